"""Limits of states and outputs as a person gives them, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from slipctl.block.block import Block
from slipctl.errors import BadInput, check_number, check_positive
from slipctl.predict.horizon import Soft


def entries_of(where: str, given: Any, form: str) -> Any:
    """Entries of one setting, refused where they are not of the form."""
    if not isinstance(given, (tuple, list)) or len(given) != len(form.split(",")):
        raise BadInput(f"{where}: {given!r} is not {form}")
    return given


def soft_limits(
    where: str, plant: Block, soft: Mapping[str, tuple[float | None, ...]]
) -> dict[str, Soft]:
    """Soft limits by full name, of (lo, hi, weight) or (lo, hi, weight, linear)."""
    found = {}
    for n, entries in soft.items():
        form = "(lo, hi, weight)"
        if isinstance(entries, (tuple, list)) and len(entries) == 4:
            form = "(lo, hi, weight, linear)"
        given = entries_of(f"{where}: soft limits of {n}", entries, form)
        name, low, high = _range(where, plant, n, "soft", given[0], given[1], form)
        weight, linear = [*given[2:], 0.0][:2]
        if len(given) == 4:
            check_positive(f"{where}: linear weight of {n}", linear)
        if len(given) == 3 or weight != 0:
            check_positive(f"{where}: weight of {n}", weight)
        found[name] = Soft(low, high, float(weight), float(linear))
    return found


def hard_limits(
    where: str, plant: Block, hard: Mapping[str, tuple[float | None, float | None]],
    softs: Mapping[str, Soft],
) -> dict[str, Soft]:  # fmt: skip
    """Hard limits by full name, of (lo, hi)."""
    found = {}
    for n, entries in hard.items():
        form = "(lo, hi)"
        given = entries_of(f"{where}: hard limits of {n}", entries, form)
        name, low, high = _range(where, plant, n, "hard", given[0], given[1], form)
        if name in softs:
            raise BadInput(f"{where}: {n} has soft limits and hard ones; give one of them")
        size = max((abs(b) for b in (low, high) if abs(b) < FAR), default=1.0) or 1.0
        found[name] = Soft(low, high, 1 / size, hard=True)
    return found


FAR = 1e12
"""A limit at this distance is none."""


def _range(
    where: str, plant: Block, n: str, kind: str, lo: Any, hi: Any, form: str
) -> tuple[str, float, float]:
    """Full name and limits of an output or state."""
    name = plant.find(n, "state", "output")
    s = (plant.states | plant.outputs)[name]
    low, high = s.lo if lo is None else lo, s.hi if hi is None else hi
    for b in (low, high):
        check_number(f"{where}: {kind} limits of {n}: an end", b, s.unit)
    if not low < high:
        raise BadInput(f"{where}: {n} from {low:g} to {high:g} {s.unit} leaves nothing")
    if math.isinf(low) and math.isinf(high):
        raise BadInput(f"{where}: {n} has no range; give {kind}={{{n!r}: {form}}}")
    return name, max(low, -FAR), min(high, FAR)
