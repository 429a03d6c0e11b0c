"""Formulas written of graphs that are built here, operation by operation: the text of each."""

from __future__ import annotations

import math
from typing import Any

import pytest
from graphs_by_hand import built, summed

from slipctl.block.text.formula import Graph
from slipctl.block.text.plain_text import Text, _elements_in_row, cut


def text_of(made: Any) -> str:
    g, (root,) = built(made)
    return Text(g).root(root)


LOG = ("mul", 1 / math.log(10), ("log", "x"))
BELOW = ("lt", "z", 0.0)
IF = ("add", ("if_else_zero", BELOW, "x"), ("if_else_zero", ("not", BELOW), "y"))
TURNED = ("add", IF[2], IF[1])
MORE = ("add", ("if_else_zero", ("lt", "w", 1.0), ("neg", "q")),
        ("if_else_zero", ("not", ("lt", "w", 1.0)), IF))  # fmt: skip
SMALL = ("if_else_zero", BELOW, "x")
TIE = ("add", ("le", "x", "y"), ("le", "y", "x"))

TEXTS = [
    (("add", ("neg", "x"), "y"), "-x + y"), (("sub", "z", ("neg", "x")), "z + x"),
    (("sub", "z", ("neg", ("add", "x", "y"))), "z + x + y"),
    (("sub", "z", ("sub", "x", ("add", "y", "w"))), "z - x + y + w"),
    (("add", "x", -3.0), "x - 3"), (("sub", "x", -3.0), "x + 3"), (("add", -2.5, "x"), "-2.5 + x"),
    (("sub", "x", ("mul", -2.0, "y")), "x + 2*y"), (("add", "q", IF), "q + (x if z < 0 else y)"),
    (("neg", ("add", "x", "y")), "-(x + y)"), (("neg", 3.0), "-3"), (("neg", ("mul", "x", "y")),
    "-x*y"), (("mul", ("mul", "x", "y"), "y"), "x*y^2"), (("mul", ("mul", "x", "y"), "x"), "x*y*x"),
    (("mul", ("mul", ("mul", "x", "y"), "z"), "z"), "x*y*z^2"),
    (("mul", ("mul", "x", 3.0), "y"), "3*x*y"), (("mul", -3.0, "x"), "-3*x"),
    (("mul", "x", ("add", "y", "z")), "x*(y + z)"), (("mul", ("sq", "x"), "y"), "x^2*y"),
    (("mul", ("sq", 2 * math.pi), "x"), "(2*pi)^2*x"), (("mul", 2 * math.pi, "x"), "2*pi*x"),
    (("sq", 3.0), "3^2"), (("sq", ("sq", "x")), "x^4"), (("sq", ("neg", "x")), "(-x)^2"),
    (("sq", ("add", "x", "y")), "(x + y)^2"), (("twice", "x"), "2*x"),
    (("twice", ("neg", "x")), "-2*x"), (("inv", "x"), "1/x"), (("inv", ("sq", "x")), "1/x^2"),
    (("div", "x", 2 * math.pi), "x/(2*pi)"), (("div", "x", math.pi), "x/pi"),
    (("div", ("mul", "x", "y"), ("mul", "z", "w")), "x*y/(z*w)"),
    (("div", "x", ("div", "y", "z")), "x/(y/z)"), (("div", ("neg", "x"), "y"), "-x/y"),
    (("div", "x", ("neg", "y")), "-x/y"), (("div", ("neg", "x"), ("neg", "y")), "x/y"),
    (("div", ("div", "x", "y"), "y"), "x/y^2"), (("div", "x", TIE), "x"),
    (("div", ("add", "x", "y"), ("sub", "z", 2.0)), "(x + y)/(z - 2)"),
    (LOG, "log10(x)"), (("mul", 20.0, LOG), "20*log10(x)"), (("sub", "y", LOG), "y - log10(x)"),
    (("mul", 0.5, ("log", "x")), "0.5*log(x)"), (("mul", LOG, "y"), "log10(x)*y"),
    (("constpow", "x", -1.5), "x^(-1.5)"), (("constpow", ("add", "x", "y"), 0.5), "(x + y)^0.5"),
    (("pow", "x", "y"), "x^y"), (("pow", "x", ("neg", "y")), "x^(-y)"),
    (("pow", "x", ("mul", "y", "z")), "x^(y*z)"), (("mul", ("pow", "x", "y"), "z"), "x^y*z"),
    (("lt", "x", 3.0), "x < 3"), (("lt", 3.0, "x"), "x > 3"), (("le", 3.0, "x"), "x >= 3"),
    (("eq", 3.0, "x"), "x == 3"), (("ne", "x", ("add", "y", "z")), "x != y + z"),
    (("not", ("lt", "x", "y")), "x >= y"), (("not", ("le", "x", "y")), "x > y"),
    (("not", ("eq", "x", "y")), "x != y"), (("not", ("ne", "x", "y")), "x == y"),
    (("not", ("le", 3.0, "x")), "x < 3"), (("not", "x"), "not x"),
    (("not", ("and", "x", "y")), "not (x and y)"),
    (("and", ("lt", "x", "y"), ("or", "z", "w")), "x < y and (z or w)"),
    (("fabs", ("sub", "x", "y")), "abs(x - y)"), (("fmin", "x", ("fmax", "y", "z")),
    "min(x, max(y, z))"), (("atan2", "x", "y"), "atan2(x, y)"),
    (SMALL, "x if z < 0 else 0"), (IF, "x if z < 0 else y"), (TURNED, "x if z < 0 else y"),
    (MORE, "-q if w < 1 else x if z < 0 else y"), (("mul", IF, "q"), "(x if z < 0 else y)*q"),
    (("if_else_zero", BELOW, IF), "(x if z < 0 else y) if z < 0 else 0"),
    (("add", SMALL, ("if_else_zero", ("lt", "w", 1.0), "y")),
     "(x if z < 0 else 0) + (y if w < 1 else 0)"),
    (("sub", "z", ("add", "x", "y")), "z - x - y"), (("pow", -2.0, "x"), "(-2)^x"),
    (("pow", 2 * math.pi, "x"), "(2*pi)^x"), (("pow", 0.0, "x"), "0^x"), (("div", "x", "x"), "x/x"),
    (("mul", ("sq", ("pow", "x", "y")), "z"), "(x^y)^2*z"),
    (("mul", 1 / math.log(10), ("exp", "x")), "0.434294*exp(x)"),
    (("add", SMALL, ("neg", ("not", BELOW))), "(x if z < 0 else 0) - (z >= 0)"),
    (("add", ("neg", ("not", BELOW)), SMALL), "-(z >= 0) + (x if z < 0 else 0)"),
    ("one[m/s]", "1[m/s]"), (("mul", "one[N]", "x"), "1[N]*x"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "text"), TEXTS, ids=[text for _, text in TEXTS])
