"""A pass of the active set: a plan with given statuses by dense algebra, and one stage by hand."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from dense_steps import NC, NU, NX, N, Numbers, solver

from slipctl.predict.qp.active_set import ActiveSet, Found
from slipctl.predict.qp.status import FASTER, FREE, HIGH, NONE, TIED

SOFT = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [1, 0, 0, 1], [0, 0, 0, 1]], dtype=float)
WHOLE: dict[str, tuple[list[list[float]], list[bool], bool]] = {
    "free": ([[FREE] * 2] * 3, [False] * 3, False),
    "at bounds": ([[FREE, HIGH], [-HIGH, FREE], [HIGH, -HIGH]], [False] * 3, False),
    "bounds and rates": ([[FASTER, HIGH], [FREE, -FASTER], [-HIGH, FREE]], [False] * 3, True),
    "rates in a row": ([[FREE, -FASTER], [FASTER, -FASTER], [FASTER, FREE]], [False] * 3, True),
    "ties": ([[FREE, -HIGH], [TIED, TIED], [FREE, FASTER]], [False, True, False], True),
    "ties of bounds": ([[HIGH, FREE], [TIED, TIED], [TIED, TIED]], [False, True, True], False),
}


def by_dense_algebra(numbers: Numbers, statuses: list[list[float]]) -> tuple[np.ndarray, ...]:
    """Plan y with controls held and rows counted, and the slope along each control that is held."""
    H, g = numbers.cost()
    for k in range(N + 1):
        C = numbers.C[k] @ numbers.z(k)
        H = H + C.T @ np.diag(SOFT[k]) @ C
        g = g + C.T @ (SOFT[k] * numbers.c[k])
    A, b = numbers.motion()
    first, held = len(A), []
    for k, i in np.ndindex(N, NU):
        status = statuses[k][i]
        M, m = numbers.moved(k)
        if abs(status) >= FASTER:
            by = 0 if status == TIED else np.sign(status) * numbers.rate[k, i]
            row, right = M[i], by - m[i]
        else:
            end = numbers.hi if status > 0 else numbers.lo
            row, right = numbers.v(k)[i], end[k, i] - numbers.U[k, i]
        if status != FREE:
            A, b = np.vstack([A, row]), np.r_[b, right]
            held.append((k, i))
    nothing = np.zeros((len(A), len(A)))
    found = np.linalg.solve(np.block([[H, A.T], [A, nothing]]), np.r_[-g, b])
    slopes = np.zeros((N, NU))
    for place, slope in zip(held, -found[numbers.size + first :], strict=True):
        slopes[place] = slope
    return found[: numbers.size], slopes


@pytest.mark.parametrize("what", [*WHOLE])
def test_a_pass_solves_the_problem_of_its_statuses(what):
    """Far bounds do not cut; a held control is freed where its slope points inwards."""
    statuses, tied, rates = WHOLE[what]
    numbers = Numbers(21)
    at = np.abs(np.array(statuses))
    # what is free or follows is far from its bounds, what is not at its rate far from that
    numbers.lo[at != HIGH] -= 50
    numbers.hi[at != HIGH] += 50
    numbers.rate[at != FASTER] += 200
    if what == "free":
        numbers.c[:, 1:3] -= 90
    qp = solver(tied, rates)
    S = np.r_[np.hstack([statuses, SOFT[:N]]).ravel(), SOFT[N]]
    z = np.r_[np.zeros(numbers.size), S, np.full(len(S), NONE), 1, 0, 0, 4]
    ends = np.cumsum([0, *qp.sizes])
    column = np.array(qp._once(z, *numbers.data)).ravel()
    found = Found(*(column[i:j] for i, j in pairwise(ends)))
    y, slopes = by_dense_algebra(numbers, statuses)
    assert np.r_[found.X, found.U] == pytest.approx(y, rel=1e-8, abs=1e-9)
    wanted, over, flipped = [], 0.0, 0.0
    for k in range(N + 1):
        for i in range(NU) if k < N else ():
            status = statuses[k][i]
            inwards = status not in (FREE, TIED) and status * slopes[k, i] > 0
            wanted.append(FREE if inwards else status)
        r = numbers.c[k] + numbers.C[k] @ numbers.z(k) @ y
        over = max(over, r[1], r[2])
        wanted += [float(r[0] > 0), 0, 0, float(r[3] > 0)]
        slope = sum(abs(r[i] * numbers.C[k, i]) for i in (0, 3) if (r[i] > 0) != SOFT[k, i])
        flipped = max(flipped, np.max((slope / (1 + abs(numbers.g[k])))[: None if k < N else NX]))
    assert pytest.approx(wanted) == found.S
    assert found.mark.tolist() == [NONE] * len(S)  # a fifth pass leaves none
    assert found.passes == 5
    assert found.open == (1 if (found.S != S).any() else -1)
    assert found.residual >= max(over, flipped) * (1 - 1e-9)
    if what == "free":
        assert found.residual == pytest.approx(flipped)
    else:
        assert over > 0.1
    assert found.over == 0


def test_a_pass_that_comes_back_is_told_and_marks_are_left_at_powers_of_two():
    """-1 where the statuses are those of a mark; the mark is the new one after 1, 2, 4 and 128."""
    statuses, tied, rates = WHOLE["at bounds"]
    numbers, qp = Numbers(21), solver(tied, rates)
    S = np.r_[np.hstack([statuses, SOFT[:N]]).ravel(), SOFT[N]]
    ends = np.cumsum([0, *qp.sizes])

    def once(mark, passes):
        z = np.r_[np.zeros(numbers.size), S, mark, 1, 0, 0, passes]
        column = np.array(qp._once(z, *numbers.data)).ravel()
        return Found(*(column[i:j] for i, j in pairwise(ends)))

    after = once(S, 2)
    assert (after.open, after.passes) == (1, 3)
    assert after.mark.tolist() == S.tolist()
    assert (after.S != S).any()
    for passes in (0, 1, 3, 127):
        assert once(S, passes).mark.tolist() == after.S.tolist()
    for passes in (2, 4, 128, 255):
        assert once(S, passes).mark.tolist() == S.tolist()
    assert once(after.S, 2).open == -1


# ---- one stage of the roll -----------------------------------------------------------------------

QVV, QV = 2.0, -4.0
CASES: dict[str, tuple[float, float, dict[str, float], float, float, float]] = {
    # status, wanted step, limits -> step, status, what it leaves of the conditions
    "free inside": (FREE, 0.5, {}, 0.5, FREE, 3 / 5),
    "free beyond the bound": (FREE, 3.5, {}, 2.0, HIGH, 2 * 1.5 / 5),
    "free below the bound": (FREE, -3.5, {}, -2.0, -HIGH, 2 * 1.5 / 5 + 8 / 5),
    "free, faster than it may": (FREE, 3.5, {"rate": 1.0}, 1.5, FASTER, 2 * 2.0 / 5),
    "free, slower than it may": (FREE, -3.5, {"rate": 1.0}, -0.5, -FASTER, 6 / 5 + 5 / 5),
    "held high, pressed": (HIGH, 1.5, {"hi": 1.5}, 1.5, HIGH, 0.0),
    "held high, pulled back": (HIGH, 2.5, {"hi": 2.5}, 2.5, FREE, 1 / 5),
    "held low, pulled up": (-HIGH, 1.5, {"lo": 1.5}, 1.5, FREE, 1 / 5),
    "held low, pressed": (-HIGH, 2.5, {"lo": 2.5, "hi": 9.0}, 2.5, -HIGH, 0.0),
    "at its rate, pressed": (FASTER, 1.5, {"rate": 1.0}, 1.5, FASTER, 0.0),
    "at its rate, behind the bound": (FASTER, 1.0, {"rate": 9.0, "hi": 1.0}, 1.0, HIGH, 0.0),
    "tied": (TIED, 1.0, {}, 1.0, TIED, 0.0),
}


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("what", [*CASES])
def test_a_control_of_a_stage_is_cut_and_gets_a_status(what, place):
    """By hand: its slope is 2 step - 4, the step before was 0.5, and its bounds are 2 away."""
    status, wanted, limits, step, following, left = CASES[what]
    qp = solver([False, True, False], True)
    numbers = Numbers(2)
    u = np.array([0.3, 0.3])
    earlier, ahead = np.array([0.3, 0.3]), np.zeros(NU)
    ahead[place] = 0.5
    given = {"lo": -2.0, "hi": 2.0, "rate": 50.0} | limits
    lo, hi, rate = np.full(NU, -9.0), np.full(NU, 9.0), np.full(NU, 50.0)
    lo[place], hi[place] = given["lo"] + 0.3, given["hi"] + 0.3
    rate[place] = given["rate"]
    z = np.r_[[0.2, -0.7], ahead]
    K, Qvz = np.zeros((NU, qp.nz)), np.zeros((NU, qp.nz))
    K[place, :2], Qvz[place, :2] = (0.6, 0.1), (1.5, -0.5)
    k, qv, Qvv = np.zeros(NU), np.zeros(NU), np.diag([7.0, 7.0])
    k[place] = wanted - K[place] @ z
    Qvv[place, place], qv[place] = QVV, QV - Qvz[place] @ z
    size = 1 + abs(qv[place])
    both = np.zeros(NU)
    both[place] = step
    r = numbers.c[1] + numbers.C[1] @ np.r_[z[:2], both]
    counts = np.array([r[0] > 0, 0, 0, r[3] > 0], dtype=float)
    if place:  # then both rows change
        counts[[0, 3]] = 1 - counts[[0, 3]]
    statuses = np.r_[np.zeros(NU), counts]
    statuses[place] = status
    column = numbers.data[0][:, 1]
    gains = np.r_[K.ravel("F"), k, Qvz.ravel("F"), Qvv.ravel("F"), qv]
    found = qp._forward(z, gains, column, statuses, u, earlier, np.r_[lo, hi, rate])
    after, x, dv, told, residual, over = (np.array(v).ravel() for v in found)
    assert dv == pytest.approx(both)
    assert told[:NU].tolist() == [following * (j == place) for j in range(NU)]
    assert x == pytest.approx(numbers.A[1] @ z[:2] + numbers.B[1] @ both + numbers.b[1])
    assert after == pytest.approx(np.r_[x, both])
    assert told[NU:].tolist() == [float(r[0] > 0), 0, 0, float(r[3] > 0)]
    assert over == pytest.approx(max(0, r[1], r[2]))
    flipped = sum(abs(r[i] * numbers.C[1, i]) for i in (0, 3) if (r[i] > 0) != counts[i])
    rows = np.max(flipped / (1 + abs(numbers.g[1])))
    assert (rows > 0) == (place == 1)
    assert residual == pytest.approx(max(left * 5 / size, rows))


# ---- small ones ----------------------------------------------------------------------------------


def test_statuses_move_with_the_plan_and_ties_stay():
    """The last stage twice, or stages that are named; a tie that leaves its place is free."""
    qp = solver([False, True, False], True)
    m = NU + NC
    S = np.r_[np.arange(1.0, 3 * m + 1), [91, 92, 93, 94]]
    S[[m, m + 1, 2 * m + 1]] = TIED, TIED, -FASTER
    stages = S[: 3 * m].reshape(3, m)

    def told(places):
        return np.array(ca.evalf(qp.shifted(ca.MX(ca.DM(S)), places))).ravel()

    for places, order in ((None, [1, 2, 2]), ([2, 0, 1], [2, 0, 1])):
        wanted = stages[order].copy()
        wanted[wanted == TIED] = np.where(np.arange((wanted == TIED).sum()) < 0, TIED, FREE)
        wanted[0, 2] = stages[order[0], 2]
        wanted[:, 2:] = stages[order][:, 2:]
        wanted[1, :2] = TIED
        assert told(places).tolist() == [*wanted.ravel(), 91, 92, 93, 94]
    assert np.array(ca.evalf(qp.first())).ravel().tolist() == [
        *[0] * m, TIED, TIED, *[0] * (NC + m + NC)]  # fmt: skip


def test_controls_before_a_stage_of_a_plan_that_branches_are_those_of_the_first_scenario():
    """Two of three stages share; the third follows what each scenario did in the second."""
    qp = object.__new__(ActiveSet)
    qp.branches = True
    qp.h = type("H", (), {"leaders": [0, 1, 0, 1], "shared": 2, "stages": 4})
    u, before = np.arange(1.0, 17).reshape(4, 4).T, np.array([21.0, 22, 23, 24])
    found = np.array(qp.earlier(ca.DM(before), ca.DM(u)))
    wanted = [[21, 22, 21, 22], [1, 2, 1, 2], [5, 6, 5, 6], [9, 10, 11, 12]]
    assert found.T.tolist() == wanted
    dv = ca.DM([1, 2, 3, 4])
    assert np.array(qp.kept(dv, ca.DM([9, 0]))).ravel().tolist() == [1, 2, 1, 2]
    assert np.array(qp.kept(dv, ca.DM([0, 1]))).ravel().tolist() == [1, 2, 3, 4]
    marked = np.array(qp._marked(ca.DM.ones(2, 4)))
    assert marked.tolist() == [[1] * 4, [1] * 4, [0, 0, 1, 1]]
    qp.branches = False
    found = np.array(qp.earlier(ca.DM(before), ca.DM(u)))
    assert found.T.tolist() == [before.tolist(), *u.T[:3].tolist()]
    assert np.array(qp.kept(dv, ca.DM([9, 0]))).ravel().tolist() == [1, 2, 3, 4]
