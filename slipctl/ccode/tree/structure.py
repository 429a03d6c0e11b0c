"""A Function as statements of C: expressions, branches that are taken or not, calls that stay.

An MX Function is taken apart. SX Functions and small MX Functions in it are written as expressions.
``if_else`` Functions (what ``every`` is made of) are ``if`` and ``else`` around their statements.
What is left (maps, long folds, solvers, tables) is a call of CasADi's own text.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import ANY, FINITE, Unsupported, Writer
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.vectors import is_place

INLINE = 600
"""Operations up to which an MX Function is written as expressions where it is called."""

WHOLE = 4000
"""Operations up to which equations are taken apart at all."""


@dataclass(frozen=True)
class Call:
    """A call that is no expression: a branch, or CasADi's text."""

    function: ca.Function
    first_argument: int  # among the results of the flat Function
    first_result: int  # among its arguments


@dataclass(frozen=True)
class Flat:
    """An SX Function around calls: their results are extra arguments, their arguments results."""

    f: ca.Function
    arguments: int  # those of the Function that was taken apart
    first_result: int  # where its own results begin
    calls: tuple[Call, ...]
    source: ca.Function


@dataclass
class Outside:
    """Functions that CasADi's text evaluates, and what the C names of them are for now."""

    functions: list[ca.Function] = field(default_factory=list)

    def name(self, f: ca.Function) -> str:
        """Name to stand for the C function until its text is there."""
        for k, known in enumerate(self.functions):
            if known.name() == f.name():
                if known.serialize() != f.serialize():
                    raise Unsupported(f"two Functions named {f.name()}")
                return f"CALL_{k}_"
        self.functions.append(f)
        return f"CALL_{len(self.functions) - 1}_"


def weight(f: ca.Function) -> int:
    """Number of scalar operations of a Function written out; what stays a call counts little."""
    kind = f.class_name()
    if kind == "SXFunction":
        return int(f.n_instructions())
    if kind != "MXFunction":
        return int(f.nnz_in() + f.nnz_out())
    total = 0
    for k in range(f.n_instructions()):
        op = f.instruction_id(k)
        if op == ca.OP_CALL:
            g = f.instruction_MX(k).which_function()
            whole = weight(g)
            total += whole if whole <= INLINE or g.class_name() == "SXFunction" else g.nnz_out()
        elif op != ca.OP_OUTPUT:
            total += int(f.instruction_MX(k).numel())
    return total


def is_inlined(g: ca.Function) -> bool:
    """Whether an MX Function becomes expressions where it is called."""
    if g.class_name() != "MXFunction" or weight(g) > INLINE:
        return False
    try:
        flatten(g)
    except Unsupported:
        return False
    return True


def flatten(f: ca.Function) -> Flat:
    """Take a Function apart.

    Raises:
        Unsupported: too large, or an operation that has no SX form.
    """
    if f.class_name() == "SXFunction":
        return Flat(f, f.n_in(), 0, (), f)
    if f.class_name() != "MXFunction" or weight(f) > WHOLE:
        raise Unsupported(f.name())
    symbols = f.mx_in()
    extra: list[ca.MX] = []
    passed: list[ca.MX] = []
    results = list(f.call(symbols, True, False))
    calls: list[Call] = []
    while (found := _next_call([*symbols, *extra], [*passed, *results])) is not None:
        g = found.which_function()
        old = [found.get_output(i) for i in range(g.n_out())]
        arguments = [found.dep(i) for i in range(found.n_dep())]
        if is_inlined(g):
            new = list(g.call(arguments, True, False))
        else:
            new = [ca.MX.sym("r", *g.size_out(i)) for i in range(g.n_out())]
            calls.append(Call(g, len(passed), len(symbols) + len(extra)))
            extra += new
            passed += arguments
        both = ca.graph_substitute([*passed, *results], old, new)
        passed, results = both[: len(passed)], both[len(passed) :]
    inputs = [*symbols, *extra]
    try:
        flat = ca.Function("flat", inputs, [*passed, *results]).expand()
    except RuntimeError as error:
        raise Unsupported(str(error)) from None
    tidy = ca.Function("flat", flat.sx_in(), flat.call(flat.sx_in(), True, False), {"cse": True})
    dense = all(tidy.sparsity_out(i).is_dense() for i in range(tidy.n_out()))
    if not dense:
        tidy = ca.Function(
            "flat", tidy.sx_in(), [ca.densify(y) for y in tidy.call(tidy.sx_in(), True, False)]
        )
    return Flat(tidy, len(symbols), len(passed), tuple(calls), f)


