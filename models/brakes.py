"""Brakes: limits and the lag of a cylinder, motors that brake first, magnets on the rails."""

from casadi import exp, fabs, fmax, fmin, if_else, logic_and, logic_not

from slipctl import Block, Input, Output, Param, State, flow, law, step
from slipctl.models.common_form import T_S

ADDED = "of the vehicle"


def brake(lag: bool = False, rate: bool = False) -> Block:
    """Make a brake: it cannot drive, it has a largest torque, and with ``lag`` it takes its time.

    Args:
        lag: first-order lag of the cylinder; without it the torque follows at once.
        rate: with a lag: the torque has a largest rate too.
    """
    if not lag:

        @law(T_b=Output("N m", "brake torque", positive="braking"), name="brake")
        def ideal(
            T_cmd=Input("N m", "commanded torque", positive="braking"),
            T_max=Param("N m", 20e3, "largest torque", "guess, not in the paper", lo=1, hi=1e8),
        ):
            """Limits of a brake, 0 <= T_b <= T_max, without lag."""
            return fmin(T_max, fmax(0, T_cmd))

        return ideal

    if rate:

        @flow(
            R=Output("N m/s", "rate of the torque", lo="-R_max", hi="R_max"),
            name="brake", choices={"lag": True, "rate": True},
        )  # fmt: skip
        def limited(
            T_b=State("N m", 0.0, "brake torque", lo=0, hi=1e8, positive="braking"),
            T_cmd=Input("N m", "commanded torque", positive="braking"),
            T_max=Param("N m", 20e3, "largest torque", "guess, not in the paper", lo=1),
            tau=Param("s", 0.05, "time constant of the cylinder", "typical, guess", lo=1e-3, hi=5),
            R_max=Param("N m/s", 1e5, "largest rate of the torque", "guess", lo=1),
        ):
            """Limits of a brake, a first-order lag and a largest rate."""
            wanted = (fmin(T_max, fmax(0, T_cmd)) - T_b) / tau
            R = fmax(-R_max, fmin(R_max, wanted))
            return dict(T_b=R), dict(R=R)

        return limited

    @flow(name="brake", choices={"lag": True})
    def lagging(
        T_b=State("N m", 0.0, "brake torque", lo=0, hi=1e8, positive="braking"),
        T_cmd=Input("N m", "commanded torque", positive="braking"),
        T_max=Param("N m", 20e3, "largest torque", "guess, not in the paper", lo=1, hi=1e8),
        tau=Param("s", 0.05, "time constant of the cylinder", "typical, guess", lo=1e-3, hi=5),
    ):
        """Limits of a brake and a first-order lag: tau T_b' = sat(T_cmd) - T_b."""
        return dict(T_b=(fmin(T_max, fmax(0, T_cmd)) - T_b) / tau), {}

    return lagging


@law(T=Output("N m", "torque asked of the cylinder", positive="braking"))
def brake_gain(
    T_cmd=Input("N m", "commanded torque", positive="braking"),
    k=Param("1", 1.0, "delivered by commanded torque", "of the vehicle", lo=0.1, hi=10),
):
    """A brake that gives another torque than it is told: T = k T_cmd."""
    return k * T_cmd


@step(F_B=Output("N", "running resistance and magnets", positive="braking"))
def track_brake(
    t=State("s", 0.0, "time since the start", lo=0, hi=1e6),
    F_R=Input("N", "running resistance"),
    v=Input("m/s", "vehicle speed"),
    attraction=Param("N", 1e5, "of all magnets to both rails", ADDED, lo=1, hi=1e7),
    friction=Param("1", 0.2, "of a magnet on the rail, slow", ADDED, lo=1e-3, hi=1),
    fall=Param("s/m", 0.03, "of that with the speed", ADDED, lo=0, hi=1),
    delay=Param("s", 1.0, "from the start until they lie on the rails", ADDED, lo=0, hi=60),
    above=Param("m/s", 20 / 3.6, "speed below which they are lifted", ADDED, lo=0.5, hi=50),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """F_B = F_R + friction/(1 + fall v) attraction, while they lie on the rails."""
    lies = logic_and(t + 0.5 * T >= delay, v > above)
    rubs = attraction * friction / (1 + fall * fabs(v))
    return dict(t=t + T), dict(F_B=F_R + if_else(lies, rubs, 0))


@step(
    T_e=Output("N m", "torque of the motor", positive="braking"),
    T_f=Output("N m", "torque that is left to the friction brake", positive="braking"),
)
def dynamic_brake(
    T_m=State("N m", 0.0, "torque of the motor", lo=0, hi=1e6, positive="braking"),
    t=State("s", 0.0, "time since the start", lo=0, hi=1e6),
    rested=State("s", 1e3, "time since a valve last held or vented", lo=0, hi=1e3),
    T_cmd=Input("N m", "torque that both together shall give", positive="braking"),
    omega=Input("rad/s", "wheel speed"),
    hold=Input("1", "bit of the valve that shuts the supply off", value=0.0),
    vent=Input("1", "bit of the valve that vents", value=0.0),
    T_top=Param("N m", 4e3, "largest torque; 0 of an axle without motor", ADDED, lo=0, hi=1e6),
    P_top=Param("W", 1e9, "largest power", ADDED, lo=1, hi=1e9),
    tau_e=Param("s", 0.1, "time constant", ADDED, lo=1e-3, hi=5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    v_full=Param("m/s", 10 / 3.6, "rim speed below which it fades", ADDED, lo=0, hi=50),
    v_gone=Param("m/s", 3 / 3.6, "rim speed at which it is gone", ADDED, lo=0, hi=50),
    pause=Param("s", 3.0, "time off after a valve held or vented", ADDED, lo=0, hi=600),
    lost=Param("s", 1e6, "time of its failure", ADDED, lo=0, hi=1e6),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """T_m follows min(T_cmd, T_top, P_top/|omega|), faded by the rim speed; T_f = T_cmd - T_m.

    It is off for a while on an axle whose valves have held or vented, and from its failure on.
    """
    turns = fabs(omega)
    fade = fmin(fmax((r * turns - v_gone) / (v_full - v_gone), 0), 1)
    most = fade * fmin(T_top, P_top / fmax(turns, 1e-3))
    acted = fmax(hold, vent) > 0.5
    since = if_else(acted, 0, rested)
    half = 0.5 * T
    free = logic_and(since + half >= pause, logic_not(acted))
    works = logic_and(t + half < lost, free)
    goal = if_else(works, fmin(fmax(T_cmd, 0), most), 0)
    nxt = dict(T_m=goal + (T_m - goal) * exp(-T / tau_e), t=t + T, rested=fmin(since + T, 1e3))
    return nxt, dict(T_e=T_m, T_f=fmax(T_cmd - T_m, 0))


@law(T_b=Output("N m", "torque on the axle", positive="braking"))
def sum_of_torques(
    T_f=Input("N m", "torque of the friction brake", positive="braking"),
    T_e=Input("N m", "torque of the motor", positive="braking"),
):
    """T_b = T_f + T_e."""
    return T_f + T_e
