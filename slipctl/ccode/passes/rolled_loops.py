"""Straight lines that repeat become a loop: a grid, the members of a population, a window.

A run of like blocks of lines is one loop. They may differ in indices and whole numbers that go up
by the same step, in their own locals, and in what the block before has left. Nothing
is computed in another order, so the bits stay.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from slipctl.ccode.passes.loop_fusion import fuse_loops
from slipctl.ccode.tree.statements import line_count

LONGEST, LEAST, SAVED, MUCH = 40, 3, 2, 5
"""Lines of a block at most, blocks at least, lines that a loop must save where they are printed; of
the fewest blocks it must save more."""

_LINE = re.compile(
    r"(?:const (?P<kind>double|bool) (?P<name>\w+) =|(?P<to>[\w>.*-]+\[\d+\]) ="
    r"|(?P<sum>\w+) \+=) (.*);$"
)
_TOKEN = re.compile(r"\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+|(?<=\[)\d+(?=\])|[A-Za-z_]\w*|.")
_OPERAND = r"[A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])?|\d[\w.]*"
_WHOLE = re.compile(r"\d+(?:\.0)?")


def roll_lines(lines: Sequence[str], taken: set[str]) -> list[str]:
    """Lines with loops where they repeat.

    Args:
        lines: statements, each on one line; others are left alone.
        taken: names that the variable of a loop may not have.
    """
    if "i" in taken:
        return list(lines)
    now, results = _with_locals(lines, taken)
    at = 0
    while at < len(now):
        best = _best(now, at)
        moved, begin = _hoisted(now, at)
        other = _best(moved, begin) if begin > at else None
        if other is not None and (best is None or other.saved > best.saved):
            now, at, best = moved, begin, other
        if best is None:
            at += 1
            continue
        made, later = best.written(now)
        whole = now[at : at + best.period * best.count]
        wanted = 0 if " += " in whole[0] else SAVED if best.count > LEAST else MUCH
        if line_count(whole) - line_count(made) < wanted:
            at += 1
            continue
        now[at : at + best.period * best.count] = made
        rest = at + len(made)
        for old, new in later.items():
            now[rest:] = [re.sub(rf"\b{old}\b", new, line) for line in now[rest:]]
        at = rest
    return fuse_loops(_without_locals(now, results))


def _best(lines: Sequence[str], at: int) -> _Run | None:
    """The run at a line that saves most."""
    return max(_runs(lines, at), key=lambda r: r.saved, default=None)


def _hoisted(lines: Sequence[str], at: int) -> tuple[list[str], int]:
    """Lines in which what stands between the first like ones, and needs none of them, is before.

    It is what all blocks use and CasADi works out when the first one needs it.
    """
    here = list(lines[at : at + LONGEST])
    if not _declared(lines[at]):
        return list(lines), at
    shapes = Counter(_shape(line) for line in lines)
    names = {n for line in here if (n := _declared(line))}
    ahead = [
        line for line in here[1:]
        if _declared(line) and shapes[_shape(line)] < LEAST
        and not names & {t for t in _tokens(line) if t != _declared(line)}
    ]  # fmt: skip
    rest = [line for line in here if line not in ahead]
    return [*lines[:at], *ahead, *rest, *lines[at + LONGEST :]], at + len(ahead)


_RESULT = re.compile(r"(?P<to>\*(?P<name>\w+)|\w+->(?P<member>\w+)) = (?P<value>.*);")


def _with_locals(lines: Sequence[str], taken: set[str]) -> tuple[list[str], dict[str, str]]:
    """Lines in which a result that is worked out as several locals are is a local first; which."""
    made, results = list(lines), dict[str, str]()
    shapes = Counter(_shape(line.partition(" = ")[2]) for line in lines if _declared(line))
    words = {*taken, *re.findall(r"\w+", " ".join(lines))}
    for line in lines:
        found = _RESULT.fullmatch(line)
        if found is None or shapes[_shape(f"{found['value']};")] < LEAST:
            continue
        name = f"{found['name'] or found['member']}_now"
        used = [k for k, x in enumerate(made) if _declared(x) in _tokens(line) and _declared(x)]
        if name in words or not used:
            continue
        made[made.index(line)] = f"{found['to']} = {name};"
        made.insert(max(used) + 1, f"const double {name} = {found['value']};")
        results[name] = found["to"]
    return made, results


def _without_locals(lines: Sequence[str], results: Mapping[str, str]) -> list[str]:
    """Lines in which a local that is in no loop is the result that it is given to."""
    made = list(lines)
    for name, to in results.items():
        start = f"const double {name} = "
        own = next((line for line in made if line.startswith(start)), None)
        if own is not None:
            made.remove(own)
            made[made.index(f"{to} = {name};")] = f"{to} = {own.removeprefix(start)}"
    return made


@dataclass
class _Run:
    """Blocks of lines that are one loop.

    Attributes:
        start, period, count: where they begin, lines of a block, blocks.
        tokens: of each line of the second block.
        steps: by (line, token) first value and step of a number that goes up.
        before: by (line, token) line of the block before whose local is meant.
        own: by (line, token) line of the same block whose local is meant.
        first: by line of a block that the next one reads, what the first block has in its place.
        begin: first value of the variable of the loop.
    """

    start: int
    period: int
    count: int = 0
    tokens: list[list[str]] = field(default_factory=list)
    steps: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    before: dict[tuple[int, int], int] = field(default_factory=dict)
    own: dict[tuple[int, int], int] = field(default_factory=dict)
    first: dict[int, str] = field(default_factory=dict)
    begin: int = 0

    @property
    def saved(self) -> int:
        """Lines that the loop saves, about."""
        return self.period * self.count - self.period - 2 - 2 * len(self.first)

    def names(self, lines: Sequence[str], block: int) -> list[str]:
        """Local that each line of a block declares, or ""."""
        begin = self.start + block * self.period
        return [_declared(line) for line in lines[begin : begin + self.period]]

    def written(self, lines: Sequence[str]) -> tuple[list[str], dict[str, str]]:
        """The loop, and what later lines have for its locals."""
        after = " ".join(lines[self.start + self.period * self.count :])
        words = set(re.findall(r"\w+", after))
        names = [self.names(lines, b) for b in range(self.count)]
        last = self.count - 1
        arrays = {
            q for q in range(self.period)
            if any(names[b][q] in words for b in range(last) if names[b][q])
        }  # fmt: skip
        ends = {
            q for q in range(self.period)
            if q not in arrays and q not in self.first and names[last][q] in words
        }  # fmt: skip
        kinds = [_kind(line) for line in lines[self.start : self.start + self.period]]
        local = [n and _stem(n) for n in names[0]]
        others = words | set(re.findall(r"\w+", " ".join(lines[: self.start])))
        local = [
            n if n and local.count(n) == 1 and n not in others else names[0][q]
            for q, n in enumerate(local)
        ]
        self.begin = self._begin(bool(arrays))
        made: list[str] = []
        later: dict[str, str] = {}
        for q in arrays:
            made.append(f"{kinds[q]} {local[q]}[{self.count}];")
            later |= {names[b][q]: f"{local[q]}[{b}]" for b in range(self.count)}
        carried: dict[int, str] = {}
        for q, text in self.first.items():
            carried[q] = names[last][q]
            made.append(f"{kinds[q]} {carried[q]} = {text};")
        for q in ends:
            made.append(f"{kinds[q]} {names[last][q]};")
        body: list[str] = []
        behind: list[str] = []
        direct = {q for q in carried if self._read_before(q) and q not in arrays}
        for q in range(self.period):
            text = "".join(self._token(q, k, t, local, carried, arrays, direct)
                           for k, t in enumerate(self.tokens[q]))  # fmt: skip
            if not local[q]:
                body.append(text)
                continue
            value = text.partition(" = ")[2]
            if q in direct:
                body.append(f"{carried[q]} = {value}")
                continue
            to = f"{local[q]}[i]" if q in arrays else f"const {kinds[q]} {local[q]}"
            if q in ends:
                to = names[last][q]
            body.append(f"{to} = {value}")
            if q in carried:
                behind.append(f"{carried[q]} = {local[q]}{'[i]' * (q in arrays)};")
        begin = self.begin
        loop = [f"for (int i = {begin}; i < {self.count + begin}; ++i) {{"]
        loop += [f"    {line}" for line in [*body, *behind]] + ["}"]
        return [*made, *loop], later

    def _begin(self, arrays: bool) -> int:
        """Where the variable of the loop begins: with the first index, if all begin there."""
        firsts = list(set(self.steps.values()))
        return firsts[0][0] if not arrays and len(firsts) == 1 and firsts[0][1] == 1 else 0

    def _read_before(self, q: int) -> bool:
        """Whether nothing reads what the block before left after line q, which gives it anew."""
        return all(at[0] <= q for at, source in self.before.items() if source == q)

    def _token(
        self, q: int, k: int, token: str, local: Sequence[str], carried: dict[int, str],
        arrays: set[int], direct: set[int],
    ) -> str:  # fmt: skip
        if (q, k) in self.steps:
            value, step = self.steps[q, k]
            value -= self.begin
            if k > 0 and self.tokens[q][k - 1] == "[":
                index = "i" if step == 1 else f"{step} * i"
                return f"{index} + {value}" if value else index
            number = "(double)i" if step == 1 else f"{step}.0 * (double)i"
            return f"({number} + {value}.0)" if value or step > 1 else number
        if (q, k) in self.before:
            return carried[self.before[q, k]]
        if (q, k) in self.own:
            source = self.own[q, k]
            if source in direct:
                return carried[source]
            return f"{local[source]}{'[i]' * (source in arrays)}"
        return token


def _runs(lines: Sequence[str], at: int) -> Iterator[_Run]:
    """Runs that begin at a line."""
    for period in range(1, LONGEST + 1):
        if at + LEAST * period > len(lines):
            return
        if not _LINE.match(lines[at + period - 1]):
            return
        if _outline(lines[at]) != _outline(lines[at + period]):
            continue
        run = _run(lines, at, period)
        if run.count >= LEAST:
            yield run


def _run(lines: Sequence[str], at: int, period: int) -> _Run:
    run = _Run(at, period)
    if at + 2 * period > len(lines):
        return run
    first = [_tokens(line) for line in lines[at : at + period]]
    second = [_tokens(line) for line in lines[at + period : at + 2 * period]]
    names = [_declared(line) for line in lines[at : at + period]]
    names2 = [_declared(line) for line in lines[at + period : at + 2 * period]]
    own = {n: q for q, n in enumerate(names) if n}
    own2 = {n: q for q, n in enumerate(names2) if n}
    for q, (a, b) in enumerate(zip(first, second, strict=True)):
        aligned = _aligned(a, b, own)
        if aligned is None:
            return run
        for k, x, y in aligned:
            if y in own2 and own2[y] <= q and own.get(x) == own2[y]:
                run.own[q, k] = own2[y]
            elif y in own and (x not in own):
                run.before[q, k] = own[y]
                if run.first.setdefault(own[y], x) != x or not re.fullmatch(_OPERAND, x):
                    return run
            elif x == y and x not in own:
                continue
            elif _WHOLE.fullmatch(x) and _WHOLE.fullmatch(y) and ("." in x) == ("." in y):
                step = int(float(y)) - int(float(x))
                if step < 1 or float(y) >= 2**24:
                    return run
                run.steps[q, k] = int(float(x)), step
            else:
                return run
    run.tokens = second
    count = 2
    while at + (count + 1) * period <= len(lines) and _fits(lines, run, names, count):
        count += 1
    kinds = {_kind(line) for q, line in enumerate(lines[at : at + period]) if q in run.first}
    if kinds <= {"double"}:
        run.count = count
    return run


def _aligned(
    a: Sequence[str], b: Sequence[str], own: Mapping[str, int]
) -> list[tuple[int, str, str]] | None:
    """Tokens of a line of the second block, by number, with what the first has in their place.

    What the block before has left may be an element or a member in the first block, which are
    several tokens. And ``step`` there is ``1.0 * step``.
    """
    found: list[tuple[int, str, str]] = []
    i = 0
    for k, y in enumerate(b):
        if i >= len(a):
            return None
        x = a[i]
        if y == "2.0" and x != y and b[k + 1 : k + 5] == [" ", "*", " ", x]:
            found.append((k, "1.0", y))
            a = [*a[:i], y, " ", "*", " ", *a[i:]]
        elif y in own and x not in own and (whole := re.match(_OPERAND, "".join(a[i:]))):
            n = next(n for n in range(1, len(a)) if len("".join(a[i : i + n])) >= whole.end())
            found.append((k, whole[0], y))
            i += n - 1
        else:
            found.append((k, x, y))
        i += 1
    return found if i == len(a) else None


def _fits(lines: Sequence[str], run: _Run, names: Sequence[str], block: int) -> bool:
    """Whether a further block is like the second one."""
    begin = run.start + block * run.period
    here = [_declared(line) for line in lines[begin : begin + run.period]]
    before = [_declared(line) for line in lines[begin - run.period : begin]]
    for q, line in enumerate(lines[begin : begin + run.period]):
        tokens = _tokens(line)
        if len(tokens) != len(run.tokens[q]) or bool(here[q]) != bool(names[q]):
            return False
        for k, (token, known) in enumerate(zip(tokens, run.tokens[q], strict=True)):
            if (q, k) in run.own:
                good = token == here[run.own[q, k]]
            elif (q, k) in run.before:
                good = token == before[run.before[q, k]]
            elif (q, k) in run.steps:
                value, step = run.steps[q, k]
                good = bool(_WHOLE.fullmatch(token)) and float(token) == value + step * block
            else:
                good = token == known
            if not good:
                return False
    return True


def _tokens(line: str) -> list[str]:
    return _TOKEN.findall(line)


def _outline(line: str) -> str:
    """A line without operands, to tell quickly that two are not alike."""
    return re.sub(r"\w+->|\[\w+\]|[\w.]+| \* ", "", line)


def _shape(line: str) -> str:
    """A line without names and numbers."""
    return re.sub(r"[\w.]+", "", line)


def _declared(line: str) -> str:
    m = _LINE.match(line)
    return (m["name"] or "") if m else ""


def _kind(line: str) -> str:
    m = _LINE.match(line)
    return (m["kind"] or "") if m else ""


def _stem(name: str) -> str:
    """Name of what an element of a vector was named after."""
    m = re.fullmatch(r"([A-Za-z_]\w*?)_\d+", name)
    return m[1] if m else name
