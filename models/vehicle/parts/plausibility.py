"""Numbers of a vehicle's file that may be, and that no train has: what a run tells of them.

What cannot be is refused where it is declared (``parts``). What is here runs, and is right for what
was written. The ends are wide: they are for units and commas that slipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from slipctl.errors import nearest
from slipctl.models.vehicle.adhesion import heights_of_law, rail_law
from slipctl.models.vehicle.parts import Constant, SlipRatio, SlipSpeed, ToothWheel, Trip
from slipctl.study.resolve import load_block

AXLE_LOAD = (2.5e3, 40e3)
"""kg on an axle: a light railcar, and the heaviest ore wagons (37.5 t) with a margin."""

TURNING = 0.4
"""Share of a vehicle's mass that turns: 5 to 15 % of coaches, 25 to 35 % of locomotives."""

DRAG = 0.5
"""Deceleration in m/s^2 by running resistance: 0.1 at 300 km/h."""

HEIGHTS = (0.01, 0.7)
"""Peak adhesion: below that of leaves and ice, above that of dry rail (0.6 measured)."""

RADII = (0.25, 0.7)
"""Wheel radius in m: of low-floor trams, and of locomotives with a margin."""

LITTLE = 0.02
"""Acceleration in m/s^2 that all actuators together give: 0.06 of a heavy freight train."""

MUCH = 6.0
"""The same: no rail carries more (0.6 measured)."""

FAST = 120.0
"""Speed in m/s: the record on rails is 160."""

SPARSE = 0.05
"""Time in s between two teeth at the speed of the start."""


SHORT = {"m": 1.0, "s": 0.1}
"""Shortest stretch of rail or demand: below that, no brake has answered when it is over."""

NOISY = 1.0
"""Standard deviation in m/s of a measured speed: 0.3 of a poor radar."""


def unusual_numbers(trip: Trip) -> Iterator[str]:
    """What of a trip no train has, a line each."""
    vehicle = trip.vehicle
    mass = "vehicle.mass" if vehicle.mass is not None else "vehicle.tare"
    mass = "vehicle.cars" if vehicle.cars else mass
    load = max(vehicle.carried, key=lambda m: max(m / AXLE_LOAD[1], AXLE_LOAD[0] / m))
    if not AXLE_LOAD[0] <= load <= AXLE_LOAD[1]:
        yield f"{mass}: an axle carries {load / 1e3:.3g} t; on rails it is 2.5 to 40 t"
    wheels = zip(vehicle.inertias, vehicle.radii, strict=True)
    turning = sum(J / r**2 for J, r in wheels) / vehicle.total
    if turning > TURNING:
        name = "inertia" if vehicle.inertia is not None else "rotating_mass"
        yield (
            f"vehicle.{name}: what turns is as heavy as {100 * turning:.3g} % of the vehicle;"
            " of trains it is 5 to 35 %"
        )
    wheel = max(vehicle.radii, key=lambda r: max(r / RADII[1], RADII[0] / r))
    if not RADII[0] <= wheel <= RADII[1]:
        yield (
            f"vehicle.radius: a wheel of {2 * wheel:.3g} m diameter; of trains 0.5 to 1.4 m;"
            " the key is the radius"
        )
    force = sum(
        trip.actuator.torque / vehicle.radii[k - 1]
        for k in (vehicle.driven or range(1, 1 + len(vehicle.radii)))
    )
    if force < LITTLE * vehicle.total:
        yield (
            f"actuator.torque: all axles together give {force / vehicle.total:.2g} m/s^2; brakes"
            " of trains give 0.5 to 1.5, and a decimal point parts no thousands"
        )
    elif force > MUCH * vehicle.total:
        yield (
            f"actuator.torque: all axles together give {force / vehicle.total:.3g} m/s^2, more than"
            " any rail carries; the torque is that of one axle"
        )
    a, b, c = vehicle.resistance.of(vehicle.total)
    slows = (a + b * vehicle.speed + c * vehicle.speed**2) / vehicle.total
    if slows > DRAG:
        yield f"vehicle.resistance: it alone slows by {slows:.3g} m/s^2 at the start; of trains 0.1"
    if vehicle.speed > FAST:
        yield f"vehicle.speed: it begins at {3.6 * vehicle.speed:.4g} km/h"
    if vehicle.mode == "brake" and vehicle.speed == 0:
        yield "vehicle.speed: it stands at the start, and is braked"
    yield from _short(trip)
    yield from _heights(trip)
    yield from _lifted(trip)
    yield from _measured(trip)


