"""Every law at its best: tuned by one tuner, with one budget, on one ensemble, judged on others.

Two numbers of each law are free, from a quarter of the hand-set ones to four times them. The
ensemble is that of the vehicle on its first rail. What the tuner found is judged on draws that it
has not seen, on that rail and on the other one, which it never ran on. Then mass, adhesion and lag
leave the ensemble one by one, and the law runs at longer sample times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slipctl import BadInput, Block, Context, Ensemble, RunFailed, Scenario, Signals, Table
from slipctl.certify import catalogue
from slipctl.certify.systems import report
from slipctl.design.gain_search import HELD_OUT
from slipctl.design.tune import tune
from slipctl.models.cheng_2022.certificate import barrier
from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.models.wang_2025.certificate import higher_order
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.run.sweep.ensemble import Draw, World
from slipctl.studies.all_rails.loops import NAMES, VEHICLES, H, Vehicle, loops, scenario
from slipctl.study.report.texts import number

FREE: dict[str, tuple[str, str]] = {
    "pid": ("law.law.K", "law.reference.up"),
    "smc": ("law.law.g1", "law.law.g2"),
    "sta": ("law.law.k1", "law.law.k2"),
    "efc": ("law.law.K", "law.reference.up"),
    "eppfc": ("law.law.K1", "law.reference.up"),
    "eppfc_barrier": ("law.law.K1", "law.reference.up"),
    "barrier": ("law.barrier.q", "law.reference.w_r"),
    "hosm": ("law.law.k_1", "law.law.k_4"),
    "nmpc": ("law.nmpc.weight_slip", "law.smoothed.tau_s"),
}
"""What is free of each law; two numbers each, so that a budget is worth the same."""

SPAN = 4.0
"""Factor to either side of the hand-set number."""

SAMPLES, RUNS, JUDGED, SEED = 12, 320, 24, 1
"""Draws of the search, its runs, draws of the judgement on each rail, seed of all of it."""

SWEPT = {
    "mass": (0.7, 0.85, 1.0, 1.15, 1.3),
    "adhesion": (0.5, 0.75, 1.0, 1.25),
    "lag": (0.5, 1.0, 2.0, 3.0),
    "sample time": (1, 2, 4, 8),
}
"""Factors on what the controller knows; the ensemble ends at 0.9 to 1.1, 0.8 to 1.1, 0.7 to 1.4.
The sample time is that of law and limits; sensors and estimators stay at a tick of 1 ms."""

NOISES = (11, 12, 13, 14)
"""Seeds of the noise at each point of a profile."""


def ensemble(v: Vehicle, world: Block) -> Ensemble:
    """Mass, lag, adhesion of all sections, and noise."""
    declared = world.values_by_place()
    draw = {}
    for n in v.masses:
        mass = float(np.asarray(declared[f"world.plant.{n}"]))
        draw[f"world.plant.{n}"] = f"{0.9 * mass!r}:{1.1 * mass!r}"
    draw[f"world.plant.{v.lag}"] = f"{0.7 * v.wheel.tau!r}:{1.4 * v.wheel.tau!r}"
    heights = ", ".join(f"world.plant.adh.{n}" for n in v.heights)
    return Ensemble(draw, {"adhesion": f"0.8:1.1 of {heights}"}, seeds=True)


SIGNALS = Signals(speed="world.v_true", position="world.x_true", torque="world.T")


def certificate(name: str, law: Block, tau: float) -> str:
    """What is proved of a law with its numbers, in continuous time unless it says otherwise."""
    p = {n.rpartition(".")[2]: float(v) for n, v in law.param_values().items() if np.size(v) == 1}
    if name == "sta":
        L = _largest(lambda x: super_twisting.exact(p["k1"], p["k2"], x), p["k2"])
        return f"|d'| <= {L:.4g} m/s^3 (exact)"
    if name == "smc":
        return f"|d| < {p['g2']:.4g} m/s^2"
    if name == "efc":
        found = report(catalogue.system("lagged_loop"), {"K": p["K"], "T": H, "lag": tau})
        return f"lagged loop, as sampled: {found.verdict}"
    if name in ("eppfc", "eppfc_barrier"):
        W = ppc.largest_disturbance(p["K1"], p["eta_inf"], p["delta_l"], p["delta_u"])
        return f"|w| <= {W:.4g} 1/s" if name == "eppfc" else "every bounded w"
    if name == "hosm":
        eta = higher_order.exact_eta(p["k_4"], 2 * p["beta"] * p["k_4"])
        return f"|delta'| <= {eta:.4g} m/s^3 (exact)"
    if name == "barrier":
        rest = barrier.robust_settled(1.0, p["q"], p["k_s"])
        return f"every bounded w; |e| <= {rest:.3g} m/s for |w| <= 1 m/s^2"
    return "no criterion"


def _largest(holds: Any, most: float) -> float:
    """Largest number below ``most`` at which a criterion holds, to 1e-6 of it."""
    low, high = 0.0, most
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def work(context: Context, vehicle: str, name: str) -> dict[str, Any]:
    """Tune a law, and run it where it was not tuned."""
    v, loop = VEHICLES[vehicle], loops(vehicle)[name]
    first, second = v.rails
    now = loop.values_by_place()
    free = {n: _range(float(np.asarray(now[n])), loop, n) for n in FREE[name]}
    drawn = ensemble(v, loop)
    sign = -1.0 if v.driven else 1.0
    rails = {r: scenario(vehicle, r).but(params={}) for r in (first, second)}
    options: dict[str, Any] = {"signals": SIGNALS, "seed": SEED, "compile": context.compile}
    found = tune(
        loop, free, "-1*distance" if v.driven else "distance", drawn, scenario=rails[first],
        samples=SAMPLES, runs=RUNS, held_out=2, controller="law", jobs=1, **options,
    )  # fmt: skip
    sets = {"tuned": dict(found.gains), "by hand": {n: float(np.asarray(now[n])) for n in free}}
    ways: dict[str, dict[str, list[float | None]]] = {}
    profile: dict[str, list[float | None]] = {}
    for rail, wanted in rails.items():
        world = World(loop, wanted, drawn, free=list(free), **options)
        world.wanted = ("distance",)
        draws = [world.draw(HELD_OUT, k) for k in range(JUDGED)]
        ways[rail] = {
            which: [_way(world, numbers, d, sign) for d in draws] for which, numbers in sets.items()
        }
        if rail == first:
            profile = _profile(world, sets["tuned"], sign, v)
            profile["sample time"] = _slowed(vehicle, name, wanted, sets["tuned"], sign, options)
    return {
        "gains": sets["tuned"], "runs": found.search.spent, "candidates": found.search.thought,
        "gradient": found.polished.text() if found.polished else "",
        "certificate": certificate(name, found.tuned_loop()["law"], v.wheel.tau),
        "ways": ways, "profile": profile,
    }  # fmt: skip


def _range(now: float, loop: Block, name: str) -> tuple[float, float]:
    declared = loop.declared(name)
    lo, hi = (e if isinstance(e, (int, float)) else math.inf for e in (declared.lo, declared.hi))
    return max(now / SPAN, float(lo) if math.isfinite(lo) else 0.0), min(now * SPAN, float(hi))


def _way(world: World, numbers: Mapping[str, float], draw: Draw, sign: float) -> float | None:
    """Distance in m, the shorter the better; None where the run fails."""
    try:
        return sign * float(world.metrics(numbers, draw)["distance"].value)  # type: ignore[arg-type]
    except (BadInput, RunFailed):
        return None


def _profile(
    world: World, numbers: Mapping[str, float], sign: float, v: Vehicle
) -> dict[str, list[float | None]]:
    """Mean distance at each point, what is not swept as the controller knows it."""
    now = world.loop.values_by_place()
    nominal = {a.name: float(np.asarray(now[a.name])) for a in world.axes}
    lag = f"world.plant.{v.lag}"
    found: dict[str, list[float | None]] = {}
    for what, factors in SWEPT.items():
        if what == "sample time":
            continue
        found[what] = []
        for by in factors:
            drawn = {
                n: x * (by if what == ("lag" if n == lag else "mass") else 1.0)
                for n, x in (nominal | {lag: v.wheel.tau}).items()
            } | {"adhesion": by if what == "adhesion" else 1.0}  # fmt: skip
            found[what].append(_mean(world, numbers, drawn, sign))
    return found


def _slowed(
    vehicle: str, name: str, wanted: Scenario, numbers: Mapping[str, float], sign: float,
    options: Mapping[str, Any],
) -> list[float | None]:  # fmt: skip
    """The same at each sample time of the law."""
    v, found = VEHICLES[vehicle], []
    for ticks in SWEPT.get("sample time", ()):
        loop = loops(vehicle, int(ticks), (name,))[name]
        world = World(loop, wanted, ensemble(v, loop), free=list(numbers), **options)
        world.wanted = ("distance",)
        now = world.loop.values_by_place()
        nominal = {a.name: float(np.asarray(now[a.name])) for a in world.axes}
        nominal |= {f"world.plant.{v.lag}": v.wheel.tau, "adhesion": 1.0}
        found.append(_mean(world, numbers, nominal, sign))
    return found


def _mean(
    world: World, numbers: Mapping[str, float], drawn: Mapping[str, float], sign: float
) -> float | None:
    """Mean distance over the seeds of the noise; None where a run fails."""
    ways = [_way(world, numbers, world.at(drawn, seed), sign) for seed in NOISES]
    return None if None in ways else float(np.mean(ways))  # type: ignore[arg-type]


# ---- tables --------------------------------------------------------------------------------------


def fair(context: Context) -> dict[str, Table]:
    """Tune every law on every vehicle, and compare them where they were not tuned."""
    vehicles = list(dict.fromkeys(c.scenario.name.split("_", 1)[0] for c in context.cases))
    pairs = [(v, n) for v in vehicles for n in NAMES if n in FREE]
    outcomes = context.each("fair", pairs, lambda pair: work(context, *pair))
    found = dict(zip(pairs, outcomes, strict=True))
    budget = (
        f"A search of {RUNS} runs for each law, and to the end of its generation, on {SAMPLES}"
        f" draws of the first rail; {JUDGED}"
        " fresh draws of each rail judge. Ranges: a quarter of the hand-set number to four times"
        " it. Mass 0.9 to 1.1, adhesion 0.8 to 1.1, lag 0.7 to 1.4 of what is known, and noise."
    )
    return {
        "gains": gains(found, budget), "judged": judged(found, budget), "profile": profiles(found)
    }  # fmt: skip


def gains(found: Mapping[tuple[str, str], Any], doc: str) -> Table:
    """What was found of each law, what is proved of it, and what it cost."""
    columns: dict[str, tuple[str, list[Any]]] = {
        "vehicle": ("", []), "loop": ("", []), "gains": ("", []), "certificate": ("", []),
        "runs": ("1", []), "candidates": ("1", []),
    }  # fmt: skip
    for (vehicle, name), its in found.items():
        told = ", ".join(f"{n.rpartition('.')[2]} = {number(x)}" for n, x in its["gains"].items())
        row = (vehicle, name, told, its["certificate"], its["runs"], its["candidates"])
        for (_, values), value in zip(columns.values(), row, strict=True):
            values.append(value)
    return Table("Tuned alike: gains, what is proved of them, budget", columns, doc)


def judged(found: Mapping[tuple[str, str], Any], doc: str) -> Table:
    """How far each law is behind the best one of its rail, on held-out draws."""
    columns: dict[str, tuple[str, list[Any]]] = {
        "vehicle": ("", []), "rail": ("", []), "seen by the tuner": ("", []), "loop": ("", []),
        "behind the best": ("m", []), "standard error": ("m", []), "gained by tuning": ("m", []),
        "its standard error": ("m", []), "failed runs": ("1", []),
    }  # fmt: skip
    for vehicle in dict.fromkeys(v for v, _ in found):
        names = [n for v, n in found if v == vehicle]
        for rail in found[vehicle, names[0]]["ways"]:
            ways = {n: _numbers(found[vehicle, n]["ways"][rail]["tuned"]) for n in names}
            least = min(names, key=lambda n: float(np.mean(ways[n])))
            for n in names:
                hand = _numbers(found[vehicle, n]["ways"][rail]["by hand"])
                behind, error = _paired(ways[n], ways[least])
                gain, its = _paired(hand, ways[n])
                row = (vehicle, rail, rail == next(iter(VEHICLES[vehicle].rails)), n, behind,
                       error, gain, its, int(np.isinf(ways[n]).sum()))  # fmt: skip
                for (_, values), value in zip(columns.values(), row, strict=True):
                    values.append(value)
    return Table(
        "Tuned alike: distance lost against the best law of the rail, draw by draw", columns,
        f"{doc} Who is behind by less than two standard errors is not behind.",
    )  # fmt: skip


def profiles(found: Mapping[tuple[str, str], Any]) -> Table:
    """How each tuned law does off its ensemble, against the best one at the same point."""
    names = list(dict.fromkeys(n for _, n in found))
    columns: dict[str, tuple[str, list[Any]]] = {
        "vehicle": ("", []), "swept": ("", []), "factor": ("1", []), **{n: ("m", []) for n in names}
    }  # fmt: skip
    for vehicle in dict.fromkeys(v for v, _ in found):
        for what, factors in SWEPT.items():
            for k, by in enumerate(factors):
                ways = [found[vehicle, n]["profile"][what][k] for n in names]
                least = min((w for w in ways if w is not None), default=0.0)
                row = (vehicle, what, by, *(None if w is None else w - least for w in ways))
                for (_, values), value in zip(columns.values(), row, strict=True):
                    values.append(value)
    return Table(
        "Tuned alike: distance lost against the best law off the ensemble", columns,
        f"First rail, one thing at a time, mean of {len(NOISES)} seeds of the noise.",
    )  # fmt: skip


def _numbers(ways: Sequence[float | None]) -> np.ndarray:
    return np.array([math.inf if w is None else w for w in ways])


def _paired(one: np.ndarray, other: np.ndarray) -> tuple[float | None, float | None]:
    """Mean difference of the draws that both ended, and its standard error."""
    both = np.isfinite(one) & np.isfinite(other)
    d = one[both] - other[both]
    if d.size < 2:
        return None, None
    return float(d.mean()), float(np.std(d, ddof=1) / math.sqrt(d.size))
