"""How safe gains of a law are: their certificate, the region about them, and the worst run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.certify import proofs, systems
from slipctl.certify.promise import exact_numbers
from slipctl.design import maps
from slipctl.design.gain_points import GainPoints
from slipctl.errors import BadInput
from slipctl.study.declaration import Gains
from slipctl.workbench.curves import Curves, Panel, Series
from slipctl.workbench.desk import Rig

POINTS = 11
"""Of a region, each way."""

AROUND = 5.0
"""How far it goes from the point, as a factor to either side."""


def points_of_gains(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> GainPoints:
    """What a certificate asks of a loop with these numbers, and of points about it."""
    loop = rig.loop.with_params(**numbers) if numbers else rig.loop
    return GainPoints(gains, loop, rig.study.controller)


def movable_gains(rig: Rig, points: GainPoints) -> dict[str, str]:
    """Numbers of a certificate that are numbers of the law: their names in the loop."""
    known = {s.name for s in rig.sliders}
    found = {n: points.place(n) for n, v in points.here.items() if v > 0}
    return {n: at for n, at in found.items() if at in known}


def verdict_of_gains(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> dict[str, Any]:
    """Certificate of a loop with these numbers: verdict, promise and margins in words.

    Raises:
        BadInput: numbers that mean nothing.
    """
    system, given = points_of_gains(rig, gains, numbers).at({})
    report = systems.report(system, given)
    decision = report.decision
    missing = [decision.promise.claims[k] for k in decision.open]
    return {
        "name": gains.name, "verdict": report.verdict, "promise": str(decision.promise),
        "shows": decision.shows or "", "open": missing, "bounds": gains.bounds,
        "numbers": given, "units": {k: report.units.get(k, "1") for k in given},
        "margins": [
            {"criterion": c, "number": m.partition("_")[2], "side": m.partition("_")[0], "value": v}
            for c, f in report.criteria.items() for m, v in f.margins.items() if v is not None
        ],
        "witness": list(report.witness.lines()) if report.witness is not None else [],
    }  # fmt: skip


def region_rows(
    rig: Rig, gains: Gains, numbers: Mapping[str, float], names: tuple[str, str] | None = None,
    points: int = POINTS,
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Region of two gains about where they are, told row by row.

    Args:
        rig, gains: loop and certificate. numbers: as the sliders have them.
        names: of the certificate's numbers along x and y; by default the first two that the law
            has. points: each way.

    Each point is decided as a point of ``slipctl certify --map`` is, with the bounds of its loop.

    Yields:
        Axes first, then each row of verdicts and margins; nothing between, after each point.

    Raises:
        BadInput: the law has not two such numbers.
    """
    points_of = points_of_gains(rig, gains, numbers)
    movable = movable_gains(rig, points_of)
    chosen = names or tuple(movable)[:2]
    if len(chosen) != 2 or not all(n in movable for n in chosen):
        has = ", ".join(movable) or "none"
        raise BadInput(f"a region needs two gains of the certificate {gains.name}; it has {has}")
    system, given = points_of.at({})
    exact = exact_numbers(system, given)
    wanted = ",".join(f"{n}={given[n] / AROUND!r}:{given[n] * AROUND!r}" for n in chosen)
    axes = maps.read_axes(wanted, system, exact)
    xs, ys = (a.values(points).tolist() for a in axes)
    yield {
        "name": gains.name, "movable": movable, "levels": list(maps.LEVELS),
        "here": proofs.decide(system, exact).verdict,
        "x": {"name": axes[0].name, "at": movable[axes[0].name], "unit": axes[0].unit,
              "values": xs, "value": given[axes[0].name]},
        "y": {"name": axes[1].name, "at": movable[axes[1].name], "unit": axes[1].unit,
              "values": ys, "value": given[axes[1].name]},
    }  # fmt: skip
    for row, y in enumerate(ys):
        found = []
        for x in xs:
            found.append(maps.point_verdict(points_of.at, {axes[0].name: x, axes[1].name: y}))
            yield {}
        yield {"row": row, "verdicts": [v for v, _ in found], "margins": [m for _, m in found]}


def worst_run(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> tuple[Curves, list[str]]:
    """What the law of a certificate does against the worst disturbance that is allowed.

    It is a run of the equations that the certificate speaks of, the error and its law, not of the
    whole vehicle: from there the disturbance is the worst.

    Args:
        rig, gains: loop and certificate. numbers: as the sliders have them.

    Returns:
        A panel for each signal, and the disturbance and what the run shows, in words.

    Raises:
        BadInput: the certificate knows no such run; numbers that mean nothing.
    """
    system, given = points_of_gains(rig, gains, numbers).at({})
    found = systems.worst_disturbance(system, given)
    if found is None:
        raise BadInput(f"{gains.name}: the certificate knows no worst run, only bounds of all runs")
    lines = found.lines()
    rows = dict(found.trajectory)
    if "t" not in rows:
        raise BadInput(f"{gains.name} has no curve of its worst run; {'; '.join(lines)}")
    time = np.array(rows.pop("t")[1], dtype=float)
    panels = []
    for name, (unit, values) in rows.items():
        scale, shown = display_scale(unit)
        series = Series(name, 0, "wanted" if name == "d" else "main", scale * np.array(values))
        panels.append(Panel("disturbance" if name == "d" else name, shown, [series]))
    return Curves(time, panels, []), lines
