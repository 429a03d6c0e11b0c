"""Moments of filters by numpy, small matrices of scalars, and what a filter declares."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, State, ctukf, ekf, flow
from slipctl.estimate.kalman.moments import (
    factors,
    forward,
    linear_moments,
    printed_22,
    sigma_points,
    solve,
    with_floor,
)

X = np.array([0.4, -1.2, 0.7])
ROOT = np.array([[0.5, 0, 0], [0.2, 0.8, 0], [-0.3, 0.4, 0.6]])
P = ROOT @ ROOT.T
FLOOR = [1e-12] * 3


def g(v):
    """Two values of three unknowns."""
    return [v[0] * v[1] + 0.3 * v[2] ** 2, ca.sin(v[0]) - v[1] * v[2]]


def by_numpy(v):
    return np.array([v[0] * v[1] + 0.3 * v[2] ** 2, np.sin(v[0]) - v[1] * v[2]])


def through(moments, x=X, floor=FLOOR):
    """Mean, cross and own covariance as arrays; symbols, so that slopes are taken too."""
    many = len(x)
    xs, ps = ca.SX.sym("x", many), ca.SX.sym("P", many, many)
    rows = [[ps[i, j] for j in range(many)] for i in range(many)]
    found = moments(g, ca.vertsplit(xs), rows, floor)
    flat = [*found.mean, *(v for m in (found.cross, found.own) for r in m for v in r)]
    numbers = np.array(ca.Function("f", [xs, ps], [ca.vertcat(*flat)])(x, P)).ravel()
    return numbers[:2], numbers[2:8].reshape(3, 2), numbers[8:].reshape(2, 2)


def weighed(points, weights, of_covariance):
    """Mean, cross and own covariance of weighed points."""
    values = np.array([by_numpy(p) for p in points])
    mean, middle = weights @ values, weights @ np.array(points)
    W, off = np.diag(of_covariance), np.array(points) - middle
    return mean, off.T @ W @ (values - mean), (values - mean).T @ W @ (values - mean)


@pytest.mark.parametrize("sigma", [0.0, 0.5, 2.0])
def test_sigma_points_spread_by_the_root_of_the_covariance(sigma):
    """2 N + 1 of them; the columns of a root that is triangular are Cholesky's."""
    spread = math.sqrt(3 + sigma) * ROOT
    points = [X, *(X + c for c in spread.T), *(X - c for c in spread.T)]
    weights = np.r_[sigma / (3 + sigma), np.full(6, 0.5 / (3 + sigma))]
    for have, want in zip(
        through(sigma_points(sigma)), weighed(points, weights, weights), strict=True
    ):
        assert have == pytest.approx(want, rel=1e-12)


def test_moments_as_printed_have_the_weights_of_three_unknowns():
    """Spread by the root of sigma alone; beta goes to the centre of the covariances."""
    sigma, beta = 2.0, 0.7
    spread = math.sqrt(sigma) * ROOT
    points = [X, *(X + c for c in spread.T), *(X - c for c in spread.T)]
    weights = np.r_[sigma / 5, np.full(6, 1 / 10)]
    own = weights + np.r_[beta, np.zeros(6)]
    for have, want in zip(
        through(printed_22(sigma, beta)), weighed(points, weights, own), strict=True
    ):
        assert have == pytest.approx(want, rel=1e-12)


def test_moments_of_first_order_take_the_exact_slopes():
    G = np.array([[X[1], X[0], 0.6 * X[2]], [np.cos(X[0]), -X[2], -X[1]]])
    mean, cross, own = through(linear_moments)
    assert mean == pytest.approx(by_numpy(X))
    assert cross == pytest.approx(P @ G.T)
    assert own == pytest.approx(G @ P @ G.T)


