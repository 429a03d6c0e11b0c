"""How the C of the representative controllers reads: its shape, its length, its names."""

from __future__ import annotations

import json
import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from controllers import REPRESENTATIVE
from module_text import laid_out, of_plan, with_pass

from slipctl import Block, Input, Output, Param, State, connect, replicate, state_machine, step
from slipctl.block.text.intermediates import remember_locals
from slipctl.ccode import codegen
from slipctl.ccode.check.readability import equations, measure_source
from slipctl.ccode.module.comments import WIDTH
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.source import sources
from slipctl.ccode.passes.local_names import name_locals
from slipctl.ccode.passes.member_results import copy_statements, place_locals
from slipctl.ccode.passes.repeats import hand_results, roll_calls
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.printer import file_text
from slipctl.study import resolve

MOST = {
    "subway_braking": (732, 366, 0.073),
    "hst_braking": (195, 317, 0.014),
    "freight_traction": (46, 188, 0.016),
    "hst_traction": (310, 664, 0.099),
}
"""Lines of the parts, of the module around them, share of anonymous assignments: to be lowered."""

LONGER = {
    "hst_braking:eppfc": (475, 394, 0.044),
    "hst_braking:eppfc@real": (517, 410, 0.04),
    "hst_braking:eppfc_free": (710, 428, 0.05),
    "hst_traction:smc_limited": (292, 647, 0.087),
    "freight_traction:smes_robust": (126, 266, 0.057),
    "predictive:nmpc": (1350, 242, 0.085),
    "all_rails:nmpc": (1362, 278, 0.074),
    "hst_traction:mpc": (441, 305, 0.057),
    "hst_traction:mpc_limited": (636, 656, 0.096),
}
"""The same of some that are not among them. Those of programs name the entries of their vectors."""


@pytest.fixture(scope="module", params=REPRESENTATIVE)
def written(request: pytest.FixtureRequest) -> tuple[str, Block, Plan, str]:
    block = REPRESENTATIVE[request.param]()
    plan = Plan(block, "ctl")
    return request.param, block, plan, of_plan(plan)


def test_the_source_is_no_longer_and_has_no_more_locals_without_a_name(written) -> None:
    name, _, plan, _ = written
    told = measure_source(plan, sources(plan))
    *lines, share = MOST[name]
    assert all(n <= most for n, most in zip(told["lines"].values(), lines, strict=True))
    assert told["share"] <= share
    assert told["registers"] == 0


@pytest.mark.second
@pytest.mark.parametrize("name", LONGER)
@pytest.mark.others("long")
def test_other_sources_are_no_longer_either(name: str) -> None:
    study, _, loop = name.partition(":")
    found = resolve.load_study(study)
    plan = Plan(resolve.find_loop(found, loop)[0][found.controller], "ctl")
    told = measure_source(plan, sources(plan))
    *lines, share = LONGER[name]
    assert all(n <= most for n, most in zip(told["lines"].values(), lines, strict=True))
    assert told["share"] <= share


SHIPPED = json.loads((Path(__file__).parents[2] / "docs/evidence/reach.json").read_text("utf-8"))
CONTROLLERS = list(SHIPPED["numbers"]["reach"]["controllers"])


@pytest.mark.long
@pytest.mark.parametrize("study", dict.fromkeys(c.partition(":")[0] for c in CONTROLLERS))
def test_no_shipped_controller_has_register_code_or_many_locals_without_a_name(study: str) -> None:
    """Each is written part by part, none of it by CasADi's generator."""
    found = resolve.load_study(study)
    for loop in (c.partition(":")[2] for c in CONTROLLERS if c.startswith(f"{study}:")):
        plan = Plan(resolve.find_loop(found, loop)[0][found.controller], "ctl")
        text = of_plan(plan)
        told = measure_source(plan, sources(plan))
        assert told["share"] <= 0.1, loop
        assert told["registers"] == 0, loop
        assert told["functions"] > 0, loop
        assert not plan.equations.static, loop
        assert "casadi_" not in text, loop
        assert not re.search(r"\(-?[\d.]+ [!=<>]=? -?[\d.]+\)", text), loop  # of constants


