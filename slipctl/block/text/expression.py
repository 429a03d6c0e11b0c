"""Expressions that a person wrote: read by Python's grammar, computed node by node.

Nothing is ever run as Python. What the grammar gives is looked through first: numbers, names,
arithmetic, comparisons, ``a if c else b`` and the functions below are allowed, all else is told
with its column. The same tree is then computed on numbers or on CasADi symbols.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.smooth import root
from slipctl.block.units.unit_algebra import one, unit
from slipctl.errors import BadInput, Faults, check_number, has_many, nearest, value_text

LONGEST = 2000
"""Characters of one expression; Python's parser is slow or gives up beyond."""

DEEPEST = 200
"""Levels of an expression; a sum of so many terms has as many."""

FUNCTIONS: dict[str, tuple[int, int, str]] = {
    **dict.fromkeys(
        ("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh",
         "sign", "floor", "ceil", "fabs"), (1, 1, "x")),
    "abs": (1, 1, "x"), "root": (1, 1, "x"), "atan2": (2, 2, "y, x"), "fmod": (2, 2, "a, b"),
    "fmin": (2, 2, "a, b"), "fmax": (2, 2, "a, b"),
    "min": (2, 99, "a, b, ..."), "max": (2, 99, "a, b, ..."), "clip": (3, 3, "x, lo, hi"),
    "interp": (3, 3, "x, [x1, x2, ...], [y1, y2, ...]"), "one": (1, 1, "'unit'"),
}  # fmt: skip
"""Functions of an expression: fewest and most arguments, and how it is called."""

CONSTANTS = {"pi": math.pi}
"""Names that have a value of their own."""

_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip

_REFUSED: dict[type[ast.AST], str] = {
    ast.BitXor: "^ is no power here; write **",
    ast.Mod: "% has two meanings; write fmod(a, b)",
    ast.FloorDiv: "// has no place here; write floor(a/b)",
    ast.BitAnd: "& has no place here; write and",
    ast.BitOr: "| has no place here; write or",
    ast.Invert: "~ has no place here; write not",
    ast.Attribute: "a name has no dot here",
    ast.Subscript: "an index has no place here",
    ast.Lambda: "lambda has no place here",
    ast.NamedExpr: ":= has no place here; give it an equation of its own",
    ast.Tuple: "a comma has no place here; a number has a decimal point",
    ast.List: "a list has its place in interp(x, [x1, x2], [y1, y2]) only",
    ast.JoinedStr: "a text has no place here",
}
_PASTED = {
    "\u2212": "write -", "\u2013": "write -", "\u00b7": "write *", "\u22c5": "write *",
    "\u00d7": "write *", "\u00f7": "write /", "\u00b2": "write **2", "\u00b3": "write **3",
    "\u2264": "write <=", "\u2265": "write >=", "\u2260": "write !=", "\u2019": "write '",
}  # fmt: skip
"""What is pasted from a paper, and how it is written here."""

_ALLOWED = "numbers, names, + - * / **, comparisons, and, or, not, a if c else b and functions"


@dataclass(frozen=True)
class Expression:
    """An expression that was read; ``value`` computes it.

    Attributes:
        text: as it was written.
        tree: what it is made of.
        names: names that it uses, functions and constants left out, in order.
    """

    text: str
    tree: ast.expr
    names: tuple[str, ...]

    def value(
        self,
        values: Mapping[str, Any],
        calls: Mapping[str, Callable[..., Any]] | None = None,
        seen: Callable[[ast.expr, Any], None] | None = None,
    ) -> Any:
        """Compute it on numbers or on CasADi symbols.

        Args:
            values: by name.
            calls: functions of one argument beside :data:`FUNCTIONS`, tables say.
            seen: told the value of each part, the innermost first.
        """
        return _Walk(values, calls or {}, seen).value(self.tree)


