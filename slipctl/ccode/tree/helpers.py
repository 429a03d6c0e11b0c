"""Small functions of C that the C of a module calls; they lie in ``templates/helpers.c``."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.tree.nodes import Node, called_functions
from slipctl.ccode.tree.parser import code


@lru_cache(maxsize=1)
def all_helpers() -> dict[str, Node]:
    """Each by its name; one that calls another stands behind it."""
    whole = code(fill_template("helpers.c"))
    return {n.parts[0].head: n for n in whole if n.kind == "function"}


def helpers(nodes: Iterable[Node], there: Iterable[Node] = ()) -> list[Node]:
    """Those that some C calls, itself or through others, without those that are there."""
    called, made = called_functions(nodes), all_helpers()
    for name in reversed(made):
        called |= made[name].calls() if name in called else set()
    known = {n.parts[0].head for n in there if n.kind == "function"}
    return [n for name, n in made.items() if name in called and name not in known]
