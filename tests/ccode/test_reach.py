"""What a written folder's own test reaches, what it finds, and how much of a run it holds."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bench.c_folders import reach
from slipctl import Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import coverage, float_error
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.study import resolve

pytestmark = [
    pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here"),
    pytest.mark.second,
]

EVIDENCE = Path(__file__).parents[2] / "docs/evidence/reach.json"
SHIPPED = json.loads(EVIDENCE.read_text(encoding="utf-8"))["numbers"]["reach"]["controllers"]

needs_gcov = pytest.mark.skipif(
    not shutil.which("gcc") or not shutil.which(coverage.COUNTER), reason="no gcc with gcov"
)


@step(period=1e-3, T=Output("N m", "torque", lo="-T_max", hi="T_max"))
def law(
    x=State("m/s", 0.0, "sum", lo=-1e3, hi=1e3),
    u=Input("m/s", "slip error", lo=-10, hi=10, change=0.5, stale=5),
    k=Param("N s/m", 2.0, "gain", lo=1, hi=10),
    k_i=Param("N/m", "k / 4", "integral gain", lo=0.1, hi=2),
    T_max=Param("N m", 40.0, "largest torque", lo=1, hi=100),
):
    """Proportional-integral law."""
    return dict(x=x + u * 1e-3), dict(T=k * u + k_i * x)


def _test(folder: Path) -> str:
    done = subprocess.run(["make", "test"], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


@needs_gcov
def test_the_own_test_reaches_refusals_and_resets(tmp_path: Path) -> None:
    """A run without a fault reaches none of the guards; the trials after it do.

    What is left cannot be: ``start`` is asked for part 0 or 1 alone where there is one part, and
    the torque does not come to its upper limit.
    """
    u = {"u": 0.5 * np.sin(np.arange(50))}
    report = codegen.export(law, tmp_path, inputs=u, check=True)
    found = report.data["coverage"]
    assert report.passed
    assert {m["function"] for m in found["missing"]} <= {"limit", "start", "accept"}
    assert found["branches"]["reached"] >= 0.95 * found["branches"]["all"]
    assert found["untouched"] == []
    assert "own test reaches" in str(report)
    assert "## Reached by the test" in (tmp_path / "report.md").read_text(encoding="utf-8")


@needs_gcov
def test_a_folder_that_is_checked_again_counts_from_zero(tmp_path: Path) -> None:
    """A run does not add to what another test has reached there."""
    u = {"u": 0.5 * np.sin(np.arange(50))}
    plan = Plan(law, "law", None)
    folder = codegen.export(law, tmp_path, inputs=u).folder
    whole = coverage.run_with_counters(plan, folder, compilers.compilers())
    test = folder / "test_law.c"
    test.write_text(test.read_text("utf-8").replace("misused(&param, &state)", "0"), "utf-8")
    part = coverage.run_with_counters(plan, folder, compilers.compilers())
    assert part["branches"]["reached"] < whole["branches"]["reached"]


@needs_gcov
def test_what_no_input_reaches_is_told(tmp_path: Path) -> None:
    """A phase that its inputs cannot bring about is listed with its line."""

    @step(period=1e-3, y=Output("1", "number", lo=-10, hi=10))
    def phases(x=State("1", 0.0, "ticks", lo=0, hi=5), u=Input("1", "number", lo=-1, hi=1)):
        """A phase that begins at an input of 2, which is out of range."""
        return dict(x=x), dict(y=_if(u))

    def _if(u):
        import casadi as ca

        return ca.if_else(u > 2, 7.0, u)

    found = codegen.check(phases, {"u": np.zeros(20)}, tmp_path)["coverage"]
    assert any("7.0" in m["text"] and m["branches"] for m in found["missing"])


@pytest.mark.parametrize(
    ("what", "to", "finds"),
    [
        ("state->in_force = *param;", "", "tune that forgets"),
        ("return status;", "return 0;", "init that says nothing"),
        ("if (state->guard.mark != INITIALISED) {", "if (state->guard.mark == 1U) {", "mark"),
        ("state->guard.refused = (turn < 3U) ? refused : 0U;", "", "no reset"),
    ],
)  # fmt: skip
@pytest.mark.others("long")
def test_the_own_test_sees_a_guard_that_is_broken(tmp_path: Path, what, to, finds) -> None:
    folder = codegen.export(law, tmp_path / finds, inputs={"u": np.zeros(20)}).folder
    assert "0 trials went wrong" in _test(folder)
    text = (folder / "law.c").read_text(encoding="utf-8")
    assert what in text
    (folder / "law.c").write_text(text.replace(what, to, 1), encoding="utf-8")
    assert "Error" in _test(folder)


@pytest.mark.skipif(not float_error.has_cpp_compiler(), reason="no C++ compiler")
def test_a_folder_in_float_holds_no_more_of_a_run_than_can_be_tried_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ticks follow from operations, which are counted: the same on every machine."""
    u = {"u": 0.5 * np.sin(np.arange(3000))}
    whole = codegen.export(law, tmp_path / "whole", inputs=u, real="float").data
    monkeypatch.setattr(float_error, "ENOUGH", 2000)
    monkeypatch.setattr(float_error, "AT_LEAST", 100)
    part = codegen.export(law, tmp_path / "part", inputs=u, real="float").data
    checked = codegen.check(law, u, tmp_path / "checked", real="float")
    assert (whole["ticks"], checked["ticks"]) == (3000, 3000)
    assert 100 <= part["ticks"] < 1000
    assert "0 faults" in _test(tmp_path / "part")


