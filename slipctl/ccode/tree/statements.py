"""Pieces of C statements."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from slipctl.ccode.module.comments import ORIGIN, WIDTH


def define(signature: str, lines: Iterable[str]) -> str:
    """A function of these statements."""
    body = "\n".join(f"    {line}" for line in lines)
    return f"{signature}\n{{\n{body}\n}}"


def if_(condition: list[str], *statements: str) -> str:
    """A branch, which may hold others."""
    body = "\n".join("        " + s.replace("\n", "\n    ") for s in statements)
    return f"if ({condition[0]}) {{\n{body}\n    }}"


def short(text: str) -> str:
    """C text in which a function, a loop or a branch of one statement is one line, if it fits."""

    def joined(found: re.Match[str]) -> str:
        line = f"{found['signature']} {{ {found['body']} }}{found['told'] or ''}"
        return line if len(line) <= WIDTH else found[0]

    whole = re.compile(
        r"^(?P<signature>static [^\n;=]*\))\n\{\n"
        r"    (?P<body>[^\n]*;)(?P<told> /\*[^\n]*\*/)?\n\}$",
        re.M,
    )
    text = whole.sub(joined, text)
    text = _TURNS.sub(_one_line, text)
    text = _BRANCH.sub(_one_branch, text)
    return _NEXT.sub(r"\1", _together(text))


_NEXT = re.compile(
    r"(?<=^static )([^\n]* \}(?: /\*[^\n]*\*/)?\n)\n(?=static [^\n]* \}(?: /\*[^\n]*\*/)?$)", re.M
)
_TURNS = re.compile(
    r"^(?P<for> *for \([^\n]*\) \{)\n +(?P<body>[^\n{}]*;)(?P<told>  /\*[^\n]*\*/)?\n *\}$", re.M
)


def _one_line(found: re.Match[str]) -> str:
    line = f"{found['for']} {found['body']} }}{found['told'] or ''}"
    return line if len(line) <= WIDTH else found[0]


_BRANCH = re.compile(
    r"^(?P<if> *if \([^{}]*\) \{)(?P<told> /\*[^\n]*\*/)?\n +(?P<body>[^\n]*;)\n *\}$", re.M
)


def _one_branch(found: re.Match[str]) -> str:
    text = f"{found['if']} {found['body']} }}{found['told'] or ''}"
    return text if len(text.rpartition("\n")[2]) <= WIDTH else found[0]


_DECLARED = re.compile(r"(?P<indent> +)(?P<kind>double|float|bool) (?P<name>\w+(?:\[\d+\])?);")


def _together(text: str) -> str:
    """C text in which a block declares what calls and loops fill at its first such place."""
    rows: list[str] = []
    blocks: list[dict[str, int]] = [{}]  # for each open block, the line of each kind
    for line in text.split("\n"):
        found = _DECLARED.fullmatch(line)
        if found is None:
            rows.append(line)
            for brace in re.findall(r"[{}]", line):
                blocks = [*blocks, {}] if brace == "{" else blocks[:-1] or [{}]
        elif (first := blocks[-1].get(found["kind"])) is not None:
            rows[first] = f"{rows[first][:-1]}, {found['name']};"
        else:
            blocks[-1][found["kind"]] = len(rows)
            rows.append(line)
    return "\n".join(row for line in rows for row in _declaration(line))


def _declaration(line: str) -> list[str]:
    """A declaration of several numbers, as often as it takes to be no longer than a line."""
    found = re.fullmatch(r"( +(?:double|float|bool) )(\w[\w, \[\]]*);", line)
    if found is None or len(line) <= WIDTH:
        return [line]
    rows = [""]
    for name in found[2].split(", "):
        if rows[-1] and len(found[1]) + len(rows[-1]) + len(name) + 3 > WIDTH:
            rows.append("")
        rows[-1] += f"{', ' if rows[-1] else ''}{name}"
    return [f"{found[1]}{row};" for row in rows]


def conjunction(tests: list[str], opening: str = "if (!(", sign: str = "&&") -> str:
    """Join conditions over as many lines as it takes, behind the opening of a statement."""
    text, width = "", 4 + len(opening)
    for k, t in enumerate(tests):
        sep = f"{sign} " if k else ""
        if k and width + len(sep) + len(t) + len(" )) {") > WIDTH:
            text, width = f"{text}\n        {sep}{t}", 8 + len(sep) + len(t)
        else:
            text, width = f"{text}{' ' * (k > 0)}{sep}{t}", width + len(sep) + (k > 0) + len(t)
    return text


def declaration_lines(result: str, function: str, *arguments: str) -> str:
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


def call_statement(opening: str, texts: Sequence[str]) -> str:
    """Statement of a call."""
    return f"{opening}{', '.join(texts)});"


def break_lines(text: str) -> str:
    """C text of which no statement is longer than a line: it goes on below, further in."""
    lines: list[str] = []
    for whole in text.split("\n"):
        line, behind = whole, ""
        if found := ORIGIN.match(whole):
            line, behind = found["code"], whole[found.end("code") :]
        plain = line.lstrip()
        if len(line) <= WIDTH or plain.startswith(("#", "* ", "*/", "/*", '"')) or "/*" in line:
            lines += _with([line], behind)
            continue
        statement: list[str] = []
        listed = bool(lines) and lines[-1].endswith(
            ("= {", "){")
        )  # elements: the others begin alike
        indent = " " * (len(line) - len(plain) + (0 if listed else 4))
        by_comma = listed or _CALL.fullmatch(plain) is not None
        while len(line) > WIDTH:
            at = max(line.rfind(mark, len(indent) + 8, WIDTH) for mark in _BREAKS)
            if at < 0 or by_comma:  # behind a comma, before what the call is given next
                at = line.rfind(", ", len(indent) + 8, WIDTH) + 1
            if at <= 0:
                break
            statement.append(line[:at].rstrip())
            line = indent + line[at:].lstrip()
        lines += _with([*statement, line], behind)
    return "\n".join(lines)


_CALL = re.compile(r"\w+\(.*\);")

_LOCAL = re.compile(r"(?P<indent> *)const double (?P<name>\w+) = ")
_TOLD = re.compile(r"  /\*[^*]*\*/$")


def place_locals(lines: Sequence[str]) -> list[str]:
    """Statements in which a local that a member is given is that member, where this is shorter.

    Of a local that several members are given it is the first.
    """
    now = list(lines)
    for line in lines:
        found = _LOCAL.match(line)
        if found is None or line not in now:
            continue
        at, name = now.index(line), found["name"]
        given = re.compile(rf"{found['indent']}((?:next|now)->\w+) = {name};")
        to = next((k for k in range(at + 1, len(now)) if given.match(now[k])), None)
        if to is None or any(_indent(r) < len(found["indent"]) for r in now[at:to]):
            continue
        member = re.match(r"\s*((?:next|now)->\w+)", now[to])
        assert member is not None
        told = _TOLD.search(now[to])
        behind = told[0] if told and not _TOLD.search(line) else ""
        use = re.compile(rf"(?<![\w>.]){name}\b")
        rest = [use.sub(member[1], r) for k, r in enumerate(now[at + 1 :], at + 1) if k != to]
        first = f"{found['indent']}{member[1]} = {line[found.end() :]}{behind}"
        tried = [*now[:at], first, *rest]
        if _length(tried) < _length(now):
            now = tried
    return now


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _length(lines: Sequence[str]) -> int:
    """Lines that statements take."""
    return break_lines("\n".join(f"    {line}" for line in lines)).count("\n")


def line_count(lines: Sequence[str]) -> int:
    """Lines that statements take, in which a loop of one statement may be one."""
    text = short("".join(f"    {line}\n" for line in lines))
    return break_lines(text).count("\n")


_MOVED = re.compile(r"(?P<to>\w+->\w+)\[(?P<at>\d+)\] = (?P<source>\w+->\w+)\[(?P<begin>\d+)\];")


def copy_statements(lines: Sequence[str], least: int = 3) -> list[str]:
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
    if not behind or len(lines[-1]) + len(behind) <= WIDTH:
        return [*lines[:-1], lines[-1] + behind]
    return [" " * (len(lines[0]) - len(lines[0].lstrip())) + behind.strip(), *lines]


_BREAKS = (" + ", " - ", " ? ", " : ", " && ", " || ", " | ", " * ", " / ")
