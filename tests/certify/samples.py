"""Functions and loops that tests of certify hand over, by a name of their own."""

from __future__ import annotations

import casadi as ca

from slipctl.certify.ticks.tick_sets import sgn

OPERATIONS = (
    lambda x, y: x * y + ca.exp(-x) * ca.sin(3 * y),
    lambda x, y: ca.sqrt(x**2 + y**2 + 0.1) / (1.5 + ca.cos(x)),
    lambda x, y: ca.if_else(x > y, ca.tanh(x), ca.fabs(y)) - ca.fmin(x, 0.3),
    lambda x, y: ca.log(2.5 + x) * ca.atan(y) + ca.sign(x) * ca.fmax(x, y),
    lambda x, y: ca.cosh(x) - ca.sinh(y) + x**3 + y**-2 + (x + 3) ** 1.5,
    lambda x, y: ca.if_else(ca.logic_and(x > 0, y <= 0.5), x / (y + 3), ca.floor(2 * x)),
    lambda x, y: ca.log1p(x + 2) + ca.expm1(y) + ca.asinh(x * y) + 1 / (x - 5),
    lambda x, y: ca.if_else(ca.logic_or(x == y, ca.logic_not(x < 0)), 2 * x, ca.ceil(y)),
)


def of_two(g):
    """Function of a column of two."""
    xy = ca.SX.sym("xy", 2)
    return ca.Function("f", [xy], [g(xy[0], xy[1])])


FUNCTIONS = tuple(map(of_two, OPERATIONS))
"""Each known operation of an enclosure."""

PEAKS = (
    of_two(lambda x, y: ca.sin(x) * y),
    of_two(lambda x, y: -((x - 0.3) ** 2) - (y + 0.2) ** 2 + 0.5),
    of_two(lambda x, y: ca.fmin(x, 0.4) + ca.cos(y) - 0.1 * x**2),
)
"""Functions with a largest value."""

STAIRS = (
    of_two(lambda x, y: ca.if_else(x > 0.25, 1 + y, x)),
    of_two(lambda x, y: ca.if_else(x > y, ca.if_else(y > 0, 3, 1), 0.5 * x)),
    of_two(lambda x, y: ca.sign(x - 0.1) * (2 + y) + ca.floor(2 * y)),
    of_two(lambda x, y: x * y),
)
"""Functions that jump, and one that does not."""


def line(n, x, d):
    """One state."""
    return {"x": n["a"] * x["x"] + d["w"]}


def relay(n, x, d):
    """A sign behind a lag."""
    return {
        "x": x["x"] + n["T"] * (-n["g"] * x["x"] + x["u"] + d["w"]),
        "u": n["a"] * x["u"] - (1 - n["a"]) * sgn(x["x"]),
    }
