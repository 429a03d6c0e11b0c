"""Arrays of intervals of floats that are rounded outwards: many boxes at once, in NumPy.

Sums, products, quotients and roots of IEEE arithmetic are correctly rounded, so one unit in the
last place is enough. Exponentials and logarithms of NumPy are wrong by less than 4, and get 8. The
methods are those of ``decimal_intervals.Interval``, so that ``tick_code`` takes either.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.operations import ArrayOperations, Exact

WIDE = 8
"""Units in the last place of exponentials and logarithms."""


class Boxes(ArrayOperations):
    """Intervals of floats, one a box; an end that is not a number becomes infinite."""

    __slots__ = ()

    def __init__(self, low: Any, high: Any) -> None:
        self.low, self.high = low, high
        if np.isnan(np.sum(low)) or np.isnan(np.sum(high)):  # or infinite ones of both signs
            self.low = np.where(np.isnan(low), -np.inf, low)
            self.high = np.where(np.isnan(high), np.inf, high)

    @classmethod
    def around(cls, low: Fraction, high: Fraction, many: int = 1) -> Boxes:
        """The same interval of rationals in so many boxes."""
        a, b = _below(low), -_below(-high)
        return cls(np.full(many, a), np.full(many, b))

    @classmethod
    def of_ends(cls, low: np.ndarray, high: np.ndarray) -> Boxes:
        """Boxes of arrays of finite floats, which are taken as they are."""
        return cls(low, high)

    @classmethod
    def _ordered(cls, low: Any, high: Any) -> Boxes:
        found = cls.__new__(cls)
        found.low, found.high = low, high
        return found

    def _truth(self, sure: Any, possible: Any) -> Boxes:
        return Boxes._ordered(sure * 1.0, possible * 1.0)

    def __add__(self, other: Boxes | Exact) -> Boxes:
        o = self._as(other)
        return Boxes(_sum_below(self.low, o.low), -_sum_below(-self.high, -o.high))

    def __sub__(self, other: Boxes | Exact) -> Boxes:
        o = self._as(other)
        return Boxes(_sum_below(self.low, -o.high), -_sum_below(-self.high, o.low))

    def __mul__(self, other: Boxes | Exact) -> Boxes:
        o = self._as(other)
        for one, many in ((o, self), (self, o)):
            if one.low.size == 1 and one.low[0] == one.high[0] and abs(one.low[0]) < np.inf:
                return many._times(float(one.low[0]))
        with np.errstate(invalid="ignore"):
            p, q = self.low * o.low, self.low * o.high
            r, s = self.high * o.low, self.high * o.high
        low = np.minimum(np.minimum(p, q), np.minimum(r, s))
        high = np.maximum(np.maximum(p, q), np.maximum(r, s))
        if np.isnan(low).any():  # zero times infinity is zero
            ends = [_product(a, b) for a in (self.low, self.high) for b in (o.low, o.high)]
            low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
        found = _outwards_unless(_exact_factor(self) | _exact_factor(o), low, high)
        if (found.low < 0).any():  # what two numbers that are not negative give is none either
            found.low = np.where(
                (self.low >= 0) & (o.low >= 0), np.maximum(found.low, 0), found.low
            )
        return found

    def _times(self, by: float) -> Boxes:
        """Product by one number."""
        if by == 0:
            return Boxes(np.zeros_like(self.low), np.zeros_like(self.high))
        ends = (self.low, self.high) if by >= 0 else (self.high, self.low)
        with np.errstate(invalid="ignore"):
            low, high = ends[0] * by, ends[1] * by
        exact = [end == 0 for end in ends]
        if _is_power_of_two(by):
            exact = [end * by / by == end for end in ends]
        return Boxes(np.where(exact[0], low, _down(low)), np.where(exact[1], high, -_down(-high)))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Boxes | Exact) -> Boxes:
        o = self._as(other)
        across = (o.low <= 0) & (o.high >= 0)
        if across.all():
            raise ZeroDivisionError("division by an interval that contains zero")
        if o.low.size == 1 and o.low[0] == o.high[0] and _is_power_of_two(float(o.low[0])):
            return self._times(1 / float(o.low[0]))
        with np.errstate(all="ignore"):
            ends = [a / b for a in (self.low, self.high) for b in (o.low, o.high)]
        low = np.where(across, -np.inf, np.minimum.reduce(ends))
        return _outwards(low, np.where(across, np.inf, np.maximum.reduce(ends)))

    def sq(self) -> Boxes:
        """Square; never negative."""
        a = self.absolute()
        found = a * a
        return Boxes(np.maximum(found.low, 0.0), found.high)

    def sqrt(self) -> Boxes:
        """Square root; nothing is said where a box goes below zero."""
        lost = self.low < 0
        with np.errstate(invalid="ignore"):
            low, high = np.sqrt(self.low), np.sqrt(self.high)
        found = _outwards(np.where(lost, -np.inf, low), np.where(lost, np.inf, high))
        return Boxes(np.where(lost, found.low, np.maximum(found.low, 0.0)), found.high)

    def exp(self) -> Boxes:
        """Exponential."""
        with np.errstate(over="ignore"):
            found = _outwards(np.exp(self.low), np.exp(self.high), WIDE)
        return Boxes(np.maximum(found.low, 0.0), found.high)

    def ln(self) -> Boxes:
        """Natural logarithm; nothing is said where a box goes to zero or below."""
        lost = self.low <= 0
        with np.errstate(invalid="ignore", divide="ignore"):
            low, high = np.log(self.low), np.log(self.high)
        return _outwards(np.where(lost, -np.inf, low), np.where(lost, np.inf, high), WIDE)

    def atan(self) -> Boxes:
        """Arc tangent."""
        return _outwards(np.arctan(self.low), np.arctan(self.high), WIDE)

    def cells(self, size: Fraction) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the first and the last cell that hold each box; cell k is [k, k + 1] size.

        Args:
            size: whole number below 128 times a power of two, so that ends of cells are exact.

        Raises:
            ArithmeticError: a box has no end near.
        """
        wide, far = float(size), float(2**40)
        if not (self.low.min(initial=0) > -far * wide and self.high.max(initial=0) < far * wide):
            raise ArithmeticError("nothing bounds it")
        first, last = np.floor(self.low / wide), np.ceil(self.high / wide) - 1
        first = np.where(first * wide > self.low, first - 1, first)
        last = np.where((last + 1) * wide < self.high, last + 1, last)
        return first.astype(np.int64), np.maximum(first, last).astype(np.int64)

    def whole(self) -> np.ndarray:
        """The whole number that each box is about.

        Raises:
            ArithmeticError: one is about none.
        """
        near = np.rint(self.low)
        if not ((self.low > near - 0.25) & (self.high < near + 0.25)).all():
            raise ArithmeticError("a mode is no whole number")
        return near.astype(np.int64)


