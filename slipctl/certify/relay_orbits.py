"""Periodic runs of the sampled reaching law behind a lag: found in doubles, then proved."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from slipctl.certify.entries import DoesNotHold
from slipctl.certify.outward import Interval
from slipctl.certify.relay_sets import DIGITS, Relay

LONGEST = 400
"""Most ticks of a period."""

Pair = tuple[Interval, Interval]

Orbit = tuple[list[int], list[int]]
"""Signs of s and of d (d = -D, 0 or D) tick by tick."""


def find(law: Relay, band: float, settle: int = 1500) -> Orbit | None:
    """Periodic run in which |s| exceeds ``band``; None if none is found.

    Disturbances are tried that are constant, alternate, or push along or against s or its slope.
    """
    (m11, m12, b1), (m21, m22, b2) = (map(float, row) for row in law.rows(law.left[0]))
    e = float(law.T * law.D)
    starts = 24
    ways = 20 if e else 1
    size = band + float(law.T * law.g2) + float(law.lag * law.g2)
    angle = np.linspace(0, 2 * np.pi, starts, endpoint=False)
    reach = np.geomspace(0.05, 4, starts)[np.argsort(np.sin(7 * np.arange(starts)))]
    s = np.tile(size * reach * np.cos(angle), (ways, 1))
    a = np.tile(size * reach * np.sin(angle), (ways, 1)) / float(law.lag)
    way = np.arange(ways)[:, None]
    half = np.array([1, 1, 1, 1, 1, 1, 1, 2, 3, 4, 5, 6, 8, 10, 13, 17, 22, 29, 38, 50])[
        :ways, None
    ]
    seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for i in range(settle + 2 * LONGEST):
        side = np.sign(s)
        square = np.where((i // half) % 2 == 0, 1.0, -1.0)
        d = np.select(
            [way == 0, way == 1, way == 2, way == 3, way == 4, way == 5],
            [np.ones_like(s), np.sign(a), side, -side, np.sign(a - side * float(law.g2)),
             -np.sign(a)],
            square,
        ) * (e > 0)  # fmt: skip
        if i >= settle:
            seen.append((s, side, d))
        s, a = m11 * s + m12 * a - b1 * side + e * d, m21 * s + m22 * a - b2 * side
    S, sides, D = (np.stack(x).reshape(len(seen), -1) for x in zip(*seen, strict=True))
    top = abs(S).max(axis=0)
    for column in np.argsort(-top)[:60]:
        if not top[column] > band:
            return None
        path = S[:, column]
        scale = 1e-7 * top[column]
        for n in range(1, LONGEST):
            if abs(path[-1] - path[-1 - n]) < scale and abs(path[-2] - path[-2 - n]) < scale:
                same = np.array_equal(D[-n:, column], D[-2 * n : -n, column])
                if same and np.array_equal(sides[-n:, column], sides[-2 * n : -n, column]):
                    orbit = (sides[-n:, column].astype(int).tolist(),
                             D[-n:, column].astype(int).tolist())  # fmt: skip
                    if _exceeds(law, orbit, Fraction(band)):
                        return orbit
                break
    return None


def _exceeds(law: Relay, orbit: Orbit, band: Fraction) -> bool:
    try:
        return proved(law, *orbit)[0] > band
    except DoesNotHold:
        return False


def proved(
    law: Relay, signs: Sequence[int], pushes: Sequence[int]
) -> tuple[Fraction, tuple[Fraction, Fraction]]:
    """Lower bound of the largest |s| of a periodic run, and its start (s, a), rounded.

    Proof note: with these signs a period is x -> A x + c; its fixed point is enclosed by Cramer's
    rule. The run from it, in enclosures, has those signs, so it is a run of the law, for ever.

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
        det = (1 - first[0]) * (1 - second[1]) - first[1] * second[0]
        s = (offset[0] * (1 - second[1]) + second[0] * offset[1]) / det
        a = (offset[1] * (1 - first[0]) + first[1] * offset[0]) / det
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
