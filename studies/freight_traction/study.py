"""Creep control of a freight locomotive: seek the best creep, identify the resistance, hold it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl import Figure, Results, Signals, Study
from slipctl.draw import plots
from slipctl.models.cheng_2022.certificate import barrier as bounds
from slipctl.studies.freight_traction import experiments, identification
from slipctl.studies.freight_traction.barrier import LAGS, K
from slipctl.studies.freight_traction.claims import CLAIMS
from slipctl.studies.freight_traction.gains import GAINS
from slipctl.studies.freight_traction.loops import (
    K_A,
    K_S,
    MODELS,
    SEEKERS,
    best,
    cases,
    check,
)

# ---- figures -------------------------------------------------------------------------------------


def adhesion_curves(r: Results) -> Any:
    """Curves of Table 1 and of the surfaces whose best creep moves."""
    law = r.part("plant.adh")
    fig, axes = plots.panels(1, 2, height=3.0)
    groups = (("dry", "wet"), ("dry_moving", "wet_moving", "damp_moving"))
    titles = ("Table 1: one best creep", "best creep moves (a guess)")
    for axis, names, title in zip(axes[0], groups, titles, strict=True):
        chosen = {n: law.conditions[n] for n in names if n in law.conditions}
        peaks = {n: best(law, n) for n in chosen}
        plots.laws(law, chosen, upto=6.0, peaks=peaks, axis=axis, title=title)
    return fig


def regimes(r: Results) -> Any:
    """The sliding mode in its two regimes: target left behind, creep tried."""
    fig, axes = plots.panels(2, 3, height=2.1, sharex="col")
    parts = (
        ("smes_robust", 0.0, 2.0, "rho/k = 1: averaged"),
        ("improved_robust", 0.0, 5.0, "rho/k = 0.1"),
        ("improved_robust", 1.0, 1.2, "close up"),
    )
    for column, (loop, start, upto, title) in enumerate(parts):
        log = r.log("base", loop)
        t = log["time"].values
        k = (t >= start) & (t <= upto)
        if "ctl.seek.mode" in log:
            k &= log["ctl.seek.mode"].values == 1
        for axis, signal, name in zip(
            axes[:, column], ("ctl.seek.delta", "ctl.seek.v"), ("delta", "creep tried"), strict=True
        ):
            y = (name, log[signal].attrs["units"])
            curve = {loop: (t[k], log[signal].values[k])}
            head = title if name == "delta" else ""
            if upto == 5.0:  # it chatters on delta = beta
                plots.chatter(axis, curve, y, head, columns=60)
            else:
                plots.lines(curve, ("time", "s"), y, axis=axis, title=head)
    return fig


def speeds(r: Results) -> Any:
    """Train and rim under the three seekers."""
    return plots.speeds(r, "base", [f"{k}_robust" for k in SEEKERS])


def switch(r: Results) -> Any:
    """The lock on dry: delta falls through its planes, the dither takes over and dies out."""
    log = r.log("base", "improved_robust")
    t = log["time"].values
    k = (t >= 2.5) & (t <= 8.0)
    fig, axes = plots.panels(2, 1, height=2.1, sharex=True)
    beta = float(r.cases[0].loops["improved_robust"].param_values()["ctl.seek.beta"])
    sliding = log["ctl.seek.mode"].values[k] == 1
    delta = np.where(sliding, log["ctl.seek.delta"].values[k], np.nan)
    plots.lines({"improved_robust": (t[k][sliding], delta[sliding] / beta)}, ("time", "s"),
                ("delta/beta", "1"), axis=axes[0, 0])  # fmt: skip
    axes[0, 0].axhline(-3.0, color=plots.GREY, lw=0.8, ls="--")
    plots.lines({"improved_robust": (t[k], log["ctl.seek.v"].values[k])}, ("time", "s"),
                ("creep tried", "m/s"), axis=axes[1, 0])  # fmt: skip
    axes[1, 0].axhline(float(log["truth.v_best"][0]), color=plots.GREY, lw=0.8, ls="--")
    return fig


def barrier(r: Results) -> Any:
    """Pull of both shapes up to the barrier, and the disturbance of an adhesion error."""
    e = np.linspace(0, 0.0196, 200)
    fig, axes = plots.panels(1, 2, height=2.8)
    printed = np.array([bounds.pull(x, K, K_S) for x in e])
    robust = np.array([bounds.robust_pull(x, 50.0, K_S) for x in e])
    wanted = ("creep error", "m/s"), ("pull", "m/s^2")
    plots.lines({"printed shape": (e, printed)}, *wanted, axis=axes[0, 0], title="printed shape")
    plots.lines({"printed shape": (e, printed), "robust shape": (e, robust)}, *wanted,
                axis=axes[0, 1], title="both, with 5 % adhesion error")  # fmt: skip
    bound = bounds.largest_disturbance(K, K_S)
    for axis, height, name in ((axes[0, 0], bound, "its bound"),
                               (axes[0, 1], 0.05 * 20.85, "5 % of D")):  # fmt: skip
        axis.axhline(height, color=plots.GREY, lw=0.9, ls=(0, (4, 2)), label=name)
        axis.legend()
    return fig


def _result(seek: str) -> Any:
    def draw(r: Results) -> Any:
        return plots.traces(
            r, "base", [f"{seek}_robust"],
            [("adhesion", "best_adhesion"), ("slip", "best_slip")],
            labels={"slip": "creep", "adhesion": "adhesion"}, limits={"slip": (-0.2, 2.0)},
        )  # fmt: skip

    return draw


def _torque(seek: str) -> Any:
    """Torque over the run, its mean over what it covers, and close up around the first change."""

    def draw(r: Results) -> Any:
        fig, axes = plots.panels(1, 2, height=2.6, width_ratios=(2, 1))
        log = r.log("base", f"{seek}_robust")
        t, T = log["time"].values, log["plant.motor.T_m"].values / 1e3
        plots.chatter(axes[0, 0], {seek: (t, T)}, ("motor torque", "kN m"), "mean and range",
                      columns=50)  # whole periods of each ripple  # fmt: skip
        near = (t >= 9.0) & (t < 11.0)
        plots.lines({seek: (t[near], T[near])}, ("time", "s"), ("motor torque", "kN m"),
                    axis=axes[0, 1], title="close up", legend=False)  # fmt: skip
        return fig

    return draw


def moving(r: Results) -> Any:
    """Best creep that moves: only the improved seeker finds each."""
    return plots.traces(
        r, "moving_optimum", [f"{k}_robust" for k in SEEKERS],
        [("slip", "best_slip"), "adhesion"], limits={"slip": (-0.2, 2.5)},
        labels={"slip": "creep", "adhesion": "adhesion"},
    )  # fmt: skip


def real(r: Results) -> Any:
    """Noise of 1e-3 rad/s and 20 ms of motor lag: mean and range, and close up at the change."""
    fig, axes = plots.panels(2, 2, height=2.3, sharex="col", width_ratios=(2, 1))
    for row, signal, factor, y in zip(
        axes, ("plant.train.v_s", "plant.motor.T_m"), (1.0, 1e-3),
        (("creep", "m/s"), ("motor torque", "kN m")), strict=True,
    ):  # fmt: skip
        whole, near = {}, {}
        for name in (f"{k}_robust" for k in SEEKERS):
            log = r.log("real", name)
            t, values = log["time"].values, factor * log[signal].values
            k = (t >= 9.5) & (t < 11.0)
            whole[name], near[name] = (t, values), (t[k], values[k])
        plots.chatter(row[0], whole, y, "mean and range" if row is axes[0] else "", columns=50)
        plots.lines(near, ("time", "s"), y, axis=row[1], title="close up" if row is axes[0] else "")
    return fig


def laws(r: Results) -> Any:
    """The three laws under the improved seeker: creep error."""
    names = {"corrected": "corrected law", "printed": "law as printed", "robust": "robust law"}
    fig, axes = plots.panels(1, 2, height=2.6)
    for axis, (start, stop), high in zip(
        axes[0], ((0.0, 25.0), (9.98, 10.4)), (0.1, 0.05), strict=True
    ):
        curves = {}
        for ending, name in names.items():
            log = r.log("base", f"improved_{ending}")
            t = log["time"].values
            k = (t >= start) & (t <= stop)
            curves[name] = (t[k], np.clip(log["ctl.barrier.e"].values[k], -high, 1.2 * high))
        plots.lines(curves, ("time", "s"), ("creep error", "m/s"), axis=axis)
        axis.axhline(K_S, color=plots.GREY, lw=0.8, ls="--")
        axis.set_ylim(-high, high)
    return fig


def escape(r: Results) -> Any:
    """Time at which the printed shape leaves its barrier, over the disturbance."""
    table = r.table("escape", "escape")
    rows = [
        (w, a, b) for w, a, b in zip(
            table["of the bound 4 k k_s^3/(3 sqrt 3)"],
            table["leaves the barrier after, predicted"],
            table["leaves the barrier after, measured"], strict=True,
        ) if a is not None and b is not None
    ]  # fmt: skip
    share, told, found = zip(*rows, strict=True)
    fig = plots.lines(
        {"predicted": (share, told)}, ("disturbance / its bound", "1"),
        ("time to the barrier", "s"), log="xy",
    )  # fmt: skip
    fig.axes[0].plot(share, found, "o", color=plots.BLACK, ms=4, label="measured")
    fig.axes[0].legend(["predicted", "measured"])
    return fig


def lagged(r: Results) -> Any:
    """Largest creep error at a rail change behind a lag, over the inner barrier."""
    table, summary = r.table("lagged", "inner"), r.table("lagged", "summary")
    fig, axes = plots.panels(1, 2, height=2.8, sharey=True)
    for axis, lag in zip(axes[0], LAGS, strict=True):
        curves = {}
        for lead, name in ((False, "without lead"), (True, "with lead")):
            rows = [
                (i, m) for at, has, i, m in zip(
                    table["lag"], table["lead"], table["inner barrier"],
                    table["largest creep error"], strict=True,
                ) if at == 1e3 * lag and has == lead
            ]  # fmt: skip
            curves[name] = tuple(zip(*rows, strict=True))
        plots.lines(curves, ("inner barrier", "m/s"), ("largest creep error", "m/s"), axis=axis,
                    log="xy", title=f"lag {1e3 * lag:g} ms", legend=False)  # fmt: skip
        for name, column, dash in (("jump times lag", "jump times lag", (0, (4, 2))),
                                   ("least with 12 kN m", "bound with the torque there is",
                                    (0, (1, 1)))):  # fmt: skip
            height = summary.where(column, lag=1e3 * lag)
            axis.axhline(height, color=plots.GREY, lw=0.9, ls=dash, label=name)
        if lag == LAGS[0]:
            axis.legend()
        axis.set_ylim(1e-3, 0.6)
    return fig


FIGURES: Mapping[str, Figure] = {
    "speeds": Figure("Speed of train and rim, three seekers under the robust law.", speeds),
    "fig01_adhesion_curves": Figure(
        "Adhesion over creep; dots are the peaks.", adhesion_curves, "Fig. 1"
    ),
    "fig02_sliding_mode": Figure(
        "Sliding-mode seeking: printed numbers, which never slide, and ours, which climb at rho.",
        regimes, "Fig. 2",
    ),
    "fig03_switch": Figure(
        "Improved seeking: delta falls through three planes (dashed), the dither takes over.",
        switch, "Fig. 3",
    ),
    "fig04_barrier": Figure(
        "Pull of the barrier laws: the printed shape lets go at the barrier.", barrier, "Fig. 4"
    ),
    **identification.FIGURES,
    "fig07_improved": Figure("Improved seeking, robust law.", _result("improved"), "Fig. 7"),
    "fig08_smes": Figure(
        "Sliding-mode seeking with the printed numbers, robust law.", _result("smes"), "Fig. 8"
    ),
    "fig09_esa": Figure("Perturbation seeking, robust law.", _result("esa"), "Fig. 9"),
    "fig10_smes_torque": Figure("Torque, sliding-mode seeking.", _torque("smes"), "Fig. 10"),
    "fig11_improved_torque": Figure("Torque, improved seeking.", _torque("improved"), "Fig. 11"),
    "fig12_esa_torque": Figure("Torque, perturbation seeking.", _torque("esa"), "Fig. 12"),
    "moving_optimum": Figure("Rails whose best creep moves every 10 s.", moving),
    "real": Figure(
        "Noise on the motor speed and 20 ms of lag: mean and range, and close up at the wet rail.",
        real,
    ),
    "laws": Figure(
        "Creep error of the three laws under the improved seeker, and at the change to wet;"
        " dashed: the barrier.", laws
    ),
    "escape": Figure("When the printed shape leaves its barrier.", escape),
    "lagged": Figure("Change from dry to wet behind a lag.", lagged),
}  # fmt: skip

study = Study(
    name="freight_traction",
    title="Seek the best creep of a freight locomotive, identify its resistance, keep the barrier",
    source="Cheng, He, Zhang, Huang, Huang, Adhesion Control for Freight Train Based on Improved"
    " Sliding Mode Extremum Seeking Algorithm and Barrier Lyapunov Function, JESA 2022",
    doc="Does the improved switch lock the best creep without oscillation, does the swarm find the"
    " running resistance, what disturbance does the barrier law stand, and how much lag?",
    short="With corrected gains the improved seeker locks on the best creep within four seconds,"
    " without oscillation. With the printed ones it does not on dry rail. The barrier law"
    " holds the creep when the rail changes behind some seekers only, and the printed observer"
    " is not stable.",
    headline="locks_dry",
    models=MODELS,
    cases=cases,
    check=check,
    signals=Signals(
        speed="plant.train.v_t",
        wheel_speed="plant.train.v_d",
        position="plant.train.x",
        slip="plant.train.v_s",
        reference="ctl.reference.v_ref",
        best_slip="truth.v_best",
        adhesion="plant.adh.mu",
        best_adhesion="rail.best_adhesion",
        torque="plant.motor.T_m",
        deceleration="plant.train.a_t",
        barrier=("ctl.barrier.e", -K_A, K_S),
    ),
    claims=CLAIMS,
    figures=FIGURES,
    experiments={**experiments.EXPERIMENTS, **identification.EXPERIMENTS},
    gains=GAINS,
)
