"""The active set and the interior point behind it, on random problems, against OSQP."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import osqp
import pytest
from scipy import sparse

from slipctl.predict.active_set import ActiveSet, Found
from slipctl.predict.horizon import Layout
from slipctl.predict.reference import Sparse


def problem(nx, nu, nc, N, rates, moves=None, passes=20, rescue=30, limits=((), (), ())):
    """Solver of a structure as a Function of its numbers, and the same as sparse matrices."""
    capped, square, hard = limits
    sizes = SimpleNamespace(
        nx=nx, nu=nu, nc=nc, stages=N, capped=capped, square=square, hard=hard
    )  # fmt: skip
    n = nx + nu
    stage = dense((nx, nx), (nx, nu), (nx, 1), n, (n, 1), (nc, 1), (nc, n), (len(capped), 1))
    end = dense(nx, (nx, 1), (nc, 1), (nc, nx), (len(capped), 1))
    tied = [k > 0 for m in moves or [1] * N for k in range(m)]
    qp = ActiveSet(sizes, stage, end, tied, rates, passes, rescue)
    data = qp.data()
    solve = ca.Function(
        "solve", list(data), list(qp.solve(data[0], data[1], qp.first(), *data[2:]))
    )
    return sizes, solve, Sparse("osqp", sizes, stage, end, tied, rates, passes)._matrices(), tied


def dense(*shapes):
    """Layout of full matrices; of a symmetric one its upper triangle."""
    return Layout(
        tuple(ca.Sparsity.upper(s) if isinstance(s, int) else ca.Sparsity.dense(*s) for s in shapes)
    )


def draw(rng, h, rates, tied):
    """Numbers of one problem: a plant that varies or not, weights over four decades."""
    nx, nu, nc, N = h.nx, h.nu, h.nc, h.stages
    n = nx + nu
    A, B = rng.normal(size=(nx, nx)), rng.normal(size=(nx, nu))
    A *= rng.uniform(0.5, 1.1) / max(abs(np.linalg.eigvals(A)))
    W, varies = 10 ** rng.uniform(-2, 2, size=n), rng.random() < 0.5
    C = rng.normal(size=(nc, n)) * 10 ** rng.uniform(-1, 2, size=(nc, 1))
    C[1::2] = -C[0::2]
    c = -rng.uniform(0.1, 2, size=nc) * abs(C).max(axis=1)
    columns = []
    for _ in range(N):
        if varies:
            A, B = A + 0.1 * rng.normal(size=A.shape), B + 0.2 * rng.normal(size=B.shape)
        J = np.diag(W) @ (np.eye(n) + 0.3 * rng.normal(size=(n, n)))
        b, g = 0.1 * rng.normal(size=nx), J.T @ (W * rng.normal(size=n))
        columns.append(np.concatenate([*flat(A, B), b, upper(J.T @ J), g, c, *flat(C)]))
    J = np.diag(W[:nx]) @ rng.normal(size=(nx, nx))
    end = np.concatenate([upper(J.T @ J), J.T @ rng.normal(size=nx), c, *flat(C[:, :nx])])
    lo, hi = -(10 ** rng.uniform(-2, 0.5, size=nu)), 10 ** rng.uniform(-2, 0.5, size=nu)
    rate = 10 ** rng.uniform(-2, 0.5, size=nu) if rates else np.full(nu, 1e30)
    before = rng.uniform(lo, hi)
    U, last = [], before
    for k in range(N):
        if not (tied[k] and k):
            last = np.clip(last + rng.uniform(-1, 1, nu) * np.minimum(rate, 1), lo, hi)
        U.append(last)
    bounds = np.tile(np.concatenate([lo, hi, rate])[:, None], (1, N))
    return np.array(columns).T, end, np.concatenate(U), before, bounds, rng.normal(size=nx)


def flat(*matrices):
    """Columns one below the other."""
    return [m.ravel("F") for m in matrices]


def upper(H):
    """Upper triangle, column by column."""
    return np.concatenate([H[: j + 1, j] for j in range(len(H))])


def reference(matrices, numbers):
    """OSQP's solution, polished, and what it leaves of the conditions of optimality."""
    H, g, A, *limits = (np.array(ca.DM(v)) for v in matrices(*numbers))
    lba, uba, lbx, ubx = (v.ravel() for v in limits)
    A, lo, hi = np.vstack([A, np.eye(len(H))]), np.r_[lba, lbx], np.r_[uba, ubx]
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(H)), g.ravel(), sparse.csc_matrix(A), lo, hi, verbose=False,
        eps_abs=1e-9, eps_rel=1e-9, max_iter=20000, polishing=True,
    )  # fmt: skip
    done = solver.solve(raise_error=False)
    slope = abs(H @ done.x + g.ravel() + A.T @ done.y).max() / (1 + abs(g).max())
    row = A @ done.x
    idle = np.maximum(done.y, 0) * np.minimum(hi - row, 1)
    idle += np.maximum(-done.y, 0) * np.minimum(row - lo, 1)
    return done.x, max(slope, (lo - row).max(), (row - hi).max(), idle.max())


