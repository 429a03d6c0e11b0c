"""How far a law of adhesion reaches: up to which slip it was measured, up to which it is meant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from slipctl.block.block import Block
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import BadInput

LOCKED = "locked"
"""What stands in a file for a law that is meant for a locked wheel at any speed."""

KEYS = ("measured_to", "meant_to")


def slip_input(law: Block) -> str | None:
    """Name of the slip among the inputs of a law; None where it has none."""
    found = [n for n, s in law.inputs.items() if s.per in ("speed", "ratio")]
    found += [n for n in ("v_s", "lam") if n in law.inputs]
    return found[0] if found else None


def reach_text(law: Block) -> str:
    """What a law says of its reach, as a line; empty where it says nothing."""
    name = slip_input(law)
    if name is None or (law.law_data.measured_to is None and law.law_data.meant_to is None):
        return ""
    unit = "" if law.inputs[name].unit == "1" else f" {law.inputs[name].unit}"
    if law.law_data.measured_to is None:
        measured = "not said up to which slip it was measured"
    else:
        upto = f"measured up to |{name}| = {law.law_data.measured_to:g}{unit}"
        measured = upto if law.law_data.measured_to else "not measured"
    if law.law_data.meant_to is None:
        return f"{measured}; not said up to which slip it is meant"
    if math.isinf(law.law_data.meant_to):
        return f"{measured}; meant up to a locked wheel"
    return f"{measured}; meant up to |{name}| = {law.law_data.meant_to:g}{unit}"


def measured_reach(law: Block, inputs: Mapping[str, Any]) -> dict[str, str]:
    """What ``with_reach`` is given for points that were measured: the largest slip among them.

    Args:
        law: the law.
        inputs: of the points, by name; without the law's slip there is nothing to tell.
    """
    name = slip_input(law)
    if name is None or name not in inputs:
        return {}
    unit = law.inputs[name].unit
    return {
        "measured_to": f"{float(max(abs(x) for x in inputs[name])):.4g} {unit}".removesuffix(" 1")
    }


def with_reach(law: Block, given: dict[str, Any]) -> Block:
    """Law that says how far it reaches.

    Args:
        law: the law.
        given: of ``measured_to`` and ``meant_to`` those that are told, texts with their units,
            numbers where the slip has none; ``meant_to`` may be ``"locked"``.

    Raises:
        BadInput: the law has no slip, or what is given is no slip.
    """
    name = slip_input(law)
    if given and name is None:
        raise BadInput(f"{law.name} has no slip among its inputs, so it has no {min(given)}")
    found: dict[str, float | None] = {k: getattr(law.law_data, k) for k in KEYS}
    for key, text in given.items():
        if key == "meant_to" and text == LOCKED:
            found[key] = math.inf
            continue
        value = parse_quantity(str(text), law.inputs[str(name)].unit, key)
        if not (math.isfinite(value) and value >= 0):
            raise BadInput(f"{key} = {text!r} is no slip; write one from 0 on, or {LOCKED!r}")
        found[key] = value
    data = replace(law.law_data, measured_to=found["measured_to"], meant_to=found["meant_to"])
    return law._copy(law.signals, law_data=data)
