"""Parts that run seldom, calls in texts, and what a block gives itself in numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, every, from_text, law, step
from slipctl.block.text import expression
from slipctl.block.text.meanings import _pieces, _split, _word
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.errors import Faults


@step(y=Output("1"))
def counter(n=State("1", 0.0), u=Input("1", value=1.0)):
    return dict(n=n + u), dict(y=n)


def test_a_part_of_a_part_that_runs_seldom_runs_more_seldom():
    """Every third run of what runs every second tick of 0.1 s: every sixth tick.

    The third of those runs is the first, and they begin in tick 1: in tick 5.
    """
    inner = connect("inner", {}, slow=every(counter, 3, 2), quick=counter)
    loop = connect("loop", {}, half=every(inner, 2, 1), whole=counter)
    loop = loop._copy(loop.signals, period=0.1)
    found = {p: runs_of_part(loop, p) for p in ("whole", "half", "half.quick", "half.slow")}
    assert {p: r.ticks for p, r in found.items()} == {
        "whole": 1, "half": 2, "half.quick": 2, "half.slow": 6}  # fmt: skip
    assert {p: round(r.period, 9) for p, r in found.items()} == {
        "whole": 0.1, "half": 0.2, "half.quick": 0.2, "half.slow": 0.6}  # fmt: skip
    assert {p: r.first for p, r in found.items()} == {
        "whole": 0, "half": 1, "half.quick": 1, "half.slow": 5}  # fmt: skip
    assert runs_of_part(connect("free", {}, a=every(counter, 4)), "a").period is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("interp(x @ 2, [0, 1], [3, 4])", "column 8"),
        ("interp(x, [0, 1, 2], [3, 4])", "equally long"), ("interp(x, [0], [3])", "two or more"),
        ("interp(x, [0, 2, 1], [3, 4, 5])", "must increase"),
        ("interp(x, [0, 1, 1], [3, 4, 5])", "must increase"), ("one(3)", "takes a unit in quotes"),
        ("one('foo')", "'foo' is no known unit"), ("interp(x, [0, 1], [3, 'a'])", "column 23"),
    ],
)  # fmt: skip
def test_a_call_is_looked_through(text, said):
    with pytest.raises(Faults, match=said):
        expression.read(text)


def test_a_table_in_a_text_is_straight_between_its_places():
    made = from_text("y = interp(x, [0, 1, 3], [2, 4, 0]) + interp(x, [a, 2*a], [1, 2])",
                     inputs={"x": "1"}, parameters={"a": "1"})  # fmt: skip
    assert [float(made(x=x)["y"]) for x in (-1.0, 0.5, 1.5, 9.0)] == [3.0, 4.0, 4.5, 2.0]


def test_a_plain_number_is_a_value():
    made = from_text("y = a*b*x", inputs={"x": "1"}, parameters={"a": 2, "b": 0.5})
    assert {n: float(v) for n, v in made.param_values().items()} == {"a": 2.0, "b": 0.5}
    assert made.params["a"].unit == "1"


@pytest.mark.parametrize(
    ("text", "pieces"),
    [
        ("a = 1, b [m/s], c = f(1, 2)", ["a = 1", " b [m/s]", " c = f(1, 2)"]),
        ("a = [1, (2, 3)], , b", ["a = [1, (2, 3)]", " b"]), ("a), b", ["a)", " b"]), ("", []),
        ("a,", ["a"]),
    ],
)  # fmt: skip
def test_pieces_stand_between_commas_outside_brackets(text, pieces):
    assert _pieces(text, ",") == pieces


def test_words_stand_alone():
    text = "y = on_x + where where a [1] on wet: a = 3 on dry: a = on.x"
    assert _split("y = onx where a [1] on wet: a = 3 on dry: b = 4", ("where", "on")) == [
        ("", "y = onx "), ("where", " a [1] "), ("on", " wet: a = 3 "),
        ("on", " dry: b = 4")]  # fmt: skip
    assert _split("on = 3 where x", ("where", "on")) == [("", "on = 3 "), ("where", " x")]
    assert _word("3 m in 1 .. 2 in", "in") == ("3 m ", "in", " 1 .. 2 in")
    assert _word("3 min", "in") == ("3 min", "", "")
    assert _split(text, ("nothing",)) == [("", text)]


def test_sparse_results_are_written_out():
    @law(y=Output("1", shape=(3,)), z=Output("1", shape=(2, 2)))
    def sparse(a=Input("1")):
        y, z = ca.SX(3, 1), ca.SX(2, 2)
        y[1], z[0, 1] = a, 2 * a
        return dict(y=y, z=z)

    found = sparse(a=3.0)
    assert np.ravel(found["y"]).tolist() == [0, 3, 0]
    assert np.asarray(found["z"]).tolist() == [[0, 6], [0, 0]]
    assert np.ravel(np.array(sparse.f([], [3.0], [])[1])).tolist() == [0, 3, 0, 0, 0, 6, 0]


@law(y=Output("1"))
def line(a=Input("1"), k=Param("1", 2.0), row=Param("1", (1.0, 2.0, 3.0), shape=(3,))):
    return k * a + row[1]


def test_arguments_of_functions_are_named_by_their_roles():
    assert line.function().name_in() == ["u_a", "p_k", "p_row"]
    stepped = counter.function()
    assert stepped.name_in() == ["x_n", "u_u"]
    J = counter.jacobian("y", ["n", "u"])
    assert np.ravel(np.array(J(3.0, 2.0))).tolist() == [1, 0]
    assert np.ravel(np.array(line.jacobian("y", ["row", "a"])(3.0, 2.0, [1, 2, 3]))).tolist() == [
        0, 1, 0, 2]  # fmt: skip


def test_shared_numbers_stay_where_a_part_is_another():
    @law(y=Output("kg"))
    def heavy(u=Input("1"), m=Param("kg", 3.0), J=Param("kg", 6.0)):
        return u * (m + J)

    loop = connect("loop", {}, a=heavy, b=heavy, share={"m": ["a.m", "b.m"], "J = 2*m": ["a.J",
                   "b.J"]})  # fmt: skip
    assert float(loop.param_values()["J"]) == 6.0
    with pytest.raises(BadInput, match=r"loop\.J is derived, 2\*m; set m"):
        loop.with_params(J=5.0)
    assert float(loop.with_params(m=9.0).param_values()["J"]) == 18.0
    other = loop.with_params(m=9.0).swap("a", heavy.with_params(m=4.0, J=1.0))
    assert {n: float(v) for n, v in other.param_values().items()} == {"m": 9.0, "J": 18.0}
    with pytest.raises(BadInput, match="c: a is no block"):
        connect("c", {}, a=3)  # type: ignore[arg-type]
