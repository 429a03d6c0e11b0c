"""The study of leaves: its bound against closed forms, its tables, its cases."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import Context, argmax
from slipctl.models.vehicle import Contamination, case
from slipctl.models.vehicle.adhesion import contaminated_law, rail_law
from slipctl.models.wheel_rail.sliding_train import stop
from slipctl.studies.leaf_fall import experiments, figures, study
from slipctl.studies.leaf_fall.bound import RULES, sliding_train
from slipctl.studies.leaf_fall.experiments import begin_of, draws_table, limits_table
from slipctl.studies.leaf_fall.loops import ENSEMBLE, cases
from slipctl.studies.leaf_fall.outcomes import outcome
from slipctl.studies.leaf_fall.trains import (
    AXLE,
    FORCE,
    INERTIA,
    LIMIT,
    MEDIUM,
    PATCH,
    PATCHES,
    RADIUS,
    RIVALS,
    WEAK,
    trip,
)
from slipctl.study import execution

QUICK = Context(quick=True, models={}, cases=())


@pytest.fixture(scope="module")
def bound():
    return experiments.bound(QUICK)


@pytest.mark.second
def test_the_brakes_are_full_before_the_leaves_and_the_train_is_slower_there():
    begin = begin_of(8)
    assert 20 < begin.place < PATCH[0]
    full = (FORCE / AXLE + 0.012 + 2e-5 * 25**2) * begin.place  # as if full from the first metre
    assert 25**2 / 2 - full < begin.speed**2 / 2 < 25**2 / 2 - 0.3 * full


@pytest.mark.long
def test_without_leaves_the_bound_is_the_closed_form():
    """dz/dx = -(a + 2 d z) with z = v^2/2, so x = ln(1 + 2 d z_0/a)/(2 d)."""
    clean = trip()
    rail = replace(clean.rail, contamination=Contamination(condition="clean"))
    train = sliding_train(replace(clean, rail=rail), begin := begin_of(8))
    found = stop(train, RULES["best of the train"](train), begin.speed, cell=0.25)
    a, d = FORCE / AXLE / (1 + INERTIA / RADIUS**2 / AXLE) + 0.012, 2e-5
    exact = np.log1p(d * begin.speed**2 / a) / (2 * d)
    assert found.distance == pytest.approx(exact, rel=1e-4)
    made = replace(clean, rail=rail, controllers={"none": RIVALS["none"]})
    run = outcome(made, case(made).loops["none"], case(made).scenario, True)["stopping_distance"]
    assert begin.place + found.distance == pytest.approx(run, rel=1e-3)


@pytest.mark.long
def test_the_best_of_the_train_is_the_shortest_and_leads_with_its_first_axles(bound):
    t = bound["distances"]
    for cleaning in ("weak", "medium"):
        ways = {rule: t.where("stopping distance", cleaning=cleaning, slips=rule) for rule in RULES}
        assert min(ways, key=ways.get) == "best of the train"
        rows = [k for k, c in enumerate(bound["slips"]["cleaning"]) if c == cleaning]
        slips = [bound["slips"]["best of the train"][k] for k in rows]
        assert slips[0] == pytest.approx(100 * LIMIT)
        assert all(b <= a + 1e-9 for a, b in pairwise(slips))
        assert slips[-1] < 10
    assert slips.count(slips[0]) > 3  # the better it cleans, the more of them lead


@pytest.mark.long
def test_cleaning_more_never_takes_longer(bound):
    t = bound["distances"]
    for rule in RULES:
        weak, medium = (t.where("stopping distance", cleaning=c, slips=rule)
                        for c in ("weak", "medium"))  # fmt: skip
        assert medium < weak


def test_leaves_by_chance_are_those_that_are_declared():
    shares = set()
    for seed in range(40):
        drawn = ENSEMBLE.also(seed)
        start, end = drawn["plant.field.start"], drawn["plant.field.end"]
        there = start < 1e5
        assert PATCHES.many[0] <= there.sum() <= PATCHES.many[1]
        length = (end - start)[there]
        assert ((PATCHES.length[0] <= length) & (length <= PATCHES.length[1])).all()
        shares.add(there.sum())
    assert len(shares) == 3


def test_scenarios_differ_in_their_leaves_alone():
    base, medium, clean = cases({}, False)
    assert (base.clean, medium.clean, clean.clean) == ("clean", "clean", "")
    assert medium.scenario.params["plant.field.tau"] == MEDIUM > WEAK
    for one in (medium, clean):
        assert list(one.loops) == list(RIVALS)
        assert one.scenario.rail == base.scenario.rail
    loop = base.loops["none"]
    assert float(loop.values_by_place()["plant.field.tau"]) == WEAK


def test_a_run_that_never_stops_is_the_longest_and_outside_the_limit():
    good = {"stopping_distance": 400.0, "longest_lock": 0.0, "flash_temperature": 100.0,
            "air_used": 200.0}  # fmt: skip
    done = [{n: dict(good) for n in RIVALS} for _ in range(4)]
    done[0]["pi"]["stopping_distance"] = None
    done[1]["wsp"] |= {"stopping_distance": 600.0, "longest_lock": 2.0}
    t = limits_table(done)
    assert t.where("within the limit", loop="pi") == 75.0
    assert t.where("longest distance", loop="pi") is None
    assert t.where("within the limit", loop="none") == 100.0
    # Clopper and Pearson: 4 of 4 prove a share of 0.025^(1/4) at least
    assert t.where("at least, 95 %", loop="none") == pytest.approx(100 * 0.025**0.25)
    assert t.where("draws with a wheel locked for half a second", loop="wsp") == 25.0
    assert draws_table([1, 2, 3, 4], done)["pi"] == [None, 400.0, 400.0, 400.0]


def test_its_cases_run_and_are_measured_beside_the_clean_rail():
    """A second of the demand alone: full metrics, no bar moves, every role is there."""
    found = [replace(c, loops=c.loops.only("none"), scenario=c.scenario.but(duration=1.0))
             for c in cases({}, False)]  # fmt: skip
    results = execution.run(study, found, experiments=False)
    assert not results.failed
    for scenario in ("base", "medium", "clean"):
        got = results.metrics[scenario]["none"]
        assert got["valve_operations"].value == 0
        assert got["air_used"].value > 10
    assert results.metrics["base"]["none"]["extension"].value is None  # it has not stopped


def test_the_rail_behind_the_train_carries_what_its_heat_has_cleaned():
    """Peak of the law between the layer's curve and the clean one, by the share 1 - exp(-tau W)."""
    heat = np.array([0.0, 2e4, 1e9])  # J/m that the axles before the last have given

    def of_axles(last):
        return SimpleNamespace(values=np.tile(np.asarray(last, dtype=float)[:, None], (1, 8)))

    log = {
        "plant.train.v": SimpleNamespace(values=np.full(3, 20.0)),
        "plant.train.x": SimpleNamespace(values=np.array([200.0, 210.0, 220.0])),
        "plant.field.height": of_axles(np.ones(3)), "plant.field.recovered": of_axles(np.zeros(3)),
        "plant.field.W_seen": of_axles(heat), "plant.train.P_contact": of_axles(np.zeros(3)),
        "rail.best_adhesion": of_axles(np.full(3, 0.04)),
    }  # fmt: skip
    results = SimpleNamespace(log=lambda scenario, loop: log)
    place, before, after = figures.adhesion_of_rail(results, "base", "wsp")
    assert place == pytest.approx(log["plant.train.x"].values - trip().vehicle.behind[-1])
    assert before == pytest.approx(np.full(3, 0.04))
    law = contaminated_law(trip(), rail_law(trip()))
    at = {"v": 20.0, "height": 1.0}
    peaks = [argmax(law, "v_s", "mu", lo=1e-4, hi=20.0, at=at | {"recovered": q}).value
             for q in -np.expm1(-WEAK * heat)]  # fmt: skip
    assert after == pytest.approx(peaks, rel=1e-2)  # the figure looks on a grid
