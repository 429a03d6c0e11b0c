"""What a block or a part cannot be, told in one line; loops, guards and names inside Functions."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    State,
    connect,
    flow,
    interpolated,
    law,
    make_block,
    ranged,
    sampled,
    step,
)
from slipctl.block.block import Block
from slipctl.block.call_order import _on_circle
from slipctl.block.shared_numbers import numbers_of
from slipctl.block.text import formula
from slipctl.block.text.intermediates import named_inside, remember_locals
from slipctl.block.units.unit_walk import check
from slipctl.run.numbers import check_guards

SIGNALS = [Input("1", "in").named("a"), Output("1", "out").named("y")]


@law(y=Output("1"))
def line(a=Input("1"), k=Param("1", 2.0)):
    return k * a


@flow(y=Output("m"))
def tank(x=State("m", 1.0), a=Input("m/s", value=0.0), tau=Param("s", 1.0, lo=1e-6)):
    return {"x": a - x / tau}, {"y": x}


def body_of(n, y):
    return Block("b", "law", lambda x, u, p: (n, y(u)), SIGNALS)


def without_rebuild():
    pair = connect("pair", {}, a=line)
    made = replace(pair.composition, rebuild=None)
    return pair._copy(pair.signals, composition=made).swap("a", line)


BAD = {
    "above a number": (lambda: law(y=Output("1"))(3), "@law stands above a function, not 3"),
    "a role": (
        lambda: make_block("b", "law", lambda x, u, p: ({}, {}), params=SIGNALS[:1]),
        "b: 'a' is an input, given among the params"),
    "a part": (lambda: connect("c", {}, **{"a b": line}), "c: 'a b' is no name of a part; write"),
    "a signal": (
        lambda: Block("b", "law", lambda x, u, p: ({}, {}), [Input("1", "x").named("a b")]),
        "b: 'a b' is no name of a signal; write letters"),
    "a place": (lambda: interpolated(1.0, [0, "q", 2], [1, 2, 3]), "the place 'q' is no number"),
    "two ranges": (
        lambda: ranged(line, Output("1", lo=0, hi=1).named("y"), Output("1", lo=0).named("y")),
        "ranged: a signal has two ranges; leave out one"),
    "a period": (
        lambda: Block("b", "step", lambda x, u, p: ({}, {}), SIGNALS, period=-1.0), "b: period"),
    "an end": (lambda: Input("1", "x", lo=[0.0]), "x: lo"),
    "a body of one": (
        lambda: Block("b", "law", lambda x: ({}, {}), SIGNALS).expr({}, {"a": 1.0}, {}),
        r"b\.expr: its body takes \(x, u, p\): "),
    "a body without a pair": (
        lambda: Block("b", "law", lambda x, u, p: {"y": u["a"]}, SIGNALS).expr(
            {}, {"a": 1.0}, {}), r"b\.expr: its body must return \(dict of states, dict of outp"),
    "another kind": (
        lambda: body_of({}, lambda u: {"y": ca.MX.sym("m") * 2}).f,
        "b: y is a MX, its equations are in SX"),
    "another symbol": (
        lambda: body_of({}, lambda u: {"y": u["a"] * ca.SX.sym("foreign")}).f,
        "b: y has the symbol foreign, which is no signal of its own"),
    "a unit of another symbol": (
        lambda: body_of({}, lambda u: {"y": u["a"] * ca.SX.sym("foreign")}).check_units(),
        "b: the symbol 'foreign' of an equation has no unit"),
    "a part that stays": (without_rebuild, "pair cannot be rebuilt with another 'a'"),
    "a step that is too long": (
        lambda: sampled(tank, 0.5, "euler").composition.guard({"tau": 1e-3}),
        r"tank: a step of 500 ms is too long for euler"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_it_is_refused_in_these_words(what):
    call, words = BAD[what]
    with pytest.raises(BadInput, match=words) as told:
        call()
    assert "\n" not in str(told.value)


def test_a_guard_lets_pass_what_its_part_takes():
    """Euler's steps may be twice as long as the time constant, implicit ones as one likes."""
    guard = sampled(tank, 0.5, "euler").composition.guard
    assert guard({"tau": 0.26}) is None
    with pytest.raises(BadInput, match="which allows 480 ms"):
        guard({"tau": 0.24})
    assert sampled(tank, 0.5, "implicit_euler").composition.guard({"tau": 1e-3}) is None
    check_guards(connect("c", {}, a=line, t=sampled(tank, 0.5, "euler")))


def test_a_list_of_expressions_is_a_column():
    @law(y=Output("1", shape=(3,)))
    def three(a=Input("1"), b=Input("1")):
        return [a, a * b, b]

    assert np.ravel(three(a=2.0, b=5.0)["y"]).tolist() == [2, 10, 5]
    assert np.ravel(np.array(three.f([], [2.0, 5.0], [])[1])).tolist() == [2, 10, 5]


def test_the_part_that_waits_for_itself_is_found_from_any_other():
    missing = {"a": [("b", "y"), ("a", "y")], "b": [("c", "y")], "c": [("d", "y")],
               "d": [("c", "y")]}  # fmt: skip
    assert _on_circle(missing) == "c"
    assert _on_circle({"a": [("a", "y")]}) == "a"


