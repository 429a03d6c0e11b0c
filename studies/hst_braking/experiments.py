"""Experiments of the study ``hst_braking``: what is no loop in a scenario."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Context, Experiment, Scenario, Table, prepare, simulate
from slipctl.certify.bounds import filters
from slipctl.estimate.kalman.filters import ctukf
from slipctl.models.zhang_2021 import hst_braking_control as control
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.ep_valve import THETA, air_brake
from slipctl.models.zhang_2021.hst_braking import I_W, G, R, peak_height, plant
from slipctl.studies.best_possible import against_optimum
from slipctl.studies.hst_braking.limits import funnel, locked, order, printed, standstill
from slipctl.studies.hst_braking.loops import (
    NAMES,
    NOISE,
    H,
    best,
    closed_form_distance,
    sensing,
)
from slipctl.studies.hst_braking.measures import (
    F_Z,
    NEAR_FORCE,
    NEAR_SLIP,
    distance,
    spans,
    time_until,
)
from slipctl.studies.hst_braking.random_rails import random_rails

# ---- the bound -----------------------------------------------------------------------------------


def closed_form(context: Context) -> Table:
    """Bounds by simulation and by formula, and the distance that resistance takes."""
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "ours", "formula", "off")}
    law = context.models["adh"]
    at = {
        "ideal": [best(law, n) for n in NAMES],
        "ideal_fixed": [(0.1, -law(lam=0.1, **law.conditions[n])["mu"]) for n in NAMES],
    }
    for name, peaks in at.items():
        block, scenario = context.loop("base", name)
        ours = distance(simulate(block, scenario, compile=context.compile))
        formula = closed_form_distance(tuple(height for _, height in peaks))
        for key, value in zip(rows, (name, ours, formula, ours - formula), strict=True):
            rows[key].append(value)
    return Table(
        "Bounds: adhesion held from the start, in 6 s",
        {
            "loop": ("", rows["loop"]),
            "distance": ("m", rows["ours"]),
            "closed form": ("m", rows["formula"]),
            "difference": ("m", rows["off"]),
        },
        "v' = -g mu without resistance; no controller can be shorter than `ideal`.",
    )


# ---- the filter ----------------------------------------------------------------------------------


def filter_convergence(context: Context) -> dict[str, Table]:
    """How fast the adhesion force is estimated, and whether the filter's statistics hold."""
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "rail", "time", "after20", "noise")}
    scenario = context.loop("base", "eppfc")[1]
    for name in ("eppfc", "filter_printed", "points_printed"):
        block = context.loop("base", name)[0]
        log = simulate(block, scenario, compile=context.compile)
        off = np.abs(log["ctl.filter.F_a"].values - log["plant.wheel.F_a"].values)
        for s, rail in zip(spans(log), NAMES, strict=True):
            rows["loop"].append(name)
            rows["rail"].append(rail)
            rows["time"].append(time_until(off[s], NEAR_FORCE))
            rows["after20"].append(float(off[s][20:].max()))
            rows["noise"].append(None)
    block, scenario = context.loop("noise", "eppfc")
    log = simulate(block, scenario, compile=context.compile)
    off = log["ctl.filter.F_a"].values - log["plant.wheel.F_a"].values
    for s, rail in zip(spans(log), NAMES, strict=True):
        rows["loop"].append("eppfc, noise")
        rows["rail"].append(rail)
        rows["time"].append(None)
        rows["after20"].append(float(np.abs(off[s][20:]).max()))
        rows["noise"].append(float(off[s][-500:].std()))
    gamma = 0.23
    return {
        "convergence": Table(
            "Adhesion force: estimated against true, after each change of the rail",
            {
                "loop": ("", rows["loop"]),
                "rail": ("", rows["rail"]),
                "within 221 N for good after": ("s", rows["time"]),
                "largest error from 20 ms on": ("N", rows["after20"]),
                "standard deviation at the end": ("N", rows["noise"]),
            },
            "221 N is 2 % of the steady dry force. At the start the wheel is released and rolls, so"
            " the force grows with the slip. Gamma per sample: pole"
            f" {filters.pole(gamma):.4f}, {1e3 * filters.time_constant(gamma, H):.2f} ms; per"
            " second, as printed, 4.35 s.",
        ),
        "consistency": consistency(context),
    }


