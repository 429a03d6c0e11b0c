"""A person's tick, written in Python, read into operations (``tick_code``).

The tick is called with symbols in the place of numbers. Every question that it asks of a symbol
(``x > 0``, ``x == 0``, ``min(x, y)``) is answered both ways, in a call of its own. Both results
stand in the code beside the condition. So what is proved is what the text says, whatever
it compares. What would make a number of a symbol (``int``, ``float``, ``round``, ``math.sin``), or
look at its type, is refused in words, also where the tick swallows the error. So is what may make
the next tick another one: globals and closures that may change, stores outside of the tick, a
clock, random numbers. In the end the tick is run with exact numbers, and has to give what its code
gives.
"""

from __future__ import annotations

import builtins
import dis
import functools
import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, NoReturn

from slipctl.certify.arithmetic.decimal_intervals import Interval, exact
from slipctl.certify.ticks.tick_code import CodeWriter, TickCode, folded_constant
from slipctl.errors import BadInput

MOST_PATHS = 256
"""Most ways through a tick."""

MOST_QUESTIONS = 100_000
"""Most questions of all ways together."""

FUNCTIONS = ("sgn", "root", "clip", "exp", "if_else")
"""Functions of ``tick_sets`` for a tick, beside + - * / ** and comparisons."""

HINT = (
    "write it with + - * / and whole powers, comparisons, if, abs, min, max, sum, and with"
    f" {', '.join(FUNCTIONS[:-1])} and {FUNCTIONS[-1]} of slipctl.certify.ticks.tick_sets"
)

_BUILTINS = {"abs", "min", "max", "sum", "len", "range", "zip", "enumerate", "dict", "list",
             "tuple", "sorted", "reversed", "all", "any", "pow"}  # fmt: skip
_METHODS = {"get", "items", "values", "keys", "append", "update"}
_REFUSED = {
    "STORE_GLOBAL": "stores into a global", "DELETE_GLOBAL": "deletes a global",
    "STORE_ATTR": "stores into an object", "DELETE_ATTR": "changes an object",
    "IMPORT_NAME": "imports", "IS_OP": "asks whether two things are the same object",
    "LOAD_BUILD_CLASS": "makes a class", "STORE_NAME": "stores into a name of its module",
    "LOAD_LOCALS": "reads its own names", "PUSH_EXC_INFO": "catches an error",
    "SETUP_FINALLY": "catches an error", "BEFORE_WITH": "opens something",
    "SETUP_WITH": "opens something", "MATCH_CLASS": "asks for a type",
}  # fmt: skip


class _Session:
    """Answers and operations of one reading."""

    def __init__(self, inputs: Sequence[str]) -> None:
        self.writer = CodeWriter(inputs)
        self.answers: list[tuple[int, bool]] = []
        self.at = 0
        self.asked = 0
        self.refusal = ""

    def refuse(self, what: str) -> NoReturn:
        """Refuse a tick; what is swallowed by it is told later.

        Raises:
            TypeError: always.
        """
        self.refusal = self.refusal or what
        raise TypeError(what)

    def answer(self, condition: int) -> bool:
        """Answer to a question of this way through the tick."""
        known = self.writer.constant(condition)
        if known is not None:
            return known != 0
        self.asked += 1
        if self.asked > MOST_QUESTIONS:
            self.refuse("a loop that does not end while its numbers are not known")
        for asked, said in self.answers[: self.at]:
            if asked == condition:
                return said
        if self.at == len(self.answers):
            self.answers.append((condition, True))
        said = self.answers[self.at][1]
        self.at += 1
        return said


def _operator(operation: str, turned: bool = False) -> Callable[[Symbol, Any], Symbol]:
    """Method of an operation of two numbers, or of the two in the other order."""

    def method(self: Symbol, other: Any) -> Symbol:
        parts = (other, self) if turned else (self, other)
        return self._made(operation, *parts)

    return method


