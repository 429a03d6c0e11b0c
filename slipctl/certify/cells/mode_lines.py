"""Values of a tick over many cells as lines: a middle, slopes along the cell, and a rest.

    x = middle + sum_k slope_k e_k + rest e,    |e_k| <= 1, |e| <= 1

e_k is where in its cell real state k is; the rest is all else: what pushes, what bends, and all
roundings. Beside it stands the plain interval of ``Boxes``; both hold, and what they have in common
counts. A value that a tick computes takes a few operations on arrays of floats. Each of them adds
a bound of its rounding to the rest: affine arithmetic, after Stolfi and Figueiredo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.ticks.tick_code import _RULES, _WEIGHTS

EPS = 2.0**-50
"""Bound of the roundings of an operation, over the numbers in it: each is wrong by 2^-53."""

GROW = 1 + 2.0**-46
"""What a sum of positive floats is multiplied by, so that its own roundings are in it."""

TINY = 1e-300
"""What is lost where floats end."""

_NONE: Mapping[int, Any] = {}


@dataclass(frozen=True)
class Line:
    """A line over all rows.

    Attributes:
        middle, slopes, rest: as above, arrays by row or of one number for all of them.
        radius: of all but the middle.
    """

    middle: Any
    slopes: Mapping[int, Any]
    rest: Any
    radius: Any

    @classmethod
    def of(cls, middle: Any, slopes: Mapping[int, Any], rest: Any) -> Line:
        """A line, whose radius is summed up."""
        radius = rest
        for s in slopes.values():
            radius = radius + np.abs(s)
        return cls(middle, slopes, rest, radius * GROW if slopes else radius)

    @classmethod
    def of_box(cls, box: Boxes) -> Line:
        """The line of an interval: its middle and its half-width."""
        point = box.low == box.high
        with np.errstate(invalid="ignore", over="ignore"):
            middle = np.where(point, box.low, box.low / 2 + box.high / 2)
            wide = np.maximum(middle - box.low, box.high - middle) * GROW
        rest = np.where(point, 0.0, wide + TINY)
        return cls(middle, _NONE, rest, rest)

    def take(self, rows: np.ndarray) -> Line:
        """Lines of some rows."""
        return Line(_rows(self.middle, rows), {k: _rows(s, rows) for k, s in self.slopes.items()},
                    _rows(self.rest, rows), _rows(self.radius, rows))  # fmt: skip

    def box(self) -> Boxes:
        """Interval of it."""
        with np.errstate(invalid="ignore"):
            room = (self.radius + EPS * np.abs(self.middle)) * GROW
            return Boxes(self.middle - room, self.middle + room)

    def plus(self, other: Line, sign: int = 1) -> Line:
        """Sum of two, or their difference."""
        middle = self.middle + other.middle if sign > 0 else self.middle - other.middle
        slopes = dict(self.slopes)
        for k, s in other.slopes.items():
            if k in slopes:
                slopes[k] = slopes[k] + s if sign > 0 else slopes[k] - s
            else:
                slopes[k] = s if sign > 0 else -s
        size = np.abs(self.middle) + np.abs(other.middle) + self.radius + other.radius
        return Line.of(middle, slopes, (self.rest + other.rest + EPS * size) * GROW)

    def minus(self) -> Line:
        """Its negative."""
        return Line(-self.middle, {k: -s for k, s in self.slopes.items()}, self.rest, self.radius)

    def times(self, other: Line) -> Line:
        """Product of two."""
        a, b = (self, other) if other.slopes is _NONE or not self.slopes else (other, self)
        if not b.slopes and b.rest.size == 1 and b.rest[0] == 0:
            return a.scaled(b.middle)
        middle = self.middle * other.middle
        slopes = {k: s * other.middle for k, s in self.slopes.items()}
        for k, s in other.slopes.items():
            term = s * self.middle
            slopes[k] = slopes[k] + term if k in slopes else term
        one, two = np.abs(self.middle), np.abs(other.middle)
        bent = self.radius * other.radius
        size = (one + self.radius) * (two + other.radius)
        rest = one * other.rest + two * self.rest + bent + EPS * size + TINY
        return Line.of(middle, slopes, rest * GROW)

    def scaled(self, by: Any, rest: Any = 0.0) -> Line:
        """Multiple of it, with more in the rest."""
        middle, size = self.middle * by, np.abs(by)
        slopes = {k: s * by for k, s in self.slopes.items()}
        more = size * (self.rest + EPS * (np.abs(self.middle) + self.radius)) + rest + TINY
        return Line.of(middle, slopes, more * GROW)

    def bent(self, point: Boxes, value: Boxes, slope: Boxes) -> Line:
        """Function of it, by the mean value theorem.

        Args:
            point: of the interval over which ``slope`` is enclosed. value: of the function there.
        """
        mean = Line.of_box(slope)
        away = self.plus(Line.of_box(-point))
        size = np.abs(away.middle) + away.radius
        return away.scaled(mean.middle, mean.radius * size).plus(Line.of_box(value))

    def joined(self, order: np.ndarray, begins: np.ndarray) -> Line:
        """Hulls of groups of rows that are one after another in an order."""
        off: Any = 0.0

        def mean(values: Any) -> Any:
            nonlocal off
            own = np.broadcast_to(_rows(values, order), (len(order),))
            low, high = np.minimum.reduceat(own, begins), np.maximum.reduceat(own, begins)
            with np.errstate(invalid="ignore", over="ignore"):
                found = low / 2 + high / 2
                off = off + np.maximum(high - found, found - low) + EPS * np.abs(found)
            return found

        middle, slopes = mean(self.middle), {k: mean(s) for k, s in self.slopes.items()}
        rest = np.broadcast_to(_rows(self.rest, order), (len(order),))
        return Line.of(middle, slopes, (np.maximum.reduceat(rest, begins) + off) * GROW)


@dataclass(frozen=True)
class LineForm:
    """A value over all rows: its interval, and its line where it has one.

    Attributes:
        box: interval. line: line; None where the interval says all.
    """

    box: Boxes
    line: Line | None = None

    def take(self, rows: np.ndarray) -> LineForm:
        """Values of some rows."""
        box = self.box if self.box.low.size == 1 else self.box.take(rows)
        return LineForm(box, None if self.line is None else self.line.take(rows))

    def joined(self, order: np.ndarray, begins: np.ndarray) -> LineForm:
        """Hulls of groups of rows."""
        wide = self.whole_box(len(order))
        box = Boxes(np.minimum.reduceat(wide.low[order], begins),
                    np.maximum.reduceat(wide.high[order], begins))  # fmt: skip
        return LineForm(box, None if self.line is None else self.line.joined(order, begins))

    def whole_box(self, many: int) -> Boxes:
        """Interval of each of so many rows."""
        if self.box.low.size == many:
            return self.box
        return Boxes(np.full(many, self.box.low[0]), np.full(many, self.box.high[0]))

    def tightest(self, many: int) -> Boxes:
        """What interval and line have in common, by row."""
        box = self.whole_box(many)
        return box if self.line is None else box.meet(self.line.box())

    def _as_line(self) -> Line:
        return Line.of_box(self.box) if self.line is None else self.line

    def compared(self, operation: str, other: LineForm, known: Boxes | None = None) -> Boxes:
        """Answer to a comparison: 0, 1, or both; ``known`` is that of the intervals."""
        plain = _RULES[operation](self.box, other.box) if known is None else known
        if (self.line is None and other.line is None) or not plain.open_rows().size:
            return plain
        difference = self._as_line().plus(other._as_line(), -1).box()
        return plain.meet(_RULES[operation](difference, Boxes(np.zeros(1), np.zeros(1))))

    @staticmethod
    def after(
        operation: str, parts: Sequence[LineForm], args: Sequence[int], known: Boxes | None = None
    ) -> LineForm:
        """Value of an operation that is no comparison; ``known`` is its interval."""
        same = operation in ("mul", "div") and args[0] == args[1]
        name = "sq" if same and operation == "mul" else operation
        if name == "sq":
            parts = parts[:1]
        boxes = [p.box for p in parts]
        box = _RULES[name](*boxes) if known is None else known
        if all(p.line is None for p in parts) or (same and operation == "div"):
            return LineForm(box)
        if name == "choose":
            return _chosen(parts, box)
        lines = [p._as_line() for p in parts]
        if name in ("add", "sub"):
            return LineForm(box, lines[0].plus(lines[1], 1 if name == "add" else -1))
        if name == "mul":
            return LineForm(box, lines[0].times(lines[1]))
        if name == "neg":
            return LineForm(box, lines[0].minus())
        if name in ("min", "max"):
            return LineForm(box, _larger(lines, parts, name == "min"))
        if name == "abs":
            return LineForm(box, _larger([lines[0], lines[0].minus()],
                                         [parts[0], LineForm(-boxes[0])], False))  # fmt: skip
        if name == "div":
            point, over = _point_and_range(lines[1], boxes[1])
            return LineForm(box, lines[0].times(lines[1].bent(point, 1 / point, -1 / over.sq())))
        point, over = _point_and_range(lines[0], boxes[0])
        slope = _WEIGHTS[name]([over], _RULES[name](over))[0]
        return LineForm(box, lines[0].bent(point, _RULES[name](point), slope))


def _point_and_range(line: Line, box: Boxes) -> tuple[Boxes, Boxes]:
    """A point of the range of a value near the middle of its line, and the range."""
    over = box.meet(line.box())
    at = np.minimum(np.maximum(line.middle, over.low), over.high)
    return Boxes(at, at), over


def _rows(values: Any, rows: np.ndarray) -> Any:
    return values if values.size == 1 else values[rows]


def _larger(lines: Sequence[Line], parts: Sequence[LineForm], smaller: bool) -> Line:
    """The larger one of two, b + max(a - b, 0), or the smaller one, a - max(a - b, 0)."""
    difference = lines[0].plus(lines[1], -1)
    over = (parts[0].box - parts[1].box).meet(difference.box())
    first, second = over.low >= 0, over.high <= 0
    one, two = (lines[1], lines[0]) if smaller else lines
    if first.all() or second.all():
        return one if first.all() else two
    found = lines[0 if smaller else 1].plus(_positive(difference, over), -1 if smaller else 1)
    return _picked(first, one, _picked(second, two, found))


def _positive(line: Line, over: Boxes) -> Line:
    """max(x, 0) of a line over its range [l, h]: from s x to s x + c, for any s from 0 to 1.

    c is the larger one of -s l and (1 - s) h. With s = h/(h - l) both are the same.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip(np.nan_to_num(over.high / (over.high - over.low), nan=0.5), 0.0, 1.0)
        room = np.maximum(np.maximum(-share * over.low, (1 - share) * over.high), 0.0) * GROW
    half = Line.of_box(Boxes(np.zeros_like(room), room))
    return line.scaled(share).plus(half)


