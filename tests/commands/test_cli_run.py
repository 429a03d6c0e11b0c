"""Plain and full runs, one run in one folder, and results that no interrupt loses."""

from __future__ import annotations

import hashlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

from slipctl.commands.cli import main
from slipctl.run import store
from slipctl.study import execution, jobs

TESTS = Path(__file__).parents[1]
TOY = str(TESTS / "toy_study.py")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*more: str) -> dict[str, dict[str, object]]:
    """Run the toy; gives its claims by their names."""
    assert main(["-q", "run", TOY, "--quick", "--out", "o", *more]) == 0
    return {c["id"]: c for c in store.read_json(Path("o/claims.json"))["claims"]}


def slow(more: str = "") -> str:
    """Write a study whose experiment says that it sleeps, and does."""
    Path("study.py").write_text(f"""
import sys, time
sys.path.insert(0, {str(TESTS)!r})
from dataclasses import replace
from slipctl import Experiment
import toy_study as toy
def slow(context):
    print("sleeping", flush=True)
    time.sleep(60)
{more}
study = replace(toy.study, experiments={{"slow": Experiment("Slow", slow)}})
""")
    return "study.py"


def started(*argv: str, **how: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "slipctl.commands.cli", "run", *argv]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


# ---- plain and full -----------------------------------------------------------------------------


@pytest.mark.second
def test_a_plain_run_has_every_claim_and_says_what_needs_full(capsys) -> None:
    claims = run()
    said = capsys.readouterr().out
    assert list(store.read_json(Path("o/metrics.json"))["scenarios"]) == ["base"]
    assert list(claims) == ["ripple", "way", "gone", "use"]
    assert claims["ripple"]["verdict"] == "reproduced"
    assert (claims["use"]["verdict"], claims["use"]["why"]) == ("not checkable", "needs --full")
    assert "4 claims: 1 reproduced, 1 not reproduced, 1 not checkable; --full would judge 1" in said
    assert "uses all adhesion" not in said
    assert "Left to --full: scenarios noisy; experiments seeds" in said
    assert said.rstrip().endswith("report.html")


@pytest.mark.second
def test_a_plain_run_shows_what_a_full_one_has_found(capsys) -> None:
    full = run("--full")
    assert full["use"]["verdict"] != "not checkable"
    numbers = store.read_json(Path("o/metrics.json"))["scenarios"]
    tables = Path("o/tables.json").read_text()
    capsys.readouterr()
    assert run() == full
    assert store.read_json(Path("o/metrics.json"))["scenarios"] == numbers
    assert re.sub(r'"command": .*', "", Path("o/tables.json").read_text()) == re.sub(
        r'"command": .*', "", tables
    )
    assert "Left to --full" not in capsys.readouterr().out


@pytest.mark.second
def test_one_core_and_many_give_the_same_bytes() -> None:
    run("--full", "--jobs", "1")
    before = {p: p.read_bytes() for p in Path("o").rglob("*") if p.suffix in (".csv", ".svg")}
    for path in before:
        path.unlink()
    for path in Path("o/parts").iterdir():
        path.unlink()
    run("--full", "--jobs", "3")
    text = re.compile(rb"--jobs \d")
    assert {p: text.sub(b"", p.read_bytes()) for p in before} == {
        p: text.sub(b"", content) for p, content in before.items()
    }


