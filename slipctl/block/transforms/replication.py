"""Copies: n of a block at once, one for each axle, as a loop over them and not as n parts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs
from slipctl.block.fields import Composition
from slipctl.block.signals import Signal
from slipctl.block.text.named_expressions import names_in
from slipctl.block.transforms.discretisation import counters
from slipctl.errors import check_known, check_whole


def replicate(
    block: Block,
    n: int,
    shared: Iterable[str] = (),
    distinct: Iterable[str] = (),
    axis: str = "axle",
    spread: bool = False,
) -> Block:
    """Run n copies of a block side by side.

    A signal that each copy has for itself gets the shape (n,). Where it had (k,) it gets (k, n),
    and where it had (k, l) it gets (k, l n), the copies beside each other. Such are every state and
    output, the inputs that are not ``shared``, and the parameters named ``distinct``. A number
    given for it holds in every copy. The computation is a loop, in C too.

    Args:
        block: a law, flow or step.
        n: how many copies.
        shared: inputs that all copies have in common.
        distinct: parameters of which each copy has its own; derived ones that use them follow.
        axis: what the copies are; the dimension in logs.
        spread: of a block under ``every``, run the copies in different ticks: the first run of copy
            k comes ``k ticks // n`` later than that of the first one.

    Raises:
        BadInput: n is no whole number from 1 on, or an unknown name.
    """
    check_whole(f"replicate({block.name}): n", n)
    n, shared, distinct = int(n), tuple(shared), tuple(distinct)
    for names, known, what in (
        (shared, block.inputs, "input"),
        (distinct, block.params, "parameter"),
    ):
        for k in names:
            check_known(f"replicate: {block.name} has no {what}", k, known)
    own = [*block.states, *with_derived(block, distinct)]
    wide = {*own, *(k for k in block.inputs if k not in shared)}
    signals = [
        signal_of_copies(s, n, axis) if s.role == "output" or s.name in wide else s
        for s in block.signals
    ]
    signals = [_spread(s, block, n) for s in signals] if spread else signals
    given = [s for s in block.signals if s.role != "output"]
    made = [*block.states.values(), *block.outputs.values()]
    once = tuple(k for k, s in enumerate(given) if s.name not in wide)

    def mapped() -> ca.Function:
        f = block.function()
        return f.map(f"{f.name()}_x{n}", "serial", n, list(once), [])

    copies = block.of_equations(("copies", n, once), mapped)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        values = {**x, **u, **p}
        # a copy is a column
        columns = [values[s.name].T if s.name in wide and not s.shape else values[s.name]
                   for s in given]  # fmt: skip
        found = copies.call(columns)
        rows = [row if s.shape else row.T for s, row in zip(made, found, strict=True)]
        states = len(block.states)
        return (
            dict(zip(block.states, rows[:states], strict=True)),
            dict(zip(block.outputs, rows[states:], strict=True)),
        )

    def rebuild(parts: dict[str, Block]) -> Block:
        return replicate(parts[block.name], n, shared, distinct, axis, spread)

    many = Block(
        block.name, block.kind, body, signals, period=block.period, sx=False,
        doc=f"{block.doc}\n\n{n} copies.", choices=block.choices | {"copies": n},
        conditions=block.conditions,
        composition=Composition.around(block, rebuild, own=frozenset(own)),
    )  # fmt: skip
    many._made = block.of_equations(("copied", n, once, tuple(own)), dict)
    return many


def _spread(s: Signal, block: Block, n: int) -> Signal:
    """Signal of copies; what counts the ticks of an ``every`` begins for each with its own."""
    ticks = counters(block).get(s.name) if s.role == "state" else None
    if ticks is None:
        return s
    begin = np.asarray(s.value) - np.arange(n) * ticks // n
    return replace(s, value=begin % ticks)


def with_derived(block: Block, names: Iterable[str]) -> list[str]:
    """Parameters by name, and those that are derived from them, in the block's order."""
    found = set(names)
    for k, s in block.params.items():
        if (
            s.derived
            and k not in found
            and found & {block._sibling(k, m) for m in names_in(s.value)}
        ):
            return with_derived(block, found | {k})
    return [k for k in block.params if k in found]


def signal_of_copies(s: Signal, n: int, axis: str = "axle") -> Signal:
    """Signal of n copies, of which each has one."""
    value: Any = s.value
    if len(s.shape) > 1:
        if value is not None and not s.derived:
            value = np.tile(np.broadcast_to(value, s.shape), (1, n))
        return replace(s, shape=(s.shape[0], s.shape[1] * n), value=value, axis="")
    if s.shape and value is not None and not s.derived:
        value = np.repeat(np.broadcast_to(value, s.shape)[:, None], n, axis=1)
    return replace(s, shape=(*s.shape, n), value=value, axis=axis)
