"""Tables whose points are parameters: places that rise, and heights over them."""

from __future__ import annotations

from collections.abc import Mapping

from slipctl.block.signals import Signal
from slipctl.errors import BadInput


def places_of(params: Mapping[str, Signal], name: str) -> tuple[str, ...]:
    """Parameters of the places over which a table is, one for each axis; none if it is no table.

    A part tells the name as it has it. In the whole it is another, or shared with other parts.

    Raises:
        BadInput: there are no such places, or another number of them.
    """
    table = params[name]
    axes = (table.over,) if isinstance(table.over, str) else table.over
    if axes == ("",):
        return ()
    if len(axes) != len(table.shape):
        raise BadInput(
            f"{name} has shape {table.shape} and is a table over {len(axes)} axes; name"
            f" {len(table.shape)}, over=(..., ...)"
        )
    return tuple(
        _place(params, name, axis, (n,)) for axis, n in zip(axes, table.shape, strict=True)
    )


def _place(params: Mapping[str, Signal], name: str, axis: str, shape: tuple[int, ...]) -> str:
    path = name.split(".")[:-1]
    found = [".".join([*path[:k], axis]) for k in range(len(path), -1, -1)]
    there = next((n for n in found if n in params), "")
    if not there or not params[there].rising or params[there].shape != shape:
        raise BadInput(
            f"{name} is a table over {axis!r}, which is no parameter of as many places;"
            f" declare {axis} = Param(..., shape={shape}, rising=True)"
        )
    return there
