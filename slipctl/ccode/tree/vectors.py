"""Vectors in C: which elements of which array they are, and loops over them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

AT = c.name("@")
"""Stands for the index of the element in the C of a vector."""

_WORKED_OUT: dict[str, Callable[[int, int], int]] = {
    "+": operator.add, "*": operator.mul, "/": operator.floordiv, "%": operator.mod,
}  # fmt: skip


def element(vector: Node, k: int | Node) -> Node:
    """One element of a vector: number k, or that of a loop."""
    at = c.integer(k) if isinstance(k, int) else k
    if AT.head not in vector.words:
        return vector

    def rule(n: Node) -> Node | None:
        if n.kind == "index" and AT.head in n.parts[1].words:
            return c.index(element(n.parts[0], at), _computed(n.parts[1].swap({AT.head: at})))
        return at if n == AT else None

    return vector.change(rule)


def _computed(index: Node) -> Node:
    """An index, with what is of numbers alone worked out if that is all of it."""
    value = _value(index)
    if value is not None:
        return c.integer(value)

    def rule(n: Node) -> Node | None:
        begins = n.kind == "op" and n.head == "+" and n.parts[0] == c.ZERO
        return n.parts[1].change(rule) if begins else None

    return index.change(rule)


def _value(n: Node) -> int | None:
    if n.kind == "number":
        return int(n.head)
    values = [_value(p) for p in n.parts]
    if n.kind == "paren":
        return values[0]
    if n.kind != "op" or None in values:
        return None
    return _WORKED_OUT[n.head](*values)  # type: ignore[arg-type]


def place(base: Node, offset: int, stride: int = 1) -> Node:
    """The element of a vector that lies in an array."""
    step = AT if stride == 1 else c.op(c.integer(stride), "*", AT)
    return c.index(base, c.op(c.integer(offset), "+", step) if offset else step)


def array_and_offset(vector: Node) -> tuple[Node, int] | None:
    """Array and offset of a vector that lies side by side in memory."""
    if vector.kind != "index" or not is_place(vector.parts[0]):
        return None
    at = vector.parts[1]
    if at == AT:
        return vector.parts[0], 0
    if at.kind == "op" and at.head == "+" and at.parts[0].kind == "number" and at.parts[1] == AT:
        return vector.parts[0], int(at.parts[0].head)
    return None


def is_place(n: Node) -> bool:
    """Whether it is a variable, or a member of one."""
    return n.kind == "name" or (n.kind == "member" and is_place(n.parts[0]))


def address(base: Node, offset: int) -> Node:
    """Address of an element."""
    return c.address(c.index(base, offset))


def by_blocks(places: Sequence[int], offset: int) -> Node | None:
    """Index of elements that are taken in blocks as far apart as each other: ``@ / 5 * 31 + ...``.

    None if they are not, or are fewer than eight.
    """
    n, first = len(places), places[0]
    if n < 8 or min(places) < 0:
        return None
    for size in (k for k in range(1, n) if n % k == 0):
        step = places[1] - first if size > 1 else 0
        apart = places[size] - first
        wanted = [first + k // size * apart + k % size * step for k in range(n)]
        if wanted != list(places) or step < 0 or apart <= 0:
            continue
        found = c.op(AT if size == 1 else c.op(AT, "/", c.integer(size)), "*", c.integer(apart))
        if first + offset:
            found = c.op(c.integer(first + offset), "+", found)
        if size > 1 and step > 0:
            inside = c.op(AT, "%", c.integer(size))
            inside = inside if step == 1 else c.op(inside, "*", c.integer(step))
            found = c.op(found, "+", inside)
        return found
    return None


def loop(n: int, statement: Node) -> list[Node]:
    """A loop over n elements, of a statement with ``AT`` in it; a call where it only moves them."""
    to = c.target(statement)
    where = array_and_offset(to) if to is not None else None
    if where is not None and statement.parts[0].head == "=":
        given, count = c.value(statement), c.integer(n)
        if given.kind == "number" or (given.kind == "unary" and given.parts[0].kind == "number"):
            return [c.do(c.call("fill", [address(*where), count, given]))]
        if (source := array_and_offset(given)) is not None:
            return [c.do(c.call("copy", [address(*where), address(*source), count]))]
    return [c.loop(n, [element(statement, c.name("i"))])]


def array_of(kind: str, array: Node | str, values: Iterable[Node]) -> Node:
    """Declaration of an array with its elements."""
    given = Node("list", "", tuple(values))
    base = c.name(array) if isinstance(array, str) else array
    return c.declare(kind, c.index(base, len(given.parts)), given)
