"""The two forms of a Kalman filter, whatever carries mean and covariance through the equations.

Both have the same inputs, outputs and parameters: see :mod:`slipctl.estimate.kalman.signals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.transforms.discretisation import check_step, sampled
from slipctl.block.units.unit_algebra import one
from slipctl.certify.bounds.filters import rate
from slipctl.certify.bounds.steps import METHODS, largest_step
from slipctl.errors import BadInput
from slipctl.estimate.kalman import signals
from slipctl.estimate.kalman.model import Problem, per_second, start_value
from slipctl.estimate.kalman.moments import Vector, factors, forward, solve, with_floor
from slipctl.estimate.kalman.signals import Names, Setting

PREDICTIONS = ("euler", "rk4")
"""Methods that carry states from tick to tick in the sampled form."""


def sampled_form(problem: Problem, setting: Setting, method: str, substeps: int) -> Block:
    """Filter by samples: predict from the tick before to this one, then correct."""
    _check_prediction(problem, method)
    names, unknown = Names(problem), problem.unknown
    if problem.moving:
        motion = _motion(problem, setting)
        check_step(motion, setting.period / substeps, method, substeps)
    ordered = (*problem.increments, *problem.direct)
    exact = not problem.moving and setting.choices["form"] != "printed-22"

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        dt, n = setting.period * one("s"), range(problem.n)
        moments, floor = setting.moments(p), [p[names.floor[s.name]] for s in unknown]
        constants = {s.name: p[s.name] for s in problem.params}
        before = constants | {k: x[names.held[k]] for k in sorted(problem.in_rates)}
        now = constants | {k: u[k] for k in sorted(problem.in_outputs)}
        begun = x[names.begun] > 0

        def at(point: Vector, known: Exprs) -> Exprs:
            return known | {s.name: v for s, v in zip(unknown, point, strict=True)}

        def ahead(point: Vector) -> Vector:
            return _integrate(lambda q: problem.rates(at(q, before))[0], point, dt / substeps,
                              method, substeps)  # fmt: skip

        def measure(point: Vector) -> Vector:
            increments = problem.rates(at(point, before))[1] if problem.increments else []
            return [*(dt * v for v in increments), *problem.outputs(at(point, now))]

        # from the tick before to this one; the first tick has none before it
        old, P = names.mean(problem, x), names.matrix(problem, x)
        moved, _, wider = (old, P, P) if exact else moments(ahead, old, P, floor)
        gamma = p["gamma"] if setting.per == "sample" else p["gamma"] * dt
        grown = _grown(wider, gamma, p, [names.cap[s.name] for s in unknown])
        Q = [p[names.drift[s.name]] * dt for s in unknown]
        mean = old if exact else [ca.if_else(begun, moved[i], old[i]) for i in n]
        P = [
            [ca.if_else(begun, grown[i][j] + (Q[i] if i == j else 0), P[i][j]) for j in n]
            for i in n
        ]

        # this tick's sample; an increment counts from the second tick on
        expected, cross, S = moments(measure, mean, P, floor)
        innovation: Vector = []
        for k, s in enumerate(ordered):
            R = p[names.noise[s.name]]
            if problem.by_increments(s):
                off = u[s.name] - x[names.held[s.name]] - expected[k]
                innovation.append(ca.if_else(begun, off, 0))
                for row in cross:
                    row[k] = ca.if_else(begun, row[k], 0)
                for j in range(len(S)):
                    S[k][j] = S[j][k] = ca.if_else(begun, S[k][j], 0)
                S[k][k] = S[k][k] + R * dt
            else:
                innovation.append(u[s.name] - expected[k])
                S[k][k] = S[k][k] + R
        L, D = factors(S)
        gain = [solve(L, D, row) for row in cross]
        mean = [mean[i] + _dot(gain[i], innovation) for i in n]
        P = with_floor([[P[i][j] - _dot(gain[i], cross[j]) for j in n] for i in n], floor)

        white = forward(L, innovation)
        results = {names.innovation[s.name]: v for s, v in zip(ordered, innovation, strict=True)}
        results |= {s.name: v for s, v in zip(unknown, mean, strict=True)}
        results |= {names.variance[s.name]: P[i][i] for i, s in enumerate(unknown)}
        results["nis"] = _dot(white, [w / d for w, d in zip(white, D, strict=True)])
        return names.states(problem, mean, P) | signals.state_for_next(problem, names, u), results

    return make_block(
        setting.kind, "step", body,
        states=[*signals.filter_states(problem, setting, names),
                *signals.held_states(problem, names)],
        inputs=signals.filter_inputs(problem),
        params=signals.filter_params(problem, setting, names),
        outputs=signals.filter_outputs(problem, names), period=setting.period, sx=problem.block.sx,
        units=problem.block.units, choices=setting.choices, doc=setting.doc,
    )  # fmt: skip


def _check_prediction(problem: Problem, method: str) -> None:
    if method not in PREDICTIONS:
        raise BadInput(
            f"{problem.who}: a sampled filter predicts by {' or '.join(PREDICTIONS)}, not"
            f" {method!r}; form='differential' takes {', '.join(METHODS)}"
        )


def _grown(wider: Sequence[Vector], gamma: Any, p: Exprs, caps: Sequence[str]) -> list[Vector]:
    """Covariance that gamma has made wider; the variance of none beyond its cap."""
    n = range(len(caps))
    growth = [ca.fmin(1 + gamma, ca.fmax(1, p[caps[i]] / wider[i][i])) for i in n]
    return [
        [wider[i][j] * (growth[i] if i == j else ca.sqrt(growth[i] * growth[j])) for j in n]
        for i in n
    ]


def differential_form(problem: Problem, setting: Setting, method: str, substeps: int) -> Block:
    """Filter by its differential equations, from the tick before to this one."""
    if method in METHODS and setting.gamma > 0:
        per_s = rate(setting.gamma) / (1 if setting.per == "second" else setting.period)
        longest = largest_step(complex(-per_s), method)
        if setting.period / substeps > longest:
            needed = math.ceil(setting.period / longest)
            raise BadInput(
                f"{problem.who}: gamma makes a mode of {1e3 / per_s:.3g} ms, too fast for {method}"
                f" in {substeps} steps of a period; use substeps={needed}"
            )
    names = Names(problem)
    return _discretised(problem, names, _rates(problem, setting, names), setting, method, substeps)


def _rates(problem: Problem, setting: Setting, names: Names) -> Block:
    """Return the differential equations, a flow; inputs are measured rates and known values."""
    unknown, measured = problem.unknown, (*problem.increments, *problem.direct)
    by_increments = {s.name for s in problem.increments}

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        dt, n = setting.period * one("s"), range(problem.n)
        floor = [p[names.floor[s.name]] for s in unknown]
        known = {s.name: p[s.name] for s in problem.params}
        known |= {k: u[k] for k in sorted(problem.in_rates | problem.in_outputs)}
        mean, P = names.mean(problem, x), names.matrix(problem, x)

        def both(point: Vector) -> Vector:
            values = known | {s.name: v for s, v in zip(unknown, point, strict=True)}
            moving, increments = problem.rates(values)
            return [*moving, *increments, *problem.outputs(values)]

        expected, cross, own = setting.moments(p)(both, mean, P, floor)
        gamma = p["gamma"] if setting.per == "second" else p["gamma"] / dt
        growth = [
            ca.if_else(P[i][i] < p[names.cap[s.name]], gamma, 0) for i, s in enumerate(unknown)
        ]
        noise = [p[names.noise[s.name]] for s in measured]
        R = [v if s.name in by_increments else v * dt for s, v in zip(measured, noise, strict=True)]
        seen = [u[names.rate[s.name] if s.name in by_increments else s.name] for s in measured]
        off = [v - e for v, e in zip(seen, expected[problem.n :], strict=True)]
        K = [[c / r for c, r in zip(row[problem.n :], R, strict=True)] for row in cross]
        rates = [expected[i] + _dot(K[i], off) for i in n]
        change = [
            [
                cross[i][j] + cross[j][i]
                + (growth[i] if i == j else (growth[i] + growth[j]) / 2) * P[i][j]
                - _dot(K[i], [k * r for k, r in zip(K[j], R, strict=True)])
                + (p[names.drift[s.name]] if i == j else 0)
                for j in n
            ]
            for i, s in enumerate(unknown)
        ]  # fmt: skip

        # what a sample of this tick says: an increment is a rate times dt
        scale = [dt if s.name in by_increments else 1 for s in measured]
        innovation = [a * v for a, v in zip(scale, off, strict=True)]
        S = [
            [a * b * own[problem.n + k][problem.n + j] for j, b in enumerate(scale)]
            for k, a in enumerate(scale)
        ]
        for k, (a, r) in enumerate(zip(scale, R, strict=True)):
            S[k][k] = S[k][k] + (a * r if measured[k].name in by_increments else noise[k])
        L, D = factors(S)
        white = forward(L, innovation)
        results = {names.innovation[s.name]: v for s, v in zip(measured, innovation, strict=True)}
        results["nis"] = _dot(white, [w / d for w, d in zip(white, D, strict=True)])
        return names.states(problem, rates, change), results

    rates = [
        s.as_role("input", unit=per_second(s.unit), doc=f"measured rate of {s.name}", value=None,
                  lo=-math.inf, hi=math.inf).named(names.rate[s.name])
        for s in problem.increments
    ]  # fmt: skip
    here = problem.in_rates | problem.in_outputs | {s.name for s in problem.direct}
    own = {names.innovation[s.name] for s in measured} | {"nis"}
    return make_block(
        setting.kind, "flow", body, states=signals.filter_states(problem, setting, names),
        inputs=[*rates, *(s for s in signals.filter_inputs(problem) if s.name in here)],
        params=signals.filter_params(problem, setting, names),
        outputs=[s for s in signals.filter_outputs(problem, names) if s.name in own],
        sx=problem.block.sx, units=problem.block.units, choices=setting.choices, doc=setting.doc,
    )  # fmt: skip


def _refuse_stiff_variance(
    problem: Problem, names: Names, flow: Block, method: str, h: float, substeps: int
) -> None:
    """Refuse a step in which the start variance would be forgotten, for implicit methods too.

    P' = -H^2 P^2/R has a second solution below zero, and Newton's method goes there from a step
    beyond 1.37 R/(H^2 P); Euler's limit, R/(H^2 P), stays away from it.
    """
    x = flow.pack("state", flow.start())
    u = flow.pack("input", {n: start_value(flow, s) for n, s in flow.inputs.items()})
    p = flow.pack("param", flow.param_values())
    slopes: Any = flow.f.factory("slopes", ["x", "u", "p"], ["jac:n:x"])(x, u, p)
    rows = [k for k, n in enumerate(flow.states) if n in names.P.values()]
    J = np.array(ca.DM(slopes).full())[np.ix_(rows, rows)]
    if not np.isfinite(J).all():
        return
    longest = min(largest_step(complex(e), "euler") for e in np.linalg.eigvals(J))
    if h / substeps > longest:
        raise BadInput(
            f"{problem.who}: the start variance makes a step of {h / substeps * 1e3:g} ms too long"
            f" for {method}, {longest * 1e3:.3g} ms would do; use substeps="
            f"{math.ceil(h / longest)}, a smaller prior or form='sampled'"
        )


def _discretised(
    problem: Problem, names: Names, flow: Block, setting: Setting, method: str, substeps: int
) -> Block:
    """Step over the time since the last tick, on the mean rates measured in it."""
    if method not in PREDICTIONS and method in METHODS:
        _refuse_stiff_variance(problem, names, flow, method, setting.period, substeps)
    try:
        motion = sampled(flow, setting.period, method, substeps)
    except BadInput as error:
        reason = str(error).removeprefix(f"{flow.name}: ")
        raise BadInput(f"{problem.who}: {reason}") from None
    unknown = problem.unknown

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        begun = x[names.begun] > 0
        known = {k: u[k] for k in flow.inputs if k in u}
        known |= {k: x[names.held[k]] for k in problem.in_rates}
        known |= {
            names.rate[s.name]: (u[s.name] - x[names.held[s.name]]) / setting.period
            for s in problem.increments
        }
        here = {k: x[k] for k in flow.states}
        moved, y = motion.expr(here, known, {k: p[k] for k in flow.params})
        nxt = {k: ca.if_else(begun, moved[k], here[k]) for k in flow.states}
        floor = [p[names.floor[s.name]] for s in unknown]
        mean, P = names.mean(problem, nxt), with_floor(names.matrix(problem, nxt), floor)
        results = {k: ca.if_else(begun, v, 0) for k, v in y.items()}
        results |= {s.name: v for s, v in zip(unknown, mean, strict=True)}
        results |= {names.variance[s.name]: P[i][i] for i, s in enumerate(unknown)}
        return names.states(problem, mean, P) | signals.state_for_next(problem, names, u), results

    def rebuild(parts: dict[str, Block]) -> Block:
        return _discretised(problem, names, parts[flow.name], setting, method, substeps)

    return make_block(
        setting.kind, "step", body,
        states=[*flow.states.values(), *signals.held_states(problem, names)],
        inputs=signals.filter_inputs(problem), params=flow.params.values(),
        outputs=signals.filter_outputs(problem, names), period=setting.period, sx=motion.sx,
        units=flow.units, doc=flow.doc,
        choices=flow.choices | {"method": method, "substeps": substeps},
        parts={flow.name: flow}, rebuild=rebuild, transparent=True,
        sharing=flow.sharing.through(),
    )  # fmt: skip


def _motion(problem: Problem, setting: Setting) -> Block:
    """Return the estimated states alone, all else an input at its start, to check the step."""
    states = [s for s in problem.unknown if s.role == "state"]
    others = [s for s in problem.unknown if s.role != "state"]
    before = [s for s in (*problem.known, *problem.increments) if s.name in problem.in_rates]
    first = partial(signals.first_estimate, problem, setting)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        rates = problem.rates({**u, **p, **x})[0]
        pairs = zip(problem.unknown, rates, strict=True)
        return {s.name: v for s, v in pairs if s.role == "state"}, {}

    return make_block(
        problem.block.name, "flow", body,
        states=[s.valued(first(s)) for s in states],
        inputs=[
            *(s.as_role("input", value=first(s)) for s in others),
            *(s.as_role("input", value=start_value(problem.block, s)) for s in before),
        ],
        params=problem.params, sx=problem.block.sx,
    )  # fmt: skip


def _integrate(
    rates: Callable[[Vector], Vector], x: Vector, h: Any, method: str, substeps: int
) -> Vector:
    """Explicit steps of a vector of scalars; what stands still is left alone."""

    def along(x: Vector, k: Vector, h: Any) -> Vector:
        return [v if _still(d) else v + h * d for v, d in zip(x, k, strict=True)]

    for _ in range(substeps):
        a = rates(x)
        if method == "rk4":
            b = rates(along(x, a, h / 2))
            c = rates(along(x, b, h / 2))
            d = rates(along(x, c, h))
            a = [
                k1 if _still(k1) else (k1 + 2 * k2 + 2 * k3 + k4) / 6
                for k1, k2, k3, k4 in zip(a, b, c, d, strict=True)
            ]
        x = along(x, a, h)
    return x


def _still(rate: Any) -> bool:
    return isinstance(rate, float) and rate == 0.0


def _dot(a: Vector, b: Vector) -> Any:
    return sum((u * v for u, v in zip(a[1:], b[1:], strict=True)), a[0] * b[0])
