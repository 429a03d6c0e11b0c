"""A metric over a map: the loop itself is run at each point of the grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.design.goals import single
from slipctl.errors import BadInput
from slipctl.run.sweep.sweep_runs import Measured

NEAR = 1e-9
"""How far a number of the loop may be from that of its certificate, as a share."""


@dataclass(frozen=True)
class Levels:
    """A metric over the grid of a map.

    Attributes:
        metric: its name. unit: its unit. places: numbers of the loop that the axes set.
        values: a row for each value of y; infinite or NaN where a run gave none.
        here: at the design point.
    """

    metric: str
    unit: str
    places: tuple[str, str]
    values: Sequence[Sequence[float]]
    here: float

    def payload(self) -> dict[str, Any]:
        """Entries of the file of data; None where there is no number."""
        return {
            "name": self.metric, "unit": self.unit, "set": list(self.places),
            "here": _plain(self.here), "values": [[_plain(v) for v in row] for row in self.values],
        }  # fmt: skip

    def text(self) -> str:
        """Its range on the grid, and the design point."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        found = [v for row in self.values for v in row if math.isfinite(v)]
        if not found:
            return f"{self.metric}: no run gave one"
        lost = sum(len(row) for row in self.values) - len(found)
        return (
            f"{self.metric}: {min(found):.4g} to {max(found):.4g}{unit}, {self.here:.4g}{unit} at"
            f" the design point" + (f"; {lost} runs gave none" if lost else "")
        )


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


def places(
    loop: Block, controller: str, names: Sequence[str], numbers: Mapping[str, float]
) -> tuple[str, str]:
    """Numbers of a loop's controller that have the names and the values of a certificate's.

    Raises:
        BadInput: none has, or several have.
    """
    now, found = loop.values_by_place(), []
    for name in names:
        same = [
            p for p, v in now.items()
            if p.startswith(f"{controller}.") and p.rpartition(".")[2] in (name, _apart(name))
            and np.shape(v) == () and math.isclose(float(v), float(numbers[name]), rel_tol=NEAR)
        ]  # fmt: skip
        shortest = [p for p in same if p.count(".") == max(q.count(".") for q in same)]
        if len(shortest) != 1:
            what = f"several have it: {', '.join(same)}" if same else f"nothing in {controller} has"
            raise BadInput(f"--metric: {name} of the map is no number of the loop; {what}"
                           + ("" if same else f" {name} = {float(numbers[name]):g}"))  # fmt: skip
        found.append(shortest[0])
    return found[0], found[1]


def _apart(name: str) -> str:
    """``k1`` as a model may have it, ``k_1``."""
    return f"{name[:-1]}_{name[-1]}" if name[-1:].isdigit() else name


def levels(
    measured: Measured, metric: str, at: tuple[str, str], xs: np.ndarray, ys: np.ndarray,
    jobs: int = 1, tell: Callable[[float], None] = lambda share: None,
) -> Levels:  # fmt: skip
    """Run the loop at each point of a grid.

    Args:
        measured: the loop in its scenario. metric: its name. at: numbers that x and y set.
        xs, ys: values. jobs: runs at once. tell: told the share done.

    Raises:
        BadInput: the loop does not have this metric, or fails at the design point.
    """
    here = measured.ended(0, {})
    if here.failed:
        raise BadInput(f"--metric {metric}: the loop fails at the design point: {here.failed}")
    if metric not in here.metrics:
        known = ", ".join(here.metrics)
        raise BadInput(f"--metric {metric}: this loop does not have it; it has {known}")
    points = [(float(x), float(y)) for y in ys for x in xs]

    def one(point: tuple[float, float]) -> float:
        ended = measured.ended(1, dict(zip(at, point, strict=True)))
        return single(ended.metrics[metric]) if not ended.failed else math.nan

    values = []
    pool = ThreadPoolExecutor(jobs)
    try:
        for k, value in enumerate(pool.map(one, points)):
            values.append(value)
            tell((k + 1) / len(points))
    finally:
        pool.shutdown(cancel_futures=True)
    wide = len(xs)
    rows = [values[k : k + wide] for k in range(0, len(values), wide)]
    found = here.metrics[metric]
    return Levels(metric, found.unit, at, rows, single(found))
