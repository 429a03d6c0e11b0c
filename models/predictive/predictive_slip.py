"""Predictive slip control: the best slip, within torque, rate and slip limits, behind a lag.

    s' = (r/J)(T - r F) - F/m + d,   T' = (T_cmd - T)/tau,   F = mu(s; estimate) W g

is one model for every wheel of the papers (``common_form``). The parameters of the adhesion law are
inputs, held over the horizon, that an estimator feeds. d is what the estimated disturbance has
beyond the estimated curve, so that the slip comes to rest on its reference whatever is wrong.
"""

from __future__ import annotations

from collections.abc import Callable

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    every,
    flow,
    gated,
    law,
    nmpc,
    opened,
    speed_to_ratio,
    step,
)
from slipctl.estimate.model import unknown_parameters
from slipctl.models.common_form import ADDED, T_S, Wheel, with_law_ranges
from slipctl.models.shared_names import SHARED


@flow(
    beyond=Output("m/s", "slip beyond 1.5 times its reference", positive="braking"),
    name="axle",
)
def axle(
    v_s=State("m/s", 0.0, "slip speed", positive="braking", per="speed"),
    T=State("N m", 0.0, "torque at the wheel", positive="braking"),
    T_cmd=Input("N m", "commanded torque", lo=0, hi=20e3, positive="braking"),
    mu=Input("1", "adhesion coefficient", positive="braking"),
    d=Input("m/s^2", "what the slip rises by beyond the model", value=0.0),
    v_ref=Input("m/s", "slip to go to", positive="braking", per="speed"),
    m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=1e3, hi=5e4),
    J=Param("kg m^2", 240.0, "inertia at the wheel", ADDED, lo=1, hi=1e4),
    r=Param("m", 0.5, "wheel radius", ADDED, lo=0.2, hi=1),
    m=Param("kg", 8000.0, "mass of the vehicle per wheel", ADDED, lo=1e3, hi=1e7),
    g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
    tau=Param("s", 0.05, "time constant of the actuator", ADDED, lo=1e-3, hi=5),
):
    """Slip of a wheel behind its actuator, at a speed of the vehicle that is held."""
    F = mu * m_axle * g
    slip = r / J * (T - r * F) - F / m + d
    return dict(v_s=slip, T=(T_cmd - T) / tau), dict(beyond=v_s - 1.5 * v_ref)


@law(slip=Output("m/s", source="a wheel that spins free", lo=-120, hi=500), change=Output("N m"))
def residuals(
    v_s=Input("m/s", "slip speed", positive="braking", per="speed"),
    v_ref=Input("m/s", "slip to go to", positive="braking", per="speed"),
    T=Input("N m", "torque at the wheel", positive="braking"),
    T_cmd=Input("N m", "commanded torque", positive="braking"),
):
    """Slip error, and the torque still to come: its weight is comfort."""
    return dict(slip=v_s - v_ref, change=T_cmd - T)


def slip_model(adhesion: Block, w: Wheel) -> Block:
    """Connect axle and adhesion, whose parameters are inputs, to the model of the controller.

    Args:
        adhesion: law from ``v_s`` or ``lam`` to the adhesion, braking positive.
        w: the wheel.
    """
    (out,) = adhesion.outputs
    block = axle.with_params(m_axle=w.W, J=w.J, r=w.r, m=w.m, g=w.g, tau=w.tau)
    parts, wires = {"axle": block, "adh": opened(adhesion)}, {"axle.mu": f"adh.{out}"}
    wires |= {f"axle.{n}": n for n in ("T_cmd", "d", "v_ref")}
    wires |= {f"adh.{n}": n for n in unknown_parameters(adhesion, None)}
    return connect("slip_model", wires | _at_slip(adhesion, parts, "axle.v_s"), **parts)


def _at_slip(adhesion: Block, parts: dict[str, Block], slip: str) -> dict[str, str]:
    """Wires that give the part ``adh`` its slip, as ratio where it takes that."""
    if "lam" not in adhesion.inputs:
        return {"adh.v_s": slip}
    parts["ratio"] = speed_to_ratio()
    return {"ratio.u": slip, "ratio.v": "v", "adh.lam": "ratio.y"}


@step(
    slip=Output(
        "m/s",
        "slip speed, filtered",
        positive="braking",
        per="speed",
        source="a wheel that spins free",
        lo=-120,
        hi=500,
    ),
    d=Output(
        "m/s^2",
        "what the slip rises by beyond the model",
        source="adhesion of 2 on the least inertia",
        lo=-1e4,
        hi=1e4,
    ),
)
def offset(
    s_h=State(
        "m/s",
        "v_s_start",
        "slip speed, predicted",
        source="a wheel that spins free",
        lo=-120,
        hi=500,
    ),
    d_h=State(
        "m/s^2",
        0.0,
        "what it rises by beyond the model",
        source="adhesion of 2 on the least inertia",
        lo=-1e4,
        hi=1e4,
    ),
    v_s=Input("m/s", "slip speed, as measured", positive="braking", per="speed"),
    T=Input("N m", "torque at the wheel, as measured", positive="braking"),
    mu=Input("1", "adhesion on the estimated curve", positive="braking"),
    pole=Param("1/s", 60.0, "both poles of the observer", "chosen", lo=1, hi=500),
    m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=1e3, hi=5e4),
    J=Param("kg m^2", 240.0, "inertia at the wheel", ADDED, lo=1, hi=1e4),
    r=Param("m", 0.5, "wheel radius", ADDED, lo=0.2, hi=1),
    m=Param("kg", 8000.0, "mass of the vehicle per wheel", ADDED, lo=1e3, hi=1e7),
    g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
    v_s_start=Param(
        "m/s", 0.0, "slip speed at the start", positive="braking", per="speed", lo=-1e6, hi=1e6
    ),
    T_s=Param("s", T_S, "tick", lo=1e-6, hi=0.1),
):
    """Observer of the slip and of a constant disturbance: s' = model + d, d' = 0.

    It stands for the integral of the other laws: with d the slip rests on its reference.
    """
    error = v_s - s_h
    model = r / J * T - (r**2 / J + 1 / m) * mu * m_axle * g
    nxt = dict(s_h=s_h + T_s * (model + d_h + 2 * pole * error), d_h=d_h + T_s * pole**2 * error)
    return nxt, dict(slip=s_h + T_s * 2 * pole * error, d=d_h)


