"""Quadratic Lyapunov function of the super-twisting law, in rationals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from slipctl.certify import super_twisting as sta

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
