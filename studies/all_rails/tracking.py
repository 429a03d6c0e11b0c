"""Speed tracking of a train under its adhesion limit: predictive control beside the laws of 2025.

The train of ``hst_traction`` follows a speed; its anti-slip limit, the same for every law, says how
much force the rail carries. So this is a comparison of tracking laws, not of slip laws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from slipctl import Block, Context, Rail, Scenario, Section, Table, simulate
from slipctl.models.predictive.predictive_speed import predictive_speed
from slipctl.models.wheel_rail.contact import patch, polach
from slipctl.studies.hst_traction import loops as train
from slipctl.studies.hst_traction.regret import smallest_error

START, LENGTH = 105.0, 30.0
"""Part of the paper's run in s: 10 s before the ice to 15 s after it."""

TARGETS = {"half": 0.5, "stress": 0.85}
"""Targets by the share of the tractive effort that they need."""

SEEDS = 5
MASS = 500e3
PER_AXLE, RADIUS, GRAVITY = 15625.0, 0.445, 9.8
LAG = 0.05
"""Time constant of the motors in s, as the study has it."""


class Draw(NamedTuple):
    """Factors on mass, on the adhesion of each surface, and on the lag of the motors."""

    mass: float
    heights: tuple[float, ...]
    lag: float


def drawn(target: str, seed: int) -> Draw:
    """Draw of a seed, the same for every law: as :func:`all_rails_loops.drawn` has it."""
    rng = np.random.default_rng([seed, 9, list(TARGETS).index(target)])
    mass, lag = rng.uniform(0.9, 1.1), rng.uniform(0.7, 1.4)
    return Draw(mass, tuple(rng.uniform(0.8, 1.1, 5)), lag)


def surfaces(draw: Draw) -> list[tuple[float, str, dict[str, float]]]:
    """Start in s, name and parameters of each surface of the part."""
    found = []
    for (name, _), height in zip(train.RAIL, draw.heights, strict=True):
        begin = next((s.start for s in train.rail_by_time(START).sections if s.condition == name),
                     None)  # fmt: skip
        if begin is not None and begin < LENGTH:
            p = dict(polach.conditions[name])
            found.append((begin, name, p | {"mu_0": height * p["mu_0"]}))
    return found


def scenario(target: str, draw: Draw) -> Scenario:
    """Part of the run with what the controller does not know."""
    wanted = train.target(TARGETS[target])
    rail = Rail([Section(t, n, {"plant.train.adh.mu_0": p["mu_0"]}) for t, n, p in surfaces(draw)])
    params: dict[str, Any] = {"plant.m": draw.mass * MASS, "tau": draw.lag * LAG}
    # a heavier train has a larger contact patch; the controller does not know it
    contact = patch(draw.mass * PER_AXLE * GRAVITY / 2, RADIUS)
    params |= {f"plant.train.adh.{n}": contact[n] for n in ("a", "b", "c11")}
    # the load of an axle follows from the mass, wherever it stands, if it is not set apart
    params |= {"ctl.m_axle": PER_AXLE, "ctl.usable.axle.curves.Q": PER_AXLE * GRAVITY / 2}
    return Scenario(target, LENGTH, rail, wanted.feeds(START), wanted.at(START), params)


def relaxed(target: str, draw: Draw) -> float:
    """Smallest rms speed error in m/s on a draw; see :func:`smallest_error`."""
    wanted = train.target(TARGETS[target])
    return smallest_error(wanted, surfaces(draw), START, LENGTH, draw.mass)


def loops(quick: bool) -> dict[str, Block]:
    """Every law of the study ``hst_traction`` with the limit, and predictive control."""
    models: Mapping[str, Any] = train.MODELS
    names = ("hosm", "pid") if quick else train.NAMES
    laws = {n: models[n] for n in names} | {"nmpc": predictive_speed()}
    return {n: train.loop(models, b) for n, b in laws.items()}


LOG = ("v_d", "x_d", "plant.train.x", "plant.train.v", "worst.highest", "ctl.F_contr")


def outcome(log: Any) -> dict[str, float]:
    """Numbers of a run."""
    speed = log["plant.train.v"].values - log["v_d"].values
    place = log["plant.train.x"].values - log["x_d"].values
    force = log["ctl.F_contr"].values
    return {
        "speed": float(np.sqrt(np.mean(speed**2))), "place": float(np.abs(place).max()),
        "creep": float(log["worst.highest"].values.max()),
        "variation": float(np.abs(np.diff(force)).sum() / LENGTH),
    }  # fmt: skip


def tracking(context: Context) -> Table:
    """Each law on each draw, against the relaxed bound of the draw."""
    from slipctl.studies.all_rails.runs import told

    blocks, count = loops(context.quick), 1 if context.quick else SEEDS
    keys = ("target", "law", "speed", "above", "worst", "place", "creep", "variation")
    rows: dict[str, list[Any]] = {k: [] for k in keys}

    draws = {t: [drawn(t, seed) for seed in range(1, count + 1)] for t in TARGETS}
    bounds = {t: [relaxed(t, d) for d in draws[t]] for t in TARGETS}

    def work(what: Sequence[str]) -> list[dict[str, float]]:
        target, n = what
        return [one(target, n, seed, draw) for seed, draw in enumerate(draws[target], 1)]

    def one(target: str, n: str, seed: int, draw: Draw) -> dict[str, float]:
        def compute() -> dict[str, float]:
            return outcome(
                simulate(
                    blocks[n], scenario(target, draw), compile=context.compile, log=LOG,
                    every=train.ROW,
                )
            )  # fmt: skip

        what = {"what": "tracking", "target": target, "controller": n, "seed": seed}
        return context.kept(what | told(blocks[n], draw), compute)

    for block in blocks.values():
        _ = block.f  # built once, before the processes part
    wanted = [(t, n) for t in TARGETS for n in blocks]
    for (target, n), found in zip(wanted, context.each("laws", wanted, work), strict=True):
        above = [f["speed"] - b for f, b in zip(found, bounds[target], strict=True)]
        values = (
            target, n, float(np.mean([f["speed"] for f in found])), float(np.mean(above)),
            max(above), max(f["place"] for f in found), max(f["creep"] for f in found),
            float(np.mean([f["variation"] for f in found])) / 1e3,
        )  # fmt: skip
        for key, value in zip(keys, values, strict=True):
            rows[key].append(value)
    return Table(
        "Speed tracking onto ice under the anti-slip limit, against the relaxed bound",
        {
            "target": ("", rows["target"]),
            "law": ("", rows["law"]),
            "rms speed error": ("m/s", rows["speed"]),
            "mean above the bound": ("m/s", rows["above"]),
            "most above the bound": ("m/s", rows["worst"]),
            "largest position error": ("m", rows["place"]),
            "largest creep": ("m/s", rows["creep"]),
            "variation of the command": ("kN/s", rows["variation"]),
        },
        f"{count} seeds: mass +-10 %, adhesion of each surface 0.8 to 1.1, motor lag 0.7 to 1.4;"
        f" {LENGTH:g} s from {START:g} s on. Bound: adhesion at its peak whenever it is needed, no"
        " lag. Targets need 0.5 and 0.85 of the tractive effort.",
    )
