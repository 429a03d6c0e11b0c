"""The parts of a controller as C functions, one each, in the order of the wires.

A part reads what its wires carry straight from the structs of the module and writes its next states
and outputs there. Its equations are those of its own block, with the letters of its page.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from slipctl.block.block import Block
from slipctl.block.connection import evaluation_order
from slipctl.block.signals import Signal
from slipctl.block.transforms.discretisation import slower
from slipctl.ccode.module.comments import FILE, comment, of_one_file, with_origins
from slipctl.ccode.module.layout import Member, c_name
from slipctl.ccode.module.shapes import dense_value
from slipctl.ccode.passes.letters import Told, letters
from slipctl.ccode.passes.local_names import name_locals
from slipctl.ccode.passes.member_results import copy_statements, place_locals
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import ANY, FINITE, Unsupported, Writer, constant
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.graph import free_name
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression
from slipctl.ccode.tree.vectors import place

POINTERS = ("in", "param", "derived", "state", "next", "now", "work")
"""Structs that a part may be given."""

Place = tuple[Member, str]
"""A struct member and the pointer to it."""


@dataclass(frozen=True)
class Wires:
    """Where the signals of a block lie: places by name."""

    states: Mapping[str, Place]
    following: Mapping[str, Place]
    inputs: Mapping[str, Place | None]
    params: Mapping[str, Place]
    outputs: Mapping[str, Place]


@dataclass
class Parts:
    """C functions of the parts, and the statements that call them.

    Attributes:
        functions: named functions that the parts call.
        types: declaration of each struct that a part may be given, by its name.
        can_be: what (C name, pointer, element) can be.
        made: function of each part by its C name.
        lines: the calls, in the order of the wires.
        ticks: from one run of a part to the next, where it is not 1, by its C name.
        results: for each (C name, pointer, element), what tells that two of them are one number.
    """

    functions: Functions
    types: Mapping[str, Node]
    can_be: Callable[[Place, int], int]
    made: dict[str, Node] = field(default_factory=dict)
    lines: list[Node] = field(default_factory=list)
    ticks: dict[str, int] = field(default_factory=dict)
    results: dict[tuple[str, str, int], Node] = field(default_factory=dict)
    known: dict[tuple[str, str, int], int] = field(default_factory=dict)
    written: Iterator[int] = field(default_factory=itertools.count)

    # ---- composition ----------------------------------------------------------------------------

    def add(self, block: Block, path: str, wires: Wires) -> None:
        """Write a block: its parts, or itself.

        Raises:
            Unsupported: an operation that is not written this way.
        """
        if not block.prefixed:
            self._function(block, path, wires, list(block.outputs), True)
            return
        plan, inner, free = evaluation_order(block)
        if not set(free.values()) <= set(wires.inputs):  # its own equations stand between its parts
            self._function(block, path, wires, list(block.outputs), True)
            return
        for b, outputs, last in plan:
            part = block.parts[b]

            def place(n: str, b: str = b) -> Place | None:
                if (b, n) in free:
                    return wires.inputs[free[b, n]]
                source, port = inner[b, n]
                known = block.parts[source]
                table = wires.outputs if port in known.outputs else wires.states
                found = table[f"{source}.{port}"]
                started = port not in known.outputs or self._started(found)
                return found if started else None

            here = f"{path}.{b}".lstrip(".")
            of_part = Wires(
                {n: wires.states[f"{b}.{n}"] for n in part.states},
                {n: wires.following[f"{b}.{n}"] for n in part.states},
                {n: place(n) for n in part.inputs},
                {n: wires.params[block.sharing.name(f"{b}.{n}")] for n in part.params},
                {n: wires.outputs[f"{b}.{n}"] for n in part.outputs},
            )
            if last and len(outputs) == len(part.outputs) and part.prefixed:
                self.add(part, here, of_part)
            else:
                self._function(part, here, of_part, outputs, last)
        for destination, source in block.wires.items():
            if "." not in destination:
                b, _, port = source.partition(".")
                table = wires.outputs if port in block.parts[b].outputs else wires.states
                self._copy(self.lines, wires.outputs[destination], table[source])

    def _started(self, place: Place) -> bool:
        return (place[0].c, place[1], 0) in self.results

    def _copy(self, lines: list[Node], to: Place, source: Place) -> None:
        """Give an output the value of what stands elsewhere."""
        lines += _moved(to, source)
        for k in range(to[0].size):
            key = source[0].c, source[1], k
            self.results[to[0].c, to[1], k] = self.results.get(key, source[0].node(source[1], k))
            self.known[to[0].c, to[1], k] = self._can_be(source, k)

    def _can_be(self, place: Place, k: int) -> int:
        if place[1] == "now->":
            return self.known.get((place[0].c, place[1], k), ANY)
        return self.can_be(place, k)

    # ---- one part -------------------------------------------------------------------------------

    def _function(
        self, block: Block, path: str, wires: Wires, outputs: Sequence[str], last: bool
    ) -> None:
        """Write a part as a function, and its call."""
        whole = last and len(outputs) == len(block.outputs)
        name = c_name(path) if path else c_name(block.name)
        name += "" if whole or last else f"_{c_name(outputs[0])}"
        if name in self.functions.reserved:
            name += "_part"
        name = self.functions.take(name)
        lines = self._lines(block, path, wires, outputs, last)
        lines = place_locals(name_locals(lines, c_name(path), self.functions.reserved))
        lines, file = of_one_file(lines)
        what = f"{path or block.name}: {_first(block.doc)}" if block.doc else path or block.name
        what += f" {FILE}{file}." if file else ""
        names = c.variables(lines)
        used = [p for p in POINTERS if p in names]
        given = [self.types[p] for p in used] or [Node("declare", "void")]
        self.made[name] = c.function("static void", name, given, lines, comment(what))
        self.lines.append(c.do(c.call(name, map(c.name, used))))
        held = _every(block)
        if held is not None:
            self.ticks[name] = held[1]

    def _lines(
        self, block: Block, path: str, wires: Wires, outputs: Sequence[str], last: bool
    ) -> list[Node]:
        held = _every(block)
        if held is None or not last or len(outputs) < len(block.outputs):
            return self._equations(block, wires, outputs, last)
        inner, n, counter, names = held
        tick = wires.states[counter]
        own = Wires(
            {k: wires.states[k] for k in inner.states},
            {k: wires.following[k] for k in inner.states},
            wires.inputs, wires.params, {k: wires.following[h] for h, k in names.items()},
        )  # fmt: skip
        run = self._inside(inner, path, own, outputs)
        tick_now, tick_next = tick[0].at(tick[1], 0), wires.following[counter][0].at("next->", 0)
        lines = [c.branch(expression(f"{tick_now} == 0.0"), run)]
        lines += code(f"{tick_next} = ({tick_now} >= {n - 1}.0) ? 0.0 : ({tick_now} + 1.0);")
        for k in inner.states:
            self._forget(own.following[k])
        for h, k in names.items():
            self._forget(wires.following[h])
            self._copy(lines, wires.outputs[k], wires.following[h])
        self.known[tick[0].c, "next->", 0] = FINITE
        self.results[tick[0].c, "next->", 0] = expression(tick_next)
        return lines

    def _inside(self, inner: Block, path: str, wires: Wires, outputs: Sequence[str]) -> list[Node]:
        """Statements of a block that runs at times; parts of it are functions of their own."""
        if not inner.prefixed:
            return self._lines(inner, path, wires, outputs, True)
        before, self.lines = self.lines, []
        self.add(inner, path, wires)
        lines, self.lines = self.lines, before
        return lines

    def _forget(self, place: Place) -> None:
        """What comes from one of two branches is itself, and may be anything that either is."""
        for k in range(place[0].size):
            self.results[place[0].c, place[1], k] = place[0].node(place[1], k)

    def _equations(
        self, block: Block, wires: Wires, outputs: Sequence[str], last: bool
    ) -> list[Node]:
        """Statements of a block's own equations."""
        groups = [block.symbols(role) for role in ("state", "input", "param")]
        with letters(groups, block.doc) as told:
            n, y = block.expr(*groups)
        chosen: list[tuple[Place, str, Signal, Any]] = []
        if last:
            chosen += [(wires.following[k], f"{k} next", s, n[k]) for k, s in block.states.items()]
        chosen += [(wires.outputs[k], k, block.outputs[k], y[k]) for k in outputs]
        results = [dense_value(block, s, v) for *_, s, v in chosen]
        page = told(results)
        self.functions.letters |= set(page.names.values())
        arguments = [v for g in groups for v in g.values()]
        places = [
            *(wires.states[k] for k in block.states), *(wires.inputs[k] for k in block.inputs),
            *(wires.params[k] for k in block.params),
        ]  # fmt: skip
        targets = [(place, name) for place, name, *_ in chosen]
        known = [k for k in block.outputs if last and k not in outputs]  # given by a piece before
        results += page.hidden
        if not block.sx:
            return self._arrays(
                ca.Function("part", arguments, results, {"cse": True}), places, targets, page
            )
        results += [dense_value(block, block.outputs[k], y[k]) for k in known]
        f = ca.Function("part", arguments, results, {"cse": True})
        return self._scalar(f, places, targets, page, [wires.outputs[k] for k in known])

    def _read(self, places: Sequence[Place | None], i: int, k: int) -> Node:
        place = places[i]
        return constant(0.0) if place is None else expression(place[0].at(place[1], k))

    def _scalar(
        self, f: ca.Function, places: Sequence[Place | None], targets: Sequence[tuple[Place, str]],
        page: Told, known: Sequence[Place],
    ) -> list[Node]:  # fmt: skip
        shown, places, part = len(targets), [*places, *known], next(self.written)
        taken = self.functions.taken(f)
        local: dict[tuple[int, int], str] = {}
        for i, ((m, _), name) in enumerate(targets):
            for k in range(m.size):
                own = _local(name, "" if m.scalar else f"_{k}")
                local[i, k] = free_name(own, taken)
                taken.add(local[i, k])
        for i, letter in page.names.items():
            for k in range(f.numel_out(i)):
                own = free_name(letter if f.numel_out(i) == 1 else f"{letter}_{k}", taken)
                local[i, k] = own
                taken.add(own)
        writer = Writer(
            f, lambda i, k: self._read(places, i, k), local, itertools.count(1),
            can_be=lambda i, k: self._given(places, i, k), shown=shown, known=len(known),
        ).run()  # fmt: skip
        self.functions.helpers |= set(writer.helpers)
        lines = list(writer.lines)
        for (i, k), node in writer.results:
            (m, pointer), _ = targets[i]
            made = writer.result(node)
            lines.append(c.assign(expression(m.at(pointer, k)), made))
            self.known[m.c, pointer, k] = writer.can_be[node]
            self.results[m.c, pointer, k] = (
                made if made.kind == "member" else c.name(f"{part} {node}")
            )
        lines = roll_lines(copy_statements(lines), set(local.values()))
        return with_origins(lines, _equations_of(local, targets, page))

    def _given(self, places: Sequence[Place | None], i: int, k: int) -> int:
        place = places[i]
        return FINITE if place is None else self._can_be(place, k)

    def _arrays(
        self, f: ca.Function, places: Sequence[Place | None], targets: Sequence[tuple[Place, str]],
        page: Told,
    ) -> list[Node]:  # fmt: skip
        sources = []
        for i, at in enumerate(places):
            if at is None and f.nnz_in(i) > 1:
                raise Unsupported("a vector that comes later")
            sources.append(constant(0.0) if at is None else _base(at))
        outputs = [_array(p) for p, _ in targets] + [None] * (f.n_out() - len(targets))
        taken = self.functions.taken(f)
        free: dict[int, str] = {}
        for i, (_, name) in enumerate(targets):
            free[i] = free_name(_local(name), taken)
            taken.add(free[i])
        for i, letter in page.names.items():
            free[i] = free_name(letter, taken)
            taken.add(free[i])
        lines = self.functions.statements(
            f, sources, outputs, itertools.count(1),
            lambda i, k: self._given(places, i, k), len(targets), free,
        )  # fmt: skip
        for (m, pointer), _ in targets:
            for k in range(m.size):
                self.results[m.c, pointer, k] = m.node(pointer, k)
        return with_origins(
            lines, _equations_of({(i, 0): name for i, name in free.items()}, targets, page)
        )


