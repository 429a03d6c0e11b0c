"""Contact of the study ``hst_traction``: adhesion curves, their peaks, and the fit of a curve."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Context, Experiment, Fitted, Results, Table, fit, registry
from slipctl.draw import plots
from slipctl.models.wang_2025.hst_traction_peaks import peaks
from slipctl.models.wheel_rail import contact
from slipctl.models.wheel_rail.contact import SURFACES, peak, polach

SPEEDS = (1.0, 5.0, 20.0, 40.0, 69.0)
"""Train speeds of the table and of the figures, in m/s."""

FACTOR = 30.0
"""Starts of k_A and k_S lie in 0.3/sqrt(30) .. 0.3 sqrt(30)."""

FAR = 8.0
"""Creep up to which curves are drawn, in m/s."""


def adhesion(law: Block, creep: np.ndarray, v: float, **values: float) -> np.ndarray:
    """Adhesion at each creep in m/s, at the train speed v."""
    p = law.pack("param", law.param_values(**values))
    inputs = np.vstack([creep, np.full_like(creep, v)])
    many = law.f.map(creep.size)(ca.DM(0, creep.size), inputs, ca.repmat(p, 1, creep.size))
    return np.array(many[1].full()).ravel()


def curve(v: float, surface: str, upto: float = FAR) -> tuple[np.ndarray, np.ndarray]:
    """Creep in m/s and adhesion of one surface at the train speed v."""
    creep = np.concatenate([np.linspace(0, 0.2, 41), np.linspace(0.2, upto, 200)[1:]])
    return creep, adhesion(polach, creep, v, **SURFACES[surface])


@cache
def order_changes() -> float:
    """Speed in m/s at which wet and oily rail have the same largest adhesion, by bisection."""
    lo, hi = 1.0, 40.0
    while (middle := (lo + hi) / 2) not in (lo, hi):
        ahead = peak(middle, "wet").value > peak(middle, "oily").value
        lo, hi = (lo, middle) if ahead else (middle, hi)
    return hi


# ---- figures -------------------------------------------------------------------------------------


def dry_curves(results: Results | None = None) -> plots.Figure:
    """Fig. 2: adhesion over creep on dry rail, at several speeds."""
    curves = {f"{v:g} m/s": curve(v, "dry") for v in SPEEDS}
    marks = {f"{v:g} m/s": peak(v, "dry")[:2] for v in SPEEDS}
    return plots.lines(curves, ("creep", "m/s"), ("adhesion coefficient", "1"), marks=marks)


def surface_curves(results: Results | None = None) -> plots.Figure:
    """Fig. 3: adhesion over creep on the five surfaces, and its peak over the speed."""
    fig, axes = plots.panels(1, 2, height=3.0)
    plots.lines(
        {name: curve(40.0, name) for name in SURFACES}, ("creep", "m/s"),
        ("adhesion coefficient", "1"), axis=axes[0, 0], title="at 40 m/s",
        marks={name: peak(40.0, name)[:2] for name in SURFACES},
    )  # fmt: skip
    v = np.linspace(0.0, 90.0, 91)
    table = peaks(polach)  # the one of the controllers
    heights = np.array([table(v=float(x))["value"] for x in v])
    tops = {n: (v, heights[:, k]) for k, n in enumerate(SURFACES)}
    limit = np.array([contact.curtius_kniffler(float(x)) for x in v])
    plots.lines(
        {**tops, "Curtius-Kniffler": (v, limit)}, ("train speed", "m/s"),
        ("largest adhesion", "1"), axis=axes[0, 1], legend=False,
        title=f"wet and oily swap at {order_changes():.2f} m/s",
    )  # fmt: skip
    axes[0, 1].annotate("Curtius-Kniffler", (v[-1], limit[-1]), xytext=(0, 6), ha="right",
                        textcoords="offset points", fontsize=8)  # fmt: skip
    return fig


def fitted_curves(results: Results | None = None) -> plots.Figure:
    """Reference curve of CONTACT with both fits, and what they leave."""
    fig, axes = plots.panels(2, sharex=True)
    found = {"k_A and k_S free": fits()[0], "k_A >= k_S": fits()[1]}
    creep = 100 * fits()[0].curve.inputs["v_s"] / 10.0
    fine = np.geomspace(creep[0], creep[-1], 400)
    lines = {name: (fine, adhesion(f.law, fine / 10, 10.0)) for name, f in found.items()}
    plots.lines(lines, ("creep", "%"), ("adhesion coefficient", "1"), axis=axes[0, 0], log="x")
    axes[0, 0].plot(creep, fits()[0].curve.measured, "o", ms=3, color=plots.BLACK, zorder=5)
    plots.lines(
        {name: (creep, 1e3 * f.residuals) for name, f in found.items()}, ("creep", "%"),
        ("error, of 1/1000 wheel load", "1"), axis=axes[1, 0], points=True, log="x", legend=False,
    )  # fmt: skip
    axes[0, 0].set_xlabel("")
    return fig


# ---- experiments ---------------------------------------------------------------------------------


@cache
def fits() -> tuple[Fitted, Fitted]:
    """Polach's law fitted to the Eurosprinter curve, free and with k_A >= k_S."""
    return tuple(fit(polach, reference(), ordered=o) for o in (False, True))  # type: ignore[return-value]


