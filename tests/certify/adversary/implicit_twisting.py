"""Adversary of super-twisting in proper implicit steps: the law as it is exported, tick by tick.

A tick solves y + T k1 root(y) + T^2 k2 xi = x, xi in Sgn(y), for y and xi. The starts are all pairs
of ticks with |x| <= k2 T^2; from the third on |x| counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def draw(rng: np.random.Generator, n: int) -> Cases:
    """k1 0.1 to 100, k2 0.1 to 100, L 0.05 to 1.1 k2, T 0.1 ms to 0.1 s, band near L T^2."""
    k1, k2 = common.log_uniform(rng, 0.1, 100, (2, n))
    L, T = k2 * common.log_uniform(rng, 0.05, 1.1, n), common.log_uniform(rng, 1e-4, 0.1, n)
    band = L * T**2 * common.log_uniform(rng, 0.5, 2, n)
    return {"k1": k1, "k2": k2, "L": L, "T": T, "band": band}


def _run(n: Cases, first: np.ndarray, second: np.ndarray, d: np.ndarray | None) -> np.ndarray:
    """Largest |x| from the third tick on; without d the one that pushes x outward."""
    k1, k2, L, T = (n[k] for k in ("k1", "k2", "L", "T"))
    x, v = first * k2 * T**2, np.zeros_like(T)
    phi = (second * k2 * T**2 + x) / T  # so that the second tick is that
    worst = np.zeros_like(T)
    for i in range(60):
        outside = np.maximum(0.0, np.abs(x) - T**2 * k2)
        root = (np.sqrt((T * k1) ** 2 + 4 * outside) - T * k1) / 2
        xi = np.clip(x / (T**2 * k2), -1, 1)
        v = v - T * k2 * xi
        x = x + T * (v - k1 * np.sign(x) * root - T * k2 * xi + phi)
        phi = phi + T * L * (np.sign(x) if d is None else d[i])
        if i >= 1:
            worst = np.maximum(worst, np.abs(x))
    return worst


def _swing(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    size, worst = n["T"].shape, np.zeros_like(n["T"])
    ways = [np.ones((60, 1)), np.where(np.arange(60) % 2, 1, -1)[:, None], None]
    ways += [rng.choice([-1.0, 1.0], (60, 1)) for _ in range(2 * effort)]
    for d in ways:
        first, second = rng.uniform(-1, 1, (2, *size))
        worst = np.maximum(worst, _run(n, first, second, d))
    return worst


def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """|x| passes the band; nothing to leave where L > k2 and a run slides off later."""
    return _swing(n, rng, effort) > n["band"] * (1 + 1e-9)


def replays_all(n: Cases, entries: list[Any]) -> np.ndarray:
    """The constant phi' = L, from rest."""
    still = np.zeros_like(n["T"])
    return _run(n, still, still, np.ones((60, 1))) > n["band"] * (1 - 1e-9)


ADVERSARY = Adversary(
    "super_twisting_implicit", draw, ("band", "L", "T"), leaves,
    grows={"band": False, "L": True, "T": True},
    swing={"band": lambda n, rng: _swing(n, rng, 1)},
    replays_all=replays_all,
)  # fmt: skip
