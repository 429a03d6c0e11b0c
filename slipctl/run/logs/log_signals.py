"""Columns of a log as signals of a block: names, units, and arithmetic with its numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.text.expression import read
from slipctl.block.units import unit_walk
from slipctl.block.units.unit_algebra import factor, parse_quantity, refuse_count, si_text, unit
from slipctl.errors import BadInput, nearest
from slipctl.run.logs.recorded_log import Recording
from slipctl.run.waveform import stretches
from slipctl.tables.columns import expression_of, turned_twice, unit_of_column


@dataclass(frozen=True)
class Source:
    """Where the values of a signal come from: columns, and arithmetic with them.

    Attributes:
        columns: name and scale by symbol; the scale makes the unit the one wanted. The samples are
            those of the first.
        text: arithmetic with the symbols and with ``numbers``; empty for the first as it is.
        numbers: of the block.
    """

    columns: Mapping[str, tuple[str, float]]
    text: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def column(self) -> str:
        """The first column."""
        return next(iter(self.columns.values()))[0]

    def values(self, log: Recording) -> np.ndarray:
        """Values at the samples, NaN where nothing was measured."""
        x = log.channel(self.column) * next(iter(self.columns.values()))[1]
        if not self.text:
            return x
        tree = read(self.text)
        symbols = {n: ca.SX.sym(n) for n in tree.names}
        f = ca.Function("f", list(symbols.values()), [ca.SX(tree.value(symbols))])
        rows = {n: log.held(c) * scale for n, (c, scale) in self.columns.items()}
        rows[next(iter(self.columns))] = x
        given = [rows[n].reshape(1, -1) if n in rows else self.numbers[n] for n in symbols]
        return np.array(f(*given).full()).ravel()

    def empty(self, log: Recording) -> dict[str, np.ndarray]:
        """Samples at which nothing was measured, of each column that has some."""
        rows = {c: ~np.isfinite(log.channel(c)) & log.rows_of(c) for c, _ in self.columns.values()}
        return {c: r for c, r in rows.items() if r.any()}

    def at(self, log: Recording, ticks: np.ndarray, rule: str, keep: np.ndarray) -> np.ndarray:
        """Values at ticks, NaN where the log says nothing."""
        x = self.values(log)
        good = np.isfinite(x)
        if not good.any():
            return np.full(ticks.size, np.nan)
        return np.where(keep, resample_at(log.time[good], x[good], ticks, rule), np.nan)


BRIDGED = {"hold": "the last value held", "linear": "a straight line across"}
"""What becomes of samples that are missing, by the rule."""


def good_samples(
    block: Block, log: Recording, name: str, source: Source, values: Mapping[str, np.ndarray],
    rule: str, notes: list[str],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Times and values of the samples that an input may take, and lines on the others.

    Args:
        block: with the parameters ``values``, which its ranges follow.
        log: the log.
        name: of the input.
        source: of its values.
        values: of all parameters.
        rule: by which samples become values of ticks.
        notes: a line is added for what is held.

    Raises:
        BadInput: a vector, or no good sample.
    """
    x = source.values(log)
    signal = block.inputs[name]
    if signal.shape:
        raise BadInput(f"{name} has shape {signal.shape}; a column gives one number")
    missing = ~np.isfinite(x)
    lows, highs, *_ = block.ends(signal, values)
    lo, hi = (max(map(float, lows), default=-np.inf), min(map(float, highs), default=np.inf))
    off = ~missing & ((x < lo) | (x > hi))
    for column, empty in source.empty(log).items():
        notes.append(f"{column}: {int(empty.sum())} empty cells, {BRIDGED[rule]}, for"
                     f" {_longest(log.time, empty):.3g} s at most")  # fmt: skip
    if off.any():
        notes.append(f"{name}: {int(off.sum())} samples off {lo:g} .. {hi:g} {signal.unit},"
                     f" {BRIDGED[rule]}")  # fmt: skip
    good = ~missing & ~off
    if not good.any():
        raise BadInput(f"{log.source}: {source.column} has no sample that {name} may take")
    return log.time[good], x[good]


def _longest(time: np.ndarray, empty: np.ndarray) -> float:
    """Longest stretch in s for which nothing was measured."""
    begins, ends = stretches(empty)
    return float((time[np.minimum(ends, len(time) - 1)] - time[np.maximum(begins - 1, 0)]).max())


def resample_at(t: np.ndarray, x: np.ndarray, ticks: np.ndarray, rule: str) -> np.ndarray:
    """Values at ticks: the last sample before, or a straight line between two."""
    if rule == "linear":
        return np.interp(ticks, t, x)
    return x[np.maximum(np.searchsorted(t, ticks + 1e-9, side="right") - 1, 0)]


