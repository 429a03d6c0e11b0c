"""Speed and position control of a train with anti-slip limit; Wang 2025.

With e1 = x - x_d, e2 = v - v_d and the train (15), x' = v, M v' = F_contr - delta - F_d, every law
asks for a force F_wanted. It gives F_contr = sat(F_wanted) in [F_lo, F_hi], which is the traction
characteristic and, with the limit, what the rail carries. Higher-order sliding mode (29)-(36):

    F_wanted = M (-k1 e2 + F_d/M + v_d' - k3 lam + u),  lam' = -k3 lam - (F_wanted - F_contr)/M
    s = k1 e1 + e2 - lam,  u = -k1H phi1 + v_H,  v_H' = -k2H phi2,  k2H = 2 beta k1H
    phi1 = |s|^(1/2) sgn s + s,  phi2 = sgn(s)/2 + (3/2)|s|^(1/2) sgn s + s

gives s' = -k1H phi1 + v_H - delta/M whatever the limit does. The text before (40) has s + lam,
which doubles what it should cancel (``form="printed-40"``).

Table 5 gives the numbers of the two other sliding modes. Predictive, robust and PID control are
only named in Table 4: their structure and numbers here are ours. Forces pull (``"traction"``).
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from casadi import DM, MX, fabs, fmax, fmin, if_else, mtimes, sign, vertcat

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    every,
    flow,
    law,
    make_block,
    one,
    ranged,
    replicate,
    sampled,
    step,
)
from slipctl.analysis.quadratic import qp_kernel
from slipctl.block.block import doc_of_maker
from slipctl.block.smooth import root
from slipctl.errors import refuse_unknown_choice
from slipctl.models.wang_2025.certificate import higher_order as bounds
from slipctl.models.wang_2025.hst_traction import resistance
from slipctl.models.wang_2025.hst_traction_adhesion import (
    GUESS,
    TABLE_1,
    TRAIN_SPEED,
    adhesion_observer,
    antislip_limit,
    characteristic,
    usable_adhesion,
)
from slipctl.models.wheel_rail.contact import polach

TABLE_5 = "Wang 2025, Table 5"
FARTHEST = "a thousand km; a quarter more than the way of a tick at 430 km/h"
WAY = (
    "a thousand km; four times the way of 1 ms at its speed, so that one that was stuck is soon"
    " taken again; noise of 5 cm"
)
T_C = 5e-3
"""Period of the laws in s; Wang 2025, Table 4 (a response of 5 ms)."""

ETA = 0.05
"""Largest |delta'|/M in m/s^3 that the default gains of the sliding mode are made for."""

FORCES = dict(
    F_contr=Output(
        "N",
        "force commanded",
        positive="traction",
        source="a hundred times the largest force of a train",
        lo=-1e9,
        hi=1e9,
    ),
    F_wanted=Output(
        "N",
        "force wanted",
        positive="traction",
        source="what laws without compensation wind up to",
        lo=-1e13,
        hi=1e13,
    ),
)
M_ = Param("kg", 500e3, "train, as the controller knows it", f"{TABLE_1}, M", lo=1e4, hi=1e8)
E1 = Input("m", "position less target", source="a thousand km", lo=-1e6, hi=1e6)
E2 = Input("m/s", "speed less target", source="a wheel that spins free", lo=-500, hi=500)
A_FF = Input(
    "m/s^2",
    "target acceleration and resistance by mass",
    positive="traction",
    source="adhesion of 2 on the least inertia",
    lo=-1e4,
    hi=1e4,
)
HI = Input(
    "N",
    "largest force",
    positive="traction",
    source="a hundred times the largest force of a train",
    lo=-1e9,
    hi=1e9,
)
LO = Input(
    "N",
    "smallest force, braking",
    positive="traction",
    source="a hundred times the largest force of a train",
    lo=-1e9,
    hi=1e9,
)
K1 = Param("1/s", 0.5, "slope of the sliding surface", TABLE_5, lo=1e-3, hi=10)


