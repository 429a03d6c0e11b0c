"""Runs that fail count as worst in every median, and limits are counted over all of them."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from slipctl.run.metrics import METRICS
from slipctl.run.sweep.spread import (
    count_kept,
    limits_missed,
    quantiles,
    share_interval,
    value_in_run,
)
from slipctl.run.sweep.sweep_results import Sweep
from slipctl.study.report import sweep_page

finite = st.floats(-1e6, 1e6)


@given(st.lists(finite, min_size=1, max_size=40), st.floats(0, 1))
def test_quantiles_of_finite_numbers_are_those_of_numpy(values, share):
    found = quantiles(np.array(values), [share])
    assert found == pytest.approx([np.quantile(values, share)], rel=1e-9, abs=1e-6)


@given(st.lists(finite, min_size=1, max_size=30), st.integers(1, 40))
def test_a_run_that_never_stops_raises_every_quantile_and_no_other_way(values, never):
    """The median of survivors is never above that of all; it is infinite where half are lost."""
    alone = quantiles(np.array(values), [0.05, 0.5, 0.95])
    whole = quantiles(np.array([*values, *[math.inf] * never]), [0.05, 0.5, 0.95])
    assert all(w >= a for w, a in zip(whole, alone, strict=True))
    if never > len(values):
        assert whole[1] == math.inf
    assert not any(map(math.isnan, whole))


@given(st.lists(st.just(math.nan), max_size=3), st.lists(st.floats(0, 1), max_size=4))
def test_without_values_each_quantile_is_nan(values, shares):
    found = quantiles(np.array(values), shares)
    assert len(found) == len(shares)
    assert all(map(math.isnan, found))


@pytest.mark.parametrize(("hits", "runs"), [(0, 1), (0, 200), (150, 200), (200, 200), (7, 12)])
def test_interval_of_a_share_is_that_of_clopper_and_pearson(hits, runs):
    known = binomtest(hits, runs).proportion_ci(0.95, "exact")
    assert share_interval(hits, runs) == pytest.approx((known.low, known.high), abs=1e-12)


def test_limits_are_counted_and_a_run_may_fail_two():
    ended = {"stopping_distance": 900.0, "lock_time": 0.1}
    runs = [
        ended,
        ended,
        {"stopping_distance": None, "lock_time": 2.0},
        {},
        ended | {"lock_time": 1},
    ]
    limits = {"stopping_distance": 950.0, "lock_time": 0.3}
    kept = count_kept(runs, limits)
    assert (kept.within, kept.runs, kept.fails) == (2, 5, {"stopping_distance": 2, "lock_time": 3})
    assert "2 of 5 within all limits" in str(kept)
    assert limits_missed({"settling_time": [0.1, None]}, {"settling_time": 5.0}) == [
        "settling_time"
    ]


def test_what_never_came_is_worst_and_what_has_no_meaning_is_none():
    assert value_in_run("stopping_distance", {"stopping_distance": None}) == math.inf
    assert value_in_run("stopping_distance", {}) == math.inf, "the run broke off"
    assert value_in_run("adhesion_use", {}) == -math.inf, "more is better"
    assert math.isnan(value_in_run("stopping_distance", {"distance": 3.0})), "it does not brake"
    assert math.isnan(value_in_run("slip_max", {})), "neither end is better"
    assert value_in_run("settling_time", {"settling_time": [0.2, None]}, 1) == math.inf
    assert math.isnan(value_in_run("settling_time", {"settling_time": [0.2]}, 1)), (
        "not on that rail"
    )
    assert all(d.better for d in METRICS.values() if d.event)


def swept(stops):
    axes = [SimpleNamespace(name="m", unit="kg", lo=1.0, hi=2.0, points=None)]
    plan = SimpleNamespace(size=len(stops), axes=axes, drawn=axes, seed=1, design="random")
    about = {"loop": "car:a", "scenario": "base", "limits": {"stopping_distance": 100.0}}
    found = Sweep(Path("out"), about, plan, {"stopping_distance": ("m", ())})
    vars(found)["runs"] = [
        (k, {"m": 1.0 + k}, {"stopping_distance": v}, "") for k, v in enumerate(stops)
    ]
    return found


def test_the_page_of_a_sweep_compares_run_by_run_and_names_what_failed_first():
    one, other = swept([90.0, 95.0, None, 105.0]), swept([91.0, 97.0, 99.0, None])
    apart = sweep_page.paired_differences({"one": one, "other": other}, "stopping_distance")
    assert apart["other"].tolist() == [1.0, 2.0, -math.inf, math.inf]
    assert one.kept.within == 2
    page = sweep_page.page({"one": one, "other": other}, "slipctl sweep")
    assert "2 of 4" in page
    assert "stopping_distance never" in page
    assert "<img" in page


@pytest.mark.parametrize("order", ["ab", "ba"])
def test_the_page_of_a_sweep_tells_each_metric_that_has_a_value(order):
    found = Sweep(
        Path("out"),
        {"loop": "car:a", "scenario": "base"},
        swept([1.0]).plan,
        dict.fromkeys(order, ("m", ())),
    )
    vars(found)["runs"] = [(0, {"m": 1.0}, {"a": math.nan, "b": 2.0}, "")]
    page = sweep_page.page({"one": found}, "slipctl sweep")
    assert "<td>b [m]</td>" in page
    assert "<td>a [m]</td>" not in page


def test_the_page_of_a_sweep_tells_least_median_and_largest_and_what_lies_between():
    page = sweep_page.page({"one": swept([float(k) for k in range(200, 301)])}, "slipctl sweep")
    row = next(r for r in page.split("<tr>") if "<td>stopping_distance [m]</td>" in r)
    told = re.findall(r">([\d.]+)</td>", row)
    assert [float(v) for v in told[:5]] == [200, 205, 250, 295, 300]


@pytest.mark.parametrize("order", ["abc", "acb", "bac", "bca", "cab", "cba"])
def test_each_number_of_each_metric_is_labelled_in_whatever_order_they_stand(order):
    """One number, a list of one, and one for each of two sections of the rail."""
    known = {"a": 1.0, "b": [2.0], "c": [3.0, 4.0]}
    plan = SimpleNamespace(size=1)
    rows = {"a": (), "b": ("all",), "c": ("x", "y")}
    found = Sweep(Path("out"), {}, plan, {name: ("m", rows[name]) for name in order})
    vars(found)["runs"] = [(0, {}, known, "")]
    wanted = {"a": ["a"], "b": ["b"], "c": ["c, x", "c, y"]}
    assert [n for n, *_ in found.labelled()] == [w for name in order for w in wanted[name]]
    assert {n: x.tolist() for n, _, x in found.labelled()} == {
        "a": [1.0], "b": [2.0], "c, x": [3.0], "c, y": [4.0]}  # fmt: skip


@pytest.mark.parametrize("limit", [100.0, 140.0, 0.1, 1.0])
def test_the_page_of_a_sweep_writes_the_whole_limit(limit):
    one = swept([90.0, 95.0])
    one.about["limits"] = {"stopping_distance": limit}
    page = sweep_page.page({"one": one}, "slipctl sweep")
    (told,) = re.findall(r"runs that miss stopping_distance ≤ ([^<]*) m<", page)
    assert float(told) == limit
