"""Anti-slip control of a high-speed train: observer, limit, and six laws with and without it."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Figure, Results, Signals, Study
from slipctl.draw import plots
from slipctl.models.wang_2025.hst_traction import tractive_effort
from slipctl.models.wheel_rail.contact import peak
from slipctl.studies.hst_traction import contact, experiments
from slipctl.studies.hst_traction import regret as lost
from slipctl.studies.hst_traction.claims import CLAIMS, SHOWN
from slipctl.studies.hst_traction.gains import GAINS
from slipctl.studies.hst_traction.loops import BAND, MODELS, RAIL, cases, check
from slipctl.studies.hst_traction.measures import KMH, begin

SLIDING = ("smc", "asmc", "hosm")
"""The three laws of Figs 7 to 10."""


# ---- figures -------------------------------------------------------------------------------------


def clock(r: Results, scenario: str, loop: str) -> tuple[Any, np.ndarray]:
    """Log of a run and its times in s of the paper's run."""
    log = r.log(scenario, loop)
    return log, log["time"].values + begin(r)


def limit_at_work(r: Results) -> Any:
    """Adhesion limit and command around the ice and the oil, with what the rail carries."""
    fig, axes = plots.panels(2, 1, height=2.3)
    log, t = clock(r, "stress", "hosm_limited")
    inside = (t >= 113.0) & (t < 125.0)
    v = log["plant.train.v"].values
    speeds = np.linspace(1, 80, 80)
    W, g, n = 15625.0, 9.8, 10
    carried = np.zeros(t.size)
    for (name, a), b in zip(RAIL, [*(a for _, a in RAIL[1:]), 1e9], strict=True):
        heights = np.interp(v, speeds, [peak(float(s), name).value for s in speeds])
        carried[(t >= a) & (t < b)] = (heights * n * W * g)[(t >= a) & (t < b)]
    traction = np.array([float(tractive_effort(float(s))) for s in v])
    curves = {
        "rail": np.minimum(carried, traction), "limit": log["ctl.limit.F_hi"].values,
        "command": log["ctl.F_contr"].values, "contact": log["plant.train.F_all"].values,
    }  # fmt: skip
    plots.lines(
        {k: (t[inside], y[inside] / 1e3) for k, y in curves.items()}, ("time", "s"),
        ("force of the train", "kN"), axis=axes[0, 0], title="hosm_limited: ice from 115 s, oil"
        " from 120 s",
    )  # fmt: skip
    axes[0, 0].set_ylim(60, 160)
    plots.lines(
        {"creep": (t[inside], KMH * log["worst.highest"].values[inside])}, ("time", "s"),
        ("largest creep", "km/h"), axis=axes[1, 0],
    )  # fmt: skip
    return fig


def speeds(r: Results) -> Any:
    """Train and worst rim under two laws without the limit, and with it."""
    return plots.speeds(r, "base", ("smc", "hosm", "hosm_limited"))


def real(r: Results) -> Any:
    """Creep, speed and limit behind converters and noise."""
    fig, axes = plots.panels(3, 1, height=2.0, sharex=True)
    names = ("hosm_limited", "pid_limited")
    runs = {n: clock(r, "real", n) for n in names}
    creep = {n: (t, KMH * log["worst.creep"].values) for n, (log, t) in runs.items()}
    speed = {n: (t, log["plant.train.v"].values) for n, (log, t) in runs.items()}
    limit = {n: (t, log["ctl.limit.F_hi"].values / 1e3) for n, (log, t) in runs.items()}
    plots.chatter(axes[0, 0], creep, ("creep", "km/h"))
    log, t = runs[names[0]]
    axes[1, 0].plot(t, log["v_d"].values, color=plots.GREY, lw=0.9, label="target")
    plots.lines(speed, ("time", "s"), ("train speed", "m/s"), axis=axes[1, 0])
    plots.chatter(axes[2, 0], limit, ("limit", "kN"))
    return fig


