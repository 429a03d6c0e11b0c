"""Runs of a loop with modes: a search for the worst one in floats, and its replay in decimals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.cells.mode_cells import Ends, ModeLoop
from slipctl.certify.entries import DoesNotHold, rows, whole

RUNS = 600
"""Runs side by side."""

GENERATIONS = 5
"""How often the worst runs are altered."""

MOST_RUN = 20_000
"""Most ticks of a run in a file."""

DIGITS = 120
"""Digits of a run that is replayed."""

Bounds = Mapping[str, Ends]
"""Least and largest value that a state may have, by its name."""


@dataclass(frozen=True)
class Runs:
    """What runs came to.

    Attributes:
        low, high: ends of each real state. visited: real states and modes, by tick.
        worst: by watched state and side (-1, 1) the farthest value, and the run: its start as
            signs by real state, and its pushes as signs by tick and push.
        kept: ends of a further output that was asked for.
        bounds: what was wanted of states. ended: whether the search for the farthest run of one
            ended as soon as a run was beyond.
    """

    low: np.ndarray
    high: np.ndarray
    visited: list[tuple[np.ndarray, np.ndarray]]
    worst: Mapping[tuple[str, int], tuple[float, np.ndarray, np.ndarray]]
    kept: tuple[Fraction, Fraction] = (Fraction(0), Fraction(0))
    bounds: Bounds | None = None
    ended: bool = False


class _Search:
    """Runs from corners of the start, with pushes at the ends of their ranges."""

    def __init__(self, loop: ModeLoop, ticks: int, seed: int, kept: str = "") -> None:
        self.loop, self.ticks = loop, ticks
        self.kept, self.ends = kept, [0.0, 0.0]
        self.rng = np.random.default_rng(seed)
        self.run = loop.code.compiled(arrays=True)
        self.names = list(loop.push)
        self.low = np.array([float(a) for a, _ in loop.push.values()])
        self.high = np.array([float(b) for _, b in loop.push.values()])
        many = len(loop.reals)
        self.lowest, self.highest = np.full(many, np.inf), np.full(many, -np.inf)
        self.visited: list[tuple[np.ndarray, np.ndarray]] = []

    def pushes(self) -> np.ndarray:
        """Random corners that stay for some ticks, by run, tick and push."""
        shape = (RUNS, self.ticks, len(self.names))
        stay = self.rng.choice([1, 3, 10, 30, 100], (RUNS, 1, 1))
        turns = self.rng.random(shape) < 1 / stay
        turns[:, 0] = True
        fresh = self.rng.choice(np.array([-1, 1], np.int8), shape)
        at = np.maximum.accumulate(np.where(turns, np.arange(self.ticks)[None, :, None], 0), axis=1)
        return np.take_along_axis(fresh, at, axis=1)

    def altered(self, signs: np.ndarray, worst: np.ndarray) -> np.ndarray:
        """Pushes of the worst runs, with stretches turned over or moved in time."""
        found = signs[worst[self.rng.integers(0, len(worst), RUNS)]]
        for k in range(len(worst), RUNS if self.names else 0):
            push = self.rng.integers(0, len(self.names))
            begin = self.rng.integers(0, self.ticks)
            size = int(self.rng.choice([1, 4, 15, 60, 200]))
            if self.rng.random() < 0.5:
                found[k, begin : begin + size, push] *= -1
            else:
                found[k, begin:] = np.roll(found[k, begin:], self.rng.choice([-9, -2, 2, 9]), 0)
        found[: len(worst)] = signs[worst]
        return found

    def runs(self, starts: np.ndarray, signs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest value of each real state, by run."""
        loop = self.loop
        ends, rows = np.array([[float(a), float(b)] for a, b in loop.start]), len(starts)
        ends = ends.reshape(-1, 2)
        states = [np.where(starts[:, k] > 0, ends[k, 1], ends[k, 0]) for k in range(len(ends))]
        states += [np.full(rows, float(m)) for m in loop.begins]
        order = [*(f"x_{n}" for n in (*loop.reals, *loop.modes)), *(f"d_{n}" for n in self.names)]
        inputs = [order.index(n) for n in loop.code.inputs]
        outputs = list(loop.code.outputs)
        to = [outputs.index(n) for n in (*loop.reals, *loop.modes)]
        many = len(loop.reals)
        low = np.array(states[:many])
        high = low.copy()
        pushes = np.where(signs > 0, self.high, self.low).transpose(1, 2, 0)
        for t in range(self.ticks):
            given = [*states, *pushes[t]]
            with np.errstate(all="ignore"):
                after = self.run(*(given[i] for i in inputs))
            numbers = [np.asarray(after[i], float) for i in to]
            states = [x if x.ndim else np.full(rows, x) for x in numbers]
            if self.kept:
                value = np.asarray(after[outputs.index(self.kept)])
                self.ends = [min(self.ends[0], value.min()), max(self.ends[1], value.max())]
            reals = np.array(states[:many])
            good = np.isfinite(reals).all(axis=0)  # of the others the run is over
            if not good.any():
                break
            if not good.all():
                states = [np.where(good, s, np.nan) for s in states]
                reals = np.array(states[:many])
            low, high = np.fmin(low, reals), np.fmax(high, reals)
            if (t + 1) % loop.stride == 0:
                modes = np.array(states[many:]).reshape(-1, rows).T
                self.visited.append((reals.T[good], np.rint(modes[good]).astype(np.int64)))
        self.lowest = np.minimum(self.lowest, low.min(axis=1))
        self.highest = np.maximum(self.highest, high.max(axis=1))
        return low, high


