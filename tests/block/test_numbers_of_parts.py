"""Numbers of the parts of a loop: shared ones, those set apart, and what a name means."""

from __future__ import annotations

import re

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, law, step
from slipctl.block.shared_numbers import differences, targets, warnings_of_places


@law(y=Output("1"))
def first(
    u=Input("1"), m=Param("kg", 10.0, lo=1, hi=50), k=Param("1", 2.0), own=Param("1", 7.0),
    row=Param("1", (1.0, 2.0), shape=(2,)), twice=Param("kg", "2*m"),
):  # fmt: skip
    """A law."""
    return u * m * k * row[0] + own + twice


@step(period=0.01, y=Output("1"))
def second(
    n=State("kg", 3.0), u=Input("1"), m=Param("kg", 10.0, lo=5, hi=90), k=Param("1", 2.0),
    row=Param("1", (1.0, 2.0), shape=(2,)), tonnes=Param("t", 1.0),
    wide=Param("1", (1.0,) * 3, shape=(3,)),
):  # fmt: skip
    """A step."""
    return dict(n=n), dict(y=u * m * k * row[1] + tonnes + wide[0])


def loop(shares, **parts):
    made = {"a": first, "b": second} | parts
    return connect("loop", {"b.u": "a.y"}, share=shares, **made)


BOTH = {"m": ["a.m", "b.m"]}


def test_a_number_that_is_set_apart_is_told_with_both_and_its_unit():
    """Not where it is the same number after all; of a vector without its numbers."""
    made = loop(BOTH | {"row": ["a.row", "b.row"], "k": ["a.k", "b.k"]})
    assert warnings_of_places(made) == []
    apart = made.with_params(**{"a.m": 12.0})
    assert differences(apart) == {"a.m": "m"}
    assert warnings_of_places(apart) == ["a.m differs from m: 12 kg, not 10 kg"]
    assert warnings_of_places(apart.with_params(m=12.0)) == []
    assert warnings_of_places(made.with_params(**{"b.k": 3.0})) == ["b.k differs from k: 3, not 2"]
    many = apart.with_params(m=12.0, **{"b.k": 3.0})
    assert warnings_of_places(many) == ["b.k differs from k: 3, not 2"]
    vector = made.with_params(**{"a.row": (3.0, 4.0)})
    assert warnings_of_places(vector) == ["a.row differs from row"]
    many = made.with_params(**{"b.k": 3.0, "a.m": 12.0, "b.row": (9.0, 9.0)})
    assert sorted(line.split()[0] for line in warnings_of_places(many)) == ["a.m", "b.k", "b.row"]


def test_a_number_in_a_part_of_a_part_that_is_set_apart_is_told_by_its_path():
    inner = loop(BOTH)
    outer = connect("outer", {}, x=inner, y=inner).with_params(**{"y.b.m": 20.0})
    assert differences(outer) == {"y.b.m": "y.m"}
    assert warnings_of_places(outer) == ["y.b.m differs from y.m: 20 kg, not 10 kg"]
    assert float(outer.param_values()["x.m"]) == 10.0


@pytest.mark.parametrize(
    ("name", "meant"),
    [("m", ["m"]), ("a.own", ["a.own"]), ("own", ["a.own"]), ("tonnes", ["b.tonnes"]),
     ("n", ["b.n"]), ("b.n", ["b.n"]), ("*.m", ["m"]), ("a.m", ["a.m"]), ("nothing", []),
     ("*.nothing", []), ("*.row", ["a.row", "b.row"]), ("b.*n*", ["b.n", "b.tonnes"])],
)  # fmt: skip
def test_a_name_means_the_number_that_it_ends_in(name, meant):
    assert sorted(targets(loop(BOTH), name)) == meant


def test_a_name_of_several_numbers_and_a_role_that_it_has_not():
    made = loop(BOTH)
    with pytest.raises(
        BadInput, match=r"'row' could be a\.row or b\.row; write which, or '\*\.row'"
    ):
        targets(made, "row")
    assert targets(made, "n", ("param",)) == []
    assert targets(made, "own", ("state",)) == []
    assert targets(made.with_params(**{"a.m": 12.0}), "m") == ["m"]
    with pytest.raises(BadInput, match=r"matches 1 of the 2 places of m; write m= for all"):
        targets(made, "a.*m")


SHARES = [
    ({"m": ["a.m", "c.m"]}, "names c.m, but there is no part 'c'"),
    ({"m": ["a.m", "b.mm"]}, "names b.mm, but b has no 'mm'; did you mean 'm'"),
    ({"m": ["a.m", "b.tonnes"]}, "b.tonnes is in t, a.m in kg; write both in one unit"),
    ({"k": ["a.k", "b.m"]}, "b.m is in kg, a.k in 1; write both in one unit"),
    ({"row": ["a.row", "b.wide"]}, r"b.wide has shape (3,), a.row (2,)"),
    ({"m": ["b.m", "a.twice"]}, "a.twice is derived, 2*m; share what it depends on"),
    ({"m": 3}, "share 'm': 3; write 'm': ['car.m', 'ctl.m']"),
    ({"m m": ["a.m", "b.m"]}, "share 'm m'"),
    ({"m": ["a.m", 3]}, "write 'm': ['car.m', 'ctl.m']"),
]  # fmt: skip


@pytest.mark.parametrize(("shares", "said"), SHARES)
def test_places_that_cannot_have_one_number_are_refused(shares, said):
    with pytest.raises(BadInput, match=re.escape(said)):
        loop(shares)


def test_what_a_part_shares_itself_is_named_by_its_share():
    inner = loop(BOTH)
    with pytest.raises(BadInput, match=r"names x\.a\.m, which x shares as m; write x\.m"):
        connect("outer", {}, share={"mass": ["x.a.m", "y.m"]}, x=inner, y=first)
    made = connect("outer", {}, share={"mass": ["x.m", "y.m"]}, x=inner, y=first)
    values = made.with_params(mass=20.0)
    for path, leaf in values.leaves():
        assert float(np.ravel(values.values_by_place()[f"{path.replace('/', '.')}.m"])[0]) == 20.0
        assert leaf.params


def test_a_list_of_numbers_is_shared_by_each_of_its_places():
    made = loop({"row": ["a.row", "b.row"]}).with_params(row=[3.0, 4.0])
    assert made.param_values()["row"] == pytest.approx([3.0, 4.0])
    by_place = made.values_by_place()
    assert [list(by_place[f"{n}.row"]) for n in "ab"] == [[3.0, 4.0]] * 2
