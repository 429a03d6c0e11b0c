"""Numbers of a vehicle's file that may be, and that no train has: what a run tells of them.

What cannot be is refused where it is declared (``parts``). What is here runs, and is right for what
was written. The ends are wide: they are for units and commas that slipped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from slipctl.errors import nearest
from slipctl.models.vehicle.adhesion import (
    heights_of_law,
    law_faults,
    layer_law,
    peak_of_layer,
    rail_law,
    rise_with_speed,
)
from slipctl.models.vehicle.parts import Air, Constant, Lag, SlipRatio, SlipSpeed, ToothWheel, Trip
from slipctl.models.vehicle.plant import on_train
from slipctl.study.resolve import load_block

AXLE_LOAD = (2.5e3, 40e3)
"""kg on an axle: a light railcar, and the heaviest ore wagons (37.5 t) with a margin."""

TURNING = 0.4
"""Share of a vehicle's mass that turns: 5 to 15 % of coaches, 25 to 35 % of locomotives."""

DRAG = 0.5
"""Deceleration in m/s^2 by running resistance: 0.1 at 300 km/h."""

HEIGHTS = (0.01, 0.7)
"""Peak adhesion: below that of leaves and ice, above that of dry rail (0.6 measured)."""

RISES = 1.2
"""How much more a rail may carry at speed than at a quarter of it, with none of it surely odd."""

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
"""Deviation or step of a measured speed in m/s, or of an acceleration in m/s^2."""

LOST = 0.5
"""Share of lost samples."""

SLOWS = 1.0
"""Deceleration in m/s^2 that brakes and wet rail give."""

CLEANS = (1e-6, 1e-2)
"""Strength of the cleaning in m/J: at the ends a megajoule per metre recovers little, and a wheel
that rolls recovers all."""

BELIEVED = 0.1
"""Relative error of a wheel radius: 0.09 from new to worn, and a diameter is twice a radius."""

WEIGHED = (0.4, 2.5)
"""Mass that the load weighing reports, over the true one: full over empty is 2 for coaches."""

GRAVITY = (9.7, 9.9)
"""Gravity in m/s^2: 9.78 at the equator, 9.83 at the poles."""


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
    if not GRAVITY[0] <= vehicle.gravity <= GRAVITY[1]:
        yield f"vehicle.gravity: is {vehicle.gravity:g} m/s^2; on earth it is 9.78 to 9.83"
    yield from _short(trip)
    yield from _heights(trip)
    yield from _faster(trip)
    yield from _layer(trip)
    yield from _lifted(trip)
    yield from _actuated(trip)
    yield from _beside(trip)
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
        top = max(vehicle.speed, 4.0)
        slow, fast = rise_with_speed(law, law.conditions[name], top)
        if fast > RISES * slow:
            yield (
                f"{where}: adhesion rises with speed, from {slow:.3g} at {top / 4:.3g} m/s to"
                f" {fast:.3g} at {top:.3g} m/s; on rails it falls or stays"
            )


def _faster(trip: Trip) -> Iterator[str]:
    """Rails that are none at speeds to which the vehicle may get after the start."""
    vehicle, law, top = trip.vehicle, rail_law(trip), trip.fastest
    if top > vehicle.speed:
        wrong = law_faults(law, law.conditions, top, vehicle.mode == "drive")
        for name, why in wrong:
            yield f"rail.law, {name}: at speeds up to {top:.3g} m/s, where it may get, {why}"


def _layer(trip: Trip) -> Iterator[str]:
    """A layer that carries more than the rail without it."""
    layer, speed, clean = trip.rail.contamination, trip.vehicle.speed, rail_law(trip)
    if layer is None:
        return
    if layer.tau and not CLEANS[0] <= layer.tau <= CLEANS[1]:
        yield f"rail.contamination.tau: is {layer.tau:g} m/J; of leaves it is about 3.4e-5 m/J"
    peaks = [
        peak_of_layer(on_train(clean.with_params(**values)), speed)
        for values in clean.conditions.values()
    ]
    own = peak_of_layer(layer_law(trip, layer), speed)
    general = own if layer.peak is None else layer.peak
    given = {"peak": general} if not layer.places else {
        f"places.{k}.peak": p.peak if p.peak is not None else general
        for k, p in enumerate(layer.places)}  # fmt: skip
    for key, peak in given.items():
        if peak > max(peaks):
            yield (
                f"rail.contamination.{key}: the layer carries {peak:.3g}, more than the rail"
                f" without it, {max(peaks):.3g}"
            )