def test_each_part_is_a_function_called_in_the_order_of_the_wires(written) -> None:
    """A part comes behind those whose outputs of this tick it reads."""
    _, block, plan, text = written
    body = text[text.index("The parts, in the order of the wires") :]
    called = re.findall(
        r"^ +(\w+)\((?:in|param|&?state|&?next|now)[^;]*;", body, flags=re.MULTILINE
    )
    assert all(any(c == b or c.startswith(f"{b}_") for c in called) for b in block.parts)
    done: set[str] = set()
    for line in body.partition("\n}\n")[0].splitlines():
        done |= set(re.findall(r"now->(\w+)(?:\[\w+\])? = ", line))
        call = re.match(r" +(\w+)\(", line)  # in a loop over copies too
        if call is None or call[1] == "copy":
            continue
        part = text[text.index(f"static void {call[1]}(") :].partition("\n}\n")[0]
        own = f"{call[1].removesuffix('_part')}_"  # an array is given by a call
        made = set(re.findall(r"now->(\w+)(?:\[\w+\])? = ", part))
        made |= {n for n in re.findall(r"now->(\w+)", part) if n.startswith(own)}
        assert set(re.findall(r"now->(\w+)", part)) - made <= done
        done |= made
    assert plan.equations.functions


def test_every_line_is_told_from_the_others() -> None:
    """The measure sees what it is to see: anonymous locals, names of a model, register code."""
    block = REPRESENTATIVE["freight_traction"]()
    plan = Plan(block, "ctl")
    text = (
        "    const double a12 = 1.0;\n    now->x = a12;\n    w07  = (w02*w07);\n    b[1] = 2.0;\n"
    )
    told = measure_source(plan, {"a.c": text})
    assert (told["lines"]["a.c"], told["anonymous"], told["registers"]) == (4, 2, 1)


def drag(v, c):
    """Force of the air by (7)."""
    F_air = c * v**2
    return F_air + c


@step(period=0.01, F=Output("N", "force", lo=-1e6, hi=1e6), s=Output("m", "way", lo=-1e9, hi=1e9))
def pushed(
    x=State("m", 0.0, "place", lo=-1e9, hi=1e9),
    v=Input("m/s", "speed", lo=-100, hi=100),
    c=Param("kg/m", 2.0, "drag", lo=0, hi=10),
):
    """Something pushed; Newton (3)."""
    way = x + 0.01 * v
    F = drag(v, c) * way
    return dict(x=way), dict(F=F, s=way * F)


def test_each_equation_has_its_line_in_the_model_and_the_paper_s_number() -> None:
    """The number of the part's own docstring stands before the part, and not behind each line."""
    plan = Plan(connect("whole", {"push.v": "v", "F": "push.F"}, push=pushed), "ctl")
    text = of_plan(plan)
    own = Path(__file__).read_text(encoding="utf-8").splitlines()

    def line(text: str) -> str:
        return f"{Path(__file__).name}:{own.index(f'    {text}') + 1}"

    rows = {r["equation"]: r for r in equations(plan, sources(plan))}
    head = (
        f"/* push: Something pushed; Newton (3). The lines are those of {Path(__file__).name}. */"
    )
    assert head in text
    assert rows["F_air"]["source"] == f"{line('F_air = c * v**2')}, (7)"
    assert rows["x next"]["source"] == line("way = x + 0.01 * v")
    assert rows["F"]["source"] == line("F = drag(v, c) * way")
    assert rows["x next"]["compared"] == ["push.x"]
    assert rows["F_air"]["compared"] == ["push.x", "push.F", "push.s"]
    for name, row in rows.items():
        there = sources(plan)[row["file"]].splitlines()[row["line"] - 1]
        assert re.search(rf"\b\w*{name.removesuffix(' next')}\w* = ", there), (name, there)


def test_a_comment_that_has_no_room_behind_its_statement_stands_above() -> None:
    full = "    x = " + " + ".join(["a_long_name"] * 6)
    lines = [f"{full};  /* model.py:12 */", f"{full} + {full[8:47]};  /* model.py:13 */"]
    made = laid_out(lines, "    ")
    assert all(len(row) <= WIDTH for row in made)
    assert made[:2] == ["    /* model.py:12 */", f"{full};"]
    assert made[-1].endswith("a_long_name;  /* model.py:13 */")


def test_a_branch_of_one_statement_is_a_line_if_it_fits() -> None:
    lines = ["    if (!within(x[k], lo, hi)) {", "        return false;", "    }"]
    assert laid_out(lines, "    ") == ["    if (!within(x[k], lo, hi)) { return false; }"]
    lines[0] += " /* why */"
    assert laid_out(lines, "    ") == ["    if (!within(x[k], lo, hi)) { return false; } /* why */"]
    for kept in (
        ["    if (a) {", "        b = 1;", "    } else {", "        b = 2;", "    }"],
        ["    if (a) {", "        b = 1;", "        return b;", "    }"],
        ["    if (a) {", f"        return {'b' * 80};", "    }"],
    ):
        assert laid_out(kept, "    ") == kept


