"""What commands make of what they are given: what computes stands behind is a stub here."""

from __future__ import annotations

import argparse
import errno
import json
import logging
import math
import os
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl import Input, Output, Param, State, flow
from slipctl.certify.boundary import Farthest
from slipctl.commands import arguments, cli, fit_log, pil, run, sweep, tune
from slipctl.commands.certificates import certify_loop, check
from slipctl.commands.library import show
from slipctl.errors import BadInput, Faults, RunFailed
from slipctl.run import store
from slipctl.run.logs.recorded_log import Recording
from slipctl.run.metrics import Metric
from slipctl.study.cache import Keep
from slipctl.tables.table import Table

# ---- what a terminal shows -----------------------------------------------------------------------


@pytest.fixture
def terminal(monkeypatch):
    """Stdout that is a terminal of 40 columns; another one can be put there."""
    sys = SimpleNamespace(stdout=SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(show, "sys", sys)
    monkeypatch.setattr(show.shutil, "get_terminal_size", lambda least: os.terminal_size((40, 9)))
    return sys


def test_a_text_that_goes_elsewhere_stays_as_it_is(terminal):
    text = "Signals\n" + "\n".join(f"  state x{k} {'long ' * 20}" for k in range(60))
    assert show._for_terminal(text, False) != text
    terminal.stdout.isatty = lambda: False
    assert show._for_terminal(text, False) == text
    terminal.stdout = None
    assert show._for_terminal(text, False) == text


@pytest.mark.parametrize("many", [show.MANY, show.MANY + 1])
def test_long_sections_are_folded_and_their_rows_counted(terminal, many):
    """Of signals states and outputs, all of a Jacobian; parameters and other sections stay."""
    params = [f"  param   p{k}" for k in range(3)]
    states = [f"  state   x{k}" for k in range(many - 5)] + ["  output  y", "  output  z"]
    other = [f"  state   o{k}" for k in range(many)]
    text = "\n".join(["Signals", *params, *states]) + "\n\n" + "\n".join(["Other", *other])
    text += "\n\n" + "\n".join(["Jacobian", *(f"  dx{k}/dt" for k in range(many))])
    signals, others, jacobian = show._for_terminal(text, False).split("\n\n")
    assert others.split("\n") == ["Other", *other]
    if many == show.MANY:
        assert signals.split("\n") == ["Signals", *params, *states]
        assert len(jacobian.split("\n")) == 1 + many
    else:
        assert signals.split("\n")[:-1] == ["Signals", *params]
        assert str(many - 3) in signals.split("\n")[-1]
        head, told = jacobian.split("\n", 1)
        assert head == "Jacobian"
        assert str(many) in told
        assert "dx" not in told
    assert show._for_terminal(text, True) == text
    plain = "\n".join(["Signals", *(f"  param   p{k}" for k in range(many))])
    assert show._for_terminal(plain, False) == plain  # nothing in it is hidden


def test_a_row_that_does_not_fit_gives_up_its_columns_and_hangs():
    row = "  param   mass          8000 kg   of the car without load and without a driver"
    assert show._hung(row, len(row)) == [row]
    found = show._hung(row, len(row) - 1)
    assert found[0].startswith("  param  mass  8000 kg")
    assert all(len(line) < len(row) for line in found)
    found = show._hung(row, 40)
    assert len(found) == 3
    assert all(len(line) - len(line.lstrip()) == 10 for line in found[1:])
    assert all(len(line) <= 40 for line in found)
    assert " ".join(found).split() == row.split()
    word = "    " + "x" * 50
    assert show._hung(word, 40)[-1].strip() == "x" * 50  # a word is not broken


# ---- options -------------------------------------------------------------------------------------


def parsed(declared, *words):
    p = argparse.ArgumentParser()
    for names, more in declared:
        p.add_argument(*names, **more)
    return p.parse_args(list(words))


def test_an_option_is_declared_as_its_help_shows_it():
    switch = arguments.option("--quick", "soon")
    assert parsed([switch]).quick is False
    assert parsed([switch], "--quick").quick is True
    one = arguments.option("--jobs N", "many", type=int)
    assert parsed([one]).jobs is None
    assert parsed([one], "--jobs", "4").jobs == 4
    assert one[1]["metavar"] == "N"
    many = arguments.option("--loop L ...", "which")
    assert parsed([many]).loop == []
    assert parsed([many], "--loop", "a", "b", "--loop", "c").loop == ["a", "b", "c"]
    assert many[1]["metavar"] == "L"
    both = arguments.option("--map|--column A=B", "which")
    assert parsed([both], "--column", "x=y").map == "x=y"
    assert both[0] == ("--map", "--column")
    chosen = arguments.option("--decimal", "mark", choices=(".", ","))
    assert parsed([chosen], "--decimal", ",").decimal == ","
    assert chosen[1]["help"] == "mark"
    place = arguments.word("study", "STUDY", "name", nargs="?")
    assert parsed([place], "toy").study == "toy"
    assert parsed([place]).study is None
    assert place == (("study",), {"metavar": "STUDY", "help": "name", "nargs": "?"})


# ---- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (BadInput("no such loop"), 2, ["no such loop"]),
        (Faults(["one is wrong", "two is wrong"]), 2, ["one is wrong", "two is wrong"]),
        (RunFailed("a step"), 1, ["a step"]),
        (OSError(errno.ENOSPC, "No space", "/x/y"), 1, ["write /x/y: No space"]),
        (OSError(errno.EDQUOT, "Quota", "/x/y"), 2, ["write /x/y: Quota"]),
        (OSError(errno.ENOENT, "No such", "/x/y"), 2, ["read or write /x/y: No such"]),
        (OSError(errno.ENOENT, "No such"), 2, ["read or write: No such"]),
        (OSError("odd"), 2, ["read or write: odd"]),
        (KeyError("k"), 1, ["KeyError"]),
        (SystemExit("left"), 1, ["SystemExit: left"]),
        (ValueError("first\nsecond"), 1, ["ValueError: first;"]),
    ],
)  # fmt: skip
def test_every_error_is_a_line_and_a_code(capsys, monkeypatch, error, code, said):
    monkeypatch.setattr(cli, "_silence", lambda: None)
    assert cli._explain(error, False) == code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(said)
    for line, words in zip(lines, said, strict=True):
        assert line.startswith("slipctl: ")
        assert words in line


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EBADF, errno.ENOENT])
def test_a_full_standard_output_is_no_file(capsys, monkeypatch, code):
    """What is left of it goes nowhere; a file says its name instead."""
    silent = []
    monkeypatch.setattr(cli, "_silence", lambda: silent.append(1))
    full = code != errno.ENOENT
    found = cli._explain(OSError(code, "told"), False)
    assert found == (1 if code in (errno.ENOSPC, errno.EIO) else 2)
    assert ("standard output" in capsys.readouterr().err) == full
    assert silent == ([1] if full else [])


