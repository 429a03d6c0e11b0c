"""Shortened steps: a residual that saturates, on which whole steps go back and forth."""

from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import pytest
from casadi import atan

from slipctl import BadInput, Input, Output, State, flow, law, nmpc, one
from slipctl.predict.qp.line_search import STEPS, Search
from slipctl.studies.predictive.slip_problem import closed_loop
from slipctl.studies.predictive.slip_problem import make as slip


@flow()
def cart(v=State("m/s", 0.0, "speed"), F=Input("N", "force", lo=-400, hi=400)):
    """One kilogram."""
    return dict(v=F / one("kg")), {}


@law(e=Output("1"), f=Output("N"))
def saturating(v=Input("m/s", "speed"), w=Input("m/s", "wanted"), F=Input("N", "force")):
    """A large error counts hardly more than a medium one."""
    return dict(e=atan(2 * (v - w) / one("m/s")), f=F)


def make(**options):
    """Controller of the cart."""
    weights = {"e": 10.0, "f": 0.01}
    return nmpc(cart, saturating, "F", h=0.1, horizon=4, weights=weights, **options)


def test_a_search_comes_down_where_whole_steps_go_back_and_forth():
    """From 2 m/s off; |z| > 1.39 is where Newton's method on atan(z) runs away."""
    best = make(solver="ipopt")(v=0.0, w=2.0)[1]["F"]
    whole = make(iterations=20)(v=0.0, w=2.0)[1]["F"]
    found = make(iterations=20, search=True)(v=0.0, w=2.0)[1]
    assert abs(whole - best) > 1
    assert found["F"] == pytest.approx(best, abs=1e-4)
    assert found["status"] == 0


@pytest.mark.long
def test_where_whole_steps_come_down_it_ends_at_the_same_cost():
    cost = closed_loop(slip(iterations=10, search=True), mismatch=True)[0]
    assert cost == pytest.approx(843.8535, abs=1e-3)
    with pytest.raises(BadInput, match="ipopt makes no iterations of ours; leave search= out"):
        slip(solver="ipopt", search=True)


def test_the_cost_of_a_plan_is_half_the_squares_and_the_prices():
    """Residuals 3, 4; excesses 2 (squares), 1 (price 5 and square), 0.5 (price 7), none of -9."""
    at = Search.__new__(Search)
    at.h = SimpleNamespace(
        nc=4, capped=(1, 2), square=(True, False), _caps=lambda q: [q[0], q[1]])  # fmt: skip
    cost = at._cost(ca.DM([3, 4]), ca.DM([2, 1, 0.5, -9]), ca.DM([5, 7]))
    assert float(cost) == 25 / 2 + 4 / 2 + (5 + 1 / 2) + 7 / 2


def test_each_step_that_is_tried_is_half_the_last():
    assert STEPS[0] == 1
    assert [a / b for a, b in pairwise(STEPS)] == [2] * (len(STEPS) - 1)
