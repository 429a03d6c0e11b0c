"""Steps of the interior point: each against dense algebra of the equations that it stands for."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from dense_steps import CAPPED, NC, NU, SQUARE, N, Numbers, solver

from slipctl.predict.qp.interior import Interior

NONE = 1e30


def limits(numbers: Numbers, rates: bool, bounded: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """(e, R) of the rows of each stage over y, as the limits read: r = e + R y <= 0."""
    found = []
    for k in range(N + 1):
        e, R = [], []
        if k < N:
            v, u = numbers.v(k), numbers.U[k]
            M, m = numbers.moved(k)
            for i in range(NU) if bounded else ():
                e += [max(u[i] - numbers.hi[k, i], -1e3), max(numbers.lo[k, i] - u[i], -1e3)]
                R += [v[i], -v[i]]
            for i in range(NU) if rates else ():
                rate = min(numbers.rate[k, i], 1e3)
                e += [m[i] - rate, -m[i] - rate]
                R += [M[i], -M[i]]
        e += [max(c, -1e6) for c in numbers.c[k]]
        R += list(numbers.C[k] @ numbers.z(k))
        found.append((np.array(e), np.array(R)))
    return found


def newton(numbers, rates, bounded, tied, now, mean, ease):
    """(y, l, s, t, n) of a whole step, by one dense system; ``now`` is (l, s, t, n, c1, c2)."""
    l, s, t, n, c1, c2 = now
    rows = limits(numbers, rates, bounded)
    e, R = np.concatenate([a for a, _ in rows]), np.vstack([a for _, a in rows])
    kinds = []
    for k, (a, _) in enumerate(rows):
        kinds += ["firm"] * (len(a) - NC) + ["soft", "one", "two", "soft"]
        assert CAPPED == (1, 2)
        assert len(a) == NC + (k < N) * 2 * NU * (rates + bounded)
    w = numbers.w.ravel()
    H, g = numbers.cost()
    A, b = numbers.motion()
    for k in range(N):
        if tied[k]:
            M, m = numbers.moved(k)
            A, b = np.vstack([A, M]), np.r_[b, -m]
    ny, na, nl, nt = numbers.size, len(A), len(l), len(t)
    at = np.cumsum([0, ny, na, nl, nl, nt, nt])
    Y, A_, L, S, T, G = (slice(i, j) for i, j in pairwise(at))
    Z, right = np.zeros((at[-1], at[-1])), np.zeros(at[-1])
    Z[Y, Y], Z[Y, A_], Z[Y, L], right[Y] = H, A.T, R.T, -g
    Z[A_, Y], right[A_] = A, b
    j = 0
    for i, kind in enumerate(kinds):
        limit, product = at[2] + i, at[3] + i
        # r - ease (l+ - l) + s+ = t+, and s l+ + l s+ = s l + m - c1
        Z[limit, Y], right[limit] = R[i], -e[i] - ease * l[i]
        Z[limit, at[2] + i], Z[limit, at[3] + i] = -ease, 1
        Z[product, at[2] + i], Z[product, at[3] + i] = s[i], l[i]
        right[product] = s[i] * l[i] + mean - c1[i]
        if kind == "soft":
            Z[limit, at[2] + i] -= 1  # t is l
        if kind in ("one", "two"):
            q = SQUARE[0] if kind == "one" else SQUARE[1]
            capped, other = at[4] + j, at[5] + j
            Z[limit, capped] = -1
            # n+ = w + q t+ - l+, and t n+ + n t+ = t n + m - c2
            Z[capped, at[5] + j], Z[capped, at[4] + j], Z[capped, at[2] + i] = 1, -q, 1
            right[capped] = w[j]
            Z[other, at[5] + j], Z[other, at[4] + j] = t[j], n[j]
            right[other] = t[j] * n[j] + mean - c2[j]
            j += 1
    found = np.linalg.solve(Z, right)
    return found[Y], found[L], found[S], found[T], found[G]


def a_point(rng, nl, nt, slack=1.0):
    """Some (l, s, t, n, corrections), all above zero but for these."""
    l, s = rng.uniform(0.5, 2, nl), slack * rng.uniform(0.5, 2, nl)
    t, n = rng.uniform(0.5, 2, nt), rng.uniform(0.5, 2, nt)
    return [l, s, t, n, rng.uniform(-0.3, 0.3, nl), rng.uniform(-0.3, 0.3, nt)]


@pytest.mark.parametrize(
    ("rates", "bounded", "tied", "ease", "slack"),
    [
        (True, True, (False, True, False), 0.0, 1.0), (True, True, (False,) * 3, 0.02, 9.0),
        (False, True, (False,) * 3, 0.0, 0.1), (False, True, (False, False, True), 0.0, 1.0),
        (False, False, (False,) * 3, 0.03, 9.0), (True, True, (True, False, True), 0.0, 0.1),
    ],
)  # fmt: skip
def test_a_step_solves_the_linear_equations_of_all_rows(rates, bounded, tied, ease, slack):
    """Firm, soft, capped by a price, and by a price and a square; some limits are none.

    Where rows are eased t is read off the multiplier, as it is where slacks are large.
    """
    numbers, rng = Numbers(3), np.random.default_rng(4)
    numbers.hi[1, 1] = numbers.rate[2, 0] = numbers.rate[0, 1] = NONE
    numbers.lo[2, 0], numbers.c[1, 3], numbers.c[3, 0] = -NONE, -1e9, -1e9
    it = Interior(solver(list(tied), rates, bounded))
    now = a_point(rng, it.m * N + NC, 2 * (N + 1), slack)
    names = _by_stages(it)
    found = it._solution()(*(v[p] for v, p in zip(now, names, strict=True)), [0.7, ease],
                           *numbers.data)  # fmt: skip
    y, *wanted = newton(numbers, rates, bounded, tied, now, 0.7, ease)
    X, V, *rows = (np.array(v).ravel() for v in found)
    assert np.r_[X, V] == pytest.approx(y, rel=1e-7, abs=1e-7)
    for have, want, place in zip(rows, wanted, names, strict=False):
        assert have == pytest.approx(want[place], rel=1e-6, abs=1e-6)


def _by_stages(it: Interior) -> list[np.ndarray]:
    """Places of (l, s, t, n, corrections): the same order, stage by stage, the last one behind."""
    many = [it.m * N + NC, it.m * N + NC, 2 * (N + 1), 2 * (N + 1)]
    return [np.arange(m) for m in (*many, many[0], many[2])]
