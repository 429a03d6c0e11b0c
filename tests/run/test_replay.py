"""Recorded logs: read as people write them, and a part of a loop gives over them what it gave."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import closed_loop, three_rails
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    from_text,
    law,
    replicate,
    simulate,
    step,
)
from slipctl.commands.cli import main
from slipctl.errors import Faults
from slipctl.run.logs.recorded_log import read_recording
from slipctl.run.logs.replay import part_of, replay

INPUTS = ("v", "v_s", "mu_hat", "f_hat", "W_hat", "v_opt", "a_demand")


@cache
def recorded() -> tuple[Block, Any]:
    """Loop with super-twisting on three rails, and its log."""
    loop = closed_loop(lag=True)
    return loop, simulate(loop, three_rails(0.06), compile=False)


def write(path: Path, columns: dict[str, Any], mark: str = ",", comma: bool = False,
          start: str = "") -> Path:  # fmt: skip
    """Write columns as CSV, all digits."""
    rows = [mark.join(columns)]
    for row in zip(*columns.values(), strict=True):
        cells = [c if isinstance(c, str) else repr(float(c)) for c in row]
        rows.append(mark.join(c.replace(".", ",") if comma else c for c in cells))
    path.write_text(start + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def own_log() -> dict[str, np.ndarray]:
    """Time and what the controller heard."""
    loop, log = recorded()
    columns = {"time": log["time"].values}
    for n in INPUTS:
        source = loop.wires.get(f"ctl.{n}", n)
        source = source if source in log else n
        columns[n] = log[source].values if source in log else np.full(60, loop.inputs[n].value)
    return columns


def test_a_controller_gives_what_it_gave(tmp_path: Path) -> None:
    """Over its own log the controller of a loop gives the same torque, bit for bit."""
    loop, log = recorded()
    file = write(tmp_path / "log.csv", own_log())
    found = replay(part_of(loop, "ctl"), read_recording(file), {}, compile=False)
    assert (found.data["T_b"].values == log["ctl.T_b"].values).all()


def test_as_people_have_it(tmp_path: Path) -> None:
    """Semicolons, decimal comma, a mark in front, ms and km/h, two rows late, one twice."""
    loop, log = recorded()
    columns = own_log()
    columns["time [ms]"] = 1e3 * columns.pop("time")
    columns["Speed (km/h)"] = 3.6 * columns.pop("v")
    order = [0, 1, 2, 5, 3, 4, *range(6, 40), 39, *range(40, 60)]
    mixed = {n: v[order] for n, v in columns.items()}
    file = write(tmp_path / "log.csv", mixed, ";", comma=True, start="\ufefflogger 7;v1.2\n\n")
    recording = read_recording(file, "time[ms]")
    found = replay(part_of(loop, "ctl"), recording, {"v": "Speed"}, compile=False)
    # 1e-9: km/h and ms cost two roundings
    assert np.allclose(found.data["T_b"].values, log["ctl.T_b"].values, rtol=1e-9)
    told = "; ".join(found.notes)
    for said in (
        "2 rows written late",
        "1 row with the time of the row before, which was left out: line",
        "Speed converted",
    ):
        assert said in told


def test_gaps_and_dropouts(tmp_path: Path) -> None:
    """A stretch without samples and empty cells hold the last value, are told, and not counted."""
    t = np.arange(100) * 0.01
    x = np.sin(5 * t)
    cells: Any = [repr(float(v)) for v in x]
    cells[10:13] = ["", "NaN", "-"]
    cells[20] = "99.0"  # off the range of the input
    keep = (t < 0.5 - 1e-9) | (t >= 0.7 - 1e-9)
    columns = {"t": t[keep], "x [m]": [c for c, k in zip(cells, keep, strict=True) if k]}
    file = write(tmp_path / "log.csv", columns)
    block = from_text("y = 2*x", inputs={"x": "m in -2 .. 2"})
    found = replay(block, read_recording(file), {"x": "x"}, beside={"y": "x[m]"}, compile=False)
    y = found.data["y"].values
    assert y.size == 100
    held = x.copy()
    held[10:13], held[20], held[50:70] = x[9], x[19], x[49]
    assert np.allclose(y, 2 * held, rtol=1e-12)  # a rounding of each tick's time at most
    told = "; ".join(found.notes)
    for said in ("1 gaps", "3 empty cells", "1 samples off -2 .. 2 m"):
        assert said in told
    recorded_ = found.compared[0].recorded
    assert np.isnan(recorded_[51:69]).all()
    assert np.isfinite(recorded_[:50]).all()


def test_arithmetic_has_units(tmp_path: Path) -> None:
    """A column in another dimension is turned round by a parameter, and checked to be right."""
    t = np.arange(5) * 0.1
    file = write(tmp_path / "log.csv", {"t": t, "Wheel [km/h]": 36 + 0 * t})
    block = from_text("v = omega*r where omega [rad/s], r = 0.5 m")
    found = replay(block, read_recording(file), {"omega": "Wheel[km/h] / r"}, compile=False)
    assert np.allclose(found.data["v"].values, 10.0, rtol=1e-12)  # a few roundings
    for text, said in (("Wheel", "convert it by an expression"), ("Wheel * r", "this is"),
                       ("Weel / r", "did you mean 'Wheel'"), ("Wheel / q", "no param 'q'"),
                       ("Wheel / (r", "column"), ("Wheel[km/q]", "no known unit")):  # fmt: skip
        with pytest.raises(Faults, match=said):
            replay(block, read_recording(file), {"omega": text}, compile=False)


def test_arithmetic_takes_further_columns(tmp_path: Path) -> None:
    """Slip speed from two recorded speeds, the unit of each in the head or behind its name."""
    t = np.arange(5) * 0.1
    file = write(tmp_path / "log.csv", {"t": t, "Train [km/h]": 36 + t, "Wheel": 180 + t})
    block = from_text("y = v_s*r where v_s [m/s], r = 0.5 m")
    found = replay(block, read_recording(file), {"v_s": "Train - Wheel[rpm] * r"}, compile=False)
    wanted = 0.5 * ((36 + t) / 3.6 - (180 + t) * 2 * np.pi / 60 * 0.5)
    assert np.allclose(found.data["y"].values, wanted, rtol=1e-12)  # a few roundings
    with pytest.raises(Faults, match="1/min may count revolutions or radians; write rpm"):
        replay(block, read_recording(file), {"v_s": "Train - Wheel[1/min] * r"}, compile=False)


@pytest.mark.parametrize(("head", "said", "factor"), [
    ("1/min", "rpm", 2 * np.pi / 60), ("Hz", "turn/s", 2 * np.pi), ("1/s", "rad/s", 1.0),
    ("1/min", "turn/s", None), ("rpm", "rad/s", None), ("rad/s", "rpm", None),
])  # fmt: skip
def test_a_person_says_what_a_rate_in_a_head_counts(
    tmp_path: Path, head: str, said: str, factor: float | None
) -> None:
    """A head of 1/min is refused where it is wanted, and the unit that the line asks for is taken;
    another time, or a unit that contradicts the head, is not."""
    t = np.arange(5) * 0.1
    file = write(tmp_path / "log.csv", {"t": t, f"n [{head}]": 180 + t})
    block = from_text("y = 2*w where w [rad/s]")
    mapped = {"w": f"n[{said}]"}
    if factor is None:
        with pytest.raises(Faults, match="units are never overruled"):
            replay(block, read_recording(file), mapped, compile=False)
        return
    found = replay(block, read_recording(file), mapped, compile=False)
    assert np.allclose(found.data["y"].values, 2 * factor * (180 + t), rtol=1e-12)


@step(period=0.1)
def counted(n=State("1", 0.0), u=Input("1"), k=Param("1", 2.0, lo=0, hi=10)):  # type: ignore[no-untyped-def]
    """A sum."""
    return {"n": n + k * u}, {}


def test_a_part_of_which_there_are_copies_is_one_of_them() -> None:
    """With the numbers that all copies have; refused where they differ."""
    one = connect("axle", {"filter.u": "u"}, filter=counted)
    both = connect("train", {}, axles=replicate(one, 2, distinct=("filter.k",)))
    path = "axles.filter"
    state, _ = part_of(both, path)(u=1.0, n=1.0)
    assert state["n"] == 3.0
    differing = both.with_params(**{f"{path}.k": [2.0, 3.0]})
    with pytest.raises(BadInput, match=r"axles\.filter\.k differs from copy to copy"):
        part_of(differing, path)


def test_units_in_a_row_and_dates(tmp_path: Path) -> None:
    """A row of units below the head counts, and times of a calendar are seconds from the first."""
    rows = ["Time;Speed", ";km/h", "2024-05-01 12:00:00.000;36,0", "2024-05-01 12:00:00.500;72,0"]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(rows), encoding="utf-16")
    log = read_recording(file)
    assert list(log.time) == [0.0, 0.5]
    assert (log.units, list(log.channel("Speed"))) == ({"Speed": "km/h"}, [36.0, 72.0])


def test_all_faults_at_once(tmp_path: Path, capsys: Any) -> None:
    """Each wrong mapping is a line; so is an input that nothing feeds."""
    file = write(tmp_path / "log.csv", {"t": np.arange(5.0), "a [km/h]": np.arange(5.0)})
    line = ["replay", str(file), "--with", "y = k*x + z where x [m], z [m], k = 2",
            "--map", "x=b", "q=a", "--set", "k=2 kg", "--out", str(tmp_path / "out")]  # fmt: skip
    assert main(line) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 4
    for said, text in zip(("--set", "--map x", "--map q", "law.z"), told, strict=True):
        assert said in text
    assert not (tmp_path / "out").exists()


def test_command(tmp_path: Path, capsys: Any) -> None:
    """The report, the table and the numbers are written; a residual that is known is told."""
    t = np.arange(50) * 0.02
    file = write(
        tmp_path / "log.csv", {"t [s]": t, "w [rad/s]": 20 + t, "gps [m/s]": 10 + t / 2 + 0.25}
    )
    out = tmp_path / "out"
    line = ["replay", str(file), "--with", "v = omega*r where omega [rad/s], r = 0.5 m",
            "--map", "omega=w", "--beside", "v=gps", "--out", str(out), "--no-compile"]  # fmt: skip
    assert main(line) == 0
    shown = capsys.readouterr().out
    assert "50 ticks of 0.02 s, 0 gaps" in shown
    assert "v: recorded minus computed  m/s   0.25  0.25  0.25" in shown
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == 1
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (out / "replay.csv").read_text().startswith("time [s],omega [rad/s],v [m/s],v recorded")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "has no head"),
        ("a;b\n", "no row of numbers below it"),
        ("1;2\n3;4\n", "has no head"),
        ("t;x\n0;1\n", "fewer than two different times"),
        ("t;t\n0;1\n1;2\n", "two columns 't'"),
        ("t;x\n0;1\n0;2\n", "fewer than two different times"),
        ("t;x\nnan;1\n-;2\n", "fewer than two different times"),
        ("t;x\n0;1\n1;abc\n", "'abc' in line 3 is no number"),
        ("t;x\n0;1\nabc;2\n", "is no number"),
        ("\x00\x01", "is no text"),
    ],
)
def test_no_log(content: str, said: str, tmp_path: Path) -> None:
    """What cannot be read as a log is one line."""
    file = tmp_path / "log.csv"
    file.write_text(content)
    with pytest.raises(BadInput, match=said):
        read_recording(file).channel("x")


PIECES = st.sampled_from(
    ["t", ";", ",", "\t", "\n", "1", "2,5", "3.5", "x", "[m/s]", "(km/h)", '"', "\ufeff", "NaN",
     "-", "1e999", "2024-01-01", " ", "\x00", "é"]
)  # fmt: skip
TEXTS = st.lists(PIECES, max_size=60).map("".join).map(str.encode)


@given(st.one_of(TEXTS, st.binary(max_size=200)))
def test_hostile_logs(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    """Whatever a file holds is read or told."""
    file = tmp_path_factory.mktemp("log") / "log.csv"
    file.write_bytes(content)
    try:
        log = read_recording(file)
        for name in log.columns:
            log.channel(name)
    except BadInput:
        return
    assert (np.diff(log.time) > 0).all()


def test_times_with_a_zone_are_read_without_a_word(tmp_path: Path, recwarn) -> None:
    """The zone is taken off, so that samples before and after summer time follow each other."""
    rows = ["Time;Speed", "2024-10-27T02:59:59+02:00;36", "2024-10-27T02:00:00+01:00;72"]
    (tmp_path / "log.csv").write_text("\n".join(rows), encoding="utf-8")
    assert read_recording(tmp_path / "log.csv").time.tolist() == [0, 1]
    assert not recwarn.list


@pytest.mark.parametrize("text", ["2*R_wheel*k + Rim - Train", "Rim - Train + k*R_wheel*2"])
def test_arithmetic_takes_what_stands_beside_a_law_and_its_parameters(
    tmp_path: Path, text: str
) -> None:
    """In whatever order: 2 times 0.5 m times 3/s above the rim's 1 m/s."""

    @law(y=Output("1", "adhesion"), beside={"R_wheel": Param("m", 0.5, "radius")})  # type: ignore
    def curve(v=Input("m/s", "slip"), k=Param("1/s", 3.0)):  # type: ignore[no-untyped-def]
        """A line."""
        return v * k

    t = np.arange(5) * 0.1
    file = write(tmp_path / "log.csv", {"t": t, "Rim [m/s]": 2 + 0 * t, "Train [m/s]": 1 + 0 * t})
    found = replay(curve, read_recording(file), {"v": text}, compile=False)
    assert np.allclose(found.data["y"].values, 3.0 * 4.0, rtol=1e-12)
