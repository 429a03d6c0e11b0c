"""Straight lines that repeat become a loop: a grid, the members of a population, a window.

A run of like blocks of lines is one loop. They may differ in indices and whole numbers that go up
by the same step, in their own locals, and in what the block before has left. Nothing
is computed in another order, so the bits stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from slipctl.ccode.passes.lanes import in_lanes
from slipctl.ccode.passes.loop_fusion import fuse_loops, made_names, used_names
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.graph import stem
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import expression
from slipctl.ccode.tree.printer import lines_of

LONGEST, LEAST, SAVED, MUCH, WORTH = 40, 3, 2, 5, 20
"""Lines of a block at most, blocks at least, lines that a loop must save where they are printed; of
the fewest blocks it must save more. Lines that sorting statements must save."""

Path = tuple[int, ...]
"""Which part of which part of a statement."""

_NO_WORDS = {
    ord(x): None for x in "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_."
}


def roll_lines(lines: Sequence[Node], taken: set[str], sort: bool = False) -> list[Node]:
    """Statements with loops where they repeat.

    Args:
        lines: statements; those that are no assignments are left alone.
        taken: names that the variable of a loop may not have.
        sort: whether statements may be sorted by the elements that they are of, where this is
            much shorter.
    """
    if "i" in taken:
        return list(lines)
    made = _rolled(lines, taken)
    if sort and (other := _sorted(lines, taken)):
        other = _rolled(other, taken)
        if len(lines_of(other, "    ")) + WORTH <= len(lines_of(made, "    ")):
            return other
    return made


def _sorted(lines: Sequence[Node], taken: set[str]) -> list[Node]:
    """Statements with a loop over each run of blocks that stand together once they are sorted."""
    now, runs = in_lanes(lines)
    moved = 0
    for begin, period in runs:
        run = _run(now, begin + moved, period)
        if run.count < LEAST:
            continue
        made, later = run.written(now, taken)
        end = run.start + period * run.count
        now[run.start :] = [*made, *c.swap_all(now[end:], later)]
        moved += len(made) - period * run.count
    return now if runs else []


def _rolled(lines: Sequence[Node], taken: set[str]) -> list[Node]:
    """Statements with loops, in the order in which they are."""
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
        made, later = best.written(now, taken)
        whole = now[at : at + best.period * best.count]
        wanted = 0 if _is_sum(whole[0]) else SAVED if best.count > LEAST else MUCH
        if len(lines_of(whole, "    ")) - len(lines_of(made, "    ")) < wanted:
            at += 1
            continue
        rest = c.swap_all(now[at + best.period * best.count :], later)
        now[at:] = [*made, *rest]
        at += len(made)
    return fuse_loops(_without_locals(now, results))


def _is_sum(line: Node) -> bool:
    return line.kind == "do" and line.parts[0].head == "+="


def _rolls(line: Node) -> bool:
    """Whether it may be in a loop: a local with its value, an element, a term of a sum."""
    to = c.target(line)
    if to is None or to.kind == "unary":
        return False
    if line.kind == "declare":
        return line.head in ("const double", "const bool") and to.kind == "name"
    element = to.kind == "index" and to.parts[1].kind == "number" and line.parts[0].head == "="
    return element or (_is_sum(line) and to.kind == "name")


def _best(lines: Sequence[Node], at: int) -> _Run | None:
    """The run at a line that saves most."""
    return max(_runs(lines, at), key=lambda r: r.saved, default=None)


def _hoisted(lines: Sequence[Node], at: int) -> tuple[list[Node], int]:
    """Statements in which what stands between the first like ones, and needs none, is before.

    It is what all blocks use and CasADi works out when the first one needs it.
    """
    here = list(lines[at : at + LONGEST])
    if not lines[at].constant:
        return list(lines), at
    shapes = Counter(_shape(line) for line in lines)
    made = made_names(here)
    ahead = [
        line for line in here[1:]
        if (own := line.constant) and shapes[_shape(line)] < LEAST
        and not made & (used_names([line]) - {own})
    ]  # fmt: skip
    rest = [line for line in here if line not in ahead]
    return [*lines[:at], *ahead, *rest, *lines[at + LONGEST :]], at + len(ahead)


def _with_locals(lines: Sequence[Node], taken: set[str]) -> tuple[list[Node], dict[str, Node]]:
    """Statements in which a result that is worked out as several locals are is one first; which."""
    made, results = list(lines), dict[str, Node]()
    shapes = Counter(_shape(c.value(line)) for line in lines if line.constant)
    words = {*taken, *c.words(lines)}
    for line in lines:
        to = c.target(line) if line.kind == "do" and not _is_sum(line) else None
        if to is None or to.kind not in ("unary", "member") or to.parts[0].kind != "name":
            continue
        if shapes[_shape(c.value(line))] < LEAST:
            continue
        name = f"{to.parts[0].head if to.kind == 'unary' else to.head[2:]}_now"
        used = [k for k, x in enumerate(made) if (own := x.constant) and own in line.words]
        if name in words or not used:
            continue
        made[made.index(line)] = c.assign(to, c.name(name))
        made.insert(max(used) + 1, c.declare("const double", name, c.value(line)))
        results[name] = to
    return made, results


def _without_locals(lines: Sequence[Node], results: Mapping[str, Node]) -> list[Node]:
    """Statements in which a local that is in no loop is the result that it is given to."""
    made = list(lines)
    for name, to in results.items():
        own = next((x for x in made if x.head == "const double" and x.constant == name), None)
        if own is not None:
            made.remove(own)
            made[made.index(c.assign(to, c.name(name)))] = c.assign(to, c.value(own))
    return made


@dataclass
class _Run:
    """Blocks of statements that are one loop.

    Attributes:
        start, period, count: where they begin, statements of a block, blocks.
        second: statements of the second block.
        steps: by (statement, part) first value and step of a number that goes up.
        before: by (statement, part) statement of the block before whose local is meant.
        own: by (statement, part) statement of the same block whose local is meant.
        first: by statement of a block that the next one reads, what the first block has there.
        begin: first value of the variable of the loop.
    """

    start: int
    period: int
    count: int = 0
    second: Sequence[Node] = ()
    steps: dict[tuple[int, Path], tuple[int, int]] = field(default_factory=dict)
    before: dict[tuple[int, Path], int] = field(default_factory=dict)
    own: dict[tuple[int, Path], int] = field(default_factory=dict)
    first: dict[int, Node] = field(default_factory=dict)
    begin: int = 0

    @property
    def saved(self) -> int:
        """Lines that the loop saves, about."""
        return self.period * self.count - self.period - 2 - 2 * len(self.first)

    def names(self, lines: Sequence[Node], block: int) -> list[str]:
        """Local that each statement of a block declares, or ""."""
        begin = self.start + block * self.period
        return [line.constant for line in lines[begin : begin + self.period]]

    def written(self, lines: Sequence[Node], taken: set[str]) -> tuple[list[Node], dict[str, Node]]:
        """The loop, without new names that are taken, and what stands for its locals later."""
        words = c.words(lines[self.start + self.period * self.count :])
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
        kinds = [x.head.removeprefix("const ") for x in self.second]  # as in each block
        rows = list(zip(*names, strict=True))
        given = [  # the model may name one of the last block only
            row[0] if q in self.first else next((n for n in row if not _is_letter(n)), row[0])
            for q, row in enumerate(rows)
        ]
        local = [n and _of_all(n) for n in given]
        others = words | c.words(lines[: self.start]) | taken
        local = [
            n if n and local.count(n) == 1 and (n in rows[q] or n not in others) else names[0][q]
            for q, n in enumerate(local)
        ]
        self.begin = self._begin(bool(arrays))
        made: list[Node] = []
        later: dict[str, Node] = {}
        for q in arrays:
            made.append(c.declare(kinds[q], local[q], size=self.count))
            later |= {names[b][q]: c.index(c.name(local[q]), b) for b in range(self.count)}
        carried = {q: c.name(names[last][q]) for q in self.first}
        made += [c.declare(kinds[q], carried[q], given) for q, given in self.first.items()]
        made += [c.declare(kinds[q], names[last][q]) for q in ends]
        direct = {q for q in carried if self._read_before(q) and q not in arrays}
        here = [
            carried[q] if q in direct else c.index(c.name(n), c.name("i")) if q in arrays
            else c.name(n)
            for q, n in enumerate(local)
        ]  # fmt: skip
        body, behind = list[Node](), list[Node]()
        for q, line in enumerate(self.second):
            new = self._put(q, line, (), here, carried)
            if not local[q]:
                body.append(new)
                continue
            plain = q not in direct and q not in arrays and q not in ends
            to = c.name(names[last][q]) if q in ends else here[q]
            own = c.declare(f"const {kinds[q]}", to, c.value(new))
            body.append(own if plain else c.assign(to, c.value(new)))
            if q in carried and q not in direct:
                behind.append(c.assign(carried[q], here[q]))
        return [*made, c.loop(self.count, [*body, *behind], self.begin)], later

    def _begin(self, arrays: bool) -> int:
        """Where the variable of the loop begins: with the first index, if all begin there."""
        firsts = list(set(self.steps.values()))
        return firsts[0][0] if not arrays and len(firsts) == 1 and firsts[0][1] == 1 else 0

    def _read_before(self, q: int) -> bool:
        """Whether nothing reads what the block before left after statement q, which gives it."""
        return all(at[0] <= q for at, source in self.before.items() if source == q)

    def _put(
        self, q: int, n: Node, at: Path, here: Sequence[Node], carried: Mapping[int, Node]
    ) -> Node:
        """A part of a statement of the second block, as it is in the loop."""
        if (q, at) in self.steps:
            value, step = self.steps[q, at]
            return _counted(value - self.begin, step, "." in n.head)
        if (q, at) in self.before:
            return carried[self.before[q, at]]
        if (q, at) in self.own:
            return here[self.own[q, at]]
        parts = (self._put(q, p, (*at, k), here, carried) for k, p in enumerate(n.parts))
        return replace(n, parts=tuple(parts)) if n.parts else n


def _is_letter(name: str) -> bool:
    """Whether it is one that no model gives."""
    return name[:1] == "a" and name[1:].isdecimal()


def _of_all(name: str) -> str:
    """Name of all elements by that of one: ``x`` of ``x_0``, ``x_next`` of ``x_0_next``."""
    return f"{stem(name[:-5])}_next" if name.endswith("_next") else stem(name)


def _counted(value: int, step: int, real: bool) -> Node:
    """A number that goes up with the loop."""
    if not real:
        i = "i" if step == 1 else f"{step} * i"
        return expression(f"{i} + {value}" if value else i)
    number = "(double)i" if step == 1 else f"{step}.0 * (double)i"
    return expression(f"({number} + {value}.0)" if value or step > 1 else number)


def _runs(lines: Sequence[Node], at: int) -> Iterator[_Run]:
    """Runs that begin at a statement."""
    for period in range(1, LONGEST + 1):
        if at + LEAST * period > len(lines) or not _rolls(lines[at + period - 1]):
            return
        if lines[at].kind != lines[at + period].kind:
            continue
        run = _run(lines, at, period)
        if run.count >= LEAST:
            yield run


def _run(lines: Sequence[Node], at: int, period: int) -> _Run:
    run = _Run(at, period, second=lines[at + period : at + 2 * period])
    names = [line.constant for line in lines[at : at + period]]
    own = {n: q for q, n in enumerate(names) if n}
    own2 = {n: q for q, line in enumerate(run.second) if (n := line.constant)}
    for q, (a, b) in enumerate(zip(lines[at:], run.second, strict=False)):
        aligned = _aligned(a, b, own)
        if aligned is None:
            return run
        for k, x, y in aligned:
            if y.head in own2 and own2[y.head] <= q and own.get(x.head) == own2[y.head]:
                run.own[q, k] = own2[y.head]
            elif y.head in own and x.head not in own:
                run.before[q, k] = own[y.head]
                if run.first.setdefault(own[y.head], x) != x:
                    return run
            elif x == y and x.head not in own:
                continue
            elif _is_whole(x) and _is_whole(y) and ("." in x.head) == ("." in y.head):
                step = int(float(y.head)) - int(float(x.head))
                if step < 1 or float(y.head) >= 2**24:
                    return run
                run.steps[q, k] = int(float(x.head)), step
            else:
                return run
    count = 2
    while at + (count + 1) * period <= len(lines) and _fits(lines, run, names, count):
        count += 1
    if {lines[at + q].head for q in run.first} <= {"const double"}:
        run.count = count
    return run


def _is_whole(n: Node) -> bool:
    return n.kind == "number" and n.head.removesuffix(".0").isdecimal()


def _is_operand(n: Node) -> bool:
    """Whether it is a number, or a variable, a member, or an element of one by number."""
    if n.kind == "index":
        return (
            n.parts[1].kind == "number" and n.parts[0].kind != "index" and _is_operand(n.parts[0])
        )
    if n.kind == "unary":
        return n.head == "-" and n.parts[0].kind == "number"
    return n.kind in ("name", "number") or (n.kind == "member" and n.parts[0].kind == "name")


def _opens(n: Node) -> str:
    """What the text of an expression begins with."""
    if n.kind in ("op", "index", "member", "choice", "post"):
        return _opens(n.parts[0])
    return "(" if n.kind in ("paren", "cast") else n.head


def _aligned(
    x: Node, y: Node, own: Mapping[str, int], at: Path = ()
) -> list[tuple[Path, Node, Node]] | None:
    """Parts of a statement of the second block, with what the first has in their place.

    What the block before has left may be an element or a member in the first block. And ``step``
    there is ``1.0 * step``.
    """
    if y.kind == "name" and y.head in own and x.head not in own and _is_operand(x):
        return [(at, x, y)]
    one = y.kind == "op" and y.head == "*" and y.parts[0].head == "2.0" and _opens(x) != "2.0"
    if one and _opens(x) == _opens(y.parts[1]):
        found = _aligned(x, y.parts[1], own, (*at, 1))
        first = (*at, 0), Node("number", "1.0"), y.parts[0]
        return None if found is None else [first, *found]
    if x.kind != y.kind or len(x.parts) != len(y.parts):
        return None
    if x.kind in ("name", "number"):
        return [(at, x, y)]
    if x.head != y.head:
        return None
    made: list[tuple[Path, Node, Node]] = []
    for k, (a, b) in enumerate(zip(x.parts, y.parts, strict=True)):
        found = _aligned(a, b, own, (*at, k))
        if found is None:
            return None
        made += found
    return made


def _fits(lines: Sequence[Node], run: _Run, names: Sequence[str], block: int) -> bool:
    """Whether a further block is like the second one."""
    begin = run.start + block * run.period
    here, before = run.names(lines, block), run.names(lines, block - 1)
    if any(bool(a) != bool(b) for a, b in zip(here, names, strict=True)):
        return False

    def good(q: int, n: Node, known: Node, at: Path) -> bool:
        if (q, at) in run.own:
            return n == c.name(here[run.own[q, at]])
        if (q, at) in run.before:
            return n == c.name(before[run.before[q, at]])
        if (q, at) in run.steps:
            value, step = run.steps[q, at]
            return _is_whole(n) and float(n.head) == value + step * block
        same = (n.kind, n.head, len(n.parts)) == (known.kind, known.head, len(known.parts))
        pairs = enumerate(zip(n.parts, known.parts, strict=False))
        return same and all(good(q, a, b, (*at, k)) for k, (a, b) in pairs)

    pairs = zip(lines[begin:], run.second, strict=False)
    return all(good(q, line, known, ()) for q, (line, known) in enumerate(pairs))


def _shape(line: Node) -> str:
    """A statement without names and numbers."""
    return line.text.translate(_NO_WORDS)
