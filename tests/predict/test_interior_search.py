"""How the interior point begins, how far it goes along a step, when it ends and what it tells."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from dense_steps import CAPPED, NC, NU, NX, SQUARE, N, Numbers, solver

from slipctl.predict.qp.interior import Interior, mean_of, reach_of
from slipctl.predict.qp.status import FASTER, FREE, HIGH, TIED

SOFT = (0, 3)


def made(rates=True, bounded=True, tied=(False,) * N):
    return Interior(solver(list(tied), rates, bounded))


def test_a_step_goes_as_far_as_each_value_leaves_it_a_part():
    """5 -> -5 leaves at most half a step, 3 -> 1 a whole one; of half a step 0.9 is kept."""
    values, steps = [ca.DM([3, 5]), ca.DM([2, 7])], [ca.DM([-2, -10]), ca.DM([-1, 4])]
    assert float(reach_of(values, steps, 1.0)) == 0.5
    assert float(reach_of(values, steps, 0.9)) == pytest.approx(0.45)
    assert float(reach_of(values, [ca.DM([-2, -1]), ca.DM([5, 9])], 1.0)) == 1
    assert float(reach_of(values, [ca.DM([2, 0]), ca.DM([5, 9])], 0.995)) == pytest.approx(1)
    assert float(reach_of(values, [ca.DM([-2, -4]), ca.DM([-8, 1])], 1.0)) == 0.25


def test_the_mean_product_is_that_of_all_rows():
    values = [ca.DM([1, 2, 3]), ca.DM([5, 7, 11]), ca.DM([13, 17]), ca.DM([19, 23])]
    assert float(mean_of(values)) == (5 + 14 + 33 + 13 * 19 + 17 * 23) / 5


def expected(it, numbers, point):
    """The next state, by the words of the method, with its linear solutions."""
    sizes = [NX * (N + 1), NU * N, *it._lengths, 1, 1, 1, 1]
    ends = np.cumsum([0, *sizes])
    X, V, *now, mean, was, before, steps = (point[i:j] for i, j in pairwise(ends))
    solve = it._solution()

    def solution(turn, target):
        return [np.array(v).ravel() for v in solve(*now, *turn, target, *numbers.data)]

    def reach(ahead, part):
        v, d = np.concatenate(now), np.concatenate(ahead)
        return min(1.0, part * min(-v[d < 0] / d[d < 0], default=1 / part))

    def mean_product(v):
        return (v[0] @ v[1] + v[2] @ v[3]) / (len(v[0]) + len(v[2]))

    ease = 1e-7 / (1 + now[0].max()) if it.bounded else 1e-8
    ahead = [b - a for a, b in zip(now, solution([0 * now[0], 0 * now[2]], [0, ease])[2:],
                                   strict=True)]  # fmt: skip
    whole = reach(ahead, 1.0)
    tried = mean_product([v + whole * d for v, d in zip(now, ahead, strict=True)])
    share = min(1.0, whole / 0.3)
    turn = [share * ahead[0] * ahead[1], share * ahead[2] * ahead[3]]
    target = float(mean[0] * (tried / mean[0]) ** 3)
    Xn, Vn, *after = solution(turn, [target, ease])
    ahead = [b - a for a, b in zip(now, after, strict=True)]
    part = reach(ahead, 0.995)
    nxt = [v + part * d for v, d in zip(now, ahead, strict=True)]
    dz, z = np.r_[Xn - X, Vn - V], np.r_[X, V]
    moved = abs(dz).max()
    if not it.bounded:
        moved /= 1 + abs(z).max()
    left = mean_product(nxt)
    residual = left / (1 + nxt[0].max())
    short = (1 - part) * moved
    still = residual < (1e-11 if it.bounded else 1e-6) and left > mean[0] / 2 and moved < 1e-5
    near = short < 1e-6 and (not it.bounded or ease * abs(ahead[0]).max() < 1e-8)
    solved = (residual < 1e-15 or still) and near
    open_ = 0 if solved else 0.5 if residual < 1e-13 and near else 1
    nearer = residual < before[0]
    worse = was[0] == 0.5 and not (nearer and open_ < 1)
    if not it.bounded:
        worse |= bool(before[0] < 1e-8 and (not nearer or part < 0.3))
    if worse:
        return np.r_[point[:-3], 0, before, steps + 1], share
    return np.r_[z + part * dz, np.concatenate(nxt), left, open_, residual, steps + 1], share


@pytest.mark.parametrize(
    ("rates", "bounded", "tied", "seed"),
    [(True, True, (False,) * 3, 5), (False, True, (False, True, False), 8),
     (False, False, (False,) * 3, 9)],
)  # fmt: skip
def test_each_step_is_that_of_the_method_and_the_last_is_the_solution(rates, bounded, tied, seed):
    """Residuals fall to nothing, and what holds the plan at the end balances its cost."""
    numbers = Numbers(seed)
    it = made(rates, bounded, tied)
    step = it._step()
    data = [ca.MX(ca.DM(v)) for v in numbers.data]
    begun = it._begun(ca.MX.zeros(NX * (N + 1)), ca.MX.zeros(NU * N), tuple(data))
    point = np.array(ca.evalf(begun)).ravel()
    shares, residuals = [], []
    for k in range(40):
        wanted, share = expected(it, numbers, point)
        point = np.array(step(point, *numbers.data)).ravel()
        assert point[-1] == k + 1
        assert point[-3] == wanted[-3]
        assert point == pytest.approx(wanted, rel=1e-6, abs=1e-9)
        shares.append(share)
        residuals.append(point[-2])
        if point[-3] <= 0:
            break
    assert point[-3] == 0
    assert residuals[-1] < 1e-9 < residuals[0]
    assert max(shares) == 1


def test_a_step_to_no_number_is_not_taken_and_is_told():
    """Open is -2; the plan and the multipliers stay."""
    numbers, it = Numbers(5), made()
    point = np.full(it._step().size1_in(0), 1.5)
    at = NX * (N + 1) + NU * N
    point[at + 7], point[-4:] = 1e16, [3.0, 1.0, 0.25, 6.0]
    point[at + 11] = 3e16
    found = np.array(it._step()(point, *numbers.data)).ravel()
    assert found[:-3] == pytest.approx(point[:-3])
    assert found[-3:].tolist() == [-2, 1, 7]


def test_a_state_that_is_near_enough_is_kept_where_the_next_is_not_nearer():
    """It was marked 0.5; a worse residual, or one that is open again, ends it as it was."""
    numbers, it = Numbers(5), made()
    point = np.linspace(0.5, 1.5, it._step().size1_in(0))
    for before in (1e-20, 1e9):
        point[-4:] = [1.2, 0.5, before, 6.0]
        found = np.array(it._step()(point, *numbers.data)).ravel()
        assert found.tolist() == [*point[:-3], 0, before, 7]


# ---- where it begins ---------------------------------------------------------------------------


def rows_of(it, numbers, y):
    """Excess of the rows of each stage at a plan, and the weights of the capped ones."""
    found = []
    for k in range(N + 1):
        r = []
        if k < N:
            v = numbers.U[k] + numbers.v(k) @ y
            for i in it.bounded:
                r += [v[i] - numbers.hi[k, i], numbers.lo[k, i] - v[i]]
            M, m = numbers.moved(k)
            for i in it.rated:
                moved = M[i] @ y + m[i]
                r += [moved - numbers.rate[k, i], -moved - numbers.rate[k, i]]
        found.append(np.r_[r, numbers.c[k] + numbers.C[k] @ numbers.z(k) @ y])
    return found


@pytest.mark.parametrize(("rates", "bounded"), [(True, True), (False, True), (True, False)])
@pytest.mark.parametrize("large", ["nothing", "gradient", "soft row", "capped row"])
def test_it_begins_with_equal_products_and_with_rows_that_hold(rates, bounded, large):
    """Of the largest of 1, the gradient, soft rows, and a tenth of the price of priced ones."""
    numbers, it = Numbers(11), made(rates, bounded)
    numbers.g *= 0.1
    numbers.c *= 0.2
    mean, y = 1.0, np.random.default_rng(1).uniform(-0.1, 0.1, numbers.size)
    if large == "gradient":
        numbers.g[1, 2], mean = -4.0, 4.0
    if large == "soft row":
        numbers.c[1, 3] = 9.0
        mean = rows_of(it, numbers, y)[1][-1]
    if large == "capped row":
        numbers.c[2, 1] = 40.0
        mean = 0.1 * numbers.w[2, 0] * rows_of(it, numbers, y)[2][-3]
    data = tuple(ca.MX(ca.DM(v)) for v in numbers.data)
    at = NX * (N + 1)
    state = np.array(ca.evalf(it._begun(ca.MX(y[:at]), ca.MX(y[at:]), data))).ravel()
    ends = np.cumsum([0, at, NU * N, *it._lengths, 1, 1, 1, 1])
    X, V, l, s, t, n, *rest = (state[i:j] for i, j in pairwise(ends))
    assert np.r_[X, V] == pytest.approx(y)
    squares = np.tile(SQUARE, N + 1) * t**2
    assert l * s == pytest.approx(mean)
    assert t * n == pytest.approx(mean + squares)
    assert np.concatenate(rest) == pytest.approx(
        [mean + squares.sum() / (len(l) + len(t)), 1, 1, 0])  # fmt: skip
    assert min(map(min, (l, s, t, n))) > 0
    i = j = 0
    for k, r in enumerate(rows_of(it, numbers, y)):
        firm = len(r) - NC
        assert s[i : i + firm] == pytest.approx(np.maximum(-r[:firm], 0.1))
        soft = [firm + a for a in SOFT]
        assert r[soft] + s[i + np.array(soft)] == pytest.approx(l[i + np.array(soft)])
        for a, row in enumerate(CAPPED):
            at = i + firm + row
            assert r[firm + row] + s[at] == pytest.approx(t[j])
            assert l[at] + n[j] == pytest.approx(numbers.w[k, a] + SQUARE[a] * t[j])
            j += 1
        i += len(r)
    assert (i, j) == (len(l), len(t))


# ---- what it tells -----------------------------------------------------------------------------


@pytest.mark.parametrize("tied", [(False,) * 3, (False, True, False)])
@pytest.mark.parametrize(("rates", "bounded"), [(True, True), (False, True), (False, False)])
def test_statuses_are_where_multipliers_exceed_slacks(rates, bounded, tied):
    """The larger of two bounds, or of a rate where it weighs more; of capped rows none."""
    it = made(rates, bounded, tied)
    rng = np.random.default_rng(2)
    stages, last = rng.uniform(0, 1, (2 * it.m + 4, N)), rng.uniform(0, 1, 2 * NC + 4)
    found = np.array(ca.evalf(it._statuses(ca.MX(ca.DM(stages)), ca.MX(ca.DM(last))))).ravel()
    wanted = []
    for k in range(N):
        l, s = stages[: it.m, k], stages[it.m : 2 * it.m, k]
        on = np.where(l > s, l, 0.0)
        for i in range(NU):
            high, low, up, down = 0.0, 0.0, 0.0, 0.0
            if bounded:
                high, low = on[2 * i], on[2 * i + 1]
            if rates:
                up, down = on[2 * NU + 2 * i], on[2 * NU + 2 * i + 1]
            most = max(high, low, up, down)
            which = FREE if most == 0 else {high: HIGH, low: -HIGH, up: FASTER, down: -FASTER}[most]
            wanted.append(TIED if tied[k] else which)
        wanted += [float(i in SOFT and on[it.m - NC + i] > 0) for i in range(NC)]
    wanted += [float(i in SOFT and last[i] > last[NC + i]) for i in range(NC)]
    assert found.tolist() == wanted
    if bounded and not any(tied):
        assert {-1.0, 0.0, 1.0} <= set(wanted)


def test_what_is_given_up_is_the_largest_excess_of_a_hard_row():
    """t less s of row 1; that of row 2, which is soft with a price, does not count."""
    it = made()
    s, t = np.arange(1.0, it.m * N + NC + 1), np.zeros((N + 1, 2))
    hard = [it.m - NC + 1 + it.m * k for k in range(N)] + [it.m * N + 1]
    for k, row in enumerate(hard):
        s[row], t[k] = 0.25 * k, (0.5 * k + (k == 2), 99.0)
    assert float(ca.evalf(it._given_up(ca.MX(ca.DM(s)), ca.MX(ca.DM(t.ravel()))))) == 1.5
    t[3, 0] = 7
    assert float(ca.evalf(it._given_up(ca.MX(ca.DM(s)), ca.MX(ca.DM(t.ravel()))))) == 6.25
    t[:, 0] = -1
    assert float(ca.evalf(it._given_up(ca.MX(ca.DM(s)), ca.MX(ca.DM(t.ravel()))))) == 0
