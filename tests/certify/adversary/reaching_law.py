"""Adversary of the reaching law: exact ticks behind a lag, against many disturbances at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

KINDS = 36


def _draw(rng: np.random.Generator, n: int) -> Cases:
    """g2 0.1 to 100 m/s^2; T 0.1 ms to 0.1 s; g1 T 0.001 to 1.9, 0 in a tenth; D 0 to 1.1 g2.

    The lag is 0 in a third, else 0.1 to 20 periods, with g1 lag at most 3.
    """
    T, g2 = common.log_uniform(rng, 1e-4, 0.1, n), common.log_uniform(rng, 0.1, 100, n)
    lag = np.where(rng.random(n) < 1 / 3, 0.0, common.log_uniform(rng, 0.1, 20, n) * T)
    g1 = common.log_uniform(rng, 1e-3, 1.9, n) / T
    g1 = np.where(lag > 0, np.minimum(g1, 3 / np.maximum(lag, 1e-9)), g1)
    g1 = np.where(rng.random(n) < 0.1, 0.0, g1)
    D = np.where(rng.random(n) < 0.2, 0.0, rng.uniform(0, 1.1, n)) * g2
    return {
        "g1": g1,
        "g2": g2,
        "T": T,
        "lag": lag,
        "D": np.where(g1 > 0, D, np.minimum(D, 0.8 * g2)),
    }


def _tick(n: Cases, s: Any, a: Any, d: Any) -> Any:
    """Command u = -g1 s - g2 sgn s held; s' = a + d, lag a' = u - a."""
    T, lag = n["T"], n["lag"]
    u = -n["g1"] * s - n["g2"] * np.sign(s)
    slow = lag > 0
    left = np.where(slow, np.exp(-T / np.where(slow, lag, 1.0)), 0.0)
    a = np.where(slow, a, u)
    return s + T * u + lag * (a - u) * (1 - left) + T * d, u + (a - u) * left


def _swing(n: Cases, rng: np.random.Generator, effort: int = 1) -> np.ndarray:
    """Largest |s| in the second half of the runs, from starts of different size."""
    shape = (KINDS, len(n["T"]))
    size = n["g2"] * (n["T"] + 2 * n["lag"]) * 10 ** rng.uniform(-2, 0.7, shape)
    s, a = size * rng.uniform(-1, 1, shape), n["g2"] * rng.uniform(-1, 1, shape)
    period, phase = rng.integers(1, 40, shape), rng.integers(0, 40, shape)
    how = np.arange(KINDS)[:, None] % 9
    worst, ticks = np.zeros(len(n["T"])), 1000 * effort
    for i in range(ticks):
        side = np.sign(s)
        ahead, _ = _tick(n, s, a, 0.0)
        # carried over the middle as far as can be: near 0 before, away from it after
        near = -np.clip(ahead / np.maximum(n["T"] * n["D"], 1e-300), -1, 1) + 1e-9 * side
        square = np.where((i + phase) % (2 * period) < period, 1.0, -1.0)
        near = np.where((i + phase) % (period + 1) == 0, np.where(ahead > 0, 1.0, -1.0), near)
        d = np.select(
            [how == 0, how == 1, how == 2, how == 3, how == 4, how == 5, how == 6],
            [np.ones(shape), np.sign(a), side, -side, square, rng.choice([-1.0, 1.0], shape), near],
            np.where(rng.random(shape) < 0.9, np.sign(a), square),
        )
        s, a = _tick(n, s, a, np.clip(d, -1, 1) * n["D"])
        if i >= ticks // 2:
            worst = np.maximum(worst, abs(s).max(axis=0))
    return worst


def _leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """Beyond the band by more than what doubles blur, when every start has settled to e^-14."""
    limit, half = n["band"] * (1 + 1e-3), 500 * effort
    left = _swing(n, rng, effort) > limit
    slow = left & (n["g1"] > 0) & (n["g1"] * n["T"] * half < 14)
    if slow.any():
        some = {k: v[slow] for k, v in n.items()}
        longer = math.ceil(14 / 500 / (some["g1"] * some["T"]).min())
        left[slow] = _swing(some, rng, longer) > limit[slow]
    return left


def _one(n: dict[str, float]) -> Callable[[float, float, float], tuple[float, float]]:
    """A tick of one case, in floats."""
    g1, g2, T, lag = (n[k] for k in ("g1", "g2", "T", "lag"))
    left = math.exp(-T / lag) if lag > 0 else 0.0
    late = lag * (1 - left)

    def tick(s: float, a: float, d: float) -> tuple[float, float]:
        u = -g1 * s - math.copysign(g2, s) * (s != 0)
        return s + T * u + late * (a - u) + T * d, u + (a - u) * left

    return tick


def _replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    tick, T, g2, D = _one(n), n["T"], n["g2"], n["D"]
    if counterexample["by"] == "sampled":
        s, a, before = 1e6 * g2 * T, 0.0, 0.0
        for i in range(4000):
            s, a = tick(s, a, 0.0)
            if i == 2000:
                before = abs(s)
            if abs(s) > 1e200:
                return True
        return abs(s) > before * 0.999
    if counterexample["by"] == "orbit":
        run = counterexample["run"]
        s, a = (_number(run["start"][k]) for k in ("s", "a"))
        d = [_number(x) for x in run["d"]]
        assert max(map(abs, d)) <= D * (1 + 1e-12)
        worst = 0.0
        for _ in range(max(2, 300 // len(d))):
            worst = 0.0
            for x in d:
                s, a = tick(s, a, x)
                worst = max(worst, abs(s))
        return worst > n["band"] * (1 - 1e-6)
    # no lag, in closed form: a constant d, an alternating one, or back to just beside 0 and across
    top = 0.0
    for way in (1.0, 0.0, -1.0):
        s = 1e-9 * T * g2
        for i in range(6000):
            s, _ = tick(s, 0.0, D if way > 0 else (1 + 2 * way) * math.copysign(D, s))
            if i > 5000:
                top = max(top, abs(s))
    s = 1e-9 * T * g2
    for _ in range(20):
        s, _ = tick(s, 0.0, -D)
        top = max(top, abs(s))
        back = s + T * (-n["g1"] * s + g2)
        if abs(back) > T * D:
            break
        s = 1e-9 * T * g2  # d = (s - back)/T takes it there
    return top > n["band"] * (1 - 1e-6)


def _number(text: str) -> float:
    top, _, bottom = text.partition("/")
    return int(top) / int(bottom or 1)


def _just(name: str) -> Callable[[Cases, np.random.Generator], np.ndarray]:
    """Value of a number with which the search just comes to the band, which it draws too."""

    def found(n: Cases, rng: np.random.Generator) -> np.ndarray:
        if name == "D":
            n["D"] = common.rounded(np.maximum(n["D"], 0.2 * n["g2"]))  # below, it decides nothing
        n["band"] = common.rounded(_swing(n, rng))
        return n[name].copy()

    return found


ADVERSARY = Adversary(
    "reaching_law", _draw, ("band", "D", "T"), _leaves, _replays,
    swing={"band": _swing, "D": _just("D"), "T": _just("T")},
)  # fmt: skip
