"""What a vehicle weighs and how it moves: identities of mechanics, tick by tick."""

import numpy as np
import pytest

from slipctl import BadInput, simulate
from slipctl.models.vehicle import (
    Constant,
    DemandAlone,
    Lag,
    SlipLaw,
    SlipSpeed,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)

H = 1e-3


def trip(vehicle, rail=(("dry", 0.0),), **more):
    """A vehicle that is braked without slip control."""
    sections = tuple(Stretch(place=at, condition=name) for name, at in rail)
    given = dict(
        duration=3.0, vehicle=vehicle, actuator=Lag(torque=8e3, lag=0.06),
        rail=Track(sections=sections), demand=Constant(deceleration=1.0),
        controllers={"none": DemandAlone()},
    )  # fmt: skip
    return Trip(**(given | more))


def log(one, *names):
    """Signals of a run of it."""
    made = case(one)
    data = simulate(made.loops["none"], made.scenario, compile=False, log=names)
    return [np.asarray(data[n].values, dtype=float) for n in names]


def numbers(one):
    """Numbers of its loop."""
    return case(one).loops["none"].param_values()


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_tare_and_load_weigh_as_much_as_their_sum(share):
    """And what turns is a share of the vehicle without load: load does not turn."""
    full = Vehicle(tare=38e3 * (1 - share / 2), load=19e3 * share, inertia=110.0, speed=3.0)
    same = Vehicle(mass=38e3, inertia=110.0, speed=3.0)
    assert full.total == pytest.approx(same.total)
    for name in ("m", "m_axle"):
        assert numbers(trip(full))[name] == pytest.approx(numbers(trip(same))[name]), name
    turning = Vehicle(tare=28e3, load=10e3 * share, rotating_mass=0.08, speed=3.0)
    turns = 4 * turning.wheel_inertia / turning.wheel_radius**2
    assert turns == pytest.approx(0.08 * 28e3)


@pytest.mark.parametrize("load", [0.0, 10e3])
def test_load_is_braked_with_the_tare(load):
    """(M + 4 J/r^2) dv/dt = -4 T/r while no wheel slips: the speeds of 3 s by hand."""
    vehicle = Vehicle(tare=28e3, load=load, inertia=110.0, speed=10.0)
    v, T = log(trip(vehicle, actuator=Lag(torque=4e3, lag=0.06)), "plant.train.v", "plant.T")
    whole = 28e3 + load + 4 * 110.0 / 0.42**2
    by_hand = v[0] - H * np.cumsum(T.sum(axis=1))[:-1] / 0.42 / whole
    assert v[1:] == pytest.approx(by_hand, abs=0.05)
    assert v[-1] < 8


def test_the_acceleration_is_the_change_of_speed_to_the_last_tick_before_it_stands():
    """h a = v+ - v in every tick: while it brakes, in the tick in which it stops, and after."""
    one = trip(Vehicle(mass=38e3, inertia=110.0, speed=1.0))
    v, a = log(one, "plant.train.v", "plant.train.a")
    stops = int(np.argmax(v == 0))
    assert 0 < stops < len(v) - 100
    assert a[:-1] * H == pytest.approx(np.diff(v), abs=1e-12)
    assert a[stops - 1] * H == pytest.approx(-v[stops - 1], rel=1e-12)


@pytest.mark.parametrize("weight", ["mass", "tare"])
def test_what_is_too_heavy_is_refused_by_the_key_that_says_it(weight):
    with pytest.raises(BadInput, match=f"{weight}: .*an axle carries"):
        numbers(trip(Vehicle(**{weight: 400e3}, inertia=110.0, speed=3.0)))


def test_bearings_slow_a_wheelset_in_proportion_to_its_speed():
    """A wheelset on no rail: J omega' = T - B_t omega, its end T/B_t and its rate B_t/J."""
    from slipctl.models.wang_2025.hst_traction import wheelset

    block = wheelset
    rate = []
    for omega in (0.0, 2.0, 50.0):
        p = block.param_values() | {"B_t": 3.0}
        nxt, _ = block.expr({"omega": omega}, dict.fromkeys(block.inputs, 0.0), p)
        rate.append(float(nxt["omega"]))
    J = float(block.param_values()["J"])
    assert rate[0] - rate[1] == pytest.approx(3.0 * 2.0 / J)
    assert rate[0] - rate[2] == pytest.approx(3.0 * 50.0 / J)


@pytest.mark.parametrize(
    ("name", "value"), [("tau", 0.3), ("T_max", 5e3), ("J", 200.0), ("g", 9.0)]
)
def test_a_number_of_the_vehicle_is_one_number_in_all_of_its_loop(name, value):
    """Whoever has it is told: plant, demand, controller and sensors."""
    one = trip(
        Vehicle(mass=38e3, inertia=110.0, speed=3.0),
        controllers={"none": SlipLaw(kind="pid", gains={"K": 50.0})},
        reference=SlipSpeed(slip=0.5),
    )
    made = case(one).loops["none"].with_params(**{name: value})
    places = {n: v for n, v in made.values_by_place().items() if n.rpartition(".")[2] == name}
    assert len(places) > 2
    assert {float(np.max(v)) for v in places.values()} == {value}
