"""Experiments of the study ``freight_traction`` on seeking: what is no loop in a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slipctl import (
    Block,
    Context,
    Experiment,
    Input,
    Output,
    Param,
    Scenario,
    Table,
    connect,
    law,
    locking_seek,
    seek_limits,
    simulate,
    sliding_seek,
)
from slipctl.certify.bounds import extremum as bounds
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.run import periods
from slipctl.seek.lock import LOCK, WAIT
from slipctl.studies.best_possible import against_optimum
from slipctl.studies.freight_traction import barrier
from slipctl.studies.freight_traction.loops import (
    FORMS,
    LAG,
    NOISE,
    SEEKERS,
    H,
    at_rest,
    best,
    seeking,
    steepest,
)
from slipctl.studies.freight_traction.measures import LOCKED, NEAR, from_when

SEEN = (
    "plant.train.v_s", "plant.adh.mu", "plant.motor.T_m", "ctl.seek.mode", "ctl.seek.v",
)  # fmt: skip


def log_of(loop: Block, scenario: Scenario, compile: bool = True) -> Any:
    """Run with each tick of what these experiments look at."""
    has = {s.name for s in loop.signals}
    return simulate(loop, scenario, compile=compile, log=[n for n in SEEN if n in has])


def sections(scenario: Scenario) -> list[tuple[str, slice]]:
    """Condition and ticks of each section of the rail."""
    assert scenario.rail is not None
    ends = [*scenario.rail.starts, scenario.duration]
    ticks = [round(t / H) for t in ends]
    return [
        (str(s.condition), slice(a, b))
        for s, a, b in zip(scenario.rail.sections, ticks[:-1], ticks[1:], strict=True)
    ]


def outcome(log: Any, span: slice, place: float, height: float) -> dict[str, Any]:
    """What a seeker made of one section: times in s, and the last half second."""
    mu, creep = log["plant.adh.mu"].values[span], log["plant.train.v_s"].values[span]
    last = round(0.5 / H)
    torque = log["plant.motor.T_m"].values[span][-last:]
    return {
        "lock": from_when(mu >= LOCKED * height, H),
        "found": from_when(np.abs(creep / place - 1) <= NEAR, H),
        "use": 100 * float(mu[-last:].min()) / height,
        "creep": float(np.ptp(creep[-last:])),
        "torque": float(np.ptp(torque)),
    }


# ---- what the loops reach ------------------------------------------------------------------------


def reached(context: Context) -> Table:
    """Each seeker under the robust law on each section: when it locks, and how still it holds."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("scenario", "loop", "rail", "lock", "found", "use", "creep", "torque")
    }

    def work(what: Sequence[str]) -> list[dict[str, Any]]:
        loop, where = context.loop(what[0], f"{what[1]}_robust")
        log = log_of(loop, where, context.compile)
        return [
            {"rail": rail, **outcome(log, span, *best(context.models["adh"], rail))}
            for rail, span in sections(where)
        ]

    wanted = [(s, seek) for s in ("base", "moving_optimum", "real") for seek in SEEKERS]
    for (scenario, seek), parts in zip(wanted, context.each("loops", wanted, work), strict=True):
        for found in parts:
            for k, v in {"scenario": scenario, "loop": seek, **found}.items():
                rows[k].append(v)
    return Table(
        "What each seeker reaches under the robust law",
        {
            "scenario": ("", rows["scenario"]),
            "loop": ("", [f"{k}_robust" for k in rows["loop"]]),
            "section": ("1", _numbered(rows["scenario"], rows["loop"])),
            "rail": ("", rows["rail"]),
            "within 0.3 % of the peak adhesion for good after": ("s", rows["lock"]),
            "within 5 % of the best creep for good after": ("s", rows["found"]),
            "least adhesion of the last 0.5 s, of the peak": ("%", rows["use"]),
            "creep ripple": ("m/s", rows["creep"]),
            "torque ripple": ("N m", rows["torque"]),
        },
        "Times count from the start of the section; for good: for its last 0.5 s at least. Ripples"
        " are peak to peak over its last 0.5 s, each tick counted.",
    )


def _numbered(scenarios: Sequence[str], loops: Sequence[str]) -> list[int]:
    """Number of each row within its scenario and loop, from 1."""
    seen: dict[tuple[str, str], int] = {}
    found = []
    for key in zip(scenarios, loops, strict=True):
        seen[key] = seen.get(key, 0) + 1
        found.append(seen[key])
    return found


