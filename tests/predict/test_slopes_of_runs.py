"""Slopes of a run in closed form, and which of them are doubtful."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, Scenario, State, run_slopes, step
from slipctl.predict import sensitivity
from slipctl.predict.sensitivity import _apart, _places, _refuse, by_numbers


@step(
    period=0.5,
    y=Output("1", "out"),
    pair=Output("1", "both", shape=(2,)),
    status=Output("1", "status"),
)
def loop(
    z=State("1", (0.5, 0.25), "apart", shape=(2,)), x=State("1", "2 * k", "level"),
    u=Input("1", "in", value=0.0), k=Param("1", 0.8, "share"), c=Param("1", 3.0, "factor"),
    twice=Param("1", "2 * k", "follows"), many=Param("1", (1.0, 2.0), "list", shape=(2,)),
):  # fmt: skip
    """A lag that begins at 2 k and is driven by k."""
    after = dict(x=k * x + u * many[1], z=0.5 * z)
    return after, dict(y=c * x + twice * u, pair=c * z, status=0 * x)


U = [(0.0, 0.5), (0.5, -1.0), (1.0, 2.0), (1.5, 0.25)]
INPUT = np.array([v for _, v in U])


def test_slopes_of_a_run_are_those_of_its_closed_form():
    """x_k = 2 k^{k+1} + sum k^{k-1-j} 2 u_j, also by the start that follows from k."""
    found = run_slopes(loop, Scenario("go", 2.0, inputs={"u": U}), ["c", "k"])
    k, x, dx, xs, dxs = 0.8, 1.6, 2.0, [], []
    for u in INPUT:
        xs.append(x)
        dxs.append(dx)
        x, dx = k * x + 2 * u, x + k * dx
    xs, dxs = np.array(xs), np.array(dxs)
    assert found.of["x"]["k"][:4] == pytest.approx(dxs)
    assert found.of["x"]["c"] == pytest.approx(0)
    assert found.of["y"]["k"][:4] == pytest.approx(3 * dxs + 2 * INPUT)
    assert found.of["y"]["c"][:4] == pytest.approx(xs)
    assert set(found.of) == {"x", "y"}
    assert found.doubtful == ()
    assert max(found.apart.values()) < 1e-6
    assert list(found.apart) == ["c", "k"]


def test_numbers_that_move_a_status_are_doubtful(monkeypatch):
    """x is taken for a status: k moves it, c does not."""
    monkeypatch.setattr(sensitivity, "_marks", lambda block: np.array([2]))
    found = run_slopes(loop, Scenario("go", 2.0, inputs={"u": U}), ["c", "k"])
    assert found.doubtful == ("k",)


@pytest.mark.parametrize("name", ["twice", "many", "u", "none"])
def test_what_is_no_number_of_its_own_is_refused(name):
    with pytest.raises(BadInput, match=name):
        run_slopes(loop, Scenario("go", 2.0), name)


def test_slopes_of_numbers_go_to_those_that_follow_and_to_the_start():
    """Columns c and k, rows of all parameters: k, c, twice and both of the list."""
    f = by_numbers(loop, ["c", "k"])
    params, start = (np.array(v) for v in f([0.8, 3.0, 1.0, 2.0]))
    assert params.tolist() == [[0, 1], [1, 0], [0, 2], [0, 0], [0, 0]]
    assert start.tolist() == [[0, 0], [0, 0], [0, 2]]
    assert _places(loop, "state") == {"x": 2}
    assert _places(loop, "output") == {"y": 0}


def test_slopes_and_differences_are_compared_by_the_largest():
    slope, difference = np.array([1.0, -4.0, 2.0]), np.array([1.5, -4.0, 2.25])
    assert _apart(slope, difference, 1.0) == pytest.approx(0.5 / 4)
    assert _apart(0 * slope, difference, 1.0) == pytest.approx(1.0)
    small = sensitivity.SMALLEST
    assert _apart(np.array([0.0]), np.array([small]), 8.0) == pytest.approx(1 / 8)
    agrees = sensitivity.AGREES
    _refuse("here", [], {"a": 0.99 * agrees})
    _refuse("here", ["b"], {"a": 0.99 * agrees, "b": 9.0})
    with pytest.raises(BadInput, match=r"here: by c slopes and differences are .* apart: some"):
        _refuse("here", ["b"], {"a": 0.99 * agrees, "b": 9.0, "c": 1.01 * agrees})
