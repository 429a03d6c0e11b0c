"""Slip of each axle by what it cleans for the axles behind it: the block, its caution, its loops.

Optima are those of the train without valves (tests/models/test_train_optimum.py has them by two
programs), so what is left to them holds valves, delay and the way to the slip too.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput, simulate
from slipctl.models.vehicle import (
    ScheduledPI,
    Sensors,
    SlideProtection,
    SlipLaw,
    Stretch,
    ToothWheel,
    Track,
    TrainSlip,
    case,
)
from slipctl.models.vehicle.control import vehicle_control
from slipctl.models.vehicle.parts import Accelerometer, Contamination, Fused, SlipControl
from slipctl.models.vehicle.slip.train_slip import train_slip
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain, stop
from slipctl.models.wheel_rail.train_caution import cautious_share
from slipctl.models.wheel_rail.train_optimum import LocalRule
from slipctl.study.files import trip_files
from tests.models.test_slide_protection import train

LEAVES = falling_creep.with_params(**falling_creep.conditions["leaves"])
REFERENCE = train_slip(LEAVES, falling_creep)


def curves(e, v):
    """Adhesion under the layer and without it, written anew."""

    def f(mu_0, A, B):
        s = e * v
        mu = mu_0 * ((1 - A) * np.exp(-B * s) + A)
        eps = 300 * s / np.hypot(v, 0.1) / mu
        return 2 * mu / np.pi * (0.3 * eps / (1 + (0.3 * eps) ** 2) + np.arctan(0.1 * eps))

    return f(0.04, 0.7, 0.2), f(0.15, 0.5, 0.15)


def settled(v, mu, v_s, **numbers):
    """Reference and share after ten seconds of the same samples."""
    block = REFERENCE.with_params(T=0.01, **numbers)
    x = block.pack("state", block.start())
    u = block.pack("input", {"v": v, "mu": mu, "v_s": v_s})
    p = block.pack("param", block.param_values())
    y = block.f.mapaccum(1000)(x, ca.repmat(u, 1, 1000), ca.repmat(p, 1, 1000))[1]
    return [float(k) for k in np.array(y)[:, -1]]


@settings(max_examples=40, deadline=None)
@given(
    st.floats(2, 40), st.floats(0, 1), st.floats(0.01, 0.3), st.integers(0, 15),
    st.floats(0, 2e-4), st.floats(0.1, 0.4),
)  # fmt: skip
def test_the_slip_is_the_best_of_the_law_on_the_curve_that_the_axle_finds(
    v, share, at, behind, strength, most
):
    """Of a fine grid of the law written anew, no slip is worth more by 1e-3 of the adhesion."""
    low, high = curves(at, v)
    v_best, learnt = settled(
        v, (1 - share) * low + share * high, at * v, behind=behind, strength=strength, load=58860,
        slip=most, least=0.01,
    )  # fmt: skip
    assert learnt == pytest.approx(share, abs=0.01 + 3e-5 / (high - low) ** 2)

    def worth(e):
        low, high = curves(e, v)
        f = (1 - learnt) * low + learnt * high
        return np.log(f) + behind * k * np.maximum(1 - f / peaks[1], 0) * e

    e = np.geomspace(1e-3, most, 4000)
    peaks = [f.max() for f in curves(e, v)]
    k = strength * 58860 * max(peaks[1] - peaks[0], 0)
    assert v_best <= max(most * v, 0.01) + 1e-9
    if v_best > 0.01:
        assert worth(np.array([v_best / v]))[0] > worth(e).max() - 1e-3 - 3e-3 * behind * k


def test_samples_that_say_nothing_leave_the_layer():
    """Not believed they are (0, 0), which both curves have: the share that was learnt fades."""
    assert settled(20.0, 0.0, 0.0, behind=7, load=58860)[1] == 0.0
    # noise of 1e-3 on a wheel that rolls is no share
    assert settled(20.0, 1e-3, 0.0, behind=7, load=58860)[1] < 0.01


@pytest.mark.second
@pytest.mark.parametrize(("axles", "floor", "layers", "speed"), [
    (4, 0.7, 1, 15.0), (3, 0.4, 1, 20.0), (8, 0.4, 1, 20.0), (8, 0.7, 2, 25.0),
    *(pytest.param(*case, marks=pytest.mark.long) for case in (
        (3, 0.7, 1, 20.0), (8, 0.7, 1, 25.0), (10, 0.7, 1, 25.0), (4, 0.4, 1, 20.0))),
])  # fmt: skip
@pytest.mark.others("long")
def test_caution_keeps_a_train_that_knows_the_strength_within_three_near_best_slips(
    axles, floor, layers, speed
):
    """In whole stops, not over one point, which is what the share was worked out from."""
    layer = LEAVES.with_params(A=floor)
    places = tuple(20.0 * c + d for c in range(4) for d in (0.0, 2.0, 14.0, 16.0))[:axles]

    def way(made, counted):
        return stop(made, LocalRule(made, counted, fastest=speed + 1), speed, cell=2.0).distance

    for tau in (9e-6, 1.1e-5, 3.4e-5, 1e-4):
        made = SlidingTrain(layer, falling_creep, places, 58860.0, tau, layers,
                            resistance=(0.012, 2e-5))  # fmt: skip
        own = way(made, 0.0)
        for factor in (1 / 3, 1.0, 3.0):
            share = cautious_share(replace(made, tau=factor * tau), 25.0)  # the file's speed
            assert share == 0 or way(made, factor * share) < 1.02 * own


def test_many_axles_need_no_caution_and_a_strength_that_is_known_needs_none():
    made = SlidingTrain(LEAVES, falling_creep, tuple(2.0 * np.arange(16)), 58860.0, 1e-4)
    assert cautious_share(made, 25.0) == 1.0
    steep = SlidingTrain(LEAVES.with_params(A=0.4), falling_creep, (0.0, 2.0, 14.0, 16.0), 58860.0,
                         1.8e-4)  # fmt: skip
    assert cautious_share(steep, 25.0) < 0.8
    assert cautious_share(steep, 25.0, within=1.0) > 0.9
    # what gains nothing does not try
    assert cautious_share(replace(made, behind=(0.0, 2.0)), 25.0) == 0.0
    assert cautious_share(replace(made, behind=(0.0, 2.0, 14.0, 16.0), tau=3.4e-5), 25.0) == 0.0
    # unless it learns that it may
    weak = replace(made, behind=(0.0, 2.0, 14.0, 16.0), tau=3.4e-5)
    assert cautious_share(weak, 25.0, learn=True) > 0.9
    # two layers: the first joules clean nothing
    assert cautious_share(replace(made, behind=made.behind[:8], tau=6e-5), 25.0) == 1.0
    assert cautious_share(replace(made, behind=made.behind[:8], tau=6e-5, layers=2), 25.0) == 0.0


# ---- in the loop ---------------------------------------------------------------------------------


def way(made):
    found = case(made)
    log = simulate(found.loops["x"], found.scenario, log=["plant.train.x", "plant.train.v"],
                   every=50)  # fmt: skip
    assert log["plant.train.v"].values[-1] < 0.05
    return float(log["plant.train.x"].values[-1])


def law(**believed):
    return {"x": ScheduledPI(reference=TrainSlip(**believed))}


def estimated(bias):
    return {
        "sensors": Sensors(
            wheel_speed=ToothWheel(teeth=100), vehicle_speed=Fused(spread=0.2),
            accelerometer=Accelerometer(bias=bias, deviation=0.02),
        ),
        "control": SlipControl(period=0.01, let_go=1.0),
    }  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(("axles", "tau", "best"), [
    (8, 3.4e-5, 748.6), (8, 1e-4, 594.0),
])  # fmt: skip
def test_behind_valves_little_of_the_way_to_the_optimum_is_left(axles, tau, best):
    """In shares of the way from the state machine; docs/train_optimum.md has more trains."""
    machine = way(train(axles, tau, controllers={"x": SlideProtection()}))

    def left(made):
        return (way(made) - best) / (machine - best)

    assert left(train(axles, tau, controllers=law())) < 0.2
    for factor in (3.0, 1 / 3):
        assert left(train(axles, tau, controllers=law(tau=factor * tau))) < 0.45
    for bias in (0.05, -0.05):
        assert left(train(axles, tau, controllers=law(), **estimated(bias))) < 0.4


@pytest.mark.long
@pytest.mark.parametrize(("tau", "believed"), [(1.8e-4, 1.8e-4), (1e-4, 1e-4 / 3)])
def test_behind_valves_a_plan_over_the_axles_stops_no_later_than_the_law_of_each(tau, believed):
    """With the same share of the strength; to risk as little, a plan has a smaller one."""
    ways = [way(train(8, tau, controllers=law(plan=plan, tau=believed, caution=0.9)))
            for plan in (True, False)]  # fmt: skip
    assert ways[0] < 1.002 * ways[1]


@pytest.mark.long
@pytest.mark.parametrize(("axles", "floor"), [(3, 0.4), (4, 0.4)])
def test_few_axles_never_stop_much_later_than_at_their_own_peaks(axles, floor):
    """tau = 0 believed is each axle's own peak, with the same estimate and valves."""
    for tau in (1e-4, 1.8e-4):
        layer = Contamination(condition="leaves", tau=tau, numbers={"A": floor})
        rail = Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),),
                     contamination=layer)  # fmt: skip
        own = way(train(axles, rail=rail, controllers=law(tau=0.0)))
        for factor in (1.0, 3.0):
            assert way(train(axles, rail=rail, controllers=law(tau=factor * tau))) < 1.02 * own


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sta", "eppfc"])
def test_every_slip_law_takes_it_and_leading_axles_go_further(kind):
    made = train(4, 1.8e-4, controllers={"x": SlipLaw(kind=kind, reference=TrainSlip())})
    found = case(made)
    log = simulate(found.loops["x"], found.scenario.but(duration=6.0),
                   log=["ctl.reference.v_best", "plant.train.v"], every=100)  # fmt: skip
    ratio = log["ctl.reference.v_best"].values[-1] / log["plant.train.v"].values[-1]
    assert ratio[0] > ratio[-1] + 0.05
    assert ratio.max() < 0.301


