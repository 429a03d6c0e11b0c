"""Time of each tick beside the log: more where more is done, and no number changes."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Scenario, connect, sampled, simulate, step_times
from slipctl.studies.predictive.slip_problem import axle, make

pytestmark = pytest.mark.usefixtures("needs_compiler")
SCENARIO = Scenario("go", 1.2, inputs={"mu_p": 0.2, "s_ref": 0.02})


def loop(**options):
    """Controller and axle."""
    wires = {f"ctl.{n}": f"plant.{n}" for n in ("v", "q", "T", "xi")}
    wires |= {f"{part}.{n}": n for part in ("ctl", "plant") for n in ("mu_p", "s_ref")}
    parts = {"ctl": make(horizon=12, **options), "plant": sampled(axle, 0.02, "rk4", 4)}
    return connect("loop", wires | {"plant.u": "ctl.u"}, **parts)


@pytest.mark.long
def test_a_tick_of_more_passes_takes_longer_and_the_log_stays():
    block = loop(rates={"u": 20.0})
    log = simulate(block, SCENARIO)
    log["ctl.step_time"] = step_times(block, "ctl", SCENARIO)
    taken, passes = log["ctl.step_time"].values, log["ctl.passes"].values
    assert log["ctl.step_time"].attrs["units"] == "s"
    assert log["ctl.step_time"].dims == ("time",)
    assert len(taken) == 60
    assert (taken > 0).all()
    many, one = passes == passes.max(), passes == 1
    assert passes.max() >= 3
    assert taken[many].min() > 1.1 * np.median(taken[one])
    again = simulate(block, SCENARIO)
    for n in again:
        assert np.array_equal(again[n], log[n], equal_nan=True)


def test_it_is_refused_in_one_line():
    with pytest.raises(BadInput, match="repeats = 0 must be a whole number"):
        step_times(loop(), "ctl", SCENARIO, repeats=0)
    with pytest.raises(BadInput, match="ctrl") as error:
        step_times(loop(), "ctrl", SCENARIO)
    assert "\n" not in str(error.value)
