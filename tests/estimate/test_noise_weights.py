"""Noise that echoes: sums, estimates and detection against generalised least squares in numpy."""

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, law, rls
from slipctl.estimate.model import Model
from slipctl.estimate.noise_weights import echoing_sums, signature
from slipctl.estimate.window import smallest_shift
from slipctl.models.huang_2020.subway_braking import TABLE_1, double_exponential

START = {"c": 0.3, "a": 0.5, "b": 1.3}
SWEEP = np.concatenate([np.linspace(0, 2.4, 26), np.full(34, 1.21)])


@law(y=Output("1", "output"))
def line(u=Input("1"), p=Param("1", 0.0), q=Param("1", 0.0)):
    """Linear in both unknowns."""
    return p + q * u


def covariance(n, echo):
    """Of w_k - echo w_{k-1} with a deviation of 1: tridiagonal."""
    return (1 + echo**2) * np.eye(n) - echo * (np.eye(n, k=1) + np.eye(n, k=-1))


def noise(rng, echo, *shape):
    w = rng.standard_normal((*shape[:-1], shape[-1] + 1))
    return w[..., 1:] - echo * w[..., :-1]


@pytest.mark.parametrize("echo", [0.3, 0.9, 1.0])
@pytest.mark.parametrize("count", [1, 5, 12])
def test_sums_are_those_of_generalised_least_squares(echo, count):
    """e' R^-1 e, H' R^-1 H and H' R^-1 e, R tridiagonal; in a full window what the oldest adds."""
    model = Model.of(line, "y", ("p", "q"), ("p", "q"), None)
    window, rng = 12, np.random.default_rng(count)
    u, y = rng.standard_normal((2, count))
    values = np.array([0.7, -1.3])
    e, H = y - values[0] - values[1] * u, np.column_stack([np.ones(count), u])
    rest = [[u[0]] * (window - count), [y[0]] * (window - count)]
    samples = np.hstack([np.array([u[::-1], y[::-1]]), rest])
    weights = (np.arange(window) < count).astype(float)[None]
    sums, heard = echoing_sums(model, window, echo)
    found = [np.array(m).squeeze() for m in sums(values, samples, weights, ca.DM(0, 1))]

    def direct(e, H):
        R = np.linalg.inv(covariance(len(e), echo)) if len(e) else np.zeros((0, 0))
        return [e @ R @ e, H.T @ R @ H, H.T @ R @ e]

    whole, without = direct(e, H), direct(e[1:], H[1:])
    lost = [whole[1] - without[1], whole[2] - without[2]]
    # both are sums of at most 12 numbers of order 1 to 100
    for ours, theirs in zip(found, whole + lost * (count == window), strict=False):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)
    # what is heard: minus the best linear forecast of the next noise, R_{k+1,1..k} R^-1 e
    forecast = covariance(count + 1, echo)[-1, :-1] @ np.linalg.inv(covariance(count, echo))
    left = np.array(heard(values, samples, weights, ca.DM(0, 1))).ravel()
    np.testing.assert_allclose(left, -forecast @ np.column_stack([e, H]), atol=1e-10)


@cache
def estimator(echo, memory=8):
    return rls(
        double_exponential,
        form="window",
        start=START,
        memory=memory,
        echo=echo,
        noise=1e-2,
        window=SWEEP.size + 8,
    )


def run(est, v, m):
    """Outputs by name, rows are runs."""
    many, ticks = m.shape
    x = ca.repmat(ca.DM(est.pack("state", est.start())), 1, many)
    p = ca.repmat(ca.DM(est.pack("param", est.param_values())), 1, many * ticks)
    inputs = np.vstack([np.tile(v, many), m.ravel()])
    Y = np.array(ca.DM(est.f.mapaccum(ticks).map(many)(x, inputs, p)[1])).reshape(-1, many, ticks)
    names = [n for n, s in est.outputs.items() if s.size == 1]
    return dict(zip(names, Y, strict=False))


def place(y):
    return np.log(y["b"] / y["a"])[:, -1] / (y["b"] - y["a"])[:, -1]


@pytest.mark.second
def test_who_knows_the_echo_finds_the_peak_better():
    """16 runs of a sweep; the bound is that of generalised least squares with the true noise."""
    true, sigma, rng = TABLE_1["dry"], 0.01, np.random.default_rng(2)
    clean = true["c"] * (np.exp(-true["a"] * SWEEP) - np.exp(-true["b"] * SWEEP))
    m = clean + sigma * noise(rng, 1.0, 16, SWEEP.size)
    best = math.log(true["b"] / true["a"]) / (true["b"] - true["a"])
    known, white = (place(run(estimator(echo), SWEEP, m)) / best - 1 for echo in (1.0, 0.0))
    fast, slow = np.exp(-true["b"] * SWEEP), np.exp(-true["a"] * SWEEP)
    H = np.column_stack([slow - fast, -true["c"] * SWEEP * slow, true["c"] * SWEEP * fast])
    P = sigma**2 * np.linalg.inv(H.T @ np.linalg.inv(covariance(SWEEP.size, 1.0)) @ H)
    a, b = true["a"], true["b"]
    g = np.array([0, (-1 / a + best) / (b - a), (1 / b - best) / (b - a)])
    bound = math.sqrt(g @ P @ g) / best
    # 16 runs tell a deviation to 18 %; two of these, and what the guess pulls
    assert np.sqrt(np.mean(known**2)) < 1.4 * bound
    assert np.sqrt(np.mean(known**2)) < 0.6 * np.sqrt(np.mean(white**2))


def test_a_shift_is_told_that_white_noise_would_hide():
    """Of the size that is told after 4 samples; and noise alone is no change, 8 runs."""
    true, sigma, before = TABLE_1["wet"], 0.01, SWEEP.size
    v = np.concatenate([SWEEP, np.full(8, 1.21)])
    rng = np.random.default_rng(3)
    clean = true["c"] * (np.exp(-true["a"] * v) - np.exp(-true["b"] * v))
    m = clean + sigma * noise(rng, 1.0, 8, v.size)
    limit = smallest_shift(sigma, before, 4, declared=1e-2, echo=1.0)
    # sum of signature^2 is 1 + 4 + 9 + 16 = 30 against 4: what white noise hides 2.7 times as well
    assert limit == pytest.approx(smallest_shift(sigma, before, 4, declared=1e-2) * 30**-0.5 * 2)
    shifted = m - 2 * limit * (np.arange(v.size) >= before)
    told = run(estimator(1.0), v, shifted)["changed"]
    assert not told[:, :before].any()
    assert told[:, before : before + 4].any(axis=1).all()  # 1.6 limits are, see window.py
    assert not run(estimator(1.0), v, m)["changed"].any()
    blind = run(estimator(0.0), v, shifted)["changed"][:, before : before + 4].any(axis=1)
    assert blind.mean() < 0.5


def test_signature_is_the_response_to_a_step():
    assert signature(4, 1.0) == [1, 2, 3, 4]
    assert signature(3, 0.5) == [1, 1.5, 1.75]


def test_bad_input_is_one_line():
    with pytest.raises(BadInput, match=r"echo = 1.1 must be from 0 to 1"):
        rls(double_exponential, form="window", echo=1.1)
    with pytest.raises(BadInput, match="echo needs 'window'"):
        rls(double_exponential, echo=0.5)
