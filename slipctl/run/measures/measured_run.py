"""A run as metrics see it: what plays which role in its log, and what a metric is.

A log has one row per tick; a row holds the state at the start of its tick, so that the run ends one
tick after the last row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.run.roles import Bounded, Names, Signals, first_of
from slipctl.run.waveform import stretches, worst

if TYPE_CHECKING:
    import xarray

MOVING = 1.0
"""Speed in m/s below which slip and adhesion say nothing."""

STANDSTILL = 0.1
"""Speed in m/s at which a vehicle has stopped."""

LOCKED = 0.05
"""Share of the vehicle speed below which the rim of a moving wheel counts as locked."""


@dataclass(frozen=True)
class Metric:
    """A number, or a list of numbers, with its unit; None where an event never came.

    Attributes:
        value: the number or numbers.
        unit: their unit.
        rows: of a list, what each number belongs to: the rail, ``("dry", "wet")``.
    """

    value: float | int | list[float | None] | None
    unit: str
    rows: tuple[str, ...] = ()


@dataclass(frozen=True)
class Definition:
    """What a metric is.

    Attributes:
        compute: its number in a run; None where it has no meaning there.
        meaning: in words.
        better: its better end, ``"low"`` or ``"high"``; empty where neither is.
        needs: roles without which it has no meaning.
        event: whether a run may fail to reach it; a number that is None was never reached.
        bound: whether it needs another run beside it: the loop ``ideal``, or the same loop on
            clean rail.
    """

    compute: Callable[[Run], Metric | None]
    meaning: str
    better: str = ""
    needs: tuple[str, ...] = ()
    event: bool = False
    bound: bool = False

    @property
    def worst(self) -> float:
        """Worst value there is: what a run counts that never reached it; NaN without an end."""
        return {"low": math.inf, "high": -math.inf}.get(self.better, math.nan)


@dataclass
class Run:
    """A log, as the metrics see it.

    Args:
        log: dataset of ``simulate``.
        signals: which signal plays which role.
        changes: times in s at which the rail changes.
        ideal: metrics of the loop ``ideal`` in the same scenario.
        rails: name of the rail from the start and from each change on, see :func:`rail_names`.
        clean: metrics of the same loop in the scenario that its case calls ``clean``.
    """

    log: xarray.Dataset
    signals: Signals
    changes: Sequence[float] = ()
    ideal: Mapping[str, Metric] = field(default_factory=dict)
    rails: Sequence[str] = ()
    clean: Mapping[str, Metric] = field(default_factory=dict)

    @cached_property
    def time(self) -> np.ndarray:
        """Times of the ticks in s."""
        return self.log["time"].values

    @cached_property
    def tick(self) -> float:
        """Length of a tick in s."""
        period = self.log.attrs.get("period_s")
        return float(period) if period is not None else float(self.time[1] - self.time[0])

    @property
    def duration(self) -> float:
        """Length of the run in s."""
        return len(self.time) * self.tick

    def get(self, role: str) -> np.ndarray | None:
        """Values of the signal that plays ``role``, of several axles the mean, or None."""
        each = self.each(role)
        return None if each is None else each.mean(axis=1) if each.shape[1] > 1 else each[:, 0]

    def each(self, role: str) -> np.ndarray | None:
        """Values of the signal that plays ``role``, a column per axle, or None."""
        return self._columns(getattr(self.signals, role))

    def worked(self, role: str) -> np.ndarray | None:
        """The same of the axles whose slip and torque are told; the others only roll."""
        each, axles = self.each(role), self.signals.axles
        if each is None or axles is None or each.shape[1] <= len(axles):
            return each
        return each[:, list(axles)]

    def unit(self, role: str) -> str:
        """Unit of the signal that plays ``role``."""
        name = self.signals.find(role, self.log)
        return str(self.log[name].attrs.get("units", "1")) if name else "1"

    @property
    def slip_sign(self) -> int:
        """1 for a slip that is positive in braking (vehicle minus rim), -1 for one in traction."""
        return self.signals.slip_sign(self.log)

    def _columns(self, names: Names) -> np.ndarray | None:
        name = first_of(names, self.log)
        if name is None:
            return None
        return np.asarray(self.log[name].values, dtype=float).reshape(len(self.time), -1)

    def exits(self, bounded: Bounded | None) -> int | None:
        """How often the first signal leaves the interval between the other two."""
        if bounded is None:
            return None
        error, lower, upper = (
            np.array([[float(b)]]) if isinstance(b, (int, float)) else self._columns(b)
            for b in bounded
        )
        if error is None or lower is None or upper is None:
            return None
        outside = (error < lower) | (error > upper)
        return len(stretches(np.any(outside, axis=1))[0])

    def span(self, start: float, stop: float) -> slice:
        """Ticks of the time from ``start`` up to, not including, ``stop`` [s]."""
        first, last = np.searchsorted(self.time, np.array([start, stop]) - 1e-9)
        return slice(int(first), int(last))

    @property
    def stretches(self) -> list[tuple[float, float]]:
        """Start and end in s of the run on each rail."""
        return list(zip([0.0, *self.changes], [*self.changes, self.duration], strict=True))

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the rails, for a metric with a number for each."""
        return tuple(self.rails) if len(self.rails) == len(self.stretches) else ()

    @cached_property
    def moving(self) -> np.ndarray:
        """Ticks at which the vehicle is faster than 1 m/s (all, where the speed is not known)."""
        v = self.get("speed")
        return np.ones(len(self.time), dtype=bool) if v is None else np.abs(v) > MOVING

    @cached_property
    def acceleration(self) -> np.ndarray | None:
        """Acceleration in m/s^2, its sign as logged; else the difference of the speed."""
        a = self.get("deceleration")
        if a is not None:
            return a
        v = self.get("speed")
        return None if v is None or len(v) < 2 else np.diff(v, append=2 * v[-1] - v[-2]) / self.tick

    @cached_property
    def travelled(self) -> np.ndarray | None:
        """Distance in m since the start at the ticks, and once more at the end of the run."""
        v = self.get("speed")
        x = self.get("position")
        if x is None and v is None:
            return None
        if v is None or len(v) < 2:
            return None if x is None else np.append(x, x[-1]) - x[0]
        end = v[-1] + 0.5 * (v[-1] - v[-2])  # mean speed of the last tick
        if x is None:
            x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * self.tick)])
        return np.append(x, x[-1] + end * self.tick) - x[0]

    @cached_property
    def slip_error(self) -> np.ndarray | None:
        """Slip minus the slip that the controller follows, else minus the best one.

        At each tick that of the axle where it is largest.
        """
        own = self.off("reference")
        return self.off("best_slip") if own is None else own

    def off(self, wanted: str) -> np.ndarray | None:
        """Slip minus the slip that plays the role ``wanted``, of the worst axle, or None."""
        slip, level = self.each("slip"), self.each(wanted)
        return None if slip is None or level is None else worst(slip - level)

    @cached_property
    def stop(self) -> int | None:
        """First tick at standstill, or None."""
        v = self.get("speed")
        if v is None or abs(v[0]) <= STANDSTILL:
            return None
        still = np.abs(v) <= STANDSTILL
        return int(np.argmax(still)) if still.any() else None


