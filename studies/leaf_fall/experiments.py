"""What is no run of one loop: the bound, trains of all lengths, leaves by chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slipctl import Context, Experiment, Table, simulate
from slipctl.models.vehicle import Air, SlideProtection, Trip, case
from slipctl.models.vehicle.books import TAKEN, energy_error
from slipctl.models.vehicle.contamination import patches_of_seed
from slipctl.models.wheel_rail.sliding_train import stop
from slipctl.run.sweep.spread import share_interval
from slipctl.studies.leaf_fall.bound import (
    ENDS,
    RULES,
    Begin,
    best_common_slip,
    common,
    filled_behind,
    least_distance,
    sliding_train,
    stops,
)
from slipctl.studies.leaf_fall.errors import errors, nothing
from slipctl.studies.leaf_fall.outcomes import STRENGTHS, begin_of, outcome
from slipctl.studies.leaf_fall.trains import DRAWN, RIVALS, SPEED, trip

BEST, LATE = "best of the train", "best of the train, brakes filled behind the leaves"

SIZES = (2, 4, 8, 16)
"""Numbers of axles."""

LENGTHS = {"300 m": ((60.0, 360.0),), "everywhere": ()}
"""Places of leaves by their length; none named is everywhere."""

SHORT = ("none", "wsp", "wsp_tuned", "common_slip", "own_slip", "train", "train_plan")
"""Rivals of the trains of other sizes: the others stop within metres of one of them."""

DRAWS, FIRST = 12, 1001
"""Draws of leaves by chance, and the first one's number; ``tune`` has others."""

REACH = 500.0
"""Stopping distance in m that leaves by chance may not exceed: a limit of ours, as an example."""


def bound(context: Context) -> dict[str, Table]:
    """Stops of slips that are held exactly, of each axle's best and of the best of the train."""
    rows: dict[str, list[Any]] = {k: [] for k in ("cleaning", "rule", "distance", "t_gamma")}
    slips: dict[str, list[Any]] = {k: [] for k in ("cleaning", "axle", *RULES)}
    least, ratios, begin = [], [], begin_of(8)
    cell = 2.0 if context.quick else 0.25
    for k, (name, tau) in enumerate(STRENGTHS.items()):
        made = trip(tau=tau)
        found = stops(made, begin, cell)
        ratios.append(best_common_slip(made, begin))
        train = sliding_train(made, begin)
        alike = stop(train, common(train, ratios[-1]), begin.speed, cell)
        late = stop(train, filled_behind(made, train, RULES[BEST](train)), begin.speed, cell)
        for rule, run in {**found, "best slip for all": alike, LATE: late}.items():
            left = made.vehicle.gravity * 6e3 * run.f * run.e  # of a wheel of 6 t, by the metre
            row = (name, rule, begin.place + run.distance, float(left.max()))
            for key, value in zip(rows, row, strict=True):
                rows[key].append(value)
        means = {rule: in_leaves(run.e, run.x, made, begin) for rule, run in found.items()}
        for axle in range(8):
            for key, value in zip(slips, (name, axle + 1, *(m[axle] for m in means.values())),
                                  strict=True):  # fmt: skip
                slips[key].append(value)
        least.append(begin.place + found["best of the train"].distance if context.quick
                     else least_distance(made, begin))  # fmt: skip
        context.progress((k + 1) / len(STRENGTHS))
    return {
        "distances": Table(
            "Slips held exactly: what a choice of slips is worth",
            {
                "cleaning": ("", rows["cleaning"]),
                "slips": ("", rows["rule"]),
                "stopping distance": ("m", rows["distance"]),
                "largest energy into a contact": ("N", rows["t_gamma"]),
            },
            "No valves, no estimate; from where the cylinders are full.",
        ),
        "least": Table(
            "Least stopping distance over the slips of all axles at all places",
            {
                "cleaning": ("", list(STRENGTHS)),
                "least distance": ("m", least),
                "best slip for all axles": ("%", [100 * r for r in ratios]),
            },
            "Slip of at most 30 %; a nonlinear program over all axles and cells.",
        ),
        "slips": Table(
            "Mean slip of each axle in the leaves, slips held exactly",
            {
                "cleaning": ("", slips["cleaning"]),
                "axle": ("1", slips["axle"]),
                **{rule: ("%", slips[rule]) for rule in RULES},
            },
            "Axle 1 leads.",
        ),
    }


