"""What a vehicle's slip control believes, and what it does where it cannot.

    v, omega, T, T_demand -> trust -> slip control of each axle -> safe -> T_cmd

``trust`` judges every input before anything else sees it, and hands on numbers that are finite
and in their ranges. What it does not believe of one axle stays with that axle, and the vehicle's
speed has a fall-back of its own. ``safe`` (:mod:`slipctl.models.vehicle.safe_output`) gives an axle
its demand where slip control cannot be relied on.

The speed that is believed follows from the momentum of vehicle and wheels together. The rail turns
one into the other, so their sum changes by the brakes alone, whatever the adhesion is:

    v + sum_i J omega_i / (r m) falls by (sum_i T_i / (r m) + b) each second

with a slow b for gradient, resistance and mass. A wheel that slides does not disturb it, and a
wrong vehicle speed does. So the two can be told from each other, which no comparison of speeds
can do.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from casadi import SX, fabs, fmax, fmin, if_else, logic_and, logic_not, logic_or, sum1, vertcat

from slipctl import Block, Input, Output, Param, State, step
from slipctl.models.common_form import ADDED, T_S

HOLD = 0.2
"""Seconds for which the last good value of an input stands for a bad one."""

NEVER = 1e3
"""A time in s that no limit is above: longer ones are not counted."""

DRAG = 1.0
"""Largest deceleration in m/s^2 by gradient, resistance and a wrong mass together."""

WORN = 0.1
"""Share by which a wheel may be smaller or larger than its controller takes for true."""

SETTLED = 0.02
"""Seconds for which samples are good before slip control goes by them: the window of the meter."""

BEHIND = 0.5
"""Slip in m/s of the wrong sign up to which a sample is taken for one of a wheel that rolls."""

MEASURED = 2.0
"""Largest adhesion that a sample may have: twice what steel on steel can."""


def all_hold(conditions: Sequence[Any]) -> Any:
    """Whether all conditions hold."""
    return reduce(logic_and, conditions)


def clip_to_range(x: Any, lo: Any, hi: Any) -> Any:
    """Number, or the end of its range that is nearest to it."""
    return fmin(fmax(x, lo), hi)


def time_without_break(condition: Any, time: Any, T: Any) -> Any:
    """Time in s for which a condition has held without a break."""
    return if_else(condition, fmin(time + T, NEVER), 0)


class _Axle:
    """What trust knows of one axle within a tick; numbers as expressions."""

    def __init__(self, k: int, s: dict[str, Any], turn: int) -> None:
        """Judge the sample of axle ``k`` by its range and by what can move a wheel."""
        self.s, self.k, self.turn = s, k, turn
        T, J, T_max = s["T"], s["J"], s["T_max"]
        self.rail = s["r"] * s["m_axle"] * s["g"]
        self._torque()
        raw, last, out = s["omega"][k], s["omega_h"][k], s["out"][k]
        braked = 1.25 * fmax(fmax(self.torque, self.modelled), 0) + 0.05 * T_max
        way = (out + T) / J
        noise = s["noise"] + if_else(fabs(last) < s["slow"], s["noise_slow"], 0)
        there = turn * (raw - last)
        moved = all_hold([there >= -(braked + 0.1 * self.rail) * way - noise,
                      there <= (0.05 * T_max + 0.6 * self.rail) * way + noise])  # fmt: skip
        ranged = logic_and(raw >= -s["most"], raw <= s["most"])
        self.can = logic_and(ranged, logic_or(moved, out >= NEVER))
        self.omega = if_else(self.can, raw, last)
        self.step = if_else(out >= NEVER, 0, self.omega - last)
        beside = s["ratio"][k] - 1
        self.ratio = 1 + beside - clip_to_range(beside, -s["alike"], s["alike"])
        self.speed = self.ratio * s["r"] * self.omega
        self.candidate = logic_and(self.can, s["ban"][k] <= 0)
        slowed = if_else(out >= NEVER, turn * self.omega, s["mean"][k])
        share = fmin(T / 0.1, 1)
        self.mean = slowed + share * (turn * self.omega - slowed)
        self.gain = s["r"] * (turn * self.omega - self.mean) / 0.1

    def _torque(self) -> None:
        """Torque: as measured while that follows the command, else as the command has it."""
        s, k = self.s, self.k
        given = s["T_b"][k]
        self.modelled = s["torque"][k] + fmin(s["T"] / s["tau"], 1) * (
            s["T_cmd"][k] - s["torque"][k]
        )
        ranged = logic_and(given >= -1.25 * s["T_max"], given <= 1.25 * s["T_max"])
        given = if_else(ranged, given, s["torque"][k])
        apart = logic_or(logic_not(ranged), fabs(given - self.modelled) > 0.25 * s["T_max"])
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
        alike = if_else(s["learnt"][k] >= SETTLED, 0.03, WORN)
        self.taken = logic_and(self.can, slip >= -(alike * speed + 0.6))
        self.out = if_else(self.taken, 0, fmin(s["out"][k] + s["T"], NEVER))
        idle = all_hold([self.taken, self.free, slip > fmax(0.6, 0.04 * speed), self.gain < 0.5])
        self.still = time_without_break(idle, s["still"][k], s["T"])
        self.dead = self.still > 0.25
        rolls = all_hold([self.free, fabs(self.gain) < 3])
        passes = slip < -(0.01 * speed + 0.2)
        share = v / if_else(fabs(self.omega) > 1, s["r"] * self.omega, s["r"])
        usable = all_hold([self.taken, sure, speed > 3, fabs(share - 1) <= WORN])
        learning = logic_and(usable, rolls)
        self.learnt = if_else(learning, fmin(s["learnt"][k] + s["T"], 1), s["learnt"][k])
        rate = if_else(learning, s["T"] / fmax(self.learnt, s["T"]),
                       if_else(logic_and(usable, passes), fmin(2 * s["T"], 1), 0))  # fmt: skip
        self.learnt_ratio = s["ratio"][k] + rate * (share - s["ratio"][k])


def _lead(axles: Sequence[_Axle], turn: int) -> tuple[Any, Any, Any]:
    """Second of the axles that slip least, as a vehicle speed; how many are seen; their spread."""
    none = -1e4
    first, second, least, count = SX(none), SX(none), SX(-none), SX(0)
    for a in axles:
        here = if_else(a.candidate, turn * a.speed, none)
        second = fmax(second, fmin(first, here))
        first = fmax(first, here)
        least = fmin(least, if_else(a.candidate, turn * a.speed, -none))
        count = count + a.candidate
    lead = if_else(count >= 2, second, if_else(count >= 1, first, 0))
    return turn * lead, count, if_else(count >= 1, first - least, 0)


class _Vehicle:
    """What trust believes of the vehicle's speed within a tick."""

    def __init__(self, s: dict[str, Any], axles: Sequence[_Axle], turn: int) -> None:
        """Predict the speed by the momentum, and hold the sensor and the wheels against that."""
        self.s, self.turn, n = s, turn, len(axles)
        self.lead, self.count, self.spread = _lead(axles, turn)
        self.seen = logic_and(s["v"] >= -2, s["v"] <= s["fastest"])
        self.given = if_else(self.seen, s["v"], 0)
        share = 1 / (n * s["r"] * s["m"])
        pull = sum(a.torque for a in axles) * share
        wheels = s["J"] * share * sum(a.step for a in axles)
        predicted = s["v_h"] + s["T"] * (s["bias"] - turn * pull) - wheels
        self.begins = s["age"] <= 0
        self.predicted = if_else(self.begins, self._first(), predicted)
        self.speed = fabs(self.predicted)
        self.gate = s["gate"] + 0.005 * self.speed
        self._stay(self.predicted - s["v_h"])
        self.beside = self.given - self.predicted
        self.wheels = if_else(self.count >= 1, self.lead - self.predicted, 0)
        sure = reduce(fmin, [s["learnt"][a.k] for a in axles])
        ahead = turn * (self.lead - self.given)
        passed = logic_and(self.count >= 2, ahead > if_else(sure >= SETTLED, 0.03, WORN)
                           * self.speed + 0.6)  # fmt: skip
        self.apart = fabs(self.beside) > self.gate
        level = fabs(self.given - self.lead) <= self.gate
        self.alike = all_hold([self.seen, self.count >= 2, level])
        # wheels and sensor together are right against the prediction, whatever made it wrong
        self.near = all_hold([self.seen, logic_or(logic_not(self.apart), self.alike),
                              logic_not(passed), logic_not(self.frozen)])  # fmt: skip

    def _stay(self, change: Any) -> None:
        """Whether the sensor has stayed at one number while wheels and momentum have moved."""
        s = self.s
        same = fabs(self.given - s["given_h"]) <= 0
        self.moved = if_else(same, clip_to_range(s["moved"] + change, -NEVER, NEVER), 0)
        self.lead_then = if_else(same, s["lead_h"], self.lead)
        self.frozen = all_hold([same, self.count >= 1, fabs(self.moved) > s["unseen"],
                                fabs(self.lead - self.lead_then) > s["unseen"]])  # fmt: skip

    def _first(self) -> Any:
        """Speed at the first tick: the sensor's, or that of wheels which agree against it."""
        lead, given, turn = self.lead, self.given, self.turn
        apart = fabs(lead - given) > WORN * fabs(lead) + 0.5
        alike = all_hold([self.count >= 2, self.spread <= WORN * fabs(lead) + 0.5,
                      fabs(lead) >= 0.3 * fabs(given)])  # fmt: skip
        passed = logic_and(self.count >= 1, turn * (lead - given) > 0)
        wheels = logic_or(logic_not(self.seen), logic_and(apart, logic_or(alike, passed)))
        wheels = logic_and(wheels, self.count >= 1)
        return if_else(wheels, lead, if_else(self.seen, given, self.s["v_h"]))

    def sensor(self) -> Any:
        """Whether the sensor is believed from now on."""
        s, T = self.s, self.s["T"]
        self.off = time_without_break(logic_not(self.near), s["off"], T)
        self.on = time_without_break(self.near, s["on"], T)
        slides = all_hold([self.seen, self.spread > WORN * self.speed + 0.5,
                       self.turn * self.beside > 0,
                       fabs(self.beside) < WORN * self.speed + 2.0,
                       self.turn * (self.given - self.lead) > self.gate])  # fmt: skip
        self.back = time_without_break(slides, s["back"], T)
        stays = logic_and(s["v_ok"] > 0.5, self.off < 0.1)
        again = logic_or(self.on >= 0.3, self.back >= 1.0)
        at_first = logic_and(self.seen, fabs(self.beside) <= 0)
        self.v_ok = if_else(self.begins, at_first, logic_or(stays, again))
        return self.v_ok

    def believe(self, wrong: Any) -> Any:
        """The speed that is believed; ``wrong``: wheels that are let go show that it is not."""
        s, T, turn = self.s, self.s["T"], self.turn
        alike = all_hold([self.count >= 1, self.near,
                      fabs(self.given - self.lead) <= self.gate + 0.01 * self.speed])  # fmt: skip
        middle = if_else(alike, (self.beside + self.wheels) / 2, self.beside)
        by_sensor = middle * fmin(T / if_else(alike, 0.3, 1.5), 1)
        ahead = turn * self.wheels
        near = -ahead <= 0.05 * self.speed + 0.3
        down = fmax(ahead, -T * if_else(near, 0.5, 0.05))
        by_wheels = turn * if_else(ahead > 0, fmin(ahead, 20 * T), down)
        self.now = logic_and(self.v_ok > 0.5, self.near)
        by_sensor = if_else(self.apart, self.beside, by_sensor)
        v = self.predicted + if_else(self.now, by_sensor, if_else(self.count >= 1, by_wheels, 0))
        learns = all_hold([alike, self.now, s["age"] > 0.3, logic_not(self.apart)])
        self.bias = clip_to_range(s["bias"] + if_else(learns, middle * T / 3, 0), -DRAG, DRAG)
        self.v_ok = if_else(wrong, 0, self.v_ok)
        self.v = clip_to_range(if_else(wrong, self.lead, v), -2, s["fastest"])
        self.now = logic_and(self.now, logic_not(wrong))
        return if_else(self.now, self.given, self.v)


