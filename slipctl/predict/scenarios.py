"""One plan for several plants: scenarios of what is not known, an adhesion or a mass, say.

Each scenario multiplies inputs and parameters of the plant by a factor of its own. All begin at the
measured state and get the same controls; each counts with an equal share of the cost, and limits
are those of every scenario. So the plan is one that does for all of them, without knowing which
will be true: that the next tick measures more, it does not count on.

Every state and output of the plant, and every output of a law, is a column of the scenarios.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs
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


def copied(
    plant: Block, laws: Mapping[str, Block], wires: Mapping[str, str], alias: Mapping[str, str],
    factors: Factors,
) -> dict[str, Block]:  # fmt: skip
    """Plant and laws with a column of the scenarios for each state and output."""
    full = {a: n for n, a in alias.items()}
    found = {"plant": _columns(plant, factors, set(), lambda i, n: factors[i].get(n, 1.0))}
    for part, law in laws.items():
        sources = {n: wires[f"{part}.{n}"] for n in law.inputs}
        read = {n for n, source in sources.items() if source.startswith("plant.")}

        def factor(i: int, n: str, sources: Mapping[str, str] = sources) -> float:
            return factors[i].get(full.get(sources[n], ""), 1.0)

        shares = {"path": 1.0, "final": 1.0, "price": 1 / len(factors)}
        share = shares.get(part, math.sqrt(1 / len(factors)))
        found[part] = _columns(law, factors, read, factor, share)
    return found


def _columns(
    block: Block, factors: Factors, read: set[str], factor: Callable[[int, str], float],
    share: float = 1.0,
) -> Block:  # fmt: skip
    """The block once per scenario; inputs in ``read`` are columns, the others times a factor."""
    many = len(factors)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        nexts: list[Exprs] = []
        outs: list[Exprs] = []
        free = {n: v for n, v in p.items() if not block.params[n].derived}
        for i in range(many):
            mine = {n: v * factors[i].get(n, 1.0) for n, v in free.items()} if not read else free
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
        parts={block.name: block}, transparent=True, sharing=block.sharing.through(),
    )  # fmt: skip
