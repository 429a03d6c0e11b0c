"""Speed tracking of ``all_rails``: the plant of every draw is one that can be."""

from __future__ import annotations

import pytest

from slipctl import simulate
from slipctl.ccode.check.vectors.run_inputs import logged_params
from slipctl.models.wheel_rail.contact import patch
from slipctl.studies.all_rails import tracking

pytestmark = pytest.mark.second


@pytest.fixture(scope="module")
def loop():
    return tracking.loops(quick=True)["pid"]


@pytest.mark.parametrize("mass", [0.9, 1.1])
def test_a_heavier_train_rolls_on_its_own_contact_patch(loop, mass):
    """A patch of another load is refused wherever a loop is prepared; this one is not."""
    draw = tracking.drawn("half", 1)._replace(mass=mass)
    scenario = tracking.scenario("half", draw).but(duration=0.02)
    log = simulate(loop, scenario, compile=False, log=("plant.train.v",))
    assert log["plant.train.v"].values.shape[0] > 1
    params = scenario.params
    heavier = patch(mass * tracking.PER_AXLE * 9.8 / 2, 0.445)
    assert params["plant.train.adh.a"] == pytest.approx(heavier["a"])
    assert (params["plant.train.adh.a"] > patch(tracking.PER_AXLE * 9.8 / 2)["a"]) == (mass > 1)


@pytest.mark.parametrize("name", ["pid", "hosm"])
def test_the_controller_does_not_know_what_is_drawn(name):
    """None of its numbers moves with mass, adhesion and lag of the draw; the plant's do."""
    loop = tracking.loops(quick=True)[name]
    nominal = tracking.Draw(1.0, (1.0,) * 5, 1.0)
    moved = {}
    for part in ("ctl", "plant"):
        logged = []
        for draw in (nominal, tracking.Draw(1.1, (0.8,) * 5, 1.4)):
            scenario = tracking.scenario("half", draw).but(duration=0.02)
            log = simulate(loop, scenario, compile=False, log=("plant.train.v",))
            logged.append(logged_params(loop, part, log))
        first, second = logged
        moved[part] = {n for n in first if (first[n] != second[n]).any()}
    assert moved["ctl"] == set()
    assert {"m", "tau", "train.adh.a", "train.adh.Q"} <= moved["plant"]
