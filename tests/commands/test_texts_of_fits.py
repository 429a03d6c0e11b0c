"""What a fitted log leaves: data, keys of a vehicle's file, samples, a figure, a report."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl import Input, Output, Param, State, flow
from slipctl.commands import fit_log
from slipctl.commands.library import copy, new
from slipctl.draw import plots
from slipctl.errors import BadInput
from slipctl.estimate.log_fit.record import DEAD, FittedOverTime, Piece
from slipctl.workbench.sources import opened_sweeps


@flow(a=Output("m/s^2", "acceleration"), P=Output("W", "power"))
def rolls(
    v=State("m/s", 9.0, "speed"),
    F=Input("N", "force"),
    m=Param("kg", 2.0, "mass that moves"),
    k=Param("N s/m", 3.0, "drag"),
    ratio=Param("1", 0.5, "share of it"),
    half=Param("kg", "m / 2", "half of it"),
    table=Param("1", np.zeros(2), shape=(2,)),
):
    """A cart."""
    return dict(v=(F - k * v) / m), dict(a=(F - k * v) / m, P=F * v)


def piece(time: list[float], measured: list[float], fitted: list[float]) -> Piece:
    return Piece(*map(np.array, (time, measured, fitted)))


NAN = float("nan")
PIECES = (
    piece([0.0, 0.5, 1.0], [1.0, NAN, 3.0], [1.25, 2.0, 2.5]),
    piece([5.0, 6.0], [7.0, 9.0], [7.5, 9.25]),
)


def fitted(**more: Any) -> FittedOverTime:
    values = {"m": 2.5, "ratio": 0.333, "k": 7.04, DEAD: 0.125}
    made = dict(
        flow=rolls, sources=("a.csv", "b.csv"), output="a", values=values,
        std={"m": 0.0312, "ratio": 0.2, "k": 0.456, DEAD: 0.0078},
        interval={"m": (2.4, 2.6), "ratio": (0.1, 0.5), "k": (6.0, 8.0), DEAD: (0.11, 0.14)},
        correlation={("m", "k"): 0.75, ("m", "ratio"): -0.5}, starts=(8.0, 4.0), pieces=PIECES,
        alike=3.0, doubts=("hardly k",), notes=("m was 2",), delayed="F",
    )  # fmt: skip
    return FittedOverTime(**made | more)


def test_a_fit_as_data_has_what_was_found_and_what_was_known() -> None:
    told = fit_log.payload(fitted(), "cart.rolls", ["read at once"], "CMD")
    assert told["parameters"] == {
        "m": {"value": 2.5, "unit": "kg", "std": 0.0312},
        "ratio": {"value": 0.333, "unit": "1", "std": 0.2},
        "k": {"value": 7.04, "unit": "N s/m", "std": 0.456},
        DEAD: {"value": 0.125, "unit": "s", "std": 0.0078},
    }
    assert told["interval_95"]["k"] == [6.0, 8.0]
    assert told["correlation"] == {"m, k": 0.75, "m, ratio": -0.5}
    assert (told["output"], told["unit"], told["points"]) == ("a", "m/s^2", 4)
    assert told["max_error"] == 0.5
    assert told["rms"] == pytest.approx(np.sqrt((0.0625 + 0.25 + 0.25 + 0.0625) / 4))
    assert (told["samples_alike"], told["starts"]) == (3.0, [8.0, 4.0])
    assert (told["delayed"], told["doubts"]) == ("F", ["hardly k"])
    assert (told["law"], told["source"]) == ("cart.rolls", "fitted to a.csv; b.csv")
    assert told["known"] == {}
    few = fitted(values={"k": 7.04}, output="v")
    told = fit_log.payload(few, "cart.rolls", ["read at once"], "CMD")
    assert told["known"] == {
        "m": {"value": 2.0, "unit": "kg"},
        "ratio": {"value": 0.5, "unit": "1"},
    }
    assert told["unit"] == "m/s"
    assert told["notes"] == ["read at once", "m was 2"]
    assert told["command"] == "CMD"


def test_samples_that_were_measured_are_told_by_their_stretch() -> None:
    rows = fit_log.residuals_text(fitted()).splitlines()
    assert rows[0] == "stretch,time [s],a [m/s^2],fitted [m/s^2],residual [m/s^2]"
    assert [[float(c) for c in row.split(",")] for row in rows[1:]] == [
        [1, 0.0, 1.0, 1.25, -0.25], [1, 1.0, 3.0, 2.5, 0.5], [2, 5.0, 7.0, 7.5, -0.5],
        [2, 6.0, 9.0, 9.25, -0.25],
    ]  # fmt: skip


def test_keys_of_a_vehicle_stand_in_their_tables_in_whole_steps() -> None:
    keys = {"m": "vehicle.mass", "half": "vehicle.half", "ratio": "vehicle.share",
            "k": "actuator.drag.k", DEAD: "actuator.late"}  # fmt: skip
    said = fit_log.keys_text(fitted(), keys, {"actuator.late": 0.05, "vehicle.mass": 0.75})
    head, *rest = said.splitlines()
    assert head == "# fitted to a.csv; b.csv"
    assert [line.split("#")[0].strip() for line in rest] == [
        "", "[vehicle]", 'mass = "2.25 kg"', "share = 0.333", "", "[actuator.drag]",
        'k = "7.04 N s/m"', "", "[actuator]", 'late = "0.1 s"',
    ]  # fmt: skip
    assert [line.split("# ")[1] for line in rest if "#" in line] == [
        "+- 0.031", "+- 0.2", "+- 0.46", "+- 0.0078"]  # fmt: skip
    assert {line.index("#") for line in rest if "#" in line} == {41}


def test_a_figure_has_measured_and_fitted_of_each_stretch_and_below_what_is_left() -> None:
    above, below = fit_log.figure(fitted()).get_axes()

    def lines(axis: Any) -> dict[str, Any]:
        return {str(k.get_label()): np.asarray(k.get_ydata()) for k in axis.get_lines()}

    drawn = lines(above)
    assert list(drawn) == ["measured 1", "fitted 1", "measured 2", "fitted 2"]
    assert drawn["fitted 2"].tolist() == [7.5, 9.25]
    assert drawn["measured 1"][[0, 2]].tolist() == [1.0, 3.0]
    assert above.get_ylabel() == "acceleration [m/s²]"
    assert below.get_ylabel() == "measured - fitted [m/s²]"
    assert (above.get_xlabel(), below.get_xlabel()) == ("", "time [s]")
    left = lines(below)
    assert left["residual 2"].tolist() == [-0.5, -0.25]
    assert [np.ravel(k.get_ydata())[0] for k in below.get_lines()
            if k.get_color() == plots.GREY] == [0]  # fmt: skip
    assert below.get_legend() is None
    one = fit_log.figure(fitted(pieces=PIECES[1:])).get_axes()
    assert list(lines(one[0])) == ["measured", "fitted"]


def test_a_report_has_a_row_of_each_number_and_its_files(tmp_path: Path) -> None:
    (tmp_path / fit_log.KEYS_FILE).write_text("# keys\nmass = 2\n\n")
    said = fit_log.report(fitted(), tmp_path, {"m": "vehicle.mass"})
    head, table, errors, keys, files = said.split("\n\n")
    assert head == "rolls fitted to a.csv, b.csv, 4 samples of a in 2 stretches"
    rows = [[c for c in line.split("  ") if c] for line in table.splitlines()]
    told = {row[0].strip(): [c.strip() for c in row[1:]] for row in rows[2:]}
    assert told == {
        "m": ["2.5", "0.031", "2.4 .. 2.6", "kg", "mass that moves"],
        "ratio": ["0.333", "0.2", "0.1 .. 0.5", "1", "share of it"],
        "k": ["7.04", "0.46", "6 .. 8", "N s/m", "drag"],
        DEAD: ["0.125", "0.0078", "0.11 .. 0.14", "s", "of F"],
    }
    assert errors == "largest error 0.5 m/s^2, rms 0.395 m/s^2"
    assert keys == "# keys\nmass = 2"
    names = ["fit.json", "fit.png", "residuals.csv", fit_log.KEYS_FILE]
    assert files.split("\n") == [str(tmp_path / n) for n in names]
    plain = fit_log.report(fitted(pieces=PIECES[:1]), tmp_path, {})
    assert "2 samples of a in 1 stretch\n" in plain
    assert plain.endswith(str(tmp_path / "residuals.csv"))


# ---- new files, sweeps ---------------------------------------------------------------------------


@pytest.mark.parametrize(("source", "kind", "out"), [
    ("toy.py:pid@wet", None, "pid.toml"), ("toy.py:pid", None, "pid.toml"),
    ("toy", None, "toy.toml"), ("a:b", "own.toml", "own.toml"), ("toy.py:@wet", None, "loop.toml"),
])  # fmt: skip
def test_a_file_of_a_loop_has_its_name(source, kind, out, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(new.loop_files, "loop_file_text", lambda name, file: f"{name} {file}")
    monkeypatch.setattr(new.trip_files, "schema_text", lambda: "SCHEMA")
    options: Any = SimpleNamespace(source=source, kind=kind, file=None, json=False)
    assert new.answer(options, "") == 0
    assert Path(out).read_text() == f"{source} {out}"
    assert Path(new.SCHEMA).read_text() == "SCHEMA"
    assert capsys.readouterr().out.splitlines() == [
        f"{out}: edit it, then slipctl run {out}", f"{new.SCHEMA}: for your editor"]  # fmt: skip
    with pytest.raises(BadInput, match="exists; name another"):
        new.answer(options, "")
    options.file = "more.toml"
    with pytest.raises(BadInput, match="takes the loop"):
        new.answer(options, "")


@pytest.mark.parametrize("command", [new, copy])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is(
    command: Any, tmp_path, monkeypatch
) -> None:
    def refuse(file: Path) -> None:
        raise BadInput(f"cannot write {file}")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command.store, "check_file", refuse)
    options: Any = SimpleNamespace(source=None, kind="metro", model="davis", json=False)
    options.file = "a.py" if command is copy else "a.toml"
    with pytest.raises(BadInput, match="cannot write a"):
        command.answer(options, "")
    assert not list(tmp_path.iterdir())
    options.kind = "metre"
    if command is new:
        with pytest.raises(BadInput, match=r"there is no vehicle 'metre'; did you mean 'metro'"):
            command.answer(options, "")
        options.kind = None
        with pytest.raises(BadInput, match="write which vehicle"):
            command.answer(options, "")


@pytest.mark.parametrize(("command", "loop", "scenario", "wanted"), [
    ("slipctl sweep below/car.toml:pid --out x", "car:pid", "", "below/car.toml:pid"),
    ("slipctl sweep -q below/car.toml --out x", "car:pid", "wet", "below/car.toml:pid@wet"),
    ("slipctl sweep subway_braking:sta", "subway_braking:sta", "base", "subway_braking:sta@base"),
    ("slipctl sweep other.toml:pid", "car:pid", "", None), ("", "car:pid", "", None),
])  # fmt: skip
def test_the_file_of_a_sweep_is_that_of_its_command(
    command, loop, scenario, wanted, tmp_path, monkeypatch
) -> None:
    """Beside this folder, or beside one that the sweep lies in."""
    (tmp_path / "below" / "out" / "deep").mkdir(parents=True)
    (tmp_path / "below" / "car.toml").write_text("")
    (tmp_path / "other.toml").write_text("")
    found: Any = SimpleNamespace(
        about={"loop": loop, "scenario": scenario, "command": command},
        folder=tmp_path / "below" / "out" / "deep",
    )  # fmt: skip
    monkeypatch.chdir(tmp_path)
    if wanted is None:
        with pytest.raises(BadInput, match="is not here"):
            opened_sweeps.loop_of_sweep(found)
        return
    assert opened_sweeps.loop_of_sweep(found) == wanted
    monkeypatch.chdir("/")
    there = wanted if wanted.startswith("subway") else f"{tmp_path}/{wanted}"
    assert opened_sweeps.loop_of_sweep(found) == there


def test_runs_of_a_sweep_have_what_was_set_and_what_was_drawn(monkeypatch) -> None:
    """In the units of the sliders; metrics in those that are shown; the first runs of many."""
    monkeypatch.setattr(opened_sweeps, "MOST", 2)
    monkeypatch.setattr(opened_sweeps, "value_in_run", lambda n, metrics: metrics.get(n, NAN))
    sliders: Any = [
        SimpleNamespace(name="car.m", unit="kg"),
        SimpleNamespace(name="ctl.K", unit="1"),
    ]
    found: Any = SimpleNamespace(
        about={"set": ["car.m=2t", "gone.x=3"], "command": "CMD", "swapped": ["adh"]},
        units={"slip_max": ("m/s", 1), "torque_max": ("N m", 1)},
        runs=[(0, {"ctl.K": 4.0, "noise.a": 1.0}, {"slip_max": 0.5, "torque_max": 3000.0}, ""),
              (3, {"ctl.K": 5.0, "car.m": 1500.0}, {"torque_max": 1000.0}, "NaN"),
              (4, {"late": 1.0}, {}, "")],
        folder=Path("out"), missing=7, limits={"torque_max": 2500.0}, kept=Path("out/logs"),
    )  # fmt: skip
    told = opened_sweeps.rows_of_sweep(found, sliders)
    assert told["runs"] == [
        {"run": 0, "numbers": {"car.m": 2000.0, "ctl.K": 4.0},
         "all": {"ctl.K": 4.0, "noise.a": 1.0}, "metrics": [0.5, 3.0], "failed": ""},
        {"run": 3, "numbers": {"car.m": 1500.0, "ctl.K": 5.0},
         "all": {"ctl.K": 5.0, "car.m": 1500.0}, "metrics": [None, 1.0], "failed": "NaN"},
    ]  # fmt: skip
    assert told["metrics"] == [
        {"key": "slip_max", "name": "slip max", "unit": "m/s", "limit": None},
        {"key": "torque_max", "name": "torque max", "unit": "kN m", "limit": 2.5},
    ]
    assert told["axes"] == ["car.m", "ctl.K", "noise.a"]
    assert told["lost"] == ["noise.a", "gone.x"]
    assert (told["folder"], told["missing"], told["kept"]) == ("out", 7, "out/logs")
    assert (told["command"], told["swapped"]) == ("CMD", ["adh"])
