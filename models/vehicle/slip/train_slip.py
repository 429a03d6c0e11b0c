"""Slip of an axle by what it rubs off the rail for the axles behind it.

An axle with m axles behind it goes to the slip ratio e that has the largest

    ln f(e) + m k (1 - f(e)/mu_r) e,    k = c tau N (mu_r - mu_d)

A search of the peak has the first term alone; see models/wheel_rail/train_optimum.py. f is what
the axle finds: (1 - q) f_layer + q f_clean of two known curves. It learns q by itself, from the
adhesion that it measures: least squares over the last T_f seconds. Where both curves are alike
nothing is learnt, and q goes to 0. mu_d and mu_r are the peaks of both curves at this speed. c is
caution: the share of a strength tau that can be counted on if it is known within a factor alone.

With a plan the axle seeks the largest f(e) + V(q') instead. V is what the axles behind transmit on
the share q' that it leaves, as :mod:`~slipctl.models.vehicle.slip.train_plan` finds it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.block.text.expression import interpolated
from slipctl.models.common_form import ADDED, T_S

POINTS = 25
"""Slips that are looked at, denser at small ones; then the vertex of the parabola at the best."""

LEAST_RATIO = 1e-3
"""Smallest slip ratio that is looked at."""

NODES = np.linspace(0.0, 1.0, 17)
"""Shares of the clean curve at which a plan has its values."""

NEARLY_ALIKE = 3e-3
"""Difference of both curves below which a sample says nothing of the share."""


def numbers_of_curve(curve: Block, name: str) -> dict[str, Param]:
    """Numbers of a curve as parameters of a block that has it inside, by the curve's own names."""
    return {
        k: replace(s, name=f"{name}_{k.replace('.', '_')}", value=float(s.value))
        for k, s in curve.params.items() if not s.derived
    }  # fmt: skip


def heights_of_curves(
    curves: Sequence[Block], known: Sequence[Mapping[str, Param]], p: Exprs, e: Any, v: Any
) -> tuple[Any, Any]:
    """Adhesion under the layer and without it at a slip ratio, braking positive.

    Args:
        curves: both. known: numbers of each, by :func:`numbers_of_curve`.
        p: their values. e: slip ratio. v: speed in m/s.
    """
    low, high = (
        -curve.expr({}, {"v_s": -e * v, "v": v}, {k: p[s.name] for k, s in rows.items()})[1]["mu"]
        for curve, rows in zip(curves, known, strict=True)
    )
    return low, high


def train_slip(layer: Block, clean: Block, *, learn: bool = False, plan: bool = False) -> Block:
    """Make the slip reference of an axle that cleans for those behind it.

    Args:
        layer, clean: curves under the layer and without it as the controller believes them, from
            ``v_s`` and ``v`` to ``mu``, traction positive.
        learn: take a ``factor`` on the strength too, as
            :func:`~slipctl.models.vehicle.slip.rail_seen.rail_seen` learns it.
        plan: take ``value`` and ``rate`` of a plan in place of a strength and the axles behind.

    Returns:
        Step from ``v``, and ``mu`` and ``v_s`` measured in the same window, to ``v_best`` in m/s
        and ``share``, what the axle has learnt of q.
    """
    curves = (layer, clean)
    known = [numbers_of_curve(c, n) for c, n in zip(curves, ("layer", "clean"), strict=True)]

    def heights(p: Exprs, e: Any, v: Any) -> tuple[Any, Any]:
        return heights_of_curves(curves, known, p, e, v)

    def learnt(x: Exprs, u: Exprs, p: Exprs, v: Any) -> tuple[Any, Any]:
        """Product and square of the difference of both curves, over the last T_f seconds."""
        e = ca.fmax(u["v_s"], 0) / v
        low, high = heights(p, e, v)
        apart, keep = high - low, ca.fmin(p["T"] / p["T_f"], 1)
        return (x["product"] + keep * (apart * (u["mu"] - low) - x["product"]),
                x["square"] + keep * (apart * apart - x["square"]))  # fmt: skip

    def best_ratio(u: Exprs, p: Exprs, v: Any, share: Any) -> Any:
        """Slip ratio of the largest worth."""
        root = roots_of_ratios(p["slip"], POINTS)
        rows = [heights(p, z * z, v) for z in root]
        mu_d, mu_r = (
            ca.mmax(ca.vertcat(*[r[0] for r in rows])),
            ca.mmax(ca.vertcat(*[r[1] for r in rows])),
        )

        def by_plan(low: Any, high: Any, z: Any) -> Any:
            f = (1 - share) * low + share * high
            left = (1 - share) * ca.exp(-u["rate"] * ca.fmax(f, 0) * z * z)
            return f + interpolated(1 - left, NODES, u["value"])

        def by_law(low: Any, high: Any, z: Any) -> Any:
            factor = u["factor"] if learn else 1
            k = p["caution"] * p["strength"] * factor * p["load"] * ca.fmax(mu_r - mu_d, 0)
            f = ca.fmax((1 - share) * low + share * high, 1e-4)
            return ca.log(f) + p["behind"] * k * ca.fmax(1 - f / mu_r, 0) * z * z

        worth = by_plan if plan else by_law
        values = [worth(*row, z) for row, z in zip(rows, root, strict=True)]
        place, height = root[0], values[0]
        for z, value in zip(root[1:], values[1:], strict=True):
            better = value > height
            place, height = ca.if_else(better, z, place), ca.if_else(better, value, height)
        step = root[1] - root[0]
        before, after = (worth(*heights(p, (place + d) ** 2, v), place + d) for d in (-step, step))
        bend = before - 2 * height + after
        moved = ca.if_else(bend < 0, step * (before - after) / (2 * ca.fmin(bend, -1e-12)), 0)
        z = ca.fmin(place + ca.fmax(ca.fmin(moved, step), -step), root[-1])
        return z * z

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v = ca.fmax(ca.fabs(u["v"]), 1.0)
        product, square = learnt(x, u, p, v)
        share = ca.fmin(ca.fmax(product / (square + NEARLY_ALIKE**2), 0), 1)
        e = best_ratio(u, p, v, share)
        e = ca.if_else(x["begun"] > 0.5, x["e"] + ca.fmin(p["T"] / p["T_e"], 1) * (e - x["e"]), e)
        return (
            dict(product=product, square=square, e=e, begun=1),
            dict(v_best=ca.fmax(e * ca.fabs(u["v"]), p["least"]), share=share),
        )  # fmt: skip

    return make_block(
        "reference",
        "step",
        body,
        **_signals(known, learn, plan),
        doc=__doc__ or "",
    )


