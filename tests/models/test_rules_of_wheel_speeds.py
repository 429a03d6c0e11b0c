"""Blocks that make a vehicle's speed of its wheels, at drawn points, against their rules."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl.models.vehicle import wheels
from slipctl.models.vehicle.measurement import fused_speed

MANY = 3000


def widest(rows):
    return rows.max(axis=1, keepdims=True)


def test_known_radii_bring_speeds_to_one_radius():
    d, n = Draw(MANY, 1), 3
    s = {"omega": d.even(0, 60, n), "r": d.even(0.3, 0.6), "worn": d.even(0.8, 1.2, n)}
    _, _, told = values(wheels.known_radii(n), s, MANY)
    assert_same(told, {"omega_n": s["omega"] * s["worn"], "r_i": s["r"] * s["worn"]})


def test_radii_are_learnt_while_all_is_calm():
    d, n = Draw(MANY, 2), 3
    r, worn, load, g = (d.even(0.3, 0.6), d.even(0.95, 1.05, n), d.even(5e3, 9e3),
                        d.even(9, 10.5))  # fmt: skip
    light, moves, spread, T = (
        d.even(0.02, 0.05),
        d.even(0.003, 0.02),
        d.even(0.05, 0.2),
        d.even(1e-3, 0.2),
    )
    v = d.one_of(d.even(10, 30), d.even(2, 5))
    slow = 1 + d.even(-0.08, 0.08, n)
    s = {"ratio": 1 + d.even(-0.2, 0.2, n), "quick": slow + d.even(-0.01, 0.01, n), "slow": slow,
         "taught": d.one_of(d.even(0, 0.03), d.even(0, 6)),
         "calm": d.one_of(d.even(-3, 3), d.even(-60, 60), 1e6, np.floor(d.even(-3, 2))),
         "omega": v / (r * worn) * (1 + d.even(-0.02, 0.02, n)),
         "torque": d.even(-1.1, 1.1, n) * light * r * load * g, "reset": d.bits(share=0.1), "r": r,
         "worn": worn, "light": light, "m_axle": load, "g": g, "v_least": d.even(2, 4),
         "moves": moves, "spread": spread, "wait": d.even(1, 3), "fade": d.even(3, 6),
         "tau_q": d.even(0.02, 0.1), "tau_s": d.even(0.2, 0.9), "T": T}  # fmt: skip
    _, after, told = values(wheels.learnt_radii(n), s, MANY)
    rims = r * worn * s["omega"]
    fast = (rims > s["v_least"]).all(axis=1, keepdims=True)
    now = np.where(fast, rims.mean(axis=1, keepdims=True) / rims, s["ratio"])
    first = 1 / (1 + np.maximum(s["calm"], 0))  # of a mean that began with the calm
    quick, slow = (s[k] + np.maximum(first, np.minimum(T / s[tau], 1)) * (now - s[k])
                   for k, tau in (("quick", "tau_q"), ("slow", "tau_s")))  # fmt: skip
    easy = fast & (widest(np.abs(quick - slow)) <= moves)
    easy &= widest(np.abs(s["torque"])) <= light * r * load * g
    learns = easy & (s["calm"] >= 0)
    taught = np.where(learns, np.minimum(s["taught"] + T, s["fade"]), s["taught"])
    share = np.where(learns, T / np.maximum(taught, T), 0)
    ratio = s["ratio"] + share * (now - s["ratio"])
    ratio = np.clip(ratio, 1 - spread, 1 + spread)
    anew = s["reset"] == 1
    ratio, taught = np.where(anew, 1, ratio), np.where(anew, 0, taught)
    calm = np.where(easy, np.minimum(s["calm"] + 1, 1e6), -s["wait"] / T)
    assert_same(after, {"ratio": ratio, "quick": quick, "slow": slow, "taught": taught,
                        "calm": np.where(anew, 0, calm)})  # fmt: skip
    assert_same(told, {"omega_n": s["omega"] * worn * ratio, "r_i": r * worn * ratio,
                       "learns": learns, "known": taught >= 0.0195})  # fmt: skip
    assert 0.05 < learns.mean() < 0.95
    assert 0.05 < fast.mean() < 0.95


@pytest.mark.parametrize("driven", [False, True])
def test_the_speed_by_wheels_goes_on_by_momentum_within_its_bound(driven):
    d, n, side = Draw(MANY, 3), 3, -1 if driven else 1
    T, r, m, J, v = (d.even(1e-3, 0.1), d.even(0.3, 0.6), d.even(2e4, 6e4), d.even(60, 160),
                     d.even(2, 30))  # fmt: skip
    omega = (v + d.even(-1, 1, n) * d.one_of(0.05, 1)) / r
    s = {"v_h": v, "wheel": omega.mean(axis=1, keepdims=True) * n * J / (r * m) + d.even(-0.1, 0.1),
         "grown": d.one_of(0, d.even(0, 2)), "since": d.one_of(0, d.even(0, 0.2)),
         "omega": omega, "torque": d.even(-2e3, 9e3, n), "m": m, "J": J, "r": r,
         "a_max": d.even(0.3, 2), "margin": d.even(0.1, 0.3), "beside": d.even(0.1, 0.3),
         "band": d.even(0.3, 0.6), "most": d.even(1, 2), "catch": d.even(0.01, 0.1),
         "noise": d.even(0.05, 0.2), "trust": d.even(1, 3), "T": T}  # fmt: skip
    _, after, told = values(wheels.bounded_speed(n, driven), s, MANY)
    pull = np.maximum(s["torque"].sum(axis=1, keepdims=True) / r / m, 0)
    held = J / r / m * omega.sum(axis=1, keepdims=True)
    fall = np.minimum(s["a_max"], s["beside"] + (1 + s["margin"]) * pull)
    line = v - side * T * fall + s["wheel"] - held
    best = r * (omega.min(axis=1, keepdims=True) if driven else widest(omega))
    lead = side * (best - line)
    since = np.where(lead < 0, s["since"] + T, 0)
    gain = np.maximum(lead, 0) * np.minimum(T / s["catch"], 1)
    surer = np.maximum((1 - T / s["trust"]) * s["grown"] - gain, 0)
    wider = s["grown"] + 2 * T * (s["margin"] * pull + s["beside"])
    grown = np.where(since > s["noise"], wider, surer)
    new = line + side * gain
    assert_same(after, {"v_h": new, "wheel": held, "grown": grown, "since": since})
    error = s["band"] + grown
    assert_same(told, {"v_m": new, "error": error, "sound": error <= s["most"]})
    start = wheels.bounded_speed(n, driven).with_params(v_start=21.0, J=130.0, r=0.4, m=2e4)
    assert start.start()["wheel"] == pytest.approx(21.0 * n * 130.0 / (0.4**2 * 2e4))


# ---- with an accelerometer -----------------------------------------------------------------------


def test_an_accelerometer_reads_acceleration_and_slope_a_tick_late():
    d = Draw(MANY, 4)
    s = {"a_h": d.even(-2, 2), "a": d.even(-2, 2), "n": d.even(-2, 2), "bias": d.even(-1, 1),
         "sigma": d.even(0, 1), "feels": d.bits(), "slope": d.even(-0.05, 0.05),
         "g": d.even(9, 10.5)}  # fmt: skip
    _, after, told = values(fused_speed.accelerometer(), s, MANY)
    slope = s["feels"] * s["g"] * s["slope"]
    assert_same(told, {"a_m": s["a_h"] + slope + s["bias"] + s["sigma"] * s["n"]})
    assert_same(after, {"a_h": s["a"]})


def test_the_largest_wheel_leaves_the_truth_by_what_it_cannot_have_lost():
    d, n = Draw(MANY, 5), 3
    v, T, a, r = d.even(5, 20), d.even(1e-3, 0.2), d.even(1, 3), d.even(0.3, 0.6)
    s = {"v_h": v, "blind": d.one_of(d.even(0, 0.5), d.even(0, 2), 499.9),
         "omega": (v - a * T + d.even(-0.6, 0.3, n)) / r, "a_max": a, "r": r,
         "band": d.even(0.3, 0.6), "most": d.even(1, 3), "T": T}  # fmt: skip
    _, after, told = values(fused_speed.largest_wheel(n), s, MANY)
    free, best = v - a * T, r * widest(s["omega"])
    made_good = np.maximum(s["blind"] - (best - free), 0)
    blind = np.where(best > free, made_good, np.minimum(s["blind"] + a * T, 500))
    assert_same(after, {"v_h": np.maximum(best, free), "blind": blind})
    error = s["band"] + blind
    assert_same(told, {"v_m": np.maximum(best, free), "error": error, "sound": error <= s["most"]})


def test_each_axle_speaks_with_the_weight_that_its_slip_leaves_it():
    d, n = Draw(2 * MANY, 6), 3
    v, r, T, load, g, free = (d.even(5, 30), d.even(0.3, 0.6), d.even(1e-3, 0.15),
                              d.even(5e3, 9e3), d.even(9, 10.5), d.even(0.005, 0.03))  # fmt: skip
    creep, sigma, P, a, b = (d.even(0.005, 0.03), d.even(0.02, 0.1),
                             d.one_of(d.even(0, 0.05), -0.01), d.even(-2, 2),
                             d.even(-0.5, 0.5))  # fmt: skip
    T_f, apart = d.even(0.05, 0.2), d.even(0.3, 1)
    near, slow = 3 * np.sqrt(np.maximum(P, 0) + sigma**2), creep * v
    beside = d.one_of(d.even(-1.2, 1.2, n) * (near + slow),
                      d.even(0.8, 1.1, n) * (2 * near + slow + 0.5))  # fmt: skip
    rim, rate = v + beside, a - b + d.even(-1.2, 1.2, n) * apart
    moved = rate * T
    s = {"w_f": rim - moved / np.minimum(T / T_f, 1), "light": d.one_of(d.even(0, 0.6, n), 99.99),
         "held_h": d.bits(n), "omega": rim / r,
         "torque": d.even(-1.2, 1.2, n) * free * r * load * g,
         "held": d.bits(n), "a": a, "v": v, "b": b, "P": P, "sigma": sigma, "creep": creep,
         "free": free, "settled": d.even(0.2, 0.5), "apart": apart, "T_f": T_f, "m_axle": load,
         "g": g, "r": r, "T": T}  # fmt: skip
    _, after, told = values(fused_speed.axle_weights(n), s, 2 * MANY)
    light = np.where(np.abs(s["torque"]) <= free * r * load * g,
                     np.minimum(s["light"] + T, 100), 0)  # fmt: skip
    assert_same(after, {"w_f": s["w_f"] + moved, "light": light, "held_h": s["held"]})
    steady = np.abs(rate - (a - b)) <= apart
    runs = (light >= s["settled"]) | ((beside > 0) & (beside <= 2 * near + slow + 0.5))
    agrees = (s["held_h"] == 0) & (np.abs(beside) <= near + slow)
    w = steady * np.where(runs, 1, agrees * sigma / (sigma + slow))
    mean = (w**2 * rim).sum(axis=1, keepdims=True)
    mean = mean / np.maximum((w**2).sum(axis=1, keepdims=True), 1e-12)
    assert_same(told, {"weight": widest(w), "z": widest(w) * mean})
    for case in (steady, runs, agrees, w == 0):
        assert 0.05 < case.mean() < 0.95


def test_the_bound_is_three_deviations_creep_and_noise():
    d = Draw(MANY, 7)
    s = {"v": d.even(-30, 30), "P": d.even(-0.05, 0.3), "creep": d.even(0.005, 0.03),
         "band": d.even(0.05, 0.2), "most": d.even(1, 2)}  # fmt: skip
    _, _, told = values(fused_speed.speed_with_bound, s, MANY)
    error = 3 * np.sqrt(np.maximum(s["P"], 0)) + s["creep"] * np.abs(s["v"]) + s["band"]
    assert_same(told, {"v_m": s["v"], "error": error, "sound": error <= s["most"]})
    m = {"v": d.even(0, 9), "b": d.even(-1, 1), "a": d.even(-1, 1), "weight": d.even(0, 1)}
    _, rate, told = values(fused_speed.motion, m, MANY)
    assert_same(rate, {"v": m["a"] - m["b"], "b": 0})
    assert_same(told, {"z": m["weight"] * m["v"]})


def test_the_filter_of_wheels_and_accelerometer_is_a_kalman_filter():
    """Two wheels that roll free speak as loud as one; by matrices of two numbers."""
    spread, wander, noise, T = 0.3, 0.5, 0.4, 0.02  # wander is by second
    block = fused_speed.fused_speed(2, spread, wander, noise, T, 17.0)
    p = block.param_values() | {"T": T, "r": 0.4}
    assert (p["filter.floor_v"], p["filter.floor_b"]) == (1e-4, 1e-8)
    free = {"axles.w_f": [17.02, 17.02], "axles.light": [1.0, 1.0]}
    x, p = block.pack("state", block.start() | free), block.pack("param", p)
    R, Q = 0.05**2 / T, np.diag([(noise**2 + 1e-6) * T**2, wander**2 * T])  # by sample
    F, P, state = np.array([[1, -T], [0, 1.0]]), np.diag([0.04, spread**2]), np.array([17.0, 0.0])
    for k, rim in enumerate((17.02, 17.05, 17.03)):
        if k:
            state, P = F @ state + [T * 0.5, 0], F @ P @ F.T + Q
        K = P[:, :1] / (P[0, 0] + R)
        state, P = state + K[:, 0] * (rim - state[0]), P - K @ P[:1]
        u = dict(omega=[rim / 0.4] * 2, torque=[0.0, 0.0], controlled=[0.0, 0.0], a=0.5)
        x, y = block.f(x, block.pack("input", u), p)
        told = {n: float(k) for n, k in block.unpack("output", y).items()}
        assert told["axles.weight"] == 1
        assert (told["v_m"], told["filter.b"]) == pytest.approx(tuple(state), abs=1e-9)
        bound = 3 * np.sqrt(P[0, 0]) + 0.01 * state[0] + 0.1
        assert told["error"] == pytest.approx(bound, rel=1e-9)
