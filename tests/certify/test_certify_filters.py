"""Bounds of filters, against the recursions that they are about, run step by step."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.certify.bounds import filters as cf

H, R, DT, GAMMA = 0.43 / 60.35, 1.0, 1e-3, 0.23  # Zhang 2021, Tables 2 and 3

gammas = st.floats(1e-3, 1)
slopes = st.floats(1e-3, 1e3)
densities = st.floats(1e-6, 1e3)
periods = st.floats(1e-4, 0.1)


def recursion(gamma, R, H, dt, prior, samples, q=0.0):
    """Variances and error shares of the scalar filter, written down as in (24)-(30)."""
    P, e, found = prior, 1.0, [(prior, 1.0, math.nan)]
    for _ in range(samples):
        before = (1 + gamma) * P + q * dt
        K = before * H * dt / (H**2 * dt**2 * before + R * dt)
        P = before - K * (H**2 * dt**2 * before + R * dt) * K
        e = (1 - K * H * dt) * e
        found.append((P, e, K * H * dt))
    return np.array(found).T


@given(gamma=gammas, R=densities, H=slopes, dt=periods, ratio=st.floats(1e-3, 1e3))
def test_steady_state_per_sample(gamma, R, H, dt, ratio):
    """Variance, gain and pole of the recursion do not depend on the start, R, H or dt."""
    P = cf.steady_variance(gamma, R, H, dt)
    samples = math.ceil(40 / math.log1p(gamma))
    variance, e, gain = recursion(gamma, R, H, dt, ratio * P, samples)
    assert variance[-1] == pytest.approx(P, rel=1e-9)
    assert gain[-1] == pytest.approx(cf.gain(gamma), rel=1e-9)
    assert e[-1] / e[-2] == pytest.approx(cf.pole(gamma), rel=1e-9)
    assert cf.pole(gamma) == pytest.approx(1 - cf.gain(gamma), abs=1e-15)


@given(gamma=gammas, ratio=st.floats(1e-6, 1e6), k=st.integers(0, 200))
def test_error_share_per_sample(gamma, ratio, k):
    """Exact at every sample, not only in the end; 1e-9 is the rounding of 200 steps."""
    prior = ratio * cf.steady_variance(gamma, R, H, DT)
    _, e, _ = recursion(gamma, R, H, DT, prior, k)
    assert cf.error_share(k * DT, gamma, prior, R, H, DT) == pytest.approx(e[-1], rel=1e-9)


@pytest.mark.parametrize("ratio", [1e-4, 0.1, 1.0, 50.0])
def test_error_share_continuous(ratio):
    """RK4 of P' = gamma P - H^2 P^2/R and e' = -P H^2 e/R; 1e-7 is its error at this step."""
    gamma, P_ss = GAMMA, cf.steady_variance(GAMMA, R, H)
    x, h = np.array([ratio * P_ss, 1.0]), 0.002

    def rhs(x):
        return np.array([gamma * x[0] - H**2 * x[0] ** 2 / R, -x[0] * H**2 / R * x[1]])

    for k in range(1, 5001):
        k1 = rhs(x)
        k2 = rhs(x + h / 2 * k1)
        k3 = rhs(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rhs(x + h * k3))
        if k % 1000 == 0:
            share = cf.error_share(k * h, gamma, ratio * P_ss, R, H)
            assert share == pytest.approx(x[1], rel=1e-7)
    assert cf.steady_variance(gamma, R, H) * H**2 / R == pytest.approx(gamma)


def test_numbers_of_the_paper():
    """0.23 per sample of 1 ms is 4.83 ms, per second 4.35 s; P(0) = 0.5 takes 39.6 s or 76 ms."""
    assert cf.time_constant(GAMMA, DT) == pytest.approx(4.83e-3, abs=5e-6)
    assert cf.time_constant(GAMMA) == pytest.approx(4.35, abs=5e-3)
    assert cf.gain(GAMMA) == pytest.approx(0.18699, abs=5e-6)
    assert cf.steady_variance(GAMMA, R, H) == pytest.approx(4530.5, abs=0.05)
    assert cf.steady_variance(GAMMA, R, H, DT) == pytest.approx(3.683e6, rel=1e-4)
    assert cf.settling_time(0.5, GAMMA, 0.5, R, H) == pytest.approx(39.617, abs=5e-4)
    assert cf.settling_time(0.5, GAMMA, 0.5, R, H, DT) == pytest.approx(76.4e-3, abs=1e-4)


@given(share=st.floats(1e-3, 0.99), gamma=gammas, ratio=st.floats(1e-6, 1e3))
def test_settling_time_inverts_error_share(share, gamma, ratio):
    """Just before it more is left, just after it less."""
    prior = ratio * cf.steady_variance(gamma, R, H, DT)
    t = cf.settling_time(share, gamma, prior, R, H, DT)
    assert cf.error_share(t, gamma, prior, R, H, DT) == pytest.approx(share, rel=1e-9)
    assert cf.error_share(0.99 * t, gamma, prior, R, H, DT) > share
    assert cf.error_share(1.01 * t, gamma, prior, R, H, DT) < share


def test_printed_points_do_not_add_up():
    """Mean to 0.6 and variance to 0.4 with three points and the weights of seven."""
    assert cf.printed_22(2.0) == pytest.approx((0.6, 0.4))
    assert cf.printed_22(2.0, unknowns=3) == pytest.approx((1.0, 0.4))
    assert cf.printed_22(2.0, N=1) == pytest.approx((1.0, 2 / 3))


@given(q=st.floats(1e-3, 1e12), R=densities, H=slopes, dt=periods)
def test_drift_variance(q, R, H, dt):
    """Fixed point of the recursion without gamma."""
    P = cf.drift_variance(q, R, H, dt)
    before = P + q * dt
    after = before - before**2 * H**2 * dt / (H**2 * dt * before + R)
    # P is a small difference where the drift of a tick is much larger than it
    assert after == pytest.approx(P, abs=1e-12 * before + 1e-9 * P)


@given(gamma=gammas, R=densities, H=slopes, dt=periods)
def test_matched_drift(gamma, R, H, dt):
    """There, and only there, gamma knows its variance: NIS 1, white, and the best gain."""
    q = cf.matched_drift(gamma, R, H, dt)
    assert cf.expected_nis(gamma, R, H, dt, q) == pytest.approx(1, rel=1e-9)
    assert cf.innovation_correlation(gamma, R, H, dt, q) == pytest.approx(0, abs=1e-12)
    steady = cf.steady_variance(gamma, R, H, dt)
    assert cf.drift_variance(q, R, H, dt) == pytest.approx(steady, rel=1e-9)
    for factor in (0.99, 1.01):
        nis = cf.expected_nis(gamma, R, H, dt, factor * q)
        assert (nis > 1) == (factor > 1)
        r = cf.innovation_correlation(gamma, R, H, dt, factor * q)
        assert (r > 0) == (factor > 1)
    assert cf.expected_nis(gamma, R, H, dt) == pytest.approx(2 / (2 + gamma))


@pytest.mark.parametrize("factor", [0.0, 1.0, 10.0])
def test_expected_nis_and_correlation(factor):
    """Of 2000 runs side by side over 500 samples, to four standard errors of the means."""
    rng, runs, samples = np.random.default_rng(3), 2000, 500
    q = factor * cf.matched_drift(GAMMA, R, H, DT)
    P = cf.steady_variance(GAMMA, R, H, DT)
    K, S = cf.gain(GAMMA) / (H * DT), (1 + GAMMA) * P * (H * DT) ** 2 + R * DT
    e, v_last, nis, products = np.zeros(runs), None, [], []
    for k in range(samples):
        e = e + math.sqrt(q * DT) * rng.standard_normal(runs)
        v = H * DT * e + math.sqrt(R * DT) * rng.standard_normal(runs)
        e = e - K * v
        if k > 100:
            nis.append(v**2 / S)
            products.append(v * v_last)
        v_last = v
    mean, r = np.mean(nis), np.mean(products) / (np.mean(nis) * S)
    by_run = np.mean(nis, axis=0)
    expected = cf.expected_nis(GAMMA, R, H, DT, q)
    assert mean == pytest.approx(expected, abs=4 * by_run.std() / math.sqrt(runs))
    assert r == pytest.approx(
        cf.innovation_correlation(GAMMA, R, H, DT, q), abs=8 / math.sqrt(runs * (samples - 101))
    )


def test_bands():
    """Coverage of the bands on true chi-squared and white numbers: 95 +- 2 % of 2000 tries."""
    rng = np.random.default_rng(1)
    for n, m in ((50, 1), (200, 3)):
        low, high = cf.nis_band(n, m)
        means = (rng.standard_normal((2000, n, m)) ** 2).sum(axis=2).mean(axis=1)
        assert ((means > low) & (means < high)).mean() == pytest.approx(0.95, abs=0.02)
        assert low < m < high
    v = rng.standard_normal((2000, 500))
    r = (v[:, 1:] * v[:, :-1]).sum(axis=1) / (v**2).sum(axis=1)
    assert (np.abs(r) < cf.white_band(500)).mean() == pytest.approx(0.95, abs=0.02)
