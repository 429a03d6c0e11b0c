"""Experiments of the study ``gain_bounds``: what the papers' gains are worth, in tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from slipctl import Block, Context, Experiment, Table, simulate
from slipctl.analysis.bounds import fastest, largest_slope
from slipctl.certify import catalogue, systems
from slipctl.commands.certificates.certify import needs
from slipctl.models.cheng_2022.freight_traction import SURFACES, adhesion
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.models.wang_2025.hst_traction_control import higher_order
from slipctl.models.zhang_2021.hst_braking import RAILS, burckhardt, peak_slip
from slipctl.studies.freight_traction import gains as freight_traction_gains
from slipctl.studies.freight_traction import loops as freight_traction_loops
from slipctl.studies.gain_bounds import runs as gain_bounds_runs
from slipctl.studies.hst_braking import gains as hst_braking_gains
from slipctl.studies.hst_braking import loops as hst_braking_loops
from slipctl.studies.hst_traction import gains as hst_traction_gains
from slipctl.studies.hst_traction import loops as hst_traction_loops
from slipctl.studies.subway_braking import gains as subway_braking_gains
from slipctl.studies.subway_braking import loops as subway_braking_loops

Found = Callable[[str], Block]
"""Loop of a study by its name, the first that has it, or by ``name@scenario``."""


def _of(loops: Any) -> Found:
    """Loops of a study, each made when it is asked for."""
    places = {}
    for case in loops.cases(loops.MODELS, True):
        for name in case.loops:
            places.setdefault(name, case)
            places[f"{name}@{case.scenario.name}"] = case
    return lambda name: places[name].loops[name.partition("@")[0]]


def _traction() -> Found:
    """Loops of hst_traction that are asked about; the others take long to build."""
    models, make = hst_traction_loops.MODELS, hst_traction_loops.loop
    made = {
        "hosm_limited": models["hosm"],
        "hosm_limited_printed@stress": higher_order("printed"),
    }
    return lambda name: make(models, made[name])


PAPERS: dict[str, tuple[Any, Callable[[], Found]]] = {
    "subway_braking": (subway_braking_gains, lambda: _of(subway_braking_loops)),
    "hst_braking": (hst_braking_gains, lambda: _of(hst_braking_loops)),
    "hst_traction": (hst_traction_gains, _traction),
    "freight_traction": (freight_traction_gains, lambda: _of(freight_traction_loops)),
}
"""What each paper's study asks of its gains, and its loops."""


def papers(context: Context) -> Table:
    """Every controller of the four studies: verdict, the paper's own condition, what it needs."""

    def asked(study: str) -> list[list[Any]]:
        gains, loops = PAPERS[study]
        found, rows = loops(), []
        for g in gains.GAINS:
            report = systems.report(catalogue.system(g.system), g.numbers(found(g.loop)))
            own = report.criteria.get(g.condition)
            said = "" if own is None else "holds" if own.holds else "violated"
            unit = None if own is None else own.unit_dependent
            rows.append([study, g.name, g.system, report.verdict, said, unit, needs(report)])
        return rows

    rows = [row for part in context.each("studies", list(PAPERS), asked) for row in part]
    columns = [list(column) for column in zip(*rows, strict=True)]
    return Table(
        "Gains as the studies use them",
        {
            "study": ("", columns[0]), "gains": ("", columns[1]),
            "certified as": ("", columns[2]), "verdict": ("", columns[3]),
            "the paper's own condition": ("", columns[4]),
            "it depends on the unit": ("", columns[5]), "what it needs": ("", columns[6]),
        },
        "slipctl certify STUDY tells the numbers and where the bounds come from.",
    )  # fmt: skip


def units(context: Context) -> Table:
    """Which criteria change their verdict when the state is told in thousandths."""
    rows: list[tuple[str, str, str, bool]] = []
    for system in catalogue.SYSTEMS.values():
        for name, criterion in system.criteria.items():
            changed = systems.unit_dependent(system, name)
            rows.append((system.name, name, criterion.kind, changed))
    columns = list(zip(*rows, strict=True))
    return Table(
        "Test of meaning: the state told in thousandths of its unit, and in thousands",
        {
            "system": ("", columns[0]), "criterion": ("", columns[1]), "kind": ("", columns[2]),
            "verdict changes": ("", columns[3]),
        },
        "A criterion whose verdict changes compares numbers of different units.",
    )  # fmt: skip


