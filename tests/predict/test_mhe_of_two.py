"""A window of two measurements and three unknowns, against all samples at once."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from slipctl import Input, Output, Param, State, flow, mhe
from slipctl.predict.trials import Driver

H = 0.2
A = np.array([[-0.4, 0.7, 0.0], [-0.3, -0.2, 1.0], [0.0, 0.0, 0.0]])
B = np.array([[1.0, 0.0], [0.0, 0.5], [0.0, 0.0]])
C, D = np.array([[0.0, 1.0, 0.0], [1.0, -2.0, 0.6]]), np.array([[0.0, 0.0], [0.3, -0.1]])
ARRIVAL = {"a": 0.5, "b": 0.2, "d": 2.0}
DRIFT = {"a": 0.03, "b": 0.01, "d": 0.5}
NOISE = {"b": 0.04, "s": 0.09}
START = {"a": 0.3, "b": -0.2, "d": 0.1}


@flow(s=Output("1", "sum"))
def pair(
    a=State("1", 0.0, "first"), b=State("1", 0.0, "second"), F=Input("1/s", "drives the first"),
    G=Input("1/s", "drives the second"), d=Input("1/s", "load", value=0.0),
    k=Param("1/s", 0.7, "from the second to the first"),
):  # fmt: skip
    """Two states that drive each other."""
    b_next = -0.3 * a - 0.2 * b + 0.5 * G + d
    return dict(a=-0.4 * a + k * b + F, b=b_next), dict(s=a - 2 * b + 0.6 * d + 0.3 * F - 0.1 * G)


def make(**options):
    given = {"drift": DRIFT, "start": START, "period": H, "samples": 4, "substeps": 2} | options
    return mhe(pair, ("b", "s"), NOISE, ARRIVAL, **given)


def motion():
    """(M, N) of a tick, x+ = M x + N u: two steps of Runge and Kutta, of a linear flow."""
    h, I = H / 2, np.eye(3)
    Z = h * A
    M = I + Z @ (I + Z / 2 @ (I + Z / 3 @ (I + Z / 4)))
    N = h * (I + Z / 2 @ (I + Z / 3 @ (I + Z / 4))) @ B
    return M @ M, M @ N + N


def at_once(Y, seen, U, ends=None):
    """Last state and sum of squares of the best motion through all samples, and ends it is at."""
    n, (M, N) = len(Y), motion()
    rows, right = [], []

    def add(k, block, before, value, deviation):
        row = np.zeros((len(value), 3 * n))
        row[:, 3 * k : 3 * k + 3] = block
        if before is not None:
            row[:, 3 * k - 3 : 3 * k] = before
        rows.append(row / deviation[:, None])
        right.append(value / deviation)

    add(0, np.eye(3), None, np.array([*START.values()]), np.sqrt([*ARRIVAL.values()]))
    for k in range(n):
        there = np.flatnonzero(seen[k])
        add(k, C[there], None, (Y[k] - D @ U[k])[there], np.sqrt([*NOISE.values()])[there])
        if k:
            add(k, np.eye(3), -M, N @ U[k - 1], np.sqrt(np.array([*DRIFT.values()]) * H))
    J, r = np.vstack(rows), np.concatenate(right)
    x, pressed = np.linalg.lstsq(J, r, rcond=None)[0], 0
    if ends:
        x = lsq_linear(J, r, ends, method="bvls", tol=1e-14).x
        pressed = sum(np.isclose(x, e, atol=1e-9).sum() for e in ends)
    return x[-3:], float(((J @ x - r) ** 2).sum()), pressed


def told(block, rows):
    """Outputs of all ticks by name."""
    tick = Driver(block, compile=False)
    return [dict(zip(block.outputs, tick(*(row[n] for n in block.inputs)), strict=True))
            for row in rows]  # fmt: skip


def test_two_measurements_of_which_some_samples_are_missing():
    """The window of 4 is that of all 9: what it leaves is in the arrival."""
    rng = np.random.default_rng(8)
    Y, U = rng.normal(size=(9, 2)), rng.normal(size=(9, 2))
    seen = np.array([[1, 1], [1, 0], [0, 1], [1, 1], [0, 0], [1, 1], [0, 1], [1, 0], [1, 1]])
    block = make()
    assert list(block.inputs) == ["b", "s", "seen_b", "seen_s", "F", "G"]
    rows = [
        dict(b=Y[k, 0] if seen[k, 0] else 1e6, s=Y[k, 1] if seen[k, 1] else -1e6,
             seen_b=seen[k, 0], seen_s=seen[k, 1], F=U[k, 0], G=U[k, 1])
        for k in range(9)
    ]  # fmt: skip
    for k, found in enumerate(told(block, rows)):
        x, squares, _ = at_once(Y[: k + 1], seen[: k + 1], U[: k + 1])
        assert [found[n] for n in "abd"] == pytest.approx(x, abs=1e-7)
        if k < 4:
            count = max(1, seen[: k + 1].sum())
            assert found["misfit"] * count == pytest.approx(squares, abs=1e-7)
        assert found["status"] == 0


def test_one_of_two_comes_late():
    """s of ticks 1 and 4 comes at 3 and 5; b comes in time. One is asked 2.4 ticks late: 2."""
    rng = np.random.default_rng(9)
    Y, U = rng.normal(size=(8, 2)), rng.normal(size=(8, 2))
    comes = {0: 0, 2: 2, 3: 1, 5: 4, 6: 6}  # tick: when s was taken
    block = make(late="s", samples=5)
    assert list(block.inputs) == ["b", "s", "seen_b", "seen_s", "age_s", "F", "G"]
    rows = []
    for k in range(8):
        taken = comes.get(k, k)
        age = 2.4 if k == 3 else k - taken
        rows.append(dict(b=Y[k, 0], s=Y[taken, 1], seen_b=float(k != 5), seen_s=float(k in comes),
                         age_s=age, F=U[k, 0], G=U[k, 1]))  # fmt: skip
    for k, found in enumerate(told(block, rows)):
        seen = np.ones((k + 1, 2))
        for j in range(k + 1):
            seen[j] = j != 5, any(comes.get(i) == j for i in range(k + 1))
        x, squares, _ = at_once(Y[: k + 1], seen, U[: k + 1])
        assert [found[n] for n in "abd"] == pytest.approx(x, abs=1e-7)
        if k < 5:
            assert found["misfit"] * seen.sum() == pytest.approx(squares, abs=1e-7)


def test_limits_of_two_unknowns_and_of_an_output():
    """At every sample of the window: scipy's bounded least squares; s is far from its limit."""
    rng = np.random.default_rng(10)
    Y, U = rng.normal(size=(4, 2)), rng.normal(size=(4, 2))
    rows = [dict(b=y[0], s=y[1], seen_b=1, seen_s=1, F=u[0], G=u[1])
            for y, u in zip(Y, U, strict=True)]  # fmt: skip
    limits = {"s": (-70.0, 60.0), "d": (0.4, 1.1), "a": (-0.9, 30.0)}
    lo, hi = np.tile([-0.9, -np.inf, 0.4], 4), np.tile([30.0, np.inf, 1.1], 4)
    x, squares, pressed = at_once(Y, np.ones((4, 2)), U, (lo, hi))
    assert pressed >= 2
    found = told(make(limits=limits), rows)[-1]
    assert [found[n] for n in "abd"] == pytest.approx(x, abs=2e-5)
    assert found["misfit"] * 8 == pytest.approx(squares, rel=1e-5)
    assert found["status"] == 0
