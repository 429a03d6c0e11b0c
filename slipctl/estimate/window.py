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
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.signals import Param, Signal, State
from slipctl.errors import BadInput, check_whole
from slipctl.estimate import gauss_newton as newton
from slipctl.estimate import recall as taken_back
from slipctl.estimate.model import Model, covariance_state, spread_param, theta_state
from slipctl.estimate.noise_weights import echoing_sums, shift_ratios, signature, white_sums
from slipctl.seek.random import epsilon

BELIEF = 0.01
"""Samples that the declared noise counts for, beside those seen. Without noise s falls to
sigma sqrt(BELIEF/count), 1 % of sigma, which keeps H within what float can invert."""

KNOWN = ("theta", "P", "scatter", "mean", "Lambda", "count", "kept")
"""What an estimate knows."""


def windowed_estimator(
    model: Model, period: float, window: int, iterations: int, memory: int = 1, echo: float = 0.0,
    recall: int = 0, per_tick: int | None = None,
) -> Block:  # fmt: skip
    """Make the windowed estimator; use :func:`slipctl.rls` with ``form="window"``."""
    per_tick = iterations if per_tick is None else per_tick
    asked = Window(model, window, iterations, memory, echo, recall, per_tick)
    return make_block(
        "rls", "step", asked.tick, states=asked.states(), inputs=model.inputs(),
        params=[*_numbers(model), *model.known()],
        outputs=[*model.outputs(), *taken_back.outputs(recall)],
        period=period, sx=False, choices=asked.choices(), doc=__doc__ or "",
    )  # fmt: skip


