"""A report in which something of each kind stands: each number of it is told, failures too."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import pytest

from slipctl import Input, Output, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import analysis, coverage
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship.readable import assumptions, readable


@step(period=0.01, y=Output("N", "sum", lo=-9, hi=9), z=Output("m", "other"))
def adds(s=State("kg", 0.0, "kept", lo=-9, hi=9), u=Input("1", "given", lo=-1, hi=1)):
    """Some of what was and of what comes."""
    return dict(s=0.9 * s + u), dict(y=s + u, z=u)


def told(first: int, n: int = 3) -> dict[str, int]:
    return dict(zip(("text", "data", "bss"), range(first, first + n), strict=False))


COMPILED = [
    {"compiler": "gcc 77.1", "flags": "-O2 -flag", "bytes": told(1001), "faults": 31,
     "symbols": {"defined": ["adds_one", "adds_two"], "needed": []}, "double_functions": [],
     "stack": {"worst": 1011, "adds_step": 1012}, "own_test": "gcc said well",
     "functions": {"adds_step": {"code": 1021, "data": 1022}, "limit": {"code": 1023}}},
    {"compiler": "clang 78.2", "flags": "-O2 -flag", "bytes": None, "faults": 32, "symbols": None,
     "double_functions": [], "stack": None, "own_test": "clang said well", "functions": None},
]  # fmt: skip
TARGETS = [
    {"target": "cortex-a", "compiler": "arm 79.3", "bytes": told(2001), "passed": True,
     "stack": {"worst": 2011, "adds_step": 2012}, "stack_used": 2013, "double_helpers": ["d", "e"],
     "instructions": {"mean": 2021.0, "most": 2022}, "ticks": 2023, "own_test": "arm said well",
     "signals": {"y": 2.5e-9, "z": 2.7e-9},
     "load": load.load(2021.0, 2022, 0.01, 1e6),
     "functions": {"adds_step": {"code": 2031, "data": 2032}}},
    {"target": "cortex-b", "compiler": "arm 79.3", "bytes": None, "passed": True, "stack": None,
     "double_helpers": []},
]  # fmt: skip
COVERED = {
    "by": "gcov", "statements": {"all": 400, "reached": 301}, "untouched": ["idle", "lazy"],
    "branches": {"all": 200, "reached": 153}, coverage.REACHABLE: {"all": 160, "reached": 151},
    "missing": [
        {"file": "one.c", "line": 3001, "function": "one", "text": "if (a | b)", "reached": True,
         "branches": 3002},
        {"file": "two.h", "line": 3003, "function": "two", "text": "x = 1;", "reached": False,
         "branches": 0},
    ],
}  # fmt: skip
ANALYSIS = {
    "tool": "Cppcheck 80.4", "kernel_lines": 4001, "passed": True,
    "misra": {"adds.c": {"15.5": 41, "8.9": 42, "17.3": 43},
              analysis.APART: {"15.5": 44, "11.4": 45}},
    "cppcheck": {"adds.c": {"knownThing": 46}}, "required": {"adds.c 17.3": 43, "adds.h 1.1": 7},
    "deviations": {"17.3": "why of 17"}, "explained": {"knownThing": "why of known"},
}  # fmt: skip
PROOF = {
    "tool": "Frama-C 81.5", "options": "-eva -more", "assumptions": ["first thing", "second thing"],
    "seconds": 5001, "limit_seconds": 5002, "ended": True, "passed": True, "non_finite": 5003,
    "alarms": [{"file": "adds.c", "line": 5004, "function": "equations", "kind": "index",
                "condition": "k < 5"}],
    "ranges": {"proven": 5005, "of": 5006, "open": ["out.y"], "without": ["t"]},
    "of_guards": False,
}  # fmt: skip


def compared(k: int, how: str = "every tick") -> dict[str, Any]:
    return {"absolute": k * 1.25e-9, "relative": k * 1.5e-9, "counted": k * 1.25e-9,
            "limit": k * 1.75e-7, "compared": how}  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Facts of a block, and beside them what tools would say."""
    folder = tmp_path_factory.mktemp("adds")
    made = codegen.export(adds, folder).data
    signals = {"y": compared(1), "z": compared(2, "envelope"), "s": compared(5, "nothing")}
    return made | {
        "compiled": COMPILED, "targets": TARGETS, "coverage": COVERED, "analysis": ANALYSIS,
        "proof": PROOF, "signals": signals, "largest_relative": 7.5e-9, "passed": True,
        "fuzz": {"executions": 6001, "seconds": 6002, "said": "nothing found", "passed": True},
        "isolation": {"sanitizers": "nothing seen", "two_instances_interleaved": True,
                      "two_modules_linked": False},
        "ticks_off_range": 6003, "ticks_limited": 6004, "ticks_undecided": 6005,
    }  # fmt: skip


