"""Simulate a loop in a scenario: one Function for the whole loop, rolled over time."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, as_block, symbol_maker
from slipctl.block.sharing import targets
from slipctl.block.signals import Signal, real_array, total_size
from slipctl.errors import BadInput, RunFailed, check_whole, nearest
from slipctl.run import build
from slipctl.run.rail import Feed, Rail, Scenario

if TYPE_CHECKING:
    import xarray

CHUNKS = 40
"""Pieces a run is cut into, for progress and for stopping it."""

LARGEST = 2**36
"""Most bytes that a run may ask for, its inputs and the rows of its log."""

SCRATCH = 20_000
"""Most ticks that are held in memory at a time where only some rows are kept."""


def simulate(
    loop: Block,
    scenario: Scenario,
    *,
    compile: bool = True,
    progress: Callable[[float], None] | None = None,
    log: Iterable[str] | None = None,
    every: int = 1,
) -> xarray.Dataset:
    """Run ``loop`` in ``scenario``.

    Args:
        loop: a step block with a period; every input must be fed by a wire, the scenario, noise
            or its own default value.
        scenario: what happens.
        compile: compile the loop when a C compiler is there; the numbers are the same.
        progress: called with the share done, 0 to 1.
        log: names to keep; by default every number, and every number per axle, that is no held
            copy.
        every: ticks from one row of the log to the next; 1 keeps each.

    Returns:
        Dataset with dimension ``time`` [s], and ``axle`` or another of ``replicate`` where there
        are copies, and one variable per signal (``"plant.v"``), attributes
        ``units``, ``long_name``, ``positive``; the tick's start value for states. Its attributes
        hold version, scenario, seed and parameters with units.

    Raises:
        BadInput: unfed inputs, unknown names, a rail condition that the loop does not know, every
            not a whole number.
        RunFailed: a state became NaN or infinite; says block, signal and time.
    """
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
    loop = begun(loop, scenario)
    rail_inputs, rail_params = rail_values(loop, scenario)
    u = _feed(loop, scenario, ticks, h, rail_inputs)
    f, pieces = _pieces(loop, scenario, ticks, h, rail_params)

    x = np.array(ca.DM(loop.pack("state", loop.start())).full()).ravel()
    rows = np.arange(0, ticks, int(every))
    x_log, y_log = np.empty((rows.size, x.size)), np.empty((rows.size, f.size1_out(1)))
    roll = build.rolling(f, compile, ticks)
    for first, last, p in pieces:
        size = max((last - first + CHUNKS - 1) // CHUNKS, 1) if progress else last - first
        size = min(size, SCRATCH) if every > 1 else size
        for k in range(first, last, size):
            stop = min(k + size, last)
            kept = slice(*np.searchsorted(rows, (k, stop)))
            uk = np.ascontiguousarray(u[k:stop])
            whole = every == 1
            x_now = x_log[kept] if whole else np.empty((stop - k, x.size))
            y_now = y_log[kept] if whole else np.empty((stop - k, y_log.shape[1]))
            n = roll(x, uk, p, x_now, y_now)
            if n < stop - k:
                raise RunFailed(_broken(loop, x, (k + n + 1) * h))
            if not whole:
                x_log[kept], y_log[kept] = x_now[rows[kept] - k], y_now[rows[kept] - k]
            if progress:
                progress(stop / ticks)
    data = _dataset(loop, scenario, rows * h, x_log, u[rows], y_log, log)
    return data.assign_attrs(period_s=h * int(every)) if every > 1 else data


def stream(seed: int, path: str) -> np.random.Generator:
    """Random stream of one noise source, keyed by seed and signal path."""
    digest = hashlib.sha256(path.encode()).digest()
    words = [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))


def begun(loop: Block, scenario: Scenario) -> Block:
    """Loop with the parameters and the start of a scenario; what follows the start does so.

    Raises:
        BadInput: an unknown name, a value off range.
    """
    values: dict[str, Any] = {}
    for given, roles in ((scenario.params, ("param",)), (scenario.start, ("state",))):
        for key, value in given.items():
            meant = targets(loop, key, roles)
            if not meant:
                _find(loop, *roles, key)  # says what there is
            values |= dict.fromkeys(meant, value)
    return loop.with_params(**values) if values else loop


def _find(loop: Block, role: str, name: str) -> str:
    """Full name of a signal given by its full name or its unique last part."""
    return loop.find(name, role)


def rail_values(
    loop: Block, scenario: Scenario
) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Values per section of the inputs and of the parameters that the rail sets."""
    if scenario.rail is None:
        return {}, {}
    rows: list[dict[str, float]] = []
    for s in scenario.rail.sections:
        row: dict[str, float] = {}
        if s.condition is not None:
            if s.condition not in loop.conditions and not loop.conditions:
                named = list(dict.fromkeys(str(x.condition) for x in scenario.rail.sections))
                if len(named) > 1:
                    raise BadInput(
                        f"{loop.name} knows no rail condition {named[0]!r}: the rail names"
                        f" {', '.join(named)}, the adhesion law has one set of numbers; name them,"
                        f" law.with_conditions({named[0]}={{...}},"
                        f" {named[1]}={{...}}) or @law(..., conditions=...)"
                    )
            elif s.condition not in loop.conditions:
                raise BadInput(
                    f"{loop.name} knows no rail condition {s.condition!r}"
                    f"{nearest(s.condition, loop.conditions)}; an adhesion law declares its own:"
                    f" @law(..., conditions={{{s.condition!r}: {{...}}}})"
                )
            row |= loop.conditions.get(s.condition, {})
        for name, value in s.values.items():
            hits = targets(loop, name, ("input", "param"))
            if len(hits) != 1:
                known = {**loop.inputs, **loop.params}
                why = (
                    "could be " + " or ".join(hits) if hits else "is unknown" + nearest(name, known)
                )
                raise BadInput(f"scenario {scenario.name}: rail value {name!r} {why}")
            row[hits[0]] = value
        rows.append(row)
    names = dict.fromkeys(n for row in rows for n in row)
    inputs: dict[str, list[float]] = {}
    params: dict[str, list[float]] = {}
    for n in names:
        signal = loop.inputs.get(n) or loop._settable(n)
        values = [row.get(n, signal.value) for row in rows]
        for v in values:
            if v is None:
                raise BadInput(f"scenario {scenario.name}: every rail section must set {n!r}")
            signal.check(f"{loop.name}.{n}", v)
        (inputs if n in loop.inputs else params)[n] = values
    return inputs, params


