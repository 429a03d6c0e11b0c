"""Where a tick with modes leads a cell: one image for each way through its conditions.

A state machine jumps, so that the image of a cell is not one set. Wherever a comparison of the tick
is open over a cell, both answers are followed, each in a row of its own. On a row nothing jumps
any more, and the mean value theorem holds,

    f(x) in f(middle) + J (x - middle),

with J the slopes over the cell. The image is what this and plain intervals have in common. What
pushes is an interval all along. A mode is a whole number, and known on every row.

Everything is an array over rows, of floats or of whole numbers that are rounded outwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.cells.mode_lines import LineValues
from slipctl.certify.cells.mode_means import MeanValues
from slipctl.certify.ticks.tick_code import _RULES, TickCode

MOST_ROWS = 40_000
"""Most rows that a few cells may have."""

MOST_WAYS = 6
"""Rows of one cell, above which those of one mode are put together after a tick."""

COMPARISONS = ("less", "less_equal", "equal")


class TooManyWays(ArithmeticError):
    """Cells with too many ways through the tick."""


@dataclass(frozen=True)
class Images:
    """Images of cells.

    Attributes:
        cell: number of the cell of each row. reals: enclosure of each real state there.
        modes: value of each mode, by row and mode.
        between: enclosure of each real state at the ticks before.
        kept: by what is watched its enclosure at each tick.
    """

    cell: np.ndarray
    reals: list[Any]
    modes: np.ndarray
    between: list[list[Any]]
    kept: dict[str, list[Any]]


class ModeTick:
    """Tick of a loop with modes, on arrays of cells."""

    def __init__(
        self, code: TickCode, reals: Sequence[str], modes: Sequence[str], kept: Sequence[str] = ()
    ) -> None:
        """Take a tick whose inputs are ``x_STATE`` and ``d_PUSH``, its outputs the states.

        Args:
            code: the tick. reals, modes: names of its states. kept: further outputs.
        """
        self.code, self.reals, self.modes = code, tuple(reals), tuple(modes)
        self.kept = tuple(kept)
        at = {name: i for i, name in enumerate(code.inputs)}
        self._of_real = [at[f"x_{n}"] for n in reals]
        self._of_mode = [at[f"x_{n}"] for n in modes]
        last: dict[int, int] = dict.fromkeys(code.outputs.values(), len(code.steps))
        for k in range(len(code.steps) - 1, -1, -1):
            operation, *args = code.steps[k]
            for i in args if operation != "const" else ():
                last.setdefault(i, k)
        self._dead: list[list[int]] = [[] for _ in range(len(code.steps) + 1)]
        for i, k in last.items():
            self._dead[k].append(i)

    def images(
        self, kind: Any, ends: Sequence[tuple[np.ndarray, np.ndarray]], modes: np.ndarray,
        push: Mapping[str, tuple[Fraction, Fraction]], ticks: int = 1,
    ) -> Images:  # fmt: skip
        """Images of cells after so many ticks.

        Args:
            kind: ``Boxes`` or ``WholeBoxes``. ends: of each real state, by cell.
            modes: value of each mode, by cell and mode. push: range of each push in each tick.
            ticks: how many.

        Raises:
            ArithmeticError: nothing bounds the image, or it has too many ways.
        """
        maker: Any = LineValues() if kind is Boxes else MeanValues(kind)
        forms: list[Any] = maker.cells(ends)
        cell, between = np.arange(len(modes)), []
        kept: dict[str, list[Any]] = {name: [] for name in self.kept}
        for tick in range(ticks):
            values: list[Any] = [None] * (len(self.code.inputs) + len(self.code.steps))
            for i, name in enumerate(self.code.inputs):
                if name.startswith("d_"):
                    values[i] = maker.between(*push[name[2:]], len(cell))
            for k, i in enumerate(self._of_real):
                values[i] = forms[k]
            for k, i in enumerate(self._of_mode):
                values[i] = maker.points(modes[:, k].astype(float))
            forms, modes, rows = self._ticked(maker, values, len(cell))
            cell = cell[rows]
            for name in self.kept:
                kept[name].append(forms.pop().box)
            if tick + 1 < ticks:
                between.append([f.box for f in forms])
                groups = _crowded(cell, modes)
                if groups is not None:
                    order, begins = groups
                    forms = [f.joined(order, begins) for f in forms]
                    maker.take(order[begins])
                    cell, modes = cell[order[begins]], modes[order[begins]]
        return Images(cell, [f.box for f in forms], modes, between, kept)

    def _ticked(
        self, maker: Any, values: list[Any], many: int
    ) -> tuple[list[Any], np.ndarray, np.ndarray]:
        """States after a tick, the modes, and from which row each row is."""
        first, cell, split = len(self.code.inputs), np.arange(many), False
        asked, plain = self._asked(values, many)
        same = [True] * first  # enclosures that are those of the pass in plain intervals
        for k, (operation, *args) in enumerate(self.code.steps):
            if operation == "const":
                values[first + k] = maker.between(args[0], args[0], len(cell))
                same.append(True)
                continue
            parts, box = [values[i] for i in args], None
            same.append(all(same[i] for i in args))
            if same[-1]:
                box = plain[first + k]
                box = box.take(cell) if split and box.low.size > 1 else box
            if operation in COMPARISONS:
                answer = maker.compared(operation, parts, box)
                open_ = answer.open_rows()
                same[-1] = answer is box and not open_.size
                if open_.size and answer.low.size == 1:  # the same in all rows
                    answer = answer.take(np.zeros(len(cell), np.int64))
                    open_ = answer.open_rows()
                open_ = open_[asked[k][cell[open_]]]
                if open_.size:
                    if len(cell) + open_.size > MOST_ROWS:
                        raise TooManyWays("the tick has too many ways over a few cells")
                    rows, many = np.concatenate([np.arange(len(cell)), open_]), len(cell)
                    values = [None if v is None else v.take(rows) for v in values]
                    split = True
                    maker.take(rows)
                    cell, answer = cell[rows], answer.take(rows)
                    one, zero = answer.number(1), answer.number(0)
                    answer.high[open_] = zero.high[open_]  # no in the rows that were there, and
                    answer.low[many:] = one.low[many:]  # yes in the new ones
                values[first + k] = maker.interval(answer)
            else:
                values[first + k] = maker.after(operation, parts, args, box)
            for i in self._dead[k]:
                values[i] = None
        found: dict[str, Any] = {n: values[i] for n, i in self.code.outputs.items()}
        modes = np.empty((len(cell), len(self.modes)), np.int64)
        for k, name in enumerate(self.modes):
            modes[:, k] = found[name].box.whole()
        forms = [
            maker.tightest(found[name], len(cell)) for name in (*self.reals, *reversed(self.kept))
        ]
        return forms, modes, cell

    def _asked(
        self, values: Sequence[Any], many: int
    ) -> tuple[dict[int, np.ndarray], Sequence[Any]]:
        """By comparison the rows on which its answer counts, and a pass in plain intervals.

        Behind a choice that is decided, only what it chooses counts.
        """
        first, code = len(self.code.inputs), self.code
        plain: list[Any] = [v.box for v in values[:first] if v is not None]
        for operation, *args in code.steps:
            if operation == "const":
                plain.append(type(plain[0]).around(args[0], args[0], 1))
            elif operation in ("mul", "div") and args[0] == args[1]:
                a = plain[args[0]]
                plain.append(a.sq() if operation == "mul" else a / a)
            else:
                plain.append(_RULES[operation](*(plain[i] for i in args)))
        counts = [np.zeros(0, bool)] * len(plain)
        all_, none = np.ones(many, bool), np.zeros(many, bool)
        for i in code.outputs.values():
            counts[i] = all_
        for k in range(len(code.steps) - 1, -1, -1):
            operation, *args = code.steps[k]
            own = counts[first + k]
            if operation == "const" or not own.size:
                continue
            for part, i in enumerate(args):
                mine = own
                if operation == "choose" and part:
                    answer = plain[args[0]]
                    never = answer.low == answer.high
                    never &= (answer.low == 0) if part == 1 else (answer.low != 0)
                    mine = own & ~never.astype(bool)
                counts[i] = mine if not counts[i].size else counts[i] | mine
        asked = {
            k: counts[first + k] if counts[first + k].size else none
            for k, (operation, *_) in enumerate(code.steps)
            if operation in COMPARISONS
        }
        return asked, plain


def _crowded(cell: np.ndarray, modes: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Order of the rows and begins of the groups that are put together; None where none are.

    Rows of a cell that has few stay alone, whatever cells stand beside it.
    """
    many = np.bincount(cell)[cell] > MOST_WAYS
    if not many.any():
        return None
    alone = np.where(many, -1, np.arange(len(cell)))
    keys = [alone, *modes.T, cell]
    order = np.lexsort(keys)
    changes = np.zeros(len(cell), bool)
    changes[0] = True
    for key in keys:
        changes[1:] |= np.diff(key[order]) != 0
    return order, np.flatnonzero(changes)
