"""What the wheels of a run did: a slide beyond the law, a spin, a law's reach."""

import math
import re
from dataclasses import replace
from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    from_text,
    prepare,
    step,
)
from slipctl.block.reach import reach_text, with_reach
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import (
    Constant,
    DemandAlone,
    Exact,
    Lag,
    Sensors,
    SlipLaw,
    SlipSpeed,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.wheel_rail.exponential_tail import exponential_tail, peak_slip
from slipctl.run.warnings import wheels
from slipctl.study.resolve import load_block

CAR = Vehicle(mass=38e3, inertia=110.0, speed=16.7)


def told(loop="none", **changes):
    given = dict(
        duration=3.0, vehicle=CAR, actuator=Lag(torque=8e3), demand=Constant(deceleration=1.2),
        rail=Track(sections=(Stretch(place=0.0, condition="ice"),)),
        sensors=Sensors(wheel_speed=Exact()), controllers={"none": DemandAlone()},
    )  # fmt: skip
    found = case(Trip(**given | changes))
    log = prepare(found.loops[loop], found.scenario, compile=False)(doubt=True)
    return log, log.told()


@pytest.mark.second
def test_a_slide_beyond_what_the_law_is_meant_for_is_told_with_axle_and_slip():
    log, (line,) = told()
    slip = np.abs(log["plant.train.v_s"])
    k, axle = np.unravel_index(np.argmax(slip), slip.shape)
    assert f"wheel of axle {axle + 1} slides at {slip[k, axle]:.3g} m/s" in line
    assert "double_exponential is meant up to 4 m/s" in line
    first = log["time"][np.argmax((slip > 4).any(axis=1))]
    assert f"from {first:.4g} s on" in line
    # a law that is meant for a locked wheel has nothing to say, nor one within its reach
    rail = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="ice"),))
    assert told(rail=rail)[1] == []
    assert told(demand=Constant(deceleration=0.1))[1] == []


def test_a_law_over_the_ratio_is_judged_by_the_ratio():
    rail = Track(law="burckhardt", sections=(Stretch(place=0.0, condition="snow"),))
    _, lines = told(rail=rail, demand=Constant(deceleration=2.0), actuator=Lag(torque=9e3))
    assert len(lines) == 1
    assert "slides at 1 of slip, and burckhardt is meant up to 0.7" in lines[0]


def test_a_wheel_that_spins_is_told_and_a_motor_has_a_limit():
    driven = replace(CAR, mode="drive", speed=5.0)
    rail = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="ice"),))
    demand = Constant(acceleration=1.4)
    log, lines = told(vehicle=driven, rail=rail, demand=demand, duration=4.0)
    assert len(lines) == 1
    assert f"its rim is {log['plant.train.v_s'].max():.4g} m/s faster" in lines[0]
    weak = Lag(torque=8e3, power=60e3, top=16.0)
    log, lines = told(vehicle=driven, rail=rail, demand=demand, duration=6.0, actuator=weak)
    assert lines == []
    omega, T = log["plant.train.omega"], log["plant.T"]
    assert (T * omega <= 60e3 * (1 + 1e-12)).all()
    assert omega.max() * 0.42 < 16.0 + 0.2  # a tick of 8 kN m is 73 rad/s^2 1 ms
    assert log["plant.train.P_drive"].max() <= 4 * 60e3 * 1.01


def test_slip_control_takes_the_torque_from_a_wheel_that_spun_while_it_was_off():
    """Its rim is faster than six times the vehicle, beyond all errors of a law of the ratio."""
    driven = replace(CAR, mode="drive", speed=0.8)
    rail = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="ice"),))
    pid = {"pid": SlipLaw(kind="pid", gains={"K": 10.0})}
    log, lines = told("pid", vehicle=driven, rail=rail, demand=Constant(acceleration=1.4),
                      reference=SlipSpeed(slip=1.0), controllers=pid)  # fmt: skip
    slip = log["plant.train.v_s"].max(axis=1)[np.argmax(log["plant.train.v"] > 1.05) :]
    assert slip[0] > 6 * 1.05
    assert (np.diff(slip) < 0).all()
    assert any("began below 1 m/s, where slip control is off: [control] off" in x for x in lines)


