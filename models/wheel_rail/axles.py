"""Wheels of a train on the rail, one implicit step for all axles: the stiff part of a plant.

    x' = v,   M v' = sum_i n_i F_i - F_d                                 body
    J_i omega_i' = T_i - T_b,i sign(omega_i) - r F_i - B_t omega_i       axle i; n_i are alike
    F_i = mu_i(v_s,i, v) N_i,   v_s,i = r omega_i - v                    contact

The step is backward Euler in the speeds: F_i is taken at the creep at the end of the step, the
speed that divides the creep at its start. With k = (J/h + B_t)/r^2 the equation of an axle is one
in its creep,

    k (v_s - beta) + N mu(v_s, v) = 0,   beta = r (J omega/h + T)/(J/h + B_t) - v+

whose root lies within N/k of beta as long as |mu| <= 1. Newton's method in this bracket solves it
for a given v+, and a few sweeps over the axles settle v+ = v + h (sum n_i F_i - F_d)/M. The brake
takes torque, it gives none: where it would turn the wheel back, the wheel stands.

With ``standing`` a train comes to a stand and stays there, by complementarity: v+ = 0 and all
omega_i+ = 0 where forces exist that do it within the step,

    F_d - F_m + R - M v/h = sum n_i F_i,   |R| <= F_h,
    |r F_i - J omega_i/h - T_i| <= T_b,i,   |F_i| <= max mu_i N_i

and the step as above where not. F_m is the running resistance in F_d, and R what it is at a stand.
So v is 0 exactly, and the train starts again when more is asked of brake or rail than they carry. A
wheel that is locked slides on all of its patch, however slowly. So it has the largest adhesion
where the train is slower than the slip of the peak, or as much less as its brake takes.

F_i is one number in both equations, so that with the mean speeds of the step, as an identity,

    change of (M v^2/2 + sum n_i J_i omega_i^2/2) = h (P_drive - P_brake - P_bearing - P_slip - P_d)

A law may have inputs beside v_s and v: what the rail under each axle is like, see
models/wheel_rail/rail_memory.py. Then the train tells the heat of each contact and the way of the
step, of which a rail that remembers makes its next state.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, State, make_block
from slipctl.block.block import Exprs
from slipctl.block.signals import Signal
from slipctl.block.transforms.replication import signal_of_copies, with_derived
from slipctl.errors import refuse_unknown_choice
from slipctl.models.wheel_rail.axle_forces import (
    peaks_under_axles,
    settle_forces,
    standing_forces,
)
from slipctl.models.wheel_rail.contact import check_patch

TRACTION = {"positive": "traction"}
BRAKING = {"positive": "braking"}
SOURCE = "Wang 2025, Table 1"

LEFT = 1.0
"""Residual in N above which contact force and law disagree."""


@dataclass(frozen=True)
class Axles:
    """Axles of a train, alike ones as one.

    Args:
        count: how many axles each entry stands for.
        behind: place behind the first axle in m.
        driven: which have a motor.

    Raises:
        BadInput: lists of unequal length, none, or a count below 1.
    """

    count: tuple[int, ...]
    behind: tuple[float, ...]
    driven: tuple[bool, ...]

    def __post_init__(self) -> None:
        if not self.count or not len(self.count) == len(self.behind) == len(self.driven):
            raise BadInput(
                f"Axles takes one entry per axle: {len(self.count)} count,"
                f" {len(self.behind)} behind, {len(self.driven)} driven"
            )
        if any(n < 1 or n != int(n) for n in self.count):
            raise BadInput(f"Axles: count = {self.count} must be whole numbers >= 1")

    def __len__(self) -> int:
        return len(self.count)

    @property
    def motors(self) -> tuple[int, ...]:
        """Places of the driven axles in the list."""
        return tuple(k for k, driven in enumerate(self.driven) if driven)

    def grouped(self) -> "Axles":
        """Driven axles as one and the others as one, all at the first axle's place.

        The same as the distinct axles on a rail that changes in time, because then all driven
        axles see the same and do the same.
        """
        counts = {d: sum(n for n, e in zip(self.count, self.driven, strict=True) if e == d)
                  for d in (True, False)}  # fmt: skip
        kinds = [d for d in (True, False) if counts[d]]
        return Axles(tuple(counts[d] for d in kinds), (0.0,) * len(kinds), tuple(kinds))


def rolling(
    adhesion: Block,
    axles: Axles,
    h: float,
    distinct: Sequence[str] = (),
    apart: Sequence[str] = (),
    standing: bool = False,
) -> Block:
    """Make the step of body, axles and contact.

    Inputs are the motor torque of each driven axle and the largest brake torque of each axle, held
    over the step. The parameters of the law that its rail conditions set are one per axle.

    Args:
        adhesion: law from ``v_s`` and ``v`` to ``mu``; |mu| <= 1. Its other inputs are inputs of
            the train, one for each axle.
        axles: see :class:`Axles`.
        h: step in s.
        distinct: further parameters of the law of which each axle has its own.
        apart: of ``r`` and ``T_b`` those of which each axle has its own. With ``share`` the load
            of an axle follows from its share of the train. ``dN`` is an input, the load that moves
            onto an axle.
        standing: a train comes to a stand and is held there, see above.

    Returns:
        Step with the law as its part ``adh``. Outputs: ``v_s`` is the creep at the start of the
        step, ``F``, ``mu`` and the powers hold over it; a power is that of all axles.

    Raises:
        BadInput: a law with other inputs, or without ``mu``; an unknown name in ``apart``.
    """
    for name in apart:
        refuse_unknown_choice("rolling", "apart", name, ("r", "T_b", "share", "dN"))
    if not {"v_s", "v"} <= set(adhesion.inputs) or "mu" not in adhesion.outputs:
        raise BadInput(
            f"{adhesion.name} has the inputs {', '.join(adhesion.inputs)}; an adhesion law under a"
            ' train has v_s and v=Input("m/s", "train speed"), used or not, and gives mu'
        )
    train = _Train(adhesion, axles, h, tuple(distinct), tuple(apart), standing)

    def rebuild(parts: dict[str, Block]) -> Block:
        return rolling(parts["adh"], axles, h, distinct, apart, standing)

    def guard(p: Mapping[str, Any]) -> None:
        """Refuse a law that knows another wheel."""
        law = {k: p[f"adh.{k}"] for k in adhesion.params if f"adh.{k}" in p}
        if {"m_axle", "g", "r"} <= set(p):
            check_patch(law, np.asarray(p["m_axle"]) * p["g"] / 2, p["r"])

    return make_block(
        "train", "step", train.step_function(), states=train.states(), inputs=train.inputs(),
        params=[*train.params(), *train.law_params], outputs=train.outputs(), period=h, sx=False,
        parts={"adh": adhesion}, rebuild=rebuild, prefixed=True, own=train.own, by_structure=True,
        doc=__doc__ or "", conditions={c: {f"adh.{k}": v for k, v in values.items()}
                                       for c, values in adhesion.conditions.items()},
        choices={"axles": sum(axles.count), "distinct axles": train.n}
        | ({"standing": True} if standing else {}), guard=guard,
    )  # fmt: skip


class _Contact(NamedTuple):
    """Contacts of all axles over a step; ``stop`` is what the brake takes of a wheel that turns."""

    F: Any
    N: Any
    v_s: Any
    locked: Any
    stands: Any
    residual: Any
    stop: Any
    per_speed: Any
    """J/h + B_t of each axle."""


@dataclass(frozen=True)
class _Train:
    """What a train was made of, as :func:`rolling` takes it, and what its step declares."""

    adhesion: Block
    axles: Axles
    h: float
    distinct: tuple[str, ...]
    apart: tuple[str, ...]
    standing: bool

    @property
    def n(self) -> int:
        """Distinct axles."""
        return len(self.axles)

    @cached_property
    def own(self) -> list[str]:
        """Parameters of the law of which each axle has its own."""
        surface = {k for values in self.adhesion.conditions.values() for k in values}
        return [f"adh.{k}" for k in with_derived(self.adhesion, surface | set(self.distinct))]

    @cached_property
    def law_params(self) -> list[Signal]:
        """Parameters of the law, those of each axle as one vector."""
        found = [s.named(f"adh.{k}") for k, s in self.adhesion.params.items()]
        return [signal_of_copies(s, self.n) if s.name in self.own else s for s in found]

    @cached_property
    def beside(self) -> list[Signal]:
        """Inputs of the law beside creep and speed, one for each axle."""
        given = self.adhesion.inputs.items()
        return [signal_of_copies(s, self.n) for k, s in given if k not in ("v_s", "v")]

    def each(self, signal: Signal, name: str, **changes: Any) -> Signal:
        """A signal of which each axle has its own."""
        return replace(signal_of_copies(signal.named(name), self.n), **changes)

    def states(self) -> list[Signal]:
        """Place, speed of the train, speeds of the axles."""
        return [
            State("m", 0.0, "position of the first axle", lo=-1e7, hi=1e7).named("x"),
            State("m/s", 0.0, "train speed", lo=-200 if self.standing else -1, hi=200).named("v"),
            self.each(State("rad/s", "v / r", "speed of an axle", lo=-1e4, hi=1e4), "omega"),
        ]

    def inputs(self) -> list[Signal]:
        """Torques of brakes and motors, resistance, what the rail is like, moved load."""
        stopping = Input("N m", "largest brake torque of an axle", value=0.0, positive="braking")
        found = [
            self.each(stopping, "T_b") if "T_b" in self.apart else stopping.named("T_b"),
            Input("N", "running resistance", value=0.0, positive="braking").named("F_d"),
            *self.beside,
        ]
        if self.standing:
            moving = Input("N", "part of F_d that only opposes motion", value=0.0, **BRAKING)
            found += [moving.named("F_m"),
                      Input("N", "largest of that at a stand", value=0.0).named("F_h")]  # fmt: skip
        if "dN" in self.apart:
            found.append(self.each(Input("N", "load that moves onto an axle", value=0.0), "dN"))
        if driven := len(self.axles.motors):
            torque = Input("N m", "torque of a motor, at its axle", value=0.0, **TRACTION)
            found.append(signal_of_copies(torque.named("T"), driven, "driven"))
        return found

    def params(self) -> list[Signal]:
        """Numbers of train and axles, beside those of the law."""
        radius, each = Param("m", 0.445, "wheel radius", SOURCE, lo=0.2, hi=1), self.each
        alike = Param("1", doc="how many axles are alike", lo=-1e6, hi=1e6)
        place = Param("m", doc="place behind the first axle", lo=-1e6, hi=1e6)
        return [
            Param("kg", 500e3, "train", SOURCE, lo=1e3, hi=1e8).named("m"),
            *_carried(self.n, "share" in self.apart),
            each(Param("kg m^2", 93.75, "inertia of an axle", SOURCE, lo=1, hi=1e4), "J"),
            each(Param("N m s", 0.01, "damping of an axle", SOURCE, lo=0, hi=1e3), "B_t"),
            each(radius, "r") if "r" in self.apart else radius.named("r"),
            Param("m/s^2", 9.8, "gravity", SOURCE, lo=1, hi=30).named("g"),
            each(Param("1", 1.0, "share of the brake torque that it gets", lo=0, hi=2), "braked"),
            each(alike, "count", value=self.axles.count),
            each(place, "behind", value=self.axles.behind),
        ]

    def outputs(self) -> list[Signal]:
        """What the contacts do over the step, and powers of all axles."""
        each = self.each
        found = [
            each(Output("m/s", "creep, rim minus train", per="speed", **TRACTION), "v_s"),
            each(Output("1", "adhesion coefficient", **TRACTION), "mu"),
            each(Output("N", "contact force of an axle", **TRACTION), "F"),
            Output("N", "contact force of all axles", **TRACTION).named("F_all"),
            Output("m/s^2", "acceleration of the train", **TRACTION).named("a"),
            Output("m/s", "largest creep of an axle", per="speed", **TRACTION).named("v_s_max"),
            Output("m/s", "smallest creep of an axle", per="speed", **TRACTION).named("v_s_min"),
            Output("N", "force of motors and brakes at the rims", **TRACTION).named("F_rim"),
            Output("W", "power of the motors").named("P_drive"),
            Output("W", "power that the brakes take", lo=0).named("P_brake"),
            Output("W", "power that the bearings take", lo=0).named("P_bearing"),
            Output("W", "power that the sliding contacts take", lo=0).named("P_slip"),
            Output("W", "power that running resistance and gradient take").named("P_d"),
            Output("N", "largest residual of the step", lo=0, hi=LEFT).named("residual"),
        ]
        if driven := len(self.axles.motors):
            speed = Output("rad/s", "speed of a driven axle").named("omega_d")
            found.append(signal_of_copies(speed, driven, "driven"))
        if self.standing:
            found.append(Output("J", "kinetic energy of train and wheels", lo=0).named("E_kin"))
        if self.beside:
            found += [
                each(Output("W", "power that the contact of an axle takes"), "P_contact"),
                Output("m", "way of this step").named("way"),
                each(Output("m", "place of an axle"), "at"),
            ]
        return found

    def step_function(self) -> Callable[[Exprs, Exprs, Exprs], tuple[Exprs, Exprs]]:
        """Next states and outputs of the step.

        The Functions that settle the forces are made once for each set of equations of the law.
        """
        law, n, h, standing = self.adhesion, self.n, self.h, self.standing
        given = [*self.law_params, *self.beside]
        apart = (*self.own, *(s.name for s in self.beside))
        settle = law.of_equations(
            ("settle", n, h, apart, standing),
            lambda: settle_forces(law, apart, given, n, h, standing),
        )
        peaks = law.of_equations(
            ("peaks", n, apart), lambda: peaks_under_axles(law, apart, given, n)
        ) if standing else None  # fmt: skip

        def step(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
            T = _scattered(u["T"], self.axles.motors, n) if self.axles.motors else 0
            return self.motion(x, u, p, T, self.contact(x, u, p, T, settle, peaks))

        return step

    def contact(
        self, x: Exprs, u: Exprs, p: Exprs, T: Any, settle: ca.Function, peaks: ca.Function | None
    ) -> _Contact:
        """Contact forces over the step, and which wheels are locked or stand."""
        v, omega, r, m, count, h = x["v"], x["omega"], p["r"], p["m"], p["count"], self.h
        side, push = ca.sign(v), (p["J"] / h * omega + T) / r
        if self.standing:  # the way that a standing train would go
            side = ca.if_else(v == 0, ca.sign(ca.dot(count, push) - u["F_d"]), side)
        side = ca.if_else(omega == 0, side, ca.sign(omega))
        stop = side * p["braked"] * u["T_b"]
        a = p["J"] / h + p["B_t"]
        free = r / a * (p["J"] / h * omega + T - stop)
        v_s = r * omega - v
        N, law = p["m_axle"] * p["g"], [p[s.name] for s in self.law_params]
        law += [u[s.name] for s in self.beside]
        N = ca.fmax(N + u["dN"], 1) if "dN" in self.apart else N
        near = ca.mmin(side * free - N * r**2 / a) <= 0  # its creep may be that of a locked one
        at, height = peaks(near, v, *law) if peaks is not None else ([], [])
        F, locked, residual = settle(
            v_s, v, free, a / r**2, N, ca.sign(stop), count, h / m, u["F_d"],
            *([at] if self.standing else []), *law,
        )  # fmt: skip
        stands: Any = False
        if self.standing:
            hold, need = p["braked"] * u["T_b"] / r, u["F_d"] - u["F_m"] - m * v / h
            stands, F_stand = standing_forces(push, hold, height * N, need, count, u["F_h"])
            F, locked = ca.if_else(stands, F_stand, F), ca.if_else(stands, 1, locked)
            residual = ca.if_else(stands, 0, residual)
        return _Contact(F, N, v_s, locked, stands, residual, stop, a)

    def motion(
        self, x: Exprs, u: Exprs, p: Exprs, T: Any, contact: _Contact
    ) -> tuple[Exprs, Exprs]:
        """Next states under these contact forces, and the outputs."""
        v, omega, r, m, count, h = x["v"], x["omega"], p["r"], p["m"], p["count"], self.h
        F, N, v_s, locked, stands, residual, stop, a = contact
        omega_next = ca.if_else(locked, 0, (p["J"] / h * omega + T - stop - r * F) / a)
        F_all = ca.dot(count, F)
        acceleration, F_d = (F_all - u["F_d"]) / m, u["F_d"]
        if self.standing:
            acceleration = ca.if_else(stands, -v / h, acceleration)
            F_d = ca.if_else(stands, F_all + m * v / h, F_d)
        v_next = v + h * acceleration
        if self.standing:
            v_next = ca.if_else(stands, 0, v_next)
        mean, v_mean = (omega + omega_next) / 2, (v + v_next) / 2
        taken = ca.if_else(locked, p["J"] / h * omega + T - r * F, stop)
        rim = ca.dot(count, (T - taken) / r) if "r" in self.apart else ca.dot(count, T - taken) / r
        outputs = dict(
            v_s=v_s, mu=F / N, F=F, F_all=F_all, a=acceleration,
            v_s_max=ca.mmax(v_s), v_s_min=ca.mmin(v_s), F_rim=rim,
            P_drive=ca.dot(count, T * mean), P_brake=ca.dot(count, taken * mean),
            P_bearing=ca.dot(count, p["B_t"] * omega_next * mean),
            P_slip=ca.dot(count, F * (r * mean - v_mean)), P_d=F_d * v_mean,
            residual=residual,
        )  # fmt: skip
        if self.standing:
            outputs["E_kin"] = m * v**2 / 2 + ca.dot(count, p["J"] * omega**2) / 2
        if self.axles.motors:
            outputs["omega_d"] = omega[list(self.axles.motors)]
        if self.beside:
            outputs |= {"P_contact": count * F * (r * mean - v_mean), "way": h * v_mean}
            outputs["at"] = x["x"] - p["behind"]
        return dict(x=x["x"] + h * v_mean, v=v_next, omega=omega_next), outputs


def _carried(n: int, by_share: bool) -> list[Signal]:
    """Mass that each axle carries; by its share of the train, so that it follows the train's."""
    load = Param("kg", 15625.0, "load of an axle", "W: M by 32 axles", lo=100, hi=5e4)
    if not by_share:
        return [signal_of_copies(load.named("m_axle"), n)]
    share = Param("1", 1 / n, "share of the train that an axle carries", lo=1e-4, hi=1)
    load = Param("kg", "m * share", "load of an axle", lo=100, hi=5e4)
    return [signal_of_copies(s.named(k), n) for k, s in (("share", share), ("m_axle", load))]


def _scattered(T: Any, motors: Sequence[int], n: int) -> Any:
    """Torques of the driven axles at their places among all axles."""
    return ca.sparsity_cast(T, ca.Sparsity.triplet(n, 1, list(motors), [0] * len(motors)))
