"""Parts of the transcription of an optimal trajectory, of a plant with two controls, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, Rail, Scenario, Section, State, flow
from slipctl.predict.trajectory import _Problem

SHARES = np.array([4 - np.sqrt(6), 4 + np.sqrt(6), 10]) / 10
"""Radau's three points: the two roots beside 1 of 10 s^2 - 8 s + 1."""


@flow(
    force=Output("N", "all of them"),
    power=Output("W", "of the brake"),
    conditions={"good": {"grip": 1.0}, "poor": {"grip": 0.25}, "wet": {"grip": 0.5}},
)
def barge(
    x=State("m", 3.0, "place"), v=State("m/s", 0.5, "speed"), e=State("J", 8.0, "work"),
    wind=Input("N", "wind", value=0.25), F=Input("N", "force", lo=-2, hi=3),
    B=Input("N", "brake", lo=0.5, hi=1.5), current=Input("N", "current", value=-0.125),
    grip=Param("1", 1.0, "share that arrives"), m=Param("kg", 2.0, "mass"),
):  # fmt: skip
    """A mass, two forces, wind and current."""
    force = grip * F - B + wind + current
    return dict(x=v, v=force / m, e=B * v), dict(force=force, power=B * v)


def made(scenario=None, goal="-x", **options):
    given = {"control": ["B", "F"], "bounds": None, "limits": None, "end": None} | options
    return _Problem(
        "here", barge, scenario or Scenario("go", 4.0), given["control"], goal, given["bounds"],
        given["limits"], given["end"],
    )  # fmt: skip


def by_time(*starts):
    names = ("good", "poor", "wet")
    return Rail([Section(s, n) for s, n in zip(starts, names, strict=False)])


def test_a_phase_has_the_inputs_and_numbers_of_its_section():
    """Controls are 0 there; a section behind the duration is none, the last one ends with it."""
    scenario = Scenario("go", 4.0, by_time(0, 1.5, 3.0), inputs={"wind": 0.75})
    found = made(scenario).phases
    assert [p.duration for p in found] == [1.5, 1.5, 1.0]
    assert [p.u.tolist() for p in found] == [[0.75, 0.0, 0.0, -0.125]] * 3
    assert [p.p.tolist() for p in found] == [[1.0, 2.0], [0.25, 2.0], [0.5, 2.0]]
    assert [p.position for p in found] == [None] * 3
    found = made(Scenario("go", 2.0, by_time(0, 1.5, 3.0))).phases
    assert [p.duration for p in found] == [1.5, 0.5]
    found = made(Scenario("go", 2.0, by_time(0, 1.5, 2.0)), end={"v": 1.0}).phases
    assert [p.duration for p in found] == [1.5, None]  # where an end is asked, the last is free
    found = made(Scenario("go", 4.0, by_time(0, 1.5, 3.0)), end={"v": 1.0}).phases
    assert [p.duration for p in found] == [1.5, 1.5, None]
    assert [p.duration for p in made(end={"v": 1.0}).phases] == [None]
    assert [p.duration for p in made().phases] == [4.0]


def test_a_phase_of_a_rail_by_place_ends_at_the_next_one():
    rail = Rail([Section(0, "good"), Section(5.0, "wet"), Section(7.5, "poor")], by="position")
    made_of = made(Scenario("go", 4.0, rail), end={"v": 1.0})
    assert made_of.place == "x"
    assert [(p.duration, p.position) for p in made_of.phases] == [
        (None, 5.0), (None, 7.5), (None, None)]  # fmt: skip
    assert [p.p[0] for p in made_of.phases] == [1.0, 0.5, 0.25]
    rail = Rail([Section(0, "good"), Section(5.0, "wet")], by="v")
    assert made(Scenario("go", 4.0, rail), end={"x": 9.0}).place == "v"


def test_controls_limits_ends_and_goal_are_found_by_name():
    found = made(bounds={"F": (-1.0, 2.5)}, limits={"power": (0, 4), "v": (-1, 2)}, end={"e": 9},
                 goal="-v")  # fmt: skip
    assert found.controls == ["B", "F"]
    assert found.driven == [2, 1]
    assert found.bounds == {"B": (0.5, 1.5), "F": (-1.0, 2.5)}
    assert found.limits == {"power": (0, 4), "v": (-1, 2)}
    assert (found.end, found.goal, found.sign, found.unit) == ({"e": 9.0}, "v", -1.0, "m/s")
    assert (made(goal="e").sign, made(goal="time", end={"v": 0}).goal) == (1.0, None)
    assert found.x0.tolist() == [3.0, 0.5, 8.0]
    assert found.scale.tolist() == [3.0, 1.0, 8.0]
    for pair in ((1.0, np.inf), (-np.inf, 1.0), (2.0, 1.0)):
        with pytest.raises(BadInput, match=r"F needs bounds=\{'F': \(lo, hi\)\} in N"):
            made(bounds={"F": pair})


