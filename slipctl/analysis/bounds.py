"""Bounds that a criterion needs, from the model or from a run: how steep, how fast, how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.certify.arithmetic.enclosure import enclose, jumps, largest, scalar_function
from slipctl.certify.arithmetic.jumps import largest_jump
from slipctl.errors import BadInput, check_known

METHODS = ("interval", "grid")


@dataclass(frozen=True)
class Bound:
    """An upper bound of a magnitude.

    Attributes:
        value: the bound.
        reached: the largest magnitude that was seen; the true one lies between both.
        method: how it was found, in words.
    """

    value: float
    reached: float
    method: str


def largest_slope(
    block: Block,
    output: str,
    wrt: str,
    over: Mapping[str, tuple[float, float]],
    method: str = "interval",
    cells: int = 400,
    coarse: float = 0.0,
    **at: float,
) -> Bound:
    """Largest |d output/d wrt| of a block over a box, from its exact Jacobian.

    Args:
        block: any block. output, wrt: names of an output (or derivative) and of what it varies by.
        over: range of each signal that varies; the rest has its declared value, or that of ``at``.
        method: ``"interval"``: interval arithmetic on boxes that are halved until bound and largest
            slope found differ by 0.1 %. ``"grid"``: the slope at the middle of each cell of a grid,
            and a Lipschitz remainder, the enclosed second derivatives times half the cell. Both
            are proven.
        cells: cells along each range of the grid.
        coarse: share of the slope at the ends of the box by which the bound may be too large, where
            that is more than the 0.1 %.
        **at: values of the other signals.

    Raises:
        BadInput: an unknown name or method, an empty range, an operation without an interval rule,
            or an output that jumps inside the box: no slope bounds a jump.
    """
    check_known("largest_slope has no method", method, METHODS)
    f = slope_function(block, output, wrt, list(over), at)
    low, high = _ends(over, "largest_slope")
    _refuse_jump(block, output, list(over), at, low, high)
    if method == "interval":
        points = np.column_stack([(low + high) / 2, low, high])
        middle, *ends = (float(v) for v in np.abs(np.array(f(points).full()))[0])
        found = largest(
            f, low, high, max(1e-3 * max(middle, *ends, 1e-12), coarse * max(ends)),
            lambda y: np.abs(y[0]), lambda a, b: np.maximum(np.abs(a[0]), np.abs(b[0])),
        )  # fmt: skip
        how = f"interval arithmetic on {found.boxes} boxes"
        return Bound(found.bound, found.reached, how)
    x = ca.SX.sym("x", len(low))
    second = ca.Function("second", [x], [ca.densify(ca.gradient(f(x), x))])
    edges = [np.linspace(a, b, cells + 1) for a, b in zip(low, high, strict=True)]
    lows = np.array([g.ravel() for g in np.meshgrid(*(e[:-1] for e in edges), indexing="ij")])
    highs = np.array([g.ravel() for g in np.meshgrid(*(e[1:] for e in edges), indexing="ij")])
    seen = np.abs(np.array(f(lows / 2 + highs / 2).full())).ravel()
    least, most = enclose(second, lows, highs)
    rest = (np.maximum(np.abs(least), np.abs(most)) * (highs - lows) / 2).sum(axis=0)
    how = f"grid of {lows.shape[1]} cells with a Lipschitz remainder"
    return Bound(float((seen + rest).max()), float(seen.max()), how)


def enclosure(
    block: Block, output: str, over: Mapping[str, tuple[float, float]], gap: float = 1e-3,
    **at: float,
) -> tuple[float, float]:  # fmt: skip
    """Range that holds every value of an output over a box.

    Args:
        block: any block. output: name of an output (or derivative).
        over: range of each signal that varies; the rest has its declared value, or that of ``at``.
        gap: how far an end may be beyond the value that was found. A share of what the values
            at the middle and at two corners of the box differ by.
        **at: values of the other signals.

    Returns:
        Lower and upper end, both proven.

    Raises:
        BadInput: an unknown name, an empty range, or an operation without an interval rule.
    """
    low, high = _ends(over, "enclosure")
    whole = block.function()
    results = [n.partition("_")[2] for n in whole.name_out()]
    check_known(f"{block.name} has no output", output, results)
    f = _of_column(block, whole, results.index(output), list(over), at)
    places = np.array(f(np.column_stack([low, (low + high) / 2, high])).full())
    apart = gap * max(float(np.ptp(places)), 1e-6 * float(np.abs(places).max()), 1e-12)
    x = ca.SX.sym("x", len(low))
    up, down = (ca.Function("signed", [x], [sign * f(x)]) for sign in (1, -1))
    smooth = not jumps(f) or largest_jump(f, low, high).bound == 0  # so that slopes say how far
    found = [
        largest(g, low, high, apart,
                slope=ca.Function("slope", [x], [ca.gradient(g(x), x)]) if smooth else None)
        for g in (down, up)
    ]  # fmt: skip
    return -found[0].bound, found[1].bound


def _ends(over: Mapping[str, tuple[float, float]], who: str) -> tuple[np.ndarray, np.ndarray]:
    """Ends of a box.

    Raises:
        BadInput: a range that is empty or not finite.
    """
    for name, (a, b) in over.items():
        if not np.isfinite([a, b]).all():
            raise BadInput(
                f"{who}: the range {a:g}..{b:g} of {name} is not finite; write two finite ends"
            )
        if not a < b:
            raise BadInput(f"{who}: the range {a:g}..{b:g} of {name} is empty")
    ends = np.array([[float(a), float(b)] for a, b in over.values()])
    return ends[:, 0], ends[:, 1]


NO_JUMP = 1e-6
"""Share of a function's span below which what is left in the narrowest boxes is no jump."""


