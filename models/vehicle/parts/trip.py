"""A whole trip, what a run of it may not exceed, and what differs from draw to draw."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass
from itertools import pairwise

import numpy as np

from slipctl.block.units.unit_algebra import read_range
from slipctl.errors import BadInput
from slipctl.models.vehicle.parts.actuator import Actuator, Lag
from slipctl.models.vehicle.parts.controllers import (
    Controller,
    Reference,
    Searched,
    SlideProtection,
    SlipControl,
    SlipRatio,
    TrainSlip,
)
from slipctl.models.vehicle.parts.declaration import (
    STANDSTILL,
    Fault,
    Part,
    number,
    number_with_unit,
    size_of,
    text_field,
)
from slipctl.models.vehicle.parts.demand import Constant, Most, Profile
from slipctl.models.vehicle.parts.rail import Track
from slipctl.models.vehicle.parts.sensors import Fused, LargestWheel, Sensors
from slipctl.models.vehicle.parts.vehicle import Vehicle
from slipctl.run.measures.slide_metrics import SLIDES
from slipctl.run.sweep.ensemble import FACTOR


@dataclass(frozen=True, kw_only=True)
class Limits(Part):
    """Largest values that are accepted: a run that is above one is marked."""

    distance: float | None = number("m", None, "distance over the run", lo=0)
    stopping_distance: float | None = number("m", None, "distance until standstill", lo=0)
    settling_time: float | None = number(
        "s", None, "settling time after each change of the rail", lo=0
    )
    lock_time: float | None = number("s", None, "time for which a wheel is locked", lo=0)
    slip_max: float | None = number("m/s", None, "slip speed", lo=0)
    slip_error_rms: float | None = number("m/s", None, "slip minus its reference", lo=0)
    torque_ripple: float | None = number(
        "N m", None, "ripple of the torque before each change of the rail", lo=0
    )
    jerk_rms: float | None = number("m/s^3", None, "jerk of the vehicle, rms", lo=0)
    longest_slide: float | None = number(
        "m",
        None,
        "longest way over which one axle is more than 30 % slower than the vehicle",
        lo=0,
    )
    longest_lock: float | None = number(
        "s", None, "longest time for which one axle is locked", lo=0
    )
    t_gamma: float | None = number("N", None, "largest energy into one contact per metre", lo=0)
    flat_energy: float | None = number(
        "J", None, "largest energy into one spot of a locked wheel", lo=0
    )
    wear: float | None = number("kg", None, "wear of the wheel that wears most", lo=0)
    flash_temperature: float | None = number(
        "K", None, "flash temperature of a contact above wheel and rail", lo=0
    )
    stop_jolt: float | None = number("m/s^2", None, "deceleration that ends at standstill", lo=0)
    extension: float | None = number(
        "1", None, "stopping distance over that on the clean rail, less 1", lo=0
    )
    overrun: float | None = number("m", None, "beyond the mark", lo=0)
    air_used: float | None = number("l", None, "free air of all cylinders", lo=0)
    valve_operations: int | None = number("1", None, "of the valves that move most", lo=0)


@dataclass(frozen=True, kw_only=True)
class DrawnPatches(Part):
    """Contaminated places that are drawn at random; where two overlap, the lower peak counts."""

    many: tuple[int, ...] = number(
        "1", (1, 3), "smallest and largest number of places", lo=0, hi=40, key="number"
    )
    length: tuple[float, ...] = number("m", MISSING, "least and most of one", lo=0.1, hi=1e5)
    peak: tuple[float, ...] = number("1", MISSING, "least and most of one", lo=1e-3, hi=1)
    begin: float = number(
        "m", 0.0, "first position at which a place may begin", lo=0, hi=1e6, key="from"
    )
    end: float = number(
        "m", MISSING, "last position at which a place may begin", lo=0, hi=1e6, key="to"
    )

    def misfits(self) -> Iterator[Fault]:
        """Pairs that are none."""
        for name, given in (("number", self.many), ("length", self.length), ("peak", self.peak)):
            if len(given) != 2 or given[0] > given[1]:
                yield name, "is a pair; write the smallest value, then the largest"
        if self.end <= self.begin:
            yield "to", f"is {self.end:g} m, they begin at {self.begin:g} m; write a larger one"


DRAWN = {
    "m": ("kg", ("m", "plant.m", "plant.train.m")),
    "J": ("kg m^2", ("J",)),
    "r": ("m", ("r",)),
}
"""Numbers of the wheel whose draws a certificate hears: unit, and names in a loop."""


def faults_of_range(text: str, unit: str = "") -> Iterator[str]:
    """What is wrong with the range of a draw, ``"34 t:42 t"``."""
    ends = text.split(":")
    if len(ends) != 2:
        yield f'{text!r} is no range; write "34 t:42 t"'
        return
    try:
        low, high = read_range(*ends, unit, "") if unit else map(size_of, ends)
    except BadInput as error:
        yield str(error).lstrip(": ")
        return
    if None not in (low, high) and not low < high:  # type: ignore[operator]
        yield f"{text!r} is no range; write the lower end first"


@dataclass(frozen=True, kw_only=True)
class Drawn(Part):
    """What differs from draw to draw where gains are tuned."""

    seeds: bool = text_field(False, "whether the noise is drawn anew")
    draw: Mapping[str, str] = text_field({}, "range of each number that is drawn, m = '36t:42t'")
    scale: Mapping[str, str] = text_field({}, "factors and what each multiplies, '0.8:1.2 of c'")
    patches: DrawnPatches | None = text_field(None, "contaminated places, instead of the rail's")

    def misfits(self) -> Iterator[Fault]:
        """An ensemble that is empty, a range that is none."""
        for name, text in self.draw.items():
            unit = next((u for u, names in DRAWN.values() if name in names), "")
            yield from ((f"draw.{name}", fault) for fault in faults_of_range(str(text), unit))
        for name, text in self.scale.items():
            match = FACTOR.fullmatch(str(text))
            if match is None:
                yield f"scale.{name}", f'{text!r} is no factor; write "0.8:1.2 of NAME, NAME"'
            else:
                wrong = faults_of_range(f"{match[1]}:{match[2]}", "1")
                yield from ((f"scale.{name}", fault) for fault in wrong)
        if not (self.draw or self.scale or self.seeds or self.patches):
            yield "", "the ensemble is empty; write what differs from draw to draw, seeds = true"


@dataclass(frozen=True, kw_only=True)
class Assumed(Part):
    """What ``slipctl certify`` takes for granted where it bounds what a law has to withstand."""

    error: float = number("1", 0.1, "largest relative error of a fitted adhesion", lo=0, hi=1)
    tube: float = number(
        "1", 0.05, "share of the best slip within which the slip is held", lo=1e-3, hi=0.5
    )
    push: float = number(
        "m/s^2",
        0.1,
        (
            "largest disturbance of the slip's rate on one axle, of any course, beside the"
            " effect of the other axles"
        ),
        lo=0,
        hi=100,
    )
    noise: float = number(
        "m/s", 0.0, "largest noise of the slip that the controller measures", lo=0, hi=10
    )
    off: float = number(
        "m/s", 0.0, "largest distance of the slip from its equilibrium at the start", lo=0, hi=10
    )
    time: float | None = number(
        "s", None, "time for which the bound shall hold; none given: for ever", lo=1e-3, hi=10
    )
    slip: float | None = number(
        "m/s",
        None,
        (
            "slip that slide protection shall never let a wheel exceed; none given: that"
            " of a locked wheel"
        ),
        lo=1e-3,
        hi=150,
    )


@dataclass(frozen=True, kw_only=True)
class Trip(Part):
    """A vehicle on its way: what it is, what it runs on, what is wanted, and who controls it."""

    title: str = text_field("A vehicle of one's own", "a line for report and figures")
    duration: float = number("s", 30.0, "duration of the run", lo=0.01, hi=1e4)
    end: str = text_field(
        "", "what ends the run before its duration: 'standstill', or a position of the first axle"
    )
    mark: float | None = number(
        "m", None, "place that the first axle shall not pass: a signal, the end of a platform",
        lo=0, hi=1e6,
    )  # fmt: skip
    vehicle: Vehicle = text_field(MISSING, "the vehicle")
    actuator: Actuator = text_field(MISSING, "what drives or brakes each axle")
    rail: Track = text_field(MISSING, "the rail")
    demand: Constant | Profile | Most = text_field(Most(), "demand of brake or drive")
    sensors: Sensors = text_field(Sensors(), "what the controllers measure")
    reference: Reference = text_field(Searched(), "slip reference of the controllers")
    control: SlipControl = text_field(
        SlipControl(),
        (
            "when slip control takes over from the demand, and what it does about"
            " implausible signals"
        ),
    )
    controllers: Mapping[str, Controller] = text_field(
        MISSING, "controllers by a name of one's own"
    )
    limits: Limits = text_field(Limits(), "largest values that are accepted")
    ensemble: Drawn | None = text_field(
        None, "what varies from draw to draw in sweep, tune and certify"
    )
    certify: Assumed = text_field(Assumed(), "what certificates assume")
    seed: int = number("1", 1, "seed of all noise", lo=0, hi=2**31)
    noise: float = number("1", 1.0, "factor on every noise; 0: no noise", lo=0, hi=100)

    @property
    def believed(self) -> tuple[float, ...]:
        """Radius in m of each axle with an actuator, as the controllers believe."""
        given = self.control.radius
        if given is None:
            return tuple(self.vehicle.radii[k] for k in self.vehicle.worked)
        many = len(self.vehicle.worked)
        return tuple(given) if isinstance(given, (list, tuple)) else (given,) * many

    @property
    def one_radius(self) -> float:
        """Radius in m that all controllers know; the speeds of the wheels are brought to it."""
        if self.control.radius is None:
            return self.vehicle.wheel_radius
        return sum(self.believed) / len(self.believed)

    @property
    def beside_torques(self) -> float:
        """Largest acceleration in m/s^2 by gradient and running resistance."""
        vehicle, slopes = self.vehicle, self.rail.slopes
        a, b, c = vehicle.resistance.of(vehicle.total)
        drag = (a + (b + c * vehicle.speed) * vehicle.speed) / vehicle.total
        return vehicle.gravity * max(map(abs, slopes)) + drag

    @property
    def pulled(self) -> float:
        """Largest acceleration in m/s^2 by the actuators: what they give, or what is demanded."""
        vehicle, demand = self.vehicle, self.demand
        given = sum(self.actuator.torque / vehicle.radii[k] for k in vehicle.worked) / vehicle.total
        for name, mass in (("deceleration", 1.0), ("acceleration", 1.0), ("force", vehicle.total)):
            asked = getattr(demand, name, None)
            if asked is not None:
                given = min(given, max(np.atleast_1d(asked)) / mass)
        return float(given)

    @property
    def fastest(self) -> float:
        """Speed in m/s that it does not exceed: by motors and downhill, without resistance."""
        vehicle, slope = self.vehicle, max(0.0, -min(self.rail.slopes))
        rate = vehicle.gravity * slope + (self.pulled if vehicle.mode == "drive" else 0.0)
        return max(vehicle.speed, min(vehicle.speed + rate * self.duration, 150.0))

    @property
    def farthest(self) -> float:
        """Place in m that the first axle does not pass in the run."""
        found = number_with_unit(self.end, "m") if self.end else ""
        last = found[0] if isinstance(found, tuple) else math.inf
        if self.vehicle.mode == "brake" and not self.rail.falls:
            last = min(last, self.vehicle.speed * self.duration)
        return last

    @property
    def fastest_change(self) -> float:
        """Largest rate in m/s^2 at which the estimated speed may change.

        A speed that may not fall as fast as the train releases its brakes on dry rail.
        """
        given, magnets = self.pulled, self.vehicle.track_brake
        if magnets is not None:
            given += magnets.attraction * magnets.friction / self.vehicle.total
        return max(1.5, 1.2 * (given + self.beside_torques))

    @property
    def learns(self) -> bool:
        """Whether the ratios of the radii are learnt."""
        if self.control.learn is None:
            return self.sensors.of_wheels and len(self.vehicle.worked) > 1
        return self.control.learn

    def misfits(self) -> Iterator[Fault]:
        """What of one part does not fit another."""
        if self.end not in ("", STANDSTILL):
            fault = number_with_unit(self.end, "m")
            if isinstance(fault, str):
                yield "end", f"{fault}, or {STANDSTILL!r}"
        wanted = "deceleration" if self.vehicle.mode == "brake" else "acceleration"
        other = "acceleration" if self.vehicle.mode == "brake" else "deceleration"
        if getattr(self.demand, other, None) is not None:
            yield f"demand.{other}", f"the vehicle's mode is {self.vehicle.mode!r}; write {wanted}"
        if not self.controllers:
            yield "controllers", "there is no controller; kind = 'none' applies the demand alone"
        if self.vehicle.mode == "drive" and not isinstance(self.actuator, Lag):
            what = "a valve" if self.actuator.kind == "valve" else "air"
            yield "actuator.kind", f"{what} brakes; a driven vehicle takes kind = 'lag'"
        believed, worked = self.control.radius, len(self.vehicle.worked)
        if isinstance(believed, (list, tuple)) and len(believed) != worked:
            yield (
                "control.radius",
                f"has {len(believed)} values for {worked} axles with an actuator",
            )
        if self.control.learn and worked < 2:
            yield "control.learn", "one axle has no ratio to learn"
        if self.sensors.of_wheels and self.vehicle.axles < 2:
            yield "sensors.vehicle_speed", "one axle that slips tells no speed; use another kind"
        speed = self.sensors.vehicle_speed
        if self.vehicle.mode == "drive" and isinstance(speed, LargestWheel | Fused):
            yield "sensors.vehicle_speed", "is for a braked vehicle; write kind = 'wheels'"
        for k, fault in enumerate(self.sensors.faults):
            if fault.axle > worked:
                yield f"sensors.faults.{k}.axle", f"is {fault.axle} of {worked} axles"
        yield from self._misplaced()
        yield from self._pressed()
        yield from self._unmeasured()
        yield from self._without_layer()
        yield from self._slips_of_axles()
        for name, part in self.controllers.items():
            if isinstance(part, SlideProtection) and self.actuator.kind != "air":
                yield (
                    f"controllers.{name}",
                    (
                        "kind = 'wsp' gives the bits of two valves; write kind = 'air' under"
                        " [actuator]"
                    ),
                )
            if not name.isidentifier() or name == "ideal":
                yield f"controllers.{name}", "write a name of letters, digits and _; not 'ideal'"

    def _unmeasured(self) -> Iterator[Fault]:
        """Limits of what no run of this trip tells."""
        given = {name for name, limit in vars(self.limits).items() if limit is not None}
        for name in (
            sorted(given & {*SLIDES, "extension"}) if self.rail.contamination is None else ()
        ):
            yield (
                f"limits.{name}",
                "needs [rail.contamination], of which tau = 0 cleans nothing",
            )
        for name in (
            sorted(given & {"air_used", "valve_operations"}) if self.actuator.kind != "air" else ()
        ):
            yield f"limits.{name}", "needs kind = 'air' under [actuator]"
        if "overrun" in given and self.mark is None:
            yield "limits.overrun", "needs the mark that is not to be passed; write mark = '900 m'"

    @property
    def references(self) -> dict[str, Reference | None]:
        """Slips that are wanted, by where they stand; None where a controller has none."""
        own = {f"controllers.{k}.reference": getattr(part, "reference", None)
               for k, part in self.controllers.items()}  # fmt: skip
        return {"reference": self.reference, **own}

    def _slips_of_axles(self) -> Iterator[Fault]:
        """A list of slips for another number of axles."""
        axles = len(self.vehicle.worked)
        for where, part in self.references.items():
            many = len(part.each) if isinstance(part, SlipRatio) else 1
            if many not in (1, axles) or (isinstance(part, SlipRatio) and part.slip == ()):
                yield (
                    f"{where}.slip",
                    f"has {many} values for {axles} axles with an actuator; write one for all, or"
                    " one for each",
                )

    def _without_layer(self) -> Iterator[Fault]:
        """A slip by what axles clean, where none is braked or nothing is to be cleaned."""
        for where, part in self.references.items():
            if not isinstance(part, TrainSlip):
                continue
            if self.vehicle.mode == "drive":
                yield where, "kind = 'train' is for a braked vehicle; write another kind"
            if self.rail.contamination is None:
                yield (
                    where,
                    "kind = 'train' knows the layer from [rail.contamination]; add it, of which"
                    " tau = 0 cleans nothing",
                )

    def _pressed(self) -> Iterator[Fault]:
        """Pads whose friction is not known at the largest torque."""
        vehicle = self.vehicle
        for k, (pads, radius) in enumerate(zip(vehicle.each_pads, vehicle.radii, strict=True)):
            fault = pads.too_strong(self.actuator.torque, radius) if pads else ""
            if fault:
                own = vehicle.cars and pads is not vehicle.pads
                place = f"cars.{vehicle.car_of(k)}.pads" if own else "pads"
                yield f"vehicle.{place}.blocks", fault
                return

    def _misplaced(self) -> Iterator[Fault]:
        """Cells that two axles would share; contaminated places where no wheel gets."""
        layer, behind = self.rail.contamination, self.vehicle.behind
        drawn = self.ensemble.patches if self.ensemble else None
        if layer is None:
            if drawn is not None:
                yield "ensemble.patches", "the rail is not contaminated; add [rail.contamination]"
            return
        apart = min((b - a for a, b in pairwise(behind)), default=math.inf)
        if layer.cell > apart:
            yield (
                "rail.contamination.cell",
                f"{layer.cell:g} m is more than the {apart:g} m between two axles, which would be"
                f" in one cell; write '{apart:g} m' or less",
            )
        sanded = layer.sand.axles if layer.sand else ()
        if max(sanded, default=0) > self.vehicle.axles:
            many = self.vehicle.axles
            yield "rail.contamination.sand.axles", f"names axle {max(sanded)} of {many}"
        last = self.farthest
        if drawn is not None and drawn.end > last:
            yield "ensemble.patches.to", f"is {drawn.end:g} m, and the run ends at {last:g} m"
        for k, place in enumerate(layer.places):
            where = f"rail.contamination.places.{k}"
            if place.begin >= last:
                yield f"{where}.from", f"is {place.begin:g} m, and the run ends at {last:g} m"
            if place.end <= -behind[-1]:
                yield f"{where}.to", f"is {place.end:g} m, behind the last axle at the start"
