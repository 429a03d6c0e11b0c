"""Where a promise ends: proved on one side, refuted by a run on the other, and what lies between.

A verdict is asked at one number after another, by halves of a ratio. Nothing is said of numbers
that were not tried: between two that are certified there may be one that is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from slipctl.certify import proofs
from slipctl.certify.promise import CERTIFIED, REFUTED, UNDECIDED, System, exact_numbers
from slipctl.errors import BadInput, nearest

MOST = 20
"""Doublings, from where the search begins, after which an end is no longer looked for."""

DIGITS = 4
"""Digits of a number that is tried."""


@dataclass(frozen=True)
class Farthest:
    """Ends of a promise along one number.

    Attributes:
        name: of the number. unit: its unit. up: whether its largest value was asked for.
        certified: farthest value that was proved, before any that was refuted; None without one.
        refuted: nearest value that was refuted; None without one.
        tried: verdict of each value, in order.
    """

    name: str
    unit: str
    up: bool
    certified: float | None
    refuted: float | None
    tried: tuple[tuple[float, str], ...]

    def payload(self) -> dict[str, Any]:
        """Entries of its JSON form."""
        return {
            "number": self.name, "unit": self.unit, "side": "largest" if self.up else "smallest",
            "certified": self.certified, "refuted": self.refuted,
            "tried": [{"value": v, "verdict": verdict} for v, verdict in self.tried],
        }  # fmt: skip


def farthest(
    at: Callable[[Mapping[str, float]], tuple[System, Mapping[str, Any]]],
    name: str,
    up: bool = True,
    share: float | None = None,
) -> Farthest:  # fmt: skip
    """Look for the largest (or smallest) value of a number at which the promise is proved.

    Args:
        at: gives the system and its numbers, with some of them replaced: the others may follow, as
            bounds of a loop do. name: number that is varied; its own value is where it begins.
        up: the largest; else the smallest.
        share: step between two values at which the search ends, over the value. It is 1 %,
            and 4 % for a loop that is asked as it runs, whose verdicts take seconds.

    Raises:
        BadInput: the system has no such number, or one that may be negative.
    """
    system, numbers = at({})
    if name not in system.numbers:
        raise BadInput(f"{system.name} has no {name!r}{nearest(name, system.numbers)}")
    if system.numbers[name].low == "any":
        raise BadInput(f"{name} may be negative; ask for a number that is positive")
    if share is None:
        share = 0.04 if hasattr(system.loop, "build") else 0.01
    seen: dict[float, str] = {}
    refused: list[float] = []  # values that cannot be asked; nor can what lies beyond

    def verdict(value: float) -> str:
        value = float(f"{value:.{DIGITS}g}")
        if any(value >= v if up else value <= v for v in refused):
            return ""
        if value not in seen:
            try:
                there, given = at({name: value})
                asked = exact_numbers(there, {**given, name: Fraction(str(value))})
                seen[value] = proofs.decide(there, asked).verdict
            except BadInput:
                refused.append(value)
                return ""
            except ArithmeticError:
                seen[value] = UNDECIDED
        return seen[value]

    exact_numbers(system, {**numbers, name: Fraction(1)})  # what is wrong with the others is said
    usual = (numbers.get("T") or 1e-3) if system.numbers[name].unit == "s" else 1.0
    begin = float(numbers.get(name) or usual)
    out = 2.0 if up else 0.5
    inside = _until(lambda v: verdict(v) == CERTIFIED, begin, 1 / out)
    if inside is not None:
        last = _until(lambda v: verdict(v) != CERTIFIED, inside, out)
        if last is not None:
            _edge(lambda v: verdict(v) == CERTIFIED, last / out, last, share)
    base = begin if inside is None else inside
    beyond = _until(lambda v: verdict(v) == REFUTED, base, out)
    if beyond is not None and verdict(beyond / out) != REFUTED:
        _edge(lambda v: verdict(v) == REFUTED, beyond, beyond / out, share)
    turn = 1 if up else -1
    bad = min((turn * v for v, found in seen.items() if found == REFUTED), default=None)
    good = [turn * v for v, found in seen.items()
            if found == CERTIFIED and (bad is None or turn * v < bad)]  # fmt: skip
    return Farthest(
        name, system.numbers[name].unit, up, turn * max(good) if good else None,
        None if bad is None else turn * bad, tuple(sorted(seen.items())),
    )  # fmt: skip


def _until(holds: Any, value: float, factor: float) -> float | None:
    """First of value, value factor, value factor^2, ... that holds."""
    for _ in range(MOST):
        if holds(value):
            return value
        value *= factor
    return None


def _edge(holds: Any, inside: float, outside: float, share: float) -> float:
    """Value that holds, with one that does not no farther away than the share."""
    while abs(math.log(outside / inside)) > math.log1p(share):
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside
