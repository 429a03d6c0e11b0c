"""What a part declares and what it computes, in rows of text for a table that is kept."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from slipctl import Block, Signal

HEAD = ["part", "signal", "role", "unit", "value", "lo", "hi", "positive", "rest", "first",
        "second"]  # fmt: skip
NEAR = 1e-7
"""Searches and fits of other versions of NumPy and CasADi end this close, as a share."""


def leaves(block: Block) -> Iterator[Block]:
    """Parts that have none of their own."""
    if not block.parts:
        yield block
    for part in block.parts.values():
        yield from leaves(part)


def told(block: Block) -> str:
    """Name and options of a part."""
    chosen = ", ".join(f"{k} = {v}" for k, v in block.choices.items())
    return f"{block.name} ({chosen})" if chosen else block.name


def signals(part: Block) -> list[list[str]]:
    """What is declared of a part, and of each of its signals, and what it gives at two points."""
    values = [answers(part, k) for k in (0, 1)]
    return [["", part.kind, *[""] * 5, of_block(part), "", ""]] + [
        [n, s.role, s.unit, said(s.value), said(s.lo), said(s.hi), s.positive or "",
         rest(s), *(v.get((s.role, n), "") for v in values)]
        for group in (part.states, part.inputs, part.params, part.outputs)
        for n, s in group.items()
    ]  # fmt: skip


def rest(s: Signal) -> str:
    """What else is declared of a signal; of words, whether there are any."""
    found = {
        "told": bool(s.doc), "sourced": bool(s.source), "per": s.per, "safe": s.safe,
        "change": s.change if np.isfinite(s.change) else "", "jitter": s.jitter or "",
        "stale": s.stale if s.stale != 200 else "", "noise": s.noise, "axis": s.axis,
        "whole": s.whole, "truth": " ".join(s.truth),
        "deviation": s.deviation, "ends": "; ".join(f"{b.what} {b.expression}" for b in s.bounds),
        "values": " ".join(s.values), "over": s.over, "rising": s.rising,
    }  # fmt: skip
    return ", ".join(n if v is True else f"{n} {said(v)}" for n, v in found.items()
                     if v is not None and v is not False and v != "")  # fmt: skip


def of_block(b: Block) -> str:
    """What is declared of a block as a whole."""
    law, made = b.law_data, b.composition
    found = {
        "period": b.period, "told": bool(b.doc), "units": b.units if b.units != "checked" else "",
        "conditions": " ".join(f"{n}({said(list(v.values()))})" for n, v in b.conditions.items()),
        "closed form": law.closed_form is not None, "coordinates": " ".join(law.coordinates),
        "readings": " ".join(law.readings), "expects": " ".join(map(str, law.expects)),
        "follows": bool(law.follows), "leaves out": bool(law.leaves_out),
        "beside": " ".join(f"{n}({said(s.value)} {said(s.lo)} {said(s.hi)})"
                           for n, s in law.beside.items()),
        "transparent": bool(b.transparent), "guarded": made.guard is not None,
        "solves": bool(made.solves), "split": made.split is not None,
        "by structure": made.by_structure,
    }  # fmt: skip
    return ", ".join(n if v is True else f"{n} {said(v)}" for n, v in found.items()
                     if v is not None and v is not False and v != "")  # fmt: skip


def answers(part: Block, number: int) -> dict[tuple[str, str], str]:
    """Next states (or derivatives) and outputs at a point that follows from the part's name."""
    rng = np.random.default_rng(zlib.crc32(f"{part.name} {number}".encode()))
    f = part.function()
    names = [n.partition("_")[2] for n in f.name_in()]
    own = {s.name.replace(".", "_").rstrip("_"): s for s in part.signals if s.role != "output"}
    missing = {n: min(max(2.0, s.lo), s.hi) for n, s in part.params.items() if s.value is None}
    numbered = part.with_params(**missing) if missing else part
    now = {n: s.value for n, s in part.inputs.items()}
    now |= numbered.start() | numbered.param_values()
    given = [
        place(own[n], now.get(own[n].name), f.size_in(k), rng, number) for k, n in enumerate(names)
    ]
    result = f(*given)
    result = result if isinstance(result, tuple) else (result,)
    roles = {s.name.replace(".", "_"): s.name for s in part.signals}
    found = {}
    for n, value in zip(f.name_out(), result, strict=True):
        kind, _, short = n.partition("_")
        role = "output" if kind == "y" else "state"
        flat = np.array(value, dtype=float).ravel()
        weights = np.cos(np.arange(len(flat)))  # of a vector one number, no entry without weight
        found[role, roles.get(short, short)] = f"{float(weights @ flat):.12g}"
    return found


def place(
    signal: Any, own: Any, size: tuple[int, int], rng: np.random.Generator, number: int
) -> np.ndarray:
    """A value of a signal: near its own where it has one, else near 1, and in its range.

    At the first point whole numbers of parameters stay, which counts and switches are.
    """
    base = np.ones(size)
    if own is not None:
        base = base * np.reshape(own, size if np.size(own) > 1 else (1, 1))
    value = base * (1 + 0.1 * rng.uniform(-1, 1, size)) + np.where(base == 0, rng.random(size), 0)
    if signal.role == "param" and not number and np.all(base == np.round(base)) and np.any(base):
        value = base
    low, high = (e if isinstance(e, int | float) else np.inf * d for e, d in
                 ((signal.lo, -1), (signal.hi, 1)))  # fmt: skip
    return np.clip(value, low, high)


def said(number: object) -> str:
    """Numbers to twelve digits: the last ones are those of a system's ``exp``."""
    if isinstance(number, int | float):
        return f"{number:.12g}"
    return " ".join(str(number).split())


def close(have: str, wanted: str, near: float = NEAR) -> bool:
    """Whether two entries are the same, as numbers where they are numbers."""
    if have == wanted:
        return True
    try:
        return bool(np.isclose(float(have), float(wanted), rtol=near, atol=near / 100))
    except ValueError:
        return False
