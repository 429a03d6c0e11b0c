"""The best argument of a law: the CasADi reference that validates every online search."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.analysis import objective
from slipctl.block.block import Block, Exprs, as_block, doc_of_maker, make_block
from slipctl.block.signals import Param
from slipctl.errors import BadInput, RunFailed, check_known, check_range, check_whole

Slopes = Callable[[float], tuple[float, float]]
"""First and second derivative at a place."""

GRID = 200
"""Intervals of the grid that brackets the peaks."""

TRIED = 8
"""Peaks of the grid that are followed up, the highest ones."""


class Peak(NamedTuple):
    """Peak of a law.

    Attributes:
        location: argument of the peak, in its unit.
        value: objective there.
        bracket: interval that holds the location: the exact derivative, evaluated at its ends, is
            positive at the lower and negative at the upper one. Of a peak at the end of the range,
            that end twice.
        method: ``"closed form"``, ``"newton"``, ``"proven"``, or ``"bound"`` for a peak at the end
            of the range.
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
    proven: bool = False,
) -> Peak:
    """Find the peak of a law over one input.

    The law's closed form is taken where it declares one, the place lies in the range and the
    derivative changes its sign there from plus to minus. Otherwise each of the highest peaks of a
    grid is bracketed by its neighbours. Newton's method on the exact derivative, replaced by
    bisection where it would leave the bracket, closes in on it to rounding. A peak narrower than
    two steps of the grid can be overlooked, unless it is ``proven``: then interval arithmetic
    discards all of the range where no peak can be (:mod:`slipctl.certify.arithmetic.enclosure`).

    Args:
        law: a law.
        over: input that is varied.
        maximise: output that is maximised; may be left out if there is only one.
        lo, hi: range of the input, in its unit.
        at: values of other inputs and of parameters; those not given have their own.
        closed_form: False to leave the closed form aside, to check it.
        proven: the bracket holds the largest value of all the range, and no other peak of it; the
            curvature is negative all over it.

    Raises:
        BadInput: unknown names, an empty range, an input without value, or a law that is NaN all
            over the range.
        RunFailed: nothing can be proven, as of a flat top or of two peaks of one height.
    """
    where = f"argmax({as_block('argmax: the law', law).name})"
    check_range(where, lo, hi)
    value, slope, p = objective_functions(where, law, [over], maximise, dict(at or {}))

    if proven:
        return _proven(where, value, slope, p, lo, hi)
    if closed_form and law.law_data.closed_form is not None:
        params = law.param_values(**{k: v for k, v in (at or {}).items() if k in law.params})
        told = {
            s.name: ca.DM(params[s.name]) if s.shape else float(params[s.name])
            for s in objective.left_open(law, [over]) if s.name in params
        }  # fmt: skip
        place = float(law.law_data.closed_form(**told))
        slopes = _slopes_at(slope, p)
        bracket = _bracket(slopes, place, lo, hi) if lo < place < hi else None
        if bracket is not None:
            return Peak(place, float(value(place, p)), bracket, "closed form")
    return highest_peak(where, value, slope, p, lo, hi)


def _slopes_at(slope: ca.Function, p: Any) -> Slopes:
    def slopes(x: float) -> tuple[float, float]:
        first, second = slope(x, p)
        return float(first), float(second)

    return slopes


def highest_peak(
    where: str, value: ca.Function, slope: ca.Function, p: Any, lo: float, hi: float
) -> Peak:
    """Highest of the peaks that a grid shows, closed in on by Newton's method."""
    slopes = _slopes_at(slope, p)
    grid = np.linspace(lo, hi, GRID + 1)
    heights = np.array(ca.DM(value.map(grid.size)(grid[None], p)).full()).ravel()
    if np.isnan(heights).all():
        raise BadInput(
            f"{where} is NaN all over {lo:g} to {hi:g}; give another range or at={{...}}"
        )
    heights = np.where(np.isnan(heights), -np.inf, heights)
    around = np.concatenate([[-np.inf], heights, [-np.inf]])
    tops = np.flatnonzero((heights >= around[:-2]) & (heights >= around[2:]))
    found = []
    for k in tops[np.argsort(-heights[tops], kind="stable")][:TRIED]:
        if (k == 0 and not slopes(lo)[0] > 0) or (k == GRID and not slopes(hi)[0] < 0):
            end = float(grid[k])
            found.append(Peak(end, float(heights[k]), (end, end), "bound"))
            continue
        a, b = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, GRID)])
        x = _climb(slopes, float(grid[k]), a, b)
        found.append(Peak(x, float(value(x, p)), _bracket(slopes, x, lo, hi) or (a, b), "newton"))
    return max(found, key=lambda peak: peak.value)


