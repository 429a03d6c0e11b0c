"""Numbers that follow from a trip's own: how fast it may change speed, what a file tells of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slipctl import Input, Output, Param, connect, step
from slipctl.models.vehicle import (
    Air,
    Constant,
    DemandAlone,
    Lag,
    SlipControl,
    SlipLaw,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)
from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE
from slipctl.models.vehicle.books import known_of_trip
from slipctl.models.vehicle.control import wheel
from slipctl.models.vehicle.parts import Davis, NoisySpeed, Slope, TrackBrake
from slipctl.models.vehicle.parts.file_keys import with_keys
from slipctl.models.vehicle.ranges import of_inputs
from slipctl.models.vehicle.slip.takeover import released_torque, released_valves
from slipctl.models.vehicle.slip.train_reference import filling_rate
from slipctl.models.vehicle.trip import end
from slipctl.models.wheel_rail.contact import patch
from slipctl.study.resolve import load_block

TRIP = Trip(
    duration=6.0,
    vehicle=Vehicle(mass=20e3, places=(0.0, 8.0), axles=2, inertia=100.0, radius=0.5, speed=20.0),
    actuator=Lag(torque=20e3, lag=0.05),
    rail=Track(law="double_exponential", sections=(Stretch(place=0.0, condition="dry"),)),
    controllers={"none": DemandAlone()},
)  # fmt: skip
AIR = Air(torque=6e3, pressure=3.8e5, supply=6e5)
BRAKES = 2 * 20e3 / 0.5 / 20e3
"""Deceleration in m/s^2 that both axles can give."""


def of_vehicle(**changes):
    return replace(TRIP, vehicle=replace(TRIP.vehicle, **changes))


FASTEST = [
    (TRIP, BRAKES),
    (replace(TRIP, demand=Constant(deceleration=2.5)), 2.5),
    (replace(TRIP, demand=Constant(force=54e3)), 2.7),
    (replace(TRIP, demand=Constant(deceleration=9.0)), BRAKES),
    (replace(TRIP, demand=Constant(deceleration=0.2)), 1.25),  # the least that is taken
    (of_vehicle(resistance=Davis(a=400.0, b=30.0, c=5.0)), BRAKES + (400 + 600 + 2000) / 20e3),
    (of_vehicle(track_brake=TrackBrake(attraction=50e3, friction=0.1)), BRAKES + 0.25),
    (replace(TRIP, rail=replace(TRIP.rail, gradient=-0.02)), BRAKES + 0.02 * 9.81),
    (
        replace(TRIP, rail=replace(TRIP.rail, gradient=(
            Slope(place=0.0, gradient=0.01), Slope(place=9.0, gradient=-0.03)))),
        BRAKES + 0.03 * 9.81,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("trip", "most"), FASTEST)
def test_a_speed_changes_no_faster_than_by_all_that_brakes_with_a_fifth_more(trip, most):
    assert trip.fastest_change == pytest.approx(1.2 * most, rel=1e-3)


@step(T_b=Output("N m", "torque", positive="braking"), period=1e-3)
def told(
    v=Input("m/s", "speed"), r=Param("m", 0.5, "wheel radius"), T=Param("s", 1e-3, "sample time"),
    K=Param("1", 2.0, "gain"), other=Param("1", 3.0, "another"),
):  # fmt: skip
    return {}, dict(T_b=K * r * v * T * other)


def test_a_number_of_the_file_says_where_it_stands_there():
    ctl = connect("ctl", {"law.v": "v"}, law=told)
    made = with_keys(ctl, ["K"])
    found = {n.rpartition(".")[2]: s.source for n, s in made.params.items()}
    assert found["T"] == "the vehicle's file, [control] period"
    assert found["K"] == "the vehicle's file, gains of the controller"
    assert found["r"].startswith("the vehicle's file, ")
    assert "file" not in found["other"]
    again = made.swap("law", told.with_params(other=4.0))
    assert again.params["law.K"].source == made.params["law.K"].source
    np.testing.assert_allclose(float(np.ravel(again.param_values()["law.other"])[0]), 4.0)


@pytest.mark.parametrize(
    ("actuator", "rate"),
    [
        (Lag(torque=9e3, lag=0.06), 9e3 / 0.06), (Lag(torque=9e3, lag=1e-3), 9e5),
        # choked flow of (supply + atmosphere), into a pressure of 3.8 bar that is worth 6 kN m
        (AIR, 6e3 / 3.8e5 * AIR.rates[0] * (6e5 + ATMOSPHERE)),
    ],
)  # fmt: skip
def test_a_torque_rises_no_faster_than_its_actuator_lets_it(actuator, rate):
    assert filling_rate(replace(TRIP, actuator=actuator)) == pytest.approx(rate)


def test_an_axle_that_is_let_go_has_no_torque():
    free = released_torque.with_params(T_max=500.0)
    for asked, given in ((-3.0, 0.0), (100.0, 100.0), (900.0, 500.0)):
        assert float(free(T_slip=asked, free=0)["T_cmd"]) == given
        assert float(free(T_slip=asked, free=1)["T_cmd"]) == 0
    for hold in (0, 1):
        for vent in (0, 1):
            bits = {"hold_by": hold, "vent_by": vent}
            assert released_valves(**bits, free=0) == {"hold": hold, "vent": vent}
            assert released_valves(**bits, free=1) == {"hold": 1, "vent": 1}


def test_the_patch_of_a_law_is_that_of_the_vehicle_s_wheels():
    """By Hertz at the load of a wheel; it grows with the third root of the mass."""
    track = replace(TRIP.rail, law="polach")
    own = rail_law(replace(TRIP, rail=track))
    wheel = patch(20e3 * 9.81 / 4, 0.5)
    found = own.param_values()
    assert {n: float(found[n]) for n in wheel} == pytest.approx(wheel)
    assert wheel["Q"] == 20e3 * 9.81 / 4
    heavy = own.with_params(m=40e3).param_values()
    assert float(heavy["a"]) == pytest.approx(2 ** (1 / 3) * wheel["a"])
    given = rail_law(replace(TRIP, rail=replace(track, conditions={"dry": {"Q": 7e4}})))
    plain = load_block("polach").param_values()
    assert float(given.param_values()["a"]) == float(plain["a"])


def test_inputs_are_judged_by_what_the_sensors_do():
    """Gate of the vehicle speed: five deviations, a step, what lost samples hide, and 0.15 m/s."""
    plain = of_inputs(TRIP, wheel(TRIP))
    assert (plain["gate"], plain["unseen"], plain["lost"]) == (0.15, 0.1, 20e3)
    assert plain["fastest"] == 120.0
    assert of_inputs(of_vehicle(speed=100.0), wheel(TRIP))["fastest"] == 150.0
    noisy = NoisySpeed(deviation=0.2, step=0.05)
    trip = replace(TRIP, sensors=replace(TRIP.sensors, vehicle_speed=noisy),
                   control=replace(TRIP.control, demand_lost="3 kN m"))  # fmt: skip
    found = of_inputs(trip, wheel(trip))
    assert found["unseen"] == pytest.approx(0.15)
    assert found["gate"] == pytest.approx(0.15 + 5 * 0.2 + 0.05)
    assert found["lost"] == 3e3
    waits = replace(TRIP, actuator=replace(TRIP.actuator, dead_time=0.2))
    assert of_inputs(waits, wheel(waits))["react"] - plain["react"] == pytest.approx(0.2)


def test_a_mark_is_known_where_the_file_has_one():
    assert list(known_of_trip(TRIP)) == ["books.error"]
    found = known_of_trip(replace(TRIP, mark=120.0))
    assert list(found) == ["books.error", "trip.mark"]
    assert found["trip.mark"].values == 120.0


@pytest.mark.parametrize("actuator", [AIR, TRIP.actuator])
@pytest.mark.parametrize("let_go", [None, 1.0])
def test_what_lets_an_axle_go_stands_behind_all_that_makes_its_command(actuator, let_go):
    """Valves by their bits, a lag by its torque; where no axle is let go in turn, nothing does."""
    control = SlipControl(period=0.01, let_go=let_go, let_go_every=6.0)
    laws = {"slip": SlipLaw(kind="pid")}
    trip = replace(TRIP, actuator=actuator, control=control, controllers=laws)
    whole = case(trip).loops["slip"]["ctl"]
    while set(whole.parts) == {"ctl"}:
        whole = whole.parts["ctl"]
    parts, wires = whole.parts, whole.wires
    assert ("release" in parts) == ("turn" in parts) == (let_go is not None)
    if let_go is None:
        return
    assert wires["release.free"] == "turn.free"
    turn = {n.rpartition(".")[2]: v for n, v in parts["turn"].param_values().items()}
    assert 1.0 in turn.values()
    assert 6.0 in turn.values()
    if isinstance(actuator, Air):
        for bit in ("hold", "vent"):
            assert wires[bit] == wires[f"model.{bit}"] == f"release.{bit}"
            assert not wires[f"release.{bit}_by"].startswith("release.")
        assert "release.T_slip" not in wires
    else:
        assert wires["T_cmd"] == "release.T_cmd"
        assert wires["release.T_slip"] == "safe.T_cmd"
        assert float(parts["release"].param_values()["T_max"]) == actuator.torque


@pytest.mark.parametrize(
    ("written", "signal", "above", "below"),
    [("", None, None, None), ("standstill", "plant.train.v", None, 0.02),
     ("400 m", "plant.train.x", 400.0, None), ("1.5 km", "plant.train.x", 1500.0, None)],
)  # fmt: skip
def test_a_run_ends_at_rest_or_at_a_place_or_with_its_time(written, signal, above, below):
    """At rest it has stood for half a second: a wheel that is let go may pass 0 for a tick."""
    found = end(replace(TRIP, end=written))
    if signal is None:
        assert found is None
        return
    assert found.signal == signal
    assert found.hold == (0.5 if below else 0)
    ends = found.above, found.below
    assert [e for e in ends if e is not None and np.isfinite(e)] == [above or below]
    assert (ends[0] is not None and np.isfinite(ends[0])) == (above is not None)
