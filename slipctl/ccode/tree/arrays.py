"""An MX Function as statements of C: vectors are arrays, what is done to each element is a loop.

Operation for operation as CasADi evaluates it, so that C gives the bits of Python. A vector that
is used once is written where it is used, with the index of the loop around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import casadi as ca

from slipctl.ccode.passes.sums import Total
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import ANY, ATOM, Node, Unsupported, Value, Writer, constant
from slipctl.ccode.tree.graph import (
    CALLED,
    CHOSEN,
    DOT,
    JOINED,
    LARGEST,
    NORMS,
    PRODUCT,
    SLICE,
    SMALLEST,
    SPARSE_PRODUCT,
    SPREAD,
    SUM_OF,
    TURNED,
    Step,
    argument_names,
    free_name,
    result_name,
    steps,
)
from slipctl.ccode.tree.nodes import Node as C
from slipctl.ccode.tree.parser import expression
from slipctl.ccode.tree.scans import single_columns
from slipctl.ccode.tree.vectors import (
    AT,
    address,
    array_and_offset,
    array_of,
    by_blocks,
    element,
    is_place,
    loop,
    place,
)


class Arrays(Writer):
    """Statements of an MX Function; ``run`` writes them.

    Args:
        f: the Function.
        sources: by argument: the scalar, or the vector in the array that holds it.
        call: writes the call of a Function: (lines, function, arguments, results), None for what
            has no numbers.
        names: names of results.
        targets: by result, the array in which it is wanted.
        count: numbers of names, shared in one C function.
        can_be: what a scalar argument can be.
        hidden: results from this one on only have names.
        taken: names that no local may have.
    """

    def __init__(
        self,
        f: ca.Function,
        sources: Sequence[C],
        call: Callable[[Arrays, ca.Function, Sequence[C | None], Sequence[C | None]], None],
        names: Mapping[int, str] | None = None,
        targets: Mapping[int, C] | None = None,
        count: Iterator[int] | None = None,
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
        hidden: int | None = None,
        taken: Iterable[str] = (),
    ) -> None:
        self.call, self.sources = call, sources
        self.outputs: list[int] = []  # node of each result
        self.asked = c.ZERO  # condition that the first argument of a call is
        self.done: set[int] = set()
        self.targets: dict[int, C] = {}
        self.suggested: dict[int, str] = {}
        self.taken = {*taken, *(names or {}).values()}
        super().__init__(f, self._source, None, count, can_be=can_be)
        shown = len(self.outputs) if hidden is None else hidden
        self.results = [((i, 0), n) for i, n in enumerate(self.outputs[:shown]) if n >= 0]
        for i, n in enumerate(self.outputs):
            if n < 0 or self.nodes[n].op in (ca.OP_CONST, ca.OP_INPUT):
                continue
            if names and i in names and i >= shown:
                self.names.setdefault(n, names[i])
            if targets and i in targets and self._size(n) > 1:
                self.targets.setdefault(n, targets[i])
        for i, n in enumerate(self.outputs[:shown]):
            named = names is not None and i in names and n >= 0 and self._size(n) == 1
            if named and self.nodes[n].op not in (ca.OP_CONST, ca.OP_INPUT):
                self.names.setdefault(n, (names or {})[i])
        self.suggested |= self.said
        for node in self.nodes:
            if node.op == CALLED and isinstance(node, Step):
                for a, name in zip(node.args, argument_names(node.detail[0]), strict=True):
                    self.suggested.setdefault(a, name)
        self.uses = self._uses()
        self.signed = self._signed()
        self.chosen: set[int] = set()
        self.places: dict[int, tuple[C, int]] = {}  # that a search has found; the last one
        self.can_be = self._can_be(can_be)

    def _read(self, f: ca.Function) -> tuple[list[Node], list[tuple[tuple[int, int], int]]]:
        self.said: dict[int, str] = {}
        nodes, self.outputs = steps(f, self.said)
        return single_columns(nodes), []

    def _totals(self) -> dict[int, Total]:
        return {}

    # ---- writing --------------------------------------------------------------------------------

    def _size(self, k: int) -> int:
        return int(getattr(self.nodes[k], "size", 1))

    def _source(self, i: int, k: int) -> C:
        return self.sources[i]

    def at(self, node: int, k: int) -> C:
        """An element of a value."""
        return element(self._real(self.values[node]), k)

    def _write(self, k: int) -> None:
        node = self.nodes[k]
        assert isinstance(node, Step)
        if k in self.values or not node.size or self._place(k, node):
            return
        op = node.op
        if op == ca.OP_INPUT:
            self.values[k] = self._input(node)
        elif op == ca.OP_CONST and node.size > 1:
            self.values[k] = self._constant(node)
        elif op == CALLED:
            self._called(k, node)
        elif op == SLICE:
            self._slice(k, node)
        elif op == SPREAD:
            self._spread(k, node)
        elif op == TURNED:
            rows, columns = (c.integer(n) for n in node.detail)
            inside = c.op(c.paren(c.op(AT, "%", columns)), "*", rows)
            self._taken(k, node.args[0], c.op(inside, "+", c.op(AT, "/", columns)))
        elif op in _BUILT:
            _BUILT[op](self, k, node)
        elif op == ca.OP_GETNONZEROS_PARAM:
            self._element(k, node)
        elif node.size == 1:
            super()._write(k)
            return
        else:
            made = self.values[k] = self._compose(node, self.signed[k])
            if self.uses[k] > 1 or k in self.names or len(made.c.text) > 150:
                self._line(k)
        wanted = k in self.names and node.size == 1
        given = op in (ca.OP_INPUT, ca.OP_CONST, CALLED)
        if wanted and not given and self.values[k].c != c.name(self.names[k]):
            self._line(k)

    def _taken(self, k: int, source: int, at: C) -> None:
        """Elements of a vector by an index, which is put behind where the vector begins."""
        base, offset = self._stored(source)
        begins = c.op(c.integer(offset), "+", at)
        if offset and at.head == "+":  # from left to right
            begins = c.op(c.op(c.integer(offset), "+", at.parts[0]), "+", at.parts[1])
        self.values[k] = Value(c.index(base, begins if offset else at), ATOM)

    def _element(self, k: int, node: Step) -> None:
        """Element of an array by a number; by a place that was searched for it lies inside."""
        base, offset = self._stored(node.args[0])
        place, last = self.places.get(node.args[1], (c.ZERO, node.detail))
        if last < node.detail:
            inside = c.op(place, "+", c.integer(offset)) if offset else place
            self.values[k] = Value(c.index(base, inside), ATOM)
            if self.uses[k] > 1:
                self._line(k)
            return
        given = [address(base, offset), c.integer(node.detail), self._real_of(node.args[1])]
        made = c.call("element", given)
        self.values[k] = Value(made, ATOM)
        if node.size == 1 or self.uses[k] > 1 or len(made.text) > 60:
            self._line(k)

    def _place(self, k: int, node: Step) -> bool:
        """Whether it is the place that a search finds, or the next one: a whole number."""
        if node.op == ca.OP_LOW:
            base, offset = self._stored(node.args[0])
            name = self.names.get(k) or f"k{next(self.count)}"
            given = [address(base, offset), c.integer(node.detail), self._real_of(node.args[1])]
            self.lines.append(c.declare("const int", name, c.call("reached", given)))
            self.places[k] = c.name(name), int(node.detail) - 1
        elif node.op == ca.OP_ADD and (first := [a for a in node.args if a in self.places]):
            by = next((a for a in node.args if a not in first), first[0])
            if self.nodes[by].op != ca.OP_CONST or self.nodes[by].value != 1:
                return False
            place, last = self.places[first[0]]
            self.places[k] = c.op(place, "+", c.integer(1)), last + 1
        else:
            return False
        self.values[k] = Value(C("cast", "double", (c.paren(self.places[k][0]),)), ATOM)
        return True

    def _real_of(self, k: int) -> C:
        return self._real(self.values[k])

    def _compose(self, node: Node, signed: bool) -> Value:
        """An operation; a truth that is above 0 is that truth."""
        if node.op == ca.OP_LT and self.values[node.args[1]].truth:
            zero = self.nodes[node.args[0]]
            if zero.op == ca.OP_CONST and zero.value == 0.0 and self._size(node.args[0]) == 1:
                return self.values[node.args[1]]
        return super()._compose(node, signed)

    def _input(self, node: Step) -> Value:
        source = self.sources[node.place[0]]
        if (array := array_and_offset(source)) is None:
            return Value(source, ATOM)
        base, offset = array[0], int(node.detail)
        return Value(place(base, offset) if node.size > 1 else c.index(base, offset), ATOM)

    def _constant(self, node: Step) -> Value:
        values = node.detail
        if all(v == values[0] for v in values):
            made = constant(values[0])
            return Value(c.paren(made) if made.text.startswith("-") else made, ATOM)
        if values == [values[0] + k for k in range(len(values))] and abs(values[0]) < 2**24:
            counted = C("cast", "double", (AT,))
            begun = c.paren(c.op(counted, "+", constant(values[0])))
            return Value(begun if values[0] else counted, ATOM)
        name = f"k{next(self.count)}"
        self.lines.append(array_of("static const double", name, map(constant, values)))
        return Value(c.index(c.name(name), AT), ATOM)

    def _stored(self, k: int) -> tuple[C, int]:
        """Array and offset of a vector; it gets an array if it has none."""
        v = self.values[k]
        if not v.truth:
            found = array_and_offset(v.c)
            if found is not None:
                return found
            single = self._size(k) == 1 and v.c.kind == "index" and is_place(v.c.parts[0])
            if single and v.c.parts[1].kind == "number":
                return v.c.parts[0], int(v.c.parts[1].head)
        self._array(k)
        found = array_and_offset(self.values[k].c)
        assert found is not None
        return found

    def _address(self, k: int) -> C:
        return address(*self._stored(k))

    def _array(self, k: int) -> None:
        """Put the elements of a vector into an array of its own."""
        to, size = place(self._target(k), 0), self._size(k)
        self.lines += loop(size, c.assign(to, self._real_of(k)))
        self.values[k] = Value(to, ATOM)

    def _target(self, k: int) -> C:
        """Array for a value: where it is wanted, or a new one."""
        if k in self.targets and k not in self.done:
            self.done.add(k)
            return self.targets[k]
        name = c.name(self._name(k))
        self.lines.append(c.declare(self.real, c.index(name, self._size(k))))
        return name

    def _line(self, k: int) -> None:
        if self._size(k) > 1:
            self._array(k)
        else:
            if k not in self.names and self.suggested.get(k):
                self.names[k] = self._name(k)
            super()._line(k)

    def _slice(self, k: int, node: Step) -> None:
        (source,) = node.args
        offset, stride = node.detail
        v = self.values[source]
        if node.size == self._size(source) and stride == 1:
            self.values[k] = v
            return
        if AT.head not in v.c.words and self._size(source) > 1:  # the same number everywhere
            self.values[k] = v
            return
        turned = any(n.kind == "op" and n.head in "%/" for n in v.c.walk())
        if turned or (array_and_offset(v.c) is None and node.size > 1):
            self._stored(source)
            v = self.values[source]
        if node.size == 1:
            self.values[k] = Value(element(v.c, offset), v.rank, v.truth)
            return
        base, first = self._stored(source)
        self.values[k] = Value(place(base, first + offset, stride), ATOM)

    def _same(self, k: int, source: int) -> None:
        """One number that stands for each element."""
        if self.values[source].rank != ATOM:
            self._line(source)
        self.values[k] = self.values[source]

    def _spread(self, k: int, node: Step) -> None:
        (source,) = node.args
        if node.detail == 1:
            self._same(k, source)
        else:
            self._taken(k, source, c.op(AT, "%", c.integer(node.detail)))

    # ---- what takes several statements, into a variable or an array of its own ------------------

    def _product(self, k: int, node: Step) -> None:
        z, x, y = node.args
        rows, inner, columns = node.detail
        if rows * inner * columns == 1:
            product = c.op(self._factor(x), "*", self._factor(y))
            self.values[k] = Value(c.op(self.at(z, 0), "+", product), 6)
            if self.uses[k] > 1 or k in self.names:
                self._line(k)
            return
        bases = [self._address(v) for v in (x, y)]
        name, begun = self._begun(k, node, self._real_of(z).text != "0.0")
        called = "add_matrix_product" if begun else "matrix_product"
        sizes = [c.integer(n) for n in (rows, inner, columns)]
        given = [bases[0], *sizes[:2], bases[1], sizes[2], name]
        self.lines.append(c.do(c.call(called, given)))

    def _begun(self, k: int, node: Step, begun: bool) -> tuple[C, bool]:
        """Where a product goes, which has what it is added to, and its address."""
        (z, *_), at = node.args, c.name
        if node.size > 1:
            name = self._target(k)
            if begun:
                self.lines += loop(node.size, c.assign(place(name, 0), self._real_of(z)))
            self.values[k] = Value(place(name, 0), ATOM)
            return name, begun
        name = at(self._name(k))
        self.lines.append(c.declare("double", name, self.at(z, 0) if begun else None))
        self.values[k] = Value(name, ATOM)
        return c.address(name), begun

    def _sparse_product(self, k: int, node: Step) -> None:
        _, x, y = node.args
        values, given = (self._address(v) for v in (x, y))
        table, places = f"k{next(self.count)}", []
        for name, numbers in zip((f"{table}_begin", f"{table}_row"), node.detail, strict=True):
            self.lines.append(array_of("static const int", name, map(c.integer, numbers)))
            places.append(c.name(name))
        to, _ = self._begun(k, node, True)
        columns = c.integer(len(node.detail[0]) - 1)
        self.lines.append(c.do(c.call("add_sparse_product", [values, *places, columns, given, to])))

    def _chosen(self, k: int, node: Step) -> None:
        (source,) = node.args
        if self._size(source) == 1 and set(node.detail) == {0}:
            self._same(k, source)
            return
        if max(node.detail) < 0:  # nothing of it, which may have no numbers
            self.values[k] = Value(constant(0.0), ATOM)
            return
        base, offset = self._stored(source)
        if node.size == 1:
            self.values[k] = Value(c.index(base, offset + node.detail[0]), ATOM)
            return
        if (at := by_blocks(node.detail, offset)) is not None:
            self.values[k] = Value(c.index(base, at), ATOM)
            if self.uses[k] > 1 or k in self.targets:
                self._array(k)
            return
        self._elements(
            k, [c.index(base, offset + j) if j >= 0 else constant(0.0) for j in node.detail]
        )

    def _joined(self, k: int, node: Step) -> None:
        parts = [(self._size(a), self._real_of(a)) for a in node.args if self._size(a)]
        if len(parts) == 1:
            self.values[k] = self.values[next(a for a in node.args if self._size(a))]
            return
        if all(n == 1 for n, _ in parts):
            self._elements(k, [element(v, 0) for _, v in parts])
            return
        name, offset = self._target(k), 0
        for n, v in parts:
            if n == 1:
                self.lines.append(c.assign(c.index(name, offset), element(v, 0)))
            else:
                self.lines += loop(n, c.assign(place(name, offset), v))
            offset += n
        self.values[k] = Value(place(name, 0), ATOM)

    def _elements(self, k: int, values: Sequence[C]) -> None:
        """Give an array its elements one by one, with its declaration if that is the last line."""
        name = self._target(k)
        self.values[k] = Value(place(name, 0), ATOM)
        if self.lines[-1:] == [c.declare(self.real, c.index(name, len(values)))]:
            self.lines[-1:] = [array_of(f"const {self.real}", name, values)]
        else:
            self.lines += [c.assign(c.index(name, i), v) for i, v in enumerate(values)]

    def _factor(self, k: int) -> C:
        v = self.values[k]
        made = element(self._real(v), 0)
        return made if v.truth or v.rank >= 7 else c.paren(made)

    def _name(self, k: int) -> str:
        """Name for a value: its own, that of what gives it or takes it, or a new one."""
        if k in self.names:
            return self.names.pop(k)
        node = self.nodes[k]
        said = self.suggested.get(k, "")
        if node.op == CALLED and isinstance(node, Step) and k not in self.said:
            said = result_name(node.detail[0], node.place[1]) or said
        if not said:
            return f"a{next(self.count)}"
        name = free_name(said, self.taken)
        self.taken.add(name)
        return name

    def _folded(self, k: int, node: Step) -> None:
        """A sum, a largest or a smallest element."""
        values = [self._real_of(a) for a in node.args]
        if node.op == SUM_OF and node.size > 1:
            name = self._target(k)
            self.lines += loop(node.size, c.assign(place(name, 0), constant(0.0)))
            to = c.index(name, c.op(AT, "%", c.integer(node.size)))
            self.lines += loop(node.detail, c.assign(to, values[0], "+="))
            self.values[k] = Value(place(name, 0), ATOM)
            return
        name, start, turn = c.name(self._name(k)), constant(0.0), None
        if node.op in (ca.OP_NORM1, ca.OP_NORMINF):
            values = [c.call("fabs", values)]
        if node.op in (DOT, ca.OP_NORMF):
            one, other = (*node.args, *node.args)[:2]
            values = [self._compose(Node(ca.OP_MUL, (one, other)), False).c]
        if node.op in (LARGEST, SMALLEST, ca.OP_NORMINF):
            way = "lesser" if node.op == SMALLEST else "greater"
            if node.op != ca.OP_NORMINF:
                start = expression(f"{'-' * (node.op == LARGEST)}(double)INFINITY")
            turn = c.assign(name, c.call(way, [name, values[0]]))
        turn = turn or c.assign(name, values[0], "+=")
        self.lines += [c.declare("double", name, start), *loop(node.detail, turn)]
        root = node.op == ca.OP_NORMF
        self.values[k] = Value(c.call("sqrt", [name]) if root else name, ATOM)

    def _called(self, k: int, node: Step) -> None:
        g, number_of, slots = node.detail
        mine = {
            n.place[1]: j for j, n in enumerate(self.nodes)
            if isinstance(n, Step) and n.op == CALLED and n.place[0] == number_of
        }  # fmt: skip
        arguments: list[C | None] = []
        for i, a in enumerate(node.args):
            n = g.nnz_in(i)
            if not n:
                arguments.append(None)
            elif self._size(a) != n:
                if self._size(a):
                    raise Unsupported("argument of another size")
                arguments.append(self._zeros(n))
            elif n == 1:
                arguments.append(element(self._real_of(a), 0))
                self.asked = element(self.condition(a), 0) if not i else self.asked
            else:
                arguments.append(self._address(a))
        results: list[C | None] = []
        for n in range(len(slots)):
            j, size = mine.get(n), g.nnz_out(n)
            if not size or j is None or not self.uses[j]:
                results.append(None)
                continue
            name = self._target(j) if size > 1 else c.name(self._name(j))
            self.values[j] = Value(place(name, 0) if size > 1 else name, ATOM)
            results.append(name)
        self.call(self, g, arguments, results)

    def _zeros(self, n: int) -> C:
        if n == 1:
            return constant(0.0)
        name = c.name(f"a{next(self.count)}")
        zeros = C("list", "", (constant(0.0),))
        self.lines.append(c.declare("static const double", c.index(name, n), zeros))
        return name


_BUILT: dict[int, Callable[[Arrays, int, Step], None]] = {
    JOINED: Arrays._joined, CHOSEN: Arrays._chosen, PRODUCT: Arrays._product,
    SPARSE_PRODUCT: Arrays._sparse_product,
    **dict.fromkeys((SUM_OF, LARGEST, SMALLEST, DOT, *NORMS), Arrays._folded),
}  # fmt: skip
"""How what takes several statements is written."""
