"""What intervals have in common: of decimals, arrays of floats, arrays of whole numbers.

A kind brings its ends ``low`` and ``high``, ``number``, ``_truth`` and the operations that round.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, NoReturn, Self

import numpy as np

Exact = Fraction | int | float
"""A number that is taken as it is: a float is the rational that its bits are."""


def exact(value: Exact) -> Fraction | int:
    """A number as a rational.

    Raises:
        TypeError: it is none, or is not finite.
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            raise TypeError(f"{value} is no finite number")
        return Fraction(value)
    if isinstance(value, Fraction | int):
        return value
    raise TypeError(f"a {type(value).__name__} is no number that can be taken as it is")


class Operations:
    """Operations that follow from others, and the refusal of those that have no meaning."""

    __slots__ = ()
    __array_ufunc__ = None
    low: Any
    high: Any

    def number(self, value: Exact) -> Self:
        """A number as an interval of this kind."""
        raise NotImplementedError

    def _truth(self, sure: Any, possible: Any) -> Self:
        """1 where it is sure, 0 where it is impossible, else both."""
        raise NotImplementedError

    def _as(self, other: Self | Exact) -> Self:
        return other if isinstance(other, type(self)) else self.number(other)  # type: ignore[arg-type]

    def __rsub__(self, other: Exact) -> Self:
        return self._as(other) - self  # type: ignore[operator]

    def __rtruediv__(self, other: Exact) -> Self:
        return self._as(other) / self  # type: ignore[operator]

    def less(self, other: Self | Exact) -> Self:
        """Whether self < other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        return self._truth(self.high < o.low, self.low < o.high)

    def less_equal(self, other: Self | Exact) -> Self:
        """Whether self <= other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        return self._truth(self.high <= o.low, self.low <= o.high)

    def equal(self, other: Self | Exact) -> Self:
        """Whether self = other: 0, 1 or, where that is open, both."""
        o = self._as(other)
        sure = (self.low == self.high) & (o.low == o.high) & (self.low == o.low)
        return self._truth(sure, (self.low <= o.high) & (o.low <= self.high))

    def _no_number(self, *_: object) -> NoReturn:
        """Refuse what would look at intervals as if they were one number.

        Raises:
            TypeError: always. An interval is neither equal to a number nor true nor false.
        """
        raise TypeError("an interval is no single number: compare and round it by its own methods")

    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _no_number
    __bool__ = __float__ = __int__ = __index__ = __complex__ = __round__ = _no_number
    __trunc__ = __floor__ = __ceil__ = __floordiv__ = __rfloordiv__ = _no_number
    __mod__ = __rmod__ = __divmod__ = __rdivmod__ = __pow__ = __rpow__ = __abs__ = _no_number
    __hash__ = _no_number


class ArrayOperations(Operations):
    """The same of arrays of intervals, one a box.

    Attributes:
        low, high: arrays of ends of one length.
    """

    __slots__ = ("high", "low")
    low: np.ndarray
    high: np.ndarray

    def __init__(self, low: Any, high: Any) -> None:
        self.low, self.high = low, high

    @classmethod
    def around(cls, low: Fraction, high: Fraction, many: int = 1) -> Self:
        """The same interval of rationals in so many boxes."""
        raise NotImplementedError

    @classmethod
    def _ordered(cls, low: Any, high: Any) -> Self:
        """Intervals of ends that are numbers, the lower one first."""
        return cls(low, high)

    def number(self, value: Exact) -> Self:
        """A number as boxes of this many."""
        number = Fraction(exact(value))
        return self.around(number, number, self.low.size)

    def take(self, rows: Any) -> Self:
        """Boxes of some rows."""
        return self._ordered(self.low[rows], self.high[rows])

    def __neg__(self) -> Self:
        return self._ordered(-self.high, -self.low)

    def absolute(self) -> Self:
        """Absolute value."""
        across = (self.low <= 0) & (self.high >= 0)
        low, high = abs(self.low), abs(self.high)
        return self._ordered(
            np.where(across, low.dtype.type(0), np.minimum(low, high)), np.maximum(low, high)
        )

    def minimum(self, other: Self | Exact) -> Self:
        """Smaller one of two."""
        o = self._as(other)
        return self._ordered(np.minimum(self.low, o.low), np.minimum(self.high, o.high))

    def maximum(self, other: Self | Exact) -> Self:
        """Larger one of two."""
        o = self._as(other)
        return self._ordered(np.maximum(self.low, o.low), np.maximum(self.high, o.high))

    def hull(self, other: Self | Exact) -> Self:
        """Smallest intervals around two."""
        o = self._as(other)
        return self._ordered(np.minimum(self.low, o.low), np.maximum(self.high, o.high))

    def meet(self, other: Self) -> Self:
        """What two enclosures of the same have in common."""
        return self._ordered(np.maximum(self.low, other.low), np.minimum(self.high, other.high))

    def choose(self, yes: Self, no: Self) -> Self:
        """``yes`` where self is not 0, ``no`` where it is 0, both where that is open."""
        sure = ((self.low > 0) | (self.high < 0)).astype(bool)
        open_ = ~(sure | ((self.low == 0) & (self.high == 0)).astype(bool))
        low, high = np.where(sure, yes.low, no.low), np.where(sure, yes.high, no.high)
        if open_.any():
            both = yes.hull(no)
            low, high = np.where(open_, both.low, low), np.where(open_, both.high, high)
        return self._ordered(low, high)

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
