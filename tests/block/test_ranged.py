"""Ranges that are given to a block: what they change, what stays, what is no range."""

from __future__ import annotations

import math

import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, flow, law, make_block, ranged


@flow(v=Output("m/s", "rate", "paper"), F=Output("N", "force"))
def cart(
    x=State("m", 0.5, "place", "paper"), F=Input("N", "push", positive="braking", value=0.0),
    m=Param("kg", 2.0, "mass", lo=1, hi=9),
):  # fmt: skip
    return {"x": F / m}, {"v": F / m, "F": F}


def ends(signal):
    return signal.lo, signal.hi


def test_a_range_is_that_which_is_given_and_all_else_stays():
    made = ranged(
        cart, Output("m/s", lo=-3, hi=4, source="we").named("v"),
        F=Input("N", lo=-5, hi="6*m", change="m", noise=0.1, stale=7),
        x=State("m", 0.0, lo=-1, hi=1),
    )  # fmt: skip
    assert ends(made.outputs["v"]) == (-3, 4)
    assert ends(made.states["x"]) == (-1, 1)
    push = made.inputs["F"]
    assert (push.lo, push.jitter, push.stale, push.positive) == (-5, 0.1, 7, "braking")
    assert {b.what: b.expression for b in push.bounds} == {"hi": "6*m", "change": "m"}
    assert made.ends(push, {"m": 3.0})[1][0] == 18
    assert (made.states["x"].value, made.states["x"].doc) == (0.5, "place")
    assert (made.outputs["v"].source, made.states["x"].source) == ("we", "paper")
    assert ends(made.outputs["F"]) == (-math.inf, math.inf)  # of the name, the input alone
    assert ends(cart.states["x"]) == (-math.inf, math.inf)
    assert made.start()["x"] == cart.start()["x"]


def test_an_end_that_follows_an_input_hides_no_other_end():
    """It stands first, and is left out where the numbers of inputs are not asked for."""

    @law(y=Output("N"))
    def sum_of(F=Input("N", lo="-G", hi="6*m", change="m"), G=Input("N"), m=Param("N", 2.0)):
        return F + G + m

    F = sum_of.inputs["F"]
    assert sum_of.ends(F, {"m": 3.0}) == ([], [18.0], [3.0], [])
    assert sum_of.ends(F, {"m": 3.0, "G": 5.0}) == ([-5.0], [18.0], [3.0], [])


@pytest.mark.parametrize("turned", [False, True])
def test_each_signal_with_an_open_end_is_named_and_one_that_is_judged_is_not(turned):
    signals = [Input("1", judged=True).named("a"), Input("1", lo=0).named("b"),
               Input("1", lo=0, hi=1).named("c"), Input("1", lo=0, hi="b").named("d")]  # fmt: skip
    made = make_block("made", "law", lambda x, u, p: ({}, {"y": u["b"]}),
                      inputs=signals[::-1] if turned else signals,
                      outputs=[Output("1", lo=0, hi=1).named("y")])  # fmt: skip
    assert made.without_range() == ["input b"]


def test_a_row_of_a_table_is_of_all_that_carries_the_name():
    made = ranged(cart, table={"F": (-8, 8, "why", 2.0, 0.5), "x": (0, "m", "there")})
    push = made.inputs["F"]
    assert (*ends(push), push.change, push.jitter, push.source) == (-8, 8, 2.0, 0.5, "why")
    out = made.outputs["F"]
    assert (*ends(out), out.change, out.jitter) == (-8, 8, math.inf, 0.0)
    assert made.states["x"].source == "paper"
    assert made.ends(made.states["x"], {"m": 4.0})[1][0] == 4


def test_a_block_that_is_made_again_of_other_parts_keeps_its_ranges():
    loop = connect("loop", {}, a=cart)
    made = ranged(loop, table={"a.x": (-2, 2, "why")}).swap("a", cart.with_params(m=3.0))
    assert ends(made.states["a.x"]) == (-2, 2)
    assert made.params["a.m"].value == 3


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: ranged(3), "ranged: the block"),
        (lambda: ranged(cart, F=3), "ranged: 3 is no signal"),
        (lambda: ranged(cart, G=Input("N", lo=0)), "has no input 'G'"),
        (lambda: ranged(cart, Output("m", lo=0).named("v")), "cart.v is in m/s, its range in m"),
        (lambda: ranged(cart, table={"f": (0, 1, "")}), "cart has no signal 'f'; did you mean 'F'"),
        (lambda: ranged(cart, F=Input("N", lo=0, hi="6*mass")), "mass"),
        (lambda: ranged(cart, table={"x": (0, "6*mass", "")}), "mass"),
    ],
)  # fmt: skip
def test_what_is_no_range_of_a_block_is_refused(made, said):
    with pytest.raises(BadInput, match=said):
        made()
