"""Passes over the nodes of C: what each makes of statements means the same as before."""

from __future__ import annotations

import copy
import itertools
import operator
import re
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from test_arrays import build, called

from slipctl import Input, Output, Param, State, step
from slipctl.block.signals import Split
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.layout import started_copies
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import _constant
from slipctl.ccode.passes import integers
from slipctl.ccode.passes import letters as letters_
from slipctl.ccode.passes.precision import tolerant
from slipctl.ccode.passes.repeats import roll_calls
from slipctl.ccode.passes.split_step import take_state
from slipctl.ccode.passes.sums import _alike
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression
from slipctl.ccode.tree.printer import file_text, lines_of

compiled = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")

# ---- what is 0 or 1 is true or false -------------------------------------------------------------

SIGNS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne, "+": operator.add, "*": operator.mul, "&&": lambda a, b: bool(a and b),
    "||": lambda a, b: bool(a or b),
}  # fmt: skip


def worth(n: Node, values: dict[str, float]) -> float:
    """Number that an expression of C has."""
    inside = [worth(p, values) for p in n.parts] if n.kind not in ("member", "index") else []
    if n.kind == "number":
        return float(n.head.rstrip("Uuf"))
    if n.kind in ("name", "member", "index"):
        return {"true": 1.0, "false": 0.0}.get(n.text, values.get(n.text, np.nan))
    if n.kind == "op":
        return float(SIGNS[n.head](*inside))
    if n.kind == "choice":
        return inside[1] if inside[0] else inside[2]
    if n.kind == "unary":
        return {"!": float(not inside[0]), "-": -inside[0]}[n.head]
    if n.kind == "call":
        return max(inside) if n.head in integers._ANY_OF else min(inside)
    return float(int(inside[0])) if n.kind == "cast" and n.head == "int" else inside[0]


A, B, T, U, M, W, N = "now->a", "state->b", "t", "u", "state->m", "w", "state->n"


def all_values() -> list[dict[str, float]]:
    """Every combination of what is 0 or 1, of a mode from 0 to 3 and of a count."""
    return [
        {A: a, B: b, "now->c": 7, T: t, U: u, M: m, W: m, N: n, "next->n": n}
        for a, b, t, u, m, n in itertools.product((0, 1), (0, 1), (0, 1), (0, 1), range(4), (0, 2))
    ]


def known(**more: Any) -> integers._Known:
    given = {
        "members": {("now", "a"), ("kept", "b")}, "modes": {("kept", "m")}, "arrays": frozenset(),
        "counts": frozenset({("kept", "n")}), "local": {T}, "whole": {W},
    }  # fmt: skip
    return integers._Known(**(given | more))


def same(before: Node, after: Node) -> None:
    for values in all_values():
        assert worth(before, values) == worth(after, values), (before.text, after.text, values)


TRUTHS = [
    "now->a", "((now->a))", "1.0", "0.0", "t", "greater(now->a, state->b)", "fmax(t, 1.0)",
    "lesser(now->a, state->b)", "fmin(t, state->b)", "state->b + 0.0",
    "(u > 0.2) ? 1.0 : 0.0", "(u > 0.2) ? 0.0 : 1.0", "(u > 0.2) ? now->a : state->b",
    "(u > 0.2) ? 1.0 : state->b", "(u > 0.2) ? state->b : 1.0", "(u > 0.2) ? 0.0 : state->b",
    "(u > 0.2) ? state->b : 0.0", "(u > 0.2) ? 1.0 : 1.0", "(u > 0.2) ? 0.0 : 0.0",
    "(now->a > 0.5) ? state->b : 0.0", "(now->a < 0.5) ? state->b : 1.0",
    "((u > 0.2) ? t : state->b) + 0.0", "(state->m > 1.5) ? t : 0.0",
    "((int)now->a != 0) ? 0.0 : fmax(state->b, t)", "(u > 0.2) ? ((t == 0.0) ? 1.0 : 0.0) : t",
]  # fmt: skip


