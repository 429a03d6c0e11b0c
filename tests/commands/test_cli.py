"""The command line as a person meets it: what it prints, writes, refuses, and its exit codes."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import fields
from functools import partial
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import pytest
import xarray

from slipctl.commands.cli import main
from slipctl.models.vehicle.parts import Valve
from slipctl.run import store
from slipctl.study import resolve

TESTS = Path(__file__).parents[1]
TOY = str(TESTS / "toy_study.py")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    """Run, expect code 2, one line on stderr, nothing on stdout and nothing written; the line."""
    before = sorted(Path.cwd().rglob("*"))
    code = main(argv)
    said = capsys.readouterr()
    assert code == 2, said
    assert said.out == ""
    assert said.err.startswith("slipctl: ")
    assert said.err.count("\n") == 1, said.err
    assert sorted(Path.cwd().rglob("*")) == before
    return said.err


def study_file(name: str, text: str) -> str:
    """Write a study that differs from the toy."""
    head = f"import sys\nsys.path.insert(0, {str(TESTS)!r})\nfrom dataclasses import replace\n"
    head += "import toy_study as toy\n"
    head += "from slipctl import (Case, Claim, Experiment, Figure, Input, Output, Param, Rail,\n"
    head += "    Scenario, Section, connect, law)\n"
    Path(name).write_text(f"{head}{text}\n")
    return name


# ---- run ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def toy_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of one quick full run of the toy."""
    out = tmp_path_factory.mktemp("run") / "deep" / "out"
    assert main(["run", TOY, "--quick", "--full", "--out", str(out)]) == 0
    return out


def test_run_writes_everything(toy_run: Path) -> None:
    found = sorted(str(p.relative_to(toy_run)) for p in toy_run.rglob("*") if p.is_file())
    kept = [p for p in found if p.startswith("parts/")]
    assert len(kept) == 1  # the finished experiment, for the next run
    assert re.fullmatch(r"parts/seeds\.[0-9a-f]{32}\.json", kept[0])
    assert [p for p in found if p not in kept] == sorted([
        "claims.json", "metrics.json", "tables.json", "report.html", "figures/fig01.png",
        "figures/fig01.svg", "logs/base/soft.nc", "logs/base/soft.csv", "logs/base/hard.nc",
        "logs/base/hard.csv", "logs/noisy/soft.nc", "logs/noisy/soft.csv",
    ])  # fmt: skip


@pytest.mark.second
def test_run_prints_claims_and_metrics_and_ends_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", TOY, "--quick", "--full"]) == 0
    said = capsys.readouterr()
    assert re.search(r"claim +paper +ours +verdict and why", said.out)
    assert re.search(
        r"the soft torque is smoother +hard > soft +soft \d.* reproduced$", said.out, re.M
    )
    assert re.search(r"way of the soft one +15.00 m +1\d.\d+ m +not reproduced: off by", said.out)
    assert "not checkable: the paper gives no data" in said.out
    assert re.search(r"scenario base\n +metric +soft +hard\n +distance \[m\] +1", said.out)
    assert "(quick)" in said.out
    assert Path("out/toy/report.html").exists()
    assert said.err.splitlines()[0] == "slipctl: 1/4 base/soft"
    assert "\r" not in said.err  # no moving bar where nobody looks


@pytest.mark.second
def test_quiet_and_verbose(capsys: pytest.CaptureFixture[str]) -> None:
    some = ("--quick", "--loop", "soft", "--scenario", "base")
    assert main(["-q", "run", TOY, *some]) == 0
    assert capsys.readouterr().err == ""
    assert main(["run", TOY, *some, "-v"]) == 0
    assert "base/soft done" in capsys.readouterr().err


