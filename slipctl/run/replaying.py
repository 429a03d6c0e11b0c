"""Recorded data through a block: an estimator or a controller of a loop, tick by tick."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from slipctl.block import unit_walk
from slipctl.block.block import Block
from slipctl.block.expression import read
from slipctl.block.signals import Signal
from slipctl.block.timing import sampled
from slipctl.block.units import factor, parse_quantity, refuse_count, si_text, unit
from slipctl.errors import BadInput, Faults, check_positive, nearest
from slipctl.run.rail import Scenario
from slipctl.run.recording import Recording
from slipctl.run.simulation import simulate

if TYPE_CHECKING:
    import xarray

RULES = ("hold", "linear")
"""How samples become values of ticks: the last one before, or a straight line between two."""


@dataclass(frozen=True)
class Compared:
    """An output beside what was recorded.

    Attributes:
        output: its name.
        unit: of both.
        recorded: values at the ticks, NaN in gaps.
        computed: values at the ticks.
    """

    output: str
    unit: str
    recorded: np.ndarray
    computed: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Recorded minus computed."""
        return self.recorded - self.computed


@dataclass
class Replayed:
    """What a block gives over a log.

    Attributes:
        block: what ran.
        data: inputs, outputs and states over time.
        compared: outputs beside the recording.
        gaps: ends in s of the stretches without samples.
        notes: what was converted, filled and left out, a line each.
    """

    block: Block
    data: xarray.Dataset
    compared: list[Compared] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def innovations(self) -> list[str]:
        """Outputs that say how far a measurement was from what was expected."""
        ends = ("innovation", "residual", "nis")
        return [n for n in self.block.outputs
                if n.rpartition(".")[2].startswith(ends) and n in self.data]  # fmt: skip

    def outside_gaps(self) -> np.ndarray:
        """Ticks at which the log has samples."""
        t = self.data["time"].values + self.data.attrs["log_start_s"]
        inside = np.zeros(t.size, dtype=bool)
        for a, b in self.gaps:
            inside |= (t > a + 1e-9) & (t < b - 1e-9)
        return ~inside


def part_of(loop: Block, path: str) -> Block:
    """Part of a loop with the numbers and the start that it has there.

    A part of which the loop has several copies, such as the filter of each axle, is one of them.

    Raises:
        BadInput: no such part, or a number of it that differs from copy to copy.
    """
    part = loop[path]
    values, start = loop.values_by_place(), loop.start()
    places = {n: f"{path}.{n}" for n in (*part.params, *part.states)}
    new: dict[str, Any] = {
        n: values[places[n]]
        for n, s in part.params.items()
        if not s.derived and places[n] in values
    }
    new |= {n: start[places[n]] for n in part.states if places[n] in start}
    for n, value in new.items():
        shape = {**part.params, **part.states}[n].shape
        if np.shape(value) != shape and np.size(value) > 1:
            new[n] = _of_a_copy(f"{path}.{n}", np.asarray(value), shape)
    known = part.with_params(**new) if new else part
    return known if known.period is not None else with_period(known, loop.period)


def _of_a_copy(name: str, values: np.ndarray, shape: tuple[int, ...]) -> Any:
    """Number of one of several copies, if it is that of all of them."""
    each = values.reshape(*shape, -1)
    if (each != each[..., :1]).any():
        raise BadInput(
            f"{name} differs from copy to copy; name the part that holds them all, or give them"
            " one number by --set"
        )
    return each[..., 0] if shape else float(each[0])


def with_period(block: Block, period: float | None) -> Block:
    """The same block with a sample period."""
    if period is None or block.kind == "flow":
        return block
    new = block._copy(block.signals)
    new.period = period
    return new


def replay(
    block: Block,
    log: Recording,
    mapping: Mapping[str, str],
    *,
    settings: Mapping[str, str] | None = None,
    beside: Mapping[str, str] | None = None,
    period: float | None = None,
    rule: str = "hold",
    compile: bool = True,
) -> Replayed:
    """Run a block over a log.

    Args:
        block: estimator, controller or law.
        log: from :func:`slipctl.run.recording.read_recording`.
        mapping: column of each input, ``{"omega": "WheelSpeed_1[km/h] / r"}``: its name, its unit
            if the head says none (or another), and arithmetic with numbers and the block's
            parameters.
        settings: values of inputs, parameters and start values with units.
        beside: column that each of these outputs is compared with.
        period: tick in s; the block's own by default, else the spacing of the log.
        rule: one of :data:`RULES`.
        compile: compile the block when a C compiler is there.

    Raises:
        Faults: what is wrong with mapping and settings, all at once.
        BadInput: no tick fits, an unknown rule.
    """
    if rule not in RULES:
        raise BadInput(f"there is no rule {rule!r}{nearest(rule, RULES)}")
    h = _tick(block, log, period)
    block = sampled(block, h, "rk4") if block.kind == "flow" else block
    block = with_period(block, h)
    block, constants, faults = _settings(block, settings or {})
    sources = _sources(block, log, mapping, constants, faults)
    pairs = _pairs(block, log, beside or {}, faults)
    if faults:
        raise Faults(faults)
    notes = list(log.notes)
    gaps = log.gaps
    told = ", ".join(f"{a:.4g} .. {b:.4g} s" for a, b in gaps[:5])
    if gaps:
        notes.append(f"{len(gaps)} gaps, the last values held: {told}" + ", ..." * (len(gaps) > 5))
    first, ticks, columns = _columns(block, log, sources, h, rule, notes)
    if ticks < 1:
        raise BadInput(f"{log.source}: the mapped columns have no stretch of a tick in common")
    inputs: dict[str, Any] = {**constants, **columns}
    data = simulate(block, Scenario("replay", ticks * h, inputs=inputs), compile=compile)
    data = data.assign_attrs(log=log.source, log_start_s=first)
    data = data.drop_attrs(deep=False).assign_attrs(
        {k: v for k, v in data.attrs.items() if k not in ("seed", "noise", "rail_changes_s")}
    )
    found = Replayed(block, data, gaps=gaps, notes=notes)
    keep = found.outside_gaps()
    for name, source in pairs.items():
        if name not in data:
            raise BadInput(f"{name} is no single number; compare another output")
        recorded = source.at(log, first + h * np.arange(ticks), rule, keep)
        unit_ = {**block.outputs, **block.states}[name].unit
        found.compared.append(Compared(name, unit_, recorded, data[name].values))
    return found


def _tick(block: Block, log: Recording, period: float | None) -> float:
    if period is None:
        return float(block.period) if block.period is not None else log.spacing
    check_positive("--period", period, "s")
    if block.period is not None and not np.isclose(period, block.period, rtol=1e-9):
        raise BadInput(f"{block.name} has a period of {block.period:g} s; leave --period out")
    return period


@dataclass(frozen=True)
class _Source:
    """Where the values of a signal come from: a column, its unit, and arithmetic behind it.

    Attributes:
        column, scale: what is read first, and what makes its unit the one wanted.
        tail: arithmetic with ``numbers`` of the block and with further columns.
        others: scales of these columns.
    """

    column: str
    scale: float
    tail: str
    numbers: Mapping[str, float]
    others: Mapping[str, float] = field(default_factory=dict)

    def values(self, log: Recording) -> np.ndarray:
        """Values at the samples, NaN where nothing was measured."""
        x = log.channel(self.column) * self.scale
        if not self.tail:
            return x
        tree = read("u__" + self.tail)
        symbols = {n: ca.SX.sym(n) for n in tree.names}
        f = ca.Function("f", list(symbols.values()), [ca.SX(tree.value(symbols))])
        rows = {n: log.held(n) * scale for n, scale in self.others.items()} | {"u__": x}
        given = [rows[n].reshape(1, -1) if n in rows else self.numbers[n] for n in symbols]
        return np.array(f(*given).full()).ravel()

    def at(self, log: Recording, ticks: np.ndarray, rule: str, keep: np.ndarray) -> np.ndarray:
        """Values at ticks, NaN where the log says nothing."""
        x = self.values(log)
        good = np.isfinite(x)
        if not good.any():
            return np.full(ticks.size, np.nan)
        return np.where(keep, _resampled(log.time[good], x[good], ticks, rule), np.nan)


def _resampled(t: np.ndarray, x: np.ndarray, ticks: np.ndarray, rule: str) -> np.ndarray:
    if rule == "linear":
        return np.interp(ticks, t, x)
    return x[np.maximum(np.searchsorted(t, ticks + 1e-9, side="right") - 1, 0)]


def _settings(
    block: Block, settings: Mapping[str, str]
) -> tuple[Block, dict[str, float], list[str]]:
    """Block with what is set, constants of inputs, and what is wrong."""
    numbers: dict[str, float] = {}
    constants: dict[str, float] = {}
    faults: list[str] = []
    for name, text in settings.items():
        try:
            full = block.find(name, "input", "param", "state")
            signal = block.inputs.get(full) or block.declared(full)
            value = parse_quantity(text, signal.unit, name)
            signal.check(name, value)
            (constants if full in block.inputs else numbers)[full] = value
        except BadInput as error:
            faults.append(f"--set {error}")
    return (block.with_params(**numbers) if numbers else block), constants, faults


def _sources(
    block: Block, log: Recording, mapping: Mapping[str, str], constants: Mapping[str, float],
    faults: list[str],
) -> dict[str, _Source]:  # fmt: skip
    """Source of each input that a column gives."""
    found: dict[str, _Source] = {}
    for name, text in mapping.items():
        try:
            full = block.find(name, "input")
            found[full] = _source(block, log, block.inputs[full], text)
        except BadInput as error:
            faults.append(f"--map {name}: {error}")
    for n, s in block.inputs.items():
        if n in found or n in constants:
            continue
        short = n.rpartition(".")[2]
        same = next((c for c in (n, short) if c in log.texts), None)
        if same is not None and not any(f.startswith(f"--map {short}:") for f in faults):
            try:
                found[n] = _source(block, log, s, same)
                log.notes.append(f"{n} is read from the column of its name")
                continue
            except BadInput as error:
                faults.append(f"the column {same}: {error}")
        elif s.value is not None and not s.noise:
            shown = np.asarray(s.value, dtype=float).ravel()[0]
            log.notes.append(f"{n} is not mapped; {shown:g} {s.unit} as it is declared")
        elif s.value is None and not s.noise and not any(f"--map {short}" in f for f in faults):
            faults.append(
                f"{block.name}.{n} [{s.unit}] is not fed; write --map {n}=COLUMN, or"
                f" --set {n}=VALUE; {log.source} has {', '.join(log.names[:12])}"
            )
    return found


def _pairs(
    block: Block, log: Recording, beside: Mapping[str, str], faults: list[str]
) -> dict[str, _Source]:
    found = {}
    for name, text in beside.items():
        try:
            full = block.find(name, "output", "state")
            signal = {**block.states, **block.outputs}[full]
            found[full] = _source(block, log, signal, text)
        except BadInput as error:
            faults.append(f"--beside {name}: {error}")
    return found


