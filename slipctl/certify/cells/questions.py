"""What is asked of a loop with modes, however it was made: its clauses, proofs by cells, runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import Any

from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.cells.mode_proofs import (
    WORK,
    check_evidence,
    find_cells,
    runs_of_loop,
)
from slipctl.certify.cells.mode_runs import Bounds, Runs, is_beyond, replay_run, run_entries
from slipctl.certify.entries import DoesNotHold, rational, read_mapping
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


@dataclass(frozen=True)
class Stay:
    """What is promised of a state.

    Attributes:
        high: number that it never exceeds; where it is not told, the promise names what is proved.
        words: the state in words. unit: its unit.
        both: whether that is asked of its size, |x|.
    """

    high: str
    words: str = ""
    unit: str = "1"
    both: bool = False

    def ends(self, most: Fraction | None) -> tuple[Fraction | None, Fraction | None]:
        """Least and largest value that it may have."""
        return -most if self.both and most is not None else None, most


@dataclass(frozen=True)
class Question:
    """Criteria and refuters of loops with modes, however they are made.

    Attributes:
        loop: makes the loop of the numbers. stays: what is promised, by state.
        covers: inputs that a proof includes, of the numbers. why: is filled where no proof is.
        work: operations that a search may take.
        within: ticks for which it is asked, of the numbers; None for ever.
        ticks: of a run of its search; None as long as the loop wants.
    """

    loop: Callable[[Numbers], ModeLoop]
    stays: Mapping[str, Stay]
    covers: Callable[[Numbers], tuple[str, ...]]
    why: list[str] = field(default_factory=list)
    work: int = WORK
    within: Callable[[Numbers], int | None] = lambda n: None
    ticks: int | None = None
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
        return {x: s.ends(n.get(s.high)) for x, s in self.stays.items()}

    def runs(self, loop: ModeLoop, within: int | None = None, bounds: Bounds | None = None) -> Runs:
        """Runs of a loop, simulated once, of no more ticks than it is asked for.

        With bounds the search ends as soon as a run is beyond them; without, it looks for the
        farthest one.
        """
        most = min((k for k in (within, self.ticks) if k is not None), default=None)
        key = (loop.code.steps, loop.start, tuple(loop.push.items()), loop.stride, most)
        found = self._seen.get(key)
        if found is None or (found.ended and found.bounds != bounds):
            self._seen.clear()
            self._seen[key] = found = runs_of_loop(loop, most, bounds)
        return found

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
            runs = self.runs(loop, self.within(n), self._bounds(n))
            found = find_cells(loop, self._bounds(n), runs, self.work)
        except (NoProof, ArithmeticError) as error:
            self.why.append(str(error))
            return None
        reach, close = {}, False
        for x, (_, most) in self._bounds(n).items():
            high = found.reach.high[x]
            high = max(high, -found.reach.low[x]) if self.stays[x].both else high
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
        check_evidence(loop, {x: self.stays[x].ends(m) for x, m in most.items()},
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
        worst = self.runs(loop, self.within(n), self._bounds(n)).worst
        for side in (1, -1) if self.stays[state].both else (1,):
            far, starts, signs = worst[state, side]
            if is_beyond(side * far, float(limit)):
                return run_entries(starts, signs)
        return None

    def replay(self, n: Numbers, given: Entries, state: str) -> str:
        """What a run does, in a line.

        Raises:
            DoesNotHold: it does not exceed the bound.
        """
        entry = read_mapping(given, ("start", "pushes"), "run", True)
        stay = self.stays[state]
        ends = stay.ends(Fraction(n[stay.high]))
        ticks, value = replay_run(self.loop(n), entry, state, *ends, self.within(n))
        far = abs(value) if stay.both else value
        return (
            f"{stay.words or state} comes to {number_text(far, stay.unit, 4)} after {ticks} ticks"
        )


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
