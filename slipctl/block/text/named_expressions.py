"""Expressions of other signals, ``"v / r"``: their names, their values, and their order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any, TypeVar

from slipctl.block.text import expression
from slipctl.errors import BadInput, Faults, nearest

E = TypeVar("E")


def solve_order(
    expressions: Mapping[str, E],
    known: Mapping[str, Any],
    needs: Callable[[str, E], Iterable[str]],
    value: Callable[[str, E, Mapping[str, Any]], Any],
    stuck: Callable[[str, E, Mapping[str, Any]], BadInput],
) -> dict[str, Any]:
    """Values of expressions that speak of each other, each after those that it needs.

    Args:
        expressions: by name.
        known: values by name that are there already; they come first in what is returned.
        needs: names that an expression needs.
        value: value of an expression, from the values of what it needs.
        stuck: what to say of the first of those that can never be computed, with what could be.

    Raises:
        BadInput: as ``stuck`` says.
    """
    values, waiting = dict(known), dict(expressions)
    while waiting:
        ready = [n for n, e in waiting.items() if all(k in values for k in needs(n, e))]
        if not ready:
            raise stuck(*next(iter(waiting.items())), values)
        for n in ready:
            values[n] = value(n, waiting.pop(n), values)
    return values


@lru_cache(maxsize=4096)
def names_in(text: str) -> tuple[str, ...]:
    """Names that an expression of other signals uses, functions left out.

    Raises:
        BadInput: not an expression.
    """
    try:
        return tuple(sorted(expression.read(text).names))
    except Faults as error:
        raise BadInput(
            f"{_cut(text)} is not an expression such as 'v / r': {error.lines[0]}"
        ) from None


def evaluate(text: str, values: Mapping[str, Any], where: str) -> Any:
    """Evaluate an expression of other signals, ``"v / r"``, on numbers or CasADi symbols.

    Raises:
        BadInput: unknown name, or not an arithmetic expression.
    """
    try:
        found = expression.read(text)
    except Faults as error:
        raise BadInput(f"{where}: {_cut(text)} is not an expression: {error.lines[0]}") from None
    unknown = [n for n in found.names if n not in values]
    if unknown:
        raise BadInput(f"{where}: {_cut(text)} uses {unknown[0]!r}{nearest(unknown[0], values)}")
    try:
        return found.value(values)
    except Exception as error:  # CasADi and numpy raise many kinds
        reason = str(error).split("\n")[0]
        raise BadInput(f"{where}: {_cut(text)} cannot be computed: {reason}") from None


def _cut(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")
