"""Variables of the environment that libraries read, and fall over where a person slips."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

from slipctl.errors import BadInput

LAST = 253402300799
"""The last second of the year 9999: dates end there."""


def check_environment() -> None:
    """Refuse a time of building that is none; numpy and matplotlib read it.

    Raises:
        BadInput: SOURCE_DATE_EPOCH is no whole number of seconds.
    """
    given = os.environ.get("SOURCE_DATE_EPOCH")
    if given is not None and not (re.fullmatch(r"\d{1,12}", given) and int(given) <= LAST):
        raise BadInput(
            f"the environment has SOURCE_DATE_EPOCH = {given[:40]!r}, which is no whole number of"
            " seconds since 1970; write one, or unset it"
        )


def tell_threads() -> Iterator[str]:
    """Take the first number of a list of threads, as of OpenMP's levels, and say so.

    numexpr, which pandas loads, reads one whole number and nothing else.
    """
    given = os.environ.get("OMP_NUM_THREADS", "").strip()
    if not given or re.fullmatch(r"[1-9]\d{0,5}", given) or "NUMEXPR_NUM_THREADS" in os.environ:
        return
    first = re.match(r"[1-9]\d{0,5}(?=\s*,)", given)
    os.environ["NUMEXPR_NUM_THREADS"] = first[0] if first else "1"
    yield (
        f"the environment has OMP_NUM_THREADS = {given[:40]!r}; where one number is wanted,"
        f" {os.environ['NUMEXPR_NUM_THREADS']} is taken"
    )


def progress_interval() -> float:
    """Seconds between two lines about something long where nobody watches: SLIPCTL_PROGRESS.

    Raises:
        BadInput: it is no time above zero.
    """
    given = os.environ.get("SLIPCTL_PROGRESS", "30")
    if not re.fullmatch(r"\d{1,6}(\.\d{1,6})?", given) or float(given) <= 0.0:
        raise BadInput(
            f"the environment has SLIPCTL_PROGRESS = {given[:40]!r}; write seconds, such as 30"
        )
    return float(given)
