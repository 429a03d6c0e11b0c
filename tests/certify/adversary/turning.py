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

Field = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""(y', x2') of y, x2, d and the numbers of the cases that these belong to, one row per number."""

STEP = 0.1
"""Step of a run over the shorter of its two time constants; RK4 is right to STEP^4/120 there."""

TICKS = 1200
"""Most steps of a half turn."""


def growth(field: Field, numbers: np.ndarray, k1: np.ndarray, k2: np.ndarray, L: np.ndarray,
           v: np.ndarray, shares: np.ndarray, creeps: float) -> np.ndarray:  # fmt: skip
    """Largest g over the shares, per case; infinite where x1 does not come back.

    The step in which d turns, or x1 comes back, is cut short where it does. A run that has not
    come back at the end creeps into the origin, g = 0, if its |x2| is below its start and has
    fallen by the factor ``creeps`` since half of it. Far below zero x2 comes back from afar.
    """
    found = np.full((len(k1), len(shares)), np.inf)
    case, column = (i.ravel() for i in np.indices(found.shape))
    y, z = np.zeros(len(case)), v[case]
    turned, on, halfway = np.zeros(len(case), bool), np.ones(len(case), bool), z
    of, own = numbers[:, case], np.stack([
        STEP / np.maximum(k1, np.sqrt(2 * (k2 + L))), L, k1, v])[:, case]  # fmt: skip
    slope = shares[column] * own[2]
    for tick in range(TICKS):
        if tick % 16 == 0 and not on.all():
            case, column, y, z, turned = (x[on] for x in (case, column, y, z, turned))
            halfway, slope, of, own, on = halfway[on], slope[on], of[:, on], own[:, on], on[on]
            if not len(case):
                break
        halfway = z if tick == TICKS // 2 else halfway
        h, d = own[0], np.where(turned, -own[1], own[1])
        new_y, new_z = _step(field, of, y, z, d, h)
        turns = on & ~turned & (new_z < slope * new_y)
        back = on & turned & (new_y <= 0)
        for cut, level in ((turns, slope), (back, None)):
            at = np.flatnonzero(cut)
            if len(at):
                new_y[at], new_z[at] = _cut(field, of[:, at], y[at], z[at], d[at], h[at],
                                            None if level is None else level[at])  # fmt: skip
        turned |= turns
        if back.any():
            found[case[back], column[back]] = np.abs(new_z[back]) / own[3][back]
        still = on & (np.maximum(new_y * own[2], np.abs(new_z)) < 1e-7 * own[3])
        if still.any():
            found[case[still], column[still]] = 0.0  # it creeps into the origin
        on &= ~(back | still)
        y, z = np.where(on, new_y, 0.0), np.where(on, new_z, 0.0)
    case, column, y, z, halfway, own = case[on], column[on], y[on], z[on], halfway[on], own[:, on]
    fell = (np.abs(z) < creeps * halfway) & (np.abs(z) < own[3])
    found[case[fell], column[fell]] = 0.0
    return found.max(axis=1)


def _step(field: Field, of: np.ndarray, y: np.ndarray, z: np.ndarray, d: np.ndarray,
          h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """One step of Runge and Kutta."""
    a1, b1 = field(y, z, d, of)
    a2, b2 = field(y + h / 2 * a1, z + h / 2 * b1, d, of)
    a3, b3 = field(y + h / 2 * a2, z + h / 2 * b2, d, of)
    a4, b4 = field(y + h * a3, z + h * b3, d, of)
    return y + h / 6 * (a1 + 2 * (a2 + a3) + a4), z + h / 6 * (b1 + 2 * (b2 + b3) + b4)


def _cut(field: Field, of: np.ndarray, y: np.ndarray, z: np.ndarray, d: np.ndarray,
         h: np.ndarray, slope: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """State within the step where x2 = slope y, or y = 0: the line through both ends, 8 times."""

    def rest(y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return y if slope is None else z - slope * y

    low, high = np.zeros_like(h), np.ones_like(h)
    above, below = rest(y, z), rest(*_step(field, of, y, z, d, h))
    kept = np.zeros_like(h)
    for _ in range(8):
        middle = low + (high - low) * above / np.maximum(above - below, 1e-300)
        value = rest(*_step(field, of, y, z, d, h * middle))
        past = value <= 0
        low, high = np.where(past, low, middle), np.where(past, middle, high)
        # an end that stays counts half, so that the other one comes near too
        above = np.where(past, np.where(kept > 0, above / 2, above), value)
        below = np.where(past, value, np.where(kept < 0, below / 2, below))
        kept = np.where(past, 1.0, -1.0)
    return _step(field, of, y, z, d, h * high)


def _shares(effort: int) -> np.ndarray:
    """One where cases are made, around it too where verdicts are tried."""
    around = np.linspace(0.2, 1.8, 2 * effort + 1) if effort > 1 else []
    return np.unique(np.concatenate([[1.0], around]))


def _observer(n: Cases, shares: np.ndarray, creeps: float) -> np.ndarray:
    K1, K2, K3, L = (n[k] for k in ("K1", "K2", "K3", "L"))

    def field(y: Any, z: Any, d: Any, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        K1, K2, K3 = of
        bend = K3 * y * y
        phi = y + bend * y
        return z - K1 * phi, 2 * y * d - K2 * phi * (1 + 3 * bend)

    # near to the origin, where K3 y^2 is below 1e-10
    v = np.where(K3 > 0, 1e-5 / np.sqrt(np.maximum(K3, 1e-30)), 1.0) * np.sqrt(K2)
    return growth(field, np.stack([K1, K2, K3]), K1, K2 / 2, L, v, shares, creeps)


def _adaptive(n: Cases, shares: np.ndarray, creeps: float) -> np.ndarray:
    k1, k2, L = n["k4"], 2 * n["beta"] * n["k4"], n["eta"]

    def field(y: Any, z: Any, d: Any, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k1, k2 = of
        phi = y + y * y
        return z - k1 * phi, 2 * y * d - k2 * phi * (1 + 2 * y)

    v = 1e-10 * np.sqrt(k2 + L)
    return growth(field, np.stack([k1, k2]), k1, k2 / 2, L, v, shares, creeps)


SURE = 1 - 1e-6
"""Of what is certified a run that still falls is given the benefit."""

BLUR = 1e-5
"""What hundreds of steps of Runge and Kutta may change of g: by 2.5e-6 in 800 cases of ``draw``."""


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


def _replays(n: Cases, entries: list[Any]) -> np.ndarray:
    """The disturbance of the file, in words: d = L while x1 grows, -L while it falls."""
    return (_observer if "K1" in n else _adaptive)(n, np.ones(1), 0.9) >= 1 - BLUR


ADVERSARIES = (
    Adversary("adhesion_observer", _draw_observer, ("L", "K1"),
              lambda n, rng, effort: _observer(n, _shares(effort), SURE) > 1 + BLUR,
              replays_all=_replays, grows={"K1": False}),
    Adversary("higher_order", _draw_adaptive, ("eta", "k4"),
              lambda n, rng, effort: _adaptive(n, _shares(effort), SURE) > 1 + BLUR,
              replays_all=_replays, grows={"k4": False}),
)  # fmt: skip
