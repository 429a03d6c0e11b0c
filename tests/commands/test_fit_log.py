"""``slipctl fit`` of a flow: logs as people have them, keys for a vehicle's file, bad input."""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slipctl.commands.cli import main
from slipctl.models.trials import KEYS
from slipctl.study import resolve
from slipctl.study.files import trip_files

COAST = ["fit", "coast.csv", "--law", "coasting", "--map", "v=Speed", "--set", "m=38t", "rho=6.6%",
         "--out", "fit"]  # fmt: skip
STEPS = ["fit", "steps.csv", "--law", "brake_step", "--map", "T_cmd=Command*T_max", "T=Torque",
         "--set", "T_max=8kNm", "--delay", "T_cmd", "--out", "fit"]  # fmt: skip


def coast(file: str = "coast.csv", span: float = 120.0) -> None:
    """A metro car that coasts, A = 1200 N, C = 4.5 N s^2/m^2, as a German table writes it."""
    t = np.arange(0, span, 0.5)
    rate = np.sqrt(1200 * 4.5) / (38e3 * 1.066)
    v = np.sqrt(1200 / 4.5) * np.tan(np.arctan(22 * np.sqrt(4.5 / 1200)) - rate * t)
    v = 3.6 * (v + 0.02 * np.random.default_rng(1).normal(size=t.size))
    rows = [f"{a:.1f};{b:.3f}".replace(".", ",") for a, b in zip(t, v, strict=True)]
    Path(file).write_text("\ufeffZeit [s];Speed [km/h]\n" + "\n".join(rows) + "\n", "utf-8")


def steps() -> None:
    """A brake of 8 kN m, gain 0.93, lag 80 ms, dead time 43 ms, at 60 % and at rest again."""
    t = np.arange(0, 4, 0.01)
    on, off = (np.maximum(t - at - 0.043, 0) for at in (0.5, 2.0))
    y = 0.93 * 0.6 * 8 * (np.exp(-off / 0.08) - np.exp(-on / 0.08))
    y = y + 0.02 * np.random.default_rng(2).normal(size=t.size)
    command = np.where((t >= 0.5) & (t < 2), 60, 0)
    rows = [f"{a:.2f},{b},{c:.4f}" for a, b, c in zip(t, command, y, strict=True)]
    Path("steps.csv").write_text("t,Command [%],Torque [kN m]\n" + "\n".join(rows) + "\n")


def said(capsys: Any, line: list[str], code: int = 0) -> tuple[str, str]:
    capsys.readouterr()
    assert main(line) == code
    out, err = capsys.readouterr()
    return out, err


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_coasting_gives_the_keys_of_a_vehicle(capsys):
    coast()
    out, err = said(capsys, [*COAST, "--unknown", "c0,c2", "--set", "c1=0 N s/m"])
    assert "Speed converted from km/h to m/s" in err
    found = json.loads(Path("fit/fit.json").read_text())
    a, c = (found["parameters"][n] for n in ("c0", "c2"))
    assert abs(a["value"] - 1200) < 4 * a["std"] < 200
    assert abs(c["value"] - 4.5) < 4 * c["std"]
    digest = hashlib.sha256(Path("coast.csv").read_bytes()).hexdigest()[:16]
    assert found["source"] == f"fitted to coast.csv, sha256 {digest}"
    keys = Path("fit/keys.toml").read_text()
    assert keys.rstrip() in out
    assert digest in keys
    table = tomllib.loads(keys)["vehicle"]["resistance"]
    assert table == {"a": f"{a['value']:.6g} N", "c": f"{c['value']:.6g} N s^2/m^2"}
    rows = Path("fit/residuals.csv").read_text().splitlines()
    assert rows[0] == "stretch,time [s],v [m/s],fitted [m/s],residual [m/s]"
    assert len(rows) == 241
    assert Path("fit/fit.png").is_file()
    assert Path("fit/fit.svg").is_file()


def test_a_brake_step_gives_gain_lag_and_dead_time(capsys):
    steps()
    said(capsys, STEPS)
    found = json.loads(Path("fit/fit.json").read_text())["parameters"]
    for n, true in (("k", 0.93), ("tau", 0.08), ("dead_time", 0.043)):
        assert abs(found[n]["value"] - true) < 4 * found[n]["std"], n
    assert set(tomllib.loads(Path("fit/keys.toml").read_text())["actuator"]) == {
        "gain", "lag", "dead_time"}  # fmt: skip


def test_what_a_trial_gives_is_taken_by_a_vehicle(capsys):
    """Each key stands in the file as it is, and ``--set`` knows the rest by the same names."""
    steps()
    said(capsys, STEPS)
    found = tomllib.loads(Path("fit/keys.toml").read_text())["actuator"]
    assert found["dead_time"] == "0.043 s"  # whole samples; fit.json has what was found
    said(capsys, ["new", "metro"])
    text = Path("metro.toml").read_text()
    text = text.replace('a = "1.2 kN"', 'a = "1186.79 N"').replace(
        'lag = "60 ms"', f'lag = "{found["lag"]}"'
    )
    text = text.replace(
        'dead_time = "20 ms"', f'dead_time = "{found["dead_time"]}"\ngain = {found["gain"]}'
    )
    Path("metro.toml").write_text(text)
    assert {k for keys in KEYS.values() for k in keys.values()} == {
        *(f"vehicle.resistance.{n}" for n in "abc"),
        *(f"actuator.{n}" for n in ("gain", "lag", "dead_time")),
    }
    loop, _ = resolve.find_loop(trip_files.load("metro.toml"), "none")
    values = loop.param_values()
    assert float(values["plant.act.gain.k"].ravel()[0]) == found["gain"]
    assert float(values["plant.res.c0"]) == 1186.79
    for n in ("c0", "c1", "c2", "tau"):
        assert loop.find(n, "param")


