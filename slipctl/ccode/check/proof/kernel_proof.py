"""CasADi's text in a module, proven function by function; the calls between them by contracts.

Followed call by call, a solver of a hundred passes over twenty stages takes Eva hours. So each
function is looked at once, whatever it is given. For those that it calls stands what they promise:

* They read as many numbers as CasADi's comment above the function says. All of them are set, and
  NaN and infinity are among them.
* A truth value that becomes an integer is 0 or 1, and lies in no scratch.
* Results are as many numbers, any at all. All of them are set where they are wanted.
* Arrays of pointers and the scratch are as long as needed, and 0 is returned.

Each promise is checked where it is used and where it is made. Nothing here is trusted: what this
text is read wrong for ends in an alarm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from slipctl.ccode.module.kernel import KERNEL
from slipctl.ccode.tree.nodes import Node, block, target, value
from slipctl.ccode.tree.parser import code

CONTRACTS = "contracts.h"
"""File of what the functions promise."""

PROOFS = "proofs.c"
"""File of the program that calls each function with anything that it may be given."""

_SIGNATURE = re.compile(r"\w+:\((?P<takes>[^)]*)\)->\((?P<gives>[^)]*)\)")
_SIZE = re.compile(r"\w+(?:\[(\d+)(?:x(\d+))?(?:,(\d+)nz)?\])?")

Pattern = tuple[tuple[bool, ...], tuple[bool, ...]]
"""Which of the arguments, and of the results, are there."""


@dataclass
class Function:
    """A function of CasADi's text: its sizes, whom it calls, and how it is called."""

    name: str
    body: Node
    takes: tuple[int, ...]
    gives: tuple[int, ...]
    flags: tuple[int, ...]
    room: tuple[int, int] = (0, 0)
    patterns: set[Pattern] = field(default_factory=set)


def text_with_contracts(
    name: str, file: str, text: str, real: str, work: tuple[int, int]
) -> tuple[dict[str, str], int]:
    """What is analysed of a module with CasADi's text.

    Args:
        name: of the module.
        file: of its parts, which has CasADi's text.
        text: C of this file.
        real: its type of numbers.
        work: integers and numbers of the scratch that it gives to CasADi's text.

    Returns:
        Texts by file name: the module, each call of a function of CasADi's text replaced by its
        contract, lines as they were; the contracts, and the program that proves them. How many
        contracts it proves.
    """
    begin, end = (text.index(f"/* {mark} */") for mark in KERNEL)
    whole = [n for n in code(text) if n.kind == "function"]
    within = {n.parts[0].head for n in code(text[begin:end]) if n.kind == "function"}
    functions = {f.name: f for n in whole if n.parts[0].head in within and (f := _read(n))}
    if not functions:
        return {file: text}, 0
    _rooms(functions)
    rest = block(n.parts[1] for n in whole if n.parts[0].head not in functions)
    _follow(functions, Function("", rest, (), (), ()), ((), ()))  # what is followed as it is
    longest = max(n for f in functions.values() for n in (*f.takes, *f.gives))
    turns = f"/*@ loop unroll {longest}; */"
    text = text[:begin] + text[begin:end].replace("for (", f"{turns} for (") + text[end:]
    replaced = re.sub(rf"(?<!static int )\b({'|'.join(functions)})\(", r"any_\1(", text)
    used = [f for f in functions.values() if f.patterns]
    sizes = sorted({n for f in used for n in (*f.takes, *f.gives) if n})
    proofs = _proofs(used, real, work)
    return {
        file: replaced.replace(f"/* {KERNEL[0]} */", f'#include "{CONTRACTS}"', 1),
        CONTRACTS: "\n".join(_contracts(used, sizes, real, work)) + "\n",
        PROOFS: "\n".join([f'#include "{name}.c"', *proofs]) + "\n",
    }, sum(len(f.patterns) for f in used)


