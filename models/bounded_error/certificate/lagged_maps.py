"""One error behind an actuator with a lag and a dead time: sets that are never left.

    a' = (u(t - dead) - a)/lag,   e' = a + w,   u held over T

With alpha = a T, E = exp(-T/lag), c1 = (lag/T)(1 - E), c2 = 1 - c1 and U the command times T

    z+ = r (z + c + c1 alpha + c2 U) - c + p,   alpha+ = r (E alpha + (1 - E) U)
    U = -pull(y) - g (1 - 1/r)(y + c),   y = z + n,   |n| <= noise,   |p| <= push,   1 <= r <= r_max

r and g tell the motion of a funnel; a bound that stands still has r = 1. A dead time of m ticks
makes y an error of m ticks ago, which differs from z by no more than m moves: it counts as noise.
At the start nothing is on its way: alpha = 0, and U = 0 in the first m ticks.

A set is a polygon with given normals, {n_k (z, alpha/scale) <= s_k}. It is cut into slices of z. A
slice lies in a trapezoid, U on it in an interval, and the map is affine in what is left. So the
image of a slice lies in the hull of the images of its corners. A search with floats finds the
levels s_k; a proof goes through the slices once, with decimals rounded outwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate.scalar_maps import DIGITS, SLOP, Interval, Pull

SIDES = 64
"""Number of normals."""

SLICES = 80
"""Number of slices on either side of zero, each of the same width."""

MOST = 6000
"""Longest search in ticks."""

_ANGLES = tuple(2 * math.pi * k / SIDES for k in range(SIDES))
NORMALS = tuple((round(10**6 * math.cos(x)), round(10**6 * math.sin(x))) for x in _ANGLES)
"""Normals in (z, alpha/scale), as whole numbers; any set of them would do."""

Levels = Sequence[Any]


@dataclass(frozen=True)
class Lagged:
    """A law behind its actuator, floats or decimals; see the module's text.

    Attributes:
        below, above: pull at negative and at positive measured errors.
        push: largest |p|. noise: largest |n| without the dead time. dead: m, ticks.
        E, c1, c2: of the lag. r, g, c: motion of the bounds, r the largest.
        scale: size of alpha in the polygon.
    """

    below: Pull
    above: Pull
    push: Any
    noise: Any
    dead: int
    E: Any
    c1: Any
    c2: Any
    scale: Any
    r: Any = 1
    g: Any = 0
    c: Any = 0

    def corners(self) -> tuple[Any, ...]:
        """Values of r whose hull holds all; the map is affine in r."""
        return (self.r,) if self.r == 1 else (1, self.r)


def lag_numbers(lag: Any, T: Any, dead: int) -> tuple[Any, Any, Any, Any, int]:
    """E, c1, c2, scale and the dead time that is left; without lag alpha is a tick of dead time."""
    if not lag:
        one = T / T
        return (one - one, one, one - one, one, dead - 1) if dead else (
            one - one, one - one, one, one, 0)  # fmt: skip
    x = -T / lag
    E = x.exp() if isinstance(x, Decimal) else math.exp(x)
    c1 = lag / T * (1 - E)
    return E, c1, 1 - c1, T / max(lag, T), dead


# ---- search, with floats ------------------------------------------------------------------------

Floats = NDArray[np.float64]


def signed_pull(law: Lagged, y: Floats) -> Floats:
    """Pull with its sign."""
    far, near = float(law.below.width), float(law.above.width)
    out = np.zeros_like(y)
    up, down = y >= 0, y < 0
    out[up] = _values(law.above, np.minimum(y[up], near))
    out[down] = -_values(law.below, np.minimum(-y[down], far))
    return out


def _values(pull: Any, y: Floats) -> Floats:
    kappa = getattr(pull, "kappa", None)
    if kappa is None:
        found: Floats = pull.at(y)
        return found
    inner = np.minimum(y, 1 - 1e-15)
    return np.asarray(kappa * (1 - inner * inner) * np.arctanh(inner))


def _pulls(law: Lagged, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Least and largest pull over intervals of y."""
    a, b = signed_pull(law, low), signed_pull(law, high)
    least, most = np.minimum(a, b), np.maximum(a, b)
    top, bottom = float(law.above.peak), -float(law.below.peak)
    most = np.where((low < top) & (top < high), law.above.at(top), most)
    least = np.where((low < bottom) & (bottom < high), -law.below.at(-bottom), least)
    return least, most


