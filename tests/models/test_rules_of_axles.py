"""A step of a train at drawn points: its equations with what it gives, force by force."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import Input, Output, Param, law
from slipctl.models.wheel_rail.axle_forces import standing_forces
from slipctl.models.wheel_rail.axles import Axles, rolling

MANY, H = 300, 2e-3
AXLES = Axles((2, 1, 3), (0.0, 3.1, 9.7), (True, False, True))
COUNT = np.array([2, 1, 3])


@law(mu=Output("1", "adhesion", positive="traction"))
def curve(
    v_s=Input("m/s", "creep", positive="traction", per="speed"),
    v=Input("m/s", "train speed"),
    wet=Input("1", "what lies on the rail", value=0.0),
    top=Param("1", 0.3, "height", "test", lo=0.01, hi=1),
    bend=Param("m/s", 0.5, "slip of the peak", "test", lo=0.01, hi=5),
    fall=Param("s/m", 0.01, "fall by the speed", "test", lo=0, hi=1),
):
    """Odd, with its peak at a slip of ``bend``."""
    return 2 * top * (1 - wet) * v_s * bend / (v_s**2 + bend**2) / (1 + fall * ca.fabs(v))


CURVE = curve.with_conditions(dry={"top": 0.3}, ice={"top": 0.05})


def adhesion(s, creep, v):
    height = 2 * s["adh.top"] * (1 - s["wet"]) / (1 + s["adh.fall"] * np.abs(v))
    return height * creep * s["adh.bend"] / (creep**2 + s["adh.bend"] ** 2)


def drawn(seed, standing):
    d, n = Draw(MANY, seed), 3
    m, g, v = d.even(5e4, 9e4), d.even(9, 10.5), d.even(3, 30)
    share, r = d.even(0.12, 0.2, n), d.even(0.4, 0.6, n)
    load = m * share * g
    rim = d.one_of(*[v + d.even(-1, 1, n)] * 5, d.even(0, 0.2, n))
    s = {"x": d.even(0, 900), "v": v, "omega": rim / r,
         "T_b": d.one_of(d.even(0, 0.4, n), d.even(0, 1, n)) * load * r * 0.3,
         "F_d": d.even(-9e3, 2e4), "wet": d.even(0, 0.5, n), "dN": d.even(-0.2, 0.2, n) * load,
         "T": d.even(0, 0.5, 2) * (load * r)[:, [0, 2]] * 0.3, "m": m, "share": share,
         "J": d.even(60, 160, n), "B_t": d.even(0, 3, n), "r": r, "g": g,
         "braked": d.even(0.5, 1.2, n), "adh.top": d.even(0.1, 0.4, n),
         "adh.bend": d.even(0.3, 2), "adh.fall": d.even(0, 0.05)}  # fmt: skip
    s |= {"m_axle": m * share}
    return s | ({"F_m": d.even(-1e3, 4e3), "F_h": d.even(0, 3e3)} if standing else {})


def train(standing):
    apart = ("r", "T_b", "share", "dN")
    return rolling(CURVE, AXLES, H, apart=apart, standing=standing).with_params(m=6e4)


def scattered(T):
    return np.stack([T[:, 0], np.zeros(len(T)), T[:, 1]], axis=1)


@pytest.mark.parametrize("standing", [False, True])
def test_a_step_keeps_the_momentum_of_the_train_and_of_each_axle(standing):
    s = drawn(1, standing)
    _, after, told = values(train(standing), s, MANY)
    v, omega, r, m = s["v"], s["omega"], s["r"], s["m"]
    F, N, T = told["F"], np.maximum(m * s["share"] * s["g"] + s["dN"], 1), scattered(s["T"])
    assert (told["residual"] <= 1e-7 * N.max(axis=1, keepdims=True)).all()
    both = (COUNT * F).sum(axis=1, keepdims=True)
    a = (both - s["F_d"]) / m
    new = v + H * a
    mean_v, turned = (v + new) / 2, after["omega"]
    assert_same({"x": after["x"], "v": after["v"]}, {"x": s["x"] + H * mean_v, "v": new})
    stop = s["braked"] * s["T_b"]
    taken = s["J"] * (omega - turned) / H + T - r * F - s["B_t"] * turned
    locked = turned == 0
    assert np.abs(taken - stop)[~locked].max() < 1e-5  # J omega' = T - T_b - r F - B omega
    held = s["J"] * omega / H + T - r * F
    assert (np.abs(held) <= stop * (1 + 1e-9))[locked].all()
    force = N * adhesion(s, r * turned - new, v)  # at the creep at the end, the speed at the begin
    assert (np.abs(F - force) / N)[~locked].max() < 5e-7
    assert ((np.abs(F) - np.abs(force)) / N)[locked].max() < 5e-7
    assert 0 < locked.mean() < 0.5
    taken = np.where(locked, held, stop)
    mean, slip = (omega + turned) / 2, r * omega - v
    wanted = {
        "v_s": slip, "mu": F / N, "F": F, "F_all": both, "a": a,
        "v_s_max": slip.max(axis=1, keepdims=True), "v_s_min": slip.min(axis=1, keepdims=True),
        "F_rim": (COUNT * (T - taken) / r).sum(axis=1, keepdims=True),
        "residual": told["residual"], "omega_d": omega[:, [0, 2]],
        "P_contact": COUNT * F * (r * mean - mean_v), "way": H * mean_v,
        "at": s["x"] - np.array([0.0, 3.1, 9.7]), "P_d": s["F_d"] * mean_v,
    }  # fmt: skip
    powers = {"P_drive": T * mean, "P_brake": taken * mean,
              "P_bearing": s["B_t"] * turned * mean, "P_slip": F * (r * mean - mean_v)}  # fmt: skip
    wanted |= {n: (COUNT * k).sum(axis=1, keepdims=True) for n, k in powers.items()}
    if standing:
        energy = (COUNT * s["J"] * omega**2).sum(axis=1, keepdims=True) / 2
        wanted["E_kin"] = m * v**2 / 2 + energy
    assert_same(told, wanted, rtol=1e-7, atol=1e-6)


def test_a_train_stands_where_brakes_and_rail_hold_it_and_starts_where_they_do_not():
    """v = 0: what holds is a friction of brakes, rail and resistance, each within its largest."""
    s = drawn(2, True)
    d = Draw(MANY, 3)
    s |= {"v": np.zeros((MANY, 1)), "omega": np.zeros((MANY, 3)), "F_m": np.zeros((MANY, 1)),
          "F_d": d.even(-8e4, 8e4)}  # fmt: skip
    _, after, told = values(train(True), s, MANY)
    N, T = np.maximum(s["m"] * s["share"] * s["g"] + s["dN"], 1), scattered(s["T"])
    rail = N * s["adh.top"] * (1 - s["wet"])  # its peak, at a slip of bend
    hold, push = s["braked"] * s["T_b"] / s["r"], T / s["r"]
    low, high = np.maximum(push - hold, -rail * 0.999), np.minimum(push + hold, rail * 0.999)
    reach = [(COUNT * k).sum(axis=1, keepdims=True) for k in (low, high)]
    inside = (high > low).all(axis=1, keepdims=True)
    inside &= (reach[0] - s["F_h"] < s["F_d"] - 50) & (s["F_d"] + 50 < reach[1] + s["F_h"])
    stands = (after["v"] == 0) & (after["omega"] == 0).all(axis=1, keepdims=True)
    assert stands[inside].all()
    wide = [(COUNT * k).sum(axis=1, keepdims=True) for k in (
        np.maximum(push - hold, -rail), np.minimum(push + hold, rail))]  # fmt: skip
    beyond = (s["F_d"] < wide[0] - s["F_h"] - 50) | (s["F_d"] > wide[1] + s["F_h"] + 50)
    assert not stands[beyond].any()
    assert 0.2 < inside.mean() < 0.9
    assert 0.1 < beyond.mean() < 0.8
    at_rest = stands[:, 0]
    assert (told["residual"][at_rest] == 0).all()
    assert (told["a"][at_rest] == 0).all()
    F = told["F"][at_rest]
    assert (np.abs(F) <= rail[at_rest] * 1.001).all()
    assert (np.abs(F - push[at_rest]) <= hold[at_rest] + 1e-6).all()
    both = (COUNT * F).sum(axis=1)
    assert (np.abs(both - s["F_d"][at_rest, 0]) <= s["F_h"][at_rest, 0] + 1e-6).all()


@pytest.mark.parametrize(("need", "rests", "stands"), [
    (0.0, 0.0, True), (-31.1, 0.0, False), (-30.9, 0.0, True), (-32.9, 2.0, True),
    (-33.1, 2.0, False), (70.1, 0.0, False), (69.9, 0.0, True), (71.9, 2.0, True),
    (72.1, 2.0, False),
])  # fmt: skip
def test_forces_of_a_stand_share_what_is_needed(need, rests, stands):
    """Ends of the axles, by hand: -7 to 9, -5 to 13, -4 to 13; two, one and three of each."""
    push, hold, most = np.array([1.0, 4.0, 9.0]), np.array([8.0, 9.0, 13.0]), [11.0, 20.0, 13.0]
    found, F = standing_forces(*map(ca.DM, (push, hold, most)), need, ca.DM(COUNT), rests)
    low, high = np.array([-7.0, -5.0, -4.0]), np.array([9.0, 13.0, 13.0])
    part = np.clip((need + 31) / 101, 0, 1)
    assert F.full().ravel() == pytest.approx(low + part * (high - low))
    assert bool(found) == stands


def test_a_wheel_that_neither_rail_nor_brake_can_hold_forbids_a_stand():
    push, hold, count = ca.DM([1.0, 30.0, 2.0]), ca.DM([8.0, 3.0, 4.0]), ca.DM(COUNT)
    assert not standing_forces(push, hold, ca.DM([9, 20, 9]), 20.0, count, 1e3)[0]
    assert standing_forces(push, hold, ca.DM([9, 27, 9]), 20.0, count, 1e3)[0]


def test_driven_axles_and_the_others_are_one_each_where_they_do_the_same():
    grouped = AXLES.grouped()
    assert grouped == Axles((5, 1), (0.0, 0.0), (True, False))
    assert Axles((2, 2), (0.0, 3.0), (False, False)).grouped() == Axles((4,), (0.0,), (False,))
    assert AXLES.motors == (0, 2)
    assert len(AXLES) == 3