def test_a_peak_is_where_its_formula_says_and_a_locked_wheel_keeps_the_tail():
    grid = np.linspace(0.01, 20, 20_000)
    for name, p in exponential_tail.conditions.items():
        at = {"a": 0.54, "b": 1.2, **p}
        mu = at["c"] * (np.exp(-0.54 * grid) - np.exp(-1.2 * grid)) + at["s"] * (
            1 - np.exp(-1.2 * grid)
        )
        assert float(peak_slip(**at)) == pytest.approx(grid[np.argmax(mu)], abs=2e-3), name
        far = float(exponential_tail(v_s=40.0, **p)["mu"])
        assert far == pytest.approx(at["s"], rel=1e-6)


def test_four_locked_wheels_on_dry_rail_brake_by_the_tail():
    # with the shipped numbers a locked wheel has 0.1: about 1 m/s^2, as every brake engineer knows
    rail = Track(law="exponential_tail", sections=(Stretch(place=0.0, condition="dry"),))
    log, _ = told(rail=rail, demand=Constant(deceleration=4.0), duration=4.0,
                  vehicle=replace(CAR, speed=30.0), actuator=Lag(torque=3e4))  # fmt: skip
    v, omega = log["plant.train.v"], log["plant.train.omega"]
    locked = (omega == 0).all(axis=1) & (v > 12)
    assert locked.sum() > 500
    slope = np.polyfit(log["time"][locked], v[locked], 1)[0]
    assert slope == pytest.approx(-0.981, rel=0.01)


def test_a_law_says_how_far_it_reaches(tmp_path: Path):
    assert reach_text(double_exponential) == "not measured; meant up to |v_s| = 4 m/s"
    assert reach_text(exponential_tail) == "not measured; meant up to a locked wheel"
    file = tmp_path / "own.toml"
    text = '[law]\nmu = "c*v_s"\ninputs = {v_s = "m/s"}\nparameters = {c = "0.1 s/m"}\n'
    for key, value, wanted in (
        (
            "meant_to",
            "locked",
            "not said up to which slip it was measured; meant up to a locked wheel",
        ),
        (
            "measured_to",
            "9 km/h",
            "measured up to |v_s| = 2.5 m/s; not said up to which slip it is meant",
        ),
    ):
        file.write_text(text + f'{key} = "{value}"\n', encoding="utf-8")
        assert reach_text(load_block(f"{file}:law")) == wanted
    for key, value in (("meant_to", "far"), ("measured_to", "-1 m/s"), ("measured_to", "2 kg")):
        with pytest.raises(BadInput, match=key):
            with_reach(double_exponential, {key: value})
    assert with_reach(double_exponential, {"meant_to": "locked"}).law_data.meant_to == math.inf
    assert double_exponential.law_data.meant_to == 4.0


@pytest.mark.parametrize("conditions", [("ice",), ("dry", "wet")])
def test_the_rail_carries_its_peak_on_the_load_of_each_axle(conditions):
    """c (e^(-a s) - e^(-b s)) at its largest, times load and radius, where an axle then is."""
    places = (0.0, 25.0)
    rail = Track(sections=tuple(Stretch(place=p, condition=c)
                                for p, c in zip(places, conditions, strict=False)))  # fmt: skip
    found = case(Trip(
        duration=1.5, vehicle=CAR, actuator=Lag(torque=8e3), demand=Constant(deceleration=1.0),
        rail=rail, sensors=Sensors(wheel_speed=Exact()), controllers={"none": DemandAlone()},
    ))  # fmt: skip
    loop = found.loops["none"]
    log = prepare(loop, found.scenario, compile=False)(doubt=True)
    carried = wheels._carried(loop, found.scenario, log)
    slip = np.linspace(0, 20, 20001)
    law = loop["plant.train.adh"]
    for axle, behind in enumerate(np.ravel(loop.param_values()["plant.train.behind"])):
        for row in (0, 700, 1499):
            at = float(log["plant.train.x"][row]) - behind
            name = conditions[-1] if at >= places[1] else conditions[0]
            p = {n: float(v) for n, v in law.param_values().items()}
            p |= {n: float(v) for n, v in law.conditions[name].items()}
            peak = (p["c"] * (np.exp(-p["a"] * slip) - np.exp(-p["b"] * slip))).max()
            wanted = peak * 38e3 / 4 * 9.81 * CAR.wheel_radius
            assert carried[row, axle] == pytest.approx(wanted, rel=1e-4)
    if len(conditions) > 1:
        assert np.ptp(carried) > 0


