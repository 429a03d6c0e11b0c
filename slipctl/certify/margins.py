"""Ends at which a criterion turns, each with the other numbers as they are; by floats."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from slipctl.certify.promise import Criterion, System


def end(holds: Callable[[float], bool], value: float, up: bool) -> float | None:
    """Largest (``up``) or smallest number at which a verdict still holds, searched from ``value``.

    From a value that holds, doubling (halving) finds one that does not; from one that does not, a
    factor of 1.1 finds one that does, within 1e-6 to 1e6. Then bisection to the last digits. So it
    is the end of the stretch of numbers of one sign that hold next to ``value``.

    Returns:
        The end; None if none holds, inf or 0 if there is no end.
    """
    if value < 0:
        found = end(lambda x: holds(-x), -value, not up)
        return None if found is None else -found
    away, limit = (2.0, 1e40) if up else (0.5, 1e-40)
    start = value or (1e-12 if up else 0.0)
    if not holds(value):
        if value == 0:
            return None
        back = 1 / 1.1 if up else 1.1
        outside = value
        for _ in range(150):
            inside = outside * back
            if holds(inside):
                break
            outside = inside
        else:
            return None
    elif value == 0 and not up:
        return 0.0
    else:
        inside = value
        outside = start
        while holds(outside):
            inside, outside = outside, outside * away
            if (outside > limit) if up else (outside < limit):
                return math.inf if up else 0.0
    for _ in range(200):
        middle = (outside + inside) / 2
        if middle in (outside, inside):
            break
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside


def margins(criterion: Criterion, numbers: Mapping[str, float]) -> dict[str, float | None]:
    """Ends at which the verdict of a criterion changes, each with the other numbers as they are."""
    found: dict[str, float | None] = {}
    for margin in criterion.margins:
        side, _, name = margin.partition("_")
        if name in numbers:

            def holds(x: float, name: str = name) -> bool:
                try:
                    return criterion.holds({**numbers, name: x})
                except (ArithmeticError, ValueError):
                    return False

            found[margin] = end(holds, float(numbers[name]), side == "largest")
    return found


def unit_dependent(system: System, name: str, scale: float = 1000.0) -> bool:
    """Whether a verdict of a criterion changes when the state is told in another unit."""
    criterion = system.criteria[name]
    if criterion.sides is None:
        return False  # what it brings was searched for; it is checked in the unit of the file
    for panel in system.panel:
        defaults = {k: n.value for k, n in system.numbers.items() if n.value is not None}
        numbers = {**defaults, **panel}
        if not all(n in numbers for n in criterion.needs):
            continue
        for c in (scale, 1 / scale):
            moved = {k: v * c ** system.numbers[k].power for k, v in numbers.items()}
            if criterion.holds(numbers) != criterion.holds(moved):
                return True
    return False