@pytest.mark.second
def test_caution_is_that_of_the_file_its_layers_and_its_plan():
    """With two layers, 8 axles that count on the strength stop 5 % later than at their peaks."""

    def counted(**changes):
        layer = Contamination(condition="leaves", tau=6e-5, **changes)
        rail = Track(law="falling_creep", sections=(Stretch(place=0.0, condition="clean"),),
                     contamination=layer)  # fmt: skip
        made = train(8, rail=rail, controllers=law())
        return vehicle_control(made, made.controllers["x"]).param_values()["reference.caution"]

    assert counted() > 0.9
    assert counted(layers=2) == 0.0
    made = SlidingTrain(LEAVES, falling_creep, tuple(2.0 * np.arange(8)), 58860.0, 3.4e-5)
    assert 0 < cautious_share(made, 25.0, plan=True) < cautious_share(made, 25.0) < 1


def test_each_axle_knows_how_many_follow():
    made = train(4, controllers=law())
    block = vehicle_control(made, made.controllers["x"])
    assert np.ravel(block.param_values()["reference.behind"]).tolist() == [3, 2, 1, 0]


FILE = """
[vehicle]
mass = "48 t"
axles = 4
radius = "0.46 m"
inertia = "100 kg m^2"
speed = "25 m/s"
[actuator]
kind = "lag"
torque = "8 kN m"
lag = "100 ms"
[rail]
law = "falling_creep"
[[rail.sections]]
place = "0 m"
condition = "clean"
[rail.contamination]
condition = "leaves"
[controllers.x]
kind = "pi"
reference = { kind = "train" }
"""
LAYER = '[rail.contamination]\ncondition = "leaves"\n'


@pytest.mark.parametrize(("change", "told"), [
    ((LAYER, ""), r"controllers.x.reference: kind = 'train' knows the layer from"),
    (('kind = "train"', 'kind = "train", layer = { mu_9 = 1 }'), r"reference.layer.mu_9.*mu_0"),
    (('kind = "train"', 'kind = "train", clean = { A = 7 }'), r"reference.clean.A: 7 .*out of"),
    (('kind = "train"', 'kind = "train", condition = "dri"'), r"reference.condition.*'dri'"),
    (('kind = "train"', 'kind = "train", slip = 2'), r"reference.slip: 2 is outside"),
])  # fmt: skip
def test_what_it_cannot_know_is_refused_where_it_stands(tmp_path, change, told):
    path = tmp_path / "my.toml"
    path.write_text(FILE.replace(*change), encoding="utf-8")
    with pytest.raises(BadInput, match=told):
        trip_files.load_trip(str(path))
    path.write_text(FILE, encoding="utf-8")
    assert isinstance(trip_files.load_trip(str(path)).controllers["x"].reference, TrainSlip)