@needs_gcov
def test_a_shipped_controller_is_reached(tmp_path: Path) -> None:
    study = resolve.load_study("subway_braking")
    loop, case = resolve.find_loop(study, "smc")
    inputs, params = codegen.record_part(loop, study.controller, case.scenario)
    data = codegen.check(loop[study.controller], inputs, tmp_path, params, period=loop.period)
    assert data["passed"]
    assert coverage.share(data["coverage"], "branches") >= 0.95


@needs_gcov
@pytest.mark.parametrize(
    "name", ["predictive:nmpc", pytest.param("predictive:nmpc_told_dry", marks=pytest.mark.long)]
)
@pytest.mark.long
def test_ways_of_a_solver_are_reached(name: str) -> None:
    """Rescue by the interior point, a solver that breaks, results that are refused."""
    found = reach.reached(name)
    assert coverage.share(found, coverage.REACHABLE) >= reach.LEAST
    assert found["untouched"] == []
    assert not [m for m in found["missing"] if not m["reached"]]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_controller_was_found_reached(name: str) -> None:
    """As the page says; the file is written anew where the test changes."""
    assert coverage.share(SHIPPED[name], coverage.REACHABLE) >= reach.LEAST


def test_the_head_of_the_report_has_time_stack_code_and_assumptions(tmp_path: Path) -> None:
    """For the first look: on a board too, where there is one; functions stand below."""
    from slipctl.ccode.compile import board

    on_board = shutil.which(board.TOOLS + "gcc") and shutil.which(board.EMULATOR)
    target = "cortex-m4" if on_board and float_error.has_cpp_compiler() else "host"
    data = codegen.check(law, {"u": np.zeros(20)}, tmp_path, target=target)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    heads = [line for line in text.splitlines() if line.startswith("## ")]
    assert heads[:2] == ["## At a glance", "## What is assumed"]
    glance = text.partition("## At a glance")[2].partition("## What")[0]
    for t in [*data["targets"], *data["compiled"]]:
        assert f" {t['bytes']['text']} |" in glance
        assert t["functions"]["law_step"]["code"] > 0
        assert f" {t.get('stack_used', '')} |" in glance
    assumed = text.partition("## What is assumed")[2].partition("## Text")[0]
    assert ("QEMU" in assumed) == (target != "host")
    assert "`law_init` comes before the first `law_step`" in assumed
    assert "| `law_step` | " in text.partition("## Functions")[2]


@step(period=1e-3, T=Output("N m", "torque", lo=-40.0, hi=40.0))
def full(
    x=State("m/s", 1.0, "sum; at the start it is full", lo=-1e3, hi=1.0),
    u=Input("m/s", "slip error", lo=-10, hi=10, change=0.5, stale=5),
):
    """A sum that a fresh instance cannot take the last input of."""
    return dict(x=x + 0.5 * u), dict(T=2.0 * x)


@needs_gcov
def test_a_module_whose_start_is_refused_is_tried_too(tmp_path: Path) -> None:
    """The trials go on where a fresh instance refuses the last inputs; their guards are reached."""
    u = {"u": np.array([-0.5] * 10 + [0.0, 0.4])}
    report = codegen.export(full, tmp_path, inputs=u, check=True)
    assert report.passed
    lines = {m["text"] for m in report.data["coverage"]["missing"] if not m["reached"]}
    assert report.data["coverage"]["untouched"] == []
    assert "return (unsigned int)FULL_RESET;" not in lines


def test_what_no_call_of_a_text_asks_for_counts_as_unreachable() -> None:
    """Pointers of CasADi's calls, and failures that no function begins; not what numbers decide."""
    first, last = (f"/* {m} */" for m in coverage.KERNEL)
    text = [first, "if (res[0]) res[0][1] = w0;", "if (f__f1(arg1, res1, iw, w, 0)) return 1;",
            "w1 = (w1<w3);", "for (i=0; i<n; ++i) z[i] = 0.;", last, "if (res[0]) {"]  # fmt: skip
    ways = [{"count": 1}, {"count": 0}]
    lines = [
        {"line_number": k, "count": 0 if k == 5 else 1, "branches": ways,
         "function_name": "casadi_mtimes" if k == 5 else "f"}
        for k in (2, 3, 4, 5, 7)
    ]  # fmt: skip
    found = coverage._counted({"lines": lines, "functions": []}, text, "a.h", text)
    assert found["branches"] == {"all": 10, "reached": 5}
    assert found[coverage.REACHABLE] == {"all": 6, "reached": 4}
    text[3] = "if (w1 < w3) return 1;"  # one that fails: then all that call it may
    found = coverage._counted({"lines": lines, "functions": []}, text, "a.h", text)
    assert found[coverage.REACHABLE] == {"all": 7, "reached": 4}


def test_what_is_done_where_a_text_failed_counts_as_unreachable_beside_it_too() -> None:
    """The module around the parts asks whether they failed; where none can, no call takes it."""
    home = [f"/* {coverage.KERNEL[0]} */", "return 0;", f"/* {coverage.KERNEL[1]} */"]
    text = ["if (failed != 0) {", "if (off != 0) {"]
    lines = [{"line_number": k, "count": 1, "branches": [{"count": 1}, {"count": 0}]}
             for k in (1, 2)]  # fmt: skip
    found = coverage._counted({"lines": lines, "functions": []}, text, "a.c", home)
    assert found[coverage.REACHABLE] == {"all": 3, "reached": 2}
    home[1] = "return 1;"
    found = coverage._counted({"lines": lines, "functions": []}, text, "a.c", home)
    assert found[coverage.REACHABLE] == {"all": 4, "reached": 2}
