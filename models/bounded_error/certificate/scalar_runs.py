"""Runs of one error that lead out of its bounds, and their replay with decimals.

What a law of ``scalar_maps`` reaches in k ticks is an interval, because the
image of connected sets is connected. So a run that ends outside is found backwards: each error is
aimed at from one in the interval before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate.scalar_maps import (
    DIGITS,
    LARGEST,
    SLOP,
    Interval,
    Tick,
    image,
    turn,
)

MOST = 20_000
"""Longest run that is looked for, in ticks."""


@dataclass(frozen=True)
class Move:
    """What is chosen in a tick: shift of the reference before it, noise, push; in z."""

    step: Any
    noise: Any
    push: Any


@dataclass(frozen=True)
class Run:
    """A start and what is chosen in each tick; the last noise shows the error out of bounds."""

    start: Any
    moves: Sequence[Move]


def outward(
    ticks: Callable[[int], Tick], start: Interval, step: float = 0.0, most: int = MOST
) -> Run | None:
    """Run that leaves the bounds from some error in the start; None if none is found.

    Args:
        ticks: the law of tick 0, 1, ... start: errors at the start. step: largest shift of the
            error, once, when it reaches no further without one. most: longest run.
    """
    if not step:
        for side in (1.0, -1.0):
            found_run = _one_way(ticks, start.high if side > 0 else start.low, side, most)
            if found_run is not None:
                return found_run
    sets, shifted = [start], -1
    z = start
    for i in range(most // 5):
        tick = ticks(i)
        found = image(tick, z)
        if found is None:
            return _backwards(ticks, sets, shifted, step)
        stays = ticks(i + 1) == tick and found.inside(
            Interval(z.low - 1e-9 * (1 + abs(z.low)), z.high + 1e-9 * (1 + abs(z.high)))
        )
        if stays:
            if not step or shifted >= 0:
                return None
            shifted = i + 1
            sets.append(found)
            found = Interval(found.low - step, found.high + step)
        z = Interval(min(found.low, z.low), max(found.high, z.high)) if stays else found
        sets.append(z)
    return None


def _one_way(ticks: Callable[[int], Tick], z: float, side: float, most: int) -> Run | None:
    """Run with the whole push and noise to one side; None if it does not leave there."""
    start, moves = z, []
    for i in range(most):
        tick = ticks(i)
        if not tick.measurable(Interval(z, z)):
            moves.append(Move(0.0, side * tick.noise, 0.0))
            return Run(start, moves)
        ways = [(float(tick.after(z + n) - tick.r * n), n) for n in (-tick.noise, tick.noise)]
        after, noise = max(ways, key=lambda w: side * w[0])
        after += side * tick.push
        if side * (after - z) <= 0 and ticks(i + 1) == tick:
            return None
        moves.append(Move(0.0, noise, side * tick.push))
        z = after
    return None


def _backwards(
    ticks: Callable[[int], Tick], sets: Sequence[Interval], shifted: int, step: float
) -> Run | None:
    """Run through the sets, the last of which has a measured error out of bounds."""
    count = len(sets) - 1 - (shifted >= 0)
    last, tick = sets[-1], ticks(count)
    above = float(tick.above.width) - (last.high + tick.noise)
    below = float(tick.below.width) + (last.low - tick.noise)
    side = 1.0 if above <= below else -1.0
    edge = float(tick.above.width) - tick.noise if side > 0 else tick.noise - tick.below.width
    end = last.high if side > 0 else last.low
    inner = max(edge, last.low) if side > 0 else min(edge, last.high)
    target = (end + inner) / 2
    moves, at = [Move(0.0, side * tick.noise, 0.0)], len(sets) - 1
    for i in reversed(range(count)):
        moved = 0.0
        if i + 1 == shifted:
            before = sets[at - 1]
            place = min(max(target, before.low), before.high)
            moved, target, at = target - place, place, at - 1
            moves[-1] = Move(moved, moves[-1].noise, moves[-1].push)
        at -= 1
        z, noise, push = aim_at(ticks(i), sets[at], target)
        moves.append(Move(0.0, noise, push))
        target = z
    return Run(target, moves[::-1])


def aim_at(tick: Tick, z: Interval, target: float) -> tuple[float, float, float]:
    """Error in z, noise and push whose next error is the target, or the nearest to it."""

    def after(x: tuple[float, float, float]) -> float:
        return float(tick.after(x[0] + x[1]) - tick.r * x[1] + x[2])

    def places(own: Tick, z: Interval) -> list[tuple[float, float]]:
        y = turn(own, min(z.low - own.noise, 0.0), min(z.high - own.noise, 0.0))
        inner = (z.low, z.high, y + own.noise, own.noise)
        return [(min(max(x, z.low), z.high), n) for x in inner for n in (-own.noise, own.noise)]

    tops = [(*x, tick.push) for x in places(tick, z)]
    flipped = places(tick.mirrored(), Interval(-z.high, -z.low))
    bottoms = [(-x, -n, -tick.push) for x, n in flipped]
    best, worst = max(tops, key=after), min(bottoms, key=after)
    low, high = 0.0, 1.0

    def between(share: float) -> tuple[float, float, float]:
        x, n, p = (a + share * (b - a) for a, b in zip(worst, best, strict=True))
        return x, n, p

    if target >= after(best):
        return best
    if target <= after(worst):
        return worst
    while (middle := (low + high) / 2) not in (low, high):
        low, high = (middle, high) if after(between(middle)) < target else (low, middle)
    return between(high)


def replay_errors(ticks: Callable[[int], Tick], run: Run) -> Iterator[tuple[Decimal, Decimal]]:
    """Errors of a run tick by tick, each with a radius that holds the true one; all in decimals.

    The step of a tick is in it. It ends when the measured error is surely out of bounds, or is not
    known to lie within.

    Proof note: the slope of the pull falls with the distance. So over [y - rho, y + rho] that of G,
    q - r pull', lies between its values at the nearest and at the furthest distance.
    """
    with precise(DIGITS):
        z, radius = run.start, Decimal(0)
        for i, move in enumerate(run.moves):
            tick = ticks(i)
            z = z + move.step
            yield z, radius
            y = z + move.noise
            if (y + radius >= tick.above.width or y - radius <= -tick.below.width
                    or abs(z) > LARGEST):  # fmt: skip
                return
            near, out = max(abs(y) - radius, Decimal(0)), abs(y) + radius
            slopes = [
                p.slope(min(x, far(p))) for p in (tick.below, tick.above) for x in (near, out)
            ]
            steep = max(abs(tick.q - tick.r * slope) for slope in slopes)
            z = tick.after(y) - tick.r * move.noise + move.push
            radius = radius * steep + SLOP


def far(pull: Any) -> Decimal:
    """Distance next to the bound."""
    return Decimal(pull.width) * (1 - Decimal("1e-40"))


def leaves(ticks: Callable[[int], Tick], run: Run) -> int | None:
    """Tick at which the measured error is surely out of bounds; None if it is not.

    The caller has to see that steps, noises and pushes are allowed.
    """
    count = -1
    for count, (z, radius) in enumerate(replay_errors(ticks, run)):
        tick, move = ticks(count), run.moves[count]
        y = z + move.noise
        if y - radius >= tick.above.width or y + radius <= -tick.below.width:
            return count
    return None
