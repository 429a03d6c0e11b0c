"""The reference optimum: closed form, Newton with a bracket, and the law for online use."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput, Input, Output, Param, argmax, argmax_block, law, step
from slipctl.analysis.optimum import GRID
from slipctl.models.huang_2020.subway_braking import TABLE_1, double_exponential, peak_slip
from slipctl.run import build

RANGE = {"lo": 0.01, "hi": 10.0}
CURVES = st.fixed_dictionaries(
    {"c": st.floats(0.02, 1), "a": st.floats(0.2, 0.6), "b": st.floats(0.8, 2)}
)


@law(y=Output("1", "height"))
def two_peaks(
    x=Input("1", "argument"),
    other=Input("1", "height of the peak at -2", value=0.9),
    width=Param("1", 0.3, "of both peaks", lo=1e-3),
    double=Param("1", "2 * width", "derived, here to be computed along"),
):
    """Two bells, at -2 and at 1; the one at 1 has height 1."""
    w2 = width * double / 2
    return other * ca.exp(-((x + 2) ** 2) / w2) + ca.exp(-((x - 1) ** 2) / w2)


@law(y=Output("1", "height"))
def root(x=Input("1", "argument"), edge=Param("1", 1.0)):
    """NaN below the edge: sqrt(x - edge) - (x - edge), peak at edge + 1/4."""
    return ca.sqrt(x - edge) - (x - edge)


@law(y=Output("1", "height"), z=Output("1", "depth"))
def valley(x=Input("1", "argument"), w=Input("1", "second argument"), k=Param("1", 3.0)):
    """Rosenbrock's valley, and the same upside down."""
    depth = (1 - x) ** 2 + k * (w - x**2) ** 2
    return {"y": -depth, "z": depth}


# ---- one input -----------------------------------------------------------------------------------


@given(CURVES)
def test_closed_form_and_newton_agree(curve):
    closed = argmax(double_exponential, "v_s", at=curve, **RANGE)
    newton = argmax(double_exponential, "v_s", at=curve, closed_form=False, **RANGE)
    assert closed.method == "closed form"
    assert newton.method == "newton"
    assert closed.location == float(peak_slip(**curve))
    # both are roots of the same derivative, known to its rounding over its slope
    assert abs(closed.location - newton.location) < 1e-13
    assert closed.value == pytest.approx(newton.value, rel=1e-15)


@given(CURVES, st.booleans())
def test_the_derivative_changes_sign_over_the_bracket(curve, closed_form):
    peak = argmax(double_exponential, "v_s", at=curve, closed_form=closed_form, **RANGE)
    slope = double_exponential.jacobian("mu", "v_s")

    def at(place: float) -> float:
        return float(slope(u_v_s=place, **{f"p_{k}": v for k, v in curve.items()})["J"])

    a, b = peak.bracket
    assert a <= peak.location <= b
    assert b - a < 1e-12
    assert at(a) > 0 > at(b)


def test_a_closed_form_that_is_no_peak_is_left_aside():
    # with a > b the formula gives the lowest point of a curve that is negative all over
    turned = dict(c=1.0, a=1.2, b=0.54)
    peak = argmax(double_exponential, "v_s", at=turned, **RANGE)
    assert (peak.location, peak.method) == (10.0, "bound")


@pytest.mark.parametrize(("lo", "hi", "end"), [(2.0, 10.0, 2.0), (0.01, 0.5, 0.5)])
def test_peak_at_the_end_of_the_range(lo, hi, end):
    peak = argmax(double_exponential, "v_s", lo=lo, hi=hi)
    assert peak.location == end
    assert peak.bracket == (end, end)
    assert peak.method == "bound"


@given(st.floats(0.5, 1.5), st.floats(0.05, 0.5))
def test_the_highest_of_several_peaks(other, width):
    # bells 3 apart and at most 0.5 wide: the tail of one moves the other by less than 1e-12
    peak = argmax(two_peaks, "x", lo=-5, hi=5, at={"other": other, "width": width})
    assert peak.location == pytest.approx(-2 if other > 1 else 1, abs=1e-9)
    assert peak.value == pytest.approx(max(other, 1), rel=1e-12)


def test_the_higher_peak_may_have_the_lower_point_on_the_grid():
    # a grid point hits the lower bell; the higher one lies in the middle between two
    step = 3 / 20.5
    lo = -2 - 50 * step
    on_grid = lo + step * np.arange(GRID + 1)
    at = {"other": 0.9, "width": 0.15}
    heights = [two_peaks(x=x, **at)["y"] for x in on_grid]
    assert on_grid[int(np.argmax(heights))] == pytest.approx(-2)
    found = argmax(two_peaks, "x", lo=on_grid[0], hi=on_grid[-1], at=at)
    assert found.location == pytest.approx(1, abs=1e-9)


