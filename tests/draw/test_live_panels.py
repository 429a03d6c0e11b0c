"""What is read off each panel of a figure, and panels of what one curve hides of another."""

from __future__ import annotations

from itertools import permutations

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")
from matplotlib import pyplot as plt

from slipctl.draw import live
from slipctl.draw.live import Curve, Panel

T = np.linspace(0, 10, 101)


def differences(*curves, label="slip [m/s]", height=(0.0, 100.0)):
    told: list[str] = []
    panel = Panel(label, height, [Curve(*c) if isinstance(c, tuple) else c for c in curves],
                  bands=[(0.0, 5.0, "#ffffff", "dry")])  # fmt: skip
    return list(live._differences(panel, told)), told


def test_of_curves_that_are_the_same_each_is_told_beside_the_next():
    found, told = differences(*((n, T, np.sin(T), "#0") for n in "abc"))
    assert found == []
    assert told == ["slip: a and b are the same", "slip: b and c are the same"]


def test_what_a_curve_hides_is_their_difference():
    y = np.sin(T)
    off = 0.02 * np.cos(T)
    found, told = differences(
        ("thin", T, y, "#0", "", True), ("short", T[:2], y[:2], "#0"), ("a", T, y + off, "#1"),
        ("far", T, y + 50, "#2"), ("b", T, y, "#3"), ("c", T, y, "#4"),
    )  # fmt: skip
    (one,) = found
    assert told[0] == "slip: a and b differ by at most 0.02 m/s"
    assert told[1] == "slip: b and c are the same"
    assert one.label == "difference of slip [m/s]"
    assert one.range == pytest.approx((-0.0212, 0.0212))
    (curve,) = one.curves
    assert curve.name == "a − b"
    assert curve.colour == "#1"
    assert curve.y == pytest.approx(off)
    assert list(curve.t) == list(T)
    assert one.bands == [(0.0, 5.0, "#ffffff", "")]


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_what_hides_nothing_ends_no_search(order):
    """A thin curve, a short one, one that is farther: wherever they stand between two others."""
    y = np.sin(T)
    others = [("thin", T, y, "#0", "", True), ("short", T[:2], y[:2], "#0"),
              ("far", T, y + 50, "#2"), ("b", T, y, "#3")]  # fmt: skip
    found, told = differences(("a", T, y + 0.02, "#1"), *(others[k] for k in order))
    assert [p.curves[0].name for p in found] == ["a − b"]
    assert len(told) == 1


def test_curves_of_other_times_are_compared_where_both_are():
    half = np.linspace(2, 8, 31)
    ((one,), _) = differences(("a", T, 2 * T, "#1"), ("b", half, 2 * half + 0.01, "#2"))
    (curve,) = one.curves
    assert (curve.t.min(), curve.t.max()) == pytest.approx((2, 8))
    assert curve.y == pytest.approx(np.full(len(curve.t), -0.01))
    assert differences(("a", T, 2 * T, "#1"), ("b", T + 20, T, "#2")) == ([], [])
    first = Curve("a", T, 2 * T, "#1", axles=[2 * T, 3 * T])
    ((one,), _) = differences(first, Curve("b", T, 2 * T + 0.01, "#2", axles=[T, T]))
    assert one.curves[0].axles == [pytest.approx(T), pytest.approx(2 * T)]


@pytest.fixture
def axis():
    fig, axis = plt.subplots()
    axis.set_xlabel(live.TIME)
    axis.set_xlim(1, 9)
    axis.set_ylabel("v [m/s]")
    yield axis
    plt.close(fig)


def test_a_panel_has_curves_levels_and_bands_and_no_borders(axis):
    axis.axvspan(0, 4, color="#ff0000", zorder=-5)
    axis.axvspan(4, 9, color="#00ff00", zorder=-5)
    axis.axvline(4, zorder=-4)
    axis.annotate("wet", (5.0, 0.5))
    axis.plot(T, np.full(101, np.nan), label="nothing", zorder=2)
    axis.plot(T, T, label="own", zorder=3, color="#123456", lw=0.5, ls="--")
    axis.plot(T, 2 * T, label="_given", zorder=2.5, lw=2)
    axis.axhline(3.0, label="level", zorder=4)
    panel = live._panel(axis, (1.0, 9.0))
    assert panel is not None
    assert [c.name for c in panel.curves] == ["reference", "own", "level"]
    reference, own, level = panel.curves
    assert (own.colour, own.thin, reference.thin) == ("#123456", True, False)
    assert own.dash.split()
    assert not reference.dash
    assert own.t == pytest.approx(T[10:91])
    assert list(own.y) == list(own.t)
    assert (list(level.t), list(level.y)) == ([1.0, 9.0], [3.0, 3.0])
    assert [b[:2] for b in panel.bands] == [(0, 4), (4, 9)]
    assert [b[2:] for b in panel.bands] == [("#ff0000", ""), ("#00ff00", "wet")]
    assert panel.label == "v [m/s]"


@pytest.mark.parametrize("odd", ["marks", "steep", "nothing"])
def test_what_is_no_line_over_time_is_no_panel(axis, odd):
    if odd == "marks":
        axis.plot(T, T)
        axis.plot(T, T, "o")
    elif odd == "steep":
        axis.plot(T, T)
        axis.axline((0, 0), (1, 1))
    else:
        axis.plot(T, np.full(101, np.nan))
    assert live._panel(axis, (1.0, 9.0)) is None


def test_what_a_line_shows_exactly_and_of_each_axle_is_taken_within_the_span(axis):
    (line,) = axis.plot([0, 10], [0, 10], label="a")
    live.exact(line, T, T**2)
    live.axles(line, T, np.stack([T, -T], axis=1))
    live.bands(axis, [[(0.0, 1.0, "#1", "dry")]])
    panel = live._panel(axis, (1.0, 9.0))
    (curve,) = panel.curves
    assert curve.y == pytest.approx(T[10:91] ** 2)
    assert [list(a) for a in curve.axles] == [list(T[10:91]), list(-T[10:91])]
    assert panel.by_axle == [[(0.0, 1.0, "#1", "dry")]]