@pytest.mark.second
def test_full_goes_on_where_it_was_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs and experiments of the same key are taken: nothing is simulated again."""
    run("--full")
    logs = {p: p.stat().st_mtime_ns for p in Path("o/logs").rglob("*.nc")}
    monkeypatch.setattr("slipctl.study.execution.simulate", lambda *a, **k: pytest.fail("again"))
    run("--full")
    assert {p: p.stat().st_mtime_ns for p in logs} == logs


@pytest.mark.second
@pytest.mark.parametrize("done", [1, 4])
@pytest.mark.others("long")
def test_full_that_was_stopped_ends_in_the_same_files(
    monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    """Ctrl-C after one job or four, then the same command: bit for bit what one go gives."""
    command = ["-q", "run", TOY, "--quick", "--full", "--jobs", "1", "--out", "o"]

    def files_of_it() -> dict[str, bytes]:
        return {str(p): p.read_bytes() for p in Path("o").rglob("*") if p.is_file()}

    assert main(command) == 0
    whole = files_of_it()
    shutil.rmtree("o")
    attempt, begun = jobs._attempt, iter(range(99))

    def stopped(job: object, tell: object) -> object:
        if next(begun) == done:
            raise KeyboardInterrupt
        return attempt(job, tell)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(jobs, "_attempt", stopped)
        assert main(command) == 130
    assert set(files_of_it()) < set(whole)
    assert main(command) == 0
    assert files_of_it() == whole


# ---- claims that speak of something else --------------------------------------------------------


def test_a_printed_number_is_left_out_where_a_number_was_changed(capsys) -> None:
    claims = run("--set", "car.m=8.2t")
    assert claims["way"]["verdict"] == "not checkable"
    assert "plant.car.m of base/soft was changed" in str(claims["way"]["why"])
    assert claims["ripple"]["verdict"] == "reproduced"  # an order of two laws, on any vehicle
    said = capsys.readouterr().out
    assert "1 left out, because they speak of what was changed" in said
    assert "way of the soft one" not in said


@pytest.mark.parametrize("setting", ["soft:ctl.K=5e3", "car.v=10m/s"])
def test_an_order_is_left_out_where_its_law_or_the_start_was_changed(setting: str) -> None:
    assert "was changed" in str(run("--set", setting)["ripple"]["why"])


@pytest.mark.second
def test_what_was_not_changed_is_judged() -> None:
    assert run("--set", "hard:ctl.K=5e3")["way"]["verdict"] == "not reproduced"


def test_what_was_not_run_is_left_out_with_a_count(capsys) -> None:
    claims = run("--loop", "soft")
    assert claims["ripple"]["why"] == "base/hard was not run"
    said = capsys.readouterr().out
    assert "left out, because they speak of what was not run" in said
    assert "the soft torque is smoother" not in said


# ---- one run, one folder ------------------------------------------------------------------------


@pytest.mark.second
def test_what_belongs_to_another_run_is_removed() -> None:
    run("--full")
    run("--set", "car.m=12t", "--loop", "soft")
    assert sorted(p.name for p in Path("o/logs").rglob("*.*")) == ["soft.csv", "soft.nc"]
    assert not Path("o/tables.json").exists()
    run("--loop", "hard")
    assert sorted(p.name for p in Path("o/logs").rglob("*.*")) == ["hard.csv", "hard.nc"]
    for path in (p for p in Path("o").rglob("*") if p.suffix in (".json", ".html", ".csv")):
        assert "12t" not in path.read_text() or "parts" in path.parts


@pytest.mark.second
def test_files_of_others_in_the_folder_stay() -> None:
    Path("o/figures").mkdir(parents=True)
    Path("o/figures/mine.png").write_text("mine")
    Path("o/report.html").write_text("mine")
    assert main(["-q", "run", TOY, "--scenario", "bse", "--out", "o"]) == 2
    assert Path("o/report.html").read_text() == "mine"
    run()
    assert Path("o/figures/mine.png").read_text() == "mine"


@pytest.mark.second
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.others("long")
def test_a_stopped_run_says_so_and_leaves_nothing_of_another(number: int) -> None:
    run("--full")
    process = started(slow(), "--quick", "--full", "--set", "car.m=12t", "--out", "o")
    assert process.stdout is not None
    assert "sleeping\n" in process.stdout  # behind what the study asks
    process.send_signal(number)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    got = store.read_json(Path("o/metrics.json"))
    assert got["state"].startswith("stopped before its end")
    assert got["parameters"]["soft"]["plant.car.m"]["value"] == 12000
    assert "This run was stopped before its end" in Path("o/report.html").read_text()
    assert not list(Path("o/figures").iterdir())
    for log in Path("o/logs").rglob("*.nc"):
        assert "12t" in xarray.load_dataset(log).attrs["command"]
    assert not list(Path("o").rglob(".*"))


SWALLOWED = """
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(5)
    except KeyboardInterrupt:
        pass
"""
IN_TEXT = """
    exec("os.kill(os.getpid(), signal.SIGINT); time.sleep(5)")
"""
UNRAISABLE = """
    class Last:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
    Last()
"""


@pytest.mark.parametrize("where", [SWALLOWED, IN_TEXT, UNRAISABLE])
def test_an_interrupt_that_does_not_come_through_is_raised_again(where: str) -> None:
    """CasADi swallows it where it reads properties, Python keeps one in text as unheard, and can
    raise none where an object ends."""
    more = f"""
import os, signal
def cases(models, quick):
{where}
    time.sleep(60)
toy.study = replace(toy.study, cases=cases)
"""
    process = started(slow(more), "--quick")
    _, err = process.communicate(timeout=300)
    assert process.returncode == 130, err
    assert "Traceback" not in err


@pytest.mark.second
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("where", ["| true", "> /dev/full", ">&-"])
@pytest.mark.others("long")
def test_results_are_written_before_anything_is_printed(where: str) -> None:
    command = f"{sys.executable} -m slipctl.commands.cli -q run {TOY} --quick --out o {where}"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert "Traceback" not in done.stderr
    for name in ("report.html", "claims.json", "metrics.json", "figures/fig01.svg"):
        assert Path("o", name).exists(), name
    assert "state" not in store.read_json(Path("o/metrics.json"))


@pytest.mark.second
def test_letters_that_the_terminal_lacks_lose_nothing() -> None:
    command = [sys.executable, "-m", "slipctl.commands.cli", "-q", "run", TOY, "--quick"]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert Path("out/toy/report.html").exists()


@pytest.mark.parametrize("out", ["x" * 300, "a/" + "x" * 300, os.fsdecode(b"\xff\xfe")])
def test_a_folder_that_cannot_be_made_is_refused_before_the_run(out: str, capsys) -> None:
    assert main(["run", TOY, "--quick", "--out", out]) == 2
    assert "cannot write " in capsys.readouterr().err
    assert not list(Path.cwd().iterdir())


# ---- a fitted law -------------------------------------------------------------------------------

CURVE_LAW = """from casadi import exp
from slipctl import Input, Output, Param, law