def _next_call(inputs: Sequence[ca.MX], outputs: Sequence[ca.MX]) -> ca.MX | None:
    """First call that is not one of an SX Function, in the order of evaluation."""
    f = ca.Function("graph", inputs, outputs)
    for k in range(f.n_instructions()):
        if f.instruction_id(k) == ca.OP_CALL:
            node = f.instruction_MX(k)
            if node.which_function().class_name() != "SXFunction":
                return node
    return None


class Statements:
    """Statements of a Function, with the calls in it.

    Args:
        f: the Function.
        read: C expression of (argument, element).
        outside: gathers the Functions that stay calls.
        branches: gives what an if_else Function chooses from: (if true, otherwise), or None.
        names: names of results, as of :class:`Writer`.
        docs: text by the name of a Function, told where its statements begin.
        count: numbers of names, shared in one C function.
        can_be: what (argument, element) can be, as of :class:`Writer`.

    Raises:
        Unsupported: the Function cannot be written this way.
    """

    def __init__(
        self,
        f: ca.Function,
        read: Callable[[int, int], Node],
        outside: Outside,
        branches: Callable[[ca.Function], tuple[ca.Function, ca.Function] | None],
        names: Mapping[tuple[int, int], str] | None = None,
        docs: Mapping[str, str] | None = None,
        count: Iterator[int] | None = None,
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
    ) -> None:
        self.flat = flatten(f)
        self.outside, self.branches, self.docs = outside, branches, dict(docs or {})
        self.count = itertools.count(1) if count is None else count
        self._read = read
        self._done: dict[int, list[Node | None]] = {}  # call -> name of each of its results
        first = self.flat.first_result
        shifted = {(first + i, k): name for (i, k), name in (names or {}).items()}
        self.writer = Writer(
            self.flat.f, self._value, shifted, self.count,
            can_be=lambda i, k: can_be(i, k) if i < self.flat.arguments else ANY,
        )  # fmt: skip
        self.at = dict(self.writer.results)
        self.helpers: set[str] = set()
        self.writer.run()
        self.helpers |= self.writer.helpers

    @property
    def lines(self) -> list[Node]:
        """The statements."""
        return self.writer.lines

    def result(self, i: int, k: int) -> Node:
        """C expression of a result."""
        return self.writer.result(self.at[self.flat.first_result + i, k])

    def finite(self, i: int, k: int) -> bool:
        """Whether a result is always a finite number."""
        return self.writer.can_be[self.at[self.flat.first_result + i, k]] == FINITE

    def _value(self, i: int, k: int) -> Node:
        if i < self.flat.arguments:
            return self._read(i, k)
        number = max(n for n, c in enumerate(self.flat.calls) if c.first_result <= i)
        call = self.flat.calls[number]
        if number not in self._done:
            self._done[number] = self._emit(call)
        name = self._done[number][i - call.first_result]
        assert name is not None
        return c.index(name, k) if call.function.numel_out(i - call.first_result) > 1 else name

    def _argument(self, call: Call, i: int) -> list[int]:
        """Nodes of an argument of a call."""
        n = call.function.numel_in(i)
        nodes = [self.at[call.first_argument + i, k] for k in range(n)]
        if any(k not in self.writer.values for k in nodes):
            raise Unsupported(f"{call.function.name()}: arguments come after results")
        return nodes

    def _used(self, call: Call) -> list[bool]:
        used = {n.place[0] for n, u in zip(self.writer.nodes, self.writer.uses, strict=True)
                if u and n.op == ca.OP_INPUT}  # fmt: skip
        return [call.first_result + i in used for i in range(call.function.n_out())]

    # ---- branches and calls ---------------------------------------------------------------------

    def _emit(self, call: Call) -> list[Node | None]:
        chosen = self.branches(call.function)
        if chosen is not None:
            return self._branch(call, chosen)
        return self._outside(call)

    def _declared(self, call: Call, letter: str) -> list[Node | None]:
        """Names of the results that are used."""
        return [c.name(f"{letter}{next(self.count)}") if u else None for u in self._used(call)]

    def _declare(self, call: Call, names: Sequence[Node | None]) -> None:
        self.writer.lines += [
            c.declare("double", n, size=call.function.numel_out(i))
            for i, n in enumerate(names) if n
        ]  # fmt: skip

    def _branch(self, call: Call, chosen: tuple[ca.Function, ca.Function]) -> list[Node | None]:
        """Write an if_else Function as if and else."""
        arguments = [self._argument(call, i) for i in range(1, call.function.n_in())]
        parts = [
            Statements(
                _only(f, self._used(call)), lambda i, k: self.writer.atom(arguments[i][k]),
                self.outside, self.branches, docs=self.docs, count=self.count,
                can_be=lambda i, k: self.writer.can_be[arguments[i][k]],
            )
            for f in chosen
        ]  # fmt: skip
        names = self._declared(call, "b")
        condition = self.writer.condition(self._argument(call, 0)[0])
        self._declare(call, names)
        bodies = []
        for part in parts:
            self.helpers |= part.helpers
            given = [(n, call.function.numel_out(i)) for i, n in enumerate(names) if n]
            values = [
                line for i, (n, size) in enumerate(given)
                for line in assign(n, [part.result(i, k) for k in range(size)], size > 1)
            ]  # fmt: skip
            bodies.append([*self._told(part.flat.source), *part.lines, *values])
        self.writer.lines.append(c.branch(condition, bodies[0], bodies[1]))
        return names

    def _told(self, f: ca.Function) -> list[Node]:
        """Comments on the Functions that a branch evaluates."""
        inside = dict.fromkeys(g.name() for g in (f, *f.find_functions()))
        return [c.remark(f"{n}: {self.docs[n]}") for n in inside if n in self.docs]

    def _outside(self, call: Call) -> list[Node | None]:
        """Call CasADi's C."""
        f, lines = call.function, self.writer.lines
        name, results = self.outside.name(f), self._declared(call, "r")
        pointers = []
        for i in range(f.n_in()):
            values = [self.writer.atom(k) for k in self._argument(call, i)]
            pointer = address(values)
            if pointer is None:
                pointer = c.name(f"c{next(self.count)}")
                lines.append(c.declare("double", c.index(pointer, len(values))))
                lines += assign(pointer, values, True)
            pointers.append(pointer)
        self._declare(call, results)
        lines += [c.assign(c.index(c.name("arg"), i), p) for i, p in enumerate(pointers)]
        for i, r in enumerate(results):
            to = c.name("NULL") if r is None else r if f.numel_out(i) > 1 else c.address(r)
            lines.append(c.assign(c.index(c.name("res"), i), to))
        lines += code(f"if ({name}(arg, res, WORK_IW_, WORK_W_, 0) != 0) {{ failed = 1; }}")
        return results


