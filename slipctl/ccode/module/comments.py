"""Comments in C: any text, in ASCII, wrapped."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Mapping, Sequence

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


def _reflowed(paragraph: str) -> list[str]:
    """Join the lines of running text; leave lines of equations and lists alone."""
    lines = paragraph.split("\n")
    indents = {len(line) - len(line.lstrip()) for line in lines}
    running = len(indents) == 1 and all(len(line) > 60 for line in lines[:-1])
    if not running:
        return lines
    return [" " * indents.pop() + " ".join(line.strip() for line in lines)]


ORIGIN = re.compile(
    r"(?P<code>.*[;}])  /\* (?:(?P<name>[^,*]+), )?(?P<source>(?:line |[^ ,*]+\.py:)\d+[^*]*) \*/$"
)
"""A statement, and behind it where its equation comes from, with its name if C has another."""

GIVEN = re.compile(
    r"\s*(?:copy\(&?|(?:const )?(?:double|float|bool) )?(?P<target>\w+(?:->\w+)?)"
    r"(?:\[[^\]]*\])*(?: = |, ).*;$"
)


def with_origins(lines: Sequence[str], told: Mapping[str, tuple[str, str]]) -> list[str]:
    """Statements, and behind the first that gives a value to a C name where that comes from.

    Args:
        lines: the statements.
        told: by C name, the name as the model has it and the place.
    """
    waiting, made = dict(told), []
    for line in lines:
        found = GIVEN.match(line)
        name, place = waiting.pop(found["target"], ("", "")) if found else ("", "")
        if found and place:  # an equation is told once, where it is worked out
            waiting = {c: said for c, said in waiting.items() if said != (name, place)}
            same = found["target"] == name
            line += f"  /* {ascii_text(place if same else f'{name}, {place}')} */"
        made.append(line)
    return made


FILE = "The lines are those of "
"""What the comment before a function says of the file that the lines behind statements are of."""


def of_one_file(lines: Sequence[str]) -> tuple[list[str], str]:
    """Tell the file that most statements come from once: they have ``line 12``; and the file."""
    files = [m[1] for line in lines if (m := _TOLD.search(line))]
    if not files:
        return list(lines), ""
    file = max(dict.fromkeys(files), key=files.count)
    place = re.compile(rf"(/\* (?:[^,*]+, )?){re.escape(file)}:(?=\d)")
    return [place.sub(r"\1line ", line) for line in lines], file


_TOLD = re.compile(r"  /\* (?:[^,*]+, )?([^ ,*]+\.py):\d+[^*]* \*/$")

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
