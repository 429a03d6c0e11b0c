"""Exact Hessians, made convex."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, State, flow, law, nmpc, one
from slipctl.ccode import codegen
from slipctl.draw import show
from slipctl.predict.stages.exact_hessian import MOST, Curved, convex
from slipctl.predict.stages.horizon import Horizon, Soft
from slipctl.predict.stages.linear_stage import stage_functions
from slipctl.studies.predictive.slip_problem import axle, cost
from slipctl.studies.predictive.slip_problem import make as slip


@flow()
def cart(v=State("m/s", 0.0, "speed"), F=Input("N", "force", lo=-400, hi=400)):
    """One kilogram."""
    return dict(v=F / one("kg")), {}


@law(e=Output("1"), f=Output("N"))
def saturating(v=Input("m/s", "speed"), w=Input("m/s", "wanted"), F=Input("N", "force")):
    """A large error counts hardly more than a medium one."""
    return dict(e=ca.atan(2 * (v - w) / one("m/s")), f=F)


def make(**options):
    """Controller of the cart."""
    weights = {"e": 10.0, "f": 0.01}
    return nmpc(cart, saturating, "F", **{"h": 0.1, "horizon": 4, "weights": weights} | options)


@pytest.mark.parametrize("n", [1, 2, 3, 5, MOST])
def test_negative_eigenvalues_change_their_sign_and_no_other(n):
    """Against LAPACK, entries over eight decades; a positive matrix keeps its bits nearly."""
    rng, mirrored = np.random.default_rng(n), convex([list(range(n))], ca.Sparsity.upper(n))
    for _ in range(20):
        D = np.diag(10 ** rng.uniform(-2, 2, n))
        H = rng.normal(size=(n, n))
        H = D @ (H + H.T) @ D
        w, V = np.linalg.eigh(H)
        found = np.array(ca.triu2symm(mirrored(ca.triu(ca.DM(H)))))
        assert found == pytest.approx(V @ np.diag(abs(w)) @ V.T, abs=1e-13 * abs(w).max())
        good = H @ H.T
        found = np.array(ca.triu2symm(mirrored(ca.triu(ca.DM(good)))))
        assert found == pytest.approx(good, abs=1e-15 * abs(good).max())


def test_blocks_that_do_not_bend_together_are_apart():
    """(0, 2) and 1: 1 keeps its sign where its block is positive."""
    H = ca.DM([[1.0, 0, 3], [0, 2, 0], [3, 0, 1]])
    pattern = ca.triu(ca.sparsify(H))
    found = np.array(ca.triu2symm(convex([[0, 2], [1]], pattern.sparsity())(pattern)))
    assert found == pytest.approx(np.array([[3.0, 0, 1], [0, 2, 0], [1, 0, 3]]))  # 4, -2: 4, 2


def problem(N=3):
    """The slip problem with a soft limit, as its stages."""
    softs = {"plant.s": Soft(-0.1, 0.015, 30.0)}
    h = Horizon.of(axle, cost, ["u"], None, softs, N, 0.02, "rk4", 4, {"u": 8.0})
    return replace(h, exact=True)


def numbers(h, seed=3):
    """Plan, held inputs and constants: states off each other's steps, slip above its limit."""
    rng = np.random.default_rng(seed)
    X = np.tile([10.0, 10.2, 4.0, 0.01], (h.stages + 1, 1)).T
    X += rng.normal(size=X.shape) * [[0.01], [0.05], [0.2], [0.01]]
    q = [*np.array(h.model.pack("param", h.model.param_values())).ravel(),
         100.0, 5.0, 0.05, -0.1, 0.015, 30.0, 0.0]  # fmt: skip
    held = {"mu_p": 0.3, "s_ref": 0.02}
    return X, rng.uniform(0.2, 0.8, (1, h.stages)), [held[n] for n in h.held], q


def lagrangian(h, d, q):
    """Symbols (states, controls, multipliers) of the whole problem, its cost and what it misses."""
    N, step, (stage, last) = h.stages, h.step(), h.costs()
    x, v = ca.SX.sym("x", h.nx, N + 1), ca.SX.sym("v", h.nu, N)
    f, missed = last(x[:, N], d, q), []
    for k in range(N):
        f += stage(x[:, k], v[:, k], d, q)
        after = step(x[:, k], v[:, k] * ca.DM(h.scale), d, q[: h.np_])[0]
        missed.append(after - x[:, k + 1])
    return x, v, f, ca.horzcat(*missed)


def test_a_stage_bends_as_casadis_own_derivatives_of_the_lagrangian():
    """Whole problem over 3 stages of 4 substeps; rows of exceeded limits are in the QP's own."""
    h = problem()
    X, V, d, q = numbers(h)
    once, stage, layout, _ = stage_functions("nmpc", h)
    end, last = h.end()
    curved = Curved("nmpc", h, layout, last)
    D = stage.map(3)(X[:, :-1], V, ca.repmat(ca.DM(d), 1, 3), ca.repmat(once(q), 1, 3), X[:, 1:])
    x, v, f, missed = lagrangian(h, d, q)
    m = ca.SX.sym("m", h.nx, 3)
    z = ca.vertcat(ca.vec(x), ca.vec(v))
    L = f + ca.dot(m, missed)
    slope = ca.Function("slope", [x, v, m], [ca.gradient(L, x), ca.hessian(L, z)[0]])

    _, g, c, C, _ = last.unpack(end(X[:, 3], d, q))
    multipliers = [np.array(ca.evalf(g + C.T @ ca.fmax(c, 0))).ravel()]
    found = []
    for k in (2, 1, 0):
        after, H = curved.hessian(multipliers[0], D[:, k], X[:, k], V[:, k], d, q)
        found.insert(0, np.array(ca.triu2symm(H)))
        multipliers.insert(0, np.array(after).ravel())
    M = np.array(multipliers[1:]).T
    by_x, whole = (np.array(a) for a in slope(X, V, M))
    assert abs(by_x[:, 1:]).max() < 1e-12 * abs(M).max()  # they are the multipliers of the plan
    bent = 0
    for k in range(3):
        own = [*range(4 * k, 4 * k + 4), 16 + k]
        _, _, _, _, _, c, C, _ = layout.unpack(D[:, k])
        rows = np.array(ca.evalf(C))[np.array(ca.evalf(c)).ravel() > 0]
        bent += len(rows)
        expected = whole[np.ix_(own, own)] - rows.T @ rows
        assert found[k] == pytest.approx(expected, abs=1e-12 * abs(expected).max())
    assert bent


