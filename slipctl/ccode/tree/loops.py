"""Which Functions are loops: maps, their sums, accumulations, calls one after the other."""

from __future__ import annotations

import re
from dataclasses import dataclass

import casadi as ca
import numpy as np

from slipctl.ccode.tree.expressions import Node
from slipctl.ccode.tree.graph import CALLED, SPREAD, SUM_OF, Step, taken_apart


def map_body(f: ca.Function) -> tuple[ca.Function, int]:
    """Function of a map, and how often it is evaluated."""
    found = f.info().get("f")
    inner = found if isinstance(found, ca.Function) else f.find_functions(0)[0]
    n = next(f.nnz_in(i) // inner.nnz_in(i) for i in range(f.n_in()) if inner.nnz_in(i))
    return inner, n


@dataclass(frozen=True)
class Sums:
    """A map whose results are summed: its Function, how often, and the argument behind each."""

    inner: ca.Function
    count: int
    sources: tuple[int, ...]


def sums(f: ca.Function) -> Sums | None:
    """What a Function sums, if it is a map of its arguments and sums all that comes of it."""
    if (apart := taken_apart(f)) is None:
        return None
    nodes, outputs = apart
    called = [n for n in nodes if n.op == CALLED]
    calls = {n.place[0] for n in called}
    if len(calls) != 1 or not isinstance(called[0], Step) or f.n_out() < 2:
        return None
    g = called[0].detail[0]
    if g.class_name() != "Map" or g.n_out() != f.n_out() or -1 in outputs:
        return None
    inner, count = map_body(g)
    for k, n in enumerate(outputs):
        node = nodes[n]
        source = nodes[node.args[0]] if node.args else node
        if node.op != SUM_OF or source.op != CALLED or source.place[1] != k:
            return None
        if f.nnz_out(k) != inner.nnz_out(k):
            return None
    sources = []
    for i, a in enumerate(called[0].args):
        node = nodes[a]
        if node.op == SPREAD:
            node = nodes[node.args[0]]
            if _size(node) != inner.nnz_in(i):
                return None
        if node.op != ca.OP_INPUT and g.nnz_in(i):
            return None
        whole = f.nnz_in(node.place[0]) == _size(node)
        if g.nnz_in(i) and not whole:
            return None
        sources.append(node.place[0])
    return Sums(inner, count, tuple(sources))


def _size(node: Node) -> int:
    return int(getattr(node, "size", 0))


@dataclass(frozen=True)
class Shared:
    """A map, or an accumulation, of which some arguments are the same in each evaluation.

    Attributes:
        inner, count: what is evaluated, and how often.
        goes_on: whether the first result is the first argument of the next one.
        arguments: those that are the same.
    """

    inner: ca.Function
    count: int
    goes_on: bool
    arguments: frozenset[int]


def shared_columns(f: ca.Function) -> Shared | None:
    """What a Function evaluates with columns of its arguments, and with some as they are."""
    if (apart := taken_apart(f)) is None:
        return None
    nodes, outputs = apart
    called = [n for n in nodes if isinstance(n, Step) and n.op == CALLED]
    if len({n.place[0] for n in called}) != 1:
        return None
    g = called[0].detail[0]
    results = [nodes[n] for n in outputs if n >= 0]
    if g.n_in() != f.n_in() or [(n.op, n.place[1]) for n in results] != [
        (CALLED, k) for k in range(g.n_out())
    ]:
        return None
    whole = set()
    for i, a in enumerate(called[0].args):
        node = nodes[a]
        if node.op == SPREAD:
            whole.add(i)
            node = nodes[node.args[0]]
        if (node.op, node.place) != (ca.OP_INPUT, (i, 0)) or _size(node) != f.nnz_in(i):
            return None
    again = (*map_body(g), False) if g.class_name() == "Map" else None
    if again is None and (found := accumulation_body(g)) and g.nnz_out(0) != found[0].nnz_out(0):
        again = (*found, True)
    return Shared(*again, frozenset(whole)) if again and whole else None


def call_chain(f: ca.Function) -> tuple[ca.Function, int] | None:
    """What a Function calls one after the other, on its first argument, and how often."""
    if (apart := taken_apart(f)) is None:
        return None
    nodes, outputs = apart
    called = [n for n in nodes if isinstance(n, Step) and n.op == CALLED]
    names = {n.detail[0].serialize() for n in called}
    if len(called) < 3 or len(names) != 1 or f.n_out() != 1 or f.nnz_out(0) < 2:
        return None
    inner = called[0].detail[0]
    if len(nodes) != len(called) + f.n_in() or inner.n_in() != f.n_in() or inner.n_out() != 1:
        return None
    last = None
    for n in called:
        first, *rest = (nodes[a] for a in n.args)
        begins = (
            first.op == ca.OP_INPUT and first.place == (0, 0) if last is None else first is last
        )
        same = all(
            node.op == ca.OP_INPUT and node.place == (i, 0) and f.nnz_in(i) == inner.nnz_in(i)
            for i, node in enumerate(rest, start=1)
        )
        if not (begins and same):
            return None
        last = n
    if nodes[outputs[0]] is not last or f.nnz_in(0) != inner.nnz_in(0):
        return None
    return (inner, len(called)) if inner.nnz_in(0) == inner.nnz_out(0) else None


def accumulation_body(f: ca.Function) -> tuple[ca.Function, int] | None:
    """What ``mapaccum`` repeats, and how often: CasADi nests calls of ten where a loop is meant.

    Believed only where both give the same numbers.
    """
    inner = f
    while True:
        called = {}
        if inner.class_name() != "MXFunction":
            break
        for k in range(inner.n_instructions()):
            if inner.instruction_id(k) == ca.OP_CALL:
                g = inner.instruction_MX(k).which_function()
                called[g.name()] = g
        bases = {re.sub(r"_acc\d+$", "", n) for n in called}
        if len(bases) != 1:
            break
        nested = [g for n, g in called.items() if re.search(r"_acc\d+$", n)]
        inner = nested[0] if nested else next(iter(called.values()))
        if not nested:
            break
    if inner is f or not inner.n_in() or inner.n_in() != f.n_in() or inner.n_out() != f.n_out():
        return None
    only_last = f.nnz_out(0) == inner.nnz_out(0)
    counts = {
        a / b for a, b in [
            *((f.nnz_in(i), inner.nnz_in(i)) for i in range(1, f.n_in())),
            *((f.nnz_out(i), inner.nnz_out(i)) for i in range(int(only_last), f.n_out())),
        ] if b
    }  # fmt: skip
    if len(counts) != 1 or inner.nnz_in(0) != f.nnz_in(0) or inner.nnz_out(0) != inner.nnz_in(0):
        return None
    (n,) = counts
    wide = [(inner.size1_in(i), n * inner.size2_in(i)) for i in range(1, f.n_in())]
    if n != int(n) or n < 3 or not all(inner.sparsity_in(i).is_dense() for i in range(f.n_in())):
        return None
    if wide != [f.size_in(i) for i in range(1, f.n_in())]:
        return None
    rng = np.random.default_rng(1)
    given = [rng.uniform(0.1, 1, f.size_in(i)) for i in range(f.n_in())]
    whole = [np.array(v).reshape(f.size_out(i)) for i, v in enumerate(f.call(given))]
    state, found = given[0], []
    for k in range(int(n)):
        columns = [
            g[:, k * inner.size2_in(i) : (k + 1) * inner.size2_in(i)]
            for i, g in enumerate(given) if i
        ]  # fmt: skip
        results = inner.call([state, *columns])
        state = results[0]
        found.append(results)
    for i, v in enumerate(whole):
        pieces = [np.array(r[i]).reshape(inner.size_out(i)) for r in found]
        pieces = pieces[-1:] if not i and only_last else pieces
        if not np.array_equal(np.hstack(pieces), v, equal_nan=True):
            return None
    return inner, int(n)


def passed_on(f: ca.Function) -> ca.Function | None:
    """The Function that one calls with its own arguments, if it gives just what that one gives."""
    if (apart := taken_apart(f)) is None:
        return None
    nodes, outputs = apart
    called = [n for n in nodes if n.op == CALLED and isinstance(n, Step)]
    if len({n.place[0] for n in called}) != 1 or len(nodes) != len(called) + f.n_in():
        return None
    g = called[0].detail[0]
    given = [(nodes[a].op, nodes[a].place) for a in called[0].args]
    results = [(nodes[n].op, nodes[n].place[1]) for n in outputs if n >= 0]
    same = (
        given == [(ca.OP_INPUT, (i, 0)) for i in range(f.n_in())]
        and results == [(CALLED, k) for k in range(f.n_out())]
        and [f.nnz_in(i) for i in range(f.n_in())] == [g.nnz_in(i) for i in range(g.n_in())]
        and [f.nnz_out(k) for k in range(f.n_out())] == [g.nnz_out(k) for k in range(g.n_out())]
    )
    return g if same else None


def is_running_sum(f: ca.Function) -> bool:
    """Whether a Function gives the sums of the first elements of its second argument."""
    if (f.n_in(), f.n_out()) != (2, 1) or f.class_name() != "MXFunction" or f.nnz_in(0) != 1:
        return False
    again = accumulation_body(f)
    if again is None or again[0].n_instructions() != 4 or f.nnz_out(0) != again[1]:
        return False
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    return bool(ca.is_equal(again[0](a, b), a + b, 1))
