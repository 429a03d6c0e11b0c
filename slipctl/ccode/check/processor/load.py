"""Load of a processor: instructions of a step against those that a tick has time for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.ccode.compile.board import CLOCK
from slipctl.errors import BadInput

ASSUMPTION = "one instruction a cycle"


def clock(text: str | None) -> float:
    """Frequency in Hz of a processor as it was written, ``"168MHz"``; that of the board without.

    Raises:
        BadInput: no frequency, or none above 0.
    """
    if text is None:
        return CLOCK
    hertz = parse_quantity(text, "Hz", "--clock")
    if not 0 < hertz < float("inf"):
        raise BadInput(f"--clock {text}: write a frequency above 0, such as 168MHz")
    return hertz


def load(mean: float, most: float, period: float | None, hertz: float) -> dict[str, Any]:
    """Share of a tick that a step takes, the mean one and the longest; empty without a period.

    Args:
        mean, most: instructions of a step.
        period: of a tick in s.
        hertz: clock of the processor.
    """
    if period is None:
        return {}
    room = period * hertz
    return {
        "clock_Hz": hertz, "instructions_in_a_tick": room, "assumption": ASSUMPTION,
        "mean": mean / room, "worst": most / room, "passed": most <= room,
    }  # fmt: skip


def load_line(found: Mapping[str, Any]) -> str:
    """A load in one line."""
    too_much = "" if found["passed"] else ": TOO MUCH, a longer tick or --clock is needed"
    return (
        f"load {100 * found['mean']:.3g} % of a tick, worst {100 * found['worst']:.3g} %, at"
        f" {found['clock_Hz'] / 1e6:g} MHz ({found['instructions_in_a_tick']:.0f} cycles),"
        f" {found['assumption']}{too_much}"
    )
