"""When slip control takes an axle over from the demand, when it gives it back, and what applies."""

from __future__ import annotations

from functools import cache

from casadi import fmax, fmin, if_else, logic_and, mmin, vertcat

from slipctl import Block, Input, Output, Param, State, law, step
from slipctl.models.common_form import ADDED, T_S


@cache
def slip_from_speeds(driven: bool) -> Block:
    """Make the slip from both speeds, and the wheel speed as a braked wheel would have it.

    Args:
        driven: whether the wheel is driven; its slip is its creep then.
    """
    turn = -1 if driven else 1

    @law(
        v_s=Output("m/s", "measured slip speed", positive="braking", per="speed"),
        omega_s=Output("rad/s", "wheel speed, seen as that of a braked wheel"),
        name="slip", choices={"driven": driven},
    )  # fmt: skip
    def slip(
        v=Input("m/s", "measured vehicle speed"),
        rim=Input("m/s", "speed of the rim"),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    ):
        """v_s = v - rim; of a driven wheel rim - v. A wrong radius makes no slip."""
        return dict(v_s=turn * (v - rim), omega_s=turn * rim / r)

    return slip


@cache
def wake(always: bool) -> Block:
    """Make what says whether slip control rules in this tick.

    Args:
        always: whenever it can, not only when an axle slips.
    """

    @law(
        on=Output("1", "1 while slip control rules, else 0", lo=0, hi=1),
        slips=Output("1", "1 while the wheel slips by more than rolling", lo=0, hi=1),
        name="wake", choices={"always": always},
    )  # fmt: skip
    def waking(
        ruling=Input("1", "1 where slip control ruled and goes on"),
        v=Input("m/s", "vehicle speed that is believed"),
        v_s=Input("m/s", "measured slip speed", positive="braking", per="speed"),
        v_best=Input("m/s", "slip to go to", positive="braking", per="speed"),
        ready=Input("1", "1 where slip control can go by the samples"),
        share=Param("1", 0.5, "slip over its reference at which it takes over", ADDED, lo=0, hi=1),
        least=Param("m/s", 0.3, "slip below which it does not, as noise is", ADDED, lo=0, hi=20),
        v_off=Param("m/s", 1.0, "speed below which it is off", ADDED, lo=0, hi=200),
    ):
        """On from the first large slip, while it can go by the samples."""
        slips = v_s > fmax(share * v_best, least)
        can = logic_and(v >= v_off, ready > 0.5)
        return dict(on=if_else(can, 1 if always else fmax(ruling, slips), 0), slips=slips)

    return waking


@cache
def watch(always: bool) -> Block:
    """Make what says when slip control gives back.

    Args:
        always: it never does.
    """

    @step(on=Output("1", "1 while slip control rules, else 0"), name="watch",
          choices={"always": always})  # fmt: skip
    def watching(
        ruling=State("1", 1.0 if always else 0.0, "1 while slip control rules"),
        idle=State("s", 0.0, "how long the demand has been the smaller one"),
        rules=Input("1", "1 while slip control rules, else 0"),
        slips=Input("1", "1 while the wheel slips by more than rolling"),
        T_wanted=Input("N m", "torque that slip control wants", positive="braking"),
        T_demand=Input("N m", "torque that is demanded", positive="braking"),
        rest=Param("s", 0.2, "time of ruling demand after which it gives back", ADDED, lo=0, hi=60),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):
        """It gives back when the demand has been the smaller torque for a while."""
        calm = logic_and(logic_and(rules > 0.5, T_wanted >= T_demand), slips < 0.5)
        waited = if_else(calm, idle + T, 0)
        stay = rules if always else if_else(waited >= rest, 0, rules)
        return dict(ruling=stay, idle=waited), dict(on=rules)

    return watching


