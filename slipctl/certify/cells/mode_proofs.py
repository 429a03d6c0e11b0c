"""Evidence that a loop with modes stays: which grid, which set, and what a file holds of it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from slipctl.certify.cells.mode_cells import (
    Ends,
    Grid,
    ModeLoop,
    Reach,
    check_cells,
    dyadic,
    read_cells,
    read_grid,
    ways_to_check,
)
from slipctl.certify.cells.mode_growth import Growth, Work
from slipctl.certify.cells.mode_runs import Bounds, Runs, worst_runs
from slipctl.certify.entries import DoesNotHold, read_mapping
from slipctl.certify.smooth.sums import NoProof

CELLS = {1: (200, 2000, 20_000), 2: (60, 150, 400, 1000), 3: (28, 44, 70, 110, 160)}
"""Cells along what runs visit of each real state, that are tried one after another."""

MOST_REALS = max(CELLS)

WORK = 600_000_000
"""Operations of a search: cells, by every way through the tick, times operations of the tick."""

WIDEST = 6
"""Times what runs visit, that a grid may be wide."""

GAIN = 0.05
"""Share by which a finer grid has to be better, else none is tried after it."""

FARTHEST = 2.0**62
"""Cells from zero as far as whole numbers count."""

NEAR = Fraction(1, 10**9)
"""Share beyond a bound that floats may find: whole numbers then have to confirm the bound."""


@dataclass(frozen=True)
class Found:
    """A proof.

    Attributes:
        entries: what a file holds. reach: of the real states. runs: what was simulated.
    """

    entries: dict[str, Any]
    reach: Reach
    runs: Runs


def find_cells(loop: ModeLoop, bounds: Bounds, runs: Runs, work: int = WORK) -> Found:
    """Cells that keep states within bounds; those of the finest grid where nothing is bounded.

    Args:
        loop: the loop. bounds: what is asked. runs: what runs come to.
        work: operations that it may take.

    Raises:
        NoProof: none were found; the words say why.
    """
    axes = len(loop.reals)
    if axes > MOST_REALS:
        raise NoProof(f"it has {axes} states that are real numbers ({', '.join(loop.reals)}); cells"
                      f" take {MOST_REALS} beside modes")  # fmt: skip
    left, best, why = Work(work), None, ""
    for name, (low, high) in bounds.items():
        if name not in loop.reals:
            continue
        k = loop.reals.index(name)
        if not _within(runs.low[k], runs.high[k], (low, high), NEAR):
            raise NoProof(f"a run comes to {name} = {runs.high[k]:.4g}")
    tried = [(span, tuple(dyadic(s / many) for s in span))
             for span in _spans(loop, bounds, runs) for many in CELLS[axes]]  # fmt: skip
    for span, sizes in [(tried[0][0], loop.sizes)] if loop.sizes else tried:
        begun = left.left
        try:
            found = _grown(loop, bounds, runs, (span, sizes), left)
        except (NoProof, ArithmeticError) as error:
            why = why or str(error)
            if left.left < 0:
                break
            continue
        if best is None or _better(loop, found, best) > 0:
            gain, best = _better(loop, found, best), found
            if any(b is not None for ends in bounds.values() for b in ends) or gain < GAIN:
                break
        if 3 * (begun - left.left) > left.left:
            break
    if best is None:
        raise NoProof(why or "no cells were found that no tick leaves")
    return best


def _better(loop: ModeLoop, new: Found, old: Found | None) -> float:
    """Share by which what is proved of the watched states is nearer to what runs come to."""
    if old is None:
        return 1.0
    gains = []
    for name in loop.watched:
        k = loop.reals.index(name)
        nearer = float(old.reach.high[name] - new.reach.high[name])
        gains.append(nearer / max(abs(new.runs.high[k]), 1e-9))
    return max(gains)


def _grown(
    loop: ModeLoop, bounds: Bounds, runs: Runs, sizes: tuple[np.ndarray, tuple[Fraction, ...]],
    work: Work,
) -> Found:  # fmt: skip
    """Set over a grid of cells of some size, about as wide as a span.

    Raises:
        NoProof: none was found.
    """
    span, size = sizes
    wide = np.array([float(s) for s in size])

    def cells_around(room: float) -> np.ndarray:
        with np.errstate(all="ignore"):
            ends = [np.minimum(runs.low, starts[0]) - room * span,
                    np.maximum(runs.high, starts[1]) + room * span]  # fmt: skip
            if not (np.abs(ends) < FARTHEST * wide).all():
                raise NoProof("its runs go farther than cells reach")
        return np.array([np.floor(ends[0] / wide) - 1, np.floor(ends[1] / wide) + 1], np.int64)

    starts = np.array([[float(a), float(b)] for a, b in loop.start]).reshape(-1, 2).T
    (first, last), (low, high) = cells_around(WIDEST), cells_around(0.3)
    for name, (least, most) in bounds.items():
        if name not in loop.reals:
            continue
        k = loop.reals.index(name)
        if least is not None:
            first[k] = max(first[k], int(np.floor(float(least) / wide[k])) - 1)
        if most is not None:
            last[k] = min(last[k], int(np.floor(float(most) / wide[k])) + 1)
    low, high = np.maximum(low, first), np.minimum(high, last)
    grid = Grid(tuple(map(int, low)), size, tuple(map(int, high - low + 1)),
                _box(loop, bounds))  # fmt: skip
    growth = Growth(loop, grid, work, first, last)
    cells = growth.run(runs.visited[:: max(1, len(runs.visited) // 200)])
    _keep(growth.reach, bounds, NEAR)
    entries = {"grid": growth.grid.payload(), "cells": cells.packed()}
    return Found(entries, growth.reach, runs)


def _spans(loop: ModeLoop, bounds: Bounds, runs: Runs) -> list[np.ndarray]:
    """What runs visit of each real state; then a part of its bounds where they go nowhere."""
    span = np.maximum(runs.high - runs.low, 1e-6 * (1 + np.abs(runs.high)))
    wider = span.copy()
    for k, (low, high) in enumerate(_box(loop, bounds)):
        if low is not None and high is not None:
            wider[k] = max(span[k], float(high - low) / 20)
    return [span] if (wider == span).all() else [span, wider]


def _box(loop: ModeLoop, bounds: Bounds) -> tuple[Ends, ...]:
    """Bounds of each real state, in order."""
    return tuple(bounds.get(name, (None, None)) for name in loop.reals)


def _within(low: Any, high: Any, ends: Ends, room: Fraction = Fraction(0)) -> bool:
    """Whether a range is within its ends, or no more than such a share beyond."""
    least, most = ends
    return (least is None or low >= least - room * abs(least)) and (
        most is None or high <= most + room * abs(most)
    )


def _keep(reach: Reach, bounds: Bounds, room: Fraction = Fraction(0)) -> None:
    """Confirm that what is reached is within bounds, or no more than such a share beyond.

    Raises:
        NoProof: it is not.
    """
    for name, ends in bounds.items():
        if not _within(reach.low[name], reach.high[name], ends, room):
            raise NoProof(f"the cells that are proved reach to {name} ="
                          f" {float(reach.high[name]):.4g}")  # fmt: skip


def check_evidence(loop: ModeLoop, bounds: Bounds, given: Any) -> tuple[Reach, str]:
    """Confirm a proof of a file; gives what is reached, and the arithmetic of the check.

    Raises:
        DoesNotHold: it proves nothing. BadInput: it is malformed.
    """
    entry = read_mapping(given, ("grid", "cells"), "evidence", True)
    if len(loop.reals) > MOST_REALS:
        raise DoesNotHold(f"evidence: cells take {MOST_REALS} real states")
    grid = replace(read_grid(entry["grid"], len(loop.reals)), box=_box(loop, bounds))
    cells = read_cells(entry["cells"], grid, len(loop.modes))
    *firsts, (last, how) = ways_to_check(loop, cells)
    for kind, words in firsts:
        with suppress(DoesNotHold, NoProof):
            reach = check_cells(loop, grid, cells, kind)
            _keep(reach, bounds)
            return reach, words
    reach = check_cells(loop, grid, cells, last)
    try:
        _keep(reach, bounds)
    except NoProof as error:
        raise DoesNotHold(f"evidence: {error}") from None
    return reach, how


def run_ticks(loop: ModeLoop) -> int:
    """Ticks of a run of the search."""
    return 500 * min(max(round(loop.stride / 2.5), 1), 4)


def runs_of_loop(loop: ModeLoop, most: int | None = None, bounds: Bounds | None = None) -> Runs:
    """Runs of a loop, of so many ticks at most; with bounds none farther than one beyond them."""
    ticks = run_ticks(loop)
    return worst_runs(loop, ticks if most is None else min(ticks, most), bounds=bounds)
