"""Locals that no model names get one from what they are: ``a3 = exp(theta)`` is ``exp_theta``.

Only one operation, or two, on what has a name itself; all else stays a letter with a number. Names
are changed in the text of a C function when all its lines are there, so nothing else is different.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import casadi as ca

from slipctl.block.text.intermediates import as_it_is, named_inside
from slipctl.ccode.tree.graph import free_name

LONGEST, WORDS = 28, 5
"""Characters and words of a name."""

_SUM = re.compile(r"\s*double (?P<name>a\d+) = (?P<text>.*);")
_ARRAY = re.compile(r"(?:\w+->)?([A-Za-z_]\w*)\[\w+\]")
_DECLARED = re.compile(r"\s*const (?:double|bool) (?P<name>a\d+) = (?P<text>.*);")
_TOKEN = re.compile(
    r"\d[\w.]*(?:(?<=e)-\d+)?|\w+(?:(?:->|\.)[A-Za-z_]\w*)*(?:\[\w+\])?|[-+*/<>=!&|?:]+|[(),]|\S"
)
_WORDS = {
    "+": "plus", "-": "minus", "*": "times", "/": "over", "<": "below", "<=": "up_to",
    ">": "above", ">=": "from", "==": "is", "!=": "is_not", "&&": "and", "||": "or", "!": "not",
}  # fmt: skip
_CALLS = {
    "exp": "exp", "log": "log", "sqrt": "root", "fabs": "abs", "square": "square", "sin": "sin",
    "cos": "cos", "tan": "tan", "atan": "atan", "tanh": "tanh", "sign_of": "sign",
}  # fmt: skip
_ANONYMOUS = re.compile(r"[A-Za-z]+\d+")
_POINTERS = re.compile(r"(?:in|param|state|next|now)->")


def name_locals(lines: Sequence[str], part: str, taken: Iterable[str]) -> list[str]:
    """The statements of a C function with names for its anonymous locals.

    Args:
        lines: the statements.
        part: C name of the part whose members lose their first word, ``law_`` of ``law_eta``.
        taken: names that no local may have.
    """
    used = {*taken, *re.findall(r"[A-Za-z_]\w*", " ".join(lines))}
    names: dict[str, str] = {}
    for line in lines:
        found = _DECLARED.match(line) or _SUM.match(line)
        if found is None or sum(_is_declared(found["name"], other) for other in lines) != 1:
            continue
        text = _renamed(found["text"], names)
        words = _said(text, part, names.values())
        if _SUM.match(line):
            words = _summed(text, part)
        if words and words not in used:
            names[found["name"]] = words
            used.add(words)
    return [_renamed(line, names) for line in lines]


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


def _is_declared(name: str, line: str) -> bool:
    return re.match(rf"\s*(?:const )?(?:double|bool|int) {name}\b", line) is not None


def _renamed(text: str, names: dict[str, str]) -> str:
    return re.sub(r"(?<![\w>.])a\d+\b", lambda m: names.get(m[0], m[0]), text)


def _said(text: str, part: str, derived: Collection[str]) -> str:
    """Words for an expression; none if it is long or of what has no name of the model."""
    words: list[str] = []
    tokens = _TOKEN.findall(re.sub(r"\*(?=[A-Za-z_])", "", text))  # not what an address holds
    for token, after in zip(tokens, [*tokens[1:], ""], strict=True):
        if token in ("(", ")"):
            continue
        word = _WORDS.get(token) or (_CALLS.get(token) if after == "(" else _word(token, part))
        if not word or token in derived:
            return ""
        words.append(word)
    if len(words) == 3 and words[1] == "times" and words[0][:1].isdigit():
        words.reverse()
    said = "_".join(words)
    good = 1 < len(words) <= WORDS and len(said) <= LONGEST and not said[0].isdigit()
    return said if good else ""


def _summed(text: str, part: str) -> str:
    """Words for a sum, by one of its terms: what is summed, and the condition that it is with."""
    arrays = [name.removeprefix(f"{part}_") for name in _ARRAY.findall(text)]
    if not arrays or any(_ANONYMOUS.fullmatch(name) for name in arrays):
        return ""
    *others, last = dict.fromkeys(arrays)
    last = f"square_{last}" if "square(" in text else last
    return "_".join([last, *others]) if "?" in text and others else f"sum_{last}"


def _word(token: str, part: str) -> str:
    """Word for an operand; none for a number of many digits, or what has no name."""
    if re.fullmatch(r"\d{1,2}\.\d{1,4}", token):
        return token.removesuffix(".0").replace(".", "_")
    if not re.match(r"[A-Za-z_]", token):
        return ""
    base, _, at = token.partition("[")
    base = _POINTERS.sub("", base).replace("->", "_").replace(".", "_")
    base = base.removeprefix(f"{part}_")
    if _ANONYMOUS.fullmatch(base) or (at and not at[:-1].isdigit()):
        return ""
    return f"{base}_{at[:-1]}" if at else base
