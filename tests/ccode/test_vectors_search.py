"""Inputs that reach what a module's own test does not, ``slipctl c --vectors search``."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from casadi import fmin, if_else, logic_and

from slipctl import BadInput, Input, Output, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import comparison
from slipctl.ccode.check.coverage import COUNTER, REACHABLE, share
from slipctl.ccode.check.vectors import search
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.commands import c as command
from slipctl.commands.cli import main

try:
    compilers.compilers()
except BadInput:
    pytest.skip("no C compiler on this machine", allow_module_level=True)


@step(y=Output("1", "open or not", lo=0, hi=3), period=0.01)
def lock(
    held=State("1", 0.0, "ticks that the dial was right", lo=0, hi=100),
    door=State("1", 0.0, "open", lo=0, hi=1),
    dial=Input("1", "dial", lo=0, hi=1, value=0.0),
    key=Input("1", "key", lo=-5, hi=5, value=0.0, change=0.5),
):
    """A lock: the dial right for 20 ticks, then the key within 0.4 % of its range."""
    right = logic_and(dial > 0.5, dial < 0.53)
    turned = logic_and(held > 20, logic_and(key > 2, key < 2.04))
    after = dict(held=if_else(right, fmin(held + 1, 99), 0), door=if_else(turned, 1, 0.95 * door))
    return after, dict(y=if_else(door > 0.1, if_else(dial > 0.9, 3, 1), 0))


@step(y=Output("1", "number", lo=0, hi=100), period=0.01)
def clock(n=State("1", 0.0, "ticks", lo=0, hi=1e6)):
    """Nothing is fed to it."""
    return dict(n=fmin(n + 1, 50)), dict(y=n)


def found(seconds: int, seed: int = 1) -> tuple[Plan, np.ndarray, dict]:
    """What a search finds behind the made-up inputs of the lock."""
    plan = Plan(lock)
    run, _ = comparison.made_up(plan, {})
    return plan, *search.find_vectors(plan, codegen.texts(plan), run.rows, {}, seconds, seed)


@pytest.mark.long
def test_it_opens_a_lock_that_the_own_test_does_not(tmp_path: Path) -> None:
    """Ways are found that wandering inputs do not take; Python and C agree on them."""
    before = codegen.export(lock, tmp_path / "before", check=True).data
    after = codegen.export(lock, tmp_path / "after", check=True, search_seconds=5).data
    assert before["passed"]
    assert after["passed"]
    assert after["search"]["new"] >= 4
    assert after["ticks"] == before["ticks"] + after["search"]["ticks"]
    assert after["search"]["ticks"] <= search.MOST
    if COUNTER in after["coverage"].get("by", ""):
        assert share(after["coverage"], REACHABLE) > share(before["coverage"], REACHABLE)
        lost = [m for m in before["coverage"]["missing"] if m["function"] == "lock"]
        left = [m for m in after["coverage"]["missing"] if m["function"] == "lock"]
        assert lost
        assert not left
    assert "search:" in str((tmp_path / "after" / "report.md").read_text(encoding="utf-8")).lower()


@pytest.mark.second
@pytest.mark.long
def test_inputs_stay_in_their_ranges_and_the_same_search_finds_the_same() -> None:
    """Ends and largest changes hold, from the last recorded tick on; a seed decides all."""
    plan, rows, told = found(2)
    lo, hi, change, _ = plan.ends(plan.layout.inputs, plan.block.param_values())
    last = comparison.made_up(plan, {})[0].rows[-1:]
    assert told["ticks"] == len(rows) > 0
    assert ((rows >= lo) & (rows <= hi)).all()
    assert (np.abs(np.diff(np.vstack([last, rows]), axis=0)) <= change).all()
    assert np.array_equal(found(2)[1], rows)
    assert not np.array_equal(found(2, seed=2)[1], rows)


@step(y=Output("1", "number", lo=-10, hi=10), period=0.01)
def gears(
    v=Input("m/s", "speed", lo=0, hi=9, value=0.0),
    gear=Input("enum", "gear", values=("none", "first", "second"), value="none"),
    count=Input("int", "teeth", lo=1, hi=7, value=3),
):
    """Choices and whole numbers beside a speed."""
    return {}, dict(y=if_else(gear > 1.5, if_else(count > 6.5, if_else(v > 8.9, 2, 1), 0), -1))


@pytest.mark.second
def test_choices_and_whole_numbers_stay_what_they_are() -> None:
    """A gear and a number of teeth have no fraction; a speed has."""
    plan = Plan(gears)
    rows = np.array([[0.0, 0.0, 3.0]])
    found, told = search.find_vectors(plan, codegen.texts(plan), rows, {}, 2)
    v, gear, count = np.vstack([rows, found]).T
    assert set(gear) <= {0.0, 1.0, 2.0}
    assert set(count) <= set(range(1, 8))
    assert told["pieces"] > 0
    assert np.all((v >= 0) & (v <= 9))


def test_it_is_asked_for_in_words(tmp_path: Path) -> None:
    """``search`` and ``search:SECONDS``; all else names a file."""
    assert search.effort("search") == search.SECONDS
    assert search.effort("search:3") == 3
    assert search.effort("mine.csv") is None
    assert search.effort("./search") is None
    for wrong in ("search:", "search:0", "search:-1", "search:2.5", "search:1e3"):
        with pytest.raises(BadInput, match="gives the search no time"):
            search.effort(wrong)


@pytest.mark.second
def test_a_folder_in_float_is_tested_with_what_was_found(tmp_path: Path) -> None:
    """Without ``--check`` too: the vectors have the ticks, and ``make test`` passes."""
    out = tmp_path / "c"
    call = ["c", "subway_braking:smc", "--real", "float", "--vectors", "search:1"]
    assert main([*call, "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    *_, ticks, _ = (out / "vectors.txt").read_text(encoding="utf-8").split("\n", 1)[0].split()
    assert report["search"]["pieces"] > 0
    assert int(ticks) == report["ticks"]
    done = subprocess.run(["make", "test"], cwd=out, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_what_cannot_be_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No inputs, no time, no compiler: one line, before anything is written."""
    with pytest.raises(BadInput, match="has no inputs to search"):
        codegen.export(clock, tmp_path / "c", search_seconds=1)
    call = ["c", "subway_braking:smc", "--out", str(tmp_path / "c"), "--vectors"]
    assert main([*call, "search:0"]) == 2
    monkeypatch.setattr(command.build, "compiler", lambda: None)
    assert main([*call, "search"]) == 2
    said = capsys.readouterr().err
    assert "gives the search no time" in said
    assert "--vectors search needs a C compiler" in said
    assert not (tmp_path / "c").exists()
