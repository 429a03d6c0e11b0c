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
