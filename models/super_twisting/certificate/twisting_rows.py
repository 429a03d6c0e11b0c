"""Where explicit super-twisting can be, tick after tick, under any disturbance: rows of a set.

One tick of the law as it is computed, y = x1/T^2, w = x2/T (with the matched disturbance inside):

    y+ = y - k1 root(y + n) + w + m,   w+ = w - k2 sgn(y + n) + d,   |d| <= L, |n| <= N, |m| <= M.

T is gone. The set is cut into rows i h <= w <= (i + 1) h; each row holds one interval of y. h
divides k2 - L, so the slowest fall of w takes rows to rows and nothing is lost there, tick after
tick. y loses h in all, not h a tick. The set is its own mirror image (y, w) -> (-y, -w), so the
upper ends of all rows are the whole set. sgn 0 may be -1, 0 or 1.

y is counted in whole units h/2^bits. Sums are exact; a root in doubles is right to 3e-16 and is
moved outwards by 1e-14, then to a whole number. So what is left out here cannot be reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

Ends = np.ndarray
"""Upper end of y of each row in units, -inf where the row is empty."""

EMPTY = -np.inf
MOST_ROWS = 40_000
"""Most rows that are worked on."""

LONGEST = 2.0**50
"""Most units of y: sums of them are exact."""


@dataclass(frozen=True)
class Law:
    """Explicit super-twisting without its sample time.

    Attributes:
        k1, k2: gains. L: bound of the change of the disturbance per tick, over T.
        N: bound of the measuring error of y. M: bound of a matched error of y.
    """

    k1: Fraction
    k2: Fraction
    L: Fraction
    N: Fraction = Fraction(0)
    M: Fraction = Fraction(0)


@dataclass(frozen=True)
class Grid:
    """Rows and units.

    Attributes:
        law: what moves the state. parts: rows in k2 - L. bits: a row is 2^bits units of y high.
    """

    law: Law
    parts: int
    bits: int

    @cached_property
    def height(self) -> Fraction:
        """Height h of a row."""
        return (self.law.k2 - self.law.L) / self.parts

    @cached_property
    def unit(self) -> Fraction:
        """Unit of y."""
        return self.height / 2**self.bits

    @cached_property
    def reach(self) -> int:
        """Most rows that w moves in a tick."""
        return math.ceil((self.law.k2 + self.law.L) / self.height)

    @cached_property
    def still(self) -> int:
        """Most rows that w moves where the sign is 0."""
        return math.ceil(self.law.L / self.height)

    @cached_property
    def noise(self) -> float:
        """Measuring error in units, rounded up."""
        return float(math.ceil(self.law.N / self.unit))

    @cached_property
    def matched(self) -> float:
        """Matched error in units, rounded up."""
        return float(math.ceil(self.law.M / self.unit))

    @cached_property
    def turn(self) -> float:
        """Where y - k1 root(y) is least, y = k1^2/4, in units; rounded up."""
        return float(math.ceil(self.law.k1**2 / 4 / self.unit))

    @cached_property
    def square(self) -> float:
        """k1^2 in units of y."""
        return float(self.law.k1**2 / self.unit)

    def least_root(self, y: Ends) -> Ends:
        """Lower bound of k1 root(y), a whole number."""
        return np.floor(np.sqrt(self.square * y) * (1 - 1e-14))

    def most_root(self, y: Ends) -> Ends:
        """Upper bound of k1 root(y), a whole number."""
        return np.ceil(np.sqrt(self.square * y) * (1 + 1e-14))


@dataclass(frozen=True)
class Rows:
    """A set as rows.

    Attributes:
        grid: what the numbers mean.
        ends: upper ends; row i of ``2 n`` has w from (i - n) h to (i - n + 1) h.
    """

    grid: Grid
    ends: Ends

    def largest(self) -> Fraction:
        """Bound of |y|."""
        top = self.ends.max(initial=EMPTY)
        return Fraction(0) if top == EMPTY else max(int(top), 0) * self.grid.unit

    def widest(self) -> Fraction:
        """Bound of |w|."""
        live = np.flatnonzero(self.ends > EMPTY)
        n = len(self.ends) // 2
        return Fraction(0) if not len(live) else int(live[-1] + 1 - n) * self.grid.height

    def tick(self) -> Rows:
        """Give a set that holds every state one tick later.

        Raises:
            OverflowError: it has more than ``MOST_ROWS``, or y more than ``LONGEST`` units.
        """
        return Rows(self.grid, _tick(self.grid, self.ends))

    def finer(self, factor: int) -> Rows:
        """Give the same set in rows of a ``factor``-th of the height."""
        grid = Grid(self.grid.law, self.grid.parts * factor, self.grid.bits)
        return Rows(grid, np.repeat(self.ends, factor) * factor)


def origin(grid: Grid) -> Rows:
    """Rows that hold y = w = 0."""
    return Rows(grid, np.zeros(2))


def _tick(grid: Grid, up: Ends) -> Ends:
    """Upper ends one tick later: what the root leaves or throws, w's upper end, and moved rows."""
    n = len(up) // 2
    shift = np.arange(1 - n, n + 1) * 2.0**grid.bits + grid.matched
    falling, rising, zero = (_noisy if grid.noise else _plain)(grid, up)
    out = np.maximum(
        np.maximum(
            moved_rows(falling + shift, -grid.reach, -grid.parts, grid.reach),
            moved_rows(rising + shift, grid.parts, grid.reach, grid.reach),
        ),
        moved_rows(zero + shift, -grid.still, grid.still, grid.reach),
    )
    found = np.flatnonzero(out > EMPTY)
    if not len(found):
        return out[:0]
    n += grid.reach
    keep = max(n - int(found[0]), int(found[-1]) + 1 - n, 1)
    out = out[n - keep : n + keep]
    if 2 * keep > MOST_ROWS or out.max() > LONGEST:
        raise OverflowError("the set has too many rows")
    return out


