"""What a C module consists of: its structs, its equations, how it starts, where it works."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.fields import VectorNames
from slipctl.block.transforms.asked_outputs import asked_outputs
from slipctl.block.transforms.discretisation import counters
from slipctl.ccode.module.comments import first_sentence
from slipctl.ccode.module.kernel import Kernel, by_parts
from slipctl.ccode.module.layout import (
    Layout,
    Member,
    constant,
    dense_value,
    layout,
    matrix,
    of_each_copy,
    started_copies,
)
from slipctl.ccode.module.wires import Wires
from slipctl.ccode.passes.integers import with_integers
from slipctl.ccode.passes.precision import check_real, round_to_real
from slipctl.ccode.passes.rolled_loops import roll_lines
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import Writer, number
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression
from slipctl.errors import BadInput

ON_STACK = 128
"""Numbers of states above which the next ones are put together in the state struct."""


class Ends(NamedTuple):
    """Of each element least and greatest value, largest change per tick, and noise."""

    lo: np.ndarray
    hi: np.ndarray
    change: np.ndarray
    noise: np.ndarray


class Plan:
    """Everything that header and source are written from.

    Args:
        block: a step or a law.
        name: name of the module.
        period: tick in s, if the block does not say it itself; only told in comments.
        real: type of a number in C, double or float.
        rates: whether there is a step function for each rate too.
        counter: whether there is a step that is told the number of its tick too.
        byte_order: of the processor, little or big, which only the A2L tells.

    Raises:
        BadInput: a flow, a name that is no C identifier, names that clash, a parameter without
            value, an operation that cannot be generated.
    """

    def __init__(
        self,
        block: Block,
        name: str | None = None,
        period: float | None = None,
        real: str = "double",
        rates: bool = False,
        counter: bool = False,
        byte_order: str = "little",
        asked: bool = False,
    ) -> None:
        if byte_order not in ("little", "big"):
            raise BadInput(f"there is no byte order {byte_order!r}; write little or big")
        self.byte_order = byte_order
        self.real, self.rates, self.counter = check_real(real), rates, counter
        if block.kind == "flow":
            raise BadInput(
                f"{block.name} is continuous and has no step;"
                f" sampled({block.name}, h, method) first"
            )
        self.block = self.whole = block
        if asked and not rates and not block.composition.split:
            self.block = asked_outputs(block)
        beside = [s for n, s in block.outputs.items() if n not in self.block.outputs]
        self.layout: Layout = layout(self.block, name or block.name, beside)
        self.name, self.period = self.layout.name, block.period or period
        made, ticks = self._by_parts(), [m for m, _ in self.counters]
        self.equations, self.layout = with_integers(made, self.layout, ticks)

    def _by_parts(self) -> Kernel:
        lay = self.layout
        params = {m.name: (m, "param->") for m in lay.params}
        params |= {m.name: (m, "derived->") for m in lay.derived}
        wires = Wires(
            {m.name: (m, "state->") for m in lay.states},
            {m.name: (m, "next->") for m in lay.states},
            {m.name: (m, "in->") for m in lay.inputs}, params,
            {m.name: (m, "now->") for m in lay.signals},
        )  # fmt: skip

        types = {k: _declared(text) for k, text in self.types.items()}
        named: VectorNames = {}
        for _, leaf in self.block.leaves():  # of several problems the first has names
            named = {**leaf.composition.vector_names, **named}
        return by_parts(self.whole, wires, types, self.results, self.docs, named)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files of the module: header, parts, source."""
        return f"{self.name}.h", f"{self.name}_parts.h", f"{self.name}.c"

    @property
    def types(self) -> dict[str, str]:
        """Declaration of each struct that a function of the module may be given, by its name."""
        n = self.name
        return {
            "in": f"const {n}_in *in", "param": f"const {n}_param *param",
            "derived": f"const struct {n}_derived *derived",
            "state": f"const struct {n}_kept *state", "next": f"struct {n}_kept *next",
            "now": f"{self.layout.now} *now", "work": f"struct {n}_work *work",
        }  # fmt: skip

    @cached_property
    def docs(self) -> dict[str, str]:
        """First sentence of each part by the name of its Function."""
        found: dict[str, str] = {}
        for _, leaf in self.block.leaves():
            if leaf.doc:
                found.setdefault(leaf._c_name(), first_sentence(leaf.doc))
        return found

    @cached_property
    def results(self) -> list[tuple[Member, str]]:
        """Struct member behind each result of the equations, with the pointer to it."""
        lay = self.layout
        return [(m, "next->") for m in lay.states] + [(m, "now->") for m in lay.signals]

    @property
    def work_in_state(self) -> bool:
        """Whether the scratch memory of the equations lies in the state struct."""
        return bool(self.equations.arrays or self.equations.static)

    @property
    def next_in_state(self) -> bool:
        """Whether the next state is put together in the state struct instead of on the stack."""
        return self.rates or sum(m.size for m in self.layout.states) > ON_STACK

    @property
    def early(self) -> list[Member]:
        """Inputs that ``prepare`` reads."""
        names = self.block.composition.split.inputs if self.block.composition.split else ()
        return [m for m in self.layout.inputs if m.name in names]

    @property
    def ahead(self) -> list[Member]:
        """States that ``prepare`` makes and the rest of the tick leaves as they are."""
        names = self.block.composition.split.ahead if self.block.composition.split else ()
        return [m for m in self.layout.states if m.name in names]

    def state_named(self, name: str) -> Member:
        """The state of this name."""
        return next(m for m in self.layout.states if m.name == name)

    @property
    def n_in(self) -> int:
        """Number of input elements."""
        return sum(m.size for m in self.layout.inputs)

    @cached_property
    def counters(self) -> list[tuple[Member, int]]:
        """States that count ticks from one run of a part to the next, and how many those are."""
        return [(self.state_named(n), ticks) for n, ticks in counters(self.block).items()]

    @property
    def judged(self) -> np.ndarray:
        """Whether the block judges an input element itself."""
        return np.array([m.signal.judged for m in self.layout.inputs for _ in range(m.size)])

    @property
    def stale(self) -> np.ndarray:
        """Ticks for which the last good value of each input element is taken."""
        return np.array([float(m.signal.stale) for m in self.layout.inputs for _ in range(m.size)])

    @cached_property
    def parts(self) -> dict[str, list[Member]]:
        """States of each part by its path, in the order in which parts are reset."""
        found: dict[str, list[Member]] = {}
        for m in self.layout.states:
            found.setdefault(m.name.rpartition(".")[0], []).append(m)
        return found

    def ranged(self, m: Member) -> bool:
        """Whether a number has a range of its own."""
        ends = any(math.isfinite(v) for v in self.limits(m)) or self.follows((m,))
        return ends and self.layout.kind(m, self.real) == self.real

    def ends(self, members: Iterable[Member], values: Mapping[str, Any]) -> Ends:
        """Range, largest change per tick and noise of each element, in numbers that C has."""
        most = float(np.finfo(np.float32 if self.real == "float" else np.float64).max)
        rows = []
        for m in members:
            found = self.block.ends(m.signal, values)
            for k in range(m.size):
                lo, hi, change, noise = (
                    [float(_element(v, k)) for v in given] for given in found
                )  # fmt: skip
                rows.append((max([-most, *lo]), min([most, *hi]), min([most, *change]),
                             max(noise, default=0.0)))  # fmt: skip
        return Ends(*round_to_real(np.array(rows).reshape(-1, 4), self.real).T)

    @cached_property
    def coupled(self) -> bool:
        """Whether an end of an input follows other inputs."""
        known = self._symbols(self.block.params)
        both = known | self._symbols(self.block.inputs)
        return any(
            len(a) < len(b) for m in self.layout.inputs
            for a, b in zip(self.block.ends(m.signal, known), self.block.ends(m.signal, both),
                            strict=True)
        )  # fmt: skip

    def _symbols(self, signals: Mapping[str, Any]) -> dict[str, ca.SX]:
        return {n: ca.SX.sym(n, *matrix(s)) for n, s in signals.items()}

    def ends_of_inputs(self, values: Mapping[str, Any]) -> ca.Function:
        """Function of last good inputs, one below the other, to the columns of :class:`Ends`."""
        symbols = self._symbols(self.block.inputs)
        most = float(np.finfo(np.float32 if self.real == "float" else np.float64).max)
        top = {"lo": -most, "hi": most, "change": most, "noise": 0.0}
        columns: dict[str, list[Any]] = {what: [] for what in Ends._fields}
        for m in self.layout.inputs:
            found = self.block.ends(m.signal, {**values, **symbols})
            for what, given in zip(Ends._fields, found, strict=True):
                for k in range(m.size):
                    here = [_element(v, k) for v in given]
                    columns[what].append(_tightest(m, what, here) if here else top[what])
        last = ca.vertcat(*(ca.vec(v) for v in symbols.values()))
        return ca.Function("ends", [last], [ca.vertcat(*c) for c in columns.values()])

    def ends_text(
        self, members: Iterable[Member], last: bool = False
    ) -> tuple[list[Node], dict[Any, str]]:
        """The same in C: statements, and an expression by (member, element, what).

        Args:
            members: of one role.
            last: count ends that follow the last good values of inputs, too.
        """
        lay, block = self.layout, self.block
        places = {m.name: (m, "param->") for m in lay.params}
        places |= {m.name: (m, "derived->") for m in lay.derived}
        places |= {m.name: (m, "guard->last.") for m in lay.inputs}
        read = [*block.params.values(), *(block.inputs.values() if last else ())]
        symbols = self._symbols({s.name: s for s in read})
        keys, results, texts = [], [], {}
        for m in members:
            found = dict(zip(Ends._fields, block.ends(m.signal, symbols), strict=True))
            top = {"lo": "-DBL_MAX", "hi": "DBL_MAX", "change": "DBL_MAX", "noise": "0.0"}
            for what, given in found.items():
                follows = any(b.what == what for b in m.signal.bounds)
                for k in range(m.size):
                    here = [_element(v, k) for v in given]
                    if not follows:
                        texts[m.c, k, what] = _literal(here[0], self.real) if here else top[what]
                        continue
                    if not here:
                        texts[m.c, k, what] = top[what]
                        continue
                    keys.append((m.c, k, what))
                    results.append(ca.SX(_tightest(m, what, here)))
        if not keys:
            return [], texts
        f = ca.Function("ends", list(symbols.values()), results)
        members_ = [places[s.name] for s in read]
        writer = Writer(f, lambda i, k: members_[i][0].node(members_[i][1], k)).run()
        at = dict(writer.results)
        return list(writer.lines), texts | {
            key: writer.result(at[i, 0]).text for i, key in enumerate(keys)
        }

    def limits(self, m: Member) -> tuple[float, float]:
        """Range of a signal, in numbers that C has."""
        lo, hi = round_to_real((m.signal.lo, m.signal.hi), self.real)
        return float(lo), float(hi)

    def before(self, m: Member) -> float:
        """Output before the first good step: safe, or what is nearest to 0 with the defaults."""
        if m.c in self.safe:
            return self.safe[m.c]
        lo, hi, *_ = self.ends([m], self.block.param_values())
        return min(max(0.0, float(lo.max())), float(hi.min()))

    def follows(self, members: Iterable[Member]) -> bool:
        """Whether an end of a range of these is an expression of parameters."""
        return any(b.what in ("lo", "hi") for m in members for b in m.signal.bounds)

    @property
    def safe(self) -> dict[str, float]:
        """Safe value by the C name of each output that states one."""
        return {m.c: float(m.signal.safe) for m in self.layout.outputs if m.signal.safe is not None}

    @property
    def can_fail(self) -> bool:
        """Whether the equations say if they came to an end (a solver may not)."""
        return bool(self.equations.static)

    @cached_property
    def untested(self) -> list[tuple[Member, str, int]]:
        """Elements of results that may come out NaN or infinite: member, pointer, number.

        Of what is written several times, such as an output of a part that leaves the controller
        too, there is one.
        """
        made, found, seen = self.equations, [], set[str]()
        for i, (m, pointer) in enumerate(self.results):
            for k in range(m.size):
                text = str(made.results[i, k])
                tested = pointer == "next->" and self.ranged(m)
                sure = (i, k) in made.finite or self.layout.kind(m, self.real) != self.real
                if text not in seen and not sure and not tested:
                    found.append((m, pointer, k))
                seen.add(text)
        return found

    @cached_property
    def start(self) -> Writer:
        """Derived parameters, then start values, as functions of the free parameters.

        What is a plain number has the result 0 here; it is written as a constant instead.
        """
        block, lay = self.block, self.layout
        symbols = {m.name: ca.SX.sym("p", *matrix(m.signal)) for m in lay.params}
        waiting = {n: s.value for n, s in block.states.items() if isinstance(s.value, str)}
        numbers = {
            n: ca.DM(constant(s, s.value)) for n, s in block.states.items() if n not in waiting
        }
        known = block._solved(waiting, {**block.derive(symbols), **numbers}, start=True)
        results = []
        for m in (*lay.derived, *lay.states):
            value = known[m.name] if m.signal.derived else 0.0
            results.append(dense_value(block, m.signal, ca.SX(value)))
        f = ca.Function("start", list(symbols.values()), results, {"cse": True})
        return Writer(f, lambda i, k: lay.params[i].node("param->", k)).run()

    def start_lines(self, members: tuple[Member, ...], first: int, pointer: str) -> list[Node]:
        """Statements that compute derived parameters or start values from expressions."""
        at = dict(self.start.results)
        given: list[Node] = []
        for i, m in enumerate(members, start=first):
            if not m.signal.derived:
                continue
            values = [self.start.result(at[i, k]) for k in range(m.size)]
            if m.size > 2 and all(v == values[0] for v in values):
                array = expression(f"{pointer}{m.c}")
                given.append(c.do(c.call("fill", [array, c.integer(m.size), values[0]])))
            elif len(m.signal.shape) == 2 and of_each_copy(values, m.signal.shape[0]):
                given += started_copies(m, pointer, values)
            else:
                given += [c.assign(m.node(pointer, k), v) for k, v in enumerate(values)]
        return roll_lines([*c.drop_unused(self.start.lines, given), *given], set(), sort=True)

    def part_docs(self) -> Iterator[tuple[str, Block]]:
        """Path and block of each part that has a text."""
        for path, leaf in self.block.leaves():
            if leaf is not self.block and leaf.doc:
                yield path, leaf


def _declared(text: str) -> Node:
    """A parameter of a function."""
    (found,) = code(f"{text};")
    return found


def _tightest(m: Member, what: str, given: list[Any]) -> Any:
    """The end of a range that holds where there are several, of which some are expressions."""
    tightest = given[0]
    for v in given[1:]:
        other = v > tightest if what in ("lo", "noise") else v < tightest
        tightest = ca.if_else(other, v, tightest)
    # parameters in their ranges may still turn the range round
    if what == "lo" and math.isfinite(m.signal.hi):
        tightest = ca.fmin(tightest, m.signal.hi)
    if what == "hi" and math.isfinite(m.signal.lo):
        tightest = ca.fmax(tightest, m.signal.lo)
    return tightest


def _element(value: Any, k: int) -> Any:
    """Element of a number, an array or a symbol; one number stands for all."""
    if isinstance(value, ca.SX):
        return value[k] if value.numel() > 1 else value
    flat = np.asarray(value, dtype=float).ravel(order="F")
    return flat[k] if flat.size > 1 else flat[0]


def _literal(value: float, real: str) -> str:
    return number(float(round_to_real(value, real)))
