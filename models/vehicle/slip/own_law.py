"""A law of a person's own as slip control takes it: loaded, checked, at its own sample time."""

from __future__ import annotations

import math

from slipctl import BadInput, Block, every
from slipctl.models.common_form import Wheel
from slipctl.models.vehicle.parts import Controller, OwnLaw, Trip
from slipctl.models.vehicle.parts.file_keys import of_the_wheel
from slipctl.study.resolve import load_block

INPUTS = ("v", "v_s", "v_best", "F", "D", "T", "T_top")
"""What slip control gives to a law."""


def sample_time(trip: Trip, part: Controller) -> float:
    """Time in s from one sample of the law of a controller to the next."""
    own = load_block(part.block).period if isinstance(part, OwnLaw) else None
    return own or trip.control.period


def own_block(trip: Trip, part: OwnLaw) -> Block:
    """Block of a controller, which runs at the sample time that it was written with.

    Raises:
        BadInput: no such block; its sample time is no whole number of those of the controllers.
    """
    block = load_block(part.block)
    if block.kind == "flow":
        raise BadInput(f"{part.block} is a flow; write it with a tick: sampled(law, 1e-3, 'euler')")
    many = (block.period or trip.control.period) / trip.control.period
    n = round(many)
    if n < 1 or not math.isclose(many, n, rel_tol=1e-9):
        raise BadInput(
            f"{part.block} runs every {block.period:g} s, and the controllers every"
            f" {trip.control.period:g} s ([control] period); write a whole number of these"
        )
    return every(block, n) if n > 1 else block


def own_slip_law(trip: Trip, part: OwnLaw, w: Wheel) -> Block:
    """Slip law of a controller, with the numbers of its wheel.

    Raises:
        BadInput: no such block, or one that is no slip law.
    """
    block = own_block(trip, part)
    other = [n for n, s in block.inputs.items() if n not in INPUTS and s.value is None]
    if other or "T_wanted" not in block.outputs:
        raise BadInput(
            f"{part.block} is no slip law: "
            + (f"it needs {other[0]}; a law may ask for {', '.join(INPUTS)}" if other else
               f"it gives {', '.join(block.outputs) or 'nothing'}, not T_wanted")
        )  # fmt: skip
    own = {"J": w.J, "r": w.r, "m": w.m, "g": w.g, "tau": w.tau, "T_max": w.T_max}
    return block.with_params(**{
        n: v for n, v in own.items() if n in block.params and not block.params[n].derived
        and of_the_wheel(block.params[n], n)
    })  # fmt: skip
