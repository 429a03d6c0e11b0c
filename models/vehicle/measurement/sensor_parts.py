"""What is measured on a trip, and what its sensors read wrong: parts of the loop, and wires."""

from __future__ import annotations

import numpy as np

from slipctl import Block, every, replicate
from slipctl.models import sensors
from slipctl.models.vehicle.measurement.fused_speed import accelerometer, fused_speed, largest_wheel
from slipctl.models.vehicle.parts import (
    TICK,
    Exact,
    Fused,
    LargestWheel,
    NoisySpeed,
    NoisyWheel,
    ToothWheel,
    Trip,
    WheelsOnly,
)
from slipctl.models.vehicle.parts.sensors import SensorFault
from slipctl.models.vehicle.wheels import bounded_speed, known_radii, learnt_radii


def wheel_speeds(trip: Trip, parts: dict[str, Block]) -> dict[str, str]:
    """Add the sensors of the wheels; gives their wires."""
    part, n = trip.sensors.wheel_speed, len(trip.vehicle.worked)
    radii = {trip.vehicle.radii[k] for k in trip.vehicle.worked}
    begin = trip.vehicle.speed / np.array([trip.vehicle.radii[k] for k in trip.vehicle.worked])
    apart = ["omega_start"] if radii != {trip.vehicle.wheel_radius} else []
    if isinstance(part, Exact):
        return {"ctl.omega": "plant.omega"}
    if isinstance(part, NoisyWheel):
        sensor = sensors.noisy_sensor("rad/s").with_params(
            sigma=part.deviation, q=part.step, lost=part.dropout
        )
        own = ["u_start"] * len(apart)
        parts["wheel"] = replicate(sensor, n, distinct=own).with_params(**dict.fromkeys(own, begin))
        return {"wheel.u": "plant.omega", "ctl.omega": "wheel.y"}
    assert isinstance(part, ToothWheel)
    parts["angle"] = replicate(sensors.turned, n)
    tooth = sensors.tooth_wheel.with_params(N=part.teeth, clock=part.clock, sigma=part.jitter)
    parts["wheel"] = replicate(tooth, n, distinct=apart).with_params(**dict.fromkeys(apart, begin))
    if trip.control.period != TICK:  # a counter card is read by the controllers, at their period
        slow = parts["wheel"].with_params(T=trip.control.period)
        parts["wheel"] = every(slow, round(trip.control.period / TICK))
    return {
        "angle.omega": "plant.omega", "wheel.phi": "angle.phi", "ctl.omega": "wheel.omega_m",
    }  # fmt: skip


def vehicle_speed(trip: Trip, parts: dict[str, Block], wires: dict[str, str]) -> str:
    """Add the sensor of the vehicle's speed; gives where it is read."""
    part = trip.sensors.vehicle_speed
    if isinstance(part, Exact):
        return "plant.train.v"
    if isinstance(part, NoisySpeed):
        parts["speed"] = sensors.noisy_sensor("m/s").with_params(
            sigma=part.deviation, q=part.step, lost=part.dropout
        )
        wires["speed.u"] = "plant.train.v"
        return "speed.y"
    many = len(trip.vehicle.worked)
    wires["speed.omega"] = wires["ctl.omega"]
    if isinstance(part, LargestWheel):
        parts["speed"] = largest_wheel(many).with_params(a_max=part.rate or trip.fastest_change)
        return "speed.v_m"
    wires["speed.torque"] = "plant.T"
    if isinstance(part, WheelsOnly):
        block = bounded_speed(many, trip.vehicle.mode == "drive")
        known = max(0.15, trip.beside_torques)
        parts["speed"] = block.with_params(
            a_max=part.rate or trip.fastest_change, margin=part.margin,
            beside=known if part.beside is None else part.beside,
        )  # fmt: skip
        return "speed.v_m"
    assert isinstance(part, Fused)
    meter = trip.sensors.accelerometer
    assert meter is not None
    parts["accel"] = accelerometer().with_params(
        bias=meter.bias, sigma=meter.deviation, feels=float(meter.gradient)
    )
    parts["speed"] = fused_speed(
        many, part.spread, part.wander, meter.deviation, TICK, trip.vehicle.speed
    )
    wires |= {"accel.a": "plant.train.a", "speed.a": "accel.a_m"}
    if "wake.on" in parts["ctl"].outputs:
        wires["speed.controlled"] = "ctl.wake.on"
    return "speed.v_m"


def with_faults(trip: Trip, parts: dict[str, Block], measured: dict[str, str]) -> dict[str, str]:
    """Add what fails of the wheel sensors; gives the wires.

    A sensor that fails twice is two of them, one behind the other: the later fault is the last.

    Args:
        trip: the trip.
        parts: of the loop.
        measured: the wires of the sensors.
    """
    left = sorted(trip.sensors.faults, key=lambda f: f.time)
    n, wires, name = len(trip.vehicle.worked), dict(measured), "fault"
    while left:
        faults: dict[int, SensorFault] = {}
        for f in left:
            faults.setdefault(f.axle - 1, f)
        rows = [faults.get(k) for k in range(n)]
        left = [f for f in left if all(f is not first for first in rows)]
        parts[name] = sensors.wheel_sensors_with_faults(
            n, [f.kind if f else "" for f in rows]
        ).with_params(
            begin=np.array([f.time if f else 0.0 for f in rows]),
            share=np.array([f.share if f else 0.0 for f in rows]),
        )
        wires |= {f"{name}.u": wires["ctl.omega"], "ctl.omega": f"{name}.y"}
        name += "_again"
    return wires


def at_one_radius(trip: Trip, parts: dict[str, Block], measured: dict[str, str]) -> dict[str, str]:
    """Add what brings the wheel speeds to the controllers' radius, where they differ; gives wires.

    Args:
        trip: the trip.
        parts: of the loop.
        measured: the wires of the sensors.
    """
    n, r = len(trip.vehicle.worked), trip.one_radius
    worn = np.array(trip.believed) / r
    if not trip.learns and (worn == 1).all():
        return measured
    block = learnt_radii(n) if trip.learns else known_radii(n)
    numbers = {"r": r, "m_axle": trip.vehicle.total / trip.vehicle.axles, "g": trip.vehicle.gravity}
    parts["radius"] = block.with_params(
        worn=worn, **{k: v for k, v in numbers.items() if k in block.params}
    )
    found = measured | {"radius.omega": measured["ctl.omega"], "ctl.omega": "radius.omega_n"}
    return found | ({"radius.torque": "plant.T"} if trip.learns else {})