def test_where_an_error_came_from_is_shown_when_asked(capsys):
    try:
        raise BadInput("told") from ZeroDivisionError("deep")
    except BadInput as error:
        told = error
    for verbose in (False, True):
        cli._explain(told, verbose)
        text = capsys.readouterr().err
        assert ("ZeroDivisionError" in text) == verbose
        assert text.splitlines()[-1] == "slipctl: told"
    cli._explain(BadInput("alone"), True)
    assert capsys.readouterr().err == "slipctl: alone\n"


# ---- draws of a statement again ------------------------------------------------------------------


@pytest.fixture
def statement(tmp_path, monkeypatch):
    """A file with a statement of 4 draws, and a world that gives k-th draw the number k/3."""
    worlds = []

    class World:
        def __init__(self, loop, scenario, ensemble, **more):
            self.given, self.drawn, self.free = (loop, scenario, ensemble, more), [], []
            worlds.append(self)

        def draw(self, attempt, k):
            self.drawn.append((attempt, k))
            return k

        def metrics(self, gains, k):
            self.free.append(gains)
            if k == 2:
                raise RunFailed("it diverged")
            return {"distance": Metric(k / 3, "m"), "slip": Metric([k / 7, k / 9], "m/s")}

    case = SimpleNamespace(loops={"pid": "LOOP"}, scenario="SCENARIO", known={"k": 1})
    asked = SimpleNamespace(loop="pid", scenario="base", case=case,
                            study=SimpleNamespace(signals="SIGNALS"))  # fmt: skip
    read = []
    monkeypatch.setattr(check.Request, "read", lambda *a: read.append(a) or asked)
    monkeypatch.setattr(check, "read_ensemble", lambda file, given: ("ENSEMBLE", given))
    monkeypatch.setattr(check, "World", World)
    monkeypatch.setattr(check.statement, "repeated_draws",
                        lambda payload, many, draws: [3, 0, 2, 1][:many])  # fmt: skip
    inf = math.inf
    said = {
        "set": ["pid.K=2"], "swapped": ["ctl=mine"], "ensemble": {"draw": {}}, "seed": 7,
        "objective": "2*distance", "draws": 4, "attempt": 2,
        "values": [(2 * (k / 3)).hex() for k in (0, 1)] + [inf.hex(), (2 * (3 / 3)).hex()],
        "claims": [
            {"metric": "slip", "upper": True,
             "values": [(k / 7).hex() for k in (0, 1)] + [inf.hex(), (3 / 7).hex()]},
            {"metric": "slip", "upper": False,
             "values": [(k / 9).hex() for k in (0, 1)] + [(-inf).hex(), (3 / 9).hex()]},
        ],
    }  # fmt: skip
    payload = {"loop": "toy:pid@base", "gains": {"K": {"value": 2}, "T": {"value": "0.5"}},
               "statistical": said, "slipctl": "1"}  # fmt: skip
    file = tmp_path / "c.json"

    def written(**more):
        file.write_text(json.dumps({**payload, **more}), encoding="utf-8")
        return str(file)

    return SimpleNamespace(written=written, payload=payload, said=said, worlds=worlds, read=read,
                           asked=asked)  # fmt: skip


def test_draws_that_run_again_give_the_same_bits(statement):
    text = check.rerun(statement.written(), 4)
    assert text.startswith("4 draws")
    assert text.endswith("3, 0, 2, 1")
    (world,) = statement.worlds
    loop, scenario, ensemble, more = world.given
    assert (loop, scenario, ensemble) == ("LOOP", "SCENARIO", ("ENSEMBLE", {"draw": {}}))
    assert more == {"signals": "SIGNALS", "known": {"k": 1}, "seed": 7, "free": ["K", "T"]}
    assert world.drawn == [(check.FIRST_PROOF + 1, k) for k in (3, 0, 2, 1)]
    assert world.free == [{"K": 2.0, "T": 0.5}] * 4
    assert statement.read == [("toy:pid@base", ["pid.K=2"], ["ctl=mine"])]
    assert "1 draws" in check.rerun(statement.written(), 1)


@pytest.mark.parametrize(
    ("where", "draw"),
    [(("values",), 3), (("values",), 2), (("claims", 0, "values"), 1), (("claims", 1, "values"), 0),
     (("claims", 0, "values"), 2), (("claims", 1, "values"), 2)],
)  # fmt: skip
def test_one_bit_of_one_draw_is_noticed(statement, where, draw):
    at = statement.said
    for key in where:
        at = at[key]
    value = float.fromhex(at[draw])
    at[draw] = (math.nextafter(value, 1e9) if math.isfinite(value) else -value).hex()
    with pytest.raises(RunFailed, match=f"draw {draw} "):
        check.rerun(statement.written(), 4)
    if draw != 3:
        assert check.rerun(statement.written(), 1)  # the first one that is asked is as it was


def test_a_file_without_a_statement_is_refused(statement):
    for wrong in ({"statistical": None}, {"gains": {"K": {"value": "x"}}}, {"gains": None},
                  {"gains": {"K": {}}}, {"gains": {"K": 2}}, {"gains": [1]}):  # fmt: skip
        with pytest.raises(BadInput):
            check.rerun(statement.written(**wrong), 1)
    for key, value in (("set", "x"), ("set", [1]), ("swapped", {"a": 1}), ("swapped", [None])):
        with pytest.raises(BadInput):
            check.rerun(statement.written(statistical={**statement.said, key: value}), 1)
    for name in ("loop", "scenario"):
        setattr(statement.asked, name, "")
        with pytest.raises(BadInput):
            check.rerun(statement.written(), 1)
        setattr(statement.asked, name, "pid")


@pytest.mark.parametrize("as_json", [False, True])
def test_a_certificate_that_holds_is_told(statement, monkeypatch, capsys, as_json):
    monkeypatch.setattr(check.certify, "check", lambda file: f"{file} holds")
    file = statement.written()
    for many in (None, 2):
        options = SimpleNamespace(file=file, rerun=many, json=as_json)
        assert check.answer(options, "slipctl check") == 0
        out = capsys.readouterr().out
        said = [f"{file} holds"] + ([] if many is None else [check.rerun(file, 2)])
        if as_json:
            assert json.loads(out) == {"file": file, "holds": True, "says": said}
        else:
            assert out == "\n".join(said) + "\n"
    with pytest.raises(BadInput):
        check.answer(SimpleNamespace(file=file, rerun=0, json=as_json), "slipctl check")


