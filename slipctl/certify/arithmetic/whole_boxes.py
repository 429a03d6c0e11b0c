"""Arrays of intervals in whole numbers: the ends are multiples of 1/ONE, rounded outwards.

Decimals of 12 digits and binary fractions of 80 bits are such multiples, and sums of them exact.

Nothing is trusted here but the whole numbers of Python: no float, no library of functions. The
methods are those of ``interval_arrays.Boxes``, so that a proof by cells is checked with either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.arithmetic.operations import ArrayOperations, Exact

BITS = 108
"""Bits behind the point, about."""

GUARD = 48
"""Further bits of an exponential while it is summed up."""

ONE = 10**12 << 68
"""Near 2^108."""

FARTHEST = ONE << 200
"""Ends beyond this bound nothing."""


class WholeBoxes(ArrayOperations):
    """Intervals of multiples of 1/ONE, one a box.

    Attributes:
        low, high: arrays of Python's whole numbers.
    """

    __slots__ = ()

    @classmethod
    def around(cls, low: Fraction, high: Fraction, many: int = 1) -> WholeBoxes:
        """The same interval of rationals in so many boxes."""
        a, b = math.floor(low * ONE), math.ceil(high * ONE)
        return cls(np.full(many, a, object), np.full(many, b, object))

    @classmethod
    def of_ends(cls, low: np.ndarray, high: np.ndarray) -> WholeBoxes:
        """Boxes of arrays of finite floats, which are taken as they are."""
        return cls(_of_floats(low, math.floor), _of_floats(high, math.ceil))

    def _truth(self, sure: Any, possible: Any) -> WholeBoxes:
        ends = (np.asarray(x, bool).astype(int).astype(object) for x in (sure, possible))
        return WholeBoxes(*(end * ONE for end in ends))

    def __add__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        return WholeBoxes(self.low + o.low, self.high + o.high)

    def __sub__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        return WholeBoxes(self.low - o.high, self.high - o.low)

    def __mul__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        ends = [self.low * o.low, self.low * o.high, self.high * o.low, self.high * o.high]
        low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
        return _within(low // ONE, -(-high // ONE))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        if ((o.low <= 0) & (o.high >= 0)).any():
            raise ZeroDivisionError("division by an interval that contains zero")
        tops = [self.low * ONE, self.high * ONE]
        below = [t // d for t in tops for d in (o.low, o.high)]
        above = [-(-t // d) for t in tops for d in (o.low, o.high)]
        return _within(np.minimum.reduce(below), np.maximum.reduce(above))

    def sq(self) -> WholeBoxes:
        """Square; never negative."""
        a = self.absolute()
        return a * a

    def sqrt(self) -> WholeBoxes:
        """Square root; what is negative in a box is left out.

        Raises:
            ArithmeticError: a box lies below zero.
        """
        if (self.high < 0).any():
            raise ArithmeticError("the root of a negative number")
        return WholeBoxes(_each(lambda a: math.isqrt(max(a, 0) * ONE), self.low),
                          _each(lambda a: math.isqrt(a * ONE) + 1, self.high))  # fmt: skip

    def exp(self) -> WholeBoxes:
        """Exponential."""
        return WholeBoxes(_each(lambda a: exponential(a)[0], self.low),
                          _each(lambda a: exponential(a)[1], self.high))  # fmt: skip

    def atan(self) -> WholeBoxes:
        """Arc tangent, by that of decimals."""
        return WholeBoxes(_each(lambda a: math.floor(_atan(a)[0] * ONE), self.low),
                          _each(lambda a: math.ceil(_atan(a)[1] * ONE), self.high))  # fmt: skip

    def ln(self) -> WholeBoxes:
        """Natural logarithm.

        Raises:
            ArithmeticError: a box comes to zero.
        """
        if (self.low <= 0).any():
            raise ArithmeticError("the logarithm of what comes to zero")
        return WholeBoxes(_each(lambda a: _logarithm(a)[0], self.low),
                          _each(lambda a: _logarithm(a)[1], self.high))  # fmt: skip

    def cells(self, size: Fraction) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the first and the last cell that hold each box; cell k is [k, k + 1] size.

        Raises:
            ArithmeticError: a box has no end near.
        """
        wide = Fraction(size) * ONE
        top, bottom = wide.numerator, wide.denominator
        first = self.low * bottom // top
        last = -(-self.high * bottom // top) - 1
        if first.size and (min(first) < -(2**40) or max(last) > 2**40):
            raise ArithmeticError("nothing bounds it")
        return first.astype(np.int64), np.maximum(first, last).astype(np.int64)

    def whole(self) -> np.ndarray:
        """The whole number that each box is about.

        Raises:
            ArithmeticError: one is about none.
        """
        near = (self.low + ONE // 2) // ONE
        if ((self.low < near * ONE - ONE // 4) | (self.high > near * ONE + ONE // 4)).any():
            raise ArithmeticError("a mode is no whole number")
        return near.astype(np.int64)


def _within(low: np.ndarray, high: np.ndarray) -> WholeBoxes:
    """Boxes of ends that are not too far out.

    Raises:
        ArithmeticError: they are.
    """
    if low.size and (low.min() < -FARTHEST or high.max() > FARTHEST):
        raise ArithmeticError("nothing bounds it")
    return WholeBoxes(low, high)


def _each(what: Callable[[int], int], values: np.ndarray) -> np.ndarray:
    return np.array([what(v) for v in values.tolist()], object)


def _of_floats(values: np.ndarray, turn: Callable[[Fraction], int]) -> np.ndarray:
    return _each(lambda v: turn(Fraction(v) * ONE), values)


def exponential(a: int) -> tuple[int, int]:
    """Ends of exp(a/ONE), as multiples of 1/ONE.

    With x = a/ONE / 2^m below 2^-6 in size, exp(x) lies within x^13 of the first 13 terms of its
    series. Each term is rounded down and counted one higher above. Then both ends are squared m
    times; of a negative x the quotient 1/exp(-x) is taken.

    Raises:
        ArithmeticError: it is beyond what is computed here.
    """
    if a < 0:
        low, high = exponential(-a)
        return (ONE * ONE) // high, -(-ONE * ONE // low)
    if a > ONE << 7:
        raise ArithmeticError("an exponential of more than 128")
    bits = BITS + GUARD + 192 * (a > ONE << 3)
    halvings = max(0, a.bit_length() - BITS + 7)
    x = (a << bits) // ONE >> halvings
    one = 1 << bits
    term, low = one, one
    for k in range(1, 13):
        term = ((term * x) >> bits) // k
        low += term
    high = low + 40 + ((x + 1) ** 13 >> (12 * bits)) + 1
    for _ in range(halvings):
        low, high = low * low >> bits, (high * high >> bits) + 1
    return low * ONE >> bits, (high * ONE >> bits) + 1


def _logarithm(a: int) -> tuple[int, int]:
    """Ends of ln(a/ONE): a guess in floats, set right by the exponential."""
    guess = math.floor((math.log(a) - math.log(ONE)) * ONE)
    below, above = guess - (1 << 68), guess + (1 << 68)
    for _ in range(60):
        if exponential(below)[1] <= a:
            break
        below -= abs(guess - below)
    else:
        raise ArithmeticError("no end of a logarithm was found")
    for _ in range(60):
        if exponential(above)[0] >= a:
            break
        above += abs(above - guess)
    else:
        raise ArithmeticError("no end of a logarithm was found")
    return below, above


def _atan(value: int) -> tuple[Fraction, Fraction]:
    """Ends of the arc tangent of a multiple of 1/ONE."""
    return Interval.of(Fraction(value, ONE), 40).atan().ends()
