"""Places that a search has found, and truths that are asked again: C without a detour."""

from __future__ import annotations

import casadi as ca
import pytest
from test_arrays import MATRIX, NUMBER, VECTOR, Prepared, argument, numbers

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.graph import CHOSEN, Step
from slipctl.ccode.tree.parser import expression
from slipctl.ccode.tree.printer import lines_of
from slipctl.ccode.tree.vectors import loop

LT, ADD, MUL, AT = ca.OP_LT, ca.OP_ADD, ca.OP_MUL, ca.OP_GETNONZEROS_PARAM
ZERO, ONE = numbers(0.0), numbers(1.0)


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        ([ZERO, Step(LT, (3, 2))], "s < A[5]"),
        ([ONE, Step(LT, (3, 2))], "1.0 < ((s < A[5]) ? 1.0 : 0.0)"),
        ([ZERO, Step(LT, (2, 3))], "((s < A[5]) ? 1.0 : 0.0) < 0.0"),
        ([ZERO, Step(LT, (3, 0))], "0.0 < s"),
        ([ZERO, Step(ca.OP_LE, (3, 2))], "0.0 <= ((s < A[5]) ? 1.0 : 0.0)"),
    ],
    ids=["above 0", "above 1", "below 0", "a number above 0", "from 0"],
)
def test_a_truth_above_zero_is_that_truth(asked: list[Step], text: str) -> None:
    made = Prepared([NUMBER, argument(0, 1, 5), Step(LT, (0, 1)), *asked], [4]).run()
    assert made.values[4].c.text == text
    assert made.values[4].truth


def searched(*more: Step, results: list[int]) -> Prepared:
    """A place in the vector that a number is looked for in; it is operation 2."""
    table = argument(1, 3, 1)
    found = Step(ca.OP_LOW, (0, 1), detail=2)
    return Prepared([table, NUMBER, found, MATRIX, ONE, *more], results).run()


def test_what_is_read_at_a_place_that_was_found_needs_no_other_search() -> None:
    """There, and one further; beyond what is known to be inside it is asked for."""
    made = searched(Step(AT, (3, 2), detail=12), Step(ADD, (2, 4)), Step(AT, (3, 6), detail=12),
                    Step(AT, (0, 2), detail=3), Step(AT, (0, 6), detail=3),
                    Step(AT, (0, 6), detail=2), Step(MUL, (2, 6)),
                    results=[5, 7, 8, 9, 10, 11])  # fmt: skip
    found = [made.values[k].c.text for k in (5, 7, 8, 9, 11)]
    assert found == ["A[k1]", "A[k1 + 1]", "v[k1 + 1]", "v[k1 + 1 + 1]",
                     "(double)(k1) * (double)(k1 + 1)"]  # fmt: skip
    assert lines_of(made.lines) == [
        "const int k1 = reached(&v[1], 2, s);",
        "const double a2 = element(&v[1], 2, (double)(k1 + 1));",
    ]


@pytest.mark.parametrize(
    ("statement", "wanted"),
    [
        ("a[@] = 2.5;", "fill(a, 4, 2.5);"), ("a[3 + @] = -2.5;", "fill(&a[3], 4, -2.5);"),
        ("a[@] = b[@];", "copy(a, b, 4);"),
        ("p->a[2 + @] = b[1 + @];", "copy(&p->a[2], &b[1], 4);"),
        ("a[@] = -x;", "for (int i = 0; i < 4; ++i) { a[i] = -x; }"),
        ("a[@] += 2.5;", "for (int i = 0; i < 4; ++i) { a[i] += 2.5; }"),
        ("a[@] = b[2 * @];", "for (int i = 0; i < 4; ++i) { a[i] = b[2 * i]; }"),
        ("a[2 * @] = 1.0;", "for (int i = 0; i < 4; ++i) { a[2 * i] = 1.0; }"),
        ("s += b[@];", "for (int i = 0; i < 4; ++i) { s += b[i]; }"),
    ],
)  # fmt: skip
def test_a_loop_that_only_moves_numbers_is_a_call(statement: str, wanted: str) -> None:
    left, sign, right = statement.rstrip(";").replace("@", "at").partition(
        " += " if "+=" in statement else " = ")  # fmt: skip
    to, value = (expression(t).swap({"at": c.name("@")}) for t in (left, right))
    assert lines_of(loop(4, c.assign(to, value, sign.strip()))) == [wanted]


def test_elements_one_by_one_stand_in_the_declaration_of_their_array() -> None:
    chosen = [Step(CHOSEN, (0,), size=3, detail=places) for places in ([3, -1, 0], [2, 0, 1])]
    made = Prepared([VECTOR, *chosen], [1, 2]).run()
    assert lines_of(made.lines) == [
        "const double a1[3] = {v[3], 0.0, v[0]};", "const double a2[3] = {v[2], v[0], v[1]};",
    ]  # fmt: skip


def test_results_that_only_have_names_are_not_written_for_themselves() -> None:
    """The second names what the first uses twice, the third what nobody uses."""
    operations = [
        NUMBER,
        argument(0, 1, 5),
        Step(ADD, (0, 1)),
        Step(MUL, (2, 2)),
        Step(MUL, (2, 0)),
    ]
    names = {0: "first", 1: "inner", 2: "unused"}
    made = Prepared(operations, [3, 2, 4], hidden=1, names=names).run()
    assert made.results == [((0, 0), 3)]
    assert lines_of(made.lines) == [
        "const double inner = s + A[5];", "const double first = inner * inner;",
    ]  # fmt: skip
    whole = Prepared(operations, [3, 2, 4], names=names).run()
    assert [n for _, n in whole.results] == [3, 2, 4]
    assert lines_of(whole.lines)[-1] == "const double unused = inner * s;"
