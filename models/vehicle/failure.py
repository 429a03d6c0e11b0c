"""What a vehicle's slip control believes, and what it does where it cannot.

    v, omega, T, T_demand -> trust -> slip control of each axle -> safe -> T_cmd

``trust`` judges every input before anything else sees it, and hands on numbers that are finite
and in their ranges. What it does not believe of one axle stays with that axle
(:mod:`slipctl.models.vehicle.measurement.axle_samples`). The vehicle's speed has a fall-back of
its own (:mod:`slipctl.models.vehicle.measurement.believed_speed`). ``safe``
(:mod:`slipctl.models.vehicle.safe_output`) gives an axle its demand where slip control cannot be
relied on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from casadi import fabs, fmax, fmin, if_else, logic_and, logic_not, logic_or, sum1, vertcat

from slipctl import Block, Input, Output, Param, Signal, State
from slipctl.block.block import Exprs, make_block
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.measurement.axle_samples import (
    ASKS,
    DOUBT,
    HOLD,
    NEVER,
    SETTLED,
    AxleSample,
    all_hold,
    axle_signals,
    clip_to_range,
    named_signals,
    time_without_break,
)
from slipctl.models.vehicle.measurement.believed_speed import VehicleSpeed, speed_signals

BEHIND = 0.5
"""Slip in m/s of the wrong sign up to which a sample is taken for one of a wheel that rolls."""

MEASURED = 2.0
"""Largest adhesion that a sample may have: twice what steel on steel can."""

MOVES = 1.0
"""Speed in m/s by its sensor from which a driven vehicle may be in motion though no wheel turns."""

STILL = 0.05
"""Believed speed in m/s below which a vehicle is taken for one that stands."""

TRIED = 1.0
"""Seconds of demand in which wheels of a vehicle that stands begin to turn."""


def _failures(turn: int) -> list[tuple[str, ...]]:
    """Rows of what may fail among the inputs; see ``block/text/failures.py``."""
    supply = [
        ("two wheel speeds or more read zero in motion (a supply fails)", "the sensor of the"
         f" vehicle's speed tells {MOVES:g} m/s or more; the wheels stand, just after they turned"
         f" or for {TRIED:g} s of demand; `trust.ok`", "the axles get the safe output until wheels"
         " and that sensor agree, or the demand has been zero", "no drive", f"{TRIED:g} s"),
    ] if turn < 0 else []  # fmt: skip
    passes = "passes" if turn > 0 else "stays behind"
    gone = f"the last good sample for {HOLD:g} s, then the axle gets the safe output"
    return [
        ("wheel speed is no number, off range, backwards, or moves faster than brake and rail can"
         " move a wheel", "each sample; `trust.ok`", gone, "no slip control of that axle",
         f"{HOLD:g} s"),
        (f"wheel speed {passes} the vehicle's by 3 % (10 % until the ratio is learnt) and 0.6 m/s",
         "each sample; `trust.ok`", gone, "no slip control of that axle", f"{HOLD:g} s"),
        ("wheel speed stands, or is too low", "the axle does not run up when it is let go;"
         " `trust.stands`, `trust.ok`", "the axle gets the safe output for 10 s, then it is tried"
         " again", "about 0.5 s of release in 10 s", "0.5 s"),
        ("wheel speed is too low, and slip control holds that as a slip",
         f"the axle has been sliding alone for {DOUBT:g} s with less than nine tenths of the"
         " demand; then it is let go (`trust.test`) and does not run up", "the same",
         "the same", f"{DOUBT + 0.5:g} s"),
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
        ("measured torque is no number, off range, or not as commanded by {other} of the largest"
         " (valve or pressure sensor stuck)", "the model of the actuator; `trust.follows`",
         "the torque as commanded stands for it", "a brake that is stuck", "{react}"),
        ("demand is no number", "each sample; `trust.demand_ok`", f"the last one for {HOLD:g} s,"
         " then {lost}", "that demand", f"{HOLD:g} s"),
        ("start or restart in motion", f"fewer than {SETTLED:g} s of good samples; `trust.ready`",
         "the demand", f"no slip control for {SETTLED:g} s", "the first tick"),
        ("the controller is called three times less often than made for, or less",
         "sensor and wheels both lose {pace} more than brakes and 1 m/s^2 can take; `trust.paced`",
         "it is told until the next start", "a slip control that is too slow",
         "about 3 s of braking"),
        ("all axles together are released too long", "the commands fall or are below a tenth of"
         " the demand; `trust.retry`", "the demand for {again}, then slip control again"
         if turn > 0 else "the safe output for {again}, then slip control again", "",
         "{limit}"),
        *supply,
    ]  # fmt: skip


def _train_signals() -> list[Signal]:
    """States, inputs, parameters and outputs that concern the demand and the whole train."""
    return named_signals(
        total=State("N m", 0.0, "commands of all axles together"),
        let_go=State("s", 0.0, "time that the train has been released in"),
        rest=State("s", 0.0, "time for which it gets the demand after that"),
        demand_h=State("N m", 0.0, "last demand that was a number"),
        demand_out=State("s", 0.0, "time without one"),
        T_demand=Input("N m", "torque that is demanded", positive="braking", judged=True),
        lost=Param("N m", 0.0, "demand where there is none any more", ADDED, lo=0, hi=1e8),
        limit=Param("s", 5.0, "longest release of the train", ADDED, lo=0.1, hi=900),
        again=Param("s", 1.0, "time of the demand after it", ADDED, lo=0.01, hi=10),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
        demand=Output("N m", "torque that is demanded, as it is believed", positive="braking"),
        demand_ok=Output("1", "1 while the demand is a number", lo=0, hi=1),
        retry=Output("1", "1 while the train gets the demand after a long release", lo=0, hi=1),
    )  # fmt: skip


def _demand(s: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """States and outputs of the demand: the last that was a number for a while, then ``lost``."""
    far = 250 * s["T_max"]
    known = logic_and(s["T_demand"] >= -far, s["T_demand"] <= far)
    missing = time_without_break(logic_not(known), s["demand_out"], s["T"])
    demand = if_else(known, s["T_demand"], if_else(missing <= HOLD, s["demand_h"], s["lost"]))
    kept = dict(demand_h=if_else(known, s["T_demand"], s["demand_h"]), demand_out=missing)
    return kept, dict(demand=demand, demand_ok=known)


def _release(s: Mapping[str, Any], n: int, demand: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """States and outputs of the limit of a release of all ``n`` axles together."""
    top, given = n * clip_to_range(demand, 0, s["T_max"]), sum1(s["T_cmd"])
    lets = all_hold([top > 0.02 * n * s["T_max"], given < 0.98 * top,
                     logic_or(given < 0.1 * top, given < s["total"])])  # fmt: skip
    letting = time_without_break(lets, s["let_go"], s["T"])
    over = letting >= s["limit"]
    rest = if_else(over, s["again"], fmax(s["rest"] - s["T"], 0))
    return dict(total=given, let_go=if_else(over, 0, letting), rest=rest), dict(retry=s["rest"] > 0)


def _speed(
    s: Mapping[str, Any], own: Sequence[AxleSample], turn: int
) -> tuple[dict[str, Any], dict[str, Any], Any]:
    """States and outputs of the vehicle's speed, by which ``own`` are judged; and ``wrong``.

    The last says that wheels which are let go contradict the speed, so that they are believed.
    """
    car = VehicleSpeed(s, own, turn)
    sensed = logic_and(car.sensor(), car.near)
    for a in own:
        a.judge(if_else(sensed, car.given, car.predicted), sensed)
    car.take_back(own)
    dead = sum(a.dead for a in own)
    wrong = all_hold([car.count >= 2, 2 * dead > car.count,
                  car.spread <= 0.05 * car.speed + 0.5])  # fmt: skip
    believed = car.believe(wrong)
    kept = dict(
        v_h=car.v, bias=car.bias, seen=car.v_ok, off=car.off, on=if_else(wrong, 0, car.on),
        back=car.back, age=clip_to_range(s["age"] + s["T"], 0, NEVER), given_h=car.given,
        lead_h=car.lead_then, moved=car.moved, lost_v=car.lost_v, lost_rim=car.lost_rim,
        kept_pace=car.paced,
    )  # fmt: skip
    return kept, dict(v=believed, v_ok=car.v_ok, paced=car.paced), wrong


def _supply(
    s: Mapping[str, Any], speed: Mapping[str, Any], v: Any, demand: Any
) -> tuple[dict[str, Any], Any]:
    """State of a driven vehicle, and whether wheels that read zero have no supply.

    Two of them outvote the sensor of the vehicle's speed, as they do where it is stuck and the
    vehicle stands. But there the wheels turn when they get a torque, and no vehicle stops at once.
    """
    sure = logic_or(speed["seen"] > 0.5, speed["given_h"] < MOVES)
    again = logic_or(sure, demand <= ASKS * s["T_max"])
    counted = fmin(s["tried"] + if_else(fabs(v) < STILL, s["T"], 0), 2 * TRIED)
    tried = if_else(v >= MOVES, TRIED, if_else(again, 0, counted))
    return dict(tried=tried), tried > TRIED


def _axles(
    s: Mapping[str, Any], own: Sequence[AxleSample], wrong: Any, v: Any, demand: Any, *more: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """States and outputs of the axles, after they were judged by the vehicle's speed ``v``.

    ``more`` are conditions without which no axle's samples are believed.
    """
    T, top = s["T"], clip_to_range(demand, 0, s["T_max"])
    alone = 2 * sum(a.slides for a in own) <= len(own)
    rows: list[dict[str, Any]] = []
    told: list[dict[str, Any]] = []
    for a in own:
        a.doubt(alone, top)
        ban = if_else(logic_and(a.dead, logic_not(wrong)), 10.0, fmax(s["ban"][a.k] - T, 0))
        okay = all_hold([a.out < HOLD, ban <= 0, *more])
        good = time_without_break(okay, s["good"][a.k], T)
        omega = if_else(a.taken, a.omega, s["omega_h"][a.k])
        rows.append(dict(
            omega_h=omega, out=a.out, good=good, radius=a.radius, learnt=a.learnt, mean=a.mean,
            still=if_else(logic_or(wrong, a.dead), 0, a.still), doubt=a.doubted, ban=ban, up=a.up,
            freed=a.freed, torque=a.modelled, odd=a.odd,
        ))  # fmt: skip
        told.append(dict(
            # a wheel of which nothing is known any more is taken for one that rolls
            rim=if_else(okay, a.ratio * a.r * omega, v), T_b=a.torque, ready=good >= SETTLED,
            ok=okay, follows=a.follows, stands=a.still > 0.1, test=a.test, ratio=a.ratio,
        ))  # fmt: skip
    return _columns(rows), _columns(told)


def _columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A column of each name, with a row per axle."""
    return {n: vertcat(*[row[n] for row in rows]) for n in rows[0]}


