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

    F_d - M v/h = sum n_i F_i,   |r F_i - J omega_i/h - T_i| <= T_b,i,   |F_i| <= max mu_i N_i

and the step as above where not. So v is 0 exactly, and the train starts again when more is asked of
brake or rail than they carry. A wheel that is locked slides on all of its patch, however slowly. So
it has the largest adhesion where the train is slower than the slip of the peak, or as much less as
its brake takes.

F_i is one number in both equations, so that with the mean speeds of the step, as an identity,

    change of (M v^2/2 + sum n_i J_i omega_i^2/2) = h (P_drive - P_brake - P_bearing - P_slip - P_d)

A law may have inputs beside v_s and v: what the rail under each axle is like, see
models/wheel_rail/rail_memory.py. Then the train tells the heat of each contact and the way of the
step, of which a rail that remembers makes its next state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, State, make_block
from slipctl.analysis.roots import bracketed_newton
from slipctl.block.block import Exprs
from slipctl.block.signals import Signal
from slipctl.block.transforms.replication import signal_of_copies, with_derived
from slipctl.errors import refuse_unknown_choice
from slipctl.models.wheel_rail.contact import check_patch

STAGES = ((0, 0), (0, 0), (3, 3, 3), (24, 24, 24, 24, 24, 24))
"""Newton updates of each axle in each sweep over the axles, beside the one between two sweeps. A
stage is computed only where the one before left a residual; the last one starts anew."""

TOLERANCE = 1e-7
"""Residual that a stage may leave, as a share of the load of an axle."""

