"""A block as plain data, as ``slipctl show --json`` prints it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.reach import reach_text
from slipctl.block.shared_numbers import differences, places_of
from slipctl.block.signals import Signal
from slipctl.draw import show


def block_dict(block: Block) -> dict[str, Any]:
    """What ``show.text`` says of a block: kind, parts, wires, signals, shared numbers, equations.

    A range without an end has null there, and so has a signal without a value.
    """
    apart = differences(block)
    return {
        "name": block.name,
        "kind": block.kind,
        "period_s": block.period,
        "doc": block.doc,
        "choices": {k: _plain(v) for k, v in block.choices.items()},
        "parts": list(block.parts),
        "wires": {target: str(source) for target, source in show.inner(block).wires.items()},
        "signals": [_signal(s) for s in block.signals],
        "shared": {n: list(places) for n in block.params if (places := places_of(block, n))},
        "set_apart": dict(apart),
        "conditions": {k: dict(v) for k, v in block.conditions.items()},
        **({"reach": reach} if (reach := reach_text(block)) else {}),
        "latex": show.latex(block),
    }


def _signal(s: Signal) -> dict[str, Any]:
    return {
        "role": s.role, "name": s.name, "unit": s.unit, "shape": list(s.shape),
        "value": _plain(s.value), "lo": _end(s.lo), "hi": _end(s.hi), "noise": s.noise,
        "positive": s.positive, "per": s.per, "doc": s.doc, "source": s.source,
        **({"values": list(s.values)} if s.values else {}),
    }  # fmt: skip


def _end(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _plain(value: Any) -> Any:
    """As JSON has it: numbers, lists of them, texts; anything else by its words."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float | np.floating | np.ndarray | list | tuple):
        return np.asarray(value, dtype=float).tolist()
    return str(value)
