"""Adhesion filter and vehicle speed of Zhang 2021: what the slip controller of the train knows.

Signs as in the paper: T_b <= 0 and F_a <= 0 when braking.
"""

from casadi import (
    fabs,
    fmax,
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
    step,
)
from slipctl.errors import known
from slipctl.estimate.kalman.filters import ctukf
from slipctl.models.hst_braking import GUESS, I_W, SOURCE, TABLE_2, G, R
from slipctl.models.shared import SLOPE


@flow()
def wheel_model(
    omega=State("rad/s", 0.0, "wheel speed"),
    T_b=Input("N m", "brake torque", positive="traction", value=0.0),
    F_a=Input("N", "adhesion force", positive="traction", value=0.0),
    J=Param("kg m^2", I_W, "wheel inertia", f"{TABLE_2}, I_w", lo=1, hi=5000),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
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
    known("adhesion_filter", "form", form, ("consistent", "printed-22", "printed-33"))
    printed = form == "printed-33"
    return ctukf(
        wheel_model, "omega", "F_a",
        prior=0.5 if printed else 4e6, noise=1.0, start=0.0, gamma=0.23, sigma=2.0,
        form="printed-22" if form == "printed-22" else "sampled",
        per="second" if printed else "sample",
    )  # fmt: skip


# ---- vehicle speed -------------------------------------------------------------------------------


@law(a_m=Output("m/s^2", "measured acceleration", positive="traction"))
def accelerometer(
    a=Input("m/s^2", "acceleration of the train", positive="traction"),
    n=Noise(),
    bias=Param("m/s^2", 0.0, "bias", "guess", lo=-1, hi=1),
    sigma=Param("m/s^2", 0.0, "standard deviation of the noise per sample", "guess", lo=0, hi=5),
    slope=SLOPE,
    g=Param("m/s^2", G, "gravity", "not stated in the paper"),
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
    v=Output("m/s", "estimated train speed"),
    lam=Output("1", "estimated slip ratio", positive="braking", per="ratio"),
    variance_v=Output("m^2/s^2", "variance of the speed"),
    variance_lam=Output("1", "variance of the slip ratio"),
)
def speed_fusion(
    v_h=State(
        "m/s", 50.0, "speed, predicted from the last tick", deviation="sqrt(P_vv)", truth="v"
    ),
    b_h=State(
        "m/s^2", 0.0, "bias of the accelerometer", deviation="sqrt(P_bb)", truth="bias + g * slope"
    ),
    P_vv=State("m^2/s^2", 1e-4, "variance of the speed"),
    P_vb=State("m^2/s^3", 0.0, "covariance of speed and bias"),
    P_bb=State("m^2/s^4", 4e-4, "variance of the bias"),
    omega=Input("rad/s", "measured wheel speed"),
    a_m=Input("m/s^2", "measured acceleration", positive="traction"),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
    sigma_a=Param("m/s^2", 0.05, "noise of the accelerometer per sample", GUESS, lo=0),
    sigma_b=Param("m/s^2.5", 1e-3, "drift of its bias, per root second", GUESS, lo=0),
    sigma_w=Param("rad/s", 1e-3, "noise of the wheel speed per sample", lo=1e-9),
    sigma_c=Param("m/s", 0.02, "creep of a rolling wheel", GUESS, lo=0),
    F_roll=Param("N", 300.0, "adhesion force up to which a wheel rolls", GUESS, lo=0),
    v_0=Param("m/s", 0.1, "the slip ratio is not formed below", "added", lo=1e-3),
    T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
):
    """Train speed and slip ratio from accelerometer and wheel speed, with their variances.

    The paper presumes such a fusion (its reference 36) and does not give it. Kalman filter of speed
    and bias: v' = a_m - b. A wheel tells the speed only while it rolls (|F_a| < F_roll); a braked
    one turns slower than the train, so it is a lower bound: the speed is corrected where the rim
    is faster than the estimate. A gradient cannot be told from a bias.
    """
    rim = r * omega
    S = P_vv + (r * sigma_w) ** 2 + sigma_c**2
    usable = logic_or(fabs(F_a) < F_roll, rim > v_h)
    K_v, K_b = usable * P_vv / S, usable * P_vb / S
    innovation = rim - v_h
    v, b = v_h + K_v * innovation, b_h + K_b * innovation
    A_vv, A_vb, A_bb = (1 - K_v) * P_vv, (1 - K_v) * P_vb, P_bb - K_b * P_vb
    nxt = dict(
        v_h=v + T * (a_m - b),
        b_h=b,
        P_vv=A_vv - 2 * T * A_vb + T**2 * A_bb + (T * sigma_a) ** 2,
        P_vb=A_vb - T * A_bb,
        P_bb=A_bb + T * sigma_b**2,
    )
    floor = fmax(v, v_0)
    lam = (v - rim) / floor
    variance_lam = ((1 - lam) / floor) ** 2 * A_vv + (r * sigma_w / floor) ** 2
    return nxt, dict(v=v, lam=lam, variance_v=A_vv, variance_lam=variance_lam)