def test_a_shared_number_without_a_value_has_none_and_what_follows_from_it_neither():
    @law(y=Output("kg"))
    def heavy(u=Input("1"), m=Param("kg", None, "mass"), J=Param("kg", None, "twice")):
        return u * (m + J)

    share = {"m": ["a.m", "b.m"], "J = 2*m": ["a.J", "b.J"]}
    loop = connect("loop", {}, a=heavy, b=heavy, share=share)
    assert numbers_of("loop", loop.sharing.shares) == {"m": None, "J": None}
    with pytest.raises(BadInput, match=r"loop\.m has no value; set it, in kg"):
        loop.param_values()
    found = loop.with_params(m=3.0)
    assert {n: float(v) for n, v in found.param_values().items()} == {"m": 3.0, "J": 6.0}
    assert numbers_of("loop", found.sharing.shares) == {"m": 3.0, "J": 6.0}


@step(period=0.1, y=Output("1"))
def copied(
    z=State("1", "k", "a number for each copy", shape=(3, 2)),
    w=State("1", "q", "one for all", shape=(2, 3)),
    k=Param("1", (5.0, 7.0), "start", shape=(2,)),
    q=Param("1", 4.0, "start"),
):
    return dict(z=z, w=w), dict(y=z[0] + w[0] + k[0] + q)


def test_a_start_for_each_copy_fills_its_column():
    p = {"k": ca.SX.sym("k", 2), "q": ca.SX.sym("q")}
    found = copied.symbolic_start(p)
    read = {n: np.array(ca.Function("f", list(p.values()), [v])([5.0, 7.0], 4.0)).ravel().tolist()
            for n, v in found.items()}  # fmt: skip
    assert read == {"z": [5, 5, 5, 7, 7, 7], "w": [4] * 6}


def test_expressions_of_matrices_have_the_names_of_their_variables():
    """CasADi keeps some names for itself; the function of what is inside gives the sine of each."""

    @remember_locals
    def make():
        x, other = ca.MX.sym("x", 2), ca.MX.sym("other", 2)
        turned, jac = ca.cos(x), 3 * x
        foreign = turned * other  # noqa: F841
        _own = turned + jac
        return "f", [x], [turned + jac], ["x"], ["y"]

    f = make()
    inside = named_inside(f)
    assert inside is not None
    assert inside.name_out() == ["turned"]
    at = np.array([0.5, 2.0])
    assert np.ravel(np.array(f(at))) == pytest.approx(np.cos(at) + 3 * at)
    assert np.ravel(np.array(inside(at))) == pytest.approx(np.sin(np.cos(at)))


LETTERS = {"v": "m/s", "r": "m", "R": "m", "mu": "1", "w": "m"}
v, r, R, mu, w = (ca.SX.sym(n) for n in LETTERS)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (ca.if_else(mu > 0, v, r), "'v' [m/s] and 'r' [m] are no two branches of one if"),
        (ca.if_else(r > R, mu, v), "'mu' [1] and 'v' [m/s] are no two branches of one if"),
        (ca.if_else(mu > 0, v, ca.if_else(mu > 1, r, R)),
         "'v' [m/s] and 'r' [m] are no two branches of one if"),
        (1.5 - v, "'v' [m/s] cannot be subtracted from '1.5' [1]; give the number its unit, as a"
                  " Param or by one('...')"),
        (v - 1.5, "'1.5' [1] cannot be subtracted from 'v' [m/s]; give the number its unit, as a"
                  " Param or by one('...')"),
        (ca.sign(v) - v, "'v' [m/s] cannot be subtracted from 'sign(v)' [1]"),
        ((v < 2 * v) - v, "'v' [m/s] cannot be subtracted from 'v < 2*v' [1]"),
        (ca.exp(mu) - v, "'v' [m/s] cannot be subtracted from 'exp(mu)' [1]"),
        (ca.copysign(v, r) - r, "'r' [m] cannot be subtracted from 'copysign(v, r)' [m/s]"),
        (v**2 - v, "'v' [m/s] cannot be subtracted from 'v^2' [m^2/s^2]"),
        (ca.sqrt(v) - v, "'v' [m/s] cannot be subtracted from 'sqrt(v)' [m^0.5/s^0.5]"),
        (1 / v - v, "'v' [m/s] cannot be subtracted from '1/v' [s/m]"),
        (v / r - v, "'v' [m/s] cannot be subtracted from 'v/r' [1/s]"),
        (r * R - v, "'v' [m/s] cannot be subtracted from 'r*R' [m^2]"),
        (ca.fabs(v) - r, "'r' [m] cannot be subtracted from 'abs(v)' [m/s]"),
        (ca.atan2(v, r), "'v' [m/s] and 'r' [m] span no angle"),
    ],
)  # fmt: skip
def test_two_values_that_do_not_fit_are_told_in_their_order(made, said):
    (line_,) = check({"y": made}, LETTERS, {})
    assert line_.partition(": ")[2] == said


def test_the_first_symbol_may_be_the_last_branch():
    """Its node has the number 0."""
    g = formula.graph({"first": r, "y": ca.if_else(mu > 0, v, r)})
    assert g.nodes[0].name in LETTERS
    for first in (v, r, mu, R):
        made = {"first": first, "y": ca.if_else(mu > R / w, v, r)}
        (line_,) = check(made, LETTERS, {})
        assert line_.endswith("'v' [m/s] and 'r' [m] are no two branches of one if")