@law(
    e1=Output("m", "position less target", source="a thousand km", lo=-1e6, hi=1e6),
    e2=Output("m/s", "speed less target", source="twice 430 km/h and more", lo=-500, hi=500),
    a_ff=Output(
        "m/s^2",
        "target acceleration and resistance by mass",
        positive="traction",
        source="that of the input",
        lo=-1e4,
        hi=1e4,
    ),
)
def tracking(
    x=Input("m", "position", source=FARTHEST, lo=-1000, hi=1e6, change=0.15),
    v=Input("m/s", "speed", source=TRAIN_SPEED, lo=-1, hi=120, change=0.0025, noise=0.15),
    x_d=Input("m", "target position", source=FARTHEST, lo=-1000, hi=1e6, change=0.15),
    v_d=Input(
        "m/s", "target speed", source="430 km/h; 2 m/s^2 for 1 ms", lo=-1, hi=120, change=0.002
    ),
    a_d=Input(
        "m/s^2",
        "target acceleration",
        positive="traction",
        source="an emergency brake, 1.2 m/s^2, and more; a target may jump",
        lo=-1.5,
        hi=1.5,
    ),
    F_d=Input(
        "N",
        "running resistance, as known",
        positive="braking",
        source="a gradient of 0.1 under the heaviest train",
        lo=-1e8,
        hi=1e8,
    ),
    m=M_,
):
    """Errors e1 = x - x_d, e2 = v - v_d and feed-forward v_d' + F_d/M."""
    return dict(e1=x - x_d, e2=v - v_d, a_ff=a_d + F_d / m)


# ---- higher-order sliding mode -------------------------------------------------------------------


def higher_order(
    gains: str = "optimum", compensation: bool = True, form: str = "consistent", eta: float = ETA
) -> Block:
    """Make the higher-order sliding mode in continuous time.

    Args:
        gains: ``"optimum"``: the smallest k4 for which (49) proves ``eta``, with the alpha and beta
            that reach it; ``"printed"``: Table 5, for which (49) proves 0.00936 m/s^3.
        compensation: lam follows what the limit takes away; without it lam = 0.
        form: ``"consistent"``, or ``"printed-40"``, with s + lam.
        eta: largest |delta'|/M in m/s^3 that the gains shall hold.
    """
    refuse_unknown_choice("higher_order", "form", gains, ("optimum", "printed"))
    refuse_unknown_choice("higher_order", "form", form, ("consistent", "printed-40"))
    if gains == "printed":
        k4, (alpha_0, beta_0), source = 0.25, (0.02, 0.09), TABLE_5
    else:
        k4 = bounds.smallest_k4(eta)
        alpha_0, beta_0, _ = bounds.best(max(k4, bounds.SMALLEST * (1 + 1e-9)))
        source = f"optimum of (49) for |delta'|/M = {eta:g} m/s^3"
    turn = 1 if form == "consistent" else -1
    bounded = compensation and (gains, form) == ("optimum", "consistent")
    far = "what laws without compensation wind up to"
    v_top, k_top, F_top, why = 1e7, 1e6, 1e13, "a thousand times the largest k_4"
    if not compensation:  # 4e11, 3e7 and 1e17 in the paper's run, and on it goes
        v_top, k_top, F_top, why = 1e15, 1e10, 1e22, far

    @flow(
        **FORCES | {"F_wanted": replace(FORCES["F_wanted"], lo=-F_top, hi=F_top)},
        s=Output("m/s", "sliding variable", source="the largest k_1 on the largest errors",
                 lo=-1e7, hi=1e7),
        k_1H=Output("1/s", "adapted gain", source=why, lo=0, hi=k_top),
        name="hosm", choices={"gains": gains, "compensation": compensation, "form": form},
    )  # fmt: skip
    def hosm(
        v_H=State("m/s^2", 0.0, "integral of the sliding mode", source=far, lo=-v_top, hi=v_top),
        k_a=State("1/s", "k_4", "adapted gain", source=why, lo=0, hi=k_top),
        lam=State("m/s", 0.0, "saturation compensation", source=far, lo=-1e5, hi=1e5),
        e1=E1, e2=E2, a_ff=A_FF, F_hi=HI, F_lo=LO, k_1=K1, m=M_,
        k_3=Param("1/s", 0.2, "decay of the compensation", TABLE_5, lo=1e-3, hi=10),
        k_4=Param("1/s", k4, "smallest gain", source, lo=1e-3, hi=1e3),
        alpha=Param("1/s^2", alpha_0, "first weight of the Lyapunov function", source, lo=1e-6,
                    hi=1e4),
        beta=Param("1/s", beta_0, "second weight of the Lyapunov function", source, lo=1 / 16,
                   hi=1e4),
        sigma=Param("m/s", 1e-4, "band in which the gain falls", TABLE_5, lo=1e-9, hi=100),
        k_max=Param("1/s", 40 * k4, "largest gain, of the default form", GUESS, lo=1e-3,
                    hi=1e5),
    ):  # fmt: skip
        """Higher-order sliding mode with adaptive gain; Wang 2025 eqs (29)-(39).

        In the default form the gain stops at k_max: sampled, the law keeps s on an orbit that grows
        with the gain, and beyond sigma nothing else would stop it. Other forms are as printed.
        """
        s = k_1 * e1 + e2 - turn * lam
        jump = one("m^.5/s^.5") * root(s)
        phi1 = jump + s
        phi2 = one("m/s") * sign(s) / 2 + 1.5 * jump + s
        gain = fmax(k_a, k_4)
        u = -gain * phi1 + v_H
        F_wanted = m * (-k_1 * e2 + a_ff - k_3 * lam + u)
        F_contr = fmin(F_hi, fmax(F_lo, F_wanted))
        pace = one("1/m^2") * 2 * alpha / (one("1/s^2") + 4 * beta**2)
        growth = phi1 * phi2 * pace * sign(fabs(s) - sigma)
        free = if_else(growth > 0, k_a < k_max if bounded else 1, k_a > k_4)
        rates = dict(
            v_H=-2 * beta * gain * phi2,
            k_a=if_else(free, growth, 0),
            lam=-k_3 * lam - (F_wanted - F_contr) / m if compensation else 0 * a_ff,
        )
        return rates, dict(F_contr=F_contr, F_wanted=F_wanted, s=s, k_1H=gain)

    return hosm


