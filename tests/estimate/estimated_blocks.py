"""One of each kind of estimator, and of each kind of fit: what ``test_recorded_estimate`` asks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from test_curve_fit import line, polach, synthetic
from test_estimate import burckhardt, plane
from test_filtering import SHAPE, THREE, car, wheel
from test_flow_fit import coasted, stepped
from test_identification import data

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    fit,
    fit_over_time,
    identify,
    law,
    linear_fit,
    misfit_search,
)  # fmt: skip
from slipctl.block.block import Block
from slipctl.estimate import gauss_newton, misfit, noise_weights, peak, window
from slipctl.estimate.identification import swarm_fit
from slipctl.estimate.kalman.filters import ctukf, ekf, lipschitz, observability
from slipctl.estimate.least_squares import opened, peak_bound, probe, rls
from slipctl.estimate.log_fit.rollout import Rolled, Stretch
from slipctl.estimate.model import Model
from slipctl.models.cheng_2022.freight_resistance import BOX, specific_resistance, swarm_settings
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.trials import brake_step, coasting

TWO = dict(
    coordinates=("log(c)", "log(a)", "log(b - a)"), start={"c": 0.3, "a": 0.5, "b": 1.3}
)  # fmt: skip
ONE = dict(prior=4e6, noise=1.0, drift=1e5, gamma=0.23)
PLANE = dict(unknown=("p", "q"), coordinates=("p", "q"), spread=[1.0, 3.0])

WAYS = (("sampled", "euler", 1), ("sampled", "rk4", 2), ("differential", "implicit_euler", 1),
        ("differential", "sdirk2", 2))  # fmt: skip
SHIFTS = ((1e-3, 20, 1, 3, 5.0, None, 0.0), (0.0, 9, 2, 2, 4.0, 2e-3, 0.5),
          (1e-2, 4, 3, 3, 5.0, 1e-3, 1.0), (1e-2, 5, 3, 3, 5.0, 1e-3, 1.0))  # fmt: skip

BLOCKS: dict[str, Callable[[], Block]] = {
    f"{kind.__name__} of a force, {form}, {per}": partial(
        kind, wheel, "omega", "F_a", form=form, per=per, **ONE)
    for kind in (ctukf, ekf) for form in ("sampled", "differential") for per in ("sample", "second")
} | {
    f"{kind.__name__} of three, {form}, {method}": partial(
        kind, car, ("omega", "a"), THREE, form=form, method=method, substeps=substeps, gamma=0.01,
        floor=dict.fromkeys(THREE, 1e-9), cap=dict.fromkeys(THREE, 1e3), **SHAPE,
        noise={"omega": 1e-6, "a": 1e-2} if form == "sampled" else {"omega": 1e-2, "a": 1e2})
    for kind in (ctukf, ekf)
    for form, method, substeps in WAYS
} | {
    "ctukf as printed": partial(ctukf, wheel, "omega", "F_a", form="printed-22", **ONE),
    "ctukf of an output": partial(
        ctukf, car, "lam", ("omega", "v"), prior={"omega": 1e-2, "v": 0.1}, noise=1e-4, sigma=1.0),
    "recursive": partial(rls, plane, forgetting=0.98, noise=0.1, **PLANE),
    "recursive in logarithms": partial(rls, double_exponential, "mu", **TWO),
    "recursive, Burckhardt": partial(rls, burckhardt, unknown=("a_0", "a_2")),
    "as printed": partial(rls, double_exponential, "mu", form="printed-16"),
    "window": partial(rls, double_exponential, "mu", form="window", window=8, iterations=2, **TWO),
    "window with memory": partial(
        rls, plane, form="window", window=6, iterations=2, memory=3, **PLANE),
    "window with an echo": partial(
        rls, plane, form="window", window=6, iterations=2, memory=2, echo=0.7, **PLANE),
    "probe": partial(probe, double_exponential, "v_s", (0.1, 3.0), measured="mu"),
    "probe that looks": partial(
        probe, double_exponential, "v_s", (0.1, 3.0), measured="mu", looks=True),
    "linear": partial(linear_fit, specific_resistance, forgetting=0.99),
    "linear in two": partial(
        linear_fit, specific_resistance, unknown=["a2", "a3"], spread=[0.1, 0.01], period=0.1),
    "misfit": lambda: misfit.misfit(specific_resistance, "y", ("a1", "a2", "a3")),
    "opened": partial(opened, double_exponential, "c"),
}  # fmt: skip


def of(f: ca.Function, seed: int = 1) -> list[Any]:
    """What a Function gives at three places."""
    rng = np.random.default_rng(seed)
    return [
        f.call([ca.DM(rng.uniform(0.5, 1.5, f.size_in(k))) for k in range(f.n_in())])
        for _ in range(3)
    ]


def over_a_jump(block: Block, law: Block, other: dict[str, float]) -> Any:
    """Last state and all outputs of an estimator over 30 samples; after 15 the law is another."""
    rng = np.random.default_rng(4)
    u = rng.uniform(0.2, 2.0, (len(law.inputs), 30))
    inputs = [dict(zip(law.inputs, column, strict=True)) for column in u.T]
    heights = [law(**at, **(other if k > 14 else {})) for k, at in enumerate(inputs)]
    rows = [[float(h[y]) for h in heights] for y in law.outputs]
    data = np.vstack([u, np.array(rows) + 1e-3 * rng.standard_normal(30)])
    x, found = ca.DM(block.pack("state", block.start())), []
    p = ca.DM(block.pack("param", block.param_values()))
    for column in data.T:
        x, y = block.f(x, column, p)
        found.append(ca.DM(y))
    return [ca.DM(x), *found]


@law(y=Output("1", "output"))
def odd(
    x=Input("1"), p=Param("1", 2.0), q=Param("1", "2 * p"), many=Param("1", (1.0, 2.0), shape=(2,)),
):  # fmt: skip
    """One parameter that is free and a number."""
    return p * x + q + 0 * many[0]


def advice() -> Any:
    """What is advised of short ranges, below and above zero and far from it."""
    found = []
    cases = ((5, 8, 0.02), (0, 1, 0.02), (10, 10.2, 0.5), (1, 1.0005, 0.02), (0, 0, 1))
    for lo, hi, noise in cases:
        try:
            given = data(lo, hi, noise, N=200)
            told = identify(specific_resistance, given, largest_condition=1e7)._asdict()
        except BadInput as refused:
            told = {"refused": str(refused)}
        found.append(told)
    return found


def followed(rule: str) -> Any:
    """A brake that answers late, from a log with a gap."""
    t = np.arange(0, 4, 0.02)
    command = np.where(t >= 0.5, 6e3, 0.0) + np.where(t >= 2.5, -2e3, 0.0)
    y = 6e3 * stepped(t, 0.5, 1.2, 0.3, 0.11) - 2e3 * stepped(t, 2.5, 1.2, 0.3, 0.11)
    y = y + 20 * np.random.default_rng(2).normal(size=t.size)
    y[100:110] = np.nan
    return fit_over_time(
        brake_step, {"time": t, "T_cmd": command, "T": y}, "T", delay="T_cmd", rule=rule
    )


def coasts() -> Any:
    """A vehicle that rolls out."""
    t = np.arange(0, 250, 2.0)
    v = coasted(t) + 0.05 * np.random.default_rng(3).normal(size=t.size)
    return fit_over_time(coasting, {"time": t, "v": v}, "v", at={"m": 38e3, "rho": 0.066})


def rolls(rule: str) -> Any:
    """A roll and its slopes."""
    t = np.sort(np.random.default_rng(5).uniform(0, 3, 40))
    piece = Stretch(t, {"T_cmd": 1e3 * np.round(np.sin(3 * t), 1)}, np.zeros(t.size))
    rolled = Rolled(brake_step, "T", ["k", "tau"], "T_b", "T_cmd", rule, {"T_b": 0.0})
    return rolled.over(piece, np.array([1.1, 0.3]), 5.0, 0.1)


def straight(ordered: bool) -> Any:
    """A noisy line."""
    x = np.linspace(1, 5, 30)
    y = 2 * x - 3 + 0.1 * np.random.default_rng(7).normal(size=30)
    return fit(line, {"x": x, "y": y}, ["p", "q"], ordered=ordered)


def rough() -> Any:
    """A noisy creep curve."""
    at = np.geomspace(1e-4, 3.0, 40)
    clean = synthetic(at)
    mu = np.array(clean["mu"]) + 1e-3 * np.random.default_rng(11).normal(size=at.size)
    return fit(polach, clean | {"mu": mu}, at={"v": 10.0}, ordered=True)


MODEL = partial(Model.of, plane, None, ("p", "q"), ("p", "q"), None)
SWEPT = {"omega": (100.0, 110.0), "v": (48.0, 52.0)}

RESULTS: dict[str, Callable[[], Any]] = {
    "step, held": partial(followed, "hold"), "step, linear": partial(followed, "linear"),
    "coasting": coasts, "line": partial(straight, False), "creep curve": rough,
    "identified": lambda: identify(specific_resistance, data())._asdict(),
    "badly identified": lambda: identify(specific_resistance, data(5, 8))._asdict(),
    "two identified": lambda: identify(
        specific_resistance, data(), unknown=["a2", "a3"])._asdict(),
    "swarm": lambda: [swarm_fit(specific_resistance, BOX, ticks=5, **swarm_settings("consistent")),
                      misfit_search(specific_resistance, BOX, **swarm_settings("consistent"))],
    "peak bound": lambda: peak_bound(
        double_exponential, "v_s", 1.1, {"v_s": np.linspace(0.1, 2, 20)}, 1e-3)._asdict(),
    "peak bound, known before": lambda: peak_bound(
        double_exponential, "v_s", 1.1, {"v_s": np.linspace(0.1, 2, 20)}, 1e-3,
        spread={"a": 0.1})._asdict(),
    "smallest shift": lambda: [
        window.smallest_shift(n, s, m, u, g, d, e) for n, s, m, u, g, d, e in SHIFTS],
    "window over a jump": lambda: over_a_jump(
        BLOCKS["window"](), double_exponential, {"c": 0.25}),
    "window with memory over a jump": lambda: over_a_jump(
        BLOCKS["window with memory"](), plane, {"p": 2.0}),
    "window with an echo over a jump": lambda: over_a_jump(
        BLOCKS["window with an echo"](), plane, {"p": 0.02}),
    "recursive over a jump": lambda: over_a_jump(BLOCKS["recursive"](), plane, {"p": 2.0}),
    "odd parameters": lambda: rls(odd), "advice": advice,
    "deviation of a peak": lambda: [
        peak._deviation(np.array(g), np.array(r)) for g, r in (
            ([1.0, 2.0], [[1.0, 0.5], [0.0, 2.0]]), ([0.0, 0.0], [[1.0, 0.0], [0.0, 1.0]]),
            ([1.0, 0.0], [[1e-9, 0.0], [0.0, 0.0]]), ([1.0, 0.0], [[1.0, 0.0], [0.0, 0.0]]),
            ([1.0, 1.0], [[0.0, 0.0], [0.0, 0.0]]))],
    "rotation": lambda: of(misfit.rotation(3)), "solution": lambda: of(misfit.solution(3)),
    "sums": lambda: of(noise_weights.white_sums(MODEL(), 5)),
    "sums with an echo": lambda: [of(f) for f in noise_weights.echoing_sums(MODEL(), 5, 0.6)],
    "solver": lambda: [of(gauss_newton.solver(3)), of(gauss_newton.inverse(3))],
    "peak gradient": lambda: of(
        peak.peak_gradient(double_exponential, "v_s", "mu", ("c", "a", "b"))),
    "observability": lambda: observability(
        car, "omega", THREE, scale={"omega": 1, "v": 1, "a_0": 0.1}, horizon=0.5, T_b=-2e3,
        omega=110.0),
    "Lipschitz": lambda: [
        lipschitz(car, ("omega", "a"), ("omega", "v"), SWEPT, of=of_what, tolerance=0.2, T_b=-2e3)
        for of_what in ("measurement", "states")],
    "roll, held": partial(rolls, "hold"), "roll, linear": partial(rolls, "linear"),
}  # fmt: skip
