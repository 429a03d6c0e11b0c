"""In which order the parts of a connection are called, and what its outputs depend on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from slipctl.block.block import Block
from slipctl.block.functions import rows_by_signal
from slipctl.block.signals import Signal, total_size
from slipctl.errors import BadInput

End = tuple[str, str]
"""A part and one of its signals."""

Call = tuple[str, list[str], bool]
"""One evaluation of a part: its name, the outputs to take, and whether it is the last one."""


def calls_of_parts(name: str, blocks: Mapping[str, Block], inner: Mapping[End, End]) -> list[Call]:
    """Order of evaluation; a part whose outputs become known in pieces is called in pieces.

    Raises:
        BadInput: an algebraic loop, told by its path.
    """
    known = {(b, n) for b, block in blocks.items() for n in block.states if n not in block.outputs}
    waiting = dict.fromkeys(blocks)
    plan: list[Call] = []

    def is_known(b: str, port: str) -> bool:
        source = inner.get((b, port))
        return source is None or source in known

    while waiting:
        whole = next((b for b in waiting if all(is_known(b, n) for n in blocks[b].inputs)), None)
        if whole is not None:
            outputs = [n for n in blocks[whole].outputs if (whole, n) not in known]
            plan.append((whole, outputs, True))
            known |= {(whole, n) for n in outputs}
            del waiting[whole]
            continue
        missing = {
            b: [inner[b, n] for n in blocks[b].inputs if not is_known(b, n)] for b in waiting
        }
        wanted = _leading_to(missing[_on_circle(missing)], blocks, inner, known)
        for b in waiting:
            ready = [
                n for n, needs in blocks[b].feedthrough().items()
                if (b, n) in wanted and all(is_known(b, k) for k in needs)
            ]  # fmt: skip
            if ready:
                plan.append((b, ready, False))
                known |= {(b, n) for n in ready}
                break
        else:
            raise BadInput(f"{name}: algebraic loop {_loop_path(blocks, inner, known)}")
    return plan


def _on_circle(missing: Mapping[str, Sequence[End]]) -> str:
    """Part that waits for itself: the walk back from part to part comes to it again."""
    trail = [next(iter(missing))]
    while trail[-1] not in trail[:-1]:
        trail.append(missing[trail[-1]][0][0])
    return trail[-1]


def _leading_to(
    ends: Sequence[End], blocks: Mapping[str, Block], inner: Mapping[End, End], known: set[End]
) -> set[End]:
    """Unknown outputs that some outputs need, themselves included.

    A part is called for no others before its turn, so that nothing dear is worked out twice.
    """
    found: set[End] = set()
    ahead = list(ends)
    while ahead:
        b, n = ahead.pop()
        if (b, n) not in found | known:
            found.add((b, n))
            ahead += [inner[b, k] for k in blocks[b].feedthrough()[n] if (b, k) in inner]
    return found


def _loop_path(blocks: Mapping[str, Block], inner: Mapping[End, End], known: set[End]) -> str:
    """Walk back from an output that cannot be computed until one comes again."""
    node = next(
        (b, n)
        for b, block in blocks.items()
        for n in block.outputs
        if (b, n) not in known and any((b, k) in inner for k in block.feedthrough()[n])
    )
    trail: list[End] = []
    while node not in trail:
        trail.append(node)
        b, n = node
        node = next(
            inner[b, k]
            for k in blocks[b].feedthrough()[n]
            if (b, k) in inner and inner[b, k] not in known
        )
    cycle = trail[trail.index(node) :][::-1]
    path = " -> ".join(f"{b}.{n}" for b, n in [*cycle, cycle[0]])
    return f"{path}; break it with a unit_delay() or with a state"


def dependence_of_parts(
    blocks: Mapping[str, Block],
    plan: Sequence[Call],
    inner: Mapping[End, End],
    free: Mapping[End, str],
    signals: Sequence[Signal],
    outer: Iterable[End],
) -> np.ndarray:
    """Which elements of a connection's inputs each element of its outputs depends on.

    It follows from the parts alone, without the function of the whole.

    Args:
        blocks, plan, inner: the parts, the order of their calls, and what feeds their inputs.
        free: name of the connection's own input that feeds each of the others.
        signals: those of the connection.
        outer: what feeds the outputs that it has besides those of its parts.
    """
    inputs = {s.name: s for s in signals if s.role == "input"}
    width = total_size(inputs.values())
    own = rows_by_signal(inputs, np.eye(width, dtype=bool))
    # a state depends on no input, and what is called does not need what is not known yet
    found: dict[End, np.ndarray] = {
        (b, n): np.zeros((s.size, width), dtype=bool)
        for b, block in blocks.items()
        for n, s in {**block.states, **block.outputs}.items()
    }
    nothing = np.zeros((0, width), dtype=bool)
    for b, outputs, _ in plan:
        block = blocks[b]
        fed = [own[free[b, n]] if (b, n) in free else found[inner[b, n]] for n in block.inputs]
        each = rows_by_signal(block.outputs, block.dependence() @ np.vstack([nothing, *fed]))
        found |= {(b, n): each[n] for n in outputs}
    of_parts = [found[b, n] for b, block in blocks.items() for n in block.outputs]
    return np.vstack([nothing, *of_parts, *(found[end] for end in outer)])
