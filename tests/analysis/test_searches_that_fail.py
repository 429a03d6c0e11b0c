"""Searches of the analyses that end without an answer say why."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    RunFailed,
    State,
    argmax_table,
    flow,
    law,
    luenberger,
    operating_point,
)
from slipctl.analysis import linearise, lookup


@flow()
def log(x=State("1", 3.0, "level"), a=Input("1", "in", value=0.0), k=Param("1/s", 2.0, "rate")):
    """Stands still at exp(a)."""
    return dict(x=k * (a - ca.log(x))), {}


@flow()
def slow(x=State("1", 40.0, "level"), a=Input("1", "in", value=7.0)):
    """Stands still at the root of a."""
    return dict(x=a - x**2), {}


@flow(p=Output("1", "first"), q=Output("1", "second"))
def chain(a=State("1", 0.0, "one"), b=State("1", 0.0, "two"), c=State("1", 0.0, "three")):
    """Three in a row, of which the first and the last are seen."""
    return dict(a=b - 2 * a, b=c - a, c=-3 * c + a), dict(p=a, q=c)


def test_an_operating_point_where_nothing_is_finite_is_refused():
    assert operating_point(log, {"a": 0.5}, free={"x": 3.0}).states["x"] == pytest.approx(np.e**0.5)
    with pytest.raises(RunFailed, match="an equation or its slope is not finite; at x = -1 there"):
        operating_point(log, {"a": 0.5}, free={"x": -1.0})


def test_newtons_steps_are_counted(monkeypatch):
    """40 comes down to the root of 7 in eight steps, the last of them to rounding."""
    found = operating_point(slow, free=["x"])
    assert found.states["x"] == pytest.approx(7**0.5, rel=1e-15)
    x, steps = 40.0, 0
    while abs(x - 7**0.5) > 1e-9:
        x, steps = (x + 7 / x) / 2, steps + 1
    assert steps <= found.steps <= steps + 2
    monkeypatch.setattr(linearise, "NEWTON_STEPS", found.steps - 2)
    with pytest.raises(RunFailed, match=f"not found in {found.steps - 2} steps; at x = 2.6"):
        operating_point(slow, free=["x"])
    monkeypatch.setattr(linearise, "NEWTON_STEPS", found.steps - 1)
    assert operating_point(slow, free=["x"]).steps == found.steps


def test_poles_of_an_observer_that_cannot_be_placed_are_refused():
    """Two measured signals place two equal poles, not three."""
    made = luenberger(chain, [-5.0, -5.0, -7.0], measured=["p", "q"])
    gains = np.array([[float(made.param_values()[f"L_{n}_{m}"]) for m in "pq"] for n in "abc"])
    A, C = np.array([[-2.0, 1, 0], [-1, 0, 1], [1, 0, -3]]), np.array([[1.0, 0, 0], [0, 0, 1]])
    assert np.sort(np.linalg.eigvals(A - gains @ C).real) == pytest.approx([-7, -5, -5], rel=1e-6)
    with pytest.raises(BadInput, match=r"these poles cannot be placed .*; make them differ"):
        luenberger(chain, [-5.0, -5.0, -5.0], measured=["p", "q"])


def test_a_table_of_too_many_nodes_is_refused(monkeypatch):
    @law(y=Output("1", "height"))
    def hump(x=Input("m", "place"), w=Input("s", "time"), top=Param("m", 1.0, "place")):
        """Its top is at top + w^2."""
        return 3 - (x - top - w**2) ** 2

    def table(error):
        given = {"lo": 0.0, "hi": 9.0, "span": (0.0, 2.0), "conditions": {"a": {}}}
        return argmax_table(hump, "x", "w", error=error, **given)

    few = table(0.02)
    monkeypatch.setattr(lookup, "MOST", 40)
    assert table(0.02).param_values()["w_at"] == pytest.approx(few.param_values()["w_at"])
    with pytest.raises(RunFailed, match=r"40 nodes do not reach an error of 1e-06"):
        table(1e-6)
