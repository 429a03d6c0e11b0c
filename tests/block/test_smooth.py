"""Corners: values and slopes there against closed-form limits."""

import math

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.block import smooth
from slipctl.block.units import unit_walk
from slipctl.errors import BadInput

EPS = 0.02
ULP = 4e-16  # relative error of a handful of operations in double

ROUNDED = {
    "sign": lambda x, e: smooth.sign(x, e),
    "root": lambda x, e: smooth.root(x, e),
    "magnitude": lambda x, e: smooth.magnitude(x, e),
    "minimum": lambda x, e: smooth.minimum(x, 0.5, e),
    "maximum": lambda x, e: smooth.maximum(x, 0.5, e),
    "sat": lambda x, e: smooth.sat(x, -1.0, 0.5, e),
}

EXACT = {
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
    "root": lambda x: math.copysign(math.sqrt(abs(x)), x),
    "magnitude": abs,
    "minimum": lambda x: min(x, 0.5),
    "maximum": lambda x: max(x, 0.5),
    "sat": lambda x: min(max(x, -1.0), 0.5),
}


def slope(f, at, e):
    x = ca.SX.sym("x")
    return float(ca.Function("d", [x], [ca.jacobian(f(x, e), x)])(at))


@pytest.mark.parametrize("name", ROUNDED)
@given(x=st.floats(-10, 10))
def test_without_rounding_the_value_is_exact_and_never_nan(name, x):
    assert ROUNDED[name](x, 0.0) == pytest.approx(EXACT[name](x), rel=ULP, abs=0)


@pytest.mark.parametrize(
    ("name", "corner", "value", "wanted"),
    [
        ("sign", 0.0, 0.0, 1 / EPS),
        ("root", 0.0, 0.0, 1 / math.sqrt(EPS)),
        ("magnitude", 0.0, 0.0, 0.0),
        ("minimum", 0.5, 0.5 - EPS / 4, 0.5),
        ("maximum", 0.5, 0.5 + EPS / 4, 0.5),
        ("sat", 0.5, 0.5 - EPS / 4, 0.5),
        ("sat", -1.0, -1.0 + EPS / 4, 0.5),
    ],
)
def test_value_and_slope_at_the_corner(name, corner, value, wanted):
    f = ROUNDED[name]
    assert f(corner, EPS) == pytest.approx(value, rel=1e-15, abs=1e-17)
    assert slope(f, corner, EPS) == pytest.approx(wanted, rel=1e-14)
    # a difference quotient over h has an error of the order of h/eps
    h = 1e-6 * EPS
    quotient = (f(corner + h, EPS) - f(corner - h, EPS)) / (2 * h)
    assert quotient == pytest.approx(wanted, rel=1e-5, abs=1e-5)


def test_exact_forms_at_the_corner_have_the_slopes_that_the_docstrings_state():
    assert slope(ROUNDED["sign"], 0.0, 0.0) == 0.0
    assert math.isnan(slope(ROUNDED["root"], 0.0, 0.0))
    assert slope(ROUNDED["magnitude"], 0.0, 0.0) == 0.0
    assert slope(ROUNDED["minimum"], 0.5, 0.0) == 0.5
    assert slope(ROUNDED["maximum"], 0.5, 0.0) == 0.5
    assert slope(ROUNDED["sat"], 0.5, 0.0) == 0.5


def test_curvature_of_the_magnitude_at_zero():
    x = ca.SX.sym("x")
    hessian = ca.hessian(smooth.magnitude(x, EPS), x)[0]
    assert float(ca.Function("h", [x], [hessian])(0.0)) == pytest.approx(2 / EPS, rel=1e-14)


def test_largest_error_of_the_magnitude_is_where_the_docstring_says():
    golden = math.sqrt((math.sqrt(5) - 1) / 2)
    error = golden * EPS - smooth.magnitude(golden * EPS, EPS)
    assert golden == pytest.approx(0.786, abs=5e-4)
    assert error / EPS == pytest.approx(0.3003, abs=5e-5)
    for t in (0.5, 0.7, 0.85, 1.0, 2.0):
        assert t * EPS - smooth.magnitude(t * EPS, EPS) < error


@given(x=st.floats(0.01, 1e3), eps=st.floats(1e-6, 1.0))
def test_rounding_errors_stay_within_their_bounds(x, eps):
    slack = ULP * max(1.0, x)
    assert 0 <= 1 - smooth.sign(x, eps) + ULP <= eps**2 / (2 * x**2) + 2 * ULP
    exact = math.sqrt(x)
    assert -ULP <= 1 - smooth.root(x, eps) / exact <= eps**2 / (4 * x**2) + ULP
    assert -slack <= x - smooth.magnitude(x, eps) <= min(0.301 * eps, eps**2 / (2 * x)) + slack


