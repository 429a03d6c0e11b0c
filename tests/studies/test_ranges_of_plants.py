"""What means nothing for a vehicle is refused before anything runs."""

import math

import pytest

from slipctl import BadInput, Scenario, sampled, simulate
from slipctl.commands.cli import main
from slipctl.models.brakes import brake
from slipctl.models.cheng_2022 import freight_traction
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.wang_2025 import hst_traction
from slipctl.models.zhang_2021 import ep_valve, hst_braking

pytestmark = pytest.mark.second

PLANTS = {
    "subway_braking": lambda: subway_braking.plant(brake=brake(lag=True)),
    "hst_braking": lambda: hst_braking.plant(brake=ep_valve.air_brake("lag")),
    "freight_traction": lambda: freight_traction.plant(),
    "hst_traction": lambda: hst_traction.plant(),
}


@pytest.mark.parametrize("name", PLANTS)
def test_every_start_and_number_of_a_plant_has_an_end(name):
    """Gravity points down; a place, a speed, a torque, a pressure lie between two ends."""
    plant = PLANTS[name]()
    open_ended = {
        n for n, s in (plant.states | plant.params).items()
        if not (math.isfinite(s.lo) and math.isfinite(s.hi))
    }  # fmt: skip
    assert open_ended == set()
    for n, s in plant.params.items():
        if n.rpartition(".")[2] == "g":
            assert s.lo > 0


@pytest.mark.parametrize("name", ["subway_braking", "hst_braking"])
@pytest.mark.parametrize(
    ("start", "wrong"),
    [("wheel.x", 1e308), ("wheel.v", -20.0), ("wheel.v", 1e6), ("wheel.x", math.nan),
     ("wheel.omega", 1e300)],
)  # fmt: skip
def test_a_run_from_a_start_beyond_its_ends_is_refused(name, start, wrong):
    plant = sampled(PLANTS[name](), 1e-3, "rk4", substeps=2)
    with pytest.raises(BadInput, match=start.replace(".", r"\.")):
        simulate(plant, Scenario("short", 0.01, start={start: wrong}), compile=False)


@pytest.mark.parametrize("wrong", [-9.81, 0.0, math.nan, math.inf])
def test_gravity_that_does_not_point_down_is_refused(wrong):
    with pytest.raises(BadInput, match=r"wheel\.g (=|is)"):
        PLANTS["subway_braking"]().with_params(**{"wheel.g": wrong})


@pytest.mark.parametrize(
    ("study", "number", "said"),
    [
        ("subway_braking", "g=-9.81", "g = -9.81 m/s^2 is out of range"),
        ("hst_braking", "wheel.x=1e308", "x = 1e+308 m is out of range"),
        ("freight_traction", "train.v_t=-20", "v_start = -20 m/s is out of range"),
        ("hst_traction", "train.x=1e308", "x = 1e+308 m is out of range"),
        ("subway_braking", "wheel.omega=1e300", "omega_start = 1e+300 rad/s is out of range"),
    ],
)
@pytest.mark.others("long")
def test_the_command_refuses_them_in_a_line(study, number, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["run", study, "--quick", "--scenario", "base", "--set", number, "--out", "o"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert said in told.splitlines()[-1]
    assert "Traceback" not in told
    assert not (tmp_path / "o" / "metrics.json").exists()
