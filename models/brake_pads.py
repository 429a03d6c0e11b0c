"""Brake pads and blocks: friction over speed, force and temperature, so the torque that comes out.

    T_b = T mu/mu_n,   mu = s mu(N, V) max(1 - f max(theta - theta_f, 0), 0),   N = T/(mu_n r_f n_b)
    C theta' = T_b |omega| - k theta

T is the torque that the actuator would give at the nominal friction mu_n. So N is the force of one
of n_b blocks, in kN below. V is the rim speed in km/h:

    cast iron   0.6 (1.6 N + 100)/(8 N + 100) (V + 100)/(5 V + 100)      P10, Karwatzki's form
    composite   0.3 - 0.00081 V                                          FR513
    cosid       0.27
    disc        0.2375 + 0.000885 N - 0.000345 N^2                       to 15 kN

The formulas were read in the code of a train simulator, eu07/maszyna, friction.pas. Cast iron grips
three times as hard near standstill as at 120 km/h: that is where its wheels slide. Temperature,
fade and spread are numbers of the user.
"""

from __future__ import annotations

from collections.abc import Mapping

from casadi import fabs, fmax

from slipctl import Input, Output, Param, State, step
from slipctl.models.common_form import T_S

READ = "eu07/maszyna, friction.pas"
USER = "of the user"

MATERIALS: Mapping[str, Mapping[str, float]] = {
    "cast_iron": {"iron": 1.0},
    "composite": {"mu_0": 0.3, "by_V": -0.00081},
    "cosid": {"mu_0": 0.27},
    "disc": {"mu_0": 0.2375, "by_N": 0.000885, "by_N2": -0.000345},
}
"""Coefficients of each material; those that it has not are 0."""

MOST = {"disc": 15e3}
"""Force of a block in N up to which a formula holds, where it does not hold for all."""


def friction(material: str, force: float, speed: float) -> float:
    """Friction of a material at a force of one block in N and a rim speed in m/s, cold."""
    c = {"mu_0": 0.0, "by_V": 0.0, "by_N": 0.0, "by_N2": 0.0, "iron": 0.0, **MATERIALS[material]}
    return float(_friction(force / 1e3, 3.6 * abs(speed), **c))


def _friction(
    N: float, V: float, mu_0: float, by_V: float, by_N: float, by_N2: float, iron: float
) -> float:
    """Friction at a force in kN and a speed in km/h."""
    cast = 0.6 * (1.6 * N + 100) / (8 * N + 100) * (V + 100) / (5 * V + 100)
    return mu_0 + by_V * V + by_N * N + by_N2 * N * N + iron * cast


@step(
    T_b=Output("N m", "torque that reaches the wheelset", positive="braking"),
    mu_pad=Output("1", "friction of the pads", lo=0),
)
def pad(
    theta=State("K", 0.0, "temperature above the air", lo=0, hi=3000),
    T=Input("N m", "torque at the nominal friction", positive="braking"),
    omega=Input("rad/s", "wheel speed"),
    mu_n=Param("1", 0.3, "nominal friction, for which the torque is told", USER, lo=0.01, hi=1),
    blocks=Param("1", 8.0, "blocks of a wheelset", USER, lo=1, hi=64),
    r_f=Param("m", 0.46, "radius at which they act", USER, lo=0.05, hi=1),
    r_w=Param("m", 0.46, "radius of the wheel", USER, lo=0.2, hi=1),
    mu_0=Param("1", 0.3, "friction without speed and force", READ, lo=0, hi=1),
    by_V=Param("1", -0.00081, "change by km/h of the rim", READ, lo=-0.01, hi=0.01),
    by_N=Param("1", 0.0, "change by kN of a block", READ, lo=-0.1, hi=0.1),
    by_N2=Param("1", 0.0, "change by its square", READ, lo=-0.1, hi=0.1),
    iron=Param("1", 0.0, "1 for cast iron", READ, lo=0, hi=1),
    spread=Param("1", 1.0, "factor on the friction", USER, lo=0.1, hi=3),
    fade=Param("1/K", 0.0, "share lost by K above theta_f", USER, lo=0, hi=0.1),
    theta_f=Param("K", 250.0, "temperature at which the fade begins", USER, lo=0, hi=3000),
    C=Param("J/K", 1e9, "heat capacity of a wheelset's discs or wheels", USER, lo=1, hi=1e12),
    k=Param("W/K", 0.0, "what the air takes", USER, lo=0, hi=1e6),
    T_=Param("s", T_S, "sample period", "of the loop", lo=1e-6, hi=0.1),
):  # fmt: skip
    """Torque of pads whose friction is another one than the nominal."""
    N, V = fabs(T) / (mu_n * r_f * blocks) / 1e3, 3.6 * fabs(omega) * r_w
    mu = spread * _friction(N, V, mu_0, by_V, by_N, by_N2, iron)
    mu = fmax(mu * fmax(1 - fade * fmax(theta - theta_f, 0), 0), 0)
    T_b = T * mu / mu_n
    heat = fabs(T_b * omega) - k * theta
    return dict(theta=fmax(theta + T_ * heat / C, 0)), dict(T_b=T_b, mu_pad=mu)
