"""Blocks of an air brake and of its slide protection, at drawn points, against their rules.

The flow of air is that of an isentropic nozzle, by ISO 6358, as in the tests of chokes.
"""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl.models.vehicle.air import pneumatics, slide_protection, valve_control

MANY = 3000
AIR = 1.013e5


def clip(x, low, high):
    return np.minimum(np.maximum(x, low), high)


def psi(ratio):
    """Flow over that at the speed of sound, from the energy equation of air with kappa = 1.4."""
    b = clip(ratio, 1.2**-3.5, 1)
    flow = np.sqrt(np.maximum(b ** (2 / 1.4) - b ** (2.4 / 1.4), 0))
    return flow / np.sqrt(1.2**-5 - 1.2**-6)


def ticks(now, s, T):
    """What a tick of filling adds to a torque and one of venting takes from it."""
    k = s["T_max"] / s["p_full"]
    p, supply = AIR + now / k, s["p_s"] + AIR
    return (k * T * s["k_f"] * supply * psi(p / supply), k * T * s["k_v"] * p * psi(AIR / p))


def numbers(d):
    return {"T_max": d.even(5e3, 9e3), "p_full": d.even(3e5, 4.5e5), "k_f": d.even(0.2, 1),
            "k_v": d.even(0.5, 3)}  # fmt: skip


def test_the_flow_of_air_and_the_rate_of_a_choke():
    ratio = np.linspace(0.01, 0.999, 400)
    found = np.array([float(pneumatics.flow_factor(float(x))) for x in ratio])
    np.testing.assert_allclose(found, psi(ratio), rtol=1e-9)
    assert 0.52828 < pneumatics.CRITICAL < 0.52829
    sonic = np.sqrt(1.4 * 287.0 * 293.0) * 1.2**-3  # speed of sound in the choke, by its density
    area = np.pi / 4 * 6e-3**2
    assert pneumatics.rate_of_choke(6e-3, 3e-3) == pytest.approx(0.7 * area * sonic / 3e-3)
    warm = pneumatics.rate_of_choke(6e-3, 3e-3, 0.8, 250.0)
    assert warm == pytest.approx(0.8 * area * sonic * np.sqrt(250 / 293) / 3e-3)


def test_a_cylinder_fills_holds_vents_and_leaves_by_the_midpoint_rule():
    d = Draw(MANY, 1)
    s = numbers(d)
    T_max, T = s["T_max"], d.even(1e-3, 0.08)
    weighed, demand = d.even(0.5, 1.5), d.even(-0.1, 1.1) * T_max
    goal = AIR + clip(weighed * demand / T_max, 0, 1) * s["p_full"]
    p = d.one_of(goal, np.maximum(goal + d.even(-2e4, 2e4), AIR), AIR + d.even(0, 4e5))
    hold, vent = d.bits(), d.bits(share=0.3)
    supply, V = d.even(5e5, 7e5), d.even(2e-3, 9e-3)
    given = s | {"p": p, "hold": hold, "vent": vent, "T_demand": demand, "supply": supply,
                 "V": V, "weighed": weighed, "T": T}  # fmt: skip
    _, after, told = values(pneumatics.cylinder, given, MANY)
    fills, leaves = (hold == 0) & (p < goal), (hold == 0) & (p > goal)

    def rates(at):
        lets = s["k_v"] * at * psi(AIR / at)
        return fills * s["k_f"] * supply * psi(at / supply), lets * ((vent == 1) | leaves)

    def later(rate, time):
        new = np.maximum(p + time * (rate[0] - rate[1]), AIR)
        new = np.where(fills, np.minimum(new, goal), new)  # the relay valve shuts at the demand
        return np.where(leaves & (vent == 0), np.maximum(new, goal), new)

    middle = rates(later(rates(p), T / 2))
    new = later(middle, T)
    came = np.where(fills, np.maximum(new - p + T * middle[1], 0), 0)
    assert_same(after, {"p": new}, rtol=1e-7, atol=1e-3)
    gauge = p - AIR
    assert_same(told, {"T_b": T_max / s["p_full"] * gauge, "pressure": gauge,
                       "drawn": V * came / AIR}, rtol=1e-7, atol=1e-9)  # fmt: skip
    for case in (fills, leaves, new == goal, came > 0):
        assert 0.05 < case.mean() < 0.95


