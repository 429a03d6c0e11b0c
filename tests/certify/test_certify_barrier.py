"""Bounds of the barrier: each is simulated just inside (0.99) and just outside (1.01)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.models.cheng_2022.certificate import barrier as bl

K, KS = 1200.0, 0.02  # paper 004
KA = KS + math.log(1.2 / 0.54) / (1.2 - 0.54)


def run(w, e=0.0, end=40.0, robust=False, q=50.0):
    """Continuous loop by RK4; returns last error and time of escape."""
    rate = q if robust else bl.rate(K, KS)
    h = 0.01 / rate

    def f(e):
        return w - (bl.robust_pull(e, q, KS) if robust else bl.pull(e, K, KS))

    for n in range(round(end / 0.01)):
        k1 = f(e)
        k2 = f(e + h / 2 * k1)
        k3 = f(e + h / 2 * k2)
        e += h / 6 * (k1 + 2 * k2 + 2 * k3 + f(e + h * k3))
        if e >= KS:
            return e, (n + 1) * h
    return e, math.inf


def test_numbers_of_the_paper():
    assert bl.largest_disturbance(K, KS) == pytest.approx(0.0073901, abs=5e-8)
    assert 1 / bl.rate(K, KS) == pytest.approx(1.0417, abs=5e-5)
    assert bl.largest_disturbance(K, KA) == pytest.approx(1718, abs=0.5)
    assert bl.largest_period(K, KA, KS) == pytest.approx(0.31024e-3, abs=5e-9)
    assert bl.stable_period(K, KA, KS) == pytest.approx(0.551e-3, abs=5e-7)


@pytest.mark.parametrize(("share", "held"), [(0.99, True), (1.01, False)])
def test_disturbance_bound(share, held):
    w = share * bl.largest_disturbance(K, KS)
    e, left = run(w, end=100)
    assert math.isinf(left) == held
    if held:
        assert e == pytest.approx(bl.settled_error(w, K, KS), rel=1e-4)
    else:
        assert left == pytest.approx(bl.escape_time(w, K, KS), rel=2e-3)


@pytest.mark.parametrize(("share", "back"), [(0.99, True), (1.01, False)])
def test_recoverable_start(share, back):
    w = 0.5 * bl.largest_disturbance(K, KS)
    start = min(share * bl.recoverable(w, K, KS), 0.9999 * KS)
    assert math.isinf(run(w, start)[1]) == back
    assert math.isinf(bl.escape_time(w, K, KS, start)) == back


@pytest.mark.parametrize(("share", "held"), [(0.99, True), (1.01, False)])
def test_largest_period(share, held):
    """From every start on the side of k_a, one tick later and on."""
    T = share * bl.largest_period(K, KA, KS)
    e = np.linspace(-KA, KS, 4001)[1:-1]
    out = np.zeros(e.shape, bool)
    for _ in range(200):
        k = np.where(e < 0, KA, KS)
        e = np.where(out, e, e - T * 2 * K * e * (k**2 - e**2))
        out |= (e <= -KA) | (e >= KS)
    assert (not out.any()) == held


@pytest.mark.parametrize("kappa", [0.3, 1.0, 1.5, 2.5, 3.5])
def test_sampled_disturbance(kappa):
    """An alternating and a constant disturbance at .99 stay; above it one of them leaves."""
    found = {}
    for share in (0.99, 1.01):
        om, worst = share * bl.sampled_disturbance(kappa), 0.0
        interval = np.zeros(1)
        for _ in range(3000):  # hull of all that the disturbance can reach
            hi = min(interval.max(), 1.5)
            z = np.linspace(-hi, hi, 2001)
            interval = np.abs(z - kappa * z * (1 - z * z)) + om
            worst = max(worst, interval.max())
            if worst >= 1:
                break
        found[share] = worst < 1
    assert found == {0.99: True, 1.01: False}


@given(
    k=st.floats(1, 1e4), width=st.floats(1e-3, 2), load=st.floats(0.0, 0.999),
)  # fmt: skip
def test_roots_of_the_cubic(k, width, load):
    W = load * bl.largest_disturbance(k, width)
    low, high = bl.settled_error(W, k, width), bl.recoverable(W, k, width)
    assert low >= -1e-12 * width
    assert low <= width * bl.Z_PEAK * (1 + 1e-9) <= high * (1 + 2e-9) <= width * (1 + 3e-9)
    for e in (low, high):
        assert bl.pull(e, k, width) == pytest.approx(W, abs=1e-9 * k * width**3)


@given(W=st.floats(1e-6, 1e3), q=st.floats(0.1, 500), width=st.floats(1e-3, 2))
def test_robust_shape_stays_inside_for_every_disturbance(W, q, width):
    e = bl.robust_settled(W, q, width)
    assert 0 < e < width
    if e < 0.999 * width:
        assert bl.robust_pull(e, q, width) == pytest.approx(W, rel=1e-6)


def test_robust_shape_holds_what_the_printed_one_cannot():
    w = 100 * bl.largest_disturbance(K, KS)
    e, left = run(w, robust=True)
    assert math.isinf(left)
    assert e == pytest.approx(bl.robust_settled(w, 50.0, KS), rel=1e-6)
    assert run(w)[1] == pytest.approx(bl.escape_time(w, K, KS), rel=0.5)


@pytest.mark.parametrize("zb", [0.5, 0.9, 0.99])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_robust_window(zb, share):
    """Invariant just inside both ends, and not just outside, by a fine grid of errors."""
    grid = np.linspace(-zb, zb, 20001)

    def holds(kappa, om):
        return np.abs(grid - kappa * grid / (1 - grid**2)).max() + om <= zb * (1 + 1e-12)

    om = share * 0.2 * zb
    low, high = bl.robust_window(zb, om)
    assert 0 <= low < high
    assert holds(0.99 * high + 0.01 * low, om)
    assert not holds(1.01 * high, om)
    if low > 0:
        assert holds(1.01 * low if 1.01 * low < high else high, om)
        assert not holds(0.99 * low, om)
    assert bl.robust_window(0.5, 0.9) == (math.inf, 0.0)


def test_excursion_behind_a_lag():
    """First-order lag, command A from the start: the integral until e' = 0, by fine Euler steps."""
    jump, lag, A, h = 1.0, 0.02, 3.0, 1e-6
    e = u = top = 0.0
    for _ in range(40000):
        e += h * (jump - u)
        u += h * (A - u) / lag
        top = max(top, e)
    assert bl.lag_excursion(jump, lag, A) == pytest.approx(top, rel=1e-3)
    assert bl.lag_excursion(jump, lag) == pytest.approx(0.02)
    assert bl.lag_excursion(jump, lag, 1.0 + 1e-9) == pytest.approx(0.02, rel=1e-6)
    assert bl.lag_excursion(jump, lag, 0.9) == math.inf


def test_refusals_name_what_would_pass():
    with pytest.raises(BadInput, match=r"outside the barrier -1\.2.*k_s = 0\.0556 would pass"):
        bl.check_start("ctl", 0.05, KA, KS)
    bl.check_start("ctl", 0.05, KA, 0.0556)
    with pytest.raises(BadInput, match=r"0\.00028 s would pass"):
        bl.check_period("ctl", K, KA, KS, 1e-3)
    bl.check_period("ctl", K, KA, KS, 0.00028)
    with pytest.raises(BadInput, match=r"q = 37\.6 1/s would pass"):
        bl.check_rate("ctl", 50.0, 0.01)
    bl.check_rate("ctl", 37.6, 0.01)
