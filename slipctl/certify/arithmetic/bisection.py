"""Where a monotone function passes a value; for bounds without a closed form."""

from __future__ import annotations

from collections.abc import Callable


def bisect(f: Callable[[float], float], value: float, a: float, b: float) -> float:
    """Where f passes value between a and b; f(a) is on one side and f(b) on the other."""
    side = f(b) > value
    for _ in range(200):
        middle = (a + b) / 2
        if middle in (a, b):
            break
        a, b = (a, middle) if (f(middle) > value) == side else (middle, b)
    return (a + b) / 2
