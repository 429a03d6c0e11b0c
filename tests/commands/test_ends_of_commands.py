"""How commands begin and end: a shell that completes, a closed output, what is raised last."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl.commands import c, cli, run
from slipctl.commands.certificates import certify
from slipctl.commands.library import open as open_command
from slipctl.errors import BadInput, RunFailed
from slipctl.run.interrupts import KEPT

# ---- the process ---------------------------------------------------------------------------------


def test_a_shell_that_completes_is_answered_before_the_words_are_read(monkeypatch, capsys) -> None:
    asked: list[Any] = []
    monkeypatch.setitem(
        sys.modules, "argcomplete", SimpleNamespace(autocomplete=lambda p: asked.append(p.prog))
    )
    assert cli.main(["--version"]) == 0
    assert asked == []
    monkeypatch.setenv("_ARGCOMPLETE", "1")
    assert cli.main(["--version"]) == 0
    assert asked == ["slipctl"]
    monkeypatch.setitem(sys.modules, "argcomplete", None)  # is not installed
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("loaded", [True, False])
def test_the_backend_of_a_notebook_is_left_where_pictures_are_drawn_already(
    loaded: bool, monkeypatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://a_notebook")
    if loaded:
        monkeypatch.setitem(sys.modules, "matplotlib", SimpleNamespace())
    else:
        monkeypatch.delitem(sys.modules, "matplotlib", raising=False)
    assert cli.main(["--version"]) == 0
    assert os.environ["MPLBACKEND"] == ("module://a_notebook" if loaded else "agg")


def test_what_is_printed_into_a_closed_output_is_told(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert cli.main(["certify"]) == 1
    assert capsys.readouterr().err == ("slipctl: standard output is closed; nothing was printed\n")


def test_a_reader_that_goes_away_ends_a_command_quietly(monkeypatch, tmp_path: Path) -> None:
    """What is left goes nowhere."""

    def gone(options: Any, command: str) -> int:
        raise BrokenPipeError(errno.EPIPE, "closed")

    monkeypatch.setattr(cli, "import_module", lambda name: SimpleNamespace(answer=gone))
    with (tmp_path / "out.txt").open("w") as file:
        monkeypatch.setattr(sys, "stdout", file)
        assert cli.main(["certify"]) == 0
        print("left", flush=True)
        monkeypatch.undo()
    assert (tmp_path / "out.txt").read_text() == ""


def test_behind_its_answer_no_interrupt_is_heard(monkeypatch) -> None:
    done: list[Any] = []
    monkeypatch.setattr(cli, "main", lambda: done.append("main") or 7)
    monkeypatch.setattr(cli.signal, "signal", lambda *given: done.append(given))
    assert cli.program() == 7
    assert done == ["main", (signal.SIGINT, signal.SIG_IGN)]


@pytest.fixture
def asked(monkeypatch) -> list[Any]:
    """What a command is asked, where it only notes that; what is checked before it, in its order."""
    done: list[Any] = []

    def noted(options: Any, command: str) -> int:
        done.append((options.command, command))
        return 3

    def module(name: str) -> Any:
        done.append(name)
        return SimpleNamespace(answer=noted)

    monkeypatch.setattr(cli, "check_one_tree", lambda: done.append("tree"))
    monkeypatch.setattr(cli, "check_environment", lambda: done.append("environment"))
    monkeypatch.setattr(cli, "tell_threads", lambda: ["too many", "cores"])
    monkeypatch.setattr(cli, "import_module", module)
    monkeypatch.setattr(cli, "_talk", lambda options: done.append(options.quiet))
    return done


@pytest.mark.parametrize("given", [True, False])
def test_a_command_is_answered_by_its_module_after_what_is_checked(
    given: bool, asked: list[Any], monkeypatch, capsys
) -> None:
    """With the words of the process, where none are given; its code is that of the process."""
    paces: list[Any] = []
    monkeypatch.setattr(cli.gc, "set_threshold", lambda *pace: paces.append(pace))
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.delenv("MPLBACKEND", raising=False)
    words = ["-q", "certify", "a b"]
    monkeypatch.setattr(sys, "argv", ["/bin/slipctl", *words])
    assert cli.main(words if given else None) == 3
    assert asked == ["tree", "environment", True, "slipctl.commands.certificates.certify",
                     ("certify", "slipctl -q certify 'a b'")]  # fmt: skip
    assert capsys.readouterr().err == "slipctl: too many\nslipctl: cores\n"
    assert paces == [cli.RARELY]
    assert os.environ.pop("OPENBLAS_NUM_THREADS") == "1"
    assert "MPLBACKEND" not in os.environ


@pytest.mark.parametrize(("words", "said"), [
    (["list", "a\0b"], "a null character stands in"), ([], "say what to do: list, show"),
])  # fmt: skip
def test_words_that_ask_for_nothing_are_refused_before_anything_is_checked(
    words, said, asked: list[Any], capsys
) -> None:
    assert cli.main(words) == 2
    assert said in capsys.readouterr().err
    assert asked == []


@pytest.mark.parametrize(("why", "code", "said"), [
    (KeyboardInterrupt(KEPT), 130, f"stopped; {KEPT}"), (KeyboardInterrupt(), 130, "stopped"),
    (BadInput("no such loop"), 2, "no such loop"), (RunFailed("NaN"), 1, "run failed: NaN"),
])  # fmt: skip
def test_what_ends_a_command_is_one_line_and_a_code(why, code, said, monkeypatch, capsys) -> None:
    def ends(options: Any, command: str) -> int:
        raise why

    monkeypatch.setattr(cli, "import_module", lambda name: SimpleNamespace(answer=ends))
    monkeypatch.setattr(cli, "tell_threads", list)
    assert cli.main(["list"]) == code
    assert capsys.readouterr().err == f"slipctl: {said}\n"


@pytest.mark.parametrize("word", ["-v", "--verbose"])
def test_where_a_fault_came_from_is_shown_where_it_is_asked_for(word, monkeypatch, capsys) -> None:
    def breaks(options: Any, command: str) -> int:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(cli, "import_module", lambda name: SimpleNamespace(answer=breaks))
    for words, shown in (([word, "list"], True), (["list"], False)):
        assert cli.main(words) == 1
        said = capsys.readouterr().err
        assert ("Traceback" in said) == shown
        assert said.endswith("slipctl: a fault of slipctl, ZeroDivisionError: by nothing; -v shows"
                             " where\n")  # fmt: skip


@pytest.mark.parametrize(("quiet", "refused"), [(False, False), (True, False), (False, True)])
def test_a_page_is_opened_once_it_is_known_to_be_there(quiet, refused, monkeypatch, capsys) -> None:
    """In a browser, unless that is not wanted; what is refused is closed again."""
    done: list[Any] = []

    def check(opening: Any) -> None:
        done.append("check")
        if refused:
            raise BadInput("no such loop")

    class Server:
        address = "http://127.0.0.1:8000/?token=x"
        windows = SimpleNamespace(close=lambda: done.append("close"))

        def __init__(self, opening: Any, port: int) -> None:
            done.append((opening.name, port))

        def run(self) -> None:
            done.append("run")

    from slipctl.workbench.sources import openings
    from slipctl.workbench.web import server

    monkeypatch.setattr(openings, "opening_of_name", lambda *given: SimpleNamespace(name=given))
    monkeypatch.setattr(openings, "check_opening", check)
    monkeypatch.setattr(server, "Server", Server)
    monkeypatch.setattr(open_command.webbrowser, "open", lambda at: done.append(("opened", at)))
    monkeypatch.setattr(
        open_command, "threading", SimpleNamespace(Thread=lambda target, args, daemon: (
            SimpleNamespace(start=lambda: target(*args)))),
    )  # fmt: skip
    options: Any = SimpleNamespace(
        name="toy:pid", files=["a.py"], no_compile=True, port=8000, no_browser=quiet
    )
    began = [(("toy:pid", ["a.py"], False), 8000), "check"]
    if refused:
        with pytest.raises(BadInput, match="no such loop"):
            open_command.answer(options, "")
        assert done == [*began, "close"]
        return
    assert open_command.answer(options, "") == 0
    assert done == [*began, *([] if quiet else [("opened", Server.address)]), "run"]
    assert capsys.readouterr().out == f"{Server.address}\n"


# ---- a run ---------------------------------------------------------------------------------------


@pytest.fixture
def running(monkeypatch, tmp_path: Path) -> Any:
    """A run of two controllers on two rails, whose pieces only say that they are asked."""
    made: Any = object.__new__(run._Run)
    done: list[Any] = []
    cases = [SimpleNamespace(scenario=SimpleNamespace(name=s), loops={"pid": 1, "sta": 2})
             for s in ("dry", "ice")]  # fmt: skip
    made.results = SimpleNamespace(cases=cases, failed={}, study="study", quick=True)
    made.keep = SimpleNamespace(out=tmp_path, clear=lambda wanted: done.append(("clear", wanted)))
    made.options = SimpleNamespace(no_compile=False, json=False)
    made.models, made.command, made.cores, made.experiments = "models", "CMD", "cores", ["one"]
    made.unprinted, made.done = None, done
    made.progress = SimpleNamespace(end=lambda: done.append("end"))
    made._metrics = lambda state="": done.append(("metrics", state))
    made._claims = lambda: done.append("claims") or ["V"]
    made._tell = lambda text: done.append(("tell", text))
    made._question, made._headline = lambda: "Q", lambda: "H"
    made._found_tables = lambda: done.append("tables")
    made._summary = lambda verdicts: f"S {verdicts}"
    made._stopped = lambda: done.append("stopped")
    made._json = lambda: "{}"
    asked: dict[str, Any] = {}
    monkeypatch.setattr(run.execution, "run", lambda *given, **more: asked.update(more, of=given))
    monkeypatch.setattr(run.results_folder, "section_jobs", lambda results: "jobs")
    monkeypatch.setattr(run.results_folder, "save_pages",
                        lambda results, judged, *rest: done.append((judged(), *rest)))  # fmt: skip
    made.asked = asked
    return made


def test_a_run_is_written_before_it_is_summed_up(running, capsys) -> None:
    """What still runs is said in its metrics; the claims are judged once."""
    out = running.keep.out
    assert running.answer() == 0
    loops = ("pid", "sta")
    assert running.done == [
        ("clear", {"dry": loops, "ice": loops}), ("metrics", "still running, or stopped before its"
                                                  " end"),
        ("tell", "Q"), "tables", "end", ("tell", "H"), ("metrics", ""), "claims",
        (["V"], out, "CMD", "cores", {}), ("tell", "S ['V']"),
    ]  # fmt: skip
    assert running.asked["of"] == ("study", running.results.cases, "models")
    assert running.asked["experiments"] == ["one"]
    assert running.asked["compile"] is True
    assert (running.asked["quick"], running.asked["beside"]) == (True, "jobs")
    assert capsys.readouterr().out == f"{out / 'report.html'}\n"


def test_of_a_run_that_failed_each_part_is_named(running, capsys, caplog, monkeypatch) -> None:
    monkeypatch.setattr(run.log, "propagate", True)
    running.results.failed = {"dry/pid": "too fast", "ice/sta": "a fault"}
    assert running.answer() == 1
    assert [r.getMessage() for r in caplog.records] == [
        "dry/pid failed: too fast", "ice/sta failed: a fault"]  # fmt: skip
    assert "report.html" in capsys.readouterr().out
    running.results.failed = {"report.html": "no room"}
    assert running.answer() == 1
    assert capsys.readouterr().out == ""
    running.results.failed = {}
    running.options.json = True
    running.done.clear()
    assert running.answer() == 0
    assert json.loads(capsys.readouterr().out) == {}
    assert ("tell", "S ['V']") not in running.done


def test_a_run_that_is_stopped_says_what_is_kept(running, monkeypatch) -> None:
    noted: list[int] = []
    monkeypatch.setattr(run.interrupts, "note_interrupt", lambda: noted.append(1))

    def stop(*given: Any, **more: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run.execution, "run", stop)
    with pytest.raises(KeyboardInterrupt, match=KEPT):
        running.answer()
    assert running.done[-1] == "stopped"
    assert noted == [1]


def test_what_could_not_be_printed_is_raised_at_the_end(running, capsys) -> None:
    running.unprinted = BrokenPipeError(errno.EPIPE, "closed")
    with pytest.raises(BrokenPipeError, match="closed"):
        running.answer()
    assert running.done[-1] == ("tell", "S ['V']")
    assert capsys.readouterr().out == ""


# ---- what stands in an answer --------------------------------------------------------------------


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
    from slipctl.commands.arguments import parser

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
