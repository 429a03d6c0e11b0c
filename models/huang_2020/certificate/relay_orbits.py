"""Periodic runs of the sampled reaching law behind a lag: found in doubles, then proved."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold
from slipctl.models.huang_2020.certificate.relay_sets import DIGITS, Relay

LONGEST = 400
"""Most ticks of a period."""

HALF_PERIODS = (1, 2, 3, 4, 5, 6, 8, 10, 13, 17, 22, 29, 38, 50)
"""Ticks between the turns of a disturbance that alternates."""

Pair = tuple[Interval, Interval]

Orbit = tuple[tuple[int, ...], tuple[int, ...], float]
"""Signs of s and of d (d = -D, 0 or D) tick by tick, and about where s starts."""


@lru_cache(maxsize=8)
def find(law: Relay, band: Fraction) -> Orbit | None:
    """Periodic run in which |s| exceeds ``band``; None if none is found.

    Disturbances are tried that are constant, alternate, or push along or against s or its slope.
    """
    pushed = law.T * law.D > 0
    for settle, longest in ((300, 100), (1500, LONGEST)):
        S, A, sides, D = _runs(law, float(band), settle, 2 * longest)
        top = abs(S).max(axis=0)
        for column in np.argsort(-top)[:60]:
            if not top[column] > band:
                return None
            n = _period(S[:, column], A[:, column], longest)
            signs, d = sides[-n:, column], D[-n:, column]
            if n and (not pushed or np.array_equal(d, D[-2 * n : -n, column])) \
                    and np.array_equal(signs, sides[-2 * n : -n, column]):  # fmt: skip
                told, pushes = (tuple(int(v) for v in x) for x in (signs, d))
                orbit = told, pushes, 0.0 if law.g1 else float(S[-n, column])
                if _exceeds(law, orbit, band):
                    return orbit
    return None


def _runs(
    law: Relay, band: float, settle: int, kept: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Runs s, a, signs of s and of d, (ticks, runs): what is kept after they have settled."""
    (m11, m12, b1), (m21, m22, b2) = (map(float, row) for row in law.rows(law.left[0]))
    e = float(law.T * law.D)
    starts = 24
    ways = 6 + len(HALF_PERIODS) if e else 1
    size = band + float(law.T * law.g2) + float(law.lag * law.g2)
    angle = np.linspace(0, 2 * np.pi, starts, endpoint=False)
    reach = np.geomspace(0.05, 4, starts)[np.argsort(np.sin(7 * np.arange(starts)))]
    s = np.tile(size * reach * np.cos(angle), (ways, 1))
    a = np.tile(size * reach * np.sin(angle), (ways, 1)) / float(law.lag)
    g2, half = float(law.g2), np.array(HALF_PERIODS)[:, None]
    seen = np.empty((4, kept, *s.shape))
    d = np.zeros_like(s)
    waves = 1.0 - 2.0 * ((np.arange(settle + kept)[:, None, None] // half) % 2)
    for i in range(settle + kept):
        side = np.sign(s)
        if e:
            d[0], d[2], d[3], d[6:] = 1.0, side[2], -side[3], waves[i]
            d[1], d[4], d[5] = np.sign(a[1]), np.sign(a[4] - side[4] * g2), -np.sign(a[5])
        if i >= settle:
            seen[:, i - settle] = s, a, side, d
        s, a = m11 * s + m12 * a - b1 * side + e * d, m21 * s + m22 * a - b2 * side
    S, A, sides, D = seen.reshape(4, kept, -1)
    return S, A, sides, D


def _period(s: np.ndarray, a: np.ndarray, longest: int) -> int:
    """Ticks after which the end of a run was there before; 0 if it was not."""
    near = 1e-7 * abs(s).max(), 1e-7 * abs(a).max()
    same = abs(s[:-1] - s[-1]) < near[0]
    same &= abs(a[:-1] - a[-1]) < near[1]
    found = np.flatnonzero(same[::-1][: longest - 1])
    return int(found[0]) + 1 if len(found) else 0


def _exceeds(law: Relay, orbit: Orbit, band: Fraction) -> bool:
    try:
        return prove_orbit(law, *orbit)[0] > band
    except DoesNotHold:
        return False


@lru_cache(maxsize=8)
def prove_orbit(
    law: Relay, signs: tuple[int, ...], pushes: tuple[int, ...], near: float | Fraction = 0
) -> tuple[Fraction, tuple[Fraction, Fraction]]:
    """Lower bound of the largest |s| of a periodic run, and its start (s, a), rounded.

    Proof note: with these signs a period is x -> A x + c; its fixed point is enclosed by Cramer's
    rule. The run from it, in enclosures, has those signs, so it is a run of the law, for ever.
    Without g1 each s is as good as another: s + lag a moves by T (d - g2 sgn s) alone, and comes
    back if these sum up to nothing. Then the run starts at ``near``, and a is the fixed point.

    Raises:
        DoesNotHold: A - 1 may be singular, or a sign of s is not the one that is told.
    """
    left = Interval.of(-law.T / law.lag, DIGITS).exp()
    taken = 1 - left
    reach = taken * law.lag
    held = law.T - reach
    m11, m21 = 1 - held * law.g1, -(taken * law.g1)
    zero, one = Interval.of(0, DIGITS), Interval.of(1, DIGITS)

    def turned(x: Pair) -> Pair:
        return m11 * x[0] + reach * x[1], m21 * x[0] + left * x[1]

    def tick(x: Pair, sign: int, push: int) -> Pair:
        s, a = turned(x)
        s = s - held * (law.g2 * sign) + law.T * law.D * push
        return s, a - taken * (law.g2 * sign)

    first, second, offset = (one, zero), (zero, one), (zero, zero)
    for sign, push in zip(signs, pushes, strict=True):
        first, second, offset = turned(first), turned(second), tick(offset, sign, push)
    try:
        if law.g1:
            det = (1 - first[0]) * (1 - second[1]) - first[1] * second[0]
            s = (offset[0] * (1 - second[1]) + second[0] * offset[1]) / det
            a = (offset[1] * (1 - first[0]) + first[1] * offset[0]) / det
        else:
            if law.D * sum(pushes) != law.g2 * sum(signs):
                raise DoesNotHold("run: s drifts from period to period")
            s, a = Interval.of(Fraction(near), DIGITS), offset[1] / (1 - second[1])
    except ZeroDivisionError:
        raise DoesNotHold("run: the period has no single start") from None
    start = (s.ends()[0] + s.ends()[1]) / 2, (a.ends()[0] + a.ends()[1]) / 2
    largest = Fraction(0)
    for sign, push in zip(signs, pushes, strict=True):
        low, high = s.ends()
        if (low <= 0 if sign > 0 else high >= 0) or not sign:
            raise DoesNotHold("run: s does not have the sign that is told")
        largest = max(largest, min(abs(low), abs(high)))
        s, a = tick((s, a), sign, push)
    return largest, start