# ---- how far a number may go ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("up", "certified", "refuted", "has", "lacks"),
    [
        (True, 3.0, 4.0, ["CERTIFIED up to 3 m", "REFUTED   from 4 m"], ["nowhere", "no limit"]),
        (False, 3.0, 2.0, ["CERTIFIED down to 3 m", "REFUTED   from 2 m"], ["nowhere"]),
        (True, None, 1.0, ["CERTIFIED nowhere from 1 to 9", "REFUTED   from 1 m"], ["no limit"]),
        (True, 9.0, None, ["CERTIFIED up to 9 m", "no limit was found up to 9 m"], ["REFUTED"]),
        (False, 1.0, None, ["down to 1 m", "no limit was found up to 1 m"], ["REFUTED"]),
        (True, 5.0, None, ["up to 5 m", "REFUTED   nowhere up to 9 m"], ["no limit"]),
        (False, 5.0, None, ["down to 5 m", "REFUTED   nowhere up to 1 m"], ["no limit"]),
    ],
)  # fmt: skip
def test_ends_of_a_number_are_told_with_their_side(up, certified, refuted, has, lacks):
    tried = tuple((v, "x") for v in (5.0, 1.0, 9.0))
    rows = certify_loop._told(Farthest("W", "m", up, certified, refuted, tried))
    assert len(rows) == 3
    assert all(row.startswith("  ") for row in rows)
    text = "\n".join(rows)
    assert all(words in text for words in has)
    assert not any(words in text for words in lacks)
    assert "3 values" in rows[2]
    plain = certify_loop._told(Farthest("n", "1", up, certified, refuted, tried))
    assert not any(" m" in row.split(";")[0] for row in plain)


@pytest.fixture
def certificates(monkeypatch):
    """A study with certificates ``a`` and ``b`` of the loop pid and ``sta`` of its own."""
    gains = [SimpleNamespace(name=n, loop=loop) for n, loop in
             (("a", "pid"), ("b", "pid"), ("sta", "sta"))]  # fmt: skip
    study = SimpleNamespace(name="toy", certificates=SimpleNamespace(gains=gains))
    guarded = []

    def find(name):
        last = name.rpartition(":")[2]
        return study, [g for g in gains if last in (g.name, g.loop)]

    asked = []
    monkeypatch.setattr(certify_loop, "find", find)
    monkeypatch.setattr(certify_loop, "check_guards", guarded.append)
    monkeypatch.setattr(certify_loop.Request, "of", lambda s, loop, settings: asked.append(
        (s, loop, list(settings))) or SimpleNamespace(chosen=(f"loop {loop}", "case")))  # fmt: skip
    return SimpleNamespace(gains=gains, study=study, guarded=guarded, asked=asked)


def test_one_certificate_of_a_loop_is_chosen_by_name(certificates):
    c = certificates
    assert certify_loop.one("toy:sta") == (c.gains[2], "loop sta")
    assert certify_loop.one("toy:b", ["K=2"]) == (c.gains[1], "loop pid")
    assert c.guarded == ["loop sta", "loop pid"]
    assert c.asked == [(c.study, "sta", []), (c.study, "pid", ["K=2"])]
    with pytest.raises(BadInput, match="toy:a, toy:b"):
        certify_loop.one("toy:pid")
    c.gains[1].name = "pid"  # one of them has the name of the loop
    assert certify_loop.one("toy:pid") == (c.gains[1], "loop pid")


# ---- tune ----------------------------------------------------------------------------------------


@pytest.fixture
def tuned(tmp_path, monkeypatch):
    """What is found when something is tuned, and what the search was asked."""
    asked: dict[str, Any] = {}
    scenario = SimpleNamespace(name="base")
    case = SimpleNamespace(loops={"pid": "LOOP"}, scenario=scenario, known="KNOWN")
    study = SimpleNamespace(certificates=SimpleNamespace(gains=("G",)), signals="SIGNALS",
                            controller="ctl")  # fmt: skip
    request = SimpleNamespace(study=study, case=case, loop="pid", home="toy", settings=["K=1"],
                              swaps=["a=b"])  # fmt: skip
    found = SimpleNamespace(promises=SimpleNamespace(gains=()), statement=None, front=())

    def search(*given, **more):
        asked.update(more, given=given)
        more["tell"]("a line")
        if isinstance(found, BaseException):
            raise found
        return asked.get("answer", found)

    monkeypatch.setattr(tune, "_world_of", lambda options: (request, "ENSEMBLE"))
    monkeypatch.setattr(tune, "promises_of_loop", lambda *a: ("PROMISES", *a))
    monkeypatch.setattr(tune, "tune", search)
    monkeypatch.setattr(tune.gain_files, "gains_text", lambda f, c: f"gains of {c}")
    monkeypatch.setattr(tune.gain_files, "certificate_of", lambda f, c, s, w: {"of": [c, s, w]})
    monkeypatch.setattr(tune.gain_files, "front_of", lambda f, c: {"front": c})
    monkeypatch.setattr(tune.gain_files, "found_of", lambda f, c: {"found": c})
    monkeypatch.setattr(tune.page, "page", lambda f, c: f"page of {c}")
    monkeypatch.setattr(tune.page, "text", lambda f: "text of it")
    monkeypatch.setattr(tune.page, "front_picture", lambda f: "PICTURE")
    drawn = []
    monkeypatch.setattr(tune.plots, "save", lambda *a: drawn.append(a))
    options = SimpleNamespace(
        name="toy:pid", objective="distance", out=str(tmp_path / "o"), prove=False, quiet=True,
        free=["K=1:2"], limits=["slip<=1"], samples=3, seed=4, runs=5, held_out=6, jobs=7,
        no_compile=False, json=False,
    )  # fmt: skip
    return SimpleNamespace(options=options, found=found, asked=asked, out=tmp_path / "o",
                           drawn=drawn, request=request)  # fmt: skip


def files(folder):
    return sorted(p.name for p in folder.iterdir())


def test_a_search_is_asked_what_the_line_says_and_its_gains_are_written(tuned, capsys):
    tuned.out.mkdir()
    assert tune.answer(tuned.options, "CMD") == 0
    more = dict(tuned.asked)
    assert more.pop("given") == ("LOOP", ["K=1:2"], "distance", "ENSEMBLE", ["slip<=1"])
    more.pop("tell")
    more.pop("progress")
    assert more == {
        "scenario": tuned.request.case.scenario, "signals": "SIGNALS", "known": "KNOWN",
        "gains": ("PROMISES", ("G",), "pid", "base"), "out": tuned.out, "samples": 3, "seed": 4,
        "runs": 5, "held_out": 6, "prove": False, "controller": "ctl", "jobs": 7, "compile": True,
        "about": {"loop": "toy:pid@base", "set": ["K=1"], "swapped": ["a=b"], "command": "CMD"},
    }  # fmt: skip
    assert files(tuned.out) == ["gains.toml", "report.html"]
    assert (tuned.out / "gains.toml").read_text() == "gains of CMD"
    assert (tuned.out / "report.html").read_text() == "page of CMD"
    said = capsys.readouterr().out.split()
    assert said[:3] == ["text", "of", "it"]
    assert said[3:] == [str(tuned.out / n) for n in ("gains.toml", "report.html")]
    tuned.options.no_compile = True
    tune.answer(tuned.options, "CMD")
    assert tuned.asked["compile"] is False


