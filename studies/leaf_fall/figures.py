"""Figures of the study, as a board would read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slipctl import Figure, Results
from slipctl.analysis.rail_peaks import Peaks
from slipctl.draw import plots
from slipctl.models.vehicle.adhesion import contaminated_law, rail_law
from slipctl.studies.leaf_fall.bound import RULES, Begin
from slipctl.studies.leaf_fall.claims import HARDENS, SCENARIOS
from slipctl.studies.leaf_fall.experiments import REACH, SIZES, STRENGTHS, in_leaves
from slipctl.studies.leaf_fall.trains import DRAWN, PATCH, RADIUS, RIVALS, SPEED, trip

SHOWN = ("none", "wsp_tuned", "super_twisting", "common_slip")
"""Loops of which each axle is drawn."""

BEFORE_AND_AFTER = ("wsp_tuned", "own_slip", "train", "train_ahead")
"""Loops whose slip along the train is drawn: before, and after."""

AHEAD = ("train", "train_ahead")
"""Loops of which the torque at the end of the leaves is drawn."""

CLEANINGS = {"base": "weak cleaning", "medium": "medium cleaning"}


def speeds(r: Results) -> Any:
    """Speed of the train and of every rim over time, a panel per loop; leading axles are dark."""
    fig, axes = plots.panels(2, 2, height=2.4, sharex=True, sharey=True)
    for axis, name in zip(axes.flat, SHOWN, strict=True):
        log = r.log("base", name)
        time, v = log["time"].values[::2], log["plant.train.v"].values[::2]
        rims = RADIUS * log["plant.train.omega"].values[::2]
        plots.lines({"train": (time, v)}, ("time", "s"), ("speed", "m/s"), axis=axis, title=name)
        last = rims.shape[1] - 1
        for k in range(last + 1):
            shade = 0.85 * k / last
            called = f"axle {k + 1}" if k in (0, last) else ""
            axis.plot(time, rims[:, k], color=(shade, shade, shade), lw=0.8, label=called)
    axes[0, 0].legend(ncols=3)
    return fig


def adhesion_along(r: Results) -> Any:
    """Peak adhesion that the first axle finds, and that the train leaves behind."""
    fig, axes = plots.panels(2, 1, height=2.4, sharex=True)
    for axis, (scenario, title) in zip(axes[:, 0], CLEANINGS.items(), strict=True):
        curves: dict[str, tuple[Any, Any]] = {}
        for name in ("common_slip", "super_twisting", "wsp"):
            place, before, after = adhesion_of_rail(r, scenario, name)
            curves.setdefault("before the train", (place, before))
            curves[f"behind it, {name}"] = (place, after)
        plots.lines(curves, ("place", "m"), ("peak adhesion", "1"), axis=axis, title=title)
        axis.set_xlim(PATCH[0] - 30, PATCH[1] + 30)
    return fig


def adhesion_of_rail(r: Results, scenario: str, loop: str) -> tuple[Any, Any, Any]:
    """Places in m, peak adhesion there before the train and behind it.

    What the last axle leaves is what it found and its own heat by the metre.
    """
    made, log = trip(), r.log(scenario, loop)
    law = contaminated_law(made, rail_law(made))
    peaks = Peaks(law, next(iter(law.conditions.values())), SPEED)
    v = np.maximum(log["plant.train.v"].values, 0.5)
    height = log["plant.field.height"].values
    tau = STRENGTHS[SCENARIOS[scenario]]
    W = log["plant.field.W_seen"].values[:, -1]
    W = W + log["plant.train.P_contact"].values[:, -1] / 2 / v
    foul = height[:, -1] * (log["plant.field.recovered"].values[:, -1] < 1)
    share = np.where(foul > 0, -np.expm1(-tau * W), 1.0)
    _, after = peaks.at(v, (1 - share) * foul, share)
    x = log["plant.train.x"].values
    last = x - made.vehicle.behind[-1]
    first = log["rail.best_adhesion"].values[:, 0]
    return last, np.interp(last, x, first), after


def distances(r: Results) -> Any:
    """Stopping distance of every rival, with the least possible one."""
    groups: dict[str, dict[str, float | None]] = {}
    for scenario, title in CLEANINGS.items():
        groups[title] = {n: r.metric(scenario, n, "stopping_distance") for n in RIVALS}
        least = r.table("bound", "least").where("least distance", cleaning=SCENARIOS[scenario])
        groups[title]["best of the train"] = least
    clean = r.metric("clean", "none", "stopping_distance")
    return plots.bars(groups, ("stopping distance", "m"), limit=("without leaves", clean))


def price(r: Results) -> Any:
    """Air, and the hottest contact, of every rival."""
    fig, axes = plots.panels(2, 1, height=2.4)
    air = {t: {n: r.metric(s, n, "air_used") for n in RIVALS} for s, t in CLEANINGS.items()}
    plots.bars(air, ("free air of a stop", "l"), axis=axes[0, 0])
    flash = {t: {n: r.metric(s, n, "flash_temperature") for n in RIVALS}
             for s, t in CLEANINGS.items()}  # fmt: skip
    plots.bars(flash, ("hottest contact", "K"), axis=axes[1, 0], log=True,
               limit=("steel hardens", HARDENS - 20))  # fmt: skip
    axes[1, 0].get_legend().remove()
    return fig


def slips(r: Results) -> Any:
    """Mean slip of each axle in the leaves: one for all, each axle's best, best of the train."""
    t = r.table("bound", "slips")
    fig, axes = plots.panels(1, 2, height=2.8, sharey=True)
    for axis, cleaning in zip(axes[0], dict.fromkeys(t["cleaning"]), strict=True):
        rows = [k for k, c in enumerate(t["cleaning"]) if c == cleaning]
        curves = {rule: ([t["axle"][k] for k in rows], [t[rule][k] for k in rows])
                  for rule in RULES}  # fmt: skip
        plots.lines(curves, ("axle", "1"), ("slip in the leaves", "%"), axis=axis, points=True,
                    title=f"{cleaning} cleaning", legend=axis is axes[0, 0])  # fmt: skip
    return fig


