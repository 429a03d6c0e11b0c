"""Random rail sections: how often the best slip is found in time, over the noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slipctl import Block, Context, Rail, Scenario, Section, Table, simulate
from slipctl.estimate.window import smallest_shift
from slipctl.models.huang_2020.subway_braking import TABLE_1 as RAILS
from slipctl.models.huang_2020.subway_braking import double_exponential, peak_slip, wheelset
from slipctl.studies.subway_braking.loops import H, online

ESTIMATE, SLIP = (f"{what} within 5 % for good after 0.5 s" for what in ("estimate", "slip"))
REACHABLE = "the same, where a released brake lets it"
"""Columns of the table."""

LENGTH = 1.0
"""Length of a section in s."""

TIME = 0.5
"""Time in s within which the paper finds the optimum."""

NEAR = 0.05
"""Share of the best slip within which it counts as found."""

ROW = 10
"""Sections that one run drives over, from 60 m/s, so that the speed never limits the slip."""

DETECTORS = {"likelihood ratio": 32, "one residual": 1}
"""Samples in which a change is looked for, by what the detector is called."""

NOISES = (0.0, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3)
"""Standard deviations of the measured adhesion."""


def random_section(rng: np.random.Generator) -> dict[str, float]:
    """Parameters c, a, b of a rail section.

    The best slip is uniform between half and twice that of Table 1, 0.605 to 2.420 m/s. The peak is
    log-uniform between ice and dry of Table 1, 0.0287 to 0.2866. b/a is uniform from 1.5 to 4;
    Table 1 has 2.2.
    """
    first = RAILS["dry"]
    known = float(peak_slip(**first))
    low, high = (_height(**RAILS[n]) for n in ("ice", "dry"))
    place = rng.uniform(known / 2, 2 * known)
    height = math.exp(rng.uniform(math.log(low), math.log(high)))
    ratio = rng.uniform(1.5, 4.0)
    a = math.log(ratio) / (ratio - 1) / place
    rail = {"c": 1.0, "a": a, "b": ratio * a}
    return rail | {"c": height / _height(**rail)}


def _height(c: float, a: float, b: float) -> float:
    place = float(peak_slip(c, a, b))
    return c * (math.exp(-a * place) - math.exp(-b * place))


def drive(
    loop: Block, sections: list[dict[str, float]], noise: float, seed: int, compile: bool = True
) -> Any:
    """Run of a loop over sections of :data:`LENGTH`, each after the other."""
    rail = Rail([
        Section(LENGTH * k, None, {f"plant.adh.{n}": v for n, v in s.items()}
                | {"v_opt": float(peak_slip(**s))})
        for k, s in enumerate(sections)
    ])  # fmt: skip
    scenario = Scenario(
        "sections", LENGTH * len(sections), rail, seed=seed,
        params={"v_start": 60.0, "adhesion.sigma": noise},
    )  # fmt: skip
    return simulate(loop, scenario, compile=compile, log=("ctl.search.best", "plant.wheel.v_s"))


def fastest(slip: float, c: float, a: float, b: float) -> float:
    """Time in s in which the slip falls to 5 % above the best one with the brake released.

    s' = -(1 + m r^2/J) g mu(s), the numbers of the study's wheelset.
    """
    p = wheelset().param_values()
    fall = float((1 + p["m"] * p["r"] ** 2 / p["J"]) * p["g"])
    target = (1 + NEAR) * float(peak_slip(c, a, b))
    v = np.linspace(min(slip, target), slip, 400)
    return float(np.trapezoid(1 / (fall * c * (np.exp(-a * v) - np.exp(-b * v))), v))


def outcomes(log: Any, sections: list[dict[str, float]]) -> list[tuple[float, float, float]]:
    """By section: times in s after which estimate and slip are within 5 % for good, inf if never.

    The third is the time that the slip needs at least, by :func:`fastest`.
    """
    n, found = round(LENGTH / H), []
    for k, s in enumerate(sections):
        times = []
        for name in ("ctl.search.best", "plant.wheel.v_s"):
            off = np.abs(log[name].values[k * n : (k + 1) * n] / float(peak_slip(**s)) - 1)
            wrong = np.flatnonzero(off >= NEAR)
            last = (wrong[-1] + 1) * H if wrong.size else 0.0
            times.append(last if last < LENGTH else math.inf)
        least = fastest(max(float(log["plant.wheel.v_s"].values[k * n]), 0.0), **s) if k else 0.0
        found.append((times[0], times[1], least))
    return found


def sections(context: Context) -> dict[str, Table]:
    """Share of random sections on which the best slip is found in time, by detector and noise."""
    models = context.models | {"adh": double_exponential}
    loops = {n: online(models, models["sta"], memory=m) for n, m in DETECTORS.items()}
    few, many = (20, 50) if context.quick else (200, 1000)
    jobs = [
        (detector, noise, row)
        for detector in DETECTORS
        for noise in NOISES
        for row in range((many if not noise and detector == "likelihood ratio" else few) // ROW)
    ]

    def work(job: tuple[str, float, int]) -> list[list[float | None]]:
        detector, noise, row = job
        rng = np.random.default_rng([context.seed, 5, row])
        drawn = [random_section(rng) for _ in range(ROW)]
        log = drive(loops[detector], drawn, noise, row + 1, context.compile)
        return [[t if t < math.inf else None for t in each] for each in outcomes(log, drawn)]

    done = dict(zip(jobs, context.each("rows", jobs, work), strict=True))
    rows: dict[str, list[Any]] = {
        k: []
        for k in ("detector", "noise", "sections", "found", "slip", "reachable", "never", "limit")
    }
    for detector, memory in DETECTORS.items():
        for noise in NOISES:
            times = [t for j, each in done.items() if j[:2] == (detector, noise) for t in each]
            late = np.array([[t if t is not None else math.inf for t in each] for each in times])
            in_time, able = late[:, :2] <= TIME, late[:, 2] <= TIME
            share = [*(100 * in_time.mean(axis=0)), 100 * in_time[able, 1].mean()]
            values = (
                detector, noise, len(times), *map(float, share), int(np.isinf(late[:, 0]).sum()),
                smallest_shift(noise, 60, 6) if memory > 1 else 5 * math.hypot(1e-3, noise),
            )  # fmt: skip
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
    return {
        "sections": Table(
            "Random sections on which the best slip is found",
            {
                "detector": ("", rows["detector"]),
                "noise": ("1", rows["noise"]),
                "sections": ("1", rows["sections"]),
                ESTIMATE: ("%", rows["found"]),
                SLIP: ("%", rows["slip"]),
                REACHABLE: ("%", rows["reachable"]),
                "never found": ("1", rows["never"]),
                "detection limit": ("1", rows["limit"]),
            },
            "Best slip uniform .605 to 2.420 m/s, peak log-uniform .0287 to .2866, b/a uniform 1.5"
            " to 4; 1 s each, in the loop sta_online. The limit is the shift of the adhesion, at"
            " the slip that is held, that is told 0.1 s after it, 1 s after the change before.",
        )
    }