def _first_tick(start: Any, h: float) -> np.ndarray:
    """First tick at or after a time; a time within a millionth of a tick is on it."""
    return np.ceil(np.asarray(start, dtype=float) / h - 1e-6).astype(int)


def _feed(
    loop: Block, scenario: Scenario, ticks: int, h: float, rail: Mapping[str, list[float]]
) -> np.ndarray:
    """Input array, ticks by input elements."""
    given = {_find(loop, "input", k): v for k, v in scenario.inputs.items()}
    for n in rail:
        if n in given:
            raise BadInput(
                f"scenario {scenario.name}: both the rail and inputs= give {n!r}; give it once"
            )
    columns = []
    for n, s in loop.inputs.items():
        where = f"{loop.name}.{n}"
        if n in rail and scenario.rail is not None:
            by_time = scenario.rail.by == "time"
            feed = list(zip(scenario.rail.starts, rail[n], strict=True)) if by_time else rail[n][0]
            columns.append(_values(where, s, feed, ticks, h))
        elif n in given:
            columns.append(_values(where, s, given[n], ticks, h))
        elif s.noise:
            noise = stream(scenario.seed, n).standard_normal((ticks, s.size))
            columns.append(scenario.noise * noise)
        elif s.value is not None:
            columns.append(_values(where, s, s.check(where, s.value), ticks, h))
        else:
            raise BadInput(
                f"{where} [{s.unit}] is not fed: wire it in connect(...), or give it in"
                f" Scenario(inputs={{{n!r}: ...}})"
            )
    return np.ascontiguousarray(np.hstack(columns)) if columns else np.zeros((ticks, 0))


