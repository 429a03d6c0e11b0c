"""Declarations that mean nothing are refused by a line that names them and what is wanted."""

from __future__ import annotations

import math

import casadi as ca
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    State,
    connect,
    flow,
    from_text,
    gated,
    interpolated,
    law,
    make_block,
    ranged,
    sampled,
    step,
)
from slipctl.block.block import Block
from slipctl.block.text.named_expressions import evaluate
from slipctl.block.units.unit_algebra import unit
from slipctl.ccode.module.layout import places_of


@law(y=Output("m", "out"))
def line(a=Input("m", "in"), k=Param("1", 2.0, "gain")):
    return k * a


@flow(y=Output("m", "out"))
def tank(x=State("m", 0.0, "level"), a=Input("m/s", "in")):
    return {"x": a}, {"y": x}


SIGNALS = [Input("1", "in").named("a"), Output("1", "out").named("y")]


def block(*more, body=lambda x, u, p: ({}, {"y": u["a"]}), kind="law"):
    return Block("b", kind, body, [*SIGNALS, *more])


def table_over(over, shape=(3,), rising=True):
    table = block(
        Param("1", (1.0,) * 3, "heights", shape=(3,), over=over).named("h"),
        Param("1", tuple(map(float, range(shape[0]))), "places", shape=shape, rising=rising).named(
            "at"
        ),
    )
    return places_of(table.params, "h")


