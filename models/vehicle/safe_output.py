"""What gives an axle its command: slip control where it can be relied on, else the safe output.

``safe`` stands behind the slip control of each axle (``failure.trust`` before it). It gives
the demand while the samples of its axle are not believed, after a start, and below the cut-off
speed. So it does when the axle or the whole train has been released for too long. ``sample`` and
the floor of a searched reference keep what is not believed out of what is learnt. A law whose
states leave their ranges begins anew, on its axle alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
from casadi import fabs, fmax, fmin, if_else, logic_and, logic_not, logic_or

from slipctl import Block, Input, Output, Param, State, law, step
from slipctl.block.block import Exprs
from slipctl.block.fields import Composition, LawData
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.failure import BEHIND, MEASURED
from slipctl.models.vehicle.measurement.axle_samples import (
    all_hold,
    clip_to_range,
    time_without_break,
)


def _failures(mode: str | float, driven: bool) -> list[tuple[str, ...]]:
    """Rows of what the safe output does; see ``block/text/failures.py``."""
    word = {"demand": "the demand", "hold": "the last command"}
    rests = word[mode] if isinstance(mode, str) else f"{mode:g} N m"
    rise = "from zero to the largest torque in {1/rate}"
    return [
        ("the samples of an axle are not believed", "`trust.ready`",
         f"the safe output: {rests}, never above the demand, {rise}",
         "no slip control of that axle", "{1/rate}"),
        ("an axle is released too long", "its command falls or is below a tenth of the demand;"
         " `safe.released`", f"{rests if driven else 'the demand'} for {{again}}, then slip control"
         " again", "", "{limit}; {limit_still} where the wheel does not run up"),
        ("the vehicle is slower than {v_off}", "the believed speed", f"the demand, {rise}",
         "no slip control", "at once"),
    ]  # fmt: skip


@cache
def safe_command(mode: str | float, driven: bool = False) -> Block:
    """Make what gives an axle its command, by slip control or without it.

    Args:
        mode: what an axle gets on which slip control cannot be relied on: ``"demand"``, ``"hold"``
            (the last command, never above the demand) or a torque in N m (never above it).
        driven: for a driven axle, which gets that too where a brake would get the demand because
            it has been released for too long, or because its law has left its ranges: so does the
            law of a wheel that spins.
    """

    @step(
        T_cmd=Output("N m", "commanded torque", positive="braking", lo=0, hi="T_max"),
        released=Output("1", "1 while the limit of a release gives the demand", lo=0, hi=1),
        name="safe", choices={"mode": mode, "driven": driven}, failures=_failures(mode, driven),
    )  # fmt: skip
    def commanding(
        T_h=State("N m", "T_max", "last command", lo=0, hi="T_max"),
        let_go=State("s", 0.0, "time of release without a break", lo=0, hi="limit"),
        back=State("s", 0.0, "time for which the demand is given after it", lo=0, hi=10),
        slow=State("1", 0.0, "1 until the command has reached the demand", lo=0, hi=1),
        T_slip=Input("N m", "torque by slip control, at most the demand", positive="braking"),
        T_demand=Input("N m", "torque that is demanded", positive="braking"),
        on=Input("1", "1 while slip control rules"),
        ready=Input("1", "1 where slip control can go by the samples"),
        sound=Input("1", "1 where the law's states are in their ranges"),
        stands=Input("1", "1 where a wheel that is let go does not run up"),
        v=Input("m/s", "vehicle speed that is believed"),
        retry=Input("1", "1 while the train gets the demand after a long release"),
        test=Input("1", "1 where the axle is let go to see whether its wheel runs up"),
        T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
        v_off=Param("m/s", 1.0, "speed below which slip control is off", ADDED, lo=0, hi=200),
        rate=Param("1/s", 12.0, "largest torques by which a command without slip control rises",
                   ADDED, lo=0.1, hi=1e4),
        limit=Param("s", 10.0, "longest release", ADDED, lo=0.1, hi=900),
        limit_still=Param("s", 3.0, "longest release of a wheel that does not run up", ADDED,
                          lo=0.1, hi=900),
        again=Param("s", 1.0, "time of the demand after it", ADDED, lo=0.01, hi=10),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """Slip control's torque where it can be relied on, else the demand; never above that."""
        top = clip_to_range(T_demand, 0, T_max)
        held = logic_and(back <= 0, retry < 0.5)
        relied = all_hold([ready > 0.5, sound > 0.5, held, v >= v_off])
        rests = top if mode == "demand" else fmin(T_h if mode == "hold" else float(mode), top)
        good = all_hold([ready > 0.5, held, sound > 0.5]) if driven else ready > 0.5
        gives = top if mode == "demand" else if_else(good, top, rests)
        wanted = if_else(relied, if_else(test > 0.5, 0, fmin(T_slip, top)), gives)
        # what is not slip control's own rises slowly, and so does its way back to the demand
        ramp = logic_and(logic_or(logic_not(relied), slow > 0.5), on < 0.5)
        T_cmd = if_else(ramp, fmin(wanted, T_h + rate * T_max * T), wanted)
        lets = all_hold([relied, on > 0.5, top > 0.02 * T_max,
                     logic_or(T_cmd < 0.1 * top, T_cmd < T_h)])  # fmt: skip
        time = time_without_break(lets, let_go, T)
        over = time >= if_else(stands > 0.5, fmin(limit, limit_still), limit)
        rest = if_else(over, again, fmax(back - T, 0))
        return (
            dict(T_h=T_cmd, let_go=if_else(over, 0, fmin(time, limit)), back=rest,
                 slow=logic_and(ramp, T_cmd < wanted)),
            dict(T_cmd=T_cmd, released=logic_not(held)),
        )  # fmt: skip

    return commanding


