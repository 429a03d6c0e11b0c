"""Interval arithmetic: every enclosure contains what it encloses, and bounds are tight."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import FUNCTIONS, PEAKS, STAIRS

from slipctl import BadInput
from slipctl.certify.arithmetic import enclosure
from slipctl.certify.arithmetic.enclosure import enclose, largest, scalar_function
from slipctl.certify.arithmetic.jumps import largest_jump


@pytest.mark.parametrize("f", FUNCTIONS)
@given(seed=st.integers(0, 10**6), width=st.floats(-3, 0))
@settings(max_examples=10)
def test_enclosures_contain_what_they_enclose(f, seed, width):
    """Random boxes, random points in them, each known operation."""
    rng = np.random.default_rng(seed)
    lo = rng.uniform(-2, 2, (2, 30))
    hi = lo + 10**width * rng.random((2, 30))
    low, high = enclose(f, lo, hi)
    for _ in range(20):
        points = lo + (hi - lo) * rng.random((2, 30))
        points[:, ::7] = lo[:, ::7]
        values = np.array(f(points).full())
        inside = (low <= values) & (values <= high)
        assert (inside | np.isnan(values)).all()
    # nothing is lost by nothing: a narrow box has a narrow enclosure
    low, high = enclose(f, lo, lo)
    known = np.isfinite(low) & np.isfinite(high)
    assert (high - low)[known].max(initial=0) < 1.01


def test_largest_finds_the_peak_and_proves_it():
    """Peak of sin(x) y on a box, to 1e-6; an unbounded function is said to be unbounded."""
    xy = ca.SX.sym("xy", 2)
    f = ca.Function("f", [xy], [ca.sin(xy[0]) * xy[1]])
    found = largest(f, np.array([0.0, 1.0]), np.array([2.0, 3.0]), 1e-6)
    assert found.reached <= 3.0 <= found.bound <= found.reached + 1e-6
    g = ca.Function("g", [xy], [1 / xy[0] + 0 * xy[1]])
    assert (
        largest(g, np.array([-1.0, 0.0]), np.array([1.0, 1.0]), 1e-3, most=2000).bound == math.inf
    )
    h = ca.Function("h", [xy], [ca.erf(xy[0]) + xy[1]])
    with pytest.raises(BadInput, match="cannot be enclosed"):
        enclose(h, np.zeros((2, 1)), np.ones((2, 1)))


def test_matrix_expressions_are_expanded():
    """MX works where CasADi can expand it, and says so where it cannot."""
    x = ca.MX.sym("x", 2)
    low, high = enclose(ca.Function("f", [x], [x[0] * x[1]]), np.ones((2, 1)), np.full((2, 1), 2.0))
    assert low[0, 0] == pytest.approx(1)
    assert high[0, 0] == pytest.approx(4)
    inverse = ca.inv(ca.reshape(ca.vertcat(x, x), 2, 2))
    with pytest.raises(BadInput, match="cannot be written as scalar operations"):
        scalar_function(ca.Function("g", [x], [ca.norm_2(inverse)]))
    z, p = ca.MX.sym("z"), ca.MX.sym("p")
    root = ca.rootfinder("root", "newton", {"x": z, "p": p, "g": z**3 + z - p})
    g = ca.Function("g", [x], [root(x0=0, p=x[0])["x"]])
    with pytest.raises(BadInput, match="cannot be"):
        enclose(g, np.zeros((2, 1)), np.ones((2, 1)))


@pytest.mark.parametrize(
    ("lo", "hi", "wanted"), [(0.0, 5.0, (1, 5)), (4.0, 6.0, (1, 5)), (6.0, 7.0, (1, 1)),
                             (5.0, 5.0, (5, 5))],
)  # fmt: skip
def test_unequal_is_open_where_the_box_holds_the_number(lo, hi, wanted):
    """x != 5 decides for a box that does not hold 5, and for 5 alone; in between it is open."""
    x = ca.SX.sym("x", 1)
    f = ca.Function("f", [x], [ca.if_else(x != 5, 1, 5)])
    low, high = enclose(f, np.array([[lo]]), np.array([[hi]]))
    assert low[0, 0] <= wanted[0] <= wanted[1] <= high[0, 0]
    assert high[0, 0] - low[0, 0] < 1e-12 or wanted == (1, 5)


@pytest.mark.parametrize("f", PEAKS)
@pytest.mark.parametrize("ends", [((-1, -1), (1, 1)), ((0, -0.5), (2, 3)), ((-0.3, 0), (0.3, 0))])
def test_no_point_of_a_grid_lies_above_what_is_largest(f, ends):
    """And none above the bound; the two are as near as was asked."""
    lo, hi = np.array(ends, dtype=float)
    found = largest(f, lo, hi, 1e-3)
    x, y = np.meshgrid(np.linspace(lo[0], hi[0], 41), np.linspace(lo[1], hi[1], 41))
    on_grid = float(np.array(f(np.array([x.ravel(), y.ravel()])).full()).max())
    assert on_grid - 1e-3 <= found.reached <= found.bound <= found.reached + 1e-3
    assert on_grid <= found.bound


@pytest.mark.parametrize(("f", "wanted"), list(zip(STAIRS, (1.75, 3.0, 7.0, 0.0), strict=True)))
def test_the_largest_jump_is_that_of_the_formula(f, wanted):
    """x in [-1, 1] and y in [-1, 1]: 1 + y - x at x = 0.25; and so on, by hand."""
    found = largest_jump(f, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert wanted <= found.bound <= wanted * 1.05 + 1e-9


ONE = {
    "sqrt": ca.sqrt, "log": ca.log, "log1p": ca.log1p, "exp": ca.exp, "expm1": ca.expm1,
    "tanh": ca.tanh, "sinh": ca.sinh, "asinh": ca.asinh, "atan": ca.atan, "asin": ca.asin,
    "acos": ca.acos, "sign": ca.sign, "floor": ca.floor, "ceil": ca.ceil, "cosh": ca.cosh,
    "fabs": ca.fabs, "sin": ca.sin, "cos": ca.cos, "-x": lambda x: -x, "2x": lambda x: x + x,
    "1/x": lambda x: 1 / x, "x^2": lambda x: x * x, "x^4": lambda x: x**4, "not": ca.logic_not,
    "sin 4x": lambda x: ca.sin(4 * x), "cos 4x": lambda x: ca.cos(4 * x),
}  # fmt: skip
TWO = {
    "+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y,
    "/": lambda x, y: x / y, "min": ca.fmin, "max": ca.fmax, "<": lambda x, y: x < y,
    "<=": lambda x, y: x <= y, "==": lambda x, y: x == y, "!=": lambda x, y: x != y,
    "and": ca.logic_and, "or": ca.logic_or, "if": lambda x, y: ca.if_else(x, y, 0),
}  # fmt: skip
STEPS = 64
"""Points on each unit of a box: a turn of sin 4x is missed by less than 1e-3."""


POWERS = (-3, -2, -1, -0.5, 0.5, 1.5, 2, 3, 7)
"""Whole ones reach the rule of a power only where CasADi does not write them as products."""


def boxes(ends):
    """Every interval between two of some numbers, points too."""
    return [(a, b) for a in ends for b in ends if a <= b]


def told(f, lo, hi):
    """Ends of an enclosure over boxes, one column each."""
    low, high = enclose(f, np.array(lo, dtype=float).T, np.array(hi, dtype=float).T)
    return low[0], high[0]


@pytest.mark.parametrize("name", ONE)
def test_an_operation_is_enclosed_as_closely_as_it_can_be(name):
    """Of an interval between quarters: the values of its points; no more where all are finite."""
    x = ca.SX.sym("x", 1)
    f = ca.Function("f", [x], [ONE[name](x)])
    every = boxes(np.arange(-9, 10) / 4)
    for (a, b), low, high in zip(every, *told(f, *np.array(every)[:, :, None].swapaxes(0, 1)),
                                 strict=True):  # fmt: skip
        points = np.linspace(a, b, int((b - a) * STEPS) + 1)
        values = np.array(f(points[None]).full())[0]
        finite = values[np.isfinite(values)]
        assert not len(finite) or (low <= finite.min() and finite.max() <= high), (a, b)
        if np.isnan(values).any():
            assert (low, high) == (-math.inf, math.inf), (a, b)
        elif len(finite) == len(values):
            assert low == pytest.approx(finite.min(), abs=1e-3, rel=1e-12), (a, b)
            assert high == pytest.approx(finite.max(), abs=1e-3, rel=1e-12), (a, b)


@pytest.mark.parametrize("name", TWO)
def test_an_operation_of_two_is_enclosed_as_closely_as_it_can_be(name):
    """Of all pairs of intervals between five numbers; what is no number is passed over."""
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [TWO[name](x[0], x[1])])
    own = boxes((-1.0, -0.5, 0.0, 0.25, 1.0))
    every = [(s, t) for s in own for t in own]
    low, high = told(f, *np.array(every).transpose(2, 0, 1))
    for k, (s, t) in enumerate(every):
        first, second = (np.linspace(a, b, int((b - a) * 4) + 1) for a, b in (s, t))
        pairs = np.array([v.ravel() for v in np.meshgrid(first, second)])
        values = np.array(f(pairs).full())[0]
        finite = values[np.isfinite(values)]
        assert not len(finite) or (low[k] <= finite.min() and finite.max() <= high[k]), (s, t)
        if len(finite) == len(values):
            assert (low[k], high[k]) == pytest.approx((finite.min(), finite.max()), abs=1e-12)


@pytest.mark.parametrize("n", POWERS)
def test_a_power_is_enclosed_as_closely_as_it_can_be(n):
    """Its rule alone: infinite where a box has a point without a power, else what it has."""
    a, b = np.array(boxes(np.arange(-8, 9) / 4)).T
    power = np.full_like(a, n)
    with np.errstate(all="ignore"):
        low, high = enclosure._RULES[ca.OP_CONSTPOW]((a, b), (power, power))
    for k in range(len(a)):
        points = np.linspace(a[k], b[k], int((b[k] - a[k]) * STEPS) + 1)
        with np.errstate(all="ignore"):
            values = points**n
        if np.isfinite(values).all():
            assert (low[k], high[k]) == pytest.approx((values.min(), values.max()), abs=1e-3)
        else:
            assert (low[k], high[k]) == (-math.inf, math.inf)
