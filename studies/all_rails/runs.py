"""Monte Carlo of the study ``all_rails``: many draws, one optimum each, and what a tick costs."""

from __future__ import annotations

import hashlib
import math
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from slipctl import Block, Context, Experiment, Table, __version__, simulate, trajectory
from slipctl.ccode.codegen import c_module
from slipctl.ccode.compile.compilers import sizes
from slipctl.run import build
from slipctl.studies.all_rails.fair import fair
from slipctl.studies.all_rails.loops import (
    LOG,
    NAMES,
    NOMINAL,
    PAPERS,
    VEHICLES,
    Draw,
    H,
    best,
    drawn,
    loops,
    scenario,
)
from slipctl.studies.all_rails.tracking import tracking

SEEDS = 10
"""Seeds of the full study."""

FIRST = 101
"""First seed: what was chosen here was chosen on seeds 1 to 10."""

SLIDE = 2.0
"""Slip over the best one from which on a wheel counts as sliding."""


# ---- one run -------------------------------------------------------------------------------------


def distance(log: Any) -> float:
    """Distance in m at the end of the run; the log ends a tick before."""
    v = log["world.v_true"].values
    return float(log["world.x_true"].values[-1] + (1.5 * v[-1] - 0.5 * v[-2]) * H)


def longest(flags: np.ndarray) -> int:
    """Longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def outcome(vehicle: str, rail: str, log: Any) -> dict[str, float]:
    """Numbers of a run: distance, longest slide, torque ripple, largest slip over the best."""
    v = VEHICLES[vehicle]
    ticks = round(v.length / H)
    places = np.repeat([best(vehicle, c)[0] for c in v.rails[rail]], ticks)[: len(log["time"])]
    if v.slip == "lam":
        places = places * log["world.v_true"].values
    over, torque = log["world.slip_true"].values / places, log["world.T"].values
    ends = [slice(ticks * (k + 1) - round(0.5 / H), ticks * (k + 1)) for k in range(3)]
    return {
        "distance": distance(log),
        "slide": longest(over > SLIDE) * H,
        "over": float(over.max()),
        "ripple": float(np.mean([np.ptp(torque[s]) for s in ends]) / v.wheel.T_max),
    }


def run(
    context: Context, vehicle: str, rail: str, name: str, block: Block, seed: int, draw: Draw
) -> dict[str, Any]:
    """Run a loop on a draw, or read what an earlier start has found."""

    def compute() -> dict[str, float]:
        log = simulate(block, scenario(vehicle, rail, seed, draw), compile=context.compile, log=LOG)
        return outcome(vehicle, rail, log)

    what = {"what": "run", "vehicle": vehicle, "rail": rail, "controller": name, "seed": seed}
    return context.kept(what | told(block, draw), compute)


def told(block: Block, draw: Sequence[Any]) -> dict[str, Any]:
    """What else a result depends on: the equations, their numbers, the draw, the version."""
    values = {n: np.asarray(v).tolist() for n, v in block.param_values().items()}
    f = hashlib.sha256(block.f.serialize().encode()).hexdigest()
    return {"f": f, "parameters": values, "draw": list(draw), "version": __version__}


# ---- the optimum ---------------------------------------------------------------------------------


def as_guess(vehicle: str, log: Any) -> xarray.Dataset:
    """Log of a loop as a run of the plant alone."""
    v = VEHICLES[vehicle]
    names = {f"world.plant.{n}": n for n in v.plant().states}
    guess = log[list(names)].rename(names)
    return guess.assign(T_cmd=log["limits.T_cmd"] / v.unit)


def optimum(vehicle: str, rail: str, draw: Draw, guesses: Sequence[Any]) -> dict[str, Any]:
    """Optimal control bound of a draw: distance in m, its meshes, and where each guess leads."""
    v, world = VEHICLES[vehicle], scenario(vehicle, rail, draw=draw, of="")
    lo, hi = sorted((0.0, v.wheel.T_max / v.unit))
    inside = 1e-6 * (hi - lo)  # the actuator's own limits have no derivative
    sign = "-" if v.driven else ""
    found = trajectory(
        v.plant(), world, "T_cmd", f"{sign}{v.position}",
        bounds={"T_cmd": (lo + inside, hi - inside)}, limits=v.limits,
        guesses=[as_guess(vehicle, g) for g in guesses],
    )  # fmt: skip
    return {
        "distance": abs(found.value), "change": abs(found.meshes[-1][1] - found.meshes[-2][1]),
        "starts": [abs(s) for s in found.starts],
    }  # fmt: skip


def optimum_of(
    context: Context, vehicle: str, rail: str, draw: Draw, blocks: dict[str, Block],
    names: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """Optimum, started from silent runs of these loops, or read again."""

    def compute() -> dict[str, Any]:
        wanted = scenario(vehicle, rail, draw=draw).but(noise=0.0)
        states = [f"world.plant.{n}" for n in VEHICLES[vehicle].plant().states]
        logs = [
            simulate(blocks[n], wanted, compile=context.compile, log=[*states, "limits.T_cmd"])
            for n in names
        ]
        return optimum(vehicle, rail, draw, logs)

    plant = VEHICLES[vehicle].plant()
    what = {"what": "optimum", "vehicle": vehicle, "rail": rail, "from": list(names)}
    return context.kept(what | told(plant, draw), compute)


# ---- experiments ---------------------------------------------------------------------------------


def shown(context: Context) -> list[tuple[str, str]]:
    """Vehicles and rails of the cases."""
    return [tuple(c.scenario.name.split("_", 1)) for c in context.cases]  # type: ignore[misc]


def regret(vehicle: str, distance: float, best: float) -> float:
    """What is lost against the optimum in m, not negative where nobody beats it."""
    return (best - distance) if VEHICLES[vehicle].driven else distance - best


def seeds(context: Context) -> dict[str, Table]:
    """Every controller on every draw, against the optimum of that draw."""
    count = 2 if context.quick else SEEDS
    pairs = shown(context)
    rows: dict[str, list[Any]] = {
        k: [] for k in ("vehicle", "rail", "loop", "mean", "deviation", "worst", "slide", "over",
                        "ripple", "behind")
    }  # fmt: skip
    draws: dict[str, list[Any]] = {k: [] for k in ("vehicle", "rail", "seed", *NAMES)}
    duel: dict[str, list[Any]] = {
        k: [] for k in ("vehicle", "rail", "rival", "lead", "error", "ahead")
    }
    checks: dict[str, list[Any]] = {k: [] for k in ("vehicle", "rail", "least", "change")}
    blocks = {vehicle: loops(vehicle) for vehicle in dict.fromkeys(v for v, _ in pairs)}
    for block in (b for ours in blocks.values() for b in ours.values()):
        _ = block.f  # built once, before the processes part

    def work(what: Sequence[Any]) -> dict[str, Any]:
        """All controllers on one draw, and the optimum of the draw, from the best of them."""
        vehicle, rail, seed = what
        draw, ours = drawn(vehicle, rail, seed), blocks[vehicle]
        ran = {n: run(context, vehicle, rail, n, ours[n], seed, draw) for n in NAMES}
        sign = -1 if VEHICLES[vehicle].driven else 1
        nearest = min(NAMES, key=lambda n: sign * ran[n]["distance"])
        return {"runs": ran, "bound": optimum_of(context, vehicle, rail, draw, ours, (nearest,))}

    wanted = [(*pair, seed) for pair in pairs for seed in range(FIRST, FIRST + count)]
    outcomes = dict(zip(wanted, context.each("draws", wanted, work), strict=True))
    for vehicle, rail in pairs:
        found: dict[str, list[dict[str, Any]]] = {n: [] for n in NAMES}
        lost: dict[str, list[float]] = {n: [] for n in NAMES}
        change = 0.0
        for seed in range(FIRST, FIRST + count):
            ran, bound = (outcomes[vehicle, rail, seed][k] for k in ("runs", "bound"))
            change = max(change, bound["change"])
            for n in NAMES:
                found[n].append(ran[n])
                lost[n].append(regret(vehicle, ran[n]["distance"], bound["distance"]))
            row = (vehicle, rail, seed, *(lost[n][-1] for n in NAMES))
            for key, value in zip(draws, row, strict=True):
                draws[key].append(value)
        lowest = min(float(np.mean(lost[n])) for n in NAMES)
        for n in NAMES:
            values = (
                vehicle, rail, n, float(np.mean(lost[n])), float(np.std(lost[n])), max(lost[n]),
                max(f["slide"] for f in found[n]), max(f["over"] for f in found[n]),
                100 * float(np.mean([f["ripple"] for f in found[n]])),
                float(np.mean(lost[n])) - lowest,
            )  # fmt: skip
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
        rival = min(PAPERS, key=lambda n: float(np.mean(lost[n])))
        lead = np.array(lost[rival]) - np.array(lost["nmpc"])
        error = float(np.std(lead, ddof=1) / math.sqrt(count))
        ahead = sum(lost["nmpc"][k] < min(lost[n][k] for n in PAPERS) for k in range(count))
        row = (vehicle, rail, rival, float(lead.mean()), error, ahead)
        for key, value in zip(duel, row, strict=True):
            duel[key].append(value)
        values = (vehicle, rail, min(min(lost[n]) for n in NAMES), change)
        for key, value in zip(checks, values, strict=True):
            checks[key].append(value)
    return {
        "regret": Table(
            "Regret: distance lost against the optimal control bound",
            {
                "vehicle": ("", rows["vehicle"]),
                "rail": ("", rows["rail"]),
                "loop": ("", rows["loop"]),
                "mean regret": ("m", rows["mean"]),
                "standard deviation": ("m", rows["deviation"]),
                "worst regret": ("m", rows["worst"]),
                "behind the best": ("m", rows["behind"]),
                "longest slide": ("s", rows["slide"]),
                "largest slip over the best": ("1", rows["over"]),
                "ripple of the torque, of its limit": ("%", rows["ripple"]),
            },
            f"{count} seeds, the same draws for every loop: mass +-10 %, adhesion of each section"
            " 0.8 to 1.1, lag 0.7 to 1.4 of what the controller knows, and noise. Sliding: slip"
            " above twice the best. Ripple: peak to peak over the last 0.5 s of each section.",
        ),
        "bound": Table(
            "The optimal control bound",
            {
                "vehicle": ("", checks["vehicle"]),
                "rail": ("", checks["rail"]),
                "least regret of any loop and seed": ("m", checks["least"]),
                "change on the last mesh, largest": ("m", checks["change"]),
            },
            "A negative regret would be a loop that beats what is possible.",
        ),
        "lead": Table(
            "Predictive control against the best of the papers' controllers on each rail",
            {
                "vehicle": ("", duel["vehicle"]),
                "rail": ("", duel["rail"]),
                "best of the papers": ("", duel["rival"]),
                "mean lead of nmpc": ("m", duel["lead"]),
                "standard error": ("m", duel["error"]),
                "draws in which nmpc is ahead of all": ("1", duel["ahead"]),
            },
            f"Draw by draw, {count} draws; a lead of less than two standard errors is none.",
        ),
        "draws": Table(
            "Regret of each draw",
            {
                "vehicle": ("", draws["vehicle"]),
                "rail": ("", draws["rail"]),
                "seed": ("1", draws["seed"]),
                **{n: ("m", draws[n]) for n in NAMES},
            },
            "A row per draw: what the spread of the other table is made of.",
        ),
    }


def guesses(context: Context) -> Table:
    """Where the optimum ends from the run of each loop."""
    rows: dict[str, list[Any]] = {k: [] for k in ("scenario", "distance", "low", "high", "lost")}
    pairs = shown(context)
    for k, (vehicle, rail) in enumerate(pairs):
        found = optimum_of(context, vehicle, rail, NOMINAL, loops(vehicle), NAMES)
        ends = [s for s in found["starts"] if s is not None]
        least, most = min(ends), max(ends)
        values = (f"{vehicle}_{rail}", found["distance"], least, most, len(NAMES) - len(ends))
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
        context.progress((k + 1) / len(pairs))
    return Table(
        "The optimum on the first mesh, started from the run of each loop",
        {
            "scenario": ("", rows["scenario"]),
            "optimum": ("m", rows["distance"]),
            "shortest distance from a guess": ("m", rows["low"]),
            "longest distance from a guess": ("m", rows["high"]),
            "guesses from which IPOPT finds nothing": ("1", rows["lost"]),
        },
        "Nominal plant, silent runs; the last mesh starts from the best of the first.",
    )


def cost(context: Context) -> Table:
    """Time of a tick and bytes of C of each law."""
    rows: dict[str, list[Any]] = {k: [] for k in ("loop", "tick", "text", "state")}
    vehicle = shown(context)[0][0]
    blocks = loops(vehicle)
    for k, n in enumerate(NAMES):
        block = blocks[n]["law"]
        rows["loop"].append(n)
        rows["tick"].append(1e6 * tick_time(block, blocks[n], vehicle, context))
        text, state = c_size(block)
        rows["text"].append(text)
        rows["state"].append(state)
        context.progress((k + 1) / len(NAMES))
    return Table(
        f"What a law costs, of the loops of {vehicle}",
        {
            "loop": ("", rows["loop"]),
            "mean time of a tick": ("us", rows["tick"]),
            "text of its C, in float": ("bytes", rows["text"]),
            "state of an instance": ("bytes", rows["state"]),
        },
        "Estimator and sensors, the same for all, are not counted. This machine, compiled with"
        f" {' '.join(build.FLAGS[:1])}; nmpc solves every 5th tick, its time is the mean. The"
        " times depend on the machine and are no result of the run.",
    )


def tick_time(block: Block, loop: Block, vehicle: str, context: Context) -> float:
    """Mean time in s of a tick of a law along its own run, the median of five."""
    roll = build.make_roller(block.f, context.compile)
    first = next(iter(VEHICLES[vehicle].rails))
    names = {n: f"world.{n}" for n in block.inputs if f"world.{n}" in loop.outputs}
    log = simulate(
        loop, scenario(vehicle, first).but(duration=1.0), compile=context.compile,
        log=list(names.values()),
    )  # fmt: skip
    u = np.column_stack(
        [log[names[n]].values if n in names else np.full(len(log["time"]), float(s.value or 0.0))
         for n, s in block.inputs.items()]
    )  # fmt: skip
    u = np.ascontiguousarray(u, dtype=float)
    x0 = np.array(block.pack("state", block.start()), dtype=float).ravel()
    p = np.array(block.pack("param", block.param_values()), dtype=float).ravel()
    times = []
    for _ in range(5):
        x, x_log = x0.copy(), np.empty((len(u), x0.size))
        y_log = np.empty((len(u), block.f.size1_out(1)))
        began = time.perf_counter()
        roll(x, u, p, x_log, y_log)
        times.append((time.perf_counter() - began) / len(u))
    return statistics.median(times)


def c_size(block: Block) -> tuple[int | None, int | None]:
    """Bytes of text of the C of a law in float, and of the state of an instance.

    None where there is no compiler.
    """
    if build.compiler() is None:
        return None, None
    with tempfile.TemporaryDirectory(prefix="slipctl_") as folder:
        period = None if block.period else H
        module = c_module(block, Path(folder) / "law", "law", period=period, real="float").load()
        found = sizes(module.object_file)
        return (found["text"] if found else None), module.instance_bytes


EXPERIMENTS = {
    "seeds": Experiment("Many seeds", seeds, "Who loses how much against the optimum?"),
    "tracking": Experiment(
        "Speed tracking", tracking, "And who follows a speed under the adhesion limit?"
    ),
    "guesses": Experiment("Guesses", guesses, "Is the optimum the same from every loop's run?"),
    "fair": Experiment(
        "Tuned alike", fair, "Who wins when every law is tuned by one tuner, with one budget?"
    ),
    "cost": Experiment("Cost", cost, "What does a tick cost, and how large is the C?"),
}
