"""Comments in C: any text, in ASCII, wrapped."""

from __future__ import annotations

import textwrap
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace

from slipctl.ccode.tree.nodes import Node, target
from slipctl.ccode.tree.nodes import value as value_of

WIDTH = 100


def comment(text: str, indent: str = "") -> str:
    """C comment of any text, wrapped; lines that are indented keep their breaks."""
    plain = ascii_text(text).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    width = WIDTH - len(indent) - 3
    lines: list[str] = []
    for paragraph in plain.strip().split("\n\n"):
        if lines:
            lines.append("")
        for block in _reflowed(paragraph):
            space = block[: len(block) - len(block.lstrip())]
            lines += textwrap.wrap(
                block, width, subsequent_indent=space, break_on_hyphens=False,
                break_long_words=False,
            )  # fmt: skip
    if len(lines) == 1 and len(lines[0]) <= width - 3:
        return f"{indent}/* {lines[0]} */"
    body = [f"{indent} * {line}".rstrip() for line in lines[1:]]
    closed = (
        [f"{body[-1]} */"] if body and len(body[-1]) <= WIDTH - 3 else [*body[-1:], f"{indent} */"]
    )
    return "\n".join([f"{indent}/* {lines[0]}", *body[:-1], *closed])


def first_sentence(doc: str) -> str:
    """First paragraph of a text, on one line."""
    return " ".join(doc.strip().partition("\n\n")[0].split())


def _reflowed(paragraph: str) -> list[str]:
    """Join the lines of running text; leave lines of equations and lists alone."""
    lines = paragraph.split("\n")
    indents = {len(line) - len(line.lstrip()) for line in lines}
    running = len(indents) == 1 and all(len(line) > 60 for line in lines[:-1])
    if not running:
        return lines
    return [" " * indents.pop() + " ".join(line.strip() for line in lines)]


def with_origins(lines: Sequence[Node], told: Mapping[str, tuple[str, str]]) -> list[Node]:
    """Statements, and behind the first that gives a value to a C name where that comes from.

    Args:
        lines: the statements.
        told: by C name, the name as the model has it and the place.
    """
    waiting = dict(told)

    def rule(n: Node) -> Node | None:
        given = _given(n) if n.kind in ("do", "declare") else ""
        name, place = waiting.pop(given, ("", ""))
        if not place:
            return None
        for c in [c for c, said in waiting.items() if said == (name, place)]:
            del waiting[c]  # an equation is told once, where it is worked out
        return replace(
            n, told=f"  /* {ascii_text(place if given == name else f'{name}, {place}')} */"
        )

    return [line.change(rule) for line in lines]


def _given(line: Node) -> str:
    """C name that a statement gives a value to, if it is one line."""
    to = target(line)
    if line.kind == "do" and line.parts[0].kind == "call" and line.parts[0].head == "copy":
        to = line.parts[0].parts[0]
        to = to.parts[0] if to.kind == "unary" else to
    numbers = line.head.split(" ")[-1] in ("", "double", "float", "bool")
    if to is None or not numbers or line.head.startswith("static") or (
        value_of(line).kind == "list" and len(line.text) > WIDTH - 12):  # fmt: skip
        return ""
    assigned = line.kind == "declare" or line.parts[0].head in ("=", "copy")
    return to.base.text if assigned else ""


FILE = "The lines are those of "
"""What the comment before a function says of the file that the lines behind statements are of."""


def of_one_file(lines: Sequence[Node]) -> tuple[list[Node], str]:
    """Tell the file that most statements come from once: they have ``line 12``; and the file."""
    told = [n.told for line in lines for n in line.walk() if n.told.startswith("  /*")]
    files = [t.partition(".py:")[0].rpartition(" ")[2] + ".py" for t in told if ".py:" in t]
    if not files:
        return list(lines), ""
    file = max(dict.fromkeys(files), key=files.count)

    def rule(n: Node) -> Node | None:
        return replace(n, told=n.told.replace(f" {file}:", " line ", 1)) if n.told else None

    return [line.change(rule) for line in lines], file


_SIGNS = {
    "≤": "<=", "≥": ">=", "≠": "!=", "±": "+-", "×": "x", "·": "*", "−": "-", "–": "-", "—": "-",
    "→": "->", "∞": "inf", "√": "sqrt ", "°": "deg", "µ": "u", "′": "'", "’": "'", "∈": " in ",
}  # fmt: skip


def ascii_text(text: str) -> str:
    """Text in ASCII: letters without accents, others by name (``omega``)."""
    out = []
    for char in text:
        if ord(char) < 128:
            out.append(char)
            continue
        if char in _SIGNS:
            out.append(_SIGNS[char])
            continue
        base = unicodedata.normalize("NFKD", char).encode("ascii", "ignore").decode()
        out.append(base or unicodedata.name(char, "?").split()[-1].lower())
    return "".join(out)