def worst_runs(
    loop: ModeLoop, ticks: int, seed: int = 0, kept: str = "", bounds: Bounds | None = None
) -> Runs:
    """Search for runs in which the watched states come farthest, in floats.

    Args:
        loop: the loop. ticks: of each run. seed: of its pushes. kept: a further output whose ends
            are wanted. bounds: least and largest value by state, None for none; no run is looked
            for that is farther than one that is beyond them.
    """
    search = _Search(loop, ticks, seed, kept)
    worst: dict[tuple[str, int], tuple[float, np.ndarray, np.ndarray]] = {}
    ended = False
    for name in loop.watched:
        k = loop.reals.index(name)
        least, most = (bounds or {}).get(name, (None, None))
        for side, bound in ((1, most), (-1, least)):
            limit = np.inf if bound is None else side * float(bound)
            starts = search.rng.choice([-1, 1], (RUNS, len(loop.reals)))
            signs = search.pushes()
            for generation in range(GENERATIONS if side > 0 else 2):
                low, high = search.runs(starts, signs)
                far = high[k] if side > 0 else -low[k]
                order = np.argsort(-far)
                best = order[0]
                if (name, side) not in worst or far[best] > worst[name, side][0] * side:
                    worst[name, side] = (
                        float(side * far[best]),
                        starts[best].copy(),
                        signs[best].copy(),
                    )
                if is_beyond(far[best], limit):
                    ended = True
                    break
                if generation + 1 < GENERATIONS:
                    signs = search.altered(signs, order[:30])
                    starts[:30] = starts[order[:30]]
    ends = [Fraction(float(e)) for e in search.ends]
    return Runs(search.lowest, search.highest, search.visited, worst, (ends[0], ends[1]), bounds,
                ended)  # fmt: skip


def is_beyond(far: float, limit: float) -> bool:
    """Whether a value in floats is beyond its limit, by more than roundings."""
    return bool(far > limit + abs(limit) * 1e-9)


def farthest_of_runs(
    loop: ModeLoop, state: str, runs: Sequence[tuple[np.ndarray, np.ndarray]]
) -> float:
    """Largest value of a state, or of a further output, in runs that other loops found worst.

    Args:
        loop: the loop. state: the state. runs: starts by real state and pushes by tick, as signs;
            those of a loop with other states or pushes are left out.
    """
    shape = (len(loop.reals), len(loop.push))
    fit = [(a, b) for a, b in runs if (len(a), b.shape[1]) == shape]
    if not fit:
        return -np.inf
    ticks = max(len(b) for _, b in fit)
    starts = np.array([a for a, _ in fit])
    signs = np.array([np.concatenate([b, np.repeat(b[-1:], ticks - len(b), 0)]) for _, b in fit])
    search = _Search(loop, ticks, 0, "" if state in loop.reals else state)
    _, high = search.runs(starts, signs)
    return float(high[loop.reals.index(state)].max()) if state in loop.reals else search.ends[1]


