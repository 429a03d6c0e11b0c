"""Curves of a run as the page draws them: panels over one time, thinned, as bytes."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.run.roles import axles_of_columns

if TYPE_CHECKING:
    from slipctl.run.metrics import Run
    from slipctl.run.results import Known

COLUMNS = 1500
"""Stretches of time of which the smallest and the largest value are kept: a screen has no more."""

KMH = 3.6
"""Kilometres an hour in a metre a second."""


@dataclass(frozen=True)
class Series:
    """A curve: what it is, its axle from 1 on (0 where it has none), its values.

    Attributes:
        name: in words. axle: its number. looks: ``main``, ``best``, ``wanted`` or ``axle``.
        values: at the times of all curves.
    """

    name: str
    axle: int
    looks: str
    values: np.ndarray


@dataclass(frozen=True)
class Panel:
    """Curves of one unit over time."""

    name: str
    unit: str
    series: list[Series] = field(default_factory=list)


@dataclass(frozen=True)
class Curves:
    """All panels of a run, and the rail that each axle is on.

    Attributes:
        time: in s. panels: over it. rails: time at which each stretch of the rail begins under
            the first axle, and its name. behind: how far each axle is behind the first one, in m.
    """

    time: np.ndarray
    panels: list[Panel]
    rails: list[tuple[float, str]]
    behind: Sequence[float] = ()


def curves_of_run(run: Run, known: Mapping[str, Known] | None = None) -> Curves:
    """Speeds of vehicle and rims, slip, torque, adhesion, air and way of a run, every axle.

    What the run does not have, it leaves out.

    Args:
        run: that has rolled. known: what its study knows of the rail beside it, by name.
    """
    behind = next((k.behind for k in (known or {}).values() if k.behind), ())
    made = (_speeds(run), *_pairs(run), _valves(run), _way(run))
    panels = [p for p in made if p is not None and p.series]
    starts = [float(run.time[0]) if len(run.time) else 0.0, *run.changes]
    return Curves(run.time, panels, list(zip(starts, run.rows, strict=False)), behind)


def _columns(run: Run, values: np.ndarray, scale: float, name: str, looks: str) -> Iterator[Series]:
    one = values.shape[1] == 1
    for k, axle in enumerate(axles_of_columns(run.signals.axles, values.shape[1])):
        yield Series(name, 0 if one else axle + 1, looks if one else "axle", scale * values[:, k])


def _speeds(run: Run) -> Panel | None:
    """Speed of the vehicle and of the rim of each axle, in km/h."""
    v, slip = run.each("speed"), run.each("slip")
    if v is None:
        return None
    panel = Panel("speed", "km/h", [Series("vehicle", 0, "best", KMH * v[:, 0])])
    rim = None
    if slip is not None:
        signed = slip * run.slip_sign
        rim = v[:, :1] - signed if run.unit("slip") == "m/s" else v[:, :1] * (1 - signed)
    elif run.unit("wheel_speed") == "m/s":
        rim = run.each("wheel_speed")
    if rim is not None:
        panel.series.extend(_columns(run, rim, KMH, "rim", "main"))
    return panel


def _pairs(run: Run) -> Iterator[Panel]:
    """What is reached, what is wanted, and what would be best."""
    for name, rows in (
        ("slip", (("slip", "slip", "main"), ("best_slip", "best", "best"),
                  ("reference", "wanted", "wanted"))),
        ("torque", (("torque", "at the wheel", "main"),)),
        ("pressure", (("pressure", "in the cylinder", "main"),)),
        ("adhesion", (("adhesion", "used", "main"), ("best_adhesion", "best", "best"))),
    ):  # fmt: skip
        first = rows[0][0]
        if run.each(first) is None:
            continue
        scale, unit = (1e-5, "bar") if name == "pressure" else display_scale(run.unit(first))
        panel = Panel(name, unit)
        for role, what, looks in rows:
            values = run.each(role)
            if values is not None:
                signed = values * (run.slip_sign if name == "slip" else _side(role, values))
                many = values.shape[1] > 1
                made = _columns(run, signed, scale, what, looks)
                panel.series.extend(
                    Series(s.name, s.axle, looks if many and looks != "main" else s.looks, s.values)
                    for s in made
                )
        yield panel


def _valves(run: Run) -> Panel | None:
    """What the two valves of each cylinder do: 1 fill, 0 hold, -1 vent."""
    hold, vent = run.each("holding"), run.each("venting")
    if hold is None or vent is None:
        return None
    does = np.where(vent > 0.5, -1.0, np.where(hold > 0.5, 0.0, 1.0))
    made = _columns(run, does, 1.0, "valve", "main")
    return Panel("valves, 1 fill, 0 hold, -1 vent", "1", list(made))


def _side(role: str, values: np.ndarray) -> int:
    """-1 for an adhesion that a model counts negative in braking: its best one is beside it."""
    return -1 if "adhesion" in role and float(np.nansum(values)) < 0 else 1


def _way(run: Run) -> Panel | None:
    way = run.travelled
    if way is None:
        return None
    return Panel("distance", "m", [Series("way", 0, "main", way[: len(run.time)])])


# ---- thinned, and as bytes -----------------------------------------------------------------------


def thin_columns(columns: Sequence[np.ndarray], stretches: int) -> list[np.ndarray]:
    """Time (the first) and values, of each stretch of time the smallest and the largest value.

    All keep two rows a stretch, so that they have one time: a peak is at most a stretch early or
    late, never lower.
    """
    rows = len(columns[0])
    if rows <= 2 * stretches:
        return list(columns)
    edges = np.linspace(0, rows, stretches + 1).astype(int)
    first, last = edges[:-1], edges[1:] - 1
    time = columns[0]
    made = [np.stack([time[first], time[last]], axis=1).ravel()]
    for values in columns[1:]:
        low, high = np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)
        rising = values[last] >= values[first]
        pair = np.where(rising[:, None], np.stack([low, high], 1), np.stack([high, low], 1))
        made.append(pair.ravel())
    return made


def frame(head: dict[str, Any], curves: Curves | None = None, stretches: int = COLUMNS) -> bytes:
    """An answer as the page reads it: length of the head, the head as JSON, columns of 32 bits."""
    columns: list[np.ndarray] = []
    if curves is not None:
        every = [s for p in curves.panels for s in p.series]
        columns = thin_columns([curves.time, *(s.values for s in every)], stretches)
        head = head | {
            "rows": len(columns[0]),
            "rails": [[t, n] for t, n in curves.rails], "behind": list(curves.behind),
            "panels": [
                {"name": p.name, "unit": p.unit,
                 "series": [{"name": s.name, "axle": s.axle, "looks": s.looks} for s in p.series]}
                for p in curves.panels
            ],
        }  # fmt: skip
    text = json.dumps(head, ensure_ascii=False, allow_nan=False, default=_plain).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(np.asarray(c, dtype="<f4").tobytes() for c in columns)
    return struct.pack("<I", len(text)) + text + body


def finite(value: float | None) -> float | None:
    """A number as JSON has it; None where it is NaN, infinite or not there."""
    return float(value) if value is not None and math.isfinite(value) else None


def _plain(value: Any) -> Any:
    """Numbers of numpy as JSON has them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no plain value")
