"""Adversary of the command with saturation compensation: a need that switches, by Runge-Kutta."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

STEP = 0.05
"""Step as a share of the fastest time, 1/(k1 + k3), or of what the command takes to reach zero."""


def _turns(n: Cases, first: float | np.ndarray, steps: int) -> np.ndarray:
    """Largest |e1| at a rest after one whole turn, from rest at ``first`` times the start.

    The need is F_high while e2 < 0 and F_low while e2 > 0; 0 if it does not turn twice in time.
    """
    k1, k3, M = n["k1"], n["k3"], n["M"]
    e1, e2 = first * n["start"], np.zeros_like(M)
    need = np.where(first > 0, n["F_high"], n["F_low"]) * np.ones_like(M)
    turns, rest = np.zeros(len(M), int), np.zeros_like(M)

    def pull(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        wanted = need - M * ((k1 + k3) * v + k1 * k3 * x)
        return (np.clip(wanted, n["F_min"], n["F_max"]) - need) / M

    for i in range(steps):
        a = pull(e1, e2)
        y, rate = k1 * k3 * e1 + (k1 + k3) * e2, k1 * k3 * e2 + (k1 + k3) * a
        h = STEP * np.maximum(1 / (k1 + k3), np.abs(y) / np.maximum(np.abs(rate), 1e-300))
        h = np.where((e2 * a < 0), np.minimum(h, np.abs(e2 / a) / 4 + STEP / (k1 + k3)), h)
        h = np.minimum(h, 1e3 * STEP / (k1 + k3))
        x, v = e1 + h / 2 * e2, e2 + h / 2 * a
        b = pull(x, v)
        new = e2 + h * b
        e1 = e1 + h * v
        turned = (new * e2 < 0) & (i > 0)
        turns += turned
        rest = np.where(turned & (turns == 2), np.abs(e1), rest)
        need = np.where(turned, np.where(new < 0, n["F_high"], n["F_low"]), need)
        e2 = new
        if (turns >= 2).all():
            break
    return rest


def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """It comes to rest as far out as it started, or further; 2 % are left to the steps."""
    with np.errstate(all="ignore"):
        worst = np.maximum(_turns(n, 1.0, 1500), _turns(n, -1.0, 1500))
    return worst > 1.02 * n["start"]


def _replays(n: Cases, entries: list[dict[str, Any]]) -> np.ndarray:
    """A constant need that is out of reach, or the worst need from the start of the file."""
    constant = np.array(["run" not in entry for entry in entries])
    out = (n["F_high"] >= n["F_max"]) | (n["F_low"] <= n["F_min"])
    starts = [entry.get("run", {}).get("e1", "") for entry in entries]
    side = np.array([-1.0 if text.startswith("-") else 1.0 for text in starts])
    with np.errstate(all="ignore"):
        return np.where(constant, out, _turns(n, side, 20_000) > 0.98 * n["start"])


def _draw(rng: np.random.Generator, n: int) -> Cases:
    """k1, k3 0.05 to 2 1/s; limits -+1e5 N; each side of the need keeps 5 to 80 % of them free."""
    low, high = rng.uniform(0.05, 0.8, (2, n)) * 1e5
    return {
        "k1": common.log_uniform(rng, 0.05, 2, n), "k3": common.log_uniform(rng, 0.05, 2, n),
        "M": common.log_uniform(rng, 1e5, 1e6, n), "F_min": np.full(n, -1e5),
        "F_max": np.full(n, 1e5), "F_low": low - 1e5, "F_high": 1e5 - high,
    }  # fmt: skip


def _first(n: Cases, rng: np.random.Generator) -> np.ndarray:
    """Start at which the worst need first brings it back, within 2 %: many starts at once."""
    free = np.minimum(n["F_max"] - n["F_high"], n["F_low"] - n["F_min"])
    low = free / (n["M"] * n["k1"] * n["k3"])
    high = 1e5 * low
    for count in (26, 26):
        starts = low * (high / low) ** (np.arange(1, count + 1)[:, None] / count)
        tiled = {k: np.tile(v, count) for k, v in n.items()}
        gone = leaves({**tiled, "start": starts.ravel()}, rng, 1).reshape(starts.shape)
        gone[-1] = True
        at, columns = gone.argmax(axis=0), np.arange(len(low))
        low, high = np.where(at > 0, starts[at - 1, columns], low), starts[at, columns]
    return high


def _ordered(rng: np.random.Generator, n: int) -> Cases:
    drawn = _draw(rng, n)
    drawn["F_low"] = np.minimum(drawn["F_low"], drawn["F_high"] - 1e4)
    return drawn


ADVERSARY = Adversary("saturation_compensation", _ordered, ("start",), leaves,
                      replays_all=_replays, swing={"start": _first})  # fmt: skip
