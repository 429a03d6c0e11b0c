"""Method "cells with modes": cells of a grid, one grid a mode, that no tick leaves.

The set begins with the cells that hold the start, and grows by the images of its cells until it
has them all. What simulated runs visit is put in first: it has to be in any such set, and
saves rounds. Of the search nothing has to be believed. ``check`` takes the set of a file, and finds
every image of every cell in it. A small set is checked in whole numbers, a large one in floats that
are rounded outwards.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes
from slipctl.certify.cells.mode_images import Images, ModeTick, TooManyWays
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks.tick_code import TickCode

MOST_CELLS = 3_000_000
"""Most cells of a set."""

MOST_PLACES = 60_000_000
"""Most places of all grids together."""

MOST_MODES = 4096
"""Most combinations of modes."""

COARSE_WORK = 4_000_000
"""Operations of all cells, up to which a set is checked in whole numbers."""

CHUNK = 8_000
"""Cells whose images are computed at once."""

Range = tuple[Fraction, Fraction]

Ends = tuple[Fraction | None, Fraction | None]
"""Least and largest value that a state may have; None where nothing bounds it."""


@dataclass(frozen=True)
class ModeLoop:
    """A loop whose states are real numbers and modes, and what it has to withstand.

    Attributes:
        code: its tick; inputs ``x_STATE`` and ``d_PUSH``, outputs by state.
        reals: real states. modes: states that are whole numbers.
        start: range of each real state at the start. begins: value of each mode there.
        push: range of each push in each tick, by its name.
        watched: real states whose largest and least value count.
        stride: ticks from one image to the next.
        kept: further outputs of the tick with the range in which each has to be at every tick; what
            the pushes stand for may rest on it. None where its ends are only wanted.
        sizes: of the cells, where the loop says so itself.
    """

    code: TickCode
    reals: tuple[str, ...]
    modes: tuple[str, ...]
    start: tuple[Range, ...]
    begins: tuple[int, ...]
    push: Mapping[str, Range]
    watched: tuple[str, ...]
    stride: int = 1
    kept: Mapping[str, Range | None] = field(default_factory=dict)
    sizes: tuple[Fraction, ...] = ()

    def tick(self) -> ModeTick:
        """Its tick on arrays of cells."""
        return ModeTick(self.code, self.reals, self.modes, tuple(self.kept))

    def left(self, found: Images) -> str:
        """What further output leaves its range in images; empty if none does."""
        for name, boxes in found.kept.items():
            ends = self.kept[name]
            if ends is None:
                continue
            low, high = ends
            for box in boxes:
                if not box.less_equal(high).low.all() or (box.less(low).high != 0).any():
                    return name
        return ""


@dataclass(frozen=True)
class Grid:
    """Cells along each real state.

    Attributes:
        origin: where each axis begins, in cells. size: of a cell. count: cells along each axis.
        box: ends of each axis, beyond which no cell counts: no image may lie there.
    """

    origin: tuple[int, ...]
    size: tuple[Fraction, ...]
    count: tuple[int, ...]
    box: tuple[Ends, ...] = ()

    @property
    def places(self) -> int:
        """Cells of a grid."""
        return math.prod(self.count)

    def ends(self, places: np.ndarray, exact: bool) -> list[tuple[np.ndarray, np.ndarray]]:
        """Ends of cells by their place, as far as they are within the box.

        Args:
            places: the cells. exact: whether ends of the box are taken as rationals, not as the
                floats around them.
        """
        found = []
        for k, index in enumerate(np.unravel_index(places, self.count)):
            at, size = (index + self.origin[k]).astype(float), float(self.size[k])
            low, high = at * size, (at + 1) * size
            least, most = self.box[k] if self.box else (None, None)
            kind: Any = object if exact and (least, most) != (None, None) else float
            if least is not None:
                end: Any = least if exact else float(Boxes.around(least, least).low[0])
                low = np.maximum(low.astype(kind), end)
            if most is not None:
                end = most if exact else float(Boxes.around(most, most).high[0])
                high = np.minimum(high.astype(kind), end)
            found.append((np.minimum(low, high), high))
        return found

    def touched(self, boxes: Sequence[Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First and last cell along each axis of boxes, by row, and which rows leave the grid."""
        low = np.empty((boxes[0].low.size, len(self.count)), np.int64)
        high = np.empty_like(low)
        for k, box in enumerate(boxes):
            first, last = box.cells(self.size[k])
            low[:, k], high[:, k] = first - self.origin[k], last - self.origin[k]
        out = (low < 0) | (high >= np.array(self.count))
        return low, high, out

    def payload(self) -> dict[str, Any]:
        """Entries of a file."""
        return {"origin": list(self.origin), "size": [str(s) for s in self.size],
                "count": list(self.count)}  # fmt: skip


