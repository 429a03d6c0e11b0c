"""Adversaries of the observer and of the adaptive law: turns about the origin, d bang-bang.

In s with dt = 2 |x1|^.5 ds and y = |x1|^.5 the half plane x1 > 0 is

    dy/ds = x2 - k1 (y + c y^3),  dx2/ds = 2 y d - k2 (y + c y^3)(1 + 3 c y^2)

for the observer; the adaptive law has y + y^2 in the place of the cubic. From x1 = 0, x2 = v, a
half turn leads to x1 = 0, x2 = -g v: it settles only if no admissible d has g >= 1. The search
tries d = L up to where x2 has fallen to a share of k1 phi1, and -L from there, for many shares.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

Field = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def growth(field: Field, k1: np.ndarray, k2: np.ndarray, L: np.ndarray, v: np.ndarray,
           shares: np.ndarray, creeps: float) -> np.ndarray:  # fmt: skip
    """Largest g over the shares, per case; infinite where x1 does not come back.

    A run that has not come back at the end creeps into the origin, g = 0, if its x2 has fallen by
    the factor ``creeps`` since half of it.
    """
    h = 0.1 / np.maximum(k1, np.sqrt(2 * (k2 + L)))[:, None]
    y, z = np.zeros((len(k1), len(shares))), np.repeat(v[:, None], len(shares), axis=1)
    found = np.full(y.shape, np.inf)
    running = np.ones(y.shape, bool)
    turned = np.zeros(y.shape, bool)
    halfway = z
    for tick in range(1200):
        halfway = z if tick == 600 else halfway
        turned |= (z < shares * k1[:, None] * y) & (y > 0)
        d = np.where(turned, -1.0, 1.0) * L[:, None]
        a1, b1 = field(y, z, d)
        a2, b2 = field(y + h / 2 * a1, z + h / 2 * b1, d)
        a3, b3 = field(y + h / 2 * a2, z + h / 2 * b2, d)
        a4, b4 = field(y + h * a3, z + h * b3, d)
        new_y = y + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        new_z = z + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        back = running & (new_y <= 0) & turned
        with np.errstate(invalid="ignore", divide="ignore"):
            at = z + (new_z - z) * y / (y - new_y)
        found = np.where(back, np.abs(at) / v[:, None], found)
        running &= ~back
        if not running.any():
            break
        # a run that creeps into the origin comes back with nothing
        still = running & (np.hypot(new_y * k1[:, None], new_z) < 1e-7 * v[:, None])
        found, running = np.where(still, 0.0, found), running & ~still
        y, z = np.where(running, new_y, 0.0), np.where(running, new_z, 0.0)
    found = np.where(running & (z < creeps * halfway), 0.0, found)
    return found.max(axis=1)


def _shares(effort: int) -> np.ndarray:
    return np.unique(np.concatenate([[1.0], np.linspace(0.2, 1.8, 2 * effort + 1)]))


def _observer(n: Cases, effort: int) -> np.ndarray:
    K1, K2, K3, L = (n[k] for k in ("K1", "K2", "K3", "L"))

    def field(y: np.ndarray, z: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c = K3[:, None]
        phi = y + c * y**3
        return z - K1[:, None] * phi, 2 * y * d - K2[:, None] * phi * (1 + 3 * c * y**2)

    # near to the origin, where K3 y^2 is a ten thousandth
    v = np.where(K3 > 0, 1e-2 / np.sqrt(np.maximum(K3, 1e-30)), 1.0) * np.sqrt(K2)
    return growth(field, K1, K2 / 2, L, v, _shares(effort), SURE if effort else 0.9)


def _adaptive(n: Cases, effort: int) -> np.ndarray:
    k1, k2, L = n["k4"], 2 * n["beta"] * n["k4"], n["eta"]

    def field(y: np.ndarray, z: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi = y + y**2
        return z - k1[:, None] * phi, 2 * y * d - k2[:, None] * phi * (1 + 2 * y)

    return growth(
        field, k1, k2 / 2, L, 1e-5 * np.sqrt(k2 + L), _shares(effort), SURE if effort else 0.9
    )


SURE = 1 - 1e-6
"""Of what is certified a run that still falls is given the benefit."""

BLUR = 2e-3
"""What K3 y^2 (or y), and the straight line between two steps, may change of g."""


def _draw_observer(rng: np.random.Generator, n: int) -> Cases:
    """L 0.01 to 1e4; K2/(2 L) from 1.05 to 10; K1/sqrt(L) from 0.3 to 3; K3 0 in a half."""
    L = common.log_uniform(rng, 1e-2, 1e4, n)
    K2 = 2 * L * (1 + common.log_uniform(rng, 0.05, 9, n))
    K1 = np.sqrt(L) * common.log_uniform(rng, 0.3, 3, n)
    K3 = np.where(rng.random(n) < 0.5, 0.0, common.log_uniform(rng, 1e-2, 10, n))
    return {"K1": K1, "K2": K2, "L": L, "K3": K3}


def _draw_adaptive(rng: np.random.Generator, n: int) -> Cases:
    """As the observer, with beta k4 in the place of K2/2."""
    eta = common.log_uniform(rng, 1e-2, 10, n)
    k4 = np.sqrt(eta) * common.log_uniform(rng, 0.3, 3, n)
    beta = eta * (1 + common.log_uniform(rng, 0.05, 9, n)) / k4
    return {"k4": k4, "alpha": k4**2 / 2, "beta": beta, "eta": eta}


def _replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    one = {k: np.array([v]) for k, v in n.items()}
    found = _observer(one, 0) if "K1" in n else _adaptive(one, 0)
    return bool(found[0] >= 1 - BLUR)


ADVERSARIES = (
    Adversary("adhesion_observer", _draw_observer, ("L", "K1"),
              lambda n, rng, effort: _observer(n, effort) > 1 + BLUR, _replays,
              grows={"K1": False}),
    Adversary("higher_order", _draw_adaptive, ("eta", "k4"),
              lambda n, rng, effort: _adaptive(n, effort) > 1 + BLUR, _replays,
              grows={"k4": False}),
)  # fmt: skip
