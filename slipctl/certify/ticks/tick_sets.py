"""A loop that is declared by its tick: what proves and refutes what is asked of it.

    loop = Loop(tick, start={"e": "e0"}, pushed={"w": "W"}, stays={"e": "band"})
    loop = Loop(
        tick, start={"s": "none", "p": "none"}, modes={"valve": 0},
        pushed={"c": ("least", "most"), "w": "W"}, stays={"s": Stay("band", "the slip")},
    )

Who declares a system brings its equations, one tick of it, and nothing that has to be believed. The
tick is plain Python with + - * /, comparisons and the functions of this module, and is read into
operations (``tick_source``). From these are computed, with enclosures that are rounded outwards:

    sums, tube   what each tick adds to a linear loop; of any number of states, smooth about 0
    cells        cells that no tick leaves; of three real states at most, and any modes
    run          a start and what pushes in each tick, after which a state is beyond its bound
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.cells.mode_proofs import WORK
from slipctl.certify.cells.mode_runs import run_entries
from slipctl.certify.cells.questions import Question, Stay
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import Criterion, Entries, Evidence, Numbers, Refuter, Target
from slipctl.certify.smooth.linear_runs import summed_run
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.smooth.tube import check_tube, find_tube
from slipctl.certify.ticks.tick_code import TickCode, with_constants
from slipctl.certify.ticks.tick_source import clip, code_of_tick, exp, if_else, root, sgn
from slipctl.errors import BadInput

__all__ = ["Loop", "Stay", "SwitchedLoop", "clip", "exp", "if_else", "root", "sgn"]

MOST_TICKS = 5000
"""Most ticks of a run that is summed up."""

FEW = WORK // 10
"""Operations of a search of cells without modes, so that an answer is there within seconds."""

SHORT = 200
"""Ticks of a run that is searched for without modes, after those that are summed up."""

Values = Mapping[str, Any]

Bound = str | tuple[str, str]
"""Number that bounds a value, |x| <= it; or those of its least and its largest value."""


@dataclass(frozen=True)
class Loop:
    """A loop tick by tick.

    Attributes:
        tick: next states, of the numbers, the states and what pushes, all by name.
        start: by real state what bounds it at the start, a number or two.
        pushed: by what pushes what bounds it in each tick.
        stays: by state the number that it never has to exceed, |x| <= it; or a ``Stay``.
        modes: states that are whole numbers, with their value at the start.
        within: number of ticks for which that is asked; without it, it is asked for ever.
        why: is filled where no cells prove it. work: operations that a search of cells may take.
    """

    tick: Callable[[Numbers, Values, Values], Values]
    start: Mapping[str, Bound]
    pushed: Mapping[str, Bound]
    stays: Mapping[str, str | Stay]
    modes: Mapping[str, int] = field(default_factory=dict)
    within: str = ""
    why: list[str] = field(default_factory=list, compare=False)
    work: int = WORK
    _codes: dict[tuple[str, ...], TickCode] = field(default_factory=dict, repr=False, compare=False)
    _made: list[Question] = field(default_factory=list, repr=False, compare=False)

    def targets(self) -> dict[str, Target]:
        """Clauses of its promise, one for each state that has to stay."""
        when = f" in the first {{{self.within}}} ticks" if self.within else ""
        plain = {f"{x}_stays": Target(f"|{x}| never exceeds {{{bound}}}{when}", (bound,))
                 for x, bound in self.stays.items() if isinstance(bound, str)}  # fmt: skip
        worded = {x for x in self.stays if f"{x}_stays" not in plain}
        return plain | {k: t for k, t in self.question().targets().items()
                        if k.rpartition("_")[0] in worded}  # fmt: skip

    def says_start(self) -> str:
        """Its start set in words."""
        parts = [f"|{x}| <= {{{b}}}" if isinstance(b, str) else f"{x} from {{{b[0]}}} to {{{b[1]}}}"
                 for x, b in self.start.items()]  # fmt: skip
        return "every " + " and ".join([*parts, *(f"{m} = {v}" for m, v in self.modes.items())])

    def code(self, numbers: Numbers) -> TickCode:
        """Its tick as operations, for numbers of these names.

        Raises:
            BadInput: the tick is not written for a proof.
        """
        names, states = tuple(numbers), (*self.start, *self.modes)
        if names not in self._codes:
            groups = (names, states, tuple(self.pushed))
            self._codes[names] = code_of_tick(self.tick, groups, states)
        return self._codes[names]

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """What proves its clauses."""
        proves, covers = tuple(self.targets()), self._covered(numbers)

        def criterion(title: str, find: Any, check: Any) -> Criterion:
            return Criterion(title, proves=proves, covers=covers, evidence=Evidence(find, check))

        found = {}
        if self.within:
            found["tube"] = criterion("what each tick adds within the time, summed up",
                                      self._find_tube, self._check_tube)  # fmt: skip
        if self._plain():
            found["sums"] = criterion("what each tick adds, summed up",
                                      self._find_sums, self._check_sums)  # fmt: skip
        title = (
            "cells with modes that no tick leaves" if self.modes else "cells that no tick leaves"
        )
        return {**found, "cells": criterion(title, self._find_cells, self.question().check)}

    def refuters(self) -> dict[str, Refuter]:
        """What refutes them."""
        made = self.question().refuters()
        if not self._plain():
            return made
        return {f"run_{x}": Refuter(
            f"{x}_stays", lambda n, x=x: self._find_run(n, x),  # type: ignore[misc]
            made[f"run_{x}"].replay,
        ) for x in self.stays}  # fmt: skip

    def ticks(self, n: Numbers, otherwise: int) -> int:
        """Ticks for which is asked.

        Raises:
            BadInput: they are no whole number.
        """
        if not self.within:
            return otherwise
        many = Fraction(n[self.within])
        if many.denominator != 1 or many < 1:
            raise BadInput(
                f"{self.within} = {float(many):g} ticks must be a whole number from 1 on"
            )
        return min(int(many), otherwise)

    def _plain(self) -> bool:
        """Whether nothing in its declaration keeps it from being summed up about 0."""
        bounds = (*self.start.values(), *self.pushed.values(), *self.stays.values())
        return not self.modes and all(isinstance(b, str) for b in bounds)

    def _covered(self, numbers: Numbers) -> tuple[str, ...]:
        """Numbers that its next states depend on: what the tick never looks at is not withstood."""
        used = self.code(numbers).depends()
        bounds = [b for d, b in self.pushed.items() if f"d_{d}" in used] + [*self.start.values()]
        return (
            *(n for b in bounds for n in ([b] if isinstance(b, str) else b)),
            *(n for n in numbers if f"n_{n}" in used), *((self.within,) if self.within else ()),
        )  # fmt: skip

    # ---- cells ----------------------------------------------------------------------------------

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
        """What is asked of its cells and runs."""
        if not self._made:
            stays = {x: s if isinstance(s, Stay) else Stay(s, f"|{x}|", both=True)
                     for x, s in self.stays.items()}  # fmt: skip
            few = {} if self.modes else {"work": min(self.work, FEW), "ticks": SHORT}
            own: dict[str, Any] = {"why": self.why, "work": self.work, **few}
            if self.within:
                own["within"] = lambda n: self.ticks(n, MOST_TICKS)
            self._made.append(Question(self.loop, stays, self._covered, **own))
        return self._made[0]

    def _find_cells(self, n: Numbers) -> Entries | None:
        asked = all(bound in n for bound in self.stays.values() if isinstance(bound, str))
        return self.question().find(n) if asked else None

    # ---- sums -----------------------------------------------------------------------------------

    def sampled(self, n: Numbers) -> tuple[SampledLoop, Cell, Bounds]:
        """The loop about 0, its numbers as parameters of one value, and what it withstands."""
        code = self.code(n)
        renamed = tuple(f"p_{i[2:]}" if i.startswith("n_") else i for i in code.inputs)
        loop = SampledLoop(TickCode(renamed, code.steps, code.outputs), tuple(self.start),
                           tuple(self.pushed), tuple(n))  # fmt: skip
        still = (Fraction(0),) * len(self.start)
        values = [Fraction(v) for v in n.values()]
        cell = Cell(tuple((v, v) for v in values), still, (still,) * len(values))
        pushed, start = ([_range(k, n)[1] for k in bounds.values()]
                         for bounds in (self.pushed, self.start))  # fmt: skip
        return loop, cell, Bounds(tuple(pushed), tuple(start))

    def _searched(
        self, n: Numbers, find: Callable[..., Any], check: Callable[[Numbers, Entries], None]
    ) -> Entries | None:
        if any(bound not in n for bound in self.stays.values()):
            return None
        try:
            entry: Entries = find(*self.sampled(n))[0]
            check(n, entry)
        except (NoProof, DoesNotHold, ArithmeticError, np.linalg.LinAlgError):
            return None
        return entry

    def _keeps(self, n: Numbers, found: Cell, most: list[Fraction]) -> None:
        """Confirm that a proof is one of these numbers, and that what it proves was asked.

        Raises:
            DoesNotHold: it is not.
        """
        if found != self.sampled(n)[1]:
            raise DoesNotHold("evidence: it speaks of other numbers, or of another rest")
        for state, z in zip(self.start, most, strict=True):
            if state in self.stays and z > n[str(self.stays[state])]:
                raise DoesNotHold(f"evidence: {state} is not shown to stay")

    def _find_sums(self, n: Numbers) -> Entries | None:
        return self._searched(n, find_cell, self._check_sums)

    def _check_sums(self, n: Numbers, given: Entries) -> None:
        sampled, _, bounds = self.sampled(n)
        self._keeps(n, *check_cell(sampled, bounds, given))

    def _find_tube(self, n: Numbers) -> Entries | None:
        ticks = self.ticks(n, 10**9)

        def find(loop: SampledLoop, cell: Cell, bounds: Bounds) -> Any:
            return find_tube(loop, cell, bounds, ticks)

        return self._searched(n, find, self._check_tube)

    def _check_tube(self, n: Numbers, given: Entries) -> None:
        sampled, _, bounds = self.sampled(n)
        found, most, ticks = check_tube(sampled, bounds, given)
        if ticks != self.ticks(n, 10**9):
            raise DoesNotHold("evidence: it speaks of another time")
        self._keeps(n, found, most)

    def _find_run(self, n: Numbers, state: str) -> Entries | None:
        """A run that leaves: one that adds up in the linear loop, or the worst of many."""
        bound = n.get(str(self.stays[state]))
        if bound is None:
            return None
        _, _, most = self.sampled(n)
        names, ticks = list(self.start), self.ticks(n, MOST_TICKS)
        run, numbers = self.code(n).compiled(), [float(v) for v in n.values()]
        with suppress(ArithmeticError, ValueError):
            found = summed_run(
                lambda x, d: run(*numbers, *x, *d), [0.0] * len(names),
                ([float(v) for v in most.start], [float(v) for v in most.push]),
                names.index(state), float(bound) * (1 + 1e-9),
                {min(k, ticks) for k in (50, 200, 700, ticks)},
            )  # fmt: skip
            if found is not None:
                return run_entries(*found)
        return self.question().find_run(n, state)


SwitchedLoop = Loop
"""A loop with modes."""


def _range(bound: Bound, n: Numbers) -> tuple[Fraction, Fraction]:
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
