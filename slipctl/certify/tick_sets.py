"""Proofs and counterexamples for any loop that is declared by its tick: sets of cells, and runs.

Who declares a system brings its equations, one tick of it, and nothing that has to be believed:

    proof      cells that hold the start set, and whose images, whatever pushes, lie in these cells
    refutation a start and what pushes in each tick, after which a state is beyond its bound

Both are computed from the tick with enclosures that are rounded outwards. The tick is written with
+ - * / and the functions ``sgn``, ``root`` and ``clip`` of this module, so that it takes floats and
intervals. Two states or three at most: the number of cells grows with their power.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any

from slipctl.certify.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.promise import Criterion, Entries, Evidence, Numbers, Refuter, Target
from slipctl.errors import BadInput

DIGITS = 25
"""Digits of the enclosures."""

GRIDS = {1: (64, 512), 2: (24, 64), 3: (8, 16)}
"""Cells along each state that are tried, by the number of states."""

MOST_CELLS = 5000
"""Most cells of a set."""

MOST_TICKS = 2000
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
    """

    tick: Callable[[Numbers, Values, Values], Values]
    start: Mapping[str, str]
    pushed: Mapping[str, str]
    stays: Mapping[str, str]

    def targets(self) -> dict[str, Target]:
        """Clauses of its promise, one for each state that has to stay."""
        return {
            f"{x}_stays": Target(f"|{x}| never exceeds {{{bound}}}", (bound,))
            for x, bound in self.stays.items()
        }

    def says_start(self) -> str:
        """Its start set in words."""
        return "every " + " and ".join(f"|{x}| <= {{{n}}}" for x, n in self.start.items())

    def criteria(self) -> dict[str, Criterion]:
        """What proves its clauses."""
        evidence = Evidence(lambda n: _find(self, n), lambda n, e: _check(self, n, e))
        return {"cells": Criterion(
            "cells that no tick leaves", proves=tuple(self.targets()),
            covers=(*self.pushed.values(), *self.start.values(), *self._taken()), evidence=evidence,
        )}  # fmt: skip

    def _taken(self) -> set[str]:
        """Numbers that the tick takes as they are: what it never looks at is not withstood."""
        seen = _Seen()
        with suppress(ArithmeticError, ValueError):  # what it took until then
            self.tick(seen, dict.fromkeys(self.start, 0.5), dict.fromkeys(self.pushed, 0.5))
        return seen.names

    def refuters(self) -> dict[str, Refuter]:
        """What refutes them."""
        return {
            f"run_{x}": Refuter(
                f"{x}_stays", lambda n, s=x: _find_run(self, n, s),  # type: ignore[misc]
                lambda n, e, s=x: _replay(self, n, e, s),  # type: ignore[misc]
            )
            for x in self.stays
        }  # fmt: skip


