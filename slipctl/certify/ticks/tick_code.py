"""A tick as a list of operations: read from a person's Python or CasADi, enclosed, differentiated.

A tick that is run on numbers says what it does to these numbers. A proof needs what it does to all
of a set. So the tick is read once into operations, and these are the object of every proof. They
are evaluated on floats, on intervals of decimals (``decimal_intervals.Interval``) and on arrays of
intervals (``interval_arrays.Boxes``), and differentiated on the latter two.

All in exact arithmetic: a float literal is the rational that its bits are, and the rounding of the
processor that runs the tick is not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import exact
from slipctl.certify.entries import DoesNotHold, rows, whole
from slipctl.errors import BadInput

OPERATIONS: dict[str, int] = {
    "add": 2, "sub": 2, "mul": 2, "div": 2, "neg": 1, "sq": 1, "abs": 1, "min": 2, "max": 2,
    "sqrt": 1, "exp": 1, "ln": 1, "atan": 1, "less": 2, "less_equal": 2, "equal": 2, "choose": 3,
}  # fmt: skip
"""Operations and how many values each takes; ``choose`` is (condition, where true, where false)."""

MOST_STEPS = 50_000
"""Most operations of a tick."""


OPEN = ""
"""In the place of a slope: why there is none."""


class OpenJump(DoesNotHold):
    """A condition that is open over a set, so that the tick jumps there and has no slope."""


@dataclass(frozen=True)
class TickCode:
    """Operations of a tick.

    Attributes:
        inputs: names of its values at the beginning of the tick.
        steps: (operation, numbers of earlier values), or ("const", a rational). Values are counted
            through, inputs first.
        outputs: number of the value by the name of what is given.
    """

    inputs: tuple[str, ...]
    steps: tuple[tuple[Any, ...], ...]
    outputs: Mapping[str, int]

    def values(self, given: Mapping[str, Any]) -> list[Any]:
        """Every value of the tick, of enclosures by name (scalars, or arrays of boxes)."""
        found: list[Any] = [given[name] for name in self.inputs]
        like: Any = found[0] if found else None
        for operation, *args in self.steps:
            if operation == "const":
                found.append(like.number(args[0]))
            elif operation in ("mul", "div") and args[0] == args[1]:
                a = found[args[0]]
                found.append(a.sq() if operation == "mul" else a / a)
            else:
                found.append(_RULES[operation](*(found[i] for i in args)))
        return found

    def run(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """What the tick gives, of enclosures by name."""
        found = self.values(given)
        return {name: found[i] for name, i in self.outputs.items()}

    def slopes(
        self, given: Mapping[str, Any], by: Sequence[str]
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """What the tick gives, and enclosures of its slopes by inputs; what is left out is zero.

        Where the tick bends (``abs``, ``min``, ``max``) a slope is the hull of both sides, so that
        the mean value theorem holds with it.

        Raises:
            OpenJump: a condition is open over the set.
        """
        found = self.values(given)
        like = found[0]
        one = like.number(1)
        slopes: list[dict[str, Any]] = [{n: one} if n in by else {} for n in self.inputs]
        needed = self._needed()
        for k, (operation, *args) in enumerate(self.steps):
            at = len(self.inputs) + k
            if operation == "const" or at not in needed or not any(slopes[i] for i in args):
                slopes.append({})
                continue
            parts = [found[i] for i in args]
            slopes.append(self._slope(operation, args, parts, found[at], slopes, k))
        for i in self.outputs.values():
            if OPEN in slopes[i]:
                raise OpenJump(slopes[i][OPEN])
        return (
            {n: found[i] for n, i in self.outputs.items()},
            {n: slopes[i] for n, i in self.outputs.items()},
        )

    def _slope(
        self, operation: str, args: Sequence[int], parts: Sequence[Any], value: Any,
        slopes: Sequence[Mapping[str, Any]], k: int,
    ) -> dict[str, Any]:  # fmt: skip
        if operation in ("less", "less_equal", "equal"):
            return {} if value.decided() else {OPEN: f"condition {self.spelled(k)} is open"}
        if operation == "choose":
            if not parts[0].decided():
                spelled = self.spelled(args[0] - len(self.inputs))
                return {OPEN: slopes[args[0]].get(OPEN, f"condition {spelled} is open")}
            return _chosen(parts[0], slopes[args[1]], slopes[args[2]])
        for i in args:
            if OPEN in slopes[i]:
                return {OPEN: slopes[i][OPEN]}
        if operation == "sqrt" and parts[0].touches_zero():
            return {OPEN: f"the root {self.spelled(k)} comes to zero, where it has no slope"}
        weights = _WEIGHTS[operation](parts, value)
        total: dict[str, Any] = {}
        for i, weight in zip(args, weights, strict=True):
            for name, slope in slopes[i].items():
                term = slope if weight is None else slope * weight
                total[name] = total[name] + term if name in total else term
        return total

    def _needed(self) -> set[int]:
        """Numbers of the values on which an output depends."""
        needed = set(self.outputs.values())
        for k in range(len(self.steps) - 1, -1, -1):
            operation, *args = self.steps[k]
            if len(self.inputs) + k in needed and operation != "const":
                needed.update(args)
        return needed

    def depends(self) -> set[str]:
        """Inputs on which what it gives depends."""
        needed = self._needed()
        return {name for i, name in enumerate(self.inputs) if i in needed}

    def without_unused(self, states: Sequence[str] = ()) -> TickCode:
        """The tick without inputs on which nothing depends; those of some states stay."""
        used = self.depends()
        keep = [
            i for i, k in enumerate(self.inputs) if k in used or (k[:2] == "x_" and k[2:] in states)
        ]
        to = {i: k for k, i in enumerate(keep)}
        steps = []
        for k, (operation, *args) in enumerate(self.steps):
            to[len(self.inputs) + k] = len(keep) + k
            steps.append((operation, *(args if operation == "const" else (to[i] for i in args))))
        return TickCode(tuple(self.inputs[i] for i in keep), tuple(steps),
                        {n: to[i] for n, i in self.outputs.items()})  # fmt: skip

    def spelled(self, k: int, depth: int = 3) -> str:
        """Operation as a person writes it, its parts to some depth."""
        if k < 0:
            return self.inputs[k + len(self.inputs)]
        operation, *args = self.steps[k]
        if operation == "const":
            return f"{float(args[0]):.6g}"
        if depth == 0:
            return "..."
        parts = [self.spelled(i - len(self.inputs), depth - 1) for i in args]
        sign = _SIGNS.get(operation)
        if sign:
            return f"({parts[0]} {sign} {parts[1]})"
        return f"{operation}({', '.join(parts)})"

    def compiled(self, arrays: bool = False) -> Callable[..., tuple[Any, ...]]:
        """The tick on floats, or on arrays of them, inputs in order; rounded, so no proof."""
        texts = {**_TEXTS, **_OF_ARRAYS} if arrays else _TEXTS
        names = [f"x{i}" for i in range(len(self.inputs) + len(self.steps))]
        rows = [f"def tick({', '.join(names[: len(self.inputs)])}):"]
        for k, (operation, *args) in enumerate(self.steps):
            to = names[len(self.inputs) + k]
            if operation == "const":
                rows.append(f"  {to} = {float(args[0])!r}")
            else:
                rows.append(f"  {to} = {texts[operation].format(*(names[i] for i in args))}")
        rows.append(f"  return ({', '.join(names[i] for i in self.outputs.values())},)")
        scope: dict[str, Any] = {"np": np, "math": math}
        exec("\n".join(rows), scope)  # its text is made of numbers and operations of this module
        return scope["tick"]

    def payload(self) -> dict[str, Any]:
        """Entries of a file."""
        steps = [[o, str(a[0])] if o == "const" else [o, *a] for o, *a in self.steps]
        return {"inputs": list(self.inputs), "steps": steps, "outputs": dict(self.outputs)}


def read_code(given: Any) -> TickCode:
    """Operations of a file.

    Raises:
        BadInput: it holds none.
    """
    if not isinstance(given, Mapping) or set(given) != {"inputs", "steps", "outputs"}:
        raise BadInput("a tick has inputs, steps and outputs")
    inputs = rows(given["inputs"], "tick.inputs", 1000)
    if not inputs or not all(isinstance(n, str) and n.isidentifier() for n in inputs):
        raise BadInput("tick.inputs must be names")
    if len(set(inputs)) != len(inputs):
        raise BadInput("tick.inputs holds a name twice")
    steps: list[tuple[Any, ...]] = []
    for k, step in enumerate(rows(given["steps"], "tick.steps", MOST_STEPS)):
        operation, *args = step if isinstance(step, list) and step else (None,)
        if operation == "const" and len(args) == 1:
            steps.append(("const", _rational(args[0])))
        elif operation in OPERATIONS and len(args) == OPERATIONS[operation]:
            last = len(inputs) + k - 1
            steps.append((operation, *(whole(a, "tick.steps", 0, last) for a in args)))
        else:
            raise BadInput(f"tick.steps[{k}] is no operation")
    outputs = given["outputs"]
    if not isinstance(outputs, Mapping) or not outputs:
        raise BadInput("tick.outputs must hold the number of a value by name")
    last = len(inputs) + len(steps) - 1
    return TickCode(tuple(inputs), tuple(steps),
                    {n: whole(i, "tick.outputs", 0, last) for n, i in outputs.items()})  # fmt: skip


def _rational(text: Any) -> Fraction:
    """A constant, which may be as long as that of a float."""
    try:
        if not isinstance(text, str) or len(text) > 800:
            raise ValueError
        return Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise BadInput('tick.steps: a constant is a rational, "3/2"') from None


# ---- rules --------------------------------------------------------------------------------------

_RULES: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b, "neg": lambda a: -a, "sq": lambda a: a.sq(),
    "abs": lambda a: a.absolute(), "min": lambda a, b: a.minimum(b),
    "max": lambda a, b: a.maximum(b), "sqrt": lambda a: a.sqrt(), "exp": lambda a: a.exp(),
    "ln": lambda a: a.ln(), "atan": lambda a: a.atan(), "less": lambda a, b: a.less(b),
    "less_equal": lambda a, b: a.less_equal(b), "equal": lambda a, b: a.equal(b),
    "choose": lambda c, a, b: c.choose(a, b),
}  # fmt: skip

_TEXTS = {
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}",
    "sq": "{0} * {0}", "abs": "abs({})", "min": "min({}, {})", "max": "max({}, {})",
    "sqrt": "math.sqrt({})", "exp": "math.exp({})", "ln": "math.log({})", "atan": "math.atan({})",
    "less": "({} < {}) * 1.0", "less_equal": "({} <= {}) * 1.0", "equal": "({} == {}) * 1.0",
    "choose": "{1} if {0} else {2}",
}  # fmt: skip

_OF_ARRAYS = {"min": "np.minimum({}, {})", "max": "np.maximum({}, {})", "sqrt": "np.sqrt({})",
              "exp": "np.exp({})", "ln": "np.log({})", "atan": "np.arctan({})",
              "choose": "np.where({}, {}, {})"}  # fmt: skip

_SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "less": "<", "less_equal": "<=",
          "equal": "=="}  # fmt: skip


def _chosen(condition: Any, yes: Mapping[str, Any], no: Mapping[str, Any]) -> dict[str, Any]:
    """Slopes of what a decided condition chooses; what it leaves out may jump."""
    one = condition.one_way()
    if one is not None:
        return dict(yes if one else no)
    for part in (yes, no):
        if OPEN in part:
            return {OPEN: part[OPEN]}
    zero = condition * 0
    return {n: condition.choose(yes.get(n, zero), no.get(n, zero)) for n in {**yes, **no}}


def _switch(parts: Sequence[Any]) -> tuple[Any, Any]:
    """Weights of min: where the first part is the smaller one, it counts."""
    first = parts[0].less_equal(parts[1])
    return first, 1 - first


_WEIGHTS: dict[str, Callable[[Sequence[Any], Any], tuple[Any, ...]]] = {
    "add": lambda p, y: (None, None),
    "sub": lambda p, y: (None, p[0].number(-1)),
    "mul": lambda p, y: (p[1], p[0]),
    "div": lambda p, y: (1 / p[1], -y / p[1]),
    "neg": lambda p, y: (p[0].number(-1),),
    "sq": lambda p, y: (2 * p[0],),
    "abs": lambda p, y: (1 - 2 * p[0].less(0),),
    "min": lambda p, y: _switch(p),
    "max": lambda p, y: _switch(p)[::-1],
    "sqrt": lambda p, y: (1 / (2 * y),),
    "exp": lambda p, y: (y,),
    "ln": lambda p, y: (1 / p[0],),
    "atan": lambda p, y: (1 / (p[0].sq() + 1),),
}


# ---- from CasADi --------------------------------------------------------------------------------

_PLAIN = {
    "OP_ADD": "add", "OP_SUB": "sub", "OP_MUL": "mul", "OP_DIV": "div", "OP_NEG": "neg",
    "OP_SQ": "sq", "OP_FABS": "abs", "OP_FMIN": "min", "OP_FMAX": "max", "OP_SQRT": "sqrt",
    "OP_EXP": "exp", "OP_LOG": "ln", "OP_ATAN": "atan",
    "OP_LT": "less", "OP_LE": "less_equal", "OP_EQ": "equal",
}  # fmt: skip
_OF_CASADI = {getattr(ca, name): operation for name, operation in _PLAIN.items()}
_NAMES = {getattr(ca, n): n[3:].lower() for n in dir(ca)
          if n.startswith("OP_") and isinstance(getattr(ca, n), int)}  # fmt: skip


def code_of_function(f: ca.Function, inputs: Sequence[str], outputs: Sequence[str]) -> TickCode:
    """Operations of a CasADi Function of one column with one dense column as result.

    Raises:
        BadInput: an operation that cannot be enclosed.
    """
    from slipctl.certify.arithmetic.enclosure import scalar_function

    f = scalar_function(f)
    writer = CodeWriter(inputs)
    work: dict[int, int] = {}
    zero = writer.const(0)
    found = [zero] * f.numel_out(0)
    for k in range(f.n_instructions()):
        op, args, to = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            found[to[1]] = work[args[0]]
            continue
        if op == ca.OP_CONST:
            work[to[0]] = writer.const(f.instruction_constant(k))
        elif op == ca.OP_INPUT:
            work[to[0]] = args[1]
        else:
            work[to[0]] = _of_casadi(writer, op, [work[a] for a in args])
    return writer.code(dict(zip(outputs, found, strict=True)))


def _of_casadi(writer: CodeWriter, op: int, a: Sequence[int]) -> int:
    """Value of an operation of CasADi.

    Raises:
        BadInput: it cannot be enclosed.
    """
    if op in _OF_CASADI:
        return writer.add(_OF_CASADI[op], *a)
    one, zero = writer.const(1), writer.const(0)
    if op == ca.OP_TWICE:
        return writer.add("add", a[0], a[0])
    if op == ca.OP_INV:
        return writer.add("div", one, a[0])
    if op == ca.OP_ASSIGN:
        return a[0]
    if op == ca.OP_IF_ELSE_ZERO:
        return writer.add("choose", a[0], a[1], zero)
    if op == ca.OP_NOT:
        return writer.add("equal", a[0], zero)
    if op == ca.OP_NE:
        return writer.add("sub", one, writer.add("equal", *a))
    if op == ca.OP_AND:
        return writer.add("choose", a[0], writer.add("choose", a[1], one, zero), zero)
    if op == ca.OP_OR:
        return writer.add("choose", a[0], one, writer.add("choose", a[1], one, zero))
    if op == ca.OP_SIGN:
        return writer.sign(a[0])
    if op in (ca.OP_CONSTPOW, ca.OP_POW):
        power = writer.constant(a[1])
        if power is not None and power.denominator == 1 and 0 <= power <= 16:
            return writer.power(a[0], int(power))
        if power == Fraction(1, 2):
            return writer.add("sqrt", a[0])
        if power is not None and power.denominator > 1:
            return writer.add("exp", writer.add("mul", a[1], writer.add("ln", a[0])))
    raise BadInput(
        f"the operation {_NAMES.get(op, op)} cannot be enclosed; known are + - * /, whole powers,"
        " sqrt, exp, log, atan, fabs, sign, fmin, fmax and conditions"
    )


class CodeWriter:
    """Operations as they are added; the same operation twice is one."""

    def __init__(self, inputs: Sequence[str]) -> None:
        self.inputs = tuple(inputs)
        self.steps: list[tuple[Any, ...]] = []
        self._seen: dict[tuple[Any, ...], int] = {}

    def add(self, operation: str, *args: Any) -> int:
        """Number of the value of an operation, with constants worked out."""
        key = (operation, *args)
        if key in self._seen:
            return self._seen[key]
        if len(self.steps) >= MOST_STEPS:
            raise BadInput(f"the tick has more than {MOST_STEPS} operations")
        self._seen[key] = len(self.inputs) + len(self.steps)
        self.steps.append(key)
        return self._seen[key]

    def const(self, value: Any) -> int:
        """Number of a constant.

        Raises:
            BadInput: it is not finite.
        """
        try:
            return self.add("const", Fraction(exact(value)))
        except TypeError as error:
            raise BadInput(f"the tick: {error}") from None

    def constant(self, i: int) -> Fraction | None:
        """What a value is if it is a constant."""
        step = self.steps[i - len(self.inputs)] if i >= len(self.inputs) else ("",)
        return step[1] if step[0] == "const" else None

    def sign(self, i: int) -> int:
        """Sign of a value, 0 at zero."""
        zero = self.const(0)
        below = self.add("choose", self.add("less", i, zero), self.const(-1), zero)
        return self.add("choose", self.add("less", zero, i), self.const(1), below)

    def power(self, i: int, n: int) -> int:
        """Whole power of a value."""
        if n == 0:
            return self.const(1)
        half = self.power(i, n // 2)
        square = self.add("sq", half) if n > 1 else half
        return square if n % 2 == 0 else i if n == 1 else self.add("mul", square, i)

    def code(self, outputs: Mapping[str, int]) -> TickCode:
        """All of it, without what no output needs."""
        whole_code = TickCode(self.inputs, tuple(self.steps), outputs)
        needed = whole_code._needed()
        to = {i: i for i in range(len(self.inputs))}
        steps: list[tuple[Any, ...]] = []
        for k, (operation, *args) in enumerate(self.steps):
            if len(self.inputs) + k in needed:
                to[len(self.inputs) + k] = len(self.inputs) + len(steps)
                steps.append(
                    (operation, *(args if operation == "const" else (to[i] for i in args)))
                )
        return TickCode(self.inputs, tuple(steps), {n: to[i] for n, i in outputs.items()})


def folded_constant(writer: CodeWriter, operation: str, at: Sequence[int]) -> int:
    """Operation whose constants are worked out as rationals."""
    known = [writer.constant(i) for i in at]
    if operation == "choose" and known[0] is not None:
        return at[1] if known[0] else at[2]
    if None in known:
        return writer.add(operation, *at)
    a, b, c = ([k for k in known if k is not None] + [Fraction(0)] * 2)[:3]
    if operation == "div" and b == 0:
        raise ZeroDivisionError("the tick divides by zero")
    found: Any = {
        "add": lambda: a + b, "sub": lambda: a - b, "mul": lambda: a * b, "div": lambda: a / b,
        "neg": lambda: -a, "abs": lambda: abs(a), "sq": lambda: a * a, "min": lambda: min(a, b),
        "max": lambda: max(a, b), "less": lambda: a < b, "less_equal": lambda: a <= b,
        "equal": lambda: a == b, "choose": lambda: b if a else c,
    }.get(operation)  # fmt: skip
    return writer.add(operation, *at) if found is None else writer.const(Fraction(found()))


def with_constants(code: TickCode, values: Mapping[str, Fraction]) -> TickCode:
    """The tick with numbers in the place of some of its inputs, what follows from them worked out.

    Args:
        code: the tick. values: numbers by the name of the input.
    """
    left = [name for name in code.inputs if name not in values]
    writer = CodeWriter(left)
    at = [left.index(n) if n in left else writer.const(values[n]) for n in code.inputs]
    for operation, *args in code.steps:
        if operation == "const":
            at.append(writer.const(args[0]))
            continue
        try:
            at.append(folded_constant(writer, operation, [at[i] for i in args]))
        except ZeroDivisionError:  # perhaps on a way that is never taken
            at.append(writer.add(operation, *(at[i] for i in args)))
    return writer.code({name: at[i] for name, i in code.outputs.items()})
