"""What stands in an answer: of a controller in C, of a study that is certified."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl.commands import c
from slipctl.commands.arguments import parser
from slipctl.commands.certificates import certify
from slipctl.errors import RunFailed


@pytest.mark.parametrize(("check", "real", "failures"), [
    (True, "float", []), (True, "double", []), (False, "float", []),
    (True, "float", ["u differs", "too slow"]),
])  # fmt: skip
def test_a_loop_in_c_is_closed_on_the_processor_where_it_is_checked_in_float(
    check, real, failures, tmp_path: Path, monkeypatch, capsys
) -> None:
    """And what fails is told in the end, with the file that says more."""
    asked: dict[str, Any] = {}
    report = SimpleNamespace(data={"name": "pid"}, failures=failures)

    def export(block: Any, out: Path, name: str, **wanted: Any) -> Any:
        asked.update(wanted, block=block, out=out, name=name)
        return report

    ticks: list[Any] = []
    study = SimpleNamespace(name="toy", controller="ctl")
    request = SimpleNamespace(
        home="toy.py", needs_loop=lambda: None, part="", loop="pid", study=study, settings=(),
        chosen=("LOOP", SimpleNamespace(scenario="dry")),
    )  # fmt: skip
    monkeypatch.setattr(c.Request, "read", lambda name, settings: request)
    monkeypatch.setattr(c.trip_files, "is_trip", lambda name: False)
    monkeypatch.setattr(c.build, "compiler", lambda: "cc")
    monkeypatch.setattr(
        c, "runs_of_part", lambda loop, part: SimpleNamespace(block=(loop, part), period=0.25)
    )
    monkeypatch.setattr(c.codegen, "export", export)
    monkeypatch.setattr(c.codegen, "record_part", lambda *given: ticks.append(given) or ("IN", "P"))
    monkeypatch.setattr(c.processor, "closed_loop", lambda request, part: (request, part))
    words = ["c", "toy.py:pid", "--out", str(tmp_path / "c"), "--real", real]
    options = parser().parse_args([*words, *(["--check"] if check else [])])
    if failures:
        with pytest.raises(RunFailed, match="u differs; too slow; see") as told:
            c.answer(options, "")
        assert str(told.value).endswith(str(tmp_path / "c" / c.codegen.READABLE))
    else:
        assert c.answer(options, "") == 0
    closed = check and real == "float"
    assert asked.get("closed_loop") == ((request, "ctl") if closed else None)
    assert (asked["block"], asked["out"]) == (("LOOP", "ctl"), tmp_path / "c")
    assert (asked["name"], asked["period"]) == ("toy_pid", 0.25)
    assert (asked["inputs"], asked["params"]) == ("IN", "P")
    assert ticks == [("LOOP", "ctl", "dry", None if check else c.codegen.KEPT)]
    assert "namespace" in capsys.readouterr().out


def answered(name: str, **more: Any) -> Any:
    """What one controller of a study is worth."""
    gains = SimpleNamespace(name=name, loop=f"{name}_loop", condition="cone", bounds="")
    criteria = {"cone": SimpleNamespace(unit_dependent=False)}
    report = SimpleNamespace(gains={"k": 2.0, "L": 0.0, "W": 0.0, "q": 0.0}, criteria=criteria,
                             units={"k": "1/s", "L": "m", "W": "1", "q": "1"})  # fmt: skip
    made = dict(gains=gains, report=report, condition=None, needs=f"needs {name}", costs={})
    return SimpleNamespace(**made | more)


def test_a_study_is_certified_controller_by_controller(monkeypatch) -> None:
    first = answered("sta", condition=True, costs={"mass": 0.75, "speed": 0.25, "wear": 0.5})
    first.gains.bounds = "of the rail"
    second = answered("smc", condition=False)
    second.report.criteria["cone"].unit_dependent = True
    third = answered("pid")
    study = SimpleNamespace(
        name="toy", title="A toy",
        certificates=SimpleNamespace(uncertified={"fuzzy": "it has no model"}),
    )  # fmt: skip
    monkeypatch.setattr(certify.resolve, "load_study", lambda name: study)
    monkeypatch.setattr(certify, "promise_lines", lambda report: ["  promised"])
    found = [first, second, third]
    monkeypatch.setattr(certify, "answers", lambda study, of, settings: found)
    said = certify.certify_study("toy", False, "").split("\n")
    head = said.index("")
    assert said[:head] == ["toy: A toy"]
    told = "\n".join(said).split("\n\n")
    assert len(told) == 6
    assert "the bound that remains when a range is halved: speed 25%, wear 50%, mass 75%" in told[1]
    assert "  bounds: of the rail\n" in told[1]
    assert [" halved: " in t for t in told] == [False, True, False, False, False, False]
    assert "the paper's own condition, cone, holds" in told[1]
    assert "the paper's own condition, cone*, is violated" in told[2]
    assert "condition" not in told[3]
    for text, name in zip(told[1:4], ("sta", "smc", "pid"), strict=True):
        rows = text.split("\n")
        assert rows[0].startswith(f"{name} (loop {name}_loop), ")
        assert rows[1] == "  k = 2 1/s, L = 0 m, W = 0"
        assert f"  needs {name}" in rows
    assert told[4] == "fuzzy: no certificate, it has no model"
    assert told[5] == "* the verdict of this condition depends on the unit of length"
    second.condition = None
    assert "depends on the unit" not in certify.certify_study("toy", False, "")


def test_a_loop_of_a_study_is_certified_into_a_file_or_told_as_data(monkeypatch) -> None:
    """With what was set; the file holds the exact numbers of its one certificate."""
    only = answered("sta", costs={"mass": 0.5}, system="SYSTEM", numbers={"k": 2.0})
    only.report.payload = lambda: {"verdict": "CERTIFIED"}
    study = SimpleNamespace(name="toy", title="A toy", certificates=None)
    done: list[Any] = []
    monkeypatch.setattr(certify.certify_loop, "is_loop", lambda name: True)
    monkeypatch.setattr(certify.certify_loop, "find", lambda name: (study, ["all", "of it"]))
    monkeypatch.setattr(certify.certify_loop, "one", lambda *given: (("one", *given), "other"))
    monkeypatch.setattr(certify, "check_place", lambda out: done.append(("place", out)))
    monkeypatch.setattr(certify, "answers", lambda *given: done.append(given) or [only])
    monkeypatch.setattr(certify.systems, "exact_numbers", lambda *given: ("exact", *given))
    monkeypatch.setattr(certify, "write", lambda *given: done.append(given))
    monkeypatch.setattr(certify, "promise_lines", lambda report: ["promised"])
    monkeypatch.setattr(certify, "loop_verdict", lambda found: f"verdict of {len(found)}")
    said = certify.certify_study("toy:a", False, "CMD", "c.json", ("k=2",))
    assert done == [
        ("place", "c.json"), (study, [("one", "toy:a", ("k=2",))], ("k=2",)),
        ("SYSTEM", ("exact", "SYSTEM", {"k": 2.0}), "c.json"),
    ]  # fmt: skip
    rows = said.split("\n")
    assert rows[1].startswith("with ")
    assert "k=2" in rows[1]
    assert rows[-2:] == ["", "c.json: certificate; slipctl check c.json"]
    done.clear()
    told = json.loads(certify.certify_study("toy:a", True, "CMD", None, ("k=2", "q=1")))
    assert done == [(study, ["all", "of it"], ("k=2", "q=1"))]
    assert (told["study"], told["loop"], told["verdict"]) == ("toy", "a", "verdict of 1")
    assert (told["set"], told["command"]) == (["k=2", "q=1"], "CMD")
    assert told["gains"] == {"sta": {
        "loop": "sta_loop", "condition": "cone", "condition_holds": None, "needs": "needs sta",
        "bounds": "", "left_of_the_bound_with_half_a_range": {"mass": 0.5},
        "verdict": "CERTIFIED",
    }}  # fmt: skip
    only.gains.condition = ""
    plain = json.loads(certify.certify_study("toy:a", True, "CMD"))
    assert plain["gains"]["sta"]["condition"] is None
    assert "set" not in plain


def finding(verdict: str, holds: bool, **margins: float | None) -> Any:
    return SimpleNamespace(verdict=verdict, holds=holds, margins=margins)


def test_what_is_needed_is_the_limit_that_fails_or_the_nearest_one(monkeypatch) -> None:
    """Of criteria that refute before those that prove; of what is proved the nearest by ratio."""
    kinds = {n: SimpleNamespace(refutes=n == "hard", proves=n != "other")
             for n in ("hard", "soft", "other")}  # fmt: skip
    monkeypatch.setattr(certify.catalogue, "SYSTEMS", {"toy": SimpleNamespace(criteria=kinds)})
    monkeypatch.setattr(certify.catalogue, "OF_LOOPS", {})
    gains = {"k": 2.0, "L": 3.0, "T": 0.0}

    def asked(verdict: str, **criteria: Any) -> str:
        return certify.needs(SimpleNamespace(  # type: ignore[arg-type]
            system="toy", verdict=verdict, criteria=criteria, gains=gains))  # fmt: skip

    never = {"largest_k": math.inf, "smallest_L": None}
    far = finding("CERTIFIED", True, largest_k=5.0, smallest_L=1.0, largest_T=9.0)
    near = finding("CERTIFIED", True, smallest_k=1.25, largest_L=4.5)
    open_ = finding("UNDECIDED", False, largest_k=2.01)
    assert asked("CERTIFIED", soft=far, other=near, hard=open_) == (
        "nearest limit other: L <= 4.5 (is 3)")  # fmt: skip
    assert asked("CERTIFIED", soft=far) == "nearest limit soft: k <= 5 (is 2)"
    assert asked("CERTIFIED", soft=finding("CERTIFIED", True, **never)) == "no limit near"
    fails = finding("UNDECIDED", False, smallest_k=4.0, largest_L=2.5)
    assert (
        asked("REFUTED", hard=fails, soft=open_) == "needs hard: k >= 4 (is 2) or L <= 2.5 (is 3)"
    )
    assert asked("UNDECIDED", soft=fails, other=open_, hard=near) == (
        "needs soft: k >= 4 (is 2) or L <= 2.5 (is 3)")  # fmt: skip
    assert asked("UNDECIDED", soft=finding("UNDECIDED", False, **never)) == (
        "needs soft: no such number")  # fmt: skip
    assert asked("UNDECIDED", other=open_) == "no limit of a gain decides it here"
