"""The walk over the instructions of equations that does their unit algebra; ``check`` does it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

from slipctl.block.text import formula
from slipctl.block.text.plain_text import Text, cut
from slipctl.block.units.unit_algebra import Unit, unit
from slipctl.errors import BadInput

PLAIN = Unit(1.0, ())


def check(
    equations: Mapping[str, Any],
    given: Mapping[str, str],
    wanted: Mapping[str, str],
    names: Mapping[str, Any] | None = None,
) -> list[str]:
    """Do the unit algebra of equations, and tell where a metre meets a newton.

    Zero and infinity fit every unit; other literals are pure numbers.

    Args:
        equations: SX expressions by what stands left of the equals sign (``"omega'"``). Of a
            vector every element is checked, and the first that fails is told.
        given: units by name of the symbol.
        wanted: units by left-hand side.
        names: SX intermediate results by letter (see :func:`slipctl.block.text.formula.letters`).

    Returns:
        One line per error; none for a pass.

    Raises:
        BadInput: a unit cannot be read, or a symbol has none.
    """
    graph = formula.graph(equations, names)
    walk = _Walk(graph, given, [*given.values(), *wanted.values()])
    targets = {k: unit(w) for k, w in wanted.items()}
    for n in graph.below([n for root in graph.roots.values() for n in root]):
        walk.visit(n)
    wrong = {
        k: [n for n in root if k in targets and (u := walk.units[n]) and not u.same(targets[k])]
        for k, root in graph.roots.items()
    }
    if not walk.errors and not any(wrong.values()):
        return []
    parts = [(graph.letters[n], [n]) for _, n in formula.named_nodes(graph)]
    parts += list(graph.roots.items())
    named = set(graph.letters)
    formula.shorten(graph)
    write = Text(graph)
    told: set[int] = set()
    lines = []
    for label, root in parts:
        for n in root:
            where = f"in {cut(label.removesuffix(' =') + ' = ' + write.root(n), 90)}: "
            inside = graph.below([n], named)  # what is behind a letter is told of that letter
            new = [e for e in inside if e in walk.errors and e not in told]
            told.update(new)
            lines += [where + walk.errors[e](write) for e in new]
            if not new and n in wrong.get(label, []):
                hint = walk.hint(n)
                lines.append(f"{where}this is [{walk.say(n)}], not [{targets[label]}]{hint}")
                new = [n]
            if new:
                break
    return lines


def infer(equations: Mapping[str, Any], given: Mapping[str, str]) -> dict[str, str]:
    """Units of equations without errors, ``{"mu": "1"}``; what fits every unit is a pure number.

    Args:
        equations, given: as of :func:`check`.
    """
    graph = formula.graph(equations)
    walk = _Walk(graph, given, list(given.values()))
    for n in graph.below([n for root in graph.roots.values() for n in root]):
        walk.visit(n)
    return {k: walk.say(root[0]) for k, root in graph.roots.items()}


_EQUAL = {
    "add": "{a} cannot be added to {b}", "sub": "{b} cannot be subtracted from {a}",
    "fmin": "{a} and {b} have no common minimum", "fmax": "{a} and {b} have no common maximum",
    "fmod": "{a} cannot be divided by {b} for a remainder",
    "remainder": "{a} cannot be divided by {b} for a remainder",
    "hypot": "{a} and {b} are no sides of one triangle",
    "atan2": "{a} and {b} span no angle",
    **dict.fromkeys(("lt", "le", "eq", "ne"), "{a} cannot be compared with {b}"),
}  # fmt: skip
"""Operations on two values of one unit, and what to say when the units differ."""

_KEEPS = ("assign", "neg", "twice", "fabs", "lift")
_NUMBER = ("atan2", "lt", "le", "eq", "ne", "not", "and", "or", "sign")
_PURE = (
    "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh",
    "acosh", "atanh", "erf", "erfinv", "log1p", "expm1", "floor", "ceil",
)  # fmt: skip
_Message = Callable[[Any], str]


class _Walk:
    """Units of the nodes of a graph; None fits everything (zero, infinity, or told already)."""

    def __init__(self, graph: formula.Graph, given: Mapping[str, str], texts: list[str]) -> None:
        self.graph, self.given = graph, given
        self.units: dict[int, Unit | None] = {}
        self.errors: dict[int, _Message] = {}
        self.known: list[Unit] = []
        for u in map(unit, texts):
            angle = any(n in ("rad", "deg", "%", "rpm") for n, _ in u.names)
            if not angle and not any(u.same(k) for k in self.known):
                self.known.append(u)

    def visit(self, n: int) -> None:
        """Find the unit of a node whose arguments have been visited."""
        op, args, value, name = self.graph.nodes[n]
        units = [self.units[a] for a in args]
        first = units[0] if units else None
        result: Unit | None = None
        if op == "symbol":
            result = self.symbol(name)
        elif op == "const":
            result = PLAIN if math.isfinite(value) and value != 0.0 else None
        elif op in _EQUAL:
            second = units[1]
            if first and second and not first.same(second):
                self.errors[n] = lambda write: self.differ(write, n)
            elif op in _NUMBER:
                result = PLAIN
            else:
                result = first or second
        elif op in _KEEPS:
            result = first
        elif op in _NUMBER:
            result = PLAIN
        elif op in _PURE:
            result = PLAIN
            self.pure(n, args[0], op)
        elif op == "copysign":
            result = first
        elif op == "if_else_zero":
            result = units[1]
        elif op in ("mul", "div"):
            if first and units[1]:
                result = first * units[1] if op == "mul" else first / units[1]
        elif op in ("constpow", "pow"):
            result = self.power(n, args, units)
        elif op in ("sq", "sqrt", "inv") and first:
            result = first ** {"sq": Fraction(2), "sqrt": Fraction(1, 2), "inv": Fraction(-1)}[op]
        self.units[n] = result

    def symbol(self, name: str) -> Unit:
        if hidden := formula.HIDDEN.fullmatch(name):
            return unit(hidden[1])
        for candidate in (name, re.sub(r"_\d+$", "", name)):
            if candidate in self.given:
                return unit(self.given[candidate])
        raise BadInput(f"the symbol {name!r} of an equation has no unit")

    def power(self, n: int, args: tuple[int, ...], units: list[Unit | None]) -> Unit | None:
        exponent = self.graph.nodes[args[1]]
        if exponent.op == "const":
            base = units[0]
            if base is None or not math.isfinite(exponent.value):
                return None
            return base ** Fraction(exponent.value).limit_denominator(1000)
        self.pure(n, args[1], "the exponent")
        self.pure(n, args[0], "the base of a variable power")
        return PLAIN

    def pure(self, n: int, arg: int, what: str) -> None:
        u = self.units[arg]
        if u is not None and not u.plain and n not in self.errors:
            self.errors[n] = lambda write: f"{what} takes a pure number, {self.quote(write, arg)}"

    def differ(self, write: Any, n: int) -> str:
        op, args, *_ = self.graph.nodes[n]
        values, text = list(args), _EQUAL[op]
        if op == "add" and (branches := write.branches(n, top=True)):
            every = [*(v for _, v in branches[0]), branches[1]]
            values = [v for v in every if v is not None][:2]
            text = "{a} and {b} are no two branches of one if"
        a, b = (self.quote(write, v) for v in values)
        return text.format(a=a, b=b) + (self.hint(values[0]) or self.hint(values[1]))

    def hint(self, n: int) -> str:
        node = self.graph.nodes[n]
        literal = node.op == "const" and math.isfinite(node.value) and node.value != 0.0
        return "; give the number its unit, as a Param or by one('...')" if literal else ""

    def quote(self, write: Any, n: int) -> str:
        return f"'{cut(write.at(n)[0], 40)}' [{self.say(n)}]"

    def say(self, n: int) -> str:
        """Text of a node's unit, in the words of the block where it has them."""
        u = self.units[n]
        if u is None or u.names:
            return str(u or "1")
        return next((str(k) for k in self.known if k.same(u)), str(u))