@pytest.mark.parametrize("why", ["promises", "statement"])
def test_what_is_certified_and_a_front_have_files_of_their_own(tuned, capsys, why):
    tuned.out.mkdir()
    if why == "promises":
        tuned.found.promises.gains = ("one",)
    else:
        tuned.found.statement = {}
        tuned.found.front = ("a", "b")
    tune.answer(tuned.options, "CMD")
    names = capsys.readouterr().out.split("\n\n")[1].split()
    said = json.loads((tuned.out / "certificate.json").read_text())
    assert said == {"of": ["CMD", ["K=1"], ["a=b"]]}
    if why == "promises":
        assert files(tuned.out) == ["certificate.json", "gains.toml", "report.html"]
        wanted = ["gains.toml", "certificate.json", "report.html"]
        assert tuned.drawn == []
    else:
        assert json.loads((tuned.out / "front.json").read_text())["front"] == "CMD"
        wanted = ["gains.toml", "certificate.json", "front.json", "front.svg", "report.html"]
        assert tuned.drawn == [("PICTURE", tuned.out, "front", "CMD")]
    assert names == [str(tuned.out / n) for n in wanted]


def test_what_was_tuned_is_told_as_data(tuned, capsys):
    tuned.out.mkdir()
    tuned.options.json = True
    assert tune.answer(tuned.options, "CMD") == 0
    assert json.loads(capsys.readouterr().out) == {"found": "CMD", "folder": str(tuned.out)}


def test_a_search_that_is_stopped_leaves_its_best_gains(tuned, monkeypatch):
    tuned.out.mkdir()

    def stopped(*_, **__):
        raise tune.Stopped("BEST")

    monkeypatch.setattr(tune, "tune", stopped)
    monkeypatch.setattr(tune.gain_files, "gains_text", lambda f, c: f"{f} of {c}")
    with pytest.raises(KeyboardInterrupt, match=r"gains\.toml"):
        tune.answer(tuned.options, "CMD")
    assert files(tuned.out) == ["gains.toml"]
    assert (tuned.out / "gains.toml").read_text() == "BEST of CMD"


@pytest.mark.parametrize(("name", "value"), [("name", None), ("objective", []), ("out", "")])
def test_a_search_that_lacks_a_word_is_refused(tuned, name, value):
    setattr(tuned.options, name, value)
    with pytest.raises(BadInput):
        tune.answer(tuned.options, "CMD")
    assert not tuned.out.exists()


# ---- a processor ---------------------------------------------------------------------------------


class Compared:
    """A comparison that says so."""

    def __init__(self, failed, passed):
        self.data, self.passed = {"failed": failed}, passed

    def __str__(self):
        return "compared"


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize(
    ("failed", "passed", "why"),
    [([], True, None), (["load"], False, "longer"), (["load", "u"], False, "differs"),
     (["u"], False, "differs")],
)  # fmt: skip
def test_a_loop_on_a_processor_passes_or_says_why_not(
    tmp_path, monkeypatch, capsys, as_json, failed, passed, why
):
    asked = []

    def compare(*given):
        asked.append(given)
        return Compared(failed, passed)

    monkeypatch.setattr(pil.processor, "compare", compare)
    options = SimpleNamespace(
        name="toy:pid", target="cortex-m4", real="float", faults=False, seconds=2.0, clock="80 MHz",
        out=str(tmp_path / "p.json"), quiet=True, json=as_json,
    )  # fmt: skip
    if why is None:
        assert pil.answer(options, "CMD") == 0
    else:
        with pytest.raises(RunFailed, match=why):
            pil.answer(options, "CMD")
    out = capsys.readouterr().out
    assert (json.loads(out) == {"failed": failed}) if as_json else out == "compared\n"
    assert asked[0][:6] == ("toy:pid", "cortex-m4", "float", False, tmp_path / "p.json", 2.0)
    assert asked[0][7] == "80 MHz"
    assert asked[0][6].total == 2 + len(pil.processor.ROUNDINGS)
    for change in ({"real": "double"}, {"faults": True}):
        if why is None:
            pil.answer(SimpleNamespace(**{**vars(options), **change, "out": ""}), "CMD")
            assert asked[-1][6].total == 2
            assert asked[-1][4] is None


# ---- a run that is told as it goes ---------------------------------------------------------------


@pytest.fixture
def running(tmp_path, monkeypatch):
    """A run of two controllers in two scenarios that were not computed here."""
    told = []
    loops = {"pid": 1, "sta": 2}
    cases = [SimpleNamespace(scenario=SimpleNamespace(name=s), loops=loops) for s in ("dry", "ice")]
    study = SimpleNamespace(headline="", claims=(), name="toy", title="A toy", short="", doc="",
                            experiments={"one": 1, "two": 2, "three": 3})  # fmt: skip
    results = SimpleNamespace(study=study, cases=cases, metrics={}, failed={}, quick=False,
                              tables={})  # fmt: skip
    options = SimpleNamespace(quiet=True, settings=[], json=False, loops=[], scenarios=[], swaps=[])
    keep = Keep(tmp_path, "KEY")
    made = run._Run(options, "CMD", results, None, keep, None, ("two",))
    monkeypatch.setattr(made, "_tell", lambda text, end="\n\n": told.append((text, end)))
    monkeypatch.setattr(run, "answer_line", lambda r, scenario, loop: f"{scenario}/{loop}")
    return SimpleNamespace(run=made, results=results, told=told, out=tmp_path, study=study,
                           options=options, keep=keep)  # fmt: skip


def test_lines_of_controllers_come_in_the_order_of_the_file(running):
    """The second one waits for the first; a failed one has no line, and holds none up."""
    r = running
    r.run._heard("dry/sta", 0.5)
    assert r.told == []
    r.results.metrics["dry"] = {"sta": {}}
    r.run._heard("dry/sta", 1.0)
    assert r.told == []
    r.results.metrics["dry"]["pid"] = {}
    r.run._heard("dry/pid", 0.9)
    assert r.told == []
    r.run._heard("dry/pid", 1.0)
    assert r.told == [("scenario dry", "\n"), ("dry/pid", "\n"), ("dry/sta", "\n")]
    r.results.failed["ice/pid"] = "why"
    r.run._heard("ice/pid", 1.0)
    assert r.told[3:] == [("scenario ice", "\n"), ("", "\n")]
    r.results.metrics["ice"] = {"sta": {}}
    r.run._heard("ice/sta", 1.0)
    assert r.told[5:] == [("ice/sta", "\n\n")]
    assert r.run.unanswered == []
    r.run._heard("ice/sta", 1.0)
    assert len(r.told) == 6


