"""A step that is told the number of its tick: a call that comes twice or late is seen."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from module_text import changed

from slipctl import BadInput, Input, Output, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.commands.cli import main

try:
    CC = compilers.compilers()[0]
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)


@step(period=0.01, y=Output("m", "way", lo=-1e3, hi=1e3))
def way(
    x=State("m", 0.0, "way so far", lo=-1e3, hi=1e3),
    u=Input("m/s", "speed", lo=-10, hi=10, change=1.0, stale=5),
):
    """Way of a speed."""
    return dict(x=x + 0.01 * u), dict(y=x + 0.01 * u)


CALLS = """#include "way.h"
#include <stdio.h>
int main(void)
{
    static const double u[] = {%s};
    static const unsigned int tick[] = {%s};
    way_param param;
    way_state state;
    way_in in;
    way_out out = {0.0};
    unsigned int k;
    way_default(&param);
    if (%d == 0) { (void)way_init(&param, &state); } else { state.guard.mark = 0U; }
    for (k = 0; k < (sizeof(u) / sizeof(u[0])); ++k) {
        int status;
        in.u = u[k];
        status = way_step_counted(&in, &param, &state, &out, tick[k]);
        (void)printf("%%d %%.6f\\n", status, (double)out.y);
    }
    return 0;
}
"""
TIMING, REFUSED, OFF_RANGE, NO_INIT = 256, 32, 8, 128


def called(folder: Path, rows: list[tuple[float, int]], begun: bool = True) -> list[list[str]]:
    """Status and output of calls, each with an input and the number of its tick."""
    codegen.export(way, folder, counter=True)
    speeds, ticks = (", ".join(map(str, column)) for column in zip(*rows, strict=True))
    (folder / "calls.c").write_text(CALLS % (speeds, ticks, not begun), encoding="utf-8")
    command = [CC, "-std=c99", "way.c", "calls.c", "-o", "calls", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    said = subprocess.run(["./calls"], cwd=folder, check=True, capture_output=True, text=True)
    return [line.split() for line in said.stdout.splitlines()]


def test_a_call_that_comes_twice_changes_nothing(tmp_path: Path) -> None:
    """Output and state are those of the first one, however often it comes."""
    rows = called(tmp_path, [(1, 5), (1, 6), (2, 6), (2, 6), (2, 7)])
    assert [int(s) for s, _ in rows] == [0, 0, TIMING | REFUSED, TIMING | REFUSED, 0]
    assert [y for _, y in rows] == ["0.010000", "0.020000", "0.020000", "0.020000", "0.040000"]


def test_a_late_call_lets_an_input_have_gone_as_far_as_it_can(tmp_path: Path) -> None:
    """3 m/s in one tick is too much, in three it is not; in four ticks 6 m/s is too much again.

    5 m/s would do: of the two ticks that the first call was late, one is still in doubt.
    """
    on_time = called(tmp_path / "a", [(0, 1), (3, 2)])
    late = called(tmp_path / "b", [(0, 1), (3, 4), (9, 8)])
    assert [int(s) for s, _ in on_time] == [0, OFF_RANGE]
    assert [int(s) for s, _ in late] == [0, TIMING, TIMING | OFF_RANGE]


def test_a_counter_that_is_wrong_once_disables_nothing(tmp_path: Path) -> None:
    """Neither one far ahead nor one that begins again; it wraps without a word."""
    ticks = [10, 4000000000, 11, 12, 0, 1, 4294967295, 0, 1]
    rows = called(tmp_path, [(1, t) for t in ticks])
    assert [int(s) for s, _ in rows] == [0, TIMING, TIMING, 0, TIMING, 0, TIMING, 0, 0]
    assert rows[-1][1] == "0.090000"


def test_a_state_that_was_never_set_up_is_told_so(tmp_path: Path) -> None:
    rows = called(tmp_path, [(1, 1), (1, 1)], begun=False)
    assert [int(s) for s, _ in rows] == [NO_INIT | REFUSED] * 2


@pytest.mark.second
@pytest.mark.parametrize("real", [pytest.param("double", marks=pytest.mark.long), "float"])
def test_the_own_test_counts_too(tmp_path: Path, real: str) -> None:
    """On this machine in both precisions; a step that takes no notice of its number is found."""
    report = codegen.export(way, tmp_path / "good", check=True, real=real, counter=True)
    assert report.passed, str(report)
    honest = codegen.texts

    def wrong(*given):
        return changed(honest(*given), "way", "if (since == 0U) {", "if (since == 9U) {")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(codegen, "texts", wrong)
        assert not codegen.export(way, tmp_path / "bad", check=True, real=real, counter=True).passed


def test_without_it_nothing_is_written(tmp_path: Path) -> None:
    plain, counted = (codegen.texts(Plan(way, counter=c)) for c in (False, True))
    for file in ("way.h", "way.c", "way.a2l", "test_way.c", "README.md"):
        assert "TIMING" not in plain[file]
        assert "TIMING" in counted[file]
    assert "0 0 0 511" in counted["way.a2l"]


@pytest.mark.second
def test_by_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["c", "subway_braking:smc", "--counter", "--rates", "--out", "c"]) == 2
    assert main(["c", "hst_braking:pid", "--counter", "--rates", "--out", "c"]) == 0
    header = Path("c/hst_braking_pid.h").read_text(encoding="utf-8")
    assert "hst_braking_pid_step_counted(" in header
    assert "hst_braking_pid_step_1ms(" in header
    size = json.loads(Path("c/report.json").read_text(encoding="utf-8"))["memory_bytes"]["state"]
    given = [CC, "-std=c99", "-x", "c", "-", "-I", "c", "-o", "size"]
    text = '#include "hst_braking_pid.h"\n#include <stdio.h>\nint main(void)\n{\n'
    text += '(void)printf("%u", (unsigned int)sizeof(hst_braking_pid_state));return 0;}\n'
    subprocess.run(given, input=text, text=True, check=True)
    said = subprocess.run(["./size"], check=True, capture_output=True, text=True)
    assert int(said.stdout) == size


@pytest.mark.second
@pytest.mark.skipif(shutil.which("frama-c") is None, reason="no frama-c on this machine")
def test_it_is_proven_with_the_rest(tmp_path: Path) -> None:
    """The harness steps by the number of the tick: any number at all."""
    plan = Plan(way, counter=True)
    text = module_proof.harness(plan)
    assert "way_step_counted(&in, &param, &state, &out, number)" in text
    assert module_proof.run_eva(plan, codegen.texts(plan))["passed"]
