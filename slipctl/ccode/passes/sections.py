"""Tables in a section of the linker."""

from __future__ import annotations

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node


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
