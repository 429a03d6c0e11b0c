"""What is made of what compilers, processors and searches say: they are stood in for."""

from __future__ import annotations

import ctypes
import io
import re
import struct
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.ctypeslib import as_array

from slipctl import BadInput, Input, Output, Param, RunFailed, Scenario, State, connect, step
from slipctl.ccode import codegen
from slipctl.ccode.check import coverage, float_error, fuzz, isolation
from slipctl.ccode.check.processor import rig, tick_times
from slipctl.ccode.check.proof import function_proof, kernel_proof, module_proof
from slipctl.ccode.check.vectors import expected_outputs, search, vector_file
from slipctl.ccode.check.vectors.expected_outputs import Expected, few_states
from slipctl.ccode.compile import compilers, module, programs, targets
from slipctl.ccode.compile.files import licence
from slipctl.ccode.compile.platforms import Platform
from slipctl.ccode.module.kernel import KERNEL
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship import fmu, fmu_xml, sections, xcp


@step(y=Output("1", "sum", lo=-9, hi=9), z=Output("1", "vector", shape=(2,)), period=0.5)
def sums(
    x=State("1", 0.5, "sum", lo=-9, hi=9),
    u=Input("1", "what is added", lo=-1, hi=1, value=0.25),
    n=Input("int", "how many", lo=0, hi=5, value=2),
    w=Input("1", "vector", shape=(2,), lo=-3, hi=3, value=1.0),
    k=Param("1", 1.5, "factor", lo=0, hi=2),
    m=Param("1", [2.0, 3.0], "more", shape=(2,)),
):
    """A sum."""
    return dict(x=0.5 * x + k * u * n + m[0] - m[1]), dict(y=x, z=w * m)


@step(y=Output("1", "count", lo=0, hi=9), period=0.5)
def alone(x=State("1", 0.0, "count", lo=0, hi=9)):
    """Nothing is given to it."""
    return dict(x=0.5 * x + 1), dict(y=x)


Answer = Callable[[list[str], Path], tuple[int, str, str]]


def answering(monkeypatch, where: Any, answer: Answer) -> list[list[str]]:
    """Commands that are run, each answered with a code, what it prints and what it tells."""
    asked: list[list[str]] = []

    def run_program(command: Any, folder: Any = None, **more: Any) -> Any:
        words = list(map(str, command))
        asked.append(words)
        code, printed, told = answer(words, folder)
        return subprocess.CompletedProcess(words, code, printed, told)

    monkeypatch.setattr(where, "run_program", run_program)
    return asked


# ---- search of vectors ---------------------------------------------------------------------------

ROWS = np.arange(8.0).reshape(2, 4)
FOUND = np.arange(12.0).reshape(3, 4) / 4


def searching(monkeypatch, seen: dict[str, Any], code: int = 0, refuse: Any = ()) -> Any:
    """A search that finds ``FOUND``; compilers named in ``refuse`` refuse the driver."""

    def answer(words: list[str], folder: Path) -> tuple[int, str, str]:
        if words[0].endswith("search"):
            seen.update({p.name: p.read_bytes() for p in folder.iterdir()})
            (folder / "found.bin").write_bytes(FOUND.tobytes())
            return code, "it said\n7 8 9\n", ""
        return int("search.c" in words and words[0] in refuse), "", "a: error: no\nsecond error"

    monkeypatch.setattr(search.cc, "compilers", lambda: ("/a/gcc", "/b/clang"))
    monkeypatch.setattr(search.cc, "version", lambda compiler: f"version of {compiler}")
    return answering(monkeypatch, search, answer)


MADE = {f: f"text of {f}" for f in (*Plan(sums).files, "test_sums.c", "other")}


def test_a_search_is_given_the_recorded_rows_and_tells_what_it_found(monkeypatch) -> None:
    seen: dict[str, Any] = {}
    asked = searching(monkeypatch, seen, refuse=("/a/gcc",))
    rows, told = search.find_vectors(Plan(sums), MADE, np.asfortranarray(ROWS), {"k": 0.25}, 3, 5)
    assert np.array_equal(rows, FOUND)
    assert told == {"by": "version of /b/clang", "seconds": 3, "seed": 5, "pieces": 7, "ticks": 3,
                    "ways": 8, "new": 9}  # fmt: skip
    assert sorted(seen) == sorted([*Plan(sums).files, "rows.bin", "search.c", "test_sums.c"])
    assert seen["test_sums.c"] == b"text of test_sums.c"
    assert np.array_equal(np.frombuffer(seen["rows.bin"]).reshape(-1, 4), ROWS)
    assert [w[0] for w in asked[:4]] == ["/a/gcc", "/a/gcc", "/b/clang", "/b/clang"]
    assert asked[2][-2:] == ["-c", "sums.c"]
    assert set(search.WATCHED) <= set(asked[2])
    assert not set(search.WATCHED) & set(asked[3])
    assert asked[3][-5:] == ["search.c", "sums.o", "-o", "search", "-lm"]
    assert asked[4][1:] == ["rows.bin", "2", str(3 * search.RATE), "5", "found.bin"]
    text = seen["search.c"].decode()
    numbers = [[float(v) for v in row.split(",")]
               for row in re.findall(r"\{(-?[\d.]+, -?[\d.]+, [\d.]+)\}", text)]  # fmt: skip
    assert numbers == [[-1, 1, 2], [0, 5, 5], [-3, 3, 6], [-3, 3, 6], [0.25, 2, 3]]
    assert "false, true, false, false" in text
    assert '#include "test_sums.c"' in text
    assert f"#define MOST {search.MOST}" in text
    assert f"#define LONGEST {search.LONGEST}" in text


