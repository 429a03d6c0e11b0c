"""Write a CasADi SX Function as C expressions a person can read, operation for operation.

The tree of operations is kept as it is (no term is moved), so that C gives the bits of Python.
Values used once are written where they are used; ``if_else`` becomes ``?:``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import casadi as ca

from slipctl.ccode.passes import ramp_tables
from slipctl.ccode.passes.sums import Total, totals
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.nodes import Node as C
from slipctl.ccode.tree.parser import expression

WIDTH = 200
"""Characters of an expression above which its longest part gets a line of its own."""

LONG = 80
"""Characters of what is used once from which on its own name is worth a line."""

ATOM, _UNARY, _PRODUCT, _SUM, _RELATION, _EQUAL, _AND, _OR, _CHOICE = range(9, 0, -1)

_BINARY = {
    ca.OP_ADD: ("+", _SUM), ca.OP_SUB: ("-", _SUM), ca.OP_MUL: ("*", _PRODUCT),
    ca.OP_DIV: ("/", _PRODUCT),
}  # fmt: skip
_COMPARE = {
    ca.OP_LT: ("<", _RELATION), ca.OP_LE: ("<=", _RELATION), ca.OP_EQ: ("==", _EQUAL),
    ca.OP_NE: ("!=", _EQUAL),
}  # fmt: skip
_CALLS = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow",
    ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_ATAN2: "atan2", ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_ASINH: "asinh", ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_FMOD: "fmod",
    ca.OP_REMAINDER: "remainder", ca.OP_FABS: "fabs", ca.OP_COPYSIGN: "copysign",
    ca.OP_ERF: "erf", ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1", ca.OP_HYPOT: "hypot",
    ca.OP_SIGN: "sign_of", ca.OP_FMIN: "lesser", ca.OP_FMAX: "greater", ca.OP_SQ: "square",
}  # fmt: skip

_BOUNDS = {ca.OP_FMIN: ("below", "at_most"), ca.OP_FMAX: ("above", "at_least")}
"""Smaller and greater where the first value, or else the second, is never NaN: that is the bound,
and one comparison does. Of equal values the first is given, as fmin does: zeros have signs."""

_TAKES_SIGN = {
    ca.OP_ATAN2: (0, 1), ca.OP_COPYSIGN: (1,), ca.OP_DIV: (1,), ca.OP_INV: (0,),
    ca.OP_POW: (0,), ca.OP_CONSTPOW: (0,),
}  # fmt: skip
_FORGETS_SIGN = {
    *_COMPARE, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_FABS, ca.OP_SQ, ca.OP_EXP, ca.OP_COS,
    ca.OP_COSH,
}  # fmt: skip

ANY, NUMBER, FINITE = range(3)
"""What a value can be: NaN too; infinite, but not NaN; a finite number only."""

_CAN_BE: dict[int, Callable[..., int]] = {
    **dict.fromkeys((*_COMPARE, ca.OP_NOT, ca.OP_AND, ca.OP_OR), lambda *a: FINITE),
    **dict.fromkeys(
        (ca.OP_NEG, ca.OP_FABS, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_SIGN, ca.OP_TANH, ca.OP_ATAN),
        lambda a: a,
    ),
    ca.OP_IF_ELSE_ZERO: lambda condition, a: a,
    **dict.fromkeys(
        (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL), lambda a, b: NUMBER if min(a, b) == FINITE else ANY
    ),
    **dict.fromkeys((ca.OP_TWICE, ca.OP_SQ, ca.OP_EXP), lambda a: min(a, NUMBER)),
    **dict.fromkeys((ca.OP_SIN, ca.OP_COS), lambda a: FINITE if a == FINITE else ANY),
    **dict.fromkeys((ca.OP_FMIN, ca.OP_FMAX), lambda a, b: max(min(a, b), min(max(a, b), NUMBER))),
}  # fmt: skip
"""What a result can be, from what its operands can be; where nothing is said, anything."""

_KNOWN = {
    *_BINARY, *_COMPARE, *_CALLS, ca.OP_NEG, ca.OP_INV, ca.OP_TWICE, ca.OP_NOT, ca.OP_AND, ca.OP_OR,
    ca.OP_IF_ELSE_ZERO,
}  # fmt: skip

_SELECT = -1  # our own operation: (condition, if true, if false)
_SLOPE = -3  # our own operation: derivative of the smaller of two values by the first


class Unsupported(Exception):
    """The Function has an operation that this writer does not know."""


@dataclass(frozen=True)
class Node:
    """One operation: its code, the nodes it takes, and a constant or (argument, element)."""

    op: int
    args: tuple[int, ...] = ()
    value: float = 0.0
    place: tuple[int, int] = (0, 0)


CHAIN = 6
"""Choices one within the other from which on each has a line of its own."""


@dataclass
class Value:
    """C of a value, how strongly its outermost operation binds, and what it is."""

    c: C
    rank: int
    truth: bool = False  # a C condition (bool), not a real number

    @property
    def plain(self) -> bool:
        """Whether it is a name, a member, an element or a number."""
        return self.rank == ATOM and "(" not in self.c.text


def number(value: float) -> str:
    """Write a number as a C double that reads back to the same bits."""
    if math.isnan(value):
        return "((double)NAN)"
    if math.isinf(value):
        return "((double)INFINITY)" if value > 0 else "(-(double)INFINITY)"
    text = repr(float(value)).replace("e+", "e")
    whole = text.removesuffix(".0").rstrip("0")
    zeros = len(text) - 2 - len(whole)
    return f"{whole}e{zeros}" if text.endswith(".0") and zeros >= 5 else text


def constant(value: float) -> C:
    """A number as a node."""
    return expression(number(value))


def known_operation(op: int) -> bool:
    """Whether an operation of CasADi on numbers can be written as an expression."""
    return op in _KNOWN


def read(f: ca.Function) -> tuple[list[Node], list[tuple[tuple[int, int], int]]]:
    """Nodes of an SX Function in order, and (output, element) -> node of its results.

    Raises:
        Unsupported: an operation that cannot be written.
    """
    nodes: list[Node] = []
    results: list[tuple[tuple[int, int], int]] = []
    held: dict[int, int] = {}  # work element -> node
    for k in range(f.n_instructions()):
        op, o, i = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if op == ca.OP_OUTPUT:
            results.append(((o[0], o[1]), held[i[0]]))
            continue
        if op == ca.OP_CONST:
            node = Node(op, value=float(f.instruction_constant(k)))
        elif op == ca.OP_INPUT:
            node = Node(op, place=(i[0], i[1]))
        elif op == ca.OP_ASSIGN:
            held[o[0]] = held[i[0]]
            continue
        elif known_operation(op):
            node = Node(op, tuple(held[a] for a in i))
        else:
            raise Unsupported(f"operation {op} of {f.name()}")
        held[o[0]] = len(nodes)
        nodes.append(slope(nodes, choice(nodes, node)))
    return nodes, results


def choice(nodes: Sequence[Node], node: Node) -> Node:
    """Read (c ? u : 0) + (!c ? v : 0), which is how CasADi keeps an if_else, as c ? u : v."""
    if node.op != ca.OP_ADD:
        return node
    a, b = (nodes[k] for k in node.args)
    if a.op != ca.OP_IF_ELSE_ZERO or b.op != ca.OP_IF_ELSE_ZERO:
        return node
    if _negates(nodes[b.args[0]], a.args[0]):
        return Node(_SELECT, (a.args[0], a.args[1], b.args[1]))
    if _negates(nodes[a.args[0]], b.args[0]):
        return Node(_SELECT, (b.args[0], b.args[1], a.args[1]))
    return node


def slope(nodes: Sequence[Node], node: Node) -> Node:
    """Read (x <= y)/((y <= x) + (x <= y)), the derivative of fmin(x, y) by x, as one operation."""
    if node.op != ca.OP_DIV:
        return node
    above, below = (nodes[k] for k in node.args)
    if above.op != ca.OP_LE or below.op != ca.OP_ADD or node.args[0] not in below.args:
        return node
    a, b = below.args
    other = nodes[a if b == node.args[0] else b]
    if other.op != ca.OP_LE or other.args != above.args[::-1]:
        return node
    return Node(_SLOPE, above.args)


def chains(nodes: Sequence[Node]) -> set[int]:
    """Choices of a long chain, ``c ? u : (d ? v : ...)``: each but the last has a line: a loop."""
    depth, found = [0] * len(nodes), set[int]()
    for k, node in enumerate(nodes):
        if node.op == _SELECT:
            depth[k] = 1 + depth[node.args[2]]
    for k in range(len(nodes) - 1, -1, -1):
        if depth[k] >= CHAIN or k in found:
            before = nodes[k].args[2]
            found |= {before} if depth[before] else set()
    return found


def _negates(node: Node, of: int) -> bool:
    return node.op == ca.OP_NOT and node.args == (of,)


class Writer:
    """Statements of one Function; ``run`` writes them.

    Args:
        f: an SX Function.
        read_input: C expression of (argument, element); asked when a value is first needed, so
            that it may put statements before.
        names: names for the values of results, by (output, element); other values that need a
            line are called a1, a2, ...
        count: numbers of those names, shared by the writers of one C function.
        real: C type of a number.
        can_be: what (argument, element) can be; anything by default.
        shown: results from this one on only have names; nothing is written for them alone.
        modest: what is used once gets no line for its name's sake.
        known: the last results, so many, are read as further arguments instead of worked out.

    Attributes:
        lines: statements, each a constant.
    """

    def __init__(
        self,
        f: ca.Function,
        read_input: Callable[[int, int], C],
        names: Mapping[tuple[int, int], str] | None = None,
        count: Iterator[int] | None = None,
        real: str = "double",
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
        shown: int | None = None,
        modest: bool = False,
        known: int = 0,
    ) -> None:
        nodes, self.results = self._read(f)
        begin = f.n_out() - known
        for (i, k), node in self.results:
            if i >= begin and nodes[node].op not in (ca.OP_CONST, ca.OP_INPUT):
                nodes[node] = Node(ca.OP_INPUT, place=(f.n_in() + i - begin, k))
        self.nodes, self.tables = ramp_tables.replace_ramps(nodes)
        self.pieces: dict[int, tuple[C, C]] = {}  # table -> row of C, ramp
        self.read_input, self.real = read_input, real
        self.lines: list[C] = []
        self.values: dict[int, Value] = {}
        self.count = itertools.count(1) if count is None else count
        self.names: dict[int, str] = {}
        for place, node in self.results:
            if names and place in names and self.nodes[node].op not in (ca.OP_CONST, ca.OP_INPUT):
                self.names.setdefault(node, names[place])
        if shown is not None:
            self.results = [(place, node) for place, node in self.results if place[0] < shown]
        self.uses = self._uses()
        once = {node for node in self.names if self.uses[node] == 1}
        plain = once & {node for _, node in self.results} if shown is not None else set()
        self.offered = {k: self.names[k] for k in once - plain if modest}
        for k in (*plain, *self.offered):
            del self.names[k]
        self.signed = self._signed()
        self.chosen = chains(self.nodes)
        self.can_be = self._can_be(can_be)
        self.totals = self._totals()
        self.within = {a for t in self.totals.values() for a in t.partial}

    def _read(self, f: ca.Function) -> tuple[list[Node], list[tuple[tuple[int, int], int]]]:
        return read(f)

    def _totals(self) -> dict[int, Total]:
        """Sums of terms that are alike, by the node of the last addition."""
        return totals(self.nodes, self.uses, {**self.offered, **self.names})

    def run(self) -> Self:
        """Write the statements."""
        for k in range(len(self.nodes)):
            if self.uses[k] and k not in self.within:
                self._write(k)
        return self

    def result(self, node: int) -> C:
        """C expression of the value of a result."""
        return self._real(self.values[node])

    def atom(self, node: int) -> C:
        """Name, member or number of a value; a longer expression gets a line first."""
        if not self.values[node].plain:
            self._line(node)
        return self._real(self.values[node])

    def condition(self, node: int) -> C:
        """C condition: the whole part of the value is not zero, as CasADi decides."""
        v = self.values[node]
        whole = C("cast", "int", (c.paren(v.c),))
        return v.c if v.truth else c.op(whole, "!=", c.ZERO)

    def _uses(self) -> list[int]:
        uses = [0] * len(self.nodes)
        for _, node in self.results:
            uses[node] += 1
        for k in range(len(self.nodes) - 1, -1, -1):
            if uses[k]:
                for a in self.nodes[k].args:
                    uses[a] += 1
        return uses

    def _signed(self) -> list[bool]:
        """Values whose sign matters even when they are zero: what atan2 takes, what divides."""
        signed = [False] * len(self.nodes)
        for k in range(len(self.nodes) - 1, -1, -1):
            node = self.nodes[k]
            if node.op in _TAKES_SIGN:
                for i in _TAKES_SIGN[node.op]:
                    signed[node.args[i]] = True
            if signed[k] and node.op not in _FORGETS_SIGN and node.op != _SLOPE:
                for a in node.args[1:] if node.op == _SELECT else node.args:
                    signed[a] = True
        return signed

    def _can_be(self, argument: Callable[[int, int], int]) -> list[int]:
        """What each value can be, whatever the arguments are."""
        found: list[int] = []
        for node in self.nodes:
            if node.op == ca.OP_CONST:
                v = node.value
                found.append(ANY if math.isnan(v) else NUMBER if math.isinf(v) else FINITE)
            elif node.op == ca.OP_INPUT:
                found.append(argument(*node.place))
            elif node.op == _SELECT:
                found.append(min(found[a] for a in node.args[1:]))
            else:
                rule = _CAN_BE.get(node.op, lambda *a: ANY)
                found.append(rule(*(found[a] for a in node.args)))
        return found

    def _write(self, k: int) -> None:
        node = self.nodes[k]
        if node.op == ca.OP_CONST:
            plain = constant(node.value)
            self.values[k] = Value(plain, _UNARY if plain.text.startswith("-") else ATOM)
            return
        if node.op == ca.OP_INPUT:
            self.values[k] = Value(self.read_input(*node.place), ATOM)
            return
        if node.op == ramp_tables.PIECES:
            self._row(node)
        if k in self.totals:
            self._total(k, self.totals[k])
            return
        made = self._compose(node, self.signed[k])
        while len(made.c.text) > WIDTH:
            long = max(node.args, key=lambda a: len(self.values[a].c.text))
            if self.values[long].plain:
                break
            self._line(long)
            made = self._compose(node, self.signed[k])
        self.values[k] = made
        named = k in self.names or (k in self.offered and len(made.c.text) > LONG)
        if named or self.uses[k] > 1 or k in self.chosen:
            self._line(k)

    def _own_name(self, k: int) -> str:
        """Name of a value: its own, or a new one."""
        return self.names.get(k) or self.offered.get(k) or f"a{next(self.count)}"

    def _total(self, k: int, total: Total) -> None:
        """Statements that add the terms of a sum one by one, in its order: a loop, rolled up."""
        first, *others = [self._operand(a, _SUM) for a in total.terms]
        to = self._own_name(k)
        self.lines.append(c.declare(self.real, to, first))
        self.lines += [c.assign(c.name(to), v, "+=") for v in others]
        self.values[k] = Value(c.name(to), ATOM)

    def _row(self, node: Node) -> None:
        """Statements that find the piece of a table, once."""
        number_of = node.place[0]
        if number_of in self.pieces:
            return
        x, name = self.atom(node.args[0]), f"t{next(self.count)}"
        table, at, ramp = self.tables[number_of], c.name(f"k{name[1:]}"), f"a{next(self.count)}"
        begin, long = c.name(f"{name}_at"), c.name(f"{name}_long")
        found = c.call("reached", [begin, c.integer(len(table.ramps)), x])
        risen = c.call("at_least", [c.op(x, "-", c.index(begin, at)), constant(0.0)])
        self.lines += [
            c.remark(f"straight pieces over {x}: begin, length, height and slope of each result"),
            *table.declared(name, constant),
            c.declare("const int", at, found),
            c.declare(f"const {self.real}", ramp, c.call("at_most", [risen, c.index(long, at)])),
        ]
        self.pieces[number_of] = c.index(c.name(name), at), c.name(ramp)

    def _line(self, k: int) -> None:
        """Give a value a line and a name of its own."""
        made, to = self.values[k], self._own_name(k)
        kind = f"const {'bool' if made.truth else self.real}"
        self.lines.append(c.declare(kind, to, made.c))
        self.values[k] = Value(c.name(to), ATOM, made.truth)

    def _real(self, v: Value) -> C:
        if not v.truth:
            return v.c
        asked = v.c if v.rank == ATOM else c.paren(v.c)
        return c.paren(C("choice", "", (asked, constant(1.0), constant(0.0))))

    def _operand(self, k: int, rank: int) -> C:
        """A real value that binds at least as strongly as ``rank``."""
        v = self.values[k]
        return self._real(v) if v.truth or v.rank >= rank else c.paren(v.c)

    def _condition(self, k: int, rank: int) -> C:
        v = self.values[k]
        if not v.truth:
            v = Value(c.op(self._operand(k, _RELATION), "!=", constant(0.0)), _EQUAL)
        return v.c if v.rank >= rank else c.paren(v.c)

    def _compose(self, node: Node, signed: bool) -> Value:
        op, a = node.op, node.args
        if op in _BINARY:
            sign, rank = _BINARY[op]
            right = self._operand(a[1], rank + 1)
            if right.text.startswith("-"):
                right = c.paren(right)
            return Value(c.op(self._operand(a[0], rank), sign, right), rank)
        if op in _COMPARE:
            sign, rank = _COMPARE[op]
            left, right = (self._operand(k, _SUM) for k in a)
            return Value(c.op(left, sign, right), rank, True)
        if op == ramp_tables.PIECES:
            (row, ramp), k = self.pieces[node.place[0]], 2 * node.place[1]
            risen = c.op(c.index(row, k + 1), "*", ramp)
            return Value(c.op(c.index(row, k), "+", risen), _SUM)
        if op == ca.OP_NEG:
            return Value(C("unary", "-", (self._operand(a[0], ATOM),)), _UNARY)
        if op == ca.OP_INV:
            return Value(c.op(constant(1.0), "/", self._operand(a[0], _UNARY)), _PRODUCT)
        if op == ca.OP_TWICE:
            return Value(c.op(constant(2.0), "*", self._operand(a[0], _UNARY)), _PRODUCT)
        if op == _SLOPE:
            given = [self._real(self.values[k]) for k in a]
            return Value(c.call("slope_of_lesser", given), ATOM)
        if op == ca.OP_NOT:
            return self._not(a[0])
        if op in (ca.OP_AND, ca.OP_OR):
            sign = "&&" if op == ca.OP_AND else "||"
            left, right = (self._condition(k, ATOM) for k in a)
            return Value(c.op(left, sign, right), _AND if op == ca.OP_AND else _OR, True)
        if op == ca.OP_IF_ELSE_ZERO:
            return self._select(a[0], self._operand(a[1], _OR), constant(0.0))
        if op == _SELECT:
            made = self._select(a[0], self._operand(a[1], _OR), self._operand(a[2], _OR))
            # CasADi adds 0 to the value chosen, which makes -0 a +0
            return Value(c.op(c.paren(made.c), "+", constant(0.0)), _SUM) if signed else made
        return self._call(op, a)

    def _not(self, k: int) -> Value:
        v = self.values[k]
        if v.truth:
            return Value(C("unary", "!", (self._condition(k, ATOM),)), _UNARY, True)
        return Value(c.op(self._operand(k, _RELATION), "==", constant(0.0)), _EQUAL, True)

    def _select(self, condition: int, yes: C, no: C) -> Value:
        return Value(C("choice", "", (self._condition(condition, ATOM), yes, no)), _CHOICE)

    def _call(self, op: int, a: tuple[int, ...]) -> Value:
        if op == ca.OP_SQ and self.values[a[0]].plain and not self.values[a[0]].truth:
            x = self.values[a[0]].c
            return Value(c.op(x, "*", x), _PRODUCT)
        name = _CALLS[op]
        if op in _BOUNDS and self.can_be[a[0]]:
            name, a = _BOUNDS[op][0], (a[1], a[0])
        elif op in _BOUNDS and self.can_be[a[1]]:
            name = _BOUNDS[op][1]
        return Value(c.call(name, [self._real(self.values[k]) for k in a]), ATOM)