# ---- what the paper compares with ----------------------------------------------------------------


@law(
    **FORCES,
    s=Output(
        "m/s", "sliding variable", source="the largest k_1 on the largest errors", lo=-1e7, hi=1e7
    ),
    name="smc",
)
def sliding_mode(
    e1=E1, e2=E2, a_ff=A_FF, F_hi=HI, F_lo=LO, k_1=K1, m=M_,
    k_smc=Param("m/s^2", 0.05, "switching", TABLE_5, lo=0, hi=10),
):  # fmt: skip
    """Conventional sliding mode: F = M (-k1 e2 + F_d/M + v_d' - k_smc sgn s); Table 5."""
    s = k_1 * e1 + e2
    F = m * (-k_1 * e2 + a_ff - k_smc * sign(s))
    return dict(F_contr=fmin(F_hi, fmax(F_lo, F)), F_wanted=F, s=s)


@step(
    **FORCES,
    s=Output(
        "m/s", "sliding variable", source="the largest k_1 on the largest errors", lo=-1e7, hi=1e7
    ),
    name="asmc",
    period=T_C,
)
def adaptive_sliding_mode(
    d_hat=State("m/s^2", 0.0, "estimated perturbation",
                source="what laws without compensation wind up to", lo=-1e7, hi=1e7),
    e1=E1, e2=E2, a_ff=A_FF, F_hi=HI, F_lo=LO, k_1=K1, m=M_,
    sigma=Param("m/s", 10.0, "width of the boundary layer", TABLE_5, lo=1e-6, hi=100),
    k_2=Param("m/s^2", 15.0, "switching", TABLE_5, lo=0, hi=1e3),
    d_1=Param("1/s^2", 10.0, "rate of the estimate", TABLE_5, lo=0, hi=1e3),
    T=Param("s", T_C, "sample period", GUESS, lo=1e-6, hi=0.1),
):  # fmt: skip
    """Adaptive sliding mode with perturbation compensation, without anti-windup; Table 5.

    F = M (-k1 e2 + F_d/M + v_d' - k2 sat(s/sigma) - d_hat), d_hat' = d1 s. The structure is ours;
    we find no role for d2 = 10.
    """
    s = k_1 * e1 + e2
    F = m * (-k_1 * e2 + a_ff - k_2 * fmax(-1, fmin(1, s / sigma)) - d_hat)
    return dict(d_hat=d_hat + T * d_1 * s), dict(F_contr=fmin(F_hi, fmax(F_lo, F)), F_wanted=F, s=s)


@law(**FORCES, name="robust")
def robust(
    e1=E1, e2=E2, a_ff=A_FF, F_hi=HI, F_lo=LO, m=M_,
    k_v=Param("1/s", 1.8, "gain on the speed", GUESS, lo=0, hi=100),
    k_x=Param("1/s^2", 1.0, "gain on the position", GUESS, lo=0, hi=100),
):  # fmt: skip
    """State feedback with feed-forward: F = M (v_d' + F_d/M - 1.8 e2 - 1.0 e1)."""
    F = m * (a_ff - k_v * e2 - k_x * e1)
    return dict(F_contr=fmin(F_hi, fmax(F_lo, F)), F_wanted=F)


