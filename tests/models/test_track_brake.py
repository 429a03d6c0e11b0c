"""Magnets on the rails: a stop in closed form, their energy in the books, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from slipctl import simulate
from slipctl.errors import BadInput
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
from slipctl.models.vehicle.books import TAKEN, energy_error
from slipctl.models.vehicle.parts import TrackBrake
from slipctl.models.vehicle.study import study

MASS, J, R = 40e3, 100.0, 0.46
TURNING = MASS + 4 * J / R**2
MAGNETS = TrackBrake(attraction=2e5, friction=0.2, fall=0.0, delay=0.5, above=5.0)


def trip(magnets=MAGNETS, force=0.0, **changes):
    vehicle = Vehicle(mass=MASS, inertia=J, radius=R, speed=20.0, track_brake=magnets)
    usual = dict(
        duration=30.0, vehicle=vehicle, actuator=Lag(torque=8e3),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),)),
        demand=Constant(force=force), sensors=Sensors(wheel_speed=Exact()),
        controllers={"none": DemandAlone()},
    )  # fmt: skip
    return Trip(**usual | changes)


def run(made):
    found = case(made)
    names = ["plant.train.x", "plant.train.v", *(f"plant.train.{n}" for n in
             ("E_kin", "P_drive", "P_d", *TAKEN))]  # fmt: skip
    return simulate(found.loops["none"], found.scenario, log=list(dict.fromkeys(names)))


def test_it_slows_down_by_its_friction_from_its_delay_to_its_least_speed():
    """No wheel brakes: v stays, then falls at mu F/M, wheels turning along, then stays again."""
    log = run(trip(duration=20.0))
    t, v = log["time"].values, log["plant.train.v"].values
    a = 0.2 * 2e5 / TURNING
    falls = np.clip(20 - a * (t - 0.5), 5.0, 20.0)
    # creep takes up the inertia of the wheels within a few ticks; one tick at the end, a T
    assert np.abs(v - falls).max() < 0.02
    assert v[-1] == pytest.approx(5.0, abs=2e-2)


def test_its_friction_falls_with_the_speed():
    """v' = -c/(1 + k v): t = ((v_0 - v) + k (v_0^2 - v^2)/2)/c."""
    log = run(trip(replace(MAGNETS, fall=0.05, delay=0.0), duration=6.0))
    v, c = log["plant.train.v"].values, 0.2 * 2e5 / TURNING
    k = int(np.argmax(v < 10.0))
    took = ((20 - v[k]) + 0.05 * (400 - v[k] ** 2) / 2) / c
    assert log["time"].values[k] == pytest.approx(took, rel=2e-3)


@pytest.mark.second
def test_its_energy_is_in_the_books_and_wheel_brakes_add():
    log = run(trip(force=3e4, end="standstill"))
    assert np.abs(energy_error(log)).max() < 1e-9
    assert log["plant.train.v"].values[-1] < 0.02
    alone = run(trip(None, force=3e4, end="standstill"))
    assert float(log["plant.train.x"][-1]) < 0.7 * float(alone["plant.train.x"][-1])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"above": 30.0}, "track_brake.above: is 30 m/s, the vehicle begins at 20 m/s"),
        ({"delay": 0.0005}, "delay: 0.5 ms is no whole number of samples"),
        ({"attraction": 0.0}, "attraction: 0 N is outside"),
    ],
)
def test_what_cannot_be_is_refused(changes, says):
    with pytest.raises(BadInput, match=says):
        trip(replace(MAGNETS, **changes))


def test_a_driven_vehicle_has_none_and_no_certificate_is_made_of_one_that_has():
    with pytest.raises(BadInput, match="track_brake: is of a braked vehicle"):
        Vehicle(mode="drive", mass=MASS, inertia=J, speed=20.0, track_brake=MAGNETS)
    from slipctl.models.vehicle import SlipLaw

    asked = study(trip(force=3e4, controllers={"sta": SlipLaw(kind="sta")}))
    assert "track brake" in asked.certificates.uncertified["sta"]
    assert not asked.certificates.gains
