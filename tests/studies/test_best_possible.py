"""Loops of the braking studies against the optimal control bound."""

from dataclasses import replace

import pytest

from slipctl import Case, Context
from slipctl.models.wheel_rail.contact import polach
from slipctl.models.zhang_2021.ep_valve import THETA, air_brake
from slipctl.models.zhang_2021.hst_braking import plant
from slipctl.studies.best_possible import against_optimum, between
from slipctl.studies.freight_traction import experiments
from slipctl.studies.freight_traction import loops as freight
from slipctl.studies.hst_braking import loops as hst
from slipctl.studies.hst_traction import loops as train
from slipctl.studies.hst_traction import regret as traction_regret

pytestmark = pytest.mark.second


def test_hst_braking_lies_between_the_bound_and_every_loop():
    """With lag: ideal < optimum < each loop, and the optimum rests to 1e-4 m."""
    rail, models = hst.rail_of(hst.burckhardt, *hst.NAMES), hst.MODELS
    loops = {
        "ideal": hst.ideal(models),
        "efc": hst.loop(models, models["efc"], "true", brake="lag"),
        "pid": hst.loop(models, models["pid"], "true", brake="lag"),
    }
    case = Case(hst.Scenario("lag", 6.0, rail), loops)
    table = against_optimum(
        Context(True, models, [case]), {"lag": ("efc", "pid")},
        {"lag": plant(brake=air_brake("lag"))},
        "plant.brake.T_b", (600e3 * THETA, 0.0), {"lam": (-0.01, 0.3)},
    )  # fmt: skip
    assert between(table)
    assert table["loop"] == ["ideal", "optimum", "efc", "pid"]
    assert table.where("distance", loop="ideal") < table.where("distance", loop="optimum") - 0.5
    assert float(table.doc.rpartition(" by ")[2].split()[0]) <= 1e-4


@pytest.mark.long
def test_no_loop_of_the_freight_train_goes_farther_than_the_optimum():
    """Traction: the longest way. Every seeker loses way while it seeks."""
    cases = freight.cases(freight.MODELS, quick=True)
    table = experiments.regret(Context(True, freight.MODELS, cases))
    assert between(table)
    assert set(table["loop"]) == {"ideal", "optimum", *(f"{s}_robust" for s in freight.SEEKERS)}
    assert table.where("regret", scenario="base", loop="improved_robust") > 0.1
    assert float(table.doc.rpartition(" by ")[2].split()[0]) <= 1e-4


def test_no_law_tracks_the_speed_better_than_adhesion_allows():
    """hst_traction around the ice: the bound lies below every loop, and the limit helps."""
    case = next(c for c in train.cases(train.MODELS, True) if c.scenario.name == "stress")
    few = {n: case.loops[n] for n in ("hosm", "hosm_limited")}
    table = traction_regret.regret(Context(True, train.MODELS, [replace(case, loops=few)]))
    lost = dict(zip(table["loop"], table["above the bound"], strict=True))
    assert 0 < lost["hosm_limited"] < lost["hosm"]


def test_the_relaxed_bound_is_zero_where_force_and_adhesion_suffice():
    """Dry rail and half the tractive effort: the target is followed exactly."""
    parts = [(0.0, "dry", polach.conditions["dry"])]
    assert traction_regret.smallest_error(train.target(0.5), parts, 40.0, 20.0, dt=0.05) < 1e-9
