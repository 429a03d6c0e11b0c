"""Brakes, pads and sensors at drawn points, against their rules over whole arrays."""

from __future__ import annotations

from math import erf

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl.models import brake_pads, brakes, sensors

MANY = 3000


def test_a_brake_follows_its_command_within_its_limits():
    d = Draw(MANY, 1)
    T_max = d.even(5e3, 9e3)
    s = {"T_b": d.even(0, 1) * T_max, "T_cmd": d.even(-0.4, 1.4) * T_max, "T_max": T_max}
    asked = np.clip(s["T_cmd"], 0, T_max)
    only = {k: s[k] for k in ("T_cmd", "T_max")}
    assert_same(values(brakes.brake(), only, MANY)[2], {"T_b": asked})
    s |= {"tau": d.even(0.03, 0.3)}
    rate = (asked - s["T_b"]) / s["tau"]
    assert_same(values(brakes.brake(lag=True), s, MANY)[1], {"T_b": rate})
    s |= {"R_max": d.even(2e3, 9e4)}
    _, change, told = values(brakes.brake(lag=True, rate=True), s, MANY)
    limited = np.clip(rate, -s["R_max"], s["R_max"])
    assert_same(change, {"T_b": limited})
    assert_same(told, {"R": limited})
    g = {"T_cmd": s["T_cmd"], "k": d.even(0.5, 2)}
    assert_same(values(brakes.brake_gain, g, MANY)[2], {"T": g["k"] * g["T_cmd"]})
    both = {"T_f": d.even(0, 9e3), "T_e": d.even(0, 5e3)}
    assert_same(values(brakes.sum_of_torques, both, MANY)[2], {"T_b": both["T_f"] + both["T_e"]})


def test_magnets_rub_while_they_lie_on_the_rails():
    d = Draw(MANY, 2)
    delay, T = d.even(0.5, 2), d.even(1e-3, 0.1)
    s = {"t": delay + d.even(-0.2, 0.1), "F_R": d.even(-2e3, 2e3), "v": d.even(-3, 30),
         "attraction": d.even(5e4, 2e5), "friction": d.even(0.1, 0.3), "fall": d.even(0, 0.1),
         "delay": delay, "above": d.even(3, 9), "T": T}  # fmt: skip
    _, after, told = values(brakes.track_brake, s, MANY)
    lies = (s["t"] + T / 2 >= delay) & (s["v"] > s["above"])
    rubs = lies * s["friction"] * s["attraction"] / (1 + s["fall"] * np.abs(s["v"]))
    assert_same(told, {"F_B": s["F_R"] + rubs})
    assert_same(after, {"t": s["t"] + T})
    assert 0.1 < lies.mean() < 0.9


def test_a_motor_brakes_within_its_torque_power_and_speeds():
    d = Draw(MANY, 3)
    T, pause, lost, top = d.even(1e-3, 0.1), d.even(0.5, 3), d.even(5, 9), d.even(3e3, 6e3)
    omega = d.one_of(d.even(-60, 60), d.even(-12, 12), 0.0)
    s = {"T_m": d.even(0, 1) * top, "t": d.one_of(lost + d.even(-0.1, 0.1), d.even(0, 5)),
         "rested": d.one_of(pause + d.even(-0.1, 0.1), 999.99, d.even(0, 9)),
         "T_cmd": d.even(-0.2, 1.4) * top, "omega": omega, "hold": d.bits(share=0.1),
         "vent": d.bits(share=0.1), "T_top": top, "P_top": d.even(3e4, 2e5),
         "tau_e": d.even(0.05, 0.3), "r": d.even(0.3, 0.6), "v_full": d.even(2, 4),
         "v_gone": d.even(0.3, 1.5), "pause": pause, "lost": lost, "T": T}  # fmt: skip
    _, after, told = values(brakes.dynamic_brake, s, MANY)
    rim = s["r"] * np.abs(omega)
    fade = np.clip((rim - s["v_gone"]) / (s["v_full"] - s["v_gone"]), 0, 1)
    most = fade * np.minimum(top, s["P_top"] / np.maximum(np.abs(omega), 1e-3))
    acted = (s["hold"] == 1) | (s["vent"] == 1)
    rested = np.where(acted, 0, s["rested"])
    works = (s["t"] + T / 2 < lost) & (rested + T / 2 >= pause) & ~acted
    goal = np.where(works, np.clip(s["T_cmd"], 0, most), 0)
    torque = goal + np.exp(-T / s["tau_e"]) * (s["T_m"] - goal)
    assert_same(after, {"T_m": torque, "t": s["t"] + T, "rested": np.minimum(rested + T, 1e3)})
    assert_same(told, {"T_e": s["T_m"], "T_f": np.maximum(s["T_cmd"] - s["T_m"], 0)})
    assert 0.1 < works.mean() < 0.9
    slow = {"omega": 1e-4, "r": 1.0, "v_full": 2e-4, "v_gone": 0.0, "T_top": 1e6, "P_top": 7.0,
            "T_cmd": 1e6, "tau_e": 1e-3, "T": 0.1, "t": 0.0, "rested": 9.0}  # fmt: skip
    found = values(brakes.dynamic_brake, slow, 1)[1]
    assert found["T_m"] == pytest.approx(0.5 * 7.0 / 1e-3)  # power at a milliradian at least


