"""Each thing that a block, a unit or a text cannot be is refused in one line that says so."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, connect, flow, from_text, law
from slipctl.block.signals import real_array
from slipctl.block.text import equations, expression
from slipctl.block.transforms.distance import over_distance
from slipctl.block.units.unit_algebra import parse_quantity, read_range
from slipctl.errors import Faults


@flow(F=Output("N"))
def car(
    v=State("m/s", 20.0, "speed"),
    x=State("m", 0.0, "way"),
    a=Input("m/s^2", "acceleration"),
    m=Param("kg", 2.0, "mass", lo=1),
):
    """A car."""
    return dict(v=a, x=v), dict(F=m * a)


def test_over_distance_a_car_needs_its_time_and_gains_its_speed() -> None:
    """Per metre: 1/v seconds, and a/v of speed; below the least speed as at it."""
    there = over_distance(car, "v", 2.0)
    n, y = there(v=8.0, x=3.0, clock=1.0, a=4.0)
    assert {k: float(e) for k, e in n.items()} == {"v": 0.5, "x": 1.0, "clock": 0.125}
    assert float(y["F"]) == 8.0
    n, _ = there(v=0.5, x=3.0, clock=1.0, a=4.0)
    assert {k: float(e) for k, e in n.items()} == {"v": 2.0, "x": 0.25, "clock": 0.5}
    assert there.states["clock"].value == 0.0
    assert there.states["clock"].unit == "s"
    heavy = there.with_params(m=5.0)
    assert float(heavy(v=8.0, x=3.0, clock=1.0, a=4.0)[1]["F"]) == 20.0


@flow(y=Output("s"))
def timed(v=State("m/s", 20.0), clock=State("s", 0.0)):
    return dict(v=0, clock=1), dict(y=clock)


@law(y=Output("m/s"))
def same(u=Input("m/s")):
    return u


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: over_distance(same, "u", 1.0), "it is a law; give the flow, not yet sampled"),
        (lambda: over_distance(car, "x", 1.0), r"x \[m\] is no speed; name a scalar state in m/s"),
        (lambda: over_distance(timed, "v", 1.0), "it has a state clock; rename it"),
        (lambda: over_distance(car, "v", 0.0), r"over_distance\(car\): least"),
        (lambda: over_distance(car, "v", -1.0), r"over_distance\(car\): least"),
        (lambda: over_distance(car, "w", 1.0), "w"),
        (lambda: read_range("34t", "42", "kg", "m"), "m: 34t:42 has a unit at one end"),
        (lambda: read_range("34", "42 t", "kg", "m"), "write '34 t' or '34 kg'"),
        (lambda: parse_quantity("1 in 0", "1", "rail.i"), "no gradient; write '1 in 25'"),
        (lambda: expression.read("(" * 300 + "1" + ")" * 300), "nested"),
        (lambda: expression.read("9" * 1999), "nested|number"),
    ],
)  # fmt: skip
def test_it_is_refused_in_one_line(make, said) -> None:
    with pytest.raises((BadInput, Faults), match=said) as told:
        make()
    assert "\n" not in str(told.value)


def test_ends_in_the_declared_unit_need_none_and_zero_never_does() -> None:
    assert read_range("34", "42", "kg", "m") == (34, 42)
    assert read_range("34 t", "42 t", "kg", "m") == (34000, 42000)
    assert read_range("0", "42 t", "kg", "m") == (0, 42000)
    assert read_range("-1 t", "0", "kg", "m") == (-1000, 0)


@pytest.mark.parametrize(("text", "value"), [("1 in 25", 0.04), ("-1 in 40", -0.025)])
def test_a_gradient_is_a_pure_number(text, value) -> None:
    assert parse_quantity(text, "1") == pytest.approx(value)
    with pytest.raises(BadInput, match="another dimension"):
        parse_quantity(text, "kg")


def test_a_number_that_no_float_holds_is_no_real_number() -> None:
    with pytest.raises(ValueError, match="beyond what a float holds"):
        real_array(10**400)
    for wrong in ("3", 1j, ["a"]):
        with pytest.raises(TypeError, match="no real number"):
            real_array(wrong)
    assert real_array(ca.DM([[1, 2]])).shape == (1, 2)
    assert real_array(ca.DM(3)).shape == ()
    assert np.array_equal(real_array([1, 2]), [1.0, 2.0])


def test_a_part_is_swapped_where_the_block_can_be_made_again() -> None:
    pair = connect("pair", {"a.u": "u", "y": "a.y"}, a=same)
    with pytest.raises(BadInput, match="pair has no part 'b'"):
        pair.swap("b", same)
    with pytest.raises(BadInput, match="same has no part 'b'"):
        same.swap("b", same)


@pytest.mark.parametrize(
    ("meaning", "said"),
    [
        ("k [kg] = 3 apples", "apples"), ("k = 3 m/s kg 4", "cannot be read"),
        ("k = 2*q", "cannot be read"),
        ("k [m/s] = 3 + + )", "3"), ("k = q*2", "is no number with a unit"),
    ],
)  # fmt: skip
def test_a_wrong_number_of_a_text_is_told(meaning, said) -> None:
    with pytest.raises(Faults, match=said):
        from_text(f"y = v*k where v [m/s], {meaning}")


def test_only_so_many_parts_of_an_equation_are_asked_for_their_units(monkeypatch) -> None:
    """Of those the innermost that does not fit is told; where none is asked, the whole is."""
    text = "y = 2*v*v + sin(m + v) where v [m/s], m [kg]"

    def told() -> str:
        with pytest.raises(BadInput) as error:
            from_text(text)
        return str(error.value)

    whole = told()
    monkeypatch.setattr(equations, "PLACES", 0)
    assert told() != whole
