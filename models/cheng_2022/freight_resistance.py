"""Identification of the running resistance of a freight train; Cheng 2022 section 3.2.

    (14)  M v_t' = n_d F_a - F_Z,  F_Z = (a1 + a2 v + a3 v^2) M g/1000      with a1 in N/kN
    ours  y = (n_d F_a - M v_t') 1000/(M g) = a1 + a2 v + a3 v^2            linear in a1, a2, a3

so that least squares solves it. Equations (15)-(20) cannot: (17) counts the signals F_a and T_L
among the parameters, and YY' is singular (docs/errata.md). No acceleration is measured. Filtering
both sides by 1/(tau s + 1) takes its place, because s/(tau s + 1) v is known from v alone:

    [n_d F_a]_f - M d = (a1 [1]_f + a2 [v]_f + a3 [v^2]_f) M g/1000,    tau d' = v' - d

All filters start at zero, d too, and then this is exact from the first sample on. Sampled, each
1/(tau s + 1) is Tustin's rule. So is d, because v is the integral of v' by the trapezoidal rule
up to h^2/12 times the second derivative of v'. The noise of v enters as that of d, which has no
low frequencies, while the regressors have only these.
"""

import math
from typing import Any

from casadi import exp

from slipctl import BadInput, Block, Input, Output, Param, State, connect, law, one, opened, step
from slipctl.errors import refuse_unknown_choice
from slipctl.estimate.identification import linear_fit, swarm_fit
from slipctl.models.cheng_2022.freight_traction import GUESS, TABLE_2, TRAIN, resistance
from slipctl.models.shared_names import SHARED

BOX = {"a1": (0.0, 1.0), "a2": (0.0, 0.1), "a3": (0.0, 0.01)}
"""Range of each coefficient; a guess, none is printed."""

FORMS = ("consistent", "printed-21")
TABLE_3 = "Cheng 2022, Table 3"
PARTICLES, ITERATIONS = 60, 300
"""Size and length of the swarm, Table 3."""

A1 = Param("N/kN", 0.5, "constant part", TABLE_2, lo=0, hi=10)
A2 = Param("N s/(kN m)", 0.04, "linear part", TABLE_2, lo=0, hi=1)
A3 = Param("N s^2/(kN m^2)", 0.0026, "quadratic part", TABLE_2, lo=0, hi=0.1)


def printed_inertia(share: Any) -> Any:
    """Inertia of iteration i, share = i/G: .279 exp(-.49 i/G), falling from .279 to .171."""
    w = 0.8 - 0.1
    return w / math.sqrt(2 * math.pi) * exp(-share * w**2)


def swarm_settings(form: str = "consistent") -> dict[str, Any]:
    """Settings of the swarm over ``BOX``, as keywords of :func:`slipctl.particle_swarm`.

    Args:
        form: ``"consistent"``: steps up to half of the box, inertia .73 and pulls 1.5, with which a
            swarm contracts (Clerc and Kennedy 2002). ``"printed-21"``: those of Table 3, steps of
            .001 in each coefficient, whatever its range.

    Raises:
        BadInput: an unknown form.
    """
    refuse_unknown_choice("swarm_settings", "form", form, FORMS)
    size = dict(particles=PARTICLES, iterations=ITERATIONS)
    if form == "consistent":
        return size | dict(inertia=0.73, c1=1.5, c2=1.5, clamp=0.5)
    clamp = [0.001 / (hi - lo) for lo, hi in BOX.values()]
    return size | dict(inertia=printed_inertia, c1=0.4, c2=0.1, clamp=clamp)


@law(y=Output("N/kN", "running resistance over weight", positive="braking"))
def specific_resistance(v=Input("m/s", "train speed"), a1=A1, a2=A2, a3=A3):
    """Running resistance over weight, Cheng 2022 eq (4) in N/kN: y = a1 + a2 v + a3 v^2."""
    return a1 + a2 * v + a3 * v**2


@law(y=Output("N/kN", "running resistance over weight, filtered", positive="braking"))
def filtered_resistance(
    one_f=Input("1", "one, filtered"),
    v_f=Input("m/s", "train speed, filtered"),
    v2_f=Input("m^2/s^2", "its square, filtered"),
    a1=A1, a2=A2, a3=A3,
):  # fmt: skip
    """Both sides of (14) filtered: y = a1 [1]_f + a2 [v]_f + a3 [v^2]_f."""
    return a1 * one_f + a2 * v_f + a3 * v2_f


