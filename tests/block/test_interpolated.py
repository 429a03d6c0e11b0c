"""Tables in equations are straight lines between points, as scipy's; units and words as written."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from slipctl import BadInput, interpolated
from slipctl.block.text.expression import read
from slipctl.block.units.unit_algebra import factor, parse_quantity
from slipctl.errors import Faults

PLACES = st.lists(st.integers(-40, 40), min_size=1, max_size=5, unique=True).map(sorted)


@given(PLACES, st.data())
def test_over_one_axis_it_is_numpys(places, data):
    xs = [k / 8 for k in places]
    ys = data.draw(st.lists(st.integers(-9, 9), min_size=len(xs), max_size=len(xs)))
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [interpolated(x, xs, ys)])
    for at in (*xs, *np.linspace(-6.0, 6.0, 9)):
        assert float(f(at)) == pytest.approx(np.interp(at, xs, ys), abs=1e-12)
        assert float(interpolated(float(at), xs, ys)) == pytest.approx(float(f(at)), abs=1e-12)


@given(PLACES.filter(lambda p: len(p) > 1), PLACES.filter(lambda p: len(p) > 1), st.data())
def test_over_two_axes_it_is_scipys_between_the_ends(first, second, data):
    """Heights as lists of rows and as a matrix of parameters; beyond the ends the end holds."""
    xs, zs = [k / 8 for k in first], [k / 4 for k in second]
    row = st.lists(st.integers(-9, 9), min_size=len(zs), max_size=len(zs))
    ys = data.draw(st.lists(row, min_size=len(xs), max_size=len(xs)))
    wanted = RegularGridInterpolator((xs, zs), np.array(ys, dtype=float))
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    for heights in (ys, ca.SX(ca.DM(ys)), np.array(ys, dtype=float)):
        f = ca.Function("f", [x, z], [interpolated((x, z), (xs, zs), heights)])
        for at in ((-7.0, 3.0), (0.3, -11.0), (xs[0], zs[-1]), (0.7, 0.6), (9.0, 20.0)):
            held = np.clip(at[0], xs[0], xs[-1]), np.clip(at[1], zs[0], zs[-1])
            assert float(f(*at)) == pytest.approx(float(np.ravel(wanted(held))[0]), abs=1e-12)


@pytest.mark.parametrize("nan", [math.nan, np.float64("nan"), np.array([np.nan]), ca.DM(np.nan)])
def test_where_the_place_is_no_number_there_is_no_height(nan):
    """fmin and fmax give the other argument, so a table would give one of its heights."""
    xs, rows = [0, 1], [[1, 2], [3, 4]]
    for height in (interpolated(nan, xs, rows[0]), interpolated((0.5, nan), (xs, xs), rows),
                   interpolated((nan, 0.5), (xs, xs), rows)):  # fmt: skip
        assert math.isnan(float(height))
    many = np.array([math.nan, 0.5, math.inf, -math.inf])
    np.testing.assert_array_equal(np.ravel(interpolated(many, xs, [1, 2])), [math.nan, 1.5, 2, 1])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("a", [0, 1], [0, 1]), "str is no number and no expression"),
        ((10**400, [0, 1], [0, 1]), "interpolated: the place"),
        ((0.5, [0, 1], [0, 1, 2]), "2 places and 3 values"),
        ((0.5, [], []), "no places; give at least one"),
        ((0.5, [0, 2, 1], [0, 1, 2]), "the place 1 comes after 2"),
        ((0.5, [0, 1, 1], [0, 1, 2]), "the place 1 comes after 1"),
        ((0.5, "01", [0, 1]), "is no list of numbers"),
        ((0.5, 3, [0, 1]), "is no list of numbers"),
        (((0.5, 1, 2), ([0, 1], [0, 1]), [[0, 1], [2, 3]]), "give one number and its places"),
        (((0.5, 1), [0, 1], [[0, 1], [2, 3]]), "is no list of numbers"),
        (((0.5, 1), 3, [[0, 1], [2, 3]]), "give one number and its places"),
        (((0.5, 1), ([0, 1], [0, 1], [0, 1]), [[0, 1], [2, 3]]), "give one number and its places"),
        (((0.5, 1), ([0, 1], [0, 1]), [[0, 1]]), "1 rows of 2 values over 2 and 2 places"),
        (((0.5, 1), ([0, 1], [0, 1]), [[0, 1], [2]]), "2 rows of 1, 2 values over 2 and 2 places"),
    ],
)
def test_no_table_is_refused(given, said):
    with pytest.raises(BadInput, match=said):
        interpolated(*given)


WORDS = {
    "x > 1 and y > 1": lambda x, y: x > 1 and y > 1, "x > 1 or y > 1": lambda x, y: x > 1 or y > 1,
    "not x > 1": lambda x, y: not x > 1, "0 < x <= y": lambda x, y: 0 < x <= y,
    "x > 0 and y > 0 and x > y": lambda x, y: x > 0 and y > 0 and x > y,
    "x == y or x < 0 or y < 0": lambda x, y: x == y or x < 0 or y < 0,
    "x != y": lambda x, y: x != y, "y if x >= 1 else x": lambda x, y: y if x >= 1 else x,
    "min(x, y, 1)": lambda x, y: min(x, y, 1), "max(x, y, 1)": lambda x, y: max(x, y, 1),
    "clip(x, 0, y + 3)": lambda x, y: min(max(x, 0), y + 3), "abs(x)": lambda x, y: abs(x),
    "fmod(x + 4, 3)": lambda x, y: math.fmod(x + 4, 3), "atan2(x, y)": math.atan2,
    "root(x*x)": lambda x, y: abs(x), "-x + +y": lambda x, y: y - x,
    "2*pi*x": lambda x, y: x * math.tau,
    "one('km/h')*x": lambda x, y: x, "floor(x/2) + ceil(y/2)": lambda x, y: x // 2 - (-y // 2),
    "interp(x, [0, 1], [y, 2])": lambda x, y: y + (2 - y) * min(max(x, 0), 1),
}  # fmt: skip


@pytest.mark.parametrize("text", WORDS)
def test_a_word_of_an_expression_is_what_python_has(text):
    tree = read(text)
    names = [ca.SX.sym("x"), ca.SX.sym("y")]
    f = ca.Function("f", names, [tree.value({"x": names[0], "y": names[1]})])
    for x in (-2.0, 0.0, 1.0, 2.0):
        for y in (-2.0, 1.0, 2.5):
            assert float(f(x, y)) == pytest.approx(float(WORDS[text](x, y)), abs=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("exp(3 kg)", "column 5: a number has no unit here; make it a parameter"),
        ("(1.5e3 N*x)", "a number has no unit here"),
        ("3 kg", "column 3: write * for a product"),
        ("~x", "~ has no place here; write not"),
        ("x and y > 1", "column 1: a condition is a comparison"),
        ("y > 1 or x", "column 10: a condition is a comparison"),
        ("not x", "a condition is a comparison"),
        ("one(x)", "one takes a unit in quotes"),
        ("one(3)", "one takes a unit in quotes"),
        ("interp(x, [0, 1], 3)", "interp takes two lists"),
        ("interp(x, [0], [1])", "interp takes two lists"),
        ("interp(x^2, [0, 1], [1, y % 2])", "write fmod"),
        ("interp(x, [0, 1, 1], [1, 2, 3])", "must increase"),
        ("  ", "there is no expression"),
    ],
)
def test_what_is_no_expression_says_where(text, said):
    with pytest.raises(Faults) as told:
        read(text)
    assert any(said in line for line in told.value.lines), told.value.lines


UNITS = {
    "m^(1/2)": ("m^.5", 1.0), "m^(2)": ("m2", 1.0), "km/h": ("m/s", 1 / 3.6),
    "kg m2": ("kg m^2", 1.0), "m**2": ("m2", 1.0),
    "°": ("rad", math.pi / 180), "mNm": ("N m", 1e-3), "kNm": ("N m", 1e3), "MNm": ("N m", 1e6),
    "Nm": ("kg m^2/s^2", 1.0), "km": ("m", 1e3), "t": ("kg", 1e3), "bar": ("Pa", 1e5),
    "kPa": ("N/m^2", 1e3), "min": ("s", 60.0), "%": ("1", 0.01), "‰": ("1", 1e-3),
    "(m/s)^2": ("m^2/s^2", 1.0), "N m s/rad": ("N m s", 1.0), "rpm": ("rad/s", math.pi / 30),
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_is_so_many_of_another(unit):
    other, number = UNITS[unit]
    assert factor(unit, other) == pytest.approx(number, rel=1e-14)
    assert parse_quantity(f"2.5 {unit}", other) == pytest.approx(2.5 * number, rel=1e-14)


def test_a_gradient_may_be_told_as_one_in_so_many():
    assert parse_quantity("1 in 25", "1") == 0.04
    assert parse_quantity("-1 in 40", "‰") == pytest.approx(-25.0, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("m^(1/2", "a bracket is not closed"),
        ("m^(1/0)", "an exponent must be a number"),
        ("m^(1/", "an exponent must be a number"),
        ("m^", "an exponent must be a number"),
        ("m^s", "an exponent must be a number"),
        ("°C", "a scale with an offset; write K"),
        ("degC", "offset"),
        ("m^100", "beyond reason"),
        ("m^.0001", "beyond reason"),
        ("Gm^60", "beyond what a number can hold"),
        ("2 m", "the number 2 has no place in a unit"),
        ("m/", "a name is missing at its end"),
        ("m/*s", "a name is missing before"),
    ],
)
def test_no_unit_is_refused(unit, said):
    with pytest.raises(BadInput, match=said):
        factor(unit, "m")
