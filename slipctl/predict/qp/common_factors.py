"""Scalar functions with fewer operations: factors gathered, and what is always the same done once.

Derivatives divide by the same number over and over, and carry the same products of parameters
along every path. Here each value is c m: c a product of numbers and of what the fixed inputs give,
m the rest. Products gather their c, sums of equal c keep it outside, a/b becomes a (1/b). Equal m
are computed once, and every c once and for all, in a function of the fixed inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from slipctl.block.text.intermediates import as_it_is, named_inside, with_names

ONE: tuple[int, ...] = ()
"""Product of nothing."""


class Value(NamedTuple):
    """number * product of fixed nodes * core; a fixed value has no core."""

    number: float
    product: tuple[int, ...]
    core: int | None


def split_by_inputs(f: ca.Function, fixed: Sequence[int]) -> tuple[ca.Function, ca.Function]:
    """Split a function of scalars by inputs that are the same in many calls.

    Args:
        f: the function.
        fixed: its inputs that stay the same.

    Returns:
        Function of the fixed inputs -> column; and the same function as f, with the column in
        place of the fixed inputs, as its last input. Sums and products are those of f up to
        rounding.
    """
    known = [ca.SX.sym(f.name_in(i), f.sparsity_in(i)) for i in fixed]
    free = [i for i in range(f.n_in()) if i not in fixed]
    if any(f.instruction_id(k) == ca.OP_CALL for k in range(f.n_instructions())):
        whole = ca.vertcat(*[ca.vec(ca.densify(c)) for c in known])
        once = ca.Function(f"{f.name()}_once", known, [whole])
        column = ca.MX.sym("fixed", whole.numel())
        symbols = {i: ca.MX.sym(f.name_in(i), f.sparsity_in(i)) for i in free}
        at = 0
        for i, c in zip(fixed, known, strict=True):
            symbols[i] = ca.reshape(column[at : at + c.numel()], *c.shape)
            at += c.numel()
        given = [symbols[i] for i in range(f.n_in())]
        results = f.call(given, True, False)
        return once, ca.Function(f.name(), [*(symbols[i] for i in free), column], results)
    with as_it_is():
        return _Graph(f, tuple(fixed)).functions(known, free)


class _Graph:
    """The operations of a function as nodes, equal ones once."""

    def __init__(self, f: ca.Function, fixed: tuple[int, ...]) -> None:
        self.f, self.fixed_inputs = f, fixed
        self.nodes: list[tuple[Any, ...]] = []
        self.fixed: list[bool] = []
        self.numbers: dict[tuple[Any, ...], int] = {}
        self.results = self._read_all(f)
        self.names: dict[int, str] = {}
        if (inside := named_inside(f)) is not None:
            values = [rows[0] for rows in self._read_all(inside)]
            for name, v in zip(inside.name_out(), values, strict=True):
                alone = v.core is None or (v.number == 1 and not v.product)
                core = self._fixed_part(v.number, v.product) if v.core is None else v.core
                self.names.setdefault(core, name if alone else f"{name}_rest")

    def _read_all(self, f: ca.Function) -> list[list[Value]]:
        """Values of the results of a function, of the same inputs."""
        fixed = self.fixed_inputs
        results = [[Value(0.0, ONE, None)] * f.nnz_out(i) for i in range(f.n_out())]
        work: dict[int, Value] = {}
        for k in range(f.n_instructions()):
            operation, into = f.instruction_id(k), f.instruction_output(k)
            read = f.instruction_input(k)
            if operation == ca.OP_OUTPUT:
                results[into[0]][into[1]] = work[read[0]]
            elif operation == ca.OP_INPUT:
                still = read[0] in fixed
                work[into[0]] = self._of(self._node(("input", *read), still))
            elif operation == ca.OP_CONST:
                work[into[0]] = Value(float(f.instruction_constant(k)), ONE, None)
            else:
                work[into[0]] = self._value(operation, [work[i] for i in read])
        return results

    def _node(self, key: tuple[Any, ...], fixed: bool) -> int:
        if key[0] in (ca.OP_ADD, ca.OP_MUL):
            key = (key[0], *sorted(key[1:]))
        if key not in self.numbers:
            self.numbers[key] = len(self.nodes)
            self.nodes.append(key)
            self.fixed.append(fixed)
        return self.numbers[key]

    def _of(self, node: int) -> Value:
        return Value(1.0, (node,), None) if self.fixed[node] else Value(1.0, ONE, node)

    def _operation(self, operation: int, *read: int) -> int:
        return self._node((operation, *read), all(self.fixed[i] for i in read))

    def _fixed_part(self, number: float, product: tuple[int, ...]) -> int:
        """Node of number * product, taken from left to right."""
        node = self._node(("number", number), True) if number != 1 or not product else None
        for i in product:
            node = i if node is None else self._node(("times", node, i), True)
        assert node is not None
        return node

    def node(self, v: Value) -> int:
        """Node of a value."""
        if v.core is None:
            return self._fixed_part(v.number, v.product)
        if not v.product and v.number == 1:
            return v.core
        if not v.product and v.number == -1:
            return self._operation(ca.OP_NEG, v.core)
        return self._operation(ca.OP_MUL, self._fixed_part(v.number, v.product), v.core)

    def _value(self, operation: int, read: list[Value]) -> Value:
        a, b = read[0], read[-1]
        if operation == ca.OP_NEG:
            return a._replace(number=-a.number)
        if operation == ca.OP_TWICE:
            return a._replace(number=2 * a.number)
        if operation in (ca.OP_MUL, ca.OP_SQ):
            return self._times(a, b)
        if operation == ca.OP_INV:
            return self._inverse(a)
        if operation == ca.OP_DIV:
            return self._times(a, self._inverse(b))
        if operation in (ca.OP_ADD, ca.OP_SUB):
            return self._sum(a, b._replace(number=-b.number) if operation == ca.OP_SUB else b)
        return self._of(self._operation(operation, *map(self.node, read)))

    def _times(self, a: Value, b: Value) -> Value:
        core = a.core if b.core is None else b.core
        if a.core is not None and b.core is not None:
            core = self._operation(ca.OP_MUL, a.core, b.core)
        return Value(a.number * b.number, tuple(sorted(a.product + b.product)), core)

    def _inverse(self, a: Value) -> Value:
        if a.number == 0:
            return self._of(self._operation(ca.OP_INV, self.node(a)))
        core = None if a.core is None else self._operation(ca.OP_INV, a.core)
        product = tuple(sorted(self._operation(ca.OP_INV, i) for i in a.product))
        return Value(1 / a.number, product, core)

    def _sum(self, a: Value, b: Value) -> Value:
        alike = a.product == b.product and a.core is not None and b.core is not None
        if alike and a.number and abs(b.number / a.number) in (0.5, 2.0):
            larger, less = (a, b) if abs(a.number) > abs(b.number) else (b, a)
            assert larger.core is not None
            twice = self._operation(ca.OP_TWICE, larger.core)
            larger = larger._replace(number=larger.number / 2, core=twice)
            a, b = less, larger
        if alike and abs(a.number) == abs(b.number):
            assert a.core is not None
            assert b.core is not None
            if a.number == b.number:
                return a._replace(core=self._operation(ca.OP_ADD, a.core, b.core))
            return a._replace(core=self._operation(ca.OP_SUB, a.core, b.core))
        if a.core is None and b.core is None and not a.product and not b.product:
            return Value(a.number + b.number, ONE, None)
        if a.number < 0 <= b.number:
            a, b = b, a
        if b.number < 0:
            second = self.node(b._replace(number=-b.number))
            if a.number < 0:
                both = self._operation(ca.OP_ADD, self.node(a._replace(number=-a.number)), second)
                return self._of(both)._replace(number=-1.0)
            return self._of(self._operation(ca.OP_SUB, self.node(a), second))
        return self._of(self._operation(ca.OP_ADD, self.node(a), self.node(b)))

    # ---- back to functions ----------------------------------------------------------------------

    def functions(self, known: list[Any], free: list[int]) -> tuple[ca.Function, ca.Function]:
        """The two functions; ``known``: symbols of the fixed inputs, ``free``: the other inputs."""
        outputs = [[self.node(v) for v in rows] for rows in self.results]
        wanted = [False] * len(self.nodes)
        for i in (n for rows in outputs for n in rows):
            wanted[i] = True
        shared = []
        for k in reversed(range(len(self.nodes))):
            if wanted[k] and not self.fixed[k]:
                for i in self._read(k):
                    wanted[i] = True
            elif wanted[k] and self.nodes[k][0] != "number":
                shared.append(k)
        shared.reverse()
        first = dict(zip(self.fixed_inputs, known, strict=True))
        column = ca.SX.sym("fixed", len(shared))
        still = self._expressions(shared, first, {})
        one_by_one = ca.vertcat(*[still[k] for k in shared]) if shared else ca.SX(0, 1)
        names = [self.f.name_in(i) for i in self.fixed_inputs]
        once = ca.Function(
            f"{self.f.name()}_once", known, [one_by_one], names, ["fixed"], {"cse": True}
        )  # fmt: skip
        once = with_names(once, once.call(known), self._named(still))
        symbols = {i: ca.SX.sym(self.f.name_in(i), self.f.sparsity_in(i)) for i in free}
        done = {k: column[i] for i, k in enumerate(shared)}
        flat = [k for rows in outputs for k in rows]
        found = self._expressions(flat, symbols, done)
        results = [
            ca.SX(self.f.sparsity_out(i), ca.vertcat(*[found[k] for k in rows]))
            for i, rows in enumerate(outputs)
        ]
        given = [*(symbols[i] for i in free), column]
        names = [*(self.f.name_in(i) for i in free), "fixed"]
        rest = ca.Function(self.f.name(), given, results, names, self.f.name_out())
        return once, with_names(rest, results, self._named(found, fixed=False))

    def _named(self, found: dict[int, Any], fixed: bool = True) -> list[tuple[str, Any]]:
        """Names of expressions that are worked out, by the names of their nodes."""
        return [
            (self.names[k], v) for k, v in found.items()
            if k in self.names and self.fixed[k] == fixed and self.nodes[k][0] != "input"
        ]  # fmt: skip

    def _read(self, k: int) -> tuple[int, ...]:
        return () if self.nodes[k][0] in ("input", "number") else self.nodes[k][1:]

    def _expressions(
        self, wanted: list[int], inputs: dict[int, Any], done: dict[int, Any]
    ) -> dict[int, Any]:
        """Expression of each wanted node and of what it reads."""
        needed = [False] * len(self.nodes)
        for k in wanted:
            needed[k] = True
        for k in reversed(range(len(self.nodes))):
            if needed[k] and k not in done:
                for i in self._read(k):
                    needed[i] = True
        found = dict(done)
        for k, node in enumerate(self.nodes):
            operation, *read = node
            if not needed[k] or k in found:
                continue
            if operation == "input":
                found[k] = inputs[read[0]].nonzeros()[read[1]]
            elif operation == "number":
                found[k] = ca.SX(read[0])
            elif operation == "times":
                found[k] = ca.SX.binary(ca.OP_MUL, found[read[0]], found[read[1]])
            elif len(read) == 2:
                found[k] = ca.SX.binary(operation, found[read[0]], found[read[1]])
            else:
                found[k] = ca.SX.unary(operation, found[read[0]])
        return found
