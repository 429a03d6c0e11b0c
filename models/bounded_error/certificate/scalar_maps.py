"""One error under a law that is computed once per period: what it can reach, and what it keeps.

    z+ = q y + shift - r pull(y) - r n + p,   y = z + n,   |n| <= noise,   |p| <= push

z is the error, y the error as measured. ``pull`` has the sign of y and is concave in |y| on either
side. It rises up to a peak and falls to zero at the bound: the funnel and the barrier of the
printed laws both are of this kind. Where the bounds stand still q = r = 1 and shift = 0.

Every function works on floats, to look for a set, and on ``Decimal`` with a ``slop``, to prove it.
What is reached is then widened by the slop, which is far above the rounding of 50 digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from decimal import Context, Decimal, getcontext
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.certify.arithmetic.decimal_intervals import precise

DIGITS = 50
"""Digits of a proof; a tick takes some tens of operations on numbers below LARGEST."""

SLOP = Decimal("1e-30")
"""Widening of a tick, 1e8 times the largest rounding error of its operations."""

LARGEST = 10**12
"""Largest magnitude in a proof."""


class Interval(NamedTuple):
    """From low to high, floats or decimals."""

    low: Any
    high: Any

    def inside(self, other: Interval) -> bool:
        """Whether it lies in another one."""
        return bool(other.low <= self.low and self.high <= other.high)


class Pull(Protocol):
    """How one side pulls back at a distance from zero, per tick; concave, zero at both ends."""

    @property
    def width(self) -> Any:
        """Distance of the bound."""
        ...

    @property
    def peak(self) -> float:
        """Distance at which it is largest."""
        ...

    def at(self, y: Any) -> Any:
        """Pull at a distance 0 <= y < width."""
        ...

    def slope(self, y: Any) -> Any:
        """Its slope."""
        ...

    def where(self, slope: float) -> float:
        """Distance at which its slope has come down to this one, below that at zero; a float."""
        ...

    def roots(self, push: float) -> tuple[float, float]:
        """Least and largest distance at which it is a push below its largest value; floats."""
        ...


@dataclass(frozen=True)
class AtanhPull:
    """Pull of the funnel law, kappa (1 - y^2) atanh y, as a share of the half-width."""

    kappa: Any
    width: Any = 1
    peak: float = 0.6479182290296026

    def at(self, y: Any) -> Any:
        """Pull at the share y."""
        return self.kappa * (1 - y * y) * _atanh(y)

    def slope(self, y: Any) -> Any:
        """Slope kappa (1 - 2 y atanh y), which falls."""
        return self.kappa * (1 - 2 * y * _atanh(y))

    def where(self, slope: float) -> float:
        """Root of 2 y atanh y = 1 - slope/kappa."""
        level = (1 - slope / float(self.kappa)) / 2
        return bisect(lambda y: y * math.atanh(y), level, 0.0, 1 - 1e-16)

    def roots(self, push: float) -> tuple[float, float]:
        """Of (1 - y^2) atanh y = push/kappa."""
        return _funnel_roots(push / float(self.kappa))


@dataclass(frozen=True)
class CubicPull:
    """Pull of the printed barrier law, gain y (width^2 - y^2)."""

    gain: Any
    width: Any

    @property
    def peak(self) -> float:
        """Distance width/sqrt 3."""
        return float(self.width) / math.sqrt(3)

    def at(self, y: Any) -> Any:
        """Pull at the distance y."""
        return self.gain * y * (self.width * self.width - y * y)

    def slope(self, y: Any) -> Any:
        """Slope gain (width^2 - 3 y^2), which falls."""
        return self.gain * (self.width * self.width - 3 * y * y)

    def where(self, slope: float) -> float:
        """Root of gain (width^2 - 3 y^2) = slope."""
        return math.sqrt(max(float(self.width) ** 2 - slope / float(self.gain), 0.0) / 3)

    def roots(self, push: float) -> tuple[float, float]:
        """Of the cubic, by its trigonometric solution."""
        top = math.acos(max(-1.0, -push / float(self.at(self.peak))))
        low, high = math.cos((top + 4 * math.pi) / 3), math.cos(top / 3)
        return 2 * self.peak * low, 2 * self.peak * high


@lru_cache(256)
def _funnel_roots(load: float) -> tuple[float, float]:
    def h(y: float) -> float:
        return (1 - y * y) * math.atanh(y)

    peak = AtanhPull.peak
    return bisect(h, load, 0.0, peak), bisect(h, load, 1 - 1e-16, peak)


def _atanh(y: Any) -> Any:
    return _decimal_atanh(y, getcontext().prec) if isinstance(y, Decimal) else math.atanh(y)


@lru_cache(4096)
def _decimal_atanh(y: Decimal, digits: int) -> Decimal:
    """Of a pull and of its slope at the same place; ``digits`` are those of the context."""
    return ((1 + y) / (1 - y)).ln() / 2


@dataclass(frozen=True)
class Tick:
    """One tick of the law: see the module's text.

    Attributes:
        below, above: pull at negative and at positive measured errors.
        push: largest |p|. noise: largest |n|. q, r, shift: motion of the bounds.
    """

    below: Pull
    above: Pull
    push: Any
    noise: Any = 0
    q: Any = 1
    r: Any = 1
    shift: Any = 0

    def mirrored(self) -> Tick:
        """Same law for -z."""
        return replace(self, below=self.above, above=self.below, shift=-self.shift)

    def after(self, y: Any) -> Any:
        """Next error at the measured error y, without noise and push: G(y)."""
        pull = self.above.at(y) if y >= 0 else -self.below.at(-y)
        return self.q * y + self.shift - self.r * pull

    def measurable(self, z: Interval) -> bool:
        """Whether every measured error lies strictly between the bounds."""
        low, high = z.low - self.noise, z.high + self.noise
        return bool(-self.below.width < low and high < self.above.width)


# ---- what one tick reaches ----------------------------------------------------------------------


def image(tick: Tick, z: Interval, slop: Any = 0) -> Interval | None:
    """All errors after a tick from any error in z; None if a measured error is out of bounds.

    Proof note: with y = z + n the next error is G(y) - r n + p. At a given y the least n is best
    for its top: n = -noise for y up to high - noise, n = y - high beyond. G is convex for y >= 0,
    as the pull is concave there, so it is largest at an end. Below zero it is concave and lies
    under each of its tangents. On the rest, y in [high - noise, high + noise], the top is
    q y - r y less the pull, convex again. The bottom is the top of the mirrored law.
    """
    if not tick.measurable(z):
        return None
    top = _highest(tick, z)
    bottom = -_highest(tick.mirrored(), Interval(-z.high, -z.low))
    return Interval(bottom - tick.push - slop, top + tick.push + slop)


def _highest(tick: Tick, z: Interval) -> Any:
    first = _peak(tick, z.low - tick.noise, z.high - tick.noise) + tick.r * tick.noise
    if not tick.noise:
        return first
    if z.high < tick.noise:  # a bound, not the value: the noise is counted twice
        return max(first, _peak(tick, z.low - tick.noise, z.high + tick.noise)
                   + tick.r * tick.noise)  # fmt: skip
    return max(first, tick.after(z.high + tick.noise) - tick.r * tick.noise)


def _peak(tick: Tick, low: Any, high: Any) -> Any:
    """Upper bound of G over [low, high]; with floats its value."""
    found = max(tick.after(low), tick.after(high))
    if low >= 0:
        return found
    end = min(high, 0)
    if end == 0:
        found = max(found, tick.shift)
    y = turn(tick, low, end)
    slope = tick.q - tick.r * tick.below.slope(-y)
    over = max(slope * (low - y), slope * (end - y), 0) if isinstance(slope, Decimal) else 0
    return max(found, tick.after(y) + over)


def turn(tick: Tick, low: Any, high: Any) -> Any:
    """Where G is largest on [low, high], at most 0: about where its slope vanishes."""
    ratio = float(tick.q) / float(tick.r)
    far, near = -float(low), -float(high)

    pull = _floats(tick.below) if isinstance(low, Decimal) else tick.below
    y = min(max(pull.where(ratio), near), far) if pull.slope(0.0) > ratio else near
    found = Decimal(-y) if isinstance(low, Decimal) else -y
    return min(max(found, low), high)


def _floats(pull: Any) -> Pull:
    """Same pull in floats."""
    found: Pull = replace(pull, **{f.name: float(getattr(pull, f.name)) for f in fields(pull)})
    return found


def keeps(tick: Tick, z: Interval, slop: Any = 0) -> bool:
    """Whether no error in z leaves it in a tick."""
    found = image(tick, z, slop)
    return found is not None and found.inside(z)


# ---- a law that stands still --------------------------------------------------------------------


def roots(pull: Pull, push: float) -> tuple[float, float]:
    """Least and largest distance at which a side pulls as much as the push; inf, 0 if none."""
    if push > pull.at(pull.peak):
        return math.inf, 0.0
    return pull.roots(push) if push > 0 else (0.0, float(pull.width))


def limits(tick: Tick) -> tuple[float, float]:
    """Largest distances, below and above, from which the worst push and noise are still opposed.

    Beyond them the push takes the error out, tick by tick; negative if there are none.
    """
    out = []
    for side in (tick.below, tick.above):
        low, high = roots(side, tick.push)
        far = min(high, float(side.width) * (1 - 1e-15)) - tick.noise
        out.append(far if low + tick.noise <= far else -1.0)
    return out[0], out[1]


def smallest(tick: Tick, start: Interval) -> Interval | None:
    """Smallest interval that holds a start and that no error leaves; None if there is none.

    Proof note: let q = r = 1. An interval [-a, b] is kept if and only if two conditions hold on
    either side. The pull at b - noise and at b + noise is at least the push, which puts b between
    the roots of the pull shifted inwards. No overshoot from the other side passes b; it grows with
    a. So from the start and the lower roots both ends are moved out as far as they must be, until
    they stay or pass the upper roots. Then the worst disturbance leads out.
    """
    most = limits(tick)
    least = [roots(side, tick.push)[0] + tick.noise for side in (tick.below, tick.above)]
    a, b = max(-start.low, least[0]), max(start.high, least[1])
    mirror = tick.mirrored()
    for _ in range(1000):
        if a > most[0] or b > most[1]:
            return None
        up = max(b, _peak(tick, -a - tick.noise, 0.0) + tick.noise + tick.push)
        down = max(a, _peak(mirror, -b - tick.noise, 0.0) + tick.noise + tick.push)
        if up <= b * (1 + 1e-13) and down <= a * (1 + 1e-13):
            return Interval(-a, b)
        a, b = down, up
    return None


# ---- proofs -------------------------------------------------------------------------------------


def exactly(value: Fraction | float | int) -> Decimal:
    """Decimal of DIGITS digits."""
    exact = Fraction(value)
    context = Context(prec=DIGITS)
    return context.divide(Decimal(exact.numerator), Decimal(exact.denominator))


def proves_kept(tick: Tick, z: Interval) -> bool:
    """Whether ``keeps`` holds with decimals; the tick and the interval must be made of them."""
    with precise(DIGITS):
        numbers = (*z, tick.push, tick.noise, tick.q, tick.r, tick.shift)
        if any(abs(x) > LARGEST for x in numbers):
            return False
        return keeps(tick, z, SLOP)


def wider(inner: Interval, most: Sequence[float], share: float) -> Interval:
    """Interval between an inner one and the largest distances below and above."""
    return Interval(inner.low - share * (most[0] + inner.low),
                    inner.high + share * (most[1] - inner.high))  # fmt: skip
