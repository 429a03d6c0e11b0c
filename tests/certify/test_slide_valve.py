"""A slide protection every 10 ms, written as text, behind the valve of a vehicle file."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from slipctl.certify import catalogue, proofs
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.cells.mode_runs import worst_runs
from slipctl.certify.promise import CERTIFIED, exact_numbers
from slipctl.models.vehicle.certificate.slide_tick import _after_valve, fall_of_sides
from slipctl.models.vehicle.parts import Valve
from slipctl.models.vehicle.plant import actuator
from slipctl.study import resolve
from slipctl.study.request import Request
from tests.leaves_trip import leaves_trip

LAW = """
[wsp]
doc = "Fills, holds and vents by slip and rim acceleration, every 10 ms"
period = "10 ms"
equations = \"\"\"
a_w = (v - v_s - w_f)/T_f
w_f+ = w_f + tick*a_w
mode+ = VENT
T_wanted = 0*T_top if mode > 1.5 else (T_top if mode < 0.5 else T)
\"\"\"
outputs = { T_wanted = "N m" }
[wsp.inputs]
v_s = { unit = "m/s", doc = "slip", positive = "braking", per = "speed" }
v = { unit = "m/s", doc = "speed" }
T = { unit = "N m", doc = "brake torque", positive = "braking" }
[wsp.parameters]
s_hi = "1.5 m/s"
s_lo = "0.9 m/s"
a_vent = "3 m/s^2"
a_fill = "0.5 m/s^2"
T_top = "9 kN m"
vents = 1
T_f = "80 ms"
tick = "10 ms"
[wsp.states]
mode = { start = 0 }
w_f = { start = 16.67, unit = "m/s" }
""".replace(
    "VENT",
    "2*vents if (v_s > s_hi or (a_w < -a_vent and v_s > s_lo)) else"
    " (0*vents if (v_s < s_lo and a_w < a_fill) else vents)",
)

TRIP = leaves_trip(
    """kind = "valve"
torque = "9 kN m"
fill = "300 ms"
vent = "100 ms"
""",
    """[control]
period = "10 ms"
[certify]
slip = "2.2 m/s"
[controllers.wsp]
kind = "file"
block = "wsp.toml:wsp"
""",
    speed="60 km/h",
    deceleration="0.9 m/s^2",
)


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The system of the machine, its numbers, and its loop."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wsp.toml").write_text(LAW, encoding="utf-8")
    (tmp_path / "t.toml").write_text(TRIP, encoding="utf-8")
    study = resolve.load_study("t.toml")
    gains = next(g for g in study.certificates.gains if g.loop == "wsp")
    block = Request.of(study, "wsp", []).chosen[0]
    system = catalogue.system_of_gains(gains, block)
    numbers = exact_numbers(system, {k: float(v) for k, v in gains.numbers(block).items()})
    return system, numbers


def _rate(x, error, part):
    """Rate of a pressure over the full one, by the error."""
    fills, vents = error > part.band, error < -part.band
    return (1 - x) / part.fill * fills - x / part.vent * vents - x / 1e3


def _ticks_of_valve(part, x, wanted, ticks):
    """Pressure over the full one after ticks of 1 ms that are followed one by one."""
    T = 1e-3
    for _ in range(ticks):
        e = wanted - x
        k1 = _rate(x, e, part)
        k2 = _rate(x + T / 2 * k1, e, part)
        k3 = _rate(x + T / 2 * k2, e, part)
        k4 = _rate(x + T * k3, e, part)
        x += T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def test_a_period_of_the_valve_holds_its_ticks_one_by_one():
    """Random valves, pressures and commands, also at the edges of the band; and hardly more."""
    rng, many = np.random.default_rng(3), 0
    P, c, stop = (ca.SX.sym(k) for k in ("P", "c", "stop"))
    for _ in range(60):
        fill, vent, band = (
            float(rng.uniform(*r)) for r in ((0.1, 0.6), (0.05, 0.4), (0.004, 0.05))
        )
        part = Valve(torque=9e3, fill=fill, vent=vent, band=band)
        ticks = int(rng.choice([2, 5, 10, 20]))
        made = _after_valve(part, actuator(part), P, c, stop, ticks)
        if made is None:
            assert max(1e-3 / part.fill, 1e-3 / part.vent) > 1.9 * part.band
            continue
        many += 1
        f = ca.Function("f", [P, c, stop], [made])
        for _ in range(40):
            x = rng.uniform(0, 1)
            edge = np.clip(x + part.band * rng.choice([-1, 1]) * rng.uniform(0.9, 1.1), 0, 1)
            wanted = float(rng.choice([0, 1, x, edge, rng.uniform(0, 1)]))
            low, high = sorted(float(f(6e5 * x, 9e3 * wanted, z)) / 6e5 for z in (0, 1))
            assert low - 1e-9 <= _ticks_of_valve(part, x, wanted, ticks) <= high + 1e-9
            assert high - low < 2.1e-3 * max(1 / part.fill, 1 / part.vent)
    assert many > 40


def test_the_sides_of_an_odd_curve_are_the_curve():
    """For both signs; what is not odd stays as it is."""
    x = ca.SX.sym("x")
    odd = ca.Function("f", [x], [ca.if_else(x >= 0, 1, -1) * (1 - ca.exp(-3 * ca.fabs(x)))])
    for at in (-2.0, -1e-3, 0.0, 1e-6, 0.7):
        exact = np.sign(at) * (1 - np.exp(-3 * abs(at)))
        assert float(fall_of_sides(odd)(ca.DM(at))) == pytest.approx(exact, abs=1e-11)
    even = ca.Function("f", [x], [x * x])
    assert fall_of_sides(even) is even


def test_a_cell_about_no_slip_has_few_ways(asked):
    """Each question of the tick doubles them at most; those of the curve's side were 2^24."""
    system, numbers = asked
    loop = system.loop.build(numbers)
    ends = [(np.array([a]), np.array([b])) for a, b in ((-0.05, 0.05), (-16.7, -16.69), (1e3, 5e3))]
    found = loop.tick().images(Boxes, ends, np.zeros((1, 1), np.int64), loop.push, loop.stride)
    assert len(found.cell) <= 64


