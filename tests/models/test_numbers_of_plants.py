"""Numbers of a vehicle's actuators, resistance and cars, each against what a hand works out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_points import Draw, assert_same, numbers, values

from slipctl import Input, Output, Param, law
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.vehicle import Air, Davis, Lag, Valve, Vehicle
from slipctl.models.vehicle import plant as made
from slipctl.models.vehicle.air.pneumatics import rate_of_choke
from slipctl.models.vehicle.parts import Car, DynamicBrake, Pads, TrackBrake
from slipctl.models.zhang_2021 import ep_valve

ODD = Vehicle(mass=41e3, places=(0.0, 7.0, 16.0), axles=3, inertia=110.0, radius=(0.5, 0.48, 0.46),
              speed=21.0, gravity=9.7, resistance=Davis(a=900.0, b=11.0, c=3.5))  # fmt: skip
AIR = Air(torque=6.1e3, pressure=3.6e5, supply=5.2e5, volume=5e-3, fill=5e-3, vent=7e-3,
          discharge=0.8, air=280.0, dead_time=0.013, pulse=0.021, reservoir=0.11, reserve=7.7e5,
          charge=2e-3, weighed=30e3)  # fmt: skip


def responses(block, command):
    """Outputs to a row of commands."""
    x, p, found = block.pack("state", block.start()), block.param_values(), []
    for c in command:
        told = block.unpack("state", x)  # of a brake alone the torque is its state
        x, y = block.f(x, block.pack("input", {"T_cmd": c}), block.pack("param", p))
        found.append(float((told | block.unpack("output", y))["T_b"]))
    return np.array(found)


@pytest.mark.parametrize(("dead", "gain"), [(0.0, 1.0), (0.003, 1.0), (0.0, 1.3), (0.004, 0.7)])
def test_a_lag_waits_its_dead_time_and_gives_its_gain(dead, gain):
    block = made.actuator(Lag(torque=7e3, lag=0.02, dead_time=dead, gain=gain))
    found = responses(block, [4e3] * 30)
    t = np.maximum(np.arange(30) * 1e-3 - dead, 0)
    assert found == pytest.approx(gain * 4e3 * (1 - np.exp(-t / 0.02)), rel=1e-6)
    assert numbers(block)["T_max"] == 7e3
    full = responses(block, [2e4] * 400)[-1]
    assert full == pytest.approx(7e3, rel=1e-6)


def test_a_valve_fills_and_vents_by_its_two_times_within_its_band():
    part = Valve(torque=6e3, fill=0.13, vent=0.07, band=0.02, dead_time=0.002)
    block = made.actuator(part)
    found = numbers(block)
    assert (found["theta"], found["P_max"]) == (-0.01, 6e5)
    assert found["act.valve.band"] == pytest.approx(12e3)
    assert (found["act.cylinder.tau_f"], found["act.cylinder.tau_v"]) == (0.13, 0.07)
    up = responses(block, [6e3] * 90 + [0.0] * 60)
    t = np.arange(150) * 1e-3
    rising = 6e3 * (1 - np.exp(-(t - 0.002) / 0.13))  # the leak is a thousand seconds
    assert up[2:92] == pytest.approx(rising[2:92], rel=2e-3, abs=1.0)
    assert up[92:] == pytest.approx(up[92] * np.exp(-np.arange(58) * 1e-3 / 0.07), rel=2e-3)


def test_a_valve_decides_by_the_error_of_the_pressure():
    d = Draw(2000, 1)
    s = {"T_cmd": -d.even(-500, 7e3), "theta": -d.even(5e-3, 0.02), "P_max": d.even(4e5, 7e5),
         "band": d.even(1e3, 2e4)}  # fmt: skip
    asked = np.clip(s["T_cmd"] / s["theta"], 0, s["P_max"])
    s["T_b"] = s["theta"] * (asked + d.even(-3e4, 3e4))
    error = asked - s["T_b"] / s["theta"]
    wanted = np.where(error > s["band"], 1, np.where(error < -s["band"], -1, 0))
    assert_same(values(ep_valve.ep_valve, s, 2000)[2], {"position": wanted})
    c = {"P_c": d.even(0, 6e5), "position": d.one_of(-1, 0, d.even(0, 1)), "theta": s["theta"],
         "P_max": s["P_max"], "tau_f": d.even(0.1, 0.3), "tau_v": d.even(0.05, 0.2),
         "tau_l": d.even(1, 9)}  # fmt: skip
    _, rate, told = values(ep_valve.air_brake("valve"), c, 2000)
    fill = np.maximum(c["position"], 0) * (c["P_max"] - c["P_c"]) / c["tau_f"]
    vent = np.maximum(-c["position"], 0) * c["P_c"] / c["tau_v"]
    assert_same(rate, {"P_c": fill - vent - c["P_c"] / c["tau_l"]})
    assert_same(told, {"T_b": c["theta"] * c["P_c"]})
    b = {"T_cmd": s["T_cmd"], "theta": s["theta"], "P_max": s["P_max"]}
    told = values(ep_valve.air_brake(), b, 2000)[2]
    assert_same(told, {"T_b": s["theta"] * asked, "P_c": asked})
    b |= {"P_c": d.even(0, 6e5), "tau": d.even(0.01, 0.1)}
    _, rate, told = values(ep_valve.air_brake("lag"), b, 2000)
    assert_same(rate, {"P_c": (asked - b["P_c"]) / b["tau"]})
    assert_same(told, {"T_b": s["theta"] * b["P_c"]})


def test_an_air_brake_has_the_numbers_of_its_file():
    found = numbers(made.plant(replace(ODD, dynamic_brake=None), AIR, double_exponential))
    fills, vents = (rate_of_choke(x, 5e-3, 0.8, 280.0) for x in (5e-3, 7e-3))
    wanted = {
        "act.cylinder.k_f": fills, "act.cylinder.k_v": vents, "act.cylinder.V": 5e-3,
        "act.T_max": 6.1e3, "act.cylinder.p_full": 3.6e5, "act.cylinder.weighed": 30 / 41,
        "act.valves.pulse": 0.021, "air.p_s": 5.2e5, "air.p_start": 7.7e5, "air.charge": 2e-3,
        "air.V_r": 0.11, "res.c0": 900.0, "res.c1": 11.0, "res.c2": 3.5, "m": 41e3, "g": 9.7,
    }  # fmt: skip
    own = {n: found[n] for n in wanted}
    assert own == pytest.approx(wanted)
    plain = numbers(made.plant(ODD, replace(AIR, reserve=None, reservoir=None, weighed=None,
                                            charge=0.0), double_exponential))  # fmt: skip
    assert (plain["air.p_start"], plain["air.V_r"]) == (5.2e5, 1e6)
    assert plain["act.cylinder.weighed"] == 1
    block = made.air_brake_of_axle(AIR, 60e3)
    assert block.parts["valves"].choices == {"ticks": 13}
    assert numbers(block)["cylinder.weighed"] == 0.5


def test_motors_and_magnets_have_the_numbers_of_their_file():
    motors = DynamicBrake(torque=2.1e3, power=9e4, lag=0.13, fades_from=3.1, fades_to=0.7,
                          pause=2.2, lost=17.0, axles=(1, 3))  # fmt: skip
    magnets = TrackBrake(attraction=8e4, friction=0.17, fall=0.021, delay=1.3, above=6.0)
    vehicle = replace(ODD, dynamic_brake=motors, track_brake=magnets)
    found = numbers(made.plant(vehicle, Lag(torque=7e3), double_exponential))
    wanted = {
        "motors.T_top": [2.1e3, 0, 2.1e3], "motors.r": [0.5, 0.48, 0.46], "motors.P_top": 9e4,
        "motors.tau_e": 0.13, "motors.v_full": 3.1, "motors.v_gone": 0.7, "motors.pause": 2.2,
        "motors.lost": 17.0, "magnets.attraction": 8e4, "magnets.friction": 0.17,
        "magnets.fall": 0.021, "magnets.delay": 1.3, "magnets.above": 6.0,
    }  # fmt: skip
    assert {n: found[n] for n in wanted} == wanted
    alike = replace(vehicle, radius=0.5, dynamic_brake=replace(motors, axles=None, power=None,
                                                               lost=None))  # fmt: skip
    found = numbers(made.plant(alike, Lag(torque=7e3), double_exponential))
    assert (found["motors.T_top"], found["motors.r"]) == (2.1e3, 0.5)
    assert (found["motors.P_top"], found["motors.lost"]) == (1e9, 1e6)


@pytest.mark.parametrize(("pads", "motors", "air", "wanted"), [
    (False, False, False, {"train.T_b": "act.T_b", "T": "act.T_b", "act.T_cmd": "T_cmd"}),
    (True, False, False, {"pads.T": "act.T_b", "train.T_b": "pads.T_b", "T": "act.T_b",
                          "pads.omega": "train.omega"}),
    (False, True, False, {"act.T_cmd": "motors.T_f", "motors.T_cmd": "T_cmd", "T": "sum.T_b",
                          "sum.T_f": "act.T_b", "sum.T_e": "motors.T_e",
                          "train.T_b": "sum.T_b"}),
    (True, True, False, {"sum.T_f": "pads.T_b", "seen.T_f": "act.T_b", "T": "seen.T_b",
                         "seen.T_e": "motors.T_e", "train.T_b": "sum.T_b"}),
    (False, True, True, {"motors.T_cmd": "T_demand", "act.T_demand": "motors.T_f",
                         "motors.hold": "hold", "motors.vent": "vent", "act.hold": "hold",
                         "act.vent": "vent", "air.drawn": "act.drawn",
                         "act.supply": "air.supply", "pressure": "act.pressure"}),
    (False, False, True, {"act.T_demand": "T_demand", "train.T_b": "act.T_b", "T": "act.T_b"}),
])  # fmt: skip
def test_torque_goes_from_actuators_by_pads_and_motors_to_the_axles(pads, motors, air, wanted):
    vehicle = replace(ODD, pads=Pads(material="disc") if pads else None,
                      dynamic_brake=DynamicBrake(torque=2e3) if motors else None)  # fmt: skip
    wires = made.plant(vehicle, AIR if air else Lag(torque=7e3), double_exponential).wires
    assert {n: wires.get(n) for n in wanted} == wanted
    always = {"res.v": "train.v", "grade.F_R": "res.F_R", "train.F_d": "grade.F_d",
              "train.F_m": "res.F_R", "train.F_h": "res.F_h", "omega": "train.omega"}  # fmt: skip
    assert {n: wires.get(n) for n in always} == always


def test_a_driven_vehicle_is_limited_and_seen_in_the_mirror():
    vehicle = replace(ODD, mode="drive", driven=(1, 3), radius=0.5)
    wires = made.plant(vehicle, Lag(torque=7e3, power=9e4), double_exponential).wires
    wanted = {"act.T_cmd": "T_cmd", "limit.T": "act.T_b", "limit.omega": "train.omega_d",
              "motor.u": "limit.T_m", "train.T": "motor.y", "T": "limit.T_m",
              "omega": "train.omega_d"}  # fmt: skip
    assert {n: wires.get(n) for n in wanted} == wanted
    assert "train.T_b" not in wires


def test_resistance_opposes_motion_and_a_slope_weighs():
    d = Draw(200, 2)
    s = {"v": d.one_of(0, d.even(-30, 30)), "c0": d.even(0, 2e3), "c1": d.even(0, 50),
         "c2": d.even(0, 9)}  # fmt: skip
    force = s["c0"] + s["c1"] * np.abs(s["v"]) + s["c2"] * s["v"] ** 2
    assert_same(values(made.running_resistance, s, 200)[2],
                {"F_R": np.sign(s["v"]) * force, "F_h": s["c0"]})  # fmt: skip
    g = {"F_R": d.even(-2e3, 2e3), "m": d.even(3e4, 6e4), "g": d.even(9, 10.5),
         "slope": d.even(-0.05, 0.05)}  # fmt: skip
    assert_same(values(made.with_gradient, g, 200)[2],
                {"F_d": g["F_R"] + g["m"] * g["g"] * g["slope"]})  # fmt: skip


@pytest.mark.parametrize("braking", [False, True])
def test_a_law_by_slip_ratio_is_one_of_creep_for_a_train(braking):
    way = "braking" if braking else "traction"

    @law(mu=Output("1", "adhesion", positive="braking"))
    def hyperbola(lam=Input("1", "ratio", positive=way, lo=-2, hi=1.7), v=Input("m/s", "speed"),
                  b=Param("1", 0.1, "bend", "test")):  # fmt: skip
        """A law."""
        return (1 if braking else -1) * 0.4 * lam / (lam + b) / (1 + 0.01 * v)

    d = Draw(300, 3)
    s = {"v_s": d.even(-3, 3), "v": d.one_of(d.even(-20, 20), d.even(-0.5, 0.5)),
         "b": d.even(0.05, 0.2), "v_least": d.even(0.3, 2)}  # fmt: skip
    block = made.on_train(hyperbola)
    _, _, told = values(block, s, 300)
    ratio = np.abs(s["v_s"]) / np.maximum(np.abs(s["v"]), s["v_least"])
    mu = 0.4 * ratio / (ratio + s["b"]) / (1 + 0.01 * np.abs(s["v"]))
    assert_same(told, {"mu": np.where(s["v_s"] >= 0, mu, -mu)})
    assert block.law_data.meant_to == 1.7
    assert numbers(block)["v_least"] == 1.0


CARS = (
    Car(mass=30e3, axles=4, bogies=2, wheelbase=2.0, bogie_centres=12.0, length=19.0, count=2),
    Car(tare=20e3, load=4e3, axles=2, bogies=0, wheelbase=9.0, length=14.0, radius=0.4,
        inertia=77.0),
)  # fmt: skip


def test_axles_of_cars_stand_where_their_lengths_say():
    train = Vehicle(cars=CARS, rotating_mass=0.05, radius=0.45, speed=20.0)
    first = [0.0, 2.0, 12.0, 14.0]
    third = 2 * 19.0 + (14.0 - 9.0) / 2 - (19.0 - 14.0) / 2
    assert train.behind == pytest.approx([*first, *(19 + x for x in first), third, third + 9])
    assert train.axles == 10
    assert train.total == 84e3
    assert train.carried == (7.5e3,) * 8 + (12e3,) * 2
    assert train.radii == (0.45,) * 8 + (0.4,) * 2
    mean = (8 * 0.45 + 2 * 0.4) / 10
    assert train.wheel_radius == pytest.approx(mean)
    own = 0.05 * 80e3 * mean**2 / 10  # of the mass without load
    assert train.inertias == pytest.approx([own] * 8 + [77.0] * 2)
    assert train.wheel_inertia == pytest.approx((8 * own + 2 * 77) / 10)
    assert [train.car_of(k) for k in range(10)] == [0] * 8 + [1] * 2
    assert train.each_car == (CARS[0], CARS[0], CARS[1])
    assert train.moved == (0.0,) * 10


def test_axles_without_cars_stand_by_bogies_and_driven_ones_are_named_from_one():
    long = Vehicle(mass=90e3, axles=9, inertia=100.0, speed=9.0, wheelbase=2.2, bogie_centres=12.5,
                   car_length=20.0)  # fmt: skip
    car = [0.0, 2.2, 12.5, 14.7]
    assert long.behind == pytest.approx([*car, *(20 + x for x in car), 40.0])
    assert long.worked == tuple(range(9))
    assert long.carried == (10e3,) * 9
    two = Vehicle(tare=20e3, load=5e3, axles=2, rotating_mass=0.1, speed=9.0, wheelbase=8.0,
                  mode="drive", driven=(2,), radius=(0.5, 0.4))  # fmt: skip
    assert (two.behind, two.worked, two.total) == ((0.0, 8.0), (1,), 25e3)
    assert two.inertias == pytest.approx([0.1 * 20e3 * 0.45**2 / 2] * 2)
