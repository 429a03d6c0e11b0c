"""What a vehicle's slip control believes when sensors fail, and what its axles get then."""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl.models import common_form as form
from slipctl.models.vehicle.failure import trust
from slipctl.models.vehicle.measurement.axle_samples import DOUBT, HOLD, SETTLED, WORN
from slipctl.models.vehicle.safe_output import begun_at_torque, safe_command

R, J, M, T_MAX, LOAD, H = 0.42, 110.0, 9500.0, 8e3, 9500.0, 1e-3
NUMBERS = dict(r=R, J=J, m=M, m_axle=LOAD, T_max=T_MAX, tau=0.06, gate=0.35, lost=T_MAX, react=0.6)


@lru_cache(maxsize=16)
def judge(driven: bool, ticks: int):
    """``trust`` of four axles over some ticks, and the block."""
    block = trust(4, driven).with_params(**NUMBERS)
    return block, block.f.mapaccum(ticks)


class Car:
    """What four axles of a car read that rolls and brakes by its torque, a row per tick."""

    def __init__(self, command, speed: float = 16.0, driven: bool = False) -> None:
        self.driven, self.ticks, self.given = driven, len(command), None
        self.command = np.array(command, dtype=float)
        self.T_b, self.v = np.zeros((self.ticks, 4)), np.zeros(self.ticks)
        torque, sense = 0.0, 1 if driven else -1
        for k, c in enumerate(command):
            torque += H / 0.06 * (c - torque)
            speed = max(speed + sense * H * torque / R / (M + J / R**2), 0.0)
            self.v[k], self.T_b[k] = speed, torque
        self.omega = np.repeat(self.v[:, None], 4, axis=1) / R
        self.T_demand = self.command.copy()

    def judged(self, start: float = 16.0, r: float = R, **states) -> dict[str, np.ndarray]:
        """What is believed of it, a row per tick."""
        block, run = judge(self.driven, self.ticks)
        last = np.r_[0.0, self.command[:-1]][:, None].repeat(4, axis=1)
        last = last if self.given is None else self.given
        given = {"v": self.v, "omega": self.omega, "T_b": self.T_b, "T_demand": self.T_demand,
                 "T_cmd": last}  # fmt: skip
        u = np.column_stack([given[n] for n in block.inputs])
        x = block.pack("state", block.start(v_h=start, omega_h=start / R, **states))
        p = block.pack("param", block.param_values() | {"r": r})
        y = np.array(run(x, u.T, ca.repmat(p, 1, self.ticks))[1].full()).T
        found, at = {}, 0
        for n, s in block.outputs.items():
            found[n] = y[:, at : at + s.size] if s.shape else y[:, at]
            at += s.size
        return found


