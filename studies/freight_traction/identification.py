"""Identification of the running resistance, for the study ``freight_traction``: Cheng 2022, 3.2.

Two runs of the train of (14) at constant adhesion, a sample every 50 ms. They are ``wide``, 0 to
20 m/s in 201 s, and ``narrow``, 5 to 8 m/s in 31 s, at about .1 m/s^2. What is measured is the
running resistance over weight, with white noise of .02 N/kN; ``in the loop`` gets speed and
adhesion only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from slipctl import (
    Block,
    Claim,
    Context,
    Experiment,
    Figure,
    Input,
    Param,
    Rail,
    Results,
    Scenario,
    Section,
    State,
    Table,
    connect,
    every,
    flow,
    identify,
    misfit_search,
    opened,
    sampled,
    simulate,
)
from slipctl.draw import plots
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022 import freight_traction_control as control
from slipctl.models.cheng_2022.freight_resistance import (
    BOX,
    ITERATIONS,
    identification,
    printed_inertia,
    specific_resistance,
    swarm_settings,
)
from slipctl.models.cheng_2022.freight_traction import resistance

T, NOISE = 0.05, 0.02
"""Period of the samples in s, and noise in N/kN."""

TRUE = np.array([resistance.params[k].value for k in BOX], dtype=float)
RANGES = {"wide": (0.0, 201.0, 0.2862), "narrow": (5.0, 30.6, 0.2722)}
"""Start speed in m/s, duration in s and adhesion of each run."""

WEIGHT = 3e4 * 9.8 * 8 / (6e6 * 9.8 / 1000)
"""Adhesion force of all driven axles over the weight of the train, N/kN per adhesion."""

LOOP = "in the loop, least squares"
SQUARES, PROPER, PRINTED = "least squares", "swarm, well posed", "swarm, printed"


@flow(name="car")
def car(
    v=State("m/s", 0.0, "train speed"),
    mu=Input("1", "adhesion coefficient", positive="traction"),
    F_Z=Input("N", "running resistance", positive="braking"),
    M=Param("kg", 6e6, "train"),
    pull=Param("N", 8 * 3e4 * 9.8, "load of the driven axles"),
):
    """Train of (14) without its wheels: M v' = n_d mu W g - F_Z."""
    return dict(v=(mu * pull - F_Z) / M), {}


