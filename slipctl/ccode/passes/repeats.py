"""Calls of one function, each with what the one before gave, as a loop: steps of an iteration.

Nothing is computed in another order, so the bits stay. Numbers go in by value and come out by
address, so one variable does for both. Arrays come out beside, and are copied then.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from slipctl.ccode.tree.graph import free_name
from slipctl.ccode.tree.statements import call_statement

LEAST = 3
"""Calls from which on they are a loop."""

_DECLARED = re.compile(r"double (\w+)(?:\[(\d+)\])?;")
_CALL = re.compile(r"(\w+)\((.*)\);")


@dataclass(frozen=True)
class _Call:
    """A call with the declarations before it: where it ends, name, arguments, sizes of locals."""

    end: int
    name: str
    arguments: list[str]
    sizes: dict[str, int]

    def given(self, k: int) -> str:
        """Local to which an argument is an address; none for another."""
        name = self.arguments[k].removeprefix("&")
        return name if name in self.sizes else ""


def roll_calls(lines: Sequence[str], taken: set[str]) -> list[str]:
    """Statements in which such calls are a loop.

    Args:
        lines: statements of a C function, without their indentation.
        taken: names that no local may have.
    """
    made, at = list(lines), 0
    while at < len(made):
        calls: list[_Call] = []
        begin = at
        while (call := _call(made, begin)) and (not calls or call.name == calls[0].name):
            calls.append(call)
            begin = call.end
        written = None
        if len(calls) >= LEAST:
            written = _written(calls, made[:at], made[calls[-1].end :], taken)
        if written is None:
            at = at + 1
            continue
        made[at:] = written
        at += 1
    return made


_GIVEN = re.compile(r"\*(?P<to>\w+) = (?P<name>\w+);")


def hand_results(lines: Sequence[str]) -> list[str]:
    """Statements in which a call writes where its result is wanted, not beside it first."""
    made = list(lines)
    for line in lines:
        found = _GIVEN.fullmatch(line)
        if found is None or f"double {found['name']};" not in made:
            continue
        text = "\n".join(made)
        once = len(re.findall(rf"\b{found['to']}\b", text)) == 1
        if once and len(re.findall(rf"\b{found['name']}\b", text)) == 3:
            made = [x for x in made if x not in (line, f"double {found['name']};")]
            made = [re.sub(rf"&{found['name']}\b", found["to"], x) for x in made]
    return made


def _call(lines: Sequence[str], at: int) -> _Call | None:
    """The call that begins at a line, or at the declarations there."""
    sizes: dict[str, int] = {}
    while at < len(lines) and (found := _DECLARED.fullmatch(lines[at])):
        sizes[found[1]] = int(found[2] or 1)
        at += 1
    text = ""
    while at < len(lines) and not text.endswith(";"):
        if text and not lines[at].startswith("    "):
            return None
        text = f"{text} {lines[at].strip()}".strip()
        at += 1
    found = _CALL.fullmatch(text)
    return _Call(at, found[1], _split(found[2]), sizes) if found and sizes else None


def _split(text: str) -> list[str]:
    """Arguments, parted by commas that are in no parentheses."""
    parts, depth = [""], 0
    for char in text:
        depth += (char == "(") - (char == ")")
        if char == "," and not depth:
            parts.append("")
        else:
            parts[-1] += char
    return [p.strip() for p in parts]


def _written(
    calls: Sequence[_Call], there: Sequence[str], after: Sequence[str], taken: set[str]
) -> list[str] | None:
    """The loop and the lines behind it, with its names; None if these calls are none."""
    first, last = calls[0], calls[-1]
    carried: dict[int, int] = {}  # argument -> the one by which it came out of the call before
    for a, b in pairwise(calls):
        if len(a.arguments) != len(b.arguments):
            return None
        out = {a.given(k): k for k in range(len(a.arguments)) if a.given(k)}
        for k, text in enumerate(b.arguments):
            if not b.given(k) and text in out and carried.setdefault(k, out[text]) != out[text]:
                return None
    outs = sorted({k for c in calls[:-1] for k in range(len(c.arguments)) if c.given(k)})
    if not carried or set(carried.values()) - set(outs):
        return None
    for a, b in pairwise(calls):
        for k, text in enumerate(b.arguments):
            before = a.given(carried[k]) if k in carried else a.arguments[k]
            if k not in outs and text != before:
                return None
    inner = {c.given(k) for c in calls[:-1] for k in outs}
    words = set(re.findall(r"\w+", " ".join(after)))
    if inner & words or any(set(c.sizes) - {c.given(k) for k in outs} for c in calls):
        return None
    given = [a for k, a in enumerate(first.arguments) if not first.given(k)]
    used = {*taken, *words, *re.findall(r"\w+", " ".join([*there, *given]))}
    start = {carried[k]: first.arguments[k] for k in carried}
    sizes = {k: first.sizes[first.given(k)] for k in outs}
    names: dict[int, str] = {}
    for k in outs:
        whole = f"{start.get(k)}[{sizes[k]}]" if sizes[k] > 1 else start.get(k)
        if f"double {whole};" in there and start[k] not in words:  # nobody else reads it
            names[k] = start[k]
            continue
        names[k] = free_name(f"{_stem(first.given(k))}_now", used)
        used.add(names[k])
    ahead: list[str] = []
    body: list[str] = []
    behind: list[str] = []
    given = [names[carried[k]] if k in carried else a for k, a in enumerate(first.arguments)]
    for k in outs:
        whole = f"{names[k]}[{sizes[k]}]" if sizes[k] > 1 else names[k]
        if sizes[k] > 1 and k in start:
            other = free_name(f"{_stem(names[k])}_next", used)
            used.add(other)
            if names[k] != start[k]:
                ahead += [f"double {whole};", f"copy({names[k]}, {start[k]}, {sizes[k]});"]
            body.append(f"double {other}[{sizes[k]}];")
            behind.append(f"copy({names[k]}, {other}, {sizes[k]});")
            given[k] = other
        else:
            if names[k] != start.get(k):
                ahead.append(f"double {whole}{f' = {start[k]}' if k in start else ''};")
            given[k] = f"{'&' * (sizes[k] == 1)}{names[k]}"
    loop = [f"for (int i = 0; i < {len(calls)}; ++i) {{"]
    loop += [f"    {line}" for line in [*body, call_statement(f"{first.name}(", given), *behind]]
    loop.append("}")
    renamed = {last.given(k): names[k] for k in outs if last.given(k)}
    for k in outs:
        if not last.given(k):  # an array that is wanted elsewhere
            to = last.arguments[k].removeprefix("&")
            loop.append(
                f"copy({to}, {names[k]}, {sizes[k]});" if sizes[k] > 1 else f"{to} = {names[k]};"
            )
    lines = [
        re.sub(r"(?<![\w>.])[A-Za-z_]\w*", lambda m: renamed.get(m[0], m[0]), line)
        for line in after
    ]
    return [*ahead, *loop, *lines]


def _stem(name: str) -> str:
    return re.sub(r"(_next|_now)?(_\d+)?$", "", name)
