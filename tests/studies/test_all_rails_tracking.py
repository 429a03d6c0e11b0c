"""Speed tracking of ``all_rails``: the plant of every draw is one that can be."""

from __future__ import annotations

import pytest

from slipctl import simulate
from slipctl.models.contact import patch
from slipctl.studies.all_rails import tracking


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