@pytest.mark.parametrize("dead", [0, 1, 5, 24, 30, 50])
def test_valves_give_each_pair_of_bits_after_its_dead_time(dead):
    """A pair of bits is a digit of base 4; a number holds 24 of them."""
    rng = np.random.default_rng(dead)
    block = pneumatics.magnet_valves(dead).with_params(pulse=5e-3)
    assert block.states["under_way"].size == max(-(-dead // 24), 1)
    bits = rng.integers(0, 2, (160, 2)).repeat(rng.integers(1, 9, 160), axis=0)[:300]
    p = block.pack("param", block.param_values())
    x = block.pack("state", block.start(held=0, vented=0))
    state, age, count = np.zeros(2), 1.0, 0
    for k in range(300):
        x, y = block.f(x, block.pack("input", {"hold": bits[k, 0], "vent": bits[k, 1]}), p)
        asked = bits[k - dead] if k >= dead else np.zeros(2)
        moved = np.abs(asked - state) if age + 5e-4 >= 5e-3 else np.zeros(2)
        state = np.where(moved, asked, state)
        count, age = count + moved.sum(), 1e-3 if moved.any() else min(age + 1e-3, 1.0)
        told = block.unpack("output", y)
        assert [float(told[n]) for n in ("hold", "vent", "switched")] == [*state, count]
    assert 20 < count < 200


def test_a_reservoir_loses_what_is_drawn_and_is_charged_up_to_its_start():
    d = Draw(MANY, 2)
    start = d.even(5e5, 8e5)
    s = {"p_start": start, "p_s": d.even(4e5, 6e5), "V_r": d.even(0.03, 0.3),
         "charge": d.even(0, 0.02), "T": d.even(1e-3, 0.1), "taken": d.even(0, 9),
         "drawn": d.one_of(0, d.even(0, 2e-3, 3)),
         "p_r": AIR + d.one_of(start - d.even(0, 3e3), d.even(0, 1) * start, d.even(0, 2e3)),
         }  # fmt: skip
    _, after, told = values(pneumatics.reservoir(3), s, MANY)
    drawn = s["drawn"].sum(axis=1, keepdims=True)
    new = s["p_r"] + AIR / s["V_r"] * (s["T"] * s["charge"] - drawn)
    assert_same(after, {"p_r": np.maximum(np.minimum(new, start + AIR), AIR),
                        "taken": s["taken"] + drawn})  # fmt: skip
    assert_same(told, {"supply": np.minimum(s["p_r"], s["p_s"] + AIR), "left": s["p_r"] - AIR,
                       "used": s["taken"]})  # fmt: skip


@pytest.mark.parametrize("dead", [0, 1, 3])
def test_what_the_bits_explain_waits_for_the_dead_time_and_follows_the_sensor(dead):
    d = Draw(MANY, 3)
    s = numbers(d) | {"p_s": d.even(5e5, 7e5)}
    T_max, many = s["T_max"], max(dead, 1)
    waiting = d.even(-0.1, 0.1, many) * T_max
    demand = d.even(-0.1, 1.2) * T_max
    torque = d.one_of(demand + d.even(-0.05, 0.05) * T_max, d.even(-0.1, 1.1) * T_max)
    s |= {"T_h": d.even(0, 1) * T_max, "changes": waiting, "under_way": d.even(-0.1, 0.1) * T_max,
          "hold": d.bits(), "vent": d.bits(share=0.3), "T_b": torque, "T_demand": demand,
          "corrects": d.even(1, 30), "T": d.even(1e-3, 0.06)}  # fmt: skip
    _, after, told = values(pneumatics.brake_model(dead), s, MANY)
    now = clip(torque + s["under_way"], 0, T_max)
    up, down = ticks(now, s, s["T"])
    top = clip(demand, 0, T_max)
    change = np.where(now < top, np.minimum(up, top - now), -np.minimum(down, now - top))
    change = np.where(s["hold"] == 1, 0, change)
    change = np.where(s["vent"] == 1, -np.minimum(down, now), change)
    acts = waiting[:, :1] if dead else change
    follows = np.minimum(s["corrects"] * s["T"], 1) * (torque - s["T_h"])
    waits = np.concatenate([waiting[:, 1:], change], axis=1) if dead else 0 * change
    assert_same(after, {
        "T_h": clip(s["T_h"] + acts + follows, 0, T_max), "changes": waits,
        "under_way": clip(waits.sum(axis=1, keepdims=True), -T_max, T_max),
    }, rtol=1e-7, atol=1e-4)  # fmt: skip
    assert_same(told, {"expected": s["T_h"]})


def test_bits_lead_to_a_torque_unless_it_is_near_or_all_of_the_demand():
    d = Draw(MANY, 4)
    s = numbers(d) | {"p_s": d.even(5e5, 7e5), "band": d.even(0, 9e3), "pulse": d.even(0, 0.04),
                      "T": d.even(1e-3, 0.03)}  # fmt: skip
    T_max = s["T_max"]
    demand = d.even(0.3, 1.2) * T_max
    command = d.one_of(np.minimum(demand, T_max) - d.even(0, 2e-3) * T_max, d.even(0, 1) * T_max)
    under_way = d.even(-0.1, 0.1) * T_max
    torque = command - under_way + d.even(-0.05, 0.05) * T_max
    given = s | {"T_cmd": command, "T_demand": demand, "T_b": torque, "under_way": under_way}
    _, _, told = values(pneumatics.valve_bits, given, MANY)
    now = torque + under_way
    up, down = ticks(clip(now, 0, T_max), s, np.maximum(s["pulse"], s["T"]))
    band = s["band"] * T_max / s["p_full"]
    whole = command >= np.minimum(demand, T_max) - T_max / 1000
    vents = ~whole & (now - command > np.maximum(down / 2, band))
    fills = command - now > np.maximum(up / 2, band)
    assert_same(told, {"hold": vents | (~whole & ~fills), "vent": vents})
    for case in (whole, vents, fills):
        assert 0.05 < case.mean() < 0.95


# ---- slide protection ----------------------------------------------------------------------------


def test_filling_goes_along_the_ramp_in_pulses_that_are_worth_it():
    d = Draw(MANY, 5)
    s = numbers(d) | {"p_s": d.even(5e5, 7e5)}
    T_max = s["T_max"]
    demand, state = d.even(-0.1, 1.2) * T_max, d.one_of(0.0, 1.0, np.full((MANY, 1), 2.0))
    torque = d.even(-0.05, 1.05) * T_max
    s |= {"top": d.one_of(torque + d.even(-0.02, 0.06) * T_max, demand - d.even(0, 300)),
          "state": state, "T_b": torque, "under_way": d.even(-0.05, 0.05) * T_max,
          "T_demand": demand, "ramp": d.even(0.3, 2), "m_axle": d.even(5e3, 12e3),
          "r": d.even(0.3, 0.6), "pulse": d.even(0, 0.04), "T": d.even(1e-3, 0.05)}  # fmt: skip
    _, after, told = values(slide_protection.refill, s, MANY)
    now = clip(s["T_b"] + s["under_way"], 0, T_max)
    rises = np.minimum(s["top"] + s["ramp"] * s["m_axle"] * s["r"] * s["T"], T_max)
    top = np.where(state == 0, rises, now)
    up, _ = ticks(now, s, np.maximum(s["pulse"], s["T"]))
    waits = (top < clip(demand, 0, T_max)) & (top - now < up / 2)
    assert_same(after, {"top": top})
    assert_same(told, {"hold": (state > 0) | waits, "vent": state == 2})
    assert 0.05 < waits.mean() < 0.95


def test_a_watchdog_gives_the_demand_after_a_long_release():
    d = Draw(MANY, 6)
    T_max, T = d.even(5e3, 9e3), d.even(1e-3, 0.1)
    demand = d.even(-0.1, 1.2) * T_max
    limit = d.one_of(d.even(1, 3), 900.0)
    s = {"let_go": np.where(limit > 10, 899.95, d.even(0, 3)), "back": d.one_of(0, d.even(0, 0.2)),
         "hold_by": d.bits(), "vent_by": d.bits(), "off": d.bits(share=0.2), "stands": d.bits(),
         "retry": d.bits(share=0.2), "T_b": np.maximum(demand, 0) * d.even(0, 0.2),
         "T_demand": demand, "T_max": T_max, "limit": limit, "limit_still": d.even(1, 3),
         "again": d.even(0.5, 2), "T": T}  # fmt: skip
    _, after, told = values(slide_protection.watchdog, s, MANY)
    given = (s["back"] > 0) | (s["retry"] == 1)
    acts = ~given & (s["off"] == 0)
    hold, vent = acts & (s["hold_by"] == 1), acts & (s["vent_by"] == 1)
    lets = vent | (hold & (s["T_b"] < 0.1 * clip(demand, 0, T_max)))
    time = np.where(lets, s["let_go"] + T, 0)
    short = np.where(s["stands"] == 1, np.minimum(limit, s["limit_still"]), limit)
    over = time >= short
    assert_same(after, {
        "let_go": np.where(over, 0, np.minimum(time, limit)),
        "back": np.where(over, s["again"], np.maximum(s["back"] - T, 0)),
    })  # fmt: skip
    assert_same(told, {"hold": hold, "vent": vent, "released": given})
    far = {"let_go": 999.9995, "limit": 1e4, "vent_by": 1.0, "off": 0.0, "retry": 0.0,
           "stands": 0.0, "hold_by": 0.0, "T_b": 0.0, "T_demand": 1.0}  # fmt: skip
    assert values(slide_protection.watchdog, far, 1)[1]["let_go"] == 1e3  # longer is not counted


def test_the_machine_goes_from_state_to_state_by_slip_and_rim():
    d = Draw(6 * MANY, 7)
    block = slide_protection.slide_machine()
    state, v = d.one_of(0.0, 1.0, np.full((6 * MANY, 1), 2.0)), d.even(0, 30)
    s = {"v": v, "off": d.bits(share=0.1), "dv_0": d.even(0.8, 1.6), "dv_v": d.even(0.05, 0.12),
         "a_vent": d.even(2, 5), "s_hold": d.even(0.4, 0.7), "a_hold": d.even(0.5, 1.9),
         "s_fill": d.even(0.1, 0.35), "a_fill": d.even(-0.3, 0.8)}  # fmt: skip
    most = s["dv_0"] + s["dv_v"] * v
    s |= {"v_s": most * d.even(0, 1.3), "a_w": d.even(-6, 2)}
    (name,) = block.states
    _, after, told = values(block, s | {name: state}, 6 * MANY)
    a, slip = s["a_w"], s["v_s"]
    slides = (a < -s["a_vent"]) | (slip > most)
    filled = np.where(slides, 2, np.where((slip > s["s_hold"] * most) & (a < -s["a_hold"]), 1, 0))
    small = slip < s["s_fill"] * most
    vented = np.where(a > 0, 1, np.where(small & (a > -s["a_vent"] / 2), 0, 2))
    held = np.where(slides & (a <= 0), 2, np.where(small & (a <= s["a_fill"]), 0, 1))
    new = np.where(state == 0, filled, np.where(state == 1, held, vented))
    new = np.where(s["off"] == 1, 0, new)
    assert_same(told, {next(iter(told)): new})
    assert_same(after, {name: new})


def test_the_rim_s_acceleration_and_where_protection_is_off():
    d = Draw(MANY, 8)
    s = {"w_f": d.even(5, 20), "rim": d.even(5, 20), "T_f": d.even(0.02, 0.1),
         "T": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = values(slide_protection.rim_acceleration, s, MANY)
    moved = (s["rim"] - s["w_f"]) * np.minimum(s["T"] / s["T_f"], 1)
    assert_same(after, {"w_f": s["w_f"] + moved})
    assert_same(told, {"a_w": moved / s["T"]})
    g = {"v": d.even(0, 3), "ready": d.bits()}
    _, _, told = values(slide_protection.protection_off, g, MANY)
    assert_same(told, {"off": (g["v"] < 5 / 3.6) | (g["ready"] == 0)})


def test_bits_and_states_of_one_s_own_are_whole_and_no_number_is_the_demand():
    given = np.array([[0.0], [0.49], [0.51], [1.0], [1.49], [1.51], [7.0], [-3.0], [np.nan]])
    bits = {"hold_by": given, "vent_by": given[::-1]}
    _, _, told = values(valve_control.whole_bits, bits, len(given))
    high = np.array([0, 0, 1, 1, 1, 1, 1, 0, 0.0])[:, None]
    assert_same(told, {"hold": high, "vent": high[::-1]})
    _, _, told = values(valve_control.whole_state, {"state_by": given}, len(given))
    assert_same(told, {"state": np.array([0, 0, 1, 1, 1, 2, 2, 0, 0.0])[:, None]})
    _, _, told = values(valve_control.valves_at_rest, {"T_cmd": given[:8]}, 8)
    assert_same(told, {"hold": 0, "vent": 0})