def _plain(grid: Grid, up: Ends) -> tuple[Ends, Ends, Ends]:
    """Upper bounds of y - k1 root(y), y >= 0, of y + k1 root(-y), y <= 0, and of y = 0 by row.

    Proof note: a row has y between -up[mirror] and up. y - k1 root(y) is convex: largest at an end;
    mirrored it is least, k1^2/4 below 0, at y = k1^2/4.
    """
    size = np.abs(up)
    square = np.sqrt(grid.square * size)
    with np.errstate(invalid="ignore"):
        left = size - np.floor(square * (1 - 1e-14))
        thrown = np.ceil(square * (1 + 1e-14)) - size
    plus, empty = up >= 0, up == EMPTY
    mirrored = plus[::-1]
    far = np.where(mirrored, 0.0, left[::-1])
    falling = np.where(plus, np.maximum(left, np.where(empty[::-1], EMPTY, far)), EMPTY)
    near = np.where(plus, 0.0, thrown)
    inside = (size[::-1] >= grid.turn - 1) & (plus | (size <= grid.turn))
    most = np.where(inside, grid.turn, np.maximum(thrown[::-1], near))
    rising = np.where(mirrored & ~empty, most, EMPTY)
    return falling, rising, np.where(plus & mirrored, 0.0, EMPTY)


def _noisy(grid: Grid, up: Ends) -> tuple[Ends, Ends, Ends]:
    """As ``_plain``, where the law sees y + n, |n| <= noise.

    Proof note: where y + n >= 0 is possible, y - k1 root(max(y - N, 0)) is y below N and convex
    above: largest at an end of the interval or at N. Where y + n <= 0 is possible, mirrored:
    k1 root(y + N) - y is concave, largest at y + N = k1^2/4, where it is k1^2/4 + N. sgn 0 = 0
    needs |y| <= N.
    """
    noise, live, down = grid.noise, up > EMPTY, -up[::-1]

    plus = live & (up >= -noise)
    b = np.where(plus, up, 0.0)
    a = np.where(plus, np.maximum(down, -noise), 0.0)
    far = b - grid.least_root(np.maximum(b - noise, 0.0))
    inner = np.maximum(a, np.minimum(b, noise))
    near = inner - grid.least_root(np.maximum(inner - noise, 0.0))
    falling = np.where(plus, np.maximum(far, near), EMPTY)

    minus = live & (down <= noise)
    b = np.where(minus, -down, 0.0)
    a = np.where(minus, np.maximum(-up, -noise), 0.0)
    most = np.maximum(grid.most_root(a + noise) - a, grid.most_root(b + noise) - b)
    inside = (a + noise <= grid.turn) & (grid.turn - 1 <= b + noise)
    rise = np.where(inside, np.maximum(most, grid.turn + noise), most)
    zero = np.where(plus & minus, np.minimum(up, noise), EMPTY)
    return falling, np.where(minus, rise, EMPTY), zero


def moved_rows(values: Ends, first: int, last: int, room: int) -> Ends:
    """Largest value that rows moved by ``first`` to ``last`` bring; ``room`` more each side."""
    n, width = len(values), last - first + 1
    wide = np.full(n + 2 * room + width - 1, EMPTY)
    # out[t] = max of values[t - room - last .. t - room - first]
    begin = room + last
    wide[begin : begin + n] = values
    return windows(wide, width)


def windows(values: Ends, width: int) -> Ends:
    """Largest value of each so many neighbours."""
    done = 1
    while 2 * done <= width:
        values = np.maximum(values[:-done], values[done:])
        done *= 2
    if done < width:
        values = np.maximum(values[: done - width], values[width - done :])
    return values
