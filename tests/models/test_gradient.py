"""A gradient in the plants: a free train falls with gravity, and its accelerometer shows none."""

import numpy as np
import pytest

from slipctl import Rail, Scenario, Section, connect, prepare, sampled, simulate
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.shared_names import GRADIENT, SHARED
from slipctl.models.vehicle import (
    Constant,
    DemandAlone,
    Exact,
    Lag,
    Sensors,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.parts.vehicle import Davis
from slipctl.models.wang_2025 import hst_traction as wang
from slipctl.models.zhang_2021 import hst_braking as hst
from slipctl.models.zhang_2021.hst_braking_estimate import accelerometer

SLOPES = (0.03, -0.03)
NONE = {
    "subway": ("air.k0", "air.k1", "air.k2"),
    "hst": (),
    "freight": ("res.a1", "res.a2", "res.a3"),
    "hst_traction": ("w_0", "w_1", "w_2", "B_t"),
}
"""Resistances, which are set to 0."""


def coasting(name: str):
    """Plant without torque and resistance, its start speed, inputs, and inertia over mass."""
    if name == "subway":
        p = subway.plant()
        return sampled(p, 1e-4, "rk4"), "wheel.v", {"T_cmd": 0.0}, 240.0 / 0.5**2 / 8000.0
    if name == "hst":
        p = hst.plant()
        return sampled(p, 1e-4, "rk4"), "wheel.v", {"T_b": 0.0}, 4 * 60.35 / 0.43**2 / 13800.0
    if name == "freight":
        p, turning = freight.plant(), 8 * 40.0 * 6.294**2 / 0.625**2 / 6e6
        return sampled(p, 2e-4, "rk4", substeps=2), "train.v_t", {"T_cmd": 0.0}, turning
    p = wang.plant()
    return p, "train.v", {"F_contr": 0.0}, 32 * 93.75 / 0.445**2 / 500e3


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("name", ["subway", "hst", "freight", "hst_traction"])
def test_a_free_train_follows_the_gradient(name, slope):
    """v' = -g slope/(1 + n J/(m r^2)): rolling wheels take their share of the energy."""
    block, speed, inputs, turning = coasting(name)
    block = block.with_params(slope=slope, **dict.fromkeys(NONE[name], 0.0))
    log = simulate(block, Scenario("s", 2.0, inputs=inputs, start={speed: 20.0}), compile=True)
    v, g = log[speed].values, float(block.param_values()["g"])
    # the last second, when the creep has settled; it stays below 1 % of the speed that is lost
    fall = (v[-1] - v[v.size // 2]) / (log.time.values[-1] - log.time.values[v.size // 2])
    assert fall == pytest.approx(-g * slope / (1 + turning), rel=2e-3)


def test_the_accelerometer_shows_the_contact_force_alone():
    """a_m = a + g slope: gravity along the track acts on the proof mass as on the train."""
    plant = sampled(hst.plant(), 1e-3, "rk4", substeps=10)
    loop = connect(
        "loop", {"meter.a": "plant.wheel.a"}, share=SHARED | GRADIENT, plant=plant,
        meter=accelerometer,
    )  # fmt: skip
    scenario = (
        Scenario("s", 0.5, inputs={"T_b": -2000.0})
        if "T_b" in loop.inputs
        else Scenario("s", 0.5, inputs={"plant.T_b": -2000.0})
    )
    for slope in (0.0, *SLOPES):
        log = simulate(loop.with_params(slope=slope), scenario, compile=False)
        force = 4 * log["plant.wheel.F_a"].values / 13800.0
        np.testing.assert_allclose(log["meter.a_m"].values, force, atol=1e-12)


def test_the_energy_of_the_train_goes_into_its_height():
    """Sum of powers of the implicit step, which is an identity, on a gradient."""
    block = wang.plant().with_params(slope=0.02)
    log = simulate(
        block, Scenario("s", 4.0, inputs={"F_contr": 150e3}, start={"train.v": 10.0}),
        compile=True,
    )  # fmt: skip
    v, x = log["train.v"].values, log["train.x"].values
    omega = log["train.omega"].values
    energy = 500e3 * v**2 / 2 + 93.75 / 2 * (omega**2 @ np.array([10.0, 22.0]))
    powers = (log["train.P_drive"] - log["train.P_brake"] - log["train.P_bearing"]
              - log["train.P_slip"]).values  # fmt: skip
    V = 3.6 * v
    davis = (6.796 + 0.062 * V + 0.00143 * V**2) * 500.0  # N, of eq (4)
    height = 500e3 * 9.8 * 0.02 * (x[1:] - x[:-1])
    mean = (v[1:] + v[:-1]) / 2
    work = 1e-3 * (powers[:-1] - davis[:-1] * mean) - height
    # roundings of 3e7 J in each of 4000 ticks
    assert np.diff(energy) == pytest.approx(work, abs=1e-5)


def test_a_rail_sets_the_gradient_section_by_section():
    rail = Rail([Section(0, values={"slope": 0.02}), Section(0.5, values={"slope": -0.02})])
    block = subway.ideal_plant()
    plant = sampled(block, 1e-3, "rk4")
    log = simulate(
        plant, Scenario("s", 1.0, rail, inputs={"v_opt": 1.21}), compile=False
    )  # fmt: skip
    flat = simulate(plant, Scenario("s", 1e-3, inputs={"v_opt": 1.21}), compile=False)
    a = log["wheel.a"].values
    assert a[0] - flat["wheel.a"].values[0] == pytest.approx(9.81 * 0.02)
    # the air slows it by little less at the lower speed
    assert a[510] - a[490] == pytest.approx(-2 * 9.81 * 0.02, abs=2e-3)


# ---- a vehicle of a file that rolls back, and one that its resistance holds ----------------------

MASS, SHARE = 38e3, 1 + 4 * 110.0 / 0.42**2 / 38e3


def rolled(speed: float, slope: float, resistance: Davis, duration: float, mode="brake", **demand):
    """Speed, place and what is told of a vehicle without slip control."""
    found = case(Trip(
        duration=duration, vehicle=Vehicle(mass=MASS, inertia=110.0, speed=speed, mode=mode,
                                           resistance=resistance),
        actuator=Lag(torque=8e3), demand=Constant(**demand or {"deceleration": 0.0}),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),), gradient=slope),
        sensors=Sensors(wheel_speed=Exact()), controllers={"none": DemandAlone()},
    ))  # fmt: skip
    log = prepare(found.loops["none"], found.scenario, compile=False)(doubt=True)
    return log, log.told()


