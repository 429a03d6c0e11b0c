"""Replay of a seeker with a fixed dither in whole numbers of 64 decimals, as it leaves."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from decimal import Context, Decimal
from fractions import Fraction

from slipctl.models.cheng_2022.certificate.ball import DOWN, WELL_UP

DIGITS = 64

OLDEST = 5000
"""Longest dead time of a run, in ticks."""


def ticks(
    n: Mapping[str, float], start: float, late: int, outward: bool, most: int, beyond: float = -1
) -> Iterator[tuple[int, float]]:
    """The seeker tick by tick, in floats: number of the tick, from 1, and th - v* after it.

    Before the first tick the dither alone has run, so that what is heard is at rest with it.

    Args:
        n: numbers of the system. start: th - v*. late: ticks of the dead time.
        outward: whether the noise drives th outward; there is none otherwise.
        most: ticks. beyond: only those are given in which |th - v*| is more.
    """
    k, w, w_l, w_h, a, c, T = (float(n[x]) for x in ("k", "w", "w_l", "w_h", "a", "curvature", "T"))
    noise = float(n.get("noise", 0)) if outward else 0.0
    E = math.exp(-T / n["lag"]) if n.get("lag") else 0.0
    line = deque((start + a * math.sin(-w * T * j)) ** 2 for j in range(late, 0, -1))
    th, xi, eta = start, 0.0, c / 2 * start * start
    heard = _at_rest(start, a, w * T, late, E) if E else 0.0
    for i in range(most):
        s = math.sin(w * T * i)
        line.append((th + a * s) ** 2)
        y = line.popleft()
        heard = y + E * (heard - y) if E else y
        high = c / 2 * heard - eta + (noise and math.copysign(noise, s * start * k))
        th, xi, eta = th + T * k * xi, xi + T * w_l * (high * s - xi), eta + T * w_h * high
        if not abs(th) <= beyond:
            yield i + 1, th


def _at_rest(start: float, a: float, W: float, late: int, E: float) -> float:
    """What is heard of (start + a sin)^2 one tick before the first."""
    found = start * start + a * a / 2
    for n, size in ((1, 2 * start * a), (2, -a * a / 2)):
        c, s = math.cos(n * W), math.sin(n * W)
        own = (1 - E) / complex(1 - E * c, E * s)
        own *= complex(math.cos(n * W * (late + 1)), -math.sin(n * W * (late + 1)))
        found += size * (own.imag if n == 1 else own.real)
    return found


def flight(
    n: Mapping[str, Fraction], start: Fraction, noise: Fraction, ticks: int, late: int = 0
) -> float | None:  # fmt: skip
    """Number that |th - v*| exceeds after so many ticks, from xi = 0, eta = y; None if unknown.

    Whole numbers of 64 decimals with a bound of their error, tick by tick; the noise is -noise or
    noise, so as to drive th outward. Each product is off by less than one unit, and what a tick
    makes of the errors before it is at most its Jacobian times them.

    Args:
        n: k, w, w_l, w_h, a, curvature, T, and lag or none, as rationals. late: dead time in ticks.
    """
    D = 10**DIGITS
    k, l, h, a, c, step = (
        _units(x, D) for x in (n["T"] * n["k"], n["T"] * n["w_l"], n["T"] * n["w_h"], n["a"],
                               n["curvature"] / 2, n["w"] * n["T"])
    )  # fmt: skip
    turn_s, turn_c = _sine(step, D)
    noise_units = _units(noise, D)
    sign = 1 if (start > 0) == (n["k"] > 0) else -1
    th, xi = _units(start, D), 0
    eta = c * (th * th // D) // D
    sizes = tuple((abs(x) + 1) / D for x in (k, l, h, a, c))  # a unit more: of what each may be
    e_th, e_xi, e_eta, one = 1.0, 0.0, 4.0 + sizes[4] * 8 * abs(start), 1.0

    s, co, e_s = 0, D, 0.0
    for _ in range(late + 1):  # back to the tick before the first that is heard
        s, co = (s * turn_c - co * turn_s) // D, (co * turn_c + s * turn_s) // D
        e_s = e_s + 8
    E = _forgotten(n["T"] / n["lag"], D) if n.get("lag") else 0
    heard, e_heard = 0, 0.0
    if E:
        found = _rest(th, a, E, (turn_c, turn_s), (co, s), D)
        if found is None:
            return None
        heard, e_heard = found[0], (found[1] + e_s) * (1 + (abs(float(start)) + sizes[3]) ** 2)
    line: deque[tuple[int, float]] = deque()
    for i in range(-late, ticks):
        s, co = (s * turn_c + co * turn_s) // D, (co * turn_c - s * turn_s) // D
        e_s = e_s + 8
        v = th + a * s // D
        e_v = e_th + sizes[3] * e_s + 1 + one
        line.append((v * v // D, 2 * abs(v) / D * e_v + e_v * e_v / D + 1))
        if i < 0:
            continue
        u, e_u = line.popleft()
        if E:
            e_heard = (1 - E / D) * e_u + E / D * e_heard + abs(u - heard) / D + 3
            u, e_u = u + E * (heard - u) // D, e_heard * WELL_UP
            heard, e_heard = u, e_u
        high = c * u // D - eta + (noise_units if (s > 0) == (sign > 0) else -noise_units)
        z = abs(high) / D
        e_high = sizes[4] * e_u + e_eta + abs(u) / D + 4 * sizes[4] + 4
        th_next = th + k * xi // D
        xi, eta = xi + l * (high * s // D - xi) // D, eta + h * high // D
        new_th = e_th + sizes[0] * e_xi + abs(xi) / D + 2
        new_xi = (1 + sizes[1]) * e_xi + sizes[1] * (e_high + z * e_s + 2) + z + abs(xi) / D + 4
        e_eta = e_eta + sizes[2] * e_high + z + 2
        e_th, e_xi, th = new_th * WELL_UP, new_xi * WELL_UP, th_next
        e_eta *= WELL_UP
        if not e_th < D:
            return None
    return (abs(th) - math.ceil(e_th)) / D * DOWN


def _rest(
    th: int, a: int, E: int, turn: tuple[int, int], at: tuple[int, int], D: int
) -> tuple[int, float] | None:
    """What a lag makes of (th + a sin)^2 at an angle, and its error for th = a = 1, or None.

    Proof note: of exp(i n phi) it makes (1 - E)/(1 - E exp(-i n W)) times it. The square of what is
    divided by is at least (1 - E)^2, asked to be above 1e-12 here, and each product is off by a few
    units.
    """
    total = th * th // D + a * a // (2 * D)
    for n in (1, 2):
        (c, s), (x, y) = (turn, at) if n == 1 else (_twice(*turn, D), _twice(*at, D))
        size = D - 2 * E * c // D + E * E // D
        if size < D // 10**12:
            return None
        re, im = (D - E) * (D - E * c // D) // size, -(D - E) * (E * s // D) // size
        if n == 1:
            total += 2 * th * a // D * (re * y + im * x) // D**2
        else:
            total -= a * a // (2 * D) * (re * x - im * y) // D**2
    return total, 1e27


def _twice(c: int, s: int, D: int) -> tuple[int, int]:
    """Cosine and sine of twice the angle."""
    return (2 * c * c - D * D) // D, 2 * c * s // D


def _forgotten(x: Fraction, D: int) -> int:
    """exp(-x) in units of 1/D, off by less than one."""
    context = Context(prec=DIGITS + 20)
    quotient = context.divide(Decimal(x.numerator), Decimal(x.denominator))
    return int(context.multiply(context.exp(-quotient), Decimal(D)))


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
