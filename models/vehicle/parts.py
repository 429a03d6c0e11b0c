"""What a trip is made of: vehicle, actuator, rail, demand, sensors, reference, controllers.

Each class is a part, its fields are the numbers that an engineer decides, in SI, each with unit,
meaning and range. A part of several kinds says which with ``kind``. A file (docs/own_vehicle.md)
has these names and no others, so what is declared here is all that a reader needs to know.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from slipctl import BadInput
from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.block.units.unit_algebra import unit as unit_of
from slipctl.study.files.declared_parts import Each

Fault = tuple[str, str]
"""A path such as ``"rail.sections.1"`` and what is wrong there."""

SLIP_LAWS = ("pid", "smc", "sta", "efc", "eppfc", "eppfc_barrier", "barrier", "hosm")
"""Slip laws by the names of :func:`slipctl.models.common_form.laws`."""


def number(
    unit: str, value: Any = MISSING, doc: str = "", *, lo: float = -math.inf, hi: float = math.inf,
    by: str = "",
) -> Any:  # fmt: skip
    """Declare a number of a part, or a list of them; without ``value`` it must be given.

    With ``by`` it may be told by another quantity too, ``by="kg"`` takes N/kg for N; see ``Each``.
    """
    meta = {"unit": unit, "doc": doc, "lo": lo, "hi": hi} | ({"by": by} if by else {})
    return field(default=value, metadata=meta)


def text_field(value: Any, doc: str) -> Any:
    """Declare what is no number, with its meaning."""
    if isinstance(value, (dict, list)):
        return field(default_factory=lambda: type(value)(value), metadata={"doc": doc})
    return field(default=value, metadata={"doc": doc})


def off_range(value: float, meta: Mapping[str, Any]) -> str:
    """What is wrong with a number of a field, in words; empty where nothing is."""
    unit = "" if meta["unit"] == "1" else f" {meta['unit']}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)):
        return f"{value!r} is no number{f' in{unit}' if unit else ''}"
    if not math.isfinite(value):
        return f"{value:g}{unit} is not finite"
    if not meta["lo"] <= value <= meta["hi"]:
        return f"{value:g}{unit} is outside {meta['lo']:g} .. {meta['hi']:g}{unit}"
    return ""


STANDSTILL = "standstill"
"""What ends a trip when the vehicle has stopped."""


def _size(text: str) -> float | None:
    """Number of a text in SI, whatever it is of; None where it is none."""
    try:
        value, name = split_quantity(text.strip())
        return float(value) * (unit_of(name).scale if name else 1.0)
    except (BadInput, ValueError):
        return None


def number_with_unit(text: str, *units: str) -> tuple[float, str] | str:
    """Positive number in one of some units, with that unit; or what is wrong with the text."""
    bare = text.strip()[-1:]
    for unit in units if bare.isalpha() else ():
        try:
            value = parse_quantity(text, unit)
        except BadInput:
            continue
        if math.isfinite(value) and value > 0:
            return value, unit
        return f"is {text!r}, which is not above 0"
    return f"is {text!r}; write a number in {' or '.join(units)}, such as '12 {units[0]}'"


def torque_of(given: str | float) -> float | str:
    """Torque in N m from 0 on, of a number or a text with its unit; or what is wrong with it."""
    if not isinstance(given, str):
        return float(given)
    try:
        value = parse_quantity(given, "N m")
    except BadInput as error:
        return str(error)
    return value if 0 <= value <= 1e6 else f"{value:g} N m is outside 0 .. 1e6 N m"


class Part:
    """A part; it refuses numbers off range and what does not fit together."""

    def __post_init__(self) -> None:
        for path, text in self.wrong():
            raise BadInput(f"{type(self).__name__}: {path}: {text}" if path else text)

    def wrong(self) -> Iterator[Fault]:
        """Everything that is wrong with the part itself, its parts left out."""
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            if "unit" in f.metadata and value is not None:
                many = value if isinstance(value, (list, tuple)) else [value]
                for k, one in enumerate(many):
                    text = off_range(one, f.metadata)
                    if text:
                        yield f.name if many is not value else f"{f.name}.{k}", text
        yield from self.misfits()

    def misfits(self) -> Iterator[Fault]:
        """What does not fit together."""
        return iter(())


TICK = 1e-3
"""Sample time of a trip in s; that of ``slipctl.models.common_form``."""


def _off_ticks(name: str, value: float) -> Iterator[Fault]:
    """A time that would be rounded."""
    ticks = value / TICK
    if abs(ticks - round(ticks)) > 1e-6:
        low, high = int(ticks), int(ticks) + 1
        yield (
            name,
            (
                f"{1e3 * value:g} ms is no whole number of samples of {1e3 * TICK:g} ms; write"
                f" '{1e3 * TICK * low:g} ms' or '{1e3 * TICK * high:g} ms'"
            ),
        )


# ---- vehicle and actuator ------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Davis(Part):
    """Running resistance a + b v + c v^2 of the whole vehicle, or by its mass, as "12 N/t"."""

    kind: Literal["davis"] = "davis"
    a: float = number("N", 0.0, "constant part", lo=0, hi=1e7, by="kg")
    b: float = number("N s/m", 0.0, "linear part", lo=0, hi=1e6, by="kg")
    c: float = number("N s^2/m^2", 0.0, "quadratic part", lo=0, hi=1e5, by="kg")

    def of(self, mass: float) -> tuple[float, float, float]:
        """Coefficients in N, N s/m and N s^2/m^2 of a vehicle of this mass in kg."""
        a, b, c = (float(n) * mass if isinstance(n, Each) else n for n in (self.a, self.b, self.c))
        return a, b, c


_LENGTHS = ("wheelbase", "bogie_centres", "wheelbase", "car_length")
"""What an axle's distance to the next one follows from, in turn."""