def in_leaves(slip: np.ndarray, x: np.ndarray, made: Trip, begin: Begin) -> list[float]:
    """Mean slip of each axle in percent while it is in the leaves.

    Args:
        slip: slip ratio, shape (steps, axles).
        x: place of the first axle since the brakes were full. made: the trip. begin: where that is.
    """
    layer = made.rail.contamination
    assert layer is not None  # every trip of the study has leaves
    found = []
    for k, behind in enumerate(made.vehicle.behind):
        at = x + begin.place - behind
        there = np.any([(at >= p.begin) & (at < p.end) for p in layer.places], axis=0)
        found.append(100 * float(slip[there, k].mean()) if there.any() else float("nan"))
    return found


def sizes(context: Context) -> Table:
    """Rivals on trains of all lengths, on short and long leaves, cleaned weakly and better."""
    small = context.quick
    grid = [(axles, strength, length)
            for axles in (SIZES[:1] if small else SIZES)
            for length in (list(LENGTHS)[:1] if small else LENGTHS)
            for strength in STRENGTHS]  # fmt: skip

    def work(what: Sequence[Any]) -> dict[str, Any]:
        """All rivals and the bound of one train on one rail."""
        axles, strength, length = what
        made = trip(axles, STRENGTHS[strength], LENGTHS[length],
                    rivals={n: RIVALS[n] for n in SHORT})  # fmt: skip
        found = case(made)
        ran = {n: outcome(made, found.loops[n], found.scenario, context.compile) for n in SHORT}
        # leaves under the train at its start are cleaned before the cylinders are full
        begin = begin_of(axles) if LENGTHS[length] else Begin(0.0, SPEED)
        ways = {n: begin.place + s.distance
                for n, s in stops(made, begin, 0.5, ENDS).items()}  # fmt: skip
        return {"runs": ran, "ways": ways}

    done = context.each("sizes", grid, work)
    columns: dict[str, tuple[str, list[Any]]] = {
        "axles": ("1", [g[0] for g in grid]), "leaves": ("", [g[2] for g in grid]),
        "cleaning": ("", [g[1] for g in grid]),
    }  # fmt: skip
    for name in SHORT:
        columns[name] = ("m", [d["runs"][name]["stopping_distance"] for d in done])
    for rule in ENDS:
        columns[rule] = ("m", [d["ways"][rule] for d in done])
    columns["flash of none"] = ("K", [d["runs"]["none"]["flash_temperature"] for d in done])
    columns["flash of common_slip"] = (
        "K", [d["runs"]["common_slip"]["flash_temperature"] for d in done]
    )  # fmt: skip
    return Table(
        "Stopping distance by length of the train, of the leaves, and by cleaning", columns,
        "90 km/h, 12 t an axle, peak adhesion .04, air brakes with valves, estimated speed; the"
        " last two distances are of slips that are held exactly.",
    )  # fmt: skip


BOOKED = ("E_kin", "P_drive", *TAKEN)
"""Signals of the train that its energy books read."""


def energy(context: Context) -> Table:
    """What the energy books of vehicle and wheels lose, tick by tick."""
    made = trip(rivals={n: RIVALS[n] for n in ("none", "wsp", "common_slip")})
    found = case(made)
    scenario = found.scenario.but(duration=2.0) if context.quick else found.scenario

    def work(name: str) -> float:
        names = [f"plant.train.{n}" for n in BOOKED]
        log = simulate(found.loops[name], scenario, compile=context.compile, log=names)
        return float(np.abs(energy_error(log)).max())

    names = list(made.controllers)
    lost = context.each("energy", names, work)
    return Table(
        "Energy books of vehicle and wheels",
        {"loop": ("", names), "lost": ("1", lost)},
        "Kinetic energy, less the work of brakes, contacts and resistance, over that at the start.",
    )


REFERENCE = {("weak", 4): 851.0, ("weak", 8): 834.0, ("weak", 16): 811.0,
             ("medium", 4): 830.0, ("medium", 8): 797.0, ("medium", 16): 753.0}  # fmt: skip
"""Stopping distances in m of the state machine by a simulation made apart from slipctl."""


def reference(context: Context) -> Table:
    """The state machine as published, leaves everywhere, true speed: beside another simulation.

    That one has air of 5 bar without end, so there is no reservoir here.
    """
    wanted = [(s, n) for s, n in REFERENCE if not context.quick or n == 4]

    def work(what: Sequence[Any]) -> float | None:
        made = trip(what[1], STRENGTHS[what[0]], (), True, {"wsp": SlideProtection()})
        act = made.actuator
        assert isinstance(act, Air)  # all trips of the study brake by air
        found = case(replace(made, actuator=replace(act, reservoir=None, reserve=None)))
        ran = outcome(made, found.loops["wsp"], found.scenario, context.compile)
        return ran["stopping_distance"]

    found = context.each("reference", wanted, work)
    told = [REFERENCE[w] for w in wanted]
    return Table(
        "The state machine beside a simulation made apart from slipctl",
        {
            "cleaning": ("", [s for s, _ in wanted]),
            "axles": ("1", [n for _, n in wanted]),
            "stopping distance": ("m", found),
            "made apart": ("m", told),
            "apart by": ("%", [None if f is None else 100 * (f / t - 1)
                               for f, t in zip(found, told, strict=True)]),
        },
        "Leaves everywhere, true speed, air of 5 bar without end.",
    )  # fmt: skip


