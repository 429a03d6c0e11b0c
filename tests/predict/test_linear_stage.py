"""The linear step of a stage: fewer operations, the same numbers."""

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, State, flow, law, sampled
from slipctl.predict.qp.common_factors import split_by_inputs
from slipctl.predict.stages.horizon import Horizon, Layout
from slipctl.predict.stages.linear_stage import stage_functions

RNG = np.random.default_rng(7)


def drawn(rng: np.random.Generator, size: int) -> ca.Function:
    """A random expression of three inputs: sums, products, quotients and functions, some shared."""
    x, y, p = ca.SX.sym("x", 3), ca.SX.sym("y", 2), ca.SX.sym("p", 3)
    pool = [*ca.vertsplit(x), *ca.vertsplit(y), *ca.vertsplit(p), ca.SX(2), ca.SX(0.5), ca.SX(-3)]
    for _ in range(size):
        a, b = (pool[i] for i in rng.integers(len(pool), size=2))
        new = [
            a + b, a - b, a * b, -a, 2 * a, a / (1 + b * b), ca.sin(a), ca.sqrt(1 + a * a),
            ca.fmin(a, b), ca.if_else(a < b, a, b), a * a, 1 / (2 + ca.cos(a)), -a - b,
        ]  # fmt: skip
        pool.append(new[rng.integers(len(new))])
    return ca.Function("drawn", [x, p, y], [ca.vertcat(*pool[-6:]), pool[-8] * 3])


@pytest.mark.second
def test_grouped_functions_give_the_same_numbers():
    for _ in range(60):
        f = drawn(RNG, 40)
        once, g = split_by_inputs(f, (1,))
        for _ in range(5):
            x, p, y = (RNG.uniform(-1.5, 1.5, n) for n in (3, 3, 2))
            for a, b in zip(f(x, p, y), g(x, y, once(p)), strict=True):
                a, b = np.array(a), np.array(b)
                # a few dozen roundings of each operation, of numbers up to the largest between
                np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("fixed", [(0,), (2,), (0, 2), (1, 2)])
def test_a_function_that_calls_another_keeps_its_numbers(fixed):
    """It is not taken apart: what is the same is handed over in one column."""
    s = ca.SX.sym("s", 2)
    inner = ca.Function(
        "inner", [s], [ca.vertcat(s[0] * s[1], ca.sin(s[0]))], {"never_inline": True}
    )
    a, x, b = ca.MX.sym("a", 2), ca.MX.sym("x", 2), ca.MX.sym("b")
    f = ca.Function("f", [a, x, b], [inner(x) * a + b, ca.dot(a, x)])
    once, g = split_by_inputs(f, fixed)
    for _ in range(5):
        given = [RNG.uniform(-1.5, 1.5, n) for n in (2, 2, 1)]
        free = [v for i, v in enumerate(given) if i not in fixed]
        column = once(*(given[i] for i in fixed))
        for wanted, found in zip(f(*given), g(*free, column), strict=True):
            assert np.array(found) == pytest.approx(np.array(wanted), rel=1e-14)


def test_a_quotient_by_nothing_is_infinite():
    """x/0 stays a division, as f has it; the gathered factor 1/0 is not made."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        f = ca.Function("f", [x, p], [x / ca.SX(0) + p])
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)
    once, g = split_by_inputs(f, (1,))
    assert float(g(2.0, once(3.0))) == math.inf
    assert float(g(-2.0, once(3.0))) == -math.inf


def test_what_is_the_same_in_all_calls_is_computed_once():
    """a (b c) x + b (a c) y is (a b c) (x + y): one factor, one sum, one product."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    f = ca.Function("f", [x, p], [p[0] * (p[1] * p[2]) * x[0] + p[1] * (x[1] * (p[0] * p[2]))])
    once, g = split_by_inputs(f, (1,))
    assert once.size1_out(0) == 1
    ids = [g.instruction_id(k) for k in range(g.n_instructions())]
    assert (ids.count(ca.OP_MUL), ids.count(ca.OP_ADD)) == (1, 1)


@flow(s=Output("1"))
def pair(
    a=State("1", 0.3), b=State("1", -0.2), c=State("1", 0.1),
    u=Input("1", lo=-2, hi=2), w=Input("1", lo=-1, hi=4), load=Input("1", value=0.4),
    k=Param("1", 1.7), r=Param("1", 0.6),
):  # fmt: skip
    """Two controls; c is seen by nobody else."""
    s = ca.sin(a * r) + k * b / (1 + a**2)
    return dict(a=-k * r * s + u, b=s - load * b * r / k, c=w * r - c), dict(s=s)


@law(e=Output("1"), f=Output("1"))
def cost(s=Input("1"), c=Input("1"), u=Input("1"), w=Input("1")):
    """Residuals of an output, a state and both controls."""
    return dict(e=s - u * w, f=c + w)


@pytest.mark.parametrize(
    ("method", "substeps"), [("rk4", 1), ("rk4", 3), ("euler", 4), ("implicit_euler", 2)]
)
def test_slopes_are_those_of_the_sampled_plant(method: str, substeps: int):
    problem = Horizon.of(
        pair, cost, ["u", "w"], None, {}, 20, 0.1, method, substeps, {"u": 2.0, "w": 4.0}
    )
    once, stage, layout, motion = stage_functions("here", problem)
    step = sampled(pair, 0.1, method, substeps).f
    x, v, p = ca.SX.sym("x", 3), ca.SX.sym("v", 2), ca.SX.sym("p", 2)
    n = step(x, ca.vertcat(2 * v[0], 4 * v[1], 0.4), p)[0]
    wanted = ca.Function("wanted", [x, v, p], [n, ca.jacobian(n, x), ca.jacobian(n, v)])
    for _ in range(4):
        xs, vs, q = RNG.normal(size=3), RNG.normal(size=2), [*RNG.uniform(0.5, 2, 2), 3.0, 5.0]
        column = stage(xs, vs, [0.4], once(q), np.zeros(3))
        pieces = Layout(layout.sparsity).unpack(ca.SX(column))
        found = [np.array(ca.DM(ca.densify(m))) for m in (pieces[2], pieces[0], pieces[1])]
        for a, b in zip(found, wanted(xs, vs, q[:2]), strict=True):
            np.testing.assert_allclose(a, np.array(b), rtol=1e-12, atol=1e-13)  # roundings
        np.testing.assert_allclose(
            np.array(motion(xs, vs, [0.4], once(q))), found[0], rtol=1e-15, atol=1e-15
        )
