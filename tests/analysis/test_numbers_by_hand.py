"""Searches and bounds of the analyses, step by step in plain numbers."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, argmax_block, law
from slipctl.analysis.bounds import enclosure, fastest, largest_slope
from slipctl.analysis.optimum import _bracket, _climb
from slipctl.analysis.quadratic import qp_kernel
from slipctl.analysis.rail_peaks import Peaks
from slipctl.analysis.roots import bracketed_newton

# ---- roots and peaks -----------------------------------------------------------------------------


def residual():
    """x^3 - 2 x - q0 + q1 sin 4x; it rises through its root, and falls on the way."""
    x, q = ca.SX.sym("x"), ca.SX.sym("q", 2)
    value = x**3 - 2 * x - q[0] + q[1] * ca.sin(4 * x)
    return ca.Function("residual", [x, q], [value, ca.jacobian(value, x)])


def newton_by_hand(updates, x, lo, hi, q):
    """Newton's steps where they stay inside and are at most half of the one before."""
    before, small = hi - lo, 1e-9 * (hi - lo)
    for _ in range(updates):
        value = x**3 - 2 * x - q[0] + q[1] * math.sin(4 * x)
        slope = 3 * x**2 - 2 + 4 * q[1] * math.cos(4 * x)
        lo, hi = (x, hi) if value < 0 else (lo, x) if value > 0 else (lo, hi)
        newton = x - value / slope
        halved = 2 * abs(value) <= max(before, small) * slope
        following = newton if lo <= newton <= hi and halved else (lo + hi) / 2
        x, before = following, abs(following - x)
    return x


@pytest.mark.parametrize("start", [-2.9, 0.3, 0.9, 3.7])
def test_newtons_steps_in_a_bracket(start):
    q, counts = [1.0, 0.4], (1, 2, 3, 5, 8, 14)
    for f, n in zip(bracketed_newton(residual(), *counts), counts, strict=True):
        root = float(f(start, -3.0, 4.0, q))
        assert root == pytest.approx(newton_by_hand(n, start, -3.0, 4.0, q), rel=1e-10)
        assert f.name() == f"newton_{n}"
        assert f.name_in() == ["x", "lo", "hi", "q"]
    assert abs(float(residual()(root, q)[0])) < 1e-12


@law(y=Output("1", "height"))
def hump(
    x=Input("m", "place"), w=Input("1", "further input", value=0.2),
    top=Param("m", 1.3, "where it stands", lo=-5, hi=5), steep=Param("1/m", 0.7, "side"),
):  # fmt: skip
    """A hump with another one on its side."""
    z = x - top
    return ca.exp(-(z**2)) + w * ca.exp(-3 * (z + 1.8) ** 2) - 0.1 * steep * z


def height(x, top, steep, w):
    z = x - top
    y = math.exp(-z * z) + w * math.exp(-3 * (z + 1.8) ** 2) - 0.1 * steep * z
    far = math.exp(-3 * (z + 1.8) ** 2) * w
    d = -2 * z * math.exp(-z * z) - 6 * (z + 1.8) * far - 0.1 * steep
    d2 = (4 * z * z - 2) * math.exp(-z * z) + (36 * (z + 1.8) ** 2 - 6) * far
    return y, d, d2


@pytest.mark.parametrize("newton", [0, 1, 2, 4])
@pytest.mark.parametrize(("points", "w"), [(4, 0.2), (7, 0.2), (9, 1.4), (5, 1.1)])
def test_the_peak_of_a_block_is_that_of_its_grid_and_steps(points, newton, w):
    block = argmax_block(hump, "x", lo=-1.5, hi=4.0, points=points, newton=newton)
    told = {n: (s.value, s.lo, s.hi) for n, s in block.params.items()}
    assert told == {"lo": (-1.5, -1e12, 1e12), "hi": (4.0, -1e12, 1e12)}
    numbers = (1.1, 0.6, w)
    found = block(top=1.1, steep=0.6, w=w)
    step = 5.5 / (points - 1)
    grid = [-1.5 + k * step for k in range(points)]
    place = max(grid, key=lambda x: height(x, *numbers)[0])
    a, b = max(place - step, -1.5), min(place + step, 4.0)
    for _ in range(newton):
        _, d, d2 = height(place, *numbers)
        a, b = (place, b) if d > 0 else (a, place)
        following = place - d / min(d2, -1e-30)
        place = following if a <= following <= b and d2 < 0 else (a + b) / 2
    assert found["best"] == pytest.approx(place, rel=1e-11)
    assert found["value"] == pytest.approx(height(place, *numbers)[0], rel=1e-12)
    assert list(argmax_block(hump, "x", lo=0.0, hi=1.0, value=False).outputs) == ["best"]


