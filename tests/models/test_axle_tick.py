"""Tick of a certificate of a vehicle file: that of the controllers, with what acts within it."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.certify.smooth.sums import NoProof
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.adhesion import rail_law
from slipctl.models.vehicle.certificate import axle_tick
from slipctl.models.vehicle.certificate.axle_loops import _Asked
from slipctl.models.vehicle.certificate.axle_tick import AxleTick, _Rest
from slipctl.models.vehicle.certificate.gains import _wheel
from slipctl.models.vehicle.certificate.slide_tick import SlideTick
from slipctl.study import resolve
from slipctl.study.files import trip_files
from slipctl.study.request import Request
from tests.leaves_trip import leaves_trip

F = Fraction

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


# ---- the rest of a tick --------------------------------------------------------------------------


def rest_of(law, first=(0.5, 4.0, 0.0), begun=0.4):
    """Rest of s+ = s + (T - 8 height)/16 and T+ = T/2 + what the law gives, and of its state."""
    z = ca.SX.sym("z", 7)
    s, T, x, height = z[0], z[1], z[2], z[6]
    after, torque = law(s, T, x, height)
    f = ca.Function("tick", [z], [ca.vertcat(s + (T - 8 * height) / 16, T / 2 + torque, after)])
    return _Rest(f, np.array(first), begun, ("mine",))


def test_a_rest_is_where_nothing_moves_and_moves_with_the_height():
    """An integral that holds the slip: it stands at half the torque, 4 height."""
    found = rest_of(lambda s, T, x, h: (x - (s - 0.5) / 4, x))
    for low, high in ((F(1, 2), F(1, 2)), (F(1, 2), F(3, 2)), (F(2), F(3))):
        cell = found.cell(((low, high),))
        assert cell.slow == ((low, high),)
        middle = float(low + high) / 2
        assert [float(x) for x in cell.rest] == pytest.approx([0.5, 8 * middle, 4 * middle])
        assert cell.rest[0] == F(1, 2)
        ((s, T, x),) = cell.moves
        assert s == 0
        assert [float(T), float(x)] == pytest.approx([8, 4])


def test_a_law_that_still_moves_is_named():
    """Its state counts up, or it grows with the error that cannot vanish."""
    with pytest.raises(NoProof, match="mine"):
        rest_of(lambda s, T, x, h: (x + 1, 4 * h)).cell(((F(1), F(1)),))


def test_a_law_that_stands_somewhere_else_meets_a_limit():
    with pytest.raises(NoProof, match="limit"):  # a torque of 2 at most, and 8 are wanted
        rest_of(lambda s, T, x, h: (x / 2, ca.fmin(x, 1))).cell(((F(1), F(1)),))


def test_a_state_that_stays_wherever_it_is_has_no_one_rest():
    with pytest.raises(NoProof):
        rest_of(lambda s, T, x, h: (x, 4 * h)).cell(((F(1), F(1)),))


def test_a_law_settles_while_the_slip_comes_from_where_it_begins():
    """It is shown the slip on its way and then at its goal; torque and slip stay what they were."""
    seen = rest_of(lambda s, T, x, h: (x / 2 + s, x), begun=0.1)._settled(2.0)
    assert seen == pytest.approx([0.5, 4.0, 1.0])  # x = 2 s at rest
    counts = rest_of(lambda s, T, x, h: (x + s, x), begun=0.1)._settled(2.0)
    n = axle_tick.SETTLING
    assert counts[2] == pytest.approx(n * (0.1 + 0.5) / 2 + n * 0.5)


def test_a_tick_is_asked_at_its_own_period_and_behind_few_ticks():
    tick = object.__new__(AxleTick)
    tick.period, tick.made = 0.01, {}
    n = {"T": F(1, 100), "lag": 0, "v": 10, "dead": F(axle_tick.MOST_DEAD + 1, 100), "goal": F(1)}
    with pytest.raises(BadInput, match=str(axle_tick.MOST_DEAD)):
        tick.build(n)
    for wrong in (F(1, 1000), F(101, 10000)):
        with pytest.raises(BadInput, match=r"0\.01 s"):
            tick.build({**n, "T": wrong})
    made = []
    tick._built = lambda n: made.append(n) or object()
    first = tick.build(n)
    assert tick.build({**n, "W": 3}) is first  # what pushes is no matter of the tick
    assert tick.build({**n, "lag": 1}) is not first
    assert len(made) == 2
    with pytest.raises(BadInput, match=r"0\.01 s"):
        SlideTick.loop(tick, {**n, "T": F(1, 50)})


def test_a_command_acts_for_what_is_left_of_its_dead_time():
    for dead, times in ((F(0), (F(1, 100),)), (F(2, 100), (F(1, 100),)),
                        (F(24, 1000), (F(4, 1000), F(6, 1000))),
                        (F(1, 1000), (F(1, 1000), F(9, 1000)))):  # fmt: skip
        assert axle_tick.times_of_commands({"dead": dead, "T": F(1, 100)}) == times


@pytest.mark.parametrize("time", [0.001, 0.005, 0.0051, 0.02])
def test_steps_within_a_tick_are_no_longer_than_the_longest(time):
    """Of x' = -x: RK4 in equal steps, each of fourth order."""
    seen = []

    def rate(x):
        seen.append(x)
        return -x

    many = max(1, int(np.ceil(time / axle_tick.LONGEST - 1e-9)))
    z = time / many
    share = 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24
    assert axle_tick.state_after(rate, 2.0, time) == pytest.approx(2 * share**many, rel=1e-14)
    assert len(seen) == 4 * many


def test_a_brake_of_a_slide_tick_takes_a_command_and_the_demand_alone():
    @step(T_b=Output("N m", "torque"))
    def brake(T=State("N m", 1.0, "torque"), T_cmd=Input("N m", "command"),
              T_demand=Input("N m", "demand"), share=Param("1", 0.5, "share")):  # fmt: skip
        """A brake."""
        return dict(T=T + share * (T_cmd - T)), dict(T_b=T + 0.25 * T_demand)

    tick = object.__new__(SlideTick)
    tick.T_demand, tick.period = 8.0, 4 * T_S
    tick.trip = SimpleNamespace(actuator=None)
    after, T_b = tick._braked(brake, ca.SX(2.0), ca.SX(6.0))
    assert (float(after), float(T_b)) == (4.0, 4.0)
    later = tick._after_period(brake, ca.SX(2.0), ca.SX(6.0), ca.SX(0))
    assert float(later) == 6 - 4 / 2**4

    @step(T_b=Output("N m", "torque"))
    def other(T=State("N m", 1.0, "torque"), T_cmd=Input("N m", "command"),
              F_n=Input("N", "load")):  # fmt: skip
        """A brake that asks for its load."""
        return dict(T=T_cmd), dict(T_b=T + F_n)

    with pytest.raises(NoProof, match="F_n"):
        tick._braked(other, ca.SX(2.0), ca.SX(6.0))
