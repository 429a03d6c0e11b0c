"""Calls of one function, each with what the one before gave, as a loop: steps of an iteration.

Nothing is computed in another order, so the bits stay. Numbers go in by value and come out by
address, so one variable does for both. Arrays come out beside, and are copied then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.graph import free_name, stem
from slipctl.ccode.tree.nodes import Node

LEAST = 3
"""Calls from which on they are a loop."""


@dataclass(frozen=True)
class _Call:
    """A call with the declarations before it: where it ends, name, arguments, sizes of locals."""

    end: int
    name: str
    arguments: tuple[Node, ...]
    sizes: dict[str, int]

    def given(self, k: int) -> str:
        """Local to which an argument is an address; none for another."""
        a = self.arguments[k]
        a = a.parts[0] if a.kind == "unary" and a.head == "&" else a
        return a.head if a.kind == "name" and a.head in self.sizes else ""


def roll_calls(lines: Sequence[Node], taken: set[str]) -> list[Node]:
    """Statements in which such calls are a loop.

    Args:
        lines: statements of a C function.
        taken: names that no local may have.
    """
    made, at = list(lines), 0
    while at < len(made):
        calls: list[_Call] = []
        begin = at
        while (call := _call(made, begin)) and (not calls or call.name == calls[0].name):
            calls.append(call)
            begin = call.end
        written = None
        if len(calls) >= LEAST:
            written = _written(calls, made[:at], made[calls[-1].end :], taken)
        if written is not None:
            made[at:] = written
        at += 1
    return made


def hand_results(lines: Sequence[Node]) -> list[Node]:
    """Statements in which a call writes where its result is wanted, not beside it first."""
    made = list(lines)
    for line in lines:
        to = c.target(line) if line.kind == "do" else None
        if to is None or to.kind != "unary" or c.value(line).kind != "name":
            continue
        name, wanted = c.value(line), to.parts[0]
        declared = c.declare("double", name)
        if declared not in made or sum(x.uses(wanted.head) for x in made) != 1:
            continue
        if sum(x.uses(name.head) for x in made) == 3:
            kept = [x for x in made if x not in (line, declared)]
            made = [x.put(c.address(name), wanted) for x in kept]
    return made


def _declared(line: Node) -> tuple[str, int] | None:
    """Local that is declared without a value, and its size."""
    if line.kind != "declare" or line.head != "double" or c.target(line) is not None:
        return None
    item = line.parts[0]
    return item.base.head, int(item.parts[1].head) if item.kind == "index" else 1


def _call(lines: Sequence[Node], at: int) -> _Call | None:
    """The call that begins at a statement, or at the declarations there."""
    sizes: dict[str, int] = {}
    while at < len(lines) and (found := _declared(lines[at])):
        sizes[found[0]] = found[1]
        at += 1
    e = lines[at].parts[0] if at < len(lines) and lines[at].kind == "do" else None
    return _Call(at + 1, e.head, e.parts, sizes) if e and e.kind == "call" and sizes else None


def _carried(calls: Sequence[_Call]) -> dict[int, int] | None:
    """Argument -> the one by which it came out of the call before; None if that differs."""
    carried: dict[int, int] = {}
    for a, b in pairwise(calls):
        if len(a.arguments) != len(b.arguments):
            return None
        out = {a.given(k): k for k in range(len(a.arguments)) if a.given(k)}
        for k, given in enumerate(b.arguments):
            known = out.get(given.text)
            if not b.given(k) and known is not None and carried.setdefault(k, known) != known:
                return None
    return carried


def _written(
    calls: Sequence[_Call], there: Sequence[Node], after: Sequence[Node], taken: set[str]
) -> list[Node] | None:
    """The loop and the statements behind it, with its names; None if these calls are none."""
    first, last = calls[0], calls[-1]
    carried = _carried(calls)
    outs = sorted({k for x in calls[:-1] for k in range(len(x.arguments)) if x.given(k)})
    if not carried or set(carried.values()) - set(outs):
        return None
    for a, b in pairwise(calls):
        for k, given in enumerate(b.arguments):
            known = c.name(a.given(carried[k])) if k in carried else a.arguments[k]
            if k not in outs and given != known:
                return None
    inner = {x.given(k) for x in calls[:-1] for k in outs}
    words = c.words(after)
    if inner & words or any(set(x.sizes) - {x.given(k) for k in outs} for x in calls):
        return None
    used = {*taken, *words, *c.words(there)}
    used |= c.words(a for k, a in enumerate(first.arguments) if not first.given(k))
    start = {carried[k]: first.arguments[k] for k in carried}
    sizes = {k: first.sizes[first.given(k)] for k in outs}
    names: dict[int, Node] = {}
    for k in outs:
        here = k in start and c.declare("double", start[k], size=sizes[k]) in there
        if here and start[k].head not in words:  # nobody else reads it
            names[k] = start[k]
            continue
        names[k] = c.name(free_name(f"{_stem(first.given(k))}_now", used))
        used.add(names[k].head)
    ahead, before, behind = list[Node](), list[Node](), list[Node]()
    given_ = [names[carried[k]] if k in carried else a for k, a in enumerate(first.arguments)]
    for k in outs:
        size, own = sizes[k], names[k] == start.get(k)
        if size > 1 and k in start:
            other = c.name(free_name(f"{_stem(names[k].head)}_next", used))
            used.add(other.head)
            if not own:
                ahead += [c.declare("double", names[k], size=size), _copy(names[k], start[k], size)]
            before.append(c.declare("double", other, size=size))
            behind.append(_copy(names[k], other, size))
            given_[k] = other
        else:
            if not own:
                ahead.append(c.declare("double", names[k], start.get(k), size))
            given_[k] = c.address(names[k]) if size == 1 else names[k]
    rolled = [c.loop(len(calls), [*before, c.do(c.call(first.name, given_)), *behind])]
    for k in outs:
        if not last.given(k):  # an array that is wanted elsewhere
            to = last.arguments[k]
            to = to.parts[0] if to.kind == "unary" else to
            rolled.append(_copy(to, names[k], sizes[k]) if sizes[k] > 1 else c.assign(to, names[k]))
    renamed = {last.given(k): names[k] for k in outs if last.given(k)}
    return [*ahead, *rolled, *c.swap_all(after, renamed)]


def _copy(to: Node, source: Node, size: int) -> Node:
    return c.do(c.call("copy", [to, source, c.integer(size)]))


def _stem(name: str) -> str:
    base, _, word = stem(name).rpartition("_")
    return base if base and word in ("next", "now") else stem(name)
