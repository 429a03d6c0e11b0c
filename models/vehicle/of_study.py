"""A loop of a study as a vehicle of one's own: its equations by name, all of its numbers in a file.

The file says which loops of which study run, and gives every number of them, of their rail and of
their scenario. A number that stands as the study has it changes nothing, so that a file as it was
written runs to the bits of the study's own run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from slipctl import BadInput, Block, Case, Rail, Scenario, Section
from slipctl.block.shared_numbers import number_at, targets
from slipctl.block.signals import Signal
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import nearest
from slipctl.models.vehicle.parts import Fault, Limits, Part, number, text_field
from slipctl.run.results import Loops
from slipctl.run.scenario_inputs import given_by, loop_at_start, rail_values
from slipctl.study import resolve
from slipctl.study.declaration import Figure, Study


def free(doc: str) -> Any:
    """Declare a table whose keys are names that a loop has, dots and all."""
    return field(default_factory=dict, metadata={"free": True, "doc": doc})


@dataclass(frozen=True, kw_only=True)
class OfStudy(Part):
    """A vehicle whose equations are those of a study."""

    kind: Literal["study"] = text_field("study", "its equations are those of a study")
    study: str = text_field("", "the study by name, or my_study.py")
    scenario: str = text_field("", "one of its scenarios; none given: the first")


@dataclass(frozen=True, kw_only=True)
class StudyLoop(Part):
    """A loop of the study, with numbers of its own."""

    kind: Literal["study"] = text_field("study", "a loop of the study")
    loop: str = text_field("", "name of the loop in the study; none given: the table's own name")
    numbers: Mapping[str, Any] = free("numbers of this loop alone, by their names in it")


@dataclass(frozen=True, kw_only=True)
class StudySection(Part):
    """Rail from a place or a time to where the next section begins."""

    place: float | None = number("m", None, "where it begins", lo=0, hi=1e7)
    time: float | None = number("s", None, "when it begins", lo=0, hi=1e6)
    condition: str | None = text_field(None, "name of the rail condition")
    values: Mapping[str, Any] = free("inputs and parameters of the loops that hold there")


@dataclass(frozen=True, kw_only=True)
class StudyRail(Part):
    """Rail of a loop of a study."""

    conditions: Mapping[str, Any] = free("parameters by the name of a condition")
    sections: tuple[StudySection, ...] = text_field((), "one after the other")

    def misfits(self) -> Iterator[Fault]:
        """Sections of neither place nor time, or of both kinds."""
        kinds = set()
        for k, s in enumerate(self.sections):
            if (s.place is None) == (s.time is None):
                yield f"sections.{k}", "a section begins at a place or at a time; write one of both"
            kinds.add(s.place is None)
        if len(kinds) > 1:
            yield "sections", "some begin at a place and some at a time; use one of both"


@dataclass(frozen=True, kw_only=True)
class StudyTrip(Part):
    """Loops of a study on their way, with numbers of one's own."""

    title: str = text_field("A loop of a study", "a line for report and figures")
    duration: float | None = number("s", None, "of the run", lo=1e-3, hi=1e5)
    seed: int | None = number("1", None, "of all noise", lo=0, hi=2**31)
    noise: float | None = number("1", None, "factor on every noise; 0 is silent", lo=0, hi=100)
    vehicle: OfStudy = text_field(OfStudy(), "the study that has the equations")
    rail: StudyRail | None = text_field(None, "the rail; none given: the study's own")
    inputs: Mapping[str, Any] = free("inputs of the loops, which hold for the whole run")
    start: Mapping[str, Any] = free("start values of states")
    numbers: Mapping[str, Any] = free("numbers of all loops, by their names in them")
    controllers: Mapping[str, StudyLoop] = text_field({}, "loops by a name of one's own")
    limits: Limits = text_field(Limits(), "what a run may not exceed")

    def misfits(self) -> Iterator[Fault]:
        """No study, no loop, or names that are none."""
        if not self.vehicle.study:
            yield "vehicle.study", "is missing; write the name of a study, such as 'hst_braking'"
        if not self.controllers:
            yield "controllers", "there is no loop; write [controllers.NAME] and kind = 'study'"
        for name in self.controllers:
            if not name.isidentifier():
                yield f"controllers.{name}", "write a name of letters, digits and _"


# ---- the study of a file -------------------------------------------------------------------------

Keys = tuple[str | int, ...]
Wrong = tuple[Keys, str]


