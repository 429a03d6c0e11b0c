"""Speed tracking of ``hst_traction`` beside the best that adhesion and power allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slipctl import Context, Experiment, Table, simulate
from slipctl.models.wang_2025.hst_traction import resistance, tractive_effort
from slipctl.models.wheel_rail.contact import peak, polach
from slipctl.studies.hst_traction.loops import DURATION, NAMES, RAIL, ROW, Target, target

M, PER_AXLE, DRIVEN, G = 500e3, 15625.0, 10, 9.8

KAPPA = {"base": 0.5, "stress": 0.85}
"""Share of the tractive effort that the target of a scenario needs."""


def smallest_error(
    wanted: Target, surfaces: Sequence[tuple[float, str, Mapping[str, float]]], start: float,
    length: float, mass: float = 1.0, dt: float = 0.01,
) -> float:  # fmt: skip
    """Smallest rms speed error in m/s of a train whose adhesion is at its peak when it needs it.

    The target is followed as far as force and adhesion go, at once and without lag. While the train
    is behind, no control is faster, so no error is smaller at any time.

    Args:
        wanted: target.
        surfaces: start in s from ``start`` on, name and parameters of each.
        start, length: part of the run in s.
        mass: factor on the mass. dt: step in s.
    """
    t = np.arange(round(length / dt)) * dt
    v_d = np.interp(t + start, wanted.t, wanted.v)
    low, high = max(v_d.min() - 5, 0.1), v_d.max() + 5
    grid = np.linspace(low, high, max(9, round((high - low) / 3)))
    best = {n: np.array([peak(float(v), dict(p)).value for v in grid]) for _, n, p in surfaces}
    weight, drag = mass * M, resistance.with_params(m=mass * M)
    F_d = np.array([float(drag(v=float(v))["F_d"]) for v in grid])
    v, errors = float(v_d[0]), []
    for k, time in enumerate(t):
        errors.append(v - v_d[k])
        name = [n for begin, n, _ in surfaces if begin <= time + 1e-9][-1]
        carried = float(np.interp(v, grid, best[name])) * mass * PER_AXLE * G * DRIVEN
        most = min(carried, float(tractive_effort(v)))
        following = v_d[min(k + 1, len(t) - 1)]
        v = min(following, v + dt * (most - float(np.interp(v, grid, F_d))) / weight)
    return float(np.sqrt(np.mean(np.square(errors))))


def regret(context: Context) -> Table:
    """Rms speed error of every loop above a bound that no loop can beat."""
    rows: dict[str, list[Any]] = {k: [] for k in ("scenario", "loop", "error", "bound", "above")}
    cases = {c.scenario.name: c for c in context.cases}
    for k, name in enumerate(n for n in KAPPA if n in cases):
        length = cases[name].scenario.duration
        start = 0.0 if length == DURATION else 105.0  # quick, a part around the ice
        parts = [(max(a - start, 0.0), n, polach.conditions[n]) for n, a in RAIL]
        ahead = [i for i, (a, _, _) in enumerate(parts) if a == 0.0]
        bound = smallest_error(target(KAPPA[name]), parts[ahead[-1] :], start, length, dt=0.05)
        wanted = [ending for n in NAMES for ending in (n, f"{n}_limited")]
        for loop in [n for n in wanted if n in cases[name].loops]:
            block, scenario = context.loop(name, loop)
            log = simulate(
                block, scenario, compile=context.compile, log=("v_d", "plant.train.v"), every=ROW
            )
            error = log["plant.train.v"].values - log["v_d"].values
            rms = float(np.sqrt(np.mean(np.square(error))))
            for key, value in zip(rows, (name, loop, rms, bound, rms - bound), strict=True):
                rows[key].append(value)
        context.progress((k + 1) / len(KAPPA))
    return Table(
        "Speed tracking against the relaxed bound",
        {
            "scenario": ("", rows["scenario"]),
            "loop": ("", rows["loop"]),
            "rms speed error": ("m/s", rows["error"]),
            "bound": ("m/s", rows["bound"]),
            "above the bound": ("m/s", rows["above"]),
        },
        "Bound: adhesion at its peak whenever it is needed, forces at once. Predictive control on"
        " the same train is in the study all_rails.",
    )


EXPERIMENTS = {
    "regret": Experiment("Speed tracking", regret, "How far is each loop from what is possible?")
}
