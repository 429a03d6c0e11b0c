"""Figures of the study ``gain_bounds``: maps of what is certified, and Lyapunov functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from slipctl import Results
from slipctl.certify import catalogue
from slipctl.draw import plots
from slipctl.models.cheng_2022.certificate import barrier
from slipctl.models.cheng_2022.freight_traction import SURFACES, steepest_slope
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.super_twisting.certificate import twisting_report as twisting
from slipctl.models.wang_2025.certificate import higher_order
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.hst_braking import RAILS, peak_height, peak_slip
from slipctl.studies.gain_bounds import runs as gain_bounds_runs
from slipctl.studies.hst_braking.gains import G, change_of_rail
from slipctl.studies.hst_traction import gains as hst_traction_gains
from slipctl.studies.subway_braking.gains import BAND

SHADES = ("#E4EEF6", "#BFD9EC", "#8FBDDD", "#5A9BC9")
"""From the widest criterion to the narrowest."""

Marks = Mapping[str, tuple[float, float]]


def nested(
    axis: Any,
    x: tuple[str, str, np.ndarray],
    y: tuple[str, str, np.ndarray],
    inside: Mapping[str, np.ndarray],
    marks: Marks,
    log: str = "xy",
    title: str = "",
) -> None:
    """Regions, each drawn over the one before, with a line around and points.

    Args:
        axis: panel. x, y: name, unit and values of each axis. inside: grids of yes and no.
        marks: points by name. log: logarithmic axes. title: of the panel.
    """
    with plots.style():
        for k, (name, grid) in enumerate(inside.items()):
            shade = SHADES[min(k, len(SHADES) - 1)]
            level = grid.astype(float)
            axis.contourf(x[2], y[2], level, levels=[0.5, 1.5], colors=[shade])
            axis.contour(x[2], y[2], level, levels=[0.5], colors=["#33658A"], linewidths=0.7)
            axis.plot([], [], "s", color=shade, mec="#33658A", ms=7, label=name)
        points(axis, marks)
        if "x" in log:
            axis.set_xscale("log")
        if "y" in log:
            axis.set_yscale("log")
        axis.set_xlabel(plots.label(*x[:2]))
        axis.set_ylabel(plots.label(*y[:2]))
        axis.set_title(title)
        axis.legend(loc="best", fontsize=7)


def points(axis: Any, marks: Marks) -> None:
    """Mark points by name."""
    styles = ("o", "X", "D", "^")
    for k, (name, (px, py)) in enumerate(marks.items()):
        axis.plot([px], [py], styles[k % 4], color=plots.ORANGE if k else plots.BLACK, ms=6,
                  label=name, zorder=5, mec="white", mew=0.5)  # fmt: skip


def twisting_map(r: Results) -> Any:
    """Criteria of super-twisting in the plane without units, and the plane of subway_braking."""
    fig, axes = plots.panels(1, 2, height=3.9)
    k2, k1 = np.geomspace(1.0005, 100, 240), np.geomspace(0.08, 40, 240)
    found = sta.regions(*np.meshgrid(k1, k2, indexing="ij"), 1.0)
    chosen = {
        "exact": found["exact"], "any quadratic V": found["quadratic"],
        "(48), best weight": found["homogenised_48"], "(48) as printed, L = 1": found["printed_48"],
    }  # fmt: skip
    nested(axes[0, 0], ("k2/L", "1", k2), ("k1/sqrt(L)", "1", k1), chosen,
           {"1.5, 1.1": (1.1, 1.5)}, title="without units")  # fmt: skip
    for name, line in (("seeber_horn", ":"), ("levant", "--")):
        ends = [twisting.smallest_k1(name, c, 1.0) or np.nan for c in k2]
        axes[0, 0].plot(k2, ends, line, color=plots.BLACK, lw=0.9,
                        label=f"after {name.replace('_', '-').title()}")  # fmt: skip
    axes[0, 0].set_ylim(k1[0], k1[-1])
    axes[0, 0].legend(loc="upper right", fontsize=6.5)
    L, T = 0.8, 1e-3
    k2, k1 = np.geomspace(0.81, 100, 240), np.geomspace(0.4, 4000, 240)
    K1, K2 = np.meshgrid(k1, k2, indexing="ij")
    found = sta.regions(K1, K2, L)
    fits = sta.explicit_swing_map(K1, K2, L, T)
    axis = axes[0, 1]
    nested(axis, ("k2", "m/s^3", k2), ("k1", "m^.5/s^1.5", k1),
           {"exact, L = 0.8 m/s^3": found["exact"],
            "and feasible at 1 ms": found["exact"] & (fits <= BAND)},
           {"used: 20, 10": (10.0, 20.0), "printed: 2000, 1.5": (1.5, 2000.0)},
           title="subway_braking")  # fmt: skip
    with plots.style():
        time = np.array([[sta.reaching_time_bounds(a, b, L, 1.0)[1] for b in k2[::6]]
                         for a in k1[::6]])  # fmt: skip
        lines = axis.contour(k2[::6], k1[::6], np.minimum(time, 1e3), levels=[0.02, 0.1, 0.5, 2.0],
                             colors=[plots.GREEN], linewidths=0.9)  # fmt: skip
        axis.clabel(lines, fmt="%g s", fontsize=6)
        lines = axis.contour(k2, k1, fits, levels=[1e-4, BAND, 0.1, 1.0], colors=[plots.ORANGE],
                             linewidths=0.9, linestyles="--")  # fmt: skip
        axis.clabel(lines, fmt="%g m/s", fontsize=6)
        axis.plot([], [], color=plots.GREEN, label="reaching time from 1 m/s^2, bound")
        axis.plot([], [], "--", color=plots.ORANGE, label="chattering at 1 ms")
        axis.legend(loc="lower right", fontsize=6.5)
    return fig


def _grid(system: str, numbers: Mapping[str, float], criterion: str,
          x: tuple[str, np.ndarray], y: tuple[str, np.ndarray]) -> np.ndarray:  # fmt: skip
    """Where a criterion holds over two of its numbers; rows are y."""
    holds = catalogue.SYSTEMS[system].criteria[criterion].holds
    return np.array([[holds({**numbers, x[0]: a, y[0]: b}) for a in x[1]] for b in y[1]])


def traction_map(r: Results) -> Any:
    """Adhesion observer over its gains, and what the adaptive law's least gain certifies."""
    fig, axes = plots.panels(1, 2, height=3.6)
    K2, K1 = np.geomspace(3.9e3, 2e5, 160), np.geomspace(8, 9e3, 160)
    base = {"K3": 0.5, "L": 2000.0}
    chosen = {
        label: _grid("adhesion_observer", base, name, ("K2", K2), ("K1", K1))
        for label, name in (("exact", "exact"), ("any quadratic V", "quadratic"),
                            ("Theorem 1 with its root", "theorem_1"))
    }  # fmt: skip
    nested(axes[0, 0], ("K2", "rad/s^3", K2), ("K1", "rad^.5/s^1.5", K1), chosen,
           {"used": (4400.0, 98.5)}, title="observer, L = 2000 rad/s^3")  # fmt: skip
    with plots.style():
        axes[0, 0].plot(K2, 2 * K2, ":", color=plots.BLACK, lw=0.9, label="K1 = 2 K2, as our text")
        axes[0, 0].set_ylim(K1[0], K1[-1])
        axes[0, 0].legend(fontsize=6.5, loc="upper right")
    k4 = np.geomspace(0.18, 10, 120)
    best = np.array([higher_order.best(k) for k in k4])
    curves = {
        "exact, beta of (49)": np.array([higher_order.exact_eta(k, 2 * b * k)
                                         for k, b in zip(k4, best[:, 1], strict=True)]),
        "any quadratic V": np.array([higher_order.quadratic_eta(k, 2 * b * k)
                                     for k, b in zip(k4, best[:, 1], strict=True)]),
        "matrix of (49), best weight, beta 3 k4/8": np.array(
            [higher_order.best_weighted(k)[2] for k in k4]),
        "(49), best alpha and beta": best[:, 2],
    }  # fmt: skip
    marks = {
        "printed: alpha .02, beta .09": (0.25, higher_order.certified_eta(0.02, 0.09, 0.25)),
        "met on dry rail, 99.9 % of a run": (0.25, hst_traction_gains.slope_met("printed").value),
    }
    plots.lines({k: (k4, v) for k, v in curves.items()}, ("k4", "1/s"), ("eta", "m/s^3"),
                axis=axes[0, 1], log="xy", title="adaptive law")  # fmt: skip
    with plots.style():
        points(axes[0, 1], marks)
        axes[0, 1].legend(fontsize=6.5)
    return fig


