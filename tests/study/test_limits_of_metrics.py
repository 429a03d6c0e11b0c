"""Limits that an engineer sets: a run above one is marked, at it is not; wrong ones are refused."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace

import pytest

from slipctl import BadInput, Signals, Study
from slipctl.run.metrics import METRICS, Metric
from slipctl.study.report.texts import (
    MARK,
    absent,
    limits_broken,
    metric_table,
    values_beyond_limit,
)


def results(limits, **loops):
    study = SimpleNamespace(limits=limits, signals=Signals(speed="v", position="x"))
    logs = {"base": {n: {"v": 0.0, "x": 0.0} for n in loops}}
    return SimpleNamespace(study=study, metrics={"base": loops}, data=logs)


def test_a_value_above_its_limit_is_marked_and_one_at_it_is_not():
    found = results(
        {"lock_time": 0.3},
        held={"lock_time": Metric(0.3, "s")}, locked={"lock_time": Metric(2.5, "s")},
    )  # fmt: skip
    assert limits_broken(found, "base") == [
        "! loop locked exceeds its limits: lock_time 2.5 s, at most 0.3 s"
    ]
    row = next(r for r in metric_table(found, "base").splitlines() if "lock_time" in r)
    assert row.split() == ["lock_time", "[s]", "0.3", "2.5", MARK.strip()]


def test_a_time_that_never_comes_and_a_metric_that_is_missing_are_above_every_limit():
    times = Metric([0.1, None], "s", ("dry", "wet"))
    found = results({"settling_time": 5.0, "stopping_distance": 140.0}, a={"settling_time": times})
    assert limits_broken(found, "base") == [
        "! loop a exceeds its limits: settling_time never, at most 5 s;"
        " it has no stopping_distance, which may be 140 at most"
    ]
    rows = [r.split() for r in metric_table(found, "base").splitlines() if "settling_time [s]" in r]
    assert [r[2:] for r in rows] == [["0.1", "/", "never", "!"]]


@pytest.mark.parametrize("names", list(permutations(["above_ideal", "lock_time", "slip_max"])))
def test_each_limit_is_held_in_whatever_order_they_stand(names):
    """One is against a bound that is not there, one has no value, one is above."""
    found = results(dict.fromkeys(names, 1.0), a={"lock_time": Metric(2.5, "s")})
    assert values_beyond_limit(found, "base") == {"a": {"lock_time": [0], "slip_max": []}}
    (line,) = limits_broken(found, "base")
    assert "lock_time 2.5 s, at most 1 s" in line
    assert "it has no slip_max" in line


@pytest.mark.parametrize("name", [n for n, d in METRICS.items() if d.needs])
def test_a_metric_that_one_loop_has_not_is_told_with_what_it_lacks(name):
    found = results({}, a={name: Metric(1.0, "s")}, b={})
    found.study.signals = Signals()
    (line,) = absent(found, "base")
    assert line.startswith(f"{name} of b: not shown, there is no ")


def test_what_a_metric_lacks_is_told_in_words_and_loops_that_lack_the_same_together():
    found = results({}, a={"adhesion_use": Metric(1.0, "1")}, b={}, c={})
    found.study.signals = Signals()
    assert absent(found, "base") == [
        "adhesion_use of b, c: not shown, there is no adhesion and no best adhesion"
    ]
    found.study.signals = Signals(adhesion="v")
    assert absent(found, "base") == [
        "adhesion_use of b, c: not shown, there is no best adhesion"]  # fmt: skip


def test_without_limits_nothing_is_marked():
    found = results({}, a={"lock_time": Metric(2.5, "s")})
    assert limits_broken(found, "base") == []
    assert MARK not in metric_table(found, "base")


def test_a_limit_of_no_metric_is_refused():
    with pytest.raises(BadInput, match="did you mean 'lock_time'"):
        Study("s", "t", "x", "d", lambda models, quick: [], Signals(), limits={"locktime": 1.0})
