"""What is worked out inside a CasADi Function, by the names that its Python has for it.

A Function forgets the local variables of the code that wrote it. Where it is made of a law, they
are remembered here, so that C written from it has the law's own names.
"""

from __future__ import annotations

import gc
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from types import FrameType
from typing import Any, ParamSpec
from weakref import WeakSet

import casadi as ca
import numpy as np

from slipctl.errors import BadInput

P = ParamSpec("P")

MOST, LARGEST = 4000, 64
"""Calls that are looked at for one Function, and elements of a vector that have names."""

_NOT_OURS = ("casadi", "numpy", "slipctl.block.", "contextlib", "functools", "abc")
_KEPT = ("null", "jac", "hess")
"""Names that CasADi keeps for itself."""

_INSIDE = "inside"
"""Name of the Function in the cache of another that gives what is inside that one."""

Found = list[tuple[str, Any]]
"""Names and what they stand for."""


_OURS: WeakSet[Any] = WeakSet()


@contextmanager
def watch_calls(watch: Callable[[FrameType, str, Any], None], over: bool = False) -> Iterator[None]:
    """Let a function see what Python calls and what returns; a person's profiler goes first.

    Garbage is left where it is meanwhile: what ends because it is collected would be seen too.

    Args:
        watch: what :func:`sys.setprofile` wants.
        over: in place of one of ours that is at work, which goes on afterwards.
    """
    before = sys.getprofile()
    free = before is None or (over and before in _OURS)
    collecting = gc.isenabled()
    gc.disable()
    if free:
        _OURS.add(watch)
        sys.setprofile(watch)
    try:
        yield
    finally:
        if free:
            sys.setprofile(before)
        if collecting:
            gc.enable()


@contextmanager
def collect_locals() -> Iterator[Found]:
    """Collect the local variables, of expressions, of the functions that return meanwhile.

    Yields:
        A list of (name, expression), filled at the end; outermost functions come first.
    """
    found: Found = []
    seen: list[tuple[int, Found]] = []

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event != "return" or len(seen) >= MOST:
            return
        if frame.f_globals.get("__name__", "").startswith(_NOT_OURS):
            return
        depth, outer = 0, frame.f_back
        while outer is not None:
            depth, outer = depth + 1, outer.f_back
        given = frame.f_locals.items()
        seen.append((depth, [x for n, v in given if n[0] != "_" for x in elements(n, v)]))

    try:
        with watch_calls(watch, over=True):
            yield found
    finally:
        for _, rows in sorted(seen, key=lambda x: x[0]):
            found.extend(rows)


def elements(name: str, value: Any) -> Found:
    """Names of the elements of an expression, or of a list of them, that are worked out.

    What is no scalar expression (MX) has one name for all of its elements.
    """
    if isinstance(value, ca.MX):
        worked_out = value.nnz() and not value.is_symbolic() and not value.is_constant()
        return [(name, value)] if worked_out else []
    if isinstance(value, list) and len(value) <= LARGEST:
        if any(isinstance(v, ca.MX) for v in value):
            return [x for k, v in enumerate(value) for x in elements(f"{name}_{k}", v)]
        rows = [(f"{name}_{k}", v) for k, v in enumerate(value)]
    elif isinstance(value, ca.SX) and value.nnz() <= LARGEST:
        places = zip(*value.sparsity().get_triplet(), strict=True)
        column = value.is_column()
        rows = [
            (name if value.is_scalar() else f"{name}_{i}" if column else f"{name}_{i}_{j}", v)
            for (i, j), v in zip(places, value.nonzeros(), strict=True)
        ]
    else:
        return []
    return [
        (n, v) for n, v in rows
        if isinstance(v, ca.SX) and v.is_scalar() and not v.is_symbolic() and not v.is_constant()
    ]  # fmt: skip


def of_symbols(values: Sequence[Any], own: set[int], key: Callable[[Any], int]) -> list[Any]:
    """Those of some expressions that have no symbols but some.

    Most often all are: so the symbols of all are asked for at once, then those of either half.

    Args:
        values: expressions, all SX or all MX.
        own: keys of the symbols.
        key: what tells one symbol from another.
    """
    if not values or {key(s) for s in ca.symvar(ca.veccat(*values))} <= own:
        return list(values)
    if len(values) == 1:
        return []
    half = len(values) // 2
    return of_symbols(values[:half], own, key) + of_symbols(values[half:], own, key)


def with_locals(f: ca.Function, found: Found) -> ca.Function:
    """The Function of scalar expressions that knows what is inside it, as long as it lives.

    Args:
        f: the Function.
        found: (name, expression); those of other symbols are left out. The first name counts.
    """
    arguments = f.sx_in()
    own = {s.element_hash() for a in arguments for s in ca.symvar(a)}
    first: dict[int, tuple[str, Any]] = {}
    for name, value in found:
        if not isinstance(value, ca.MX):
            first.setdefault(value.element_hash(), (name, value))
    inner = of_symbols([v for _, v in first.values()], own, ca.SX.element_hash)
    if not inner:
        return f
    names = [re.sub("_+", "_", first[v.element_hash()][0]).rstrip("_") for v in inner]
    inside = ca.Function(
        _INSIDE, arguments, inner, f.name_in(), names,
        {"cse": True, "allow_duplicate_io_names": True},
    )  # fmt: skip
    return ca.Function(
        f.name(), arguments, f.call(arguments), f.name_in(), f.name_out(),
        {"cse": True, "cache": {_INSIDE: inside}},
    )  # fmt: skip