def funnel_map(r: Results) -> Any:
    """What prescribed performance holds when sampled: both laws."""
    fig, axes = plots.panels(1, 2, height=3.4)
    kappa = np.linspace(0.02, 3.7, 220)
    held = np.array([ppc.sampled_disturbance(float(k)) / k for k in kappa])
    load = np.linspace(0.0, 0.6, 300)
    region = load[:, None] <= held[None, :]
    nested(axes[0, 0], ("K1 T", "1", kappa), ("W/(K1 eta d)", "1", load),
           {"invariant": region, "and errors die out": region & (kappa[None, :] <= 2)},
           {"used, W = 0.2 1/s": (0.1, 0.2 / 0.6),
            "change dry to snow, 43.6 m/s": (0.1, change_of_rail(43.6) / 0.6)},
           log="", title="funnel law")  # fmt: skip
    axes[0, 0].set_ylim(0, 0.85)
    speed = np.linspace(1, 55, 100)
    W = ppc.largest_disturbance(100.0, 0.005, 1.2, 1.2)
    budget = np.array([ppc.adhesion_budget(v, W, 0.43, 60.35) for v in speed]) / 1e3
    a, slip = G * float(peak_height(**RAILS["dry"])), float(peak_slip(**RAILS["dry"]))
    own = np.array([ppc.neglected_term(v, a, slip) for v in speed]) * 60.35 * speed / 0.43**2
    plots.lines({"held by the law": (speed, budget), "vehicle's motion, if left out":
                 (speed, own / 1e3)}, ("speed", "m/s"), ("error of the adhesion force", "kN"),
                axis=axes[0, 1], title="budget over speed", marks={})  # fmt: skip
    return fig