def test_a_long_statement_of_bits_goes_on_below() -> None:
    line = f"    status |= (unsigned int){'A' * 40} | (unsigned int){'B' * 40};"
    first, second = laid_out([line], "    ")
    assert first.endswith("A")
    assert second == f"        | (unsigned int){'B' * 40};"
    assert laid_out([f"{'a' * 110};"], "    ") == [f"    {'a' * 110};"]


def test_a_block_declares_at_one_place_what_calls_fill() -> None:
    lines = [
        "void f(void)", "{", "    double a[3];", "    g(a);", "    bool b;", "    double c;",
        "    for (int i = 0; i < 3; ++i) {", "        double d, e;", "        g(&d);",
        "        double n;", "        h(&n);", "    }", "    if (b) {", "        double m;",
        "        h(&m);", "    }", "    h(&c, &b);", "}", "", "void g(void)", "{",
        "    double a;", "    g(&a);", "}",
    ]  # fmt: skip
    made = laid_out(lines)
    assert made[2:5] == ["    double a[3], c;", "    g(a);", "    bool b;"]
    assert {"        double d, e;", "        double m;"} <= set(made)
    assert made[-3] == "    double a;"
    many = [f"    double a_long_name_{k}[3];" for k in range(9)]
    rows = laid_out(["{", *many, "}"])
    assert len(rows) == 4
    assert all(len(row) <= WIDTH for row in rows)
    assert ", ".join(r.strip()[7:-1] for r in rows[1:3]).count("a_long_name_") == 9


def test_a_long_call_goes_on_behind_a_comma() -> None:
    texts = [f"param->number_{k} * 2.0" for k in range(9)]
    rows = laid_out([f"call({', '.join(texts)});"], "    ")
    assert len(rows) > 1
    assert all(row.endswith(",") for row in rows[:-1])


def test_equations_are_in_the_report(tmp_path: Path) -> None:
    codegen.export(pushed, tmp_path / "out")
    told = json.loads((tmp_path / "out/report.json").read_text(encoding="utf-8"))["equations"]
    text = (tmp_path / "out/report.md").read_text(encoding="utf-8")
    assert "## Equations" in text
    for row in told:
        where = f"| `{row['file']}` | {row['line']} | `{row['function']}` |"
        assert f"{where} `{row['equation']}` | {row['source']} |" in text


def test_what_has_no_name_gets_one_from_what_it_is_made_of() -> None:
    """Of the model's names alone, in one or two operations, and none that is taken."""
    lines = [
        "const double a1 = exp(theta);",
        "const bool a2 = param->law_k < in->e;",
        "const double a3 = a1 * 3.5;",
        "const double a4 = a1 + v;",
        "const double a5 = above(v, w);",
        "const double a6 = u - v;",
        "double a7 = u + v;",
        "x = a1 + (a2 ? a3 : a4) + a5 * a6;",
    ]
    assert with_pass(name_locals, lines, "law", {"u_minus_v"}) == [
        "const double exp_theta = exp(theta);",
        "const bool k_below_e = param->law_k < in->e;",
        "const double a3 = exp_theta * 3.5;",
        "const double a4 = exp_theta + v;",
        *lines[4:7],
        "x = exp_theta + (k_below_e ? a3 : a4) + a5 * a6;",
    ]


def test_a_window_that_moves_on_is_one_copy() -> None:
    moved = [f"next->w[{k}] = state->w[{k + 1}];" for k in range(4)]
    assert with_pass(copy_statements, [*moved, "next->w[4] = in->u;"]) == [
        "copy(next->w, &state->w[1], 4);", "next->w[4] = in->u;",
    ]  # fmt: skip
    for kept in (moved[:2], [*moved[:2], moved[3], moved[2]]):
        assert with_pass(copy_statements, kept) == kept


def _steps(count: int) -> list[str]:
    """Calls of a step of an iteration, each with what the one before gave."""
    lines, x, J = ["double J_1;", "begun(in->x, &J_1);"], "in->x", "J_1"
    for k in range(count):
        lines += [f"double x_next_{k + 2}[3];", f"double J_next_{k + 2};"]
        lines += [f"step({x}, {J}, gain,", f"    x_next_{k + 2}, &J_next_{k + 2});"]
        x, J = f"x_next_{k + 2}", f"J_next_{k + 2}"
    return [*lines, f"end({x}, {J});"]


