"""What means nothing for a vehicle is refused before anything runs."""

import pytest

from slipctl.commands.cli import main


@pytest.mark.parametrize("study", ["subway_braking", "hst_braking"])
@pytest.mark.parametrize(
    ("number", "said"),
    [
        ("plant.wheel.g=-9.81", "g"), ("g=0", "g"), ("wheel.x=1e308", "x"),
        ("wheel.v=-20", "v"), ("wheel.v=1e6", "v"), ("wheel.x=nan", "x"),
    ],
)  # fmt: skip
def test_gravity_place_and_speed_have_ranges(study, number, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["run", study, "--quick", "--scenario", "base", "--set", number, "--out", "o"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert f"{said} = " in told or f".{said}" in told
    assert not (tmp_path / "o" / "metrics.json").exists()
