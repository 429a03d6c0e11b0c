"""What gives reason to doubt a run: ranges, energy, estimates that stay off, limits, wires."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.block.units.unit_algebra import read_unit
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import rail_values
from slipctl.run.warnings.wheels import (
    axle_of_column,
    columns,
    longest_span,
    watched_wheels,
    worked_axles,
)

AWAY = 3.0
"""Deviations within which an honest estimate is: beyond one it is a third of the time."""

LONG = 1.0
"""Time in s for which an estimate may be further off."""

MOST = 0.5
"""Share of a run above which a limit is active for most of it."""

ROUNDED = 1e-9
"""Share of a range by which a state may be beyond it."""

GIVEN = 1e-3
"""Share of what a power moves that it may give back: it is of the mean of a tick."""

Values = Mapping[Any, Any]


def doubt_signals(loop: Block) -> set[str]:
    """Signals that tell whether a run is to be doubted: estimates, what they estimate, limits."""
    found = {n for n, _ in _limits(loop)}
    for n, s, names in _judged(loop):
        found |= {n, *names.values(), *(loop._sibling(n, k) for k in names_in(s.deviation))}
        found.add(loop._sibling(n, "P"))
    found |= {n for n in loop.states if n.rpartition(".")[2] == "x"}  # for where the axles are
    found |= {n for n, _ in _ranged(loop)} | {n for n, _ in _taking(loop)}
    known = {**loop.states, **loop.outputs}
    return {n for n in found if n in known} | watched_wheels(loop)


def warnings_of_log(loop: Block, scenario: Scenario, log: Values) -> list[str]:
    """What the log of a whole run gives reason to doubt, one line each.

    An estimate is doubted that is off by more than three of its own deviations for longer than a
    second. So is a limit that is active for more than half of the run, and a state or a residual
    that leaves its declared range. So is a power that takes, with a range from 0, where it gives.

    Args:
        loop, scenario: the run.
        log: ``time`` and the signals of :func:`doubt_signals`, by name, a row per tick.
    """
    return [
        *_unreached(loop, scenario, log), *_off_range(loop, log), *_giving(loop, log),
        *(e.numbers for e in estimates_off(loop, scenario, log)), *_limited(loop, log),
    ]  # fmt: skip


@dataclass(frozen=True)
class EstimateOff:
    """An estimate that was off by more than its own deviations for long.

    Attributes:
        what: is estimated, in words: "adhesion curve". axle: from 1 on; 0 where there is one.
        start, stop: of the stretch, in s. to_end: whether the run ends in it.
        numbers: all of it with its numbers, a line.
    """

    what: str
    axle: int
    start: float
    stop: float
    to_end: bool
    numbers: str


def warnings_of_loop(loop: Block, scenario: Scenario) -> list[str]:
    """What gives reason to doubt a loop before it runs, one line each.

    A sensor whose noise ``sigma`` is above zero and below the error of its own steps ``q``. An
    input that no wire feeds, while another part gives a signal of its name and unit.
    """
    return [*_quantised(loop), *_unfed(loop, scenario)]


# ---- estimates -----------------------------------------------------------------------------------


def meant_signals(loop: Block, s: Signal, text: str, own: set[str]) -> dict[str, str | None]:
    """Signals that an estimate means by the names in what it says of its truth.

    Args:
        loop: in which it is. s: the estimate. text: one of ``s.truth``.
        own: blocks of all estimates, whose signals are no truth.

    Returns:
        Full name by name; None where no signal has that name and unit, or more than one.
    """
    if text.isidentifier():
        return {text: _meant(loop, text, own, s.unit)}
    known = {**loop.params, **loop.outputs, **loop.states}
    units = {n.rpartition(".")[2]: k.unit for n, k in known.items() if n.rpartition(".")[0] in own}
    return {n: _meant(loop, n, own, units.get(n, "")) for n in names_in(text)}


def _meant(loop: Block, name: str, own: set[str], unit: str) -> str | None:
    """A shared number, or the one other signal of this name and unit; no held copy of an output."""
    if name in loop.params:
        return name
    for signals in (loop.states, loop.params, loop.outputs):
        hits = [n for n, s in signals.items() if n.endswith("." + name)
                and n.rpartition(".")[0] not in own and ".held_" not in f".{n}"
                and (not unit or read_unit(n, s.unit).same(read_unit(n, unit)))]  # fmt: skip
        if hits:
            return hits[0] if len(hits) == 1 and not _of_another_law(loop, hits[0], own) else None
    return None


def _of_another_law(loop: Block, name: str, own: set[str]) -> bool:
    """Whether a number is of a law of adhesion with a parameter that no estimator knows of.

    A parameter of one law is no truth for that of another one, though both are called ``c``.
    """
    home = name.rpartition(".")[0]
    laws = {path: law for path, law in loop.leaves() if law.conditions and "mu" in law.outputs}
    if home not in laws:
        return False
    known = {t for o in own for n, s in loop.states.items() if n.rpartition(".")[0] == o
             for text in s.truth for t in names_in(text)}  # fmt: skip
    known |= {n.rpartition(".")[2] for n in loop.params if n.rpartition(".")[0] in own}
    return any(n not in known for n, s in laws[home].params.items() if not s.derived)


def _judged(loop: Block) -> Iterator[tuple[str, Signal, dict[str, str]]]:
    """Estimates that say how sure they are all the time, and the names of their truth."""
    estimates = {n: s for n, s in loop.states.items() if s.deviation and s.truth}
    own = {n.rpartition(".")[0] for n in estimates}
    for n, s in estimates.items():
        names = {k: v for text in s.truth for k, v in meant_signals(loop, s, text, own).items()}
        if all(names.values()):
            yield n, s, {k: str(v) for k, v in names.items()}


def estimates_off(loop: Block, scenario: Scenario, log: Values) -> Iterator[EstimateOff]:
    """Estimates that were off by more than three of their own deviations for more than a second.

    Args:
        loop, scenario, log: as of :func:`warnings_of_log`.
    """
    time = np.asarray(log["time"])
    if time.size < 2:
        return
    tick = float(time[1] - time[0])
    by_rail = _along(loop, scenario, log)
    params = loop.param_values()
    for n, s, names in _judged(loop):
        sure = _deviations(loop, n, s, log, params)
        if sure is None or not all(v in by_rail or v in params or v in log for v in names.values()):
            continue
        values = {
            k: by_rail[v] if v in by_rail else log[v] if v in log else params[v]
            for k, v in names.items()
        }
        found = [_span(loop, n, s, k, values, log, sure, tick) for k in range(len(s.truth))]
        length, off = max(found, key=lambda f: f[0])
        if length * tick > LONG:
            yield off


def _span(
    loop: Block, n: str, s: Signal, k: int, values: Values, log: Values, sure: np.ndarray,
    tick: float,
) -> tuple[int, EstimateOff]:  # fmt: skip
    """Rows for which one element of an estimate is too far off at a stretch, and what to say."""
    text, time = s.truth[k], log["time"]
    truth = np.asarray(evaluate(text, values, n), dtype=float)
    one = np.asarray(log[n], dtype=float)
    bare = not loop.states[n].shape or one.ndim == 1
    if not bare and (len(s.truth) > 1 or one.shape[1] == 1):
        one, sure = one[:, k], sure[:, k]
    one, truth, sure = np.broadcast_arrays(*map(columns, (one, truth, sure)))
    beyond = (np.abs(one - truth) > AWAY * sure) & (sure > 0)
    spans = [longest_span(column) for column in beyond.T]
    axle = int(np.argmax([b - a for a, b in spans]))
    a, b = spans[axle]
    what = n if len(s.truth) == 1 and text.isidentifier() else f"{n} for {text}"
    number = axle_of_column(worked_axles(loop), axle, len(spans)) if len(spans) > 1 else 0
    where = f" of axle {number}" if number else ""
    unit = "" if s.unit == "1" else f" {s.unit}"
    last = max(b - 1, 0)
    numbers = (
        f"{what}{where} errs by more than {AWAY:g} of its own standard deviations from"
        f" {time[a]:.4g} s to {time[last]:.4g} s: at the end {one[last, axle]:.4g}{unit} for a true"
        f" {truth[last, axle]:.4g}{unit}, with a deviation of {sure[last, axle]:.2g}{unit}"
    )
    return b - a, EstimateOff(
        _estimated(loop, s, text, n), number, float(time[a]),
        float(time[last]), b == len(time), numbers,
    )  # fmt: skip


def _estimated(loop: Block, s: Signal, text: str, name: str) -> str:
    """What is estimated, in words."""
    if len(s.truth) > 1 or not text.isidentifier():
        return "adhesion curve"  # coordinates of a law that is fitted
    own = {n.rpartition(".")[0] for n in loop.states if loop.states[n].truth}
    truth = meant_signals(loop, s, text, own)[text]
    signal = (loop.outputs.get(truth) or loop.declared(truth)) if truth else None
    doc = signal.doc.partition(",")[0].rpartition(": ")[2] if signal else ""
    return doc or text


def _deviations(
    loop: Block, n: str, s: Signal, log: Values, params: Mapping[str, Any]
) -> np.ndarray | None:
    """Deviation of an estimate in every row; None where it tells that of its start alone.

    It is what the estimate says itself, where that is of states, else the root of the diagonal of
    the covariance ``P`` beside it.
    """
    names = {k: loop._sibling(n, k) for k in names_in(s.deviation)}
    if any(v in loop.states for v in names.values()):
        if not all(v in log or v in params for v in names.values()):
            return None
        values = {k: log[v] if v in log else params[v] for k, v in names.items()}
        return np.asarray(evaluate(s.deviation, values, n), dtype=float)
    beside, many = loop._sibling(n, "P"), len(s.truth)
    if beside not in log:
        return None
    P = np.asarray(log[beside], dtype=float)
    if P.ndim != 3 or P.shape[1] != many or P.shape[2] % many:
        return None
    copies = P.reshape(len(P), many, P.shape[2] // many, many)  # beside each other, one each axle
    roots = np.sqrt(np.maximum(np.einsum("ticj->tijc", copies)[:, range(many), range(many)], 0))
    return roots if np.ndim(log[n]) == 3 else roots[:, :, 0]


def _along(loop: Block, scenario: Scenario, log: Values) -> dict[str, np.ndarray]:
    """What the rail sets, in every row, a column per axle where it is set for each."""
    inputs, params = rail_values(loop, scenario)
    rail = scenario.rail
    if rail is None or not (inputs or params):
        return {}
    at = np.asarray(log["time"])[:, None]
    if rail.by != "time":
        name = loop.find("x" if rail.by == "position" else rail.by, "state")
        if name not in log:
            return {}
        behind = loop.param_values().get(loop._sibling(name, "behind"), 0.0)
        at = np.asarray(log[name])[:, None] - np.reshape(behind, (1, -1))
    section = np.maximum(np.searchsorted(rail.starts, at + 1e-9, side="right") - 1, 0)
    return {n: np.asarray(v, dtype=float)[section] for n, v in {**inputs, **params}.items()
            if np.ndim(v) == 1}  # fmt: skip


# ---- limits --------------------------------------------------------------------------------------


def _limits(loop: Block) -> Iterator[tuple[str, dict[str, str]]]:
    """Outputs whose range follows one parameter, and where each end of it stands, by its text.

    What a part hands to another one, and what that one has inside: a command and its actuator.
    What goes on inside a controller is of no concern, as another limit, or the demand, may rule.
    """
    found: dict[str, dict[str, str]] = {}
    for n, s in loop.outputs.items():
        ends = {b.expression: loop._sibling(b.home or n, b.expression.removeprefix("-"))
                for b in s.bounds if b.what in ("lo", "hi")}  # fmt: skip
        ends = {text: place for text, place in ends.items() if place in loop.params}
        if ends:
            found[n] = ends
    handed = {t.partition(".")[0]: s for t, s in loop.wires.items() if s in found}
    for n, ends in found.items():
        if n in handed.values() or n.partition(".")[0] in handed:
            yield n, ends


def _limited(loop: Block, log: Values) -> Iterator[str]:
    params = loop.param_values()
    for n, ends in _limits(loop):
        if n not in log:
            continue
        values = columns(log[n])
        active, limit = np.zeros(values.shape, dtype=bool), ""
        for text, place in ends.items():
            end = np.asarray(params[place], dtype=float) * (-1 if text[0] == "-" else 1)
            if (end != 0).all():  # at 0 nothing is asked for
                active |= np.isclose(values, end, rtol=1e-9, atol=0)
                limit = place
        share = active.mean(axis=0)
        axle = int(np.argmax(share))
        if share[axle] > MOST:
            many = len(share)
            where = f" of axle {axle_of_column(worked_axles(loop), axle, many)}" if many > 1 else ""
            size = f"{float(np.max(params[limit])):.4g} {loop.params[limit].unit}"
            yield f"{n}{where} is at its limit, {size}, for {100 * share[axle]:.0f} % of the run"


# ---- what a run does not come to -----------------------------------------------------------------


def _unreached(loop: Block, scenario: Scenario, log: Values) -> Iterator[str]:
    """Sections of the rail that begin beyond the run, and an end that it has not come to."""
    time = np.asarray(log["time"])
    rail, end = scenario.rail, scenario.end
    if not time.size:
        return
    if rail is not None and rail.by != "time":
        name = loop.find("x" if rail.by == "position" else rail.by, "state")
        far = float(np.max(log[name])) if name in log else np.inf
        late = [s for s in rail.starts if s > far]
        if late:
            yield (
                f"{len(late)} of {len(rail.starts)} sections of the rail begin at {late[0]:g} m or"
                f" beyond; the run ends at {far:.4g} m"
            )
    yield from _demands_beyond(loop, log)
    if end is None or end.signal not in log or end.above is None:
        return
    if not end.there(np.asarray(log[end.signal]).reshape(len(time), -1)).any():
        yield (
            f"{end.signal} never reaches {end.above:g}, where the run was to end; it ends after its"
            f" duration, {scenario.duration:g} s"
        )


def _demands_beyond(loop: Block, log: Values) -> Iterator[str]:
    """Points of a demand over the position that the run does not come to."""
    over = [path for path, part in loop.leaves() if part.choices.get("over") == "position"]
    for path in over:
        at = np.atleast_1d(loop.param_values()[f"{path}.at"])
        far = float(np.max(log["plant.train.x"])) if "plant.train.x" in log else np.inf
        if (at > far).any():
            yield (f"the {path} changes at {at[at > far][0]:g} m, and the run ends at {far:.4g} m")


# ---- ranges and energy ---------------------------------------------------------------------------


def _ranged(loop: Block) -> Iterator[tuple[str, Signal]]:
    """States and residuals with a range of their own, which follows no parameter."""
    residuals = {n: s for n, s in loop.outputs.items() if n.rpartition(".")[2] == "residual"}
    for n, s in {**loop.states, **residuals}.items():
        if np.isfinite([s.lo, s.hi]).any() and not any(b.what in ("lo", "hi") for b in s.bounds):
            yield n, s


def _off_range(loop: Block, log: Values) -> Iterator[str]:
    for n, s in _ranged(loop):
        if n not in log:
            continue
        values = np.asarray(log[n], dtype=float).reshape(len(log["time"]), -1)
        near = ROUNDED * max(abs(e) for e in (s.lo, s.hi) if np.isfinite(e))
        off = ((values < s.lo - near) | (values > s.hi + near)).any(axis=1)
        if off.any():
            k = int(np.argmax(off))
            far = values[np.unravel_index(np.argmax(np.maximum(s.lo - values, values - s.hi)),
                                          values.shape)]  # fmt: skip
            unit = "" if s.unit == "1" else f" {s.unit}"
            yield (
                f"{n} leaves its range, {s.lo:g} .. {s.hi:g}{unit}, at {log['time'][k]:.4g} s, and"
                f" comes to {far:.4g}{unit}: the model is not valid there"
            )


def _taking(loop: Block) -> Iterator[tuple[str, Signal]]:
    """Powers that take energy and give none: their range begins at 0."""
    for n, s in loop.outputs.items():
        if s.unit == "W" and s.lo == 0:
            yield n, s


def _giving(loop: Block, log: Values) -> Iterator[str]:
    time = np.asarray(log["time"])
    for n, _ in _taking(loop):
        if n not in log or time.size < 2:
            continue
        power = np.asarray(log[n], dtype=float).reshape(len(time), -1)
        energy = np.cumsum(power, axis=0) * (time[1] - time[0])
        given = np.max(np.maximum.accumulate(energy, axis=0) - energy)
        moved = np.sum(np.abs(power)) * (time[1] - time[0])
        if given > GIVEN * moved + 1.0:
            yield (
                f"{n} should take energy and delivers {given:.4g} J in this run; check the signs,"
                " and whether its law acts against the motion"
            )


# ---- before a run --------------------------------------------------------------------------------


def _quantised(loop: Block) -> Iterator[str]:
    values = loop.param_values()
    for n, s in loop.params.items():
        if n.rpartition(".")[2] != "q" or (beside := loop._sibling(n, "sigma")) not in values:
            continue
        step, noise = float(np.max(values[n])), float(np.max(values[beside]))
        if 0 < noise < step / 12**0.5 and loop.params[beside].unit == s.unit:
            yield (
                f"{beside} = {noise:.3g} {s.unit} is below the {step / 12**0.5:.3g} {s.unit} of the"
                f" quantisation, standard deviation of steps of {step:.3g} {s.unit}: the measured"
                " value stands still and jumps"
            )


def _unfed(loop: Block, scenario: Scenario) -> Iterator[str]:
    fed = {loop.find(k, "input") for k in scenario.inputs} | set(rail_values(loop, scenario)[0])
    made = {**loop.outputs, **loop.states}
    for n, s in loop.inputs.items():
        if s.value is None or s.noise or n in fed or "." not in n:
            continue
        home, _, last = n.rpartition(".")
        hits = [k for k, g in made.items() if k.rpartition(".")[2] == last and g.unit == s.unit
                and k.rpartition(".")[0] != home and g.positive == s.positive]  # fmt: skip
        if hits:
            yield f"no wire feeds {n}, so it keeps {s.value} {s.unit}; wire it to {hits[0]}?"