@dataclass(frozen=True, kw_only=True)
class Vehicle(Part):
    """A vehicle: mass, axles and their places, wheels, resistance, and its speed at the start."""

    mode: Literal["brake", "drive"] = text_field("brake", "whether its wheels are braked or driven")
    mass: float | None = number("kg", None, "mass; or tare and load", lo=100, hi=1e8)
    tare: float | None = number("kg", None, "mass without load", lo=100, hi=1e8)
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
        "kg m^2", None, "of one wheelset with all that turns with it", lo=0.1, hi=1e5
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


@dataclass(frozen=True, kw_only=True)
class Lag(Part):
    """Actuator of an axle: limits and a first-order lag, behind a dead time."""

    kind: Literal["lag"] = "lag"
    torque: float = number("N m", MISSING, "largest torque of one axle", lo=1, hi=1e6)
    lag: float = number("s", 0.05, "time constant", lo=1e-3, hi=5)
    gain: float = number("1", 1.0, "delivered by commanded torque", lo=0.1, hi=10)
    rate: float | None = number("N m/s", None, "largest rate of the torque", lo=1, hi=1e9)
    dead_time: float = number("s", 0.0, "from command to action", lo=0, hi=2)
    power: float | None = number(
        "W", None, "largest of one axle: its torque is at most that over the wheel speed",
        lo=1, hi=1e8,
    )  # fmt: skip
    top: float | None = number(
        "m/s", None, "rim speed above which it gives no torque", lo=0.1, hi=200
    )

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from _off_ticks("dead_time", self.dead_time)


@dataclass(frozen=True, kw_only=True)
class Valve(Part):
    """Air brake of an axle: a valve fills, holds or vents the cylinder, behind a dead time."""

    kind: Literal["valve"] = "valve"
    torque: float = number("N m", MISSING, "torque of one axle at full pressure", lo=1, hi=1e6)
    fill: float = number("s", 0.15, "time constant towards the supply", lo=1e-3, hi=5)
    vent: float = number("s", 0.10, "time constant towards the air", lo=1e-3, hi=5)
    band: float = number("1", 0.005, "pressure error that it holds at, of the full pressure",
                         lo=0, hi=0.5)  # fmt: skip
    dead_time: float = number("s", 0.0, "from command to action", lo=0, hi=2)

    def misfits(self) -> Iterator[Fault]:
        """A dead time that is no whole number of ticks."""
        yield from _off_ticks("dead_time", self.dead_time)


