"""Texts that are written from a template, a file that reads as what it becomes."""

from __future__ import annotations

import re
from pathlib import Path

_FOLDER = Path(__file__).parents[1] / "templates"
_PLACE = re.compile(r"@(\w+)@")


def fill_template(name: str, **values: object) -> str:
    """Text of a template with its values.

    Args:
        name: of the template. A value stands for ``@name@``; a line that has nothing else is left
            out where the value is empty. Lines from ``//@ if name other`` to ``//@ end`` stand
            where these values are true, and those behind ``//@ else`` where they are not;
            ``!name`` is the opposite.
        **values: by name.
    """
    lines, taken = list[str](), [True]
    for line in (_FOLDER / name).read_text(encoding="utf-8").splitlines():
        before, mark, command = line.partition("//@ ")
        word, *names = command.split() if mark and not before.strip() else [""]
        if word == "if":
            taken.append(all(bool(values[n.lstrip("!")]) != (n[0] == "!") for n in names))
        elif word == "else":
            taken[-1] = not taken[-1]
        elif word == "end":
            taken.pop()
        elif all(taken):
            made = _PLACE.sub(lambda m: str(values[m[1]]), line)
            if made.strip() or not line.strip():
                lines.append(made.rstrip("\n"))
    return "\n".join(lines) + "\n"
