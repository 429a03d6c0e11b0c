"""What axles of a train see, plan and seek, at drawn points, against their rules.

Both curves of the rail are a h e/(e + b) less by their speed, so that each number of each matters.
"""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import Input, Output, Param, law
from slipctl.models.vehicle.slip.rail_seen import rail_seen
from slipctl.models.vehicle.slip.train_plan import train_plan
from slipctl.models.vehicle.slip.train_slip import train_slip

NODES = np.linspace(0, 1, 17)


@law(mu=Output("1", "adhesion", positive="traction"))
def curve(
    v_s=Input("m/s", "creep", positive="traction", per="speed"),
    v=Input("m/s", "speed"),
    h=Param("1", 0.1, "height", "test"),
    b=Param("1", 0.01, "bend", "test"),
    fall=Param("s/m", 0.01, "fall", "test"),
):
    """Odd in the creep."""
    e = v_s / v
    return h * e / ((e**2) ** 0.5 + b + e**2) / (1 + fall * v)


LAYER, CLEAN = curve.with_params(h=0.05, b=0.03), curve.with_params(h=0.25, b=0.02)


def height(p, which, e, v):
    h, b, fall = (p[f"{which}_{n}"] for n in ("h", "b", "fall"))
    return h * e / (e + b + e**2) / (1 + fall * v)


def of_curves(d):
    return {"layer_h": d.even(0.03, 0.08), "layer_b": d.even(0.02, 0.05),
            "layer_fall": d.even(0.005, 0.02), "clean_h": d.even(0.1, 0.4),
            "clean_b": d.even(0.01, 0.03), "clean_fall": d.even(0.005, 0.03)}  # fmt: skip


def roots(slip, many):
    """Roots of the ratios: even steps from that of a thousandth to that of the largest slip."""
    low = np.sqrt(1e-3)
    return low + np.arange(many) * (np.sqrt(slip) - low) / (many - 1)


def cleaned(q, rate, f, e):
    return 1 - (1 - q) * np.exp(-rate * f * e)


def interpolated(x, columns):
    """Value at x between the nodes; of each point its own row of values."""
    at = np.clip(x * 16, 0, 16)
    k = np.minimum(np.floor(at).astype(int), 15)
    low = np.take_along_axis(columns, k, axis=1)
    return low + (at - k) * (np.take_along_axis(columns, k + 1, axis=1) - low)


@pytest.mark.parametrize("learn", [False, True])
@pytest.mark.parametrize("plan", [False, True])
def test_an_axle_learns_its_share_and_seeks_the_best_slip(plan, learn):
    many = 150
    d = Draw(many, 1)
    v = d.one_of(d.even(3, 30), d.even(-0.9, 0.9), d.even(-30, -3))
    s = of_curves(d) | {
        "product": d.one_of(d.even(0, 0.02), d.even(-1e-5, 2e-5)),
        "square": d.one_of(d.even(0.005, 0.03), d.even(0, 2e-5)), "e": d.even(0.01, 0.3),
        "begun": d.bits(), "v": v, "mu": d.even(0, 0.2), "v_s": np.abs(v) * d.even(-0.02, 0.2),
        "slip": d.even(0.1, 0.5), "least": d.even(0.1, 0.4), "T_f": d.even(0.2, 1),
        "T_e": d.even(0.05, 0.4), "T": d.even(1e-3, 0.3),
    }  # fmt: skip
    if plan:
        rising = np.sort(d.even(0.1, 0.9, 17), axis=1)
        s |= {"value": rising, "rate": d.even(0, 60)}
    else:
        s |= {"behind": np.floor(d.even(0, 5)), "strength": d.even(0, 2e-4),
              "caution": d.even(0.3, 1), "load": d.even(4e4, 7e4)}  # fmt: skip
        s |= {"factor": d.even(0.4, 2)} if learn else {}
    block = train_slip(LAYER, CLEAN, learn=learn, plan=plan)
    _, after, told = values(block, s, many)
    v = np.maximum(np.abs(v), 1)
    e = np.maximum(s["v_s"], 0) / v
    low, high = height(s, "layer", e, v), height(s, "clean", e, v)
    keep, apart = np.minimum(s["T"] / s["T_f"], 1), high - low
    product = s["product"] + keep * (apart * (s["mu"] - low) - s["product"])
    square = s["square"] + keep * (apart**2 - s["square"])
    share = np.clip(product / (square + 3e-3**2), 0, 1)

    z = roots(s["slip"], 25)
    tops = [height(s, n, z**2, v).max(axis=1, keepdims=True) for n in ("layer", "clean")]
    if not plan:
        factor = s.get("factor", 1)
        gain = s["behind"] * s["caution"] * s["strength"] * factor * s["load"]
        gain = gain * np.maximum(tops[1] - tops[0], 0)

    def worth(z):
        f = (1 - share) * height(s, "layer", z**2, v) + share * height(s, "clean", z**2, v)
        if plan:
            return f + interpolated(cleaned(share, s["rate"], np.maximum(f, 0), z**2), s["value"])
        f = np.maximum(f, 1e-4)
        return np.log(f) + gain * np.maximum(1 - f / tops[1], 0) * z**2

    all_ = worth(z)
    best = np.argmax(all_, axis=1)[:, None]
    place, top = np.take_along_axis(z, best, 1), np.take_along_axis(all_, best, 1)
    step = z[:, 1:2] - z[:, :1]
    before, behind = worth(place - step), worth(place + step)
    bend = before - 2 * top + behind  # the vertex of the parabola through three
    moved = np.where(bend < 0, step * (before - behind) / 2 / np.minimum(bend, -1e-12), 0)
    place = np.minimum(place + np.clip(moved, -step, step), z[:, -1:])
    follows = s["e"] + np.minimum(s["T"] / s["T_e"], 1) * (place**2 - s["e"])
    e = np.where(s["begun"] == 1, follows, place**2)
    assert_same(after, {"product": product, "square": square, "e": e, "begun": 1}, rtol=1e-7)
    best_slip = np.maximum(e * np.abs(s["v"]), s["least"])
    assert_same(told, {"v_best": best_slip, "share": share}, rtol=1e-7)


