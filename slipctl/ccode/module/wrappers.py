"""What a block is around another one for: several of it, or one that does not run in each tick."""

from __future__ import annotations

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import slower

NO_END = 1e300
"""In the place of an end of a range that there is none of."""


def runs_of(block: Block) -> tuple[Block, int, str, dict[str, str]] | None:
    """Block inside an ``every``, its ticks, the counter, and held states by output."""
    made = slower(block)
    if made is None:
        return None
    counter, ticks = made
    (inner,) = block.parts.values()
    kept = [n for n in block.states if n not in inner.states and n != counter]
    if len(kept) != len(inner.outputs) or list(inner.params) != list(block.params):
        return None
    return inner, ticks, counter, dict(zip(kept, inner.outputs, strict=True))


def is_copies(block: Block) -> bool:
    """Whether a block is copies of another, made by ``replicate``."""
    inner = _inner(block, "copies")
    return (
        inner is not None
        and list(inner.states) == list(block.states)
        and list(inner.outputs) == list(block.outputs)
        and all(s.shape != inner.outputs[n].shape for n, s in block.outputs.items())
    )


def gate_of(block: Block) -> str:
    """Input that a block made by ``gated`` has more than what it is around; "" of another."""
    inner = _inner(block, "gated by")
    more = set(block.inputs) - set(inner.inputs) if inner is not None else set()
    return more.pop() if len(more) == 1 else ""


def begins_anew(block: Block) -> bool:
    """Whether a block begins anew where a state leaves its range, and tells that by an output."""
    inner = _inner(block, "contained")
    return inner is not None and len(set(block.outputs) - set(inner.outputs)) == 1


def _inner(block: Block, choice: str) -> Block | None:
    """What a block made with this choice is around."""
    if not block.transparent or choice not in block.choices or len(block.parts) != 1:
        return None
    return next(iter(block.parts.values()))