def report(data: dict[str, Any]) -> codegen.Report:
    return codegen.Report(Path("out"), data, None)  # type: ignore[arg-type]


def rows(text: str, head: str) -> list[list[str]]:
    """Cells of the first table after a heading."""
    part = text.partition(f"## {head}\n")[2].partition("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")]
    return [[c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines][2:]


def test_every_number_stands_in_its_table(data: dict[str, Any]) -> None:
    text = readable(data, Plan(adds).layout)
    state = str(data["memory_bytes"]["state"])
    assert rows(text, "At a glance") == [
        ["cortex-a", "2021.0", "2022", "20.2%", "2013", "2011", "2001", "4005", state],
        ["cortex-b", *[""] * 7, state],
        ["gcc 77.1", "", "", "", "", "1011", "1001", "2005", state],
        ["clang 78.2", *[""] * 7, state],
    ]
    assert rows(text, "On this machine") == [
        ["gcc 77.1", "1001", "1002", "1003", "1011", "gcc said well"],
        ["clang 78.2", "", "", "", "", "clang said well"],
    ]
    assert "* two instances interleaved: passed\n* two modules linked: FAILED" in text
    assert "* sanitizers: nothing seen" in text
    assert rows(text, "Against Python") == [
        ["`y`", "N", "1.25e-09", "1.5e-09", "1.75e-07", "every tick"],
        ["`z`", "m", "2.5e-09", "3e-09", "3.5e-07", rows(text, "Against Python")[1][5]],
        ["`s`", "kg", "6.25e-09", "7.5e-09", "", rows(text, "Against Python")[2][5]],
    ]
    assert "passed. 6003 had an input off range, 6004 an output at its limit, 6005 a" in text
    assert rows(text, "Reached by the test") == [
        ["`one.c`", "3001", "`one`", r"`if (a \| b)`", "", "3002"],
        ["`two.h`", "3003", "`two`", "`x = 1;`", "never", "0"],
    ]  # fmt: skip
    assert rows(text, "On the target") == [
        ["cortex-a", "2001", "2002", "2003", "2011", "2013", "2021.0", "2022", "2", "2.7e-09",
         "passed"],
        ["cortex-b", *[""] * 7, "0", "0", "passed"],
    ]  # fmt: skip
    assert rows(text, "Functions, cortex-a") == [["`adds_step`", "2031", "2032", "2012"]]
    assert "Functions, gcc" not in text
    assert ["`adds.c`", "17.3", "43", "why of 17"] in rows(text, "MISRA C:2012 and cppcheck")
    assert ["`adds.c`", "knownThing", "46", "why of known"] in rows(
        text, "MISRA C:2012 and cppcheck"
    )
    assert rows(text, "Proven") == [["`adds.c`", "5004", "`equations`", "index", "`k < 5`"]]
    assert "Ranges not proven: `out.y`." in text
    assert "* first thing\n* second thing" in text
    assert "6001 runs of libFuzzer in 6002 s: nothing found." in text
    assert "arm 79.3; instructions" in text


def test_functions_are_those_of_this_machine_where_there_is_no_target(data) -> None:
    text = readable(data | {"targets": []}, Plan(adds).layout)
    assert rows(text, "Functions, gcc 77.1") == [
        ["`adds_step`", "1021", "1022", "1012"], ["`limit`", "1023", "", ""],
    ]  # fmt: skip
    assert "Functions, clang" not in text
    assert "The stack by `-fstack-usage` is the sum of all functions" in text
    assert "counted by QEMU" not in text
    bare = readable(data | {"targets": [], "compiled": []}, Plan(adds).layout)
    assert "At a glance" not in bare
    assert "Nothing was compiled" in bare


def test_what_is_left_out_is_not_told(data) -> None:
    left = {k: v for k, v in data.items()
            if k not in ("coverage", "analysis", "proof", "fuzz", "signals")}  # fmt: skip
    text = readable(left, Plan(adds).layout)
    for head in ("Reached by", "MISRA", "Proven", "Any bytes", "Against Python"):
        assert head not in text, head
    ended = readable(data | {"proof": PROOF | {"ended": False, "alarms": []}}, Plan(adds).layout)
    assert "Ranges not proven" not in ended
    assert rows(ended, "Proven") == []
    nothing = COVERED | {"missing": [], "untouched": []}
    assert (
        rows(readable(data | {"coverage": nothing}, Plan(adds).layout), "Reached by the test") == []
    )


def test_one_line_each(data) -> None:
    assert coverage.summary(COVERED) == (
        "own test reaches 301 of 400 statements (75.2%), 153 of 200 branches (76.5%),"
        " 151 of 160 reachable branches (94.4%); never called: idle, lazy"
    )
    assert coverage.summary({}).startswith("coverage not measured")
    assert coverage.share({"x": {"all": 0, "reached": 0}}, "x") == 1
    advisory = sum(n for r, n in ANALYSIS["misra"]["adds.c"].items() if r in analysis.ADVISORY)
    kernel = ANALYSIS["misra"][analysis.APART]
    inside = sum(n for r, n in kernel.items() if r not in analysis.ADVISORY)
    assert analysis.summary(ANALYSIS) == (
        f"MISRA C:2012 (Cppcheck 80.4): 50 required, {advisory} advisory findings in what slipctl"
        f" writes; in 4001 lines of CasADi's {inside} required, {89 - inside} advisory"
    )
    assert "CasADi" not in analysis.summary(ANALYSIS | {"kernel_lines": 0})
    assert module_proof.summary(PROOF) == (
        "Frama-C: 1 alarms, 5005 of 5006 ranges proven; signals without a range: 1"
        " (NaN and infinity as alarms: 5003 alarms): proven"
    )
    assert module_proof.summary(PROOF | {"passed": False, "non_finite": None}).endswith(
        "(NaN and infinity as alarms: no result): NOT PROVEN"
    )
    open_ = PROOF | {"ended": False}
    assert module_proof.summary(open_) == (
        "Frama-C: no end in 5002 s, nothing is proven of the equations"
    )
    assert module_proof.summary(open_ | {"of_guards": True}).endswith(
        "equations; of the guards, whatever the equations give: 1 alarms, 5005 of 5006 ranges"
        " proven"
    )


def test_what_is_printed(data) -> None:
    text = str(report(data))
    lines = [line.strip() for line in text.splitlines()]
    assert lines[0] == (
        f"adds in double: {len(data['files']) + 1} files in out, content {data['content']}"
    )
    assert "gcc 77.1: no warning, text 1001, data 1002, bss 1003 bytes" in lines
    assert "clang 78.2: no warning bytes" in lines
    assert f"one instance: {data['memory_bytes']['state']} bytes of state" in lines
    assert (
        f"{data['ticks']} ticks replayed, largest difference from Python 1.5e-09 of the largest"
        " value (y); 1 compared by the range alone, among them z; 1 compared not at all, among them"
        " s: passed"
    ) in lines
    assert (
        "cortex-a: no warning, text 2001, data 2002, bss 2003 bytes, stack 2011,"
        " functions of double linked: 2"
    ) in lines
    assert "cortex-b: no warning bytes, stack ?, functions of double linked: 0" in lines
    assert (
        "cortex-a: 2021 instructions per step, at most 2022, 2013 bytes of stack used, 2023 ticks:"
        " passed"
    ) in lines
    assert f"cortex-a: {load.load_line(TARGETS[0]['load'])}" in lines
    assert f"{coverage.summary(COVERED)}" in lines
    assert f"{analysis.summary(ANALYSIS)}" in lines
    assert "libFuzzer: 6001 runs in 6002 s, nothing found" in lines
    assert module_proof.summary(PROOF) in lines
    assert "public symbols" not in text


def test_a_report_has_passed_only_if_each_part_has(data) -> None:
    assert report(data).passed
    said = {
        (): "differs from Python", ("analysis",): "MISRA", ("fuzz",): "libFuzzer",
        ("targets", 0): TARGETS[0]["target"], ("targets", 1): TARGETS[1]["target"],
    }  # fmt: skip
    for place, word in said.items():
        bad = copy.deepcopy(data)
        inner: Any = bad
        for key in place:
            inner = inner[key]
        inner["passed"] = False
        assert not report(bad).passed, place
        (failure,) = report(bad).failures  # it is told as what it is, and as nothing else
        assert word in failure, place
    failed = str(report(data | {"passed": False}))
    assert "not at all, among them s: FAILED" in failed
    assert (
        "gcc 77.1: gcc said well; 31 ticks with another status; public symbols adds_one," in failed
    )
    assert "clang 78.2: clang said well; 32 ticks with another status; public symbols" in failed
    assert "  two modules linked: False" in failed
    slow = copy.deepcopy(data)
    slow["targets"][0]["load"] = load.load(2021.0, 20022, 0.01, 1e6)
    assert report(slow).failures == ("a step takes longer than its tick",)
    unproven = data | {"proof": PROOF | {"passed": False}}
    assert report(unproven).failures == ("Frama-C has not proved all goals",)
    looped = data | {"closed_loop": LOOPED | {"passed": False}}
    assert len(report(looped).failures) == 1
    assert report(data | {"closed_loop": LOOPED}).passed
    errors = copy.deepcopy(data)
    errors["analysis"] |= {"passed": False, "required": {}}
    assert "cppcheck" in report(errors).failures[0]
    assert "adds.c 17.3, adds.h 1.1" in report(
        data | {"analysis": ANALYSIS | {"passed": False}}
    ).failures[0]  # fmt: skip


LOOPED = {
    "ticks": 7001, "period": 0.5, "passed": True, "metrics_differ": ["lock_time", "slip_max"],
    "commands": {
        "u": {"absolute": 1.0, "largest": 100.0, "element": None, "unit": "N", "tick": 3},
        "w": {"absolute": 0.5, "largest": 10.0, "element": 2, "unit": "kg", "tick": 8},
        "x": {"absolute": 0.01, "largest": 0.0, "element": None, "unit": "1", "tick": 4},
    },
    "metrics": {"stopping_distance": [123.25, 123.5], "lock_time": [2.0, 1.5],
                "slip_max": [None, 1.0], "distance": [9.0, 8.0]},
}  # fmt: skip
"""Numbers of a float module and of Python, Python's first."""


def test_a_module_in_float_tells_its_closed_loop(data) -> None:
    """The command that is furthest off of its own size, then the metrics that differ."""
    looped = data | {"real": "float", "closed_loop": LOOPED}
    said = (
        "in closed loop 7001 ticks, w[2] differs most, by 0.5 of 10 kg at tick 8 (4 s);"
        " stopping_distance 123.5, in Python 123.25; lock_time 1.5, in Python 2: passed"
    )
    assert f"  {said}" in str(report(looped)).splitlines()
    assert f"{said[0].upper()}{said[1:]}." in readable(looped, Plan(adds).layout)
    assert "closed loop" not in readable(data, Plan(adds).layout)
    assert "closed loop" not in str(report(data | {"closed_loop": LOOPED}))
    alone = str(report(data | {"real": "float"})).splitlines()
    assert any("not run in closed loop: adds is in no loop" in line for line in alone)
    bare = LOOPED | {"commands": {}, "metrics_differ": [], "metrics": {}, "passed": False}
    assert "  in closed loop 7001 ticks: FAILED" in str(
        report(looped | {"closed_loop": bare})
    ).splitlines()  # fmt: skip


def test_a_search_and_a_proof_one_by_one_are_told(data) -> None:
    found = {"pieces": 8001, "new": 8002, "ways": 8003, "ticks": 8004}
    (line,) = (s for s in str(report(data | {"search": found})).splitlines() if "8001" in s)
    assert re.findall(r"\d+", line) == ["8001", "8002", "8003", "8004"]
    one_by_one = PROOF | {"functions": {"ended": 21, "of": 23}}
    assert "(NaN and infinity as alarms: 5003 alarms; one by one: 21 of 23 functions end)" in (
        module_proof.summary(one_by_one)
    )
    assert "one by one" not in module_proof.summary(PROOF | {"functions": {"ended": 0, "of": 0}})
    stopped = copy.deepcopy(data)
    stopped["targets"][0] |= {"passed": False}
    assert f"2023 ticks: FAILED, {TARGETS[0]['own_test']}" in str(report(stopped))
    assert report(stopped).failures == ("its test fails on cortex-a",)


def test_assumptions_name_the_length_of_a_tick_if_it_is_known(data) -> None:
    for period, said in ((0.25, "every tick of 0.25 s"), (None, "whose length is not known")):
        found = [a for a in assumptions(data | {"period_s": period}) if "adds_step` is" in a]
        assert len(found) == 1
        assert said in found[0]
    counted = assumptions(data)
    plain = assumptions(data | {"targets": []})
    bare = assumptions(data | {"targets": [], "compiled": []})
    assert (len(counted), len(plain), len(bare)) == (7, 6, 5)
    assert counted[:5] == plain[:5] == bare
    assert "ADDS_NO_INIT" in bare[0]


def test_all_that_is_proved_with_every_range_leaves_the_tables_out(data) -> None:
    clean = PROOF | {"alarms": [], "ranges": PROOF["ranges"] | {"open": [], "without": []}}
    text = readable(data | {"proof": clean}, Plan(adds).layout)
    assert rows(text, "Proven") == []
    assert "Ranges not proven" not in text
    assert "nothing is claimed" not in text
    assert "nothing is claimed of them: `t`." in readable(data, Plan(adds).layout)
    assert "options: `-eva -more`" in text