def test_a_search_that_cannot_be_made_is_refused(monkeypatch) -> None:
    asked = searching(monkeypatch, {}, code=3)
    with pytest.raises(RunFailed, match="code 3"):
        search.find_vectors(Plan(sums), MADE, ROWS, {}, 1)
    assert [w[0] for w in asked[:2]] == ["/a/gcc"] * 2
    for plan, rows in ((Plan(alone), ROWS), (Plan(sums), ROWS[:0])):
        with pytest.raises(BadInput, match=plan.name):
            search.find_vectors(plan, MADE, rows, {}, 1)
    searching(monkeypatch, {}, refuse=("/a/gcc", "/b/clang"))
    with pytest.raises(RunFailed, match=r"a: error: no$"):
        search.find_vectors(Plan(sums), MADE, ROWS, {}, 1)


def test_a_run_goes_on_with_what_a_search_found_and_the_last_recorded_ticks_make_room(
    monkeypatch,
) -> None:
    asked: list[Any] = []

    def find(*given: Any) -> Any:
        asked.append(given)
        return FOUND, {"pieces": 7, "ticks": 3}

    def run(plan: Any, rows: np.ndarray, params: Any, whole: bool) -> Any:
        asked.append((plan, rows, params, whole))
        return SimpleNamespace(rows=rows[:-1])

    monkeypatch.setattr(search, "find_vectors", find)
    monkeypatch.setattr(search, "expected_run", run)
    recorded = SimpleNamespace(rows=np.arange(20.0).reshape(5, 4))
    for most, kept in ((search.MOST + 3, 3), (search.MOST + 9, 5), (10, 1)):
        asked.clear()
        longer, told = search.gone_on("plan", "made", recorded, {"k": 1}, 3, most)
        (plan, made, rows, params, seconds), (same, whole_rows, used, whole) = asked
        assert (same, used) == (plan, params)
        assert (plan, made, params, seconds, whole) == ("plan", "made", {"k": 1}, 3, False)
        assert np.array_equal(rows, recorded.rows[:kept])
        assert np.array_equal(whole_rows, np.vstack([rows, FOUND]))
        assert len(longer.rows) == kept + 2
        assert told == {"pieces": 7, "ticks": 2}  # the block itself ends before the last one


# ---- states that are looked at now and then ------------------------------------------------------


def long_run(ticks: int) -> Expected:
    states = np.arange(7.0 * ticks).reshape(ticks, 7)
    return Expected(
        np.zeros((ticks, 0)), states[:, :1] + 0.5, states, np.arange(ticks), {"y": 1.0},
        frozenset({"z"}),
    )  # fmt: skip


def looked_at(ticks: int, every: int) -> list[int]:
    """Latest tick that is looked at, by tick; the last one is."""
    return [t - t % every if t < ticks - 1 else t for t in range(ticks)]


@pytest.mark.parametrize(("room", "every"), [
    (200, 1), (90, 1),  # all fits, in the end just so
    (89, 2), (55, 2), (54, 3),  # 70 states in 69 places, in 35, in 34
    (43, 4), (10, 35),  # in 23; in a quarter of the room at least
])  # fmt: skip
def test_a_file_has_the_states_of_as_many_ticks_as_it_has_room_for(
    monkeypatch, room, every
) -> None:
    """Ten ticks, each with an output, a status and 7 states."""
    monkeypatch.setattr(expected_outputs, "LARGEST_FILE", room * expected_outputs.DIGITS)
    run = long_run(10)
    rows = [np.hstack([run.outputs, run.states]) + k for k in range(2)]
    trials = float_error.Trials(rows, np.arange(20).reshape(2, 10))
    plan = SimpleNamespace(real="double")
    held, tried, found = few_states(plan, run, trials)
    assert found == every
    assert tried is not None
    at = looked_at(10, every)
    assert held.states.tolist() == [run.states[t].tolist() for t in at]
    assert held.outputs is run.outputs
    assert (held.rows is run.rows, held.status is run.status) == (True, True)
    assert (held.limits, held.envelope) == ({"y": 1.0}, frozenset({"z"}))
    for k, got in enumerate(tried.rows):
        assert got[:, :1].tolist() == (run.outputs + k).tolist()
        assert got[:, 1:].tolist() == [(run.states[t] + k).tolist() for t in at]
    assert tried.status is trials.status
    same = few_states(plan, run, None)
    assert same[1:] == (None, every)
    assert np.array_equal(same[0].states, held.states)


@pytest.mark.parametrize(("room", "ticks"), [(90, 10), (89, 9), (19, 2), (3, 1)])
def test_a_run_in_float_without_trials_is_shorter_instead(monkeypatch, room, ticks) -> None:
    monkeypatch.setattr(expected_outputs, "LARGEST_FILE", room * expected_outputs.DIGITS)
    run = long_run(10)
    first, trials, every = few_states(SimpleNamespace(real="float"), run, None)
    assert (len(first.rows), trials, every) == (ticks, None, 1)
    assert np.array_equal(first.states, run.states[:ticks])


# ---- time of a step ------------------------------------------------------------------------------


