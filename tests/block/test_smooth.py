"""The signed square root: its values, its slope at the corner, its unit."""

import math

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.block.smooth import root
from slipctl.block.units import unit_walk

ULP = 4e-16  # relative error of a handful of operations in double


@given(x=st.floats(-10, 10))
def test_the_value_is_exact_and_never_nan(x):
    assert root(x) == pytest.approx(math.copysign(math.sqrt(abs(x)), x), rel=ULP, abs=0)
    assert root(-x) == -root(x)


def test_the_slope_at_the_corner_is_what_the_docstring_states():
    x = ca.SX.sym("x")
    slope = ca.Function("d", [x], [ca.jacobian(root(x), x)])
    assert math.isnan(float(slope(0.0)))
    assert float(slope(4.0)) == float(slope(-4.0)) == 0.25


@pytest.mark.parametrize("symbol", [ca.SX, ca.MX])
def test_symbols_and_numbers_give_the_same(symbol):
    x = symbol.sym("x")
    f = ca.Function("f", [x], [root(x)])
    for value in (-1.01, -0.3, 0.0, 0.49, 7.0):
        assert float(f(value)) == root(value) == float(root(ca.DM(value)))


def test_vectors_are_taken_element_by_element():
    assert root(ca.DM([-4.0, 0.0, 9.0])).full().ravel().tolist() == [-2.0, 0.0, 3.0]


def test_its_unit_is_the_root_of_the_unit():
    s = ca.SX.sym("s")
    assert unit_walk.check({"y": root(s)}, {"s": "m/s"}, {"y": "m^.5/s^.5"}) == []
