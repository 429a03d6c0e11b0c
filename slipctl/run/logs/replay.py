"""Recorded data through a block: an estimator or a controller of a loop, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import sampled
from slipctl.errors import BadInput, Faults, check_known, check_positive
from slipctl.run.logs import log_signals
from slipctl.run.logs.log_signals import Source
from slipctl.run.logs.recorded_log import Recording
from slipctl.run.rail import Scenario
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
        done: how the file was read, a line each.
    """

    block: Block
    data: xarray.Dataset
    compared: list[Compared] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)

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
    return block._copy(block.signals, period=period)


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
        log: from :func:`slipctl.run.logs.recorded_log.read_recording`.
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
        BadInput: a period that is none, an unknown rule.
    """
    check_known("there is no rule", rule, RULES)
    if log.begins:
        row = f"{log.table.line} {log.table.lines[log.rows[log.begins[0]]]}"
        raise BadInput(f"{log.source}: the time goes back in {row}, where a further run begins;"
                       " a replay takes one run, so cut the file there")  # fmt: skip
    h = _tick(block, log, period)
    block = sampled(block, h, "rk4") if block.kind == "flow" else block
    block = with_period(block, h)
    block, constants, faults = log_signals.apply_settings(block, settings or {})
    sources = log_signals.of_inputs(block, log, mapping, constants, faults)
    pairs = log_signals.of_results(block, log, beside or {}, faults)
    if faults:
        raise Faults(faults)
    for x in (*sources.values(), *pairs.values()):
        x.values(log)  # what has to be decided of a column is told with the rest
    notes = list(log.notes)
    gaps = log.gaps
    told = ", ".join(f"{a:.4g} .. {b:.4g} s" for a, b in gaps[:5])
    if gaps:
        bridged = log_signals.BRIDGED[rule]
        notes.append(f"{len(gaps)} gaps, {bridged}: {told}" + ", ..." * (len(gaps) > 5))
    first, ticks, columns = _columns(block, log, sources, h, rule, notes)
    inputs: dict[str, Any] = {**constants, **columns}
    data = simulate(block, Scenario("replay", ticks * h, inputs=inputs), compile=compile)
    data = data.assign_attrs(log=log.source, log_start_s=first)
    data = data.drop_attrs(deep=False).assign_attrs(
        {k: v for k, v in data.attrs.items() if k not in ("seed", "noise", "rail_changes_s")}
    )
    found = Replayed(block, data, gaps=gaps, notes=notes, done=log.table.done)
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


def _columns(
    block: Block, log: Recording, sources: Mapping[str, Source], h: float, rule: str,
    notes: list[str],
) -> tuple[float, int, dict[str, np.ndarray]]:  # fmt: skip
    """Start, number of ticks, and the inputs at the ticks."""
    values = block.param_values()
    channels = {
        n: log_signals.good_samples(block, log, n, x, values, rule, notes)
        for n, x in sources.items()
    }
    first = max((float(t[0]) for t, _ in channels.values()), default=0.0)
    ticks = int(np.floor((float(log.time[-1]) - first) / h + 1e-6)) + 1
    at = first + h * np.arange(ticks)
    if log.spacing < 0.5 * h:
        notes.append(f"samples every {log.spacing:.4g} s are resampled to ticks of {h:g} s, without"
                     " an anti-aliasing filter")  # fmt: skip
    if log.spacing > 20 * h:
        notes.append(f"samples every {log.spacing:.4g} s are slow for ticks of {h:g} s; look at the"
                     " unit of the time")  # fmt: skip
    inputs = {n: log_signals.resample_at(t, x, at, rule) for n, (t, x) in channels.items()}
    return first, ticks, inputs
