"""Explicit super-twisting comes from every start into a bounded set: a polygon that shrinks.

In z = root(y), y = x1/T^2, and w = x2/T a tick in the half z > 0 is

    z+^2 = z^2 - k1 z + w,  w+ = w - c,  a <= c <= b,  a = k2 - L,  b = k2 + L

Since root(z^2 + p) <= z + p/(2 z),

    n z+ + m w+ <= n z + m w + (n (w - k1 z) - 2 m c z)/(2 z)        for n >= 0:

a convex polygon whose edges the continuous motion crosses inwards is crossed inwards by a tick of
any length. V is the size of the polygon through a state: the polygon runs from (0, 1) through
z > 0 to (0, -q), q < 1, and is mirrored for z < 0. From V >= ``level`` on, V falls by at least
``fall`` in each tick, whatever d does; so every run comes to V <= ``level`` and stays in V <=
``kept``. ``Levels.check`` proves it with rationals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import over_one
from slipctl.certify.smtlib import interval_terms, problem, sum_term, term, times
from slipctl.models.super_twisting.certificate.twisting_rows import (
    LONGEST,
    MOST_ROWS,
    Grid,
    Law,
    Rows,
)

Point = tuple[Fraction, Fraction]

MOST_CORNERS = 600
"""Most corners of a polygon."""


@dataclass(frozen=True)
class Levels:
    """The polygon and what it proves.

    Attributes:
        law: what moves the state.
        corners: (z, w) from (0, 1) over (z1, 1) to (0, -q).
        level, fall: V falls by ``fall`` a tick from ``level`` on.
    """

    law: Law
    corners: tuple[Point, ...]
    level: Fraction
    fall: Fraction

    def holds(self) -> bool:
        """Whether V falls as it says: every inequality below is decided with rationals.

        Proof note, for a state with V = lam >= level, in z >= 0 with the sign taken as +1 (the
        other half is its mirror. At z = 0 V is the larger of both sides):

        * Same half, from edge i >= 2 towards edge j: what is added to n z + m w times 2 z is the
          bracket B_j. B_j + 2 fall z <= K (lam - n z - m w) holds along edge i if it does at both
          its corners, and K <= 2 z then leaves lam - fall. w < 0 stays in this half only if
          z^2 >= -w.
        * From the top edge w = lam: w+ <= lam - a; z+^2 is convex in z, so its ends z = 0 and z1
          lam decide.
        * Across: z+^2 <= k1^2/4 + q lam, -q lam - b <= w+ <= k1^2/4 - a.

        Each is convex in lam where it has a root and linear elsewhere: its value and its slope at
        ``level`` decide for all larger ones.
        """
        slow, fast = self.law.k2 - self.law.L, self.law.k2 + self.law.L
        if not self._shaped() or not 0 < self.fall <= slow or self.level < fast:
            return False
        # in whole numbers: z and w over D, rates and sizes over R, n and m over S
        D, P = self._whole
        R, (k1, a, b, lam, fall) = over_one((self.law.k1, slow, fast, self.level, self.fall))
        q, z1 = -P[-1][1], P[1][0]
        inside = k1 * k1 * D + 4 * R * q * lam  # k1^2/4 + q lam, over 4 R^2 D
        end = 2 * z1 * z1 * lam + D * (R * D - k1 * z1)  # of the top edge, over 2 D R z1
        for j, ((z, w), (z2, w2)) in enumerate(pairwise(P)):
            n, m, S = (w - w2) * D, (z2 - z) * D, w * z2 - z * w2
            up, down = max(m, 0), max(-m, 0)
            # across
            spare = 4 * R * (S * D * (lam - fall) - up * (q * lam + b * D)) - down * k1 * k1 * D
            slope = S * D - up * q
            if spare < 0 or spare**2 < 4 * n * n * inside * R * R * D or slope < 0:
                return False
            if slope**2 * inside < (n * q * R) ** 2 * D:
                return False
            if j == 0:
                continue
            # from the top edge
            spare, slope = (S - up) * lam + up * a - S * fall, S - up
            if spare < 0 or spare**2 < n * n * lam * R or 4 * slope**2 * lam < n * n * R:
                return False
            if (S - up) * D < n * z1:
                return False
            if n * end + 2 * D * z1 * up * (lam - a) > 2 * D * z1 * S * (lam - fall):
                return False
        return self._crossed_inwards()

    def _crossed_inwards(self) -> bool:
        """From every edge but the top one: K <= 2 z, or K^2 <= 4 |w| where w < 0.

        In whole numbers, because there are many: z and w over D, rates over R; K is
        bracket/(R D gap) with the common factors left out.
        """
        a, b = self.law.k2 - self.law.L, self.law.k2 + self.law.L
        D, P = self._whole
        R, (k1, slow, fast, fall) = over_one((self.law.k1, a, b, self.fall))
        top, bottom = self.level.numerator, self.level.denominator
        pull = [w * R - k1 * z for z, w in P]
        limits = []  # of K and K^2 along each edge, times D bottom
        for (z, w), (z2, w2) in pairwise(P[1:]):
            limits.append((2 * min(z, z2) * top, 4 * max(0, -max(w, w2)) * top))
        for (z1, w1), (z2, w2) in pairwise(P[1:]):
            across, along = w2 - w1, z1 - z2
            size = -(z1 * w2 - w1 * z2)
            rate = 2 * along * (fast if along >= 0 else slow)  # m > 0 where along < 0
            lean = 2 * fall * size
            bracket = [
                lean * z - D * (across * p - rate * z) for (z, _), p in zip(P, pull, strict=True)
            ]
            for i, (of_K, of_square) in enumerate(limits, 1):
                for x in (i, i + 1):
                    if bracket[x] > 0:
                        gap = R * D * (size + across * P[x][0] + along * P[x][1])
                        K = bracket[x] * bottom * D
                        if of_K * gap < K and K * bracket[x] > of_square * gap * gap:
                            return False
        return True

    @cached_property
    def _whole(self) -> tuple[int, list[tuple[int, int]]]:
        """Common denominator of the corners, and their numerators."""
        D, flat = over_one([x for corner in self.corners for x in corner])
        return D, list(zip(flat[::2], flat[1::2], strict=True))

    @cached_property
    def kept(self) -> Fraction:
        """V stays below this once it has been below ``level``; rounded up.

        Proof note: from V <= lam = level a tick in the same half leads to z+ <= zm lam + 1/(2 zm),
        -q lam - b <= w+ <= lam. It also adds at most root(lam) to z, because z+^2 <= z^2 + lam, and
        takes at most b from w, and n z + m w was at most lam. Across it leads to
        z+^2 <= k1^2/4 + q lam, |w+| <= q lam + b or w+ <= k1^2/4.
        """
        k1, lam = self.law.k1, self.level
        b = self.law.k2 + self.law.L
        q, far = -self.corners[-1][1], max(z for z, _ in self.corners)
        same = far * lam + 1 / (2 * far)
        root = math.isqrt(math.ceil(k1 * k1 / 4 + q * lam)) + 1
        further = math.isqrt(math.ceil(lam)) + 1
        found = lam
        for n, m in self.edges():
            up, down = max(m, Fraction(0)), max(-m, Fraction(0))
            found = max(
                found,
                min(n * same + up * lam + down * (q * lam + b), lam + n * further + down * b),
                n * root + up * (q * lam + b) + down * k1 * k1 / 4,
            )
        return found

    def rows(self, grid: Grid) -> Rows:
        """Rows that cover V <= ``kept``.

        Raises:
            OverflowError: that takes too many, or too many units.
        """
        kept = self.kept
        n = math.ceil(kept / grid.height)
        if 2 * n > MOST_ROWS:
            raise OverflowError(f"{2 * n} rows are needed")
        z, w = np.array([[float(x) for x in corner] for corner in self.corners]).T
        edges = np.arange(-n, n + 1) * float(grid.height) / float(kept)
        low, high = edges[:-1] - 1e-12, edges[1:] + 1e-12
        # z is concave in w: largest in a row at an end of it, or at the corner that reaches far
        order, tip = np.argsort(w[1:], kind="stable") + 1, int(z.argmax())
        across = np.maximum(np.interp(low, w[order], z[order]), np.interp(high, w[order], z[order]))
        across = np.where((low <= w[tip]) & (w[tip] <= high), z[tip], across)
        y = (across * float(kept)) ** 2 / float(grid.unit) * (1 + 1e-9)
        ends = np.where(high < w[-1], 0.0, np.ceil(y))
        if ends.max() > LONGEST:
            raise OverflowError("y has too many units")
        return Rows(grid, ends)

    def edges(self) -> Iterator[Point]:
        """Give (n, m) with n z + m w = 1 along each edge."""
        for (z, w), (z2, w2) in pairwise(self.corners):
            size = z * w2 - w * z2
            yield (w2 - w) / size, (z - z2) / size

    def _shaped(self) -> bool:
        """Whether it is convex, turns clockwise around the origin, and has 0 < q < 1.

        Proof note: no edge rises, and each turns clockwise from the one before. So seen from any
        edge all later ones go inwards, and all earlier ones came from there.
        """
        P = self.corners
        if (
            not 4 <= len(P) <= MOST_CORNERS
            or P[0] != (0, 1)
            or P[1][1] != 1
            or P[1][0] <= 0
            or P[-1][0] != 0
        ):
            return False
        if not 0 < -P[-1][1] < 1 or min(z for z, _ in P[1:-1]) <= 0:
            return False
        if any(z * w2 - w * z2 >= 0 for (z, w), (z2, w2) in pairwise(P)):
            return False
        edges = [(z2 - z, w2 - w) for (z, w), (z2, w2) in pairwise(P)]
        if any(fall > 0 for _, fall in edges):
            return False
        return all(z * w2 - w * z2 <= 0 for (z, w), (z2, w2) in pairwise(edges))


def smt_steps(levels: Levels) -> Iterator[str]:
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


def _turn(corner: Point, state: tuple[str, str], way: int) -> str:
    """Cross product of a corner and a state, positive where it is counter-clockwise, times way."""
    z, w = corner
    return sum_term(times(way * z, state[1]), times(-way * w, state[0]))