@pytest.mark.long
def test_the_certificate_that_was_found_is_that_of_this_file_and_holds(asked):
    """It was made by ``slipctl certify t.toml:wsp --out``; a bound at most 1.45 times a run."""
    system, _ = asked
    payload = json.loads((Path(__file__).parent / "slide_valve.json").read_text(encoding="utf-8"))
    assert payload["verdict"] == CERTIFIED
    assert "never exceeds 1.928 m/s" in proofs.check(system, payload)
    numbers = {k: Fraction(v["value"]) for k, v in payload["asked"].items()}
    far = worst_runs(system.loop.build(numbers), 400).worst["s", 1][0]
    assert 1.928 / 1.45 < far < 1.928


def test_runs_of_an_axle_written_here_stay_below_the_bound(asked):
    """What docs/own_proof.md says is proved; these runs share nothing with the proof."""
    _, numbers = asked
    assert 1.2 < _worst_of_plain_runs(float(numbers["W"]), float(numbers["demand"])) < 1.928


def _worst_of_plain_runs(W, demand, runs=60, ticks=200):
    """Largest slip of runs whose push turns over at random, or follows the slip."""
    rng, worst = np.random.default_rng(1), 0.0
    part = Valve(torque=9e3, fill=0.3, vent=0.1)
    J, r, m, g = 110.0, 0.42, 38e3, 9.81
    scale = (r**2 / J + 4 / m) * m * g / 4
    for k in range(runs):
        s, w_f, x, mode, w = 0.0, 16.67, 0.0, 0, W
        for i in range(ticks):
            if k % 2:
                w = W if s > 0.02 * k or i < 5 * k else -W
            elif rng.random() < 0.05:
                w = rng.choice([-W, W])
            a = (50 / 3 - s - w_f) / 0.08
            T = 9e3 * x
            wanted = (demand, T, 0.0)[mode]
            vents = s > 1.5 or (a < -3 and s > 0.9)
            mode, w_f = (2 if vents else 0 if s < 0.9 and a < 0.5 else 1), w_f + 0.01 * a
            x = _ticks_of_valve(part, x, min(wanted, demand) / 9e3, 10)
            for _ in range(10):
                mu = 0.18 * (np.exp(-0.54 * abs(s)) - np.exp(-1.2 * abs(s))) * np.sign(s)
                s += 1e-3 * (r / J * T - scale * mu + w)
            worst = max(worst, s)
    return worst