def reference() -> Any:
    """File of the reference curve."""
    return registry.folder("models") / "data" / "eurosprinter_creep_curve.csv"


def meaning(free: Fitted, ordered: Fitted) -> str:
    """What the order of k_A and k_S says about this curve."""
    p = free.values
    return (
        f"The curve wants k_S = {p['k_S']:.3f} > k_A = {p['k_A']:.3f}: forced into Polach's order,"
        f" both become {ordered.values['k_A']:.3f} and the largest error"
        f" grows {ordered.max_error / free.max_error:.1f} times. Polach expects dirt to soften the"
        f" part of the patch that slips more than the part that adheres. CONTACT computed this"
        f" curve with an elastic layer between wheel and rail. It softens the part that adheres,"
        f" where it adds to the give of the steel. It does not matter where friction alone sets"
        f" the stress. So k_A falls more than k_S. Together they keep"
        f" {50 * (p['k_A'] + p['k_S']):.0f} % of Kalker's slope without creep."
    )


def draws(count: int, seed: int) -> list[dict[str, float]]:
    """Starts: k_A and k_S log-uniform over a factor 30, the others uniform."""
    rng = np.random.default_rng([seed, count])
    found = []
    for _ in range(count):
        k_A, k_S = 0.3 * FACTOR ** rng.uniform(-0.5, 0.5, 2)
        found.append({
            "k_A": k_A, "k_S": k_S, "mu_0": rng.uniform(0.1, 0.7),
            "A": rng.uniform(0.1, 0.9), "B": rng.uniform(0.05, 1.5),
        })  # fmt: skip
    return found


def peaks_table(context: Context) -> Table:
    """Peak of each surface at each speed, proven to be the only one up to 20 m/s."""
    speeds = (40.0,) if context.quick else SPEEDS
    rows: dict[str, list[Any]] = {k: [] for k in ("surface", "v", "creep", "mu", "force")}
    for k, name in enumerate(SURFACES):
        for v in speeds:
            found = peak(v, name, proven=True)
            for key, value in zip(rows, (
                name, v, found.location, found.value, 20 * contact.WHEEL_LOAD * found.value / 1e3
            ), strict=True):  # fmt: skip
                rows[key].append(value)
        context.progress((k + 1) / len(SURFACES))
    units = {"surface": "1", "v": "m/s", "creep": "m/s", "mu": "1", "force": "kN"}
    return Table(
        "Largest adhesion", {k: (units[k], rows[k]) for k in rows},
        f"Force of ten axles. Wet and oily rail swap their order at {order_changes():.3f} m/s.",
    )  # fmt: skip


def fit_tables(context: Context) -> dict[str, Table]:
    """Parameters of both fits, and how many starts lead there."""
    free, ordered = fits()
    friction = {"mu_0": 0.33, "A": 0.14 / 0.33, "B": math.log(2) / 1.25}
    names = list(free.values)
    parameters = Table(
        "Polach's law fitted to the Eurosprinter curve",
        {
            "parameter": ("1", names),
            "free": ("1", [free.values[n] for n in names]),
            "std": ("1", [free.std[n] for n in names]),
            "k_A >= k_S": ("1", [ordered.values[n] for n in names]),
            "given to CONTACT": ("1", [friction.get(n) for n in names]),
        },
        meaning(free, ordered) + " B in s/m. Deviations count scatter alone; CONTACT is another"
        " model, so the friction that it was given is several of them away.",
    )
    count = 10 if context.quick else 100
    rows: dict[str, list[Any]] = {k: [] for k in ("fit", "limit", "reached", "of", "worst")}
    for name, keep, limit in (("free", False, 0.001), ("k_A >= k_S", True, 0.003)):
        errors = []
        for k, start in enumerate(draws(count, context.seed)):
            errors.append(fit(polach, reference(), start=start, ordered=keep).max_error)
            context.progress((k + 1 + count * keep) / (2 * count))
        reached = sum(e < limit for e in errors)
        for key, value in zip(rows, (name, limit, reached, count, max(errors)), strict=True):
            rows[key].append(value)
    started = Table(
        "Largest error from random starts", {k: ("1", v) for k, v in rows.items()},
        "k_A, k_S log-uniform over a factor 30, mu_0 .1-.7, A .1-.9, B .05-1.5 s/m; errors as a"
        " share of the wheel load.",
    )  # fmt: skip
    return {"fit_parameters": parameters, "fit_starts": started}


EXPERIMENTS = {
    "peaks": Experiment("Peaks of the adhesion", peaks_table, "Where is how much adhesion?"),
    "fit": Experiment("Fit of a creep curve", fit_tables, "Does Polach's law describe a curve?"),
}
