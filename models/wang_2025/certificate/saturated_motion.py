"""A mass under a saturated command while the force that it needs varies: how far it swings.

    e1' = e2,   e2' = clip(-y, -(need - F_min)/M, (F_max - need)/M),   y = k1 k3 e1 + (k1 + k3) e2

is what is left of the command with saturation compensation on its surface s = 0. The need may take
any value between F_low and F_high at any time. The worst one pulls hard on the way to zero and
brakes weakly beyond: F_high while e2 < 0, F_low while e2 > 0. From rest at e1 = s the error then
comes to rest on the other side at R(s). With q = -e1 and E = e2^2/2 on a half turn,

    dE/dq = g(-k1 k3 q - (k1 + k3) sqrt(2 E)),   g(y) = y cut to [-weak, strong],   E(-s) = 0

Proof note: for e2 < 0 every motion satisfies dE/dq <= that right side, because g is the largest of
-e2' over all needs. The right side falls with E and with q. So a function that rises at least as
fast lies above every motion, and one that rises at most as fast lies below the worst one. R rises
with s, as two motions do not cross. Let a ladder s, R R(s), ... come down into the region without
saturation, where both poles -k1 and -k3 are stable. Then every motion tends to zero: one that does
not turn any more comes to rest, and at rest y is zero only at e1 = 0. If R R(s) >= s, the worst
need keeps the error from dying out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import precise

STEPS = 300
"""Steps of a half turn over the distance s."""

FINER = (30, 100, STEPS)
"""Steps that are tried in turn: far from the boundary few are enough."""

RUNGS = 60
"""Most turns of a ladder."""

DIGITS = 34
SLOP = Decimal("1e-28")
"""Relative widening of a step, 1e5 times the rounding of its operations."""


@dataclass(frozen=True)
class Saturated:
    """Numbers of the motion, floats or decimals.

    Attributes:
        stiff: k1 k3. damp: k1 + k3. left: strong and weak limit in m/s^2 for e2 < 0; right: for
        e2 > 0.
    """

    stiff: Any
    damp: Any
    left: tuple[Any, Any]
    right: tuple[Any, Any]

    def turned(self) -> Saturated:
        """Same motion seen from the other side."""
        return Saturated(self.stiff, self.damp, self.right, self.left)


def motion(k1: Any, k3: Any, M: Any, F_min: Any, F_max: Any, F_low: Any, F_high: Any) -> Saturated:
    """Numbers of the motion."""
    return Saturated(
        k1 * k3, k1 + k3,
        ((F_high - F_min) / M, (F_max - F_high) / M), ((F_max - F_low) / M, (F_low - F_min) / M),
    )  # fmt: skip


def half_turn(
    law: Saturated, s: Any, above: bool = True, steps: int = STEPS
) -> tuple[Any, Any] | None:
    """Bound of the next rest R(s) and of the largest speed on the way, from rest at e1 = s > 0.

    None if it is further away than 1000 s.

    Args:
        law: numbers. s: error at the start. above: whether both are upper bounds, or lower bounds
        of what the worst need does.
    """
    strong, weak = law.left
    stiff, damp, none = law.stiff, law.damp, s - s
    h, q, E, top, v = s / steps, -s, none, none, none
    exact = isinstance(s, Decimal)
    root: Any = Decimal.sqrt if exact else math.sqrt
    wide = SLOP if exact else 0.0
    for _ in range(1000 * steps):
        if above:
            slope = -stiff * q - damp * v
            if exact:
                slope += wide * (stiff * s + damp * v)
            slope = max(-weak, min(strong, slope))
            if slope < 0:
                least = E - weak * h
                v = root(2 * least) if least > 0 else none
                slope = -stiff * q - damp * v
                if exact:
                    slope += wide * (stiff * s + damp * v)
                slope = max(-weak, min(strong, slope))
        else:
            first = min(strong, -stiff * q - damp * v)
            if first > 0:
                v = root(2 * (E + first * h))
            slope = -stiff * (q + h) - damp * v
            if exact:
                slope -= wide * (stiff * s + damp * v)
            slope = max(-weak, min(strong, slope))
        after = E + slope * h
        if after <= 0:
            if slope < 0 and q - E / slope > 0:
                return (q - E / slope) * (1 + (wide if above else -wide)), top
            if not above:
                return none, top
            after = none
        E = after * (1 + (wide if above else -wide)) if exact else after
        v = root(2 * E)
        q, top = q + h, max(top, v)
    return None


def turn(law: Saturated, s: Any, above: bool = True, steps: int = STEPS) -> Any:
    """Bound of R R(s), from rest at s; None if it is far beyond s, and the speeds on the way."""
    first = half_turn(law, s, above, steps)
    if first is None:
        return None
    if first[0] <= 0:
        return first[0], first[1]
    second = half_turn(law.turned(), first[0], above, steps)
    return None if second is None else (second[0], max(first[1], second[1]), first[0])


def dies_out(law: Saturated, s: Any, steps: int = STEPS) -> bool:
    """Whether a ladder from s, on either side, comes down into the region without saturation."""
    return _ladder(law, s, steps) and (law.left == law.right or _ladder(law.turned(), s, steps))


def _ladder(law: Saturated, s: Any, steps: int) -> bool:
    free = min(*law.left, *law.right)
    for _ in range(RUNGS):
        found = turn(law, s, True, steps)
        if found is None or not found[0] < s:
            return False
        far = max(s, found[-1])
        if law.stiff * far + law.damp * found[1] <= free:
            return True
        s = found[0]
    return False


def comes_back(law: Saturated, s: Any, steps: int = STEPS) -> bool:
    """Whether the worst need surely brings the error back to s or further."""
    found = turn(law, s, False, steps)
    return found is None or bool(found[0] >= s)


def exactly(numbers: Sequence[Fraction]) -> list[Decimal]:
    """Decimals of DIGITS digits."""
    with precise(DIGITS):
        return [Decimal(x.numerator) / Decimal(x.denominator) for x in numbers]
