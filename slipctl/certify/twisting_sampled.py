"""Explicit super-twisting as sampled: a bound of |x1| from every start, and runs that exceed one.

The bound: a polygon into which every run comes (``twisting_levels``), then rows that hold what is
left of it tick after tick (``twisting_rows``). A certificate names the polygon and how many ticks
in rows of which height; going through them again is no search. Lengths: y = x1/T^2.

A run: point by point along w = j h the largest y that can be reached from the origin; its
disturbance is read back, and replayed by whole numbers with interval bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np

from slipctl.certify import super_twisting
from slipctl.certify.twisting_levels import Levels
from slipctl.certify.twisting_polygons import find
from slipctl.certify.twisting_rows import EMPTY, Grid, Law, Rows, moved

BITS = 10
"""A row is 2^BITS units of y high."""

Plan = tuple[tuple[int, int], ...]
"""Rows in k2 - L, ticks in them; each entry twice or more as fine as the one before."""

MOST_WORK = 1.0
"""Limit of ``_work``, about seconds."""


@dataclass(frozen=True)
class Bound:
    """A bound of |y| in the end, from every start, under every disturbance.

    Attributes:
        levels: the polygon into which every run comes. plan: what is done then.
        y, w: bounds of |y| and |w| after that.
    """

    levels: Levels
    plan: Plan
    y: Fraction
    w: Fraction

    def holds(self) -> bool:
        """Whether it does, by going through it once more."""
        if not self.levels.holds():
            return False
        rows = replay(self.levels, self.plan)
        return rows is not None and rows.largest() <= self.y and rows.widest() <= self.w


def _work(rows: Rows) -> float:
    """Cost of a tick, about seconds."""
    return 9e-5 + 4e-8 * len(rows.ends)


def replay(levels: Levels, plan: Plan) -> Rows | None:
    """Rows after the ticks of a plan; None if they take too much.

    Proof note: every start leads to V <= ``level``, and then V <= ``kept``. What is in rows that
    hold that set is, n ticks later, in the rows after n ticks.
    """
    rows, work = None, 0.0
    try:
        for parts, ticks in plan:
            if rows is None:
                rows = levels.rows(Grid(levels.law, parts, BITS))
            elif parts % rows.grid.parts:
                return None
            else:
                rows = rows.finer(parts // rows.grid.parts)
            for _ in range(ticks):
                rows = rows.tick()
                work += _work(rows)
                if work > 2 * MOST_WORK:
                    return None
    except OverflowError:
        return None
    return rows


def _parts(law: Law, least: int) -> int:
    """Rows in k2 - L, so that what moves w fastest is almost whole rows too.

    Rounded up it moves w farther, as a larger k2 + L would: ln q grows by half of what is lost, and
    where little of it is left nothing would settle.
    """
    ratio = (law.k2 + law.L) / (law.k2 - law.L)
    spare = -super_twisting.log_ratio(float(law.k1), float(law.k2), float(law.L))
    allowed = min(max(spare / 10, 1e-3), 0.02)

    def lost(parts: int) -> Fraction:
        return math.ceil(ratio * parts) / (ratio * parts) - 1

    first = max(1, least)
    tried = range(first, first + 40)
    return next((p for p in tried if lost(p) <= allowed), min(tried, key=lost))


def bound(
    law: Law, wanted: Fraction | None = None, most_work: float = MOST_WORK
) -> Bound | None:  # fmt: skip
    """Bound of |y|, as near as it gets, or as soon as it is at most ``wanted``.

    Returns:
        None where no polygon is found (near the boundary of stability), or nothing is gained.
    """
    levels = find(law)
    if levels is None:
        return None
    parts = _parts(law, math.ceil(100 * (law.k2 - law.L) / levels.kept))
    plan: list[tuple[int, int]] = []
    best, work = None, 0.0
    try:
        rows = levels.rows(Grid(law, parts, BITS))
        while work < most_work:
            ticks, before, settled = 0, math.inf, False
            pause = max(32, int(rows.widest() / (law.k2 - law.L)))  # a quarter turn or more
            while not settled and work < most_work:
                new = rows.tick()
                work, ticks = work + _work(new), ticks + 1
                settled = np.array_equal(new.ends, rows.ends)
                rows = new
                if wanted is not None and ticks % 8 == 0 and rows.largest() <= wanted:
                    break
                if ticks % pause == 0:
                    size = float(rows.ends[rows.ends > EMPTY].sum() * len(rows.ends))
                    settled, before = settled or size > 0.998 * before, size
            plan.append((rows.grid.parts, ticks))
            y = rows.largest()
            if best is not None and not y < best.y:
                break
            near = best is not None and y > best.y * Fraction(999, 1000)
            if best is not None and wanted is not None and y - 2 * (best.y - y) > wanted:
                near = True  # what finer rows gain halves from one to the next: it is in vain
            best = Bound(levels, tuple(plan), y, rows.widest())
            if near or (wanted is not None and y <= wanted):
                break
            rows = rows.finer(2)
    except OverflowError:
        pass
    return best


# ---- runs ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """A run from x1 = x2 = 0 that goes beyond a bound.

    Attributes:
        d: change of the disturbance per tick, over T. y: |y| after the last tick, at least.
    """

    d: tuple[Fraction, ...]
    y: Fraction


@lru_cache(maxsize=8)
def worst_run(law: Law, wanted: Fraction) -> Run | None:
    """Look for a run from the origin with |y| > ``wanted``; None if none is found."""
    found = quick_run(law, wanted)
    return found or _run(law, wanted, _by_ends(law, wanted))


@lru_cache(maxsize=8)
def quick_run(law: Law, wanted: Fraction) -> Run | None:
    """Run that the shorter searches find."""
    found = _run(law, wanted, _by_cells(law, wanted, 60))
    return found or _run(law, wanted, _by_cells(law, wanted, 150))


def _run(law: Law, wanted: Fraction, d: Sequence[Fraction] | None) -> Run | None:
    reached = replay_run(law, d) if d else None
    return Run(tuple(d), reached) if d and reached is not None and reached > wanted else None


def _by_cells(law: Law, wanted: Fraction, n: int) -> list[Fraction] | None:
    """Search in width: one point in each of n x n cells that has been reached is followed."""
    if law.k2 <= law.L or law.N or law.M:
        return None
    L, k2, k1 = float(law.L), float(law.k2), float(law.k1)
    moves = np.linspace(-1, 1, 9)
    top = 1.05 * float(wanted)
    wide = 1.5 * max(k2 + L, k1 * math.sqrt(top), 2 * math.sqrt((k2 - L) * top))
    seen = np.zeros((n + 1) * (2 * n + 1), bool)
    y, w, parent, move = (np.zeros(1) for _ in range(4))
    levels = [(parent.astype(int), move.astype(int))]
    while len(levels) < 1000 and len(y):
        sign = np.sign(y)
        next_y = np.repeat(y - k1 * np.sqrt(abs(y)) * sign + w, len(moves))
        next_w = ((w - k2 * sign)[:, None] + L * moves).ravel()
        best = int(abs(next_y).argmax())
        if abs(next_y[best]) > float(wanted) * (1 + 1e-9):
            return _path(law, levels, best, moves)
        side = np.where(next_w < 0, -1.0, 1.0)  # a state and its mirror image share a cell
        row = np.floor(abs(next_w) / wide * n).astype(int)
        column = np.floor((1 + next_y * side / top) * n).astype(int)
        cell = np.minimum(row, n) * (2 * n + 1) + np.clip(column, 0, 2 * n)
        _, new = np.unique(np.where(seen[cell], -1, cell), return_index=True)
        new = new[~seen[cell[new]]]
        seen[cell[new]] = True
        levels.append((new // len(moves), new % len(moves)))
        y, w = next_y[new], next_w[new]
    return None


def _path(
    law: Law, levels: Sequence[tuple[np.ndarray, np.ndarray]], best: int, moves: np.ndarray
) -> list[Fraction]:
    """Disturbance that leads to a candidate of the last level."""
    steps = len(moves) - 1
    place, move = divmod(best, len(moves))
    d = [law.L * Fraction(2 * move - steps, steps)]
    for parents, taken in reversed(levels[1:]):
        d.append(law.L * Fraction(2 * int(taken[place]) - steps, steps))
        place = int(parents[place])
    return d[::-1]


def _by_ends(law: Law, wanted: Fraction, ticks: int = 1500) -> list[Fraction] | None:
    """Search in time: at each w = j h the largest y that can be reached, and its mirror image.

    The same y is kept until a larger one comes, so that the run may be long: near the boundary of
    stability the worst swing builds up over many turns.
    """
    slow, L = law.k2 - law.L, law.L
    if slow <= 0 or law.N or law.M:
        return None
    parts = max(1, math.ceil(8 * slow / L)) if slow > L / 12 else 1
    height = max(slow / parts, L / 40)
    h, k1 = float(height), float(law.k1)
    first, last = math.ceil(slow / height), math.floor((law.k2 + L) / height)
    still = math.floor(L / height)
    n = min(2000, math.ceil((25 * (law.k2 + L) + law.k1**2 / 2) / height))
    top = np.full(2 * n + 1, EMPTY)
    top[n] = 0.0
    w = np.arange(-n, n + 1) * h
    history = [top]
    reach, spent = ((-still, still), (-last, -first), (first, last)), 0.0
    while len(history) <= ticks and spent < MOST_WORK / 2:
        spent += 2e-4 + 1e-7 * len(w)
        new = top.copy()
        for score, (a, b) in zip(_scores(k1, top, w), reach, strict=True):
            best = moved(score.max(axis=0), a, b, last)[last:-last]
            better = best > new + 1e-9 * abs(np.where(best > EMPTY, best, 0.0))
            new[better] = best[better]
        if np.array_equal(new, top):
            return None
        history.append(new)
        top = new
        if top.max() > float(wanted) * (1 + 1e-9):
            return _read_back(law, history, w, reach, height)
    return None


def _scores(k1: float, top: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    """What becomes of the largest y and of its mirror image at each w, by the sign of y."""
    sources = np.stack([top, -top[::-1]])
    live = np.isfinite(sources)
    y = np.where(live, sources, 0.0)
    root = k1 * np.sqrt(abs(y))
    kinds = ((y == 0, y + w), (y > 0, y - root + w), (y < 0, y + root + w))
    return tuple(np.where(live & usable, value, EMPTY) for usable, value in kinds)


def _read_back(
    law: Law,
    history: Sequence[np.ndarray],
    w: np.ndarray,
    reach: Sequence[tuple[int, int]],
    height: Fraction,
) -> list[Fraction]:
    """Disturbance of the run that ends in the largest y of all places."""
    d: list[Fraction] = []
    place, mirrored, n = int(history[-1].argmax()), False, len(w) // 2
    for before, after in zip(history[-2::-1], history[:0:-1], strict=True):
        at = 2 * n - place if mirrored else place
        if after[at] == before[at]:
            continue
        best, source, which, sign = EMPTY, at, 0, 0
        for score, (a, b), side in zip(
            _scores(float(law.k1), before, w), reach, (0, 1, -1), strict=True
        ):
            begin = max(0, at - b)
            window = score[:, begin : max(begin, at - a + 1)]
            if window.size and window.max() > best:
                row, column = divmod(int(window.argmax()), window.shape[1])
                best, source, which, sign = window[row, column], begin + column, row, side
        if mirrored:
            source, sign = 2 * n - source, -sign
        d.append((place - source) * height + sign * law.k2)
        place, mirrored = source, mirrored != (which == 1)
    return d[::-1]


def replay_run(law: Law, d: Sequence[Fraction], digits: int = 400) -> Fraction | None:
    """Bound from below of |y| after a run from y = w = 0; None if rounding leaves a sign open.

    Whole numbers of 2^-digits, roots between two of them. sgn 0 = 0.
    """
    one = 1 << digits
    k2 = law.k2
    low = high = 0
    w = Fraction(0)
    k1_low = math.floor(law.k1 * one)
    for step in d:
        if abs(step) > law.L:
            return None
        if low <= 0 <= high and (low or high):
            return None
        sign = (low > 0) - (high < 0)
        a, b = (low, high) if sign >= 0 else (-high, -low)  # mirrored
        root_a, root_b = math.isqrt(a << digits), math.isqrt(b << digits) + 1
        push_low = (k1_low * root_a) >> digits
        push_high = ((k1_low + 1) * root_b >> digits) + 1
        drift = w * sign if sign else w
        if sign:
            a, b = a - push_high, b - push_low
        a, b = a + math.floor(drift * one), b + math.ceil(drift * one)
        low, high = (a, b) if sign >= 0 else (-b, -a)
        w += step - k2 * sign
    return Fraction(max(low, -high, 0), one)