def random_walk(filter_block: Block, q: float, samples: int, seed: int) -> Any:
    """Log of a filter on a wheel whose adhesion is a random walk of q in N^2/s, R_w = 1."""
    rng = np.random.default_rng([seed, 7])
    F = -8000 + np.cumsum(math.sqrt(q * H) * rng.standard_normal(samples))
    T_b = -3400.0
    steps_ = (T_b - R * F[:-1]) / I_W * H + math.sqrt(H) * rng.standard_normal(samples - 1)
    omega = 100 + np.concatenate([[0.0], np.cumsum(steps_)])
    scenario = Scenario(
        "walk", samples * H, inputs={"omega": lambda t: omega, "T_b": T_b}, seed=seed
    )
    return simulate(filter_block, scenario)


def consistency(context: Context) -> Table:
    """NIS and whiteness of the filter with matched drift, and of the form with gamma."""
    samples = 4_000 if context.quick else 20_000
    gamma, Hw = 0.23, R / I_W
    q = filters.matched_drift(gamma, 1.0, Hw, H)
    model = control.wheel_model
    both: dict[str, Any] = dict(prior=4e6, noise=1.0, start=-8000.0)
    cases: list[tuple[str, Block, float, float | None]] = [
        ("without gamma, drift known", ctukf(model, "omega", "F_a", drift=q, **both), q, 1.0),
        (
            "without gamma, drift known",
            ctukf(model, "omega", "F_a", drift=q / 100, **both),
            q / 100,
            1.0,
        ),
    ]
    for factor in (0.0, 0.01, 1.0, 10.0):
        block = ctukf(model, "omega", "F_a", gamma=gamma, **both)
        cases.append(
            ("gamma 0.23", block, factor * q, filters.expected_nis(gamma, 1.0, Hw, H, factor * q))
        )
    low, high = filters.nis_band(samples - 500)
    white = filters.white_band(samples - 500)
    rows: dict[str, list[Any]] = {
        k: [] for k in ("filter", "drift", "nis", "expected", "inside", "corr", "white")
    }
    for name, block, drift, expected in cases:
        log = random_walk(block, drift, samples, context.seed)
        nis = log["nis"].values[500:]
        innovation = log["innovation_omega"].values[500:]
        corr = float(np.corrcoef(innovation[1:], innovation[:-1])[0, 1])
        values = (name, math.sqrt(drift), float(nis.mean()), expected,
                  bool(low < nis.mean() < high), corr, bool(abs(corr) < white))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "Consistency on a synthetic random walk of the adhesion force",
        {
            "filter": ("", rows["filter"]),
            "drift of the force": ("N/s^0.5", rows["drift"]),
            "mean NIS": ("1", rows["nis"]),
            "its expectation": ("1", rows["expected"]),
            "inside the 95 % band": ("", rows["inside"]),
            "correlation of innovations": ("1", rows["corr"]),
            "white": ("", rows["white"]),
        },
        f"{samples} samples; band {low:.4f} to {high:.4f}, white below {white:.4f}. With gamma P"
        " forgets the data at a fixed rate, whatever the force does. Its P is that of one drift"
        " only. So on any other the NIS is off, and it is 2/(2 + gamma) on a constant force.",
    )


# ---- the search ----------------------------------------------------------------------------------


AFTER = (50, 120, 250)
"""Times in ms after a change of the rail at which the search is looked at."""