def flat(table: Mapping[str, Any], keys: Keys = ()) -> Iterator[tuple[Keys, Any]]:
    """Entries of nested tables, each with the keys that lead to it."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, (*keys, key))
        else:
            yield (*keys, key), value


def in_unit(value: Any, signal: Signal) -> Any:
    """Number of a file, or a list of them, in the unit of a signal.

    Raises:
        BadInput: no number, another dimension, off range.
    """

    def one(given: Any) -> Any:
        if isinstance(given, list):
            return [one(g) for g in given]
        if isinstance(given, str):
            return parse_quantity(given, signal.unit)
        if isinstance(given, bool) or not isinstance(given, (int, float)):
            raise BadInput(f"is {given!r}; write a number in {signal.unit}")
        if signal.unit != "1":
            raise BadInput(f"{given:g} has no unit; write '{given:g} {signal.unit}'")
        return float(given)

    found = one(value)
    signal.check(signal.name, found)
    return found


class Reading:
    """A file's numbers put into the loops of its study; collects what is wrong with them."""

    def __init__(self, trip: StudyTrip, models: Mapping[str, Any] | None = None) -> None:
        self.trip, self.wrong = trip, list[Wrong]()
        self.base = resolve.load_study(trip.vehicle.study)
        base = self.base if models is None else replace(self.base, models=models)
        cases = resolve.build_cases(base)
        names = [c.scenario.name for c in cases]
        wanted = trip.vehicle.scenario or names[0]
        if wanted not in names:
            raise BadInput(f"{self.base.name} has no scenario {wanted!r}{nearest(wanted, names)}")
        self.case = cases[names.index(wanted)]
        self.asked = {n: part.loop or n for n, part in trip.controllers.items()}

    def check(self) -> list[Wrong]:
        """Everything that is wrong with the numbers, each with the keys to where it stands."""
        for name, loop in self.asked.items():
            if loop not in self.case.loops:
                here = f"{self.base.name}@{self.case.scenario.name} has no loop {loop!r}"
                keys = ("controllers", name, "loop")
                self.wrong.append((keys, here + nearest(loop, self.case.loops)))
        if self.wrong:
            return self.wrong
        loops = {n: self.case.loops[loop] for n, loop in self.asked.items()}
        every = list(loops.values())
        for keys, value in flat(self.trip.numbers, ("numbers",)):
            self._checked(every, keys, 1, value, ("param",))
        for keys, value in flat(self.trip.start, ("start",)):
            self._checked(every, keys, 1, value, ("state",))
        for keys, value in flat(self.trip.inputs, ("inputs",)):
            self._checked(every, keys, 1, value, ("input",))
        for name, part in self.trip.controllers.items():
            for keys, value in flat(part.numbers, ("controllers", name, "numbers")):
                self._checked([loops[name]], keys, 3, value, ("param", "state"))
        rail = self.trip.rail
        for keys, value in flat(rail.conditions if rail else {}, ("rail", "conditions")):
            self._checked(every, keys, 3, value, ("param",))
        for k, section in enumerate(rail.sections if rail else ()):
            for keys, value in flat(section.values, ("rail", "sections", k, "values")):
                self._checked(every, keys, 4, value, ("input", "param"))
        if not self.wrong:
            self._tried(loops)
        return self.wrong

    def _tried(self, loops: Mapping[str, Block]) -> None:
        """Whether the loops take their numbers together, and the rail its sections."""
        for name in loops:
            try:
                loop, scenario = self.loop(name), self.scenario()
                rail_values(loop_at_start(loop, scenario), scenario)
            except BadInput as error:
                self.wrong.append((("controllers", name), str(error)))

    def _checked(
        self, loops: list[Block], keys: Keys, skip: int, value: Any, roles: tuple[str, ...]
    ) -> None:
        """Whether one of the loops has a number of this name and takes the value."""
        name, why = ".".join(str(k) for k in keys[skip:]), ""
        for loop in loops:
            if self._of_others(loop, name):
                continue
            try:
                meant = targets(loop, name, roles)
                for full in meant:
                    in_unit(value, _signal(loop, full))
            except BadInput as error:
                self.wrong.append((keys, str(error)))
                return
            if meant:
                return
            known = [n for role in roles for n in loop._signals[role]]
            why = why or f"{loop.name} has no number {name!r}{nearest(name, known)}"
        self.wrong.append((keys, why))

    def _of_others(self, loop: Block, name: str) -> bool:
        """Whether a name is the full one of other loops, and no full one of this."""
        every = [self.case.loops[n] for n in self.asked.values()]
        return not _has(loop, name) and any(_has(other, name) for other in every)

    def _numbers(self, loop: Block, table: Mapping[str, Any], *roles: str) -> dict[str, Any]:
        """Numbers of a table that a loop has, by full names."""
        found: dict[str, Any] = {}
        for keys, value in flat(table):
            name = ".".join(str(k) for k in keys)
            for full in [] if self._of_others(loop, name) else targets(loop, name, roles):
                found[full] = in_unit(value, _signal(loop, full))
        return found

    def loop(self, name: str) -> Block:
        """Loop of a controller, with the numbers of the file that differ from the study's."""
        loop, scenario = self.case.loops[self.asked[name]], self.case.scenario
        ruled = {number_at(loop, n): v for n, v in given_by(loop, scenario).items()}
        before = loop.with_params(**ruled) if ruled else loop
        given = self._numbers(loop, self.trip.numbers, "param")
        given |= self._numbers(loop, self.trip.start, "state")
        given |= self._numbers(loop, self.trip.controllers[name].numbers, "param", "state")
        now = before.values_by_place() | before.start()
        other = {n: v for n, v in given.items() if not np.array_equal(now[n], _shaped(loop, n, v))}
        made = loop.with_params(**(ruled | other)) if ruled or other else loop
        conditions = self.conditions(loop)
        return made.with_conditions(**conditions) if conditions != made.conditions else made

    def conditions(self, loop: Block) -> dict[str, dict[str, float]]:
        """Rail conditions of a loop, with those of the file."""
        found = {k: dict(v) for k, v in loop.conditions.items()}
        for name, values in (self.trip.rail.conditions if self.trip.rail else {}).items():
            found[name] = found.get(name, {}) | self._numbers(loop, values, "param")
        return found

    def scenario(self) -> Scenario:
        """Scenario of the study with what the file gives; its numbers are in the loops."""
        trip, old = self.trip, self.case.scenario
        one = next(iter(self.case.loops[n] for n in self.asked.values()))
        inputs = dict(old.inputs)
        for keys, value in flat(trip.inputs):
            for full in targets(one, ".".join(str(k) for k in keys), ("input",)):
                inputs = {n: v for n, v in inputs.items() if full != one.find(n, "input")}
                inputs[full] = in_unit(value, one.inputs[full])
        given = {"duration": trip.duration, "seed": trip.seed, "noise": trip.noise}
        return old.but(
            rail=self.rail(one), params={}, start={}, inputs=inputs,
            **{n: v for n, v in given.items() if v is not None},
        )  # fmt: skip

    def rail(self, loop: Block) -> Rail | None:
        """Rail of the file, or of the study where the file has none."""
        part, old = self.trip.rail, self.case.scenario.rail
        if part is None or not part.sections:
            return old
        placed = part.sections[0].place is not None
        by = old.by if old is not None and placed == (old.by != "time") else "position"
        sections = []
        for s in part.sections:
            values = {}
            for keys, value in flat(s.values):
                name = ".".join(str(k) for k in keys)
                full = targets(loop, name, ("input", "param"))[0]
                values[name] = in_unit(value, _signal(loop, full))
            start = s.place if placed else s.time
            assert start is not None  # the part says so
            sections.append(Section(start, s.condition, values))
        return Rail(sections, by if placed else "time")

    def own_case(self, quick: bool) -> Case:
        """Case of the file; quantities of the study's rail stay while that rail does."""
        scenario, old = self.scenario(), self.case.scenario
        if quick:
            scenario = scenario.but(duration=min(scenario.duration, 0.5))
        one = next(iter(self.case.loops[n] for n in self.asked.values()))
        same = _told(scenario.rail) == _told(old.rail) and self.conditions(one) == one.conditions
        loops = Loops({n: partial(self.loop, n) for n in self.asked})
        return replace(
            self.case, scenario=scenario, loops=loops, known=self.case.known if same else {}
        )


