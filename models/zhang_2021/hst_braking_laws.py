"""Slip laws of Zhang 2021: prescribed performance and its rivals, feedback linearisation and PID.

Signs as in the paper, see ``hst_braking_control``. Each law gives the torque that it wants.
"""

from casadi import exp, fabs, fmax, fmin, if_else, log, logic_and, logic_or

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    law,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.models.zhang_2021.hst_braking import (
    GUESS,
    INERTIA,
    MASS,
    PERIOD,
    RADIUS,
    SOURCE,
    TABLE_3,
    WHEELS,
)
from slipctl.models.zhang_2021.hst_braking_estimate import (
    SLIP,
)
from slipctl.models.zhang_2021.hst_braking_reference import (
    FIRST,
)

LAM_START = Param("1", 0.0, "slip at the start", positive="braking", per="ratio", lo=-1.5, hi=1.5)

FIRST_SHARE = Param(
    "1", "fmax((lam_start - lam_ref_start)/delta_u, (lam_ref_start - lam_start)/delta_l)/eta_0",
    "error at the start over its bound", lo=0, hi=1,
)  # fmt: skip

WIDE = "ten times a locked wheel's; printed references run away"
INSIDE = 1 - 1e-9
"""Share of the funnel beyond which the error is taken for its bound."""

WANTED = "250 times the largest torque; arbitration limits it"
COUNTED = "the count stands still there"
FASTEST = "430 km/h; 5 m/s^2 for 1 ms, and noise"

# ---- slip laws -----------------------------------------------------------------------------------


def slip_torque(nu, v, F_a, lam, J, r, m, n, motion):
    """Torque at which lam' = nu by (7), or by (8) without ``motion``."""
    T = r * F_a - (J * v / r) * nu
    return T + J * n * (1 - lam) * F_a / (m * r) if motion else T


def funnel_pull(law, K1, eps, eta, zeta, delta_l, delta_u):
    """Rate at which a law pulls the error back into its funnel: K1 eps/l, or without 1/l."""
    width = (delta_l + delta_u) / 2
    if law == "barrier":
        return K1 * eta * width * eps
    return K1 * eps * eta * (zeta + delta_l) * (delta_u - zeta) / width