BAD = {
    "no function": (lambda: block(body=3), r"its body is 3; give a function \(x, u, p\)"),
    "twice": (lambda: block(Input("1", "again").named("a")), "b declares 'a' twice"),
    "an output twice": (
        lambda: block(Output("1", "again").named("y")), "b declares the output 'y' twice"),
    "undeclared": (
        lambda: block(body=lambda x, u, p: ({}, {"y": u["a"], "z": u["a"]})).function(),
        "returns an undeclared output 'z'"),
    "no part": (lambda: connect("c", {"y": "l.y"}, l=line)["m"], "c has no part 'm'"),
    "no dict": (
        lambda: law(name="both", y=Output("m", "1"), z=Output("m", "2"))(
            lambda a=Input("m", "in"): a).function(),
        "must return a dict of its outputs y, z"),
    "no pair": (
        lambda: flow(y=Output("m", "1"), name="f")(
            lambda x=State("m", 0.0, "x"): {"x": 0}).function(),
        "f must return .dict of states, dict of outputs."),
    "places missing": (lambda: table_over("other"), "h is a table over 'other', which is no"),
    "places of another number": (lambda: table_over("at", (2,)), "declare at = Param.*shape=.3,"),
    "two axes": (lambda: table_over(("at", "at")), "is a table over 2 axes; name 1"),
    "a wire": (lambda: connect("c", {"l.a": "a b"}, l=line), "a wire ends at 'a b'; write part"),
    "two readings": (
        lambda: connect("c", {"y": "l.y", "z": "m.y"}, l=line, m=line).find("a", "input"),
        "'a' could be l.a or m.a; write which"),
    "ranged, no signal": (
        lambda: ranged(line, q=Param("1", 1.0, "x")), "ranged: line has no param 'q'"),
    "ranged, a unit": (
        lambda: ranged(line, k=Param("m", 1.0, "x")), "line.k is in 1, its range in m"),
    "ranged, a table": (
        lambda: ranged(line, table={"q": (0, 1, "why")}), "ranged: line has no signal 'q'"),
    "gated flow": (lambda: gated(tank, "on"), "a flow has no ticks; sampled.tank, h. first"),
    "gated twice": (
        lambda: gated(sampled(tank, 0.1, "rk4"), "a"), "it has a signal 'a'; name the gate"),
    "ends": (lambda: Param("1", 1.0, "x", lo=2, hi=1), "its range has lo = 2 above hi = 1"),
    "an end that is none": (lambda: Param("1", 1.0, "x", lo=math.nan), "lo is NaN.*leave it out"),
    "change": (lambda: Input("1", "x", change=0.0), "per tick is 0; give a positive number"),
    "shape": (lambda: Input("1", "x", shape=(0,)), r"shape \(0,\) has an extent below 1"),
    "places": (
        lambda: Param("1", 1.0, "x", rising=True), "places of a table have a shape .n,., n at"),
    "places that fall": (
        lambda: Param("1", (0.0, 2.0, 1.0), "x", shape=(3,), rising=True), "must rise"),
    "expression": (lambda: evaluate("a +* b", {}, "here"), "here: .* is not an expression"),
    "expression of another": (
        lambda: evaluate("v / rr", {"v": 1.0, "r": 2.0}, "here"), "uses 'rr'; did you mean 'r'"),
    "expression of nothing": (
        lambda: evaluate("v / r", {"v": ca.SX.sym("v", 2), "r": ca.SX.sym("r", 3)}, "here"),
        "here: .* cannot be computed"),
    "unit": (lambda: unit(3), "a unit is a text such as 'm/s.2', not 3"),
    "unit too large": (lambda: unit("km^99"), "'km.99' is beyond what a number can hold"),
    "interpolated, one of two": (
        lambda: interpolated((1.0, 2.0), (0.0, 1.0, 2.0), [1.0]), "or two and those of both"),
    "interpolated, rows": (
        lambda: interpolated((1.0, 2.0), ([0, 1], [0, 1]), [[1, 2]]), "1 rows of 2 values over 2"),
    "interpolated, text": (lambda: interpolated(1.0, "ab", [1]), "'ab' is no list of numbers"),
    "text": (lambda: from_text(3), "equations are a text such as 'mu = c.v_s', not 3"),
    "period": (lambda: from_text("x+ = a", period="-1 s"), "period '-1 s' must be positive"),
    "period of a law": (lambda: from_text("y = a", period="1 s"), "only a step, x. = ..., has a"),
    "start": (
        lambda: step(y=Output("m", "1"), name="s")(
            lambda x=State("m", "z", "x"), z=State("m", "x", "z"): ({"x": x, "z": z}, {"y": x})
        ).start(), "s.x: start value 'z' cannot be computed"),
    "no state": (lambda: tank.start(q=1), "tank has no state 'q'"),
    "order": (
        lambda: make_block("o", "law", lambda x, u, p: ({}, {"y": u["a"]}), inputs=SIGNALS[:1],
                           outputs=SIGNALS[1:], expects=("p > q",)).orders(),
        "expects 'p > q'; write 'p >= q' of two parameters"),
    "parameter of itself": (
        lambda: block(Param("1", "q + 1", "x").named("p"), Param("1", "p", "y").named("q"))
        .param_values(), "depends on itself"),
    "parameter of another": (
        lambda: block(Param("1", "pp + 1", "x").named("p")).param_values(), "uses 'pp'"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_it_is_refused_with_what_is_wanted(what):
    call, words = BAD[what]
    with pytest.raises(BadInput, match=words):
        call()


SIGNAL = [
    (lambda: Input("1", 3), "a signal: doc is a text, not 3"),
    (lambda: Param("1", 1.0, "k", source=5), "a signal: source is a text, not 5"),
    (lambda: Input("m/s", "a", positive="up"), "a has no sign convention 'up'"),
    (lambda: Input("m/s", "a", per="wheel"), "a has no slip convention 'wheel'"),
    (lambda: Input("1", "a", lo=math.nan), "a: lo is NaN"),
    (lambda: Input("1", "a", hi=math.nan), "a: hi is NaN"),
    (lambda: Input("1", "a", lo=2, hi=1), "its range has lo = 2 above hi = 1"),
    (lambda: Input("1", "a", change=0), "its largest change per tick is 0; give a positive"),
    (lambda: Input("1", "a", change=math.nan), "a: change is NaN"),
    (lambda: Input("1", "a", change=1, noise=-1), "noise = -1 is no finite number from 0 on"),
    (lambda: Input("1", "a", change=1, noise=math.inf), "noise = inf is no finite number"),
    (lambda: Input("1", "a", noise=1), "noise widens the limit on the change of a tick"),
    (lambda: Input("1", "a", stale=-1), "stale = -1 must be a whole number >= 0"),
    (lambda: Input("1", "a", stale=1.5), "stale = 1.5 must be a whole number >= 0"),
    (lambda: Input("1", "a", shape=(0,)), r"shape \(0,\) has an extent below 1"),
    (lambda: Input("1", "a", shape=(2.5,)), r"shape \(2.5,\) has an extent below 1"),
    (lambda: Input("1", "a", shape=[2]), r"shape \[2\] has an extent below 1"),
    (lambda: Param("1", 1.0, "k", rising=True), r"places of a table have a shape \(n,\)"),
    (lambda: Param("1", (1.0,), "k", shape=(1,), rising=True), "places of a table have a shape"),
    (lambda: Param("1", ((1.0, 2.0), (3.0, 4.0)), "k", shape=(2, 2), rising=True),
     "places of a table have a shape"),
    (lambda: Param("1", (1.0, 1.0), "k", shape=(2,), rising=True), "k goes from 1 to 1 1; the"),
    (lambda: Param("1", (0.0, 3.0, 2.0), "k", shape=(3,), rising=True), "k goes from 3 to 2 1"),
    (lambda: Param("1", math.nan, "k"), "k is NaN; give a number in"),
    (lambda: Param("1", math.inf, "k"), "k is infinite; give a number in"),
    (lambda: Param("1", 1.5, "k", lo=0, hi=1).named("k").check("k", 1.5),
     r"k = 1.5 is out of range; it must lie in \[0, 1\]"),
    (lambda: Param("m", (1.0, 9.0, -3.0), "k", shape=(3,), lo=0, hi=1).check("k", (1.0, 9.0, -3.0)),
     r"k = 9 m is out of range; it must lie in \[0, 1\] m"),
    (lambda: line.expr({}, {"a": "one"}, {"k": 1.0}), "the input 'a' is no expression"),
    (lambda: line.expr({}, {}, {"k": 1.0}), "the input 'a' is no expression"),
    (lambda: line.expr({}, {"a": 1.0}, {"k": None}), "the param 'k' is no expression"),
    (lambda: line.expr({}, 3, {"k": 1.0}), "give each input by name"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "said"), SIGNAL)
def test_a_signal_that_means_nothing_is_refused(made, said):
    with pytest.raises(BadInput, match=said):
        made()


def test_what_breaks_in_a_body_is_told_as_it_is():
    def breaks(x, u, p):
        raise TypeError("of the body")

    with pytest.raises(TypeError, match="of the body"):
        block(body=breaks).expr({}, {"a": 1.0}, {})


def test_a_long_expression_is_quoted_in_short():
    text = " + ".join(["zz"] * 60)
    with pytest.raises(BadInput) as refused:
        evaluate(text, {}, "here")
    assert "..." in str(refused.value)
    assert len(str(refused.value)) < 110
