"""Outputs that were asked for, as the wires of a connection name them; the rest is measured.

The parts of a connection give each other their outputs, ``estimator.c``. Whoever calls the C asks
for those that a wire leads out, ``T_cmd``. The others lie in the state, for a calibration tool.
"""

from __future__ import annotations

from dataclasses import replace

from slipctl.block.block import Block, Exprs


def inner_outputs(block: Block) -> list[str]:
    """Outputs of a block's parts that nobody asked for; none where no wire leads out."""
    inner = [n for n in block.outputs if "." in n]
    return inner if len(inner) < len(block.outputs) else []


def asked_outputs(block: Block) -> Block:
    """The block without the outputs that only its parts give each other."""
    inner = inner_outputs(block)
    if not inner:
        return block

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        packed = block.pack("state", x), block.pack("input", u), block.pack("param", p)
        nxt, y = block.f(*packed)
        told = block.unpack("output", y)
        return block.unpack("state", nxt), {n: told[n] for n in block.outputs if n not in inner}

    rebuild = block.composition.rebuild
    made_of = block.composition
    if rebuild is not None:
        made_of = replace(made_of, rebuild=lambda *parts: asked_outputs(rebuild(*parts)))
    return Block(
        block.name, block.kind, body, [s for s in block.signals if s.name not in inner
                                       or s.role != "output"],
        period=block.period, sx=False, doc=block.doc, choices=block.choices,
        conditions=block.conditions, composition=made_of, law_data=block.law_data,
    )  # fmt: skip
