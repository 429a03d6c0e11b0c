"""The optimal control bound against closed forms, and between bound and loops of a study."""

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    flow,
    sampled,
    simulate,
    trajectory,
)
from slipctl.models.zhang_2021.hst_braking import burckhardt, ideal_plant, plant
from slipctl.predict.trajectory import _Problem
from slipctl.studies.hst_braking import loops as hst


@flow(conditions={"good": {"grip": 1.0}, "poor": {"grip": 0.25}})
def sled(
    x=State("m", 0.0, "position"),
    v=State("m/s", 0.0, "speed"),
    e=State("J", 0.0, "work of the brake"),
    F=Input("N", "force", lo=-2, hi=2),
    grip=Param("1", 1.0, "share of the force that arrives"),
    m=Param("kg", 2.0, "mass"),
):
    """A mass and a force."""
    return dict(x=v, v=grip * F / m, e=-F * v), {}


def test_least_time_is_bang_bang():
    """From rest over 1 m to rest with |a| <= 1 m/s^2: 2 s."""
    found = trajectory(
        sled, Scenario("go", 10.0), "F", "time", end={"x": 1.0, "v": 0.0}, tolerance=1e-6
    )
    assert found.value == pytest.approx(2.0, abs=2e-6)
    force = found.log["F"].values
    assert force[2] == pytest.approx(2.0, abs=1e-4)
    assert force[-2] == pytest.approx(-2.0, abs=1e-4)
    time = found.log["time"].values
    assert time[-1] == pytest.approx(found.value)
    assert found.log["v"].values == pytest.approx(np.minimum(time, 2 - time), abs=1e-4)


def test_a_constant_input_acts_all_the_time():
    """Farthest in 2 s with a wind of 1 N behind the sled of 2 kg: 1.5 m/s^2."""

    @flow()
    def sailing(
        x=State("m", 0.0, "position"),
        v=State("m/s", 0.0, "speed"),
        F=Input("N", "force", lo=-2, hi=2),
        wind=Input("N", "force of the wind", value=0.0),
    ):
        """A mass, a force and the wind."""
        return dict(x=v, v=(F + wind) / 2), {}

    for wind in (0.0, 1.0):
        scenario = Scenario("go", 2.0, inputs={"wind": wind})
        found = trajectory(sailing, scenario, "F", "-x", tolerance=1e-6)
        assert found.value == pytest.approx(2 + wind, abs=2e-6)


def test_a_rail_by_time_has_a_phase_per_section():
    """Farthest in 4 s: full force, 1 m/s^2 for 1 s, then a quarter of it."""
    rail = Rail([Section(0, "good"), Section(1.0, "poor")])
    found = trajectory(sled, Scenario("go", 4.0, rail), "F", "-x", tolerance=1e-6)
    assert found.value == pytest.approx(0.5 + 1 * 3 + 0.25 * 9 / 2, abs=2e-6)
    assert found.meshes[-1][0] == 2 * found.meshes[-2][0]


def test_a_rail_by_position_changes_where_it_says():
    """Braked at 1 m/s^2 over 1 m, then at a quarter: v^2/2 = 1 + (x - 1)/4."""
    rail = Rail([Section(0, "good"), Section(1.0, "poor")], by="position")
    scenario = Scenario("stop", 60.0, rail, start={"v": 2.0})
    found = trajectory(
        sled, scenario, "F", "x", end={"v": 0.0}, limits={"v": (0.0, np.inf)}, tolerance=1e-5
    )
    assert found.value == pytest.approx(1 + 4 * (2.0 - 1.0), abs=1e-4)


def test_a_guess_is_the_motion_at_rest_or_a_run_phase_by_phase():
    """Free motion at 2 m/s, a tick of 1/500 s; a run under 2 N that is cut where it arrives."""
    rail = Rail([Section(0, "good"), Section(1.0, "poor")])
    problem = _Problem("w", sled, Scenario("go", 4.0, rail, start={"v": 2.0}), "F", "-x",
                       None, None, None)  # fmt: skip
    share = np.linspace(0, 1, 5)
    free = problem.guess(None)
    assert free["durations"] == [1.0, 3.0]
    for k, time in enumerate((share, 1 + 3 * share)):
        rows = free["x"][k](share)
        assert rows[:, 0] == pytest.approx(2 * time, abs=1e-9)
        assert rows[:, 1:] == pytest.approx(np.tile([2.0, 0.0], (5, 1)), abs=1e-9)
        assert not free["u"][k](share).any()
    run = Scenario("go", 4.0, rail, inputs={"F": 2.0})
    log = simulate(sampled(sled, 1e-2, "rk4"), run, compile=False)
    problem = _Problem("w", sled, Scenario("go", 10.0, rail), "F", "time", None, None, {"x": 1.0})
    found = problem.guess(log)
    arrives = 1 + (np.sqrt(1 + 0.25) - 1) / 0.25  # x = 0.5 + t + t^2 / 8 behind the first second
    assert found["durations"] == pytest.approx([1.0, arrives - 1], abs=2e-2)
    for k, time in enumerate((share, 1 + found["durations"][1] * share)):
        behind = np.maximum(time - 1, 0)
        place = np.where(time < 1, time**2 / 2, 0.5 + behind + behind**2 / 8)
        assert found["x"][k](share)[:, 0] == pytest.approx(place, abs=1e-3)
        assert found["u"][k](share) == pytest.approx(np.full((5, 1), 2.0))