def test_factors_solve_and_floor_are_numpys():
    """A pivot below the floor is lifted to it; the others stay."""
    A = [[float(v) for v in row] for row in P]
    L, D = factors(A)
    L, D = np.array(L, dtype=float), np.array(D, dtype=float)
    assert pytest.approx(ROOT / np.diag(ROOT)) == L
    assert pytest.approx(np.diag(ROOT) ** 2) == D
    b = [0.3, -0.7, 1.9]
    assert np.array(forward(L, b), dtype=float) == pytest.approx(np.linalg.solve(L, b))
    assert np.array(solve(L, D, b), dtype=float) == pytest.approx(np.linalg.solve(P, b))
    lifted = with_floor(A, [0.1, 0.9, 0.01])
    D[1] = 0.9
    L[2, 1] = (P[2, 1] - L[2, 0] * L[1, 0] * D[0]) / 0.9
    D[2] = max(P[2, 2] - L[2, 0] ** 2 * D[0] - L[2, 1] ** 2 * 0.9, 0.01)
    assert np.array([[float(v) for v in r] for r in lifted]) == pytest.approx(L @ np.diag(D) @ L.T)


# ---- what a filter declares ----------------------------------------------------------------------


@flow(s=Output("N", "sum"))
def pair(
    a=State("m", 0.3, "first"), b=State("m/s", -0.2, "second"), u=Input("m/s", "drives"),
    k=Param("1/s", 0.7, "rate", lo=0, hi=5), c=Param("N/m", 2.0, "stiffness", lo=0.1, hi=9),
):  # fmt: skip
    """Two states."""
    return dict(a=b + u, b=-k * b), dict(s=c * a)


GIVEN = {
    "prior": {"a": 2.0, "b": 3.0, "k": 5.0}, "noise": {"a": 0.1, "s": 0.2},
    "drift": {"a": 0.01, "b": 0.02, "k": 0.03}, "floor": {"a": 1e-5, "b": 2e-5, "k": 3e-5},
    "cap": {"a": 40.0, "b": 50.0, "k": 60.0}, "start": {"b": 0.9}, "gamma": 0.25, "period": 0.5,
}  # fmt: skip


@pytest.mark.parametrize("kind", [ctukf, ekf], ids=["ctukf", "ekf"])
@pytest.mark.parametrize("per", ["sample", "second"])
def test_numbers_of_a_filter_are_those_that_are_given(kind, per):
    block = kind(pair, ("a", "s"), ("a", "b", "k"), per=per, **GIVEN)
    told = {n: (float(s.value), s.lo, s.hi) for n, s in block.params.items()}
    least = 1e-300
    wanted = {"gamma": (0.25, 0, 1 if per == "sample" else 1e3)}
    for n in "abk":
        wanted |= {
            f"prior_{n}": (GIVEN["prior"][n], least, 1e30),
            f"drift_{n}": (GIVEN["drift"][n], 0, 1e30),
            f"floor_{n}": (GIVEN["floor"][n], least, 1e30),
            f"cap_{n}": (GIVEN["cap"][n], least, 1e30),
        }  # fmt: skip
    wanted |= {f"noise_{n}": (GIVEN["noise"][n], least, 1e30) for n in "as"}
    assert {n: told[n] for n in wanted} == wanted
    assert told["c"] == (2.0, 0.1, 9)
    start = {n: float(v) for n, v in block.start().items()}
    assert (start["held_a"], start["held_b"], start["held_k"]) == (0.3, 0.9, 0.7)
    assert [start[f"P_{n}"] for n in ("a", "b", "k")] == [2.0, 3.0, 5.0]
    assert [start[f"P_{n}"] for n in ("b_a", "k_a", "k_b")] == [0, 0, 0]
    assert start["held_begun"] == 0
    units = {n: s.unit for n, s in block.outputs.items()}
    assert [units[n] for n in ("a", "b", "k", "innovation_s", "nis")] == [
        "m",
        "m/s",
        "1/s",
        "N",
        "1",
    ]


def test_a_tick_keeps_what_the_next_one_needs():
    block = ekf(pair, ("a", "s"), ("a", "b", "k"), **GIVEN)
    after, _ = block(a=0.35, s=0.8, u=0.6)
    assert [float(after[n]) for n in ("held_begun", "held_u")] == [1.0, 0.6]
