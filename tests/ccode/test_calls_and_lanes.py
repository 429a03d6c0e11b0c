"""Calls that repeat, loops that are one, axles side by side: whole statements before and after."""

from __future__ import annotations

import pytest
from module_text import laid_out, with_pass

from slipctl.ccode.passes.lanes import _before, in_lanes
from slipctl.ccode.passes.loop_fusion import fuse_loops, made_names, used_names
from slipctl.ccode.passes.repeats import hand_results, roll_calls
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of

# ---- calls ---------------------------------------------------------------------------------------


def test_two_iterations_one_behind_the_other_are_two_loops() -> None:
    """The other begins with what the first ends with; where v_now is taken it is v_now_2."""
    lines = ["double z;", "g(&z);"]
    x, v = "x", "v"
    for k in range(2, 5):
        lines += [f"double x_{k};", f"double v_{k}[2];", f"f({x}, {v}, 2.0, &x_{k}, v_{k});"]
        x, v = f"x_{k}", f"v_{k}"
    q = x
    for k in range(2, 6):
        lines += [f"double q_{k};", f"h({q}, &q_{k});"]
        q = f"q_{k}"
    lines += ["*y = q_5 + v_4[1];"]
    assert with_pass(roll_calls, lines, {"v_now"}) == laid_out([
        "double z;", "double v_now_2[2];", "g(&z);", "double x_now = x;", "copy(v_now_2, v, 2);",
        "for (int i = 0; i < 3; ++i) {", "    double v_next[2];",
        "    f(x_now, v_now_2, 2.0, &x_now, v_next);", "    copy(v_now_2, v_next, 2);", "}",
        "double q_now = x_now;", "for (int i = 0; i < 4; ++i) { h(q_now, &q_now); }",
        "*y = q_now + v_now_2[1];",
    ])  # fmt: skip


def test_an_array_that_the_last_call_writes_elsewhere_is_copied_there() -> None:
    """It goes into no call, so it needs none beside; the middle argument is the same in all."""
    lines = []
    for k in range(1, 4):
        lines += [f"double b_{k};", *[f"double w_{k}[3];"] * (k < 3)]
        given = f"b_{k - 1}" if k > 1 else "x0"
        lines += [f"f({given}, &y, k, &b_{k}, {f'w_{k}' if k < 3 else 'r'});"]
    lines += ["g(b_3, r);"]
    assert with_pass(roll_calls, lines, {"f"}) == [
        "double b_now = x0;", "double w_now[3];",
        "for (int i = 0; i < 3; ++i) { f(b_now, &y, k, &b_now, w_now); }", "copy(r, w_now, 3);",
        "g(b_now, r);",
    ]  # fmt: skip


STEPS = ["double b_1;", "f(x, u, &b_1);", "double b_2;", "f(b_1, u, &b_2);", "double b_3;",
         "f(b_2, u, &b_3);", "*y = b_3;"]  # fmt: skip


@pytest.mark.parametrize(
    ("at", "line"),
    [
        (3, "f(b_1, v, &b_2);"), (5, "f(b_1, u, &b_3);"), (5, "f(b_2, b_2, &b_3);"),
        (5, "h(b_2, u, &b_3);"), (3, "f(b_1, u, &b_2, 1.0);"), (6, "*y = b_3 + b_2;"),
        (5, "f(u, b_2, &b_3);"), (2, "double b_2 = 0.0;"),
        (2, "bool b_2;"), (3, "f(x, u, &b_2);"),
    ],
)  # fmt: skip
def test_calls_that_are_no_iteration_stay(at: int, line: str) -> None:
    """Another argument, another function, or one whose result is wanted besides."""
    assert with_pass(roll_calls, STEPS, set())[0] == "double b_now = x;"
    lines = [*STEPS[:at], line, *STEPS[at + 1 :]]
    assert with_pass(roll_calls, lines, set()) == laid_out(lines)


def test_a_local_of_the_calls_may_have_the_name_of_the_loops_variable() -> None:
    lines = [line.replace("b_1", "b_now") for line in STEPS]
    assert with_pass(roll_calls, lines, set()) == [
        "double b_now = x;", "for (int i = 0; i < 3; ++i) { f(b_now, u, &b_now); }", "*y = b_now;",
    ]  # fmt: skip


def test_calls_of_which_the_last_alone_has_a_local_for_an_array_stay() -> None:
    lines = []
    for k in range(1, 4):
        lines += [f"double b_{k};", *["double w_3[2];"] * (k == 3)]
        lines += [f"f({f'b_{k - 1}' if k > 1 else 'x'}, &b_{k}, {'w_3' if k == 3 else 'r'});"]
    lines += ["*y = b_3 + w_3[1];"]
    assert with_pass(roll_calls, lines, set()) == laid_out(lines)