STRUCTURES = {
    "box": (2, 1, 0, 10, False),
    "rates": (2, 1, 0, 10, True),
    "two controls": (3, 2, 2, 8, True),
    "soft": (4, 1, 4, 12, True),
    "moves": (3, 2, 2, 10, True, (1, 1, 2, 6)),
}


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_every_problem_is_solved_and_the_solution_is_that_of_osqp(structure):
    """No status 1; 1e-6 of a control's size apart, where OSQP itself is right to 1e-9."""
    h, solve, matrices, tied = problem(*structure)
    rng, compared = np.random.default_rng(3), 0
    for _ in range(25):
        numbers = draw(rng, h, structure[4], tied)
        found = Found(*(np.array(v).ravel() for v in solve(*numbers)))
        assert found.open == 0
        assert found.residual < 1e-9
        answer, left = reference(matrices, numbers)
        if left < 1e-9:
            at = h.nx * (h.stages + 1)
            assert pytest.approx(answer[at : at + found.U.size], abs=1e-6) == found.U
            compared += 1
    assert compared >= 15


def test_statuses_that_go_in_a_circle_are_seen_and_the_passes_are_bounded():
    """Without the interior point some of these never settle; with it all do, from any statuses."""
    h, alone, _, tied = problem(2, 1, 0, 10, True, passes=40, rescue=0)
    _, both, _, _ = problem(2, 1, 0, 10, True, passes=40, rescue=30)
    rng, circles = np.random.default_rng(3), 0
    for _ in range(40):
        numbers = draw(rng, h, True, tied)
        seen = Found(*(np.array(v).ravel() for v in alone(*numbers)))
        if seen.open != 0:
            circles += 1
            assert seen.open < 0  # named, not run out of passes
            assert seen.passes < 40
        found = Found(*(np.array(v).ravel() for v in both(*numbers)))
        assert found.open == 0
        assert found.passes <= 40 + 30 + 4
    assert circles > 3


def test_bounds_and_rates_that_meet_in_a_corner_are_solved():
    """One control at its bound and at its rate limit at once pins the one before it."""
    _, solve, matrices, _ = problem(1, 1, 0, 3, True)
    # x+ = x + u; 1/2 (u - 10)^2, in the middle 1/2 (u + 10)^2
    stage = [np.r_[1.0, 1.0, 0, 0, 0, 1, 0, 0] for _ in range(3)]
    for column, wish in zip(stage, (10.0, -10.0, 10.0), strict=True):
        column[3:] = [1e-3, 0, 1, 0, -wish]
    bounds = np.tile([[-1.0], [1.0], [1.5]], (1, 3))
    numbers = np.array(stage).T, np.r_[1e-3, 0.0], np.zeros(3), 0.0, bounds, 0.0
    found = Found(*(np.array(v).ravel() for v in solve(*numbers)))
    answer, _ = reference(matrices, numbers)
    assert found.open == 0
    assert pytest.approx([1.0, -0.5, 1.0], abs=1e-6) == found.U
    assert pytest.approx(answer[4:], abs=1e-8) == found.U


def cost(matrices, numbers, plan):
    """Cost of states and controls, each limit's slack as small as its row allows."""
    H, g, A, _, uba, *_ = (np.array(ca.DM(v)) for v in matrices(*numbers))
    n = plan.size
    slack = np.zeros(len(H) - n)
    for row, most in zip(A, uba.ravel(), strict=True):
        at = np.flatnonzero(row[n:])
        slack[at] = np.maximum(0, row[:n] @ plan - most)
    z = np.r_[plan, slack]
    return float(z @ H @ z / 2 + g.ravel() @ z)


@pytest.mark.parametrize("square", [False, True], ids=["linear", "both"])
@pytest.mark.parametrize("cap", [3.0, 1e3], ids=["soft", "hard"])
def test_hard_and_linear_limits_cost_no_more_than_with_osqp(cap, square):
    """The exact penalty, hard limits given up where they must: the same cost as OSQP's plan."""
    hard = (0, 1) if cap > 100 else ()
    h, solve, matrices, tied = problem(3, 1, 4, 8, True, limits=((0, 1), (square,) * 2, hard))
    rng, given_up = np.random.default_rng(5), 0
    for _ in range(25):
        D, end, *rest = draw(rng, h, True, tied)
        caps = np.full(2, cap)
        numbers = np.vstack([D, np.tile(caps[:, None], (1, 8))]), np.r_[end, caps], *rest
        found = Found(*(np.array(v).ravel() for v in solve(*numbers)))
        assert found.open == 0
        given_up += found.over > 1e-6
        ours = np.r_[found.X, found.U]
        best = cost(matrices, numbers, reference(matrices, numbers)[0][: ours.size])
        # 1e-8: products of slack and multiplier end at 1e-13 of the largest multiplier
        assert cost(matrices, numbers, ours) <= best + 1e-8 * (1 + abs(best))
    assert (given_up > 0) == bool(hard)
