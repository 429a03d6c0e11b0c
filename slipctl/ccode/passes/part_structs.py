"""States by parts: a function that needs those of its own part alone is given their struct."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from slipctl.ccode.module.layout import Layout
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

_KEPT = {"state", "next"}


def nest_states(layout: Layout, node: Node) -> Node:
    """C in which a state of a part is a member of the struct of that part."""
    moved = {m: place.split(".") for m, place in layout.places.items() if m != place}

    def rule(n: Node) -> Node | None:
        place = moved.get(n.head.lstrip("->.")) if n.kind == "member" else None
        if place is None:
            return None
        (base,) = n.parts
        before = base.head.lstrip("->.")
        if before not in ({*_KEPT, "x"} if n.head.startswith("->") else {"kept", "next"}):
            return None
        sign = n.head[: len(n.head) - len(n.head.lstrip("->."))]
        return Node("member", f".{place[1]}", (Node("member", sign + place[0], (base,)),))

    return node.change(rule) if moved else node


def nest_parts(layout: Layout, functions: Mapping[str, Node], rest: list[Node]
               ) -> tuple[dict[str, Node], list[Node]]:  # fmt: skip
    """Functions that are given the struct of one part where they need no other, and their calls.

    Args:
        layout: names and places of the states.
        functions: of the parts and what they call, by name.
        rest: what else calls them.
    """
    made = {name: nest_states(layout, f) for name, f in functions.items()}
    structs = {name: s for name, f in made.items() if (s := _only_struct(f))}

    def called(n: Node) -> Node | None:
        struct = structs.get(n.head) if n.kind == "call" else None
        if struct is None:
            return None
        return c.call(n.head, [
            c.address(Node("member", f"->{struct}", (p,))) if p.kind == "name" and p.head in _KEPT
            else p for p in n.parts
        ])  # fmt: skip

    for name, struct in structs.items():
        head, body = made[name].parts
        given = [
            replace(p, head=p.head.removesuffix("_kept") + f"_kept_{struct}")
            if p.parts and p.head.endswith(f"struct {layout.name}_kept") else p for p in head.parts
        ]  # fmt: skip
        made[name] = replace(
            made[name],
            parts=(c.call(name, given), body.change(lambda n: _own(n, struct))),  # noqa: B023
        )
    made = {name: replace(f, parts=(f.parts[0], f.parts[1].change(called)))
            for name, f in made.items()}  # fmt: skip
    return made, [nest_states(layout, n).change(called) for n in rest]


def _own(n: Node, struct: str) -> Node | None:
    """A member of the struct of a part, of which the address is at hand."""
    inner = n.parts[0] if n.kind == "member" and n.head.startswith(".") else None
    if inner is None or inner.kind != "member" or inner.head != f"->{struct}":
        return None
    return Node("member", f"->{n.head[1:]}", inner.parts)


def _only_struct(f: Node) -> str:
    """Struct of the part whose states alone a function uses; "" if there is none, or others."""
    used: set[str] = set()

    def rule(n: Node) -> Node | None:
        by = n.parts[0].head if n.kind == "member" and n.parts[0].kind == "name" else ""
        if n.kind == "name" and n.head in _KEPT:
            used.add("")  # passed on whole
        if by in _KEPT:
            used.add("")
            return n
        inner = n.parts[0] if n.kind == "member" else None
        if inner is not None and inner.kind == "member" and inner.parts[0].head in _KEPT:
            used.add(inner.head[2:])
            return n
        return None

    f.parts[1].change(rule)
    return used.pop() if f.head == "static void" and len(used) == 1 else ""