def test_a_demand_by_place_that_the_run_does_not_come_to_is_told():
    log, lines = told(demand=Constant(deceleration=0.1, until="900 m"))
    far = log["plant.train.x"].max()
    assert lines == [f"the demand changes at 900 m, and the run ends at {far:.4g} m"]
    assert told(demand=Constant(deceleration=0.1, until="20 m"))[1] == []


@pytest.mark.parametrize(("first", "then", "lines"), [("dry", "ice", 1), ("ice", "dry", 0)])
def test_what_the_rail_carries_is_that_under_the_driven_axles(first, then, lines):
    """The first axle is at 105 m, the driven ones at 94 and 92 m; the rail changes at 100 m."""
    sections = (Stretch(place=0.0, condition=first), Stretch(place=100.0, condition=then))
    rail = Track(law="exponential_tail", sections=sections)
    car = replace(CAR, mode="drive", speed=5.0, driven=(3, 4))
    trip = Trip(duration=3.0, vehicle=car, actuator=Lag(torque=8e3), rail=rail,
                demand=Constant(acceleration=0.4), controllers={"none": DemandAlone()})  # fmt: skip
    found = case(trip)
    ones = np.ones(3001)
    log = {"time": np.arange(3001) * 1e-3, "plant.train.x": 105 * ones, "plant.train.v": 5 * ones,
           "demand.T_demand": 3000 * ones, "ctl.T_cmd": np.full((3001, 2), 500.0)}  # fmt: skip
    told = wheels.wheel_warnings(found.loops["none"], found.scenario, log)
    assert len(told) == lines


@step(period=0.01, v_s=Output("m/s", "slip", positive="braking", per="speed"))
def axle(n=State("1", 0.0), mu=Input("1", "adhesion", positive="braking")):
    """Something that slips."""
    return dict(n=n), dict(v_s=n + 0 * mu)


def test_each_wheel_that_slides_is_told_behind_one_that_may_or_is_not_logged():
    """One may lock by its law, the slip of another is not logged, one is beyond 4 m/s."""
    laws = {"free": exponential_tail, "unseen": double_exponential, "beyond": double_exponential}
    time = 0.01 * np.arange(101)
    log = {"time": time} | {f"{n}.axle.v_s": 5 * time for n in ("free", "beyond")}
    for names in permutations(laws):
        parts = {n: connect("part", {"adh.v_s": "axle.v_s"}, axle=axle, adh=laws[n]) for n in names}
        (line,) = wheels.wheel_warnings(connect("loop", {}, **parts), Scenario("s", 1.0), log)
        assert "slides at 5 m/s of slip" in line
        assert "from 0.81 s on" in line


@pytest.mark.parametrize(("v", "lines"), [(-0.021, 1), (-0.019, 0), (0.5, 0)])
def test_a_vehicle_that_rolls_back_is_told_from_2_cm_a_second_on(v, lines):
    time = 0.01 * np.arange(101)
    log = {"time": time, "plant.train.v": np.full(101, v), "plant.train.x": 5.0 + v * time}
    told = wheels.wheel_warnings(connect("loop", {}, a=axle), Scenario("s", 1.0), log)
    assert len(told) == lines
    assert all("rolls back from 0 s on, 0.021 m and up to 0.021 m/s" in line for line in told)


@pytest.mark.parametrize(("slip", "lines"), [(-21.0, 1), (-19.0, 0), (21.0, 0)])
def test_a_rim_spins_that_is_20_metres_a_second_faster(slip, lines):
    part = connect("part", {"adh.v_s": "axle.v_s"}, axle=axle, adh=exponential_tail)
    log = {"time": 0.01 * np.arange(101), "one.axle.v_s": np.full(101, slip)}
    loop = connect("loop", {}, one=part)
    assert len(wheels.wheel_warnings(loop, Scenario("s", 1.0), log)) == lines


