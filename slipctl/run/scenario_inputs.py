"""What a scenario gives a loop: its start and parameters, its inputs tick by tick, its rail."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.connection import parts_inlined
from slipctl.block.functions import symbol_maker
from slipctl.block.shared_numbers import targets
from slipctl.block.signals import Signal, real_array, total_size
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.block.transforms.replication import with_derived
from slipctl.errors import BadInput, nearest
from slipctl.run.build import pack_numbers
from slipctl.run.rail import Feed, Rail, Scenario


def stream(seed: int, path: str) -> np.random.Generator:
    """Random stream of one noise source, keyed by seed and signal path."""
    digest = hashlib.sha256(path.encode()).digest()
    words = [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))


def loop_at_start(loop: Block, scenario: Scenario) -> Block:
    """Loop with the parameters and the start of a scenario; what follows the start does so.

    Raises:
        BadInput: an unknown name, a value off range.
    """
    values = given_by(loop, scenario)
    return loop.with_params(**values) if values else loop


def given_by(loop: Block, scenario: Scenario) -> dict[str, Any]:
    """Parameters and start values that a scenario sets, by their names in the loop.

    Raises:
        BadInput: an unknown name.
    """
    values: dict[str, Any] = {}
    for given, role in ((scenario.params, "param"), (scenario.start, "state")):
        for key, value in given.items():
            meant = targets(loop, key, (role,))
            if not meant:
                loop.find(key, role)  # says what there is
            values |= dict.fromkeys(meant, value)
    return values


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


def first_tick(start: Any, h: float) -> np.ndarray:
    """First tick at or after a time; a time within a millionth of a tick is on it."""
    return np.ceil(np.asarray(start, dtype=float) / h - 1e-6).astype(int)


def feeds(
    loop: Block, scenario: Scenario, ticks: int, h: float, rail: Mapping[str, list[float]]
) -> np.ndarray:
    """Input array, ticks by input elements."""
    given = {loop.find(k, "input"): v for k, v in scenario.inputs.items()}
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


def _spread(
    where: str, values: np.ndarray, wanted: tuple[int, ...], each: tuple[int, ...] = ()
) -> np.ndarray:
    """Values in a shape, repeated where that is longer."""
    try:
        return np.broadcast_to(values, wanted)
    except ValueError:
        a_tick = f" or, for all ticks, {each}" if each else ""
        raise BadInput(
            f"{where}: its feed gives an array {values.shape}, wanted is {wanted}{a_tick}"
        ) from None


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
            at = np.searchsorted(first_tick(starts, h), np.arange(ticks), side="right") - 1
            steps = [_spread(where, real_array(v), s.shape) for _, v in feed]
            values = np.array(steps)[np.maximum(at, 0)]
        else:
            values = _spread(where, real_array(feed), wanted, s.shape)
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


def pieces(
    loop: Block, scenario: Scenario, ticks: int, h: float, rail: Mapping[str, list[float]],
    values: Mapping[str, np.ndarray] | None = None,
) -> tuple[ca.Function, list[tuple[int, int, np.ndarray]]]:  # fmt: skip
    """Function to roll, and (first tick, last tick, parameter vector) of each piece.

    Args:
        loop, scenario: what runs.
        ticks, h: how many there are, and their length in s.
        rail: parameters that the rail sets, a value for each section.
        values: ``loop.param_values()``, where they are known already.
    """
    known = loop.param_values() if values is None else values
    follow = [n for n in with_derived(loop, rail) if loop.params[n].derived]

    def vector(**values: float) -> np.ndarray:
        given = {n: loop.params[n].check(f"{loop.name}.{n}", v) for n, v in values.items()}
        return pack_numbers(loop, "param", complete_params(loop, {**known, **given}, follow))

    if scenario.rail is None or (not rail and scenario.rail.by == "time"):
        return loop.f, [(0, ticks, vector())]
    if scenario.rail.by != "time":
        f, table = _by_position(loop, scenario)
        return f, [(0, ticks, np.concatenate([vector(), table]))]
    starts = [*first_tick(scenario.rail.starts, h).tolist(), ticks]
    pieces = []
    for k in range(len(starts) - 1):
        first, last = starts[k], min(starts[k + 1], ticks)
        if first < last:
            pieces.append((first, last, vector(**{n: v[k] for n, v in rail.items()})))
    return loop.f, pieces


def complete_params(loop: Block, values: dict[str, Any], follow: Sequence[str]) -> dict[str, Any]:
    """Parameters with those made again that follow others, each after what it follows itself."""
    waiting = deque(follow)
    while waiting:
        n = waiting.popleft()
        names = {k: loop._sibling(n, k) for k in names_in(loop.params[n].value)}
        if set(names.values()) & set(waiting):
            waiting.append(n)
            continue
        local = {k: values[full] for k, full in names.items()}
        found = evaluate(loop.params[n].value, local, f"{loop.name}.{n}")
        values[n] = loop.params[n].check(f"{loop.name}.{n}", found)
    return values


def _by_position(loop: Block, scenario: Scenario) -> tuple[ca.Function, np.ndarray]:
    """Loop whose rail values are looked up at the vehicle's position; the table is a parameter.

    A parameter ``behind`` beside the position says how far each of several places, of axles say,
    lies behind it. A value for each of as many copies is looked up at each of them.
    """
    rail: Rail = scenario.rail  # type: ignore[assignment]
    name = loop.find("x" if rail.by == "position" else rail.by, "state")
    inputs, params = rail_values(loop, scenario)
    varying = {**inputs, **params}
    n, derived = (
        len(rail.sections),
        tuple((s.name, s.value) for s in loop.params.values() if s.derived),
    )
    f = loop.of_equations(
        ("rail", name, n, tuple(varying), derived), lambda: _looked_up(loop, name, n, list(varying))
    )
    return f, np.concatenate([rail.starts, *(np.asarray(v, dtype=float) for v in varying.values())])


def _looked_up(loop: Block, name: str, n: int, varying: Sequence[str]) -> ca.Function:
    """Loop with a table of n rows below its parameters: starts, and values of what varies."""
    sym = symbol_maker(loop.sx)
    places = loop._sibling(name, "behind")
    x, u, p = (
        sym(letter, total_size(signals.values()))
        for letter, signals in zip("xup", (loop.states, loop.inputs, loop.params), strict=True)
    )
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
    u_dict = loop.unpack("input", u) | {k: v for k, v in values.items() if k in loop.inputs}
    p_dict = loop.unpack("param", p) | {k: v for k, v in values.items() if k in loop.params}
    free = {k: v for k, v in p_dict.items() if not loop.params[k].derived}
    with parts_inlined():
        then, y = loop.expr(loop.unpack("state", x), u_dict, loop.derive(free))
    packed = [loop.pack("state", then), loop.pack("output", y)]
    return ca.Function(f"{loop._c_name()}_rail", [x, u, ca.vertcat(p, table)], packed,
                       ["x", "u", "p"], ["n", "y"], {"cse": True})  # fmt: skip
