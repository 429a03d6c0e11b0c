"""Proofs and counterexamples for any loop that is declared by its tick: sets of cells, and runs.

Who declares a system brings its equations, one tick of it, and nothing that has to be believed:

    proof      cells that hold the start set, and whose images, whatever pushes, lie in these cells
    refutation a start and what pushes in each tick, after which a state is beyond its bound

Both are computed from the tick as it is read into operations (``tick_source``), with enclosures
that are rounded outwards. It is plain Python with + - * /, comparisons and the functions of this
module. Cells take two states or three at most: their number grows with the power of that. A loop
that is smooth about 0 may have any number of states: what each tick adds is summed up (``sums``).
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.promise import Criterion, Entries, Evidence, Numbers, Refuter, Target
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.smooth.tube import check_tube, find_tube
from slipctl.certify.ticks.tick_code import TickCode
from slipctl.certify.ticks.tick_source import clip, code_of_tick, exp, if_else, root, sgn
from slipctl.errors import BadInput

__all__ = ["Loop", "clip", "exp", "if_else", "root", "sgn"]

DIGITS = 25
"""Digits of the enclosures."""

GRIDS = {1: (64, 512), 2: (24, 64), 3: (8, 16)}
"""Cells along each state that are tried, by the number of states."""

MOST_CELLS = 5000
"""Most cells of a set."""

FAR = 1e30
"""Gain of a start at which no more ticks are added up."""

MOST_TICKS = 5000
"""Most ticks of a run."""

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Loop:
    """A loop tick by tick.

    Attributes:
        tick: next states, of the numbers, the states and what pushes, all by name.
        start: by state the number that bounds it at the start, |x| <= it.
        pushed: by what pushes the number that bounds it in each tick.
        stays: by state the number that it never has to exceed, |x| <= it.
        within: number of ticks for which that is asked; without it, it is asked for ever.
    """

    tick: Callable[[Numbers, Values, Values], Values]
    start: Mapping[str, str]
    pushed: Mapping[str, str]
    stays: Mapping[str, str]
    within: str = ""
    _codes: dict[tuple[str, ...], TickCode] = field(default_factory=dict, repr=False, compare=False)

    def targets(self) -> dict[str, Target]:
        """Clauses of its promise, one for each state that has to stay."""
        when = f" in the first {{{self.within}}} ticks" if self.within else ""
        return {
            f"{x}_stays": Target(f"|{x}| never exceeds {{{bound}}}{when}", (bound,))
            for x, bound in self.stays.items()
        }

    def says_start(self) -> str:
        """Its start set in words."""
        return "every " + " and ".join(f"|{x}| <= {{{n}}}" for x, n in self.start.items())

    def code(self, numbers: Numbers) -> TickCode:
        """Its tick as operations, for numbers of these names.

        Raises:
            BadInput: the tick is not written for a proof.
        """
        names = tuple(numbers)
        if names not in self._codes:
            groups = (names, tuple(self.start), tuple(self.pushed))
            self._codes[names] = code_of_tick(self.tick, groups, tuple(self.start))
        return self._codes[names]

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """What proves its clauses."""
        evidence = Evidence(lambda n: _find(self, n), lambda n, e: _check(self, n, e))
        summed = Evidence(lambda n: _find_sums(self, n), lambda n, e: _check_sums(self, n, e))
        tube = Evidence(lambda n: _find_tube(self, n), lambda n, e: _check_tube(self, n, e))
        first = {"tube": Criterion(
            "what each tick adds within the time, summed up", proves=tuple(self.targets()),
            covers=self._covered(numbers), evidence=tube,
        )} if self.within else {}  # fmt: skip
        return {**first, "sums": Criterion(
            "what each tick adds, summed up", proves=tuple(self.targets()),
            covers=self._covered(numbers), evidence=summed,
        ), "cells": Criterion(
            "cells that no tick leaves", proves=tuple(self.targets()),
            covers=self._covered(numbers), evidence=evidence,
        )}  # fmt: skip

    def sampled(self, n: Numbers) -> tuple[SampledLoop, Cell, Bounds]:
        """The loop about 0, its numbers as parameters of one value, and what it withstands."""
        code = self.code(n)
        renamed = tuple(f"p_{i[2:]}" if i.startswith("n_") else i for i in code.inputs)
        loop = SampledLoop(TickCode(renamed, code.steps, code.outputs), tuple(self.start),
                           tuple(self.pushed), tuple(n))  # fmt: skip
        still = (Fraction(0),) * len(self.start)
        values = [Fraction(v) for v in n.values()]
        cell = Cell(tuple((v, v) for v in values), still, (still,) * len(values))
        pushed, start = ([Fraction(n[k]) for k in names.values()]
                         for names in (self.pushed, self.start))  # fmt: skip
        return loop, cell, Bounds(tuple(pushed), tuple(start))

    def _covered(self, numbers: Numbers) -> tuple[str, ...]:
        """Numbers that its next states depend on: what the tick never looks at is not withstood."""
        used = self.code(numbers).depends()
        return (
            *(n for d, n in self.pushed.items() if f"d_{d}" in used), *self.start.values(),
            *(n for n in numbers if f"n_{n}" in used), *((self.within,) if self.within else ()),
        )  # fmt: skip

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

    def refuters(self) -> dict[str, Refuter]:
        """What refutes them."""
        return {
            f"run_{x}": Refuter(
                f"{x}_stays", lambda n, s=x: _find_run(self, n, s),  # type: ignore[misc]
                lambda n, e, s=x: _replay(self, n, e, s),  # type: ignore[misc]
            )
            for x in self.stays
        }  # fmt: skip


# ---- sets of cells ------------------------------------------------------------------------------


def _span(low: Fraction, high: Fraction) -> Interval:
    """Interval between two rationals, rounded outwards."""
    a, b = Interval.of(low, DIGITS), Interval.of(high, DIGITS)
    return Interval(a.low, b.high, DIGITS)


@dataclass(frozen=True)
class _Grid:
    """Cells between -reach and reach of each state, so many along each."""

    loop: Loop
    numbers: Numbers
    reach: tuple[Fraction, ...]
    count: int

    def start(self) -> Iterator[tuple[int, ...]]:
        """Cells that touch the start set."""
        spans = [(-self.numbers[n], self.numbers[n]) for n in self.loop.start.values()]
        yield from self._touched(spans)

    def images(self, cell: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        """Cells in which every tick from a cell ends.

        Raises:
            DoesNotHold: it may end outside of all.
        """
        given = dict(self._fixed)
        for x, i, reach in zip(self.loop.start, cell, self.reach, strict=True):
            size = 2 * reach / self.count
            given[f"x_{x}"] = _span(i * size - reach, (i + 1) * size - reach)
        after = self.loop.code(self.numbers).run(given)
        yield from self._touched([after[x].ends() for x in self.loop.start])

    @cached_property
    def _fixed(self) -> dict[str, Interval]:
        numbers = self.numbers
        pushed = {f"d_{d}": _span(-numbers[n], numbers[n]) for d, n in self.loop.pushed.items()}
        return {f"n_{k}": Interval.of(v, DIGITS) for k, v in numbers.items()} | pushed

    def _touched(self, spans: Sequence[tuple[Fraction, Fraction]]) -> Iterator[tuple[int, ...]]:
        ranges = []
        for (low, high), reach in zip(spans, self.reach, strict=True):
            if low < -reach or high > reach:
                raise DoesNotHold("evidence: a tick leaves the cells")
            scale = self.count / (2 * reach)
            first = min(math.floor((low + reach) * scale), self.count - 1)
            last = max(math.ceil((high + reach) * scale) - 1, first)
            ranges.append(range(first, last + 1))
        yield from product(*ranges)


def _find(loop: Loop, n: Numbers) -> Entries | None:
    """Grow the set from the start set, on grids that get finer."""
    if len(loop.start) not in GRIDS or any(bound not in n for bound in loop.stays.values()):
        return None
    reach = _reach(loop, n)
    for count in GRIDS[len(loop.start)]:
        grid = _Grid(loop, n, reach, count)
        try:
            found = set(grid.start())
            new = list(found)
            while new and len(found) <= MOST_CELLS:
                for cell in grid.images(new.pop()):
                    if cell not in found:
                        found.add(cell)
                        new.append(cell)
        except (DoesNotHold, ArithmeticError):
            continue
        if not new:
            return {"reach": [str(r) for r in reach], "count": count, "cells": _runs(found)}
    return None


def _reach(loop: Loop, n: Numbers) -> tuple[Fraction, ...]:
    """How far the cells go: to what a state must not exceed, else to twice what runs come to."""
    far = {x: float(n[name]) for x, name in loop.start.items()}
    for seed in range(10):
        for states in _run(loop, n, seed, 200):
            for x, value in states.items():
                far[x] = max(far[x], min(abs(value), 1e30))
    return tuple(
        Fraction(n[loop.stays[x]]) if x in loop.stays
        else Fraction(2 * value or 1.0).limit_denominator(10**9)
        for x, value in far.items()
    )  # fmt: skip


def _runs(found: set[tuple[int, ...]]) -> list[list[int]]:
    """Cells as [indices of all states but the last, first and last index of that one]."""
    out: list[list[int]] = []
    for *row, i in sorted(found):
        if out and out[-1][:-2] == row and out[-1][-1] == i - 1:
            out[-1][-1] = i
        else:
            out.append([*row, i, i])
    return out


def _check(loop: Loop, n: Numbers, given: Entries) -> None:
    entry = read_mapping(given, ("reach", "count", "cells"), "evidence", True)
    states = len(loop.start)
    reach = tuple(rational(r, "evidence.reach")
                  for r in rows(entry["reach"], "evidence.reach", states, states))  # fmt: skip
    count = whole(entry["count"], "evidence.count", 1, 1000)
    cells: set[tuple[int, ...]] = set()
    for run in rows(entry["cells"], "evidence.cells", MOST_CELLS):
        read = [whole(i, "evidence.cells", 0, count - 1)
                for i in rows(run, "evidence.cells", states + 1, states + 1)]  # fmt: skip
        cells.update((*read[:-2], i) for i in range(read[-2], read[-1] + 1))
        if len(cells) > MOST_CELLS:
            raise BadInput(f"evidence.cells: slipctl checks at most {MOST_CELLS}")
    if min(reach, default=Fraction(0)) <= 0:
        raise DoesNotHold("evidence: cells of no size")
    for x, r in zip(loop.start, reach, strict=True):
        if x in loop.stays and not r <= n[loop.stays[x]]:
            raise DoesNotHold(f"evidence: its cells go farther than {x} may")
    grid = _Grid(loop, n, reach, count)
    if _runs(cells) != entry["cells"]:
        raise DoesNotHold("evidence: its cells are not in order")
    if not set(grid.start()) <= cells:
        raise DoesNotHold("evidence: a start lies outside of its cells")
    for cell in cells:
        if not set(grid.images(cell)) <= cells:
            raise DoesNotHold("evidence: a tick leaves its cells")


# ---- sums ---------------------------------------------------------------------------------------


def _find_sums(loop: Loop, n: Numbers) -> Entries | None:
    """A proof by sums, for a loop that is smooth about 0."""
    if any(bound not in n for bound in loop.stays.values()):
        return None
    sampled, cell, bounds = loop.sampled(n)
    try:
        entry, _ = find_cell(sampled, cell, bounds)
        _check_sums(loop, n, entry)
    except (NoProof, DoesNotHold, ArithmeticError, np.linalg.LinAlgError):
        return None
    return entry


def _check_sums(loop: Loop, n: Numbers, given: Entries) -> None:
    sampled, cell, bounds = loop.sampled(n)
    found, box = check_cell(sampled, bounds, given)
    if found != cell:
        raise DoesNotHold("evidence: it speaks of other numbers, or of another rest")
    for state, z in zip(loop.start, box, strict=True):
        if state in loop.stays and z > n[loop.stays[state]]:
            raise DoesNotHold(f"evidence: {state} is not shown to stay")


def _find_tube(loop: Loop, n: Numbers) -> Entries | None:
    """A proof for a finite time, of a loop that is smooth about 0."""
    if any(bound not in n for bound in loop.stays.values()):
        return None
    sampled, cell, bounds = loop.sampled(n)
    try:
        entry, _ = find_tube(sampled, cell, bounds, loop.ticks(n, 10**9))
        _check_tube(loop, n, entry)
    except (NoProof, DoesNotHold, ArithmeticError, np.linalg.LinAlgError):
        return None
    return entry


def _check_tube(loop: Loop, n: Numbers, given: Entries) -> None:
    sampled, cell, bounds = loop.sampled(n)
    found, far, ticks = check_tube(sampled, bounds, given)
    if found != cell or ticks != loop.ticks(n, 10**9):
        raise DoesNotHold("evidence: it speaks of other numbers, or of another time")
    for state, z in zip(loop.start, far, strict=True):
        if state in loop.stays and z > n[loop.stays[state]]:
            raise DoesNotHold(f"evidence: {state} is not shown to stay")


# ---- runs ---------------------------------------------------------------------------------------


def _run(
    loop: Loop, n: Numbers, seed: int, ticks: int, state: str = "",
    kept: list[dict[str, int]] | None = None,
) -> Iterator[Values]:  # fmt: skip
    """Run in floats from a corner of the start set.

    With an even seed all that pushes is at the corner of its set that takes a state farthest from 0
    in the next tick. With an odd one it holds a random corner for some ticks.
    """
    rng, plain = random.Random(seed), {k: float(v) for k, v in n.items()}
    ticked = _on_floats(loop, n)
    corners = [dict(zip(loop.pushed, s, strict=True))
               for s in product((-1, 1), repeat=len(loop.pushed))]  # fmt: skip
    signs = {x: rng.choice((-1, 1)) for x in loop.start}
    states: Values = {x: signs[x] * plain[name] for x, name in loop.start.items()}
    stay = rng.choice((1, 2, 3, 8, ticks))
    kept = [] if kept is None else kept
    kept.append(signs)
    pushes = [({d: s[d] * plain[name] for d, name in loop.pushed.items()}, s) for s in corners]
    held = pushes[0]
    for i in range(ticks):
        try:
            if seed % 2 == 0:
                tried = [(ticked(states, push), s) for push, s in pushes]
                states, signs = max(tried, key=lambda t: abs(t[0][state or next(iter(t[0]))]))
            else:
                held = rng.choice(pushes) if i % stay == 0 else held
                states, signs = ticked(states, held[0]), held[1]
        except (ArithmeticError, ValueError):
            return
        kept.append(signs)
        yield states


def _on_floats(loop: Loop, n: Numbers) -> Callable[[Values, Values], dict[str, float]]:
    """Next states of states and what pushes, in floats."""
    run, numbers = loop.code(n).compiled(), [float(v) for v in n.values()]

    def ticked(states: Values, pushed: Values) -> dict[str, float]:
        found = run(*numbers, *states.values(), *pushed.values())
        return dict(zip(loop.start, found, strict=True))

    return ticked


def _summed_run(loop: Loop, n: Numbers, state: str, limit: float) -> Entries | None:
    """Run whose start and pushes add up in a state, as the loop linearised at 0 says."""
    ticked, names, pushes = _on_floats(loop, n), list(loop.start), list(loop.pushed)
    zero, still = dict.fromkeys(names, 0.0), dict.fromkeys(pushes, 0.0)
    small = 1e-7

    def column(x: Values, d: Values) -> list[float]:
        moved, at = ticked(x, d), ticked(zero, still)
        return [(moved[k] - at[k]) / small for k in names]

    try:
        A = np.array([column({**zero, k: small}, still) for k in names]).T
        B = np.array([column(zero, {**still, d: small}) for d in pushes]).reshape(-1, len(names)).T
    except (ArithmeticError, ValueError):
        return None
    row, by_push, by_start = np.eye(len(names))[names.index(state)], [], []
    for _ in range(MOST_TICKS):
        if not np.isfinite(row).all():
            break
        by_push.append(np.sign(row @ B).astype(int).tolist())
        row = row @ A
        by_start.append(np.sign(row).astype(int).tolist())
        if np.abs(row).max() > FAR:
            break
    most = loop.ticks(n, MOST_TICKS)
    for ticks in sorted({min(k, most) for k in (50, 200, 700, most, len(by_push))}):
        signs = [dict(zip(pushes, s, strict=True)) for s in reversed(by_push[:ticks])]
        for turn in (1, -1):
            begin = by_start[min(ticks, len(by_start)) - 1] if by_start else [0] * len(names)
            first = {k: turn * s for k, s in zip(names, begin, strict=True)}
            states: Values = {k: s * float(n[loop.start[k]]) for k, s in first.items()}
            for i, one in enumerate(signs):
                try:
                    push = {d: turn * s * float(n[loop.pushed[d]]) for d, s in one.items()}
                    states = ticked(states, push)
                except (ArithmeticError, ValueError):
                    break
                if not abs(states[state]) <= limit:
                    start = {k: str(s * n[loop.start[k]]) for k, s in first.items()}
                    pushed = [{d: str(turn * s * n[loop.pushed[d]]) for d, s in p.items()}
                              for p in signs[: i + 1]]  # fmt: skip
                    return {"start": start, "pushed": pushed}
    return None


def _find_run(loop: Loop, n: Numbers, state: str) -> Entries | None:
    limit = float(n[loop.stays[state]]) * (1 + 1e-9)
    summed = _summed_run(loop, n, state, limit)
    if summed is not None:
        return summed
    for seed in range(60):
        kept: list[dict[str, int]] = []
        for states in _run(loop, n, seed, loop.ticks(n, 400), state, kept):
            if not abs(states[state]) <= limit:
                start = {x: str(s * n[loop.start[x]]) for x, s in kept[0].items()}
                pushed = [{d: str(s * n[loop.pushed[d]]) for d, s in p.items()} for p in kept[1:]]
                return {"start": start, "pushed": pushed}
    start = {x: str(n[name]) for x, name in loop.start.items()}
    beyond = state in start and n[loop.start[state]] > n[loop.stays[state]]
    return {"start": start, "pushed": []} if beyond else None


def _replay(loop: Loop, n: Numbers, given: Entries, state: str) -> str:
    entry = read_mapping(given, ("start", "pushed"), "run", True)
    pushed = rows(entry["pushed"], "run.pushed", loop.ticks(n, MOST_TICKS))
    digits = 2 * DIGITS + len(pushed) // 4  # an interval widens from tick to tick
    states = _read(entry["start"], loop.start, n, "run.start", digits)
    code = loop.code(n)
    given = {f"n_{k}": Interval.of(v, digits) for k, v in n.items()}
    for i, one in enumerate(pushed):
        push = _read(one, loop.pushed, n, f"run.pushed[{i}]", digits)
        given |= {f"x_{x}": v for x, v in states.items()} | {f"d_{d}": v for d, v in push.items()}
        states = code.run(given)
    low, high = states[state].ends()
    limit = n[loop.stays[state]]
    if not (low > limit or high < -limit):
        raise DoesNotHold(f"run: {state} is not shown to exceed its bound")
    return f"after {len(pushed)} ticks |{state}| is {float(max(low, -high)):.6g} at least"


def _read(
    given: Any, bounds: Mapping[str, str], n: Numbers, where: str, digits: int
) -> dict[str, Interval]:
    """Values of a run, none beyond its bound."""
    entry = read_mapping(given, tuple(bounds), where, True)
    out = {}
    for name, bound in bounds.items():
        value = rational(entry[name], where)
        if abs(value) > n[bound]:
            raise DoesNotHold(f"{where}: {name} is larger than was asked")
        out[name] = Interval.of(value, digits)
    return out