def _climb(slopes: Slopes, x: float, a: float, b: float) -> float:
    """Place in a..b where the first derivative changes its sign, from ``x`` on."""
    for _ in range(200):
        first, second = slopes(x)
        a, b = (x, b) if first > 0 else (a, x)
        following = x - first / second if second < 0 else math.inf
        if not a < following < b:
            following = (a + b) / 2
        if following == x or b - a <= 4 * np.spacing(abs(x)):
            break
        x = following
    return x


def _proven(
    where: str, value: ca.Function, slope: ca.Function, p: Any, lo: float, hi: float,
    most: int = 100_000,
) -> Peak:  # fmt: skip
    """Largest value over the range, by branch and bound on enclosures.

    A piece goes where its values stay below one that is reached, and where its slope keeps its
    sign. What is left is halved until the curvature is negative over all of it: then it holds one
    stationary point, which is the peak.
    """
    from slipctl.certify.arithmetic.enclosure import enclose

    z = ca.SX.sym("z")
    f = ca.Function("f", [z], [ca.vertcat(value(z, p), *slope(z, p))])
    slopes = _slopes_at(slope, p)
    left, right = np.array([lo]), np.array([hi])
    reached, boxes = max(float(value(lo, p)), float(value(hi, p))), 0
    while boxes < most:
        boxes += left.size
        middle = left + (right - left) / 2
        reached = max(reached, float(np.nanmax(np.array(f(middle[None]).full())[0])))
        low, high = enclose(f, left[None], right[None])
        kept = ~(high[0] < reached) & ~(low[1] > 0) & ~(high[1] < 0)
        if not kept.any():  # the law rises or falls all over the range
            end = lo if float(value(lo, p)) > float(value(hi, p)) else hi
            return Peak(end, float(value(end, p)), (end, end), "bound")
        left, right, middle = left[kept], right[kept], middle[kept]
        a, b = float(left.min()), float(right.max())
        curvature = enclose(f, np.array([[a]]), np.array([[b]]))[1][2, 0]
        if curvature < 0 and slopes(a)[0] > 0 > slopes(b)[0]:
            x = _climb(slopes, (a + b) / 2, a, b)
            return Peak(x, float(value(x, p)), (a, b), "proven")
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    raise RunFailed(f"{where}: no single peak can be proven in {lo:g} to {hi:g}")


def _bracket(slopes: Slopes, x: float, lo: float, hi: float) -> tuple[float, float] | None:
    """Narrow interval around ``x`` with a rising law at one end and a falling one at the other."""
    width = 4 * float(np.spacing(abs(x)))
    while width < hi - lo:
        a, b = max(x - width, lo), min(x + width, hi)
        if slopes(a)[0] > 0 > slopes(b)[0]:
            return a, b
        width *= 2
    return None


def argmax_block(
    law: Block, over: str, maximise: str | None = None, *, lo: float, hi: float, points: int = 32,
    newton: int = 6, closed_form: bool = False, value: bool = True,
) -> Block:  # fmt: skip
    """Make a law that finds the peak online: a grid, then safeguarded Newton steps.

    Args:
        law: a law of scalar expressions.
        over: input that is varied.
        maximise: output that is maximised; may be left out if there is only one.
        lo, hi: range of the input, in its unit.
        points: points of the grid, the ends included.
        newton: Newton steps, each replaced by bisection where it would leave the bracket.
        closed_form: take the closed form of the peak that the law declares, put into the range.
        value: give the objective there too, which costs more than the place of a closed form.

    Returns:
        A law. Inputs: the law's scalar parameters and its other inputs. Outputs: ``best`` and
        ``value``. Parameters of the law that are vectors stay parameters.

    Raises:
        BadInput: unknown names, an empty range, or too few points.
    """
    where = f"argmax_block({as_block('argmax_block: the law', law).name})"
    maximise = objective.objective(where, law, over, maximise)
    check_range(where, lo, hi)
    check_whole(f"{where}: points", points, 3)
    check_whole(f"{where}: newton", newton, 0)
    objective.refuse_names(where, law, ("lo", "hi"))
    if closed_form and law.law_data.closed_form is None:
        raise BadInput(f"{where}: {law.name} declares no closed form of its peak; leave it out")
    x, given = law.inputs[over], objective.left_open(law, [over])
    return make_block(
        "argmax", "law",
        _peak_body(law, over, maximise, int(points), int(newton), closed_form, value),
        inputs=objective.of_role("input", given),
        params=[
            Param(x.unit, float(lo), "lowest", lo=-1e12, hi=1e12).named("lo"),
            Param(x.unit, float(hi), "highest", lo=-1e12, hi=1e12).named("hi"),
            *objective.of_role("param", given),
        ],
        outputs=objective.best_outputs(law, over, maximise)[: 1 + value],
        choices={"law": law.name, "over": over}
        | ({"peak": "closed form"} if closed_form else {"points": points, "newton": newton}),
        doc=doc_of_maker(argmax_block),
    )  # fmt: skip