@pytest.mark.parametrize("text", TRUTHS)
def test_an_expression_that_is_0_or_1_is_the_same_condition(text: str) -> None:
    """And no number of it is left, but those with which samples and modes are compared."""
    before, know = expression(text), known()
    assert integers._is_truth(before, know)
    after = integers._truth(before, know)
    same(before, after)
    left = re.sub(r"u > 0.2|state->m \S+ \d+(\.5)?", "", after.text)
    assert not re.search(r"\d", left), after.text
    assert " + " not in after.text


@pytest.mark.parametrize("text", [
    "2.0", "u", "now->a + 1.0", "now->a * state->b", "fmax(u, now->a)", "(u > 0.2) ? u : 1.0",
    "state->m", "now->c", "other->a", "-1.0",
])  # fmt: skip
def test_what_may_be_another_number_is_no_condition(text: str) -> None:
    assert not integers._is_truth(expression(text), known())


@pytest.mark.parametrize("sign", ["<", "<=", ">", ">=", "==", "!="])
@pytest.mark.parametrize("number", ["0.0", "0.5", "1.0", "1.5", "2.0", "3.0"])
@pytest.mark.parametrize("side", [0, 1])
def test_a_comparison_with_a_number_holds_as_before(sign: str, number: str, side: int) -> None:
    """Of a truth it is the truth, its opposite, or neither; of a mode it is one of integers."""
    for flag in (A, f"({B})", T, f"(int){A}", f"fmax({A}, {T})", M, f"({M})"):
        before = expression(f"{number} {sign} {flag}" if side else f"{flag} {sign} {number}")
        after = before.change(lambda n: integers._rule(n, known()))
        same(before, after)
        if M not in flag:
            assert not re.search(r"\d", after.text)
        elif sign not in ("==", "!=") or number.endswith(".0"):
            assert re.sub(r"\d+", "", after.text).strip() in (f"{M} {sign}", f"{sign} {M}")
            assert "." not in after.text


@pytest.mark.parametrize(("text", "wanted"), [
    ("now->a >= 0.0 && u > 0.2", "u > 0.2"), ("u > 0.2 && state->b <= 1.0", "u > 0.2"),
    ("now->a >= 0.0 && state->b <= 1.0", "true"), ("now->a > 0.5 && t > 0.5", "now->a && t"),
    ("now->a > 0.5 && u > 0.2", "now->a && (u > 0.2)"),
])  # fmt: skip
def test_of_two_conditions_what_always_holds_is_left_out(text: str, wanted: str) -> None:
    before = expression(text)
    after = before.change(lambda n: integers._rule(n, known()))
    assert after.text == wanted
    same(before, after)


@pytest.mark.parametrize(("text", "wanted"), [
    ("u * now->a", "u * (now->a ? 1.0 : 0.0)"), ("u * state->m", "u * (double)state->m"),
    ("(int)state->m + u", "state->m + u"), ("u + t", "u + (t ? 1.0 : 0.0)"),
    ("u + now->c", "u + now->c"), ("(u > 0.2) * u", "(u > 0.2) * u"), ("((t)) * u", None),
])  # fmt: skip
def test_what_is_asked_for_as_a_number_is_made_one(text: str, wanted: str | None) -> None:
    before = expression(text)
    after = before.change(lambda n: integers._rule(n, known()))
    same(before, after)
    if wanted is not None:
        assert after.text == wanted


def given(text: str, know: integers._Known) -> str:
    (line,) = code(text)
    return lines_of([line.change(lambda n: integers._rule(n, know))])[0]