@law(
    mu=Output("1", "adhesion for the estimator", positive="braking"),
    v_s=Output("m/s", "slip speed for the estimator", positive="braking", per="speed"),
    name="sample",
)
def sample(
    mu_m=Input("1", "mean adhesion over the window", positive="braking"),
    v_s_m=Input("m/s", "mean slip speed over the window", positive="braking", per="speed"),
    ready=Input("1", "1 where slip control can go by the samples"),
):
    """What an estimator takes: (0, 0) while samples are not believed, which fits every law.

    So it is where the wheel is ahead of the vehicle by more than noise: no law is meant for that.
    """
    good = logic_and(ready > 0.5, v_s_m >= -BEHIND)
    mu = clip_to_range(mu_m, -MEASURED, MEASURED)
    return dict(mu=if_else(good, mu, 0), v_s=if_else(good, v_s_m, 0))


def reference_with_floor(peak: float, noise: float) -> Block:
    """Make what a searched reference does not fall below, so that it cannot latch.

    The smaller it is, the sooner an error of a speed is taken for slip. Then slip control releases,
    nothing more is learnt, and it stays. So it is above what the speeds may be off by. It is never
    above the peak of the law that is fitted: a rail is best there or at less.

    Args:
        peak: slip in m/s at which the law that is fitted has its peak.
        noise: what the sensor of the vehicle's speed may be off by, in m/s.
    """

    @law(
        v_best=Output("m/s", "slip to go to", positive="braking", per="speed"),
        name="reference",
    )
    def reference(
        searched=Input("m/s", "slip to go to, as searched", positive="braking", per="speed"),
        v=Input("m/s", "vehicle speed that is believed"),
        standstill=Param("m/s", min(noise, 5.0), "floor at standstill", ADDED, lo=0, hi=10),
        share=Param("1", 0.045, "share of the speed that it has besides", ADDED, lo=0, hi=0.5),
        most=Param("m/s", 0.85 * peak, "the floor is not above it", "below the law's own peak",
                   lo=0.001, hi=20),
    ):  # fmt: skip
        """The searched slip, and not less than what speeds may be off by."""
        return fmax(searched, fmin(standstill + share * fabs(v), most))

    return reference


@law(
    T=Output("N m", "torque that the rail carries", positive="braking", lo=0, hi="T_max"),
    name="carried",
)
def carried_torque(
    mu=Input("1", "adhesion, as measured", positive="braking"),
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=100, hi=1e8),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
):
    """T = mu m_axle g r, not above the demand: with it the wheel keeps its speed."""
    return clip_to_range(mu * m_axle * g * r, 0, clip_to_range(T_demand, 0, T_max))


