"""The slip laws of the four papers on one form, so that each may drive any of the wheels.

Every wheel of the papers, braked or driven, is

    s' = (r/J) T - D,   D = (r^2/J + 1/m) F + a_R

with s >= 0 the slip speed, T >= 0 the torque at the wheel, F the adhesion force and m the mass that
a wheel carries along. A driven wheel is a braked one seen in a mirror (``slipctl.mirror``). So each
law is a wanted s' = nu(e) of the slip error and T = (J/r)(D + nu). What differs is nu, and how the
reference is prepared. Here: braking positive, slip as speed.

A law takes from ``v`` (vehicle), ``v_s`` (slip), ``v_best`` (slip to go to), ``F`` and ``D`` what
it needs, and gives ``T_wanted``. What a paper has for another wheel gets the numbers of this one:
inertia, radius and mass, and barriers that scale with the slip. Gains stay, but where a paper has
them for another quantity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from casadi import fmax, fmin

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    connect,
    flip_sign,
    law,
    mirror,
    one,
    sampled,
    speed_to_ratio,
)
from slipctl.block.signals import Signal
from slipctl.models.cheng_2022 import freight_traction_control as cheng
from slipctl.models.huang_2020 import subway_braking_control as huang
from slipctl.models.ranges import of_those
from slipctl.models.shared_names import SHARED
from slipctl.models.wang_2025 import hst_traction_control as wang
from slipctl.models.zhang_2021 import hst_braking_control as zhang

T_S = 1e-3
"""Tick of all laws in s."""

ADDED = "of the wheel that it drives"


class Wheel(NamedTuple):
    """A wheel and what moves with it.

    Attributes:
        J: inertia at the wheel in kg m^2.
        r: radius in m.
        W: load on the rail in kg.
        m: mass of the vehicle per such wheel in kg.
        g: gravity in m/s^2.
        T_max: largest torque at the wheel in N m.
        tau: time constant of the actuator in s, as the controller knows it.
        v_best: typical best slip in m/s.
        v: speed at the start in m/s.
    """

    J: float
    r: float
    W: float
    m: float
    g: float
    T_max: float
    tau: float
    v_best: float
    v: float


# ---- the form itself -----------------------------------------------------------------------------


@law(
    D=Output(
        "m/s^2",
        "what the slip falls by without torque",
        positive="braking",
        source="adhesion of 2 on the least inertia",
        lo=-1e5,
        hi=1e5,
    ),
)
def fall(
    F=Input(
        "N",
        "adhesion force",
        positive="braking",
        source="that of the law, whose mass is its own",
        lo=-1e12,
        hi=1e12,
    ),
    a_R=Input(
        "m/s^2",
        "deceleration by resistance",
        value=0.0,
        positive="braking",
        source="gravity",
        lo=-10,
        hi=10,
    ),
    J=Param("kg m^2", 240.0, "inertia at the wheel", ADDED, lo=1, hi=1e4),
    r=Param("m", 0.5, "wheel radius", ADDED, lo=0.2, hi=1),
    m=Param("kg", 8000.0, "mass of the vehicle per wheel", ADDED, lo=1e3, hi=1e7),
):
    """D = (r^2/J + 1/m) F + a_R."""
    return (r**2 / J + 1 / m) * F + a_R


@law(
    F=Output("N", "adhesion force", "adhesion of 2 under 50 t", positive="braking", lo=-1e6, hi=1e6)
)
def force(
    mu=Input("1", "adhesion coefficient", positive="braking"),
    m_axle=Param("kg", 8000.0, "load on the rail", ADDED, lo=1e3, hi=5e4),
    g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
):
    """F = mu W g."""
    return mu * m_axle * g


@law(
    T_eq=Output(
        "N m",
        "torque that keeps the slip",
        positive="braking",
        source="adhesion of 2 on the largest inertia",
        lo=-1e7,
        hi=1e7,
    )
)
def keeping(
    D=Input(
        "m/s^2",
        "what the slip falls by without torque",
        positive="braking",
        source="adhesion of 2 on the least inertia",
        lo=-1e5,
        hi=1e5,
    ),
    J=Param("kg m^2", 240.0, "inertia at the wheel", ADDED, lo=1, hi=1e4),
    r=Param("m", 0.5, "wheel radius", ADDED, lo=0.2, hi=1),
):
    """T = (J/r) D, for s' = 0."""
    return J / r * D