class Symbol:
    """A number of a tick that is being read."""

    __slots__ = ("_at", "_session")
    __array_ufunc__ = None

    def __init__(self, session: _Session, at: int) -> None:
        self._session, self._at = session, at

    def _value(self, other: Any) -> int:
        if isinstance(other, Symbol) and other._session is self._session:
            return other._at
        try:
            return self._session.writer.const(exact(other))
        except TypeError as error:
            self._session.refuse(str(error))

    def _made(self, operation: str, *args: Any) -> Symbol:
        at = [self._value(a) for a in args]
        return Symbol(self._session, folded_constant(self._session.writer, operation, at))

    __add__, __radd__ = _operator("add"), _operator("add", turned=True)
    __sub__, __rsub__ = _operator("sub"), _operator("sub", turned=True)
    __mul__, __rmul__ = _operator("mul"), _operator("mul", turned=True)
    __truediv__, __rtruediv__ = _operator("div"), _operator("div", turned=True)
    __lt__, __gt__ = _operator("less"), _operator("less", turned=True)
    __le__, __ge__ = _operator("less_equal"), _operator("less_equal", turned=True)

    def __neg__(self) -> Symbol:
        return self._made("neg", self)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Symbol:
        return self._made("abs", self)

    def __pow__(self, n: Any, modulo: Any = None) -> Symbol:
        if modulo is not None or isinstance(n, bool) or not isinstance(n, int) or not 0 <= n <= 16:
            self._session.refuse("a power that is no whole number from 0 to 16")
        return Symbol(self._session, self._session.writer.power(self._at, n))

    def __eq__(self, o: Any) -> Symbol:  # type: ignore[override]
        return self._made("equal", self, o)

    def __ne__(self, o: Any) -> Symbol:  # type: ignore[override]
        return 1 - self._made("equal", self, o)

    def __bool__(self) -> bool:
        return self._session.answer(self._at)

    def _refuse(self, *_: Any) -> NoReturn:
        self._session.refuse("a cast, a rounding or a text of a number that is not known")

    __int__ = __float__ = __index__ = __complex__ = __round__ = __trunc__ = _refuse
    __floor__ = __ceil__ = __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = _refuse
    __divmod__ = __rdivmod__ = __rpow__ = __str__ = __repr__ = __iter__ = __len__ = _refuse
    __format__ = __getitem__ = __contains__ = __call__ = __reduce_ex__ = _refuse
    __and__ = __or__ = __xor__ = __rand__ = __ror__ = __rxor__ = __invert__ = _refuse
    __lshift__ = __rshift__ = __rlshift__ = __rrshift__ = __matmul__ = _refuse
    __hash__ = _refuse

    def __getattr__(self, name: str) -> NoReturn:
        self._session.refuse(f"the attribute {name} of a number")


# ---- functions for a tick: they take floats, intervals, and what a tick is read with ------------


def sgn(x: Any) -> Any:
    """Sign; of an interval that holds 0 all of -1 to 1."""
    if isinstance(x, Interval):
        return x.sgn()
    if isinstance(x, Symbol):
        return Symbol(x._session, x._session.writer.sign(x._at))
    return (x > 0) - (x < 0)


def root(x: Any) -> Any:
    """Square root; of what is negative 0."""
    if isinstance(x, Interval):
        return x.maximum(0).sqrt()
    if isinstance(x, Symbol):
        return x._made("max", x, 0)._made("sqrt", x._made("max", x, 0))
    return math.sqrt(max(x, 0.0))


def exp(x: Any) -> Any:
    """Exponential."""
    if isinstance(x, Interval):
        return x.exp()
    return x._made("exp", x) if isinstance(x, Symbol) else math.exp(x)


def clip(x: Any, low: Any, high: Any) -> Any:
    """Value limited to a range, min(max(x, low), high)."""
    if isinstance(x, Interval):
        return x.maximum(low).minimum(high)
    for one in (x, low, high):
        if isinstance(one, Symbol):
            return one._made("min", one._made("max", x, low), high)
    return min(max(x, low), high)


