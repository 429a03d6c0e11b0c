"""Functions with names and typed arguments: what a map, a fold or a search evaluates, in C.

Each CasADi Function becomes one C function: scalars by value, vectors by their address, results
by address, or as what it returns if it has one number. A map and an accumulation become a loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from slipctl.block.fields import VectorNames
from slipctl.ccode.module.comments import comment
from slipctl.ccode.module.layout import KEYWORDS, LIBRARY, LOCAL
from slipctl.ccode.passes.local_names import name_locals, with_inside
from slipctl.ccode.passes.repeats import hand_results, roll_calls
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.arrays import Arrays
from slipctl.ccode.tree.expressions import ANY, Unsupported, Writer
from slipctl.ccode.tree.graph import argument_names, free_name, result_name, word
from slipctl.ccode.tree.loops import (
    Sums,
    accumulation_body,
    call_chain,
    is_running_sum,
    map_body,
    passed_on,
    shared_columns,
    sums,
)
from slipctl.ccode.tree.nodes import Node as C
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.scans import find_scan, scan_lines
from slipctl.ccode.tree.vectors import AT, element, loop, place
from slipctl.ccode.tree.while_loops import Again, again_lines, branches, find_while_loop, stays


@dataclass
class Functions:
    """C functions made so far, in order.

    Attributes:
        docs: comment by the name of a Function.
        made: function by C name.
        names: C name by serialised Function.
        letters: names that locals have from the model.
        reserved: names that are taken.
        pointers: those of them that are locals of a part; a function that it calls may have them.
        repeats: what Functions do again and again, if that is all, by their hash.
        vector_names: what numbers in the vectors of Functions are.
        enums: those that are read by a constant: what the vector is, and the place, by name.
    """

    docs: Mapping[str, str]
    made: dict[str, C] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    letters: set[str] = field(default_factory=set)
    reserved: set[str] = field(default_factory=lambda: {*LOCAL, *KEYWORDS})
    pointers: set[str] = field(default_factory=set)
    repeats: dict[int, tuple[ca.Function, Again | None]] = field(default_factory=dict)
    vector_names: VectorNames = field(default_factory=dict)
    enums: dict[str, tuple[str, int]] = field(default_factory=dict)

    def mark(self) -> dict[str, Any]:
        """What there is so far, for :meth:`go_back`."""
        return {k: copy(v) for k, v in vars(self).items() if isinstance(v, (dict, set))}

    def go_back(self, mark: Mapping[str, Any]) -> None:
        """Forget what has come since."""
        vars(self).update(mark)

    def name(self, f: ca.Function) -> str:
        """C name of a Function, which is written if it is not there yet.

        Raises:
            Unsupported: it has an operation that is not written.
        """
        key = f.serialize()
        if key not in self.names and (inner := passed_on(f)) is not None:
            self.names[key] = self.name(inner)
        if key not in self.names:
            name = self.names[key] = self.take(f.name())
            self.made[name] = self._written(f, name)  # behind those that it calls
        return self.names[key]

    def take(self, name: str) -> str:
        """A free name, which nobody else gets."""
        found = free_name(name, self.reserved | LIBRARY)
        self.reserved.add(found)
        return found

    def taken(self, f: ca.Function) -> set[str]:
        """Names that no local of a Function may have."""
        return {*(self.reserved - self.pointers), *(g.name() for g in f.find_functions())}

    # ---- one function ---------------------------------------------------------------------------

    def _written(self, f: ca.Function, name: str) -> C:
        kind = f.class_name()
        if kind not in ("SXFunction", "MXFunction", "Map"):
            raise Unsupported(f"{f.name()}: {kind}")
        inputs, outputs = _names(f, self.taken(f))
        self.letters |= {*inputs, *outputs}
        lines = name_locals(self._body(f, kind, inputs, outputs), "", self.taken(f))
        returns = returns_number(f)
        if returns:
            (out,) = (n for n in outputs if n)
            lines = _with_return(lines, out)
        given = [_parameter("", n, f.nnz_in(i)) for i, n in enumerate(inputs) if n]
        if not returns:
            given += [_parameter("*", n, f.nnz_out(i)) for i, n in enumerate(outputs) if n]
        used = c.variables(lines)
        unused = [c.mark_unused(n) for n in inputs if n and n not in used]
        what = self.docs.get(f.name())
        told = comment(f"{f.name()}: {what}") if what else ""
        kind = f"static {'double' if returns else 'void'}"
        lines = self._by_names(f, lines, inputs, outputs)
        return c.function(kind, name, given, [*unused, *lines], told)

    def _by_names(
        self, f: ca.Function, lines: list[C], inputs: Sequence[str], outputs: Sequence[str]
    ) -> list[C]:
        """Statements in which numbers of known vectors are read by what they are."""
        known = self.vector_names.get(f.name(), {})
        said = {n: known[f.name_in(i)] for i, n in enumerate(inputs) if f.name_in(i) in known}
        said |= {n: known[f.name_out(i)] for i, n in enumerate(outputs) if f.name_out(i) in known}

        def rule(x: C) -> C | None:
            if x.kind != "index" or x.parts[0].kind != "name" or x.parts[0].head not in said:
                return None
            what, names = said[x.parts[0].head]
            at = x.parts[1]
            number = at.parts[0] if at.kind == "op" and at.head == "+" else at
            if number.kind != "number" or int(number.head) not in names:
                return None
            named, place = f"{what}_{names[int(number.head)]}".upper(), (what, int(number.head))
            if self.enums.setdefault(named, place) != place:
                return None  # of another problem in the same module
            to = c.name(named)
            return c.index(x.parts[0], to if number is at else c.op(to, "+", at.parts[1]))

        return [x.change(rule) for x in lines] if said else lines

    def _body(
        self, f: ca.Function, kind: str, inputs: Sequence[str], outputs: Sequence[str]
    ) -> list[C]:
        if kind == "SXFunction":
            return self._scalar(f, inputs, outputs)
        if kind == "Map":
            inner, n = map_body(f)
            return self._loop(inner, n, inputs, outputs, 0)
        summed = sums(f)
        if summed is not None:
            return self._sums(f, summed, inputs, outputs)
        part = shared_columns(f)
        if part is not None:
            kept = int(part.goes_on)
            return self._loop(part.inner, part.count, inputs, outputs, kept, part.arguments)
        chain = call_chain(f)
        if chain is not None:
            return self._chain(f, *chain, inputs, outputs)
        each = accumulation_body(f)
        if each is not None and f.nnz_out(0) != each[0].nnz_out(0):
            return self._loop(each[0], each[1], inputs, outputs, 1)
        scan = find_scan(f)
        if scan is not None:
            name, one = self.name(scan.inner), returns_number(scan.inner)
            return scan_lines(scan, name, inputs, outputs, self.taken(f), one)
        more = self._again(f)
        if more is not None:
            return again_lines(more, self.name(more.once), inputs, outputs[0], self.taken(f))
        sources = [
            c.name(n) if f.nnz_in(i) == 1 else place(c.name(n), 0) for i, n in enumerate(inputs)
        ]
        return self.statements(f, sources, [c.name(n) if n else None for n in outputs])

    def _again(self, f: ca.Function) -> Again | None:
        """What a Function does again and again; looked at once."""
        key = f.__hash__()
        if key not in self.repeats:
            self.repeats[key] = f, find_while_loop(f, self._again)
        return self.repeats[key][1]

    def _scalar(self, f: ca.Function, inputs: Sequence[str], outputs: Sequence[str]) -> list[C]:
        if any(not f.sparsity_out(i).is_dense() and f.nnz_out(i) == 0 for i in range(f.n_out())):
            raise Unsupported("empty result")

        def at(name: str, n: int, k: int) -> C:
            return c.name(name) if n == 1 else c.index(c.name(name), k)

        inner, names = with_inside(f, {*inputs, *outputs, *self.taken(f)})
        self.letters |= set(names.values())
        writer = Writer(
            inner, lambda i, k: at(inputs[i], f.nnz_in(i), k), names, shown=f.n_out(), modest=True
        ).run()
        lines = list(writer.lines)
        for (i, k), node in writer.results:
            to, made = at(outputs[i], f.nnz_out(i), k), writer.result(node)
            to = c.value_at(to) if f.nnz_out(i) == 1 else to
            lines.append(c.give(made) if returns_number(f) else c.assign(to, made))
        return roll_lines(lines, {*inputs, *outputs})

    def _loop(
        self, inner: ca.Function, n: int, inputs: Sequence[str], outputs: Sequence[str],
        kept: int, whole: Set[int] = frozenset(),
    ) -> list[C]:  # fmt: skip
        """N calls, each with its columns; with ``kept`` the first result goes on as argument.

        An argument that is in ``whole`` is the same in each of them.
        """
        lines: list[C] = []
        arguments: list[C] = []
        now = c.name("now")
        for i, name in enumerate(inputs):
            size = inner.nnz_in(i)
            if not size:
                continue
            if i < kept:
                start = c.address(c.name(name)) if size == 1 else c.name(name)
                lines.append(c.declare("const double", c.value_at(now), start))
                arguments.append(c.value_at(now) if size == 1 else now)
            else:
                arguments.append(c.name(name) if i in whole else column(name, size))
        sizes = [inner.nnz_out(i) for i in range(len(outputs))]
        results = [column(n, size) for n, size in zip(outputs, sizes, strict=True) if size]
        called = self.name(inner)
        if returns_number(inner):
            body = [c.assign(results[0], c.call(called, arguments))]
        else:
            given = [c.pointer(r) for r in results]
            body = [c.do(c.call(called, [*arguments, *given]))]
        if kept:
            body.append(c.assign(now, c.pointer(column(outputs[0], sizes[0]))))
        return [*lines, c.loop(n, body)]

    def _chain(
        self, f: ca.Function, inner: ca.Function, n: int, inputs: Sequence[str],
        outputs: Sequence[str],
    ) -> list[C]:  # fmt: skip
        """Calls one after the other, each with what the one before gave, in two arrays by turns.

        A chain of chains is one: CasADi nests a long one by tens.
        """
        while (deeper := call_chain(inner)) is not None:
            inner, n = deeper[0], n * deeper[1]
        taken = {*self.taken(f), *inputs, *outputs}
        now, to, other = (free_name(w, taken) for w in ("before", "to", "between"))
        given = ", ".join([now, *(x for x in inputs[1:] if x), to])
        size = f.nnz_out(0)
        return code(
            f"double {other}[{size}];"
            f"for (int i = 0; i < {size}; ++i) {{ {other}[i] = 0.0; }}"
            f"const double *{now} = {inputs[0]};"
            f"for (int i = 0; i < {n}; ++i) {{"
            f" double *const {to} = ((i % 2) == {(n - 1) % 2}) ? {outputs[0]} : {other};"
            f" {self.name(inner)}({given}); {now} = {to}; }}"
        )

    def _sums(
        self, f: ca.Function, found: Sums, inputs: Sequence[str], outputs: Sequence[str]
    ) -> list[C]:
        """Sums of what each evaluation of a map gives, without an array of all of it."""
        inner, taken = found.inner, {*self.taken(f), *inputs, *outputs}
        given = [
            c.name(inputs[s]) if f.nnz_in(s) == size else column(inputs[s], size)
            for i, s in enumerate(found.sources) if (size := inner.nnz_in(i))
        ]  # fmt: skip
        before, declared, after = list[C](), list[C](), list[C]()
        for k, name in enumerate(outputs):
            size, one = f.nnz_out(k), free_name(f"{result_name(inner, k) or 'term'}_one", taken)
            taken.add(one)
            declared.append(c.declare("double", one, size=size))
            given.append(c.name(one) if size > 1 else c.address(c.name(one)))
            before += code(
                f"*{name} = 0.0;" if size == 1
                else f"for (int j = 0; j < {size}; ++j) {{ {name}[j] = 0.0; }}"
            )  # fmt: skip
            after += code(
                f"*{name} += {one};" if size == 1
                else f"for (int j = 0; j < {size}; ++j) {{ {name}[j] += {one}[j]; }}"
            )  # fmt: skip
        called = c.do(c.call(self.name(inner), given))
        return [*before, c.loop(found.count, [*declared, called, *after])]

    # ---- statements of an MX Function -----------------------------------------------------------

    def statements(
        self,
        f: ca.Function,
        sources: Sequence[C],
        outputs: Sequence[C | None],
        count: Iterator[int] | None = None,
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
        hidden: int | None = None,
        names: Mapping[int, str] | None = None,
    ) -> list[C]:
        """Statements that give the results of an MX Function to C variables.

        Args:
            f: the Function.
            sources: by argument, the scalar, or the vector in its array.
            outputs: by result, what it is given to: the argument with its address, or a member.
            count: numbers of names.
            can_be: what a scalar argument can be.
            hidden: results from here on are only told for their names.
            names: names of results.
        """
        targets = {i: to for i, to in enumerate(outputs) if to and f.nnz_out(i) > 1}
        own = {w for to in outputs if to for w in [to.text] if to.kind == "name"}
        own |= {w for v in sources for w in [v.base.text]}
        made = Arrays(
            f, sources, self._call, names, targets, count, can_be, hidden, {*self.taken(f), *own}
        ).run()
        lines = made.lines
        returns = hidden is None and returns_number(f)
        for i, to in enumerate(outputs):
            node = made.outputs[i]
            if node < 0 or not to:
                continue
            n, given = f.nnz_out(i), made._real(made.values[node])
            if n == 1:
                given = element(given, 0)
                to = c.value_at(to) if to.kind == "name" else to
                lines.append(c.give(given) if returns else c.assign(to, given))
            elif given != c.index(to, AT):
                lines += loop(n, c.assign(place(to, 0), given))
        return roll_calls(hand_results(lines), self.taken(f) | own)

    def _call(
        self, at: Arrays, g: ca.Function, arguments: Sequence[C | None],
        results: Sequence[C | None],
    ) -> None:  # fmt: skip
        """Write a call: a branch, a running sum, or that of a function."""
        if is_running_sum(g) and results[0]:
            total = free_name("total", at.taken)
            at.taken.add(total)
            start, given, i = arguments[0], arguments[1], c.name("i")
            assert start is not None
            assert given is not None
            summed = given if given.kind != "unary" else given.parts[0]
            summed = c.index(summed, i) if summed.kind != "index" else c.index(
                summed.parts[0], c.op(summed.parts[1], "+", i))  # fmt: skip
            body = [c.assign(c.name(total), summed, "+="),
                    c.assign(c.index(results[0], i), c.name(total))]  # fmt: skip
            at.lines += [c.declare("double", total, start), c.loop(g.nnz_out(0), body)]
            return
        chosen = branches(g)
        if chosen is None:
            self._plain(at, g, arguments, results, True)
            return
        at.lines += [
            c.declare("double", r) for n, r in enumerate(results) if r and g.nnz_out(n) == 1
        ]
        before, bodies = at.lines, []
        for f in chosen:
            at.lines = []
            kept = stays(f)
            if kept >= 0 and results[0]:
                n, given = f.nnz_out(0), arguments[1 + kept]
                assert given is not None
                copied = c.do(c.call("copy", [results[0], given, c.integer(n)]))
                at.lines.append(c.assign(results[0], given) if n == 1 else copied)
            else:
                self._plain(at, f, arguments[1:], results, False)
            bodies.append(at.lines)
        at.lines = [*before, c.branch(at.asked, bodies[0], bodies[1])]

    def _plain(
        self, at: Arrays, g: ca.Function, arguments: Sequence[C | None],
        results: Sequence[C | None], declare: bool,
    ) -> None:  # fmt: skip
        called, given = self.name(g), [a for a in arguments if a]
        if returns_number(g):
            (result,) = (r for n, r in enumerate(results) if g.nnz_out(n))
            made = c.call(called, given)
            if result:
                at.lines.append(c.declare("const double", result, made) if declare
                                else c.assign(result, made))  # fmt: skip
            return
        passed = []
        for n, r in enumerate(results):
            size = g.nnz_out(n)
            if not size:
                continue
            if not r:
                r = c.name(f"unused{next(at.count)}")
                at.lines.append(c.declare("double", r, size=size))
            elif declare and size == 1:
                at.lines.append(c.declare("double", r))
            passed.append(r if size > 1 else c.address(r))
        at.lines.append(c.do(c.call(called, [*given, *passed])))


def _with_return(lines: list[C], out: str) -> list[C]:
    """Statements of a function that returns its number, where they write it to an address."""
    if out not in c.variables(lines):
        return lines
    number = c.name(out)

    def rule(x: C) -> C | None:
        if x == c.value_at(number):
            return number
        return c.address(number) if x == number else None

    return [c.declare("double", number), *(x.change(rule) for x in lines), c.give(number)]


def returns_number(f: ca.Function) -> bool:
    """Whether a Function gives one number, which its C function returns."""
    return sum(f.nnz_out(i) for i in range(f.n_out())) == 1


def column(array: str, size: int, by: str = "i") -> C:
    """A column of an array in a loop: the number, or the address of the first one."""
    at = c.name(by)
    if size == 1:
        return c.index(c.name(array), at)
    return c.address(c.index(c.name(array), c.op(c.integer(size), "*", at)))


def _parameter(pointer: str, name: str, size: int) -> C:
    """Parameter of a function: a number, an array; what it gives by address."""
    kind = "double" if size == 1 or pointer else "const double"
    named = c.value_at(c.name(name)) if pointer and size == 1 else c.name(name)
    return c.declare(kind, named, size=size)


def _names(f: ca.Function, taken: set[str]) -> tuple[list[str], list[str]]:
    """C names of arguments and results; empty for what holds no number."""
    own = [n or f.name_in(i) for i, n in enumerate(argument_names(f))]
    used = set(taken)

    def free(name: str) -> str:
        name = word(name)
        found = free_name(name if name[:1].isalpha() else f"x_{name}", used)
        used.add(found)
        return found

    inputs = [free(n) if f.nnz_in(i) else "" for i, n in enumerate(own)]
    outputs = [free(f.name_out(i)) if f.nnz_out(i) else "" for i in range(f.n_out())]
    return inputs, outputs
