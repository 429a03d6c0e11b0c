"""Names in the vectors of a controller's Functions: one for each number, none twice."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from dense_steps import NC, NU, NX, N, solver
from programs import cart, make, price, to_go, wish

from slipctl.predict import nmpc as made_by
from slipctl.predict.controller import Controller
from slipctl.predict.options.offset import Unknown
from slipctl.predict.qp.interior import Interior
from slipctl.predict.stages.horizon import Horizon, Soft
from slipctl.predict.stages.linear_stage import motion_of
from slipctl.predict.vector_names import vector_names

SOFTS = {"plant.v": Soft(-1.0, 1.5, 3.0, 0.5), "plant.power": Soft(-8.0, 0.25, 2.0)}


@pytest.mark.parametrize("rates", [{"F": 6.0, "B": 9.0}, None])
def test_each_number_of_a_vector_has_a_name_of_its_own(monkeypatch, rates):
    found = []

    class Kept(Controller):
        def block(self, *given):
            found.append(self)

    monkeypatch.setattr(made_by, "Controller", Kept)
    options = {"rates": rates} if rates else {}
    make(horizon=3, damping=0.1, soft={"v": (-1.0, 1.5, 3.0), "power": (None, 1.0, 2.0, 0.5)},
         economic=price, terminal=to_go, weights={"w": 0.2, "s": 0.7, "q": 2.0, "r": 1.0},
         **options)  # fmt: skip
    (it,) = found
    names, inner = vector_names(it.h, it.qp), Interior(it.qp)
    motion, _ = motion_of("here", it.h)
    functions = [it.qp._backward, it.qp._forward, it.qp._start, it.qp._last_statuses()]
    functions += [inner._backward, inner._forward, motion, it.h.rows()[0], it.h.end()[0]]
    seen = 0
    for f in functions:
        known = names[f.name()]
        sides = [(f.name_in(k), f.sparsity_in(k)) for k in range(f.n_in())]
        sides += [(f.name_out(k), f.sparsity_out(k)) for k in range(f.n_out())]
        for argument, sparsity in sides:
            if argument in known:
                _, own = known[argument]
                if argument == "gains" and f.name().startswith("ip"):
                    assert len(own) > sparsity.nnz()  # the first of them alone
                    continue
                assert len(own) == sparsity.nnz(), (f.name(), argument)
                assert len(set(own.values())) == len(own), (f.name(), argument)
                assert list(own) == list(range(len(own)))
                seen += 1
    assert seen > 40
    states, z = ["x", "v"], ["x", "v", *(["F_before", "B_before"] if rates else [])]
    assert list(names["qp_forward"]["z"][1].values()) == z
    assert list(names["motion"]["point"][1].values()) == states
    rows = ["v_above", "v_below", "power_above", "power_below"]
    assert list(names["qp_forward"]["s"][1].values()) == ["F", "B", *rows]
    assert list(names["qp_end"]["s"][1].values()) == rows
    bounds = names["ip_forward"]["bounds"][1].values()
    assert list(bounds) == ["F_lo", "B_lo", "F_hi", "B_hi", "F_rate", "B_rate"]
    gains = list(names["qp_forward"]["gains"][1].values())
    n = len(z)
    assert gains[: 2 * n] == [f"K_{i}_{j}" for j in range(n) for i in (0, 1)]
    assert gains[2 * n : 2 * n + 2] == ["step_0", "step_1"]
    assert gains[-6:] == ["Qvv_0_0", "Qvv_1_0", "Qvv_0_1", "Qvv_1_1", "qv_0", "qv_1"]
    whole = names["qp_pass"]["z"][1]
    assert list(whole.values()) == [
        "X", "U", "status", "mark", "open", "residual", "over", "passes"]  # fmt: skip
    assert list(whole) == [0, *np.cumsum(it.qp.sizes)[:-1]]


def test_sizes_of_what_is_found_are_those_of_the_problem():
    qp = solver([False, True, False], True)
    many = (NU + NC) * N + NC
    assert qp.sizes == [NX * (N + 1), NU * N, many, many, 1, 1, 1, 1]
    z = np.arange(float(sum(qp.sizes)))
    pieces = [np.array(v).ravel() for v in qp.split(ca.DM(z))]
    assert np.concatenate(pieces).tolist() == z.tolist()
    assert [len(p) for p in pieces] == qp.sizes


def test_two_numbers_that_are_not_known_are_learnt_by_their_effects():
    """share (B'WB + W_0)^-1 B'W with B the slopes of the step, by two held inputs of three."""
    A, B = np.array([[0.9, 0.2], [0.0, 0.8]]), np.array([[0.5, 0, 0.3], [0.1, 0, -0.7]])
    names = ("x", 2), ("v", 1), ("d", 3), ("p", 1)
    x, v, d, p = (ca.SX.sym(n, k) for n, k in names)
    after = ca.DM(A) @ x + ca.DM([[1.0], [2.0]]) @ v * p + ca.DM(B) @ d**2
    step = ca.Function("step", [x, v, d, p], [after, x])
    h = SimpleNamespace(symbols=lambda: (x, v, d, p), nq=4, np_=1, step=lambda: step,
                        scale=(3.0,), held=("a", "b", "c"))  # fmt: skip
    unknown = Unknown(("c", "a"), (0.0, 0.0), np.array([4.0, 0.25]), np.array([0.02, 0.05]))
    f = unknown.step(h)
    at, d0 = np.array([0.3, -0.4]), np.array([0.6, 0.2, -0.5])
    expected, gain = (np.array(m) for m in f(at, [0.7], d0, [1.5, 9, 9, 9], 0.2))
    assert expected.ravel() == pytest.approx(A @ at + np.array([1, 2]) * 2.1 * 1.5 + B @ d0**2)
    S, W = 2 * B[:, [2, 0]] * d0[[2, 0]], np.diag([4.0, 0.25])
    L = 0.2 * np.linalg.solve(S.T @ W @ S + np.diag([0.02, 0.05]), S.T @ W)
    assert gain.ravel() == pytest.approx(L.ravel("F"))


def test_scenarios_have_columns_of_their_own():
    """Two masses, the load of the second twice as large; one control that both share at first."""
    factors = ({}, {"m": 0.5, "load": 2.0})
    h = Horizon.of(cart, wish, ["F", "B"], None, {"plant.v.0": Soft(-1, 1.5, 3.0)}, 3, 0.1, "euler",
                   1, {"F": 4.0, "B": 2.0}, {}, (), factors, 2)  # fmt: skip
    assert h.nx == 4
    assert h.nu == 4
    assert h.leaders == [0, 1, 0, 1]
    assert h.decided == h.controls[:2]
    p = ca.DM(h.model.pack("param", h.model.param_values()))
    x, u = np.array([0.1, 0.3, 1.0, 2.0]), np.array([1.0, 0.5, 3.0, 0.25])
    held = {"load": 0.4, "v_ref": 2.0, "x_ref": 0.5}
    for together in (1.0, 0.0):
        d = [(held | {"together": together})[n] for n in h.held]
        after, _ = h.step()(x, u, d, p)
        own = u if not together else np.r_[u[:2], u[:2]]
        wanted = []
        for k, (mass, load) in enumerate(((2.0, 0.4), (1.0, 0.8))):
            v = x[2 + k]
            drag = 0.3 * v * np.sqrt(v * v + 0.01)
            wanted.append((v, (own[2 * k] - own[2 * k + 1] - drag - load) / mass))
        rates = np.array(wanted).T.ravel()
        assert np.array(after).ravel() == pytest.approx(x + 0.1 * rates)
