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

F_i is one number in both equations, so that with the mean speeds of the step, as an identity,

    change of (M v^2/2 + sum n_i J_i omega_i^2/2) = h (P_drive - P_brake - P_bearing - P_slip - P_d)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from slipctl import BadInput, Block, Input, Output, Param, State, make_block
from slipctl.block import Exprs
from slipctl.replication import widened, with_derived
from slipctl.rooting import bracketed_newton
from slipctl.signals import Signal

FAST = (0, 1)
"""Newton updates in each sweep over the axles, as a rule."""

SAFE = (24, 12, 12, 12)
"""The same where the rule leaves a residual: a new rail, a locking wheel, a wild start."""

TOLERANCE = 1e-9
"""Residual that is left, as a share of the load of an axle."""


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


def rolling(adhesion: Block, axles: Axles, h: float, distinct: Sequence[str] = ()) -> Block:
    """Make the step of body, axles and contact.

    Inputs are the motor torque of each driven axle and the largest brake torque of each axle, held
    over the step. The parameters of the law that its rail conditions set are one per axle.

    Args:
        adhesion: law from ``v_s`` and ``v`` to ``mu``; |mu| <= 1.
        axles: see :class:`Axles`.
        h: step in s.
        distinct: further parameters of the law of which each axle has its own.

    Returns:
        Step with the law as its part ``adh``. Outputs: ``v_s`` is the creep at the start of the
        step, ``F``, ``mu`` and the powers hold over it; a power is that of all axles.
    """
    n, motors = len(axles), axles.motors
    surface = {k for values in adhesion.conditions.values() for k in values}
    own = [f"adh.{k}" for k in with_derived(adhesion, surface | set(distinct))]
    law_params = [s.named(f"adh.{k}") for k, s in adhesion.params.items()]
    law_params = [widened(s, n) if s.name in own else s for s in law_params]

    def each(signal: Signal, name: str, **changes: Any) -> Signal:
        return replace(widened(signal.named(name), n), **changes)

    states = [
        State("m", 0.0, "position of the first axle").named("x"),
        State("m/s", 0.0, "train speed").named("v"),
        each(State("rad/s", "v / r", "speed of an axle"), "omega"),
    ]
    traction, driven = {"positive": "traction"}, len(motors)
    inputs = [
        Input("N m", "largest brake torque of an axle", value=0.0, positive="braking").named("T_b"),
        Input("N", "running resistance", value=0.0, positive="braking").named("F_d"),
    ]
    if motors:
        torque = Input("N m", "torque of a motor, at its axle", value=0.0, **traction)
        inputs.append(widened(torque.named("T"), driven, "driven"))
    source = "Wang 2025, Table 1"
    params = [
        Param("kg", 500e3, "train", source, lo=1e3, hi=1e8).named("M"),
        each(Param("kg", 15625.0, "load of an axle", "M by 32 axles", lo=100, hi=5e4), "W"),
        each(Param("kg m^2", 93.75, "inertia of an axle", source, lo=1, hi=1e4), "J"),
        each(Param("N m s", 0.01, "damping of an axle", source, lo=0, hi=1e3), "B_t"),
        Param("m", 0.445, "wheel radius", source, lo=0.2, hi=1).named("r"),
        Param("m/s^2", 9.8, "gravity", source).named("g"),
        each(Param("1", 1.0, "share of the brake torque that it gets", lo=0, hi=2), "braked"),
        each(Param("1", doc="how many axles are alike"), "count", value=axles.count),
        each(Param("m", doc="place behind the first axle"), "behind", value=axles.behind),
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
        Output("W", "power that the brakes take").named("P_brake"),
        Output("W", "power that the bearings take").named("P_bearing"),
        Output("W", "power that the sliding contacts take").named("P_slip"),
        Output("W", "power that the running resistance takes").named("P_d"),
        Output("N", "largest residual of the step").named("residual"),
    ]
    if motors:
        speed = Output("rad/s", "speed of a driven axle").named("omega_d")
        outputs.append(widened(speed, driven, "driven"))
    settle = _settle(adhesion, own, law_params, n, h)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        v, omega, r, M, count = x["v"], x["omega"], p["r"], p["M"], p["count"]
        T = _scattered(u["T"], motors, n) if motors else 0
        side = ca.if_else(omega == 0, ca.sign(v), ca.sign(omega))
        stop = side * p["braked"] * u["T_b"]
        a = p["J"] / h + p["B_t"]
        free = r / a * (p["J"] / h * omega + T - stop)
        v_s = r * omega - v
        F, locked, residual = settle(
            v_s, v, free, a / r**2, p["W"] * p["g"], ca.sign(stop), count, h / M, u["F_d"],
            *[p[s.name] for s in law_params],
        )  # fmt: skip
        omega_next = ca.if_else(locked, 0, (p["J"] / h * omega + T - stop - r * F) / a)
        F_all = ca.dot(count, F)
        acceleration = (F_all - u["F_d"]) / M
        v_next = v + h * acceleration
        mean, v_mean = (omega + omega_next) / 2, (v + v_next) / 2
        taken = ca.if_else(locked, p["J"] / h * omega + T - r * F, stop)
        outputs = dict(
            v_s=v_s,
            mu=F / (p["W"] * p["g"]),
            F=F,
            F_all=F_all,
            a=acceleration,
            v_s_max=ca.mmax(v_s),
            v_s_min=ca.mmin(v_s),
            F_rim=ca.dot(count, T - taken) / r,
            P_drive=ca.dot(count, T * mean),
            P_brake=ca.dot(count, taken * mean),
            P_bearing=ca.dot(count, p["B_t"] * omega_next * mean),
            P_slip=ca.dot(count, F * (r * mean - v_mean)),
            P_d=u["F_d"] * v_mean,
            residual=residual,
        )
        if motors:
            outputs["omega_d"] = omega[list(motors)]
        return dict(x=x["x"] + h * v_mean, v=v_next, omega=omega_next), outputs

    def rebuild(parts: dict[str, Block]) -> Block:
        return rolling(parts["adh"], axles, h, distinct)

    return make_block(
        "train", "step", body, states=states, inputs=inputs, params=[*params, *law_params],
        outputs=outputs, period=h, sx=False, parts={"adh": adhesion}, rebuild=rebuild,
        prefixed=True, own=own, doc=__doc__ or "",
        conditions={c: {f"adh.{k}": v for k, v in values.items()}
                    for c, values in adhesion.conditions.items()},
        choices={"axles": sum(axles.count), "distinct axles": n},
    )  # fmt: skip