def prescribed(form: str = "consistent", law: str = "funnel", motion: bool = True) -> Block:
    """Make the prescribed performance controller E-PPFC; (10)-(17), (34).

    Args:
        form: ``"consistent"``, or ``"printed-17"``: (15) with its minus, (17) with g' = 1/g, no
            restart.
        law: ``"funnel"``: K1 eps/l as printed, whose pull vanishes at the bound. ``"barrier"``: the
            1/l left out, so that it does not.
        motion: keep the term of (7) that (8) neglects.
    """
    refuse_unknown_choice("prescribed", "form", form, ("consistent", "printed-17"))
    refuse_unknown_choice("prescribed", "law", law, ("funnel", "barrier"))
    printed = form == "printed-17"

    @step(
        T_wanted=Output("N m", "wanted torque", WANTED, positive="traction", lo=-5e6, hi=5e6),
        e=Output("1", "slip error", WIDE, lo=-5, hi=5),
        lower=Output("1", "lower bound of the error", WIDE, lo=-20, hi=0),
        upper=Output("1", "upper bound of the error", WIDE, lo=0, hi=20),
        share=Output("1", "error over its bound", "it restarts beyond 1", lo=-1, hi=100),
        restarts=Output("1", "restarts of the funnel so far", COUNTED, lo=0, hi=1e6),
        name="eppfc", choices={"form": form, "law": law, "motion": motion},
    )  # fmt: skip
    def eppfc(
        eta_h=State("1", "eta_0", "performance function", WIDE, lo=0, hi=20),
        count=State("1", 0.0, "restarts so far", COUNTED, lo=0, hi=1e6),
        lam=Input("1", "slip ratio", SLIP, positive="braking", per="ratio", lo=-1.5, hi=1.5),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        rate=Input("1/s", "its rate"),
        v=Input("m/s", "train speed"),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        eta_0=Param("1", 0.1, "half-width of the funnel at the start", TABLE_3, lo=1e-6, hi=1),
        eta_inf=Param("1", 0.005, "half-width of the funnel in the end", TABLE_3, lo=1e-6, hi=1),
        k=Param("1/s", 30.0, "rate at which the funnel narrows", TABLE_3, lo=0, hi=1e5),
        delta_l=Param("1", 1.2, "bound below, in half-widths", TABLE_3, lo=1e-3, hi=1e4),
        delta_u=Param("1", 1.2, "bound above, in half-widths", TABLE_3, lo=1e-3, hi=1e4),
        K1=Param("1/s", 100.0, "gain", TABLE_3, lo=0, hi=1e5),
        trip=Param("1", 0.95, "share of the bound at which the funnel restarts", GUESS, lo=0,
                   hi=1e9),
        reserve=Param("1", 0.6, "share of the new bound that the error has then", GUESS, lo=0.01,
                      hi=1000),
        v_min=Param("m/s", 0.5, "least speed in the law", GUESS, lo=1e-3, hi=1000),
        v_off=Param("m/s", 1.0, "speed below which slip control is off", GUESS, lo=0,
                    hi=1000),
        m=MASS, n=WHEELS, J=INERTIA, r=RADIUS, T=PERIOD,
        kappa=Param("1", "K1 * T", "gain per tick; from 2 on the error grows", lo=0, hi=2),
        lam_start=LAM_START, lam_ref_start=FIRST, first=FIRST_SHARE,
    ):  # fmt: skip
        """Prescribed performance slip control with estimated adhesion; Zhang 2021 (10)-(17), (34).

        T_b = r F_a - (I_w v/r)(-K1 eps/l + e eta'/eta + lam*') + I_w n (1 - lam) F_a/(m r), with
        1/l = 2 eta (zeta + dl)(du - zeta)/(dl + du), so that nothing is divided by g. Added here:
        the funnel restarts, wider, when the error comes to ``trip`` of its bound, because from
        beyond it the printed law never comes back.
        """
        e, awake, eta = lam - lam_ref, v >= v_off, eta_h
        if not printed:
            tripped = logic_or(e > trip * delta_u * eta_h, e < -trip * delta_l * eta_h)
            wider = fmax(eta_0, fmax(e / delta_u, -e / delta_l) / reserve)
            eta = if_else(tripped, wider, eta_h)
        zeta = fmax(-delta_l * INSIDE, fmin(delta_u * INSIDE, e / eta))
        eps = log((zeta + delta_l) / (delta_u - zeta)) / 2
        deta, speed = -k * (eta - eta_inf), fmax(v, v_min)
        if printed:
            ell = (1 / (zeta + delta_l) - 1 / (delta_u - zeta)) / (2 * eta)
            f, g = r**2 / (J * speed) * ell * F_a - ell * deta / eta * e, r / (J * speed) * ell
            T_wanted = (K1 * eps + f - ell * rate) / g
        else:
            pull = funnel_pull(law, K1, eps, eta, zeta, delta_l, delta_u)
            nu = -pull + e * deta / eta + rate
            T_wanted = slip_torque(nu, speed, F_a, lam, J, r, m, n, motion)
        nxt = dict(eta_h=eta_inf + (eta - eta_inf) * exp(-k * T), count=count if printed
                   else fmin(count + logic_and(tripped, awake), 1e6))  # fmt: skip
        shown = if_else(awake, eta_h, fmax(eta, fabs(e) / fmin(delta_l, delta_u)))
        upper, lower = delta_u * shown, -delta_l * shown
        return nxt, dict(T_wanted=T_wanted, e=e, lower=lower, upper=upper,
                         share=fmax(e / upper, e / lower), restarts=nxt["count"])  # fmt: skip

    return eppfc