def _picked(yes: np.ndarray, one: Line, two: Line) -> Line:
    """One line where a condition holds, the other one elsewhere."""
    if yes.all() or not yes.any():
        return one if yes.all() else two
    zero = np.zeros(1)
    slopes = {k: np.where(yes, one.slopes.get(k, zero), two.slopes.get(k, zero))
              for k in {**one.slopes, **two.slopes}}  # fmt: skip
    return Line(np.where(yes, one.middle, two.middle), slopes, np.where(yes, one.rest, two.rest),
                np.where(yes, one.radius, two.radius))  # fmt: skip


def _chosen(parts: Sequence[LineForm], box: Boxes) -> LineForm:
    """What a condition chooses; where it is open there may be a jump, and a line says nothing."""
    answer = parts[0].box
    if answer.low.size == 1 and answer.low[0] == answer.high[0]:
        return parts[1 if answer.low[0] != 0 else 2]
    yes, open_ = answer.low != 0, answer.low != answer.high
    found = _picked(yes, *(p._as_line() for p in parts[1:]))
    return LineForm(box, _picked(open_, Line.of_box(box), found))


@lru_cache(maxsize=4096)
def _around(low: Fraction, high: Fraction) -> Boxes:
    return Boxes.around(low, high)


class LineValues:
    """Makes values of a tick as lines; ranges that all rows have alike are arrays of one."""

    def cells(self, ends: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[LineForm]:
        """Real states over cells."""
        found = []
        for k, (low, high) in enumerate(ends):
            middle = low / 2 + high / 2
            half = np.maximum(high - middle, middle - low) * GROW + TINY
            zero = np.zeros(len(low))
            found.append(LineForm(Boxes(low, high), Line(middle, {k: half}, zero, half)))
        return found

    def between(self, low: Fraction, high: Fraction, many: int) -> LineForm:
        """What lies within a range in all rows."""
        return self.interval(_around(low, high))

    def points(self, values: np.ndarray) -> LineForm:
        """One float a row."""
        return self.interval(Boxes(values, values))

    def interval(self, box: Boxes) -> LineForm:
        """An interval a row, of which nothing more is known."""
        return LineForm(box)

    def take(self, rows: np.ndarray) -> None:
        """Go over to some rows: values do it themselves."""

    def tightest(self, form: LineForm, many: int) -> LineForm:
        """A value with the tightest interval that is known, by row."""
        return LineForm(form.tightest(many), form.line)

    def compared(
        self, operation: str, parts: Sequence[LineForm], known: Boxes | None = None
    ) -> Boxes:
        """Answer to a comparison, by row 0, 1 or both; ``known`` is that of the intervals."""
        return parts[0].compared(operation, parts[1], known)

    def after(
        self, operation: str, parts: Sequence[LineForm], args: Sequence[int],
        known: Boxes | None = None,
    ) -> LineForm:  # fmt: skip
        """Value of an operation that is no comparison; ``known`` is its interval."""
        return LineForm.after(operation, parts, args, known)
