"""The funnel law as it is computed once per period, with all that disturbs it together.

    e+ = e + T (u + w),   u = -K1 eta d h(z_m) + e_m eta'/eta,   e_m = e + n
    h = (1 - z^2) atanh z
    eta = eta_inf + (eta_0 - eta_inf) exp(-k t),   z = (e/eta - (delta_u - delta_l)/2)/d

With d = (delta_l + delta_u)/2, c = (delta_u - delta_l)/(2 d), s = (eta - eta_inf)/eta,
r = eta/eta+ = 1/(1 - s (1 - exp(-k T))) and q = r (1 - k T s)

    z+ + c = q (y + c) - r K1 T h(y) - r n/(eta d) + T w/(eta+ d),   y = z + n/(eta d)

which is the map of ``scalar_maps``. In continuous time the shrinking of the
funnel cancels; in a tick it does not: the error is divided by a bound that has moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate import scalar_maps as maps
from slipctl.models.bounded_error.certificate.scalar_maps import AtanhPull, Interval, Tick

H_BOUND = Fraction(4478, 10000)
"""Above the largest value of h, 0.44774."""

TICKS = 4000
"""Longest shrinking that is followed tick by tick."""


@dataclass(frozen=True)
class Funnel:
    """Numbers of a funnel law, floats or decimals.

    Attributes:
        K1: gain in 1/s. T: period in s. eta_0, eta_inf: the funnel at the start and in the end.
        k: its decay in 1/s. lower, upper: widths over eta. W: largest |w| in 1/s, all inputs
        added. noise: largest |n|.
    """

    K1: Any
    T: Any
    eta_0: Any
    eta_inf: Any
    k: Any
    lower: Any
    upper: Any
    W: Any
    noise: Any

    @property
    def d(self) -> Any:
        """Mean width over eta."""
        return (self.lower + self.upper) / 2

    @property
    def shrink(self) -> Any:
        """Factor exp(-k T) of the falling part in a tick."""
        x = -self.k * self.T
        return x.exp() if isinstance(x, Decimal) else math.exp(x)

    def share(self, i: int) -> Any:
        """Part s = (eta - eta_inf)/eta of tick i that is still to fall."""
        part = (self.eta_0 - self.eta_inf) * self.shrink**i
        return part / (self.eta_inf + part)

    def eta(self, i: int) -> Any:
        """Funnel at tick i."""
        return self.eta_inf + (self.eta_0 - self.eta_inf) * self.shrink**i

    def standing(self, s: Any = 0) -> Tick:
        """Tick of the funnel at eta_inf; with s > 0, one that covers every part up to s as push.

        Proof note: |z+ - (y - K1 T h - n')| <= (1 - q)(1 + |c|) + (r - 1)(K1 T max h + n'), and
        1 - q = r s (k T - 1 + exp(-k T)). Both grow with s. T W/(eta+ d) and n/(eta d) are largest
        at eta_inf.
        """
        kappa, scale = self.K1 * self.T, self.eta_inf * self.d
        pull, noise = AtanhPull(kappa), self.noise / scale
        push = self.T * self.W / scale
        if s:
            fall = 1 - self.shrink
            r = 1 / (1 - s * fall)
            c = abs(self.upper - self.lower) / (2 * self.d)
            top = Decimal("0.4478") if isinstance(kappa, Decimal) else float(H_BOUND)
            push += r * s * (self.k * self.T - fall) * (1 + c) + (r - 1) * (kappa * top + noise)
        return Tick(pull, pull, push, noise)

    def ticks(self) -> Callable[[int], Tick]:
        """The law of tick 0, 1, ...; the same one object for a funnel that stands still."""
        standing = self.standing()
        if self.eta_0 == self.eta_inf or not self.k:
            return lambda i: standing
        E, falling = self.shrink, self.eta_0 - self.eta_inf
        c = (self.upper - self.lower) / (2 * self.d)

        def tick(i: int) -> Tick:
            part = falling * E**i
            eta, after = self.eta_inf + part, self.eta_inf + part * E
            r = eta / after
            q = r * (1 - self.k * self.T * part / eta)
            return Tick(standing.below, standing.above, self.T * self.W / (after * self.d),
                        self.noise / (eta * self.d), q, r, (q - 1) * c)  # fmt: skip

        return tick


def decimals(numbers: Mapping[str, Fraction]) -> Funnel:
    """Funnel of rationals as decimals of 50 digits."""
    return Funnel(**{k: maps.exactly(v) for k, v in numbers.items()})


@dataclass(frozen=True)
class Kept:
    """Sets that prove that an error stays in its funnel.

    Attributes:
        settled: interval around the middle that no disturbance leaves, at eta_inf.
        kept: interval that is never left from tick ``ticks`` on.
        ticks: how long the shrinking is followed tick by tick.
    """

    settled: Interval
    kept: Interval
    ticks: int


def follow(law: Funnel, start: Any, ticks: int, slop: Any = 0) -> Interval | None:
    """What is reached after some ticks from the shares |z| <= start; None if it may leave."""
    z, tick = Interval(-start, start), law.ticks()
    for i in range(ticks):
        found = maps.image(tick(i), z, slop)
        if found is None:
            return None
        z = Interval(found.low.quantize(QUANTUM), found.high.quantize(QUANTUM)) if slop else found
    return z


QUANTUM = Decimal("1e-36")


def find(law: Funnel, start: float, step: float = 0.0) -> Kept | None:
    """Sets for a start and a step of the reference, with floats; None if there are none.

    Args:
        law: floats. start: largest |z| at the start. step: of the reference.
    """
    share = step / (law.eta_inf * law.d)
    inner = maps.smallest(law.standing(), Interval(0.0, 0.0))
    if inner is None:
        return None
    moving = law.eta_0 != law.eta_inf and bool(law.k)
    z: Interval | None = Interval(-start, start)
    tick, done = law.ticks(), 0
    counts = [0]
    while moving and counts[-1] < TICKS:
        counts.append(max(4, 2 * counts[-1]))
    for count in counts:
        for i in range(done, count):
            z = maps.image(tick(i), z) if z is not None else None
            if z is None:
                return None
        done = count
        tail = law.standing(law.share(count) * (1 + 1e-12) if moving else 0.0)
        settled = maps.smallest(tail, Interval(0.0, 0.0))
        if settled is None or z is None:
            continue
        hull = Interval(min(z.low, settled.low - share), max(z.high, settled.high + share))
        kept = maps.smallest(tail, hull)
        if kept is not None:
            most = maps.limits(tail)
            for part in (0.3, 1e-2, 1e-4, 1e-6, 1e-9):
                a = maps.wider(settled, most, part * 1e-3)
                b = maps.wider(kept, most, part)
                if (b.low <= a.low - share and a.high + share <= b.high
                        and maps.keeps(tail, a) and maps.keeps(tail, b)):  # fmt: skip
                    return Kept(a, b, count)
    return None


def why_unproved(
    numbers: Mapping[str, Fraction], start: Fraction, step: Fraction, kept: Kept
) -> str | None:
    """None if the sets prove that every error stays; else what fails, in words.

    Args:
        numbers: of the Funnel. start: largest |z| at the start. step: of the reference.
        kept: sets, as decimals.
    """
    with precise(maps.DIGITS):
        law = decimals(numbers)
        tail = law.standing(law.share(kept.ticks) * (1 + maps.SLOP) if law.k else Decimal(0))
        for name, z in (("settled", kept.settled), ("kept", kept.kept)):
            if not maps.proves_kept(tail, z):
                return f"the errors '{name}' are left in a tick"
        if not kept.settled.low <= 0 <= kept.settled.high:
            return "the errors 'settled' do not hold the middle"
        share = maps.exactly(step) / (law.eta_inf * law.d) + maps.SLOP
        if not Interval(kept.settled.low - share, kept.settled.high + share).inside(kept.kept):
            return "a step of the reference leads out of the errors 'kept'"
        reached = follow(law, maps.exactly(start), kept.ticks, maps.SLOP)
        if reached is None:
            return "an error may leave while the funnel shrinks"
        if not reached.inside(kept.kept):
            return f"the errors after {kept.ticks} ticks are not among 'kept'"
    return None
