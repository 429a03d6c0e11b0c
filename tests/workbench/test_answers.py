"""What each question of a page is answered with, piece by piece, and what is asked for it.

What computes is put in its place by what tells how it was asked; processes are none.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from workbench_frames import answered, read

from slipctl import (
    BadInput,
    Ensemble,
    Input,
    Output,
    Param,
    Rail,
    RunFailed,
    Scenario,
    Section,
    Signals,
    State,
    connect,
    law,
    step,
)
from slipctl.run import store
from slipctl.run.metrics import Metric
from slipctl.run.sweep import spread
from slipctl.workbench import (
    answers,
    c_texts,
    command_lines,
    curves,
    effects,
    findings,
    laws,
    safety,
    saved_files,
    texts,
)
from slipctl.workbench.answers import Answers
from slipctl.workbench.desk import Desk, Rig
from slipctl.workbench.sliders import Slider, ends_of_slider, sliders_of_loop
from slipctl.workbench.sources import openings
from slipctl.workbench.sources.opened_logs import LogAnswers
from slipctl.workbench.web import windows, worker
from slipctl.workbench.web.windows import Worker


def slider(name: str, value: float = 1.0, unit: str = "1", group: str = "law", **ends) -> Slider:
    given = {"lo": None, "hi": None, "left": 0.0, "right": 9.0} | ends
    return Slider(name, value, unit, by_ratio=False, doc="", source="", group=group, **given)


GAIN, MASS = slider("ctl.law.k"), slider("m", 2.0, "kg", "vehicle and rail")
SAID = {"answers": "of a stand-in"}


class Desktop:
    """A desk with one loop, whose rig is a stand-in."""

    home, text, loop, scenario = "metro.toml", "a = 1\n", "pid", "wet"

    def __init__(self, folder: Path = Path("/folder")) -> None:
        self.folder = folder
        self.asked: list[Any] = []
        self.the_rig = SimpleNamespace(
            name="pid", sliders=[GAIN, MASS, slider("ctl.T", group="controller")],
            gains_by_name=lambda name: SimpleNamespace(name=f"gains {name!r}"),
            study=SimpleNamespace(name="my-study", controller="ctl", limits={"distance": 9.0}),
            case=SimpleNamespace(scenario=SimpleNamespace(name="wet")),
        )  # fmt: skip
        self.the_rig.wait = lambda: self.asked.append("wait") or self.the_rig

    def rig(self, *given: Any) -> Any:
        self.asked.append(given)
        return self.the_rig

    def saved(self) -> str:
        return self.text

    def within(self, name: str, suffix: str) -> Path:
        assert suffix == ""
        return self.folder / name


@pytest.fixture
def desk() -> Desktop:
    return Desktop()


def heads(desk: Any, **request: Any) -> list[dict[str, Any]]:
    """Heads of all frames, without what each has of its question."""
    found = [head for head, _ in answered(Answers(desk), **request)]
    for head in found:
        assert (head.pop("kind"), head.pop("id")) == (request["kind"], 1)
    return found


def told(monkeypatch, where: Any, name: str, answer: Any) -> list[tuple[Any, ...]]:
    """What a function is given that answers so."""
    given: list[tuple[Any, ...]] = []

    def stand_in(*values: Any, **named: Any) -> Any:
        given.append((*values, named) if named else values)
        return answer

    monkeypatch.setattr(where, name, stand_in)
    return given


# ---- questions -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "where", "name", "key"), [
    ("verdict", safety, "verdict_of_gains", "verdict"),
])  # fmt: skip
def test_a_verdict_is_asked_of_the_gains_of_that_name(
    desk, monkeypatch, kind, where, name, key
) -> None:
    given = told(monkeypatch, where, name, SAID)
    found = heads(desk, kind=kind, name="sta", numbers={"m": 3}, loop="pid", scenario="dry")
    assert found == [{"end": True, key: SAID}]
    ((rig, gains, numbers),) = given
    assert (rig, gains.name, numbers) == (desk.the_rig, "gains 'sta'", {"m": 3.0})
    assert desk.asked == [("a = 1\n", "pid", "dry")]
    heads(desk, kind=kind)
    assert (given[1][1].name, given[1][2]) == ("gains ''", {})
    assert desk.asked[1] == ("a = 1\n", None, None)


@pytest.mark.parametrize(("axes", "pair"), [
    (["k", "m"], ("k", "m")), (["k"], None), (["k", "m", "c"], None), ("km", None), (None, None),
    ([1, 2], ("1", "2")),
])  # fmt: skip
def test_a_region_is_told_row_by_row_and_a_newer_question_may_come_between(
    desk, monkeypatch, axes, pair
) -> None:
    given = told(monkeypatch, safety, "region_rows", [{"x": [1]}, {}, {}, {"row": 0}])
    parts = list(Answers(desk).begin({"kind": "region", "id": 1, "name": "a", "axes": axes}))
    assert [read(p)[0].get("region") if p else "nothing" for p in parts] == [
        {"x": [1]}, "nothing", "nothing", {"row": 0}, None,
    ]  # fmt: skip
    assert read(parts[-1])[0] == {"kind": "region", "id": 1, "end": True}
    ((rig, gains, numbers, names),) = given
    assert (rig, gains.name, numbers, names) == (desk.the_rig, "gains 'a'", {}, pair)
    heads(desk, kind="region", numbers={"m": 3})
    assert (given[1][1].name, *given[1][2:]) == ("gains ''", {"m": 3.0}, None)


def test_effects_are_those_of_the_law_and_of_what_was_moved(desk, monkeypatch) -> None:
    """Behind the compiled code; then the slopes, or why there are none."""
    rows = [{"name": "ctl.law.k", "by": 1.5}, {"name": "m", "by": 2.5}]
    given = told(monkeypatch, answers, "difference_rows", rows)
    slopes = told(monkeypatch, answers, "exact_slopes", {"distance": {"m": 2.0}})
    found = heads(desk, kind="effects", numbers={"m": 4})
    assert found == [*({"effect": r} for r in rows),
                     {"end": True, "exact": {"distance": {"m": 2.0}}}]  # fmt: skip
    assert given == [(desk.the_rig, {"m": 4.0}, [GAIN, MASS])]
    assert slopes == [(desk.the_rig, {"m": 4.0}, ["ctl.law.k", "m"])]
    assert desk.asked[1:] == ["wait"]
    heads(desk, kind="effects")
    assert given[1][2] == [GAIN]
    for error in (BadInput("a sign in it"), RunFailed("it became NaN")):

        def refused(*_: Any, error: Exception = error) -> Any:
            raise error

        monkeypatch.setattr(answers, "exact_slopes", refused)
        assert heads(desk, kind="effects")[-1] == {"end": True, "why": str(error)}
    desk.the_rig.sliders = [MASS]
    assert "the law has no gains" in heads(desk, kind="effects")[-1]["faults"][0]


def test_at_most_twelve_effects_are_asked_for(desk, monkeypatch) -> None:
    desk.the_rig.sliders = [slider(f"k{k}") for k in range(15)]
    given = told(monkeypatch, answers, "difference_rows", [])
    told(monkeypatch, answers, "exact_slopes", {})
    heads(desk, kind="effects")
    assert [s.name for s in given[0][2]] == [f"k{k}" for k in range(12)]


def test_draws_are_told_run_by_run(desk, monkeypatch) -> None:
    given = told(monkeypatch, answers, "ensemble_rows", [{"runs": 1}, {"runs": 2}])
    found = heads(desk, kind="draws", numbers={"ctl.law.k": 3})
    assert found == [{"ensemble": {"runs": 1}}, {"ensemble": {"runs": 2}}, {"end": True}]
    assert given == [(desk.the_rig, {"ctl.law.k": 3.0})]


@pytest.mark.parametrize(("asked", "target"), [
    ("cortex-m4", "cortex-m4"), ("cortex-m7", "host"), (None, "host"),
])  # fmt: skip
def test_c_is_written_for_the_target_that_is_known(desk, monkeypatch, asked, target) -> None:
    given = told(monkeypatch, c_texts, "c_of_rig", SAID)
    assert heads(desk, kind="c", target=asked, numbers={"m": 3}) == [{"end": True, "c": SAID}]
    assert given == [(desk.the_rig, {"m": 3.0}, {"target": target})]


def test_doubts_are_those_of_the_whole_run_that_is_watched(desk, monkeypatch) -> None:
    asked = []

    def pieces(numbers: Any, doubt: bool = False) -> Any:
        asked.append((numbers, doubt))
        for k in range(3):
            yield k / 2, lambda k=k: f"log {k}"

    desk.the_rig.measured = SimpleNamespace(prepared=SimpleNamespace(pieces=pieces))
    given = told(monkeypatch, answers, "warnings_of_rig", ["a doubt"])
    parts = list(Answers(desk).begin({"kind": "doubts", "id": 1, "numbers": {"m": 3}}))
    assert parts[:-1] == [b"", b""]
    assert read(parts[-1])[0] == {"kind": "doubts", "id": 1, "end": True, "warnings": ["a doubt"]}
    assert given == [(desk.the_rig, "log 2")]
    assert asked == [({"m": 3.0}, True)]
    assert desk.asked[1:] == ["wait"]


def test_a_law_without_words_is_that_of_the_desk(desk, monkeypatch) -> None:
    given = told(monkeypatch, laws, "law_of_desk", ("the law", "its text"))
    seen = told(monkeypatch, laws, "law_view", SAID)
    for typed in (None, "  ", 3):
        found = heads(desk, kind="law", law=typed)
        assert found == [{"end": True, "law": SAID, "typed": "its text"}]
    assert given[0] == (desk, desk.the_rig)
    assert seen == [("the law",)] * 3
    asked = told(monkeypatch, laws, "law_of_text", "of the words")
    assert heads(desk, kind="law", law=" mu = 2*s ") == [
        {"end": True, "law": SAID, "typed": " mu = 2*s "}
    ]
    assert (asked, seen[-1]) == ([("mu = 2*s",)], ("of the words",))


def test_what_may_stand_on_a_line_is_told_with_the_line(desk, monkeypatch) -> None:
    given = told(monkeypatch, answers, "completions", [{"insert": "b"}])
    assert heads(desk, kind="complete", line=3) == [
        {"end": True, "line": 3, "found": [{"insert": "b"}]}
    ]
    heads(desk, kind="complete", line=1, text="b = 2")
    assert given == [("a = 1\n", 3), ("b = 2", 1)]
    for request in ({"line": "3"}, {}):
        assert "a text and a line" in heads(desk, kind="complete", **request)[0]["faults"][0]
    desk.text = None
    assert "a text and a line" in heads(desk, kind="complete", line=3)[0]["faults"][0]


def test_an_edit_puts_a_value_at_its_keys(desk) -> None:
    request = {"kind": "edit", "text": "[v]\na = 1  # kept\n", "keys": ["v", "a"], "value": "2"}
    assert heads(desk, **request) == [{"end": True, "text": "[v]\na = 2  # kept\n"}]
    mixed = request | {"keys": ["v", 3, "a"]}
    assert heads(desk, **mixed) == heads(desk, **request)
    for wrong in ({"keys": "va"}, {"keys": []}, {"keys": [1]}, {"value": 2}, {"value": None}):
        assert "an edit needs" in heads(desk, **(request | wrong))[0]["faults"][0]


def test_a_model_is_that_of_the_loop_that_is_asked_for_if_there_is_one(desk) -> None:
    pairs = [("pid", "dry"), ("pid", "wet"), ("sta", "wet")]
    desk.study = lambda text: SimpleNamespace(
        title="T", doc="d", limits={"distance": 9.0}, controller="ctl", ensembles={"dry": 1}
    )
    desk.loops = lambda text: pairs
    desk.first_loop = lambda text: ("sta", "wet")
    desk.the_rig.certificates = lambda: {"names": ["g"], "why": ""}
    desk.the_rig.loop = SimpleNamespace(period=0.01)

    def open_now(**request: Any) -> tuple[Any, ...]:
        (head,) = heads(desk, kind="model", **request)
        assert (desk.loop, desk.scenario) == (head["loop"], head["scenario"])
        return head["loop"], head["scenario"], head["ensemble"]

    assert open_now(loop="sta", scenario="wet") == ("sta", "wet", False)
    assert open_now(loop="sta", scenario="dry") == ("sta", "wet", False)  # there is none
    assert open_now(loop="pid", scenario="dry") == ("pid", "dry", True)
    assert open_now() == ("pid", "dry", True)
    desk.loop, desk.scenario = "pid", "icy"
    assert open_now() == ("pid", "dry", True)  # the first of that name
    desk.loop, desk.scenario = "nobody", "wet"
    assert open_now() == ("sta", "wet", False)
    (head,) = heads(desk, kind="model")
    assert head["sliders"][0]["name"] == "ctl.law.k"
    assert len(head["sliders"]) == 3
    plain = {k: head[k] for k in ("end", "home", "title", "doc", "text", "limits", "controller",
                                  "tick", "folder", "certificates")}  # fmt: skip
    assert plain == {
        "end": True, "home": "metro.toml", "title": "T", "doc": "d", "text": "a = 1\n",
        "limits": {"distance": 9.0}, "controller": "ctl", "tick": 0.01, "folder": "/folder",
        "certificates": {"names": ["g"], "why": ""},
    }  # fmt: skip
    assert head["loops"] == [list(p) for p in pairs]


# ---- commands ------------------------------------------------------------------------------------


def commanded(monkeypatch, rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """A command that tells these rows."""
    return told(monkeypatch, answers, "run_command", rows)


@pytest.mark.parametrize(("asked", "more"), [
    ("report", {}), ("sweep", {"ranges": ["m=1:2"]}),
    ("tune", {"ranges": ["m=1:2"], "metric": "distance"}),
])  # fmt: skip
def test_a_command_tells_how_far_it_is_and_what_it_found(desk, monkeypatch, asked, more) -> None:
    rows = [{"progress": "10 %"}, {}, {"progress": "90 %"},
            {"said": "all of it", "code": 0, "command": "slipctl it"}]  # fmt: skip
    given = commanded(monkeypatch, rows)
    gains = told(monkeypatch, answers, "found_gains", {"m": 1.5})
    out = desk.folder / f"out/my_study_pid_{asked}"
    parts = list(Answers(desk).begin({"kind": "command", "id": 1, "command": asked, **more}))
    assert [read(p)[0].get("progress") if p else "nothing" for p in parts] == [
        "10 %", "nothing", "90 %", "nothing", None,
    ]  # fmt: skip
    assert read(parts[0])[0]["command"] == asked
    assert read(parts[-1])[0] == {
        "kind": "command", "id": 1, "end": True, "command": asked, "said": "all of it",
        "line": "slipctl it", "gains": {"m": 1.5} if asked == "tune" else {},
        "file": f"out/my_study_pid_{asked}/report.html",
    }  # fmt: skip
    ((words,),) = given
    assert words[-2:] == ["--out", str(out)]
    assert words[0] == {"report": "run"}.get(asked, asked)
    assert gains == ([(out, desk.the_rig.sliders)] if asked == "tune" else [])


def test_a_report_that_found_something_is_told_and_a_search_or_replay_that_failed_is_refused(
    desk, monkeypatch
) -> None:
    """By its last line, or that it failed."""
    replay = {"command": "replay", "log": "a.csv", "part": "ctl"}
    tune = {"command": "tune", "ranges": ["m=1:2"], "metric": "distance"}
    commanded(monkeypatch, [{"said": "first\nlast line\n", "code": 1, "command": "c"}])
    for request in (replay, tune):
        assert heads(desk, kind="command", **request)[-1]["faults"] == ["last line"]
    assert heads(desk, kind="command", command="report")[-1]["said"] == "first\nlast line\n"
    commanded(monkeypatch, [{"said": "\n", "code": 3, "command": "c"}])
    for request in (replay, tune):
        assert heads(desk, kind="command", **request)[-1]["faults"] == [
            f"{request['command']} failed"
        ]


def test_a_replay_draws_what_it_wrote_before_it_ends(desk, monkeypatch) -> None:
    given = commanded(monkeypatch, [{"said": "3 ticks", "code": 0, "command": "c"}])
    drawn = curves.Curves(np.arange(3.0), [curves.Panel("mu", "1", [
        curves.Series("computed", 0, "main", np.array([1.0, 2, 4]))])], [])  # fmt: skip
    seen = told(monkeypatch, answers, "replayed_curves", drawn)
    asked = {"log": "a.csv", "part": "ctl", "columns": ["v=a", "w=b "], "beside": ["u=c"]}
    first, last = answered(Answers(desk), kind="command", command="replay", **asked)
    head, (time, values) = first
    assert {k: head[k] for k in ("kind", "id", "loop", "share")} == {
        "kind": "command", "id": 0, "loop": "replay", "share": 1.0,
    }  # fmt: skip
    assert (time.tolist(), values.tolist()) == ([0, 1, 2], [1, 2, 4])
    assert (last[0]["end"], last[0]["said"], last[0]["gains"]) == (True, "3 ticks", {})
    out = desk.folder / "out/my_study_pid_replay"
    assert seen == [(out,)]
    words = ["replay", str(desk.folder / "a.csv"), "--with", "metro.toml:pid.ctl"]
    assert given == [([*words, "--map", "v=a", "w=b", "--beside", "u=c", "--out", str(out)],)]


def test_a_command_that_was_stopped_says_so_and_a_text_that_was_not_saved_is_refused(
    desk, monkeypatch
) -> None:
    given = commanded(monkeypatch, [])
    assert heads(desk, kind="command", command="stop") == [
        {"end": True, "command": "stop", "said": Answers.stopped}
    ]
    assert "save the text first" in heads(
        desk, kind="command", command="report", text="b = 2")[0]["faults"][0]  # fmt: skip
    assert given == []


@pytest.mark.parametrize(("scenario", "named"), [("wet", ["--scenario", "wet"]), ("", [])])
def test_words_of_a_report_are_those_of_the_run(desk, scenario, named) -> None:
    desk.scenario = scenario
    out = str(desk.folder / "out/my_study_pid_report")
    words, folder = command_lines.command_words("report", desk, desk.the_rig, {"m": 2.5}, {})
    assert words == ["run", "metro.toml", "--loop", "pid", *named, "--set", "m=2.5 kg",
                     "--out", out]  # fmt: skip
    assert str(folder) == out


def test_a_recorded_log_is_replayed_with_a_part_and_nothing_else_is_done_with_it() -> None:
    log = object.__new__(LogAnswers)
    log.path, log.folder = Path("/there/run.csv"), Path("/there")
    words, out = log._words("replay", {"part": " metro.toml:pid.ctl "})
    assert out == Path("/there/out/run_replay")
    assert words == ["replay", "/there/run.csv", "--with", "metro.toml:pid.ctl", "--out", str(out)]
    with pytest.raises(BadInput):
        log._words("tune", {"part": "x"})
    with pytest.raises(BadInput):
        log._words("replay", {"part": "--x"})


class Process:
    """A process that ends after a few looks, and writes meanwhile."""

    def __init__(self, writes: list[str], printed: str = "", code: int = 0) -> None:
        self.writes, self.printed, self.code = deque(writes), printed, code
        self.returncode: int | None = None
        self.done: list[Any] = []

    def __call__(self, words: list[str], **given: Any) -> Process:
        self.words, self.given = words, given
        return self

    def poll(self) -> int | None:
        if self.returncode is None and self.writes:
            self.given["stderr"].close() if self.given["stderr"].closed else None
            with Path(self.given["stderr"].name).open("a") as file:
                file.write(self.writes.popleft())
            return None
        if self.returncode is None:
            Path(self.given["stdout"].name).write_text(self.printed)
            self.returncode = self.code
        return self.returncode

    def terminate(self) -> None:
        self.done.append("terminate")

    def wait(self, seconds: float) -> None:
        self.done.append(seconds)
        raise subprocess.TimeoutExpired("it", seconds)

    def kill(self) -> None:
        self.done.append("kill")
        self.returncode = -9


def running(monkeypatch, process: Process, *words: str) -> Any:
    monkeypatch.setattr(subprocess, "Popen", process)
    monkeypatch.setattr(command_lines.time, "sleep", process.done.append)
    return command_lines.run_command(words)


def test_a_command_tells_each_new_line_once_and_what_it_printed_at_last(monkeypatch) -> None:
    process = Process(["slipctl: 10 %\n", "", "warm\n50 %", "\n"], "x" * 20_005, code=1)
    found = list(running(monkeypatch, process, "sweep", "a b"))
    assert found[:-1] == [{"progress": "10 %"}, {}, {"progress": "50 %"}, {}]
    assert found[-1] == {"said": "x" * 20_000, "code": 1, "command": "slipctl sweep 'a b'"}
    assert process.words == [sys.executable, "-m", "slipctl", "sweep", "a b"]
    assert process.given["env"]["SLIPCTL_PROGRESS"] == "1"
    assert process.given["env"].items() >= {"PATH": os.environ["PATH"]}.items()
    assert process.given["stdin"] == subprocess.DEVNULL
    assert process.done == [0.05] * 4  # it is not ended
    assert not Path(process.given["stdout"].name).exists()


def test_a_command_that_printed_nothing_says_what_it_told(monkeypatch) -> None:
    process = Process(["why it failed\nin two lines\n"], code=1)
    assert list(running(monkeypatch, process))[-1]["said"] == "why it failed\nin two lines\n"


@pytest.mark.parametrize(("told_", "said"), [
    (["warning\n", "slipctl: no such loop\n"], "no such loop"), ([], "it was refused"),
])  # fmt: skip
def test_a_command_that_is_refused_is_so_in_its_last_line(monkeypatch, told_, said) -> None:
    with pytest.raises(BadInput) as refused:
        list(running(monkeypatch, Process(told_, "printed", code=2)))
    assert str(refused.value) == said


def test_a_command_that_is_left_is_ended_with_patience(monkeypatch) -> None:
    process = Process(["1 %\n"] * 3)
    going = running(monkeypatch, process)
    assert next(going) == {"progress": "1 %"}
    going.close()
    assert process.done == [0.05, "terminate", command_lines.PATIENCE, "kill"]
    assert not Path(process.given["stderr"].name).exists()


def test_gains_of_a_search_are_in_the_units_of_si(tmp_path: Path) -> None:
    (tmp_path / "gains.toml").write_text(
        f'format = {store.FORMAT}\nloop = "a"\n[gains]\nm = "2 t"\nk = 3.5\n'
    )
    assert command_lines.found_gains(tmp_path, [MASS]) == {"m": 2000.0, "k": 3.5}


def test_a_replay_is_a_panel_for_each_signal_those_with_a_recording_first(tmp_path: Path) -> None:
    rows = ["t [s],a [m/s],b [kN],b recorded [kN],b residual [kN]", "0,1,2,3,1", "0.5,4,5,6,1"]
    (tmp_path / "replay.csv").write_text("\n".join(rows) + "\n")
    found = command_lines.replayed_curves(tmp_path)
    assert found.time.tolist() == [0.0, 0.5]
    assert [(p.name, p.unit) for p in found.panels] == [("b", "kN"), ("a", "m/s")]
    told_ = [[(s.name, s.axle, s.looks, s.values.tolist()) for s in p.series] for p in found.panels]
    assert told_ == [
        [("computed", 0, "main", [2, 5]), ("recorded", 0, "best", [3, 6])],
        [("computed", 0, "main", [1, 4])],
    ]
    assert list(found.rails) == []


# ---- effects, draws, C ---------------------------------------------------------------------------


@step(period=0.1, w=Output("m/s", "twice", lo=-1e3, hi=1e3), T=Output("N m", "of it"))
def falls(
    v=State("m/s", 5.0, "speed"),
    x=State("m", 0.0, "way"),
    m=Param("kg", 2.0, "mass", lo=1, hi=9),
    a=Param("m/s^2", 1.0, "deceleration", lo=0, hi=9),
):
    """A body that slows down."""
    return dict(v=v - 0.1 * a, x=x + 0.1 * v), dict(w=2 * v, T=4 * m)


LOOP = connect("loop", {"w": "car.w"}, car=falls)
TICKS = 30


def rig(**named: Any) -> SimpleNamespace:
    scenario = Scenario("base", 0.1 * TICKS, Rail([Section(0.0)]))
    study = {"name": "own", "ensembles": {}, "limits": {}, "models": {}, "without_effect": [],
             "signals": Signals(speed="car.v", position="car.x")}  # fmt: skip
    case = SimpleNamespace(scenario=scenario, known={}, loops={"loop": LOOP})
    return SimpleNamespace(
        loop=LOOP, case=case, study=SimpleNamespace(**(study | named)), compiled=False,
        compile=False, sliders=sliders_of_loop(LOOP, scenario), name="loop",
    )  # fmt: skip


def distance(a: float) -> float:
    """Way of the body at the end of the run, from the last two speeds beyond the last tick."""
    v = 5 - 0.1 * a * np.arange(TICKS)
    return float(0.1 * v[:-1].sum() + 0.1 * (1.5 * v[-1] - 0.5 * v[-2]))


def test_slopes_of_a_loop_are_those_of_its_closed_form_of_the_metrics_that_it_has() -> None:
    """Here it has no slip; the way is linear in the deceleration."""
    for numbers in ({}, {"car.a": 2.0}):
        found = effects.exact_slopes(rig(), numbers, ["car.a", "car.m"])
        wanted = pytest.approx(distance(2.0) - distance(1.0), rel=1e-12)
        assert found == {"distance": {"car.a": wanted, "car.m": 0.0}}
        assert list(found["distance"]) == ["car.a", "car.m"]
        assert all(type(v) is float for v in found["distance"].values())


def test_draws_count_what_is_kept_what_fails_and_tell_each_value(monkeypatch) -> None:
    """By the numbers that are drawn, which the world tells; the last of three fails."""
    drawn = []

    class World(effects.World):
        def metrics(self, numbers: Any, draw: Any) -> Any:
            found = super().metrics(numbers, draw)
            drawn.append((draw.numbers["car.a"], numbers, found["distance"].value))
            if len(drawn) == 3:
                raise RunFailed("it became NaN")
            return found

    monkeypatch.setattr(effects, "World", World)
    monkeypatch.setattr(spread, "share_interval", lambda hits, runs: (0.0, 1.0))
    asked = rig(ensembles={"base": Ensemble({"car.a": "1m/s^2:3m/s^2"})}, limits={"distance": 6.0})
    rows = list(effects.ensemble_rows(asked, {"car.m": 3.0}, 4))
    ways = [distance(a) for a, _, _ in drawn]
    assert len(set(ways)) == 4
    assert [w for _, _, w in drawn] == pytest.approx(ways, rel=1e-12)
    assert all(numbers == {"car.m": 3.0} for _, numbers, _ in drawn)
    told_ = [ways[0], ways[1], None, ways[3]]
    for k, row in enumerate(rows, 1):
        assert (row["runs"], row["draws"], row["failed"]) == (k, 4, int(k > 2))
        assert row["within"] == sum(w is not None and w <= 6.0 for w in told_[:k])
        assert row["values"] == {
            "distance": [w if w is None else pytest.approx(w) for w in told_[:k]]
        }
        assert (row["limits"], row["notes"]) == ({"distance": 6.0}, [])
        assert row["text"].startswith(f"{row['within']} of {k} ")
    assert 0 < rows[-1]["within"] < 3
    assert len(list(effects.ensemble_rows(
        rig(ensembles={"base": Ensemble({"car.a": "1m/s^2:3m/s^2"})}, limits={"distance": 6.0}),
        {}))) == effects.DRAWS  # fmt: skip


def test_a_metric_that_one_side_has_not_changes_by_nothing_that_is_known() -> None:
    up = {"distance": Metric(3.0, "m"), "slip_max": Metric(np.nan, "m/s")}
    down = {"distance": Metric(1.0, "m"), "slip_max": Metric(1.0, "m/s")}
    assert effects._change("slip_max", down, up, 0.04) == {"by": None, "unit": "m/s"}
    assert effects._change("distance", {}, up, 0.04) == {"by": None, "unit": "m"}
    assert effects._change("distance", down, up, 0.04) == {
        "by": pytest.approx(2.0 / 0.04 / 100), "unit": "m",
    }  # fmt: skip


@pytest.mark.parametrize("compiler", [None, "cc"])
@pytest.mark.parametrize("part", ["", "other"])
def test_c_of_a_loop_is_that_of_its_controller_checked_where_there_is_a_compiler(
    monkeypatch, compiler, part
) -> None:
    exported: list[Any] = []

    def export(block: Any, folder: str, name: str, **given: Any) -> Any:
        exported.append((block, name, given))
        for file, text in (("b.h", "head"), ("a.c", "x" * 200_007), ("c.o", "1"), ("d.txt", "t")):
            (Path(folder) / file).write_text(text)
        data = {"compiled": [{"compiler": "gcc", "bytes": {"text": 1}},
                             {"compiler": "clang", "bytes": {"text": 2}}],
                "memory_bytes": {"state": 24, "all": 99},
                "targets": [{"target": "m4", "bytes": 7, "instructions": 8, "load": 0.5, "x": 1}],
                }  # fmt: skip
        said = {"__str__": lambda self: f"1 file in {folder}, right"}
        return type("Report", (), {"data": {} if part else data, "passed": True, **said})()

    runs = told(monkeypatch, c_texts, "runs_of_part", SimpleNamespace(block="block", period=0.02))
    recorded = told(monkeypatch, c_texts.codegen, "record_part", ("inputs", "params"))
    monkeypatch.setattr(c_texts.codegen, "export", export)
    monkeypatch.setattr(c_texts.build, "compiler", lambda: compiler)
    asked = rig(name="my-own", controller="ctl")
    found = c_texts.c_of_rig(asked, {}, part, "cortex-m4")
    assert runs == [(LOOP, part or "ctl")]
    ticks = c_texts.TICKS if compiler else 1
    assert recorded == [(LOOP, part or "ctl", asked.case.scenario, ticks)]
    assert exported == [("block", "my_own_loop", {
        "inputs": "inputs", "params": "params", "period": 0.02, "check": compiler is not None,
        "target": "cortex-m4",
    })]  # fmt: skip
    assert list(found["files"]) == ["a.c", "b.h"]
    assert (found["files"]["b.h"], len(found["files"]["a.c"])) == ("head", c_texts.LETTERS)
    assert (found["report"], found["passed"]) == ("1 file, right", True)
    assert found["checked"] == (compiler is not None)
    if part:
        assert (found["bytes"], found["state_bytes"], found["targets"]) == ({}, None, [])
        return
    assert found["bytes"] == {"gcc": {"text": 1}, "clang": {"text": 2}}
    assert found["state_bytes"] == 24
    assert found["targets"] == [{"target": "m4", "bytes": 7, "instructions": 8, "load": 0.5}]


def test_c_of_moved_numbers_is_of_a_loop_that_has_them(monkeypatch) -> None:
    def stop(loop: Any, part: str) -> None:
        raise BadInput(f"{float(loop.param_values()['car.m'])} {part}")

    monkeypatch.setattr(c_texts, "runs_of_part", stop)
    with pytest.raises(BadInput, match=r"^3.5 ctl$"):
        c_texts.c_of_rig(rig(controller="ctl"), {"car.m": 3.5})


# ---- a window's process --------------------------------------------------------------------------


class Pipe:
    """Questions that come after so many looks; what is sent is kept."""

    def __init__(self, *comes: Any) -> None:
        self.comes, self.sent, self.waits = deque(comes), [], []

    def poll(self, seconds: float | None) -> bool:
        self.waits.append(seconds)
        if not self.comes:
            raise EOFError
        if self.comes[0] is ...:
            if seconds != 0:  # nobody waits where there is work
                raise EOFError
            self.comes.popleft()
            return False
        return True

    def recv(self) -> Any:
        return self.comes.popleft()

    def send(self, said: Any) -> None:
        self.sent.append(said)


class Counting:
    """Answers each question in a few pieces, and tells which were left."""

    def __init__(self) -> None:
        self.left: list[Any] = []

    def begin(self, request: Any) -> Any:
        try:
            for k in range(request.get("pieces", 1)):
                yield f"{request['kind']} {request['id']} {k}".encode() if k != 1 else b""
        except GeneratorExit:
            self.left.append(request["id"])


@pytest.fixture
def served(monkeypatch) -> Any:
    """What a worker does with a pipe, and what it did before."""

    def serve(pipe: Pipe, made: Any, limited: bool = True) -> list[Any]:
        done: list[Any] = []
        for where, name in ((worker.signal, "signal"), (worker.gc, "set_threshold"),
                            (worker.resolve, "load_only"), (worker, "_limit_memory")):  # fmt: skip
            monkeypatch.setattr(where, name, lambda *given, name=name: done.append((name, *given)))

        def opened(*given: Any) -> Any:
            done.append(given)
            if isinstance(made, Exception):
                raise made
            return made

        monkeypatch.setattr(worker, "answers_of_opening", opened)
        worker.serve(pipe, "metro.toml", "/folder", ["a.py"], False, limited)
        return done

    return serve


def question(kind: str, number: int, pieces: int = 1) -> dict[str, Any]:
    return {"kind": kind, "id": number, "pieces": pieces}


@pytest.mark.parametrize("limited", [True, False])
def test_a_process_reads_what_is_open_and_imports_what_was_named_alone(served, limited) -> None:
    done = served(pipe := Pipe(None), Counting(), limited)
    sig = worker.signal
    assert done[0] == ("signal", sig.SIGINT, sig.SIG_IGN)
    assert (("_limit_memory",) in done) == limited
    assert ("load_only", ["a.py"]) in done
    assert done[-1] == ("metro.toml", "/folder", False)
    assert done.index(("load_only", ["a.py"])) < len(done) - 1
    assert (pipe.sent, pipe.waits) == ([], [None])


def test_a_process_of_what_cannot_be_opened_says_so_and_ends(served) -> None:
    pipe = Pipe({"kind": "run"})
    served(pipe, BadInput("no such file"))
    ((what, said),) = pipe.sent
    assert what == "frame"
    assert read(said)[0] == {"kind": "model", "id": 0, "end": True, "faults": ["no such file"]}
    assert len(pipe.comes) == 1


def test_a_process_answers_piece_by_piece_the_most_urgent_question_first(served) -> None:
    """A run before the model before effects, whenever they came; what is unknown before all."""
    pipe = Pipe(question("effects", 1), question("run", 2, 3), question("model", 3),
                *[...] * 2, question("odd", 4), *[...] * 9)  # fmt: skip
    served(pipe, Counting())
    steps = [said[1] for said in pipe.sent if said[0] == "step"]
    assert steps == ["run", "run", *["odd"] * 2, *["run"] * 2, *["model"] * 2, *["effects"] * 2]
    frames = [said[1] for said in pipe.sent if said[0] == "frame"]
    assert frames == [b"run 2 0", b"odd 4 0", b"run 2 2", b"model 3 0", b"effects 1 0"]
    assert [k for k, said in enumerate(pipe.sent) if said == ("idle",)] == [len(pipe.sent) - 1]
    assert pipe.waits[:4] == [None, 0, 0, 0]
    assert pipe.waits[-1] is None  # it waits for the next question


def test_a_newer_question_of_a_kind_ends_the_older_one(served) -> None:
    pipe = Pipe(question("run", 1, 5), ..., question("run", 2), *[...] * 2)
    served(pipe, made := Counting())
    frames = [said[1] for said in pipe.sent if said[0] == "frame"]
    assert frames == [b"run 1 0", b"run 2 0"]
    assert made.left == [1]
    pipe = Pipe(question("run", 1), question("run", 2), *[...] * 2)
    served(pipe, made := Counting())
    assert [said[1] for said in pipe.sent if said[0] == "frame"] == [b"run 2 0"]
    assert made.left == []


def test_memory_is_limited_where_the_system_can(monkeypatch) -> None:
    resource = pytest.importorskip("resource")
    given = told(monkeypatch, resource, "setrlimit", None)
    monkeypatch.setattr(worker.sys, "platform", "linux")
    worker._limit_memory()
    assert given == [(resource.RLIMIT_AS, (8 * 2**30, 8 * 2**30))]
    monkeypatch.setattr(worker.sys, "platform", "darwin")
    worker._limit_memory()
    assert len(given) == 1

    def refuse(*_: Any) -> None:
        raise ValueError

    monkeypatch.setattr(worker.sys, "platform", "linux")
    monkeypatch.setattr(resource, "setrlimit", refuse)
    worker._limit_memory()


def test_what_is_said_of_a_kind_is_sent_to_it_and_nothing_of_none() -> None:
    sent: list[Any] = []
    made = object.__new__(Worker)
    made.send = lambda kind, data: sent.append((kind, read(data)[0]))
    made._say("run", "it has ended")
    made._say("", "nobody asked")
    head = {"kind": "run", "id": 0, "end": True, "faults": ["it has ended"], "stopped": True}
    assert sent == [("run", head)]


def test_windows_are_kept_over_a_reload_and_at_most_so_many(monkeypatch) -> None:
    server = pytest.importorskip("slipctl.workbench.web.server")
    closed: list[Any] = []

    class Window:
        def __init__(self, opening: Any, send: Any) -> None:
            self.opening, self.send = opening, send

        def warm(self) -> Any:
            self.warmed = True
            return self

        def close(self) -> None:
            closed.append(self)

    class Timer:
        cancelled = False

        def cancel(self) -> None:
            self.cancelled = True

    class Thread:
        def __init__(self, target: Any, daemon: bool) -> None:
            assert daemon
            self.start = target

    monkeypatch.setattr(server, "Window", Window)
    monkeypatch.setattr(server, "threading", SimpleNamespace(Thread=Thread))
    made = server.Windows("opening")
    first = made.enter("0", "send 0")
    assert (first.warmed, first.send, first.opening) == (True, "send 0", "opening")
    others = [made.enter(str(k), f"send {k}") for k in range(1, server.MOST)]
    assert not any(hasattr(w, "warmed") for w in others)
    with pytest.raises(BadInput):
        made.enter("more", "send")
    timer = made._ends["0"] = Timer()
    assert made.enter("0", "again") is first
    assert (first.send, timer.cancelled, made._ends) == ("again", True, {})
    made._ends["0"] = Timer()
    made._end("0")
    assert (closed, made._ends) == ([first], {})
    assert "0" not in made._windows
    made._end("0")  # twice is once
    assert closed == [first]
    assert made.enter("more", "send") not in (first, *others)
    made.close()
    assert closed[1:-1] == others


# ---- what is open --------------------------------------------------------------------------------


def bare_rig(gains: list[Any], uncertified: dict[str, str]) -> Rig:
    certificates = SimpleNamespace(gains=gains, uncertified=uncertified)
    case = SimpleNamespace(scenario=SimpleNamespace(name="wet"))
    return Rig(SimpleNamespace(certificates=certificates), case, "pid", LOOP, compile=False)  # type: ignore[arg-type]


def test_certificates_of_a_loop_are_those_of_its_name_or_the_reason_why_there_are_none() -> None:
    gains = [SimpleNamespace(name=n, loop=at) for n, at in (
        ("a", "pid"), ("b", "sta"), ("c", "pid@wet"), ("d", "pid@dry"))]  # fmt: skip
    made = bare_rig(gains, {})
    assert made.certificates() == {"names": ["a", "c"], "why": ""}
    assert [made.gains_by_name(n).name for n in ("", "a", "c")] == ["a", "a", "c"]
    for name in ("b", "d"):
        with pytest.raises(BadInput, match=f"'{name}'"):
            made.gains_by_name(name)
    found = bare_rig([], {"pid": "it has a quantiser"}).certificates()
    assert found == {"names": [], "why": "it has a quantiser"}
    found = bare_rig(gains[1:2], {"sta": "no"}).certificates()
    assert found["names"] == []
    assert "declares no gains" in found["why"]


class Shelf(Desk):
    """A desk whose studies are stand-ins."""

    def __init__(self, pairs: list[tuple[str, str]], gains: list[str]) -> None:
        self.text = None
        self.pairs = pairs
        self.made = SimpleNamespace(certificates=([SimpleNamespace(loop=g) for g in gains], {}))

    def loops(self, text: Any = None) -> Any:
        return self.pairs

    def study(self, text: Any = None) -> Any:
        return self.made


@pytest.mark.parametrize(("pairs", "gains", "first"), [
    ([("none", "a"), ("pid", "a"), ("sta", "a"), ("sta", "b")], ["gone", "sta"], ("sta", "a")),
    ([("none", "a"), ("pid", "a"), ("pid", "b")], ["gone"], ("pid", "a")),
    ([("none", "a"), ("pid", "a"), ("sta", "b")], ["sta", "pid"], ("sta", "b")),
    ([("none", "a"), ("none", "b")], [], ("none", "a")),
])  # fmt: skip
def test_the_first_loop_has_a_certificate_else_it_is_a_controller(pairs, gains, first) -> None:
    assert Shelf(pairs, gains).first_loop() == first


def test_the_last_studies_and_loops_stay_ready(monkeypatch) -> None:
    from slipctl.workbench import desk as desks

    shelf = object.__new__(Desk)
    shelf.text, shelf.home, shelf.compile = "t", "metro.toml", False
    shelf.loop, shelf.scenario = "pid", ""
    shelf._studies, shelf._rigs = {}, {}
    loaded: list[Any] = []

    def study_of_text(home: str, text: str) -> str:
        loaded.append((home, text))
        return f"study {text}"

    monkeypatch.setattr(desks.trip_files, "study_of_text", study_of_text)
    monkeypatch.setattr(desks.resolve, "load_study", lambda home: f"study of {home}")
    for text in "abcde":
        assert shelf.study(text) == f"study {text}"
    assert list(shelf._studies) == list("bcde")
    assert shelf.study("b") == "study b"
    assert loaded == [("metro.toml", t) for t in "abcde"]
    shelf.text = None
    assert shelf.study() == "study of metro.toml"
    assert list(shelf._studies) == [*"cde", None]
    asked: list[Any] = []
    monkeypatch.setattr(desks, "Rig", lambda *given: given)
    monkeypatch.setattr(desks.Request, "of", lambda study, name: asked.append(name) or
                        SimpleNamespace(declared=(f"block {name}", "case")))  # fmt: skip
    for loop in ("p1", "p2", "p3", "p4"):
        found = shelf.rig("c", loop, "wet")
        assert found == ("study c", "case", loop, f"block {loop}@wet", False)
    shelf.rig("c", "p1", "wet")  # used again: the second is the oldest now
    shelf.rig("c", "p5", "")
    assert [key[1] for key in shelf._rigs] == ["p3", "p4", "p1", "p5"]
    assert asked == ["p1@wet", "p2@wet", "p3@wet", "p4@wet", "p5"]
    assert list(shelf._rigs)[-1] == ("c", "p5", "")
    shelf.rig("c")
    assert asked[-1] == "pid"


def test_a_file_that_is_gone_is_refused_and_a_mark_at_its_beginning_is_no_text(tmp_path) -> None:
    shelf = object.__new__(Desk)
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert shelf._read(str(tmp_path / "a.toml")) == "a = 1\n"
    with pytest.raises(BadInput):
        shelf._read(str(tmp_path / "b.toml"))


def test_a_recorded_log_is_opened_in_its_folder(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "run.csv").write_text("t [s],v [m/s]\n0,1\n1,2\n")
    made = openings.opening_of_name("below/run.csv", ["a.py"], False)
    assert made == openings.Opening(
        "below/run.csv", str((tmp_path / "below").resolve()), ("a.py",), False)  # fmt: skip
    openings.check_opening(made)
    (tmp_path / "below" / "run.csv").write_text("nothing\n")
    with pytest.raises(BadInput):
        openings.check_opening(made)
    with pytest.raises(BadInput):
        openings.opening_of_name("gone.toml:pid")


def test_a_study_that_there_is_not_is_refused_when_it_is_checked() -> None:
    openings.check_opening(openings.Opening("subway_braking", "."))
    with pytest.raises(BadInput):
        openings.check_opening(openings.Opening("no_such_study", "."))


# ---- law, findings, sliders, curves --------------------------------------------------------------


@law(mu=Output("1", positive="traction"))
def sliding(v_s=Input("m/s", "slip"), c=Param("s/m", 0.5, "slope")):
    return c * v_s


@law(mu=Output("1", positive="traction"))
def apart(u=Input("1", "no slip")):
    return u


def test_a_law_of_a_file_is_read_from_it_else_it_is_one_of_the_study_or_of_the_loop(
    monkeypatch,
) -> None:
    files = SimpleNamespace(root=lambda content: ("root", content),
                            adhesion_law=lambda part: ("law", part) if part else None)  # fmt: skip
    monkeypatch.setattr(laws.trip_files, "vehicle_files", lambda: files)
    read_parts = told(monkeypatch, laws.declared_parts, "read", ("part", []))
    text = SimpleNamespace(text="a = 1")
    assert laws.law_of_desk(text, rig()) == ("law", "part")
    assert read_parts == [(("root", {"a": 1}), {"a": 1})]
    told(monkeypatch, laws.declared_parts, "read", (None, []))
    own = rig(models={"x": SimpleNamespace(), "y": apart, "z": sliding})
    for desk_ in (text, SimpleNamespace(text=None)):
        assert laws.law_of_desk(desk_, own) == (sliding, "")
    loop = SimpleNamespace(leaves=lambda: [("a", falls), ("b", apart), ("c", sliding)])
    beside = rig()
    beside.loop = loop
    assert laws.law_of_desk(text, beside) == (sliding, "")
    with pytest.raises(BadInput, match="own"):
        laws.law_of_desk(text, rig())


def test_an_equation_with_a_state_is_no_adhesion_law(monkeypatch) -> None:
    @step(period=0.1, mu=Output("1"))
    def slow(x=State("1", 0.0), v_s=Input("m/s", "slip")):
        return dict(x=x + v_s), dict(mu=x)

    monkeypatch.setattr(laws.resolve, "load_block", lambda text: slow)
    with pytest.raises(BadInput, match="step"):
        laws.law_of_text("slow")
    monkeypatch.setattr(laws.resolve, "load_block", lambda text: sliding)
    assert laws.law_of_text("sliding") is sliding


def test_a_curve_without_a_peak_says_why(monkeypatch) -> None:
    """And has all its points."""

    def refuse(*_: Any, **__: Any) -> None:
        raise RunFailed("no peak")

    monkeypatch.setattr(laws, "_peak", refuse)
    found = laws._curve(sliding, "v_s", 2.0, "dry", {"c": 0.25})
    assert found["x"] == np.linspace(0, 2, laws.POINTS).tolist()
    assert found["y"] == pytest.approx(0.25 * np.linspace(0, 2, laws.POINTS))
    assert (found["name"], found["why"]) == ("dry", "no peak")
    assert set(found) == {"name", "x", "y", "why"}


def test_doubts_of_a_run_are_told_once_of_the_study_then_of_the_log_then_of_the_loop(
    monkeypatch,
) -> None:
    before = told(monkeypatch, findings, "warnings_before_run", ["loop", "both"])
    asked = rig(without_effect=["study", "both"])
    log = SimpleNamespace(told=lambda: ["log", "study"])
    assert findings.warnings_of_rig(asked, log) == ["study", "both", "log", "loop"]
    assert before == [(LOOP, asked.case.scenario)]


@pytest.mark.parametrize(("value", "lo", "hi", "wanted"), [
    (2.0, 0.0, 100.0, (0.4, 10.0, True)), (2.0, 1.0, 3.0, (1.0, 3.0, False)),
    (2.0, -1.0, 100.0, (0.4, 10.0, True)), (-2.0, -100.0, 0.0, (-10.0, -0.4, False)),
    (2.0, 2.0, 2.0, (2.0, 2.0, False)), (30.0, 0.0, 5.0, (0.0, 5.0, False)),
    (0.0, -3.0, 0.5, (-1.0, 0.5, False)), (0.0, -np.inf, np.inf, (-1.0, 1.0, False)),
    (0.0, -0.25, 0.125, (-0.25, 0.125, False)), (0.0, 0.0, 9.0, (0.0, 1.0, False)),
    (1.0, 0.5, 2.5, (0.5, 2.5, True)),
])  # fmt: skip
def test_a_slider_goes_five_times_either_way_within_the_declared_range(
    value, lo, hi, wanted
) -> None:
    assert ends_of_slider(value, lo, hi) == pytest.approx(wanted)


class Seen:
    """A run with columns by role."""

    def __init__(self, sign: int, units: dict[str, str], **columns: Any) -> None:
        self.slip_sign, self.units = sign, units
        self.columns = {n: np.array(v, float) for n, v in columns.items()}
        self.signals = SimpleNamespace(axles=())

    def each(self, role: str) -> Any:
        return self.columns.get(role)

    def unit(self, role: str) -> str | None:
        return self.units.get(role)


V = [[10.0], [5.0]]


@pytest.mark.parametrize(("run", "rims"), [
    (Seen(1, {"slip": "m/s"}, speed=V, slip=[[1.0, 2], [0, 3]]), [[9.0, 8], [5, 2]]),
    (Seen(-1, {"slip": "m/s"}, speed=V, slip=[[1.0, 2], [0, 3]]), [[11.0, 12], [5, 8]]),
    (Seen(1, {"slip": "1"}, speed=V, slip=[[0.1, 0], [0, 0.4]]), [[9.0, 10], [5, 3]]),
    (Seen(1, {"wheel_speed": "m/s"}, speed=V, wheel_speed=[[7.0, 8], [2, 3]]), [[7.0, 8], [2, 3]]),
    (Seen(1, {"wheel_speed": "rad/s"}, speed=V, wheel_speed=[[7.0, 8], [2, 3]]), []),
    (Seen(1, {}, speed=V), []),
])  # fmt: skip
def test_the_speed_of_a_rim_follows_from_slip_or_is_that_of_the_wheel(run, rims) -> None:
    panel = curves._speeds(run)
    assert (panel.name, panel.unit) == ("speed", "km/h")
    first, *others = panel.series
    assert (first.name, first.axle, first.looks) == ("vehicle", 0, "best")
    assert first.values.tolist() == [36.0, 18.0]
    assert [(s.name, s.axle) for s in others] == [("rim", k + 1) for k in range(2 if rims else 0)]
    if rims:
        assert np.stack([s.values for s in others], 1) == pytest.approx(3.6 * np.array(rims))
    assert curves._speeds(Seen(1, {}, slip=V)) is None


# ---- what is refused or lost ---------------------------------------------------------------------


def test_a_process_that_ends_again_and_again_is_begun_no_more(monkeypatch) -> None:
    """One that was idle between counts anew."""
    begun: list[int] = []
    said_: list[tuple[str, str]] = []
    sent: list[Any] = []

    class Ended:
        def __init__(self, *said: Any) -> None:
            self.said = deque(said)

        def recv(self) -> Any:
            if not self.said:
                raise EOFError
            return self.said.popleft()

    made = object.__new__(Worker)
    made.__dict__.update(_lock=threading.Condition(), _closed=False, _lost=0, _step=None)
    made.send = lambda kind, data: sent.append((kind, data))
    made._begin = lambda: begun.append(made._lost)  # type: ignore[method-assign]
    made._say = lambda kind, text: said_.append((kind, text))  # type: ignore[method-assign]

    def end(*said: Any) -> None:
        made._step, made._pipe = None, Ended(*said)
        made._read(made._pipe)

    end(("frame", b"1"), ("step", "run"), ("frame", b"2"))
    assert sent == [("model", b"1"), ("run", b"2")]
    assert said_[-1][0] == "run"
    end(("step", "run"), ("idle",))
    assert (made._lost, said_[-1][0]) == (1, "")
    for _ in range(windows.MOST_LOST - 1):
        end()
    assert not made._closed
    assert begun == [1, 1, 2, 3]
    end()
    assert (made._closed, begun, said_[-1][0]) == (True, [1, 1, 2, 3], "model")
    made._closed, made._lost = False, windows.MOST_LOST
    end(("step", "effects"))
    assert (made._closed, said_[-1][0], len(begun)) == (True, "effects", 4)


def test_a_question_of_a_process_that_has_ended_is_lost_and_the_next_one_is_not(
    monkeypatch,
) -> None:
    """They are handed on in the order in which they came, until the window is closed."""
    made, sent, slept = object.__new__(Worker), [], []

    class Broken:
        def send(self, request: Any) -> None:
            sent.append(request)
            made._closed = len(sent) == 3
            if len(sent) == 1:
                raise OSError
            if len(sent) == 2:
                raise ValueError

    made.__dict__.update(
        _lock=threading.Condition(), _closed=False, _pipe=Broken(),
        _waiting={"b": 1, "a": 2, "c": 3, "d": 4},
    )  # fmt: skip
    monkeypatch.setattr(windows, "time", SimpleNamespace(sleep=slept.append))
    made._write()
    assert (sent, slept, made._waiting) == ([1, 2, 3], [0.05, 0.05], {"d": 4})


def test_a_port_that_is_taken_is_refused_and_left() -> None:
    server = pytest.importorskip("slipctl.workbench.web.server")
    with server.socket.socket() as other:
        other.bind((server.HOST, 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(BadInput, match=str(port)):
            server.Server(openings.Opening("x", "."), port)
    with pytest.raises(BadInput, match="--port 70000"):
        server.Server(openings.Opening("x", "."), 70000)


def points(here: dict[str, float], **named: Any) -> Any:
    found = SimpleNamespace(here=here, place=lambda n: f"ctl.law.{n}")
    found.__dict__.update(named)
    return found


def test_a_region_needs_two_gains_that_can_be_moved(monkeypatch) -> None:
    asked = SimpleNamespace(sliders=[slider("ctl.law.k"), slider("ctl.law.c"), MASS])
    gains = SimpleNamespace(name="own gains")
    for here, names, has in (
        ({"k": 1.0, "x": 2.0}, None, "k"), ({"k": 1.0, "c": 0.0}, None, "k"),
        ({"k": 1.0, "c": 2.0}, ("k", "x"), "k, c"), ({}, None, "none"),
    ):  # fmt: skip
        told(monkeypatch, safety, "points_of_gains", points(here))
        with pytest.raises(BadInput, match=f"own gains.* {has}$"):
            list(safety.region_rows(asked, gains, {}, names))
    assert safety.movable_gains(asked, points({"c": 2.0, "x": 1.0, "k": 0.5, "d": -1})) == {
        "c": "ctl.law.c", "k": "ctl.law.k",
    }  # fmt: skip


def test_a_worst_run_has_a_panel_for_each_signal_or_says_why_there_is_none(monkeypatch) -> None:
    at = points({}, at=lambda moved: ("system", {"k": 1}))
    asked = told(monkeypatch, safety, "points_of_gains", at)
    rows = {"t": ("s", [0.0, 1.0]), "d": ("N", [1.0, -1.0]), "e": ("m/s", [3.0, 4.0])}
    lines = ["the disturbance", "what it does"]
    found = SimpleNamespace(lines=lambda: lines, trajectory=rows)
    given = told(monkeypatch, safety.systems, "worst_disturbance", found)
    gains = SimpleNamespace(name="own gains")
    drawn, said_ = safety.worst_run("rig", gains, {"m": 2.0})
    assert (asked[0], given[0]) == (("rig", gains, {"m": 2.0}), ("system", {"k": 1}))
    assert said_ == lines
    assert drawn.time.tolist() == [0.0, 1.0]
    assert [(p.name, p.series[0].name, p.series[0].looks) for p in drawn.panels] == [
        ("disturbance", "d", "wanted"), ("e", "e", "main"),
    ]  # fmt: skip
    for panel, (unit, values) in zip(drawn.panels, list(rows.values())[1:], strict=True):
        scale, shown = safety.display_scale(unit)
        assert panel.unit == shown
        assert panel.series[0].values == pytest.approx(scale * np.array(values))
    assert list(rows) == ["t", "d", "e"]  # as they were
    found.trajectory = {"d": rows["d"]}
    with pytest.raises(BadInput, match="the disturbance"):
        safety.worst_run("rig", gains, {})
    told(monkeypatch, safety.systems, "worst_disturbance", None)
    with pytest.raises(BadInput, match="own gains"):
        safety.worst_run("rig", gains, {})


def test_a_study_is_saved_as_a_file_of_its_loop(tmp_path: Path, monkeypatch) -> None:
    desk_ = SimpleNamespace(
        home="study", text=None, loop="pid", scenario="wet", rig=lambda text: rig(),
        within=lambda name: tmp_path / name,
    )  # fmt: skip
    written = told(monkeypatch, saved_files.loop_files, "loop_file_text", "a = 1\n")
    numbered = told(monkeypatch, saved_files, "text_with_numbers", ("a = 2\n", ["a note"]))
    found = saved_files.save_desk(desk_, "", None, {"car.m": 2.5})
    assert found == {"file": "pid.toml", "text": "a = 2\n", "notes": ["a note"]}
    assert (tmp_path / "pid.toml").read_text() == "a = 2\n"
    assert written == [("study:pid@wet", "pid.toml")]
    ((path, text, loop, numbers, moved),) = numbered
    assert (path, text, loop, numbers) == ("pid.toml", "a = 1\n", "pid", {"car.m": 2.5})
    assert [s.name for s in moved] == ["car.m", "car.a"]
    with pytest.raises(BadInput, match="exists"):
        saved_files.save_desk(desk_, "", None, {})


def test_a_number_that_no_key_sets_is_not_saved(monkeypatch) -> None:
    monkeypatch.setattr(saved_files, "_loop", lambda path, text, loop: LOOP)
    sliders = rig().sliders
    assert saved_files.text_with_numbers("a.toml", "m = 2\n", "loop", {"car.m": 2.0}, sliders) == (
        "m = 2\n", [],
    )  # fmt: skip
    with pytest.raises(BadInput, match=r"car.m.* 3 kg"):
        saved_files.text_with_numbers("a.toml", "m = 2\n", "loop", {"car.m": 3.0}, sliders)


@dataclass
class Part:
    """A part of a file whose keys have choices, a unit, or nothing."""

    way: Literal["fast", "slow"] | None = field(default=None, metadata={"doc": "how it goes"})
    mass: float = field(default=1.0, metadata={"doc": "of all", "unit": "kg"})
    share: float = field(default=1.0, metadata={"doc": "of it", "unit": "1"})


def test_values_of_a_key_are_its_choices_or_an_example_with_its_unit() -> None:
    assert texts._values(Part, [Part], "way") == [
        {"insert": '"fast"', "meaning": "how it goes"},
        {"insert": '"slow"', "meaning": "how it goes"},
    ]
    assert texts._values(Part, [Part], "mass") == [{"insert": '"1 kg"', "meaning": "of all"}]
    assert '"' not in "".join(v["insert"] for v in texts._values(Part, [Part], "share"))
    assert texts._values(Part, [Part], "nothing") == []


@pytest.mark.parametrize("gone", ["starlette", "uvicorn", "websockets"])
def test_a_server_without_its_packages_says_which_one(monkeypatch, gone) -> None:
    server = pytest.importorskip("slipctl.workbench.web.server")
    monkeypatch.setitem(sys.modules, gone, None)
    with pytest.raises(BadInput, match=gone):
        server.Server(openings.Opening("x", "."), 0)