def begun_at_torque(block: Block, state: str, sign: float) -> Block:
    """Run a law whose integral begins at the torque that the rail carries, not at zero.

    An integral that begins at zero takes the brake off for as long as it needs to come back.
    It does so whenever slip control takes over, be it for a wrong sample.

    Args:
        block: a step.
        state: its integral, in N m. sign: of the torque in it where braking is positive.
    """

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        held = {n: x[n] for n in block.states}
        held[state] = if_else(x["begun"] > 0.5, x[state], sign * u["T_begin"])
        nxt, y = block.expr(held, {n: u[n] for n in block.inputs}, p)
        return dict(nxt) | {"begun": 1}, y

    def rebuild(parts: dict[str, Block]) -> Block:
        return begun_at_torque(parts[block.name], state, sign)

    begun = State("1", 0.0, "1 from the second tick on", lo=0, hi=1).named("begun")
    first = Input("N m", "torque that the rail carries", positive="braking").named("T_begin")
    return Block(
        block.name, "step", body,
        [*block.states.values(), begun, *block.inputs.values(), first, *block.params.values(),
         *block.outputs.values()],
        period=block.period, sx=block.sx,
        doc=f"{block.doc}\n\nIts integral begins at the torque that the rail carries.",
        choices=block.choices | {"begins": state}, conditions=block.conditions,
        composition=Composition.around(block, rebuild),
    )  # fmt: skip


NO_END = 1e38
"""End of a range that has none; float has such a number too."""


def contained_block(block: Block, gets: str = "the demand") -> Block:
    """Run a step block, and begin it anew where a next state would leave its range.

    In such a tick its outputs are zero and ``sound`` is 0. So what goes wrong in the slip control
    of one axle ends there: no other axle waits for it, and no generated guard has to refuse a tick.

    Args:
        block: a step; ends of ranges that are expressions are left to the generated guards.
        gets: what its axle gets in such a tick, in words.
    """
    states = list(block.states.values())
    low = ca.DM(np.concatenate([[], *(np.full(s.size, max(s.lo, -NO_END)) for s in states)]))
    high = ca.DM(np.concatenate([[], *(np.full(s.size, min(s.hi, NO_END)) for s in states)]))
    chosen = block.of_equations("contained", lambda: _kept_or_begun(block.f))

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        now = block.pack("param", p)
        nxt, y = block.f(block.pack("state", x), block.pack("input", u), now)
        sound = ca.dot(nxt >= low, nxt <= high) >= low.numel()
        nxt, y = chosen(sound, nxt, y, block.pack("state", block.symbolic_start(p)))
        return block.unpack("state", nxt), block.unpack("output", y) | {"sound": sound}

    def rebuild(parts: dict[str, Block]) -> Block:
        return contained_block(parts[block.name], gets)

    sound = Output("1", "1 where its states are in their ranges", lo=0, hi=1).named("sound")
    wide = [replace(s, lo=min(s.lo, 0.0), hi=max(s.hi, 0.0)) for s in block.outputs.values()]
    return Block(
        block.name, "step", body,
        [*states, *block.inputs.values(), *block.params.values(), *wide, sound],
        period=block.period, sx=False,
        doc=f"{block.doc}\n\nIt begins anew where a state leaves its range.",
        choices=block.choices | {"contained": True}, conditions=block.conditions,
        composition=Composition.around(block, rebuild),
        law_data=LawData(failures=[
            ("a state of an axle's law leaves its range", "each tick; `law.sound`",
             f"that law begins anew, its axle gets {gets} in that tick", "", "one tick"),
        ]),
    )  # fmt: skip


def _kept_or_begun(f: ca.Function) -> ca.Function:
    """Function (sound, next, y, start) -> (next, y): as they are, or the start and zero."""
    x, start = ca.MX.sym("x", f.size1_out(0)), ca.MX.sym("s", f.size1_out(0))
    y = ca.MX.sym("y", f.size1_out(1))
    kept = ca.Function(f"{f.name()}_kept", [x, y, start], [x, y])
    begun = ca.Function(f"{f.name()}_begun", [x, y, start], [start, ca.DM.zeros(f.size1_out(1))])
    return ca.Function.if_else(f"{f.name()}_contained", kept, begun)
