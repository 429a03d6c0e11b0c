"""Arrays of functions that need much room lie in the state, not on the stack.

Each function has a struct of its own in it, so nothing overlaps: no function calls itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from slipctl.ccode.tree.statements import declaration_lines

DEEPEST = 2048
"""Numbers in arrays of functions that call each other above which the larger ones leave the
stack: 8 kB of floats."""

LARGE = 16
"""Numbers of an array above which it leaves the stack then."""

OWN = "own"
"""Pointer of a function to its arrays."""

_ARRAY = re.compile(r"^ +double (\w+)\[(\d+)\];\n", re.MULTILINE)
_HEAD = re.compile(r"^static (?P<type>\w+) (?P<name>\w+)\((?P<given>[^)]*)\)\n\{\n", re.MULTILINE)

Arrays = tuple[tuple[str, int], ...]
"""Names and sizes."""


@dataclass(frozen=True)
class Scratch:
    """Functions whose large arrays lie elsewhere.

    Attributes:
        texts: the functions by name.
        lines: statements that call them.
        arrays: of each function that has some, by its name.
    """

    texts: Mapping[str, str]
    lines: tuple[str, ...]
    arrays: Mapping[str, Arrays]

    @property
    def numbers(self) -> int:
        """Numbers in all of them."""
        return sum(n for rows in self.arrays.values() for _, n in rows)


def off_stack(texts: Mapping[str, str], lines: Sequence[str], declared: str) -> Scratch:
    """Move large arrays off the stack, if they are much together.

    Args:
        texts: functions by name, before lines are joined.
        lines: statements that call them.
        declared: declaration of the argument ``work``, behind which the arrays lie.
    """
    arrays = {
        name: tuple((a, int(n)) for a, n in _ARRAY.findall(text)) for name, text in texts.items()
    }
    called = {n: set(re.findall(r"(\w+)\(", _body(text))) for n, text in texts.items()}
    calls = {n: [m for m in texts if m in called[n]] for n in texts}
    deepest: dict[str, int] = {}

    def depth(name: str) -> int:
        if name not in deepest:
            own = sum(n for _, n in arrays[name])
            deepest[name] = own + max((depth(m) for m in calls[name]), default=0)
        return deepest[name]

    if max((depth(n) for n in texts), default=0) <= DEEPEST:
        return Scratch(texts, tuple(lines), {})
    large = {name: tuple(row for row in rows if row[1] > LARGE) for name, rows in arrays.items()}
    large = {name: rows for name, rows in large.items() if rows}
    needing = set(large)
    while more := {n for n in texts if n not in needing and needing & set(calls[n])}:
        needing |= more
    of_work = declared.removesuffix("*work").strip()
    made = {}
    for name, text in texts.items():
        for other in (m for m in calls[name] if m in needing):
            text = _given(text, other)
        if name in large:
            text = _moved(text, large[name], f"{of_work}_{name}")
        if name in needing:
            head = _HEAD.search(text)
            assert head is not None
            given = " ".join(head["given"].split()).removesuffix("void")
            arguments = [*([given] if given else []), declared]
            opening = declaration_lines(
                f"static {head['type']}", name, *", ".join(arguments).split(", ")
            )
            text = f"{text[: head.start()]}{opening}\n{{\n{text[head.end() :]}"
        made[name] = text
    for name in needing:
        lines = [_given(line, name) for line in lines]
    return Scratch(made, tuple(lines), large)


def _body(text: str) -> str:
    """What a function does, without what is told of it."""
    head = _HEAD.search(text)
    return re.sub(r"/\*.*?\*/", "", text[head.end() :] if head else text, flags=re.DOTALL)


def _moved(text: str, arrays: Arrays, struct: str) -> str:
    """A function whose arrays are members of its struct."""
    head = _HEAD.search(text)
    assert head is not None
    body = text[head.end() :]
    names = {name for name, _ in arrays}
    body = _ARRAY.sub(lambda m: "" if m[1] in names else m[0], body)
    body = re.sub(
        rf"(?<![\w>.])({'|'.join(sorted(names))})\b(?! *\()", lambda m: f"{OWN}->{m[1]}", body
    )
    pointer = f"    {struct} *const {OWN} = &work->{head['name']};\n"
    return text[: head.end()] + pointer + body


def _given(text: str, name: str) -> str:
    """Text in which calls of a function are given ``work`` too."""
    made, at = "", 0
    for m in re.finditer(rf"(?<![\w>.]){name}\(", text):
        if m.start() < at or text[: m.start()].endswith(("static void ", "static double ")):
            continue
        depth, end = 1, m.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            end += 1
        inside = text[m.end() : end - 1].rstrip()
        made += text[at : m.end()] + inside + (", " if inside else "") + "work)"
        at = end
    return made + text[at:]


def structs(arrays: Mapping[str, Arrays], name: str) -> list[str]:
    """Declarations of the structs that hold them, and of the one that holds these."""
    lines: list[str] = []
    for function, rows in arrays.items():
        lines += [f"struct {name}_{function} {{"]
        lines += [f"    double {a}[{n}];" for a, n in rows]
        lines += ["};", ""]
    lines += [f"struct {name} {{", *(f"    struct {name}_{f} {f};" for f in arrays), "};", ""]
    return lines