@cache
def run(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Speed in m/s and adhesion of each sample of a run."""
    start, seconds, mu = RANGES[name]
    wires = {"car.F_Z": "res.F_Z", "res.v": "car.v", "car.mu": "mu"}
    train = sampled(connect("train", wires, car=car, res=resistance), T, "rk4", substeps=10)
    scenario = Scenario(name, seconds, inputs={"mu": mu}, start={"car.v": start})
    log = simulate(train, scenario, compile=False)
    return log["car.v"].values, np.full(len(log["time"]), mu)


def samples(v: np.ndarray, noise: float, seed: int) -> dict[str, np.ndarray]:
    """Speed and noisy resistance over weight."""
    y = TRUE @ [v**0, v, v**2]
    return {"v": v, "y": y + noise * np.random.default_rng([seed, 5]).standard_normal(len(v))}


@cache
def search(form: str, iterations: int = ITERATIONS) -> Block:
    """Swarm of the settings named, its inertia that of the whole schedule even if cut short."""
    settings = swarm_settings(form) | {"iterations": iterations}
    if form != "consistent":
        share = iterations / ITERATIONS
        settings["inertia"] = lambda done: printed_inertia(done * share)
    return misfit_search(specific_resistance, BOX, **settings)


def errors(a: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Largest relative error of a coefficient, and of F_Z over a range of speeds."""
    v = np.linspace(low, high, 201)
    grid = np.stack([v**0, v, v**2])
    return float(np.abs(a / TRUE - 1).max()), float(np.abs(a @ grid / (TRUE @ grid) - 1).max())


def by_samples(form: str | None) -> Callable[[str, float, int], np.ndarray]:
    """Coefficients from samples of speed and resistance, by least squares or a swarm."""

    def found(name: str, noise: float, seed: int) -> np.ndarray:
        block = None if form is None else search(form)
        data = samples(run(name)[0], noise, seed)
        return np.array(
            list(identify(specific_resistance, data, search=block, seed=seed).values.values())
        )

    return found


def in_the_loop(name: str, noise: float, seed: int) -> np.ndarray:
    """Coefficients from speed and adhesion by the block, no acceleration measured."""
    v, mu = run(name)
    mu = mu + noise / WEIGHT * np.random.default_rng([seed, 5]).standard_normal(len(v))
    scenario = Scenario("loop", len(v) * T, inputs={"v_t": lambda t: v, "mu_hat": lambda t: mu})
    log = simulate(_block(), scenario, log=[f"fit.{k}" for k in BOX])
    return np.array([float(log[f"fit.{k}"][-1]) for k in BOX])


@cache
def _block() -> Block:
    return identification(T)


METHODS: dict[str, Callable[[str, float, int], np.ndarray]] = {
    SQUARES: by_samples(None),
    PROPER: by_samples("consistent"),
    PRINTED: by_samples("printed-21"),
    LOOP: in_the_loop,
}


def many_seeds(context: Context) -> dict[str, Table]:
    """Coefficients of each method in each run over many seeds."""
    seeds, noises = 10 if context.quick else 100, {"wide": (NOISE, 0.0), "narrow": (NOISE, 0.0)}
    rows: dict[str, list[Any]] = {
        k: []
        for k in ("run", "noise", "method", "seeds", "good", "worst", "worst F", "mean", "std")
    }
    each: dict[str, list[Any]] = {k: [] for k in ("run", "method", "seed", *BOX)}
    jobs = [(r, n, m) for r, ns in noises.items() for n in ns for m in METHODS]

    def work(job: tuple[str, float, str]) -> list[list[float]]:
        name, noise, method = job
        deterministic = noise == 0 and method in (SQUARES, LOOP)
        count = 1 if deterministic else seeds
        return [METHODS[method](name, noise, s).tolist() for s in range(1, count + 1)]

    for name in noises:
        run(name)  # once, before the processes part
    found = context.each("methods", jobs, work, share=(0.0, 0.8))
    for (name, noise, method), coefficients in zip(jobs, found, strict=True):
        a, count = np.array(coefficients), len(coefficients)
        start, end = run(name)[0][[0, -1]]
        off = np.array([errors(x, start, end) for x in a])
        good = int(((off[:, 0] < 0.05) & (off[:, 1] < 0.01)).sum())
        values = (name, noise, method, count, good, off[:, 0].max(), off[:, 1].max(), a.mean(0),
                  a.std(0))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
        if noise:
            for s, x in enumerate(a, 1):
                for key, value in zip(each, (name, method, s, *x.tolist()), strict=True):
                    each[key].append(value)
    units = {k: resistance.params[k].unit for k in BOX}
    return {
        "accuracy": Table(
            "Coefficients over many seeds",
            {
                "run": ("", rows["run"]),
                "noise": ("N/kN", rows["noise"]),
                "method": ("", rows["method"]),
                "seeds": ("1", rows["seeds"]),
                "good": ("1", rows["good"]),
                "largest error of a coefficient": ("1", [float(x) for x in rows["worst"]]),
                "largest error of F_Z": ("1", [float(x) for x in rows["worst F"]]),
                **{
                    f"{k}, {what}": (units[k], [float(x[i]) for x in rows[key]])
                    for i, k in enumerate(BOX)
                    for what, key in (("mean", "mean"), ("std", "std"))
                },
            },
            "Good: every coefficient within 5 % and F_Z within 1 % over the speeds of the run."
            " True: .5, .04, .0026. The swarms have 60 particles and 300 iterations.",
        ),
        "seeds": Table(
            f"Coefficients of each seed, noise {NOISE:g} N/kN",
            {
                **{k: ("" if k != "seed" else "1", each[k]) for k in ("run", "method", "seed")},
                **{k: (units[k], each[k]) for k in BOX},
            },
            "What the figure of the scatter shows.",
        ),
    }


def excitation() -> Table:
    """What a range of speeds tells, by least squares of 3000 samples with noise."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("low", "high", "condition", *BOX, "told", "advice")
    }
    for low, high in ((5, 8), (0, 8), (5, 12), (0, 12), (5, 20), (0, 15), (0, 20), (0, 25)):
        v = np.linspace(low, high, 3000)
        found = identify(specific_resistance, samples(v, NOISE, 1))
        told = (low, high, found.condition, *found.deviation.values(), found.identified,
                found.advice)  # fmt: skip
        for key, value in zip(rows, told, strict=True):
            rows[key].append(value)
    return Table(
        "What tells the coefficients: 3000 samples spread evenly, noise .02 N/kN",
        {
            "from": ("m/s", rows["low"]),
            "to": ("m/s", rows["high"]),
            "condition": ("1", rows["condition"]),
            **{f"{k}, std": (resistance.params[k].unit, rows[k]) for k in BOX},
            "identified": ("", rows["told"]),
            "what would pass": ("", rows["advice"]),
        },
        "Identified: 1.96 standard deviations are within 5 % for each coefficient.",
    )


def convergence(quick: bool) -> Table:
    """Best of the swarm over its iterations, run `wide` without noise."""
    seeds = 3 if quick else 10
    steps = (1, 3, 10, 30, 100, 300)
    rows: dict[str, list[Any]] = {k: [] for k in ("method", "iterations", *BOX, "off")}
    for method, form in ((PROPER, "consistent"), (PRINTED, "printed-21")):
        for count in steps:
            data = samples(run("wide")[0], 0.0, 1)
            a = np.array([
                list(identify(specific_resistance, data, search=search(form, count), seed=s)
                     .values.values())
                for s in range(1, seeds + 1)
            ])  # fmt: skip
            grid = np.stack([data["v"] ** k for k in range(3)])
            rms = [math.sqrt(float(np.mean((x @ grid - data["y"]) ** 2))) for x in a]
            values = (method, count, *np.median(np.abs(a / TRUE - 1), axis=0).tolist(),
                      float(np.median(rms)))  # fmt: skip
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
    return Table(
        "Convergence of the swarms, run `wide` without noise",
        {
            "method": ("", rows["method"]),
            "iterations": ("1", rows["iterations"]),
            **{f"{k}, error": ("1", rows[k]) for k in BOX},
            "rms misfit": ("N/kN", rows["off"]),
        },
        f"Medians of {seeds} seeds; errors relative to the true coefficients.",
    )


RUNS = {
    "paper": (25.0, 5.0, [Section(0, "dry"), Section(10, "wet"), Section(15, "dry")]),
    "long": (220.0, 0.1, [Section(0, "dry"), Section(60, "wet"), Section(100, "dry")]),
}
"""Duration in s, start speed in m/s and rail of each run of the closed loop."""

H = 2e-4
"""Period of the controller in s; the identification takes a sample every 0.1 s."""


@cache
def closed_loop() -> Block:
    """Train at the peak under the robust barrier law, whose resistance is the one identified."""
    ctl = control.seeking_controller(control.hold, "robust", H)
    ctl = ctl.swap("resistance", opened(resistance, *BOX))
    wires = {
        "ctl.omega_m": "plant.train.omega_m",
        "ctl.v_t": "plant.train.v_t",
        "ctl.T_m": "plant.motor.T_m",
        "plant.T_cmd": "ctl.T_cmd",
        "ident.v_t": "plant.train.v_t",
        "ident.mu_hat": "ctl.adhesion.mu_hat",
    }
    wires |= {f"ctl.resistance.{k}": f"ident.fit.{k}" for k in BOX}
    plant = sampled(freight.plant(freight.adhesion, freight.motor()), H, "rk4")
    ident = every(identification(0.1), round(0.1 / H))
    return connect("loop", wires, plant=plant, ctl=ctl, ident=ident)


def in_closed_loop(name: str, compile: bool = True) -> Table:
    """Resistance, true and identified, over a run of the closed loop: observer, wheels, rail."""
    seconds, start, rail = RUNS[name]
    names = ("plant.train.v_t", "plant.res.F_Z", "ident.res.F_Z", "ident.fit.identified")
    scenario = Scenario(name, seconds, Rail(rail), start={"plant.train.v_t": start})
    log = simulate(closed_loop(), scenario, log=names, compile=compile)
    every_n = round(seconds / 10 / H)
    at = [*range(every_n, len(log["time"]), every_n), len(log["time"]) - 1]
    v, true, found, told = (log[k].values[at] for k in names)
    return Table(
        f"Resistance identified in the closed loop, run `{name}`",
        {
            "time": ("s", log["time"].values[at].tolist()),
            "speed": ("m/s", v.tolist()),
            "F_Z": ("N", true.tolist()),
            "error": ("1", (found / true - 1).tolist()),
            "identified": ("", [bool(x) for x in told]),
        },
        "Recursive least squares of the observer's adhesion and the speed, no noise, no prior"
        " but the box. Dry, wet and dry rail.",
    )


def tables(context: Context) -> dict[str, Table]:
    """All tables of the identification."""
    found = many_seeds(context)
    found["excitation"] = excitation()
    found["convergence"] = convergence(context.quick)
    for name in RUNS:
        found[f"loop_{name}"] = in_closed_loop(name, context.compile)
    return found


EXPERIMENTS = {
    "identification": Experiment(
        "Identification", tables, "Do the data tell the running resistance, and who finds it?"
    ),
}


# ---- figures and claims --------------------------------------------------------------------------


def scatter(r: Results) -> Any:
    """Each coefficient, over its true value, in each seed."""
    table = r.table("identification", "seeds")
    fig, axes = plots.panels(2, 3, height=2.3)
    short = {SQUARES: "LS", PROPER: "PSO", PRINTED: "PSO,\nprinted", LOOP: "loop"}
    for row, name in enumerate(RANGES):
        for column, (k, true) in enumerate(zip(BOX, TRUE, strict=True)):
            groups = {
                short[m]: [
                    x / true
                    for x, of, by in zip(table[k], table["run"], table["method"], strict=True)
                    if of == name and by == m
                ]
                for m in METHODS
            }
            axis = axes[row, column]
            plots.spread(groups, (f"{k} over its true value", "1"), axis=axis, title=f"{name}, {k}")
            axis.axhline(1.0, color=plots.BLACK, lw=0.8)
    return fig


def converging(r: Results) -> Any:
    """Misfit and error of a3 over the iterations of both swarms."""
    table = r.table("identification", "convergence")
    fig, axes = plots.panels(1, 2, height=2.6)
    what = (("rms misfit", ("rms misfit", "N/kN")), ("a3, error", ("error of a3", "1")))
    for axis, (column, y) in zip(axes.flat, what, strict=True):
        curves = {}
        for method in (PROPER, PRINTED):
            at = [k for k, m in enumerate(table["method"]) if m == method]
            curves[method] = ([table["iterations"][k] for k in at], [table[column][k] for k in at])
        plots.lines(curves, ("iterations", "1"), y, axis=axis, log="xy", points=True)
    return fig


FIGURES = {
    "fig05_identification": Figure(
        "Coefficients over their true values, each dot a seed, noise .02 N/kN. Above 0 to 20 m/s,"
        " below 5 to 8 m/s, which does not tell them.", scatter, "Fig. 5",
    ),
    "fig06_convergence": Figure(
        "Convergence of the well-posed and the printed swarm, without noise, median of the seeds.",
        converging, "Fig. 6",
    ),
}  # fmt: skip


def mean_of(k: str) -> Callable[[Results], Any]:
    """Mean of a coefficient over the seeds of the printed swarm, run `wide`, no noise."""
    return lambda r: next(
        value
        for value, name, noise, method in zip(
            *(r.table("identification", "accuracy")[c]
              for c in (f"{k}, mean", "run", "noise", "method")), strict=True
        )
        if (name, noise, method) == ("wide", 0.0, PRINTED)
    )  # fmt: skip


def scatter_of(k: str, printed: str) -> Callable[[Results], str]:
    """How far the seeds of the printed swarm lie apart, beside how far their mean is off."""

    def told(r: Results) -> str:
        table = r.table("identification", "accuracy")
        at = next(
            i for i in range(len(table["run"]))
            if (table["run"][i], table["noise"][i], table["method"][i]) == ("wide", 0.0, PRINTED)
        )  # fmt: skip
        std, off = float(table[f"{k}, std"][at]), table[f"{k}, mean"][at] - float(printed)
        more = "more" if std > abs(off) else "less"
        return (
            f"the paper's is one draw; the seeds scatter by {std:.2g}, {more} than the mean is off:"
            " the swarm stops before it arrives"
        )

    return told


def stopped(r: Results) -> str:
    """What more iterations bring the printed swarm."""
    table = r.table("identification", "convergence")
    steps = [
        (n, e)
        for m, n, e in zip(*(table[c] for c in ("method", "iterations", "a3, error")), strict=True)
        if m == PRINTED
    ]
    (some, before), (most, after) = steps[-2:]
    return (
        f"properly in {proper_share(PRINTED)(r):.0%} of the seeds. With its small inertia and pulls"
        f" it comes to rest before it arrives. The median error of a3 is {before:.2g} after {some}"
        f" iterations and {after:.2g} after {most}"
    )


def proper_share(method: str) -> Callable[[Results], float]:
    """Share of the seeds with coefficients within 5 % and F_Z within 1 %, run `wide`, noise."""

    def share(r: Results) -> float:
        table = r.table("identification", "accuracy")
        at = next(
            k for k in range(len(table["run"]))
            if (table["run"][k], table["noise"][k], table["method"][k]) == ("wide", NOISE, method)
        )  # fmt: skip
        return float(table["good"][at]) / float(table["seeds"][at])

    return share


CLAIMS = (
    *(
        Claim(
            f"pso_{k}", "Fig. 5", f"the swarm of Table 3 finds {k} = {printed}", "number", printed,
            mean_of(k), unit, tolerance="5 %",
            assumption="speeds 0 to 20 m/s, no noise, mean over the seeds; box 0..1, 0..0.1,"
            " 0..0.01 in N/kN and m/s",
            why=scatter_of(k, printed),
        )
        for k, printed, unit in (
            ("a1", "0.505", "N/kN"), ("a2", "0.05", "N s/(kN m)"), ("a3", "0.003", "N s^2/(kN m^2)")
        )
    ),
    Claim(
        "pso_identifies", "section 4.1", "the swarm can identify the resistance properly", "yes/no",
        True, lambda r: proper_share(PRINTED)(r) >= 0.95,
        assumption="properly: each coefficient within 5 % and F_Z within 1 % in 95 of 100 seeds",
        why_not=stopped,
    ),
)  # fmt: skip
