"""Blocks of lines as a loop, by whole statements: names, first values, what is worth a loop."""

from __future__ import annotations

import pytest
from module_text import laid_out, with_pass

from slipctl.ccode.passes import rolled_loops
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree.parser import code, expression
from slipctl.ccode.tree.printer import lines_of


def rolled(lines: list[str], taken: set[str] = frozenset()) -> list[str]:  # type: ignore[assignment]
    return with_pass(roll_lines, lines, set(taken))


def test_what_saves_too_little_stays_and_what_comes_behind_it_is_still_a_loop() -> None:
    """Of three lines one loop saves two; what stands before and behind does not count."""
    few = [f"y[{k}] = x[{k}];" for k in range(3)]
    before = ["const bool t = u > w;", "const double q = u / w + 1.5;", "*g = q;", "g(q);"]
    lines = [*before, *few, "const double b = t ? u : w;", "*z = b;"]
    assert rolled(lines) == lines
    many = [f"v[{k}] = b * x[{k}];" for k in range(5)]
    assert rolled([*lines, *many]) == [*lines, "for (int i = 0; i < 5; ++i) { v[i] = b * x[i]; }"]


def test_a_sum_is_a_loop_whatever_it_saves() -> None:
    """Even with another statement behind it in each block; not with one before it."""
    pairs = [(f"s += x[{k}];", f"y[{k}] = 2.0 * x[{k}];") for k in range(3)]
    wanted = ["for (int i = 0; i < 3; ++i) {", "    s += x[i];", "    y[i] = 2.0 * x[i];", "}"]
    assert rolled([line for pair in pairs for line in pair]) == wanted
    turned = [line for pair in pairs for line in pair[::-1]]
    assert rolled(turned)[0] == turned[0]


def test_the_loop_counts_from_the_first_index_where_all_begin_there() -> None:
    assert rolled([f"y[{k}] = x[{k}] + {k}.0;" for k in range(3, 9)]) == [
        "for (int i = 3; i < 9; ++i) { y[i] = x[i] + (double)i; }"]  # fmt: skip
    assert rolled([f"y[{2 * k + 1}] = x[{2 * k + 1}];" for k in range(6)]) == [
        "for (int i = 0; i < 6; ++i) { y[2 * i + 1] = x[2 * i + 1]; }"]  # fmt: skip
    assert rolled([f"y[{k}] = x[{3 * k + 2}] * {k + 1}.0 + {5 * k}.0;" for k in range(6)]) == [
        "for (int i = 0; i < 6; ++i) {"
        " y[i] = x[3 * i + 2] * ((double)i + 1.0) + (5.0 * (double)i + 0.0); }"]  # fmt: skip


def test_the_element_may_be_the_first_statement_of_a_block() -> None:
    """Then the locals; the last one is wanted behind the loop, the other is not."""
    lines = []
    for k in range(5):
        lines += [f"y[{k}] = x[{k}] * u;", f"const double w_{k} = x[{k}] - u;"]
        lines += [f"const double q_{k} = w_{k} * w_{k};"]
    lines += ["*z = q_4;"]
    assert rolled(lines) == laid_out([
        "double q_4;", "for (int i = 0; i < 5; ++i) {", "    y[i] = x[i] * u;",
        "    const double w = x[i] - u;", "    q_4 = w * w;", "}", "*z = q_4;"])  # fmt: skip


def test_locals_of_blocks_are_called_as_all_of_them_or_as_the_first() -> None:
    """By their stem; where that is taken, or two would have it, by the name of the first."""

    def loop(name: str, other: str, taken: set[str], read: str = "x") -> list[str]:
        lines = []
        for k in range(4):
            lines += [f"const double {name.format(k)} = {read}[{k}] * u;"]
            lines += [f"const double {other.format(k)} = {name.format(k)} + 1.5;"]
            lines += [f"y[{k}] = {other.format(k)} * {name.format(k)};"]
        found = rolled(["const bool t = u > 0.0;", *lines, "*g = t ? 1.0 : u;"], taken)
        return [line.strip() for line in found[2:-2]]

    assert loop("w_{}", "q_{}_next", set()) == [
        "const double w = x[i] * u;", "const double q_next = w + 1.5;", "y[i] = q_next * w;",
    ]  # fmt: skip
    assert loop("w_{}", "q_{}", {"w"})[0] == "const double w_0 = x[i] * u;"
    assert loop("w_{}", "t_{}", set())[1] == "const double t_0 = w + 1.5;"
    assert loop("v_{}", "q_{}", set(), "in->v")[0] == "const double v = in->v[i] * u;"
    assert loop("b{}", "a1{}", set()) == [
        "const double b0 = x[i] * u;", "const double a10 = b0 + 1.5;", "y[i] = a10 * b0;",
    ]  # fmt: skip


def test_what_is_read_of_blocks_is_an_array_of_its_kind() -> None:
    lines = [*(f"const bool t_{k} = x[{k}] > u;" for k in range(5)),
             *(f"const double w_{k} = t_{k} ? x[{k}] : u;" for k in range(5)),
             "*y = t_1 ? w_0 : w_3;"]  # fmt: skip
    assert rolled(lines) == laid_out([
        "bool t[5];", "double w[5];", "for (int i = 0; i < 5; ++i) {", "    t[i] = x[i] > u;",
        "    w[i] = t[i] ? x[i] : u;", "}", "*y = t[1] ? w[0] : w[3];"])  # fmt: skip


