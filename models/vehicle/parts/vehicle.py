"""The vehicle: mass, axles and their places, wheels, running resistance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import Literal

from slipctl.models.vehicle.parts.declaration import Fault, Part, number, text_field
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


_LENGTHS = ("wheelbase", "bogie_centres", "wheelbase", "car_length")
"""What an axle's distance to the next one follows from, in turn."""


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
    axles: int = number("1", 4, "how many axles", lo=1, hi=32)
    wheelbase: float = number("m", 2.1, "between the axles of a bogie", lo=0, hi=30)
    bogie_centres: float = number("m", 11.0, "between the bogies of a car", lo=0, hi=60)
    car_length: float = number("m", 18.0, "from one car to the next, above 4 axles", lo=1, hi=100)
    places: tuple[float, ...] | None = number(
        "m", None, "of each axle behind the first, instead of the lengths", lo=0, hi=3000
    )
    driven: tuple[int, ...] | None = number(
        "1", None, "numbers of the driven axles, 1 the first; none given: all", lo=1, hi=32
    )
    radius: float | tuple[float, ...] = number(
        "m", 0.42, "of the wheels, or of each axle", lo=0.2, hi=1
    )
    inertia: float | None = number(
        "kg m^2", None, "of one wheelset with all that turns with it", lo=INERTIA[0], hi=INERTIA[1]
    )
    rotating_mass: float | None = number(
        "1", None, "share of the mass without load, instead of the inertia", lo=1e-3, hi=1
    )
    resistance: Davis = text_field(Davis(), "running resistance")
    speed: float = number("m/s", MISSING, "at the start", lo=0, hi=150)
    gravity: float = number("m/s^2", 9.81, "gravity", lo=1, hi=30)

    def misfits(self) -> Iterator[Fault]:
        """Mass, places, radii and inertia that do not fit together."""
        if (self.mass is None) == (self.tare is None):
            what = "has neither mass nor tare" if self.mass is None else "has both mass and tare"
            yield "mass", f"the vehicle {what}; write mass, or tare and load"
        if self.mass is not None and self.load:
            yield "load", "load is for a vehicle with tare; mass is the sum of both"
        if (self.inertia is None) == (self.rotating_mass is None):
            what = "neither" if self.inertia is None else "both"
            yield "inertia", f"{what} of inertia and rotating_mass is given; write one of them"
        for name in ("places", "radius"):
            given = getattr(self, name)
            if isinstance(given, (list, tuple)) and len(given) != self.axles:
                yield name, f"has {len(given)} values for {self.axles} axles"
        if self.places is not None and (self.places[:1] != (0.0,) or self._unsorted()):
            yield "places", "must begin with 0 m and rise from axle to axle"
        if isinstance(self.radius, (int, float)) or len(self.radius) == self.axles:
            yield from self._impossible()
        if self.driven is not None:
            if self.mode == "brake":
                yield "driven", "is for a driven vehicle; write mode = 'drive'"
            if not self.driven or len(set(self.driven)) != len(self.driven):
                yield "driven", "must name each driven axle once"
            if any(k > self.axles for k in self.driven):
                yield "driven", f"names axle {max(self.driven):g} of {self.axles}"

    def _impossible(self) -> Iterator[Fault]:
        """Wheels that would stand in each other; more that turns than there is."""
        places, radii = self.behind, self.radii
        for k, (a, b) in enumerate(pairwise(places) if len(places) == self.axles else ()):
            room = radii[k] + radii[k + 1]
            if b - a < room:
                name = "places" if self.places is not None else _LENGTHS[min(k % 4, 3)]
                name = "wheelbase" if self.axles == 2 else name
                yield (
                    name,
                    (
                        f"axles {k + 1} and {k + 2} are {b - a:g} m apart; wheels of"
                        f" {radii[k]:g} m and {radii[k + 1]:g} m need {room:g} m"
                    ),
                )
                break
        load, (least, most) = self.total / self.axles, AXLE_LOAD
        if self.total and not least <= load <= most:
            name = "mass" if self.mass is not None else "tare"
            yield name, f"an axle carries {load:.4g} kg; it must be {least:g} .. {most:g} kg"
        if self.rotating_mass is not None and not INERTIA[0] <= self.wheel_inertia <= INERTIA[1]:
            yield (
                "rotating_mass",
                (
                    f"the inertia of a wheelset is {self.wheel_inertia:.4g} kg m^2; it must be"
                    f" {INERTIA[0]:g} .. {INERTIA[1]:g} kg m^2"
                ),
            )
        turning = sum(self.wheel_inertia / r**2 for r in radii)
        if self.inertia is not None and self.total and turning > self.total:
            yield (
                "inertia",
                (
                    f"the wheelsets are as heavy as {turning:.4g} kg at the rims, the vehicle is"
                    f" {self.total:.4g} kg; write the inertia of one wheelset"
                ),
            )

    def _unsorted(self) -> bool:
        places = self.places or ()
        return any(b <= a for a, b in pairwise(places))

    @property
    def total(self) -> float:
        """Mass in kg."""
        return self.mass if self.mass is not None else (self.tare or 0.0) + self.load

    @property
    def behind(self) -> tuple[float, ...]:
        """Place of each axle behind the first, in m."""
        if self.places is not None:
            return self.places
        if self.axles == 2:
            return (0.0, self.wheelbase)
        bogie = (0.0, self.wheelbase)
        car = (*bogie, *(self.bogie_centres + d for d in bogie))
        return tuple(self.car_length * (k // 4) + car[k % 4] for k in range(self.axles))

    @property
    def radii(self) -> tuple[float, ...]:
        """Radius of each axle in m."""
        return self.radius if isinstance(self.radius, tuple) else (self.radius,) * self.axles

    @property
    def wheel_radius(self) -> float:
        """Mean radius in m."""
        return sum(self.radii) / self.axles

    @property
    def wheel_inertia(self) -> float:
        """Inertia of one wheelset in kg m^2."""
        if self.inertia is not None:
            return self.inertia
        empty = self.tare if self.tare is not None else self.total
        return (self.rotating_mass or 0.0) * empty * self.wheel_radius**2 / self.axles

    @property
    def worked(self) -> tuple[int, ...]:
        """Axles with an actuator, from 0."""
        if self.driven is None:
            return tuple(range(self.axles))
        return tuple(sorted(int(k) - 1 for k in self.driven))