def test_an_operation_has_this_text(made, text):
    assert text_of(made) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3.0, "3"), (-4.0, "-4"), (0.0, "0"), (-0.0, "0"), (999999.0, "999999"), (1e6, "1e6"),
        (1.5e6, "1.5e6"),
        (1234567.0, "1.23457e6"), (1e-7, "1e-7"), (2.5e-12, "2.5e-12"), (0.1, "0.1"),
        (1 / 3, "0.333333"), (math.pi, "pi"), (2 * math.pi, "2*pi"), (math.inf, "inf"),
        (-math.inf, "-inf"), (1e300, "1e300"),
    ],
)  # fmt: skip
def test_a_number_is_written_with_six_digits(value, text):
    assert Text(Graph()).number(value) == text


def row(name: str, *places: int) -> list[str]:
    return [f"{name}[{k}]" for k in places]


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (summed(*row("x", *range(7))), "x[0] + x[1] + ... + x[6]"),
        (summed(*row("x", *range(3, 8))), "x[3] + x[4] + ... + x[7]"),
        (summed(*row("x", *range(4))), "x[0] + x[1] + x[2] + x[3]"),
        (("neg", summed(*row("x", *range(5)), "y")), "-(x[0] + x[1] + ... + x[4] + y)"),
        (summed("y", *row("x", *range(5)), "z", op="sub"), "y - x[0] - x[1] - ... - x[4] - z"),
        (summed(*row("x", 0, 1, 2, 4, 5)), "x[0] + x[1] + x[2] + x[4] + x[5]"),
        (summed(*row("x", 0, 1), *row("y", *range(6))),
         "x[0] + x[1] + y[0] + y[1] + ... + y[5]"),
    ],
)  # fmt: skip
def test_of_elements_in_a_row_the_first_two_and_the_last_are_written(made, text):
    assert text_of(made) == text


def test_elements_in_a_row_are_counted_from_one_on():
    terms = [(True, n, n) for n in ("y", *row("x", 2, 3, 4), "x[6]", "x[7]")]
    terms += [(False, n, n) for n in row("x", 8, 9)]
    assert [_elements_in_row(terms, k) for k in range(8)] == [1, 3, 2, 1, 2, 1, 2, 1]
    assert _elements_in_row([(True, "t", "x[k]"), (True, "t", "x[1]")], 0) == 1


def test_a_letter_stands_for_its_part_and_is_spelled_out_alone():
    g, (F, root) = built(("mul", "m", "g"), ("div", ("sub", ("mul", "m", "g"), "T"), "J"))
    g.letters[F] = "F_a"
    text = Text(g)
    assert text.root(root) == "(F_a - T)/J"
    assert text.root(F) == "m*g"
    assert text.at(F) == ("F_a", 6)
    g, (low, turned, case) = built(BELOW, ("not", BELOW), IF)
    g.letters |= {low: "low", case: "u"}
    assert Text(g).root(turned) == "not low"
    assert Text(g).root(case) == "x if low else y"
    g, (case, total) = built(IF, ("add", IF, ("twice", IF)))
    g.letters[case] = "u"
    assert Text(g).root(total) == "u + 2*u"
    assert Text(g).branches(case) is None
    assert Text(g).branches(case, top=True) is not None
    g, (log, whole) = built(("log", "x"), LOG)
    g.letters[log] = "L"
    assert Text(g).root(whole) == "0.434294*L"
    g, (inner, outer) = built(("sq", "x"), ("sq", ("sq", "x")))
    assert Text(g).root(outer) == "x^4"
    g.letters[inner] = "E"
    assert Text(g).root(outer) == "E^2"


@pytest.mark.parametrize(
    ("limit", "text"),
    [(16, "abcdefghijklmnop"), (15, "abcdefg ... nop"), (12, "abcd ... nop")],
)
def test_a_long_text_is_cut_in_its_middle(limit, text):
    assert cut("abcdefghijklmnop", limit) == text
    assert len(text) == limit
