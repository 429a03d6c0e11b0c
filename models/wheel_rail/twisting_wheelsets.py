"""Driven axles that twist, in a train on the rail: the wheels of an axle slip differently.

The train of :mod:`slipctl.models.wheel_rail.axles` knows the mean speed of a wheelset, that of its
momentum. Each inertia j of the row rotor, wheel, wheel turns faster than that by d_j and stands
ahead by the angle a_j. At the rim of a wheel that is r d_j in m/s:

    J_j d_j' = -(K a)_j - (C d)_j + T_j - r N f(v_s + r d_j) - J_j (mean of all that),   a_j' = d_j

with f of the wheels alone, and the torque T of the motor on the first of the row. The axle has the
mean adhesion of both wheels. A tick is cut into equal steps: first the rates, then the angles with
the new rates, so that a step neither feeds the swing nor damps it. Where adhesion rises with the
slip it is taken at the end of the step, linearised, as it is stiff there.

The books of the train take the heat at the mean slip. What the swing takes of that, or gives, stays
between wheels and axle.
"""

from __future__ import annotations

from math import ceil, pi
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.block.fields import Composition
from slipctl.block.transforms.replication import signal_of_copies
from slipctl.models.wheel_rail.torsion import Wheelset

WHEELS = ("ahead", "back")
"""Inputs of the law on two wheels: by how much each is faster than the wheelset, at its rim."""

SHARP = 0.03
"""Largest step, times the fastest frequency in rad/s."""

SECANT = 1e-3
"""Slip in m/s over which the rise of the adhesion is taken."""

OWN = "of the vehicle"


def law_on_two_wheels(adhesion: Block) -> Block:
    """Mean adhesion of two wheels, one ``ahead`` and one ``back`` in m/s at the rim.

    Args:
        adhesion: law as a train takes it, from ``v_s`` and ``v`` to ``mu``, traction positive.
    """

    def body(x: Any, u: Any, p: Any) -> Any:
        own = {k: e for k, e in u.items() if k not in WHEELS}
        both = [adhesion.expr({}, own | {"v_s": u["v_s"] + u[w]}, p)[1]["mu"] for w in WHEELS]
        return {}, {"mu": (both[0] + both[1]) / 2}

    faster = Input("m/s", "how much faster a wheel is than its wheelset", value=0.0)
    beside = [faster.named(w) for w in WHEELS]
    return make_block(
        adhesion.name, "law", body, inputs=[*adhesion.inputs.values(), *beside],
        params=list(adhesion.params.values()), outputs=[adhesion.outputs["mu"]],
        conditions=adhesion.conditions, sx=adhesion.sx, choices=adhesion.choices,
        doc=adhesion.doc,
    )  # fmt: skip


def damping_matrix(wheelset: Wheelset) -> np.ndarray:
    """Damping over the rates of the inertias in N m s/rad, with its ratio in each mode."""
    J = np.array(wheelset.inertias, dtype=float)
    C = np.zeros((J.size, J.size))
    for mode in wheelset.modes():
        weighed = J * mode.shape
        C += 2 * wheelset.damping * 2 * pi * mode.frequency * np.outer(weighed, weighed)
    return C


def steps_of_tick(wheelset: Wheelset, h: float) -> int:
    """Into how many steps a tick of h seconds is cut."""
    fastest = max(m.frequency for m in wheelset.modes())
    return max(ceil(2 * pi * fastest * h / SHARP), 4)


