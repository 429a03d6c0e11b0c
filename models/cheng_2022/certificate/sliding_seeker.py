"""What a sliding-mode seeker does at its ticks: how far it falls behind, how far it ripples.

    v+ = v + T k s,  g+ = g + T rho,  s = 1 where (y - g) mod 2 beta lies in [0, beta], else -1
    y = mu(v) as it was a dead time of n ticks ago, behind a lag, with a noise of at most N

delta = mu(v) - g, told as y without its noise, moves by (k |mu'| - rho) T towards the plane beta
from below and by (k |mu'| + rho) T from above. That, for n + 1 ticks after it passed, is how far it
leaves the plane again, and it must not meet the next one. A lag is an error of y of at most
k |mu'| lag, from rest. All functions take rationals, and are exact then.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

MOST_TICKS = 20_000
"""Ticks that a replay takes at most."""

MOST_TURNS = 600
"""Turns of a period that a replay on a parabola takes at most."""

PERIODS = 3
"""Periods of such a run; the first is for the start to fade."""


class Seeker(NamedTuple):
    """A seeker and what it hears: ``late`` is the dead time in ticks, ``noise`` N, lag in s."""

    k: Any
    rho: Any
    beta: Any
    T: Any
    noise: Any = 0
    late: int = 0
    lag: Any = 0


def ticks_late(dead_time: Any, T: Any) -> int:
    """Ticks that a dead time takes, rounded up."""
    return math.ceil(dead_time / T)


# ---- on a slope ---------------------------------------------------------------------------------


def travel(p: Seeker, slope: Any) -> Any:
    """How much of a cell the plane needs beside it: (n + 1) (k slope + rho) T + 2 N'; <= beta.

    Proof note: N' = N + k slope lag. Let delta >= beta - N' at a tick and below it at the next. All
    signs from that one on are +, as long as delta stays above N'. They act n ticks later, so
    delta turns at the latest n + 1 ticks after, at beta - N' - (n + 1) (k slope + rho) T >= N'. The
    same above the plane, where it is left by (n + 1) (k slope - rho) T only.
    """
    return (p.late + 1) * (p.k * slope + p.rho) * p.T + 2 * heard_error(p, slope)


def heard_error(p: Seeker, slope: Any) -> Any:
    """Error of what is heard: N + k slope lag."""
    return p.noise + p.k * slope * p.lag


def loss(p: Seeker, slope: Any) -> Any:
    """How far mu falls behind a climb at rho at most, from any start, where ``travel`` <= beta.

    Proof note: mu(t) - mu(0) = rho t + delta(t) - delta(0). The plane that catches lies at most
    beta + N' below the start, or n ticks of rho further where the first tick is heard late. It is
    left by ``travel`` - N' at most. mu is ahead of what is heard by what k moves in the dead time
    and the lag at most. All of it is below 3 beta.
    """
    moved = p.k * slope * (p.late * p.T + p.lag)
    return p.beta + travel(p, slope) + p.late * p.rho * p.T + moved


def least_gain(p: Seeker, slope: Any, time: Any) -> Any:
    """How much of mu is gained after a time at least: rho times its whole ticks, less the loss."""
    return p.rho * math.floor(time / p.T) * p.T - loss(p, slope)


def gained_at_most(p: Seeker, slope: Any, time: Any) -> Any:
    """How much of mu is gained by then from a start just below a turning plane, without noise.

    Proof note: delta starts at 2 beta (1 - 1e-6) and falls to beta. From there on it exceeds
    beta by (n + 1) (k slope - rho) T and what the lag hides at most.
    """
    above = (p.late + 1) * (p.k * slope - p.rho) * p.T
    moved = p.k * slope * (p.late * p.T + 3 * p.lag)
    start = 2 * p.beta * (1 - Fraction(1, 10**6))
    return p.rho * math.floor(time / p.T) * p.T + p.beta + above + moved - start


def first_tick_behind(
    p: Seeker, slope: Any, start: Any, against: bool, ticks: int
) -> tuple[int, Any]:
    """Tick at which mu first is 3 beta behind a climb at rho, and by how much; (0, 0) if never.

    Args:
        p: a seeker without lag. slope: mu' of a straight map. start: delta at rest.
        against: whether the noise always says -, where it can. ticks: how many at most.
    """
    scale = 1
    for x in (p.k * slope * p.T, p.rho * p.T, p.beta, start, p.noise):
        scale = math.lcm(scale, Fraction(x).denominator)
    move, fall, cell, delta, noise = (
        int(Fraction(x) * scale) for x in (p.k * slope * p.T, p.rho * p.T, p.beta, start, p.noise)
    )
    noise = noise if against else 0
    waiting, gain, aim = [0] * p.late, 0, 0
    for tick in range(1, ticks + 1):
        place = delta % (2 * cell)
        up = noise <= place <= cell - noise if against else place <= cell
        waiting.append(1 if up else -1)
        delta += waiting.pop(0) * move - fall
        gain, aim = gain + (move if up else -move), aim + fall
        if aim - gain >= 3 * cell:
            return tick, Fraction(aim - gain, scale)
    return 0, 0


# ---- at the peak --------------------------------------------------------------------------------


def flat_ripple(p: Seeker) -> Any:
    """Longest distance of v between two turns on a flat top: k T (floor((beta + 2 N)/(rho T)) + 1).

    Proof note: delta falls by rho T per tick, and hears + while it lies in a closed cell that the
    noise makes longer by N at both ends.
    """
    return p.k * p.T * (math.floor((p.beta + 2 * p.noise) / (p.rho * p.T)) + 1)


def zone(p: Seeker, curvature: Any) -> Any:
    """Distance from the peak of a parabola at which sliding stops, r = rho/(k |mu''|)."""
    return p.rho / (p.k * abs(curvature))


def ripple_sides(p: Seeker, curvature: Any) -> list[tuple[str, Any, Any]]:
    """Inequalities (text, left, right) under which ``ripple`` bounds what a parabola ends in.

    Proof note: let x = v - v*, c = |mu''|. While s = 1, delta + c (x + r)^2/2 stays as it is, tick
    by tick, and while s = -1 delta + c (x - r)^2/2 does. From turn to turn delta falls by D in
    beta +- E. Let z be the place of its start seen in its own direction. A half cycle takes it to
    F(z) = r - sqrt(max(z + r, 0)^2 + 2 D/c), which falls in z and in D. E is 2 N' + (n + 1) times
    what a tick moves delta, below 4 rho T where |x| <= 2 r. Outside of r it slides towards r, and
    the half cycle starts as from r. So z ends in the largest interval that F maps onto itself. It
    does not reach to -r, where F bends, if (A + B)^2 <= 16 r^2 A, A and B being 2 D/c of both ends.
    And it does not get to 2 r from |x| <= r, noise and delay included.
    """
    c, r, half = abs(curvature), zone(p, curvature), p.k * p.T / 2
    error = 2 * heard_at_peak(p, 2) + 4 * (p.late + 1) * p.rho * p.T
    low, high = 2 * (p.beta - error) / c, 2 * (p.beta + error) / c
    extra = 2 * error / c
    return [
        ("E < beta", error, p.beta),
        ("(A + B)^2 <= 16 r^2 A", (low + high) ** 2, 16 * r * r * low),
        ("(r^2 + B + 2 E/c)^2 <= 4 r^2 (4 r^2 + B)",
         (r * r + high + extra) ** 2, 4 * r * r * (4 * r * r + high)),
        ("|x| at a turn <= r", farthest_turn(p, curvature, error) + half, r),
    ]  # fmt: skip


def heard_at_peak(p: Seeker, zones: int) -> Any:
    """Error of what is heard within so many zones of the peak, where k |mu'| <= zones rho."""
    return p.noise + zones * p.rho * p.lag


