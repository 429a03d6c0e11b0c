"""The equations of a Block as C: its parts, and CasADi's text for those that need it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from slipctl.block.block import Block
from slipctl.block.fields import VectorNames
from slipctl.ccode.module.parts import Parts
from slipctl.ccode.module.wires import Place, Wires
from slipctl.ccode.passes.scratch import Arrays, off_stack
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.casadi_text import StaticC, static_c
from slipctl.ccode.tree.expressions import FINITE
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.nodes import Node

KERNEL = ("---- text of CasADi's generator from here ----", "---- end of CasADi's text ----")
"""Marks around the functions that CasADi generated."""


@dataclass(frozen=True)
class Kernel:
    """C text of the equations: a function for each part.

    Attributes:
        lines: statements that call the parts, in the order of the wires.
        results: what tells that two results are one number, by (result, element).
        finite: results that are finite whatever the arguments are.
        static: definitions of CasADi that the parts need, in order; where there are some, the parts
            tell in ``work->failed`` whether they came to an end.
        work: sizes of arg, res, iw, w.
        copied: whether text of CasADi's templates is in it.
        letters: names that locals have from the model.
        functions: C functions that ``lines`` call, by name: those of the parts, and what they call.
        ticks: from one run to the next, by the function of a part that does not run in every tick.
        arrays: names and sizes of those that lie in the scratch memory, by function.
        enums: what a vector is, and the place of a number in it, by the number's name.
    """

    lines: tuple[Node, ...] = ()
    results: Mapping[tuple[int, int], Node] = field(default_factory=dict)
    finite: frozenset[tuple[int, int]] = frozenset()
    static: tuple[Node, ...] = ()
    work: tuple[int, int, int, int] = (0, 0, 0, 0)
    copied: bool = False
    functions: Mapping[str, Node] = field(default_factory=dict)
    letters: frozenset[str] = frozenset()
    ticks: Mapping[str, int] = field(default_factory=dict)
    arrays: Mapping[str, Arrays] = field(default_factory=dict)
    enums: Mapping[str, tuple[str, int]] = field(default_factory=dict)

    @property
    def in_arrays(self) -> int:
        """Numbers in all arrays that lie in the scratch memory."""
        return sum(n for rows in self.arrays.values() for _, n in rows)


def by_parts(
    block: Block,
    wires: Wires,
    types: Mapping[str, Node],
    results: Sequence[Place],
    docs: Mapping[str, str],
    vector_names: VectorNames,
) -> Kernel:
    """Make the C text of a block, a function for each of its parts.

    Args:
        block: the whole.
        wires: where its signals lie.
        types: declaration of each struct that a function may be given, by its name.
        results: places of next states and outputs, in order.
        docs: comment by name of a nested Function.
        vector_names: what numbers in the vectors of Functions are.

    Raises:
        BadInput: CasADi cannot generate an operation, or not without library, heap or globals.
    """
    functions = Functions(docs, vector_names=vector_names)
    parts = Parts(functions, types)
    parts.add(block, "", wires)
    made, lines, outside = functions.made | parts.made, list(parts.lines), StaticC()
    if parts.outside:
        outside = static_c(parts.outside, docs, block.name)
        names = {f.name(): entry for f, entry in zip(parts.outside, outside.entries, strict=True)}
        made = {name: c.with_calls(f, names) for name, f in made.items()}
    placed = off_stack(made, lines, types["work"])
    places = [(i, m, p, k) for i, (m, p) in enumerate(results) for k in range(m.size)]
    found = Kernel(
        placed.lines,
        {(i, k): parts.results[m.c, p, k] for i, m, p, k in places},
        frozenset((i, k) for i, m, p, k in places if parts.known.get((m.c, p, k)) == FINITE),
        outside.made, outside.work, outside.copied,
        placed.made, frozenset(functions.letters), parts.ticks, placed.arrays, functions.enums,
    )  # fmt: skip
    sz_arg, sz_res, sz_iw, sz_w = outside.work
    if parts.outside:
        sz_iw, sz_w = max(sz_iw, 1), max(sz_w, 1)
    return replace(found, work=(sz_arg, sz_res, sz_iw, sz_w + found.in_arrays))