@pytest.mark.parametrize(("text", "wanted"), [
    ("now->a = (u > 0.2) ? 1.0 : 0.0;", "now->a = u > 0.2;"),
    ("now->a = 1.0;", "now->a = true;"), ("next->b = state->b;", "next->b = state->b;"),
    ("const double t = (u > 0.2) ? 1.0 : 0.0;", "const bool t = u > 0.2;"),
    ("next->n = 0.0;", "next->n = 0U;"), ("next->n = state->n + 1.0;", "next->n = state->n + 1U;"),
    ("next->n = (state->n < 4.0) ? (state->n + 1.0) : 0.0;",
     "next->n = (state->n < 4U) ? (state->n + 1U) : 0U;"),
    ("next->n = (t > 0.5) ? 0.0 : state->n;", "next->n = t ? 0U : state->n;"),
    ("next->m = 2.0;", "next->m = 2;"), ("next->m = w;", "next->m = (int)w;"),
    ("next->m = (double)k;", "next->m = k;"), ("next->m = (2.0);", "next->m = (2);"),
    ("next->m = (t > 0.5) ? 2.0 : state->m;", "next->m = t ? 2 : state->m;"),
    ("now->c = now->a;", "now->c = now->a ? 1.0 : 0.0;"), ("now->c = 1.0;", "now->c = 1.0;"),
    ("now->c = fmax(now->a, t);", "now->c = (now->a || t) ? 1.0 : 0.0;"),
    ("if (0.0 <= state->n) { f(); }", None), ("if (state->n >= 3.0) { f(); }", None),
])  # fmt: skip
def test_what_is_given_to_a_member_is_of_its_kind(text: str, wanted: str | None) -> None:
    made = given(text, known())
    if wanted is None:
        wanted = "if (true)" if "<=" in text else "if (state->n >= 3U)"
        assert made.startswith(wanted)
    else:
        assert made == wanted


@pytest.mark.parametrize("text", [
    "next->n = state->n * 2.0;", "next->n = u;", "next->n = 0.5;", "u = 2.0 * state->n;",
    "next->n = state->n + u;", "if (state->n > u) { f(); }", "next->n = -1.0;",
])  # fmt: skip
def test_a_counter_that_is_used_as_a_number_stays_one(text: str) -> None:
    with pytest.raises(integers._Otherwise):
        given(text, known())


@pytest.mark.parametrize(("text", "is_mode"), [
    ("2.0", True), ("32767.0", True), ("32768.0", False), ("0.5", False), ("w", True),
    ("u", False), ("(u > 0.2) ? 1.0 : state->m", True), ("(u > 0.2) ? u : state->m", False),
    ("(double)k", True), ("(w)", True), ("state->b", False),
])  # fmt: skip
def test_a_mode_is_a_whole_number_or_what_was_chosen(text: str, is_mode: bool) -> None:
    assert integers._is_mode(expression(text), known()) == is_mode


@pytest.mark.parametrize(("text", "wanted"), [
    ("!now->a", "now->a"), ("now->a", "!now->a"), ("(now->a)", "!now->a"), ("!(!t)", "!t"),
    ("u > 0.2", "!(u > 0.2)"), ("!(u > 0.2)", "u > 0.2"),
])  # fmt: skip
def test_the_opposite_of_an_opposite_is_the_condition(text: str, wanted: str) -> None:
    assert integers._not(expression(text)).text == wanted


# ---- tolerances ----------------------------------------------------------------------------------

SOLVER = """static int %s(double *x)
{
    p->constr_viol_tol = 1e-8;
    p.dual_inf_tol = 1e-8;
    p->mu = 1e-12;
    p->other_tol = 2.0 * 1e-14;
    x[0] = 1e-12;
    y = 1e-14 + 1e-10;
    return 0;
}
"""


@pytest.mark.parametrize(("name", "rest"), [
    ("casadi_qp", ["1e-6", "1e-7", "1e-10"]), ("own", ["1e-12", "1e-14", "1e-10"]),
])  # fmt: skip
def test_solvers_in_float_have_tolerances_that_float_reaches(name: str, rest: list[str]) -> None:
    """Elsewhere only those of members are other ones."""
    (n,) = code(SOLVER % name)
    numbers = re.findall(r"\d\.?\d*e-\d+", file_text([tolerant(n)]))
    assert numbers == ["1e-5", "1e-3", "1e-6", "1e-7", *rest]
    assert "2.0 * 1e-7" in file_text([tolerant(n)])


# ---- calls again and again -----------------------------------------------------------------------

STEPS = """static void f(double x, const double v[2], double *y, double w[2])
{
    *y = 0.5 * x + v[0];
    w[0] = v[1] - x;
    w[1] = 0.25 * v[0];
}
"""


WANTED = [("&r[0][0]", "r[1]"), ("&own", "r[1]"), ("&r[0][0]", "other"), ("&own", "other")]
"""Where the last call puts its number and its array."""