def _equations_of(
    local: Mapping[tuple[int, int], str], targets: Sequence[tuple[Place, str]], page: Told
) -> dict[str, tuple[str, str]]:
    """Name and place of each equation, by the C name that it gives a value to."""
    found: dict[str, tuple[str, str]] = {}
    for i, ((m, pointer), whole) in enumerate(targets):
        name = whole.rpartition(".")[2]
        origin = page.of_result(name.removesuffix(" next"))
        told = name, origin
        if origin:
            found[f"{pointer}{m.c}"] = told
            found |= {local[i, k]: told for k in range(m.size) if (i, k) in local}
    for (i, _), own in local.items():
        if i in page.names and page.origins[i]:
            for c_or_array in (own, page.names[i]):
                found.setdefault(c_or_array, (page.names[i], page.origins[i]))
    return found


def _local(name: str, element: str = "") -> str:
    """Name of a local for a result, ``x next`` of a state; of an array with its element."""
    last, _, following = name.rpartition(".")[2].partition(" ")
    return f"{c_name(last)}{element}{'_next' * bool(following)}"


def _array(place: Place) -> Node:
    """The variable, or the array as a whole."""
    m, pointer = place
    return expression(f"{pointer}{m.c}" if m.size > 1 else m.at(pointer, 0))


def _base(at: Place) -> Node:
    """The variable, or the vector that lies in the array."""
    return place(_array(at), 0) if at[0].size > 1 else _array(at)


def _moved(to: Place, source: Place) -> list[Node]:
    """Statements that copy a value."""
    if to[0].size > 1:
        return [c.do(c.call("copy", [_array(to), _array(source), c.integer(to[0].size)]))]
    return [c.assign(_array(to), _array(source))]


def _every(block: Block) -> tuple[Block, int, str, dict[str, str]] | None:
    """Block inside an ``every``, its ticks, the counter, and held states by output."""
    made = slower(block)
    if made is None:
        return None
    counter, ticks = made
    (inner,) = block.parts.values()
    kept = [n for n in block.states if n not in inner.states and n != counter]
    if len(kept) != len(inner.outputs) or list(inner.params) != list(block.params):
        return None
    return inner, ticks, counter, dict(zip(kept, inner.outputs, strict=True))


def _first(doc: str) -> str:
    return " ".join(doc.strip().partition("\n\n")[0].split())
