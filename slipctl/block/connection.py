"""Connecting blocks by name; units, conventions, missing wires and algebraic loops are checked."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import casadi as ca

from slipctl.block.block import Block, Exprs, as_block
from slipctl.block.call_order import Call, End, calls_of_parts, dependence_of_parts
from slipctl.block.fields import Composition
from slipctl.block.functions import symbol_maker
from slipctl.block.shared_numbers import Share, Sharing, numbers_of, parts_with_shares, read_shares
from slipctl.block.shared_places import bind
from slipctl.block.signals import Signal
from slipctl.block.units import unit_algebra
from slipctl.errors import BadInput, check_known, nearest

WIRE_END = re.compile(r"[A-Za-z][\w.]*")


def connect(
    name: str, wires: Mapping[str, str], *, share: Mapping[str, Any] | None = None, **blocks: Block
) -> Block:
    """Connect blocks to one block.

    Args:
        name: name of the new block.
        wires: source by destination: ``{"car.T_b": "ctl.T_b"}``. A source without a dot is an
            input of the new block (``{"car.mu": "mu", "est.mu": "mu"}``), a destination without
            one is an output of it (``{"T_b": "ctl.T_b"}``). A state may be a source too.
        share: places of each number that several parts have, by the number's name:
            ``{"m": ["car.m", "ctl.m"], "J": "*.J"}``. The first place declares it, the others take
            its number; a pattern means every part that has the name, now or after ``swap``. A
            state among the places begins with the number, and when it is the first, its start
            value is the shared number. ``"J_w = J * R_g**2"`` is computed from others.
        **blocks: the parts. Flows go with flows and laws, steps with steps and laws.

    Returns:
        A block with the signals of its parts, named ``part.signal``; inputs fed by no wire stay
        inputs.

    Raises:
        BadInput: unknown signal, wrong unit, sign or slip convention, parts of different kind or
            period, an algebraic loop (told by its path). A shared place that no part has, or that
            has another unit or range.
    """
    _check_given(name, wires, blocks)
    wires = dict(wires)
    kind, period = _common_kind(name, blocks)
    given = read_shares(name, share)
    shares = bind(name, blocks, given)
    for key in sorted(set(shares) & set(blocks)):
        raise BadInput(f"{name}: {key!r} is a part and a shared number; rename one")
    blocks = parts_with_shares(blocks, shares, numbers_of(name, shares))
    sharing = Sharing.of(blocks, shares)
    wiring = _Wiring.of(name, blocks, wires)
    signals = _signals_of_parts(blocks, wiring, shares)
    inner, free, outer_outputs = wiring.inner, wiring.free, wiring.outputs
    plan = calls_of_parts(name, blocks, inner)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        results: dict[End, Any] = {
            (b, n): x[f"{b}.{n}"]
            for b, block in blocks.items()
            for n in block.states
            if n not in block.outputs
        }
        nxt: Exprs = {}
        for b, outputs, last in plan:
            block = blocks[b]
            args = [
                block.pack("state", {n: x[f"{b}.{n}"] for n in block.states}),
                block.pack("input", _inputs(b, block, wiring, results, u)),
                block.pack("param", {n: p[sharing.name(f"{b}.{n}")] for n in block.params}),
            ]
            n, y = _evaluated(block, args, outputs, last)
            if last:
                nxt |= {f"{b}.{k}": v for k, v in block.unpack("state", n).items()}
                values = block.unpack("output", y)
            else:
                values = block.unpack("output", y, outputs)
            results |= {(b, k): values[k] for k in outputs}
        y_all = {f"{b}.{k}": results[b, k] for b, block in blocks.items() for k in block.outputs}
        y_all |= {out: results[source] for out, source in outer_outputs.items()}
        return nxt, y_all

    def rebuild(parts: dict[str, Block], changed: Mapping[str, Share] | None = None) -> Block:
        return connect(name, wires, share=given if changed is None else changed, **parts)

    uses = partial(dependence_of_parts, blocks, plan, inner, free, signals, outer_outputs.values())
    made_of = Composition(dict(blocks), rebuild, dict(wires), prefixed=True, sharing=sharing,
                          by_structure=True, dependence=uses)  # fmt: skip
    return Block(
        name, kind, body, signals, period=period, doc=f"Connection of {', '.join(blocks)}.",
        sx=all(block.sx for block in blocks.values()),
        conditions=_conditions(blocks, sharing), composition=made_of,
    )  # fmt: skip


def _check_given(name: str, wires: Mapping[str, str], blocks: Mapping[str, Block]) -> None:
    """Refuse what is no wiring, and parts that are none."""
    if not blocks:
        raise BadInput(f"connect({name!r}) needs at least one block")
    texts = isinstance(wires, Mapping) and [*wires, *wires.values()]
    if texts is False or not all(isinstance(end, str) for end in texts):
        raise BadInput(f"{name}: wires name a source by destination, {{'car.T_b': 'ctl.T_b'}}")
    for b, block in blocks.items():
        as_block(f"{name}: {b}", block)
        if not re.fullmatch(r"\w+", b):
            raise BadInput(f"{name}: {b!r} is no name of a part; write letters, digits, _")


class _Wiring(NamedTuple):
    """Where each wire of a connection begins, as (part, signal)."""

    inner: dict[End, End]
    """Source of an input that another part feeds."""
    free: dict[End, str]
    """Input of the connection that feeds each other input."""
    inputs: dict[str, Signal]
    outputs: dict[str, End]

    @classmethod
    def of(cls, name: str, blocks: Mapping[str, Block], wires: Mapping[str, str]) -> _Wiring:
        """Wiring of the parts, checked end by end."""
        found = cls({}, {}, {}, {})
        for destination, source in wires.items():
            for end in (destination, source):
                if not WIRE_END.fullmatch(end):
                    raise BadInput(
                        f"{name}: a wire ends at {end!r}; write part.signal, or one name"
                    )
            if "." not in destination:
                found.outputs[destination] = _source(name, blocks, source)
                continue
            part, port = _find(name, blocks, destination, "input")
            signal = blocks[part].inputs[port]
            if "." not in source:
                known = found.inputs.get(source)
                if known is None:
                    found.inputs[source] = signal.moved(source, part)
                else:
                    _check_wire(name, source, known, destination, signal)
                    found.inputs[source] = _both(known, signal.moved(source, part))
                found.free[part, port] = source
                continue
            from_part, from_port = _source(name, blocks, source)
            _check_wire(name, source, _signal(blocks[from_part], from_port), destination, signal)
            found.inner[part, port] = (from_part, from_port)
        for b, block in blocks.items():
            for n in block.inputs:
                if (b, n) not in found.inner:
                    found.free.setdefault((b, n), f"{b}.{n}")
        return found


def _signals_of_parts(
    blocks: Mapping[str, Block], wiring: _Wiring, shares: Mapping[str, Share]
) -> list[Signal]:
    """All signals of the connection."""
    here = {place for s in shares.values() for place in s.places}
    signals: list[Signal] = []
    for b, block in blocks.items():
        for n, s in block.states.items():
            s = s.moved(f"{b}.{n}", b)
            # its own name is the expression that leads to the shared number
            signals.append(s.valued(n.rpartition(".")[2]) if s.name in here else s)
    signals += [s.signal for s in shares.values() if s.signal is not None]
    for b, block in blocks.items():
        signals += [s.named(f"{b}.{n}") for n, s in block.params.items() if f"{b}.{n}" not in here]
    signals += list(wiring.inputs.values())
    for b, block in blocks.items():
        own = ((n, s) for n, s in block.inputs.items() if wiring.free.get((b, n)) == f"{b}.{n}")
        signals += [s.moved(f"{b}.{n}", b) for n, s in own]
    for b, block in blocks.items():
        signals += [s.moved(f"{b}.{n}", b) for n, s in block.outputs.items()]
    for out, (b, n) in wiring.outputs.items():
        signals.append(_signal(blocks[b], n).moved(out, b).as_role("output", value=None))
    return signals


def _conditions(blocks: Mapping[str, Block], sharing: Sharing) -> dict[str, dict[str, float]]:
    """Rail conditions of the parts, by the names that their numbers have in the connection."""
    found: dict[str, dict[str, float]] = {}
    for b, block in blocks.items():
        for condition, values in block.conditions.items():
            found.setdefault(condition, {}).update(
                {sharing.name(f"{b}.{k}"): v for k, v in values.items()}
            )
    return found


def _common_kind(name: str, blocks: Mapping[str, Block]) -> tuple[str, float | None]:
    flows = [b for b, block in blocks.items() if block.kind == "flow"]
    steps = [b for b, block in blocks.items() if block.kind == "step"]
    if flows and steps:
        raise BadInput(
            f"{name}: {flows[0]} is continuous and {steps[0]} is sampled;"
            f" discretise it first, sampled({flows[0]}, h, method)"
        )
    periods = {b: h for b in steps if (h := blocks[b].period) is not None}
    slow, fast = (f(periods, key=lambda b: periods[b], default="") for f in (max, min))
    if periods and not math.isclose(periods[slow], periods[fast], rel_tol=1e-9):
        raise BadInput(
            f"{name}: {slow} runs every {periods[slow]:g} s and {fast} every {periods[fast]:g} s;"
            f" wrap it in every({slow}, {periods[slow] / periods[fast]:g})"
        )
    kind = "flow" if flows else "step" if steps else "law"
    return kind, next(iter(periods.values()), None)


def _find(name: str, blocks: Mapping[str, Block], path: str, role: str) -> End:
    part, dot, port = path.partition(".")
    if part not in blocks or not dot:
        raise BadInput(f"{name}: {path!r} names no part{nearest(part, blocks)}")
    known = blocks[part]._signals[role]
    check_known(f"{name}: {part} has no {role}", port, known)
    return part, port


def _source(name: str, blocks: Mapping[str, Block], path: str) -> End:
    """Part and name of an output, or of a state, whose value at the start of the tick it is."""
    part, dot, port = path.partition(".")
    if part in blocks and dot and port in blocks[part].states:
        return part, port
    return _find(name, blocks, path, "output")


def _signal(block: Block, port: str) -> Signal:
    return block.outputs.get(port) or block.states[port]


def _check_wire(name: str, source: str, s: Signal, destination: str, d: Signal) -> None:
    where = f"{name}: {source} [{s.unit}] cannot feed {destination} [{d.unit}]"
    if s.unit != d.unit:
        if not unit_algebra.dimension_equal(s.unit, d.unit):
            raise BadInput(f"{where}; the units differ in dimension")
        if unit_algebra.factor(s.unit, d.unit) != 1.0:
            raise BadInput(f"{where}; write both in {d.unit}, or put a gain of the ratio between")
    if s.positive and d.positive and s.positive != d.positive:
        raise BadInput(
            f"{name}: {source} is positive for {s.positive}, {destination} for {d.positive};"
            f" put flip_sign({s.unit!r}) between them"
        )
    if s.per and d.per and s.per != d.per:
        adaptor = "speed_to_ratio" if d.per == "ratio" else "ratio_to_speed"
        raise BadInput(
            f"{name}: {source} is a slip {s.per}, {destination} takes a slip {d.per};"
            f" put {adaptor}() between them"
        )
    if s.shape != d.shape:
        raise BadInput(f"{name}: {source} has shape {s.shape}, {destination} takes {d.shape}")


def _both(a: Signal, b: Signal) -> Signal:
    """Input that feeds two parts: in both ranges, and of the convention that either declares."""
    return replace(
        a,
        value=b.value if a.value is None else a.value,
        source=a.source or b.source,
        lo=max(a.lo, b.lo),
        hi=min(a.hi, b.hi),
        change=min(a.change, b.change),
        jitter=max(a.jitter, b.jitter),  # of the one sensor that both read
        stale=min(a.stale, b.stale),
        judged=a.judged and b.judged,
        bounds=tuple(dict.fromkeys([*a.bounds, *b.bounds])),
        positive=a.positive or b.positive,
        per=a.per or b.per,
    )


def evaluation_order(block: Block) -> tuple[list[Call], dict[End, End], dict[End, str]]:
    """How a connected block is evaluated.

    Returns:
        The calls of its parts in order; (part, port) that feeds each inner (part, input); name of
        the block's own input that feeds each other (part, input).
    """
    wiring = _Wiring.of(block.name, block.parts, block.wires)
    plan = calls_of_parts(block.name, block.parts, wiring.inner)
    return plan, wiring.inner, wiring.free


def _inputs(b: str, block: Block, wiring: _Wiring, results: Mapping[End, Any], u: Exprs) -> Exprs:
    """Inputs of a part; an output that is evaluated now does not depend on what is not known."""
    return {
        n: u[wiring.free[b, n]] if (b, n) in wiring.free
        else results.get(wiring.inner[b, n], ca.DM.zeros(s.size, 1))
        for n, s in block.inputs.items()
    }  # fmt: skip


_inlined: ContextVar[bool] = ContextVar("_inlined", default=False)
ROLES = ("state", "input", "param")


@contextmanager
def parts_inlined() -> Iterator[None]:
    """Let connections write the equations of their parts, where these are no scalar graphs.

    The operations and their order are the same. Nothing is packed for a call and unpacked in it.
    """
    before = _inlined.set(True)
    try:
        yield
    finally:
        _inlined.reset(before)


def _evaluated(
    block: Block, args: Sequence[Any], outputs: list[str], last: bool
) -> tuple[Any, Any]:
    """Next state and outputs of a part, packed; before its last turn ``outputs`` alone."""
    if block.sx or not _inlined.get():
        return (block.f if last else _part(block, outputs))(*args)
    n, y = block.expr(*[block.unpack(role, a) for role, a in zip(ROLES, args, strict=True)])
    if last:
        return block.pack("state", n), block.pack("output", y)
    return ca.DM(0, 1), _pack_some(block, outputs, y)


def _part(block: Block, outputs: list[str]) -> ca.Function:
    """Function of the part that gives only these outputs (and no next state).

    It is made from the equations and not from the part's Function: what the outputs do not need, an
    iteration say, is not computed for them.
    """

    def make() -> ca.Function:
        full = block.f
        sym = symbol_maker(block.sx)
        args: list[Any] = [sym("xup"[i], full.size1_in(i)) for i in range(3)]
        _, y = block.expr(*[block.unpack(role, a) for role, a in zip(ROLES, args, strict=True)])
        name = f"{full.name()}_part{len(outputs)}"
        found = [ca.DM(0, 1), _pack_some(block, outputs, y)]
        return ca.Function(name, args, found, {"cse": True})

    return block.of_equations(("part", *outputs), make)


def _pack_some(block: Block, outputs: list[str], y: Exprs) -> Any:
    wanted = block.pack("output", {k: y[k] if k in outputs else 0.0 for k in block.outputs})
    found = block.unpack("output", wanted)
    return ca.vertcat(*[ca.reshape(found[k], block.outputs[k].size, 1) for k in outputs])