@given(x=st.floats(-3, 3), eps=st.floats(1e-6, 0.7))
def test_rounded_limits_never_leave_the_range_and_are_exact_off_the_corners(x, eps):
    y = smooth.sat(x, -1.0, 0.5, eps)
    assert -1.0 <= y <= 0.5
    if min(abs(x + 1.0), abs(x - 0.5)) >= eps:
        assert y == smooth.sat(x, -1.0, 0.5)
    low, high = smooth.minimum(x, 0.5, eps), smooth.maximum(x, 0.5, eps)
    assert low <= min(x, 0.5)
    assert high >= max(x, 0.5)
    assert low + high == pytest.approx(x + 0.5, abs=2e-15)  # the two roundings cancel


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), eps=st.floats(1e-6, 1.0))
def test_every_rounded_form_is_monotone_and_odd_ones_are_odd(x, y, eps):
    x, y = min(x, y), max(x, y)
    for name in ("sign", "root", "minimum", "maximum", "sat"):
        f = ROUNDED[name]
        if name != "sat" or eps <= 0.75:
            assert f(x, eps) <= f(y, eps) + 1e-14  # rounding of the sum of two parabolas
    for name in ("sign", "root"):
        assert ROUNDED[name](-x, eps) == -ROUNDED[name](x, eps)


def test_blend_goes_from_one_value_to_the_other_with_flat_ends():
    def f(x, _=0):
        return smooth.blend(x, 1.0, 2.0, 5.0, 7.0)

    assert [f(x) for x in (-4.0, 1.0, 1.5, 2.0, 9.0)] == [5.0, 5.0, 6.0, 7.0, 7.0]
    assert slope(f, 1.0, 0) == 0.0
    assert slope(f, 2.0, 0) == 0.0
    assert slope(f, 1.5, 0) == pytest.approx(1.5 * 2.0, rel=1e-15)
    assert smooth.blend(1.5, 1.0, 2.0) == 0.5


@pytest.mark.parametrize("symbol", [ca.SX, ca.MX])
@pytest.mark.parametrize("name", ROUNDED)
def test_symbols_and_numbers_give_the_same(symbol, name):
    x, e = symbol.sym("x"), symbol.sym("e")
    f = ca.Function("f", [x, e], [ROUNDED[name](x, e)])
    for value in (-1.01, -0.3, 0.0, 0.49, 0.5, 7.0):
        assert float(f(value, EPS)) == pytest.approx(ROUNDED[name](value, EPS), rel=ULP, abs=0)
        assert float(ROUNDED[name](ca.DM(value), EPS)) == float(f(value, EPS))
    exact = ca.Function("f", [x], [ROUNDED[name](x, 0)])
    assert float(exact(0.3)) == ROUNDED[name](0.3, 0)


def test_vectors_are_taken_element_by_element():
    x = ca.DM([-4.0, 0.0, 9.0])
    assert smooth.root(x).full().ravel().tolist() == [-2.0, 0.0, 3.0]


def test_units_pass_when_eps_has_the_unit_of_the_argument():
    s, e, lo, hi, T_b, T_max = (ca.SX.sym(n) for n in ("s", "e", "lo", "hi", "T_b", "T_max"))
    given_units = dict.fromkeys(("s", "e", "lo", "hi"), "m/s") | {"T_b": "N m", "T_max": "N m"}
    formulas = {
        "sign": (smooth.sign(s, e), "1"),
        "sign exact": (smooth.sign(s), "1"),
        "root": (smooth.root(s, e), "m^.5/s^.5"),
        "root exact": (smooth.root(s), "m^.5/s^.5"),
        "magnitude": (smooth.magnitude(s, e), "m/s"),
        "minimum": (smooth.minimum(s, hi, e), "m/s"),
        "maximum": (smooth.maximum(s, hi, e), "m/s"),
        "sat": (smooth.sat(s, lo, hi, e), "m/s"),
        "weight": (smooth.blend(s, lo, hi), "1"),
        "blend": (smooth.blend(s, lo, hi, T_b, T_max), "N m"),
        "switch": (smooth.blend(s, lo, hi, above=T_b), "N m"),
    }
    equations = {k: v[0] for k, v in formulas.items()}
    wanted = {k: v[1] for k, v in formulas.items()}
    assert unit_walk.check(equations, given_units, wanted) == []


@pytest.mark.parametrize("name", ["sign", "root", "magnitude"])
def test_a_bare_number_as_eps_is_found(name):
    s = ca.SX.sym("s")
    found = unit_walk.check({"y": ROUNDED[name](s, 0.01)}, {"s": "m/s"}, {})
    assert len(found) == 1
    assert "cannot be added" in found[0]


def test_a_negative_eps_is_bad_input():
    for wrong in (-1.0, math.nan):
        with pytest.raises(BadInput, match="rounded over a positive distance"):
            smooth.sign(1.0, wrong)
