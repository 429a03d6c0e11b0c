"""One quantity is one parameter of a vehicle's slip control, and what was made of it follows."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from bench.healthy_vehicles import trip_of
from slipctl import simulate
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.codegen import c_module
from slipctl.ccode.module.guard import REFUSED
from slipctl.models.vehicle import trip as trips
from slipctl.models.vehicle.control import vehicle_control
from slipctl.models.vehicle.parts.file_keys import of_the_wheel
from slipctl.models.vehicle.slip.common_numbers import WHEEL

TICKS = 40
"""Ticks that are compared of each parameter: from the tick on in which slip control has begun."""


def content(kind: str, **vehicle: str) -> dict:
    """A vehicle file of four braked axles that comes onto leaves at once."""
    return {
        "title": "one", "duration": "0.5 s",
        "vehicle": {"mode": "brake", "mass": "38 t", "axles": 4, "radius": "0.42 m",
                    "inertia": "110 kg m^2", "speed": "60 km/h"} | vehicle,
        "actuator": {"kind": "lag", "torque": "8 kN m", "lag": "60 ms"},
        "rail": {"law": "exponential_tail", "conditions": {"leaves": {"c": 0.09, "s": 0.03}},
                 "sections": [{"place": "0 m", "condition": "leaves"}]},
        "demand": {"kind": "constant", "deceleration": "1.2 m/s^2"},
        "sensors": {"wheel_speed": {"kind": "tooth_wheel", "teeth": 120}},
        "reference": {"kind": "searched"},
        "controllers": {"one": {"kind": kind}},
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["pid", "sta", "nmpc", "eppfc_barrier"])
def test_a_number_of_the_wheel_is_one_parameter(kind):
    """A law's own scale may be another mass, ``law.m``; the wheel's own are there once."""
    trip = trip_of(content(kind))
    params = vehicle_control(trip, trip.controllers["one"]).params
    for last in WHEEL:
        hits = [n for n, s in params.items() if n.rpartition(".")[2] == last and not s.derived]
        assert [n for n in hits if of_the_wheel(params[n], last)] == [last]
    assert params["r"].shape == (4,)
    periods = [n for n, s in params.items() if n.rpartition(".")[2] in ("T", "T_s", "period")]
    assert [n for n in periods if not n.startswith("estimator.")] == ["period"]
    assert params["period"].derived


@pytest.mark.parametrize(
    ("name", "value", "given"),
    [
        ("r", 0.43, {"radius": "0.43 m"}),
        ("J", 130.0, {"inertia": "130 kg m^2"}),
        ("v_start", 20.0, {"speed": "72 km/h"}),
        ("g", 9.7, {"gravity": "9.7 m/s^2"}),
    ],
)
def test_what_follows_from_a_tuned_number_is_as_of_a_file_with_it(name, value, given):
    made, other = (
        vehicle_control(t, t.controllers["one"])
        for t in (trip_of(content("pid")), trip_of(content("pid", **given)))
    )
    tuned, wanted = made.with_params(**{name: value}).param_values(), other.param_values()
    for n, s in made.params.items():
        if s.derived:
            np.testing.assert_array_equal(np.array(tuned[n]), np.array(wanted[n]), n)


def test_the_period_cannot_be_tuned():
    trip = trip_of(content("pid"))
    made = vehicle_control(trip, trip.controllers["one"])
    with pytest.raises(Exception, match="period"):
        made.with_params(period=0.01)


def moved(signal) -> np.ndarray:
    """A tenth more, or less where that is beyond its range, of each element of a parameter."""
    value = np.broadcast_to(np.asarray(signal.value, dtype=float), signal.shape)
    more = np.where(value == 0, 0.1 * min(1.0, signal.hi), 1.1 * value)
    return np.where(more <= signal.hi, more, 0.9 * value)


@pytest.mark.long
def test_c_with_any_parameter_moved_is_the_model_with_that_number(tmp_path):
    """Tick by tick, to the bit, and no tick is refused. Each axle has its own radius in one row."""
    trip = trip_of(content("pid"))
    loop = trips.loop(trip, "one")
    runs = runs_of_part(loop, "ctl")
    block = runs.block
    module = c_module(loop["ctl"], tmp_path, "ctl", period=loop.period).compile().load()
    log = simulate(loop, trips.scenario(replace(trip, duration=0.3)), compile=False)
    sources = {"v": "plant.train.v", "omega": "plant.train.omega", "T": "plant.T",
               "T_demand": "demand.T_demand"}  # fmt: skip
    inputs = {n: log[source].values[-TICKS:] for n, source in sources.items()}
    rows = {n: moved(s) for n, s in block.params.items() if not s.derived}
    rows["r"] = np.array([0.41, 0.42, 0.43, 0.44])
    refused = {}
    for name, value in rows.items():
        values = {n: ca.DM(v) for n, v in block.param_values(**{name: value}).items()}
        module.reset(**{name: value})
        out = module.replay(inputs)
        if (module.status & REFUSED).any():
            refused[name] = module.status
        p, x = block.pack("param", values), block.pack("state", block.symbolic_start(values))
        for k in range(TICKS):
            u = {n: s.value for n, s in block.inputs.items()} | {n: v[k] for n, v in inputs.items()}
            x, y = block.f(x, block.pack("input", u), p)
            told = np.array(block.unpack("output", y)["T_cmd"]).ravel()
            np.testing.assert_array_equal(out["T_cmd"][k], told, f"{name}, tick {k}")
    assert refused == {}
