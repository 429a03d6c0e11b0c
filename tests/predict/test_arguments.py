"""What a predictive controller is asked for: read as it is given, or refused in a line."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import xarray as xr

from slipctl import BadInput, Input, Output, State, flow, law
from slipctl.predict.controller import Controller
from slipctl.predict.options import arguments
from slipctl.predict.options.arguments import Solver
from slipctl.predict.options.offset import with_constant_rates
from slipctl.predict.trajectory import _Problem

INF = float("inf")


@flow()
def cart(
    v=State("m/s", 0.0, "speed"), F=Input("N", "force", lo=-2, hi=3), T=Input("N m", "torque")
):
    """Two controls; the range of one is declared."""
    return dict(v=(F + T / 1.0) / 2.0), {}


@law(e=Output("m/s"), f=Output("N"))
def cost(v=Input("m/s", ""), F=Input("N", "")):
    """Two residuals."""
    return dict(e=v, f=F)


BOTH = {"F": "F", "T": "T"}


def bounds(given: Any, full: Any = BOTH) -> Any:
    return arguments.bounds_of("here", cart, full, given)


def test_a_control_is_bounded_as_it_is_given_or_declared():
    assert bounds({"T": (-1, "T_top")}) == {"F": (-2, 3), "T": (-1, "T_top")}
    assert bounds({"F": ("a", "b"), "T": (0.0, 1.0)}) == {"F": ("a", "b"), "T": (0.0, 1.0)}


@pytest.mark.parametrize(("given", "said"), [
    ({"G": (0, 1)}, "bounds of 'G', which is no control"), ({}, "T is unbounded; give bounds="),
    ({"T": (0, INF)}, "T is unbounded"), ({"T": (-INF, 0)}, "T is unbounded"),
    ({"T": (1, 1)}, "from 1 to 1 N m leaves nothing"), ({"T": (2, 1)}, "leaves nothing"),
    ({"T": (0, "2x")}, "'2x' is no name"), ({"T": ("a b", 1)}, "'a b' is no name"),
    ({"T": (0, None)}, "an end takes a number"), ({"T": (0, 1, 2)}, "lo, hi"), ({"T": 3}, "lo, hi"),
])  # fmt: skip
def test_bounds_that_are_none_are_refused(given, said):
    with pytest.raises(BadInput, match=said):
        bounds(given)


@pytest.mark.parametrize(("ends", "size"), [
    ((-2, 3), 3), ((-4, 3), 4), (("a", 3), 3), ((-2, "b"), 2), (("a", "b"), 1), ((0, "b"), 1),
])  # fmt: skip
def test_the_size_of_a_control_is_its_largest_bound(ends, size):
    """One without a number, or at zero, is counted in its unit."""
    assert arguments.scale_of(*ends) == size


def test_rates_are_those_of_controls():
    assert arguments.rates_of("here", ["F", "T"], {"T": 2.0}) == {"T": 2.0}
    with pytest.raises(BadInput, match="rate of 'G', which is no control"):
        arguments.rates_of("here", ["F", "T"], {"T": 2.0, "G": 1.0})
    for rate in (0.0, -1.0):
        with pytest.raises(BadInput, match="rate of T"):
            arguments.rates_of("here", ["F", "T"], {"T": rate})


def test_a_residual_weighs_1_where_nobody_says_else():
    assert arguments.weights_of("here", [cost], {"f": 2.5}) == {"e": 1.0, "f": 2.5}
    with pytest.raises(BadInput, match="two laws have a residual 'e'"):
        arguments.weights_of("here", [cost, cost], {})
    with pytest.raises(BadInput, match="the cost has no residual 'g'"):
        arguments.weights_of("here", [cost], {"g": 1.0})
    with pytest.raises(BadInput, match="weight of f"):
        arguments.weights_of("here", [cost], {"f": 0.0})
    with pytest.raises(BadInput, match="weights = 3; give weights="):
        arguments.by_name("here", "weights", 3)
    assert arguments.by_name("here", "weights", None) == {}


@pytest.mark.parametrize(("moves", "tied"), [
    (None, [False] * 4), ([1, 1, 1, 1], [False] * 4), ([4], [False, True, True, True]),
    ([1, 3], [False, False, True, True]), ((2, 2), [False, True, False, True]),
])  # fmt: skip
def test_controls_of_a_move_are_tied_to_its_first(moves, tied):
    assert arguments.tied_of("here", 4, moves) == tied


@pytest.mark.parametrize(("moves", "said"), [
    (5, "no list of whole numbers"), ([1, 2], "must have the sum 4"), ([5, -1], "a length"),
    ([2.5, 1.5], "a length"), ([0, 4], "a length"),
])  # fmt: skip
def test_moves_that_are_none_are_refused(moves, said):
    with pytest.raises(BadInput, match=said):
        arguments.tied_of("here", 4, moves)


def test_what_is_known_ahead_is_an_input_or_a_bound_with_a_name():
    known = ["load", 3.0, "T_top"]
    assert arguments.preview_names("here", ["T_top", "load"], known) == ("T_top", "load")
    with pytest.raises(BadInput, match="preview of 'wind'"):
        arguments.preview_names("here", ["load", "wind"], known)
    for odd in ("load", 3):
        with pytest.raises(BadInput, match="give a list of names"):
            arguments.preview_names("here", odd, known)


@pytest.mark.parametrize(("options", "said"), [
    (dict(rescue=-1), "rescue"), (dict(iterations=0), "iterations"), (dict(passes=0), "passes"),
    (dict(solver="acados"), "no solver 'acados'"), (dict(hessian="bfgs"), "hessian = 'bfgs'"),
    (dict(split=True, solver="ipopt"), "leave split= out"), (dict(damping=-1.0), "damping"),
    (dict(solver="ipopt", search=True), "leave search= out"),
    (dict(solver="ipopt", damping=1.0), "leave damping= out"),
    (dict(solver="ipopt", hessian="exact"), "leave hessian= out"),
])  # fmt: skip
def test_ways_to_solve_that_are_none_are_refused(options, said, monkeypatch):
    monkeypatch.setattr(arguments, "available", lambda where, solver: None)
    with pytest.raises(BadInput, match=said):
        arguments.check_numbers("here", 0.1, 5, Solver(**options))


@pytest.mark.parametrize(("h", "horizon"), [(0.0, 5), (-1.0, 5), (0.1, 0), (0.1, 2.5)])
def test_stages_have_a_length_and_a_number(h, horizon):
    arguments.check_numbers("here", 0.1, 5, Solver())
    with pytest.raises(BadInput, match=r"here: (h|horizon)"):
        arguments.check_numbers("here", h, horizon, Solver())


# ---- what is made of it --------------------------------------------------------------------------


@pytest.mark.parametrize("ahead", ["none", "F_top", "T_low"])
def test_bounds_stand_stage_by_stage_where_one_is_known_ahead(ahead):
    """Lower ones, upper ones, rates of all controls over their size; no upper one below a lower."""
    known = [] if ahead == "none" else [ahead]
    model = SimpleNamespace(period=0.5)
    stub = SimpleNamespace(
        limits={"F": (-2.0, "F_top"), "T": ("T_low", 8.0)}, short=BOTH, rate={"T": 3.0},
        scale=ca.DM([2.0, 4.0]), ahead=known, h=SimpleNamespace(nu=2, stages=3, model=model,
                                                                lengths=()),
    )  # fmt: skip
    stub._bound = lambda *given: Controller._bound(stub, *given)
    rows = {"F_top": [6.0, 4.0, 2.0, 9.0], "T_low": [-4.0, 0.0, 12.0, 9.0]}
    u = {n: ca.MX(ca.DM(v if n in known else v[:1])) for n, v in rows.items()}
    p = {"F_lo": ca.MX(-2.0), "T_hi": ca.MX(8.0), "T_rate": ca.MX(3.0)}
    found = np.array(ca.evalf(Controller.bounds(stub, u, p)))
    wide = 1 if ahead == "none" else 3
    assert found.shape == (6, wide)
    low, high = ([rows[n][k] if n in known else rows[n][0] for k in range(wide)]
                 for n in ("T_low", "F_top"))  # fmt: skip
    wanted = [[-1.0] * wide, [v / 4 for v in low], [v / 2 for v in high],
              [max(8.0, v) / 4 for v in low]]  # fmt: skip
    assert found[:4] == pytest.approx(np.array(wanted))
    assert (found[4] > 1e20).all()
    assert found[5] == pytest.approx([3.0 * 0.5 / 4] * wide)


@pytest.mark.parametrize("lengths", [(), (1.0, 2.0, 3.0)])
def test_a_rate_goes_from_the_middle_of_a_stage_to_that_of_the_next(lengths):
    """The stage before the first is as long as a tick."""
    h = SimpleNamespace(nu=1, stages=3, model=SimpleNamespace(period=0.5), lengths=lengths)
    stub = SimpleNamespace(limits={"F": (-2.0, 2.0)}, short=BOTH, rate={"F": 3.0},
                           scale=ca.DM([4.0]), ahead=[], h=h)  # fmt: skip
    stub._bound = lambda *given: Controller._bound(stub, *given)
    p = {"F_lo": ca.MX(-2.0), "F_hi": ca.MX(2.0), "F_rate": ca.MX(3.0)}
    rates = np.array(ca.evalf(Controller.bounds(stub, {}, p)))[2]
    edges = np.cumsum([0.0, 1.0, *(lengths or [1.0])])
    between = np.diff((edges[:-1] + edges[1:]) / 2)
    assert rates == pytest.approx(3.0 * 0.5 / 4 * between)


def test_a_state_that_is_an_array_has_no_one_rate():
    @flow()
    def two(x=State("m", np.zeros(2), "places", shape=(2,)), v=State("m/s", 0.0), F=Input("m/s")):
        return dict(x=F, v=v), {}

    plant, names = with_constant_rates("here", two, ["v"], ["F"])
    assert (names, "unmodelled_v" in plant.inputs) == (["unmodelled_v"], True)
    with pytest.raises(BadInput, match="offset_free: x is an array; name a scalar"):
        with_constant_rates("here", two, ["v", "x"], ["F"])


def test_a_state_that_no_run_shows_has_the_size_of_its_start():
    """Whatever states stand before it; one that runs show has their largest."""
    stub = SimpleNamespace(states=["a", "b", "c"], x0=np.array([500.0, 7.0, 0.0]),
                           scale=np.array([500.0, 7.0, 1.0]))  # fmt: skip
    _Problem.scale_by(stub, [])
    assert list(stub.scale) == [500.0, 7.0, 1.0]
    stub.x0, stub.scale = stub.x0[::-1], np.array([1.0, 7.0, 500.0])
    _Problem.scale_by(stub, [xr.Dataset()])
    assert list(stub.scale) == [1.0, 7.0, 500.0]
    stub.x0, stub.scale = stub.x0[::-1], stub.scale[::-1]
    log = xr.Dataset({"part.c": ("time", [0.0, -30.0, 20.0])})
    _Problem.scale_by(stub, [log])
    assert list(stub.scale) == [500.0, 7.0, 30.0]
