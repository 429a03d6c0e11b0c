"""Creep control of a freight locomotive: seek the best creep, identify the resistance, hold it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl import Claim, Figure, Results, Signals, Study
from slipctl.certify import barrier as bounds
from slipctl.draw import plots
from slipctl.models import freight_traction as freight
from slipctl.studies.freight_traction import experiments, identification
from slipctl.studies.freight_traction.barrier import LAGS, K
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

# ---- answers to the claims -----------------------------------------------------------------------


def window(r: Results, loop: str, signal: str, start: float, stop: float) -> np.ndarray:
    """Values of a logged signal of a loop in ``base`` between two times in s."""
    log = r.log("base", loop)
    t = log["time"].values
    return np.asarray(log[signal].values[(t >= start - 1e-9) & (t < stop - 1e-9)])


def adhesion_at(loop: str, time: float) -> Any:
    """Mean adhesion over the half second before a time in s, in ``base``."""
    return lambda r: float(window(r, loop, "plant.adh.mu", time - 0.5, time).mean())


def torque_of(loop: str, seconds: float = 10.0) -> Any:
    """Mean torque in N m over the half second before the end of the dry section."""
    return lambda r: float(window(r, loop, "plant.motor.T_m", seconds - 0.5, seconds).mean())


def reached(column: str, seek: str = "improved", section: int = 1, scenario: str = "base") -> Any:
    """What a seeker reaches under the robust law on a section."""
    return lambda r: r.table("reached").where(
        column, scenario=scenario, loop=f"{seek}_robust", section=section
    )


LOCK = "within 0.3 % of the peak adhesion for good after"
USE = "least adhesion of the last 0.5 s, of the peak"
FOUND = "within 5 % of the best creep for good after"


def worst_found(r: Results) -> float | None:
    """Longest time in s until the best creep is within 5 %, on the moving optimum."""
    times = [reached(FOUND, section=k, scenario="moving_optimum")(r) for k in (1, 2, 3)]
    return None if None in times else max(times)


def largest_creep(r: Results) -> float:
    """Largest creep beyond the best one in m/s, improved seeker under the robust law."""
    log = r.log("base", "improved_robust")
    return float((log["plant.train.v_s"].values - log["truth.v_best"].values).max())


CLAIMS = (
    *(
        Claim(
            f"peak_{rail}", "Table 1", f"optimal adhesion coefficient, {rail}", "number", printed,
            lambda r, rail=rail: float(freight.peak_height(**freight.SURFACES[rail])),  # type: ignore[misc]
            tolerance="last digit", why="with the columns of Table 1 in the order a, c, b",
        )
        for rail, printed in (("dry", "0.286"), ("wet", "0.206"))
    ),
    Claim(
        "locks_dry", "section 4.2, Fig. 7", "improved seeking locks an adhesion of .2855, dry",
        "number", 0.2855, adhesion_at("improved_robust", 10.0), bound="at least",
        scenario="base", loop="improved_robust",
        assumption="k = 1, rho = 0.1, beta = 0.02; with the printed set it cannot (next claims)",
    ),
    Claim(
        "locks_by_8s", "section 4.2, Fig. 7", "improved seeking has locked at 8 s", "number", 8.0,
        reached(LOCK), "s", bound="at most", scenario="base", loop="improved_robust",
        assumption="locked: within 0.3 % of the peak for good",
    ),
    Claim(
        "locks_wet", "section 4.2, Fig. 7", "improved seeking locks an adhesion of .206, wet",
        "number", "0.206", adhesion_at("improved_robust", 15.0), tolerance="last digit",
        scenario="base", loop="improved_robust",
    ),
    Claim(
        "no_oscillation", "section 4.2, Fig. 7", "improved seeking ends without"
        " steady-state oscillation", "yes/no", True,
        lambda r: all(reached("creep ripple", section=k)(r) < 0.01 for k in (1, 2, 3)),
        scenario="base", loop="improved_robust",
        assumption="creep moves less than 0.01 m/s in the last 0.5 s of each section",
    ),
    Claim(
        "smes_rising", "section 4.2, Fig. 8",
        "plain sliding-mode seeking still rises when the rail changes at 10 s", "yes/no", True,
        lambda r: adhesion_at("smes_robust", 10.0)(r) > adhesion_at("smes_robust", 9.0)(r) + 1e-4,
        scenario="base", loop="smes_robust", why="averaged regime, time constant 5.39 s",
    ),
    Claim(
        "smes_028", "section 4.2, Fig. 8", "plain sliding-mode seeking comes to about"
        " .28 on dry and oscillates", "number",
        "0.28", lambda r: float(window(r, "smes_robust", "plant.adh.mu", 5.0, 10.0).mean()),
        tolerance="last digit", scenario="base", loop="smes_robust",
        assumption="mean over 5 s to 10 s",
    ),
    Claim(
        "smes_oscillates", "section 4.2, Fig. 8", "plain sliding-mode seeking oscillates"
        " on wet too", "yes/no", True,
        lambda r: reached("creep ripple", "smes", 2)(r) > 0.05, scenario="base",
        loop="smes_robust", why="k beta/rho = 0.1 m/s, told before the run",
    ),
    Claim(
        "esa_slow", "section 4.2, Fig. 9", "perturbation seeking does not converge in the dry"
        " section", "yes/no", True, lambda r: reached(USE, "esa")(r) < 99.7,
        scenario="base", loop="esa_robust",
        assumption="dither 0.1 m/s at 2 Hz, gain 20 (guesses), corners as printed; converged:"
        " within 0.3 % over the last 0.5 s before 10 s",
        why="dither and gain are not printed, so the outcome is that of our guess",
    ),
    *(
        Claim(
            f"torque_{seek}", f"section 4.2, Fig. {figure}",
            f"torque of more than 8300 N m on dry, {seek}", "number", 8300.0,
            torque_of(f"{seek}_robust"), "N m", bound="at least", scenario="base",
            loop=f"{seek}_robust", assumption=".625 m is the radius; mean of 9.5 s to 10 s",
            why_not="this is the mean; its ripple takes the torque above 8.7 kN m",
        )
        for seek, figure in (("smes", 10), ("improved", 11))
    ),
    Claim(
        "torque_esa", "section 4.2, Fig. 12", "torque of about 8250 N m on dry, esa", "number",
        "8250", torque_of("esa_robust"), "N m", tolerance=50.0,
        tolerance_why="'about'; the paper tells it from 8300", scenario="base", loop="esa_robust",
        assumption="as for esa_slow", why_not="our guess of the dither is nearer to the peak",
    ),
    Claim(
        "creep_constraint", "section 2.2, (10)", "the creep never exceeds the best creep",
        "number", 0.0, largest_creep, "m/s", bound="at most", scenario="base",
        loop="improved_robust",
        why_not="a seeker must pass the peak to know it; the barrier is around the creep it asks"
        " for",
    ),
    Claim(
        "holds_transient", "section 5 (3)",
        "the printed law keeps its barrier through the rail changes", "yes/no", True,
        lambda r: r.metric("base", "improved_corrected", "barrier_exits") == 0, scenario="base",
        loop="improved_corrected", assumption="signs put right, observer in the loop",
        why_not="its pull vanishes at the barrier, and beyond it pushes outwards",
    ),
    Claim(
        "robust_holds", "ours", "the robust form keeps it through both rail changes with 5 %"
        " adhesion error, without lag", "yes/no", True,
        lambda r: all(
            held for form, rail, lag, held in zip(
                *(r.table("kept")[c] for c in ("law", "rail", "lag", "barrier held")), strict=True
            ) if form == "robust" and lag == 0
        ),
    ),
    Claim(
        "robust_lag", "ours", "the robust form keeps it on a constant rail with 5 % adhesion"
        " error and 20 ms of lag", "yes/no", True,
        lambda r: all(
            held for form, lag, held in zip(
                *(r.table("kept")[c] for c in ("law", "lag", "barrier held")), strict=True
            ) if form == "robust" and lag > 0
        ),
    ),
    Claim(
        "robust_real", "ours", "the robust form keeps 0.02 m/s with seeker, noise and 20 ms of lag,"
        " by a lead and an inner barrier of 5 mm/s", "yes/no", True,
        lambda r: r.metric("real", "improved_robust", "barrier_exits") == 0, scenario="real",
        loop="improved_robust",
    ),
    Claim(
        "dry_in_6s", "ours", "improved seeking locks the dry rail within 6 s of the start",
        "number", 6.0, reached(LOCK), "s", bound="at most", scenario="base", loop="improved_robust",
    ),
    Claim(
        "wet_in_2s", "ours", "improved seeking locks the wet rail within 2 s", "number", 2.0,
        reached(LOCK, section=2), "s", bound="at most", scenario="base", loop="improved_robust",
    ),
    Claim(
        "moving_5s", "ours", "improved seeking finds each new optimum within 5 % in 5 s",
        "number", 5.0, worst_found, "s", bound="at most", scenario="moving_optimum",
        loop="improved_robust",
    ),
    Claim(
        "torque_still", "ours", "improved seeking holds with a torque ripple below 20 N m",
        "number", 20.0,
        lambda r: max(reached("torque ripple", section=k)(r) for k in (1, 2, 3)), "N m",
        bound="at most", scenario="base", loop="improved_robust",
    ),
    Claim(
        "torque_noisy", "ours", "with noise of 1e-3 rad/s the torque ripple is below 80 N m, any"
        " seed", "number", 80.0, lambda r: max(r.table("seeds")["torque ripple, worst"]), "N m",
        bound="at most",
    ),
    Claim(
        "no_false_lock", "ours", "improved seeking makes no false lock, any seed", "number", 0,
        lambda r: sum(r.table("seeds")["false locks"]), bound="at most",
    ),
    Claim(
        "formulas", "ours", "ripple and rate of the sliding mode are their formulas", "number", 2.0,
        lambda r: max(abs(d) for d in r.table("theory")["difference"]), "%", bound="at most",
    ),
    Claim(
        "back_inside", "ours", "after a rail change behind 20 ms the creep is back inside 0.02 m/s",
        "number", 200.0,
        lambda r: max(r.table("lagged", "summary")["back inside 0.02 after"]), "ms",
        bound="at most",
    ),
    *identification.CLAIMS,
)  # fmt: skip


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
    fig, axes = plots.panels(2, 2, height=2.1, sharex="col")
    for column, (loop, upto, title) in enumerate(
        (("smes_robust", 2.0, "rho/k = 1: averaged"), ("improved_robust", 5.0, "rho/k = 0.1"))
    ):
        log = r.log("base", loop)
        t = log["time"].values
        k = t <= upto
        if "ctl.seek.mode" in log:
            k &= log["ctl.seek.mode"].values == 1
        for axis, signal, name in zip(
            axes[:, column], ("ctl.seek.delta", "ctl.seek.v"), ("delta", "creep tried"), strict=True
        ):
            unit = log[signal].attrs["units"]
            plots.lines({loop: (t[k], log[signal].values[k])}, ("time", "s"), (name, unit),
                        axis=axis, title=title if name == "delta" else "")  # fmt: skip
    return fig


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
    plots.lines({"printed shape": (e, printed), "its bound": (e, 0 * e + bounds.largest_disturbance(
        K, K_S))}, *wanted, axis=axes[0, 0], title="printed shape")  # fmt: skip
    plots.lines({"printed shape": (e, printed), "robust shape": (e, robust),
                 "5 % of D": (e, 0 * e + 0.05 * 20.85)}, *wanted, axis=axes[0, 1],
                title="both, with 5 % adhesion error")  # fmt: skip
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
    def draw(r: Results) -> Any:
        return plots.traces(r, "base", [f"{seek}_robust"], ["torque"])

    return draw


def moving(r: Results) -> Any:
    """Best creep that moves: only the improved seeker finds each."""
    return plots.traces(
        r, "moving_optimum", [f"{k}_robust" for k in SEEKERS],
        [("slip", "best_slip"), "adhesion"], limits={"slip": (-0.2, 2.5)},
        labels={"slip": "creep", "adhesion": "adhesion"},
    )  # fmt: skip


def real(r: Results) -> Any:
    """Noise of 1e-3 rad/s and 20 ms of motor lag."""
    return plots.traces(
        r, "real", [f"{k}_robust" for k in SEEKERS],
        [("slip", "best_slip"), "torque"], limits={"slip": (-0.2, 2.0)}, labels={"slip": "creep"},
    )  # fmt: skip


def laws(r: Results) -> Any:
    """The three laws under the improved seeker: creep error."""
    names = {"corrected": "corrected", "printed": "as printed", "robust": "robust"}
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
        inner = curves["with lead"][0]
        for name, column in (("jump times lag", "jump times lag"),
                             ("least with 12 kN m", "bound with the torque there is")):  # fmt: skip
            curves[name] = (inner, [summary.where(column, lag=1e3 * lag)] * len(inner))
        plots.lines(curves, ("inner barrier", "m/s"), ("largest creep error", "m/s"), axis=axis,
                    log="xy", title=f"lag {1e3 * lag:g} ms", legend=lag == LAGS[0])  # fmt: skip
        axis.set_ylim(1e-3, 0.6)
    return fig


FIGURES: Mapping[str, Figure] = {
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
    "real": Figure("Noise on the motor speed and 20 ms of lag.", real),
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