def invariant_levels(
    law: Lagged, start: Interval, inner: Floats | None = None, step: float = 0.0
) -> tuple[Floats, float] | None:
    """Levels of a polygon that nothing leaves, and how far z moves in a tick at most; or None.

    It holds the start, with the actuator at rest, and ``inner`` shifted by a step either way. Tried
    are large strides first, then small ones that overshoot less. During the dead time nothing
    pulls, so that the push alone widens the start.
    """
    normals = np.array(NORMALS, dtype=float)
    wide = law.dead * float(law.push)
    levels = start_levels(Interval(start.low - wide, start.high + wide), normals[:, 0])
    if inner is not None:
        levels = np.maximum(levels, inner + np.abs(normals[:, 0]) * step)
    for spare, stride in ((1e-3, 8.0), (1e-4, 2.0)):
        found = _grown(law, normals, levels, spare, stride)
        if found is not None:
            return found
    return None


def start_levels(start: Interval, n0: Any) -> Any:
    """Levels of a polygon that just holds a start, actuator at rest."""
    return np.maximum(n0 * start.low, n0 * start.high)


def _grown(
    law: Lagged, normals: Floats, levels: Floats, spare: float, stride: float
) -> tuple[Floats, float] | None:
    near, far = float(law.above.width), float(law.below.width)
    size, scaled = np.abs(normals[:, 0]), normals / (1.0, float(law.scale))
    moved = 0.0
    pull = max(float(law.above.at(law.above.peak)), float(law.below.at(law.below.peak)))
    more = 1e6 * spare * min(float(law.push) + 0.1 * pull, near)
    levels = levels + 1e-9 * near * 1e6
    leap = 1.0
    for _ in range(MOST):
        low, high = -levels[SIDES // 2] / 1e6, levels[0] / 1e6
        noise = float(law.noise) + law.dead * moved
        if high + noise >= near or low - noise <= -far:
            return None
        edges = np.array(_edges(low, high))
        points, moves = _images(law, normals, levels, edges, noise)
        move = (np.abs(moves).max() + float(law.push)) * (1 + spare)
        reach = (scaled @ points).max(axis=1) + size * float(law.push)
        if (reach <= levels).all() and (not law.dead or move <= moved):
            return levels, moved
        wanted = reach + more
        levels = np.maximum(levels, levels + leap * (wanted - levels))
        moved = max(moved, move) if law.dead else 0.0
        leap = min(leap * 1.02, stride)
    return None


def _edges(low: Any, high: Any) -> list[Any]:
    """Edges of the slices."""
    zero = low - low
    below = [low * (SLICES - i) / SLICES for i in range(SLICES)]
    return [*below, zero, *(high * i / SLICES for i in range(1, SLICES)), high]


def _images(
    law: Lagged, normals: Floats, levels: Floats, edges: Floats, noise: float
) -> tuple[Floats, Floats]:
    """Corner points after a tick without push, as (z, alpha) rows, and their moves of z."""
    left, right = edges[:-1], edges[1:]
    tops, bottoms = _lids(normals, levels, edges, float(law.scale))
    least, most = _pulls(law, left - noise, right + noise)
    z, alpha = np.array([left, right])[:, None, None], np.array([tops, bottoms]).swapaxes(0, 1)
    alpha = alpha[:, :, None]
    images, moves = [], []
    for r in map(float, law.corners()):
        drift = float(law.g) * (1 - 1 / r)
        extra, spare = drift * (z + float(law.c)), drift * noise
        U = np.array([-most - spare, -least + spare]) - extra
        after = r * (z + float(law.c) + (law.c1 * alpha + law.c2 * U)) - float(law.c)
        images.append(np.stack([after.ravel(), (r * (law.E * alpha + (1 - law.E) * U)).ravel()]))
        moves.append((after - z).ravel())
    return np.concatenate(images, axis=1), np.concatenate(moves)


def _lids(
    normals: Floats, levels: Floats, edges: Floats, scale: float
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Alpha of the lines that bound each slice above and below, at its left and right edge."""
    middle = (edges[:-1] + edges[1:]) / 2
    out = []
    for sign in (1, -1):
        chosen = np.nonzero(sign * normals[:, 1] > 0.5)[0]
        n, s = normals[chosen], levels[chosen]
        at = (s[:, None] - n[:, :1] * middle) / n[:, 1:] * scale
        best = at.argmin(axis=0) if sign > 0 else at.argmax(axis=0)

        def line(z: Floats, n: Floats = n[best], s: Floats = s[best]) -> Floats:
            return np.asarray((s - n[:, 0] * z) / n[:, 1] * scale)

        out.append((line(edges[:-1]), line(edges[1:])))
    return (out[0][0], out[0][1]), (out[1][0], out[1][1])


# ---- proof, with decimals -----------------------------------------------------------------------


def keeps(law: Lagged, levels: Levels, moved: Any) -> bool:
    """Whether nothing leaves the polygon in a tick; law, levels and moved made of decimals.

    Args:
        law: decimals. levels: of the normals. moved: bound of the move of z in a tick, which a
            dead time needs.
    """
    with precise(DIGITS):
        noise = law.noise + law.dead * moved
        low, high = -levels[SIDES // 2] / 10**6, levels[0] / 10**6
        if not (-law.below.width < low - noise and high + noise < law.above.width):
            return False
        edges = _edges(low, high)
        tables = [_table(levels, law.scale, sign) for sign in (1, -1)]
        most_move = Decimal(0)
        points = set()
        for left, right in pairwise(edges):
            least, most = _pull_range(law, left - noise, right + noise)
            lids = [_lid(table, (left + right) / 2, sign)
                    for table, sign in zip(tables, (1, -1), strict=True)]  # fmt: skip
            for r in law.corners():
                drift = law.g * (1 - Decimal(1) / r)
                for z in (left, right):
                    extra = drift * (z + law.c)
                    for level, n0, n1 in lids:
                        alpha = (level - n0 * z) / n1 * law.scale
                        for U in (-most - extra - drift * noise, -least - extra + drift * noise):
                            after = r * (z + law.c + law.c1 * alpha + law.c2 * U) - law.c
                            most_move = max(most_move, abs(after - z))
                            points.add((after, r * (law.E * alpha + (1 - law.E) * U) / law.scale))
        if law.dead and most_move + law.push + SLOP > moved:
            return False
        return _all_inside(_outermost(points), levels, law.push + SLOP)


def _outermost(points: Any) -> list[tuple[int, int]]:
    """Corners of the hull of points, as multiples of 1e-20, and within 1e-20 of it."""
    with precise(DIGITS):
        whole = sorted({(_units(x), _units(y)) for x, y in points})
    hull: list[tuple[int, int]] = []
    for way in (whole, whole[::-1]):
        part: list[tuple[int, int]] = []
        for p in way:
            while len(part) > 1 and _turns(part[-2], part[-1], p) <= 0:
                part.pop()
            part.append(p)
        hull += part[:-1]
    return hull


def _units(x: Any) -> int:
    return int(x.scaleb(20).to_integral_value())


def _turns(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> int:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _all_inside(hull: Sequence[tuple[int, int]], levels: Levels, push: Any) -> bool:
    """Whether all points, moved by at most the push in z and 1e-20 in both, lie in the polygon."""
    unit = 10**20
    down, up = Context(prec=60, rounding=ROUND_FLOOR), Context(prec=60, rounding=ROUND_CEILING)
    shift = int(up.multiply(push, Decimal(unit)).to_integral_value(ROUND_CEILING)) + 2
    for (n0, n1), level in zip(NORMALS, levels, strict=True):
        room = int(down.multiply(level, Decimal(unit)).to_integral_value(ROUND_FLOOR))
        room -= abs(n0) * shift + 2 * abs(n1)
        if any(n0 * x + n1 * y > room for x, y in hull):
            return False
    return True


def _table(levels: Levels, scale: Any, sign: int) -> list[tuple[Any, int, int]]:
    return [(level, n0, n1) for (n0, n1), level in zip(NORMALS, levels, strict=True)
            if sign * n1 > 0]  # fmt: skip


def _lid(table: Sequence[tuple[Any, int, int]], z: Any, sign: int) -> tuple[Any, int, int]:
    """The line that bounds alpha best at z; any would be right."""
    x = float(z)
    return min(table, key=lambda line: sign * (float(line[0]) - line[1] * x) / line[2])


def _pull_range(law: Lagged, low: Any, high: Any) -> tuple[Any, Any]:
    """Bounds of the pull with its sign over [low, high], as it is concave on either side."""

    def signed(y: Any) -> Any:
        return law.above.at(y) if y >= 0 else -law.below.at(-y)

    a, b = signed(low), signed(high)
    least, most = min(a, b), max(a, b)
    if high > 0:
        most = max(most, _under_tangent(law.above, max(low, Decimal(0)), high))
    if low < 0:
        least = min(least, -_under_tangent(law.below, max(-high, Decimal(0)), -low))
    return least - SLOP, most + SLOP


def _under_tangent(pull: Pull, low: Any, high: Any) -> Any:
    """Upper bound of a concave pull over [low, high]: the tangent at the place nearest its peak."""
    y = min(max(Decimal(pull.peak), low), high)
    slope = pull.slope(y)
    return pull.at(y) + max(slope * (low - y), slope * (high - y), Decimal(0))


def decimal_levels(levels: Sequence[float]) -> tuple[Decimal, ...]:
    """Levels as whole numbers and six digits, rounded up."""
    step = Decimal("1e-6")
    return tuple(Decimal(float(x)).quantize(step, ROUND_CEILING) for x in levels)
