"""Replay of a seeker with a fixed dither in whole numbers of 64 decimals, as it leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

DIGITS = 64


def flight(
    n: Mapping[str, Fraction], start: Fraction, noise: Fraction, ticks: int
) -> float | None:  # fmt: skip
    """Number that |th - v*| exceeds after so many ticks, from xi = 0, eta = y; None if unknown.

    Whole numbers of 64 decimals with a bound of their error, tick by tick; the noise is -noise or
    noise, so as to drive th outward. Each product is off by less than one unit, and what a tick
    makes of the errors before it is at most its Jacobian times them.

    Args:
        n: k, w, w_l, w_h, a, curvature, T as rationals.
    """
    D = 10**DIGITS
    k, l, h, a, c, step = (
        _units(x, D) for x in (n["T"] * n["k"], n["T"] * n["w_l"], n["T"] * n["w_h"], n["a"],
                               n["curvature"] / 2, n["w"] * n["T"])
    )  # fmt: skip
    turn_s, turn_c = _sine(step, D)
    heard = _units(noise, D)
    sign = 1 if (start > 0) == (n["k"] > 0) else -1
    th, xi = _units(start, D), 0
    eta = c * (th * th // D) // D
    s, co = 0, D
    sizes = (abs(k) / D, l / D, h / D, a / D, abs(c) / D)
    e_th, e_xi, e_eta, e_s, one = 1.0, 0.0, 4.0 + sizes[4] * 8 * abs(start), 0.0, 1.0
    for _ in range(ticks):
        v = th + a * s // D
        high = c * (v * v // D) // D - eta + (heard if (s > 0) == (sign > 0) else -heard)
        x, z = abs(v) / D, abs(high) / D
        e_v = e_th + sizes[3] * e_s + 1 + one
        e_high = sizes[4] * (2 * x * e_v + e_v * e_v / D) + e_eta + x * x + 4 * sizes[4] + 4
        th_next = th + k * xi // D
        xi, eta = xi + l * (high * s // D - xi) // D, eta + h * high // D
        new_th = e_th + sizes[0] * e_xi + abs(xi) / D + 2
        new_xi = (1 + sizes[1]) * e_xi + sizes[1] * (e_high + z * e_s + 2) + z + abs(xi) / D + 4
        e_eta = e_eta + sizes[2] * e_high + z + 2
        e_th, e_xi, th = new_th * (1 + 1e-9), new_xi * (1 + 1e-9), th_next
        e_eta *= 1 + 1e-9
        s, co = (s * turn_c + co * turn_s) // D, (co * turn_c - s * turn_s) // D
        e_s = e_s * (1 + 1e-30) + 8
        if not e_th < D:
            return None
    return (abs(th) - math.ceil(e_th)) / D * (1 - 1e-12)


def _units(x: Fraction, D: int) -> int:
    return int(x * D // 1)


def _sine(x: int, D: int) -> tuple[int, int]:
    """Sine and cosine of x/D in units of 1/D, off by less than two units for |x| <= 4 D.

    Proof note: the series with ten guard digits; the first term that is left out is below a unit of
    the guard, and so is each rounding.
    """
    guard = 10**10
    x, D = x * guard, D * guard
    sine, cosine, term, count = 0, 0, D, 0
    while term:
        part = term if count % 4 < 2 else -term
        if count % 2:
            sine += part
        else:
            cosine += part
        count += 1
        term = term * x // D // count
    return sine // guard, cosine // guard
