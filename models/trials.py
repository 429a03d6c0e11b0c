"""Trials on the line that tell a vehicle's numbers: coasting, and steps of the brake.

Coasting, with m the mass, rho the rotating mass as a share of it, n J/(m r^2) for n axles:

    m (1 + rho) v' = -(c0 + c1 |v| + c2 v^2) sign(v) - m g slope

Steps of the brake, after a dead time that a fit may look for (``--delay T_cmd``):

    tau T_b' = k T_cmd - T_b,    T = T_b + T_0

``slipctl fit LOG --law coasting`` finds their parameters (docs/trials.md).
"""

from typing import Any

from casadi import fabs, fmax, fmin

from slipctl import Input, Output, Param, State, flow

KEYS = {
    "coasting": {
        "c0": "vehicle.resistance.a", "c1": "vehicle.resistance.b", "c2": "vehicle.resistance.c",
    },
    "brake_step": {"k": "actuator.gain", "tau": "actuator.lag", "dead_time": "actuator.dead_time"},
}  # fmt: skip
"""Keys of a vehicle's file that the parameters of a trial fill, and its dead time."""

STEPS = {"actuator.dead_time": 1e-3}
"""Keys that a vehicle's file takes in whole steps: a dead time, in samples of 1 ms."""

CHOSEN = "start of a fit"

SLOPE = Input("1", "gradient, rise over run, uphill positive", value=0.0, lo=-0.1, hi=0.1)
MASS = Param("kg", None, "mass", lo=100, hi=1e8)
ROTATING = Param("1", None, "rotating mass, a share of the mass", lo=0, hi=1)
GRAVITY = Param("m/s^2", 9.81, "gravity", lo=1, hi=30)
COASTS = Output("m/s^2", "acceleration, without a brake on any line", lo=-2, hi=2)
FADE = Param("m/s", 0.1, "speed below which resistance fades", "as of davis", lo=1e-4, hi=100)


def resistance_share(v: Any, v_0: Any) -> Any:
    """Share of the resistance that is left: it cannot push a standing train backwards."""
    return fmax(-1, fmin(1, v / v_0))


@flow(a=COASTS, coordinates=("c0", "c1", "c2"))
def coasting(
    v=State("m/s", 20.0, "speed", lo=-200, hi=200),
    slope=SLOPE,
    m=MASS,
    rho=ROTATING,
    c0=Param("N", 1e3, "constant part of the resistance", CHOSEN, lo=0, hi=1e7),
    c1=Param("N s/m", 10.0, "linear part", CHOSEN, lo=0, hi=1e6),
    c2=Param("N s^2/m^2", 5.0, "quadratic part", CHOSEN, lo=0, hi=1e5),
    g=GRAVITY,
    v_0=FADE,
):
    """A vehicle that coasts against Davis resistance and the gradient."""
    F_R = (c0 + c1 * fabs(v) + c2 * v**2) * resistance_share(v, v_0)
    a = -(F_R + m * g * slope) / (m * (1 + rho))
    return dict(v=a), dict(a=a)


@flow(a=COASTS, coordinates=("c0", "c1", "c2"))
def coasting_by_mass(
    v=State("m/s", 20.0, "speed", lo=-200, hi=200),
    slope=SLOPE,
    rho=ROTATING,
    c0=Param("N/kg", 0.02, "constant part of the resistance", CHOSEN, lo=0, hi=10),
    c1=Param("N s/(m kg)", 2e-4, "linear part", CHOSEN, lo=0, hi=1),
    c2=Param("N s^2/(m^2 kg)", 5e-5, "quadratic part", CHOSEN, lo=0, hi=0.1),
    g=GRAVITY,
    v_0=FADE,
):
    """A vehicle that coasts, its resistance by its mass: the mass need not be known."""
    f = (c0 + c1 * fabs(v) + c2 * v**2) * resistance_share(v, v_0)
    a = -(f + g * slope) / (1 + rho)
    return dict(v=a), dict(a=a)


@flow(
    T=Output("N m", "measured torque", positive="braking"),
    coordinates=("k", "tau"),
    beside={
        "T_max": Param("N m", None, "torque at full command", lo=1, hi=1e8),
        "m": MASS,
        "rho": ROTATING,
        "r": Param("m", None, "wheel radius", lo=0.2, hi=1),
        "n": Param("1", None, "braked axles", lo=1, hi=64),
    },
)
def brake_step(
    T_b=State("N m", 0.0, "brake torque", lo=-1e8, hi=1e8, positive="braking"),
    T_cmd=Input("N m", "commanded torque", positive="braking"),
    k=Param("1", 1.0, "delivered by commanded torque", CHOSEN, lo=0.01, hi=100),
    tau=Param("s", 0.1, "time constant", CHOSEN, lo=1e-3, hi=5),
    T_0=Param("N m", 0.0, "what is measured without the brake", "chosen", lo=-1e8, hi=1e8),
):
    """A brake of one axle: gain and first-order lag.

    Beside it are numbers that turn other columns round: ``T_cmd='Command[%] * T_max'``,
    ``T='Force[kN] * r / n'``, ``T='Deceleration[m/s^2] * m * (1 + rho) * r / n'``.
    """
    return dict(T_b=(k * T_cmd - T_b) / tau), dict(T=T_b + T_0)
