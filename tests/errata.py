"""Rows of docs/errata.md, and whether what one prints is what was measured."""

import re
from functools import cache
from pathlib import Path

from slipctl.study.declaration import half_last_digit

ERRATA = Path(__file__).parents[1] / "docs" / "errata.md"


@cache
def rows() -> dict[str, str]:
    """Text of each row of the errata by its number, ``"000.1"``."""
    pieces = re.split(r"^### (\d{3}\.\d+) ", ERRATA.read_text(encoding="utf-8"), flags=re.M)
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


def shows(row: str, text: str, measured: float) -> None:
    """Check that the row prints ``text`` and that this is the measured number."""
    assert re.search(rf"(?<![\d.]){re.escape(text)}(?!\d)", rows()[row]), f"{row} prints no {text}"
    number = float(text.replace(" ", ""))
    allowed = 1.0001 * half_last_digit(text.replace(" ", ""))
    assert abs(measured - number) <= allowed, f"{row}: printed {text}, measured {measured:.6g}"