def test_resistance_opposes_a_vehicle_that_rolls_back() -> None:
    """Its linear part too; and the run says that the vehicle rolls back, not that it is wrong."""
    a, b, push = 500.0, 500.0, MASS * 9.81 * 0.02
    log, told = rolled(1.0, 0.02, Davis(a=a, b=b), 40.0)
    k = b / (MASS * SHARE)
    turn = np.log(1 + b * 1.0 / (push + a)) / k
    back = (push - a) / b * (1 - np.exp(-k * (log["time"][-1] - turn)))
    assert log["plant.train.v"][-1] == pytest.approx(-back, rel=1e-3)
    assert len(told) == 1
    assert told[0].startswith("the vehicle rolls back from ")
    x = log["plant.train.x"]
    assert f", {x.max() - x[-1]:.4g} m and up to {back:.3g} m/s" in told[0]


@pytest.mark.parametrize(("speed", "slope"), [(0.3, -0.005), (0.0, -0.005), (0.0, 0.005)])
def test_resistance_holds_a_vehicle_that_stands(speed: float, slope: float) -> None:
    """Below its constant part: v0^2/(2 a) to a stand at v = 0 exactly, books in balance."""
    log, told = rolled(speed, slope, Davis(a=3e3), 12.0)
    v, x = log["plant.train.v"], log["plant.train.x"]
    a = (3e3 + MASS * 9.81 * slope) / (MASS * SHARE)
    assert v[-1] == 0
    assert told == []
    assert x[-1] == pytest.approx(speed**2 / (2 * a), rel=5e-3, abs=1e-12)
    taken = sum(log[f"plant.train.{n}"] for n in ("P_brake", "P_slip", "P_d"))
    held = 0.5 * MASS * SHARE * speed**2
    assert 1e-3 * taken.sum() == pytest.approx(held, rel=1e-2, abs=1e-9)


@pytest.mark.second
def test_a_motor_has_to_overcome_the_resistance_first() -> None:
    log, _ = rolled(0.0, 0.0, Davis(a=3e3), 5.0, "drive", acceleration=0.05)
    assert (log["plant.train.v"] == 0).all()
    log, _ = rolled(0.0, 0.0, Davis(a=3e3), 5.0, "drive", acceleration=0.1)
    assert log["plant.train.v"][-1] == pytest.approx((0.1 - 3e3 / MASS / SHARE) * 4.9, rel=0.03)


def test_a_train_that_has_not_started_has_not_come_to_a_stand() -> None:
    """A motor behind a dead time, longer than a stand lasts until the run ends."""
    found = case(Trip(
        duration=60.0, end="standstill",
        vehicle=Vehicle(mass=MASS, inertia=110.0, speed=0.0, mode="drive",
                        resistance=Davis(a=8e3)),
        actuator=Lag(torque=8e3, dead_time=0.6), demand=Constant(acceleration=0.6, until="5 s"),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),)),
        sensors=Sensors(wheel_speed=Exact()), controllers={"none": DemandAlone()},
    ))  # fmt: skip
    v = simulate(found.loops["none"], found.scenario, compile=False)["plant.train.v"].values
    assert v.max() == pytest.approx((0.6 - 8e3 / MASS / SHARE) * 4.95, rel=0.02)
    assert v[-1] == 0
    assert 10 < 1e-3 * v.size < 30