class Clocked:
    """A module that takes 10, 11, ... s at its ticks the first time, less the second time, more
    the third time; what it was given is kept."""

    def __init__(self, block: Any, plan: Plan, kind: Any) -> None:
        self.block, self._plan, self._kind = block, plan, kind
        self._param, self._state = np.zeros(3), np.zeros(9)
        self.resets: list[Any] = []
        self.rows: list[np.ndarray] = []
        self._lib = SimpleNamespace(clocked=self.clocked)

    def reset(self, **params: Any) -> None:
        self.resets.append(params)

    def clocked(self, ticks: Any, rows: Any, param: Any, state: Any, taken: Any) -> None:
        assert param.value == self._param.ctypes.data
        assert state.value == self._state.ctypes.data
        n = ticks.value
        double = ctypes.POINTER(ctypes.c_double)
        wide = max(self._plan.n_in, 1)
        kind = ctypes.c_float if self._kind == np.float32 else ctypes.c_double
        given = as_array(ctypes.cast(rows, ctypes.POINTER(kind)), (n, wide))
        self.rows.append(given.copy())
        k = len(self.rows)
        as_array(ctypes.cast(taken, double), (n,))[:] = [10 + t + (k - 2) ** 2 * (t + 1)
                                                         for t in range(n)]  # fmt: skip


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("block", [sums, alone])
def test_the_time_of_a_step_is_the_least_of_all_repeats(monkeypatch, real, block) -> None:
    made: list[Any] = []
    recorded = ({"u": np.array([0.5, 1.0, -1.0]), "w": np.arange(6.0).reshape(3, 2)}
                if block is sums else {}, {"k": 1.25})  # fmt: skip
    asked: list[Any] = []
    kind = np.float32 if real == "float" else np.float64

    def c_module(part: Any, folder: str, name: str, **given: Any) -> Any:
        made.append((part, name, given))
        return Clocked(part, Plan(part, name, 0.5, real), kind)

    monkeypatch.setattr(tick_times, "record_part", lambda *given: asked.append(given) or recorded)
    monkeypatch.setattr(tick_times, "c_module", c_module)
    monkeypatch.setattr(
        tick_times, "_clocked", lambda module, folder, real: made.append((module, real)) or module
    )
    monkeypatch.setattr(tick_times, "compilers", lambda: ("/a/gcc", "/b/clang"))
    monkeypatch.setattr(tick_times, "version", lambda compiler: f"version of {compiler}")
    scenario = Scenario("go", 1.6)
    loop = connect("loop", {}, ctl=block)
    found = tick_times.step_times(loop, "ctl", scenario, repeats=3, real=real)
    (part, _, given), (clocked, _) = made
    assert (part.name, given) == (block.name, {"period": 0.5, "real": real})
    assert asked == [(loop, "ctl", scenario)]
    assert found.name == "ctl.step_time"
    assert found.dims == ("time",)
    assert found.values.tolist() == [10.0, 11.0, 12.0]  # of the second time
    assert found["time"].values.tolist() == [0.0, 0.5, 1.0]
    assert found.attrs["units"] == "s"
    for word in (real, "version of /a/gcc", "least of 3"):
        assert word in found.attrs["long_name"]
    assert clocked.resets == [{"k": 1.25}] * 3
    wanted = [[0.5, 2, 0, 1], [1, 2, 2, 3], [-1, 2, 4, 5]] if block is sums else [[0.0]] * 3
    assert [rows.tolist() for rows in clocked.rows] == [wanted] * 3


def test_a_module_is_clocked_by_what_is_compiled_beside_it(tmp_path: Path, monkeypatch) -> None:
    done: list[Any] = []
    scratch = tmp_path / "scratch"
    made = SimpleNamespace(
        compile=lambda: done.append("compiled"), object_file=scratch / "m.o", name="ctl",
        load=lambda library: ("loaded", library),
    )  # fmt: skip
    monkeypatch.setattr(tick_times, "compilers", lambda: ("/a/gcc", "/b/clang"))
    monkeypatch.setattr(tick_times, "compile_object", lambda *given: done.append(given))
    monkeypatch.setattr(tick_times, "link", lambda *given: done.append(given))
    assert tick_times._clocked(made, tmp_path, "double") == ("loaded", scratch / "clocked.so")
    assert done == [
        "compiled",
        ("/a/gcc", tmp_path / "clocked.c", scratch / "clocked.o", "-fPIC"),
        ("/a/gcc", [scratch / n for n in ("m.o", "bind.o", "clocked.o")], scratch / "clocked.so",
         "-shared"),
    ]  # fmt: skip
    assert '#include "ctl.h"' in (tmp_path / "clocked.c").read_text()


# ---- what the test of a module reaches -----------------------------------------------------------


def counted(number: int, count: int, *ways: int, function: str = "casadi_f0") -> dict[str, Any]:
    return {"line_number": number, "count": count, "function_name": function,
            "branches": [{"count": w} for w in ways]}  # fmt: skip


HOME = [
    f"/* {KERNEL[0]} */",
    "if (arg[0] != NULL) {",  # 2: asked of how it is called
    "x = y;",
    "if (f(arg, res, iw, w)) return 1;",  # 4: passed on
    "if (x < y) {",
    f"/* {KERNEL[1]} */",
    "if (failed) {",  # 7
    "if (k < 3) {",
]
LINES = [
    counted(2, 5, 5, 0), counted(3, 0), counted(4, 5, 0, 5), counted(5, 5, 3, 0),
    counted(7, 5, 0, 5), counted(8, 5, 5, 0), counted(3, 0, function="own"),
]  # fmt: skip


def test_ways_that_no_call_asks_for_are_those_of_casadi_s_text_that_cannot_fail() -> None:
    home = [line.replace("arg[0] != NULL", "arg[0] != 0") for line in HOME]
    assert coverage._by_call(LINES, home, home) == {2, 3, 4, 7}
    fails = [*home[:4], "if (x < y) return 1;", *home[5:]]  # it can fail
    assert coverage._by_call(LINES, fails, fails) == {2, 3}
    assert coverage._by_call(LINES, ["plain"] * 8, ["plain"] * 8) == set()
    other = ["if (failed) {"] * 8  # another file has none of CasADi's text
    assert coverage._by_call(LINES[:4], other, home) == {2, 3, 4, 5}
    assert coverage._by_call(LINES[:4], other, fails) == set()
    assert coverage._by_call([counted(3, 0, function="own")], home, home) == set()
    assert coverage._by_call([counted(3, 4)], home, home) == set()


@pytest.mark.parametrize(("line", "asked", "wanted"), [
    (counted(3, 5, 5, 0, 0), set(), [True, False, False]),
    (counted(3, 5, 5, 0, 0), {3}, [True, False]),  # one of them is not asked for
    (counted(3, 5, 5, 0), {3}, [True]), (counted(3, 5, 5, 2), {3}, [True, True]),
    (counted(3, 0, 0, 0), {3}, []), (counted(3, 0, 0, 0), {4}, [False, False]),
])  # fmt: skip
def test_of_a_line_that_no_call_takes_both_ways_one_is_left_out(line, asked, wanted) -> None:
    assert coverage._decided(line, asked) == wanted


def test_what_was_counted_before_is_forgotten(tmp_path: Path, monkeypatch) -> None:
    """And what gcov says is put together for all files."""
    monkeypatch.setattr(coverage.shutil, "which", lambda tool: f"/bin/{tool}")
    plan = SimpleNamespace(name="m", files=("m.h", "m.c"))
    (tmp_path / "m.c").write_text("int x;\nif (x) {\nreturn x;\n")
    (tmp_path / "m.h").write_text("first\nsecond\n")
    (tmp_path / "covered_m.gcda").write_text("old")
    said = {"files": [
        {"file": "m.h", "lines": [counted(2, 0, function="part_off")], "functions": []},
        {"file": "stdio.h", "lines": [], "functions": []},
        {"file": "m.c", "functions": [{"name": "a", "execution_count": 0},
                                      {"name": "b", "execution_count": 3}],
         "lines": [counted(1, 3, function="m_init"), counted(2, 4, 4, 0, function="m_step"),
                   counted(3, 0, function="b")]},
    ]}  # fmt: skip
    there: list[bool] = []

    def answer(words: list[str], folder: Path) -> tuple[int, str, str]:
        if words[0].endswith("covered_m"):
            there.append((folder / "covered_m.gcda").exists())
        return 0, coverage.json.dumps(said) if words[0] == "/bin/gcov" else "", ""

    asked = answering(monkeypatch, coverage, answer)
    found = coverage.run_with_counters(plan, tmp_path, ["/bin/clang", "/bin/gcc-12"])  # type: ignore[arg-type]
    assert there == [False]
    assert asked[0][0] == "/bin/gcc-12"
    assert asked[2] == [str(tmp_path / "covered_m"), "vectors.txt"]
    assert asked[3][-1] == "covered_m.gcda"
    assert found["by"] == "gcov"
    assert found["statements"] == {"all": 4, "reached": 2}
    assert found["branches"] == {"all": 2, "reached": 1}
    assert found["untouched"] == ["a"]
    assert [(m["file"], m["line"], m["reached"], m["branches"], m["asked"], m["text"])
            for m in found["missing"]] == [
        ("m.h", 2, False, 0, True, "second"), ("m.c", 2, True, 1, True, "if (x) {"),
        ("m.c", 3, False, 0, True, "return x;"),
    ]  # fmt: skip
    assert coverage.run_with_counters(plan, tmp_path, ["/bin/clang"]) == {}  # type: ignore[arg-type]
    said["files"] = said["files"][:2]
    assert coverage.run_with_counters(plan, tmp_path, ["gcc"]) == {}  # type: ignore[arg-type]


# ---- a board -------------------------------------------------------------------------------------


class Line:
    """A pipe of a board; it closes once."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.closed = 0

    def write(self, data: bytes) -> None:
        self.sent.append(data)

    def close(self) -> None:
        self.closed += 1


@pytest.mark.parametrize(("real", "kind"), [("double", "<f8"), ("float", "<f4")])
@pytest.mark.parametrize("status", [0, 4])
def test_a_board_is_built_begun_with_the_parameters_and_switched_off(
    monkeypatch, real, kind, status
) -> None:
    done: list[Any] = []
    board = SimpleNamespace(stdin=Line(), stdout=Line(), kill=lambda: done.append("kill"),
                            wait=lambda: done.append("wait"))  # fmt: skip
    began: list[Any] = []

    def popen(call: Any, **given: Any) -> Any:
        began.append((call, given))
        return board

    def build(target: str, folder: Path, sources: Any, program: str, kind: str) -> None:
        done.append((target, sources, program, kind,
                     {p.name: p.read_text() for p in folder.iterdir()}))  # fmt: skip

    monkeypatch.setattr(rig.subprocess, "Popen", popen)
    monkeypatch.setattr(rig.targets, "build", build)
    monkeypatch.setattr(rig.targets, "command", lambda target, program: ["qemu", target, program])
    monkeypatch.setattr(rig.Rig, "_receive", lambda self: self.instructions.append(9)
                        or (0, status, np.zeros(3)))  # fmt: skip
    plan = Plan(sums, "own", 0.5, real)
    made = {name: f"text of {name}" for name in (*plan.files, *targets.BOARD_FILES, "more.c")}
    if status:
        with pytest.raises(RunFailed, match="own on cortex-m4"):
            rig.Rig(plan, made, "cortex-m4", {"k": 0.25})
    else:
        with rig.Rig(plan, made, "cortex-m4", {"k": 0.25}) as own:
            assert own.instructions == []
            assert own._answer == 9 + int(kind[-1]) * 3
            folder = Path(own._scratch.name)
            assert folder.is_dir()
            assert began[0][1]["cwd"] == folder
            assert done[1:] == []
        assert done[1:] == ["kill", "wait"]
        assert (board.stdin.closed, board.stdout.closed) == (1, 1)
        assert not folder.exists()
    target, sources, program, numbers, texts = done[0]
    assert (target, sources, program, numbers) == (
        "cortex-m4", ["own.c", "rig.c"], "rig.elf", real)  # fmt: skip
    assert sorted(texts) == sorted([*plan.files, *targets.BOARD_FILES, "rig.c"])
    assert texts["own.c"] == "text of own.c"
    assert '#include "own.h"' in texts["rig.c"]
    for value in (rig.LOST, rig.LATE, rig.BROKEN):
        assert str(value) in texts["rig.c"]
    assert began[0][0] == ["qemu", "cortex-m4", "rig.elf", "-serial", "stdio", *targets.COUNT]
    content = np.array([0.25, 2.0, 3.0], kind).tobytes()
    assert board.stdin.sent == [b"\xa4" + content + rig.fletcher(content)]


def test_a_board_without_numbers_is_begun_with_one_and_answers_one(monkeypatch) -> None:
    @step(period=0.5)
    def idle(x=State("1", 0.0)):
        return dict(x=x), {}

    board = SimpleNamespace(stdin=Line(), stdout=None, kill=lambda: None, wait=lambda: None)
    monkeypatch.setattr(rig.subprocess, "Popen", lambda *_, **__: board)
    monkeypatch.setattr(rig.targets, "build", lambda *_: None)
    monkeypatch.setattr(rig.targets, "command", lambda *_: [])
    monkeypatch.setattr(rig.Rig, "_receive", lambda self: (0, 0, np.zeros(1)))
    plan = Plan(idle)
    made = dict.fromkeys((*plan.files, *targets.BOARD_FILES), "")
    own = rig.Rig(plan, made, "cortex-m7", {})
    assert own._answer == 9 + 8
    assert board.stdin.sent[0][1:-2] == bytes(8)
    own.close()


SAID = """y and z, some words
signal     absolute   relative   limit
y          1e-3       2.5e-9     1e-9 (of least and greatest)
z          2e-3       1.5e-9     1e-8
17 ticks replayed, all is well
instructions per step: mean 123.5, most 456; bytes of stack: at most 789
behind
"""


def boarded(monkeypatch, printed: str, told: str = "", code: int = 0) -> Any:
    plan = Plan(sums)
    made = {name: f"text of {name}" for name in (*plan.files, "test_sums.c", "x.c",
                                                 *targets.BOARD_FILES)}  # fmt: skip
    made["vectors.txt"] = "3 text 4\n1.5 -2\n0.1\n"
    seen: list[Any] = []

    def build(*given: Any) -> None:
        folder = given[1]
        seen.append((given, {p.name: p.read_bytes() for p in folder.iterdir()}))

    monkeypatch.setattr(targets, "build", build)
    monkeypatch.setattr(targets, "command", lambda target, program: ["qemu", target, program])
    asked = answering(monkeypatch, targets, lambda words, folder: (code, printed, told))
    return seen, asked, lambda: targets.replayed_on("cortex-m7", plan, made)


@pytest.mark.parametrize("code", [0, 1])
def test_a_replay_on_a_board_tells_each_signal_and_what_it_counted(monkeypatch, code) -> None:
    seen, asked, replay = boarded(monkeypatch, SAID, code=code)
    found = replay()
    ((target, _, sources, program, real), texts) = seen[0]
    assert (target, sources, program, real) == (
        "cortex-m7", ["sums.c", "test_sums.c"], "test.elf", "double")  # fmt: skip
    assert sorted(texts) == sorted(
        [*Plan(sums).files, "test_sums.c", *targets.BOARD_FILES, "vectors.bin"])  # fmt: skip
    assert texts["vectors.bin"] == b"3 binary 4\n" + struct.pack("<3d", 1.5, -2, 0.1)
    assert asked == [["qemu", "cortex-m7", "test.elf", "-serial", "none", *targets.COUNT]]
    assert found.pop("emulator").startswith(f"{targets.EMULATOR} -M {targets.BOARDS['cortex-m7']}")
    assert found == {
        "signals": {"y": 2.5e-9, "z": 1.5e-9}, "own_test": "17 ticks replayed, all is well",
        "ticks": 17, "instructions": {"mean": 123.5, "most": 456}, "stack_used": 789,
        "passed": code == 0,
    }  # fmt: skip


@pytest.mark.parametrize(("printed", "told", "last"), [
    ("one\ntwo\n\n", "err", "two"), ("\n", "first\nlast\n", "last"), ("", "", "nothing"),
])  # fmt: skip
def test_a_replay_that_stops_tells_the_last_line(monkeypatch, printed, told, last) -> None:
    *_, replay = boarded(monkeypatch, printed, told, 1)
    with pytest.raises(RunFailed, match=rf"sums on cortex-m7.*: {last}$"):
        replay()


def test_a_replay_without_end_is_ended(monkeypatch) -> None:
    def never(call: Any, folder: Any, timeout: float, stdin: Any) -> None:
        assert (timeout, stdin) == (targets.WAIT, subprocess.DEVNULL)
        raise subprocess.TimeoutExpired("qemu", timeout)

    monkeypatch.setattr(targets, "run_program", never)
    with pytest.raises(RunFailed, match="qemu"):
        targets.run(["qemu"], Path())


@pytest.mark.parametrize(("said", "there"), [("/lib/libm.a\n", True), ("libm.a\n", False)])
def test_a_compiler_without_its_library_is_none(monkeypatch, said, there) -> None:
    """gcc tells the bare name of a library that it has not."""
    monkeypatch.setattr(targets, "find_program", lambda name, *_: f"/bin/{name}")
    asked = answering(monkeypatch, targets, lambda words, folder: (0, said, ""))
    if there:
        assert targets.tool("cortex-m4") == f"/bin/{targets.COMPILER}"
        assert asked == [[f"/bin/{targets.COMPILER}", "-print-file-name=libm.a"]]
    else:
        with pytest.raises(BadInput, match="cortex-m4"):
            targets.tool("cortex-m4")


# ---- FMUs ----------------------------------------------------------------------------------------

BOTH = Platform("linux64", "/a/gcc", {2: "linux64", 3: "x86_64-linux"}, ".so", ("-fPIC",), ("-s",))
NEW = Platform("aarch64-linux", "/b/gcc", {3: "aarch64-linux"}, ".so", ("-flag",))


@pytest.mark.parametrize("platforms", [(), (BOTH, NEW)])
def test_an_fmu_has_its_sources_its_pages_and_a_binary_for_each_platform(
    monkeypatch, platforms
) -> None:
    """The module is compiled once for each, whatever the version."""
    compiled_: list[Any] = []
    linked: list[Any] = []

    def compile_object(compiler: str, source: Path, to: Path, *flags: str) -> None:
        compiled_.append((compiler, source.name, flags))
        to.write_text(f"{compiler} {source.read_text()}")

    def link(compiler: str, objects: list[Path], to: Path, *flags: str) -> None:
        linked.append((compiler, [o.name for o in objects], to.name, flags))
        to.write_text(" + ".join(o.read_text() for o in objects))

    monkeypatch.setattr(fmu.cc, "compile_object", compile_object)
    monkeypatch.setattr(fmu.cc, "link", link)
    plan = Plan(sums)
    made = {f: f"text of {f}" for f in (*plan.files, "other.c")}
    found = fmu.fmus(plan, made, "0123abcd", platforms)
    assert list(found) == ["sums_fmi2.fmu", "sums_fmi3.fmu"]
    tokens = []
    for version, name in zip((2, 3), found, strict=True):
        with zipfile.ZipFile(io.BytesIO(found[name])) as archive:
            files = {n: archive.read(n).decode() for n in archive.namelist()}
        own = {n: files.pop(f"sources/{n}") for n in plan.files}
        assert own == {n: made[n] for n in plan.files}
        source = files.pop(f"sources/fmi{version}.c")
        assert "0123abcd" in source
        token = re.search(r"\{[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", source)
        assert token is not None
        tokens.append(token[0])
        assert token[0] in files.pop("modelDescription.xml")
        assert files.pop("documentation/index.html") == fmu_xml.page(plan)
        place = "LICENSE" if version == 2 else "licenses/license.txt"
        assert files.pop(f"documentation/{place}") == licence(plan)
        if version == 3:
            assert "sums" in files.pop("sources/buildDescription.xml")
        binaries = {}
        for p in platforms:
            if version in p.folders:
                binaries[f"binaries/{p.folders[version]}/sums.so"] = (
                    f"{p.compiler} text of sums.c + {p.compiler} {source}")  # fmt: skip
        assert files == binaries
    assert len(set(tokens)) == 2
    assert fmu.fmus(plan, made, "0123abcd", platforms) == found
    other = fmu.fmus(plan, made | {"sums.h": "changed"}, "0123abcd", ())
    assert tokens[0].encode() not in zipfile.ZipFile(
        io.BytesIO(other["sums_fmi2.fmu"])).read("modelDescription.xml")  # fmt: skip
    if platforms:
        more = "-Wno-unused-parameter"
        assert compiled_[:5] == [
            ("/a/gcc", "sums.c", ("-fPIC", more)), ("/a/gcc", "fmi2.c", ("-fPIC", more)),
            ("/a/gcc", "fmi3.c", ("-fPIC", more)),
            ("/b/gcc", "sums.c", ("-flag", more)), ("/b/gcc", "fmi3.c", ("-flag", more)),
        ]  # fmt: skip
        assert linked[:3] == [
            ("/a/gcc", ["sums.o", "fmi2.o"], "sums.so", ("-shared", "-s")),
            ("/a/gcc", ["sums.o", "fmi3.o"], "sums.so", ("-shared", "-s")),
            ("/b/gcc", ["sums.o", "fmi3.o"], "sums.so", ("-shared",)),
        ]  # fmt: skip


# ---- other programs ------------------------------------------------------------------------------


def test_functions_that_libraries_round_otherwise_are_found_by_their_calls() -> None:
    text = "y = exp(x) + sqrt(x) + my_log(x) + expm1 (x) + sin(fabs(x)) + cos * pow(x, 2);"
    assert float_error.inexact(text) == ["exp", "pow", "sin"]
    assert not {"fma", "floor", "sqrt", "fabs"} & set(float_error.INEXACT)


def test_the_first_cpp_compiler_that_is_there_is_taken(monkeypatch) -> None:
    for there, wanted in (({"g++", "clang++", "c++"}, "g++"), ({"clang++", "c++"}, "clang++"),
                          ({"c++"}, "c++"), (set(), None)):  # fmt: skip
        float_error.compiler.cache_clear()
        monkeypatch.setattr(
            float_error.shutil,
            "which",
            lambda name, there=there: f"/bin/{name}" if name in there else None,
        )
        assert float_error.has_cpp_compiler() == (wanted is not None)
        if wanted:
            assert float_error.compiler() == f"/bin/{wanted}"
    float_error.compiler.cache_clear()


@pytest.mark.parametrize("real", ["double", "float"])
def test_roundings_that_the_compiler_refuses_are_told_with_its_first_error(
    tmp_path: Path, monkeypatch, real
) -> None:
    """In double functions of the library are moved, in float each operation."""
    monkeypatch.setattr(float_error, "compiler", lambda: "/bin/g++")
    asked = answering(monkeypatch, float_error, lambda words, folder: (
        1, "", "note\nx.c:1: error: first\nerror: second"))  # fmt: skip
    plan = Plan(sums, "sums", 0.5, real)
    made = {name: f"/* {name} */" for name in plan.files}
    with pytest.raises(RunFailed, match=r"sums .*: x.c:1: error: first$"):
        float_error.trials(plan, made, ROWS, {}, tmp_path)
    assert asked[0][0] == "/bin/g++"
    assert asked[0][-3:] == ["-o", str(tmp_path / "sums.so"), "rounded.cpp"]
    text = (tmp_path / "rounded.cpp").read_text()
    assert '#include "sums.c"' in text
    assert ("#define exp(...) rounding_beside(exp(__VA_ARGS__))" in text) == (real == "double")
    assert {f"{m}" for m in re.findall(r"#define (\w+)\(\.\.\.\) rounding_beside", text)} == (
        set(float_error.INEXACT) if real == "double" else set())  # fmt: skip
    assert (tmp_path / "sums.c").read_text() == "/* sums.c */"


def test_the_first_error_of_a_compiler_is_told() -> None:
    assert programs.first_error("note\na: error: one\nb: error: two\n") == "a: error: one"
    assert programs.first_error("note\nwarning\n") == programs.first_error("") == "no message"


@pytest.mark.parametrize("code", [0, 1])
def test_a_clang_without_a_fuzzer_is_none(monkeypatch, code) -> None:
    monkeypatch.setattr(fuzz, "find_program", lambda name, *_: f"/bin/{name}")
    seen: list[str] = []

    def answer(words: list[str], folder: Path) -> tuple[int, str, str]:
        seen.append((folder / "trial.c").read_text())
        return code, "", ""

    asked = answering(monkeypatch, fuzz, answer)
    if code:
        with pytest.raises(BadInput, match="clang"):
            fuzz.tool()
    else:
        assert fuzz.tool() == "/bin/clang"
    assert asked == [["/bin/clang", *fuzz.FLAGS, "trial.c", "-o", "trial"]]
    assert "LLVMFuzzerTestOneInput" in seen[0]


@pytest.mark.parametrize(("code", "told", "said", "sound"), [
    (0, "", "address, undefined: nothing found", True),
    (1, "noise", "address, undefined: nothing found", True),  # its own test fails, no more
    (77, "", "stopped with 77", False), (-11, "", "stopped with -11", False),
    (0, "a.c:1: runtime error: shift\nmore", "runtime error: shift", False),
    (1, "==9==ERROR: AddressSanitizer: heap-use on", "ERROR: AddressSanitizer: heap-use", False),
])  # fmt: skip
def test_what_a_sanitizer_sees_is_told(monkeypatch, tmp_path, code, told, said, sound) -> None:
    plan = SimpleNamespace(name="m")

    def answer(words: list[str], folder: Path) -> tuple[int, str, str]:
        return (code, "", told) if words[-1] == "vectors.txt" else (0, "", "runtime error: no")

    asked = answering(monkeypatch, isolation, answer)
    assert isolation.run_sanitizers(plan, tmp_path, "gcc") == (said, sound)  # type: ignore[arg-type]
    assert asked[1] == [str(tmp_path / "sanitized_m"), "vectors.txt"]
    answering(monkeypatch, isolation, lambda words, folder: (1, "", ""))
    said_, passed = isolation.run_sanitizers(plan, tmp_path, "/a/own-cc")  # type: ignore[arg-type]
    assert passed
    assert "own-cc has no sanitizers" in said_


def test_a_compiler_that_tells_no_stack_is_asked_again_without(tmp_path, monkeypatch) -> None:
    calls: list[Any] = []

    def compile_object(compiler: str, source: Path, to: Path, *flags: str) -> None:
        calls.append((compiler, source.name, to.name, flags))
        if compilers.TOLD in flags:
            raise RunFailed("no such flag")

    monkeypatch.setattr(module, "compile_object", compile_object)
    monkeypatch.setattr(module, "link", lambda *given: calls.append(given))
    (tmp_path / "sums.c").write_text("")
    made = module.CModule(tmp_path, Plan(sums)).compile("/a/cc")
    include = f"-I{tmp_path.resolve()}"
    assert calls[:3] == [
        ("/a/cc", "sums.c", "sums.o", ("-fPIC", compilers.TOLD)),
        ("/a/cc", "sums.c", "sums.o", ("-fPIC",)),
        ("/a/cc", "bind.c", "bind.o", ("-fPIC", include)),
    ]  # fmt: skip
    scratch = made.object_file.parent
    objects = [scratch / "sums.o", scratch / "bind.o"]
    assert calls[3] == ("/a/cc", objects, scratch / "sums.so", "-shared")


def test_only_cc_is_taken_where_no_other_compiler_is(monkeypatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    for there, wanted in (({"gcc", "clang", "cc"}, ("/bin/gcc", "/bin/clang")),
                          ({"clang", "cc"}, ("/bin/clang",)), ({"cc"}, ("/bin/cc",))):  # fmt: skip
        compilers.compilers.cache_clear()
        monkeypatch.setattr(
            compilers.shutil,
            "which",
            lambda name, there=there: f"/bin/{name}" if name in there else None,
        )
        assert compilers.compilers() == wanted
    monkeypatch.setenv("CC", "cc")
    compilers.compilers.cache_clear()
    assert compilers.compilers() == ("/bin/cc",)
    compilers.compilers.cache_clear()


def test_what_is_prepared_needs_a_block_in_two_parts_and_an_input_may_be_left_out(tmp_path) -> None:
    made = module.CModule(tmp_path, Plan(sums))
    with pytest.raises(BadInput):
        made.prepare(u=1.0)
    called: list[Any] = []
    made.block = SimpleNamespace(
        composition=SimpleNamespace(split="yes"), inputs={"u": 1, "n": 2, "w": 3})  # fmt: skip
    made._in, made._param, made._state = np.zeros(4), "param", "state"
    made._row = lambda inputs: called.append(inputs) or [1.0, 2.0, 3.0, 4.0]  # type: ignore[method-assign]
    made._call = lambda *given: called.append(given) or 7  # type: ignore[method-assign]
    assert made.prepare(n=2.0) == 7
    assert made.status == 7
    assert called == [{"u": 0.0, "n": 2.0, "w": 0.0}, ("prepare", made._in, "param", "state")]
    assert made._in.tolist() == [1, 2, 3, 4]


# ---- proofs --------------------------------------------------------------------------------------


def test_a_state_of_a_part_is_a_member_of_its_struct_in_a_harness() -> None:
    places = {"ctl_x": "ctl.x", "ctl_xy": "ctl.xy", "own": "own"}
    plan = SimpleNamespace(layout=SimpleNamespace(places=places))
    text = "state.kept.ctl_x next->ctl_xy next.ctl_x kept.own in.ctl_x my_next->ctl_x kept.ctl_xyz"
    assert module_proof.with_structs(plan, text) == (  # type: ignore[arg-type]
        "state.kept.ctl.x next->ctl.xy next.ctl.x kept.own in.ctl_x my_next->ctl_x kept.ctl_xyz"
    )
    plain = SimpleNamespace(layout=SimpleNamespace(places={"own": "own"}))
    assert module_proof.with_structs(plain, text) == text  # type: ignore[arg-type]


def test_a_proof_takes_the_contracts_of_the_text_that_a_module_has(monkeypatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(module_proof, "written_out", lambda text: f"out {text}")
    monkeypatch.setattr(
        module_proof.kernel_proof,
        "text_with_contracts",
        lambda *given: asked.append(given) or ({"b.c": "new"}, 4),
    )
    monkeypatch.setattr(
        module_proof.function_proof,
        "text_with_contracts",
        lambda *given: asked.append(given) or ({"c": "d"}, 5),
    )
    plan = SimpleNamespace(name="m", files=("m.h", "b.c", "m.c"), real="float")
    texts = {"b.c": "1", "m.c": "2"}
    plan.equations = SimpleNamespace(static=True, work=(1, 2, 30, 44), in_arrays=4, arrays=True,
                                     functions=["f"])  # fmt: skip
    assert module_proof._with_contracts(plan, texts) == ({"b.c": "new", "m.c": "out 2"}, 4)  # type: ignore[arg-type]
    assert asked.pop() == ("m", "b.c", "out 1", "float", (30, 40))
    plan.equations.static = False
    assert module_proof._with_contracts(plan, texts) == ({"c": "d"}, 5)  # type: ignore[arg-type]
    assert asked.pop() == ("m", {"b.c": "out 1", "m.c": "out 2"}, "float", ["f"])
    plan.equations.arrays = False
    assert module_proof._with_contracts(plan, texts) == ({"b.c": "out 1", "m.c": "out 2"}, 0)  # type: ignore[arg-type]
    assert asked == []


def test_a_text_without_equations_stays_as_it_is() -> None:
    text = "static int other(void)\n{\n    return 0;\n}\n"
    assert module_proof.any_results(Plan(sums), text) == text


def test_a_module_without_functions_of_its_own_has_no_contracts() -> None:
    texts = {"m.c": "int main(void)\n{\n    return 0;\n}\n"}
    assert function_proof.text_with_contracts("m", texts, "double", ["f"]) == (texts, 0)
    text = f"/* {KERNEL[0]} */\n/* {KERNEL[1]} */\nint m(void)\n{{\n    return 0;\n}}\n"
    assert kernel_proof.text_with_contracts("m", "m.c", text, "double", (0, 0)) == (
        {"m.c": text}, 0)  # fmt: skip


# ---- tables and texts ----------------------------------------------------------------------------


def test_a_table_of_vectors_that_is_none_is_refused(tmp_path: Path, monkeypatch) -> None:
    file = tmp_path / "a.csv"
    file.write_text("u,v\n\n1,2\n", encoding="utf-8-sig")
    assert vector_file._rows(file) == [["u", "v"], ["1", "2"]]
    for content, said in ((b"\xff\xfe\x00", "UTF-8"), (b"", "head"), (b" , \n1,2\n", "head"),
                          (b'"' + b"x" * 200_000 + b'"\n', "commas")):  # fmt: skip
        file.write_bytes(content)
        with pytest.raises(BadInput, match=said):
            vector_file._rows(file)
    with pytest.raises(BadInput, match="cannot read"):
        vector_file._rows(tmp_path / "gone.csv")
    file.write_text("u\n1\n")
    monkeypatch.setattr(vector_file, "LARGEST", file.stat().st_size)
    assert vector_file._rows(file) == [["u"], ["1"]]
    monkeypatch.setattr(vector_file, "LARGEST", file.stat().st_size - 1)
    with pytest.raises(BadInput, match="fewer"):
        vector_file._rows(file)


def test_a_module_without_inputs_or_parameters_has_one_number_in_their_place() -> None:
    plan = Plan(alone)
    found = sections.calibration(plan, ".calibration")
    assert ".unused = 0.0" in found["alone_calibration.c"]
    assert ".unused" not in "".join(sections.calibration(Plan(sums), ".calibration").values())
    assert fmu_xml.feedthrough(plan) == {}
    assert fmu_xml.feedthrough(Plan(sums)) == {1: [2], 2: [3]}
    board = xcp.texts(plan)
    assert list(board) == ["xcp.h", "xcp.c", "xcp_board.c"]
    assert "alone_in_instance.unused = 0;" in board["xcp_board.c"]
    own = xcp.texts(Plan(sums))["xcp_board.c"]
    assert "unused" not in own
    for value in ("sums_in_instance.u = 0.25;", "sums_in_instance.n = 2"):
        assert value in own
    assert "@" not in own.replace("@step", "")
    assert codegen.texts(plan)["alone.c"]
