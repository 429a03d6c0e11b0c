"""Calls in CasADi's C that write where their result is copied to, not beside it first.

A result that a function gives on is an argument of its own: what it calls writes there. Nothing
else reads it, and results never lie where arguments do. So the bits stay.
"""

from __future__ import annotations

from collections.abc import Sequence

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

_GIVEN = ("arg1", "res1", "iw", "w", "0")
"""What is passed to a Function that is called."""


def direct(body: Node) -> Node:
    """Statements of one function with as many such calls as there are."""
    lines = [_element(s) for s in body.parts]
    taken: set[int] = set()
    for end, line in enumerate(lines):
        copied = _copy(line)
        begin = _begin(lines, end, copied[0]) if copied else None
        if copied is None or begin is None:
            continue
        _, to = copied
        whole = to.parts[0] if to.kind == "op" else to
        there = c.paren(c.op(whole, "!=", c.name("NULL")))
        place = to if to is whole else Node("choice", "", (there, to, c.name("NULL")))
        lines[begin] = c.assign(lines[begin].parts[0].parts[0], place)
        lines[end] = Node("blank")
        taken |= {end - 1, end} if lines[end - 1].kind == "comment" else {end}
    left = [x for k, x in enumerate(lines) if k not in taken]
    used = c.words(x for x in left if x.kind != "declare")
    return c.block(s for x in left if (s := _declared(x, used)) is not None)


def _element(s: Node) -> Node:
    """A loop over one element as the statement in it."""
    if s.kind != "for" or s.parts[0].kind != "do" or s.parts[0].parts[0].head != ",":
        return s
    first, second = s.parts[0].parts[0].parts
    ends, turn = s.parts[1], s.parts[3].parts[0]
    to = first.parts[1].parts[0] if first.head == "=" and first.parts[1].kind == "paren" else None
    if to is None or second.head != "=" or turn.text != "*rr++ = *cs;" or ends.head != "!=":
        return s
    begin, end = second.parts[1], ends.parts[1]
    if begin.head != "+" or end.head != "+" or to.head != "&":
        return s
    only = int(end.parts[1].head) == int(begin.parts[1].head) + 1
    element = c.index(begin.parts[0], int(begin.parts[1].head))
    return c.assign(to.parts[0], element) if only else s


def _copy(s: Node) -> tuple[str, Node] | None:
    """Local that is copied to a result, and the address of that."""
    if s.kind == "if" and len(s.parts) == 2 and len(s.parts[1].parts) == 1:
        return _copy(s.parts[1].parts[0])
    e = s.parts[0] if s.kind == "do" else None
    if e is None or e.kind != "call" or e.head != "casadi_copy" or e.parts[0].kind != "name":
        return None
    to = e.parts[2].parts[0] if e.parts[2].kind == "op" else e.parts[2]
    result = to.kind == "index" and to.parts[0] == c.name("res")
    return (e.parts[0].head, e.parts[2]) if result else None


def _begin(lines: Sequence[Node], end: int, name: str) -> int | None:
    """Statement that gives a local to a call, whose result is copied in ``end`` and only there."""
    places = [k for k, x in enumerate(lines) if x.kind != "declare" and x.uses(name)]
    before = max((k for k in places if k < end), default=0)
    after = min((k for k in places if k > end), default=None)
    if not _is_passed(lines[before], name):
        return None
    called = any(
        n.kind == "call" and tuple(p.text for p in n.parts) == _GIVEN
        for x in lines[before:end] for n in x.walk()
    )  # fmt: skip
    return before if called and (after is None or _anew(lines[after], name)) else None


def _is_passed(s: Node, name: str) -> bool:
    to = c.target(s)
    return to is not None and to.base == c.name("res1") and c.value(s) == c.name(name)


def _anew(s: Node, name: str) -> bool:
    """Whether a statement writes a local from end to end, and does not read it."""
    if s.uses(name) > 1:
        return False
    begins = c.op(c.name("rr"), "=", c.name(name))
    if s.kind == "do":
        e = s.parts[0]
        filled = e.kind == "call" and e.head == "casadi_copy" and e.parts[-1] == c.name(name)
        return filled or e == begins or _is_passed(s, name)
    turn = s.parts[3].parts[0] if s.kind == "for" and len(s.parts[3].parts) == 1 else None
    to = c.target(turn) if turn is not None and turn.kind == "do" else None
    if to is None or turn is None or turn.parts[0].head != "=":
        return False
    plain = to.parts[0] if to.kind == "paren" else to
    return plain.text == "*rr++" and begins in s.parts[0].walk()


def _declared(s: Node, used: set[str]) -> Node | None:
    """A declaration without locals that nobody uses any more; none if it is empty then."""
    if s.kind != "declare":
        return s
    kept = tuple(p for p in s.parts if not (n := _pointer(p)) or n in used)
    return Node("declare", s.head, kept) if kept else None


def _pointer(item: Node) -> str:
    """Name of a local address of CasADi that is declared."""
    to = item.parts[0] if item.kind == "op" else item
    name = to.parts[0].head if to.kind == "unary" and to.head == "*" else ""
    ours = name in ("rr", "cs") or (name[:1] == "w" and name[1:].isdecimal())
    return name if ours else ""