PEAKS = tuple(float(s) for s in np.geomspace(1e-3, 5.0, 40))
"""Creeps in m/s among which the peak of the law is sought, for trains slower than the last one."""


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
    n, motors = len(axles), axles.motors
    surface = {k for values in adhesion.conditions.values() for k in values}
    own = [f"adh.{k}" for k in with_derived(adhesion, surface | set(distinct))]
    law_params = [s.named(f"adh.{k}") for k, s in adhesion.params.items()]
    law_params = [signal_of_copies(s, n) if s.name in own else s for s in law_params]
    beside = [signal_of_copies(s, n) for k, s in adhesion.inputs.items() if k not in ("v_s", "v")]
    law_given = [*law_params, *beside]
    apart_in_law = (*own, *(s.name for s in beside))

    def each(signal: Signal, name: str, **changes: Any) -> Signal:
        return replace(signal_of_copies(signal.named(name), n), **changes)

    states = [
        State("m", 0.0, "position of the first axle", lo=-1e7, hi=1e7).named("x"),
        State("m/s", 0.0, "train speed", lo=-1, hi=200).named("v"),
        each(State("rad/s", "v / r", "speed of an axle", lo=-1e4, hi=1e4), "omega"),
    ]
    traction, driven = {"positive": "traction"}, len(motors)
    stopping = Input("N m", "largest brake torque of an axle", value=0.0, positive="braking")
    inputs = [
        each(stopping, "T_b") if "T_b" in apart else stopping.named("T_b"),
        Input("N", "running resistance", value=0.0, positive="braking").named("F_d"),
    ]
    inputs += beside
    if "dN" in apart:
        inputs.append(each(Input("N", "load that moves onto an axle", value=0.0), "dN"))
    if motors:
        torque = Input("N m", "torque of a motor, at its axle", value=0.0, **traction)
        inputs.append(signal_of_copies(torque.named("T"), driven, "driven"))
    source = "Wang 2025, Table 1"
    radius = Param("m", 0.445, "wheel radius", source, lo=0.2, hi=1)
    params = [
        Param("kg", 500e3, "train", source, lo=1e3, hi=1e8).named("m"),
        *_carried(n, "share" in apart),
        each(Param("kg m^2", 93.75, "inertia of an axle", source, lo=1, hi=1e4), "J"),
        each(Param("N m s", 0.01, "damping of an axle", source, lo=0, hi=1e3), "B_t"),
        each(radius, "r") if "r" in apart else radius.named("r"),
        Param("m/s^2", 9.8, "gravity", source, lo=1, hi=30).named("g"),
        each(Param("1", 1.0, "share of the brake torque that it gets", lo=0, hi=2), "braked"),
        each(
            Param("1", doc="how many axles are alike", lo=-1e6, hi=1e6), "count", value=axles.count
        ),
        each(
            Param("m", doc="place behind the first axle", lo=-1e6, hi=1e6),
            "behind",
            value=axles.behind,
        ),
    ]
    outputs = [
        each(Output("m/s", "creep, rim minus train", per="speed", **traction), "v_s"),
        each(Output("1", "adhesion coefficient", **traction), "mu"),
        each(Output("N", "contact force of an axle", **traction), "F"),
        Output("N", "contact force of all axles", **traction).named("F_all"),
        Output("m/s^2", "acceleration of the train", **traction).named("a"),
        Output("m/s", "largest creep of an axle", per="speed", **traction).named("v_s_max"),
        Output("m/s", "smallest creep of an axle", per="speed", **traction).named("v_s_min"),
        Output("N", "force of motors and brakes at the rims", **traction).named("F_rim"),
        Output("W", "power of the motors").named("P_drive"),
        Output("W", "power that the brakes take", lo=0).named("P_brake"),
        Output("W", "power that the bearings take", lo=0).named("P_bearing"),
        Output("W", "power that the sliding contacts take", lo=0).named("P_slip"),
        Output("W", "power that running resistance and gradient take").named("P_d"),
        Output("N", "largest residual of the step", lo=0, hi=LEFT).named("residual"),
    ]
    if motors:
        speed = Output("rad/s", "speed of a driven axle").named("omega_d")
        outputs.append(signal_of_copies(speed, driven, "driven"))
    if beside:
        outputs += [
            each(Output("W", "power that the contact of an axle takes"), "P_contact"),
            Output("m", "way of this step").named("way"),
            each(Output("m", "place of an axle"), "at"),
        ]
    settle = adhesion.of_equations(
        ("settle", n, h, apart_in_law, standing),
        lambda: _settle(adhesion, apart_in_law, law_given, n, h, standing),
    )
    peaks = adhesion.of_equations(
        ("peaks", n, apart_in_law), lambda: _peaks(adhesion, apart_in_law, law_given, n)
    ) if standing else None  # fmt: skip

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v, omega, r, m, count = x["v"], x["omega"], p["r"], p["m"], p["count"]
        T = _scattered(u["T"], motors, n) if motors else 0
        side, push = ca.sign(v), (p["J"] / h * omega + T) / r
        if standing:  # the way that a standing train would go
            side = ca.if_else(v == 0, ca.sign(ca.dot(count, push) - u["F_d"]), side)
        side = ca.if_else(omega == 0, side, ca.sign(omega))
        stop = side * p["braked"] * u["T_b"]
        a = p["J"] / h + p["B_t"]
        free = r / a * (p["J"] / h * omega + T - stop)
        v_s = r * omega - v
        N, law = p["m_axle"] * p["g"], [p[s.name] for s in law_params]
        law += [u[s.name] for s in beside]
        N = ca.fmax(N + u["dN"], 1) if "dN" in apart else N
        near = ca.mmin(side * free - N * r**2 / a) <= 0  # its creep may be that of a locked one
        at, height = peaks(near, v, *law) if peaks is not None else ([], [])
        F, locked, residual = settle(
            v_s, v, free, a / r**2, N, ca.sign(stop), count, h / m, u["F_d"],
            *([at] if standing else []), *law,
        )  # fmt: skip
        stands: Any = False
        if standing:
            hold = p["braked"] * u["T_b"] / r
            stands, F_stand = _stand(push, hold, height * N, u["F_d"] - m * v / h, count)
            F, locked = ca.if_else(stands, F_stand, F), ca.if_else(stands, 1, locked)
            residual = ca.if_else(stands, 0, residual)
        omega_next = ca.if_else(locked, 0, (p["J"] / h * omega + T - stop - r * F) / a)
        F_all = ca.dot(count, F)
        acceleration = (F_all - u["F_d"]) / m
        if standing:
            acceleration = ca.if_else(stands, -v / h, acceleration)
        v_next = v + h * acceleration
        if standing:
            v_next = ca.if_else(stands, 0, v_next)
        mean, v_mean = (omega + omega_next) / 2, (v + v_next) / 2
        taken = ca.if_else(locked, p["J"] / h * omega + T - r * F, stop)
        outputs = dict(
            v_s=v_s,
            mu=F / N,
            F=F,
            F_all=F_all,
            a=acceleration,
            v_s_max=ca.mmax(v_s),
            v_s_min=ca.mmin(v_s),
            F_rim=ca.dot(count, (T - taken) / r) if "r" in apart else ca.dot(count, T - taken) / r,
            P_drive=ca.dot(count, T * mean),
            P_brake=ca.dot(count, taken * mean),
            P_bearing=ca.dot(count, p["B_t"] * omega_next * mean),
            P_slip=ca.dot(count, F * (r * mean - v_mean)),
            P_d=u["F_d"] * v_mean,
            residual=residual,
        )
        if motors:
            outputs["omega_d"] = omega[list(motors)]
        if beside:
            outputs |= {"P_contact": count * F * (r * mean - v_mean), "way": h * v_mean}
            outputs["at"] = x["x"] - p["behind"]
        return dict(x=x["x"] + h * v_mean, v=v_next, omega=omega_next), outputs

    def rebuild(parts: dict[str, Block]) -> Block:
        return rolling(parts["adh"], axles, h, distinct, apart, standing)

    def guard(p: Mapping[str, Any]) -> None:
        """Refuse a law that knows another wheel."""
        law = {k: p[f"adh.{k}"] for k in adhesion.params if f"adh.{k}" in p}
        if {"m_axle", "g", "r"} <= set(p):
            check_patch(law, np.asarray(p["m_axle"]) * p["g"] / 2, p["r"])

    return make_block(
        "train", "step", body, states=states, inputs=inputs, params=[*params, *law_params],
        outputs=outputs, period=h, sx=False, parts={"adh": adhesion}, rebuild=rebuild,
        prefixed=True, own=own, by_structure=True, doc=__doc__ or "",
        conditions={c: {f"adh.{k}": v for k, v in values.items()}
                    for c, values in adhesion.conditions.items()},
        choices={"axles": sum(axles.count), "distinct axles": n}
        | ({"standing": True} if standing else {}), guard=guard,
    )  # fmt: skip


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


