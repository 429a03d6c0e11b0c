"""Explicit super-twisting from one crossing of y = 0 to the next, under any disturbance.

If every crossing has |w| <= B, a half turn starts with 0 <= y <= B + k1^2/4 and w <= B + b: the
tick that crosses adds at most b = k2 + L to |w|, and k1 root(y) - y <= k1^2/4 to y. Until the next
crossing w falls by a = k2 - L to b in each tick, so that a single sweep over rows of w, from the
top downwards, bounds all of y:

    Y(row) = max(B + k1^2/4, max over the rows from which a tick leads here of G(Y) + w)

G(y) = max(0, y - k1 root(y)) is the most that y - k1 root(y) can be up to y. The lowest row with
Y >= 0 bounds |w| at the next crossing: B again. A tick of ``twisting_rows`` goes over all rows once
for each tick of a half turn; this goes over them once in all. A state with y = 0 belongs to the
half turn that comes to its end there, whichever of -1, 0, 1 its sign is: |w| changes by less
than b, and y becomes |w|.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from slipctl.certify.twisting_rows import EMPTY, LONGEST, MOST_ROWS, Grid, Rows, windows

Sweep = tuple[int, np.ndarray]
"""Lowest row, and the upper ends of y from there on."""


SHORTER = 1 - 1e-14
"""Of a root in doubles, so that it is not above the true one."""


def half_turn(grid: Grid, most: int) -> Sweep:
    """Where a run can be with y >= 0 if it crosses with |w| <= ``most`` rows.

    Raises:
        OverflowError: that takes too many rows.
    """
    parts, reach, one = grid.parts, grid.reach, 2.0**grid.bits
    entry = most * one + grid.turn
    top, low = most + reach, -math.ceil(grid.turn / one) - 1  # rows of the entry, below ``top``
    if top > MOST_ROWS or grid.noise or grid.matched:
        raise OverflowError("the sweep has too many rows")
    bottom = top + 3 * reach  # rows below zero: it does not grow
    ends = np.full(bottom + top, EMPTY)
    gone = np.full(bottom + top + reach, EMPTY)  # G(Y) + w by row, with ``reach`` more on top
    height, dead = np.arange(1 - bottom, top + 1) * one, 0
    for at in range(bottom + top, reach, -parts):
        begin = max(at - parts, 0)
        best = windows(gone[begin + parts : at + reach], reach - parts + 1)
        if at > bottom + low:
            best = np.maximum(best, entry)
        if best.min() > grid.square:  # y > k1^2: all of it falls, and stays above 0
            falls = best - np.floor(np.sqrt(grid.square * best) * SHORTER)
        else:
            live = best >= 0
            dead = 0 if live.any() else dead + parts
            if dead >= reach:  # no tick leads farther
                break
            size = np.where(live, best, 0.0)
            falls = np.maximum(size - np.floor(np.sqrt(grid.square * size) * SHORTER), 0.0)
            best, falls[~live] = np.where(live, best, EMPTY), EMPTY
        ends[begin:at] = best
        gone[begin:at] = falls + height[begin:at]
    else:
        raise OverflowError("a half turn grows")
    if ends.max() > LONGEST:
        raise OverflowError("y has too many units")
    lowest = int(np.flatnonzero(ends > EMPTY)[0])
    return lowest - bottom, ends[lowest:]


def swept(grid: Grid, w: Fraction, turns: int) -> tuple[Fraction, Sweep]:
    """Bound of |w| at each crossing after so many half turns, and where a run is after one more.

    Args:
        grid: rows. w: bound of |w| at each crossing before. turns: half turns.

    Raises:
        OverflowError: that takes too many rows, or it grows.
    """
    most = math.ceil(w / grid.height)
    for _ in range(turns):
        most = min(most, -half_turn(grid, most)[0])
    return most * grid.height, half_turn(grid, most)


def bounds(grid: Grid, w: Fraction, sweep: Sweep) -> tuple[Fraction, Fraction]:
    """Bounds of |y| and |w| where a run crosses with |w| <= w, a multiple of the height."""
    return int(sweep[1].max()) * grid.unit, w + grid.reach * grid.height


def rows_of(grid: Grid, sweep: Sweep) -> Rows:
    """Set of all states, both halves: where y >= 0 is out of reach, y <= 0."""
    lowest, up = sweep
    n = max(-lowest, lowest + len(up))
    ends = np.zeros(2 * n)
    ends[n + lowest : n + lowest + len(up)] = np.maximum(up, 0.0)
    return Rows(grid, ends)


def cost(grid: Grid, w: Fraction) -> float:
    """Work of a half turn, about seconds."""
    blocks = 2 * w / (grid.law.k2 - grid.law.L) + 4
    return float(blocks) * (1.3e-5 + 5e-8 * grid.reach)
