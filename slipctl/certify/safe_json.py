"""Files of strangers: read whole, of bounded size and depth, or refused in one line."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from slipctl.errors import BadInput

LARGEST = 10_000_000
"""Bytes of a certificate that is read."""

DEEPEST = 20
"""Brackets inside each other."""


def read(path: Path) -> Mapping[str, Any]:
    """Read a JSON file whose content nobody vouches for.

    Raises:
        BadInput: no such file, no regular one, above 10 MB, no JSON object. Brackets nested above
            20, an entry twice, a number that is none of JSON or has more than 300 digits.
    """
    try:
        # not blocking, so that a pipe that nobody writes to is seen before it is waited for
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise BadInput(f"{path} is no regular file")
            raw = file.read(LARGEST + 1)
    except BadInput:
        raise
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror}") from None
    except ValueError:
        raise BadInput("the name of the file has a null character in it") from None
    if len(raw) > LARGEST:
        raise BadInput(f"{path} has more than {LARGEST // 10**6} MB; a certificate has less")
    try:
        payload = json.loads(
            raw.decode("utf-8"), object_pairs_hook=_once, parse_constant=_none, parse_int=_int,
            parse_float=_none,
        )  # fmt: skip
        if isinstance(payload, dict):
            _shallow(payload)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    except (ValueError, RecursionError):
        raise BadInput(f"{path} is no JSON file of slipctl") from None
    if not isinstance(payload, dict):
        raise BadInput(f"{path} is no JSON file of slipctl")
    return payload


def _shallow(payload: Any) -> None:
    """Refuse deep nesting, level by level and so without recursion."""
    level = [payload]
    for _ in range(DEEPEST):
        level = [
            inner
            for value in level
            for inner in (value.values() if isinstance(value, dict) else value)
            if isinstance(inner, (dict, list))
        ]
        if not level:
            return
    raise BadInput(f"brackets are nested more than {DEEPEST} deep; a certificate has fewer")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = sorted(k for k, _ in pairs)
        name = next(a for a, b in pairwise(names) if a == b)
        raise BadInput(f"the entry {name[:40]!r} stands in it twice")
    return found


def _int(text: str) -> int:
    if len(text) > 300:
        raise BadInput("a number in it has more than 300 digits")
    return int(text)


def _none(text: str) -> Any:
    raise BadInput(f"{text[:40]} stands in it as a number; certificates have texts such as '3/2'")
