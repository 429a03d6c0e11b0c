"""Ranges of a number as a person writes them, ``34t:42t``."""

from __future__ import annotations

from slipctl.block.units.unit_algebra import parse_quantity, split_quantity
from slipctl.errors import BadInput


def read_range(first: str, last: str, wanted: str, where: str) -> tuple[float, float]:
    """Both ends of a range in the wanted unit; where one has a unit, the other needs it too.

    Plain numbers are in the wanted unit already. An end without a unit beside one that has it,
    ``34:42t``, could be 34 kg or 34 t. Only 0 is the same in both.

    Args:
        first, last: the ends, ``"34t"`` and ``"42t"``.
        wanted: declared unit, ``"kg"``.
        where: what takes them, for the message.

    Raises:
        BadInput: no number, an unknown unit, another dimension, a unit at one end alone.
    """
    ends = (parse_quantity(first, wanted, where), parse_quantity(last, wanted, where))
    units = [split_quantity(end)[1] for end in (first, last) if float(split_quantity(end)[0])]
    if len(units) == 2 and (units[0] is None) != (units[1] is None):
        bare, unit = (first, units[1]) if units[0] is None else (last, units[0])
        raise BadInput(
            f"{where}: {first.strip()}:{last.strip()} has a unit at one end; write '{bare.strip()}"
            f" {unit}' or '{bare.strip()} {wanted}'"
        )
    return ends