def barrier_map(r: Results) -> Any:
    """Periods and disturbances that the printed barrier law stands, and one step of its map."""
    fig, axes = plots.panels(1, 2, height=3.4)
    numbers = {"k": 1200.0, "k_a": 1.22986, "k_s": 0.02}
    T, W = np.linspace(5e-6, 7e-4, 160), np.linspace(1e-5, 3e-2, 200)
    chosen = {
        "small errors die out": _grid("barrier_lyapunov", numbers, "dies_out", ("T", T), ("W", W)),
        "w held, T -> 0": _grid("barrier_lyapunov", numbers, "disturbance", ("T", T), ("W", W)),
        "nothing jumps out": _grid("barrier_lyapunov", numbers, "window", ("T", T), ("W", W)),
        "sampled and disturbed": _grid("barrier_lyapunov", numbers, "together", ("T", T), ("W", W)),
    }
    both = chosen["w held, T -> 0"] & chosen["nothing jumps out"]
    shown = {"errors die out": chosen["small errors die out"], "necessary": both,
             "certified": chosen["sampled and disturbed"]}  # fmt: skip
    nested(axes[0, 0], ("T", "ms", T * 1e3), ("W", "m/s^2", W), shown,
           {"used, F_a known to 0.01 %": (0.2, 2.085e-3), "to 0.1 %": (0.2, 2.085e-2)}, log="",
           title="printed shape, k = 1200")  # fmt: skip
    axes[0, 0].set_ylim(0, 0.03)
    e = np.linspace(-1.2298, 0.0199, 400)
    curves = {}
    for period in (2e-4, 3.1e-4, 1e-3):
        width = np.where(e < 0, 1.22986, 0.02)
        nxt = e - period * np.array([barrier.pull(a, 1200.0, b)
                                     for a, b in zip(e, width, strict=True)])  # fmt: skip
        curves[f"T = {period * 1e3:g} ms"] = (e, nxt)
    plots.lines(curves, ("error", "m/s"), ("error one tick later", "m/s"), axis=axes[0, 1],
                title="one tick without disturbance")  # fmt: skip
    with plots.style():
        axes[0, 1].axhline(0.02, color=plots.BLACK, lw=0.8, ls="--")
        axes[0, 1].text(-1.2, 0.04, "barrier", fontsize=7)
    return fig


def seeker_map(r: Results) -> Any:
    """Where the sliding-mode seeker slides, and where only its average climbs."""
    fig, axes = plots.panels(1, 1, height=3.4)
    k, rho = np.geomspace(0.05, 5, 300), np.geomspace(0.01, 3, 300)
    dry, wet = (steepest_slope(**SURFACES[n]) for n in ("dry", "wet"))
    slides = rho[:, None] < dry * k[None, :]
    nested(axes[0, 0], ("k", "m/s^2", k), ("rho", "1/s", rho), {"slides on dry rail": slides,
           "and on wet rail": rho[:, None] < wet * k[None, :]},
           {"used: 1, 0.1": (1.0, 0.1), "printed: 1, 1": (1.0, 1.0)},
           title="sliding-mode seeker")  # fmt: skip
    with plots.style():
        grid = 0.02 * k[None, :] / rho[:, None]
        lines = axes[0, 0].contour(k, rho, grid, levels=[0.02, 0.1, 0.5], colors=[plots.ORANGE],
                                   linewidths=0.9, linestyles="--")  # fmt: skip
        axes[0, 0].clabel(lines, fmt="ripple %g m/s", fontsize=6)
    return fig