def tracking(r: Results) -> Any:
    """Speed under the three sliding modes, and its error."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    speeds, off = {}, {}
    for name in (*SHOWN, "hosm"):
        log, t = clock(r, "stress", name)
        speeds[name] = (t, log["plant.train.v"].values)
        off[name] = (t, log["plant.train.v"].values - log["v_d"].values)
    axes[0, 0].plot(t, log["v_d"].values, color=plots.GREY, lw=0.9, label="target")
    plots.lines(speeds, ("time", "s"), ("train speed", "m/s"), axis=axes[0, 0])
    plots.lines(off, ("time", "s"), ("speed error", "m/s"), axis=axes[1, 0], legend=False)
    axes[1, 0].set_ylim(-10, 10)
    return fig


def displacement(r: Results) -> Any:
    """Position error under the three sliding modes, each with and without the limit."""
    fig, axes = plots.panels(1, 2, height=2.8)
    for axis, ending in zip(axes[0], ("", "_limited"), strict=True):
        off = {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            off[name] = (t, log["plant.train.x"].values - log["x_d"].values)
        title = "with the limit" if ending else "without the limit"
        plots.lines(off, ("time", "s"), ("position error", "m"), axis=axis, title=title)
    return fig


def creeps(r: Results) -> Any:
    """Creep without and with the limit."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    for axis, ending in zip(axes[:, 0], ("", "_limited"), strict=True):
        curves = {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            curves[name] = (t, KMH * log["worst.creep"].values)
        title = "with the limit, and the paper's band" if ending else "without the limit"
        plots.lines(curves, ("time", "s"), ("creep", "km/h"), axis=axis, title=title)
    for edge in BAND:
        axes[1, 0].axhline(KMH * edge, color=plots.GREY, lw=0.8, ls=(0, (4, 2)))
    return fig


def outputs(r: Results) -> Any:
    """Commands without and with the limit: mean and what they cover, and close up at the ice."""
    fig, axes = plots.panels(2, 2, height=2.3, sharex="col")
    for row, ending in zip(axes, ("", "_limited"), strict=True):
        title = "with the limit" if ending else "without the limit"
        near, whole = {}, {}
        for name in SLIDING:
            log, t = clock(r, "stress", name + ending)
            F = log["ctl.F_contr"].values / 1e3
            whole[name] = (t, F)
            inside = (t >= 114.5) & (t < 115.5)
            near[name] = (t[inside], F[inside])
        plots.chatter(row[0], whole, ("commanded force", "kN"), title)
        plots.lines(near, ("time", "s"), ("commanded force", "kN"), axis=row[1], legend=False,
                    title=f"{title}, close up")  # fmt: skip
    return fig


def by_place(r: Results) -> Any:
    """Ice by place under traction and under the brake: creep and speed, 32 axles."""
    return plots.traces(
        r, "position", ("hosm", "hosm_limited"),
        ("worst.creep", ("plant.train.v", "v_d"), "ctl.F_contr"),
        limits={"worst.creep": (-3.0, 6.0)},
        labels={"worst.creep": "creep", "ctl.F_contr": "force"},
    )  # fmt: skip


def compensation(r: Results) -> Any:
    """Sliding variable and position error with and without saturation compensation."""
    fig, axes = plots.panels(2, 1, height=2.3, sharex=True)
    s, off = {}, {}
    for name in ("hosm_limited", "hosm_limited_uncompensated"):
        log, t = clock(r, "stress", name)
        what = "not compensated" if name.endswith("uncompensated") else "compensated"
        s[what] = (t, log["ctl.strategy.law.s"].values)
        off[what] = (t, log["plant.train.x"].values - log["x_d"].values)
    plots.lines(s, ("time", "s"), ("sliding variable", "m/s"), axis=axes[0, 0])
    plots.lines(off, ("time", "s"), ("position error", "m"), axis=axes[1, 0], legend=False)
    return fig


FIGURES = {
    "speeds": Figure(
        "Speed of the train and of its worst rim, without and with the limit.", speeds
    ),
    "fig02": Figure("Adhesion on dry rail at several speeds.", contact.dry_curves, "Fig. 2"),
    "fig03": Figure("Typical surfaces, and their peaks.", contact.surface_curves, "Fig. 3"),
    "fig04": Figure(
        "The limit at work: it follows the next poorer surface, on ice 0.9 of its own peak.",
        limit_at_work, "Fig. 4",
    ),
    "fig07": Figure(
        "Speed and its error (asmc leaves the panel), stress.", tracking, "Fig. 7"
    ),
    "fig08": Figure("Position error, stress.", displacement, "Fig. 8"),
    "fig09": Figure("Creep, stress.", creeps, "Fig. 9"),
    "fig10": Figure(
        "Commanded force, stress: mean and range of each law, and close up at the ice.", outputs,
        "Fig. 10",
    ),
    "real": Figure(
        "Converters of 12 bit and noise: creep, speed, and what the limit allows.", real
    ),
    "position": Figure("Ice by place: creep (cut off), speed, command.", by_place),
    "compensation": Figure("What the saturation compensation does.", compensation),
    "fit": Figure(
        "Polach's law fitted to a curve of CONTACT, with and without k_A >= k_S.",
        contact.fitted_curves,
    ),
}  # fmt: skip

study = Study(
    name="hst_traction",
    title="Anti-slip control of a high-speed train",
    source="Wang, Zhang, Wang, Cao: Research on Active Anti-Slip Control of High-Speed Trains Based"
    " on High-Order Sliding Mode, Appl. Sci. 2025, 15, 3909",
    doc="What prevents slip, the limit or the law? How fast and how honest is the observer? What do"
    " the gains of the higher-order sliding mode hold, and what does the run ask of them?",
    short="With the limit no law slips, and without it every law spins on poor rail, the proposed"
    " one too. The ranking of the laws by speed error is not that of the paper. With lag and noise"
    " the higher-order law chatters more than the law that it should replace.",
    headline="creep_every_law_base",
    models=MODELS,
    cases=cases,
    check=check,
    signals=Signals(
        speed="plant.train.v", position="plant.train.x", slip="worst.creep",
        torque="ctl.F_contr", deceleration="plant.train.a",
        wanted_speed="v_d", wanted_position="x_d",
    ),
    experiments=experiments.EXPERIMENTS | contact.EXPERIMENTS | lost.EXPERIMENTS,
    claims=CLAIMS,
    figures=FIGURES,
    gains=GAINS,
)  # fmt: skip
