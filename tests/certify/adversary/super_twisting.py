"""Adversary of super-twisting in explicit steps: runs against many disturbances at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

KINDS = 24
"""Disturbances tried at once on each case."""


def _draw(rng: np.random.Generator, n: int) -> Cases:
    """L 0.1 to 100; k2/L 1.1 to 10; k1 1.2 to 20 times its boundary; T 0.1 ms to 0.1 s."""
    L = common.log_uniform(rng, 0.1, 100, n)
    k2 = common.log_uniform(rng, 1.1, 10, n)
    k1 = common.log_uniform(rng, 1.2, 20, n) * boundary(k2)
    return {"k1": k1 * np.sqrt(L), "k2": k2 * L, "L": L, "T": common.log_uniform(rng, 1e-4, 0.1, n)}


def boundary(k2: np.ndarray) -> np.ndarray:
    """Smallest stable k1 at L = 1: where the worst half turn brings x2 back to what it was."""
    low, high = np.full_like(k2, 0.05), np.full_like(k2, 2.0)
    for _ in range(14):
        k1 = np.sqrt(low * high)
        grows = half_turn(k1, k2) > 1
        low, high = np.where(grows, k1, low), np.where(grows, high, k1)
    return high


def half_turn(k1: np.ndarray, k2: np.ndarray) -> np.ndarray:
    """|x2| after a half turn from x1 = 0, x2 = 1 against d = 1 outward, then -1; midpoint steps.

    In z = root(x1) and ds = dt/(2 z) it is z' = x2 - k1 z, x2' = -2 (k2 - d) z.
    """
    z, w, out = np.zeros_like(k1), np.ones_like(k1), np.zeros_like(k1)
    h = 0.02 / np.sqrt(k2)
    going = np.ones(k1.shape, bool)
    for _ in range(600):
        c = np.where(w > k1 * z, k2 - 1, k2 + 1)
        mz, mw = z + h / 2 * (w - k1 * z), w - h * c * z
        z2, w2 = z + h * (mw - k1 * mz), w - 2 * h * c * mz
        done = going & (z2 <= 0)
        out[done] = -w2[done]
        going &= ~done
        z, w = np.where(going, z2, z), np.where(going, w2, w)
    return out


def _swing(n: Cases, rng: np.random.Generator, effort: int = 1) -> np.ndarray:
    """Largest |x1| over T^2 L in the second half of the runs; starts of different size."""
    cases = len(n["k1"])
    k1, k2 = n["k1"] / np.sqrt(n["L"]), n["k2"] / n["L"]
    shape = (KINDS, cases)
    size = 10 ** rng.uniform(-1, 1.5, shape) * k2
    y, w = size * rng.uniform(-3, 3, shape), size * rng.uniform(-1, 1, shape)
    period = rng.integers(1, 60, shape)
    phase = rng.integers(0, 60, shape)
    bias = rng.uniform(-1, 1, shape)
    how = np.arange(KINDS)[:, None] % 6
    worst = np.zeros(cases)
    held = np.ones(shape)
    ticks = 400 * effort
    for i in range(ticks):
        s = np.sign(y)
        root = np.sqrt(abs(y))
        outward = np.where(s * w > k1 * root, s, -s)
        next_y = y - k1 * root * s + w
        # so that the next root throws furthest: the y that is nearest to -(k1/2)^2 from above
        ahead = np.where(next_y * s > 0, s, np.where(abs(next_y) < (k1 / 2) ** 2, s, -s))
        square = np.where((i + phase) % (2 * period) < period, 1.0, -1.0)
        flips = rng.random(shape) < 1 / period
        held = np.where(flips, -held, held)
        d = np.select(
            [how == 0, how == 1, how == 2, how == 3, how == 4],
            [outward, square, held, ahead, np.where(rng.random(shape) < 0.8, outward, held)],
            np.clip(bias + 0.5 * outward, -1, 1),
        )
        y, w = next_y, w - k2 * s + d
        if i >= ticks // 2:
            worst = np.maximum(worst, abs(y).max(axis=0))
    return worst


def _leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    return _swing(n, rng, effort) * n["L"] * n["T"] ** 2 > n["band"]


def _replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """Explicit steps from x1 = x2 = 0 with the disturbance of the file."""
    if counterexample["by"] == "band":  # the orbit in closed form: there and back
        T, x1, x2 = n["T"], 0.0, 0.0
        x1 = T**2 * ((n["k1"] + np.sqrt(n["k1"] ** 2 - 4 * n["k2"])) / 4) ** 2
        x2 = T * n["k2"] / 2
        there = x1 + T * (x2 - n["k1"] * np.sqrt(x1))
        return bool(abs(there + x1) < 1e-6 * x1 and x1 > n["band"] * (1 - 1e-9))
    x1 = x2 = worst = 0.0
    for text in counterexample["run"]["d"]:
        top, _, bottom = text.partition("/")
        d = float(int(top) / int(bottom or 1))
        assert abs(d) <= n["L"] * (1 + 1e-12)
        s = np.sign(x1)
        nu = -n["k1"] * np.sqrt(abs(x1)) * s + x2
        x1, x2 = x1 + n["T"] * nu, x2 + n["T"] * (d - n["k2"] * s)
        worst = max(worst, abs(x1))
    return worst > n["band"] * (1 - 1e-6)


ADVERSARY = Adversary(
    "super_twisting", _draw, ("band",), _leaves, _replays,
    swing={"band": lambda n, rng: _swing(n, rng) * n["L"] * n["T"] ** 2},
)  # fmt: skip