@law(mu=Output("1", "mu", positive="braking"), conditions={"dry": {"c": 1.0}, "ice": {"c": 0.1}})
def mine(
    s=Input("m/s", "slip", positive="braking", per="speed"),
    c=Param("1", 1.0, "height", lo=0.01, hi=2),
    a=Param("s/m", 0.5, "decay", lo=0.1, hi=2),
):
    return c * (exp(-a * s) - exp(-2 * a * s))
"""


@pytest.mark.second
def test_a_fitted_law_is_what_runs_and_its_file_is_told(capsys) -> None:
    """The whole way by the command line: fit, name the rail's conditions, swap, run, look."""
    Path("my.py").write_text(CURVE_LAW, encoding="utf-8")
    rows = [f"{s},{0.6 * (math.exp(-0.5 * s) - math.exp(-s)):.12g}" for s in range(1, 9)]
    Path("curve.csv").write_text("\n".join(["s [m/s],mu [1]", *rows, ""]), encoding="utf-8")
    digest = hashlib.sha256(Path("curve.csv").read_bytes()).hexdigest()[:16]
    assert main(["fit", "curve.csv", "--law", "my.py:mine", "--out", "fit"]) == 0
    few = ["--quick", "--loop", "soft", "--scenario", "base"]
    swapped = ["run", TOY, "--swap", "adh=fit/fitted.py:law", *few, "--out", "swapped"]
    assert main(swapped) == 2  # the rail has two conditions, the fitted law one set of numbers
    assert "law.with_conditions(dry={...}, ice={...})" in capsys.readouterr().err
    edited = Path("fit/fitted.py").read_text(encoding="utf-8")
    edited += 'law = law.with_conditions(dry={}, ice={"c": 0.08})\n'
    Path("fit/named.py").write_text(edited, encoding="utf-8")
    swapped[3] = "adh=fit/named.py:law"
    assert main(swapped) == 0
    assert main(["run", TOY, *few, "--out", "plain"]) == 0
    first, second = (store.read_json(Path(f"{n}/metrics.json")) for n in ("plain", "swapped"))
    found = second["parameters"]["soft"]["plant.adh.c"]
    assert found["value"] == pytest.approx(0.6, rel=1e-6)  # of which the curve was made
    assert found["source"] == f"fitted to curve.csv, sha256 {digest}"
    assert first["scenarios"]["base"]["soft"] != second["scenarios"]["base"]["soft"]
    data = xarray.load_dataset(Path("swapped/logs/base/soft.nc"))
    s, mu = (data[f"plant.{n}"].values[:300] for n in ("car.s", "adh.mu"))  # dry is the first half
    assert mu == pytest.approx(0.6 * (np.exp(-0.5 * s) - np.exp(-s)), abs=1e-6)
    assert f"curve.csv, sha256 {digest}" in Path("swapped/report.html").read_text(encoding="utf-8")


CAR = """
duration = "2 s"
[vehicle]
mode = "brake"
mass = "9 t"
axles = 1
radius = "0.42 m"
inertia = "110 kg m^2"
speed = "60 km/h"
[actuator]
kind = "lag"
torque = "8 kN m"
lag = "60 ms"
[rail]
law = "double_exponential"
[[rail.sections]]
place = "0 m"
condition = "wet"
[demand]
kind = "constant"
deceleration = "1 m/s^2"
[reference]
kind = "speed"
slip = "0.8 m/s"
[controllers.none]
kind = "none"
[controllers.slow]
kind = "pid"
K = "100 1/s"
[controllers.quick]
kind = "none"
"""


@pytest.mark.parametrize(
    "broken", ["", *(pytest.param(n, marks=pytest.mark.second) for n in ("none", "quick"))]
)
def test_a_controller_is_answered_as_soon_as_it_has_run(
    monkeypatch: pytest.MonkeyPatch, capsys, broken: str
) -> None:
    """The first of the file runs first; lines come in the order of the file, none is lost."""
    Path("car.toml").write_text(CAR)
    seen: list[list[str]] = []
    simulate = execution.simulate

    def watched(loop, *more, **options):
        seen.append(answered(capsys.readouterr().out))
        if names.pop(0) == broken:
            raise RuntimeError("broken on purpose")
        return simulate(loop, *more, **options)

    names = ["none", "slow", "quick"]
    monkeypatch.setattr(execution, "simulate", watched)
    assert main(["-q", "run", "car.toml", "--jobs", "1"]) == (1 if broken else 0)
    seen.append(answered(capsys.readouterr().out))
    first = [] if broken == "none" else ["none"]
    assert seen == [[], first, ["slow"], [] if broken == "quick" else ["quick"]]


def answered(text: str) -> list[str]:
    """Controllers that have a line."""
    return re.findall(r"^(none|slow|quick) .*; wheels", text, re.M)