def _stand(push: Any, hold: Any, most: Any, need: Any, count: Any) -> tuple[Any, Any]:
    """Whether all axles and the train can stand at the end of the step, and the forces that do it.

    Args:
        push: force of each axle that stops it without its brake.
        hold: what the brake of each can take, at the rim.
        most: what the rail under each carries.
        need: force of all that stops the train.
        count: how many axles are alike.
    """
    lo, hi = ca.fmax(push - hold, -most), ca.fmin(push + hold, most)
    least, largest = ca.dot(count, lo), ca.dot(count, hi)
    stands = ca.logic_and(ca.mmin(hi - lo) >= 0, ca.logic_and(least <= need, need <= largest))
    share = (need - least) / ca.fmax(largest - least, 1e-300)
    return stands, lo + ca.fmax(0, ca.fmin(share, 1)) * (hi - lo)


def _adhesion(law: Block, v_s: Any, v: Any, values: Sequence[Any]) -> Any:
    """Adhesion of a law at a creep, with the values of its parameters and of its other inputs."""
    p = dict(zip(law.params, values, strict=False))
    others = [k for k in law.inputs if k not in ("v_s", "v")]
    u = dict(zip(others, values[len(p) :], strict=True))
    return law.expr({}, {"v_s": v_s, "v": v, **u}, p)[1]["mu"]


def _peaks(
    adhesion: Block, own: Sequence[str], law_params: Sequence[Signal], n: int
) -> ca.Function:
    """Creep and height of the largest adhesion under each axle, where they can be needed; else 0.

    They are needed of a slow train of which a wheel is ``near`` its stand.
    """
    names = [s.name for s in law_params]
    v = ca.SX.sym("v")
    values = [ca.SX.sym(name) for name in names]
    best, height = ca.SX(PEAKS[0]), ca.SX(0)
    for s in PEAKS:
        mu = ca.fabs(_adhesion(adhesion, ca.SX(s), v, values))
        best, height = ca.if_else(mu > height, s, best), ca.fmax(mu, height)
    one = ca.Function("peak", [v, *values], [best, height], {"cse": True})
    once = [0, *(1 + j for j, name in enumerate(names) if name not in own)]
    each = one.map(f"peak_x{n}", "serial", n, once, [])
    v_m, near = ca.MX.sym("v"), ca.MX.sym("near")
    given = [v_m, *(ca.MX.sym(s.name.replace(".", "_"), s.size) for s in law_params)]
    found = each.call([row if i in once else row.T for i, row in enumerate(given)])
    slow = ca.Function("slow", given, [row.T for row in found])
    fast = ca.Function("fast", given, [ca.MX.zeros(n), ca.MX.zeros(n)])
    due = ca.Function.if_else("peaks", slow, fast)
    needed = ca.logic_and(near, ca.fabs(v_m) < PEAKS[-1])
    return ca.Function("peaks_of", [near, *given], due.call([needed, *given]))