def test_one_scenario_needs_no_name(running):
    r = running
    r.results.cases = r.results.cases[:1]
    made = run._Run(r.options, "CMD", r.results, None, r.keep, None, ())
    told = []
    made._tell = lambda text, end="\n\n": told.append((text, end))
    r.results.metrics["dry"] = {"sta": {}, "pid": {}}
    made._heard("dry/sta", 1.0)
    assert told == [("dry/pid", "\n"), ("dry/sta", "\n\n")]
    assert made.progress.total == 2
    assert r.run.progress.total == 5


def test_what_is_asked_stands_before_the_answers(running, monkeypatch):
    r = running
    monkeypatch.setattr(run, "changes", lambda results: "K = 2")
    assert r.run._question() == "toy: A toy\nK = 2"
    monkeypatch.setattr(run, "changes", lambda results: "")
    r.results.quick = True
    assert r.run._question() == "toy: A toy (quick)"
    r.study.doc, r.study.short = "Does it hold?", "It does."
    assert r.run._question() == "toy: A toy (quick)\n\nDoes it hold?\n\nIt does."


def test_a_headline_is_the_claim_that_a_study_names(running, monkeypatch):
    r = running
    claims = [SimpleNamespace(id="a"), SimpleNamespace(id="b")]
    r.study.claims = claims
    monkeypatch.setattr(run.claim_scope, "changes", lambda *given: given)
    monkeypatch.setattr(run, "judge", lambda claim, results, changed: (claim.id, changed[1:]))
    monkeypatch.setattr(run, "claim_line", lambda verdict: f"{verdict}")
    assert r.run._headline() == ""
    r.study.headline = "b"
    assert r.run._headline() == "('b', ([], [], None))"

    def breaks(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(run, "judge", breaks)
    assert not r.run._headline()


def test_tables_of_an_earlier_run_are_taken_where_none_is_made(running, monkeypatch):
    """Not those that this run makes, and none where only some loops or scenarios run."""
    r = running
    earlier = {"one": {"t": 1}, "two": {"t": 2}}
    monkeypatch.setattr(Keep, "tables", lambda self, name: earlier.get(name))
    for name in ("loops", "scenarios"):
        setattr(r.options, name, ["x"])
        r.run._found_tables()
        assert r.results.tables == {}
        setattr(r.options, name, [])
    r.run._found_tables()
    assert r.results.tables == {"one": {"t": 1}}


def test_a_run_that_is_stopped_writes_what_had_finished(running, monkeypatch):
    r = running
    done = []
    monkeypatch.setattr(r.run, "_metrics", lambda state="": done.append(("metrics", state)))
    monkeypatch.setattr(r.run, "_claims", lambda state="": done.append(("claims", state)) or ["V"])
    monkeypatch.setattr(r.run, "_found_tables", lambda: done.append(("tables", "")))
    monkeypatch.setattr(Keep, "clear_parts", lambda self: done.append(("parts", "")))
    pages = []
    monkeypatch.setattr(run.report_page, "page", lambda *given: pages.append(given) or "PAGE")
    r.run._stopped()
    assert sorted(done) == sorted([("metrics", run.STOPPED), ("claims", run.STOPPED),
                                   ("tables", ""), ("parts", "")])  # fmt: skip
    assert done.index(("tables", "")) < done.index(("metrics", run.STOPPED))
    ((results, verdicts, figures, command, parts, state),) = pages
    assert (results, verdicts, figures, command, parts) == (r.results, ["V"], {}, "CMD", {})
    assert run.STOPPED in state
    assert (r.out / "report.html").read_text() == "PAGE"
    monkeypatch.setattr(run.report_page, "page", lambda *given: 1 / 0)
    r.run._stopped()
    assert list(r.results.failed) == ["report.html"]


def test_a_run_as_data_holds_its_files_warnings_and_remarks(running, monkeypatch):
    r = running
    monkeypatch.setattr(run, "warnings_of_runs", lambda results: [("it slid", "dry/pid")])
    remark = SimpleNamespace(text="far off", scenario="ice", loop="sta", numbers=("c = 1",))
    monkeypatch.setattr(run, "estimator_remarks", lambda results: [remark])
    rest = {
        "warnings": [{"text": "it slid", "runs": "dry/pid"}],
        "remarks": [{"text": "far off", "run": "ice/sta", "numbers": ["c = 1"]}],
        "folder": str(r.out),
    }
    assert json.loads(r.run._json()) == rest
    (r.out / "metrics.json").write_text('{"a": 1}', encoding="utf-8")
    assert json.loads(r.run._json()) == {"metrics": {"a": 1}, **rest}
    (r.out / "claims.json").write_text('["ä"]', encoding="utf-8")
    assert json.loads(r.run._json()) == {"metrics": {"a": 1}, "claims": ["ä"], **rest}
    assert "ä" in r.run._json()


def test_output_that_nobody_reads_does_not_stop_a_run(running, monkeypatch, capsys):
    r = running
    made = run._Run(r.options, "CMD", r.results, None, r.keep, None, ())
    made._tell("one")
    made._tell("two", "\n")
    made._tell("")
    assert capsys.readouterr().out == "one\n\ntwo\n"
    r.options.json = True
    made._tell("three")
    assert capsys.readouterr().out == ""
    r.options.json = False
    printed = []

    def broken(*given, **more):
        printed.append(given)
        raise BrokenPipeError(errno.EPIPE, "closed")

    monkeypatch.setattr(run, "print", broken, raising=False)
    made._tell("four")
    made._tell("five")
    assert printed == [("four",)]
    assert isinstance(made.unprinted, BrokenPipeError)


# ---- what a folder keeps -------------------------------------------------------------------------


def test_a_folder_keeps_tables_under_their_key(tmp_path):
    from slipctl import Table

    keep = Keep(tmp_path, "KEY")
    tables = {"t": Table("A table", {"x": ("m", [1.0, 2.5]), "n": ("", ["a", "b"])}, "about it")}
    assert keep.tables("one") is None
    keep.keep_tables("one", tables)
    (found,) = keep.tables("one").values()
    assert (found.title, found.doc) == ("A table", "about it")
    assert {n: (u, list(v)) for n, (u, v) in found.columns.items()} == {
        "x": ("m", [1.0, 2.5]), "n": ("", ["a", "b"])}  # fmt: skip
    assert keep.tables("two") is None
    assert Keep(tmp_path, "OTHER").tables("one") is None
    keep._table_file("one").write_text(
        f'{{"format": {store.FORMAT}, "tables": {{"t": 1}}}}', encoding="utf-8"
    )
    assert keep.tables("one") is None
    keep._table_file("one").write_text("{", encoding="utf-8")
    assert keep.tables("one") is None


def test_only_what_a_run_of_ours_left_is_removed(tmp_path):
    """Where metrics.json is no run's, only half-written files go."""
    keep = Keep(tmp_path, "KEY")
    (tmp_path / "logs" / "dry").mkdir(parents=True)
    (tmp_path / "figures").mkdir()
    names = ["logs/dry/pid.nc", "logs/dry/pid.csv", "logs/dry/own.txt", "report.html",
             "claims.json", "tables.json", "figures/a.svg", "figures/b.png", "figures/c.txt",
             "mine.html"]  # fmt: skip
    for name in names:
        (tmp_path / name).write_text("x", encoding="utf-8")
    half = tmp_path / "logs" / f"{store.PART}x"
    for content in (None, f'{{"format": {store.FORMAT}, "else": 1}}', "{"):
        half.write_text("x", encoding="utf-8")
        if content is not None:
            (tmp_path / "metrics.json").write_text(content, encoding="utf-8")
        keep.clear({"dry": ["pid"]})
        assert not half.exists()
        assert all((tmp_path / n).exists() for n in names)
    (tmp_path / f"{store.PART}folder").mkdir()
    (tmp_path / "logs" / "ice").mkdir()
    (tmp_path / "metrics.json").write_text(
        f'{{"format": {store.FORMAT}, "study": "toy"}}', encoding="utf-8"
    )
    keep.clear({"dry": ["pid"]})
    left = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file())
    assert left == ["figures/c.txt", "logs/dry/own.txt", "metrics.json", "mine.html"]
    assert (tmp_path / f"{store.PART}folder").is_dir()
    assert not (tmp_path / "logs" / "ice").exists()