def run_entries(starts: np.ndarray, signs: np.ndarray) -> dict[str, Any]:
    """A run as a file holds it: signs of the start, and rows of [ticks, signs of the pushes]."""
    found: list[list[int]] = []
    for row in signs.tolist():
        if found and found[-1][1:] == row:
            found[-1][0] += 1
        else:
            found.append([1, *row])
    return {"start": [int(s) for s in starts], "pushes": found}


def replay_run(
    loop: ModeLoop, given: Mapping[str, Any], state: str, low: Fraction | None,
    high: Fraction | None, most: int | None = None,
) -> tuple[int, Fraction]:  # fmt: skip
    """Run a file's run in decimals; gives after how many ticks a state is beyond, and its value.

    Args:
        loop: the loop. given: the run. state: what leaves. low, high: its bounds, None for none.
        most: ticks that it may have.

    Raises:
        DoesNotHold: it is never beyond, or the run is not decided. BadInput: it is malformed.
    """
    if state not in loop.reals:
        raise DoesNotHold(f"run: no run is a counterexample for {state}")
    many, pushes = len(loop.reals), []
    for row in rows(given["pushes"], "run.pushes", MOST_RUN):
        count, *signs = rows(row, "run.pushes", len(loop.push) + 1, len(loop.push) + 1)
        pushes.append((whole(count, "run.pushes", 1, MOST_RUN), signs))
    total = sum(count for count, _ in pushes)
    if total > min(MOST_RUN, most or MOST_RUN):
        raise DoesNotHold(f"run: it has more than {min(MOST_RUN, most or MOST_RUN)} ticks")
    run = rows(given["start"], "run.start", many, many), pushes
    for digits in (DIGITS, DIGITS + total // 16):  # an interval widens from tick to tick
        with suppress(DoesNotHold, ArithmeticError):
            return _replayed(loop, run, (state, low, high), digits)
    return _replayed(loop, run, (state, low, high), DIGITS + total // 4)


def _replayed(
    loop: ModeLoop, run: tuple[Sequence[Any], Sequence[tuple[int, Sequence[Any]]]],
    wanted: tuple[str, Fraction | None, Fraction | None], digits: int,
) -> tuple[int, Fraction]:  # fmt: skip
    """``replay_run`` with decimals of so many digits."""
    (starts, pushes), (state, low, high) = run, wanted

    def chosen(ends: Sequence[tuple[Fraction, Fraction]], signs: Sequence[Any]) -> list[Interval]:
        return [Interval.of(b if whole(sign, "run", -1, 1) > 0 else a, digits)
                for (a, b), sign in zip(ends, signs, strict=True)]  # fmt: skip

    least, most = (None if end is None else Interval.of(end, digits) for end in (low, high))
    values = dict(zip(loop.reals, chosen(loop.start, starts), strict=True))
    values |= {name: Interval.of(mode, digits)
               for name, mode in zip(loop.modes, loop.begins, strict=True)}  # fmt: skip
    ticks, steps = 0, ((count, chosen(list(loop.push.values()), signs)) for count, signs in pushes)
    for push in chain([None], (push for count, push in steps for _ in range(count))):
        if push is not None:
            ticks += 1
            pushed = {f"d_{name}": at for name, at in zip(loop.push, push, strict=True)}
            values = loop.code.run({**{f"x_{k}": v for k, v in values.items()}, **pushed})
        if any(not values[m].decided() for m in loop.modes):
            raise DoesNotHold("run: a condition is too near to tell")
        if most is not None and values[state].low > most.high:
            return ticks, Fraction(values[state].low)
        if least is not None and values[state].high < least.low:
            return ticks, Fraction(values[state].high)
    raise DoesNotHold(f"run: {state} is not shown to exceed its bound")