def _failures(turn: int) -> list[tuple[str, ...]]:
    """Rows of what may fail among the inputs; see ``block/text/failures.py``."""
    passes = "passes" if turn > 0 else "stays behind"
    gone = f"the last good sample for {HOLD:g} s, then the axle gets the safe output"
    return [
        ("wheel speed is no number, off range, or moves faster than brake and rail can move a"
         " wheel", "each sample; `trust.ok`", gone, "no slip control of that axle", f"{HOLD:g} s"),
        (f"wheel speed {passes} the vehicle's by 3 % (10 % until the ratio is learnt) and 0.6 m/s",
         "each sample; `trust.ok`", gone, "no slip control of that axle", f"{HOLD:g} s"),
        ("wheel speed stands, or is too low", "the axle does not run up when it is let go;"
         " `trust.stands`, `trust.ok`", "the axle gets the safe output for 10 s, then it is tried"
         " again", "about 0.5 s of release in 10 s", "0.5 s"),
        ("vehicle speed is no number, off range, jumps, is off by a share or drifts",
         "it is {gate} from what momentum predicts and the wheels contradict it; `trust.v_ok`",
         "the axles go by the prediction, held up by the second fastest wheel"
         if turn > 0 else "the axles go by the prediction, held down by the second slowest wheel",
         "slip control goes on", "each sample; a drift of 0.5 m/s^2 within 2.2 s"),
        ("vehicle speed is frozen", "one and the same number while momentum and wheels have moved"
         " by {unseen}; `trust.v_ok`", "the same", "slip control goes on", "that change"),
        ("vehicle speed is wrong and not seen so", "more than half of the wheels are let go, agree"
         " and do not run up; `trust.v_ok`", "the wheels are believed", "slip control goes on",
         "0.25 s after the release"),
        ("measured torque is no number, off range, or not as commanded by a quarter of the largest"
         " (valve or pressure sensor stuck)", "the model of the actuator; `trust.follows`",
         "the torque as commanded stands for it", "a brake that is stuck", "{react}"),
        ("demand is no number", "each sample; `trust.demand_ok`", f"the last one for {HOLD:g} s,"
         " then {lost}", "that demand", f"{HOLD:g} s"),
        ("start or restart in motion", f"fewer than {SETTLED:g} s of good samples; `trust.ready`",
         "the demand", f"no slip control for {SETTLED:g} s", "the first tick"),
        ("all axles together are released too long", "the commands fall or are below a tenth of"
         " the demand; `trust.retry`", "the demand for {again}, then slip control again"
         if turn > 0 else "the safe output for {again}, then slip control again", "",
         "{limit}"),
    ]  # fmt: skip


