"""Samples of a quantity as somebody gives them: lists, arrays, columns of a frame or of a log."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl.block.signals import real_array
from slipctl.errors import BadInput, value_text


def samples_of(where: str, given: Any) -> np.ndarray:
    """Samples as an array of floats, NaN where they are.

    Args:
        where: what they are of, for the message.
        given: numbers. Of texts, dates, complex and masked numbers nobody knows what is meant.

    Raises:
        BadInput: it is none of these, or has none.
    """
    values = getattr(given, "values", given)
    values = given if callable(values) else values
    if np.ma.is_masked(values):
        raise BadInput(f"{where} has masked numbers; leave these rows out")
    try:
        found = real_array(values)
    except (TypeError, ValueError):
        raise BadInput(f"{where} is {value_text(given)}, no list of real numbers") from None
    if not found.size:
        raise BadInput(f"{where} has no numbers")
    return found