@cache
def on_dry_rail():
    """A loop, its scenario, 2 s of a log of it at rest, and what the rail carries there."""
    found = case(Trip(
        duration=2.0, vehicle=CAR, actuator=Lag(torque=8e4), demand=Constant(deceleration=1.2),
        rail=Track(sections=(Stretch(place=0.0, condition="dry"),)),
        sensors=Sensors(wheel_speed=Exact()), controllers={"none": DemandAlone()},
    ))  # fmt: skip
    loop, still = found.loops["none"], np.zeros(201)
    log = {"time": 0.01 * np.arange(201), "plant.train.x": still, "plant.train.v": still}
    return loop, found.scenario, log, wheels._carried(loop, found.scenario, log)[0, 0]


HOLDS = dict(asked=0.89, given=0.89, v=0.105, seconds=1.05)


@pytest.mark.parametrize(
    ("change", "lines"),
    [({}, 1), ({"asked": 0.91}, 0), ({"given": 0.91}, 0), ({"v": 0.095}, 0),
     ({"seconds": 0.95}, 0)],
)  # fmt: skip
def test_slip_control_holds_what_is_clearly_below_what_rail_and_driver_allow(change, lines):
    """A tenth below either, above 0.1 m/s, for more than a second."""
    at = HOLDS | change
    loop, scenario, log, carried = on_dry_rail()
    demand = at["asked"] * carried
    command = np.where(log["time"] <= at["seconds"] + 1e-6, at["given"], 1.0) * demand
    log = log | {"demand.T_demand": np.full(201, demand), "ctl.T_cmd": command,
                 "plant.train.v": np.full(201, at["v"])}  # fmt: skip
    told = wheels.wheel_warnings(loop, scenario, log)
    assert len(told) == lines
    assert all(f"for {demand:.4g} N m" in line for line in told)


def told_of_law(text, upto=2.0, positive="braking"):
    """What a wheel tells whose slip grows to ``upto`` in m/s on a law of these words."""

    @step(0.01, v_s=Output("m/s", "slip", positive="braking", per="speed"))
    def wheel(
        s=State("m/s", 0.0, "slip"),
        mu=Input("1", "adhesion", positive=positive),
        rate=Param("m/s", upto / 10, "of the slip, a tick"),
    ):
        return {"s": s + rate}, {"v_s": s}

    used = {"k": "0.3", "w": "0.5 m/s"}
    law = from_text(f"mu = {text}", inputs={"v_s": "m/s"}, parameters=used)
    law = law.with_conditions(dry={"k": 0.3})
    plant = connect("plant", {"wheel.mu": "adh.mu", "adh.v_s": "wheel.v_s"}, wheel=wheel, adh=law)
    loop = connect("loop", {}, plant=plant)
    log = prepare(loop, Scenario("s", 0.1), compile=False)(doubt=True)
    return log.told()


RISES = "k*v_s/(abs(v_s) + w)"
NO_LAWS = {
    "pushes": (f"-{RISES}", "gives an adhesion of -.* pushes"),
    "above its load": (f"10*{RISES}", "more than the load"),
    "offset": (f"0.3*{RISES} + k/3", "at a slip of 0 m/s.* rolls"),
    "nothing": (f"0*{RISES}", "none at any slip"),
    "peak further on": ("20*k*v_s/w/(1 + (v_s/w)**2/40)", "more than the load"),
}


@pytest.mark.parametrize(("text", "why"), NO_LAWS.values(), ids=NO_LAWS)
def test_a_law_that_is_none_is_told_in_any_loop(text, why):
    """Put under the wheels of a study it is judged by no vehicle's file."""
    (line,) = told_of_law(text, upto=0.05 if "**" in text else 2.0)
    assert re.search(why, line)


@pytest.mark.parametrize(("text", "positive"), [(RISES, "braking"), (f"-{RISES}", "traction")])
def test_a_law_that_opposes_slip_is_not_told(text, positive):
    assert told_of_law(text, positive=positive) == []
