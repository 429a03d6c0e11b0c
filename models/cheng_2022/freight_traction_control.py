"""Creep control of Cheng 2022: an asymmetric barrier Lyapunov law on the motor torque.

With e = v_s - v_ref and the plant of ``freight_traction``, e' = gamma T_m - D - v_ref',
gamma = r/(J R_g), a wanted e' = -kappa(e) is reached by

    T_m = (D + v_ref' - kappa(e))/gamma

    printed shape   kappa = 2 k e (k_x^2 - e^2)          (42), (44), k_x = k_a for e < 0, else k_s
    robust shape    kappa = q e k_x^2/(k_x^2 - e^2)      added here: the gain grows at the barrier

Equations (42), (44), (47) print -f in place of D, which (8) makes positive. The command then adds
to the disturbance, e' = -2 D - kappa(e). The creep rests below the wanted one, where the far
stronger pull of the k_a side equals 2 D. The pull of the printed shape vanishes at the barrier: it
holds disturbances below 4 k k_s^3/(3 sqrt 3) only (``certificate.barrier``).

Added here: D from adhesion estimate and resistance as known; v_ref' is an input, because a seeker
knows it; a torque limit. The robust shape counts e at most ``share`` of the way to the barrier, so
that beyond it the pull is large, finite, and still inwards.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from casadi import fmax, fmin, if_else

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    law,
    luenberger,
    one,
    ranged,
    sampled,
    step,
)
from slipctl.certify.bounds import extremum, observers
from slipctl.errors import refuse_unknown_choice
from slipctl.models.cheng_2022.certificate import barrier as barrier_bounds
from slipctl.models.cheng_2022.freight_traction import (
    GUESS,
    TABLE_2,
    TRAIN,
    adhesion_of_load,
    resistance,
    shaft,
)
from slipctl.models.ranges import observer_ranged, seeker_ranged
from slipctl.models.shared_names import SHARED
from slipctl.seek.extremum import warn_regime

FORMS = ("robust", "consistent", "printed-42")
SECTION_4 = "Cheng 2022, section 4"


@law(
    D_hat=Output(
        "m/s^2",
        "what the creep falls by, as known",
        positive="traction",
        source="adhesion of 2",
        lo="-10 - 2 * m_axle * g * (r**2 / (J * R_g**2) + n_d / m)",
        hi="10 + 2 * m_axle * g * (r**2 / (J * R_g**2) + n_d / m)",
    )
)
def disturbance(
    mu_hat=Input(
        "1",
        "adhesion estimate",
        positive="traction",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    ),
    F_Z_hat=Input(
        "N",
        "running resistance, as known",
        value=0.0,
        positive="braking",
        source="half the weight of the heaviest train",
        lo=-2e8,
        hi=2e8,
    ),
    m=Param("kg", 6e6, "train, as the controller knows it", f"{TABLE_2}, M", lo=1e4, hi=3e7),
    m_axle=Param("kg", 30e3, "load of one driven axle", f"{TABLE_2}, W", lo=1e3, hi=5e4),
    n_d=Param("1", 8.0, "driven axles, all alike", GUESS, lo=1, hi=64),
    J=Param("kg m^2", 40.0, "inertia at one motor", GUESS, lo=0.1, hi=1e4),
    r=Param("m", 0.625, "wheel radius", f"{TABLE_2}, printed as a diameter", lo=0.2, hi=1),
    R_g=Param("1", 6.294, "gear, motor to wheel", TABLE_2, lo=1, hi=20),
    g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """D = r^2/(J R_g^2) F_a + (n_d F_a - F_Z)/M; Cheng 2022 eq (39) with its signs turned."""
    F_a = mu_hat * m_axle * g
    return r**2 / (J * R_g**2) * F_a + (n_d * F_a - F_Z_hat) / m


def barrier_law(form: str = "robust") -> Block:
    """Make the law from creep to torque.

    Args:
        form: ``"robust"``, ``"consistent"`` (the printed shape with the signs put right), or
            ``"printed-42"``, which takes -D for D and so doubles it.

    Raises:
        BadInput: an unknown form.
    """
    refuse_unknown_choice("barrier_law", "form", form, FORMS)
    outputs = dict(
        T_cmd=Output("N m", "commanded torque", positive="traction", lo="-T_max", hi="T_max"),
        e=Output("m/s", "creep error", source="a wheel that spins free", lo=-120, hi=1000),
        name="barrier", choices={"form": form},
    )  # fmt: skip
    V_S = Input("m/s", "creep, rim minus train", positive="traction", per="speed",
                source="a wheel that spins free", lo=-120, hi=1000)  # fmt: skip
    V_REF = Input("m/s", "wanted creep", positive="traction", per="speed",
                  source="twice the range that is searched", lo=-20, hi=20)  # fmt: skip
    RATE = Input("m/s^2", "rate of the wanted creep", value=0.0,
                 source="a thousand times the largest of the seekers", lo=-1000,
                 hi=1000)  # fmt: skip
    D_HAT = Input("m/s^2", "what the creep falls by, as known", positive="traction",
                  source="adhesion of 2 on the least inertia", lo=-1e6, hi=1e6)  # fmt: skip
    K_A = Param("m/s", "k_s + v_sopt", "barrier below", lo=0, hi=50)
    K_S = Param("m/s", 0.02, "barrier above", SECTION_4, lo=1e-4, hi=1)
    V_OPT = Param("m/s", 1.2098601, "best creep, as known", "peak of Table 1", lo=0.01, hi=20)
    J_M = Param("kg m^2", 40.0, "inertia at one motor", GUESS, lo=0.1, hi=1e4)
    R = Param("m", 0.625, "wheel radius", f"{TABLE_2}, printed as a diameter", lo=0.2, hi=1)
    GEAR = Param("1", 6.294, "gear, motor to wheel", TABLE_2, lo=1, hi=20)
    T_MAX = Param("N m", 12e3, "largest torque", GUESS, lo=1, hi=1e6)
    if form == "robust":

        @law(**outputs)
        def robust(
            v_s=V_S, v_ref=V_REF, rate=RATE, D_hat=D_HAT, k_s=K_S, v_sopt=V_OPT, k_a=K_A,
            q=Param("1/s", 50.0, "rate of small errors", "chosen", lo=0.1, hi=1e4),
            share=Param("1", 0.95, "largest e counted, of the barrier", "chosen", lo=0.1, hi=0.999),
            J=J_M, r=R, R_g=GEAR, T_max=T_MAX,
        ):  # fmt: skip
            """Robust barrier law: kappa = q e k_x^2/(k_x^2 - e^2), which grows at the barrier."""
            e = v_s - v_ref
            k_x = if_else(e < 0, k_a, k_s)
            z = fmin(share, fmax(-share, e / k_x))
            kappa = q * e / (1 - z**2)
            T = (D_hat + rate - kappa) * J * R_g / r
            return dict(T_cmd=fmin(T_max, fmax(-T_max, T)), e=e)

        return robust
    turn = 1 if form == "consistent" else -1

    @law(**outputs)
    def printed(
        v_s=V_S, v_ref=V_REF, rate=RATE, D_hat=D_HAT, k_s=K_S, v_sopt=V_OPT, k_a=K_A,
        k=Param("s/m^2", 1200.0, "gain k1 = k2", SECTION_4, lo=0, hi=1e7),
        J=J_M, r=R, R_g=GEAR, T_max=T_MAX,
    ):  # fmt: skip
        """Barrier law; Cheng 2022 eqs (42), (44): kappa = 2 k e (k_x^2 - e^2)."""
        e = v_s - v_ref
        k_x = if_else(e < 0, k_a, k_s)
        kappa = 2 * k * e * (k_x**2 - e**2)
        T = (turn * D_hat + rate - kappa) * J * R_g / r
        return dict(T_cmd=fmin(T_max, fmax(-T_max, T)), e=e)

    return printed


def controller(
    form: str = "robust", period: float = 2e-4, name: str = "ctl", **values: float
) -> Block:
    """Connect disturbance and barrier law: from v_s, v_ref, mu_hat, F_Z_hat, rate to T_cmd.

    Args:
        form: as of :func:`barrier_law`.
        period: sample period in s, checked against the gain; ``"printed-42"`` is not checked.
        name: name of the controller.
        **values: parameters of the barrier law.

    Raises:
        BadInput: a gain that the period cannot carry, with the one that would pass.
    """
    block = barrier_law(form)
    block = block.with_params(**values) if values else block
    _check_gain("barrier_law", block.param_values(), form, period)
    wires = {
        "disturbance.mu_hat": "mu_hat",
        "disturbance.F_Z_hat": "F_Z_hat",
        "barrier.D_hat": "disturbance.D_hat",
        "barrier.v_s": "v_s",
        "barrier.v_ref": "v_ref",
        "barrier.rate": "rate",
        "T_cmd": "barrier.T_cmd",
    }
    return connect(name, wires, share=SHARED | TRAIN, disturbance=disturbance, barrier=block)


# ---- what stands around the law ------------------------------------------------------------------


@law(
    v_s=Output(
        "m/s",
        "creep, as measured",
        positive="traction",
        per="speed",
        source="a wheel that spins free",
        lo=-120,
        hi=1000,
    )
)
def creep(
    omega_m=Input(
        "rad/s",
        "measured motor speed",
        source="ten times the motor's speed at 100 km/h: a wheel that spins free",
        lo=-500,
        hi=1e4,
    ),
    v_t=Input(
        "m/s",
        "measured train speed",
        source="430 km/h; 5 m/s^2 for .2 ms, and noise",
        lo=-5,
        hi=120,
        change=0.001,
        noise=0.1,
    ),
    r=Param("m", 0.625, "wheel radius", f"{TABLE_2}, printed as a diameter", lo=0.2, hi=1),
    R_g=Param("1", 6.294, "gear, motor to wheel", TABLE_2, lo=1, hi=20),
):
    """Creep from both speeds; Cheng 2022 eqs (3), (8)."""
    return r * omega_m / R_g - v_t


def reference(period: float = 2e-4) -> Block:
    """Make the wanted creep, whose rate is limited and known.

    Args:
        period: sample period in s.
    """

    @step(
        v_ref=Output("m/s", "wanted creep", positive="traction", per="speed",
                     source="twice the range that is searched", lo=-20, hi=20),
        rate=Output("m/s^2", "its rate", lo="-most", hi="most"),
        period=period, name="reference",
    )  # fmt: skip
    def follow(
        x=State(
            "m/s", 0.0, "wanted creep", source="twice the range that is searched", lo=-20, hi=20
        ),
        v=Input(
            "m/s",
            "creep that the seeker tries",
            source="twice the range that is searched",
            lo=-20,
            hi=20,
        ),
        w_r=Param("1/s", 200.0, "rate at which it follows", "added", lo=1, hi=1e4),
        most=Param(
            "m/s^2",
            1.5,
            "largest rate of the creep",
            "added, above the k of the seekers",
            lo=1e-3,
            hi=1e4,
        ),
        T=Param("s", period, "sample period", GUESS, lo=1e-6, hi=0.1),
    ):
        """Wanted creep, added here: v_ref' = sat(w_r (v - v_ref)).

        The law needs v_ref'; a seeker jumps when it locks, and turns at once.
        """
        rate = fmin(most, fmax(-most, w_r * (v - x)))
        return dict(x=x + T * rate), dict(v_ref=x, rate=rate)

    return follow


@law(
    T_cmd=Output(
        "N m",
        "commanded torque",
        "from one end of the torque to the other",
        positive="traction",
        lo="-1e6 * (1 + tau / tau_d)",
        hi="1e6 * (1 + tau / tau_d)",
    )
)
def lead(
    T_wanted=Input(
        "N m",
        "wanted torque",
        positive="traction",
        source="eighty times the largest torque",
        lo=-1e6,
        hi=1e6,
    ),
    T_m=Input(
        "N m",
        "motor torque, as measured",
        positive="traction",
        source="eighty times the largest torque",
        lo=-1e6,
        hi=1e6,
    ),
    tau=Param("s", 0.02, "time constant of the motor, as known", GUESS, lo=1e-4, hi=1),
    tau_d=Param("s", 0.005, "wanted time constant", "chosen", lo=1e-4, hi=1),
):
    """Faster motor, added here: tau T_m' = T_cmd - T_m becomes tau_d T_m' = T_wanted - T_m."""
    return T_m + tau / tau_d * (T_wanted - T_m)


@law(
    v=Output(
        "m/s",
        "creep to hold",
        positive="traction",
        per="speed",
        source="twice the range that is searched",
        lo=-20,
        hi=20,
    )
)
def hold(
    y=Input(
        "1",
        "adhesion estimate",
        positive="traction",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    ),
    v_hold=Param("m/s", 1.2098601, "creep to hold", "peak of Table 1", lo=0, hi=20),
):
    """Fixed creep in the place of a seeker."""
    return v_hold + 0 * y * one("m/s")


def seeking_controller(
    seek: Block,
    form: str = "robust",
    period: float = 2e-4,
    *,
    pole: float = -400.0,
    lag: float | None = None,
    name: str = "ctl",
    **values: float,
) -> Block:
    """Connect observer, seeker, reference and barrier law: from the two speeds to a torque.

    Inputs ``omega_m`` and ``v_t`` (measured speeds) and ``T_m`` (torque of the motor, as its own
    control knows it), output ``T_cmd``. The running resistance is that of the parameters of
    ``resistance``, as identified.

    Args:
        seek: step from ``y``, the adhesion estimate, to ``v``, the creep to try.
        form: of the barrier law.
        period: sample period in s.
        pole: double pole of the observer in 1/s.
        lag: time constant in s of the motor, which a lead shortens to a quarter; None has no lead.
        name: name of the controller.
        **values: parameters of the barrier law.

    Raises:
        BadInput: poles, gains or a period that cannot work.
    """
    observer = luenberger(shaft, [pole, pole], measured="omega_m")
    parts = {
        "observer": sampled(observer_ranged(observer), period, "rk4"),
        "adhesion": adhesion_of_load,
        "creep": creep,
        "resistance": resistance,
        "seek": seeker_ranged(seek),
        "reference": reference(period),
        **controller(form, period, **values).parts,
    }
    wires = {
        "observer.omega_m_measured": "omega_m",
        "observer.T_m": "T_m",
        "adhesion.T_L_hat": "observer.T_L_hat",
        "creep.omega_m": "omega_m",
        "creep.v_t": "v_t",
        "resistance.v": "v_t",
        "seek.y": "adhesion.mu_hat",
        "reference.v": "seek.v",
        "disturbance.mu_hat": "adhesion.mu_hat",
        "disturbance.F_Z_hat": "resistance.F_Z",
        "barrier.D_hat": "disturbance.D_hat",
        "barrier.v_s": "creep.v_s",
        "barrier.v_ref": "reference.v_ref",
        "barrier.rate": "reference.rate",
        "T_cmd": "barrier.T_cmd",
    }
    if lag is not None:
        parts["lead"] = lead.with_params(tau=lag, tau_d=lag / 4)
        wires |= {
            "lead.T_wanted": "barrier.T_cmd", "lead.T_m": "T_m", "T_cmd": "lead.T_cmd",
        }  # fmt: skip
    share = (
        SHARED
        | TRAIN
        | {
            # a seeker may have another r
            "r": ["adhesion.r", "creep.r", "disturbance.r", "barrier.r"],
            "omega_m_start": "observer.omega_m",
        }
    )
    block = connect(name, wires, share=share, **parts)
    check(name, block.values_by_place(), period, form)
    motor = Input("N m", source="twice the largest torque", lo="-2 * T_max", hi="2 * T_max")
    return ranged(block, T_m=motor)


def check(
    where: str,
    p: Mapping[str, Any],
    period: float,
    form: str = "robust",
    error: float = 0.0,
    steepest: float | None = None,
) -> None:
    """Refuse parameters of a :func:`seeking_controller` that cannot work, before a run.

    The printed law is refused nothing but its observer: it is there to show that it fails.

    Args:
        where: name for the messages.
        p: values of its parameters.
        period: sample period in s.
        form: of the barrier law.
        error: creep error in m/s at the start.
        steepest: largest slope of the adhesion in s/m; a seeker that never slides is warned of.

    Raises:
        BadInput: an unstable or slow observer, a barrier smaller than the error at the start, a
            gain that the period cannot carry. A seeker that passes its cells in a tick or whose
            dither is near the corners of its filters. Each with a value that would pass.
    """
    A = [[-float(p["observer.L_omega_m"]), -1 / float(p["observer.J"])],
         [-float(p["observer.L_T_L"]), 0.0]]  # fmt: skip
    observers.check_poles(f"{where}.observer", np.linalg.eigvals(np.array(A)), what="gains")
    k_a, k_s = float(p["barrier.k_a"]), float(p["barrier.k_s"])
    if form != "printed-42":
        barrier_bounds.check_start(f"{where}.barrier", error, k_a, k_s)
    _check_gain(f"{where}.barrier", {n.partition(".")[2]: v for n, v in p.items()
                                     if n.startswith("barrier.")}, form, period)  # fmt: skip
    s = {n.partition(".")[2]: float(v) for n, v in p.items() if n.startswith("seek.")}
    seek = f"{where}.seek"
    if {"k", "rho", "beta"} <= set(s):
        extremum.check_sampling(seek, s["beta"], s["rho"], period)
        if steepest is not None:
            warn_regime(seek, s["k"], s["rho"], steepest)
    if {"w", "w_h", "w_l"} <= set(s):
        extremum.check_dither(seek, s["w"], s["w_h"], s["w_l"], period)


def _check_gain(where: str, p: Mapping[str, Any], form: str, period: float) -> None:
    """Refuse a gain that the period cannot carry."""
    if form == "robust":
        share = min(float(p["share"]), 0.9)
        barrier_bounds.check_rate(where, float(p["q"]), period, share)
    elif form == "consistent":
        barrier_bounds.check_period(
            where, float(p["k"]), float(p["k_a"]), float(p["k_s"]), period
        )  # fmt: skip
