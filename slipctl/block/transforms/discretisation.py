"""Time: discretise a flow, run a step every n-th tick, delay a signal by one tick."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, as_block, make_block
from slipctl.block.fields import Composition
from slipctl.block.functions import symbol_maker
from slipctl.block.signals import Bound, Input, Output, State
from slipctl.certify.bounds.steps import METHODS, largest_step
from slipctl.errors import BadInput, check_known, check_positive, check_whole

SHARES = (1.0, 1 / 4, 1 / 16, 1 / 64)
"""Shares of a Newton step among which an implicit method chooses."""

UNROLL = 20_000
"""Instructions above which substeps become a loop instead of straight-line code."""


def sampled(
    block: Block,
    h: float,
    method: str = "rk4",
    substeps: int = 1,
    newton: int = 8,
    check: bool = True,
) -> Block:
    """Discretise a flow block: inputs are held over the step h, outputs are those at its start.

    Args:
        block: a flow.
        h: step (the tick) in s.
        method: ``"euler"`` and ``"rk4"`` are explicit; ``"implicit_euler"`` (order 1) and
            ``"sdirk2"`` (order 2) are L-stable, for stiff wheels.
        substeps: number of equal steps inside one tick.
        newton: Newton iterations of an implicit stage, on the exact Jacobian.
        check: refuse a step too long for the fastest mode, at the start and with wheels that stand,
            without inputs and with the largest torques, on each rail condition.

    Returns:
        A step block with the same signals and period h.

    Raises:
        BadInput: not a flow, unknown method, h not positive, or an explicit step that is too
            long. The message names a step, a number of substeps and a method that would do.
    """
    if as_block("sampled: what is to be sampled", block).kind != "flow":
        raise BadInput(f"{block.name} is a {block.kind}; only a flow can be sampled")
    check_known(f"sampled({block.name}): unknown method", method, METHODS)
    check_positive(f"sampled({block.name}): h", h, "s")
    check_whole(f"sampled({block.name}): substeps", substeps)
    dt = h / substeps
    if check:
        check_step(block, dt, method, substeps)

    def guard(numbers: Mapping[str, Any]) -> None:
        check_step(block._numbered(numbers), dt, method, substeps)

    one_step = block.of_equations(
        ("step", method, dt, newton), lambda: _one_step(block, dt, method, newton)
    )
    loop = one_step.n_instructions() * substeps > UNROLL or not block.sx
    f = block.f

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        X, U, P = block.pack("state", x), block.pack("input", u), block.pack("param", p)
        y = f(X, U, P)[1]
        if loop and substeps > 1:
            X = one_step.fold(substeps)(X, ca.repmat(U, 1, substeps), ca.repmat(P, 1, substeps))
        else:
            for _ in range(substeps):
                X = one_step(X, U, P)
        return block.unpack("state", X), block.unpack("output", y)

    def rebuild(parts: dict[str, Block]) -> Block:
        return sampled(parts[block.name], h, method, substeps, newton, check)

    return Block(
        block.name, "step", body, block.signals, period=h, sx=block.sx and not loop,
        doc=f"{block.doc}\n\nSampled: {method}, {h:g} s in {substeps} substeps.",
        choices=block.choices | {"method": method, "h": h, "substeps": substeps},
        conditions=block.conditions,
        composition=Composition.around(block, rebuild, guard=guard if check else None),
    )  # fmt: skip


def _one_step(block: Block, dt: float, method: str, newton: int) -> ca.Function:
    f = block.f
    sym = symbol_maker(block.sx)
    x, u, p = (sym("xup"[i], f.size1_in(i)) for i in range(3))

    def rate(at: Any) -> Any:
        return f(at, u, p)[0]

    if method == "euler":
        following = x + dt * rate(x)
    elif method == "rk4":
        k1 = rate(x)
        k2 = rate(x + dt / 2 * k1)
        k3 = rate(x + dt / 2 * k2)
        k4 = rate(x + dt * k3)
        following = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    elif method == "implicit_euler":
        following = x + dt * _stage(block, x, u, p, dt, newton)
    else:
        g = 1 - 1 / math.sqrt(2)
        k1 = _stage(block, x, u, p, g * dt, newton)
        k2 = _stage(block, x + (1 - g) * dt * k1, u, p, g * dt, newton)
        following = x + dt * ((1 - g) * k1 + g * k2)
    return ca.Function(f"{f.name()}_{method}", [x, u, p], [following], {"cse": True})


def _stage(block: Block, x: Any, u: Any, p: Any, gh: float, newton: int) -> Any:
    """Rate k that solves k = f(x + gh k, u, p), by damped Newton steps on the exact Jacobian.

    It starts at k = 0, because x + gh f(x) of a stiff wheel lies far beyond the adhesion curve. Of
    each Newton step the share is taken after which the next correction, with the same Jacobian, is
    smallest. Source: Deuflhard, Newton Methods for Nonlinear Problems, section 3.3.
    """
    f = block.f
    n = f.size1_in(0)
    sym = symbol_maker(block.sx)
    z = sym("z", n)
    a, b, c = (sym("abc"[i], f.size1_in(i)) for i in range(3))

    def residual(k: Any) -> Any:
        return k - f(a + gh * k, b, c)[0]

    J = ca.jacobian(residual(z), z)
    whole = -ca.solve(J, residual(z))
    trials = [z + share * whole for share in SHARES]
    corrections = ca.solve(J, ca.horzcat(*[residual(t) for t in trials]))
    best, smallest = trials[0], ca.inf
    for column, trial in enumerate(trials):
        # fmin turns a NaN beyond the curve into a large number
        size = ca.fmin(ca.sumsqr(corrections[:, column] / (1 + ca.fabs(a))), 1e300)
        best = ca.if_else(size < smallest, trial, best)
        smallest = ca.fmin(size, smallest)
    step = ca.Function(f"{f.name()}_newton", [z, a, b, c], [best], {"cse": True})
    k = ca.DM.zeros(n, 1)
    for _ in range(newton):
        k = step(k, x, u, p)
    return k


def check_step(block: Block, dt: float, method: str, substeps: int = 1) -> None:
    """Refuse an explicit step longer than the fastest mode allows.

    The Jacobian of the flow is taken at the start values, and there with wheels that stand. The
    inputs are zero (the nearest number in their range) and then as large as they act, see
    :func:`_points`. It is taken once per rail condition of the block.

    Raises:
        BadInput: with the mode, the longest step and what to use instead.
    """
    if method in ("implicit_euler", "sdirk2") or not block.states:
        return
    try:
        x = block.pack("state", block.start())
    except BadInput:
        return  # start values that come later are checked when the loop is simulated
    longest, mode, where = math.inf, 0.0, ""
    for condition, values in (block.conditions or {"": {}}).items():
        known = {k: v for k, v in values.items() if k in block.params}
        p = block.pack("param", block.param_values(**known))
        for place, slopes in _points(block, np.asarray(x, dtype=float).ravel(), p):
            for eigenvalue in np.linalg.eigvals(slopes):
                allowed = largest_step(complex(eigenvalue), method)
                if allowed < longest * (1 - 1e-9):
                    longest, mode = allowed, abs(eigenvalue)
                    where = (f" on {condition}" if condition else "") + place
    if dt > longest:
        needed = math.ceil(round(substeps * dt / longest, 9))
        raise BadInput(
            f"{block.name}: a step of {dt * 1e3:g} ms is too long for {method}: the fastest"
            f" time constant{where} is {1e3 / mode:.3g} ms, which allows {longest * 1e3:.3g} ms;"
            f" use substeps={needed}, or method='implicit_euler' or 'sdirk2'"
        )


EFFORTS = ("N m", "N", "Pa")
"""Units of inputs that may be large."""

LARGE = 1e9, 1e12
"""Sizes of an input without a range: where both act alike, the block limits it itself."""


def _points(block: Block, start: np.ndarray, p: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Where a step is checked: words for it, and the Jacobian there, where that is finite.

    A torque or a force among the inputs is as large as its range allows. One without a range is as
    large as the block lets it act, and left out where it has no limit. A state that follows it is
    where it then settles.
    """
    f = block.f
    jac = block.of_equations(
        "slopes", lambda: f.factory(f"{f.name()}_jac", ["x", "u", "p"], ["jac:n:x"])
    )

    def at(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array(ca.DM(jac(x, u, p)).full())

    def inputs(size: float, sign: int) -> np.ndarray:
        found = []
        for s in block.inputs.values():
            far = min(max(sign * size, s.lo), s.hi)
            near = s.value if s.value is not None else min(max(0.0, s.lo), s.hi)
            acts = size > 0 and s.unit in EFFORTS and not s.noise
            found.append(np.broadcast_to(far if acts else near, s.shape or (1,)))
        return np.concatenate([np.ravel(v) for v in found]) if found else np.zeros(0)

    def settled(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """State after one Newton step of those states that follow an input by themselves."""
        moves = np.ravel(np.array(f(x, u, p)[0])) - np.ravel(np.array(f(x, inputs(0, 1), p)[0]))
        own = np.diag(at(x, u))
        follows = (moves != 0) & (own < 0) & np.isfinite(moves)
        rate = np.ravel(np.array(f(x, u, p)[0]))
        return np.where(follows, x - rate / np.where(own < 0, own, 1), x)

    turns = np.concatenate([np.full(s.size, s.unit == "rad/s") for s in block.states.values()])
    for place, x in (("", start), (" of wheels that stand", np.where(turns, 0.0, start))):
        slopes = at(x, inputs(0, 1))
        if np.isfinite(slopes).all():
            yield place, slopes
        for sign in (1, -1):
            u, more = inputs(LARGE[0], sign), inputs(LARGE[1], sign)
            first, second = settled(x, u), settled(x, more)
            slopes, other = at(first, u), at(second, more)
            if np.isfinite(slopes).all() and np.allclose(slopes, other, rtol=1e-6, atol=1e-9):
                yield f"{place} with the largest inputs", slopes


def _with_zero(bounds: tuple[Bound, ...]) -> tuple[Bound, ...]:
    """Ends of a range that has 0 in it, as a held output is 0 until the first run."""
    widen = {"lo": "fmin({}, 0)", "hi": "fmax({}, 0)"}
    return tuple(replace(b, expression=widen[b.what].format(b.expression)) for b in bounds)


def every(block: Block, n: int, offset: int = 0) -> Block:
    """Run a step block every n-th tick; between, states and outputs hold and nothing is computed.

    Args:
        block: a step (a law is sampled and held).
        n: ticks from one run to the next.
        offset: tick of the first run, 0 <= offset < n.

    Returns:
        A step block; its period, if the block insists on one, is the block's divided by n.

    Raises:
        BadInput: n or offset is not a whole number in range, or the block is a flow.
    """
    if block.kind == "flow":
        raise BadInput(f"every({block.name}): a flow has no ticks; sampled({block.name}, h) first")
    check_whole(f"every({block.name}): n", n)
    check_whole(f"every({block.name}): offset", offset, 0, int(n) - 1)
    n, offset = int(n), int(offset)
    choose = block.of_equations("every", lambda: _run_or_hold(block.f))
    taken = {s.name for s in block.signals}
    counter = _new_name("tick", taken)
    hold_names = {_new_name(f"held_{k}", taken): k for k in block.outputs}
    states = [
        *block.states.values(),
        State("1", float((n - offset) % n), "ticks since the last run", lo=0, hi=n).named(counter),
        *(
            # zero until the first run, even where the range of the output excludes zero
            replace(
                s.moved(h).as_role("state", value=0.0, doc=f"held: {s.doc}"),
                lo=min(s.lo, 0.0),
                hi=max(s.hi, 0.0),
                bounds=_with_zero(s.moved(h).bounds),
            )
            for h, s in zip(hold_names, block.outputs.values(), strict=True)
        ),
    ]

    def body(xs: Exprs, us: Exprs, ps: Exprs) -> tuple[Exprs, Exprs]:
        old = block.pack("output", {k: xs[h] for h, k in hold_names.items()})
        due = xs[counter] == 0
        nxt, y = choose(
            due, block.pack("state", xs), block.pack("input", us), block.pack("param", ps), old
        )
        outputs = block.unpack("output", y)
        tick = ca.if_else(xs[counter] >= n - 1, 0, xs[counter] + 1)
        new = block.unpack("state", nxt) | {counter: tick}
        return new | {h: outputs[k] for h, k in hold_names.items()}, outputs

    def rebuild(parts: dict[str, Block]) -> Block:
        return every(parts[block.name], n, offset)

    return Block(
        block.name, "step", body,
        [*states, *block.inputs.values(), *block.params.values(), *block.outputs.values()],
        period=None if block.period is None else block.period / n, sx=False,
        doc=f"{block.doc}\n\nRuns every {n} ticks.", choices=block.choices | {"every": n},
        conditions=block.conditions, composition=Composition.around(block, rebuild),
    )  # fmt: skip


def counters(block: Block) -> dict[str, int]:
    """Ticks from one run to the next by the state that counts them, of each part under ``every``.

    What such a part has inside counts its runs, and is left out.
    """
    own = slower(block)
    if own:
        return dict([own])
    found: dict[str, int] = {}
    for name, part in block.parts.items():
        for n, ticks in counters(part).items():
            found[f"{name}.{n}" if block.prefixed else n] = ticks
    return {n: ticks for n, ticks in found.items() if n in block.states}


def slower(block: Block) -> tuple[str, int] | None:
    """Counter and its ticks, of what ``every`` made; what is around it has its choices as well."""
    if not block.transparent or "every" not in block.choices or len(block.parts) != 1:
        return None
    (inner,) = block.parts.values()
    counter = _new_name("tick", {s.name for s in inner.signals})
    return (counter, int(block.choices["every"])) if counter in block.states else None


class PartRuns(NamedTuple):
    """What runs of a part of a loop, and when: what a module of that part is made of.

    Attributes:
        block: what runs; of a part under ``every`` what stands in it.
        ticks: of the loop, from one run to the next.
        first: tick of the loop in which it runs first.
        period: from one run to the next in s, None where the loop has none.
    """

    block: Block
    ticks: int
    first: int
    period: float | None


def runs_of_part(loop: Block, path: str) -> PartRuns:
    """Runs of a part of a loop: a module of it is called once for each, at their period.

    Raises:
        BadInput: no such part.
    """
    loop[path]  # says what is wrong with the path
    words, block, ticks, first = path.split("."), loop, 1, 0
    while True:
        own = slower(block)
        if own:
            counter, n = own
            first += ticks * (-int(block.start()[counter]) % n)
            ticks *= n
        if own or (words and block.transparent):
            block = next(iter(block.parts.values()))
        elif words:
            block = block.parts[words.pop(0)]
        else:
            period = None if loop.period is None else loop.period * ticks
            return PartRuns(block, ticks, first, period)


def _run_or_hold(f: ca.Function) -> ca.Function:
    """Function (due, x, u, p, held) -> (x, y): those of f where it is due, else held."""
    x, u, p = (ca.MX.sym("xup"[i], f.size1_in(i)) for i in range(3))
    held = ca.MX.sym("h", f.size1_out(1))
    run = ca.Function(f"{f.name()}_run", [x, u, p, held], [*f(x, u, p)])
    hold = ca.Function(f"{f.name()}_hold", [x, u, p, held], [x, held])
    return ca.Function.if_else(f"{f.name()}_every", run, hold)


def gated(block: Block, by: str = "on") -> Block:
    """Run a step block while a signal is on; while it is off nothing is computed.

    While it is off the outputs are zero, and the states wait at their start values, so that the
    block begins anew each time that the signal comes on.

    Args:
        block: a step, or a law.
        by: name of the further input; above 0.5 it is on.

    Raises:
        BadInput: the block is a flow, or has a signal of that name.
    """
    if block.kind == "flow":
        raise BadInput(f"gated({block.name}): a flow has no ticks; sampled({block.name}, h) first")
    if any(s.name == by for s in block.signals):
        raise BadInput(f"gated({block.name}): it has a signal {by!r}; name the gate otherwise")
    choose = block.of_equations("gated", lambda: _run_or_rest(block.f))
    outputs = [
        # zero while it is off, even where the range excludes zero
        replace(s, lo=min(s.lo, 0.0), hi=max(s.hi, 0.0))
        for s in block.outputs.values()
    ]

    def body(x: Exprs, us: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        u = {k: us[k] for k in block.inputs}
        start = block.pack("state", block.symbolic_start(p))
        nxt, y = choose(
            us[by] > 0.5, block.pack("state", x), block.pack("input", u), block.pack("param", p),
            start,
        )  # fmt: skip
        return block.unpack("state", nxt), block.unpack("output", y)

    def rebuild(parts: dict[str, Block]) -> Block:
        return gated(parts[block.name], by)

    gate = Input("1", "the block runs while this is 1", lo=0, hi=1).named(by)
    return Block(
        block.name, "step", body,
        [*block.states.values(), *block.inputs.values(), gate, *block.params.values(), *outputs],
        period=block.period, sx=False,
        doc=f"{block.doc}\n\nRuns while {by} is 1, and begins anew each time.",
        choices=block.choices | {"gated by": by}, conditions=block.conditions,
        composition=Composition.around(block, rebuild),
    )  # fmt: skip


def _run_or_rest(f: ca.Function) -> ca.Function:
    """Function (on, x, u, p, start) -> (x, y): those of f where it is on, else start and zero."""
    x, u, p = (ca.MX.sym("xup"[i], f.size1_in(i)) for i in range(3))
    start = ca.MX.sym("s", f.size1_in(0))
    run = ca.Function(f"{f.name()}_on", [x, u, p, start], [*f(x, u, p)])
    rest = ca.Function(f"{f.name()}_off", [x, u, p, start], [start, ca.DM.zeros(f.size1_out(1))])
    return ca.Function.if_else(f"{f.name()}_gated", run, rest)


SAMPLE_TIMES = ("T", "T_o", "T_s")
"""Names of a sample time among the parameters of a step."""


def check_sample_times(loop: Block) -> None:
    """Refuse a sample time, a parameter of a step, that is not the time from one run to the next.

    Raises:
        BadInput: with the place and the time.
    """
    if loop.period is None:
        return
    for path, h in _rates(loop, loop.period, ""):
        for n in SAMPLE_TIMES:
            place = f"{path}.{n}" if path else n
            signal = loop.params.get(loop.sharing.name(place))
            if signal is None or signal.unit != "s" or signal.derived or signal.value is None:
                continue
            told = float(np.ravel(signal.value)[0])
            if not math.isclose(told, h, rel_tol=1e-6):
                raise BadInput(
                    f"{place} = {told:g} s, but it runs every {h:g} s; a sample time is that of"
                    " the loop, which is built with it"
                )


def _rates(block: Block, h: float, path: str) -> Iterator[tuple[str, float]]:
    """Path of every step without parts, and the time from one run of it to the next."""
    if not block.parts:
        if block.kind == "step":
            yield path, h
        return
    own = slower(block)
    h *= own[1] if own else 1
    for name, part in block.parts.items():
        yield from _rates(part, h, path if block.transparent else f"{path}.{name}".lstrip("."))


def _new_name(name: str, taken: set[str]) -> str:
    """Name for a state that is added to a block; ``_`` is added while the block has it already."""
    while name in taken:
        name += "_"
    return name


def unit_delay(unit: str = "1", value: float = 0.0, shape: tuple[int, ...] = ()) -> Block:
    """Delay by one tick: output is the input of the tick before; breaks an algebraic loop."""
    return make_block(
        "unit_delay", "step", lambda x, u, p: ({"last": u["u"]}, {"y": x["last"]}),
        states=[State(unit, value, "input of the tick before", shape=shape).named("last")],
        inputs=[Input(unit, "signal", shape=shape).named("u")],
        outputs=[Output(unit, "signal one tick later", shape=shape).named("y")],
        doc="Delay by one tick.",
    )  # fmt: skip
