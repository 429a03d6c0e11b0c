"""Pieces of C statements."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from slipctl.ccode.write.comments import ORIGIN, WIDTH


def define(signature: str, lines: Iterable[str]) -> str:
    """A function of these statements."""
    body = "\n".join(f"    {line}" for line in lines)
    return f"{signature}\n{{\n{body}\n}}"


def if_(condition: list[str], *statements: str) -> str:
    """A branch, which may hold others."""
    body = "\n".join("        " + s.replace("\n", "\n    ") for s in statements)
    return f"if ({condition[0]}) {{\n{body}\n    }}"


def conjunction(tests: list[str]) -> str:
    """Join conditions with && over as many lines as it takes."""
    text, width = "", 0
    for k, t in enumerate(tests):
        if k and width + len(t) > 80:
            text, width = f"{text}\n          && {t}", len(t) + 13
        else:
            text, width = f"{text}{' && ' if k else ''}{t}", width + len(t) + 4
    return text


def wrapped(result: str, function: str, *arguments: str) -> str:
    """Declaration of a function, on as many lines as it takes."""
    start = f"{result} {function}("
    text = start + ", ".join(arguments) + ")"
    if len(text) < WIDTH:
        return text
    lines, line = [], start
    for k, a in enumerate(arguments):
        a += ")" if k == len(arguments) - 1 else ","
        if len(line) + len(a) > WIDTH and line != start:
            lines.append(line.rstrip())
            line = " " * len(start)
        line += a + " "
    return "\n".join([*lines, line.rstrip()])


def called(opening: str, texts: Sequence[str]) -> list[str]:
    """Statement of a call, on as many lines as it takes."""
    lines, line = [], opening
    for k, text in enumerate(texts):
        piece = text + (");" if k == len(texts) - 1 else ", ")
        if len(line) + len(piece) > 84:
            lines.append(line.rstrip())
            line = "    "
        line += piece
    return [*lines, line]


def broken(text: str) -> str:
    """C text of which no statement is longer than a line: it goes on below, further in."""
    lines: list[str] = []
    for whole in text.split("\n"):
        line, behind = whole, ""
        if found := ORIGIN.match(whole):
            line, behind = found["code"], whole[found.end("code") :]
        plain = line.lstrip()
        if len(line) <= WIDTH or plain.startswith(("#", "*", "/*", '"')) or "/*" in line:
            lines += _with([line], behind)
            continue
        statement: list[str] = []
        indent = " " * (len(line) - len(plain) + 4)
        while len(line) > WIDTH:
            at = max(line.rfind(mark, len(indent) + 8, WIDTH) for mark in _BREAKS)
            if at < 0:
                break
            statement.append(line[:at].rstrip())
            line = indent + line[at:].lstrip()
        lines += _with([*statement, line], behind)
    return "\n".join(lines)


_MOVED = re.compile(r"(?P<to>\w+->\w+)\[(?P<at>\d+)\] = (?P<source>\w+->\w+)\[(?P<begin>\d+)\];")


def copied(lines: Sequence[str], least: int = 3) -> list[str]:
    """Statements in which elements that move side by side are one call of ``copy``."""
    made: list[str] = []
    k = 0
    while k < len(lines):
        first, n = _MOVED.fullmatch(lines[k]), 1
        while first and k + n < len(lines) and _follows(first, _MOVED.fullmatch(lines[k + n]), n):
            n += 1
        if first and n >= least and first["to"] != first["source"]:
            ends = (_place(first["to"], first["at"]), _place(first["source"], first["begin"]))
            made.append(f"copy({', '.join(ends)}, {n});")
        else:
            made += lines[k : k + n]
        k += n
    return made


def _follows(first: re.Match[str], other: re.Match[str] | None, n: int) -> bool:
    """Whether an element moves as the first did, n places further on."""
    return (
        other is not None
        and (other["to"], other["source"]) == (first["to"], first["source"])
        and int(other["at"]) == int(first["at"]) + n
        and int(other["begin"]) == int(first["begin"]) + n
    )


def _place(base: str, at: str) -> str:
    return f"&{base}[{at}]" if int(at) else base


def _with(lines: list[str], behind: str) -> list[str]:
    """A statement of some lines and the comment behind it, which goes above if there is no room."""
    if len(lines[-1]) + len(behind) <= WIDTH:
        return [*lines[:-1], lines[-1] + behind]
    return [" " * (len(lines[0]) - len(lines[0].lstrip())) + behind.strip(), *lines]


_BREAKS = (" + ", " - ", " ? ", " : ", " && ", " || ", " * ", " / ")
