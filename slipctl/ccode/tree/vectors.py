"""Text of vectors in C: which elements of which array they are, and loops over them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from slipctl.ccode.module.comments import WIDTH

AT = "@"
"""Stands for the index of the element in the text of a vector."""


def element_text(text: str, k: int | str) -> str:
    """Text of one element of a vector: number k, or that of a loop."""

    def index(m: re.Match[str]) -> str:
        inside = m[1].replace(AT, str(k))
        return f"[{_computed(inside)}]"

    return re.sub(r"\[([^\[\]]*@[^\[\]]*)\]", index, text).replace(AT, str(k))


def _computed(index: str) -> str:
    """An index of numbers alone, worked out."""
    if re.fullmatch(r"[\d +*%/()]+", index):
        return str(eval(index.replace("/", "//"), {"__builtins__": {}}))
    return re.sub(r"\b0 \+ ", "", index)


def place(base: str, offset: int, stride: int = 1) -> str:
    """Text of the element of a vector that lies in an array."""
    step = AT if stride == 1 else f"{stride} * {AT}"
    return f"{base}[{offset} + {step}]" if offset else f"{base}[{step}]"


def array_and_offset(text: str) -> tuple[str, int] | None:
    """Array and offset of a vector that lies side by side in memory."""
    m = re.fullmatch(r"([A-Za-z_][\w.>-]*)\[(?:(\d+) \+ )?@\]", text)
    return (m[1], int(m[2] or 0)) if m else None


def address(base: str, offset: int) -> str:
    """C expression of the address of an element."""
    return f"&{base}[{offset}]" if offset else base


def by_blocks(places: Sequence[int], offset: int) -> str | None:
    """Index of elements that are taken in blocks as far apart as each other: ``@ / 5 * 31 + ...``.

    None if they are not, or are fewer than eight.
    """
    n, first = len(places), places[0]
    if n < 8 or min(places) < 0:
        return None
    for size in (k for k in range(1, n) if n % k == 0):
        step = places[1] - first if size > 1 else 0
        apart = places[size] - first
        wanted = [first + k // size * apart + k % size * step for k in range(n)]
        if wanted == list(places) and step >= 0 and apart > 0:
            begin = f"{first + offset} + " * bool(first + offset)
            block = AT if size == 1 else f"{AT} / {size}"
            inside = f" + {AT} % {size}{f' * {step}' * (step != 1)}" * (size > 1 and step > 0)
            return f"{begin}{block} * {apart}{inside}"
    return None


_MOVED = re.compile(
    r"(?P<to>[\w.>-]+)\[(?:(?P<at>\d+) \+ )?@\] = "
    r"(?:(?P<source>[\w.>-]+)\[(?:(?P<begin>\d+) \+ )?@\]|(?P<number>-?\d[\d.e+-]*));"
)


def loop(n: int, line: str) -> list[str]:
    """A loop over n elements, of a statement with ``AT`` in it; a call where it only moves them."""
    if found := _MOVED.fullmatch(line):
        to = address(found["to"], int(found["at"] or 0))
        if found["number"]:
            return [f"fill({to}, {n}, {found['number']});"]
        return [f"copy({to}, {address(found['source'], int(found['begin'] or 0))}, {n});"]
    return [f"for (int i = 0; i < {n}; ++i) {{", f"    {element_text(line, 'i')}", "}"]


def initialiser_lines(declared: str, texts: Sequence[str], sign: str = " = ") -> list[str]:
    """Declaration of an array or a struct with its elements; the lines are broken later."""
    if len(line := f"{declared}{sign}{{{', '.join(texts)}}};") <= WIDTH - 12:
        return [line]
    return [f"{declared}{sign}{{", f"    {', '.join(texts)}", "};"]
