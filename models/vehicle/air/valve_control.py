"""Control of air brakes by their valves: a command becomes two bits, which explain the torque."""

from __future__ import annotations

import math
from collections.abc import Mapping

from slipctl import Block, Input, Output, law
from slipctl.models.common_form import Wheel
from slipctl.models.vehicle.air.pneumatics import brake_model, valve_bits
from slipctl.models.vehicle.air.slide_protection import (
    protection_off,
    refill,
    rim_acceleration,
    slide_machine,
    watchdog,
)
from slipctl.models.vehicle.parts import Air, SlideProtection, Trip
from slipctl.models.vehicle.slip.takeover import slip_from_speeds

Parts, Wires = dict[str, Block], dict[str, str]


@law(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
    name="valves",
)
def valves_at_rest(T_cmd=Input("N m", "commanded torque, the demand", positive="braking")):
    """Both valves without current: the cylinder follows the demand."""
    rest = 0 * (T_cmd > 0)
    return dict(hold=rest, vent=rest)


def numbers_of_brake(trip: Trip) -> dict[str, float]:
    """Numbers of the air brake, by the names of the blocks of a controller."""
    part = trip.actuator
    assert isinstance(part, Air)
    k_f, k_v = part.rates
    return {"T_max": part.torque, "p_full": part.pressure, "p_s": part.supply, "k_f": k_f,
            "k_v": k_v, "band": part.band, "pulse": part.pulse}  # fmt: skip


def with_numbers(block: Block, numbers: Mapping[str, float]) -> Block:
    """A block with those of the numbers that it has."""
    return block.with_params(**{k: v for k, v in numbers.items() if k in block.params})


def model_of_brake(trip: Trip) -> Block:
    """Model of the brake of one axle, at the period of the controllers."""
    ticks = math.ceil(trip.actuator.dead_time / trip.control.period - 1e-9)
    return with_numbers(brake_model(ticks), numbers_of_brake(trip))


MODEL_WIRES = {
    "model.hold": "hold", "model.vent": "vent", "model.T_b": "trust.T_b",
    "model.T_demand": "trust.demand",
}  # fmt: skip
"""What the model of a brake is told; ``hold`` and ``vent`` stand for where the bits are made."""


def torque_to_bits(trip: Trip) -> tuple[Parts, Wires]:
    """Parts of one axle that turn a commanded torque into bits, and their wires."""
    bits = with_numbers(valve_bits, numbers_of_brake(trip))
    wires = {
        "valves.T_cmd": "safe.T_cmd", "valves.T_demand": "trust.demand",
        "valves.T_b": "trust.T_b", "valves.under_way": "model.under_way",
        "hold": "valves.hold", "vent": "valves.vent", "trust.T_cmd": "model.T_h",
    }  # fmt: skip
    wires |= {k: v if v not in ("hold", "vent") else f"valves.{v}" for k, v in MODEL_WIRES.items()}
    return {"model": model_of_brake(trip), "valves": bits}, wires


def slide_protection(trip: Trip, part: SlideProtection, w: Wheel) -> tuple[Parts, Wires]:
    """Parts of the slide protection of one axle, and their wires."""
    numbers = numbers_of_brake(trip) | {"m_axle": w.W, "r": w.r}
    machine = slide_machine().with_params(
        dv_0=part.slip, dv_v=part.share, a_vent=part.deceleration, s_hold=part.hold,
        a_hold=part.hold_deceleration, s_fill=part.fill, a_fill=part.fill_acceleration,
    )  # fmt: skip
    parts = {
        "slip": slip_from_speeds(driven=False),
        "gate": protection_off.with_params(v_off=part.cut_off),
        "rim": rim_acceleration.with_params(T_f=part.filter, v_start=trip.vehicle.speed),
        "machine": machine,
        "refill": with_numbers(refill, numbers | {"ramp": part.ramp}),
        "safe": with_numbers(watchdog, numbers).with_params(
            limit=trip.control.release, limit_still=trip.control.release_still
        ),
        "model": model_of_brake(trip),
    }
    wires = {
        "slip.v": "trust.v", "slip.rim": "trust.rim", "gate.v": "trust.v",
        "gate.ready": "trust.ready", "rim.rim": "trust.rim", "machine.v": "trust.v",
        "machine.v_s": "slip.v_s", "machine.a_w": "rim.a_w", "machine.off": "gate.off",
        "refill.state": "machine.state", "refill.T_b": "trust.T_b",
        "refill.under_way": "model.under_way", "refill.T_demand": "trust.demand",
        "safe.hold_by": "refill.hold", "safe.vent_by": "refill.vent", "safe.off": "gate.off",
        "safe.stands": "trust.stands", "safe.retry": "trust.retry",
        "safe.T_b": "trust.T_b", "safe.T_demand": "trust.demand",
        "hold": "safe.hold", "vent": "safe.vent", "trust.T_cmd": "model.T_h",
    }  # fmt: skip
    wires |= {k: v if v not in ("hold", "vent") else f"safe.{v}" for k, v in MODEL_WIRES.items()}
    return parts, wires