def test_a_motion_under_constant_forces_leaves_no_defect():
    """x and v are polynomials of the time within reach of three points; the work is one too."""
    found = made()
    T, B, F, grip = 0.7, 1.25, 1.75, 0.25
    a = (grip * F - B + 0.25 - 0.125) / 2
    t = np.r_[0.0, SHARES] * T
    x, v = 3.0 + 0.5 * t + a * t**2 / 2, 0.5 + a * t
    X = np.array([x, v, 8.0 + B * (x - 3.0)]) / found.scale[:, None]
    known = [[0.25, 77.0, 77.0, -0.125], [grip, 2.0]]  # the controls are written over

    def defects(X, T=T):
        # controls are given as shares of their sizes
        column = found._interval()(X[:, 0], X[:, 1:].ravel("F"), [B / 1.5, F / 3.0], T, *known)
        return np.array(column).reshape(3, 3).T

    assert defects(X) == pytest.approx(0, abs=1e-13)
    # elsewhere: what the slope of the polynomial through the four points is more than h f
    rng = np.random.default_rng(1)
    X = X + 0.1 * rng.normal(size=X.shape)
    places = np.r_[0.0, SHARES]
    slopes = np.array([np.polyval(np.polyder(np.polyfit(places, row, 3)), SHARES) for row in X])
    speed = X[1, 1:] * found.scale[1]
    rates = np.array([speed, np.full(3, a), B * speed]) / found.scale[:, None]
    assert defects(X) == pytest.approx(slopes - T * rates, abs=1e-11)


def test_limited_signals_of_the_three_points_stand_one_after_the_other():
    found = made(limits={"power": (0, 4), "v": (-1, 2), "force": (-1, 1)})
    X = np.array([[3.0, 4, 5], [0.5, 0.75, 1.25], [8.0, 9, 11]])
    B, F = 1.25, 1.75
    rows = found._path()((X / found.scale[:, None]).ravel("F"), [B / 1.5, F / 3.0],
                         [0.25, 0, 0, -0.125], [0.5, 2.0])  # fmt: skip
    force = 0.5 * F - B + 0.125
    assert np.array(rows).ravel() == pytest.approx(
        [B * 0.5, 0.5, force, B * 0.75, 0.75, force, B * 1.25, 1.25, force])  # fmt: skip
    assert made()._path() is None


def solution(found, durations):
    """A solution of two intervals and two phases in numbers that all differ."""
    mesh, size = np.array([0.0, 0.25, 1.0]), np.array([1.5, 3.0])
    points = np.arange(1.0, 37).reshape(2, 2, 3, 3)  # phase, interval, point, state
    controls = np.array([[[0.4, 0.5], [0.6, 0.7]], [[0.8, 0.9], [1.0, -0.5]]])
    values = [np.zeros(3)]
    for k in range(2):
        values += [np.array([durations[k]])] if found.phases[k].duration is None else []
        values += [points[k].ravel(), controls[k].ravel()]
    return mesh, values, size, points, controls


def test_a_solution_is_states_and_controls_by_phase():
    """States linear between the points, from the end of the phase before; controls held."""
    scenario = Scenario("go", 2.0, by_time(0, 1.5))
    found = made(scenario, end={"v": 1.0})
    mesh, values, size, points, controls = solution(found, [None, 0.625])
    told = found._solution(mesh, values, size)
    assert told["durations"] == [1.5, 0.625]
    assert told["mesh"].tolist() == mesh.tolist()
    places = np.r_[0.0, 0.25 * SHARES, 0.25 + 0.75 * SHARES]
    for k in range(2):
        begin = found.x0 if k == 0 else points[0, 1, 2] * found.scale
        rows = np.vstack([begin, points[k].reshape(6, 3) * found.scale])
        assert told["x"][k](places) == pytest.approx(rows)
        middles = (places[1:] + places[:-1]) / 2
        assert told["x"][k](middles) == pytest.approx((rows[1:] + rows[:-1]) / 2)
        held = controls[k] * size
        assert told["u"][k](np.array([0, 0.1, 0.25, 0.6, 1.0])) == pytest.approx(
            held[[0, 0, 1, 1, 1]])  # fmt: skip