def _short(trip: Trip) -> Iterator[str]:
    """Stretches of rail and demands that are over at once."""
    said = "{} long; it is over before a brake answers"
    begins = [(s.place, "m") if s.time is None else (s.time, "s") for s in trip.rail.sections]
    for k, ((here, unit), (there, _)) in enumerate(pairwise(begins)):
        if there - here < SHORT[unit]:
            yield f"rail.sections.{k}: " + said.format(f"{there - here:.3g} {unit}")
    layer = trip.rail.contamination
    for k, patch in enumerate(layer.places if layer else ()):
        if (length := patch.end - patch.begin) < SHORT["m"]:
            yield f"rail.contamination.places.{k}: " + said.format(f"{length:.3g} m")
    end = trip.demand.end if isinstance(trip.demand, Constant) else None
    if end is not None and end[0] < SHORT[end[1]]:
        yield "demand.until: the demand is " + said.format(f"{end[0]:.3g} {end[1]}")


def _heights(trip: Trip) -> Iterator[str]:
    """Rails with more or less adhesion than any, by their conditions."""
    vehicle = trip.vehicle
    law, own = rail_law(trip), load_block(trip.rail.law).conditions
    heights = heights_of_law(law, vehicle.speed, vehicle.mode == "drive")
    for name, height in heights.items():
        if own and name not in own and not trip.rail.conditions.get(name, True):
            yield (
                f"rail.conditions.{name}: it is empty, and {law.name} has no condition of that"
                f" name{nearest(name, own)}; the rail there is the law as it stands, with an"
                f" adhesion of up to {height:.3g}"
            )
    for name, height in heights.items():
        where = f"rail.conditions.{name}" if name in trip.rail.conditions else f"rail.law, {name}"
        if height < HEIGHTS[0]:
            yield f"{where}: adhesion is {height:.3g} at most; of ice and leaves it is 0.02 or more"
        elif height > HEIGHTS[1]:
            yield f"{where}: adhesion is up to {height:.3g}; of dry rail it is at most 0.6"


def _lifted(trip: Trip) -> Iterator[str]:
    """Axles that carry nothing while the vehicle does what is demanded of it."""
    vehicle, part = trip.vehicle, trip.demand
    given = [getattr(part, k, None) for k in ("deceleration", "acceleration", "force")]
    largest = [0.0 if x is None else float(max(x) if isinstance(x, tuple) else x) for x in given]
    level = max(largest[0], largest[1], largest[2] / vehicle.total)
    way = 1 if vehicle.mode == "brake" else -1
    for k, (mass, gains) in enumerate(zip(vehicle.carried, vehicle.moved, strict=True)):
        if mass * vehicle.gravity + way * gains * level <= 0:
            yield (
                f"vehicle.cars: at {level:.3g} m/s^2 axle {k + 1} carries nothing; it stays on the"
                " rail here, and the others carry more than the vehicle weighs"
            )
            return


def _measured(trip: Trip) -> Iterator[str]:
    """A slip that nobody reaches, a tooth wheel that tells next to nothing."""
    vehicle, goal, part = trip.vehicle, trip.reference, trip.sensors.wheel_speed
    if vehicle.mode == "brake" and isinstance(goal, SlipSpeed) and 0 < vehicle.speed < goal.slip:
        yield f"reference.slip: {goal.slip:g} m/s is above the vehicle's speed; a wheel locks first"
    if isinstance(goal, SlipRatio) and max(goal.each) > 0.5:
        yield f"reference.slip: {max(goal.each):g} of the speed; slip laws hold 0.01 to 0.3"
    for name in ("wheel_speed", "vehicle_speed"):
        noise = getattr(getattr(trip.sensors, name), "deviation", 0.0)
        if noise > NOISY:
            yield f"sensors.{name}.deviation: {noise:g} m/s; of speed sensors it is 0.3 or less"
    if isinstance(part, ToothWheel) and vehicle.speed > 0:
        apart = 6.283 * vehicle.wheel_radius / part.teeth / vehicle.speed
        if apart > SPARSE:
            yield (
                f"sensors.wheel_speed.teeth: a tooth passes every {1e3 * apart:.3g} ms at the"
                " start; the speed of a wheel is not known in between"
            )
