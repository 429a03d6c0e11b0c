"""The equations of a Block as C: our own statements, and CasADi's text for what stays a call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.fields import VectorNames
from slipctl.ccode.module.parts import Parts
from slipctl.ccode.module.wires import Place, Wires
from slipctl.ccode.passes.precision import tolerant
from slipctl.ccode.passes.scratch import Arrays, off_stack
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.casadi_text import static_c
from slipctl.ccode.tree.expressions import ANY, FINITE, Unsupported
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.helpers import helpers
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.structure import Outside, Statements, drop_unused

KERNEL = ("---- text of CasADi's generator from here ----", "---- end of CasADi's text ----")
"""Marks around the functions that CasADi generated."""


@dataclass(frozen=True)
class Kernel:
    """C text of a Function.

    Attributes:
        lines: statements that compute the results, where the Function could be taken apart.
        results: C expression of each result by (output, element), beside ``lines``.
        finite: results that are finite whatever the arguments are.
        static: definitions of CasADi that the statements need, in order.
        entry: name of the C function ``(arg, res, iw, w, mem)`` that does it all, where the
            Function could not be taken apart; then there are no lines.
        calls: whether the statements call functions of CasADi, with ``arg``, ``res``, ``failed``.
        work: sizes of arg, res, iw, w.
        helpers: functions of ``HELPERS`` that are called.
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
    entry: str = ""
    calls: bool = False
    work: tuple[int, int, int, int] = (0, 0, 0, 0)
    helpers: frozenset[str] = field(default_factory=frozenset)
    copied: bool = False
    functions: Mapping[str, Node] = field(default_factory=dict)
    letters: frozenset[str] = frozenset()
    ticks: Mapping[str, int] = field(default_factory=dict)
    arrays: Mapping[str, Arrays] = field(default_factory=dict)
    enums: Mapping[str, tuple[str, int]] = field(default_factory=dict)


def kernel(
    f: ca.Function,
    read_input: Callable[[int, int], Node],
    names: Mapping[tuple[int, int], str],
    docs: Mapping[str, str],
    where: str,
    can_be: Callable[[int, int], int] = lambda i, k: ANY,
) -> Kernel:
    """Make the C text of a Function.

    Args:
        f: the equations.
        read_input: C expression of (argument, element).
        names: local names of results by (output, element).
        docs: comment by name of a nested Function.
        where: name of the block, for errors.
        can_be: what (argument, element) can be, as of :class:`Writer`.

    Raises:
        BadInput: CasADi cannot generate an operation, or not without library, heap or globals.
    """
    outside = Outside()
    try:
        made = Statements(f, read_input, outside, _branches, names, docs,
                          can_be=can_be)  # fmt: skip
    except Unsupported:
        whole = static_c([f], docs, where)
        return Kernel(
            static=whole.made, entry=whole.entries[0], work=whole.work, helpers=whole.helpers,
            copied=whole.copied,
        )  # fmt: skip
    results = {(i, k): made.result(i, k) for i in range(f.n_out()) for k in range(f.numel_out(i))}
    sure = frozenset(place for place in results if made.finite(*place))
    lines = drop_unused(made.lines, list(results.values()))
    if not any(f"CALL_{k}_" in c.words(lines) for k in range(len(outside.functions))):
        return Kernel(tuple(lines), results, sure, helpers=frozenset(made.helpers))
    text = static_c(outside.functions, docs, where)
    entries = {f"CALL_{k}_": entry for k, entry in enumerate(text.entries)}
    lines = [c.with_calls(line, entries) for line in lines]
    return Kernel(
        tuple(lines), results, sure, text.made, calls=True, work=text.work,
        helpers=frozenset(made.helpers | text.helpers), copied=text.copied,
    )  # fmt: skip


def by_parts(
    block: Block,
    wires: Wires,
    types: Mapping[str, Node],
    results: Sequence[Place],
    docs: Mapping[str, str],
    can_be: Callable[[Place, int], int],
    vector_names: VectorNames,
) -> Kernel:
    """Make the C text of a block, a function for each of its parts.

    Args:
        block: the whole.
        wires: where its signals lie.
        types: declaration of each struct that a function may be given, by its name.
        results: places of next states and outputs, in order.
        docs: comment by name of a nested Function.
        can_be: what an element of an argument can be.
        vector_names: what numbers in the vectors of Functions are.

    Raises:
        Unsupported: an operation that is left to CasADi's text.
    """
    functions = Functions(_branches, docs, vector_names=vector_names)
    parts = Parts(functions, types, can_be)
    parts.add(block, "", wires)
    places = [(i, m, p, k) for i, (m, p) in enumerate(results) for k in range(m.size)]
    made = off_stack(functions.made | parts.made, parts.lines, types["work"])
    return Kernel(
        made.lines,
        {(i, k): parts.results[m.c, p, k] for i, m, p, k in places},
        frozenset((i, k) for i, m, p, k in places if parts.known.get((m.c, p, k)) == FINITE),
        work=(0, 0, 0, made.numbers), helpers=frozenset(functions.helpers),
        functions=made.made, letters=frozenset(functions.letters), ticks=parts.ticks,
        arrays=made.arrays, enums=functions.enums,
    )  # fmt: skip


def _branches(g: ca.Function) -> tuple[ca.Function, ca.Function] | None:
    """What an if_else Function evaluates if true and otherwise; None of another Function."""
    if g.class_name() != "Switch":
        return None
    found = g.info()
    others = found["f"]
    return (found["f_def"], others[0]) if len(others) == 1 else None


def definitions(kernels: Iterable[Kernel], real: str = "double") -> list[Node]:
    """Helper functions and static definitions of several kernels."""
    made = list(kernels)
    found = helpers(set().union(*(k.helpers for k in made)))
    for k in made:
        if k.static:
            static = [tolerant(n) for n in k.static] if real == "float" else k.static
            found += [c.remark(KERNEL[0]), *static, c.remark(KERNEL[1])]
    return found
