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

from slipctl.commands import cli, run
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
    """What is checked before a command, in its order, and what it is asked, which it only notes."""
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
        assert cli.main(words) == 2
        said = capsys.readouterr().err
        assert ("Traceback" in said) == shown
        assert said.endswith("ZeroDivisionError: by nothing\n")


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
