"""The shipped slide protection behind the two valves of an air brake: its tick, its certificate."""

from __future__ import annotations

import copy
import json
import math
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest

from slipctl.certify import catalogue, proofs
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.cells.mode_images import ModeTick
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.promise import CERTIFIED, exact_numbers
from slipctl.errors import BadInput
from slipctl.models.vehicle.air.pneumatics import ATMOSPHERE, cylinder, flow_factor, magnet_valves
from slipctl.models.vehicle.air.slide_protection import refill, rim_acceleration, slide_machine
from slipctl.models.vehicle.certificate.air_tick import CHORDS, AirAxle, air_loop
from slipctl.models.vehicle.parts import Air
from slipctl.study import resolve
from slipctl.study.request import Request

BRAKE = Air(torque=6e3, fill=4e-3, vent=8e-3, dead_time=0.06, pulse=0.02)
N = {
    "W": 0, "noise": 0, "dead": 0.06, "T": 0.01, "least": 0.14, "most": 1, "v": 38.9,
    "demand": 5800,
}  # fmt: skip
AXLE = AirAxle(lever=0.46 / 100, T_f=0.04, s_1=0.1, peak=61.0, brake=BRAKE)


class Running:
    """A block that is run tick by tick."""

    def __init__(self, block, **numbers):
        self.block = block.with_params(**{k: x for k, x in numbers.items() if k in block.params})
        self.x = ca.DM(self.block.pack("state", self.block.start()))
        self.f, self.p = self.block.f, self.block.param_values()

    def __call__(self, **u):
        b = self.block
        given = {k: u.get(k, s.value) for k, s in b.inputs.items()}
        after, y = self.f(self.x, b.pack("input", given), b.pack("param", self.p))
        self.x = after
        return {k: float(v) for k, v in b.unpack("output", y).items()}

    def state(self, name):
        return float(self.block.unpack("state", self.x)[name])


class Braked:
    """An axle with the controller's own blocks and the brake's own, in ticks of 1 ms."""

    def __init__(self, rng):
        k_f, k_v = BRAKE.rates
        air = {"k_f": k_f, "k_v": k_v, "T_max": 6e3, "pulse": 0.02, "m_axle": 12e3, "r": 0.46}
        self.rng, self.s = rng, 0.0
        self.rim = Running(rim_acceleration, T_f=0.04, T=0.01, v_start=38.9)
        self.machine = Running(slide_machine())
        self.refill = Running(refill, **air, T=0.01, ramp=float(rng.choice([0.67, 5, 50])))
        self.valves, self.now = (Running(magnet_valves(k), **air, T=1e-3) for k in (60, 0))
        self.real, self.shadow = (Running(cylinder, **air, T=1e-3) for _ in range(2))
        self.q, self.T_b, self.then = 61.0, 0.0, 0.0
        for _ in range(60):  # valves at rest fill: that is under way
            self.shadow(T_demand=5.8e3, **_open(self.now(hold=0, vent=0)))

    def coordinates(self):
        f = 38.9 - self.rim.state("w_f")
        p = math.log(self.shadow.state("p") / ATMOSPHERE)
        # a valve that has moved in the last tick stays for one more
        stands = 2 * (self.now.state("vented") > 0.5) or float(self.now.state("held") > 0.5)
        stays = 1 if self.now.state("age") < 0.0105 else 0
        return [f, (f - self.s) / 0.04, p], [self.then, stands, stays]

    def tick(self):
        a_w = self.rim(rim=38.9 - self.s)["a_w"]
        self.then = self.machine(v=38.9, v_s=self.s, a_w=a_w, off=0)["state"]
        later = 6e3 * (self.shadow.state("p") - ATMOSPHERE) / 3.8e5
        bits = self.refill(
            state=self.then, T_b=self.T_b, under_way=later - self.T_b, T_demand=5.8e3
        )
        for _ in range(10):
            if self.rng.random() < 0.02:
                self.q = float(self.rng.choice([0.14 * 61, 61, self.rng.uniform(0.14, 1) * 61]))
            near = min(self.s / 0.1, 1.0)
            self.s = max(0.0, self.s + 1e-3 * (0.46 / 100 * self.T_b - self.q * near))
            real = self.real(T_demand=5.8e3, **_open(self.valves(**bits)))
            self.shadow(T_demand=5.8e3, **_open(self.now(**bits)))
            self.T_b = real["T_b"]


