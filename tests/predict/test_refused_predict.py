"""What no plan, region or window can use is refused by a line that says what is wanted."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Noise,
    Output,
    Param,
    Scenario,
    State,
    connect,
    flow,
    law,
    mhe,
    nmpc,
    trajectory,
)
from slipctl.predict.options import region, terminal
from slipctl.predict.sensitivity import by_numbers
from slipctl.predict.stages import linear_stage
from slipctl.predict.stages.joint_flow import join_flows


@flow(y=Output("m/s", "speed again"))
def cart(
    x=State("m", 0.0, "place"), v=State("m/s", 1.0, "speed"), F=Input("N", "force", lo=-4, hi=4),
    m=Param("kg", 2.0, "mass"),
):  # fmt: skip
    """A cart."""
    return dict(x=v, v=F / m), dict(y=v)


@flow(y=Output("1", "first", shape=(2,)), z=Output("1", "sum"))
def twins(
    a=State("1", 0.0, "level"), u=Input("1", "in", lo=-1, hi=1),
    w=Input("1", "two of them", shape=(2,)), k=Param("1", (1.0, 2.0), "rates", shape=(2,)),
):  # fmt: skip
    """Arrays everywhere."""
    return dict(a=-k[0] * a + u + w[1]), dict(y=ca.vertcat(a, w[0]), z=a * k[1])


@law(e=Output("m/s"), f=Output("N"))
def wish(v=Input("m/s", "speed"), F=Input("N", "force"), to=Input("m/s", "wanted", value=0.0)):
    """Speed and force."""
    return dict(e=v - to, f=F)


@law(room=Output("m", "two rooms", shape=(2,), lo=-9, hi=0))
def rooms(x=Input("m", "place")):
    """Both sides."""
    return ca.vertcat(x, -x)


@law(e=Output("m/s"), f=Output("N"), idle=Output("1"))
def idle(v=Input("m/s", "speed"), F=Input("N", "force"), to=Input("1", "wanted", value=0.0)):
    """One of them sees nothing that moves."""
    return dict(e=v, f=F, idle=to)


def make(cost=wish, control="F", **options):
    weights = dict.fromkeys(cost.outputs, 2.0)
    return nmpc(cart, cost, control, **{"h": 0.1, "horizon": 3, "weights": weights} | options)


def two_carts():
    inside = {"a.F": "F", "b.F": "F"}
    return connect("both", inside, a=cart, b=cart)


WINDOW = {"noise": 0.1, "period": 0.1, "samples": 3}
REFUSED = {
    "no control": (lambda: make(control=[]), "give control=, one or more of F"),
    "a limit that is an array": (lambda: make(path=rooms), "room of the path law must be a scalar"),
    "an end that is an array": (lambda: make(final=rooms), "of the final law must be a scalar"),
    "a residual of nothing": (
        lambda: make(cost=idle), "the residual idle depends on no state and no control"),
    "an array as input": (
        lambda: nmpc(twins, wish, "u", h=0.1, horizon=3), "inputs of plant and cost must be"),
    "one of two": (
        lambda: join_flows("here", two_carts(), {"cost": wish}),
        r"here: 'v' of the cost could be a\.v or b\.v"),
    "an array that is measured": (
        lambda: mhe(twins, "y", arrival={"a": 1.0}, drift=0.1, **WINDOW),
        r"y has shape \(2,\); measure scalars"),
    "an array that is known": (
        lambda: mhe(twins, "z", arrival={"a": 1.0}, drift=0.1, **WINDOW),
        "is an array; an estimator takes scalars"),
}  # fmt: skip


@pytest.mark.parametrize("what", [*REFUSED])
def test_what_cannot_be_planned_with_is_refused(what):
    ask, words = REFUSED[what]
    with pytest.raises(BadInput, match=words) as error:
        ask()
    assert "\n" not in str(error.value)


def test_a_stage_of_too_many_instructions_is_refused(monkeypatch):
    """At its bound it is made; the count is that of all substeps."""
    make(horizon=2)
    monkeypatch.setattr(linear_stage, "UNROLL", 30)
    with pytest.raises(BadInput, match=r"one stage takes \d+ instructions; use fewer substeps"):
        make(horizon=2)


def test_an_input_of_a_trajectory_is_a_number_and_noise_is_none():
    @flow()
    def sled(x=State("m", 0.0, "place"), v=State("m/s", 0.0, "speed"),
             F=Input("N", "force", lo=-2, hi=2), wind=Input("N", "wind", value=0.0),
             n=Noise("N", "gusts")):  # fmt: skip
        """A mass of 1 kg."""
        return dict(x=v, v=F + wind + n), {}

    with pytest.raises(BadInput, match="the input wind must be a number in N"):
        trajectory(sled, Scenario("go", 1.0, inputs={"wind": [(0.0, 1.0), (0.5, 2.0)]}), "F", "-x")
    problem = trajectories_problem(sled, {"wind": 3.0, "n": 5.0})
    assert [p.u.tolist() for p in problem.phases] == [[0.0, 3.0, 0.0]]


def trajectories_problem(plant, inputs):
    from slipctl.predict.trajectory import _Problem

    return _Problem("here", plant, Scenario("go", 1.0, inputs=inputs), "F", "-x", None, None, None)


# ---- regulators ----------------------------------------------------------------------------------


def slopes(**given):
    """Slopes of a problem of one state and one control, some of them given."""
    fields = {"A": [[0.5]], "B": [[1.0]], "X": [[1.0], [0.0]], "U": [[0.0], [1.0]],
              "drift": [[0.0]], "r": [[0.0], [0.0]]}  # fmt: skip
    fields |= given
    numbers = {n: np.array(v) for n, v in fields.items()}
    rest = dict.fromkeys(("horizon", "x", "v", "d", "T", "lift", "E"))
    return terminal.Slopes(**rest, **numbers)


def test_a_regulator_that_does_not_bring_to_rest_is_refused():
    """A state that grows and no control moves, and one that stands still unseen."""
    P = slopes().regulator("here")
    assert pytest.approx(1 + 0.25 * P / (1 + P)) == P  # P = Q + A'P A/(1 + P) of scalars
    for given in ({"A": [[2.0]], "B": [[0.0]]}, {"A": [[1.0]], "B": [[0.0]], "X": [[0.0], [0.0]]}):
        with pytest.raises(BadInput, match="no regulator brings all that the residuals see to"):
            slopes(**given).regulator("here")
    with pytest.raises(BadInput, match="needs a residual of every control"):
        slopes(U=[[0.0], [0.0]]).regulator("here")


def test_a_steady_state_that_is_not_there_is_refused():
    """x+ = x + 0.3 goes on for ever; x+ = x/2 + v + 0.3 with x and v weighed alike rests."""
    y, v, level = slopes(drift=[[0.3]]).steady("here")
    assert y / 2 == pytest.approx(v + 0.3)
    assert y + -0.5 * level == pytest.approx(0)
    assert v + level == pytest.approx(0)
    with pytest.raises(BadInput, match="there is no steady state at the point of terminal="):
        slopes(A=[[1.0]], B=[[0.0]], drift=[[0.3]]).steady("here")


def test_a_steady_state_that_is_no_minimum_of_the_cost_to_go_is_refused(monkeypatch):
    """The cost to go is flat along the second state, where the level is not."""
    found = SimpleNamespace(
        regulator=lambda where: np.diag([4.0, 0.0]), T=np.eye(2),
        tailed=lambda L, columns: (L, columns),
    )  # fmt: skip
    monkeypatch.setattr(terminal, "slopes_at", lambda *a: found)
    y = np.array([[0.5], [7.0]])
    found.steady = lambda where: (y, None, np.array([[6.0], [0.0]]))
    L, columns = terminal.with_lqr("here", None, {}, {})
    assert pytest.approx(np.diag([4.0, 0.0])) == L.T @ L
    assert L.T @ columns == pytest.approx(np.array([[6.0 - 4 * 0.5], [0.0]]))
    found.steady = lambda where: (y, None, np.array([[6.0], [0.1]]))
    with pytest.raises(BadInput, match="the best steady state is no minimum of the cost to go"):
        terminal.with_lqr("here", None, {}, {})


def test_a_region_needs_a_cost_to_go_that_rises_and_a_rest():
    s = SimpleNamespace(
        T=np.eye(2), regulator=lambda where: np.diag([1.0, -1.0]),
        steady=lambda where: (np.zeros((2, 1)), np.zeros((1, 1)), None),
        horizon=SimpleNamespace(nx=2, model=SimpleNamespace(states={})),
    )  # fmt: skip
    with pytest.raises(BadInput, match="here: the cost to go does not rise in every direction"):
        region._Search("here", s, ["u"], [(-1.0, 1.0)], {})
    made = object.__new__(region._Search)
    made.where, made.L, made.G = "here", np.diag([2.0, 0.5]), np.diag([0.5, 2.0])
    made.x_s = np.array([3.0, -1.0])
    w = ca.SX.sym("w", 2)
    turned = ca.vertcat(0.5 * w[1] + 0.25 + 0.1 * w[0] ** 2, 0.25 * w[0] - 0.5)
    at = made._rest(w, turned, None)
    found = (at - made.x_s) @ made.L
    assert found == pytest.approx(
        [0.5 * found[1] + 0.25 + 0.1 * found[0] ** 2, 0.25 * found[0] - 0.5])  # fmt: skip
    with pytest.raises(BadInput, match="has no rest near the point"):
        made._rest(w, ca.vertcat(w[0] + w[0] ** 2 + 1, w[1] / 2), None)


def test_rows_that_bend_are_bounded_over_each_box():
    """The larger of both; x^2 + y - 1 and y^2 - x - 2 over three boxes, by hand."""
    made = object.__new__(region._Search)
    w = ca.SX.sym("w", 2)
    rows = [w[0] ** 2 + w[1] - 1, w[1] ** 2 - w[0] - 2]
    made.bent = [ca.Function("row", [w], [r]) for r in rows]
    made.bent_slopes = [ca.Function("s", [w], [ca.densify(ca.gradient(r, w))]) for r in rows]
    low = np.array([[0.0, 1.0, 2.0], [0.0, 2.0, -3.0]])
    high = low + np.array([[0.5, 1.0, 0.25], [1.0, 0.5, 1.0]])
    a = high[0] ** 2 + high[1] - 1
    b = np.maximum(low[1] ** 2, high[1] ** 2) - low[0] - 2
    assert (a > b).tolist() == [True, True, False]
    assert made._within(low, high) == pytest.approx(np.maximum(a, b), abs=1e-8)
    assert (made._within(low, high) > np.maximum(a, b)).all()  # room for the rounding


# ---- slopes --------------------------------------------------------------------------------------


def test_parameters_that_take_no_symbols_are_refused():
    def derive(symbols):
        raise TypeError("float() of a symbol")

    loop = SimpleNamespace(params={"k": SimpleNamespace(derived=False, size=1)}, derive=derive)
    with pytest.raises(BadInput, match="its parameters cannot be written as symbols"):
        by_numbers(loop, ["k"])