def farthest_turn(p: Seeker, curvature: Any, error: Any) -> Any:
    """Largest |x| of a turn in the end, k beta/(2 rho) + r E/beta.

    Proof note: the ends a <= b of the interval obey (r - a)^2 = (b + r)^2 + B and
    (r - b)^2 = (a + r)^2 + A. So a + b = -(A + B)/(4 r) and b - a = r (B - A)/((A + B)/2).
    """
    return p.k * p.beta / (2 * p.rho) + zone(p, curvature) * error / p.beta


def ripple(p: Seeker, curvature: Any) -> Any:
    """Width of the interval about the peak of a parabola in which v ends, whatever the noise.

    2 X, X = (k beta/(2 rho) + r (2 N + m)/beta)/(1 - (2 rho lag + m)/beta), m = (n + 1) rho T, and
    of that whole ticks' ways k T. Proof note: see ``ripple_sides``. Within |x| <= X a tick moves
    delta by rho T (1 + X/r) at most. What is heard is wrong by N + rho lag X/r, so that
    E = 2 N + m + (2 rho lag + m) X/r. From X = r on, each X gives an E and that the next X, by
    ``farthest_turn``; the limit is where both are the same. All v of a run differ by whole k T.
    """
    m = (p.late + 1) * p.rho * p.T
    share = 1 - (2 * p.rho * p.lag + m) / p.beta
    if share <= 0:  # then ``ripple_sides`` fail too
        return 2 * zone(p, curvature)
    width = 2 * farthest_turn(p, curvature, 2 * p.noise + m) / share
    return math.floor(width / (p.k * p.T)) * (p.k * p.T)


