"""What the law of the whole train loses where it knows less, and where it gains nothing at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from slipctl import Context, Table
from slipctl.models.vehicle import TrainSlip, Trip, case
from slipctl.models.vehicle.parts import Accelerometer, Controller
from slipctl.studies.leaf_fall.bound import ENDS, stops
from slipctl.studies.leaf_fall.outcomes import STRENGTHS, begin_of, outcome
from slipctl.studies.leaf_fall.trains import RIVALS, STA, WEAK, trip

FACTORS = {"strength believed 3 times": 3.0, "strength believed a third": 1 / 3}
"""Errors of the strength of the cleaning, by what they are called."""

CURVES: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "peak of the leaves believed .03": {"layer": {"mu_0": 0.03}},
    "peak of the leaves believed .06": {"layer": {"mu_0": 0.06}},
    "peak of the clean rail believed .10": {"clean": {"mu_0": 0.10}},
    "peak of the clean rail believed .25": {"clean": {"mu_0": 0.25}},
}
"""Errors of the curves that the law knows."""

BIASES = {"accelerometer reads .05 m/s^2 less": -0.05, "accelerometer reads .1 m/s^2 more": 0.1}
"""Errors of the accelerometer in m/s^2; it reads .05 more in all other runs."""

LEARNT = ", and learnt"
PLANNED = ", planned"
TRUE = "the true speed"
SMALLER = "slip of at most 20 %"
KNOWN = "as it is"


def with_law(made: Trip, **believed: Any) -> Trip:
    """A trip whose one controller is the law of the whole train."""
    return replace(made, controllers={"train": replace(STA, reference=TrainSlip(**believed))})


def variants(tau: float) -> dict[str, Trip]:
    """Trips of the law, each with one error."""
    made = trip(tau=tau)
    biased = {
        n: replace(made.sensors, accelerometer=Accelerometer(bias=b, deviation=0.02))
        for n, b in BIASES.items()
    }
    return {
        KNOWN: with_law(made),
        **{n: with_law(made, tau=k * tau) for n, k in FACTORS.items()},
        **{n + LEARNT: with_law(made, tau=k * tau, learn=True) for n, k in FACTORS.items()},
        KNOWN + PLANNED: with_law(made, plan=True),
        **{n + PLANNED: with_law(made, tau=k * tau, plan=True) for n, k in FACTORS.items()},
        **{n: with_law(made, **believed) for n, believed in CURVES.items()},
        **{n: with_law(replace(made, sensors=s)) for n, s in biased.items()},
        TRUE: with_law(trip(tau=tau, true_speed=True)),
        SMALLER: with_law(made, slip=0.2),
    }  # fmt: skip


def errors(context: Context) -> Table:
    """The law of the whole train with one error after the other."""
    cleanings = list(STRENGTHS)[:1] if context.quick else list(STRENGTHS)
    rows = [(c, n) for c in cleanings for n in variants(STRENGTHS[c])]
    rows = rows[:2] if context.quick else rows

    def work(row: tuple[str, str]) -> float | None:
        made = variants(STRENGTHS[row[0]])[row[1]]
        found = case(made)
        run = outcome(made, found.loops["train"], found.scenario, context.compile)
        return run["stopping_distance"]

    ways = context.each("errors", rows, work)
    return Table(
        "What it costs to know less",
        {
            "cleaning": ("", [c for c, _ in rows]),
            "error": ("", [n for _, n in rows]),
            "stopping distance": ("m", ways),
        },
        "The law train behind valves, one error at a time.",
    )


WHERE: Mapping[str, Any] = {
    "2 axles, medium cleaning": (2, {"tau": 1e-4}),
    "4 axles, weak cleaning": (4, {"tau": WEAK}),
    "8 axles, leaves of two layers": (8, {"tau": 6e-5, "layers": 2}),
    "8 axles, adhesion that falls steeply, weak cleaning": (8, {"numbers": {"A": 0.4}}),
}
"""Trains and leaves where little is to be gained: axles, and what the leaves are like."""

BESIDE = ("wsp_tuned", "own_slip", "train")
"""Rivals that are shown there."""


def nothing(context: Context) -> Table:
    """Trains and leaves where there is little to gain, held exactly and behind valves."""
    names = list(WHERE)[:1] if context.quick else list(WHERE)
    rivals: dict[str, Controller] = {n: RIVALS[n] for n in BESIDE}

    def work(name: str) -> dict[str, float | None]:
        axles, leaves = WHERE[name]
        made = trip(axles, rivals=rivals)
        layer = replace(made.rail.contamination, **leaves)  # type: ignore[type-var]
        made = replace(made, rail=replace(made.rail, contamination=layer))
        found, begin = case(made), begin_of(axles)
        ran = {n: outcome(made, found.loops[n], found.scenario, context.compile) for n in rivals}
        ways = {n: s.distance + begin.place for n, s in stops(made, begin, 0.5, ENDS).items()}
        return {n: r["stopping_distance"] for n, r in ran.items()} | ways

    done = context.each("nothing", names, work)
    columns: dict[str, tuple[str, list[Any]]] = {"train and leaves": ("", names)}
    columns |= {n: ("m", [d[n] for d in done]) for n in (*BESIDE, *ENDS)}
    return Table(
        "Where the whole train has little to gain", columns,
        "300 m of leaves; the last two distances are of slips that are held exactly.",
    )  # fmt: skip
