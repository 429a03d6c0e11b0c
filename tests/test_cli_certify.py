"""The commands certify and check as a person meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipctl.certify.super_twisting import worst_ratio
from slipctl.cli import main

GAINS = ("certify", "super_twisting", "--set", "k1=2", "k2=1.1", "L=1")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_json_answer(capsys):
    for k1, verdict in (("1.5", "CERTIFIED"), ("0.98", "REFUTED")):
        assert main(["certify", "super_twisting", "--set", f"k1={k1}", "k2=1.1", "L=1",
                     "--json"]) == 0  # fmt: skip
        said = json.loads(capsys.readouterr().out)
        assert said["format"] == 1
        assert said["system"] == "super_twisting"
        assert said["verdict"] == said["criteria"]["exact"]["verdict"] == verdict
        assert said["witness"]["growth"] == pytest.approx(worst_ratio(float(k1), 1.1, 1.0))
        for name, finding in said["criteria"].items():
            assert set(finding["margins"]) == {
                "largest_L", "largest_delta", "smallest_k1", "smallest_k2"}  # fmt: skip
            assert name == "exact" or finding["verdict"] != "REFUTED"
    assert said["criteria"]["seeber_horn"]["verdict"] == "NOT CERTIFIED BY THIS CRITERION"
    assert said["criteria"]["printed_48"]["unit_dependent"] is True


def test_table(capsys):
    assert main([*GAINS, "delta=0.1"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("super_twisting: CERTIFIED\n")
    assert "printed_48*" in said
    assert "worst disturbance: r1 = delta |x1|^(1/2) sgn x1; d = L sgn x1 while" in said


def test_certificate_written_checked_and_altered(capsys):
    assert main([*GAINS, "--out", "a.json"]) == 0
    assert main(["check", "a.json"]) == 0
    said = capsys.readouterr().out
    assert said.endswith("CERTIFIED (exact and quadratic proof checked)\n")
    text = Path("a.json").read_text()
    changes = {
        '"569/625"': ('"568/625"', 1, "the minors are not those"),
        '"11/10"': ('"12/10"', 1, "does not belong to the gains"),
        '"-1.2548': ('"-1.2549', 1, "does not belong to the gains"),
        '"m/s^3"': ('"mm/s^3"', 2, "gains.k2 has the unit 'mm/s^3'"),
        '"theta"': ('"thela"', 2, "quadratic has no entry 'thela'; did you mean 'theta'?"),
        '"super_twisting"': ('"barrier"', 2, "no check for the system 'barrier'"),
        '"format": 1': ('"format": 9', 2, "update slipctl"),
        "{": ("", 2, "no JSON file"),
    }
    for old, (new, code, why) in changes.items():
        assert old in text
        Path("b.json").write_text(text.replace(old, new, 1))
        assert main(["check", "b.json"]) == code
        said = capsys.readouterr()
        assert why in said.err
        assert said.err.count("\n") == 1
        assert said.out == ""


@pytest.mark.parametrize(("argv", "said"), [
    (("super_twistin", "--set", "k1=1"), "did you mean 'super_twisting'?"),
    (("super_twisting",), "needs k1, k2, L; add --set k1=VALUE k2=VALUE L=VALUE"),
    (("super_twisting", "--set", "K1=1"), "has no 'K1'; did you mean 'k1'?"),
    (("super_twisting", "--set", "k1=1", "k1=2"), "names k1 twice"),
    (("super_twisting", "--set", "k1"), "write NAME=VALUE"),
    (("super_twisting", "--set", "k1=inf", "k2=1", "L=1"), "k1=inf is no finite number"),
    (("super_twisting", "--set", "k1=1/0", "k2=1", "L=1"), "k1=1/0 is no finite number"),
    (("super_twisting", "--set", "k1=-1", "k2=1", "L=1"), "k1 = -1 m^.5/s^1.5 must be more than"),
    (("super_twisting", "--set", "k1=0", "k2=1", "L=1"), "k1 = 0 m^.5/s^1.5 must be more than"),
    (("super_twisting", "--set", "k1=1", "k2=1", "L=0"), "L = 0 m/s^3 must be more than"),
])  # fmt: skip
def test_bad_input(capsys, argv, said):
    assert main(["certify", *argv]) == 2
    found = capsys.readouterr()
    assert said in found.err
    assert found.err.count("\n") == 1
    assert found.out == ""
    assert not list(Path.cwd().iterdir())


def test_files_that_cannot_be(capsys):
    Path("folder").mkdir()
    assert main(["check", "none.json"]) == 2
    assert main(["check", "folder"]) == 2
    assert main([*GAINS, "--out", "folder"]) == 2
    capsys.readouterr()
    Path("empty.json").write_text('{"format": 1}')
    assert main(["check", "empty.json"]) == 2
    assert "it is no certificate" in capsys.readouterr().err
