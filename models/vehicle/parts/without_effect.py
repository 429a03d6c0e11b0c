"""Keys of a vehicle's file that change no run, or not as a reader takes them.

They are of what is not there, or of what comes when the run is over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields
from typing import Any

from slipctl.models.vehicle.parts.actuator import Air
from slipctl.models.vehicle.parts.controllers import SlideProtection
from slipctl.models.vehicle.parts.declaration import Part, torque_of
from slipctl.models.vehicle.parts.demand import Constant, Profile
from slipctl.models.vehicle.parts.trip import Trip
from slipctl.study.files.declared_parts import key_of


def parts_without_effect(trip: Trip) -> Iterator[str]:
    """What of a trip has no effect on any run, a line each."""
    used = {s.condition for s in trip.rail.sections}
    for name in trip.rail.conditions:
        if name not in used:
            yield f"rail.conditions.{name}: no section of the rail has this condition"
    part = trip.demand
    if isinstance(part, Profile) and part.over != "speed" and part.at[0] > 0:
        unit = "s" if part.over == "time" else "m"
        yield (
            f"demand.at.0: is {part.at[0]:g} {unit}; the demand there holds from the start on,"
            f" write 0 {unit} and what is demanded before"
        )
    if isinstance(part, Profile) and sum(at <= 0 for at in part.at) > 1:
        yield f"demand.at.0: has no effect, as demand.at.1 = {part.at[1]:g} is not above 0 either"
    yield from _too_late(trip)
    yield from _too_far(trip)
    yield from _of_nothing(trip, "")
    yield from _of_other_parts(trip)
    yield from _of_cars(trip)
    yield from _never(trip)


def _too_late(trip: Trip) -> Iterator[str]:
    """What begins when the run is over."""
    vehicle, layer, part = trip.vehicle, trip.rail.contamination, trip.demand
    for k, section in enumerate(trip.rail.sections):
        if section.time is not None and section.time >= trip.duration:
            yield f"rail.sections.{k}: begins at {section.time:g} s, the run ends before"
    end = part.end if isinstance(part, Constant) else None
    if end is not None and end[1] == "s" and end[0] >= trip.duration:
        yield f"demand.until: {part.until} is not before the end of the run, {trip.duration:g} s"
    times = [(f"sensors.faults.{k}.time", f.time) for k, f in enumerate(trip.sensors.faults)]
    if isinstance(part, Profile) and part.over == "time":
        times += [(f"demand.at.{k}", at) for k, at in enumerate(part.at)]
    if vehicle.track_brake is not None:
        times.append(("vehicle.track_brake.delay", vehicle.track_brake.delay))
    if vehicle.dynamic_brake is not None and vehicle.dynamic_brake.lost is not None:
        times.append(("vehicle.dynamic_brake.lost", vehicle.dynamic_brake.lost))
    if layer is not None and layer.sand is not None:
        times.append(("rail.contamination.sand.delay", layer.sand.delay))
    for key in ("dead_time", "reaction"):
        times.append((f"actuator.{key}", getattr(trip.actuator, key, 0.0)))
    for where, time in times:
        if time >= trip.duration:
            yield f"{where}: {time:g} s is not before the end of the run, {trip.duration:g} s"


def _too_far(trip: Trip) -> Iterator[str]:
    """What is at places where no axle gets."""
    part, slopes, last = trip.demand, trip.rail.gradient, trip.farthest
    end = part.end if isinstance(part, Constant) else None
    places = [("demand.until", end[0])] if end is not None and end[1] == "m" else []
    if isinstance(part, Profile) and part.over == "position":
        places += [(f"demand.at.{k}", at) for k, at in enumerate(part.at)]
    if isinstance(slopes, tuple):
        places += [(f"rail.gradient.{k}.place", s.place) for k, s in enumerate(slopes)]
    for where, place in places:
        if place >= last:
            yield f"{where}: {place:g} m is not before the end of the run, {last:g} m at most"


def _never(trip: Trip) -> Iterator[str]:
    """What the speed at the start or the largest torque leaves without effect."""
    vehicle, control, brake = trip.vehicle, trip.control, trip.actuator
    motors, layer = vehicle.dynamic_brake, trip.rail.contamination
    slows = vehicle.mode == "brake" and not trip.rail.falls and vehicle.speed > 0
    ruled = any(part.kind not in ("none", "wsp") for part in trip.controllers.values())
    for key in ("off", "least") if slows and ruled else ():
        if (given := getattr(control, key)) >= vehicle.speed:
            yield (
                f"control.{key}: is {given:g} m/s, the vehicle begins at {vehicle.speed:g} m/s;"
                " slip control never takes over"
            )
    for name, law in trip.controllers.items() if slows else ():
        if isinstance(law, SlideProtection) and law.cut_off >= vehicle.speed:
            yield (
                f"controllers.{name}.cut_off: is {law.cut_off:g} m/s, the vehicle begins at"
                f" {vehicle.speed:g} m/s; slide protection is always off"
            )
    if slows and motors is not None and motors.fades_to >= vehicle.speed:
        yield (
            f"vehicle.dynamic_brake.fades_to: is {motors.fades_to:g} m/s, the vehicle begins at"
            f" {vehicle.speed:g} m/s; the motors never brake"
        )
    if motors is not None and motors.lost == 0:
        yield "vehicle.dynamic_brake.lost: is 0 s; the motors never brake"
    for key in ("safe", "demand_lost"):
        torque = torque_of(given) if (given := getattr(control, key)) != "" else 0.0
        if isinstance(torque, float) and torque > brake.torque:
            yield (f"control.{key}: is {torque:g} N m, an axle gets {brake.torque:g} N m at most")
    if layer is not None and layer.sand is not None and layer.sand.rate == 0:
        yield "rail.contamination.sand.rate: is 0; no sand falls"


def _of_cars(trip: Trip) -> Iterator[str]:
    """Lengths of bogies that are not there; what each car has in place of the vehicle."""
    vehicle = trip.vehicle
    for k, car in enumerate(vehicle.cars):
        if car.bogies == 1 and _set(car, "bogie_centres"):
            yield f"vehicle.cars.{k}.bogie_centres: has no effect, as bogies = 1"
        if car.per_bogie == 1 and _set(car, "wheelbase"):
            yield f"vehicle.cars.{k}.wheelbase: has no effect, as a bogie has one axle"
    for key in ("radius", "inertia", "rotating_mass", "pads"):
        if vehicle.cars and _set(vehicle, key) and all(getattr(c, key) for c in vehicle.cars):
            yield f"vehicle.{key}: has no effect, as each car has its own"
    if not vehicle.cars and vehicle.axles == 1 and _set(vehicle, "wheelbase"):
        yield "vehicle.wheelbase: has no effect, as axles = 1"


def _of_nothing(part: Part, where: str) -> Iterator[str]:
    """Keys of a part and of the parts in it that are for another key, which is not there."""
    for f in fields(part):  # type: ignore[arg-type]
        value = getattr(part, f.name)
        key = f"{where}{key_of(f)}"
        for other in f.metadata.get("needs", ()):
            default = f.default if f.default is not MISSING else None
            if value != default and not getattr(part, other):
                yield f"{key}: has no effect{_without(part, other)}"
                break
        inner = value.items() if isinstance(value, dict) else (
            enumerate(value) if isinstance(value, tuple) else [("", value)])  # fmt: skip
        for k, one in inner:
            if isinstance(one, Part):
                yield from _of_nothing(one, f"{key}.{k}." if k != "" else f"{key}.")


def _without(part: Any, key: str) -> str:
    """What is missing, in words."""
    value = getattr(part, key)
    return f" without {key}" if value is None else f", as {key} = {value:g}"


def _of_other_parts(trip: Trip) -> Iterator[str]:
    """Keys that are for another part, or another kind of it, than the trip has."""
    vehicle, brake, layer = trip.vehicle, trip.actuator, trip.rail.contamination
    motors = vehicle.dynamic_brake
    if motors is not None and not isinstance(brake, Air) and _set(motors, "pause"):
        yield "vehicle.dynamic_brake.pause: has no effect without the valves of kind = 'air'"
    if layer is None:
        for key in ("patch", "patch_half_length"):
            if _set(vehicle, key):
                yield f"vehicle.{key}: has no effect without [rail.contamination]"
    slows = vehicle.mode == "brake" and not trip.rail.falls
    sand = layer.sand if layer is not None and slows else None
    if sand is not None and sand.above >= vehicle.speed:
        yield (
            f"rail.contamination.sand.above: is {sand.above:g} m/s, the vehicle begins at"
            f" {vehicle.speed:g} m/s and never sands"
        )
    if isinstance(brake, Air):
        rates = {"fill": brake.fill_rate, "vent": brake.vent_rate}
        for key, rate in rates.items():
            if rate is not None and _set(brake, key):
                yield f"actuator.{key}: has no effect, as {key}_rate is given"
        for key in ("discharge", "air"):
            if _set(brake, key) and None not in rates.values():
                yield f"actuator.{key}: has no effect, as fill_rate and vent_rate are given"
    sensors = (trip.sensors.wheel_speed, trip.sensors.vehicle_speed, trip.sensors.accelerometer)
    noisy = any(getattr(s, k, 0) for s in sensors for k in ("jitter", "deviation", "dropout"))
    for key in ("seed", "noise"):
        if _set(trip, key) and not (noisy and (trip.noise or key == "noise")):
            yield f"{key}: has no effect, " + ("as noise = 0" if noisy else "no sensor has noise")
    for k, fault in enumerate(trip.sensors.faults):
        if fault.kind == "jumps" and fault.share == 0:
            yield f"sensors.faults.{k}.share: has no effect, as it is 0"
        if fault.kind != "jumps" and _set(fault, "share"):
            yield f"sensors.faults.{k}.share: has no effect, as kind = {fault.kind!r}"
    if not vehicle.cars and vehicle.places is None:
        for key, more in (("bogie_centres", 2), ("car_length", 4)):
            if vehicle.axles <= more and _set(vehicle, key):
                yield f"vehicle.{key}: has no effect, as axles = {vehicle.axles}"


def _set(part: Part, key: str) -> bool:
    """Whether a key has another value than its default."""
    (f,) = (f for f in fields(part) if f.name == key)  # type: ignore[arg-type]
    return bool(getattr(part, key) != f.default)
