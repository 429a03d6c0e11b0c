"""What the driver wants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import Literal

from slipctl.models.vehicle.parts.declaration import (
    Fault,
    Part,
    number,
    number_with_unit,
    text_field,
)


@dataclass(frozen=True, kw_only=True)
class Constant(Part):
    """A demand that does not change; of a driver, a timetable, a fixed brake step."""

    kind: Literal["constant"] = "constant"
    deceleration: float | None = number(
        "m/s^2", None, "deceleration of a braked vehicle", lo=0, hi=10
    )
    acceleration: float | None = number(
        "m/s^2", None, "acceleration of a driven vehicle", lo=0, hi=10
    )
    force: float | None = number(
        "N", None, "force of all axles together, at the rims", lo=0, hi=1e8
    )
    until: str = text_field(
        "", "when or where the demand ends, '12 s' or '130 m'; it is 0 from then on"
    )

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

    @property
    def end(self) -> tuple[float, str] | None:
        """When or where it ends, in s or m, with the unit; None where it does not."""
        found = number_with_unit(self.until, "s", "m") if self.until else None
        assert not isinstance(found, str)  # misfits have said so
        return found

    def as_table(self) -> Constant | Profile:
        """The same as a table with a point at its end; itself where it does not end."""
        if self.end is None:
            return self
        end, unit = self.end
        names = ("deceleration", "acceleration", "force")
        level = {n: (getattr(self, n), 0.0) for n in names if getattr(self, n) is not None}
        over: Literal["time", "position"] = "time" if unit == "s" else "position"
        return Profile(over=over, at=(0.0, end), **level)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Profile(Part):
    """A demand over time, speed or position: held from point to point, over speed a line."""

    kind: Literal["table"] = "table"
    over: Literal["time", "speed", "position"] = text_field("time", "what the demand depends on")
    at: tuple[float, ...] = number("by over", MISSING, "time, speed or position of each point")
    deceleration: tuple[float, ...] | None = number(
        "m/s^2", None, "value at each point", lo=0, hi=10
    )
    acceleration: tuple[float, ...] | None = number(
        "m/s^2", None, "value at each point", lo=0, hi=10
    )
    force: tuple[float, ...] | None = number("N", None, "value at each point", lo=0, hi=1e8)

    def misfits(self) -> Iterator[Fault]:
        """No point, lists of unequal length, points that do not rise."""
        yield from Constant.misfits(self)  # type: ignore[arg-type]
        if not self.at:
            yield "at", "has no point; write one at least"
        given = next((v for v in (self.deceleration, self.acceleration, self.force) if v), ())
        if len(given) != len(self.at):
            yield "at", f"has {len(self.at)} values, the demand has {len(given)}"
        if any(b <= a for a, b in pairwise(self.at)):
            yield "at", "must rise from point to point"


@dataclass(frozen=True, kw_only=True)
class Most(Part):
    """As much as the rail carries: slip control holds the best slip all the time."""

    kind: Literal["adhesion"] = "adhesion"
