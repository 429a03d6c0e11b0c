"""What ``slipctl sweep`` prints of one loop and of several, and how it ends."""

import json

import numpy as np
import pytest

from slipctl.commands.cli import main

FILE = """
title = "short"
duration = "60 ms"
[vehicle]
mass = "38 t"
axles = 2
inertia = "110 kg m^2"
speed = "{speed}"
[actuator]
kind = "lag"
torque = "8 kN m"
[rail.conditions]
x = {{ c = 0.5 }}
[[rail.sections]]
place = "0 m"
condition = "x"
[demand]
kind = "constant"
deceleration = "1 m/s^2"
[reference]
kind = "speed"
slip = "0.5 m/s"
[limits]
distance = "1.0 m"
[ensemble]
draw = {{ m = "30 t:45 t" }}
[controllers.none]
kind = "none"
{more}
"""
PID = '[controllers.pid]\nkind = "pid"\n'


def swept(folder, capsys, *words, more="", speed="60 km/h", loop=""):
    """Exit code, what is printed, and what is said beside it."""
    path = folder / "car.toml"
    path.write_text(FILE.format(more=more, speed=speed), encoding="utf-8")
    out = str(folder / "out")
    code = main(["-q", "sweep", f"{path}{loop}", "--out", out, "--no-compile", *words])
    told = capsys.readouterr()
    return code, told.out, told.err


def row(text, metric):
    """Cells of a line of a table."""
    return next(line for line in text.splitlines() if line.startswith(metric)).split()


@pytest.mark.second
def test_the_table_of_one_loop_has_the_spread_of_its_runs(tmp_path, capsys):
    """Least, median and largest distance are those of what the store holds."""
    from slipctl import open_sweep

    code, text, _ = swept(tmp_path, capsys, "--samples", "5", loop=":none")
    runs = open_sweep(tmp_path / "out")
    values = np.array(next(v for n, _, v in runs.labelled() if n == "distance"))
    assert code == 0
    cells = row(text, "distance")
    assert cells[1] == "m"
    assert [float(c) for c in cells[2:7]] == pytest.approx(
        np.quantile(values, [0, 0.05, 0.5, 0.95, 1]), rel=1e-3
    )
    assert "5 runs" in text
    assert "m = 30000 .. 45000 kg (drawn)" in text


def test_a_file_with_one_loop_has_its_table_too(tmp_path, capsys):
    """All loops of a file that has one: the spread, not a comparison with nothing."""
    code, text, _ = swept(tmp_path, capsys, "--samples", "4")
    assert code == 0
    assert row(text, "metric")[:3] == ["metric", "unit", "least"]
    assert row(text, "distance")[1] == "m"


def test_several_loops_stand_beside_each_other(tmp_path, capsys):
    code, text, _ = swept(tmp_path, capsys, "--samples", "4", more=PID)
    assert code == 0
    assert "2 loops, 4 runs each, on the same draws" in text
    assert "slipctl compare" in text
    assert row(text, "none")[1:]
    assert row(text, "pid")[1:]


def test_what_a_program_reads_is_what_a_person_reads(tmp_path, capsys):
    code, text, _ = swept(tmp_path, capsys, "--samples", "4", "--json", loop=":none")
    told = json.loads(text)
    assert (code, told["runs"], told["missing"], told["failed"]) == (0, 4, 0, {})
    distance = next(m for m in told["metrics"] if m["metric"] == "distance")
    ends = list(distance["quantiles"].values())
    assert ends == sorted(ends)
    assert 0.9 < ends[0] <= ends[-1] < 1.0  # 60 ms at 60 km/h are 1 m


def test_a_run_that_fails_is_told_and_ends_with_1(tmp_path, capsys, monkeypatch):
    """The others are in the table; the exit code says that not all of them ran."""
    from slipctl.errors import RunFailed
    from slipctl.run.sweep import sweep_runs

    metrics = sweep_runs.Measured.metrics

    def breaks(self, log, *given):
        if float(log["plant.train.v"][-1]) == self.first:
            raise RunFailed("state x is NaN")
        return metrics(self, log, *given)

    ends = []
    monkeypatch.setattr(sweep_runs.Measured, "first", 0.0, raising=False)

    def noted(self, log, *given):
        ends.append(float(log["plant.train.v"][-1]))
        return metrics(self, log, *given)

    monkeypatch.setattr(sweep_runs.Measured, "metrics", noted)
    assert swept(tmp_path, capsys, "--samples", "4", loop=":none")[0] == 0
    monkeypatch.setattr(sweep_runs.Measured, "first", ends[1])
    monkeypatch.setattr(sweep_runs.Measured, "metrics", breaks)
    (tmp_path / "out" / "sweep.sqlite").unlink()
    code, text, err = swept(tmp_path, capsys, "--samples", "4", loop=":none")
    assert code == 1
    assert "4 runs, 1 failed" in text
    assert "1 of 4 runs failed" in err
    assert "state x is NaN" in err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--vary", "m=30e3:45e3", "--samples", "3"), False),
        (("--vary", "m=30e3:45e3:3"), False),
        (("--vary", "m=30e3:45e3:3", "--samples", "3"), True),
    ],
)
def test_a_number_of_samples_without_effect_is_told(words, told, tmp_path, capsys):
    """Where values are counted out and none is drawn."""
    path = tmp_path / "car.toml"
    path.write_text(FILE.format(more="", speed="60 km/h"), encoding="utf-8")
    line = ["sweep", f"{path}:none", "--out", str(tmp_path / "out"), "--no-compile", *words]
    assert main(line) == 0
    said = capsys.readouterr()
    assert "3 runs" in said.out
    assert ("is left out, as nothing is drawn" in said.err) == told


@pytest.mark.parametrize("words", [("--vary", "m=30e3:45e3", "--samples", "2"), ("--samples", "2")])
@pytest.mark.parametrize("loop", [":none", ""])
def test_a_setting_of_what_varies_is_refused(words, loop, tmp_path, capsys):
    """Each run would set it to another value: of the line's own range, and of the ensemble."""
    code, text, err = swept(tmp_path, capsys, *words, "--set", "m=33t", loop=loop)
    assert code == 2
    assert not text
    assert "--set m=33t: the sweep varies m, so it has no effect" in err
    assert swept(tmp_path, capsys, *words, "--set", "r=0.4m", loop=loop)[0] == 0