def dyadic(size: float) -> Fraction:
    """Number near another one, a whole number below 64 times a power of two."""
    mantissa, power = math.frexp(size)
    return Fraction(round(mantissa * 64)) * Fraction(2) ** (power - 6)


def read_grid(given: Any, axes: int) -> Grid:
    """Grid of a file.

    Raises:
        BadInput, DoesNotHold: it is none.
    """
    entry = read_mapping(given, ("origin", "size", "count"), "evidence.grid", True)
    where = "evidence.grid"
    far = 2**24
    origin = [whole(i, where, -far, far) for i in rows(entry["origin"], where, axes, axes)]
    count = [whole(i, where, 1, far) for i in rows(entry["count"], where, axes, axes)]
    size = [rational(s, where) for s in rows(entry["size"], where, axes, axes)]
    for s in size:
        if s <= 0 or s != dyadic(float(s)) or not 2**-60 < s < 2**60:
            raise DoesNotHold("evidence.grid: a cell has no size that a float holds")
    if math.prod(count) > MOST_PLACES:
        raise DoesNotHold(f"evidence.grid has more than {MOST_PLACES} places")
    return Grid(tuple(origin), tuple(size), tuple(count))


class Cells:
    """A set of cells: one grid for each combination of modes that it has."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.numbers: dict[tuple[int, ...], int] = {}
        self.modes: list[tuple[int, ...]] = []
        self.held: list[np.ndarray] = []
        self.many = 0

    def number(self, modes: tuple[int, ...]) -> int:
        """Number of a combination of modes, which is entered.

        Raises:
            NoProof: there are too many.
        """
        if modes not in self.numbers:
            if len(self.modes) >= MOST_MODES:
                raise NoProof(f"the modes have more than {MOST_MODES} combinations; a timer of many"
                              " ticks has as many modes")  # fmt: skip
            if (len(self.modes) + 1) * self.grid.places > MOST_PLACES:
                raise NoProof(f"the grids of {len(self.modes)} combinations of modes are too large")
            self.numbers[modes] = len(self.modes)
            self.modes.append(modes)
            self.held.append(np.zeros(self.grid.places, bool))
        return self.numbers[modes]

    def mode_numbers(self, modes: np.ndarray, enter: bool) -> np.ndarray:
        """Number of the combination of modes of each row; -1 where it is none of them."""
        if not modes.shape[1]:
            if enter:
                self.number(())
            return np.zeros(len(modes), np.int64) if self.modes else np.full(len(modes), -1)
        if not len(modes):
            return np.zeros(0, np.int64)
        first, back = modes.min(axis=0), np.zeros(len(modes), np.int64)
        for column in (modes - first).T:  # numbered anew, so that no product is too large
            _, back = _distinct(back * (int(column.max()) + 1) + column)
        row = np.zeros(int(back.max()) + 1, np.int64)
        row[back] = np.arange(len(back))
        known = [tuple(map(int, m)) for m in modes[row]]
        numbers = [self.number(m) if enter else self.numbers.get(m, -1) for m in known]
        return np.array(numbers, np.int64)[back]

    def add(self, number: int, places: np.ndarray) -> np.ndarray:
        """Enter places of a mode; gives those that are new."""
        held = self.held[number]
        new = places[~held[places]]
        if not new.size:
            return new
        held[new] = True
        new = np.unique(new)
        self.many += new.size
        return new

    def packed(self) -> list[dict[str, Any]]:
        """Entries of a file."""
        found = []
        for modes, held in zip(self.modes, self.held, strict=True):
            data = zlib.compress(np.packbits(held).tobytes(), 9)
            found.append({"modes": list(modes), "cells": base64.b64encode(data).decode("ascii")})
        return found


def read_cells(given: Any, grid: Grid, modes: int) -> Cells:
    """Set of cells of a file.

    Raises:
        BadInput, DoesNotHold: it is none.
    """
    cells = Cells(grid)
    most = min(MOST_MODES, MOST_PLACES // grid.places)
    wide = (grid.places + 7) // 8
    for entry in rows(given, "evidence.cells", most):
        one = read_mapping(entry, ("modes", "cells"), "evidence.cells", True)
        values = tuple(whole(m, "evidence.cells", -(10**6), 10**6)
                       for m in rows(one["modes"], "evidence.cells", modes, modes))  # fmt: skip
        if values in cells.numbers:
            raise DoesNotHold("evidence.cells: a mode stands there twice")
        try:
            data = base64.b64decode(one["cells"], validate=True)
            unpacked = zlib.decompressobj().decompress(data, wide + 1)
        except (ValueError, TypeError, zlib.error):
            raise DoesNotHold("evidence.cells: they cannot be read") from None
        if len(unpacked) != wide:
            raise DoesNotHold("evidence.cells: they do not belong to the grid")
        held = np.unpackbits(np.frombuffer(unpacked, np.uint8))[: grid.places].astype(bool)
        number = cells.number(values)
        cells.held[number] = held
        cells.many += int(held.sum())
    if cells.many > MOST_CELLS:
        raise DoesNotHold(f"evidence.cells: slipctl checks at most {MOST_CELLS}")
    return cells


@dataclass
class Reach:
    """Ends of each real state and further output over all that was reached, as rationals."""

    low: dict[str, Fraction]
    high: dict[str, Fraction]

    @classmethod
    def of(cls, loop: ModeLoop) -> Reach:
        """That of the start."""
        ends = dict(zip(loop.reals, loop.start, strict=True))
        return cls({k: a for k, (a, _) in ends.items()}, {k: b for k, (_, b) in ends.items()})

    def add(self, loop: ModeLoop, found: Images) -> None:
        """Take images in."""
        for boxes in (*found.between, found.reals):
            for name, box in zip(loop.reals, boxes, strict=True):
                self._take(name, box)
        for name, boxes in found.kept.items():
            for box in boxes:
                self._take(name, box)

    def _take(self, name: str, box: Any) -> None:
        scale = 1 if isinstance(box, Boxes) else Fraction(1, ONE)
        low, high = Fraction(box.low.min()) * scale, Fraction(box.high.max()) * scale
        self.low[name] = min(self.low.get(name, low), low)
        self.high[name] = max(self.high.get(name, high), high)


# ---- images ------------------------------------------------------------------------------------


def images_of(
    loop: ModeLoop, tick: ModeTick, kind: Any, grid: Grid, places: np.ndarray, modes: np.ndarray
) -> Images:
    """Images of cells; where they have too many ways, in smaller parts.

    Raises:
        ArithmeticError: nothing bounds one, or a single cell has too many ways.
    """
    try:
        with np.errstate(all="ignore"):  # what overflows bounds nothing, and is told so
            return tick.images(
                kind, grid.ends(places, kind is not Boxes), modes, loop.push, loop.stride
            )
    except TooManyWays:
        if len(places) < 2:
            raise
    half = len(places) // 2
    one = images_of(loop, tick, kind, grid, places[:half], modes[:half])
    two = images_of(loop, tick, kind, grid, places[half:], modes[half:])
    return Images(np.concatenate([one.cell, two.cell + half]),
                  [_joined(a, b) for a, b in zip(one.reals, two.reals, strict=True)],
                  np.concatenate([one.modes, two.modes]),
                  [*one.between, *two.between],
                  {n: [*one.kept[n], *two.kept[n]] for n in one.kept})  # fmt: skip


def _joined(a: Any, b: Any) -> Any:
    return type(a)(np.concatenate([a.low, b.low]), np.concatenate([a.high, b.high]))


def places_in_ranges(low: np.ndarray, high: np.ndarray, count: Sequence[int]) -> np.ndarray:
    """Places of all cells from the first to the last one along each axis, by row."""
    if not len(low):
        return np.zeros(0, np.int64)
    span, first = high - low + 1, low.min(axis=0)
    box = high.max(axis=0) + 1 - first
    if span.astype(float).prod(axis=1).sum() > box.astype(float).prod():  # many share their cells
        inner = np.unravel_index(np.flatnonzero(_cover(low - first, high - first, box)), box)
        at = tuple(i + b for i, b in zip(inner, first, strict=True))
        return np.ravel_multi_index(at, tuple(count)).astype(np.int64)
    strides = np.array([math.prod(count[k + 1 :]) for k in range(len(count))], np.int64)
    base = low @ strides
    many, found = span.max(axis=0) + 1, []
    shapes, of = _distinct(np.ravel_multi_index(span.T, many))
    for k, shape in enumerate(zip(*np.unravel_index(shapes, many), strict=True)):
        offsets = sum(np.ix_(*(np.arange(n) * s for n, s in zip(shape, strides, strict=True))))
        found.append((base[of == k, None] + np.ravel(offsets)).reshape(-1))
    return np.concatenate(found)


def _cover(low: np.ndarray, high: np.ndarray, count: np.ndarray) -> np.ndarray:
    """How many rows cover each cell, summed up from the corners of their ranges."""
    total = np.zeros([c + 1 for c in count], np.int32)
    for at, sign in _corners(low, high):
        np.add.at(total, at, sign)
    for axis in range(len(count)):
        np.cumsum(total, axis=axis, out=total)
    return total[tuple(slice(c) for c in count)].reshape(-1)


def _corners(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[tuple[np.ndarray, ...], int]]:
    """Corners of ranges of cells, one beyond the last, and the sign with which each counts."""
    for ends in product((0, 1), repeat=low.shape[1]):
        sides = [high[:, k] + 1 if upper else low[:, k] for k, upper in enumerate(ends)]
        yield tuple(sides), -1 if sum(ends) % 2 else 1


def _distinct(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct ones of a few whole numbers, in order, and which of them each is."""
    found = np.unique(values)
    return found, np.searchsorted(found, values)


