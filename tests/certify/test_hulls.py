"""Hulls, steps of a run and other small pieces of searches: against what defines them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.models.huang_2020.certificate.relay_sets import hull
from slipctl.models.super_twisting.certificate.worst_run import _rk4

POINTS = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=14)


def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@given(POINTS)
def test_a_hull_turns_left_at_each_corner_and_has_every_point_inside(points) -> None:
    found = hull(points)
    assert set(found) <= set(points)
    assert len(set(found)) == len(found)
    if len(found) < 3:
        low_high = sorted(set(points))
        flat = all(turn(low_high[0], low_high[-1], p) == 0 for p in points) if points else True
        assert flat
        assert set(found) >= {*low_high[:1], *low_high[-1:]}
        return
    corners = list(zip(found, found[1:] + found[:1], found[2:] + found[:2], strict=True))
    assert all(turn(a, b, c) > 0 for a, b, c in corners)
    for a, b, _ in corners:
        assert all(turn(a, b, p) >= 0 for p in points)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.5, 3))
def test_a_step_of_a_run_is_of_the_fourth_order(y, z, w) -> None:
    """On a rotation, whose solution is known, in each of its three numbers."""

    def f(y, z, d):
        return w * z, -w * y, d + y

    def error(h):
        got = _rk4(f, (y, z, 0.5), 0.3, h)
        c, s = math.cos(w * h), math.sin(w * h)
        true = (y * c + z * s, z * c - y * s, 0.5 + 0.3 * h + (y * s + z * (1 - c)) / w)
        return max(abs(a - b) for a, b in zip(got, true, strict=True))

    assert error(0.1) < 1e-3 * w**5 * (abs(y) + abs(z) + 1) / 10
    if error(0.2) > 1e-9:
        assert error(0.2) / max(error(0.1), 1e-16) > 16


def test_steps_of_a_run_are_exact_where_nothing_bends() -> None:
    got = _rk4(lambda y, z, d: (d, 2 * d, 1.0), (1.0, 2.0, 3.0), 0.5, 0.25)
    assert got == pytest.approx((1.125, 2.25, 3.25), rel=1e-15)