@step(
    v_ref=Output(
        "m/s",
        "slip to go to",
        positive="braking",
        per="speed",
        source="twice the range that is searched",
        lo=-20,
        hi=20,
    )
)
def smoothed(
    x=State(
        "m/s", 0.0, "filtered reference", source="twice the range that is searched", lo=-20, hi=20
    ),
    v_best=Input(
        "m/s",
        "best slip, as searched",
        positive="braking",
        per="speed",
        source="twice the range that is searched",
        lo=-20,
        hi=20,
    ),
    tau_s=Param("s", 0.05, "time constant", "chosen", lo=1e-3, hi=5),
    T_s=Param("s", T_S, "tick", lo=1e-6, hi=0.1),
):
    """First-order filter of the searched slip, which jumps with each estimate."""
    following = x + T_s / (tau_s + T_s) * (v_best - x)
    return dict(x=following), dict(v_ref=following)


def predictive(
    adhesion: Block,
    ticks: int = 2,
    horizon: int = 40,
    slip: float = 1.0,
    change: float = 0.02,
    beyond: float = 2.0,
    rate: float = 20.0,
    pole: float = 3.0,
    smooth: float = 0.3,
    gate: bool = False,
    tick: float = T_S,
) -> Callable[[Wheel], Block]:
    """Make the maker of a predictive slip law; see :mod:`slipctl.models.common_form`.

    Args:
        adhesion: law that the estimator estimates, from ``v_s`` or ``lam``, braking positive.
        ticks: ticks from one solution to the next, also the length of a stage.
        horizon: stages.
        slip: weight of the slip error over the best slip.
        change: weight of the torque still to come over the largest torque: comfort.
        beyond: weight of the slip beyond 1.5 times its reference, over the best slip.
        rate: largest rate of the command, in largest torques per time constant of the actuator.
        pole: of the observer, over the reciprocal of that time constant.
        smooth: time constant of the reference's filter over that of the actuator.
        gate: solve only while the further input ``on`` is 1; observer and filter run on.
        tick: period in s.

    Returns:
        Function of a :class:`~slipctl.models.common_form.Wheel`. The law takes the parameters of
        ``adhesion`` too, as the estimator gives them.
    """

    def make(w: Wheel) -> Block:
        solver = nmpc(
            slip_model(adhesion, w), residuals, "T_cmd", h=ticks * tick, horizon=horizon,
            weights={"slip": slip / w.v_best, "change": change / w.T_max},
            bounds={"T_cmd": (0.0, w.T_max)}, rates={"T_cmd": rate * w.T_max / w.tau},
            soft={"beyond": (-1e3, 0.0, beyond / w.v_best)},
            moves=(1, 1, 2, 4, horizon - 8), substeps=2, passes=60,
        )  # fmt: skip
        (out,) = adhesion.outputs
        parts: dict[str, Block] = {
            "adh": opened(adhesion),
            "offset": offset.with_params(pole=pole / w.tau, m_axle=w.W, J=w.J, r=w.r, m=w.m, g=w.g),
            "smoothed": smoothed.with_params(tau_s=smooth * w.tau, x=w.v_best),
            "nmpc": gated(every(solver, ticks)) if gate else every(solver, ticks),
        }
        wires = {
            "offset.mu": f"adh.{out}",
            "offset.v_s": "v_s",
            "offset.T": "T",
            "nmpc.axle.v_s": "offset.slip",
            "nmpc.axle.T": "T",
            "nmpc.d": "offset.d",
            "smoothed.v_best": "v_best",
            "nmpc.v_ref": "smoothed.v_ref",
            "T_wanted": "nmpc.T_cmd",
        } | _at_slip(adhesion, parts, "v_s")
        if "v" in solver.inputs:
            wires["nmpc.v"] = "v"
        if gate:
            wires["nmpc.on"] = "on"
        for n in unknown_parameters(adhesion, None):
            wires |= {f"adh.{n}": n, f"nmpc.{n}": n}
        share = SHARED | {
            "m_axle": "*.m_axle", "T_s": "*.T_s", "T_max": "nmpc.T_cmd_hi",
        }  # fmt: skip
        share |= {n: f"*.{n}" for n, s in adhesion.params.items() if s.shape and not s.derived}
        return with_law_ranges(connect("law", wires, share=share, **parts), w)

    return make
