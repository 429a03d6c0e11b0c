"""Arrays of balls, mid +- rad, rounded outwards: interval arithmetic that numpy does at once.

Proof note: each operation of float64 is off by at most half a unit in the last place of its result
(sums of n terms by n - 1 such). It is below 1e-292 by less than 1e-300. The radius takes more than
that on top, and each radius is itself enlarged by 1e-14 of it for its own few roundings.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

ROUND = 2.3e-16  # above half a unit in the last place, 2^-53, twice
TINY = 1e-300
GROW = 1 + 1e-14

UP, DOWN = 1 + 1e-12, 1 - 1e-12
"""Factors that take up some hundred roundings of a number outside of balls."""
WELL_UP, WELL_DOWN = 1 + 1e-9, 1 - 1e-9
"""The same for what is computed over many ticks."""


@dataclass(frozen=True)
class Ball:
    """Numbers that are known to lie within ``rad`` of ``mid``, element by element."""

    mid: np.ndarray
    rad: np.ndarray

    @classmethod
    def of(cls, value: Any) -> Ball:
        """Enclose rationals, or floats as they are."""
        if isinstance(value, Ball):
            return value
        if isinstance(value, Fraction):
            mid = np.asarray(float(value))
            return cls(mid, abs(mid) * ROUND + TINY)
        mid = np.asarray(value, dtype=float)
        return cls(mid, np.zeros_like(mid))

    @classmethod
    def near(cls, value: Any, error: float) -> Ball:
        """Enclose floats that are off by at most ``error``."""
        mid = np.asarray(value, dtype=float)
        return cls(mid, np.full_like(mid, error))

    def __add__(self, other: Any) -> Ball:
        o = Ball.of(other)
        mid = self.mid + o.mid
        return Ball(mid, (self.rad + o.rad + abs(mid) * ROUND + TINY) * GROW)

    def __neg__(self) -> Ball:
        return Ball(-self.mid, self.rad)

    def __sub__(self, other: Any) -> Ball:
        return self + -Ball.of(other)

    def __rsub__(self, other: Any) -> Ball:
        return Ball.of(other) - self

    def __mul__(self, other: Any) -> Ball:
        o = Ball.of(other)
        mid = self.mid * o.mid
        rad = abs(self.mid) * o.rad + abs(o.mid) * self.rad + self.rad * o.rad
        return Ball(mid, (rad + abs(mid) * ROUND + TINY) * GROW)

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, key: Any) -> Ball:
        return Ball(self.mid[key], self.rad[key])

    def dot(self, other: Ball) -> Ball:
        """Matrix product along the last axis of this one and the first of the other."""
        n = self.mid.shape[-1]
        mid = self.mid @ other.mid
        size = abs(self.mid) @ abs(other.mid)
        rad = abs(self.mid) @ other.rad + self.rad @ (abs(other.mid) + other.rad)
        return Ball(mid, (rad + (n + 1) * (size * ROUND + TINY)) * (GROW + n * ROUND))

    def over(self, other: Any) -> Ball:
        """Quotient by balls that lie away from zero.

        Raises:
            ZeroDivisionError: one does not.
        """
        o = Ball.of(other)
        least = abs(o.mid) - o.rad
        if not bool(np.all(least > 0)):
            raise ZeroDivisionError("division by a ball around zero")
        mid = self.mid / o.mid
        rad = (self.rad + abs(mid) * (1 + ROUND) * o.rad) / (least * (1 - ROUND))
        return Ball(mid, (rad + abs(mid) * ROUND + TINY) * GROW)

    def sqrt(self) -> Ball:
        """Square root of balls above zero."""
        low, high = np.sqrt(np.maximum(self.low(), 0.0)), np.sqrt(np.maximum(self.high(), 0.0))
        mid = (low + high) / 2
        return Ball(mid, ((high - low) / 2 + high * 4 * ROUND + TINY) * GROW)

    def low(self) -> np.ndarray:
        """Numbers below."""
        found = self.mid - self.rad
        return np.asarray(found - abs(found) * ROUND - TINY)

    def high(self) -> np.ndarray:
        """Numbers above."""
        found = self.mid + self.rad
        return np.asarray(found + abs(found) * ROUND + TINY)

    def size(self) -> np.ndarray:
        """Numbers that no absolute value exceeds."""
        return np.asarray((abs(self.mid) + self.rad) * (1 + 2 * ROUND) + TINY)
