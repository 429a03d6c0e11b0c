"""Pieces of figures and of shown blocks that no whole figure of the pages has."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

from slipctl import Input, Output, Param, State, connect, step
from slipctl.draw import live, looks, mathml, plots, show, strokes, typeset
from slipctl.draw.diagrams.levels import _short_choices
from slipctl.draw.repeats import dead_time

# ---- rail conditions behind a panel --------------------------------------------------------------


def log(ticks: int = 5, changes: Any = (1.0, 3.0), slip: int = 0) -> Any:
    """A run of a second a tick, whose rail changes at some times; slip of so many axles."""
    time = np.arange(float(ticks))
    data: dict[str, Any] = {"time": ("time", time), "v": ("time", 20 - time)}
    if slip:
        data["s"] = (("time", "axle"), np.outer(time, np.arange(1.0, slip + 1)))
    made = xarray.Dataset(data)
    made.attrs["rail_changes_s"] = list(changes)
    if slip:
        made["s"].attrs["units"] = "m/s"
    return made


def results(by: str = "position", sections: int = 3, end: Any = "stands", **logs: Any) -> Any:
    """Results of one scenario on a rail that is dry, wet and leafy."""
    names = ["dry_rail", "wet_track", "leaves"][:sections]
    rail = SimpleNamespace(
        sections=[SimpleNamespace(condition=n) for n in names], by=by, starts=[0.0, 10.0, 30.0]
    )
    scenario = SimpleNamespace(name="base", rail=rail, end=end, duration=9.0)
    signals = SimpleNamespace(
        find=lambda role, found: {"slip": "s", "speed": "v"}[role]
        if {"slip": "s", "speed": "v"}[role] in found else None,
        slip_sign=lambda found: 1,
    )  # fmt: skip
    return SimpleNamespace(
        cases=[SimpleNamespace(scenario=scenario)], data={"base": logs},
        study=SimpleNamespace(signals=signals), log=lambda scenario, loop: logs[loop],
    )  # fmt: skip


def shaded(axis: Any) -> list[tuple[float, float]]:
    """Spans behind a panel."""
    found = []
    for patch in axis.patches:
        box = patch.get_extents().transformed(axis.transData.inverted())
        found.append((round(box.x0, 9), round(box.x1, 9)))
    return found


def panel(left: float = 0.0, right: float = 5.0) -> Any:
    axis = Figure().subplots()
    axis.set_xlim(left, right)
    return axis


def test_each_rail_condition_is_shaded_from_its_beginning_to_the_next(monkeypatch) -> None:
    """Up to the end of the last run; what is not in sight is left out."""
    given = results(a=log(5), b=log(8, (2.0, 4.0)))
    axis = panel(0.0, 9.0)
    plots.bands(axis, given, "base")
    assert shaded(axis) == [(0, 1), (1, 3), (3, 7)]
    assert [t.get_text() for t in axis.texts] == ["dry rail", "wet track", "leaves"]
    assert [t.xy[0] for t in axis.texts] == [0.5, 2.0, 5.0]
    assert [line.get_xdata()[0] for line in axis.lines] == [1.0, 3.0]
    assert axis.get_xlim() == (0.0, 9.0)
    axis = panel(2.5, 4.0)
    plots.bands(axis, given, "base", title=False, loop="b")
    assert shaded(axis) == [(2.5, 4.0)]
    assert list(axis.texts) == []
    axis = panel()
    plots.bands(axis, results(sections=1, a=log()), "base")
    assert shaded(axis) == []


def test_the_end_of_a_scenario_is_that_of_its_last_run_or_its_duration() -> None:
    for end, logs, wanted in (("stands", {"a": log(5), "b": log(8)}, 7.0),
                              ("stands", {"a": log(8), "b": log(5)}, 7.0),
                              (None, {"a": log(5)}, 9.0), ("stands", {}, 9.0)):  # fmt: skip
        given = results(end=end, **logs)
        assert plots._last(given, given.cases[0]) == wanted


@pytest.mark.parametrize("title", [True, False])
def test_each_axle_has_its_own_bands_where_the_rail_changes_by_the_place(
    monkeypatch, title
) -> None:
    told: list[Any] = []
    asked: list[Any] = []

    def arrivals(of: Any, found: Any, starts: Any, axle: int) -> list[float]:
        asked.append((starts, axle))
        return [1.0 + axle, 3.0 + axle] if axle < 2 else []

    monkeypatch.setattr(live, "bands", lambda axis, each: told.append(each))
    monkeypatch.setattr(plots.seen, "arrivals", arrivals)
    given = results(a=log(6, slip=3))
    axis = panel(0.0, 9.0)
    plots.bands(axis, given, "base", title=title, axle=1)
    (each,) = told
    assert [[row[:2] for row in rows] for rows in each] == [
        [(0.0, 1.0), (1.0, 3.0), (3.0, 5.0)], [(0.0, 2.0), (2.0, 4.0), (4.0, 5.0)],
        [(0.0, 1.0), (1.0, 3.0), (3.0, 5.0)],  # it never came there: those of the run
    ]  # fmt: skip
    names = ["dry rail", "wet track", "leaves"] if title else [""] * 3
    assert all([row[3] for row in rows] == names for rows in each)
    hues = [looks.RAILS.get(w, "#FFFFFF") for w in ("dry", "wet", "leaves")]
    assert all([row[2] for row in rows] == hues for rows in each)
    assert shaded(axis) == [(0, 2), (2, 4), (4, 5)]
    assert all(starts == [10.0, 30.0] for starts, _ in asked)
    told.clear()
    plots.bands(panel(), results("time", a=log(6, slip=3)), "base", axle=1)
    plots.bands(panel(), given, "base")
    plots.bands(panel(), results(a=log(6)), "base", axle=1)
    assert told == []


def test_axles_of_a_run_are_those_of_its_slip() -> None:
    assert [plots._axles(results(), log(slip=n)) for n in (0, 1, 4)] == [0, 1, 4]
    one = log()
    one["s"] = ("time", np.zeros(5))
    assert plots._axles(results(), one) == 1


# ---- curves and bars -----------------------------------------------------------------------------


def test_what_a_logarithmic_axis_does_not_show_is_no_part_of_a_curve() -> None:
    found = plots._seen([100.0, 0.0, -1.0, 0.1], True)
    assert found[[0, 3]].tolist() == [2.0, -1.0]
    assert np.isnan(found[1:3]).all()
    assert plots._seen([1, 0, -1], False).tolist() == [1.0, 0.0, -1.0]
    curves = {"a": ([1.0, 10.0, 100.0], [1.0, 2.0, 3.0]), "b": ([1.0, 10.0], [3.0, 4.0])}
    for wanted in ("", "x", "y", "xy"):
        (axis,) = plots.lines(curves, ("t", "s"), ("y", "m"), log=wanted).axes
        scales = axis.get_xscale(), axis.get_yscale()
        assert scales == tuple("log" if k in wanted else "linear" for k in "xy")
        assert [t.get_text() for t in axis.get_legend().get_texts()] == ["a", "b"]


@pytest.mark.parametrize("logarithmic", [False, True])
def test_bars_of_several_decades_may_be_logarithmic(logarithmic: bool) -> None:
    groups = {"base": {"smc": 1.0, "sta": 100.0}, "wet": {"smc": None, "sta": 10.0}}
    (axis,) = plots.bars(groups, ("y", "m"), log=logarithmic).axes
    assert axis.get_yscale() == ("log" if logarithmic else "linear")
    assert [p.get_height() for p in axis.patches] == [1.0, 100.0, 10.0]


def test_signals_that_chatter_have_a_legend_where_there_are_several() -> None:
    t = np.linspace(0, 1, 50)
    for names in (["sta"], ["sta", "smc"]):
        axis = panel()
        plots.chatter(axis, {n: (t, np.sin(t)) for n in names}, ("y", "m"), "above")
        legend = axis.get_legend()
        assert (legend is None) == (len(names) == 1)
        if legend:
            assert [text.get_text() for text in legend.get_texts()] == names
        assert axis.get_title(loc="left") == "above"


@pytest.mark.parametrize(("text", "wanted"), [
    ("short", "short"), ("x" * 24, "x" * 24), ("x" * 25, "x" * 25),
    ("a long label of two lines here", "a long label of\ntwo lines here"),
    ("ab " + "c" * 30, "ab\n" + "c" * 30),
])  # fmt: skip
def test_a_long_label_is_broken_once_at_the_space_nearest_to_its_middle(text, wanted) -> None:
    assert plots._wrap(text) == wanted


def test_a_curve_that_goes_up_and_down_is_an_area(monkeypatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(strokes, "area", lambda *given, **more: asked.append((given, more)) or "an")
    t = np.linspace(0, 1, 8000)
    axis = panel()
    assert strokes.stroke(axis, (t, np.sign(np.sin(9000 * t))), color="red") == "an"
    (given, more) = asked.pop()
    assert given[0] is axis
    assert given[1] is t
    assert (given[3], more) == (strokes.DENSE, {"color": "red"})
    line = strokes.stroke(axis, (t, t), color="red")
    assert line.get_color() == "red"
    assert asked == []


def test_legends_of_panels_with_other_lines_stand_beside_them() -> None:
    """Below each other at the right of each, in a row below each."""
    for rows, columns, place in ((2, 1, (1.0, 1.0)), (1, 2, (-0.1, -0.2))):
        fig = Figure()
        axes = np.ravel(fig.subplots(rows, columns))
        for axis, hue in zip(axes, ("red", "blue"), strict=True):
            axis.plot([0, 1], [0, 1], color=hue, label="the same name")
            axis.legend()
        looks.legends_aside(fig)
        for axis in axes:
            legend = axis.get_legend()
            assert legend is not None
            box = legend.get_bbox_to_anchor().transformed(axis.transAxes.inverted())
            assert (round(box.x0, 6), round(box.y0, 6)) == place
            assert [t.get_text() for t in legend.get_texts()] == ["the same name"]
        assert not fig.legends


# ---- shown blocks --------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "wanted"), [
    ([("x[0]+", "x[1]"), ("x[1]+", "x[2]"), ("x[2]+", "u"), ("y", "x[0]")], ("y", "u", 3)),
    ([("x[0]+", "x[1]"), ("x[1]+", "u"), ("y", "x[0]")], ("y", "u", 2)),
    ([("x[0]+", "x[1]"), ("x[1]+", "2 u"), ("y", "x[0]")], ("y", "2 u", 2)),
    ([("x[0]+", "x[2]"), ("x[1]+", "x[2]"), ("x[2]+", "u"), ("y", "x[0]")], None),
    ([("x[0]+", "x[1]"), ("x[1]+", "x[2]"), ("x[2]+", "u"), ("y", "x[1]")], None),
    ([("x[0]+", "x[1]"), ("x[1]+", "x[2]"), ("x[3]+", "u"), ("y", "x[0]")], None),
    ([("x[0]+", "x[1]"), ("x[1]+", "u[1]"), ("y", "x[0]")], None),
    ([("x[0]+", "u"), ("y", "x[0]")], None), ([], None),
    ([("x[1]+", "x[1]"), ("x[1]+", "x[2]"), ("x[2]+", "u"), ("y", "x[0]")], None),
])  # fmt: skip
def test_values_that_take_the_place_before_are_a_dead_time(rows, wanted) -> None:
    assert dead_time(rows) == wanted


def test_a_block_that_only_waits_is_told_so() -> None:
    """By how many ticks."""

    @step(period=0.1, y=Output("1"))
    def waits(x=State("1", np.zeros(3), shape=(3,)), u=Input("1")):
        return dict(x=ca.vertcat(x[1], x[2], u)), dict(y=x[0])

    assert "3 ticks before" in show.text(waits)
    assert "(k - 3)" in show.latex(waits)


def test_elements_are_named_column_by_column() -> None:
    signal = SimpleNamespace(shape=(2, 3), size=6)
    assert show._elements("A", signal) == [  # type: ignore[arg-type]
        "A[0,0]", "A[1,0]", "A[0,1]", "A[1,1]", "A[0,2]", "A[1,2]"]  # fmt: skip
    assert show._elements("v", SimpleNamespace(shape=(3,), size=3)) == ["v[0]", "v[1]", "v[2]"]  # type: ignore[arg-type]
    assert show._elements("s", SimpleNamespace(shape=(), size=1)) == ["s"]  # type: ignore[arg-type]


def test_a_value_is_told_by_its_number_or_its_name() -> None:
    for value, told in ((0.5, "0.5"), (1 / 3, repr(1 / 3)), (np.float64(2.0), "2"),
                        ([1.0, 1.0], "1 each"), ([1, 2], "[1, 2]"),
                        (np.arange(8), "[0, 1, 2, 3, 4, 5, ...]"),
                        (np.arange(12).reshape(3, 4), "12 numbers"), ([7], "[7]"),
                        (SimpleNamespace(name="wheel"), "wheel"), ("rk4", "rk4"),
                        (None, "None")):  # fmt: skip
        assert show._value(value) == told


@step(period=0.1, y=Output("1"))
def has(x=State("1", 0.0), k=Param("1", 2.0, "gain")):
    return dict(x=x), dict(y=k * x)


@step(period=0.2, y=Output("1"))
def slower(x=State("1", 0.0), k=Param("1", 2.0, "gain")):
    return dict(x=x), dict(y=k * x)


def test_numbers_that_parts_share_are_told_with_those_that_differ() -> None:
    pair = connect("pair", {"y": "a.y", "z": "b.y"}, a=has, b=has)
    shared = connect("pair", {"y": "a.y", "z": "b.y"}, share={"k": ["a.k", "b.k"]}, a=has, b=has)
    text = show.text(shared)
    assert "Shared numbers" in text
    part = text.partition("Shared numbers")[2]
    assert "a.k, b.k" in part
    assert "differs" not in part
    assert "Shared numbers" not in show.text(pair)
    apart = show.text(shared.with_params(**{"b.k": 3.0})).partition("Shared numbers")[2]
    assert "differs from k" in apart
    (line,) = (row for row in apart.splitlines() if "differs from" in row)
    assert line.split()[0] == "b.k"


def test_blocks_of_another_period_differ_in_it() -> None:
    lines = show.difference(has, slower).splitlines()
    stripped = [line.strip() for line in lines]
    assert "- period: 0.1" in stripped
    assert "+ period: 0.2" in stripped
    assert stripped.index("- period: 0.1") == stripped.index("+ period: 0.2") - 1
    assert "period" not in show.difference(has, has)


# ---- letters -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "wanted"), [
    ("m/s^2", r"\mathrm{m/s^{2}}"), ("kg m^2", r"\mathrm{kg\,m^{2}}"), ("%", r"\mathrm{\%}"),
    ("m^-1", r"\mathrm{m^{-1}}"), ("m^1/2 s", r"\mathrm{m^{1/2}\,s}"), ("N", r"\mathrm{N}"),
    ("s^0.5", r"\mathrm{s^{0.5}}"),
])  # fmt: skip
def test_a_unit_is_upright_with_raised_exponents(text: str, wanted: str) -> None:
    assert typeset.unit(text) == wanted


def test_numbers_without_end_have_a_sign() -> None:
    made: Any = object.__new__(typeset.Latex)
    assert typeset.Latex.number(made, math.inf) == r"\infty"
    assert typeset.Latex.number(made, -math.inf) == r"-\infty"


def test_a_row_without_a_left_side_is_a_title() -> None:
    rows = mathml.page(r"$$\begin{aligned} a &= b \\ c \\ & = d \end{aligned}$$")
    assert len(rows) == 3
    assert rows[0] == (mathml.render("a "), mathml.render("= b "))
    assert rows[1] == (mathml.render(" c "), mathml.render(""))
    assert rows[2] == (mathml.render(" = d"), "")


def test_choices_of_a_block_are_told_in_short() -> None:
    chosen = {"h": 0.005, "every": 4, "method": "rk4", "form": "consistent", "other": 3}
    assert _short_choices(SimpleNamespace(choices=chosen)) == ["5 ms", "every 4", "rk4"]  # type: ignore[arg-type]
    assert _short_choices(SimpleNamespace(choices={"form": "own"})) == ["own"]  # type: ignore[arg-type]


# ---- axles ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [False, True])
def test_the_rims_of_all_axles_are_told_beside_the_one_that_is_drawn(monkeypatch, ratio) -> None:
    """The vehicle's speed less the slip of each, or times one less its ratio."""
    told: list[Any] = []
    monkeypatch.setattr(live, "axles", lambda *given: told.append(given))
    monkeypatch.setattr(plots, "bands", lambda *_, **__: None)
    monkeypatch.setattr(plots.seen, "chosen_axle", lambda *_: 1)
    run = log(6, slip=3)
    if ratio:
        run["s"] = run["s"] / 100
        run["s"].attrs["units"] = "1"
    time = np.arange(6.0)
    monkeypatch.setattr(plots.seen, "samples", lambda found, name, span, axle=0: (
        time, found[name].values if name == "v" else found[name].values[:, axle]))  # fmt: skip
    monkeypatch.setattr(plots.seen, "each_axle", lambda found, name, span: found[name].values)
    fig = plots.speeds(results(pid=run), "base", ["pid"])
    v = (20 - time)[:, None]
    slip = np.outer(time, [1.0, 2.0, 3.0])
    wanted = v * (1 - slip / 100) if ratio else v - slip
    ((line, t, every),) = told
    assert line is fig.axes[0].get_lines()[0]
    assert t.tolist() == time.tolist()
    np.testing.assert_allclose(every, wanted)
    rim, vehicle = fig.axes[0].get_lines()
    np.testing.assert_allclose(rim.get_ydata(), wanted[:, 1])
    np.testing.assert_allclose(vehicle.get_ydata(), v[:, 0])
    assert "axle 2" in fig.axes[0].get_ylabel()
