"""Explicit super-twisting as sampled: a bound of |x1| from every start, and runs that exceed one.

The bound: a polygon into which every run comes (``twisting_levels``), then half turns by which it
shrinks (``twisting_turns``). Where these are short, rows that hold what is left of it tick
after tick (``twisting_rows``). A certificate names the polygon, the bounds at the crossings, and
how many ticks in rows of which height; going through them is no search. Lengths: y = x1/T^2.

A run: cell by cell, or half turn after half turn (``twisting_swings``), what can be reached from
the origin. Its disturbance is read back, and replayed by whole numbers with interval bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np

from slipctl.models.super_twisting.certificate import super_twisting, twisting_swings
from slipctl.models.super_twisting.certificate.twisting_levels import Levels
from slipctl.models.super_twisting.certificate.twisting_polygons import find
from slipctl.models.super_twisting.certificate.twisting_rows import (
    EMPTY,
    Grid,
    Law,
    Rows,
    moved_rows,
)
from slipctl.models.super_twisting.certificate.twisting_turns import (
    Sweep,
    cost,
    falling_bounds,
    sweep,
)

BITS = 10
"""A row is 2^BITS units of y high."""

Plan = tuple[tuple[int, int], ...]
"""Rows in k2 - L, ticks in them; each entry twice or more as fine as the one before."""

Crossings = tuple[tuple[int, ...], ...]
"""Rows in k2 - L, then bounds of |w| at crossings in such rows, falling; each entry finer."""

MOST_WORK = 1.0
"""Limit of ``_work``, about seconds."""


SHORT = 25
"""Ticks at w = k2 - L each into which |w| at a crossing may be divided for ticks of rows to pay."""


@dataclass(frozen=True)
class Bound:
    """A bound of |y| in the end, from every start, under every disturbance.

    Attributes:
        levels: the polygon into which every run comes. turns: bounds at the crossings of y = 0,
            each of which leads to the next. plan: ticks after these.
        y, w: bounds of |y| and |w| after that.
    """

    levels: Levels
    turns: Crossings
    plan: Plan
    y: Fraction
    w: Fraction

    def holds(self) -> bool:
        """Whether it does, by going through it once more."""
        if not self.levels.holds():
            return False
        found = replay(self.levels, self.turns, self.plan)
        return found is not None and found[0] <= self.y and found[1] <= self.w


def _work(rows: Rows) -> float:
    """Cost of a tick, about seconds."""
    return 9e-5 + 4e-8 * len(rows.ends)


def replay(levels: Levels, turns: Crossings, plan: Plan) -> tuple[Fraction, Fraction] | None:
    """Bounds of |y| and |w| after the half turns and ticks of a plan; None if they take too much.

    Proof note: every start leads to V <= ``level``, and then V <= ``kept``, which is above |w|.
    Each crossing after that is within what the one before leads to, so within the next bound. What
    is in rows that hold that set is, n ticks later, in the rows after n ticks.
    """
    work, w = 0.0, levels.kept
    rows: Rows | None = None
    last: Sweep | None = None
    try:
        for parts, *most in turns:
            grid = Grid(levels.law, parts, BITS)
            work += cost(grid, most)
            if work > 2 * MOST_WORK or most[0] * grid.height < w:
                return None
            last = sweep(grid, most)
            if not last.falls():
                return None
            w = most[-1] * grid.height
        for parts, ticks in plan:
            if rows is None:
                grid = Grid(levels.law, parts, BITS)
                rows = _at_crossing(grid, w).rows() if turns else levels.rows(grid)
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
    if rows is not None:
        return rows.largest(), rows.widest()
    return None if last is None else last.bounds()


def _at_crossing(grid: Grid, w: Fraction) -> Sweep:
    """Half turn from crossings with |w| <= w."""
    return sweep(grid, [math.ceil(w / grid.height)])


def _parts(law: Law, least: int) -> int:
    """Rows in k2 - L, so that what moves w fastest is almost whole rows too.

    Rounded up it moves w farther, as a larger k2 + L would. ln q grows by half of what is lost, and
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
    best: Bound | None = None
    turns: Crossings = ()
    work = 0.0
    if _lost(law) < NEAR:
        best, work = _by_half_turns(levels, parts, wanted, most_work)
        if best is None or (wanted is not None and best.y <= wanted):
            return best
        turns = best.turns
        finest, *_, crossing = turns[-1]
        if crossing > SHORT * finest:
            return best
    plan: list[tuple[int, int]] = []
    last: Fraction | None = None
    try:
        grid = Grid(law, parts, BITS)
        rows = levels.rows(grid)
        if turns:
            rows = _at_crossing(grid, crossing * Grid(law, finest, BITS).height).rows()
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
            y, last, before_y = rows.largest(), rows.largest(), last
            if best is None or y < best.y:
                best = Bound(levels, turns, tuple(plan), y, rows.widest())
            near = before_y is not None and y > before_y * Fraction(999, 1000)
            if before_y is not None and wanted is not None and y - 2 * (before_y - y) > wanted:
                near = True  # what finer rows gain halves from one to the next: it is in vain
            if near or (wanted is not None and y <= wanted):
                break
            rows = rows.finer(2)
    except OverflowError:
        pass
    return best


def _by_half_turns(
    levels: Levels, parts: int, wanted: Fraction | None, most_work: float
) -> tuple[Bound | None, float]:
    """Bound after half turns in finer and finer rows, and the work that it took.

    What finer rows gain falls from one to the next: with much more to gain than ``REFINED`` a
    wanted bound is in vain.
    """
    turns: list[tuple[int, ...]] = []
    best, work, w = None, 0.0, levels.kept
    try:
        while work < most_work:
            found = falling_bounds(Grid(levels.law, parts, BITS), w)
            work += 3 * cost(found.grid, found.most)
            turns.append((parts, *found.most))
            w, before = found.most[-1] * found.grid.height, best
            y, far = found.bounds()
            if best is None or y < best.y:
                best = Bound(levels, tuple(turns), (), y, far)
            if wanted is not None and not wanted < y <= wanted * REFINED[min(len(turns), 3) - 1]:
                break
            if before is not None and y > before.y * Fraction(99, 100):
                break
            parts *= 2
    except OverflowError:
        pass
    return best, work


REFINED = (2, Fraction(5, 4), Fraction(11, 10))
"""Over a wanted bound, where finer rows may still come to it: of the first, second, third rows."""


def _lost(law: Law) -> float:
    """Share of x2 that the worst half turn in continuous time takes."""
    return 1 - super_twisting.worst_ratio(float(law.k1), float(law.k2), float(law.L))


# ---- runs ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """A run from x1 = x2 = 0 that goes beyond a bound.

    Attributes:
        d: change of the disturbance per tick, over T. y: |y| after the last tick, at least.
    """

    d: tuple[Fraction, ...]
    y: Fraction


NEAR = 0.3
"""Share that a half turn loses below which runs take many turns to swing far."""


@lru_cache(maxsize=8)
def worst_run(law: Law, wanted: Fraction) -> Run | None:
    """Look for a run from the origin with |y| > ``wanted``; None if none is found."""
    found = quick_run(law, wanted)
    if found is None and law.k2 > law.L and law.k1 > 0 and _lost(law) < NEAR:
        return _run(law, wanted, twisting_swings.search(law, wanted, 0.6 * MOST_WORK))
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
            best = moved_rows(score.max(axis=0), a, b, last)[last:-last]
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
