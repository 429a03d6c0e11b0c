"""The plant of a trip: axles on the rail, what turns or brakes them, resistance and gradient.

    x' = v,   M v' = sum_i F_i - F_R(v) - M g slope
    J omega_i' = T_i - T_b,i sign(omega_i) - r_i F_i
    F_i = mu(v_s,i) N_i,   v_s,i = r_i omega_i - v

The wheels' step is in models/wheel_rail/axles.py. Between the parts torque and slip are those of a
braked wheel; a driven one is seen in the mirror, see models/common_form.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from casadi import fabs, fmax, fmin, if_else, sign

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    connect,
    flip_sign,
    law,
    make_block,
    mirror,
    replicate,
    sampled,
)
from slipctl.block.units.unit_algebra import read_unit
from slipctl.models.brakes import brake, brake_gain, dynamic_brake, sum_of_torques, track_brake
from slipctl.models.common_form import T_S
from slipctl.models.shared_names import SLOPE
from slipctl.models.vehicle.air.pneumatics import cylinder, magnet_valves, reservoir
from slipctl.models.vehicle.cars import (
    load_transfer,
    masses_of_axles,
    pads_of_axles,
    wheelset_that_twists,
)
from slipctl.models.vehicle.parts import Actuator, Air, Lag, Valve, Vehicle
from slipctl.models.wheel_rail.axles import Axles, rolling
from slipctl.models.wheel_rail.twisting_wheelsets import law_on_two_wheels, train_that_twists
from slipctl.models.zhang_2021.ep_valve import air_brake, dead_time, ep_valve

ADDED = "of the vehicle"

IN_UNITS = {"v_s": "m/s", "lam": "1", "v": "m/s", "mu": "1"}
"""Units in which an adhesion law takes and gives what the wheels have."""


def on_train(adhesion: Block) -> Block:
    """Law as a train takes it: from creep and train speed to mu, odd in the creep.

    Args:
        adhesion: law from ``v_s`` (with ``v`` or without) or ``lam``, for either sign convention.
            One that takes ``v_s`` and ``v`` in traction is such a law already.

    Raises:
        BadInput: a law with other inputs, outputs or units, or whose equations are none.
    """
    inputs = adhesion.inputs
    slip = "lam" if "lam" in inputs else "v_s"
    if slip not in inputs or not set(inputs) <= {slip, "v"} or "mu" not in adhesion.outputs:
        raise BadInput(
            f"{adhesion.name} has the inputs {', '.join(inputs)}; an adhesion law has v_s or lam,"
            " and v where it needs the speed, and gives mu"
        )
    taken = {**inputs, "mu": adhesion.outputs["mu"]}
    for name, meant in IN_UNITS.items():
        if name in taken and not read_unit(name, taken[name].unit).same(read_unit(name, meant)):
            raise BadInput(
                f"{adhesion.name}: {name} is in [{taken[name].unit}], wheels have it in [{meant}];"
                f" declare {name} in [{meant}] and convert it in the law"
            )
    _ = adhesion.f  # says what is wrong with its equations
    if set(inputs) == {"v_s", "v"} and inputs["v_s"].positive == "traction":
        return adhesion
    source, meant_to = adhesion, adhesion.law_data.meant_to
    if meant_to is None and np.isfinite(inputs[slip].hi):  # its range says it too
        meant_to = inputs[slip].hi
    turn = 1 if inputs[slip].positive == source.outputs["mu"].positive else -1

    def body(x: Any, u: Any, p: Any) -> Any:
        s, speed = fabs(u["v_s"]), fabs(u["v"])
        if slip == "lam":
            s = s / fmax(speed, p["v_least"])
        given = {slip: s} | ({"v": speed} if "v" in inputs else {})
        own = {k: p[k] for k in source.params}
        height = turn * source.expr({}, given, own)[1]["mu"]
        return {}, {"mu": if_else(u["v_s"] >= 0, height, -height)}

    params = list(source.params.values())
    if slip == "lam":
        least = Param("m/s", 1.0, "least speed in the ratio", ADDED, lo=1e-3)
        params.append(least.named("v_least"))
    return make_block(
        source.name, "law", body,
        inputs=[
            Input("m/s", "creep, rim minus train", positive="traction", per="speed").named("v_s"),
            Input("m/s", "train speed").named("v"),
        ],
        params=params,
        outputs=[Output("1", "adhesion coefficient", positive="traction").named("mu")],
        conditions=source.conditions, sx=source.sx, choices=source.choices,
        doc=f"{source.doc}\n\nOdd in the creep, traction positive.",
        measured_to=source.law_data.measured_to, meant_to=meant_to,
    )  # fmt: skip


@law(F_d=Output("N", "running resistance and gradient", positive="braking"))
def with_gradient(
    F_R=Input("N", "running resistance"),
    m=Param("kg", 40e3, "vehicle", ADDED, lo=100, hi=1e8),
    g=Param("m/s^2", 9.81, "gravity", ADDED),
    slope=SLOPE,
):
    """F_d = F_R + m g slope."""
    return F_R + m * g * slope


@law(
    F_R=Output("N", "resistance to motion", positive="braking"),
    F_h=Output("N", "largest resistance of a train that stands"),
    name="davis",
)
def running_resistance(
    v=Input("m/s", "train speed"),
    c0=Param("N", 0.0, "constant part", ADDED, lo=0, hi=1e6),
    c1=Param("N s/m", 0.0, "linear part", ADDED, lo=0, hi=1e6),
    c2=Param("N s^2/m^2", 0.0, "quadratic part", ADDED, lo=0, hi=1e6),
):
    """Davis resistance against the motion, forward or back; at a stand it holds up to c0."""
    return dict(F_R=sign(v) * (c0 + c1 * fabs(v) + c2 * v**2), F_h=c0)


def valve_brake() -> Block:
    """Air brake behind its valve, from ``T_cmd`` to ``T_b``, both braking positive."""
    wires = {
        "turn.u": "T_cmd",
        "valve.T_cmd": "turn.y",
        "valve.T_b": "cylinder.T_b",
        "cylinder.position": "valve.position",
        "back.u": "cylinder.T_b",
        "T_b": "back.y",
    }
    return connect(
        "act", wires, share={"theta": "*.theta", "P_max": "*.P_max"},
        turn=flip_sign("N m", "traction"), valve=ep_valve,
        cylinder=sampled(air_brake("valve"), T_S, "rk4"), back=flip_sign("N m", "braking"),
    )  # fmt: skip


def actuator(part: Actuator) -> Block:
    """Actuator of one axle, from ``T_cmd`` to ``T_b``, with the numbers of the part."""
    if isinstance(part, Valve):
        P_max = 600e3
        block = valve_brake().with_params(
            **{"theta": -part.torque / P_max, "P_max": P_max, "valve.band": part.band * P_max,
               "cylinder.tau_f": part.fill, "cylinder.tau_v": part.vent}
        )  # fmt: skip
    else:
        numbers = {"T_max": part.torque, "tau": part.lag}
        if part.rate is not None:
            numbers["R_max"] = part.rate
        block = sampled(brake(lag=True, rate=part.rate is not None), T_S, "rk4")
        block = block.with_params(**numbers)
    ticks, gain = round(part.dead_time / T_S), getattr(part, "gain", 1.0)
    before = {"wait": dead_time(ticks, "N m", "braking")} if ticks else {}
    if gain != 1.0:
        before["gain"] = brake_gain.with_params(k=gain)
    if not before:
        return block
    wires, last = {"T_b": "act.T_b"}, "T_cmd"
    for name, one in before.items():
        wires[f"{name}.{next(iter(one.inputs))}"] = last
        last = f"{name}.{next(iter(one.outputs))}"
    names = [k for k in ("T_max", "tau", "R_max", "theta", "P_max") if k in block.params]
    inner = {k: f"act.{k}" for k in names}
    return connect("act", wires | {"act.T_cmd": last}, share=inner, **before, act=block)


def air_brake_of_axle(part: Air, mass: float) -> Block:
    """Air brake of one axle, from the bits ``hold`` and ``vent`` and the demand to ``T_b``.

    Args:
        part: numbers of the brake. mass: of the vehicle in kg.
    """
    k_f, k_v = part.rates
    valves = magnet_valves(round(part.dead_time / T_S)).with_params(pulse=part.pulse)
    numbers = {"k_f": k_f, "k_v": k_v, "V": part.volume, "T_max": part.torque,
               "p_full": part.pressure, "weighed": (part.weighed or mass) / mass}  # fmt: skip
    wires = {
        "valves.hold": "hold", "valves.vent": "vent", "cylinder.hold": "valves.hold",
        "cylinder.vent": "valves.vent", "cylinder.T_demand": "T_demand",
        "cylinder.supply": "supply", "T_b": "cylinder.T_b", "pressure": "cylinder.pressure",
        "drawn": "cylinder.drawn", "switched": "valves.switched",
    }  # fmt: skip
    return connect("act", wires, share={"T_max": ["cylinder.T_max"], "T": "*.T"}, valves=valves,
                   cylinder=cylinder.with_params(**numbers))  # fmt: skip


def _air(part: Air, vehicle: Vehicle, many: int) -> tuple[dict[str, Block], dict[str, str]]:
    """Air brakes of all axles, with the air of the vehicle, and their wires.

    Where motors brake too, the demand of each axle is what they leave of it.
    """
    one, each = air_brake_of_axle(part, vehicle.total), vehicle.dynamic_brake is not None
    numbers = {"p_s": part.supply, "p_start": part.reserve or part.supply, "charge": part.charge}
    if part.reservoir is not None:
        numbers["V_r"] = part.reservoir
    parts = {
        "act": replicate(one, many, ["supply"] if each else ["T_demand", "supply"]),
        "air": reservoir(many).with_params(**numbers),
    }
    ticks, demand = round(part.reaction / T_S), "motors.T_f" if each else "T_demand"
    wires = {"act.hold": "hold", "act.vent": "vent", "act.supply": "air.supply",
             "air.drawn": "act.drawn", "pressure": "act.pressure"}  # fmt: skip
    if ticks:
        waits = dead_time(ticks, "N m", "braking")
        parts["reaction"] = replicate(waits, many) if each else waits
        wires["reaction.u"], demand = demand, "reaction.y"
    return parts, wires | {"act.T_demand": demand}


def _motors(vehicle: Vehicle, air: bool) -> tuple[dict[str, Block], dict[str, str]]:
    """Motors that brake first, and their wires; those of axles without one have no torque."""
    part, n = vehicle.dynamic_brake, vehicle.axles
    assert part is not None
    tops: Any = np.array([part.torque * (k in (part.axles or range(1, n + 1)))
                          for k in range(1, n + 1)])  # fmt: skip
    own = {"T_top": tops, "r": np.array(vehicle.radii)}
    own = {k: v if len(set(v)) > 1 else float(v[0]) for k, v in own.items()}
    given = {"P_top": part.power, "lost": part.lost}
    one = dynamic_brake.with_params(
        tau_e=part.lag, v_full=part.fades_from, v_gone=part.fades_to, pause=part.pause,
        **{k: v for k, v in given.items() if v is not None},
    )  # fmt: skip
    distinct = [k for k, v in own.items() if not isinstance(v, float)]
    motors = replicate(one, n, ["T_cmd"] if air else ["hold", "vent"], distinct)
    wires = {"motors.T_cmd": "T_demand" if air else "T_cmd", "motors.omega": "train.omega"}
    if air:
        wires |= {"motors.hold": "hold", "motors.vent": "vent"}
    both = {"sum": replicate(sum_of_torques, n), "motors": motors.with_params(**own)}
    return both, wires | {"sum.T_e": "motors.T_e"}


def motor_limit(part: Lag, radius: float) -> Block:
    """Make the limit of a motor, or of an electric brake, over the speed of its wheel.

    Args:
        part: actuator with a largest power, a largest rim speed, or both.
        radius: of the wheel in m.
    """
    power = part.power if part.power is not None else 1e8
    top = part.top / radius if part.top is not None else 1e4

    @law(T_m=Output("N m", "torque that the motor gives", positive="braking"), name="motor_limit")
    def limit(
        T=Input("N m", "torque that is asked of it", positive="braking"),
        omega=Input("rad/s", "wheel speed"),
        P_max=Param("W", power, "largest power", "of the vehicle", lo=1, hi=1e9),
        omega_top=Param("rad/s", top, "speed above which it gives nothing", "of the vehicle",
                        lo=0.1, hi=1e6),
        omega_0=Param("rad/s", 1e-3, "speed below which power limits nothing", ADDED, lo=1e-6),
    ):  # fmt: skip
        """T_m = min(T, P_max/|omega|), and 0 above omega_top."""
        most = P_max / fmax(fabs(omega), omega_0)
        return if_else(fabs(omega) > omega_top, 0, fmin(T, most))

    return limit


def _train(vehicle: Vehicle, law_: Block) -> Block:
    """Axles in one train on the rail; law_ as a train takes it."""
    worked, driven, n = vehicle.worked, vehicle.mode == "drive", vehicle.axles
    apart = ["T_b"] * (not driven) + ["r"] * (len(set(vehicle.radii)) > 1)
    apart += ["share"] * (len(set(vehicle.carried)) > 1) + ["dN"] * any(vehicle.moved)
    axles = Axles((1,) * n, vehicle.behind, tuple(driven and k in worked for k in range(n)))
    r: Any = np.array(vehicle.radii) if "r" in apart else vehicle.wheel_radius
    twists = wheelset_that_twists(vehicle)
    law_ = law_on_two_wheels(law_) if twists else law_
    train = rolling(law_, axles, T_S, apart=apart, standing=True).with_params(
        m=vehicle.total, r=r, **masses_of_axles(vehicle), g=vehicle.gravity, B_t=0.0,
        v=vehicle.speed,
    )  # fmt: skip
    return train_that_twists(train, twists, worked) if twists else train


def plant(vehicle: Vehicle, part: Actuator, adhesion: Block, field: Block | None = None) -> Block:
    """Connect actuators, axles, resistance and contact.

    Its input is ``T_cmd``, the command of each axle that has an actuator, seen as a braked one.
    With air brakes it is the bits ``hold`` and ``vent`` of each axle, and ``T_demand``, the torque
    that is demanded of one. It gives ``T``, the torque of each of them, and ``omega``, their
    speeds.

    Args:
        vehicle: numbers of the vehicle.
        part: actuator of an axle.
        adhesion: law of the rail.
        field: what the rail under each axle is like, where it remembers; see
            ``slipctl.models.wheel_rail.rail_memory``.
    """
    worked, driven = vehicle.worked, vehicle.mode == "drive"
    many, moves = len(worked), any(vehicle.moved)
    brakes, commands = ({"act": replicate(actuator(part), many)}, {"act.T_cmd": "T_cmd"}) if (
        not isinstance(part, Air)) else _air(part, vehicle, many)  # fmt: skip
    drag = zip(("c0", "c1", "c2"), vehicle.resistance.of(vehicle.total), strict=True)
    parts = {
        **brakes,
        "res": running_resistance.with_params(**dict(drag)),
        "grade": with_gradient.with_params(m=vehicle.total, g=vehicle.gravity),
        "train": _train(vehicle, adhesion if field is not None else on_train(adhesion)),
    }
    torque = "act.T_b"
    wires = {
        **commands,
        "res.v": "train.v",
        "grade.F_R": "res.F_R",
        "train.F_d": "grade.F_d",
        "train.F_m": "res.F_R",
        "train.F_h": "res.F_h",
        "T": torque,
        "omega": "train.omega_d" if driven else "train.omega",
    }
    if vehicle.track_brake is not None:
        parts["magnets"] = track_brake.with_params(**vars(vehicle.track_brake))
        wires |= {"magnets.F_R": "res.F_R", "magnets.v": "train.v", "grade.F_R": "magnets.F_B"}
    if isinstance(part, Lag) and (part.power is not None or part.top is not None):
        parts["limit"] = replicate(motor_limit(part, vehicle.wheel_radius), many)
        speed, torque = wires["omega"], "limit.T_m"
        wires |= {"limit.T": "act.T_b", "limit.omega": speed, "T": torque}
    if driven:
        parts["motor"] = replicate(mirror("N m", "traction"), many)
        wires |= {"motor.u": torque, "train.T": "motor.y"}
    else:
        pads = pads_of_axles(vehicle)
        if pads is not None:
            parts["pads"] = pads
            wires |= {"pads.T": torque, "pads.omega": "train.omega"}
            torque = "pads.T_b"
        wires["train.T_b"] = torque
    if vehicle.dynamic_brake is not None:
        motors, more = _motors(vehicle, isinstance(part, Air))
        if "pads" in parts:  # what is measured is at their nominal friction
            motors["seen"] = motors["sum"]
            more |= {"seen.T_f": wires["T"], "seen.T_e": "motors.T_e"}
        wires |= more | {"sum.T_f": torque, "train.T_b": "sum.T_b"}
        wires["T"] = "seen.T_b" if "pads" in parts else "sum.T_b"
        if not isinstance(part, Air):
            wires["act.T_cmd"] = "motors.T_f"
        parts |= motors
    if moves:
        parts["transfer"] = load_transfer(vehicle)
        wires |= {"transfer.a": "train.a", "train.dN": "transfer.dN"}
    if field is not None:
        parts["field"] = field
        wires |= {"field.at": "train.at", "field.way": "train.way", "field.P": "train.P_contact"}
        wires |= {f"train.{name}": f"field.{name}" for name in ("recovered", "height")}
        wires |= {f"field.{k}": f"train.{k}" for k in ("v_s", "v") if k in field.inputs}
    return connect("plant", wires, share={"m": "*.m", "g": "*.g"}, **parts)
