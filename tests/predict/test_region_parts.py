"""Parts of the proof of a region, of functions that are given here: bounds and counterexamples."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput
from slipctl.predict.options import region
from slipctl.predict.options.limits import FAR
from slipctl.predict.stages.horizon import Soft

W = ca.SX.sym("w", 2)
LOW = np.array([[0.2, -0.5, 1.0], [0.1, 0.3, -2.0]])
HIGH = LOW + np.array([[0.2, 0.1, 0.5], [0.4, 0.2, 0.25]])


def search(following, rows=(), L=((1.0, 0.0), (0.0, 1.0))):
    """A search whose law goes from W to ``following``, with rows of its limits."""
    made = object.__new__(region._Search)
    made.where, made.L = "here", np.array(L)
    made.G, made.rest, made.names = np.linalg.inv(made.L), np.array([3.0, -1.0]), ["p", "q"]
    made.labels = [f"{n} {s}" for n in ("u", "v", "z") for s in ("above", "below")]
    made._functions(W, following, ca.densify(ca.vertcat(*rows)))
    return made


ROWS = [W[0] - 0.7, -W[0] - 2.0, 2 * W[1] - 3.2, -W[1] - 5.0, W[0] * W[1] - 9, ca.SX(-1)]


def test_contraction_is_bounded_by_the_middle_and_half_the_spread():
    """Slopes (0.5 + 0.1 x, 0.2; y/4, 0.3): norms of the middle, and of what a box adds."""
    turned = ca.vertcat(0.5 * W[0] + 0.05 * W[0] ** 2 + 0.2 * W[1], 0.125 * W[1] ** 2 + 0.3 * W[0])
    found = search(turned, ROWS)._contracts(LOW, HIGH)
    for k in range(3):
        x, y = (LOW[:, k] + HIGH[:, k]) / 2
        half_x, half_y = (HIGH[:, k] - LOW[:, k]) / 2
        middle = np.array([[0.5 + 0.1 * x, 0.2], [0.3, y / 4]])
        spread = np.hypot(0.1 * half_x, half_y / 4)
        assert found[k] == pytest.approx(np.linalg.norm(middle, 2) + spread - 1, abs=1e-8)
        assert found[k] > np.linalg.norm(middle, 2) + spread - 1
    wild = search(
        ca.vertcat(0.5 * W[0] / (1 + W[1] ** 2 * 0) + ca.sqrt(W[1] + 4) - 2, W[0] / 4), ROWS
    )
    far = wild._contracts(np.array([[0.0], [-5.0]]), np.array([[1.0], [-4.5]]))
    assert far.tolist() == [np.inf]


def test_the_fall_is_bounded_over_the_size_of_the_box():
    """V falls by 3/4: the least of what intervals and the middle of a box tell, never below."""
    made = search(0.5 * W, ROWS)
    found = made._falls(LOW, HIGH)
    near = np.where(LOW * HIGH < 0, 0, np.minimum(abs(LOW), abs(HIGH)))
    far = np.maximum(abs(LOW), abs(HIGH))
    middle, half = (LOW + HIGH) / 2, (HIGH - LOW) / 2
    steepest = np.maximum(abs(LOW / 2 - 2 * HIGH), abs(HIGH / 2 - 2 * LOW))  # of w/2 less 2 w
    ends = -0.75 * (middle**2).sum(axis=0) + (steepest * half).sum(axis=0)
    ends = np.minimum(ends, (far**2).sum(axis=0) / 4 - (near**2).sum(axis=0))
    exact = -0.75 * (near**2).sum(axis=0) / (far**2).sum(axis=0)
    assert (found >= exact).all()
    assert found == pytest.approx(ends / (far**2).sum(axis=0), abs=1e-8)
    assert (found > ends / (far**2).sum(axis=0)).all()
    grows = search(1.25 * W, ROWS)._falls(LOW, HIGH)
    assert (grows >= 0.5625 * (near**2).sum(axis=0) / (far**2).sum(axis=0)).all()


def test_the_edge_is_the_nearest_linear_limit():
    """Distances 0.7, 2, 1.6 and 5; what bends is apart, and what is no limit is none."""
    made = search(0.5 * W, ROWS)
    assert made.edge == pytest.approx(0.7)
    assert len(made.bent) == len(made.bent_slopes) == 1
    assert float(made.bent[0]([2.0, 3.0])) == -3
    assert np.array(made.bent_slopes[0]([2.0, 3.0])).ravel().tolist() == [3, 2]
    assert float(made.fall([2.0, 3.0])) == pytest.approx(-0.75 * 13)
    assert np.array(made.fall_slope([2.0, 3.0])).ravel() == pytest.approx([-3.0, -4.5])
    assert made.rays.shape == (2, region.RAYS + 5)
    assert np.linalg.norm(made.rays, axis=0) == pytest.approx(1)
    assert made.rays[:, -5:].T.tolist() == [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]]
    assert search(0.5 * W, [W[0] - 0.7, 3 * W[0] + 4 * W[1] - 2.5]).edge == pytest.approx(0.5)
    with pytest.raises(
        BadInput, match="at the rest p = 3, q = -1 v is not within its limits; give"
    ):
        search(0.5 * W, [W[0] - 0.7, -W[0] - 2.0, W[1] + 0.1, -W[1] - 5.0])


def test_the_nearest_counterexample_is_told_with_its_reason():
    """V rises beyond a radius of 0.5, or a limit is passed at 0.7."""
    rising = W * (0.5 + 2 * ca.sumsqr(W))  # as long as W at 0.5
    made = search(rising, ROWS)
    radius, w, why = made._beyond(0.4)
    assert radius == pytest.approx(0.5, rel=2e-4)
    assert np.linalg.norm(w) == pytest.approx(radius)
    assert why == "V does not fall"
    made = search(0.5 * W, ROWS)
    radius, w, why = made._beyond(0.65)
    assert radius == pytest.approx(0.7, rel=1e-4)
    assert w == pytest.approx([0.7, 0], abs=1e-2)
    assert why == "u above its limit"
    assert made._fails(np.array([[0.1, 0.0, 0.2], [0.1, 1.7, 5.0]])) == (1, "v above its limit")
    assert made._fails(np.array([[0.1, 0.3], [0.1, 1.5]])) is None
    assert made._fails(np.array([[0.1, -2.1], [0.1, 0.0]])) == (1, "u below its limit")
    assert made._state(np.array([0.5, -0.25])) == {"p": 3.5, "q": -1.25}


@pytest.mark.parametrize("edge", [0.013, 0.4, 1.9])
def test_the_first_radius_that_fails_is_found_by_halving(edge):
    """On 30 radii at a fixed ratio, then a thousandth of the gap between two."""
    asked = []

    def fails(radius):
        asked.append(radius)
        return radius >= edge

    found = region._first(fails, 0.01, 2.0)
    gap = 200 ** (1 / 29)
    assert edge <= found <= edge * (1 + (gap - 1) / 1000)
    assert len([a for a in asked if a != asked[0]]) <= 29 + region.HALVINGS
    assert region._first(lambda r: False, 0.01, 2.0) == 2.0
    assert region._first(lambda r: True, 0.01, 2.0) == pytest.approx(0.01)
    assert region._first(lambda r: r > 5, 3.0, 2.0) == 2.0


def test_the_law_the_step_and_the_rows_of_limits_are_in_coordinates_of_v():
    """x+ = A x + B u of two states and two controls: w = L (x - center), v as it is scaled."""
    A, B = np.array([[0.5, 0.2], [0.1, 0.7]]), np.array([[1.0, 0.5], [0.0, 2.0]])
    L = np.array([[2.0, 0.5], [0.0, 1.5]])
    made = object.__new__(region._Search)
    made.L, made.G, made.K = L, np.linalg.inv(L), np.array([[0.3, -0.1], [0.2, 0.4]])
    made.x_s, made.v_s = np.array([0.3, -0.2]), np.array([0.05, 0.1])
    x, u, d, p = (ca.SX.sym(n, k) for n, k in (("x", 2), ("u", 2), ("d", 1), ("p", 1)))
    step = ca.Function("step", [x, u, d, p], [ca.DM(A) @ x + ca.DM(B) @ u + d * p, x])
    made.s = SimpleNamespace(d=np.array([0.25]), horizon=SimpleNamespace(
        nx=2, scale=(4.0, 2.0), soft=("a", "b"), step=lambda: step,
        limits=(Soft(-1.0, 2.0, 0.5), Soft(-FAR, 3.0, 4.0)),
        model=SimpleNamespace(pack=lambda role, values: [8.0], param_values=dict),
        _outputs=lambda x, u, d, p: {"a": x[0] + 3 * u[1], "b": x[1] * d * p},
    ))  # fmt: skip
    center = np.array([1.0, 2.0])
    found = made._motion([(-3.0, 5.0), (-1.0, 1.5)], center)
    f = ca.Function("f", [found[0]], list(found[1:]))
    w = np.array([0.7, -0.4])
    at = center + made.G @ w
    v = made.v_s - made.K @ (at - made.x_s)
    u = v * [4.0, 2.0]
    after, rows = (np.array(m).ravel() for m in f(w))
    assert after == pytest.approx(L @ (A @ at + B @ u + 2.0 - center))
    a, b = at[0] + 3 * u[1], at[1] * 2.0
    assert rows == pytest.approx([
        v[0] - 5 / 4, -3 / 4 - v[0], v[1] - 1.5 / 2, -1 / 2 - v[1],
        0.5 * (a - 2), 0.5 * (-1 - a), 4 * (b - 3), -1,
    ])  # fmt: skip