anything = st.one_of(st.floats(), st.floats(-500, 500), st.sampled_from([0.0, 38.0, 1e308]))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(anything, anything), min_size=1, max_size=40), st.booleans())
def test_any_bits_of_one_axle_change_nothing_of_the_others(samples, driven):
    car = Car([4e3] * 400, driven=driven)
    right = car.judged()
    for k in range(400):
        car.omega[k, 0], car.T_b[k, 0] = samples[k * len(samples) // 400]
    wrong = car.judged()
    assert all(np.isfinite(v).all() for v in wrong.values())
    assert (np.abs(wrong["rim"]) < 1e3).all()
    for n in ("rim", "T_b", "ready", "ok"):
        np.testing.assert_array_equal(wrong[n][:, 1:], right[n][:, 1:])
    np.testing.assert_array_equal(wrong["v"], right["v"])
    assert (wrong["demand"] == 4e3).all()


@pytest.mark.parametrize("driven", [False, True])
def test_a_wheel_that_passes_the_vehicle_moves_no_speed_while_the_others_slide(driven):
    """Half as fast again, or half as fast where driven; no other wheel speaks for the sensor."""
    car, sense = Car([4e3] * 1500, driven=driven), -1 if driven else 1
    share = 1 - sense * 0.1 * np.clip(np.arange(1500) / 200 - 2, 0, 1)  # rim by vehicle speed
    car.v *= (M + J / R**2) / (M + share * J / R**2)  # the sum of momenta stays
    car.omega = np.repeat((share * car.v)[:, None], 4, axis=1) / R
    car.omega[700:, 0] *= 1 + sense * 0.5
    got = car.judged()
    assert got["v_ok"].all()
    assert (np.abs(got["v"] - car.v) < 0.05).all()
    assert got["ok"][-1].tolist() == [0, 1, 1, 1]


@settings(max_examples=40, deadline=None)
@given(anything, st.floats(0, 5e3))
@pytest.mark.second
def test_any_vehicle_speed_leaves_a_speed_near_the_truth(value, command):
    """Whatever the sensor reads from some tick on, all axles go by a speed that is near."""
    car = Car([command] * 2500)
    true = car.v.copy()
    car.v[500:] = value
    got = car.judged()
    assert (np.abs(got["v"] - true) < 0.75).all()
    assert got["ready"][500:].all()


@pytest.mark.parametrize(
    "read",
    [lambda v, t: 0 * v + 16.0, lambda v, t: 1.05 * v, lambda v, t: v + 0.9,
     lambda v, t: v + 0.5 * t, lambda v, t: 0 * v + 100.0, lambda v, t: v * math.nan,
     lambda v, t: 0 * v],
    ids=["frozen", "5 % high", "off", "drifts", "jumps", "missing", "zero"],
)  # fmt: skip
def test_a_wrong_vehicle_speed_is_told_and_replaced(read):
    car = Car([0.0] * 1000 + [5e3] * 4000)
    true = car.v.copy()
    car.v[1000:] = read(true[1000:], H * np.arange(4000))
    got = car.judged()
    off = np.abs(got["v"] - true)
    assert got["v_ok"][-1] == 0
    assert off.max() < 1.2  # of one that drifts by .5 m/s^2; half of the slip that is held
    assert off[4000:].max() < 0.3


def test_a_frozen_vehicle_speed_is_seen_before_slip_control_takes_it_for_slip():
    """At 1.2 m/s^2 wheels and momentum move by the 0.1 m/s within a tenth of a second."""
    car = Car([0.0] * 300 + [5e3] * 1200)
    car.v[1000:] = car.v[1000]
    got = car.judged()
    true = car.omega[:, 0] * R
    assert (np.abs(got["v"] - true) < 0.15).all()
    assert got["v_ok"][-1] == 0


def test_a_vehicle_speed_that_stays_because_the_vehicle_does_is_no_fault():
    """Rolling at one speed against a gradient that the brake holds, told in steps of 0.1 m/s."""
    car = Car([1.5e3] * 3000)
    car.v[:] = 16.0
    car.omega[:] = 16.0 / R
    assert car.judged()["v_ok"].all()


@pytest.mark.parametrize("driven", [False, True])
def test_a_train_that_is_released_as_a_whole_tries_the_demand_after_its_limit(driven):
    """All axles together are let go; a falling demand is no release."""
    car = Car([200.0] * 6500, driven=driven)
    car.T_demand[:] = 5e3
    retry = car.judged()["retry"]
    assert np.flatnonzero(retry)[0] * H == pytest.approx(5.0, abs=0.05)
    assert retry.sum() * H == pytest.approx(1.0, abs=0.01)
    car = Car(np.linspace(5e3, 0, 6500), driven=driven)
    assert not car.judged()["retry"].any()


def test_without_sensors_the_speed_falls_by_the_running_resistance():
    """As dv/dt = -c v^2 has it; a vehicle that stands is not moved by it."""
    block, c, ticks = trust(1, False).with_params(**NUMBERS, resist_2=4e-4), 4e-4, 1000
    alike, run = block.with_params(resist_0=0.5), block.f.mapaccum(ticks)
    u = block.pack("input", dict.fromkeys(block.inputs, math.nan) | {"T_cmd": 0.0, "T_demand": 0.0})
    for found, start, end in ((block, 40.0, 40 / (1 + c * 40 * ticks * H)), (alike, 0.0, 0.0)):
        x = found.pack("state", found.start(v_h=start, age=1.0))
        p = ca.repmat(found.pack("param", found.param_values()), 1, ticks)
        last = run(x, ca.repmat(u, 1, ticks), p)[0][:, -1]
        at = sum(n.size for n in list(found.states.values())[: list(found.states).index("v_h")])
        assert float(last[at]) == pytest.approx(end, rel=1e-4, abs=1e-9)


def test_the_first_tick_takes_any_speed():
    for speed in (2.0, 16.0, 44.0):
        car = Car([3e3] * 40, speed=speed)
        got = car.judged(start=16.0)
        assert got["v"][0] == car.v[0]
        ready = got["ready"].all(axis=1)
        assert not ready[0]
        assert ready[-1]
        assert (~ready).sum() == round(SETTLED / H) - 1


def test_a_wheel_that_is_worn_is_learnt_while_it_rolls_and_no_more_than_it_can_be():
    for ratio in (0.92, 1.06, 0.7):
        car = Car([0.0] * 400)
        car.omega[:, 0] /= ratio
        got = car.judged()
        if abs(ratio - 1) <= WORN:
            assert abs(got["rim"][-1, 0] / car.v[-1] - 1) < 0.004
            assert got["ok"][-1].all()
        else:
            assert got["ok"][-1].tolist() == [0, 1, 1, 1]  # it is ahead of the vehicle


@pytest.mark.parametrize("r", [0.40, 0.44])
def test_a_radius_that_is_tuned_in_motion_changes_no_slip(r):
    """What a wheel's radius is was learnt; what a controller takes it for does not change it."""
    car = Car([5e3] * 800)
    got = car.judged(r=r, radius=R, learnt=1.0)
    assert (np.abs(got["rim"] - car.v[:, None]) <= 0.004 * car.v[:, None]).all()


def test_a_wheel_that_was_learnt_is_not_learnt_anew_by_a_reading_that_passes_the_vehicle():
    car = Car([0.0] * 200 + [4e3] * 2800, speed=8.0)
    car.omega[1000:2000, 0] *= 1.1
    rim = car.judged(start=8.0)["rim"]
    assert (np.abs(rim[2300:, 0] - car.v[2300:]) < 0.1).all()


def test_a_wheel_speed_of_the_wrong_sign_is_never_believed():
    """As the vehicle slows down such a reading seems to run up; no wheel turns back at speed."""
    car = Car([4e3] * 6000, speed=20.0)
    car.omega[500:, 0] *= -1
    got = car.judged(start=20.0)
    assert not got["ok"][500 + round(HOLD / H) :, 0].any()
    assert got["ok"][:, 1:].all()


def sliding_alone(axles: int) -> tuple[Car, dict[str, np.ndarray]]:
    """Some axles read 10 % low from 1 s on, and slip control holds them at 3 of 5 kN m."""
    car = Car([5e3] * 3000)
    car.T_demand[:] = 5e3
    car.given = np.full((3000, 4), 5e3)
    car.omega[1000:, :axles] *= 0.9
    for k in range(axles):
        car.given[1000:, k] = 3e3
        car.given[1000 + round(DOUBT / H) + 40 :, k] = 0.0
        for j in range(1000, 3000):
            car.T_b[j, k] = car.T_b[j - 1, k] + H / 0.06 * (car.given[j, k] - car.T_b[j - 1, k])
    return car, car.judged()


def test_an_axle_that_slides_alone_for_long_is_let_go_and_told_if_it_does_not_run_up():
    _, got = sliding_alone(1)
    assert np.flatnonzero(got["test"][:, 0])[0] * H == pytest.approx(1 + DOUBT, abs=0.1)
    assert np.flatnonzero(got["ok"][:, 0] == 0)[0] * H < 1 + DOUBT + 0.6
    assert not got["test"][-1].any()  # it ends with that
    assert not got["test"][:, 1:].any()
    assert got["ok"][:, 1:].all()
    assert (got["v_ok"] == 1).all()


def test_no_axle_is_let_go_for_that_while_more_than_half_slide():
    """They do on a long slippery place; there each is where slip control wants it."""
    assert not sliding_alone(3)[1]["test"].any()


def held_at_four_percent(demand: float) -> tuple[Car, np.ndarray]:
    """All wheels of a car slip by 4 % from .5 s on, braked by 4 kN m of what is demanded."""
    car = Car([4e3] * 4000)
    slip = np.clip((np.arange(4000) - 500) / 500, 0, 1)[:, None] * 0.04
    car.omega *= 1 - slip
    car.T_demand[:] = demand
    return car, car.v.copy()


def test_wheels_that_slip_control_holds_do_not_pull_the_speed_down():
    """Those that carry their demand do: they are taken for wheels that roll."""
    car, true = held_at_four_percent(8e3)
    car.v[1200:] = math.nan
    assert np.abs(car.judged()["v"] - true).max() < 0.2
    car, true = held_at_four_percent(4e3)
    car.v[1200:] = math.nan
    assert car.judged()["v"][-1] < true[-1] - 0.4


@pytest.mark.parametrize("released", [True, False])
def test_an_axle_that_ran_up_speaks_for_a_speed_that_jumps_to_its_own(released):
    """A jump alone is a broken sensor."""
    car, true = held_at_four_percent(8e3)
    car.omega[:1000] = 0.96 * true[:1000, None] / R  # from the start, so that no radius is learnt
    car.v[:2900] -= 0.7
    if released:
        car.given = np.full((4000, 4), 4e3)
        car.given[2500:, 3] = 0.0
        for k in range(2500, 4000):
            car.T_b[k, 3] = car.T_b[k - 1, 3] * (1 - H / 0.06)
        car.omega[2700:, 3] = np.minimum(car.omega[2700:, 3] + 5.0 * H / R * np.arange(1300),
                                         true[2700:] / R)  # fmt: skip
    got = car.judged(start=15.3)
    assert got["v_ok"][2890] == 1
    assert (got["v_ok"][3200] == 1) == released
    assert (abs(got["v"][3200] - true[3200]) < 0.05) == released


def test_a_dead_wheel_speed_is_held_and_then_not_gone_by():
    car = Car([4e3] * 1600)
    car.omega[500:1500, 0] = math.nan
    ready = car.judged()["ready"]
    assert ready[500:, 1:].all()
    assert np.flatnonzero(ready[500:, 0] == 0)[0] == pytest.approx(HOLD / H, abs=1)
    assert ready[-1].all()


def test_a_wheel_let_go_that_does_not_run_up_is_a_dead_sensor():
    """One that stands on zero from the start, while nothing brakes it."""
    car = Car([0.0] * 400)
    car.omega[:, 0] = 0.0
    got = car.judged()
    assert got["ok"][-1].tolist() == [0, 1, 1, 1]
    assert got["v"][-1] == car.v[-1]


def test_a_demand_that_is_no_number_is_held_and_then_the_largest():
    car = Car([2e3] * 400)
    car.T_demand[100:] = math.nan
    got = car.judged()
    assert (got["demand"][:299] == 2e3).all()
    assert (got["demand"][302:] == T_MAX).all()
    assert got["demand_ok"][:100].all()
    assert not got["demand_ok"][100:].any()


def test_a_brake_that_does_not_follow_is_told_within_a_second():
    for stuck in (0.0, 7e3):
        car = Car([3e3] * 1500)
        car.T_b[500:, 0] = stuck
        got = car.judged()["follows"]
        assert got[:800].all()
        assert got[-1].tolist() == [0, 1, 1, 1]


# ---- the command ---------------------------------------------------------------------------------


class Command:
    """``safe`` of one axle, tick by tick."""

    def __init__(self, mode="demand", **numbers) -> None:
        self.block = safe_command(mode).with_params(T_max=T_MAX, **numbers)
        self.x = self.block.pack("state", self.block.start())
        self.p = self.block.pack("param", self.block.param_values())

    def tick(self, slip: float, demand: float, **others: float) -> float:
        u = {"T_slip": slip, "T_demand": demand, "on": 1, "ready": 1, "sound": 1, "stands": 0,
             "v": 10.0, "retry": 0, "test": 0} | others  # fmt: skip
        self.x, y = self.block.f(self.x, self.block.pack("input", u), self.p)
        return float(self.block.unpack("output", y)["T_cmd"])


@given(st.lists(st.tuples(st.floats(0, 2e4), st.floats(-1e4, 2e4), *[st.sampled_from([0, 1])] * 4,
                          st.floats(-1, 60)), min_size=1, max_size=60),
       st.sampled_from(["demand", "hold", 0.0, 2e3]))  # fmt: skip
@settings(deadline=None)
def test_release_by_the_driver_always_works(rows, mode):
    command = Command(mode)
    for slip, demand, on, ready, sound, stands, v in rows:
        got = command.tick(slip, demand, on=on, ready=ready, sound=sound, stands=stands, v=v)
        assert 0 <= got <= min(max(demand, 0), T_MAX)


def test_an_axle_without_samples_gets_the_demand_within_a_tenth_of_a_second():
    command = Command()
    for _ in range(100):
        command.tick(0.0, 5e3)
    got = [command.tick(0.0, 5e3, ready=0, on=0) for _ in range(100)]
    assert got[0] < 500
    assert got[-1] == 5e3
    assert [
        Command("hold").tick(0.0, 5e3, ready=0, on=0),
        Command(1e3).tick(0.0, 5e3, ready=0, on=0),
    ] == [5e3, 1e3]


def test_an_axle_that_is_tested_is_let_go_and_the_driver_s_demand_stays_its_limit():
    command = Command()
    command.tick(3e3, 5e3)
    assert command.tick(3e3, 5e3, test=1) == 0
    assert command.tick(3e3, 2e3, test=0) == 2e3
    assert command.tick(3e3, 5e3, test=1, ready=0, on=0) > 0  # it is not slip control's any more


@given(st.floats(0, 8e3), st.floats(5, 40))
@settings(deadline=None, max_examples=20)
@pytest.mark.second
def test_an_integral_begins_at_the_torque_that_the_rail_carries(torque, v):
    """At its reference a PI law gives in its first tick what it begins with, not zero."""
    wheel = form.SAMPLE._replace(v=v)
    law = begun_at_torque(form.laws()["pid"](wheel), "law.integral", -1.0)
    x, p = law.pack("state", law.start()), law.pack("param", law.param_values())
    best = float(law.start()["reference.limited"]) * v
    u = {n: 0.0 if s.value is None else s.value for n, s in law.inputs.items()}
    u |= {"v": v, "v_s": best, "v_best": best, "T_begin": torque}
    _, y = law.f(x, law.pack("input", u), p)
    assert float(law.unpack("output", y)["T_wanted"]) == pytest.approx(torque, abs=1.0)


def test_the_first_command_is_the_demand():
    assert Command().tick(0.0, 5e3, ready=0, on=0) == 5e3


def test_below_the_cut_off_the_demand_is_given():
    command = Command()
    for _ in range(100):
        command.tick(300.0, 5e3)
    got = [command.tick(300.0, 5e3, v=0.9, on=0) for _ in range(200)]
    assert max(np.diff([300.0, *got])) <= 12 * T_MAX * H * (1 + 1e-9)
    assert got[-1] == 5e3


@pytest.mark.second
@pytest.mark.parametrize(("stands", "limit"), [(0, 10.0), (1, 3.0)])
@pytest.mark.others("long")
def test_a_release_has_a_limit_and_is_tried_again(stands, limit):
    command = Command()
    got = np.array([command.tick(0.0, 5e3, stands=stands) for _ in range(round(2.3 * limit / H))])
    released = got < 500
    edges = np.flatnonzero(np.diff(np.r_[0, released, 0]))
    longest = max(b - a for a, b in zip(edges[::2], edges[1::2], strict=True)) * H
    assert longest <= limit + 0.01
    assert (got > 0.9 * 5e3).sum() > 0.5 / H  # the demand came in between
    assert len(edges) >= 4  # and slip control after it


@pytest.mark.second
def test_holding_a_wheel_at_its_slip_is_no_release():
    command = Command()
    rng = np.random.default_rng(1)
    got = [command.tick(1500 + 300 * rng.standard_normal(), 5e3) for _ in range(15_000)]
    assert max(got) < 4e3


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize(("apart", "told"), [(1, False), (3, True), (10, True)])
def test_a_controller_that_is_called_too_seldom_says_so(apart, told, driven):
    """Made for 1 ms, with 5 kN m on each axle: within 5 s; in its own time never."""
    car = Car([5e3] * 5000, speed=18.0, driven=driven)
    car.v, car.omega, car.T_b = car.v[::apart], car.omega[::apart], car.T_b[::apart]
    car.command, car.T_demand = car.command[::apart], car.T_demand[::apart]
    car.ticks = len(car.command)
    paced = car.judged(start=18.0)["paced"]
    assert (np.diff(paced) <= 0).all()  # told once, to the end
    assert bool(paced[-1] < 0.5) is told


@pytest.mark.parametrize("slope", [-0.5, 0.5])
def test_no_gradient_and_no_wrong_mass_looks_like_calls_too_seldom(slope):
    """5 % up or down, and a vehicle that is a fifth lighter than believed."""
    car = Car([5e3] * 5000, speed=18.0)
    car.v = np.maximum(18.0 - 1.25 * (18.0 - car.v) - slope * H * np.arange(car.ticks), 0.0)
    car.omega = np.repeat(car.v[:, None], 4, axis=1) / R
    assert car.judged(start=18.0)["paced"].all()


def _commanded(mode, driven, x, u, p):
    """Next states and command of one axle, from what is promised of them, in plain Python."""
    top = min(max(u["T_demand"], 0), p["T_max"])
    held = x["back"] <= 0 and u["retry"] < 0.5
    relied = u["ready"] > 0.5 and u["sound"] > 0.5 and held and u["v"] >= p["v_off"]
    if relied:
        wanted = 0.0 if u["test"] > 0.5 else min(u["T_slip"], top)
    elif mode == "demand" or (u["ready"] > 0.5 and (not driven or (held and u["sound"] > 0.5))):
        wanted = top
    else:
        wanted = min(x["T_h"] if mode == "hold" else float(mode), top)
    slowly = (not relied or x["slow"] > 0.5) and u["on"] < 0.5
    gets = min(wanted, x["T_h"] + p["rate"] * p["T_max"] * p["T"]) if slowly else wanted
    low = gets < 0.1 * top or gets < x["T_h"]
    lets = relied and u["on"] > 0.5 and top > 0.02 * p["T_max"] and low
    time = x["let_go"] + p["T"] if lets else 0.0
    longest = min(p["limit"], p["limit_still"]) if u["stands"] > 0.5 else p["limit"]
    over = time >= longest
    after = {
        "T_h": gets, "let_go": 0.0 if over else min(time, p["limit"]),
        "back": p["again"] if over else max(x["back"] - p["T"], 0.0),
        "slow": float(slowly and wanted > gets),
    }  # fmt: skip
    return after, {"T_cmd": gets, "released": float(not held)}


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("mode", ["demand", "hold", 700.0])
def test_a_command_is_what_is_promised_of_it(mode, driven):
    """Random states and inputs, many of them at the edge of a condition."""
    block = safe_command(mode, driven).with_params(T_max=1000.0, T=0.01)
    p, rng = {k: float(v) for k, v in block.param_values().items()}, np.random.default_rng(8)
    for _ in range(300):
        bits = {k: float(rng.random() < 0.7) for k in ("ready", "sound")}
        bits |= {k: float(rng.random() < 0.3) for k in ("retry", "test", "stands")}
        top = rng.choice([0.0, 19.0, 21.0, 1200.0, rng.uniform(0, 1000)])
        x = {
            "T_h": rng.choice([0.0, rng.uniform(0, 1000), 0.09 * top]),
            "let_go": rng.choice([0.0, 2.985, 2.995, 9.985, 9.995, rng.uniform(0, 10)]),
            "back": rng.choice([0.0, 0.0, 0.005, 0.5]), "slow": float(rng.random() < 0.5),
        }  # fmt: skip
        share = rng.choice([0.09, 0.105, 0.11, 0.5, 1.0, 1.2])
        u = bits | {
            "T_demand": top, "T_slip": share * top, "on": float(rng.random() < 0.6),
            "v": rng.choice([0.99, 1.0, 1.05, 20.0]),
        }  # fmt: skip
        x_next, y = block.f(block.pack("state", x), block.pack("input", u), block.pack("param", p))
        after, said = _commanded(mode, driven, x, u, p)
        for found, wanted in ((block.unpack("state", x_next), after),
                              (block.unpack("output", y), said)):  # fmt: skip
            assert {k: float(v) for k, v in found.items()} == pytest.approx(wanted, abs=1e-12)