@pytest.mark.parametrize("learn", [False, True])
@pytest.mark.parametrize("axles", [1, 2, 4])
def test_a_plan_works_out_one_column_in_a_tick(axles, learn):
    many = 40
    d = Draw(many, 2)
    turn = np.floor(d.even(1, axles)) if axles > 1 else d.one_of(0.0, 0.0)
    value = np.sort(d.even(0.1, 0.9, 17 * axles).reshape(many, axles, 17))
    s = of_curves(d) | {
        "value": value.reshape(many, -1), "turn": turn, "v": d.one_of(d.even(3, 30), -0.5),
        "strength": d.even(0, 4e-4), "caution": d.even(0.3, 1), "load": d.even(4e4, 7e4),
        "slip": d.even(0.1, 0.5), "most": d.one_of(d.even(0.02, 0.2), 1.0),
    } | ({"factor": d.even(0.4, 2)} if learn else {})  # fmt: skip
    _, after, told = values(train_plan(LAYER, CLEAN, axles, learn=learn), s, many)
    rate = s["strength"] * s["caution"] * s["load"] * s.get("factor", 1)
    assert_same(told, {"value": s["value"], "rate": rate})
    v, wanted = np.maximum(np.abs(s["v"]), 1), value.copy()
    e = roots(s["slip"], 13) ** 2
    low, high = height(s, "layer", e, v), height(s, "clean", e, v)
    for k in range(many):
        if axles > 1:
            j = int(turn[k, 0])
            f = np.clip(np.outer(1 - NODES, low[k]) + np.outer(NODES, high[k]), 0, s["most"][k])
            left = cleaned(NODES[:, None], rate[k], f, e[k])
            wanted[k, j - 1] = (f + np.interp(left, NODES, value[k, j])).max(axis=1)
    new = np.where(turn > 1, turn - 1, axles - 1)
    assert_same(after, {"value": wanted.reshape(many, -1), "turn": new}, rtol=1e-7)


