"""Motors that brake first: what they give, what friction gives, and when they give none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput, simulate
from slipctl.models.brakes import dynamic_brake
from slipctl.models.vehicle import (
    Air,
    Constant,
    DemandAlone,
    Exact,
    Lag,
    Sensors,
    SlipLaw,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.books import TAKEN, energy_error
from slipctl.models.vehicle.parts import DynamicBrake, Pads
from slipctl.models.vehicle.study import study

R = 0.46
MOTORS = DynamicBrake(torque=3e3, power=60e3, axles=(1, 2), lag=0.1, fades_from=4.0, fades_to=2.0)
BOOKS = [f"plant.train.{n}" for n in ("E_kin", "P_drive", *TAKEN)]


def trip(motors=MOTORS, actuator=None, pads=None, controllers=None, **changes):
    vehicle = Vehicle(
        mass=40e3, inertia=100.0, radius=R, speed=20.0, dynamic_brake=motors, pads=pads
    )
    usual = dict(
        duration=40.0, vehicle=vehicle, actuator=actuator or Lag(torque=8e3, lag=0.2),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),)), end="standstill",
        demand=Constant(deceleration=0.8), sensors=Sensors(wheel_speed=Exact()),
        controllers=controllers or {"none": DemandAlone()},
    )  # fmt: skip
    return Trip(**usual | changes)


def run(made, *more):
    found = case(made)
    names = ["plant.train.x", "plant.train.v", "plant.train.omega", "plant.T", "plant.motors.T_e",
             *BOOKS, *more]  # fmt: skip
    return simulate(found.loops["none"], found.scenario, log=names)


def test_motors_give_what_power_torque_and_speed_let_them_and_friction_the_rest():
    log = run(trip())
    t, T_e, T = (log[n].values for n in ("time", "plant.motors.T_e", "plant.T"))
    omega = log["plant.train.omega"].values
    most = np.minimum(3e3, 60e3 / np.maximum(omega, 1)) * np.clip((R * omega - 2) / 2, 0, 1)
    demand = T[-1000, 2]
    settled, fast = t > 2, R * omega[:, 0] > 4.5
    there = settled & fast
    assert np.abs(T_e[there, :2] - np.minimum(most[there, :2], demand)).max() < 0.01 * demand
    assert not T_e[:, 2:].any()  # no motor there
    # friction follows what is left of the demand with its lag of .2 s, as the motor changes
    late = 0.2 * np.abs(np.gradient(T_e[settled], 1e-3, axis=0)).max()
    assert np.abs(T[settled] - demand).max() < 1.01 * late
    assert np.abs(T[settled] - demand).max() > 0.5 * late
    assert np.abs(energy_error(log)).max() < 1e-9


@pytest.mark.second
@pytest.mark.parametrize("actuator", [
    Lag(torque=8e3), pytest.param(Air(torque=8e3, reaction=0.2), marks=pytest.mark.long),
])  # fmt: skip
def test_a_stop_is_as_long_as_by_friction_alone_and_motors_that_fail_are_replaced(actuator):
    alone = case(trip(None, actuator))
    place = "plant.train.x"
    end = float(simulate(alone.loops["none"], alone.scenario, log=[place])[place][-1])
    for motors in (MOTORS, replace(MOTORS, lost=5.0)):
        log = run(trip(motors, actuator))
        assert float(log[place][-1]) == pytest.approx(end, rel=0.02)
        t, T_e = log["time"].values, log["plant.motors.T_e"].values[:, 0]
        if motors.lost is not None:
            k = 5000
            falls = T_e[k] * np.exp(-(t[k:] - t[k]) / 0.1)
            assert np.abs(T_e[k:] - falls).max() < 1e-6


def test_pads_change_what_friction_gives_and_not_what_motors_give():
    weak = run(trip(pads=Pads(material="disc", nominal=0.35, spread=0.5)))
    usual = run(trip(pads=Pads(material="disc", nominal=0.35)))
    assert float(weak["plant.train.x"][-1]) > 1.3 * float(usual["plant.train.x"][-1])
    k = 4000
    same = [log["plant.T"].values[k, 0] for log in (weak, usual)]
    assert same[0] == pytest.approx(same[1], rel=5e-3)  # what is measured does not see the pads


@settings(max_examples=30, deadline=None)
@given(
    T_cmd=st.floats(-1e3, 1e4), omega=st.floats(-60, 60), T_m=st.floats(0, 3e3),
    hold=st.booleans(), vent=st.booleans(), rested=st.floats(0, 10),
)  # fmt: skip
def test_a_tick_never_asks_for_more_than_the_demand_nor_for_a_drive(
    T_cmd, omega, T_m, hold, vent, rested
):
    block = dynamic_brake
    x = block.pack("state", block.start(T_m=T_m, rested=rested))
    u = block.pack("input", {"T_cmd": T_cmd, "omega": omega, "hold": hold, "vent": vent})
    nxt, y = block.f(x, u, block.pack("param", block.param_values()))
    out, after = block.unpack("output", y), block.unpack("state", nxt)
    T_f, T_n = float(out["T_f"]), float(after["T_m"])
    assert T_f >= 0
    assert T_f + T_m == pytest.approx(max(T_cmd, T_m))
    assert 0 <= T_n <= max(T_m, min(max(T_cmd, 0), 4e3)) + 1e-9
    if hold or vent or rested < 3.0 - 1e-3:
        assert T_n <= T_m


def test_valves_that_hold_or_vent_keep_the_motor_of_their_axle_off_for_its_pause():
    block = dynamic_brake.with_params(pause=0.5)
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())
    given = []
    for k in range(2000):
        u = {"T_cmd": 2e3, "omega": 40.0, "hold": 500 <= k < 600, "vent": 0.0}
        x, y = block.f(x, block.pack("input", u), p)
        given.append(float(block.unpack("output", y)["T_e"]))
    T = np.array(given)
    assert T[500] == pytest.approx(2e3, rel=0.01)
    assert T[500] > T[510] > T[1000]
    assert T[1099] < 10
    assert T[1105] > T[1100]
    assert T[1999] == pytest.approx(2e3, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"fades_to": 4.0}, "fades_to: must be below fades_from, 4 m/s"),
        ({"axles": (1, 1)}, "axles: must name each axle with a motor once"),
        ({"axles": (5,)}, "dynamic_brake.axles: names axle 5 of 4"),
        ({"lost": 0.0005}, "lost: 0.5 ms is no whole number"),
    ],
)
def test_what_cannot_be_is_refused(changes, says):
    with pytest.raises(BadInput, match=says):
        trip(replace(MOTORS, **changes))


def test_a_driven_vehicle_has_none_and_no_certificate_is_made_of_one_that_has():
    with pytest.raises(BadInput, match="dynamic_brake: is of a braked vehicle"):
        Vehicle(mode="drive", mass=40e3, inertia=100.0, speed=20.0, dynamic_brake=MOTORS)
    asked = study(trip(controllers={"sta": SlipLaw(kind="sta")}))
    assert "two brakes" in asked.certificates.uncertified["sta"]