def test_deceleration_is_a_torque_by_the_numbers_beside(capsys):
    steps()
    text = Path("steps.csv").read_text().splitlines()
    body = [r.rpartition(",") for r in text[1:]]
    per = 4 / 0.42 / 38e3 / 1.066 * 1e3  # m/s^2 for kN m on each of four axles
    rows = [f"{a},{float(b) * per!r}" for a, _, b in body]
    Path("steps.csv").write_text("t,Command [%],Brake [m/s^2]\n" + "\n".join(rows) + "\n")
    line = [*STEPS[:6], "T=Brake*m*(1 + rho)*r/n", *STEPS[7:]]
    said(capsys, [*line, "--set", "m=38t", "rho=0.066", "r=0.42m", "n=4"])
    found = json.loads(Path("fit/fit.json").read_text())["parameters"]
    assert found["k"]["value"] == pytest.approx(0.93, rel=3e-3)
    assert "needs m, mass [kg]; --set m=VALUE" in said(capsys, line, 2)[1]


def test_two_columns_that_could_be_meant_are_asked_about(capsys):
    Path("both.csv").write_text("time,v,a\n0,9,-.1\n1,8.9,-.1\n2,8.8,-.1\n", encoding="utf-8")
    line = ["fit", "both.csv", "--law", "coasting", "--set", "m=38t", "rho=.1", "--out", "fit"]
    assert "which column was measured? write --map v=COLUMN (of v or a)" in said(capsys, line, 2)[1]


@pytest.mark.second
def test_only_a_part_of_a_log_and_several_logs(capsys):
    """Brakes before and after, cut away; a second log has a start of its own."""
    coast()
    head, *rows = Path("coast.csv").read_text("utf-8").splitlines()
    braked = [f"{k / 2:.1f};90,0".replace(".", ",") for k in range(40)]
    late = [f"{float(r.split(';')[0].replace(',', '.')) + 20:.1f}".replace(".", ",") + ";"
            + r.split(";")[1] for r in rows]  # fmt: skip
    Path("trip.csv").write_text("\n".join([head, *braked, *late]) + "\n", "utf-8")
    line = [*COAST, "--unknown", "c0,c2", "--set", "c1=0N s/m"]
    said(capsys, line)
    alone = json.loads(Path("fit/fit.json").read_text())["parameters"]
    line[1] = "trip.csv"
    said(capsys, [*line, "--between", "20s:200s"])
    cut = json.loads(Path("fit/fit.json").read_text())["parameters"]
    assert cut["c0"]["value"] == pytest.approx(alone["c0"]["value"], rel=1e-6)
    line[1:2] = ["coast.csv", "coast.csv"]
    out, _ = said(capsys, line)
    assert "480 samples of v in 2 stretches" in out
    both = json.loads(Path("fit/fit.json").read_text())["parameters"]
    assert both["c0"]["std"] == pytest.approx(alone["c0"]["std"] / np.sqrt(2), rel=0.02)


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        (["--law", "coastin"], "there is no model or study 'coastin'; did you mean 'coasting'?"),
        (["--map", "v=Sped"], "has no column 'Sped'; did you mean 'Speed'?"),
        (["--map", "v=Speed", "a=Speed"], "--map names v and a; one of them is fitted"),
        (["--map", "w=Speed"], "has no input or state or output 'w'"),
        (["--map", "slope=Speed"], "coast.csv: which column was measured? write --map v=COLUMN"),
        (["--map", "v=Speed[kg]"], "Speed is in kg as told and in km/h by its head"),
        (["--set", "m=38s", "rho=0.1"], "another dimension"),
        (["--set", "rho=0.1"], "coasting needs m (mass, kg); give it, --set m=VALUE"),
        (["--set", "m=38t", "rho=7"], "coasting.rho"),
        (["--between", "12"], "--between '12': write two times behind the first sample"),
        (["--between", "9s:3s"], "the first time has to be before the second"),
        (["--between", "500s:600s"], "fewer than two samples from 500 s to 600 s"),
        (["--delay", "u"], "coasting has no input 'u'"),
        (["--unknown", "c0,c3"], "coasting has no parameter 'c3'"),
        (["--column", "v=Speed"], "--map names v twice"),
        (["--ordered"], "--ordered is for a law"),
        (["--between", "0s:3s"], "does not determine"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(capsys, change, wrong):
    coast(span=60)
    line = list(COAST)
    if change[0] in line:
        at = line.index(change[0])
        after = next((k for k in range(at + 1, len(line)) if line[k].startswith("--")), len(line))
        line[at:after] = change
    else:
        line += change
    out, err = said(capsys, line, 2)
    told = [row for row in err.splitlines() if wrong in row]
    assert len(told) == 1, err
    assert "Traceback" not in err
    assert not out
    assert not Path("fit/fit.json").exists()


def test_a_refusal_names_the_value_that_a_sensor_held(capsys):
    """A log that determines nothing because its sensor stood still says where."""
    coast(span=60)
    head, *rows = Path("coast.csv").read_text("utf-8").splitlines()
    held = [r.split(";")[0] + ";" + rows[40].split(";")[1] for r in rows[40:80]]
    text = "\n".join([head, *rows[:40], *held, *rows[80:]]) + "\n"
    Path("coast.csv").write_text(text, encoding="utf-8")
    out, err = said(capsys, list(COAST), 2)
    assert not out
    (line,) = err.splitlines()
    assert "coast.csv does not determine" in line
    assert "rows from line 42 on, then it jumps; where nothing was measured, empty" in line
