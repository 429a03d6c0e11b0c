"""A loop with modes that is declared by its tick: a state machine behind a valve.

    loop = SwitchedLoop(
        tick, start={"s": "none", "p": "none"}, modes={"valve": 0},
        pushed={"c": ("least", "most"), "w": "W"}, stays={"s": Stay(high="band", words="the slip")},
    )

``tick`` is plain Python as for ``tick_sets.Loop``. Real states have cells, each combination of
modes has a grid of its own (``mode_cells``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import Any

from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.cells.mode_proofs import (
    WORK,
    Bounds,
    check_evidence,
    find_cells,
    runs_of_loop,
)
from slipctl.certify.cells.mode_runs import Runs, replay_run, run_entries
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows
from slipctl.certify.promise import (
    Criterion,
    Entries,
    Evidence,
    Numbers,
    Refuter,
    Target,
    number_text,
    rounded_up,
)
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks.tick_code import TickCode, with_constants
from slipctl.certify.ticks.tick_source import code_of_tick
from slipctl.errors import BadInput

Bound = str | tuple[str, str]
"""Number that bounds a value, |x| <= it; or those of its least and its largest value."""

Range = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Stay:
    """What is promised of a state.

    Attributes:
        high: number that it never exceeds; where it is not told, the promise names what is proved.
        words: the state in words. unit: its unit.
    """

    high: str
    words: str = ""
    unit: str = "1"


@dataclass(frozen=True)
class Question:
    """Criteria and refuters of loops with modes, however they are made.

    Attributes:
        loop: makes the loop of the numbers. stays: what is promised, by state.
        covers: inputs that a proof includes, of the numbers. why: is filled where no proof is.
        work: operations that a search may take.
    """

    loop: Callable[[Numbers], ModeLoop]
    stays: Mapping[str, Stay]
    covers: Callable[[Numbers], tuple[str, ...]]
    why: list[str] = field(default_factory=list)
    work: int = WORK
    _seen: dict[Any, Runs] = field(default_factory=dict, repr=False, compare=False)
    _found: dict[Any, tuple[Entries | None, list[str]]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def targets(self) -> dict[str, Target]:
        """Clauses of the promise: one where a bound is told, one with what is proved."""
        found = {}
        for x, stay in self.stays.items():
            claim = partial(_says, x, stay)
            found[f"{x}_stays"] = Target(claim, (stay.high,))
            found[f"{x}_bounded"] = Target(claim, unless=(f"{x}_stays",))
        return found

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """The proof by cells."""
        return {"cells": Criterion(
            "cells with modes that no tick leaves", proves=tuple(self.targets()),
            covers=self.covers(numbers), evidence=Evidence(self.find, self.check),
        )}  # fmt: skip

    def refuters(self) -> dict[str, Refuter]:
        """Runs that exceed a bound."""
        return {f"run_{x}": Refuter(
            f"{x}_stays", lambda n, x=x: self.find_run(n, x),  # type: ignore[misc]
            lambda n, e, x=x: self.replay(n, e, x),  # type: ignore[misc]
            lambda n, x=x: self.find_run(n, x),  # type: ignore[misc]
        ) for x in self.stays}  # fmt: skip

    def _bounds(self, n: Numbers) -> Bounds:
        return {x: (None, n.get(s.high)) for x, s in self.stays.items()}

    def runs(self, loop: ModeLoop) -> Runs:
        """Runs of a loop, simulated once."""
        key = (loop.code.steps, loop.start, tuple(loop.push.items()), loop.stride)
        if key not in self._seen:
            self._seen.clear()
            self._seen[key] = runs_of_loop(loop)
        return self._seen[key]

    def find(self, n: Numbers) -> Entries | None:
        """Entries of a proof; None where none is found."""
        key = tuple(sorted(n.items()))
        if key not in self._found:  # an answer and its file ask the same
            self.why.clear()
            found = self._searched(n)
            self._found.clear()
            self._found[key] = found, list(self.why)
        found, self.why[:] = self._found[key]
        return found

    def _searched(self, n: Numbers) -> Entries | None:
        try:
            loop = self.loop(n)
            found = find_cells(loop, self._bounds(n), self.runs(loop), self.work)
        except (NoProof, ArithmeticError) as error:
            self.why.append(str(error))
            return None
        reach, close = {}, False
        for x, (_, most) in self._bounds(n).items():
            high = found.reach.high[x]
            told = rounded_up(high + abs(high) / 10**9 + Fraction(1, 10**12), 12)
            if most is not None and told > most:  # within roundings of what is wanted
                told, close = most, True
            reach[x] = str(told)
        entries = {**found.entries, "reach": reach}
        if close:
            try:
                self.check(n, entries)
            except DoesNotHold as error:
                self.why.append(str(error))
                return None
        return entries

    def check(self, n: Numbers, given: Entries) -> None:
        """Confirm a proof.

        Raises:
            DoesNotHold: it proves nothing. BadInput: it is malformed.
        """
        entry = read_mapping(given, ("grid", "cells", "reach"), "evidence", True)
        told = read_mapping(entry["reach"], tuple(self.stays), "evidence.reach", True)
        loop = self.loop(n)
        most = {x: rational(told[x], "evidence.reach") for x in self.stays}
        for x, high in self._bounds(n).items():
            if high[1] is not None and most[x] > high[1]:
                raise DoesNotHold(f"evidence: {x} is not shown to stay")
        check_evidence(loop, {x: (None, m) for x, m in most.items()},
                       {"grid": entry["grid"], "cells": entry["cells"]})  # fmt: skip

    def find_run(self, n: Numbers, state: str) -> Entries | None:
        """A run that exceeds the bound of a state."""
        limit = n.get(self.stays[state].high)
        try:
            loop = self.loop(n)
        except NoProof:
            return None
        if limit is None:
            return None
        if state not in loop.reals:  # its pushes hold more than any axle does
            return None
        far, starts, signs = self.runs(loop).worst[state, 1]
        return run_entries(starts, signs) if far > float(limit) * (1 + 1e-9) else None

    def replay(self, n: Numbers, given: Entries, state: str) -> str:
        """What a run does, in a line.

        Raises:
            DoesNotHold: it does not exceed the bound.
        """
        entry = read_mapping(given, ("start", "pushes"), "run", True)
        stay = self.stays[state]
        ticks, value = replay_run(self.loop(n), entry, state, None, Fraction(n[stay.high]))
        return (f"{stay.words or state} comes to {number_text(value, stay.unit, 4)} after {ticks}"
                " ticks")  # fmt: skip


def _says(state: str, stay: Stay, n: Numbers, proof: Entries) -> str:
    """Clause of a promise."""
    words = stay.words or state
    evidence = proof.get("evidence", {})
    asked = number_text(n[stay.high], stay.unit, 6) if stay.high in n else ""
    if "reach" not in evidence:
        return f"{words} never exceeds {asked or 'a number that is proved'}"
    most = rounded_up(rational(evidence["reach"][state], "evidence.reach"), 4)
    said = f"{words} never exceeds {number_text(most, stay.unit, 4)}"
    return said + (f", asked were {asked}" if asked else "")


@dataclass(frozen=True)
class SwitchedLoop:
    """A loop with modes, tick by tick.

    Attributes:
        tick: next states, of the numbers, the states and what pushes, all by name.
        start: by real state what bounds it at the start, a number or two.
        pushed: by what pushes what bounds it in each tick.
        stays: what is promised, by real state.
        modes: states that are whole numbers, with their value at the start.
        why: is filled where there is no proof. work: operations that a search may take.
    """

    tick: Callable[..., Mapping[str, Any]]
    start: Mapping[str, Bound]
    pushed: Mapping[str, Bound]
    stays: Mapping[str, Stay]
    modes: Mapping[str, int]
    why: list[str] = field(default_factory=list, compare=False)
    work: int = WORK
    _codes: dict[tuple[str, ...], TickCode] = field(default_factory=dict, repr=False, compare=False)
    _made: list[Question] = field(default_factory=list, repr=False, compare=False)

    def code(self, numbers: Numbers) -> TickCode:
        """Its tick as operations, for numbers of these names.

        Raises:
            BadInput: the tick is not written for a proof.
        """
        names = tuple(numbers)
        if names not in self._codes:
            states = (*self.start, *self.modes)
            self._codes[names] = code_of_tick(
                self.tick, (names, states, tuple(self.pushed)), states
            )
        return self._codes[names]

    def loop(self, n: Numbers) -> ModeLoop:
        """The loop of these numbers.

        Raises:
            BadInput: a range that is empty.
        """
        values = {f"n_{k}": Fraction(v) for k, v in n.items()}
        return ModeLoop(
            with_constants(self.code(n), values), tuple(self.start), tuple(self.modes),
            tuple(_range(b, n) for b in self.start.values()), tuple(self.modes.values()),
            {d: _range(b, n) for d, b in self.pushed.items()}, tuple(self.stays),
        )  # fmt: skip

    def question(self) -> Question:
        """Its criteria and refuters."""
        if not self._made:
            self._made.append(Question(self.loop, self.stays, self._covered, self.why, self.work))
        return self._made[0]

    def _covered(self, n: Numbers) -> tuple[str, ...]:
        used = self.code(n).depends()
        found = [k for k in n if f"n_{k}" in used]
        for d, bound in self.pushed.items():
            if f"d_{d}" in used:
                found += [bound] if isinstance(bound, str) else list(bound)
        for bound in self.start.values():
            found += [bound] if isinstance(bound, str) else list(bound)
        return tuple(found)

    def targets(self) -> dict[str, Target]:
        """Clauses of its promise."""
        return self.question().targets()

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """What proves them."""
        return self.question().criteria(numbers)

    def refuters(self) -> dict[str, Refuter]:
        """What refutes them."""
        return self.question().refuters()

    def says_start(self) -> str:
        """Its start set in words."""
        parts = [f"|{x}| <= {{{b}}}" if isinstance(b, str) else f"{x} from {{{b[0]}}} to {{{b[1]}}}"
                 for x, b in self.start.items()]  # fmt: skip
        parts += [f"{m} = {v}" for m, v in self.modes.items()]
        return "every " + " and ".join(parts)


def _range(bound: Bound, n: Numbers) -> Range:
    """Range of a bound.

    Raises:
        BadInput: it is empty.
    """
    if isinstance(bound, str):
        return -Fraction(n[bound]), Fraction(n[bound])
    low, high = (Fraction(n[b]) for b in bound)
    if low > high:
        raise BadInput(f"{bound[0]} is larger than {bound[1]}")
    return low, high


def read_names(given: Any, where: str) -> tuple[str, ...]:
    """Names of a file.

    Raises:
        BadInput: they are none.
    """
    names = rows(given, where, 500)
    if not all(isinstance(n, str) and n.isidentifier() for n in names):
        raise BadInput(f"{where} must be names")
    return tuple(names)
