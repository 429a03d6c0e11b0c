"""A law as the objective of a search: what varies, what is given, what is maximised."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs
from slipctl.block.signals import Output, Signal
from slipctl.block.text.named_expressions import names_in
from slipctl.errors import BadInput, check_known


def objective(where: str, law: Block, over: str, maximise: str | None) -> str:
    """Output that is maximised, after a look at the law."""
    if law.kind != "law" or not law.sx:
        raise BadInput(f"{where}: only a law of scalar expressions can be searched")
    check_known(f"{where} has no input", over, law.inputs)
    if maximise is None and len(law.outputs) == 1:
        maximise = next(iter(law.outputs))
    if maximise is None:
        raise BadInput(f"{where}: give maximise=, one of {', '.join(law.outputs)}")
    check_known(f"{where} has no output", maximise, law.outputs)
    if any(s.shape != () for s in (*law.inputs.values(), law.outputs[maximise])):
        raise BadInput(f"{where}: inputs, and what is searched for the best of, must be scalars")
    return maximise


def refuse_names(where: str, law: Block, settings: Sequence[str]) -> None:
    """Refuse a law one of whose names the block of a search needs itself."""
    for name in (*law.inputs, *law.params):
        if name in settings:
            raise BadInput(f"{where}: {law.name}.{name} is a name of the search itself; rename it")


def settled_by(law: Block, names: Collection[str]) -> list[Signal]:
    """Parameters that are known where these are: themselves, and what is derived of them alone."""
    found = set(names)
    derived = {
        n: {law._sibling(n, k) for k in names_in(s.value)}
        for n, s in law.params.items() if s.derived
    }  # fmt: skip
    while more := {n for n, needs in derived.items() if needs <= found} - found:
        found |= more
    return [s for n, s in law.params.items() if n in found]


def left_open(law: Block, over: Sequence[str]) -> list[Signal]:
    """Signals that fix a law but for some inputs.

    These are its other inputs and its free parameters. What is searched for is told the scalars, as
    inputs. Parameters of a shape, the points of a table, are known: they stay parameters, and with
    them what is derived of them.
    """
    others = [s for k, s in law.inputs.items() if k not in over]
    free = [s for s in law.params.values() if not s.derived]
    told = [s.as_role("input", value=None) for s in free if s.shape == ()]
    return [*others, *told, *settled_by(law, [s.name for s in free if s.shape != ()])]


def of_role(role: str, given: Sequence[Signal]) -> list[Signal]:
    """Those of what fixes a law that are inputs of its search, or parameters."""
    return [s for s in given if s.role == role]


def best_outputs(
    law: Block, over: str, of: str, shape: tuple[int, ...] = ()
) -> tuple[Signal, Signal]:  # fmt: skip
    """Outputs ``best`` (place) and ``value`` (there) of what looks for the best of one input."""
    x = law.inputs[over]
    best = Output(x.unit, f"best {x.doc}", positive=x.positive, per=x.per, shape=shape)
    return best.named("best"), value_there(law, of, shape)


def value_there(law: Block, of: str, shape: tuple[int, ...] = ()) -> Signal:
    """Output ``value``: the objective at the best place."""
    return law.outputs[of].as_role("output", doc="value there", shape=shape).named("value")


def column(given: Sequence[Signal], u: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
    """Values of what fixes a law, one below the other."""
    return ca.vertcat(*[ca.vec(u[s.name] if s.role == "input" else p[s.name]) for s in given])


def open_law(
    law: Block, over: Sequence[str], maximise: str
) -> tuple[list[Signal], ca.Function]:  # fmt: skip
    """Signals that fix a law but for some, and Function (place, their values) -> objective."""
    given = left_open(law, over)
    place, values = ca.SX.sym("place", len(over)), ca.SX.sym("given", sum(s.size for s in given))
    y = law_at(law, over, maximise, place, values)
    return given, ca.Function("value_of", [place, values], [y], {"cse": True})


def law_at(law: Block, over: Sequence[str], maximise: str, place: Any, values: Any) -> Any:
    """The objective there; unlike ``open_law`` it is written anew, with the letters of the law."""
    at: Exprs = {name: place[k] for k, name in enumerate(over)}
    first = 0
    for s in left_open(law, over):
        piece = values[first : first + s.size]
        at[s.name] = ca.reshape(piece, *s.shape) if len(s.shape) == 2 else piece
        first += s.size
    params = {k: v for k, v in at.items() if k in law.params}
    inputs = {k: v for k, v in at.items() if k in law.inputs}
    return law.expr({}, inputs, law.derive(params))[1][maximise]