def _read(n: Node) -> Function | None:
    """A function that CasADi has written for a Function, which the comment before it tells."""
    said = _SIGNATURE.search(" ".join(n.told.split()))
    if said is None:
        return None
    takes, gives = (
        tuple(
            int(s[3]) if s[3] else math.prod(int(n) for n in s.groups()[:2] if n)
            for s in _SIZE.finditer(said[side])
        )
        for side in ("takes", "gives")
    )
    flags = {
        int(x.parts[0].parts[0].parts[0].parts[1].head) for x in n.walk()
        if x.kind == "cast" and x.head == "int" and x.text.startswith("(int)(*arg[")
    }  # fmt: skip
    return Function(n.parts[0].head, n.parts[1], takes, gives, tuple(sorted(flags)))


def _shifted(n: Node) -> tuple[str, int]:
    """Array of pointers, and where it begins in it: ``arg + 3``."""
    if n.kind == "op" and n.head == "+" and n.parts[1].kind == "number":
        return n.parts[0].head, int(float(n.parts[1].head))
    return (n.head, 0) if n.kind == "name" else ("", 0)


def _rooms(functions: dict[str, Function]) -> None:
    """Lengths of the arrays of pointers that each needs, with what it calls; callees come first."""
    for f in functions.values():
        items = [p for n in f.body.walk() if n.kind in ("declare", "do") for p in n.parts]
        shifts = {
            p.parts[0].text.lstrip("*"): _shifted(p.parts[1])[1] for p in items
            if p.kind == "op" and p.head == "=" and _shifted(p.parts[1])[0] in ("arg", "res")
        }  # fmt: skip
        room = [len(f.takes), len(f.gives)]
        for n in f.body.walk():
            if n.kind == "call" and n.head in functions:
                for side, given in enumerate(n.parts[:2]):
                    base, more = _shifted(given)
                    needs = shifts.get(base, 0) + more + functions[n.head].room[side]
                    room[side] = max(room[side], needs)
        f.room = (room[0], room[1])


def _follow(functions: dict[str, Function], f: Function, pattern: Pattern) -> None:
    """Which arguments and results of whom are there, where this one is called so.

    Statement by statement, as they stand: CasADi's text has no jumps.
    """
    if pattern in f.patterns:
        return
    f.patterns.add(pattern)
    own = {"arg": dict(enumerate(pattern[0])), "res": dict(enumerate(pattern[1]))}
    there: dict[str, dict[int, bool]] = {**own}
    aliases: dict[str, bool] = {}

    def is_there(given: Node) -> bool:
        given = given.parts[1] if given.kind == "choice" else given
        given = given.parts[0] if given.kind == "op" else given
        if given.kind == "index" and given.parts[0].head in own:
            return own[given.parts[0].head].get(int(given.parts[1].head), True)
        return aliases.get(given.text, given.text not in ("0", "NULL"))

    for n in f.body.walk():
        to = target(n) if n.kind == "do" and n.parts[0].head == "=" else None
        if n.kind == "for" and len(n.parts[3].parts) == 1:
            only = n.parts[3].parts[0]
            copied = target(only) if only.kind == "do" else None
            source = value(only) if copied is not None else None
            if copied is None or source is None or source.base.head not in own:
                continue
            if copied.kind == "index" and copied.parts[1].kind == "name":
                mine, count = own[source.base.head], int(n.parts[1].parts[1].head)
                there[copied.base.head] = {i: mine.get(i, True) for i in range(count)}
        elif to is not None and to.kind == "index" and to.parts[0].head.startswith(("arg", "res")):
            if to.parts[1].kind == "number":
                there.setdefault(to.parts[0].head, {})[int(to.parts[1].head)] = is_there(value(n))
        elif to is not None and to.kind == "name" and value(n).base.head in own:
            aliases[to.head] = is_there(value(n))
        if n.kind == "call" and n.head in functions:
            g = functions[n.head]
            sides = []
            for given, count in zip(n.parts, (len(g.takes), len(g.gives)), strict=False):
                base, more = _shifted(given)
                sides.append(tuple(there.get(base, {}).get(i + more, True) for i in range(count)))
            _follow(functions, g, (sides[0], sides[1]))


