"""Adhesion filter and vehicle speed of Zhang 2021: what the slip controller of the train knows.

Signs as in the paper: T_b <= 0 and F_a <= 0 when braking.
"""

from casadi import (
    fabs,
    fmax,
    fmin,
    if_else,
    logic_and,
    logic_or,
)

from slipctl import (
    Block,
    Input,
    Noise,
    Output,
    Param,
    State,
    flow,
    law,
    one,
    ranged,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.estimate.kalman.filters import ctukf
from slipctl.models.shared_names import SLOPE
from slipctl.models.zhang_2021.hst_braking import GUESS, INERTIA, PERIOD, RADIUS, G

FORCE = "three times the load on a wheel of 13.8 t"
FASTEST = "430 km/h"
SLIP = "a locked wheel has 1; half as much again for noise"

MEASURED_SPEED = Input(
    "rad/s", lo=-1, hi="120 / r", change="30 / J", stale=10,
    source="430 km/h; (20 + 9) kN m of brake and rail on the wheel for 1 ms",
)  # fmt: skip
"""What a wheel speed can be: a wheel does not turn back but for noise, and its inertia is known."""

MEASURED_TORQUE = Input(
    "N m", lo=-40e3, hi=1e3, source="twice the largest torque; a brake does not drive"
)
"""What a brake torque can be. It has no largest change: a brake without lag jumps."""


@flow()
def wheel_model(
    omega=State("rad/s", 0.0, "wheel speed"),
    T_b=Input("N m", "brake torque", positive="traction", value=0.0),
    F_a=Input("N", "adhesion force", positive="traction", value=0.0),
    J=INERTIA,
    r=RADIUS,
):
    """Braked wheel as the filter knows it; Zhang 2021 eq (1), h of (19)."""
    return dict(omega=(T_b - r * F_a) / J), {}


def adhesion_filter(form: str = "consistent") -> Block:
    """Make the filter of the adhesion force from wheel speed and brake torque; (18)-(33).

    Args:
        form: ``"consistent"``: gamma acts per sample, P(0) = 4e6 N^2. ``"printed-22"``: spread and
            weights of (22)-(25) as printed. ``"printed-33"``: gamma per second and P(0) = 0.5 N^2
            as printed, which takes 40 s to wake up.
    """
    refuse_unknown_choice(
        "adhesion_filter", "form", form, ("consistent", "printed-22", "printed-33")
    )
    printed = form == "printed-33"
    found = ctukf(
        wheel_model, "omega", "F_a",
        prior=0.5 if printed else 4e6, noise=1.0, start=0.0, gamma=0.23, sigma=2.0,
        form="printed-22" if form == "printed-22" else "sampled",
        per="second" if printed else "sample",
    )  # fmt: skip
    return ranged(
        found,
        Output("N", FORCE, lo=-60e3, hi=60e3).named("F_a"),
        Output("N^2", "at most the limit of the filter", lo=0, hi="cap_F_a + prior_F_a").named(
            "variance_F_a"
        ),
        Output("rad/s", "the whole range of the wheel speed", lo=-700, hi=700).named(
            "innovation_omega"
        ),
        Output("1", "the square of 1e6 standard deviations", lo=0, hi=1e12).named("nis"),
        omega=MEASURED_SPEED,
        T_b=MEASURED_TORQUE,
        held_omega=State("rad/s", 0.0, lo=-1, hi="120 / r"),
        held_T_b=State("N m", 0.0, lo=-40e3, hi=1e3),
        held_F_a=State("N", 0.0, source=FORCE, lo=-60e3, hi=60e3),
        P_F_a=State("N^2", 0.0, lo=0, hi="2 * cap_F_a + prior_F_a"),
    )  # fmt: skip


# ---- vehicle speed -------------------------------------------------------------------------------


@law(a_m=Output("m/s^2", "measured acceleration", positive="traction"))
def accelerometer(
    a=Input("m/s^2", "acceleration of the train", positive="traction"),
    n=Noise(),
    bias=Param("m/s^2", 0.0, "bias", "guess", lo=-1, hi=1),
    sigma=Param("m/s^2", 0.0, "standard deviation of the noise per sample", "guess", lo=0, hi=5),
    slope=SLOPE,
    g=Param("m/s^2", G, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """Acceleration along the train as an accelerometer sees it: a gradient looks like a bias."""
    return a + g * slope + bias + sigma * n


@law(omega_m=Output("rad/s", "measured wheel speed"))
def wheel_speed_sensor(
    omega=Input("rad/s", "wheel speed"),
    n=Noise(),
    sigma=Param("rad/s", 0.0, "standard deviation of the noise per sample", lo=0, hi=10),
):
    """Wheel speed with white noise."""
    return omega + sigma * n


@step(
    v=Output("m/s", "estimated train speed", FASTEST, lo=-1, hi=120),
    lam=Output("1", "estimated slip ratio", SLIP, positive="braking", per="ratio", lo=-1.5, hi=1.5),
    variance_v=Output("m^2/s^2", "variance of the speed", "(10 m/s)^2", lo=0, hi=100),
    variance_lam=Output("1", "variance of the slip ratio", "(10 m/s over v_0)^2", lo=0, hi=1e4),
)
def speed_fusion(
    v_h=State("m/s", 50.0, "speed, predicted from the last tick", FASTEST, lo=-1, hi=120,
              deviation="sqrt(P_vv)", truth="v"),
    b_h=State("m/s^2", 0.0, "bias of the accelerometer", "a fifth of gravity", lo=-2, hi=2,
              deviation="sqrt(P_bb)", truth="bias + g * slope"),
    P_vv=State("m^2/s^2", 1e-4, "variance of the speed", "(10 m/s)^2", lo=0, hi=100),
    P_vb=State("m^2/s^3", 0.0, "covariance of speed and bias", "of both ends", lo=-20, hi=20),
    P_bb=State("m^2/s^4", 4e-4, "variance of the bias", "(2 m/s^2)^2", lo=0, hi=4),
    rolled=State("1", "calm", "ticks that the wheel has rolled", "as many as are asked for", lo=0,
                 hi=1000),
    omega=Input("rad/s", "measured wheel speed"),
    a_m=Input("m/s^2", "measured acceleration",
              "three times the friction of dry rail; a jump of the rail", positive="traction",
              lo=-15, hi=15, change=5),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    r=RADIUS,
    sigma_a=Param("m/s^2", 0.05, "noise of the accelerometer per sample", GUESS, lo=0, hi=100),
    sigma_b=Param("m/s^2.5", 1e-3, "drift of its bias, per root second", GUESS, lo=0, hi=1),
    sigma_w=Param("rad/s", 1e-3, "noise of the wheel speed per sample", lo=1e-9, hi=1),
    sigma_c=Param("m/s", 0.02, "creep of a rolling wheel", GUESS, lo=0, hi=100),
    F_roll=Param("N", 300.0, "adhesion force up to which a wheel rolls", GUESS, lo=0, hi=1e6),
    far=Param("m/s", 1.0, "rim and estimate are no further apart while a wheel rolls",
              "added; twice the largest of the runs", lo=0, hi=100),
    calm=Param("1", 20.0, "ticks of a small force after which the wheel rolls; four time constants"
               " of the adhesion filter", "added", lo=0, hi=1000),
    v_0=Param("m/s", 0.1, "least speed in the slip ratio", "added", lo=1e-3, hi=100),
    T=PERIOD,
):  # fmt: skip
    """Train speed and slip ratio from accelerometer and wheel speed, with their variances.

    The paper presumes such a fusion (its reference 36) and does not give it. Kalman filter of speed
    and bias: v' = a_m - b. A wheel tells the speed only while it rolls (|F_a| < F_roll). After
    wrong samples a force may change its sign, and is small for a moment while the wheel slides. So
    where the rim is further off, the force has to be small for ``calm`` ticks. A braked wheel turns
    slower than the train, so it is a lower bound: the speed is corrected where the rim is faster
    than the estimate. A gradient cannot be told from a bias. Speed, bias and slip ratio stay in
    their ranges, whatever was read.
    """
    rim = r * omega
    S = P_vv + (r * sigma_w) ** 2 + sigma_c**2
    small = fabs(F_a) < F_roll
    rolls = logic_and(small, logic_or(fabs(rim - v_h) < far, rolled >= calm))
    usable = logic_or(rolls, rim > v_h)
    K_v, K_b = usable * P_vv / S, usable * P_vb / S
    innovation = rim - v_h
    v = v_h + K_v * innovation
    b = fmax(-2 * one("m/s^2"), fmin(2 * one("m/s^2"), b_h + K_b * innovation))
    A_vv, A_vb, A_bb = (1 - K_v) * P_vv, (1 - K_v) * P_vb, P_bb - K_b * P_vb
    nxt = dict(
        v_h=fmax(-1 * one("m/s"), fmin(120 * one("m/s"), v + T * (a_m - b))),
        b_h=b,
        P_vv=A_vv - 2 * T * A_vb + T**2 * A_bb + (T * sigma_a) ** 2,
        P_vb=A_vb - T * A_bb,
        P_bb=A_bb + T * sigma_b**2,
        rolled=if_else(small, fmin(calm, rolled + 1), 0),
    )
    floor = fmax(v, v_0)
    lam = fmax(-1.5, fmin(1.5, (v - rim) / floor))
    variance_lam = ((1 - lam) / floor) ** 2 * A_vv + (r * sigma_w / floor) ** 2
    return nxt, dict(v=v, lam=lam, variance_v=A_vv, variance_lam=variance_lam)
