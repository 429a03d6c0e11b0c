"""The adhesion force of ``hst_braking`` by a window of samples, beside the filters of the paper."""

from __future__ import annotations

from collections.abc import Callable
from statistics import fmean
from typing import Any

import numpy as np

from slipctl import Block, Context, Table, ekf, mhe, simulate
from slipctl.models.zhang_2021.hst_braking_estimate import adhesion_filter, wheel_model
from slipctl.predict.trials import Driver
from slipctl.study.resolve import build_cases, load_study

DRIFTS = {1e-3: 1e6, 1e-2: 1e8, 5e-2: 3e8}
"""Drift of the adhesion force in N^2/s by the standard deviation of the measured wheel speed in
rad/s: about as quick after a change of the rail as the filter of the paper. They were chosen by
other noise than what the errors are of."""

RAILS = {"dry": (0.0, 2.0), "snow": (2.0, 4.0), "wet": (4.0, 6.0)}
"""Spans in s of the scenario ``base`` of hst_braking."""

RAIL = 2.0
"""Time in s on each rail."""

SAMPLES = 30
DRAWS = 5
"""So many draws of the noise count together."""

CHANGE = 0.05
"""Time in s after a start or a change of rail that counts as change."""


def filters(noise: float, start: float) -> dict[str, Block]:
    """The estimators by name, told the noise; that of the paper has its own settings."""
    both: dict[str, Any] = {
        "drift": {"omega": 1e-9, "F_a": DRIFTS[noise]}, "start": {"omega": start, "F_a": 0.0},
    }  # fmt: skip
    prior = {"omega": 1.0, "F_a": 4e6}
    limits = {"F_a": (-30e3, 0.0)}
    return {
        "ctukf": adhesion_filter(),
        "ekf": ekf(
            wheel_model, "omega", ("omega", "F_a"), prior=prior, noise=noise**2, **both
        ),
        "mhe": mhe(
            wheel_model, "omega", noise**2, prior, limits=limits, samples=SAMPLES, **both
        ),
    }  # fmt: skip


def estimation(context: Context) -> dict[str, Table]:
    """Errors of each estimator over rails, noises and their draws, all on the same run."""
    case = build_cases(load_study("hst_braking"))[0]
    log = simulate(case.loops["eppfc"], case.scenario, compile=context.compile)
    t = log["time"].values
    omega, T_b, F_a = (
        log[n].values.ravel() for n in ("plant.wheel.omega", "plant.brake.T_b", "plant.wheel.F_a")
    )

    def work(one: tuple[float, int]) -> dict[str, Any]:
        noise, draw = one
        drawn = np.random.default_rng([context.seed, 19, draw]).standard_normal(omega.size)
        given = {"omega": omega + noise * drawn, "T_b": T_b, "seen_omega": np.ones(omega.size)}
        found: dict[str, Any] = {}
        for name, block in filters(noise, float(omega[0])).items():
            tick, rows = Driver(block, context.compile), []
            columns = [given[n] for n in block.inputs]
            for k in range(omega.size):
                rows.append(tick(*(c[k] for c in columns)))
            out = dict(zip(block.outputs, np.array(rows).T, strict=True))
            error, steady = out["F_a"] - F_a, t % RAIL >= CHANGE
            spans = {(r, "steady"): (t >= a + CHANGE) & (t < b) for r, (a, b) in RAILS.items()}
            spans |= {(r, "change"): (t >= a) & (t < a + CHANGE) for r, (a, _) in RAILS.items()}
            found[name] = {
                "error": {" ".join(k): float(np.mean(error[s] ** 2)) for k, s in spans.items()},
                "pushes": int((out["F_a"] > 1e-6).sum()),
                "unsolved": int((out.get("status", np.zeros(1)) != 0).sum()),
                "square": float(np.mean(out["misfit" if name == "mhe" else "nis"][steady])),
                "values": out["F_a"].tolist(),
            }  # fmt: skip
        apart = np.abs(np.subtract(found["mhe"]["values"], found["ekf"]["values"]))
        calm = np.array(found["ekf"]["values"]) < -1000  # away from the limit, long enough
        kept = np.convolve(calm, np.ones(10 * SAMPLES), "full")[: calm.size] == 10 * SAMPLES
        for row in found.values():
            del row["values"]
        return found | {"apart": float(apart[kept].max())}

    noises = list(DRIFTS)[1:2] if context.quick else list(DRIFTS)
    draws = range(1, 1 + (1 if context.quick else DRAWS))
    each = context.each("estimation", [(n, k) for n in noises for k in draws], work)
    found = [each[k : k + len(draws)] for k in range(0, len(each), len(draws))]
    names = ("ctukf", "ekf", "mhe")

    def rms(draws: list[Any], name: str, span: str) -> float:
        return float(np.sqrt(np.mean([d[name]["error"][span] for d in draws])))

    def total(name: str, what: str, of: Callable[[Any], Any] = sum) -> list[Any]:
        return [of([d[name][what] for d in f]) for f in found]

    apart = [max(d["apart"] for d in f) for f in found]

    rows = [(s, r, part, f) for s, f in zip(noises, found, strict=True)
            for part in ("steady", "change") for r in RAILS]  # fmt: skip
    return {
        "errors": Table(
            "Adhesion force: rms error by noise of the wheel speed and rail",
            {
                "noise": ("rad/s", [s for s, *_ in rows]),
                "rail": ("", [r for _, r, *_ in rows]),
                "part": ("", [part for *_, part, _ in rows]),
                **{n: ("N", [rms(f, n, f"{r} {p}") for _, r, p, f in rows]) for n in names},
            },
            "Change: the first 50 ms of each rail; steady: the rest. ctukf is the filter of the"
            " paper, which is not told the noise. Window of 30 samples of 1 ms."
            f" Root of the mean square over {len(draws)} draws of the noise.",
        ),
        "consistency": Table(
            "Mean square of what was not expected, over its variance",
            {
                "noise": ("rad/s", noises),
                **{n: ("", total(n, "square", fmean)) for n in names},
            },
            "1 where noise and drift are true; without the first 50 ms of each rail. ctukf and ekf:"
            " of each sample; mhe: of the window, over its samples.",
        ),
        "limits": Table(
            "An adhesion force that pushes the train",
            {
                "noise": ("rad/s", noises),
                **{f"samples, {n}": ("", total(n, "pushes")) for n in names},
                "mhe, ticks not solved": ("", total("mhe", "unsolved")),
                "mhe from ekf, away from the limit": ("N", apart),
            },
        ),
    }