def seeds(context: Context) -> Table:
    """Noise on the motor speed, with and without lag: false locks and ripples over many seeds."""
    count = 4 if context.quick else 100
    rows: dict[str, list[Any]] = {
        k: [] for k in ("what", "seeds", "false", "unlocked", "reopened", "lock", "torque", "creep")
    }
    runs = (("base", "noise"), ("moving_optimum", "noise, moving optimum"),
            ("real", "noise and 20 ms lag"))  # fmt: skip
    for k, (scenario, what) in enumerate(runs):
        loop, where = context.loop(scenario, "improved_robust")
        where = where.but(params={**where.params, "sensor.sigma": NOISE})
        found, false, unlocked, reopened = [], 0, 0, 0
        for seed in range(count):
            log = log_of(loop, where.but(seed=seed), context.compile)
            mode = log["ctl.seek.mode"].values
            for rail, span in sections(where):
                place, height = best(context.models["adh"], rail)
                found.append(outcome(log, span, place, height))
                locked = mode[span][-1] == LOCK
                unlocked += not locked
                false += bool(locked and found[-1]["use"] < 100 * LOCKED)
                opened = np.flatnonzero((mode[span][1:] == WAIT) & (mode[span][:-1] == LOCK)) * H
                reopened += int((opened > 0.2).sum())
            context.progress((k + (seed + 1) / count) / len(runs))
        locks = [f["lock"] for f in found]
        rows["what"].append(what)
        rows["seeds"].append(count)
        rows["false"].append(false)
        rows["unlocked"].append(unlocked)
        rows["reopened"].append(reopened)
        rows["lock"].append(None if None in locks else max(locks))
        rows["torque"].append(max(f["torque"] for f in found))
        rows["creep"].append(max(f["creep"] for f in found))
    return Table(
        "improved_robust under noise of 1e-3 rad/s on the motor speed, three sections each",
        {
            "what": ("", rows["what"]),
            "seeds": ("1", rows["seeds"]),
            "false locks": ("1", rows["false"]),
            "sections that end without a lock": ("1", rows["unlocked"]),
            "locks that opened by themselves": ("1", rows["reopened"]),
            "within 0.3 % for good after, worst": ("s", rows["lock"]),
            "torque ripple, worst": ("N m", rows["torque"]),
            "creep ripple, worst": ("m/s", rows["creep"]),
        },
        "A false lock is a section at whose end the seeker is locked with less than 99.7 % of the"
        " peak adhesion. Ripples over the last 0.5 s of each section, each tick counted.",
    )


def reopen(context: Context) -> Table:
    """Locks put off the peak by hand: each opens by itself and finds the peak."""
    law_, places = context.models["adh"], (0.2, 0.5, 0.9, 1.6, 2.5)
    _, base = context.loop("base", "improved_robust")
    place, height = best(law_, "dry")
    loop = seeking(law_, context.models["improved"])
    rows: dict[str, list[Any]] = {k: [] for k in ("place", "height", "open", "lock")}
    for v in places:
        mu = float(law_(v_s=v, **law_.conditions["dry"])["mu"])
        scenario = base.but(duration=6.0, start=_locked_at(v, mu))
        log = log_of(loop, scenario, context.compile)
        mode = log["ctl.seek.mode"].values
        rows["place"].append(v)
        rows["height"].append(100 * mu / height)
        rows["open"].append(float(np.argmax(mode == WAIT)) * H if (mode == WAIT).any() else None)
        rows["lock"].append(from_when(log["plant.adh.mu"].values >= LOCKED * height, H))
    return Table(
        "A lock put off the peak, dry rail",
        {
            "locked at": ("m/s", rows["place"]),
            "adhesion there, of the peak": ("%", rows["height"]),
            "opens after": ("s", rows["open"]),
            "within 0.3 % of the peak for good after": ("s", rows["lock"]),
        },
        f"Best creep {place:.4g} m/s; without noise and lag.",
    )


def _locked_at(v: float, mu: float) -> dict[str, float]:
    """Start values of a loop that has locked a creep in m/s with an adhesion."""
    seek = {"mode": float(LOCK), "v": v, "turn": v, "a": 0.06, "kept": mu, "eta": mu}
    return at_rest(v, mu) | {f"ctl.seek.{k}": s for k, s in seek.items()}


# ---- against the formulas ------------------------------------------------------------------------


@law(y=Output("1", "value"))
def slope_map(
    v=Input("m/s", "place"),
    slope=Param("s/m", 0.0, "slope"),
):
    """Straight line."""
    return slope * v


@law(y=Output("1", "value"))
def dry_map(v=Input("m/s", "place")):
    """Dry surface of Table 1 as a static map."""
    return freight.adhesion.expr({}, {"v_s": v}, dict(freight.adhesion.param_values()))[1]["mu"]


def _sought(seek: Block, map_: Block, seconds: float, **params: float) -> np.ndarray:
    """Places that a seeker tries on a static map, tick by tick."""
    wires = {"map.v": "seek.v", "seek.y": "map.y"}
    loop = connect("loop", wires, seek=seek, map=map_.with_params(**params) if params else map_)
    return np.asarray(simulate(loop, Scenario("map", seconds), log=["seek.v"])["seek.v"].values)


