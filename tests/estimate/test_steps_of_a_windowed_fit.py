"""Sums, normal equations, damped steps and recalls of a fit over a window, by numpy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, law, rls
from slipctl.estimate import gauss_newton as newton
from slipctl.estimate import recall
from slipctl.estimate.identification import _weights
from slipctl.estimate.model import Model
from slipctl.estimate.noise_weights import echoing_sums, shift_ratios, white_sums
from slipctl.estimate.window import _numbers

WINDOW = 5


@law(y=Output("N", "height"))
def curve(
    v=Input("m/s", "one"), w=Input("1", "two", shape=(2,)), a=Param("s/m", 0.4, "decay", lo=1e-3),
    b=Param("N", -0.3, "slope"), c=Param("N", 1.5, "height", lo=1e-3), k=Param("1", 0.7, "known"),
):  # fmt: skip
    """Three unknowns and a known number."""
    return c * ca.exp(-a * v) + b * w[0] - k * a * w[1]


MODEL = Model.of(curve, "y", ["a", "b", "c"], ["log(a)", "b", "log(c + b)"], {"b": -0.2})


def by_numpy(values, samples, known):
    """(residuals, rows) of samples (v, w0, w1, y) as columns."""
    a, b, c = values
    v, w0, w1, y = samples
    e = y - (c * np.exp(-a * v) + b * w0 - known * a * w1)
    return e, np.column_stack([-c * v * np.exp(-a * v) - known * w1, w0, np.exp(-a * v)])


def drawn(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 2, size=(4, WINDOW)), rng.uniform(0, 1, (1, WINDOW)), rng


def arrays(found):
    return [np.array(v) for v in found]


def test_coordinates_and_their_slopes():
    """b is itself; a and c + b are exponentials of theirs."""
    assert MODEL.guess == pytest.approx([np.log(0.4), -0.2, np.log(1.3)])
    theta = np.array([0.3, 0.8, -0.5])
    values, slopes = arrays(MODEL.parameters(theta))
    a, q = np.exp(0.3), np.exp(-0.5)
    assert values.ravel() == pytest.approx([a, 0.8, q - 0.8])
    assert slopes == pytest.approx(np.array([[a, 0, 0], [0, 1, 0], [0, -1, q]]))


def test_sums_of_white_noise_are_weighted_products():
    samples, weights, _ = drawn(1)
    values = [0.5, -0.4, 1.2]
    e, rows = by_numpy(values, samples, 0.9)
    squares, JJ, Je = arrays(white_sums(MODEL, WINDOW)(values, samples, weights, [0.9]))
    W = np.diag(weights.ravel())
    assert squares.item() == pytest.approx(e @ W @ e)
    assert pytest.approx(rows.T @ W @ rows) == JJ
    assert Je.ravel() == pytest.approx(rows.T @ W @ e)


def test_sums_of_echoing_noise_are_those_of_its_covariance():
    """n_k = w_k - 0.6 w_{k-1}: generalised least squares; what the oldest adds."""
    samples, _, _ = drawn(2)
    values, echo, many = [0.5, -0.4, 1.2], 0.6, 4
    weights = np.ones((1, WINDOW))
    weights[0, many:] = 0  # an unused place is the oldest
    e, rows = by_numpy(values, samples, 0.9)
    sums, heard = echoing_sums(MODEL, WINDOW, echo)

    def whole(n):
        C = (1 + echo**2) * np.eye(n) - echo * (np.eye(n, k=1) + np.eye(n, k=-1))
        return np.linalg.inv(C)

    squares, JJ, Je, _, _ = arrays(sums(values, samples, weights, [0.9]))
    V = whole(many)
    assert squares.item() == pytest.approx(e[:many] @ V @ e[:many])
    assert pytest.approx(rows[:many].T @ V @ rows[:many]) == JJ
    assert Je.ravel() == pytest.approx(rows[:many].T @ V @ e[:many])
    *_, JJ_last, Je_last = arrays(sums(values, samples, np.ones((1, WINDOW)), [0.9]))
    V, less = whole(WINDOW), whole(WINDOW - 1)
    assert JJ_last == pytest.approx(rows.T @ V @ rows - rows[:-1].T @ less @ rows[:-1])
    assert Je_last.ravel() == pytest.approx(rows.T @ V @ e - rows[:-1].T @ less @ e[:-1])
    # the newest noise given all samples: the innovation of the next residual
    r, u, g = 0.0, 0.0, np.zeros(3)
    for k in reversed(range(WINDOW)):
        q = echo / r if r else 0.0
        u, g, r = e[k] + q * u, rows[k] + q * g, 1 + echo**2 - echo * q
    left = arrays([heard(values, samples, np.ones((1, WINDOW)), [0.9])])[0].ravel()
    assert left == pytest.approx(echo / r * np.r_[u, g])


def test_the_normal_equations_are_cost_slope_and_curvature():
    samples, weights, rng = drawn(3)
    normal = newton.normal_equations(MODEL, white_sums(MODEL, WINDOW))
    theta, mean = rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.3
    L = rng.normal(size=(3, 3))
    Lambda = L @ L.T + np.eye(3)
    J, squares, H, r = arrays(normal(theta, samples, weights, mean, Lambda, 0.04, [0.9]))
    values, slopes = arrays(MODEL.parameters(theta))
    e, rows = by_numpy(values.ravel(), samples, 0.9)
    W, G = np.diag(weights.ravel()), rows @ slopes
    assert squares.item() == pytest.approx(e @ W @ e)
    off = mean - theta
    assert J.item() == pytest.approx((e @ W @ e / 0.04 + off @ Lambda @ off) / 2)
    assert pytest.approx(G.T @ W @ G / 0.04 + Lambda) == H
    assert r.ravel() == pytest.approx(G.T @ W @ e / 0.04 + Lambda @ off)


@pytest.mark.parametrize("damping", [1e-3, 0.5, 2e-9, 5e8])
def test_an_iteration_is_a_damped_step_that_has_to_be_better(damping):
    """Damping falls to a quarter or rises fourfold, from 1e-9 to 1e9; then it begins at 0.1."""
    samples, weights, _ = drawn(4)
    normal = newton.normal_equations(MODEL, white_sums(MODEL, WINDOW))
    step, least = newton.iteration(normal), np.full(3, 1e-12)
    data = [samples, weights, [0.1, -0.2, 0.3], np.diag([1.0, 2.0, 3.0]), 0.04, [0.9]]
    theta = np.array([0.4, 0.1, -0.2])
    now = arrays(normal(theta, *data))
    H, r = now[2], now[3]
    there = theta + np.linalg.solve(H + damping * np.diag(np.diag(H)), r.ravel())
    then = arrays(normal(there, *data))
    assert then[0] < now[0]
    eps = 2.0**-52
    found = arrays(step(theta, *now, damping, least, eps, *data))
    assert found[0].ravel() == pytest.approx(there)
    for have, want in zip(found[1:5], then, strict=True):
        assert have == pytest.approx(want)
    assert found[5].item() == pytest.approx(max(damping / 4, 1e-9))
    small = [now[0] - 1e6, *now[1:]]  # a cost below all others: it is refused
    found = arrays(step(theta, *small, damping, least, eps, *data))
    assert found[0].ravel().tolist() == theta.tolist()
    for have, want in zip(found[1:5], small, strict=True):
        assert (have == want).all()
    assert found[5].item() == pytest.approx(min(4 * damping, 1e9))
    blind = 64 / np.sqrt(2.0**-23)
    for near, after in ((0.99, 0.99 * blind), (1.01, 0.1)):
        found = arrays(step(theta, *small, near * blind / 4, least, 2.0**-23, *data))
        assert found[5].item() == pytest.approx(after)


@pytest.mark.parametrize("n", [1, 2, 4, 5])
def test_solver_and_inverse_are_numpys(n):
    rng = np.random.default_rng(n)
    L, b = rng.normal(size=(n, n)), rng.normal(size=n)
    A, least = L @ L.T + 0.1 * np.eye(n), np.full(n, 1e-9)
    assert np.array(newton.solver(n)(A, b, least)).ravel() == pytest.approx(np.linalg.solve(A, b))
    assert np.array(newton.inverse(n)(A, least)) == pytest.approx(np.linalg.inv(A))


def test_an_inverse_that_rounding_has_lost_is_what_is_known_anyhow():
    """The second pivot, 1 - 4, is taken for 0.5: the first variance would be 9, not 4 at most."""
    lost = newton.inverse(2)(np.array([[1.0, 2.0], [2.0, 1.0]]), [0.25, 0.5])
    assert np.array(lost) == pytest.approx(np.diag([4.0, 2.0]))
    kept = newton.inverse(2)(np.array([[1.0, 0.5], [0.5, 1.0]]), [0.25, 0.5])
    assert np.array(kept) == pytest.approx(np.array([[4, -2], [-2, 4]]) / 3)
    held = newton.solver(2)(np.array([[1.0, 2.0], [2.0, 1.0]]), [1.0, 3.0], [0.25, 0.5])
    full = np.array([[1, 2], [2, 4 + 0.5]])  # with the pivot in place of -3
    assert np.array(held).ravel() == pytest.approx(np.linalg.solve(full, [1, 3]))


def test_ratios_of_shifts_are_squared_projections():
    """White: (sum of the latest k)^2/k; with an echo on 1, 1 + e, 1 + e + e^2, newest last."""
    shifts = np.array([0.5, -1.0, 2.0, 0.25])
    for echo in (0.0, 0.5):
        shape = np.cumsum(echo ** np.arange(4)) if echo else np.ones(4)
        left = [shape[:k] for k in (1, 2, 3, 4)]
        wanted = [(shifts[: len(s)] @ s[::-1]) ** 2 / (s @ s) for s in left]
        found = np.array(shift_ratios(ca.DM(shifts).T, 4, echo)).ravel()
        assert found == pytest.approx(wanted)


# ---- taking a change back ------------------------------------------------------------------------


def numbers(exprs):
    return {n: float(v) for n, v in exprs.items()}


@pytest.mark.parametrize(
    ("agreed", "summed", "agrees", "t", "after", "back"),
    [
        (0, 0.0, 1, 0.5, (1, 0.5), 0), (2, 1.0, 1, 0.7, (3, 1.7), 1), (2, 1.0, 1, 0.8, (0, 0.0), 0),
        (2, 1.0, 0, 0.1, (0, 0.0), 0), (-1, 0.0, 1, 0.1, (-1, 0.0), 0),
        (1, -1.0, 1, -0.4, (2, -1.4), 0),
    ],
)  # fmt: skip
def test_samples_that_agree_are_counted(agreed, summed, agrees, t, after, back):
    """Three in a row bring it back; their sum may be as much as the root of how many they are."""
    x = {"agreed": ca.DM(agreed), "summed": ca.DM(summed)}
    counts, came = recall.count_sample(x, ca.DM(agrees), 3, ca.DM(t))
    assert numbers(counts) == pytest.approx({"agreed": after[0], "summed": after[1]})
    assert float(came) == back
    alone, _ = recall.count_sample({"agreed": ca.DM(agreed)}, ca.DM(agrees), 3)
    assert numbers(alone) == {"agreed": -1 if agreed < 0 else agreed + 1 if agrees else 0}


def test_what_is_left_is_put_aside():
    x = {"theta": ca.DM(5), "P": ca.DM(7), "former_theta": ca.DM(11), "former_P": ca.DM(13)}
    counts = {"agreed": ca.DM(2), "summed": ca.DM(0.5)}
    for left, over, wanted in (
        (0, 0, [11, 13, 2, 0.5]), (1, 0, [5, 7, 0, 0]), (0, 1, [11, 13, -1, 0.5]),
        (1, 1, [5, 7, 0, 0]),
    ):  # fmt: skip
        found = recall.put_aside(x, ("theta", "P"), counts, ca.DM(left), ca.DM(over))
        assert list(numbers(found).values()) == wanted
        assert list(found) == ["former_theta", "former_P", "agreed", "summed"]


# ---- what is declared ----------------------------------------------------------------------------


def ranges(signals):
    return {s.name: (float(np.ravel(s.value)[0]), s.lo, s.hi) for s in signals}


def test_numbers_of_the_estimators():
    assert ranges(_numbers(MODEL)) == {
        "noise": (1e-3, 1e-12, 1e12), "spread": (2.0, 1e-6, 1e12), "gate": (5.0, 1, 1e12),
        "coarsest": (1e12, 1e-12, 1e12), "farthest": (1e12, 1e-12, 1e12),
        "settling": (0.0, 0, 1000), "forgetting": (1.0, 1e-3, 1),
    }  # fmt: skip
    block = rls(curve, unknown=["a", "b", "c"], coordinates=["a", "b", "c"], start={"b": 1.0})
    own = {n: s for n, s in block.params.items() if n != "k"}
    assert ranges(own.values()) == {
        "forgetting": (0.98, 1e-3, 1), "noise": (1e-2, 1e-12, 1e12), "spread": (1.0, 1e-6, 1e12),
        "jump": (0.02, 0, 1e12), "cap": (1.0, 1e-3, 1e12),
    }  # fmt: skip
    assert block.period == 0.016
    found = _weights("N", [3.0, 4.0], [5.0, 6.0])
    assert ranges(found) == {
        "forgetting": (1.0, 1e-3, 1), "noise": (1e-2, 1e-12, np.inf),
        "spread": (3.0, 1e-12, np.inf), "centre": (5.0, -np.inf, np.inf),
        "accuracy": (0.05, 1e-9, np.inf),
    }  # fmt: skip
    assert [found[2].value.tolist(), found[3].value.tolist()] == [[3.0, 4.0], [5.0, 6.0]]