@lru_cache(maxsize=4096)
def read(text: str, calls: frozenset[str] = frozenset()) -> Expression:
    """Read an expression.

    Args:
        text: ``"c*(exp(-a*v_s) - exp(-b*v_s))"``.
        calls: names of further functions of one argument.

    Raises:
        Faults: each with its column.
    """
    if len(text) > LONGEST:
        raise Faults([f"it has {len(text)} characters, at most {LONGEST} are read; split it up"])
    strange = next((k for k, c in enumerate(text) if not (c.isascii() and c.isprintable())), None)
    if strange is not None:
        told = f"column {strange + 1}: {text[strange]!a} is no letter of a name or a number here"
        raise Faults([f"{told}; {_PASTED.get(text[strange], 'write names in a..z, 0..9 and _')}"])
    lead = len(text) - len(text.lstrip())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        raise Faults([_syntax(text, error, lead)]) from None
    except (ValueError, MemoryError, RecursionError, OverflowError):
        raise Faults(["it is nested too deeply, or has too long a number"]) from None
    if _deep(tree):
        raise Faults([f"it is nested more than {DEEPEST} deep; give parts of it their own names"])
    look = _Look(calls, lead)
    look.at(tree)
    if look.faults:
        raise Faults([f"column {k}: {said}" for k, said in sorted(set(look.faults))])
    for node in ast.walk(tree):
        if isinstance(node, ast.expr):
            node.col_offset += lead
    return Expression(text, tree, tuple(dict.fromkeys(look.names)))


def _syntax(text: str, error: SyntaxError, lead: int) -> str:
    column = min((error.offset or 1) + lead, len(text) + 1)
    said = error.msg.partition(".")[0]
    if not text.strip():
        return "there is no expression"
    here = text[column - 1 : column + 11].strip()
    if re.search(r"[\w)]\s*$", text[: column - 1]) and re.match(r"[\w(]", here):
        said = "write * for a product"
    elif re.match(r"[\d.]+(e[+-]?\d+)?\s+[A-Za-z]", here):
        said = "a number has no unit here; make it a parameter"
    return f"column {column}: {said}" + (f", at {here!r}" if here else ", at its end")


def _deep(tree: ast.expr) -> bool:
    level: list[ast.AST] = [tree]
    for _ in range(DEEPEST):
        level = [c for node in level for c in ast.iter_child_nodes(node) if isinstance(c, ast.expr)]
        if not level:
            return False
    return True


