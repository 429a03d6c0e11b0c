"""CasADi's C as compilers like it, what of it is refused; and what no Function is written of."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import (
    BadInput,
    End,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    flow,
    sampled,
    simulate,
    step,
)
from slipctl.ccode import codegen
from slipctl.ccode.check.processor.in_loop import Stored, run_in_loop
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import _enums
from slipctl.ccode.request import Checks, Content
from slipctl.ccode.tree import casadi_text, expressions, graph
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import Unsupported, Writer
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.graph import CHOSEN, Step
from slipctl.ccode.tree.parser import code, expression
from slipctl.ccode.tree.printer import file_text, lines_of
from slipctl.ccode.tree.scans import Scan, _moved, scan_lines

# ---- CasADi's text -------------------------------------------------------------------------------


def cleaned(text: str) -> str:
    return " ".join(" ".join(lines_of(casadi_text._clean(c.block(code(text))).parts)).split())


@pytest.mark.parametrize(("text", "wanted"), [
    ("x = w0 ? w1 : 0;", "x = (w0 != 0.0) ? w1 : 0.0;"),
    ("x = (w0) ? w1 : w2;", "x = ((w0) != 0.0) ? w1 : w2;"),
    ("x = *p ? w1 : 0;", "x = (*p != 0.0) ? w1 : 0.0;"),
    ("x = w[3] ? w1 : 0;", "x = (w[3] != 0.0) ? w1 : 0.0;"),
    ("x = arg[1] ? arg[1][0] : 0;", "x = arg[1][0];"),
    ("x = k ? w1 : 0;", "x = k ? w1 : 0;"),
    ("x = (w0 < w1);", "x = (w0 < w1) ? 1.0 : 0.0;"),
    ("x = w0 == w1;", "x = (w0 == w1) ? 1.0 : 0.0;"),
    ("x = !w0;", "x = (w0 == 0.0) ? 1.0 : 0.0;"),
    ("x = w0 && w1;", "x = ((w0 != 0.0) && (w1 != 0.0)) ? 1.0 : 0.0;"),
    ("x = (w0 || *p);", "x = ((w0 != 0.0) || (*p != 0.0)) ? 1.0 : 0.0;"),
    ("x = w0 + w1;", "x = w0 + w1;"), ("x = 0 + w1;", "x = w1;"), ("x = w1 + 0;", "x = w1;"),
    ("arg1[0] = 0;", "arg1[0] = NULL;"), ("res[2] = 0;", "res[2] = NULL;"),
    ("arg1[0] = w0;", "arg1[0] = w0;"), ("w[2] = 0;", "w[2] = 0;"),
    ("if (res[0]) { x = w0; }", "if (res[0] != NULL) { x = w0; }"),
    ("if (f(arg, res)) { return 1; }", "if (f(arg, res) != 0) { return 1; }"),
    ("if (k < 3) { x = !w0; }", "if (k < 3) { x = (w0 == 0.0) ? 1.0 : 0.0; }"),
    ("x = casadi_to_int(w0);", "x = (int)(w0);"),
    ("x = casadi_inf;", "x = ((double)INFINITY);"),
])  # fmt: skip
def test_numbers_are_compared_with_numbers_and_addresses_with_none(text: str, wanted: str) -> None:
    assert re.sub("[()]", "", cleaned(text)) == re.sub("[()]", "", wanted)


@pytest.mark.parametrize(("text", "wanted"), [
    ("double r = 0;", "double r = 0.0;"), ("double s = 0;", "double s = 0;"),
    ("int r = 0;", "int r = 0;"),
    ("double r = k ? casadi_nan : 0;", "double r = k ? ((double)NAN) : 0.0;"),
    ("double r = k ? x : casadi_inf;", "double r = k ? x : casadi_inf;"),
    ("double r = k ? x : y;", "double r = k ? x : y;"),
    ("x = (ng - 1) * y;", "x = (double)(ng - 1) * y;"), ("x = (nh - 1) * y;", "x = (nh - 1) * y;"),
    ("if (bottom) { x = casadi_real_min; }", "if (bottom != 0.0) { x = DBL_MIN; }"),
    ("if (top) { x = casadi_to_int(y); }", "if (top) { x = (int)(y); }"),
])  # fmt: skip
def test_casadis_library_has_no_number_for_a_condition(text: str, wanted: str) -> None:
    made = [casadi_text._runtime(n) for n in code(text)]
    assert " ".join(" ".join(lines_of(made)).split()) == wanted


@pytest.mark.parametrize(("text", "refused"), [
    ("#include <lapack.h>\n", "lapack.h"), ("#include <math.h>\n", ""),
    ("static int counter = 0;\n", "global data .counter."), ("static const int c = 3;\n", ""),
    ("static void f(double *x)\n{\n    g(malloc(3), calloc(2));\n}\n", "calloc"),
    ("static void f(double *x)\n{\n    g(x);\n}\n", ""),
    ("static void f(double *x);\n", ""),
])  # fmt: skip
def test_what_needs_a_library_global_data_or_the_heap_is_refused(text: str, refused: str) -> None:
    if not refused:
        casadi_text._refuse(code(text), "own")
        return
    with pytest.raises(BadInput, match=rf"^own: .*{refused}"):
        casadi_text._refuse(code(text), "own")


def test_what_casadi_or_we_do_not_know_is_refused_in_a_line(monkeypatch) -> None:
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [x[0] * x[1], x])
    assert casadi_text.signature(f) == "f:(i0[2])->(o0,o1[2])"
    assert casadi_text.casadi_c([f], "own")

    def odd(*given: Any) -> Any:
        raise ValueError("what is this")

    with monkeypatch.context() as changed:
        changed.setattr(casadi_text, "code", odd)
        with pytest.raises(BadInput, match=r"^own: .*what is this$"):
            casadi_text.casadi_c([f], "own")

    def cannot(*given: Any) -> Any:
        raise RuntimeError("where it is\nthe reason\n")

    monkeypatch.setattr(casadi_text.ca, "CodeGenerator", cannot)
    with pytest.raises(BadInput, match=r"^own: .*: the reason$"):
        casadi_text.casadi_c([f], "own")


# ---- what is not written -------------------------------------------------------------------------

A, B, V = ca.MX.sym("A", 2, 3), ca.MX.sym("B", 2, 3), ca.MX.sym("v", 2)
SPARSE = ca.Sparsity.triplet(2, 3, [0, 1], [1, 2])


@pytest.mark.parametrize("given", [
    ca.project(A, SPARSE).T * 2, ca.det(A @ B.T), ca.solve(A @ B.T, V),
])  # fmt: skip
def test_an_operation_of_a_matrix_that_is_not_known_is_not_written(given: Any) -> None:
    f = ca.Function("f", [A, B, V], [given])
    with pytest.raises(Unsupported):
        graph.steps(f)
    assert graph.taken_apart(f) is None


def test_an_argument_whose_text_or_pieces_are_other_ones_is_not_written(monkeypatch) -> None:
    for text in ("input[1]", "input[x][0]", "1input[1][0]", "input[1][0]]"):
        with pytest.raises(Unsupported, match="argument"):
            graph._piece(text)  # type: ignore[arg-type]
    assert graph._piece("input[12][3]") == (12, 3)  # type: ignore[arg-type]
    f = ca.Function("f", [A, V], [2 * A, V])
    assert graph._segments(f) == {(0, 0): 0, (1, 0): 0}
    monkeypatch.setattr(graph, "_piece", lambda mx: (0, 1) if mx.nnz() == 6 else (1, 0))
    with pytest.raises(Unsupported, match="f: pieces of argument 0"):
        graph._segments(f)


def test_vectors_of_other_sizes_and_what_is_none_are_not_written() -> None:
    nodes = [Step(ca.OP_INPUT, size=2), Step(ca.OP_INPUT, size=3), Step(ca.OP_INPUT, size=1)]
    mx = SimpleNamespace(dep=lambda k: None)
    for args, fits in (((0, 0), True), ((0, 2), True), ((0, 1), False), ((2, 1), False)):
        if fits:
            assert graph._step(ca.OP_ADD, args, 2, mx, nodes).size == 2  # type: ignore[arg-type]
        else:
            with pytest.raises(Unsupported, match="sizes"):
                graph._step(ca.OP_ADD, args, 2, mx, nodes)  # type: ignore[arg-type]


def test_a_vector_that_is_turned_has_its_numbers_in_the_same_order() -> None:
    found, outputs = graph.steps(ca.Function("f", [V], [ca.sin(V.T)]))
    kept = [n for n in found if isinstance(n, Step) and n.op == graph.SLICE]
    assert all((n.detail, n.size) == ((0, 1), 2) for n in kept)
    assert found[outputs[0]].op == ca.OP_SIN


def test_a_scalar_function_with_a_result_without_numbers_is_not_written() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(Unsupported):
        Functions({}).name(ca.Function("f", [x], [2 * x, ca.SX(2, 2)]))


class Instructions:
    """A Function with these instructions: operation, where it goes, what it takes."""

    def __init__(self, *rows: tuple[int, list[int], list[int]]) -> None:
        self.rows = rows

    def n_instructions(self) -> int:
        return len(self.rows)

    def instruction_id(self, k: int) -> int:
        return self.rows[k][0]

    def instruction_output(self, k: int) -> list[int]:
        return self.rows[k][1]

    def instruction_input(self, k: int) -> list[int]:
        return self.rows[k][2]

    def instruction_constant(self, k: int) -> float:
        return 2.5

    def name(self) -> str:
        return "own"


def test_a_value_that_is_handed_on_is_the_same_value() -> None:
    f: Any = Instructions(
        (ca.OP_INPUT, [0], [1, 2]), (ca.OP_CONST, [1], []), (ca.OP_ASSIGN, [2], [0]),
        (ca.OP_MUL, [0], [2, 1]), (ca.OP_OUTPUT, [0, 3], [0]), (ca.OP_OUTPUT, [1, 0], [2]),
    )  # fmt: skip
    nodes, results = expressions.read(f)
    assert [n.op for n in nodes] == [ca.OP_INPUT, ca.OP_CONST, ca.OP_MUL]
    assert nodes[2].args == (0, 1)
    assert (nodes[0].place, nodes[1].value) == ((1, 2), 2.5)
    assert results == [((0, 3), 2), ((1, 0), 0)]
    odd: Any = Instructions((ca.OP_INPUT, [0], [0, 0]), (10_000, [1], [0]))
    with pytest.raises(Unsupported, match="10000 of own"):
        expressions.read(odd)


def test_a_slope_of_other_comparisons_stays_a_division() -> None:
    le, node = ca.OP_LE, expressions.Node
    before = [node(ca.OP_INPUT), node(ca.OP_INPUT), node(le, (0, 1)), node(le, (1, 0)),
              node(ca.OP_ADD, (3, 2)), node(ca.OP_LT, (1, 0)), node(ca.OP_ADD, (5, 2)),
              node(le, (0, 0)), node(ca.OP_ADD, (2, 7)), node(ca.OP_ADD, (3, 3)),
              node(ca.OP_ADD, (2, 3))]  # fmt: skip
    for below in (4, 10):
        found = expressions.slope(before, node(ca.OP_DIV, (2, below)))
        assert (found.op, found.args) == (expressions._SLOPE, (0, 1))
    for above, below in ((2, 6), (2, 8), (2, 9), (0, 4), (2, 1)):
        plain = node(ca.OP_DIV, (above, below))
        assert expressions.slope(before, plain) is plain


def test_a_longer_expression_gets_a_line_where_an_atom_is_wanted() -> None:
    x = ca.SX.sym("x", 2)
    writer = Writer(ca.Function("f", [x], [x[0] * x[1] + 1]), lambda i, k: expression(f"x[{k}]"))
    writer.run()
    ((_, node),) = writer.results
    assert writer.lines == []
    assert writer.atom(node).kind == "name"
    assert len(writer.lines) == 1
    assert writer.atom(node).kind == "name"
    assert len(writer.lines) == 1


def test_places_that_take_nothing_are_zero() -> None:
    node = Step(CHOSEN, (0,), size=3, detail=[1, -1, 0])
    assert _moved(node, [((-1, 0, 0), (-1, 0, 1))]) == ((-1, 0, 1), (0.0,), (-1, 0, 0))


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("size", [1, 2])
def test_what_no_stage_hands_on_has_its_place(backward: bool, size: int) -> None:
    """The last of what is wanted of all stages, what is wanted of the last alone, and the rest."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    each = ca.SX.sym("e", size)
    f = ca.Function("stage", [x, u], [x + u, each * 0 + u, each * 0 + 2 * u, each * 0 + 3 * u],
                    ["x", "u"], ["n", "every", "last", "rest"], {"allow_free": True})  # fmt: skip
    found = Scan(f, 3, (0, 1), {0: 0}, frozenset({1}), backward, {1: 0, 2: 1}, {1: 2})
    lines = scan_lines(found, "stage", ["x", "u"], ["one", "own", "all"], set(), False)
    text = " ".join(" ".join(lines_of(lines)).split())
    end = 0 if backward else 2
    if size == 1:
        assert f"*one = all[{end}];" in text
        assert "double rest_now;" in text
        assert "&all[i], own, &rest_now" in text
    else:
        assert f"copy(one, &all[{end * 2}], 2);" in text
        assert "double rest_now[2];" in text
        assert "&all[2 * i], own, rest_now" in text
    order = "int i = 2; i >= 0; --i" if backward else "int i = 0; i < 3; ++i"
    assert order in text


