"""Expressions read back: CasADi SX to a graph, which ``plain_text`` writes as formulas.

The letters of intermediate results (``F_a = mu*m*g``) are those of the local variables of the
function that wrote the equations, see :func:`letters`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType, FrameType
from typing import Any, NamedTuple

import casadi as ca

from slipctl.block.text.intermediates import watch_calls

LONG = 60
"""Operations in one formula; what goes beyond is given a letter of its own."""

COMPARISONS = ("lt", "le", "eq", "ne")

HIDDEN = re.compile(r"one\[(.*)\]")
"""Name of the symbol that stands for a hidden unit constant."""


class Node(NamedTuple):
    """One operation: CasADi's name for it, its arguments, and a number or a symbol's name."""

    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    name: str = ""


@dataclass
class Graph:
    """Equations as one graph without repeated nodes; arguments come before their users.

    Attributes:
        nodes: all operations.
        roots: for each equation, the node of each of its elements, column by column.
        letters: names of intermediate results, by node.
    """

    nodes: list[Node] = field(default_factory=list)
    roots: dict[str, list[int]] = field(default_factory=dict)
    letters: dict[int, str] = field(default_factory=dict)

    def below(self, start: list[int], but: Container[int] = ()) -> list[int]:
        """Nodes that the given ones are made of, themselves included, in order of evaluation.

        What is behind those of ``but`` is left out, and so are they.
        """
        seen, waiting = set(start), list(start)
        while waiting:
            new = [a for a in self.nodes[waiting.pop()].args if a not in seen and a not in but]
            seen.update(new)
            waiting += new
        return sorted(seen)


@contextmanager
def letters(code: CodeType) -> Iterator[dict[str, Any]]:
    """Collect the local SX variables of a function, and of those it calls directly.

    Args:
        code: code of the function which calls the page of equations, ``body.__code__``.

    Yields:
        A dict that is filled when the function returns, SX results by the name of the variable.
    """
    found: dict[str, Any] = {}

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event != "return":
            return
        caller = frame.f_back
        if frame.f_code is not code and (caller is None or caller.f_code is not code):
            return
        module = frame.f_globals.get("__name__", "")
        if module == "slipctl.block.block" or module.startswith("casadi"):
            return
        for name, value in frame.f_locals.items():
            if isinstance(value, ca.SX) and value.numel() and not name.startswith("_"):
                found.setdefault(name, value)

    token = _told.set(found)
    try:
        with watch_calls(watch):
            yield found
    finally:
        _told.reset(token)


_told: ContextVar[dict[str, Any] | None] = ContextVar("_told", default=None)


def tell(name: str, value: Any) -> None:
    """Give an intermediate result its letter, where there is no local variable to have it."""
    found = _told.get()
    if found is not None and isinstance(value, ca.SX):
        found.setdefault(name, value)


@lru_cache(maxsize=1)
def _operations() -> dict[int, str]:
    return {getattr(ca, n): n[3:].lower() for n in dir(ca) if n.startswith("OP_")}


def graph(equations: Mapping[str, Any], names: Mapping[str, Any] | None = None) -> Graph:
    """Read expressions into one graph.

    Args:
        equations: SX expressions (or numbers) by name.
        names: SX intermediate results by letter, as :func:`letters` finds them.
    """
    wanted = {k: ca.densify(ca.SX(v)) for k, v in equations.items()}
    extra = {k: ca.densify(v) for k, v in (names or {}).items()}
    outputs = [*wanted.values(), *extra.values()]
    symbols = ca.symvar(ca.veccat(*outputs)) if outputs else []
    f = ca.Function("f", symbols, outputs)
    operations = _operations()
    g = Graph()
    index: dict[Node, int] = {}
    register: dict[int, int] = {}
    results: list[list[int]] = [[0] * e.numel() for e in outputs]

    def add(node: Node) -> int:
        key = node if not math.isnan(node.value) else node._replace(value=0.0, name="nan")
        if key not in index:
            index[key] = len(g.nodes)
            g.nodes.append(node)
        return index[key]

    for k in range(f.n_instructions()):
        op = operations[f.instruction_id(k)]
        read, written = f.instruction_input(k), f.instruction_output(k)
        if op == "input":
            register[written[0]] = add(Node("symbol", name=symbols[read[0]].name()))
        elif op == "const":
            register[written[0]] = add(Node("const", value=f.instruction_constant(k)))
        elif op == "output":
            results[written[0]][written[1]] = register[read[0]]
        else:
            args = tuple(register[r] for r in read if r >= 0)
            for i, w in enumerate(written):
                if w >= 0:
                    register[w] = add(Node(op, args, float(i)))
    g.roots = dict(zip(wanted, results, strict=False))
    _name(g, dict(zip(extra, results[len(wanted) :], strict=True)))
    return g


def _name(g: Graph, found: Mapping[str, list[int]]) -> None:
    """Give letters to intermediate results, leaving out those that would mislead."""
    taken = {n.name for n in g.nodes if n.op == "symbol"}
    roots = {n for root in g.roots.values() for n in root}
    live = set(g.below(list(roots)))
    used = {a for n in live for a in g.nodes[n].args}
    own = {root[0]: k for k, root in g.roots.items() if len(root) == 1}
    for name, nodes in found.items():
        if name in taken or (name in g.roots and g.roots[name] != nodes):
            continue
        for i, n in enumerate(nodes):
            whole = n in roots and n not in used  # an equation that has a name already
            if n not in live or not g.nodes[n].args or (whole and own.get(n) != name):
                continue
            if own.get(n, name) in (name, *(k for k in g.roots if k not in found)):
                g.letters.setdefault(n, name if len(nodes) == 1 else f"{name}[{i}]")


def shorten(g: Graph, long: int = LONG, prefixes: str = "azqhw") -> None:
    """Give letters ``a1, a2, ...`` to parts that would make a formula longer than ``long``."""
    roots = [n for root in g.roots.values() for n in root]
    live = g.below(roots)
    users = dict.fromkeys(live, 0)
    for n in live:
        for a in g.nodes[n].args:
            users[a] += 1
    names = {n.name for n in g.nodes} | set(g.letters.values()) | set(g.roots)
    prefix = next(
        p for p in (*prefixes, "part") if not any(re.fullmatch(p + r"\d+", n) for n in names)
    )
    size: dict[int, int] = {}
    count = 0
    for n in live:
        node = g.nodes[n]
        size[n] = 1 + sum(1 if a in g.letters else size[a] for a in node.args)
        logic = node.op in (*COMPARISONS, "not", "if_else_zero") or is_tie(g, n)
        if n in g.letters or logic or n in roots:
            continue
        if size[n] > long or (users[n] > 1 and size[n] > long // 4):
            count += 1
            g.letters[n] = f"{prefix}{count}"


def is_tie(g: Graph, n: int) -> bool:
    """Whether a node is (a <= b) + (b <= a), by which CasADi splits the slope of min and max."""
    op, args, *_ = g.nodes[n]
    if op != "add":
        return False
    first, second = (g.nodes[a] for a in args)
    return first.op == second.op == "le" and first.args == second.args[::-1]


def named_nodes(g: Graph) -> list[tuple[str, int]]:
    """Letters with their nodes, in order of evaluation; results named as an equation left out."""
    return [(g.letters[n], n) for n in sorted(g.letters) if g.letters[n] not in g.roots]
