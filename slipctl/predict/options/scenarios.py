"""One plan for several plants: scenarios of what is not known, an adhesion or a mass, say.

Each scenario multiplies inputs and parameters of the plant by a factor of its own. All begin at the
measured state and get the same controls; each counts with an equal share of the cost, and limits
are those of every scenario. So the plan is one that does for all of them, without knowing which
will be true: that the next tick measures more, it does not count on.

Or the plan branches: after some stages each scenario has controls of its own, because by then it
will have been measured which one is true. That is multi-stage predictive control (Lucia, Finkler,
Engell, Journal of Process Control 23, 2013). The controls of the first scenario are those that all
share before. Rates and held moves follow them into each branch.

Every state and output of the plant, and every output of a law, is a column of the scenarios.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.fields import Composition
from slipctl.block.signals import Input, Output, Signal
from slipctl.errors import BadInput, check_positive

Factors = tuple[dict[str, float], ...]
"""Factor of each number that a scenario changes, by full name; one for each scenario."""


def factors_of(where: str, plant: Block, given: Any, controls: Sequence[str]) -> Factors:
    """What the scenarios are, checked.

    Raises:
        BadInput: fewer than two, a name that is no held input or parameter, a factor that is not
            positive.
    """
    if not isinstance(given, (list, tuple)) or not all(isinstance(s, Mapping) for s in given):
        raise BadInput(f"{where}: scenarios = {given!r}; give a list of {{name: factor}}")
    if len(given) < 2:
        raise BadInput(f"{where}: scenarios are two or more; write [{{}}, {{name: factor}}]")
    found = []
    for scenario in given:
        full = {}
        for n, factor in scenario.items():
            name = plant.find(n, "input", "param")
            s = plant.inputs.get(name) or plant.params[name]
            if name in controls or s.derived:
                raise BadInput(f"{where}: scenarios: {n} is no held input and no free parameter")
            check_positive(f"{where}: scenarios: the factor of {n}", factor)
            full[name] = float(factor)
        found.append(full)
    return tuple(found)


TOGETHER = "together"
"""Input of a plan that branches: 1 in the stages that all scenarios share."""

TREE = "tree"
"""Part of the model that gives each scenario its controls."""


def own(control: str, scenario: int) -> str:
    """Name of the control of a scenario."""
    return f"{control}_{scenario + 1}" if scenario else control


def tree(controls: Mapping[str, Signal], scale: Mapping[str, float], many: int) -> Block:
    """Make the law that gives each scenario its controls: the first one's, or its own.

    A control that has no say yet is drawn to the one that has: ``tie`` is 0 at every optimum.
    """
    inputs = [s.named(own(c, i)) for i in range(many) for c, s in controls.items()]
    shared = Input("1", "whether the scenarios share their controls", value=1.0).named(TOGETHER)
    outputs = []
    for c, s in controls.items():
        outputs.append(Output(s.unit, s.doc, shape=(many,)).named(c))
        outputs.append(Output("1", "from the control that is shared", shape=(many,)).named(_tie(c)))

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        found = {}
        for c in controls:
            off = ca.vertcat(*[u[own(c, i)] - u[c] for i in range(many)])
            found[c] = u[c] + (1 - u[TOGETHER]) * off
            found[_tie(c)] = u[TOGETHER] * off / scale[c]
        return {}, found

    return make_block(TREE, "law", body, inputs=[*inputs, shared], outputs=outputs)


def _tie(control: str) -> str:
    return f"tie_{control}"


def ties(controls: Sequence[str]) -> list[str]:
    """Residuals without a weight of a plan that branches."""
    return [f"{TREE}.{_tie(c)}" for c in controls]


def scenario_copies(
    plant: Block, laws: Mapping[str, Block], wires: Mapping[str, str], alias: Mapping[str, str],
    factors: Factors,
) -> dict[str, Block]:  # fmt: skip
    """Plant and laws with a column of the scenarios for each state and output."""
    full = {a: n for n, a in alias.items()}
    driven = {n for n in plant.inputs if wires[f"plant.{n}"].startswith(f"{TREE}.")}

    def held(i: int, n: str) -> float:
        return factors[i].get(n, 1.0)

    found = {"plant": _columns(plant, factors, driven, held, own=True)}
    for part, law in laws.items():
        sources = {n: wires[f"{part}.{n}"] for n in law.inputs}
        read = {n for n, source in sources.items() if source.startswith(("plant.", f"{TREE}."))}

        def factor(i: int, n: str, sources: Mapping[str, str] = sources) -> float:
            return factors[i].get(full.get(sources[n], ""), 1.0)

        shares = {"path": 1.0, "final": 1.0, "price": 1 / len(factors)}
        share = shares.get(part, math.sqrt(1 / len(factors)))
        found[part] = _columns(law, factors, read, factor, share)
    return found


def _columns(
    block: Block, factors: Factors, read: set[str], factor: Callable[[int, str], float],
    share: float = 1.0, own: bool = False,
) -> Block:  # fmt: skip
    """The block once per scenario; inputs in ``read`` are columns, the others times a factor.

    With ``own`` the factors are of its parameters too.
    """
    many = len(factors)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        nexts: list[Exprs] = []
        outs: list[Exprs] = []
        free = {n: v for n, v in p.items() if not block.params[n].derived}
        for i in range(many):
            mine = {n: v * factors[i].get(n, 1.0) for n, v in free.items()} if own else free
            given = {n: u[n][i] if n in read else u[n] * factor(i, n) for n in block.inputs}
            states = {n: x[n][i] for n in block.states}
            columns = (block.pack("state", states), block.pack("input", given),
                       block.pack("param", block.derive(mine)))  # fmt: skip
            n, y = block.f(*columns)
            nexts.append(block.unpack("state", n))
            outs.append(block.unpack("output", y))
        return (
            {n: ca.vertcat(*[v[n] for v in nexts]) for n in block.states},
            {n: share * ca.vertcat(*[v[n] for v in outs]) for n in block.outputs},
        )

    wide = (*block.states, *block.outputs, *read)
    signals = [
        replace(s, shape=(many,)) if s.name in wide and s.role != "param" else s
        for s in block.signals
    ]
    return Block(
        block.name, block.kind, body, signals, doc=block.doc, sx=block.sx,
        composition=Composition.around(block, None, by_structure=False),
    )  # fmt: skip
