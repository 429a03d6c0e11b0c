"""Blocks that give an axle its command, at drawn points, against their rules over whole arrays."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl.models.vehicle import safe_output
from slipctl.models.vehicle.slip import takeover
from slipctl.models.vehicle.slip.fill_ahead import fill_ahead
from slipctl.models.vehicle.slip.scheduled_pi import scheduled_pi

MANY = 3000


def clip(x, low, high):
    return np.minimum(np.maximum(x, low), high)


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("mode", ["demand", "hold", 2e3])
def test_the_safe_output_stands_for_slip_control_that_is_not_relied_on(mode, driven):
    d = Draw(MANY, 1)
    T_max = d.even(5e3, 9e3)
    s = {
        "T_h": d.even(0, 1) * T_max, "let_go": d.even(0, 3), "back": d.one_of(0, d.even(0, 0.3)),
        "slow": d.bits(), "T_slip": d.one_of(d.even(0, 1.2), d.even(0, 0.1)) * T_max,
        "T_demand": d.one_of(d.even(-0.1, 1.2), d.even(0, 0.04)) * T_max, "on": d.bits(),
        "ready": d.bits(share=0.8), "sound": d.bits(share=0.8), "stands": d.bits(),
        "v": d.even(0, 8), "retry": d.bits(share=0.2), "test": d.bits(share=0.2), "T_max": T_max,
        "v_off": d.even(0.5, 3), "rate": d.even(5, 40), "limit": d.even(1, 3),
        "limit_still": d.even(0.5, 3), "again": d.even(0.5, 2), "T": d.even(0.02, 0.2),
    }  # fmt: skip
    _, after, told = values(safe_output.safe_command(mode, driven), s, MANY)
    top = clip(s["T_demand"], 0, T_max)
    given_back = (s["back"] > 0) | (s["retry"] == 1)
    relied = (s["ready"] == 1) & (s["sound"] == 1) & ~given_back & (s["v"] >= s["v_off"])
    safe = {"demand": top, "hold": np.minimum(s["T_h"], top)}.get(mode, np.minimum(2e3, top))
    # the demand of a slow axle; and of one that is released too long, where it is a brake
    fine = s["ready"] == 1
    if driven:
        fine = fine & (s["sound"] == 1) & ~given_back
    slip = np.where(s["test"] == 1, 0, np.minimum(s["T_slip"], top))
    wanted = np.where(relied, slip, np.where(fine, top, safe))
    ramp = (~relied | (s["slow"] == 1)) & (s["on"] == 0)
    rising = s["T_h"] + s["rate"] * T_max * s["T"]
    command = np.where(ramp, np.minimum(wanted, rising), wanted)
    released = relied & (s["on"] == 1) & (top > 0.02 * T_max)
    released &= (command < 0.1 * top) | (command < s["T_h"])
    time = np.where(released, s["let_go"] + s["T"], 0)
    short = np.where(s["stands"] == 1, np.minimum(s["limit"], s["limit_still"]), s["limit"])
    over = time >= short
    assert_same(after, {
        "T_h": command, "let_go": np.where(over, 0, np.minimum(time, s["limit"])),
        "back": np.where(over, s["again"], np.maximum(s["back"] - s["T"], 0)),
        "slow": ramp & (command < wanted),
    })  # fmt: skip
    assert_same(told, {"T_cmd": command, "released": given_back})
    assert 0.02 < over.mean() < 0.98


def test_a_sample_is_handed_on_where_it_is_believed():
    d = Draw(MANY, 2)
    s = {"mu_m": d.even(-3, 3), "v_s_m": d.even(-1, 2), "ready": d.bits()}
    _, _, told = values(safe_output.sample, s, MANY)
    good = (s["ready"] == 1) & (s["v_s_m"] >= -0.5)
    assert_same(told, {"mu": good * clip(s["mu_m"], -2, 2), "v_s": good * s["v_s_m"]})


@pytest.mark.parametrize(("noise", "standstill"), [(0.3, 0.3), (7.0, 5.0)])
def test_a_reference_is_not_below_what_speeds_may_be_off_by(noise, standstill):
    d = Draw(MANY, 3)
    s = {"searched": d.even(0, 2), "v": d.even(-40, 40)}
    _, _, told = values(safe_output.reference_with_floor(1.4, noise), s, MANY)
    floor = np.minimum(standstill + 0.045 * np.abs(s["v"]), 0.85 * 1.4)
    assert_same(told, {"v_best": np.maximum(s["searched"], floor)})


def test_the_rail_carries_its_adhesion_times_the_load_within_the_demand():
    d = Draw(MANY, 4)
    s = {"mu": d.even(-0.1, 0.4), "T_demand": d.even(-2e3, 12e3), "m_axle": d.even(5e3, 9e3),
         "r": d.even(0.3, 0.6), "g": d.even(9, 10.5), "T_max": d.even(5e3, 9e3)}  # fmt: skip
    _, _, told = values(safe_output.carried_torque, s, MANY)
    carried = s["mu"] * s["m_axle"] * s["g"] * s["r"]
    assert_same(told, {"T": clip(carried, 0, clip(s["T_demand"], 0, s["T_max"]))})


@pytest.mark.parametrize("driven", [False, True])
def test_slip_control_wakes_at_a_slip_and_rests_where_the_demand_is_less(driven):
    d = Draw(MANY, 5)
    s = {"v": d.even(0, 30), "rim": d.even(0, 30), "r": d.even(0.3, 0.6)}
    _, _, told = values(takeover.slip_from_speeds(driven), s, MANY)
    side = -1 if driven else 1
    assert_same(told, {"v_s": side * (s["v"] - s["rim"]), "omega_s": side * s["rim"] / s["r"]})
    always = driven  # another choice of two
    w = {"ruling": d.bits(), "v": d.even(0, 4), "v_s": d.even(-0.5, 2), "v_best": d.even(0, 2),
         "ready": d.bits(share=0.8), "share": d.even(0.2, 0.8), "least": d.even(0.1, 0.6),
         "v_off": d.even(0.5, 2)}  # fmt: skip
    _, _, told = values(takeover.wake(always), w, MANY)
    slips = w["v_s"] > np.maximum(w["share"] * w["v_best"], w["least"])
    can = (w["v"] >= w["v_off"]) & (w["ready"] == 1)
    assert_same(told, {"on": can & (always | slips | (w["ruling"] == 1)), "slips": slips})
    g = {"ruling": d.bits(), "idle": d.even(0, 0.3), "rules": d.bits(share=0.8), "slips": d.bits(),
         "T_wanted": d.even(0, 9e3), "T_demand": d.even(0, 5e3), "rest": d.even(0.1, 0.3),
         "T": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = values(takeover.watch(always), g, MANY)
    calm = (g["rules"] == 1) & (g["slips"] == 0) & (g["T_wanted"] >= g["T_demand"])
    idle = np.where(calm, g["idle"] + g["T"], 0)
    rules = np.where((idle >= g["rest"]) & (not always), 0, g["rules"])
    assert_same(after, {"ruling": rules, "idle": idle})
    assert_same(told, {"on": g["rules"]})
    assert takeover.watch(always).start()["ruling"] == always


def test_a_command_leads_the_torque_and_stays_within_demand_and_brake():
    d = Draw(MANY, 6)
    T_max = d.even(5e3, 9e3)
    s = {"T_wanted": d.even(-0.3, 1.3) * T_max, "T_demand": d.even(-0.3, 1.3) * T_max,
         "T": d.even(0, 1) * T_max, "on": d.bits(), "T_max": T_max,
         "lead": d.even(1, 4)}  # fmt: skip
    _, _, told = values(takeover.applied, s, MANY)
    top = clip(s["T_demand"], 0, T_max)
    led = s["T"] + s["lead"] * (clip(s["T_wanted"], 0, T_max) - s["T"])
    assert_same(told, {"T_cmd": np.where(s["on"] == 1, clip(led, 0, top), top)})
    only = {n: s[n] for n in ("T_demand", "T_max")}
    assert_same(values(takeover.demand_alone, only, MANY)[2], {"T_cmd": top})
    free = d.bits()
    freed = {"T_slip": s["T_wanted"], "free": free, "T_max": T_max}
    _, _, told = values(takeover.released_torque, freed, MANY)
    assert_same(told, {"T_cmd": (1 - free) * clip(s["T_wanted"], 0, T_max)})
    hold, vent = d.bits(), d.bits()
    _, _, told = values(takeover.released_valves,
                        {"hold_by": hold, "vent_by": vent, "free": free}, MANY)  # fmt: skip
    assert_same(told, {"hold": (hold + free) > 0, "vent": (vent + free) > 0})


def test_axles_are_let_go_in_turn_from_the_last_one_on():
    d, n = Draw(MANY, 7), 3
    T_max, axle = d.even(5e3, 9e3), d.one_of(0.0, 1.0, np.full((MANY, 1), 2.0))
    demand = d.even(-0.1, 1.2) * T_max
    s = {"clock": d.even(5, 8), "left": d.one_of(0, d.even(0, 0.3)), "axle": axle,
         "v": d.even(1, 6), "T_b": np.maximum(demand, 0) * d.even(0.85, 1.1, n),
         "T_demand": demand, "T_max": T_max, "time": d.even(0.5, 2), "every_": d.even(6, 9),
         "v_least": d.even(2, 4), "T": d.even(0.01, 0.2)}  # fmt: skip
    _, after, told = values(takeover.turns(n), s, MANY)
    top = clip(demand, 0, T_max)
    slides = (s["T_b"] < 0.9 * top).any(axis=1, keepdims=True) & (s["v"] > s["v_least"])
    due = s["clock"] + s["time"] >= s["every_"]  # from one axle to the next
    left = np.where(s["left"] > 0, np.maximum(s["left"] - s["T"], 0), due * s["time"])
    left = np.where(slides, left, 0)
    ended = (s["left"] > 0) & (left == 0)
    assert_same(after, {
        "left": left, "clock": np.where(slides & (left == 0), s["clock"] + s["T"], 0),
        "axle": np.where(ended, (axle - 1) % n, axle),
    })  # fmt: skip
    assert_same(told, {"free": (left > 0) & (axle == np.arange(n))})
    assert takeover.turns(n).start()["axle"] == n - 1
    far = values(takeover.turns(n), {"clock": np.full((1, 1), 1e3 - 1e-4), "T_demand": 5e3,
                                     "every_": 2e3, "v": 9.0, "T_b": 0.0}, 1)[1]  # fmt: skip
    assert far["clock"] == 1e3


def test_an_axle_fills_ahead_where_its_slip_stays_within_the_limit():
    d = Draw(MANY, 8)
    v = d.one_of(d.even(-20, 20), d.even(-2, 2))
    s = {"since": d.one_of(0, d.even(0, 1.6)), "v": v, "v_s": np.abs(v) * d.even(0, 0.4),
         "own": np.abs(v) * d.even(0, 0.5), "ahead": d.one_of(1e3, d.even(0, 12)),
         "slip": d.even(0.15, 0.4), "rate": d.even(2e3, 9e3), "dead": d.even(0.02, 0.2),
         "J": d.even(60, 160), "r": d.even(0.3, 0.6), "T": d.even(1e-3, 0.2)}  # fmt: skip
    _, after, told = values(fill_ahead, s, MANY)
    time = np.maximum(s["ahead"] / np.maximum(np.abs(v), 1) - s["dead"], 0)
    there = s["v_s"] + s["rate"] / s["J"] * s["r"] * time**2 / 2
    limit = np.maximum(s["slip"] * np.abs(v), s["own"])
    goes = (s["ahead"] < 1e3) & (there <= limit) | (s["since"] > 0) & (s["v_s"] > s["own"])
    assert_same(after, {"since": np.where(goes, np.minimum(s["since"] + s["T"], 1.5), 0)})
    on = goes & (s["since"] < 1.5)
    assert_same(told, {"v_best": np.where(on, limit, s["own"])})
    assert 0.1 < on.mean() < 0.9


def test_a_scheduled_pi_law_is_its_equations():
    d = Draw(MANY, 9)
    s = {"integral": d.even(-2e3, 9e3), "begun": d.bits(), "v": d.even(-40, 40),
         "v_s": d.even(-1, 4), "v_best": d.even(0, 2), "T": d.even(0, 8e3),
         "T_top": d.even(-1e3, 8e3), "K": d.even(2, 12), "T_i": d.even(0.1, 1),
         "T_t": d.even(0.05, 0.5), "v_n": d.even(15, 30), "least": d.even(0.1, 0.4),
         "J": d.even(60, 160), "r": d.even(0.3, 0.6), "T_s": d.even(1e-3, 0.3)}  # fmt: skip
    _, after, told = values(scheduled_pi, s, MANY)
    e, share = s["v_s"] - s["v_best"], clip(np.abs(s["v"]) / s["v_n"], s["least"], 1)
    push = s["J"] * s["K"] * share * e / s["r"]
    integral = np.where(s["begun"] == 1, s["integral"], s["T"] + push)
    wanted = integral - push
    within = clip(wanted, 0, np.maximum(s["T_top"], 0))
    follows = np.minimum(s["T_s"] / s["T_t"], 1) * (within - wanted)
    assert_same(told, {"T_wanted": wanted})
    integral = integral - s["T_s"] * push / s["T_i"] + follows
    assert_same(after, {"integral": integral, "begun": 1})