# ---- rail and demand -----------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Stretch(Part):
    """Rail from a place, or from a time, to where the next stretch begins."""

    place: float | None = number("m", None, "where it begins", lo=0, hi=1e6)
    time: float | None = number("s", None, "when it begins", lo=0, hi=1e5)
    condition: str = text_field(MISSING, "name of the rail condition")

    def misfits(self) -> Iterator[Fault]:
        """Neither place nor time, or both."""
        if (self.place is None) == (self.time is None):
            what = "neither" if self.place is None else "both"
            yield "", f"a section begins at a place or at a time; {what} is given"


@dataclass(frozen=True, kw_only=True)
class Slope(Part):
    """Gradient of the track from a place on."""

    place: float = number("m", MISSING, "where it begins", lo=0, hi=1e6)
    gradient: float = number("1", MISSING, "rise over run, uphill positive", lo=-0.1, hi=0.1)


@dataclass(frozen=True, kw_only=True)
class Track(Part):
    """Adhesion law of the rail, its conditions, and where each is."""

    law: str = text_field("double_exponential", "a law of the models by name, or my_law.py:law")
    conditions: Mapping[str, Mapping[str, float | str]] = text_field(
        {}, "parameters of the law by condition, beside those that the law brings"
    )
    sections: tuple[Stretch, ...] = text_field(MISSING, "along the track, or one after the other")
    gradient: float | tuple[Slope, ...] = number(
        "1", 0.0, "rise over run, uphill positive; or sections of it", lo=-0.1, hi=0.1
    )

    def wrong(self) -> Iterator[Fault]:
        """Numbers off range; sections that do not follow each other."""
        if isinstance(self.gradient, (int, float)):
            yield from super().wrong()
        else:
            yield from self.misfits()

    def misfits(self) -> Iterator[Fault]:
        """Sections that do not follow each other."""
        if not self.sections:
            yield "sections", "the rail has no section"
            return
        by = {"place" if s.place is not None else "time" for s in self.sections}
        if len(by) > 1:
            yield "sections", "some begin at a place and some at a time; use one of both"
            return
        lists: list[tuple[str, list[Any], str]] = [
            ("sections", [getattr(s, min(by)) for s in self.sections], "m" if self.placed else "s")
        ]
        if isinstance(self.gradient, tuple):
            if not self.placed:
                yield "gradient", "a gradient by place goes with sections by place"
            lists.append(("gradient", [s.place for s in self.gradient], "m"))
        for name, starts, unit in lists:
            if starts[:1] != [0.0]:
                yield f"{name}.0", f"the first one must begin at 0 {unit}"
            for k, (a, b) in enumerate(pairwise(starts), start=1):
                if b <= a:
                    yield f"{name}.{k}", f"begins at {b:g} {unit}, not after the one before"

    @property
    def placed(self) -> bool:
        """Whether the sections lie along the track, not in time."""
        return bool(self.sections) and self.sections[0].place is not None


