"""Straight lines that repeat become a loop: a grid, the members of a population, a window.

A run of like blocks of lines is one loop. They may differ in indices and whole numbers that go up
by the same step, in their own locals, and in what the block before has left. Nothing
is computed in another order, so the bits stay.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

LONGEST, LEAST, SAVED = 40, 4, 3
"""Lines of a block at most, blocks at least, lines that a loop must save."""

_LINE = re.compile(
    r"(?:const (?P<kind>double|bool) (?P<name>\w+)|(?P<to>[\w>.*-]+\[\d+\])) = (.*);$"
)
_TOKEN = re.compile(r"\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+|(?<=\[)\d+(?=\])|[A-Za-z_]\w*|.")
_WHOLE = re.compile(r"\d+(?:\.0)?")


def rolled(lines: Sequence[str], taken: set[str]) -> list[str]:
    """Lines with loops where they repeat.

    Args:
        lines: statements, each on one line; others are left alone.
        taken: names that the variable of a loop may not have.
    """
    if "i" in taken:
        return list(lines)
    now, at = list(lines), 0
    while at < len(now):
        best = max(_runs(now, at), key=lambda r: r.saved, default=None)
        if best is None or best.saved < SAVED:
            at += 1
            continue
        made, later = best.written(now)
        now[at : at + best.period * best.count] = made
        rest = at + len(made)
        for old, new in later.items():
            now[rest:] = [re.sub(rf"\b{old}\b", new, line) for line in now[rest:]]
        at = rest
    return now


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
    """

    start: int
    period: int
    count: int = 0
    tokens: list[list[str]] = field(default_factory=list)
    steps: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    before: dict[tuple[int, int], int] = field(default_factory=dict)
    own: dict[tuple[int, int], int] = field(default_factory=dict)
    first: dict[int, str] = field(default_factory=dict)

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
        loop = [f"for (int i = 0; i < {self.count}; ++i) {{"]
        loop += [f"    {line}" for line in [*body, *behind]] + ["}"]
        return [*made, *loop], later

    def _read_before(self, q: int) -> bool:
        """Whether nothing reads what the block before left after line q, which gives it anew."""
        return all(at[0] <= q for at, source in self.before.items() if source == q)

    def _token(
        self, q: int, k: int, token: str, local: Sequence[str], carried: dict[int, str],
        arrays: set[int], direct: set[int],
    ) -> str:  # fmt: skip
        if (q, k) in self.steps:
            value, step = self.steps[q, k]
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
        if _shape(lines[at]) != _shape(lines[at + period]):
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
        if len(a) != len(b):
            return run
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            if y in own2 and own2[y] <= q and own.get(x) == own2[y]:
                run.own[q, k] = own2[y]
            elif y in own and (x not in own):
                run.before[q, k] = own[y]
                if run.first.setdefault(own[y], x) != x or not re.fullmatch(r"[\w.]+", x):
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


def _shape(line: str) -> str:
    """A line without names and numbers, to tell quickly that two are not alike."""
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
