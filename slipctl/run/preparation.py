"""A prepared run: a loop in its scenario, built once, rolled with other numbers again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, as_block
from slipctl.block.signals import total_size
from slipctl.errors import BadInput, RunFailed, check_known, check_whole, value_text
from slipctl.run import build
from slipctl.run.logs.run_log import Log, Rows, log_columns
from slipctl.run.numbers import Template, check_guards, template
from slipctl.run.rail import Rail, Scenario
from slipctl.run.scenario_inputs import feeds, loop_at_start, pieces, rail_values
from slipctl.run.warnings.doubts import doubt_signals

CHUNKS = 40
"""Pieces a run is cut into, for progress and for stopping it."""

LARGEST = 2**36
"""Most bytes that a run may ask for, its inputs and the rows of its log."""

SCRATCH = 2**18
"""Numbers of a run that are held before those that the log keeps are taken: 2 MB, near the core."""


def prepare(
    loop: Block,
    scenario: Scenario,
    *,
    compile: bool = True,
    log: Iterable[str] | None = None,
    every: int = 1,
    runs: int = 1,
) -> Prepared:
    """Build all that a run needs once, to roll it with many sets of numbers.

    ``run = prepare(loop, scenario)`` gives a run that is called with numbers: ``run({"ctl.law.k1":
    12.0})`` gives, bit by bit, the signals of ``simulate(loop.with_params(...), scenario)``, in
    little more than the time of the compiled roll. Threads may call it side by side: the roll runs
    outside Python's lock.

    Args:
        loop: a step block with a period; every input must be fed by a wire, the scenario, noise
            or its own default value.
        scenario: what happens.
        compile: compile the loop when a C compiler is there; the numbers are the same.
        log: names to keep; by default every number, and every number per axle, that is no held
            copy.
        every: ticks from one row of the log to the next; 1 keeps each.
        runs: how many there will be; for many the compiler thinks longer, the numbers are the same.

    Returns:
        The run, to be called with numbers.

    Raises:
        BadInput: unfed inputs, unknown names, a rail condition that the loop does not know, every
            not a whole number.
    """
    return Prepared(loop, scenario, compile=compile, log=log, every=every, runs=runs)


def first_tick(loop: Block, scenario: Scenario, names: list[str]) -> Mapping[str, np.ndarray]:
    """Outputs of the first tick; none where it cannot be run, for the run itself says why."""
    if loop.period is None:
        return {}
    try:
        return prepare(loop, scenario.but(duration=loop.period), compile=False, log=names)()
    except (BadInput, RunFailed):
        return {}


class Prepared:
    """A loop in a scenario, ready to roll; see :func:`prepare`.

    Attributes:
        loop: as it was given.
        scenario: what happens.
        compile: whether to compile it.
    """

    def __init__(
        self, loop: Block, scenario: Scenario, *, compile: bool = True,
        log: Iterable[str] | None = None, every: int = 1, runs: int = 1,
    ) -> None:  # fmt: skip
        self.loop, self.scenario, self._every, self._runs = loop, scenario, every, runs
        check_whole("prepare: runs", runs)
        self.ticks = _ticks(loop, scenario, every)
        self.compile = compile
        self._begun = loop_at_start(loop, scenario)
        check_guards(self._begun)
        self._wanted = None if log is None else set(log)
        _check_logged(self._begun, self._wanted)
        self._columns = log_columns(self._begun, self._wanted)
        self._end = Ending(self._begun, scenario) if scenario.end is not None else None
        self._templates: dict[tuple[str, ...], Template | None] = {}
        self._roller: tuple[ca.Function, Callable[..., int]] | None = None
        self._feed: tuple[Any, np.ndarray] | None = None
        self._parts(self._begun, scenario)

    def __call__(
        self,
        numbers: Mapping[str, Any] | None = None,
        *,
        seed: int | None = None,
        rail: Rail | None = None,
        progress: Callable[[float], None] | None = None,
        doubt: bool = False,
    ) -> Log:
        """Roll with these numbers.

        Args:
            numbers: parameters and start values by name, as :meth:`Block.with_params` takes them:
                a shared number reaches all its places. None rolls the loop as it is.
            seed: of the noise; None is the scenario's.
            rail: another rail; None is the scenario's.
            progress: called with the share done, 0 to 1.
            doubt: watch the whole run, so that :meth:`Log.told` says what stays off or limited.

        Returns:
            Arrays by name, ``"time"`` in s and the signals, the tick's start value for states.

        Raises:
            BadInput: what ``with_params`` and ``simulate`` refuse, with the same words.
            RunFailed: a state became NaN or infinite; says block, signal and time.
        """
        often = progress is not None
        for piece in self.pieces(numbers, seed=seed, rail=rail, doubt=doubt, often=often):
            if progress:
                progress(piece[0])
        return piece[1]()

    def pieces(
        self,
        numbers: Mapping[str, Any] | None = None,
        *,
        seed: int | None = None,
        rail: Rail | None = None,
        doubt: bool = False,
        often: bool = True,
    ) -> Iterator[tuple[float, Callable[[], Log]]]:
        """Roll as a call does, piece by piece, for whoever shows a run before it has ended.

        Args:
            numbers, seed, rail, doubt: as of a call.
            often: in :data:`CHUNKS` pieces at least; else in as many as memory asks for.

        Yields:
            Share done, and what gives the log so far: after the last piece it is that of a call.

        Raises:
            BadInput, RunFailed: as a call.
        """
        scenario = self._scenario(seed, rail)
        block, values = self._numbered(numbers)
        x = build.pack_numbers(block, "state", block._start({}, values))
        u, roll, parts = self._parts(block, scenario, values)
        h, ticks = float(block.period or 0.0), self.ticks
        same = block._made is self._begun._made
        columns = self._columns if same else log_columns(block, self._wanted)
        beside = log_columns(block, doubt_signals(block)) if doubt else {}
        every = int(self._every)
        kept = Rows(block, scenario, u, np.arange(0, ticks, every), columns, beside, every)
        most = -(-ticks // CHUNKS) if often else ticks
        size = max(min(SCRATCH // max(x.size + total_size(block.outputs.values()), 1), most), 1)
        x_now = np.empty((size, x.size))
        y_now = np.empty((size, total_size(block.outputs.values())))
        stayed = self._end.begins if self._end is not None else 0
        for start, last, p in parts:
            for k in range(start, last, size):
                stop = min(k + size, last)
                n = roll(x, u[k:stop], p, x_now[: stop - k], y_now[: stop - k])
                ended = None
                if self._end is not None:
                    at, stayed = self._end.tick(x_now[:n], y_now[:n], stayed)
                    if at is not None:
                        ended = stop = k + at + 1
                        n = at + 1
                if n < stop - k:
                    raise RunFailed(_broken(block, x, (k + n + 1) * h))
                kept.add(k, stop, x_now, y_now)
                yield stop / (ended or ticks), kept.log
                if ended is not None:
                    return

    def whole(
        self, numbers: Mapping[str, Any], seed: int | None = None, rail: Rail | None = None
    ) -> Whole:
        """Roll with these numbers and keep every state and output of every tick.

        Raises:
            BadInput, RunFailed: as a call.
        """
        scenario = self._scenario(seed, rail)
        block, values = self._numbered(numbers)
        u, roll, parts = self._parts(block, scenario, values)
        h = float(block.period or 0.0)
        f, _ = pieces(block, scenario, self.ticks, h, rail_values(block, scenario)[1])
        x = build.column(block.pack("state", block.start()))
        x_log = np.empty((self.ticks, x.size))
        y_log = np.empty((self.ticks, total_size(block.outputs.values())))
        for first, last, p in parts:
            n = roll(x, u[first:last], p, x_log[first:last], y_log[first:last])
            if n < last - first:
                raise RunFailed(_broken(block, x, (first + n + 1) * h))
        return Whole(block, f, u, x_log, y_log, parts)

    def _scenario(self, seed: int | None, rail: Rail | None) -> Scenario:
        """The scenario with another seed and rail, where they are given."""
        given = {"seed": seed, "rail": rail}
        return self.scenario.but(**{k: v for k, v in given.items() if v is not None})

    def _numbered(
        self, numbers: Mapping[str, Any] | None
    ) -> tuple[Block, Mapping[str, np.ndarray]]:
        """Loop with these numbers, in the scenario, and the values of its parameters.

        Where only numbers differ, it is made from one.
        """
        if numbers is not None and not isinstance(numbers, Mapping):
            raise BadInput(f"a run takes numbers by name, {{'k': 2.0}}, not {value_text(numbers)}")
        if not numbers:
            return self._begun, self._begun.param_values()
        key = tuple(numbers)
        if key not in self._templates:
            with suppress(BadInput, TypeError, ValueError):  # told below, in the words of the loop
                self._templates[key] = template(self.loop, self._begun, self.scenario, numbers)
        known = self._templates.get(key)
        found = known.with_numbers(numbers) if known is not None else None
        if found is not None:
            return found
        block = loop_at_start(self.loop.with_params(**numbers), self.scenario)
        check_guards(block)
        return block, block.param_values()

    def _parts(
        self, block: Block, scenario: Scenario, values: Mapping[str, np.ndarray] | None = None
    ) -> tuple[np.ndarray, Callable[..., int], list[tuple[int, int, np.ndarray]]]:
        """Inputs tick by tick, what rolls, and (first tick, last tick, parameters) of each part."""
        h = float(block.period or 0.0)
        inputs, params = rail_values(block, scenario)
        starts = None if scenario.rail is None else tuple(scenario.rail.starts)
        fixed = {n: [np.asarray(v).tolist() for v in vs] for n, vs in inputs.items()}
        key = (scenario.seed, starts, fixed)
        fed = self._feed
        if fed is None or fed[0] != key:
            fed = self._feed = (key, feeds(block, scenario, self.ticks, h, inputs))
        f, parts = pieces(block, scenario, self.ticks, h, params, values)
        roller = self._roller
        if roller is None or roller[0] is not f:
            roller = self._roller = (f, build.make_roller(f, self.compile, self.ticks * self._runs))
        return fed[1], roller[1], parts


@dataclass(frozen=True)
class Whole:
    """A run with all that it was made of.

    Attributes:
        block: the loop with its numbers. f: what was rolled, (x, u, p) -> (x+, y).
        u, x, y: a row a tick; x at its start. parts: first tick, last tick and p of each part.
    """

    block: Block
    f: ca.Function
    u: np.ndarray
    x: np.ndarray
    y: np.ndarray
    parts: list[tuple[int, int, np.ndarray]]


def _ticks(loop: Block, scenario: Scenario, every: int) -> int:
    """Ticks of a run; refuses what cannot be one."""
    if as_block("simulate: the loop", loop).kind == "flow":
        raise BadInput(f"{loop.name} is continuous; sampled({loop.name}, h, method) first")
    if loop.period is None:
        raise BadInput(f"{loop.name} has no period; one of its blocks must say it")
    if not isinstance(scenario, Scenario):
        raise BadInput(
            f"simulate: {scenario!r} is no scenario; write Scenario(name, duration, ...)"
        )
    h = loop.period
    ticks = round(scenario.duration / h)
    if ticks < 1:
        raise BadInput(
            f"scenario {scenario.name}: duration {scenario.duration:g} s is shorter than one tick"
            f" of {h:g} s"
        )
    check_whole("simulate: every", every)
    read = total_size(loop.inputs.values())
    logged = total_size([*loop.states.values(), *loop.outputs.values()])
    room = 8 * ticks * (read + logged / every)
    if room > LARGEST:
        raise BadInput(
            f"scenario {scenario.name}: {ticks:.3g} ticks of {h:g} s need {room / 2**30:.3g} GiB;"
            " shorten the duration, or keep fewer rows with every="
        )
    return ticks


def _check_logged(loop: Block, wanted: set[str] | None) -> None:
    known = {s.name for s in loop.signals if s.role != "param"}
    for n in wanted or ():
        check_known(f"{loop.name} has no signal", n, known, " to log")


def _broken(loop: Block, x: np.ndarray, when: float) -> str:
    at = 0
    for n, s in loop.states.items():
        values = x[at : at + s.size]
        at += s.size
        if not np.isfinite(values).all():
            bad = values[~np.isfinite(values)][0]
            return f"{loop.name}: {n} [{s.unit}] became {bad} at t = {when:.6g} s"
    return f"{loop.name}: a state became NaN before t = {when:.6g} s"


class Ending:
    """When a run ends before its duration.

    Raises:
        BadInput: the loop has no such signal.
    """

    def __init__(self, loop: Block, scenario: Scenario) -> None:
        end = scenario.end
        assert end is not None
        _check_logged(loop, {end.signal})
        columns = log_columns(loop, {end.signal})
        self._column = columns[end.signal]
        if self._column.role == "input":
            raise BadInput(f"scenario {scenario.name}: {end.signal} is fed; a run ends by what it"
                           " computes")  # fmt: skip
        self._there = end.there
        self.begins = -1 if end.returns else 0  # ticks for which it is there at the start
        self._needed = max(round(end.hold / float(loop.period or 1.0)), 1)

    def tick(self, x: np.ndarray, y: np.ndarray, stayed: int) -> tuple[int | None, int]:
        """Last tick of the run among these, or None; and for how many ticks it has been there.

        Args:
            x, y: states and outputs, a row a tick.
            stayed: ticks for which it had been there before; -1 where it has to leave first.
        """
        c = self._column
        values = (y if c.role == "output" else x)[:, c.at : c.at + c.signal.size]
        number = np.arange(len(values))
        there = self._there(values)
        if stayed < 0:
            left = np.flatnonzero(~there)
            if not left.size:
                return None, stayed
            there[: left[0]], stayed = False, 0
        outside = np.where(there, -1 - stayed, number)
        count = number - np.maximum.accumulate(outside)
        hits = np.flatnonzero(count >= self._needed)
        return (int(hits[0]) if hits.size else None), int(count[-1]) if count.size else stayed