# ---- text of C that is read ----------------------------------------------------------------------


def test_a_blank_line_a_prototype_and_what_stands_behind_a_line_stay() -> None:
    text = ("static int f(double x);\n\nstatic int g(double x)\n{\n    int k = 0;\n\n"
            "    k = 1; /* behind */\n    return k;\n}\n")  # fmt: skip
    prototype, blank, function = code(text)
    assert (prototype.kind, prototype.head, blank.kind) == ("declare", "static int", "blank")
    assert prototype.parts[0].head == "f"
    assert [n.kind for n in function.parts[1].parts] == ["declare", "blank", "do", "return"]
    assert file_text([function]) in text + "\n"
    (one,) = code("static int h(int x) { /* why */ return x; }\n")
    assert len(one.parts[1].parts) == 1
    assert "/* why */" in file_text([one])


def test_places_in_vectors_are_enums_in_groups() -> None:
    plan: Any = SimpleNamespace(equations=SimpleNamespace(enums={
        "TUNE_LAG": ("tune", 2), "SEEN_V": ("seen", 0), "TUNE_GAIN": ("tune", 0)}))  # fmt: skip
    text = " ".join(file_text(_enums(plan)).split())
    assert "enum { TUNE_GAIN = 0, TUNE_LAG = 2 };" in text
    assert "enum { SEEN_V = 0 };" in text