@dataclass(frozen=True, kw_only=True)
class Constant(Part):
    """A demand that does not change; of a driver, a timetable, a fixed brake step."""

    kind: Literal["constant"] = "constant"
    deceleration: float | None = number("m/s^2", None, "of a braked vehicle", lo=0, hi=10)
    acceleration: float | None = number("m/s^2", None, "of a driven vehicle", lo=0, hi=10)
    force: float | None = number("N", None, "of all axles together, at the rims", lo=0, hi=1e8)
    until: str = text_field("", "when or where it ends, '12 s' or '130 m'; it is zero from then on")

    def misfits(self) -> Iterator[Fault]:
        """None of them, or more than one; an end that is none."""
        if getattr(self, "until", ""):
            fault = number_with_unit(self.until, "s", "m")
            if isinstance(fault, str):
                yield "until", fault
        names = ("deceleration", "acceleration", "force")
        given = [n for n in names if getattr(self, n) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none is given"
            yield "", f"a demand is one of {', '.join(names)}; {found}"

    def as_table(self) -> Constant | Profile:
        """The same as a table with a point at its end; itself where it does not end."""
        if not self.until:
            return self
        found = number_with_unit(self.until, "s", "m")
        assert not isinstance(found, str)
        end, unit = found
        names = ("deceleration", "acceleration", "force")
        level = {n: (getattr(self, n), 0.0) for n in names if getattr(self, n) is not None}
        over: Literal["time", "position"] = "time" if unit == "s" else "position"
        return Profile(over=over, at=(0.0, end), **level)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Profile(Part):
    """A demand over time, speed or position: held from point to point, over speed a line."""

    kind: Literal["table"] = "table"
    over: Literal["time", "speed", "position"] = text_field("time", "what the points are over")
    at: tuple[float, ...] = number("by over", MISSING, "time, speed or position of each point")
    deceleration: tuple[float, ...] | None = number("m/s^2", None, "at each point", lo=0, hi=10)
    acceleration: tuple[float, ...] | None = number("m/s^2", None, "at each point", lo=0, hi=10)
    force: tuple[float, ...] | None = number("N", None, "at each point", lo=0, hi=1e8)

    def misfits(self) -> Iterator[Fault]:
        """Lists of unequal length, points that do not rise."""
        yield from Constant.misfits(self)  # type: ignore[arg-type]
        given = next((v for v in (self.deceleration, self.acceleration, self.force) if v), ())
        if len(given) != len(self.at):
            yield "at", f"has {len(self.at)} values, the demand has {len(given)}"
        if any(b <= a for a, b in pairwise(self.at)):
            yield "at", "must rise from point to point"


@dataclass(frozen=True, kw_only=True)
class Most(Part):
    """As much as the rail carries: slip control holds the best slip all the time."""

    kind: Literal["adhesion"] = "adhesion"


# ---- sensors -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Exact(Part):
    """The true value."""

    kind: Literal["exact"] = "exact"


@dataclass(frozen=True, kw_only=True)
class ToothWheel(Part):
    """Wheel speed from the time between the edges of a tooth wheel."""

    kind: Literal["tooth_wheel"] = "tooth_wheel"
    teeth: int = number("1", 100, "teeth", lo=1, hi=1000)
    clock: float = number("s", 1e-6, "resolution of the timer", lo=1e-9, hi=1e-3)
    jitter: float = number("s", 2e-6, "of an edge, standard deviation", lo=0, hi=1e-3)


@dataclass(frozen=True, kw_only=True)
class NoisyWheel(Part):
    """Wheel speed with noise, steps and lost samples."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("rad/s", 0.0, "of the noise", lo=0, hi=100)
    step: float = number("rad/s", 0.0, "of the quantisation; 0 has none", lo=0, hi=100)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


@dataclass(frozen=True, kw_only=True)
class NoisySpeed(Part):
    """Vehicle speed with noise, steps and lost samples, as of a radar."""

    kind: Literal["noisy"] = "noisy"
    deviation: float = number("m/s", 0.0, "of the noise", lo=0, hi=10)
    step: float = number("m/s", 0.0, "of the quantisation; 0 has none", lo=0, hi=10)
    dropout: float = number("1", 0.0, "share of lost samples; the last one is held", lo=0, hi=0.99)


@dataclass(frozen=True, kw_only=True)
class WheelsOnly(Part):
    """Vehicle speed from the wheels alone: the axle that slips least, within a largest rate."""

    kind: Literal["wheels"] = "wheels"
    rate: float = number("m/s^2", 1.5, "most that the vehicle can change its speed", lo=0.01, hi=10)
    margin: float = number("1", 0.15, "share by which the torques may be wrong", lo=0, hi=1)
    beside: float = number(
        "m/s^2", 0.15, "what gradient and resistance may do beside the torques", lo=0, hi=5
    )


@dataclass(frozen=True, kw_only=True)
class Sensors(Part):
    """What the controllers measure."""

    wheel_speed: Exact | ToothWheel | NoisyWheel = text_field(ToothWheel(), "speed of each axle")
    vehicle_speed: Exact | NoisySpeed | WheelsOnly = text_field(Exact(), "speed of the vehicle")


# ---- reference and controllers -------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Searched(Part):
    """Best slip, estimated and searched while the loop runs, for each axle."""

    kind: Literal["searched"] = "searched"
    law: str = text_field("double_exponential", "law that is fitted, from the slip speed")
    start: Mapping[str, float | str] = text_field({}, "first guess of its parameters")
    noise: float = number("1", 1e-2, "of the measured adhesion, as the fit is told", lo=1e-6, hi=1)


@dataclass(frozen=True, kw_only=True)
class SlipSpeed(Part):
    """A fixed slip speed."""

    kind: Literal["speed"] = "speed"
    slip: float = number("m/s", MISSING, "slip speed to hold", lo=0.01, hi=20)


@dataclass(frozen=True, kw_only=True)
class SlipRatio(Part):
    """A fixed share of the vehicle's speed."""

    kind: Literal["ratio"] = "ratio"
    slip: float = number("1", MISSING, "slip over speed", lo=1e-3, hi=0.9)
    least: float = number("m/s", 0.2, "slip speed that it does not fall below", lo=0.01, hi=5)


Reference = Searched | SlipSpeed | SlipRatio


@dataclass(frozen=True, kw_only=True)
class SlipControl(Part):
    """When slip control takes over from the demand, and when it gives back."""

    wake: float = number("1", 0.5, "slip over the reference at which it takes over", lo=0, hi=1)
    least: float = number("m/s", 0.3, "slip below which it does not take over", lo=0, hi=20)
    rest: float = number("s", 0.2, "time of ruling demand after which it gives back", lo=0, hi=10)
    off: float = number("m/s", 1.0, "speed below which it is off and the demand is given",
                        lo=0, hi=10)  # fmt: skip
    safe: str | float = text_field("", "what an axle gets whose samples are not believed: 'demand',"
                             " 'hold', or a torque below the demand; none given: the demand, 0"
                             " for a driven vehicle")  # fmt: skip
    demand_lost: str | float = text_field("", "demand .2 s after it is no number any more:"
                                    " 'largest', or a torque; none given: the largest of a"
                                    " braked vehicle, 0 of a driven one")  # fmt: skip
    release: float = number("s", 10.0, "longest release of an axle, after which it gets the demand"
                            " for 1 s", lo=0.1, hi=600)  # fmt: skip
    release_still: float = number("s", 3.0, "longest release of an axle that does not run up",
                                  lo=0.1, hi=600)  # fmt: skip
    radius: float | tuple[float, ...] | None = number(
        "m", None, "of the wheels, or of each axle with an actuator, as the controllers believe;"
        " none given: as it is", lo=0.2, hi=1,
    )  # fmt: skip
    learn: bool | None = text_field(
        None, "whether the ratios of the radii are learnt while no wheel slips; none given: where"
        " the vehicle's speed is from the wheels",
    )  # fmt: skip

    def misfits(self) -> Iterator[Fault]:
        """A safe output or a demand that is neither a word that there is nor a torque."""
        for name, words in (("safe", ("demand", "hold")), ("demand_lost", ("largest",))):
            given = getattr(self, name)
            if isinstance(given, str) and given not in ("", *words):
                fault = torque_of(given)
                if isinstance(fault, str):
                    yield name, f"is {given!r}; write {' or '.join(map(repr, words))}, or a torque"
            elif not isinstance(given, str) and off_range(
                given, {"unit": "N m", "lo": 0, "hi": 1e6}
            ):
                yield name, off_range(given, {"unit": "N m", "lo": 0, "hi": 1e6})


@dataclass(frozen=True, kw_only=True)
class Limits(Part):
    """Largest values that are accepted: a run that is above one is marked."""

    distance: float | None = number("m", None, "over the run", lo=0)
    stopping_distance: float | None = number("m", None, "until standstill", lo=0)
    settling_time: float | None = number("s", None, "after each change of the rail", lo=0)
    lock_time: float | None = number("s", None, "with a wheel that stands still", lo=0)
    slip_max: float | None = number("m/s", None, "slip speed", lo=0)
    slip_error_rms: float | None = number("m/s", None, "slip minus its reference", lo=0)
    torque_ripple: float | None = number("N m", None, "before each change of the rail", lo=0)
    jerk_rms: float | None = number("m/s^3", None, "of the vehicle", lo=0)


@dataclass(frozen=True, kw_only=True)
class SlipLaw(Part):
    """A slip law of the papers by its name, with its own gains; ``slipctl list kinds`` has them."""

    kind: Literal[SLIP_LAWS] = text_field("pid", "which law")  # type: ignore[valid-type]
    lead: float = number("1", 1.0, "actuator's lag over the one that it shall have", lo=1, hi=20)
    reference: Reference | None = text_field(None, "slip to go to, instead of the trip's")
    gains: Mapping[str, float | str] = field(
        default_factory=dict, metadata={"rest": True, "doc": "parameters of the law by name"}
    )


@dataclass(frozen=True, kw_only=True)
class Predictive(Part):
    """Predictive slip control: the best slip within torque, rate and slip limits."""

    kind: Literal["nmpc"] = "nmpc"
    ticks: int = number("1", 2, "ticks from one solution to the next, length of a stage",
                        lo=1, hi=50)  # fmt: skip
    horizon: int = number("1", 40, "stages", lo=9, hi=200)
    slip: float = number("1", 1.0, "weight of the slip error over the best slip", lo=0, hi=1e6)
    change: float = number("1", 0.02, "weight of the torque still to come", lo=0, hi=1e6)
    beyond: float = number("1", 2.0, "weight of slip beyond 1.5 times its reference", lo=0, hi=1e6)
    rate: float = number("1", 20.0, "largest rate, in largest torques a lag", lo=0.01, hi=1e3)
    pole: float = number("1", 3.0, "of the observer, over the reciprocal lag", lo=0.1, hi=100)
    smooth: float = number("1", 1.2, "filter of the reference, in lags", lo=0.01, hi=100)
    reference: Reference | None = text_field(None, "slip to go to, instead of the trip's")


@dataclass(frozen=True, kw_only=True)
class DemandAlone(Part):
    """No slip control: the demand as it is."""

    kind: Literal["none"] = "none"


@dataclass(frozen=True, kw_only=True)
class OwnLaw(Part):
    """A slip law of one's own: a block from what it needs of v, v_s, v_best, F, D to T_wanted."""

    kind: Literal["file"] = "file"
    block: str = text_field(MISSING, "my_law.py:block, or a model by name")
    lead: float = number("1", 1.0, "actuator's lag over the one that it shall have", lo=1, hi=20)
    reference: Reference | None = text_field(None, "slip to go to, instead of the trip's")
    gains: Mapping[str, float | str] = field(
        default_factory=dict, metadata={"rest": True, "doc": "parameters of the block by name"}
    )


Controller = SlipLaw | Predictive | DemandAlone | OwnLaw


# ---- what slipctl tune draws ---------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Drawn(Part):
    """What differs from draw to draw where gains are tuned."""

    seeds: bool = text_field(False, "whether the noise is drawn anew")
    draw: Mapping[str, str] = text_field({}, "range of each number that is drawn, m = '36t:42t'")
    scale: Mapping[str, str] = text_field({}, "factors and what each multiplies, '0.8:1.2 of c'")

    def misfits(self) -> Iterator[Fault]:
        """An ensemble that is empty, a range that is none."""
        for name, text in self.draw.items():
            ends = [_size(end) for end in str(text).split(":")]
            if len(ends) == 2 and None not in ends and not ends[0] < ends[1]:  # type: ignore[operator]
                yield f"draw.{name}", f"{text!r} is no range; write the lower end first"
        if not (self.draw or self.scale or self.seeds):
            yield "", "the ensemble is empty; write what differs from draw to draw, seeds = true"


@dataclass(frozen=True, kw_only=True)
class Assumed(Part):
    """What ``slipctl certify`` takes for granted where it bounds what a law has to withstand."""

    error: float = number("1", 0.1, "share by which a fitted adhesion may be wrong", lo=0, hi=1)
    tube: float = number("1", 0.05, "share of the best slip within which the slip is held",
                         lo=1e-3, hi=0.5)  # fmt: skip
    push: float = number("m/s^2", 0.1, "what pushes the slip of an axle in any way, beside what the"
                         " other axles do", lo=0, hi=100)  # fmt: skip
    noise: float = number("m/s", 0.0, "largest noise of the slip that a controller sees", lo=0,
                          hi=10)  # fmt: skip
    off: float = number("m/s", 0.0, "how far the slip may be off its rest at the start", lo=0,
                        hi=10)  # fmt: skip
    time: float | None = number("s", None, "for which a controller that runs is asked; not told:"
                                " for ever", lo=1e-3, hi=10)  # fmt: skip
    slip: float | None = number("m/s", None, "slip that a slide protection never lets be exceeded;"
                                " not told: that of a locked wheel", lo=1e-3, hi=150)  # fmt: skip


# ---- all of it -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Trip(Part):
    """A vehicle on its way: what it is, what it runs on, what is wanted, and who controls it."""

    title: str = text_field("A vehicle of one's own", "a line for report and figures")
    duration: float = number("s", 30.0, "of the run", lo=0.01, hi=1e4)
    end: str = text_field("", "what ends a run before: 'standstill', or a place of the first axle")
    vehicle: Vehicle = text_field(MISSING, "the vehicle")
    actuator: Lag | Valve = text_field(MISSING, "what turns or brakes each axle")
    rail: Track = text_field(MISSING, "the rail")
    demand: Constant | Profile | Most = text_field(Most(), "what is wanted")
    sensors: Sensors = text_field(Sensors(), "what is measured")
    reference: Reference = text_field(Searched(), "slip that the controllers go to")
    control: SlipControl = text_field(SlipControl(), "when slip control takes over")
    controllers: Mapping[str, Controller] = text_field(
        MISSING, "controllers by a name of one's own"
    )
    limits: Limits = text_field(Limits(), "what a run may not exceed")
    ensemble: Drawn | None = text_field(
        None, "what differs from draw to draw where gains are tuned"
    )
    certify: Assumed = text_field(Assumed(), "what certificates take for granted")
    seed: int = number("1", 1, "of all noise", lo=0, hi=2**31)
    noise: float = number("1", 1.0, "factor on every noise; 0 is silent", lo=0, hi=100)

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
    def learns(self) -> bool:
        """Whether the ratios of the radii are learnt."""
        if self.control.learn is None:
            wheels = isinstance(self.sensors.vehicle_speed, WheelsOnly)
            return wheels and len(self.vehicle.worked) > 1
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
        if isinstance(self.actuator, Valve) and self.vehicle.mode == "drive":
            yield "actuator.kind", "a valve brakes; a driven vehicle takes kind = 'lag'"
        believed, worked = self.control.radius, len(self.vehicle.worked)
        if isinstance(believed, (list, tuple)) and len(believed) != worked:
            yield (
                "control.radius",
                f"has {len(believed)} values for {worked} axles with an actuator",
            )
        if self.control.learn and worked < 2:
            yield "control.learn", "one axle has no ratio to learn"
        if isinstance(self.sensors.vehicle_speed, WheelsOnly) and self.vehicle.axles < 2:
            yield "sensors.vehicle_speed", "one axle that slips tells no speed; use another kind"
        for name in self.controllers:
            if not name.isidentifier() or name == "ideal":
                yield f"controllers.{name}", "write a name of letters, digits and _; not 'ideal'"