@pytest.mark.parametrize(("goal", "unit"), [("-x", "m"), ("e", "J"), ("time", "s")])
def test_the_objective_has_the_unit_of_what_is_minimised(goal, unit):
    made = _Problem("here", sled, Scenario("go", 2.0), "F", goal, None, None, {"v": 0.0})
    assert made.unit == unit


def test_limits_are_kept_along_the_way():
    """Least time with a speed limit: trapezoidal profile, 1/v + v for |a| <= 1."""
    found = trajectory(
        sled, Scenario("go", 10.0), "F", "time", end={"x": 1.0, "v": 0.0},
        limits={"v": (-1.0, 0.5)}, tolerance=1e-3, intervals=40,
    )  # fmt: skip
    assert found.value == pytest.approx(1 / 0.5 + 0.5, abs=5e-3)
    assert found.log["v"].values.max() <= 0.5 + 1e-6


def test_no_loop_brakes_harder_and_the_bound_is_not_reached():
    """hst_braking: ideal adhesion < optimum < the best loop, and the optimum rests to 1e-4 m."""
    rail = Rail([Section(2.0 * k, n) for k, n in enumerate(hst.NAMES)])
    scenario = Scenario("base", 6.0, rail)
    bound = simulate(
        hst.ideal(hst.MODELS),
        scenario.but(rail=hst.rail_of(burckhardt, *hst.NAMES)),
    )["plant.wheel.x"].values[-1]
    run = _braked_by_hand(rail)
    found = trajectory(
        plant(), scenario, "T_b", "wheel.x", bounds={"T_b": (-40e3, 0.0)}, guesses=[run],
        limits={"lam": (-0.01, 0.3)},
    )  # fmt: skip
    assert bound < found.value < float(run["wheel.x"].values[-1])
    assert abs(found.meshes[-1][1] - found.meshes[-2][1]) <= 1e-4
    assert found.value == pytest.approx(255.48, abs=0.01)


def _braked_by_hand(rail):
    """Run with torques a little below what each section carries."""
    torques = [(0.0, -4300.0), (2.0, -1700.0), (4.0, -3400.0)]
    block = sampled(plant(), 1e-3, "implicit_euler")
    return simulate(block, Scenario("by hand", 6.0, rail, {"T_b": torques}))


BAD = [
    (dict(control="G"), "no input 'G'"),
    (dict(minimise="y"), "no state 'y'"),
    (dict(minimise="time"), "needs an end="),
    (dict(bounds={"F": (1.0, 1.0)}), "needs bounds"),
    (dict(end={"w": 0.0}), "no state 'w'"),
]


@pytest.mark.parametrize(("options", "text"), BAD, ids=[t for _, t in BAD])
def test_bad_input_is_one_line(options, text):
    arguments = {"control": "F", "minimise": "-x", **options}
    with pytest.raises(BadInput, match=text) as error:
        trajectory(sled, Scenario("go", 1.0), **arguments)
    assert "\n" not in str(error.value)


def test_a_sampled_plant_and_a_rail_by_position_without_end_are_refused():
    with pytest.raises(BadInput, match="give the flow"):
        trajectory(sampled(sled, 0.1, "rk4"), Scenario("go", 1.0), "F", "x")
    rail = Rail([Section(0, "good"), Section(1.0, "poor")], by="position")
    with pytest.raises(BadInput, match="needs end="):
        trajectory(sled, Scenario("go", 1.0, rail), "F", "x")


def test_an_ideal_plant_has_no_choice_left():
    """A slip that is held is the optimum of itself: the log is that of the run."""
    law = burckhardt
    free = ideal_plant(law)
    best, height = hst.best(law, "dry")
    rail = Rail([Section(0, "dry")])
    found = trajectory(
        free, Scenario("dry", 2.0, rail), "lam_held", "wheel.x", bounds={"lam_held": (0.0, 0.9)},
        tolerance=1e-6,
    )  # fmt: skip
    assert found.value == pytest.approx(50 * 2 - 9.81 * abs(height) * 2, abs=1e-5)
    assert np.median(found.log["lam_held"].values) == pytest.approx(best, abs=1e-3)
