"""How numbers of many runs are drawn: dots, boxes, runs that never came, differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg

from slipctl.draw import distributions, plots

DISTANCE = ("distance", "m")
NEVER = math.inf


def spread(values, **more):
    return distributions.spread({"a": values}, DISTANCE, **more).axes[0]


def test_runs_that_never_came_stand_in_a_strip_above_all_others():
    """A line half way between it and them; it takes the same share of the height in each scale."""
    shares = []
    for log, along in ((False, float), (True, math.log)):
        low, high = (along(y) for y in spread([1.0, 2.0, 5.0], log=log).get_ylim())
        axis = spread([1.0, 2.0, NEVER, 5.0, None], log=log)
        bottom, top = (along(y) for y in axis.get_ylim())
        cross = next(line for line in axis.lines if line.get_marker() == "x")
        border = next(line for line in axis.lines if list(line.get_xdata()) == [0, 1])
        assert bottom == pytest.approx(low)
        assert along(cross.get_ydata()[0]) == pytest.approx(top)
        assert along(border.get_ydata()[0]) == pytest.approx((high + top) / 2)
        assert [t.get_text() for t in axis.texts] == ["1 of 4 never"]
        shares.append((top - high) / (high - low))
    assert min(shares) == pytest.approx(max(shares))
    assert min(shares) > 0


def test_a_box_is_the_middle_half_with_its_median_from_side_to_side():
    axis = spread([4.0, 0.0, 3.0, 1.0, 2.0])
    (box,) = axis.patches
    (median,) = (c.get_segments()[0] for c in axis.collections)
    assert (box.get_y(), box.get_y() + box.get_height()) == (1.0, 3.0)
    assert list(median[:, 1]) == [2.0, 2.0]
    assert median[:, 0] == pytest.approx([box.get_x(), box.get_x() + box.get_width()])
    left, right = distributions.spread({"a": [1.0], "b": [2.0]}, DISTANCE).axes[0].get_xlim()
    assert -left == pytest.approx(right - 1)


@pytest.mark.parametrize("many", [20, 50, 89, 120, 300])
def test_dots_beside_each_other_spread_evenly_within_the_box(many):
    axis = spread(np.ones(many))
    at = np.sort(axis.lines[0].get_xdata())
    box = axis.patches[0]
    assert box.get_x() < at[0] <= at[-1] < box.get_x() + box.get_width()
    gaps = np.diff(at)
    assert gaps.max() < 2.7 * gaps.min()
    assert abs(at[0] + at[-1]) <= 2 * gaps.max()


def test_differences_are_spread_over_the_draws_and_those_without_end_are_counted():
    fig, axes = plots.panels()
    values = [3.0, -1.0, math.nan, NEVER, 2.0, -NEVER, NEVER]
    distributions.differences({"b": values}, "a", DISTANCE, axis=axes[0, 0])
    (dots, *_) = axes[0, 0].lines
    assert list(dots.get_ydata()) == [-1.0, 2.0, 3.0]
    assert dots.get_xdata() == pytest.approx([25.0, 125 / 3, 175 / 3])
    (said,) = (t.get_text() for t in axes[0, 0].get_legend().get_texts())
    assert said == "b - a; 2 where b never came; 1 where a never came"
    assert fig.axes[0].get_xlim() == (0, 100)


def test_the_name_of_a_limit_ends_at_the_edge_of_the_panel():
    axis = spread([1.0, 2.0], limit=("allowed", 1.5))
    (name,) = axis.texts
    box = name.get_window_extent(RendererAgg(900, 400, axis.figure.dpi))
    assert box.x1 == pytest.approx(axis.bbox.x1, abs=2)
