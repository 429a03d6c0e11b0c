"""What noise does to a seeker with a dither: how far from its orbit, at least and at most.

At least: a run that is driven away from its orbit, again and again.

Proof note: let the noise be silent for so long that the loop has come to its orbit, V <= ``last``
without noise. Wait until its phase is as near to a given one as one likes (a rational w T is no
part of a turn). Then let it have the given signs, and be silent again. Of two runs of the same
noise, both with V below the ``last`` of the noisy loop, the difference d obeys (see ``dither``)

    V(d)+ <= (1 - W (mu - 2 alpha last)) V(d) + W (what the second run misses of the equations)

because the product, and what is heard late, are differences of products. mu - 2 alpha last is
positive wherever ``last`` is known. The second run starts on the orbit and is computed with floats:
what it misses is below ``MISSED`` in the rates of x, z, e and in what is heard. So |x| of the true
run is near to its |x|, as often as one likes, and not below it in the end.

At most: the distance from the orbit is what the noise makes of the linear loop, and a rest r. With
rows c(k) = (1, 0, 0) at a phase, c(k + 1) = c(k) (1 + W J) one tick earlier, the first is at most
W noise sum |c(k) . (0, l S, h)| and what is left of the state before these ticks. That is summed at
nodes, and from there to the nearest node V changes by what J and S do in that angle, over mu. r
obeys V(r)+ <= (1 - W mu) V(r) + W (what is heard late + alpha V^2 + what the orbit leaves over)
with V <= ``last``. The rows are floats: each tick is off by less than 1e-11 of them (the
angles are below 1e5), which counts times the state.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from slipctl.models.cheng_2022.certificate.ball import DOWN, WELL_DOWN, WELL_UP
from slipctl.models.cheng_2022.certificate.dither import NODES, Found, Loop, basis_at, gain
from slipctl.models.cheng_2022.certificate.dither_search import TIE, first_of_the_best

MISSED = 1e-10
"""Of numbers below ``LARGEST`` and W above ``LEAST``, a million roundings of one another."""

LARGEST, LEAST = 10.0, 1e-4
MOST_TICKS = 4000
ENDS = 64


@dataclass(frozen=True)
class Push:
    """A noise: the phase at which it starts, and whether it is positive, tick by tick."""

    angle: float
    signs: tuple[bool, ...]


def find(loop: Loop, found: Found) -> Push | None:
    """Look for the worst noise: that of the linear loop, from the end backwards.

    Args:
        loop: of floats. found: what is proven of it.
    """
    if not found.mu > 0 or not loop.noise:
        return None
    W = loop.W
    ticks = min(MOST_TICKS, math.ceil(6 / (found.mu * W)))
    ends = 2 * np.pi * np.arange(ENDS) / ENDS
    orbit = np.asarray(found.proof.orbit)
    degree = (orbit.shape[1] - 1) // 2
    gained, signs = np.zeros(ENDS), np.empty((ticks, ENDS), bool)
    for k, (push, _) in enumerate(_backwards(loop, orbit, basis_at(ends, degree), ticks), 1):
        gained += abs(push)
        signs[ticks - k] = push > -TIE * abs(push).max()
    there = orbit[0] @ basis_at(ends, degree)
    best = first_of_the_best(abs(there) + W * loop.noise * gained)
    outward = signs[:, best] if there[best] >= -TIE else ~signs[:, best]
    return Push(float(ends[best] - ticks * W), tuple(bool(x) for x in outward))


def at_least(loop: Loop, noisy: Found, quiet: Found, push: Push) -> float:
    """Number that |x| exceeds again and again under such a noise; below zero if it need not.

    Args:
        loop: of floats. noisy, quiet: what one proof says of it, and of it without noise.
    """
    q, l, h, W, noise, late, lag = loop
    rate = (noisy.mu - 2 * noisy.alpha * noisy.last * WELL_UP) * WELL_DOWN
    if not (rate > 0 and LEAST < W < 3 and max(abs(q), l, h, noise) < LARGEST):
        return -1.0
    orbit = np.asarray(noisy.proof.orbit)
    degree = (orbit.shape[1] - 1) // 2
    E = math.exp(-1 / lag) if lag else 0.0
    before = push.angle - W * np.arange(late, -1, -1.0)
    places = orbit @ basis_at(before, degree)
    line = deque((places[0] + np.sin(before)) ** 2 / 2)
    x, z, e = (float(v) for v in places[:, -1])
    line.pop()
    heard = _heard(loop, orbit, push.angle - W) if lag else 0.0
    for i, up in enumerate(push.signs):
        s = math.sin(push.angle + i * W)
        line.append((x + s) ** 2 / 2)
        y = line.popleft()
        heard = y + E * (heard - y)
        H = heard - x * x / 2 - e + (noise if up else -noise)
        x, z, e = (x - W * q * z, z + W * l * (s * H - z),
                   e + W * (h * H + q * x * z - q * q * W * z * z / 2))  # fmt: skip
        if not max(abs(x), abs(z), abs(e)) < LARGEST:
            return -1.0
    off = max(quiet.last, (sum(noisy.stiff) + noisy.loud) * MISSED / rate)
    return (abs(x) - noisy.spread * off) * WELL_DOWN - MISSED


@lru_cache(maxsize=32)
def at_most(loop: Loop, found: Found, wanted: float = math.inf) -> float:
    """Number that |x| does not exceed in the end, whatever the noise; infinite if none is known.

    Args:
        loop: of floats. found: what is proven of it. wanted: it stops once it is above that.
    """
    q, l, h, W, noise = (abs(float(v)) for v in loop[:5])
    mu, last = found.proof.mu * DOWN, found.last * WELL_UP
    if not (LEAST < W < 3 and max(q, l, h, noise) < LARGEST and mu * W < 1):
        return math.inf
    orbit = np.asarray(found.proof.orbit)
    degree = (orbit.shape[1] - 1) // 2
    most_ticks = min(MOST_TICKS, math.ceil(8 / (mu * W)))
    angles = 2 * np.pi * np.arange(NODES) / NODES
    at, size = basis_at(angles, degree), abs(orbit).sum(axis=1)
    dx, dz, de = (v * last for v in found.spreads)
    state, before = np.array([dx, dz, de]), abs(orbit[0] @ at)
    gained, most, left, ticks = np.zeros(NODES), 1.0, math.inf, 0
    for push, rows in _backwards(loop, orbit, at, most_ticks):
        gained += abs(push)
        most, ticks = max(most, float(rows.max()), -float(rows.min())), ticks + 1
        if ticks % AT_ONCE == 0 or ticks == most_ticks:
            there = float((before + W * noise * gained).max())
            left = float((state @ abs(rows)).max())
            if left < 1e-3 * there or there >= wanted:
                break
    away = math.pi / NODES
    # of a sum of degree n with coefficients c the slope is at most n sum |c|
    bend_x, bend_z = degree * float(size[0]), degree * float(size[1])
    jump = found.stiff[1] * l * (dx + de + noise) + found.stiff[2] * (
        (h + q * bend_z) * dx + (q * bend_x + q * q * W * bend_z) * dz
    )
    rest = (found.proof.mu - found.mu) * last + found.alpha * last**2
    rest += max(found.rho - found.loud * noise * WELL_DOWN, 0.0)
    V = (rest + away * jump) / mu
    blur = 1e-11 * ticks * most * (dx + dz + de + noise)
    slope = abs(_slope(orbit[0]) @ at).max() + away * degree * bend_x
    left = min(left, found.spread * last * math.exp(-mu * W * ticks))
    return (there + away * float(slope) + found.spread * V + left) * WELL_UP + blur


AT_ONCE = 64
"""Ticks whose coefficients are computed together."""


def _backwards(
    loop: Loop, orbit: np.ndarray, at: np.ndarray, ticks: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """What a noise does to x at the end, tick by tick backwards: c . (0, l S, h), and the rows c.

    Args:
        loop: of floats. orbit: its orbit. at: basis at the phases of the ends. ticks: how many.
    """
    q, l, h, W = loop[:4]
    n = np.arange(1, len(at) // 2 + 1)
    (re, im), own = gain(loop, 1), orbit[:2, None]
    a, b, d = rows = np.zeros((3, at.shape[1]))
    a += 1.0
    turned = np.empty((2, AT_ONCE, len(at)))
    turned[:, :, 0] = own[:, :, 0]
    for first in range(1, ticks + 1, AT_ONCE):
        angle = np.outer(np.arange(first, first + AT_ONCE), n) * W
        c, s = np.cos(angle), np.sin(angle)
        turned[:, :, 1::2] = own[:, :, 1::2] * c - own[:, :, 2::2] * s
        turned[:, :, 2::2] = own[:, :, 2::2] * c + own[:, :, 1::2] * s
        x, z = turned @ at
        sine = np.outer(c[:, 0], at[2]) - np.outer(s[:, 0], at[1])
        cosine = np.outer(c[:, 0], at[1]) + np.outer(s[:, 0], at[2])
        heard, low = sine * re + cosine * im, l * sine
        of_a, of_z = W * low * heard, W * (h * heard + q * z)
        of_x = W * (q * x - q * q * W * z)
        for k in range(min(AT_ONCE, ticks + 1 - first)):
            push = low[k] * b + h * d
            rows = np.empty_like(rows)
            rows[0] = a + of_a[k] * b + of_z[k] * d
            rows[1] = b - W * (q * a + l * b) + of_x[k] * d
            rows[2] = d - W * push
            a, b, d = rows
            yield push, rows


def _slope(sums: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative."""
    found, n = np.zeros_like(sums), np.arange(1, len(sums) // 2 + 1)
    found[1::2], found[2::2] = n * sums[2::2], -n * sums[1::2]
    return found


def _heard(loop: Loop, orbit: np.ndarray, angle: float) -> float:
    """What is heard of the orbit at an angle, by the harmonics of (x + S)^2/2."""
    degree = orbit.shape[1] - 1  # twice that of the orbit
    fine = 2 * np.pi * np.arange(4 * degree) / (4 * degree)
    values = (orbit[0] @ basis_at(fine, degree // 2) + np.sin(fine)) ** 2 / 2
    parts = basis_at(fine, degree) @ values * (2 / len(fine))
    own, found = basis_at(np.array([angle]), degree)[:, 0], parts[0] / 2
    for n in range(1, degree + 1):
        re, im = gain(loop, n)
        c, s = own[2 * n - 1], own[2 * n]
        found += parts[2 * n - 1] * (c * re + s * -im) + parts[2 * n] * (s * re + c * im)
    return float(found)