def repeated(many: int, number: str, array: str) -> str:
    """So many calls, the last one writes where its results are wanted."""
    lines, x, v = [], "x0", "v0"
    for k in range(1, many):
        lines.append(f"double y{k}; double w{k}[2]; f({x}, {v}, &y{k}, w{k});")
        x, v = f"y{k}", f"w{k}"
    declared = "double own; " * (number == "&own") + "double other[2]; " * (array == "other")
    lines.append(f"{declared}f({x}, {v}, {number}, {array});")
    lines += ["r[0][0] = own;"] * (number == "&own")
    lines += ["r[1][0] = other[0]; r[1][1] = 2.0 * other[1];"] * (array == "other")
    return "\n".join(lines)


@compiled
def test_calls_that_are_a_loop_give_the_same_where_it_is_wanted(tmp_path: Path) -> None:
    texts, rows = [], list(itertools.product((2, 3, 4, 5), WANTED))
    for k, (many, (number, array)) in enumerate(rows):
        lines = code(repeated(many, number, array))
        rolled = roll_calls(lines, {"f", "a", "r", "x0", "v0"})
        loops = [x for x in rolled if x.kind == "for"]
        whole = number == "&own" or array == "other"  # else no call has a local to begin with
        assert len(loops) == int(many > 2 + (not whole)), lines_of(rolled)
        assert sum("f" in x.calls() for x in rolled) == (many if not loops else 2 - whole)
        for n, body in enumerate((lines, rolled)):
            printed = "\n".join(lines_of(body))
            begin = "const double x0 = *a[0]; const double *v0 = a[1];"
            texts.append(
                f"void run{2 * k + n}(const double **a, double **r) {{ {begin}\n{printed}\n}}"
            )
    used = code("copy(a, b, 2);")
    unit = build([file_text(helpers([c.block(used)])), STEPS, *texts], tmp_path)
    values = [np.array([0.7]), np.array([1.5, -0.3])]
    for k, row in enumerate(rows):
        before, after = (called(unit, 2 * k + n, values, [1, 2]) for n in range(2))
        assert np.isfinite(np.hstack(before)).all()
        for one, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(one, other, err_msg=str(row))


# ---- terms that are alike ------------------------------------------------------------------------


def nodes_of(*rows: tuple[Any, ...]) -> list[Any]:
    """Operations: what it is, arguments, value, place."""
    return [
        SimpleNamespace(op=op, args=args, value=value, place=place)
        for op, args, value, place in rows
    ]


CONST, INPUT, MUL, ADD = ca.OP_CONST, ca.OP_INPUT, ca.OP_MUL, ca.OP_ADD


@pytest.mark.parametrize(("values", "alike"), [
    ([1.0, 2.0, 3.0], True), ([0.0, 4.0, 8.0], True), ([-4.0, -1.0, 2.0], True),
    ([3.0, 2.0, 1.0], False), ([1.0, 2.0, 4.0], False), ([0.5, 1.5, 2.5], False),
    ([1.0, 2.5, 4.0], False), ([2.0, 2.0, 2.0], False),
])  # fmt: skip
def test_whole_numbers_that_go_up_evenly_are_alike(values: list[float], alike: bool) -> None:
    """Alone, and as factors of places that do."""
    nodes = nodes_of(*((CONST, (), v, (0, 0)) for v in values),
                     *((INPUT, (), 0.0, (1, 2 * k)) for k in range(3)),
                     *((MUL, (k, 3 + k), 0.0, (0, 0)) for k in range(3)))  # fmt: skip
    uses = [1] * 9
    assert _alike(nodes, uses, {}, [0, 1, 2]) == alike
    assert _alike(nodes, uses, {}, [6, 7, 8]) == alike
    assert _alike(nodes, uses, {}, [3, 4, 5])
    assert not _alike(nodes, [*uses[:7], 2, 1], {}, [6, 7, 8])  # one of them is used again
    assert not _alike(nodes, uses, {7: "x"}, [6, 7, 8])
    named = {6: "x_1", 7: "x_3", 8: "x_5"}
    assert _alike(nodes, uses, named, [6, 7, 8])
    assert not _alike(nodes, uses, named | {8: "y_5"}, [6, 7, 8])
    assert not _alike(nodes, uses, named | {8: "x_6"}, [6, 7, 8])
    nodes[7].op = ADD
    assert not _alike(nodes, uses, {}, [6, 7, 8])
    assert _alike(nodes, uses, {}, [7, 7])