def search(context: Context) -> dict[str, Table]:
    """When the best slip is found, and what forbids to find it earlier."""
    seeds = 3 if context.quick else 30
    summary: dict[str, list[Any]] = {
        k: [] for k in ("search", "noise", "seeds", "rail", "off50", "off120", "off250", "worst")
    }
    kinds = {
        "eppfc": "with prior", "eppfc_free": "without prior", "eppfc_gradient": "gradient"
    }  # fmt: skip
    jobs = [
        (name, what, noise, count)
        for name, what in kinds.items()
        for noise, count in ((0.0, 1), (NOISE, seeds))
    ]
    law = context.models["adh"]

    def outcome(job: tuple[str, float, int]) -> dict[str, Any]:
        """Errors some time after each change of the rail, and the time until it is small."""
        name, noise, seed = job
        log = ready[name, noise](seed=seed)
        off = np.abs(log["ctl.search.best"] - log["lam_opt"])
        starts = [2000 * k for k in range(len(NAMES))]
        return {
            "off": [[float(off[first + ms]) for ms in AFTER] for first in starts],
            "time": [time_until(off[first : first + 2000], NEAR_SLIP) for first in starts],
        }

    ready = {}
    for name, _, noise, _ in jobs:
        block, scenario = context.loop("base", name)
        block = sensing(block, {"tacho.sigma": noise})
        ready[name, noise] = prepare(
            block, scenario, compile=context.compile, log=("ctl.search.best", "lam_opt")
        )
    runs = [(n, noise, s) for n, _, noise, count in jobs for s in range(1, count + 1)]
    outcomes = dict(zip(runs, context.each("runs", runs, outcome, (0.0, 0.9)), strict=True))
    for name, what, noise, count in jobs:
        found = [outcomes[name, noise, seed] for seed in range(1, count + 1)]
        for k, rail in enumerate(NAMES):
            summary["search"].append(what)
            summary["noise"].append(noise)
            summary["seeds"].append(count)
            summary["rail"].append(rail)
            for at, ms in enumerate(AFTER):
                summary[f"off{ms}"].append(max(f["off"][k][at] for f in found))
            times = [f["time"][k] for f in found]
            summary["worst"].append(None if None in times else max(times))
    block, scenario = context.loop("base", "eppfc_free")
    log = simulate(block, scenario, compile=context.compile)
    prior = simulate(context.loop("base", "eppfc")[0], scenario, compile=context.compile)
    return {
        "found": Table(
            "Search result before any rate limit, against the best slip",
            {
                "search": ("", summary["search"]),
                "noise": ("rad/s", summary["noise"]),
                "seeds": ("1", summary["seeds"]),
                "rail": ("", summary["rail"]),
                "error at 50 ms, worst": ("1", summary["off50"]),
                "error at 120 ms, worst": ("1", summary["off120"]),
                "error at 250 ms, worst": ("1", summary["off250"]),
                "within 0.01 for good after, worst": ("s", summary["worst"]),
            },
            "The prior is the one-parameter family through the paper's three rails.",
        ),
        "bound": _bound_table(law, log, prior),
    }


def knowledge(law: Block, lam: np.ndarray, rail: Mapping[str, float], sigma: float) -> float:
    """Smallest standard deviation of the best slip that an unbiased estimate can have.

    Cramer-Rao: the wheel speed is measured at each tick with white noise of sigma in rad/s, brake
    torque and slip are known. So omega_k = omega_0 + sum of (T_b - r F_z mu(lam; p))/I_w dt.
    Unknown are the law's parameters and omega_0; the sum, not each increment, is what is measured,
    so that the information of all ticks since the change is counted.
    """
    names = list(rail)
    gradient = law.jacobian("mu", names)
    mean = (lam[1:] + lam[:-1]) / 2
    order = [n.partition("_")[2] for n in gradient.name_in()]
    arguments = [mean.reshape(1, -1) if n == "lam" else float(rail[n]) for n in order]
    rows = np.array(gradient.map(len(mean))(*[
        ca.DM(a) if np.ndim(a) else ca.repmat(ca.DM(a), 1, len(mean)) for a in arguments
    ])).reshape(-1, len(names))  # fmt: skip
    scale = np.array([float(rail[n]) for n in names])  # relative parameters
    sums = np.vstack([np.zeros(len(names)), np.cumsum(rows * scale, axis=0)])
    J = np.hstack([sums * R * F_Z / I_W * H, np.ones((len(lam), 1))]) / sigma
    a0, a1, a2 = (float(rail[n]) for n in ("a0", "a1", "a2"))
    g = {"a0": 1 / (a0 * a1), "a1": (1 - math.log(a0 * a1 / a2)) / a1**2, "a2": -1 / (a2 * a1)}
    along = np.array([g[n] * float(rail[n]) for n in names] + [0.0])
    r: Any = np.linalg.qr(J, mode="r")
    if np.abs(np.diag(r)).min() < 1e-14 * np.abs(np.diag(r)).max():
        return math.inf
    return float(np.linalg.norm(np.linalg.solve(r.T, along)))


