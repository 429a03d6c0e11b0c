"""Statements that are the same for each axle stand together, one axle after the other.

CasADi works out what is shared when the first axle needs it, so lines of axles and shared ones are
mixed. Here they are sorted: what is alike but for an index is a family, and families that need
nothing else between them are a block for each axle. :mod:`slipctl.ccode.passes.rolled_loops` makes
a loop of such blocks. No value is computed in another way, so the bits stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node

LEAST = 3
"""Axles from which on they are sorted."""


def in_lanes(lines: Sequence[Node]) -> tuple[list[Node], list[tuple[int, int]]]:
    """Statements of a C function, those of one axle side by side.

    Args:
        lines: statements, each local declared once.

    Returns:
        The statements, and of each run of like blocks where it begins and how long a block is.
    """
    sizes = _sizes(lines)
    for n, _ in Counter(sizes.values()).most_common():
        arrays = {name for name, size in sizes.items() if size == n}
        lanes = _Lanes(lines, n, arrays)
        if lanes.families:
            return lanes.ordered()
    return list(lines), []


def _sizes(lines: Iterable[Node]) -> dict[str, int]:
    """Elements of each array of which every one is read or written by its number."""
    found: dict[str, set[int]] = {}
    for n in (n for line in lines for n in line.walk()):
        if n.kind == "index" and n.parts[1].kind == "number":
            found.setdefault(n.parts[0].text, set()).add(int(n.parts[1].head))
    return {name: len(at) for name, at in found.items() if len(at) >= LEAST and max(at) < len(at)}


@dataclass
class _Lanes:
    """What is alike in each lane.

    Attributes:
        lines: statements.
        n: lanes.
        arrays: arrays with an element for each.
        families: statements of each family by lane.
        shared: statements that are in none.
    """

    lines: Sequence[Node]
    n: int
    arrays: set[str]
    families: list[list[int]] = field(default_factory=list)
    shared: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        while True:
            found = self._found()
            open_ = [[k for k in f if k is not None] for f in found if None in f]
            lost = set(self._causes(open_))
            if not lost:
                self.families = [[k for k in f if k is not None] for f in found]
                if (cycle := self._cycle()) is None:
                    return
                lost = set(cycle)
            self.shared |= lost

    def _causes(self, open_: Sequence[Sequence[int]]) -> list[int]:
        """Statements without a fellow in each lane, which have none for their own sake."""
        names = {self.lines[k].constant: f for f, unit in enumerate(open_) for k in unit}
        return [
            k for f, unit in enumerate(open_) for k in unit
            if all(names.get(w, f) == f for i in unit for w in self.lines[i].words)
        ]  # fmt: skip

    def _found(self) -> list[list[int | None]]:
        """Families with the statement of each lane, where there is one."""
        lane: dict[str, int] = {}
        family: dict[str, int] = {}
        known: dict[tuple[str, int], int] = {}
        found: list[list[int | None]] = []

        def put(k: int, at: int, key: str) -> None:
            turn = 0
            while (key, turn) in known and found[known[key, turn]][at] is not None:
                turn += 1
            if (key, turn) not in known:
                known[key, turn] = len(found)
                found.append([None] * self.n)
            found[known[key, turn]][at] = k
            if name := self.lines[k].constant:
                lane[name], family[name] = at, known[key, turn]

        for k, line in enumerate(self.lines):
            if k in self.shared or not _is_simple(line):
                continue
            at = {lane[w] for w in line.words & lane.keys()} | self._indices(line)
            if len(at) == 1:
                put(k, min(at), self._key(line, family, ""))
            elif len(at) == 2 and max(at) == min(at) + 1:
                before = [w for w in line.words & lane.keys() if lane[w] == min(at)]
                if len(before) != 1 or min(at) in self._indices(line) or not line.constant:
                    continue
                (prior,) = before
                key = self._key(line, family, prior)
                if max(at) == 1:  # the first lane begins with something else
                    first = next(i for i, x in enumerate(self.lines) if x.constant == prior)
                    whole = family[prior]
                    if found[whole][1:] != [None] * (self.n - 1) or found[whole][0] != first:
                        continue
                    found[whole][1] = k
                    known[key, 0] = whole
                elif (key, 0) not in known or known[key, 0] != family[prior]:
                    continue
                else:
                    found[known[key, 0]][max(at)] = k
                lane[line.constant], family[line.constant] = max(at), known[key, 0]
        return found

    def _indices(self, line: Node) -> set[int]:
        """Lanes of which a statement reads or writes an element."""
        return {int(n.parts[1].head) for n in line.walk() if self._is_element(n)}

    def _is_element(self, n: Node) -> bool:
        return n.kind == "index" and n.parts[1].kind == "number" and n.parts[0].text in self.arrays

    def _key(self, line: Node, family: Mapping[str, int], before: str) -> str:
        """A statement without its lane."""
        own = line.constant

        def rule(n: Node) -> Node | None:
            if self._is_element(n):
                return c.index(n.parts[0], c.name("i"))
            if n.kind == "name" and n.head == before:
                return c.name("?")
            if n.kind == "name" and n.head == own:
                return c.name("it")
            if n.kind == "name" and n.head in family:
                return c.name(f"?{family[n.head]}")
            return None

        return line.change(rule).text

    # ---- order ----------------------------------------------------------------------------------

    def _units(self) -> list[list[int]]:
        """Statements that are moved as one, in their order: families, and single ones."""
        inside = {k for f in self.families for k in f}
        alone = [[k] for k in range(len(self.lines)) if k not in inside]
        return sorted([*self.families, *alone])

    def _needs(self, units: Sequence[Sequence[int]]) -> dict[int, set[int]]:
        """Units that are to be before each."""
        of = {k: u for u, unit in enumerate(units) for k in unit}
        graph = {u: set[int]() for u in range(len(units))}
        for k, before in enumerate(_before(self.lines)):
            graph[of[k]] |= {of[b] for b in before} - {of[k]}
        return graph

    def _cycle(self) -> list[int] | None:
        """Statements of a family that waits for itself."""
        units = self._units()
        try:
            TopologicalSorter(self._needs(units)).prepare()
        except CycleError as error:
            return next(list(units[u]) for u in error.args[1] if len(units[u]) > 1)
        return None

    def ordered(self) -> tuple[list[Node], list[tuple[int, int]]]:
        """The statements: what is shared as soon as it can be, then a block for each lane."""
        units = self._units()
        needs, done, made = self._needs(units), set[int](), list[Node]()
        runs: list[tuple[int, int]] = []
        left = list(range(len(units)))

        def taken(alone: bool) -> list[int]:
            """Units that can be next, one kind of them."""
            found: list[int] = []
            for u in left:
                if (len(units[u]) == 1) == alone and needs[u] <= done | {*found}:
                    found.append(u)
            return found

        while left:
            now = taken(True)
            made += [self.lines[units[u][0]] for u in now]
            done |= {*now}
            left = [u for u in left if u not in done]
            block = taken(False)
            runs += [(len(made), len(block))] * bool(block)
            made += [self.lines[units[u][k]] for k in range(self.n) for u in block]
            done |= {*block}
            left = [u for u in left if u not in done]
        return made, runs


def _is_simple(line: Node) -> bool:
    """Whether it gives one value: to a local that it declares, or to an element."""
    to = c.target(line)
    if to is None or line.parts[0].head != "=":
        return False
    if line.kind == "declare":
        return line.head in ("const double", "const bool") and to.kind == "name"
    return to.kind == "index"


def _before(lines: Sequence[Node]) -> list[set[int]]:
    """Statements that are to be before each: they write what it reads, or the reverse."""
    written = dict[str, int]()
    readers = dict[str, list[int]]()
    made = []
    for k, line in enumerate(lines):
        places, to = _places(line), c.target(line)
        own = set(places)
        plain = to is not None and line.parts[0].head == "=" and to.kind in ("member", "name")
        if to is not None and (plain or _is_simple(line)):
            own = {to.text}
        bases = {p.partition("[")[0] for p in own}
        found = {written[p] for p in places if p in written}
        found |= {i for p in own | bases for i in readers.get(p, ())}
        if not _is_simple(line):  # it may touch any element
            found |= {i for p, i in written.items() if p.partition("[")[0] in bases}
            found |= {i for p, r in readers.items() if p.partition("[")[0] in bases for i in r}
        found |= {written[b] for p in places if (b := p.partition("[")[0]) in written}
        for p in places:
            readers.setdefault(p, []).append(k)
        for p in own:
            written[p], readers[p] = k, []
        made.append(found - {k})
    return made


def _places(n: Node) -> set[str]:
    """Variables, members and elements in a statement."""
    if n.kind == "index" and n.parts[1].kind == "number":
        return {n.text}
    if n.kind in ("name", "member"):
        return {n.text}
    return set[str]().union(*(_places(p) for p in n.parts))
