"""Super-twisting slip control of a braked subway wheelset, with the optimum searched online."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl import Figure, Results, Signals, Study
from slipctl.draw import plots
from slipctl.studies.subway_braking import estimation, experiments
from slipctl.studies.subway_braking.claims import CLAIMS
from slipctl.studies.subway_braking.gains import GAINS
from slipctl.studies.subway_braking.loops import (
    ENSEMBLES,
    MODELS,
    MOVING,
    TABLE_1,
    best,
    cases,
)
from slipctl.studies.subway_braking.sections import ESTIMATE

# ---- figures -------------------------------------------------------------------------------------


def adhesion_curves(r: Results) -> Any:
    """Curves of Table 1 and of the family whose optimum moves, with their peaks."""
    law = r.part("plant.adh")
    fig, axes = plots.panels(1, 2, height=3.0)
    titles = ("Table 1: one optimum", "optimum moves (a guess)")
    for axis, names, title in zip(axes[0], (TABLE_1, MOVING), titles, strict=True):
        chosen = {n: law.conditions[n] for n in names if n in law.conditions}
        peaks = {n: best(law, n) for n in chosen}
        plots.laws(law, chosen, upto=8.0, peaks=peaks, axis=axis, title=title)
    return fig


def estimated_curves(r: Results) -> Any:
    """True curve of each rail and the one estimated at its end, in the loop."""
    log = r.log("moving_optimum", "sta_online")
    law = r.part("plant.adh")
    v = np.linspace(0, 8, 200)
    fig, axes = plots.panels(1, 3, height=2.6)
    for axis, span, name in zip(axes[0], experiments.spans(log), MOVING, strict=True):
        end = {n: float(log[f"ctl.estimator.{n}"].values[span.stop - 1]) for n in law.params}
        curves = {
            "true": (v, estimation.curve(law, v, law.conditions[name])),
            "estimated": (v, estimation.curve(law, v, end)),
        }
        plots.lines(
            curves, ("slip speed", "m/s"), ("adhesion", "1"), axis=axis,
            title=name.replace("_moving", ""),
        )  # fmt: skip
    return fig


def best_slip(r: Results) -> Any:
    """Online optimum and the reference made of it, beside the true optimum."""
    return plots.traces(
        r, "moving_optimum", ["sta_online"],
        [("ctl.search.best", "best_slip"), ("ctl.probe.reference", "best_slip"),
         ("slip", "best_slip")],
        limits={"ctl.search.best": (0, 4), "ctl.probe.reference": (0, 4), "slip": (0, 4)},
        labels={"ctl.search.best": "best slip, found", "ctl.probe.reference": "slip reference"},
    )  # fmt: skip


def slip(r: Results) -> Any:
    """Slip over the run, and close up after the start and after each change."""
    return _slip(r, "base")


def _slip(r: Results, scenario: str) -> Any:
    loops = ("smc", "sta")
    logs = {k: r.log(scenario, k) for k in loops}
    fig, axes = plots.panels(2, 2, height=2.1)
    windows = ((0.0, 6.0), (0.0, 0.2), (1.99, 2.09), (3.99, 4.09))
    titles = ("whole run", "start on dry", "dry to wet", "wet to ice")
    for axis, (first, last), title in zip(axes.flat, windows, titles, strict=True):
        curves = {}
        for k, log in logs.items():
            t = log["time"].values
            inside = (t >= first) & (t <= last)
            curves[k] = (t[inside], log["plant.wheel.v_s"].values[inside])
        plots.lines(curves, ("time", "s"), ("slip speed", "m/s"), axis=axis, title=title)
    return fig


def torque(r: Results) -> Any:
    """Torque of the reaching law and of super-twisting: its range over time, and close up."""
    return _swings(r, "base", ("smc", "sta"))


def _swings(r: Results, scenario: str, loops: tuple[str, ...]) -> Any:
    """Mean and range of the torque in windows of 20 ms, and 30 ms of it close up."""
    whole = {}
    for k in loops:
        log = r.log(scenario, k)
        whole[k] = (log["time"].values, log["plant.brake.T_b"].values / 1e3)
    return _mean_and_close_up(whole, ("brake torque", "kN m"), (1.98, 2.01))


def _mean_and_close_up(
    whole: Mapping[str, Any], y: tuple[str, str], near: tuple[float, float]
) -> Any:
    """Mean and range of what chatters in windows of 20 ms, and between two times tick by tick."""
    fig, axes = plots.panels(1, 2, height=2.8)
    plots.chatter(axes[0, 0], whole, y, "mean and range")
    close = {}
    for k, (t, values) in whole.items():
        inside = (t >= near[0]) & (t < near[1])
        close[k] = (t[inside], values[inside])
    plots.lines(close, ("time", "s"), y, axis=axes[0, 1], title="close up, dry to wet")
    return fig


def error(r: Results) -> Any:
    """Control error of both laws once it is small, and close up at the change to wet."""
    whole = {}
    for k in ("smc", "sta"):
        log = r.log("base", k)
        difference = log["plant.wheel.v_s"].values - log["v_opt"].values
        whole[k] = (log["time"].values, 1e3 * difference)
    fig = _mean_and_close_up(whole, ("slip error", "mm/s"), (1.98, 2.04))
    fig.axes[0].set_ylim(-20, 20)
    return fig


def speeds(r: Results) -> Any:
    """Vehicle and rim under the reaching law, super-twisting, and its online form."""
    return plots.speeds(r, "base", ("smc", "sta", "sta_online"))


def slip_in_curves(r: Results) -> Any:
    """Slip in curves, with close-ups where it settles."""
    return _slip(r, "curves")


def torque_in_curves(r: Results) -> Any:
    """Torque in curves: its range over time, and close up at the first curve."""
    return _swings(r, "curves", ("smc", "sta"))


def real(r: Results) -> Any:
    """What lag, tooth wheel and noise leave."""
    loops = [k for k in ("smc", "sta", "sta_online") if k in r.data.get("real", {})]
    return plots.traces(r, "real", loops, [("slip", "best_slip"), "torque"])


def demand(r: Results) -> Any:
    """Demand of 0.8 m/s^2: dry rail never wakes slip control, ice does."""
    log = r.log("demand", "sta")
    t = log["time"].values
    near = (t >= 4.07) & (t < 4.15)
    fig, axes = plots.panels(3, 2, sharex="col", width_ratios=(2, 1))
    for row, signal, factor, y in zip(
        axes, ("plant.wheel.v_s", "plant.brake.T_b", "plant.wheel.a"), (1.0, 1e-3, 1.0),
        (("slip speed", "m/s"), ("brake torque", "kN m"), ("deceleration", "m/s^2")), strict=True,
    ):  # fmt: skip
        values = factor * log[signal].values
        top = row is axes[0]
        plots.chatter(row[0], {"sta": (t, values)}, y, "mean and range" if top else "")
        plots.lines({"sta": (t[near], values[near])}, ("time", "s"), y, axis=row[1],
                    title="close up, wet to ice" if top else "")  # fmt: skip
    for axis, k in zip(axes[0], (t >= 0, near), strict=True):
        axis.plot(t[k], log["v_opt"].values[k], color=plots.GREY, ls=(0, (4, 2)), lw=0.9)
    return fig


def random_sections(r: Results) -> Any:
    """Share of random sections found over the noise; noise-free at the left end."""
    table = r.table("sections", "sections")
    curves: dict[str, tuple[list[float], list[float]]] = {}
    rows = zip(*(table[k] for k in ("detector", "noise", ESTIMATE)), strict=True)
    for detector, noise, share in rows:
        xs, ys = curves.setdefault(detector, ([], []))
        xs.append(noise)
        ys.append(share)
    fig = plots.lines(
        curves, ("noise of the measured adhesion", "1"),
        ("found within 0.5 s", "%"), points=True, legend=False,
    )  # fmt: skip
    axis = fig.axes[0]
    axis.set_xscale("symlog", linthresh=1e-5)  # linear below: 0 is noise-free
    axis.set_xlim(-1e-6, 4e-3)
    axis.set_ylim(0, 105)
    axis.legend(title="change looked for by", loc="lower left")
    return fig


def printed(r: Results) -> Any:
    """Printed gains at 1 ms: the torque swings between nothing and all."""
    return _swings(r, "base", ("sta_printed",))


FIGURES: Mapping[str, Figure] = {
    "speeds": Figure("Speed of vehicle and rim, perfect sensors.", speeds),
    "fig02_adhesion_curves": Figure(
        "Adhesion over slip speed; dots are the peaks.", adhesion_curves, "Fig. 2"
    ),
    "fig05_estimated_curves": Figure(
        "True curves, and those estimated by the end of each rail (noise-free).",
        estimated_curves, "Fig. 5",
    ),
    "fig06_best_slip": Figure(
        "Best slip found online, reference with probes, and slip; dashed: true optimum.",
        best_slip, "Fig. 6",
    ),
    "fig07_slip": Figure("Slip under both laws, with close-ups.", slip, "Fig. 7"),
    "fig08_torque": Figure(
        "Brake torque under both laws: mean and range, and close up.", torque, "Fig. 8"
    ),
    "fig09_error": Figure(
        "Control error of both laws: mean and range, and close up; the start leaves the panel.",
        error, "Fig. 9",
    ),
    "fig10_slip_in_curves": Figure(
        "Slip with a curve of 800 m from 2 s and of 400 m from 4 s, with close-ups.",
        slip_in_curves, "Fig. 10",
    ),
    "fig11_torque_in_curves": Figure("Brake torque in the curves.", torque_in_curves, "Fig. 11"),
    "printed_gains": Figure("Super-twisting with the printed gains, sampled at 1 ms.", printed),
    "real": Figure("50 ms of lag, tooth wheel and noisy speed.", real),
    "sections": Figure(
        "Random sections on which the best slip is found in time, over the noise.", random_sections
    ),
    "demand": Figure(
        "A demand of 0.8 m/s^2 on dry, wet and icy rail; dashed: best slip.", demand
    ),
}  # fmt: skip

study = Study(
    name="subway_braking",
    title="Super-twisting slip control of a braked subway wheelset, optimum searched online",
    source="Huang, Du et al., An Online Super-Twisting Sliding Mode Anti-Slip Control Strategy,"
    " Energies 2020",
    doc="Does super-twisting end the chattering of sliding-mode slip control, does least squares"
    " with differential evolution find the best slip in time, and with which gains?",
    short="With the printed gains, super-twisting chatters more than the reaching law that it"
    " should replace, and with k1 = 20 and k2 = 10 the chattering ends. The paper's own estimator"
    " does not find the optimum. A windowed one with a probe finds it in a quarter of a second on"
    " exact data, but not with lag and noise on ice.",
    headline="chattering_eliminated",
    models=MODELS,
    cases=cases,
    signals=Signals(
        speed="plant.wheel.v",
        wheel_speed="plant.wheel.omega",
        position="plant.wheel.x",
        slip="plant.wheel.v_s",
        reference=("ctl.reference.v_ref", "ctl.slip.reference.v_ref"),
        best_slip="v_opt",
        adhesion="plant.adh.mu",
        best_adhesion="rail.best_adhesion",
        torque="plant.brake.T_b",
        deceleration="plant.wheel.a",
    ),
    claims=CLAIMS,
    figures=FIGURES,
    experiments=experiments.EXPERIMENTS,
    gains=GAINS,
    ensembles=ENSEMBLES,
    plain=("base", "real", "curves"),  # the paper's rows on curves need one run a loop
)
