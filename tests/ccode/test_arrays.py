"""Vectors and matrices in C, operation by operation: every bit is that of CasADi, or of numpy.

All Functions of a test are one file of C, which is compiled once.
"""

from __future__ import annotations

import ctypes
import itertools
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl.ccode.compile import compilers
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.arrays import Arrays
from slipctl.ccode.tree.expressions import Unsupported
from slipctl.ccode.tree.functions import Functions, returns_number
from slipctl.ccode.tree.graph import CALLED, CHOSEN, JOINED, PRODUCT, SLICE, Step
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.parser import expression
from slipctl.ccode.tree.printer import file_text, lines_of
from slipctl.ccode.tree.vectors import AT, by_blocks, element, place

compiled = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
HEAD = "#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n"
P = ctypes.POINTER(ctypes.c_double)

A, v, s, w = ca.MX.sym("A", 3, 4), ca.MX.sym("v", 4), ca.MX.sym("s"), ca.MX.sym("w", 3)
GIVEN = [
    np.array([[0.3, -1.7, 2.9, 0.11], [5.3, -0.2, 1.9, -7.1], [0.7, 3.1, -4.3, 0.9]]),
    np.array([1.3, -0.7, 0.0, 2.1]), np.array([[0.37]]), np.array([-0.9, 1.7, 0.23]),
]  # fmt: skip
ONE = ca.Sparsity.triplet(3, 4, [1], [2])
LOW = ca.Sparsity.triplet(3, 4, [0, 2], [1, 3])
_x, _s = ca.SX.sym("x", 4), ca.SX.sym("s")
G = ca.Function("g", [_s, _x], [_s + _x[0] * _x[3]])
TWO = ca.Function("two", [_x, _s], [_s * _x, _x[1] + _s])

EXPRESSIONS = {
    "part_turned": 2 * ca.horzsplit(A, [0, 1, 3, 4])[1].T,
    "whole_turned": A.T - 1,
    "vector_above_zero": ca.vertcat((v > s) > 0, v > 0, (v > s) > 1, (v > s) < 0),
    "number_above_zero": ((s > w[0]) > 0) + 3 * (s > 0) + 5 * ((s > w[0]) > 1) + 7 * (w[0] < 0),
    "one_number_in_places": ca.repmat(2 * s + 1, 4, 1)[1:3] * w[:2],
    "one_number_in_columns": ca.repmat(2 * s + w[0], 1, 4) * v.T,
    "row_in_columns": ca.repmat(w, 1, 4) * A,
    "an_element_three_times": (s * w[1]).nz[[0, 0, 0]] * w.T,
    "of_some_places": ca.densify(ca.project(ca.project(A, LOW), LOW)) + A,
    "one_place": ca.densify(ca.project(A, ONE)) * s,
    "blocks": A[:2, :],
    "blocks_of_two": ca.vec(A[1:3, :]) * s + ca.vec(A[:2, :]),
    "blocks_twice": ca.sin(ca.vec(A[1:3, :])) * ca.vec(A[1:3, :]),
    "parts_added": ca.repsum(A, 1, 2),
    "turned_parts_added": ca.repsum(A.T * s, 1, 3) * v,
    "called_without_number": G(ca.MX(1, 1), v) + s,
    "called_without_vector": G(s, ca.MX(4, 1)),
    "second_of_two": TWO(2 * v, s + 1)[1],
    "first_of_two": TWO(2 * v, s + 1)[0] * v,
}  # fmt: skip
SHOWN = {
    "whole_turned": 1, "vector_above_zero": 6, "one_number_in_columns": 2, "row_in_columns": 1,
    "an_element_three_times": 2, "one_place": 2, "blocks": 1, "blocks_of_two": 1,
    "parts_added": 2, "part_turned": 1, "called_without_number": 2, "called_without_vector": 4,
}  # fmt: skip
"""Statements that are needed: a vector that is used once has no array."""