class _Look:
    """Looks through a tree: what is not allowed, names, and numbers that are none."""

    def __init__(self, calls: Iterable[str], lead: int) -> None:
        self.calls, self.lead = frozenset(calls), lead
        self.faults: list[tuple[int, str]] = []
        self.names: list[str] = []

    def wrong(self, node: ast.AST, said: str) -> None:
        self.faults.append((getattr(node, "col_offset", 0) + self.lead + 1, said))

    def at(self, node: ast.expr, condition: bool = False) -> bool:
        """Look through a node; gives whether it is a constant."""
        before = len(self.faults)
        constant = self._at(node)
        truth = isinstance(node, (ast.Compare, ast.BoolOp)) or (
            isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
        )
        if condition and not truth and len(self.faults) == before:
            self.wrong(node, "a condition is a comparison, such as x > 0")
        if constant and len(self.faults) == before:
            self.number(node)
        return constant

    def number(self, node: ast.expr) -> None:
        """Refuse a constant that is no finite number."""
        try:
            result = _Walk({}, {}, None).value(node)
            fine = not isinstance(result, complex) and math.isfinite(float(result))
        except (ArithmeticError, ValueError, TypeError, RuntimeError, NotImplementedError):
            fine = False
        if not fine:
            self.wrong(node, "it cannot be computed, it is no finite number")

    def _at(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
                self.wrong(node, f"{str(node.value)[:20]!a} is no number")
            return True
        if isinstance(node, ast.Name):
            if node.id in CONSTANTS:
                return True
            if node.id in FUNCTIONS or node.id in self.calls:
                self.wrong(node, f"{node.id} is a function; write {_usage(node.id)}")
            self.names.append(node.id)
            return False
        if isinstance(node, ast.UnaryOp):
            if isinstance(node.op, ast.Not):
                self.at(node.operand, condition=True)
                return False
            if type(node.op) not in _UNARY:
                self.wrong(node, _REFUSED[type(node.op)])
            return self.at(node.operand)
        if isinstance(node, ast.BinOp):
            if type(node.op) not in _BINARY:
                told = _REFUSED.get(type(node.op), f"an operation that is none of {_ALLOWED}")
                self.wrong(node, told)
            return all([self.at(node.left), self.at(node.right)])
        if isinstance(node, ast.BoolOp):
            for v in node.values:
                self.at(v, condition=True)
            return False
        if isinstance(node, ast.Compare):
            for op in node.ops:
                if type(op) not in _COMPARE:
                    self.wrong(node, "compare with <, <=, >, >=, == or !=")
            for v in (node.left, *node.comparators):
                self.at(v)
            return False
        if isinstance(node, ast.IfExp):
            self.at(node.test, condition=True)
            self.at(node.body)
            self.at(node.orelse)
            return False
        if isinstance(node, ast.Call):
            return self.call(node)
        self.wrong(node, _REFUSED.get(type(node), f"only {_ALLOWED} have a place here"))
        return False

    def call(self, node: ast.Call) -> bool:
        if not isinstance(node.func, ast.Name):
            self.wrong(node, _REFUSED.get(type(node.func), "only a function by its name is called"))
            return False
        name = node.func.id
        if name not in FUNCTIONS and name not in self.calls:
            close = nearest(name, [*self.calls, *FUNCTIONS])
            self.wrong(node, f"there is no function {name}{close}")
        for keyword in node.keywords:
            self.wrong(keyword.value, f"{name} takes no names; write {_usage(name)}")
        few, most, _ = FUNCTIONS.get(name, (1, 1, "x"))
        known = name in FUNCTIONS or name in self.calls
        if known and not node.keywords and not few <= len(node.args) <= most:
            self.wrong(node, f"{name} with {len(node.args)} arguments; write {_usage(name)}")
            return False
        if name == "one":
            return self.unit(node.args[0])
        if name == "interp" and len(node.args) == 3:
            return self.interp(node)
        fixed = [self.at(a) for a in node.args]  # each is looked through
        return all(fixed) and name in FUNCTIONS

    def unit(self, node: ast.expr) -> bool:
        if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
            self.wrong(node, "one takes a unit in quotes, one('m/s')")
            return False
        try:
            unit(node.value)
        except BadInput as error:
            self.wrong(node, str(error))
        return False

    def interp(self, node: ast.Call) -> bool:
        self.at(node.args[0])
        lists = [a.elts if isinstance(a, ast.List) else None for a in node.args[1:]]
        xs, ys = lists
        if xs is None or ys is None or len(xs) != len(ys) or len(xs) < 2:
            self.wrong(node, "interp takes two lists of two or more, equally long; write "
                       + _usage("interp"))  # fmt: skip
            return False
        fixed = [self.at(x) for x in xs]
        for y in ys:
            self.at(y)
        if all(fixed) and not self.faults:
            at = [float(_Walk({}, {}, None).value(x)) for x in xs]
            if any(b <= a for a, b in pairwise(at)):
                self.wrong(node, "interp: the places x1, x2, ... must increase")
        return False


def _usage(name: str) -> str:
    return f"{name}({FUNCTIONS.get(name, (1, 1, 'x'))[2]})"


class _Walk:
    """Computes the nodes of a tree that was looked through."""

    def __init__(
        self,
        values: Mapping[str, Any],
        calls: Mapping[str, Callable[..., Any]],
        seen: Callable[[ast.expr, Any], None] | None,
    ) -> None:
        self.values, self.calls, self.seen = values, calls, seen

    def value(self, node: ast.expr) -> Any:
        found = self._value(node)
        if self.seen is not None:
            self.seen(node, found)
        return found

    def _value(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return float(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.Name):
            own = self.values.get(node.id)
            return CONSTANTS[node.id] if own is None and node.id in CONSTANTS else own
        if isinstance(node, ast.BinOp):
            return _BINARY[type(node.op)](self.value(node.left), self.value(node.right))
        if isinstance(node, ast.Call):
            return self.call(node)
        if isinstance(node, ast.UnaryOp):
            inner = self.value(node.operand)
            if isinstance(node.op, ast.Not):
                return ca.logic_not(inner)
            return _UNARY[type(node.op)](inner)
        if isinstance(node, ast.Compare):
            values = [self.value(v) for v in (node.left, *node.comparators)]
            found = [
                _COMPARE[type(op)](a, b)
                for op, a, b in zip(node.ops, values, values[1:], strict=False)
            ]
            return reduce(ca.logic_and, found)
        if isinstance(node, ast.BoolOp):
            both = ca.logic_and if isinstance(node.op, ast.And) else ca.logic_or
            return reduce(both, [self.value(v) for v in node.values])
        assert isinstance(node, ast.IfExp)
        return ca.if_else(self.value(node.test), self.value(node.body), self.value(node.orelse))

    def call(self, node: ast.Call) -> Any:
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        if name == "one":
            assert isinstance(node.args[0], ast.Constant)
            return one(str(node.args[0].value))
        if name == "interp":
            xs, ys = ([self.value(e) for e in a.elts] for a in node.args[1:]
                      if isinstance(a, ast.List))  # fmt: skip
            return interpolated(self.value(node.args[0]), xs, ys)
        args = [self.value(a) for a in node.args]
        if name in self.calls:
            return self.calls[name](*args)
        if name in ("min", "max"):
            return reduce(ca.fmin if name == "min" else ca.fmax, args)
        if name == "clip":
            return ca.fmin(ca.fmax(args[0], args[1]), args[2])
        if name == "root":
            return root(*args)
        return getattr(ca, "fabs" if name == "abs" else name)(*args)


def interpolated(x: Any, xs: Any, ys: Any) -> Any:
    """Straight lines through points, the ends held: a table in the equations of a block.

    y = y_1 + sum_k s_k min(max(x - x_k, 0), x_k+1 - x_k), s_k the slope behind x_k. There is no
    search and no index, so it differentiates and runs in C, in float too. Where a number is NaN, so
    is the height; in equations, a run and the C refuse the input or state that is NaN.

    A table over two axes is ``interpolated((x, z), (xs, zs), ys)``, with a row of ``ys`` for each
    place of x and a column for each of z. Lines go along z in each row, then along x.

    Args:
        x: number or expression, or two of them.
        xs: places, which rise, or those of both axes.
        ys: heights over them, as many, or a matrix. All are numbers, or parameters of a shape.

    Raises:
        BadInput: places that do not rise, or heights of another number.
    """
    if isinstance(x, tuple | list):
        return _over_two(x, xs, ys)
    if isinstance(x, (float, int)):
        check_number("interpolated: the place", x)
    numbers = isinstance(x, (float, int, np.number)) or getattr(x, "dtype", "x") in (float, int)
    if not isinstance(x, (ca.SX, ca.MX, ca.DM)) and not numbers:
        raise BadInput(f"interpolated: {type(x).__name__} is no number and no expression")
    xs, ys = _places(xs), _points(ys)
    if len(xs) != len(ys):
        raise BadInput(f"interpolated: {len(xs)} places and {len(ys)} values; give as many of both")
    found = ys[0]
    for k in range(len(xs) - 1):
        wide = xs[k + 1] - xs[k]
        found = found + (ys[k + 1] - ys[k]) / wide * ca.fmin(ca.fmax(x - xs[k], 0.0), wide)
    return _with_holes(found, x)


def _over_two(x: Any, xs: Any, ys: Any) -> Any:
    """Heights over two axes: the ramps of each axis, from 0 to 1, are the same for all rows."""
    if len(x) != 2 or not isinstance(xs, tuple | list) or len(xs) != 2:
        raise BadInput("interpolated: give one number and its places, or two and those of both")
    axes = [_places(places) for places in xs]
    if isinstance(ys, ca.SX | ca.MX | ca.DM):
        rows = [ca.horzsplit(row) for row in ca.vertsplit(ys)]
    else:
        rows = [_points(row) for row in _points(ys)]
    if [len(rows), *{len(row) for row in rows}] != [len(places) for places in axes]:
        raise BadInput(
            f"interpolated: {len(rows)} rows of {', '.join(sorted({str(len(r)) for r in rows}))}"
            f" values over {len(axes[0])} and {len(axes[1])} places; give a row for each of the"
            " first and a value in it for each of the second"
        )
    first, second = (
        [ca.fmin(ca.fmax(at - a, 0.0), b - a) / (b - a) for a, b in pairwise(places)]
        for at, places in zip(x, axes, strict=True)
    )

    def line(heights: list[Any], shares: list[Any]) -> Any:
        rises = [(b - a) * s for (a, b), s in zip(pairwise(heights), shares, strict=True)]
        return sum(rises, heights[0])

    return _with_holes(_with_holes(line([line(row, second) for row in rows], first), x[0]), x[1])


def _with_holes(found: Any, x: Any) -> Any:
    """NaN where a number is: fmin and fmax pass over it. An expression stays as it is."""
    if isinstance(x, float | int | np.number):
        return found if x == x else math.nan
    return found if isinstance(x, ca.SX | ca.MX) else ca.if_else(x != x, x, found)


def _points(given: Any) -> list[Any]:
    if isinstance(given, ca.SX | ca.MX | ca.DM):
        return ca.vertsplit(given)
    if isinstance(given, str) or not has_many(given):
        raise BadInput(f"interpolated: {value_text(given)} is no list of numbers")
    return list(given)


def _places(given: Any) -> list[Any]:
    places = _points(given)
    if not places:
        raise BadInput("interpolated: no places; give at least one")
    if odd := [p for p in places if isinstance(p, str | bytes)]:
        raise BadInput(f"interpolated: the place {odd[0]!r} is no number")
    for a, b in pairwise(places):
        if isinstance(a, int | float) and isinstance(b, int | float) and not b > a:
            raise BadInput(f"interpolated: the place {b:g} comes after {a:g}; give them rising")
    return places