def test_an_iteration_is_newtons_step_where_the_stages_are_convex():
    """Against the whole system of Karush, Kuhn and Tucker with CasADi's Hessian."""
    h = Horizon.of(cart, saturating, ["F"], None, {}, 4, 0.1, "rk4", 1, {"F": 400.0})
    one, two = (make(iterations=k, hessian="exact")(v=1.85, w=2.0)[0] for k in (1, 2))
    x, v, f, missed = lagrangian(h, [2.0], [10.0, 0.01])
    z, c = ca.vertcat(ca.vec(x), ca.vec(v)), ca.vertcat(x[:, 0] - 1.85, ca.vec(missed))
    H, g, J = ca.hessian(f, z)[0], ca.gradient(f, z), ca.jacobian(c, z)
    K = ca.vertcat(ca.horzcat(H, J.T), ca.horzcat(J, ca.SX(5, 5)))
    step = ca.Function("step", [z], [z - ca.solve(K, ca.vertcat(g, c))[:9]])
    at = np.r_[one["X"], one["U"]]
    assert abs(np.r_[two["X"], two["U"]] - at).max() > 1e-3
    assert np.array(step(at)).ravel() == pytest.approx(np.r_[two["X"], two["U"]], abs=1e-9)


def test_it_comes_down_to_ipopts_optimum_quadratically():
    """From 2 m/s off, where whole steps of Gauss and Newton go back and forth for ever."""
    best = make(solver="ipopt")(v=0.0, w=2.0)[1]["F"]
    off = [abs(make(iterations=k, hessian="exact")(v=0.0, w=2.0)[1]["F"] - best)
           for k in (2, 3, 5)]  # fmt: skip
    assert 0.1 < off[0] < 1
    assert off[1] < off[0] ** 2
    assert off[2] < 1e-10 * abs(best)
    assert abs(make(iterations=20)(v=0.0, w=2.0)[1]["F"] - best) > 1


@pytest.mark.second
@pytest.mark.parametrize("options", [{}, {"split": True}, {"damping": 0.01, "grow": 1.1}], ids=str)
@pytest.mark.others("long")
def test_it_ends_where_gauss_newton_ends(options):
    """A soft limit that is exceeded, a lag, a rail: the same optimum by another way."""
    given = {"horizon": 4, "iterations": 12, "soft": {"s": (-0.1, 0.015, 30.0)}, **options}
    rail = dict(v=10.0, q=10.25, T=6.5, xi=0.0, mu_p=0.3, s_ref=0.02)
    ours, theirs = (slip(hessian=e, **given)(**rail)[1] for e in ("exact", "gauss_newton"))
    assert 0 < theirs["u"] < 8
    assert ours["u"] == pytest.approx(theirs["u"], abs=1e-5)
    assert ours["status"] == 0


@pytest.mark.second
@pytest.mark.usefixtures("needs_compiler")
def test_generated_c_bends_alike(tmp_path):
    n = 10
    given = {"v": np.linspace(0, 3, n), "w": np.full(n, 2.0)}
    block = make(hessian="exact", iterations=2, horizon=2, passes=4, rescue=0)
    assert codegen.check(block, given, tmp_path)["passed"]


def test_what_is_damped_moves_less_by_the_damping_alone():
    """The more, the less; the step tends to the gradient over the damping."""
    block = make(hessian="exact", horizon=2, damping=1.0, rescue=0)
    given = {"v": 0.0, "w": 2.0}
    rest = block.with_params(damping=1e12)(**given)[1]["F"]
    moved = [abs(block.with_params(damping=d)(**given)[1]["F"] - rest) for d in (1e-6, 1e7, 1e9)]
    assert moved[0] > moved[1] > moved[2] > 0
    assert moved[1] == pytest.approx(100 * moved[2], rel=0.01)


def test_show_says_so():
    text = show.text(make(hessian="exact"), False)
    assert "exact Hessian, made convex" in text


BAD = [
    ({"hessian": "newton"}, "hessian = 'newton'; give 'gauss_newton' or 'exact'"),
    ({"solver": "ipopt"}, "ipopt makes no iterations of ours; leave hessian= out"),
    ({"hard": {"v": (-5.0, 5.0)}}, "knows no multipliers of hard and linear limits"),
]


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    with pytest.raises(BadInput, match=text) as error:
        make(**({"hessian": "exact"} | options))
    assert "\n" not in str(error.value)


def test_too_many_that_bend_together_are_refused():
    """Four scenarios of the axle: each v and q bends with the one torque."""
    few = [{"mu_p": 1 + k / 10} for k in range(4)]
    with pytest.raises(BadInput, match=r"1\d states and controls bend together, at most 12"):
        slip(horizon=3, scenarios=few, hessian="exact")