def test_calls_with_what_the_one_before_gave_are_a_loop() -> None:
    """A number goes in and comes out by one variable, an array beside."""
    assert with_pass(roll_calls, _steps(2), {"i"}) == laid_out(_steps(2))
    assert with_pass(roll_calls, _steps(5), {"i"}) == [
        "double J_1, x_now[3];", "begun(in->x, &J_1);", "copy(x_now, in->x, 3);",
        "for (int i = 0; i < 5; ++i) {", "    double x_next[3];",
        "    step(x_now, J_1, gain, x_next, &J_1);", "    copy(x_now, x_next, 3);", "}",
        "end(x_now, J_1);",
    ]  # fmt: skip
    used = [*_steps(3), "end(x_next_3, J_next_3);"]  # what a call in between gave is wanted too
    assert with_pass(roll_calls, used, {"i"}) == laid_out(used)


def test_a_local_that_a_member_is_given_is_that_member_behind_one_that_is_not() -> None:
    lines = ["const double only = sin(u);", "use(only);", "const double made = cos(u);",
             "use(made);", "next->x = made;"]  # fmt: skip
    assert with_pass(place_locals, lines) == [
        *lines[:2], "next->x = cos(u);", "use(next->x);",
    ]  # fmt: skip


def test_a_call_writes_where_its_result_is_wanted() -> None:
    lines = ["double a_2;", "double b_2;", "both(x, &a_2, &b_2);", "*a = a_2;", "*b = b_2 + a_2;"]
    assert with_pass(hand_results, lines) == laid_out(lines)
    lines[-1] = "*b = b_2;"
    assert with_pass(hand_results, lines) == ["both(x, a, b);"]
    lines[3:] = ["*a = a_2;", "*b = b_2;", "*a = 2.0 * *a;"]  # a is wanted again, b is not
    assert with_pass(hand_results, lines) == [
        "double a_2;", "both(x, &a_2, b);", "*a = a_2;", "*a = 2.0 * *a;",
    ]  # fmt: skip


@step(period=0.01, y=Output("m", "way", lo=-1e9, hi=1e9))
def summed(
    force=State("m", 0.0, "place", lo=-1e9, hi=1e9),
    b=State("m", [0.0, 0.0, 0.0], "last ones", shape=(3,), lo=-1e9, hi=1e9),
    u=Input("m", "step", lo=-1, hi=1),
):
    """Something summed."""
    return dict(force=force + u, b=[u, b[0], b[1]]), dict(y=force + b[2])


def test_a_part_has_the_struct_of_its_states() -> None:
    """With their own names; a part whose states do not lie together, or whose name clashes, not."""
    plan = Plan(connect("two", {"a.u": "u", "b.u": "a.y"}, a=summed, b=summed), "ctl")
    text = of_plan(plan)
    assert [s for s, _ in plan.layout.kept] == ["a", "b"]
    assert "next->force = state->force + in->u;" in text
    assert "    b(&state->b, &next->b, now);" in text
    assert "within(x->a.force, -1e9, 1e9)" in text
    plan = Plan(connect("clash", {"in.u": "v"}, **{"in": summed}), "ctl")
    assert [s for s, _ in plan.layout.kept] == [""]  # in.force would be state->in_force
    assert "state->in_force = *param;" in of_plan(plan)
    apart = connect("apart", {"b.u": "u"}, b=summed)
    plan = Plan(connect("far", {"a_b.v": "v", "a.u": "w"}, a_b=pushed, a=apart), "ctl")
    assert [s for s, _ in plan.layout.kept] == ["", ""]


def test_a_function_that_only_calls_another_is_that_one() -> None:
    a, b, x, y = ca.SX.sym("a"), ca.SX.sym("b"), ca.MX.sym("x"), ca.MX.sym("y")
    inner = ca.Function("inner", [a, b], [a * b, a + b], ["x", "y"], ["p", "s"])
    outer = ca.Function("outer", [x, y], inner(x, y))
    turned = ca.Function("turned", [x, y], inner(y, x))
    made = Functions({})
    assert made.name(outer) == made.name(inner) == "inner"
    assert made.name(turned) == "turned"
    assert list(made.made) == ["inner", "turned"]


def test_sums_of_the_first_elements_are_a_loop() -> None:
    x = ca.MX.sym("x", 8)
    f = ca.Function("ratios", [x], [ca.cumsum(x[1:]) / 2], ["x"], ["r"])
    made = Functions({})
    text = file_text([made.made[made.name(f)]])
    assert "total += x[1 + i];" in text
    assert list(made.made) == ["ratios"]


