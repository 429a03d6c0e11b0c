"""Wheels that differ: ratios that are learnt, the speed made of the wheels, and its bound."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput, simulate
from slipctl.models.vehicle import (
    Constant,
    DemandAlone,
    Exact,
    Lag,
    Profile,
    Sensors,
    SlipLaw,
    SlipSpeed,
    Stretch,
    ToothWheel,
    Track,
    Trip,
    Vehicle,
    WheelsOnly,
    case,
)
from slipctl.models.vehicle.measurement.sensor_parts import vehicle_speed
from slipctl.models.vehicle.parts import SlipControl
from slipctl.models.vehicle.parts.sensors import LargestWheel
from slipctl.models.vehicle.wheels import bounded_speed, learnt_radii

DRY = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="dry"),))
CAR = Vehicle(mass=38e3, inertia=110.0, speed=16.7, radius=(0.42, 0.42, 0.39, 0.42))


def trip(**changes):
    usual = dict(
        duration=3.0, vehicle=CAR, actuator=Lag(torque=8e3, lag=0.06, dead_time=0.02), rail=DRY,
        demand=Constant(deceleration=1.2),
        sensors=Sensors(wheel_speed=ToothWheel(teeth=120), vehicle_speed=WheelsOnly()),
        reference=SlipSpeed(slip=1.2),
        controllers={"none": DemandAlone(), "pid": SlipLaw(kind="pid", gains={"K": "100 1/s"})},
    )  # fmt: skip
    return Trip(**usual | changes)


def run(made, name="pid"):
    found = case(made)
    return simulate(found.loops[name], found.scenario, compile=False)


def rolled(block, ticks, **inputs):
    """Outputs of a step, tick by tick; an input is a function of the tick."""
    x, p = block.pack("state", block.start()), block.pack("param", block.param_values())
    rows = []
    for k in range(ticks):
        u = {"reset": 0.0} if "reset" in block.inputs else {}
        x, y = block.f(x, block.pack("input", u | {n: f(k) for n, f in inputs.items()}), p)
        rows.append(block.unpack("output", y))
    return {n: np.array([np.array(r[n]).ravel() for r in rows]) for n in rows[0]}


# ---- ratios --------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(0.93, 1.07), min_size=2, max_size=8), st.floats(5, 60), st.integers(0, 9))
@pytest.mark.second
def test_ratios_are_learnt_from_wheels_that_roll(worn, v, seed):
    # rims have one speed; noise of 0.3 % is averaged over 300 ticks, so 0.02 %, and three of these
    n, r = len(worn), 0.42 * np.array(worn)
    noise = np.random.default_rng(seed).normal(1, 0.003, (300, n))
    said = rolled(learnt_radii(n), 300, omega=lambda k: v / r * noise[k],
                  torque=lambda k: np.zeros(n))  # fmt: skip
    found = said["r_i"][-1]
    np.testing.assert_allclose(found / found.mean(), r / r.mean(), rtol=1.5e-3)
    assert said["known"][-1] == 1
    rims = (said["omega_n"][-1] * 0.42) / noise[-1]
    np.testing.assert_allclose(rims, rims.mean(), rtol=1.5e-3)


@pytest.mark.second
def test_nothing_is_learnt_under_torque_in_a_slide_or_too_slowly_and_a_reset_forgets():
    v, r = 15.0, np.array([0.42, 0.42, 0.40, 0.42])
    block = learnt_radii(4)

    def last(ticks=400, torque=0.0, omega=None, **more):
        wheels = omega or (lambda k: v / r)
        return rolled(block, ticks, omega=wheels, torque=lambda k: np.full(4, torque), **more)

    assert last()["r_i"][-1][2] == pytest.approx(0.40 * last()["r_i"][-1][0] / 0.42, rel=1e-6)
    for quiet in (last(torque=3e3), last(omega=lambda k: 2.0 / r)):
        np.testing.assert_array_equal(quiet["r_i"], 0.42)
        assert not quiet["learns"].any()
    # axle 1 slides down by 4 m/s^2 from tick 200 on: that is no wear
    slides = last(1500, omega=lambda k: (v - np.array([4e-3 * max(k - 200, 0), 0, 0, 0])) / r)
    assert slides["learns"][199] == 1
    assert not slides["learns"][400:].any()
    np.testing.assert_allclose(slides["r_i"][-1], slides["r_i"][199], rtol=5e-3)
    # no wheel is a third smaller than the others; and reset begins anew
    odd = last(omega=lambda k: v / np.array([0.42, 0.42, 0.28, 0.42]))["r_i"]
    assert odd.min() >= 0.9 * 0.42
    assert odd.max() <= 1.1 * 0.42
    anew = last(400, reset=lambda k: float(k == 399))
    np.testing.assert_array_equal(anew["r_i"][-1], 0.42)


@pytest.mark.parametrize(
    ("small", "believed"),
    [(0.39, None), (0.405, 0.42), *(pytest.param(*pair, marks=pytest.mark.second)
     for pair in ((0.39, 0.42), (0.40, None), (0.40, 0.42), (0.405, None)))],
)  # fmt: skip
def test_a_worn_wheelset_takes_no_brake_away_on_dry_rail(small, believed):
    # known, or learnt in the first 36 ms, before the torque has 3 % of the load
    car = replace(CAR, radius=(0.42, 0.42, small, 0.42))
    log = run(trip(vehicle=car, control=SlipControl(radius=believed)))
    asked, given_ = log["demand.T_demand"].values, log["ctl.T_cmd"].values
    late = log["time"].values > 0.2
    assert (given_[late] >= 0.99 * asked[late, None]).all()
    found = log["radius.r_i"].values[-1]
    np.testing.assert_allclose(found / found[0], np.array(car.radii) / 0.42, rtol=3e-3)
    v, by_wheels = log["plant.train.v"].values, log["speed.v_m"].values
    assert (np.abs(by_wheels - v)[late] <= log["speed.error"].values[late]).all()


def test_who_does_not_learn_loses_brake_at_first_and_the_run_says_so():
    """The smaller wheel makes the speed too high; it takes torque until the bound has grown."""
    made = trip(control=SlipControl(radius=0.42, learn=False), reference=SlipSpeed(slip=0.5))
    found = case(made)
    from slipctl import prepare

    log = prepare(found.loops["pid"], found.scenario, compile=False)(doubt=True)
    share = log["ctl.T_cmd"] / np.maximum(log["demand.T_demand"], 1)[:, None]
    assert share[200:400, :2].min() < 0.5
    assert share[-500:].min() > 0.99
    line = log.told()[0]
    assert line.startswith("the vehicle speed estimated from the wheels")
    assert "the error exceeds the" in line


def test_a_loop_of_equal_wheels_with_a_measured_speed_has_no_such_part():
    made = trip(vehicle=replace(CAR, radius=0.42), sensors=Sensors(wheel_speed=Exact()))
    assert "radius" not in case(made).loops["pid"].parts
    with pytest.raises(BadInput, match="has 3 values for 4 axles"):
        trip(control=SlipControl(radius=(0.42, 0.42, 0.39)))
    with pytest.raises(BadInput, match="no ratio to learn"):
        trip(vehicle=replace(CAR, axles=1, radius=0.42), control=SlipControl(learn=True),
             sensors=Sensors())  # fmt: skip


# ---- speed ---------------------------------------------------------------------------------------


@pytest.mark.second
def test_the_speed_goes_on_by_momentum_while_all_wheels_slide():
    # all four lock on ice: M v + sum J omega/r changes by the torques alone, so that the speed is
    # known up to the share that these may be wrong by, and what gradient and resistance may do
    ice = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="ice"),))
    made = trip(rail=ice, duration=4.0, vehicle=replace(CAR, radius=0.42))
    log = run(made, "pid")
    slides = log["slip.y"].values.min(axis=1) > 0.5
    assert slides.sum() > 2000
    off = log["plant.train.v"].values - log["speed.v_m"].values
    assert (np.abs(off) <= log["speed.error"].values).all()
    assert off.max() < 1.2  # 0.3 s of 1.5 m/s^2, as a limit of the rate alone would have, is 4.7
    assert log["speed.error"].values.max() > 1.0


@pytest.mark.parametrize(("asked", "uphill"), [(1.0, 0.0), (3.0, 0.0), (0.8, 0.05), (6.0, 0.05)])
@pytest.mark.parametrize("sensor", [WheelsOnly(), LargestWheel()])
def test_the_speed_falls_with_any_train_that_brakes_as_it_is_asked(sensor, asked, uphill):
    # every wheel slips by 10 %; an estimate that may not fall with the train is too high, and a
    # controller that believes it releases the brakes on dry rail
    made = trip(demand=Constant(deceleration=asked), actuator=Lag(torque=60e3, lag=0.06),
                rail=replace(DRY, gradient=uphill),
                sensors=Sensors(wheel_speed=Exact(), vehicle_speed=sensor))  # fmt: skip
    parts = {"ctl": bounded_speed(4)}
    vehicle_speed(made, parts, {"ctl.omega": ""})
    block = parts["speed"].with_params(v_start=10.0)
    falls = asked + 9.81 * uphill
    v = 10 - falls * 1e-3 * np.arange(100)
    pull = 0.42 * (38e3 * asked + 4 * 110 * 0.9 * falls / 0.42**2) / 4
    given = dict(omega=lambda k: np.full(4, 0.9 * v[k] / 0.42), torque=lambda k: np.full(4, pull))
    said = rolled(block, 100, **{n: f for n, f in given.items() if n in block.inputs})
    off = said["v_m"][:, 0] - v
    assert off[-1] <= off[0]


@pytest.mark.parametrize("driven", [False, True])
def test_the_speed_is_that_of_the_axle_that_slips_least(driven):
    block = bounded_speed(3, driven).with_params(v_start=15.0, r=0.4)
    rims = np.array([15.0, 15.0, 12.0] if not driven else [15.0, 15.0, 19.0])
    said = rolled(block, 2000, omega=lambda k: rims / 0.4, torque=lambda k: np.zeros(3))
    assert said["v_m"][-1] == pytest.approx(15.0, abs=0.01)
    assert said["sound"].min() == 1
    # all are gone for good: the error grows by what may be beside the torques, and it says so
    gone = np.full(3, 5.0 if not driven else 40.0)
    said = rolled(block, 8000, omega=lambda k: gone / 0.4, torque=lambda k: np.zeros(3))
    assert said["sound"][-1] == 0
    assert said["error"][-1] >= abs(said["v_m"][-1] - 15.0)


def test_a_table_of_demands_coasts_and_learns_and_then_brakes():
    steps = Profile(over="time", at=(0.0, 1.0), deceleration=(0.0, 1.2))
    log = run(trip(demand=steps, control=SlipControl(radius=0.42)))
    t, learns = log["time"].values, log["radius.learns"].values
    assert learns[(t > 0.1) & (t < 1.0)].all()
    assert not learns[t > 1.1].any()
