"""Faults of inputs in closed loop: the plant in Python, the module in C, wrong samples between.

Each input in turn is wrong for some ticks: not a number, infinite, at an end of its range, stuck, a
spike, its sign flipped. What has to hold: a value that cannot be true shows in the status of its
own tick. 100 ms after the last one the status is 0 and every output is that of the run without
faults, to 2 % of its range, in 99 % of the ticks. No wheel locks that does not lock where these
ticks are held at the last good sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.check.in_loop import GIVEN, SEEN, _buffered, _places, place_holder
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.write import guard
from slipctl.ccode.write.plan import Plan
from slipctl.errors import BadInput
from slipctl.run import feeding
from slipctl.run.rail import Scenario

Wrong = Callable[[float, float, float, float], float]
"""(true value, last good one, lo, hi) -> what is read."""

KINDS: Mapping[str, Wrong] = {
    "NaN": lambda u, last, lo, hi: np.nan,
    "infinity": lambda u, last, lo, hi: np.inf,
    "-infinity": lambda u, last, lo, hi: -np.inf,
    "lower end": lambda u, last, lo, hi: lo,
    "upper end": lambda u, last, lo, hi: hi,
    "stuck": lambda u, last, lo, hi: last,
    "times 1.01": lambda u, last, lo, hi: 1.01 * u,
    "times 1.1": lambda u, last, lo, hi: 1.1 * u,
    "times 2": lambda u, last, lo, hi: 2 * u,
    "times 100": lambda u, last, lo, hi: 100 * u,
    "times 1e30": lambda u, last, lo, hi: 1e30 * u,
    "10000": lambda u, last, lo, hi: 1e4,
    "65535": lambda u, last, lo, hi: 65535.0,
    "flipped": lambda u, last, lo, hi: -u,
}
"""What is read in the place of a true value."""

LENGTHS = (1, 10, 100)
"""Ticks that a fault lasts."""

BEFORE, AFTER, SETTLED = 0.5, 2.0, 0.1
"""Time in s before and after a fault that is looked at; after the last of these all is well."""

NEAR, SHARE = 0.02, 0.99
"""Difference allowed, of the range of an output, in this share of the ticks."""

ENDLESS = 1e30
"""An end of a range beyond this is none."""


@dataclass(frozen=True)
class Fault:
    """What one fault led to.

    Attributes:
        signal, kind, ticks: which input read what, for how long.
        told: faulted ticks whose status tells of an input.
        cannot_be: faulted ticks in which the value left its range or its largest change.
        missed: those of them that were not told.
        back: share of the ticks, from 0.1 s after the last faulted one, with status 0 and every
            output as without the fault.
        worst: output that is off in most of the ticks that are not back.
        locks: whether the wheel locks, and would not have with the last good sample held.
    """

    signal: str
    kind: str
    ticks: int
    told: int
    cannot_be: int
    missed: int
    back: float
    worst: str
    locks: bool

    @property
    def passed(self) -> bool:
        """Whether it did no harm."""
        return not self.missed and self.back >= SHARE and not self.locks


class InLoop:
    """A loop whose part runs as compiled C, from a tick on that is kept to start from again.

    Args:
        loop, part, scenario: as of ``run_in_loop``.
        module: the part, compiled and loaded, with the parameters of the run.
        wheel: state of the plant that is the wheel's speed; at 0 it is locked.
    """

    def __init__(
        self, loop: Block, part: str, scenario: Scenario, module: CModule, wheel: str
    ) -> None:
        block = loop[part]
        rest = loop.swap(part, place_holder(block))
        rest = feeding.begun(rest, scenario)
        if rest.period is None:
            raise BadInput(f"{loop.name} has no period")
        self.module, self.period, self.plan = module, rest.period, Plan(block)
        ticks = round(scenario.duration / rest.period)
        rail_inputs, rail_params = feeding.rail_values(rest, scenario)
        self.u = feeding.feeds(rest, scenario, ticks, rest.period, rail_inputs)
        f, self.pieces = feeding.pieces(rest, scenario, ticks, rest.period, rail_params)
        self.calls = [_buffered(f, p) for _, _, p in self.pieces]
        self.x = np.array(ca.DM(rest.pack("state", rest.start())).full()).ravel()
        self.given = _places(rest, "input", [f"{part}.{GIVEN}{n}" for n in block.outputs])
        self.seen = _places(rest, "output", [f"{part}.{SEEN}{n}" for n in block.inputs])
        self.wheel = int(_places(rest, "state", [wheel])[0])
        self.tick = 0

    def run(
        self, ticks: int, spoil: Callable[[int, np.ndarray], np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Go on for some ticks: inputs as they are, outputs, status, and the wheel's speed."""
        rows = np.empty((ticks, self.seen.size))
        outputs, status = np.empty((ticks, self.given.size)), np.zeros(ticks, dtype=int)
        speed = np.empty(ticks)
        for j in range(ticks):
            k = self.tick
            at = next(i for i, (a, b, _) in enumerate(self.pieces) if a <= k < b)
            call, (x_in, u_in, x_out, y_out), _ = self.calls[at]
            x_in[:, 0], u_in[:, 0] = self.x, self.u[k]
            call()
            rows[j] = y_out[self.seen, 0]
            read = rows[j] if spoil is None else spoil(j, rows[j].copy())
            m = self.module
            m._in[: read.size] = read
            status[j] = m._call("step", m._in, m._param, m._state, m._out)
            outputs[j] = m._out[: self.given.size]
            u_in[self.given, 0] = outputs[j]
            call()
            self.x = x_out[:, 0].copy()
            speed[j] = self.x[self.wheel]
            self.tick += 1
        return rows, outputs, status, speed

    def keep(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Where the run is now."""
        return self.tick, self.x.copy(), self.module._state.copy()

    def go_back(self, kept: tuple[int, np.ndarray, np.ndarray]) -> None:
        """Be there again."""
        self.tick, self.x = kept[0], kept[1].copy()
        self.module._state[:] = kept[2]


def faults(
    loop: Block,
    part: str,
    scenario: Scenario,
    folder: Path,
    at: float,
    wheel: str,
    *,
    kinds: Iterable[str] = tuple(KINDS),
    lengths: Iterable[int] = LENGTHS,
    signals: Iterable[str] | None = None,
    real: str = "double",
) -> list[Fault]:
    """Put each fault on each input of a part, in closed loop.

    Args:
        loop, part, scenario: what runs.
        folder: where the C is written.
        at: time in s of the first faulted tick.
        wheel: state of the plant that is the wheel's speed.
        kinds, lengths: which faults.
        signals: inputs, by default each of the part.
        real: double or float.
    """
    from slipctl.ccode.check.logged import recorded
    from slipctl.ccode.codegen import c_module

    kinds, lengths = list(kinds), list(lengths)
    block = loop[part]
    _, params = recorded(loop, part, scenario, 1)
    module = c_module(block, folder, "ctl", period=loop.period, real=real).compile().load()
    module.reset(**params)
    whole = InLoop(loop, part, scenario, module, wheel)
    h = whole.period
    first, after = round(at / h), round(AFTER / h)
    plain_before = whole.run(first)
    kept, last_good = whole.keep(), plain_before[0][-1]
    longest = max(lengths)
    _, outputs, status, speed = whole.run(longest + after)
    lo, hi, change = whole.plan.ends(whole.plan.layout.inputs, block.param_values(**params))
    swing = _ranges(whole.plan, params, np.vstack([plain_before[1], outputs]))
    names = [m.name for m in whole.plan.layout.inputs for _ in range(m.size)]
    out_names = [m.name for m in whole.plan.layout.outputs for _ in range(m.size)]
    locked = bool((speed <= 0).any())
    wanted = set(names if signals is None else signals)

    def spoilt(k: int, ticks: int, wrong: Wrong) -> Callable[[int, np.ndarray], np.ndarray]:
        def spoil(j: int, row: np.ndarray) -> np.ndarray:
            if j < ticks:
                row[k] = wrong(row[k], last_good[k], lo[k], hi[k])
            read.append(row[k])
            return row

        return spoil

    found = []
    for k, name in enumerate(names):
        for ticks in lengths if name in wanted else ():
            read: list[float] = []
            whole.go_back(kept)
            hold_locks = bool(
                (whole.run(ticks + after, spoilt(k, ticks, KINDS["stuck"]))[3] <= 0).any()
            )
            for kind in kinds:
                if kind.endswith("end") and abs((lo, hi)[kind == "upper end"][k]) > ENDLESS:
                    continue
                read.clear()
                whole.go_back(kept)
                _, got, said, rim = whole.run(ticks + after, spoilt(k, ticks, KINDS[kind]))
                told = said[:ticks] & (guard.BAD_INPUT | guard.OFF_RANGE) != 0
                false = _cannot_be(np.array(read[:ticks]), last_good[k], lo[k], hi[k], change[k])
                late = ticks + round(SETTLED / h)
                off = np.abs(got - outputs[: ticks + after])[late:] > NEAR * swing
                back = (said[late:] == status[late : ticks + after]) & ~off.any(axis=1)
                worst = out_names[int(np.argmax(off.sum(axis=0)))] if off.any() else ""
                found.append(Fault(
                    name, kind, ticks, int(told.sum()), int(false.sum()),
                    int((false & ~told).sum()), float(back.mean()), worst,
                    bool((rim <= 0).any()) and not hold_locks and not locked,
                ))  # fmt: skip
    return found


def _cannot_be(read: np.ndarray, last: float, lo: float, hi: float, change: float) -> np.ndarray:
    """Which values leave the range, or are further from the last good one than they can be."""
    found = np.zeros(len(read), dtype=bool)
    since = 1
    for j, u in enumerate(read):
        good = lo <= u <= hi and abs(u - last) <= change * since
        found[j] = not good
        last, since = (u, 1) if good else (last, since + 1)
    return found


def _ranges(plan: Plan, params: Mapping[str, Any], outputs: np.ndarray) -> np.ndarray:
    """Range of each output: as declared, else what the run without faults swings over."""
    lo, hi, _ = plan.ends(plan.layout.outputs, plan.block.param_values(**params))
    own = np.ptp(outputs, axis=0)
    own = np.where(own > 0, own, np.maximum(np.abs(outputs).max(axis=0), 1e-9))
    with np.errstate(over="ignore"):
        width = hi - lo
    return np.where((np.abs(lo) < ENDLESS) & (np.abs(hi) < ENDLESS), width, own)
