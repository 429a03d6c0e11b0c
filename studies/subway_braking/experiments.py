"""Experiments of the study ``subway_braking``: what is no loop in a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl import (
    Block,
    Context,
    Experiment,
    Table,
    argmax,
    argmax_block,
    differential_evolution,
    peak_bound,
    prepare,
    rls,
    simulate,
)
from slipctl.models.brakes import brake
from slipctl.models.huang_2020.certificate import reaching_law
from slipctl.models.huang_2020.subway_braking import (
    curve_resistance,
    double_exponential,
    plant,
    wheelset,
)
from slipctl.models.huang_2020.subway_braking_control import super_twisting as super_twisting_law
from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.run import build
from slipctl.run.metrics import settling_time
from slipctl.studies.best_possible import against_optimum
from slipctl.studies.subway_braking import estimation
from slipctl.studies.subway_braking.leaves import leaves
from slipctl.studies.subway_braking.loops import (
    MOVING,
    START,
    TABLE_1,
    H,
    best,
    perfect,
    searcher,
)
from slipctl.studies.subway_braking.sections import sections

RAILS = ("dry", "wet", "ice")
LENGTH = 2.0
"""Time on each rail in s."""


def spans(log: Any) -> list[slice]:
    """Ticks of each rail."""
    n = round(LENGTH / H)
    return [slice(k * n, (k + 1) * n) for k in range(len(log["time"]) // n)]


def ripple_by_rail(log: Any) -> list[float]:
    """Torque ripple in N m over the last 0.5 s of each rail, peak to peak."""
    torque, last = log["plant.brake.T_b"].values, round(0.5 / H)
    return [float(np.ptp(torque[s.stop - last : s.stop])) for s in spans(log)]


def settling_by_rail(log: Any, band: float = 0.05) -> list[float | None]:
    """Time in s until |v_s - v_s*| stays below the band in m/s on each rail; None if never."""
    error, time = log["plant.wheel.v_s"].values - log["v_opt"].values, log["time"].values
    return [settling_time(time, error, s.start * H, s.stop * H, band) for s in spans(log)]


def steady_error(log: Any) -> float:
    """Rms of v_s - v_s* in m/s over the last 0.5 s of each rail."""
    error, last = log["plant.wheel.v_s"].values - log["v_opt"].values, round(0.5 / H)
    return float(np.sqrt(np.mean([error[s.stop - last : s.stop] ** 2 for s in spans(log)])))


# ---- the estimator on a sweep --------------------------------------------------------------------

SWEEP = np.linspace(0.0, 2.4, 26)
"""Slip speeds of a 400 ms sweep sampled every 16 ms, in m/s."""


def estimates(block: Block, columns: Sequence[np.ndarray], starts: Any = None) -> np.ndarray:
    """Last outputs of an estimator fed with samples, one run per row of the last column.

    Args:
        block: estimator.
        columns: slip speeds, then one row of measurements per run.
        starts: start states by name, one column per run, or None.
    """
    slip, measured = columns
    runs = len(measured)
    x = np.repeat(np.array(ca.DM(block.pack("state", block.start())).full()), runs, axis=1)
    if starts is not None:
        at = 0
        for n, s in block.states.items():
            if n in starts:
                x[at : at + s.size] = starts[n]
            at += s.size
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    roll = build.make_roller(block.f)
    last = np.empty((runs, block.f.size1_out(1)))
    for k in range(runs):
        u = np.ascontiguousarray(np.column_stack([slip, measured[k]]))
        x_log, y_log = np.empty((len(u), len(x))), np.empty((len(u), last.shape[1]))
        state = np.ascontiguousarray(x[:, k])
        roll(state, u, p, x_log, y_log)
        last[k] = y_log[-1]
    return last[:, :3]


def peaks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place in m/s and height of the peak of each row (c, a, b)."""
    c, a, b = values.T
    place = np.log(b / a) / (b - a)
    return place, c * (np.exp(-a * place) - np.exp(-b * place))