def apply_settings(
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


def of_inputs(
    block: Block, log: Recording, mapping: Mapping[str, str], constants: Mapping[str, float],
    faults: list[str],
) -> dict[str, Source]:  # fmt: skip
    """Source of each input that a column gives."""
    found: dict[str, Source] = {}
    for name, text in mapping.items():
        try:
            full = block.find(name, "input")
            found[full] = source_of(block, log, block.inputs[full], text)
        except BadInput as error:
            faults.append(f"--map {name}: {error}")
    for n, s in block.inputs.items():
        if n in found or n in constants:
            continue
        short = n.rpartition(".")[2]
        same = next((c for c in (n, short) if c in log.columns), None)
        if same is not None and not any(f.startswith(f"--map {short}:") for f in faults):
            try:
                found[n] = source_of(block, log, s, same)
                log.notes.append(f"{n} is read from the column of its name")
                continue
            except BadInput as error:
                faults.append(f"the column {same}: {error}")
        elif s.value is not None and not s.noise:
            shown = np.asarray(s.value, dtype=float).ravel()[0]
            unit = "" if s.unit == "1" else f" {s.unit}"
            log.notes.append(f"{n} is not mapped; it is {shown:g}{unit}, as declared")
        elif s.value is None and not s.noise and not any(f"--map {short}" in f for f in faults):
            faults.append(
                f"{block.name}.{n} [{s.unit}] is not fed; write --map {n}=COLUMN, or"
                f" --set {n}=VALUE; {log.source} has {', '.join(log.names[:12])}"
            )
    return found


def of_results(
    block: Block, log: Recording, beside: Mapping[str, str], faults: list[str]
) -> dict[str, Source]:
    """Source of what each output or state is compared with."""
    found = {}
    for name, text in beside.items():
        try:
            full = block.find(name, "output", "state")
            signal = {**block.states, **block.outputs}[full]
            found[full] = source_of(block, log, signal, text)
        except BadInput as error:
            faults.append(f"--beside {name}: {error}")
    return found


def source_of(block: Block, log: Recording, signal: Signal, text: str) -> Source:
    """Read ``COLUMN``, ``COLUMN[unit]`` and arithmetic with columns, for a signal."""
    said = expression_of(text, log.table)
    if not said.columns:
        log.table.find(re.split(r"\s*[\[*/+-]", text.strip())[0])
    if said.plain:
        ((column, told),) = zip(said.columns.values(), said.told.values(), strict=True)
        return Source({"u": (column, _scale(block, log, signal, column, told))})
    units, columns, numbers = {}, {}, {}
    for n, column in said.columns.items():
        told = unit_of_column(log.table, column, said.told[n], "", log.notes) or "1"
        refuse_count(told)
        units[n] = si_text(told)
        columns[n] = (column, factor(told, units[n]))
    tree = read(said.text)
    for n in tree.names:
        if n in columns:
            continue
        if n in block.law_data.beside:
            known = block.law_data.beside[n]
            if known.value is None:
                raise BadInput(f"{text} needs {n}, {known.doc} [{known.unit}]; --set {n}=VALUE")
            numbers[n], units[n] = float(known.value), known.unit
            continue
        try:
            full = block.find(n, "param")
        except BadInput as error:
            raise BadInput(f"{error}{nearest(n, log.columns)}") from None
        numbers[n], units[n] = float(block.param_values()[full]), block.params[full].unit
    symbols = {n: ca.SX.sym(n) for n in tree.names}
    value = ca.SX(tree.value(symbols))
    wrong = unit_walk.check({signal.name: value}, units, {signal.name: signal.unit})
    if wrong:
        raise BadInput(f"{text}: {wrong[0].partition(': ')[2]}")
    turned = [f"{c} from {log.units[c]} to {units[n]}" for n, (c, scale) in columns.items()
              if scale != 1.0 and log.units[c]]  # fmt: skip
    log.notes.append(f"{signal.name} = {text}" + f" ({', '.join(turned)})" * bool(turned))
    log.notes += turned_twice(text, dict(columns.values()))
    return Source(columns, said.text, numbers)


def _scale(block: Block, log: Recording, signal: Signal, column: str, told: str) -> float:
    """What turns a column that is a signal itself into the signal's unit."""
    told = unit_of_column(log.table, column, told, signal.unit, log.notes)
    if not told:
        log.notes.append(f"{column} has no unit in the head; read in {signal.unit}")
        return 1.0
    if unit(told).dims != unit(signal.unit).dims:
        radius = next((n for n in block.params if n.rpartition(".")[2] == "r"), "r")
        raise BadInput(
            f"the column {column} is in {told}, and {signal.name} is in {signal.unit}, another"
            f" dimension; convert it by an expression, such as '{column}[{told}] / {radius}'"
        )
    scale = factor(told, signal.unit)
    if scale != 1.0:
        log.notes.append(f"{column} converted from {told} to {signal.unit}")
    return scale
