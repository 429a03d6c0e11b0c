"""Arrays of intervals in whole numbers: the ends are multiples of 2^-80, rounded outwards.

Nothing is trusted here but the whole numbers of Python: no float, no library of functions. The
methods are those of ``interval_arrays.Boxes``, so that a proof by cells is checked with either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import Exact, Interval, exact

BITS = 80
"""Bits behind the point."""

GUARD = 48
"""Further bits of an exponential while it is summed up."""

ONE = 1 << BITS

FARTHEST = 1 << (BITS + 200)
"""Ends beyond this bound nothing."""


class WholeBoxes:
    """Intervals of multiples of 2^-80, one a box.

    Attributes:
        low, high: arrays of Python's whole numbers.
    """

    __slots__ = ("high", "low")
    __array_ufunc__ = None

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        self.low, self.high = low, high

    @classmethod
    def around(cls, low: Fraction, high: Fraction, many: int = 1) -> WholeBoxes:
        """The same interval of rationals in so many boxes."""
        a, b = math.floor(low * ONE), math.ceil(high * ONE)
        return cls(np.full(many, a, object), np.full(many, b, object))

    @classmethod
    def of_ends(cls, low: np.ndarray, high: np.ndarray) -> WholeBoxes:
        """Boxes of arrays of finite floats, which are taken as they are."""
        return cls(_of_floats(low, math.floor), _of_floats(high, math.ceil))

    def number(self, value: Exact) -> WholeBoxes:
        """A number as boxes of this many."""
        number = Fraction(exact(value))
        return WholeBoxes.around(number, number, self.low.size)

    def take(self, rows: Any) -> WholeBoxes:
        """Boxes of some rows."""
        return WholeBoxes(self.low[rows], self.high[rows])

    def _as(self, other: WholeBoxes | Exact) -> WholeBoxes:
        return other if isinstance(other, WholeBoxes) else self.number(other)

    def __add__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        return WholeBoxes(self.low + o.low, self.high + o.high)

    def __neg__(self) -> WholeBoxes:
        return WholeBoxes(-self.high, -self.low)

    def __sub__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        return WholeBoxes(self.low - o.high, self.high - o.low)

    def __rsub__(self, other: Exact) -> WholeBoxes:
        return self._as(other) - self

    def __mul__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        ends = [self.low * o.low, self.low * o.high, self.high * o.low, self.high * o.high]
        low, high = np.minimum.reduce(ends), np.maximum.reduce(ends)
        return _within(low >> BITS, -(-high >> BITS))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: WholeBoxes | Exact) -> WholeBoxes:
        o = self._as(other)
        if ((o.low <= 0) & (o.high >= 0)).any():
            raise ZeroDivisionError("division by an interval that contains zero")
        tops = [self.low << BITS, self.high << BITS]
        below = [t // d for t in tops for d in (o.low, o.high)]
        above = [-(-t // d) for t in tops for d in (o.low, o.high)]
        return _within(np.minimum.reduce(below), np.maximum.reduce(above))

    def __rtruediv__(self, other: Exact) -> WholeBoxes:
        return self._as(other) / self

    def _no_number(self, *_: object) -> Any:
        """Refuse what would look at boxes as if they were one number.

        Raises:
            TypeError: always.
        """
        raise TypeError("boxes are no single number: compare them by their own methods")

    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = __bool__ = __float__ = _no_number
    __hash__ = _no_number

    def sq(self) -> WholeBoxes:
        """Square; never negative."""
        a = self.absolute()
        return a * a

    def absolute(self) -> WholeBoxes:
        """Absolute value."""
        across = (self.low <= 0) & (self.high >= 0)
        low, high = abs(self.low), abs(self.high)
        return WholeBoxes(np.where(across, 0, np.minimum(low, high)), np.maximum(low, high))

    def sqrt(self) -> WholeBoxes:
        """Square root; what is negative in a box is left out.

        Raises:
            ArithmeticError: a box lies below zero.
        """
        if (self.high < 0).any():
            raise ArithmeticError("the root of a negative number")
        return WholeBoxes(_each(lambda a: math.isqrt(max(a, 0) << BITS), self.low),
                          _each(lambda a: math.isqrt(a << BITS) + 1, self.high))  # fmt: skip

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

    def minimum(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Smaller one of two."""
        o = self._as(other)
        return WholeBoxes(np.minimum(self.low, o.low), np.minimum(self.high, o.high))

    def maximum(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Larger one of two."""
        o = self._as(other)
        return WholeBoxes(np.maximum(self.low, o.low), np.maximum(self.high, o.high))

    def hull(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Smallest intervals around two."""
        o = self._as(other)
        return WholeBoxes(np.minimum(self.low, o.low), np.maximum(self.high, o.high))

    def meet(self, other: WholeBoxes) -> WholeBoxes:
        """What two enclosures of the same have in common."""
        return WholeBoxes(np.maximum(self.low, other.low), np.minimum(self.high, other.high))

    def less(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Whether self < other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        return _truth(self.high < o.low, self.low < o.high)

    def less_equal(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Whether self <= other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        return _truth(self.high <= o.low, self.low <= o.high)

    def equal(self, other: WholeBoxes | Exact) -> WholeBoxes:
        """Whether self = other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        sure = (self.low == self.high) & (o.low == o.high) & (self.low == o.low)
        return _truth(sure, (self.low <= o.high) & (o.low <= self.high))

    def choose(self, yes: WholeBoxes, no: WholeBoxes) -> WholeBoxes:
        """``yes`` where self is not 0, ``no`` where it is 0, both where that is open."""
        sure = ((self.low > 0) | (self.high < 0)).astype(bool)
        never = ((self.low == 0) & (self.high == 0)).astype(bool)
        both = yes.hull(no)
        return WholeBoxes(
            np.where(sure, yes.low, np.where(never, no.low, both.low)),
            np.where(sure, yes.high, np.where(never, no.high, both.high)),
        )

    def decided(self) -> bool:
        """Whether each box holds a single number."""
        return bool((self.low == self.high).all())

    def one_way(self) -> bool | None:
        """What a decided condition says where it says the same of all boxes, else None."""
        said = (self.low != 0).astype(bool)
        return bool(said[0]) if said.all() or not said.any() else None

    def touches_zero(self) -> bool:
        """Whether a box holds zero or what is below."""
        return bool((self.low <= 0).any())

    def open_rows(self) -> np.ndarray:
        """Rows that hold more than one number."""
        return np.flatnonzero((self.low != self.high).astype(bool))

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
        near = (self.low + ONE // 2) >> BITS
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


def _truth(sure: Any, possible: Any) -> WholeBoxes:
    return WholeBoxes(*(np.asarray(x, bool).astype(int).astype(object) * ONE
                        for x in (sure, possible)))  # fmt: skip


def _each(what: Callable[[int], int], values: np.ndarray) -> np.ndarray:
    return np.array([what(v) for v in values.tolist()], object)


def _of_floats(values: np.ndarray, turn: Callable[[Fraction], int]) -> np.ndarray:
    return _each(lambda v: turn(Fraction(v) * ONE), values)


def exponential(a: int) -> tuple[int, int]:
    """Ends of exp(a 2^-80), as multiples of 2^-80.

    With x = a 2^-80 / 2^m below 2^-7 in size, exp(x) lies within x^13 of the first 13 terms of its
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
    x = (a << (bits - BITS)) >> halvings
    one = 1 << bits
    term, low = one, one
    for k in range(1, 13):
        term = ((term * x) >> bits) // k
        low += term
    high = low + 40 + ((x + 1) ** 13 >> (12 * bits)) + 1
    for _ in range(halvings):
        low, high = low * low >> bits, (high * high >> bits) + 1
    return low >> (bits - BITS), (high >> (bits - BITS)) + 1


def _logarithm(a: int) -> tuple[int, int]:
    """Ends of ln(a 2^-80): a guess in floats, set right by the exponential."""
    guess = math.floor((math.log(a) - BITS * math.log(2)) * ONE)
    below, above = guess - (1 << 40), guess + (1 << 40)
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
    """Ends of the arc tangent of a multiple of 2^-80."""
    return Interval.of(Fraction(value, ONE), 40).atan().ends()
