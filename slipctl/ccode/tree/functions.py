"""Functions with names and typed arguments: what a map, a fold or a search evaluates, in C.

Each CasADi Function becomes one C function: scalars by value, vectors by their address, results
by address, or as what it returns if it has one number. A map and an accumulation become a loop.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field

import casadi as ca

from slipctl.ccode.module.comments import WIDTH, comment
from slipctl.ccode.module.layout import KEYWORDS, LOCAL
from slipctl.ccode.passes.local_names import name_locals, with_inside
from slipctl.ccode.passes.repeats import hand_results, roll_calls
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree.arrays import Arrays
from slipctl.ccode.tree.expressions import ANY, Unsupported, Writer
from slipctl.ccode.tree.graph import argument_names, free_name, result_name
from slipctl.ccode.tree.helpers import HELPERS
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
from slipctl.ccode.tree.scans import find_scan, scan_lines
from slipctl.ccode.tree.statements import call_statement
from slipctl.ccode.tree.vectors import AT, element_text, loop
from slipctl.ccode.tree.while_loops import Again, again_lines, find_while_loop, stays

Branches = Callable[[ca.Function], tuple[ca.Function, ca.Function] | None]


@dataclass
class Functions:
    """C functions made so far, in order.

    Attributes:
        branches: gives what an if_else Function chooses from: (if true, otherwise), or None.
        docs: comment by the name of a Function.
        texts: text by C name.
        helpers: functions of ``HELPERS`` that they call.
        names: C name by serialised Function.
        letters: names that locals have from the model.
        reserved: names that are taken.
        repeats: what Functions do again and again, if that is all, by their hash.
    """

    branches: Branches
    docs: Mapping[str, str]
    texts: dict[str, str] = field(default_factory=dict)
    helpers: set[str] = field(default_factory=set)
    names: dict[str, str] = field(default_factory=dict)
    letters: set[str] = field(default_factory=set)
    reserved: set[str] = field(default_factory=lambda: {*LOCAL, *KEYWORDS, *HELPERS})
    repeats: dict[int, tuple[ca.Function, Again | None]] = field(default_factory=dict)

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
            self.texts[name] = self._written(f, name)  # behind those that it calls
        return self.names[key]

    def take(self, name: str) -> str:
        """A free name, which nobody else gets."""
        found = free_name(name, self.reserved)
        self.reserved.add(found)
        return found

    def taken(self, f: ca.Function) -> set[str]:
        """Names that no local of a Function may have."""
        return {*self.reserved, *(g.name() for g in f.find_functions())}

    # ---- one function ---------------------------------------------------------------------------

    def _written(self, f: ca.Function, name: str) -> str:
        kind = f.class_name()
        if kind not in ("SXFunction", "MXFunction", "Map"):
            raise Unsupported(f"{f.name()}: {kind}")
        inputs, outputs = _names(f, self.taken(f))
        self.letters |= {*inputs, *outputs}
        lines = name_locals(self._body(f, kind, inputs, outputs), "", self.taken(f))
        returns = returns_number(f)
        declared = [
            f"double {n}" if f.nnz_in(i) == 1 else f"const double {n}[{f.nnz_in(i)}]"
            for i, n in enumerate(inputs) if n
        ]  # fmt: skip
        if not returns:
            declared += [
                f"double *{n}" if f.nnz_out(i) == 1 else f"double {n}[{f.nnz_out(i)}]"
                for i, n in enumerate(outputs) if n
            ]  # fmt: skip
        text = " ".join(lines)
        voids = [f"(void){n};" for n in inputs if n and not re.search(rf"\b{re.escape(n)}\b", text)]
        signature = _signature(f"static {'double' if returns else 'void'} {name}", declared)
        what = self.docs.get(f.name())
        head = [comment(f"{f.name()}: {what}")] if what else []
        body = [f"    {line}" for line in [*voids, *lines]]
        return "\n".join([*head, signature, "{", *body, "}"])

    def _body(
        self, f: ca.Function, kind: str, inputs: Sequence[str], outputs: Sequence[str]
    ) -> list[str]:
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
        sources = [n if f.nnz_in(i) == 1 else f"{n}[]" for i, n in enumerate(inputs)]
        made = self.statements(f, sources, outputs)
        return made

    def _again(self, f: ca.Function) -> Again | None:
        """What a Function does again and again; looked at once."""
        key = f.__hash__()
        if key not in self.repeats:
            self.repeats[key] = f, find_while_loop(f, self.branches, self._again)
        return self.repeats[key][1]

    def _scalar(self, f: ca.Function, inputs: Sequence[str], outputs: Sequence[str]) -> list[str]:
        if any(not f.sparsity_out(i).is_dense() and f.nnz_out(i) == 0 for i in range(f.n_out())):
            raise Unsupported("empty result")
        single = [f.nnz_in(i) == 1 for i in range(f.n_in())]
        returns = returns_number(f)
        inner, names = with_inside(f, {*inputs, *outputs, *self.taken(f)})
        self.letters |= set(names.values())
        writer = Writer(
            inner, lambda i, k: inputs[i] if single[i] else f"{inputs[i]}[{k}]", names,
            shown=f.n_out(), modest=True,
        ).run()  # fmt: skip
        self.helpers |= set(writer.helpers)
        lines = list(writer.lines)
        for (i, k), node in writer.results:
            text = writer.result(node)
            if returns:
                lines.append(f"return {text};")
            else:
                to = f"*{outputs[i]}" if f.nnz_out(i) == 1 else f"{outputs[i]}[{k}]"
                lines.append(f"{to} = {text};")
        return roll_lines(lines, {*inputs, *outputs})

    def _loop(
        self, inner: ca.Function, n: int, inputs: Sequence[str], outputs: Sequence[str],
        kept: int, whole: Set[int] = frozenset(),
    ) -> list[str]:  # fmt: skip
        """N calls, each with its columns; with ``kept`` the first result goes on as argument.

        An argument that is in ``whole`` is the same in each of them.
        """
        lines: list[str] = []
        arguments, results = [], []
        for i, name in enumerate(inputs):
            size = inner.nnz_in(i)
            if not size:
                arguments.append("")
            elif i < kept:
                lines.append(f"const double *now = {'&' * (size == 1)}{name};")
                arguments.append("*now" if size == 1 else "now")
            elif i in whole:
                arguments.append(name)
            else:
                arguments.append(f"{name}[i]" if size == 1 else f"&{name}[{size} * i]")
        for i, name in enumerate(outputs):
            size = inner.nnz_out(i)
            results.append(
                "" if not size else f"{name}[i]" if size == 1 else f"&{name}[{size} * i]"
            )
        call = self.name(inner)
        if returns_number(inner):
            body = (
                f"{next(r for r in results if r)} = {call}({', '.join(a for a in arguments if a)});"
            )
        else:
            given = [r if r.startswith("&") else f"&{r}" for r in results if r]
            body = f"{call}({', '.join([a for a in arguments if a] + given)});"
        lines += [f"for (int i = 0; i < {n}; ++i) {{", f"    {body}"]
        if kept:
            size = inner.nnz_out(0)
            lines.append(f"    now = &{outputs[0]}[{f'{size} * ' if size > 1 else ''}i];")
        return [*lines, "}"]

    def _chain(
        self, f: ca.Function, inner: ca.Function, n: int, inputs: Sequence[str],
        outputs: Sequence[str],
    ) -> list[str]:  # fmt: skip
        """Calls one after the other, each with what the one before gave, in two arrays by turns.

        A chain of chains is one: CasADi nests a long one by tens.
        """
        while (deeper := call_chain(inner)) is not None:
            inner, n = deeper[0], n * deeper[1]
        taken = {*self.taken(f), *inputs, *outputs}
        now, to, other = (free_name(word, taken) for word in ("before", "to", "between"))
        given = ", ".join([now, *(x for x in inputs[1:] if x), to])
        return [
            f"double {other}[{f.nnz_out(0)}];",
            f"for (int i = 0; i < {f.nnz_out(0)}; ++i) {{",
            f"    {other}[i] = 0.0;",
            "}",
            f"const double *{now} = {inputs[0]};",
            f"for (int i = 0; i < {n}; ++i) {{",
            f"    double *const {to} = ((i % 2) == {(n - 1) % 2}) ? {outputs[0]} : {other};",
            f"    {self.name(inner)}({given});",
            f"    {now} = {to};",
            "}",
        ]

    def _sums(
        self, f: ca.Function, found: Sums, inputs: Sequence[str], outputs: Sequence[str]
    ) -> list[str]:
        """Sums of what each evaluation of a map gives, without an array of all of it."""
        inner, taken = found.inner, {*self.taken(f), *inputs, *outputs}
        lines: list[str] = []
        arguments, results, body = [], [], []
        for i, source in enumerate(found.sources):
            size, whole = inner.nnz_in(i), f.nnz_in(source)
            if not size:
                continue
            name = inputs[source]
            if whole == size:
                arguments.append(name)
            else:
                arguments.append(f"{name}[i]" if size == 1 else f"&{name}[{size} * i]")
        for k, name in enumerate(outputs):
            size = f.nnz_out(k)
            one = free_name(f"{result_name(inner, k) or 'term'}_one", taken)
            taken.add(one)
            body.append(f"double {one}{f'[{size}]' if size > 1 else ''};")
            results.append(one if size > 1 else f"&{one}")
            if size == 1:
                lines.append(f"*{name} = 0.0;")
            else:
                lines += [f"for (int j = 0; j < {size}; ++j) {{", f"    {name}[j] = 0.0;", "}"]
        body.append(call_statement(f"{self.name(inner)}(", [*arguments, *results]))
        for k, name in enumerate(outputs):
            size, one = f.nnz_out(k), results[k].removeprefix("&")
            if size == 1:
                body.append(f"*{name} += {one};")
            else:
                body += [f"for (int j = 0; j < {size}; ++j) {{",
                         f"    {name}[j] += {one}[j];", "}"]  # fmt: skip
        lines.append(f"for (int i = 0; i < {found.count}; ++i) {{")
        return [*lines, *(f"    {line}" for line in body), "}"]

    # ---- statements of an MX Function -----------------------------------------------------------

    def statements(
        self,
        f: ca.Function,
        sources: Sequence[str],
        outputs: Sequence[str],
        count: Iterator[int] | None = None,
        can_be: Callable[[int, int], int] = lambda i, k: ANY,
        hidden: int | None = None,
        names: Mapping[int, str] | None = None,
    ) -> list[str]:
        """Statements that give the results of an MX Function to C variables.

        Args:
            f: the Function.
            sources: by argument, text of the scalar, or of the array with ``[]`` behind.
            outputs: by result, name of the argument by whose address it is given.
            count: numbers of names.
            can_be: what a scalar argument can be.
            hidden: results from here on are only told for their names.
            names: names of results.
        """
        targets = {i: n for i, n in enumerate(outputs) if n and f.nnz_out(i) > 1}
        made = Arrays(
            f,
            sources,
            self._call,
            names,
            targets,
            count,
            can_be,
            hidden,
            {*self.taken(f), *(x.removesuffix("[]") for x in (*sources, *outputs))},
        ).run()
        self.helpers |= made.helpers
        lines = made.lines
        returns = hidden is None and returns_number(f)
        for i, name in enumerate(outputs):
            node = made.outputs[i]
            if node < 0 or not name:
                continue
            n = f.nnz_out(i)
            text = made._real(made.texts[node])
            if n == 1:
                to = name if "->" in name or "." in name else f"*{name}"
                text = element_text(text, 0)
                lines.append(f"return {text};" if returns else f"{to} = {text};")
            elif text != f"{name}[@]":
                lines += loop(n, f"{name}[{AT}] = {text};")
        own = {x.removesuffix("[]") for x in (*sources, *outputs) if x}
        return roll_calls(hand_results(lines), self.taken(f) | own)

    def _call(
        self, at: Arrays, g: ca.Function, arguments: Sequence[str], results: Sequence[str]
    ) -> None:
        """Write a call: a branch, a running sum, or that of a function."""
        if is_running_sum(g) and results[0]:
            total = free_name("total", at.taken)
            at.taken.add(total)
            given = arguments[1].removeprefix("&")
            element = re.sub(r"\[(\d+)\]$", r"[\1 + i]", given)
            element += "" if element != given else "[i]"
            at.lines += [
                f"double {total} = {arguments[0]};",
                f"for (int i = 0; i < {g.nnz_out(0)}; ++i) {{",
                f"    {total} += {element};",
                f"    {results[0]}[i] = {total};",
                "}",
            ]
            return
        chosen = self.branches(g)
        if chosen is None:
            self._plain(at, g, arguments, results, True)
            return
        for n, r in enumerate(results):
            if r and g.nnz_out(n) == 1:
                at.lines.append(f"double {r};")
        lines, at.lines = at.lines, []
        lines.append(f"if ({at.asked}) {{")
        for f, after in zip(chosen, ("} else {", "}"), strict=True):
            kept = stays(f)
            if kept >= 0 and results[0]:
                n = f.nnz_out(0)
                at.lines += [
                    f"{results[0]} = {arguments[1 + kept]};" if n == 1
                    else f"copy({results[0]}, {arguments[1 + kept]}, {n});"
                ]  # fmt: skip
            else:
                self._plain(at, f, arguments[1:], results, False)
            lines += [f"    {line}" for line in at.lines]
            at.lines = []
            lines.append(after)
        at.lines = lines

    def _plain(
        self, at: Arrays, g: ca.Function, arguments: Sequence[str], results: Sequence[str],
        declare: bool,
    ) -> None:  # fmt: skip
        name = self.name(g)
        given = [a for a in arguments if a]
        if returns_number(g):
            (result,) = (r for n, r in enumerate(results) if g.nnz_out(n))
            what = "const double " if declare else ""
            if result:
                at.lines.append(f"{what}{result} = {name}({', '.join(given)});")
            return
        passed = []
        for n, r in enumerate(results):
            size = g.nnz_out(n)
            if not size:
                continue
            if not r:
                r = f"unused{next(at.count)}"
                at.lines.append(f"double {r}{f'[{size}]' if size > 1 else ''};")
            elif declare and size == 1:
                at.lines.append(f"double {r};")
            passed.append(r if size > 1 else f"&{r}")
        at.lines.append(call_statement(f"{name}(", [*given, *passed]))


def returns_number(f: ca.Function) -> bool:
    """Whether a Function gives one number, which its C function returns."""
    return sum(f.nnz_out(i) for i in range(f.n_out())) == 1


def _signature(opening: str, declared: Sequence[str]) -> str:
    lines, line = [], f"{opening}("
    indent = " " * len(line)
    for k, text in enumerate(declared):
        piece = text + (")" if k == len(declared) - 1 else ", ")
        if len(line) + len(piece) > WIDTH:
            lines.append(line.rstrip())
            line = indent
        line += piece
    return "\n".join([*lines, line])


def _names(f: ca.Function, taken: set[str]) -> tuple[list[str], list[str]]:
    """C names of arguments and results; empty for what holds no number."""
    own = [n or f.name_in(i) for i, n in enumerate(argument_names(f))]
    used = set(taken)

    def free(name: str) -> str:
        name = re.sub(r"\W", "_", name)
        name = name if re.match("[A-Za-z]", name) else f"x_{name}"
        found = free_name(name, used)
        used.add(found)
        return found

    inputs = [free(n) if f.nnz_in(i) else "" for i, n in enumerate(own)]
    outputs = [free(f.name_out(i)) if f.nnz_out(i) else "" for i in range(f.n_out())]
    return inputs, outputs
