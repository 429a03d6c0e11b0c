"""What the axles of a train see of the rail: a field under the train, and how well wheels clean.

The field has cells that move back under the train. Each holds three numbers. They are the share q
of the clean curve as the last axle over it measured, and that of the first axle. The third is the
energy W that wheels have left since. Each axle that passes adds joule per metre of one rail:

    W <- W + N mu v_s/v

Where axle k finds more than the first one did, wheels have cleaned. With q = 1 - exp(-tau W),

    ln((1 - q_1)/(1 - q_k)) = tau W

Least squares over the last T_tau seconds give tau. Each sample is weighed by its (1 - q_k)^2, as an
error of q is one of 1/(1 - q) there. The strength that is believed before counts like W = ``sure``
for that time. A curve of the layer that is believed wrong errs alike for both axles, so most of
that cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.slip.train_slip import heights_of_curves, numbers_of_curve

CELL = 1.0
"""Length of a cell of the field in m, at most; half the least distance of two axles if less."""

APART = 0.02
"""Difference of both curves below which a sample says nothing of the rail."""

FARTHEST = 1e3
"""Distance in m to cleaner rail where nobody has seen any."""

CLEAN = 0.9
"""Share of the clean curve above which a sample says nothing of the strength."""


def rail_seen(layer: Block, clean: Block, behind: Sequence[float]) -> Block:
    """Make the field of the rail as the axles of a train see it.

    Args:
        layer, clean: curves as :func:`~slipctl.models.vehicle.slip.train_slip.train_slip` has them.
        behind: place of each axle behind the first one in m, rising from 0.

    Returns:
        Step from ``v``, and ``mu`` and ``v_s`` of each axle measured in the same window, to
        ``ahead``, the distance of each axle to cleaner rail in m, and ``factor`` on the strength of
        the cleaning that is believed.
    """
    at = np.asarray(behind, dtype=float)
    n, length = at.size, min(CELL, float(np.diff(at).min()) / 2 if at.size > 1 else CELL)
    whole = np.floor(at / length).astype(int)
    rest, cells = at / length - whole, int(whole[-1]) + 2
    curves = (layer, clean)
    known = [numbers_of_curve(c, m) for c, m in zip(curves, ("layer", "clean"), strict=True)]

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v, slips = ca.fmax(ca.fabs(u["v"]), 1.0), ca.fmax(u["v_s"], 0)
        keep, kept = ca.fmin(p["T"] / p["T_f"], 1), ca.fmin(p["T"] / p["T_tau"], 1)
        seen, first, energy = (ca.vertsplit(x[k]) for k in ("seen", "first", "energy"))
        before, gaps = list(seen), []
        product, square = x["product"] * (1 - kept), x["square"] * (1 - kept)
        for k, j in enumerate(map(int, whole)):
            low, high = heights_of_curves(curves, known, p, slips[k] / v, v)
            says = high - low > APART
            share = (u["mu"][k] - low) / ca.fmax(high - low, APART)
            share = ca.fmin(ca.fmax(share, 0), 1)
            left = p["load"] * ca.fmax(u["mu"][k], 0) * slips[k] / v * ca.fabs(u["v"]) * p["T"]
            late = rest[k] >= x["phase"]
            own, found = (ca.if_else(late, a[j + 1], a[j]) for a in (before, first))
            if k:  # of the cell ahead, as it has left some of its own here
                W = ca.if_else(late, energy[j], energy[j - 1])
                rose = ca.log(ca.fmax(1 - found, 0.01) / ca.fmax(1 - share, 0.01))
                level = ca.fabs(share - own) < p["rise"]  # at an end of the layer it is not
                able = ca.logic_and(ca.logic_and(says, level), ca.fmax(share, found) < CLEAN)
                weight = ca.if_else(able, (1 - share) ** 2, 0) * kept * p["tau_0"] * W
                product, square = product + weight * rose, square + weight * p["tau_0"] * W
            for cell, here in ((j, ca.logic_not(late)), (j + 1, late)):
                told = ca.logic_and(says, here)
                moved = seen[cell] + keep * (share - seen[cell])
                seen[cell] = ca.if_else(told, moved, seen[cell])
                if not k:
                    first[cell] = ca.if_else(told, moved, first[cell])
                energy[cell] = energy[cell] + ca.if_else(here, left / length, 0)
            gap = FARTHEST
            for cell in range(j + 1):  # from the first axle back to this one
                place = rest[k] + j - x["phase"] - cell
                nearer = ca.logic_and(before[cell] - own > p["rise"], place >= 0)
                gap = ca.if_else(nearer, length * place, gap)
            gaps.append(gap)
        prior = (p["tau_0"] * p["sure"]) ** 2
        factor = ca.fmin(ca.fmax((x["product"] + prior) / (x["square"] + prior), 1 / p["most"]),
                         p["most"])  # fmt: skip
        phase = x["phase"] + ca.fmin(ca.fabs(u["v"]) * p["T"] / length, 1)
        enters = phase >= 1

        def shifted(rows: list[Any], begin: Any) -> Any:
            moved = zip(rows, [begin, *rows[:-1]], strict=True)
            return ca.vertcat(*[ca.if_else(enters, new, old) for old, new in moved])

        # the first cell begins as what is behind it
        following = dict(
            seen=shifted(seen, first[0]), first=shifted(first, first[0]),
            energy=shifted(energy, 0), phase=ca.fmax(phase - enters, 0),
            product=product, square=square,
        )  # fmt: skip
        return following, dict(ahead=ca.vertcat(*gaps), factor=factor)

    return make_block("rail", "step", body, **_signals(n, cells, known), doc=__doc__ or "",
                      choices={"axles": n, "cells": cells, "cell in m": length})  # fmt: skip


def _signals(n: int, cells: int, known: list[dict[str, Param]]) -> dict[str, list[Any]]:
    """Signals of the field by role; known: numbers of both curves."""
    each, field = {"shape": (n,)}, {"shape": (cells,)}
    share = "share of the clean curve, from the first axle back, as seen"
    return dict(
        states=[
            State("1", np.ones(cells), f"{share} last", lo=0, hi=1, **field).named("seen"),
            State("1", np.ones(cells), f"{share} by the first axle", lo=0, hi=1,
                  **field).named("first"),
            State("J/m", np.zeros(cells), "energy that wheels have left since, on one rail", lo=0,
                  hi=1e9, **field).named("energy"),
            State("1", 0.0, "share of the first cell that is passed", lo=0, hi=1).named("phase"),
            State("1", 0.0, "product of what was cleaned and its energy", lo=-1e12,
                  hi=1e12).named("product"),
            State("1", 0.0, "square of that energy", lo=0, hi=1e12).named("square"),
        ],
        inputs=[
            Input("m/s", "vehicle speed that is believed").named("v"),
            Input("1", "mean adhesion over a window", positive="braking", **each).named("mu"),
            Input("m/s", "mean slip speed over it", positive="braking", per="speed",
                  **each).named("v_s"),
        ],
        params=[
            Param("1", 0.3, "by how much a place has to be cleaner", ADDED, lo=0.01,
                  hi=1).named("rise"),
            Param("m/J", 1e-4, "strength of the cleaning, as believed", "of the trip", lo=1e-9,
                  hi=1).named("tau_0"),
            Param("J/m", 300.0, "energy like which that counts", ADDED, lo=1, hi=1e9).named("sure"),
            Param("1", 3.0, "factor within which it is known", "of the trip", lo=1,
                  hi=100).named("most"),
            Param("N", 6e4, "load of a wheel", ADDED, lo=500, hi=5e5).named("load"),
            Param("s", 0.03, "time over which a cell is learnt", ADDED, lo=1e-3,
                  hi=1).named("T_f"),
            Param("s", 10.0, "time over which the strength is learnt", ADDED, lo=1e-2,
                  hi=1e3).named("T_tau"),
            Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1).named("T"),
            *(s for rows in known for s in rows.values()),
        ],
        outputs=[
            Output("m", "distance to cleaner rail", lo=0, hi=FARTHEST, **each).named("ahead"),
            Output("1", "factor on the strength of the cleaning", lo=0, hi=100).named("factor"),
        ],
    )  # fmt: skip
