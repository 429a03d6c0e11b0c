"""Values of a tick over many cells by the mean value theorem, in whole numbers or floats.

    f(x) in f(middle) + J (x - middle),

with J the slopes over the cell. What this and plain intervals have in common counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.ticks.tick_code import _RULES, _WEIGHTS


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


class MeanValues:
    """Makes values of a tick, and keeps the half-width of the cell of each row."""

    def __init__(self, kind: Any) -> None:
        """Take the arithmetic: ``WholeBoxes`` or ``Boxes``."""
        self.kind = kind
        self.half: list[Any] = []

    def cells(self, ends: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[_Form]:
        """Real states over cells."""
        found = []
        for k, (low, high) in enumerate(ends):
            middle = (low + high) / 2
            box, at = self.kind.of_ends(low, high), self.kind.of_ends(middle, middle)
            self.half.append(box - at)
            found.append(_Form(box, at, {k: self.kind.around(Fraction(1), Fraction(1), len(low))}))
        return found

    def between(self, low: Fraction, high: Fraction, many: int) -> _Form:
        """What lies within a range in each of so many rows."""
        return self.interval(self.kind.around(low, high, many))

    def points(self, values: np.ndarray) -> _Form:
        """One float a row."""
        return self.interval(self.kind.of_ends(values, values))

    def interval(self, box: Any) -> _Form:
        """An interval a row, of which nothing more is known."""
        return _Form(box, box, {})

    def take(self, rows: np.ndarray) -> None:
        """Go over to some rows."""
        self.half = [h.take(rows) for h in self.half]

    def tightest(self, form: _Form, many: int) -> _Form:
        """A value with the tightest interval that is known."""
        return _Form(form.tightest(self.half), form.middle, form.slopes)

    def compared(self, operation: str, parts: Sequence[_Form], known: Any = None) -> Any:
        """Answer to a comparison, by row 0, 1 or both; ``known`` is that of the intervals."""
        return _compared(operation, parts, self.half, self._each_row(known))

    def after(
        self, operation: str, parts: Sequence[_Form], args: Sequence[int], known: Any = None
    ) -> _Form:
        """Value of an operation that is no comparison; ``known`` is its interval."""
        return _after(operation, parts, args, self._each_row(known))

    def _each_row(self, known: Any) -> Any:
        """An interval in each row, of one that may be the same in all of them."""
        many = self.half[0].low.size if self.half else 1
        if known is None or known.low.size == many:
            return known
        return known.take(np.zeros(many, np.int64))


def _compared(
    operation: str, parts: Sequence[_Form], half: Sequence[Any], known: Any = None
) -> Any:
    """Answer to a comparison, by row 0, 1 or both."""
    a, b = parts
    plain = _RULES[operation](a.box, b.box) if known is None else known
    if not (a.slopes or b.slopes) or not plain.open_rows().size:
        return plain
    slopes = {k: (a.slopes[k] - b.slopes[k]) if k in a.slopes and k in b.slopes
              else a.slopes[k] if k in a.slopes else -b.slopes[k]
              for k in {**a.slopes, **b.slopes}}  # fmt: skip
    difference = _Form(plain, a.middle - b.middle, slopes).spread(half)
    return plain.meet(_RULES[operation](difference, difference.number(0)))


def _after(operation: str, parts: Sequence[Any], args: Sequence[int], known: Any = None) -> _Form:
    """Value of an operation that is no comparison."""
    boxes = [p.box for p in parts]
    same = all(p.middle is p.box for p in parts)
    if operation in ("mul", "div") and args[0] == args[1]:
        rule = (lambda a, b: a.sq()) if operation == "mul" else _RULES["div"]
    else:
        rule = _RULES[operation]
    box = rule(*boxes) if known is None else known
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
    rows = answer.open_rows()
    if rows.size:
        is_open, zero = np.zeros(answer.low.shape, bool), answer * 0
        is_open[rows] = True

        def jumps(at: Any, else_: Any) -> Any:
            return type(box)(np.where(is_open, at.low, else_.low),
                             np.where(is_open, at.high, else_.high))  # fmt: skip

        middle = jumps(box, middle)
        slopes = {k: jumps(zero, slope) for k, slope in slopes.items()}
    return _Form(box, middle, slopes)


def _hulls(box: Any, order: np.ndarray, begins: np.ndarray) -> Any:
    return type(box)(np.minimum.reduceat(box.low[order], begins),
                     np.maximum.reduceat(box.high[order], begins))  # fmt: skip