def theory(context: Context) -> Table:
    """Ripple and averaged rate of the sliding mode against their formulas, on static maps."""
    rows: list[tuple[str, float, float, float, float, float]] = []
    peak, _ = best(freight.adhesion, "dry")
    for k, rho, beta in ((1.0, 1.0, 0.1), (1.0, 1.0, 0.2), (1.0, 0.1, 0.02), (2.0, 0.5, 0.05)):
        v = _sought(sliding_seek(H, k=k, rho=rho, beta=beta, start=peak), dry_map, 30 * rho / k**2)
        told = bounds.ripple(k, beta, rho)
        rows.append(
            ("ripple at the peak [m/s]", k, rho, beta, told, float(np.ptp(v[v.size // 2 :])))
        )
    for slope in (0.1, 0.3, 0.6):
        v = _sought(sliding_seek(H, k=1.0, rho=1.0, beta=0.05), slope_map, 20.0, slope=slope)
        told = bounds.averaged_rate(1.0, 1.0, slope)
        rows.append((f"rate at slope {slope:g} s/m [m/s^2]", 1.0, 1.0, 0.05, told, v[-1] / 20.0))
    for slope in (0.2, 0.6):
        v = _sought(sliding_seek(H, k=1.0, rho=0.1, beta=0.02), slope_map, 20.0, slope=slope)
        told = bounds.averaged_rate(1.0, 0.1, slope)
        moved = (v[-1] - v[v.size // 5]) / 16.0
        rows.append((f"rate at slope {slope:g} s/m, sliding [m/s^2]", 1.0, 0.1, 0.02, told, moved))
    columns = list(zip(*rows, strict=True))
    error = [100 * (b / a - 1) for *_, a, b in rows]
    return Table(
        "Sliding mode on static maps: formula against measurement",
        {
            "what": ("", columns[0]),
            "k": ("m/s^2", columns[1]),
            "rho": ("1/s", columns[2]),
            "beta": ("1", columns[3]),
            "formula": ("", columns[4]),
            "measured": ("", columns[5]),
            "difference": ("%", error),
        },
        "Ripple k beta/rho on the dry surface from its peak; rate k^2 mu'/rho where it does not"
        " slide, rho/mu' where it does.",
    )


def told(context: Context) -> Table:
    """What each seeker says of itself before it runs, beside what the loop does."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("loop", "rail", "regime", "ripple", "measured", "rate", "tau", "notes")
    }
    for seek in SEEKERS:
        loop, where = context.loop("base", f"{seek}_robust")
        log = log_of(loop, where, context.compile)
        steep = steepest(loop, where)
        for rail, span in sections(where)[1:]:
            p = context.models["adh"].conditions[rail]
            curvature = float(freight.peak_curvature(**p))
            says = seek_limits(
                loop["ctl.seek"], steepest=steep or 0.66, curvature=curvature
            )  # fmt: skip
            tried = log["ctl.seek.v"].values[span][-round(1.0 / H) :]
            rows["loop"].append(f"{seek}_robust")
            rows["rail"].append(rail)
            rows["regime"].append(says.regime)
            rows["ripple"].append(says.ripple)
            rows["measured"].append(float(np.ptp(tried)))
            rows["rate"].append(None if np.isnan(says.rate) else says.rate)
            rows["tau"].append(says.time_constant)
            rows["notes"].append(says.notes)
    return Table(
        "What each seeker tells before it runs",
        {
            "loop": ("", rows["loop"]),
            "rail": ("", rows["rail"]),
            "regime": ("", rows["regime"]),
            "ultimate ripple, told": ("m/s", rows["ripple"]),
            "ripple of the last second": ("m/s", rows["measured"]),
            "rate at the steepest slope, told": ("m/s^2", rows["rate"]),
            "time constant at the peak, told": ("s", rows["tau"]),
            "in words": ("", rows["notes"]),
        },
        "From the seeker's parameters and the rail's curve alone.",
    )


def printed(context: Context) -> Table:
    """Each printed form that fails, in the loop where it fails, beside ours."""
    rows: list[tuple[str, str, float | None, float | None, str]] = []

    def row(item: str, what: str, ours: Any, theirs: Any, unit: str) -> None:
        rows.append((item, what, theirs, ours, unit))

    dry = freight.SURFACES["dry"]
    as_printed = freight.PRINTED
    for name in ("dry", "wet"):
        row("Table 1", f"peak adhesion, {name}",
            float(freight.peak_height(**freight.SURFACES[name])),
            float(freight.peak_height(**as_printed[f"{name}_printed"])), "1")  # fmt: skip
    row("section 4.2", "rho/k, beside the steepest slope on dry",
        float(freight.steepest_slope(**dry)), 1.0, "s/m")  # fmt: skip
    fired = []
    for seek in (locking_seek(H), locking_seek(H, k=1.0, rho=1.0, beta=0.1, reach=0.5, wait=H)):
        loop, where = seeking(context.models["adh"], seek), context.loop("base", "smes_robust")[1]
        log = log_of(loop, where.but(duration=6.0), context.compile)
        k = int(np.argmax(log["ctl.seek.mode"].values == LOCK))
        fired.append((k * H, float(log["plant.adh.mu"].values[k])))
    height = best(context.models["adh"], "dry")[1]
    row("threshold", "time of the switch", fired[0][0], fired[1][0], "s")
    row("threshold", "adhesion at the switch, of the peak",
        100 * fired[0][1] / height, 100 * fired[1][1] / height, "%")  # fmt: skip
    for gains in ((-40.0, -40.0), (40.0, -40.0)):
        A = np.array([[-gains[0], -1 / 40.0], [-gains[1], 0.0]])
        slow = float(np.linalg.eigvals(A).real.max())
        row(
            "Table 2",
            f"pole of the observer, gains {gains[0]:g}, {gains[1]:g}",
            -400.0,
            slow,
            "1/s",
        )
    columns = list(zip(*rows, strict=True))
    return Table(
        "Printed forms that fail",
        {
            "item": ("", columns[0]),
            "what": ("", columns[1]),
            "printed form": ("", columns[2]),
            "ours": ("", columns[3]),
            "unit": ("", columns[4]),
        },
        "The story of each is in docs/errata.md; the printed control law is in the table Escape.",
    )


def dither(context: Context) -> Table:
    """Perturbation seeking at the end of the dry section, over what the paper does not print."""
    loop, where = context.loop("base", "esa_robust")
    scenario = where.but(duration=10.0)
    tried = (10.0, 20.0) if context.quick else (1.0, 5.0, 10.0, 20.0, 40.0, 80.0)
    place, _ = best(context.models["adh"], "dry")
    rows: dict[str, list[Any]] = {k: [] for k in ("gain", "a", "middle", "torque")}
    grid = [(k, a) for k in tried for a in (0.05, 0.1, 0.2)]
    for count, (k, a) in enumerate(grid):
        made = loop.with_params(**{"ctl.seek.k": k, "ctl.seek.a": a})
        log = simulate(
            made, scenario, compile=context.compile, log=["ctl.seek.v", "plant.motor.T_m"], every=10
        )
        last = log["time"].values >= 9.0
        rows["gain"].append(k)
        rows["a"].append(a)
        rows["middle"].append(periods.mean(log["ctl.seek.v"].values[last]) / place)
        rows["torque"].append(periods.mean(log["plant.motor.T_m"].values[last]))
        context.progress((count + 1) / len(grid))
    return Table(
        "esa_robust over the last second before 10 s, dry rail",
        {
            "gain": ("m/s^2", rows["gain"]),
            "dither": ("m/s", rows["a"]),
            "middle of the dither, of the best creep": ("1", rows["middle"]),
            "mean torque": ("N m", rows["torque"]),
        },
        "The paper prints neither gain nor dither. Means over whole periods.",
    )


def regret(context: Context) -> Table:
    """Every loop against the optimal control bound: the longest distance in its time."""
    law = context.models["adh"]
    lagging = freight.motor(lag=True).with_params(tau=LAG)
    plants = {"base": freight.plant(law), "moving_optimum": freight.plant(law)}
    plants["real"] = freight.plant(law, lagging)
    endings = ("robust",) if context.quick else FORMS
    loops = [f"{s}_{ending}" for s in SEEKERS for ending in endings]
    return against_optimum(
        context, dict.fromkeys(plants, loops), plants, "plant.motor.T_m", (-12e3, 12e3),
        {"train.v_s": (-0.5, 4.0)}, body=("train.x", "train.v_t"), farthest=True, every=10,
    )  # fmt: skip


EXPERIMENTS = {
    "regret": Experiment("Regret", regret, "How far is each loop from what is possible?"),
    "reached": Experiment(
        "Seeking", reached, "When does each seeker lock, how still does it hold?"
    ),
    "seeds": Experiment("Many seeds", seeds, "Does noise make false locks?"),
    "reopen": Experiment("Locks off the peak", reopen, "Does a false lock open?"),
    "theory": Experiment("Formulas", theory, "Do ripple and rate follow their formulas?"),
    "dither": Experiment("Dither", dither, "What do the numbers that are not printed decide?"),
    "told": Experiment("Told before", told, "What does a seeker say of itself?"),
    **barrier.EXPERIMENTS,
    "printed": Experiment("Printed forms", printed, "What does each misprint do?"),
}