def place(log: xarray.Dataset, rail: Any, signals: Signals) -> np.ndarray | None:
    """Time in s or position in m of each tick, as the rail counts; None without a position."""
    if rail.by == "time":
        return np.asarray(log["time"].values)
    ends = [str(n) for n in log if str(n).rpartition(".")[2] == "x"]
    name = rail.by if rail.by in log else signals.find("position", log) or next(iter(ends), None)
    return None if name is None else np.asarray(log[name].values)


def rail_changes(log: xarray.Dataset, scenario: Any, signals: Signals) -> list[float]:
    """Times in s at which the rail changes; for a rail by position, when the vehicle gets there."""
    rail = scenario.rail
    if rail is None or rail.by == "time":  # a run may end before its rail does
        last = float(log["time"].values[-1])
        return [t for t in scenario.changes if scenario.end is None or t <= last]
    x, time = place(log, rail, signals), log["time"].values
    if x is None:
        return []
    found = [int(np.argmax(x >= start)) for start in rail.starts[1:] if (x >= start).any()]
    return [float(time[k]) for k in found]


def rail_names(scenario: Any, changes: Sequence[float]) -> list[str]:
    """Name of the rail from the start and from each change on; of equal ones with time or place.

    Empty where the rail has no names, or was not left as often as it changes.
    """
    sections = () if scenario.rail is None else scenario.rail.sections[: len(changes) + 1]
    names = [s.condition or "" for s in sections]
    if len(names) != len(changes) + 1 or not all(names):
        return []
    twice = {n for n in names if names.count(n) > 1}
    by_time = scenario.rail is not None and scenario.rail.by == "time"
    starts = [0.0, *changes] if by_time else [s.start for s in sections]
    unit = "s" if by_time else "m"
    return [
        f"{n} from {t:.4g} {unit}" if n in twice else n for n, t in zip(names, starts, strict=True)
    ]


Computes = Callable[[Run], Metric | None]


def entry(table: dict[str, Definition]) -> Callable[..., Callable[[Computes], Computes]]:
    """Make a decorator that enters a function of a run into a table of metrics, by its name."""

    def metric(
        meaning: str, better: str = "", needs: tuple[str, ...] = (), *, event: bool = False,
        bound: bool = False,
    ) -> Callable[[Computes], Computes]:  # fmt: skip
        def entered(compute: Computes) -> Computes:
            name = compute.__name__.removeprefix("_")
            table[name] = Definition(compute, meaning, better, needs, event, bound)
            return compute

        return entered

    return metric
