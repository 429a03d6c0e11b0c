"""The world of a run: rail sections by time or by position, demand, noise, start, seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from slipctl import registry
from slipctl.errors import (
    BadInput,
    check_finite,
    check_kinds,
    check_number,
    check_whole,
    own_copy,
    value_text,
)

Feed = float | Sequence[Any] | Callable[[np.ndarray], np.ndarray]
"""Value of an input: a number, steps ((time in s, value), ...), or a function of the times."""


@dataclass(frozen=True)
class Section:
    """A stretch of rail, from ``start`` to the start of the next one.

    Args:
        start: where it begins: s for a rail by time, m for a rail by position.
        condition: rail condition by name, ``"dry"``; the adhesion law says what it means.
        values: further parameters or inputs of the loop that hold here, ``{"R": 800}`` [SI].
        length: its length, checked against the next start; None lasts to the next one.
    """

    start: float
    condition: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    length: float | None = None

    def __post_init__(self) -> None:
        given = {k: v for k, v in vars(self).items() if k in ("condition", "values")}
        check_kinds("Section", Section, given)  # Rail looks at start and length
        object.__setattr__(self, "values", own_copy(self.values))


@dataclass(frozen=True)
class Rail:
    """Sections in order, by time or by position.

    Args:
        sections: the first starts at 0.
        by: ``"time"``, ``"position"`` (the loop's only state named ``x``), or the full name of
            the state that carries the position. If its block has a parameter ``behind`` (the places
            of axles behind it), what each axle has of its own changes when that axle gets there.

    Raises:
        BadInput: no sections, what is no section, first start not 0, sections that overlap or are
            empty.
    """

    sections: tuple[Section, ...]
    by: str = "time"

    def __init__(self, sections: Sequence[Section], by: str = "time") -> None:
        if not isinstance(sections, Sequence):
            raise BadInput(f"a Rail takes a list of sections, not {sections!r}")
        if not isinstance(by, str):
            raise BadInput(
                f"a Rail goes by 'time', 'position' or a state's name, not {value_text(by)}"
            )
        object.__setattr__(self, "sections", tuple(sections))
        object.__setattr__(self, "by", by)
        unit = "s" if by == "time" else "m"
        if not self.sections:
            raise BadInput("a Rail needs at least one Section")
        for k, s in enumerate(self.sections):
            if not isinstance(s, Section):
                raise BadInput(
                    f"rail section {k} is {value_text(s)}; write Section(start, condition)"
                )
            check_number(f"start of rail section {k}", s.start, unit)
            if s.length is not None:
                check_number(f"length of rail section {k}", s.length, unit)
        if self.sections[0].start != 0:
            raise BadInput(
                f"the first rail section starts at {self.sections[0].start:g} {unit}, not 0"
            )
        for k, s in enumerate(self.sections):
            if not math.isfinite(s.start):
                raise BadInput(f"rail section {k} starts at {s.start} {unit}; give a finite number")
            if s.length is not None and not s.length > 0:
                raise BadInput(f"rail section {k} is {s.length:g} {unit} long; it must be positive")
        for k, (a, b) in enumerate(zip(self.sections, self.sections[1:], strict=False)):
            if b.start == a.start:
                raise BadInput(
                    f"rail section {k} is empty: section {k + 1} starts at {b.start:g} {unit} too"
                )
            if b.start < a.start:
                raise BadInput(
                    f"rail sections overlap: section {k + 1} starts at {b.start:g} {unit},"
                    f" before section {k} at {a.start:g} {unit}; sort them by start"
                )
            if a.length is not None and a.start + a.length > b.start + 1e-12:
                raise BadInput(
                    f"rail sections overlap: section {k} ends at {a.start + a.length:g} {unit},"
                    f" section {k + 1} starts at {b.start:g} {unit}"
                )

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    @property
    def starts(self) -> np.ndarray:
        """Starts of the sections, s or m."""
        return np.array([s.start for s in self.sections])

    def at(self, where: float) -> Section:
        """Section in force at a time in s or a position in m."""
        check_number("where on the rail", where)
        k = int(np.searchsorted(self.starts, where, side="right")) - 1
        return self.sections[max(k, 0)]


@dataclass(frozen=True)
class End:
    """What ends a run before its duration: a signal that has stayed below, or above, a level.

    Args:
        signal: state or output of the loop by its full name; of several axles all have to be there.
        below: its absolute value is at most this; or
        above: it is at least this.
        hold: how long, in s.
        returns: it has to have been elsewhere before; a train that has not started yet has not
            come to a stand.

    Raises:
        BadInput: neither or both of below and above, a hold that is negative.
    """

    signal: str
    below: float | None = None
    above: float | None = None
    hold: float = 0.0
    returns: bool = False

    def __post_init__(self) -> None:
        check_kinds("End", End, vars(self))
        if (self.below is None) == (self.above is None):
            raise BadInput(f"the end by {self.signal} needs one of below= and above=")
        level = self.above if self.below is None else self.below
        check_finite(f"the end by {self.signal}: its level", level)
        if self.below is not None and self.below < 0:
            raise BadInput(f"the end by {self.signal}: no absolute value is below {self.below:g}")
        if not (math.isfinite(self.hold) and self.hold >= 0):
            raise BadInput(f"the end by {self.signal}: hold {self.hold:g} s must be 0 or positive")

    def there(self, values: np.ndarray) -> np.ndarray:
        """Ticks at which the signal is there, of its values with a row a tick."""
        if self.below is not None:
            near = np.abs(values) <= self.below
        else:
            near = values >= float(self.above or 0.0)
        return np.asarray(near.all(axis=1))


@dataclass(frozen=True)
class Scenario:
    """One situation: rail, duration, inputs, start, noise and seed.

    Args:
        name: name in files and figures.
        duration: in s.
        rail: conditions along the run; None leaves the loop's own parameters.
        inputs: feeds (see :data:`Feed`) of the loop's inputs by full or last name, in the
            input's unit.
        start: start values of states by full or last name.
        params: parameters by full or last name, for the whole run.
        noise: factor on every noise source; 0 is silent.
        seed: of all noise; each source has its own stream, keyed by seed and signal path.
        end: what ends the run before its duration; None runs all of it.

    Raises:
        BadInput: a duration or noise that is not positive or not finite, a seed that is no whole
            number, a rail that is none.
    """

    name: str
    duration: float
    rail: Rail | None = None
    inputs: Mapping[str, Any] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)
    noise: float = 1.0
    seed: int = 1
    doc: str = ""
    end: End | None = None

    def __post_init__(self) -> None:
        check_kinds("Scenario", Scenario, {"name": self.name})
        check_number(f"scenario {self.name}: duration", self.duration, "s")
        check_number(f"scenario {self.name}: noise", self.noise)
        check_whole(f"scenario {self.name}: seed", self.seed, 0)
        if not isinstance(self.rail, Rail | None):
            raise BadInput(f"scenario {self.name}: rail is {self.rail!r}; write Rail([...])")
        if not (math.isfinite(self.duration) and self.duration > 0):
            raise BadInput(f"scenario {self.name}: duration {self.duration:g} s must be positive")
        if not (math.isfinite(self.noise) and self.noise >= 0):
            raise BadInput(f"scenario {self.name}: noise {self.noise:g} must be 0 or positive")
        check_kinds("Scenario", Scenario, vars(self))
        for name in ("inputs", "start", "params"):
            object.__setattr__(self, name, own_copy(getattr(self, name)))

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    def but(self, **changes: Any) -> Scenario:
        """Return the scenario with some fields replaced."""
        return replace(self, **changes)

    @property
    def changes(self) -> list[float]:
        """Times in s at which the rail changes (empty for a rail by position)."""
        if self.rail is None or self.rail.by != "time":
            return []
        return [float(t) for t in self.rail.starts[1:] if t < self.duration]
