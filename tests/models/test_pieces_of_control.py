"""Pieces of a vehicle's control, with numbers that all differ: what each is told, and by whom."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_points import Draw, assert_same, numbers, values

from slipctl import BadInput
from slipctl.models.huang_2020.subway_braking import double_exponential, peak_slip
from slipctl.models.vehicle import (
    Air,
    Lag,
    ScheduledPI,
    SlideProtection,
    SlipLaw,
    SlipRatio,
    SlipSpeed,
    TrainSlip,
    Valve,
    control,
)
from slipctl.models.vehicle.air import valve_control
from slipctl.models.vehicle.parts import OwnLaw, Searched, SlipControl
from slipctl.models.vehicle.slip import common_numbers, own_law
from slipctl.models.vehicle.slip.fixed_reference import fixed_reference
from tests.models.test_ends_and_demands_of_trips import TRIP
from tests.models.test_slide_protection import train

SETTINGS = SlipControl(period=2e-3, wake=0.6, least=0.4, off=1.7, rest=0.35, release=7.0,
                       release_still=2.5)  # fmt: skip
MINE = replace(TRIP, control=SETTINGS, reference=SlipSpeed(slip=0.9))


def test_a_wheel_is_that_of_the_vehicle_and_its_reference():
    w = control.wheel(MINE)
    assert (w.J, w.r, w.W, w.m, w.g, w.T_max, w.tau, w.v_best, w.v) == (
        100.0, 0.5, 9e3, 9e3, 9.7, 8e3, 0.05, 0.9, 20.0)  # fmt: skip
    driven = replace(MINE.vehicle, mode="drive", driven=(1, 3), speed=0.3)
    made = replace(MINE, vehicle=driven, actuator=Lag(torque=6e3, lag=0.23))
    w = control.wheel(made, SlipRatio(slip=0.3, least=0.05))
    assert (w.W, w.m, w.T_max, w.tau, w.v) == (9e3, 13.5e3, 6e3, 0.23, 1.0)
    assert w.v_best == pytest.approx(0.3)
    valve = Valve(torque=6e3, fill=0.23, vent=0.11)
    assert control.wheel(replace(MINE, actuator=valve)).tau == valve.usual_lag


@pytest.mark.parametrize(("reference", "speed", "slip"), [
    (SlipSpeed(slip=0.7), 20.0, 0.7), (SlipRatio(slip=0.1, least=0.4), 20.0, 2.0),
    (SlipRatio(slip=0.1, least=0.4), 2.0, 0.4), (TrainSlip(slip=0.3, least=0.2), 20.0, 3.0),
    (TrainSlip(slip=0.3, least=0.2), 0.5, 0.2),
    (Searched(start={"c": 0.3, "a": 0.5, "b": 1.3}), 20.0, float(peak_slip(0.3, 0.5, 1.3))),
])  # fmt: skip
def test_a_law_is_scaled_by_the_slip_that_its_reference_begins_at(reference, speed, slip):
    assert control.typical_slip(reference, speed) == pytest.approx(slip, rel=1e-6)


def test_times_are_whole_periods_of_the_controllers():
    for period, time, ticks in ((1e-3, 0.016, 16), (3e-3, 0.016, 5), (0.05, 0.016, 1)):
        trip = SimpleNamespace(control=SimpleNamespace(period=period))
        assert control.ticks_of(time, trip) == ticks


def test_what_an_axle_gets_without_slip_control():
    for given, brakes, wanted in (("", True, "demand"), ("", False, 0.0), ("hold", True, "hold"),
                                  ("demand", False, "demand"), ("3 kN m", True, 3e3)):  # fmt: skip
        trip = SimpleNamespace(
            control=SimpleNamespace(safe=given),
            vehicle=SimpleNamespace(mode="brake" if brakes else "drive"),
        )
        assert control.safe_output(trip) == wanted


def test_each_axle_has_its_own_slip_or_number_of_axles_behind():
    plain = SimpleNamespace(reference=None)
    each = replace(MINE, reference=SlipRatio(slip=(0.1, 0.2, 0.3)))
    found = control.numbers_of_each_axle(each, plain)
    assert {n: v.tolist() for n, v in found.items()} == {"reference.slip": [0.1, 0.2, 0.3]}
    assert control.numbers_of_each_axle(MINE, plain) == {}
    one = SimpleNamespace(reference=SlipRatio(slip=0.1))
    assert control.numbers_of_each_axle(each, one) == {}
    behind = control.numbers_of_each_axle(MINE, SimpleNamespace(reference=TrainSlip()))
    assert {n: v.tolist() for n, v in behind.items()} == {"reference.behind": [2, 1, 0]}
    assert control.numbers_of_each_axle(MINE, SimpleNamespace(reference=TrainSlip(plan=True))) == {}


def test_parts_of_an_axle_have_the_settings_of_the_file_and_their_wires():
    part = SlipLaw(kind="pid", gains={"K": "7 1/s"}, lead=1.5)
    w = control.wheel(MINE)
    parts, wires = control._axle(MINE, part, w)
    assert set(parts) == {"slip", "meter", "force", "fall", "law", "wake", "watch", "apply",
                          "carried", "reference"}  # fmt: skip
    wake = numbers(parts["wake"])
    assert (wake["share"], wake["least"], wake["v_off"]) == (0.6, 0.4, 1.7)
    assert numbers(parts["watch"])["rest"] == 0.35
    assert numbers(parts["apply"])["lead"] == 1.5
    assert parts["meter"].choices == {"window": 8, "torque": "sampled"}
    assert numbers(parts["law"])["law.K"] == 7
    assert numbers(parts["reference"])["slip"] == 0.9
    wanted = control.WIRES | {
        "carried.mu": "sample.mu", "carried.T_demand": "trust.demand", "force.mu": "meter.mu_m",
        "reference.v": "trust.v", "wake.v_best": "reference.v_best", "law.v": "trust.v",
        "law.v_s": "slip.v_s", "law.v_best": "reference.v_best", "law.F": "force.F",
        "law.T_begin": "carried.T",
    }  # fmt: skip
    assert {n: s for n, s in wires.items() if n in wanted} == wanted
    assert set(wires) - set(wanted) <= {"law.D", "law.T"}


def test_a_scheduled_law_has_the_numbers_of_its_file_and_is_told_torques():
    part = ScheduledPI(K=6.5, integral=0.7, follow=0.3, full=18.0, least=0.35,
                       reference=SlipRatio(slip=0.15, least=0.25))  # fmt: skip
    parts, wires = control._axle(MINE, part, control.wheel(MINE))
    found = numbers(parts["law"])
    wanted = {"K": 6.5, "T_i": 0.7, "T_t": 0.3, "v_n": 18.0, "least": 0.35, "J": 100.0, "r": 0.5}
    assert {n: found[n] for n in wanted} == wanted
    assert wires["law.T"] == "trust.T_b"
    assert wires["law.T_top"] == "trust.demand"
    reference = numbers(parts["reference"])
    assert (reference["slip"], reference["least"]) == (0.15, 0.25)


def test_a_command_is_safe_and_goes_by_valves_where_the_brake_is_air():
    w = control.wheel(MINE)
    part = SlipLaw(kind="pid")
    parts, wires = control._controlled_axle(MINE, part, w)
    safe = numbers(parts["safe"])
    assert (safe["v_off"], safe["limit"], safe["limit_still"]) == (1.7, 7.0, 2.5)
    wanted = {
        "sample.mu_m": "meter.mu_m", "sample.v_s_m": "meter.v_s_m", "sample.ready": "trust.ready",
        "safe.T_slip": "apply.T_cmd", "safe.T_demand": "trust.demand", "safe.on": "wake.on",
        "safe.ready": "trust.ready", "safe.sound": "law.sound", "safe.stands": "trust.stands",
        "safe.v": "trust.v", "safe.retry": "trust.retry", "safe.test": "trust.test",
        "T_cmd": "safe.T_cmd", "trust.T_cmd": "safe.T_h",
    }  # fmt: skip
    assert {n: wires[n] for n in wanted} == wanted
    assert "valves" not in parts
    air = Air(torque=5.5e3, pressure=3.5e5, supply=5.5e5, band=4e3, pulse=0.012, dead_time=0.03,
              fill_rate=0.5, vent_rate=1.6)  # fmt: skip
    parts, wires = control._controlled_axle(replace(MINE, actuator=air), part, w)
    valves, model = numbers(parts["valves"]), numbers(parts["model"])
    wanted = {"T_max": 5.5e3, "p_full": 3.5e5, "p_s": 5.5e5, "k_f": 0.5, "k_v": 1.6}
    assert {n: model[n] for n in wanted} == wanted
    wanted |= {"band": 4e3, "pulse": 0.012}
    assert {n: valves[n] for n in wanted} == wanted
    assert parts["model"].choices == {"ticks": 15}
    lines = {
        "valves.T_cmd": "safe.T_cmd", "valves.T_demand": "trust.demand",
        "valves.T_b": "trust.T_b", "valves.under_way": "model.under_way", "hold": "valves.hold",
        "vent": "valves.vent", "trust.T_cmd": "model.T_h", "model.hold": "valves.hold",
        "model.vent": "valves.vent", "model.T_b": "trust.T_b", "model.T_demand": "trust.demand",
    }  # fmt: skip
    assert {n: wires[n] for n in lines} == lines


def test_a_slide_protection_has_the_thresholds_of_its_file():
    part = SlideProtection(slip=1.1, share=0.07, deceleration=3.1, hold=0.45, hold_deceleration=0.9,
                           fill=0.25, fill_acceleration=0.4, cut_off=2.2, filter=0.06,
                           ramp=0.55)  # fmt: skip
    trip = train(3, control=replace(SETTINGS, period=0.01))
    parts, wires = valve_control.slide_protection(trip, part, control.wheel(trip))
    machine = numbers(parts["machine"])
    wanted = {"dv_0": 1.1, "dv_v": 0.07, "a_vent": 3.1, "s_hold": 0.45, "a_hold": 0.9,
              "s_fill": 0.25, "a_fill": 0.4}  # fmt: skip
    assert {n: machine[n] for n in wanted} == wanted
    assert numbers(parts["gate"])["v_off"] == 2.2
    rim = numbers(parts["rim"])
    assert (rim["T_f"], rim["v_start"]) == (0.06, 25.0)
    refill, safe = numbers(parts["refill"]), numbers(parts["safe"])
    assert (refill["ramp"], refill["m_axle"], refill["r"]) == (0.55, 12e3, 0.46)
    assert (refill["k_f"], refill["k_v"], refill["T_max"]) == (0.44, 1.75, 12e3 * 0.46)
    assert (safe["limit"], safe["limit_still"]) == (7.0, 2.5)
    lines = {
        "slip.v": "trust.v", "slip.rim": "trust.rim", "gate.v": "trust.v",
        "gate.ready": "trust.ready", "rim.rim": "trust.rim", "machine.v": "trust.v",
        "machine.v_s": "slip.v_s", "machine.a_w": "rim.a_w", "machine.off": "gate.off",
        "refill.state": "machine.state", "refill.T_b": "trust.T_b",
        "refill.under_way": "model.under_way", "refill.T_demand": "trust.demand",
        "safe.hold_by": "refill.hold", "safe.vent_by": "refill.vent", "safe.off": "gate.off",
        "safe.stands": "trust.stands", "safe.retry": "trust.retry", "safe.T_b": "trust.T_b",
        "safe.T_demand": "trust.demand", "hold": "safe.hold", "vent": "safe.vent",
        "trust.T_cmd": "model.T_h", "model.hold": "safe.hold", "model.vent": "safe.vent",
        "model.T_b": "trust.T_b", "model.T_demand": "trust.demand",
    }  # fmt: skip
    assert wires == lines


@pytest.mark.parametrize("air", [False, True])
def test_an_axle_that_goes_in_turn_is_released_behind_its_command(air):
    trip = SimpleNamespace(
        control=SimpleNamespace(let_go=1.3), actuator=Air(torque=5e3) if air else Lag(torque=5e3)
    )
    parts, wires = {}, {"T_cmd": "safe.T_cmd", "hold": "safe.hold", "vent": "safe.vent"}
    control._let_go(trip, parts, wires)
    turn = {"turn.v": "trust.v", "turn.T_b": "trust.T_b", "turn.T_demand": "trust.demand",
            "release.free": "turn.free"}  # fmt: skip
    bits = {"release.hold_by": "safe.hold", "hold": "release.hold", "model.hold": "release.hold",
            "release.vent_by": "safe.vent", "vent": "release.vent", "model.vent": "release.vent",
            "T_cmd": "safe.T_cmd"}  # fmt: skip
    torque = {"release.T_slip": "safe.T_cmd", "T_cmd": "release.T_cmd", "hold": "safe.hold",
              "vent": "safe.vent"}  # fmt: skip
    assert wires == turn | (bits if air else torque)
    assert numbers(parts["release"]) == ({} if air else {"T_max": 5e3})
    trip.control.let_go, parts, wires = None, {}, {}
    control._let_go(trip, parts, wires)
    assert (parts, wires) == ({}, {})


def test_a_fixed_reference_is_a_slip_or_a_share_of_the_speed():
    d = Draw(200, 1)
    v, least = d.one_of(d.even(-20, 20), d.even(-0.02, 0.02)), d.even(0.1, 0.5)
    block = fixed_reference(SlipSpeed(slip=0.8))
    assert numbers(block) == {"slip": 0.8}
    slip = d.even(0.1, 3)
    _, _, told = values(block, {"v": v, "slip": slip}, 200)
    assert_same(told, {"v_best": np.minimum(slip, np.maximum(np.abs(v), 0.01))})
    block = fixed_reference(SlipRatio(slip=(0.11, 0.2, 0.3), least=0.27))
    assert numbers(block) == {"slip": 0.11, "least": 0.27}
    _, _, told = values(block, {"v": v, "slip": slip / 9, "least": least}, 200)
    assert_same(told, {"v_best": np.maximum(slip / 9 * np.abs(v), least)})


def test_a_law_of_one_s_own_gets_the_wheel_s_numbers_that_are_its_own(monkeypatch):
    w = control.wheel(MINE)
    given = {}

    def block(inputs, outputs=("T_wanted",), params=()):
        signals = {n: SimpleNamespace(derived=n == "tau", name=n) for n in params}
        return SimpleNamespace(
            inputs={n: SimpleNamespace(value=v) for n, v in inputs.items()},
            outputs=dict.fromkeys(outputs), params=signals,
            with_params=lambda **k: given.update(k) or "made",
        )  # fmt: skip

    monkeypatch.setattr(own_law, "of_the_wheel", lambda s, n: n != "g")
    part = OwnLaw(block="mine.py:mine")
    known = dict.fromkeys(list(own_law.INPUTS)[:2])
    own = block(known | {"beside": 3.0}, params=("J", "r", "g", "tau", "T_max", "other"))
    monkeypatch.setattr(own_law, "own_block", lambda trip, part: own)
    assert own_law.own_slip_law(MINE, part, w) == "made"
    assert given == {"J": 100.0, "r": 0.5, "T_max": 8e3}
    for wrong, said in ((block(known | {"beside": None}), "needs beside"),
                        (block(known, ("T", "q")), "gives T, q"),
                        (block(known, ()), "gives nothing")):  # fmt: skip
        monkeypatch.setattr(own_law, "own_block", lambda trip, part, wrong=wrong: wrong)
        with pytest.raises(BadInput, match=said):
            own_law.own_slip_law(MINE, part, w)


def test_a_sample_time_is_one_in_seconds_of_a_part_that_runs_in_every_tick():
    def made(**signals):
        return SimpleNamespace(params={
            n.replace("__", "."): SimpleNamespace(derived=d, unit=u) for n, (d, u) in
            signals.items()})  # fmt: skip

    block = made(safe__T=(False, "s"), T=(False, "s"), law__T=(False, "N m"), a__T=(True, "s"),
                 estimator__T=(False, "s"), a__tau=(False, "s"))  # fmt: skip
    found = [n for n in block.params if common_numbers.is_period(n, block)]
    assert found == ["safe.T", "T"]


def test_a_curve_that_nobody_estimates_has_the_numbers_of_the_first_guess():
    block, ports = control.known_curve()
    assert ports == {n: f"curve.{n}" for n in ("c", "a", "b")}
    assert numbers(block) == {"c_0": 0.3, "a_0": 0.5, "b_0": 1.3}
    told = block(c_0=0.2, a_0=0.6, b_0=1.5)
    assert {n: float(v) for n, v in told.items()} == {"c": 0.2, "a": 0.6, "b": 1.5}
    for n in "cab":
        s = double_exponential.params[n]
        ends = (max(s.lo, -1e6), min(s.hi, 1e6))
        assert (block.outputs[n].lo, block.outputs[n].hi) == ends
        assert (block.params[f"{n}_0"].lo, block.params[f"{n}_0"].hi) == ends
