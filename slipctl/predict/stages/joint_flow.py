"""Plant and laws of an optimal control problem as one flow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs
from slipctl.block.connection import connect
from slipctl.block.fields import Composition
from slipctl.block.signals import Signal
from slipctl.block.units.unit_algebra import dimension_equal
from slipctl.errors import BadInput
from slipctl.predict.options.scenarios import TREE, Factors, scenario_copies, tree


def with_inputs(
    plant: Block, inputs: Sequence[Signal], change: Callable[[Exprs, Exprs], Exprs]
) -> Block:
    """The flow with further inputs, its rates changed: (rates, inputs) -> rates."""

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        own = {n: u[n] for n in plant.inputs}
        n, y = plant.f(plant.pack("state", x), plant.pack("input", own), plant.pack("param", p))
        return change(plant.unpack("state", n), u), plant.unpack("output", y)

    return Block(
        plant.name, "flow", body, [*plant.signals, *inputs], doc=plant.doc, sx=plant.sx,
        choices=plant.choices, conditions=plant.conditions,
        composition=Composition.around(
            plant, lambda parts: with_inputs(parts[plant.name], inputs, change)
        ),
    )  # fmt: skip


def join_flows(
    where: str, plant: Block, laws: Mapping[str, Block], factors: Factors = (),
    branching: Mapping[str, float] | None = None,
) -> tuple[Block, dict[str, str]]:  # fmt: skip
    """Plant and laws as one flow, and the name that each input of the plant has there.

    An input of a law that has the name of a state, an output or an input of the plant reads it.
    ``branching``: controls of which each scenario has its own, and their sizes.
    """
    if plant.kind != "flow":
        raise BadInput(f"{where}: {plant.name} is a {plant.kind}; give the flow, not yet sampled")
    for part, block in laws.items():
        if block.kind != "law":
            raise BadInput(
                f"{where}: the {part} {block.name} is a {block.kind}; give a law of {WHAT[part]}"
            )
    inputs = [s for block in (plant, *laws.values()) for s in block.inputs.values()]
    if any(s.shape != () for s in inputs):
        raise BadInput(f"{where}: inputs of plant and {' and '.join(laws)} must be scalars")
    short = [n.rpartition(".")[2] for n in plant.inputs]
    alias = {
        n: s if short.count(s) == 1 else n.replace(".", "_")
        for n, s in zip(plant.inputs, short, strict=True)
    }
    wires = {f"plant.{n}": a for n, a in alias.items()}
    for part, block in laws.items():
        for n in block.inputs:
            wires[f"{part}.{n}"] = _source(where, plant, alias, n, part)
    parts: dict[str, Any] = {"plant": plant, **laws}
    if factors:
        more: dict[str, Any] = {}
        if branching:
            driven = {alias[c]: plant.inputs[c] for c in branching}
            sizes = {alias[c]: size for c, size in branching.items()}
            wires = {k: f"{TREE}.{v}" if v in driven else v for k, v in wires.items()}
            more[TREE] = tree(driven, sizes, len(factors))
            wires |= {f"{TREE}.{n}": n for n in more[TREE].inputs}
        parts = more | scenario_copies(plant, laws, wires, alias, factors)
    return connect("model", wires, **parts), alias


WHAT = {"cost": "residuals", "path": "limits", "final": "limits", "last": "residuals",
        "price": "prices"}  # fmt: skip
"""What the outputs of each law are: of every stage, or of the last one."""


def _source(where: str, plant: Block, alias: Mapping[str, str], name: str, part: str) -> str:
    """Signal of the plant that an input of a law reads, or its own name: a reference."""
    for known, found in ((plant.states, "plant.{}"), (plant.outputs, "plant.{}"), (alias, "{}")):
        hits = [n for n in known if n == name or n.rpartition(".")[2] == name]
        if name in known:
            hits = [name]
        if len(hits) > 1:
            raise BadInput(f"{where}: {name!r} of the {part} could be {' or '.join(hits)}")
        if hits:
            return found.format(alias[hits[0]] if known is alias else hits[0])
    return name


def check_lag(
    where: str, plant: Block, model: Block, controls: Sequence[str], length: float
) -> None:
    """Refuse a horizon shorter than the lag of the actuator that a control drives.

    An actuator follows its command, in the command's unit. Another state that a control drives has
    a time constant of its own, that of a mass with its drag, of which a plan need not see the end.
    """
    try:
        x, p = model.start(), model.param_values()
    except BadInput:
        return  # numbers that come later
    f = model.f
    slopes = f.factory("slopes", ["x", "u", "p"], ["jac:n:x", "jac:n:u"])
    u = [_middle(s) for s in model.inputs.values()]
    point = model.pack("state", x), ca.DM(u), model.pack("param", p)
    A, B = (ca.DM(m).full() for m in slopes(*point))
    names = list(model.inputs)
    states = [(n, s.unit) for n, s in model.states.items() for _ in range(s.size)]
    for control in controls:
        for k, effect in enumerate(B[:, names.index(control)]):
            if not dimension_equal(states[k][1], model.inputs[control].unit):
                continue
            rate = -float(A[k, k])
            if effect != 0 and rate > 0 and math.isfinite(rate) and rate * length < 1:
                raise BadInput(
                    f"{where}: the horizon of {length:g} s is shorter than the lag of"
                    f" {1 / rate:.3g} s from {control} to {states[k][0].removeprefix('plant.')};"
                    f" take at least {1 / rate:.3g} s"
                )


def _middle(s: Signal) -> float:
    """A value of an input to linearise at: its own, or the number of its range nearest to zero."""
    if s.value is not None and not isinstance(s.value, str):
        return float(s.value)
    return float(min(max(0.0, s.lo), s.hi))