def test_a_value_that_goes_on_from_block_to_block_is_kept_beside_where_it_is_read_late() -> None:
    """s is read by the statement behind its own; p only before it is given."""
    lines = ["const double s0 = u * 2.0;", "const double p0 = w * 3.0;"]
    for k in range(1, 6):
        lines += [f"const double s{k} = s{k - 1} + x[{k}];"]
        lines += [f"const double p{k} = p{k - 1} * s{k - 1};"]
    found = rolled([*lines, "*y = s5 * p5;"])
    assert found == laid_out([
        *lines[:2], "double s5 = s0;", "double p5 = p0;", "for (int i = 1; i < 6; ++i) {",
        "    const double s1 = s5 + x[i];", "    p5 = p5 * s5;", "    s5 = s1;", "}",
        "*y = s5 * p5;"])  # fmt: skip


def test_shared_lines_move_before_a_block_and_no_line_is_lost() -> None:
    """Those that need nothing of what is made there; also where more than are looked at follow."""
    before = [f"const double b{k} = u + {k * k + 0.5};" for k in range(3)]
    here = ["const double s = x[0] * u;", "const double lift = u - 7.25;", "y[0] = s * lift;",
            "const double late = s / u;"]  # fmt: skip
    rest = [f"z[{k}] = x[{k * k}] * s;" for k in range(50)]
    made, at = rolled_loops._hoisted(code("\n".join([*before, *here, *rest])), 3)
    assert lines_of(made) == [*before, here[1], here[0], *here[2:], *rest]
    assert at == 4
    made, at = rolled_loops._hoisted(code("\n".join([*before, *here, *rest])), 5)
    assert (lines_of(made), at) == ([*before, *here, *rest], 5)


def test_a_result_whose_name_is_taken_keeps_no_other_from_being_a_local() -> None:
    chain = [f"const double p_{k + 1} = sin(p_{k});" for k in range(3)]
    lines = [*chain, "*b = sin(p_2);", "*c = sin(q);", "now->d = sin(p_3);"]
    assert with_pass(lambda n: rolled_loops._with_locals(n, {"p_0", "b_now"})[0], lines) == [
        *chain, "const double d_now = sin(p_3);", *lines[3:5], "now->d = d_now;"]  # fmt: skip
    made, results = rolled_loops._with_locals(code("\n".join(lines)), {"p_0"})
    assert lines_of(made) == [
        *chain[:2], "const double b_now = sin(p_2);", chain[2], "const double d_now = sin(p_3);",
        "*b = b_now;", lines[4], "now->d = d_now;"]  # fmt: skip
    assert lines_of(rolled_loops._without_locals(made, results)) == [
        *chain, "*b = sin(p_2);", lines[4], "now->d = sin(p_3);"]  # fmt: skip


def test_a_run_of_axles_whose_first_differs_keeps_no_other_from_being_a_loop() -> None:
    chain = [
        "const double m_0 = sin(u[0]);",
        *(f"const double m_{k} = u[{k}] + m_{k - 1};" for k in (1, 2)),
    ]
    shared = "const double s = m_2 * x;"
    lines = [*chain, shared, *(f"z[{k}] = u[{k}] * s;" for k in range(3))]
    assert with_pass(rolled_loops._sorted, lines, set()) == [
        *chain, shared, "for (int i = 0; i < 3; ++i) { z[i] = u[i] * s; }"]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "operand", "opens"),
    [
        ("x", True, "x"), ("2.0", True, "2.0"), ("-2.0", True, "-"), ("-x", False, "-"),
        ("x[3]", True, "x"), ("x[i]", False, "x"), ("p->x", True, "p"), ("p->x[2]", True, "p"),
        ("x[1][2]", False, "x"), ("p->q.x", False, "p"), ("f(x)[1]", False, "f"),
        ("x + 1.0", False, "x"), ("2.0 * x", False, "2.0"), ("(x)", False, "("),
        ("(double)i", False, "("), ("a > b ? c : d", False, "a"), ("!x", False, "!"),
        ("f(x)", False, "f"), ("x[2] * y", False, "x"), ("&x", False, "&"),
    ],
)  # fmt: skip
def test_an_operand_is_a_number_or_one_place(text: str, operand: bool, opens: str) -> None:
    assert rolled_loops._is_operand(expression(text)) == operand
    assert rolled_loops._opens(expression(text)) == opens


@pytest.mark.parametrize(
    ("name", "letter", "whole"),
    [
        ("a", False, "a"), ("a1", True, "a1"), ("a12", True, "a12"), ("b12", False, "b12"),
        ("ab1", False, "ab1"), ("a_1", False, "a"), ("x_0_next", False, "x_next"),
        ("x_12", False, "x"), ("next", False, "next"), ("x_y_3", False, "x_y"),
        ("x_next", False, "x_next"),
    ],
)  # fmt: skip
def test_names_of_counted_locals_and_of_elements(name: str, letter: bool, whole: str) -> None:
    assert rolled_loops._is_letter(name) == letter
    assert rolled_loops._of_all(name) == whole