def _scattered(T: Any, motors: Sequence[int], n: int) -> Any:
    """Torques of the driven axles at their places among all axles."""
    return ca.sparsity_cast(T, ca.Sparsity.triplet(n, 1, list(motors), [0] * len(motors)))


def _axle(adhesion: Block, names: Sequence[str], updates: int) -> ca.Function:
    """Creep of one axle for a given speed of the train at the end of the step.

    Results: creep, contact force, whether the brake holds the wheel, residual, the force that a
    last Newton step would give, and how much it falls with that speed.
    """
    s0, v_next, v, free, k, N, hold = (ca.SX.sym(name) for name in
                                       ("s0", "v_next", "v", "free", "k", "N", "hold"))  # fmt: skip
    values = [ca.SX.sym(name.replace(".", "_")) for name in names]
    p = dict(zip(adhesion.params, values, strict=True))
    z = ca.SX.sym("z")
    mu = adhesion.expr({}, {"v_s": z, "v": v}, p)[1]["mu"]
    curve = ca.Function("curve", [z, v, *values], [mu, ca.gradient(mu, z)], {"cse": True})
    beta, reach = free - v_next, N / k

    def residual(s: Any) -> tuple[Any, Any]:
        height, slope = curve(s, v, *values)
        return k * (s - beta) + N * height, k + N * slope

    lo, hi = beta - reach, beta + reach
    s = bracketed_newton(residual, ca.fmin(ca.fmax(s0, lo), hi), lo, hi, updates)
    # a wheel that stands has the creep -v+; the brake cannot push it beyond
    locked = hold * s < -hold * v_next
    s = ca.if_else(locked, -v_next, s)
    height, slope = curve(s, v, *values)
    slope = ca.fmax(slope, 0) * N
    fall = ca.if_else(locked, slope, k * slope / (k + slope))
    left = ca.if_else(locked, 0, k * (s - beta) + N * height)
    expected = N * height - left * slope / (k + slope)
    inputs = [s0, v_next, v, free, k, N, hold, *values]
    results = [s, N * height, locked, ca.fabs(left), expected, fall]
    return ca.Function(f"axle_{updates}", inputs, results, {"cse": True})


def _settle(
    adhesion: Block, own: Sequence[str], law_params: Sequence[Signal], n: int, h: float
) -> ca.Function:
    """Contact forces of all axles, settled with the train's speed at the end of the step."""
    names = [s.name for s in law_params]
    v_s, free, k, N, hold, count = (ca.MX.sym(name, n) for name in
                                    ("v_s", "free", "k", "N", "hold", "count"))  # fmt: skip
    v, by_mass, F_d = (ca.MX.sym(name) for name in ("v", "by_mass", "F_d"))
    values = [ca.MX.sym(s.name.replace(".", "_"), s.size) for s in law_params]
    once = [1, 2, *(7 + j for j, name in enumerate(names) if name not in own)]
    given = [v_s, v, free, k, N, hold, count, by_mass, F_d, *values]

    def sweeps(updates: Sequence[int]) -> list[Any]:
        s, v_next = v_s, v
        for j, m in enumerate(updates):
            axle = _axle(adhesion, names, m)
            copies = axle.map(f"{axle.name()}_x{n}", "serial", n, once, [])
            rows = [s, v_next, v, free, k, N, hold, *values]
            found = copies.call([row if i in once else row.T for i, row in enumerate(rows)])
            s, F, locked, left, expected, fall = (row.T for row in found)
            if j < len(updates) - 1:
                error = v + by_mass * (ca.dot(count, expected) - F_d) - v_next
                v_next = v_next + error / (1 + by_mass * ca.dot(count, fall))
        error = v + by_mass * (ca.dot(count, F) - F_d) - v_next
        worst = ca.fmax(ca.mmax(left), ca.mmax(k) * ca.fabs(error))
        return [F, locked, worst]

    fast = ca.Function("fast", given, sweeps(FAST))
    safe = ca.Function("safe", given, sweeps(SAFE))
    kept = [ca.MX.sym(f"kept{j}", fast.size1_out(j)) for j in range(3)]
    again = ca.Function("again", [*given, *kept], safe.call(given))
    keep = ca.Function("keep", [*given, *kept], kept)
    choose = ca.Function.if_else("settled", again, keep)
    found = fast.call(given)
    due = found[2] > TOLERANCE * ca.mmax(N)
    return ca.Function("settle", given, choose.call([due, *given, *found]))