def _bound_table(law: Block, log: Any, prior: Any) -> Table:
    """Bound on the knowledge of the best slip on the way that the slip took after 2 s."""
    snow = law.conditions["snow"]
    free = log["plant.wheel.lam"].values[2000:]
    known = prior["plant.wheel.lam"].values[2000:]
    rows: dict[str, list[Any]] = {k: [] for k in ("time", "free", "prior", "moved")}
    height = float(peak_height(**snow))
    rate = ppc.slip_fall_rate(F_Z * height, 43.6, R, I_W, a=G * height, slip=0.15)
    for ms in (20, 50, 80, 100, 120, 150, 200, 250, 300):
        rows["time"].append(ms * H)
        rows["free"].append(knowledge(law, free[: ms + 1], snow, NOISE))
        rows["prior"].append(knowledge(law, known[: ms + 1], snow, NOISE))
        rows["moved"].append(float(np.ptp(free[: ms + 1])))
    return Table(
        "Why 50 ms need a prior: bound on the best slip after the change at 2 s, noise 1e-3 rad/s",
        {
            "time since the change": ("s", rows["time"]),
            "bound without prior, slip as in eppfc_free": ("1", rows["free"]),
            "bound without prior, slip as in eppfc": ("1", rows["prior"]),
            "slip ratio has moved by": ("1", rows["moved"]),
        },
        "Standard deviation of any unbiased estimate (Cramer-Rao) of the three parameters' best"
        f" slip. With the brake released the slip falls by {rate:.3f} 1/s on snow. So in 50 ms it"
        " sees a piece of the curve that is nearly a parabola's, and its peak is far away.",
    )


# ---- price of each reference ---------------------------------------------------------------------


