"""Metrics of a brake that works on air, of a stop beside that on clean rail, and of a mark.

They are what a board asks after a stop. How much longer was it than on clean rail? Did the train
pass the mark? What air did it take, and how often did the valves move?
"""

from __future__ import annotations

import numpy as np

from slipctl.run.measures.measured_run import Definition, Metric, Run, entry

BRAKES: dict[str, Definition] = {}
"""What each metric of a brake is."""

LITRES = 1e3
"""Litres in a cubic metre."""

_metric = entry(BRAKES)


@_metric(
    "stopping distance over that of the same loop on clean rail, less 1", "low", event=True,
    bound=True,
)  # fmt: skip
def _extension(run: Run) -> Metric | None:
    clean = run.clean.get("stopping_distance")
    x = run.travelled
    if clean is None or x is None:
        return None
    if run.stop is None or clean.value is None:
        return Metric(None, "1")
    return Metric(float(x[run.stop]) / float(clean.value) - 1, "1")  # type: ignore[arg-type]


@_metric("way by which the first axle passes the mark; 0 before it", "low", event=True)
def _overrun(run: Run) -> Metric | None:
    mark, x = run.get("mark"), run.get("position")
    if mark is None or x is None:
        return None
    if run.stop is None:  # it still moves, and nobody knows where it comes to
        return Metric(None, "m")
    return Metric(max(float(x[run.stop] - mark[-1]), 0.0), "m")


@_metric("free air that all cylinders have taken from their supply", "low")
def _air_used(run: Run) -> Metric | None:
    air = run.get("air_used")
    return None if air is None else Metric(LITRES * float(air[-1]), "l")


@_metric("least pressure of the reservoir, gauge", "high")
def _air_left(run: Run) -> Metric | None:
    left = run.get("air_left")
    return None if left is None else Metric(float(left.min()) * 1e-5, "bar")


@_metric("changes of the valves of the axle on which they move most", "low")
def _valve_operations(run: Run) -> Metric | None:
    changes = run.each("valve_changes")
    return None if changes is None else Metric(int(np.max(changes[-1] - changes[0])), "1")
