"""Adversary of the seeker with a dither: the loop on its parabola, tick by tick."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def draw(rng: np.random.Generator, n: int) -> Cases:
    """w 1 to 20 rad/s, corners w/20 to w/6, averaged natural frequency^2 0.15 to 1 w_l^2.

    a 0.05 to 0.5, curvature -0.05 to -1, start 0.1 to 1 a, 12 to 30 ticks to a period; one in ten
    flees (k < 0).
    """
    w = common.log_uniform(rng, 1, 20, n)
    w_l, w_h = w / common.log_uniform(rng, 6, 20, n), w / common.log_uniform(rng, 6, 20, n)
    a, c = common.log_uniform(rng, 0.05, 0.5, n), -common.log_uniform(rng, 0.05, 1, n)
    k = 2 * w_l * common.log_uniform(rng, 0.15, 1, n) / (a * -c)
    k = k * np.where(rng.random(n) < 0.9, 1, -1)
    T = 2 * np.pi / w / rng.integers(12, 30, n)
    return {"k": k, "w": w, "w_l": w_l, "w_h": w_h, "a": a, "curvature": c, "T": T,
            "start": a * common.log_uniform(rng, 0.1, 1, n)}  # fmt: skip


def _run(n: Cases, share: float, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest |th - v*| of all ticks, and of the last three periods."""
    T, c = n["T"], n["curvature"] / 2
    far = np.where(np.isnan(n["start"]), n["a"], n["start"]) if "start" in n else n["a"]
    th, xi = share * far, np.zeros_like(T)
    eta, phase = c * th * th, np.zeros_like(T)
    most, last = np.abs(th), np.zeros_like(T)
    tail = int(3 * 2 * np.pi / float((n["w"] * T).min()))
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(ticks):
            s = np.sin(phase)
            high = c * (th + n["a"] * s) ** 2 - eta
            th, xi, eta = (th + T * n["k"] * xi, xi + T * n["w_l"] * (high * s - xi),
                           eta + T * n["w_h"] * high)  # fmt: skip
            phase = np.mod(phase + n["w"] * T, 2 * np.pi)
            size = np.nan_to_num(np.abs(th), nan=np.inf)
            most = np.maximum(most, size)
            if i >= ticks - tail:
                last = np.maximum(last, size)
    return most, last


def _search(n: Cases, effort: int) -> tuple[np.ndarray, np.ndarray]:
    natural = np.abs(n["k"] * n["curvature"]) * n["a"] * n["w_l"] / 2
    slow = np.minimum(natural / n["w_l"], n["w_l"] / 2)
    ticks = int((14 / slow / n["T"]).max()) + 200
    found = [_run(n, share, min(ticks, 12_000)) for share in (1.0, -1.0, 0.3)[: 1 + effort]]
    return np.max([f[0] for f in found], 0), np.max([f[1] for f in found], 0)


def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """It goes farther than was asked, or rests farther out, or runs away."""
    most, last = _search(n, effort)
    far = np.where(np.isnan(n["start"]), n["a"], n["start"]) if "start" in n else n["a"]
    out = most > 10 * np.maximum(far, n["a"])
    for name, value in (("reach", most), ("rest", last)):
        if name in n:
            out |= value > np.where(np.isnan(n[name]), np.inf, n[name]) * (1 + 1e-9)
    return out


def replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """The run of the file, in floats; on its orbit from the same start."""
    run, clause = counterexample["run"], counterexample["clause"]
    k, w, w_l, w_h, a, c, T = (n[x] for x in ("k", "w", "w_l", "w_h", "a", "curvature", "T"))
    th, xi = float(Fraction(run["start"])) if "start" in run else n.get("start", a), 0.0
    eta = c / 2 * th * th
    for i in range(run["ticks"]):
        s = math.sin(w * T * i)
        high = c / 2 * (th + a * s) ** 2 - eta
        th, xi, eta = th + T * k * xi, xi + T * w_l * (high * s - xi), eta + T * w_h * high
    limit = n.get(clause, 10 * max(n.get("start", a), a))
    return abs(th) > limit * (1 - 1e-9)


ADVERSARY = Adversary(
    "perturbation_seek", draw, ("rest", "reach"), leaves, replays,
    grows={"rest": False, "reach": False},
    swing={"rest": lambda n, rng: np.minimum(_search(n, 1)[1], 10 * n["a"]),
           "reach": lambda n, rng: np.minimum(_search(n, 1)[0], 10 * n["a"])},
)  # fmt: skip