def test_logs_of_the_same_run_stay_where_they_are_wanted(tmp_path, monkeypatch):
    keep = Keep(tmp_path, "KEY")
    own = {"pid": keep.of("dry", "pid"), "sta": keep.of("dry", "sta"), "old": "another key"}
    monkeypatch.setattr("slipctl.study.cache._attribute", lambda path, name: own.get(path.stem))
    (tmp_path / "logs" / "dry").mkdir(parents=True)
    for name in own:
        for end in (".nc", ".csv"):
            (tmp_path / "logs" / "dry" / f"{name}{end}").write_text("x", encoding="utf-8")
    (tmp_path / "metrics.json").write_text(
        f'{{"format": {store.FORMAT}, "study": "toy"}}', encoding="utf-8"
    )
    assert keep.logs() == {"dry": ["pid", "sta"]}
    keep.clear({"dry": ["pid", "old"]})
    assert sorted(p.name for p in (tmp_path / "logs" / "dry").iterdir()) == ["pid.csv", "pid.nc"]
    assert keep.log("dry", "old") is None
    assert keep.log("dry", "pid") is None  # under its key, and damaged
    (tmp_path / "logs" / "dry" / "pid.csv").unlink()
    assert keep.log("dry", "pid") is None


# ---- a log that is fitted ------------------------------------------------------------------------


@flow(x=Output("m/s", "speed as it is told"))
def rolls(
    v=State("m/s", 3.0, "speed"),
    T=Input("N m", "torque", value=2.0),
    slope=Input("1", "gradient", value=0.5),
    m=Param("kg", 4.0, "mass", lo=1.0, hi=100.0),
    c=Param("kg/s", 1.0, "drag"),
):
    """A mass that rolls."""
    return dict(v=(T - c * v) / m), dict(x=v)


def test_settings_of_a_fit_are_numbers_inputs_or_what_stands_beside():
    block, at, constants = fit_log._settled(rolls, {"m": "2 t", "T": "3 kN m", "c": "7 kg/s"}
                                            | {"m": "8 kg"})  # fmt: skip
    assert at == {"m": "8 kg", "c": "7 kg/s"}
    assert constants == {"T": 3000.0}
    values = {n: float(v) for n, v in block.param_values().items()}
    assert values == {"m": 8.0, "c": 7.0}
    assert {n: float(v) for n, v in rolls.param_values().items()} == {"m": 4.0, "c": 1.0}
    same, at, constants = fit_log._settled(rolls, {})
    assert (at, constants) == ({}, {})
    assert {n: float(v) for n, v in same.param_values().items()} == {"m": 4.0, "c": 1.0}
    for wrong in ({"m": "2 s"}, {"m": "1000 kg"}, {"T": "2 kg"}, {"q": "3"}):
        with pytest.raises(BadInput):
            fit_log._settled(rolls, wrong)


def test_what_stands_beside_a_law_keeps_its_number():
    beside = {"rho": Param("1", 0.05, "rotating share", lo=0.0, hi=1.0).named("rho")}
    made = rolls._copy(rolls.signals, law_data=replace(rolls.law_data, beside=beside))
    block, at, constants = fit_log._settled(made, {"rho": "6 %"})
    assert (at, constants) == ({}, {})
    assert block.law_data.beside["rho"].value == pytest.approx(0.06)
    assert made.law_data.beside["rho"].value == 0.05
    with pytest.raises(BadInput):
        fit_log._settled(made, {"rho": "2"})


def recorded(time, **columns):
    cells = {n: np.array(v, float) for n, v in columns.items()}
    units = {"v": "km/h", "x": "m/s", "torque": "kN m", "slope": "1"}
    made = Table("log.csv", cells, {n: units.get(n, "1") for n in cells}, range(len(time)))
    rows = np.arange(len(time))
    return Recording("log.csv", np.array(time, float), made, rows, gap=1.0)


def test_a_record_is_what_was_measured_and_every_input():
    """By its own name; what was not measured stands still at its value, of the block or told."""
    log = recorded([0, 0.5, 1.0, 4.0, 4.5], v=[36, 18, np.nan, 9, 3.6], torque=[1, 2, 3, 4, 5])
    name, found = fit_log._record(rolls, log, "", {"T": "torque"}, {}, "hold")
    assert name == "v"
    assert found.source == "log.csv"
    assert found.time.tolist() == [0, 0.5, 1.0, 4.0, 4.5]
    assert found.measured[[0, 1, 3, 4]].tolist() == pytest.approx([10, 5, 2.5, 1])
    assert np.isnan(found.measured[2])
    assert found.inputs["T"].tolist() == [1000, 2000, 3000, 4000, 5000]
    assert found.inputs["slope"].tolist() == [0.5] * 5
    assert found.begins == (3,)
    assert any("empty" in note for note in log.notes)
    assert any(note.startswith("1 gap") for note in log.notes)
    _, found = fit_log._record(rolls, log, "v", {"T": "torque"}, {"slope": 0.25}, "hold")
    assert found.inputs["slope"].tolist() == [0.25] * 5
    log = recorded([0, 2, 4], v=[1, 2, 3])
    _, found = fit_log._record(rolls, log, "", {}, {}, "hold")
    assert found.begins == (1, 2)
    assert found.inputs["T"].tolist() == [2.0] * 3
    assert any(note.startswith("2 gaps") for note in log.notes)
    assert fit_log._record(rolls, recorded([0, 0.5], v=[1, 2]), "", {}, {}, "hold")[1].begins == ()


