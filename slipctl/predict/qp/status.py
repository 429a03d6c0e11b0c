"""Statuses of a control in the plan, what is small enough to leave them so, and of what data."""

from __future__ import annotations

from collections.abc import Mapping

from slipctl.block.signals import Output, Signal

FREE, HIGH, FASTER, TIED = 0.0, 1.0, 2.0, 3.0
"""Status of a control; -1 and -2 are the low bound and the fastest fall."""

NONE = 9.0
"""No status."""

SMALL = 1e-6
"""Part of its size by which a multiplier or a control must be wrong before a status changes."""

DATA = ("D", "E", "U", "before", "bounds", "dx")
"""What the program is made of, as arguments of Functions: see :meth:`ActiveSet.solve`."""


def status_outputs(words: Mapping[int, str]) -> list[Signal]:
    """Outputs that say how a tick was solved; ``words``: what each status is."""
    told = ", ".join(f"{k} {v}" for k, v in words.items())
    left = Output("1", "what is left of the conditions of optimality", lo=0, hi=1e30)
    return [
        Output("1", told, lo=0, hi=3).named("status"),
        Output("1", "passes of the active set and steps inside it", lo=0, hi=1e6).named("passes"),
        left.named("residual"),
    ]
