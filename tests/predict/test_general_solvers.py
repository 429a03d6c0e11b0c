"""The same plans by OSQP, qrqp and IPOPT; what is left of the conditions of optimality, by hand."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from dense_steps import NC, NU, NX, N, Numbers, solver
from programs import cart, make, wish

from slipctl import BadInput
from slipctl.predict import reference
from slipctl.predict.reference import Sparse, available, compile_callbacks, remains
from slipctl.predict.stages.horizon import Horizon

AT = {"x": 0.1, "v": 1.2, "v_ref": 2.0, "x_ref": 0.5, "load": 0.4}
PLANS: dict[str, dict[str, Any]] = {
    "hard": {"hard": {"v": (-1.0, 1.4), "x": (-1.0, 0.42)}},
    "hard and rates": {"horizon": 2, "hard": {"v": (-1.0, 1.4)}, "rates": {"F": 9.0, "B": 4.0}},
    "soft": {"soft": {"v": (-1.0, 1.3, 9.0), "x": (None, 0.3, 2.0, 5.0)}},
    "moves": {"moves": (1, 2), "soft": {"v": (None, 1.3, 9.0)}},
    "given up": {"horizon": 2, "hard": {"v": (-1.0, 0.9)}},
}
SOLVED = [("osqp", "hard and rates"), ("osqp", "given up"), ("qrqp", "moves"), ("qrqp", "soft"),
          ("ipopt", "hard"), ("ipopt", "moves")]  # fmt: skip


@cache
def by_us(what: str, iterations: int) -> dict[str, float]:
    """Outputs of the first tick of the active set."""
    return make(**{"horizon": 3, "iterations": iterations} | PLANS[what])(**AT)[1]


@pytest.mark.parametrize(("by", "what"), SOLVED)
def test_a_general_solver_gives_the_plan_of_the_active_set(by, what):
    """Of one quadratic program, or of the whole after iterations of ours."""
    ours = by_us(what, 4 if by == "ipopt" else 1)
    theirs = make(**{"horizon": 3, "solver": by} | PLANS[what])(**AT)[1]
    assert ours["status"] == (3 if what == "given up" else 0)
    for n in ("F", "B"):
        assert theirs[n] == pytest.approx(ours[n], abs=1e-4)
    assert theirs["residual"] < 1e-6


@pytest.mark.parametrize("firm", [False, True])
@pytest.mark.parametrize(
    ("tied", "rates"),
    [((False,) * N, True), ((False, True, True), False), ((True, False, True), True)],
)
def test_the_matrices_are_cost_motion_limits_and_rates(firm, tied, rates):
    """Of every stage in its order, with a slack of each row; hard rows have none where kept."""
    numbers, model = Numbers(31), solver(list(tied), rates)
    build = Sparse(
        "osqp", model.h, model.stage, model.end, list(tied), rates, 9
    )._matrices(firm)  # fmt: skip
    H, g, A, lba, uba, lbx, ubx = (np.array(ca.DM(v).full()) for v in build(*numbers.data))
    m = numbers.size
    cost, slope = numbers.cost()
    assert H[:m, :m] == pytest.approx(cost, rel=1e-14)
    assert not H[:m, m:].any()
    assert not H[m:, :m].any()
    square = [1.0, float(firm), 1.0, 1.0] * (N + 1)  # rows 1 and 2 are capped, 1 without a square
    assert H[m:, m:].tolist() == np.diag(square).tolist()
    prices = np.zeros((N + 1, NC))
    prices[:, 1:3] = numbers.w
    prices[:, 1] *= not firm
    assert g.ravel() == pytest.approx(np.r_[slope, prices.ravel()], rel=1e-14)

    def slack(k, kept):
        E = np.zeros((NC, NC * (N + 1)))
        E[:, NC * k : NC * (k + 1)] = -np.diag([1.0, float(not kept), 1, 1])
        return E

    none = np.full(NC, -np.inf)
    motion, right = numbers.motion()
    wide = np.zeros((NX, NC * (N + 1)))
    rows = [(np.hstack([motion[:NX], wide]), right[:NX], right[:NX])]
    for k in range(N):
        at = slice(NX * (k + 1), NX * (k + 2))
        rows.append((np.hstack([-motion[at], wide]), -right[at], -right[at]))
        rows.append((np.hstack([numbers.C[k] @ numbers.z(k), slack(k, firm)]), none, -numbers.c[k]))
        if rates or tied[k]:
            M, by = numbers.moved(k)
            room = 0 if tied[k] else numbers.rate[k]
            rows.append((np.hstack([M, wide[:NU]]), -by - room, -by + room))
    rows.append((np.hstack([numbers.C[N] @ numbers.z(N), slack(N, firm)]), none, -numbers.c[N]))
    wanted = [np.concatenate([r[i] for r in rows]) for i in range(3)]
    assert pytest.approx(wanted[0], rel=1e-14) == A
    assert lba.ravel() == pytest.approx(wanted[1], rel=1e-12)
    assert uba.ravel() == pytest.approx(wanted[2], rel=1e-12)
    first, last = NX * (N + 1), m
    least = np.tile([-np.inf, 0, 0, -np.inf], N + 1)
    assert lbx.ravel()[:first].tolist() == [-np.inf] * first
    assert lbx.ravel()[first:last] == pytest.approx((numbers.lo - numbers.U).ravel())
    assert lbx.ravel()[last:].tolist() == least.tolist()
    assert ubx.ravel()[first:last] == pytest.approx((numbers.hi - numbers.U).ravel())
    assert np.isinf(np.r_[ubx[:first], ubx[last:]]).all()


def test_what_is_compiled_is_so_inside_alone():
    before = dict(reference.QUIET)
    with compile_callbacks():
        assert {**before, **reference.COMPILED} == reference.QUIET
        assert reference.QUIET["jit"] is True
    assert before == reference.QUIET


def test_a_solver_that_is_not_there_is_refused():
    available("here", "osqp")
    available("here", "ipopt")
    for missing in ("mosek9", "none"):
        with pytest.raises(BadInput, match=f"here: CasADi has no {missing} here; use solver="):
            available("here", missing)
    with pytest.raises(BadInput, match="FATROP takes no rates and no moves"):
        make(solver="fatrop", rates={"F": 1.0})


def test_what_is_left_is_the_largest_of_slope_idle_multiplier_and_excess():
    """Slope 3 over 1 + 5; multiplier 4 (-6) with room 0.5 (at most 1); excess 0.75."""
    gradient, slope = ca.DM([-5, 2]), ca.DM([1, -3, 2])
    held, lo, hi = ca.DM([1, 2, 3]), ca.DM([0, -9, 2.25]), ca.DM([1.5, 2, 9])

    def left(multipliers, slope=slope, held=held):
        return float(remains(slope, gradient, held, lo, hi, ca.DM(multipliers)))

    assert left([0, 0, 0]) == 3 / 6
    assert left([4, 9, 0]) == 3 / 6  # 4 * 0.5 is less; the second is at its end
    assert left([12, 0, 0]) == 12 * 0.5 / 6
    assert left([-6, 0, 0]) == 6 * 1 / 6
    assert left([0, -60, 0]) == 60 * 1 / 6  # however far it is
    assert left([0, 0, 48]) == 48 * 1 / 6
    assert left([0, 0, -8]) == 8 * 0.75 / 6
    assert left([0, 0, 0], held=ca.DM([2.25, 2, 3])) == 0.75
    assert left([0, 0, 0], held=ca.DM([1, 2, 1.25])) == 1.0


def test_the_end_has_the_residuals_that_are_named():
    def horizon(terminal):
        scale = {"F": 4.0, "B": 2.0}
        return Horizon.of(cart, wish, ["F", "B"], terminal, {}, 3, 0.1, "rk4", 1, scale)

    assert horizon(None).last == ("cost.e", "cost.p")
    assert horizon(["p"]).last == ("cost.p",)
    assert horizon(["p", "e"]).last == ("cost.p", "cost.e")
    with pytest.raises(BadInput, match="f depends on the control, which the last stage does not"):
        horizon(["p", "f"])
    with pytest.raises(BadInput, match="the cost has no residual 'q'"):
        horizon(["q"])