def feedback_linearisation(motion: bool = True) -> Block:
    """Make the baseline E-FC, which the paper does not print.

    Args:
        motion: keep the term of (7) that (8) neglects.
    """

    @law(
        T_wanted=Output("N m", "wanted torque", WANTED, positive="traction", lo=-5e6, hi=5e6),
        e=Output("1", "slip error", WIDE, lo=-5, hi=5),
        name="efc", choices={"motion": motion},
    )  # fmt: skip
    def efc(
        lam=Input("1", "slip ratio", SLIP, positive="braking", per="ratio", lo=-1.5, hi=1.5),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        rate=Input("1/s", "its rate"),
        v=Input("m/s", "train speed"),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        K=Param(
            "1/s", 100.0, "gain; equal to K1, so that the comparison means something", lo=0, hi=1e5
        ),
        v_min=Param("m/s", 0.5, "least speed in the law", GUESS, lo=1e-3, hi=1000),
        m=MASS,
        n=WHEELS,
        J=INERTIA,
        r=RADIUS,
    ):
        """Feedback linearisation with estimated adhesion: lam' = -K e + lam*'."""
        e = lam - lam_ref
        nu = -K * e + rate
        T = slip_torque(nu, fmax(v, v_min), F_a, lam, J, r, m, n, motion)
        return dict(T_wanted=T, e=e)

    return efc


def pid(gains: str = "rule") -> Block:
    """Make the baseline PID.

    Args:
        gains: ``"rule"``: on (8) with the adhesion constant the loop is s^2 + b Kp s + b Ki with
            b = r/(I_w v). Both poles are put at K/2, so Kp = K/b and Ki = K^2/(4 b), K the gain of
            the other laws. Kd = 0, because on an integrator it only adds inertia. ``"printed"``:
            100, 10, 1, read as kN m, kN m/s and kN m s.
    """
    refuse_unknown_choice("pid", "gains", gains, ("rule", "printed"))
    rule = gains == "rule"

    @step(
        T_wanted=Output("N m", "wanted torque", WANTED, positive="traction", lo=-5e6, hi=5e6),
        e=Output("1", "slip error", WIDE, lo=-5, hi=5),
        name="pid", choices={"gains": gains},
    )  # fmt: skip
    def controller_pid(
        integral=State("N m", 0.0, "integral part", WANTED, lo=-5e6, hi=5e6),
        e_last=State("1", "lam_start - lam_ref_start", "slip error of the last tick", lo=-5, hi=5),
        lam=Input("1", "slip ratio", SLIP, positive="braking", per="ratio", lo=-1.5, hi=1.5),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        v=Input("m/s", "train speed"),
        K=Param("1/s", 100.0, "wanted bandwidth, that of the other laws", lo=0, hi=1e5),
        K_p=Param("N m", 100e3, "proportional gain", f"{SOURCE}, section 5.2, unit guessed", lo=0,
                  hi=1e8),
        K_i=Param("N m/s", 10e3, "integral gain", f"{SOURCE}, section 5.2, unit guessed", lo=0,
                  hi=1e7),
        K_d=Param("N m s", 1e3, "derivative gain", f"{SOURCE}, section 5.2, unit guessed", lo=0,
                  hi=1e6),
        T_max=Param("N m", 20e3, "largest torque", GUESS, lo=1, hi=1e8),
        v_min=Param("m/s", 0.5, "least speed in the rule", GUESS, lo=1e-3, hi=1000),
        J=INERTIA,
        r=RADIUS,
        lam_start=LAM_START, lam_ref_start=FIRST,
        T=PERIOD,
    ):  # fmt: skip
        """PID on the slip error; T_b grows towards 0 with the error.

        Added here: the integral stands still while the torque is limited (anti-windup).
        """
        e = lam - lam_ref
        if rule:
            P, I = K * J * fmax(v, v_min) / r, K**2 / 4 * J * fmax(v, v_min) / r
            T_wanted = P * e + integral
        else:
            P, I = K_p, K_i
            T_wanted = P * e + integral + K_d * (e - e_last) / T
        free = logic_or(
            logic_and(T_wanted < 0, T_wanted > -T_max),
            logic_or(logic_and(T_wanted >= 0, e < 0), logic_and(T_wanted <= -T_max, e > 0)),
        )
        nxt = dict(integral=integral + if_else(free, T * I * e, 0), e_last=e)
        return nxt, dict(T_wanted=T_wanted, e=e)

    return controller_pid
