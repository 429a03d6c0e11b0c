"""Command lines that mean nothing: exit code 2, one line that names the option and the way out."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from slipctl import BadInput
from slipctl.commands import environment, progress
from slipctl.commands.certificates.certify_numbers import read_numbers
from slipctl.commands.cli import main
from slipctl.commands.progress import Progress, clock
from slipctl.commands.replay import pairs

LAW = "y = k*a where a [1], k = 2"
LAG = "x' = -x/T + a where x [m] = 0, a [m/s], T = 1 s"

OUT = ["--out", "x"]
REPLAY = ["replay", "none.csv", "--with", LAW, *OUT]
LINES: list[tuple[list[str], str]] = [
    (["c", LAW, "--out="], "--out names no folder; write one, or . for the current"),
    (["c", LAW, *OUT, "--fuzz", "0"], "--fuzz 0 gives it no time"),
    (
        ["c", "subway_braking:sta.ctl", "--part", "ctl", *OUT],
        "a part, and --part ctl another",
    ),
    (["run", "subway_braking:sta"], "run takes a study; write slipctl run subway_braking --loop"),
    (["sweep", "subway_braking:sta", "--out", ""], "--out names no folder; write one"),
    (["sweep", *OUT], "say what to run: slipctl sweep STUDY:LOOP"),
    (["sweep", "gain_bounds", "--export", "x.nc", *OUT], "--export writes one loop; name it"),
    (["tune", *OUT], "say what to tune: slipctl tune STUDY:LOOP"),
    (["tune", "subway_braking:sta", *OUT], "--minimise names no metric; write one"),
    (
        ["tune", "subway_braking:sta", "--minimise", "distance", "--out", ""],
        "--out names no folder",
    ),
    (
        ["tune", "gain_bounds:sta", "--minimise", "distance", "--free", "ctl.law.k1=1:2", *OUT],
        "gain_bounds declares no ensemble for sta in scenario base",
    ),
    (["replay", "none.csv", "--with", "subway_braking:sta", *OUT], "is a whole loop; write which"),
    (["open", "--port", "70000"], "--port 70000 is no port"),
    (["open", "--port", "-1"], "--port -1 is no port"),
    (["c", LAW, *OUT, "--set", "k=1"], "is no loop and has no --set"),
    (["c", LAW, *OUT, "--part", "ctl"], "is no loop and has no --part ctl"),
    (["c", LAW, *OUT, "--clock", "8MHz"], "--clock 8MHz is that of a processor"),
    (["c", LAW, *OUT, "--clock", "8MHz", "--check"], "--clock 8MHz is that of a processor"),
    (["c", LAW, *OUT, "--clock", "8MHz", "--target", "cortex-m4"], "write --check and --target"),
    (["c", "hst_traction", *OUT], "hst_traction"),
    (["replay", "none.csv", "--with", LAW, "--out", ""], "--out names no folder"),
    (
        [*REPLAY, "--map", "a"],
        "--map 'a': write NAME=..., such as omega=",
    ),
    ([*REPLAY, "--map", "=b"], "--map '=b': write NAME="),
    (
        [*REPLAY, "--map", "a= "],
        "--map 'a= ': write NAME=",
    ),
    (
        [*REPLAY, "--map", "a=b", "--map", "a=c"],
        "--map names a twice",
    ),
    (["fit", *OUT, "a.csv", "b.csv", "--law", LAW], "is a law; give it one curve"),
    (
        ["fit", *OUT, "a.csv", "--law", LAW, "--gap", "1s"],
        "--gap is for a flow and its log, not for a l",
    ),
    (["fit", *OUT, "a.csv", "--law", LAG, "--ordered"], "--ordered is for a law, not for a flow"),
    (["show", LAW, "--json", "--latex"], "--json says all; leave out --latex"),
    (["show", LAW, "--json", "--graph"], "--json says all; leave out"),
    (["new"], "write which vehicle"),
    (["new", "metor"], "there is no vehicle 'metor'; did you mean 'metro'"),
    (["new", "metro", "car.txt"], "car.txt is no TOML file; write car.txt.toml"),
    (["new", "metro", "there.toml"], "there.toml exists; name another file"),
    (
        ["new", "a.toml", "b.toml", "--from", "hst_braking:eppfc"],
        "--from takes the loop; write one",
    ),
    (["copy", "polach", "there"], "there is a folder; write a file, there"),
    (["copy", "polach", "there.py"], "there.py exists already and is not overwritten"),
    (["copy", "polach", "law.txt"], "law.txt must end in .py to be used as law.txt.py:block"),
    (["copy", "polach", "no/law.py"], "there is no folder no; make it first"),
    (["copy", "polch", "law.py"], "did you mean 'polach'"),
    (["certify", "super_twisting", "--set", "k1"], "--set k1: write NAME=VALUE, k1=1.5"),
    (["certify", "super_twisting", "--set", "k9=1"], "super_twisting has no 'k9'"),
    (["certify", "super_twisting", "--set", "k1=1", "k1=2"], "--set names k1 twice"),
    (
        ["certify", "super_twisting", "--map", "k1=1:2", "--json"],
        "--map writes its data to map.json",
    ),
    (["certify", "super_twistin"], "cannot certify 'super_twistin'; did you mean 'super_twisting'"),
    (["certify", "hst_traction", "--set", "k1=1"], "is a study; --set goes with one of its loops"),
    (["certify", "hst_traction", "--out", "c.json"], "is a study; --out goes with one of its"),
    (["check", "none.json"], "none.json"),
    (["compare", "there"], "compare takes two folders or more"),
    (["compare", "there", "no"], "is no folder of slipctl run or slipctl sweep"),
    ([], "say what to do: "),
]


@pytest.mark.parametrize(("words", "said"), LINES, ids=lambda v: None if isinstance(v, str) else
                         re.sub(r"\W+", "_", "_".join(v))[:70])  # fmt: skip
def test_a_line_that_means_nothing(words, said, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    Path("there.toml").write_text("x = 1")
    Path("there.py").write_text("x = 1")
    before = sorted(p.name for p in tmp_path.rglob("*"))
    assert main(words) == 2
    told = capsys.readouterr()
    assert said in told.err, told.err
    assert len(told.err.strip().splitlines()) == 1
    assert told.out == ""
    assert sorted(p.name for p in tmp_path.rglob("*") if p.name != "out") == before


def test_names_with_what_stands_behind_them():
    assert pairs("--map", ["a = b", "c=d=e"]) == {"a": "b", "c": "d=e"}
    with pytest.raises(BadInput, match=r"--set 'k': write NAME=..., such as T_b=0"):
        pairs("--set", ["k"])


# ---- numbers of certify --------------------------------------------------------------------------

SYSTEM: Any = SimpleNamespace(
    name="system", numbers={"L": SimpleNamespace(unit="m/s^2"), "n": SimpleNamespace(unit="1"),
                            "T": SimpleNamespace(unit="s")},
)  # fmt: skip


@pytest.mark.parametrize(
    ("texts", "found"),
    [
        (["L=1.5", "n=1/3"], {"L": "3/2", "n": "1/3"}),
        (["L=1.5cm/s^2", "n=.5", "T=2 ms"], {"L": "3/200", "n": "1/2", "T": "1/500"}),
        (["L=-2e3"], {"L": "-2000"}),
        (["T=3/4 min"], {"T": "45"}),
        ([], {}),
    ],
)
def test_numbers_are_exact(texts: list[str], found: dict[str, str]) -> None:
    assert {k: str(v) for k, v in read_numbers(SYSTEM, texts).items()} == found


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["L"], "--set L: write NAME=VALUE, L=1.5"),
        (["M=1"], "system has no 'M'"),
        (["L=1", "L=1"], "--set names L twice"),
        (["L=one"], "L=one is no finite number; write one in m/s.2, L=1.5"),
        (["L=1/0"], "L=1/0 is no finite number"),
        (["L=nan"], "L=nan is no finite number"),
        (["L=" + 61 * "1"], "is no finite number"),
        (["L=1kg"], "L is in m/s.2, not in kg"),
        (["L=1m/s^2", "T=1"], "T has no unit and others have one; write T in s"),
    ],
)
def test_numbers_that_are_none(texts: list[str], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        read_numbers(SYSTEM, texts)


# ---- the environment -----------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["", "-1", "1.5", "now", "0x10", "253402300800", 13 * "1"])
def test_a_time_of_building_that_is_none(given: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", given)
    with pytest.raises(BadInput, match=r"SOURCE_DATE_EPOCH = .*no whole number of seconds"):
        environment.check_environment()


@pytest.mark.parametrize("given", ["0", "1700000000", "253402300799", None])
def test_a_time_of_building(given: str | None, monkeypatch: Any) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    if given is not None:
        monkeypatch.setenv("SOURCE_DATE_EPOCH", given)
    assert environment.check_environment() is None


@pytest.mark.parametrize(
    ("given", "taken"),
    [("4,2", "4"), ("16 , 1", "16"), ("many", "1"), ("0", "1"), ("4", None), ("", None)],
)
def test_threads_of_several_levels(given: str, taken: str | None, monkeypatch: Any) -> None:
    monkeypatch.delenv("NUMEXPR_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    lines = list(environment.tell_threads())
    assert environment.os.environ.get("NUMEXPR_NUM_THREADS") == taken
    assert [f"{taken} is taken" in k and given in k for k in lines] == [True] * (taken is not None)
    monkeypatch.setenv("NUMEXPR_NUM_THREADS", "3")
    assert list(environment.tell_threads()) == []


@pytest.mark.parametrize("given", ["", "0", "0.0", "-1", "1e3", "soon", "1234567"])
def test_a_time_between_lines_that_is_none(given: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("SLIPCTL_PROGRESS", given)
    with pytest.raises(BadInput, match=r"SLIPCTL_PROGRESS = .*write seconds, such as 30"):
        environment.progress_interval()


def test_a_time_between_lines(monkeypatch: Any) -> None:
    monkeypatch.setenv("SLIPCTL_PROGRESS", "2.5")
    assert environment.progress_interval() == 2.5
    monkeypatch.delenv("SLIPCTL_PROGRESS")
    assert environment.progress_interval() == 30.0


# ---- how far a run is ----------------------------------------------------------------------------


class Terminal(io.StringIO):
    """A stream that is watched, or not."""

    def __init__(self, watched: bool) -> None:
        super().__init__()
        self.watched = watched

    def isatty(self) -> bool:
        return self.watched


@pytest.fixture
def now(monkeypatch: Any) -> list[float]:
    """Time in s that the test sets."""
    at = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: at[0])
    return at


def test_a_terminal_sees_all_that_goes_on(now) -> None:
    stream = Terminal(watched=True)
    shown = Progress(4, stream, quiet=False)
    shown("one", 0.0)
    now[0] += 10.0
    shown("two", 0.25)
    now[0] += 10.0
    shown("one", 0.5)
    last = stream.getvalue().rpartition("\033[J")[2].splitlines()
    # a share of 0.75 of 4 is done: 4.5 of 24 signs; one took 20 s for its half, two 10 s for 1/4
    assert last == ["[####....................] 0/4", "  one: 50 %, 20 s left",
                    "  two: 25 %, 30 s left"]  # fmt: skip
    before = stream.getvalue()
    now[0] += 0.05
    shown("one", 0.6)
    assert stream.getvalue() == before  # not more often than ten times a second
    shown("one", 1.0)
    written = stream.getvalue()[len(before) :]
    assert written.startswith("\r\033[2A\033[J")  # over the three lines before
    rows = written.rpartition("\033[J")[2].splitlines()
    assert rows == ["[########................] 1/4", "  two: 25 %, 30 s left"]
    shown("two", 1.0)
    assert stream.getvalue().endswith("[############............] 2/4")
    shown.end()
    assert stream.getvalue().endswith("\r\033[J")
    assert shown.lines == 0


@pytest.mark.parametrize(("watched", "quiet"), [(False, False), (True, True)])
def test_a_file_has_a_line_for_each_and_one_now_and_then(watched, quiet, now, caplog) -> None:
    stream = Terminal(watched)
    caplog.set_level("INFO", logger="slipctl")
    shown = Progress(2, stream, quiet)
    for seconds, share in ((0, 0.0), (29, 0.3), (2, 0.5), (29, 0.6), (2, 0.7), (60, 1.0)):
        now[0] += seconds
        shown("one", share)
    shown("two", 0.01)
    shown("two", 1.0)
    shown.end()
    assert stream.getvalue() == ""
    assert caplog.messages == ["1/2 one", "one: 50 %, 31 s left", "one: 70 %, 27 s left", "2/2 two"]


def test_the_time_in_which_a_run_is_built_is_not_taken_for_that_of_its_steps(now, caplog) -> None:
    caplog.set_level("INFO", logger="slipctl")
    shown = Progress(1, Terminal(False), quiet=False)
    for seconds, share in ((0, 0.0), (300, 0.02), (31, 0.32)):
        now[0] += seconds
        shown("one", share)
    assert caplog.messages[-1] == "one: 32 %, 70 s left"  # 31 s for 0.3


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0, "0 s"), (89, "89 s"), (90, "2 min"), (300, "5 min"), (5399, "90 min"), (5400, "1.5 h")],
)
def test_a_time_in_words(seconds: float, said: str) -> None:
    assert clock(seconds) == said


def test_what_is_written_is_named_for_programs(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["copy", "polach", "law.py", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["file"], said["block"]) == ("law.py", "polach")
    assert Path("law.py").is_file()
    assert main(["new", "metro", "car.toml", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert all(Path(said[k]).is_file() for k in ("file", "schema"))
    assert json.loads(Path(said["schema"]).read_text(encoding="utf-8"))["$defs"]
    assert main(["copy", "polach", "other.py"]) == 0
    assert "slipctl show other.py:polach" in capsys.readouterr().out