class _Seen(dict[str, float]):
    """Numbers, all of them 1, that remember which were asked for."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def __missing__(self, name: str) -> float:
        self.names.add(name)
        return 1.0

    def get(self, name: str, default: Any = None) -> float:
        """Value of a number."""
        return self[name]


# ---- functions that take floats and intervals ---------------------------------------------------


def sgn(x: Any) -> Any:
    """Sign; of an interval that holds 0 all of -1 to 1."""
    if isinstance(x, Interval):
        low, high = x.ends()
        return _span(Fraction((low > 0) - (low <= 0)), Fraction((high >= 0) - (high < 0)))
    return (x > 0) - (x < 0)


def root(x: Any) -> Any:
    """Square root; of what is negative 0."""
    if isinstance(x, Interval):
        low, high = x.ends()
        if high <= 0:
            return _span(Fraction(0), Fraction(0))
        top = _span(high, high).sqrt().ends()[1]
        return _span(_span(low, low).sqrt().ends()[0] if low > 0 else Fraction(0), top)
    return math.sqrt(max(x, 0.0))


def clip(x: Any, low: Any, high: Any) -> Any:
    """Value limited to a range of two rationals."""
    if isinstance(x, Interval):
        a, b = (min(max(end, Fraction(low)), Fraction(high)) for end in x.ends())
        return _span(a, b)
    return min(max(x, low), high)


def _span(low: Fraction, high: Fraction) -> Interval:
    """Interval between two rationals, rounded outwards."""
    a, b = Interval.of(low, DIGITS), Interval.of(high, DIGITS)
    return Interval(a.low, b.high, DIGITS)


# ---- sets of cells ------------------------------------------------------------------------------


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
        states = {}
        for x, i, reach in zip(self.loop.start, cell, self.reach, strict=True):
            size = 2 * reach / self.count
            states[x] = _span(i * size - reach, (i + 1) * size - reach)
        after = _ticked(self.loop, self._enclosed, states, self._pushed)
        yield from self._touched([_ends(after[x]) for x in self.loop.start])

    @property
    def _enclosed(self) -> dict[str, Interval]:
        return {k: Interval.of(v, DIGITS) for k, v in self.numbers.items()}

    @property
    def _pushed(self) -> dict[str, Interval]:
        numbers = self.numbers
        return {d: _span(-numbers[n], numbers[n]) for d, n in self.loop.pushed.items()}

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


def _ticked(loop: Loop, n: Numbers, states: Values, pushed: Values) -> Values:
    """Enclosure of a tick.

    Raises:
        BadInput: the tick is not written for enclosures.
    """
    try:
        return loop.tick(n, states, pushed)
    except TypeError as error:
        raise BadInput(
            f"the tick takes no enclosures ({error}); write it with + - * / and with sgn, root and"
            " clip of slipctl.certify.tick_sets"
        ) from None


def _ends(x: Any) -> tuple[Fraction, Fraction]:
    return x.ends() if isinstance(x, Interval) else (Fraction(x), Fraction(x))


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
                tried = [(loop.tick(plain, states, push), s) for push, s in pushes]
                states, signs = max(tried, key=lambda t: abs(t[0][state or next(iter(t[0]))]))
            else:
                held = rng.choice(pushes) if i % stay == 0 else held
                states, signs = loop.tick(plain, states, held[0]), held[1]
        except (ArithmeticError, ValueError):
            return
        kept.append(signs)
        yield states


def _find_run(loop: Loop, n: Numbers, state: str) -> Entries | None:
    limit = float(n[loop.stays[state]]) * (1 + 1e-9)
    for seed in range(60):
        kept: list[dict[str, int]] = []
        for states in _run(loop, n, seed, 400, state, kept):
            if not abs(states[state]) <= limit:
                start = {x: str(s * n[loop.start[x]]) for x, s in kept[0].items()}
                pushed = [{d: str(s * n[loop.pushed[d]]) for d, s in p.items()} for p in kept[1:]]
                return {"start": start, "pushed": pushed}
    start = {x: str(n[name]) for x, name in loop.start.items()}
    beyond = state in start and n[loop.start[state]] > n[loop.stays[state]]
    return {"start": start, "pushed": []} if beyond else None


def _replay(loop: Loop, n: Numbers, given: Entries, state: str) -> str:
    entry = read_mapping(given, ("start", "pushed"), "run", True)
    states: Values = _read(entry["start"], loop.start, n, "run.start")
    enclosed = {k: Interval.of(v, 2 * DIGITS) for k, v in n.items()}
    pushed = rows(entry["pushed"], "run.pushed", MOST_TICKS)
    for i, one in enumerate(pushed):
        states = _ticked(loop, enclosed, states, _read(one, loop.pushed, n, f"run.pushed[{i}]"))
    low, high = _ends(states[state])
    limit = n[loop.stays[state]]
    if not (low > limit or high < -limit):
        raise DoesNotHold(f"run: {state} is not shown to exceed its bound")
    return f"after {len(pushed)} ticks |{state}| is {float(max(low, -high)):.6g} at least"


def _read(given: Any, bounds: Mapping[str, str], n: Numbers, where: str) -> dict[str, Interval]:
    """Values of a run, none beyond its bound."""
    entry = read_mapping(given, tuple(bounds), where, True)
    out = {}
    for name, bound in bounds.items():
        value = rational(entry[name], where)
        if abs(value) > n[bound]:
            raise DoesNotHold(f"{where}: {name} is larger than was asked")
        out[name] = Interval.of(value, 2 * DIGITS)
    return out