def sweep(context: Context) -> Table:
    """Peak found by the windowed estimator on a sweep, noise-free, with noise, from anywhere."""
    law, seeds = double_exponential, 20 if context.quick else 200
    rng = np.random.default_rng([context.seed, 1])
    a = rng.uniform(0.2, 1.0, seeds)
    first = np.array(
        [rng.uniform(0.02, 1.2, seeds), a, a + 0.2 + rng.uniform(0, 1, seeds) * (2.3 - a)]
    )
    coordinates = np.array([np.log(first[0]), np.log(first[1]), np.log(first[2] - first[1])])
    rows: dict[str, list[Any]] = {
        k: [] for k in ("place", "height", "rms", "share", "bound", "from")
    }
    for k, name in enumerate(TABLE_1):
        rail = law.conditions[name]
        clean = estimation.curve(law, SWEEP, rail)
        block = rls(law, form="window", start=START)
        found = estimates(block, (SWEEP, clean[None]))
        place, height = peaks(found)
        true_place, true_height = (float(v[0]) for v in peaks(np.array([[*rail.values()]])))
        rows["place"].append(100 * abs(place[0] / true_place - 1))
        rows["height"].append(100 * abs(height[0] / true_height - 1))
        v = np.linspace(0.01, 10, 1000)
        fitted = dict(zip(rail, found[0], strict=True))
        off = estimation.curve(law, v, fitted) - estimation.curve(law, v, rail)
        rows["rms"].append(float(np.sqrt(np.mean(off**2))))
        noise = 1e-3 * rng.standard_normal((seeds, len(SWEEP)))
        place, height = peaks(estimates(block, (SWEEP, clean + noise)))
        inside = (abs(place / true_place - 1) < 0.05) & (abs(height / true_height - 1) < 0.05)
        rows["share"].append(100 * float(inside.mean()))
        bound = peak_bound(law, "v_s", true_place, {"v_s": SWEEP}, 1e-3, **rail)
        rows["bound"].append(100 * bound.location / true_place)
        starts = {"theta": coordinates, "mean": coordinates}
        place, _ = peaks(estimates(block, (SWEEP, np.tile(clean, (seeds, 1))), starts))
        rows["from"].append(100 * float((abs(place / true_place - 1) < 0.05).mean()))
        context.progress((k + 1) / 3)
    return Table(
        "Peak estimated from a 400 ms sweep of the slip, 0 to 2.4 m/s, sampled every 16 ms",
        {
            "rail": ("", list(TABLE_1)),
            "error of the place, noise-free": ("%", rows["place"]),
            "error of the height, noise-free": ("%", rows["height"]),
            "rms error of the curve": ("1", rows["rms"]),
            "seeds within 5 %, noise 1e-3": ("%", rows["share"]),
            "Cramer-Rao bound of the place, noise 1e-3": ("%", rows["bound"]),
            "random starts that converge": ("%", rows["from"]),
        },
        f"{seeds} seeds and {seeds} random starts (c .02-1.2, a .2-1, b a+.2-2.5) per rail; the"
        " bound is one standard deviation of any unbiased estimate, over the true place.",
    )


# ---- the search ----------------------------------------------------------------------------------


def search(context: Context) -> Table:
    """Differential evolution against the closed form and against the CasADi optimum."""
    law, curves = double_exponential, 20 if context.quick else 200
    rng = np.random.default_rng([context.seed, 2])
    c, a = rng.uniform(0.02, 1, curves), rng.uniform(0.2, 0.6, curves)
    b = rng.uniform(0.8, 2, curves)
    true, _ = peaks(np.column_stack([c, a, b]))
    rows: dict[str, list[Any]] = {k: [] for k in ("method", "error", "wrong")}
    casadi = [
        argmax(law, "v_s", lo=0.01, hi=10, at=dict(c=k, a=m, b=n), closed_form=False).location
        for k, m, n in zip(c, a, b, strict=True)
    ]
    printed = differential_evolution(law, "v_s", lo=0.01, hi=10, form="printed-alg1")
    online = argmax_block(law, "v_s", lo=0.01, hi=10)
    found = {
        "differential evolution": _searched(searcher(law), c, a, b),
        "grid and Newton, as a block": _searched(online, c, a, b),
        "argmax on the exact derivative": np.array(casadi),
        "Algorithm 1 as printed": _searched(printed, c, a, b),
    }
    for k, (name, places) in enumerate(found.items()):
        rows["method"].append(name)
        rows["error"].append(float(np.abs(places - true).max()))
        rows["wrong"].append(int((np.abs(places - true) > 1e-6).sum()))
        context.progress((k + 1) / len(found))
    return Table(
        "Best slip of random curves, against ln(b/a)/(b - a)",
        {
            "method": ("", rows["method"]),
            "largest error": ("m/s", rows["error"]),
            "curves with an error above 1e-6 m/s": ("1", rows["wrong"]),
        },
        f"{curves} curves, c in [.02, 1], a in [.2, .6] s/m, b in [.8, 2] s/m. Algorithm 1 prints"
        " '<' where a maximum is sought, so it runs to the end of the range.",
    )


