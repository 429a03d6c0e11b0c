"""``--json``: every command that finds something prints it as one JSON text, and nothing else."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from slipctl.commands import arguments
from slipctl.commands.cli import main


def answer(capsys, *words: str) -> dict:
    assert main([*words, "--json", "-q"]) == 0
    return json.loads(capsys.readouterr().out)


def test_each_command_that_finds_something_has_it():
    """The schema is JSON anyway, and the workbench is a page."""
    commands = arguments.parser()._subparsers._group_actions[0].choices
    without = {name for name, p in commands.items() if "--json" not in p._option_string_actions}
    assert without == {"schema", "open"}


def test_each_command_has_examples_that_can_be_typed():
    parser = arguments.parser()
    for name, p in parser._subparsers._group_actions[0].choices.items():
        text = p.format_help().replace("\\\n", " ")
        lines = re.findall(r"(?m)^  slipctl (.*)$", text)
        assert any(line.split()[0] == name for line in lines), name
        for line in lines:
            parser.parse_args(shlex.split(line.partition(" > ")[0]))


def test_files_that_are_written_are_named(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert answer(capsys, "new", "metro") == {"file": "metro.toml", "schema": "slipctl.schema.json"}
    assert answer(capsys, "copy", "double_exponential", "law.py")["block"] == "double_exponential"
    certify = ["super_twisting", "--set", "k1=6", "k2=4", "L=1", "--out", "sta.json"]
    assert answer(capsys, "certify", *certify)["verdict"] == "CERTIFIED"
    said = answer(capsys, "check", "sta.json")
    assert said["holds"] is True
    assert said["says"]


def test_show_of_a_block_has_its_signals(capsys):
    said = answer(capsys, "show", "double_exponential")
    signals = {s["name"]: s for s in said["signals"]}
    assert said["kind"] == "law"
    assert (signals["a"]["value"], signals["a"]["unit"]) == (0.54, "s/m")
    assert (signals["a"]["lo"], signals["a"]["hi"]) == (1e-3, 10)
    assert signals["v_s"]["value"] is None
    assert "dry" in said["conditions"]


def test_show_of_a_loop_has_wires_and_shared_numbers(capsys):
    said = answer(capsys, "show", "subway_braking:sta")
    assert "plant.wheel.m" in said["shared"]["m"]
    assert said["wires"]["ctl.v"] == "plant.wheel.v"
    assert said["period_s"] == 1e-3


def test_show_of_a_study_has_its_scenarios(capsys):
    said = answer(capsys, "show", "subway_braking")
    assert {"base", "real"} <= {s["name"] for s in said["scenarios"]}
    assert main(["show", "subway_braking:sta", "--json", "--latex"]) == 2
    assert "leave out --latex" in capsys.readouterr().err


def test_c_prints_its_report(capsys, tmp_path):
    said = answer(capsys, "c", "double_exponential", "--out", str(tmp_path))
    assert said == json.loads((tmp_path / "report.json").read_text())


def test_fit_prints_what_it_found(capsys, tmp_path):
    curve = tmp_path / "curve.csv"
    curve.write_text("v_s,mu\n" + "".join(f"{k / 10},{0.2 * k / 10}\n" for k in range(1, 9)))
    law = "mu = c*v_s where v_s [m/s], c = 0.1 s/m"
    said = answer(capsys, "fit", str(curve), "--law", law, "--unknown", "c", "--out",
                  str(tmp_path / "out"))  # fmt: skip
    assert said["parameters"]["c"]["value"] == pytest.approx(0.2)


def test_replay_prints_statistics(capsys, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t [s],e [m/s],y [m/s]\n" + "".join(f"{k / 10},1,2\n" for k in range(50)))
    said = answer(capsys, "replay", str(log), "--with", "y = 2*e where e [m/s]", "--map",
                  "e=e[m/s]", "--beside", "y=y[m/s]", "--out", str(tmp_path / "out"))  # fmt: skip
    assert said["statistics"][0]["rms"] == "0"


@pytest.mark.long
def test_tune_prints_gains_and_judgement(capsys, tmp_path):
    said = answer(capsys, "tune", "subway_braking:sta@base", "--free", "k1=5:60", "--minimise",
                  "slip_error_rms", "--samples", "4", "--runs", "4", "--held-out", "4",
                  "--out", str(tmp_path / "out"))  # fmt: skip
    assert 5 <= said["gains"]["ctl.law.k1"]["value"] <= 60
    assert said["gains"]["ctl.law.k1"]["unit"] == "m^.5/s^1.5"
    assert said["judged"]["draws"] == 4