# ---- what is asked for ---------------------------------------------------------------------------


@step(period=0.01, y=Output("1", "sum", lo=-9, hi=9))
def adds(s=State("1", 0.0, "kept", lo=-9, hi=9), u=Input("1", "given", lo=-1, hi=1)):
    """Some of what was and of what comes."""
    return dict(s=0.5 * s + u), dict(y=s + u)


@pytest.fixture
def tools(monkeypatch) -> dict[str, list[Any]]:
    """Tools that a module is put to, each answered by its name."""
    asked: dict[str, list[Any]] = {}

    def stand_in(where: Any, name: str, answer: Any) -> None:
        def told(*given: Any, **named: Any) -> Any:
            asked.setdefault(name, []).append((*given, *named.values()))
            return answer(*given) if callable(answer) else answer

        monkeypatch.setattr(where, name, told)

    monkeypatch.setattr(Checks, "need_tools", lambda self: None)
    stand_in(codegen.analysis, "cppcheck_findings", {"tool": "cppcheck"})
    stand_in(codegen.fuzz, "run_fuzzer", {"tool": "clang"})
    stand_in(codegen.module_proof, "run_eva", {"tool": "frama-c"})
    stand_in(codegen.targets, "compiled_for", lambda target, *_: {"target": target, "passed": True})
    ran = {"instructions": {"mean": 100.0, "most": 200}, "passed": False, "ticks": 7}
    stand_in(codegen.targets, "replayed_on", ran)
    stand_in(codegen, "compare", {"passed": True})
    stand_in(codegen.float_error, "compiler", "g++")
    stand_in(codegen, "readable", "all that is told\n")
    monkeypatch.setattr(codegen.cc, "compilers", lambda: ("/bin/gcc",))
    return asked