class Turn(NamedTuple):
    """A half cycle: tick and place at its end, and its direction."""

    tick: int
    x: Any
    side: int


def turns(p: Seeker, curvature: Any, x: Any, left: int, right: int) -> Iterator[Turn]:
    """Half cycles on a parabola, with the noise that drives to the left, then to the right, thrice.

    It starts at rest at x with delta = beta/2, which is heard as +; places are told as they are
    heard, a dead time late. Within the zone only, where delta falls at each tick; it ends where
    that is left.

    Args:
        p: a seeker without lag. curvature: mu''. x: start, less the peak.
        left, right: how many half cycles of each in a period.
    """
    c, r = abs(curvature), zone(p, curvature)
    step, fall = p.k * p.T, p.rho * p.T
    delta, edge, tick, side = p.beta / 2 - p.late * fall, 0 * p.beta, p.late, 1
    for number in range(PERIODS * (left + right)):
        towards = (1 if number % (left + right) >= left else -1) == side
        limit = edge - p.noise if towards else edge + p.noise

        def after(m: int, x: Any = x, delta: Any = delta, side: int = side) -> Any:
            """Give delta m ticks on."""
            new = x + side * m * step
            return delta - c * (new * new - x * x) / 2 - m * fall

        most = math.ceil((delta - limit) / fall) * 2 + 4
        while after(most) >= limit:
            if most > 10**9:
                return
            most *= 2
        low = 0
        while most - low > 1:
            middle = (low + most) // 2
            low, most = (middle, most) if after(middle) >= limit else (low, middle)
        count = most + p.late
        delta, x, tick = after(count), x + side * count * step, tick + count
        if abs(x) + step > r:
            return
        yield Turn(tick, x, side)
        side, edge = -side, edge - p.beta


def last_swing(found: list[Turn], left: int, right: int) -> Any:
    """Width of the turns of the last period but one.

    It is 0 if the run left the zone, or if the width still falls from a period to the next. What a
    start brings is not what v ends in.
    """
    period = left + right
    if len(found) < PERIODS * period or left < 2 or right < 2:
        return 0
    widths = []
    for end in (len(found) - period, len(found)):
        places = [t.x for t in found[end - period : end]]
        widths.append(max(places) - min(places))
    return widths[0] if widths[1] >= widths[0] else 0


def lyapunov(delta: Any, slope: Any, k: float, rho: float, beta: float) -> tuple[Any, Any]:
    """V and V', V = x^2/2, x = sin(pi delta/beta) of the sliding-mode seeker; Cheng 2022 (25)-(28).

    delta' = k mu' sgn x - rho; V' = x cos(pi delta/beta) (pi/beta) delta', negative around odd
    multiples of beta for k mu' > rho, and around even ones for k mu' < -rho.
    """
    x = np.sin(np.pi * delta / beta)
    rate = np.pi / beta * np.cos(np.pi * delta / beta) * (k * slope * np.sign(x) - rho)
    return x * x / 2, x * rate
