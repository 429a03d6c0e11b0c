"""What the C is expected to give: the block in Python, with the guards of the C around it.

The block itself takes any input and limits no output. So it sees what the guards make of the
inputs, a tick that they refuse is left out of its run, and its outputs are put into their ranges
afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.check.float_error import Trials
from slipctl.ccode.module import guard
from slipctl.ccode.module.header import bit
from slipctl.ccode.module.layout import Member, spans
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import epsilon, round_to_real

LIMIT = 1e-12
"""Largest allowed difference in double, relative to the largest value of the signal."""

AMPLIFIED = 16
"""Times the spread of the trials: eight runs do not show the rarest decision."""

ROUNDINGS = 2
"""Roundings that the limit of a signal in float has besides, of its largest value: of the input
and of the result."""

UNTRIED = 64
"""The same where there were no trials of the compiled text, only of rounded states and inputs."""

MOVED = 3
"""Such trials: runs of the block in double with states and inputs moved at random by eps."""

ENVELOPE = 0.1
"""Where the limit is a larger part than this of what the signal swings over, it depends on
decisions or chatters: least and greatest value are compared instead, to this part, or to twice
what those of the trials differ by where that is more."""

UNKNOWN = float(np.finfo(float).max)
"""Limit of a signal whose ends differ among the trials by half of what it swings over, as the
damping of an iteration that has converged does: arithmetic alone decides it."""

LARGEST_FILE, DIGITS = 32_000_000, 19
"""Bytes that ``vectors.txt`` should not exceed, and of a number in it. The state of a vehicle's
controller has a thousand numbers and more, so the file has it after some of its ticks only."""

UNDECIDED = -1
"""Status of a tick in which arithmetic decides: trials have another one than the block."""


@dataclass(frozen=True)
class Expected:
    """Rows per tick: inputs, outputs, states after it, status; and a limit per signal.

    Attributes:
        limits: largest allowed absolute difference, by name of output and state.
        envelope: names of the signals of which only the least and greatest value is compared.
    """

    rows: np.ndarray
    outputs: np.ndarray
    states: np.ndarray
    status: np.ndarray
    limits: Mapping[str, float]
    envelope: frozenset[str]

    @property
    def refused(self) -> int:
        """Ticks with an input that was not taken."""
        return self._with(bit("OFF_RANGE") | bit("BAD_INPUT"))

    @property
    def undecided(self) -> int:
        """Ticks whose status depends on arithmetic."""
        return int(np.count_nonzero(self.status == UNDECIDED))

    def faults(self, status: np.ndarray, mask: int) -> int:
        """Ticks in which another status was given, of those that are decided."""
        differ = (status & mask) != (self.status & mask)
        return int(np.count_nonzero(differ & (self.status != UNDECIDED)))

    @property
    def limited(self) -> int:
        """Ticks with an output that was limited."""
        return self._with(bit("LIMITED"))

    def _with(self, bits: int) -> int:
        return int(np.count_nonzero((self.status != UNDECIDED) & (self.status & bits != 0)))


def accepted_rows(
    plan: Plan, rows: np.ndarray, values: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """What the step takes of rows of inputs, and the bits of the status that tell of it.

    Args:
        plan: the module.
        rows: input elements, one row per tick.
        values: of all parameters by name.
    """
    most = float(np.finfo(np.float32 if plan.real == "float" else np.float64).max)
    inputs = plan.layout.inputs
    ends = plan.ends_of_inputs(values) if plan.coupled else plan.ends(inputs, values)
    return guard.accepted_inputs(rows, ends, plan.stale, most, plan.period, plan.judged)


def missed_ticks(good: np.ndarray) -> np.ndarray:
    """Ticks that were refused before each one that was not, since the last such one."""
    at = np.flatnonzero(good)
    return np.diff(np.r_[-1, at]) - 1


def catch_up(plan: Plan, x: np.ndarray, missed: float) -> None:
    """Move on the counters among the elements of states, a row or column of them each."""
    if not missed:
        return
    counts = {m.name: ticks for m, ticks in plan.counters}
    for m, here in spans(plan.layout.states):
        if m.name in counts:
            now = ca.DM(x[here].reshape(1, -1))
            found = guard.counter_after().map(now.numel())(now, missed, counts[m.name])
            x[here] = np.array(found.full()).reshape(x[here].shape)


def run_with_guards(
    plan: Plan,
    rows: np.ndarray,
    told: np.ndarray,
    outputs: np.ndarray,
    states: np.ndarray,
    params: Mapping[str, Any],
) -> Expected:
    """Put the guards around the run of a block.

    Args:
        plan: the module.
        rows: input elements, one row per tick.
        told: what the guards of the inputs tell in each tick.
        outputs, states: what the block gave in the ticks that are not refused.
        params: parameters of the run, by name.
    """
    good = told & bit("REFUSED") == 0
    lo, hi, *_ = plan.ends(plan.layout.outputs, plan.block.param_values(**params))
    limited = outputs.clip(lo, hi)
    status = told.copy()
    status[good] |= np.where((limited != outputs).any(axis=1), bit("LIMITED"), 0)
    before = np.array([plan.before(m) for m in plan.layout.outputs for _ in range(m.size)])
    before = before.clip(lo, hi)
    last = np.cumsum(good)  # number of good ticks so far: 0 is before the first
    held = np.vstack([before, limited])[last]
    safe = round_to_real([np.nan if m.signal.safe is None else m.signal.safe
                    for m in plan.layout.outputs for _ in range(m.size)], plan.real)  # fmt: skip
    return Expected(
        rows, np.where(good[:, np.newaxis] | np.isnan(safe), held, safe),
        np.vstack([start_state(plan.block, params), states])[last], status, {}, frozenset(),
    )  # fmt: skip


def with_limits(
    plan: Plan, run: Expected, params: Mapping[str, Any], trials: Trials | None = None
) -> Expected:
    """Say how much each signal of the C may differ, with trials by what they differ."""
    members = [*plan.layout.outputs, *plan.layout.states]
    wanted = np.hstack([run.outputs, run.states])
    if plan.real == "double" and trials is None:
        limits = {
            m.name: LIMIT * (_largest(w) or 1.0) for m, w in _parts(members, wanted)
        }  # fmt: skip
        return Expected(run.rows, run.outputs, run.states, run.status, limits, frozenset())
    eps, status = epsilon("float"), run.status
    if trials is None:
        spread, ends, eps = _spread(plan, run, params), 0 * wanted[:1], UNTRIED * eps
    else:
        spread, ends = (found[np.newaxis] for found in trials.differ(wanted))
        eps = LIMIT if plan.real == "double" else ROUNDINGS * eps
        other = ((trials.status ^ status) & ~bit("LIMITED")).any(axis=0)
        status = np.where(other, UNDECIDED, status)
    limits, envelope = {}, set()
    parts = (_parts(members, rows) for rows in (wanted, spread, ends))
    for (m, w), (_, s), (_, e) in zip(*parts, strict=True):
        limits[m.name] = AMPLIFIED * _largest(s) + eps * (_largest(w) or 1.0)
        # made-up inputs may break a block in their first tick: then there is no row
        swing = float(np.ptp(w, axis=0).max(initial=0.0)) if len(w) else 0.0
        varies = swing > eps * _largest(w)
        if varies and not limits[m.name] <= ENVELOPE * swing:
            envelope.add(m.name)
            limits[m.name] = max(ENVELOPE * swing, 2 * _largest(e), eps * _largest(w))
            if 2 * _largest(e) > swing or trials is None:  # untried: what chatters decides nothing
                limits[m.name] = UNKNOWN
    return Expected(run.rows, run.outputs, run.states, status, limits, frozenset(envelope))


def differences(plan: Plan, run: Expected, got: np.ndarray) -> dict[str, dict[str, Any]]:
    """Largest difference of each signal from what is expected, and whether it is allowed.

    Args:
        plan: the module.
        run: what is expected.
        got: outputs and states of the C, one row per tick.
    """
    members = [*plan.layout.outputs, *plan.layout.states]
    wanted = np.hstack([run.outputs, run.states])
    found: dict[str, dict[str, Any]] = {}
    for (m, w), (_, g) in zip(_parts(members, wanted), _parts(members, got), strict=True):
        absolute = float(np.nan_to_num(np.abs(w - g), nan=np.inf).max(initial=0.0))
        counted = absolute
        if m.name in run.envelope:
            ends = np.abs(w.max(axis=0) - g.max(axis=0)), np.abs(w.min(axis=0) - g.min(axis=0))
            counted = float(np.nan_to_num(np.maximum(*ends), nan=np.inf).max(initial=0.0))
        largest = _largest(w)
        found[m.name] = {
            "absolute": absolute, "relative": absolute / largest if largest > 0 else absolute,
            "compared": "nothing" if run.limits[m.name] == UNKNOWN
            else "envelope" if m.name in run.envelope else "every tick",
            "counted": counted, "limit": run.limits[m.name],
        }  # fmt: skip
    return found


def largest_relative(signals: Mapping[str, Mapping[str, Any]]) -> tuple[float, str]:
    """Largest relative difference of the signals compared in every tick, and of which."""
    every = {n: d["relative"] for n, d in signals.items() if d["compared"] == "every tick"}
    name = max(every, key=lambda n: every[n], default="")
    return every.get(name, 0.0), name


def start_state(block: Block, params: Mapping[str, Any]) -> np.ndarray:
    """Elements of the start state with some parameters."""
    computed = any(s.derived for s in block.states.values())
    begins = block.with_params(**params) if params and computed else block
    return np.array(ca.DM(block.pack("state", begins.start())).full()).ravel()


def float_params(plan: Plan, values: Mapping[str, Any]) -> dict[str, Any]:
    """Free parameters as C has them, within their ranges."""
    return {
        m.name: round_to_real(values[m.name], plan.real).clip(m.signal.lo, m.signal.hi)
        for m in plan.layout.params
    }


def _spread(plan: Plan, run: Expected, params: Mapping[str, Any]) -> np.ndarray:
    """Largest difference per element that roundings to float of states and inputs make.

    What holds only whole numbers (counters, choices, random numbers) is exact in float: it is left.
    """
    block, rng, eps = plan.block, np.random.default_rng(20), epsilon("float")
    p = ca.DM(block.pack("param", block.param_values(**params)))
    start = start_state(block, params)
    values = block.param_values(**params)
    seen, told = accepted_rows(plan, run.rows, values)
    good = told & bit("REFUSED") == 0
    rows, gaps = seen[good], missed_ticks(good)
    lo, hi, *_ = plan.ends(plan.layout.outputs, values)
    wanted = np.hstack([run.outputs, run.states])[good]
    moved_x = (np.vstack([start, run.states]) % 1 != 0).any(axis=0)
    moved_u = (rows % 1 != 0).any(axis=0)
    x = np.repeat(start[:, np.newaxis], MOVED, axis=1)
    worst = np.zeros(wanted.shape[1])
    many = block.f.map(MOVED)
    p = ca.repmat(p, 1, MOVED)
    for k, row in enumerate(rows):
        u = np.repeat(row[:, np.newaxis], MOVED, axis=1)
        x = x * (1 + eps * moved_x[:, np.newaxis] * rng.uniform(-1, 1, x.shape))
        u = u * (1 + eps * moved_u[:, np.newaxis] * rng.uniform(-1, 1, u.shape))
        following, y = many(x, u, p)
        x = np.array(following.full()).reshape(x.shape)
        catch_up(plan, x, gaps[k])
        y = np.array(y.full()).clip(lo[:, np.newaxis], hi[:, np.newaxis])
        differ = np.abs(np.vstack([y, x]) - wanted[k][:, np.newaxis]).max(axis=1)
        worst = np.maximum(worst, np.nan_to_num(differ, nan=np.inf))
    return worst[np.newaxis, :]


def _parts(members: list[Member], rows: np.ndarray) -> list[tuple[Member, np.ndarray]]:
    """Columns of each signal."""
    return [(m, rows[:, here]) for m, here in spans(members)]


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0))


def last_states(ticks: int, every: int) -> np.ndarray:
    """By tick: the latest one whose states are written, each so many and the very last."""
    found = np.arange(ticks)
    found -= found % every
    found[-1:] = ticks - 1
    return found


def few_states(
    plan: Plan, run: Expected, trials: Trials | None
) -> tuple[Expected, Trials | None, int]:
    """A run whose states are looked at in some ticks only, where the file were too large.

    Returns:
        The run and its trials with the states held in between, and the ticks from one look to the
        next. In float without trials the run is shorter instead: its limits need every state.
    """
    width, states = run.rows.shape[1] + run.outputs.shape[1] + 1, run.states.shape[1]
    ticks, room = len(run.rows), LARGEST_FILE // DIGITS
    if ticks * (width + states) <= room:
        return run, trials, 1
    if trials is None and plan.real == "float":
        return *first_ticks(run, None, max(room // (width + states), 1)), 1
    every = math.ceil(ticks * states / max(room - ticks * width, room // 4))
    at, n = last_states(ticks, every), run.outputs.shape[1]
    held = Expected(run.rows, run.outputs, run.states[at], run.status, run.limits, run.envelope)
    if trials is not None:
        rows = [np.hstack([r[:, :n], r[at, n:]]) for r in trials.rows]
        trials = Trials(rows, trials.status)
    return held, trials, every


def first_ticks(run: Expected, trials: Trials | None, ticks: int) -> tuple[Expected, Trials | None]:
    """The first ticks of a run, as far as its trials; limits are those of a whole run no more."""
    ticks = min(ticks, trials.ticks if trials else ticks)
    first = Expected(
        run.rows[:ticks], run.outputs[:ticks], run.states[:ticks], run.status[:ticks], {},
        frozenset(),
    )  # fmt: skip
    return first, trials and trials.first(ticks)
