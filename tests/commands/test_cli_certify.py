"""The commands certify and check as a person meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipctl.certify.catalogue import SYSTEMS, certify
from slipctl.commands.cli import main
from slipctl.models.super_twisting.certificate.super_twisting import worst_ratio

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
    assert said["criteria"]["seeber_horn"]["verdict"] == "UNDECIDED"
    assert said["criteria"]["printed_48"]["unit_dependent"] is True


def test_table(capsys):
    assert main([*GAINS, "delta=0.1"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("super_twisting: CERTIFIED in continuous time\n")
    assert "printed_48*" in said
    assert "worst disturbance: r1 = delta |x1|^(1/2) sgn x1; d = L sgn x1 while" in said


def test_a_mark_in_the_table_has_its_note(capsys):
    """Of the printed inequality, whose verdict depends on the unit of length; of no other."""
    for marked, argv in ((True, [*GAINS, "delta=0.1"]), (False, ["certify", "filter"])):
        main(argv)
        said = capsys.readouterr().out
        notes = [line for line in said.splitlines() if line.startswith("  * ")]
        assert len(notes) == marked
        assert ("printed_48*" in said) == marked


def test_head_tells_continuous_from_sampled(capsys):
    """A proof of the equations is no proof of the law that is computed once per period."""
    chatters = ["certify", "super_twisting", "--set", "k1=2000", "k2=1", "L=0.5", "T=0.016"]
    assert main(chatters) == 0
    said = capsys.readouterr().out
    assert said.startswith("super_twisting: UNDECIDED as sampled\n")
    assert "explicit amplitude: 256 m/s" in said
    assert main([*chatters, "band=0.1"]) == 0
    assert capsys.readouterr().out.startswith("super_twisting: REFUTED as sampled\n")
    assert str(certify("lagged_loop", K=1, T=1)) == "lagged_loop: CERTIFIED as sampled"
    noise = {"gamma": 0.1, "R": 1e-6, "H": 1e-3}
    assert str(certify("filter", **noise)) == "filter: CERTIFIED as sampled"
    assert str(certify("filter", **noise, dt=0)) == "filter: CERTIFIED in continuous time"


def test_certificate_written_checked_and_altered(capsys):
    assert main([*GAINS, "--out", "a.json"]) == 0
    assert main(["check", "a.json"]) == 0
    said = capsys.readouterr().out
    assert said.endswith("and stays there (exact, quadratic, seeber_horn checked)\n")
    text = Path("a.json").read_text()
    changes = {
        '"569/625"': ('"568/625"', 1, "do not belong to what was asked"),
        '"11/10"': ('"6/5"', 1, "do not belong to what was asked"),
        '"value": "11/10"': ('"value": "22/20"', 2, "must be written '11/10'"),
        '"-1.2548': ('"-1.2549', 1, "do not belong to what was asked"),
        '"m/s^3"': ('"mm/s^3"', 2, "asked.k2 has the unit 'mm/s^3'"),
        '"multipliers"': ('"multiplyers"', 2, "did you mean 'multipliers'?"),
        '"super_twisting"': ('"barrier"', 2, "no check for the system 'barrier'"),
        "x1 is 0 after": ("x1 is 0.1 after", 1, "the promise in it is not the one"),
        '"format": 2': ('"format": 9', 2, "update slipctl"),
        '"format": 2,': ('"format": 1,', 2, "leaves out what its proofs did not use"),
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
    (("super_twisting", "--set", "k1=1e999", "k2=1", "L=1"), "k1=1e999 is no finite number"),
    (("super_twisting", "--set", "k1=-1", "k2=1", "L=1"), "k1 = -1 m^.5/s^1.5 must be more than"),
    (("super_twisting", "--set", "k1=0", "k2=1", "L=1"), "k1 = 0 m^.5/s^1.5 must be more than"),
    (("super_twisting", "--set", "k1=1", "k2=1", "L=0"), "L = 0 m/s^3 must be more than"),
    (("super_twisting", "--set", "k1=1", "k2=1m/s^3", "L=1"), "k1 has no unit and others have one"),
    (("super_twisting", "--set", "k1=1m", "k2=1", "L=1"), "k1 is in m^.5/s^1.5, not in m"),
    (("reaching_law", "--set", "g1=3wb", "g2=1", "T=1"), "is no known unit"),
    (("reaching_law", "--set", "g1=3"), "reaching_law needs g2, T; add --set g2=VALUE T=VALUE"),
    (("reaching_law", "--set", "g1=3", "g2=0", "T=1"), "g2 = 0 m/s^2 must be more than 0"),
    (("funnel", "--set", "g1=3"), "cannot certify 'funnel'"),
])  # fmt: skip
def test_bad_input(capsys, argv, said):
    assert main(["certify", *argv]) == 2
    found = capsys.readouterr()
    assert said in found.err
    assert found.err.count("\n") == 1
    assert found.out == ""
    assert not list(Path.cwd().iterdir())


@pytest.mark.parametrize(("numbers", "factor"), [
    (("g1=36/s", "g2=12m/s^2", "T=1ms"), 1.0), (("g1=36", "g2=12", "T=1e-3"), 1.0),
    (("g1=36Hz", "g2=12000mm/s^2", "T=1/1000s"), 1.0), (("g1=36/s", "g2=24m/s^2", "T=1ms"), 2.0),
])  # fmt: skip
def test_units_are_read(capsys, numbers, factor):
    assert main(["certify", "reaching_law", "--set", *numbers, "--json"]) == 0
    swing = json.loads(capsys.readouterr().out)["values"]["symmetric_orbit"]
    assert swing["unit"] == "m/s"
    assert swing["value"] == pytest.approx(factor * 0.012 / 1.964, rel=1e-12)


def test_list_of_systems(capsys):
    assert main(["certify"]) == 0
    said = capsys.readouterr().out
    for name in SYSTEMS:
        assert f"\n{name}\n" in f"\n{said}"
    assert "K1            rad^.5/s^1.5            gain of the root" in said


def test_certificate_of_another_system(capsys):
    numbers = ["k=1200", "k_a=1.22986", "k_s=0.02", "T=2e-4", "W=5e-3"]
    assert main(["certify", "barrier_lyapunov", "--set", *numbers, "--out", "b.json"]) == 0
    assert main(["check", "b.json"]) == 0
    text = Path("b.json").read_text()
    assert '"value": "1/200", "unit": "m/s^2"' in text
    changes = {
        '"value": "1/200"': ('"value": "1/201"', 1, "not the one that its numbers make"),
        '"value": "1/200", "unit": "m/s^2"': ('"value": "1/200"', 2, "asked.W.unit is missing"),
        '"barrier_lyapunov"': ('"rls"', 2, "asked has no entry 'k'"),
        '"1/5000"': (f'"{"9" * 4000}"', 2, "at most 200 digits"),
        '"proofs"': ('"prooves"', 2, "did you mean 'proofs'?"),
    }
    for old, (new, code, why) in changes.items():
        assert old in text
        Path("c.json").write_text(text.replace(old, new, 1))
        assert main(["check", "c.json"]) == code
        said = capsys.readouterr()
        assert why in said.err
        assert said.err.count("\n") == 1


def test_files_that_cannot_be(capsys):
    Path("folder").mkdir()
    assert main(["check", "none.json"]) == 2
    assert main(["check", "folder"]) == 2
    assert main([*GAINS, "--out", "folder"]) == 2
    capsys.readouterr()
    Path("empty.json").write_text('{"format": 1}')
    assert main(["check", "empty.json"]) == 2
    assert "it is no certificate" in capsys.readouterr().err


OWN = """
from slipctl.certify.systems import INPUT, TARGET, Number, System
from slipctl.certify.ticks.tick_sets import Loop

