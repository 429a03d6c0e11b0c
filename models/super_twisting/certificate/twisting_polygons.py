"""Finding the polygon of ``twisting_levels``: two families of shapes, and a search in doubles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache

import numpy as np

from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.models.super_twisting.certificate.twisting_levels import MOST_CORNERS, Levels
from slipctl.models.super_twisting.certificate.twisting_rows import Law

Shape = dict[str, float]
Family = Callable[[float, float, Shape], np.ndarray | None]


@lru_cache(maxsize=8)
def find(law: Law) -> Levels | None:
    """Polygon with a small ``level``, by a search over its shape; None if none is found.

    What it gives holds: it is checked with rationals.
    """
    if law.k2 <= law.L or law.k1 <= 0:
        return None
    k1, k2 = float(law.k1) / math.sqrt(law.L), float(law.k2 / law.L)
    value, shape = math.inf, FAMILIES[0][1][0]
    family: Family = _box
    for one, starts in (*FAMILIES, (_spiral, _paced(k1, k2))):
        level, best = _best(k1, k2, one, starts, value)
        if level < value:
            value, family, shape = level, one, best
    if not math.isfinite(value):
        return None
    corners = family(k1, k2, shape)
    return None if corners is None else _proved(law, corners, shape["fall"], value)


def _best(
    k1: float, k2: float, family: Family, starts: tuple[Shape, ...], below: float
) -> tuple[float, Shape]:
    """Shape of the least level, from the best start, one number after the other."""
    best: Shape = {}
    value = below
    for tried in starts:
        if math.isinf(value) or tried["fall"] > 0.005 or "tick" in tried:  # finer ones lie higher
            found = _level(k1, k2, family, tried, value)
            if found < value:
                best, value = tried, found
    if value == below:
        return math.inf, best
    if best["fall"] < 0.0012 and "tick" in best:
        return value, best
    for factor in (2.0, 1.4, 1.15):
        for name in best:
            for move in (factor, 1 / factor):
                while True:
                    tried = {**best, name: best[name] * move}
                    found = _level(k1, k2, family, tried, value)
                    if not found < value:
                        break
                    best, value = tried, found
    return value, best


def _proved(law: Law, corners: np.ndarray, fall: float, value: float) -> Levels | None:
    """Give it in rationals and in the unit of the law, a little wider if rounding needs it.

    In few digits if it can be; a fine polygon has little to spare for rounding.
    """
    for digits in (7, 10):
        scale = 10**digits
        least = Fraction(fall).limit_denominator(scale // 10) * (law.k2 - law.L)
        wide = Fraction(1 / math.sqrt(law.L)).limit_denominator(scale // 10)
        exact = [(Fraction(round(z * scale), scale) * wide, Fraction(round(w * scale), scale))
                 for z, w in corners]  # fmt: skip
        for wider in (1.001, 1.01, 1.1, 1.5):
            level = Fraction(math.ceil(value * wider * 1000), 1000) * law.L
            found = Levels(law, tuple(exact), level, least)
            if least > 0 and found.holds():
                return found
    return None


def _box(k1: float, k2: float, shape: Shape) -> np.ndarray | None:
    """Four corners, for a strongly damped law: (0, 1), (z, 1), (z, w), (0, -q)."""
    z, w = shape["wide"] / k1, 1 - shape["down"]
    inside = k1 * z - w
    if inside <= 0:
        return None
    q = 2 * (k2 + 1) * (1 + shape["push"]) * z * z / inside - w
    return np.array([(0.0, 1.0), (z, 1.0), (z, w), (0.0, -q)]) if 0 < q < 1 else None


def _spiral(k1: float, k2: float, shape: Shape) -> np.ndarray | None:
    """Tangents of the worst continuous motion, each begun where the last one ends: outside it."""
    if max(shape["turn"], shape["first"]) > 1.5:
        return None
    a, b = k2 - 1, k2 + 1
    k1 = k1 * (1 - min(shape["damp"], 0.5))
    down, turn, tick = math.sqrt(2 * b), shape["turn"], shape.get("tick", 0.0)
    slow = max(0.0, 1.5 * k1 * k1 / 8 - b)  # so that the polygon overshoots where nothing does
    P = [(0.0, 1.0), (shape["first"] / max(down, k1), 1.0)]
    for c in (a * (1 - 2 * min(shape["fall"], 0.25)), b * (1 + shape["push"]) + slow):
        first = c < a
        while len(P) < MOST_CORNERS - 1:
            z, w = P[-1]
            dz, dw = w - k1 * z, -2 * c * z
            if first and dz <= 0:
                break
            ddz, ddw = dw - k1 * dz, -2 * c * dz
            bend = abs(dz * ddw - dw * ddz) * down / ((dz * down) ** 2 + dw * dw)
            far = math.hypot(dz * down, dw) / math.hypot(z * down, w)
            step = max(turn / max(bend, far, 1e-12), tick / (2 * z))
            if z + step * dz <= 0:
                w -= z / dz * dw
                P.append((0.0, w))
                return np.array(P) if -1 < w < 0 else None
            P.append((z + step * dz, w + step * dw))
    return None


def _paced(k1: float, k2: float) -> tuple[Shape, ...]:
    """Starts for a law near the boundary of stability: as fine as ln q asks for.

    An edge is no shorter than a tick at the level that is hoped for, b/|ln q|: a tick that passes
    over a corner needs a higher level.
    """
    g = -super_twisting.log_ratio(k1, k2, 1.0)
    if not 0 < g < 0.5:
        return ()
    # very near as small as it gets, without a search: each takes long
    turns, ticks, damps = [0.12, 0.08, 0.05], [0.5, 0.25, 0.12], [0.03, 0.15]
    if g < 0.06:
        turns, ticks, damps = [0.05, 0.035], [0.17], [0.5]
    return tuple(
        {"first": 0.6 * math.sqrt(g), "turn": turn * math.sqrt(g), "damp": damp * g,
         "fall": 0.02 * g, "push": 0.05 * g, "tick": tick * g / (k2 + 1)}
        for turn, tick, damp in itertools.product(turns, ticks, damps)
    )  # fmt: skip


def _level(k1: float, k2: float, family: Family, shape: Shape, below: float) -> float:
    """Level of a shape in doubles, inf if not ``below``; the inequalities of ``Levels.holds``."""
    P = family(k1, k2, shape) if min(shape.values()) > 1e-7 else None
    if P is None or shape["fall"] > 0.5:
        return math.inf
    fall = shape["fall"] * (k2 - 1)
    a, b = k2 - 1, k2 + 1
    q, z1 = -P[-1, 1], P[1, 0]
    z, w = P.T
    size = z[:-1] * w[1:] - w[:-1] * z[1:]
    if size.max() >= 0:
        return math.inf
    n, m = (w[1:] - w[:-1]) / size, (z[:-1] - z[1:]) / size
    gap = 1 - n[:, None] * z - m[:, None] * w
    gap[abs(gap) < 1e-9] = 0
    c = np.where(m > 0, a, b)
    bracket = n[:, None] * (w - k1 * z) - 2 * (m * c)[:, None] * z + 2 * fall * z
    own = (gap[1:] == 0) & (z > 0)
    if gap.min() < 0 or n.min() < -1e-12 or (bracket[1:][own] > -1e-4 * fall * z.max()).any():
        return math.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        K = np.where(bracket > 0, bracket / gap, 0.0)[1:]
    worst = np.maximum(K[:, 1:-1], K[:, 2:]).max(axis=0)
    least = np.minimum(z[1:-1], z[2:])
    under = np.maximum(0, -np.maximum(w[1:-1], w[2:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        need = np.minimum(worst / (2 * least), worst**2 / (4 * under))
    low = max(b, float(np.where(worst > 0, need, 0.0).max()))
    up, down, quarter = np.maximum(m, 0), np.maximum(-m, 0), k1 * k1 / 4

    def fits(lam: float) -> bool:
        root = math.sqrt(quarter + q * lam)
        if (n * root + up * (q * lam + b) + down * quarter > lam - fall).any():
            return False
        if (2 * (1 - up * q) * root < n * q).any():
            return False
        N, U = n[1:], up[1:]
        if (N * math.sqrt(lam) + U * (lam - a) > lam - fall).any():
            return False
        if (2 * (1 - U) * math.sqrt(lam) < N).any() or (1 - N * z1 - U < -1e-9).any():
            return False
        end = z1 * lam + (1 - k1 * z1) / (2 * z1)
        return bool((N * end + U * (lam - a) <= lam - fall).all())

    high = min(0.98 * below, 1e7 * b)
    if low >= high or not fits(high):
        return math.inf
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high


FAMILIES: tuple[tuple[Family, tuple[Shape, ...]], ...] = (
    (_box, tuple(
        {"wide": wide, "down": down, "push": push, "fall": 0.1 * push}
        for wide, down, push in itertools.product(
            (1.2, 2.0, 4.0, 16.0, 64.0, 256.0, 1024.0), (0.5, 0.8, 1.0), (0.1, 0.4))
    )),
    (_spiral, tuple(
        {"first": first, "turn": 0.7 * fine, "damp": damp * fine, "fall": 0.05 * fine,
         "push": 0.1 * fine}
        for fine, first, damp in itertools.product(
            (1.0, 0.4, 0.15, 0.06, 0.025), (0.5, 0.2, 0.07), (0.05, 0.2, 0.6))
    )),
)  # fmt: skip
"""Families of shapes, and where the search starts."""