def function(
    found: Found, name: str, arguments: Sequence[Any], results: Sequence[Any],
    inputs: Sequence[str], outputs: Sequence[str],
) -> ca.Function:  # fmt: skip
    """A Function that knows what is inside it, as long as it lives.

    Args:
        found: (name, expression), as :func:`collect_locals` gives it; those of other symbols
            are left out.
        name, arguments, results, inputs, outputs: of the Function.
    """
    names, twice = (list(inputs), list(outputs)), {"allow_duplicate_io_names": True}
    if not any(isinstance(v, ca.MX) for v in (*arguments, *results)):
        return with_locals(ca.Function(name, arguments, results, *names, {"cse": True}), found)
    own = {hash(a) for a in arguments}
    first: dict[int, tuple[str, Any]] = {}
    for said, value in found:
        if isinstance(value, ca.MX) and (plain := re.sub("_+", "_", said).strip("_")) not in _KEPT:
            first.setdefault(hash(value), (plain, value))
    inner = of_symbols([v for _, v in first.values()], own, hash)
    if not inner:
        return ca.Function(name, arguments, results, *names, twice)
    known = [first[hash(v)][0] for v in inner]
    marked = [ca.sin(v) for v in inner]  # a result that is pieces would be taken apart
    inside = ca.Function(_INSIDE, arguments, marked, inputs, known, twice)
    return ca.Function(name, arguments, results, *names, twice | {"cache": {_INSIDE: inside}})


def with_names(
    f: ca.Function, results: Sequence[Any], named: Sequence[tuple[str, Any]]
) -> ca.Function:  # fmt: skip
    """The Function of scalar expressions with names for expressions inside it.

    Args:
        f: the Function. results: its expressions. named: (name, expression), of its symbols.
    """
    if not named:
        return f
    names, values = zip(*named, strict=True)
    inside = ca.Function(
        _INSIDE, f.sx_in(), values, f.name_in(), names, {"allow_duplicate_io_names": True}
    )
    given = (f.name(), f.sx_in(), results, f.name_in(), f.name_out())
    return ca.Function(*given, {"cache": {_INSIDE: inside}})


@contextmanager
def as_it_is() -> Iterator[None]:
    """Let CasADi keep expressions as they are: it would turn a (1/b) into a/b."""
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


def with_checked_locals(f: ca.Function, name: str, found: Found) -> ca.Function:
    """Equations of a block, which know what is inside them.

    Args:
        f: the equations. name: of the block. found: as :func:`collect_locals` gives it.

    Raises:
        BadInput: they hold a NaN, which ``math.exp`` and ``float`` make of a symbol.
    """
    for k in range(f.n_instructions()):
        if f.instruction_id(k) == ca.OP_CONST and math.isnan(f.instruction_constant(k)):
            raise BadInput(
                f"{name} gives NaN whatever the numbers; float(x) and math.exp(x) cannot read a"
                " symbol: from casadi import exp, and so for every function of math"
            )
    return with_locals(f, found)


def remember_locals(make: Callable[P, Any]) -> Callable[P, ca.Function]:
    """Decorate what makes a Function of scalar expressions: its variables are remembered.

    What gives a name, arguments, results and the names of both makes one of any expressions.
    """

    @wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> ca.Function:
        with collect_locals() as found:
            f = make(*args, **kwargs)
        if isinstance(f, tuple):
            return function(found, *f)
        return with_locals(f, found) if f.class_name() == "SXFunction" else f

    return made


def named_inside(f: ca.Function) -> ca.Function | None:
    """Function of the same arguments that gives what is inside, under its names, if known.

    That of one that is no scalar expression (MX) is to be read only: it gives the sine of each.
    """
    return f.cache().get(_INSIDE)


def values_of_body(
    where: str, body: Callable[..., Any], signals: Mapping[str, Mapping[str, Any]], given: Any
) -> Any:  # fmt: skip
    """What a body gives of states, inputs and parameters by name.

    Args:
        where: what is called. signals: of the block, by role and name.
        given: states, inputs and parameters.

    Raises:
        BadInput: which of these lacks, or is no expression; or that the body takes or gives
            something else. What breaks within it is told as it is.
    """
    try:
        found = body(*given)
    except (TypeError, NotImplementedError) as error:
        for role, values in zip(("state", "input", "param"), given, strict=True):
            if not isinstance(values, Mapping):
                raise BadInput(f"{where}: give each {role} by name") from None
            for name in signals[role]:
                value = values.get(name)
                if not isinstance(value, (int, float, np.ndarray, ca.SX, ca.MX, ca.DM)):
                    raise BadInput(f"{where}: the {role} {name!r} is no expression") from None
        if error.__traceback__ is not None and error.__traceback__.tb_next is None:
            raise BadInput(f"{where}: its body takes (x, u, p): {error}") from error
        raise
    pair = isinstance(found, (tuple, list)) and len(found) == 2
    if not pair or not all(isinstance(half, Mapping) for half in found):
        raise BadInput(f"{where}: its body must return (dict of states, dict of outputs)")
    return found
