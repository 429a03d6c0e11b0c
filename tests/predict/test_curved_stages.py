"""Exact Hessians of two controls in their columns, and functions of which factors are gathered."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from test_linear_stage import drawn

from slipctl import Input, Output, Param, State, flow, law, one
from slipctl.predict.qp.common_factors import split_by_inputs
from slipctl.predict.stages.exact_hessian import Curved, _blocks, _upper
from slipctl.predict.stages.horizon import Horizon, Soft
from slipctl.predict.stages.linear_stage import slope_sparsity, stage_functions

N, DAMPING = 3, 0.07


@flow(y=Output("1", "product"))
def plant(
    a=State("1", 0.0, "first"), b=State("1", 0.0, "second"), c=State("1", 0.0, "apart"),
    u=Input("1/s", lo=-2, hi=2), w=Input("1/s", lo=-1, hi=4), k=Param("1", 1.3),
):  # fmt: skip
    """Two states and a control bend together, and the third state alone."""
    s = one("s")
    return dict(a=(b * a - k * ca.sin(a)) / s + u, b=a**2 / s - u * b, c=-(c**3) / s + w), dict(
        y=a * b
    )


@law(e=Output("1"), f=Output("1"), g=Output("1/s"))
def cost(
    a=Input("1", "first"), b=Input("1", "second"), c=Input("1", "third"), u=Input("1/s"),
    w=Input("1/s"), to=Input("1", value=0.4),
):  # fmt: skip
    """Residuals that bend."""
    return dict(e=ca.sin(2 * a) - to + b**2, f=c**2 - 0.3, g=u + w)


SOFTS = {"plant.y": Soft(-0.05, 0.02, 3.0), "plant.c": Soft(-0.5, 0.1, 2.0)}


@pytest.fixture(scope="module")
def problem():
    h = Horizon.of(plant, cost, ["u", "w"], None, SOFTS, N, 0.2, "rk4", 2, {"u": 2.0, "w": 4.0})
    return replace(h, exact=True, damped=True)


def mirrored(H):
    w, V = np.linalg.eigh(H)
    return V @ np.diag(abs(w)) @ V.T


def numbers(expression):
    return np.array(ca.evalf(ca.densify(expression)))


def whole_of(H):
    """A symmetric matrix of its upper triangle."""
    H = numbers(H)
    return np.triu(H) + np.triu(H, 1).T


def test_columns_get_the_mirrored_hessian_of_the_lagrangian(problem):
    """All else stays in its place; the damping is added to the controls behind the mirror."""
    h, rng = problem, np.random.default_rng(7)
    X, V = rng.normal(size=(3, N + 1)) * 0.6, rng.normal(size=(2, N)) * 0.4
    q = [1.3, 2.0, 3.0, 0.5, -0.05, 0.02, 3.0, 0.0, -0.5, 0.1, 2.0, 0.0, DAMPING]
    assert h.nq == len(q)
    d = [0.4]
    once, stage, layout, _ = stage_functions("here", h)
    end, last = h.end()
    curved = Curved("here", h, layout, last)
    shared = once(q)
    D = ca.horzcat(*[stage(X[:, k], V[:, k], d, shared, X[:, k + 1]) for k in range(N)])
    E = end(X[:, N], d, q)
    held = ca.MX(ca.DM([d * N])), ca.MX(ca.DM(d))
    found = curved(ca.MX(D), ca.MX(E), ca.MX(ca.DM(X)), ca.MX(ca.DM(V)), held, ca.MX(ca.DM(q)))
    D_new, E_new = (np.array(ca.evalf(v)) for v in found)

    # the last stage: cost and exceeded limits bend, its rows are in the program itself
    x = ca.SX.sym("x", 3)
    _, last_cost = h.costs()
    of_last = ca.Function("f", [x], [ca.hessian(last_cost(x, d, q), x)[0]])
    old, new = last.unpack(ca.SX(E)), curved.end.unpack(ca.SX(E_new))
    rows = numbers(old[3])[numbers(old[2]).ravel() > 0]
    assert len(rows)
    own = np.array(of_last(X[:, N])) - rows.T @ rows
    H = np.zeros((3, 3))
    H[:2, :2], H[2, 2] = mirrored(own[:2, :2]), abs(own[2, 2])
    assert whole_of(new[0]) == pytest.approx(H, abs=1e-10)
    for a, b in zip(old[1:], new[1:], strict=True):
        assert (
            np.array(ca.evalf(ca.densify(a))).tolist() == np.array(ca.evalf(ca.densify(b))).tolist()
        )

    # stages: the Lagrangian with the multipliers that go back from the end
    over = np.maximum(numbers(old[2]).ravel(), 0)
    C = numbers(old[3])
    m = numbers(old[1]).ravel() + C.T @ over
    v, ms = ca.SX.sym("v", 2), ca.SX.sym("m", 3)
    stage_cost, _ = h.costs()
    step = h.step()(x, v * ca.DM([2.0, 4.0]), d, [1.3])[0]
    L = stage_cost(x, v, d, q) + ca.dot(ms, step)
    z = ca.vertcat(x, v)
    f = ca.Function("L", [x, v, ms], [ca.hessian(L, z)[0], ca.gradient(L, x)])
    bent = 0
    for k in reversed(range(N)):
        old, new = layout.unpack(ca.SX(D[:, k])), curved.stage.unpack(ca.SX(D_new[:, k]))
        exact, slope = (np.array(v) for v in f(X[:, k], V[:, k], m))
        c = numbers(old[5]).ravel()
        rows = numbers(old[6])[c > 0]
        own = exact - rows.T @ rows
        H = mirrored(own) + DAMPING * np.diag([0, 0, 0, 1, 1])
        assert whole_of(new[3]) == pytest.approx(H, abs=1e-9)
        bent += (np.linalg.eigvalsh(own) < 0).sum()
        for a, b in zip((*old[:3], *old[4:]), (*new[:3], *new[4:]), strict=True):
            assert numbers(a).tolist() == numbers(b).tolist()
        m = slope.ravel()
    assert bent > 1


def test_variables_that_bend_together_are_found_over_others():
    """0-2 and 2-4 tie 0, 2 and 4; 1 bends alone, 3 not at all."""
    pattern = ca.DM(5, 5)
    for i, j in ((0, 2), (2, 4), (1, 1)):
        pattern[i, j] = 1
    pattern = ca.sparsify(pattern).sparsity()
    blocks = _blocks("here", None, pattern)
    assert sorted(blocks) == [[0, 2, 4], [1]]
    upper = np.array(ca.DM(_upper(blocks, 5, 3), 1))
    wanted = np.zeros((5, 5))
    wanted[[0, 0, 0, 2, 2, 4, 1, 3], [0, 2, 4, 2, 4, 4, 1, 3]] = 1
    assert upper.tolist() == wanted.tolist()
    wanted[3, 3] = 0
    assert np.array(ca.DM(_upper(blocks, 5, None), 1)).tolist() == wanted.tolist()


def test_slopes_over_substeps_have_the_places_that_may_be_filled():
    """A chain of four: each substep reaches one state further, from the control too."""
    F = ca.DM(np.eye(4) + np.eye(4, k=-1))
    G = ca.DM([[1.0], [0], [0], [0]])
    for repeats, reach in ((1, 1), (2, 2), (3, 3), (5, 4)):
        A, B = slope_sparsity(ca.sparsify(F).sparsity(), ca.sparsify(G).sparsity(), repeats)
        wanted = np.tril(np.ones((4, 4))) * (np.subtract.outer(range(4), range(4)) <= reach)
        assert np.array(ca.DM(A, 1)).tolist() == wanted.tolist()
        assert np.array(ca.DM(B, 1)).ravel().tolist() == [1.0] * reach + [0.0] * (4 - reach)


@pytest.mark.parametrize("fixed", [(1,), (0, 2), (0, 1, 2)])
@pytest.mark.parametrize("seed", range(4))
def test_a_few_grouped_functions_give_the_same_numbers(fixed, seed):
    rng = np.random.default_rng(seed)
    f = drawn(rng, 30)
    once, g = split_by_inputs(f, fixed)
    given = [rng.uniform(-1.5, 1.5, n) for n in (3, 3, 2)]
    column = once(*(given[i] for i in fixed))
    found = g(*(v for i, v in enumerate(given) if i not in fixed), column)
    for a, b in zip(f(*given), found, strict=True):
        np.testing.assert_allclose(np.array(b), np.array(a), rtol=1e-9, atol=1e-9)
