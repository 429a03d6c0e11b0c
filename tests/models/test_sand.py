"""Sand on the rail, layers that dry or are fouled again, and wheel sensors that fail."""

from __future__ import annotations

from itertools import pairwise
from math import exp

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.models.sensors import wheel_sensors_with_faults
from slipctl.models.vehicle.air.pneumatics import brake_model
from slipctl.models.wheel_rail.rail_memory import Cells, Layer, rail_field

H, CELL, V = 1e-2, 0.5, 20.0


def packed(field, x, u, p):
    return field.pack("state", x), field.pack("input", u), field.pack("param", p)


def after(field, x, u, p):
    """States after a step, and its outputs by name."""
    column, outputs = field.f(*packed(field, x, u, p))
    nxt = {n: np.array(v).ravel() for n, v in field.unpack("state", column).items()}
    return nxt, {n: np.array(v).ravel() for n, v in field.unpack("output", outputs).items()}


def sander(behind, nozzles, lead=0.0, **numbers):
    field = rail_field(Cells(behind, CELL, 40.0, lead), H, Layer(nozzles=nozzles))
    given_ = {"rate": 0.03, "S_0": 7.5e-3, "carry": 1.0, "delay": 0.0, "v_least": 5.0,
              "start": [-1e6], "end": [1e6]}  # fmt: skip
    return field.with_params(**(given_ | numbers))


def run(field, axles, ticks, slip=2.0, v=V, way=None):
    """Outputs of each tick, and the states at the end."""
    x, p, told = field.start(), field.param_values(), []
    at, behind = 0.0, np.array(axles)
    step = v * H if way is None else way
    for k in range(ticks):
        each = slip(k) if callable(slip) else slip
        u = {"at": at - behind, "way": step, "P": np.zeros(behind.size), "v": v,
             "v_s": np.full(behind.size, each)}  # fmt: skip
        x, y = after(field, x, u, p)
        told.append(y)
        at += step
    return told, x


@pytest.mark.parametrize("axles", [(0.0,), (0.0, 2.5), (0.0, 2.5, 6.1)])
def test_a_nozzle_ahead_of_an_axle_gives_it_rate_over_speed(axles) -> None:
    """Once what was poured at the start lies under the last axle; nothing is lost with carry 1."""
    field = sander(axles, (-1.0,), lead=1.0)
    told, x = run(field, axles, 120)
    assert told[-1]["S_seen"] == pytest.approx(np.full(len(axles), 0.03 / V), rel=1e-9)
    assert told[0]["S_seen"] == pytest.approx(np.zeros(len(axles)))
    share = -np.expm1(-0.03 / V / 7.5e-3)
    assert told[-1]["recovered"] == pytest.approx(np.full(len(axles), share), rel=1e-9)
    assert x["sand"].item() == pytest.approx(2 * 0.03 * 120 * H)
    lying = 2 * CELL * (np.sum(x["S"]) + np.sum(x["poured"]))
    assert lying <= x["sand"].item() + 1e-12


def test_two_nozzles_pour_twice_as_much() -> None:
    """The second one behind the first axle: that finds the sand of the first alone."""
    axles = (0.0, 4.0)
    told, x = run(sander(axles, (-1.0, 2.0), lead=1.0), axles, 120)
    assert told[-1]["S_seen"] == pytest.approx([0.03 / V, 0.06 / V], rel=1e-9)
    assert x["sand"].item() == pytest.approx(4 * 0.03 * 120 * H)


@given(st.floats(0.1, 0.9))
@settings(max_examples=5)
def test_each_wheel_leaves_its_share_to_the_next(carry) -> None:
    axles = (0.0, 2.5, 6.0)
    told, _ = run(sander(axles, (-1.0,), lead=1.0, carry=carry), axles, 100)
    wanted = 0.03 / V * carry ** np.arange(3)
    assert told[-1]["S_seen"] == pytest.approx(wanted, rel=1e-9)


def test_no_sand_is_made_or_lost_while_it_lies_under_the_train() -> None:
    """What was poured is in the cells or in the nozzle's present one, until it is behind."""
    axles = (0.0, 12.0)
    field = sander(axles, (-1.0,), lead=1.0)
    x, p, at = field.start(), field.param_values(), 0.0
    for _ in range(50):  # 10 m: the first grain is not yet behind the last axle
        u = {"at": at - np.array(axles), "way": V * H, "P": np.zeros(2), "v": V,
             "v_s": np.full(2, 2.0)}  # fmt: skip
        x, _ = after(field, x, u, p)
        at += V * H
        lying = 2 * CELL * (float(np.sum(x["S"])) + float(np.sum(x["poured"])))
        assert lying == pytest.approx(x["sand"].item(), rel=1e-12)


@pytest.mark.parametrize(
    ("numbers", "slip", "v", "poured"),
    [
        ({}, 2.0, V, 60), ({}, -2.0, V, 60), ({}, 0.9, V, 0),  # below 5 % of the speed
        ({"e_slide": 0.04}, 0.9, V, 60), ({}, 2.0, 4.9, 0), ({"v_least": 4.0}, 2.0, 4.9, 60),
        ({"delay": 0.2}, 2.0, V, 40), ({"delay": 5.0}, 2.0, V, 0),
        # a pause of the slide begins the delay anew
        ({"delay": 0.2}, lambda k: 0.0 if k == 30 else 2.0, V, 60 - 20 - 1 - 20),
    ],
)  # fmt: skip
def test_sand_is_poured_while_an_axle_slides_fast_enough(numbers, slip, v, poured) -> None:
    told, x = run(sander((0.0,), (-1.0,), lead=1.0, **numbers), (0.0,), 60, slip, v)
    assert x["sand"].item() == pytest.approx(2 * 0.03 * poured * H, abs=2.1 * 0.03 * H)
    assert told[0]["sand"] == 0  # what was poured before


