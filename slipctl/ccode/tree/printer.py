"""The one printer of C: nodes as text, no line longer than ``WIDTH`` where it can be broken."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from slipctl.ccode.module.comments import WIDTH, comment
from slipctl.ccode.tree.nodes import Node

STEP = "    "
_BREAKS = (" + ", " - ", " ? ", " : ", " && ", " || ", " | ", " * ", " / ")
_SIMPLE = {"do", "declare", "return", "break", "continue"}
_TOGETHER = {"double", "float", "bool"}


def lines_of(statements: Iterable[Node], indent: str = "") -> list[str]:
    """Lines of statements; what calls and loops fill is declared together, at the first place."""
    return [line for s in _together(statements, indent) for line in _statement(s, indent)]


def signature(kind: str, called: str, given: Sequence[str]) -> str:
    """Declaration of a function, on as many lines as it takes."""
    start = f"{kind} {called}("
    text = f"{start}{', '.join(given)})"
    if len(text) < WIDTH:
        return text
    lines, line = [], start
    for k, a in enumerate(given):
        a += ")" if k == len(given) - 1 else ","
        if len(line) + len(a) > WIDTH and line != start:
            lines.append(line.rstrip())
            line = " " * len(start)
        line += a + " "
    return "\n".join([*lines, line.rstrip()])


def file_text(pieces: Iterable[Node]) -> str:
    """Text of a file: a blank line between pieces, but for functions of one line each."""
    text, short = "", False
    for n in pieces:
        lines = lines_of([n])
        before, short = short, n.kind == "function" and not lines[-1].startswith("}")
        text += "\n" * (bool(text) and not (before and short and len(lines) == 1))
        text += "\n".join(lines) + "\n"
    return text


# ---- statements ---------------------------------------------------------------------------------


def _together(statements: Iterable[Node], indent: str) -> list[Node]:
    """Statements in which what a block declares without a value is one declaration of each type."""
    made: list[Node] = []
    first: dict[str, int] = {}
    for s in statements:
        plain = s.kind == "declare" and s.head in _TOGETHER and not s.told and len(s.parts) == 1
        if not plain or s.parts[0].kind not in ("name", "index"):
            made.append(s)
        elif s.head in first:
            k = first[s.head]
            made[k] = Node("declare", s.head, (*made[k].parts, *s.parts))
        else:
            first[s.head] = len(made)
            made.append(s)
    return [row for s in made for row in _rows(s, indent)]


def _rows(s: Node, indent: str) -> Iterator[Node]:
    """A declaration of several numbers, as often as it takes to be no longer than a line."""
    if s.kind != "declare" or len(s.parts) < 2 or len(indent) + len(s.text) <= WIDTH:
        yield s
        return
    row, length = list[Node](), 0
    for p in s.parts:
        if row and len(indent) + len(s.head) + 1 + length + len(p.text) + 3 > WIDTH:
            yield Node("declare", s.head, tuple(row))
            row, length = [], 0
        length += len(p.text) + 2 * bool(row)
        row.append(p)
    yield Node("declare", s.head, tuple(row))


def _statement(s: Node, indent: str) -> list[str]:
    if s.kind in _SIMPLE:
        return _simple(s, indent)
    if s.kind in ("if", "for", "while", "switch"):
        return _compound(s, indent)
    if s.kind == "block":
        return [f"{indent}{{", *lines_of(s.parts, indent + STEP), f"{indent}}}"]
    if s.kind == "comment":
        return comment(s.head, indent).split("\n")
    if s.kind == "function":
        return _function(s)
    if s.kind == "struct":
        return [f"{s.head} {{", *lines_of(s.parts, STEP), "};"]
    if s.kind == "until":
        inner = lines_of(s.parts[1].parts, indent + STEP)
        return [f"{indent}do {{", *inner, f"{indent}}} while ({s.parts[0]});"]
    if s.kind == "case":
        return [f"{indent[4:]}case {s.parts[0]}:" if s.parts else f"{indent[4:]}default:"]
    return s.head.split("\n") if s.head else [""] * (s.kind == "blank")


def _simple(s: Node, indent: str) -> list[str]:
    elements = _elements(s)
    worked_out = s.head.startswith("const ") and len(_wrapped(indent + s.text, "", False)) < 3
    if elements is not None and len(s.text) > WIDTH - 12 and not worked_out:
        opening = s.text[: -len(elements.text) - 1]
        rows = [elements.parts] if not any(p.kind == "list" for p in elements.parts) else [
            (p,) for p in elements.parts]  # fmt: skip
        texts = [", ".join(p.text for p in row) + "," for row in rows]
        texts[-1] = texts[-1][:-1]
        inner = indent + STEP
        return [
            f"{indent}{opening}{{",
            *(line for t in texts for line in _wrapped(inner + t, "", True, inner)),
            f"{indent}}};{s.told}",
        ]
    if s.kind == "return" and s.parts and s.parts[0].head in _JOINED:
        text = indent + _conjunction(s.parts[0], "return ") + ";"
        return [line for t in text.split("\n") for line in _wrapped(t, "", False)]
    called = s.kind == "do" and s.parts[0].kind == "call"
    return _wrapped(indent + s.text, s.told, called)


def _elements(s: Node) -> Node | None:
    """List of the elements that a statement ends with."""
    e = s.parts[0] if s.kind in ("do", "declare") and len(s.parts) == 1 else None
    if e is None or e.kind != "op" or e.head != "=":
        return None
    given = e.parts[1]
    given = given.parts[0] if given.kind == "cast" else given
    return given if given.kind == "list" else None


def _conjunction(tests: Node, opening: str) -> str:
    """Conditions over as many lines as it takes, behind the opening of a statement."""
    text, width, sign = opening, 4 + len(opening), tests.head
    for k, t in enumerate(_joined(tests, sign)):
        sep = f"{sign} " if k else ""
        if k and width + len(sep) + len(t) + len(" )) {") > WIDTH:
            text, width = f"{text}\n        {sep}{t}", 8 + len(sep) + len(t)
        else:
            text, width = f"{text}{' ' * (k > 0)}{sep}{t}", width + len(sep) + (k > 0) + len(t)
    return text


_JOINED = ("&&", "||", "|")


def _joined(tests: Node, sign: str) -> list[str]:
    """Conditions that are joined by one sign."""
    if tests.kind != "op" or tests.head != sign:
        return [tests.text]
    return [*_joined(tests.parts[0], sign), tests.parts[1].text]


def _opening(s: Node, indent: str) -> str:
    if s.kind == "for":
        first, ends, step = (p.text.removesuffix(";") for p in s.parts[:3])
        return f"{indent}for ({first}; {ends}; {step}) {{"
    c = s.parts[0]
    wide = "if (!("
    if s.kind == "if":
        if c.head in _JOINED:
            return f"{indent}if ({_conjunction(c, wide)[len(wide) :]}) {{"
        if c.head == "!" and c.parts[0].kind == "paren" and c.parts[0].parts[0].head in _JOINED:
            return f"{indent}{_conjunction(c.parts[0].parts[0], wide)})) {{"
    return f"{indent}{s.kind} ({c}) {{"


def _compound(s: Node, indent: str) -> list[str]:
    opening, body = _opening(s, indent), s.parts[3 if s.kind == "for" else 1]
    other = s.parts[2] if s.kind == "if" and len(s.parts) > 2 else None
    only = body.parts[0] if len(body.parts) == 1 else None
    if only is not None and only.kind in _SIMPLE and s.kind != "while" and other is None:
        behind = s.told if s.kind == "if" else only.told
        line = f"{opening} {only.text} }}"
        fits = len((line + behind).rpartition("\n")[2]) <= WIDTH
        short = not only.told if s.kind == "if" else (
            "{" not in only.text and (not only.told or only.told.startswith("  ")))  # fmt: skip
        if short and fits and s.kind != "switch":
            *before, last = (line + behind).split("\n")
            return [*(row for t in before for row in _wrapped(t, "", False)), last]
    lines = [row for t in opening.split("\n") for row in _wrapped(t, "", False)]
    lines[-1] += s.told
    lines += lines_of(body.parts, indent + STEP)
    while other is not None and other.kind == "if":
        lines += _wrapped(f"{indent}}} else if ({other.parts[0]}) {{", "", False)
        lines += lines_of(other.parts[1].parts, indent + STEP)
        other = other.parts[2] if len(other.parts) > 2 else None
    if other is not None:
        lines += [f"{indent}}} else {{", *lines_of(other.parts, indent + STEP)]
    return [*lines, f"{indent}}}"]


def _function(f: Node) -> list[str]:
    head, body = f.parts
    given = [p.text.removesuffix(";") for p in head.parts]
    opening = signature(f.head, head.head, given)
    told = f.told.split("\n") if f.told else []
    only = body.parts[0] if len(body.parts) == 1 else None
    if only is not None and only.kind in _SIMPLE and "\n" not in opening:
        line = f"{opening} {{ {only.text} }}{only.told}"
        if len(line) <= WIDTH and f.head.startswith("static") and not only.told.startswith("  "):
            return [*told, line]
    return [*told, *opening.split("\n"), "{", *lines_of(body.parts, STEP), "}"]


# ---- lines --------------------------------------------------------------------------------------


def _wrapped(line: str, told: str, by_comma: bool, indent: str = "") -> list[str]:
    """A line, going on below, further in, where it is too long."""
    if len(line) <= WIDTH or (told and not told.startswith("  ")):
        return _behind([line], told)
    indent = indent or " " * (len(line) - len(line.lstrip()) + 4)
    found: list[str] = []
    while len(line) > WIDTH:
        at = max(line.rfind(mark, len(indent) + 8, WIDTH) for mark in _BREAKS)
        if at < 0 or by_comma:  # behind a comma, before what the call is given next
            at = line.rfind(", ", len(indent) + 8, WIDTH) + 1
        if at <= 0:
            break
        found.append(line[:at].rstrip())
        line = indent + line[at:].lstrip()
    return _behind([*found, line], told)


def _behind(lines: list[str], told: str) -> list[str]:
    """Lines and the comment behind them, which goes above if there is no room."""
    plain = told and not told.startswith("  ")
    if not told or plain or len(lines[-1]) + len(told) <= WIDTH:
        return [*lines[:-1], lines[-1] + told]
    return [" " * (len(lines[0]) - len(lines[0].lstrip())) + told.strip(), *lines]
