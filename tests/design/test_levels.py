"""Level lines of a map: each point is a run of the loop as it is by itself."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import simulate
from slipctl.commands.cli import main
from slipctl.design.levels import levels, places
from slipctl.run.metrics import Metric, Run, measure
from slipctl.run.sweep.sweep_runs import Measured
from slipctl.study.resolve import find_loop, load_study

STUDY = load_study("subway_braking")
LOOP, CASE = find_loop(STUDY, "sta", quick=True)


def test_each_value_is_that_of_a_run_by_itself():
    """The grid against ``simulate`` with the two numbers set."""
    at = ("ctl.law.k1", "ctl.law.k2")
    measured = Measured(LOOP, CASE.scenario, STUDY.signals, CASE.known, compile=False)
    found = levels(measured, "distance", at, np.array([5.0, 20.0]), np.array([10.0]))
    assert found.unit == "m"
    for k1, value in zip((5.0, 20.0), found.values[0], strict=True):
        own = LOOP.with_params(**dict(zip(at, (k1, 10.0), strict=True)))
        log = simulate(own, CASE.scenario, compile=False)
        assert value == measure(Run(log, STUDY.signals, []))["distance"].value
    assert found.values[0][1] == found.here  # the design point is on the grid


@pytest.mark.parametrize(("xs", "ys"), [([1.0, 2.0, 3.0], [5.0, 6.0]), ([1.0], [5.0, 6.0, 7.0])])
def test_rows_of_a_grid_go_along_the_first_axis(xs, ys):
    """A point whose run fails has no number; the share done rises to 1."""

    def ended(k, numbers):
        failed = "it fell over" if numbers == {"a": 1.0, "b": 6.0} else ""
        value = 100 * numbers.get("a", 0.0) + numbers.get("b", 0.0)
        return SimpleNamespace(failed=failed, metrics={"distance": Metric(value, "m")})

    told = []
    found = levels(SimpleNamespace(ended=ended), "distance", ("a", "b"), np.array(xs), np.array(ys),
                   tell=told.append)  # fmt: skip
    wanted = [[np.nan if (x, y) == (1.0, 6.0) else 100 * x + y for x in xs] for y in ys]
    assert np.array_equal(found.values, wanted, equal_nan=True)
    assert (found.here, found.unit) == (0.0, "m")
    assert told == sorted(told)
    assert (len(told), told[-1]) == (len(xs) * len(ys), 1.0)


def test_axes_are_found_by_name_and_value():
    numbers = {"k1": 20.0, "k2": 10.0}
    assert places(LOOP, "ctl", ["k1", "k2"], numbers) == ("ctl.law.k1", "ctl.law.k2")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["super_twisting", "--set", "k1=3", "k2=2", "L=1", "--metric", "distance"], "is a system"),
        (["subway_braking:sta", "--metric", "torque_riple"], "did you mean 'torque_ripple'"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(words, said, tmp_path, capsys):
    line = ["certify", *words, "--map", "k1,k2", "--points", "2", "--out", str(tmp_path / "m")]
    assert main(line) == 2
    err = [k for k in capsys.readouterr().err.splitlines() if "slipctl: 1/" not in k]
    assert len(err) == 1
    assert said in err[0]


def test_a_number_that_is_not_of_the_loop_is_refused(capsys, tmp_path):
    line = ["certify", "subway_braking:sta", "--map", "k1,L", "--points", "2", "--metric",
            "distance", "--out", str(tmp_path / "m")]  # fmt: skip
    assert main(line) == 2
    assert "L of the map is no number of the loop" in capsys.readouterr().err


def test_a_point_without_a_number_is_written_as_none():
    from slipctl.design.levels import Levels

    found = Levels("distance", "m", ("a", "b"), [[1.0, math.inf], [math.nan, 2.0]], 1.0)
    assert json.loads(json.dumps(found.payload()))["values"] == [[1.0, None], [None, 2.0]]
    assert found.text() == "distance: 1 to 2 m, 1 m at the design point; 2 runs gave none"
