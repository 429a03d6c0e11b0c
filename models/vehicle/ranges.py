"""What the numbers of a vehicle's slip control can be, so that its C knows a wrong sample.

Ends follow from the trip: its speed, wheels, largest torque and sensors. They are wide, because a
value beyond its range is not taken, and one that is further from the last than physics allows
neither. A law of the user's own keeps the ranges that it declares.
"""

from __future__ import annotations

from math import log, pi, sqrt

from slipctl import Block
from slipctl.models.common_form import T_S, Wheel
from slipctl.models.ranges import FLAG, of_those
from slipctl.models.vehicle.parts import (
    Exact,
    NoisySpeed,
    NoisyWheel,
    ToothWheel,
    Trip,
    WheelsOnly,
)

SURE = 8.0
"""Standard deviations that a noise never leaves."""

Row = tuple[float, float, str, float, float]


def with_control_ranges(block: Block, trip: Trip, w: Wheel) -> Block:
    """Declare the ranges of the control of one axle: of what it measures and of what it holds."""
    speed, spin = _speed(trip, w), _wheel(trip, w)
    turning = (*spin[:2], "as that which is measured")
    slip = speed[1] + 1.1 * w.r * spin[1]  # radii of the axles differ by less than a tenth
    slipping = (-slip, slip, "a wheel that spins, either way, and the vehicle's speed")
    far = 250 * w.T_max
    rows: dict[str, tuple] = {
        "v": speed,
        "omega": spin,
        "T": (-1.25 * w.T_max, 1.25 * w.T_max, "a quarter more than the largest, either way"),
        "T_demand": (-far, far, "250 times the largest torque; it is limited"),
        "slip.v_s": slipping,
        "slip.omega_s": turning,
        "meter.omegas": turning,
        "meter.torques": (-1.25 * w.T_max, 1.25 * w.T_max, "as that which is measured"),
        "meter.slips": slipping,
        "meter.n": (-40, 40, "unit normal noise, none of which a controller has"),
        "meter.mu_m": (-1e3, 1e3, "a wheel that stops within a tick has a hundred"),
        "meter.v_s_m": slipping,
        "estimator.kept": slipping,
        "watch.ruling": (0, 1, FLAG),
        "watch.on": (0, 1, FLAG),
        "watch.idle": (0, 1e9, "it counts on where slip control rules from the start"),
        "reference.v_best": (0, max(20.0, speed[1]), "no more than the speed"),
    }
    return of_those(block, rows)


def _speed(trip: Trip, w: Wheel) -> Row:
    """Speed of the vehicle as it is measured: ends, source, change per tick and noise."""
    most = max(120.0, 1.5 * trip.vehicle.speed)
    part, why = trip.sensors.vehicle_speed, "430 km/h, or half as much again as at the start"
    if isinstance(part, WheelsOnly):
        _, _, _, change, noise = _wheel(trip, w)
        return -1.0, most, f"{why}; as the wheels", w.r * change, w.r * noise
    change = 10 * T_S
    noise = 0.5 + (_noise(part, change) if isinstance(part, NoisySpeed) else 0.0)
    return -1.0 - noise, most + noise, f"{why}; 10 m/s^2, and its sensor", change, noise


def _wheel(trip: Trip, w: Wheel) -> Row:
    """Speed of a wheel as it is measured; it gains what twice its torque and an adhesion of 2 do.

    A tooth wheel tells a speed at an edge, at the latest when the wheel has turned by a tooth. From
    rest it has sqrt(2 alpha 2 pi/N) by then.
    """
    part = trip.sensors.wheel_speed
    alpha = 2 * (w.T_max + w.W * w.g * w.r) / w.J
    change, most = alpha * T_S, 1.5 * max(120.0, trip.vehicle.speed) / w.r
    noise = 0.1
    if isinstance(part, NoisyWheel):
        noise += _noise(part, change)
    elif isinstance(part, ToothWheel):
        tooth, usual = 2 * pi / part.teeth, 1.2 * max(trip.vehicle.speed, 1.0) / w.r
        noise += sqrt(2 * alpha * tooth) + usual**2 / tooth * (SURE * part.jitter + 2 * part.clock)
    else:
        assert isinstance(part, Exact)
    return -most, most, "a wheel that spins free; its torque and the rail turn it", change, noise


def _noise(part: NoisyWheel | NoisySpeed, change: float) -> float:
    """Of a sensor with noise and steps, which loses samples: in 1e9 of them so many in a row."""
    lost = log(1e-9) / log(part.dropout) if part.dropout > 0 else 0.0
    return SURE * part.deviation + part.step + lost * change