loop = Loop(
    tick=lambda n, x, d: {"e": x["e"] - n["T"] * (n["K"] * x["e"] + d["w"])},
    start={"e": "e0"}, pushed={"w": "W"}, stays={"e": "band"},
)
own = System(
    "own", "e+ = e - T (K e + w)",
    {
        "K": Number("1/s", "gain"),
        "T": Number("s", "sample period", role=INPUT, says="a sample time of {}"),
        "e0": Number("m/s", "largest |e| at the start", 0.0, "not negative"),
        "W": Number("m/s^2", "largest |w|", 0.0, "not negative", role=INPUT, says="|w| <= {}"),
        "band": Number("m/s", "wanted |e|", optional=True, role=TARGET),
    },
    {}, loop.targets(), loop.says_start(), loop=loop,
)
"""


@pytest.mark.second
def test_a_system_of_a_file_is_certified_by_its_name(capsys, tmp_path):
    """Its verdict is as sampled; its ends and its maps are asked for as those of any other."""
    Path("my.py").write_text(OWN, encoding="utf-8")
    told = ["certify", "my.py:own", "--set", "K=10", "T=.05", "W=.5"]
    for band, verdict in (("band=.06", "CERTIFIED"), ("band=.04", "REFUTED")):
        assert main([*told, band]) == 0
        assert f"own: {verdict} as sampled" in capsys.readouterr().out
    assert main([*told, "band=.06", "--out", "own.json"]) == 0
    assert json.loads(Path("own.json").read_text(encoding="utf-8"))["system"] == "own"
    assert "proofs.check repeats it" in capsys.readouterr().out
    assert main([*told, "band=.06", "--largest", "W"]) == 0
    end = float(capsys.readouterr().out.split("CERTIFIED up to ")[1].split()[0])
    assert 0.55 < end <= 0.6  # K band, but for the width of a cell
    assert main(["-q", *told, "band=.06", "--map", "K,W", "--points", "3", "--out", "map"]) == 0
    assert (tmp_path / "map" / "map.json").is_file()
    capsys.readouterr()
    assert main(["certify", "my.py:own", "--set", "L=3"]) == 2
    assert "own has no 'L'" in capsys.readouterr().err
    assert main(["certify", "my.py:loop"]) == 2  # a loop alone has no bounds
    assert "declares no study" in capsys.readouterr().err
