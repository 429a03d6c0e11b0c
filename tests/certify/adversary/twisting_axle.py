"""Adversary of the wheelset that twists: curves with kinks that fall by no more than is told."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

KINKS, TURNS, STEPS = 5, 10, 60


def _draw(rng: np.random.Generator, n: int) -> Cases:
    """J 20 to 500, k 1e5 to 2e7, z .001 to .2, N 1e4 to 2e5, r .2 to .8; fall near the edge."""
    J, k = common.log_uniform(rng, 20, 500, n), common.log_uniform(rng, 1e5, 2e7, n)
    z, N = common.log_uniform(rng, 1e-3, 0.2, n), common.log_uniform(rng, 1e4, 2e5, n)
    r = rng.uniform(0.2, 0.8, n)
    fall = z * np.sqrt(k * J) / (N * r * r) * common.log_uniform(rng, 0.5, 8, n)
    return {"J": J, "k": k, "z": z, "N": N, "r": r, "fall": fall}


def _grows_from_small(n: Cases) -> np.ndarray:
    """A small twist on a straight falling piece: log of its size does not fall over 2^30 steps.

    The size is that of all entries: the largest one hangs on the phase, which near the edge says
    more than the growth does.
    """
    w, h = np.sqrt(2 * n["k"] / n["J"]), 0.01
    give = n["fall"] * n["N"] * n["r"] ** 2 / (n["J"] * w) - 2 * n["z"]
    zero = 0 * w
    M = np.moveaxis(h * np.array([[zero, zero + 1], [zero - 1, give]]), 2, 0)
    one = np.eye(2)
    tick = one + M @ (one + M / 2 @ (one + M / 3 @ (one + M / 4 @ (one + M / 5))))
    log, before = zero, zero
    for _ in range(30):
        before, tick = log, tick @ tick
        size = np.maximum(np.linalg.norm(tick, axis=(1, 2)), 1e-300)
        log, tick = 2 * log + np.log(size), tick / size[:, None, None]
    return log > before


def _grows_on_kinks(n: Cases, rng: np.random.Generator) -> np.ndarray:
    """The energy of a twist grows over ten turns on a curve of straight pieces."""
    many = len(n["J"])
    w = np.sqrt(2 * n["k"] / n["J"])
    ends = np.sort(rng.uniform(-3, 3, (many, KINKS)), axis=1)  # over the first swing at the rim
    slopes = n["fall"][:, None] * np.where(
        rng.random((many, KINKS + 1)) < 0.6, -1, rng.uniform(-1, 2, (many, KINKS + 1))
    )

    def height(x: np.ndarray) -> np.ndarray:
        """Integral of the slopes from 0 to x, a slip over the first swing."""
        found = slopes[:, 0] * x
        for j in range(KINKS):
            more = np.maximum(x - ends[:, j], 0) - np.maximum(-ends[:, j], 0)
            found = found + (slopes[:, j + 1] - slopes[:, j]) * more
        return found

    drive = n["r"] ** 2 * n["N"] / (2 * n["J"] * w)

    def rates(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Twist and its rate, both over the first swing, by w t."""
        return b, -a - 2 * n["z"] * b - drive * (height(b) - height(-b))

    a, b, h = np.ones(many), np.zeros(many), 2 * np.pi / STEPS
    for _ in range(TURNS * STEPS):
        k1 = rates(a, b)
        k2 = rates(a + h / 2 * k1[0], b + h / 2 * k1[1])
        k3 = rates(a + h / 2 * k2[0], b + h / 2 * k2[1])
        k4 = rates(a + h * k3[0], b + h * k3[1])
        a = a + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        b = b + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
    return a * a + b * b > 1 + 1e-4  # what the steps may add


def _leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """A small twist grows, or one on some curve with kinks."""
    found = _grows_from_small(n)
    for _ in range(2 * (effort - 1)):
        found = found | _grows_on_kinks(n, rng)
    return found


def _refuted(n: Cases, entries: list[dict[str, Any]]) -> np.ndarray:
    """A small twist does not die out where the curve falls alike around the slip."""
    return _grows_from_small(n)


ADVERSARY = Adversary(
    "twisting_axle", _draw, ("fall", "z", "N"), _leaves, replays_all=_refuted,
    grows={"fall": True, "z": False, "N": True},
)  # fmt: skip
