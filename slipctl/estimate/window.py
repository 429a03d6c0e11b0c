"""Windowed Gauss-Newton: the law is fitted to all samples kept since the last detected change.

Minimised over theta, with m_i, u_i the samples kept and sigma their noise,

    J = 1/2 sum_i ((m_i - f(u_i; theta))/sigma)^2 + 1/2 (theta - mean)' Lambda (theta - mean)

The second term is what is known besides: the spread around the old estimate after a change. From
then on it is also the samples that have left the window, linearised where they left it. So P, the
inverse of the Hessian of J, never grows beyond the spread, whatever the excitation.

A change is looked for in the residuals e_i of new samples before they are used, over their
standard deviations t_i. With ``memory`` = 1 it is |t| > gate, and sigma is the declared noise.

With more it is the generalised likelihood ratio of a shift k samples ago, and sigma is what the
residuals of the window show, with nu degrees of freedom. The declared noise counts as BELIEF
samples, and alone below n + 2. With r the largest (t_1 + ... + t_k)^2/k over k up to the memory,

    nu ln(1 + r/nu) > gate^2

tells a change (twice the log-likelihood ratio of Student's t; gate^2 = r for many nu). So a shift D
is found after the smallest k with D^2 > s^2 nu (exp(gate^2/nu) - 1)/k, :func:`smallest_shift`.

What residuals show is taken for noise up to ``coarsest``. Samples that the law cannot fit, such as
wrong ones, would show so much of it that no change is found any more.

With ``recall`` a change may be taken back (:mod:`slipctl.estimate.recall`). What an estimate with
half a window knows is put aside when a change is told. It is in force again once so many samples in
a row agree with it. Each is to be within ``gate`` deviations, of the declared noise at least. With
more memory the sum of k of them is to be within gate sqrt(k), as the detector asks. If the window
is full before, it is another curve. So wrong samples cost no more than the time that they lasted.

Parameters are told within the ranges of the law. The estimate itself may lie beyond, up to
``farthest``: while the samples say little of one parameter, its way back leads there. A single
unknown has no such way, so it stays in its range: beyond it a law may be flat, and no step leads
back.

A fit may be worked out over several ticks, ``iterations_per_tick`` in each. It begins with the
sample of its first tick, and samples that come meanwhile are left out. Coordinates and covariance
come with the last tick, to the bit those of a fit in one; ``changed`` comes with the first.

With ``echo`` the noise of a sample comes back with the opposite sign in the next, and sigma is that
of one of the two. Residuals and regressors are then innovations
(:mod:`slipctl.estimate.noise_weights`), in which a shift grows: it leaves 1, 1 + echo, ... of
itself.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Param, Signal, State
from slipctl.block.text.intermediates import remember_locals
from slipctl.errors import BadInput, check_whole
from slipctl.estimate import recall as taken_back
from slipctl.estimate.model import Model, covariance_state, spread_param, theta_state
from slipctl.estimate.noise_weights import echoing_sums, shift_ratios, signature, white_sums
from slipctl.seek.random import epsilon

DAMPING = 0.1
"""Damping of the first iteration after a change, relative to the diagonal of the Hessian
(Marquardt 1963); a success divides it by 4, a failure multiplies it by 4, and it is kept from tick
to tick, because the valley along which a, b and c trade off is narrow and bent."""

LEAST, MOST = 1e-9, 1e9
"""Range of the damping: without effect, and standing still."""

BLIND = 64.0
"""Beyond BLIND / sqrt(eps) damping begins anew. Steps as short as that change J by less than its
rounding, so they fail whatever the data say, and damping would stay at MOST for ever, the estimate
still. In double it is beyond MOST, in float 2e5: far above what a bent valley needs."""

ROUNDED = 1e-5
"""Rounding that a variance may have beyond the spread, in float and in double."""


BELIEF = 0.01
"""Samples that the declared noise counts for, beside those seen. Without noise s falls to
sigma sqrt(BELIEF/count), 1 % of sigma, which keeps H within what float can invert."""


KNOWN = ("theta", "P", "scatter", "mean", "Lambda", "count", "kept")
"""What an estimate knows."""

DATA = ("theta", "kept", "weights", "mean", "Lambda", "sigma2", "constants")
"""Arguments of the normal equations."""


def windowed_estimator(
    model: Model, period: float, window: int, iterations: int, memory: int = 1, echo: float = 0.0,
    recall: int = 0, per_tick: int | None = None,
) -> Block:  # fmt: skip
    """Make the windowed estimator; use :func:`slipctl.rls` with ``form="window"``."""
    n, rows = model.n, sum(s.size for s in model.law.inputs.values()) + 1
    unit = model.law.outputs[model.measured].unit
    if echo:
        sums, heard = echoing_sums(model, window, echo)
    else:
        sums = white_sums(model, window)
    normal = _normal_equations(model, sums)
    iterate = _iteration(normal)
    solve, invert = _solver(n), _inverse(n)
    per_tick = iterations if per_tick is None else per_tick
    several = per_tick < iterations

    def variance(x: Exprs, row: Any, p: Exprs) -> Any:
        """Variance of the residual of a new sample: its noise, and what is not known."""
        doubt = ca.fmax(row.T @ x["P"] @ row, 0)  # in float P may not be definite
        noise = ca.fmin(x["scatter"], p["coarsest"] ** 2)
        return noise * (1 + doubt / p["noise"] ** 2) if memory == 1 else noise + doubt

    def recalled(
        x: Exprs, inputs: Any, measurement: Any, constants: Any, p: Exprs
    ) -> tuple[Exprs, Exprs, Any]:
        """States, what counts samples that agree with the former one, and whether it is back."""
        former = {name: x[f"former_{name}"] for name in KNOWN}
        told = former | {"scatter": ca.fmax(former["scatter"], p["noise"] ** 2)}
        predicted, h = model.predict(former["theta"], inputs, constants)
        off, may = measurement - predicted, variance(told, h, p)
        t = off / (p["gate"] * ca.sqrt(may)) if memory > 1 else None
        counts, back = taken_back.count_sample(x, off**2 <= p["gate"] ** 2 * may, recall, t)
        taken = former | {"unsettled": 0, "damping": DAMPING}
        taken |= {"shifts": 0} if memory > 1 else {}
        return dict(x) | {k: ca.if_else(back, v, x[k]) for k, v in taken.items()}, counts, back

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        constants, declared = model.constants(p), p["noise"] ** 2
        least = p["spread"] ** -2
        Lambda_0 = ca.densify(ca.diag(least))
        inputs, measurement = model.sample(u)
        begun = x
        if recall:
            x, counts, back = recalled(x, inputs, measurement, constants, p)
        theta = x["theta"]
        predicted, h = model.predict(theta, inputs, constants)
        e = measurement - predicted
        new, row = (e + x["echoed"][0], h + x["echoed"][1:]) if echo else (e, h)

        # a change: the residual is beyond the prediction interval of the regression
        enough = x["count"] >= n + 2  # fewer cannot tell a change from an unknown
        if memory == 1:
            changed = ca.logic_and(enough, new**2 > p["gate"] ** 2 * variance(x, row, p))
        else:
            shift = new / ca.sqrt(variance(x, row, p))
            shifts = ca.horzcat(ca.if_else(enough, shift, 0), x["shifts"][:, :-1])
            ratios = shift_ratios(shifts, memory, echo)
            freedom = BELIEF + ca.fmax(0, x["count"] - n)
            changed = freedom * ca.log1p(ca.mmax(ratios) / freedom) > p["gate"] ** 2
        unsettled = ca.if_else(changed, p["settling"], ca.fmax(0, x["unsettled"] - 1))
        again = ca.logic_or(ca.logic_or(changed, x["count"] == 0), x["unsettled"] > 0)

        sigma2 = declared
        if memory > 1:
            sigma2 = ca.if_else(ca.logic_or(again, x["count"] < n + 2), declared, x["scatter"])

        # what leaves the window stays as information
        if echo:
            values, slopes = model.parameters(theta)
            *_, JJ, Je = sums(values, x["kept"], ca.DM.ones(1, window), constants)
            seen, told = slopes.T @ JJ @ slopes, slopes.T @ Je
        else:
            last = x["kept"][:, -1]
            old, g = model.predict(theta, last[:-1], constants)
            seen, told = g @ g.T, g * (last[-1] - old)
        kept_share = p["forgetting"] * x["Lambda"]
        Lambda = kept_share + (1 - p["forgetting"]) * Lambda_0 + seen / sigma2
        pull = kept_share @ (x["mean"] - theta) + told / sigma2
        mean = theta + solve(Lambda, pull, least)
        full = x["count"] == window
        Lambda = ca.if_else(again, Lambda_0, ca.if_else(full, Lambda, x["Lambda"]))
        mean = ca.if_else(again, theta, ca.if_else(full, mean, x["mean"]))

        # the window, newest first; unused places repeat the first sample, with weight 0
        sample = ca.vertcat(inputs, measurement)
        kept = ca.if_else(
            again, ca.repmat(sample, 1, window), ca.horzcat(sample, x["kept"][:, :-1])
        )
        count = ca.if_else(again, 1, ca.fmin(window, x["count"] + 1))

        damping = ca.if_else(again, DAMPING, x["damping"])
        begins = begun["left"] <= 0 if several else True

        def now(name: str, new: Any) -> Any:
            """What a fit begins with, or what it has come to."""
            return ca.if_else(begins, new, begun[name]) if several else new

        kept, count, Lambda = now("kept", kept), now("count", count), now("Lambda", Lambda)
        weights = count > ca.DM(range(window)).T
        unsettled, changed = now("unsettled", unsettled), now("told", changed)
        predicted, e = now("predicted_then", predicted), now("residual_then", e)
        mean_now, sigma2 = now("mean_now", mean), now("sigma2", sigma2)
        data = (kept, weights, mean_now, Lambda, sigma2, constants)
        arithmetic = (least, epsilon(ca.fmin(count, 1)))
        first = (theta, *normal(theta, *data), damping)
        state = tuple(now(k, new) for k, new in zip(HAND, first, strict=True))
        for _ in range(per_tick):
            state = iterate(*state, *arithmetic, *data)
        hand = dict(zip(HAND, state, strict=True))
        theta, _, squares, H, _, damping = state
        theta, mean = (_near(v, model, p["farthest"]) for v in (theta, mean_now))
        P = invert(H, least)
        if memory == 1:
            scatter = declared + squares / count
        else:
            scatter = (BELIEF * declared + squares) / (BELIEF + ca.fmax(0, count - n))
        nxt = {
            "theta": theta, "P": P, "scatter": scatter, "mean": mean,
            "Lambda": Lambda, "count": count, "unsettled": unsettled, "kept": kept,
            "damping": damping,
        }  # fmt: skip
        if memory > 1:
            nxt["shifts"] = ca.if_else(again, 0, shifts)
        if recall:
            left = ca.logic_and(changed, x["count"] >= window / 2)
            over = ca.logic_or(back, count == window)
            nxt |= taken_back.put_aside(x, KNOWN, counts, left, over)
        if echo:
            values, slopes = model.parameters(theta)
            left = heard(values, kept, weights, constants)
            nxt["echoed"] = ca.vertcat(left[0], slopes.T @ left[1:])
        if several:
            left = now("left", iterations) - per_tick
            nxt |= {
                k: ca.if_else(left <= 0, nxt[k], begun[k])
                for k in ("theta", "P", "scatter", "mean", "echoed") if k in nxt
            } | {
                k: now(k, v) for k, v in nxt.items()
                if k in ("shifts", "agreed", "summed") or k.startswith("former_")
            } | {k: hand[k] for k in HAND if k != "damping"} | {
                "left": left, "mean_now": mean_now, "sigma2": sigma2, "told": changed,
                "predicted_then": predicted, "residual_then": e,
            }  # fmt: skip
            if recall:
                nxt["recalled_then"] = back = now("recalled_then", back)
            theta, P = nxt["theta"], nxt["P"]
        results = model.results(theta, P, predicted, e, changed)
        told = {name: model.law.params[name] for name in model.unknown}
        results |= {k: ca.fmax(s.lo, ca.fmin(s.hi, results[k])) for k, s in told.items()}
        return nxt, results | ({"recalled": back} if recall else {})

    states = [
        theta_state(model), covariance_state(n),
        State(f"({unit})^2", 0.0, "noise seen: sigma^2 and mean square residual").named("scatter"),
        State("1", model.guess, "centre of what is known besides", shape=(n,)).named("mean"),
        State("1", 0.0, "information besides the window", shape=(n, n)).named("Lambda"),
        State("1", 0.0, "samples in the window").named("count"),
        State("1", 0.0, "samples still to be replaced after a change").named("unsettled"),
        State("1", DAMPING, "damping of the next iteration").named("damping"),
        State("1", 0.0, "samples, newest first, each in its units",
              shape=(rows, window)).named("kept"),
    ]  # fmt: skip
    if memory > 1:
        states.append(State("1", 0.0, "latest residuals over their standard deviations, newest"
                            " first", shape=(1, memory)).named("shifts"))  # fmt: skip
    if echo:
        states.append(State("1", 0.0, "what the next residual hears of the newest noise, in units"
                            " of the measurement, and its regressor",
                            shape=(n + 1,)).named("echoed"))  # fmt: skip
    if recall:
        states += taken_back.states([s for s in states if s.name in KNOWN], memory > 1)
    states += _in_hand(model, unit, recall) if several else []
    return make_block(
        "rls", "step", body, states=states,
        inputs=model.inputs(),
        params=[
            Param(unit, 1e-3, "standard deviation of the measurement", lo=1e-12,
                  hi=1e12).named("noise"),
            spread_param(n, 2.0),
            Param("1", 5.0, "residual taken for a change, over its standard deviation", lo=1,
                  hi=1e12).named(
                "gate"
            ),
            Param(unit, 1e12, "largest standard deviation that residuals are taken for noise with;"
                  " samples that the law cannot fit would hide the next change", lo=1e-12,
                  hi=1e12).named("coarsest"),
            Param("1", 1e12, "how far a coordinate may go from its first guess; where nothing is"
                  " to be measured, a logarithm would fall for ever", lo=1e-12,
                  hi=1e12).named("farthest"),
            Param("1", 0.0, "samples after a change in which the sensor still mixes before and"
                  " after; the newest replaces them", lo=0, hi=1000).named("settling"),
            Param("1", 1.0, "weight of what left the window, per sample; below 1 the estimate"
                  " wanders where the slip shows nothing", lo=1e-3, hi=1).named("forgetting"),
            *model.known(),
        ],
        outputs=[
            *model.outputs(),
            *taken_back.outputs(recall),
        ],
        period=period, sx=False,
        choices=model.describe("window") | {"window": window, "iterations": iterations}
        | ({"iterations per tick": per_tick} if several else {})
        | ({"memory": memory} if memory > 1 else {}) | ({"echo": echo} if echo else {})
        | ({"recall": recall} if recall else {}),
        doc=__doc__ or "",
    )  # fmt: skip


HAND = ("theta_now", "J", "squares", "H", "r", "damping")
"""States of a fit in hand, in the order of an iteration."""


def _in_hand(model: Model, unit: str, recall: int) -> list[Signal]:
    """States of a fit that is worked out over several ticks."""
    n = model.n
    return [
        State("1", 0.0, "iterations left of the fit in hand").named("left"),
        State("1", model.guess, "coordinates of the fit in hand", shape=(n,)).named("theta_now"),
        State("1", 0.0, "its cost").named("J"),
        State(f"({unit})^2", 0.0, "its sum of squares").named("squares"),
        State("1", 0.0, "its Hessian", shape=(n, n)).named("H"),
        State("1", 0.0, "minus its gradient", shape=(n,)).named("r"),
        State("1", model.guess, "its centre of what is known besides", shape=(n,)).named(
            "mean_now"
        ),
        State(f"({unit})^2", 0.0, "its variance of a sample").named("sigma2"),
        State(unit, 0.0, "its sample as it was predicted").named("predicted_then"),
        State(unit, 0.0, "its sample minus that").named("residual_then"),
        State("1", 0.0, "whether that told a change").named("told"),
        *[State("1", 0.0, "whether it took one back").named("recalled_then")][: recall > 0],
    ]


def _near(theta: Any, model: Model, far: ca.MX) -> Any:
    """Coordinates no further than so much from the first guess; one alone stays in its range."""
    guess, (lo, hi) = ca.DM(model.guess), model.ends()
    least = guess - far if math.isinf(lo) else ca.fmax(lo, guess - far)
    largest = guess + far if math.isinf(hi) else ca.fmin(hi, guess + far)
    return ca.fmax(least, ca.fmin(largest, theta))


def smallest_shift(
    noise: float, samples: int, latest: int = 1, unknown: int = 3, gate: float = 5.0,
    declared: float | None = None, echo: float = 0.0,
) -> float:  # fmt: skip
    """Detection limit: the shift that the windowed form tells after some samples, with ``memory``.

    At a constant input, without what the estimate does not know itself. As that follows the shift
    while it is looked for, up to 1.6 times as much is needed for one half of the shifts to be told.

    Args:
        noise: standard deviation of the samples, in the unit measured; 0 is none.
        samples: since the last change, before the shift.
        latest: samples since the shift, up to the memory.
        unknown: parameters that are estimated.
        gate: parameter of the estimator.
        declared: parameter ``noise`` of the estimator; by default 1e-3.
        echo: as given to :func:`slipctl.rls`.

    Returns:
        Size of the shift, in the unit measured; inf where the samples are too few.

    Raises:
        BadInput: a number that is none or negative.
    """
    declared = 1e-3 if declared is None else declared
    for name, value in (
        ("noise", noise), ("declared", declared), ("gate", gate), ("echo", echo)
    ):  # fmt: skip
        if not 0 <= value < math.inf:
            raise BadInput(f"smallest_shift: {name} = {value:g} must be 0 or positive")
    for name, count in (("samples", samples), ("latest", latest), ("unknown", unknown)):
        check_whole(f"smallest_shift: {name}", count)
    seen = samples - unknown
    if seen < 2:
        return math.inf
    freedom = BELIEF + seen
    s2 = (BELIEF * declared**2 + seen * noise**2) / freedom
    weight = sum(c**2 for c in signature(latest, echo))
    return math.sqrt(s2 * freedom * math.expm1(gate**2 / freedom) / weight)


def _normal_equations(model: Model, sums: ca.Function) -> ca.Function:
    """Function (theta, data) -> (J, squares, H, r).

    These are the cost, the sum of squared residuals, the Hessian in Gauss-Newton form and minus
    the gradient.
    """
    n, (rows, window) = model.n, sums.size_in(1)
    theta, kept = ca.MX.sym("theta", n), ca.MX.sym("kept", rows, window)
    weights, mean = ca.MX.sym("weights", 1, window), ca.MX.sym("mean", n)
    Lambda, sigma2 = ca.MX.sym("Lambda", n, n), ca.MX.sym("sigma2")
    constants = ca.MX.sym("constants", model.output.size1_in(2))
    values, slopes = model.parameters(theta)
    squares, JJ, Je = sums(values, kept, weights, constants)[:3]
    off = mean - theta
    J = (squares / sigma2 + off.T @ Lambda @ off) / 2
    H = slopes.T @ JJ @ slopes / sigma2 + Lambda
    r = slopes.T @ Je / sigma2 + Lambda @ off
    return ca.Function(
        "normal_equations",
        [theta, kept, weights, mean, Lambda, sigma2, constants],
        [J, squares, H, r],
        list(DATA),
        ["J", "squares", "H", "r"],
    )


def _iteration(normal: ca.Function) -> ca.Function:
    """Function (theta, J, squares, H, r, damping, pivots, eps, data) -> the first six anew."""
    inputs = [ca.MX.sym(n, normal.sparsity_in(k)) for k, n in enumerate(normal.name_in())]
    theta, data = inputs[0], inputs[1:]
    now = [ca.MX.sym(n, normal.sparsity_out(k)) for k, n in enumerate(normal.name_out())]
    J, _, H, r = now
    damping, eps = ca.MX.sym("damping"), ca.MX.sym("eps")
    least = ca.MX.sym("least", theta.shape[0])
    there = theta + _solver(theta.shape[0])(H + damping * ca.diag(ca.diag(H)), r, least)
    then = normal(there, *data)
    better = then[0] < J  # false for NaN too, so a step out of range is refused
    following = [
        ca.if_else(better, b, a) for a, b in zip([theta, *now], [there, *then], strict=True)
    ]
    more = ca.if_else(4 * damping > BLIND / ca.sqrt(eps), DAMPING, ca.fmin(damping * 4, MOST))
    after = ca.if_else(better, ca.fmax(damping / 4, LEAST), more)
    taken = [theta, *now, damping, least, eps, *data]
    names = [DATA[0], *normal.name_out(), "damping", "least", "eps", *DATA[1:]]
    given = [f"{n}_next" for n in names[: len(following) + 1]]
    return ca.Function("iteration", taken, [*following, after], names, given)


def _ldl(A: ca.SX, least: ca.SX) -> tuple[ca.SX, ca.SX]:
    """D and strict upper triangle L' of A = (I + L) diag(D) (I + L'); no pivot is below ``least``.

    A is Lambda_0 plus squares, so in exact arithmetic no pivot is below that of Lambda_0. In float
    it is lost where the squares are 1e7 times as large, and pivots would come out negative.
    """
    n = A.shape[0]
    D, LT = ca.SX(n, 1), ca.SX(n, n)
    for j in range(n):
        column = [A[i, j] for i in range(j + 1)]
        for i in range(j):
            LT[i, j] = column[i] / D[i]
            for k in range(i + 1, j):
                column[k] -= LT[i, k] * column[i]
            column[j] -= column[i] * LT[i, j]
        D[j] = ca.fmax(column[j], least[j])
    return D, LT


@remember_locals
def _solver(n: int) -> ca.Function:
    """Function (A, b, least pivots) -> A^-1 b for symmetric positive definite A."""
    A, b, least = ca.SX.sym("A", n, n), ca.SX.sym("b", n), ca.SX.sym("least", n)
    D, LT = _ldl(A, least)
    return ca.Function(
        "solve", [A, b, least], [ca.ldl_solve(b, D, LT, range(n))],
        ["A", "b", "least"], ["solution"], {"cse": True},
    )  # fmt: skip


@remember_locals
def _inverse(n: int) -> ca.Function:
    """Function (A, least pivots) -> A^-1 for symmetric positive definite A, or 1/least.

    A^-1 is at most diag(1/least). Where rounding has lost it, nothing is known but that.
    """
    A, least = ca.SX.sym("A", n, n), ca.SX.sym("least", n)
    D, LT = _ldl(A, least)
    columns = ca.ldl_solve(ca.SX.eye(n), D, LT, range(n))
    inverse = ca.densify((columns + columns.T) / 2)
    lost = ca.logic_not(ca.mmin(ca.diag(inverse) * least <= 1 + ROUNDED))
    known = ca.if_else(lost, ca.densify(ca.diag(1 / least)), inverse)
    return ca.Function("inverse", [A, least], [known], ["A", "least"], ["inverse"], {"cse": True})
