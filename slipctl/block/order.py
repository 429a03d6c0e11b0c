"""In which order expressions that speak of each other are solved."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from slipctl.errors import BadInput

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