def lyapunov(r: Results) -> Any:
    """V of each proof along a disturbed run, and V' where it claims to be negative."""
    found = [*gain_bounds_runs.runs(True), gain_bounds_runs.in_the_loop(r.log("base", "sta"))]
    fig, axes = plots.panels(4, 2, height=1.85)
    for axis, run in zip(axes.flat, found, strict=False):
        with plots.style():
            _covered(axis, run.t, np.maximum(run.V, 1e-12), plots.BLUE)
            _covered(axis, run.t, np.where(run.where, run.V, np.nan), plots.ORANGE)
            axis.set_yscale("log")
            axis.set_title(f"{run.name}\n{run.source}", fontsize=7.5)
            axis.set_xlabel(plots.label("time", "s"))
            axis.set_ylabel("V")
    with plots.style():
        last = axes.flat[7]
        last.plot([], [], color=plots.BLUE, label="V")
        last.plot([], [], color=plots.ORANGE, lw=2.2, label="where the proof claims V' < 0")
        last.legend()
    return fig


def _covered(axis: Any, t: np.ndarray, V: np.ndarray, hue: str) -> None:
    """Largest V of each part of the time as a line, over what V covers there."""
    edges = np.linspace(0, len(t), min(150, len(t)) + 1).astype(int)[:-1]
    low, high = np.fmin.reduceat(V, edges), np.fmax.reduceat(V, edges)
    axis.fill_between(t[edges], low, high, color=hue, alpha=0.2, lw=0, zorder=1.5)
    axis.plot(t[edges], high, color=hue, lw=2.2 if hue == plots.ORANGE else 1.4)


def sampled(r: Results) -> Any:
    """Sliding error of three discretisations over the period."""
    found = r.table("amplitudes", "error")
    T = np.array(found["period"])
    curves = {k: (T, np.array(found[k])) for k in ("explicit", "implicit", "proper implicit")}
    curves["L T^2"] = (T, T**2)
    return plots.lines(curves, ("period", "s"), ("sliding error", "m/s"), log="xy", points=True)


def slip(r: Results) -> Any:
    """Slip of both super-twisting gains beside that of the reaching law, whole and close up."""
    fig, axes = plots.panels(2, 2, height=2.1)
    for row, loop in zip(axes, ("sta", "sta_printed"), strict=True):
        whole, close = {}, {}
        for k in ("smc", loop):
            log = r.log("base", k)
            t, v_s = log["time"].values, log["plant.wheel.v_s"].values
            near = (t >= 0.5) & (t < 0.53)
            whole[k], close[k] = (t, v_s), (t[near], v_s[near])
        plots.chatter(row[0], whole, ("slip speed", "m/s"), "mean and range", columns=100)
        plots.lines(close, ("time", "s"), ("slip speed", "m/s"), axis=row[1], title="close up")
    return fig


DRAWN: dict[str, tuple[str, Callable[[Results], Any]]] = {
    "twisting_map": (
        "Super-twisting: nested criteria; reaching time, chattering and what is feasible at 1 ms.",
        twisting_map),
    "traction_map": (
        "Adhesion observer over its gains, and the disturbance slope that the adaptive law stands.",
        traction_map),
    "funnel_map": (
        "Prescribed performance, sampled: disturbance over gain, and the adhesion budget.",
        funnel_map),
    "barrier_map": (
        "Barrier law: disturbance and period that it stands, and one tick of its map.",
        barrier_map),
    "seeker_map": (
        "Sliding-mode seeker: where it slides; dashed: ripple at the peak for beta = 0.02.",
        seeker_map),
    "lyapunov": (
        "Lyapunov functions of the proofs along runs with disturbances within their bounds.",
        lyapunov),
    "sampled": ("Sliding error of super-twisting over the sample period.", sampled),
    "slip": ("Slip of the subway train on dry rail with three sets of gains.", slip),
}  # fmt: skip
"""Caption and function of each figure."""
