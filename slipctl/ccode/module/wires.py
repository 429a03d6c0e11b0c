"""Where the signals of a part lie, and what a part is around another: copies, or a slower one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import slower
from slipctl.ccode.module.layout import Copy, Member, c_name
from slipctl.ccode.passes.letters import Told
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression
from slipctl.ccode.tree.vectors import place

POINTERS = ("in", "param", "derived", "state", "next", "now", "work")
"""Structs that a part may be given."""

Place = tuple[Member, str]
"""A struct member and the pointer to it."""


@dataclass(frozen=True)
class Wires:
    """Where the signals of a block lie: places by name."""

    states: Mapping[str, Place]
    following: Mapping[str, Place]
    inputs: Mapping[str, Place | None]
    params: Mapping[str, Place]
    outputs: Mapping[str, Place]

    def places(self) -> list[Place]:
        """All that are known."""
        tables = (self.states, self.following, self.inputs, self.params, self.outputs)
        return [p for table in tables for p in table.values() if p is not None]


def named_equations(
    local: Mapping[tuple[int, int], str], targets: Sequence[tuple[Place, str]], page: Told
) -> dict[str, tuple[str, str]]:
    """Name and place of each equation, by the C name that it gives a value to."""
    found: dict[str, tuple[str, str]] = {}
    for i, ((m, pointer), whole) in enumerate(targets):
        name = whole.rpartition(".")[2]
        origin = page.of_result(name.removesuffix(" next"))
        told = name, origin
        if origin:
            found[f"{pointer}{m.c}"] = told
            if isinstance(m, Copy) and m.local:
                found[m.local] = told
            found |= {local[i, k]: told for k in range(m.size) if (i, k) in local}
    for (i, _), own in local.items():
        if i in page.names and page.origins[i]:
            for c_or_array in (own, page.names[i]):
                found.setdefault(c_or_array, (page.names[i], page.origins[i]))
    return found


def local_name(name: str, element: str = "") -> str:
    """Name of a local for a result, ``x next`` of a state; of an array with its element."""
    last, _, following = name.rpartition(".")[2].partition(" ")
    return f"{c_name(last)}{element}{'_next' * bool(following)}"


def array_of(place: Place) -> Node:
    """The variable, or the array as a whole."""
    m, pointer = place
    return expression(m.array(pointer) if m.size > 1 else m.at(pointer, 0))


def address_of(at: Place) -> Node:
    """Address of its first number."""
    return array_of(at) if at[0].size > 1 else c.address(array_of(at))


def vector_of(at: Place) -> Node:
    """The variable, or the vector that lies in the array."""
    return place(array_of(at), 0) if at[0].size > 1 else array_of(at)


def copy_lines(to: Place, source: Place) -> list[Node]:
    """Statements that copy a value."""
    if to[0].size > 1:
        return [c.do(c.call("copy", [array_of(to), array_of(source), c.integer(to[0].size)]))]
    return [c.assign(array_of(to), array_of(source))]


def own_pointers(wires: Wires, outputs: Sequence[str], names: set[str]) -> list[Node]:
    """Declarations of pointers to what one copy has, of those that are used."""
    written = {id(p) for p in (*wires.following.values(), *(wires.outputs[n] for n in outputs))}
    found: dict[str, str] = {}
    for at in wires.places():
        m, pointer = at
        if isinstance(m, Copy):
            found |= m.pointers(pointer, id(at) not in written)
    lines: list[Node] = []
    for local, text in reversed(found.items()):  # behind what it points into
        if local in names:
            lines = [*code(text), *lines]
            names = names | c.variables(lines[:1])
    return lines


def left_to_casadi(
    block: Block, equations: ca.Function, name: str, places: Sequence[Place | None],
    targets: Sequence[Place], wires: Wires,
) -> tuple[ca.Function, list[Node]]:  # fmt: skip
    """Function that CasADi's text is to have, and the statements that call it by its name.

    Args:
        block: the part.
        equations: from its states, inputs and parameters to what is asked for.
        name: of the Function.
        places, targets: of arguments and results; an argument that comes later has none.
        wires: of the part.
    """
    symbols = [ca.MX.sym(f"i{i}", *equations.size_in(i)) for i in range(len(places))]
    given = [0 if at is None else s for s, at in zip(symbols, places, strict=True)]
    known = [s for s, at in zip(symbols, places, strict=True) if at is not None]
    f = ca.Function(name, known, equations.call(given, not block.sx, False), {"cse": True})
    results, split = list(map(address_of, targets)), block.composition.split
    if split:  # what is prepared is not written again
        ahead = [wires.following[n] for n in split.ahead]
        only, prepared = (array_of(wires.states[n]) for n in (split.only, split.prepared))
        due = f"({only} > 0.0) || !({prepared} > 0.0)"
        results = [
            expression(f"({due}) ? {to} : NULL") if any(at is a for a in ahead) else to
            for at, to in zip(targets, results, strict=True)
        ]
    addresses = [address_of(at) for at in places if at is not None]
    return f, [
        *code(f"const double *arg[{f.sz_arg()}]; double *res[{f.sz_res()}];"),
        *(c.assign(c.index(c.name("arg"), i), a) for i, a in enumerate(addresses)),
        *(c.assign(c.index(c.name("res"), i), a) for i, a in enumerate(results)),
        *code(f"if ({name}(arg, res, work->iw, work->w, 0) != 0) {{ work->failed = 1; }}"),
    ]


def switch_lines(block: Block, now: str, then: str, chosen: Mapping[str, Node]) -> list[Node]:
    """Statements of a state machine: which state follows, by the present one.

    Args:
        block: the machine.
        now, then: C of the present state, and the integer that is given the next one.
        chosen: by the text of a condition, its C.
    """
    (kept,) = block.states.values()
    word = {v: f"AT_{c_name(v).upper()}" for v in kept.values}
    cases = list[str]()
    for state in kept.values:
        taken = [
            f"if ({chosen[condition]}) {{ {then} = {word[to]}; }} else "
            for here, to, condition in block.choices["transitions"] if here in (state, "*")
        ]  # fmt: skip
        stays = f"{{ {then} = {word[state]}; }}" if taken else f"{then} = {word[state]};"
        last = "default:" * (state == kept.values[-1])
        cases.append(f"case {word[state]}: {last} {''.join(taken)}{stays} break;")
    return [
        Node("declare", f"enum {{ {', '.join(word.values())} }}"),
        *code(f"int {then}; switch ((int){now}) {{ {' '.join(cases)} }}"),
    ]


# ---- what a block is around ----------------------------------------------------------------------

NO_END = 1e38
"""In the place of an end of a range that there is none of; float has such a number too."""


def runs_of(block: Block) -> tuple[Block, int, str, dict[str, str]] | None:
    """Block inside an ``every``, its ticks, the counter, and held states by output."""
    made = slower(block)
    if made is None:
        return None
    counter, ticks = made
    (inner,) = block.parts.values()
    kept = [n for n in block.states if n not in inner.states and n != counter]
    if len(kept) != len(inner.outputs) or list(inner.params) != list(block.params):
        return None
    return inner, ticks, counter, dict(zip(kept, inner.outputs, strict=True))


def is_copies(block: Block) -> bool:
    """Whether a block is copies of another, made by ``replicate``."""
    inner = _inner(block, "copies")
    return (
        inner is not None
        and list(inner.states) == list(block.states)
        and list(inner.outputs) == list(block.outputs)
        and all(s.shape != inner.outputs[n].shape for n, s in block.outputs.items())
    )


def gate_of(block: Block) -> str:
    """Input that a block made by ``gated`` has more than what it is around; "" of another."""
    inner = _inner(block, "gated by")
    more = set(block.inputs) - set(inner.inputs) if inner is not None else set()
    return more.pop() if len(more) == 1 else ""


def begins_anew(block: Block) -> bool:
    """Whether a block begins anew where a state leaves its range, and tells that by an output."""
    inner = _inner(block, "contained")
    return inner is not None and len(set(block.outputs) - set(inner.outputs)) == 1


def _inner(block: Block, choice: str) -> Block | None:
    """What a block made with this choice is around."""
    if not block.transparent or choice not in block.choices or len(block.parts) != 1:
        return None
    return next(iter(block.parts.values()))
