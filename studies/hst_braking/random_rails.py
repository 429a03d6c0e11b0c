"""Random rails: what each way to know the best slip costs on rails that nobody tuned for."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Context, Table
from slipctl.models.zhang_2021.hst_braking import G, peak_height, peak_slip
from slipctl.run import build
from slipctl.studies.hst_braking.loops import (
    H,
)


def random_rail(rng: np.random.Generator) -> dict[str, float]:
    """Parameters of a rail: peak log-uniform .03-.35, best slip uniform .02-.2.

    With y = a1 lam* the curve falls to mu(1) >= 0 if y exp(-y) <= lam*. y is drawn from there up to
    1.5 above, as the paper's rails have it (0 to 1.53).
    """
    height = math.exp(rng.uniform(math.log(0.03), math.log(0.35)))
    place = rng.uniform(0.02, 0.2)
    low, high = 1.0, 50.0
    for _ in range(80):
        y = (low + high) / 2
        low, high = (y, high) if y * math.exp(-y) > place else (low, y)
    y = high + rng.uniform(0, 1.5)
    a0 = height / (1 - math.exp(-y) - y * math.exp(-y))
    return {"a0": a0, "a1": y / place, "a2": a0 * y / place * math.exp(-y)}


def random_run(rng: np.random.Generator) -> list[tuple[float, dict[str, float]]]:
    """Sections of a run: length in s and rail; 2 to 5 of 0.5 to 3 s."""
    return [(round(rng.uniform(0.5, 3.0), 3), random_rail(rng)) for _ in range(rng.integers(2, 6))]


class Runner:
    """A loop that is rolled over many random rails, from several threads at once."""

    def __init__(self, block: Block, compile: bool) -> None:
        self.block, self.compile = block, compile
        self.x0 = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
        self.at = {n: k for k, n in enumerate(_flat(block, "state"))}
        self.out = {n: k for k, n in enumerate(_flat(block, "output"))}
        self.p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
        self.p_at = {n: k for k, n in enumerate(_flat(block, "param"))}
        self.mine = threading.local()
        if compile:
            build.compile_roller(block.f)  # once, before the threads

    def __call__(self, sections: Sequence[tuple[float, Mapping[str, float]]]) -> Any:
        """Position, speed, slip and adhesion over the ticks; None where the loop broke."""
        f = self.block.f
        if not hasattr(self.mine, "roll"):
            self.mine.roll = build.make_roller(f, self.compile)
        x = self.x0.copy()
        logs = []
        for length, rail in sections:
            ticks = round(length / H)
            p = self.p.copy()
            for n, v in rail.items():
                p[self.p_at[f"plant.adh.{n}"]] = v
            u = np.zeros((ticks, f.size1_in(1)))
            for k, (n, s) in enumerate(self.block.inputs.items()):
                u[:, k] = float(peak_slip(**rail)) if n == "lam_opt" else float(s.value or 0.0)
            x_log, y_log = np.empty((ticks, x.size)), np.empty((ticks, f.size1_out(1)))
            if self.mine.roll(x, u, p, x_log, y_log) < ticks:
                return None
            logs.append((x_log, y_log))
        states = np.vstack([a for a, _ in logs])
        outputs = np.vstack([b for _, b in logs])
        return {
            "x": states[:, self.at["plant.wheel.x"]], "v": states[:, self.at["plant.wheel.v"]],
            "lam": outputs[:, self.out["plant.wheel.lam"]],
            "mu": -outputs[:, self.out["plant.adh.mu"]],
        }  # fmt: skip


def _flat(block: Block, role: str) -> list[str]:
    return [n for n, s in block._signals[role].items() for _ in range(s.size)]


RANDOM = ("eppfc_true_reference", "eppfc", "eppfc_free", "eppfc_gradient")


def random_rails(context: Context) -> dict[str, Table]:
    """Each reference on random rails, where the prior does not hold; all cores."""
    runs = 12 if context.quick else 200
    rng = np.random.default_rng([context.seed, 3])
    rails = [random_run(rng) for _ in range(runs)]
    runners = {
        n: Runner(context.loop("base", n)[0], context.compile and build.compiler() is not None)
        for n in RANDOM
    }
    done, lock, total = [0], threading.Lock(), runs * len(RANDOM)

    def work(job: tuple[str, int]) -> dict[str, float] | None:
        name, k = job
        found = runners[name](rails[k])
        with lock:
            done[0] += 1
            context.progress(done[0] / total)
        if found is None:
            return None
        heights = np.concatenate(
            [np.full(round(t / H), float(peak_height(**rail))) for t, rail in rails[k]]
        )
        moving = found["v"] > 1
        bound, v = 0.0, 50.0
        for t, rail in rails[k]:
            mu = float(peak_height(**rail))
            bound += v * t - G * mu * t**2 / 2
            v -= G * mu * t
        return {
            "x": float(found["x"][-1] + found["v"][-1] * H), "bound": bound,
            "use": float((found["mu"] / heights)[moving].mean()),
            "lock": float((found["lam"] > 0.95)[moving].sum() * H),
            "above": float(min(found["lam"][moving].max(), 9.9)),
        }  # fmt: skip

    jobs = [(n, k) for n in RANDOM for k in range(runs)]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        results = list(pool.map(work, jobs))
    by = {n: results[i * runs : (i + 1) * runs] for i, n in enumerate(RANDOM)}
    true = by["eppfc_true_reference"]
    rows: dict[str, list[Any]] = {
        k: [] for k in ("loop", "runs", "broke", "mean", "median", "worst", "use", "low", "lock",
                        "bound")
    }  # fmt: skip
    prices: dict[str, list[float]] = {}
    for name in RANDOM:
        both = [(a, b) for a, b in zip(by[name], true, strict=True) if a and b]
        price = np.array([a["x"] - b["x"] for a, b in both])
        prices[name] = list(price)
        uses = [a["use"] for a, _ in both]
        values = (
            name, runs, sum(a is None for a in by[name]), float(price.mean()),
            float(np.median(price)), float(price.max()), float(np.mean(uses)),
            float(min(a["use"] for a, _ in both)), float(max(a["lock"] for a, _ in both)),
            float(min(a["x"] - a["bound"] for a, _ in both)),
        )  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(value)
    return {
        "random_rails": Table(
            f"{runs} runs on random rails: what each reference costs",
            {
                "loop": ("", rows["loop"]),
                "runs": ("1", rows["runs"]),
                "broke": ("1", rows["broke"]),
                "above the true reference, mean": ("m", rows["mean"]),
                "median": ("m", rows["median"]),
                "worst": ("m", rows["worst"]),
                "adhesion use, mean": ("1", rows["use"]),
                "adhesion use, worst run": ("1", rows["low"]),
                "longest lock-up": ("s", rows["lock"]),
                "least distance above the bound": ("m", rows["bound"]),
            },
            "Peak adhesion log-uniform 0.03-0.35, best slip uniform 0.02-0.2, 2 to 5 sections of"
            " 0.5 to 3 s, from 50 m/s, seed 1. The prior of eppfc is the family through the"
            " paper's three rails, which these rails do not belong to.",
        ),
        "prices": Table(
            "Each random run: distance above the true reference",
            {n: ("m", v) for n, v in prices.items() if len(v) == runs},
        ),
    }
