"""Ranges of the signals of a block that is made of another one, such as an estimator of a model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from slipctl.block.block import Block, as_block
from slipctl.block.signals import Signal, numbers_and_bounds
from slipctl.errors import BadInput, nearest

Row = tuple[Any, ...]
"""Lower end, upper end, source, and of an input its largest change per tick, and its noise."""


def ranged(
    block: Block, *outputs: Signal, table: Mapping[str, Row] | None = None, **signals: Any
) -> Block:
    """Declare ranges of states, inputs, outputs and parameters; nothing else of the block changes.

    Args:
        block: any.
        outputs: ``Output("N", lo=-1e3, hi=1e3).named("F_a")``; a state may have the same name.
        table: ranges by name, ``{"F_a": (-1e3, "F_max", "source")}``, whatever carries the name:
            lower end, upper end, source and, of an input, the largest change per tick and noise.
        signals: states and inputs by name, ``omega=Input("rad/s", lo=-1, hi="120 / r")``; ends, and
            ``change`` and ``noise`` of an input, may be expressions of the block's parameters.
            Unit, meaning and all the rest stay the block's own.

    Raises:
        BadInput: an unknown signal, another unit, an expression that cannot be read.
    """
    as_block("ranged: the block", block)
    for s in (*outputs, *signals.values()):
        if not isinstance(s, Signal):
            raise BadInput(f"ranged: {s!r} is no signal; write u=Input('N', lo=-1, hi=1)")
    given = {(s.role, n): s for n, s in signals.items()} | {("output", s.name): s for s in outputs}
    if len(given) < len(outputs) + len(signals):
        raise BadInput("ranged: a signal has two ranges; leave out one")
    own = {(s.role, s.name): s for s in block.signals}
    for (role, n), s in given.items():
        if (role, n) not in own:
            known = [k for r, k in own if r == role]
            raise BadInput(f"ranged: {block.name} has no {role} {n!r}{nearest(n, known)}")
        there = own[role, n]
        if s.unit != there.unit:
            raise BadInput(f"ranged: {block.name}.{n} is in {there.unit}, its range in {s.unit}")
        own[role, n] = _declared(there, s)
    for n, (lo, hi, source, *change) in (table or {}).items():
        found = [key for key in own if key[1] == n]
        if not found:
            known = [k for _, k in own]
            raise BadInput(f"ranged: {block.name} has no signal {n!r}{nearest(n, known)}")
        for role, _ in found:
            own[role, n] = _row(own[role, n], (lo, hi, *change), source)
    made = block._copy(own.values())
    params = made.symbols("param")
    for s in made.signals:
        if s.bounds:
            made.ends(s, params)
    rebuild = block.composition.rebuild
    if rebuild is None:
        return made
    return made.with_rebuild(  # made again of other parts it has the same ranges
        lambda *parts: ranged(rebuild(*parts), *outputs, table=table, **signals)
    )


def _declared(there: Signal, s: Signal) -> Signal:
    """A signal with the range of another one."""
    taken = ("lo", "hi", "change", "jitter", "bounds", "stale")
    given = {k: getattr(s, k) for k in taken}
    return replace(there, **given, source=s.source or there.source)


def _row(there: Signal, ends: Row, source: str) -> Signal:
    """A signal with the range of a row of a table."""
    what = dict(zip(("lo", "hi", "change", "noise"), ends, strict=False))
    if there.role != "input":
        what = {k: what[k] for k in ("lo", "hi")}
    given: dict[str, Any] = {"lo": -math.inf, "hi": math.inf, "change": math.inf, "noise": 0.0}
    given |= numbers_and_bounds(**what)
    jitter = given.pop("noise")
    return replace(there, **given, jitter=jitter, source=there.source or source)
