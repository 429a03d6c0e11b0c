"""A large module is proven function by function; what breaks what a function promises is told."""

from __future__ import annotations

import re
from typing import Any

import casadi as ca
import pytest
from test_proof import needs_tool

from slipctl import Input, Output, State
from slipctl.block.block import Block, make_block
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import function_proof, module_proof
from slipctl.ccode.check.proof.kernel_proof import CONTRACTS, PROOFS
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes import scratch
from slipctl.errors import RunFailed
from slipctl.predict.qp.stage_loops import Repeated, scan

_STAGES = 20


def _stage() -> ca.Function:
    x, u, q = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("q")
    after = ca.vertcat(x[0] + ca.sin(x[1]) * q, 0.9 * x[1] + u[0])
    return ca.Function(
        "stage", [x, u, q], [after, ca.vertcat(x, u)], ["x", "u", "q"], ["x_after", "row"]
    )  # fmt: skip


def _planned() -> Block:
    """Stages, again and again while something changes, where it is due."""
    over = scan(_stage(), _STAGES, 1, 1)
    z, U, q = ca.MX.sym("z", 3), ca.MX.sym("U", 2, _STAGES), ca.MX.sym("q")
    last, rows = over(z[:2], U, q)
    size = ca.sumsqr(rows)
    again = ca.vertcat(last, size > z[2])
    once = ca.Function("once", [z, U, q], [again], ["z", "U", "q"], ["z_next"])
    many = Repeated(once, 2)(30, z, U, q)
    some = ca.Function("some", [z, U, q], [many], ["z", "U", "q"], ["z_next"])
    none = ca.Function("none", [z, U, q], [z])
    due = ca.Function.if_else("due", some, none)

    def body(x: Any, u: Any, p: Any) -> Any:
        s, q = x["s"], u["u"]
        plan = ca.repmat(ca.vertcat(q, s[0]), 1, _STAGES) * ca.DM([range(_STAGES)] * 2)
        found = due(q > 0, ca.vertcat(s, 1), plan, q)
        return {"s": 0.5 * found[:2]}, {"path": plan * found[2]}

    return make_block(
        "planned", "step", body, sx=False, doc="A plan, made anew where it is due.",
        states=[State("1", 0.2, lo=-9, hi=9, shape=(2,)).named("s")],
        inputs=[Input("1", lo=-1, hi=3).named("u")],
        outputs=[Output("1", lo=-9, hi=9, shape=(2, _STAGES)).named("path")],
    )  # fmt: skip


@pytest.fixture
def made(monkeypatch) -> dict[str, tuple[Plan, dict[str, str]]]:
    monkeypatch.setattr(scratch, "DEEPEST", 40)
    plans = {real: Plan(_planned(), "ctl", 0.01, real) for real in ("double", "float")}
    return {real: (plan, codegen.texts(plan)) for real, plan in plans.items()}


def test_calls_go_to_contracts_and_lines_stay(made) -> None:
    plan, texts = made["double"]
    sources = {f: texts[f] for f in plan.files[1:]}
    text, functions = sources["ctl_parts.h"], plan.equations.functions
    files, contracts = function_proof.text_with_contracts("ctl", sources, "double", functions)
    analysed, proofs = files["ctl_parts.h"], files[PROOFS]
    assert analysed.count("\n") == text.count("\n")
    assert contracts == proofs.count("ended = 1;") == len(functions) - 1  # that of the block itself
    for name in (n for n in functions if n != "planned"):
        assert analysed.count(f"any_{name}(") == text.count(f"{name}(") - 1
        assert f"    {name}(" in proofs
    stage = files[CONTRACTS].split("void any_stage(")[1].split("\n}")[0]
    assert "const double *x, const double *u, double q, double *x_after, double *row" in stage
    assert [x.strip() for x in stage.split("\n")[2:-1]] == [
        "seen_2(x);", "seen_2(u);", "any_2(x_after);", "any_4(row);",
    ]  # fmt: skip


@needs_tool
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.others("long")
def test_a_module_of_many_functions_is_proven(made, real: str) -> None:
    said = module_proof.run_eva(*made[real])
    assert said["passed"], said
    assert said["functions"]["ended"] == said["functions"]["of"] >= 4
    assert "one by one: " in module_proof.summary(said)


@needs_tool
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"i < 20; \+\+i\) \{\n +double", "i < 21; ++i) {\n        double"),  # one turn too many
        (r"&u\[2 \* i\]", "&u[3 * i]"),  # by a wrong stride
        (r"row\[3\] = ", "row[4] = "),  # beside it
        (r"row\[3\] = ", "x_after[1] = "),  # one is never set
        (r"i < 30; \+\+i", "; "),  # no end
        (r"copy\(z_next, latest, 3\);", "copy(z_next, latest, 4);"),  # more than there is
        (r"if \(latest != z_next\)", "if (latest == z_next)"),  # not given where it is asked for
    ],
)  # fmt: skip
@pytest.mark.others("long")
def test_what_breaks_a_promise_is_not_proven(made, old: str, new: str) -> None:
    plan, texts = made["double"]
    changed, n = re.subn(old, new, texts["ctl_parts.h"])
    assert n
    said = module_proof.run_eva(plan, texts | {"ctl_parts.h": changed}, finite=False)
    assert not said["passed"], said
    assert said["alarms"] or said["functions"]["ended"] < said["functions"]["of"]


def test_a_function_that_touches_another_s_arrays_is_refused(made) -> None:
    plan, texts = made["double"]
    functions = plan.equations.functions
    names = list(plan.equations.arrays)
    text = texts["ctl_parts.h"].replace(f"&work->{names[0]};", f"&work->{names[1]};")
    with pytest.raises(RunFailed, match=f"{names[0]} touches arrays of another function"):
        function_proof.text_with_contracts("ctl", {"ctl_parts.h": text}, "double", functions)
    text = texts["ctl_parts.h"].replace(
        "    x_after[0] = ", "    stage(x, u, q, x_after, row);\n    x_after[0] = "
    )
    with pytest.raises(RunFailed, match=r"stage.*: functions that may call themselves"):
        function_proof.text_with_contracts("ctl", {"ctl_parts.h": text}, "double", functions)
