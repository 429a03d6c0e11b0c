"""A law as the objective of a search: what varies, what is given, what is maximised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.errors import BadInput, nearest


def objective(where: str, law: Block, over: str, maximise: str | None) -> str:
    """Output that is maximised, after a look at the law."""
    if law.kind != "law" or not law.sx:
        raise BadInput(f"{where}: only a law of scalar expressions can be searched")
    if over not in law.inputs:
        raise BadInput(f"{where} has no input {over!r}{nearest(over, law.inputs)}")
    if any(s.shape != () for s in (*law.inputs.values(), *law.params.values())):
        raise BadInput(f"{where}: inputs and parameters must be scalars")
    if maximise is None and len(law.outputs) == 1:
        return next(iter(law.outputs))
    if maximise is None:
        raise BadInput(f"{where}: give maximise=, one of {', '.join(law.outputs)}")
    if maximise not in law.outputs:
        raise BadInput(f"{where} has no output {maximise!r}{nearest(maximise, law.outputs)}")
    return maximise


def refuse_names(where: str, law: Block, settings: Sequence[str]) -> None:
    """Refuse a law one of whose names the block of a search needs itself."""
    for name in (*law.inputs, *law.params):
        if name in settings:
            raise BadInput(f"{where}: {law.name}.{name} is a name of the search itself; rename it")


def left_open(law: Block, over: Sequence[str]) -> list[Signal]:
    """Inputs that fix a law but for some: its other inputs, then its free parameters."""
    others = [s for k, s in law.inputs.items() if k not in over]
    free = [s for s in law.params.values() if not s.derived]
    return [*others, *(s.as_role("input", value=None) for s in free)]


def open_law(
    law: Block, over: Sequence[str], maximise: str
) -> tuple[list[Signal], ca.Function]:  # fmt: skip
    """Inputs that fix a law but for some, and Function (place, their values) -> objective."""
    given = left_open(law, over)
    place, values = ca.SX.sym("place", len(over)), ca.SX.sym("given", len(given))
    y = law_at(law, over, maximise, place, values)
    return given, ca.Function("value_of", [place, values], [y], {"cse": True})


def law_at(law: Block, over: Sequence[str], maximise: str, place: Any, values: Any) -> Any:
    """The objective there; unlike ``open_law`` it is written anew, with the letters of the law."""
    at = {s.name: values[k] for k, s in enumerate(left_open(law, over))}
    at |= {name: place[k] for k, name in enumerate(over)}
    params = {k: v for k, v in at.items() if k in law.params}
    inputs = {k: v for k, v in at.items() if k in law.inputs}
    return law.expr({}, inputs, law.derive(params))[1][maximise]
