"""Locals that no model names get one from what they are: ``a3 = exp(theta)`` is ``exp_theta``.

Only one operation, or two, on what has a name itself; all else stays a letter with a number. Names
are changed when all statements of a C function are there, so nothing else is different.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import casadi as ca

from slipctl.block.text.intermediates import as_it_is, named_inside
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.graph import free_name
from slipctl.ccode.tree.nodes import Node

LONGEST, WORDS = 28, 5
"""Characters and words of a name."""

_WORDS = {
    "+": "plus", "-": "minus", "*": "times", "/": "over", "<": "below", "<=": "up_to",
    ">": "above", ">=": "from", "==": "is", "!=": "is_not", "&&": "and", "||": "or", "!": "not",
}  # fmt: skip
_CALLS = {
    "exp": "exp", "log": "log", "sqrt": "root", "fabs": "abs", "square": "square", "sin": "sin",
    "cos": "cos", "tan": "tan", "atan": "atan", "tanh": "tanh", "sign_of": "sign",
}  # fmt: skip
_TURNED = {"up_to": "from", "below": "above"}
_STRUCTS = {"in", "param", "state", "next", "now"}


def name_locals(lines: Sequence[Node], part: str, taken: Iterable[str]) -> list[Node]:
    """The statements of a C function with names for its anonymous locals.

    Args:
        lines: the statements.
        part: C name of the part whose members lose their first word, ``law_`` of ``law_eta``.
        taken: names that no local may have.
    """
    used = {*taken, *c.words(lines)}
    names: dict[str, Node] = {}
    declared = [n for line in lines for n in line.walk() if n.kind == "declare" and n.parts]
    once = [n.parts[0].base.head for n in declared]
    once += [to.base.head for n in declared if (to := c.target(n)) is not None]
    for line in declared:
        to = c.target(line)
        if to is None or not _is_letter(to, "a") or once.count(to.head) != 1:
            continue
        made, sign = c.value(line).swap(names), line.head.startswith("const ")
        said = (_said if sign else _summed)(made, part, {n.head for n in names.values()})
        if said and said not in used:
            names[to.head] = c.name(said)
            used.add(said)
    lines = c.swap_all(lines, names)
    arrays = {}
    for name, made in _filled(lines).items():
        said = _said(made, part, set(), turned=True)
        if said and said not in used:
            arrays[name] = c.name(said)
            used.add(said)
    return c.swap_all(lines, arrays)


def _filled(lines: Sequence[Node]) -> dict[str, Node]:
    """What an anonymous array is filled with by one statement in a loop, without the indices."""
    found: dict[str, list[Node]] = {}
    for n in (n for line in lines for n in line.walk()):
        if n.kind == "op" and n.head == "=" and _is_letter(n.parts[0].base, "a") and (
            n.parts[0].kind == "index" and n.parts[0].parts[1].kind == "name"
        ):  # fmt: skip
            found.setdefault(n.parts[0].base.head, []).append(n.parts[1].change(
                lambda x: x.base if x.kind == "index" else None))  # fmt: skip
    return {name: values[0] for name, values in found.items() if len(values) == 1}


def with_inside(f: ca.Function, taken: Iterable[str]) -> tuple[ca.Function, dict[Any, str]]:
    """A Function with what its Python has a name for as further results.

    Args:
        f: the Function, of scalar expressions.
        taken: names that none of them may have.

    Returns:
        The Function, and the name of each further result by (number, 0).
    """
    inside = named_inside(f)
    if inside is None:
        return f, {}
    arguments, used = f.sx_in(), set(taken)
    names: dict[Any, str] = {}
    for k, name in enumerate(inside.name_out()):
        own = names[f.n_out() + k, 0] = free_name(name, used)
        used.add(own)
    with as_it_is():
        results = [*f.call(arguments), *inside.call(arguments)]
        return ca.Function(f.name(), arguments, results, {"cse": True}), names


def _is_letter(n: Node, letter: str) -> bool:
    return n.kind == "name" and n.head[:1] == letter and n.head[1:].isdecimal()


def _anonymous(name: str) -> bool:
    """Whether it is letters and a number behind them."""
    letters = name.rstrip("0123456789")
    return letters.isalpha() and letters != name


def _said(made: Node, part: str, derived: Collection[str], turned: bool = False) -> str:
    """Words for an expression; none if it is long or of what has no name of the model."""
    words = _words(made, part, derived)
    if turned and len(words) == 3 and words[0][:1].isdigit() and words[1] in _TURNED:
        words = [words[2], _TURNED[words[1]], words[0]]
    if len(words) == 3 and words[1] == "times" and words[0][:1].isdigit():
        words.reverse()
    said = "_".join(words)
    good = 1 < len(words) <= WORDS and len(said) <= LONGEST and not said[0].isdigit()
    return said if good and all(words) else ""


def _words(n: Node, part: str, derived: Collection[str]) -> list[str]:
    """Word for each operation and operand, in their order; empty for what has none."""
    inside = [word for p in n.parts for word in _words(p, part, derived)]
    if n.kind == "op":
        before = _words(n.parts[0], part, derived)
        return [*before, _WORDS.get(n.head, ""), *inside[len(before) :]]
    if n.kind == "paren" or (n.kind == "unary" and n.head == "*"):
        return inside
    if n.kind in ("unary", "call", "cast"):
        word = {"unary": _WORDS, "call": _CALLS}.get(n.kind, {n.head: n.head}).get(n.head, "")
        return [word if n.kind != "call" or len(n.parts) == 1 else "", *inside]
    word = _word(n, part)
    return ["" if n.text in derived else word]


def _word(n: Node, part: str) -> str:
    """Word for an operand; none for a number of many digits, or what has no name."""
    if n.kind == "number":
        whole, _, rest = n.head.partition(".")
        short = rest.isdecimal() and len(whole) < 3 and len(rest) < 5
        return n.head.removesuffix(".0").replace(".", "_") if short else ""
    base, at = n.base, n.parts[1].text if n.kind == "index" else ""
    if base.kind not in ("name", "member") or (at and not at.isdecimal()):
        return ""
    while base.head.startswith("->") and base.parts[0].head in _STRUCTS:
        base = c.name(base.head[2:])
    word = base.text.replace("->", "_").replace(".", "_").removeprefix(f"{part}_")
    return "" if _anonymous(word) else f"{word}_{at}" if at else word


def _summed(made: Node, part: str, derived: Collection[str]) -> str:
    """Words for a sum, by one of its terms: what is summed, and the condition that it is with."""
    arrays = [
        (n.base.head.removeprefix("->").removeprefix(".")).removeprefix(f"{part}_")
        for n in made.walk()
        if n.kind == "index" and n.parts[1].kind in ("name", "number")
    ]
    if not arrays or any(_anonymous(name) for name in arrays):
        return ""
    *others, last = dict.fromkeys(arrays)
    last = f"square_{last}" if "square" in made.calls() else last
    chosen = any(n.kind == "choice" for n in made.walk())
    return "_".join([last, *others]) if chosen and others else f"sum_{last}"
