"""Metrics of air, of a mark and beside clean rail, on logs with numbers in closed form."""

import numpy as np
import pytest
import xarray

from slipctl.run.measures.measured_run import Metric, Run
from slipctl.run.metrics import measure
from slipctl.run.roles import Signals
from slipctl.run.sweep.sweep_runs import MEASURED

SIGNALS = Signals(
    speed="v", position="x", air_used="air", air_left="left", valve_changes="n", mark="mark"
)


def stop_from(v_0, a, tick=0.01, still=200):
    """Log of a stop from v_0 at a, exact at each tick, with what a brake adds to it."""
    time = np.arange(round(v_0 / a / tick) + still) * tick
    t = np.minimum(time, v_0 / a)
    data = {
        "v": ("time", v_0 - a * t, {"units": "m/s"}),
        "x": ("time", v_0 * t - a * t**2 / 2, {"units": "m"}),
        "air": ("time", 2e-3 * time, {"units": "m^3"}),
        "left": ("time", 7e5 - 1e4 * time + 2e4 * (time > 2), {"units": "Pa"}),
        "n": (("time", "axle"), np.outer(time // 0.5, [1, 3]), {"units": "1"}),
        "mark": ("time", 0 * time + 90.0, {"units": "m"}),
    }
    return xarray.Dataset(data, coords={"time": time}, attrs={"period_s": tick})


def found(log, **more):
    return {n: m.value for n, m in measure(Run(log, SIGNALS, **more)).items()}


def test_a_stop_passes_its_mark_by_v2_over_2a_less_the_mark():
    got = found(stop_from(20.0, 2.0))  # 100 m; measured where the speed is 0.1 m/s
    assert got["overrun"] == pytest.approx(10.0 - 0.1**2 / 4, abs=1e-9)
    assert found(stop_from(18.0, 2.0))["overrun"] == 0.0  # 81 m


def test_who_still_moves_has_no_overrun_and_counts_as_worst():
    log = stop_from(20.0, 2.0).isel(time=slice(0, 500))
    assert found(log)["overrun"] is None


def test_the_extension_is_that_over_the_stop_on_clean_rail():
    clean = measure(Run(stop_from(20.0, 2.0), SIGNALS))
    got = found(stop_from(20.0, 1.0), clean=clean)
    assert got["extension"] == pytest.approx((200 - 0.005) / (100 - 0.0025) - 1, abs=1e-9)
    never = found(stop_from(20.0, 1.0), clean={"stopping_distance": Metric(None, "m")})
    assert never["extension"] is None
    assert "extension" not in found(stop_from(20.0, 1.0))
    assert "extension" not in MEASURED  # a run that is alone in a sweep has nothing beside it


def test_air_and_valves_are_those_at_the_end_and_of_the_worst_axle():
    log = stop_from(20.0, 2.0)
    got, last = found(log), float(log["time"][-1])
    assert got["air_used"] == pytest.approx(2.0 * last)  # 2 l/s
    assert got["air_left"] == pytest.approx(7.0 - 0.1 * last + 0.2)
    assert got["valve_operations"] == 3 * (last // 0.5)
