"""What the exact Jacobian of a filtering problem says: observability, and a Lipschitz constant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs
from slipctl.certify.arithmetic.enclosure import Bracket, largest, scalar_function
from slipctl.errors import BadInput, check_positive, nearest
from slipctl.estimate.kalman.model import Numbers, Problem, by_name, per_second, start_value


@dataclass(frozen=True)
class Observability:
    """Whether a measurement tells the unknowns apart at a point.

    Attributes:
        rank: number of directions seen.
        needed: number of unknowns.
        singular: singular values: how far measurements move over the horizon, per unit of scale.
        unseen: the direction seen least, by unknown, in units of scale.
    """

    rank: int
    needed: int
    singular: tuple[float, ...]
    unseen: Mapping[str, float]

    @property
    def full(self) -> bool:
        """Whether all unknowns are seen."""
        return self.rank == self.needed


def observability(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    scale: Numbers = 1.0,
    horizon: float = 1.0,
    tolerance: float = 1e-9,
    **at: float,
) -> Observability:
    """Rank of the Jacobian of what is measured and its time derivatives, at a point.

    Row j is d/dx of the j-th time derivative of the measurement (of its rate, for increments) times
    horizon^j/j!, j < N: what the measurement does within the horizon. Known signals stand still;
    motion of theirs can only add to what is seen.

    Args:
        block, measured, estimate: as of :func:`slipctl.ctukf`.
        scale: size of each unknown, so that units do not matter.
        horizon: time in s in which a difference has to show.
        tolerance: singular values below this share of the largest count as zero.
        **at: values of states, inputs and parameters; the rest has its declared value.

    Raises:
        BadInput: as of ``ctukf``, or a slope that is not finite there.
    """
    check_positive("observability: horizon", horizon, "s")
    check_positive("observability: tolerance", tolerance)
    problem = Problem.of("observability", block, measured, estimate)
    scales = _scales(problem, scale)
    symbols = problem.symbols()
    x = ca.vertcat(*(symbols[s.name] for s in problem.unknown))
    moving = [*problem.unknown, *problem.increments]
    z = ca.vertcat(*(symbols[s.name] for s in moving))
    rates, increments = problem.rates(symbols)
    field = ca.vertcat(*rates, *increments)
    y = ca.vertcat(*increments, *problem.outputs(symbols))
    rows = []
    for j in range(problem.n):
        rows.append(ca.jacobian(y, x) * horizon**j / math.factorial(j))
        y = ca.jtimes(y, z, field)
    matrix = ca.vertcat(*rows) @ ca.diag(ca.DM(scales))
    M = _evaluate(problem, symbols, ca.densify(matrix), _point(problem, at))
    if not np.isfinite(M).all():
        raise BadInput(f"{problem.who}: a slope is not finite there; give another point")
    _, singular, v = np.linalg.svd(M)
    rank = int((singular > tolerance * singular[0]).sum())
    weak = {s.name: float(c) for s, c in zip(problem.unknown, v[-1], strict=True)}
    return Observability(rank, problem.n, tuple(float(s) for s in singular), weak)


@dataclass(frozen=True)
class Lipschitz:
    """How fast equations change with the unknowns over a region.

    Attributes:
        constant: proven upper bound of the Lipschitz constant, unknowns and results over their
            scales.
        reached: slope found at a point of the region; the true constant lies between both.
        slopes: enclosure of each partial derivative in its units, by ``(result, unknown)``.
        method: how the bounds were found.
    """

    constant: float
    reached: float
    slopes: Mapping[tuple[str, str], tuple[float, float]]
    method: str


def lipschitz(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    over: Mapping[str, tuple[float, float]],
    *,
    of: str = "measurement",
    scale: Numbers = 1.0,
    scale_of: Numbers = 1.0,
    tolerance: float = 0.01,
    **at: Any,
) -> Lipschitz:
    """Lipschitz constant of what is measured, or of the state equations, over a box.

    The exact Jacobian is enclosed by interval arithmetic on boxes that are halved until the bound
    and the largest slope found differ by less than ``tolerance``. So it is proven, not sampled:
    ||h(a) - h(b)|| <= constant ||a - b||, because a box is convex.

    Args:
        block, measured, estimate: as of :func:`slipctl.ctukf`.
        over: range of each signal that varies, unknown or known; the rest is fixed.
        of: ``"measurement"``, h of Lemma 2 of Zhang 2021 (the rate, for increments), or
            ``"states"``, the rates of the unknowns.
        scale: size of each unknown, in the norm of the unknowns.
        scale_of: size of each result, in the norm of the results.
        tolerance: relative gap at which halving stops.
        **at: values of the other states, inputs and parameters.

    Raises:
        BadInput: as of ``ctukf``, an unknown name, a range that is empty, an operation that has no
            interval rule.
    """
    check_positive("lipschitz: tolerance", tolerance)
    problem = Problem.of("lipschitz", block, measured, estimate)
    if of not in ("measurement", "states"):
        raise BadInput(f"{problem.who} has no of={of!r}{nearest(of, ('measurement', 'states'))}")
    symbols = problem.symbols()
    point = _point(problem, at)
    ranges = _ranges(problem, over, symbols)
    of_what, results = _results(problem, symbols, of)
    sizes = by_name(problem.who, "scale_of", _all(scale_of, of_what), of_what, "positive")
    unknown = [s.name for s in problem.unknown]
    x = ca.vertcat(*(symbols[n] for n in unknown))
    J = ca.densify(ca.jacobian(ca.vertcat(*results), x))
    fixed = {n: ca.DM(point[n]) for n in symbols if n not in ranges}
    J = ca.substitute([J], [symbols[n] for n in fixed], list(fixed.values()))[0]
    varying = ca.vertcat(*(symbols[n] for n in ranges))
    f = scalar_function(ca.Function("slopes", [varying], [ca.vec(J)], {"cse": True}))
    lo, hi = np.array(list(ranges.values())).T
    n, m = len(unknown), len(of_what)
    weight = np.outer(_scales(problem, scale), [1 / v for v in sizes.values()]).ravel()[:, None]

    def norms(y: np.ndarray) -> np.ndarray:
        matrices = (weight * y).T.reshape(-1, n, m)
        matrices = np.where(np.isfinite(matrices), matrices, 1e300)
        found = np.linalg.norm(matrices, 2, axis=(1, 2))
        return np.where(np.isfinite(y).all(axis=0), found, np.inf)

    def inside(y: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(y).all(axis=0), norms(y), np.nan)

    grid = np.random.default_rng(0).uniform(lo[:, None], hi[:, None], (len(lo), 64))
    seen = np.array(f(grid).full())
    size = np.nanmax(np.abs(np.where(np.isfinite(seen), seen, np.nan)), axis=1, initial=0.0)
    whole = largest(
        f, lo, hi, tolerance * float(np.nanmax(inside(seen), initial=0.0)), inside,
        lambda a, b: norms(np.maximum(np.abs(a), np.abs(b))), most=MOST,
    )  # fmt: skip
    slopes, boxes = {}, whole.boxes
    for k, (i, j) in enumerate((i, j) for i in range(n) for j in range(m)):
        gap = tolerance * float(size[k])
        high, low = (_largest_entry(f, k, sign, lo, hi, gap) for sign in (1, -1))
        slopes[list(of_what)[j], unknown[i]] = (-low.bound, high.bound)
        boxes += low.boxes + high.boxes
    method = f"interval arithmetic on the exact Jacobian, {boxes} boxes"
    return Lipschitz(whole.bound, whole.reached, slopes, method)


def _results(problem: Problem, symbols: Mapping[str, Any], of: str) -> tuple[dict[str, str], Any]:
    """Units by name of what has a Lipschitz constant, and its expressions."""
    rates, increments = problem.rates(symbols)
    if of == "states":
        of_what = {s.name: per_second(s.unit) for s in problem.unknown if s.role == "state"}
        results = [v for s, v in zip(problem.unknown, rates, strict=True) if s.name in of_what]
    else:
        of_what = {s.name: per_second(s.unit) for s in problem.increments}
        of_what |= {s.name: s.unit for s in problem.direct}
        results = [*increments, *problem.outputs(symbols)]
    if not results:
        raise BadInput(f"{problem.who}: no unknown is a state, so there are no state equations")
    return of_what, results


MOST = 20_000
"""Boxes after which a bound is taken as it is; it stays a bound."""


def _largest_entry(
    f: ca.Function, k: int, sign: int, lo: np.ndarray, hi: np.ndarray, gap: float
) -> Bracket:
    """Bracket of one entry times a sign."""
    end = (lambda a, b: b[k]) if sign > 0 else (lambda a, b: -a[k])
    return largest(f, lo, hi, gap, lambda y: sign * y[k], end, MOST)


def _scales(problem: Problem, scale: Numbers) -> list[float]:
    units = {s.name: s.unit for s in problem.unknown}
    return list(by_name(problem.who, "scale", _all(scale, units), units, "positive").values())


def _all(given: Numbers, names: Mapping[str, str]) -> Numbers:
    """One number stands for all names, in the order of the names."""
    if isinstance(given, Mapping):
        return {n: given[n] for n in names if n in given} | dict(given)
    return dict.fromkeys(names, given)


def _point(problem: Problem, at: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Values of all signals: given ones by full or last name, declared ones otherwise."""
    b = problem.block
    given = {b.find(k, "state", "input", "param"): v for k, v in at.items()}
    signals = [*b.states.values(), *b.inputs.values(), *b.params.values()]
    return {
        s.name: s.check(f"{problem.who}: {s.name}", given[s.name]) if s.name in given
        else start_value(b, s)
        for s in signals
    }  # fmt: skip


def _ranges(
    problem: Problem, over: Mapping[str, tuple[float, float]], symbols: Exprs
) -> dict[str, tuple[float, float]]:
    """Ranges by full name."""
    found = {}
    for k, (low, high) in over.items():
        n = problem.block.find(k, "state", "input", "param")
        if n not in symbols or symbols[n].numel() != 1:
            raise BadInput(f"{problem.who}: {n} is derived or no scalar and cannot vary")
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise BadInput(f"{problem.who}: range of {n} is {low:g}..{high:g}; lowest first")
        found[n] = (float(low), float(high))
    if not found:
        raise BadInput(f"{problem.who}: over={{...}} names no signal that varies")
    return found


def _evaluate(
    problem: Problem, symbols: Exprs, expression: Any, point: Mapping[str, np.ndarray]
) -> np.ndarray:
    f = ca.Function("at", list(symbols.values()), [expression])
    values = [ca.DM(np.asarray(point[n], dtype=float).reshape(symbols[n].shape)) for n in symbols]
    return np.array(ca.DM(f(*values)).full())
