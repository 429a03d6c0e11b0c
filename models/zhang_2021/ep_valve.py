"""Pneumatic brake of Zhang 2021: torque from cylinder pressure, limits, lag, valve, dead time.

    T_b = theta P_c,   theta = -33.56 N m/kPa (the unit is not printed),   0 <= P_c <= P_max

Signs as in the paper: T_b <= 0 brakes.
"""

from casadi import fmax, fmin, vertcat

from slipctl import BadInput, Block, Input, Output, Param, State, flow, law, step
from slipctl.errors import refuse_unknown_choice

SOURCE = "Zhang 2021, section 5.1"
THETA = -33.56e-3
"""Torque per pressure in N m/Pa."""

FORMS = ("ideal", "lag", "valve")


def air_brake(form: str = "ideal") -> Block:
    """Make the brake.

    Args:
        form: ``"ideal"``: limits only, a law from the commanded torque. ``"lag"``: limits and a
            first-order cylinder. ``"valve"``: a cylinder that an electro-pneumatic valve fills,
            holds or vents; its input is the valve's position, see :func:`ep_valve`.
    """
    refuse_unknown_choice("air_brake", "form", form, FORMS)
    if form == "ideal":

        @law(
            T_b=Output("N m", "brake torque", positive="traction"),
            P_c=Output("Pa", "cylinder pressure"),
            name="brake", choices={"form": form},
        )  # fmt: skip
        def ideal(
            T_cmd=Input("N m", "commanded torque", positive="traction"),
            theta=Param("N m/Pa", THETA, "torque per pressure", SOURCE, lo=-1, hi=-1e-6),
            P_max=Param("Pa", 600e3, "largest pressure", "guess, not in the paper", lo=1e3, hi=1e9),
        ):
            """Brake without lag: pressure limits 0 <= P_c <= P_max."""
            P_c = fmax(0, fmin(P_max, T_cmd / theta))
            return dict(T_b=theta * P_c, P_c=P_c)

        return ideal
    if form == "lag":

        @flow(
            T_b=Output("N m", "brake torque", positive="traction"),
            name="brake", choices={"form": form},
        )  # fmt: skip
        def lagging(
            P_c=State("Pa", 0.0, "cylinder pressure", lo=0, hi=1e9),
            T_cmd=Input("N m", "commanded torque", positive="traction"),
            theta=Param("N m/Pa", THETA, "torque per pressure", SOURCE, lo=-1, hi=-1e-6),
            P_max=Param("Pa", 600e3, "largest pressure", "guess, not in the paper", lo=1e3, hi=1e9),
            tau=Param("s", 0.02, "time constant of the cylinder", "guess", lo=1e-3, hi=5),
        ):
            """Brake with limits and a first-order cylinder: tau P_c' = sat(T_cmd/theta) - P_c."""
            P_cmd = fmax(0, fmin(P_max, T_cmd / theta))
            return dict(P_c=(P_cmd - P_c) / tau), dict(T_b=theta * P_c)

        return lagging

    @flow(
        T_b=Output("N m", "brake torque", positive="traction"),
        name="brake", choices={"form": form},
    )  # fmt: skip
    def cylinder(
        P_c=State("Pa", 0.0, "cylinder pressure", lo=0, hi=1e9),
        position=Input("1", "valve: 1 fills, 0 holds, -1 vents", lo=-1, hi=1),
        theta=Param("N m/Pa", THETA, "torque per pressure", SOURCE, lo=-1, hi=-1e-6),
        P_max=Param("Pa", 600e3, "supply pressure", "guess, not in the paper", lo=1e3, hi=1e9),
        tau_f=Param("s", 0.15, "filling towards the supply", "guess", lo=1e-3, hi=5),
        tau_v=Param("s", 0.10, "venting towards the air", "guess", lo=1e-3, hi=5),
        tau_l=Param("s", 1e3, "leak while holding", "guess", lo=1, hi=1e6),
    ):
        """Cylinder behind a valve: fills towards the supply, vents towards the air, or holds."""
        fill = fmax(0, position) * (P_max - P_c) / tau_f
        vent = fmax(0, -position) * P_c / tau_v
        return dict(P_c=fill - vent - P_c / tau_l), dict(T_b=theta * P_c)

    return cylinder


@law(position=Output("1", "valve: 1 fills, 0 holds, -1 vents", lo=-1, hi=1))
def ep_valve(
    T_cmd=Input("N m", "commanded torque", positive="traction"),
    T_b=Input("N m", "brake torque, from the pressure sensor", positive="traction"),
    theta=Param("N m/Pa", THETA, "torque per pressure", SOURCE, lo=-1, hi=-1e-6),
    P_max=Param("Pa", 600e3, "largest pressure", "guess, not in the paper", lo=1e3, hi=1e9),
    band=Param("Pa", 3e3, "pressure error below which it holds", "guess", lo=0, hi=1e7),
):
    """Electro-pneumatic valve: fill, hold or vent, decided at each tick from the pressure error."""
    error = fmax(0, fmin(P_max, T_cmd / theta)) - T_b / theta
    return (error > band) - (error < -band)


def dead_time(ticks: int, unit: str = "N m", positive: str = "traction") -> Block:
    """Make a delay by whole ticks.

    Args:
        ticks: how many, at least 1.
        unit: unit of the signal.
        positive: its sign convention.

    Raises:
        BadInput: not a whole number of ticks.
    """
    if ticks < 1 or ticks != int(ticks):
        raise BadInput(f"dead_time({ticks}) takes a whole number of ticks >= 1")
    size = int(ticks)

    @step(
        y=Output(unit, "signal after the dead time", positive=positive),
        name="dead_time", choices={"ticks": size},
    )  # fmt: skip
    def delay(
        waiting=State(unit, 0.0, "signal under way, oldest first", shape=(size,)),
        u=Input(unit, "signal", positive=positive),
    ):
        """Delay by a whole number of ticks."""
        return dict(waiting=vertcat(waiting[1:], u) if size > 1 else u), dict(y=waiting[0])

    return delay
