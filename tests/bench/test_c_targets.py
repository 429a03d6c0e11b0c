"""The study of every controller in C: what is done again, and what the page says of it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench import c_targets
from bench.c_targets import Controller, Wanted
from slipctl.study import resolve

pytestmark = pytest.mark.second

SHORT = 0.05
needs_arm = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None, reason="no arm-none-eabi-gcc here"
)


@pytest.fixture(scope="module")
def one() -> Controller:
    (found,) = c_targets.controllers(["subway_braking:smc"])
    return replace(found, scenario=replace(found.scenario, duration=SHORT))


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the parts that were done, none of which takes time."""
    names: list[str] = []

    def instead(name: str) -> Any:
        def do(*given: Any) -> dict[str, Any]:
            names.append(f"{name} {given[1]}" if name == "checked" else name)
            return {"passed": name != "opened", "seconds": given[-1]}

        return do

    for name in ("checked", "beside_casadi", "opened", "fuzzed"):
        monkeypatch.setattr(c_targets, name, instead(name))
    return names


@pytest.mark.long
@needs_arm
def test_what_passed_for_the_same_text_and_inputs_is_not_done_again(
    one: Controller, done: list[str]
) -> None:
    row = c_targets.made(one, Wanted(fuzz=4), {})
    assert done == ["checked double", "checked float", "beside_casadi", "opened", "fuzzed"]
    done.clear()
    again = c_targets.made(one, Wanted(fuzz=2), row)
    assert done == ["opened"]  # it did not pass
    assert again | {"fmu": 0} == row | {"fmu": 0}
    done.clear()
    c_targets.made(one, Wanted(fuzz=8), row)  # longer than it was
    assert done == ["opened", "fuzzed"]


@needs_arm
def test_other_inputs_are_another_content(one: Controller) -> None:
    other = replace(one, scenario=replace(one.scenario, duration=2 * SHORT))
    same = replace(one)
    assert one.content() == same.content() != other.content()


def test_comments_and_line_breaks_are_no_content() -> None:
    text = "/* a block\n * of 2 lines */\nint f(const a *p,\n      b *s); /* one */"
    assert c_targets.bare(text) == "int f(const a *p, b *s);"


def test_every_loop_with_a_controller_has_a_row() -> None:
    found = {c.name for c in c_targets.controllers(["subway_braking", "hst_traction:hosm_limited"])}
    assert set(c_targets.REPRESENTATIVE) & found == {
        "subway_braking:sta",
        "hst_traction:hosm_limited",
    }
    study = resolve.load_study("subway_braking")
    cases = resolve.build_cases(study)
    loops = {n for case in cases for n, loop in case.loops.items() if "ctl" in loop.parts}
    assert {n.partition(":")[2] for n in found if n.startswith("subway")} == loops


def test_an_unknown_study_is_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "x.json"
    assert c_targets.main(["subway_brakin", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said == "slipctl: there is no study 'subway_brakin'; did you mean 'subway_braking'?\n"
    assert not out.exists()


@needs_arm
def test_a_failure_is_kept_as_a_result(one: Controller, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: Any) -> dict[str, Any]:
        raise c_targets.RunFailed("gcc refuses")

    monkeypatch.setattr(c_targets, "opened", refuses)
    for name in ("checked", "beside_casadi"):
        monkeypatch.setattr(c_targets, name, lambda *_: {"passed": True})
    row = c_targets.made(one, Wanted(), {})
    assert row["fmu"]["failed"] == "gcc refuses"
    assert not c_targets.passed(row)
    assert "FAILED" in c_targets.said("x", row | {"float": {"targets": {}}})
    json.dumps(row)