def test_a_result_is_handed_over_only_where_it_goes_to_one_place_alone() -> None:
    lines = ["double a;", "double b;", "double c;", "f(x, &a, &b, &c);", "*p = a;", "*q = 2.0 * b;",
             "r->s = c;"]  # fmt: skip
    assert with_pass(hand_results, lines) == laid_out(
        ["double b, c;", "f(x, p, &b, &c);", *lines[5:]])  # fmt: skip
    lines = ["double a;", "double b;", "f(x, &a, &b);", "*p = other;", "*q = b;", "*r = a;"]
    assert with_pass(hand_results, lines) == ["f(x, r, q);", "*p = other;"]
    for more in ("*q = a;", "w = a;", "g(p);"):
        stays = ["double a;", "f(x, &a);", "*p = a;", more]
        assert with_pass(hand_results, stays) == stays


# ---- loops that are one --------------------------------------------------------------------------

LOOP = "for (int i = 0; i < 4; ++i) {"


def test_loops_move_before_what_does_not_need_them_with_what_they_begin_with() -> None:
    """The third is kept back by its start, which the loops before give; another count stays."""
    lines = [
        "double a[4];", "double b[4];", "bool c[4];", LOOP, "    a[i] = x[i] * 2.0;",
        "    b[i] = x[3 - i];", "}", "for (int i = 0; i < 3; ++i) {", "    z[i] = x[i];", "}",
        "*m = v;", "double t = w;", LOOP, "    c[i] = a[i] > 0.0;", "    t = t + a[i];", "}",
        "*n = v + 2.0;", "double s = t;", LOOP, "    s = s + b[i];",
        "    y[i] = c[i] ? a[i] : b[i];", "}", "*k = s + t;",
    ]  # fmt: skip
    assert with_pass(fuse_loops, lines) == laid_out([
        *lines[:3], "double t = w;", *lines[3:6], *lines[13:15], "}", *lines[7:11], *lines[16:],
    ])  # fmt: skip


def test_an_array_that_is_only_read_at_hand_is_a_number_also_of_truths_and_what_is_left() -> None:
    """What the last turn leaves is read behind the loop by the name that carries it."""
    lines = [
        "bool c[4];", "double a[4];", LOOP, "    a[i] = x[i] * 2.0;", "    c[i] = a[i] > v;",
        "    s = a[i];", "    y[i] = c[i] ? a[i] : 0.0;", "}", "*n = a[3] - s;", "*m = a[3];",
    ]  # fmt: skip
    assert with_pass(fuse_loops, lines) == laid_out([
        LOOP, "    const double a = x[i] * 2.0;", "    const bool c = a > v;", "    s = a;",
        "    y[i] = c ? a : 0.0;", "}", "*n = s - s;", "*m = s;",
    ])  # fmt: skip
    for other in ("*m = a[2];", "g(a);", "*m = a[j];"):
        stays = ["double a[4];", *lines[2:4], lines[5], "}", other]
        assert with_pass(fuse_loops, stays) == laid_out(stays)


def test_names_that_statements_give_and_read() -> None:
    """An address that is passed on may be given anything; members count with their struct."""
    lines = code(
        "const double a = b * p->c; d[e] = a; double f[3]; *g = 1.0; n->h = q.k; m->s[2] += r;"
        f" {LOOP} t[i] = x[i]; }} w(&u, v);"
    )
    assert made_names(lines) == {"a", "d", "f", "g", "n->h", "m->s", "i", "t", "?"}
    assert used_names(lines) == {
        "a", "b", "p->c", "d", "e", "f", "g", "n->h", "q", "m->s", "r", "t", "x", "u", "v",
    }  # fmt: skip


# ---- axles ---------------------------------------------------------------------------------------


def lanes(lines: list[str]) -> tuple[list[str], list[tuple[int, int]]]:
    made, runs = in_lanes(code("\n".join(lines)))
    return lines_of(made), runs


def test_statements_of_an_axle_stand_together_and_what_is_shared_where_it_is_needed() -> None:
    """A chain from axle to axle begins with another value; w_0 is read by what all share."""
    lines = []
    for k in range(3):
        before = f"m_{k - 1}" if k else "x[5]"
        lines += [f"const double w_{k} = u[{k}] * x[4];", f"const double m_{k} = w_{k} + {before};"]
        lines += ["const double share = w_0 + x[3];"] * (k == 1)
        lines += [f"z[{k}] = w_{k} * w_{k};"]
    lines += ["*y = m_2 * share;", *(f"y[{k}] = m_{k} - share;" for k in range(3))]
    first = [line for k in range(3) for line in lines if f"_{k} =" in line or f"z[{k}]" in line]
    assert lanes(lines) == ([*first, "const double share = w_0 + x[3];", *lines[-4:]],
                            [(0, 3), (11, 1)])  # fmt: skip


