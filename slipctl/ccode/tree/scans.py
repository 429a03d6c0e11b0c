"""Functions that go over stages are loops of C.

A Function over stages is calls of one for a stage, or of Functions that are such calls. Which
number each call is given is followed through all of them, element by element. It is a loop where
these are columns, one further in each call, what the call before gave, or always the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from slipctl.ccode.tree.expressions import Node
from slipctl.ccode.tree.graph import (
    CALLED,
    CHOSEN,
    JOINED,
    SLICE,
    SPREAD,
    Step,
    argument_names,
    free_name,
    result_name,
    taken_apart,
)
from slipctl.ccode.tree.loops import map_body, shared_columns
from slipctl.ccode.tree.nodes import Node as C
from slipctl.ccode.tree.parser import code

LEAST = 3
"""Calls from which on they are a loop."""

Atom = tuple[float, ...]
"""Where a number comes from: an argument (-1, i, k), a result of a call (call, i, k), or itself."""

Value = tuple[Atom, ...]


@dataclass(frozen=True)
class Scan:
    """Calls of one Function, each with what the one before gave and the next columns.

    Attributes:
        inner: the Function.
        count: how often it is called.
        sources: by its argument, that of the whole behind it.
        carried: which of its results is the argument of the next call, by argument.
        columns: arguments of which each call is given the next column.
        backward: whether the last column is the first.
        last, every: results of the whole that the last call gives, and that all of them give, a
            column each; by the result of ``inner``.
    """

    inner: ca.Function
    count: int
    sources: tuple[int, ...]
    carried: Mapping[int, int]
    columns: frozenset[int]
    backward: bool
    last: Mapping[int, int]
    every: Mapping[int, int]


@dataclass(frozen=True)
class _Flat:
    """Calls of one Function in order, with what they are given, and the results of the whole."""

    inner: ca.Function
    calls: list[list[Value]]
    results: list[Value]


def find_scan(f: ca.Function) -> Scan | None:
    """What a Function does stage by stage, if that is all it does."""
    for deep in (True, False):
        flat = _flat(f, deep)
        found = _scan(f, flat) if flat is not None else None
        if found is not None:
            return found
    return None


def _flat(f: ca.Function, deep: bool) -> _Flat | None:
    """The calls that a Function is made of; ``deep``: those of the Functions over stages in it."""
    if (apart := taken_apart(f)) is None:
        return None
    nodes, outputs = apart
    values: list[Value] = []
    calls: list[list[Value]] = []
    given: dict[int, list[Value]] = {}
    inner: ca.Function | None = None
    for node in nodes:
        assert isinstance(node, Step)
        if node.op != CALLED:
            value = _moved(node, values)
            if value is None:
                return None
            values.append(value)
            continue
        g, number = node.detail[0], node.place[0]
        if number not in given:
            part = _part(g) if deep else None
            base = g if part is None else part.inner
            if inner is not None and not same(base, inner):
                return None
            inner = base
            arguments = [values[a] for a in node.args]
            if part is None:
                given[number] = [_results(len(calls), g, n) for n in range(g.n_out())]
                calls.append(arguments)
            else:
                at = len(calls)
                calls += [[_put(v, arguments, at) for v in c] for c in part.calls]
                given[number] = [_put(v, arguments, at) for v in part.results]
        values.append(given[number][node.place[1]])
    if inner is None or -1 in outputs:
        return None
    return _Flat(inner, calls, [values[n] for n in outputs])


def _part(g: ca.Function) -> _Flat | None:
    """Calls of a Function that goes over stages itself."""
    flat = _flat(g, True)
    return flat if flat is not None and _scan(g, flat, 2) else None


def same(f: ca.Function, g: ca.Function) -> bool:
    """Whether two Functions are one."""
    return f.name() == g.name() and f.serialize() == g.serialize()


def size(node: Node) -> int:
    """Numbers of an operation."""
    return int(getattr(node, "size", 0))


def _results(call: int, g: ca.Function, n: int) -> Value:
    return tuple((call, n, k) for k in range(g.nnz_out(n)))


def _put(value: Value, arguments: Sequence[Value], at: int) -> Value:
    """A value inside a called Function, with what that one is given, its calls counted from at."""
    return tuple(
        arguments[int(a[1])][int(a[2])] if a[0] == -1 else (a[0] + at, *a[1:]) if len(a) > 1 else a
        for a in value
    )


def _moved(node: Step, values: Sequence[Value]) -> Value | None:
    """Elements of a vector that is made of others without any arithmetic."""
    args = [values[a] for a in node.args if a < len(values)]
    if node.op == ca.OP_INPUT:
        return tuple((-1, node.place[0], node.detail + k) for k in range(node.size))
    if node.op == ca.OP_CONST:
        return tuple((float(v),) for v in node.detail)
    if node.op == SLICE:
        offset, stride = node.detail
        return args[0][offset::stride][: node.size]
    if node.op == JOINED:
        return tuple(a for v in args for a in v)
    if node.op == CHOSEN:
        return tuple(args[0][k] if k >= 0 else (0.0,) for k in node.detail)
    if node.op == SPREAD:
        return args[0] * (node.size // max(len(args[0]), 1))
    return None


def _scan(f: ca.Function, flat: _Flat, least: int = LEAST) -> Scan | None:
    """The loop that calls are, if there are as many."""
    inner, calls = flat.inner, flat.calls
    n = len(calls)
    sources: list[int] = []
    carried: dict[int, int] = {}
    steps_: dict[int, int] = {}
    for i in range(inner.n_in()):
        rows = [c[i] for c in calls]
        size = inner.nnz_in(i)
        if not size:
            sources.append(-1)
            continue
        if any(len(r) != size for r in rows) or rows[0][0][0] != -1 or len(rows[0][0]) < 3:
            return None
        source = int(rows[0][0][1])
        whole = tuple((-1, source, k) for k in range(f.nnz_in(source)))
        sources.append(source)
        if rows[0] == whole:
            if all(r == whole for r in rows) and n > 1:
                continue
            before = rows[1][0] if n > 1 else ()
            if len(before) < 3 or before[0] == -1:  # no result of the first call
                return None
            result = int(before[1])
            if all(r == _results(c, inner, result) for c, r in enumerate(rows[1:])):
                carried[i] = result
                continue
            return None
        for sign in (1, -1):
            begin = 0 if sign == 1 else (n - 1) * size
            expected = [whole[begin + sign * c * size :][:size] for c in range(n)]
            if rows == expected and len(whole) == n * size:
                steps_[i] = sign
                break
        else:
            return None
    if len(set(steps_.values())) > 1 or n < least or not (steps_ or carried):
        return None
    backward = -1 in steps_.values()
    order = range(n)[::-1] if backward else range(n)
    last: dict[int, int] = {}
    every: dict[int, int] = {}
    for k, value in enumerate(flat.results):
        if not value or len(value[0]) < 3 or value[0][0] == -1:
            return None
        result = int(value[0][1])
        if value == _results(n - 1, inner, result) and result not in last:
            last[result] = k
        elif value == tuple(a for c in order for a in _results(c, inner, result)):
            if result in every:
                return None
            every[result] = k
        else:
            return None
    return Scan(
        inner, n, tuple(sources), carried, frozenset(steps_), backward, last, every
    )  # fmt: skip


def single_columns(nodes: Sequence[Node]) -> list[Node]:
    """Operations in which a Function that goes over columns is given one, if all are that one.

    What it is given is a copy of it for each column otherwise.
    """
    made: list[Node] = []
    new: dict[int, tuple[ca.Function, tuple[int, ...]]] = {}
    for node in nodes:
        if not isinstance(node, Step) or node.op != CALLED:
            made.append(node)
            continue
        g, number, slots = node.detail
        if number not in new:
            new[number] = _narrow(g, node.args, nodes)
        f, args = new[number]
        made.append(replace(node, args=args, detail=(f, number, slots)))
    return made


def _narrow(
    g: ca.Function, args: tuple[int, ...], nodes: Sequence[Node]
) -> tuple[ca.Function, tuple[int, ...]]:
    """The Function that repeats such arguments itself, and what it is given."""
    spread: dict[int, int] = {}
    for i, a in enumerate(args):
        node = nodes[a]
        while node.op == SLICE and isinstance(node, Step) and node.detail == (0, 1):
            source = nodes[node.args[0]]
            if size(source) != node.size:
                break
            node = source
        if node.op == SPREAD and isinstance(node, Step) and size(node) == g.nnz_in(i):
            spread[i] = node.args[0]
    if not spread:
        return g, args
    sizes = _columns(g)
    chosen = {i: a for i, a in spread.items() if 0 < size(nodes[a]) == sizes.get(i)}
    if not chosen:
        return g, args
    names = [n or g.name_in(i) for i, n in enumerate(argument_names(g))]
    symbols = [
        ca.MX.sym(n, sizes[i]) if i in chosen else ca.MX.sym(n, g.sparsity_in(i))
        for i, n in enumerate(names)
    ]
    given = [
        ca.reshape(ca.repmat(s, 1, g.nnz_in(i) // sizes[i]), *g.size_in(i)) if i in chosen else s
        for i, s in enumerate(symbols)
    ]
    f = ca.Function(g.name(), symbols, g.call(given, False, True), g.name_in(), g.name_out())
    if shared_columns(f) is None and find_scan(f) is None:
        return g, args
    return f, tuple(chosen.get(i, a) for i, a in enumerate(args))


def _columns(g: ca.Function) -> dict[int, int]:
    """Numbers of a column, by the argument of which a Function takes one after the other."""
    if g.class_name() == "Map":
        inner, _ = map_body(g)
        return {i: inner.nnz_in(i) for i in range(g.n_in())}
    if (found := find_scan(g)) is not None:
        return {found.sources[i]: found.inner.nnz_in(i) for i in found.columns}
    return {}


def scan_lines(
    found: Scan, name: str, inputs: Sequence[str], outputs: Sequence[str], taken: set[str],
    returns: bool,
) -> list[C]:  # fmt: skip
    """Statements of a Function over stages.

    Args:
        found: what it does.
        name: C name of the Function of a stage.
        inputs, outputs: names of what the whole is given and gives.
        taken: names that no local may have.
        returns: whether the Function of a stage returns its only result.
    """
    made = _Stages(found, inputs, outputs, taken)
    given = [text for i in range(found.inner.n_in()) if (text := made.argument(i))]
    results = [text for r in range(found.inner.n_out()) if (text := made.result(r))]
    call = f"{name}({', '.join([*given, *results])});"
    if returns:
        call = f"{results[0].removeprefix('&')} = {name}({', '.join(given)});"
    at, last = made.at, found.count - 1
    head = f"int {at} = 0; {at} < {found.count}; ++{at}"
    if found.backward:
        head = f"int {at} = {last}; {at} >= 0; --{at}"
    body = "".join([*made.first, call, *made.then])
    return code(f"{''.join(made.ahead)} for ({head}) {{ {body} }} {''.join(made.behind)}")


class _Stages:
    """Parts of the loop over stages, put together argument by argument, then result by result.

    Attributes:
        at: index of the stage.
        ahead, first, then, behind: statements before the loop, before and after the call in it,
            and behind it.
    """

    def __init__(
        self, found: Scan, inputs: Sequence[str], outputs: Sequence[str], taken: set[str]
    ) -> None:
        self.found, self.inputs, self.outputs = found, inputs, outputs
        self.at = next(x for x in "ijk" if x not in {*inputs, *outputs})
        self.ahead: list[str] = []
        self.first: list[str] = []
        self.then: list[str] = []
        self.behind: list[str] = []
        self._used = {*taken, *inputs, *outputs}
        self._to: dict[int, str] = {}  # where a result goes that is an argument of the next call

    def _free(self, name: str) -> str:
        fresh = free_name(name, self._used)
        self._used.add(fresh)
        return fresh

    def _last(self, r: int) -> str:
        """Result of the whole that is this one of the last call, or nothing."""
        return self.outputs[self.found.last[r]] if r in self.found.last else ""

    def _column(self, name: str, size: int) -> str:
        return f"{name}[{self.at}]" if size == 1 else f"&{name}[{size} * {self.at}]"

    def argument(self, i: int) -> str:
        """What the call is given as an argument; nothing for one without numbers."""
        found, size = self.found, self.found.inner.nnz_in(i)
        name = self.inputs[found.sources[i]] if size else ""
        if i in found.columns:
            return self._column(name, size)
        if i not in found.carried:
            return name
        now, r = self._free(f"{name}_now"), found.carried[i]
        self.ahead.append(f"{'const double *' if size > 1 else 'double '}{now} = {name};")
        if r in found.every:
            to = self._column(self.outputs[found.every[r]], size)
        elif size == 1:
            to = self._free(f"{name}_next")
            self.first.append(f"double {to};")
            self.behind += [f"*{self._last(r)} = {now};"] * bool(self._last(r))
        else:
            to = self._by_turns(name, size, self._last(r))
        self._to[r] = f"&{to}" if size == 1 else to
        self.then.append(f"{now} = {to};")
        return now

    def _by_turns(self, name: str, size: int, last: str) -> str:
        """Pointer to one of two arrays, so that the last call writes where it is wanted."""
        arrays = [last or self._free(f"{name}_one"), self._free(f"{name}_other")]
        self.ahead += [f"double {a}[{size}];" for a in arrays if a != last]
        if not (self.found.backward or self.found.count % 2):
            arrays.reverse()
        turns, to = self._free(f"{name}_by_turns"), self._free(f"{name}_next")
        self.ahead.append(f"double *const {turns}[2] = {{{', '.join(arrays)}}};")
        self.first.append(f"double *const {to} = {turns}[{self.at} % 2];")
        return to

    def result(self, r: int) -> str:
        """Where the call writes a result; nothing for one without numbers."""
        found, size, last = self.found, self.found.inner.nnz_out(r), self._last(r)
        if not size:
            return ""
        if r in found.every:
            whole = self.outputs[found.every[r]]
            ends = 0 if found.backward else found.count - 1
            if last and size == 1:
                self.behind.append(f"*{last} = {whole}[{ends}];")
            elif last:
                self.behind.append(f"copy({last}, &{whole}[{size * ends}], {size});")
            return self._to.get(r) or f"{'&' * (size == 1)}{self._column(whole, size)}"
        if r in self._to:
            return self._to[r]
        if last:
            return last
        name = self._free(f"{result_name(found.inner, r) or 'unused'}_now")
        self.ahead.append(f"double {name}[{size}];" if size > 1 else f"double {name};")
        return name if size > 1 else f"&{name}"
