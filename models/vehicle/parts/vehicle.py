"""The vehicle: mass, axles and their places, wheels, running resistance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import Literal

from slipctl.models.vehicle.parts.added_brakes import DynamicBrake, TrackBrake
from slipctl.models.vehicle.parts.declaration import Fault, Part, number, text_field
from slipctl.models.vehicle.parts.pads import Pads
from slipctl.models.vehicle.parts.torsion import Torsion
from slipctl.models.wheel_damage import HALF_LENGTH, PATCH
from slipctl.study.files.declared_parts import Each


@dataclass(frozen=True, kw_only=True)
class Davis(Part):
    """Running resistance a + b v + c v^2 of the whole vehicle, or by its mass, as "12 N/t"."""

    kind: Literal["davis"] = "davis"
    a: float = number("N", 0.0, "constant part", lo=0, hi=1e6, by="kg")
    b: float = number("N s/m", 0.0, "linear part", lo=0, hi=1e6, by="kg")
    c: float = number("N s^2/m^2", 0.0, "quadratic part", lo=0, hi=1e5, by="kg")

    def of(self, mass: float) -> tuple[float, float, float]:
        """Coefficients in N, N s/m and N s^2/m^2 of a vehicle of this mass in kg."""
        a, b, c = (float(n) * mass if isinstance(n, Each) else n for n in (self.a, self.b, self.c))
        return a, b, c


@dataclass(frozen=True, kw_only=True)
class Car(Part):
    """A car, or several alike: its mass, its bogies, and how its load moves when it brakes."""

    count: int = number("1", 1, "number of such cars", lo=1, hi=32)
    mass: float | None = number("kg", None, "mass; or tare and load", lo=100, hi=1e8)
    tare: float | None = number("kg", None, "mass without load", lo=100, hi=1e8)
    load: float = number("kg", 0.0, "load, on top of tare", lo=0, hi=1e8)
    axles: int = number("1", 4, "number of axles", lo=1, hi=32)
    bogies: int = number("1", 2, "number of bogies; 0: the axles are under the body", lo=0, hi=16)
    wheelbase: float = number("m", 2.1, "distance of the axles of a bogie", lo=0.4, hi=30)
    bogie_centres: float = number(
        "m", 11.0, "distance of its bogie centres", lo=0, hi=60, needs=("bogies",)
    )
    length: float = number("m", 18.0, "length over buffers or couplers", lo=1, hi=100)
    radius: float | None = number(
        "m", None, "wheel radius; none given: that of the vehicle", lo=0.2, hi=1
    )
    inertia: float | None = number(
        "kg m^2",
        None,
        (
            "moment of inertia of one wheelset with all that rotates with it; none given:"
            " that of the vehicle"
        ),
        lo=0.1,
        hi=1e5,
    )
    height: float | None = number(
        "m",
        None,
        "height of the body's centre of mass above the rail; none given: no load transfer",
        lo=0.1,
        hi=5,
    )
    pivot_height: float = number(
        "m",
        0.8,
        "height at which the bogie transmits the brake force to the body",
        lo=0,
        hi=3,
        needs=("height", "bogies"),
    )
    bogie_mass: float = number(
        "kg", 0.0, "mass of one bogie without wheelsets", lo=0, hi=1e5, needs=("height", "bogies")
    )
    bogie_height: float = number(
        "m", 0.6, "height of the bogie's centre of mass", lo=0, hi=3, needs=("height", "bogies")
    )
    wheelset_mass: float = number(
        "kg", 0.0, "mass of one wheelset", lo=0, hi=1e4, needs=("height",)
    )
    pads: Pads | None = text_field(None, "brake pads; none given: those of the vehicle")

    def misfits(self) -> Iterator[Fault]:
        """Masses and lengths that do not fit together."""
        yield from _mass_faults(self, "the car")
        if self.bogies and self.axles % self.bogies:
            yield "bogies", f"{self.axles} axles are not alike on {self.bogies} bogies"
            return
        if self.total <= self._below:
            name = "bogie_mass" if self.bogies and self.bogie_mass else "wheelset_mass"
            yield name, f"bogies and wheelsets are {self._below:g} kg of {self.total:g} kg"
        if self.span >= self.length:
            yield "length", f"is {self.length:g} m; its axles alone are over {self.span:g} m"

    @property
    def total(self) -> float:
        """Mass of one car in kg."""
        return self.mass if self.mass is not None else (self.tare or 0.0) + self.load

    @property
    def _below(self) -> float:
        """Mass of bogies and wheelsets in kg."""
        return self.bogies * self.bogie_mass + self.axles * self.wheelset_mass

    @property
    def per_bogie(self) -> int:
        """Axles of a bogie, or of the car where it has none."""
        return self.axles // self.bogies if self.bogies else self.axles

    @property
    def offsets(self) -> tuple[float, ...]:
        """Place of each axle behind the first one of the car, in m."""
        bogie = [self.wheelbase * k for k in range(self.per_bogie)]
        return tuple(self.bogie_centres * b + d for b in range(max(self.bogies, 1)) for d in bogie)

    @property
    def span(self) -> float:
        """From the first to the last axle, in m."""
        return self.offsets[-1]

    def moved(self, radius: float) -> tuple[float, ...]:
        """Load that each axle gains by m/s^2 of deceleration, in N: of body, then of bogie.

        The body pitches on its bogies, a bogie on its axles, and the sum of moments about the rail
        is that of the inertial forces. Cars do not lift each other.

        Args:
            radius: of the wheels in m, the height of the wheelsets.
        """
        if self.height is None:
            return (0.0,) * self.axles
        if not self.bogies:
            body = self.total - self.axles * self.wheelset_mass
            moment = body * self.height + self.axles * self.wheelset_mass * radius
            return tuple(moment * arm for arm in _arms(self.offsets))
        body = self.total - self._below
        centres = [self.bogie_centres * b for b in range(self.bogies)]
        pulls = [body * (self.height - self.pivot_height) * arm for arm in _arms(centres)]
        own = body / self.bogies * self.pivot_height + self.bogie_mass * self.bogie_height
        own += self.per_bogie * self.wheelset_mass * radius
        axles = [self.wheelbase * k for k in range(self.per_bogie)]
        return tuple(pull / self.per_bogie + own * arm for pull in pulls for arm in _arms(axles))


def _arms(places: Sequence[float]) -> list[float]:
    """Force at each place, falling from the first to the last one, that has the moment 1."""
    middle = sum(places) / len(places)
    square = sum((x - middle) ** 2 for x in places)
    return [(middle - x) / square if square else 0.0 for x in places]


def _mass_faults(part: Car | Vehicle, what: str) -> Iterator[Fault]:
    """Mass and tare, or none of them; a load on top of the mass."""
    if (part.mass is None) == (part.tare is None):
        has = "has neither mass nor tare" if part.mass is None else "has both mass and tare"
        yield "mass", f"{what} {has}; write mass, or tare and load"
    if part.mass is not None and part.load:
        yield "load", f"load is for {'a' + what[3:]} with tare; mass is the sum of both"


_LENGTHS = ("wheelbase", "bogie_centres", "wheelbase", "car_length")
"""What an axle's distance to the next one follows from, in turn."""


