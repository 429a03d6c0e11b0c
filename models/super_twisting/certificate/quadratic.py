"""Inequalities of the super-twisting law, and a quadratic Lyapunov function of it in rationals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

from slipctl.certify import smtlib
from slipctl.certify.arithmetic import decimal_intervals
from slipctl.certify.promise import Side
from slipctl.models.super_twisting.certificate import super_twisting as sta

Matrix = tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]


def minors(gains: Mapping[str, Fraction], P: Matrix, theta: Fraction) -> tuple[Fraction, ...]:
    """Leading minors of -[[A'P + PA + theta L^2 C'C, P B], [B'P, -theta]], and det P.

    A = [[-k/2, 1/2], [-k2, 0]] with k = k1 - delta, B = (0, 1)', C = (1, 0). All positive: V falls.

    Proof note: |x1|^(1/2) V' = zeta' (A'P + PA) zeta + 2 zeta' P B w with w^2 <= L^2 zeta1^2 is
    below the quadratic form of that matrix in (zeta, w).
    """
    k, k2, L = gains["k1"] - gains["delta"], gains["k2"], gains["L"]
    (p, r), (_, s) = P
    a = k * p + 2 * k2 * r - theta * L**2
    b = -(p / 2 - k * r / 2 - k2 * s)
    c = -r
    second = a * c - b * b
    third = theta * second - (a * s * s - 2 * b * r * s + c * r * r)
    return a, second, third, p * s - r * r


def find_quadratic(gains: Mapping[str, Fraction]) -> dict[str, Any] | None:
    """Quadratic function in closed form, rounded to as few digits as still prove it.

    Args:
        gains: k1, k2, L and delta.

    Returns:
        P, theta, minors and det_P as texts, or None if the criterion does not hold.
    """
    k, k2, L = gains["k1"] - gains["delta"], gains["k2"], gains["L"]
    if k <= 0 or not sta.quadratic(k, k2, L):
        return None
    for digits in (4, 6, 9, 14, 20, 30, 45):
        root = _root_below(k2 * k2 - L * L, digits)
        if root is None:
            continue
        raw = [_short(x, digits) for x in sta.quadratic_matrix(k, k2, L, root)]
        P = ((raw[0], raw[1]), (raw[1], raw[2]))
        found = minors(gains, P, Fraction(1))
        if min(*found, raw[0]) > 0:
            return {
                "P": [[str(x) for x in row] for row in P],
                "theta": "1",
                "minors": [str(x) for x in found[:3]],
                "det_P": str(found[3]),
            }
    return None


def _root_below(x: Fraction, digits: int) -> Fraction | None:
    """Rational at most sqrt(x) with about this many digits."""
    scale = _scale(x, 2 * digits + 2)
    scale *= scale
    root = Fraction(math.isqrt(int(x * scale)), math.isqrt(scale))
    return root if root > 0 else None


def _scale(x: Fraction, digits: int) -> int:
    """Power of ten at which x has about this many digits."""
    size = len(str(x.numerator)) - len(str(x.denominator))
    return int(10 ** max(digits - size, 0))


def _short(x: Fraction, digits: int) -> Fraction:
    """Round to about this many significant digits."""
    scale = _scale(abs(x), digits)
    return Fraction(round(x * scale), scale)


def exact_sides(k1: Any, k2: Any, L: Any, names: tuple[str, str, str]) -> list[Side]:
    """Inequalities of ``super_twisting.exact``, the last one an enclosure for rationals.

    Args:
        k1, k2, L: gains and bound of the disturbance's slope.
        names: how the texts call them.
    """
    a, b, c = names
    sides = [Side(f"0 < {a}", 0, k1), Side(f"{c} < {b}", L, k2)]
    if not (k1 > 0 and k2 > L):
        return sides
    if k1 * k1 >= 8 * (k2 + L):
        return [*sides, Side(f"8 ({b} + {c}) <= ({a})^2", 8 * (k2 + L), k1 * k1)]
    if not isinstance(k1, Fraction):
        return [*sides, Side("ln q < 0", sta.log_ratio(k1, k2, L), 0)]
    found = sta.enclosure_of_log_ratio(k1, Fraction(k2), Fraction(L))
    low, high = found or (Decimal(-1), Decimal(1))
    return [
        *sides,
        Side("ln q < 0", decimal_intervals.Interval(low, high, sta.DIGITS), 0),
    ]


def quadratic_sides(
    k1: Any, k2: Any, L: Any, names: tuple[str, str, str], P: Sequence[Any] = ()
) -> list[Side]:  # fmt: skip
    """Inequalities of ``super_twisting.quadratic``, or of a matrix P = (P11, P12, P22) if given.

    Proof note: with a matrix, that the leading minors of ``minors`` are positive.
    """
    a, b, c = names
    if P:
        gains = {"k1": k1, "k2": k2, "L": L, "delta": Fraction(0)}
        found = minors(gains, ((P[0], P[1]), (P[1], P[2])), Fraction(1))
        texts = ("minor 1", "minor 2", "minor 3", "det P")
        return [Side("0 < P11", 0, P[0]),
                *(Side(f"0 < {t}", 0, x) for t, x in zip(texts, found, strict=True))]  # fmt: skip
    if k1 * k1 >= 4 * k2:
        return [Side(f"4 {b} <= ({a})^2", 4 * k2, k1 * k1), Side(f"{c} < {b}", L, k2)]
    return [Side(f"16 {c}^2 < ({a})^2 (8 {b} - ({a})^2)", 16 * L * L, k1 * k1 * (8 * k2 - k1 * k1))]


def matrix(k1: Fraction, k2: Fraction, L: Fraction) -> dict[str, Fraction] | None:
    """Matrix of a quadratic Lyapunov function as multipliers; None if there is none."""
    found = find_quadratic({"k1": k1, "k2": k2, "L": L, "delta": Fraction(0)})
    if found is None:
        return None
    (a, b), (_, c) = found["P"]
    return {"P11": Fraction(a), "P12": Fraction(b), "P22": Fraction(c)}


MATRIX = ("P11", "P12", "P22")


def fall(k1: Fraction, k2: Fraction, L: Fraction, P: Sequence[Fraction]) -> str:
    """Step of the proof by P as SMT-LIB: V > 0 and V' < 0 for all zeta but 0.

    V' is |x1|^(1/2) times that in time, zeta = (y, z), y = |x1|^(1/2) sgn x1, w = d |y|,
    so that w^2 <= L^2 y^2.
    """
    y, z, w = "y", "z", "w"
    first = smtlib.sum_term(smtlib.times(-k1 / 2, y), smtlib.times(Fraction(1, 2), z))
    second = smtlib.sum_term(smtlib.times(-k2, y), w)
    rows = [smtlib.sum_term(smtlib.times(P[i], y), smtlib.times(P[i + 1], z)) for i in (0, 1)]
    V = smtlib.sum_term(smtlib.times(rows[0], y), smtlib.times(rows[1], z))
    slope = smtlib.sum_term(smtlib.times(rows[0], first), smtlib.times(rows[1], second))
    facts = [
        smtlib.term("<=", smtlib.times(w, w), smtlib.times(L * L, y, y)),
        smtlib.term("=", smtlib.sum_term(smtlib.times(y, y), smtlib.times(z, z)), 1),
    ]
    claim = smtlib.term("and", smtlib.term(">", V, 0), smtlib.term("<", slope, 0))
    return smtlib.problem((y, z, w), facts, claim)
