"""What a trip's sensors become in its loop: blocks with the numbers of the file, and wires."""

from __future__ import annotations

from dataclasses import replace

import pytest
from drawn_points import numbers

from slipctl.models.vehicle import NoisySpeed, NoisyWheel, WheelsOnly
from slipctl.models.vehicle.description import _placed
from slipctl.models.vehicle.measurement import sensor_parts
from slipctl.models.vehicle.parts import Exact, SlipControl, ToothWheel
from slipctl.models.vehicle.parts.sensors import LargestWheel, SensorFault
from tests.models.test_ends_and_demands_of_trips import TRIP

UNLIKE = replace(TRIP, vehicle=replace(TRIP.vehicle, radius=(0.5, 0.45, 0.4)))


def wheels(trip, part):
    parts = {}
    sensors = replace(trip.sensors, wheel_speed=part)
    wires = sensor_parts.wheel_speeds(replace(trip, sensors=sensors), parts)
    return parts, wires


def test_wheel_speeds_are_exact_noisy_or_those_of_teeth():
    assert wheels(TRIP, Exact()) == ({}, {"ctl.omega": "plant.omega"})
    noisy = NoisyWheel(deviation=0.02, step=0.05, dropout=0.07)
    parts, wires = wheels(TRIP, noisy)
    assert wires == {"wheel.u": "plant.omega", "ctl.omega": "wheel.y"}
    found = numbers(parts["wheel"])
    assert (found["sigma"], found["q"], found["lost"]) == (0.02, 0.05, 0.07)
    assert found["u_start"] == 0  # one number, which follows the speed
    parts, _ = wheels(UNLIKE, noisy)
    assert numbers(parts["wheel"])["u_start"] == pytest.approx([40.0, 20 / 0.45, 50.0])
    tooth = ToothWheel(teeth=77, clock=2e-6, jitter=3e-6)
    parts, wires = wheels(TRIP, tooth)
    assert wires == {"angle.omega": "plant.omega", "wheel.phi": "angle.phi",
                     "ctl.omega": "wheel.omega_m"}  # fmt: skip
    found = numbers(parts["wheel"])
    assert (found["N"], found["clock"], found["sigma"]) == (77, 2e-6, 3e-6)
    assert parts["angle"].outputs["phi"].shape == (3,)
    assert "every" not in parts["wheel"].choices
    parts, _ = wheels(UNLIKE, tooth)
    assert numbers(parts["wheel"])["omega_start"] == pytest.approx([40.0, 20 / 0.45, 50.0])
    parts, _ = wheels(replace(TRIP, control=SlipControl(period=0.01)), tooth)
    assert parts["wheel"].choices["every"] == 10
    assert numbers(parts["wheel"])["T"] == 0.01


def test_a_driven_vehicle_has_sensors_on_its_driven_axles():
    driven = replace(UNLIKE, vehicle=replace(UNLIKE.vehicle, mode="drive", driven=(1, 3)))
    parts, _ = wheels(driven, NoisyWheel())
    assert parts["wheel"].outputs["y"].shape == (2,)
    assert numbers(parts["wheel"])["u_start"] == pytest.approx([40.0, 50.0])


def speed(trip, part):
    parts, wires = {}, {"ctl.omega": "wheel.y"}
    sensors = replace(trip.sensors, vehicle_speed=part)
    at = sensor_parts.vehicle_speed(replace(trip, sensors=sensors), parts, wires)
    return at, parts, wires