def _is_power_of_two(value: float) -> bool:
    """Whether products and quotients by it are exact, where floats do not end."""
    return abs(math.frexp(value)[0]) == 0.5 and 2.0**-99 < abs(value) < 2.0**99


def _down(values: np.ndarray, units: int = 1) -> np.ndarray:
    """No more than what was rounded to these floats, each wrong by so many units at most.

    A unit in the last place of x is at most 2^-52 |x|; half a unit more is taken for the rounding
    here. ``nextafter`` is 25 times slower.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        return values - (np.abs(values) * ((units + 0.5) * 2.0**-52) + units * 5e-324)


def _outwards(low: np.ndarray, high: np.ndarray, units: int = 1) -> Boxes:
    return Boxes(_down(low, units), -_down(-high, units))


def _sum_below(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sum of floats rounded down: its error is a float too (Knuth), and exact sums stay."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = a + b
        part = total - a
        lost = (a - (total - part)) + (b - part)
        return np.where(lost >= 0, total, _down(total))


def _exact_factor(values: Boxes) -> np.ndarray:
    """Where both ends are one and the same of 0, 1 and -1, so that products by them are exact."""
    return (values.low == values.high) & ((values.low == 0) | (np.abs(values.low) == 1))


def _outwards_unless(exact: np.ndarray, low: np.ndarray, high: np.ndarray) -> Boxes:
    if not exact.any():
        return _outwards(low, high)
    return Boxes(np.where(exact, low, _down(low)), np.where(exact, high, -_down(-high)))


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of ends, in which zero times infinity is zero."""
    with np.errstate(invalid="ignore"):
        return np.where((a == 0) | (b == 0), 0.0, a * b)


def _below(value: Fraction) -> float:
    """Largest float that is not above a rational, or the one below it."""
    near = float(value)
    return near if Fraction(near) <= value else float(np.nextafter(near, -np.inf))
