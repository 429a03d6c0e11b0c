"""What a panel shows of several axles, where an axle meets the rail, and maps of regions."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection

from slipctl import BadInput, Signals
from slipctl.draw import panels, regions

TIME = np.array([0.0, 0.5, 1.0, 1.5])


def log(**signals) -> xr.Dataset:
    """Signals of a run by name with _ for the dot: an array, and its unit."""
    found = {}
    for name, (values, unit) in signals.items():
        values = np.asarray(values, float)
        dims = ("time", "axle")[: values.ndim]
        found[name.replace("_", ".", 1)] = (
            dims, values, {"units": unit, "long_name": f"meaning of {name}, told"}
        )  # fmt: skip
    return xr.Dataset(found, {"time": TIME}, {"parameters": json.dumps({})})


def results(**roles) -> SimpleNamespace:
    return SimpleNamespace(study=SimpleNamespace(signals=Signals(**roles)))


SLIPS = np.array([[0.0, 0.0, 0.0], [1.0, -5.0, 2.0], [1.0, 1.0, 5.0], [0.0, 0.0, 0.0]])


@settings(max_examples=8)
@given(st.integers(0, 2), st.sampled_from([None, (0.5, 1.0), (0.0, 0.5), (1.0, 9.0)]))
def test_samples_are_those_of_the_axle_in_the_span(axle, span) -> None:
    """Ends belong to a span; an axle beyond the last one is the last one."""
    run = log(car_slip=(SLIPS, "m/s"), car_T=(TIME, "N m"))
    t, y = panels.samples(run, "car.slip", span, axle)
    inside = [k for k, at in enumerate(TIME) if span is None or span[0] <= at <= span[1]]
    assert list(t) == list(TIME[inside])
    factor = y[np.argmax(abs(y))] / SLIPS[inside, axle][np.argmax(abs(SLIPS[inside, axle]))]
    assert factor > 0
    assert y == pytest.approx(factor * SLIPS[inside, axle])
    _, worst = panels.samples(run, "car.slip", span)
    assert abs(worst) == pytest.approx(factor * abs(SLIPS[inside]).max(axis=1))
    _, last = panels.samples(run, "car.slip", span, 7)
    assert last == pytest.approx(factor * SLIPS[inside, 2])
    every = panels.each_axle(run, "car.slip", span)
    assert every is not None
    assert every[:, axle] == pytest.approx(y)
    assert every.shape == (len(inside), 3)
    assert panels.each_axle(run, "car.T", span) is None
    assert panels.each_axle(log(car_T=(TIME[:, None], "N m")), "car.T", span) is None


def test_a_signal_of_the_driven_axles_is_shown_at_their_places() -> None:
    """Axles 2 and 3 of three have a torque: the first one only rolls, and has none."""
    torque = np.stack([10 * TIME, 20 * TIME], axis=1)
    run = log(car_slip=(SLIPS, "m/s")).assign({"car.T": (("time", "two"), torque, {"units": "m"})})
    asked = results(slip="car.slip", axles=(1, 2))
    assert panels.samples(run, "car.T", None, 2, (1, 2))[1] == pytest.approx(20 * TIME)
    every = panels.each_axle(run, "car.T", None, (1, 2))
    assert every is not None
    assert np.isnan(every[:, 0]).all()
    assert every[:, 1:] == pytest.approx(torque)
    panel = panels.make_panel(asked, "base", {"a": run}, "car.T", None, 1)
    assert panel.curves["a"][1] == pytest.approx(10 * TIME)
    assert panels.each_axle(run, "car.slip", None, (1, 2)).shape == (4, 3)
    assert panels.chosen_axle(results(axles=(1, 2)), {"a": run}, ["car.T"]) == 2


def test_the_axle_that_slips_most_in_any_run_is_shown() -> None:
    """The first of those that slip alike; without a slip, the first signal of several axles."""
    one, two = log(car_slip=(SLIPS, "m/s")), log(car_slip=(SLIPS[:, [1, 0, 0]], "m/s"))
    asked = results(slip="car.slip")
    assert panels.chosen_axle(asked, {"a": one}, ["car.slip"]) == 1  # -5 before 5
    assert panels.chosen_axle(asked, {"a": two}, ["car.slip"]) == 0
    assert panels.chosen_axle(asked, {"a": one, "b": two}, [("slip", "car.T")]) == 0
    more = log(car_slip=(3 * SLIPS[:, [0, 2, 1]], "m/s"))
    assert panels.chosen_axle(asked, {"a": one, "b": more}, ["car.slip"]) == 1
    third = log(car_slip=(SLIPS * [1, 0.1, 1], "m/s"))
    assert panels.chosen_axle(asked, {"a": third}, ["car.slip"]) == 2
    plain = log(car_slip=(SLIPS[:, 0], "m/s"))
    assert panels.chosen_axle(asked, {"a": plain}, ["car.slip"]) is None
    force = log(car_F=(SLIPS[:, [2, 0, 0]], "N"))
    assert panels.chosen_axle(results(), {"a": force}, ["car.F"]) == 0


def test_an_axle_comes_to_a_place_as_far_behind_as_it_is() -> None:
    """The first sample at or beyond it; places that it never reaches are left out."""
    way = np.array([0.0, 5.0, 10.0, 15.0])
    run = log(car_x=(way, "m"))
    asked = results(position="car.x")
    assert panels.arrivals(asked, run, [0.0, 5.0, 6.0, 40.0], 0) == [0.0, 0.5, 1.0]
    run.attrs["parameters"] = json.dumps({"car.behind": {"value": [0.0, 4.0]}})
    assert panels.arrivals(asked, run, [5.0, 11.0], 0) == [0.5, 1.5]
    assert panels.arrivals(asked, run, [5.0, 11.0, 12.0], 1) == [1.0, 1.5]
    assert panels.arrivals(asked, run, [5.0], 9) == [1.0]  # as the last one
    assert panels.arrivals(results(), run, [0.0], 0) is None
    both = log(car_x=(np.column_stack([way, 2 * way]), "m"))
    assert panels.arrivals(asked, both, [10.0], 0) == [1.0]


def test_a_panel_says_what_it_shows() -> None:
    """Of each loop its curve and its share of the variation; a role has the name of its signal."""
    logs = {"a": log(car_slip=(SLIPS, "m/s")), "b": log(car_slip=(SLIPS / 2, "m/s")),
            "c": log(car_T=(TIME, "N m"))}  # fmt: skip
    asked = results(slip="car.slip")
    panel = panels.make_panel(asked, "base", logs, ["slip", "car.T"], None, 2)
    assert (panel.first, panel.others, list(panel.curves)) == ("slip", ["car.T"], ["a", "b"])
    assert panel.rough == {"a": 1.0, "b": 0.5}
    assert panel.text == "meaning of car_slip"
    assert panel.unit == "m/s"
    assert panel.curves["a"][1] == pytest.approx(2 * panel.curves["b"][1])
    assert panel.curves["a"][1] == pytest.approx(panel.axles["a"][:, 2])
    assert set(panel.axles) == {"a", "b"}
    still = panels.make_panel(asked, "base", {"a": log(car_T=(0 * TIME, "N m"))}, "car.T", None)
    assert still.rough == {"a": 0.0}
    assert not still.axles
    with pytest.raises(BadInput, match=r"no loop of base logs 'car\.slp'.*car\.slip"):
        panels.make_panel(asked, "base", logs, "car.slp", None)
    made = logs["c"]
    made["car.T"].attrs["long_name"] = "signal with three parts"
    assert panels.make_panel(asked, "base", {"c": made}, "car.T", None).text == "car.T"


# ---- maps of regions -----------------------------------------------------------------------------


@given(st.floats(-3, 3), st.floats(0, 4))
def test_level_lines_are_by_ratio_where_a_quantity_spans_decades(first, decades) -> None:
    """1, 2, 5 below three decades, else the decades; they enclose all of it. Else evenly spaced."""
    z = np.array([[10.0**first, 10.0 ** (first + decades)], [np.nan, 10.0**first]])
    found = regions._heights(z)
    if 10.0**decades < 20 * (1 - 1e-9):
        assert found == regions.LINES
    elif 10.0**decades > 20 * (1 + 1e-9):
        assert list(found) == sorted(found)
        assert found[0] <= z[0, 0] * (1 + 1e-9)
        assert found[-1] >= z[0, 1] * (1 - 1e-9)
        mantissas = {round(float(f"{h:e}".partition("e")[0]), 6) for h in found}
        assert mantissas == ({1, 2, 5} if decades < 3 else {1})
    assert regions._heights(z - z[0, 0]) == regions.LINES
    assert regions._heights(-z) == regions.LINES


def drawn(levels=None, point=None):
    codes = np.array([[0, 0, 1], [2, 0, 1]])
    edges = (np.array([1.0, 2.0, 4.0, 8.0]), np.array([0.0, 10.0, 20.0]))
    fig = regions.regions(
        codes, ["#ffffff", "#ff0000", "#00ff00", "#0000ff"], ["white", "", "green", "blue"], edges,
        ["k1", "k2"], [True, False], point, "a map", levels,
    )  # fmt: skip
    return fig.axes[0]


def test_regions_have_their_borders_and_names() -> None:
    axis = drawn(point=(3.0, 15.0))
    lines = next(c for c in axis.collections if isinstance(c, LineCollection))
    found = {tuple(map(tuple, np.asarray(s).tolist())) for s in lines.get_segments()}
    assert found == {
        ((4.0, 0.0), (4.0, 10.0)), ((4.0, 10.0), (4.0, 20.0)), ((2.0, 10.0), (2.0, 20.0)),
        ((1.0, 10.0), (2.0, 10.0)),
    }  # fmt: skip
    assert (axis.get_xlim(), axis.get_ylim()) == ((1.0, 8.0), (0.0, 20.0))
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "linear")
    assert (axis.get_xlabel(), axis.get_ylabel(), axis.get_title("left")) == ("k1", "k2", "a map")
    assert [t.get_text() for t in axis.get_legend().get_texts()] == ["white", "green"]
    star = axis.get_lines()[0]
    assert (list(star.get_xdata()), list(star.get_ydata())) == ([3.0], [15.0])
    assert not drawn().get_lines()


def test_borders_lie_between_cells_of_different_regions_row_by_row() -> None:
    codes = np.array([[0, 1], [0, 1], [2, 2], [2, 0]])
    xs, ys = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    found = {tuple(map(tuple, np.asarray(s).tolist())) for s in regions._borders(codes, xs, ys)}
    upright = {((1.0, j), (1.0, j + 1)) for j in (0.0, 1.0, 3.0)}
    level = {((0.0, 2.0), (1.0, 2.0)), ((1.0, 2.0), (2.0, 2.0)), ((1.0, 3.0), (2.0, 3.0))}
    assert found == upright | level


def test_level_lines_are_those_of_the_quantity() -> None:
    """Each in the legend once; none where there is no number."""
    x, y = np.array([1.5, 3.0, 6.0]), np.array([5.0, 15.0])
    z = np.array([[1.0, 2.0, 3.0], [2.0, 3.0, 4.0]])
    axis = drawn(((x, y), z, "distance"))
    names = [t.get_text() for t in axis.get_legend().get_texts()]
    assert names == ["white", "green", "distance"]
    contours = [c for c in axis.collections if hasattr(c, "levels")]
    assert len(contours) == 1
    assert all(1 <= h <= 4 for h in contours[0].levels[1:-1])
    texts = [float(t.get_text()) for t in axis.texts]
    assert texts
    assert set(texts) <= {round(float(h), 6) for h in contours[0].levels}
    assert all(t.get_path_effects() for t in axis.texts)
    bare = drawn(((x, y), np.full((2, 3), np.nan), "distance"))
    assert not [c for c in bare.collections if hasattr(c, "levels")]
    assert [t.get_text() for t in bare.get_legend().get_texts()] == ["white", "green"]
