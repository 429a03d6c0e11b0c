"""What the claims of ``freight_traction`` are judged on: numbers read off the logs of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slipctl import Results
from slipctl.run import periods

LOCKED = 0.997
"""Share of the peak adhesion from which on a creep counts as locked."""

NEAR = 0.05
"""Share of the best creep within which it counts as found."""

LAST = 1.0
"""Length in s of the end of a section over which means and ripples are taken."""

MU, CREEP, TORQUE = "plant.adh.mu", "plant.train.v_s", "plant.motor.T_m"
TRIED, BEST, PEAK = "ctl.seek.v", "truth.v_best", "rail.best_adhesion"

Answer = Callable[[Results], Any]


def part(
    r: Results, loop: str, signal: str, start: float, stop: float, scenario: str = "base"
) -> np.ndarray:
    """Values of a logged signal between two times in s; torques in kN m."""
    log = r.log(scenario, loop)
    t, values = log["time"].values, log[signal].values
    values = values / 1e3 if log[signal].attrs["units"] == "N m" else values
    return np.asarray(values[(t >= start - 1e-9) & (t < stop - 1e-9)])


def ends(r: Results, loop: str, section: int, scenario: str = "base") -> tuple[float, float]:
    """Begin and end in s of a section of the rail, counted from 1."""
    changes = r.log(scenario, loop).attrs["rail_changes_s"]
    duration = next(c.scenario.duration for c in r.cases if c.scenario.name == scenario)
    at = [0.0, *changes, duration]
    return at[section - 1], at[section]


def last(
    r: Results, loop: str, signal: str, section: int, scenario: str = "base", seconds: float = LAST
) -> np.ndarray:
    """Values of a signal over the last seconds of a section."""
    stop = ends(r, loop, section, scenario)[1]
    return part(r, loop, signal, stop - seconds, stop, scenario)


def mean(loop: str, signal: str, section: int = 1) -> Answer:
    """Mean over whole periods of the last second of a section."""
    return lambda r: periods.mean(last(r, loop, signal, section))


def ripple(
    loop: str, signal: str, section: int = 1, scenario: str = "base", seconds: float = LAST
) -> Answer:
    """Peak-to-peak value of the last seconds of a section."""
    return lambda r: float(np.ptp(last(r, loop, signal, section, scenario, seconds)))


def period(r: Results, loop: str, section: int) -> float | None:
    """Period in s of what the adhesion does in the last second of a section, None without one."""
    y = last(r, loop, MU, section)
    whole = periods.whole_periods(y)
    if whole == slice(0, len(y)):
        return None
    away = y[whole] - y[whole].mean()
    rises = int(np.count_nonzero((away[1:] > 0) & (away[:-1] <= 0)))
    return len(away) * tick(r, loop, "base") / max(rises, 1)


def from_when(good: np.ndarray, tick: float) -> float | None:
    """Time in s from which all ticks are good; None if they are not so for 0.5 s at least."""
    first = int(np.flatnonzero(~good)[-1]) + 1 if not good.all() else 0
    return None if (good.size - first) * tick < 0.5 else first * tick


def locked(loop: str, section: int = 1, scenario: str = "base") -> Answer:
    """Time in s from which a section has 99.7 % of the peak adhesion for good; None if never."""

    def found(r: Results) -> float | None:
        span = ends(r, loop, section, scenario)
        share = part(r, loop, MU, *span, scenario) / part(r, loop, PEAK, *span, scenario)
        return from_when(share >= LOCKED, tick(r, loop, scenario))

    return found


def found(loop: str, section: int = 1, scenario: str = "base") -> Answer:
    """Time in s from which a section has its best creep within 5 % for good; None if never."""

    def told(r: Results) -> float | None:
        span = ends(r, loop, section, scenario)
        share = part(r, loop, CREEP, *span, scenario) / part(r, loop, BEST, *span, scenario)
        return from_when(np.abs(share - 1) <= NEAR, tick(r, loop, scenario))

    return told


def tick(r: Results, loop: str, scenario: str) -> float:
    """Time in s from one row of a log to the next."""
    t = r.log(scenario, loop)["time"].values
    return float(t[1] - t[0])


def middle(r: Results, loop: str, section: int = 1) -> float:
    """Middle of what a seeker tries at the end of a section, by the best creep."""
    best = float(last(r, loop, BEST, section)[-1])
    return periods.mean(last(r, loop, TRIED, section)) / best


def lost(loop: str, change: float, seconds: float = 1.0) -> Answer:
    """Mean share of the peak adhesion that is not used after a change of the rail in s."""

    def share(r: Results) -> float:
        span = (change, change + seconds)
        return float(1 - np.mean(part(r, loop, MU, *span) / part(r, loop, PEAK, *span)))

    return share


def roughness(loop: str, change: float, seconds: float = 1.0) -> Answer:
    """Total variation of the adhesion's share of the peak in the time after a change of rail."""

    def moved(r: Results) -> float:
        span = (change, change + seconds)
        share = part(r, loop, MU, *span) / part(r, loop, PEAK, *span)
        return float(np.abs(np.diff(share)).sum())

    return moved
