"""Calls in CasADi's text that write where their result is copied to, not beside it first.

A result that a function gives on is an argument of its own: what it calls writes there. Nothing
else reads it, and results never lie where arguments do. So the bits stay.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_COPY = re.compile(
    r"\s*(?:if \(res\[\d+\]\) )?casadi_copy\((?P<name>w\d+), \d+, (?P<to>res\[\d+\])"
    r"(?P<at>\+\d+)?\);"
)
_SAID = re.compile(r"\s*/\* #\d+: output\[\d+\]\[\d+\] = @\d+ \*/")
_CALL = "(arg1, res1, iw, w, 0)"
_DECLARED = re.compile(r"\s*(?P<type>(?:const )?casadi_real) (?P<names>(?:\*|w).*);")
_LOCAL = re.compile(r"\*(w\d+|rr|cs)(?:=w\+\d+)?")
_ONE = re.compile(
    r"for \(rr=\(&(w\d+)\), cs=(\w+)\+(\d+); cs!=\2\+(\d+); cs\+=1\) \*rr\+\+ = \*cs;"
)
"""Loop over one element."""


def direct(text: str) -> str:
    """Text of one function, with as many such calls as there are; no loop over one element."""
    lines = _ONE.sub(_element, text).split("\n")
    code = ["" if line.lstrip().startswith("/*") else line for line in lines]
    taken: set[int] = set()
    for end, line in enumerate(code):
        copied = _COPY.fullmatch(line)
        begin = _given(code, end, copied["name"]) if copied else None
        if copied is None or begin is None:
            continue
        to, at = copied["to"], copied["at"]
        place = f"({to} != NULL) ? {to}{at} : NULL" if at else to
        lines[begin] = code[begin] = code[begin].replace(f"={copied['name']};", f"={place};")
        code[end] = ""
        taken |= {end - 1, end} if _SAID.fullmatch(lines[end - 1]) else {end}
    return "\n".join(_declared([x for k, x in enumerate(lines) if k not in taken]))


def _element(m: re.Match[str]) -> str:
    only = int(m[4]) == int(m[3]) + 1
    return f"{m[1]} = {m[2]}[{m[3]}];" if only else m[0]


def _given(code: Sequence[str], end: int, name: str) -> int | None:
    """Line that gives a local to a call, whose result is copied in line ``end`` and only there."""
    word = re.compile(rf"\b{name}\b")
    places = [k for k, x in enumerate(code) if word.search(x) and not _DECLARED.fullmatch(x)]
    before = max((k for k in places if k < end), default=0)
    after = min((k for k in places if k > end), default=None)
    if not re.fullmatch(rf"\s*res1\[\d+\]={name};", code[before]):
        return None
    if sum(_CALL in x for x in code[before:end]) < 1:
        return None
    return before if after is None or _anew(code[after], name) else None


def _anew(line: str, name: str) -> bool:
    """Whether a line writes a local from its first element to its last, and does not read it."""
    if len(re.findall(rf"\b{name}\b", line)) > 1:
        return False
    filled = rf"rr={name};|res1\[\d+\]={name};|casadi_copy\(.*, {name}\);"
    looped = rf"for \(.*\brr={name}[,;].*\) \(?\*rr\+\+\)? +=.*"
    return re.fullmatch(rf"\s*(?:{filled}|{looped})", line) is not None


def _declared(lines: Sequence[str]) -> list[str]:
    """Lines without declarations of locals that nobody uses any more."""
    text = "\n".join(x for x in lines if not _DECLARED.fullmatch(x))
    found = []
    for line in lines:
        if declared := _DECLARED.fullmatch(line):
            kept = [
                n for n in declared["names"].split(", ")
                if not (m := _LOCAL.fullmatch(n)) or re.search(rf"\b{m[1]}\b", text)
            ]  # fmt: skip
            if not kept:
                continue
            line = f"  {declared['type']} {', '.join(kept)};"
        found.append(line)
    return found
