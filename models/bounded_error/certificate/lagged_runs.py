"""Runs of one error behind a lag and a dead time that lead out of its bounds, and their replay.

A run names the error z of each tick; what the disturbance has to be follows from it, so that
rounding does not pile up over the ticks. Without a disturbance a run is its start and its noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import ROUND_DOWN, Decimal
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged, signed_pull
from slipctl.models.bounded_error.certificate.scalar_maps import DIGITS, LARGEST, SLOP, Interval

MOST = 6000
"""Longest run that is looked for, in ticks."""

NEAR = Decimal("0.999999")
"""Share of the push that a search uses, so that a replay has room for rounding."""

QUANTUM = Decimal("1e-25")
"""Errors in a file are multiples of this."""


@dataclass(frozen=True)
class Path:
    """A run.

    Attributes:
        errors: z at each tick, as the law meets it; the first is the start, the actuator at rest.
            It is the only one if nothing pushes.
        noise: sign of the noise at each tick, -1, 0 or 1 times its bound.
        stepped: tick before which the reference has moved, -1 for none. step: by how much in z.
    """

    errors: Sequence[Any]
    noise: Sequence[int]
    stepped: int
    step: Any


@dataclass(frozen=True)
class Chosen:
    """What a search has chosen: a start, the sign of the push in each tick, a step.

    The noise has the other sign.
    """

    start: float
    signs: Sequence[int]
    stepped: int
    step: float


def outward(law: Callable[[int], Lagged], start: Interval, step: float = 0.0) -> Chosen | None:
    """Run that leaves, in floats, with a push of -1, 0 or 1 in each tick; None if none is found.

    Tried are pushes that stay, that follow the sign of z + x alpha, and square waves of many
    periods, from either end of the start set and from its middle. The noise has the other sign. A
    step comes when half of the ticks are over.
    """
    first = law(0)
    rate = max(float(first.above.slope(0.0)), float(first.below.slope(0.0)), 1e-9)
    most = int(min(MOST, 300 + 100 / rate))
    leans = [0.0, 0.1, 0.3, 1.0, 3.0, 10.0, -0.3, -1.0, -3.0]
    periods = sorted({int(p) for p in np.geomspace(1, most / 4, 30)})
    ways = [(0.0, 0, 1)] + [(x / rate, 0, 0) for x in leans] + [(0.0, p, 0) for p in periods]
    begins = sorted({start.low, 0.0, start.high})
    table = [(s, *w, side) for s in begins for w in ways for side in (1.0, -1.0)]
    z, lean, period, stays, side = np.array(table, dtype=float).T
    at = most // 2 if step else -1
    alpha, begin = np.zeros_like(z), z
    old, signs = [z] * (first.dead + 1), []
    forward = np.ones_like(z)
    for i in range(most):
        own = law(i)
        feel = np.where(z + lean * alpha >= 0, 1.0, -1.0)
        wave = side * np.where((i // np.maximum(period, 1)) % 2, -1.0, 1.0)
        feel = np.where(stays > 0, side, np.where(period > 0, wave, feel))
        push, r = float(own.push) * float(NEAR), float(own.r)
        signs.append(feel)
        out = (z + own.noise >= float(own.above.width)) | (z - own.noise <= -own.below.width)
        if out.any():
            k = int(np.nonzero(out)[0][0])
            moved = float(forward[k]) * step if 0 <= at <= i else 0.0
            return Chosen(float(begin[k]), [int(s[k]) for s in signs], at if moved else -1, moved)
        j = max(0, i - own.dead)
        then = law(j)
        y = old[0] - signs[j] * float(then.noise)
        U = -signed_pull(then, y) - float(then.g) * (1 - 1 / float(then.r)) * (y + float(then.c))
        U = U * _narrowed(law, j, i) if i >= own.dead else np.zeros_like(z)
        z = r * (z + float(own.c) + own.c1 * alpha + own.c2 * U) - float(own.c) + feel * push
        alpha = r * (own.E * alpha + (1 - own.E) * U)
        if i + 1 == at:
            forward = np.where(z >= 0, 1.0, -1.0)
            z = z + forward * step
        old = [*old[1:], z]
    return None


def exact(law: Callable[[int], Lagged], chosen: Chosen, step: Any, start: Interval) -> Path | None:
    """Path that a law of decimals takes under what was chosen; None if it does not leave.

    Args:
        law, step: decimals. chosen: from ``outward``. start: the set of starts, in decimals; the
            end of it that floats have chosen may lie outside by their rounding.
    """
    with precise(DIGITS):
        z = min(max(Decimal(chosen.start), start.low), start.high).quantize(QUANTUM, ROUND_DOWN)
        errors, alpha = [], Decimal(0)
        forward = -1 if chosen.step < 0 else 1
        for i, sign in enumerate(chosen.signs):
            own = law(i)
            z = z.quantize(QUANTUM)
            errors.append(z)
            if z + own.noise >= own.above.width or z - own.noise <= -own.below.width:
                shown = 1 if z + own.noise >= own.above.width else -1
                noise = [*(-s for s in chosen.signs[:i]), shown]
                told = errors if own.push else errors[:1]
                return Path(told, noise, chosen.stepped, forward * step)
            j = i - own.dead
            U = Decimal(0)
            if j >= 0:
                then = law(j)
                U = _command(then, errors[j] - chosen.signs[j] * then.noise) * _narrowed(law, j, i)
            z = own.r * (z + own.c + own.c1 * alpha + own.c2 * U) - own.c + sign * own.push * NEAR
            alpha = own.r * (own.E * alpha + (1 - own.E) * U)
            if i + 1 == chosen.stepped:
                z += forward * step
    return None


def _narrowed(law: Callable[[int], Lagged], j: int, i: int) -> Any:
    """Bounds of tick j over those of tick i: a command that is on its way counts for more."""
    return 1 if law(j) is law(i) else math.prod(law(m).r for m in range(j, i))


def _command(own: Lagged, y: Any) -> Any:
    """Command times T at a measured error."""
    pull = own.above.at(y) if y >= 0 else -own.below.at(-y)
    return -pull - own.g * (1 - 1 / own.r) * (y + own.c)


def leaves(law: Callable[[int], Lagged], path: Path) -> bool:
    """Whether a run of errors is one of the law, and its last error is surely out of bounds.

    All in decimals. That the start and the step are allowed, the caller has to see.

    Proof note: alpha follows from the errors by a filter that forgets, so it is enclosed with a
    radius. The push that a tick needs is then known up to that radius, and must be allowed. Where
    nothing pushes, the errors follow too, each with a radius that the slope of the pull carries on.
    """
    with precise(DIGITS):
        alpha, loose, last = Decimal(0), Decimal(0), len(path.noise) - 1
        told = len(path.errors) == len(path.noise)
        errors, radii = list(path.errors), [Decimal(0)] * len(path.errors)
        for i in range(last + 1):
            own, z, radius = law(i), errors[i], radii[i]
            if abs(z) > LARGEST or (own.push and not told):
                return False
            if (z + own.noise - radius >= own.above.width
                    or z - own.noise + radius <= -own.below.width):  # fmt: skip
                return i == last
            if i == last:
                return False
            j, U, around = i - own.dead, Decimal(0), Decimal(0)
            if j >= 0:
                then, narrowed = law(j), _narrowed(law, j, i)
                y = errors[j] + path.noise[j] * then.noise
                if not (-then.below.width < y - radii[j] and y + radii[j] < then.above.width):
                    return False
                U = _command(then, y) * narrowed
                around = (_steepest(then, y, radii[j]) * radii[j] + SLOP) * narrowed
            after = own.r * (z + own.c + own.c1 * alpha + own.c2 * U) - own.c
            after += path.step if i + 1 == path.stepped else Decimal(0)
            spread = own.r * (radius + own.c1 * loose + own.c2 * around) + SLOP
            if told and abs(errors[i + 1] - after) + spread > own.push:
                return False
            if not told:
                errors.append(after)
                radii.append(spread)
            alpha = own.r * (own.E * alpha + (1 - own.E) * U)
            loose = own.r * (own.E * loose + (1 - own.E) * around) + SLOP
    return False


def _steepest(own: Lagged, y: Any, radius: Any) -> Any:
    """Bound of the slope of the command over [y - radius, y + radius]."""
    near, far = max(abs(y) - radius, Decimal(0)), abs(y) + radius
    ends = [abs(p.slope(min(x, p.width * NEAR_BOUND)))
            for p in (own.below, own.above) for x in (near, far)]  # fmt: skip
    return max(ends) + abs(own.g * (1 - 1 / own.r))


NEAR_BOUND = 1 - Decimal("1e-40")