@law(**FORCES, name="pid")
def pid(
    e1=E1, e2=E2, F_hi=HI, F_lo=LO, m=M_,
    k_v=Param("1/s", 1.5, "gain on the speed", GUESS, lo=0, hi=100),
    k_x=Param("1/s^2", 0.4, "gain on the position", GUESS, lo=0, hi=100),
):  # fmt: skip
    """PI on the speed without feed-forward, the position its integral: F = -M (1.5 e2 + 0.4 e1)."""
    F = -m * (k_v * e2 + k_x * e1)
    return dict(F_contr=fmin(F_hi, fmax(F_lo, F)), F_wanted=F)


def horizon(
    moves: int = 25, dt: float = 0.2, q_x: float = 1.0, q_v: float = 10.0, r: float = 2.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Condense the double integrator e1' = e2, e2' = u over a horizon.

    The cost is the sum of q_x e1^2 + q_v e2^2 after each move and of r u^2; half of it is
    x'Hx/2 + (G e)'x and a constant.

    Args:
        moves: moves of length ``dt`` in s. q_x, q_v, r: weights.

    Returns:
        H, G with the linear term G (e1, e2), and A, whose rows are the moves and their steps.
    """
    step_1 = np.array([[1.0, dt], [0.0, 1.0]])
    push = np.array([dt**2 / 2, dt])
    free, forced = np.eye(2), np.zeros((2, moves))
    H, G = r * np.eye(moves), np.zeros((moves, 2))
    Q = np.diag([q_x, q_v])
    for k in range(moves):
        free, forced = step_1 @ free, step_1 @ forced
        forced[:, k] += push
        H, G = H + forced.T @ Q @ forced, G + forced.T @ Q @ free
    steps = np.eye(moves) - np.eye(moves, k=-1)
    return H, G, np.vstack([np.eye(moves), steps])


def predictive(moves: int = 25, dt: float = 0.2, iterations: int = 25) -> Block:
    """Make model predictive control of the double integrator; ours, Table 4 only names it.

    Args:
        moves, dt: the horizon, 25 times 0.2 s.
        iterations: of the solver, the same in every tick.

    Each move lies in the present limits, moves differ by at most ``jerk dt``, and the first one
    from the last command by ``jerk T``, as far as the limits allow.
    """
    H, G, A = horizon(moves, dt)
    solve = qp_kernel(H, A, iterations)

    def body(x: dict[str, Any], u: dict[str, Any], p: dict[str, Any]) -> Any:
        a_hi, a_lo = u["F_hi"] / p["m"] - u["a_ff"], u["F_lo"] / p["m"] - u["a_ff"]
        last = x["F_last"] / p["m"] - u["a_ff"]
        near, far = p["jerk"] * p["T"], p["jerk"] * dt
        first_lo = fmin(fmax(last - near, a_lo), a_hi)
        first_hi = fmax(fmin(last + near, a_hi), a_lo)
        lo = vertcat(MX.ones(moves, 1) * a_lo, first_lo, -MX.ones(moves - 1, 1) * far)
        hi = vertcat(MX.ones(moves, 1) * a_hi, first_hi, MX.ones(moves - 1, 1) * far)
        found, end = solve(mtimes(DM(G), vertcat(u["e1"], u["e2"])), lo, hi, x["inner"])
        move = fmin(first_hi, fmax(first_lo, found[0]))  # however far the solver is
        F = p["m"] * (u["a_ff"] + move)
        F_contr = fmin(u["F_hi"], fmax(u["F_lo"], F))
        return dict(F_last=F_contr, inner=end), dict(F_contr=F_contr, F_wanted=F)

    return make_block(
        "mpc", "step", body, period=T_C, sx=False,
        states=[State("N", "F_start", "last command", "that of the limits", positive="traction",
                      lo=-1e9, hi=1e9).named("F_last"),
                State("1", 0.0, "where the solver starts", "a thousand times what runs show",
                      shape=(5 * moves,), lo=-1e6, hi=1e6).named("inner")],
        inputs=[E1.named("e1"), E2.named("e2"), A_FF.named("a_ff"), HI.named("F_hi"),
                LO.named("F_lo")],
        params=[M_.named("m"),
                Param("m/s^3", 1.0, "largest jerk", GUESS, lo=1e-3, hi=1e4).named("jerk"),
                Param("N", 0.0, "force at the start", positive="traction", lo=-1e9,
                      hi=1e9).named("F_start"),
                Param("s", T_C, "sample period", GUESS, lo=1e-6, hi=0.1).named("T")],
        outputs=[s.named(n) for n, s in FORCES.items()],
        doc=doc_of_maker(predictive), choices={"moves": moves, "dt": dt, "iterations": iterations},
    )  # fmt: skip


# ---- the whole -----------------------------------------------------------------------------------


def laws() -> dict[str, Block]:
    """Every law with its default form, by name."""
    return {
        "hosm": higher_order(),
        "smc": sliding_mode,
        "asmc": adaptive_sliding_mode,
        "mpc": predictive(),
        "robust": robust,
        "pid": pid,
    }


CONTROLLER = {
    n: f"*.{n}" for n in ("m", "J", "r", "g", "m_axle", "n_m", "n_b", "F_top", "P_top", "B_t")
}
"""Numbers that several parts of the controller have."""


@law(
    F_contr=FORCES["F_contr"],
    name="clamp",
)
def clamp(
    F=Input(
        "N",
        "force commanded by the law",
        positive="traction",
        source="a hundred times the largest force of a train",
        lo=-1e9,
        hi=1e9,
    ),
    F_hi=HI,
    F_lo=LO,
):
    """Limits of this tick on a force that the law gave up to some ticks ago."""
    return fmin(F_hi, fmax(F_lo, F))


@lru_cache(maxsize=4)
def _observers(observer: Block | None, axles: int) -> Block:
    return replicate(observer or adhesion_observer(), axles)


_usable, _limit = lru_cache(maxsize=4)(usable_adhesion), lru_cache(maxsize=4)(antislip_limit)
"""Parts that all controllers have are made once, so that their equations are worked out once."""


def controller(
    control_law: Block,
    axles: int = 1,
    limited: bool = True,
    observer: Block | None = None,
    creep_law: Block = polach,
    ticks: int = 5,
    name: str = "ctl",
) -> Block:
    """Connect observers, anti-slip limit and control law: sensors to the force of the train.

    Args:
        control_law: one of :func:`laws`; a flow is discretised by Euler's method.
        axles: observed axles, those with a motor.
        limited: with the anti-slip limit; without it the characteristic alone limits.
        observer: of the adhesion of an axle; the robust one by default.
        creep_law: law whose surfaces the classification knows.
        ticks: ticks from one run of the law to the next. Observers and limit run every tick, so
            that a poorer rail does not wait for the law.
        name: name of the controller.

    Returns:
        Block from x, v, x_d, v_d, a_d and, with the limit, omega and T of the axles to F_contr.

    Raises:
        BadInput: axles or ticks not a whole number from 1 on.
    """
    if axles < 1 or axles != int(axles):
        raise BadInput(f"controller: axles = {axles} must be a whole number >= 1")
    if control_law.kind == "flow":
        control_law = sampled(control_law, T_C, "euler")
    measured, errors = ("x", "v", "x_d", "v_d", "a_d"), ("e1", "e2", "a_ff")
    ports = {f"tracking.{n}": n for n in measured} | {f"law.{n}": n for n in ("F_hi", "F_lo")}
    ports |= {"res.v": "v", "tracking.F_d": "res.F_d", "F_contr": "law.F_contr"}
    ports |= {f"law.{n}": f"tracking.{n}" for n in errors if n in control_law.inputs}
    strategy = connect("strategy", ports, res=resistance, tracking=tracking, law=control_law)
    limits = "limit" if limited else "characteristic"
    wires = {f"strategy.{n}": n for n in measured} | {
        "characteristic.v": "v",
        "clamp.F": "strategy.F_contr",
        "F_contr": "clamp.F_contr",
    }
    wires |= {f"{part}.{n}": f"{limits}.{n}" for part in ("strategy", "clamp")
              for n in ("F_hi", "F_lo")}  # fmt: skip
    parts = {"characteristic": characteristic, "strategy": every(strategy, ticks), "clamp": clamp}
    if limited:
        parts |= {
            "observer": _observers(observer, axles),
            "usable": _usable(axles, creep_law),
            "limit": _limit(axles),
        }
        wires |= {
            "observer.omega": "omega",
            "observer.T": "T",
            "usable.omega": "omega",
            "usable.v": "v",
            "usable.mu_hat": "observer.mu_hat",
            "limit.mu_lim": "usable.mu_lim",
            "limit.F_hi_0": "characteristic.F_hi",
            "limit.F_lo_0": "characteristic.F_lo",
        }
    block = connect(name, wires, share=CONTROLLER, **parts)
    ways = {
        x: Input("m", source=WAY, lo=-1000, hi=1e6, change=(0.15, f"4e-3*fabs({v}) + 2e-4"),
                 noise=0.05)
        for x, v in (("x", "v"), ("x_d", "v_d"))
    }  # fmt: skip
    return ranged(block, **ways)
