"""Traces of runs in which each axle has its own slip; dense curves; parts cut out along a path."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
from matplotlib.path import Path as Outline

from slipctl import Signals
from slipctl.draw import figure_files, live, plots, strokes

TIME = np.array([0.0, 1.0, 2.0, 3.0])
SLIP = np.array([[0.0, 0.0, 0.0], [1.0, 3.0, 2.0], [0.5, -7.0, 4.0], [0.25, 1.0, 6.0]])
TORQUE = np.array([0.0, 1500.0, 4000.0, 2500.0])


def run(slip: np.ndarray, torque: np.ndarray, wanted: float) -> xarray.Dataset:
    """A run of four ticks."""
    axes = ("time", "axle")[: slip.ndim]
    return xarray.Dataset(
        {"car.slip": (axes, slip, {"units": "m/s", "long_name": "slip of a wheel, driven"}),
         "ctl.T": ("time", torque, {"units": "N m", "long_name": "torque that is asked for"}),
         "ctl.s": ("time", np.full(4, wanted), {"units": "m/s", "long_name": "wanted"})},
        {"time": TIME}, {"rail_changes_s": []},
    )  # fmt: skip


def results(**logs: xarray.Dataset) -> Any:
    scenario = SimpleNamespace(name="base", rail=None, end=None, duration=3.5)
    other = SimpleNamespace(name="other", rail=None, end=None, duration=99.0)
    return SimpleNamespace(
        cases=[SimpleNamespace(scenario=s) for s in (other, scenario)], data={"base": logs},
        study=SimpleNamespace(signals=Signals(slip="car.slip", torque="ctl.T", reference="ctl.s")),
        log=lambda scenario, loop: logs[loop],
    )  # fmt: skip


def lines(axis: Any) -> dict[str, Any]:
    return {str(k.get_label()): k for k in axis.get_lines()}


def test_all_panels_show_the_axle_that_slips_most_and_the_page_has_the_others(monkeypatch) -> None:
    """The second of three; a loop whose slip is one for all has it in the same panel."""
    told: list[Any] = []
    monkeypatch.setattr(live, "axles", lambda line, t, every: told.append((line, t, every)))
    runs = {"sta": run(SLIP, TORQUE, 0.5), "pid": run(SLIP[:, 2], 2 * TORQUE, 0.5),
            "smc": run(SLIP[:, [1, 0, 2]] / 2, TORQUE / 4, 0.75)}  # fmt: skip
    fig = plots.traces(
        results(**runs), "base", signals=[("slip", "reference"), "torque"],
        limits={"torque": (-2000.0, 9000.0)}, labels={"slip": "slip speed"},
    )  # fmt: skip
    slip, torque = fig.get_axes()
    assert slip.get_ylabel() == "slip speed, axle 2 [m/s]"
    assert torque.get_ylabel() == "torque that is asked for [kN m]"
    assert torque.get_ylim() == pytest.approx((-2.0, 9.0))
    assert slip.get_ylim() != torque.get_ylim()
    assert slip.get_xlim() == (0.0, 3.5)
    assert (slip.get_xlabel(), torque.get_xlabel()) == ("", "time [s]")
    drawn = lines(slip)
    for loop, values in (("sta", SLIP[:, 1]), ("pid", SLIP[:, 2]), ("smc", SLIP[:, 0] / 2)):
        assert drawn[loop].get_ydata() == pytest.approx(values)
        assert list(drawn[loop].get_xdata()) == list(TIME)
    for loop, factor in (("sta", 1.0), ("pid", 2.0), ("smc", 0.25)):
        assert lines(torque)[loop].get_ydata() == pytest.approx(factor * TORQUE / 1000)
    assert [k.get_ydata()[0] for k in slip.get_lines() if k.get_lw() < 1] == [0.5, 0.75]
    found = {id(line): (t, every) for line, t, every in told}
    assert len(told) == 2
    for loop, columns, factor in (("sta", [0, 1, 2], 1.0), ("smc", [1, 0, 2], 0.5)):
        t, every = found[id(drawn[loop])]
        assert list(t) == list(TIME)
        np.testing.assert_allclose(every, factor * SLIP[:, columns])
    (legend,) = fig.legends
    assert [t.get_text() for t in legend.get_texts()] == ["sta", "pid", "smc", "wanted"]
    handles = legend.legend_handles
    assert [h.get_color() for h in handles[:3]] == [drawn[n].get_color() for n in runs]


def test_what_moves_most_is_drawn_below_the_others() -> None:
    """By the sum over the panels of the share of the largest total variation."""
    runs = {"sta": run(SLIP[:, 2], 3 * TORQUE, 0.5), "pid": run(2 * SLIP[:, 2], TORQUE, 0.5),
            "smc": run(SLIP[:, 2] / 9, TORQUE, 0.5)}  # fmt: skip
    fig = plots.traces(results(**runs), "base", ["smc", "sta", "pid"])
    for axis in fig.get_axes():  # 1.5, 1.33 and 0.39
        drawn = lines(axis)
        assert [drawn[n].get_zorder() for n in ("sta", "pid", "smc")] == [2.0, 2.01, 2.02]
        assert [str(k.get_label()) for k in axis.get_lines()] == ["sta", "pid", "smc"]
    assert fig.get_axes()[0].get_ylabel() == "slip of a wheel [m/s]"
    (legend,) = fig.legends
    assert [t.get_text() for t in legend.get_texts()] == ["smc", "sta", "pid"]
    alone = plots.traces(results(sta=runs["sta"]), "base", span=(1.0, 2.0))
    assert not alone.legends
    assert list(alone.get_axes()[0].get_lines()[0].get_xdata()) == [1.0, 2.0]
    assert alone.get_axes()[1].get_xlim() == (1.0, 2.0)


# ---- dense curves --------------------------------------------------------------------------------


def teeth(columns: float, per: int, height: float) -> np.ndarray:
    """Saw teeth on a slope in the first so many columns of ``per`` samples; then only the slope."""
    many = strokes.DENSE * per
    up = np.where(np.arange(many) % 2, height, 0.0)
    up[round(columns * per) :] = 0.0
    return np.linspace(0.0, 1.0, many) + up


@pytest.mark.parametrize(("columns", "height", "rest", "dense"), [
    (0.12 * strokes.DENSE, 0.2, 0, True), (0.12 * strokes.DENSE, 0.2, 5, True),
    (0.08 * strokes.DENSE, 0.2, 0, False), (0.9 * strokes.DENSE, 0.02, 0, False),
    (0.9 * strokes.DENSE, 0.2, 7, True),
])  # fmt: skip
def test_a_curve_is_dense_where_a_tenth_of_it_goes_up_and_down_and_far(
    columns, height, rest, dense
) -> None:
    """Whatever is left behind the last whole column."""
    y = teeth(columns, 8, height)
    assert strokes._dense(np.append(y, np.full(rest, y[-1]))) == dense


def test_too_few_samples_or_one_that_is_no_number_are_not_dense() -> None:
    assert strokes._dense(teeth(strokes.DENSE, 5, 0.2))
    assert not strokes._dense(teeth(strokes.DENSE, 4, 0.2))
    assert not strokes._dense(teeth(strokes.DENSE, 5, 0.2)[: strokes.DENSE])
    assert not strokes._dense(np.zeros(3))
    y = teeth(strokes.DENSE, 8, 0.2)
    assert not strokes._dense(np.column_stack([y, y]))
    y[100] = np.nan
    assert not strokes._dense(y)


def test_an_area_has_mean_and_ends_of_each_column_and_its_line_the_whole_curve(monkeypatch) -> None:
    """Seven samples in three columns: of two, two and three."""
    told: list[Any] = []
    monkeypatch.setattr(live, "exact", lambda *given: told.append(given))
    _, axes = plots.panels()
    t, y = np.arange(7.0) ** 2, np.array([4.0, 0.0, 1.0, 9.0, 2.0, 8.0, 5.0])
    line = strokes.area(axes[0, 0], t, y, 3, color="#112233", label="it")
    assert list(line.get_xdata()) == pytest.approx([0.5, 6.5, (16 + 25 + 36) / 3])
    assert list(line.get_ydata()) == pytest.approx([2.0, 5.0, 5.0])
    ((one, x, values),) = told
    assert one is line
    assert (list(x), list(values)) == (list(t), list(y))
    (band,) = axes[0, 0].collections
    assert (band.get_label(), band.get_alpha()) == (live.RANGE, 0.25)
    corners = {(round(float(a), 6), float(b)) for a, b in band.get_paths()[0].vertices}
    middle = round((16 + 25 + 36) / 3, 6)
    assert corners == {(0.5, 4), (0.5, 0), (6.5, 9), (6.5, 1), (middle, 8), (middle, 2)}


def test_a_curve_of_few_points_is_each_of_them_once_in_its_order() -> None:
    """Of each column the first, the least, the largest and the last."""
    t = np.arange(11.0)
    y = np.array([3.0, 9.0, 1.0, 2.0, 4.0, 8.0, 7.0, 0.0, 5.0, 6.0, 5.5])
    few_t, few = strokes.envelope(t, y, 2)  # 0 to 4, and 5 to 10
    assert few_t.tolist() == [0, 1, 2, 4, 5, 7, 10]
    assert few.tolist() == [3.0, 9.0, 1.0, 4.0, 8.0, 0.0, 5.5]
    assert strokes.envelope(t[:4], y[:4], 2)[0].tolist() == [0, 1, 2, 3]


# ---- files ---------------------------------------------------------------------------------------


def test_what_is_cut_out_along_a_path_is_drawn_as_matplotlib_draws_it() -> None:
    """The pass that draws both at once has no such pen."""
    drawn = []
    for _ in range(2):
        fig, axes = plots.panels()
        fig.set_layout_engine("none")
        (line,) = axes[0, 0].plot([0, 1], [0, 1], lw=9)
        line.set_clip_path(Outline.unit_circle(), axes[0, 0].transAxes)
        drawn.append(fig)
    svg, png = figure_files.pictures(drawn[0])
    with plots.style():
        assert svg == figure_files._svg(drawn[1], "")
        assert png == figure_files._png(drawn[1], "")
