"""Parts of a predictive controller in numbers: constants, bounds, what is held and can be kept."""

from __future__ import annotations

import math
from statistics import NormalDist
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from programs import make
from scipy.linalg import solve_discrete_are

from slipctl import Input, Output, Param, State, flow, law, tightening
from slipctl.predict import nmpc as made_by
from slipctl.predict.controller import Controller
from slipctl.predict.options.terminal import Slopes, _seen
from slipctl.predict.qp.common_factors import split_by_inputs


@pytest.fixture
def controller(monkeypatch):
    """What makes the block of a controller of the cart."""
    found = []

    class Kept(Controller):
        def block(self, *given):
            found.append(self)
            return SimpleNamespace()

    monkeypatch.setattr(made_by, "Controller", Kept)

    def of(**options):
        make(**options)
        return found.pop()

    return of


RICH = {
    "preview": ["load", "F_top"], "bounds": {"F": (-3.0, "F_top"), "B": ("B_low", 1.5)},
    "rates": {"B": 9.0}, "damping": 0.02, "horizon": 3,
    "soft": {"power": (None, 1.0, 2.0, 0.5), "v": (-1.0, 1.2, 9.0)}, "hard": {"x": (-1.0, 4.0)},
}  # fmt: skip
NUMBERS = {"B_hi": 1.25, "B_rate": 7.0, "F_lo": -2.0, "c": 0.2, "damping": 0.03, "m": 3.0,
           "power_linear": 0.7, "power_max": 2.5, "power_min": -1.5, "power_weight": 1.75,
           "v_max": 1.1, "v_min": -0.9, "v_weight": 8.0, "weight_b": 0.6, "weight_e": 3.5,
           "weight_f": 0.4, "weight_p": 1.6, "x_max": 5.0, "x_min": -2.0, "soft": 0.8}  # fmt: skip


def number(expression):
    return np.array(ca.evalf(ca.MX(expression)))


def test_settings_have_the_numbers_that_are_given(controller):
    found = {s.name: (s.value, s.lo, s.hi, s.unit) for s in controller(**RICH).settings()}
    far, least = 1e12, 1e-12
    assert found == {
        "weight_e": (3.0, least, far, "1/(m/s)"), "weight_f": (0.3, least, far, "1/(N)"),
        "weight_b": (0.5, least, far, "1/(N)"), "weight_p": (1.5, least, far, "1/(m)"),
        "F_lo": (-3.0, -far, far, "N"), "B_hi": (1.5, -far, far, "N"),
        "B_rate": (9.0, 0, far, "N/s"), "power_min": (-9.0, -far, far, "W"),
        "power_max": (1.0, -far, far, "W"), "power_weight": (2.0, least, far, "1/(W)"),
        "power_linear": (0.5, least, far, "1/(W)"), "v_min": (-1.0, -far, far, "m/s"),
        "v_max": (1.2, -far, far, "m/s"), "v_weight": (9.0, least, far, "1/(m/s)"),
        "x_min": (-1.0, -far, far, "m"), "x_max": (4.0, -far, far, "m"),
        "damping": (0.02, least, far, "1"),
    }  # fmt: skip
    given = {s.name: s.shape for s in controller(**RICH).given()}
    assert given == {"load": (4,), "v_ref": (), "x_ref": (), "B_low": (), "F_top": (4,)}
    assert [s.name for s in controller(**RICH).measured()] == ["x", "v"]


def test_constants_stand_in_the_order_of_the_stages(controller):
    it = controller(**RICH)
    own = list(it.h.model.params)
    p = NUMBERS | {n: NUMBERS[n.rpartition(".")[2]] for n in own}
    found = number(it.constants({n: ca.MX(v) for n, v in p.items()})).ravel()
    params = [p[n] for n in own]
    assert sorted(params) == [0.2, 0.8, 3.0]
    weight = it.softs["plant.x"].weight
    assert weight == pytest.approx(0.25)
    assert found == pytest.approx([
        *params, 3.5, 0.4, 0.6, 1.6, -1.5, 2.5, 1.75, 0.7, -0.9, 1.1, 8.0, 0.0,
        -2.0, 5.0, weight, 0.0, 0.03,
    ])  # fmt: skip


def test_bounds_are_scaled_and_those_ahead_have_a_column_each(controller):
    """Of scales 4 and 2; where a lower one passes an upper one, that follows it."""
    it = controller(**RICH)
    sizes = np.array(ca.DM(it.scale)).ravel()
    u = {"F_top": ca.MX(ca.DM([1.0, -2.5, 3.0, 99.0])), "B_low": ca.MX(0.5)}
    found = number(it.bounds(u, {n: ca.MX(v) for n, v in NUMBERS.items()}))
    wanted = np.array([[-2.0] * 3, [0.5] * 3, [1.0, -2.0, 3.0], [1.25] * 3, [1e30] * 3, [0.7] * 3])
    assert found == pytest.approx(wanted / np.r_[sizes, sizes, sizes][:, None])
    long = controller(grow=1.5, horizon=3, rates={"F": 6.0, "B": 8.0})
    p = {"F_lo": -2.0, "F_hi": 3.0, "B_lo": 0.25, "B_hi": 1.0, "F_rate": 5.0, "B_rate": 7.0}
    found = number(long.bounds({}, {n: ca.MX(v) for n, v in p.items()}))
    between = np.array([(1 + 1) / 2, (1 + 1.5) / 2, (1.5 + 2.25) / 2]) * 0.1
    sizes = np.array(ca.DM(long.scale)).ravel()
    wanted = np.array([[-2.0] * 3, [0.25] * 3, [3.0] * 3, [1.0] * 3, 5 * between, 7 * between])
    assert found == pytest.approx(wanted / np.r_[sizes, sizes, sizes][:, None])