@dataclass(frozen=True)
class Window:
    """A windowed estimator: what was asked for, and what its tick does with a sample.

    Attributes:
        model: the law as a function of the coordinates of its unknowns.
        window, iterations, memory, echo, recall: as of :func:`slipctl.rls`.
        per_tick: iterations in each tick.
    """

    model: Model
    window: int
    iterations: int
    memory: int
    echo: float
    recall: int
    per_tick: int

    @property
    def several(self) -> bool:
        """Whether a fit takes several ticks."""
        return self.per_tick < self.iterations

    @cached_property
    def echoing(self) -> tuple[ca.Function, ca.Function]:
        """Sums of innovations over the window, and what the next sample hears."""
        return echoing_sums(self.model, self.window, self.echo)

    @cached_property
    def sums(self) -> ca.Function:
        """Sums of residuals over the window."""
        return self.echoing[0] if self.echo else white_sums(self.model, self.window)

    @cached_property
    def normal(self) -> ca.Function:
        """Normal equations of the samples kept."""
        return newton.normal_equations(self.model, self.sums)

    def tick(self, x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        """Next states and outputs with a new sample."""
        begun, (inputs, measurement) = x, self.model.sample(u)
        known = {"constants": self.model.constants(p), "declared": p["noise"] ** 2,
                 "least": p["spread"] ** -2}  # fmt: skip
        if self.recall:
            x, counts, back = self.recalled(x, inputs, measurement, known["constants"], p)
        predicted, h = self.model.predict(x["theta"], inputs, known["constants"])
        e = measurement - predicted
        changed, shifts = self.change(x, e, h, p)
        unsettled = ca.if_else(changed, p["settling"], ca.fmax(0, x["unsettled"] - 1))
        again = ca.logic_or(ca.logic_or(changed, x["count"] == 0), x["unsettled"] > 0)
        sigma2 = self.noise(x, again, known["declared"])
        mean, Lambda = self.information(x, again, sigma2, known, p)
        kept, count = self.samples(x, again, ca.vertcat(inputs, measurement))

        now = self.in_hand(begun)
        given = {"kept": kept, "count": count, "Lambda": Lambda, "unsettled": unsettled}
        nxt = {k: now(k, v) for k, v in given.items()}
        given = {"mean_now": mean, "sigma2": sigma2, "told": changed,
                 "predicted_then": predicted, "residual_then": e}  # fmt: skip
        first = {k: now(k, v) for k, v in given.items()}
        weights = nxt["count"] > ca.DM(range(self.window)).T
        damping = ca.if_else(again, newton.DAMPING, x["damping"])
        hand = self.fit(x["theta"], damping, weights, now, nxt | first | known)
        nxt |= self.estimate(hand, nxt["count"], first["mean_now"], known, p["farthest"])
        if self.memory > 1:
            nxt["shifts"] = ca.if_else(again, 0, shifts)
        if self.recall:
            left = ca.logic_and(first["told"], x["count"] >= self.window / 2)
            over = ca.logic_or(back, nxt["count"] == self.window)
            nxt |= taken_back.put_aside(x, KNOWN, counts, left, over)
        if self.echo:
            nxt["echoed"] = self.heard(nxt, weights, known["constants"])
        if self.several:
            nxt = self.held(nxt, begun, now, hand["left"]) | hand | first
            if self.recall:
                nxt["recalled_then"] = back = now("recalled_then", back)
        return nxt, self.results(nxt, first) | ({"recalled": back} if self.recall else {})

    def variance(self, x: Exprs, row: Any, p: Exprs) -> Any:
        """Variance of the residual of a new sample: its noise, and what is not known."""
        doubt = ca.fmax(row.T @ x["P"] @ row, 0)  # in float P may not be definite
        noise = ca.fmin(x["scatter"], p["coarsest"] ** 2)
        return noise * (1 + doubt / p["noise"] ** 2) if self.memory == 1 else noise + doubt

    def recalled(
        self, x: Exprs, inputs: Any, measurement: Any, constants: Any, p: Exprs
    ) -> tuple[Exprs, Exprs, Any]:
        """States, what counts samples that agree with the former one, and whether it is back."""
        former = {name: x[f"former_{name}"] for name in KNOWN}
        told = former | {"scatter": ca.fmax(former["scatter"], p["noise"] ** 2)}
        predicted, h = self.model.predict(former["theta"], inputs, constants)
        off, may = measurement - predicted, self.variance(told, h, p)
        t = off / (p["gate"] * ca.sqrt(may)) if self.memory > 1 else None
        counts, back = taken_back.count_sample(x, off**2 <= p["gate"] ** 2 * may, self.recall, t)
        taken = former | {"unsettled": 0, "damping": newton.DAMPING}
        taken |= {"shifts": 0} if self.memory > 1 else {}
        return dict(x) | {k: ca.if_else(back, v, x[k]) for k, v in taken.items()}, counts, back

    def change(self, x: Exprs, e: Any, h: Any, p: Exprs) -> tuple[Any, Any]:
        """Whether a residual is beyond the prediction interval of the regression; latest shifts."""
        new, row = (e + x["echoed"][0], h + x["echoed"][1:]) if self.echo else (e, h)
        enough = x["count"] >= self.model.n + 2  # fewer cannot tell a change from an unknown
        if self.memory == 1:
            beyond = new**2 > p["gate"] ** 2 * self.variance(x, row, p)
            return ca.logic_and(enough, beyond), None
        shift = new / ca.sqrt(self.variance(x, row, p))
        shifts = ca.horzcat(ca.if_else(enough, shift, 0), x["shifts"][:, :-1])
        ratios = shift_ratios(shifts, self.memory, self.echo)
        freedom = BELIEF + ca.fmax(0, x["count"] - self.model.n)
        return freedom * ca.log1p(ca.mmax(ratios) / freedom) > p["gate"] ** 2, shifts

    def noise(self, x: Exprs, again: Any, declared: Any) -> Any:
        """Variance of a sample that the fit takes: as declared, or as the residuals show."""
        if self.memory == 1:
            return declared
        few = x["count"] < self.model.n + 2
        return ca.if_else(ca.logic_or(again, few), declared, x["scatter"])

    def information(
        self, x: Exprs, again: Any, sigma2: Any, known: Exprs, p: Exprs
    ) -> tuple[Any, Any]:
        """Centre and information of what is known besides: what leaves the window stays so."""
        least, constants, theta = known["least"], known["constants"], x["theta"]
        Lambda_0 = ca.densify(ca.diag(least))
        if self.echo:
            values, slopes = self.model.parameters(theta)
            ones = ca.DM.ones(1, self.window)
            *_, JJ, Je = self.sums(values, x["kept"], ones, constants)
            seen, told = slopes.T @ JJ @ slopes, slopes.T @ Je
        else:
            last = x["kept"][:, -1]
            old, g = self.model.predict(theta, last[:-1], constants)
            seen, told = g @ g.T, g * (last[-1] - old)
        kept_share = p["forgetting"] * x["Lambda"]
        Lambda = kept_share + (1 - p["forgetting"]) * Lambda_0 + seen / sigma2
        pull = kept_share @ (x["mean"] - theta) + told / sigma2
        mean = theta + newton.solver(self.model.n)(Lambda, pull, least)
        full = x["count"] == self.window
        Lambda = ca.if_else(again, Lambda_0, ca.if_else(full, Lambda, x["Lambda"]))
        return ca.if_else(again, theta, ca.if_else(full, mean, x["mean"])), Lambda

    def samples(self, x: Exprs, again: Any, sample: Any) -> tuple[Any, Any]:
        """The window, newest first, and its count.

        Unused places repeat the first sample; they have weight 0.
        """
        all_same = ca.repmat(sample, 1, self.window)
        kept = ca.if_else(again, all_same, ca.horzcat(sample, x["kept"][:, :-1]))
        return kept, ca.if_else(again, 1, ca.fmin(self.window, x["count"] + 1))

    def in_hand(self, begun: Exprs) -> Callable[[str, Any], Any]:
        """What a fit begins with in its first tick, or what it has come to, by name."""
        if not self.several:
            return lambda name, new: new
        begins = begun["left"] <= 0
        return lambda name, new: ca.if_else(begins, new, begun[name])

    def fit(
        self, theta: Any, damping: Any, weights: Any, now: Callable[[str, Any], Any], given: Exprs
    ) -> Exprs:
        """The fit after the iterations of this tick: :data:`HAND`, and how many are left."""
        data = (given["kept"], weights, given["mean_now"], given["Lambda"], given["sigma2"],
                given["constants"])  # fmt: skip
        arithmetic = (given["least"], epsilon(ca.fmin(given["count"], 1)))
        first = (theta, *self.normal(theta, *data), damping)
        state = tuple(now(k, new) for k, new in zip(newton.HAND, first, strict=True))
        iterate = newton.iteration(self.normal)
        for _ in range(self.per_tick):
            state = iterate(*state, *arithmetic, *data)
        left = {"left": now("left", self.iterations) - self.per_tick} if self.several else {}
        return dict(zip(newton.HAND, state, strict=True)) | left

    def estimate(self, hand: Exprs, count: Any, mean: Any, known: Exprs, far: Any) -> Exprs:
        """What the fit in hand tells: coordinates, covariance, noise, and its next damping."""
        model, declared, squares = self.model, known["declared"], hand["squares"]
        theta, mean = (_near(v, model, far) for v in (hand["theta_now"], mean))
        if self.memory == 1:
            scatter = declared + squares / count
        else:
            scatter = (BELIEF * declared + squares) / (BELIEF + ca.fmax(0, count - model.n))
        P = newton.inverse(model.n)(hand["H"], known["least"])
        return {"theta": theta, "P": P, "scatter": scatter, "mean": mean,
                "damping": hand["damping"]}  # fmt: skip

    def heard(self, nxt: Exprs, weights: Any, constants: Any) -> Any:
        """What the next residual hears of the newest noise, and its regressor."""
        values, slopes = self.model.parameters(nxt["theta"])
        left = self.echoing[1](values, nxt["kept"], weights, constants)
        return ca.vertcat(left[0], slopes.T @ left[1:])

    def held(self, nxt: Exprs, begun: Exprs, now: Callable[[str, Any], Any], left: Any) -> Exprs:
        """States where a fit takes several ticks: the last estimate holds until the fit ends."""
        ended = ("theta", "P", "scatter", "mean", "echoed")
        first = ("shifts", "agreed", "summed", *(f"former_{n}" for n in KNOWN))
        return (
            nxt
            | {k: ca.if_else(left <= 0, nxt[k], begun[k]) for k in ended if k in nxt}
            | {k: now(k, nxt[k]) for k in first if k in nxt}
        )

    def results(self, nxt: Exprs, first: Exprs) -> Exprs:
        """Outputs; a parameter is told within the range that its law declares."""
        seen = first["predicted_then"], first["residual_then"], first["told"]
        found = self.model.results(nxt["theta"], nxt["P"], *seen)
        told = {name: self.model.law.params[name] for name in self.model.unknown}
        return found | {k: ca.fmax(s.lo, ca.fmin(s.hi, found[k])) for k, s in told.items()}

    def states(self) -> list[Signal]:
        """States of the estimator."""
        model, n, unit = self.model, self.model.n, _unit(self.model)
        rows = sum(s.size for s in model.law.inputs.values()) + 1
        seen = State(f"({unit})^2", 0.0, "noise seen: sigma^2 and mean square residual")
        found = [
            theta_state(model), covariance_state(n),
            seen.named("scatter"),
            State("1", model.guess, "centre of what is known besides", shape=(n,)).named("mean"),
            State("1", 0.0, "information besides the window", shape=(n, n)).named("Lambda"),
            State("1", 0.0, "samples in the window").named("count"),
            State("1", 0.0, "samples still to be replaced after a change").named("unsettled"),
            State("1", newton.DAMPING, "damping of the next iteration").named("damping"),
            State("1", 0.0, "samples, newest first, each in its units",
                  shape=(rows, self.window)).named("kept"),
        ]  # fmt: skip
        if self.memory > 1:
            found.append(State("1", 0.0, "latest residuals over their standard deviations, newest"
                               " first", shape=(1, self.memory)).named("shifts"))  # fmt: skip
        if self.echo:
            found.append(State("1", 0.0, "what the next residual hears of the newest noise, in"
                               " units of the measurement, and its regressor",
                               shape=(n + 1,)).named("echoed"))  # fmt: skip
        if self.recall:
            found += taken_back.states([s for s in found if s.name in KNOWN], self.memory > 1)
        return found + (_in_hand(model, unit, self.recall) if self.several else [])

    def choices(self) -> dict[str, Any]:
        """Structural choices for the block."""
        found = self.model.describe("window")
        found |= {"window": self.window, "iterations": self.iterations}
        found |= {"iterations per tick": self.per_tick} if self.several else {}
        found |= {"memory": self.memory} if self.memory > 1 else {}
        found |= {"echo": self.echo} if self.echo else {}
        return found | ({"recall": self.recall} if self.recall else {})


def _unit(model: Model) -> str:
    """Unit of the measurement."""
    return model.law.outputs[model.measured].unit


def _numbers(model: Model) -> list[Signal]:
    """Parameters of the estimator, beside those of the law that it takes as known."""
    unit = _unit(model)
    noise = Param(unit, 1e-3, "standard deviation of the measurement", lo=1e-12, hi=1e12)
    told = "residual taken for a change, over its standard deviation"
    return [
        noise.named("noise"), spread_param(model.n, 2.0),
        Param("1", 5.0, told, lo=1, hi=1e12).named("gate"),
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
    ]  # fmt: skip


def _in_hand(model: Model, unit: str, recall: int) -> list[Signal]:
    """States of a fit that is worked out over several ticks."""
    n = model.n
    mean = State("1", model.guess, "its centre of what is known besides", shape=(n,))
    return [
        State("1", 0.0, "iterations left of the fit in hand").named("left"),
        State("1", model.guess, "coordinates of the fit in hand", shape=(n,)).named("theta_now"),
        State("1", 0.0, "its cost").named("J"),
        State(f"({unit})^2", 0.0, "its sum of squares").named("squares"),
        State("1", 0.0, "its Hessian", shape=(n, n)).named("H"),
        State("1", 0.0, "minus its gradient", shape=(n,)).named("r"),
        mean.named("mean_now"),
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
    for name, value in dict(noise=noise, declared=declared, gate=gate, echo=echo).items():
        if not 0 <= value < math.inf:
            raise BadInput(f"smallest_shift: {name} = {value:g} must be 0 or positive")
    for name, count in dict(samples=samples, latest=latest, unknown=unknown).items():
        check_whole(f"smallest_shift: {name}", count)
    seen = samples - unknown
    if seen < 2:
        return math.inf
    freedom = BELIEF + seen
    s2 = (BELIEF * declared**2 + seen * noise**2) / freedom
    weight = sum(c**2 for c in signature(latest, echo))
    return math.sqrt(s2 * freedom * math.expm1(gate**2 / freedom) / weight)
