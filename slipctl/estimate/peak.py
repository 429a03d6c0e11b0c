"""Where the peak of an estimated law lies, how sure that is, and how to become surer: probing.

At the peak df/dx = 0, so a small change of the parameters moves it by the implicit function theorem

    dx* = g dp,    g = -(d2f/dx dp) / (d2f/dx2),

and a covariance C of the parameters gives it the variance g C g'.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Input, Output, Param, Signal, State
from slipctl.errors import BadInput, check_all_known, check_finite, check_known, check_positive
from slipctl.estimate import model
from slipctl.estimate.samples import samples_of

WORST = 1e3
"""Relative deviation reported where the estimated curve has no peak at the given place."""


def probe(
    law: Block,
    over: str,
    within: tuple[float, float],
    *,
    measured: str | None = None,
    unknown: Sequence[str] | None = None,
    period: float = 0.016,
    looks: bool = False,
    **numbers: float,
) -> Block:
    """Make the reference that goes to the estimated peak, and past it while the peak is unsure.

    After a change the reference is ``best (1 + depth)``: samples from the slip before the change
    up to beyond the peak are those that tell most about it. It returns to ``best`` for good as
    soon as the peak is known to ``tolerance``, at the latest after ``longest``. In between the
    slip moves as fast as controller and brake can; the estimator uses what it sees.

    A rail that changes without a trace in the samples at hand, because both curves meet there, is
    noticed by looking again. After ``again`` without probing the reference is ``best (1 + nudge)``
    for ``look``. If the peak is still less sure than ``tolerance`` by then, it is probed once more.

    Args:
        law: the estimated law.
        over: input along which the peak is sought.
        within: lowest and highest reference, in the unit of that input.
        measured: as given to :func:`slipctl.rls`.
        unknown: as given to :func:`slipctl.rls`.
        period: sample period in s.
        looks: look again from time to time, and probe again while the peak is unsure.
        **numbers: values of the block's parameters.

    Returns:
        A step block. Inputs: the unknowns, ``covariance`` and ``changed`` from the estimator,
        ``best`` (the peak of the estimated law), ``limit`` (highest reference at present), and
        the other inputs of the law. Outputs: ``reference``, ``deviation`` (standard deviation of
        the peak's place over its place) and ``probing``.

    Raises:
        BadInput: an unknown name, or a range that is none.
    """
    measured, unknown = model.measured_output(law, measured), model.unknown_parameters(law, unknown)
    _scalar_input(law, over, "probe")
    lowest, highest = within
    if not (math.isfinite(lowest) and math.isfinite(highest) and lowest < highest):
        raise BadInput(f"probe({law.name}): within = {within} must be (lowest, highest)")
    check_positive(f"probe({law.name}): period", period, "s")
    s, others = law.inputs[over], [k for k in law.inputs if k != over]
    known = model.known_parameters(law, unknown)
    gradient = peak_gradient(law, over, measured, unknown)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        best = ca.fmin(ca.fmax(u["best"], p["lowest"]), p["highest"])
        inputs = law.pack("input", {k: u[k] for k in others} | {over: best})
        values = ca.vertcat(*[u[k] for k in unknown])
        g, curvature = gradient(values, inputs, model.stack_column(p[k.name] for k in known))
        variance = g @ u["covariance"] @ g.T
        certain = ca.logic_and(curvature < 0, variance < (WORST * best) ** 2)
        deviation = ca.if_else(certain, ca.sqrt(ca.fmax(variance, 0)) / best, WORST)
        return _probing(x, u, p, best, deviation, period, looks)

    convention: Any = {"positive": s.positive, "per": s.per}
    block = make_block(
        "probe", "step", body,
        states=[
            State("s", 0.0, "time since the last change, up to longest").named("elapsed"),
            State("1", 1.0, "1 until the peak is known").named("probing"),
            *[State("s", 0.0, "time since it was probed or looked at").named("waited")][:looks],
        ],
        inputs=_probe_inputs(law, over, unknown, highest),
        params=[*_probe_numbers(s.unit, lowest, highest, looks), *known],
        outputs=[
            Output(s.unit, "reference", **convention).named("reference"),
            Output("1", "standard deviation of the peak's place over its place").named("deviation"),
            Output("1", "1 while probing").named("probing"),
        ],
        period=period, sx=False, choices={"over": over},
        doc="Reference at the estimated peak, past it while the peak is unsure after a change.",
    )  # fmt: skip
    return block.with_params(**numbers) if numbers else block


def _probing(
    x: Exprs, u: Exprs, p: Exprs, best: Any, deviation: Any, period: float, looks: bool
) -> tuple[Exprs, Exprs]:
    """Next states and outputs of a probe that knows the peak, and how unsure it is."""
    begins = u["changed"]
    if looks:
        waited = ca.logic_and(ca.logic_not(x["probing"]), x["waited"] >= p["again"])
        begins = ca.logic_or(begins, ca.logic_and(waited, deviation > p["tolerance"]))
    elapsed = ca.if_else(begins, 0, x["elapsed"])
    before = ca.logic_or(begins, x["probing"])
    unsure = ca.logic_and(deviation > p["tolerance"], elapsed < p["longest"])
    probing = ca.logic_and(before, unsure)
    wanted = best * (1 + p["depth"] * probing)
    nxt: Exprs = {}
    if looks:
        looking = ca.logic_and(ca.logic_not(probing), x["waited"] >= p["again"])
        wanted = wanted + best * p["nudge"] * looking
        done = ca.logic_or(probing, x["waited"] + period >= p["again"] + p["look"])
        nxt["waited"] = ca.if_else(done, 0, x["waited"] + period)
    reference = ca.fmax(p["lowest"], ca.fmin(wanted, ca.fmin(p["highest"], u["limit"])))
    following = ca.fmin(elapsed + period, p["longest"])
    outputs = {"reference": reference, "deviation": deviation, "probing": probing}
    return {"elapsed": following, "probing": probing} | nxt, outputs


def _probe_inputs(law: Block, over: str, unknown: Sequence[str], highest: float) -> list[Signal]:
    """Inputs of a probe: the estimate, how sure it is, and its peak."""
    n, s = len(unknown), law.inputs[over]
    convention: Any = {"positive": s.positive, "per": s.per}
    covariance = Input("1", "covariance of the unknowns, in their units", shape=(n, n))
    return [
        *(Input(law.params[k].unit, f"estimate: {law.params[k].doc}").named(k) for k in unknown),
        covariance.named("covariance"),
        Input("1", "1 when the rail has changed").named("changed"),
        Input(s.unit, "peak of the estimated law", **convention).named("best"),
        Input(s.unit, "highest reference now", value=highest, **convention).named("limit"),
        *(law.inputs[k] for k in law.inputs if k != over),
    ]  # fmt: skip


def _probe_numbers(unit: str, lowest: float, highest: float, looks: bool) -> list[Signal]:
    """Parameters of a probe."""
    rows = [
        ("depth", "1", 0.4, "how far past the peak to probe, over its place", "chosen", 0, 2),
        ("lowest", unit, lowest, "lowest reference", "given", -1e12, 1e12),
        ("highest", unit, highest, "highest reference", "given", -1e12, 1e12),
        ("tolerance", "1", 0.02, "relative deviation of the peak that ends the probing", "chosen",
         1e-6, 1e12),
        ("longest", "s", 0.3, "longest time of probing", "chosen", 0, 60),
        ("again", "s", 1.0, "time after which it looks again", "chosen", 0, 3600),
        ("look", "s", 0.08, "how long it looks", "chosen", 0, 60),
        ("nudge", "1", 0.15, "how far it looks past the peak, over its place", "chosen", 0, 2),
    ]  # fmt: skip
    return [
        Param(u, value, doc, source, lo=lo, hi=hi).named(n)
        for n, u, value, doc, source, lo, hi in rows[: 8 if looks else 5]
    ]


class PeakBound(NamedTuple):
    """Smallest standard deviation that an unbiased estimate of a peak can have."""

    location: float
    height: float


def peak_bound(
    law: Block,
    over: str,
    at: float,
    samples: Mapping[str, Any],
    noise: float,
    *,
    measured: str | None = None,
    unknown: Sequence[str] | None = None,
    spread: Mapping[str, float] | None = None,
    **params: float,
) -> PeakBound:
    """Bound on the knowledge of a peak (Cramer-Rao): information of the samples, no estimator.

    With the Jacobian h_i of sample i the information is I = sum_i h_i h_i'/sigma^2. The place of
    the peak cannot be known better than sqrt(g I^-1 g'), its height not better than
    sqrt(h* I^-1 h*').

    Args:
        law: the law, with the true parameters as values or in ``params``.
        over: input along which the peak lies.
        at: its true place (other inputs at the mean of their samples).
        samples: values of each input of the law.
        noise: standard deviation of the measured output.
        measured: as given to :func:`slipctl.rls`.
        unknown: as given to :func:`slipctl.rls`.
        spread: standard deviation with which unknowns are known beforehand, in their units.
        **params: parameters of the law.

    Returns:
        Standard deviations of location and height; inf where the samples cannot tell.

    Raises:
        BadInput: unknown names, a noise that is not positive, samples missing or of two lengths.
    """
    measured, unknown = model.measured_output(law, measured), model.unknown_parameters(law, unknown)
    _scalar_input(law, over, "peak_bound")
    check_positive(f"peak_bound({law.name}): noise", noise)
    check_finite(f"peak_bound({law.name}): at", at)
    for k, deviation in (spread or {}).items():
        check_positive(f"peak_bound({law.name}): spread of {k}", deviation)
    for k in law.inputs:
        if k not in samples:
            raise BadInput(f"peak_bound({law.name}): samples lack {k} [{law.inputs[k].unit}]")
    names = [*law.inputs, *unknown]
    check_all_known(f"peak_bound({law.name}) has no", (*samples, *(spread or {})), names)
    where = f"peak_bound({law.name}): samples of"
    columns = [np.atleast_1d(samples_of(f"{where} {k}", samples[k])) for k in law.inputs]
    if not all(np.isfinite(c).all() for c in columns):
        raise BadInput(f"peak_bound({law.name}): samples must be finite numbers")
    if len({c.shape for c in columns}) != 1 or columns[0].ndim != 1:
        raise BadInput(f"peak_bound({law.name}): samples must be lists of one length")
    every = law.param_values(**params)
    values = ca.DM([float(every[k]) for k in unknown])
    known = model.stack_column(ca.DM(every[s.name]) for s in model.known_parameters(law, unknown))
    count, n = columns[0].size, len(unknown)
    inputs = ca.DM(np.array(columns).reshape(len(columns), count))
    many = [ca.repmat(c, 1, count) for c in (values, known)]
    rows = model.output_function(law, measured, unknown).map(count)(many[0], inputs, many[1])[1]
    H = np.array(ca.DM(rows).full()).reshape(count, n) / noise
    before = np.diag([1 / spread[k] if spread and k in spread else 0.0 for k in unknown])
    place = {k: at if k == over else c.mean() for k, c in zip(law.inputs, columns, strict=True)}
    peak = ca.DM([place[k] for k in law.inputs])
    g, _ = peak_gradient(law, over, measured, unknown)(values, peak, known)
    h = model.output_function(law, measured, unknown)(values, peak, known)[1]
    root = np.vstack([H, before])
    return PeakBound(*(_deviation(np.array(ca.DM(v).full()).ravel(), root) for v in (g, h)))


def peak_gradient(law: Block, over: str, measured: str, unknown: Sequence[str]) -> ca.Function:
    """Function (unknown, inputs, known) -> (g, curvature) at a peak along one input."""
    output = model.output_function(law, measured, unknown)
    sym: Any = ca.SX.sym if law.sx else ca.MX.sym
    names = "values", "at", "known"
    values, inputs, known = (sym(n, output.size1_in(k)) for k, n in enumerate(names))
    y, row = output(values, inputs, known)
    column = list(law.inputs).index(over)
    along = ca.jacobian(y, inputs)[:, column]
    curvature = ca.jacobian(along, inputs)[:, column]
    mixed = ca.jacobian(row, inputs)[:, column].T
    results = [ca.densify(-mixed / curvature), ca.densify(curvature)]
    return ca.Function("peak_gradient", [values, inputs, known], results, names,
                       ("slopes", "curvature"), {"cse": True})  # fmt: skip


def _deviation(g: np.ndarray, root: np.ndarray) -> float:
    """sqrt(g I^-1 g') with I = root' root; inf where I says nothing along g."""
    scale = np.linalg.norm(root, axis=0)
    if (g[scale == 0] != 0).any():
        return math.inf
    if (scale == 0).any():
        return _deviation(g[scale > 0], root[:, scale > 0])
    _, s, v = np.linalg.svd(root / scale, full_matrices=False)
    along = v @ (g / scale)
    seen = s > 1e-12 * s[0]
    if seen.sum() < g.size and np.linalg.norm(along[~seen]) > 1e-9 * np.linalg.norm(along):
        return math.inf
    return float(np.linalg.norm(along[seen] / s[seen]))


def _scalar_input(law: Block, over: str, who: str) -> None:
    check_known(f"{who}: {law.name} has no input", over, law.inputs)
    if any(s.shape != () for s in law.inputs.values()):
        raise BadInput(f"{who}: {law.name} has inputs that are no scalars")