def model_bounds(context: Context) -> Table:
    """Slopes that the bounds use, by intervals and by a grid, and what a run shows."""
    dry, best = double_exponential.conditions["dry"], float(peak_slip(**RAILS["dry"]))
    asked = {
        "subway, |mu'| of dry rail, 0 to 10 m/s": (
            double_exponential, "v_s", (0.0, 10.0), dry, "s/m"),
        "subway, |mu'| of dry rail, 1.16 to 1.26 m/s": (
            double_exponential, "v_s", (1.16, 1.26), dry, "s/m"),
        "hst_braking, |mu'| of dry rail, 0 to 0.4": (
            burckhardt, "lam", (0.0, 0.4), RAILS["dry"], "1"),
        "hst_braking, |mu'| of dry rail in the funnel": (
            burckhardt, "lam", (best - 0.006, best + 0.006), RAILS["dry"], "1"),
        "freight, |mu'| of dry rail, 0 to 3 m/s": (
            adhesion, "v_s", (1e-9, 3.0), SURFACES["dry"], "s/m"),
    }  # fmt: skip
    rows: dict[str, list[Any]] = {k: [] for k in ("what", "unit", "interval", "grid", "seen")}
    for what, (law, by, span, at, unit) in asked.items():
        interval = largest_slope(law, "mu", by, {by: span}, **at)
        grid = largest_slope(law, "mu", by, {by: span}, "grid", **at)
        values = (what, unit, interval.value, grid.value, interval.reached)
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    loop, scenario = context.loop("base", "sta")
    log = simulate(loop, scenario, compile=context.compile)
    rate = fastest(log["time"].values, log["plant.wheel.v_s"].values, (0.0,), 0.2)
    seen = fastest(log["time"].values, log["plant.adh.mu"].values, (0.0,), 0.2)
    for what, unit, found in (
        ("subway, |v_s'| of sta after 0.2 s", "m/s^2", rate),
        ("subway, |mu'| per time of sta after 0.2 s", "1/s", seen),
    ):
        for key, value in zip(rows, (what, unit, None, None, found.value), strict=True):
            rows[key].append(value)
    return Table(
        "Bounds from the model (exact Jacobians) and from a run",
        {
            "what": ("", rows["what"]), "unit of the bound": ("", rows["unit"]),
            "interval bound": ("", rows["interval"]),
            "grid with Lipschitz remainder": ("", rows["grid"]), "reached": ("", rows["seen"]),
        },
        "Interval and grid bounds are proven; what a run shows is not.",
    )  # fmt: skip


def lyapunov(context: Context) -> Table:
    """Whether each proof's function falls along a disturbed run where the proof says so."""
    found = gain_bounds_runs.runs(context.quick)
    loop, scenario = context.loop("base", "sta")
    log = simulate(loop, scenario, compile=context.compile)
    own = [r.deviation() for r in found]
    found.append(gain_bounds_runs.in_the_loop(log))
    return Table(
        "Lyapunov functions along runs with disturbances within the bound",
        {
            "system": ("", [r.name for r in found]), "proof": ("", [r.source for r in found]),
            "claim": ("", [r.says for r in found]),
            "samples where it claims": ("1", [int(r.where.sum()) for r in found]),
            "V falls there": ("%", [100 * r.falls() for r in found]),
            "V' against the slope of V": ("1", [*own, None]),
        },
        "The last column is the largest difference of V' by the chain rule and the slope of V"
        " between two samples, over the largest V'. In the loop V' is that slope.",
    )  # fmt: skip


PHI = 3.0
"""Constant part of the matched disturbance in m/s^2; sin t is added, so that L = 1 m/s^3."""


def amplitudes(context: Context) -> dict[str, Table]:
    """Sliding error of three discretisations, and how it falls with the period."""
    periods = (0.1, 0.03, 0.01, 0.003, 0.001)
    forms = ("explicit", "implicit", "proper implicit")

    def integral(t: float) -> float:
        return PHI * t - math.cos(t)

    seen = {
        f: [gain_bounds_runs.sampled_twisting(f, T, integral, ticks=6000) for T in periods]
        for f in forms
    }
    slopes = {f: float(np.polyfit(np.log(periods), np.log(v), 1)[0]) for f, v in seen.items()}
    rows = Table(
        "Sliding error of super-twisting (1.5, 1.1), disturbance 3 + sin t m/s^2",
        {
            "period": ("s", list(periods)),
            **{f: ("m/s", seen[f]) for f in forms},
            "offset of implicit, T phi": ("m/s", [
                super_twisting.implicit_offset(PHI + 1, T) for T in periods]),
            "bound of proper implicit, L T^2": ("m/s", [
                super_twisting.proper_implicit_amplitude(1.0, T) for T in periods]),
        },
        "6000 ticks each, the last third. The implicit form is exact on its model, which has no"
        " disturbance, and leaves an offset of first order.",
    )  # fmt: skip
    order = Table(
        "Order of the sliding error in the period",
        {"form": ("", list(forms)), "order": ("1", [slopes[f] for f in forms])},
    )
    return {"error": rows, "order": order}


EXPERIMENTS = {
    "papers": Experiment("Gains of the four papers", papers,
                         "Which gains satisfy the paper's own condition, and which suffice?"),
    "units": Experiment("Test of meaning", units, "Does a verdict depend on the unit?"),
    "model_bounds": Experiment("Bounds from the model", model_bounds),
    "lyapunov": Experiment("Lyapunov functions along runs", lyapunov),
    "amplitudes": Experiment("Sampled super-twisting", amplitudes),
}  # fmt: skip