def _searched(block: Block, *columns: np.ndarray) -> np.ndarray:
    """Places that a search block finds, one tick per row of inputs."""
    u = np.column_stack(columns)
    x = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    x_log, y_log = np.empty((len(u), x.size)), np.empty((len(u), block.f.size1_out(1)))
    build.make_roller(block.f)(x, u, p, x_log, y_log)
    return y_log[:, list(block.outputs).index("best")]


# ---- the moving optimum --------------------------------------------------------------------------


def moving(context: Context) -> dict[str, Table]:
    """Loop with the online optimum on rails whose optimum moves: time to find it, and its price."""
    loop, scenario = context.loop("moving_optimum", "sta_online")
    known, _ = context.loop("moving_optimum", "sta")
    law = context.models["adh"]
    true = [best(law, n) for n in MOVING]
    reference = simulate(known, scenario, compile=context.compile)
    distance = float(reference["plant.wheel.x"][-1])
    levels = ((0.0, 1), (2e-4, 5 if context.quick else 100), (1e-3, 5 if context.quick else 100))
    run = prepare(loop, scenario, compile=context.compile)
    summary: dict[str, list[Any]] = {k: [] for k in ("noise", "seeds", "price", "time", "use")}
    shares: dict[str, list[Any]] = {k: [] for k in ("noise", "rail", "end", "half", "bound")}

    def outcome(job: tuple[float, int]) -> dict[str, Any]:
        """Price, outcome on each rail, and for some seeds the bounds, of one run."""
        noise, seed = job
        log = run({"adhesion.sigma": noise}, seed=seed).dataset()
        return {
            "price": float(log["plant.wheel.x"][-1]) - distance,
            "rails": [_rail_outcome(log, s, *t) for s, t in zip(spans(log), true, strict=True)],
            "bound": _bounds(law, log, noise) if noise and seed < 5 else None,
        }

    jobs = [(noise, seed) for noise, seeds in levels for seed in range(seeds)]
    outcomes = dict(zip(jobs, context.each("runs", jobs, outcome), strict=True))
    for noise, seeds in levels:
        runs = [outcomes[noise, seed] for seed in range(seeds)]
        price = [r["price"] for r in runs]
        found, use, off = ([[rail[k] for rail in r["rails"]] for r in runs] for k in range(3))
        bound = [r["bound"] for r in runs if r["bound"] is not None]
        summary["noise"].append(noise)
        summary["seeds"].append(seeds)
        summary["price"].append(max(price))
        times = [t for row in found for t in row]
        summary["time"].append(None if None in times else max(times))
        summary["use"].append(float(np.min(np.mean(use, axis=0))))
        for k, rail in enumerate(RAILS):
            shares["noise"].append(noise)
            shares["rail"].append(rail)
            shares["end"].append(100 * float(np.mean([o[k] < 0.05 for o in off])))
            times_k = [row[k] for row in found]
            early = [t is not None and t <= 0.5 for t in times_k]
            shares["half"].append(100 * float(np.mean(early)))
            shares["bound"].append(100 * float(np.median([b[k] for b in bound])) if bound else None)
    return {
        "summary": Table(
            "Online optimum on rails whose optimum moves",
            {
                "noise": ("1", summary["noise"]),
                "seeds": ("1", summary["seeds"]),
                "distance above known optimum, worst": ("m", summary["price"]),
                "found within 5 % after, worst": ("s", summary["time"]),
                "adhesion use from 0.5 s after each change, mean of the worst rail": (
                    "1", summary["use"],
                ),
            },
            "White noise on the measured adhesion; found: the estimated best slip stays within 5 %"
            " of the true one until the next change.",
        ),
        "shares": Table(
            "Share of seeds within 5 % of the best slip, beside the bound that limits it",
            {
                "noise": ("1", shares["noise"]),
                "rail": ("", shares["rail"]),
                "seeds within 5 % for good after 0.5 s": ("%", shares["half"]),
                "seeds within 5 % at the end of the rail": ("%", shares["end"]),
                "Cramer-Rao bound of the place at its end": ("%", shares["bound"]),
            },
            "The bound is the standard deviation of any unbiased estimate from the samples that"
            " the loop took on this rail, over the true place; median of 5 seeds.",
        ),
    }  # fmt: skip


def _rail_outcome(log: Any, s: slice, place: float, height: float) -> tuple[Any, float, float]:
    """Time in s from which the optimum is within 5 % for good, adhesion use, last deviation."""
    off = np.abs(log["ctl.search.best"].values[s] / place - 1)
    wrong = np.flatnonzero(off >= 0.05)
    first = 0.0 if not wrong.size else (wrong[-1] + 1) * H
    settled = slice(s.start + round(0.5 / H), s.stop)
    use = float(np.mean(np.abs(log["plant.adh.mu"].values[settled])) / height)
    return (first if wrong.size < len(off) and off[-1] < 0.05 else None), use, float(off[-1])