def _asked(where: str, feed: Any, times: np.ndarray) -> Any:
    """What a feed function gives; what breaks in it is told as its own."""
    try:
        return feed(times)
    except Exception as error:
        raise BadInput(
            f"{where}: its feed function fails on {times.size} times:"
            f" {type(error).__name__}: {error}"
        ) from error


def _values(where: str, s: Signal, feed: Feed | np.ndarray, ticks: int, h: float) -> np.ndarray:
    """Values of one input over all ticks, in range and element by element as the loop packs it."""
    wanted = (ticks, *s.shape)
    try:
        if callable(feed):
            values = real_array(_asked(where, feed, np.arange(ticks) * h))
            values = np.broadcast_to(values, wanted) if values.ndim == 0 else values
        elif isinstance(feed, (list, tuple)):
            starts = real_array([t for t, _ in feed])
            if not starts.size or not np.isfinite(starts).all() or (np.diff(starts) <= 0).any():
                raise BadInput(f"{where}: its feed needs steps (time, value) in order of time")
            if starts[0] > 0:
                raise BadInput(
                    f"{where}: its feed starts at {starts[0]:g} s; say what it is from 0 s on"
                )
            at = np.searchsorted(_first_tick(starts, h), np.arange(ticks), side="right") - 1
            steps = [np.broadcast_to(real_array(v), s.shape) for _, v in feed]
            values = np.array(steps)[np.maximum(at, 0)]
        else:
            values = np.broadcast_to(real_array(feed), wanted)
    except BadInput:
        raise
    except (TypeError, ValueError) as error:
        raise BadInput(f"{where}: its feed is no number, steps or function: {error}") from None
    if values.shape != wanted:
        raise BadInput(f"{where}: its feed gives an array {values.shape}, wanted is {wanted}")
    if not np.isfinite(values).all():
        raise BadInput(f"{where}: its feed has NaN or infinite values")
    for extreme in (values.min(), values.max()):
        replace(s, shape=(), value=None).check(where, extreme)
    if len(s.shape) == 2:  # a matrix is packed column by column
        values = values.transpose(0, 2, 1)
    return values.reshape(ticks, -1)


def _pieces(
    loop: Block, scenario: Scenario, ticks: int, h: float, rail: Mapping[str, list[float]]
) -> tuple[ca.Function, list[tuple[int, int, np.ndarray]]]:
    """Function to roll, and (first tick, last tick, parameter vector) of each piece."""

    def vector(**values: float) -> np.ndarray:
        p = loop.pack("param", loop.param_values(**values))
        return np.ascontiguousarray(np.array(ca.DM(p).full()).ravel())

    if scenario.rail is None or (not rail and scenario.rail.by == "time"):
        return loop.f, [(0, ticks, vector())]
    if scenario.rail.by != "time":
        f, table = _by_position(loop, scenario)
        return f, [(0, ticks, np.concatenate([vector(), table]))]
    starts = [*_first_tick(scenario.rail.starts, h).tolist(), ticks]
    pieces = []
    for k in range(len(starts) - 1):
        first, last = starts[k], min(starts[k + 1], ticks)
        if first < last:
            pieces.append((first, last, vector(**{n: v[k] for n, v in rail.items()})))
    return loop.f, pieces


