"""Brakes: limits, and the lag of a cylinder."""

from casadi import fmax, fmin

from slipctl import Block, Input, Output, Param, State, flow, law


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