def test_which_column_was_measured_is_asked_where_it_is_not_told():
    both = recorded([0, 0.5], v=[1, 2], x=[1, 2])
    with pytest.raises(BadInput, match="--map"):
        fit_log._record(rolls, both, "", {}, {}, "hold")
    assert fit_log._record(rolls, both, "x", {}, {}, "hold")[0] == "x"
    with pytest.raises(BadInput, match="--map"):
        fit_log._record(rolls, recorded([0, 0.5], torque=[1, 2]), "", {}, {}, "hold")
    with pytest.raises(Faults):
        fit_log._record(rolls, recorded([0, 0.5], v=[1, 2]), "", {"T": "never"}, {}, "hold")


def test_times_between_which_a_log_is_fitted_rise():
    assert fit_log._ends("12s:95s") == (12.0, 95.0)
    assert fit_log._ends("1 min:2 min") == (60.0, 120.0)
    for wrong in ("12s", "1s:2s:3s", "2s:1s", "1s:1s", "1m:2m"):
        with pytest.raises(BadInput):
            fit_log._ends(wrong)


# ---- sweeps side by side -------------------------------------------------------------------------


@pytest.fixture
def swept(tmp_path, monkeypatch):
    """A sweep whose runs are not made here."""
    asked: dict[str, Any] = {}

    def made(failed=(), drawn=True):
        return SimpleNamespace(
            failed=dict(failed), runs=[1, 2, 3], kept="", plan=SimpleNamespace(drawn=drawn),
            save=lambda path: asked.setdefault("saved", []).append(path),
        )  # fmt: skip

    loops = {"pid": "PID", "sta": "STA"}
    case = SimpleNamespace(loops=loops, scenario=SimpleNamespace(name="base"), known="KNOWN")
    study = SimpleNamespace(name="toy", signals="SIGNALS", limits={"slip": 1.0}, ensembles={})
    request = SimpleNamespace(study=study, settings=["K=1"], swaps=["a=b"])
    found = {"pid": made(), "sta": made()}

    def run(loop, *given, **more):
        asked.setdefault("runs", []).append((loop, given, more))
        return found["pid" if loop == "PID" else "sta"]

    state = {"together": False}
    monkeypatch.setattr(sweep, "_asked", lambda options: (request, case, state["together"]))
    monkeypatch.setattr(sweep, "_refuse_overruled", lambda *a: asked.__setitem__("overruled", a))
    monkeypatch.setattr(sweep, "sweep", run)
    monkeypatch.setattr(sweep, "page", lambda found, command: f"page of {list(found)} {command}")
    monkeypatch.setattr(sweep, "report", lambda one: "REPORT")
    monkeypatch.setattr(sweep, "spread", lambda one: {"runs": len(one.runs)})
    monkeypatch.setattr(sweep, "head_lines", lambda one: ["head", "second"])
    monkeypatch.setattr(sweep.sweep_export, "check", lambda path: None)
    options = SimpleNamespace(
        name="toy:pid", out=str(tmp_path / "o"), export="", varied=["K=1:2"], samples=3, seed=4,
        design="lhs", logs=["v"], jobs=5, no_compile=True, scheduler=None, mixed=False, json=False,
        quiet=True,
    )  # fmt: skip
    (tmp_path / "o").mkdir()
    return SimpleNamespace(options=options, asked=asked, found=found, made=made, state=state,
                           case=case, study=study, out=tmp_path / "o", loops=loops)  # fmt: skip


def test_a_sweep_of_one_loop_is_asked_what_the_line_says(swept, capsys):
    swept.case.loops = {"pid": "PID"}
    assert sweep.answer(swept.options, "CMD") == 0
    ((loop, given, more),) = swept.asked["runs"]
    assert loop == "PID"
    assert given == (swept.case.scenario, ["K=1:2"], swept.out)
    more.pop("progress")
    assert more == {
        "samples": 3, "seed": 4, "design": "lhs", "signals": "SIGNALS", "known": "KNOWN",
        "logs": ["v"], "jobs": 5, "compile": False, "world": None, "scheduler": "", "mixed": False,
        "about": {"loop": "toy:pid", "set": ["K=1"], "swapped": ["a=b"], "command": "CMD",
                  "limits": {"slip": 1.0}},
    }  # fmt: skip
    out = capsys.readouterr().out
    assert out == f"REPORT\n\n{swept.out / 'report.html'}\n"
    assert (swept.out / "report.html").read_text() == "page of ['pid'] CMD"
    swept.options.export = "x.nc"
    sweep.answer(swept.options, "CMD")
    assert swept.asked["saved"] == ["x.nc"]
    assert capsys.readouterr().out.split() == ["REPORT", "x.nc", str(swept.out / "report.html")]
    swept.options.json = True
    sweep.answer(swept.options, "CMD")
    assert json.loads(capsys.readouterr().out) == {"runs": 3}


def test_runs_that_failed_and_samples_of_nothing_are_said(swept, capsys, caplog):
    swept.case.loops = {"pid": "PID"}
    swept.found["pid"] = swept.made({7: "why"}, drawn=False)
    with caplog.at_level(logging.WARNING, "slipctl"):
        assert sweep.answer(swept.options, "CMD") == 1
    text = caplog.text
    assert "--samples 3" in text
    assert "1 of 3 runs failed" in text
    assert "run 7: why" in text
    caplog.clear()
    swept.options.samples = 1
    sweep.answer(swept.options, "CMD")
    assert "--samples" not in caplog.text


def test_loops_together_have_folders_of_their_own(swept, capsys, monkeypatch):
    swept.state["together"] = True
    told = []
    monkeypatch.setattr(sweep, "_tell_together", lambda *a: told.append(a))
    assert sweep.answer(swept.options, "CMD") == 0
    assert [given[2] for _, given, _ in swept.asked["runs"]] == [swept.out / n for n in swept.loops]
    ((_, found, places, out),) = told
    assert list(found) == ["pid", "sta"]
    assert places == {n: swept.out / n for n in swept.loops}
    assert out == swept.out
    swept.options.export = "x.nc"
    with pytest.raises(BadInput):
        sweep.answer(swept.options, "CMD")