def test_axles_see_the_rail_under_them_and_how_well_they_clean():
    """Three axles over cells of a metre, one of a half: places, shares and energies of each."""
    many, behind = 500, (0.0, 2.3, 7.9)
    d, n, cells = Draw(many, 3), 3, 9
    v = d.one_of(d.even(3, 30), d.even(-25, -3), d.even(-0.9, 0.9))
    steps = np.clip(np.floor(d.even(0, 4, cells)) / 3 + d.even(-0.05, 0.05, cells), 0, 1)
    s = of_curves(d) | {
        "seen": steps, "first": np.clip(steps - d.even(0, 0.3, cells), 0, 1),
        "energy": d.even(0, 900, cells), "phase": d.one_of(d.even(0, 1), d.even(0.9, 1)),
        "product": d.even(0, 0.01), "square": d.even(0, 0.01), "v": v,
        "mu": d.even(-0.01, 0.25, n), "v_s": np.abs(v) * d.one_of(d.even(-0.01, 0.3, n), 2e-3),
        "rise": d.even(0.1, 0.5), "tau_0": d.even(5e-5, 3e-4), "sure": d.even(100, 900),
        "most": d.even(1.5, 4), "load": d.even(4e4, 7e4), "T_f": d.even(0.01, 0.1),
        "T_tau": d.even(0.5, 3), "T": d.even(1e-3, 0.05),
    }  # fmt: skip
    block = rail_seen(LAYER, CLEAN, behind)
    assert block.states["seen"].size == cells
    _, after, told = values(block, s, many)
    seen, first, energy = (s[k].copy() for k in ("seen", "first", "energy"))
    product, square = np.zeros((many, 1)), np.zeros((many, 1))
    ahead = np.full((many, n), 1e3)
    for k in range(many):
        p = {name: row[k, 0] for name, row in s.items() if name not in ("mu", "v_s", "seen")}
        speed, phase = max(abs(p["v"]), 1.0), p["phase"]
        kept = min(p["T"] / p["T_tau"], 1)
        product[k], square[k] = p["product"] * (1 - kept), p["square"] * (1 - kept)
        before = s["seen"][k]
        for axle, place in enumerate(behind):
            slip = max(s["v_s"][k, axle], 0) / speed
            mu, low, high = s["mu"][k, axle], *(height(p, c, slip, speed)
                                               for c in ("layer", "clean"))  # fmt: skip
            says = high - low > 0.02
            share = min(max((mu - low) / max(high - low, 0.02), 0), 1)
            # the cell under the axle: the next one once the rest of its place is passed
            cell = int(np.floor(place)) + (place % 1 >= phase)
            own, found = before[cell], first[k, cell]
            if axle:
                W = energy[k, cell - 1]  # of the cell ahead
                rose = np.log(max(1 - found, 0.01) / max(1 - share, 0.01))
                able = says and abs(share - own) < p["rise"] and max(share, found) < 0.9
                weight = able * (1 - share) ** 2 * kept * p["tau_0"] * W
                product[k] += weight * rose
                square[k] += weight * p["tau_0"] * W
            moved = seen[k, cell] + min(p["T"] / p["T_f"], 1) * (share - seen[k, cell])
            if says:
                seen[k, cell] = moved
                if not axle:
                    first[k, cell] = moved
            rubbed = p["load"] * max(mu, 0) * slip * abs(p["v"]) * p["T"]
            energy[k, cell] += rubbed  # over a cell of a metre
            at = place - phase - np.arange(int(np.floor(place)) + 1)
            nearer = (before[: len(at)] - own > p["rise"]) & (at >= 0)
            if nearer.any():
                ahead[k, axle] = at[nearer].min()
    prior = (s["tau_0"] * s["sure"]) ** 2
    factor = (s["product"] + prior) / (s["square"] + prior)
    assert_same(told, {"ahead": ahead, "factor": np.clip(factor, 1 / s["most"], s["most"])})
    phase = s["phase"] + np.minimum(np.abs(v) * s["T"], 1)
    enters = phase >= 1

    def shifted(rows, begin):
        return np.where(enters, np.concatenate([begin, rows[:, :-1]], axis=1), rows)

    wanted = {"seen": shifted(seen, first[:, :1]), "first": shifted(first, first[:, :1]),
              "energy": shifted(energy, np.zeros((many, 1))), "product": product,
              "square": square, "phase": phase - enters}  # fmt: skip
    assert_same(after, wanted)
    assert 0.02 < enters.mean() < 0.9
    assert 0.02 < (ahead < 1e3).mean() < 0.9


def test_cells_are_half_of_the_least_distance_of_two_axles_at_most():
    near = rail_seen(LAYER, CLEAN, (0.0, 3.1, 4.5))
    assert near.choices["cell in m"] == pytest.approx(0.7)
    assert near.choices["cells"] == int(4.5 / 0.7) + 2
    assert rail_seen(LAYER, CLEAN, (0.0,)).choices == {"axles": 1, "cells": 2, "cell in m": 1.0}
    s = {"v": np.array([[8.0]]), "T": np.array([[0.05]]), "phase": np.array([[0.2]]),
         "mu": np.zeros((1, 3)), "v_s": np.zeros((1, 3))}  # fmt: skip
    assert values(near, s, 1)[1]["phase"] == pytest.approx(0.2 + 0.4 / 0.7)