def test_what_is_held_is_ahead_or_the_same_for_all_stages(controller):
    it = controller(**RICH)
    u = {"load": ca.MX(ca.DM([1.0, 2, 3, 4])), "v_ref": ca.MX(7), "x_ref": ca.MX(9)}
    rows = {"load": [1, 2, 3, 4], "v_ref": [7] * 4, "x_ref": [9] * 4}
    d, last = it.held(u)
    both = np.hstack([number(d), number(last)])
    assert both.tolist() == [rows[n] for n in it.h.held]
    plain = controller(horizon=2)
    d, last = plain.held({n: ca.MX(k) for k, n in enumerate(("load", "v_ref", "x_ref"), 5)})
    assert np.hstack([number(d), number(last)]).T.tolist() == [[5, 6, 7]] * 3
    long = controller(grow=1.5, horizon=3)
    d, last = long.held({"load": ca.MX(5), "v_ref": ca.MX(6), "x_ref": ca.MX(7)})
    at = long.h.held.index("stretch")
    assert np.hstack([number(d), number(last)])[at].tolist() == [1, 1.5, 2.25, 1]
    assert [number(long._start(n)).item() for n in long.h.controls] == [0, 0]


def test_scenarios_share_their_numbers_and_the_first_stages(controller):
    it = controller(
        scenarios=[{}, {"m": 0.5}], shared=1, horizon=3, damping=0.1,
        soft={"v": (-1.0, 1.2, 9.0), "power": (None, 1.0, 2.0)},
    )  # fmt: skip
    assert it.fixed == {"together": [1, 0, 0, 0]}
    names = [s.name for s in it.settings()]
    limits = [f"{n}_{e}" for n in ("v", "power") for e in ("min", "max", "weight")]
    assert names == [
        "weight_e", "weight_f", "weight_b", "weight_p", "F_lo", "F_hi", "B_lo", "B_hi", *limits,
        "damping",
    ]  # fmt: skip


def bare(rate, tied):
    made = object.__new__(Controller)
    made.h, made.rate, made.tied = SimpleNamespace(nu=2, stages=4), rate, tied
    return made


def test_bounds_are_opened_where_a_rate_does_not_lead_back():
    """From 5 by 1 a stage to 3, 3.5, 9 and 1: by 4, 3, 2, 1; the other control is its mirror."""
    hi = np.array([3.0, 3.5, 9.0, 1.0])
    bounds = np.array([[0.0] * 4, -hi, hi, [0.0] * 4, [1.0] * 4, [1.0] * 4])
    made = bare({"u": 1}, [False] * 4)
    found, contradict = made.reachable(ca.MX(ca.DM(bounds)), ca.MX(ca.DM([5.0, -5.0])))
    way = [4, 3, 2, 1]
    wanted = [[0.0] * 4, [-v for v in way], way, [0.0] * 4, [1.0] * 4, [1.0] * 4]
    assert number(found).tolist() == wanted
    assert number(contradict).item() == 1
    found, contradict = made.reachable(ca.MX(ca.DM(bounds)), ca.MX(ca.DM([3.0, -2.5])))
    wanted[1], wanted[2] = [-3, -3, -2, -1], [3, 3, 2, 1]
    assert number(found).tolist() == wanted
    assert number(contradict).item() == 0


def test_constant_bounds_are_opened_as_far_as_the_moves_lead_back():
    """From 7 by 1.5 a move to at most 3, and from -6 by 0.5 to at least -5; the second is tied."""
    bounds = ca.MX(ca.DM([-2.0, -5.0, 3.0, 4.0, 1.5, 0.5]))
    made = bare({"u": 1}, [False, True, False, False])
    found, contradict = made.reachable(bounds, ca.MX(ca.DM([7.0, -6.0])))
    assert number(found).tolist() == [
        [-2] * 4, [-5.5, -5.5, -5, -5], [5.5, 5.5, 4, 3], [4] * 4, [1.5] * 4,
        [0.5] * 4]  # fmt: skip
    assert number(contradict).item() == 1
    assert number(made.reachable(bounds, ca.MX(ca.DM([4.4, -5.4])))[1]).item() == 0
    found, contradict = bare({}, [False] * 4).reachable(bounds, ca.MX(ca.DM([7.0, -6.0])))
    assert number(found).tolist() == [[v] * 4 for v in (-2, -5, 3, 4, 1.5, 0.5)]
    assert number(contradict).item() == 0


# ---- slopes at a point ---------------------------------------------------------------------------