@law(y=Output("1", "height"))
def needle(
    x=Input("1", "argument"), at=Param("1", 0.0), side=Param("1", 1.0), slope=Param("1", 1.0)
):
    """A bell of height 1, and a ramp that ends at 1 with a height of slope; side -1 mirrors it."""
    z = side * x
    return ca.exp(-(((z - at) / 0.004) ** 2)) + slope * ca.fmax(0, 2 * z - 1)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("cell", [0, 60, GRID // 4])
def test_a_peak_between_points_beats_an_end_that_stands_higher_on_the_grid(side, cell):
    """A third of a cell off a point the bell shows exp(-0.17) there; the end, a peak too, shows .9.

    In the first cell the bell's point is the end of the range itself, where the law rises still.
    """
    h = 1.0 / GRID
    at = cell * h + h / 3
    lo, hi = sorted((0.0, side))
    found = argmax(needle, "x", lo=lo, hi=hi, at={"at": at, "side": side, "slope": 0.9})
    assert found.location == pytest.approx(side * at, abs=1e-9)
    assert (found.method, found.value) == ("newton", pytest.approx(1.0, rel=1e-12))
    end = argmax(needle, "x", lo=lo, hi=hi, at={"at": at, "side": side, "slope": 1.1})
    assert (end.location, end.method) == (side, "bound")
    assert end.value == pytest.approx(1.1, rel=1e-12)


def test_where_the_law_is_nan_there_is_no_peak():
    assert argmax(root, "x", lo=-3, hi=3).location == pytest.approx(1.25, abs=1e-12)


def test_values_of_the_law_are_used_unless_given():
    rail = TABLE_1["wet"]
    wet = argmax(double_exponential, "v_s", at=rail, **RANGE)
    assert wet == argmax(double_exponential.with_params(**rail), "v_s", **RANGE)
    assert argmax(two_peaks, "x", lo=-5, hi=-1).value == pytest.approx(0.9)


# ---- as a block ----------------------------------------------------------------------------------


@given(CURVES)
def test_block_finds_the_peak(curve):
    found = ONLINE(**curve)
    true = float(peak_slip(**curve))
    # a grid step of 0.32 m/s, then six steps of Newton
    assert abs(found["best"] - true) < 1e-9
    assert found["value"] == pytest.approx(float(double_exponential(v_s=true, **curve)["mu"]))


ONLINE = argmax_block(double_exponential, "v_s", **RANGE)


@pytest.mark.parametrize(("lo", "hi", "end"), [(2.0, 10.0, 2.0), (0.01, 0.5, 0.5)])
def test_block_stays_in_the_range(lo, hi, end):
    block = argmax_block(double_exponential, "v_s", lo=lo, hi=hi, newton=30)
    best = block(**TABLE_1["dry"])["best"]
    assert lo <= best <= hi
    assert abs(best - end) < 1e-6


def test_block_gives_the_same_bits_compiled(needs_compiler):
    rows = np.random.default_rng(1).uniform([0.02, 0.2, 0.8], [1.0, 0.6, 2.0], (50, 3))
    f = ONLINE.f
    p = np.array(ca.DM(ONLINE.pack("param", ONLINE.param_values())).full()).ravel()
    logs = []
    for run in (build.compile_roller(f).roll, lambda *a: build.roll_interpreted(f, *a)):
        y = np.empty((len(rows), 2))
        run(np.empty(0), rows, p, np.empty((len(rows), 0)), y)
        logs.append(y.tobytes())
    assert logs[0] == logs[1]


# ---- refusals ------------------------------------------------------------------------------------


@step(y=Output("1", "state"))
def no_law(x=Input("1", "argument")):
    return {}, {"y": x}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: argmax(valley, "v", "y", lo=0, hi=1), "argmax(valley) has no input 'v'"),
        (lambda: argmax(valley, "x", lo=0, hi=1), "give maximise=, one of y, z"),
        (lambda: argmax(valley, "x", "y", lo=0, hi=1), "give at={'w': ...} in 1"),
        (lambda: argmax(valley, "x", "y", lo=0, hi=1, at={"q": 1}), "no input or parameter 'q'"),
        (lambda: argmax(double_exponential, "v_s", lo=1, hi=1), "range 1 to 1 is none"),
        (lambda: argmax(double_exponential, "v_s", lo=0, hi=math.nan), "range 0 to nan is none"),
        (lambda: argmax(double_exponential, "v_s", lo="0", hi=1), "is '0'; give numbers, lo < hi"),
        (lambda: argmax("burckhardt", "v_s", lo=0, hi=1), "the law is no block but of type str"),
        (lambda: argmax(double_exponential, "v_s", at={"c": -1}, **RANGE), "out of range"),
        (lambda: argmax(root, "x", lo=-3, hi=-2), "is NaN all over -3 to -2"),
        (lambda: argmax(no_law, "x", lo=0, hi=1), "only a law of scalar expressions"),
        (lambda: argmax_block(double_exponential, "v_s", points=2, **RANGE), "points = 2 must be"),
        (lambda: argmax_block(double_exponential, "v_s", lo=3, hi=2), "range 3 to 2 is none"),
    ],
)
def test_refused_in_one_line(call, words):
    with pytest.raises(BadInput) as error:
        call()
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_block_of_the_closed_form() -> None:
    block = argmax_block(double_exponential, "v_s", **RANGE, closed_form=True)
    searched = argmax_block(double_exponential, "v_s", **RANGE)
    for rail in double_exponential.conditions.values():
        assert block(**rail)["best"] == pytest.approx(searched(**rail)["best"], rel=1e-9)
    # in the range, where the peak is beyond it
    assert block(c=1.0, a=1e-4, b=2e-4)["best"] == RANGE["hi"]
    with pytest.raises(BadInput, match="declares no closed form of its peak"):
        argmax_block(open_ended, "u", lo=0.0, hi=1.0, closed_form=True)


@law(y=Output("1"))
def open_ended(u=Input("1")):
    """No closed form."""
    return -((u - 0.5) ** 2)
