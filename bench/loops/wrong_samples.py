"""Faults of inputs in closed loop: the plant and the module in C, wrong samples between.

Each input in turn is wrong for some ticks: not a number, infinite, at an end of its range, stuck, a
spike, its sign flipped. What has to hold: a value that cannot be true shows in the status of its
own tick. 100 ms after the last one the status is 0 and every output is that of the run without
faults, to 2 % of its range, in 99 % of the ticks. No wheel locks that does not lock where these
ticks are held at the last good sample.

The run without faults is compared with itself, begun a tick later or with an input read 1e-9 wrong
in one tick. An output that does not keep to that chatters, or its course hangs on last digits. Of
such an output means over 50, 200 or 500 ms are compared. It is the shortest over which these runs
agree to half of the tolerance; if there is none, how far it swings is compared. So it is where a
seeker walks up and down for ever: a fault shifts its cycle, and a quarter of it later is another
such run. A law that counts its restarts, and has no end of them without a fault, has such a cycle
too: the longest time between two.

What is not back in time is held against a controller that read no wrong sample. Once it is in
charge from where the fault left the plant, once it reads the samples of this very run. A fault that
one of the two does not tell apart is forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from bench.loops.closed_loop import ClosedLoop, Course, Wrong
from slipctl.block.block import Block
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.run.rail import Scenario

LAST, LO, HI = "the last good sample", "the lower end", "the upper end"

KINDS: Mapping[str, tuple[float, float | str]] = {
    "NaN": (0.0, np.nan),
    "infinity": (0.0, np.inf),
    "-infinity": (0.0, -np.inf),
    "lower end": (0.0, LO),
    "upper end": (0.0, HI),
    "stuck": (0.0, LAST),
    "times 1.01": (1.01, 0.0),
    "times 1.1": (1.1, 0.0),
    "times 2": (2.0, 0.0),
    "times 100": (100.0, 0.0),
    "times 1e30": (1e30, 0.0),
    "10000": (0.0, 1e4),
    "65535": (0.0, 65535.0),
    "flipped": (-1.0, 0.0),
}
"""What is read in the place of a true value: so many times it or, with 0, a value."""

LENGTHS = (1, 10, 100)
"""Ticks that a fault lasts."""

BEFORE, AFTER, SETTLED = 0.5, 2.0, 0.1
"""Time in s before and after a fault that is looked at; after the last of these all is well."""

NEAR, SHARE = 0.02, 0.99
"""Difference allowed, of the range of an output, in this share of the ticks."""

WINDOWS = (0.0, 0.05, 0.2, 0.5)
"""Times in s over which an output is averaged, the shortest that serves; 0 is a tick."""

CYCLES = 5
"""Cycles that an output has counted when its loop is said to walk in one for ever."""

BARELY = 1 + 1e-9
"""What an input is multiplied with, for one tick, in a run that should stay the same."""

ENDLESS = 1e30
"""An end of a range beyond this is none."""


@dataclass(frozen=True)
class Fault:
    """What one fault led to.

    Attributes:
        signal, kind, ticks: which input read what, for how long.
        at: time of its first tick in s.
        told: faulted ticks whose status tells of an input.
        cannot_be: faulted ticks in which the value left its range or its largest change.
        missed: those of them that were not told.
        back: share of the ticks, from the time allowed after the last faulted one on, with the
            status and every output as without the fault.
        settled: time in s after the last faulted tick from which on that holds in 99 % of the
            ticks that are left; infinite if it does not in the last tenth of the window.
        own: the same time against a run from where the fault left the plant, with a controller that
            never saw it. A wheel that slid while its controller was blind needs its time.
        alike: the same time against a controller that never saw it and reads the very samples that
            this one reads. If they answer alike, the fault is forgotten; what differs is the loop.
        allowed: what these times may be, to the end of a tick: as ``settling`` says. Where that is
            too short, also the time in which the true value can have come from the last wrong one
            that may have been true.
        worst: output that is off in most of the ticks that are not back.
        locks: whether the wheel locks, and would not have with the last good sample held.
    """

    signal: str
    kind: str
    ticks: int
    at: float
    told: int
    cannot_be: int
    missed: int
    back: float
    settled: float
    own: float
    alike: float
    allowed: float
    worst: str
    locks: bool

    @property
    def passed(self) -> bool:
        """Whether all was as without it in time."""
        return not self.missed and self.settled <= self.allowed and not self.locks

    @property
    def forgotten(self) -> bool:
        """Whether the controller was in time what it would be without it; the plant may not be."""
        own = min(self.own, self.alike)
        return not self.missed and own <= self.allowed and not self.locks


def faults(
    loop: Block,
    part: str,
    scenario: Scenario,
    folder: Path,
    at: Sequence[float],
    wheel: str,
    *,
    kinds: Iterable[str] = tuple(KINDS),
    lengths: Iterable[int] = LENGTHS,
    signals: Iterable[str] | None = None,
    settling: Callable[[float], float] = lambda _: SETTLED,
    cycle: float = 0.0,
    rests: Mapping[str, float] | None = None,
    outside: Iterable[str] = (),
    real: str = "double",
) -> list[Fault]:
    """Put each fault on each input of a part, in closed loop.

    Args:
        loop, part, scenario: what runs.
        folder: where the C is written.
        at: times in s of the first faulted tick, in order; one too near to the end of the run for
            the time allowed is left out.
        wheel: state of the plant that is the wheel's speed; at 0 it is locked.
        kinds, lengths: which faults.
        signals: inputs, by default each of the part.
        settling: from the time that a fault lasted to the time after it in which all has to be as
            without it, both in s; an estimator may state a longer one.
        cycle: time in s of a cycle that a seeker walks for ever, 0 for none.
        rests: states that may rest so far beside their place without a fault.
        outside: inputs that an estimator in the rest of the loop finds; see ``_Instant._own``.
        real: double or float.
    """
    from slipctl.ccode.check.vectors.run_inputs import record_part
    from slipctl.ccode.codegen import c_module

    block = loop[part]
    _, params = record_part(loop, part, scenario, 1)
    module = c_module(block, folder, "ctl", period=loop.period, real=real).compile().load()
    module.reset(**params)
    whole = ClosedLoop(loop, part, scenario, module)
    names = [m.name for m in whole.plan.layout.inputs for _ in range(m.size)]
    wanted = [n for n in names if signals is None or n in set(signals)]
    found = []
    for when in at:
        good = whole.run(round(when / whole.period) - whole.tick)
        one = _Instant(whole, params, wheel, when, good.read[-1], list(lengths), settling,
                       cycle, rests or {}, [n in set(outside) for n in names])  # fmt: skip
        for k, name in enumerate(names):
            if name in wanted and one.judged:
                found += one.faults(k, name, list(kinds))
        whole.go_back(one.kept)
    return found


class _Instant:
    """Faults that begin at one tick of a run."""

    def __init__(
        self, whole: ClosedLoop, params: Mapping[str, Any], wheel: str, at: float,
        last_good: np.ndarray, lengths: list[int], settling: Callable[[float], float],
        cycle: float, rests: Mapping[str, float], outside: list[bool],
    ) -> None:  # fmt: skip
        self.outside = np.array(outside)
        self.whole, self.at, self.last, self.lengths = whole, at, last_good, lengths
        self.kept = whole.keep()
        h = whole.period
        self.allowed = {n: math.ceil(settling(n * h) / h - 1e-9) * h for n in lengths}
        left = whole.ticks - whole.tick - max(lengths)
        self.after = min(round((AFTER + max(self.allowed.values())) / whole.period), left)
        self.plain = whole.run(max(lengths) + self.after)
        block, lay = whole.plan.block, whole.plan.layout
        self.ends = whole.plan.ends(lay.inputs, block.param_values(**params))
        self.swing = _ranges(whole.plan, params, self.plain.outputs)
        self.names = [m.name for m in lay.outputs for _ in range(m.size)]
        self.wheel = whole.places(wheel)
        cycle = max(round(cycle / whole.period),
                    _counting(self.plain.outputs, round(max(WINDOWS) / whole.period)))  # fmt: skip
        twins = self._twins(cycle, rests)
        self.windows = self._windows(twins, self.swing, cycle)
        self.strict = np.minimum(self.swing, _swung(self.plain.outputs))
        self.strictly = self._windows(twins, self.strict, cycle)

    @property
    def judged(self) -> bool:
        """Whether the run goes on for long enough after the time allowed."""
        return self.after >= 1.1 * max(self._late(ticks) for ticks in self.allowed)

    def faults(self, k: int, name: str, kinds: list[str]) -> list[Fault]:
        """Each of some faults on input k."""
        lo, hi, change, noise = (float(e[k]) for e in self.ends)
        values = {LAST: float(self.last[k]), LO: lo, HI: hi}
        found = []
        for ticks in self.lengths:
            held = self._run(Wrong(k, ticks, 0.0, values[LAST]), ticks)
            for kind in kinds:
                times, value = KINDS[kind]
                number = values[value] if isinstance(value, str) else value
                if kind.endswith("end") and abs(number) > ENDLESS:
                    continue
                got = self._run(Wrong(k, ticks, times, number), ticks)
                told = got.status[:ticks] & (guard.BAD_INPUT | guard.OFF_RANGE) != 0
                false = _cannot_be(got.read[:ticks, k], values[LAST], lo, hi, change, noise)
                locks = self._locks(got) and not self._locks(held) and not self._locks(self.plain)
                course = got.read[:ticks, k], got.truth[ticks:, k], ~false
                way = _way(*course, values[LAST], change, noise)
                for late in dict.fromkeys((self._late(ticks), self._late(ticks) + way)):
                    if 1.1 * late > self.after:
                        break  # the run ends before that could be told
                    one = Fault(
                        name, kind, ticks, self.at, int(told.sum()), int(false.sum()),
                        int((false & ~told).sum()), **self._judged(got, ticks, late), locks=locks,
                    )  # fmt: skip
                    if one.forgotten:
                        break
                found.append(one)
        return found

    def _run(self, wrong: Wrong, ticks: int) -> Course:
        self.whole.go_back(self.kept)
        return self.whole.run(ticks + self.after, wrong)

    def _locks(self, course: Course) -> bool:
        return bool((course.rest[:, self.wheel] <= 0).any())

    def _twins(self, cycle: int, rests: Mapping[str, float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Pairs of runs that are to count as the same."""
        plain = self.plain.outputs
        twins = [(plain[1:], plain[:-1])]
        for k in range(len(self.last)):
            one = self._run(Wrong(k, 1, BARELY, 0.0), max(self.lengths)).outputs
            twins.append((one[: len(plain)], plain[: len(one)]))
        held = [m.name for m in self.whole.plan.layout.states for _ in range(m.size)]
        for name, by in rests.items():
            for shift in (by, -by):
                self.whole.go_back(self.kept)
                self.whole.module._state[held.index(name)] += shift
                one = self.whole.run(max(self.lengths) + self.after).outputs
                twins.append((one[: len(plain)], plain[: len(one)]))
        if cycle:  # a fault shifts it
            twins.append((plain[cycle // 4 :], plain[: -(cycle // 4)]))
        return twins

    def _windows(
        self, twins: list[tuple[np.ndarray, np.ndarray]], swing: np.ndarray, cycle: int
    ) -> np.ndarray:
        """Ticks over which each output is averaged; 0 where only its swing can be compared."""
        windows = np.zeros(swing.size, dtype=int)
        lengths = {max(1, round(t / self.whole.period)) for t in WINDOWS} | {max(1, cycle)}
        for w in sorted(lengths, reverse=True):
            agree = [(np.abs(_means(a, w) - _means(b, w)) <= NEAR / 2 * swing).mean(axis=0)
                     for a, b in twins]  # fmt: skip
            windows[np.min(agree, axis=0) >= SHARE] = w
        return windows

    def _late(self, ticks: int) -> int:
        """Ticks after a fault in which all has to be as without it."""
        return round(self.allowed[ticks] / self.whole.period)

    def _judged(self, got: Course, ticks: int, late: int) -> dict[str, Any]:
        """How a fault ends that may take so many ticks."""
        allowed = late * self.whole.period
        without = _from(self.plain, ticks, ticks + self.after)
        share, settled, worst = self._back(got, ticks, late, without)
        own = self._own(got, ticks, late) if settled > allowed else settled
        alike = self._alike(got, ticks, late) if own > allowed else own
        return {"back": share, "settled": settled, "own": own, "alike": alike, "allowed": allowed,
                "worst": worst}  # fmt: skip

    def _back(self, got: Course, ticks: int, late: int, than: Course) -> tuple[float, float, str]:
        """How a fault ends: share of ticks that are as in another run, from when on, what is not.

        Both runs begin with the first tick after the fault.
        """
        off = _off(got.outputs[ticks:], than.outputs, self.swing, self.windows)
        well = (got.status[ticks:] == than.status) & ~off.any(axis=1)
        worst = off[late:].sum(axis=0)
        name = self.names[int(np.argmax(worst))] if worst.any() else ""
        return float(well[late:].mean()), _settled(well) * self.whole.period, name

    def _own(self, got: Course, ticks: int, late: int) -> float:
        """Time in s after a fault from which on the module is one that read true samples.

        The other run begins where the plant is when the time allowed is over. Its controller has
        watched the plant on the way there, and read no wrong sample; it is in charge from then on.
        What an estimator outside of the controller finds is read as in the run with the fault.
        Where it decides another way in the two, it is not the controller that differs.
        """
        at = ticks + late
        self.whole.go_back(self.kept)
        self.whole.watch(got.truth[:at])
        tick, _, module = self.whole.keep()
        self.whole.go_back((tick + at, got.rest[at - 1], module))
        than = self.whole.run(
            self.after - late, told=np.where(self.outside, got.truth[at:], np.nan)
        )
        off = _off(got.outputs[at:], than.outputs, self.swing, self.windows)
        well = (got.status[at:] == than.status) & ~off.any(axis=1)
        return (late + _settled(well)) * self.whole.period

    def _alike(self, got: Course, ticks: int, late: int) -> float:
        """Time in s after a fault from which on the module answers as one that read true samples.

        The other one reads, from the first faulted tick on, what was true in this very run. Both
        read the same after the fault, so no plant and no fit in the rest of the loop is between
        them. In closed loop there is: where that fit takes another sample for a new rail, runs
        that differ by 1e-9 end as far apart as any two. What an output swings over is its range
        here where the declared one is wider: in that, an integral that is wound up would not show.
        """
        at = ticks + late
        self.whole.go_back(self.kept)
        outputs, status = self.whole.watch(got.truth)
        off = _off(got.outputs[at:], outputs[at:], self.strict, self.strictly)
        well = (got.status[at:] == status[at:]) & ~off.any(axis=1)
        return (at - ticks + _settled(well)) * self.whole.period


def _from(course: Course, first: int, last: int) -> Course:
    """Ticks of a run."""
    return Course(*(getattr(course, f.name)[first:last] for f in fields(course)))


def _off(
    outputs: np.ndarray, plain: np.ndarray, swing: np.ndarray, windows: np.ndarray
) -> np.ndarray:
    """Where outputs are not as in another run; means are those of the ticks from here on."""
    off = np.zeros(outputs.shape, dtype=bool)
    for w in np.unique(windows[windows > 0]):
        which = np.flatnonzero(windows == w)
        far = np.abs(_means(outputs[:, which], w) - _means(plain[:, which], w))
        off[: len(far), which] = far > NEAR * swing[which]
    for k in np.flatnonzero(windows == 0):
        off[:, k] = _beyond(outputs[:, k], plain[:, k], 2 * NEAR * swing[k])
    return off


def _beyond(values: np.ndarray, plain: np.ndarray, room: float) -> np.ndarray:
    """Which values are beyond all that the run without faults has."""
    return (values > plain.max() + room) | (values < plain.min() - room)


def _counting(outputs: np.ndarray, most: int) -> int:
    """Ticks of a cycle that an output counts, the longest; 0 where none comes within ``most``."""
    longest = 0
    for column in outputs.T:
        steps = np.diff(column)
        at = np.flatnonzero(steps)
        if len(at) >= CYCLES and (steps >= 0).all() and (column % 1 == 0).all():
            longest = max(longest, int(np.diff(at).max()))
    return longest if longest <= most else 0


def _means(values: np.ndarray, window: int) -> np.ndarray:
    """Means over so many ticks from each tick on, as far as there are so many."""
    if window == 1:
        return values
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return (sums[window:] - sums[:-window]) / window


def _settled(well: np.ndarray) -> float:
    """Ticks after which all is well in 99 % of those that are left, of which there are a tenth."""
    share = np.cumsum(well[::-1])[::-1] / np.arange(len(well), 0, -1)
    first = np.flatnonzero(share >= SHARE)
    return float(first[0]) if first.size and first[0] <= 0.9 * len(well) else np.inf


def _cannot_be(
    read: np.ndarray, last: float, lo: float, hi: float, change: float, noise: float
) -> np.ndarray:
    """Which values cannot be true, as the one before the first was.

    They leave the range, or are further from that one than they can have come meanwhile. Nor can
    both of two be true that follow each other and are further apart than a tick allows.
    """
    ticks = np.arange(1, len(read) + 1)
    with np.errstate(over="ignore", invalid="ignore"):
        possible = (lo <= read) & (read <= hi) & (np.abs(read - last) <= noise + change * ticks)
        jumps = np.abs(np.diff(read, prepend=last)) > noise + change
    return ~possible | (jumps & np.r_[True, possible[:-1]])


def _way(
    read: np.ndarray, truth: np.ndarray, possible: np.ndarray, last: float, change: float,
    noise: float,
) -> int:  # fmt: skip
    """Ticks after a fault until the true value can have come from the last that may have been true.

    A value that stays away for longer, and could be true, is believed. The true one then looks like
    a jump: it is taken when it can have come so far, as the fault concept says.
    """
    at = np.flatnonzero(possible)
    where, held = (at[-1], read[at[-1]]) if at.size else (-1, last)
    since = len(read) - where + np.arange(len(truth))
    with np.errstate(over="ignore", invalid="ignore"):
        near = np.abs(truth - held) <= noise + change * since
    return int(np.argmax(near)) if near.any() else 0


def _ranges(plan: Plan, params: Mapping[str, Any], outputs: np.ndarray) -> np.ndarray:
    """Range of each output: as declared, else what the run without faults swings over."""
    lo, hi, *_ = plan.ends(plan.layout.outputs, plan.block.param_values(**params))
    own = _swung(outputs)
    with np.errstate(over="ignore"):
        width = hi - lo
    return np.where((np.abs(lo) < ENDLESS) & (np.abs(hi) < ENDLESS), width, own)


def _swung(outputs: np.ndarray) -> np.ndarray:
    """What each output swings over; of one that rests, how large it is."""
    own = np.ptp(outputs, axis=0)
    return np.where(own > 0, own, np.maximum(np.abs(outputs).max(axis=0), 1e-9))