def test_same_input_gives_same_bytes(toy_run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["run", TOY, "--quick", "--full", "--out", str(toy_run)]
    before = {p: p.read_bytes() for p in toy_run.rglob("*") if p.is_file()}
    assert main(command) == 0
    for path, content in before.items():
        assert path.read_bytes() == content, path.name


def test_no_compile_gives_the_same_numbers(toy_run: Path) -> None:
    assert main(["run", TOY, "--quick", "--full", "--no-compile"]) == 0
    a = store.read_json(toy_run / "metrics.json")["scenarios"]
    assert store.read_json(Path("out/toy/metrics.json"))["scenarios"] == a


@pytest.mark.second
def test_set_and_swap_take_several_or_are_repeated(capsys: pytest.CaptureFixture[str]) -> None:
    Path("my.py").write_text(
        "from slipctl import Input, Output, Param, law\n"
        '@law(mu=Output("1", "mu", positive="braking"), conditions={"dry": {}, "ice": {}})\n'
        'def mine(s=Input("m/s", "slip", positive="braking", per="speed"),'
        ' q=Param("s/m", 0.1, lo=0)):\n'
        '    """Mine."""\n    return q * s\n'
    )
    few = ["--quick", "--loop", "soft", "hard", "--scenario", "base"]
    settings = ["--set", "car.m=8.2t", "soft:ctl.K=5e3", "--set", "adh.q=0.2"]
    assert main(["run", TOY, "--swap", "adh=my.py:mine", *settings, *few]) == 0
    got = store.read_json(Path("out/toy/metrics.json"))
    assert got["parameters"]["hard"]["plant.car.m"]["value"] == 8200
    assert got["parameters"]["hard"]["ctl.K"]["value"] == 4000
    assert got["parameters"]["soft"]["ctl.K"]["value"] == 5000
    assert got["parameters"]["soft"]["plant.adh.q"]["value"] == 0.2
    assert list(got["scenarios"]) == ["base"]
    assert "--set car.m=8.2t" in got["command"]
    said = (
        "with adh swapped for my.py:mine, car.m=8.2t set, soft:ctl.K=5e3 set, adh.q=0.2 set;"
        " claims are of the paper's model"
    )
    assert capsys.readouterr().out.splitlines()[1] == said
    page = Path("out/toy/report.html").read_text(encoding="utf-8")
    note = f'<p class="quick">W{escape(said[1:])}.</p>'
    assert f'<h2 id="claims">Claims</h2>{note}' in page
    assert page.index(note) < page.index("<nav>")
    assert not Path("out/toy/tables.json").exists()  # experiments belong to the whole study
    data = xarray.load_dataset(Path("out/toy/logs/base/soft.nc"))
    assert data["plant.adh.mu"].values[-1] == pytest.approx(0.2 * data["plant.car.s"].values[-1])


@pytest.mark.second
def test_a_part_of_a_study_leaves_claims_open(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", TOY, "--quick", "--loop", "soft", "--scenario", "base"]) == 0
    claims = {c["id"]: c for c in store.read_json(Path("out/toy/claims.json"))["claims"]}
    assert claims["ripple"]["verdict"] == "not checkable"
    assert claims["ripple"]["why"] == "base/hard was not run"
    assert claims["way"]["verdict"] == "not reproduced"
    assert main(["run", TOY, "--quick", "--scenario", "noisy", "--out", "noisy"]) == 0
    assert "figure fig01 is left out: base was not run" in capsys.readouterr().err


def test_stopped_while_a_study_is_built_nothing_is_said_to_be_written(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*args: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("slipctl.study.case_setup.prepare", interrupted)
    assert main(["run", TOY, "--quick"]) == 130
    assert capsys.readouterr().err == "slipctl: stopped\n"
    assert not Path("out").exists()


def test_a_failed_run_ends_with_1_and_keeps_the_rest(capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file("study.py", """
from casadi import exp, sqrt
@law(mu=Output("1", "mu", positive="braking"), conditions=toy.RAILS)
def pole(s=Input("m/s", "slip", positive="braking", per="speed"), c=Param("1", 1.0, lo=0, hi=2)):
    return 0.2 * c * exp(-s) + 0.001 * sqrt(0.5 - s)
def cases(models, quick):
    case = toy.cases(models, quick)[0]
    return [Case(case.scenario, {"hard": toy.loop(pole, toy.controller()), **case.loops})]
study = replace(toy.study, cases=cases, experiments={})
""".replace('"hard": toy', '"bad": toy'))  # fmt: skip
    assert main(["run", file, "--quick"]) == 1
    said = capsys.readouterr()
    assert re.search(r"^slipctl: base/bad failed: .*plant", said.err, re.MULTILINE)
    assert "Traceback" not in said.err
    got = store.read_json(Path("out/toy/metrics.json"))
    assert list(got["scenarios"]["base"]) == ["soft", "hard"]
    assert "base/bad" in got["failed"]
    assert "base/bad failed" in Path("out/toy/report.html").read_text()


def test_a_figure_that_breaks_does_not_cost_the_results(capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file("study.py", """
bad = {"f": Figure("x", lambda r: 1 / 0)}
study = replace(toy.study, experiments={}, figures=bad | toy.study.figures)
""")  # fmt: skip
    assert main(["run", file, "--quick"]) == 1
    assert (
        "figure f failed: study.py, line 8: ZeroDivisionError: division by zero"
        in capsys.readouterr().err
    )
    assert Path("out/toy/report.html").exists()
    assert Path("out/toy/figures/fig01.png").exists()


def test_a_claim_that_breaks_does_not_cost_the_results(capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file("study.py", """
def ours(r):
    return r.metric("base", "soft", "stopping_distance") > 3
study = replace(toy.study, experiments={}, claims=(
    Claim("stop", "here", "it stops", "yes/no", True, ours), *toy.study.claims))
""")  # fmt: skip
    assert main(["run", file, "--quick"]) == 1
    assert "claim stop failed: study.py, line 9: TypeError" in capsys.readouterr().err
    claims = store.read_json(Path("out/toy/claims.json"))["claims"]
    assert [c["verdict"] for c in claims][:2] == ["not checkable", "reproduced"]


def test_a_log_that_cannot_be_written_does_not_cost_the_rest(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("out").mkdir()
    Path("out/logs").write_text("in the way")
    assert main(["run", TOY, "--quick", "--out", "out"]) == 1
    said = capsys.readouterr()
    assert re.search(r"log of base/soft failed: cannot write \S*logs", said.err)
    assert "scenario base" in said.out
    assert Path("out/metrics.json").exists()
    assert Path("out/report.html").exists()


@pytest.mark.second
def test_ctrl_c_ends_with_130_and_what_was_finished() -> None:
    file = study_file("study.py", """
import time
def slow(context):
    print("sleeping", flush=True)
    time.sleep(60)
study = replace(toy.study, experiments={"slow": Experiment("Slow", slow)})
""")  # fmt: skip
    command = [sys.executable, "-m", "slipctl.commands.cli", "run", file, "--quick", "--full"]
    process = subprocess.Popen(
        [*command, "--jobs", "1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    assert "sleeping\n" in process.stdout  # behind what the study asks
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "slipctl: stopped; all finished results are written"
    assert "Traceback" not in err
    got = store.read_json(Path("out/toy/metrics.json"))
    assert list(got["scenarios"]["base"]) == ["soft", "hard"]
    for log in Path("out/toy/logs").rglob("*.nc"):
        assert xarray.load_dataset(log).attrs["quick"] == 1
    assert not list(Path("out").rglob(".*"))


# ---- the report ---------------------------------------------------------------------------------


class Page(HTMLParser):
    """Checks that tags are balanced, and collects ids, links and outside resources."""

    VOID = ("meta", "br", "img", "mspace", "link", "input", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.outside: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        for key, value in attrs:
            if key == "id":
                self.ids.append(str(value))
            if key == "href":
                (self.links if str(value).startswith("#") else self.outside).append(str(value))
            if key == "src" and not str(value).startswith("data:"):
                self.outside.append(str(value))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_report_is_one_well_formed_page(toy_run: Path) -> None:
    text = (toy_run / "report.html").read_text()
    page = Page()
    page.feed(text)
    assert page.open == []
    assert page.outside == []
    assert not re.search(r"https?://(?!www\.w3\.org)|@import|url\(", text)
    assert {link[1:] for link in page.links} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    for said in ("the soft torque is smoother", "not reproduced", "torque_ripple", "Slip of both",
                 "Worst error at the end", "Toy adhesion", "plant.car.m", "Toy, Table 2",
                 "A quick run", "slipctl run"):  # fmt: skip
        assert said in page.text, said
    assert "<math" in text
    assert "data:image/svg+xml;base64," in text
    machine = re.search(r'<script type="application/json" id="slipctl">(.*?)</script>', text)
    assert machine is not None
    assert json.loads(machine[1])["parameters"]["soft"]["plant.car.m"]["unit"] == "kg"


def test_figures_say_quick_and_where_they_come_from(toy_run: Path) -> None:
    svg = (toy_run / "figures/fig01.svg").read_text()
    assert "toy_study.py --quick" in svg
    assert "<dc:date>" not in svg
    png = (toy_run / "figures/fig01.png").read_bytes()
    assert b"toy_study.py --quick" in png


# ---- list, show, copy, c ------------------------------------------------------------------------


def test_list_shows_models_and_studies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^  subway_braking +\w", said, re.MULTILINE)
    assert re.search(r"^    double_exponential +Adhesion by two exponentials", said, re.MULTILINE)


def test_list_by_topic_and_word(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "kinds"]) == 0
    said = capsys.readouterr().out
    valve = said.partition("\n  actuator.valve ")[2].partition("\n  actuator.")[0]
    assert re.findall(r"^    (\w+)", valve, re.MULTILINE) == [
        f.name for f in fields(Valve) if f.name != "kind"]  # fmt: skip
    torque = next(f for f in fields(Valve) if f.name == "torque").metadata
    assert f"torque [N m], must be given, {torque['lo']:g} to {torque['hi']:g}" in valve
    assert "subway_braking" not in said
    assert main(["list", "tooth", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [r["name"] for r in found["kinds"]] == ["sensors.wheel_speed.tooth_wheel"]
    assert "tooth_wheel" in [b["name"] for m in found["models"] for b in m["blocks"]]
    assert main(["list", "obsrver"]) == 2
    assert "did you mean 'observer" in capsys.readouterr().err


def test_each_gain_of_a_law_is_in_list_and_schema(capsys: pytest.CaptureFixture[str]) -> None:
    """With the same meaning, unit, default and range; tables that stand several times say so."""
    assert main(["schema"]) == 0
    rules = json.loads(capsys.readouterr().out)["$defs"]["SlipLaw"]["allOf"]
    assert main(["list", "kinds", "--json"]) == 0
    rows = {r["name"]: r for r in json.loads(capsys.readouterr().out)["kinds"]}
    for rule in rules:
        kind, then = rule["if"]["properties"]["kind"]["const"], rule["then"]
        row = rows[f"controllers.NAME.{kind}"]
        assert (then["description"], list(then["properties"])) == (
            row["doc"], [g["name"] for g in row["gains"]])  # fmt: skip
        for gain in row["gains"]:
            said = then["properties"][gain["name"]]["description"]
            assert gain["meaning"]
            assert all(gain[k] in said for k in ("meaning", "unit", "default", "range"))
    assert {r["kind"] for r in rows.values()} >= {"pid", "sta", "lag", "noisy"}
    assert [n for n, r in rows.items() if r["many"]][:2] == ["vehicle.cars", "rail.sections"]
    assert rows["sensors.faults"]["kind"] == ""


def test_a_shell_completes_commands_and_options(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")

    def said(line: str) -> set[str]:
        told = tmp_path / "said"
        asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)),
                 "_ARGCOMPLETE_STDOUT_FILENAME": str(told)}  # fmt: skip
        subprocess.run([sys.executable, "-m", "slipctl"], env=os.environ | asked, check=True)
        return {w.strip() for w in told.read_text(encoding="utf-8").split("\v")}

    assert said("slipctl sw") == {"sweep"}
    assert said("slipctl sweep --de") == {"--design"}


def test_show(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "double_exponential"]) == 0
    assert "mu = c*(exp(-a*v_s) - exp(-b*v_s))" in capsys.readouterr().out
    assert main(["show", "subway_braking.wheelset", "--latex"]) == 0
    assert r"\dot{\omega}" in capsys.readouterr().out
    assert main(["show", f"{TOY}:soft", "--graph"]) == 0
    assert capsys.readouterr().out.startswith("digraph")
    assert main(["show", f"{TOY}:soft@noisy", "--against", f"{TOY}:hard"]) == 0
    assert "Equations of ctl\n  - T_b = min(20000" in capsys.readouterr().out
    assert main(["show", TOY]) == 0
    said = capsys.readouterr().out
    assert "Does the soft controller slip less" in said
    assert re.search(r"noisy +1.2 s, seed 7: soft", said)


def test_copy_gives_a_file_that_runs_and_is_never_overwritten(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["copy", "double_exponential", "mine.py"]) == 0
    assert "--swap NAME=mine.py:double_exponential" in capsys.readouterr().out
    assert main(["show", "mine.py:double_exponential"]) == 0
    capsys.readouterr()
    Path("mine.py").write_text("mine")
    assert "exists already and is not overwritten" in refused(
        capsys, "copy", "double_exponential", "mine.py"
    )
    assert Path("mine.py").read_text() == "mine"


@pytest.mark.parametrize("module", sorted(resolve.models()))
def test_every_model_file_runs_as_a_copy(module: str) -> None:
    assert main(["copy", module, f"{module}_copy.py"]) == 0
    resolve.load_file(f"{module}_copy.py")


@pytest.mark.second
def test_c_of_a_loop_and_of_a_model(
    capsys: pytest.CaptureFixture[str], needs_compiler: None
) -> None:
    assert main(["c", f"{TOY}:soft", "--out", "soft", "--check"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"1200 ticks replayed, largest difference from Python \d", said)
    assert "passed" in said
    assert Path("soft/toy_soft.c").exists()
    assert main(["c", "double_exponential", "--out", "law"]) == 0
    assert Path("law/double_exponential.h").exists()


def test_a_loop_without_controller_has_no_c(capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file("study.py", "study = replace(toy.study, controller='ctrl')")
    said = refused(capsys, "c", f"{file}:soft", "--out", "c")
    assert "study.py:soft has no controller to write: loop has no part 'ctrl'" in said
    assert "did you mean 'ctl'?" in said


NOT_IN_C = """
import casadi as ca
from slipctl import Input, Output, Param, State, law, make_block, step

def _solved(solver):
    z, q = ca.MX.sym("z"), ca.MX.sym("q")
    root = ca.rootfinder("root", solver, {"x": z, "p": q, "g": z**2 - q})
    return make_block(solver, "law", lambda x, u, p: ({}, {"y": root(x0=1.0, p=u["u"])["x"]}),
                      inputs=[Input("1").named("u")], outputs=[Output("1").named("y")], sx=False)

kinsol = _solved("kinsol")

@law(y=Output("1"))
def valueless(u=Input("1"), m=Param("kg")):
    "No default."
    return dict(y=m * u)

@law(y=Output("1"))
def clash(u=Input("1"), \u03b8=Param("1", 1.0), theta=Param("1", 2.0)):
    "Two names, one in C."
    return dict(y=u * \u03b8 * theta)

@law(y=Output("1"))
def math(u=Input("1")):
    "A header of C."
    return dict(y=u)

@step(y=Output("1"))
def timeless(x=State("1"), u=Input("1")):
    "No period."
    return dict(x=u), dict(y=x)
"""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "kinsol",
            "cannot generate C for KinsolInterface 'root'; use rootfinder(..., 'fast",
        ),
        ("valueless", "valueless.m has no value; give it a default in kg"),
        ("clash", "'\u03b8' and 'theta' would both be 'theta' in C; rename one"),
        ("math", "'math' cannot name a C file and its functions"),
        ("timeless --fmu", "has no period, which an FMU needs; write @step(period=0.01, ...)"),
        ("timless", "blocks.py has no block 'timless'; did you mean 'timeless'?"),
        ("timeless --fuzz -3", "--fuzz -3 gives it no time; write seconds, such as 15"),
        ("timeless --part plant", "is no loop and has no --part plant; leave it out"),
        ("timeless --name test", "'test' cannot name a C file and its functions: C, make, CMake"),
        ("timeless --out=", "--out names no folder"),
        ("timeless --target cortex-m3", "target 'cortex-m3' is not known; did you mean 'cortex-m"),
        ("timeless --real double_", "there is no --real 'double_'; did you mean 'double'?"),
    ],
)
def test_what_cannot_be_c_is_one_line(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("blocks.py").write_text(NOT_IN_C, encoding="utf-8")
    name, *options = words.split()
    assert said in refused(capsys, "c", f"blocks.py:{name}", "--out", "c", *options)


@pytest.mark.parametrize(
    ("options", "package"),
    [
        ("--target cortex-m4", "apt install gcc-arm-none-eabi libnewlib-arm-none-eabi"),
        ("--misra", "apt install cppcheck"),
        ("--fuzz 1", "apt install clang"),
        ("--prove", "apt install frama-c-base"),
    ],
)
def test_a_tool_that_is_missing_is_named_with_its_package(
    options: str,
    package: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", str(Path.cwd()))
    assert package in refused(capsys, "c", "double_exponential", "--out", "c", *options.split())


def test_foreign_files_stay(capsys: pytest.CaptureFixture[str]) -> None:
    Path("c").mkdir()
    Path("c/notes.txt").write_text("mine")
    Path("c/Makefile").write_text("mine too")
    said = refused(capsys, "c", "double_exponential", "--out", "c")
    assert "Makefile was not written by slipctl, or was changed since; move it away or give" in said
    Path("c/Makefile").unlink()
    assert main(["c", "double_exponential", "--out", "c"]) == 0
    assert Path("c/notes.txt").read_text() == "mine"
    with open("c/double_exponential.c", "a") as file:
        file.write("/* changed by hand */")
    capsys.readouterr()
    assert "was changed since" in refused(capsys, "c", "double_exponential", "--out", "c")


# ---- bad input ----------------------------------------------------------------------------------

FEW = ("--quick", "--loop", "soft", "--scenario", "base")


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        ([], "say what to do: list, show, new, open, schema, copy, run, sweep, tune, replay,"),
        (["rnu"], "there is no command 'rnu'; did you mean 'run'?"),
        (["fit", "a\0b", "--law", "polach"], "a null character stands in"),
        (["run"], "the following arguments are required: STUDY; see slipctl run --help"),
        (["run", TOY, "--quik"], "unrecognized arguments: --quik"),
        (["run", "subway_breaking"], "no study 'subway_breaking'; did you mean 'subway_braking'?"),
        (["run", "no_such.py"], "there is no file no_such.py"),
        (["run", TOY, "--loop", "sft"], "toy has no loop 'sft'; did you mean 'soft'?"),
        (["run", TOY, "--scenario", "bse"], "toy has no scenario 'bse'; did you mean 'base'?"),
        (["run", TOY, "--set", "car.mm=1"], "'car.mm'; did you mean 'car.m'?"),
        (["run", TOY, "--set", "soff:car.m=9t"], "no loop 'soff' runs; did you mean 'soft'?"),
        (["run", TOY, "--set", "car.m=5 N"], "plant.car.m [kg] cannot be '5 N'"),
        (["run", TOY, "--set", "car.m=5 miles"], "plant.car.m [kg] cannot be '5 miles'"),
        (["run", TOY, "--set", "car.m=-1kg"], "-1 kg is out of range; it must lie in"),
        (["run", TOY, "--set", "car.m=nan"], "'nan' is no number"),
        (["run", TOY, "--set", "car.m"], "write [loop:]block.param=VALUE[unit], such as"),
        (["run", TOY, "--swap", "ahd=x.py:y"], "no model 'ahd' to swap; did you mean 'adh'?"),
        (["run", TOY, "--swap", "adh=x.py:y"], "there is no file x.py"),
        (["run", "all_rails", "--swap", "adh=x.py:y"], "see docs/all_rails.md, 'Rails"),
        (["run", TOY, "--swap", "adh=double_exponentail"], "did you mean 'double_exponential'?"),
        (["show", "double_exponentail"], "did you mean 'double_exponential'?"),
        (["show", "subway_braking.weelset"], "no block 'weelset'; did you mean 'wheelset'?"),
        (["show", "subway_brakin.wheelset"], "no model file 'subway_brakin'; did you mean"),
        (["show", "brakes"], "brakes is a file of models; write which: brakes.brake"),
        (["show", f"{TOY}:sft"], "toy has no loop 'sft'; did you mean 'soft'?"),
        (["show", f"{TOY}:soft@nosy"], "toy has no scenario 'nosy'; did you mean 'noisy'?"),
        (["show", f"{TOY}", "--latex"], "is a study; write which loop: "),
        (["show", "subway_braking_control.controller"], "is a function that needs slip_law"),
        (["show", "no.py:law"], "there is no file no.py"),
        (["copy", "double_exponentail", "x.py"], "did you mean 'double_exponential'?"),
        (["copy", "double_exponential", "x.txt"], "must end in .py"),
        (["copy", "double_exponential", "no/x.py"], "there is no folder no; make it first"),
        (["c", "double_exponential"], "the following arguments are required: --out"),
        (["c", f"{TOY}:sft", "--out", "c"], "no loop 'sft'; did you mean 'soft'?"),
        (["c", "brakes", "--out", "c"], "brakes is a file of models"),
        (["run", TOY, "--set", "car.m=8t", "car.m=9t"], "--set names car.m twice; write it once"),
        (["run", "hst_traction", "--swap", "adh=double_exponential"],
         "double_exponential has the inputs v_s; an adhesion law under a train has v_s and v="),
    ],
)  # fmt: skip
def test_bad_input(capsys: pytest.CaptureFixture[str], argv: list[str], said: str) -> None:
    assert said in refused(capsys, *argv)


@pytest.mark.parametrize(
    ("content", "argv", "said"),
    [
        (b"study = 5\n", ["run", "file.py"], "file.py has no study; it must end in: study = S"),
        (b"a = 1\x00\n", ["show", "file.py:a"], "file.py is no Python file: source code string"),
        (b'from slipctl import Input, Output, law\n\n\n@law(mu=Output("furlong^"))\n'
         b'def a(v_s=Input("m/s")):\n    return v_s\n', ["show", "file.py:a"],
         "a.mu: unit 'furlong"),
    ],
    ids=["study", "bytes", "unit"],
)  # fmt: skip
def test_bad_files(
    capsys: pytest.CaptureFixture[str], content: bytes, argv: list[str], said: str
) -> None:
    Path("file.py").write_bytes(content)
    assert said in refused(capsys, *argv)


@pytest.mark.parametrize(
    ("cases", "said"),
    [
        ("[Case(Scenario('base', 0.0), {})]", "duration 0 s must be positive"),
        ("[Case(Scenario('base', -1.0), {})]", "duration -1 s must be positive"),
        ("[Case(Scenario('base', float('nan')), {})]", "must be positive"),
        ("[Case(Scenario('base', 1e-5, toy.cases(m, q)[0].scenario.rail, {'s_ref': 1}),"
         " toy.cases(m, q)[0].loops)]", "shorter than one tick"),
        ("Rail([Section(0, 'dry'), Section(2, 'ice'), Section(1, 'dry')])",
         "rail sections overlap: section 2 starts at 1 s"),
        ("Rail([Section(0, 'dry', length=3), Section(2, 'ice')])", "rail sections overlap"),
        ("Rail([Section(0, 'dry'), Section(0, 'ice')])", "rail section 0 is empty"),
        ("Rail([])", "a Rail needs at least one Section"),
        ("Rail(['dry'])", "rail section 0 is 'dry'; write Section(start, condition)"),
        ("Rail([Section('0 s', 'dry')])", "start of rail section 0 takes a number in s"),
        ("[Case(Scenario('base', '1 s'), {})]", "duration takes a number in s, not '1 s'"),
        ("[Case(Scenario('base', 1.0, [Section(0)]), {})]", "write Rail([...])"),
        ("[Case(Scenario('base', 1.0, Rail([Section(0, 'drry')]), {'s_ref': 1}),"
         " toy.cases(m, q)[0].loops)]", "knows no rail condition 'drry'; did you mean 'dry'?"),
        ("[Case(Scenario('base', 1.0, Rail([Section(0, 'dry')])), toy.cases(m, q)[0].loops)]",
         "s_ref [m/s] is not fed: wire it"),
        ("connect('loop', {'ctl.s': 'plant.s', 'plant.T_bb': 'ctl.T_b'}, plant=toy.car,"
         " ctl=toy.adhesion)", "plant has no input 'T_bb'; did you mean 'T_b'?"),
        ("connect('loop', {'b.T_b': 'b.s'}, b=toy.car)", "b.s [m/s] cannot feed b.T_b [N m]"),
        ("connect('loop', {'a.s': 'b.y', 'b.u': 'a.mu'}, a=toy.adhesion, b=echo)",
         "algebraic loop b.y -> a.mu -> b.y; break it with a unit_delay()"),
        ("connect('loop', {'a.u': 'b.mu'}, a=pull, b=toy.adhesion)", "put flip_sign('1') between"),
        ("[Case(Scenario('base', 1.0, params={'car.m': float('nan')}),"
         " toy.cases(m, q)[0].loops)]", "plant.car.m is NaN"),
        ("[Case(Scenario('base', 1.0, params={'car.m': -1}), toy.cases(m, q)[0].loops)]",
         "car.m = -1 kg is out of range"),
        ("undefined", "study.py, line 15: NameError: name 'undefined' is not defined"),
    ],
)  # fmt: skip
def test_bad_studies(capsys: pytest.CaptureFixture[str], cases: str, said: str) -> None:
    file = study_file("study.py", f"""
@law(y=Output("m/s", "y", positive="braking", per="speed"))
def echo(u=Input("1", "u", positive="braking"), k=Param("m/s", 1.0)):
    return k * u

@law(y=Output("1", "y"))
def pull(u=Input("1", "u", positive="traction")):
    return u
def cases(m, q):
    return {cases}
study = replace(toy.study, cases=cases)
""".replace("\n\n", "\n"))  # fmt: skip
    assert said in refused(capsys, "run", file)


def test_an_unwritable_folder_is_refused_before_anything_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("file").write_text("")
    assert "cannot write to file: file is not a folder" in refused(
        capsys, "run", TOY, "--out", "file"
    )
    assert "is not a folder" in refused(capsys, "run", TOY, "--out", "file/below/it")
    if Path("/proc").is_dir():  # where root has permission and still cannot
        assert "cannot write to /proc/x" in refused(capsys, "run", TOY, "--out", "/proc/x")
    assert "is not a folder" in refused(capsys, "c", "double_exponential", "--out", "file")
    assert "is a folder" in refused(capsys, "copy", "double_exponential", ".")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("locked").mkdir(mode=0o500)
    assert "no permission in" in refused(capsys, "run", TOY, "--out", "locked/out")


def test_check_without_a_compiler_is_refused(
    capsys: pytest.CaptureFixture[str], no_compiler: None
) -> None:
    assert "--check needs a C compiler; install gcc or clang" in refused(
        capsys, "c", "double_exponential", "--out", "c", "--check"
    )


def test_without_a_compiler_a_study_runs(no_compiler: None) -> None:
    assert main(["-q", "run", TOY, *FEW]) == 0


def test_an_unknown_fault_is_one_line_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resolve, "studies", partial(next, iter(())))
    assert main(["list"]) == 1
    assert capsys.readouterr().err.startswith("slipctl: a fault of slipctl, StopIteration")


def test_verbose_shows_where_only_what_python_said(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.py").write_text("x = 1 / 0\n")
    assert main(["-v", "show", "bad.py:x"]) == 2
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert said.splitlines()[-1] == "slipctl: bad.py, line 1: ZeroDivisionError: division by zero"
    assert main(["-v", "run", TOY, "--loop", "sft"]) == 2
    assert "Traceback" not in capsys.readouterr().err


# ---- speed --------------------------------------------------------------------------------------


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\nfrom slipctl.commands.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as stop:\n    assert stop.code == 0\n"
        "heavy = {'casadi', 'numpy', 'scipy', 'xarray', 'matplotlib', 'pint'} & set(sys.modules)\n"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for command in ("list", "show", "copy", "run", "c"):
        assert command in done.stdout


def test_help_takes_at_most_twelve_empty_starts() -> None:
    def fastest(*arguments: str) -> float:
        times = []
        for _ in range(5):
            before = os.times()
            subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
            after = os.times()  # of the processor: what else runs here does not count
            times.append(
                after.children_user
                + after.children_system
                - before.children_user
                - before.children_system
            )
        return min(times)

    assert fastest("-m", "slipctl.commands.cli", "--help") <= 12 * fastest("-c", "pass")


DRAWING = (
    "distributions",
    "plots",
    "looks",
    "regions",
    "layout",
    "figure_files",
    "strokes",
    "live",
)


@pytest.mark.second
def test_only_what_draws_imports_matplotlib() -> None:
    engine = Path(resolve.__file__).parents[1]
    for path in engine.rglob("*.py"):
        if path.parent.name == "draw" and path.stem in DRAWING:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(n.partition(".")[0] == "matplotlib" for n in names), path
