"""Blocks that are changed, copied or put into others keep what is theirs and lose what was."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, from_text, law, step
from slipctl.block import connection
from slipctl.block.block import Block
from slipctl.block.transforms.asked_outputs import asked_outputs, inner_outputs
from slipctl.block.transforms.replication import signal_of_copies
from slipctl.block.units.unit_algebra import factor, refuse_count
from slipctl.block.units.unit_walk import check, infer
from slipctl.errors import Faults


@law(mu=Output("1"), conditions={"dry": {"k": 0.4}, "wet": {"k": 0.2}})
def curve(
    s=Input("1", lo=-3, change=9.0, noise=0.1), k=Param("1", 0.3, lo=0, hi=1), q=Param("1", 2.0)
):
    return k * q * s


def test_a_law_with_another_number_loses_the_conditions_that_set_it():
    assert curve.with_params(k=0.5).conditions == {}
    assert curve.with_params(q=3.0).conditions == {"dry": {"k": 0.4}, "wet": {"k": 0.2}}
    loop = connect("loop", {}, a=curve)
    assert loop.with_params(**{"a.k": 0.5})["a"].conditions == {}
    assert curve.with_conditions(ice={"k": 0.1}).conditions == {"ice": {"k": 0.1}}
    for values, said in (
        ({"k": 1.5}, "curve, condition 'ice': k"),
        ({"z": 1.0}, "no parameter 'z'"),
    ):
        with pytest.raises(BadInput, match=said):
            curve.with_conditions(dry={"k": 0.4}, ice=values)
    with pytest.raises(BadInput, match="loop has parts by name, none by 3"):
        _ = loop[3]


def test_ends_of_a_signal_are_those_that_it_has():
    assert curve.ends(curve.inputs["s"], {}) == ([-3], [], [9.0], [0.1])
    assert curve.ends(curve.params["k"], {}) == ([0], [1], [], [])
    with pytest.raises(BadInput, match="is not an expression"):
        Input("1", "x", lo="a +* b")
    with pytest.raises(BadInput, match="kind"):
        Block("b", 3, lambda x, u, p: ({}, {}), [])  # type: ignore[arg-type]
    with pytest.raises(BadInput, match=r"curve\.jacobian"):
        curve.jacobian(3, "s")  # type: ignore[arg-type]


@law(y=Output("m"))
def first(a=Input("m"), t=Input("s")):
    return a - t


@law(y=Output("m"))
def second(a=Input("m"), t=Param("s", 2.0), d=Param("m", "2*t")):
    return a + d


@law(y=Output("m"))
def good(a=Input("m")):
    return 2 * a


def test_units_of_all_parts_are_told_and_of_what_is_derived():
    """With the name of each part; a length of twice a time is none."""
    told = connect("loop", {}, a=first, b=good, c=second).check_units()
    assert told == ["first: in y = a - t: 't' [s] cannot be subtracted from 'a' [m]",
                    "second: in d = 2*t: this is [s], not [m]"]  # fmt: skip
    assert connect("loop", {}, b=good).check_units() == []


def test_units_are_told_in_the_words_of_the_block():
    """N m where somebody has it so; else by their usual names."""
    import casadi as ca

    F, r, v = (ca.SX.sym(n) for n in "Frv")
    given = {"F": "N", "r": "m", "v": "m/s"}
    assert check({"y": F * r - v}, given, {}) == [
        "in y = F*r - v: 'v' [m/s] cannot be subtracted from 'F*r' [N m]"]  # fmt: skip
    own = given | {"W": "J"}
    assert check({"y": F * r - v}, own, {}) == [
        "in y = F*r - v: 'v' [m/s] cannot be subtracted from 'F*r' [J]"]  # fmt: skip
    assert infer({"y": F * r, "z": 0 * F, "w": v / v}, own) == {"y": "J", "z": "1", "w": "1"}
    refuse_count(" U/min ")
    assert factor("U/min", "rad/s") == pytest.approx(2 * np.pi / 60)
    with pytest.raises(BadInput, match="may count revolutions"):
        refuse_count(" 1/min ")


def test_equations_of_parts_are_written_out_inside_alone():
    assert connection._inlined.get() is False
    with connection.parts_inlined():
        assert connection._inlined.get() is True
    assert connection._inlined.get() is False


@step(period=0.1, y=Output("1"))
def begins(z=State("1", 1.0), k=Param("1", 5.0)):
    return dict(z=z), dict(y=z * k)


@step(period=0.1, y=Output("1"))
def plain(k=Param("1", 7.0), m=Param("1", (1.0, 2.0, 3.0), shape=(3,)),
          J=Param("1", (2.0, 4.0, 6.0), shape=(3,))):  # fmt: skip
    return {}, dict(y=k + m[0] + J[1])


def test_a_state_that_begins_with_a_shared_number_is_known_at_every_depth():
    inner = connect("inner", {}, a=begins, p=plain, share={"n": ["a.z", "p.k"]})
    sharing = connect("outer", {}, i=inner, c=plain).sharing
    assert sharing.aliases == {"i.a.z": "i.n", "i.p.k": "i.n"}
    assert (sharing.owners, sharing.begun, sharing.between) == ({"i.a.z"}, {"i.n"}, set())
    outer = connect("outer", {}, i=inner, c=plain, share={"n": ["i.n", "c.k"]})
    assert outer.sharing.aliases == {"i.n": "n", "c.k": "n", "i.a.z": "n", "i.p.k": "n"}
    assert (outer.sharing.owners, outer.sharing.begun) == ({"i.n", "i.a.z"}, {"n"})
    assert outer.sharing.between == {"i.n"}
    top = connect("top", {}, o=outer, d=plain)
    assert top.sharing.between == {"o.i.n"}
    assert top.sharing.owners == {"o.i.n", "o.i.a.z"}
    assert top.sharing.begun == {"o.n"}
    found = top.with_params(**{"o.n": 3.0})
    assert float(found.start()["o.i.a.z"]) == 3.0


def test_what_is_computed_of_a_vector_is_one():
    share = {"m": ["a.m", "b.m"], "J = 2*m": ["a.J", "b.J"]}
    loop = connect("loop", {}, a=plain, b=plain, share=share)
    assert loop.params["J"].shape == (3,)
    found = loop.with_params(m=(5.0, 6.0, 7.0)).param_values()
    assert found["J"].tolist() == [10, 12, 14]


def test_a_start_off_its_range_is_told_of_a_text():
    text = "x' = -x/T where x [1] = q - 3 in 0 .. 9, q = {}, T = 2 s"
    assert float(from_text(text.format(4)).start()["x"]) == 1.0
    with pytest.raises(Faults, match="x"):
        from_text(text.format(1))


def test_a_block_without_its_inner_outputs_is_made_again_without_them():
    loop = connect("loop", {"b.a": "a.y", "out": "b.y"}, a=good, b=second)
    assert inner_outputs(loop) == ["a.y", "b.y"]
    asked = asked_outputs(loop)
    assert list(asked.outputs) == ["out"]
    again = asked.with_params(**{"b.t": 5.0})
    assert list(again.outputs) == ["out"]
    assert float(again(**{"a.a": 1.0})["out"]) == 12.0
    assert asked_outputs(good) is good


def test_copies_of_a_signal_have_a_column_each():
    def copies(signal):
        made = signal_of_copies(signal.named("k"), 3)
        return made.shape, made.axis, np.asarray(made.value).tolist()

    assert copies(Param("1", (1.0, 2.0), shape=(2,))) == ((2, 3), "axle", [[1] * 3, [2] * 3])
    assert copies(Param("1", 4.0)) == ((3,), "axle", 4.0)
    assert copies(Param("1", ((1.0, 2.0), (3.0, 4.0)), shape=(2, 2))) == (
        (2, 6), "", [[1, 2, 1, 2, 1, 2], [3, 4, 3, 4, 3, 4]])  # fmt: skip
    assert copies(Param("1", None, shape=(2,)))[:2] == ((2, 3), "axle")