def _only(f: ca.Function, used: Sequence[bool]) -> ca.Function:
    """A Function without the results that nobody uses."""
    if all(used):
        return f
    symbols: Any = f.sx_in() if f.class_name() == "SXFunction" else f.mx_in()
    results = f.call(symbols, True, False)
    chosen = [y for y, u in zip(results, used, strict=True) if u]
    return ca.Function(f.name(), symbols, chosen)


def assign(to: Node, values: Sequence[Node], array: bool) -> list[Node]:
    """Statements that give values to a variable or to an array."""
    if not values:
        return []
    if not array:
        return [c.assign(to, values[0])]
    run = _run(values)
    if run is not None and len(values) > 2:
        return [c.do(c.call("copy", [to, run, c.integer(len(values))]))]
    return [c.assign(c.index(to, k), v) for k, v in enumerate(values)]


def address(values: Sequence[Node]) -> Node | None:
    """Address of values that lie side by side in memory; None if they do not."""
    if not values:
        return c.name("NULL")
    run = _run(values)
    if run is None and len(values) == 1 and is_place(values[0]):
        return c.address(values[0])
    return run


def _run(values: Sequence[Node]) -> Node | None:
    first = values[0]
    if first.kind != "index" or not is_place(first.parts[0]) or first.parts[1].kind != "number":
        return None
    base, offset = first.parts[0], int(first.parts[1].head)
    same = all(v == c.index(base, offset + k) for k, v in enumerate(values))
    return c.address(first) if same else None


def drop_unused(lines: Sequence[Node], rest: Sequence[Node]) -> list[Node]:
    """Leave out constants that nothing uses after them."""
    used = c.words(rest)
    kept: list[Node] = []
    for line in reversed(lines):
        made = c.target(line) if line.kind == "declare" and line.head.startswith("const ") else None
        if made is None or made.base.head in used:
            used |= line.words
            kept.append(line)
    return kept[::-1]
