"""A flow over distance in place of time: speed profiles, gradients and limits along it."""

from __future__ import annotations

import casadi as ca

from slipctl.block.block import Block, Exprs, as_block
from slipctl.block.fields import Composition
from slipctl.block.signals import State
from slipctl.block.units.unit_algebra import dimension_equal
from slipctl.errors import BadInput, check_positive


def over_distance(plant: Block, speed: str = "v", least: float = 0.1) -> Block:
    """The same flow over distance in place of time: a second of it is a metre of the way.

    Every rate is divided by the speed, dx/ds = f(x, u, p)/v, so steps, horizons and durations of
    what is made of it are metres. Gradients and speed limits become inputs that are known ahead. A
    further state ``clock`` is the time.

    Args:
        plant: a flow. speed: its state that is the speed, in m/s.
        least: speed in m/s below which it counts as this one: a train at rest covers no distance.

    Raises:
        BadInput: no flow, no scalar state of a speed, a least speed that is not positive.
    """
    block = as_block("over_distance: the plant", plant)
    where = f"over_distance({block.name})"
    if block.kind != "flow":
        raise BadInput(f"{where}: it is a {block.kind}; give the flow, not yet sampled")
    name = block.find(speed, "state")
    s = block.states[name]
    if s.shape != () or not dimension_equal(s.unit, "m/s"):
        raise BadInput(f"{where}: {name} [{s.unit}] is no speed; name a scalar state in m/s")
    if "clock" in block.states:
        raise BadInput(f"{where}: it has a state clock; rename it")
    check_positive(f"{where}: least", least, "m/s")

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        own = {n: x[n] for n in block.states}
        columns = (block.pack("state", own), block.pack("input", u), block.pack("param", p))
        n, y = block.f(*columns)
        v = ca.fmax(x[name], least)
        rates = {k: value / v for k, value in block.unpack("state", n).items()}
        return rates | {"clock": 1 / v}, block.unpack("output", y)

    clock = State("s", 0.0, "time since the start").named("clock")
    return Block(
        block.name, "flow", body, [*block.signals, clock], doc=f"{block.doc}\n\nOver distance.",
        sx=block.sx, choices=block.choices, conditions=block.conditions,
        composition=Composition.around(
            block, lambda parts: over_distance(parts[block.name], speed, least),
            own=frozenset({"clock"}),
        ),
    )  # fmt: skip