@law(T_cmd=Output("N m", "commanded torque", positive="braking", lo=0, hi="T_max"))
def limits(
    T_wanted=Input(
        "N m",
        "wanted torque",
        positive="braking",
        source="the gains at the ends of their ranges",
        lo=-1e9,
        hi=1e9,
    ),
    T=Input(
        "N m",
        "torque at the wheel, as measured",
        positive="braking",
        source="the gains at the ends of their ranges",
        lo=-1e9,
        hi=1e9,
    ),
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
    lead=Param("1", 1.0, "time constant of the actuator over the one it is to have", lo=1, hi=20),
):
    """Command behind a lag: shortened by ``lead`` as in freight_traction, then limited."""
    return fmin(T_max, fmax(0, T + lead * (fmin(T_max, fmax(0, T_wanted)) - T)))


@law(T_top=Output("N m", "most that may be applied", positive="braking", lo=0, hi="T_max"))
def most(T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8)):
    """What a law is told that it can have at most."""
    return 1 * T_max


# ---- the laws ------------------------------------------------------------------------------------

LAW = {
    "v": (-1, 120, "430 km/h; 10 m/s^2 for 1 ms, and noise", 0.01, 0.5),
    "v_s": (-0.5, 120, "a locked wheel; noise alone slips the other way", 0.5),
    "D": ("-20 - 1e6 * r**2 / J", "20 + 1e6 * r**2 / J", "adhesion of 2 under 50 t"),
    "F": (-1e6, 1e6, "adhesion of 2 under 50 t"),
    "T": (-1e6, 1e6, "fifty brakes"),
    **dict.fromkeys(("a", "b", "c", "a0", "a1", "a2"), (-1e6, 1e6, "parameters of the curve")),
    **dict.fromkeys(
        ("ratio.y", "adh.lam"), (-125, 125, "locked at 1 m/s, below which none is formed")
    ),
    "best.y": (-20, 20, "twice the range that is searched"),
    "force.y": (-1e6, 1e6, "that of the input"),
    "fall.y": (-1e5, 1e5, "that of the input"),
    "slip.y": (-120, 120, "that of the input"),
    **dict.fromkeys(("adh.mu", "adh.grip"), (-1e3, 1e3, "parameters far from any rail")),
    **dict.fromkeys(("nmpc.X", "nmpc.U", "nmpc.applied"), (-1e6, 1e6, "a hundred thrusts")),
    "nmpc.S": (-10, 10, "statuses are whole numbers"),
    "nmpc.planned": (0, 1, "no or yes"),
}
"""Ranges of a law in the common form: what it is fed, and what its adaptors and its plan hold."""

SEARCHED = "what a search looks through; three times the typical one where that is more"
WANTED = "250 times the largest torque; it is limited behind the law"


def with_law_ranges(law_block: Block, w: Wheel) -> Block:
    """Declare the ranges of a law that it has signals for: :data:`LAW`, and those of its wheel."""
    best, most = max(6.0, 3 * w.v_best), 250 * w.T_max
    rows = LAW | {"v_best": (0, best, SEARCHED)} | dict.fromkeys(
        ("T_wanted", "torque.y", "torque.T", "mirror.y"), (-most, most, WANTED)
    )  # fmt: skip
    return of_those(law_block, rows)


def of_huang(control_law: Block) -> Callable[[Wheel], Block]:
    """A law of ``subway_braking_control``: it is in this form already."""

    def make(w: Wheel) -> Block:
        wires = {
            "reference.v": "v",
            "reference.v_opt": "v_best",
            "keeping.D": "D",
            "law.v_s": "v_s",
            "law.v_ref": "reference.v_ref",
            "law.T_eq": "keeping.T_eq",
            "T_wanted": "law.T_wanted",
        }
        parts = {"law": control_law.with_params(J=w.J, r=w.r)}
        if "T_top" in control_law.inputs:  # its integral stands still there
            wires["law.T_top"] = "most.T_top"
            parts["most"] = most.with_params(T_max=w.T_max)
        return with_law_ranges(connect(
            "law", wires, share=SHARED, reference=huang.slip_reference,
            keeping=keeping.with_params(J=w.J, r=w.r), **parts,
        ), w)  # fmt: skip

    return make


