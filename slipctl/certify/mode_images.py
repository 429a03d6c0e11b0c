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

from slipctl.certify.tick_code import _RULES, _WEIGHTS, TickCode

MOST_ROWS = 40_000
"""Most rows that a few cells may have."""

MOST_WAYS = 6
"""Rows of one cell, above which those of one mode are put together after a tick."""

COMPARISONS = ("less", "less_equal", "equal")


class TooManyWays(ArithmeticError):
    """Cells with too many ways through the tick."""


@dataclass
class _Form:
    """A value over all rows: its enclosure, that at the middles of the cells, and its slopes."""

    box: Any
    middle: Any
    slopes: dict[int, Any]

    def take(self, rows: np.ndarray) -> _Form:
        same = self.middle is self.box
        box = self.box.take(rows)
        return _Form(box, box if same else self.middle.take(rows),
                     {k: s.take(rows) for k, s in self.slopes.items()})  # fmt: skip

    def joined(self, order: np.ndarray, begins: np.ndarray) -> _Form:
        """Hulls of groups of rows, which are one after another in an order."""
        same = self.middle is self.box
        box = _hulls(self.box, order, begins)
        return _Form(box, box if same else _hulls(self.middle, order, begins),
                     {k: _hulls(s, order, begins) for k, s in self.slopes.items()})  # fmt: skip

    def spread(self, half: Sequence[Any]) -> Any:
        """Enclosure by the mean value theorem."""
        found = self.middle
        for k, slope in self.slopes.items():
            found = found + slope * half[k]
        return found

    def tightest(self, half: Sequence[Any]) -> Any:
        """What both enclosures have in common."""
        return self.box.meet(self.spread(half)) if self.slopes else self.box


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
        many = len(modes)
        boxes = [kind.of_ends(low, high) for low, high in ends]
        middles, half = [], []
        for (low, high), box in zip(ends, boxes, strict=True):
            middle = (low + high) / 2
            middles.append(kind.of_ends(middle, middle))
            half.append(box - middles[-1])
        one = kind.around(Fraction(1), Fraction(1), many)
        forms = [_Form(boxes[k], middles[k], {k: one}) for k in range(len(boxes))]
        cell, between = np.arange(many), []
        kept: dict[str, list[Any]] = {name: [] for name in self.kept}
        for tick in range(ticks):
            values: list[_Form | None] = [None] * (len(self.code.inputs) + len(self.code.steps))
            for i, name in enumerate(self.code.inputs):
                if name.startswith("d_"):
                    box = kind.around(*push[name[2:]], len(cell))
                    values[i] = _Form(box, box, {})
            for k, i in enumerate(self._of_real):
                values[i] = forms[k]
            for k, i in enumerate(self._of_mode):
                value = modes[:, k].astype(float)
                box = kind.of_ends(value, value)
                values[i] = _Form(box, box, {})
            forms, modes, half, rows = self._ticked(kind, values, half, len(cell))
            cell = cell[rows]
            for name in self.kept:
                kept[name].append(forms.pop().box)
            if tick + 1 < ticks:
                between.append([f.box for f in forms])
                groups = _crowded(cell, modes)
                if groups is not None:
                    order, begins = groups
                    forms = [f.joined(order, begins) for f in forms]
                    half = [h.take(order[begins]) for h in half]
                    cell, modes = cell[order[begins]], modes[order[begins]]
        return Images(cell, [f.box for f in forms], modes, between, kept)

    def _ticked(
        self, kind: Any, values: list[_Form | None], half: list[Any], many: int
    ) -> tuple[list[_Form], np.ndarray, list[Any], np.ndarray]:
        """States after a tick, the modes, the half-widths, and from which row each row is."""
        first, cell = len(self.code.inputs), np.arange(many)
        asked = self._asked(values, many)
        for k, (operation, *args) in enumerate(self.code.steps):
            if operation == "const":
                box = kind.around(args[0], args[0], len(cell))
                values[first + k] = _Form(box, box, {})
                continue
            parts = [values[i] for i in args]
            if operation in COMPARISONS:
                answer = self._compared(operation, parts, half)
                open_ = answer.open_rows()
                open_ = open_[asked[k][cell[open_]]]
                if open_.size:
                    if len(cell) + open_.size > MOST_ROWS:
                        raise TooManyWays("the tick has too many ways over a few cells")
                    rows = np.concatenate([np.arange(len(cell)), open_])
                    values = [None if v is None else v.take(rows) for v in values]
                    half, many = [h.take(rows) for h in half], len(cell)
                    cell, answer = cell[rows], answer.take(rows)
                    one, zero = answer.number(1), answer.number(0)
                    answer.high[open_] = zero.high[open_]  # no in the rows that were there, and
                    answer.low[many:] = one.low[many:]  # yes in the new ones
                values[first + k] = _Form(answer, answer, {})
            else:
                values[first + k] = self._after(operation, parts, args)
            for i in self._dead[k]:
                values[i] = None
        found: dict[str, Any] = {n: values[i] for n, i in self.code.outputs.items()}
        modes = np.empty((len(cell), len(self.modes)), np.int64)
        for k, name in enumerate(self.modes):
            modes[:, k] = found[name].box.whole()
        forms = []
        for name in (*self.reals, *reversed(self.kept)):
            form = found[name]
            forms.append(_Form(form.tightest(half), form.middle, form.slopes))
        return forms, modes, half, cell

    def _asked(self, values: Sequence[_Form | None], many: int) -> dict[int, np.ndarray]:
        """By comparison the rows on which its answer counts, of a pass in plain intervals.

        Behind a choice that is decided, only what it chooses counts.
        """
        first, code = len(self.code.inputs), self.code
        plain: list[Any] = [v.box for v in values[:first] if v is not None]
        like = plain[0]
        for operation, *args in code.steps:
            if operation == "const":
                plain.append(like.number(args[0]))
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
        return {
            k: counts[first + k] if counts[first + k].size else none
            for k, (operation, *_) in enumerate(code.steps)
            if operation in COMPARISONS
        }

    @staticmethod
    def _compared(operation: str, parts: Sequence[Any], half: Sequence[Any]) -> Any:
        """Answer to a comparison, by row 0, 1 or both."""
        a, b = parts
        plain = _RULES[operation](a.box, b.box)
        if not (a.slopes or b.slopes) or not plain.open_rows().size:
            return plain
        slopes = {k: (a.slopes[k] - b.slopes[k]) if k in a.slopes and k in b.slopes
                  else a.slopes[k] if k in a.slopes else -b.slopes[k]
                  for k in {**a.slopes, **b.slopes}}  # fmt: skip
        difference = _Form(plain, a.middle - b.middle, slopes).spread(half)
        return plain.meet(_RULES[operation](difference, difference.number(0)))

    @staticmethod
    def _after(operation: str, parts: Sequence[Any], args: Sequence[int]) -> _Form:
        """Value of an operation that is no comparison."""
        boxes = [p.box for p in parts]
        same = all(p.middle is p.box for p in parts)
        if operation in ("mul", "div") and args[0] == args[1]:
            rule = (lambda a, b: a.sq()) if operation == "mul" else _RULES["div"]
        else:
            rule = _RULES[operation]
        box = rule(*boxes)
        if same and not any(p.slopes for p in parts):
            return _Form(box, box, {})
        middle = rule(*(p.middle for p in parts))
        slopes: dict[int, Any] = {}
        if operation == "choose":
            zero = None
            for k in {**parts[1].slopes, **parts[2].slopes}:
                zero = boxes[0] * 0 if zero is None else zero
                slopes[k] = boxes[0].choose(parts[1].slopes.get(k, zero),
                                            parts[2].slopes.get(k, zero))  # fmt: skip
            return _chosen(boxes[0], box, middle, slopes)
        for part, weight in zip(parts, _WEIGHTS[operation](boxes, box), strict=True):
            for k, slope in part.slopes.items():
                term = slope if weight is None else slope * weight
                slopes[k] = slopes[k] + term if k in slopes else term
        return _Form(box, middle, slopes)


def _chosen(answer: Any, box: Any, middle: Any, slopes: dict[int, Any]) -> _Form:
    """What a condition chooses; where it is open there may be a jump, and slopes say nothing."""
    open_ = answer.open_rows()
    if open_.size:
        kind, zero = type(box), answer * 0
        middle = kind(middle.low.copy(), middle.high.copy())
        middle.low[open_], middle.high[open_] = box.low[open_], box.high[open_]
        for k, slope in slopes.items():
            slopes[k] = kind(slope.low.copy(), slope.high.copy())
            slopes[k].low[open_], slopes[k].high[open_] = zero.low[open_], zero.high[open_]
    return _Form(box, middle, slopes)


def _hulls(box: Any, order: np.ndarray, begins: np.ndarray) -> Any:
    return type(box)(np.minimum.reduceat(box.low[order], begins),
                     np.maximum.reduceat(box.high[order], begins))  # fmt: skip


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
