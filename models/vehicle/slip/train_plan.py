"""Slips of all axles of a train by a plan over the axles, solved anew while it brakes.

Over one rail point the axles pass one after the other at nearly one speed, and they touch no other
point there. So the best of a whole stop is sought point by point. The state is the share q of the
clean curve; it moves from axle to axle, not from tick to tick. With m axles behind,

    V_m(q) = max over e of  f(e, q) + V_(m-1)(q'),    1 - q' = (1 - q) exp(-c tau N f e)

and V_(-1) = 0. f is (1 - q) f_layer + q f_clean, at most what the brake can hold. A tick works out
one V over the nodes of q, at the speed of that tick. A train of n axles has the whole plan anew
after n - 1 ticks, which is a metre or two of way. Each axle then seeks the largest
f + V_m(q') at the share that it measures (:mod:`~slipctl.models.vehicle.slip.train_slip`).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.block.text.expression import interpolated
from slipctl.models.vehicle.slip.train_slip import (
    NODES,
    heights_of_curves,
    largest_ratio,
    learnt_factor,
    numbers_of_cleaning,
    numbers_of_curve,
    roots_of_ratios,
)

LOOKED_AT = 13
"""Slips that are looked at in each node, denser at small ones."""


def train_plan(layer: Block, clean: Block, axles: int, *, learn: bool = False) -> Block:
    """Make the plan of a train.

    Args:
        layer, clean: curves as :func:`~slipctl.models.vehicle.slip.train_slip.train_slip` has them.
        axles: how many are braked, alike.
        learn: take a ``factor`` on the strength too, as
            :func:`~slipctl.models.vehicle.slip.rail_seen.rail_seen` learns it.

    Returns:
        Step from ``v`` to ``value`` and ``rate``. A column of ``value`` is for an axle what those
        behind it transmit together, in adhesions, over the nodes of the share that it leaves;
        shape (nodes, axles). ``rate`` is c tau N.
    """
    curves = (layer, clean)
    known = [numbers_of_curve(c, n) for c, n in zip(curves, ("layer", "clean"), strict=True)]
    numbers = [s.name for rows in known for s in rows.values()]
    heights, stage = _heights(curves, known), _stage()

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v = ca.fmax(ca.fabs(u["v"]), 1.0)
        rate = p["caution"] * p["strength"] * (u["factor"] if learn else 1) * p["load"]
        columns = ca.horzsplit(x["value"])
        behind = columns[-1]  # of the axle whose column is found in this tick
        for k in range(1, axles - 1):
            behind = ca.if_else(x["turn"] == k, columns[k], behind)
        e, low, high = heights(p["slip"], v, ca.vertcat(*[p[n] for n in numbers]))
        found = stage(NODES[None], e, low, high, behind, rate, p["most"]).T
        moved = [ca.if_else(x["turn"] == k + 1, found, columns[k]) for k in range(axles - 1)]
        turn = ca.if_else(x["turn"] > 1, x["turn"] - 1, axles - 1)
        return (
            dict(value=ca.horzcat(*moved, columns[-1]), turn=turn),
            dict(value=x["value"], rate=rate),
        )  # fmt: skip

    value = {"shape": (NODES.size, axles), "lo": 0, "hi": 100.0}
    says = "adhesions of those behind, over the share that an axle leaves"
    return make_block(
        "plan", "step", body, sx=False, doc=__doc__ or "", choices={"axles": axles},
        states=[
            State("1", np.zeros((NODES.size, axles)), says, **value).named("value"),
            State("1", max(axles - 1.0, 0.0), "axle before which a column is found next, from 0",
                  lo=0, hi=max(axles - 1, 1)).named("turn"),
        ],
        inputs=[Input("m/s", "vehicle speed that is believed").named("v"),
                *([learnt_factor()] if learn else [])],
        params=[
            *numbers_of_cleaning(),
            largest_ratio(),
            Param("1", 0.1, "adhesion that the brake can hold", "of the trip", lo=1e-3,
                  hi=2).named("most"),
            *(s for rows in known for s in rows.values()),
        ],
        outputs=[
            Output("1", says, **value).named("value"),
            Output("1", "by what cleaning takes the share down, over adhesion and slip ratio", lo=0,
                   hi=1e6).named("rate"),
        ],
    )  # fmt: skip


def _heights(curves: tuple[Block, Block], known: list[dict[str, Param]]) -> ca.Function:
    """Function (slip, v, numbers) -> slip ratios that are looked at, and both curves there."""
    slip, v = ca.SX.sym("slip"), ca.SX.sym("v")
    numbers = [s.name for rows in known for s in rows.values()]
    values = ca.SX.sym("numbers", len(numbers))
    p = dict(zip(numbers, ca.vertsplit(values), strict=True))
    roots = roots_of_ratios(slip, LOOKED_AT)
    rows = [heights_of_curves(curves, known, p, z * z, v) for z in roots]
    return ca.Function(
        "heights", [slip, v, values],
        [ca.vertcat(*[z * z for z in roots]), *(ca.vertcat(*r) for r in zip(*rows, strict=True))],
        {"cse": True},
    )  # fmt: skip


def _stage() -> ca.Function:
    """Function of all nodes -> V there, from the ratios, both curves, and V of the axle behind."""
    q, rate, most = (ca.SX.sym(n) for n in ("q", "rate", "most"))
    e, low, high = (ca.SX.sym(n, LOOKED_AT) for n in ("e", "low", "high"))
    behind = ca.SX.sym("behind", NODES.size)
    f = ca.fmin(ca.fmax((1 - q) * low + q * high, 0), most)
    after = 1 - (1 - q) * ca.exp(-rate * f * e)
    worth = [f[k] + interpolated(after[k], NODES, behind) for k in range(LOOKED_AT)]
    one = ca.Function("node", [q, e, low, high, behind, rate, most], [ca.mmax(ca.vertcat(*worth))],
                      {"cse": True})  # fmt: skip
    return one.map(f"node_x{NODES.size}", "serial", NODES.size, [1, 2, 3, 4, 5, 6], [])
