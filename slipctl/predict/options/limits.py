"""Limits of states and outputs as a person gives them, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.signals import Param, Signal
from slipctl.errors import BadInput, check_number, check_positive
from slipctl.predict.stages.horizon import Soft


def entries_of(where: str, given: Any, form: str) -> Any:
    """Entries of one setting, refused where they are not of the form."""
    if not isinstance(given, (tuple, list)) or len(given) != len(form.split(",")):
        raise BadInput(f"{where}: {given!r} is not {form}")
    return given


def limits_of(
    where: str, plant: Block, laws: Mapping[str, Block],
    soft: Mapping[str, tuple[float | None, ...]],
    hard: Mapping[str, tuple[float | None, float | None]],
) -> dict[str, Soft]:  # fmt: skip
    """Limits by full name: ``plant.v`` of the plant, ``path.room`` or ``final.room`` of a law."""
    rows = _rows(where, plant, laws)
    softs = _soft(where, plant, rows, soft)
    found = softs | _hard(where, plant, rows, hard, softs)
    for name, s in rows.items():
        if name not in found:
            given = {name.split(".", 1)[1]: (s.lo, s.hi)}
            found |= _hard(where, plant, rows, given, found)
    _refuse_contradictions(where, laws, found)
    return found


def _rows(where: str, plant: Block, laws: Mapping[str, Block]) -> dict[str, Signal]:
    """Outputs of the laws that are limits."""
    found: dict[str, Signal] = {}
    taken = dict.fromkeys((*plant.states, *plant.outputs), plant.name)
    for part in ("path", "final"):
        block = laws.get(part)
        for n, s in (block.outputs if block else {}).items():
            if n in taken:
                raise BadInput(
                    f"{where}: {n} of the {part} law is a name of {taken[n]} too; rename it"
                )
            if s.shape != ():
                raise BadInput(f"{where}: {n} of the {part} law must be a scalar")
            taken[n] = block.name if block else ""
            found[f"{part}.{n}"] = s
    return found


def _refuse_contradictions(
    where: str, laws: Mapping[str, Block], found: Mapping[str, Soft]
) -> None:
    """Refuse a limit of the end that leaves nothing of a limit of the same signal on the way.

    A law whose output is one of its inputs limits that signal itself.
    """
    itself: dict[str, list[tuple[str, Soft]]] = {}
    for name, limit in found.items():
        part, short = name.split(".", 1)
        signal = short.rpartition(".")[2]
        if part in laws:
            law = laws[part]
            u, p = law.symbols("input"), law.symbols("param")
            y = law.expr({}, u, p)[1][short]
            signal = next((n for n, v in u.items() if ca.is_equal(y, v)), "")
        if signal:
            itself.setdefault(signal, []).append((short, limit))
    for signal, limits in itself.items():
        lo = max(limits, key=lambda e: e[1].lo)
        hi = min(limits, key=lambda e: e[1].hi)
        if lo[1].lo > hi[1].hi and lo[1].hard and hi[1].hard:
            raise BadInput(
                f"{where}: {lo[0]} keeps {signal} above {lo[1].lo:g} and {hi[0]} below"
                f" {hi[1].hi:g}: nothing is left; widen one of them"
            )


def _soft(
    where: str, plant: Block, rows: Mapping[str, Signal],
    soft: Mapping[str, tuple[float | None, ...]],
) -> dict[str, Soft]:  # fmt: skip
    """Soft limits by full name, of (lo, hi, weight) or (lo, hi, weight, linear)."""
    found = {}
    for n, entries in soft.items():
        form = "(lo, hi, weight)"
        if isinstance(entries, (tuple, list)) and len(entries) == 4:
            form = "(lo, hi, weight, linear)"
        given = entries_of(f"{where}: soft limits of {n}", entries, form)
        name, low, high = _range(where, plant, rows, n, "soft", given[0], given[1], form)
        weight, linear = [*given[2:], 0.0][:2]
        if len(given) == 4:
            check_positive(f"{where}: linear weight of {n}", linear)
        if len(given) == 3 or weight != 0:
            check_positive(f"{where}: weight of {n}", weight)
        found[name] = Soft(low, high, float(weight), float(linear))
    return found


def _hard(
    where: str, plant: Block, rows: Mapping[str, Signal],
    hard: Mapping[str, tuple[float | None, float | None]], softs: Mapping[str, Soft],
) -> dict[str, Soft]:  # fmt: skip
    """Hard limits by full name, of (lo, hi)."""
    found = {}
    for n, entries in hard.items():
        form = "(lo, hi)"
        given = entries_of(f"{where}: hard limits of {n}", entries, form)
        name, low, high = _range(where, plant, rows, n, "hard", given[0], given[1], form)
        if name in softs:
            raise BadInput(f"{where}: {n} has soft limits and hard ones; give one of them")
        found[name] = firm(low, high)
    return found


FAR = 1e12
"""A limit at this distance is none."""


def _range(
    where: str, plant: Block, rows: Mapping[str, Signal], n: str, kind: str, lo: Any, hi: Any,
    form: str,
) -> tuple[str, float, float]:  # fmt: skip
    """Full name and limits of an output of a law, or of an output or state of the plant."""
    own = next((name for name in rows if name.split(".", 1)[1] == n), None)
    name = own or f"plant.{plant.find(n, 'state', 'output')}"
    s = rows[own] if own else (plant.states | plant.outputs)[name.removeprefix("plant.")]
    advice = f"give {kind}={{{n!r}: {form}}}" if own is None else "declare its lo= or hi="
    return name, *ends_of(where, f"{kind} limits", n, s, (lo, hi), advice)


def ends_of(
    where: str, what: str, n: str, s: Signal, given: Sequence[float | None], advice: str
) -> tuple[float, float]:
    """Limits of a signal, declared ones where None is given; refused where they leave nothing."""
    low, high = (own if b is None else b for b, own in zip(given, (s.lo, s.hi), strict=True))
    for b in (low, high):
        check_number(f"{where}: {what} of {n}: an end", b, s.unit)
    if not low < high:
        raise BadInput(f"{where}: {n} from {low:g} to {high:g} {s.unit} leaves nothing")
    if math.isinf(low) and math.isinf(high):
        raise BadInput(f"{where}: {n} has no range; {advice}")
    return max(low, -FAR), min(high, FAR)


def firm(low: float, high: float) -> Soft:
    """Hard limits; what they are exceeded by counts by their size."""
    size = max((abs(b) for b in (low, high) if abs(b) < FAR), default=1.0) or 1.0
    return Soft(low, high, 1 / size, hard=True)


def limit_params(unit: str, name: str, limit: Soft) -> list[Signal]:
    """Parameters of the ends of a limit."""
    kind = "hard" if limit.hard else "soft"
    return [
        Param(unit, value, f"{kind} limit {side}", lo=-1e12, hi=1e12).named(f"{name}_{end}")
        for end, side, value in (("min", "below", limit.lo), ("max", "above", limit.hi))
    ]
