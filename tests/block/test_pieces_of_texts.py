"""What is written of expressions, and what texts of blocks mean, read back as numbers."""

from __future__ import annotations

import itertools
import math

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, from_text, step
from slipctl.block.text import formula
from slipctl.block.text.intermediates import LARGEST, elements
from slipctl.block.text.plain_text import Text

x, y, z = (ca.SX.sym(n) for n in "xyz")

POINTS = [(1.5, -0.5, 2.0), (-2.0, 0.25, 1.0), (0.5, 0.5, -3.0), (3.0, 3.0, 3.0)]


@pytest.mark.parametrize(
    "made",
    [
        x - (y - (z - x)), -(x - y) - z, -x - y, x + (-y), 2 * x - 3 * (y + z), x - y + 2,
        (x - y) - (y - z), x / (2 * ca.pi), x / (y * z), 1 / (x * x * y), -x / y, (x / y) / (z / x),
        x * y / z * x, (-x) ** 2, (x * y) ** 3, -(x**2), x**2 * y**-2, 1 / x, 2 / x**3, 1e-7 * x,
        1.5e6 * x / y, -2 * x**2, (-2 * x) ** 2, (x + y) ** 2 / (x - z) ** 2, ca.exp(-x * y),
        ca.fmin(x, ca.fmax(y, z)), ca.fabs(x - y) * z, ca.sqrt(x * x + y * y), x * (y + z) * x,
    ],
)  # fmt: skip
def test_a_formula_that_is_written_is_the_expression(made):
    """Read as Python: the same number at every point."""
    g = formula.graph({"y": made})
    text = Text(g).root(g.roots["y"][0])
    f = ca.Function("f", [x, y, z], [made])
    names = {"exp": math.exp, "sqrt": math.sqrt, "pi": math.pi, "min": min, "max": max, "abs": abs,
             "fabs": abs, "fmin": min, "fmax": max}  # fmt: skip
    checked = 0
    for point in POINTS:
        wanted = float(f(*point))
        if not math.isfinite(wanted):
            continue
        given = dict(zip("xyz", point, strict=True))
        found = eval(text.replace("^", "**"), names, given)  # a formula that was made here
        assert found == pytest.approx(wanted, rel=1e-5)
        checked += 1
    assert checked >= 3


def test_branches_of_an_if_are_told_in_their_order():
    made = ca.if_else(x < 0, x, ca.if_else(x < 1, y, ca.if_else(x < 2, z, x + y)))
    g = formula.graph({"y": made})
    text = Text(g)
    (root,) = (g.roots["y"][0],)
    branches, rest = text.branches(root)
    assert [text.at(c)[0] for c, _ in branches] == ["x < 0", "x < 1", "x < 2"]
    assert [text.at(v)[0] for _, v in branches] == ["x", "y", "z"]
    assert text.at(rest)[0] == "x + y"
    alone = formula.graph({"y": ca.if_else(x < 0, y, 0)})
    branches, rest = Text(alone).branches(alone.roots["y"][0])
    assert len(branches) == 1
    assert rest is None
    for other in (x + y, x * y, ca.if_else(x < 0, y, 0) + ca.if_else(x < 1, z, 0), x):
        g = formula.graph({"y": other})
        assert Text(g).branches(g.roots["y"][0]) is None


def test_elements_of_an_expression_have_names_by_their_place():
    a = ca.SX.sym("a")
    found = elements("q", ca.vertcat(a + 1, 0, a * 2))
    assert [n for n, _ in found] == ["q_0", "q_2"]
    assert [float(ca.Function("f", [a], [v])(3.0)) for _, v in found] == [4, 6]
    matrix = ca.SX(2, 2)
    matrix[0, 1], matrix[1, 0] = a * 3, a - 1
    assert sorted(n for n, _ in elements("M", matrix)) == ["M_0_1", "M_1_0"]
    row = ca.horzcat(a + 1, a + 2)
    assert [n for n, _ in elements("r", row)] == ["r_0_0", "r_0_1"]
    assert [n for n, _ in elements("s", a + 1)] == ["s"]
    assert elements("s", a) == []  # a symbol is no result
    assert elements("s", ca.SX(3)) == []
    assert [n for n, _ in elements("l", [a + 1, a, 4, a + 2])] == ["l_0", "l_3"]
    assert elements("l", [a + 1] * (LARGEST + 1)) == []
    assert len(elements("l", [a + k + 1 for k in range(LARGEST)])) == LARGEST
    assert elements("v", ca.SX.sym("v", LARGEST + 1) * 2) == []
    assert len(elements("v", ca.SX.sym("v", LARGEST) * 2)) == LARGEST
    assert elements("t", "text") == []