def _source(block: Block, log: Recording, signal: Signal, text: str) -> _Source:
    """Read ``COLUMN``, ``COLUMN[unit]`` and arithmetic behind it, for a signal."""
    text = text.strip()
    hits = [c for c in log.texts if text == c or (text.startswith(c) and not _wordy(text[len(c)]))]
    if not hits:
        name = re.split(r"\s*[\[*/+-]", text)[0]
        log.find(name)
        hits = [log.find(name)]
        text = hits[0] + text[len(name) :]
    column = max(hits, key=len)
    rest = text[len(column) :].strip()
    given = re.match(r"\[([^\]]*)\]\s*", rest)
    told = given[1] if given else log.units[column]
    tail = rest[given.end() :] if given else rest
    if not told and not tail:
        log.notes.append(f"{column} has no unit in the head; read in {signal.unit}")
        return _Source(column, 1.0, "", {})
    if not tail:
        if unit(told).dims != unit(signal.unit).dims:
            radius = next((n for n in block.params if n.rpartition(".")[2] == "r"), "r")
            raise BadInput(
                f"{column} is in {told}, {signal.name} in {signal.unit}, another dimension; turn it"
                f" round, '{column}[{told}] / {radius}' say"
            )
        scale = factor(told, signal.unit)
        if scale != 1.0:
            log.notes.append(f"{column} converted from {told} to {signal.unit}")
        return _Source(column, scale, "", {})
    refuse_count(told or "1")
    si = si_text(told or "1")
    said = dict(log.units)  # the unit of a further column may stand behind it too
    for c in log.texts:
        inside = re.search(rf"\b{re.escape(c)}\s*\[([^\]]*)\]", tail)
        if inside:
            said[c], tail = inside[1], tail.replace(inside[0], c)
    tree = read("u__" + tail)
    numbers, others, units = {}, {}, {"u__": si}
    for n in tree.names:
        if n == "u__":
            continue
        if n in log.texts:
            refuse_count(said[n] or "1")
            units[n] = si_text(said[n] or "1")
            others[n] = factor(said[n] or "1", units[n])
            continue
        full = block.find(n, "param")
        numbers[n], units[n] = float(block.param_values()[full]), block.params[full].unit
    symbols = {n: ca.SX.sym(n) for n in tree.names}
    value = ca.SX(tree.value(symbols))
    wrong = unit_walk.check({signal.name: value}, units, {signal.name: signal.unit})
    if wrong:
        why = wrong[0].partition(": ")[2].replace("u__", column)
        raise BadInput(f"{text}: {why}")
    log.notes.append(f"{signal.name} = {text}" + (f" ({told} to {si})" if told != si else ""))
    return _Source(column, factor(told or "1", si), tail, numbers, others)


def _wordy(letter: str) -> bool:
    return letter.isalnum() or letter == "_"


def _columns(
    block: Block, log: Recording, sources: Mapping[str, _Source], h: float, rule: str,
    notes: list[str],
) -> tuple[float, int, dict[str, np.ndarray]]:  # fmt: skip
    """Start, number of ticks, and the inputs at the ticks."""
    channels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    values = block.param_values()
    for n, source in sources.items():
        x = source.values(log)
        signal = block.inputs[n]
        if signal.shape:
            raise BadInput(f"{n} has shape {signal.shape}; a column gives one number")
        missing = ~np.isfinite(x)
        empty = missing & log.rows(source.column)
        lows, highs, _ = block.ends(signal, values)
        lo, hi = (max(map(float, lows), default=-np.inf), min(map(float, highs), default=np.inf))
        off = ~missing & ((x < lo) | (x > hi))
        if empty.any():
            longest = _longest(log.time, empty)
            notes.append(f"{source.column}: {int(empty.sum())} empty cells, the last value held,"
                         f" for {longest:.3g} s at most")  # fmt: skip
        if off.any():
            notes.append(f"{n}: {int(off.sum())} samples off {lo:g} .. {hi:g} {signal.unit}, the"
                         " last good value held")  # fmt: skip
        good = ~missing & ~off
        if not good.any():
            raise BadInput(f"{log.source}: {source.column} has no sample that {n} may take")
        channels[n] = log.time[good], x[good]
    first = max((float(t[0]) for t, _ in channels.values()), default=0.0)
    ticks = int(np.floor((float(log.time[-1]) - first) / h + 1e-6)) + 1
    at = first + h * np.arange(max(ticks, 0))
    if log.spacing < 0.5 * h:
        notes.append(f"samples every {log.spacing:.4g} s become ticks of {h:g} s without a filter")
    return first, ticks, {n: _resampled(t, x, at, rule) for n, (t, x) in channels.items()}


def _longest(time: np.ndarray, empty: np.ndarray) -> float:
    """Longest stretch in s for which nothing was measured."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], empty, [False]]).astype(int)))
    spans = zip(edges[::2], edges[1::2], strict=True)
    last = len(time) - 1
    return max(float(time[min(b, last)] - time[max(a - 1, 0)]) for a, b in spans)
