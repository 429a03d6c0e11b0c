"""The active set and the interior point behind it, on random problems, against OSQP."""

import casadi as ca
import numpy as np
import pytest

from bench.programs import (
    MORE,
    RIGHT,
    STRUCTURES,
    by_qrqp,
    draw,
    problem,
    reference,
)
from slipctl.predict.qp.active_set import Found


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_every_problem_is_solved_and_the_solution_is_that_of_osqp_and_qrqp(structure):
    """No status 1 in 200; at most 1e-6 from OSQP and qrqp where they are right to 1e-10."""
    h, solve, matrices, tied = problem(*structure)
    rng, compared, third = np.random.default_rng(3), 0, by_qrqp(matrices)
    for _ in range(40):
        numbers = draw(rng, h, structure[4], tied)
        found = Found(*(np.array(v).ravel() for v in solve(*numbers)))
        assert found.open == 0
        assert found.residual < 1e-9
        for answer, left in (reference(matrices, numbers), third(numbers)):
            if left < RIGHT:
                at = h.nx * (h.stages + 1)
                assert pytest.approx(answer[at : at + found.U.size], abs=1e-6) == found.U
                compared += 1
    assert compared >= 25  # qrqp gives up on half of those with rates


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


def test_a_problem_that_runs_away_is_solved_in_more_than_30_steps():
    """Its states grow to 1e9: OSQP and qrqp give up on it; it takes 38 steps, of 60 allowed."""
    structure = MORE["long"]
    h, solve, _, tied = problem(*structure)
    rng = np.random.default_rng(106)
    for _ in range(94):
        draw(rng, h, True, tied)
    found = Found(*(np.array(v).ravel() for v in solve(*draw(rng, h, True, tied))))
    assert found.open == 0
    assert found.residual < 1e-9


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
    h, solve, matrices, tied = problem(
        3, 1, 4, 8, True, rescue=60, limits=((0, 1), (square,) * 2, hard)
    )
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