def _has(loop: Block, name: str) -> bool:
    """Whether a loop has a signal of this full name."""
    own = (loop.params, loop.states, loop.inputs, loop.sharing.aliases)
    return any(name in names for names in own)


def _signal(loop: Block, name: str) -> Signal:
    return loop.inputs[name] if name in loop.inputs else loop.declared(name)


def _shaped(loop: Block, name: str, value: Any) -> np.ndarray:
    return loop.declared(name).shaped(name, value)


def _told(rail: Rail | None) -> Any:
    """What a rail says, without the lengths that are only checked."""
    return rail and (rail.by, [(s.start, s.condition, dict(s.values)) for s in rail.sections])


def _figure(results: Any) -> Any:
    from slipctl.draw import plots

    logs = list(results.data.get(results.cases[0].scenario.name, {}).values())
    find = results.study.signals.find
    roles = [r for r in ("speed", "slip", "torque") if any(find(r, log) for log in logs)]
    return plots.traces(results, results.cases[0].scenario.name, signals=roles)


def study(trip: StudyTrip, name: str = "trip", source: str = "a loop of a study") -> Study:
    """Make the study of a file that takes loops from another one.

    Args:
        trip: what the file says.
        name: of its folder and files.
        source: where it is from, for the report.

    Raises:
        BadInput: no such study, scenario or loop.
    """
    reading = Reading(trip)
    base = reading.base

    def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
        own = reading if models is base.models else Reading(trip, models)
        return [own.own_case(quick)]

    by_loop = {loop: n for n, loop in reading.asked.items()}
    where, asked = reading.case.scenario.name, base.certificates
    return replace(
        base, name=name, title=trip.title, source=f"{source}; {base.source}", cases=cases,
        experiments={}, claims=(), short="", headline="", plain=(where,),
        figures={"traces": Figure("Speed, slip and torque, where the loops log them", _figure)},
        gains=[replace(g, loop=by_loop[g.loop]) for g in asked.gains if g.loop in by_loop],
        ensembles={k: e for k, e in base.ensembles.items() if k == where},
        limits={k: v for k, v in vars(trip.limits).items() if v is not None},
        uncertified={n: asked.uncertified[loop] for n, loop in reading.asked.items()
                     if loop in asked.uncertified},
    )  # fmt: skip
