"""What the analyses refuse, each by a line that says what was asked of which block."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    RunFailed,
    State,
    argmax,
    argmax_block,
    argmax_table,
    flow,
    from_text,
    law,
    luenberger,
    operating_point,
)
from slipctl.analysis.bounds import enclosure, fastest, largest_slope

HUMP = from_text("mu = c*x*exp(-x)/(1 + w) where x [1], w [1], c = 2")
FLAT = from_text("mu = 0*x + 1 where x [1]")
TWINS = from_text("mu = -(x**2 - 1)**2 where x [1]")
BARE = from_text("mu = c*x where x [1]", parameters={"c": {"value": "1"}})


@law(y=Output("1", "out", shape=(2,)))
def rows(x=Input("1", "in", shape=(2,))):
    return x


@law(y=Output("1", "out"))
def named_so(x=Input("1", "in"), hi=Param("1", 2.0, "taken")):
    return -(x**2) * hi


@flow(y=Output("1", "out"))
def tank(x=State("1", 0.0, "level"), z=State("1", 0.0, "other"), a=Input("1/s", "in")):
    return {"x": a - x / 1.0, "z": a - z / 1.0}, {"y": x}


@flow(y=Output("1", "out", shape=(2,)))
def wide(x=State("1", (0.0, 0.0), "levels", shape=(2,)), a=Input("1/s", "in")):
    return {"x": a * np.ones(2)}, {"y": x}


@flow()
def dry(x=State("1", 0.0, "level")):
    return {"x": -x / 1.0}, {}


REFUSED = {
    "method": (lambda: largest_slope(HUMP, "mu", "x", {"x": (0, 1)}, method="gird", w=0.0),
               "largest_slope has no method 'gird'; did you mean 'grid'"),
    "signal": (lambda: largest_slope(HUMP, "mu", "x", {"x": (0, 1), "q": (0, 1)}, w=0.0),
               "has no signal 'q'"),
    "no value": (lambda: largest_slope(HUMP, "mu", "x", {"x": (0, 1)}),
                 "give a value or a range of w"),
    "no conditions": (lambda: argmax_table(HUMP, "x", by="w", span=(0, 1), lo=0, hi=3),
                      "has no conditions; give conditions="),
    "a condition's name": (
        lambda: argmax_table(HUMP, "x", by="w", span=(0, 1), lo=0, hi=3, conditions={"a b": {}}),
        "condition 'a b' is no name"),
    "by itself": (
        lambda: argmax_table(HUMP, "x", by="x", span=(0, 1), lo=0, hi=3, conditions={"a": {}}),
        "has no other input 'x'"),
    "by nothing": (
        lambda: argmax_table(HUMP, "x", by="v", span=(0, 1), lo=0, hi=3, conditions={"a": {}}),
        "has no other input 'v'"),
    "empty": (lambda: argmax(HUMP, "x", lo=1, hi=1, at={"w": 0}), r"argmax\(law\)"),
    "over nothing": (lambda: argmax(HUMP, "q", lo=0, hi=1), "has no input 'q'"),
    "maximise nothing": (lambda: argmax(HUMP, "x", "nu", lo=0, hi=1), "has no output 'nu'; it has"),
    "maximise what": (
        lambda: argmax(from_text("a = x; b = x where x [1]"), "x", lo=0, hi=1),
        "give maximise=, one of a, b"),
    "no law": (lambda: argmax(tank, "a", lo=0, hi=1), "only a law of scalar expressions"),
    "rows": (lambda: argmax(rows, "x", lo=0, hi=1), "must be scalars|only a law of scalar"),
    "NaN": (lambda: argmax(from_text("y = log(x) where x [1]"), "x", lo=-2, hi=-1),
            "is NaN all over -2 to -1; give another range"),
    "a name of the search": (lambda: argmax_block(named_so, "x", lo=-1, hi=1),
                             "named_so.hi is a name of the search itself; rename it"),
    "observer of a law": (lambda: luenberger(HUMP, poles=[-1]), "only a flow with states"),
    "observer of rows": (lambda: luenberger(wide, [-1, -2], measured="x"), "must be scalars"),
    "observer of nothing": (lambda: luenberger(tank, [-1, -2], measured="q"), "has no signal 'q'"),
    "observer without": (lambda: luenberger(dry, poles=[-1]),
                         "give measured=, states or outputs of dry"),
    "too many": (lambda: operating_point(tank, free=["x"], steady=["x", "z"]),
                 "1 unknowns .x. and 2 equations"),
    "fixed nothing": (lambda: operating_point(tank, {"q": 1}, free=["a"], steady=["x"]),
                      "has no .*'q'"),
    "fixed and free": (lambda: operating_point(tank, {"x": 1}, free=["x"]), "both fixed and free"),
    "a law": (lambda: operating_point(HUMP), "it has no state that could stand still"),
    "one value": (lambda: fastest(np.zeros(1), np.zeros(1)), "needs two values or more"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_is_refused(case: str) -> None:
    call, said = REFUSED[case]
    with pytest.raises(BadInput, match=said):
        call()


def test_equations_that_have_no_one_answer_say_why():
    both = flow(name="both")(
        lambda x=State("1", 0.0, "x"), a=Input("1/s", "a"), b=Input("1/s", "b"):
        ({"x": a + b}, {})
    )  # fmt: skip
    twice = flow(name="twice", y=Output("1/s", "y"))(
        lambda x=State("1", 0.0, "x"), a=Input("1/s", "a", value=0.0),
        b=Input("1/s", "b", value=0.0): ({"x": a + b}, {"y": a + b})
    )  # fmt: skip
    with pytest.raises(RunFailed, match="rate of x does not depend on what is free"):
        operating_point(tank, free=["z"], steady=["x"], fixed={"a": 1.0})
    with pytest.raises(RunFailed, match="do not tell the unknowns apart"):
        operating_point(twice, free=["a", "b"], steady=["x"], fixed={"y": 1.0})
    with pytest.raises(BadInput, match=r"2 unknowns .a, b. and 1 equations .rate of x = 0."):
        operating_point(both, free=["a", "b"], steady=["x"])


def test_a_peak_is_proven_or_not_told():
    """x exp(-x) has its only peak at 1; of a flat top or of twins none can be shown."""
    peak = argmax(HUMP, "x", lo=0.0, hi=8.0, at={"w": 0.0}, proven=True)
    assert (peak.method, peak.location) == ("proven", pytest.approx(1.0, rel=1e-14))
    assert peak.value == pytest.approx(2 / math.e, rel=1e-14)
    assert peak.bracket[0] < 1.0 < peak.bracket[1]
    rising = argmax(HUMP, "x", lo=0.0, hi=0.5, at={"w": 0.0}, proven=True)
    falling = argmax(HUMP, "x", lo=2.0, hi=3.0, at={"w": 0.0}, proven=True)
    assert (rising.location, falling.location) == (0.5, 2.0)
    assert (rising.method, falling.bracket) == ("bound", (2.0, 2.0))
    for of in (FLAT, TWINS):
        with pytest.raises(RunFailed, match="no single peak can be proven in -2 to 2"):
            argmax(of, "x", lo=-2.0, hi=2.0, proven=True)


def test_the_grid_bounds_what_the_boxes_bound():
    """Both methods hold the steepest slope of sin, 1, from above, and find it within their gap."""
    wave = from_text("y = sin(x) where x [1]")
    boxes = largest_slope(wave, "y", "x", {"x": (-1.0, 2.0)})
    grid = largest_slope(wave, "y", "x", {"x": (-1.0, 2.0)}, method="grid", cells=300)
    for bound in (boxes, grid):
        assert bound.reached <= 1.0 <= bound.value
    assert boxes.value <= 1.002
    assert grid.value <= 1.0 + 3.0 / 300 / 2  # half a cell times the largest curvature, 1
    low, high = enclosure(wave, "y", {"x": (0.0, 2.0)})
    assert low <= 0.0 < 1.0 <= high <= 1.01
    assert low >= -0.01


def test_the_fastest_rate_of_a_log():
    """The largest difference over the period, without those at an event."""
    t = 0.1 * np.arange(200)
    y = np.where(t < 10, np.sin(t), np.sin(t) + 5)
    assert fastest(t, y).reached == pytest.approx(5 / 0.1, rel=0.02)
    calm = fastest(t, y, apart=[10.0], within=0.25)
    assert calm.reached == pytest.approx(1.0, rel=0.01)
    assert calm.value >= calm.reached