@law(T_cmd=Output("N m", "commanded torque", positive="braking", lo=0, hi="T_max"))
def applied(
    T_wanted=Input("N m", "torque that slip control wants", positive="braking"),
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    T=Input("N m", "torque at the wheel, as measured", positive="braking"),
    on=Input("1", "1 while slip control rules"),
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
    lead=Param("1", 1.0, "time constant of the actuator over the one it is to have", lo=1, hi=20),
):
    """The demand, or what slip control wants where that is less; see ``common_form.limits``."""
    top = fmin(fmax(T_demand, 0), T_max)
    led = T + lead * (fmin(T_max, fmax(0, T_wanted)) - T)
    return if_else(on > 0.5, fmin(top, fmax(0, led)), top)


@law(T_cmd=Output("N m", "commanded torque", positive="braking", lo=0, hi="T_max"), name="applied")
def demand_alone(
    T_demand=Input("N m", "torque that is demanded", positive="braking"),
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
):
    """The demand as it is, within the limits."""
    return fmin(fmax(T_demand, 0), T_max)


@cache
def turns(axles: int) -> Block:
    """Make what lets one axle go in turn while wheels slide, so that one of them tells the speed.

    Args:
        axles: how many.
    """

    @step(free=Output("1", "1 for the axle that is let go", shape=(axles,), lo=0, hi=1),
          name="turn", choices={"axles": axles})  # fmt: skip
    def letting(
        clock=State("s", 0.0, "time of sliding since an axle was let go", lo=0, hi=1e3),
        left=State("s", 0.0, "time for which one still is", lo=0, hi=1e3),
        axle=State("1", axles - 1.0, "which, from 0", lo=0, hi=axles - 1),
        v=Input("m/s", "vehicle speed that is believed"),
        T_b=Input("N m", "torque", shape=(axles,), positive="braking"),
        T_demand=Input("N m", "torque that is demanded", positive="braking"),
        T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
        time=Param("s", 1.0, "for which an axle is let go", ADDED, lo=0.01, hi=100),
        every_=Param("s", 8.0, "from one axle to the next", ADDED, lo=0.1, hi=500),
        v_least=Param("m/s", 3.0, "speed below which none is", ADDED, lo=0, hi=50),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """Where an axle has less than its demand, wheels slide; then the next axle is let go.

        The last one is first: it slips least, so it has run up soonest, and none behind it misses
        what it cleans.
        """
        top = fmin(fmax(T_demand, 0), T_max)
        slides = logic_and(mmin(T_b) < 0.9 * top, v > v_least)
        due = logic_and(slides, clock + time >= every_)
        time_left = if_else(slides, if_else(left > 0, fmax(left - T, 0), if_else(due, time, 0)), 0)
        ends = logic_and(left > 0, time_left <= 0)
        following = if_else(axle <= 0, axles - 1, fmax(axle - 1, 0))
        nxt = dict(
            clock=if_else(slides, if_else(time_left > 0, 0, fmin(clock + T, 1e3)), 0),
            left=time_left, axle=if_else(ends, following, axle),
        )  # fmt: skip
        on = time_left > 0
        return nxt, dict(free=vertcat(*[logic_and(on, axle == k) for k in range(axles)]))

    return letting


@law(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
    name="release",
)
def released_valves(
    hold_by=Input("1", "bit of the valve that shuts the supply off"),
    vent_by=Input("1", "bit of the valve that vents"),
    free=Input("1", "1 where the axle is let go"),
):
    """Both bits of an axle that is let go."""
    return dict(hold=fmax(hold_by, free), vent=fmax(vent_by, free))


@law(T_cmd=Output("N m", "commanded torque", positive="braking", lo=0, hi="T_max"), name="release")
def released_torque(
    T_slip=Input("N m", "torque by slip control", positive="braking"),
    free=Input("1", "1 where the axle is let go"),
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
):
    """None of an axle that is let go."""
    return if_else(free > 0.5, 0, fmin(fmax(T_slip, 0), T_max))
