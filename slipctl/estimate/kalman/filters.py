"""Filters: unknown states, inputs and parameters of a flow from its measured signals.

* :func:`ctukf`: unscented Kalman filter, sampled or in differential form.
* :func:`ekf`: the same filter with the exact Jacobian in place of sigma points.
* :func:`observability`: whether the measurement tells the unknowns apart, from that Jacobian.
* :func:`lipschitz`: how fast the equations change over a region, enclosed by interval arithmetic.

What bounds them (pole, steady variance, consistency) is in :mod:`slipctl.certify.bounds.filters`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from slipctl.block.block import Block
from slipctl.block.signals import Param
from slipctl.errors import BadInput, check_known, check_whole
from slipctl.estimate.kalman.forms import differential_form, sampled_form
from slipctl.estimate.kalman.model import Numbers, Problem, by_name, unit_squared
from slipctl.estimate.kalman.moments import linear_moments, printed_22, sigma_points
from slipctl.estimate.kalman.signals import Setting
from slipctl.estimate.kalman.slopes import Lipschitz, Observability, lipschitz, observability

__all__ = [
    "FORMS", "PER", "Lipschitz", "Observability", "ctukf", "ekf", "lipschitz", "observability",
]  # fmt: skip

FORMS = ("sampled", "differential", "printed-22")
PER = ("sample", "second")


def ctukf(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    prior: Numbers,
    noise: Numbers,
    drift: Numbers = 0.0,
    start: Numbers | None = None,
    floor: Numbers | None = None,
    cap: Numbers | None = None,
    form: str = "sampled",
    per: str = "sample",
    method: str = "rk4",
    substeps: int = 1,
    period: float = 1e-3,
    **numbers: float,
) -> Block:
    """Make an unscented Kalman filter from a flow: a step block that runs once per period.

    ``ctukf(wheel, measured="omega", estimate="F_a", prior=4e6, noise=1.0, gamma=0.23)`` is the
    adhesion filter of Zhang 2021 on any flow ``wheel`` with the state omega and the input F_a.

    What is estimated: a state moves by its equation; an input or a parameter is a random walk.
    What is measured: a state that is not estimated is compared by its increments,
    z_k - z_(k-1) = f_z dt + noise (eqs (20)-(21)), and its last measured value goes into the
    equations. An estimated state or an output is compared directly. All other states and inputs
    that the equations need are inputs of the filter.

    Increments suit noise that drifts, as the paper has it. Where the sensor adds new noise to each
    sample, estimate the measured state too: ``estimate=("omega", "F_a")``.

    Args:
        block: a flow.
        measured: names of measured states and outputs.
        estimate: names of estimated states, inputs and parameters; scalars.
        prior: variance of each unknown before the first sample, in its unit squared; one per name,
            or a number where there is one name, as everywhere below.
        noise: of a measurement: R_w in unit^2/s for increments (their variance is R_w dt),
            variance of a sample in unit^2 for a direct one.
        drift: R_v of each unknown in unit^2/s.
        start: first estimates; by default the declared values, or the number next to zero.
        floor: least variance of each unknown given those before it; by default 1e-12 of the prior.
            P = 0 is an equilibrium of P+ = (1 + gamma) P, so it must be positive.
        cap: variance above which gamma rests; by default 1e12 of the prior. The variance of what
            is not seen would grow as (1 + gamma)^k.
        form: ``"sampled"`` (22)-(30); ``"differential"`` (31)-(33), discretised by ``sampled``;
            ``"printed-22"``: spread sqrt(sigma P) and the weights of N = 3 as printed.
        per: gamma acts ``"sample"`` by sample, P- = (1 + gamma) P, or per ``"second"``,
            P- = (1 + gamma dt) P, as printed (docs/errata.md).
        method: integration over a period: of estimated states by ``"euler"`` or ``"rk4"`` (sampled
            form), of the differential equations by any method of ``sampled``.
        substeps: steps of that method in one period.
        period: sample period in s.
        **numbers: gamma (default 0), sigma (default 2), or other parameters of the result.

    Returns:
        A step block. Inputs: the measured signals under their names, and what else the equations
        need. Outputs: each unknown under its name, ``variance_<unknown>``,
        ``innovation_<measured>`` and ``nis``, the normalised innovation squared. Parameters:
        ``gamma, sigma, prior_*, drift_*, floor_*, cap_*, noise_*`` and those of the flow. The
        estimate at a tick uses the other inputs of the tick before, so a controller may use it at
        once.

    Raises:
        BadInput: not a flow, an unknown name, a form that does not exist, a variance that is not
            positive, gamma or sigma that make a weight negative.
    """
    unknowns = 1 if isinstance(estimate, str) else len(estimate)
    _check_sigma(block.name, numbers.get("sigma", 2.0), unknowns)
    return _filter(
        "ctukf", FORMS, block, measured, estimate,
        moments=lambda p: printed_22(p["sigma"], p["beta"]) if "beta" in p
        else sigma_points(p["sigma"]),
        shape=_SIGMA if form != "printed-22" else (*_SIGMA, _BETA), prior=prior, noise=noise,
        drift=drift, start=start, floor=floor, cap=cap, form=form, per=per, method=method,
        substeps=substeps, period=period, numbers=numbers,
    )  # fmt: skip


_SPREAD = Param("1", 2.0, "spread of the sigma points", "Zhang 2021, Table 3", lo=0, hi=100)
_SIGMA = (_SPREAD.named("sigma"),)
_BETA = Param("1", 2.0, "extra weight", "Zhang 2021, Table 3", lo=0, hi=100).named("beta")


def _check_sigma(name: str, sigma: float, unknowns: int) -> None:
    if not sigma >= 0:
        weight = f"{sigma / (unknowns + sigma):.3g}" if unknowns + sigma else "infinite"
        raise BadInput(
            f"ctukf({name}): sigma = {sigma:g} makes the weight of the centre sigma/(N + sigma)"
            f" {weight}; it must not be negative, sigma = 2 would pass"
        )


def ekf(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    prior: Numbers,
    noise: Numbers,
    drift: Numbers = 0.0,
    start: Numbers | None = None,
    floor: Numbers | None = None,
    cap: Numbers | None = None,
    form: str = "sampled",
    per: str = "sample",
    method: str = "rk4",
    substeps: int = 1,
    period: float = 1e-3,
    **numbers: float,
) -> Block:
    """Make an extended Kalman filter: as :func:`ctukf`, with the exact Jacobian for sigma points.

    Where the equations are linear in the unknowns both give the same numbers; otherwise they differ
    by the square of the spread. It has no parameter sigma and no form ``"printed-22"``.
    """
    return _filter(
        "ekf", FORMS[:2], block, measured, estimate, moments=lambda p: linear_moments, shape=(),
        prior=prior, noise=noise, drift=drift, start=start, floor=floor, cap=cap, form=form,
        per=per, method=method, substeps=substeps, period=period, numbers=numbers,
    )  # fmt: skip


def _filter(
    kind: str, forms: Sequence[str], block: Block, measured: str | Sequence[str],
    estimate: str | Sequence[str], *, form: str, per: str, method: str, substeps: int,
    period: float, numbers: dict[str, float], prior: Numbers, noise: Numbers, drift: Numbers,
    start: Numbers | None, floor: Numbers | None, cap: Numbers | None, **of_kind: Any,
) -> Block:  # fmt: skip
    """Check what both filters share, and build the block."""
    who = f"{kind}({block.name})"
    for word, value, known in (("form", form, forms), ("per", per, PER)):
        check_known(f"{who} has no {word}", value, known)
    if not (math.isfinite(period) and period > 0):
        raise BadInput(f"{who}: period = {period:g} s must be positive")
    check_whole(f"{who}: substeps", substeps)
    gamma = float(numbers.get("gamma", 0.0))
    highest = 1.0 if per == "sample" else math.inf
    if not 0 <= gamma <= highest:
        scale = 1.0 if per == "sample" else period
        weight = f"{1 / (1 + gamma * scale):.3g}" if 1 + gamma * scale else "infinite"
        raise BadInput(
            f"{who}: gamma = {gamma:g} makes the weight of the past 1/(1 + gamma) {weight}; it must"
            f" lie in [0, {highest:g}], gamma = 0.23 would pass"
        )
    problem = Problem.of(kind, block, measured, estimate)
    squares = {s.name: unit_squared(s.unit) for s in problem.unknown}
    rates = {s.name for s in problem.increments}
    noises = {s.name: unit_squared(s.unit) + "/s" * (s.name in rates) for s in problem.measured}
    before = by_name(who, "prior", prior, squares, "positive")
    least: Numbers = {k: 1e-12 * v for k, v in before.items()} if floor is None else floor
    most: Numbers = {k: 1e12 * v for k, v in before.items()} if cap is None else cap
    first = by_name(
        who, "start", {} if start is None else start,
        {s.name: s.unit for s in problem.unknown}, "finite", partial=True,
    )  # fmt: skip
    choices = {
        "form": form, "per": per, "flow": block.name,
        "measured": ", ".join(s.name for s in problem.measured),
        "estimate": ", ".join(s.name for s in problem.unknown),
    }  # fmt: skip
    setting = Setting(
        kind, prior=before, start=first, gamma=gamma, per=per, period=period, choices=choices,
        drift=by_name(who, "drift", drift, {k: f"{u}/s" for k, u in squares.items()},
                      "not negative"),
        floor=by_name(who, "floor", least, squares, "positive"),
        cap=by_name(who, "cap", most, squares, "positive"),
        noise=by_name(who, "noise", noise, noises, "positive"),
        doc=_DOC[kind] + _DOC["differential" if form == "differential" else "sampled"], **of_kind,
    )  # fmt: skip
    make = differential_form if form == "differential" else sampled_form
    made = make(problem, setting, method, int(substeps))
    return made.with_params(**numbers) if numbers else made


_DOC = {
    "ctukf": "Unscented Kalman filter after Zhang 2021, eqs (18)-(33).\n\n"
    "C(f, g) is the covariance of f and g over the points x, x +- sqrt((N + sigma) P), weighted by"
    " sigma/(N + sigma) and 1/(2 (N + sigma)).\n",
    "ekf": "Extended Kalman filter.\n\nC(f, g) = F P G' with the exact Jacobians of f and g.\n",
    "sampled": "x- = f(x), P- = (1 + gamma) C(f, f) + R_v dt;  z^ = h(x-), S = C(h, h) + R,"
    " K = C(x, h)/S;\nx+ = x- + K (z - z^), P+ = P- - K S K', not below its floor.",
    "differential": "K = C(x, h)/R_w, x' = f + K (z' - h),"
    " P' = C(x, f) + C(f, x) + gamma P + R_v - K R_w K'.",
}
