"""Rows of the stages of a problem with all that it may have, by hand; names of its numbers."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from programs import cart, price, to_go, wish

from slipctl import Input, Output, law
from slipctl.predict.qp.line_search import Search
from slipctl.predict.stages.horizon import HARD, Horizon, Layout, Soft
from slipctl.predict.stages.stage_lengths import with_time_scale
from slipctl.predict.vector_names import _constants, _short


@law(near=Output("m", "room", lo=-30, hi=0))
def near(x=Input("m", "place"), F=Input("N", "force")):
    """A limit of the way that reads a control."""
    return x + 0.2 * F


@law(far=Output("m", "room", lo=-30, hi=0))
def far(x=Input("m", "place"), v=Input("m/s", "speed")):
    """A limit of the end."""
    return x + 3 * v


SOFTS = {
    "plant.v": Soft(-1.0, 1.5, 3.0), "path.near": Soft(-2.0, 0.5, 0.25, hard=True),
    "final.far": Soft(-9.0, 2.0, 0.0, 7.0), "plant.power": Soft(-8.0, 0.25, 2.0, 5.0),
}  # fmt: skip
WEIGHTS = {"e": 2.0, "f": 0.5, "b": 0.75, "p": 1.25, "q": 3.0, "r": 0.6, "w": 0.3, "s": 0.7}
DAMPING = 0.02


def problem(lengths=(), **more):
    laws = {"path": near, "final": far, "last": to_go, "price": price}
    made = Horizon.of(
        with_time_scale(cart) if lengths else cart, wish, ["F", "B"], None, SOFTS, 3, 0.1, "rk4", 1,
        {"F": 4.0, "B": 2.0}, laws, lengths,
    )  # fmt: skip
    return replace(made, damped=True, **more)


def constants(h, weights=WEIGHTS):
    params = {n.rpartition(".")[2]: v for n, v in h.model.param_values().items()}
    q = [float(v) for v in params.values()]
    q += [weights[n.rpartition(".")[2]] for n in h.weighed]
    for s in SOFTS.values():
        q += [s.lo, s.hi, s.weight, s.linear]
    return [*q, DAMPING]


X, V, HELD = np.array([0.7, 1.9]), np.array([0.6, 0.4]), {"load": 0.4, "v_ref": 2.25, "x_ref": 0.5}
F, B = 4 * 0.6, 2 * 0.4


def by_hand(x, F, B):
    """Residuals, prices and excesses of the way at a point; soft is 0.7, see the law."""
    r = [2.0 * (x[1] - 2.25), 0.5 * F, 0.75 * B, 1.25 * 0.7 * (x[0] - 0.5)]
    prices = [0.3 * F * x[1], -0.7 * x[1]]
    rows = [
        3 * (x[1] - 1.5), 3 * (-1.0 - x[1]), 0.25 * (x[0] + 0.2 * F - 0.5),
        0.25 * (-2.0 - x[0] - 0.2 * F), -1.0, -1.0, 2 * (F * x[1] - 0.25), 2 * (-8.0 - F * x[1]),
    ]  # fmt: skip
    return np.array(r), np.array(prices), np.array(rows)


def slopes(f, z, e=1e-6):
    return np.array([(f(z + d) - f(z - d)) / (2 * e) for d in e * np.eye(len(z))]).T


def whole_of(H):
    """A symmetric matrix of its upper triangle."""
    return np.triu(H) + np.triu(H, 1).T


def pieces(column, sparsity):
    found = Layout(tuple(sparsity)).unpack(ca.SX(column))
    return [np.array(ca.evalf(ca.densify(m))) for m in found]


@pytest.mark.parametrize("lengths", [(), (1.0, 1.5, 2.25)])
def test_a_stage_has_the_rows_of_cost_prices_and_limits(lengths):
    """Squares and prices count by the length of the stage; limits do not."""
    h = problem(lengths)
    stretch = 1.5 if lengths else 1.0
    held = HELD | {"stretch": stretch}
    d, q = [held[n] for n in h.held], constants(h)
    f, sparsity = h.rows()
    H, g, c, C, w = pieces(f(X, V, d, q), sparsity)

    def at(z):
        r, prices, rows = by_hand(z[:2], 4 * z[2], 2 * z[3])
        return np.r_[np.sqrt(stretch) * r, stretch * prices.sum(), rows]

    z = np.r_[X, V]
    values, J = at(z), slopes(at, z)
    R = J[:4]
    assert whole_of(H) == pytest.approx(
        R.T @ R + DAMPING * np.diag([0, 0, 1, 1]), abs=1e-8)  # fmt: skip
    assert g.ravel() == pytest.approx(R.T @ values[:4] + J[4], abs=1e-7)
    assert c.ravel() == pytest.approx(values[5:])
    assert pytest.approx(J[5:], abs=1e-8) == C
    assert h.capped == (2, 3, 4, 5, 6, 7)
    assert h.square == (False, False, False, False, True, True)
    assert h.hard == (2, 3)
    assert w.ravel() == pytest.approx([HARD, HARD, 1, 1, 2.5, 2.5])
    cost, _ = h.costs()
    over = np.maximum(values[5:], 0)
    whole = (values[:4] @ values[:4] + over @ over) / 2 + values[4]
    assert float(cost(X, V, d, q)) == pytest.approx(whole)
    firm, _ = h.firm()
    assert np.array(firm(X, V, d, q)).ravel() == pytest.approx(values[7:9])


def test_the_last_stage_has_the_rows_that_need_no_control():
    """Its own residuals, the limit of the end and that of the speed; others are far away."""
    h = problem()
    d, q = [HELD[n] for n in h.held], constants(h)
    f, layout = h.end()
    H, g, c, C, w = pieces(f(X, d, q), layout.sparsity)
    assert h.last == ("last.q", "last.r")
    r, J = np.array([3 * 2 * (1.9 - 2.0), 0.6 * 0.7]), np.array([[0, 6.0], [0.6, 0]])
    v_ref = HELD["v_ref"]
    r[0] = 3 * 2 * (1.9 - v_ref)
    assert whole_of(H) == pytest.approx(J.T @ J)
    assert g.ravel() == pytest.approx(J.T @ r)
    rows = [3 * 0.4, 3 * -2.9, -1, -1, 7 * (0.7 + 3 * 1.9 - 2), 7 * (-9 - 0.7 - 3 * 1.9), -1, -1]
    assert c.ravel() == pytest.approx(rows)
    slope = np.zeros((8, 2))
    slope[[0, 1], 1] = 3, -3
    slope[4], slope[5] = (7, 21), (-7, -21)
    assert pytest.approx(slope) == C
    assert w.ravel() == pytest.approx([HARD, HARD, 1, 1, 2.5, 2.5])
    _, last = h.costs()
    over = np.maximum(rows, 0)
    assert float(last(X, d, q)) == pytest.approx((r @ r + over @ over) / 2)
    _, firm = h.firm()
    assert np.array(firm(X, d, q)).ravel().tolist() == [-1, -1]
    L, M, c0 = np.array([[0.5, 0.25]]), np.array([[0.125, 2.0, 3.0]]), np.array([0.75])
    tailed = problem(last=("last.r",), tail=(L, M, c0))
    H, g, *_ = pieces(tailed.end()[0](X, d, q), tailed.end()[1].sparsity)
    r, J = np.r_[0.6 * 0.7, L @ X + M @ d + c0], np.vstack([[[0.6, 0]], L])
    assert whole_of(H) == pytest.approx(J.T @ J)
    assert g.ravel() == pytest.approx(J.T @ r)


def test_the_price_of_a_plan_is_that_of_its_stages_and_its_slope():
    """As of the search along a step: linear prices by their weights, hard ones by a million."""
    h = problem()
    motion = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("d", h.nd), ca.SX.sym("s")
    search = Search(h, ca.Function("step", [*motion], [motion[0]]))
    d, q = [HELD[n] for n in h.held], constants(h)
    caps = {2: HARD, 3: HARD, 4: 1.0, 5: 1.0, 6: 2.5, 7: 2.5}

    def priced(r, rows):
        over = np.maximum(rows, 0)
        found = r @ r / 2 + sum(over[i] ** 2 / 2 for i in (0, 1, 6, 7))
        return found + sum(w * over[i] for i, w in caps.items())

    def of_stage(z):
        r, prices, rows = by_hand(z[:2], 4 * z[2], 2 * z[3])
        return priced(r, rows) + prices.sum()

    def of_end(x):
        rows = np.array([3 * (x[1] - 1.5), 3 * (-1 - x[1]), -1, -1, 7 * (x[0] + 3 * x[1] - 2),
                         7 * (-9 - x[0] - 3 * x[1]), -1, -1])  # fmt: skip
        return priced(np.array([6 * (x[1] - 2.25), 0.6 * x[0]]), rows)

    dx, dv = np.array([0.3, -0.2]), np.array([0.7, 0.1])
    f, slope = (float(v) for v in search.price(X, V, d, q, dx, dv))
    z, dz = np.r_[X, V], np.r_[dx, dv]
    assert f == pytest.approx(of_stage(z))
    e = 1e-6
    wanted = (of_stage(z + e * dz) - of_stage(z - e * dz)) / (2 * e)
    assert slope == pytest.approx(wanted, rel=1e-5)
    f, slope = (float(v) for v in search.last(X, d, q, dx))
    assert f == pytest.approx(of_end(X))
    assert slope == pytest.approx((of_end(X + e * dx) - of_end(X - e * dx)) / (2 * e), rel=1e-5)


def test_numbers_have_names_in_their_order():
    h = problem()
    ends = ("min", "max", "weight", "linear")
    softs = [f"{n}_{e}" for n in ("v", "near", "far", "power") for e in ends]
    params = [n.rpartition(".")[2] for n in h.model.params]
    weights = [f"weight_{n}" for n in ("e", "f", "b", "p", "q", "r", "w", "s")]
    assert _constants(h) == [*params, *weights, *softs, "damping"]
    assert _constants(replace(h, damped=False))[-1] == "power_linear"
    assert len(_constants(h)) == h.nq == len(constants(h))
    assert _short(["plant.v", "cost.e"]) == ["v", "e"]
    assert _short(["plant.v", "cost.v"]) == ["plant_v", "cost_v"]
    assert _short(["plant.v.0", "plant.v.1"]) == ["plant_v_0", "plant_v_1"]