# ---- letters of a page ---------------------------------------------------------------------------


def test_locals_are_heard_as_the_functions_of_a_page_return(monkeypatch) -> None:
    """The outermost first; not what is hidden, a symbol, a foreign value, or of other modules."""
    heard: list[Any] = []

    @contextmanager
    def watch_calls(watch: Any) -> Any:
        heard.append(watch)
        yield

    monkeypatch.setattr(letters_, "watch_calls", watch_calls)
    a, b = ca.SX.sym("a"), ca.SX.sym("b", 2)

    class Law:
        """A law whose object keeps an expression."""

    Law.__module__ = "slipctl.models.own"
    law, other = Law(), SimpleNamespace(x=5 * a)
    law.kept, law.number, law.sum = 7 * a, 3, ca.sum1(b)  # type: ignore[attr-defined]

    def outer() -> Any:
        inner_value = 3 * b
        _hidden, early, n = 2 * a, ca.SX(3), 4
        mixed = {"x": 2 * a}
        del inner_value, early, n, mixed
        return sys._getframe()

    frame = outer()
    top = SimpleNamespace(f_back=None, f_globals={"__name__": "models.x"}, f_code=frame.f_code)
    top.f_locals = {"_h": 2 * a, "a": 2 * a, "z": 2 * a, "b2": b[0] + 1, "n": 4, "symbol": a,
                    "sparse": ca.SX(2, 2) + 0, "self": law, "other": other}  # fmt: skip
    below = SimpleNamespace(f_back=SimpleNamespace(f_back=top), f_code=frame.f_code,
                            f_globals={"__name__": "models.y"}, f_locals={"z": 4 * a})  # fmt: skip
    own = SimpleNamespace(f_back=top, f_code=frame.f_code, f_locals={"q": 9 * a},
                          f_globals={"__name__": "slipctl.ccode.module.x"})  # fmt: skip
    with letters_.letters([{"a": a}, {"b": b}]) as told:
        (watch,) = heard
        watch(below, "return", None)
        watch(own, "return", None)
        watch(top, "call", None)
        watch(top, "return", None)
    found = told([2 * a, b])
    assert list(found.names.items()) == [(2, "z"), (3, "b2"), (4, "kept"), (5, "sum"), (6, "z")]
    wanted = [2 * a, b[0] + 1, 7 * a, ca.sum1(b), 4 * a]
    for value, expected in zip(found.hidden, wanted, strict=True):
        assert ca.is_equal(value, expected, 9)
    assert len(found.codes) == 2
    monkeypatch.setattr(letters_, "MOST", 2)
    with letters_.letters([{"a": a}, {"b": b}]) as told:
        heard[-1](top, "return", None)  # more than enough already
        heard[-1](below, "return", None)
    assert len(told([a]).names) == 4


# ---- a tick in two parts -------------------------------------------------------------------------


@step(period=0.1, y=Output("1", "sum", lo=-50, hi=50))
def whole_tick(
    prepare=State("1", 0.0, "1 to prepare, and no more", lo=0, hi=1),
    prepared=State("1", 0.0, "the next tick is prepared", lo=0, hi=1),
    plan=State("1", [0.0, 0.0], "made before", shape=(2,)),
    n=State("1", 0.0, "sum", lo=-50, hi=50),
    early=Input("1", "known before", lo=-2, hi=2, change=0.5, value=0.0),
    late=Input("1", "measured", lo=-9, hi=9, value=0.0),
    k=Param("1", 2.0, "gain", lo=0, hi=5),
):
    """What is early gives a plan, before what is late is there."""
    due = ca.logic_or(prepare > 0, prepared <= 0)
    first = ca.if_else(due, k * early + plan[1], plan[0])
    second = ca.if_else(due, early, plan[1])
    rest = ca.if_else(prepare > 0, n, 0.5 * n + late)
    return dict(prepare=0, prepared=ca.if_else(prepare > 0, 1, 0), n=rest,
                plan=ca.vertcat(first, second)), dict(y=first + n + late)  # fmt: skip


def in_two(block: Any = whole_tick) -> Any:
    """The same, whose tick may be made in two."""
    made = copy.copy(block)
    split = Split("prepare", "prepared", ("early",), ("plan",))
    made.composition = replace(block.composition, split=split)
    return made