def _bounds(law: Block, log: Any, noise: float) -> list[float]:
    """Cramer-Rao bound of the place on each rail from the samples taken there, relative."""
    found = []
    for s, name in zip(spans(log), MOVING, strict=True):
        place, _ = best(law, name)
        taken = log["plant.wheel.v_s"].values[s][::16]
        rail = law.conditions[name]
        found.append(peak_bound(law, "v_s", place, {"v_s": taken}, noise, **rail).location / place)
    return found


# ---- chattering and gains ------------------------------------------------------------------------


def chatter(context: Context) -> Table:
    """Torque ripple of each loop on each rail, beside what theory says of the sampled laws."""
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "scenario", *RAILS, "theory")}
    smc = reaching_law.torque_swing(36.0, 12.0, H, 240.0, 0.5)
    amplitude = super_twisting.explicit_amplitude(20.0, 10.0, H)
    sta = 240.0 / 0.5 * (2 * 20.0 * math.sqrt(amplitude) - H * 10.0)
    wanted = [
        *(("base", n) for n in ("smc", "sta", "sta_implicit", "sta_printed")),
        *(("real", n) for n in ("smc", "sta", "sta_implicit")),
    ]

    def ripple(which: tuple[str, str]) -> list[float]:
        loop, where = context.loop(*which)
        return ripple_by_rail(simulate(loop, where, compile=context.compile))

    for (scenario, name), values in zip(
        wanted, context.each("ripples", wanted, ripple), strict=True
    ):
        rows["loop"].append(name)
        rows["scenario"].append(scenario)
        for rail, value in zip(RAILS, values, strict=True):
            rows[rail].append(value)
        rows["theory"].append({"smc": smc, "sta": sta}.get(name) if scenario == "base" else None)
    return Table(
        "Torque ripple over the last 0.5 s of each rail, peak to peak",
        {
            "scenario": ("", rows["scenario"]),
            "loop": ("", rows["loop"]),
            **{rail: ("N m", rows[rail]) for rail in RAILS},
            "period-2 orbit": ("N m", rows["theory"]),
        },
        "Orbit of the reaching law: 2 (J/r)(g1 s + g2), s = T g2/(2 - T g1); of super-twisting by"
        " explicit Euler: (J/r)(2 k1 |s|^(1/2) - T k2), s = T^2 ((k1 + sqrt(k1^2 - 4 k2))/4)^2."
        " Where half of it is more than the mean torque, the torque is cut off at 0, as on ice.",
    )


def gains(context: Context) -> Table:
    """Printed and chosen gains under each criterion, and what sampling makes of them."""
    pairs = {"printed": (2000.0, 1.5), "chosen": (20.0, 10.0)}
    return Table(
        "Gains of super-twisting",
        {
            "gains": ("", list(pairs)),
            "k1": ("m^.5/s^1.5", [k for k, _ in pairs.values()]),
            "k2": ("m/s^3", [k for _, k in pairs.values()]),
            "k2 that (48) wants at L = 0": (
                "m/s^3", [super_twisting.smallest_k2_printed(k1) for k1, _ in pairs.values()],
            ),
            "(48) holds for some L": (
                "", [super_twisting.printed_48(*k, 0.0) for k in pairs.values()],
            ),
            "largest L, exact": (
                "m/s^3", [_largest(super_twisting.exact, *k) for k in pairs.values()],
            ),
            "largest L, (48)": (
                "m/s^3", [_largest(super_twisting.printed_48, *k) for k in pairs.values()],
            ),
            "half-swing of the slip, explicit, 1 ms": (
                "m/s", [super_twisting.explicit_amplitude(*k, H) for k in pairs.values()],
            ),
            "half-swing of the slip, explicit, 16 ms": (
                "m/s", [super_twisting.explicit_amplitude(*k, 0.016) for k in pairs.values()],
            ),
        },
        "L bounds the slope of the disturbance. In continuous time the printed pair is stable;"
        " it is the sampling that makes it swing.",
    )  # fmt: skip


