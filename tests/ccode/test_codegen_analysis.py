"""What we write breaks no required rule of MISRA C:2012; CasADi's text is counted apart."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
from controllers import REPRESENTATIVE

from slipctl import BadInput, Block, Input, Output, Param, State, make_block, step
from slipctl.ccode import codegen
from slipctl.ccode.check import analysis
from slipctl.ccode.module.plan import Plan
from slipctl.study import resolve

needs_cppcheck = pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck here")


@step(T=Output("N m", "torque", lo=-5, hi=20), v=Output("1", "both", shape=(2,), lo=0, hi=0.3))
def guarded(
    i=State("m", "2*r", "integral, from the diameter"),
    e=Input("1", "error", lo=-1, hi=0.6),
    w=Input("1", "vector", shape=(2,), lo=0),
    r=Param("m", "d/2", "radius", lo=0.1, hi=10),
    d=Param("m", 3.0, "diameter", lo=0),
):
    """Derived parameter and start value, vectors, a choice that becomes a number."""
    return dict(i=i + e), dict(T=r * (i + e) + (e > 0), v=w)


BLOCKS: dict[str, Callable[[], Block]] = {
    "guarded": lambda: guarded,
    "table": lambda: make_block(
        "table", "law", _table, sx=False, inputs=[Input("1", lo=0, hi=2).named("u")],
        outputs=[Output("1").named("y")],
    ),
    "hst_braking": REPRESENTATIVE["hst_braking"],
}  # fmt: skip


def _table(x: Any, u: Any, p: Any) -> Any:
    return {}, {"y": ca.interpolant("t", "linear", [[0, 1, 2]], [0, 1, 4])(u["u"])}


@pytest.mark.long
@needs_cppcheck
@pytest.mark.parametrize("name", BLOCKS)
def test_required_rules_are_kept(name: str, tmp_path: Path) -> None:
    block = BLOCKS[name]()
    report = codegen.export(block, tmp_path, misra=True, real="float")
    found = report.data["analysis"]
    assert report.passed, json.dumps(found["required"])
    assert found["required"] == {}
    assert "0 required" in str(report)
    ours = set(found["misra"]) - {analysis.APART}
    assert {f"{block.name}.{e}" for e in "ch"} <= ours  # they were looked at
    assert ("kernel" in found["misra"]) == (name == "table")
    rules = {r for counts in found["misra"].values() for r in counts}
    assert rules <= {*analysis.ADVISORY, *found["explained"], *found["deviations"]}


@pytest.mark.long
@needs_cppcheck
@pytest.mark.parametrize("name", ["predictive:nmpc", "all_rails:nmpc", "hst_traction:mpc_limited"])
def test_solvers_keep_required_rules_too(name: str) -> None:
    """All of what is written, as none of it is CasADi's text."""
    study, _, loop = name.partition(":")
    found = resolve.load_study(study)
    plan = Plan(resolve.find_loop(found, loop)[0][found.controller], "ctl", real="float")
    made = {n: t for n, t in codegen.texts(plan).items() if n in plan.files}
    said = analysis.cppcheck_findings(plan, made)
    assert said["required"] == {}
    assert said["kernel_lines"] == 0
    assert said["passed"], said["cppcheck"]


@pytest.mark.second
@needs_cppcheck
def test_a_broken_rule_is_told(tmp_path: Path) -> None:
    codegen.c_module(guarded, tmp_path)
    made = {n: (tmp_path / n).read_text() for n in ("guarded.c", "guarded.h", "example.c")}
    plan = Plan(guarded)
    assert analysis.cppcheck_findings(plan, made)["passed"]
    first = "told |= accept(in->e"
    spoilt = made["guarded.c"].replace(first, f"const int octal = 017;\n    {first}")
    assert spoilt != made["guarded.c"]
    found = analysis.cppcheck_findings(plan, made | {"guarded.c": spoilt})
    assert not found["passed"]
    assert found["required"] == {"guarded.c 7.1": 1}  # no octal numbers


def test_without_cppcheck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="apt install cppcheck"):
        codegen.export(guarded, tmp_path / "out", misra=True)
    assert not (tmp_path / "out").exists()
