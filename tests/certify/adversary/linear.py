"""Adversaries of the linear systems: runs from a start; nothing disturbs them."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def _lagged_draw(rng: np.random.Generator, n: int) -> Cases:
    """K 0.1 to 1000 1/s; lag 0 in a quarter, else 0.01 to 100 periods; T 0.01/K to 1/K."""
    K = common.log_uniform(rng, 0.1, 1e3, n)
    T = common.log_uniform(rng, 0.01, 1.0, n) / K
    lag = np.where(rng.random(n) < 0.25, 0.0, common.log_uniform(rng, 0.01, 100, n) * T)
    return {"K": K, "T": T, "lag": lag}


def _lagged_run(n: Cases, doublings: int) -> np.ndarray:
    """Logarithm of the size of (e, a T) after 2^doublings ticks: a lag's answer to held inputs."""
    K, T = n["K"], n["T"]
    lag = np.where(np.isnan(n["lag"]), 0.0, n["lag"])
    left = np.exp(-T / np.where(lag > 0, lag, 1.0)) * (lag > 0)
    tick = np.empty((len(K), 2, 2))
    for column, (e, a) in enumerate(((1.0, 0.0), (0.0, 1.0 / T))):
        u = -K * e
        tick[:, 0, column] = e + T * u + lag * (a - u) * (1 - left)
        tick[:, 1, column] = (u + (a - u) * left) * T
    log = np.zeros_like(K)
    for _ in range(doublings):
        tick = tick @ tick
        size = np.maximum(np.abs(tick).max(axis=(1, 2)), 1e-300)
        log, tick = 2 * log + np.log(size), tick / size[:, None, None]
    return log


def _lagged_leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """It has not shrunk between the middle and the end of a long run."""
    return _lagged_run(n, 20 + effort) > _lagged_run(n, 19 + effort)


def _observer_draw(rng: np.random.Generator, n: int) -> Cases:
    """J 0.01 to 1000; L1 of either sign; L2 about -J L1^2/4, of either sign."""
    J = common.log_uniform(rng, 0.01, 1e3, n)
    L1 = common.log_uniform(rng, 0.1, 1e3, n) * np.where(rng.random(n) < 0.9, 1, -1)
    L2 = -J * L1**2 / 4 * common.log_uniform(rng, 0.05, 20, n)
    return {"L1": L1, "L2": L2 * np.where(rng.random(n) < 0.9, 1, -1), "J": J}


def _decay(n: Cases) -> np.ndarray:
    """Slowest decay in 1/s, from a long run: of log |(w, T)| between its middle and its end.

    The states are w and T/(J scale).
    """
    scale = np.sqrt(np.abs(n["L2"] / n["J"])) + np.abs(n["L1"])
    M = np.array(
        [[-n["L1"], -scale], [-n["L2"] / (n["J"] * scale), 0 * scale]]
    )  # of w, T/(J scale)
    step = np.moveaxis(M * (0.01 / scale), 2, 0)
    tick = np.eye(2) + step @ (
        np.eye(2) + step / 2 @ (np.eye(2) + step / 3 @ (np.eye(2) + step / 4))
    )
    x, log, seen = np.ones((len(scale), 2, 1)), np.zeros_like(scale), []
    for _ in range(8):  # 2^8 small steps at once
        tick = tick @ tick
    for i in range(400):
        x = tick @ x
        size = np.abs(x).max(axis=(1, 2))
        log, x = log + np.log(size), x / size[:, None, None]
        if i in (200, 399):
            seen.append(log)
    return (seen[0] - seen[1]) * scale / (0.01 * 256 * 199)


def _observer_leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """It decays slower than wanted, by more than what the steps and the turns of the run blur."""
    wanted = np.where(np.isnan(n["slowest"]), 0.0, n["slowest"])
    return _decay(n) < wanted * (1 - 5e-3)


def _refuted(n: Cases, entries: list[dict[str, Any]]) -> np.ndarray:
    """The sides are in closed form; the run from a start does not die out, or too slowly."""
    if "K" in n:
        return _lagged_run(n, 21) > _lagged_run(n, 20) - 1e-6
    wanted = np.nan_to_num(n["slowest"]) if "slowest" in n else 0.0
    return _decay(n) <= wanted * (1 + 5e-3) + 1e-9


ADVERSARIES = (
    Adversary("lagged_loop", _lagged_draw, ("K", "T"), _lagged_leaves,
              replays_all=_refuted),
    Adversary(
        "load_observer", _observer_draw, ("slowest",), _observer_leaves,
        replays_all=_refuted, guess={"slowest": lambda n: np.abs(n["L1"]) / 2},
    ),
)  # fmt: skip
