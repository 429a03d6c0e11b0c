"""States by parts: a function that needs those of its own part alone is given their struct."""

from __future__ import annotations

import re
from collections.abc import Iterable

from slipctl.ccode.module.layout import Layout
from slipctl.ccode.tree.statements import declaration_lines

_PASSED = re.compile(r"\b(?:state|next)\b(?!->)")
_USED = re.compile(r"\b(?:state|next)->(\w+)(\.?)")


def nest_states(layout: Layout, text: str, parts: Iterable[str]) -> str:
    """C text in which a state of a part is a member of the struct of that part.

    Args:
        layout: names and places of the states.
        text: of the module, with the states by their C names.
        parts: names of the functions that may have the struct of one part in the place of all.
    """
    text = layout.nested(text)
    for name in parts:
        text = _of_one(layout, text, name)
    return text


def _of_one(layout: Layout, text: str, name: str) -> str:
    """Text in which a function has the struct of one part, if it needs no other."""
    found = re.search(
        rf"^static void {name}\((?P<given>[^{{;]*)\)\n\{{\n(?P<body>.*?)^\}}", text, re.M | re.S
    )
    if found is None:
        return text
    code = re.sub(r"/\*.*?\*/", "", found["body"])
    if _PASSED.search(code):
        return text
    used = set(_USED.findall(code))
    if len({struct for struct, _ in used}) != 1 or not all(dot for _, dot in used):
        return text
    (struct,) = {struct for struct, _ in used}
    whole, own = f"struct {layout.name}_kept *", f"struct {layout.name}_kept_{struct} *"
    given = [" ".join(a.split()).replace(whole, own) for a in found["given"].split(",")]
    body = re.sub(rf"\b(state|next)->{struct}\.", r"\1->", found["body"])
    made = f"{declaration_lines('static void', name, *given)}\n{{\n{body}}}"
    before, after = text[: found.start()], text[found.end() :]

    def called(m: re.Match[str]) -> str:
        return re.sub(r"\b(state|next)\b", rf"&\1->{struct}", m[0])

    call = re.compile(rf"^ +{name}\([^;]*\);$", re.M)
    return call.sub(called, before) + made + call.sub(called, after)
