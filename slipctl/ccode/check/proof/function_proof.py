"""Functions of a large module, proven one by one; the calls between them by contracts.

Followed call by call, a solver of a hundred passes over forty stages takes Eva too long. So each
function is looked at once, whatever it is given. For those that it calls stands what they promise,
which is what their head says:

* They read as many numbers as it says. All of them are set; NaN and infinity are among them.
* Results are as many numbers, any at all. All of them are set.
* The scratch is what it may be, unset. A function touches its own arrays there and no others.

Each promise is checked where it is used and where it is made, the last one by the text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from slipctl.ccode.check.proof.kernel_proof import CONTRACTS, PROOFS, seen_and_any
from slipctl.errors import RunFailed

_FUNCTION = re.compile(
    r"^static (?P<type>void|double|float) (?P<name>\w+)\((?P<given>[^)]*)\)\s*"
    r"(?:\{\n(?P<body>.*?)^\}|\{ (?P<line>[^\n]*) \}$)",
    re.MULTILINE | re.DOTALL,
)
_ARGUMENT = re.compile(
    r"(?P<const>const )?(?:double|float) (?P<address>\*)?(?P<name>\w+)(?:\[(?P<size>\d+)\])?"
)
_SCRATCH = re.compile(r"struct \w+ \*work")
_FOR = re.compile(r"for \(int \w+ = (?P<begin>\d+); \w+ (?:<|>=) (?P<end>\d+); ")
_LEFT = re.compile(_FOR.pattern + r"\+\+\w+\) \{\n +if \([^\n]*\) \{ break; \}")

READ, WRITTEN, VALUE = "read", "written", "value"
"""How an argument is given."""


@dataclass(frozen=True)
class Argument:
    """An argument of a function: its name, how many numbers, and how it is given."""

    name: str
    size: int
    kind: str


@dataclass(frozen=True)
class Function:
    """A function of numbers and arrays alone, with the declaration of its scratch, if any."""

    name: str
    result: str
    arguments: tuple[Argument, ...]
    scratch: str
    body: str

    @property
    def declared(self) -> str:
        """Its arguments."""
        kinds = {READ: "const {} *", WRITTEN: "{} *", VALUE: "{} "}
        texts = [f"{kinds[a.kind]}{a.name}" for a in self.arguments]
        return ", ".join([*texts, *[self.scratch] * bool(self.scratch)])


def text_with_contracts(
    name: str, texts: Mapping[str, str], real: str, functions: Iterable[str]
) -> tuple[dict[str, str], int]:
    """What is analysed of a module.

    Args:
        name: of the module.
        texts: its C by file name, the file with its functions first.
        real: its type of numbers.
        functions: names of those that its equations call.

    Returns:
        Texts by file name: those of the module, each call of such a function replaced by its
        contract, lines as they were; the contracts, and the program that proves them. How many
        these are.

    Raises:
        RunFailed: a function that touches arrays of another, or may call itself.
    """
    wanted, home = set(functions), next(iter(texts))
    places = [m for m in _FUNCTION.finditer(texts[home]) if m["name"] in wanted]
    found = [f for f in map(_read, places) if f is not None]
    if not found:
        return dict(texts), 0
    _own_alone(found)
    names = "|".join(f.name for f in found)
    longest = max(int(n) for text in texts.values() for n in re.findall(r"\[(\d+)\]", text))
    replaced = {}
    for file, text in texts.items():
        text = re.sub(rf"(?<!static void )(?<!static {real} )\b({names})\(", r"any_\1(", text)
        text = re.sub(rf"(?<!\*/ ){_FOR.pattern}", _unrolled, text)  # of which nothing is said yet
        replaced[file] = re.sub(
            r"(?m)^    for \(int (\w+) = 0; \1 < n;", rf"/*@ loop unroll {longest}; */ \g<0>", text
        )  # of what copies and fills
    own = f'#include "{name}.h"\n'  # and an empty line, in which that of the contracts stands
    replaced[home] = replaced[home].replace(f"{own}\n", f'{own}#include "{CONTRACTS}"\n', 1)
    sizes = sorted({a.size for f in found for a in f.arguments if a.kind != VALUE})
    contracts = [*seen_and_any(sizes, real, real), *(line for f in found for line in _any(f, real))]
    return {
        **replaced,
        CONTRACTS: "\n".join(contracts) + "\n",
        PROOFS: "\n".join([f'#include "{name}.c"', *_proofs(found, real)]) + "\n",
    }, len(found)


def kept_apart(text: str) -> dict[str, int]:
    """Cases to be told apart in functions that do something again while it is wanted."""
    return {
        m["name"]: 4 * int(turns["end"]) + 8
        for m in _FUNCTION.finditer(text) if (turns := _LEFT.search(m["body"] or ""))
    }  # fmt: skip


def _read(m: re.Match[str]) -> Function | None:
    """A function, if all that it is given are numbers, arrays of them, and the scratch."""
    arguments, scratch = [], ""
    for given in (" ".join(a.split()) for a in m["given"].split(",")):
        if _SCRATCH.fullmatch(given):
            scratch = given
            continue
        a = _ARGUMENT.fullmatch(given)
        if a is None:
            return None
        array = bool(a["address"] or a["size"])
        kind = (READ if a["const"] else WRITTEN) if array else VALUE
        arguments.append(Argument(a["name"], int(a["size"] or 1), kind))
    return Function(m["name"], m["type"], tuple(arguments), scratch, m["body"] or m["line"])


def _unrolled(m: re.Match[str]) -> str:
    """A loop of known length, every turn of which is told from the others."""
    return f"/*@ loop unroll {abs(int(m['end']) - int(m['begin'])) + 1}; */ {m[0]}"


def _own_alone(found: Sequence[Function]) -> None:
    """See that each function touches arrays of its own alone, and that none calls itself."""
    calls: dict[str, set[str]] = {}
    for f in found:
        if set(re.findall(r"work->(\w+)", f.body)) - {f.name}:
            raise RunFailed(f"{f.name} touches arrays of another function")
        calls[f.name] = set(re.findall(r"(\w+)\(", f.body)) & {g.name for g in found}
    waiting = dict(calls)
    while free := [n for n, called in waiting.items() if not called & set(waiting)]:
        for n in free:
            del waiting[n]
    if waiting:
        raise RunFailed(f"{', '.join(sorted(waiting))}: functions that may call themselves")


def _any(f: Function, real: str) -> list[str]:
    """A function that does no more than what another promises."""
    body = [
        f"    {'seen' if a.kind == READ else 'any'}_{a.size}({a.name});"
        for a in f.arguments if a.kind != VALUE
    ]  # fmt: skip
    body += [f"    (void){a.name};" for a in f.arguments if a.kind == VALUE]
    body += ["    (void)work;"] * bool(f.scratch)
    body += ["    return undecided;"] * (f.result != "void")
    declared = f.declared.format(*[real] * len(f.arguments))
    return [f"static {f.result} any_{f.name}({declared})", "{", *body, "}"]


def _proofs(found: Iterable[Function], real: str) -> list[str]:
    """The program that calls each function with anything that it may be given."""
    lines, names = [], []
    for f in found:
        names.append(f"proof_of_{f.name}")
        given = [f"&{a.name}[0]" if a.kind != VALUE else a.name for a in f.arguments]
        call = f"{f.name}({', '.join([*given, *['&scratch'] * bool(f.scratch)])});"
        lines += [
            f"static void {names[-1]}(void)", "{",
            *(
                f"    {real} {a.name}[{a.size}];" if a.kind != VALUE
                else f"    const {real} {a.name} = undecided;"
                for a in f.arguments
            ),
            *[f"    {f.scratch.replace('*work', 'scratch')};"] * bool(f.scratch),
            "    int ended = 0;",
            *(f"    any_{a.size}({a.name});" for a in f.arguments if a.kind == READ),
            f"    {'(void)' * (f.result != 'void')}{call}",
            "    ended = 1;",
            "    /*@ check ends: ended == 1; */",
            *(f"    seen_{a.size}({a.name});" for a in f.arguments if a.kind == WRITTEN),
            "}",
        ]  # fmt: skip
    return [*lines, "int main(void)", "{", *(f"    {n}();" for n in names), "    return 0;", "}"]
