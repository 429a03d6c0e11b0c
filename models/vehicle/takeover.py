"""When slip control takes an axle over from the demand, when it gives it back, and what applies."""

from __future__ import annotations

from casadi import fmax, fmin, if_else, logic_and

from slipctl import Block, Input, Output, Param, State, law, step
from slipctl.models.common_form import ADDED, T_S


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
        omega=Input("rad/s", "measured wheel speed"),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    ):
        """v_s = v - r omega; of a driven wheel r omega - v."""
        return dict(v_s=turn * (v - r * omega), omega_s=turn * omega)

    return slip


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
