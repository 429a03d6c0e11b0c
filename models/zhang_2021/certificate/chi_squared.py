"""Enclosures of the chi-squared distribution, by its series and by Chernoff's bound."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache

from slipctl.certify.arithmetic.decimal_intervals import Interval, arctan_over

DIGITS = 40
MOST_TERMS = 20_000


def pi(digits: int = DIGITS) -> Interval:
    """Enclose pi, 4 atan 1."""
    return arctan_over(Interval.of(1, digits)) * 4


def log_gamma_after(s: Fraction, digits: int = DIGITS) -> Interval:
    """Enclose ln Gamma(s + 1) for a multiple s of 1/2.

    Proof note: m! for a whole s = m, (2 m)!/(4^m m!) sqrt(pi) for s + 1 = m + 1/2.
    """
    if s.denominator == 1:
        return Interval.of(math.factorial(int(s)), digits).ln()
    m = int(s + Fraction(1, 2))
    ratio = Fraction(math.factorial(2 * m), 4**m * math.factorial(m))
    return Interval.of(ratio, digits).ln() + pi(digits).ln() / 2


@lru_cache(maxsize=8)
def probability_below(value: Fraction, freedom: int) -> Interval:
    """Enclose the probability that chi-squared with so many degrees of freedom is below a value.

    Proof note: with s = freedom/2, x = value/2 it is x^s e^-x/Gamma(s + 1) times the sum of
    x^k/((s + 1) ... (s + k)); from k with x < s + k on, the rest is below the last term over
    1 - x/(s + k + 1). Far out, the tail is below e^(s - x) (x/s)^s, on either side (Chernoff).
    """
    s, x = Fraction(freedom, 2), Fraction(value) / 2
    spread = 12 * math.isqrt(freedom) + 60
    if x <= 0:
        return Interval.of(0, DIGITS)
    if abs(x - s) > spread or freedom > 20_000:
        log_tail = Interval.of(s - x, DIGITS) + Interval.of(x / s, DIGITS).ln() * s
        tail = min(log_tail.exp().high, Decimal(1)) if log_tail.high < 0 else Decimal(1)
        low, high = (Decimal(0), tail) if x < s else (Decimal(1) - tail, Decimal(1))
        return Interval(max(low, Decimal(0)), high, DIGITS)
    power = Interval.of(x, DIGITS)
    total = term = Interval.of(1, DIGITS)
    for k in range(1, MOST_TERMS):
        term = term * power / (s + k)
        total = total + term
        if s + k > x and term.high < Decimal(10) ** -DIGITS:
            rest = term / (1 - power / (s + k + 1))
            total = Interval(total.low, total.up.add(total.high, rest.high), DIGITS)
            break
    front = (power.ln() * s - x - log_gamma_after(s)).exp()
    return front * total