def test_what_is_no_scalar_expression_has_one_name():
    m = ca.MX.sym("m", 3)
    worked = ca.sin(m)
    assert [n for n, _ in elements("q", worked)] == ["q"]
    assert elements("q", m) == []
    assert elements("q", ca.MX(3)) == []
    assert elements("q", ca.MX(2, 2)) == []
    found = elements("q", [worked, m, [worked, worked]])
    assert [n for n, _ in found] == ["q_0", "q_2_0", "q_2_1"]


@step(y=Output("1", "sum"))
def shaped(
    one=State("1", "k", "expression"),
    column=State("1", 2.0, "same for all", shape=(3,)),
    copies=State("1", (1.0, 2.0), "a number for each copy", shape=(3, 2)),
    u=Input("1", "input"),
    k=Param("1", 5.0, "start"),
):
    """States of several shapes."""
    return dict(one=one + u, column=column, copies=copies), dict(y=one)


def test_starts_of_states_fill_their_shape():
    """In symbols as in numbers: one number everywhere, or one for each copy."""
    p = {"k": ca.SX.sym("k")}
    found = shaped.symbolic_start(p)
    read = {n: np.array(ca.Function("f", [p["k"]], [v])(7.0)).ravel() for n, v in found.items()}
    assert read["one"].tolist() == [7]
    assert read["column"].tolist() == [2, 2, 2]
    assert read["copies"].tolist() == [1, 1, 1, 2, 2, 2]
    start = shaped.with_params(k=7.0).start()
    for n, v in read.items():
        assert np.array(ca.DM(start[n])).ravel(order="F").tolist() == pytest.approx(v.tolist())


def parameter(**means):
    """Values in SI of parameters of a block that is written as text."""
    text = "y = " + " + ".join(f"{n}*x" for n in means)
    block = from_text(text, inputs={"x": "1"}, parameters=means)
    return {n: float(v) for n, v in block.param_values().items()}


def test_numbers_of_texts_are_in_their_own_unit_or_that_of_the_name():
    assert parameter(a="2 km") == {"a": 2000.0}
    made = from_text("y = a*x/b*c where x [m/s], a [km/h] = 36, b [m] = 2*c, c = 3 m")
    values = {n: float(v) for n, v in made.param_values().items()}
    assert values == {"a": 10.0, "b": 6.0, "c": 3.0}


@pytest.mark.parametrize(
    "text",
    [
        "y = a*x where x [m/s], a = 2*b, b = 1", "y = a*x where x [m/s], a [m] = 2*",
        "y = a*x where x [m/s], a [m] = 2 s", "y = a*x where x [m/s], a = many",
        "y = a*x where x [m/s], a [m] = sin", "y = a*x where x [m/s], a = 2 in 3 .. 1",
        "y = a*x where x [m/s], a = 2 in 3",
    ],
)  # fmt: skip
def test_values_that_cannot_be_read_are_refused(text):
    with pytest.raises(BadInput):
        from_text(text)


@pytest.mark.parametrize(
    "more",
    [
        {"conditions": 3}, {"conditions": {"wet": 3}}, {"conditions": {"wet": {"b": 1.0}}},
        {"parameters": 3}, {"inputs": ["x"]}, {"parameters": {"a": True}}, {"outputs": {"q": "m"}},
    ],
)  # fmt: skip
def test_tables_of_texts_are_tables(more):
    good = {"inputs": {"x": "1"}, "parameters": {"a": "2"}}
    assert float(from_text("y = a*x", **good)(x=3.0)["y"]) == 6
    with pytest.raises(BadInput):
        from_text("y = a*x", **{**good, **more})


def test_conditions_of_texts_are_in_the_units_of_their_parameters():
    made = from_text("y = a*b*x", inputs={"x": "1"}, parameters={"a": "2 m", "b": "1"},
                     conditions={"wet": {"a": "30 cm"}, "dry": {"a": 3, "b": 0.5}})  # fmt: skip
    assert {c: dict(v) for c, v in made.conditions.items()} == {
        "wet": {"a": pytest.approx(0.3)}, "dry": {"a": 3.0, "b": 0.5}}  # fmt: skip


def test_every_pair_of_signs_of_a_sum_is_kept():
    for a, b, c in itertools.product((1, -1), repeat=3):
        made = a * x + (b * y - (c * z - x))
        g = formula.graph({"y": made})
        text = Text(g).root(g.roots["y"][0])
        at = {"x": 2.0, "y": 3.0, "z": 5.0}
        assert eval(text, {}, at) == a * 2 + (b * 3 - (c * 5 - 2))
