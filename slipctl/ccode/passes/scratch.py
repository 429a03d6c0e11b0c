"""Where arrays lie: large ones of functions in the state, tables in a section of the linker.

Each function has a struct of its own in it, so nothing overlaps: no function calls itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

DEEPEST = 2048
"""Numbers in arrays of functions that call each other above which the larger ones leave the
stack: 8 kB of floats."""

LARGE = 16
"""Numbers of an array above which it leaves the stack then."""

OWN = "own"
"""Pointer of a function to its arrays."""

Arrays = tuple[tuple[str, int], ...]
"""Names and sizes."""


@dataclass(frozen=True)
class Scratch:
    """Functions whose large arrays lie elsewhere.

    Attributes:
        made: the functions by name.
        lines: statements that call them.
        arrays: of each function that has some, by its name.
    """

    made: Mapping[str, Node]
    lines: tuple[Node, ...]
    arrays: Mapping[str, Arrays]


def off_stack(functions: Mapping[str, Node], lines: Sequence[Node], work: Node) -> Scratch:
    """Move large arrays off the stack, if they are much together.

    Args:
        functions: by name.
        lines: statements that call them.
        work: declaration of the argument ``work``, behind which the arrays lie.
    """
    arrays = {name: _arrays(f) for name, f in functions.items()}
    called = {name: f.parts[1].calls() for name, f in functions.items()}
    calls = {n: [m for m in functions if m in called[n]] for n in functions}
    deepest: dict[str, int] = {}

    def depth(name: str) -> int:
        if name not in deepest:
            own = sum(n for _, n in arrays[name])
            deepest[name] = own + max((depth(m) for m in calls[name]), default=0)
        return deepest[name]

    if max((depth(n) for n in functions), default=0) <= DEEPEST:
        return Scratch(functions, tuple(lines), {})
    large = {name: tuple(row for row in rows if row[1] > LARGE) for name, rows in arrays.items()}
    large = {name: rows for name, rows in large.items() if rows}
    needing = set(large)
    while more := {n for n in functions if n not in needing and needing & set(calls[n])}:
        needing |= more

    told = {n for n, f in functions.items() if work in f.parts[0].parts}  # of it already

    def given(n: Node) -> Node | None:
        if n.kind != "call" or n.head not in needing - told:
            return None
        return c.call(n.head, [*(p.change(given) for p in n.parts), c.name("work")])

    made = dict(functions)
    for name in needing:
        head, body = functions[name].parts
        body = body.change(given)
        if name in large:
            struct = f"{work.head}_{name}"
            body = _moved(body, {a for a, _ in large[name]}, struct, name)
        own = [p for p in head.parts if p.head != "void" or p.parts]
        own += [work] * (name not in told)
        made[name] = replace(functions[name], parts=(c.call(name, own), body))
    return Scratch(made, tuple(line.change(given) for line in lines), large)


def _arrays(f: Node) -> Arrays:
    """Arrays that a function declares without values."""
    items = [n.parts[0] for n in f.parts[1].walk() if n.kind == "declare" and n.head == "double"]
    return tuple((n.base.head, int(n.parts[1].head)) for n in items if n.kind == "index")


def _moved(body: Node, names: set[str], struct: str, name: str) -> Node:
    """A function's statements with arrays that are members of its struct."""
    own = c.name(OWN)

    def rule(n: Node) -> Node | None:
        if n.kind == "name" and n.head in names:
            return Node("member", f"->{n.head}", (own,))
        if n.kind == "block":
            kept = [p for p in n.parts if not (p.kind == "declare" and _declares(p, names))]
            return c.block(p.change(rule) for p in kept)
        return None

    pointer = c.declare(struct, Node("unary", "*const ", (own,)),
                        c.address(Node("member", f"->{name}", (c.name("work"),))))  # fmt: skip
    return c.block([pointer, *body.change(rule).parts])


def _declares(n: Node, names: set[str]) -> bool:
    return n.head == "double" and n.parts[0].kind == "index" and n.parts[0].base.head in names


def structs(arrays: Mapping[str, Arrays], name: str, real: str, more: Sequence[str]) -> list[str]:
    """Declarations of the structs that hold them, and of the one that holds these and more."""
    lines: list[str] = []
    for function, rows in arrays.items():
        lines += [f"struct {name}_{function} {{"]
        lines += [f"    {real} {a}[{n}];" for a, n in rows]
        lines += ["};", ""]
    members = [*(f"struct {name}_{f} {f};" for f in arrays), *more]
    return [*lines, f"struct {name} {{", *(f"    {m}" for m in members), "};", ""]


# ---- tables ------------------------------------------------------------------------------------


def attribute(section: str) -> str:
    """What compilers read behind a name."""
    return f'__attribute__((section("{section}")))'


def in_section(node: Node, section: str) -> Node:
    """C with its tables in a section."""

    def rule(n: Node) -> Node | None:
        to = c.target(n) if n.kind == "declare" and n.head.startswith("static const ") else None
        if to is None or to.kind != "index":
            return None
        return c.declare(n.head, c.name(f"{to} {attribute(section)}"), c.value(n))

    return node.change(rule)
