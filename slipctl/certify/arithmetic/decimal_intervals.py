"""Decimal intervals that are rounded outwards.

Only the operations of the module ``decimal`` are trusted. Sums, products and quotients round as
told. Square root and logarithm are correctly rounded, and widened here by one unit in the last
place. The arctangent is a series with a bound of its remainder.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal, localcontext
from fractions import Fraction
from functools import cache
from typing import Any

from slipctl.certify.arithmetic.operations import Exact, Operations, exact


def precise(digits: int) -> AbstractContextManager[Context]:
    """Decimals of so many digits within a block of code."""
    return localcontext(Context(prec=digits))


@cache
def _contexts(digits: int) -> tuple[Context, Context]:
    """Rounding down and up."""
    return (Context(prec=digits, rounding=ROUND_FLOOR, Emin=-999999, Emax=999999),
            Context(prec=digits, rounding=ROUND_CEILING, Emin=-999999, Emax=999999))  # fmt: skip


class Interval(Operations):
    """Closed interval of decimals with outward rounding."""

    __slots__ = ("digits", "down", "high", "low", "up")

    def __init__(self, low: Decimal, high: Decimal, digits: int) -> None:
        self.low, self.high, self.digits = low, high, digits
        self.down, self.up = _contexts(digits)

    @classmethod
    def of(cls, value: Exact, digits: int) -> Interval:
        """Make the smallest interval around a rational."""
        value = exact(value)
        top, bottom = Decimal(value.numerator), Decimal(value.denominator)
        new = cls(top, top, digits)
        new.low, new.high = new.down.divide(top, bottom), new.up.divide(top, bottom)
        return new

    def _new(self, low: Decimal, high: Decimal) -> Interval:
        return Interval(low, high, self.digits)

    def number(self, value: Exact) -> Interval:
        """The smallest interval of these digits around a number."""
        return Interval.of(exact(value), self.digits)

    def __add__(self, other: Interval | Exact) -> Interval:
        o = self._as(other)
        return self._new(self.down.add(self.low, o.low), self.up.add(self.high, o.high))

    def __neg__(self) -> Interval:
        return self._new(self.low.copy_negate(), self.high.copy_negate())._ordered()

    def __sub__(self, other: Interval | Exact) -> Interval:
        return self + (-self._as(other))

    def __mul__(self, other: Interval | Exact) -> Interval:
        o = self._as(other)
        if self.low >= 0 and o.low >= 0:
            return self._new(self.down.multiply(self.low, o.low),
                             self.up.multiply(self.high, o.high))  # fmt: skip
        ends = [(x, y) for x in (self.low, self.high) for y in (o.low, o.high)]
        return self._new(
            min(self.down.multiply(x, y) for x, y in ends),
            max(self.up.multiply(x, y) for x, y in ends),
        )

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Interval | Exact) -> Interval:
        o = self._as(other)
        if o.low <= 0 <= o.high:
            raise ZeroDivisionError("division by an interval that contains zero")
        if self.low >= 0 and o.low > 0:
            return self._new(self.down.divide(self.low, o.high),
                             self.up.divide(self.high, o.low))  # fmt: skip
        ends = [(x, y) for x in (self.low, self.high) for y in (o.low, o.high)]
        return self._new(
            min(self.down.divide(x, y) for x, y in ends),
            max(self.up.divide(x, y) for x, y in ends),
        )

    def sqrt(self) -> Interval:
        """Square root of an interval of positive numbers."""
        low = self.down.sqrt(self.low)
        return self._new(
            max(Decimal(0), self.down.next_minus(low)), self.up.next_plus(self.up.sqrt(self.high))
        )

    def ln(self) -> Interval:
        """Natural logarithm of an interval of positive numbers."""
        return self._new(
            self.down.next_minus(self.down.ln(self.low)), self.up.next_plus(self.up.ln(self.high))
        )

    def exp(self) -> Interval:
        """Exponential; that of ``decimal`` is correctly rounded, widened by one unit here."""
        return self._new(
            max(Decimal(0), self.down.next_minus(self.down.exp(self.low))),
            self.up.next_plus(self.up.exp(self.high)),
        )

    def atan(self) -> Interval:
        """Arc tangent, which rises."""
        ends = [
            end * arctan_over(end.sq()) for end in (self._new(x, x) for x in (self.low, self.high))
        ]
        return self._new(ends[0].low, ends[1].high)

    def sq(self) -> Interval:
        """Square; never negative."""
        a = self.absolute()
        return a * a

    def absolute(self) -> Interval:
        """Absolute value."""
        ends = self.low.copy_abs(), self.high.copy_abs()
        low = Decimal(0) if self.low <= 0 <= self.high else min(ends)
        return self._new(low, max(ends))

    def minimum(self, other: Interval | Exact) -> Interval:
        """Smaller one of two."""
        o = self._as(other)
        return self._new(min(self.low, o.low), min(self.high, o.high))

    def maximum(self, other: Interval | Exact) -> Interval:
        """Larger one of two."""
        o = self._as(other)
        return self._new(max(self.low, o.low), max(self.high, o.high))

    def hull(self, other: Interval | Exact) -> Interval:
        """Smallest interval around two."""
        o = self._as(other)
        return self._new(min(self.low, o.low), max(self.high, o.high))

    def sgn(self) -> Interval:
        """Sign, 0 at zero."""
        return self._new(Decimal((self.low > 0) - (self.low < 0)),
                         Decimal((self.high > 0) - (self.high < 0)))  # fmt: skip

    def choose(self, yes: Interval, no: Interval) -> Interval:
        """``yes`` where self is not 0, ``no`` where it is 0, both where that is open."""
        if self.low > 0 or self.high < 0:
            return yes
        return no if self.low == self.high else yes.hull(no)

    def decided(self) -> bool:
        """Whether it is a single number, as a condition that is not open."""
        return self.low.compare(self.high) == 0

    def one_way(self) -> bool | None:
        """What a decided condition says, the same everywhere."""
        return not self.low.is_zero()

    def touches_zero(self) -> bool:
        """Whether it holds zero or what is below."""
        return self.low <= 0

    def _truth(self, sure: bool, possible: bool) -> Interval:
        return self._new(Decimal(int(sure)), Decimal(int(possible)))

    def magnitude(self) -> Decimal:
        """Largest absolute value."""
        return max(self.low.copy_abs(), self.high.copy_abs())

    def ends(self) -> tuple[Fraction, Fraction]:
        """Both ends as exact rationals."""
        return Fraction(self.low), Fraction(self.high)

    def texts(self) -> list[str]:
        """Both ends as decimals."""
        return [str(self.low), str(self.high)]

    def _ordered(self) -> Interval:
        self.low, self.high = self.high, self.low
        return self


def over_one(values: Sequence[Fraction]) -> tuple[int, list[int]]:
    """Give the common denominator of rationals and their numerators over it."""
    common = math.lcm(*(x.denominator for x in values))
    return common, [x.numerator * (common // x.denominator) for x in values]


def arctan_over(u: Interval) -> Interval:
    """Enclose atan(t)/t at u = t^2 >= 0, artanh(t)/t at u = -t^2 > -1.

    Proof note: halving the angle, A(u) = 2/(1 + s) A(u/(1 + s)^2) with s = sqrt(1 + u), until
    |u| < 0.01. Then the sum of (-u)^n/(2n + 1), whose rest after N terms is below 2 |u|^N.
    """
    factor = Interval.of(1, u.digits)
    while u.magnitude() >= Decimal("0.01"):
        s = (u + 1).sqrt() + 1
        factor = factor * 2 / s
        u = u / s / s
    total, power, n = Interval.of(0, u.digits), Interval.of(1, u.digits), 0
    small = Decimal(10) ** (-u.digits - 2)
    while power.magnitude() > small:
        total = total + power / (2 * n + 1)
        power = power * -u
        n += 1
    rest = u.up.multiply(Decimal(2), power.magnitude())
    return factor * (total + Interval(rest.copy_negate(), rest, u.digits))


def ln_of(x: Any) -> Any:
    """Logarithm: of a rational enclosed to 60 digits, of a float as a float."""
    return Interval.of(x, 60).ln() if isinstance(x, Fraction) else math.log(x)