@cache
def trust(axles: int, driven: bool) -> Block:
    """Make the judge of all inputs: what of them is believed, and what stands for the rest.

    Args:
        axles: how many have an actuator.
        driven: the vehicle is driven; its wheels are seen in the mirror.

    Returns:
        Step from ``v``, ``omega``, ``T_b``, ``T_demand``, which may be anything, and the last
        command ``T_cmd`` to what is believed of them, and to how it is with each.
    """
    turn = -1 if driven else 1
    of_axle, of_speed, of_train = axle_signals(axles), speed_signals(axles), _train_signals()

    def judging(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        s = {**p, **x, **u}
        own = [AxleSample(k, s, turn) for k in range(axles)]
        speed, told, wrong = _speed(s, own, turn)
        wanted, said = _demand(s)
        more: list[Any] = []
        if driven:
            kept, zero = _supply(s, speed, told["v"], said["demand"])
            speed, more = speed | kept, [logic_not(zero)]
        axle, of_each = _axles(s, own, wrong, told["v"], said["demand"], *more)
        train, tried = _release(s, axles, said["demand"])
        return speed | wanted | axle | train, told | said | of_each | tried

    signals = [*of_axle, *of_speed, *of_train]
    if driven:
        signals += named_signals(tried=State("s", 0.0, "time of demand in which it stood"))
    return make_block(
        "trust", "step", judging,
        states=[s for s in signals if s.role == "state"],
        inputs=[s for s in signals if s.role == "input"],
        params=[s for s in signals if s.role == "param"],
        outputs=[s for s in signals if s.role == "output"],
        doc="Judge every input: what is believed of it, and what stands for it where it is not.",
        choices={"axles": axles, "driven": driven}, failures=_failures(turn),
    )  # fmt: skip