def printed(context: Context) -> Table:
    """Each printed form that fails, in the loop or on the data where it fails."""
    _, scenario = context.loop("base", "sta")
    models, compile = context.models, context.compile
    rows: list[tuple[str, str, str, float, float, str]] = []

    consistent = simulate(perfect(models, super_twisting_law()), scenario, compile=compile)
    wheel_6 = perfect(models | {"wheel": wheelset("printed-6")}, super_twisting_law())
    turned = simulate(wheel_6, scenario, compile=compile)
    law_38 = perfect(models, super_twisting_law(form="printed-38"))
    backward = simulate(law_38, scenario, compile=compile)
    dry, height = spans(consistent)[0], best(models["adh"], "dry")[1]

    def row(eq: str, form: str, what: str, of: Callable[[Any], float], log: Any, unit: str) -> None:
        rows.append((eq, form, what, float(of(log)), float(of(consistent)), unit))

    row("(6)", "printed-6", "slip after 2 s",
        lambda log: log["plant.wheel.v_s"].values[dry.stop - 1], turned, "m/s")  # fmt: skip
    row("(6)", "printed-6", "adhesion used on dry",
        lambda log: log["plant.adh.mu"].values[dry].mean() / height, turned, "1")  # fmt: skip
    row("(38)", "printed-38", "speed at the end",
        lambda log: log["plant.wheel.v"].values[-1], backward, "m/s")  # fmt: skip
    row("(38)", "printed-38", "largest slip",
        lambda log: log["plant.wheel.v_s"].values.max(), backward, "m/s")  # fmt: skip

    law = double_exponential
    clean = estimation.curve(law, SWEEP, law.conditions["dry"])
    four = rls(law, form="printed-16")
    windowed = rls(law, form="window", start=START)
    spread = [float(np.ptp(estimates(e, (SWEEP, clean[None]))[0])) for e in (four, windowed)]
    rows.append(("(15)-(19)", "printed-16", "largest minus smallest estimate", *spread, "1"))

    at = law.conditions["dry"]
    search_alg1 = differential_evolution(law, "v_s", lo=0.01, hi=10, form="printed-alg1")
    places = [e(**at)[1]["best"] for e in (search_alg1, searcher(law))]
    rows.append(("Algorithm 1", "printed-alg1", "best slip on dry", *places, "m/s"))

    for radius in (800.0, 400.0):
        W = [curve_resistance(f)(kappa=1 / radius)["W"] for f in ("printed-10", "consistent")]
        rows.append(("(10)", "printed-10", f"resistance at R = {radius:g} m", *W, "N"))
    columns = list(zip(*rows, strict=True))
    return Table(
        "Printed forms that fail",
        {
            "equation": ("", columns[0]),
            "form": ("", columns[1]),
            "what": ("", columns[2]),
            "printed form": ("", columns[3]),
            "consistent form": ("", columns[4]),
            "unit": ("", columns[5]),
        },
        "Scenario base and the dry rail of Table 1; the story of each is in docs/errata.md.",
    )


def _largest(criterion: Any, k1: float, k2: float) -> float | None:
    """Largest L in m/s^3 that a criterion accepts, by bisection; None if it accepts none."""
    if not criterion(k1, k2, 0.0):
        return None
    low, high = 0.0, k2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if criterion(k1, k2, middle) else (low, middle)
    return low


def regret(context: Context) -> Table:
    """Loops against the optimal control bound, without and with lag."""
    adh = context.models["adh"]
    plants = {"base": plant(adh), "real": plant(adh, brake(lag=True))}
    plants["moving_optimum"] = plants["base"]
    wanted = {
        "base": ("smc", "sta", "sta_implicit", "sta_online"),
        "moving_optimum": ("smc", "sta", "sta_online"),
        "real": ("smc", "sta", "sta_implicit", "sta_online"),
    }
    return against_optimum(
        context, wanted, plants, "plant.brake.T_b", (0.0, 20e3), {"wheel.v_s": (-0.2, 6.0)}
    )


EXPERIMENTS = {
    "held": Experiment("Optimum held", estimation.held, "Is it, with lag and real sensors?"),
    "search": Experiment("Search", search, "Does differential evolution find the best slip?"),
    "sweep": Experiment("Estimator on a sweep", sweep, "Does the estimator find the peak?"),
    "moving": Experiment(
        "Online optimum", moving, "How fast is a new optimum found, at what price?"
    ),
    "sections": Experiment(
        "Random sections", sections, "Is the best slip found on rails that nobody tuned for?"
    ),
    "leaves": Experiment("Leaves", leaves, "Does the estimate come back after leaves?"),
    "chatter": Experiment("Chattering", chatter, "What is left of the chattering?"),
    "printed": Experiment("Printed forms", printed, "What does each misprint do?"),
    "regret": Experiment("Regret", regret, "How far is each loop from what is possible?"),
    "gains": Experiment("Gains", gains, "What do the printed gains satisfy?"),
}
