"""What leading axles have seen of the rail, and a brake that is full where the layer ends.

The field of the rail under the train is the state: share q of the clean curve by cells, each as the
last axle over it measured. It moves back under the train as the train moves on. An axle that slides
on the layer looks along the field to the first place that is cleaner, at the distance d. A cylinder
needs longer to fill than the axle to get there, so it has to begin on the layer, where the wheel
then slides more. With the brake filling from now on at the rate R of its force, the slip there is

    s(t) = s + R t^2/(2 J/r^2),    t = d/v - t_0 with the dead time t_0

The plan has one number for each axle, when to fill, and is solved anew in each tick: the earliest
time is best, as long as s(t) stays within the limit of the slip. So an axle fills as soon as it
can. It does so by its reference, which goes to the limit, and back once the wheel has run up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.slip.train_slip import heights_of_curves, numbers_of_curve

CELL = 1.0
"""Length of a cell of the field in m, at most; half the distance of two axles where that is less."""

APART = 0.02
"""Difference of both curves below which a sample says nothing of the rail."""

NOWHERE = 1e3
"""Distance in cells to a place that is not there."""

LONGEST = 1.5
"""Time in s after which an axle goes back to its own slip, wherever it is."""


def rail_ahead(layer: Block, clean: Block, behind: Sequence[float]) -> Block:
    """Make the part that lets axles fill before the layer ends; see the module.

    Args:
        layer, clean: curves as :func:`~slipctl.models.vehicle.slip.train_slip.train_slip` has them.
        behind: place of each axle behind the first one in m, rising from 0.

    Returns:
        Step from ``v``, and of each axle ``mu`` and ``v_s`` measured in the same window and
        ``own``, the slip of its law, to ``v_best`` of each in m/s, and ``ahead``, the distance in
        m to cleaner rail.
    """
    at = np.asarray(behind, dtype=float)
    n, length = at.size, min(CELL, float(np.diff(at).min()) / 2 if at.size > 1 else CELL)
    whole = np.floor(at / length).astype(int)
    rest, cells = at / length - whole, int(whole[-1]) + 2
    known = [numbers_of_curve(c, m) for c, m in zip((layer, clean), ("layer", "clean"), strict=True)]

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v, v_s = ca.fmax(ca.fabs(u["v"]), 1.0), ca.fmax(u["v_s"], 0)
        keep = ca.fmin(p["T"] / p["T_f"], 1)
        q, field = ca.vertsplit(x["seen"]), ca.vertsplit(x["seen"])
        own, there = [], []
        for k in range(n):
            low, high = heights_of_curves((layer, clean), known, p, v_s[k] / v, v)
            apart = high - low
            says = apart > APART
            share = ca.fmin(ca.fmax((u["mu"][k] - low) / ca.fmax(apart, APART), 0), 1)
            late = rest[k] >= x["phase"]
            j = int(whole[k])
            own.append(ca.if_else(late, q[j + 1], q[j]))
            there.append(late)
            for cell, here in ((j, ca.logic_not(late)), (j + 1, late)):
                told = ca.logic_and(says, here)
                field[cell] = ca.if_else(told, field[cell] + keep * (share - field[cell]),
                                         field[cell])  # fmt: skip
        best, gaps, timers = [], [], []
        for k in range(n):
            gap = NOWHERE
            for j in range(int(whole[k]) + 1):  # from the first axle back to this one
                before = j < whole[k] if j < whole[k] else there[k]
                nearer = ca.logic_and(before, q[j] - own[k] > p["rise"])
                gap = ca.if_else(nearer, rest[k] + whole[k] - x["phase"] - j, gap)
            time = ca.fmax(gap * length / v - p["dead"], 0)
            slip = v_s[k] + p["rate"] * p["r"] * time**2 / (2 * p["J"])
            limit = ca.fmax(p["slip"] * v, u["own"][k])
            begins = ca.logic_and(gap < NOWHERE, slip <= limit)
            stays = ca.logic_and(x["raised"][k] > 0, v_s[k] > u["own"][k])
            on = ca.logic_and(ca.logic_or(begins, stays), x["raised"][k] < LONGEST)
            again = ca.logic_or(begins, stays)
            timers.append(ca.if_else(again, ca.fmin(x["raised"][k] + p["T"], LONGEST), 0))
            best.append(ca.if_else(on, limit, u["own"][k]))
            gaps.append(length * gap)
        phase = x["phase"] + ca.fmin(ca.fabs(u["v"]) * p["T"] / length, 1)
        enters = phase >= 1
        moved = [field[0], *field[:-1]]  # the first cell begins as what is behind it
        following = dict(
            seen=ca.vertcat(*[ca.if_else(enters, b, a)
                              for a, b in zip(field, moved, strict=True)]),
            phase=ca.fmax(phase - enters, 0), raised=ca.vertcat(*timers),
        )  # fmt: skip
        return following, dict(v_best=ca.vertcat(*best), ahead=ca.vertcat(*gaps))

    each = {"shape": (n,)}
    return make_block(
        "ahead", "step", body,
        states=[
            State("1", np.ones(cells), "share of the clean curve, from the first axle back", lo=0,
                  hi=1, shape=(cells,)).named("seen"),
            State("1", 0.0, "share of the first cell that is passed", lo=0, hi=1).named("phase"),
            State("s", np.zeros(n), "time for which an axle has been filled ahead", lo=0,
                  hi=LONGEST, **each).named("raised"),
        ],
        inputs=[
            Input("m/s", "vehicle speed that is believed").named("v"),
            Input("1", "mean adhesion over a window", positive="braking", **each).named("mu"),
            Input("m/s", "mean slip speed over it", positive="braking", per="speed",
                  **each).named("v_s"),
            Input("m/s", "slip by the law of the axle", positive="braking", per="speed",
                  **each).named("own"),
        ],
        params=[
            Param("1", 0.3, "largest slip over speed", "of the trip", lo=0.02,
                  hi=0.9).named("slip"),
            Param("1", 0.3, "by how much a place has to be cleaner", ADDED, lo=0.01,
                  hi=1).named("rise"),
            Param("N m/s", 8e3, "rate of the torque of a brake that fills", "of the trip", lo=1,
                  hi=1e7).named("rate"),
            Param("s", 0.06, "dead time of the brake", "of the trip", lo=0, hi=1).named("dead"),
            Param("s", 0.03, "time over which a cell is learnt", ADDED, lo=1e-3,
                  hi=1).named("T_f"),
            Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5).named("J"),
            Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1).named("r"),
            Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1).named("T"),
            *(s for rows in known for s in rows.values()),
        ],
        outputs=[
            Output("m/s", "slip to go to", positive="braking", per="speed",
                   **each).named("v_best"),
            Output("m", "distance to cleaner rail", **each).named("ahead"),
        ],
        doc=__doc__ or "", choices={"axles": n, "cells": cells, "cell in m": length},
    )  # fmt: skip