def test_what_each_turn_takes_as_it_is_is_passed_as_it_is() -> None:
    x, k = ca.SX.sym("x"), ca.SX.sym("k", 2)
    one = ca.Function("one", [x, k], [x * k[0] + k[1]], ["x", "k"], ["y"])
    xs, ks = ca.MX.sym("xs", 1, 6), ca.MX.sym("ks", 2)
    f = ca.Function("each", [xs, ks], [one.map(6)(xs, ca.repmat(ks, 1, 6))], ["x", "k"], ["y"])
    made = Functions({})
    text = file_text([made.made[made.name(f)]])
    assert "y[i] = one(xs[i], ks);" in text
    assert list(made.made) == ["one", "each"] or list(made.made) == ["each", "one"]


def test_a_function_has_the_names_of_the_python_that_wrote_it() -> None:
    @remember_locals
    def roots() -> ca.Function:
        p, q = ca.SX.sym("p"), ca.SX.sym("q")
        half = p / 2 - q
        apart = ca.sqrt(half**2 + q)
        return ca.Function("roots", [p, q], [half + apart, half - apart], ["p", "q"], ["x", "y"])

    made = Functions({})
    text = file_text([made.made[made.name(roots())]])
    assert "const double half = p / 2.0 - q;" in text
    assert "const double apart = sqrt(half * half + q);" in text
    assert {"half", "apart"} <= made.letters


def test_a_sum_is_called_after_what_is_summed() -> None:
    lines = [
        "double a1 = (inside[0] ? 1.0 : 0.0) * state->part_slips[0];",
        "for (int i = 1; i < 5; ++i) {",
        "    a1 += (inside[i] ? 1.0 : 0.0) * state->part_slips[i];",
        "}",
        "double a2 = taps[0] * window[0];",
        "y = a1 + a2;",
    ]
    made = with_pass(name_locals, [*lines[:3], "other = a1;", *lines[3:]], "part", set())
    assert made[0].startswith("double slips_inside = ")
    assert made[2].startswith("    slips_inside += ")
    assert made[5:] == [
        "double sum_window = taps[0] * window[0];",
        "y = slips_inside + sum_window;",
    ]


def test_copies_of_a_block_keep_the_names_of_its_locals() -> None:
    """Whatever made the Function of the block first: a run, or the writing of C itself."""

    @step(period=0.01, F=Output("N", "force", lo=-1e6, hi=1e6))
    def dragged(
        x=State("m", 0.0, "place", lo=-1e9, hi=1e9), v=Input("m/s", "speed", lo=-100, hi=100)
    ):
        """Dragged."""
        pull = x - 3 * v
        swing = pull**2 + v
        return dict(x=pull), dict(F=swing * pull + swing)

    for n in (2, 3):
        text = of_plan(Plan(replicate(dragged, n), "ctl"))
        assert "const double x_next = state->x[axle] - 3.0 * in->v[axle];" in text
        assert "const double swing = x_next * x_next + in->v[axle];" in text


@pytest.mark.second
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.others("long")
def test_a_state_machine_is_a_switch_that_goes_where_the_model_goes(tmp_path, seed: int) -> None:
    """Any transitions, those from every state among them, over any signals: all are taken."""
    rng = np.random.default_rng(seed)
    names = ("rest", "fill", "hold", "vent")
    pairs = [(a, b) for a in ("*", *names) for b in names if a != b]
    drawn = [pairs[k] for k in rng.permutation(len(pairs))[: 12 - seed]]
    drawn += [p for p in zip(names, (*names[1:], names[0]), strict=True) if p not in drawn]
    machine = state_machine(
        "machine", names,
        [(a, b, f"u > {rng.uniform(-1, 1):.3f}*k and w < {rng.uniform(-1, 1):.3f}")
         for a, b in drawn],
        u=Input("1", lo=-2, hi=2), w=Input("1", lo=-2, hi=2), k=Param("1", 1.0, lo=0.5, hi=2),
    )  # fmt: skip
    inputs = {n: rng.uniform(-1, 1, 800) for n in "uw"}
    report = codegen.export(machine, tmp_path, inputs=inputs, period=0.01, check=True)
    assert report.passed, str(report)
    assert report.data["largest_relative"] == 0
    text = "".join(f.read_text("utf-8") for f in tmp_path.glob("machine*"))
    assert "switch ((int)state->at) {" in text
    assert all(f"case AT_{n.upper()}:" in text for n in names)
    assert not re.search(r"\?[^;]*\?", text[text.index("switch") :].partition("\n}\n")[0])
