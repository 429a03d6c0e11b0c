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
        "1", None, "largest adhesion there, instead of the one of all places", lo=1e-3, hi=1
    )

    def misfits(self) -> Iterator[Fault]:
        """An end that is not behind the beginning."""
        if self.end <= self.begin:
            yield (
                "to",
                f"is {self.end:g} m, the place begins at {self.begin:g} m; write a larger one",
            )


@dataclass(frozen=True, kw_only=True)
class Contamination(Part):
    """A layer on the rail, which wheels that slide clean for the wheels behind them."""

    law: str = text_field("", "creep law under the layer; none is the law of the rail")
    condition: str = text_field("", "condition of that law; none is the law as it stands")
    numbers: Mapping[str, float | str] = text_field({}, "parameters of that law")
    peak: float | None = number(
        "1", None, "largest adhesion of the layer at the speed at the start; none: as it is",
        lo=1e-3, hi=1,
    )  # fmt: skip
    tau: float = number(
        "m/J", 3.4e-5, "strength of the cleaning: 1 by the energy per metre of one rail that"
        " recovers 63 %; 0 cleans nothing", lo=0, hi=1,
    )  # fmt: skip
    layers: float = number(
        "1", 1.0, "1 recovers at once, 2 late: both layers have to go", lo=1, hi=10
    )
    own: bool = text_field(False, "whether a wheel finds what it cleans itself")
    drying: float | None = number(
        "s", None, "time in which the layer dries by itself", lo=1, hi=1e6
    )
    fouling: float | None = number(
        "s", None, "time in which cleaned rail is fouled again", lo=1, hi=1e6
    )
    cell: float = number("m", 0.25, "length over which the energy is averaged", lo=0.15, hi=5)
    places: tuple[Patch, ...] = text_field((), "where the layer is; none: everywhere")


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
    contamination: Contamination | None = text_field(None, "a layer on the rail; none: it is clean")

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
    def falls(self) -> bool:
        """Whether the track goes downhill anywhere."""
        given = self.gradient
        slopes = [s.gradient for s in given] if isinstance(given, tuple) else [given]
        return min(slopes) < 0
