"""An MX Function as statements of C: vectors are arrays, what is done to each element is a loop.

Operation for operation as CasADi evaluates it, so that C gives the bits of Python. A vector that
is used once is written where it is used, with the index of the loop around it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import casadi as ca

from slipctl.ccode.passes.sums import Total
from slipctl.ccode.tree.expressions import ANY, Node, Text, Unsupported, Writer, number
from slipctl.ccode.tree.expressions import ATOM as _ATOM
from slipctl.ccode.tree.graph import (
    CALLED,
    CHOSEN,
    DOT,
    JOINED,
    LARGEST,
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
from slipctl.ccode.tree.scans import single_columns
from slipctl.ccode.tree.vectors import (
    AT,
    address,
    array_and_offset,
    by_blocks,
    element_text,
    initialiser_lines,
    loop,
    place,
)


class Arrays(Writer):
    """Statements of an MX Function; ``run`` writes them.

    Args:
        f: the Function.
        sources: by argument: text of the scalar, or of the array that holds it.
        call: writes the call of a Function: (lines, function, addresses or texts of arguments,
            names of results).
        names: names of results.
        targets: by result, the array in which it is wanted, or "".
        count: numbers of names, shared in one C function.
        can_be: what a scalar argument can be.
        hidden: results from this one on only have names.
        taken: names that no local may have.
    """

    def __init__(
        self,
        f: ca.Function,
        sources: Sequence[str],
        call: Callable[[Arrays, ca.Function, Sequence[str], Sequence[str]], None],
        names: Mapping[int, str] | None = None,
        targets: Mapping[int, str] | None = None,
        count: Iterator[int] | None = None,
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
        hidden: int | None = None,
        taken: Iterable[str] = (),
    ) -> None:
        self.call, self.sources = call, sources
        self.outputs: list[int] = []  # node of each result
        self.asked = ""  # condition that the first argument of a call is
        self.done: set[int] = set()
        self.targets: dict[int, str] = {}
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
            if targets and targets.get(i) and self._size(n) > 1:
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
        self.places: dict[int, tuple[str, int]] = {}  # that a search has found; the last one
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

    def _source(self, i: int, k: int) -> str:
        return self.sources[i]

    def text_at(self, node: int, k: int | str) -> str:
        """Text of an element of a value."""
        return element_text(self._real(self.texts[node]), k)

    def _write(self, k: int) -> None:
        node = self.nodes[k]
        assert isinstance(node, Step)
        if k in self.texts or not node.size or self._place(k, node):
            return
        op = node.op
        if op == ca.OP_INPUT:
            self.texts[k] = self._input(node)
        elif op == ca.OP_CONST and node.size > 1:
            self.texts[k] = self._constant(node)
        elif op == CALLED:
            self._called(k, node)
        elif op == SLICE:
            self._slice(k, node)
        elif op == SPREAD:
            self._spread(k, node)
        elif op == TURNED:
            rows, columns = node.detail
            base, offset = self._stored(node.args[0])
            at = f"({AT} % {columns}) * {rows} + {AT} / {columns}"
            self.texts[k] = Text(f"{base}[{offset} + {at}]" if offset else f"{base}[{at}]", _ATOM)
        elif op in (JOINED, CHOSEN, PRODUCT, SPARSE_PRODUCT, SUM_OF, LARGEST, SMALLEST, DOT):
            self._built(k, node)
        elif op == ca.OP_GETNONZEROS_PARAM:
            self._element(k, node)
        elif node.size == 1:
            super()._write(k)
            return
        else:
            made = self._compose(node, self.signed[k])
            self.texts[k] = made
            if self.uses[k] > 1 or k in self.names or len(made.text) > 150:
                self._line(k)
        wanted = k in self.names and node.size == 1
        given = op in (ca.OP_INPUT, ca.OP_CONST, CALLED)
        if wanted and not given and self.texts[k].text != self.names[k]:
            self._line(k)

    def _element(self, k: int, node: Step) -> None:
        """Element of an array by a number; by a place that was searched for it lies inside."""
        base, offset = self._stored(node.args[0])
        place, last = self.places.get(node.args[1], ("", node.detail))
        if last < node.detail:
            inside = f"{place} + {offset}" if offset else place
            self.texts[k] = Text(f"{base}[{inside}]", _ATOM)
            if self.uses[k] > 1:
                self._line(k)
            return
        self.helpers.add("element")
        index = self._real(self.texts[node.args[1]])
        text = f"element({address(base, offset)}, {node.detail}, {index})"
        self.texts[k] = Text(text, _ATOM)
        if node.size == 1 or self.uses[k] > 1 or len(text) > 60:
            self._line(k)

    def _place(self, k: int, node: Step) -> bool:
        """Whether it is the place that a search finds, or the next one: a whole number."""
        if node.op == ca.OP_LOW:
            base, offset = self._stored(node.args[0])
            self.helpers.add("reached")
            name = self.names.get(k) or f"k{next(self.count)}"
            x = self._real(self.texts[node.args[1]])
            search = f"reached({address(base, offset)}, {node.detail}, {x})"
            self.lines.append(f"const int {name} = {search};")
            self.places[k] = name, int(node.detail) - 1
        elif node.op == ca.OP_ADD and (first := [a for a in node.args if a in self.places]):
            by = next((a for a in node.args if a not in first), first[0])
            if self.nodes[by].op != ca.OP_CONST or self.nodes[by].value != 1:
                return False
            place, last = self.places[first[0]]
            self.places[k] = f"{place} + 1", last + 1
        else:
            return False
        self.texts[k] = Text(f"(double)({self.places[k][0]})", _ATOM)
        return True

    def _compose(self, node: Node, signed: bool) -> Text:
        """Text of an operation; a truth that is above 0 is that truth."""
        if node.op == ca.OP_LT and self.texts[node.args[1]].truth:
            zero = self.nodes[node.args[0]]
            if zero.op == ca.OP_CONST and zero.value == 0.0 and self._size(node.args[0]) == 1:
                return self.texts[node.args[1]]
        return super()._compose(node, signed)

    def _input(self, node: Step) -> Text:
        source = self.sources[node.place[0]]
        if source.endswith("[]"):
            base, offset = source[:-2], int(node.detail)
            return Text(place(base, offset) if node.size > 1 else f"{base}[{offset}]", _ATOM)
        return Text(source, _ATOM)

    def _constant(self, node: Step) -> Text:
        values = node.detail
        if all(v == values[0] for v in values):
            text = number(values[0])
            return Text(f"({text})" if text.startswith("-") else text, _ATOM)
        if values == [values[0] + k for k in range(len(values))] and abs(values[0]) < 2**24:
            begin = f" + {number(values[0])}" if values[0] else ""
            return Text(f"((double){AT}{begin})" if begin else f"(double){AT}", _ATOM)
        name = f"k{next(self.count)}"
        declared = f"static const double {name}[{len(values)}]"
        self.lines += initialiser_lines(declared, [number(v) for v in values])
        return Text(f"{name}[{AT}]", _ATOM)

    def _stored(self, k: int) -> tuple[str, int]:
        """Array and offset of a vector; it gets an array if it has none."""
        text = self.texts[k]
        if not text.truth:
            found = array_and_offset(text.text)
            if found is not None:
                return found
            single = re.fullmatch(r"([A-Za-z_][\w.>-]*)\[(\d+)\]", text.text)
            if self._size(k) == 1 and single:
                return single[1], int(single[2])
        self._array(k)
        found = array_and_offset(self.texts[k].text)
        assert found is not None
        return found

    def _array(self, k: int) -> None:
        """Put the elements of a vector into an array of its own."""
        name, size = self._target(k), self._size(k)
        line = f"{place(name, 0)} = {self._real(self.texts[k])};"
        self.lines += loop(size, line)
        self.texts[k] = Text(place(name, 0), _ATOM)

    def _target(self, k: int) -> str:
        """Array for a value: where it is wanted, or a new one."""
        if k in self.targets and k not in self.done:
            self.done.add(k)
            return self.targets[k]
        name = self._name(k)
        self.lines.append(f"{self.real} {name}[{self._size(k)}];")
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
        text = self.texts[source]
        if node.size == self._size(source) and stride == 1:
            self.texts[k] = text
            return
        if AT not in text.text and self._size(source) > 1:  # the same number everywhere
            self.texts[k] = text
            return
        if (
            "%" in text.text
            or "/ " in text.text
            or (array_and_offset(text.text) is None and node.size > 1)
        ):
            self._stored(source)
            text = self.texts[source]
        if node.size == 1:
            self.texts[k] = Text(element_text(text.text, offset), text.rank, text.truth)
            return
        base, first = self._stored(source)
        self.texts[k] = Text(place(base, first + offset, stride), _ATOM)

    def _spread(self, k: int, node: Step) -> None:
        (source,) = node.args
        if node.detail == 1:
            if self.texts[source].rank != _ATOM:
                self._line(source)
            self.texts[k] = self.texts[source]
            return
        base, offset = self._stored(source)
        at = f"{AT} % {node.detail}"
        self.texts[k] = Text(f"{base}[{offset} + {at}]" if offset else f"{base}[{at}]", _ATOM)

    def _built(self, k: int, node: Step) -> None:
        """Write what takes several statements, into a variable or an array of its own."""
        op, args, lines = node.op, node.args, self.lines
        if op == PRODUCT:
            z, x, y = args
            rows, inner, columns = node.detail
            if rows * inner * columns == 1:
                product = f"{self.text_at(z, 0)} + {self._factor(x)} * {self._factor(y)}"
                self.texts[k] = Text(product, 6)
                if self.uses[k] > 1 or k in self.names:
                    self._line(k)
                return
            bases = [address(*self._stored(v)) for v in (x, y)]
            name, start = self._target(k) if node.size > 1 else self._variable(k), self.texts[z]
            begun = self._real(start) != "0.0"
            if begun and node.size > 1:
                lines += loop(node.size, f"{place(name, 0)} = {self._real(start)};")
            elif node.size == 1:
                lines.append(f"double {name}{f' = {self.text_at(z, 0)}' if begun else ''};")
            at = name if node.size > 1 else f"&{name}"
            call = "add_matrix_product" if begun else "matrix_product"
            self.helpers.add(call)
            lines.append(f"{call}({bases[0]}, {rows}, {inner}, {bases[1]}, {columns}, {at});")
        elif op == SPARSE_PRODUCT:
            z, x, y = args
            values, given = (address(*self._stored(v)) for v in (x, y))
            table, places = f"k{next(self.count)}", []
            for name, numbers in zip((f"{table}_begin", f"{table}_row"), node.detail, strict=True):
                declared = f"static const int {name}[{len(numbers)}]"
                lines += initialiser_lines(declared, [str(v) for v in numbers])
                places.append(name)
            name, start = self._target(k) if node.size > 1 else self._variable(k), self.texts[z]
            if node.size > 1:
                lines += loop(node.size, f"{place(name, 0)} = {self._real(start)};")
            else:
                lines.append(f"double {name} = {self.text_at(z, 0)};")
            self.helpers.add("add_sparse_product")
            columns = len(node.detail[0]) - 1
            at = name if node.size > 1 else f"&{name}"
            lines.append(
                f"add_sparse_product({values}, {', '.join(places)}, {columns}, {given}, {at});"
            )
        elif op in (SUM_OF, LARGEST, SMALLEST, DOT):
            self._folded(k, node)
            return
        elif op == CHOSEN:
            (source,) = args
            if self._size(source) == 1 and set(node.detail) == {0}:
                if self.texts[source].rank != _ATOM:
                    self._line(source)
                self.texts[k] = self.texts[source]
                return
            base, offset = self._stored(source)
            if node.size == 1:
                self.texts[k] = Text(f"{base}[{offset + node.detail[0]}]", _ATOM)
                return
            if (index := by_blocks(node.detail, offset)) is not None:
                self.texts[k] = Text(f"{base}[{index}]", _ATOM)
                if self.uses[k] > 1 or k in self.targets:
                    self._array(k)
                return
            name = self._target(k)
            self._elements(
                name, [f"{base}[{offset + j}]" if j >= 0 else "0.0" for j in node.detail]
            )
        else:
            texts = [(a, self._size(a), self._real(self.texts[a])) for a in args if self._size(a)]
            if len(texts) == 1:
                self.texts[k] = self.texts[texts[0][0]]
                return
            name, offset = self._target(k), 0
            if all(n == 1 for _, n, _ in texts):
                self._elements(name, [element_text(text, 0) for _, _, text in texts])
                texts = []
            for _, n, text in texts:
                if n == 1:
                    lines.append(f"{name}[{offset}] = {element_text(text, 0)};")
                else:
                    lines += loop(n, f"{place(name, offset)} = {text};")
                offset += n
        self.texts[k] = Text(place(name, 0) if node.size > 1 else name, _ATOM)

    def _elements(self, name: str, texts: Sequence[str]) -> None:
        """Give an array its elements one by one, with its declaration if that is the last line."""
        if self.lines[-1:] != [f"{self.real} {name}[{len(texts)}];"]:
            self.lines += [f"{name}[{i}] = {text};" for i, text in enumerate(texts)]
            return
        self.lines[-1:] = initialiser_lines(f"const {self.real} {name}[{len(texts)}]", texts)

    def _factor(self, k: int) -> str:
        t = self.texts[k]
        text = element_text(self._real(t), 0)
        return text if t.truth or t.rank >= 7 else f"({text})"

    def _variable(self, k: int) -> str:
        return self._name(k)

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
        texts = [self._real(self.texts[a]) for a in node.args]
        if node.op == SUM_OF and node.size > 1:
            name = self._target(k)
            self.lines += loop(node.size, f"{place(name, 0)} = 0.0;")
            line = f"{name}[{AT} % {node.size}] += {texts[0]};"
            self.lines += loop(node.detail, line)
            self.texts[k] = Text(place(name, 0), _ATOM)
            return
        name, start = self._variable(k), "0.0"
        if node.op in (SUM_OF, DOT):
            if node.op == DOT:
                texts = [self._operand(a, 7) for a in node.args]
            line = f"{name} += {' * '.join(texts)};"
        else:
            way = "greater" if node.op == LARGEST else "lesser"
            start = "-(double)INFINITY" if node.op == LARGEST else "(double)INFINITY"
            self.helpers.add(way)
            line = f"{name} = {way}({name}, {texts[0]});"
        self.lines.append(f"double {name} = {start};")
        self.lines += loop(node.detail, line)
        self.texts[k] = Text(name, _ATOM)

    def _called(self, k: int, node: Step) -> None:
        g, number_of, slots = node.detail
        mine = {
            n.place[1]: j for j, n in enumerate(self.nodes)
            if isinstance(n, Step) and n.op == CALLED and n.place[0] == number_of
        }  # fmt: skip
        arguments = []
        for i, a in enumerate(node.args):
            n = g.nnz_in(i)
            if not n:
                arguments.append("")
            elif self._size(a) != n:
                if self._size(a):
                    raise Unsupported("argument of another size")
                arguments.append(self._zeros(n))
            elif n == 1:
                arguments.append(element_text(self._real(self.texts[a]), 0))
                self.asked = element_text(self.condition(a), 0) if not i else self.asked
            else:
                arguments.append(address(*self._stored(a)))
        results = []
        for n in range(len(slots)):
            j = mine.get(n)
            size = g.nnz_out(n)
            if not size:
                results.append("")
                continue
            if j is None or not self.uses[j]:
                results.append("")
                continue
            if size > 1:
                name = self._target(j)
                self.texts[j] = Text(place(name, 0), _ATOM)
            else:
                name = self._name(j)
                self.texts[j] = Text(name, _ATOM)
            results.append(name)
        self.call(self, g, arguments, results)

    def _zeros(self, n: int) -> str:
        if n == 1:
            return "0.0"
        name = f"a{next(self.count)}"
        self.lines.append(f"static const double {name}[{n}] = {{0.0}};")
        return name
