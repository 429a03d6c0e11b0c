"""Loops over the same elements become one loop; an array read only at hand becomes a number.

What a loop computes depends on nothing that stands between it and the one before, so it may be done
there. Each value is computed from the same values in the same order, so the bits stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

_I = c.name("i")


def fuse_loops(lines: Sequence[Node]) -> list[Node]:
    """Statements of a C function, of which loops that may be one are one."""
    now = list(lines)
    while (other := next(_joined(now), None)) is not None:
        now = other
    return _numbers(now)


def body(loop: Node) -> tuple[Node, ...]:
    """Statements of a loop."""
    return loop.parts[3].parts


def _with_body(loop: Node, statements: Iterable[Node]) -> Node:
    return replace(loop, parts=(*loop.parts[:3], c.block(statements)))


def _joined(lines: list[Node]) -> Iterator[list[Node]]:
    """Statements with one loop less, for each two loops that may be one."""
    loops = [k for k, line in enumerate(lines) if line.kind == "for"]
    for n, a in enumerate(loops):
        for b in loops[n + 1 :]:
            begun = b
            while begun - 1 > a and _begins(lines[begun - 1]):
                begun -= 1
            same = lines[a].parts[:3] == lines[b].parts[:3]
            if same and _free(lines[a], lines[b], lines[a + 1 : begun], lines[begun:b]):
                whole = _with_body(lines[a], (*body(lines[a]), *body(lines[b])))
                yield [*lines[:a], *lines[begun:b], whole, *lines[a + 1 : begun], *lines[b + 1 :]]


def _begins(line: Node) -> bool:
    """Whether it declares what a loop fills: an array, or a number with its start."""
    if line.kind != "declare" or line.head not in ("double", "bool"):
        return False
    return line.parts[0].kind == "index" or c.target(line) is not None


def _free(a: Node, b: Node, between: Sequence[Node], begins: Sequence[Node]) -> bool:
    """Whether what loop b does, and what it begins with, may be done with loop a."""
    first, second = body(a), body(b)
    if any(n.kind == "for" for line in (*first, *second) for n in line.walk()):
        return False
    made_first, made_second = made_names(first), made_names([*second, *begins])
    made_between, used = made_names(between), used_names(second)
    if made_first & made_second or made_between & (used | used_names(begins)):
        return False
    if made_second & (used_names(between) | used_names(first)) or made_first & used_names(begins):
        return False
    at_i = [n.base.text for line in second for n in line.walk() if _is_here(n)]
    others = [
        n.base.text for line in first if (n := c.target(line)) is not None
        if n.kind == "index" and n.parts[1] != _I
    ]  # fmt: skip
    return all(
        at_i.count(name) and at_i.count(name) == _count(second, name) and name not in others
        for name in made_first & used
    )


def _is_here(n: Node) -> bool:
    return n.kind == "index" and n.parts[1] == _I


def _count(lines: Iterable[Node], name: str) -> int:
    return sum(n.kind in ("name", "member") and n.text == name for x in lines for n in x.walk())


def made_names(lines: Iterable[Node]) -> set[str]:
    """Names that statements give values to, or declare; ? where an address is passed on."""
    found = set[str]()
    for n in (n for line in lines for n in line.walk()):
        if n.kind == "declare" or (n.kind == "do" and c.target(n) is not None):
            to = c.target(n) or n.parts[0]
            found.add((to.parts[0] if to.kind == "unary" else to).base.text)
        if n.kind == "call" and any(p.kind == "unary" and p.head == "&" for p in n.parts):
            found.add("?")
    return found


def used_names(lines: Iterable[Node]) -> set[str]:
    """Names in statements, of members with their struct."""
    found: set[str] = set()
    waiting = list(lines)
    while waiting:
        n = waiting.pop()
        if n.kind == "member" and n.head.startswith("->") and n.parts[0].kind == "name":
            found.add(n.text)
            continue
        found |= {n.head} if n.kind == "name" else set()
        waiting += n.parts
    return found - {"i"}


def _numbers(lines: Sequence[Node]) -> list[Node]:
    """Statements in which an array that a loop fills and reads at hand is a number of its turn."""
    now = list(lines)
    for line in lines:
        array = (
            line.parts[0] if line.kind == "declare" and line.head in ("double", "bool") else None
        )
        if array is None or array.kind != "index" or array.parts[1].kind != "number":
            continue
        name, here = array.parts[0].head, c.index(array.parts[0], _I)
        last = c.index(array.parts[0], int(array.parts[1].head) - 1)
        given = [s for x in now if x.kind == "for" for s in body(x)
                 if c.target(s) is not None and s.kind == "do" and c.value(s) == here]  # fmt: skip
        carried = next((c.target(s) for s in given if s.parts[0].head == "="), None)
        if carried is not None and carried.kind == "name":  # its last value, behind the loop
            now = [x if x.kind == "for" else x.put(last, carried) for x in now]
        places = [k for k, x in enumerate(now) if x != line and _count([x], name)]
        if len(places) != 1 or now[places[0]].kind != "for":
            continue
        loop = now[places[0]]
        inside = [s for s in body(loop) if _count([s], name)]
        first, *rest = inside
        at_i = sum(n == here for s in inside for n in s.walk())
        if at_i != _count(inside, name) or any(c.target(s) == here for s in rest):
            continue
        plain = first.kind == "do" and first.parts[0].head == "=" and c.target(first) == here
        if not plain or _count([c.value(first)], name):
            continue
        own = c.declare(f"const {line.head}", name, c.value(first))
        made = [replace(own, told=first.told) if s is first else s for s in body(loop)]
        now[places[0]] = _with_body(loop, [s.put(here, array.parts[0]) for s in made])
        now.remove(line)
    return now