def if_else(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` where a condition holds, else ``no``."""
    for one in (condition, yes, no):
        if isinstance(one, Symbol):
            return one._made("choose", condition, yes, no)
    return yes if condition else no


# ---- reading ------------------------------------------------------------------------------------


def code_of_tick(
    tick: Callable[..., Any], groups: Sequence[Sequence[str]], outputs: Sequence[str]
) -> TickCode:
    """Read a tick, which takes mappings of numbers by name and gives one.

    Args:
        tick: the function. groups: names in each of its mappings. outputs: what it has to give.

    Raises:
        BadInput: it is not written for a proof; the message says what to write instead.
    """
    inspect_function(tick)
    names = [f"{'nxd'[k]}_{name}" for k, group in enumerate(groups) for name in group]
    session = _Session(names)
    tree = _explored(session, tick, groups, outputs)
    found = {name: _joined(session.writer, tree, name) for name in outputs}
    code = session.writer.code(found)
    _run_beside(tick, code, groups)
    return code


def _explored(
    session: _Session, tick: Callable[..., Any], groups: Sequence[Sequence[str]],
    outputs: Sequence[str],
) -> list[tuple[list[tuple[int, bool]], dict[str, int]]]:  # fmt: skip
    """Every way through the tick: its answers, and what it then gives."""
    ways: list[tuple[list[tuple[int, bool]], dict[str, int]]] = []
    while True:
        session.at = 0
        given = _called(session, tick, groups, outputs)
        del session.answers[session.at :]
        ways.append((list(session.answers), given))
        if len(ways) > MOST_PATHS:
            raise BadInput(f"the tick has more than {MOST_PATHS} ways through its conditions")
        while session.answers and not session.answers[-1][1]:
            session.answers.pop()
        if not session.answers:
            return ways
        session.answers[-1] = (session.answers[-1][0], False)


def _called(
    session: _Session, tick: Callable[..., Any], groups: Sequence[Sequence[str]],
    outputs: Sequence[str],
) -> dict[str, int]:  # fmt: skip
    at = iter(range(sum(map(len, groups))))
    given = [types.MappingProxyType({n: Symbol(session, next(at)) for n in g}) for g in groups]
    try:
        found = tick(*given)
        read = {n: Symbol(session, 0)._value(found[n]) for n in outputs}
        if set(found) != set(outputs):
            other = ", ".join(map(str, set(found) - set(outputs)))
            raise BadInput(f"the tick gives {other}, which is no state")
    except BadInput:
        raise
    except Exception as error:
        if session.refusal:
            raise BadInput(f"the tick has {session.refusal}; {HINT}") from None
        what = f"gives no {error}" if isinstance(error, KeyError) else f"fails: {error}"
        raise BadInput(f"the tick {what} ({type(error).__name__}); {HINT}") from None
    if session.refusal:
        raise BadInput(f"the tick has {session.refusal}; {HINT}")
    return read


def _joined(
    writer: CodeWriter, ways: Sequence[tuple[list[tuple[int, bool]], dict[str, int]]], name: str,
    depth: int = 0,
) -> int:  # fmt: skip
    """One value of all ways, chosen by their conditions."""
    if len(ways) == 1 and len(ways[0][0]) == depth:
        return ways[0][1][name]
    asked = {w[0][depth][0] if len(w[0]) > depth else -1 for w in ways}
    if len(asked) != 1 or -1 in asked or len(ways) == 1:
        raise BadInput(
            "the tick asks another question when it is called again; it must keep nothing"
        )
    condition = asked.pop()
    parts = [[w for w in ways if w[0][depth][1] == said] for said in (True, False)]
    yes, no = (_joined(writer, part, name, depth + 1) for part in parts)
    return yes if yes == no else writer.add("choose", condition, yes, no)


def _run_beside(tick: Callable[..., Any], code: TickCode, groups: Sequence[Sequence[str]]) -> None:
    """Run the tick with numbers, twice each, and compare with its code.

    Raises:
        BadInput: they differ.
    """
    points = [Fraction(0), Fraction(1), Fraction(-1), Fraction(3, 7), Fraction(-22, 9)]
    for k in range(2 * len(points)):
        numbers = [
            [points[(k // 2 + 3 * i * (k > 1)) % 5] for i, _ in enumerate(g)] for g in groups
        ]
        flat = [v for values in numbers for v in values]
        session = _Session([])
        given = [
            types.MappingProxyType(
                {n: Symbol(session, session.writer.const(v)) for n, v in zip(g, vs, strict=True)}
            )
            for g, vs in zip(groups, numbers, strict=True)
        ]
        try:
            found = tick(*given)
            enclosed = code.run(
                {n: Interval.of(v, 40) for n, v in zip(code.inputs, flat, strict=True)}
            )
        except Exception:
            continue  # no tick there, such as a division by zero
        for name, value in enclosed.items():
            own = session.writer.constant(Symbol(session, 0)._value(found[name]))
            low, high = value.ends()
            if own is not None and not low <= own <= high:
                raise BadInput(
                    f"the tick gives {name} = {float(own):g} when it is run, and {float(low):g}"
                    " as it is read; it must depend on its numbers alone"
                )


# ---- what a tick may use ------------------------------------------------------------------------


def inspect_function(tick: Any) -> None:
    """Refuse a tick that may do something else in the next tick.

    Raises:
        BadInput: it is no plain function, or uses what may change.
    """
    _inspect(tick, "the tick", set())


def _inspect(value: Any, where: str, seen: set[int]) -> None:
    """Whether a value that a tick uses is constant: a number, a text, or a function of such."""
    if isinstance(value, functools.partial):
        for part in (value.func, *value.args, *value.keywords.values()):
            _inspect(part, where, seen)
        return
    if isinstance(value, tuple | frozenset):
        for part in value:
            _inspect(part, where, seen)
        return
    constant = type(value) in (int, float, bool, str, Fraction, types.NoneType)
    if constant or _of_this_package(value) or any(value is b for b in _known_builtins()):
        return
    if not isinstance(value, types.FunctionType):
        raise BadInput(
            f"{where} uses a {type(value).__name__}, which may change between ticks or is not"
            f" known here; use numbers, tuples and functions of them, and {HINT}"
        )
    if id(value) in seen:
        return
    seen.add(id(value))
    for default in (*(value.__defaults__ or ()), *(value.__kwdefaults__ or {}).values()):
        _inspect(default, f"{where}, in a default,", seen)
    cells = {}
    for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True):
        try:
            cells[name] = cell.cell_contents
        except ValueError:
            raise BadInput(f"{where} uses {name}, which has no value") from None
    _inspect_code(value.__code__, value.__globals__, cells, where, seen)


def _known_builtins() -> list[Any]:
    return [getattr(builtins, n) for n in _BUILTINS if hasattr(builtins, n)] + [Fraction]


def _of_this_package(value: Any) -> bool:
    return any(value is own for own in (sgn, root, clip, exp, if_else))


def _inspect_code(
    code: types.CodeType, scope: Mapping[str, Any], cells: Mapping[str, Any], where: str,
    seen: set[int],
) -> None:  # fmt: skip
    for one, after in _with_next(code):
        name = one.argval
        refused = _REFUSED.get(one.opname, "")
        if "JUMP" in one.opname and one.opname.endswith("NONE"):
            refused = _REFUSED["IS_OP"]
        if refused:
            raise BadInput(
                f"{where} {refused}, line {code.co_firstlineno}; a tick must depend on"
                " its numbers alone"
            )
        if one.opname in ("STORE_DEREF", "DELETE_DEREF") and name in cells:
            raise BadInput(f"{where} stores into {name} outside of it; it must keep nothing")
        if one.opname.startswith(("LOAD_GLOBAL", "LOAD_NAME", "LOAD_DEREF", "LOAD_CLASSDEREF")):
            if one.opname.startswith("LOAD_DEREF") and name not in cells:
                continue  # a name of the tick itself
            if name in cells:
                value = cells[name]
            elif name in scope:
                value = scope[name]
            elif hasattr(builtins, name):
                value = getattr(builtins, name)
                if name not in _BUILTINS:
                    raise BadInput(f"{where} uses {name}, which cannot be enclosed; {HINT}")
            else:
                raise BadInput(f"{where} uses {name}, which is not defined")
            _inspect_name(value, name, after, where, seen)
        elif (
            one.opname.startswith(("LOAD_ATTR", "LOAD_METHOD"))
            and name not in _METHODS
            and not _after_module(code, one, scope, cells)
        ):
            raise BadInput(f"{where} asks for the attribute {name}; {HINT}")
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            inner = {**dict.fromkeys(code.co_cellvars, 0), **cells}
            own = {n: inner[n] for n in part.co_freevars if n in cells}
            _inspect_code(part, scope, own, where, seen)


def _inspect_name(
    value: Any, name: str, after: dis.Instruction | None, where: str, seen: set[int]
) -> None:
    if isinstance(value, types.ModuleType):
        read = after is not None and after.opname.startswith(("LOAD_ATTR", "LOAD_METHOD"))
        attribute = after.argval if after is not None and read else None
        found = getattr(value, attribute, None) if isinstance(attribute, str) else value
        if isinstance(found, float) or _of_this_package(found):
            return
        raise BadInput(f"{where} uses {name}{f'.{attribute}' if attribute else ''}; {HINT}")
    _inspect(value, f"{where}, by {name},", seen)


def _with_next(code: types.CodeType) -> Iterator[tuple[dis.Instruction, dis.Instruction | None]]:
    steps = [i for i in dis.get_instructions(code)
             if i.opname not in ("CACHE", "EXTENDED_ARG", "PUSH_NULL")]  # fmt: skip
    return zip(steps, [*steps[1:], None], strict=True)


def _after_module(
    code: types.CodeType, one: dis.Instruction, scope: Mapping[str, Any], cells: Mapping[str, Any]
) -> bool:
    """Whether an attribute is one of a module, which was looked at with its name."""
    for before, after in _with_next(code):
        if after is not None and after.offset == one.offset:
            value = cells.get(before.argval, scope.get(before.argval)) \
                if isinstance(before.argval, str) else None  # fmt: skip
            return before.opname.startswith("LOAD_") and isinstance(value, types.ModuleType)
    return False
