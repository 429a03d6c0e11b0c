"""Explicit super-twisting from one crossing of y = 0 to the next, under any disturbance.

If every crossing has |w| <= B, a half turn starts with 0 <= y <= B + k1^2/4 and w <= B + b. The
tick that crosses adds at most b = k2 + L to |w|, and k1 root(y) - y <= k1^2/4 to y. Until the next
crossing w falls by a = k2 - L to b in each tick. So a single sweep over rows of w, from the
top downwards, bounds all of y:

    Y(row) = max(B + k1^2/4, max over the rows from which a tick leads here of G(Y) + w)

G(y) = max(0, y - k1 root(y)) is the most that y - k1 root(y) can be up to y. The lowest row with
Y >= 0 bounds |w| at the next crossing: B again. A tick of ``twisting_rows`` goes over all rows once
for each tick of a half turn; this goes over them once in all. A state with y = 0 belongs to the
half turn that comes to its end there, whichever of -1, 0, 1 its sign is. |w| changes by less
than b, and y becomes |w|.

Near the boundary of stability a half turn takes little, and hundreds are needed. Their bounds
B1 > B2 > ... are guessed first, and then proved together: one sweep follows all of them, a column
each, and each has to come to the next one. A larger B is never better, so that is enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from slipctl.models.super_twisting.certificate.twisting_rows import (
    EMPTY,
    LONGEST,
    MOST_ROWS,
    Grid,
    Rows,
    windows,
)

SHORTER = 1 - 1e-14
"""Of a root in doubles, so that it is not above the true one."""

MOST_CELLS = 6_000_000
"""Most rows of all columns of a sweep."""

MOST_TURNS = 2000
"""Most bounds of a chain."""


@dataclass(frozen=True)
class Sweep:
    """Where runs can be with y >= 0, by the bound of |w| at the crossing before.

    Attributes:
        grid: rows. most: bounds in rows, falling. leads: bounds of |w| at the next crossing, in
            rows. highest: bounds of y in units. lowest: lowest row, of the last bound.
        ends: upper ends of y from there on, of the last bound.
    """

    grid: Grid
    most: Sequence[int]
    leads: np.ndarray
    highest: np.ndarray
    lowest: int
    ends: np.ndarray

    def falls(self) -> bool:
        """Whether each bound leads to the next one."""
        return bool((self.leads[:-1] <= np.array(self.most[1:])).all())

    def bounds(self) -> tuple[Fraction, Fraction]:
        """Bounds of |y| and |w| in the end: of the last bound."""
        w = min(self.most[-1], int(self.leads[-1])) + self.grid.reach
        return int(self.highest[-1]) * self.grid.unit, w * self.grid.height

    def rows(self) -> Rows:
        """Set of all states, both halves: where y >= 0 is out of reach, y <= 0."""
        n = max(-self.lowest, self.lowest + len(self.ends))
        ends = np.zeros(2 * n)
        first = n + self.lowest
        ends[first : first + len(self.ends)] = np.maximum(self.ends, 0.0)
        return Rows(self.grid, ends)


def sweep(grid: Grid, most: Sequence[int]) -> Sweep:
    """Follow a half turn from every crossing with |w| <= ``most`` rows, a column for each.

    Raises:
        OverflowError: that takes too many rows, or a bound does not stay.
    """
    parts, reach, one = grid.parts, grid.reach, 2.0**grid.bits
    count, size = len(most), np.array(most, dtype=float)
    entry, tops = size * one + grid.turn, size + reach
    top, low = most[0] + reach, -math.ceil(grid.turn / one) - 1  # rows of the entry, below ``top``
    bottom = top + 3 * reach  # rows below zero: it does not grow
    if top > MOST_ROWS or grid.noise or grid.matched or (top + bottom) * count > MOST_CELLS:
        raise OverflowError("the sweep has too many rows")
    ends = np.full(bottom + top, EMPTY)
    gone = np.full((reach, count), EMPTY)  # G(Y) + w of the rows above
    leads, highest = np.zeros(count), np.zeros(count)
    dead = np.zeros(count, dtype=int)
    into = np.arange(-parts, 0)[:, None]
    k = 0  # columns from the first that are gone through: the others enter later, or are at an end
    entered = 0
    for at in range(bottom + top, parts, -parts):
        begin = at - parts
        while entered < count and tops[entered] > begin - bottom:
            entered += 1
            k = entered
        above = gone[:, :k]
        best = windows(above, reach - parts + 1)
        row = at - bottom + into
        if at > bottom + low:
            inside = (row >= low) & (row < tops[:k])
            best = np.where(inside, np.maximum(best, entry[:k]), best)
        height = (row + 1) * one
        if best.min() > grid.square:  # y > k1^2: all of it falls, and stays above 0
            falls = best - np.floor(np.sqrt(grid.square * best) * SHORTER)
            leads[:k] = begin - bottom
            np.maximum(highest[:k], best.max(axis=0), out=highest[:k])
        else:
            live = best >= 0
            some = live.any(axis=0)
            dead[:k] = np.where(some, 0, dead[:k] + parts)
            first = begin - bottom + live.argmax(axis=0)
            leads[:k] = np.where(some, first, leads[:k])
            whole = np.where(live, best, 0.0)
            falls = np.maximum(whole - np.floor(np.sqrt(grid.square * whole) * SHORTER), 0.0)
            best, falls = np.where(live, best, EMPTY), np.where(live, falls, EMPTY)
            np.maximum(highest[:k], whole.max(axis=0), out=highest[:k])
        if k == count:
            ends[begin:at] = best[:, -1]
        gone[:, :k] = np.concatenate((falls + height, above), axis=0)[:reach]
        if entered == count:
            alive = np.flatnonzero(dead[:k] < reach)  # no tick leads farther than ``reach``
            if not len(alive):
                break
            k = int(alive[-1]) + 1
    else:
        raise OverflowError("a half turn grows")
    if highest.max() > LONGEST:
        raise OverflowError("y has too many units")
    lowest = int(np.flatnonzero(ends > EMPTY)[0])
    return Sweep(grid, most, -leads, highest, lowest - bottom, ends[lowest:])


def falling_bounds(grid: Grid, w: Fraction) -> Sweep:
    """Bounds of |w| from the crossing ``w`` down to where nothing is gained: a guess, then proved.

    Where a half turn leads to is nearly linear in where it comes from; between the bounds of a
    sweep it is taken as straight, with a little added.

    Raises:
        OverflowError: it takes too many rows or half turns, or a bound does not stay.
    """
    start = math.ceil(w / grid.height)
    sizes = start * 0.75 ** np.arange(40)
    tried = sweep(grid, [start, *(int(x) for x in sizes[(sizes > grid.reach) & (sizes < start)])])
    for slack in (0.02, 0.05, 0.1):
        chain = _chain(tried, slack)
        found = sweep(grid, chain)
        if found.falls():
            return found
        tried = found
    raise OverflowError("no bounds were found")


def _chain(tried: Sweep, slack: float) -> list[int]:
    """Bounds that fall as a sweep tells, a share of the fall held back."""
    at, to = np.array(tried.most[::-1], dtype=float), tried.leads[::-1]
    chain = [tried.most[0]]
    while len(chain) < MOST_TURNS:
        last = chain[-1]
        falls = last - float(np.interp(last, at, to))
        step = math.floor(falls * (1 - slack)) - 1
        if step < max(1, 5e-4 * last):
            break
        chain.append(last - step)
    return chain


def cost(grid: Grid, most: Sequence[int]) -> float:
    """Work of a sweep, about seconds."""
    blocks = 2 * most[0] / grid.parts + 4
    return blocks * (3e-5 + len(most) * (2e-8 * grid.parts + 1e-8 * grid.reach))
