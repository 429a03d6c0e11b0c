"""A map of two numbers of a system: where its promise is proved, refuted, or neither.

Each point of a grid is decided as ``slipctl certify`` decides it, with rationals and enclosures;
nothing is said of what lies between the points. Bounds are those that the loop has at the point; of
a system without a loop, those that were told. Level lines of the margin go between points that are
proved with so many times the bounds and such that are not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl import __version__
from slipctl.block.units.unit_algebra import read_range
from slipctl.certify import proofs
from slipctl.certify.promise import CERTIFIED, REFUTED, UNDECIDED, System, exact_numbers
from slipctl.design.gain_points import Asked
from slipctl.design.levels import Levels
from slipctl.design.promises import with_margin
from slipctl.errors import BadInput, check_known, check_whole
from slipctl.run import store
from slipctl.seek.population import Box
from slipctl.study.jobs import Cores, run_jobs

if TYPE_CHECKING:
    from slipctl.draw import plots

LEVELS = (1.2, 2.0, 5.0)
"""Margins whose level lines are drawn."""

POINTS, MOST = 25, 200
"""Points along an axis, and most of them."""

AROUND = 10.0
"""How far an axis without a range goes from the design point, as a factor to either side."""

SHADES = ("#CFE6F5", "#9CCBEA", "#56A5D8", "#1F78B4")
"""Of what is proved, by its margin: 1, then :data:`LEVELS`."""

GREY, ORANGE = "#E8E8E8", "#E69F00"


@dataclass(frozen=True)
class Axis:
    """An axis of a map: a number of the system, its range and its unit."""

    name: str
    lo: float
    hi: float
    unit: str

    @property
    def logarithmic(self) -> bool:
        """Whether its points are evenly spaced on a logarithmic scale."""
        return bool(Box([self.lo], [self.hi]).logarithmic[0])

    def values(self, points: int) -> np.ndarray:
        """Its points."""
        box = Box([self.lo], [self.hi])
        return np.array([box.point(np.array([s]))[0] for s in np.linspace(0, 1, points)])


@dataclass(frozen=True)
class Map:
    """What was found at each point.

    Attributes:
        system: its name. what: is mapped, in words. numbers: of the design point. x, y: axes.
        verdicts: a row for each value of y; empty where the numbers mean nothing.
        margins: largest of 1 and :data:`LEVELS` up to which a point is proved; 0 where it is not.
        here: verdict of the design point. levels: a metric of the loop at each point, if asked for.
    """

    system: str
    what: str
    numbers: Mapping[str, float]
    x: Axis
    y: Axis
    verdicts: Sequence[Sequence[str]]
    margins: Sequence[Sequence[float]]
    here: str
    levels: Levels | None = None

    def count(self, verdict: str) -> int:
        """Points of a verdict."""
        return sum(v == verdict for row in self.verdicts for v in row)

    def payload(self) -> dict[str, Any]:
        """Entries of the file of data."""
        points = len(self.verdicts)
        axes = {a.name: {"unit": a.unit, "values": a.values(points).tolist()}
                for a in (self.x, self.y)}  # fmt: skip
        more = {"metric": self.levels.payload()} if self.levels else {}
        return {
            "kind": "map", "slipctl": __version__, "system": self.system, "of": self.what,
            "numbers": dict(self.numbers), "axes": axes, "verdict_here": self.here,
            "verdicts": [list(r) for r in self.verdicts],
            "margin_at_least": [list(r) for r in self.margins], **more,
        }  # fmt: skip


def read_axes(text: str, system: System, numbers: Mapping[str, Fraction]) -> tuple[Axis, Axis]:
    """Read ``k1,k2`` or ``k1=1:60,k2=1:60``.

    Without a range an axis goes from a tenth of the design point to ten times it.

    Raises:
        BadInput: not two numbers of the system, a range that is none.
    """
    found: list[Axis] = []
    for part in text.split(","):
        name, equals, ends = (p.strip() for p in part.partition("="))
        check_known(f"--map {text}: {system.name} has no", name, system.numbers)
        unit = system.numbers[name].unit
        if equals:
            pair = ends.split(":")
            if len(pair) != 2:
                raise BadInput(f"--map {part!r}: write {name}=LO:HI")
            lo, hi = read_range(pair[0], pair[1], unit, f"--map {name}")
        elif not numbers.get(name):
            raise BadInput(f"--map {text}: {name} is not given, so its axis needs a range;"
                           f" write {name}=LO:HI")  # fmt: skip
        else:
            here = float(numbers[name])
            lo, hi = sorted((here / AROUND, here * AROUND))
        if not (math.isfinite(lo) and math.isfinite(hi) and lo < hi):
            raise BadInput(f"--map {part!r}: {lo:g} to {hi:g} is no range; write lo < hi")
        found.append(Axis(name, lo, hi, unit))
    if len(found) != 2 or found[0].name == found[1].name:
        raise BadInput(f"--map {text!r}: write two numbers, such as --map k1,k2")
    return found[0], found[1]


def drawn_map(
    at: Callable[[Mapping[str, float]], Asked], axes: tuple[Axis, Axis], what: str,
    points: int = POINTS, cores: Cores | None = None,
    tell: Callable[[float], None] = lambda share: None,
) -> Map:  # fmt: skip
    """Decide each point of a grid.

    Args:
        at: gives the system and the numbers of a point, such as
            :meth:`slipctl.design.gain_points.GainPoints.at`. axes: of the map. what: is mapped, in
            words. points: along each axis. cores: that are used. tell: told the share done.

    Raises:
        BadInput: numbers of the design point that mean nothing.
    """
    check_whole("--points", points, 2, MOST)
    system, given = at({})
    numbers = exact_numbers(system, given)
    x, y = axes
    xs, ys = (a.values(points) for a in axes)

    def row(b: float) -> Callable[[Callable[[float], None]], Any]:
        def job(progress: Callable[[float], None]) -> list[tuple[str, float]]:
            return [point_verdict(at, {x.name: float(a), y.name: float(b)}) for a in xs]

        return job

    rows: dict[str, list[tuple[str, float]]] = {}
    jobs = {str(k): row(float(b)) for k, b in enumerate(ys)}
    with closing(run_jobs(jobs, cores or Cores(1), lambda name, share: None)) as outcomes:
        for name, outcome in outcomes:
            rows[name] = outcome.get()
            tell(len(rows) / points)
    table = [rows[str(k)] for k in range(points)]
    return Map(
        system.name, what, {k: float(v) for k, v in numbers.items()}, x, y,
        [[v for v, _ in r] for r in table], [[m for _, m in r] for r in table],
        proofs.decide(system, numbers).verdict,
    )  # fmt: skip


def point_verdict(
    at: Callable[[Mapping[str, float]], Asked], point: Mapping[str, float]
) -> tuple[str, float]:
    """Verdict at a point, and up to which margin it is proved."""
    try:
        system, given = at(point)
        numbers = exact_numbers(system, given)
        verdict = proofs.decide(system, numbers).verdict
    except (BadInput, ArithmeticError):
        return "", 0.0
    if verdict != CERTIFIED:
        return verdict, 0.0
    margin = 1.0
    for level in LEVELS:
        try:
            if proofs.decide(system, with_margin(system, numbers, level)).verdict != CERTIFIED:
                break
        except (BadInput, ArithmeticError):
            break
        margin = level
    return verdict, margin


def figure(found: Map) -> plots.Figure:
    """Draw it: regions, darker the larger the margin, lines between them, the design point."""
    from slipctl.draw import looks
    from slipctl.draw.regions import regions

    points = len(found.verdicts)
    proved = {(CERTIFIED, m): c for m, c in zip((1.0, *LEVELS), SHADES, strict=True)}
    kinds = proved | {(UNDECIDED, 0.0): GREY, (REFUTED, 0.0): ORANGE, ("", 0.0): "#FFFFFF"}
    names = list(kinds)
    codes = np.array([
        [names.index(pair) for pair in zip(verdicts, margins, strict=True)]
        for verdicts, margins in zip(found.verdicts, found.margins, strict=True)
    ])  # fmt: skip
    labels = [v.lower() + (f", margin {m:g}" if m > 1 else "") for v, m in names]
    sides = (found.x, found.y)
    here = [found.numbers.get(a.name) for a in sides]
    return regions(
        codes, list(kinds.values()), labels, [_edges(a, points) for a in sides],
        [looks.label(a.name, a.unit) for a in sides], [a.logarithmic for a in sides],
        here if all(h is not None for h in here) else None, found.what,
        None if found.levels is None else (
            [a.values(points) for a in sides], np.array(found.levels.values),
            looks.label(found.levels.metric.replace("_", " "), found.levels.unit),
        ),
    )  # fmt: skip


def _edges(axis: Axis, points: int) -> np.ndarray:
    """Edges of the cells about the points of an axis."""
    half = 0.5 / (points - 1)
    at = np.linspace(-half, 1 + half, points + 1)
    if axis.logarithmic:
        return axis.lo * (axis.hi / axis.lo) ** at
    return axis.lo + (axis.hi - axis.lo) * at


def write(found: Map, folder: Path, command: str) -> list[Path]:
    """Write ``map.png``, ``map.svg`` and ``map.json``; gives their names."""
    from slipctl.draw import plots

    plots.save(figure(found), folder, "map", command)
    store.write_json(folder / "map.json", {"command": command, **found.payload()})
    return [folder / f"map.{e}" for e in ("png", "svg", "json")]


def text(found: Map) -> str:
    """What a person reads on the terminal."""
    points = len(found.verdicts)
    counted = ", ".join(f"{found.count(v)} {v}" for v in (CERTIFIED, REFUTED, UNDECIDED))
    none = found.count("")
    axes = [
        f"{a.name} = {a.lo:.4g} .. {a.hi:.4g}{'' if a.unit == '1' else f' {a.unit}'}"
        for a in (found.x, found.y)
    ]
    return (
        f"{found.what}: {' by '.join(axes)}, {points} x {points} points: {counted}"
        + (f", {none} that mean nothing" if none else "")
        + f"; the design point is {found.here}"
        + (f"\n{found.levels.text()}" if found.levels else "")
    )