def test_a_module_is_put_to_what_is_asked_for_and_to_nothing_else(tools, tmp_path) -> None:
    data = codegen.export(adds, tmp_path / "plain", inputs={"u": np.zeros(4)}).data
    assert set(tools) == {"readable"}
    assert (data["targets"], data["ticks"]) == ([], 4)
    data = codegen.export(
        adds, tmp_path / "all", inputs={"u": np.zeros(4)}, check=True, target="cortex-m4",
        misra=True, fuzz_seconds=3, prove=True, clock=1e6,
    ).data  # fmt: skip
    assert (data["analysis"], data["fuzz"], data["proof"]) == (
        {"tool": "cppcheck"}, {"tool": "clang"}, {"tool": "frama-c"})  # fmt: skip
    (board,) = data["targets"]
    load = board.pop("load")
    assert board == {"target": "cortex-m4", "passed": False, "ticks": 7,
                     "instructions": {"mean": 100.0, "most": 200}}  # fmt: skip
    assert load == codegen.load.load(100.0, 200, 0.01, 1e6)
    plan, made = tools["cppcheck_findings"][0]
    assert (plan.name, "adds.c" in made) == ("adds", True)
    assert tools["run_fuzzer"][0][2] == 3
    assert len(tools["run_eva"]) == len(tools["compare"]) == len(tools["compiler"]) == 1