def test_a_train_that_stands_pours_into_one_cell() -> None:
    field = sander((0.0, 3.0), (-1.0,), lead=1.0)
    _, x = run(field, (0.0, 3.0), 20, way=0.0)
    assert not np.any(x["S"])
    assert x["poured"].item() == pytest.approx(0.03 * 20 * H / CELL)


def test_a_layer_dries_with_time_and_cleaned_rail_is_fouled_again() -> None:
    drying = rail_field(Cells((0.0,), CELL, 40.0), H, Layer(drying=True)).with_params(
        T_dry=0.5, start=[-1e6], end=[1e6]
    )
    x, p = drying.start(), drying.param_values()
    u = {"at": np.zeros(1), "way": 0.1, "P": np.zeros(1)}
    for k in range(40):
        x, y = after(drying, x, u, p)
        assert y["recovered"][0] == pytest.approx(1 - exp(-k * H / 0.5), abs=1e-12)
    fouling = rail_field(Cells((0.0, 4.0), CELL, 40.0), H, Layer(fouling=True)).with_params(
        T_foul=0.4
    )
    x, p = fouling.start(), fouling.param_values()
    x["W"] = np.full(fouling.states["W"].size, 500.0)
    still = {"at": np.zeros(2), "way": 0.0, "P": np.zeros(2)}
    for _ in range(10):
        x, _ = after(fouling, x, still, p)
    assert np.ravel(x["W"]) == pytest.approx(np.full(x["W"].size, 500 * exp(-10 * H / 0.4)))


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan")])
def test_a_cell_has_a_length(length) -> None:
    with pytest.raises(BadInput, match="it must be positive"):
        Cells((0.0, 3.0), length)


def test_a_part_of_the_rail_has_the_least_factor_of_its_stretches() -> None:
    field = rail_field(Cells((0.0, 5.0), CELL, 40.0), H, Layer(places=2)).with_params(
        start=[10.0, 12.0], end=[20.0, 14.0], factor=[0.8, 0.5]
    )
    for at, wanted in ((9.9, [1, 1]), (10.0, [0.8, 1]), (13.0, [0.5, 1]), (14.0, [0.8, 1]),
                       (18.0, [0.8, 0.5]), (20.0, [1, 0.8])):  # fmt: skip
        u = {"at": at - np.array([0.0, 5.0]), "way": 0.1, "P": np.zeros(2)}
        _, y = after(field, field.start(), u, field.param_values())
        assert list(y["height"]) == wanted
        assert list(y["recovered"]) == [float(w == 1) for w in wanted]


# ---- wheel sensors that fail ---------------------------------------------------------------------


def test_each_kind_of_a_sensor_fails_as_it_says() -> None:
    """From its time on: one keeps what it read, one reads 0, one reads more, one is sound."""
    block = wheel_sensors_with_faults(4, ["", "frozen", "missing", "jumps"]).with_params(
        begin=[0.0, 0.03, 0.02, 0.01], share=[0.0, 0.0, 0.0, -0.25], T=0.01
    )
    x = block.start()
    for k in range(8):
        u = np.array([10.0, 20.0, 30.0, 40.0]) + k
        x, y = block(**x, u=u)
        read = np.ravel(ca.DM(y["y"]).full())
        assert read[0] == u[0]
        assert read[1] == (u[1] if k < 3 else 22.0)
        assert read[2] == (u[2] if k < 2 else 0.0)
        assert read[3] == pytest.approx(u[3] if k < 1 else 0.75 * u[3])
    assert block.choices["kinds"] == ("", "frozen", "missing", "jumps")


# ---- what a controller expects of its valves -----------------------------------------------------


@pytest.mark.parametrize("ticks", [0, 1, 4])
def test_the_expected_torque_follows_the_bits_and_ends_at_what_is_demanded(ticks) -> None:
    """No further than it, holds it, and vents down to 0; each late by its dead time."""
    block = brake_model(ticks).with_params(T=0.01, corrects=0.0)
    p = {k: float(v) for k, v in block.param_values().items()}
    demand = 0.31 * p["T_max"]

    def run(x, bits, many):
        told = []
        for _ in range(many):
            seen = float(x["T_h"])  # a sensor that is right
            x, y = block(**x, hold=bits[0], vent=bits[1], T_b=seen, T_demand=demand)
            told.append(float(y["expected"]))
        return x, told

    x, filled = run(block.start(), (0, 0), 400 + ticks)
    assert filled[: ticks + 1] == pytest.approx([0.0] * (ticks + 1))
    assert filled[ticks + 2] > 0
    assert all(b >= a - 1e-9 for a, b in pairwise(filled))
    assert filled[-1] == pytest.approx(demand, rel=1e-9)
    assert max(filled) <= demand * (1 + 1e-12)
    x, held = run(x, (1, 0), 30)  # nothing is under way any more
    assert held == pytest.approx([demand] * 30)
    x, vented = run(x, (1, 1), 400)
    assert all(b <= a + 1e-9 for a, b in pairwise(vented))
    assert vented[: ticks + 1] == pytest.approx([demand] * (ticks + 1))
    assert 0 <= vented[-1] < 0.02 * demand


def test_a_sensor_pulls_the_expected_torque_to_itself() -> None:
    block = brake_model(0).with_params(T=0.01, corrects=2.0)
    x, told = block.start(), []
    for _ in range(200):
        x, y = block(**x, hold=1, vent=0, T_b=500.0, T_demand=0.0)
        told.append(float(y["expected"]))
    assert told == pytest.approx([500 * (1 - 0.98**k) for k in range(200)], abs=1e-6)
