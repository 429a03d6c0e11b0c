"""The QP kernel against OSQP, alone and in the loop of predictive control."""

import numpy as np
import osqp
import pytest
import scipy.sparse as sp

from slipctl import BadInput
from slipctl.analysis.quadratic import qp_kernel
from slipctl.models.wang_2025.hst_traction_control import horizon


def reference(H, A, q, lo, hi):
    solver = osqp.OSQP()
    solver.setup(
        sp.csc_matrix(H), q, sp.csc_matrix(A), lo, hi,
        verbose=False, eps_abs=1e-9, eps_rel=1e-9, max_iter=100_000,
    )  # fmt: skip
    return solver


def test_a_small_problem_to_rounding():
    """min (x-2)^2 + (y-2)^2 with x + y <= 2, x <= 0.5: at (0.5, 1.5)."""
    f = qp_kernel(2 * np.eye(2), np.array([[1.0, 1.0], [1.0, 0.0]]), iterations=300)
    x, end = f([-4.0, -4.0], [-10.0, -10.0], [2.0, 0.5], np.zeros(6))
    assert np.array(x).ravel() == pytest.approx([0.5, 1.5], abs=1e-9)
    again, _ = f([-4.0, -4.0], [-10.0, -10.0], [2.0, 0.5], end)
    assert np.array(again).ravel() == pytest.approx([0.5, 1.5], abs=1e-12)


def test_a_problem_of_one_number_may_be_given_as_numbers():
    """min (x - 2)^2 with x <= 0.5: at the limit; with x <= 3: at 2."""
    f = qp_kernel(2.0, [1.0], iterations=200)
    for limit, best in ((0.5, 0.5), (3.0, 2.0)):
        x, _ = f([-4.0], [-10.0], [limit], np.zeros(3))
        assert float(x) == pytest.approx(best, abs=1e-9)
    with pytest.raises(BadInput, match=r"must be \(n, n\) and \(m, n\)"):
        qp_kernel(np.eye(2), [[1.0, 1.0, 1.0]])


def test_random_problems_agree_with_osqp():
    rng = np.random.default_rng(1)
    H, G, A = horizon(8)
    f = qp_kernel(H, A, iterations=3000)
    for _ in range(10):
        q = G @ rng.normal(size=2)
        lo = np.concatenate([np.full(8, -rng.uniform(0.2, 1)), np.full(8, -0.2)])
        hi = np.concatenate([np.full(8, rng.uniform(0.1, 0.6)), np.full(8, 0.2)])
        best = reference(H, A, q, lo, hi).solve().x
        found, _ = f(q, lo, hi, np.zeros(8 + 32))
        assert np.array(found).ravel() == pytest.approx(best, abs=1e-6)


def test_horizon_is_the_cost_of_the_double_integrator():
    rng = np.random.default_rng(2)
    H, G, _ = horizon(5, 0.2, 1.0, 10.0, 2.0)
    e, u = rng.normal(size=2), rng.normal(size=5)

    def cost(u):
        (x, v), total = e, 0.0
        for a in u:
            x, v = x + 0.2 * v + 0.02 * a, v + 0.2 * a
            total += x * x + 10 * v * v + 2 * a * a
        return total

    change = cost(u) - cost(0 * u)
    assert u @ H @ u + 2 * (G @ e) @ u == pytest.approx(change)


def test_few_iterations_follow_a_problem_that_changes():
    """The double integrator pushed about, limits that drop: first move against OSQP each tick."""
    H, G, A = horizon()
    n, T = 25, 5e-3
    f = qp_kernel(H, A)
    e, last, inner, off = np.zeros(2), 0.0, np.zeros(5 * n), []
    solver = None
    for k in range(1200):
        t = k * T
        top, low = (0.24 if t < 2 else 0.1), -0.9
        d = 0.02 * np.sin(2 * t) - (0.15 if 3 < t < 4 else 0.0)
        near = np.clip([last - 1.0 * T, last + 1.0 * T], low, top)
        lo = np.concatenate([np.full(n, low), near[:1], np.full(n - 1, -0.2)])
        hi = np.concatenate([np.full(n, top), near[1:], np.full(n - 1, 0.2)])
        if solver is None:
            solver = reference(H, A, G @ e, lo, hi)
        x, end = f(G @ e, lo, hi, inner)
        inner = np.array(end).ravel()
        if k % 5 == 0:
            solver.update(q=G @ e, l=lo, u=hi)
            off.append(float(x[0]) - solver.solve().x[0])
        last = float(np.clip(float(x[0]), low, top))
        e = e + T * np.array([e[1], last + d])
    # 1e-3 m/s^2 of the train are 500 N; the largest are where the limit drops
    assert np.abs(off).max() < 1e-3
    assert np.sqrt(np.mean(np.square(off))) < 1e-4


@pytest.mark.parametrize(
    ("H", "A", "iterations", "word"),
    [
        (-np.eye(2), np.eye(2), 10, "positive definite"),
        (np.eye(2), np.eye(3), 10, "must be"),
        (np.eye(2), np.eye(2), 0, "whole number"),
    ],
)
def test_bad_input(H, A, iterations, word):
    with pytest.raises(BadInput, match=word):
        qp_kernel(H, A, iterations)
