"""The graph of an MX Function: each operation with what it takes, how much it gives, and how."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import pytest

from slipctl.ccode.tree import graph
from slipctl.ccode.tree.expressions import Unsupported
from slipctl.ccode.tree.graph import (
    CALLED,
    CHOSEN,
    DOT,
    JOINED,
    LARGEST,
    PRODUCT,
    SLICE,
    SMALLEST,
    SPARSE_PRODUCT,
    SPREAD,
    SUM_OF,
    TURNED,
    steps,
)

A, B = ca.MX.sym("A", 2, 3), ca.MX.sym("B", 2, 3)
v, w, s = ca.MX.sym("v", 2), ca.MX.sym("w", 3), ca.MX.sym("s")
S = ca.MX.sym("S", ca.Sparsity.triplet(2, 3, [0, 1, 1], [1, 0, 2]))
_x, _s = ca.SX.sym("x", 3), ca.SX.sym("s")
TWO = ca.Function("two", [_x, _s], [_s * _x, _x[1] + _s])


def put(to: Any, at: Any, value: Any) -> Any:
    """A matrix with something else in a place."""
    made = ca.MX(to)
    made[at] = value
    return made


ROWS: dict[str, tuple[Any, int, str, int, Any]] = {
    # expression, the last operation, what it takes, how many numbers it gives, details
    "turned": (A.T, TURNED, "A", 6, (2, 3)),
    "under": (ca.vertcat(v, w, s), JOINED, "v w s", 6, None),
    "beside": (ca.horzcat(A, v), JOINED, "A v", 8, None),
    "piece": (w[1:], SLICE, "w", 2, (1, 1)),
    "every second": (w[::2], SLICE, "w", 2, (0, 2)),
    "row": (A[1, :], SLICE, "A", 3, (1, 2)),
    "columns": (A[:, 1:], SLICE, "A", 4, (2, 1)),
    "chosen": (w[[2, 0, 2]], CHOSEN, "w", 3, [2, 0, 2]),
    "from behind": (w[::-1], CHOSEN, "w", 3, [2, 1, 0]),
    "put in": (put(w, 1, s), CHOSEN, "(w s)", 3, [0, 3, 2]),
    "copies": (ca.repmat(w, 1, 2), SPREAD, "w", 6, 3),
    "summed": (ca.repsum(A, 1, 3), SUM_OF, "A", 2, 6),
    "largest": (ca.mmax(A), LARGEST, "A", 1, 6),
    "smallest": (ca.mmin(w), SMALLEST, "w", 1, 3),
    "absolute": (ca.norm_1(A[0, :]), ca.OP_NORM1, "[A]", 1, 3),
    "length": (ca.norm_fro(A), ca.OP_NORMF, "A", 1, 6),
    "farthest": (ca.norm_inf(w), ca.OP_NORMINF, "w", 1, 3),
    "dot": (ca.dot(w, A[1, :].T), DOT, "w [[A]]", 1, 3),
    "product": (ca.mtimes(A, w), PRODUCT, "0 A w", 2, (2, 3, 1)),
    "outer product": (ca.mtimes(v, w.T), PRODUCT, "0 v [w]", 6, (2, 1, 3)),
    "few": (ca.mtimes(S, w), SPARSE_PRODUCT, "0 S w", 2, ([0, 1, 2, 3], [1, 0, 1])),
    "filled": (ca.densify(S), CHOSEN, "S", 6, [-1, 0, 1, -1, -1, 2]),
    "low": (ca.low(w, s), ca.OP_LOW, "w s", 1, 2),
    "place": (w[s], ca.OP_GETNONZEROS_PARAM, "w s", 1, 3),
    "split": (ca.vertsplit(w, [0, 1, 3])[1], SLICE, "w", 2, (1, 1)),
    "split in three": (ca.horzsplit(A, [0, 1, 2, 3])[2], SLICE, "A", 2, (4, 1)),
    "sum": (v + s, ca.OP_ADD, "v s", 2, None),
    "shape": (2 * ca.reshape(A, 3, 2), ca.OP_TWICE, "[A]", 6, None),
}  # fmt: skip


def said(nodes: list[Any], k: int) -> str:
    """An operand: an argument, 0, what is joined, what is taken of one."""
    node = nodes[k]
    if node.op == ca.OP_INPUT:
        return "ABvwsS"[node.place[0]]
    if node.op == ca.OP_CONST:
        return "0"
    inside = " ".join(said(nodes, a) for a in node.args)
    return f"({inside})" if node.op == JOINED else f"[{inside}]"


@pytest.mark.parametrize("name", ROWS)
def test_an_operation_has_its_operands_its_size_and_its_details(name: str) -> None:
    expression, op, operands, size, detail = ROWS[name]
    nodes, (last,) = steps(ca.Function("f", [A, B, v, w, s, S], [expression]))
    node: Any = nodes[last]
    assert (node.op, node.size, node.detail) == (op, size, detail)
    assert " ".join(said(nodes, a) for a in node.args) == operands


def test_a_call_knows_its_function_its_number_and_where_each_result_is_wanted() -> None:
    both = TWO(w, s)[0] * TWO(2 * w, s)[1]
    nodes, outputs = steps(ca.Function("f", [A, B, v, w, s, S], [both, TWO(w, s)[0]]))
    called: list[Any] = [n for n in nodes if n.op == CALLED]
    wanted = [(0, 0, 3), (1, 1, 1), (2, 0, 3)]
    assert [(*n.place, n.size) for n in called] == wanted
    assert [n.detail[0].name() for n in called] == ["two"] * 3
    assert [[k >= 0 for k in n.detail[2]] for n in called] == [
        [True, False], [False, True], [True, False]]  # fmt: skip
    assert [said(nodes, a) for n in called for a in n.args] == ["w", "s", "[w]", "s", "w", "s"]
    assert nodes[outputs[0]].op == ca.OP_MUL
    assert nodes[outputs[1]] is called[2]


def test_what_is_the_same_is_there_once_and_results_in_pieces_are_joined() -> None:
    """An argument that is put together of several is read in pieces, each with its place."""
    a, b, c = ca.MX.sym("a", 2), ca.MX.sym("b"), ca.MX.sym("c", 3)
    whole = ca.vertcat(a, b, c)
    results = [b * c, ca.vertcat(ca.sin(a), s), ca.MX(2, 0), ca.vertcat(c, a)]
    results += [2 * w[1:], 3 + w[1:]]
    nodes, outputs = steps(ca.Function("f", [whole, s, w], results))
    pieces: Any = {(n.place, n.size, n.detail) for n in nodes if n.op == ca.OP_INPUT}  # type: ignore[attr-defined]
    assert pieces == {
        ((0, 0), 2, 0),
        ((0, 0), 1, 2),
        ((0, 0), 3, 3),
        ((1, 0), 1, 0),
        ((2, 0), 3, 0),
    }
    assert outputs[2] == -1
    assert sum(n.op == SLICE for n in nodes) == 1
    last: Any = [nodes[n] if n >= 0 else None for n in outputs]
    assert [n and n.size for n in last] == [3, 3, None, 5, 2, 2]
    assert [nodes[k].detail for k in last[3].args] == [3, 0]  # type: ignore[attr-defined]
    assert [nodes[k].op for k in last[1].args] == [ca.OP_SIN, ca.OP_INPUT]


def test_matrices_that_are_put_under_each_other_are_turned_by_casadi_or_not_written() -> None:
    """Their numbers do not follow each other; columns do."""
    for turned in (ca.vertcat(A, B), ca.vertsplit(A, 1)[1]):
        nodes, _ = steps(ca.Function("f", [A, B], [turned]))
        assert sum(n.op == TURNED for n in nodes) > 0

    def of(*columns: bool) -> Any:
        parts = [SimpleNamespace(is_column=lambda c=c: c) for c in columns]
        return SimpleNamespace(n_dep=lambda: len(parts), dep=lambda k: parts[k])

    assert graph._step(ca.OP_VERTCAT, (0, 1), 5, of(True, True), []).op == JOINED
    assert graph._step(ca.OP_HORZCAT, (0, 1), 5, of(True, False), []).op == JOINED
    for columns in ((False, True), (True, False)):
        with pytest.raises(Unsupported, match="vertcat of matrices"):
            graph._step(ca.OP_VERTCAT, (0, 1), 5, of(*columns), [])


class Said:
    """A Function of one argument, whose second operation is what is told."""

    def __init__(self, op: int, mx: Any, inputs: list[int]) -> None:
        one = SimpleNamespace(nnz=lambda: 6, __str__=lambda: "")
        self.ops, self.mx, self.inputs = [ca.OP_INPUT, op], [one, mx], [[0], inputs]

    def n_instructions(self) -> int:
        return 2

    def instruction_id(self, k: int) -> int:
        return self.ops[k]

    def instruction_input(self, k: int) -> list[int]:
        return self.inputs[k]

    def instruction_output(self, k: int) -> list[int]:
        return [[0], [1, -1]][k]

    def instruction_MX(self, k: int) -> Any:
        return self.mx[k]

    def nnz_in(self, i: int) -> int:
        return 6


def test_a_call_without_an_argument_and_a_matrix_that_is_cut_into_rows_are_not_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(graph, "_piece", lambda mx: (0, 0))
    of_two = SimpleNamespace(which_function=lambda: TWO, nnz=lambda: 3)
    with pytest.raises(Unsupported, match="two: an argument that is none"):
        steps(Said(ca.OP_CALL, of_two, [0, -1]))  # type: ignore[arg-type]
    matrix = SimpleNamespace(nnz=lambda: 6, dep=lambda k: A)
    with pytest.raises(Unsupported, match="vertsplit of a matrix"):
        steps(Said(ca.OP_VERTSPLIT, matrix, [0]))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "taken", "free"),
    [
        ("x", set(), "x"), ("x", {"x"}, "x_2"), ("x", {"x", "x_2", "x_3"}, "x_4"),
        ("a1", set(), "a_1"), ("k12", set(), "k_12"), ("r0", {"r_0"}, "r_0_2"), ("b1", set(), "b1"),
        ("ab1", set(), "ab1"), ("a", set(), "a"), ("a_1", set(), "a_1"),
    ],
)  # fmt: skip
def test_a_name_is_free_with_a_number_behind_it(name: str, taken: set[str], free: str) -> None:
    assert graph.free_name(name, taken) == free
    assert graph.claim_name(name, taken) == free
    assert free in taken


def test_arguments_are_called_as_the_function_calls_them_unless_casadi_did() -> None:
    x = ca.SX.sym("x_3"), ca.vertcat(ca.SX.sym("y_0"), ca.SX.sym("y_1")), ca.SX.sym("i7")
    mixed = ca.vertcat(ca.SX.sym("p"), ca.SX.sym("q"))
    f = ca.Function("f", [*x, mixed], [x[0]], ["a", "b", "c", "d.e"], ["o12"])
    assert graph.argument_names(f) == ["x", "y", "", "d_e"]
    g = ca.Function("g", [ca.MX.sym("i0"), ca.MX.sym("i"), w, ca.MX.sym("i0_1")],
                    [w], ["i0", "i1", "i2", "i3"], ["out"])  # fmt: skip
    assert graph.argument_names(g) == ["", "i", "w", ""]
    assert [graph.result_name(k, 0) for k in (f, g)] == ["", "out"]
    assert [graph._counted(n, "i") for n in ("i0", "i12_3", "i1_2_3", "i", "x0", "i_1", "ix")] == [
        True, True, False, False, False, False, False]  # fmt: skip
