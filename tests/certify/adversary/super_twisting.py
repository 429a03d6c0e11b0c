"""Adversary of super-twisting in explicit steps: runs against many disturbances at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases
from .holding import told

KINDS = 24
"""Disturbances tried at once on each case."""


def _draw(rng: np.random.Generator, n: int) -> Cases:
    """L 0.1 to 100; k2/L 1.1 to 10; k1 1.2 to 20 times its boundary; T 0.1 ms to 0.1 s.

    In one of twenty noise of 0.1 to 3 L T^2, in one of forty a lag of 0.05 to 0.5 T, in one of
    forty a dead time of T.
    """
    L = common.log_uniform(rng, 0.1, 100, n)
    k2 = common.log_uniform(rng, 1.1, 10, n)
    k1 = common.log_uniform(rng, 1.2, 20, n) * boundary(k2)
    T = common.log_uniform(rng, 1e-4, 0.1, n)
    which, size = rng.random(n), rng.random(n)
    return {
        "k1": k1 * np.sqrt(L), "k2": k2 * L, "L": L, "T": T,
        "noise": np.where(which < 0.05, L * T**2 * 0.1 * 30**size, np.nan),
        "lag": np.where((which >= 0.05) & (which < 0.075), T * 0.05 * 10**size, np.nan),
        "dead": np.where((which >= 0.075) & (which < 0.1), T, np.nan),
    }  # fmt: skip


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


class Loop:
    """Explicit steps of many runs (kinds, cases), in y = x1/(L T^2): u late, from a noisy y."""

    def __init__(self, n: Cases, kinds: int) -> None:
        T = n["T"]
        self.k1, self.k2 = n["k1"] / np.sqrt(n["L"]), n["k2"] / n["L"]
        self.N = told(n, "noise") / (n["L"] * T**2)
        lag = told(n, "lag") / T
        self.E = np.where(lag > 0, np.exp(-1 / np.where(lag > 0, lag, 1.0)), 0.0)
        self.missed = lag * (1 - self.E)
        self.wait = np.ceil(told(n, "dead") / T * (1 - 1e-12)).astype(int)
        self.rests = (self.N > 0) | (lag > 0) | (self.wait > 0)
        self.y, self.v, self.phi, self.a = (np.zeros((kinds, len(T))) for _ in range(4))
        self.line = [self.a for _ in range(int(self.wait.max(initial=0)) + 1)]

    def slope(self) -> np.ndarray:
        """What y would move without lateness and noise."""
        return self.v + self.phi - self.k1 * np.sign(self.y) * np.sqrt(abs(self.y))

    def tick(self, d: np.ndarray, noise: np.ndarray) -> None:
        """One tick with d and noise as shares of their bounds."""
        seen = self.y + noise * self.N
        s = np.sign(seen)
        self.line = [self.v - self.k1 * np.sqrt(abs(seen)) * s, *self.line[:-1]]
        u = self.line[0]
        for late in range(1, len(self.line)):
            u = np.where(self.wait == late, self.line[late], u)
        self.y = self.y + u + self.missed * (self.a - u) + self.phi
        self.a = u + self.E * (self.a - u)
        self.v, self.phi = self.v - self.k2 * s, self.phi + d


def _swing(n: Cases, rng: np.random.Generator, effort: int = 1) -> np.ndarray:
    """Largest |x1| over T^2 L in the second half of the runs, from starts of different size.

    From rest, and from the first tick on, where the command is late or there is noise.
    """
    loop = Loop(n, KINDS)
    k1, shape = loop.k1, loop.y.shape
    size = 10 ** rng.uniform(-1, 1.5, shape) * loop.k2 * ~loop.rests
    loop.y, loop.phi = size * rng.uniform(-3, 3, shape), size * rng.uniform(-1, 1, shape)
    period = rng.integers(1, 60, shape)
    phase = rng.integers(0, 60, shape)
    bias = rng.uniform(-1, 1, shape)
    how = np.arange(KINDS)[:, None] % 6
    against = (np.arange(KINDS)[:, None] // 6 % 3) - 1.0
    worst = np.zeros(shape[1])
    held = np.ones(shape)
    ticks = 400 * effort
    for i in range(ticks):
        s, slope = np.sign(loop.y), loop.slope()
        outward = np.where(s * slope > 0, s, -s)
        next_y = loop.y + slope
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
        loop.tick(d, against * np.where(slope >= 0, 1.0, -1.0))
        if i >= ticks // 2 or loop.rests.any():
            counts = loop.rests | (i >= ticks // 2)
            worst = np.maximum(worst, np.where(counts, abs(loop.y).max(axis=0), 0.0))
    return worst


def _leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    return _swing(n, rng, effort) * n["L"] * n["T"] ** 2 > n["band"]


def _band(n: Cases, rng: np.random.Generator) -> np.ndarray:
    return _swing(n, rng) * n["L"] * n["T"] ** 2


def _just(name: str) -> Callable[[Cases, np.random.Generator], np.ndarray]:
    """Value of a number with which the search just comes to the band, which it draws too."""

    def found(n: Cases, rng: np.random.Generator) -> np.ndarray:
        n["band"] = common.rounded(_band(n, rng))
        return n[name].copy()

    return found


def _replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """Explicit steps from x1 = x2 = 0 with the disturbance of the file."""
    if counterexample["by"] == "turns":  # x2 never turns back
        return n["k2"] <= n["L"]
    if counterexample["by"] == "band":  # the orbit in closed form: there and back
        T, x1, x2 = n["T"], 0.0, 0.0
        x1 = T**2 * ((n["k1"] + np.sqrt(n["k1"] ** 2 - 4 * n["k2"])) / 4) ** 2
        x2 = T * n["k2"] / 2
        there = x1 + T * (x2 - n["k1"] * np.sqrt(x1))
        return bool(abs(there + x1) < 1e-6 * x1 and x1 > n["band"] * (1 - 1e-9))
    run = counterexample["run"]
    one = Loop({k: np.array([v]) for k, v in n.items()}, 1)
    noise = run.get("noise", ["0"] * len(run["d"]))
    worst = 0.0
    for d, heard in zip(map(_number, run["d"]), map(_number, noise), strict=True):
        assert abs(d) <= n["L"] * (1 + 1e-12)
        assert abs(heard) <= n.get("noise", 0.0) * (1 + 1e-12)
        one.tick(np.full((1, 1), d / n["L"]), np.full((1, 1), heard / n["noise"] if heard else 0.0))
        worst = max(worst, abs(one.y[0, 0]))
    return worst * n["L"] * n["T"] ** 2 > n["band"] * (1 - 1e-6)


def _number(text: str) -> float:
    top, _, bottom = text.partition("/")
    return int(top) / int(bottom or 1)


ADVERSARY = Adversary(
    "super_twisting", _draw, ("band", "T", "L"), _leaves, _replays,
    swing={"band": _band, "T": _just("T"), "L": _just("L")},
)  # fmt: skip
