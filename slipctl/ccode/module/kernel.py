"""The equations of a Block as C: our own statements, and CasADi's text for what stays a call."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from slipctl.block.block import Block
from slipctl.ccode.module.parts import Parts, Place, Wires
from slipctl.ccode.passes.precision import tolerant
from slipctl.ccode.passes.scratch import Arrays, off_stack
from slipctl.ccode.tree.casadi_text import casadi_c, chunks_of, signature, static_text
from slipctl.ccode.tree.expressions import ANY, FINITE, Unsupported
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.helpers import helper_text
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
        text: static definitions that the statements need, in order.
        entry: name of the C function ``(arg, res, iw, w, mem)`` that does it all, where the
            Function could not be taken apart; then there are no lines.
        calls: whether the statements call functions of CasADi, with ``arg``, ``res``, ``failed``.
        work: sizes of arg, res, iw, w.
        helpers: functions of ``HELPERS`` that are called.
        copied: whether text of CasADi's templates is in it.
        letters: names that locals have from the model.
        functions: C functions that ``lines`` call, by name: those of the parts, and what they call.
        ticks: from one run to the next, for each of ``lines`` that does not run in every tick.
        arrays: names and sizes of those that lie in the scratch memory, by function.
    """

    lines: tuple[str, ...] = ()
    results: Mapping[tuple[int, int], str] = field(default_factory=dict)
    finite: frozenset[tuple[int, int]] = frozenset()
    text: str = ""
    entry: str = ""
    calls: bool = False
    work: tuple[int, int, int, int] = (0, 0, 0, 0)
    helpers: frozenset[str] = field(default_factory=frozenset)
    copied: bool = False
    functions: Mapping[str, str] = field(default_factory=dict)
    letters: frozenset[str] = frozenset()
    ticks: Mapping[str, int] = field(default_factory=dict)
    arrays: Mapping[str, Arrays] = field(default_factory=dict)


def kernel(
    f: ca.Function,
    read_input: Callable[[int, int], str],
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
        made = Statements(f, read_input, outside, lambda g: _branches(g, where), names, docs,
                          can_be=can_be)  # fmt: skip
    except Unsupported:
        whole = static_text([f], docs, where)
        return Kernel(
            text=whole.text, entry=whole.entries[0], work=whole.work, helpers=whole.helpers,
            copied=whole.copied,
        )  # fmt: skip
    results = {(i, k): made.result(i, k) for i in range(f.n_out()) for k in range(f.numel_out(i))}
    sure = frozenset(place for place in results if made.finite(*place))
    lines = drop_unused(made.lines, list(results.values()))
    called = [g for k, g in enumerate(outside.functions) if f"CALL_{k}_" in " ".join(lines)]
    if not called:
        return Kernel(tuple(lines), results, sure, helpers=frozenset(made.helpers))
    text = static_text(outside.functions, docs, where)
    for k, entry in enumerate(text.entries):
        lines = [line.replace(f"CALL_{k}_(", f"{entry}(") for line in lines]
    return Kernel(
        tuple(lines), results, sure, text.text, calls=True, work=text.work,
        helpers=frozenset(made.helpers | text.helpers), copied=text.copied,
    )  # fmt: skip


def by_parts(
    block: Block,
    wires: Wires,
    signature: Callable[[str, str, Sequence[str]], str],
    results: Sequence[Place],
    docs: Mapping[str, str],
    can_be: Callable[[Place, int], int],
    work: str,
) -> Kernel:
    """Make the C text of a block, a function for each of its parts.

    Args:
        block: the whole.
        wires: where its signals lie.
        signature: declaration of a function, from its type, name and the structs that it takes.
        results: places of next states and outputs, in order.
        docs: comment by name of a nested Function.
        can_be: what an element of an argument can be.
        work: declaration of the scratch memory as an argument.

    Raises:
        Unsupported: an operation that is left to CasADi's text.
    """
    known: dict[int, tuple[ca.Function, tuple[ca.Function, ca.Function] | None]] = {}

    def branches(g: ca.Function) -> tuple[ca.Function, ca.Function] | None:
        key = g.__hash__()
        if key not in known:
            known[key] = g, _branches(g, block.name)
        return known[key][1]

    functions = Functions(branches, docs)
    parts = Parts(functions, signature, can_be)
    parts.add(block, "", wires)
    places = [(i, m, p, k) for i, (m, p) in enumerate(results) for k in range(m.size)]
    made = off_stack(functions.texts | parts.texts, parts.lines, work)
    ticks = {
        new: parts.ticks[old]
        for old, new in zip(parts.lines, made.lines, strict=True) if old in parts.ticks
    }  # fmt: skip
    return Kernel(
        made.lines,
        {(i, k): parts.results[m.c, p, k] for i, m, p, k in places},
        frozenset((i, k) for i, m, p, k in places if parts.known.get((m.c, p, k)) == FINITE),
        work=(0, 0, 0, made.numbers), helpers=frozenset(functions.helpers),
        functions=made.texts, letters=frozenset(functions.letters), ticks=ticks,
        arrays=made.arrays,
    )  # fmt: skip


def _branches(g: ca.Function, where: str) -> tuple[ca.Function, ca.Function] | None:
    """What an if_else Function evaluates if true and otherwise, read from CasADi's own text."""
    if g.class_name() != "Switch":
        return None
    chunks = chunks_of(casadi_c([g], where))
    own = [c.text for c in chunks if c.signature == signature(g)]  # it may hold others like it
    names = len(own) == 1 and re.search(
        r"if \(arg\[0\] \? casadi_to_int\(\*arg\[0\]\) : 0\) \{\s*"
        r"if \((\w+)\(arg\+1, res, iw, w, 0\)\) return 1;\s*\} else \{\s*"
        r"if \((\w+)\(arg\+1, res, iw, w, 0\)\) return 1;\s*\}",
        own[0],
    )
    if not names:
        return None
    signatures = {c.name: c.signature for c in chunks}
    found = []
    for name in names.groups():
        fitting = [h for h in g.find_functions() if signature(h) == signatures.get(name)]
        if len({h.serialize() for h in fitting}) != 1:
            return None
        found.append(fitting[0])
    return found[0], found[1]


def definitions(kernels: Iterable[Kernel], real: str = "double") -> str:
    """Helper functions and static text of several kernels."""
    helpers: set[str] = set()
    texts = []
    for k in kernels:
        helpers |= k.helpers
        if k.text:
            text = tolerant(k.text) if real == "float" else k.text
            texts.append(f"/* {KERNEL[0]} */\n\n{text}\n\n/* {KERNEL[1]} */")
    parts = [helper_text(helpers), *texts]
    return "\n".join(p for p in parts if p)