def test_a_block_waits_for_what_one_of_its_axles_needs() -> None:
    """Here an axle in the middle reads its own number; the last statement, all of them."""
    lines = []
    for k in range(4):
        lines += [f"const double w_{k} = u[{k}] * x[4];"]
        lines += ["const double lift = x[5] * x[6];"] * (k == 1)
        lines += [f"const double e_{k} = w_{k} * lift;"] * (k > 0)
    lines += ["const double e_0 = w_0 * lift;", "const double s = e_0 + e_3;"]
    found, runs = lanes(lines)
    each = [f"const double {n}_{k} = {v};" for k in range(4)
            for n, v in (("w", f"u[{k}] * x[4]"), ("e", f"w_{k} * lift"))]  # fmt: skip
    assert found == ["const double lift = x[5] * x[6];", *each, "const double s = e_0 + e_3;"]
    assert runs == [(1, 2)]


@pytest.mark.parametrize(
    "lines",
    [
        [f"const double w_{k} = u[{k}] * {k + 2}.0;" for k in range(3)],  # other numbers
        [f"w[{k}] = u[0] * x;" for k in range(2)],  # two are few
        ["const double a = u[0] + u[2];", "const double b = u[1] + u[2];"],
    ],
    ids=["numbers", "two", "of two axles"],
)
def test_what_is_not_the_same_for_each_axle_stays_in_its_order(lines: list[str]) -> None:
    assert lanes(lines)[0] == lines
    assert all(period for _, period in lanes(lines)[1])


@pytest.mark.parametrize(
    "others",
    [
        [f"const double d_{k} = w_{k} - w_{k - 1};" for k in (1, 2)],  # of two that are there
        ["const double m_0 = w_0 + x[5];", "const double m_1 = w_1 + m_0;",
         "const double m_2 = w_2 - m_1;"],  # a chain whose last axle does another thing
        ["y[1] = w_0 + w_1;", "y[0] = w_0 - w_2;"],  # no locals
        ["const double d = u[0] - w_1;", "const double e = w_0 - w_2;"],  # an element of the other
    ],
    ids=["differences", "broken chain", "results", "elements"],
)  # fmt: skip
def test_what_joins_two_axles_keeps_no_other_from_standing_together(others: list[str]) -> None:
    each = [[f"const double w_{k} = u[{k}] * x[4];", f"z[{k}] = w_{k} * w_{k};"] for k in range(3)]
    lines = [*(w for w, _ in each), *others, *(z for _, z in each)]
    found, runs = lanes(lines)
    assert found == [line for own in each for line in own] + others
    assert runs == [(0, 2)]


def test_a_loop_over_axles_keeps_what_is_read_of_one_of_them() -> None:
    lines = [*(f"const double w_{k} = u[{k}] * x[4];" for k in range(4)),
             *(f"const double e_{k} = w_{k} - x[5];" for k in range(4)),
             "const double s = e_0 + e_3;",
             *(f"y[{k}] = e_{k} * s;" for k in range(4))]  # fmt: skip
    assert with_pass(roll_lines, lines, set(), True) == laid_out([
        "double e[4];", LOOP, "    const double w = u[i] * x[4];", "    e[i] = w - x[5];", "}",
        "const double s = e[0] + e[3];", LOOP, "    y[i] = e[i] * s;", "}",
    ])  # fmt: skip


def test_a_statement_waits_for_what_it_reads_and_for_who_reads_what_it_writes() -> None:
    """Elements by their numbers; a loop may touch each of them, and all that stands in it."""
    rows = {
        "const double a = u[0];": set(), "y[0] = a * x[1];": {0}, "y[1] = y[0];": {1},
        "x[1] = 2.0;": {1}, "y[0] = x[2];": {1, 2}, "m->s = y[1];": {2},
        "y[2] += m->s;": {2, 4, 5}, "for (int i = 0; i < 3; ++i) { y[i] = a; }": {0, 1, 2, 4, 5, 6},
        "const double b = y[0];": {4, 7}, "m->s = b;": {6, 8},
        "const double d = x[1] + m->s;": {3, 9},
    }  # fmt: skip
    found = _before(code("\n".join(rows)))
    assert found == list(rows.values())