def slips_behind_valves(r: Results) -> Any:
    """Mean slip of each axle in the leaves as it ran: before and after, and the best of all."""
    fig, axes = plots.panels(1, 2, height=2.8, sharey=True)
    t = r.table("bound", "slips")
    for axis, (scenario, title) in zip(axes[0], CLEANINGS.items(), strict=True):
        curves: dict[str, tuple[Any, Any]] = {}
        for name in BEFORE_AND_AFTER:
            log = r.log(scenario, name)
            v = np.maximum(log["plant.train.v"].values, 0.5)[:, None]
            x = log["plant.train.x"].values
            means = in_leaves(log["slip.y"].values / v, x, trip(), Begin(0.0, SPEED))
            curves[name] = (range(1, len(means) + 1), means)
        rows = [k for k, c in enumerate(t["cleaning"]) if c == SCENARIOS[scenario]]
        curves["best of the train, held exactly"] = (
            [t["axle"][k] for k in rows], [t["best of the train"][k] for k in rows]
        )  # fmt: skip
        plots.lines(curves, ("axle", "1"), ("slip in the leaves", "%"), axis=axis, points=True,
                    title=title, legend=axis is axes[0, 0])  # fmt: skip
    return fig


def behind_the_leaves(r: Results) -> Any:
    """Torque of some axles where each leaves the leaves: filled behind them, and ahead."""
    fig, axes = plots.panels(1, 2, height=2.8, sharey=True)
    behind = trip().vehicle.behind
    for axis, name in zip(axes[0], AHEAD, strict=True):
        log = r.log("base", name)
        x, T = log["plant.train.x"].values, log["plant.T"].values / 1e3
        curves = {}
        for k in (0, 2, 4, 7):
            at = x - behind[k] - PATCH[1]
            near = (at > -15) & (at < 25)
            curves[f"axle {k + 1}"] = (at[near], T[near, k])
        plots.lines(curves, ("place behind the leaves", "m"), ("torque", "kN m"), axis=axis,
                    title=name, legend=axis is axes[0, 0])  # fmt: skip
        axis.axvline(0, color=plots.GREY, lw=0.8)
    return fig


def chance(r: Results) -> Any:
    """Distance of every draw beside the limit, and the hottest contact of each."""
    t = r.table("chance", "draws")
    fig, axes = plots.panels(2, 1, height=2.4)
    plots.spread({n: t[n] for n in DRAWN}, ("stopping distance", "m"), axis=axes[0, 0],
                 limit=("limit", REACH))  # fmt: skip
    plots.spread({n: t[f"flash of {n}"] for n in RIVALS}, ("hottest contact", "K"),
                 axis=axes[1, 0], log=True, limit=("steel hardens", HARDENS - 20))  # fmt: skip
    return fig


def sizes(r: Results) -> Any:
    """Stopping distance over the number of axles, leaves everywhere.

    The plan over all axles would hide the law: it is within the width of its line.
    """
    t = r.table("sizes")
    names = ("wsp_tuned", "common_slip", "own_slip", "train", "best of the train")
    fig, axes = plots.panels(1, 2, height=2.8, sharey=True)
    for axis, cleaning in zip(axes[0], dict.fromkeys(t["cleaning"]), strict=True):
        rows = [k for k, (c, where) in enumerate(zip(t["cleaning"], t["leaves"], strict=True))
                if (c, where) == (cleaning, "everywhere")]  # fmt: skip
        curves: Mapping[str, Any] = {n: ([t["axles"][k] for k in rows], [t[n][k] for k in rows])
                                     for n in names}  # fmt: skip
        plots.lines(curves, ("axles", "1"), ("stopping distance", "m"), axis=axis, points=True,
                    title=f"{cleaning} cleaning", legend=axis is axes[0, 0])  # fmt: skip
        axis.set_xticks(SIZES)
    return fig


FIGURES: Mapping[str, Figure] = {
    "speeds": Figure("Speed of the train and of every axle's rims, weak cleaning.", speeds),
    "adhesion": Figure("Adhesion along the track, before the train and behind it.",
                       adhesion_along),
    "distances": Figure("Stopping distance, with the least possible one and that without leaves.",
                        distances),
    "price": Figure("What a stop takes: free air of all cylinders, and the hottest contact of a"
                    " wheel above the temperature of wheel and rail.", price),
    "slips": Figure("Mean slip of each axle in the leaves, slips held exactly: axle 1 leads.",
                    slips),
    "train": Figure("Mean slip of each axle in the leaves, behind valves: before (slide protection,"
                    " each axle's own peak) and after (the law of the whole train). Axle 1 leads.",
                    slips_behind_valves),
    "ahead": Figure("Torque where an axle comes out of the leaves, weak cleaning: it fills from"
                    " there on, or before, as leading axles have seen the place.",
                    behind_the_leaves),
    "chance": Figure("Leaves by chance: every draw a dot, the middle half a box, the median a"
                     " line.", chance),
    "sizes": Figure("Leaves everywhere: the longer the train, the more its first axles clean for"
                    " the rest.", sizes),
}  # fmt: skip