@step(period=0.1, y=Output("1", "the plan of before"))
def ranged_tick(
    prepare=State("1", 0.0, "1 to prepare, and no more", lo=0, hi=1),
    prepared=State("1", 0.0, "the next tick is prepared", lo=0, hi=1),
    plan=State("1", 0.0, "made before", lo=-9, hi=9),
    early=Input("1", "known before", lo=-2, hi=2, change=0.5, value=0.0),
):
    """All states have ranges: nothing else has to be asked whether they are finite."""
    made = 0.5 * plan + early
    return dict(prepare=0, prepared=ca.if_else(prepare > 0, 1, 0), plan=made), dict(y=2 * plan)


@compiled
def test_a_plan_with_a_range_is_tested_by_it(tmp_path: Path) -> None:
    module = codegen.c_module(in_two(ranged_tick), tmp_path).compile().load()
    assert module.prepare(early=1.0) == 0
    assert module.state["plan"] == 1.0


@compiled
def test_a_tick_in_two_parts_is_the_whole_one(tmp_path: Path) -> None:
    """Prepared or not, by what is early at that time; a refused one is made as a whole."""
    module = codegen.c_module(in_two(), tmp_path).compile().load()
    big = 5.0
    refused, off = Plan(in_two()).layout.big, {}
    header = (tmp_path / "whole_tick.h").read_text()
    for word in ("OFF_RANGE", "REFUSED", "NO_INIT", "BAD_RESULT"):
        off[word] = int(re.search(rf"{refused}_{word} *=? *(\d+)", header)[1])  # type: ignore[index]
    module.reset(k=1.5)
    first, second, n = 0.0, 0.0, 0.0
    rows = [(0.5, 0.5, 1.0), (None, 0.75, -2.0), (1.0, 0.5, 0.25), (big, 0.25, 3.0),
            (-1.5, 0.0, 1.0), (None, -0.5, 0.5)]  # fmt: skip
    for ahead, early, late in rows:
        taken = early
        if ahead is not None:
            status = module.prepare(early=ahead)
            assert status == (off["OFF_RANGE"] | off["REFUSED"] if ahead == big else 0)
            assert module.state["prepared"] == float(ahead != big or n is None)
            taken = early if ahead == big else ahead
            if ahead != big:
                assert module.state["plan"].tolist() == [1.5 * taken + second, taken]
                assert module.state["n"] == n
        y = module.step(early=early, late=late)["y"]
        first, second = 1.5 * taken + second, taken
        assert y == first + n + late
        n = 0.5 * n + late
        assert module.status == 0
        state = module.state
        assert (state["prepare"], state["prepared"], state["n"]) == (0.0, 0.0, n)
        assert state["plan"].tolist() == [first, second]
    header_of_two = header.replace("\n", " ")
    assert "whole_tick_prepare(" in header_of_two
    assert "whole_tick_feedback(" in header_of_two
    assert "of in it reads early." in re.sub(r"[\s*]+", " ", header)


def test_states_are_taken_one_by_one_unless_it_is_all_of_them() -> None:
    plan = Plan(in_two())
    states = list(plan.layout.states)
    assert take_state(plan, states) == ["state->kept = next;"]
    assert take_state(plan, states[:1] + states[2:3]) == [
        "state->kept.prepare = next.prepare;", "copy(state->kept.plan, next.plan, 2);",
    ]  # fmt: skip
    assert take_state(plan, []) == []
    large = SimpleNamespace(layout=plan.layout, next_in_state=True)
    assert take_state(large, states[3:]) == ["state->kept.n = state->next.n;"]  # type: ignore[arg-type]
    assert [m.name for m in plan.early] == ["early"]
    assert [m.name for m in plan.ahead] == ["plan"]
    assert Plan(whole_tick).early == []


# ---- constants and start values ------------------------------------------------------------------