def of_zhang(control_law: Block) -> Callable[[Wheel], Block]:
    """A law of ``hst_braking_control``: slip as ratio, braking torques and forces negative.

    Its term of the vehicle's motion is that of a braked one, whose speed falls; on a driven wheel
    it has the other sign and is left out.
    """

    def make(w: Wheel) -> Block:
        p = {"J": w.J, "r": w.r, "T_max": w.T_max}
        if control_law.choices.get("motion"):
            p |= {"n": 1.0, "m": w.m}
        block = control_law.with_params(**{k: x for k, x in p.items() if k in control_law.params})
        first = min(w.v_best / w.v, 0.1)
        # without its term of the motion the law has no mass
        shared = {k: v for k, v in SHARED.items() if k != "m" or control_law.choices.get("motion")}
        shared |= {n: f"*.{n}" for n in ("lam_start", "lam_ref_start")}
        wires = {
            "ratio.u": "v_s",
            "ratio.v": "v",
            "best.u": "v_best",
            "best.v": "v",
            "force.u": "F",
            "reference.best": "best.y",
            "reference.lam": "ratio.y",
            "reference.F_a": "force.y",
            "reference.v": "v",
            "torque.u": "law.T_wanted",
            "T_wanted": "torque.y",
        }
        ports = {"v": "v", "lam": "ratio.y", "F_a": "force.y", "lam_ref": "reference.lam_ref",
                 "rate": "reference.rate"}  # fmt: skip
        wires |= {f"law.{n}": ports[n] for n in block.inputs}
        shape = zhang.shaper.with_params(J=w.J, r=w.r)
        shape = shape.with_params(lam_ref_start=first)
        return with_law_ranges(connect(
            "law", wires, share=shared, ratio=speed_to_ratio(), best=speed_to_ratio(),
            force=flip_sign("N", "traction"), reference=shape, law=block,
            torque=flip_sign("N m", "braking"),
        ), w)  # fmt: skip

    return make


def of_cheng(form: str = "robust", tick: float = T_S) -> Callable[[Wheel], Block]:
    """The barrier law of ``freight_traction_control``: made for a driven wheel, so in the mirror.

    Its barrier of 0.02 m/s stands at a best creep of 1.21 m/s and keeps that share elsewhere.
    ``tick`` is its period in s.
    """
    barrier = cheng.barrier_law(form)

    def make(w: Wheel) -> Block:
        share = w.v_best / 1.2098601
        block = barrier.with_params(
            k_s=cheng_barrier(w), v_sopt=w.v_best, J=w.J, r=w.r, R_g=1.0, T_max=w.T_max
        )
        wires = {
            "slip.u": "v_s",
            "best.u": "v_best",
            "fall.u": "D",
            "reference.v": "best.y",
            "barrier.v_s": "slip.y",
            "barrier.v_ref": "reference.v_ref",
            "barrier.rate": "reference.rate",
            "barrier.D_hat": "fall.y",
            "torque.u": "barrier.T_cmd",
            "T_wanted": "torque.y",
        }
        reference = cheng.reference(tick)
        reference = reference.with_params(most=10.0 * share)
        speed = ("m/s", "traction", "speed")
        return with_law_ranges(connect(
            "law", wires, share=SHARED, slip=mirror(*speed), best=mirror("m/s", "traction"),
            fall=mirror("m/s^2", "traction"), reference=reference, barrier=block,
            torque=mirror("N m", "braking"),
        ), w)  # fmt: skip

    return make


def cheng_barrier(w: Wheel) -> float:
    """Barrier above the reference in m/s."""
    return 0.02 * w.v_best / 1.2098601


def of_wang(control_law: Block, tick: float = T_S) -> Callable[[Wheel], Block]:
    """A law of ``hst_traction_control``: with v - v_d the slip error and M = J/r it is a slip law.

    It tracks speed and position; a slip has no position, so e1 = 0. Its gains are made for a
    disturbance of 0.05 m/s^3; the caller gives gains for one of a slip. ``tick`` is its period
    in s.
    """

    def make(w: Wheel) -> Block:
        block = sampled(control_law, tick, "euler") if control_law.kind == "flow" else control_law
        scale = block.params["m"].value
        wires = {
            "slip.u": "v_s",
            "best.u": "v_best",
            "error.v_s": "slip.y",
            "error.v_ref": "best.y",
            "fall.u": "D",
            "law.e1": "error.e1",
            "law.e2": "error.e2",
            "law.a_ff": "fall.y",
            "law.F_hi": "scale.F_hi",
            "law.F_lo": "scale.F_lo",
            "torque.F": "law.F_wanted",
            "mirror.u": "torque.T",
            "T_wanted": "mirror.y",
        }
        return with_law_ranges(connect(
            "law", wires, share={k: v for k, v in SHARED.items() if k != "m"}
            | {"m_law": ["law.m", "scale.m", "torque.m"]},
            slip=mirror("m/s", "traction", "speed"), best=mirror("m/s", "traction"),
            fall=mirror("m/s^2", "traction"), error=slip_error,
            scale=force_limits.with_params(m=scale, J=w.J, r=w.r, T_max=w.T_max),
            law=block, torque=torque_of.with_params(m=scale, J=w.J, r=w.r),
            mirror=mirror("N m", "braking"),
        ), w)  # fmt: skip

    return make


