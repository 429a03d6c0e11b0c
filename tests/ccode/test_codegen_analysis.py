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
from slipctl.errors import RunFailed
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


@pytest.mark.long
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


# ---- what it says is counted ---------------------------------------------------------------------


@pytest.fixture
def cppcheck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """In its place a program that says lines of the file that it is asked about."""
    folder = tmp_path / "bin"
    folder.mkdir()

    def found(said: dict[str, str], code: int = 0, kernel: bool = False) -> dict[str, Any]:
        for name, text in said.items():
            (folder / name).write_text(text, encoding="utf-8")
        script = folder / "cppcheck"
        script.write_text(
            '#!/bin/sh\n[ "$1" = --version ] && echo Cppcheck 9.9 && exit\n'
            f'for last; do :; done\n[ -f guarded.h ] && [ -f "$last" ] || exit 9\n'
            f"[ -f {folder}/$last ] && cat {folder}/$last >&2\nexit {code}\n",
            encoding="utf-8",
        )
        script.chmod(0o755)
        monkeypatch.setattr(analysis, "tool", lambda: str(script))
        made = {"guarded.c": "a\nb\nc\n", "guarded.h": "h\n", "test.c": "t\n", "report.md": "no C"}
        if kernel:
            made["guarded_parts.h"] = f"a\n{analysis.KERNEL[0]}\nb\nc\n{analysis.KERNEL[1]}\nd\n"
        return analysis.cppcheck_findings(Plan(guarded), made)

    return found


ADVISED, DEVIATED = sorted(analysis.ADVISORY)[0], sorted(analysis.DEVIATIONS)[0]


def test_findings_are_counted_by_file_and_rule(cppcheck: Callable[..., Any]) -> None:
    """One that two files report is one; words that are no finding are none."""
    said = cppcheck({
        "guarded.c": "guarded.c:1:misra-c2012-7.1\nguarded.c:2:misra-c2012-7.1\n"
        f"guarded.h:1:misra-c2012-{ADVISED}\nnofile:0:information\nsome words: and more\n",
        "test.c": f"guarded.h:1:misra-c2012-{ADVISED}\ntest.c:1:misra-c2012-17.7\n",
    })  # fmt: skip
    assert said["tool"] == "Cppcheck 9.9"
    assert said["misra"] == {"guarded.c": {"7.1": 2}, "guarded.h": {ADVISED: 1},
                             "test.c": {"17.7": 1}}  # fmt: skip
    assert said["required"]["guarded.c 7.1"] == 2
    assert not any(ADVISED in k for k in said["required"])
    assert (said["kernel_lines"], said["passed"]) == (0, False)
    text = analysis.summary(said)
    assert f"{sum(said['required'].values())} required, 1 advisory findings in what" in text
    assert "CasADi's" not in text


def test_an_advisory_finding_and_a_deviation_of_a_test_break_nothing(
    cppcheck: Callable[..., Any],
) -> None:
    said = cppcheck({"guarded.c": f"guarded.c:1:misra-c2012-{ADVISED}\n",
                     "test.c": f"test.c:1:misra-c2012-{DEVIATED}\n"})  # fmt: skip
    assert (said["required"], said["passed"]) == ({}, True)
    assert set(said["deviations"]) == {DEVIATED}
    said = cppcheck({"guarded.c": f"guarded.c:1:misra-c2012-{DEVIATED}\n"})
    in_module = DEVIATED not in analysis.ADVISORY
    assert (said["required"] == {f"guarded.c {DEVIATED}": 1}) == in_module


def test_findings_in_casadis_text_are_counted_apart(cppcheck: Callable[..., Any]) -> None:
    """From the first mark to the last; what stands before and behind is ours."""
    home = "guarded_parts.h"
    lines = "".join(f"{home}:{k}:misra-c2012-7.1\n" for k in range(1, 7))
    lines += f"{home}:3:misra-c2012-{ADVISED}\n"
    said = cppcheck({"guarded.c": lines}, kernel=True)
    assert said["kernel_lines"] == 3
    assert said["misra"] == {"kernel": {"7.1": 3, ADVISED: 1}, home: {"7.1": 3}}
    assert said["required"] == {f"{home} 7.1": 3}
    assert analysis.summary(said).endswith("; in 3 lines of CasADi's 3 required, 1 advisory")


def test_its_own_errors_in_the_module_break_it(cppcheck: Callable[..., Any]) -> None:
    said = cppcheck({"guarded.c": "guarded.c:2:nullPointer\n"})
    assert (said["cppcheck"], said["passed"]) == ({"guarded.c": {"nullPointer": 1}}, False)
    said = cppcheck({"guarded.c": "", "test.c": "test.c:1:nullPointer\n"})
    assert (said["cppcheck"], said["passed"]) == ({"test.c": {"nullPointer": 1}}, True)
    known = sorted(analysis.EXPLAINED)[0]
    said = cppcheck({"guarded.c": f"guarded.c:2:{known}\n", "test.c": ""})
    assert said["passed"]
    assert set(said["explained"]) == {known}


def test_where_it_fails_that_is_told(cppcheck: Callable[..., Any]) -> None:
    with pytest.raises(RunFailed, match=r"cppcheck fails on guarded\.c: out of memory"):
        cppcheck({"guarded.c": "out of memory"}, code=1)
