"""Where the sampled reaching law behind a lag can be, tick after tick: a polygon and its mirror.

One tick, exact for a command that is held: (s, a)+ = M (s, a) - b sgn s + (e, 0), |e| <= T D. All
states are kept in the convex polygon of those with s >= 0 and its mirror image. A polygon that
every run enters (``Absorbing``) comes first; what lasts is found tick after tick on a lattice of
whole numbers, each corner moved outwards to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from slipctl.certify.arithmetic.decimal_intervals import Interval, over_one

Point = tuple[Fraction, Fraction]
Node = tuple[int, int]

DIGITS = 60
BITS = 20
"""A side of the first polygon is about 2^BITS units long."""

SHIFT = 90
"""Coefficients are whole numbers over 2^SHIFT."""


@dataclass(frozen=True)
class Relay:
    """Reaching law u = -g1 s - g2 sgn s, held over T, behind a lag; s' = a + d, |d| <= D."""

    g1: Fraction
    g2: Fraction
    T: Fraction
    lag: Fraction
    D: Fraction

    @cached_property
    def left(self) -> tuple[Fraction, Fraction]:
        """Enclosure of exp(-T/lag), what a tick leaves of the lag's error."""
        if not self.lag:
            return Fraction(0), Fraction(0)
        return Interval.of(-self.T / self.lag, DIGITS).exp().ends()

    def rows(self, left: Fraction) -> tuple[Row, Row]:
        """Give (m11, m12, b1), (m21, m22, b2) where exp(-T/lag) is ``left``; affine in it."""
        reach, taken = self.lag * (1 - left), 1 - left
        held = self.T - reach
        return (
            (1 - self.g1 * held, reach, self.g2 * held),
            (-self.g1 * taken, left, self.g2 * taken),
        )


Row = tuple[Fraction, Fraction, Fraction]
Enclosed = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Absorbing:
    """Convex polygon, its own mirror image, into which every run comes.

    Attributes:
        law: the law. corners: in turn, counter-clockwise.
    """

    law: Relay
    corners: tuple[Point, ...]

    def holds(self) -> bool:
        """Whether every run comes into it and stays.

        Proof note: the polygon is {n_k . x <= 1}. For lam >= 1 the states of lam times it with
        s >= 0 go to n_k . x+ <= lam n_k . M P - n_k . b + T D |n_k1| for the worst corner P of the
        half s >= 0. If n_k . M P <= 1, and at lam = 1 the sum is below 1, it is below lam by
        as much for every lam >= 1. The size falls by a constant in each tick. Where s = 0 the sign
        may be anything between -1 and 1: the polygon is convex.
        """
        faces = self._faces()
        if not faces or len(half := upper_half(self.corners)) < 3:
            return False
        (Ds, _), (Da, _) = self._whole
        push = self.law.T * self.law.D
        for left in self.law.left:  # all of it is affine in exp(-T/lag): its ends decide
            (m11, m12, b1), (m21, m22, b2) = self.law.rows(left)
            Dx, X = over_one([m11 * s + m12 * a for s, a in half])
            Dy, Y = over_one([m21 * s + m22 * a for s, a in half])
            moved = [(Ds * x * Dy, Da * y * Dx) for x, y in zip(X, Y, strict=True)]
            for n, m, size in faces:
                rest = Ds * (push * abs(n) - n * b1) - Da * m * b2
                most = min(size * Dx * Dy, math.ceil((size - rest) * Dx * Dy) - 1)
                if any(n * x + m * y > most for x, y in moved):
                    return False
        return True

    @cached_property
    def _whole(self) -> tuple[tuple[int, list[int]], tuple[int, list[int]]]:
        """Corners as whole numbers S/Ds, A/Da."""
        s, a = zip(*self.corners, strict=True)
        return over_one(s), over_one(a)

    def _faces(self) -> list[tuple[int, int, int]] | None:
        """Give n, m, size with n Ds s + m Da a = size along each side; None if it is misshapen."""
        P = self.corners
        if not 4 <= len(P) <= 200 or set(P) != {(-s, -a) for s, a in P}:
            return None
        (_, S), (_, A) = self._whole
        W = list(zip(S, A, strict=True))
        faces = []
        for (s, a), (s2, a2) in zip(W, W[1:] + W[:1], strict=True):
            size = s * a2 - a * s2
            if size <= 0:
                return None
            faces.append((a2 - a, s - s2, size))
        if any(n * s + m * a > size for n, m, size in faces for s, a in W):
            return None
        return faces


def upper_half(P: Sequence[Point]) -> list[Point]:
    """Part of a polygon with s >= 0."""
    out: list[Point] = []
    for (s, a), (s2, a2) in zip(P, [*P[1:], P[0]], strict=True):
        if s >= 0:
            out.append((s, a))
        if (s > 0 > s2) or (s < 0 < s2):
            out.append((Fraction(0), a + (a2 - a) * s / (s - s2)))
    return out


# ---- ticks --------------------------------------------------------------------------------------


class Ticker:
    """Polygon of the states with s >= 0 in whole units, tick by tick.

    Attributes:
        points: corners of the polygon. unit: of s and of a.
    """

    def __init__(self, start: Absorbing) -> None:
        half = upper_half(start.corners)
        law = start.law
        size = max(s for s, _ in half), max(abs(a) for _, a in half)
        self.unit = size[0] / 2**BITS, size[1] / 2**BITS
        ratio, one = self.unit[1] / self.unit[0], 1 << SHIFT
        (m11, m12, b1), (m21, m22, b2) = [
            [tuple(sorted(pair)) for pair in zip(*rows, strict=True)]
            for rows in zip(*(law.rows(left) for left in law.left), strict=True)
        ]

        def fixed(x: Enclosed, by: Fraction) -> Node:
            return math.floor(x[0] * by * one), math.ceil(x[1] * by * one)

        self.s_row = (fixed(m11, Fraction(1)), fixed(m12, ratio), fixed(b1, 1 / self.unit[0]))
        self.a_row = (fixed(m21, 1 / ratio), fixed(m22, Fraction(1)), fixed(b2, 1 / self.unit[1]))
        self.noise = math.ceil(law.T * law.D / self.unit[0])
        self.points = hull([
            corner for s, a in half
            for corner in _around(s / self.unit[0], a / self.unit[1])
        ])  # fmt: skip

    def tick(self) -> None:
        """Go one tick on.

        Proof note: the images of the corners with the sign +1, with the disturbance to both sides,
        span what the polygon goes to; its parts with s < 0 are mirrored. s = 0 with the sign 0 is
        moved without b.
        """
        image = []
        for point in self.points:
            image += self._moved(point, 1)
        inside = hull(image)
        parts = [p for p in inside if p[0] >= 0] + [(-s, -a) for s, a in inside if s <= 0]
        for (s, a), (s2, a2) in zip(inside, [*inside[1:], inside[0]], strict=True):
            if s * s2 < 0:
                at = Fraction(a * s2 - a2 * s, s2 - s)
                parts += [(0, math.floor(at)), (0, math.ceil(at))]
                parts += [(0, -math.floor(at)), (0, -math.ceil(at))]
        for point in self.points:
            if point[0] == 0:
                rest = self._moved(point, 0)
                parts += [p for p in rest if p[0] >= 0] + [(-s, -a) for s, a in rest if s <= 0]
                parts += [(0, a) for _, a in rest] + [(0, -a) for _, a in rest]
        self.points = hull(parts)

    def largest(self) -> Fraction:
        """Bound of |s|."""
        return max(s for s, _ in self.points) * self.unit[0]

    def _moved(self, point: Node, sign: int) -> list[Node]:
        s = _sum(self.s_row, point, sign)
        a = _sum(self.a_row, point, sign)
        return [(x, y) for x in (s[0] - self.noise, s[1] + self.noise) for y in a]


def _sum(row: tuple[Node, Node, Node], point: Node, sign: int) -> Node:
    low = high = 0
    for (least, most), x in zip(row, (*point, -sign), strict=True):
        if x >= 0:
            low += least * x
            high += most * x
        elif x:
            low += most * x
            high += least * x
    return low >> SHIFT, -(-high >> SHIFT)


def _around(s: Fraction, a: Fraction) -> list[Node]:
    return [(x, y) for x in (math.floor(s), math.ceil(s)) for y in (math.floor(a), math.ceil(a))]


