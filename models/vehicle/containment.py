"""A block of one axle whose states leave their ranges begins anew; no other axle waits for it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from slipctl import Block, Output
from slipctl.block.block import Exprs
from slipctl.block.fields import Composition, LawData

NO_END = 1e300
"""End of a range that has none."""


def contained_block(block: Block) -> Block:
    """Run a step block, and begin it anew where a next state would leave its range.

    In such a tick its outputs are zero and ``sound`` is 0. So what goes wrong in the slip control
    of one axle ends there: no other axle waits for it, and no generated guard has to refuse a tick.

    Args:
        block: a step; ends of ranges that are expressions are left to the generated guards.
    """
    states = list(block.states.values())
    low = ca.DM(np.concatenate([[], *(np.full(s.size, max(s.lo, -NO_END)) for s in states)]))
    high = ca.DM(np.concatenate([[], *(np.full(s.size, min(s.hi, NO_END)) for s in states)]))
    chosen = block.of_equations("contained", lambda: _kept_or_begun(block.f))

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        now = block.pack("param", p)
        nxt, y = block.f(block.pack("state", x), block.pack("input", u), now)
        sound = ca.dot(nxt >= low, nxt <= high) >= low.numel()
        nxt, y = chosen(sound, nxt, y, block.pack("state", block.symbolic_start(p)))
        return block.unpack("state", nxt), block.unpack("output", y) | {"sound": sound}

    def rebuild(parts: dict[str, Block]) -> Block:
        return contained_block(parts[block.name])

    sound = Output("1", "1 where its states are in their ranges", lo=0, hi=1).named("sound")
    wide = [replace(s, lo=min(s.lo, 0.0), hi=max(s.hi, 0.0)) for s in block.outputs.values()]
    return Block(
        block.name, "step", body,
        [*states, *block.inputs.values(), *block.params.values(), *wide, sound],
        period=block.period, sx=False,
        doc=f"{block.doc}\n\nIt begins anew where a state leaves its range.",
        choices=block.choices | {"contained": True}, conditions=block.conditions,
        composition=Composition.around(block, rebuild),
        law_data=LawData(failures=[
            ("a state of an axle's law leaves its range", "each tick; `law.sound`",
             "that law begins anew, its axle gets the demand in that tick", "", "one tick"),
        ]),
    )  # fmt: skip


def _kept_or_begun(f: ca.Function) -> ca.Function:
    """Function (sound, next, y, start) -> (next, y): as they are, or the start and zero."""
    x, start = ca.MX.sym("x", f.size1_out(0)), ca.MX.sym("s", f.size1_out(0))
    y = ca.MX.sym("y", f.size1_out(1))
    kept = ca.Function(f"{f.name()}_kept", [x, y, start], [x, y])
    begun = ca.Function(f"{f.name()}_begun", [x, y, start], [start, ca.DM.zeros(f.size1_out(1))])
    return ca.Function.if_else(f"{f.name()}_contained", kept, begun)