def filled(lines: list[str], name: str, size: int) -> list[float]:
    """An array behind statements that give its elements, singly, in a loop or by a call."""
    found = [float("nan")] * size
    number = {"true": 1.0, "false": 0.0}

    def worth_of(text: str, k: int) -> float:
        inside = re.fullmatch(rf"{name}\[k - (\d+)\]", text)
        if inside:
            return found[k - int(inside[1])]
        return number.get(text) if text in number else float(text.rstrip("U"))  # type: ignore[return-value]

    for line in " ".join(lines).replace("{ ", "{").split("\n"):
        pieces = re.findall(
            rf"for \(int k = (\d+); k < (\d+); \+\+k\) \{{\s*(?:if \(\(k % (\d+)\) != 0\) \{{\s*)?"
            rf"{name}\[k\] = ([^;]+);|{name}\[(\d+)\] = ([^;]+);|fill\({name}, (\d+), ([^)]+)\)",
            line,
        )
        for begin, end, every, value, at, single, many, all_of in pieces:
            if at:
                found[int(at)] = worth_of(single, int(at))
            elif many:
                found[: int(many)] = [float(all_of)] * int(many)
            else:
                for k in range(int(begin), int(end)):
                    if not every or k % int(every):
                        found[k] = worth_of(value, k)
    return found


@pytest.mark.parametrize(("value", "kind", "most"), [
    ([1.0, 2.0, 1.0, 2.0, 1.0, 2.0], "double", 3), ([1.0, 2.0, 3.0, 1.0, 2.0, 3.0], "double", 4),
    ([4.0] * 6, "double", 1), ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "double", 6),
    ([1.0, 2.0, 3.0, 4.0, 5.0, 1.0], "double", 6), ([0.0, 1.0, 1.0, 0.0, 0.0, 1.0], "bool", 6),
    ([1.0] * 6, "bool", 1), ([3.0] * 6, "unsigned int", 1), ([3.0, 0, 1, 2, 0, 2], "int", 6),
    ([1.0, 1.0, 2.0, 1.0, 1.0, 2.0], "double", 4),
])  # fmt: skip
def test_a_constant_is_given_to_each_element(value: list[float], kind: str, most: int) -> None:
    """In as few statements as its numbers repeat; whole numbers and truths as C has them."""

    @step(period=0.1)
    def own(x=State("1", value, shape=(6,))):
        return dict(x=x), {}

    (m,) = Plan(own).layout.states
    lines = _constant(m, "p->", value, kind)
    assert filled(lines, "p->x", 6) == value
    assert len(lines) == most
    text = "".join(lines)
    assert ("U;" in text) == (kind == "unsigned int")
    assert ("true" in text) == (kind == "bool")
    assert (".0" in text) == (kind == "double")


def test_copies_begin_with_the_first_number_of_their_column() -> None:
    @step(period=0.1)
    def own(x=State("1", 0.0, shape=(3, 4))):
        return dict(x=x), {}

    (m,) = Plan(own).layout.states
    values = [c.name(str(float(k - k % 3))) for k in range(12)]
    lines = [line.replace("\n", " ") for line in lines_of(started_copies(m, "p->", values))]
    assert filled(lines, "p->x", 12) == [float(k - k % 3) for k in range(12)]
    assert sum("for" in line for line in lines) == 1


def test_an_input_that_the_block_judges_is_handed_over_as_it_is() -> None:
    """Only what is no number is told; one that is judged by the guard is held at its last."""
    rows = np.array([[0.5, 0.5], [7.0, 7.0], [np.nan, np.nan], [0.25, 0.25]])
    ends = [np.array([v, v]) for v in (-1.0, 1.0, 1e30, 0.0)]
    stale = np.full(2, 100.0)
    taken, told = guard.accepted_inputs(rows, ends, stale, 1e30, None, np.array([False, True]))
    assert taken[:, 0].tolist() == [0.5, 0.5, 0.5, 0.25]
    assert taken[[0, 1, 3], 1].tolist() == [0.5, 7.0, 0.25]
    assert np.isnan(taken[2, 1])
    assert (told != 0).tolist() == [False, True, True, False]
    alone, said = guard.accepted_inputs(rows[:, :1], [e[:1] for e in ends], stale[:1], 1e30, None,
                                        np.array([True]))  # fmt: skip
    assert alone[[0, 1, 3], 0].tolist() == [0.5, 7.0, 0.25]
    assert said.tolist() == [0, 0, guard.BAD_INPUT, 0]
