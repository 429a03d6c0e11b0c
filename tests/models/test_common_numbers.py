"""One quantity is one parameter of a vehicle's slip control, and what was made of it follows."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from bench.healthy_vehicles import trip_of
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.codegen import c_module, record_part
from slipctl.ccode.module.guard import REFUSED
from slipctl.models.vehicle import trip as trips
from slipctl.models.vehicle.control import vehicle_control
from slipctl.models.vehicle.parts.file_keys import of_the_wheel
from slipctl.models.vehicle.slip.common_numbers import WHEEL

TICKS = 40
"""Ticks that are compared of each parameter: from the tick on in which slip control has begun."""


def content(kind: str, lag: str = "60 ms", **vehicle: str) -> dict:
    """A vehicle file of four braked axles that comes onto leaves at once; ``wsp`` is of air."""
    actuator = {"kind": "lag", "torque": "8 kN m", "lag": lag, "rate": "80 kN m/s"}
    air = {"kind": "air", "torque": "8 kN m", "dead_time": "5 ms"}
    return {
        "title": "one", "duration": "0.5 s",
        "vehicle": {"mode": "brake", "mass": "38 t", "axles": 4, "radius": "0.42 m",
                    "inertia": "110 kg m^2", "speed": "60 km/h"} | vehicle,
        "actuator": air if kind == "wsp" else actuator,
        "rail": {"law": "exponential_tail", "conditions": {"leaves": {"c": 0.09, "s": 0.03}},
                 "sections": [{"place": "0 m", "condition": "leaves"}]},
        "demand": {"kind": "constant", "deceleration": "1.2 m/s^2"},
        "sensors": {"wheel_speed": {"kind": "tooth_wheel", "teeth": 120, "jitter": "1 us"},
                    "vehicle_speed": {"kind": "noisy", "deviation": "0.05 m/s"}},
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
        ("tau", 0.07, {"lag": "70 ms"}),
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


def test_limits_of_the_samples_follow_mass_and_sensor():
    """Twice the mass halves the resistance by mass; 0.2 m/s more error of the speed are 0.4 of pace
    and 0.2 of the floor of the reference. What a wheel may be off by is that of its radius.
    """
    trip = trip_of(content("pid", resistance={"a": "1.2 kN", "b": "12 N s/m", "c": "4 N/(m/s)^2"}))
    made = vehicle_control(trip, trip.controllers["one"])
    as_is = made.param_values()
    heavy = made.with_params(m=2 * as_is["m"]).param_values()
    for k, force in enumerate((1200, 12, 4)):
        assert as_is[f"resist_{k}"] == pytest.approx(force / 38e3, rel=1e-12)
        assert heavy[f"resist_{k}"] == pytest.approx(force / 76e3, rel=1e-12)
    vague = made.with_params(v_error=as_is["v_error"] + 0.2).param_values()
    np.testing.assert_allclose(np.subtract(vague["pace"], as_is["pace"]), 0.4, rtol=1e-9)
    assert vague["standstill"] - as_is["standstill"] == pytest.approx(0.2)
    worn = made.with_params(r=[0.42, 0.42, 0.42, 0.40]).param_values()["noise"]
    # but for 0.1 rad/s it is the time of an edge by speed: as the square of the turning
    assert np.diff(np.ravel(worn))[:2] == pytest.approx(0)
    assert (worn[3] - 0.1) / (worn[0] - 0.1) == pytest.approx((0.42 / 0.40) ** 2)


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
@pytest.mark.parametrize("kind", ["pid", "sta", "wsp"])
def test_c_with_any_parameter_moved_is_the_model_with_that_number(kind, tmp_path):
    """Tick by tick, to the bit, and no tick is refused. Each axle has its own radius in one row."""
    trip = trip_of(content(kind))
    loop = trips.loop(trip, "one")
    block = runs_of_part(loop, "ctl").block
    module = c_module(loop["ctl"], tmp_path, "ctl", period=loop.period).compile().load()
    inputs, _ = record_part(loop, "ctl", trips.scenario(replace(trip, duration=0.3)))
    inputs = {n: v[-TICKS:] for n, v in inputs.items()}
    rows = {n: moved(s) for n, s in block.params.items() if not s.derived}
    rows["r"] = np.array([0.41, 0.42, 0.43, 0.44])
    commands = [n for n in block.outputs if "." not in n]
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
            told = block.unpack("output", y)
            for n in commands:
                np.testing.assert_array_equal(out[n][k], np.array(told[n]).ravel(), f"{name}, {k}")
    assert refused == {}
