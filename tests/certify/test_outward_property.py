"""Arithmetic that rounds outwards encloses the exact result, and no more than its last digits."""

from __future__ import annotations

import operator
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.arithmetic.enclosure import _constpow
from slipctl.models.cheng_2022.certificate.ball import Ball

OPERATIONS = [operator.add, operator.sub, operator.mul, operator.truediv]
ENDS = [(a, b) for a, b in product(map(Fraction, ("-7/3", "-1/9", "0", "2/7", "5/3")), repeat=2)
        if a <= b]  # fmt: skip
DIGITS = 20
EPS, TINY = Fraction(1, 2**52), Fraction(1, 10**290)


def interval(low: Fraction, high: Fraction) -> Interval:
    return Interval(Interval.of(low, DIGITS).low, Interval.of(high, DIGITS).high, DIGITS)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_interval_is_that_of_its_corners(operation) -> None:
    """All signs of both; of a sum, a product and a quotient the extremes lie at corners."""
    for a, b in product(ENDS, ENDS):
        if operation is operator.truediv and b[0] <= 0 <= b[1]:
            with pytest.raises(ZeroDivisionError):
                operation(interval(*a), interval(*b))
            continue
        corners = [operation(x, y) for x, y in product(a, b)]
        low, high = operation(interval(*a), interval(*b)).ends()
        assert low <= min(corners)
        assert max(corners) <= high
        slack = max(1, *map(abs, corners)) / 10 ** (DIGITS - 2)
        assert min(corners) - low <= slack
        assert high - max(corners) <= slack


@pytest.mark.parametrize("operation", OPERATIONS)
def test_a_ball_holds_its_corners(operation) -> None:
    """Against exact rationals; its radius is that of the formula and a few roundings."""
    rng = np.random.default_rng(1)
    name = {operator.truediv: "over"}.get(operation)
    for _ in range(200):
        mids, rads = rng.uniform(-3, 3, 2), rng.choice([0.0, 1e-9, 1e-3, 0.05], 2)
        if name and abs(mids[1]) <= rads[1]:
            continue
        a, b = (Ball(np.array(m), np.array(r)) for m, r in zip(mids, rads, strict=True))
        found = a.over(b) if name else operation(a, b)
        ends = [[Fraction(float(m)) + s * Fraction(float(r)) for s in (-1, 1)]
                for m, r in zip(mids, rads, strict=True)]  # fmt: skip
        corners = [operation(x, y) for x, y in product(*ends)]
        low, high = Fraction(float(found.low())), Fraction(float(found.high()))
        assert low <= min(corners)
        assert max(corners) <= high
        (m, n), (r, t) = (map(Fraction, map(float, pair)) for pair in (mids, rads))
        radius = {
            operator.mul: abs(m) * t + abs(n) * r + r * t,
            operator.truediv: (r + abs(m / n) * t) / (abs(n) - t),
        }.get(operation, r + t)
        assert high - low <= 2 * radius * (1 + 100 * EPS) + 6 * EPS * max(map(abs, corners)) + TINY


@pytest.mark.parametrize("power", [-3, -2, -1, 0.5, 2, 3, 4, 2.5])
def test_a_power_of_an_interval_encloses_its_values(power) -> None:
    """Below zero, about zero and above, where it is defined: the extremes of its values."""
    for low, high in ((-2.0, -0.5), (-1.0, 2.0), (0.5, 3.0), (0.0, 1.5)):
        if (low <= 0 and power < 0) or (low < 0 and power != int(power)):
            continue
        n = np.array([float(power)])
        a, b = _constpow((np.array([low]), np.array([high])), (n, n))
        values = np.linspace(low, high, 301) ** float(power)
        assert [a[0], b[0]] == pytest.approx([values.min(), values.max()], rel=1e-14)
