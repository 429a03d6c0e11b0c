"""A seal over what was asked and what a proof brings, so that no digit of either changes unseen.

What a proof brings may often be one of many (a start, a matrix), and a neighbour would prove the
same. The seal tells that a file was altered; only the proof tells that it proves what it says.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from slipctl.certify.entries import DoesNotHold, read_mapping


def _seal(numbers: Mapping[str, Any], entries: Mapping[str, Any]) -> str:
    told = [{k: str(v) for k, v in numbers.items()}, dict(entries)]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]


def with_checksum(numbers: Mapping[str, Any], entries: Mapping[str, Any]) -> dict[str, Any]:
    """Entries with their seal."""
    return {**entries, "seal": _seal(numbers, entries)}


def without_checksum(
    numbers: Mapping[str, Any], entries: Any, known: Sequence[str], where: str
) -> dict[str, Any]:
    """Entries without their seal, all of those that are known.

    Raises:
        BadInput: an entry is unknown or missing. DoesNotHold: the seal is another one.
    """
    found = dict(read_mapping(entries, (*known, "seal"), where, True))
    if found.pop("seal") != _seal(numbers, found):
        raise DoesNotHold(f"{where}: it was altered; its seal is that of other numbers")
    return found
