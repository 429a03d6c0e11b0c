"""Loops over stages and passes give what calling once and again gives."""

import casadi as ca
import numpy as np
import pytest

from slipctl.predict.qp.stage_loops import Repeated, as_one_call, chunk, scan


def step():
    """Function (carried, column, constant) -> (carried, column)."""
    z, a, c = ca.SX.sym("z", 2), ca.SX.sym("a", 3), ca.SX.sym("c")
    after = ca.vertcat(ca.sin(z[1]) + a[0] * c, z[0] * a[1] - a[2])
    return ca.Function("f", [z, a, c], [after, ca.vertcat(after, z[0], c)])


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("N", [1, 2, 5, 7, 12, 20, 23])
def test_a_scan_is_the_loop_by_hand(N, backward):
    """To the same bits: nothing is summed in another order."""
    f, rng = step(), np.random.default_rng(N)
    A, z, c = rng.normal(size=(3, N)), rng.normal(size=2), 0.7
    last, found = scan(f, N, 1, 1, backward)(z, A, c)
    rows = [None] * N
    for k in reversed(range(N)) if backward else range(N):
        z, rows[k] = f(z, A[:, k], c)
    assert (np.array(last) == np.array(z)).all()
    assert (np.array(found) == np.array(ca.horzcat(*rows))).all()


def test_parts_have_fewest_calls():
    """20 stages as 5 parts of 4, or 4 of 5: 9 calls."""
    assert 20 // chunk(20) + 20 % chunk(20) + chunk(20) == 9
    for N in range(1, 50):
        assert N // chunk(N) + N % chunk(N) + chunk(N) <= 2 * N**0.5 + 3


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("most", [1, 2, 3, 4, 7, 20, 30])
def test_what_is_repeated_stops_where_nothing_is_left_or_after_the_most(most, begun):
    """A counter down from five, and how often it was asked: never more than is left or allowed."""
    z, c = ca.MX.sym("z", 2), ca.MX.sym("c")
    once = ca.Function("down", [z, c], [ca.vertcat(z[0] - c, z[1] + 1)])
    again = Repeated(once, 0)
    f = ca.Function("all", [z, c], [again(most, z, c, begun=begun)])
    left, made = np.array(f([5, 0], 1)).ravel()
    assert made == min(most, 5)
    assert left == 5 - made


def test_a_body_that_is_apart_is_the_body():
    def body(x, u, p):
        return {"x": x["x"] + u["u"]}, {"y": p["k"] * x["x"]}

    x, u, k = ca.MX.sym("x", 3), ca.MX.sym("u", 3), ca.MX.sym("k")
    nxt, out = as_one_call("b", body)({"x": x}, {"u": u}, {"k": k})
    f = ca.Function("f", [x, u, k], [nxt["x"], out["y"]])
    found = [np.array(v).ravel() for v in f([1, 2, 3], [4, 5, 6], 2)]
    assert found[0].tolist() == [5, 7, 9]
    assert found[1].tolist() == [2, 4, 6]
    assert f.n_nodes() < 10  # one call