def test_the_vehicle_s_speed_is_exact_noisy_or_of_its_wheels():
    assert speed(TRIP, Exact()) == ("plant.train.v", {}, {"ctl.omega": "wheel.y"})
    at, parts, wires = speed(TRIP, NoisySpeed(deviation=0.2, step=0.1, dropout=0.3))
    found = numbers(parts["speed"])
    assert (at, found["sigma"], found["q"], found["lost"]) == ("speed.y", 0.2, 0.1, 0.3)
    assert wires["speed.u"] == "plant.train.v"
    assert "speed.omega" not in wires
    at, parts, wires = speed(TRIP, LargestWheel(rate=1.7))
    assert (at, numbers(parts["speed"])["a_max"]) == ("speed.v_m", 1.7)
    assert wires == {"ctl.omega": "wheel.y", "speed.omega": "wheel.y"}
    usual = speed(TRIP, LargestWheel())[1]["speed"]
    assert numbers(usual)["a_max"] == pytest.approx(TRIP.fastest_change)
    at, parts, wires = speed(TRIP, WheelsOnly(rate=1.9, margin=0.3, beside=0.22))
    found = numbers(parts["speed"])
    assert (at, found["a_max"], found["margin"], found["beside"]) == ("speed.v_m", 1.9, 0.3, 0.22)
    assert wires["speed.torque"] == "plant.T"
    found = numbers(speed(TRIP, WheelsOnly())[1]["speed"])
    assert found["beside"] == pytest.approx(0.15)  # gradient and resistance are less
    assert found["a_max"] == pytest.approx(TRIP.fastest_change)
    uphill = replace(TRIP, rail=replace(TRIP.rail, gradient=0.04))
    found = numbers(speed(uphill, WheelsOnly())[1]["speed"])
    assert found["beside"] == pytest.approx(uphill.beside_torques)
    assert uphill.beside_torques > 0.4


def test_a_sensor_that_fails_twice_is_two_one_behind_the_other():
    faults = (
        SensorFault(axle=2, kind="jumps", time=4.0, share=0.3),
        SensorFault(axle=1, kind="missing", time=2.0),
        SensorFault(axle=2, kind="frozen", time=1.0),
    )
    trip = replace(TRIP, sensors=replace(TRIP.sensors, faults=faults))
    parts = {}
    wires = sensor_parts.with_faults(
        trip, parts, {"ctl.omega": "wheel.y", "wheel.u": "plant.omega"}
    )
    assert list(parts) == ["fault", "fault_again"]
    assert wires == {"wheel.u": "plant.omega", "fault.u": "wheel.y", "fault_again.u": "fault.y",
                     "ctl.omega": "fault_again.y"}  # fmt: skip
    first, second = parts.values()
    assert first.choices["kinds"] == ("missing", "frozen", "")
    assert second.choices["kinds"] == ("", "jumps", "")
    assert numbers(first)["begin"] == [2.0, 1.0, 0.0]
    assert numbers(first)["share"][2] == 0
    assert numbers(second)["begin"] == [0.0, 4.0, 0.0]
    assert numbers(second)["share"] == [0.0, 0.3, 0.0]
    same = {"ctl.omega": "wheel.y"}
    assert sensor_parts.with_faults(TRIP, parts, same) == same


def test_speeds_are_brought_to_one_radius_where_wheels_differ():
    measured = {"ctl.omega": "wheel.y"}
    parts = {}
    assert sensor_parts.at_one_radius(TRIP, parts, measured) == measured
    assert parts == {}
    found = sensor_parts.at_one_radius(UNLIKE, parts, measured)
    assert found == {"radius.omega": "wheel.y", "ctl.omega": "radius.omega_n"}
    assert numbers(parts["radius"]) == {
        "r": pytest.approx(0.45),
        "worn": pytest.approx([0.5 / 0.45, 1.0, 0.4 / 0.45]),
    }
    learns = replace(UNLIKE, control=replace(UNLIKE.control, learn=True))
    found = sensor_parts.at_one_radius(learns, parts, measured)
    assert found["radius.torque"] == "plant.T"
    own = numbers(parts["radius"])
    assert (own["m_axle"], own["g"], own["r"]) == (9e3, 9.7, pytest.approx(0.45))
    alike = replace(TRIP, control=replace(TRIP.control, learn=True))
    assert sensor_parts.at_one_radius(alike, parts, measured)["ctl.omega"] == "radius.omega_n"
    assert numbers(parts["radius"])["worn"] == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(("above", "line", "keys", "said"), [
    ("reference", "layer.mu_9: no such number", ("reference", "layer", "mu_9"), "no such number"),
    ("reference", "condition: it has none", ("reference", "condition"), "it has none"),
    ("controllers", "gains.K: is off range", ("controllers", "K"), "is off range"),
    ("rail", "rail.sections.2.condition: the", ("rail", "sections", 2, "condition"), "the"),
    ("rail", "rail.conditions.dry.c = 7 is", ("rail", "conditions", "dry", "c"), "7 is"),
    ("rail", "something else is wrong", ("rail",), "something else is wrong"),
])  # fmt: skip
def test_a_fault_stands_below_its_keys(above, line, keys, said):
    assert _placed((above,), line) == (keys, said)
