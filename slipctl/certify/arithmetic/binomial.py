"""What independent draws prove of a share: the exact binomial tail, in integers.

Proof note: let p be the chance of a violation, k the violations in N independent draws. Whatever p
is, the chance that F(k; N, p) = P(Bin(N, p) <= k) comes out at beta or less is at most beta
(Clopper and Pearson, Biometrika 26 (1934) 404-413). F falls with p. So "p is at most P", for the
least P with F(k; N, P) <= beta, is wrong with a chance of beta at most. For a bound that is the
largest of the N values themselves, k = 0: P(the next one is above it) > P has the chance
(1 - P)^N at most.
"""

from __future__ import annotations

from fractions import Fraction

from slipctl.errors import BadInput

MOST = 20_000
"""Most draws of a statement."""

GRAIN = 10**6
"""Shares are told in multiples of 1/GRAIN, rounded up."""


def holds(draws: int, violations: int, share: Fraction, beta: Fraction) -> bool:
    """Whether P(Bin(draws, share) <= violations) <= beta, in integers.

    With share = a/b: sum of C(N, i) a^i (b - a)^(N - i) over i <= k, times the denominator of
    beta, is at most its numerator times b^N.

    Raises:
        BadInput: numbers that mean nothing.
    """
    if not 0 < draws <= MOST or not 0 <= violations <= draws:
        raise BadInput(f"{violations} of {draws} draws is no count; at most {MOST} draws")
    if not 0 <= share <= 1 or not 0 < beta < 1:
        raise BadInput("a share lies in 0 .. 1, the chance of an error between 0 and 1")
    if violations == draws:
        return False  # the tail is 1
    a, b = share.numerator, share.denominator
    good = b - a
    if good == 0:
        return True  # the tail is 0
    # powers of (b - a) are taken out: sum of C(N, i) a^i (b - a)^(k - i), times (b - a)^(N - k)
    term, total, powers = 1, 0, [good**j for j in range(violations + 1)]
    for i in range(violations + 1):
        total += term * powers[violations - i]
        term = term * a * (draws - i) // (i + 1) if i < violations else term
    left = total * good ** (draws - violations) * beta.denominator
    return bool(left <= beta.numerator * b**draws)


def largest_share(draws: int, violations: int, beta: Fraction) -> Fraction:
    """Least share of violations, in steps of 1/GRAIN, that the draws prove not to be exceeded."""
    low, high = 0, GRAIN  # low is not proved, high is
    if violations == draws:
        return Fraction(1)
    while high - low > 1:
        middle = (low + high) // 2
        if holds(draws, violations, Fraction(middle, GRAIN), beta):
            high = middle
        else:
            low = middle
    return Fraction(high, GRAIN)


def draws_needed(share: Fraction, beta: Fraction) -> int:
    """Least number of draws that prove a share if none is violated.

    Raises:
        BadInput: more than :data:`MOST`.
    """
    low, high = 0, MOST
    if not holds(high, 0, share, beta):
        raise BadInput(f"more than {MOST} draws are needed")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle, 0, share, beta) else (middle, high)
    return high
