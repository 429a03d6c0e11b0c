"""Loops over the same elements become one loop; an array read only at hand becomes a number.

What a loop computes depends on nothing that stands between it and the one before, so it may be done
there. Each value is computed from the same values in the same order, so the bits stay.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_FOR = re.compile(r"for \(int i = \d+; i < \d+; \+\+i\) \{")
_TARGET = re.compile(
    r"\s*(?:(?:const )?(?:double|bool) )?\*?(?P<name>[A-Za-z_]\w*(?:->\w+)?)(?:\[[^=]*\])?"
    r"(?: [-+*/]?= |;)"
)
_BEGUN = re.compile(r"(?:double|bool) \w+(?:\[\d+\]| = .*);")
_ARRAY = re.compile(r"(double|bool) (\w+)\[(\d+)\];")


def _carries(name: str) -> re.Pattern[str]:
    """Statement by which the element of an array goes on into the next turn."""
    return re.compile(rf"    (\w+) = {name}\[i\];")


@dataclass(frozen=True)
class _Loop:
    """A loop in lines: its first line, the line behind it, declarations before it."""

    at: int
    end: int
    begun: int

    def body(self, lines: Sequence[str]) -> list[str]:
        return list(lines[self.at + 1 : self.end - 1])


def fuse_loops(lines: Sequence[str]) -> list[str]:
    """Statements of a C function, of which loops that may be one are one."""
    now = list(lines)
    while (other := next(_joined(now), None)) is not None:
        now = other
    return _numbers(now)


def _loops(lines: Sequence[str]) -> Iterator[_Loop]:
    for at, line in enumerate(lines):
        if not _FOR.fullmatch(line):
            continue
        end = at + 1 + list(lines[at:]).index("}")
        begun = at
        while begun and _BEGUN.fullmatch(lines[begun - 1]):
            begun -= 1
        yield _Loop(at, end, begun)


def _joined(lines: list[str]) -> Iterator[list[str]]:
    """Lines with one loop less, for each two loops that may be one."""
    found = list(_loops(lines))
    for k, a in enumerate(found):
        for b in found[k + 1 :]:
            begun = max(b.begun, a.end)
            if lines[a.at] == lines[b.at] and _free(lines, a, b, begun):
                yield [
                    *lines[: a.at], *lines[begun : b.at], *lines[a.at : a.end - 1],
                    *b.body(lines), "}", *lines[a.end : begun], *lines[b.end :],
                ]  # fmt: skip


def _free(lines: Sequence[str], a: _Loop, b: _Loop, begun: int) -> bool:
    """Whether what loop b does, and what it begins with, may be done with loop a."""
    first, second = a.body(lines), b.body(lines)
    between, begins = lines[a.end : begun], lines[begun : b.at]
    if any(_FOR.fullmatch(line.strip()) for line in (*first, *second)):
        return False
    made_first, made_second = _targets(first), _targets([*second, *begins])
    made_between = _targets(between)
    if made_first & made_second or made_between & (_words(second) | _words(begins)):
        return False
    if made_second & (_words(between) | _words(first)) or made_first & _words(begins):
        return False
    text = "\n".join(second)
    elements = set(re.findall(r"([A-Za-z_]\w*(?:->\w+)?)\[i\]", text))
    for name in made_first & _words(second):
        whole = len(re.findall(rf"(?<![\w>]){re.escape(name)}\b", text))
        if name not in elements or whole != text.count(f"{name}[i]"):
            return False
        if any(re.match(rf"\s*{re.escape(name)}\[(?!i\])", line) for line in first):
            return False
    return True


def _targets(lines: Sequence[str]) -> set[str]:
    """Names that statements give values to, or declare."""
    found = {m["name"] for line in lines if (m := _TARGET.match(line))}
    return found | {"?"} if any("(&" in line or ", &" in line for line in lines) else found


def _words(lines: Sequence[str]) -> set[str]:
    """Names in statements, of members with their struct."""
    return set(re.findall(r"[A-Za-z_]\w*(?:->\w+)?", " ".join(lines))) - {"i"}


def _numbers(lines: Sequence[str]) -> list[str]:
    """Lines in which an array that one loop fills and reads at hand is a number of its turn."""
    now = list(lines)
    for line in lines:
        declared = _ARRAY.fullmatch(line)
        if declared is None:
            continue
        kind, name, size = declared.groups()
        carried = next((m[1] for x in now if (m := _carries(name).fullmatch(x))), None)
        if carried:  # its last value, behind the loop
            now = [x if x.startswith(" ") else re.sub(rf"(?<![\w>]){name}\[{int(size) - 1}\]",
                                                      carried, x) for x in now]  # fmt: skip
        use = re.compile(rf"(?<![\w>]){name}\b")
        places = [k for k, x in enumerate(now) if x != line and use.search(x)]
        loop = next((x for x in _loops(now) if places and x.at < places[0] < x.end), None)
        if loop is None or places[-1] >= loop.end:
            continue
        text = "\n".join(now[k] for k in places)
        start = f"    {name}[i] = "
        if len(use.findall(text)) != text.count(f"{name}[i]") or text.count(f"\n{start}"):
            continue
        if not now[places[0]].startswith(start) or name in now[places[0]][len(start) :]:
            continue
        for k in places:
            now[k] = now[k].replace(f"{name}[i]", name)
        now[places[0]] = f"    const {kind} {now[places[0]].strip()}"
        now.remove(line)
    return now
