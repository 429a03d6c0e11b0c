"""The parts of a controller as C functions, one each, in the order of the wires.

A part reads what its wires carry straight from the structs of the module and writes its next states
and outputs there. Its equations are those of its own block, with the letters of its page.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.connection import evaluation_order
from slipctl.block.signals import Signal
from slipctl.block.text.expression import read
from slipctl.ccode.module.comments import FILE, comment, first_sentence, of_one_file, with_origins
from slipctl.ccode.module.layout import LIBRARY, LOCAL, Copy, c_name, dense_value, matrix
from slipctl.ccode.module.wires import (
    NO_END,
    POINTERS,
    Place,
    Wires,
    array_of,
    begins_anew,
    copy_lines,
    gate_of,
    is_copies,
    left_to_casadi,
    local_name,
    named_equations,
    own_pointers,
    runs_of,
    switch_lines,
    vector_of,
)
from slipctl.ccode.passes.letters import Told, letters
from slipctl.ccode.passes.local_names import name_locals
from slipctl.ccode.passes.member_results import copy_statements, place_locals
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import (
    ANY,
    FINITE,
    NUMBER,
    Unsupported,
    Writer,
    constant,
    number,
)
from slipctl.ccode.tree.functions import Functions
from slipctl.ccode.tree.graph import claim_name, free_name
from slipctl.ccode.tree.loops import passed_on
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression

ARGUMENTS = 31
"""Arguments of a C function at most; what would have more is written where it is called."""


@dataclass
class Parts:
    """C functions of the parts, and the statements that call them.

    Attributes:
        functions: named functions that the parts call.
        types: declaration of each struct that a part may be given, by its name.
        made: function of each part by its C name.
        lines: the calls, in the order of the wires.
        ticks: from one run of a part to the next, where it is not 1, by its C name; of copies that
            run in different ticks it is 1.
        results: for each (C name, pointer, element), what tells that two of them are one number.
        outside: equations that are left to CasADi's text; they are called by their own names.
    """

    functions: Functions
    types: Mapping[str, Node]
    made: dict[str, Node] = field(default_factory=dict)
    lines: list[Node] = field(default_factory=list)
    ticks: dict[str, int] = field(default_factory=dict)
    results: dict[tuple[str, str, int], Node] = field(default_factory=dict)
    known: dict[tuple[str, str, int], int] = field(default_factory=dict)
    written: Iterator[int] = field(default_factory=itertools.count)
    axes: list[str] = field(default_factory=list)
    outside: list[ca.Function] = field(default_factory=list)

    # ---- composition ----------------------------------------------------------------------------

    def add(self, block: Block, path: str, wires: Wires) -> None:
        """Write a block: its parts, or itself.

        Raises:
            Unsupported: an operation that is not written this way.
        """
        if is_copies(block):
            self._copies(block, path, wires)
            return
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
                begun = (found[0].c, found[1], 0) in self.results
                return found if begun or port not in known.outputs else None

            here = f"{path}.{b}".lstrip(".")
            of_part = Wires(
                {n: wires.states[f"{b}.{n}"] for n in part.states},
                {n: wires.following[f"{b}.{n}"] for n in part.states},
                {n: place(n) for n in part.inputs},
                {n: wires.params[block.sharing.name(f"{b}.{n}")] for n in part.params},
                {n: wires.outputs[f"{b}.{n}"] for n in part.outputs},
            )
            if last and len(outputs) == len(part.outputs) and (part.prefixed or is_copies(part)):
                self.add(part, here, of_part)
            else:
                self._function(part, here, of_part, outputs, last)
        for destination, source in block.wires.items():
            if "." not in destination:
                b, _, port = source.partition(".")
                table = wires.outputs if port in block.parts[b].outputs else wires.states
                self._copy(self.lines, wires.outputs[destination], table[source])

    def _copy(self, lines: list[Node], to: Place, source: Place) -> None:
        """Give an output the value of what stands elsewhere."""
        lines += copy_lines(to, source)
        for k in range(to[0].size):
            known = self._can_be(source, k)
            own = source[0].node(source[1], k)
            for i, j in zip(to[0].elements(k), source[0].elements(k), strict=False):
                node = self.results.get((source[0].c, source[1], j), own)
                self.results[to[0].c, to[1], i] = node
                self.known[to[0].c, to[1], i] = known

    def _can_be(self, place: Place, k: int) -> int:
        m, pointer = place
        if pointer == "now->":
            return min(self.known.get((m.c, pointer, i), ANY) for i in m.elements(k))
        return NUMBER if pointer == "param->" else FINITE  # without a range it may be infinite

    def _made(self, place: Place, k: int, node: Node, can_be: int | None = None) -> None:
        """Remember what an element is, in each copy."""
        m, pointer = place
        for i in m.elements(k):
            own = node if len(m.elements(k)) == 1 else c.name(f"{node} {i}")
            self.results[m.c, pointer, i] = own
            if can_be is not None:
                self.known[m.c, pointer, i] = can_be

    # ---- copies ---------------------------------------------------------------------------------

    def _copies(self, block: Block, path: str, wires: Wires) -> None:
        """Write one function for all copies, and the loop that calls it."""
        (inner,) = block.parts.values()
        n = int(block.choices["copies"])
        given = (*block.outputs.values(), *block.states.values())
        axis = "0" if n == 1 else next((s.axis for s in given if s.axis), "each")
        outer = set(self.functions.pointers)
        self.functions.reserved.add(axis)
        self.functions.pointers.add(axis)
        self.axes.append(axis)
        before, self.lines = self.lines, []

        def own(role: str, table: Mapping[str, Any]) -> dict[str, Any]:
            found = {}
            for n, place in table.items():
                one = getattr(inner, role)[n]
                found[n] = (
                    self._copy_of(place, one, axis)
                    if (place is not None and getattr(block, role)[n].shape != one.shape)
                    else place
                )
            return found

        self.add(inner, path, Wires(
            own("states", wires.states), own("states", wires.following),
            own("inputs", wires.inputs), own("params", wires.params),
            own("outputs", wires.outputs),
        ))  # fmt: skip
        self.lines = [*before, *(self.lines if n == 1 else [c.loop(n, self.lines, by=axis)])]
        self.axes.pop()
        self.functions.reserved -= self.functions.pointers - outer
        self.functions.pointers.intersection_update(outer)

    def _copy_of(self, place: Place, one: Signal, axis: str) -> Place:
        """Place of what one copy has, with a pointer of its own to several numbers."""
        m, pointer = place
        local = ""
        if one.size > 1 and axis != "0":
            told = c_name(one.name.rpartition(".")[2]) + "_next" * (pointer == "next->")
            local = self.functions.take(told)
            self.functions.pointers.add(local)
        own = replace(m.signal, shape=one.shape, value=None, axis="")
        return Copy(own, m.c, axis, m, local), pointer

    # ---- one part -------------------------------------------------------------------------------

    def _function(
        self, block: Block, path: str, wires: Wires, outputs: Sequence[str], last: bool
    ) -> None:
        """Write a part as a function, and its call."""
        whole = last and len(outputs) == len(block.outputs)
        name = c_name(path) if path else c_name(block.name)
        name += "" if whole or last else f"_{c_name(outputs[0])}"
        if name in self.functions.reserved | LIBRARY:
            name += "_part"
        name = self.functions.take(name)
        lines = self._lines(block, path, wires, outputs, last)
        lines = place_locals(name_locals(lines, c_name(path), self.functions.reserved))
        lines, file = of_one_file(lines)
        what = ": ".join([path or block.name, *[first_sentence(block.doc)] * bool(block.doc)])
        what += f" {FILE}{file}." if file else ""
        lines = [*own_pointers(wires, outputs, c.variables(lines)), *lines]
        names = c.variables(lines)
        used = [p for p in POINTERS if p in names]
        given = [self.types[p] for p in used]
        for axis in self.axes:
            if axis in names:
                used.append(axis)
                given.append(c.declare("int", axis))
        given = given or [Node("declare", "void")]
        self.made[name] = c.function("static void", name, given, lines, comment(what))
        self.lines.append(c.do(c.call(name, map(c.name, used))))
        held = runs_of(block)
        if held is not None:
            together = len(set(np.ravel(wires.states[held[2]][0].all.signal.value))) == 1
            self.ticks[name] = held[1] if together else 1

    def _lines(
        self, block: Block, path: str, wires: Wires, outputs: Sequence[str], last: bool
    ) -> list[Node]:
        held = runs_of(block)
        whole = last and len(outputs) == len(block.outputs)
        if whole and (gate := gate_of(block)):
            return self._gated(block, path, wires, gate)
        if whole and begins_anew(block):
            return self._begun_anew(block, path, wires)
        if held is None or not whole:
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
        self._made(wires.following[counter], 0, expression(tick_next), FINITE)
        return lines

    def _gated(self, block: Block, path: str, wires: Wires, gate: str) -> list[Node]:
        """Statements of a block that runs while a signal is on; else it waits at its start."""
        (inner,) = block.parts.values()
        own = replace(wires, inputs={n: wires.inputs[n] for n in inner.inputs})
        run = self._inside(inner, path, own, list(inner.outputs))
        finite = self._finite()
        rest = self._at_start(inner, own)
        self._either(own, finite)
        on = wires.inputs[gate]
        value = constant(0.0) if on is None else on[0].node(on[1], 0)
        return [c.branch(c.op(value, ">", constant(0.5)), run, rest)]

    def _begun_anew(self, block: Block, path: str, wires: Wires) -> list[Node]:
        """Statements of a block that begins anew where a next state leaves its range."""
        (inner,) = block.parts.values()
        (told,) = set(block.outputs) - set(inner.outputs)
        own = replace(wires, outputs={n: wires.outputs[n] for n in inner.outputs})
        lines = self._inside(inner, path, own, list(inner.outputs))
        sound, now = c.name(c_name(told)), list[Node]()
        tests = list[str]()
        for n, place in own.following.items():
            s = inner.states[n]
            ends = [number(min(max(v, -NO_END), NO_END)) for v in (s.lo, s.hi)]
            many = s.size > 1
            x = c.index(array_of(place), c.name("i")) if many else array_of(place)
            test = f"({ends[0]} <= {x}) && ({x} <= {ends[1]})"
            if many:
                body = code(f"{sound} = {sound} && ({test});")
                now.append(c.loop(s.size, body))
            else:
                tests.append(f"({test})")
        lines += code(f"bool {sound} = {' && '.join(tests) or 'true'};")
        finite = self._finite()
        rest = self._at_start(inner, own)
        self._either(own, finite)
        to = wires.outputs[told]
        self._made(to, 0, to[0].node(to[1], 0), FINITE)
        given = c.assign(to[0].node(to[1], 0), expression(f"{sound} ? 1.0 : 0.0"))
        return [*lines, *now, c.branch(Node("unary", "!", (sound,)), rest), given]

    def _at_start(self, inner: Block, wires: Wires) -> list[Node]:
        """Statements that put the states of a block to their start, and its outputs to zero."""
        symbols = {n: ca.SX.sym("p", *matrix(s)) for n, s in inner.params.items()}
        start = inner.symbolic_start(symbols)
        results = [dense_value(inner, s, ca.SX(start[n])) for n, s in inner.states.items()]
        f = ca.Function("start", list(symbols.values()), results, {"cse": True})
        targets = [(wires.following[n], f"{n} next") for n in inner.states]
        lines = self._scalar(f, [wires.params[n] for n in inner.params], targets, Told(), [])
        for n in inner.outputs:
            m, _ = place = wires.outputs[n]
            if m.size > 1:
                lines.append(c.do(c.call("fill", [array_of(place), c.integer(m.size),
                                                  constant(0.0)])))  # fmt: skip
            else:
                lines.append(c.assign(array_of(place), constant(0.0)))
        return lines

    def _finite(self) -> set[tuple[str, str, int]]:
        """Results that are finite whatever comes."""
        return {key for key, known in self.known.items() if known == FINITE}

    def _either(self, wires: Wires, finite: set[tuple[str, str, int]]) -> None:
        """What comes from one of two branches: known where it is known of both."""
        for place in (*wires.following.values(), *wires.outputs.values()):
            m, pointer = place
            for k in range(m.size):
                key = m.c, pointer, m.elements(k)[0]
                both = key in finite and (
                    pointer == "now->" or self.known.get(key) == FINITE)  # fmt: skip
                self._made(place, k, m.node(pointer, k), FINITE if both else ANY)

    def _inside(self, inner: Block, path: str, wires: Wires, outputs: Sequence[str]) -> list[Node]:
        """Statements of a block that runs at times; parts of it are functions of their own."""
        if not inner.prefixed and not is_copies(inner):
            return self._lines(inner, path, wires, outputs, True)
        before, self.lines = self.lines, []
        self.add(inner, path, wires)
        lines, self.lines = self.lines, before
        return lines

    def _forget(self, place: Place) -> None:
        """What comes from one of two branches is itself, and may be anything that either is."""
        for k in range(place[0].size):
            self._made(place, k, place[0].node(place[1], k))

    def _equations(
        self, block: Block, wires: Wires, outputs: Sequence[str], last: bool
    ) -> list[Node]:
        """Statements of a block's own equations."""
        if last and "transitions" in block.choices:
            return self._machine(block, wires)
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
        plain, before = list(results), self.functions.mark()
        try:
            if block.composition.split:  # only CasADi's text leaves what is prepared where it lies
                raise Unsupported("a tick in two parts")
            results += page.hidden
            if not block.sx:
                f = ca.Function("part", arguments, results, {"cse": True})
                return self._arrays(f, places, targets, page)
            results += [dense_value(block, block.outputs[k], y[k]) for k in known]
            f = ca.Function("part", arguments, results, {"cse": True})
            return self._scalar(f, places, targets, page, [wires.outputs[k] for k in known])
        except Unsupported:  # a solver, say
            self.functions.go_back(before)
            f = ca.Function("equations", arguments, plain)
            name = f"{block._c_name()}_{len(self.outside) + 1}"
            left, lines = left_to_casadi(block, f, name, places, [at for at, _ in targets], wires)
            self.outside.append(left)
            for at, _ in targets:
                self._forget(at)
            return lines

    def _machine(self, block: Block, wires: Wires) -> list[Node]:
        """Statements of a state machine: its conditions, and a switch over its states."""
        groups = [block.symbols(role) for role in ("input", "param")]
        given = {**groups[0], **groups[1]}
        rows = {text: (here, to) for here, to, text in reversed(block.choices["transitions"])}
        f = ca.Function("part", list(given.values()),
                        [read(text).value(given) for text in rows], {"cse": True})  # fmt: skip
        taken = self.functions.taken(f) | self.functions.pointers
        local = dict[tuple[int, int], str]()
        for i, (here, to) in enumerate(rows.values()):
            said = c_name(f"to_{to}" if here == "*" else f"{here}_to_{to}")
            local[i, 0] = free_name(said, {*taken, *local.values()})
        places = [
            *(wires.inputs[n] for n in block.inputs),
            *(wires.params[n] for n in block.params),
        ]
        writer = Writer(
            f, lambda i, k: self._read(places, i, k), local, itertools.count(1),
            can_be=lambda i, k: self._given(places, i, k), shown=len(rows),
        ).run()  # fmt: skip
        chosen = {text: writer.condition(writer.results[i][1]) for i, text in enumerate(rows)}
        then = free_name("then", {*taken, *local.values()})
        (now,), (to,), (told,) = (
            [*table.values()] for table in (wires.states, wires.following, wires.outputs)
        )
        lines = [*writer.lines, *switch_lines(block, now[0].at(now[1], 0), then, chosen)]
        for m, pointer in (to, told):
            lines.append(c.assign(expression(m.at(pointer, 0)), expression(f"(double){then}")))
            self._made((m, pointer), 0, m.node(pointer, 0), FINITE)
        return lines

    def _read(self, places: Sequence[Place | None], i: int, k: int) -> Node:
        place = places[i]
        return constant(0.0) if place is None else expression(place[0].at(place[1], k))

    def _scalar(
        self, f: ca.Function, places: Sequence[Place | None], targets: Sequence[tuple[Place, str]],
        page: Told, known: Sequence[Place],
    ) -> list[Node]:  # fmt: skip
        shown, places, part = len(targets), [*places, *known], next(self.written)
        taken = self.functions.taken(f) | self.functions.pointers
        local: dict[tuple[int, int], str] = {}
        for i, ((m, _), name) in enumerate(targets):
            for k in range(m.size):
                local[i, k] = claim_name(local_name(name, "" if m.scalar else f"_{k}"), taken)
        for i, letter in page.names.items():
            for k in range(f.numel_out(i)):
                own = letter if f.numel_out(i) == 1 else f"{letter}_{k}"
                local[i, k] = claim_name(own, taken)
        writer = Writer(
            f, lambda i, k: self._read(places, i, k), local, itertools.count(1),
            can_be=lambda i, k: self._given(places, i, k), shown=shown, known=len(known),
        ).run()  # fmt: skip
        lines = list(writer.lines)
        for (i, k), node in writer.results:
            (m, pointer), _ = targets[i]
            made = writer.result(node)
            lines.append(c.assign(expression(m.at(pointer, k)), made))
            told = made if made.kind == "member" else c.name(f"{part} {node}")
            self._made(targets[i][0], k, told, writer.can_be[node])
        kept = {*local.values(), *((LOCAL | self.functions.reserved) - {"i"})}
        lines = roll_lines(copy_statements(lines), kept, sort=True)
        return with_origins(lines, named_equations(local, targets, page))

    def _given(self, places: Sequence[Place | None], i: int, k: int) -> int:
        place = places[i]
        return FINITE if place is None else self._can_be(place, k)

    def _arrays(
        self, f: ca.Function, places: Sequence[Place | None], targets: Sequence[tuple[Place, str]],
        page: Told,
    ) -> list[Node]:  # fmt: skip
        sources = []
        inner = passed_on(f)
        if inner is not None and inner.n_in() + inner.n_out() > ARGUMENTS:
            f = inner
        for i, at in enumerate(places):
            if at is None and f.nnz_in(i) > 1:
                raise Unsupported("a vector that comes later")
            sources.append(constant(0.0) if at is None else vector_of(at))
        outputs = [array_of(p) for p, _ in targets] + [None] * (f.n_out() - len(targets))
        taken = self.functions.taken(f) | self.functions.pointers
        free: dict[int, str] = {}
        for i, (_, name) in enumerate(targets):
            free[i] = claim_name(local_name(name), taken)
        for i, letter in page.names.items():
            free[i] = claim_name(letter, taken)
        lines = self.functions.statements(
            f, sources, outputs, itertools.count(1),
            lambda i, k: self._given(places, i, k), len(targets), free,
        )  # fmt: skip
        for (m, pointer), _ in targets:
            for k in range(m.size):
                self._made((m, pointer), k, m.node(pointer, k))
        return with_origins(
            lines, named_equations({(i, 0): name for i, name in free.items()}, targets, page)
        )
