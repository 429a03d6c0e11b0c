"""A driven vehicle whose wheel speeds read zero, in motion and at a stand: two things to tell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slipctl import prepare
from slipctl.models.vehicle import Constant, Exact, Lag, Sensors, Stretch, Track, Trip, Vehicle
from slipctl.models.vehicle.failure import MOVES, TRIED
from slipctl.models.vehicle.measurement.axle_samples import HOLD, SETTLED
from slipctl.models.vehicle.parts import (
    NoisySpeed,
    SensorFault,
    SlipLaw,
    SlipSpeed,
    WheelsOnly,
)
from slipctl.models.vehicle.trip import case
from tests.models.test_failure import Car, H, R

SOUND = Sensors(wheel_speed=Exact(), vehicle_speed=Exact())


def run(v, duration, sensors=SOUND, condition="wet"):
    """Log of a locomotive of 80 t with ``pid`` that is to accelerate by 1.2 m/s^2."""
    found = case(Trip(
        duration=duration, actuator=Lag(torque=40e3), demand=Constant(acceleration=1.2),
        vehicle=Vehicle(mass=80e3, inertia=300.0, radius=0.6, speed=v, mode="drive"),
        rail=Track(law="exponential_tail", sections=(Stretch(place=0.0, condition=condition),)),
        sensors=sensors, reference=SlipSpeed(slip=1.0),
        controllers={"pid": SlipLaw(kind="pid", gains={"K": 10.0})},
    ))  # fmt: skip
    return prepare(found.loops["pid"], found.scenario, compile=False)()


@pytest.mark.parametrize("axles", [2, 4])
@pytest.mark.parametrize("v", [10.0, 0.0])
def test_wheels_that_lose_their_supply_do_not_spin_up(v, axles):
    """In motion at once; at a stand 1 s after the vehicle's sensor tells 1 m/s."""
    begin = 0.5 if v else 0.0
    faults = [SensorFault(axle=k + 1, kind="jumps", time=begin, share=-1.0) for k in range(axles)]
    log = run(v, 4.0, replace(SOUND, faults=tuple(faults)))
    slip, since = log["plant.train.v_s"].max(axis=1), log["time"] - begin
    if v:
        assert slip.max() < 1.1  # as held before
    moves = since[(log["plant.train.v"] >= MOVES) & (since > 0)][0]
    late = since > moves + (HOLD + 0.05 if v else TRIED + 0.1)
    assert (np.asarray(log["ctl.T_cmd"])[since > moves + TRIED + 0.1] == 0).all()
    assert (np.diff(slip[late]) <= 0.01).all()


@pytest.mark.parametrize("speed", [Exact(), NoisySpeed(deviation=0.05), WheelsOnly()],
                         ids=lambda s: s.kind)  # fmt: skip
def test_a_vehicle_starts_by_whatever_tells_its_speed(speed):
    log = run(0.0, 2.0, Sensors(vehicle_speed=speed), "dry")
    assert log["plant.train.v"][-1] > 0.9 * 1.2 * (2.0 - 0.1)  # lag, and mass that turns


@pytest.mark.parametrize("read", [math.nan, 0.0, 3.0, 20.0])
@pytest.mark.parametrize("added", [False, True])
def test_a_vehicle_starts_whatever_the_sensor_of_its_speed_reads(read, added):
    """The wheels turn and are believed, whether it is stuck there or off by that."""
    car = Car([4e3] * 4000, speed=0.0, driven=True)
    true = car.v.copy()
    car.v = read + added * true
    got = car.judged(start=0.0)
    assert got["ready"][round(SETTLED / H) :].all()
    assert np.abs(got["v"] - true).max() < 0.1


@pytest.mark.parametrize("demand", [0.0, 4e3], ids=["none", "kept"])
def test_a_vehicle_that_stopped_with_a_frozen_sensor_starts_again(demand):
    """When it is asked to. Where the demand was kept while it stopped, that is taken back first."""
    car = Car(np.repeat([0.0, 4e3], [4000, 2000]), driven=True)
    true = np.interp(np.arange(6000), [0, 500, 2000, 4200, 5999], [10, 10, 0, 0, 1.2])
    car.v, car.omega = np.maximum(true, 10.0), np.repeat(true[:, None], 4, axis=1) / R
    car.T_demand[:3500] = demand
    ready = car.judged(start=10.0)["ready"]
    assert ready[2500:3500].any() == (demand == 0)
    assert ready[3600:].all()


@pytest.mark.parametrize("axles", [2, 3, 4])
def test_axles_are_believed_again_when_their_sensors_are(axles):
    car = Car([4e3] * 3000, driven=True)
    car.omega[500:1500, :axles] = 0.0
    ready = car.judged()["ready"]
    assert not ready[500 + round(HOLD / H) : 1500, :axles].any()
    assert ready[2000:].all()