def chance(context: Context) -> dict[str, Table]:
    """Every rival on the same draws of leaves: places, lengths, adhesion, noise."""
    made = trip(rivals=DRAWN)
    many = 2 if context.quick else DRAWS
    found, draw = case(made), patches_of_seed(made)
    assert draw is not None  # the trip has an ensemble
    for loop in found.loops.values():
        _ = loop.f  # built once, before the processes part
    clean = found.scenario.but(duration=5.0) if context.quick else found.scenario

    def work(seed: int) -> dict[str, dict[str, float | None]]:
        scenario = clean.but(seed=seed, params={**clean.params, **draw(seed)})
        return {n: outcome(made, loop, scenario, context.compile)
                for n, loop in found.loops.items()}  # fmt: skip

    seeds = list(range(FIRST, FIRST + many))
    done = context.each("chance", seeds, work)
    return {"draws": draws_table(seeds, done), "limits": limits_table(done)}


def draws_table(seeds: list[int], done: Sequence[Mapping[str, Any]]) -> Table:
    """A row per draw: distance, flash temperature and air of every rival."""
    columns: dict[str, tuple[str, list[Any]]] = {"seed": ("1", seeds)}
    for what, metric, unit in (("", "stopping_distance", "m"), ("flash of ", "flash_temperature",
                               "K"), ("air of ", "air_used", "l")):  # fmt: skip
        for name in done[0]:
            columns[f"{what}{name}"] = (unit, [d[name].get(metric) for d in done])
    return Table("Leaves by chance, draw by draw", columns, "The same draws for every rival.")


def limits_table(done: Sequence[Mapping[str, Any]]) -> Table:
    """Share of the draws in which each rival stops within the limit, and locks no wheel."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("loop", "mean", "worst", "within", "low", "high", "locked", "flash", "air")
    }
    for name in done[0]:
        runs = [d[name] for d in done]
        ways = [np.inf if r["stopping_distance"] is None else r["stopping_distance"] for r in runs]
        within = sum(w <= REACH for w in ways)
        low, high = share_interval(within, len(ways))
        locked = sum((r["longest_lock"] or 0.0) > 0.5 for r in runs)
        row = (name, float(np.mean(ways)), max(ways), 100 * within / len(ways), 100 * low,
               100 * high, 100 * locked / len(ways), max(r["flash_temperature"] for r in runs),
               max(r["air_used"] for r in runs))  # fmt: skip
        for key, value in zip(rows, row, strict=True):
            rows[key].append(value if not isinstance(value, float) or np.isfinite(value) else None)
    return Table(
        f"Leaves by chance: {len(done)} draws, and a limit of {REACH:g} m",
        {
            "loop": ("", rows["loop"]),
            "mean distance": ("m", rows["mean"]),
            "longest distance": ("m", rows["worst"]),
            "within the limit": ("%", rows["within"]),
            "at least, 95 %": ("%", rows["low"]),
            "at most, 95 %": ("%", rows["high"]),
            "draws with a wheel locked for half a second": ("%", rows["locked"]),
            "hottest contact": ("K", rows["flash"]),
            "most air": ("l", rows["air"]),
        },
        "One to three places of 50 to 250 m with a peak adhesion of .03 to .08. A run that does"
        " not stop counts as the longest. Interval of Clopper and Pearson.",
    )


EXPERIMENTS = {
    "energy": Experiment("Energy", energy, "Is all energy accounted for?"),
    "bound": Experiment("Bound", bound, "What is the least distance, and what slips does it take?"),
    "sizes": Experiment("Sizes", sizes, "What do the length of the train and of the leaves do?"),
    "reference": Experiment("Reference", reference, "Is it what another simulation finds?"),
    "errors": Experiment("Errors", errors, "What does it cost to know less?"),
    "nothing": Experiment("No gain", nothing, "Where does it gain nothing?"),
    "chance": Experiment("Leaves by chance", chance, "How are the stops spread?"),
}