def _refuse_jump(
    block: Block, output: str, varying: Sequence[str], at: Mapping[str, float],
    low: np.ndarray, high: np.ndarray,
) -> None:  # fmt: skip
    """Refuse an output that jumps inside a box, or of which that cannot be excluded."""
    whole = block.function()
    results = [n.partition("_")[2] for n in whole.name_out()]
    f = _of_column(block, whole, results.index(output), varying, at)
    found = largest_jump(f, low, high)
    a, b = enclose(f, low.reshape(-1, 1), high.reshape(-1, 1))
    span = float((b - a)[0, 0])
    if found.bound > (NO_JUMP * span if np.isfinite(span) else 0.0):
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(varying, found.at, strict=True))
        raise BadInput(
            f"{block.name}.{output} may jump by {found.bound:.3g} at {where}, and no slope bounds a"
            " jump; leave that place out of the range, or smooth it"
        )


def slope_function(
    block: Block, output: str, wrt: str, varying: Sequence[str], at: Mapping[str, float]
) -> ca.Function:
    """Slope of an output by a signal as a Function of the column of varying signals.

    Raises:
        BadInput: an unknown name.
    """
    return _of_column(block, block.jacobian(output, wrt), 0, varying, at)


def _of_column(
    block: Block, function: ca.Function, result: int, varying: Sequence[str],
    at: Mapping[str, float],
) -> ca.Function:  # fmt: skip
    """One result of a named Function, as a Function of the column of varying signals.

    Raises:
        BadInput: an unknown name.
    """
    named = scalar_function(function)
    declared: dict[str, Any] = {
        **block.start(), **{n: s.value for n, s in block.inputs.items()}, **block.param_values()
    }  # fmt: skip
    own = {n.replace(".", "_"): n for n in declared}  # CasADi takes no dots
    names = [own[n.partition("_")[2]] for n in named.name_in()]
    for name in (*varying, *at):
        check_known(f"{block.name} has no signal", name, names)
    x = ca.SX.sym("x", len(varying))
    arguments = []
    for name in names:
        value = x[list(varying).index(name)] if name in varying else at.get(name, declared[name])
        if value is None:
            raise BadInput(f"{block.name}: give a value or a range of {name}")
        arguments.append(value)
    found = named(*arguments)
    found = found[result] if isinstance(found, tuple) else found
    return ca.Function("of_column", [x], [ca.densify(found)])


def fastest(
    time: np.ndarray, values: np.ndarray, apart: Sequence[float] = (), within: float = 0.0
) -> Bound:
    """Largest rate of a logged signal, |difference|/period, seen in a run.

    Args:
        time: in s, evenly spaced. values: of the signal.
        apart: times of events, such as a change of the rail.
        within: how long after an event rates are left out, in s; the event itself always is.

    Raises:
        BadInput: fewer than two values.
    """
    if len(values) < 2:
        raise BadInput("fastest needs two values or more")
    step = float(time[1] - time[0])
    rates = np.abs(np.diff(values)) / step
    keep = np.ones(len(rates), bool)
    for t in apart:
        keep &= (time[1:] < t - 1e-9) | (time[:-1] > t + within + 1e-9)
    seen = float(rates[keep].max()) if keep.any() else 0.0
    return Bound(seen, seen, "seen in a run, no proof")
