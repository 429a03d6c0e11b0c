"""Steps of the proofs by polygons as SMT-LIB: super-twisting and the reaching law as sampled.

What is written is that every run comes into the polygon (its size falls by a stated amount in each
tick outside) and how far it can leave it again. The ticks after that are gone through by ``check``:
they are ten thousands of sums, and no inequality.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise

from slipctl.certify.relay_sets import Absorbing, Point
from slipctl.certify.smtlib import interval_terms, problem, sum_term, term, times
from slipctl.certify.twisting_levels import Levels


def twisting_steps(levels: Levels) -> Iterator[str]:
    """Tick of explicit super-twisting from each edge of its polygon, against each other edge.

    In z = root(x1/T^2) and w = x2/T, z >= 0, the sign is taken as +1. The size lam of the polygon
    through the state is n z + m w on the edge whose cone it is in. After the tick z is p; where
    x1 changes its sign the mirrored state is measured.
    """
    law, edges = levels.law, list(levels.edges())
    c = interval_terms(law.k2 - law.L, "c", law.k2 + law.L)
    moved = sum_term(times("z", "z"), times(-law.k1, "z"), "w")
    kept = levels.kept
    for (P, Q), (n, m) in zip(pairwise(levels.corners), edges, strict=True):
        size = sum_term(times(n, "z"), times(m, "w"))
        cone = [term("<=", 0, "z"), term("<=", 0, _turn(P, ("z", "w"), -1)),
                term("<=", 0, _turn(Q, ("z", "w"), 1))]  # fmt: skip
        for side in (1, -1):
            root = [term("<=", 0, "p"), term("=", times("p", "p"), times(side, moved))]
            after = times(side, sum_term("w", times(-1, "c")))
            sizes = [sum_term(times(n2, "p"), times(m2, after)) for n2, m2 in edges]
            outside = term("<=", levels.level, size)
            falls = term("and", *(term("<=", x, sum_term(size, -levels.fall)) for x in sizes))
            stays = term("and", *(term("<=", x, kept) for x in sizes))
            yield problem("zwcp", [*cone, *c, *root, outside], falls)
            yield problem("zwcp", [*cone, *c, *root, term("not", outside)], stays)


def relay(polygon: Absorbing) -> Iterator[str]:
    """Tick of the reaching law behind a lag from lam >= 1 times its polygon, against each side.

    For both ends of E = exp(-T/lag): the state that follows is affine in E, as is all else.
    """
    law = polygon.law
    push = law.T * law.D
    faces = list(_faces(polygon.corners))
    inside = [term("<=", sum_term(times(n, "s"), times(m, "a")), "lam") for n, m in faces]
    facts = [term("<=", 1, "lam"), term("<=", 0, "s"), *interval_terms(-push, "e", push), *inside]
    for left in outward(law.left):
        (m11, m12, b1), (m21, m22, b2) = law.rows(left)
        claims = []
        for n, m in faces:
            moved = [times(n * m11 + m * m21, "s"), times(n * m12 + m * m22, "a"), times(n, "e")]
            claims.append(term("<", sum_term(*moved, -n * b1 - m * b2), "lam"))
        yield problem(("s", "a", "e", "lam"), facts, claims, "QF_LRA")


def outward(ends: tuple[Fraction, Fraction], digits: int = 15) -> tuple[Fraction, Fraction]:
    """Interval with short ends that holds the one given."""
    one = 10**digits
    return Fraction(math.floor(ends[0] * one), one), Fraction(math.ceil(ends[1] * one), one)


def _faces(P: Sequence[Point]) -> Iterator[Point]:
    """Give (n, m) with n s + m a = 1 along each side of a polygon."""
    for (s, a), (s2, a2) in zip(P, [*P[1:], P[0]], strict=True):
        size = s * a2 - a * s2
        yield (a2 - a) / size, (s - s2) / size


def _turn(corner: Point, state: tuple[str, str], way: int) -> str:
    """Cross product of a corner and a state, positive where it is counter-clockwise, times way."""
    z, w = corner
    return sum_term(times(way * z, state[1]), times(-way * w, state[0]))
