"""Small programs with firm, soft, priced and hard rows: the plan is judged by its multipliers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from dense_steps import NC, NU, NX, N, Numbers, solver
from test_quadratic_programs import optimal

from slipctl.predict.qp.active_set import Found
from slipctl.predict.reference import Sparse

CASES = {
    "boxes": ((False,) * N, False), "rates": ((False,) * N, True),
    "moves": ((False, True, False), True), "moves of boxes": ((False, False, True), False),
}  # fmt: skip


@pytest.mark.parametrize("what", [*CASES])
@pytest.mark.parametrize("passes", [1, 20])
def test_a_plan_balances_its_cost(what, passes):
    """From one pass by the interior point, or by the active set; the hard row where it may be.

    Each control is within its bounds and rates, and ties hold, whatever is given up.
    """
    tied, rates = CASES[what]
    inside = 0
    model = solver(list(tied), rates, passes=passes, rescue=60)
    general = Sparse("osqp", model.h, model.stage, model.end, list(tied), rates, 9)
    matrices = general._matrices()
    data = model.data()
    f = ca.Function("f", list(data), list(model.solve(*data[:2], model.first(), *data[2:])))
    for seed in (41, 43):
        numbers = Numbers(seed, caps=(1e3, 5.0))
        numbers.lo, numbers.hi = numbers.lo - 0.5, numbers.hi + 0.5
        found = Found(*(np.array(v).ravel() for v in f(*numbers.data)))
        assert found.open == 0
        inside += found.passes > passes
        y = np.r_[found.X, found.U]
        assert optimal(matrices, numbers.data, y) < 1e-6
        A, b = numbers.motion()
        assert A @ y == pytest.approx(b, abs=1e-9)
        most = 0.0
        for k in range(N):
            v = numbers.v(k) @ y + numbers.U[k]
            assert (v >= numbers.lo[k] - 1e-9).all()
            assert (v <= numbers.hi[k] + 1e-9).all()
            M, m = numbers.moved(k)
            moved = M @ y + m
            assert not tied[k] or abs(moved).max() < 1e-9
            assert not rates or (abs(moved) <= numbers.rate[k] + 1e-9).all()
        for k in range(N + 1):
            row = numbers.c[k] + numbers.C[k] @ numbers.z(k) @ y
            most = max(most, row[1])
        if found.over > 1e-6:
            assert found.over == pytest.approx(most, rel=1e-6)
        assert most > 1e-6 or found.over < 1e-6
        assert found.S.size == N * (NU + NC) + NC
    assert inside >= (2 if passes == 1 else 0)
    assert found.X.size == NX * (N + 1)