def roots_of_ratios(slip: Any, many: int) -> list[Any]:
    """Roots of the slip ratios that are looked at, up to the largest, denser at small ones."""
    low = LEAST_RATIO**0.5
    return [low + k * (slip**0.5 - low) / (many - 1) for k in range(many)]


def numbers_of_cleaning() -> list[Param]:
    """What is believed of the cleaning: c tau N."""
    return [
        Param("m/J", 1e-4, "strength of the cleaning, as believed", "of the trip", lo=0,
              hi=1).named("strength"),
        Param("1", 1.0, "share of it that is counted on", "of the trip", lo=0,
              hi=1).named("caution"),
        Param("N", 6e4, "load of a wheel", ADDED, lo=500, hi=5e5).named("load"),
    ]  # fmt: skip


def largest_ratio() -> Param:
    """Limit of the slip over the speed."""
    return Param("1", 0.3, "largest slip over speed", "of the trip", lo=0.02, hi=0.9).named("slip")


def learnt_factor() -> Input:
    """Factor on the strength."""
    return Input("1", "factor on the strength, as it is learnt").named("factor")


def _signals(known: list[dict[str, Param]], learn: bool, plan: bool) -> dict[str, list[Any]]:
    """Signals of the reference by role.

    Args:
        known: numbers of both curves. learn: whether the strength has a factor.
        plan: whether a plan stands for all that is known of the axles behind.
    """
    of_plan = [
        Input("1", "adhesions of those behind, over the share that it leaves",
              shape=NODES.shape).named("value"),
        Input("1", "by what cleaning takes the share down, over adhesion and slip ratio").named(
            "rate"),
    ]  # fmt: skip
    of_law = [
        Param("1", 0.0, "braked axles behind this one", ADDED, lo=0, hi=31).named("behind"),
        *numbers_of_cleaning(),
    ]
    return dict(
        states=[
            State("1", 0.0, "product of what was measured and the difference of both curves",
                  lo=-4, hi=4).named("product"),
            State("1", 0.0, "square of that difference", lo=0, hi=4).named("square"),
            State("1", 0.0, "slip over speed", lo=0, hi=0.9).named("e"),
            State("1", 0.0, "1 from the second tick on", lo=0, hi=1).named("begun"),
        ],
        inputs=[
            Input("m/s", "vehicle speed that is believed").named("v"),
            Input("1", "mean adhesion over a window", positive="braking").named("mu"),
            Input("m/s", "mean slip speed over it", positive="braking", per="speed").named("v_s"),
            *(of_plan if plan else [learnt_factor()] if learn else []),
        ],
        params=[
            *([] if plan else of_law),
            largest_ratio(),
            Param("m/s", 0.2, "slip that it does not fall below", "of the trip", lo=0.01,
                  hi=5).named("least"),
            Param("s", 0.5, "time over which the share is learnt", ADDED, lo=1e-3,
                  hi=60).named("T_f"),
            Param("s", 0.2, "time in which the slip follows", ADDED, lo=1e-3, hi=60).named("T_e"),
            Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1).named("T"),
            *(s for rows in known for s in rows.values()),
        ],
        outputs=[
            Output("m/s", "slip to go to", positive="braking", per="speed").named("v_best"),
            Output("1", "share of the clean curve that it has learnt", lo=0, hi=1).named("share"),
        ],
    )  # fmt: skip