def test_a_log_has_the_ends_of_the_intervals_of_all_phases():
    found = made(Scenario("the way", 2.0, by_time(0, 1.5), inputs={"wind": 0.75}))
    mesh, values, size, points, controls = solution(found, [None, None])
    log = found.log(found._solution(mesh, values, size))
    assert log.attrs["scenario"] == "the way"
    assert log["time"].values == pytest.approx([0, 0.375, 1.5, 1.5, 1.625, 2.0])
    assert log["time"].attrs["units"] == "s"
    ends = [points[k, i, 2] * found.scale for k, i in ((0, 0), (0, 1), (0, 1), (1, 0), (1, 1))]
    states = np.array([found.x0, *ends])
    for i, n in enumerate("xve"):
        assert log[n].values == pytest.approx(states[:, i])
    held = np.array([*controls[0][[0, 1, 1]], *controls[1][[0, 1, 1]]]) * size
    for i, n in enumerate("BF"):
        assert log[n].values == pytest.approx(held[:, i])
    grip = np.repeat([1.0, 0.25], 3)
    assert log["force"].values == pytest.approx(grip * held[:, 1] - held[:, 0] + 0.75 - 0.125)
    assert log["power"].values == pytest.approx(held[:, 0] * states[:, 1])
    assert log["v"].attrs == {"units": "m/s", "long_name": "speed"}
    assert log["F"].attrs == {"units": "N", "long_name": "force"}
    assert log["power"].attrs == {"units": "W", "long_name": "of the brake"}


def test_a_guess_from_a_log_is_of_the_times_of_its_phases():
    """It is cut where the end is reached; what the log lacks is at rest or at its start."""
    import xarray

    scenario = Scenario("go", 6.0, by_time(0, 1.0))
    found = made(scenario, end={"v": 2.0, "x": 6.0}, goal="e")
    time = np.linspace(0, 5, 51)
    log = xarray.Dataset({"v": ("time", 0.5 + 0.5 * time), "x": ("time", 3.0 + time),
                          "a.F": ("time", 2 * time)}, {"time": time})  # fmt: skip
    told = found.guess(log)
    assert told["durations"] == pytest.approx([1.0, 2.0])  # x = 6 and v = 2 both after 3 s
    share = np.array([0.0, 0.5, 1.0])
    for k, at in enumerate((share, 1 + 2 * share)):
        assert told["x"][k](share) == pytest.approx(
            np.column_stack([3 + at, 0.5 + 0.5 * at, np.full(3, 8.0)]))  # fmt: skip
        assert told["u"][k](share) == pytest.approx(np.column_stack([np.full(3, 0.5), 2 * at]))
    found.scale_by([log])
    assert found.scale.tolist() == [8.0, 3.0, 8.0]
    short = found.guess(log.isel(time=slice(0, 8)))  # it ends before the second phase begins
    assert short["durations"] == pytest.approx([1.0, 1e-3])


def test_without_a_log_the_plant_goes_on_by_itself_section_by_section():
    """Under the control nearest to none, 1 N of which a share arrives, then a quarter, a half."""
    scenario = Scenario("go", 4.0, by_time(0, 1.5, 3.0))
    told = made(scenario, bounds={"F": (1.0, 3.0)}).guess(None)
    assert told["durations"] == [1.5, 1.5, 1.0]
    v = 0.5
    for k, (grip, long) in enumerate(((1.0, 1.5), (0.25, 1.5), (0.5, 1.0))):
        share, a = np.array([0.0, 0.5, 1.0]), (grip - 0.5 + 0.125) / 2
        rows = told["x"][k](share)
        assert rows[:, 1] == pytest.approx(v + a * share * long, abs=3e-3)
        assert told["u"][k](share) == pytest.approx(np.tile([0.5, 1.0], (3, 1)))
        v += a * long


def test_a_plan_of_two_controls_keeps_its_limits():
    """Farthest in 2 s: all force, least brake, no faster than 1 m/s; it adds up in the log."""
    found = made(Scenario("go", 2.0), limits={"v": (-9.0, 1.0)})
    value, told = found.solve(6, found.guess(None))
    log = found.log(told)
    a = (3.0 - 0.5 + 0.125) / 2
    t = (1.0 - 0.5) / a
    best = 3.0 + 0.5 * t + a * t * t / 2 + (2.0 - t)
    assert best - 0.03 < -value < best + 1e-6
    assert -value == pytest.approx(log["x"].values[-1], rel=1e-6)
    assert log["v"].values.max() <= 1.0 + 1e-6
    assert log["F"].values[0] == pytest.approx(3.0, abs=1e-3)
    assert log["B"].values.min() >= 0.5 - 1e-6
