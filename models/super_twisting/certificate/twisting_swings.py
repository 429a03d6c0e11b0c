"""Runs of explicit super-twisting that swing far, half turn after half turn.

At each w = j h the largest y >= 0 that a run from the origin is seen to come to, from the top
downwards. Each point is that of a run, and so is what a tick makes of it. Where a tick crosses
y = 0 its mirror image enters the next half turn; an entry is kept until a larger one comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Law, windows

MOST_TICKS = 20_000
"""Most ticks of a run."""


@dataclass(frozen=True)
class _Half:
    """Points of a half turn: largest y at each w, entries, and the half turn that these are of."""

    y: np.ndarray
    entry: np.ndarray
    since: np.ndarray


def search(law: Law, wanted: Fraction, work: float) -> list[Fraction] | None:
    """Disturbance, tick by tick, that leads from y = w = 0 to |y| > ``wanted``; None if none.

    Args:
        law: gains, without noise. wanted: of y. work: limit, about seconds.
    """
    slow, L = law.k2 - law.L, law.L
    if slow <= 0 or law.N or law.M:
        return None
    parts = max(1, math.ceil(8 * slow / L)) if slow > L / 12 else 1
    h = max(slow / parts, L / 40)
    first, last = math.ceil(slow / h), math.floor((law.k2 + L) / h)
    still, limit = math.floor(L / h), float(wanted) * (1 + 1e-9)
    top = 2 * last + math.ceil(math.sqrt(2 * float(law.k2 + L) * limit) / float(h))
    if top > 20_000:
        return None
    w = np.arange(-top, top + 1) * float(h)
    entry, since = np.full(len(w), EMPTY), np.zeros(len(w), int)
    start = np.arange(1, still + 1)
    entry[top + still + start] = start * float(h)  # two ticks from the origin
    halves: list[_Half] = []
    blocks = 2 * top / first
    before, spent = 0.0, 0.0
    while spent < work:
        spent += blocks * (1.5e-5 + 3e-8 * last)
        y = _sweep(float(law.k1), w, entry, first, last)
        halves.append(_Half(y, entry, since))
        if y.max() > limit:
            return _read_back(law, halves, h, (first, last, still))
        if len(halves) % 16 == 0:
            if not y.max() > before * (1 + 1e-4):
                return None
            before = float(y.max())
        # across: y' = |w| + k1 root(y) - y, w' = |w| + c
        low = y[top::-1]
        gained = np.where(low >= 0, np.sqrt(np.maximum(low, 0.0)), 0.0) * float(law.k1)
        out = np.where(low > 0, gained - low - w[top::-1], EMPTY)
        out[out <= 0] = EMPTY
        moved = windows(np.concatenate([np.full(last, EMPTY), out]), last - first + 1)
        new = np.full(len(w), EMPTY)
        new[top + first :] = moved[first : first + top + 1 - first]
        better = new > entry
        entry, since = np.where(better, new, entry), np.where(better, len(halves), since)
    return None


def _sweep(k1: float, w: np.ndarray, entry: np.ndarray, first: int, last: int) -> np.ndarray:
    """Largest y at each w, from the entries on."""
    y, gone = entry.copy(), np.full(len(w) + last, EMPTY)
    for at in range(len(w), 0, -first):
        begin = max(at - first, 0)
        best = windows(gone[begin + first : at + last], last - first + 1)
        here = np.maximum(entry[begin:at], best)
        live = here > 0
        y[begin:at] = np.where(live, here, EMPTY)
        size = np.where(live, here, 0.0)
        gone[begin:at] = np.where(live, size - k1 * np.sqrt(size) + w[begin:at], EMPTY)
    return y


def _read_back(
    law: Law, halves: list[_Half], h: Fraction, moves: tuple[int, int, int]
) -> list[Fraction] | None:
    """Disturbance of the run that ends in the largest y of the last half turn."""
    first, last, still = moves
    top, k1, step = len(halves[0].y) // 2, float(law.k1), float(h)
    turn = len(halves) - 1
    place = int(halves[-1].y.argmax())
    d: list[Fraction] = []
    side = 1
    while len(d) < MOST_TICKS:
        half = halves[turn]
        sources = np.arange(place + first, min(place + last, 2 * top) + 1)
        y = half.y[sources]
        size = np.maximum(y, 0.0)
        gone = np.where(y > 0, size - k1 * np.sqrt(size) + (sources - top) * step, EMPTY)
        if len(gone) and gone.max() >= half.entry[place]:
            source = int(sources[gone.argmax()])
            d.append(side * (law.k2 - (source - place) * h))
            place = source
            continue
        turn = int(half.since[place])
        if turn == 0:  # two ticks from the origin
            d += [side * still * h, side * (place - top - still) * h]
            return d[::-1]
        before, m = halves[turn - 1], place - top
        low = np.arange(max(m - last, 0), m - first + 1)
        y = before.y[top - low]
        size = np.maximum(y, 0.0)
        out = np.where(y > 0, k1 * np.sqrt(size) - size + low * step, EMPTY)
        best = int(low[out.argmax()])
        # seen from the half turn before it is w = -best, pulled down by c
        d.append(-side * (law.k2 - (m - best) * h))
        place, turn, side = top - best, turn - 1, -side
    return None