def seen_and_any(sizes: Iterable[int], undecided: str, real: str) -> list[str]:
    """Declarations of functions that read so many numbers, and that set them to any."""
    lines = [f"static volatile {undecided} undecided;"]
    for n in sizes:
        lines += [
            f"/*@ requires \\valid_read(x + (0 .. {n - 1})) && \\initialized(x + (0 .. {n - 1}));",
            "    assigns \\nothing; */",
            f"void seen_{n}(const {real} *x);",
            f"/*@ requires \\valid(x + (0 .. {n - 1})); assigns x[0 .. {n - 1}] \\from \\nothing;",
            f"    ensures \\initialized(x + (0 .. {n - 1})); */",
            f"void any_{n}({real} *x);",
        ]
    return lines


def _contracts(
    used: Iterable[Function], sizes: Iterable[int], real: str, work: tuple[int, int]
) -> list[str]:
    scratch = "".join(
        f" && \\valid({name} + (0 .. {n - 1}))"
        for name, n in zip(("iw", "w"), work, strict=True) if n
    )  # fmt: skip
    lines = seen_and_any(sizes, "int", real)
    for f in used:
        ways = [
            " && ".join(
                f"{side}[{k}] {'!=' if there else '=='} \\null"
                for side, whole in zip(("arg", "res"), pattern, strict=True)
                for k, there in enumerate(whole)
            )
            or "\\true"
            for pattern in sorted(f.patterns)
        ]
        lines += [
            f"static int any_{f.name}(const {real} **arg, {real} **res, int *iw, {real} *w,"
            " int mem)",
            "{",
            f"    /*@ check room: \\valid(arg + (0 .. {f.room[0] - 1}))"
            f" && \\valid(res + (0 .. {f.room[1] - 1})){scratch}; */",
            f"    /*@ check called: {' || '.join(f'({way})' for way in ways)}; */",
            *(
                f"    /*@ check flag: 0.0 <= *arg[{k}] <= 1.0"
                f" && \\base_addr(arg[{k}]) != \\base_addr(w); */"
                for k in f.flags
            ),
            *(f"    if (arg[{k}] != 0) {{ seen_{n}(arg[{k}]); }}"
              for k, n in enumerate(f.takes) if n),
            *(f"    if (res[{k}] != 0) {{ any_{n}(res[{k}]); }}"
              for k, n in enumerate(f.gives) if n),
            "    return 0;",
            "}",
        ]  # fmt: skip
    return lines


def _proofs(used: Iterable[Function], real: str, work: tuple[int, int]) -> list[str]:
    lines, names = [], []
    for f in used:
        for number, (takes, gives) in enumerate(sorted(f.patterns)):
            names.append(f"proof_{number}_{f.name}")
            lines += [
                f"static void {names[-1]}(void)", "{",
                *(f"    {real} a{k}[{max(n, 1)}];" for k, n in enumerate(f.takes)),
                *(f"    {real} r{k}[{max(n, 1)}];" for k, n in enumerate(f.gives)),
                f"    int iw[{max(work[0], 1)}];", f"    {real} w[{max(work[1], 1)}];",
                f"    const {real} *arg[{max(f.room[0], 1)}];",
                f"    {real} *res[{max(f.room[1], 1)}];",
                "    int failed;",
                *(f"    any_{n}(a{k});" for k, n in enumerate(f.takes) if n),
                *(f"    a{k}[0] = (undecided != 0) ? 1.0 : 0.0;" for k in f.flags),
                *(f"    arg[{k}] = {f'a{k}' if there else '0'};" for k, there in enumerate(takes)),
                *(f"    res[{k}] = {f'r{k}' if there else '0'};" for k, there in enumerate(gives)),
                f"    failed = {f.name}(arg, res, iw, w, 0);",
                "    /*@ check never_fails: failed == 0; */",
                *(f"    seen_{n}(r{k});" for k, n in enumerate(f.gives) if n and gives[k]),
                "}",
            ]  # fmt: skip
    return [*lines, "int main(void)", "{", *(f"    {n}();" for n in names), "    return 0;", "}"]
