"""CasADi's text is proven function by function; what breaks a contract between them is told."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest
from test_proof import needs_tool

from slipctl import Input, Output, State
from slipctl.block.block import make_block
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import kernel_proof, module_proof
from slipctl.ccode.module.plan import Plan

_s, _q = ca.SX.sym("s", 2), ca.SX.sym("q")
_once = ca.Function("once", [_s, _q], [ca.vertcat(_s[0] + ca.sin(_s[1]) * _q, 0.9 * _s[1])])


def _folded(x: Any, u: Any, p: Any) -> Any:
    s, q = x["s"], u["u"]
    a, b = ca.MX.sym("a", 2), ca.MX.sym("b")
    longer = ca.Function("longer", [a, b], [_once.fold(200)(a, ca.repmat(b, 1, 200))])
    none = ca.Function("none", [a, b], [a])
    due = ca.Function.if_else("due", longer, none)
    form = ca.bilin(ca.DM.eye(2), a, a)  # there is no own text of it
    chosen = ca.Function("chosen", [a, b], [due(b > 0, a, b) * form])
    many = chosen.map(12)(ca.repmat(s, 1, 12), ca.repmat(q, 1, 12))
    return {"s": 0.5 * many[:, 0]}, {"path": many}


folded = make_block(
    "folded", "step", _folded, sx=False, doc="A fold, called where it is due.",
    states=[State("1", 0.2, lo=-9, hi=9, shape=(2,)).named("s")],
    inputs=[Input("1", lo=-1, hi=3).named("u")],
    outputs=[Output("1", lo=-9, hi=9, shape=(2, 12)).named("path")],
)  # fmt: skip
PLAN = Plan(folded, "ctl", 0.01)
MADE = codegen.texts(PLAN)
PARTS = "ctl_parts.h"


def test_calls_go_to_contracts_and_lines_stay() -> None:
    """Each function is proven for each way it is called; what calls it sees its contract alone."""
    text = MADE[PARTS]
    files, contracts = kernel_proof.text_with_contracts(
        "ctl", PARTS, text, "double", PLAN.equations.work[2:]
    )
    analysed, proofs = files[PARTS], files[kernel_proof.PROOFS]
    assert analysed.count("\n") == text.count("\n")
    assert contracts == proofs.count("failed = ")
    called = [
        line.split("(")[0] for line in text.splitlines() if "__f" in line and "static" in line
    ]
    assert called
    for name in (c.split()[-1] for c in called):
        calls = text.count(f"{name}(") - 1
        assert calls
        assert analysed.count(f"any_{name}(") == calls
        assert f"= {name}(arg, res, iw, w, 0);" in proofs
    due = files[kernel_proof.CONTRACTS].split("any_due")[1].split("\n}")[0]
    assert "check flag: 0.0 <= *arg[0] <= 1.0 && \\base_addr(arg[0]) != \\base_addr(w)" in due
    assert "seen_2(arg[1])" in due
    assert "any_2(res[0])" in due


@needs_tool
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.others("long")
def test_a_module_with_casadis_text_is_proven(real: str) -> None:
    plan = Plan(folded, "ctl", 0.01, real)
    said = module_proof.run_eva(plan, codegen.texts(plan))
    assert said["passed"], said
    assert said["functions"]["ended"] == said["functions"]["of"] > 4
    assert said["non_finite"] is None
    assert "one by one: " in module_proof.summary(said)


@needs_tool
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("i < 12; ++i) {", "i < 13; ++i) {"),  # one turn too many
        ("arg1[0] += 2;", "arg1[0] += 3;"),  # by a wrong stride
        ("if (res[0] != NULL) { casadi_copy(", "if (res[0] == NULL) { casadi_copy("),  # unset
        ("res[0][1] = ", "res[0][2] = "),  # beside it
        ("return 0;\n}\n\n/* ---- end", "for (;;) { }\n}\n\n/* ---- end"),  # no end
        ("  return 0;\n}", "  return 1;\n}"),  # a failure
        ("arg1[1] = ", "arg1[1] = NULL; arg1[0] = "),  # an argument that is not there
    ],
)  # fmt: skip
@pytest.mark.others("long")
def test_what_breaks_a_contract_is_not_proven(old: str, new: str) -> None:
    text = MADE[PARTS]
    assert old in text
    said = module_proof.run_eva(PLAN, MADE | {PARTS: text.replace(old, new)}, finite=False)
    assert not said["passed"], said
    assert said["alarms"] or said["functions"]["ended"] < said["functions"]["of"]
