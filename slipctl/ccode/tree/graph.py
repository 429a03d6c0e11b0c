"""The graph of an MX Function, operation by operation, with what each does to a vector."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from slipctl.block.text.intermediates import named_inside
from slipctl.ccode.tree.expressions import Node, Unsupported, choice, known_operation

(
    CALLED, SLICE, JOINED, SPREAD, CHOSEN, PRODUCT, SUM_OF, LARGEST, SMALLEST, DOT, TURNED,
    SPARSE_PRODUCT,
) = range(-20, -8)  # fmt: skip
"""Operations beside those of CasADi on numbers."""

SAME = {ca.OP_RESHAPE, ca.OP_SPARSITY_CAST}
NORMS = (ca.OP_NORM1, ca.OP_NORMF, ca.OP_NORMINF)


@dataclass(frozen=True)
class Step(Node):
    """An operation on a vector: beside the node, how many numbers come out, and its details."""

    size: int = 1
    detail: Any = None


def _piece(mx: ca.MX) -> tuple[int, int]:
    """Number of an argument and of the piece of it, which only the text of the node tells."""
    m = re.fullmatch(r"input\[(\d+)\]\[(\d+)\]", str(mx))
    if m is None:
        raise Unsupported(f"argument {mx}")
    return int(m[1]), int(m[2])


def _segments(f: ca.Function) -> dict[tuple[int, int], int]:
    """Where each piece of an argument begins: CasADi reads some in pieces."""
    sizes: dict[int, dict[int, int]] = {}
    for k in range(f.n_instructions()):
        if f.instruction_id(k) == ca.OP_INPUT:
            i, piece = _piece(f.instruction_MX(k))
            sizes.setdefault(i, {})[piece] = f.instruction_MX(k).nnz()
    found = {}
    for i, pieces in sizes.items():
        whole = sorted(pieces) == list(range(len(pieces))) and sum(pieces.values()) == f.nnz_in(i)
        if not whole and sorted(pieces) != [0]:
            raise Unsupported(f"{f.name()}: pieces of argument {i}")
        offset = 0
        for piece in sorted(pieces):
            found[i, piece] = offset
            offset += pieces[piece]
    return found


def operation_names(f: ca.Function) -> dict[tuple[int, int], str]:
    """What the Python that wrote an MX Function calls its operations, by their hash and result."""
    inside = named_inside(f)
    if inside is None:
        return {}
    held: dict[int, tuple[int, int]] = {}
    marked: dict[int, tuple[int, int]] = {}  # what the sine in a place is of
    found: dict[tuple[int, int], str] = {}
    for k in range(inside.n_instructions()):
        op, o, i = (
            inside.instruction_id(k), inside.instruction_output(k), inside.instruction_input(k)
        )  # fmt: skip
        if op == ca.OP_OUTPUT:
            found.setdefault(marked[i[0]], inside.name_out(o[0]))
            continue
        if op == ca.OP_SIN:
            marked[o[0]] = held[i[0]]
        for n, slot in enumerate(o):
            held[slot] = inside.instruction_MX(k).__hash__(), n
    return found


def steps(f: ca.Function, names: dict[int, str] | None = None) -> tuple[list[Node], list[int]]:
    """Operations of an MX Function in order, and the number of that of each result, or -1.

    Args:
        f: the Function.
        names: is given the name of each operation for which its Python has one.

    Raises:
        Unsupported: an operation that is not written.
    """
    nodes: list[Node] = []
    outputs: list[int] = []
    held: dict[int, int] = {}
    segments: dict[int, list[int]] = {}
    starts = _segments(f)
    calls = itertools.count()

    known: dict[str, int] = {}
    told = operation_names(f) if names is not None else {}

    def add(node: Step, slot: int, n: int = 0) -> None:
        """Take an operation, or the one before that is the same."""
        key = repr(node) if node.op not in (CALLED, ca.OP_INPUT) else ""
        if told and names is not None and (name := told.get((mx.__hash__(), n))):
            names.setdefault(known.get(key, len(nodes)) if key else len(nodes), name)
        if key and key in known:
            held[slot] = known[key]
            return
        held[slot] = known[key] = len(nodes)
        nodes.append(node)

    for k in range(f.n_instructions()):
        op, o, i = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if op == ca.OP_OUTPUT:
            segments.setdefault(o[0], []).append(held[i[0]])
            continue
        mx = f.instruction_MX(k)
        args = tuple(held[a] for a in i if a >= 0) if op != ca.OP_INPUT else ()
        size = mx.nnz()
        if op == ca.OP_INPUT:
            add(Step(op, (), 0.0, (i[0], 0), size, starts[_piece(mx)]), o[0])
        elif op == ca.OP_CONST:
            values = ca.DM(mx.to_DM()).nonzeros()
            add(Step(op, (), values[0] if size else 0.0, size=size, detail=values), o[0])
        elif op == ca.OP_CALL:
            g, number_of = mx.which_function(), next(calls)
            if -1 in i:
                raise Unsupported(f"{g.name()}: an argument that is none")
            for n, slot in enumerate(o):
                if slot >= 0:
                    detail = (g, number_of, tuple(o))
                    add(Step(CALLED, args, 0.0, (number_of, n), g.nnz_out(n), detail), slot, n)
        elif op in (ca.OP_HORZSPLIT, ca.OP_VERTSPLIT):
            if op == ca.OP_VERTSPLIT and not mx.dep(0).is_column():
                raise Unsupported("vertsplit of a matrix")
            offset = 0
            for n, slot in enumerate(o):
                part = mx.get_output(n).nnz()
                if slot >= 0:
                    add(Step(SLICE, args, size=part, detail=(offset, 1)), slot, n)
                offset += part
        else:
            if op == ca.OP_SETNONZEROS:  # elements of what it was, and of what is put in
                both = sum(mx.dep(k).nnz() for k in range(2))
                nodes.append(Step(JOINED, args, size=both))
                args = (len(nodes) - 1,)
            add(_step(op, args, size, mx, nodes), o[0])
    for number in range(f.n_out()):
        found = segments.get(number, [])
        if not f.nnz_out(number):
            outputs.append(-1)
        elif len(found) == 1:
            outputs.append(found[0])
        else:
            outputs.append(len(nodes))
            nodes.append(Step(JOINED, tuple(found), size=f.nnz_out(number)))
    return nodes, outputs


def taken_apart(f: ca.Function) -> tuple[list[Node], list[int]] | None:
    """The same of a Function that can be taken apart; None of any other."""
    if f.class_name() != "MXFunction":
        return None
    try:
        return steps(f)
    except Unsupported:
        return None


def _step(op: int, args: tuple[int, ...], size: int, mx: ca.MX, nodes: Sequence[Node]) -> Step:
    if known_operation(op):
        for a in args:
            if getattr(nodes[a], "size", 1) not in (1, size):
                raise Unsupported("sizes differ")
        found = choice(nodes, Node(op, args))
        return Step(found.op, found.args, size=size)
    if op in SAME:
        return Step(SLICE, args, size=size, detail=(0, 1))
    if op == ca.OP_TRANSPOSE:
        source = mx.dep(0)
        if source.is_vector():
            return Step(SLICE, args, size=size, detail=(0, 1))
        if not source.is_dense():
            raise Unsupported("transpose of a sparse matrix")
        return Step(TURNED, args, size=size, detail=source.shape)
    if op in (ca.OP_VERTCAT, ca.OP_HORZCAT):
        columns = all(mx.dep(k).is_column() for k in range(mx.n_dep()))
        if op == ca.OP_VERTCAT and not columns:
            raise Unsupported("vertcat of matrices")
        return Step(JOINED, args, size=size)
    if op in (ca.OP_GETNONZEROS, ca.OP_SETNONZEROS):
        return _nonzeros(args, size, mx)
    if op == ca.OP_PROJECT:
        have, want = mx.dep(0).sparsity(), mx.sparsity()
        known = {place: k for k, place in enumerate(have.find())}
        return Step(CHOSEN, args, size=size, detail=[known.get(p, -1) for p in want.find()])
    if op == ca.OP_HORZREPMAT:
        return Step(SPREAD, args, size=size, detail=mx.dep(0).nnz())
    if op == ca.OP_HORZREPSUM:
        return Step(SUM_OF, args, size=size, detail=mx.dep(0).nnz())
    if op in (ca.OP_MMAX, ca.OP_MMIN) and mx.dep(0).is_dense():
        kind = LARGEST if op == ca.OP_MMAX else SMALLEST
        return Step(kind, args, size=size, detail=mx.dep(0).nnz())
    if op in NORMS and mx.dep(0).is_dense():
        return Step(op, args, size=size, detail=mx.dep(0).nnz())
    if op == ca.OP_DOT:
        return Step(DOT, args, size=size, detail=mx.dep(0).nnz())
    if op == ca.OP_MTIMES and all(mx.dep(k).is_dense() for k in range(3)):
        x, y = mx.dep(1), mx.dep(2)
        return Step(PRODUCT, args, size=size, detail=(x.shape[0], x.shape[1], y.shape[1]))
    if op == ca.OP_MTIMES and mx.is_dense() and mx.is_column() and mx.dep(2).is_dense():
        pattern = mx.dep(1).sparsity()
        detail = (pattern.colind(), pattern.row())
        return Step(SPARSE_PRODUCT, args, size=size, detail=detail)
    if op == ca.OP_GETNONZEROS_PARAM and len(args) == 2:
        return Step(ca.OP_GETNONZEROS_PARAM, args, size=size, detail=mx.dep(0).nnz())
    if op == ca.OP_LOW and size == 1:
        return Step(ca.OP_LOW, args, size=size, detail=mx.dep(0).nnz() - 1)
    raise Unsupported(f"operation {op}")


def _nonzeros(args: tuple[int, ...], size: int, mx: ca.MX) -> Step:
    """Which nonzeros of all arguments are taken, one after the other."""
    taken = [int(v) for v in mx.mapping().nonzeros()]
    if mx.op() == ca.OP_SETNONZEROS:
        own = list(range(first := mx.dep(0).nnz()))
        for k, place in enumerate(taken, start=first):
            own[place] = k
        taken = own
    stride = taken[1] - taken[0] if len(taken) > 1 else 1
    if stride > 0 and taken == [taken[0] + stride * k for k in range(len(taken))]:
        return Step(SLICE, args, size=size, detail=(taken[0], stride))
    return Step(CHOSEN, args, size=size, detail=taken)


def word(name: str) -> str:
    """A name with an underscore for what no name of C has."""
    return "".join(x if x.isalnum() or x == "_" else "_" for x in name)


def free_name(name: str, taken: set[str]) -> str:
    """A name that is not taken: itself, or with a number behind.

    Names like ``a1`` are those of counted locals, so a model's ``a1`` is written ``a_1``.
    """
    if name[:1] in ("a", "k", "r") and name[1:].isdecimal():
        name = f"{name[0]}_{name[1:]}"
    others = (f"{name}_{k}" for k in itertools.count(2))
    return next(n for n in itertools.chain([name], others) if n not in taken)


def claim_name(word: str, taken: set[str]) -> str:
    """A free name, which is taken from now on."""
    found = free_name(word, taken)
    taken.add(found)
    return found


def argument_names(f: ca.Function) -> list[str]:
    """Names that a Function's own symbols give its arguments; "" for i0, i1, ... of CasADi."""
    kind = f.class_name()
    if kind == "MXFunction":
        own = [v.name() if v.is_symbolic() else f.name_in(i) for i, v in enumerate(f.mx_in())]
    elif kind == "SXFunction":
        own = [_common(v, f.name_in(i)) for i, v in enumerate(f.sx_in())]
    else:
        own = [f.name_in(i) for i in range(f.n_in())]
    return ["" if _counted(n, "i") else word(n) for n in own]


def _counted(name: str, letter: str) -> bool:
    """Whether CasADi has made it: a letter and a number, and maybe a second one."""
    numbers = name[1:].split("_")
    return name[:1] == letter and len(numbers) < 3 and all(n.isdecimal() for n in numbers)


def result_name(f: ca.Function, n: int) -> str:
    """Name that a Function gives a result; "" for o0, o1, ... of CasADi."""
    name = str(f.name_out(n))
    return "" if name[:1] == "o" and name[1:].isdecimal() else name


def stem(name: str) -> str:
    """What an element was named after: a name without the number behind it."""
    base, _, number = name.rpartition("_")
    return base if base and number.isdecimal() else name


def _common(v: ca.SX, otherwise: str) -> str:
    single = [v.nz[k] for k in range(v.nnz())]
    names = {stem(e.name()) for e in single if e.is_symbolic()}
    return names.pop() if len(names) == 1 else otherwise
