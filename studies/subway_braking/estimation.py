"""What claims on the estimator and the search ask: printed form, errors, operations, seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Context, Table, differential_evolution, prepare, rls
from slipctl.run.metrics import settling_time
from slipctl.run.results import NotRun
from slipctl.studies.subway_braking.loops import TABLE_1, H

BUS = 16
"""Ticks from one sample of the speed bus to the next."""

NEAR = 0.05
"""Share of the best slip within which an optimum counts as found."""

SEEDS = 10


def rails(log: Any, length: float = 2.0) -> list[slice]:
    """Ticks of each rail."""
    n = round(length / H)
    return [slice(k * n, (k + 1) * n) for k in range(len(log["time"]) // n)]


def printed_estimate(log: Any, law: Block) -> float | None:
    """Best slip in m/s by (15)-(19) as printed, fed with the first rail of a run; None without."""
    if set(law.params) != {"c", "a", "b"}:
        raise NotRun(f"{law.name} is not the law of (4)")
    estimator = rls(law, form="printed-16")
    first = rails(log)[0]
    slip, mu = (log[n].values[first][::BUS] for n in ("plant.wheel.v_s", "plant.adh.mu"))
    x: dict[str, Any] = estimator.start()
    y: dict[str, Any] = {}
    for v, m in zip(slip, mu, strict=True):
        x, y = estimator(v_s=float(v), mu=float(m), **x)
    c, a, b = (float(y[n]) for n in ("c", "a", "b"))
    return math.log(b / a) / (b - a) if 0 < a != b > 0 and c > 0 else None


def curve(law: Block, slip: np.ndarray, rail: Mapping[str, float]) -> np.ndarray:
    """Adhesion over slip speeds in m/s on a rail given by the law's parameters.

    They may be an estimate that ran away, beyond what the law takes.
    """
    p = np.array(ca.DM(law.pack("param", law.derive(dict(rail)))).full())
    u = ca.DM(slip).T
    return np.array(ca.DM(law.f.map(len(slip))(ca.DM(0, len(slip)), u, p)[1]).full()).ravel()


def curve_errors(log: Any, law: Block) -> tuple[list[float], list[float]]:
    """Rms error of the curve estimated at the end of each rail: up to the best slip, and beyond."""
    low, high = [], []
    for s, name in zip(rails(log), TABLE_1, strict=True):
        best = float(log["v_opt"].values[s.start])
        end = {n: float(log[f"ctl.estimator.{n}"].values[s.stop - 1]) for n in law.params}
        for errors, span in ((low, (0.0, best)), (high, (best, 8.0))):
            v = np.linspace(*span, 200)
            off = curve(law, v, end) - curve(law, v, law.conditions[name])
            errors.append(float(np.sqrt(np.mean(np.square(off)))))
    return low, high


def operations(law: Block, condition: str = "dry") -> tuple[dict[str, float], str]:
    """Elementary operations of one search by evolution and by Newton, and the same in words."""
    search = differential_evolution(law, over="v_s", maximise="mu", lo=0.01, hi=10.0)
    choices = search.choices
    evaluations = int(choices["population"]) * int(choices["generations"])
    v, names = ca.SX.sym("v"), [n for n in law.params if not law.params[n].derived]
    p = ca.SX.sym("p", len(names))
    free = {n: p[k] for k, n in enumerate(names)}
    mu = law.expr({}, {"v_s": v}, law.derive(free))[1]["mu"]
    slope = ca.gradient(mu, v)
    one = ca.Function("mu", [v, p], [mu])
    step = ca.Function("step", [v, p], [v - slope / ca.gradient(slope, v), slope], {"cse": True})
    there = law.with_params(**law.conditions[condition]).param_values()
    x, at, count = 0.01, [float(there[n]) for n in names], 0
    while count < 100:
        new, _ = (float(y) for y in step(x, at))
        count += 1
        if abs(new - x) < 1e-6:
            break
        x = new
    cost = {"de": float(evaluations * one.n_instructions()),
            "newton": float(count * step.n_instructions())}  # fmt: skip
    text = f"{evaluations} evaluations of the curve against {count} steps of Newton"
    return cost, text


def stationary_points(law: Block, condition: str = "dry") -> int:
    """How often the slope of the curve changes its sign between 0.01 and 10 m/s."""
    v = ca.SX.sym("v")
    there = law.with_params(**law.conditions[condition]).param_values()
    slope = ca.gradient(
        law.expr({}, {"v_s": v}, {n: ca.DM(p) for n, p in there.items()})[1]["mu"], v
    )
    values = np.array(ca.Function("s", [v], [slope])(np.linspace(0.01, 10, 5000).reshape(1, -1)))
    return int(np.count_nonzero(np.diff(np.sign(values.ravel()))))


def held(context: Context) -> Table:
    """Loop with the online optimum behind lag and real sensors: is the optimum found and held?"""
    loop, scenario = context.loop("real", "sta_online")
    run = prepare(loop, scenario, compile=context.compile)

    def outcome(seed: int) -> dict[str, list[bool]]:
        """Whether it is found and held on each rail."""
        log = run(seed=seed).dataset()
        time, true = log["time"].values, log["v_opt"].values
        off = {n: log[n].values / true - 1 for n in ("ctl.search.best", "plant.wheel.v_s")}
        row: dict[str, list[bool]] = {k: [] for k in ("half", "end", "slip")}
        for s in rails(log):
            span = (s.start * H, s.stop * H, NEAR)
            best, slip = (settling_time(time, e, *span) for e in off.values())
            row["half"].append(best is not None and best <= 0.5)
            row["end"].append(bool(abs(off["ctl.search.best"][s.stop - 1]) < NEAR))
            row["slip"].append(slip is not None and slip <= 0.5)
        return row

    rows = context.each("seeds", range(1, SEEDS + 1), outcome)
    found = {k: [row[k] for row in rows] for k in ("half", "end", "slip")}
    share = {k: 100 * np.mean(v, axis=0) for k, v in found.items()}
    return Table(
        "Online optimum with 50 ms of lag and real sensors",
        {
            "rail": ("", list(TABLE_1)),
            "seeds": ("1", [SEEDS] * len(TABLE_1)),
            "optimum within 5 % for good after 0.5 s": ("%", [float(x) for x in share["half"]]),
            "optimum within 5 % at the end of the rail": ("%", [float(x) for x in share["end"]]),
            "slip within 5 % for good after 0.5 s": ("%", [float(x) for x in share["slip"]]),
        },
        "Share of the seeds; all against the true best slip.",
    )


def held_in_words(table: Table) -> str:
    """Which share of the seeds ends near the optimum, by rail."""
    column = "optimum within 5 % at the end of the rail"
    parts = [f"{n} {x:.0f} %" for n, x in zip(table["rail"], table[column], strict=True)]
    return f"of {table['seeds'][0]} seeds the estimated optimum ends within 5 %: {', '.join(parts)}"
