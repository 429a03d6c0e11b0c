"""Members that are given values: without a local beside them, and side by side by one ``copy``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.printer import STEP, lines_of


def place_locals(lines: Sequence[Node], indent: str = STEP) -> list[Node]:
    """Statements in which a local that a member is given is that member, where this is shorter.

    Of a local that several members are given it is the first.
    """
    now = [_inside(line, indent) for line in lines]
    for line in list(now):
        name = c.target(line) if line.kind == "declare" and line.head == "const double" else None
        if name is None or name.kind != "name" or line not in now:
            continue
        at = now.index(line)
        to = next((k for k in range(at + 1, len(now)) if _is_given(now[k], name)), None)
        member = c.target(now[to]) if to is not None else None
        if to is None or member is None:
            continue
        told = line.told or now[to].told
        rest = [x for k, x in enumerate(now[at + 1 :], at + 1) if k != to]
        first = c.assign(member, c.value(line), told=told)
        tried = [*now[:at], first, *c.swap_all(rest, {name.head: member})]
        if len(lines_of(tried, indent)) < len(lines_of(now, indent)):
            now = tried
    return now


def _inside(line: Node, indent: str) -> Node:
    """A statement, with this done in its blocks."""
    if line.kind not in ("if", "for", "while"):
        return line
    parts = [
        c.block(place_locals(p.parts, indent + STEP)) if p.kind == "block" else _inside(p, indent)
        for p in line.parts
    ]
    return replace(line, parts=tuple(parts))


def _is_given(line: Node, name: Node) -> bool:
    to = c.target(line) if line.kind == "do" and line.parts[0].head == "=" else None
    return to is not None and to.kind == "member" and to.parts[0] in (
        c.name("next"), c.name("now")) and c.value(line) == name  # fmt: skip


def copy_statements(lines: Sequence[Node], least: int = 3) -> list[Node]:
    """Statements in which elements that move side by side are one call of ``copy``."""
    made: list[Node] = []
    k = 0
    while k < len(lines):
        first, n = _moved(lines[k]), 1
        while first and k + n < len(lines) and _moved(lines[k + n]) == (
            first[0], first[1] + n, first[2], first[3] + n,
        ):  # fmt: skip
            n += 1
        if first and n >= least and first[0] != first[2]:
            to, at, source, begin = first
            ends = [c.address(c.index(to, at)), c.address(c.index(source, begin))]
            made.append(c.do(c.call("copy", [*ends, c.integer(n)])))
        else:
            made += lines[k : k + n]
        k += n
    return made


def _moved(line: Node) -> tuple[Node, int, Node, int] | None:
    """Element of a member that is given an element of one: both with their numbers."""
    to = c.target(line) if line.kind == "do" and line.parts[0].head == "=" else None
    both = [to, c.value(line)] if to is not None else []
    if not both or any(
        n is None or n.kind != "index" or n.parts[1].kind != "number"
        or n.parts[0].kind != "member" or n.parts[0].parts[0].kind != "name" for n in both
    ):  # fmt: skip
        return None
    (a, i), (b, k) = (n.parts for n in both if n is not None)
    return a, int(i.head), b, int(k.head)