def test_states_that_residuals_see_are_taken_apart():
    """Of a chain that the last one is seen of all, of three apart the two that are seen."""
    A = np.array([[0.5, 0, 0], [1.0, 0.25, 0], [0, 2.0, 0.75]])
    T, lift = _seen(A, np.array([[0.0, 0, 3.0]]))
    assert (T @ lift) == pytest.approx(np.eye(3))
    assert (lift @ T) == pytest.approx(np.eye(3))
    T, lift = _seen(np.diag([0.5, 0.6, 0.7]), np.array([[1.0, 0, 2.0], [1.0, 0, -1.0]]))
    assert T.shape == (2, 3)
    assert (T @ lift) == pytest.approx(np.eye(2))
    assert (lift @ T) == pytest.approx(np.diag([1.0, 0, 1]))


def test_what_no_rest_makes_up_for_is_left():
    """x+ = x/2 + v + w; with residuals x - v rests, with x and v it does not; what grows may."""

    def of(X, U, drift, r, A=0.5):
        return Slopes(**dict.fromkeys(("horizon", "x", "v", "d", "T", "lift", "E")),
                      A=np.array([[A]]), B=np.array([[1.0]]), X=np.array(X), U=np.array(U),
                      drift=np.array(drift), r=np.array(r))  # fmt: skip

    one = of([[1.0]], [[0.0]], [[9.0, 0.3]], [[9.0, 0.2]])
    assert one.left(np.array([1])) < 1e-12
    two = of([[1.0], [0.0]], [[0.0], [1.0]], [[0.0, 0.3]], [[0.0, 0.0], [0.0, 0.0]])
    # nearest: rows -y/2 + v - y' = -0.3, y = 0, v = 0 of sizes 1: a third of each
    assert two.left(np.array([1])) > 0.2
    assert two.left(np.array([0])) == 0
    grows = of([[0.0]], [[1.0]], [[0.0, 0.3]], [[0.0, 0.0]], A=1.0)
    assert grows.left(np.array([1])) < 1e-12


@flow(z=Output("m/s", "speed and force"))
def cart(
    x=State("m", 0.0, "place"), v=State("m/s", 1.0, "speed"), F=Input("N", "force", lo=-4, hi=4),
    m=Param("kg", 2.0, "mass"),
):  # fmt: skip
    """A cart."""
    return dict(x=v, v=F / m), dict(z=v + 0.2 * F)


@law(e=Output("m/s"), p=Output("m"), f=Output("N"))
def wish(x=Input("m", "place"), v=Input("m/s", "speed"), F=Input("N", "force")):
    """Place, speed and force."""
    return dict(e=v, p=x, f=F)


@pytest.mark.parametrize("answered", [True, False])
def test_room_for_noise_is_that_of_its_covariance(answered):
    """By scipy's Riccati equation; the control of now is fixed, what is measured has noise too."""
    h, weights = 0.2, {"e": 2.0, "p": 0.7, "f": 0.5}
    found = tightening(
        cart, wish, "F", ["x", "z"], h=h, horizon=4, noise={"v": 0.05, "x": 0.01}, chance=0.9,
        start={"x": 0.02}, weights=weights, answered=answered, at={"v": 0.0, "F": 0.0},
    )  # fmt: skip
    A, B = np.array([[1, h], [0, 1]]), np.array([[h * h / 4], [h / 2]])
    P = solve_discrete_are(A, B, np.diag([0.49, 4.0]), np.array([[0.25]]))
    K = np.linalg.solve(0.25 + B.T @ P @ B, B.T @ P @ A) * answered
    S, Q, z = np.diag([0.02, 0.0]), np.diag([0.01, 0.05]) * h, NormalDist().inv_cdf(0.9)
    for k in range(5):
        answer = K * (k > 0)
        rows = {"x": np.array([1.0, 0.0]), "z": np.array([0.0, 1.0]) - 0.2 * answer[0]}
        for n, c in rows.items():
            assert found[n][k] == pytest.approx(z * math.sqrt(c @ S @ c), rel=1e-6, abs=1e-12)
        M = A - B @ answer
        S = M @ S @ M.T + Q


# ---- common factors ------------------------------------------------------------------------------


def test_sums_of_multiples_of_one_factor_are_gathered_with_their_signs():
    """Each pair of signs and of the shares 1, 2, 1/2; with numbers alone, and differences."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    a, b = p[0] * x[0], p[0] * x[1]
    rows = [s * a + t * b for s in (1, -1, 2, -2, 0.5, 3) for t in (1, -1, 2, -0.5, -3)]
    rows += [
        -a - p[1] * x[2],
        p[1] * x[2] - a,
        a - p[1] * x[2],
        -3 * a + p[1] * x[2],
        p[0] - 2 - x[1],
    ]
    f = ca.Function("f", [x, p], [ca.vertcat(*rows), a / (p[1] * x[1])])
    once, g = split_by_inputs(f, (1,))
    given, fixed = [0.7, -1.3, 2.1], [1.7, -0.6]
    for have, want in zip(g(given, once(fixed)), f(given, fixed), strict=True):
        assert np.array(have) == pytest.approx(np.array(want), rel=1e-14)
