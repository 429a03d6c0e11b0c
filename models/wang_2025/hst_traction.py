"""High-speed train with motors and air brakes on Polach adhesion; Wang et al., Appl. Sci. 2025.

Signs: a force that drives is positive (``"traction"``), v_s = v_w - v, v_w = r omega; a brake force
F_b >= 0 slows (``"braking"``).

    x' = v,   M v' = sum_i F_mu,i - F_d                                     (1)(2)
    J omega_i' = T_i - r F_mu,i - B_t omega_i                               (3), divided by r
    F_d = (6.796 + 0.062 V + 0.00143 V^2) M/1000 + M g slope, V in km/h     (4), gradient added
    F_mu,i = mu(v_s,i, v) W g                                           (5), wheel_rail/contact.py
    F_b = z K phi_k R_m/r,   K = (pi/4) d_z^2 p gamma_z eta_z               (9)(10), z pads added
    p / u = 1/(1 + T_p s),   u = PI(p_ref - p)                              (11)
    traction: F_contr/10 on each driven axle; braking: F_contr/32 on each   (12)-(14)
    F(v) = min(302 kN, 5.5 MW/v)                                            (33)

One motor and one axle are pages of their own; :func:`plant` puts the train together. The wheels'
step is in models/wheel_rail/axles.py, the motor with its currents in models/motors.py. What is
wrong in print is told in docs/errata.md. Valid for v >= 0; F_d for 0 <= v <= 90 m/s.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from casadi import fmax, fmin, pi

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    flow,
    law,
    one,
    replicate,
    sampled,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.models.shared_names import GRADIENT, SHARED, SLOPE
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.contact import polach

SOURCE = "Wang 2025"
TABLE_1 = "Wang 2025, Table 1"
GUESS = "guess, not in the paper"

TRAIN = {
    **{n: f"*.{n}" for n in ("n_m", "n_b", "F_top", "P_top", "B_t", "w_0", "w_1", "w_2")},
    "m_axle = m / n_b": "*.m_axle",
}
"""Numbers of the train that several parts have, beside those of every model."""

M_EFF = 500e3 + 32 * 93.75 / 0.445**2
"""Mass of the train with its rotating axles in kg."""

MOTOR_CARS = (True, True, False, True, False, False, True, True)
"""Eight cars, 5 of them with motors; their order is a guess, as of the CRH5 (paper ref 17)."""


def formation(cars: tuple[bool, ...] = MOTOR_CARS) -> Axles:
    """Axles of a train, each by itself; the lengths are guesses, not in the paper.

    From car to car 25 m, from bogie to bogie 19 m, from axle to axle 2.7 m; the inner axles of a
    motor car are driven.

    Args:
        cars: whether a car has motors, from the front.
    """
    places = (0.0, 2.7, 19.0, 21.7)
    return Axles(
        count=(1,) * 4 * len(cars),
        behind=tuple(25.0 * k + d for k in range(len(cars)) for d in places),
        driven=tuple(motor and d in (2.7, 19.0) for motor in cars for d in places),
    )


DISTINCT = formation()
"""32 axles, each by itself; 10 of them driven."""

GROUPED = DISTINCT.grouped()
"""10 driven axles as one and 22 others as one, for a rail that changes in time."""


# ---- the pages -----------------------------------------------------------------------------------


@flow(a=Output("m/s^2", "acceleration of the train", positive="traction"))
def body(
    x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
    v=State("m/s", 0.0, "train speed", lo=-1, hi=200),
    F_mu=Input("N", "contact force of an axle", positive="traction"),
    F_d=Input("N", "running resistance", value=0.0, positive="braking"),
    n=Param("1", 32.0, "axles, all alike", SOURCE, lo=1, hi=200),
    m=Param("kg", 500e3, "train", f"{TABLE_1}, M", lo=1e3, hi=1e8),
):
    """Train as a point; Wang 2025 eqs (1), (2) for axles that are all alike."""
    a = (n * F_mu - F_d) / m
    return dict(x=v, v=a), dict(a=a)


@flow(
    F_mu=Output("N", "contact force", positive="traction"),
    v_s=Output("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v_w=Output("m/s", "rim speed"),
)
def wheelset(
    omega=State("rad/s", 0.0, "speed of the axle", lo=-1e4, hi=1e4),
    T=Input("N m", "torque on the axle", positive="traction"),
    mu=Input("1", "adhesion coefficient", positive="traction"),
    v=Input("m/s", "train speed"),
    m_axle=Param("kg", 15625.0, "load of the axle", "W: M by 32 axles", lo=100, hi=5e4),
    J=Param("kg m^2", 93.75, "inertia of the axle", TABLE_1, lo=1, hi=1e4),
    B_t=Param("N m s", 0.01, "damping of the axle", TABLE_1, lo=0, hi=1e3),
    r=Param("m", 0.445, "wheel radius", TABLE_1, lo=0.2, hi=1),
    g=Param("m/s^2", 9.8, "gravity", TABLE_1, lo=1, hi=30),
):
    """One axle; Wang 2025 eqs (3), (5), (8) with the sign of (8) turned (docs/errata.md)."""
    F_mu = mu * m_axle * g
    v_w = r * omega
    return dict(omega=(T - r * F_mu - B_t * omega) / J), dict(F_mu=F_mu, v_s=v_w - v, v_w=v_w)


@law(
    F_d=Output(
        "N",
        "running resistance",
        positive="braking",
        source="twice the steepest gradient",
        lo="-0.2 * m * g",
        hi="0.2 * m * g",
    )
)
def resistance(
    v=Input("m/s", "train speed"),
    w_0=Param("N/t", 6.796, "constant part", f"{SOURCE} eq (4)", lo=0, hi=100),
    w_1=Param("N h/(t km)", 0.062, "linear part", f"{SOURCE} eq (4)", lo=0, hi=10),
    w_2=Param("N h^2/(t km^2)", 0.00143, "quadratic part", f"{SOURCE} eq (4)", lo=0, hi=1),
    m=Param("kg", 500e3, "train", f"{TABLE_1}, M", lo=1e3, hi=1e8),
    v_0=Param("m/s", 0.01, "speed below which it fades", "added", lo=1e-6, hi=10),
    slope=SLOPE,
    g=Param("m/s^2", 9.8, "gravity", TABLE_1, lo=1, hi=30),
):
    """Running resistance; Wang 2025 eq (4) read in N/t and km/h (docs/errata.md).

    38.2 kN at 200 km/h. Added here: it fades below v_0, so that it cannot drive the train; a
    gradient, which does not fade.
    """
    V = 3.6 * one("km s/(h m)") * v
    in_t = m * one("t/kg") / 1000
    F_rolling = (w_0 + w_1 * V + w_2 * V**2) * in_t * fmin(1, fmax(-1, v / v_0))
    return F_rolling + m * g * slope


@law(
    F_m=Output("N", "command of one motor, at its rims", positive="traction"),
    F_b=Output("N", "command of the brake of one axle", positive="braking"),
)
def distribution(
    F_contr=Input("N", "commanded force of the train", positive="traction"),
    n_m=Param("1", 10.0, "driven axles", SOURCE, lo=1, hi=200),
    n_b=Param("1", 32.0, "braked axles", SOURCE, lo=1, hi=200),
):
    """Command in equal parts: driven axles drive, all axles brake; Wang 2025 eqs (12)-(14)."""
    return dict(F_m=fmax(F_contr, 0) / n_m, F_b=fmax(-F_contr, 0) / n_b)


def tractive_effort(v: float, F_top: float = 302e3, P_top: float = 5.5e6) -> float:
    """Largest force of all motors in N at the rim speed v in m/s: min(302 kN, 5.5 MW/v), (33).

    The corner is at 18.212 m/s; the two printed cases meet at 18 m/s with a step.
    """
    return P_top / fmax(v, P_top / F_top)


def check_target(t: Sequence[float], v: Sequence[float], a: Sequence[float], name: str) -> None:
    """Refuse a target that motors and brakes cannot follow on any rail.

    Args:
        t: times in s.
        v: wanted speeds in m/s.
        a: wanted accelerations in m/s^2.
        name: of the target, for the message.

    Raises:
        BadInput: a negative speed, or a force beyond (33) or the brakes; says when.
    """
    t, v, a = (np.asarray(y, dtype=float) for y in (t, v, a))
    if v.min() < 0:
        k = int(np.argmin(v))
        raise BadInput(f"{name}: wanted speed {v[k]:g} m/s at {t[k]:g} s; it must not be negative")
    F_d = np.array(resistance.f.map(v.size)([], v[None], _packed(resistance))[1].full()).ravel()
    wanted = M_EFF * a + F_d
    top = 5.5e6 / np.maximum(v, 5.5e6 / 302e3)
    for excess, limit, what in ((wanted - top, top, "motors"), (-wanted - 480e3, 480e3, "brakes")):
        k = int(np.argmax(excess))
        if excess[k] > 0:
            has = float(np.broadcast_to(limit, v.shape)[k])
            best = ((has if what == "motors" else -has) - F_d[k]) / M_EFF
            raise BadInput(
                f"{name}: at {t[k]:.4g} s and {v[k]:.4g} m/s it wants {abs(wanted[k]) / 1e3:.4g} kN"
                f" of the {what}, which have {has / 1e3:.4g} kN; want {best:.3g} m/s^2 there,"
                f" not {a[k]:.3g}"
            )


def _packed(block: Block) -> Any:
    """Parameters of a block as its packed Function takes them."""
    return block.pack("param", block.param_values())


def motor(form: str = "consistent") -> Block:
    """Make a motor as a lag with the limit (33).

    Args:
        form: ``"consistent"`` limits the power by the speed of the motor's own wheel.
            ``"printed-33"`` by the speed of the train, with which a wheel that slips is fed with a
            power that grows with its speed (docs/errata.md).

    Raises:
        BadInput: unknown form.
    """
    refuse_unknown_choice("motor", "form", form, ("consistent", "printed-33"))

    @flow(
        T=Output("N m", "torque of the motor, at its axle", positive="traction"),
        name="motor", choices={"form": form},
    )  # fmt: skip
    def lagging(
        F_m=State(
            "N", 0.0, "force that the motor's current gives", lo=-1e6, hi=1e6, positive="traction"
        ),
        F_cmd=Input("N", "commanded force at the rims", positive="traction"),
        omega=Input("rad/s", "speed of the axle"),
        v=Input("m/s", "train speed"),
        tau=Param("s", 0.05, "time constant of the torque", GUESS, lo=1e-3, hi=2),
        F_top=Param("N", 302e3, "largest force of all motors", f"{SOURCE} eq (33)", lo=1, hi=1e9),
        P_top=Param("W", 5.5e6, "largest power of all motors", f"{SOURCE} eq (33)", lo=1, hi=1e10),
        n_m=Param("1", 10.0, "motors", SOURCE, lo=1, hi=200),
        r=Param("m", 0.445, "wheel radius", TABLE_1, lo=0.2, hi=1),
    ):
        """Motor with a first-order lag; it drives only, F_m <= min(F_top, P_top/v_w)/n_m."""
        speed = r * omega if form == "consistent" else v
        F_lim = P_top / fmax(speed, P_top / F_top) / n_m
        wanted = fmax(0, fmin(F_cmd, F_lim))
        return dict(F_m=(wanted - F_m) / tau), dict(T=r * fmin(F_m, F_lim))

    return lagging


@flow(
    T_b=Output("N m", "brake torque of one axle", positive="braking"),
    F_b=Output("N", "brake force of one axle, at its rims", positive="braking"),
    p_ref=Output("Pa", "wanted pressure"),
)
def air_brake(
    p=State("Pa", 0.0, "cylinder pressure", lo=0, hi=2e6),
    q=State(
        "Pa",
        "p",
        "integral part of the pressure loop; at the start it keeps the pressure",
        lo=-1e8,
        hi=1e8,
    ),
    F_cmd=Input("N", "commanded brake force of one axle", positive="braking"),
    p_max=Param("Pa", 450e3, "supply pressure", GUESS, lo=1e3, hi=2e6),
    F_max=Param("N", 15e3, "brake force of one axle at p_max", GUESS, lo=1, hi=1e5),
    z=Param("1", 4.0, "pads of one axle", GUESS, lo=1, hi=32),
    phi_k=Param("1", 0.35, "friction of a pad", GUESS, lo=0.01, hi=1),
    R_m=Param("m", 0.247, "mean friction radius", GUESS, lo=0.05, hi=1),
    gamma_z=Param("1", 2.0, "multiplier of the clamp", GUESS, lo=0.1, hi=20),
    eta_z=Param("1", 0.95, "efficiency of the rigging", GUESS, lo=0.1, hi=1),
    r=Param("m", 0.445, "wheel radius", TABLE_1, lo=0.2, hi=1),
    d_z=Param(
        "m",
        "sqrt(4*F_max*r/(pi*p_max*z*phi_k*R_m*gamma_z*eta_z))",
        "cylinder",
        "F_max",
        lo=0,
        hi=1e4,
    ),
    T_p=Param("s", 0.4, "time constant of the cylinder", GUESS, lo=1e-3, hi=5),
    K_p=Param("1", 4.0, "gain of the pressure loop", GUESS, lo=0, hi=100),
    K_i=Param("1/s", "K_p/T_p", "integral gain", "cancels the cylinder's pole", lo=0, hi=1e5),
):
    """Air brake of one axle with its pressure loop; Wang 2025 eqs (9)-(11), the loop is a guess.

    K is the force of one pad in N (called a pressure in print). The supply limits 0 <= u <= p_max,
    and p with it. Added here: the integral part follows the limited u, so that it does not wind up.
    """
    K_by_p = pi / 4 * d_z**2 * gamma_z * eta_z
    F_by_p = z * K_by_p * phi_k * R_m / r
    p_ref = fmin(fmax(F_cmd / F_by_p, 0), p_max)
    u = K_p * (p_ref - p) + q
    u_lim = fmin(fmax(u, 0), p_max)
    rates = dict(p=(u_lim - p) / T_p, q=K_i * (p_ref - p) + (u_lim - u) / T_p)
    return rates, dict(T_b=F_by_p * p * r, F_b=F_by_p * p, p_ref=p_ref)


# ---- the train -----------------------------------------------------------------------------------


def plant(
    adhesion: Block = polach,
    axles: Axles = GROUPED,
    h: float = 1e-3,
    motor: Block | None = None,
    brake: Block = air_brake,
    distinct: tuple[str, ...] = (),
) -> Block:
    """Connect the train: command, motors, brakes, resistance, axles, contact.

    Its input is ``F_contr``, the commanded force of the train in N. What a controller reads are
    states, or depends on states only, so it closes no algebraic loop:

    ``train.x``, ``train.v``; ``train.omega_d`` and ``motor.T``, speed and torque of each driven
    axle; ``brake.p``. For the log: ``train.v_s`` and ``train.mu`` of each axle with the extremes
    ``train.v_s_max``, ``train.v_s_min``, ``train.F_all``, ``train.F_rim`` (delivered by motors and
    brakes), ``train.a``, powers ``train.P_drive`` ...

    Args:
        adhesion: law from ``v_s`` and ``v`` to ``mu``.
        axles: ``GROUPED`` for a rail by time, ``DISTINCT`` for a rail by position.
        h: tick in s.
        motor: flow from ``F_cmd`` and ``omega`` (and ``v``) to ``T``: the lag, or
            ``motors.vector_drive()`` at h = 0.1 ms.
        brake: flow from ``F_cmd`` to ``T_b``.
        distinct: parameters of the law, beside those of its rail conditions, of which each axle
            has its own.
    """
    drive = sampled(_lagging if motor is None else motor, h, "rk4")
    shared = [k for k in ("F_cmd", "v") if k in drive.inputs]
    parts = {
        "split": distribution,
        "motor": replicate(drive, len(axles.motors), shared, axis="driven"),
        "brake": sampled(brake, h, "rk4"),
        "res": resistance,
        "train": rolling(adhesion, axles, h, distinct),
    }
    wires = {
        "split.F_contr": "F_contr",
        "motor.F_cmd": "split.F_m",
        "motor.omega": "train.omega_d",
        "brake.F_cmd": "split.F_b",
        "res.v": "train.v",
        "train.T": "motor.T",
        "train.T_b": "brake.T_b",
        "train.F_d": "res.F_d",
    }
    if "v" in shared:
        wires["motor.v"] = "train.v"
    return connect("plant", wires, share=SHARED | TRAIN | GRADIENT, **parts)


_lagging = motor()