def balance(period: float) -> Block:
    """Make the regression of (14) that needs no acceleration.

    Args:
        period: of the samples in s.

    Raises:
        BadInput: no period.
    """
    if not (math.isfinite(period) and period > 0):
        raise BadInput(f"balance: period = {period:g} s must be positive")

    @step(
        period=period,
        y=Output("N/kN", "running resistance over weight, filtered", positive="braking"),
        one_f=Output("1", "one, filtered"),
        v_f=Output("m/s", "train speed, filtered"),
        v2_f=Output("m^2/s^2", "its square, filtered"),
        name="balance",
    )
    def regression(
        begun=State("1", 0.0, "0 before the first sample"),
        F_old=State("N", 0.0, "last adhesion force"),
        v_old=State("m/s", 0.0, "last speed"),
        F=State("N", 0.0, "adhesion force, filtered"),
        d=State("m/s^2", 0.0, "acceleration, filtered"),
        i=State("1", 0.0, "one, filtered"),
        u=State("m/s", 0.0, "speed, filtered"),
        w=State("m^2/s^2", 0.0, "square of the speed, filtered"),
        v_t=Input("m/s", "train speed", lo=0, hi=50),
        mu_hat=Input("1", "adhesion estimate", positive="traction", lo=-1, hi=1),
        T=Param("s", period, "period of the samples", "chosen", lo=1e-6, hi=1e6),
        tau_f=Param("s", 2.0, "time constant of the filters", "chosen, tau", lo=1e-3, hi=100),
        m=Param("kg", 6e6, "train, as the controller knows it", f"{TABLE_2}, M", lo=1e4, hi=3e7),
        m_axle=Param("kg", 30e3, "load of one driven axle", f"{TABLE_2}, W", lo=1e3, hi=5e4),
        n_d=Param("1", 8.0, "driven axles, all alike", GUESS, lo=1, hi=64),
        g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
    ):
        """Regression for the running resistance, both sides of (14) filtered by Tustin's rule.

        x_f+ = rho x_f + (1 - rho)(x + x+)/2, d+ = rho d + 2 (v+ - v)/(2 tau + T),
        rho = (2 tau - T)/(2 tau + T).
        """
        rho = (2 * tau_f - T) / (2 * tau_f + T)
        F_a = n_d * mu_hat * m_axle * g
        half = (1 - rho) / 2 * begun
        F_f = rho * F + half * (F_old + F_a)
        d_f = rho * d + begun * 2 * (v_t - v_old) / (2 * tau_f + T)
        i_f = rho * i + 2 * half
        u_f = rho * u + half * (v_old + v_t)
        w_f = rho * w + half * (v_old**2 + v_t**2)
        y = one("N/kN") * 1000 * (F_f - m * d_f) / (m * g)
        nxt = dict(begun=1, F_old=F_a, v_old=v_t, F=F_f, d=d_f, i=i_f, u=u_f, w=w_f)
        return nxt, dict(y=y, one_f=i_f, v_f=u_f, v2_f=w_f)

    return regression


def identification(
    period: float = 0.1, method: str = "least_squares", form: str = "consistent", **settings: Any
) -> Block:
    """Make the identification in the loop, from speed and adhesion estimate to F_Z.

    Args:
        period: of the samples in s; run it by ``every``.
        method: ``"least_squares"``, recursive, or ``"swarm"``, which searches every 100th sample.
        form: of the swarm's settings, see :func:`swarm_settings`.
        **settings: of the swarm, over those (``ticks``, ``iterations``, ``seed``).

    Returns:
        A step block. Inputs: ``v_t``, ``mu_hat``. Outputs of interest: ``res.F_Z`` for a
        controller, ``fit.a1`` (or ``search.a1``) and so on, ``fit.deviation``, ``fit.identified``.

    Raises:
        BadInput: an unknown method or form, or settings that make no search.
    """
    refuse_unknown_choice("identification", "form", method, ("least_squares", "swarm"))
    refuse_unknown_choice("identification", "form", form, FORMS)
    fit = dict(noise=0.02, centre=[(hi + lo) / 2 for lo, hi in BOX.values()])
    spread = [hi - lo for lo, hi in BOX.values()]
    wires = {f"balance.{k}": k for k in ("v_t", "mu_hat")} | {"res.v": "v_t"}
    parts = {"balance": balance(period), "res": opened(resistance, "a1", "a2", "a3")}
    rows = ("y", "one_f", "v_f", "v2_f")
    if method == "least_squares":
        parts["fit"] = linear_fit(filtered_resistance, period=period, spread=spread, **fit)
        found = "fit"
        wires |= {f"fit.{k}": f"balance.{k}" for k in rows}
    else:
        chosen = {"ticks": 100} | swarm_settings(form) | settings
        parts["pso"] = swarm_fit(filtered_resistance, BOX, period=period, fit=fit, **chosen)
        found = "pso.search"
        wires |= {f"pso.{k}": f"balance.{k}" for k in rows}
    wires |= {f"res.{k}": f"{found}.{k}" for k in BOX}
    return connect("identification", wires, share=SHARED | TRAIN, **parts)