def test_loops_together_are_told_side_by_side(swept, capsys, monkeypatch):
    out, options = swept.out, swept.options
    places = {n: out / n for n in swept.loops}
    rows = [("a", True), ("b", False), ("c", True)]
    monkeypatch.setattr(sweep.compare, "read", lambda path: f"read {path}")
    monkeypatch.setattr(sweep.compare, "metric_rows",
                        lambda sides: {"base": (sides, rows)})  # fmt: skip
    monkeypatch.setattr(sweep.compare, "tells_apart", lambda row: row[1])
    monkeypatch.setattr(sweep.compare, "metric_tables",
                        lambda names, told: [f"{names} {told}"])  # fmt: skip
    monkeypatch.setattr(sweep.compare, "metric_rows", lambda sides: {"base": rows})
    swept.found["sta"].kept = "kept 2 s"
    sweep._tell_together(options, swept.found, places, out)
    parts = capsys.readouterr().out.rstrip("\n").split("\n\n")
    assert parts[0].split("\n")[1] == "second"
    assert str(out) in parts[0]
    assert "2 loops, 3 runs each" in parts[0]
    assert parts[1] == "sta  kept 2 s"
    assert "slipctl compare" in parts[-1]
    alone = {"pid": swept.found["pid"]}
    sweep._tell_together(options, alone, {"pid": out / "pid"}, out)
    parts = capsys.readouterr().out.rstrip("\n").split("\n\n")
    assert parts[1:] == ["REPORT"]
    options.json = True
    sweep._tell_together(options, swept.found, places, out)
    assert json.loads(capsys.readouterr().out) == {"pid": {"runs": 3}, "sta": {"runs": 3}}


def test_without_a_range_the_ensemble_of_the_study_is_drawn(swept, monkeypatch, caplog):
    made = []

    def world(*given, **more):
        made.append((given, more))
        return SimpleNamespace(notes=("a note",), ensemble=None)

    monkeypatch.setattr(sweep, "World", world)
    with pytest.raises(BadInput, match="--vary"):
        sweep._world(swept.study, swept.case, "pid", swept.options)
    swept.study.ensembles = {"base": "ENSEMBLE"}
    with caplog.at_level(logging.WARNING, "slipctl"):
        sweep._world(swept.study, swept.case, "pid", swept.options)
    more = {"signals": "SIGNALS", "known": "KNOWN", "seed": 4, "compile": False}
    assert made == [(("PID", swept.case.scenario, "ENSEMBLE"), more)]
    assert "a note" in caplog.text


# ---- maps ----------------------------------------------------------------------------------------


@pytest.fixture
def mapped(tmp_path, monkeypatch):
    number = lambda value: SimpleNamespace(value=value)  # noqa: E731
    system = SimpleNamespace(numbers={"a": number(1.0), "b": number(None), "c": number(3.0)})
    asked: dict[str, Any] = {}
    axes = [SimpleNamespace(name=n, values=lambda many, n=n: f"{many} of {n}") for n in "ab"]
    monkeypatch.setattr(certify_loop, "_asked", lambda options: (
        lambda point: (system, {"c": 4.0}), "WHAT"))  # fmt: skip
    monkeypatch.setattr(certify_loop.maps, "read_axes",
                        lambda *a: asked.__setitem__("axes", a) or axes)  # fmt: skip

    @dataclass(frozen=True)
    class Map:
        """A map."""

        levels: Any = None

    def drawn(at, axes, what, points, cores, tell):
        tell(0.5)
        asked["drawn"] = (axes, what, points)
        return Map()

    monkeypatch.setattr(certify_loop.maps, "drawn_map", drawn)
    monkeypatch.setattr(certify_loop.maps, "write", lambda *a: asked.__setitem__("write", a) or [
        "one.svg", "two.json"])  # fmt: skip
    monkeypatch.setattr(certify_loop.maps, "text", lambda found: f"MAP {found.levels}")
    monkeypatch.setattr(certify_loop, "Cores", lambda many: nullcontext("CORES"))
    monkeypatch.setattr(certify_loop, "_measured", lambda o, axes, given: asked.__setitem__(
        "measured", (axes, given)) or ("MEASURED", "METRIC", ("p", "q")))  # fmt: skip
    monkeypatch.setattr(
        certify_loop, "levels", lambda *a: asked.__setitem__("levels", a) or "LEVELS"
    )
    monkeypatch.setattr(certify_loop.machine, "cores", lambda: 7)
    options = SimpleNamespace(map=["a=1:2", "b=3:4"], system="toy:pid", out=str(tmp_path / "m"),
                              metric=None, points=5, quiet=True)  # fmt: skip
    return SimpleNamespace(options=options, asked=asked, axes=axes, system=system, out=tmp_path)


def test_a_map_has_its_axes_and_files(mapped):
    text = certify_loop.map_answer(mapped.options, "CMD")
    assert text == "MAP None\n\none.svg\ntwo.json"
    assert mapped.asked["axes"] == (mapped.options.map, mapped.system, {"a": 1.0, "c": 4.0})
    assert mapped.asked["drawn"] == (mapped.axes, "WHAT", 5)
    _, folder, command = mapped.asked["write"]
    assert (folder, command) == (mapped.out / "m", "CMD")
    assert "levels" not in mapped.asked
    mapped.options.out = str(mapped.out / "m.json")
    with pytest.raises(BadInput):
        certify_loop.map_answer(mapped.options, "CMD")


def test_a_map_with_a_metric_has_its_levels(mapped, monkeypatch):
    mapped.options.metric = "distance"
    assert certify_loop.map_answer(mapped.options, "CMD").startswith("MAP LEVELS")
    assert mapped.asked["measured"] == (mapped.axes, {"c": 4.0})
    assert mapped.asked["levels"][:6] == ("MEASURED", "METRIC", ("p", "q"), "5 of a", "5 of b", 7)
    monkeypatch.chdir(mapped.out)
    mapped.options.out = None
    certify_loop.map_answer(mapped.options, "CMD")
    assert mapped.asked["write"][1] == Path("out/map_toy_pid")


def test_only_loops_have_metrics_on_a_map(monkeypatch):
    loops = {"toy:pid"}
    monkeypatch.setattr(certify_loop, "is_loop", lambda name: name in loops)
    for metric, system in (("never", "toy:pid"), ("distance", "sta")):
        with pytest.raises(BadInput):
            certify_loop._measured(SimpleNamespace(metric=metric, system=system), [], {})
    gains = SimpleNamespace(loop="pid")
    study = SimpleNamespace(controller="ctl", signals="SIGNALS")
    case = SimpleNamespace(scenario="SCENARIO", known="KNOWN")
    asked = []
    monkeypatch.setattr(certify_loop, "one", lambda name: (gains, None))
    monkeypatch.setattr(certify_loop, "find", lambda name: (study, []))
    monkeypatch.setattr(certify_loop.Request, "of", lambda *a: asked.append(a) or SimpleNamespace(
        chosen=("LOOP", case)))  # fmt: skip
    monkeypatch.setattr(certify_loop, "places", lambda *a: ("places", *a))
    monkeypatch.setattr(certify_loop, "Measured", lambda *a: ("measured", *a))
    options = SimpleNamespace(metric="distance", system="toy:pid", settings=["K=1"])
    axes = [SimpleNamespace(name=n) for n in "ab"]
    assert certify_loop._measured(options, axes, {"c": 1}) == (
        ("measured", "LOOP", "SCENARIO", "SIGNALS", "KNOWN"), "distance",
        ("places", "LOOP", "ctl", ["a", "b"], {"c": 1}),
    )  # fmt: skip
    assert asked == [(study, "pid", ["K=1"])]