def hull(points: Sequence[Node]) -> list[Node]:
    """Corners of the convex hull, counter-clockwise; exact for whole numbers."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered
    chains = []
    for way in (ordered, ordered[::-1]):
        chain: list[Node] = []
        for p in way:
            x, y = p
            while len(chain) > 1:
                (x0, y0), (x1, y1) = chain[-2], chain[-1]
                if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                    break
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return chains[0] + chains[1]


# ---- finding ------------------------------------------------------------------------------------


def find(law: Relay) -> Absorbing | None:
    """Small polygon into which every run comes; None if none is found."""
    import numpy as np

    if not law.lag or law.left[0] == law.left[1]:
        return None
    (m11, m12, b1), (m21, m22, b2) = (map(float, row) for row in law.rows(law.left[0]))
    M, b, e = np.array([[m11, m12], [m21, m22]]), np.array([b1, b2]), float(law.T * law.D)
    lag, g1 = float(law.lag), float(law.g1)
    shapes: list[np.ndarray] = []
    for times in (1.05, 1.2, 1.5, 2.0, 3.0, 5.0):
        x = 1 / (times * lag)  # |s + lag a| <= 1, |a| <= x
        shapes.append(np.array([[-1 - lag * x, x], [-1 + lag * x, -x],
                                [1 + lag * x, -x], [1 - lag * x, x]]))  # fmt: skip
    if g1 and max(abs(np.linalg.eigvals(M))) < 1 - 1e-9:
        for weight in (0.2, 1.0, 5.0):
            Q = np.diag([1.0, (weight * lag) ** 2])
            total, power = Q.copy(), M.copy()
            for _ in range(60):  # sum of M'^k Q M^k, doubled each time
                total = total + power.T @ total @ power
                power = power @ power
            inverse = np.linalg.inv(np.linalg.cholesky(total)).T
            for n in (12, 24, 48, 96):
                angle = 2 * np.pi * (np.arange(n) + 0.5) / n
                shapes.append(np.stack([np.cos(angle), np.sin(angle)], axis=1) @ inverse.T)
    best, value = None, math.inf
    for P in shapes:
        size = _size(P, M, b, e)
        if size is not None and size * P[:, 0].max() < value:
            value, best = size * P[:, 0].max(), P * size * 1.001
    if best is None:
        return None
    half: list[Point] = []
    scale = abs(best).max(axis=0)
    for s, a in best[: len(best) // 2].tolist():
        if len(best) == 4:  # s + lag a stays as it is where g1 = 0: its sides need their direction
            far = _short(a, scale[1])
            half.append((_short(s + lag * a, scale[0]) - law.lag * far, far))
        else:
            half.append((_short(s, scale[0]), _short(a, scale[1])))
    found = Absorbing(law, tuple(half + [(-s, -a) for s, a in half]))
    return found if found.holds() else None


def _short(x: float, scale: float) -> Fraction:
    grid = Fraction(2) ** (math.frexp(scale)[1] - 30)
    return round(Fraction(float(x)) / grid) * grid


def _size(P: object, M: object, b: object, e: float) -> float | None:
    """Least factor of a polygon with which ``Absorbing`` holds, in doubles; None if none does."""
    import numpy as np

    corners = np.asarray(P)
    ahead = np.roll(corners, -1, axis=0)
    size = corners[:, 0] * ahead[:, 1] - corners[:, 1] * ahead[:, 0]
    faces = np.stack([ahead[:, 1] - corners[:, 1], corners[:, 0] - ahead[:, 0]], axis=1)
    faces = faces / size[:, None]
    half = np.array(
        [[float(x) for x in p] for p in upper_half([tuple(p) for p in corners.tolist()])]
    )
    up = faces @ np.asarray(M) @ half.T
    need = (abs(faces[:, 0]) * e - faces @ np.asarray(b))[:, None]
    if (up > 1 - 1e-12).any() and ((up > 1 + 1e-12) | ((up > 1 - 1e-12) & (need >= 0))).any():
        return None
    with np.errstate(divide="ignore"):
        least = np.where(up < 1 - 1e-12, need / np.maximum(1 - up, 1e-300), 0.0)
    return float(max(least.max(), 1e-9 * e, 1e-12))