def _open(bits):
    return {k: bits[k] for k in ("hold", "vent")}


def _squeezed(a):
    """Acceleration as the loop counts it."""
    return min(max(a, -8 + (a + 8) / 2), 4 + (a - 4) / 16)


@pytest.mark.parametrize(
    ("runs", "looked_at", "many", "far"),
    [(1, range(66, 96), 5, 0.4), pytest.param(3, range(350), 6, 3, marks=pytest.mark.long)],
)
def test_the_tick_holds_what_blocks_valves_and_cylinder_do(runs, looked_at, many, far):
    """Runs with any adhesion in its range: each next state lies in an image of the one before."""
    loop = air_loop(slide_machine(), AXLE, N)
    tick: ModeTick = loop.tick()
    rng, states, slid = np.random.default_rng(5), set(), 0.0
    for _ in range(runs):
        axle = Braked(rng)
        for k in range(looked_at.stop):
            x, modes = axle.coordinates()
            axle.tick()
            if k not in looked_at:
                continue
            y, wanted = axle.coordinates()
            x[1], y[1] = _squeezed(x[1]), _squeezed(y[1])
            ends = [(np.array([v - 1e-9]), np.array([v + 1e-9])) for v in x]
            found = tick.images(Boxes, ends, np.array([modes], np.int64), loop.push, 1)
            rows = np.flatnonzero((found.modes == np.array(wanted)).all(axis=1))
            # the cylinder's steps are of second order: 1e-4 of the pressure
            near = (1e-6, 1e-6, 1e-4)
            assert any(
                all(b.low[r] - e <= v <= b.high[r] + e
                    for b, v, e in zip(found.reals, y, near, strict=True)) for r in rows
            ), (x, modes, y, wanted)  # fmt: skip
            states.add(tuple(modes))
            slid = max(slid, axle.s)
    assert len(states) > many
    assert slid > far


def test_the_chords_of_a_flow_lie_below_it():
    """The flow to the air is concave in the logarithm of the pressure; below they touch it."""
    p = np.linspace(0, -math.log(0.5283), 4001)[1:]
    flow = np.array([float(flow_factor(math.exp(-x))) for x in p])
    nodes = [0.0] + [float(flow_factor(math.exp(-x))) for x in CHORDS[1:]]
    assert (flow >= np.interp(p, CHORDS, nodes) - 1e-9).all()
    assert (np.diff(flow, 2) < 1e-9).all()


@pytest.mark.long
def test_the_slide_protection_of_emu_locks_no_wheel(tmp_path, monkeypatch):
    """Over a narrower adhesion than the file's, which is quicker; the file is checked alone."""
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, "-m", "slipctl", "new", "emu"], check=True, capture_output=True)
    study = resolve.load_study("emu.toml")
    gains = next(g for g in study.certificates.gains if g.loop == "wsp")
    block = Request.of(study, "wsp", []).chosen[0]
    system = catalogue.system_of_gains(gains, block)
    told = {k: float(v) for k, v in gains.numbers(block).items()}
    assert told["band"] == pytest.approx(140 / 3.6)
    numbers = exact_numbers(system, told | {"least": 0.25, "band": 25.0})
    payload = json.loads(json.dumps(proofs.write(system, numbers)))
    assert payload["verdict"] == CERTIFIED
    proofs.check(catalogue.OF_LOOPS["slide_loop"], payload)
    bad = copy.deepcopy(payload)
    bad["asked"]["band"]["value"] = "6"
    with pytest.raises((DoesNotHold, BadInput)):
        proofs.check(catalogue.OF_LOOPS["slide_loop"], bad)


def test_load_that_moves_and_pads_are_told_instead_of_left_out(tmp_path, monkeypatch):
    """A vehicle whose torque or load differs from what is proved has a reason, no certificate."""
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, "-m", "slipctl", "new", "emu"], check=True, capture_output=True)
    text = (tmp_path / "emu.toml").read_text(encoding="utf-8")
    more = text.replace('length = "20 m"', 'length = "20 m"\nheight = "1.6 m"')
    (tmp_path / "emu.toml").write_text(more, encoding="utf-8")
    study = resolve.load_study("emu.toml")
    assert not [g for g in study.certificates.gains if g.loop == "wsp"]
    assert "load moves" in study.certificates.uncertified["wsp"]
    assert "contaminated" in study.certificates.uncertified["pi"]