def build(texts: Sequence[str], folder: Path) -> ctypes.CDLL:
    """C of functions ``run0``, ``run1``, ... with addresses of what they are given and give."""
    (folder / "all.c").write_text(HEAD + "\n".join(texts), encoding="utf-8")
    flags = ["-std=c99", "-O0", "-Wall", "-Wshadow", "-Werror", "-shared", "-fPIC"]
    command = ["gcc", *flags, "-ffp-contract=off", "all.c", "-o", "all.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


def called(unit: ctypes.CDLL, k: int, given: Sequence[np.ndarray], sizes: Sequence[int]) -> Any:
    """Results of a function of it, by columns."""
    columns = [np.array(x, float).ravel(order="F") for x in given]
    found = [np.full(n, np.nan) for n in sizes]
    a, r = ((P * len(rows))(*(x.ctypes.data_as(P) for x in rows)) for rows in (columns, found))
    getattr(unit, f"run{k}")(a, r)
    return found


@compiled
def test_each_operation_gives_the_bits_of_casadi_and_no_array_too_much(tmp_path: Path) -> None:
    made, texts, functions = Functions({}), [], []
    for k, (name, expression_) in enumerate(EXPRESSIONS.items()):
        f = ca.Function(name, [A, v, s, w], [ca.densify(expression_)])
        functions.append(f)
        own = made.name(f)
        places = ["a[0]", "a[1]", "*a[2]", "a[3]"]
        given = ", ".join(places if returns_number(f) else [*places, "r[0]"])
        call = f"*r[0] = {own}({given})" if returns_number(f) else f"{own}({given})"
        texts.append(f"void run{k}(const double **a, double **r) {{ (void)r; {call}; }}")
        body = [n for n in made.made[own].parts[1].parts if "(void)" not in lines_of([n])[0]]
        assert len(body) == SHOWN.get(name, len(body)), lines_of(body)
    whole = list(made.made.values())
    unit = build([file_text([*helpers(whole), *whole]), *texts], tmp_path)
    for k, f in enumerate(functions):
        (found,) = called(unit, k, GIVEN, [f.nnz_out(0)])
        expected = np.array(f(*GIVEN)).ravel(order="F")
        np.testing.assert_array_equal(found, expected, err_msg=f.name())
        assert np.ptp(expected) > 0 or len(expected) == 1 or f.name() == "vector_above_zero"


class Prepared(Arrays):
    """Statements of operations that are given: what CasADi itself seldom leaves."""

    def __init__(self, prepared: list[Step], results: list[int], **given: Any) -> None:
        self.prepared, self.given_outputs = prepared, results
        sources = [place(c.name("A"), 0), place(c.name("v"), 0), c.name("s")]
        f = ca.Function("none", [], [])
        super().__init__(f, sources, given.pop("call", None), **given)

    def _read(self, f: ca.Function) -> Any:
        self.said, self.outputs = {}, self.given_outputs
        return self.prepared, []


def argument(i: int, size: int, offset: int = 0) -> Step:
    """A piece of an argument: the matrix, the vector or the number."""
    return Step(ca.OP_INPUT, (), 0.0, (i, 0), size, offset)


def numbers(*values: float) -> Step:
    return Step(ca.OP_CONST, (), values[0] if values else 0.0, size=len(values), detail=[*values])


MATRIX, VECTOR, NUMBER = argument(0, 12), argument(1, 4), argument(2, 1)
SUM = Step(ca.OP_ADD, (0, 1), size=1)
ONES = (1, 1, 1)
a, b = GIVEN[0].ravel(order="F"), GIVEN[1]
n = float(GIVEN[2].item())
EMPTY = Step(ca.OP_CONST, (), 0.0, size=0, detail=[])

PREPARED: dict[str, tuple[list[Step], Any, int]] = {
    # operations, the numbers of the last of them, statements before it
    "product_of_numbers": (
        [NUMBER, argument(0, 1, 5), Step(ca.OP_ADD, (0, 1)), argument(1, 1, 3),
         Step(PRODUCT, (3, 2, 1), detail=ONES)], [b[3] + (n + a[5]) * a[5]], 0),
    "product_of_numbers_turned": (
        [NUMBER, argument(0, 1, 5), Step(ca.OP_ADD, (0, 1)), argument(1, 1, 3),
         Step(PRODUCT, (3, 1, 2), detail=ONES)], [b[3] + a[5] * (n + a[5])], 0),
    "product_of_truths": (
        [NUMBER, argument(0, 1, 5), Step(ca.OP_LT, (0, 1)), argument(1, 1, 3),
         Step(PRODUCT, (1, 3, 2), detail=ONES)], [a[5] + b[3] * (n < a[5])], 0),
    "product_used_twice": (
        [NUMBER, argument(0, 1, 5), argument(1, 1, 3), Step(PRODUCT, (0, 1, 2), detail=ONES),
         Step(ca.OP_MUL, (3, 3))], [(n + a[5] * b[3]) ** 2], 1),
    "product_divided": (
        [NUMBER, argument(0, 1, 5), argument(1, 1, 3), Step(PRODUCT, (0, 1, 2), detail=ONES),
         Step(ca.OP_DIV, (2, 3))], [b[3] / (n + a[5] * b[3])], 0),
    "column_by_number": (
        [argument(0, 3, 3), VECTOR, Step(SLICE, (1,), size=1, detail=(3, 1)), argument(0, 3, 6),
         Step(PRODUCT, (3, 0, 2), size=3, detail=(3, 1, 1))], a[6:9] + a[3:6] * b[3], 3),
    "row_by_column": (
        [argument(0, 3, 3), argument(1, 3, 1), NUMBER,
         Step(PRODUCT, (2, 0, 1), size=1, detail=(1, 3, 1))], None, 2),
    "nothing_joined_to_a_vector": (
        [EMPTY, VECTOR, Step(JOINED, (0, 1), size=4), Step(ca.OP_SIN, (2,), size=4)],
        np.sin(b), 0),
    "piece_of_one_number_everywhere": (
        [numbers(2.5, 2.5, 2.5, 2.5), argument(1, 2, 1), Step(SLICE, (0,), size=2, detail=(1, 2)),
         Step(ca.OP_MUL, (1, 2), size=2)], 2.5 * b[1:3], 0),
    "piece_of_counted_numbers": (
        [numbers(3.0, 4.0, 5.0, 6.0), argument(1, 2, 1), Step(SLICE, (0,), size=2, detail=(1, 2)),
         Step(ca.OP_MUL, (1, 2), size=2)], np.array([4.0, 6.0]) * b[1:3], 2),
    "counted_from_zero": (
        [numbers(0.0, 1.0, 2.0, 3.0), VECTOR, Step(ca.OP_ADD, (0, 1), size=4)],
        np.arange(4) + b, 0),
    "counted_from_below": (
        [numbers(-2.0, -1.0, 0.0, 1.0), VECTOR, Step(ca.OP_MUL, (0, 1), size=4)],
        (np.arange(4) - 2) * b, 0),
    "as_one_below_zero": (
        [numbers(-2.0, -2.0, -2.0, -2.0), VECTOR, Step(ca.OP_MUL, (0, 1), size=4)], -2 * b, 0),
    "some_numbers": (
        [numbers(-2.0, 7.0, 0.5, 1.0), VECTOR, Step(ca.OP_MUL, (0, 1), size=4)],
        np.array([-2.0, 7, 0.5, 1]) * b, 1),
    "one_of_a_sum": (
        [argument(0, 4, 4), VECTOR, Step(ca.OP_ADD, (0, 1), size=4),
         Step(SLICE, (2,), size=1, detail=(2, 1))], [a[6] + b[2]], 0),
    "every_second_of_a_sum": (
        [argument(0, 4, 4), VECTOR, Step(ca.OP_ADD, (0, 1), size=4),
         Step(SLICE, (2,), size=2, detail=(1, 2))], (a[4:8] + b)[1::2], 2),
    "places_of_a_piece": (
        [argument(0, 4, 4), Step(CHOSEN, (0,), size=4, detail=[3, -1, 0, 3])],
        np.array([a[7], 0, a[4], a[7]]), 1),
    "no_place_of_a_piece": (
        [argument(0, 4, 4), Step(CHOSEN, (0,), size=2, detail=[-1, -1]), argument(1, 2, 2),
         Step(ca.OP_ADD, (1, 2), size=2)], b[2:], 0),
    "a_number_in_all_places": (
        [NUMBER, argument(1, 1, 3), Step(ca.OP_ADD, (0, 1)),
         Step(CHOSEN, (2,), size=3, detail=[0, 0, 0]), argument(0, 3, 1),
         Step(ca.OP_DIV, (4, 3), size=3)], a[1:4] / (n + b[3]), 1),
    "a_number_in_some_places": (
        [NUMBER, Step(CHOSEN, (0,), size=3, detail=[0, -1, 0])], np.array([n, 0.0, n]), 3),
    "one_place_of_many": (
        [argument(0, 4, 4), Step(CHOSEN, (0,), size=1, detail=[3])], [a[7]], 0),
}  # fmt: skip
"""``row_by_column`` goes by the sum of the loop, whose order is one by one."""


def written(made: Arrays, size: int, k: int) -> str:
    """C that computes the last operation."""
    last = made.values[len(made.nodes) - 1]
    lines = lines_of(made.lines)
    results = [f"r[0][{i}] = {element(made._real(last), i).text};" for i in range(size)]
    begin = f"void run{k}(const double **a, double **r)"
    local = "const double *A = a[0], *v = a[1], s = *a[2]; (void)A; (void)v; (void)s;"
    return "\n".join([begin, "{", local, *lines, *results, "}"])


@compiled
def test_operations_that_are_given_are_those_of_numpy(tmp_path: Path) -> None:
    texts, all_made = [], []
    for k, (name, (operations, expected, before)) in enumerate(PREPARED.items()):
        made = Prepared(operations, [len(operations) - 1]).run()
        assert len(made.lines) == before, (name, lines_of(made.lines))
        size = 1 if expected is None else len(expected)
        texts.append(written(made, size, k))
        all_made += made.lines
    unit = build([file_text(helpers([c.block(all_made)])), *texts], tmp_path)
    for k, (name, (_, expected, _)) in enumerate(PREPARED.items()):
        wanted = expected
        if wanted is None:
            wanted = [n + a[3] * b[1] + a[4] * b[2] + a[5] * b[3]]
        (found,) = called(unit, k, GIVEN[:3], [len(wanted)])
        np.testing.assert_array_equal(found, np.array(wanted, float), err_msg=name)


def calls_of(
    arguments: tuple[int, ...], *nodes: Step, results: int = 1
) -> tuple[Prepared, list[Any]]:
    """A call of ``two`` or ``g`` with these operations as arguments, and what it is written as."""
    heard: list[Any] = []
    g = TWO if results == 2 else G
    calls = [
        Step(CALLED, arguments, 0.0, (0, k), g.nnz_out(k), (g, 0, tuple(range(results))))
        for k in range(results)
    ]
    made = Prepared(
        [*nodes, *calls], [len(nodes)], call=lambda _, f, given, found: heard.append(
            (f.name(), [x.text if x else None for x in given],
             [x.text if x else None for x in found]))
    ).run()  # fmt: skip
    return made, heard


def test_a_call_has_a_zero_for_each_number_it_is_not_given() -> None:
    made, heard = calls_of((0, 1), EMPTY, VECTOR)
    ((name, (first, second), results),) = heard
    assert (name, first, second, len(results)) == ("g", "0.0", "v", 1)
    assert made.lines == []
    made, heard = calls_of((0, 1), NUMBER, EMPTY)
    ((name, (first, second), results),) = heard
    assert (name, first, len(results)) == ("g", "s", 1)
    assert lines_of(made.lines) == [f"static const double {second}[4] = {{0.0}};"]


def test_only_results_that_are_used_have_a_place() -> None:
    """Here the first of two, which is a vector."""
    made, heard = calls_of((1, 0), NUMBER, argument(0, 4, 4), results=2)
    ((name, given, (vector, number)),) = heard
    assert (name, given, number) == ("two", ["&A[4]", "s"], None)
    assert lines_of(made.lines) == [f"double {vector}[4];"]
    assert made.values[2].c == place(c.name(vector), 0)


def test_a_call_with_a_vector_of_another_size_is_not_written() -> None:
    with pytest.raises(Unsupported):
        calls_of((0, 1), NUMBER, argument(1, 3))
    with pytest.raises(Unsupported):
        calls_of((0, 1), argument(1, 3), VECTOR)


def test_an_element_of_a_value_is_read_by_its_place() -> None:
    made = Prepared([VECTOR, argument(0, 4, 4), Step(ca.OP_ADD, (0, 1), size=4)], [2]).run()
    assert [made.at(k, 2).text for k in range(3)] == ["v[2]", "A[6]", "v[2] + A[6]"]
    assert [made._source(k, 9).text for k in range(3)] == ["A[@]", "v[@]", "s"]


@pytest.mark.parametrize("offset", [0, 5])
def test_the_index_of_blocks_is_that_of_each_element(offset: int) -> None:
    """Whatever the size of a block, the step in it, how far they are apart and where they begin."""
    several = itertools.product((1, 2, 3, 4), (0, 1, 2), (1, 4, 7), (0, 3), (4, 8))
    for size, step, apart, first, blocks in several:
        places = [first + b_ * apart + k * step for b_ in range(blocks) for k in range(size)]
        found = by_blocks(places, offset)
        if len(places) < 8:
            assert found is None
            continue
        assert found is not None
        evaluated = found.text.replace("/", "//")
        index = [eval(evaluated.replace(AT.head, str(k))) for k in range(len(places))]
        assert index == [offset + p for p in places], found.text
        assert ("0 +" in found.text, found.text.startswith("0")) == (False, False)


@pytest.mark.parametrize("places", [
    [0, 1, 2, 3, 4, 5, 6],  # too few
    [0, 1, 4, 5, 8, 9, 12, 14], [0, 1, 4, 5, 9, 10, 12, 13], [-1, 0, 4, 5, 9, 10, 14, 15],
    [8, 9, 6, 7, 4, 5, 2, 3],  # from behind
    [1, 0, 5, 4, 9, 8, 13, 12], [3, 3, 3, 3, 3, 3, 3, 3],
])  # fmt: skip
def test_places_without_blocks_upwards_have_no_index(places: list[int]) -> None:
    assert by_blocks(places, 0) is None


@pytest.mark.parametrize(("text", "k", "wanted"), [
    ("a[@]", 3, "a[3]"), ("a[4 + @]", 3, "a[7]"), ("a[4 + 3 * @]", 2, "a[10]"),
    ("a[(@ % 3) * 4 + @ / 3]", 7, "a[6]"), ("a[(@ % 3) * 4 + @ / 3]", 8, "a[10]"),
    ("a[2 + @ / 5 * 31 + @ % 5]", 13, "a[67]"), ("a[@] + b[1 + @]", 4, "a[4] + b[5]"),
    ("b[a[@]]", 2, "b[a[2]]"), ("(double)(@)", 6, "(double)(6)"), ("x + y", 3, "x + y"),
])  # fmt: skip
def test_an_element_has_its_index_worked_out(text: str, k: int, wanted: str) -> None:
    vector = expression(text.replace("@", "at")).swap({"at": AT})
    assert element(vector, k).text == wanted


def test_an_index_of_a_loop_stays_and_a_zero_before_it_goes() -> None:
    vector = c.index(c.name("a"), c.op(c.integer(0), "+", AT))
    assert element(vector, c.name("i")).text == "a[i]"
    vector = place(c.name("a"), 3, 2)
    assert element(vector, c.name("i")).text == "a[3 + 2 * i]"


KNOWN = {"f": {"x": ("tune", {0: "gain", 2: "lag"})}}


@pytest.mark.parametrize(("read", "wanted"), [
    ("x[0]", "x[TUNE_GAIN]"), ("x[2]", "x[TUNE_LAG]"), ("x[1]", "x[1]"), ("y[0]", "y[0]"),
    ("x[2 + i]", "x[TUNE_LAG + i]"), ("x[1 + i]", "x[1 + i]"), ("x[i]", "x[i]"),
    ("x[2 * i]", "x[2 * i]"), ("m->x[0]", "m->x[0]"), ("x[0] * y[2]", "x[TUNE_GAIN] * y[2]"),
    ("x[i + 2]", "x[i + 2]"), ("x + 2", "x + 2"),
])  # fmt: skip
def test_numbers_of_a_known_vector_are_read_by_their_names(read: str, wanted: str) -> None:
    made = Functions({}, vector_names=KNOWN)
    f = ca.Function("f", [ca.MX.sym("x", 4), ca.MX.sym("y", 4)], [], ["x", "y"], [])
    lines = [c.assign(c.name("r"), expression(read))]
    assert lines_of(made._by_names(f, lines, ["x", "y"], [])) == [f"r = {wanted};"]
    places = {"TUNE_GAIN": ("tune", 0), "TUNE_LAG": ("tune", 2)}
    assert made.enums == {word: place for word, place in places.items() if word in wanted}


def test_a_name_of_two_places_is_read_by_number_the_second_time() -> None:
    said = {"f": {"x": ("tune", {0: "gain", 2: "gain"}), "o": ("tune", {1: "lag"})}}
    made = Functions({}, vector_names=said)
    x = ca.MX.sym("x", 4)
    f = ca.Function("f", [x], [x[:2]], ["x"], ["o"])
    lines = [c.assign(expression("out[1]"), expression("x[0] + x[2]"))]
    assert lines_of(made._by_names(f, lines, ["x"], ["out"])) == [
        "out[TUNE_LAG] = x[TUNE_GAIN] + x[2];"
    ]
    assert made.enums == {"TUNE_GAIN": ("tune", 0), "TUNE_LAG": ("tune", 1)}
