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

CONTRACTS = "contracts.h"
"""File of what the functions promise."""

PROOFS = "proofs.c"
"""File of the program that calls each function with anything that it may be given."""

_FUNCTION = re.compile(
    r"^/\* \w+:\((?P<takes>[^)]*)\)->\((?P<gives>[^)]*)\)(?: \*/|:[^/]*\*/)\n"
    r"static int (?P<name>\w+)\([^)]*\)\s*\{\n(?P<body>.*?)^\}",
    re.MULTILINE | re.DOTALL,
)
_SIZE = re.compile(r"\w+(?:\[(\d+)(?:x(\d+))?(?:,(\d+)nz)?\])?")
_CALL = r"\b(%s)\((\w+)(?:\+(\d+))?, (\w+)(?:\+(\d+))?, "
_SHIFTED = re.compile(r"\b((?:arg|res)\d+) ?= ?(arg|res)\+(\d+)")
_COPIED = re.compile(r"i<(\d+); \+\+i\) ((?:arg|res)\d+)\[i\] ?= ?(arg|res)\[i\]$")
_GIVEN = re.compile(r"^((?:arg|res)\d*)\[(\d+)\] ?= ?(.*)$")
_ALIAS = re.compile(r"^(\w+) ?= ?(arg|res)\[(\d+)\]$")
_OWN = re.compile(r"\(?(arg|res)\[(\d+)\](?: != (?:0|NULL)\) \? \1\[\2\]\+\d+ : (?:0|NULL))?$")
_FLAG = re.compile(r"casadi_to_int\(\*arg\[(\d+)\]\)")

Pattern = tuple[tuple[bool, ...], tuple[bool, ...]]
"""Which of the arguments, and of the results, are there."""


@dataclass
class Function:
    """A function of CasADi's text: its sizes, whom it calls, and how it is called."""

    name: str
    body: str
    takes: tuple[int, ...]
    gives: tuple[int, ...]
    flags: tuple[int, ...]
    room: tuple[int, int] = (0, 0)
    patterns: set[Pattern] = field(default_factory=set)


def has_kernel(text: str) -> bool:
    """Whether a module has text of CasADi."""
    return KERNEL[0] in text


def text_with_contracts(
    name: str, text: str, real: str, work: tuple[int, int]
) -> tuple[dict[str, str], int]:
    """What is analysed of a module with CasADi's text.

    Args:
        name: of the module.
        text: its C.
        real: its type of numbers.
        work: integers and numbers of the scratch that it gives to CasADi's text.

    Returns:
        Texts by file name: the module, each call of a function of CasADi's text replaced by its
        contract, lines as they were; the contracts, and the program that proves them. How many
        contracts it proves.
    """
    begin, end = (text.index(f"/* {mark} */") for mark in KERNEL)
    functions = {m["name"]: _read(m) for m in _FUNCTION.finditer(text, begin, end)}
    if not functions:
        return {f"{name}.c": text}, 0
    calls = re.compile(_CALL % "|".join(functions))
    _rooms(functions, calls)
    rest = Function("", _FUNCTION.sub("", text), (), (), ())  # what is followed as it is
    _follow(functions, calls, rest, ((), ()))
    longest = max(n for f in functions.values() for n in (*f.takes, *f.gives))
    turns = f"/*@ loop unroll {longest}; */"
    text = text[:begin] + text[begin:end].replace("for (", f"{turns} for (") + text[end:]
    replaced = re.sub(rf"(?<!static int )\b({'|'.join(functions)})\(", r"any_\1(", text)
    used = [f for f in functions.values() if f.patterns]
    sizes = sorted({n for f in used for n in (*f.takes, *f.gives) if n})
    proofs = _proofs(used, real, work)
    return {
        f"{name}.c": replaced.replace(f"/* {KERNEL[0]} */", f'#include "{CONTRACTS}"', 1),
        CONTRACTS: "\n".join(_contracts(used, sizes, real, work)) + "\n",
        PROOFS: "\n".join([f'#include "{name}.c"', *proofs]) + "\n",
    }, sum(len(f.patterns) for f in used)


def _read(m: re.Match[str]) -> Function:
    takes, gives = (
        tuple(
            int(s[3]) if s[3] else math.prod(int(n) for n in s.groups()[:2] if n)
            for s in _SIZE.finditer(m[side])
        )
        for side in ("takes", "gives")
    )
    flags = tuple(sorted({int(k) for k in _FLAG.findall(m["body"])}))
    return Function(m["name"], m["body"], takes, gives, flags)


def _rooms(functions: dict[str, Function], calls: re.Pattern[str]) -> None:
    """Lengths of the arrays of pointers that each needs, with what it calls; callees come first."""
    for f in functions.values():
        shifts = {a: int(k) for a, _, k in _SHIFTED.findall(f.body)}
        room = [len(f.takes), len(f.gives)]
        for g, a, k, r, j in calls.findall(f.body):
            for side, (base, more) in enumerate(((a, k), (r, j))):
                needs = shifts.get(base, 0) + int(more or 0) + functions[g].room[side]
                room[side] = max(room[side], needs)
        f.room = (room[0], room[1])


def _follow(
    functions: dict[str, Function], calls: re.Pattern[str], f: Function, pattern: Pattern
) -> None:
    """Which arguments and results of whom are there, where this one is called so.

    Statement by statement, as they stand: CasADi's text has no jumps, and heads of its loops and
    branches stay with what follows them.
    """
    if pattern in f.patterns:
        return
    f.patterns.add(pattern)
    own = {"arg": dict(enumerate(pattern[0])), "res": dict(enumerate(pattern[1]))}
    there: dict[str, dict[int, bool]] = {**own}
    aliases: dict[str, bool] = {}
    body = re.sub(r"/\*.*?\*/", "", f.body, flags=re.DOTALL)
    for statement in (" ".join(s.split()) for s in re.split(r"[;{}](?! \w+[<+])", body)):
        if copied := _COPIED.search(statement):
            there[copied[2]] = {i: own[copied[3]].get(i, True) for i in range(int(copied[1]))}
        elif given := _GIVEN.match(statement):
            value = given[3]
            from_own = _OWN.match(value)
            there.setdefault(given[1], {})[int(given[2])] = (
                own[from_own[1]].get(int(from_own[2]), True) if from_own
                else aliases.get(value, value not in ("0", "NULL"))
            )  # fmt: skip
        elif alias := _ALIAS.match(statement):
            aliases[alias[1]] = own[alias[2]].get(int(alias[3]), True)
        for name, a, k, r, j in calls.findall(statement):
            g = functions[name]
            sides = (
                tuple(there.get(base, {}).get(i + int(more or 0), True) for i in range(n))
                for base, more, n in ((a, k, len(g.takes)), (r, j, len(g.gives)))
            )
            _follow(functions, calls, g, (next(sides), next(sides)))


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