# ---- check --------------------------------------------------------------------------------------


def ways_to_check(loop: ModeLoop, cells: Cells) -> tuple[tuple[Any, str], ...]:
    """Kinds of numbers in which a set is checked, and their words: a small one in whole numbers.

    Whole numbers go by the mean value theorem. Lines of floats are a little tighter, so they may
    confirm what whole numbers do not.
    """
    floats = (Boxes, "in floats rounded outwards")
    if cells.many * max(len(loop.code.steps), 1) * loop.stride <= COARSE_WORK:
        return (WholeBoxes, "in whole numbers"), floats
    return (floats,)


def check_cells(loop: ModeLoop, grid: Grid, cells: Cells, kind: Any) -> Reach:
    """Confirm that no tick leaves a set; gives what it reaches.

    Args:
        loop, grid, cells: the set. kind: the arithmetic, ``WholeBoxes`` or ``Boxes``.

    Raises:
        DoesNotHold: a tick leaves it, or a start lies outside.
    """
    tick = loop.tick()
    totals = [_totals(held, grid.count) for held in cells.held]
    starts = [kind.around(a, b) for a, b in loop.start]
    _inside(cells, totals, grid, starts, np.array([loop.begins], np.int64).reshape(1, -1))
    reach = Reach.of(loop)
    chunk = CHUNK if kind is Boxes else 2000
    for modes, held in zip(cells.modes, cells.held, strict=True):
        places = np.flatnonzero(held)
        for k in range(0, len(places), chunk):
            part = places[k : k + chunk]
            of = np.broadcast_to(np.array(modes, np.int64), (len(part), len(modes)))
            try:
                found = images_of(loop, tick, kind, grid, part, of)
            except ArithmeticError as error:  # too many ways, or one that has no root
                raise DoesNotHold(f"evidence: {error}") from None
            if loop.left(found):
                raise DoesNotHold(f"evidence: {loop.left(found)} is not in its range")
            _inside(cells, totals, grid, found.reals, found.modes)
            reach.add(loop, found)
    return reach


