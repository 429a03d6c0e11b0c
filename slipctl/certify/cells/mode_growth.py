"""Growth of a set of cells from the start until no tick leaves it; of it nothing is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.cells.mode_cells import (
    MOST_CELLS,
    MOST_PLACES,
    Cells,
    Grid,
    ModeLoop,
    Reach,
    images_of,
    places_in_ranges,
)
from slipctl.certify.cells.mode_images import Images
from slipctl.certify.smooth.sums import NoProof

CHUNK = 8_000
"""Cells whose images are computed at once."""

LEAST = 500
"""Cells that take no longer than one does."""


@dataclass
class Work:
    """Operations that a search may still take."""

    left: int

    def take(self, many: int) -> None:
        """Count some down.

        Raises:
            NoProof: there are none left.
        """
        self.left -= many
        if self.left < 0:
            raise NoProof("the set still grows after as many operations as a search may take")


@dataclass
class Growth:
    """Growth of a set over a grid.

    Attributes:
        loop: the loop. grid: where it begins; it widens where images leave it.
        work: operations that it may take, counted down.
        first, last: outermost cells along each axis, beyond which it gives up.

    Every image of every cell is taken in once, so that ``reach`` bounds the set when it is closed.
    """

    loop: ModeLoop
    grid: Grid
    work: Work
    first: np.ndarray
    last: np.ndarray

    def __post_init__(self) -> None:
        self.tick = self.loop.tick()
        self.cells = Cells(self.grid)
        self.reach = Reach.of(self.loop)

    def run(self, visited: Sequence[tuple[np.ndarray, np.ndarray]]) -> Cells:
        """Set that no tick leaves.

        Args:
            visited: real states and modes that runs come to, arrays by row and state.

        Raises:
            NoProof: it takes too long, or has too many cells.
        """
        pending = self._start()
        for reals, modes in visited:
            pending += self._entered(reals, modes)
        while pending:
            if self.cells.many > MOST_CELLS:
                raise NoProof(f"the set has more than {MOST_CELLS} cells")
            batch, pending = _batch(pending)
            number = np.concatenate([np.full(len(p), n) for n, p in batch])
            places = np.concatenate([p for _, p in batch])
            found = self._images(number, places)
            rows = max(len(found.cell), LEAST)
            self.work.take(rows * len(self.loop.code.steps) * self.loop.stride)
            if self.loop.left(found):
                raise NoProof(f"{self.loop.left(found)} is farther off than it was taken to be")
            self.reach.add(self.loop, found)
            low, high, out = self.grid.touched(found.reals)
            if out.any():
                moved, pending = self._widened(low.min(axis=0), high.max(axis=0), pending)
                low, high = low + moved, high + moved
            to = self.cells.mode_numbers(found.modes, True)
            for n in np.unique(to):
                mine = to == n
                new = self.cells.add(
                    int(n), places_in_ranges(low[mine], high[mine], self.grid.count)
                )
                if new.size:
                    pending.append((int(n), new))
        return self.cells

    def _widened(
        self, low: np.ndarray, high: np.ndarray, pending: list[tuple[int, np.ndarray]]
    ) -> tuple[np.ndarray, list[tuple[int, np.ndarray]]]:
        """Widen the grid to some cells; gives by how many it begins earlier, and what is pending.

        Raises:
            NoProof: they lie beyond the outermost ones.
        """
        old = self.grid
        begin, count = np.array(old.origin), np.array(old.count)
        beyond = (low + begin < self.first) | (high + begin > self.last)
        if beyond.any():
            axis = int(np.argmax(beyond))
            size = float(old.size[axis])
            raise NoProof(f"over cells of {size:.3g}, {self.loop.reals[axis]} is not shown to stay"
                          f" between {self.first[axis] * size:.4g} and"
                          f" {self.last[axis] * size:.4g}")  # fmt: skip
        more = count // 4 + 1
        before = np.where(low < 0, np.minimum(-low + more, begin - self.first), 0)
        after = np.where(
            high >= count, np.minimum(high - count + 1 + more, self.last - begin - count + 1), 0
        )
        self.grid = replace(old, origin=tuple(map(int, begin - before)),
                            count=tuple(map(int, count + before + after)))  # fmt: skip
        if self.grid.places * len(self.cells.modes) > MOST_PLACES:
            raise NoProof("the grid is too large")
        inner = tuple(slice(int(b), int(b + c)) for b, c in zip(before, count, strict=True))
        for k, held in enumerate(self.cells.held):
            wide = np.zeros(self.grid.count, bool)
            wide[inner] = held.reshape(old.count)
            self.cells.held[k] = wide.reshape(-1)
        self.cells.grid = self.grid
        moved = []
        for n, places in pending:
            at = zip(np.unravel_index(places, old.count), before, strict=True)
            moved.append((n, np.ravel_multi_index([i + b for i, b in at], self.grid.count)))
        return before, moved

    def _images(self, number: np.ndarray, places: np.ndarray) -> Images:
        modes = np.array([self.cells.modes[n] for n in number], np.int64)
        modes = modes.reshape(len(number), len(self.loop.modes))
        return images_of(self.loop, self.tick, Boxes, self.grid, places, modes)

    def _start(self) -> list[tuple[int, np.ndarray]]:
        number = self.cells.number(self.loop.begins)
        boxes = [Boxes.around(a, b) for a, b in self.loop.start]
        low, high, out = self.grid.touched(boxes)
        if out.any():
            raise NoProof("the start lies outside of the grid")
        return [(number, self.cells.add(number, places_in_ranges(low, high, self.grid.count)))]

    def _entered(self, reals: np.ndarray, modes: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Cells that runs come to."""
        index = [np.floor(reals[:, k] / float(s)).astype(np.int64) - self.grid.origin[k]
                 for k, s in enumerate(self.grid.size)]  # fmt: skip
        inside = np.all([(i >= 0) & (i < c) for i, c in zip(index, self.grid.count, strict=True)],
                        axis=0)  # fmt: skip
        if not inside.any():
            return []
        places = np.ravel_multi_index([i[inside] for i in index], self.grid.count)
        numbers = self.cells.mode_numbers(modes[inside], True)
        return [(int(n), self.cells.add(int(n), places[numbers == n])) for n in np.unique(numbers)]


def _batch(
    pending: list[tuple[int, np.ndarray]],
) -> tuple[list[tuple[int, np.ndarray]], list[tuple[int, np.ndarray]]]:
    """Some of the cells that are to be done, and the others."""
    batch, many = [], 0
    left = list(pending)
    while left and many < CHUNK:
        number, places = left.pop()
        room = CHUNK - many
        if len(places) > room:
            left.append((number, places[room:]))
            places = places[:room]
        if len(places):
            batch.append((number, places))
        many += len(places)
    if not batch:
        return [(0, np.zeros(0, np.int64))], left
    return batch, left
