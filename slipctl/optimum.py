"""The best argument of a law: the CasADi reference that validates every online search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block import Block, Exprs, make_block
from slipctl.errors import BadInput, nearest
from slipctl.signals import Output, Param

GRID = 200
"""Intervals of the grid that brackets the peak."""


class Peak(NamedTuple):
    """Peak of a law.

    Attributes:
        location: argument of the peak, in its unit.
        value: objective there.
        bracket: interval that holds the location.
        method: ``"closed form"``, ``"newton"``, or ``"bound"`` for a peak at the end of the range.
    """

    location: float
    value: float
    bracket: tuple[float, float]
    method: str


def argmax(
    law: Block,
    over: str,
    maximise: str | None = None,
    *,
    lo: float,
    hi: float,
    at: Mapping[str, float] | None = None,
    closed_form: bool = True,
) -> Peak:
    """Find the peak of a law over one input.

    The law's closed form is taken where it declares one and the peak lies in the range. Otherwise
    the best point of a grid brackets the peak, and Newton's method on the exact derivative,
    replaced by bisection where it would leave the bracket, closes in on it to rounding.

    Args:
        law: a law.
        over: input that is varied.
        maximise: output that is maximised; may be left out if there is only one.
        lo, hi: range of the input, in its unit.
        at: values of other inputs and of parameters; those not given have their own.
        closed_form: False to leave the closed form aside, to check it.

    Raises:
        BadInput: unknown names, an empty range, or an input without value.
    """
    where = f"argmax({law.name})"
    if not (math.isfinite(lo) and math.isfinite(hi) and lo < hi):
        raise BadInput(f"{where}: range {lo:g} to {hi:g} is none; give lo < hi")
    value, slope, p = _functions(where, law, over, maximise, dict(at or {}))
    if closed_form and law.closed_form is not None:
        params = law.param_values(**{k: v for k, v in (at or {}).items() if k in law.params})
        free = {k: float(v) for k, v in params.items() if not law.params[k].derived}
        place = float(law.closed_form(**free))
        if lo <= place <= hi:
            return Peak(place, float(value(place, p)), (place, place), "closed form")
    grid = np.linspace(lo, hi, GRID + 1)
    heights = np.array(ca.DM(value.map(grid.size)(grid[None], p)).full()).ravel()
    best = int(np.argmax(heights))
    a, b = grid[max(best - 1, 0)], grid[min(best + 1, GRID)]
    if best == 0 and float(slope(lo, p)[0]) <= 0:
        return Peak(lo, float(heights[0]), (lo, lo), "bound")
    if best == GRID and float(slope(hi, p)[0]) >= 0:
        return Peak(hi, float(heights[-1]), (hi, hi), "bound")
    x = float(grid[best])
    for _ in range(200):
        d, d2 = (float(v) for v in slope(x, p))
        a, b = (x, b) if d > 0 else (a, x)
        following = x - d / d2 if d2 < 0 else math.inf
        if not a < following < b:
            following = (a + b) / 2
        if following == x or b - a <= 4 * np.spacing(abs(x)):
            break
        x = following
    return Peak(x, float(value(x, p)), (float(a), float(b)), "newton")


def argmax_block(
    law: Block, over: str, maximise: str | None = None, *, lo: float, hi: float, points: int = 32,
    newton: int = 6,
) -> Block:  # fmt: skip
    """Make a law that finds the peak online: a grid, then safeguarded Newton steps.

    Args:
        law: a law of scalar expressions.
        over: input that is varied.
        maximise: output that is maximised; may be left out if there is only one.
        lo, hi: range of the input, in its unit.
        points: points of the grid, the ends included.
        newton: Newton steps, each replaced by bisection where it would leave the bracket.

    Returns:
        A law. Inputs: the law's parameters and its other inputs. Outputs: ``best`` and ``value``.

    Raises:
        BadInput: unknown names, an empty range, or too few points.
    """
    from slipctl.seek import objective, open_law

    where = f"argmax_block({law.name})"
    maximise = objective(where, law, over, maximise)
    if not (math.isfinite(lo) and math.isfinite(hi) and lo < hi):
        raise BadInput(f"{where}: range {lo:g} to {hi:g} is none; give lo < hi")
    if points != int(points) or points < 3 or newton != int(newton) or newton < 0:
        raise BadInput(
            f"{where}: points = {points}, newton = {newton}; give points >= 3, newton >= 0"
        )
    given, value_of = open_law(law, over, maximise)
    z, g = ca.SX.sym("z"), ca.SX.sym("g", value_of.size1_in(1))
    d = ca.jacobian(value_of(z, g), z)
    slope = ca.Function("slope", [z, g], [d, ca.jacobian(d, z)], {"cse": True})
    x = law.inputs[over]

    def body(xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        at = ca.vertcat(*[u[s.name] for s in given])
        step = (p["hi"] - p["lo"]) / (points - 1)
        place, height = p["lo"], value_of(p["lo"], at)
        for k in range(1, int(points)):
            there = p["lo"] + k * step
            value = value_of(there, at)
            better = value > height
            place, height = ca.if_else(better, there, place), ca.if_else(better, value, height)
        a, b = ca.fmax(place - step, p["lo"]), ca.fmin(place + step, p["hi"])
        for _ in range(int(newton)):
            d1, d2 = slope(place, at)
            a, b = ca.if_else(d1 > 0, place, a), ca.if_else(d1 > 0, b, place)
            following = place - d1 / ca.fmin(d2, -1e-300)
            inside = ca.logic_and(ca.logic_and(following >= a, following <= b), d2 < 0)
            place = ca.if_else(inside, following, (a + b) / 2)
        return {}, {"best": place, "value": value_of(place, at)}

    return make_block(
        "argmax", "law", body, inputs=given,
        params=[
            Param(x.unit, float(lo), "lowest").named("lo"),
            Param(x.unit, float(hi), "highest").named("hi"),
        ],
        outputs=[
            Output(x.unit, f"best {x.doc}", positive=x.positive, per=x.per).named("best"),
            law.outputs[maximise].as_role("output", doc="value there").named("value"),
        ],
        choices={"law": law.name, "over": over, "points": int(points), "newton": int(newton)},
        doc=argmax_block.__doc__ or "",
    )  # fmt: skip


def _functions(
    where: str, law: Block, over: str, maximise: str | None, at: dict[str, float]
) -> tuple[ca.Function, ca.Function, Any]:
    """Objective and (first, second derivative) as functions of (place, fixed values), and these."""
    from slipctl.seek import objective, open_law

    maximise = objective(where, law, over, maximise)
    given, value_of = open_law(law, over, maximise)
    names = [s.name for s in given]
    for k in at:
        if k not in names:
            raise BadInput(f"{where} has no input or parameter {k!r}{nearest(k, names)}")
    params = law.param_values(**{k: v for k, v in at.items() if k in law.params})
    fixed = []
    for s in given:
        value = params.get(s.name, at.get(s.name, s.value))
        if value is None:
            raise BadInput(f"{where}: give at={{{s.name!r}: ...}} in {s.unit}")
        fixed.append(float(value))
    z, g = ca.SX.sym("z"), ca.SX.sym("g", len(fixed))
    y = value_of(z, g)
    d = ca.jacobian(y, z)
    value = ca.Function("value", [z, g], [y])
    slope = ca.Function("slope", [z, g], [d, ca.jacobian(d, z)], {"cse": True})
    return value, slope, ca.DM(fixed)
