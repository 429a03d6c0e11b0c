"""Images of small cells under each operation of a tick: they hold every point, and hardly more."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes
from slipctl.certify.cells.mode_images import ModeTick
from slipctl.certify.cells.mode_lines import LineValues
from slipctl.certify.cells.mode_means import MeanValues
from slipctl.certify.ticks.tick_code import TickCode

F = Fraction

WIDE = 2.0**-10
A = np.array([1.25, 0.5, 2.75, 0.625, 1.5])
B = np.array([0.75, 1.625, 2.0, 0.5, 3.25])
"""Lower ends of cells in a and b, each other than the next."""

# s = a + b and d = a - b are values 2 and 3 of the tick
OPERATIONS = {
    "sum": ([("add", 0, 1)], lambda a, b: a + b), "difference": ([], lambda a, b: a - b),
    "product": ([("mul", 2, 3)], lambda a, b: a * a - b * b),
    "its square": ([("mul", 3, 3)], lambda a, b: (a - b) ** 2),
    "itself": ([("div", 2, 2)], lambda a, b: 1 + 0 * a),
    "quotient": ([("div", 3, 2)], lambda a, b: (a - b) / (a + b)),
    "negative": ([("neg", 3)], lambda a, b: b - a),
    "square": ([("sq", 2)], lambda a, b: (a + b) ** 2),
    "size": ([("abs", 3)], lambda a, b: abs(a - b)),
    "smaller": ([("min", 3, 1)], lambda a, b: np.minimum(a - b, b)),
    "larger": ([("max", 1, 3)], lambda a, b: np.maximum(a - b, b)),
    "root": ([("sqrt", 2)], lambda a, b: np.sqrt(a + b)),
    "exponential": ([("exp", 3)], lambda a, b: np.exp(a - b)),
    "logarithm": ([("ln", 2)], lambda a, b: np.log(a + b)),
    "arc": ([("atan", 3)], lambda a, b: np.arctan(a - b)),
    "choice": ([("less", 0, 1), ("choose", 4, 3, 2)],
               lambda a, b: np.where(a < b, a - b, a + b)),
    "other choice": ([("less_equal", 1, 0), ("choose", 4, 1, 3)],
                     lambda a, b: np.where(b <= a, b, a - b)),
    "chain": ([("mul", 2, 3), ("sub", 4, 0), ("div", 5, 1)],
              lambda a, b: (a * a - b * b - a) / b),
}  # fmt: skip


def image(kind, name, a=A, b=B):
    """Lower and upper ends of the image of cells, one a row, and of the other state."""
    steps = [("add", 0, 1), ("sub", 0, 1), *OPERATIONS[name][0]]
    out = 1 + len(steps)
    code = TickCode(("x_a", "x_b"), tuple(steps), {"a": out, "b": 2})
    tick = ModeTick(code, ("a", "b"), ())
    ends = [(low, low + WIDE) for low in (a, b)]
    found = tick.images(kind, ends, np.zeros((len(a), 0), np.int64), {})
    assert list(found.cell) == list(range(len(a)))
    scale = 1 if kind is Boxes else float(F(1, ONE))
    return [np.array([float(x) for x in end]) * scale
            for box in found.reals for end in (box.low, box.high)]  # fmt: skip


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
def test_an_image_holds_every_point_of_its_cell_and_hardly_more(kind, name) -> None:
    low, high, other_low, other_high = image(kind, name)
    s, t = (x.ravel() for x in np.meshgrid(np.linspace(0, WIDE, 9), np.linspace(0, WIDE, 9)))
    values = OPERATIONS[name][1](A[:, None] + s, B[:, None] + t)
    least, most = values.min(axis=1), values.max(axis=1)
    assert (low <= least + 1e-12).all()
    assert (high >= most - 1e-12).all()
    room = 2 * WIDE if name == "itself" else 4 * WIDE**2 * (1 + abs(values).max())
    assert (low >= least - room).all()
    assert (high <= most + room).all()
    assert other_low == pytest.approx(A + B, abs=1e-9)
    assert other_high == pytest.approx(A + B + 2 * WIDE, abs=1e-9)


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
def test_an_image_across_a_bend_or_a_jump_holds_both_sides(kind) -> None:
    """Cells where a is near b, or near 2 b: the bend of each lies inside of one of them."""
    b = np.array([0.75, 0.75, 1.5])
    a = b + WIDE * np.array([0.25, 3.0, -0.5])
    s, t = (x.ravel() for x in np.meshgrid(np.linspace(0, WIDE, 9), np.linspace(0, WIDE, 9)))
    for name in ("size", "smaller", "larger"):
        shift = b if name != "size" else 0 * b
        low, high, *_ = image(kind, name, a + shift, b)
        values = OPERATIONS[name][1](a[:, None] + shift[:, None] + s, b[:, None] + t)
        assert (low <= values.min(axis=1) + 1e-12).all()
        assert (high >= values.max(axis=1) - 1e-12).all()
        assert (high - low < np.ptp(values, axis=1) + 2 * WIDE).all()


@pytest.mark.parametrize("kind", ["lines", "means"])
def test_a_value_times_itself_is_its_square(kind) -> None:
    """And over itself one, whatever is known of it."""
    maker = LineValues() if kind == "lines" else MeanValues(Boxes)
    form = maker.cells([(np.array([1.0, -2.0]), np.array([2.0, -1.5]))])[0]
    square = maker.after("mul", [form, form], [0, 0]).box
    assert list(square.low) == pytest.approx([1, 2.25])
    assert list(square.high) == pytest.approx([4, 4])
    one = maker.after("div", [form, form], [0, 0]).box
    assert (one.low <= 1).all()
    assert (one.high >= 1).all()


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
def test_an_open_choice_has_both_answers(kind) -> None:
    """Of three cells the middle one is open: two images, one of each way."""
    steps = (("add", 0, 1), ("sub", 0, 1), ("less", 0, 1), ("choose", 4, 3, 2))
    tick = ModeTick(TickCode(("x_a", "x_b"), steps, {"a": 5, "b": 1}), ("a", "b"), ())
    a, b = np.array([0.5, 1.0, 2.0]), np.array([1.0, 1.0, 1.0])
    found = tick.images(kind, [(a, a + WIDE), (b, b + WIDE)], np.zeros((3, 0), np.int64), {})
    scale = 1 if kind is Boxes else F(1, ONE)
    rows = sorted((int(c), math.floor(16 * (low + high) / 2 * scale))
                  for c, low, high in zip(found.cell, found.reals[0].low, found.reals[0].high,
                                          strict=True))  # fmt: skip
    assert rows in ([(0, -8), (1, -1), (1, 32), (2, 48)], [(0, -8), (1, 0), (1, 32), (2, 48)])