def _peak_body(
    law: Block, over: str, maximise: str, points: int, newton: int, closed_form: bool, value: bool
) -> Callable[..., tuple[Exprs, Exprs]]:
    """Equations of a search on a grid and by Newton's steps, or by the closed form."""
    given, value_of = objective.open_law(law, [over], maximise)
    z, g = ca.SX.sym("z"), ca.SX.sym("g", value_of.size1_in(1))
    d = ca.jacobian(value_of(z, g), z)
    slope = ca.Function("slope", [z, g], [d, ca.jacobian(d, z)], {"cse": True})
    form = law.law_data.closed_form if closed_form else None

    def results(place: Any, at: Any) -> Exprs:
        return {"best": place} | ({"value": value_of(place, at)} if value else {})

    def body(xs: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        at = objective.column(given, u, p)
        if form is not None:
            told = {s.name: (u | p)[s.name] for s in given if s.name in law.params}
            best = ca.fmin(p["hi"], ca.fmax(p["lo"], form(**told)))
            return {}, results(best, at)
        step = (p["hi"] - p["lo"]) / (points - 1)
        place, height = p["lo"], objective.law_at(law, [over], maximise, p["lo"], at)

        # functions, so that C has these names in its loops
        def compared(place: Any, height: Any, k: int) -> tuple[Any, Any]:
            there = p["lo"] + k * step
            value = value_of(there, at)
            better = value > height
            return ca.if_else(better, there, place), ca.if_else(better, value, height)

        def closer(place: Any, a: Any, b: Any) -> tuple[Any, Any, Any]:
            d1, d2 = slope(place, at)
            rising = d1 > 0
            a, b = ca.if_else(rising, place, a), ca.if_else(rising, b, place)
            following = place - d1 / ca.fmin(d2, -1e-30)
            inside = ca.logic_and(ca.logic_and(following >= a, following <= b), d2 < 0)
            return ca.if_else(inside, following, (a + b) / 2), a, b

        for k in range(1, points):
            place, height = compared(place, height, k)
        a, b = ca.fmax(place - step, p["lo"]), ca.fmin(place + step, p["hi"])
        for _ in range(newton):
            place, a, b = closer(place, a, b)
        return {}, results(place, at)

    return body


def objective_functions(
    where: str, law: Block, over: Sequence[str], maximise: str | None, at: dict[str, float]
) -> tuple[ca.Function, ca.Function, Any]:
    """Objective and (first, second derivative) as functions of (place, fixed values), and these.

    The derivatives are for one input.
    """
    for name in over:
        maximise = objective.objective(where, law, name, maximise)
    given = objective.left_open(law, over)
    names = [s.name for s in given]
    for k in at:
        check_known(f"{where} has no input or parameter", k, names)
    params = law.param_values(**{k: v for k, v in at.items() if k in law.params})
    fixed: list[float] = []
    for s in given:
        value = params.get(s.name, at.get(s.name, s.value))
        if value is None:
            raise BadInput(f"{where}: give at={{{s.name!r}: ...}} in {s.unit}")
        fixed.extend(np.ravel(np.asarray(value, dtype=float), order="F"))

    def make() -> tuple[ca.Function, ca.Function]:
        _, value_of = objective.open_law(law, list(over), str(maximise))
        z, g = ca.SX.sym("z", len(over)), ca.SX.sym("g", len(fixed))
        y = value_of(z, g)
        d = ca.jacobian(y, z)
        value = ca.Function("value", [z, g], [y])
        slope = ca.Function("slope", [z, g], [d, ca.jacobian(d, z)], {"cse": True})
        return value, slope

    derived = tuple((s.name, s.value) for s in law.params.values() if s.derived)
    value, slope = law.of_equations(("objective", tuple(over), maximise, derived), make)
    return value, slope, ca.DM(fixed)
