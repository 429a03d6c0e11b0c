"""Fit the parameters of a law to a measured curve, and say how well the curve tells them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl import registry
from slipctl.block.block import Block
from slipctl.block.reach import measured_reach, with_reach
from slipctl.errors import BadInput, check_known
from slipctl.estimate import model
from slipctl.estimate.curve import Curve, parameters_of_columns, points, quantity, settings
from slipctl.estimate.log_fit.record import origin
from slipctl.tables.table import read_table

Numbers = Mapping[str, Any]

DRAWN, REACH, FOLLOWED = 1000, 30.0, 4
"""Further starts drawn around the given one, up to this factor away, and how many of the best ones
are followed: curves of adhesion have several local minima."""

WEAKEST = 1e-8
"""Smallest singular value of the Jacobian, of the largest one, that is not taken for zero."""


@dataclass(frozen=True)
class Fitted:
    """Law fitted to a curve.

    Attributes:
        law: the law with the parameters found.
        curve: the points.
        values: unknown parameters, in their units.
        std: standard deviation of each; None of one that ends at a bound.
        interval: 95 % confidence interval of each; None as above.
        correlation: of the parameters that are at no bound, by pairs of names.
        residuals: measured minus fitted, in the unit of the output.
        tied: parameter by the one that it was set equal to, to keep the order that the law expects.
        doubts: expectations of the law that the values do not keep.
        origin: where each known input and parameter is from.
        notes: what was converted, a line each.
        peaks: other inputs, and place and height of the peak there.
    """

    law: Block
    curve: Curve
    values: dict[str, float]
    std: dict[str, float | None]
    interval: dict[str, tuple[float, float] | None]
    correlation: dict[tuple[str, str], float]
    residuals: np.ndarray
    tied: dict[str, str]
    doubts: tuple[str, ...]
    origin: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    peaks: tuple[tuple[dict[str, float], float, float], ...] = ()

    def _repr_html_(self) -> str:
        return registry.view(self, "html")

    @property
    def max_error(self) -> float:
        """Largest residual, in the unit of the output."""
        return float(np.abs(self.residuals).max())

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, in the unit of the output."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit(
    law: Block,
    data: str | Path | Mapping[str, Any],
    unknown: Sequence[str] | None = None,
    start: Numbers | None = None,
    *,
    at: Numbers | None = None,
    columns: Mapping[str, str] | None = None,
    measured: str | None = None,
    ordered: bool = False,
    decimal: str = "",
) -> Fitted:
    """Fit parameters of a law to a measured curve by least squares.

    The squares of measured minus fitted are made least by a trust-region method with bounds
    (Branch, Coleman, Li 1999; ``scipy.optimize.least_squares``) on the exact Jacobian. It starts
    from the given start and from the best of others drawn around it, always the same. A parameter
    whose range is positive is sought as its logarithm. Standard deviations are those of the
    linearised problem, s^2 (J'J)^-1 with s^2 the sum of squares by points minus unknowns.

    Args:
        law: a law.
        data: file with a head and a row per point (``creep [1],force [kN]``; comments ``# set Q =
            106.7 kN`` are values for ``at``, or starts of what is unknown), or columns by name in
            SI units.
        unknown: parameters to find; by default those that the law's rail conditions set, or all.
        start: values to start from; what is not given starts from the law's own value.
        at: inputs that do not vary and known parameters, as numbers or texts with a unit.
        columns: expression of the columns for a signal of the law, ``{"v_s": "slip * v / 100"}``;
            otherwise a column of the signal's name is taken, or the law's own ``readings``.
        measured: output that was measured; may be left out if there is only one.
        ordered: keep the order that the law expects of its parameters
            (``law.law_data.expects``). Where the free fit breaks it, the two parameters are equal.
        decimal: decimal mark of the file, where its numbers can be read in two ways.

    Raises:
        BadInput: an unknown name, a curve that lacks a column or is not sorted by it, fewer points
            than unknowns plus one, or unknowns that the curve does not identify. Says which.
    """
    output = model.measured_output(law, measured)
    if unknown is None and law.conditions:
        unknown = [n for n in law.params if any(n in c for c in law.conditions.values())]
    unknown = model.unknown_parameters(law, unknown)
    table = data if isinstance(data, Mapping) else read_table(data, decimal)
    source = "data" if isinstance(data, Mapping) else str(data)
    known = {n: quantity(law, n, v) for n, v in (at or {}).items()}
    known |= parameters_of_columns(law, source, table, known)
    for n in known:
        if n in unknown:
            raise BadInput(f"{n} is both given and unknown; leave it out of one of them")
    told = settings(law, table)
    given = dict(known)
    known = {n: v for n, v in told.items() if n not in unknown} | known
    followed, notes = _following(law, source, told, given, known)
    known |= followed
    signals = {**law.law_data.beside, **law.inputs, **law.params}
    notes += tuple(
        f"{source}: its comment has {n} = {v:g} {signals[n].unit}; {given[n]:g} is given and taken"
        for n, v in told.items()
        if n in given and given[n] != v
    )
    law = law.with_params(**{n: v for n, v in (told | known).items() if n in law.params})
    origin = _origins(law, source, told, given, followed, unknown)
    for n, v in (start or {}).items():
        check_known("start has", n, unknown)
        law = law.with_params(**{n: quantity(law, n, v)})
    curve, said = points(law, source, table, known, columns or {}, output, unknown)
    said = [*(f"{source}: {n}" for n in getattr(table, "notes", ())), *said]
    free = _solve(law, curve, unknown)
    tied = {a: b for a, b in law.orders() if ordered and free[0][a] < free[0][b]}
    if tied:
        equal = {b: math.sqrt(free[0][a] * free[0][b]) for a, b in tied.items()}
        rest = [n for n in unknown if n not in tied]
        free = _solve(law.with_params(**tied, **equal), curve, rest)
    found = _judged(law, curve, unknown, tied, *free)
    of = {*followed, *(inspect.signature(law.law_data.follows).parameters if followed else ())}  # type: ignore[arg-type]
    notes = (*said, *notes, *_untold(found.law, curve, origin, of))
    return replace(found, origin=origin, notes=notes, peaks=_peaks(found.law, curve))


# ---- what follows, what nobody told -------------------------------------------------------------


def _following(
    law: Block, source: str, told: Mapping[str, float], given: Mapping[str, float],
    known: Mapping[str, float],
) -> tuple[dict[str, float], tuple[str, ...]]:  # fmt: skip
    """Parameters that follow from what is known, and the line that tells it.

    Args:
        law: the law.
        source: of the curve.
        told: by the file.
        given: by the person.
        known: both.

    Raises:
        BadInput: some of those that follow are told and others not, or both they and what they
            follow from, or those of the file belong to another load.
    """
    data = law.law_data
    if data.follows is None:
        return {}, ()
    own = {n: float(s.value) for n, s in {**law.params, **data.beside}.items() if np.size(s.value)
           and isinstance(s.value, int | float | np.floating)}  # fmt: skip
    every = {**told, **known}
    names = list(inspect.signature(data.follows).parameters)
    found = dict(data.follows(**{n: every.get(n, own.get(n)) for n in names}))
    words = ", ".join(found)
    ways = f"give {words}, or {' and '.join(n for n in names if n in data.beside and n[0] == 'R')}"
    here = [n for n in found if n in every]
    changed = [n for n in names if n in given and n in told and given[n] != told[n]]
    if here and len(here) < len(found):
        lost = ", ".join(n for n in found if n not in here)
        raise BadInput(f"{source}: {', '.join(here)} known without {lost}; {ways}")
    if here:
        both = [n for n in names if n in law.law_data.beside and n in every]
        if both:
            raise BadInput(f"{source}: {words} and {', '.join(both)} are both given; leave out one")
        if changed and not any(n in given for n in found):
            raise BadInput(
                f"{source}: its {words} belong to {changed[0]} = {told[changed[0]]:g}, not"
                f" {given[changed[0]]:g}; {ways} for that"
            )
        return {}, ()
    if not any(n in every and every[n] != own.get(n) for n in names):
        return {}, ()
    signals = {**law.params, **law.law_data.beside}
    of = ", ".join(
        f"{n} = {every.get(n, own.get(n)):.5g} {signals[n].unit}".removesuffix(" 1")
        + ("" if n in every else " (the law's own)")
        for n in names
    )
    return found, (f"{words} follow from {of}",)


def _origins(
    law: Block, source: str, told: Mapping[str, float], given: Mapping[str, float],
    followed: Mapping[str, float], unknown: Sequence[str],
) -> dict[str, str]:  # fmt: skip
    """Where each known input and parameter is from."""
    found = {}
    for n, s in {**law.inputs, **law.params}.items():
        if n in unknown:
            continue
        if n in given:
            found[n] = "given"
        elif n in told:
            found[n] = f"comment of {Path(source).name}"
        elif n in followed:
            found[n] = "follows by " + ("Hertz and Kalker" if law.law_data.beside else "the law")
        elif n in law.params and s.derived:
            found[n] = f"= {s.value}"
        elif n in law.params:
            found[n] = f"the law's own{', ' + s.source if s.source else ''}"
    return found


def _untold(
    law: Block, curve: Curve, origin: Mapping[str, str], said: Collection[str]
) -> tuple[str, ...]:
    """The line on numbers that were not given and that the fitted curve depends on."""
    names = [n for n, o in origin.items() if o.startswith("the law's own") and n not in said]
    if not names:
        return ()
    f = model.output_function(law, curve.output, names)
    values = law.param_values()
    known = model.known_parameters(law, names)
    rest = ca.DM(np.concatenate([[], *(np.ravel(s.value) for s in known)]))
    J = f.map(curve.measured.size)(
        ca.repmat(ca.DM([float(values[n]) for n in names]), 1, curve.measured.size),
        ca.DM(np.array([curve.inputs[k] for k in law.inputs])),
        ca.repmat(rest, 1, curve.measured.size),
    )[1].full().reshape(len(names), -1, order="F")  # fmt: skip
    moved = [n for n, row in zip(names, J, strict=True) if np.any(row)]
    if not moved:
        return ()
    own = ", ".join(f"{n} = {float(values[n]):.5g} {law.params[n].unit}" for n in moved)
    return (f"not given, taken from the law: {own.replace(' 1,', ',').removesuffix(' 1')}",)


def _peaks(law: Block, curve: Curve) -> tuple[tuple[dict[str, float], float, float], ...]:
    """Peak of the fitted law over its abscissa, at each set of the other inputs."""
    along = curve.abscissa
    others = [n for n in curve.inputs if n != along]
    sets = sorted({tuple(float(curve.inputs[n][k]) for n in others)
                   for k in range(curve.measured.size)})  # fmt: skip
    x = curve.inputs[along]
    grid = np.linspace(min(0.0, float(x.min())), float(x.max()), 2001)
    found = []
    for values in sets:
        rest = dict(zip(others, values, strict=True))
        inputs = np.array([grid if n == along else np.full(grid.size, rest[n])
                           for n in law.inputs])  # fmt: skip
        p = ca.DM(law.pack("param", law.param_values()))
        f = law.f.map(grid.size)
        y = np.array(f(ca.DM(0, grid.size), ca.DM(inputs), ca.repmat(p, 1, grid.size))[1].full())
        height = y[list(law.outputs).index(curve.output)]
        k = int(np.argmax(height))
        if not 0 < k < grid.size - 1:
            continue
        a, b, c = height[k - 1 : k + 2]
        shift = (a - c) / (2 * (a - 2 * b + c)) if a - 2 * b + c else 0.0
        place = float(grid[k] + shift * (grid[1] - grid[0]))
        found.append((rest, place, float(b - (a - c) * shift / 4)))
    return tuple(found)


# ---- the search ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Scale:
    """Coordinates of the unknowns: the logarithm of what is positive, the rest as it is."""

    names: tuple[str, ...]
    log: np.ndarray
    lo: np.ndarray
    hi: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, law: Block, names: Sequence[str]) -> _Scale:
        lo, hi = (np.array([getattr(law.params[n], k) for n in names]) for k in ("lo", "hi"))
        log = lo > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = np.where(log, np.log(lo), lo), np.where(log, np.log(hi), hi)
        at = np.array([abs(float(law.params[n].value)) for n in names])
        size = np.where(log, 1.0, np.where(np.isfinite(high - low), high - low, np.maximum(at, 1)))
        return cls(tuple(names), log, low, high, size)

    def to(self, values: np.ndarray) -> np.ndarray:
        return np.array([math.log(v) if k else v for v, k in zip(values, self.log, strict=True)])

    def back(self, q: np.ndarray) -> np.ndarray:
        return np.array([math.exp(v) if k else v for v, k in zip(q, self.log, strict=True)])

    def slopes(self, values: np.ndarray) -> np.ndarray:
        """Derivative of the values by the coordinates."""
        return np.where(self.log, values, 1.0)


Solution = tuple[dict[str, float], np.ndarray, np.ndarray, "_Scale", np.ndarray]


def _solve(law: Block, curve: Curve, unknown: Sequence[str]) -> Solution:
    """Parameters, residuals, Jacobian by the coordinates, coordinates, and which are at a bound."""
    from scipy.optimize import least_squares

    f = model.output_function(law, curve.output, unknown)
    many, count = curve.measured.size, len(unknown)
    fixed = [s.value for s in model.known_parameters(law, unknown)]
    constants = ca.DM(np.concatenate([[], *(np.ravel(v) for v in fixed)]))
    inputs = ca.DM(np.array([curve.inputs[k] for k in law.inputs]))
    each = f.map(many)
    scale = _Scale.of(law, unknown)
    size = float(np.abs(curve.measured).max()) or 1.0

    def evaluated(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y, J = each(ca.repmat(ca.DM(values), 1, many), inputs, ca.repmat(constants, 1, many))
        return np.array(y.full()).ravel(), np.array(J.full()).reshape(many, count)

    def residuals(q: np.ndarray) -> np.ndarray:
        return (evaluated(scale.back(q))[0] - curve.measured) / size

    def jacobian(q: np.ndarray) -> np.ndarray:
        values = scale.back(q)
        return evaluated(values)[1] * scale.slopes(values) / size

    first = scale.to(np.array([float(law.params[k].value) for k in unknown]))
    margin = np.where(np.isfinite(scale.hi - scale.lo), 1e-6 * (scale.hi - scale.lo), 0.0)
    inside = scale.lo + margin, scale.hi - margin
    first = np.clip(first, *inside)
    if not np.isfinite(residuals(first)).all():
        raise BadInput(f"{law.name} is not finite at the start; give start={{...}}")
    reach = scale.size * np.where(scale.log, math.log(REACH), 0.5)
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (DRAWN, count))
    around = np.clip(first + reach * drawn, *inside)
    z = ca.MX.sym("z", count)
    predicted = each(ca.repmat(z, 1, many), inputs, ca.repmat(constants, 1, many))[0]
    squares = ca.Function("squares", [z], [ca.sumsqr(predicted - ca.DM(curve.measured).T)])
    places = np.array([scale.back(q) for q in around])
    costs = np.nan_to_num(squares.map(DRAWN)(places.T).full().ravel(), nan=np.inf)
    nearest_ones = around[np.argsort(costs, kind="stable")[:FOLLOWED]]

    def descend(q: np.ndarray, tolerance: float) -> Any:
        return least_squares(
            residuals, q, jacobian, bounds=(scale.lo, scale.hi), x_scale=scale.size,
            ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=300,
        )  # fmt: skip

    ways = [descend(q, 1e-5) for q in (first, *nearest_ones)]
    found = descend(min(ways, key=lambda end: float(end.cost)).x, 1e-13)
    values = scale.back(found.x)
    y, J = evaluated(values)
    ends = np.minimum(found.x - scale.lo, scale.hi - found.x) <= 1e-6 * scale.size
    named = dict(zip(unknown, map(float, values), strict=True))
    return named, curve.measured - y, J * scale.slopes(values), scale, ends


# ---- what it is worth ---------------------------------------------------------------------------


def _judged(
    law: Block, curve: Curve, unknown: Sequence[str], tied: dict[str, str],
    values: dict[str, float], residuals: np.ndarray, J: np.ndarray, scale: _Scale,
    ends: np.ndarray,
) -> Fitted:  # fmt: skip
    """Standard deviations and intervals; refuses what the curve does not tell."""
    from scipy.special import stdtrit  # scipy.stats takes a second to import

    names = [n for n, end in zip(scale.names, ends, strict=True) if not end]
    runaways = [n for n, end, k in zip(scale.names, ends, scale.log, strict=True) if end and k]
    lost = list(runaways)
    freedom = curve.measured.size - len(names)
    spread = math.sqrt(float(residuals @ residuals) / freedom)
    scaled = (J * scale.size)[:, ~ends]
    _, strength, directions = np.linalg.svd(scaled, full_matrices=False)
    for s, direction in zip(strength, directions, strict=True):
        if s <= WEAKEST * strength[0] or spread > s:
            part = np.abs(direction)
            lost += [n for n, p in zip(names, part, strict=True) if p > 0.2 * part.max()]
    if lost:
        which = [n for n in unknown if n in lost]
        said = [f"{n} runs to the end of its range, {values[n]:.4g}" for n in runaways]
        raise BadInput(
            f"{curve.source} does not identify {', '.join(which)}:"
            f" {'; '.join(said) or 'other values fit as well'};"
            f" fix {'one of them' if len(which) > 1 else 'it'}, or measure more of the curve"
            f"{', or check columns, units and known values' if said else ''}"
        )
    covariance = spread**2 * np.linalg.inv(scaled.T @ scaled)
    deviation = np.sqrt(np.diag(covariance)) * scale.size[~ends]
    quantile = float(stdtrit(freedom, 0.975))
    std: dict[str, float | None] = dict.fromkeys(unknown)
    interval: dict[str, tuple[float, float] | None] = dict.fromkeys(unknown)
    for n, d in zip(names, deviation, strict=True):
        k = scale.names.index(n)
        at, far = values[n], quantile * float(d)
        std[n] = float(d) * (at if scale.log[k] else 1.0)
        interval[n] = (at * math.exp(-far), at * math.exp(far)) if scale.log[k] else (
            max(at - far, float(scale.lo[k])), min(at + far, float(scale.hi[k]))
        )  # fmt: skip
    root = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    correlation = {
        (names[i], names[j]): float((covariance / root)[i, j])
        for i in range(len(names))
        for j in range(i)
    }
    for a, b in tied.items():
        values[a], std[a], interval[a] = values[b], std[b], interval[b]
    values = {n: values[n] for n in unknown}
    fitted = law.with_params(**values).with_source(origin([curve.source]), *values)
    fitted = with_reach(fitted, measured_reach(law, curve.inputs))
    p = fitted.param_values()
    doubts = tuple(
        f"{a} = {float(p[a]):.4g} < {b} = {float(p[b]):.4g}; {law.name} expects {a} >= {b}"
        for a, b in law.orders()
        if p[a] < p[b]
    )
    return Fitted(fitted, curve, values, std, interval, correlation, residuals, dict(tied), doubts)