def _actuated(trip: Trip) -> Iterator[str]:
    """An actuator that gives next to nothing at the speed of the start, or too late."""
    vehicle, act = trip.vehicle, trip.actuator
    if isinstance(act, Lag):
        if act.top is not None and act.top <= vehicle.speed:
            yield (
                f"actuator.top: is {act.top:g} m/s, the vehicle begins at {vehicle.speed:g} m/s,"
                " where the actuators give no torque"
            )
        most = math.inf if act.power is None else act.power * len(vehicle.worked)
        if most < LITTLE * vehicle.total * max(vehicle.speed, 1.0):
            yield (
                f"actuator.power: all axles together have {most:.3g} W for {vehicle.total:.3g} kg;"
                " the power is that of one axle"
            )
        if act.rate is not None and act.torque / act.rate >= trip.duration:
            yield (
                f"actuator.rate: it takes {act.torque / act.rate:.3g} s to the largest torque, the"
                f" run {trip.duration:g} s"
            )
    if isinstance(act, Air) and act.weighed is not None:
        share = act.weighed / vehicle.total
        if not WEIGHED[0] <= share <= WEIGHED[1]:
            yield f"actuator.weighed: is {100 * share:.3g} % of the vehicle's mass"


def _beside(trip: Trip) -> Iterator[str]:
    """Magnets and motors that brake next to nothing, or more than any."""
    vehicle = trip.vehicle
    magnets, motors = vehicle.track_brake, vehicle.dynamic_brake
    if magnets is not None:
        slows = magnets.attraction * magnets.friction / vehicle.total
        if not LITTLE <= slows <= MUCH:
            yield (
                f"vehicle.track_brake.attraction: it alone slows by {slows:.2g} m/s^2; magnets of"
                " trains do by 0.2 to 1.5"
            )
    if motors is not None:
        axles = [k - 1 for k in motors.axles or range(1, 1 + vehicle.axles)]
        slows = sum(motors.torque / vehicle.radii[k] for k in axles) / vehicle.total
        if not LITTLE <= slows <= MUCH:
            yield f"vehicle.dynamic_brake.torque: all motors together give {slows:.2g} m/s^2"
        most = math.inf if motors.power is None else motors.power * len(axles)
        if most < LITTLE * vehicle.total * max(vehicle.speed, 1.0):
            yield (
                f"vehicle.dynamic_brake.power: all motors together have {most:.3g} W for"
                f" {vehicle.total:.3g} kg; the power is that of one axle"
            )


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
    vehicle, part = trip.vehicle, trip.sensors.wheel_speed
    for where, goal in trip.references.items():
        slip = getattr(goal, "slip" if isinstance(goal, SlipSpeed) else "least", 0.0)
        if vehicle.mode == "brake" and 0 < vehicle.speed < slip:
            key = "slip" if isinstance(goal, SlipSpeed) else "least"
            yield f"{where}.{key}: {slip:g} m/s is above the vehicle's speed; a wheel locks first"
        if isinstance(goal, SlipRatio) and max(goal.each) > 0.5:
            yield f"{where}.slip: {max(goal.each):g} of the speed; slip laws hold 0.01 to 0.3"
    rate = getattr(trip.sensors.vehicle_speed, "rate", None)
    if rate is not None and rate < 0.5 * min(trip.pulled, SLOWS):
        yield (
            f"sensors.vehicle_speed.rate: is {rate:g} m/s^2, and the vehicle may change its speed"
            f" by {trip.pulled:.3g} m/s^2"
        )
    for true, known in zip(vehicle.worked, trip.believed, strict=True):
        if abs(known / vehicle.radii[true] - 1) > BELIEVED:
            yield (
                f"control.radius: is {known:g} m, the wheels of axle {true + 1} have"
                f" {vehicle.radii[true]:g} m"
            )
            break
    for name in ("wheel_speed", "vehicle_speed", "accelerometer"):
        sensor = getattr(trip.sensors, name)
        size = vehicle.wheel_radius if name == "wheel_speed" else 1.0  # of a wheel in rad/s
        unit, what = ("m/s^2", "accelerometers") if name == "accelerometer" else (
            "m/s", "speed sensors")  # fmt: skip
        for key in ("deviation", "step", "bias"):
            if (error := size * abs(getattr(sensor, key, 0.0))) > NOISY:
                yield f"sensors.{name}.{key}: {error:.3g} {unit}; of {what} it is 0.3 or less"
        if (share := getattr(sensor, "dropout", 0.0)) > LOST:
            yield f"sensors.{name}.dropout: {100 * share:g} % of the samples are lost"
    if isinstance(part, ToothWheel) and vehicle.speed > 0:
        apart = 6.283 * vehicle.wheel_radius / part.teeth / vehicle.speed
        for key in ("clock", "jitter"):
            if (error := getattr(part, key)) > BELIEVED * apart:
                yield (
                    f"sensors.wheel_speed.{key}: {1e6 * error:g} us, and a tooth passes every"
                    f" {1e6 * apart:.3g} us at the start"
                )
        if apart > SPARSE:
            yield (
                f"sensors.wheel_speed.teeth: a tooth passes every {1e3 * apart:.3g} ms at the"
                " start; the speed of a wheel is not known in between"
            )