def references(context: Context) -> Table:
    """Distance of eppfc with each reference above the true one, and funnel and restarts."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("scenario", "loop", "x", "above", "share", "restarts")
    }
    for scenario, names in (
        ("base", ("eppfc", "eppfc_gradient", "eppfc_free")),
        ("noise", ("eppfc", "eppfc_gradient", "eppfc_free")),
        ("real", ("eppfc",)),
        ("lag50", ("eppfc",)),
    ):
        block, where = context.loop(scenario, "eppfc_true_reference")
        true = distance(simulate(block, where, compile=context.compile))
        for name in names:
            block, where = context.loop(scenario, name)
            log = simulate(block, where, compile=context.compile)
            share, restarts = log["ctl.law.share"].max(), log["ctl.law.restarts"][-1]
            x = distance(log)
            values = (scenario, name, x, x - true, float(share), float(restarts))
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
    return Table(
        "Price of the online reference: distance above the same law with the true reference",
        {
            "scenario": ("", rows["scenario"]),
            "loop": ("", rows["loop"]),
            "distance": ("m", rows["x"]),
            "above the true reference": ("m", rows["above"]),
            "largest error over its bound": ("1", rows["share"]),
            "restarts": ("1", rows["restarts"]),
        },
        "Both under the same rate limit and filter.",
    )


def estimated_speed(context: Context) -> Table:
    """Price of the estimated speed for each controller."""
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "true", "estimated", "price", "v", "lam")}
    for name in ("fixed_slip", "pid", "efc", "eppfc", "eppfc_barrier"):
        a, where = context.loop("base", name)
        b, there = context.loop("estimated", name)
        x = distance(simulate(a, where, compile=context.compile))
        log = simulate(b, there, compile=context.compile)
        off = log["ctl.fusion.v"].values - log["plant.wheel.v"].values
        slip = log["ctl.fusion.lam"].values - log["plant.wheel.lam"].values
        values = (name, x, distance(log), distance(log) - x, float(np.abs(off).max()),
                  float(np.abs(slip).max()))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "Price of the estimated speed: accelerometer (bias 0.02 m/s^2, noise 0.05 m/s^2) and wheel",
        {
            "loop": ("", rows["loop"]),
            "distance, true speed": ("m", rows["true"]),
            "distance, estimated": ("m", rows["estimated"]),
            "price": ("m", rows["price"]),
            "largest error of the speed": ("m/s", rows["v"]),
            "largest error of the slip ratio": ("1", rows["lam"]),
        },
        "The estimated scenario also has noise on the wheel speed. A bias moves the slip that a"
        " fixed reference holds, in this case towards the peak.",
    )


def table_4(context: Context) -> Table:
    """Table 4 of the paper beside ours."""
    printed_x = {"fixed_slip": 256.8391, "pid": 254.4313, "efc": 254.1955, "eppfc": 254.0479}
    printed_a = {"pid": 0.0679, "efc": 0.0637, "eppfc": 0.0564}
    rows: dict[str, list[Any]] = {
        k: [] for k in ("loop", "paper", "ours", "resisted", "barely", "variance")
    }
    bounds = {}
    for scenario in ("base", "resistance"):
        block, where = context.loop(scenario, "ideal")
        bounds[scenario] = distance(simulate(block, where, compile=context.compile))
    for name in ("ideal", "fixed_slip", "pid", "efc", "eppfc", "eppfc_barrier"):
        logs = {}
        for scenario in ("base", "resistance"):
            block, where = context.loop(scenario, name)
            logs[scenario] = simulate(block, where, compile=context.compile)
        a = logs["base"]["plant.wheel.a"].values
        spread = [float(np.var(a[k : k + 500])) for k in (0, 2000, 4000)]
        values = (name, printed_x.get(name), distance(logs["base"]), distance(logs["resistance"]),
                  printed_a.get(name), float(np.mean(spread)))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "Table 4: distance in 6 s and variance of the acceleration",
        {
            "loop": ("", rows["loop"]),
            "distance, paper": ("m", rows["paper"]),
            "distance, ours": ("m", rows["ours"]),
            "distance, ours with resistance": ("m", rows["resisted"]),
            "variance, paper": ("m2/s4", rows["barely"]),
            "variance, ours": ("m2/s4", rows["variance"]),
        },
        "The paper's distances are shorter than the bound without resistance; its Davis"
        " coefficients are missing. Variance: mean over the 0.5 s after 0, 2 and 4 s; the paper"
        " does not say its windows.",
    )


def regret(context: Context) -> Table:
    """Loops against the optimal control bound, without and with lag."""
    adh = context.models["adh"]
    plants = {"base": plant(adh), "real": plant(adh, air_brake("lag"))}
    wanted = {
        "base": ("eppfc_true_reference", "efc_true_reference", "pid_true_reference", "eppfc",
                 "eppfc_barrier", "efc", "pid", "fixed_slip"),
        "real": ("eppfc_true_reference", "eppfc", "eppfc_barrier", "efc", "pid", "fixed_slip"),
    }  # fmt: skip
    full = 600e3 * -THETA
    return against_optimum(
        context, wanted, plants, "plant.brake.T_b", (-full, 0.0), {"lam": (-0.01, 0.3)}
    )


EXPERIMENTS = {
    "table_4": Experiment("Table 4", table_4, "How far does each controller get in 6 s?"),
    "regret": Experiment("Regret", regret, "How far is each loop from what is possible?"),
    "order": Experiment("Order of the distances", order, "Does it hold for other limits, gains?"),
    "closed_form": Experiment("Bounds", closed_form, "Does the simulation agree with formulas?"),
    "filter": Experiment("Filter", filter_convergence, "How fast and how honest is the filter?"),
    "search": Experiment("Search", search, "When is the best slip found?"),
    "references": Experiment("References", references, "What does the online reference cost?"),
    "estimated": Experiment("Estimated speed", estimated_speed, "What does it cost?"),
    "funnel": Experiment("Funnel", funnel, "What does the funnel hold?"),
    "printed": Experiment("Printed forms", printed, "What do the printed forms do?"),
    "locked": Experiment("Locked wheel", locked, "Does a locked wheel turn again?"),
    "standstill": Experiment("Standstill", standstill, "Down to standstill without lock-up?"),
    "random_rails": Experiment(
        "Random rails", random_rails, "What does the prior cost where it does not hold?"
    ),
}
