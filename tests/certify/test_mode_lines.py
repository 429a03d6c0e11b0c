"""Lines of a tick hold what the tick gives, at any point of a cell; and the arc tangent."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes
from slipctl.certify.cells.mode_images import ModeTick
from slipctl.certify.cells.mode_lines import LineValues
from slipctl.certify.cells.mode_means import MeanValues
from slipctl.certify.ticks.tick_code import CodeWriter

UNARY = ("neg", "abs", "sq", "exp", "atan", "sqrt", "ln")
BINARY = ("add", "sub", "mul", "div", "min", "max")


def _code(choices):
    """A tick of two states and a push: operations that are drawn, each of earlier values."""
    writer = CodeWriter(("x_a", "x_b", "d_w"))
    values = [0, 1, 2, writer.const(Fraction(1, 3)), writer.const(-2)]
    half, one = writer.const(Fraction(1, 2)), writer.const(1)
    for name, i, j in choices:
        a, b = values[i % len(values)], values[j % len(values)]
        if name in ("sqrt", "ln"):  # of what is positive
            a = writer.add("add", writer.add("sq", a), half)
        if name == "div":
            b = writer.add("add", writer.add("sq", b), one)
        if name == "exp":  # of what is bounded
            a = writer.add("min", a, one)
        if name == "choose":
            values.append(writer.add("choose", writer.add("less", a, b), b, half))
        else:
            values.append(writer.add(name, *((a,) if name in UNARY else (a, b))))
    last = writer.add("min", writer.add("max", values[-1], writer.const(-50)), writer.const(50))
    return writer.code({"a": last, "b": writer.add("sub", last, values[-2])})


steps = st.lists(st.tuples(st.sampled_from((*UNARY, *BINARY, "choose")), st.integers(0, 40),
                           st.integers(0, 40)), min_size=3, max_size=14)  # fmt: skip


@given(steps, st.integers(0, 2**32 - 1))
def test_the_image_of_a_cell_holds_what_the_tick_gives(choices, seed):
    """Two ticks of random operations, at corners and within random cells, with random pushes."""
    code, rng = _code(choices), np.random.default_rng(seed)
    tick, many = ModeTick(code, ("a", "b"), ()), 12
    low = rng.uniform(-2, 2, (2, many))
    high = low + rng.choice([0.5, 0.05, 1e-3], (2, many))
    push = {"w": (Fraction(-1, 7), Fraction(1, 5))}
    modes = np.zeros((many, 0), np.int64)
    try:
        found = tick.images(Boxes, list(zip(low, high, strict=True)), modes, push, 2)
    except ArithmeticError:
        return  # nothing bounds it, which is said
    run, order = code.compiled(arrays=True), list(code.outputs)
    for _ in range(6):
        x = {k: low[i] + (high[i] - low[i]) * rng.choice([0, 1, rng.random()], many)
             for i, k in enumerate(("a", "b"))}  # fmt: skip
        for _ in range(2):
            w = rng.choice([-1 / 7 + 1e-16, 0.2 - 1e-16], many)
            with np.errstate(all="ignore"):
                x = dict(zip(order, run(x["a"], x["b"], w), strict=True))
        held = np.ones(len(found.cell), bool)
        for k, box in zip(("a", "b"), found.reals, strict=True):
            at = np.broadcast_to(x[k], (many,))[found.cell]
            room = 1e-9 * (1 + np.abs(at))  # of the floats of the run
            held &= ~((at < box.low - room) | (at > box.high + room))
        assert set(found.cell[held]) == set(range(many))


def _widths(values, code):
    """Width of what a code gives over one cell, by one way of bounding it."""
    cell = [(np.array([0.2]), np.array([0.3])), (np.array([-0.4]), np.array([-0.3]))]
    found = [*values.cells(cell), values.between(Fraction(0), Fraction(0), 1)]
    for operation, *args in code.steps:
        if operation == "const":
            found.append(values.between(args[0], args[0], 1))
        else:
            found.append(values.after(operation, [found[i] for i in args], args))
    box = values.tightest(found[code.outputs["a"]], 1).box
    return float((box.high - box.low)[0])


@pytest.mark.parametrize("names", [("abs", "abs"), ("max", "min"), ("exp", "mul"), ("mul", "sub")])
def test_lines_are_no_wider_than_the_mean_value_theorem(names):
    """Kinks within kinks and products; each of the two is a proof by itself."""
    writer = CodeWriter(("x_a", "x_b", "d_w"))
    total = writer.add("add", 0, 1)
    first = writer.add(names[0], *((total,) if names[0] in UNARY else (total, 1)))
    moved = writer.add("sub", first, 0)
    last = writer.add(names[1], *((moved,) if names[1] in UNARY else (moved, total)))
    code = writer.code({"a": writer.add("add", last, 0)})
    assert _widths(LineValues(), code) <= 1.02 * _widths(MeanValues(Boxes), code)


@given(st.floats(-1e3, 1e3), st.floats(0, 10))
def test_arc_tangents_enclose_that_of_the_library(x, wide):
    """In floats, decimals and whole numbers; over an interval it rises."""
    low, high = Fraction(x), Fraction(x) + Fraction(wide)
    exact = (math.atan(low), math.atan(high))
    floats = Boxes.around(low, high).atan()
    assert floats.low[0] <= exact[0]
    assert exact[1] <= floats.high[0]
    whole = WholeBoxes.around(low, high).atan()
    ends = [Fraction(int(e[0]), ONE) for e in (whole.low, whole.high)]
    decimals = Interval.of(low, 40).hull(Interval.of(high, 40)).atan().ends()
    for found in (ends, decimals):
        assert float(found[0]) == pytest.approx(exact[0], rel=1e-14, abs=1e-20)
        assert float(found[1]) == pytest.approx(exact[1], rel=1e-14, abs=1e-20)


def test_what_is_not_negative_stays_so():
    """A state that only falls, and stops at 0, does not creep below it by a rounding."""
    zero, share = Boxes(np.zeros(1), np.ones(1)), Fraction(1, 3)
    assert (zero * share).low[0] == 0
    assert (zero * zero).low[0] == 0
    assert (zero * -1).high[0] == 0
