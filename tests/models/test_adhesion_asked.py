"""A law is asked before a run, and a run tells what no vehicle does."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import slipctl.models.vehicle.adhesion as adhesion
import slipctl.models.vehicle.trip as trips
from slipctl import ranged, simulate
from slipctl.errors import BadInput
from slipctl.models.vehicle.adhesion import law_faults
from slipctl.models.vehicle.parts.plausibility import unusual_numbers
from slipctl.study.files.trip_files import load_trip
from slipctl.study.resolve import load_block

FILE = """
duration = "{duration}"
{head}
[vehicle]
mode = "{mode}"
mass = "38 t"
axles = 4
{lengths}
radius = "0.42 m"
inertia = "{inertia}"
speed = "{speed}"
[actuator]
kind = "lag"
torque = "{torque}"
dead_time = "{dead}"
[rail]
law = "{law}"
[rail.conditions]
x = {{ {condition} }}
{more}
[[rail.sections]]
place = "0 m"
condition = "x"
{section}
[demand]
kind = "constant"
{demand}
[sensors]
wheel_speed = {{ kind = "exact" }}
[reference]
kind = "speed"
slip = "0.8 m/s"
[controllers.none]
kind = "none"
{tail}
"""
SOUND = dict(
    duration="1 s", head="", mode="brake", lengths="", inertia="110 kg m^2", speed="60 km/h",
    torque="8 kN m", dead="20 ms", law="double_exponential", condition="c = 0.18", more="",
    section="", demand='deceleration = "1.2 m/s^2"', tail="",
)  # fmt: skip
RISING = "mu = k*v_s/(v_s + v_0) where v_s [m/s], k = 0.3, v_0 = 0.5 m/s"


def trip(tmp_path: Path, **changes: str):
    path = tmp_path / "t.toml"
    path.write_text(FILE.format(**SOUND | changes), encoding="utf-8")
    return load_trip(str(path))


LAWS = {
    "pushes": ("mu = -k*v_s where v_s [m/s], k = 0.1 s/m", 'k = "0.1 s/m"', "the wrong sign"),
    "step": ("mu = k*v_s/v_s where v_s [m/s], k = 0.05", "k = 0.05", "without slip"),
    "offset": ("mu = k + v_s/v_0 where v_s [m/s], k = 0.05, v_0 = 100 m/s", "k = 0.05",
               "without slip"),
    "falls below": ("mu = k*(v_s - v_s*v_s/v_0) where v_s [m/s], k = 0.1 s/m, v_0 = 5 m/s",
                    'k = "0.1 s/m"', r"slip of 5\.\d+ m/s"),
    "percent": (RISING, "k = 30", r"above 1 .*'30 %'"),
    "peak": ("double_exponential", "c = 4.5", "above 1 from a slip of 0.5"),
}  # fmt: skip


@pytest.mark.parametrize(("law", "condition", "why"), LAWS.values(), ids=LAWS)
def test_a_law_that_is_none_of_adhesion_is_refused_with_its_line(tmp_path, law, condition, why):
    with pytest.raises(BadInput, match=rf"line \d+: rail\.conditions\.x: adhesion is .*{why}"):
        trip(tmp_path, law=law, condition=condition)


BY_SPEED = {
    "a band of speed pushes": ("k*tanh(v_s/w)*(1 if abs(v - a) > b else -1)", "the wrong sign"),
    "a band of speed is a percentage": ("k*tanh(v_s/w)*(1 if abs(v - a) > b else 30)", "above 1"),
    "pushes just before it stands": ("k*tanh(v_s/w)*(v - b)/(v + b)", "the wrong sign"),
    "no number just before it stands": ("k*tanh(v_s/w)*sqrt(v - b)/sqrt(v)", "no number"),
}


@pytest.mark.parametrize(("text", "why"), BY_SPEED.values(), ids=BY_SPEED)
def test_a_law_is_asked_at_the_speeds_in_between_and_until_it_stands(tmp_path, text, why):
    numbers = {"k": "0.3", "w": "0.5 m/s", "a": "12.2 m/s", "b": "0.4 m/s"}
    used = [f"{n} = {v}" for n, v in numbers.items() if re.search(rf"\b{n}\b", text)]
    law = f"mu = {text} where v_s [m/s], v [m/s], {', '.join(used)}"
    with pytest.raises(BadInput, match=rf"conditions\.x: adhesion is .*{why}"):
        trip(tmp_path, law=law, condition="k = 0.3")


def test_a_law_above_its_own_range_is_refused():
    law = load_block("mu = k*tanh(v_s/w) where v_s [m/s], k = 0.3, w = 0.5 m/s")
    for top, faults in ((0.2, 1), (0.3, 0)):
        found = law_faults(
            ranged(law, table={"mu": (0, top, "measured")}), {"x": {}}, 10.0, driven=False
        )
        assert len(list(found)) == faults


@pytest.mark.parametrize(
    ("falls", "told"), [("v/u", 1), ("(v + u)/u/2", 1), ("u/(v + u)", 0), ("(v + u)/(v + u)", 0)]
)
def test_adhesion_that_rises_with_speed_is_told(tmp_path, falls, told):
    law = f"mu = k*tanh(v_s/w)*{falls} where v_s [m/s], v [m/s], k = 0.3, w = 0.5 m/s, u = 16 m/s"
    lines = unusual_numbers(trip(tmp_path, law=law, condition="k = 0.3"))
    assert len([k for k in lines if "conditions.x: adhesion rises with speed" in k]) == told


@settings(max_examples=30, deadline=None)
@given(st.floats(-2, 3), st.floats(0.01, 10), st.sampled_from([5.0, 20.0, 60.0]))
def test_a_rising_law_is_taken_exactly_where_it_is_between_0_and_1(k, v_0, speed):
    """k v_s/(v_s + v_0) has the sign of k and stays below it."""
    law = load_block(RISING)
    found = list(law_faults(law, {"x": {"k": k, "v_0": v_0}}, speed, driven=False))
    highest = k * speed / (speed + v_0)
    if abs(highest - 1) > 1e-3 and abs(k) > 1e-6:
        assert bool(found) == (k < 0 or highest > 1)


def test_a_law_below_1_is_on_its_curve_and_one_above_is_told_by_the_run(tmp_path, monkeypatch):
    """By the back door, as a number that is set later: the contact force leaves the law."""
    monkeypatch.setattr(adhesion, "law_faults", lambda *_: ())
    drive = dict(
        duration="2 s", lengths="driven = [1]", mode="drive", inertia="20 kg m^2", speed="5 m/s",
        torque="48 kN m", demand='acceleration = "8 m/s^2"',
    )  # fmt: skip
    for c, told in ((3.4, False), (4.5, True)):
        case = trips.case(trip(tmp_path, **drive, condition=f"c = {c}"), "base")
        run = simulate(case.loops["none"], case.scenario, compile=False)
        s, mu = run["plant.train.v_s"].values, run["plant.train.mu"].values
        law = c * (np.exp(-0.54 * s[1:]) - np.exp(-1.2 * s[1:]))
        assert (abs(mu[:-1] - law).max() < 1e-4) == (not told)
        assert ("plant.train.residual leaves its range" in run.attrs.get("told", "")) == told


def test_a_law_that_pushes_is_told_by_range_and_by_energy(tmp_path, monkeypatch):
    monkeypatch.setattr(adhesion, "law_faults", lambda *_: ())
    law, condition, _ = LAWS["pushes"]
    made = trip(tmp_path, law=law, condition=condition, duration="6 s")
    case = trips.case(made, "base")
    told = simulate(case.loops["none"], case.scenario, compile=False).attrs["told"]
    assert "plant.train.v leaves its range, -200 .. 200 m/s" in told
    assert "plant.train.P_slip should take energy and delivers" in told


def test_the_energy_of_a_run_is_that_of_its_powers(tmp_path):
    """M v^2/2 + sum J omega^2/2 changes by what goes in and out, to 1e-9 of it."""
    case = trips.case(trip(tmp_path, duration="3 s", torque="12 kN m"), "base")
    run = simulate(case.loops["none"], case.scenario, compile=False)
    v, omega = run["plant.train.v"].values, run["plant.train.omega"].values
    energy = 38e3 * v**2 / 2 + 110 * (omega**2).sum(axis=1) / 2
    power = sum(
        sign * run[f"plant.train.{n}"].values
        for n, sign in (("P_drive", 1), ("P_brake", -1), ("P_bearing", -1), ("P_slip", -1),
                        ("P_d", -1))
    )  # fmt: skip
    assert energy[0] - energy[-1] > 1e5
    assert np.diff(energy) == pytest.approx(power[:-1] * 1e-3, abs=1e-9 * energy[0])
    (line,) = run.attrs["told"].splitlines()  # of wheels that lock, none of the energy
    assert "slides at" in line
    assert "is meant up to 4 m/s" in line


ABSURD = {
    "wheelbase": (dict(lengths='wheelbase = "0.3 m"'), "wheels of 0.42 m and 0.42 m need 0.84 m"),
    "bogies": (dict(lengths='bogie_centres = "1 m"'), "vehicle.bogie_centres: axles 2 and 3"),
    "places": (dict(lengths='places = ["0 m", "2 m", "2.1 m", "13 m"]'), "places: axles 2 and 3"),
    "inertia": (dict(inertia="5000 kg m^2"), "as heavy as 1.134e.05 kg"),
    "dead time": (dict(dead="0.3 ms"), "no whole number of samples"),
    "draw": (dict(tail='[ensemble]\ndraw = { m = "42 t:34 t" }'), "lower end first"),
}


@pytest.mark.parametrize(("changes", "why"), ABSURD.values(), ids=ABSURD)
def test_what_is_impossible_is_refused_in_one_line(tmp_path, changes, why):
    with pytest.raises(BadInput, match=why) as error:
        trip(tmp_path, **changes)
    assert "\n" not in str(error.value)


def test_what_a_run_does_not_come_to_is_told(tmp_path):
    from slipctl.models.vehicle.study import study

    far = '[[rail.sections]]\nplace = "45 km"\ncondition = "x"'
    made = trip(tmp_path, more="y = { c = 0.1 }", section=far, head='end = "5 km"')
    assert study(made).without_effect == (
        "rail.conditions.y: no section of the rail has this condition",
    )
    case = trips.case(made, "base")
    told = simulate(case.loops["none"], case.scenario, compile=False).attrs["told"]
    assert "1 of 2 sections of the rail begin at 45000 m" in told
    assert "never reaches 5000, where the run was to end" in told
    late = trip(tmp_path, demand='deceleration = "1.2 m/s^2"\nuntil = "12 s"')
    assert study(late).without_effect == (
        "demand.until: 12 s is not before the end of the run, 1 s",
    )