def train_that_twists(train: Block, wheelset: Wheelset, driven: tuple[int, ...]) -> Block:
    """Let the driven axles of a train twist.

    Args:
        train: made by ``rolling`` with :func:`law_on_two_wheels`.
        wheelset: inertias and shafts of each driven axle; its last two inertias are the wheels.
        driven: places of these axles.

    Returns:
        The train with two states more for each inertia and driven axle, ``angle`` and ``rate``.
        ``omega_d`` is the speed of the wheel beside the motor, ``torsion`` the axle's torque.
    """
    law, h = train.parts["adh"], float(train.period or 0)
    m, many, steps = len(wheelset.inertias), len(driven), steps_of_tick(wheelset, h)
    others = [k for k in law.inputs if k not in ("v_s", "v", *WHEELS)]
    advance = law.of_equations(
        ("twist", m, steps, h, tuple(others)), lambda: _advance(law, others, m, h / steps, steps)
    )

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        angle, rate = ca.reshape(x["angle"], m, many), ca.reshape(x["rate"], m, many)
        n = x["omega"].size1()
        r = p["r"] if p["r"].size1() == n else ca.repmat(p["r"], n, 1)
        swing = {w: ca.MX.zeros(n, 1) for w in WHEELS}
        for k, axle in enumerate(driven):
            for row, w in zip((m - 2, m - 1), WHEELS, strict=True):
                swing[w][axle] = r[axle] * rate[row, k]
        own = {k: e for k, e in x.items() if k not in ("angle", "rate")}
        nxt, y = train.expr(own, u | swing, p)
        load = ca.fmax(p["m_axle"] * p["g"] + u.get("dN", 0), 1)
        angles, rates = [], []
        for k, axle in enumerate(driven):

            def one(e: Any, axle: int = axle) -> Any:
                return e[axle] if e.numel() == n and n > 1 else e

            numbers = ca.vertcat(
                y["v_s"][axle],
                x["v"],
                u["T"][k] if many > 1 else u["T"],
                one(load) / 2,
                r[axle],
                p["inertia"],
                ca.vec(p["K"]),
                ca.vec(p["C"]),
                *(one(u[name]) for name in others),
                *(one(p[f"adh.{name}"]) for name in law.params),
            )
            found = advance(ca.vertcat(angle[:, k], rate[:, k]), ca.repmat(numbers, 1, steps))
            angles.append(found[:m])
            rates.append(found[m:])
        first = ca.vertcat(*[rate[m - 2, k] for k in range(many)])
        twist = ca.vertcat(*[angle[m - 2, k] - angle[m - 1, k] for k in range(many)])
        y = y | {"omega_d": y["omega_d"] + first, "torsion": -p["K"][m - 2, m - 1] * twist}
        return nxt | {"angle": ca.vertcat(*angles), "rate": ca.vertcat(*rates)}, y

    def rebuild(parts: dict[str, Block]) -> Block:
        return train_that_twists(parts[train.name], wheelset, driven)

    J, C = np.array(wheelset.inertias, dtype=float), damping_matrix(wheelset)
    torque = Output("N m", "torque of the axle between its wheels").named("torsion")
    signals = [
        *(s for s in train.signals if s.name not in WHEELS),
        State("rad", 0.0, "inertias of the driven axles ahead of the mean, axle by axle",
              shape=(m * many,), lo=-1, hi=1).named("angle"),
        State("rad/s", 0.0, "how much faster they are than it", shape=(m * many,), lo=-1e3,
              hi=1e3).named("rate"),
        Param("kg m^2", J, "inertias of a driven axle", OWN, shape=(m,)).named("inertia"),
        Param("N m/rad", wheelset.stiffness_matrix, "stiffness over their angles", OWN,
              shape=(m, m)).named("K"),
        Param("N m s/rad", C, "damping over their rates", OWN, shape=(m, m)).named("C"),
        signal_of_copies(torque, many, "driven"),
    ]  # fmt: skip
    return Block(
        train.name, "step", body, signals, period=train.period, sx=False,
        doc=f"{train.doc}\n\n{__doc__}", choices=train.choices | {"inertias of an axle": m},
        conditions=train.conditions, composition=Composition.around(train, rebuild),
    )  # fmt: skip


def _advance(law: Block, others: list[str], m: int, dt: float, steps: int) -> ca.Function:
    """Angles and rates of one axle after all steps of a tick; numbers are held over it."""
    sym = ca.SX.sym if law.sx else ca.MX.sym
    x = sym("x", 2 * m)
    given = sym("given", 5 + m + 2 * m * m + len(others) + len(law.params))
    angle, rate = x[:m], x[m:]
    s, v, T, N, r = (given[k] for k in range(5))
    J, at = given[5 : 5 + m], 5 + m
    K = ca.reshape(given[at : at + m * m], m, m)
    C = ca.reshape(given[at + m * m : at + 2 * m * m], m, m)
    at += 2 * m * m
    beside = {name: given[at + k] for k, name in enumerate(others)}
    numbers = {name: given[at + len(others) + k] for k, name in enumerate(law.params)}

    def height(slip: Any) -> Any:
        u = {"v_s": slip, "v": v, **dict.fromkeys(WHEELS, 0), **beside}
        return law.expr({}, u, numbers)[1]["mu"]

    pull, stiff = [0] * (m - 2), [0] * (m - 2)
    for k in (m - 2, m - 1):
        slip = s + r * rate[k]
        rise = (height(slip + SECANT) - height(slip - SECANT)) / (2 * SECANT)
        pull.append(r * N * height(slip))
        stiff.append(r * r * N * ca.fmax(rise, 0))
    force = -ca.mtimes(K, angle) - ca.mtimes(C, rate) - ca.vertcat(*pull)
    force[0] += T
    force = force - J * ca.sum1(force) / ca.sum1(J)
    later = rate + dt * force / (J + dt * ca.vertcat(*stiff))
    later = later - ca.dot(J, later) / ca.sum1(J)
    one = ca.Function("twist", [x, given], [ca.vertcat(angle + dt * later, later)], {"cse": True})
    return one.fold(steps)
