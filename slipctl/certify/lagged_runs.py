"""Runs of one error behind a lag and a dead time that lead out of its bounds, and their replay.

A run names the error z of each tick; what the disturbance has to be follows from it, so that
rounding does not pile up over the ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np

from slipctl.certify.lagged_maps import Lagged, signed_pull
from slipctl.certify.scalar_maps import DIGITS, LARGEST, SLOP

MOST = 6000
"""Longest run that is looked for, in ticks."""

NEAR = 1 - 1e-9
"""Share of the push that a search uses, so that a replay has room for rounding."""


@dataclass(frozen=True)
class Path:
    """A run.

    Attributes:
        errors: z at each tick, as the law meets it; the first is the start, the actuator at rest.
        noise: sign of the noise at each tick, -1, 0 or 1 times its bound.
        stepped: tick before which the reference has moved, -1 for none. step: by how much in z.
    """

    errors: Sequence[Any]
    noise: Sequence[int]
    stepped: int = -1
    step: Any = 0


def outward(law: Callable[[int], Lagged], start: float, step: float = 0.0) -> Path | None:
    """Run that leaves; None if none is found.

    Tried are pushes that stay, that follow the sign of z + x alpha, and square waves of many
    periods, from either end of the start set and from its middle; the noise has the other sign. A
    step comes when half of the ticks are over.
    """
    first = law(0)
    rate = max(float(first.above.slope(0.0)), float(first.below.slope(0.0)), 1e-9)
    most = int(min(MOST, 300 + 100 / rate))
    leans = [0.0, 0.1, 0.3, 1.0, 3.0, 10.0, -0.3, -1.0, -3.0]
    periods = sorted({int(p) for p in np.geomspace(1, most / 4, 30)})
    ways = [(0.0, 0, 1)] + [(x / rate, 0, 0) for x in leans] + [(0.0, p, 0) for p in periods]
    table = [(s, *w, side) for s in {start, 0.0} for w in ways for side in (1.0, -1.0)]
    begin, lean, period, stays, side = np.array(table, dtype=float).T
    at = most // 2 if step else -1
    z, alpha = begin * side, np.zeros_like(begin)
    old, tracks, signs = [z] * (first.dead + 1), [z], []
    for i in range(most):
        own = law(i)
        feel = np.where(z + lean * alpha >= 0, 1.0, -1.0)
        wave = side * np.where((i // np.maximum(period, 1)) % 2, -1.0, 1.0)
        feel = np.where(stays > 0, side, np.where(period > 0, wave, feel))
        noise, push, r = float(own.noise), float(own.push) * NEAR, float(own.r)
        signs.append(-feel)
        out = (z + own.noise >= float(own.above.width)) | (z - own.noise <= -own.below.width)
        if out.any():
            k = int(np.nonzero(out)[0][0])
            moved = float(np.sign(tracks[at][k]) or 1.0) * step if 0 <= at <= i else 0.0
            return Path([float(t[k]) for t in tracks], [int(s[k]) for s in signs],
                        at if moved else -1, moved)  # fmt: skip
        y = old[0] + signs[max(0, i - own.dead)] * noise
        U = -signed_pull(own, y) - float(own.g) * (1 - 1 / r) * (y + float(own.c))
        z = r * (z + float(own.c) + own.c1 * alpha + own.c2 * U) - float(own.c) + feel * push
        alpha = r * (own.E * alpha + (1 - own.E) * U)
        if i + 1 == at:
            z = z + np.where(z >= 0, step, -step)
        old = [*old[1:], z]
        tracks.append(z)
    return None


def leaves(law: Callable[[int], Lagged], path: Path) -> bool:
    """Whether a run of errors is one of the law, and its last error is surely out of bounds.

    All in decimals. That the start and the step are allowed, the caller has to see.

    Proof note: alpha follows from the errors by a filter that forgets, so it is enclosed with a
    radius; the push that a tick needs is then known up to that radius, and must be allowed.
    """
    with localcontext(Context(prec=DIGITS)):
        alpha, radius, last = Decimal(0), Decimal(0), len(path.errors) - 1
        for i, z in enumerate(path.errors):
            own = law(i)
            if abs(z) > LARGEST:
                return False
            if z + own.noise >= own.above.width or z - own.noise <= -own.below.width:
                return i == last
            if i == last:
                return False
            j = max(0, i - own.dead)
            y = path.errors[j] + path.noise[j] * own.noise
            if not -own.below.width < y < own.above.width:
                return False
            pull = own.above.at(y) if y >= 0 else -own.below.at(-y)
            U = -pull - own.g * (1 - 1 / own.r) * (y + own.c)
            after = own.r * (z + own.c + own.c1 * alpha + own.c2 * U) - own.c
            moved = path.step if i + 1 == path.stepped else Decimal(0)
            if abs(path.errors[i + 1] - moved - after) + own.r * own.c1 * radius + SLOP > own.push:
                return False
            alpha = own.r * (own.E * alpha + (1 - own.E) * U)
            radius = own.r * own.E * radius + SLOP
    return False
