"""Ranges of the signals of a block that is made of another one, such as an estimator of a model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from slipctl.block.block import Block, Exprs, as_block
from slipctl.block.signals import Signal
from slipctl.errors import BadInput, nearest


def ranged(block: Block, *outputs: Signal, **signals: Any) -> Block:
    """Declare ranges of states and inputs, and of outputs; nothing else of the block changes.

    Args:
        block: any.
        outputs: ``Output("N", lo=-1e3, hi=1e3).named("F_a")``; a state may have the same name.
        signals: states and inputs by name, ``omega=Input("rad/s", lo=-1, hi="120 / r")``; ends, and
            the ``change`` of an input, may be expressions of the block's parameters. Unit, meaning
            and all the rest stay the block's own.

    Raises:
        BadInput: an unknown signal, another unit, an expression that cannot be read.
    """
    as_block("ranged: the block", block)
    given = {(s.role, n): s for n, s in signals.items()} | {("output", s.name): s for s in outputs}
    own = {(s.role, s.name): s for s in block.signals}
    for (role, n), s in given.items():
        if (role, n) not in own:
            known = [k for r, k in own if r == role]
            raise BadInput(f"ranged: {block.name} has no {role} {n!r}{nearest(n, known)}")
        there = own[role, n]
        if s.unit != there.unit:
            raise BadInput(f"ranged: {block.name}.{n} is in {there.unit}, its range in {s.unit}")
        own[role, n] = replace(
            there,
            lo=s.lo,
            hi=s.hi,
            change=s.change,
            bounds=s.bounds,
            stale=s.stale,
            source=s.source or there.source,
        )

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        n, y = block.f(block.pack("state", x), block.pack("input", u), block.pack("param", p))
        return block.unpack("state", n), block.unpack("output", y)

    def rebuild(parts: dict[str, Block]) -> Block:
        return ranged(parts[block.name], *outputs, **signals)

    made = Block(
        block.name, block.kind, body, list(own.values()),
        period=block.period, sx=block.sx, doc=block.doc, choices=block.choices,
        parts={block.name: block}, rebuild=rebuild, conditions=block.conditions,
        transparent=True, sharing=block.sharing.through(),
    )  # fmt: skip
    params = made.symbols("param")
    for s in made.signals:
        if s.bounds:
            made.ends(s, params)
    return made
