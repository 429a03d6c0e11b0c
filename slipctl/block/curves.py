"""Tables whose points are parameters: places that rise, and heights over them."""

from __future__ import annotations

from collections.abc import Mapping

from slipctl.block.signals import Signal
from slipctl.errors import BadInput


def places_of(params: Mapping[str, Signal], name: str) -> str:
    """Parameter of the places over which a table is, empty if it is none.

    A part tells the name as it has it. In the whole it is another, or shared with other parts.

    Raises:
        BadInput: there are no such places, or another number of them.
    """
    table = params[name]
    if not table.over:
        return ""
    path = name.split(".")[:-1]
    found = [".".join([*path[:k], table.over]) for k in range(len(path), -1, -1)]
    there = next((n for n in found if n in params), "")
    if not there or not params[there].rising or params[there].shape != table.shape:
        raise BadInput(
            f"{name} is a table over {table.over!r}, which is no parameter of as many places;"
            f" declare {table.over} = Param(..., shape={table.shape}, rising=True)"
        )
    return there
