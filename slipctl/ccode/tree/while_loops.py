"""Functions that do one thing again while it is wanted: loops of C that end when it is not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from slipctl.ccode.tree.expressions import Node
from slipctl.ccode.tree.graph import CALLED, SLICE, Step, free_name, taken_apart
from slipctl.ccode.tree.nodes import Node as C
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.scans import same, size


@dataclass(frozen=True)
class Again:
    """One Function on what it gave, as long as a number of that is above 0.

    Attributes:
        once: the Function.
        most: how often at most.
        going: which element of its first argument says so.
        begun: whether it is called once in any case.
    """

    once: ca.Function
    most: int
    going: int
    begun: bool


def branches(g: ca.Function) -> tuple[ca.Function, ca.Function] | None:
    """What an if_else Function evaluates if true and otherwise; None of another Function."""
    if g.class_name() != "Switch":
        return None
    found = g.info()
    others = found["f"]
    return (found["f_def"], others[0]) if len(others) == 1 else None


def find_while_loop(f: ca.Function, within: Callable[[ca.Function], Again | None]) -> Again | None:
    """What a Function does again and again, if that is all it does.

    Args:
        f: the Function.
        within: the same of a Function that it calls.
    """
    if (apart := taken_apart(f)) is None or f.n_out() != 1:
        return None
    nodes, outputs = apart
    now: Node | None = None
    once: ca.Function | None = None
    most, going, begun = 0, -1, False
    for node in nodes:
        if not isinstance(node, Step) or node.op != CALLED:
            continue
        g = node.detail[0]
        rest = [nodes[a] for a in node.args]
        chosen = branches(g)
        if chosen is not None:
            yes, no = chosen
            at = _going(rest[0], nodes, rest[1])
            if at < 0 or going not in (-1, at) or not _stays(no):
                return None
            going, g, rest = at, yes, rest[1:]
        elif now is not None:
            return None  # it is called in any case, and not as the first
        deeper = within(g)
        base = g if deeper is None else deeper.once
        if deeper is not None and going not in (-1, deeper.going):
            return None
        if deeper is not None:
            going = deeper.going
        begun = begun or (chosen is None and (deeper is None or deeper.begun))
        if once is not None and not same(base, once):
            return None
        once = base
        first, *others = rest
        starts = (first.op, first.place) == (ca.OP_INPUT, (0, 0)) if now is None else first is now
        if not starts or len(rest) != f.n_in():
            return None
        for i, other in enumerate(others, start=1):
            if (other.op, other.place) != (ca.OP_INPUT, (i, 0)) or size(other) != f.nnz_in(i):
                return None
        now = node
        most += 1 if deeper is None else deeper.most
    if once is None or most < 2 or going < 0 or nodes[outputs[0]] is not now:
        return None
    like = once.nnz_in(0) == once.nnz_out(0) == f.nnz_out(0) and once.n_out() == 1
    return Again(once, most, going, begun) if like else None


def _going(condition: Node, nodes: Sequence[Node], of: Node) -> int:
    """Element of a vector that is asked to be above 0; -1 for another question."""
    if condition.op != ca.OP_LT:
        return -1
    zero, value = (nodes[a] for a in condition.args)
    if zero.op != ca.OP_CONST or zero.value != 0.0 or value.op != SLICE:
        return -1
    assert isinstance(value, Step)
    return int(value.detail[0]) if nodes[value.args[0]] is of and value.size == 1 else -1


def stays(f: ca.Function) -> int:
    """Argument that a Function gives as it is, if that is all it does; else -1."""
    if (apart := taken_apart(f)) is None or f.n_out() != 1:
        return -1
    nodes, outputs = apart
    node = nodes[outputs[0]] if outputs[0] >= 0 else None
    whole = node is not None and node.op == ca.OP_INPUT and size(node) == f.nnz_in(node.place[0])
    return node.place[0] if node is not None and whole else -1


def _stays(f: ca.Function) -> bool:
    return stays(f) == 0


def again_lines(
    found: Again, name: str, inputs: Sequence[str], output: str, taken: set[str]
) -> list[C]:
    """Statements of a Function that does something again and again.

    Args:
        found: what it does.
        name: C name of what is called.
        inputs, output: names of what it is given and gives.
        taken: names that no local may have.
    """
    used = {*taken, *inputs, output}
    names = [next(x for x in "ijk" if x not in {*inputs, output})]
    for word in ("latest", "other", "to", "by_turns"):
        names.append(free_name(word, used))
        used.add(names[-1])
    at, now, other, to, turns = names
    z, *others = inputs
    n = found.once.nnz_in(0)
    over = f"!({now}[{found.going}] > 0.0)"
    if found.begun:
        over = f"({at} > 0) && {over}"
    return code(
        f"double {other}[{n}];"
        f"double *const {turns}[2] = {{{output}, {other}}};"
        f"const double *{now} = {z};"
        f"for (int {at} = 0; {at} < {found.most}; ++{at}) {{"
        f"  if ({over}) {{ break; }}"
        f"  double *const {to} = {turns}[{at} % 2];"
        f"  {name}({', '.join([now, *(o for o in others if o), to])});"
        f"  {now} = {to};"
        f"}}"
        f"if ({now} != {output}) {{ copy({output}, {now}, {n}); }}"
    )