def test_a_peak_is_climbed_and_bracketed():
    def slopes(x):
        return height(x, 1.1, 0.6, 0.2)[1:]

    x = _climb(slopes, 0.7, 0.0, 2.0)
    assert abs(slopes(x)[0]) < 1e-14
    a, b = _bracket(slopes, x, 0.0, 2.0)
    assert a < x < b
    assert b - a < 1e-13
    assert slopes(a)[0] > 0 > slopes(b)[0]
    assert _bracket(slopes, 1.9, 1.8, 2.0) is None
    wide = _bracket(slopes, x + 1e-3, 0.0, 2.0)
    assert wide[0] < x < wide[1] < x + 4e-3


# ---- bounds --------------------------------------------------------------------------------------


@law(y=Output("1", "product"))
def product(x=Input("1", "one"), w=Input("1", "two"), c=Param("1", 2.0, "factor")):
    """c x^3 w."""
    return c * x**3 * w


def test_the_slope_on_a_grid_is_that_of_the_middles_and_what_cells_may_add():
    """6 x^2 w over 1..2.5 by 2..3, three cells each: the last one has both largest."""
    bound = largest_slope(
        product, "y", "x", {"x": (1.0, 2.5), "w": (2.0, 3.0)}, method="grid", cells=3
    )
    seen = 6 * 2.25**2 * (3 - 1 / 6)
    assert bound.reached == pytest.approx(seen)
    assert bound.value == pytest.approx(seen + 12 * 2.5 * 3 * 0.25 + 6 * 2.5**2 / 6)
    assert bound.method == "grid of 9 cells with a Lipschitz remainder"
    other = largest_slope(product, "y", "w", {"x": (-2.0, 1.0)}, "grid", 3, w=5.0, c=3.0)
    assert other.reached == pytest.approx(3 * 1.5**3)
    assert other.value == pytest.approx(3 * 1.5**3 + 9 * 2.0**2 * 0.5)


def test_boxes_are_as_near_as_they_have_to_be():
    """0.1 % of the largest slope, 112.5, or the share of that at the ends that is asked for."""
    over = {"x": (1.0, 2.5), "w": (2.0, 3.0)}
    fine = largest_slope(product, "y", "x", over)
    assert 112.5 <= fine.value <= 112.5 * 1.001 + 1e-9
    coarse = largest_slope(product, "y", "x", over, coarse=0.2)
    assert 112.5 <= coarse.value <= 112.5 * 1.2
    low, high = enclosure(product, "y", over)
    assert 4 - 0.1 <= low <= 4.0
    assert 93.75 <= high <= 93.75 + 1e-3 * (93.75 - 4)
    low, high = enclosure(product, "y", over, gap=0.2)
    assert 93.75 <= high <= 93.75 + 0.2 * (93.75 - 4)


def test_rates_beside_events_are_left_out():
    """Every tick 0.5 s; the jump at 2 s, and what follows within a second of it, do not count."""
    time = np.arange(0, 5, 0.5)
    values = np.array([0.0, 0.2, 0.5, 0.4, 9.0, 8.0, 7.5, 7.25, 7.0, 7.6])
    assert fastest(time, values).reached == pytest.approx(8.6 / 0.5)
    assert fastest(time, values, [2.0]).reached == pytest.approx(0.6 / 0.5)
    assert fastest(time, values, [1.75]).reached == pytest.approx(1.0 / 0.5)
    assert fastest(time, values, [1.75], 0.5).reached == pytest.approx(0.6 / 0.5)
    assert fastest(time, values, [1.75, 4.25], 0.5).reached == pytest.approx(0.5 / 0.5)
    assert fastest(time, values, [4.25, 1.75], 0.2).reached == pytest.approx(2.0)
    assert fastest(time[:2], values[:2], [0.25]).value == 0