_LENGTHS_OF_BOGIES = ("wheelbase", "bogie_centres", "car_length")
"""What tells the places of the axles of a vehicle that has neither places nor cars."""

AXLE_LOAD = (100.0, 5e4)
"""kg on an axle that its equations are for."""

INERTIA = (1.0, 5e3)
"""kg m^2 of a wheelset that its equations are for."""


@dataclass(frozen=True, kw_only=True)
class Vehicle(Part):
    """A vehicle: mass, axles and their places, wheels, resistance, and its speed at the start."""

    mode: Literal["brake", "drive"] = text_field("brake", "whether its wheels are braked or driven")
    mass: float | None = number("kg", None, "mass; or tare and load", lo=1e3, hi=1e8)
    tare: float | None = number("kg", None, "mass without load", lo=1e3, hi=1e8)
    load: float = number("kg", 0.0, "load, on top of tare", lo=0, hi=1e8)
    cars: tuple[Car, ...] = text_field(
        (), "cars one behind the other, instead of mass and places", instead_of=_LENGTHS_OF_BOGIES
    )
    axles: int = number(
        "1", None, "number of axles; none given: 4, or those of the cars", lo=1, hi=32
    )
    wheelbase: float = number("m", 2.1, "distance of the axles of a bogie", lo=0, hi=30)
    bogie_centres: float = number("m", 11.0, "distance of the bogie centres of a car", lo=0, hi=60)
    car_length: float = number(
        "m", 18.0, "distance from one car to the next, for more than 4 axles", lo=1, hi=100
    )
    places: tuple[float, ...] | None = number(
        "m", None, "distance of each axle behind the first, instead of the lengths", lo=0, hi=3000,
        instead_of=_LENGTHS_OF_BOGIES,
    )  # fmt: skip
    driven: tuple[int, ...] | None = number(
        "1", None, "numbers of the driven axles, 1 the first; none given: all", lo=1, hi=32
    )
    radius: float | tuple[float, ...] = number(
        "m", 0.42, "wheel radius, one for all or one for each axle", lo=0.2, hi=1
    )
    inertia: float | None = number(
        "kg m^2",
        None,
        "moment of inertia of one wheelset with all that rotates with it",
        lo=INERTIA[0],
        hi=INERTIA[1],
    )
    rotating_mass: float | None = number(
        "1",
        None,
        "rotating masses as a share of the mass without load, instead of the inertia",
        lo=1e-3,
        hi=1,
    )
    resistance: Davis = text_field(Davis(), "running resistance")
    pads: Pads | None = text_field(None, "brake pads; none given: a constant friction")
    track_brake: TrackBrake | None = text_field(
        None, "magnetic track brakes; none given: the vehicle has none"
    )
    dynamic_brake: DynamicBrake | None = text_field(
        None, "motors that brake first, the actuator the rest; none given: the actuator alone"
    )
    torsion: Torsion | None = text_field(None, "wheelsets that twist; none given: they are rigid")
    patch: float = number(
        "m^2", PATCH, "area of the contact patch of a wheel, for wear and heat", lo=1e-6, hi=1e-3
    )
    patch_half_length: float = number(
        "m",
        HALF_LENGTH,
        "half the length of the patch, in the direction of rolling",
        lo=1e-4,
        hi=0.05,
    )
    speed: float = number("m/s", MISSING, "speed at the start", lo=0, hi=150)
    gravity: float = number("m/s^2", 9.81, "gravitational acceleration", lo=1, hi=30)

    def complete(self) -> None:
        """The number of axles."""
        if self.axles is None:
            given = sum(car.count * car.axles for car in self.cars) if self.cars else 4
            object.__setattr__(self, "axles", min(given, 32))  # more of them are told below

    def misfits(self) -> Iterator[Fault]:
        """Mass, places, radii and inertia that do not fit together."""
        if self.cars:
            yield from self._beside_cars()
        else:
            yield from _mass_faults(self, "the vehicle")
        told = self.cars and all(car.inertia is not None for car in self.cars)
        if (self.inertia is None) == (self.rotating_mass is None) and not (
            told and self.inertia is None
        ):
            given = "neither of them is" if self.inertia is None else "both are"
            yield "inertia", f"write inertia or rotating_mass; {given} given"
        for name in ("places", "radius"):
            given = getattr(self, name)
            if isinstance(given, (list, tuple)) and len(given) != self.axles:
                yield name, f"has {len(given)} values for {self.axles} axles"
        if self.places is not None and (self.places[:1] != (0.0,) or self._unsorted()):
            yield "places", "must begin with 0 m and rise from axle to axle"
        if isinstance(self.radius, (int, float)) or len(self.radius) == self.axles:
            yield from self._impossible()
        if self.torsion is not None and len(self.radii) == self.axles == len(self.inertias):
            worked = [k for k in self.worked if k < self.axles]
            yield from self.torsion.faults_of_vehicle(
                self.mode == "drive", [self.inertias[k] for k in worked],
                [self.radii[k] for k in worked],
            )  # fmt: skip
        yield from self._held_back()
        if self.mode == "drive" and any(self.each_pads):
            yield "pads", "are of a braked vehicle; leave them out of a driven one"
        for name in ("track_brake", "dynamic_brake"):
            if getattr(self, name) is not None and self.mode == "drive":
                yield name, "is of a braked vehicle; leave it out of a driven one"
        magnets, motors = self.track_brake, self.dynamic_brake
        if magnets is not None and self.mode == "brake" and magnets.above >= self.speed:
            yield (
                "track_brake.above",
                f"is {magnets.above:g} m/s, the vehicle begins at {self.speed:g} m/s; write less",
            )
        if motors is not None and any(k > self.axles for k in motors.axles or ()):
            yield "dynamic_brake.axles", f"names axle {max(motors.axles)} of {self.axles}"
        if self.driven is not None:
            if self.mode == "brake":
                yield "driven", "is for a driven vehicle; write mode = 'drive'"
            if not self.driven or len(set(self.driven)) != len(self.driven):
                yield "driven", "must name each driven axle once"
            if any(k > self.axles for k in self.driven):
                yield "driven", f"names axle {max(self.driven):g} of {self.axles}"

    def _beside_cars(self) -> Iterator[Fault]:
        """What cars say already, and more axles than there may be."""
        for name in ("mass", "tare", "places"):
            if getattr(self, name) is not None:
                yield name, "the cars have it; leave it out"
        if self.load:
            yield "load", "the cars have it; leave it out"
        for k, car in enumerate(self.cars if not isinstance(self.radius, (int, float)) else ()):
            if car.radius is not None:
                yield f"cars.{k}.radius", "vehicle.radius is a list of all axles; leave one out"
        many = sum(car.count * car.axles for car in self.cars)
        if many > 32:
            yield "cars", f"the cars have {many} axles; a vehicle has at most 32"
        elif many != self.axles:
            yield "axles", f"is {self.axles}, and the cars have {many}; leave it out"

    def _impossible(self) -> Iterator[Fault]:
        """Wheels that would stand in each other; more that turns than there is."""
        places, radii = self.behind, self.radii
        for k, (a, b) in enumerate(pairwise(places) if len(places) == self.axles else ()):
            room = radii[k] + radii[k + 1]
            if b - a < room:
                name = "places" if self.places is not None else _LENGTHS[min(k % 4, 3)]
                name = "wheelbase" if self.axles == 2 else name
                name = "cars" if self.cars else name
                yield (
                    name,
                    (
                        f"axles {k + 1} and {k + 2} are {b - a:g} m apart; wheels of"
                        f" {radii[k]:g} m and {radii[k + 1]:g} m need {room:g} m"
                    ),
                )
                break
        (least, most), (light, heavy) = AXLE_LOAD, INERTIA
        for load in self.carried if self.total else ():
            if not least <= load <= most:
                name = "cars" if self.cars else "mass" if self.mass is not None else "tare"
                yield name, f"an axle carries {load:.4g} kg; it must be {least:g} .. {most:g} kg"
                break
        odd = [J for J in self.inertias if J and not light <= J <= heavy]
        if odd and (self.cars or self.inertia is None):
            yield (
                "cars" if self.cars else "rotating_mass",
                (
                    f"the inertia of a wheelset is {odd[0]:.4g} kg m^2; it must be"
                    f" {light:g} .. {heavy:g} kg m^2"
                ),
            )
        turning = sum(J / r**2 for J, r in zip(self.inertias, radii, strict=True))
        if self.rotating_mass is None and self.total and turning > self.total:
            yield (
                "inertia",
                (
                    f"the wheelsets are as heavy as {turning:.4g} kg at the rims, the vehicle is"
                    f" {self.total:.4g} kg; write the inertia of one wheelset"
                ),
            )

    def _held_back(self) -> Iterator[Fault]:
        """Running resistance that no vehicle overcomes: by mass, told in kN for N."""
        slows = zip("abc", self.resistance.of(self.total), strict=True)
        for key, part in slows if self.total else ():
            if part / self.total > 1:
                unit = {"a": "m/s^2", "b": "1/s", "c": "1/m"}[key]
                yield (
                    f"resistance.{key}",
                    f"is {part / self.total:g} {unit} of the mass; it must be at most 1 {unit}",
                )

    def _unsorted(self) -> bool:
        places = self.places or ()
        return any(b <= a for a, b in pairwise(places))

    @property
    def total(self) -> float:
        """Mass in kg."""
        if self.cars:
            return sum(car.count * car.total for car in self.cars)
        return self.mass if self.mass is not None else (self.tare or 0.0) + self.load

    @property
    def each_car(self) -> tuple[Car, ...]:
        """Cars one by one."""
        return tuple(car for car in self.cars for _ in range(car.count))

    def car_of(self, axle: int) -> int:
        """Entry of the cars, from 0, to which an axle belongs."""
        for k, car in enumerate(self.cars):
            axle -= car.count * car.axles
            if axle < 0:
                return k
        return 0

    @property
    def carried(self) -> tuple[float, ...]:
        """Mass that each axle carries, in kg: a car stands on its axles alike."""
        if not self.cars:
            return (self.total / self.axles,) * self.axles
        return tuple(car.total / car.axles for car in self.each_car for _ in range(car.axles))

    @property
    def each_pads(self) -> tuple[Pads | None, ...]:
        """Pads of each axle."""
        if not self.cars:
            return (self.pads,) * self.axles
        return tuple(car.pads or self.pads for car in self.each_car for _ in range(car.axles))

    @property
    def moved(self) -> tuple[float, ...]:
        """Load that each axle gains by m/s^2 of deceleration, in N."""
        radii = iter(self.radii)
        found: list[float] = []
        for car in self.each_car:
            own = [next(radii) for _ in range(car.axles)]
            found += car.moved(sum(own) / len(own))
        return tuple(found) or (0.0,) * self.axles

    @property
    def behind(self) -> tuple[float, ...]:
        """Place of each axle behind the first, in m."""
        if self.places is not None:
            return self.places
        if self.cars:
            found: list[float] = []
            end, first = 0.0, (self.each_car[0].length - self.each_car[0].span) / 2
            for car in self.each_car:
                begin = end + (car.length - car.span) / 2 - first
                found += [begin + d for d in car.offsets]
                end += car.length
            return tuple(found)
        if self.axles == 2:
            return (0.0, self.wheelbase)
        bogie = (0.0, self.wheelbase)
        car = (*bogie, *(self.bogie_centres + d for d in bogie))
        return tuple(self.car_length * (k // 4) + car[k % 4] for k in range(self.axles))

    @property
    def radii(self) -> tuple[float, ...]:
        """Radius of each axle in m."""
        if isinstance(self.radius, tuple):
            return self.radius
        if not self.cars:
            return (self.radius,) * self.axles
        return tuple(car.radius or self.radius for car in self.each_car for _ in range(car.axles))

    @property
    def inertias(self) -> tuple[float, ...]:
        """Inertia of each wheelset in kg m^2."""
        alone = self._one_inertia
        if not self.cars:
            return (alone,) * self.axles
        return tuple(car.inertia or alone for car in self.each_car for _ in range(car.axles))

    @property
    def wheel_radius(self) -> float:
        """Mean radius in m."""
        return sum(self.radii) / self.axles

    @property
    def wheel_inertia(self) -> float:
        """Mean inertia of a wheelset in kg m^2."""
        if len(set(self.inertias)) == 1:
            return self.inertias[0]
        return sum(self.inertias) / self.axles

    @property
    def _one_inertia(self) -> float:
        """Inertia in kg m^2 of a wheelset whose car has none of its own."""
        if self.inertia is not None:
            return self.inertia
        empty = (
            self.tare
            if self.tare is not None
            else self.total - sum(car.count * car.load for car in self.cars)
        )
        return (self.rotating_mass or 0.0) * empty * self.wheel_radius**2 / self.axles

    @property
    def worked(self) -> tuple[int, ...]:
        """Axles with an actuator, from 0."""
        if self.driven is None:
            return tuple(range(self.axles))
        return tuple(sorted(int(k) - 1 for k in self.driven))
