"""Leaves on the rail: does the estimate come back afterwards, on seeds that chose no setting?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slipctl import Block, Context, Rail, Scenario, Section, Table, simulate
from slipctl.models.huang_2020.subway_braking import double_exponential, peak_slip
from slipctl.studies.subway_braking.loops import H, real_online

LEAVES = {"c": 0.1048, "a": 1.0710, "b": 2.3801}
"""Peak of .030 at .61 m/s."""

VEHICLE = {"m": 11e3, "J": 120.0, "r": 0.42, "v_start": 45.0}
"""None of the study's: the noise of its meter is .08, of a peak of .286."""

CHOSEN, HELD_OUT = range(1, 13), range(201, 241)
"""Seeds on which the settings of estimator and detector were chosen, and seeds that judge them."""

NEAR, USE = 0.2, 0.96
"""Share of the best slip within which the estimate has come back, and of the adhesion then used."""

START, LATE = 3.0, 9.0
"""Time in s at which each rail begins, and from which the adhesion counts."""


def run(loop: Block, seed: int, compile: bool = True) -> tuple[float, float]:
    """Estimated best slip at the end by the true one; mean adhesion after leaves by its peak."""
    dry = double_exponential.conditions["dry"]
    rail = Rail([
        Section(START * k, None, {f"plant.adh.{n}": v for n, v in r.items()}
                | {"v_opt": float(peak_slip(**r))})
        for k, r in enumerate((dry, LEAVES, dry))
    ])  # fmt: skip
    scenario = Scenario("leaves", 12.0, rail, params=VEHICLE, seed=seed)
    log = simulate(loop, scenario, compile=compile)
    slip, best = log["plant.wheel.v_s"].values[round(LATE / H) :], float(peak_slip(**dry))
    held = np.mean(np.exp(-dry["a"] * slip) - np.exp(-dry["b"] * slip))
    peak = math.exp(-dry["a"] * best) - math.exp(-dry["b"] * best)
    return float(log["ctl.search.best"].values[-1]) / best, float(held) / peak


def leaves(context: Context) -> Table:
    """Share of the seeds on which the estimate comes back, chosen and held out."""
    loop = real_online(context.models | {"adh": double_exponential}, context.models["sta"])
    many = 1 if context.quick else None
    groups = {"chosen on": CHOSEN[:many], "held out": HELD_OUT[:many]}
    jobs = [(name, seed) for name, seeds in groups.items() for seed in seeds]

    def work(job: tuple[str, int]) -> list[float]:
        return list(run(loop, job[1], context.compile))

    done = dict(zip(jobs, context.each("leaves", jobs, work), strict=True))
    rows: dict[str, list[Any]] = {k: [] for k in ("seeds", "many", "back", "used", "low", "least")}
    for name in groups:
        found = np.array([v for j, v in done.items() if j[0] == name])
        back = np.abs(found[:, 0] - 1) <= NEAR
        values = (name, len(found), 100 * float(back.mean()),
                  100 * float((found[:, 1] >= USE).mean()),
                  float(found[:, 0].min()), float(found[:, 1].min()))  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return Table(
        "After leaves, with real sensors",
        {
            "seeds": ("", rows["seeds"]),
            "how many": ("1", rows["many"]),
            "estimate within a fifth at the end": ("%", rows["back"]),
            "96 % of the adhesion used, or more": ("%", rows["used"]),
            "least estimate, of the best slip": ("1", rows["low"]),
            "least adhesion used": ("1", rows["least"]),
        },
        "3 s dry, 3 s of leaves, 6 s dry; the adhesion counts over the last 3 s.",
    )
