"""Control of air brakes by their valves: a command becomes two bits, which explain the torque."""

from __future__ import annotations

import math
from collections.abc import Mapping

from casadi import if_else

from slipctl import BadInput, Block, Input, Output, law
from slipctl.errors import nearest
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
from slipctl.models.vehicle.safe_output import contained_block
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


@law(
    hold=Output("1", "bit of the valve that shuts the supply off", lo=0, hi=1),
    vent=Output("1", "bit of the valve that vents", lo=0, hi=1),
    name="refill",
)
def whole_bits(
    hold_by=Input("1", "bit of the valve that shuts the supply off, as it was given"),
    vent_by=Input("1", "bit of the valve that vents, as it was given"),
):
    """Bits of what a block gives; what is no number is 0, the brake by the demand."""
    return dict(hold=if_else(hold_by > 0.5, 1, 0), vent=if_else(vent_by > 0.5, 1, 0))


@law(
    state=Output("1", "0 fill, 1 hold, 2 vent", lo=0, hi=2), name="states",
)  # fmt: skip
def whole_state(state_by=Input("1", "state, as it was given: 0 fill, 1 hold, 2 vent")):
    """State of what a block gives; what is no number is 0, the brake by the demand."""
    return if_else(state_by > 1.5, 2, if_else(state_by > 0.5, 1, 0))


SEEN = {
    "v": "trust.v", "omega": "slip.omega_s", "v_s": "slip.v_s", "a_w": "rim.a_w",
    "T": "trust.T_b", "T_b": "trust.T_b", "T_demand": "trust.demand",
    "under_way": "model.under_way", "off": "gate.off",
}  # fmt: skip
"""What a block of one's own that gives bits may ask for, and where it is."""


def gives_bits(block: Block) -> bool:
    """Whether a block is a slide protection: it gives ``hold`` and ``vent``, or ``state``."""
    gives = set(block.outputs)
    return "T_wanted" not in gives and ({"hold", "vent"} <= gives or "state" in gives)


def refuse_misfits(trip: Trip, block: Block) -> None:
    """Refuse a block that gives bits and does not fit a trip.

    Raises:
        BadInput: no air brake, an input that slide protection has not.
    """
    if not isinstance(trip.actuator, Air):
        raise BadInput(
            f"{block.name} gives the bits of two valves; write kind = 'air' under [actuator]"
        )
    other = [n for n, s in block.inputs.items() if n not in SEEN and s.value is None]
    if other:
        raise BadInput(
            f"{block.name}, which gives the bits of two valves, asks for {other[0]}"
            f"{nearest(other[0], SEEN)}"
        )


def own_slide_protection(trip: Trip, block: Block, w: Wheel) -> tuple[Parts, Wires]:
    """Parts of a slide protection of one's own for one axle, and their wires.

    Gate, watchdog and model of the brake are those of :func:`slide_protection`; a block that gives
    ``state`` has its refill as well. A block that breaks gives its axle the demand.

    Args:
        trip: the trip. block: gives the bits, see :func:`gives_bits`. w: the wheel.
    """
    parts, wires = slide_protection(trip, SlideProtection(), w)
    del parts["machine"]
    wires = {k: v for k, v in wires.items() if not k.startswith("machine.")}
    parts["law"] = contained_block(block)
    wires |= {f"law.{n}": SEEN[n] for n in block.inputs if n in SEEN}
    if {"hold", "vent"} <= set(block.outputs):
        parts["refill"] = whole_bits
        wires = {k: v for k, v in wires.items() if not k.startswith("refill.")}
        wires |= {"refill.hold_by": "law.hold", "refill.vent_by": "law.vent"}
    else:
        parts["states"] = whole_state
        wires |= {"states.state_by": "law.state", "refill.state": "states.state"}
    if "a_w" not in block.inputs:
        del parts["rim"], wires["rim.rim"]
    if not {"v_s", "omega"} & set(block.inputs):
        del parts["slip"], wires["slip.v"], wires["slip.rim"]
    return parts, wires


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