@law(
    e1=Output("m", "none: a slip has no position", source="a slip has no position", lo=-1, hi=1),
    e2=Output("m/s", "creep less reference", source="a wheel that spins free", lo=-500, hi=500),
)
def slip_error(
    v_s=Input(
        "m/s",
        "creep",
        positive="traction",
        per="speed",
        source="a wheel that spins free",
        lo=-120,
        hi=500,
    ),
    v_ref=Input(
        "m/s",
        "its reference",
        positive="traction",
        source="twice the range that is searched",
        lo=-20,
        hi=20,
    ),
):
    """Slip error in the place of a speed error."""
    return dict(e1=0 * one("s") * v_s, e2=v_s - v_ref)


SCALE = dict(
    m=Param("kg", 500e3, "mass that the law has", ADDED, lo=1, hi=1e9),
    J=Param("kg m^2", 240.0, "inertia at the wheel", ADDED, lo=1, hi=1e4),
    r=Param("m", 0.5, "wheel radius", ADDED, lo=0.2, hi=1),
)


@law(F_hi=Output("N", "largest force", positive="traction", lo=0, hi='m * r / J * T_max'),
     F_lo=Output("N", "smallest force", positive="traction", source='a brake does not drive', lo=-1,
                 hi=1))  # fmt: skip
def force_limits(
    m=SCALE["m"], J=SCALE["J"], r=SCALE["r"],
    T_max=Param("N m", 20e3, "largest torque", ADDED, lo=1, hi=1e8),
):  # fmt: skip
    """Limits of the torque as forces on the mass of the law, F = M (r/J) T."""
    return dict(F_hi=m * r / J * T_max, F_lo=0 * m * r / J * T_max)


@law(
    T=Output(
        "N m",
        "torque at the wheel",
        positive="traction",
        source="the gains at the ends of their ranges",
        lo=-1e9,
        hi=1e9,
    )
)
def torque_of(
    F=Input("N", "force that the law wants", positive="traction",
            source='that of the law, whose mass is its own', lo=-1e12, hi=1e12),
    m=SCALE["m"], J=SCALE["J"], r=SCALE["r"],
):  # fmt: skip
    """T = (J/r) F/M."""
    return J / r * F / m


MEANINGS = {
    "pid": "PI on the slip ratio; its gains follow from the wanted bandwidth K (Zhang 2021).",
    "smc": "Sliding mode by a reaching law; its constant part chatters (Huang 2020).",
    "sta": "Super-twisting: the root of the slip error and an integral of its sign; the torque is"
    " continuous (Huang 2020).",
    "efc": "Feedback linearisation: it cancels the adhesion force, and the slip error decays with K"
    " (Zhang 2021).",
    "eppfc": "Prescribed performance: the slip error stays in a funnel that narrows (Zhang 2021).",
    "eppfc_barrier": "Prescribed performance by a barrier in place of the printed transformation"
    " (Zhang 2021).",
    "barrier": "Robust barrier law: the slip does not exceed the best slip by more than k_s"
    " (Cheng 2022).",
    "hosm": "Higher-order sliding mode with compensation of a torque at its limit (Wang 2025).",
}
"""What each law does, in a sentence, by its name in :func:`laws`."""

SAMPLE = Wheel(
    J=110.0, r=0.42, W=9500.0, m=9500.0, g=9.81, T_max=8000.0, tau=0.06, v_best=1.2, v=50 / 3
)
"""Wheel of the metro car that ``slipctl new`` writes."""


def gains_of_law(name: str) -> list[Signal]:
    """Gains that a file may set of a law, with the values that they have on :data:`SAMPLE`.

    The numbers of the wheel itself come from the vehicle and are left out.

    Raises:
        KeyError: no such law.
    """
    block = laws()[name](SAMPLE)
    return [s for n, s in block.params.items() if "." in n and not s.derived]


def laws(driven: bool = False, tick: float = T_S) -> dict[str, Callable[[Wheel], Block]]:
    """Makers of the laws by name, to be given a :class:`Wheel`.

    Args:
        driven: for a driven wheel.
        tick: period in s of laws that insist on one; the others have it as parameter ``T``.
    """
    motion = not driven
    return {
        "pid": of_zhang(zhang.pid()),
        "smc": of_huang(huang.reaching_law()),
        "sta": of_huang(huang.super_twisting()),
        "efc": of_zhang(zhang.feedback_linearisation(motion)),
        "eppfc": of_zhang(zhang.prescribed(motion=motion)),
        "eppfc_barrier": of_zhang(zhang.prescribed(law="barrier", motion=motion)),
        "barrier": of_cheng(tick=tick),
        "hosm": of_wang(wang.higher_order(eta=10.0).with_params(k_3=10.0), tick),
    }
