"""Ticks as operations, slopes and residuals, sets of cells that grow: against plain numbers."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import partial
from itertools import product

import casadi as ca
import numpy as np
import pytest

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.whole_boxes import ONE, WholeBoxes, _logarithm
from slipctl.certify.cells import mode_cells, mode_growth, mode_runs
from slipctl.certify.cells.mode_cells import (
    Cells,
    Grid,
    ModeLoop,
    Reach,
    check_cells,
    images_of,
    places_in_ranges,
    ways_to_check,
)
from slipctl.certify.cells.mode_growth import Growth, Work, _batch
from slipctl.certify.cells.mode_images import Images, TooManyWays
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth import sampled_loop
from slipctl.certify.smooth.sampled_loop import (
    PARTS,
    ZERO,
    Cell,
    SampledLoop,
    _ends_of_each,
    _in_parts,
    boxes,
    decimals,
    ends_of,
    residuals,
)
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks import tick_sets, tick_source
from slipctl.certify.ticks.tick_code import (
    CodeWriter,
    OpenJump,
    TickCode,
    code_of_function,
    with_constants,
)
from slipctl.certify.ticks.tick_source import (
    Symbol,
    _Session,
    clip,
    code_of_tick,
    if_else,
    root,
    sgn,
)
from slipctl.errors import BadInput

F = Fraction


def code_of(outputs, names):
    """A tick written in CasADi: functions by output, of inputs by name."""
    x = {n: ca.SX.sym(n) for n in names}
    made = [f(*x.values()) for f in outputs.values()]
    f = ca.Function("tick", [ca.vertcat(*x.values())], [ca.vertcat(*made)])
    return code_of_function(f, names, list(outputs))


def enclosure(code, values):
    """Ends of what a tick gives, of rationals, in decimals."""
    given = {n: Interval.of(v, 40) for n, v in zip(code.inputs, values, strict=True)}
    return {n: x.ends() for n, x in code.run(given).items()}


# ---- operations of CasADi ------------------------------------------------------------------------

POINTS = [F(0), F(1), F(-1), F(1, 2), F(-5, 4), F(3)]


@pytest.mark.parametrize(
    ("made", "plain"),
    [
        (lambda a, b: a + a, lambda a, b: 2 * a),
        (lambda a, b: 1 / (a * a + 2), lambda a, b: 1 / (a * a + 2)),
        (lambda a, b: ca.if_else(a < b, a + 5, 0), lambda a, b: a + 5 if a < b else 0),
        (lambda a, b: ca.if_else(a < b, a, b * 3), lambda a, b: a if a < b else 3 * b),
        (lambda a, b: ca.logic_not(a), lambda a, b: int(a == 0)),
        (lambda a, b: a != b, lambda a, b: int(a != b)),
        (lambda a, b: a == b, lambda a, b: int(a == b)),
        (lambda a, b: a <= b, lambda a, b: int(a <= b)),
        (lambda a, b: ca.logic_and(a, b), lambda a, b: int(a != 0 and b != 0)),
        (lambda a, b: ca.logic_or(a, b), lambda a, b: int(a != 0 or b != 0)),
        (lambda a, b: ca.logic_and(a < 1, b > 0), lambda a, b: int(a < 1 and b > 0)),
        (lambda a, b: ca.logic_or(a < 0, b > 1), lambda a, b: int(a < 0 or b > 1)),
        (lambda a, b: ca.sign(a) + 10 * ca.sign(b),
         lambda a, b: (a > 0) - (a < 0) + 10 * ((b > 0) - (b < 0))),
        (lambda a, b: ca.constpow(a, 3), lambda a, b: a**3),
        (lambda a, b: ca.constpow(a, 6) + ca.power(b, 5), lambda a, b: a**6 + b**5),
        (lambda a, b: ca.constpow(a, 16), lambda a, b: a**16),
        (lambda a, b: ca.constpow(a, 0) + b, lambda a, b: 1 + b),
        (lambda a, b: ca.constpow(a, 1) - b, lambda a, b: a - b),
        (lambda a, b: ca.fabs(a) - ca.fmin(a, b) + ca.fmax(2 * a, b),
         lambda a, b: abs(a) - min(a, b) + max(2 * a, b)),
    ],
)  # fmt: skip
def test_operations_of_casadi_are_read_as_they_are(made, plain):
    code = code_of({"y": made}, ["a", "b"])
    run = code.compiled()
    for a, b in product(POINTS, POINTS):
        true = F(plain(a, b))
        low, high = enclosure(code, (a, b))["y"]
        assert low <= true <= high
        assert high - low < F(1, 10**30)
        assert run(float(a), float(b))[0] == pytest.approx(float(true), rel=1e-12, abs=1e-12)


def written(op, *values):
    """What an operation of CasADi, as it stands in a Function, gives of numbers."""
    from slipctl.certify.ticks.tick_code import _of_casadi

    names = [f"a{k}" for k in range(len(values))]
    writer = CodeWriter(names)
    at = _of_casadi(writer, op, list(range(len(values))))
    return enclosure(writer.code({"y": at}), values)["y"]


@pytest.mark.parametrize("a", POINTS)
def test_operations_that_casadi_may_write_are_known(a):
    """Some of them stand only in Functions that were made of others."""
    assert written(ca.OP_TWICE, a) == (2 * a, 2 * a)
    assert written(ca.OP_ASSIGN, a) == (a, a)
    assert written(ca.OP_NOT, a) == ((a == 0),) * 2
    assert written(ca.OP_SIGN, a) == ((a > 0) - (a < 0),) * 2
    if a:
        low, high = written(ca.OP_INV, a)
        assert low <= 1 / a <= high
        assert high - low < F(1, 10**30)
    for b in POINTS:
        assert written(ca.OP_IF_ELSE_ZERO, a, b) == (b if a else 0,) * 2
        assert written(ca.OP_NE, a, b) == (a != b,) * 2
        assert written(ca.OP_AND, a, b) == (a != 0 and b != 0,) * 2
        assert written(ca.OP_OR, a, b) == (a != 0 or b != 0,) * 2


@pytest.mark.parametrize("power", [0.5, 1.5, -0.75, 2.25])
def test_broken_powers_of_what_is_positive_are_enclosed(power):
    code = code_of({"y": lambda a: a**power}, ["a"])
    for a in (F(1, 7), F(1), F(9, 4)):
        low, high = enclosure(code, [a])["y"]
        assert float(low) == pytest.approx(float(a) ** power, rel=1e-14)
        assert 0 <= high - low < F(1, 10**30)


@pytest.mark.parametrize(
    "made",
    [
        lambda a, b: ca.sin(a), lambda a, b: ca.power(a, b), lambda a, b: ca.floor(a),
        lambda a, b: ca.atan2(a, b),
    ],
)  # fmt: skip
def test_what_cannot_be_enclosed_is_refused(made):
    with pytest.raises(BadInput):
        code_of({"y": made}, ["a", "b"])


@pytest.mark.parametrize("power", [F(-1), F(17), F(-3)])
def test_whole_powers_beyond_those_that_are_known_are_refused(power):
    from slipctl.certify.ticks.tick_code import _of_casadi

    writer = CodeWriter(["a"])
    with pytest.raises(BadInput):
        _of_casadi(writer, ca.OP_CONSTPOW, [0, writer.const(power)])
    at = _of_casadi(writer, ca.OP_CONSTPOW, [0, writer.const(F(4))])
    assert enclosure(writer.code({"y": at}), [F(-3, 2)])["y"] == (F(81, 16), F(81, 16))


def test_numbers_are_put_in_the_place_of_inputs():
    """A way that divides by zero and is never taken stays out; the others are worked out."""
    code = code_of(
        {
            "y": lambda a, p, q: ca.if_else(p <= 0, a + q, a / p),
            "z": lambda a, p, q: ca.fmax(p, q) * ca.fabs(p - q) - ca.fmin(p, q) / 4,
            "u": lambda a, p, q: a * 1,
        },
        ["a", "p", "q"],
    )
    for p, q in ((F(0), F(3)), (F(2), F(-1)), (F(-1), F(1, 2))):
        known = with_constants(code, {"p": p, "q": q})
        assert known.inputs == ("a",)
        assert list(known.outputs) == ["y", "z", "u"]
        for a in POINTS:
            found = enclosure(known, [a])
            for name, true in (("y", a + q if p <= 0 else a / p), ("u", a),
                               ("z", max(p, q) * abs(p - q) - min(p, q) / 4)):  # fmt: skip
                assert found[name][0] <= true <= found[name][1]
                assert found[name][1] - found[name][0] < F(1, 10**30)
        assert all(step[0] != "choose" for step in known.steps)  # of known numbers none is open
    some = with_constants(code, {"q": F(3)})
    assert some.inputs == ("a", "p")
    assert enclosure(some, (F(1), F(2)))["y"] == (F(1, 2), F(1, 2))


# ---- slopes --------------------------------------------------------------------------------------


def rows_of(*ends):
    low, high = np.array(ends, float).T
    return Boxes(low.copy(), high.copy())


def test_slopes_of_what_is_chosen_are_those_of_each_row():
    """Two rows answer differently; what one part lacks has no slope in it."""
    code = code_of({"y": lambda x, w: ca.if_else(x < 0, 3 * x, x * w)}, ["x", "w"])
    given = {"x": rows_of((-2, -1), (1, 2)), "w": rows_of((5, 6), (7, 8))}
    _, slopes = code.slopes(given, ["x", "w"])
    by_x, by_w = slopes["y"]["x"], slopes["y"]["w"]
    assert by_x.low == pytest.approx([3, 7])
    assert by_x.high == pytest.approx([3, 8])
    assert by_w.low == pytest.approx([0, 1], abs=1e-12)
    assert by_w.high == pytest.approx([0, 2], abs=1e-12)
    for ends, slope in (((-2, -1), 3), ((1, 2), 7)):
        given = {"x": rows_of(ends), "w": rows_of((7, 7))}
        assert code.slopes(given, ["x"])[1]["y"]["x"].low == pytest.approx([slope])
    with pytest.raises(OpenJump):
        code.slopes({"x": rows_of((-1, 1)), "w": rows_of((7, 7))}, ["x"])


def test_a_jump_counts_where_it_is_not_left_out():
    made = lambda x, z: ca.if_else(x < 0, ca.if_else(z < 0, 1, 2) + z, x)  # noqa: E731
    code = code_of({"y": made}, ["x", "z"])
    wide = rows_of((-1, 1))
    assert code.slopes({"x": rows_of((1, 2)), "z": wide}, ["x", "z"])[1]["y"]["x"].low == [1]
    with pytest.raises(OpenJump):
        code.slopes({"x": rows_of((-2, -1)), "z": wide}, ["x", "z"])
    both = {"x": rows_of((-2, -1), (1, 2)), "z": rows_of((-1, 1), (-1, 1))}
    with pytest.raises(OpenJump):  # one row of two goes there
        code.slopes(both, ["x", "z"])
    turned = code_of({"y": lambda x, z: ca.if_else(x >= 0, x, ca.if_else(z < 0, 1, 2) + z)},
                     ["x", "z"])  # fmt: skip
    with pytest.raises(OpenJump):
        turned.slopes(both, ["x", "z"])


def test_slopes_of_every_operation_hold_those_of_points():
    """Differences over a small step, at points of a box, lie within the slopes over it."""
    made = lambda a, b: (  # noqa: E731
        a * b / (2 + b * b) - ca.exp(a / 4) + ca.atan(b) + ca.log(3 + a) + ca.sqrt(4 + b)
        + ca.fabs(a) + ca.fmin(a, b) - ca.fmax(2 * a, b) + a * a
    )  # fmt: skip
    code = code_of({"y": made}, ["a", "b"])
    run = code.compiled()
    rng = np.random.default_rng(2)
    for low, high in (((-1, 0.5), (1, 1.5)), ((0.5, -1), (0.75, -0.5)), ((-1, -1), (1, 1))):
        given = {n: rows_of((p, q)) for n, p, q in zip("ab", low, high, strict=True)}
        _, slopes = code.slopes(given, ["a", "b"])
        for _ in range(40):
            a, b = rng.uniform(low, high)
            for n, step in (("a", (1e-6, 0)), ("b", (0, 1e-6))):
                by = (run(a + step[0], b + step[1])[0] - run(a, b)[0]) / 1e-6
                assert slopes["y"][n].low[0] - 1e-4 <= by <= slopes["y"][n].high[0] + 1e-4


# ---- residuals of a rest -------------------------------------------------------------------------


def moving():
    """x+ = x/2 + p^2/4, y+ = y/2 + x p/8: at rest x = p^2/2 and y = p^3/8."""
    code = code_of(
        {"x": lambda x, y, w, p: x / 2 + p * p / 4 + w * w,
         "y": lambda x, y, w, p: y / 2 + x * p / 8},
        ["x_x", "x_y", "d_w", "p_p"],
    )  # fmt: skip
    return SampledLoop(code, ("x", "y"), ("w",), ("p",))


def cell_of(low, high, x=None):
    m = (low + high) / 2
    rest = (m * m / 2 if x is None else x, m**3 / 8)
    return Cell(((low, high),), rest, ((m, 3 * m * m / 8),))


@pytest.mark.parametrize("make", [decimals, boxes])
def test_the_residual_of_a_moving_rest_holds_what_it_is_at_every_place(make):
    """With slopes of both signs; x is off by 1/8 at most over [1, 2], in closed form."""
    loop = moving()
    for low, high in ((F(1), F(2)), (F(-2), F(-1)), (F(1, 2), F(5, 8))):
        cell = cell_of(low, high)
        found = residuals(loop, cell, make)
        m = (low + high) / 2
        for k in range(17):
            p = low + (high - low) * k / 16
            x, y = (c + v * (p - m) for c, v in zip(cell.rest, cell.moves[0], strict=True))
            off = (x / 2 + p * p / 4 - x, y / 2 + x * p / 8 - y)
            for (a, b), exact in zip(found, off, strict=True):
                assert a <= exact <= b
    (xs, ys) = residuals(loop, cell_of(F(1), F(2)), make)
    for (a, b), most in ((xs, F(1, 8)), (ys, F(3, 32))):
        assert float(b) == pytest.approx(float(most), rel=1e-9)
        assert float(a) == pytest.approx(-float(most), rel=1e-9)


@pytest.mark.parametrize("make", [decimals, boxes])
def test_at_one_place_the_residual_is_what_is_wrong_with_the_rest(make):
    loop = moving()
    for wrong in (F(0), F(1, 8), F(-1, 4)):
        cell = cell_of(F(3, 2), F(3, 2), F(9, 8) + wrong)
        found = residuals(loop, cell, make)
        for (a, b), exact in zip(found, (-wrong / 2, wrong * 3 / 16), strict=True):
            assert a <= exact <= b
            assert b - a < F(1, 10**12)
    off = residuals(loop, cell_of(F(1), F(2), F(9, 8) + F(1, 4)), make)
    assert float(off[0][0]) == pytest.approx(-1 / 8 - 1 / 8, rel=1e-9)
    assert float(off[0][1]) == pytest.approx(1 / 8 - 1 / 8, abs=1e-9)


@pytest.mark.parametrize("make", [decimals, boxes])
def test_slopes_along_an_axis_are_given_part_by_part(make):
    """That of w^2 is 2 w, from -size to size; a row without it has none."""
    loop, cell = moving(), cell_of(F(1), F(2))
    given = sampled_loop.input_enclosures(loop, cell, make, [ZERO, ZERO], [(F(-3), F(3))])
    found = _in_parts(loop, cell, make, given, 2, F(3), [0, 1])
    assert list(found) == [0, 1]
    assert len(found[0]) == len(found[1]) == 2 * PARTS
    assert set(found[1]) == {ZERO}
    for k, (low, high) in zip(range(-PARTS, PARTS), found[0], strict=True):
        assert low <= F(6 * k, PARTS) <= F(6 * (k + 1), PARTS) <= high
        assert high - low < F(6, PARTS) + F(1, 10**9)
    along_x = _in_parts(loop, cell, make, given, 0, F(1), [1])
    assert list(along_x) == [1]
    assert all(abs(float(a) - 1 / 8) < 1e-9 and abs(float(b) - 1 / 4) < 1e-9
               for a, b in along_x[1])  # fmt: skip


def test_ends_of_boxes_are_those_of_all_of_them():
    assert ends_of(decimals(F(-1, 2), F(3))) == (F(-1, 2), F(3))
    assert ends_of(rows_of((1, 2), (-3, 0.5), (0, 7))) == (F(-3), F(7))
    for wrong in ((-np.inf, 0), (0, np.inf)):
        with pytest.raises(ArithmeticError):
            ends_of(rows_of((1, 2), wrong))
        with pytest.raises(ArithmeticError):
            _ends_of_each(rows_of((1, 2), wrong), 2)
    assert _ends_of_each(None, 3) == [ZERO] * 3
    assert _ends_of_each(rows_of((1, 2)), 3) == [(F(1), F(2))] * 3
    assert _ends_of_each(rows_of((1, 2), (-1, 0.5)), 2) == [(F(1), F(2)), (F(-1), F(1, 2))]


# ---- numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("x", [F(1, 10**20), F(1, 3), F(1) + F(1, 10**12), F(2), F(10**30)])
def test_a_logarithm_in_whole_numbers_holds_the_true_one(x):
    low, high = _logarithm(int(x * ONE))
    near = Interval.of(F(int(x * ONE), ONE), 60).ln().ends()
    assert F(low, ONE) <= near[0]
    assert near[1] <= F(high, ONE)
    assert high - low < ONE // 10**8
    low, high = _logarithm(ONE)
    assert low <= 0 <= high


def test_squares_of_boxes_are_never_negative():
    for made in (Boxes, WholeBoxes):
        around = [made.around(F(a), F(b)) for a, b in ((-3, 2), (-3, -2), (1, 2), (0, 0))]
        for box, (low, high) in zip(around, ((0, 9), (4, 9), (1, 4), (0, 0)), strict=True):
            found = box.sq()
            scale = 1 if made is Boxes else ONE
            assert float(found.low[0]) / scale == pytest.approx(low, abs=1e-12)
            assert float(found.high[0]) / scale == pytest.approx(high, rel=1e-12)
            assert found.low[0] >= 0


def test_zero_times_what_nothing_bounds_is_zero():
    zero, wide = rows_of((0, 0), (0, 2), (-1, 0)), rows_of((-np.inf, np.inf), (1, np.inf), (2, 3))
    found = zero * wide
    assert list(found.low) == pytest.approx([0, 0, -3], rel=1e-15, abs=1e-300)
    assert found.high[0] == pytest.approx(0, abs=1e-300)
    assert found.high[1] == np.inf
    assert found.high[2] == pytest.approx(0, abs=1e-300)


# ---- functions of a tick -------------------------------------------------------------------------


@pytest.mark.parametrize("x", [F(-3), F(-1, 4), F(0), F(1, 4), F(9, 4)])
def test_functions_of_a_tick_are_the_same_of_floats_intervals_and_when_read(x):
    low, high = F(-1, 2), F(3, 2)
    plain = {
        "sign": (x > 0) - (x < 0),
        "clip": min(max(x, low), high), "upper": min(max(F(1), low), x),
        "lower": min(max(F(1), x), F(2)), "one": F(7) if x > 0 else x, "two": x if x <= 0 else F(4),
    }  # fmt: skip

    def tick(n, y, d):
        at = y["x"]
        return {
            "sign": sgn(at), "clip": clip(at, -0.5, 1.5),
            "upper": clip(1, -0.5, at), "lower": clip(1, at, 2), "one": if_else(at > 0, 7, at),
            "two": if_else(at <= 0, at, 4),
        }  # fmt: skip

    code = code_of_tick(tick, ((), ("x",), ()), tuple(plain))
    read = enclosure(code, [x])
    run = tick({}, {"x": float(x)}, {})
    for name, true in plain.items():
        assert float(read[name][0]) == pytest.approx(float(true), rel=1e-15)
        assert float(read[name][1]) == pytest.approx(float(true), rel=1e-15)
        assert run[name] == pytest.approx(float(true), rel=1e-15)
    session = _Session(["x"])
    code = session.writer.code({"y": root(Symbol(session, 0))._at})
    assert root(float(x)) == math.sqrt(max(x, 0))
    assert code.compiled()(float(x))[0] == math.sqrt(max(x, 0))


def test_functions_of_a_tick_enclose_intervals():
    one = lambda a, b: decimals(F(a), F(b))  # noqa: E731
    for (a, b), ends in (((-2, 3), (-1, 1)), ((1, 2), (1, 1)), ((0, 0), (0, 0)), ((-2, 0), (-1, 0)),
                         ((0, 5), (0, 1))):  # fmt: skip
        assert sgn(one(a, b)).ends() == ends
    low, high = root(one(-2, 4)).ends()
    assert low == 0
    assert high >= 2 > high - F(1, 10**30)
    low, high = root(one(4, 9)).ends()
    assert 2 - F(1, 10**30) < low <= 2
    assert 3 <= high < 3 + F(1, 10**30)
    assert clip(one(-2, 5), -1, 3).ends() == (-1, 3)
    assert clip(one(1, 2), -1, 3).ends() == (1, 2)
    assert clip(one(4, 5), -1, 3).ends() == (3, 3)
    assert if_else(False, 1, 2) == 2
    assert if_else(1, 1, 2) == 1


# ---- sets of cells -------------------------------------------------------------------------------


def spiral(stride=1, **more):
    """Two states that are halved and pushed, and a mode that says on which side a is."""
    code = code_of(
        {"a": lambda a, b, m, w: a / 2 + b / 4 + w, "b": lambda a, b, m, w: b / 2 - a / 4,
         "m": lambda a, b, m, w: ca.if_else(a >= 0, 1, 0), "k": lambda a, b, m, w: a - b},
        ["x_a", "x_b", "x_m", "d_w"],
    )  # fmt: skip
    if "k" not in more.get("kept", {}):
        code = TickCode(code.inputs, code.steps, {n: code.outputs[n] for n in "abm"})
    return ModeLoop(code, ("a", "b"), ("m",), ((F(0), F(1, 8)), (F(0), F(0))), (1,),
                    {"w": (F(-1, 4), F(1, 2))}, ("a",), stride, **more)  # fmt: skip


SIZE = (F(1, 8), F(1, 16))


def grown(loop, origin, count, first=(-40, -40), last=(60, 60), work=10**9):
    growth = Growth(loop, Grid(origin, SIZE, count), Work(work), np.array(first), np.array(last))
    return growth, growth.run([])


def held_cells(cells):
    """All cells of a set by their own numbers: mode, and cell along each axis."""
    found = set()
    for modes, held in zip(cells.modes, cells.held, strict=True):
        at = np.unravel_index(np.flatnonzero(held), cells.grid.count)
        found |= {(modes, *(int(i) + o for i, o in zip(p, cells.grid.origin, strict=True)))
                  for p in zip(*at, strict=True)}  # fmt: skip
    return found


def plain_runs(loop, many=40, ticks=60):
    rng = np.random.default_rng(4)
    for _ in range(many):
        a, b, m = rng.uniform(0, 1 / 8), 0.0, 1
        for _ in range(ticks):
            yield m, a, b
            w = rng.choice([-0.25, 0.5, rng.uniform(-0.25, 0.5)])
            a, b, m = a / 2 + b / 4 + w, b / 2 - a / 4, int(a >= 0)


def test_a_set_that_grows_is_closed_and_holds_every_run():
    loop = spiral()
    growth, cells = grown(loop, (-40, -40), (100, 100))
    held = held_cells(cells)
    assert cells.many == len(held)
    for m, a, b in plain_runs(loop):
        assert ((m,), math.floor(a / SIZE[0]), math.floor(b / SIZE[1])) in held
    for kind in (WholeBoxes, Boxes):
        reach = check_cells(loop, growth.grid, cells, kind)
        assert reach.high["a"] <= growth.reach.high["a"] + F(1, 10**9)
        assert reach.low["b"] >= growth.reach.low["b"] - F(1, 10**9)
        assert reach.high["a"] >= max(F(a) for _, a, _ in plain_runs(loop))
    assert set(cells.modes) == {(0,), (1,)}


def test_a_grid_that_is_too_small_widens_to_the_same_set():
    first, wide = grown(spiral(), (-40, -40), (100, 100))
    for origin, count in (((0, 0), (2, 2)), ((0, -3), (1, 5)), ((-9, -9), (11, 11))):
        growth, cells = grown(spiral(), origin, count)
        assert held_cells(cells) == held_cells(wide)
        assert cells.grid is growth.grid
        assert cells.many == wide.many
        assert growth.reach.low == first.reach.low
        assert growth.reach.high == first.reach.high


def test_a_grid_widens_as_far_as_it_is_let():
    loop = spiral()
    growth = Growth(loop, Grid((0, -1), SIZE, (4, 3)), Work(1), np.array([-3, -40]),
                    np.array([20, 5]))  # fmt: skip
    one, two = growth.cells.number((1,)), growth.cells.number((0,))
    growth.cells.add(one, np.array([0, 4, 11]))
    growth.cells.add(two, np.array([7]))
    before = held_cells(growth.cells)
    assert before == {((1,), 0, -1), ((1,), 1, 0), ((1,), 3, 1), ((0,), 2, 0)}
    pending = [(one, np.array([4, 11])), (two, np.array([7]))]
    moved, left = growth._widened(np.array([-2, 1]), np.array([5, 5]), pending)
    grid = growth.grid
    assert held_cells(growth.cells) == before
    assert list(moved) == [3, 0]  # not beyond the first one, and no more where nothing leaves
    assert grid.origin == (-3, -1)
    assert grid.count == (11, 7)  # to the last one, 5, along the second axis
    assert grid.size == SIZE
    found = {(growth.cells.modes[n], *(int(i[k]) + o for i, o in
              zip(np.unravel_index(p, grid.count), grid.origin, strict=True)))
             for n, p in left for k in range(len(p))}  # fmt: skip
    assert found == {((1,), 1, 0), ((1,), 3, 1), ((0,), 2, 0)}
    for low, high in (((-1, 0), (0, 0)), ((0, 0), (0, 7)), ((0, 0), (24, 0))):
        with pytest.raises(NoProof):
            growth._widened(np.array(low), np.array(high), [])
    moved, _ = growth._widened(np.array([0, 0]), np.array([23, 6]), [])
    assert list(moved) == [0, 0]
    assert growth.grid.count == (24, 7)
    assert held_cells(growth.cells) == before


def test_a_set_gives_up_where_it_takes_too_much(monkeypatch):
    with pytest.raises(NoProof):
        grown(spiral(), (-40, -40), (100, 100), work=10)
    with pytest.raises(NoProof):
        grown(spiral(), (1, 0), (1, 1))  # the start lies outside
    with pytest.raises(NoProof):
        grown(spiral(), (0, 0), (2, 2), last=(6, 60))  # it comes to 8 cells and more
    monkeypatch.setattr(mode_growth, "MOST_CELLS", 30)
    with pytest.raises(NoProof):
        grown(spiral(), (-40, -40), (100, 100))
    monkeypatch.setattr(mode_growth, "MOST_CELLS", 10**6)
    monkeypatch.setattr(mode_growth, "MOST_PLACES", 100)
    with pytest.raises(NoProof):
        grown(spiral(), (0, 0), (2, 2))


def test_work_is_counted_down_to_nothing():
    work = Work(7)
    work.take(3)
    assert work.left == 4
    work.take(4)
    with pytest.raises(NoProof):
        work.take(1)


def test_cells_that_runs_come_to_are_entered_first():
    loop = spiral()
    reals, modes = np.array([[0.13, 0.0], [9.0, 0.0], [-0.01, -0.1]]), np.array([[1], [1], [0]])
    growth = Growth(loop, Grid((-8, -8), SIZE, (16, 16)), Work(10**9), np.array([-40, -40]),
                    np.array([60, 60]))  # fmt: skip
    found = growth._entered(reals, modes)
    assert held_cells(growth.cells) == {((1,), 1, 0), ((0,), -1, -2)}
    assert {growth.cells.modes[n] for n, _ in found} == {(0,), (1,)}
    assert growth._entered(np.array([[9.0, 0.0]]), np.array([[0]])) == []
    growth = Growth(loop, Grid((-40, -40), SIZE, (100, 100)), Work(10**9), np.array([-40, -40]),
                    np.array([60, 60]))  # fmt: skip
    cells = growth.run([(reals[[0, 2]], modes[[0, 2]])])
    assert held_cells(cells) == held_cells(grown(loop, (-40, -40), (100, 100))[1])


def test_what_is_pending_is_taken_in_pieces(monkeypatch):
    """All of it, each place once and with its own mode."""
    monkeypatch.setattr(mode_growth, "CHUNK", 5)
    pending = [(0, np.arange(3)), (1, np.arange(10, 17)), (2, np.arange(0)), (0, np.arange(20, 22))]
    wanted = sorted((n, int(p)) for n, places in pending for p in places)
    left, seen, sizes = pending, [], []
    while left:
        batch, left = _batch(left)
        sizes.append(sum(len(p) for _, p in batch))
        seen += [(n, int(p)) for n, places in batch for p in places]
    assert sorted(seen) == wanted
    assert sizes == [5, 5, 2]
    batch, left = _batch([(1, np.arange(0))])
    assert left == []
    assert [len(p) for _, p in batch] == [0]
    assert batch[0][1].dtype == np.int64


def test_images_of_cells_with_too_many_ways_are_taken_in_parts(monkeypatch):
    loop = spiral(2, kept={"k": (F(-9), F(9))})
    grid = Grid((-8, -8), SIZE, (16, 16))
    places = np.array([3, 40, 100, 130, 200])
    modes = np.array([[0], [1], [1], [0], [1]])
    tick = loop.tick()
    whole = images_of(loop, tick, Boxes, grid, places, modes)

    asked = []

    class Narrow:
        def images(self, kind, ends, modes, push, ticks):
            asked.append(len(modes))
            if len(modes) > 2:
                raise TooManyWays
            return tick.images(kind, ends, modes, push, ticks)

    found = images_of(loop, Narrow(), Boxes, grid, places, modes)
    assert asked == [5, 2, 3, 1, 2]

    def rows(images):
        return sorted(
            (int(c), *(float(b.low[i]) for b in images.reals), *(float(b.high[i]) for b in
             images.reals), int(images.modes[i, 0]))
            for i, c in enumerate(images.cell)
        )  # fmt: skip

    assert rows(found) == rows(whole)
    for name in ("between", "kept"):
        one, two = getattr(found, name), getattr(whole, name)
        parts = one["k"] if name == "kept" else [b for boxes_ in one for b in boxes_]
        all_of = two["k"] if name == "kept" else [b for boxes_ in two for b in boxes_]
        assert sorted(float(v) for b in parts for v in b.low) == sorted(
            float(v) for b in all_of for v in b.low
        )

    class Never:
        def images(self, kind, ends, modes, push, ticks):
            raise TooManyWays

    with pytest.raises(TooManyWays):
        images_of(loop, Never(), Boxes, grid, places, modes)


def test_reach_takes_in_every_tick_of_images():
    loop = spiral()
    for kind, scale in ((Boxes, 1), (WholeBoxes, F(1, ONE))):
        reach = Reach.of(loop)
        assert (reach.low, reach.high) == ({"a": 0, "b": 0}, {"a": F(1, 8), "b": 0})

        def of(*ends, kind=kind):
            pairs = [kind.around(F(a), F(b)) for a, b in ends]
            return kind(np.concatenate([p.low for p in pairs]),
                        np.concatenate([p.high for p in pairs]))  # fmt: skip

        images = Images(
            np.array([0, 1]), [of((1, 2), (3, 4)), of((-1, 0), (0, 0))], np.array([[0], [1]]),
            [[of((-2, 1)), of((0, 1))], [of((0, 5)), of((0, F(1, 2)))]],
            {"k": [of((7, 8)), of((-3, 2))]},
        )  # fmt: skip
        reach.add(loop, images)
        assert reach.low == {"a": -2, "b": -1, "k": -3}
        assert reach.high == {"a": 5, "b": 1, "k": 8}
        assert all(isinstance(v, F) for v in reach.low.values())
        reach.add(loop, Images(np.array([0]), [of((0, 1)), of((0, 2))], np.array([[0]]), [], {}))
        assert reach.low == {"a": -2, "b": -1, "k": -3}
        assert reach.high == {"a": 5, "b": 2, "k": 8}
        assert scale > 0


def test_a_set_with_one_cell_less_is_refused():
    """No cell of the least set may be missing; a mode that is missing neither."""
    loop = spiral()
    growth, cells = grown(loop, (-40, -40), (100, 100))
    for kind in (Boxes, WholeBoxes):
        for n, place in [(k, p) for k in (0, 1) for p in np.flatnonzero(cells.held[k])[::19]]:
            cells.held[n][place] = False
            with pytest.raises(DoesNotHold):
                check_cells(loop, growth.grid, cells, kind)
            cells.held[n][place] = True
        check_cells(loop, growth.grid, cells, kind)
    alone = Cells(growth.grid)
    number = alone.number((1,))
    alone.held[number] = cells.held[cells.numbers[1,]]
    with pytest.raises(DoesNotHold):
        check_cells(loop, growth.grid, alone, Boxes)


@pytest.mark.parametrize("kind", [Boxes, WholeBoxes])
def test_what_is_kept_stays_in_its_range(kind):
    """k = a - b over all cells: within what they reach, and not within less."""
    free = spiral(kept={"k": None})
    growth, cells = grown(free, (-40, -40), (100, 100))
    reach = check_cells(free, growth.grid, cells, kind)
    low, high = reach.low["k"], reach.high["k"]
    assert low < 0 < high
    room = F(1, 10**6)
    for ends, holds in (((low - room, high + room), True), ((low + room, high + room), False),
                        ((low - room, high - room), False)):  # fmt: skip
        loop = spiral(kept={"k": ends})
        if holds:
            check_cells(loop, growth.grid, cells, kind)
            grown(loop, (-40, -40), (100, 100))
        else:
            with pytest.raises(DoesNotHold):
                check_cells(loop, growth.grid, cells, kind)
            with pytest.raises(NoProof):
                grown(loop, (-40, -40), (100, 100))


def test_cells_without_an_image_prove_nothing(monkeypatch):
    loop = spiral()
    growth, cells = grown(loop, (-40, -40), (100, 100))

    def nothing(*_):
        raise ArithmeticError("the root of a negative number")

    monkeypatch.setattr(mode_cells, "images_of", nothing)
    with pytest.raises(DoesNotHold, match="root of a negative"):
        check_cells(loop, growth.grid, cells, Boxes)


def test_a_small_set_is_checked_in_whole_numbers_first(monkeypatch):
    loop = spiral(3)
    _, cells = grown(loop, (-40, -40), (100, 100))
    work = cells.many * len(loop.code.steps) * 3
    for most, kinds in ((work, [WholeBoxes, Boxes]), (work - 1, [Boxes])):
        monkeypatch.setattr(mode_cells, "COARSE_WORK", most)
        assert [kind for kind, _ in ways_to_check(loop, cells)] == kinds


def test_no_ranges_have_no_places():
    none = np.zeros((0, 2), np.int64)
    found = places_in_ranges(none, none, (3, 4))
    assert found.shape == (0,)
    assert found.dtype == np.int64


# ---- runs ----------------------------------------------------------------------------------------


def test_a_run_in_decimals_is_that_of_rationals():
    """After how many ticks it is beyond, and its value there; on either side, or never."""
    loop = spiral()

    def plain(pushes, sign):
        a, b = (F(1, 8) if sign > 0 else F(0)), F(0)
        yield a
        for count, s in pushes:
            for _ in range(count):
                a, b = a / 2 + b / 4 + (F(1, 2) if s > 0 else F(-1, 4)), b / 2 - a / 4
                yield a

    for sign, pushes in ((1, [[3, 1], [4, -1]]), (-1, [[9, -1], [1, 1]])):
        run = {"start": [sign, -1], "pushes": pushes}
        path = list(plain(pushes, sign))
        for bound in (F(1, 4), F(6, 10), F(7, 8), F(-1, 5), F(-3, 10), F(-1, 3)):
            up = bound > 0
            ends = (None, bound) if up else (bound, None)
            beyond = [k for k, x in enumerate(path) if (x > bound if up else x < bound)]
            if beyond:
                ticks, value = mode_runs.replay_run(loop, run, "a", *ends)
                assert ticks == beyond[0]
                assert abs(value - path[ticks]) < F(1, 10**60)
                assert value > bound if up else value < bound
            else:
                with pytest.raises(DoesNotHold):
                    mode_runs.replay_run(loop, run, "a", *ends)
    late = [[5, -1], [3, 1]]
    run = {"start": [1, 1], "pushes": late}
    assert mode_runs.replay_run(loop, run, "a", None, F(1, 2), 8)[0] == [
        x > F(1, 2) for x in plain(late, 1)].index(True)  # fmt: skip
    for wrong in (
        (run, "a", None, F(1, 2), 7), (run, "m", None, F(1, 2)), (run, "k", None, F(1, 2)),
        ({**run, "start": [1]}, "a", None, F(1, 2)), ({**run, "start": [1, 2]}, "a", None, F(1, 2)),
        ({**run, "pushes": [[8, 2]]}, "a", None, F(1, 2)),
        ({**run, "pushes": [[0, 1]]}, "a", None, F(1, 2)),
        ({**run, "pushes": [[8, 1, 1]]}, "a", None, F(1, 2)),
        ({**run, "pushes": [[20_001, 1]]}, "a", None, F(1, 2)),
        ({**run, "pushes": [[20_000, 1], [1, 1]]}, "a", None, F(1, 2)),
    ):  # fmt: skip
        with pytest.raises((DoesNotHold, BadInput)):
            mode_runs.replay_run(loop, *wrong)


def test_a_run_whose_mode_is_not_decided_refutes_nothing():
    """A threshold that a third comes to: in decimals both answers stay possible."""
    names = ("x_a", "x_m", "d_w")
    steps = (("const", F(3)), ("div", 0, 3), ("add", 4, 2), ("mul", 4, 3), ("const", F(1)),
             ("less", 6, 7))  # fmt: skip
    code = TickCode(names, steps, {"a": 5, "m": 8})
    loop = ModeLoop(code, ("a",), ("m",), ((F(1), F(1)),), (0,), {"w": (F(0), F(9))}, ("a",))
    with pytest.raises(DoesNotHold):
        mode_runs.replay_run(loop, {"start": [1], "pushes": [[3, 1]]}, "a", None, F(2))
    other = ModeLoop(code, ("a",), ("m",), ((F(2), F(2)),), (0,), {"w": (F(0), F(9))}, ("a",))
    ticks, value = mode_runs.replay_run(other, {"start": [1], "pushes": [[3, 1]]}, "a", None, F(2))
    assert ticks == 1
    assert abs(value - (F(2, 3) + 9)) < F(1, 10**60)


def test_runs_that_are_no_numbers_any_more_are_over():
    """A root that some runs lose: what they came to before stays, the others go on."""
    code = code_of({"a": lambda a, w: ca.sqrt(a + w)}, ["x_a", "d_w"])
    loop = ModeLoop(code, ("a",), (), ((F(1), F(4)),), (), {"w": (F(-2), F(1))}, ("a",))
    search = mode_runs._Search(loop, 3, 0)
    starts = np.array([[1], [-1], [1]])
    signs = np.array([[[1], [1], [1]], [[-1], [1], [1]], [[-1], [-1], [1]]], np.int8)
    low, high = search.runs(starts, signs)
    first = [4, math.sqrt(5), math.sqrt(math.sqrt(5) + 1)]
    first.append(math.sqrt(first[-1] + 1))
    assert low[0] == pytest.approx([min(first), 1, math.sqrt(2)])
    assert high[0] == pytest.approx([4, 1, 4])
    assert search.lowest == pytest.approx([1])
    assert search.highest == pytest.approx([4])
    assert [len(reals) for reals, _ in search.visited] == [2, 1, 1]
    search = mode_runs._Search(loop, 3, 0)
    low, high = search.runs(starts[1:2], signs[1:2])
    assert (low[0], high[0]) == ([1], [1])
    assert search.visited == []


# ---- what a tick may use -------------------------------------------------------------------------


def scaled(value, gain=0.5, *, offset=0):
    """A function that a tick may use."""
    return gain * value + offset


NOTES = ["a list"]


def with_list(value):
    """It looks at what may change."""
    return value * len(NOTES)


def unset():
    """A function whose name of an outer one has no value."""

    def tick(n, x, d):
        return {"x": x["x"] * later}

    if NOTES is None:
        later = 1
    return tick


GOOD = [
    partial(scaled, gain=0.25), partial(scaled, 1, offset=F(1, 2)), (1, 2.0, "a", None, (F(1),)),
    frozenset({1, 2}), scaled, lambda n, x, d: {"x": scaled(x["x"])}, sgn, abs, F,
    lambda n, x, d, table=(1, (2, 3)): {"x": x["x"] * table[0]},
    lambda n, x, d: {"x": math.pi * x["x"]}, lambda n, x, d: {"x": max(v for v in x.values())},
]  # fmt: skip

BAD = [
    partial(with_list), partial(scaled, gain=[1]), partial(print), partial(scaled, NOTES),
    (1, [2]), (1, (2, {})), frozenset({print}), with_list, print, [1], {}, np.float64(1), object(),
    1j, b"a", unset(), lambda n, x, d: {"x": never},  # noqa: F821
    lambda n, x, d, table=(1, [2]): {"x": x["x"]}, lambda n, x, d, *, k=NOTES: {"x": x["x"]},
    lambda n, x, d: {"x": with_list(x["x"])}, lambda n, x, d: {"x": math.floor(x["x"])},
    lambda n, x, d: {"x": np.abs(x["x"])}, lambda n, x, d: {"x": open("a")},  # noqa: SIM115
    lambda n, x, d: {"x": x["x"].numerator}, math, lambda n, x, d: {"x": math},
]  # fmt: skip


@pytest.mark.parametrize("given", GOOD, ids=range(len(GOOD)))
def test_numbers_and_functions_of_numbers_may_be_used(given):
    assert tick_source._inspect(given, "the tick", set()) is None


@pytest.mark.parametrize("given", BAD, ids=range(len(BAD)))
def test_what_may_change_or_is_not_known_may_not_be_used(given):
    with pytest.raises(BadInput):
        tick_source._inspect(given, "the tick", set())


def test_a_function_that_calls_itself_is_looked_at_once():
    def odd(k):
        return even(k - 1)

    def even(k):
        return odd(k - 1)

    seen: set[int] = set()
    tick_source._inspect(odd, "the tick", seen)
    assert seen == {id(odd), id(even)}


GROUPS = ((), ("x",), ("w",))


def test_each_way_through_a_tick_is_read_once():
    """Questions in questions: eight ways, and the one that a run takes."""

    def tick(n, x, d):
        at = x["x"]
        if at > 2:
            return {"x": at - 2 if d["w"] > 0 else at - 1}
        if at < -2:
            return {"x": at + (3 if d["w"] > 0 else 4)}
        return {"x": 0 if at else 5}

    code = code_of_tick(tick, GROUPS, ("x",))
    for x, w in product((F(-7, 2), F(-2), F(0), F(1), F(2), F(3)), (F(-1), F(0), F(1))):
        (low, high) = enclosure(code, (x, w))["x"]
        assert low == high == tick({}, {"x": x}, {"w": w})["x"]


def test_a_tick_gives_its_states_and_no_other():
    for tick in (
        lambda n, x, d: {"x": x["x"], "y": x["x"]}, lambda n, x, d: {},
        lambda n, x, d: {"x": "a"}, lambda n, x, d: {"x": None}, lambda n, x, d: x["x"],
        lambda n, x, d: {"x": x["x"] ** 17}, lambda n, x, d: {"x": x["x"] ** -1},
        lambda n, x, d: {"x": x["x"] ** x["x"]}, lambda n, x, d: {"x": x["x"] ** True},
        lambda n, x, d: {"x": pow(x["x"], 2, 3)}, lambda n, x, d: {"x": x["never"]},
    ):  # fmt: skip
        with pytest.raises(BadInput):
            code_of_tick(tick, GROUPS, ("x",))
    powers = code_of_tick(lambda n, x, d: {"x": x["x"] ** 5 + d["w"] ** 0}, GROUPS, ("x",))
    assert enclosure(powers, (F(3, 2), F(7)))["x"] == (F(3, 2) ** 5 + 1,) * 2


def test_a_loop_that_never_ends_is_refused(monkeypatch):
    monkeypatch.setattr(tick_source, "MOST_QUESTIONS", 300)
    monkeypatch.setattr(tick_source, "MOST_PATHS", 20)

    def never(n, x, d):
        at = x["x"]
        while at > 0:
            at = at + 1
        return {"x": at}

    def many(n, x, d):
        return {"x": sum(1 if x["x"] > k else 0 for k in range(30))}

    for tick in (never, many):
        with pytest.raises(BadInput):
            code_of_tick(tick, GROUPS, ("x",))


def test_a_tick_that_keeps_what_it_was_asked_is_noticed():
    """Another question where it is called again; of ways that differ in depth too."""
    writer = CodeWriter(["a", "b"])
    joined = tick_source._joined
    ways = [([(0, True)], {"y": 0}), ([(0, False)], {"y": 1})]
    at = joined(writer, ways, "y")
    assert writer.steps[at - 2] == ("choose", 0, 0, 1)
    same = [([(0, True)], {"y": 1}), ([(0, False)], {"y": 1})]
    assert joined(writer, same, "y") == 1
    assert joined(writer, [([], {"y": 1})], "y") == 1
    for wrong in ([([(0, True)], {"y": 0}), ([(1, False)], {"y": 1})],
                  [([(0, True)], {"y": 0}), ([], {"y": 1})], [([(0, True)], {"y": 0})],
                  [([(0, True), (1, True)], {"y": 0}), ([(0, False)], {"y": 1})]):  # fmt: skip
        with pytest.raises(BadInput):
            joined(writer, wrong, "y")


def test_ranges_of_a_loop_are_its_numbers_or_their_opposites():
    n = {"a": F(1, 2), "b": F(3), "k": F(7)}
    assert tick_sets._range("a", n) == (F(-1, 2), F(1, 2))
    assert tick_sets._range(("a", "b"), n) == (F(1, 2), F(3))
    assert tick_sets._range(("a", "a"), n) == (F(1, 2), F(1, 2))
    with pytest.raises(BadInput):
        tick_sets._range(("b", "a"), n)


def test_a_loop_is_asked_for_whole_ticks():
    loop = tick_sets.Loop(lambda n, x, d: x, {"x": "a"}, {}, {"x": "b"}, within="k")
    assert loop.ticks({"k": F(7)}, 100) == 7
    assert loop.ticks({"k": F(700)}, 100) == 100
    for wrong in (F(0), F(-1), F(1, 2), F(3, 2)):
        with pytest.raises(BadInput):
            loop.ticks({"k": wrong}, 100)
    forever = tick_sets.Loop(lambda n, x, d: x, {"x": "a"}, {}, {"x": "b"})
    assert forever.ticks({}, 100) == 100


def test_a_sum_of_other_numbers_or_a_wider_box_is_refused():
    loop = tick_sets.Loop(lambda n, x, d: {"x": n["g"] * x["x"] + d["w"]}, {"x": "a"}, {"w": "W"},
                          {"x": "b"})  # fmt: skip
    n = {"g": F(1, 2), "a": F(1), "W": F(1, 8), "b": F(2)}
    sampled, cell, bounds = loop.sampled(n)
    assert (sampled.states, sampled.pushes, sampled.slow) == (("x",), ("w",), tuple(n))
    assert cell.slow == tuple((v, v) for v in n.values())
    assert (bounds.push, bounds.start) == ((F(1, 8),), (F(1),))
    loop._keeps(n, cell, [F(2)])
    for found, most in ((cell, [F(2) + F(1, 10**9)]),
                        (Cell(cell.slow, (F(1),), cell.moves), [F(1)]),
                        (loop.sampled({**n, "g": F(1, 3)})[1], [F(1)])):  # fmt: skip
        with pytest.raises(DoesNotHold):
            loop._keeps(n, found, most)
    evidence = loop.criteria(n)["sums"].evidence
    entry = evidence.find(n)
    evidence.check(n, entry)
    for name, value in (("b", F(5, 4)), ("W", F(1)), ("a", F(3)), ("g", F(3, 4))):
        with pytest.raises((DoesNotHold, BadInput)):
            evidence.check({**n, name: value}, entry)
    assert evidence.find({k: v for k, v in n.items() if k != "b"}) is None
    assert evidence.find({**n, "b": F(9, 8)}) is None