def _by_position(loop: Block, scenario: Scenario) -> tuple[ca.Function, np.ndarray]:
    """Loop whose rail values are looked up at the vehicle's position; the table is a parameter.

    A parameter ``behind`` beside the position says how far each of several places, of axles say,
    lies behind it; a value for each of as many copies is looked up at each of them.
    """
    rail: Rail = scenario.rail  # type: ignore[assignment]
    name = _find(loop, "state", "x" if rail.by == "position" else rail.by)
    inputs, params = rail_values(loop, scenario)
    varying = {**inputs, **params}
    sym = symbol_maker(loop.sx)
    n, places = len(rail.sections), loop._sibling(name, "behind")
    x, u, p = (sym("xup"[i], loop.f.size1_in(i)) for i in range(3))
    table = sym("table", n * (1 + len(varying)))
    position = loop.unpack("state", x)[name]
    values: dict[str, Any] = {}
    behind = loop.unpack("param", p)[places] if places in loop.params else 0.0
    for row, key in enumerate(varying, start=1):
        shape = (loop.inputs.get(key) or loop.params[key]).shape
        each = shape and places in loop.params and shape == loop.params[places].shape
        at = position - behind if each else position
        value = table[row * n]
        for k in range(1, n):
            value = ca.if_else(at >= table[k], table[row * n + k], value)
        values[key] = value
    u_dict = loop.unpack("input", u) | {k: v for k, v in values.items() if k in inputs}
    p_dict = loop.unpack("param", p) | {k: v for k, v in values.items() if k in params}
    free = {k: v for k, v in p_dict.items() if not loop.params[k].derived}
    n_, y = loop.f(x, loop.pack("input", u_dict), loop.pack("param", loop.derive(free)))
    f = ca.Function(f"{loop.f.name()}_rail", [x, u, ca.vertcat(p, table)], [n_, y],
                    ["x", "u", "p"], ["n", "y"], {"cse": True})  # fmt: skip
    return f, np.concatenate([rail.starts, *(np.asarray(v, dtype=float) for v in varying.values())])


def _broken(loop: Block, x: np.ndarray, when: float) -> str:
    at = 0
    for n, s in loop.states.items():
        values = x[at : at + s.size]
        at += s.size
        if not np.isfinite(values).all():
            bad = values[~np.isfinite(values)][0]
            return f"{loop.name}: {n} [{s.unit}] became {bad} at t = {when:.6g} s"
    return f"{loop.name}: a state became NaN before t = {when:.6g} s"


def _dataset(
    loop: Block,
    scenario: Scenario,
    time: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    y: np.ndarray,
    log: Iterable[str] | None,
) -> xarray.Dataset:
    import xarray

    from slipctl import __version__

    wanted = None if log is None else set(log)
    known = {s.name for s in loop.signals if s.role != "param"}
    for n in wanted or ():
        if n not in known:
            raise BadInput(f"{loop.name} has no signal {n!r} to log{nearest(n, known)}")
    variables: dict[str, Any] = {}
    sizes: dict[str, int] = {}
    for role, values in (("input", u), ("output", y), ("state", x)):
        at = 0
        for n, s in loop._signals[role].items():
            columns = values[:, at : at + s.size]
            at += s.size
            last = n.rpartition(".")[2]
            shown = s.shape == () or (s.axis != "" and len(s.shape) == 1)
            keep = shown and not last.startswith("held_") and last != "tick"
            if not (keep if wanted is None else n in wanted):
                continue
            if role != "output" and n in loop.outputs:
                continue  # a wire from this name carries the output too
            attributes = {"units": s.unit, "long_name": s.doc or n}
            if s.positive:
                attributes["positive"] = s.positive
            dims = ["time", *(f"{n}.{i}" for i in range(len(s.shape)))]
            if s.axis and sizes.setdefault(s.axis, s.shape[-1]) == s.shape[-1]:
                dims[-1] = s.axis
            data = columns.reshape(len(time), *s.shape, order="F" if len(s.shape) < 2 else "C")
            if len(s.shape) == 2:  # stored column by column
                data = columns.reshape(len(time), s.shape[1], s.shape[0]).transpose(0, 2, 1)
            variables[n] = (dims, np.ascontiguousarray(data), attributes)
    parameters = {
        n: {"value": np.asarray(v).tolist(), "unit": loop.params[n].unit}
        for n, v in loop.param_values().items()
    }
    provenance: dict[str, Any] = {
        "format": 1,
        "slipctl_version": __version__,
        "loop": loop.name,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "noise": scenario.noise,
        "period_s": loop.period,
        "rail_changes_s": scenario.changes,
        "parameters": json.dumps(parameters),
    }
    coordinate = ("time", time, {"units": "s", "long_name": "time"})
    return xarray.Dataset(variables, coords={"time": coordinate}, attrs=provenance)
