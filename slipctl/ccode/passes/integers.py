"""What is 0 or 1 in the model, whatever happens, as true or false in C; what counts as integers.

That is found in the statements themselves: all that a member is ever given is 0, 1, a choice of
such numbers, or another such member. So no value is lost, and every other number keeps its bits.
A state of a state machine is given whole numbers, or what a ``switch`` has chosen. A counter of
ticks is given whole numbers and one more than itself, and compared with some.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slipctl.ccode.module.kernel import Kernel
from slipctl.ccode.module.layout import Layout, Member
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import constant
from slipctl.ccode.tree.nodes import Node

_ATOMS = {"name", "member", "index", "call", "paren"}
_COMPARED: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_ANY_OF = {"above", "at_least", "greater", "fmax"}
_ALL_OF = {"below", "at_most", "lesser", "fmin"}
_TRUE, _FALSE, _NO, _YES = c.name("true"), c.name("false"), constant(0.0), constant(1.0)


@dataclass
class _Known:
    """What is 0 or 1: members, and constants of the function at hand.

    Attributes:
        members: of ``now`` and of what is kept: the struct, and the name.
        arrays: those of them that are arrays.
        counts: counters of ticks, members of what is kept.
        modes: members that hold the state of a state machine.
        local: constants.
        whole: constants that are the state of a state machine.
    """

    members: set[tuple[str, str]]
    modes: set[tuple[str, str]]
    arrays: frozenset[tuple[str, str]]
    counts: frozenset[tuple[str, str]]
    local: set[str] = field(default_factory=set)
    whole: set[str] = field(default_factory=set)

    def look_at(self, body: Node) -> None:
        """Find the constants of a function."""
        made = [(n.constant, c.value(n)) for n in body.walk() if n.constant and "double" in n.head]
        self.local = {name for name, _ in made}
        self.whole = set(self.local)
        while lost := {n for n, v in made if n in self.local and not _is_truth(v, self)}:
            self.local -= lost
        while lost := {n for n, v in made if n in self.whole and not _is_mode(v, self)}:
            self.whole -= lost

    def has(self, n: Node) -> bool:
        """Whether a member or a constant is 0 or 1."""
        return n.head in self.local if n.kind == "name" else _member(n) in self.members


class _Otherwise(Exception):
    """A counter is used as a number."""


def with_integers(
    made: Kernel, layout: Layout, counters: Collection[Member]
) -> tuple[Kernel, Layout]:
    """Equations with true or false for what is 0 or 1; the layout that says what that is.

    Args:
        made: what is written by parts.
        layout: of the module; only where it measures are such numbers looked for. A measurement
            or a state that may be so has a range from 0 to 1, and a state begins as one of them.
        counters: states that count ticks; they are integers if all of them can be.
    """
    rows = [("now", m) for m in layout.measured]
    rows += [("kept", m) for m in layout.states if rows and _begins(m)]
    modes = {(struct, m.c) for struct, m in rows if m.signal.values}
    truths = {(struct, m.c) for struct, m in rows if m.signal.lo >= 0 and m.signal.hi <= 1}
    known = _Known(truths - modes, modes,
                   frozenset((struct, m.c) for struct, m in rows if not m.scalar),
                   frozenset(("kept", m.c) for m in counters if layout.measured))  # fmt: skip
    bodies = [*made.functions.values(), c.block(made.lines)]
    lost = {("", "")}
    while lost:
        lost = set()
        for body in bodies:
            known.look_at(body)
            lost |= (known.members | known.modes).intersection(_refuted(body, known))
        known.members -= lost
        known.modes -= lost
    if not known.members and not known.counts and not known.modes:
        return made, layout
    try:
        *functions, lines = [_changed(body, known) for body in bodies]
    except _Otherwise:
        known.counts = frozenset()
        *functions, lines = [_changed(body, known) for body in bodies]
    new = replace(
        made, functions=dict(zip(made.functions, functions, strict=True)), lines=lines.parts
    )
    kinds = dict.fromkeys(known.members, "bool") | dict.fromkeys(known.modes, "int")
    kinds |= dict.fromkeys(known.counts, "unsigned int")
    return new, replace(layout, kinds=kinds)


def _begins(m: Member) -> bool:
    """Whether a state begins as 0 or 1, or in a mode, whatever the parameters are."""
    if m.signal.derived:
        return False
    start = np.asarray(m.signal.value, dtype=float)
    return bool(m.signal.values) or bool(np.isin(start, (0, 1)).all())


def _member(n: Node) -> tuple[str, str]:
    """Where a member, or an element of one, lies: in ``now`` or in what is kept; its name."""
    inner = n.parts[0] if n.kind == "index" else n
    if inner.kind != "member" or not inner.head.startswith("->"):
        return "", ""
    struct = {"now": "now", "state": "kept", "next": "kept"}.get(inner.parts[0].head, "")
    return struct, inner.head[2:] * bool(struct)


# ---- finding -------------------------------------------------------------------------------------


def _is_truth(n: Node, known: _Known) -> bool:
    """Whether an expression is 0 or 1."""
    if n.kind == "number":
        return n in (_NO, _YES)
    if n.kind == "choice":
        return all(_is_truth(p, known) for p in n.parts[1:])
    if n.kind == "paren" or (n.kind == "call" and n.head in (_ANY_OF | _ALL_OF)):
        return all(_is_truth(p, known) for p in n.parts)
    if n.kind == "op" and n.head == "+" and n.parts[1] == _NO:
        return _is_truth(n.parts[0], known)
    return known.has(n)


def _is_below(value: float, end: int) -> bool:
    """Whether it is a whole number from 0 on and below an end."""
    return value.is_integer() and 0 <= value < end


def _is_mode(n: Node, known: _Known) -> bool:
    """Whether an expression is the state of a state machine, as a whole number."""
    if n.kind == "number":
        return _is_below(float(n.head), 2**15)
    if n.kind == "choice":
        return all(_is_mode(p, known) for p in n.parts[1:])
    if n.kind == "paren":
        return _is_mode(n.parts[0], known)
    if n.kind == "name":
        return n.head in known.whole
    chosen = n.kind == "cast" and n.head == "double" and n.parts[0].kind == "name"
    return chosen or _member(n) in known.modes


def _refuted(n: Node, known: _Known, above: Node | None = None) -> Iterator[tuple[str, str]]:
    """Members that are given another number, or that something else may write."""
    to = c.target(n) if n.kind == "do" else None
    if to is not None:
        fits = _is_mode if _member(to) in known.modes else _is_truth
        if n.parts[0].head != "=" or not fits(c.value(n), known):
            yield _member(to)
    if n.kind in ("member", "index") and above is not None and not n.text.startswith("state->"):
        whole = n.kind == "member" and above.kind != "index" and _member(n) in known.arrays
        if whole or (above.kind == "unary" and above.head == "&"):
            yield _member(n)
    for p in n.parts:
        yield from _refuted(p, known, n)


# ---- writing -------------------------------------------------------------------------------------


def _changed(body: Node, known: _Known) -> Node:
    """A function in which what is 0 or 1 is true or false.

    A constant of which the number is asked for somewhere stays a number.
    """
    known.look_at(body)
    while True:
        made = body.change(lambda n: _rule(n, known))
        asked = {
            n.parts[0].head for n in made.walk()
            if n.kind == "choice" and n.parts[0].kind == "name" and n.parts[1:] == (_YES, _NO)
        } & known.local  # fmt: skip
        if not asked:
            return made
        known.local = known.local - asked


def _rule(n: Node, known: _Known) -> Node | None:
    """What stands for a statement or an expression; None where only what is in it changes."""
    to = c.target(n) if n.kind in ("do", "declare") else None
    if to is not None and n.parts[0].head == "=":
        if known.has(to) and (n.kind == "do" or n.constant):
            kind = "const bool" if n.kind == "declare" else ""
            return replace(n, head=kind, parts=(c.op(to, "=", _truth(c.value(n), known)),))
        if _member(to) in known.counts:
            return replace(n, parts=(c.op(to, "=", _whole(c.value(n), known)),))
        if _member(to) in known.modes:
            return replace(n, parts=(c.op(to, "=", _mode(c.value(n), known)),))
        value = c.value(n)
        if _is_truth(value, known) and any(known.has(x) for x in value.walk()):
            number = Node("choice", "", (_atom(_truth(value, known)), _YES, _NO))
            return replace(n, parts=(c.op(to, "=", number),))
    if n.kind == "op" and n.head in _COMPARED:
        return _comparison(n, known)
    if n.kind == "op" and n.head == "&&":
        sides = [p.change(lambda x: _rule(x, known)) for p in n.parts]
        left = [p for p in sides if p != _TRUE]
        return _joined(left, "&&") if left else _TRUE
    if n.kind == "paren":
        inner = n.parts[0].change(lambda x: _rule(x, known))
        return inner if inner.kind in _ATOMS else c.paren(inner)
    if n.kind in ("member", "index") and _member(n) in known.counts:
        raise _Otherwise
    if n.kind == "cast" and n.head == "int" and _member(n.parts[0]) in known.modes:
        return n.parts[0]
    if n.kind in ("member", "index") and _member(n) in known.modes:
        return Node("cast", "double", (n,))
    if n.kind in ("name", "member", "index") and known.has(n):
        return c.paren(Node("choice", "", (n, _YES, _NO)))
    return None


def _comparison(n: Node, known: _Known) -> Node | None:
    """A comparison of what is true or false with a number: it itself, its opposite, or neither."""
    sides = [_bare(p) for p in n.parts]
    for k, flag in enumerate(sides):
        number = sides[1 - k]
        if number.kind == "number" and flag.kind != "number" and _is_truth(flag, known):
            at, told = float(number.head), _truth(flag, known)
            held = [_COMPARED[n.head](*((v, at) if k == 0 else (at, v))) for v in (0.0, 1.0)]
            if held[0] != held[1]:
                return told if held[1] else _not(told)
            return _TRUE if held[0] else _FALSE
        if _member(flag) in known.modes and number.kind == "number":
            up = (n.head in ("<", ">=")) == (k == 0)
            whole = math.ceil(float(number.head)) if up else math.floor(float(number.head))
            if n.head not in ("==", "!=") or whole == float(number.head):
                end = Node("number", str(whole))
                return c.op(flag, n.head, end) if k == 0 else c.op(end, n.head, flag)
    if any(_member(s) in known.counts for s in sides):
        least = sides[0] == _NO and n.head == "<="  # which every integer without a sign is above
        return _TRUE if least else c.op(_whole(sides[0], known), n.head, _whole(sides[1], known))
    return None


def _mode(n: Node, known: _Known) -> Node:
    """What holds the state of a state machine is given, as an integer."""
    if n.kind == "number":
        return Node("number", str(int(float(n.head))))
    if n.kind == "name":
        return Node("cast", "int", (n,))
    if n.kind == "cast":
        return n.parts[0]
    if n.kind == "paren":
        return replace(n, parts=(_mode(n.parts[0], known),))
    if n.kind == "choice":
        asked = n.parts[0].change(lambda x: _rule(x, known))
        return replace(n, parts=(asked, *(_mode(p, known) for p in n.parts[1:])))
    return n


def _whole(n: Node, known: _Known) -> Node:
    """What a counter is given or compared with, as an integer.

    Raises:
        _Otherwise: another number.
    """
    if n.kind == "number" and _is_below(float(n.head), 2**31):
        return Node("number", f"{int(float(n.head))}U")
    if n.kind == "paren" or (n.kind == "op" and n.head == "+"):
        return replace(n, parts=tuple(_whole(p, known) for p in n.parts))
    if n.kind == "choice":
        asked = n.parts[0].change(lambda x: _rule(x, known))
        return replace(n, parts=(asked, *(_whole(p, known) for p in n.parts[1:])))
    if _member(n) not in known.counts:
        raise _Otherwise
    return n


def _bare(n: Node) -> Node:
    """A value without parentheses, and without the conversion to a whole number."""
    inside = n.kind == "paren" or (n.kind == "cast" and n.head == "int")
    return _bare(n.parts[0]) if inside else n


def _truth(n: Node, known: _Known) -> Node:
    """An expression that is 0 or 1, as a condition."""
    if n.kind == "paren":
        return _truth(n.parts[0], known)
    if n.kind == "number":
        return _TRUE if n == _YES else _FALSE
    if n.kind == "call":
        return _joined([_truth(p, known) for p in n.parts], "||" if n.head in _ANY_OF else "&&")
    if n.kind == "op":
        return _truth(n.parts[0], known)
    if n.kind == "choice":
        asked = _open(n.parts[0].change(lambda x: _rule(x, known)))
        yes, no = (_truth(p, known) for p in n.parts[1:])
        if (yes, no) in ((_TRUE, _TRUE), (_FALSE, _FALSE)):
            return yes
        if _TRUE in (yes, no):
            first = asked if yes == _TRUE else _not(asked)
            other = no if yes == _TRUE else yes
            return first if other == _FALSE else _joined([first, other], "||")
        if _FALSE in (yes, no):
            return _joined([asked, yes] if no == _FALSE else [_not(asked), no], "&&")
        return Node("choice", "", (_atom(asked), _atom(yes), _atom(no)))
    return n


def _joined(conditions: Sequence[Node], sign: str) -> Node:
    """Conditions of which one is to hold, or all."""
    first, *others = conditions
    for n in others:
        first = c.op(_atom(first), sign, _atom(n))
    return first


def _not(n: Node) -> Node:
    """The opposite of a condition."""
    inner = _open(n)
    if inner.kind == "unary" and inner.head == "!":
        return _open(inner.parts[0])
    return Node("unary", "!", (_atom(inner),))


def _open(n: Node) -> Node:
    """A condition without the parentheses around it."""
    return _open(n.parts[0]) if n.kind == "paren" else n


def _atom(n: Node) -> Node:
    """A condition that may stand beside any sign."""
    return n if n.kind in _ATOMS else c.paren(n)
