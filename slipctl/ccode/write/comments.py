"""Comments in C: any text, in ASCII, wrapped."""

from __future__ import annotations

import textwrap
import unicodedata

WIDTH = 98


def comment(text: str, indent: str = "") -> str:
    """C comment of any text, wrapped; lines that are indented keep their breaks."""
    plain = spelled(text).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
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
    return "\n".join([f"{indent}/* {lines[0]}", *body, f"{indent} */"])


def _reflowed(paragraph: str) -> list[str]:
    """Join the lines of running text; leave lines of equations and lists alone."""
    lines = paragraph.split("\n")
    indents = {len(line) - len(line.lstrip()) for line in lines}
    running = len(indents) == 1 and all(len(line) > 60 for line in lines[:-1])
    if not running:
        return lines
    return [" " * indents.pop() + " ".join(line.strip() for line in lines)]


_SIGNS = {
    "≤": "<=", "≥": ">=", "≠": "!=", "±": "+-", "×": "x", "·": "*", "−": "-", "–": "-", "—": "-",
    "→": "->", "∞": "inf", "√": "sqrt ", "°": "deg", "µ": "u", "′": "'", "’": "'", "∈": " in ",
}  # fmt: skip


def spelled(text: str) -> str:
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