def trust(axles: int, driven: bool, **numbers: float) -> Block:
    """Make the judge of all inputs: what of them is believed, and what stands for the rest.

    Args:
        axles: how many have an actuator.
        driven: the vehicle is driven; its wheels are seen in the mirror.
        **numbers: parameters of the block.

    Returns:
        Step from ``v``, ``omega``, ``T_b``, ``T_demand``, which may be anything, and the last
        command ``T_cmd`` to what is believed of them, and to how it is with each.
    """
    n, turn = axles, -1 if driven else 1
    each = (n,)

    @step(
        v=Output("m/s", "vehicle speed that is believed"),
        omega=Output("rad/s", "believed wheel speed, of a wheel with the radius r", shape=each),
        T_b=Output("N m", "torque that is believed", positive="braking", shape=each),
        demand=Output("N m", "torque that is demanded, as it is believed", positive="braking"),
        ready=Output("1", "1 where slip control can go by the samples", shape=each, lo=0, hi=1),
        ok=Output("1", "1 where the axle's own samples are believed", shape=each, lo=0, hi=1),
        v_ok=Output("1", "1 while the sensor of the vehicle's speed is believed", lo=0, hi=1),
        demand_ok=Output("1", "1 while the demand is a number", lo=0, hi=1),
        follows=Output("1", "1 where the torque follows its command", shape=each, lo=0, hi=1),
        stands=Output("1", "1 where a wheel let go does not run up", shape=each, lo=0, hi=1),
        ratio=Output("1", "speed of the vehicle over that of a wheel that rolls", shape=each),
        retry=Output("1", "1 while the train gets the demand after a long release", lo=0, hi=1),
        name="trust", choices={"axles": n, "driven": driven}, failures=_failures(turn),
    )  # fmt: skip
    def judging(
        omega_h=State("rad/s", "omega_start", "last wheel speed that was believed", shape=each),
        out=State("s", NEVER, "time without a wheel speed to believe", shape=each),
        good=State("s", 0.0, "time with one", shape=each),
        ratio_h=State("1", 1.0, "vehicle's speed over that of a wheel that rolls", shape=each),
        learnt=State("s", 0.0, "time that it was learnt in", shape=each),
        mean=State("rad/s", "omega_start", "wheel speed, filtered", shape=each),
        still=State("s", 0.0, "time that a wheel let go has not run up in", shape=each),
        ban=State("s", 0.0, "time for which its speed is not to be believed", shape=each),
        torque=State("N m", 0.0, "torque, as the commands have it", shape=each),
        odd=State("s", 0.0, "time that the measured torque has been another", shape=each),
        v_h=State("m/s", "v_start", "vehicle speed that was believed"),
        bias=State("m/s^2", 0.0, "acceleration by all but the brakes"),
        seen=State("1", 1.0, "1 while the sensor of the vehicle's speed is believed"),
        off=State("s", 0.0, "time that it has been another"),
        on=State("s", 0.0, "time that it has been the same"),
        back=State("s", 0.0, "time that wheels which slide have spoken for it"),
        given_h=State("m/s", "v_start", "vehicle speed as its sensor told it last"),
        lead_h=State("m/s", "v_start", "that of the wheels when its sensor told another"),
        moved=State("m/s", 0.0, "change by momentum since then"),
        age=State("s", 0.0, "time since the start"),
        total=State("N m", 0.0, "commands of all axles together"),
        let_go=State("s", 0.0, "time that the train has been released in"),
        rest=State("s", 0.0, "time for which it gets the demand after that"),
        demand_h=State("N m", 0.0, "last demand that was a number"),
        demand_out=State("s", 0.0, "time without one"),
        v=Input("m/s", "measured vehicle speed", judged=True),
        omega=Input("rad/s", "measured wheel speed", shape=each, judged=True),
        T_b=Input("N m", "measured torque", positive="braking", shape=each, judged=True),
        T_demand=Input("N m", "torque that is demanded", positive="braking", judged=True),
        T_cmd=Input("N m", "last command", positive="braking", shape=each),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
        J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
        m=Param("kg", 8000.0, "vehicle, per axle with an actuator", ADDED, lo=100, hi=1e8),
        m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=100, hi=1e8),
        g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
        tau=Param("s", 0.05, "time constant of the actuator", ADDED, lo=1e-3, hi=5),
        T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
        react=Param("s", 0.8, "time to follow a command in", ADDED, lo=0.01, hi=10),
        gate=Param("m/s", 0.35, "largest error of the vehicle's speed", ADDED, lo=0.01, hi=50),
        unseen=Param("m/s", 0.1, "change of it that its sensor may not show", ADDED, lo=0.01,
                     hi=50),
        noise=Param("rad/s", 0.5, "what a wheel's sensor may be off by", ADDED, lo=0, hi=100),
        slow=Param("rad/s", 20.0, "below this speed it may be off by more", ADDED, lo=0, hi=1e3),
        noise_slow=Param("rad/s", 5.0, "that much more", ADDED, lo=0, hi=1e3),
        alike=Param("1", 0.003, "wheels that differ by less are equal", ADDED, lo=0, hi=0.1),
        fastest=Param("m/s", 120.0, "largest speed of the vehicle", ADDED, lo=1, hi=500),
        most=Param("rad/s", 430.0, "largest speed of a wheel", ADDED, lo=1, hi=5000),
        lost=Param("N m", 0.0, "demand where there is none any more", ADDED, lo=0, hi=1e8),
        limit=Param("s", 5.0, "longest release of the train", ADDED, lo=0.1, hi=900),
        again=Param("s", 1.0, "time of the demand after it", ADDED, lo=0.01, hi=10),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
        v_start=Param("m/s", 20.0, "vehicle speed at the start", ADDED, lo=0, hi=200),
        omega_start=Param("rad/s", 40.0, "wheel speed at the start", ADDED, lo=0, hi=1e3),
    ):  # fmt: skip
        """Judge every input: what is believed of it, and what stands for it where it is not."""
        s = dict(omega_h=omega_h, out=out, ratio=ratio_h, learnt=learnt, mean=mean, still=still,
                 ban=ban, torque=torque, odd=odd, v_h=v_h, bias=bias, v_ok=seen, off=off, on=on,
                 back=back, given_h=given_h, lead_h=lead_h, moved=moved, age=age,
                 v=v, omega=omega, T_b=T_b, T_cmd=T_cmd, r=r, J=J, m=m,
                 m_axle=m_axle, g=g, tau=tau, T_max=T_max, react=react, gate=gate, noise=noise,
                 slow=slow, noise_slow=noise_slow, alike=alike, fastest=fastest, most=most,
                 unseen=unseen, T=T)  # fmt: skip
        own = [_Axle(k, s, turn) for k in range(n)]
        car = _Vehicle(s, own, turn)
        sensed = car.sensor()
        for a in own:
            a.judge(if_else(logic_and(sensed, car.near), car.given, car.predicted),
                    logic_and(sensed, car.near))  # fmt: skip
        dead = sum(a.dead for a in own)
        wrong = all_hold([car.count >= 2, 2 * dead > car.count,
                      car.spread <= 0.05 * car.speed + 0.5])  # fmt: skip
        believed = car.believe(wrong)
        banned = [
            if_else(logic_and(a.dead, logic_not(wrong)), 10.0, fmax(ban[a.k] - T, 0)) for a in own
        ]
        okay = [logic_and(a.out < HOLD, b <= 0) for a, b in zip(own, banned, strict=True)]
        good_ = [time_without_break(k, good[a.k], T) for k, a in zip(okay, own, strict=True)]
        omegas = [if_else(a.taken, a.omega, omega_h[a.k]) for a in own]
        far = 250 * T_max
        known = logic_and(T_demand >= -far, T_demand <= far)
        missing = time_without_break(logic_not(known), demand_out, T)
        wanted = if_else(known, T_demand, if_else(missing <= HOLD, demand_h, lost))
        top, given = n * clip_to_range(wanted, 0, T_max), sum1(T_cmd)
        lets = all_hold([top > 0.02 * n * T_max, given < 0.98 * top,
                         logic_or(given < 0.1 * top, given < total)])  # fmt: skip
        letting = time_without_break(lets, let_go, T)
        over = letting >= limit
        nxt = dict(
            omega_h=omegas, out=[a.out for a in own], good=good_,
            ratio_h=[a.learnt_ratio for a in own], learnt=[a.learnt for a in own],
            mean=[a.mean for a in own],
            still=[if_else(logic_or(wrong, a.dead), 0, a.still) for a in own], ban=banned,
            torque=[a.modelled for a in own], odd=[a.odd for a in own],
        )  # fmt: skip
        nxt = {k: vertcat(*x) for k, x in nxt.items()}
        nxt |= dict(
            v_h=car.v, bias=car.bias, seen=car.v_ok, off=car.off, on=if_else(wrong, 0, car.on),
            back=car.back, age=fmin(age + T, NEVER), demand_h=if_else(known, T_demand, demand_h),
            demand_out=missing, given_h=car.given, lead_h=car.lead_then, moved=car.moved,
            total=given, let_go=if_else(over, 0, letting),
            rest=if_else(over, again, fmax(rest - T, 0)),
        )  # fmt: skip
        made = dict(
            # a wheel of which nothing is known any more is taken for one that rolls
            omega=[if_else(k, a.ratio * w, believed / r)
                   for a, w, k in zip(own, omegas, okay, strict=True)],
            T_b=[a.torque for a in own], ready=[g >= SETTLED for g in good_], ok=okay,
            follows=[a.follows for a in own], stands=[a.still > 0.1 for a in own],
            ratio=[a.ratio for a in own],
        )  # fmt: skip
        made = {k: vertcat(*x) for k, x in made.items()}
        return nxt, made | dict(v=believed, demand=wanted, v_ok=car.v_ok, demand_ok=known,
                                retry=rest > 0)  # fmt: skip

    return judging.with_params(**numbers)
