"""Explicit super-twisting whose command comes late: behind a lag, a dead time, from noisy errors.

The law computes u = -k1 root(y + n) + v and v+ = v - k2 sgn(y + n), |n| <= N; w = v + phi. What is
delivered, j ticks late and behind a lag tau (in ticks), is a:

    y+ = y + u' + tau (1 - E) (a - u') + phi,  a+ = u' + E (a - u'),  u' = u j ticks ago,
    E = exp(-1/tau)

Then Y = y + tau (a + phi), j ticks ahead, is driven as if nothing were late:

    Y+ = Y + u + phi + tau d                     (phi j ticks ahead, and in w too)

and the law sees Y with a larger error, the way that y has before it. a + phi is a mean of former
u + phi, and phi moves by L a tick. So |a + phi| and |y+ - y| are at most P = U + L/(1 - E), U the
largest |u + phi|. So a tick is that of ``twisting_rows`` with

    N' = N + (tau + j) P,   M' = tau L,   |y| <= |Y| + tau P

from rest: y = w = a = 0. A set of rows that holds the origin, that no such tick leaves, and in
which |w - k1 root(Y + n)| + L/(1 - E) <= P, holds every run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Grid, Law, Rows, origin

BITS = 10
MOST_TICKS = 1000
"""Most ticks of a run: enough for a slow lag to swing the loop up from rest."""

MOST_WORK = 0.6
"""Limit of the work of a search, about seconds; ``holds`` takes no more than twice that."""

Pair = tuple[int, int]


@dataclass(frozen=True)
class Late:
    """Law with what makes its command late.

    Attributes:
        law: gains and noise, without a matched error. lag: over T. dead: in whole ticks.
    """

    law: Law
    lag: Fraction
    dead: int

    def left(self, digits: int = 60) -> tuple[Fraction, Fraction]:
        """Bounds of E; of a very short lag from above."""
        if not self.lag:
            return Fraction(0), Fraction(0)
        low, high = Interval.of(-1 / max(self.lag, Fraction(1, 20)), digits).exp().ends()
        return (low if self.lag * 20 >= 1 else Fraction(0)), high

    def drift(self) -> Fraction:
        """L/(1 - E), rounded up; 0 without a lag."""
        return _short(self.law.L / (1 - self.left()[1])) if self.lag else Fraction(0)

    def under(self, P: Fraction) -> Law:
        """Law of the state ahead, rounded up so that its numbers stay short."""
        law = self.law
        return replace(law, N=_short(law.N + (self.lag + self.dead) * P),
                       M=_short(self.lag * law.L))  # fmt: skip


@dataclass(frozen=True)
class Kept:
    """A set that every run from rest stays in.

    Attributes:
        late: the law. P: bound of a step of y. parts: rows in k2 - L. ticks: after which the set
            has grown to its end. y: bound of |y| in it.
    """

    late: Late
    P: Fraction
    parts: int
    ticks: int
    y: Fraction

    def holds(self) -> bool:
        """Whether it does, by growing it once more."""
        try:
            rows = origin(Grid(self.late.under(self.P), self.parts, BITS))
            rows, ticks, _ = _grown(rows, self.ticks, 2 * MOST_WORK)
        except OverflowError:
            return False
        if ticks is None or step(rows) + self.late.drift() > self.P:
            return False
        return rows.largest() + self.late.lag * self.P <= self.y


def _grown(rows: Rows, most: int, room: float) -> tuple[Rows, int | None, float]:
    """The set with its images, until none is new; None for the ticks if that takes more."""
    work = 0.0
    for tick in range(1, most + 1):
        new = _joined(rows, rows.tick())
        work += 9e-5 + 4e-8 * len(new.ends)
        if np.array_equal(new.ends, rows.ends):
            return rows, tick, work
        rows = new
        if work > room:
            break
    return rows, None, work


def _joined(one: Rows, two: Rows) -> Rows:
    n = max(len(one.ends), len(two.ends)) // 2
    ends = np.full(2 * n, EMPTY)
    for rows in (one, two):
        k = len(rows.ends) // 2
        ends[n - k : n + k] = np.maximum(ends[n - k : n + k], rows.ends)
    return Rows(one.grid, ends)


def step(rows: Rows) -> Fraction:
    """Bound U of |w - k1 root(Y + n)| in the set.

    Proof note: it is largest where Y is least and w is at the upper edge of its row; the set is its
    own mirror image.
    """
    grid, n = rows.grid, len(rows.ends) // 2
    live = rows.ends > EMPTY
    low = np.where(live, -rows.ends[::-1], 0.0) - grid.noise
    top = np.arange(1 - n, n + 1) * 2.0**grid.bits
    pull = np.where(low >= 0, -grid.least_root(np.maximum(low, 0.0)),
                    grid.most_root(np.maximum(-low, 0.0)))  # fmt: skip
    return int(np.where(live, top + pull, EMPTY).max()) * grid.unit


def find(late: Late, wanted: Fraction | None = None) -> Kept | None:
    """Small set that every run from rest stays in; None if none is found."""
    law = late.law
    if not law.k2 > law.L:
        return None
    P, work = 2 * (law.k2 + law.L) + late.drift(), 0.0
    best: Kept | None = None
    parts = max(1, math.ceil(16 * (law.k2 - law.L) / (law.k2 + law.L)))
    while work < MOST_WORK / 2:
        try:
            rows, ticks, spent = _grown(origin(Grid(late.under(P), parts, BITS)), 3000,
                                        MOST_WORK - work)  # fmt: skip
            work += spent
            if ticks is None:
                break
            need = step(rows) + late.drift()
        except OverflowError:
            break
        if need > P:
            P = _short(need * (Fraction(51, 50) if best else Fraction(11, 10)))
            continue
        y = rows.largest() + late.lag * P
        if best is None or y < best.y:
            best, last = Kept(late, P, parts, ticks, y), best
            if last is not None and y > last.y * Fraction(98, 100):
                break
        else:
            break
        if wanted is not None and best.y <= wanted:
            break
        parts, P = 2 * parts, _short(need * Fraction(101, 100))
    return best


def _short(x: Fraction) -> Fraction:
    return Fraction(math.ceil(x * 4096), 4096)


# ---- runs ---------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def search(
    late: Late, wanted: Fraction, ticks: int = MOST_TICKS
) -> tuple[list[Fraction], ...] | None:
    """Disturbance and noise, tick by tick, that lead from rest to |y| > ``wanted``; else None."""
    law, j = late.law, late.dead
    k1, k2, L, N = (float(x) for x in (law.k1, law.k2, law.L, law.N))
    E = math.exp(-1 / float(late.lag)) if late.lag else 0.0
    missed = float(late.lag) * (1 - E)
    ways = [(way, against) for against in ((0.0, 1.0, -1.0) if N else (0.0,)) for way in range(40)]
    way, against = (np.array(x) for x in zip(*ways, strict=True))
    half = np.array([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60])
    lead = np.linspace(0, 3 + 2 * j + 2 * float(late.lag), 20)
    y, v, phi, a = (np.zeros(len(way)) for _ in range(4))
    line = [np.zeros(len(way))] * j
    pushes, noises, sizes = [], [], []
    for i in range(ticks):
        w = v + phi
        square = np.where((i // half[way % 20]) % 2 == 0, 1.0, -1.0)
        slope = w - k1 * np.sign(y) * np.sqrt(abs(y))
        d = np.where(way < 20, square, np.where(slope + lead[way % 20] * slope / (1 + abs(w)) >= 0,
                                                1.0, -1.0))  # fmt: skip
        d = np.where(way % 20 == 19, np.where(y + slope >= 0, 1.0, -1.0), d)
        n = against * np.where(slope >= 0, 1.0, -1.0) * N
        seen = y + n
        sign = np.sign(seen)
        u = v - k1 * sign * np.sqrt(abs(seen))
        v = v - k2 * sign
        line = [*line, u]
        u, line = line[0], line[1:]
        y = y + u + missed * (a - u) + phi
        a = u + E * (a - u)
        phi = phi + L * d
        pushes.append(d)
        noises.append(np.sign(n))
        sizes.append(abs(y))
    best = np.array(sizes)
    tick, run = np.unravel_index(int(best.argmax()), best.shape)
    if not best[tick, run] > float(wanted) * (1 + 1e-9):
        return None
    over = np.flatnonzero(best[:, run] > float(wanted) * (1 + 1e-9))[0]
    return ([int(x[run]) * law.L for x in pushes[: over + 1]],
            [int(x[run]) * law.N for x in noises[: over + 1]])  # fmt: skip


def replay(
    late: Late, d: Sequence[Fraction], n: Sequence[Fraction], digits: int = 1500
) -> Fraction | None:
    """Bound from below of |y| after a run from rest; None if rounding leaves a sign open.

    Whole numbers of 2^-digits from both sides. sgn 0 = 0.
    """
    law, one = late.law, 1 << digits
    if any(abs(x) > law.L for x in d) or any(abs(x) > law.N for x in n):
        return None
    E = late.left(digits // 3)  # decimal ones: 2^10 is 10^3
    left = math.floor(E[0] * one), math.ceil(E[1] * one)
    missed = (math.floor(late.lag * (1 - E[1]) * one), math.ceil(late.lag * (1 - E[0]) * one))
    k1 = math.floor(law.k1 * one), math.ceil(law.k1 * one)

    def times(c: Pair, x: Pair) -> Pair:  # c is not negative
        low = x[0] * (c[0] if x[0] >= 0 else c[1])
        high = x[1] * (c[1] if x[1] >= 0 else c[0])
        return low >> digits, -(-high >> digits)

    def near(x: Fraction) -> Pair:
        return math.floor(x * one), math.ceil(x * one)

    def plus(x: Pair, z: Pair) -> Pair:
        return x[0] + z[0], x[1] + z[1]

    y: Pair = (0, 0)
    a: Pair = (0, 0)
    line: list[Pair] = [(0, 0)] * late.dead
    v, phi = Fraction(0), Fraction(0)
    for push, heard in zip(d, n, strict=True):
        low, high = plus(y, near(heard))
        if low <= 0 <= high and (low or high):
            return None
        sign = (low > 0) - (high < 0)
        low, high = (low, high) if sign >= 0 else (-high, -low)
        root = times(k1, (math.isqrt(low << digits), math.isqrt(high << digits) + 1))
        pull = (-root[1], -root[0]) if sign > 0 else root if sign < 0 else (0, 0)
        line.append(plus(near(v), pull))
        v -= law.k2 * sign
        u = line.pop(0)
        behind = a[0] - u[1], a[1] - u[0]
        y = plus(plus(y, plus(u, times(missed, behind))), near(phi))
        a = plus(u, times(left, behind))
        phi += push
    return Fraction(max(y[0], -y[1], 0), one)
