"""What is believed of the samples of one axle: its wheel speed, its torque, its radius.

A sample is judged by its range, and by what brake and rail can make of a wheel. Then it is held
against the speed of the vehicle: a braked wheel does not pass it, and one that is let go runs up.
An axle that is held far below its demand while others roll is let go for that, to see whether it
does. The radius is learnt in metres while the wheel rolls, so that it is a matter of the wheel
alone, whatever radius a controller has been given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

from casadi import fabs, fmax, fmin, if_else, logic_and, logic_not, logic_or

from slipctl import Input, Output, Param, Signal, State
from slipctl.models.common_form import ADDED
from slipctl.models.vehicle.wheels import taught_mean

HOLD = 0.2
"""Seconds for which the last good value of an input stands for a bad one."""

ASKS = 0.02
"""Share of the largest torque up to which a demand is none."""

NEVER = 1e3
"""A time in s that no limit is above: longer ones are not counted."""

WORN = 0.1
"""Share by which a wheel may be smaller or larger than its controller takes for true."""

SETTLED = 0.02
"""Seconds for which samples are good before slip control goes by them: the window of the meter."""

BACK = 2.0
"""Speed in m/s at which a vehicle rolls back at most; no wheel turns back faster than that."""

DOUBT = 1.0
"""Seconds for which an axle slides alone before it is let go to see whether it runs up."""

TEST = 0.7
"""Seconds that this may take."""

RUNS_UP = 2.0
"""Acceleration of a rim in m/s^2 by which an axle that is let go runs up, as on a rail of 0.01."""

RUN_UP = 0.5
"""Seconds for which a wheel is without torque before it is taken for one that rolls."""

AGAIN = 60.0
"""Seconds for which an axle that ran up is not asked again: on leaves leading axles slide alone."""

SPEAKS = 1.0
"""Seconds for which an axle that was let go and ran up speaks for a speed like its own."""


def all_hold(conditions: Sequence[Any]) -> Any:
    """Whether all conditions hold."""
    return reduce(logic_and, conditions)


def clip_to_range(x: Any, lo: Any, hi: Any) -> Any:
    """Number, or the end of its range that is nearest to it."""
    return fmin(fmax(x, lo), hi)


def time_without_break(condition: Any, time: Any, T: Any) -> Any:
    """Time in s for which a condition has held without a break."""
    return if_else(condition, fmin(time + T, NEVER), 0)


def named_signals(**signals: Signal) -> list[Signal]:
    """Signals with the names that they are given by."""
    return [s.named(n) for n, s in signals.items()]


def axle_signals(n: int) -> list[Signal]:
    """States, inputs, parameters and outputs that concern the axles, ``n`` of them."""
    each = (n,)
    return named_signals(
        omega_h=State("rad/s", "omega_start", "last wheel speed that was believed", shape=each),
        out=State("s", NEVER, "time without a wheel speed to believe", shape=each),
        good=State("s", 0.0, "time with one", shape=each),
        radius=State("m", "r", "radius by the vehicle's speed while it rolls", shape=each),
        learnt=State("s", 0.0, "time that it was learnt in", shape=each),
        mean=State("rad/s", "omega_start", "wheel speed, filtered", shape=each),
        still=State("s", 0.0, "time that a wheel let go has not run up in", shape=each),
        freed=State("s", NEVER, "time without a torque", shape=each),
        up=State("s", 0.0, "time left in which one that has run up speaks", shape=each),
        doubt=State("s", 0.0, "time that it has been sliding alone; below 0 after it ran up",
                    shape=each),
        ban=State("s", 0.0, "time for which its speed is not to be believed", shape=each),
        torque=State("N m", 0.0, "torque, as the commands have it", shape=each),
        odd=State("s", 0.0, "time that the measured torque has been another", shape=each),
        omega=Input("rad/s", "measured wheel speed", shape=each, judged=True),
        T_b=Input("N m", "measured torque", positive="braking", shape=each, judged=True),
        T_cmd=Input("N m", "last command", positive="braking", shape=each),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1, shape=each),
        J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
        m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=100, hi=1e8),
        g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
        tau=Param("s", 0.05, "time constant of the actuator", ADDED, lo=1e-3, hi=5),
        T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
        react=Param("s", 0.8, "time to follow a command in", ADDED, lo=0.01, hi=10),
        other=Param("1", 0.25, "share of the largest torque that it may be off by", ADDED, lo=0.01,
                    hi=1),
        noise=Param("rad/s", 0.5, "what a wheel's sensor may be off by", ADDED, lo=0, hi=100,
                    shape=each),
        slow=Param("rad/s", 20.0, "below this speed it may be off by more", ADDED, lo=0, hi=1e3,
                   shape=each),
        noise_slow=Param("rad/s", 5.0, "that much more", ADDED, lo=0, hi=1e3, shape=each),
        alike=Param("1", 0.003, "wheels that differ by less are equal", ADDED, lo=0, hi=0.1),
        most=Param("rad/s", 430.0, "largest speed of a wheel", ADDED, lo=1, hi=5000, shape=each),
        omega_start=Param("rad/s", 40.0, "wheel speed at the start", ADDED, lo=0, hi=1e3,
                          shape=each),
    ) + named_signals(
        rim=Output("m/s", "believed speed of the rim", shape=each),
        T_b=Output("N m", "torque that is believed", positive="braking", shape=each),
        ready=Output("1", "1 where slip control can go by the samples", shape=each, lo=0, hi=1),
        ok=Output("1", "1 where the axle's own samples are believed", shape=each, lo=0, hi=1),
        follows=Output("1", "1 where the torque follows its command", shape=each, lo=0, hi=1),
        stands=Output("1", "1 where a wheel let go does not run up", shape=each, lo=0, hi=1),
        test=Output("1", "1 where it is let go to see whether it runs up", shape=each, lo=0, hi=1),
        ratio=Output("1", "speed of the vehicle over that of a wheel that rolls", shape=each),
    )  # fmt: skip


class AxleSample:
    """What is believed of one axle within a tick; numbers as expressions."""

    def __init__(self, k: int, s: Mapping[str, Any], turn: int) -> None:
        """Judge the sample of axle ``k`` by its range and by what can move a wheel.

        Args:
            k: number of the axle.
            s: signals by name.
            turn: 1 for a braked vehicle, -1 for a driven one.
        """
        self.s, self.k, self.turn = s, k, turn
        self.r, self.slower = s["r"][k], s["noise_slow"][k]
        self.rail = self.r * s["m_axle"] * s["g"]
        self._torque()
        last, out = s["omega_h"][k], s["out"][k]
        self.can = self._can_be(s["omega"][k], last, out)
        self.omega = if_else(self.can, s["omega"][k], last)
        turned, before = self.omega - last, out < NEVER
        self.step = if_else(before, turned, 0)
        beside = s["radius"][k] / self.r - 1
        self.ratio = clip_to_range(
            1 + beside - clip_to_range(beside, -s["alike"], s["alike"]), 1 - 2 * WORN, 1 + 2 * WORN
        )
        self.speed = self.ratio * self.r * self.omega
        self.candidate = logic_and(self.can, s["ban"][k] <= 0)
        slowed = if_else(out >= NEVER, turn * self.omega, s["mean"][k])
        self.mean = slowed + fmin(s["T"] / 0.1, 1) * (turn * self.omega - slowed)
        self.gain = self.r * (turn * self.omega - self.mean) / 0.1
        runs_up = all_hold([self.candidate, self.free, self.gain > RUNS_UP])
        self.up = if_else(runs_up, SPEAKS, fmax(s["up"][k] - s["T"], 0))
        self.ran_up = all_hold([self.candidate, self.up > 0, self.gain <= RUNS_UP])
        top = clip_to_range(s["T_demand"], 0, s["T_max"])
        self.demanded = s["T_cmd"][k] >= 0.9 * top

    def _can_be(self, raw: Any, last: Any, out: Any) -> Any:
        """Whether a wheel can have that speed, so long after the last one that was believed."""
        s, k, T_max = self.s, self.k, self.s["T_max"]
        braked = 1.25 * fmax(fmax(self.torque, self.modelled), 0) + 0.05 * T_max
        way = (out + s["T"]) / s["J"]
        noise = s["noise"][k] + if_else(fabs(last) < s["slow"][k], self.slower, 0)
        there = self.turn * (raw - last)
        moved = all_hold([there >= -(braked + 0.1 * self.rail) * way - noise,
                      there <= (0.05 * T_max + 0.6 * self.rail) * way + noise])  # fmt: skip
        back = BACK / self.r + s["noise"][k] + self.slower
        ranged = logic_and(raw >= -fmin(back, s["most"][k]), raw <= s["most"][k])
        return logic_and(ranged, logic_or(moved, out >= NEVER))

    def _torque(self) -> None:
        """Torque: as measured while that follows the command, else as the command has it."""
        s, k = self.s, self.k
        given = s["T_b"][k]
        self.modelled = s["torque"][k] + fmin(s["T"] / s["tau"], 1) * (
            s["T_cmd"][k] - s["torque"][k]
        )
        ranged = logic_and(given >= -1.25 * s["T_max"], given <= 1.25 * s["T_max"])
        given = if_else(ranged, given, s["torque"][k])
        apart = logic_or(logic_not(ranged), fabs(given - self.modelled) > s["other"] * s["T_max"])
        self.odd = time_without_break(apart, s["odd"][k], s["T"])
        self.follows = self.odd < s["react"]
        self.torque = if_else(logic_and(ranged, self.odd < 0.3), given, self.modelled)
        self.free = fmax(fabs(self.torque), fabs(self.modelled)) < fmin(
            0.05 * s["T_max"], 0.02 * self.rail
        )

    def judge(self, v: Any, sure: Any) -> None:
        """Judge it by the vehicle's speed: it does not pass it, and runs up when it is let go."""
        s, k = self.s, self.k
        speed = fabs(v)
        slip = self.turn * (v - self.speed)
        known = s["learnt"][k] >= SETTLED
        self.taken = logic_and(self.can, slip >= -(if_else(known, 0.03, WORN) * speed + 0.6))
        self.out = if_else(self.taken, 0, fmin(s["out"][k] + s["T"], NEVER))
        self.slides = logic_and(self.taken, slip > fmax(0.6, 0.04 * speed))
        idle = all_hold([self.slides, self.free, self.gain < 0.5])
        self.still = time_without_break(idle, s["still"][k], s["T"])
        self.dead = self.still > 0.25
        self._learn(v, sure, known, slip < -(0.01 * speed + 0.2))

    def _learn(self, v: Any, sure: Any, known: Any, passes: Any) -> None:
        """Learn the radius while the wheel rolls; or, where it never has, as it passes."""
        s, k = self.s, self.k
        now = v / if_else(fabs(self.omega) > 1, self.omega, 1)  # at least 3 m where it stands
        near = fabs(now - self.r) <= WORN * self.r
        usable = all_hold([self.taken, sure, fabs(v) > 3, near])
        # on leaves a wheel runs up so slowly that for a while it looks like one that rolls
        self.freed = time_without_break(self.free, s["freed"][k], s["T"])
        rolls = all_hold([usable, self.freed > RUN_UP, fabs(self.gain) < 3])
        ahead = all_hold([usable, passes, logic_not(known), logic_not(rolls)])
        radius, self.learnt = taught_mean(s["radius"][k], now, s["learnt"][k], rolls, s["T"], 1.0)
        self.radius = if_else(ahead, s["radius"][k] + fmin(2 * s["T"], 1) * (now - s["radius"][k]),
                              radius)  # fmt: skip

    def doubt(self, alone: Any, demand: Any) -> None:
        """Let it go for a moment where it has been sliding alone for long: does it run up?

        Args:
            alone: whether at least half of the axles roll.
            demand: torque in N m that is demanded of it.
        """
        s, k = self.s, self.k
        held = all_hold([self.slides, alone, demand > ASKS * s["T_max"],
                         s["T_cmd"][k] < 0.9 * demand, s["ban"][k] <= 0])  # fmt: skip
        before = s["doubt"][k]
        runs_up = logic_or(logic_not(self.slides), logic_and(self.free, self.gain > RUNS_UP))
        ran_up = logic_and(before > DOUBT, runs_up)
        counted = if_else(held, before + s["T"], 0)
        time = if_else(before < 0, fmin(before + s["T"], 0), counted)
        time = if_else(ran_up, -AGAIN, time)
        self.doubted = if_else(time > DOUBT + TEST, 0, time)
        self.test = self.doubted > DOUBT
