"""Tick of a certificate of a vehicle file: that of the controllers, with what acts within it."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.certificate.axle_loops import _Asked
from slipctl.models.vehicle.certificate.axle_tick import AxleTick
from slipctl.models.vehicle.certificate.gains import _wheel
from slipctl.study import resolve
from slipctl.study.files import trip_files
from slipctl.study.request import Request
from tests.leaves_trip import leaves_trip

TRIP = leaves_trip(
    """kind = "lag"
torque = "9 kN m"
lag = "50 ms"
dead_time = "24 ms"
""",
    """[control]
period = "10 ms"
[controllers.pid]
kind = "pid"
K = "5 1/s"
[controllers.sta]
kind = "sta"
[controllers.smc]
kind = "smc"
""",
    speed="15 m/s",
)


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text(TRIP, encoding="utf-8")
    return resolve.load_study("t.toml")


@pytest.mark.second
def test_every_certificate_is_asked_at_the_period_of_the_controllers(study):
    """The plant ticks each millisecond; a sentence about that tick would be of another loop."""
    gains, _ = study.certificates
    told = {g.name: g.numbers(Request.of(study, g.loop, []).chosen[0]) for g in gains}
    assert {"pid", "sta", "smc"} <= set(told)
    assert {float(n["T"]) for n in told.values()} == {0.01}


@pytest.mark.second
def test_axle_is_the_differential_equation_and_a_command_acts_within_a_tick(study):
    """A dead time of 2.4 ticks: the command of 3 ticks ago acts for 4 ms, the next one for 6."""
    loop = Request.of(study, "pid", []).chosen[0]
    trip = trip_files.load_trip("t.toml")
    asked = _Asked(trip, trip.controllers["pid"], "leaves", rail_law(trip))
    tick = AxleTick(trip, asked.part, loop, asked.falls, asked._given(**_wheel(loop)), 0.8, 0.1)
    n = {**asked.numbers(loop), "dead": Fraction(24, 1000), "T": Fraction(1, 100)}
    built = tick.build(n)
    states = built.loop.states
    fall = tick._fall(float(n["v"]))
    wheel = _wheel(loop)
    x = dict.fromkeys(states, 0.0) | {"s": 0.7, "T": 2900.0, "q0": 2000.0, "q1": 4000.0}
    given = {f"x_{k}": v for k, v in x.items()}
    given |= {"d_w": 0.3, "d_n": 0.0, "d_f": 0.0, "p_height": 1.1}
    code = built.loop.code
    found = dict(zip(code.outputs, code.compiled()(*(given[k] for k in code.inputs)), strict=True))
    here = np.array([0.7, 2900.0])
    for command, time in ((2000.0, 0.004), (4000.0, 0.006)):
        rate = lambda _, y, u=command: [  # noqa: E731
            wheel["r"] / wheel["J"] * y[1] - 1.1 * float(fall(y[0])) - 0.1 + 0.3,
            (u - y[1]) / 0.05,
        ]
        here = solve_ivp(rate, (0, time), here, rtol=1e-10, atol=1e-10).y[:, -1]
    assert [found["s"], found["T"]] == pytest.approx(list(here), rel=1e-6)
    assert found["q0"] == 4000.0
