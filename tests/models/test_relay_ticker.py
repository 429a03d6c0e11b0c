"""A polygon of the reaching law behind a lag, one tick on: what can be there, and hardly more."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from slipctl.models.huang_2020.certificate import relay_orbits
from slipctl.models.huang_2020.certificate.relay_sets import (
    BITS,
    SHIFT,
    Absorbing,
    Relay,
    Ticker,
    _around,
    _short,
    _sum,
    hull,
    upper_half,
)

F = Fraction
LAW = Relay(F(36), F(12), F(1, 1000), F(42, 10000), F(5))
CORNERS = tuple((F(s, 1000), F(a, 10)) for s, a in (
    (40, -50), (50, 10), (30, 60), (-10, 70), (-40, 50), (-50, -10), (-30, -60), (10, -70)
))  # fmt: skip
"""A convex polygon and its own mirror image; whether runs stay in it does not matter here."""


def images(points: np.ndarray, sign: float, D: float) -> np.ndarray:
    """Points (s, a) a tick later with d at both of its ends; u = -g1 s - g2 sign is held."""
    s, a = points.T
    T, lag = float(LAW.T), float(LAW.lag)
    left = np.exp(-T / lag)
    u = -36.0 * s - 12.0 * sign
    s, a = s + u * T + (a - u) * lag * (1 - left), u + (a - u) * left
    return np.concatenate([np.stack([s + side * T * D, a], 1) for side in (-1, 1)])


def folded(points: np.ndarray) -> np.ndarray:
    """Part of the hull of points with s >= 0, and the mirror image of the rest."""
    s = points[:, 0]
    right, left = points[s >= 0], points[s <= 0]
    cuts = []
    for p in right:
        for q in left:
            if p[0] > q[0]:
                cuts.append([0.0, p[1] + (q[1] - p[1]) * p[0] / (p[0] - q[0])])
    cut = np.array(cuts).reshape(-1, 2)
    return np.concatenate([right, -left, cut, -cut])


@pytest.mark.parametrize(("D", "wide", "high"), [
    (5, F(1), F(1)), (0, F(1, 1000), F(1, 3)), (0, F(1, 100), F(1, 20)), (1, F(1, 1000), F(1, 20)),
])  # fmt: skip
def test_a_tick_moves_the_polygon_to_all_that_follows_and_hardly_further(D, wide, high) -> None:
    """In each of many directions as far as the equations go, to a few units of the lattice."""
    law = replace(LAW, D=F(D))
    ticker = Ticker(Absorbing(law, tuple((s * wide, a * high) for s, a in CORNERS)))
    unit = np.array([float(u) for u in ticker.unit])
    assert ticker.unit == (F(50, 1000) * wide / 2**BITS, F(7) * high / 2**BITS)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ways = np.stack([np.cos(angle), np.sin(angle)])
    for _ in range(1 if wide < 1 else 3):
        before = np.array(ticker.points, float) * unit
        at_zero = before[before[:, 0] == 0]
        assert len(at_zero) == 2
        ticker.tick()
        still = images(at_zero, 0.0, D)
        wall = np.stack([np.zeros(len(still)), still[:, 1]], 1)
        exact = np.concatenate([folded(images(before, 1.0, D)), still[still[:, 0] >= 0],
                                -still[still[:, 0] <= 0], wall, -wall]) / unit  # fmt: skip
        found = np.array(ticker.points, float)
        assert (found[:, 0] >= 0).all()
        beyond = (found @ ways).max(0) - (exact @ ways).max(0)
        assert beyond.min() > -1e-4
        assert beyond.max() < 4
        assert float(ticker.largest()) == pytest.approx(found[:, 0].max() * unit[0])


def test_the_half_of_a_polygon_ends_where_its_sides_cross_the_axis() -> None:
    half = upper_half(CORNERS)
    assert half == [*CORNERS[:3], (F(0), F(6) + F(1) * F(30, 40)), (F(0), F(-27, 4)), CORNERS[7]]
    box = [(F(1), F(-1)), (F(1), F(1)), (F(0), F(2)), (F(-1), F(1)), (F(-1), F(-1)), (F(0), F(-2))]
    assert upper_half(box) == [box[0], box[1], box[2], box[5]]


def test_a_hull_has_its_corners_in_turn_and_no_point_on_a_side() -> None:
    points = [
        (0, 0),
        (4, 1),
        (2, 2),
        (6, 5),
        (1, 4),
        (3, 3),
        (5, 3),
        (8, 2),
        (4, 1),
        (2, 0),
        (4, 0),
    ]
    assert hull(points) == [(0, 0), (4, 0), (8, 2), (6, 5), (1, 4)]
    assert hull([(3, 1), (1, 2), (3, 1)]) == [(1, 2), (3, 1)]
    assert _around(F(3, 2), F(-5, 2)) == [(1, -3), (1, -2), (2, -3), (2, -2)]
    assert set(_around(F(2), F(-1, 3))) == {(2, -1), (2, 0)}


def test_a_row_is_enclosed_whatever_the_signs_are() -> None:
    """Ends of coefficients over 2^SHIFT, rounded to whole numbers outwards."""
    one = 1 << SHIFT
    row: Any = ((2 * one, 3 * one), (-5 * one, -4 * one), (one // 2, one))
    assert _sum(row, (10, 1), 1) == (20 - 5 - 1, 30 - 4)
    assert _sum(row, (-10, 1), 1) == (-30 - 5 - 1, -20 - 4)
    assert _sum(row, (10, -1), -1) == (20 + 4, 30 + 5 + 1)
    assert _sum(row, (0, 0), 1) == (-1, 0)
    assert _sum(row, (7, 0), 0) == (14, 21)


def test_numbers_of_a_search_are_short_and_near() -> None:
    assert _short(0.3, 1.0) == F(round(0.3 * 2**29), 2**29)
    assert _short(-5.0, 8.0) == -5
    assert abs(_short(np.pi, 1e3) - F(float(np.pi))) <= F(1, 2**21)


def test_a_period_is_one_of_both_states_each_to_its_own_size() -> None:
    """A run that is back in s, small as it is, and not in a, is not back."""
    turns = np.arange(41) * np.pi / 4
    s, a = np.sin(turns), 1e3 * np.cos(turns)
    assert relay_orbits._period(s, a, 20) == 8
    assert relay_orbits._period(a, s, 20) == 8
    apart = a.copy()
    apart[::16] += 5e-5
    assert relay_orbits._period(s, apart, 20) == 8  # within 1e-7 of its size
    apart[::16] += 5e-4
    assert relay_orbits._period(s, apart, 40) == 16
    less = s.copy()
    less[::16] += 5e-6
    assert relay_orbits._period(less, a, 40) == 16
    assert relay_orbits._period(s, a, 8) == 0  # one tick more than is looked for
    assert relay_orbits._period(s, a, 9) == 8