def friction(N, V, mu_0, by_V, by_N, by_N2, iron):
    """Of a force of one block in kN and km/h, as the module's text has it."""
    cast = 0.6 * (1.6 * N + 100) / (8 * N + 100) * (V + 100) / (5 * V + 100)
    return mu_0 + by_V * V + by_N * N + by_N2 * N**2 + iron * cast


def test_pads_grip_by_force_speed_and_heat():
    d = Draw(MANY, 4)
    s = {"theta": d.even(0, 500), "T": d.even(-2e3, 1e4), "omega": d.even(-60, 60),
         "mu_n": d.even(0.2, 0.4), "blocks": np.floor(d.even(2, 9)), "r_f": d.even(0.2, 0.5),
         "r_w": d.even(0.4, 0.5), "mu_0": d.even(0.1, 0.4), "by_V": d.even(-4e-3, 1e-3),
         "by_N": d.even(-0.01, 0.01), "by_N2": d.even(-1e-3, 1e-3), "iron": d.bits(),
         "spread": d.even(0.5, 1.5), "fade": d.even(0, 8e-3), "theta_f": d.even(100, 400),
         "C": d.even(2e3, 9e4), "k": d.even(0, 90), "T_": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = values(brake_pads.pad, s, MANY)
    N = np.abs(s["T"]) / s["mu_n"] / s["r_f"] / s["blocks"] / 1e3
    V = 3.6 * s["r_w"] * np.abs(s["omega"])
    mu = friction(N, V, *(s[k] for k in ("mu_0", "by_V", "by_N", "by_N2", "iron"))) * s["spread"]
    mu = np.maximum(mu, 0) * np.clip(1 - s["fade"] * np.maximum(s["theta"] - s["theta_f"], 0), 0, 1)
    torque = s["T"] * mu / s["mu_n"]
    heat = np.abs(torque * s["omega"]) - s["k"] * s["theta"]
    assert_same(told, {"T_b": torque, "mu_pad": mu})
    assert_same(after, {"theta": np.maximum(s["theta"] + s["T_"] / s["C"] * heat, 0)})


@pytest.mark.parametrize(("material", "wanted"), [
    ("cast_iron", friction(12.0, 72.0, 0, 0, 0, 0, 1)), ("composite", 0.3 - 0.00081 * 72),
    ("cosid", 0.27), ("disc", 0.2375 + 0.000885 * 12 - 0.000345 * 144),
])  # fmt: skip
def test_friction_of_each_material_is_that_of_its_formula(material, wanted):
    for way in (20.0, -20.0):
        assert brake_pads.friction(material, 12e3, way) == pytest.approx(wanted)


# ---- sensors -------------------------------------------------------------------------------------


def test_a_tooth_wheel_times_its_edges():
    d = Draw(MANY, 5)
    N, T, clock = np.floor(d.even(20, 120)), d.even(5e-4, 5e-3), d.even(1e-6, 2e-4)
    q, step = d.even(0, 900), d.one_of(d.even(0, 5), d.even(0, 0.9))
    s = {"q": q, "edge": np.floor(q) - d.one_of(0, 0, 1), "age": d.even(0, 1) * T,
         "omega_h": d.even(0, 60), "phi": (q + step) * 2 * np.pi / N, "jitter": d.even(-2, 2),
         "N": N, "clock": clock, "sigma": d.even(0, 3e-4), "T": T}  # fmt: skip
    _, after, told = values(sensors.tooth_wheel, s, MANY)
    now = q + step
    tooth = np.floor(s["phi"] * N / (2 * np.pi))
    seen = tooth > s["edge"]
    since = T * (now - tooth) / np.maximum(step, 1e-12)
    pulses = (since + s["sigma"] * s["jitter"]) / clock
    since = np.clip(clock * np.floor(pulses), 0, T)
    gap = np.maximum(s["age"] + T - since, clock)
    fresh = 2 * np.pi * (tooth - s["edge"]) / N / gap
    silent = np.minimum(s["omega_h"], 2 * np.pi / N / np.maximum(s["age"] + T, clock))
    omega = np.where(seen, fresh, silent)
    keep = (np.abs(pulses - np.round(pulses)) > 1e-6)[:, 0]  # not at an edge of the clock
    assert keep.mean() > 0.9
    wanted = {"q": now, "edge": np.where(seen, tooth, s["edge"]), "omega_h": omega,
              "age": np.where(seen, since, s["age"] + T)}  # fmt: skip
    assert_same({n: k[keep] for n, k in after.items()}, {n: k[keep] for n, k in wanted.items()},
                rtol=1e-6)  # fmt: skip
    assert_same({"omega_m": told["omega_m"][keep]}, {"omega_m": omega[keep]}, rtol=1e-6)
    assert 0.1 < seen.mean() < 0.9
    start = sensors.tooth_wheel.with_params(phi_start=3.0, N=70.0, T=0.02, omega_start=9.0).start()
    teeth = 3.0 * 70 / (2 * np.pi)
    assert start == {"q": pytest.approx(teeth), "edge": pytest.approx(teeth), "age": -0.02,
                     "omega_h": 9.0}  # fmt: skip


def test_readings_have_noise_steps_and_losses():
    d = Draw(MANY, 6)
    s = {"last": d.even(0, 9), "u": d.even(0, 9), "n": d.even(-2, 2), "luck": d.even(-2, 2),
         "sigma": d.even(0, 0.5), "q": d.one_of(0, d.even(0.1, 0.5)),
         "lost": d.even(0, 0.6)}  # fmt: skip
    _, after, told = values(sensors.noisy_sensor("m/s"), s, MANY)
    value = s["u"] + s["sigma"] * s["n"]
    whole = np.where(s["q"] > 0, s["q"], 1)
    stepped = np.where(s["q"] > 0, whole * np.floor(value / whole + 0.5), value)
    share = (1 + np.vectorize(erf)(s["luck"] / np.sqrt(2))) / 2
    read = np.where(share < s["lost"], s["last"], stepped)
    assert_same(after, {"last": read})
    assert_same(told, {"y": read})
    small = {"n": s["n"], "sigma": s["sigma"]}
    for block, unit in ((sensors.speed_sensor, "v"), (sensors.adhesion_sensor, "mu")):
        found = values(block, small | {unit: s["u"]}, MANY)[2]
        assert_same(found, {f"{unit}_m": value})
    t = {"angle": d.even(0, 9), "omega_h": d.even(0, 9), "begun": d.bits(), "omega": d.even(0, 9),
         "T": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = values(sensors.turned, t, MANY)
    angle = t["angle"] + t["begun"] * t["T"] * (t["omega_h"] + t["omega"]) / 2
    assert_same(after, {"angle": angle, "omega_h": t["omega"], "begun": 1})
    assert_same(told, {"phi": angle})
    v = {"v": d.even(0, 30), "omega": d.even(0, 60), "r": d.even(0.3, 0.6)}
    assert_same(values(sensors.slip_sensor, v, MANY)[2], {"v_s": v["v"] - v["r"] * v["omega"]})


def test_each_sensor_fails_in_its_way_from_its_time():
    d, kinds = Draw(MANY, 7), ("jumps", "", "frozen", "missing")
    s = {"t": d.even(0, 9), "last": d.even(0, 60, 4), "u": d.even(0, 60, 4),
         "begin": d.even(0, 9, 4), "share": d.even(-0.5, 2, 4), "T": d.even(1e-3, 0.1)}  # fmt: skip
    _, after, told = values(sensors.wheel_sensors_with_faults(4, kinds), s, MANY)
    wrong = s["u"].copy()
    wrong[:, 0] *= 1 + s["share"][:, 0]
    wrong[:, 2], wrong[:, 3] = s["last"][:, 2], 0
    read = np.where(s["t"] >= s["begin"], wrong, s["u"])
    assert_same(told, {"y": read})
    assert_same(after, {"t": s["t"] + s["T"], "last": read})


@pytest.mark.parametrize("torque", ["held", "sampled"])
@pytest.mark.parametrize("window", [1, 2, 5])
@pytest.mark.parametrize("noise", [True, False])
def test_a_meter_of_adhesion_has_the_means_of_its_window(torque, window, noise):
    d = Draw(300, 8)
    s = {"omegas": d.even(30, 60, window), "torques": d.even(0, 9e3, window),
         "slips": d.even(0, 2, window), "omega": d.even(30, 60), "T_b": d.even(0, 9e3),
         "v_s": d.even(0, 2), "m": d.even(5e3, 9e3), "J": d.even(60, 160), "r": d.even(0.3, 0.6),
         "g": d.even(9, 10.5), "T": d.even(1e-3, 0.1)}  # fmt: skip
    s |= {"n": d.even(-2, 2), "sigma": d.even(0, 0.1)} if noise else {}
    _, after, told = values(sensors.adhesion_meter(window, torque, noise), s, 300)
    torques, slips, omegas = (
        np.concatenate([s[k], s[now]], axis=1)
        for k, now in (("torques", "T_b"), ("slips", "v_s"), ("omegas", "omega"))
    )
    force = np.trapezoid(torques, axis=1) if torque == "sampled" else torques[:, :-1].sum(axis=1)
    rise = (s["omega"] - omegas[:, :1]) / (window * s["T"])
    mu = (s["J"] * rise + force[:, None] / window) / (s["r"] * s["m"] * s["g"])
    mean = np.trapezoid(slips, axis=1)[:, None] / window
    assert_same(told, {"mu_m": mu + (s["sigma"] * s["n"] if noise else 0), "v_s_m": mean})
    assert_same(after, {"omegas": omegas[:, 1:], "torques": torques[:, 1:], "slips": slips[:, 1:]})