def _inside(
    cells: Cells, totals: Sequence[np.ndarray], grid: Grid, boxes: Sequence[Any], modes: np.ndarray
) -> None:
    """Confirm that all cells that boxes touch are in the set.

    Raises:
        DoesNotHold: one is not.
    """
    low, high, out = grid.touched(boxes)
    numbers = cells.mode_numbers(modes, False)
    if out.any() or (numbers < 0).any():
        raise DoesNotHold("evidence: a tick leaves its cells")
    wanted = (high - low + 1).prod(axis=1)
    for n in np.unique(numbers):
        mine = numbers == n
        if (_counted(totals[n], low[mine], high[mine]) != wanted[mine]).any():
            raise DoesNotHold("evidence: a tick leaves its cells")


def _totals(held: np.ndarray, count: Sequence[int]) -> np.ndarray:
    """How many cells of a set lie below each corner of the grid, along all axes."""
    total = np.zeros([c + 1 for c in count], np.int32)
    inner = total[tuple(slice(1, None) for _ in count)]
    inner[...] = held.reshape(count)
    for axis in range(len(count)):
        np.cumsum(inner, axis=axis, out=inner)
    return total


def _counted(total: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Cells of a set from the first to the last one along each axis, by row."""
    found = np.zeros(len(low), np.int64)
    turn = -1 if low.shape[1] % 2 else 1
    for at, sign in _corners(low, high):
        found += turn * sign * total[at].astype(np.int64)
    return found