def _axle(adhesion: Block, names: Sequence[str], standing: bool = False) -> dict[int, ca.Function]:
    """Creep of one axle for a given speed of the train at the end of the step, by Newton updates.

    Results: contact force, whether the brake holds the wheel, residual. Then creep and force after
    one more Newton step, the share of a change of that speed by which the creep falls, and the
    force.
    """
    z = ca.SX.sym("z")
    q = v_next, v, free, k, N, hold, *values = [
        ca.SX.sym(n)
        for n in ("v_next", "v", "free", "k", "N", "hold", *(["peak"] * standing), *names)
    ]
    peak = values.pop(0) if standing else None
    mu = _adhesion(adhesion, z, v, values)
    curve = ca.Function("curve", [z, *q], [mu, ca.gradient(mu, z)], {"cse": True})
    beta, reach = free - v_next, N / k
    lo, hi = beta - reach, beta + reach

    start = ca.fmin(ca.fmax(z, lo), hi)
    # a wheel that stands has the creep -v+; the brake cannot push it beyond
    locked = hold * start < -hold * v_next
    s = ca.if_else(locked, -v_next, start)
    slides = s
    if peak is not None:  # all of the patch of a locked wheel slides, however slow it is
        slides = ca.if_else(locked, -ca.sign(v_next) * ca.fmax(ca.fabs(v_next), peak), s)
    height, slope = curve(slides, *q)
    F, slope = N * height, N * ca.fmax(slope, 0)
    if peak is not None:  # as much as its brake takes
        most = k * free
        F = ca.if_else(locked, ca.if_else(hold > 0, ca.fmax(F, most), ca.fmin(F, most)), F)
        slope = ca.if_else(locked, 0, slope)
    left = ca.if_else(locked, 0, k * (s - beta) + F)
    move, slide = -left / (k + slope), ca.if_else(locked, 1, k / (k + slope))
    results = [F, locked, ca.fabs(left), s + move, F + slope * move, slide, slope * slide]
    found = {0: ca.Function("axle_0", [z, *q], results, {"cse": True})}
    height, slope = curve(z, *q)
    equation = [k * (z - beta) + N * height, k + N * slope]
    residual = ca.Function("residual", [z, ca.vertcat(*q)], equation, {"cse": True})
    numbers = sorted({m for stage in STAGES for m in stage} - {0})
    inputs = s0, v_next, _, free, k, N, *_ = [ca.MX.sym(f"i{j}") for j in range(1 + len(q))]
    lo, hi = free - v_next - N / k, free - v_next + N / k
    for m, newton in zip(numbers, bracketed_newton(residual, *numbers), strict=True):
        s = newton(ca.fmin(ca.fmax(s0, lo), hi), lo, hi, ca.vertcat(*inputs[1:]))
        found[m] = ca.Function(f"axle_{m}", inputs, found[0].call([s, *inputs[1:]]))
    return found


def _settle(
    adhesion: Block,
    own: Sequence[str],
    law_params: Sequence[Signal],
    n: int,
    h: float,
    standing: bool,
) -> ca.Function:
    """Contact forces of all axles, settled with the train's speed at the end of the step."""
    names = [s.name for s in law_params]
    v_s, free, k, N, hold, count = (ca.MX.sym(name, n) for name in
                                    ("v_s", "free", "k", "N", "hold", "count"))  # fmt: skip
    v, by_mass, F_d = (ca.MX.sym(name) for name in ("v", "by_mass", "F_d"))
    values = [ca.MX.sym(s.name.replace(".", "_"), s.size) for s in law_params]
    peak = [ca.MX.sym("peak", n)] if standing else []
    given = [v_s, v, free, k, N, hold, count, by_mass, F_d, *peak, *values]
    first = 7 + len(peak)
    once = [1, 2, *(first + j for j, name in enumerate(names) if name not in own)]
    axles = {
        m: f.map(f"{f.name()}_x{n}", "serial", n, once, [])
        for m, f in _axle(adhesion, names, standing).items()
    }

    def sweeps(updates: Sequence[int], s: Any, v_next: Any) -> list[Any]:
        F = locked = worst = None
        for m in updates:
            rows = [s, v_next, v, free, k, N, hold, *peak, *values]
            found = axles[m].call([row if i in once else row.T for i, row in enumerate(rows)])
            F, locked, left, s, expected, slide, fall = (row.T for row in found)
            error = v + by_mass * (ca.dot(count, F) - F_d) - v_next
            worst = ca.fmax(ca.mmax(left), ca.mmax(k) * ca.fabs(error))
            error = v + by_mass * (ca.dot(count, expected) - F_d) - v_next
            change = error / (1 + by_mass * ca.dot(count, fall))
            s, v_next = s - slide * change, v_next + change
        return [s, v_next, F, locked, worst]

    def stage(j: int) -> ca.Function:
        """Results so far, and the next stages where these are not settled."""
        so_far = [ca.MX.sym(f"r{i}", size) for i, size in enumerate((n, 1, n, n, 1))]
        last = j == len(STAGES) - 1
        found = sweeps(STAGES[j], *((v_s, v) if last else so_far[:2]))
        more = ca.Function(f"stage{j}", [*given, *so_far], following(j + 1, found))
        keep = ca.Function("keep", [*given, *so_far], so_far)
        return ca.Function.if_else(f"stage{j}_due", more, keep)

    def following(j: int, found: list[Any]) -> list[Any]:
        if j == len(STAGES):
            return found
        due = found[-1] > TOLERANCE * ca.mmax(N)
        return stage(j).call([due, *given, *found])

    settled = following(1, sweeps(STAGES[0], v_s, v))
    return ca.Function("settle", given, settled[2:])