# ---- quadratic programs --------------------------------------------------------------------------


@pytest.mark.parametrize("iterations", [1, 2, 7])
def test_the_kernel_is_the_method_of_multipliers(iterations):
    rng = np.random.default_rng(1)
    L, A = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    A[0, 1] = 0.0
    H, q = L @ L.T + np.eye(3), rng.normal(size=3)
    lo, hi, start = np.array([-0.4, 0.1]), np.array([0.3, 0.5]), rng.normal(size=7)
    x, z, y = start[:3], start[3:5], start[5:]
    rho = 3 * np.trace(H) / np.trace(A.T @ A)
    for _ in range(iterations):
        K = H + 1e-6 * np.eye(3) + rho * A.T @ A
        solved = np.linalg.solve(K, 1e-6 * x - q + A.T @ (rho * z - y))
        moved = 1.6 * A @ solved - 0.6 * z
        following = np.clip(moved + y / rho, lo, hi)
        x, y = 1.6 * solved - 0.6 * x, y + rho * (moved - following)
        z = following
    found, end = (np.array(v).ravel() for v in qp_kernel(H, A, iterations)(q, lo, hi, start))
    assert found == pytest.approx(x, rel=1e-9)
    assert end == pytest.approx(np.r_[x, z, y], rel=1e-9)


# ---- peaks over the speed ------------------------------------------------------------------------


def adhesion(s, v, top):
    return top * s / (0.05 * v + s**2)


@law(mu=Output("1", "adhesion"))
def plain(v_s=Input("m/s", "slip"), v=Input("m/s", "speed"), top=Param("m/s", 0.3, "height")):
    """One curve, braking positive."""
    s = -v_s
    return -(top * s / (0.05 * v + s**2))


@law(mu=Output("1", "adhesion"))
def layered(
    v_s=Input("m/s", "slip"), v=Input("m/s", "speed"), recovered=Input("1", "share"),
    height=Input("1", "factor"), wet=Input("m/s", "further", value=0.5),
    top=Param("m/s", 0.3, "height"),
):  # fmt: skip
    """Two curves: the fouled one is lower and has its best slip further out."""
    s = -v_s
    fouled, clean = wet * top * s / (0.4 * v + s**2), top * s / (0.05 * v + s**2)
    return -((1 - recovered) * height * fouled + recovered * clean)


def test_peaks_of_one_curve_are_those_of_the_grid_of_slips():
    """The best slip is the root of 0.05 v: a grid of 1.7 % steps, speeds in between linear."""
    peaks = Peaks(plain, {"top": 0.4}, 20.0)
    assert peaks.speeds == pytest.approx(np.linspace(0.5, 20, 40))
    v = np.array([0.5, 3.3, 17.0, 20.0])
    slip, top = peaks.at(v, np.array([0.2, 0.3, 0.4, 0.5]), np.array([0.5, 0.4, 0.3, 0.1]))
    assert slip == pytest.approx(np.sqrt(0.05 * v), rel=0.02)
    assert top == pytest.approx(0.4 / (2 * np.sqrt(0.05 * v)), rel=0.02)
    assert Peaks(plain, {}, 0.1).speeds[-1] == 1.0


def test_peaks_of_a_layer_are_those_of_the_blend():
    """Factors on both curves; against a search on a finer grid at the nearest speed."""
    peaks = Peaks(layered, {"top": 0.4}, 20.0)
    assert peaks.shares == pytest.approx(np.arange(65) / 64)
    v = peaks.speeds[[1, 12, 39]]
    fouled, clean = np.array([0.7, 0.25, 0.6]), np.array([0.1, 0.5, 0.0])
    slip, top = peaks.at(v, fouled, clean)
    for k in range(3):
        s = np.geomspace(1e-3, 1.0, 20001) * v[k]
        blend = fouled[k] * 0.5 * 0.4 * s / (0.4 * v[k] + s**2) + clean[k] * adhesion(s, v[k], 0.4)
        assert top[k] == pytest.approx(blend.max(), rel=2e-4)
        assert slip[k] == pytest.approx(s[blend.argmax()], rel=0.03)
