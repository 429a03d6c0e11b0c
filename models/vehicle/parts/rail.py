"""The rail: adhesion law, conditions and where each is, gradient."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import Any

from slipctl.models.vehicle.parts.declaration import Fault, Part, number, text_field


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
class Patch(Part):
    """A stretch of rail under a layer: leaves, rust and water, oil."""

    begin: float = number("m", MISSING, "where it begins", lo=-1e6, hi=1e6, key="from")
    end: float = number("m", MISSING, "where it ends", lo=-1e6, hi=1e6, key="to")
    peak: float | None = number(
        "1", None, "largest adhesion at this place, instead of `peak` of all places", lo=1e-3, hi=1
    )

    def misfits(self) -> Iterator[Fault]:
        """An end that is not behind the beginning."""
        if self.end <= self.begin:
            yield (
                "to",
                f"is {self.end:g} m, the place begins at {self.begin:g} m; write a larger one",
            )


@dataclass(frozen=True, kw_only=True)
class Sand(Part):
    """Sand in front of axles, on the contaminated rail, while one of them slides."""

    axles: tuple[int, ...] = number("1", MISSING, "axles with a sander, 1 the first", lo=1, hi=32)
    ahead: float = number("m", 0.4, "distance of the nozzle ahead of the axle", lo=-10, hi=10)
    rate: float = number("kg/s", 0.03, "sand from a nozzle, on one rail", lo=0, hi=1)
    grip: float = number(
        "kg/m",
        7.5e-3,
        "sand per metre of one rail that recovers 63 % of the adhesion",
        lo=1e-6,
        hi=1,
    )
    carry: float = number("1", 0.7, "share of the sand that remains behind a wheel", lo=0, hi=1)
    delay: float = number("s", 1.0, "delay from the slide to the sand", lo=0, hi=60)
    above: float = number("m/s", 25 / 3.6, "speed above which the sander works", lo=0, hi=150)
    slip: float = number(
        "1", 0.05, "slip ratio of an axle above which the sander works", lo=1e-3, hi=1
    )

    def misfits(self) -> Iterator[Fault]:
        """A nozzle behind its axle, an axle twice."""
        if self.ahead < 0:
            yield "ahead", f"is {self.ahead:g} m: the nozzle is behind its axle; write it above 0"
        if not self.axles or len(set(self.axles)) != len(self.axles):
            yield "axles", "must name each axle with a sander, and none twice"


@dataclass(frozen=True, kw_only=True)
class Contamination(Part):
    """A layer on the rail, which wheels that slide clean for the wheels behind them."""

    law: str = text_field("", "adhesion law of the layer; none given: the law of the rail")
    condition: str = text_field("", "rail condition of that law; none given: the law as it stands")
    numbers: Mapping[str, float | str] = text_field({}, "parameters of that law")
    peak: float | None = number(
        "1",
        None,
        "largest adhesion of the layer, at the speed at the start; none given: that of the law",
        lo=1e-3,
        hi=1,
    )
    tau: float = number(
        "m/J",
        3.4e-5,
        (
            "strength of the cleaning: 1 over the energy per metre of one rail that"
            " recovers 63 % of the adhesion; 0: wheels clean nothing"
        ),
        lo=0,
        hi=1,
    )
    layers: float = number(
        "1",
        1.0,
        (
            "exponent of the cleaning; with 1 adhesion recovers from the first joule, with"
            " 2 late, as with two layers"
        ),
        lo=1,
        hi=10,
        needs=("tau",),
    )
    own: bool = text_field(
        False, "whether a wheel itself runs on the rail that it cleans", needs=("tau",)
    )
    drying: float | None = number(
        "s", None, "time constant in which the layer dries by itself", lo=1, hi=1e6
    )
    fouling: float | None = number(
        "s", None, "time constant in which cleaned rail is fouled again", lo=1, hi=1e6
    )
    cell: float = number("m", 0.25, "length over which the energy is averaged", lo=0.15, hi=5)
    places: tuple[Patch, ...] = text_field((), "where the layer lies; none given: everywhere")
    sand: Sand | None = text_field(None, "sanders; none given: no sand")

    def misfits(self) -> Iterator[Fault]:
        """A nozzle so near to its axle that the sand is not measured before the wheel is there."""
        if self.sand is not None and 0 <= self.sand.ahead < self.cell:
            yield (
                "sand.ahead",
                f"is {self.sand.ahead:g} m, within a cell of {self.cell:g} m; write at least that",
            )


@dataclass(frozen=True, kw_only=True)
class Track(Part):
    """Adhesion law of the rail, its conditions, and where each is."""

    law: str = text_field("double_exponential", "a law of the models by name, or my_law.py:law")
    conditions: Mapping[str, Mapping[str, float | str]] = text_field(
        {}, "parameters of the law by condition, beside those that the law brings"
    )
    sections: tuple[Stretch, ...] = text_field(
        MISSING, "sections along the track, or one after the other in time"
    )
    gradient: float | tuple[Slope, ...] = number(
        "1", 0.0, "rise over run, uphill positive; or sections of it", lo=-0.1, hi=0.1
    )
    contamination: Contamination | None = text_field(
        None, "a layer on the rail; none given: clean rail"
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

    @property
    def slopes(self) -> list[float]:
        """Gradients of the track."""
        given = self.gradient
        return [s.gradient for s in given] if isinstance(given, tuple) else [given]

    @property
    def falls(self) -> bool:
        """Whether the track goes downhill anywhere."""
        return min(self.slopes) < 0
