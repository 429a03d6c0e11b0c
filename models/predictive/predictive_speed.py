"""Predictive speed control of a train under its adhesion limit: a rival to ``hst_traction``'s laws.

    e1' = e2,   e2' = F/M - a_ff + d,   F_lo <= F <= F_hi

with the errors and the feed-forward of ``hst_traction_control.tracking`` and the limits of its
anti-slip law as bounds that are inputs. d is observed, so that the error goes to zero whatever mass
or resistance is wrong. The problem is linear: what it has beyond the other laws is that it knows
its limits and plans with them.
"""

from __future__ import annotations

from slipctl import Block, Input, Output, Param, State, connect, every, flow, law, nmpc, step
from slipctl.models.wang_2025.hst_traction_control import A_FF, E1, E2, FORCES, HI, LO, M_, T_C


@flow(name="body")
def body(
    e1=State("m", 0.0, "position less target"),
    e2=State("m/s", 0.0, "speed less target"),
    F=Input("N", "force of the train", lo=-1e6, hi=1e6, positive="traction"),
    a_ff=A_FF,
    d=Input("m/s^2", "acceleration beyond the model", value=0.0),
    m=M_,
):
    """Train as a point, relative to its target."""
    return dict(e1=e2, e2=F / m - a_ff + d), {}


@law(position=Output("m"), speed=Output("m/s"), effort=Output("m/s^2"))
def residuals(
    e1=E1,
    e2=E2,
    F=Input("N", "force of the train", positive="traction"),
    a_ff=A_FF,
    d=Input("m/s^2", "acceleration beyond the model"),
    m=M_,
):
    """Errors, and the acceleration beyond what the target needs: its weight is comfort."""
    return dict(position=e1, speed=e2, effort=F / m - a_ff + d)


@step(
    d=Output(
        "m/s^2",
        "acceleration beyond the model",
        source="that of the target",
        lo=-1e4,
        hi=1e4,
    )
)
def unmodelled(
    e_h=State("m/s", 0.0, "predicted speed error", source="that of the error", lo=-500, hi=500),
    d_h=State(
        "m/s^2",
        0.0,
        "acceleration beyond the model",
        source="that of the target",
        lo=-1e4,
        hi=1e4,
    ),
    e2=E2,
    F=Input("N", "force of the train", positive="traction"),
    a_ff=A_FF,
    m=M_,
    pole=Param("1/s", 2.0, "both poles of the observer", "chosen", lo=0.01, hi=100),
    T=Param("s", T_C, "sample period", lo=1e-6, hi=0.1),
):
    """Observer of the speed error and of a constant disturbance."""
    error = e2 - e_h
    nxt = dict(e_h=e_h + T * (F / m - a_ff + d_h + 2 * pole * error), d_h=d_h + T * pole**2 * error)
    return nxt, dict(d=d_h)


@step(
    **FORCES,
    F_last=Output(
        "N",
        "force of the last run",
        positive="traction",
        source="a hundred times the largest force of a train",
        lo=-1e9,
        hi=1e9,
    ),
    name="held",
)
def held(
    F_h=State(
        "N",
        0.0,
        "force of the last run",
        positive="traction",
        source="a hundred times the largest force of a train",
        lo=-1e9,
        hi=1e9,
    ),
    F=Input("N", "planned force", positive="traction"),
    F_hi=HI,
    F_lo=LO,
):
    """The planned force within the limits of this run, kept for the observer."""
    from casadi import fmax, fmin

    F_contr = fmin(F_hi, fmax(F_lo, F))
    return dict(F_h=F_contr), dict(F_contr=F_contr, F_wanted=F, F_last=F_h)


def predictive_speed(
    ticks: int = 20,
    horizon: int = 25,
    position: float = 1.0,
    speed: float = 3.2,
    effort: float = 1.0,
    jerk: float = 1.0,
) -> Block:
    """Make the law: from e1, e2, a_ff and the limits to F_contr and F_wanted.

    Args:
        ticks: runs of the law's period, 5 ms, from one solution to the next.
        horizon: stages of that length.
        position, speed, effort: weights.
        jerk: largest rate of the command in m/s^3 times the mass.
    """
    mass = float(M_.value)
    solver = nmpc(
        body, residuals, "F", h=ticks * T_C, horizon=horizon,
        weights={"position": position, "speed": speed, "effort": effort},
        bounds={"F": ("F_lo", "F_hi")}, rates={"F": jerk * mass},
        moves=(1, 1, 2, 4, horizon - 8),
    )  # fmt: skip
    wires = {
        "nmpc.e1": "e1", "nmpc.e2": "e2", "nmpc.a_ff": "a_ff", "nmpc.F_hi": "F_hi",
        "nmpc.F_lo": "F_lo", "nmpc.d": "observer.d", "observer.e2": "e2", "observer.a_ff": "a_ff",
        "observer.F": "held.F_last", "held.F": "nmpc.F", "held.F_hi": "F_hi", "held.F_lo": "F_lo",
        "F_contr": "held.F_contr", "F_wanted": "held.F_wanted",
    }  # fmt: skip
    return connect("nmpc", wires, nmpc=every(solver, ticks), observer=unmodelled, held=held)