def test_a_board_without_a_replay_has_passed_if_it_was_compiled(tools) -> None:
    plan: Any = "plan"
    assert codegen._on_board("m4", plan, {}, False) == {"target": "m4", "passed": True}
    assert "replayed_on" not in tools
    found = codegen._on_board("m4", plan, {}, True)
    assert (found["passed"], found["ticks"]) == (False, 7)
    assert tools["compiled_for"] == [("m4", "plan", {})] * 2
    assert tools["replayed_on"] == [("m4", "plan", {})]


def test_trials_are_made_where_machines_may_differ_and_in_double_of_what_is_kept(
    monkeypatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(codegen.float_error, "trials", lambda *given: asked.append(given) or "made")
    monkeypatch.setattr(codegen, "KEPT", 3)
    rows = np.zeros((5, 1))
    made = {"m.h": "exp(x)", "m.c": "y = x;", "p.c": "z = x;"}
    plan: Any = SimpleNamespace(real="double", files=("m.h", "m.c", "p.c"))
    assert codegen._trials(plan, made, rows, {}, True) is None
    assert asked == []
    assert codegen._trials(plan, made | {"p.c": "exp(x)"}, rows, {"k": 1}, True) == "made"
    assert [len(given[2]) for given in asked] == [3]
    assert (asked[0][3], asked[0][5]) == ({"k": 1}, True)
    plan.real = "float"
    assert codegen._trials(plan, made, rows, {}, False) == "made"
    assert (len(asked[1][2]), asked[1][5]) == (5, False)


def test_more_files_are_written_where_they_are_asked_for() -> None:
    plan = Plan(adds)
    plain = codegen.texts(plan)
    more = codegen.texts(plan, Content(with_xcp=True))
    assert set(more) - set(plain) == {"xcp.h", "xcp.c", "xcp_board.c"}
    assert "xcp" in more["Makefile"]
    assert "xcp" not in plain["Makefile"]


# ---- a loop whose part runs elsewhere ------------------------------------------------------------


@flow(y=Output("m/s", "speed"))
def mass(v=State("m/s", 0.0, "speed"), F=Input("N", "force"), m=Param("kg", 2.0, "mass", lo=0.1)):
    """A mass."""
    return dict(v=F / m), dict(y=v)


@step(period=0.01, F=Output("N", "force", lo=-2, hi=2))
def drives(i=State("N", 0.0, "integral"), v=Input("m/s", "speed"), k=Param("N s/m", 3.0, lo=0)):
    """Up to a speed."""
    return dict(i=i + 0.05 * k * (1 - v)), dict(F=k * (1 - v) + i)


@pytest.mark.parametrize("below", [0.1, 9.0])
def test_a_run_with_a_part_elsewhere_ends_as_the_whole_one(below: float) -> None:
    """In the tick in which it comes to its end, or at the end of the time."""
    wires = {"ctl.v": "plant.y", "plant.F": "ctl.F"}
    loop = connect("loop", wires, plant=sampled(mass, 0.01, "rk4"), ctl=drives)
    scenario = Scenario("go", 0.3, end=End("plant.v", above=below), params={"m": 2.5, "k": 2.0})
    got = run_in_loop(loop, "ctl", scenario, Stored(drives, {"k": 2.0}))
    wanted = simulate(loop, scenario, compile=False)
    ticks = len(wanted["time"])
    assert (ticks < 30) == (below == 0.1)
    assert len(got.data["time"]) == len(got.status) == ticks
    assert not got.status.any()
    np.testing.assert_allclose(got.data["plant.v"], wanted["plant.v"], atol=1e-6)
    np.testing.assert_allclose(got.data["ctl.F"], wanted["ctl.F"], atol=1e-5)
    assert float(got.data["time"][-1]) == float(wanted["time"][-1])
