"""What filters and fits over time cannot do with a plant is said, with what would do."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    State,
    ctukf,
    ekf,
    fit_over_time,
    flow,
    law,
    observability,
    rls,
)
from slipctl.estimate.kalman.model import Problem, by_name
from slipctl.estimate.kalman.signals import Names
from slipctl.estimate.log_fit import flow_fit


@flow(y=Output("1", "root"))
def root(x=State("1", 4.0, "level"), u=Input("1/s", "in", value=0.0), k=Param("1/s", 0.5, "rate")):
    """A tank."""
    return dict(x=u - k * x), dict(y=ca.sqrt(x))


@flow()
def growing(x=State("1", 1.0, "level"), k=Param("1/s", 1.0, "rate")):
    """It is infinite after 1/(2 k x^2)."""
    return dict(x=k * x**3), {}


@flow()
def named(
    v=State("1", 1.0, "level"), w=State("1", 2.0, "other"), drift_v=Param("1/s", 0.3, "taken"),
    drift_vx=Param("1/s", 0.4, "taken too"), held_w=Param("1/s", 0.4, "taken"),
):  # fmt: skip
    """Names that a filter would give."""
    return dict(v=-drift_v * v, w=drift_vx * v - held_w * w), {}


def test_a_point_where_a_slope_is_infinite_is_refused():
    assert observability(root, "y", "x", x=4.0).singular == pytest.approx((0.25,))
    with pytest.raises(BadInput, match="a slope is not finite there; give another point"):
        observability(root, "y", "x", x=0.0)


def test_a_log_over_which_a_flow_becomes_infinite_is_refused():
    data = {"time": np.linspace(0, 100, 21), "x": np.linspace(1, 2, 21)}
    with pytest.raises(BadInput, match="growing is not finite over data; give another start, --st"):
        fit_over_time(growing, data, "x", start={"k": 50.0})


def test_a_fit_whose_equations_have_no_solution_is_refused(monkeypatch):
    def found(self):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(flow_fit.Search, "found", found)
    data = {"time": np.linspace(0, 1, 21), "x": np.linspace(1, 2, 21)}
    with pytest.raises(BadInput, match="data: growing is not finite over it; look at the units of"):
        fit_over_time(growing, data, "x")


def test_a_measurement_that_the_law_reads_is_refused():
    @law(y=Output("1", "height"))
    def hill(y=Input("1", "place"), a=Param("1", 2.0, "factor")):
        """Its output and its input have one name."""
        return dict(y=a * y)

    with pytest.raises(BadInput, match=r"rls\(hill\): 'y' is an input of the law too"):
        rls(hill, period=0.1, start={"a": 1.0})


def test_names_that_are_taken_get_an_x():
    """drift_v and drift_vx are parameters of the flow; of others nothing changes."""
    names = Names(Problem.of("here", named, ["v", "w"], ["v", "w"]))
    assert names.drift == {"v": "drift_vxx", "w": "drift_w"}
    assert names.prior == {"v": "prior_v", "w": "prior_w"}
    assert (names.held["v"], names.held["w"]) == ("held_v", "held_wx")
    assert names.P == {(0, 0): "P_v", (1, 0): "P_w_v", (1, 1): "P_w"}
    assert (names.noise["w"], names.begun) == ("noise_w", "held_begun")


@pytest.mark.parametrize("kind", [ctukf, ekf], ids=["ctukf", "ekf"])
def test_a_start_variance_that_an_implicit_step_would_forget_is_refused(kind):
    """P' = -P - P^2/R: Euler's limit is 2/(1 + 2 P/R), with 10 and 0.04 in 10 ms 40 us."""
    given = {"noise": 0.04, "drift": 0.0, "form": "differential", "method": "implicit_euler"}
    text = (
        r"a step of 10 ms too long for implicit_euler, 0\.04 ms would do; use substeps=251, a sma"
    )
    with pytest.raises(BadInput, match=text):
        kind(root, "x", "x", prior=10.0, period=0.01, **given)
    with pytest.raises(BadInput, match=r"a step of 0\.04 ms too long"):
        kind(root, "x", "x", prior=10.0, period=0.01, substeps=250, **given)
    assert kind(root, "x", "x", prior=10.0, period=0.01, substeps=251, **given).period == 0.01


def test_numbers_of_names_are_floats_by_whole_name_or_its_end():
    units = {"a.v": "m/s", "b": "1"}
    found = by_name("f", "noise", {"v": 3, "b": "2.5"}, units, "positive")
    assert found == {"a.v": 3.0, "b": 2.5}
    assert {type(x) for x in found.values()} == {float}
    assert by_name("f", "noise", 0, units, "not negative") == {"a.v": 0.0, "b": 0.0}
