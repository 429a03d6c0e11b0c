"""An expression of CasADi as one of C: signs, parentheses, truths, bounds, and what gets a line."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any

import casadi as ca
import pytest

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import (
    _SELECT as SELECT,
)
from slipctl.ccode.tree.expressions import (
    _SLOPE as SLOPE,
)
from slipctl.ccode.tree.expressions import (
    ANY,
    FINITE,
    NUMBER,
    WIDTH,
    Node,
    Writer,
    choice,
    number,
    slope,
)
from slipctl.ccode.tree.printer import lines_of

x, y, z, w = (ca.SX.sym(n) for n in "xyzw")
SINE, SUM, BELOW, UP_TO = ca.sin(x + y), z + w, x < y, x <= y
"""Each is one value wherever it stands."""


def written(
    results: Sequence[Any], can_be: Sequence[int] = (ANY,) * 4, **options: Any
) -> tuple[list[str], list[str], list[int]]:
    """Lines, results, and what these can be; values that are known are called p and q."""
    f = ca.Function("f", [x, y, z, w], [ca.SX(r) for r in results])
    made = Writer(f, lambda i, k: c.name("xyzwpq"[i]),
                  can_be=lambda i, k: (*can_be, ANY, ANY)[i], **options).run()  # fmt: skip
    nodes = [n for _, n in made.results]
    return lines_of(made.lines), [made.result(n).text for n in nodes], [
        made.can_be[n] for n in nodes]  # fmt: skip


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (x - (y - z), "x - (y - z)"), (x - y - z, "x - y - z"), (x * (y / z), "x * (y / z)"),
        (x / (y * z), "x / (y * z)"), ((x + y) * (z - w), "(x + y) * (z - w)"),
        (x * y - z / w, "x * y - z / w"), (x - 2.5 * y, "x - 2.5 * y"),
        (x - ca.SX(-2.5), "x - (-2.5)"),
        (-(x + y), "-(x + y)"), (-(x * y), "-(x * y)"), (1 / (x + y), "1.0 / (x + y)"),
        (x + x, "2.0 * x"), (2 * (x - y), "2.0 * (x - y)"), (x**2, "x * x"),
        ((x + y) ** 2, "square(x + y)"), (x**y, "pow(x, y)"), (y**3.5, "pow(y, 3.5)"),
        (ca.atan2(x, y), "atan2(x, y)"), (ca.fmod(x - y, z), "fmod(x - y, z)"),
        (ca.copysign(x, y), "copysign(x, y)"), (ca.sqrt(x) * ca.sign(y), "sqrt(x) * sign_of(y)"),
        (x < y, "((x < y) ? 1.0 : 0.0)"), (x >= y, "((y <= x) ? 1.0 : 0.0)"),
        (x == y, "((x == y) ? 1.0 : 0.0)"), (x != y, "((x != y) ? 1.0 : 0.0)"),
        ((x < y) * z, "((x < y) ? 1.0 : 0.0) * z"),
        ((x < y) < z, "((((x < y) ? 1.0 : 0.0) < z) ? 1.0 : 0.0)"),
        (ca.logic_not(x), "((x == 0.0) ? 1.0 : 0.0)"),
        (ca.logic_not(x < y), "((!(x < y)) ? 1.0 : 0.0)"),
        (ca.logic_and(x, y < z), "(((x != 0.0) && (y < z)) ? 1.0 : 0.0)"),
        (ca.logic_or(x < y, ca.logic_and(z, w)),
         "(((x < y) || ((z != 0.0) && (w != 0.0))) ? 1.0 : 0.0)"),
        (ca.if_else(x < y, z, w), "(x < y) ? z : w"), (ca.if_else(x, y, z), "(x != 0.0) ? y : z"),
        (ca.if_else(x, 0, z), "(x == 0.0) ? z : 0.0"),
        (ca.if_else(x, y, 0), "(x != 0.0) ? y : 0.0"),
        (ca.if_else(x - y, z, w), "(x - y != 0.0) ? z : w"),
        (ca.if_else(x < y, z + w, z - w) * x, "((x < y) ? z + w : z - w) * x"),
        (ca.if_else(x < y, ca.if_else(z, x, w), y), "(x < y) ? ((z != 0.0) ? x : w) : y"),
        (ca.atan2(ca.if_else(x < y, z, w), y), "atan2(((x < y) ? z : w) + 0.0, y)"),
        (x / ca.if_else(x < y, z, w), "x / (((x < y) ? z : w) + 0.0)"),
        (x / ca.fabs(ca.if_else(x < y, z, w)), "x / fabs((x < y) ? z : w)"),
        (ca.if_else(x < y, z, w) / x, "((x < y) ? z : w) / x"),
        (ca.jacobian(ca.fmin(x, y), x), "slope_of_lesser(x, y)"),
        (ca.jacobian(ca.fmin(x, y), y), "slope_of_lesser(y, x)"),
        (UP_TO / ((x <= z) + UP_TO), "(a1 ? 1.0 : 0.0) / (((x <= z) ? 1.0 : 0.0)"
         " + (a1 ? 1.0 : 0.0))"),
        (x * ca.inf, "((double)INFINITY) * x"), (ca.if_else(x < y, -ca.inf, 1e5 * y),
                                                 "(x < y) ? (-(double)INFINITY) : 1e5 * y"),
    ],
)  # fmt: skip
def test_an_expression_has_the_parentheses_that_it_needs(expression: Any, text: str) -> None:
    (found,) = written([expression])[1]
    assert found == text


def test_a_bound_is_the_value_that_is_never_nan() -> None:
    """Of two that may be, the smaller one asks both; what it gives is known then."""
    for a, b in itertools.product((ANY, NUMBER, FINITE), repeat=2):
        low, high = written([ca.fmin(x, y), ca.fmax(x, y)], (a, b, FINITE, ANY))[1:]
        names = ("at_most(x, y)", "at_least(x, y)") if b else ("lesser(x, y)", "greater(x, y)")
        names = ("below(y, x)", "above(y, x)") if a else names
        assert tuple(low) == names
        assert high == [FINITE if a == b == FINITE else NUMBER if max(a, b) else ANY] * 2


@pytest.mark.parametrize(
    ("expression", "of"),
    [
        (x + y, {"FF": NUMBER}), (x - y, {"FF": NUMBER}), (x * y, {"FF": NUMBER}), (x / y, {}),
        (-x, {"N*": NUMBER, "F*": FINITE}), (ca.tanh(x), {"N*": NUMBER, "F*": FINITE}),
        (2 * x, {"N*": NUMBER, "F*": NUMBER}), (x**2, {"N*": NUMBER, "F*": NUMBER}),
        (ca.sin(x), {"F*": FINITE}), (ca.sqrt(x), {}),
        (x < y, dict.fromkeys(("A*", "N*", "F*"), FINITE)),
        (ca.if_else(w < z, x, y), {"NN": NUMBER, "NF": NUMBER, "FN": NUMBER, "FF": FINITE}),
        (ca.if_else(w < z, y, 0), {"*N": NUMBER, "*F": FINITE}),
    ],
)  # fmt: skip
def test_what_a_value_can_be_follows_from_its_operands(expression: Any, of: dict[str, int]) -> None:
    """Large numbers may be infinite, infinite ones NaN."""
    kinds = {"A": ANY, "N": NUMBER, "F": FINITE}
    for a, b in itertools.product(kinds, repeat=2):
        wanted = [v for k, v in of.items() if k in (a + b, f"{a}*", f"*{b}")]
        assert written([expression], (kinds[a], kinds[b], FINITE, ANY))[2] == (wanted or [ANY])


def test_what_is_used_twice_has_a_line_and_a_result_its_name() -> None:
    assert written([SINE * SINE + z, SINE - 1])[:2] == (
        ["const double a1 = sin(x + y);"], ["a1 * a1 + z", "a1 - 1.0"])  # fmt: skip
    names = {(0, 0): "first", (1, 0): "second", (2, 0): "third", (3, 0): "fourth"}
    assert written([SINE * z, SINE + 1, w, 3], names=names)[:2] == (
        ["const double a1 = sin(x + y);", "const double first = a1 * z;",
         "const double second = a1 + 1.0;"], ["first", "second", "w", "3.0"])  # fmt: skip
    assert written([BELOW * z, BELOW + w])[:2] == (
        ["const bool a1 = x < y;"], ["(a1 ? 1.0 : 0.0) * z", "(a1 ? 1.0 : 0.0) + w"])  # fmt: skip


def test_results_that_only_have_names_are_written_where_they_are_worth_it() -> None:
    """Those that are modest have a line only where they are used twice, or long."""
    names = {(0, 0): "first", (1, 0): "inner", (2, 0): "unused"}
    found = written([SUM * x, SUM, SINE], names=names, shown=1)
    assert found[:2] == (["const double inner = z + w;"], ["inner * x"])
    found = written([SUM * x, SUM, SINE], names=names, shown=1, modest=True)
    assert found[:2] == ([], ["(z + w) * x"])
    twice = written([SUM * (x - SUM), SUM, SINE], names=names, shown=1, modest=True)
    assert twice[:2] == (["const double inner = z + w;"], ["inner * (x - inner)"])
    long = sum((ca.sin(x * k + 0.1234567) for k in range(3, 6)), ca.cos(y * w))
    lines, results, _ = written([long * x, long], names=names, shown=1, modest=True)
    assert results == ["inner * x"]
    assert " ".join(" ".join(lines).split()) == (
        "const double inner = cos(y * w) + sin(3.0 * x + 0.1234567) + sin(4.0 * x + 0.1234567)"
        " + sin(5.0 * x + 0.1234567);")  # fmt: skip


def test_values_that_are_known_are_read_and_not_worked_out() -> None:
    assert written([SUM * SINE, SUM, SINE], known=1)[1] == ["a1 * p", "a1", "p"]
    found = written([SINE * x + SUM, 2, SINE, SUM], known=2)
    assert found[:2] == ([], ["p * x + q", "2.0", "p", "q"])


def test_a_long_chain_of_choices_has_a_line_for_each_but_the_last() -> None:
    def chain(n: int) -> Any:
        made = w
        for k in range(1, n + 1):
            made = ca.if_else(x < 2.0 * k, (k + 0.5) * y, made)
        return made

    lines, (last,), _ = written([chain(7)])
    before = ["w", *(f"a{k}" for k in range(1, 7))]
    assert lines == [
        f"const double a{k} = (x < {2.0 * k}) ? {k + 0.5} * y : {before[k - 1]};"
        for k in range(1, 7)
    ]
    assert last == "(x < 14.0) ? 7.5 * y : a6"
    lines, (whole,), _ = written([chain(3)])
    assert lines == []
    assert whole == (
        "(x < 6.0) ? 3.5 * y : ((x < 4.0) ? 2.5 * y : ((x < 2.0) ? 1.5 * y : w))")  # fmt: skip


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.0"), (-0.0, "-0.0"), (1.5, "1.5"), (20000.0, "20000.0"), (1e5, "1e5"),
        (120000.0, "120000.0"), (1.2e6, "12e5"), (-3e7, "-3e7"), (1e22, "1e22"), (1e-7, "1e-07"),
        (0.1, "0.1"), (100000.5, "100000.5"), (float("nan"), "((double)NAN)"),
        (float("inf"), "((double)INFINITY)"), (float("-inf"), "(-(double)INFINITY)"),
    ],
)  # fmt: skip
def test_a_number_is_written_shortly_and_reads_back_to_its_bits(value: float, text: str) -> None:
    assert number(value) == text
    assert "(" in text or float(text).hex() == value.hex()


def test_the_sign_of_a_zero_is_kept_in_what_is_chosen_and_not_in_the_condition() -> None:
    inner = ca.if_else(z < w, x, y)
    assert written([ca.atan2(ca.if_else(inner, z, w), x)])[1] == [
        "atan2(((((z < w) ? x : y) != 0.0) ? z : w) + 0.0, x)"]  # fmt: skip
    assert written([ca.atan2(x, ca.if_else(y, z, inner))])[1] == [
        "atan2(x, ((y != 0.0) ? z : ((z < w) ? x : y) + 0.0) + 0.0)"]  # fmt: skip
    assert written([ca.copysign(inner, x) * inner])[:2] == (
        ["const double a1 = (z < w) ? x : y;"], ["copysign(a1, x) * a1"])  # fmt: skip


def test_of_a_choice_and_of_numbers_it_is_known_what_they_can_be() -> None:
    kinds = (ANY, NUMBER, FINITE, ANY)
    results = [
        ca.if_else(x, y, z),
        ca.if_else(x, z, 2.5),
        ca.if_else(x, z, w),
        2.5,
        ca.inf,
        -ca.inf,
    ]
    assert written([*results, float("nan")], kinds)[2] == [
        NUMBER, FINITE, ANY, FINITE, NUMBER, NUMBER, ANY]  # fmt: skip


def of_nodes(*rows: tuple[int, tuple[int, ...]]) -> list[Node]:
    return [Node(op, args, place=(0, k)) for k, (op, args) in enumerate(rows)]


IN, NOT, PICK, ADD, LE = ca.OP_INPUT, ca.OP_NOT, ca.OP_IF_ELSE_ZERO, ca.OP_ADD, ca.OP_LE


def test_a_choice_is_read_whichever_side_stands_first_and_only_of_opposites() -> None:
    """0 and 1 are conditions, 2 and 3 values, 4 is the opposite of 0."""
    given = [(IN, ()), (IN, ()), (IN, ()), (IN, ()), (NOT, (0,))]
    nodes = of_nodes(*given, (PICK, (0, 2)), (PICK, (4, 3)), (PICK, (1, 3)), (PICK, (2, 3)))
    assert choice(nodes, Node(ADD, (5, 6))) == Node(SELECT, (0, 2, 3))
    assert choice(nodes, Node(ADD, (6, 5))) == Node(SELECT, (0, 2, 3))
    for op, args in ((ADD, (5, 7)), (ADD, (7, 6)), (ADD, (5, 3)), (ADD, (3, 6)), (LE, (5, 6)),
                     (ADD, (6, 8)), (ADD, (8, 6)), (ADD, (5, 4))):  # fmt: skip
        assert choice(nodes, Node(op, args)) == Node(op, args)


def test_a_slope_is_read_of_the_same_two_values_turned_alone() -> None:
    given = [(IN, ()), (IN, ()), (IN, ()), (LE, (0, 1)), (LE, (1, 0)), (LE, (2, 0))]
    more = [(ADD, (3, 4)), (ADD, (4, 3)), (ADD, (3, 5)), (ADD, (0, 3)), (ca.OP_LT, (1, 0)),
            (ADD, (3, 10)), (ca.OP_MUL, (3, 4)), (ADD, (4, 5))]  # fmt: skip
    nodes = of_nodes(*given, *more)
    for above, below in ((3, 6), (3, 7), (4, 6), (4, 7)):
        found = slope(nodes, Node(ca.OP_DIV, (above, below)))
        assert found == Node(SLOPE, nodes[above].args)
    for op, args in ((ca.OP_DIV, (3, 8)), (ca.OP_DIV, (3, 9)), (ca.OP_DIV, (3, 11)),
                     (ca.OP_DIV, (3, 12)), (ca.OP_DIV, (3, 13)), (ca.OP_DIV, (0, 9)),
                     (ca.OP_MUL, (3, 6)), (ca.OP_DIV, (6, 3)), (ca.OP_DIV, (5, 13))):  # fmt: skip
        assert slope(nodes, Node(op, args)) == Node(op, args)


v = ca.SX.sym("v", 6)


def of_vector(*results: Any) -> Writer:
    f = ca.Function("f", [v, x], [ca.SX(r) for r in results])
    return Writer(f, lambda i, k: c.index(c.name("v"), k) if i == 0 else c.name("x"))


def test_elements_are_read_by_their_place_and_sums_of_them_added_one_by_one() -> None:
    taps = x * v[0]
    for k in range(1, 5):
        taps = taps + x * v[k]
    made = of_vector(2 * taps - v[5], taps + v[3] / v[1], v[4]).run()
    assert lines_of(made.lines) == [
        "double a1 = x * v[0];", *(f"a1 += x * v[{k}];" for k in range(1, 5))]  # fmt: skip
    assert [made.result(n).text for _, n in made.results] == [
        "2.0 * a1 - v[5]", "a1 + v[3] / v[1]", "v[4]"]  # fmt: skip


def test_an_atom_and_a_condition_are_asked_for_one_by_one() -> None:
    made = of_vector(x - v[2], x < v[1], v[3]).run()
    (_, first), (_, second), (_, third) = made.results
    assert [made.condition(n).text for n in (first, second, third)] == [
        "(int)(x - v[2]) != 0", "x < v[1]", "(int)(v[3]) != 0"]  # fmt: skip
    assert lines_of(made.lines) == []
    assert [made.atom(n).text for n in (third, first, first)] == ["v[3]", "a1", "a1"]
    assert made.atom(second).text == "(a2 ? 1.0 : 0.0)"
    assert lines_of(made.lines) == ["const double a1 = x - v[2];", "const bool a2 = x < v[1];"]


def test_what_is_too_wide_gets_lines_for_its_widest_operands() -> None:
    """Those of which there is nothing to be taken out stay as wide as they are."""
    wide = x
    for k in range(30):
        wide = ca.atan2(wide, v[k % 6] + k)
    made = of_vector(wide).run()
    assert len(made.lines) > 1
    text = [made.result(n).text for _, n in made.results]
    whole = {f"a{k}": line.parts[0].parts[1].text for k, line in enumerate(made.lines, start=1)}
    assert all(len(t) <= WIDTH for t in [*text, *whole.values()])
    while any(re.search(r"\ba\d+\b", t) for t in text):
        text = [re.sub(r"\ba\d+\b", lambda m: whole[m[0]], t) for t in text]
    wanted = "x"
    for k in range(30):
        wanted = f"atan2({wanted}, v[{k % 6}]{f' + {float(k)}' if k else ''})"
    assert text == [wanted]
