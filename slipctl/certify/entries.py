"""What stands in a certificate: texts that are rationals, lists of a length, no unknown names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from slipctl.errors import BadInput, nearest

RATIONAL = re.compile(r"-?[0-9]{1,200}(/[1-9][0-9]{0,199})?")


class DoesNotHold(ValueError):
    """A certificate whose numbers prove nothing, or not what it says."""


def brief(value: Any) -> str:
    """Value as a person may write it, cut short and on one line."""
    text = repr(value) if isinstance(value, (str, int, float, type(None))) else type(value).__name__
    return text if len(text) < 40 else text[:36] + "..."


def rational(text: Any, where: str) -> Fraction:
    """Read "p/q".

    Raises:
        BadInput: it is none, or has more than 200 digits.
    """
    if not isinstance(text, str) or not RATIONAL.fullmatch(text):
        raise BadInput(f"{where}: {brief(text)} must be a text such as '3/2', at most 200 digits")
    return Fraction(text)


def read_mapping(
    value: Any, known: Sequence[str], where: str, all_of_them: bool = False
) -> Mapping[str, Any]:
    """Mapping with no unknown names.

    Raises:
        BadInput: it is none, has an unknown entry, or lacks one of ``known`` if all must be there.
    """
    if not isinstance(value, Mapping):
        raise BadInput(f"{where} must hold {', '.join(known) or 'nothing'}")
    refuse_unknown(value, known, where)
    for name in known:
        if all_of_them and name not in value:
            raise BadInput(f"{where}.{name} is missing")
    return value


def rows(value: Any, where: str, most: int, length: int | None = None) -> list[Any]:
    """List of at most so many entries, or of exactly so many.

    Raises:
        BadInput: it is none, or is longer or shorter.
    """
    if not isinstance(value, list):
        raise BadInput(f"{where} must be a list")
    if len(value) > most:
        raise BadInput(f"{where} has {len(value)} entries; slipctl checks at most {most}")
    if length is not None and len(value) != length:
        raise BadInput(f"{where} must have {length} entries")
    return value


def read_names(value: Any, where: str) -> tuple[str, ...]:
    """Names, as of states.

    Raises:
        BadInput: they are none.
    """
    names = rows(value, where, 500)
    if not all(isinstance(n, str) and n.isidentifier() for n in names):
        raise BadInput(f"{where} must be names")
    return tuple(names)


def whole(value: Any, where: str, low: int, high: int) -> int:
    """Whole number between two others.

    Raises:
        BadInput: it is none, or lies outside.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise BadInput(f"{where}: {brief(value)} must be a whole number from {low} to {high}")
    return value


def refuse_unknown(given: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    """Refuse entries that are not known.

    Raises:
        BadInput: an unknown entry.
    """
    for name in given:
        if name not in known:
            raise BadInput(
                f"{where} has no entry {str(name)[:40]!r}{nearest(str(name)[:40], known)}"
            )
