"""A sampled loop near its rest, and what its tick adds to the nearest linear loop.

    x+ - c = A (x - c) + B w + r,      r in [low, high] while x stays in the box c + [-Z, Z]

c is the rest, which may move with parameters that do not change in a run (the height of the
adhesion curve, the mass): c(p) = c0 + c1 (p - p0). A and B are any numbers. With J and G the
enclosed slopes of the tick over box and cell,

    r = (F(c(p), 0, p) - c(p)) + sum_j int_0^{y_j} (J_j - A_j) dt + sum_j int_0^{w_j} (G_j - B_j) dt

by the mean value theorem along the axes, one after another. Where a slope varies much the integral
is taken in parts. The residual of the rest is that at p0 and its slope by p over the cell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.ticks.tick_code import TickCode

DIGITS = 40
"""Digits of enclosures."""

PARTS = 12
"""Parts of an integral to either side of the rest."""

Range = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class SampledLoop:
    """A loop, tick by tick.

    Attributes:
        code: its tick; inputs ``x_STATE``, ``d_PUSH`` and ``p_PARAMETER``, outputs by state.
        states: names. pushes: what pushes in each tick. slow: parameters that do not change.
    """

    code: TickCode
    states: tuple[str, ...]
    pushes: tuple[str, ...]
    slow: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cell:
    """A cell of the slow parameters, and the rest over it.

    Attributes:
        slow: range of each. rest: the rest at the middle, by state in order.
        moves: by slow parameter how the rest moves with it.
    """

    slow: tuple[Range, ...]
    rest: tuple[Fraction, ...]
    moves: tuple[tuple[Fraction, ...], ...]

    def middles(self) -> tuple[Fraction, ...]:
        """Middle of each parameter."""
        return tuple((a + b) / 2 for a, b in self.slow)


ZERO: Range = (Fraction(0), Fraction(0))
"""Range of a slope, a push or a distance from rest that is zero."""

Make = Callable[[Fraction, Fraction], Any]
"""Makes an enclosure of two ends: an interval of decimals, or boxes."""


def decimals(low: Fraction, high: Fraction) -> Interval:
    """Interval of decimals around two rationals."""
    return Interval(Interval.of(low, DIGITS).low, Interval.of(high, DIGITS).high, DIGITS)


def boxes(low: Fraction, high: Fraction) -> Boxes:
    """Box of floats around two rationals."""
    return Boxes.around(low, high)


def input_enclosures(loop: SampledLoop, cell: Cell, make: Make, box: Sequence[Range] | None = None,
           push: Sequence[Range] | None = None) -> dict[str, Any]:  # fmt: skip
    """Enclosures of all inputs: states about their rest, pushes, parameters in their cell."""
    given: dict[str, Any] = {}
    for name, (low, high) in zip(loop.slow, cell.slow, strict=True):
        given[f"p_{name}"] = make(low, high)
    for i, name in enumerate(loop.states):
        given[f"x_{name}"] = _state(cell, make, i, box[i] if box else ZERO)
    for j, name in enumerate(loop.pushes):
        given[f"d_{name}"] = make(*(push[j] if push else ZERO))
    return given


def _state(cell: Cell, make: Make, i: int, about: Range) -> Any:
    """Enclosure of one state, which is so far from its rest."""
    low, high = cell.rest[i] + about[0], cell.rest[i] + about[1]
    for (a, b), moves in zip(cell.slow, cell.moves, strict=True):
        if moves[i]:
            away = abs(moves[i]) * (b - a) / 2
            low, high = low - away, high + away
    return make(low, high)


def slope_ranges(
    loop: SampledLoop, given: Mapping[str, Any], by: Sequence[str]
) -> dict[tuple[int, str], Range]:
    """Ends of the slopes of the tick by inputs, by row and input; what is left out is zero.

    Raises:
        OpenJump: a condition is open there.
        ArithmeticError: nothing bounds a slope there.
    """
    _, slopes = loop.code.slopes(given, by)
    found = {}
    for i, name in enumerate(loop.states):
        for at, value in slopes[name].items():
            found[i, at] = ends_of(value)
    return found


def ends_of(value: Any) -> Range:
    """Ends of an enclosure, of all its boxes."""
    if isinstance(value, Interval):
        return value.ends()
    low, high = float(value.low.min()), float(value.high.max())
    if not abs(low) < float("inf") > abs(high):
        raise ArithmeticError("nothing bounds it")
    return Fraction(low), Fraction(high)


def residuals(loop: SampledLoop, cell: Cell, make: Make) -> list[Range]:
    """By row what F(c(p), 0, p) - c(p) may be over the cell."""
    middle = Cell(tuple((m, m) for m in cell.middles()), cell.rest, cell.moves)
    at = loop.code.run(input_enclosures(loop, middle, make))
    found = []
    for name, rest in zip(loop.states, cell.rest, strict=True):
        low, high = ends_of(at[name])
        found.append((low - rest, high - rest))
    if all(a == b for a, b in cell.slow):
        return found
    by = [f"x_{s}" for s in loop.states] + [f"p_{s}" for s in loop.slow]
    slopes = slope_ranges(loop, input_enclosures(loop, cell, make), by)
    for q, (name, (a, b)) in enumerate(zip(loop.slow, cell.slow, strict=True)):
        half = (b - a) / 2
        for i in range(len(loop.states)):
            low, high = slopes.get((i, f"p_{name}"), ZERO)
            low, high = low - cell.moves[q][i], high - cell.moves[q][i]
            for j, state in enumerate(loop.states):
                ends = slopes.get((i, f"x_{state}"))
                if ends is not None and cell.moves[q][j]:
                    one, two = (e * cell.moves[q][j] for e in ends)
                    low, high = low + min(one, two), high + max(one, two)
            most = max(abs(low), abs(high)) * half
            found[i] = (found[i][0] - most, found[i][1] + most)
    return found


@dataclass(frozen=True)
class Nominal:
    """The linear loop that a loop is compared with.

    Attributes:
        A: by row and state. B: by row and push; what is left out is zero.
        bends: (row, input) whose slope varies so much that its integral is taken in parts.
    """

    A: Mapping[tuple[int, int], Fraction]
    B: Mapping[tuple[int, int], Fraction]
    bends: frozenset[tuple[int, int]] = frozenset()


def remainders(
    loop: SampledLoop, cell: Cell, nominal: Nominal, box: Sequence[Fraction],
    push: Sequence[Fraction], make: Make,
) -> list[Range]:  # fmt: skip
    """By row what the tick adds to the nominal loop while the box is not left.

    Args:
        loop, cell, nominal: the loop. box: half-widths about the rest, by state.
        push: largest of each push. make: of enclosures.

    Raises:
        OpenJump: a condition is open in the box. ArithmeticError: nothing bounds a slope.
    """
    wide = [(-z, z) for z in box]
    pushed = [(-w, w) for w in push]
    whole = input_enclosures(loop, cell, make, wide, pushed)
    axes = [(f"x_{s}", z) for s, z in zip(loop.states, box, strict=True)]
    axes += [(f"d_{s}", w) for s, w in zip(loop.pushes, push, strict=True)]
    names = [n for n, z in axes if z]
    slopes = slope_ranges(loop, whole, names)
    found = residuals(loop, cell, make)
    n = len(loop.states)
    for j, (name, size) in enumerate(axes):
        if not size:
            continue
        rows = [i for i in range(n) if (i, j) in nominal.bends]
        parts = _in_parts(loop, cell, make, whole, j, size, rows) if rows else {}
        for i in range(n):
            wanted = (nominal.A.get((i, j)) if j < n else nominal.B.get((i, j - n))) or Fraction(0)
            if i in rows:
                low, high = _integral(parts[i], wanted, size)
            else:
                ends = slopes.get((i, name), ZERO)
                most = max(abs(ends[0] - wanted), abs(ends[1] - wanted)) * size
                low, high = -most, most
            found[i] = (found[i][0] + low, found[i][1] + high)
    return found


def _in_parts(
    loop: SampledLoop, cell: Cell, make: Make, given: Mapping[str, Any], j: int, size: Fraction,
    rows: Sequence[int],
) -> dict[int, list[Range]]:  # fmt: skip
    """By row the slopes along an axis, in parts from -size to size."""
    n = len(loop.states)
    ends = [(size * k / PARTS, size * (k + 1) / PARTS) for k in range(-PARTS, PARTS)]
    if j < n:
        name, places = f"x_{loop.states[j]}", [_state(cell, make, j, part) for part in ends]
    else:
        name, places = f"d_{loop.pushes[j - n]}", [make(*part) for part in ends]
    if isinstance(places[0], Boxes):  # all parts at once
        together = Boxes(np.concatenate([p.low for p in places]),
                         np.concatenate([p.high for p in places]))  # fmt: skip
        _, slopes = loop.code.slopes({**given, name: together}, [name])
        return {i: _ends_of_each(slopes[loop.states[i]].get(name), len(places)) for i in rows}
    found: dict[int, list[Range]] = {i: [] for i in rows}
    for place in places:
        slopes_here = slope_ranges(loop, {**given, name: place}, [name])
        for i in rows:
            found[i].append(slopes_here.get((i, name), ZERO))
    return found


def _ends_of_each(value: Boxes | None, many: int) -> list[Range]:
    """Ends of each of so many boxes."""
    if value is None:
        return [ZERO] * many
    low, high = np.broadcast_to(value.low, many), np.broadcast_to(value.high, many)
    if not (np.isfinite(low) & np.isfinite(high)).all():
        raise ArithmeticError("nothing bounds a slope")
    return [(Fraction(a), Fraction(b)) for a, b in zip(low.tolist(), high.tolist(), strict=True)]


def _integral(parts: Sequence[Range], wanted: Fraction, size: Fraction) -> Range:
    """Range of the integral of (slope - wanted) from 0 to any place between -size and size."""
    step = size / PARTS
    least = most = Fraction(0)
    for way in (1, -1):
        side = parts[PARTS:] if way > 0 else parts[PARTS - 1 :: -1]
        low = high = Fraction(0)
        for a, b in side:
            one, two = (way * (e - wanted) * step for e in (a, b))
            down, up = min(one, two), max(one, two)
            least, most = min(least, low, low + down), max(most, high, high + up)
            low, high = low + down, high + up
    return least, most
