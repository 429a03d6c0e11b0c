"""Metrics of a run: each is one function of a log, and one that has no meaning is left out.

Which logged signal is the speed, the slip or the torque is said by ``slipctl.run.roles.Signals``. A
log has one row per tick; a row holds the state at the start of its tick, so that the run ends one
tick after the last row. Of a signal with a value per axle, slip, torque and bounds take the worst
axle, adhesion takes the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from slipctl.run.roles import Bounded, Names, Signals, first_of
from slipctl.run.waveform import ripple, rms, settling_time, worst

if TYPE_CHECKING:
    import xarray

BAND = {"m/s": 0.05, "1": 0.01}
"""Slip error that counts as settled, by the unit of the slip."""

WINDOW = 0.5
"""Length in s of the windows before and after a change of the rail."""

MOVING = 1.0
"""Speed in m/s below which slip and adhesion say nothing."""

STANDSTILL = 0.1
"""Speed in m/s at which a vehicle has stopped."""

LOCKED = 0.05
"""Share of the vehicle speed below which the rim of a moving wheel counts as locked."""


_Computes = TypeVar("_Computes", bound="Callable[[Run], Metric | None]")


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
        bound: whether it needs the loop ``ideal`` beside it.
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
    """

    log: xarray.Dataset
    signals: Signals
    changes: Sequence[float] = ()
    ideal: Mapping[str, Metric] = field(default_factory=dict)
    rails: Sequence[str] = ()

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
        outside = np.atleast_1d(((error < lower) | (error > upper)).any(axis=1))
        return int(outside[0]) + int(np.count_nonzero(outside[1:] & ~outside[:-1]))

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


# ---- the metrics, one function each; None is left out ------------------------------------------

METRICS: dict[str, Definition] = {}
"""What each metric is, in the order of files and tables."""


def _metric(
    meaning: str, better: str = "", needs: tuple[str, ...] = (), *, event: bool = False,
    bound: bool = False,
) -> Callable[[_Computes], _Computes]:  # fmt: skip
    """Enter a function of a run into :data:`METRICS`, by its name."""

    def entered(compute: _Computes) -> _Computes:
        name = compute.__name__.removeprefix("_")
        METRICS[name] = Definition(compute, meaning, better, needs, event, bound)
        return compute

    return entered


@_metric("distance over the run, its last tick by the speed")
def _distance(run: Run) -> Metric | None:
    return None if run.travelled is None else Metric(float(run.travelled[-1]), "m")


@_metric("the same, of the loop `ideal` in this scenario", bound=True)
def _ideal_distance(run: Run) -> Metric | None:
    return run.ideal.get("distance")


@_metric("distance until the speed is below 0.1 m/s", "low", ("speed",), event=True)
def _stopping_distance(run: Run) -> Metric | None:
    v, x = run.get("speed"), run.travelled
    if v is None or x is None or abs(v[0]) <= STANDSTILL or run.slip_sign < 0:
        return None
    return Metric(None if run.stop is None else float(x[run.stop]), "m")


def _settling(run: Run, wanted: str) -> Metric | None:
    """Per rail: time until the slip stays within the band about ``wanted``, while moving."""
    error, band = run.off(wanted), BAND.get(run.unit("slip"))
    if error is None or band is None:
        return None
    time, error = run.time[run.moving], error[run.moving]
    found = [settling_time(time, error, a, b, band) for a, b in run.stretches]
    return Metric(found, "s", run.rows)


@_metric(
    "per rail, start included: until the slip stays within 0.05 m/s or 0.01 of the best one, while"
    " faster than 1 m/s",
    "low",
    ("slip", "best_slip"),
    event=True,
)
def _settling_time(run: Run) -> Metric | None:
    return _settling(run, "best_slip")


@_metric(
    "the same about the loop's own reference, which may be off the best slip",
    "low",
    ("slip", "reference"),
    event=True,
)
def _tracking_time(run: Run) -> Metric | None:
    return _settling(run, "reference")


@_metric("slip minus its reference, whole run", "low")
def _slip_error_rms(run: Run) -> Metric | None:
    return None if run.slip_error is None else Metric(rms(run.slip_error), run.unit("slip"))


@_metric("largest slip", needs=("slip",))
def _slip_max(run: Run) -> Metric | None:
    slip = run.each("slip")
    return None if slip is None else Metric(float(slip.max()), run.unit("slip"))


@_metric("smallest slip", needs=("slip",))
def _slip_min(run: Run) -> Metric | None:
    slip = run.each("slip")
    return None if slip is None else Metric(float(slip.min()), run.unit("slip"))


@_metric(
    "largest peak-to-peak over the last 0.5 s before each rail change and the end",
    "low",
    ("torque",),
)
def _torque_ripple(run: Run) -> Metric | None:
    torque = run.each("torque")
    if torque is None:
        return None
    spans = [run.span(max(a, b - WINDOW), b) for a, b in run.stretches]
    return Metric(max(ripple(torque[s]) for s in spans), run.unit("torque"))


@_metric("total variation of the delivered torque / duration", "low", ("torque",))
def _torque_variation(run: Run) -> Metric | None:
    torque = run.each("torque")
    if torque is None:
        return None
    variation = float(np.abs(np.diff(torque, axis=0)).sum(axis=0).max())
    return Metric(variation / run.duration, f"{run.unit('torque')}/s")


@_metric("mean |mu| / mu_max while faster than 1 m/s", "high", ("adhesion", "best_adhesion"))
def _adhesion_use(run: Run) -> Metric | None:
    mu, best = run.each("adhesion"), run.each("best_adhesion")
    if mu is None or best is None or not run.moving.any():
        return None
    return Metric(float(np.mean(np.abs(mu[run.moving]) / np.abs(best[run.moving]))), "1")


@_metric("over the 0.5 s after the start and after each rail change", "low")
def _acceleration_variance(run: Run) -> Metric | None:
    a = run.acceleration
    if a is None:
        return None
    spans = [run.span(s, min(s + WINDOW, e)) for s, e in run.stretches]
    found = [float(np.var(a[s])) if len(a[s]) > 1 else None for s in spans]
    return Metric(found, "m2/s4", run.rows)


@_metric("change of the acceleration from tick to tick, rail steps left out", "low")
def _jerk_rms(run: Run) -> Metric | None:
    a = run.acceleration
    if a is None or len(a) < 2:
        return None
    jerk = np.diff(a) / run.tick
    steps = np.searchsorted(run.time, np.array(run.changes, dtype=float) - 1e-9) - 1
    keep = np.ones(len(jerk), dtype=bool)
    keep[steps[(steps >= 0) & (steps < len(jerk))]] = False  # the rail's own step is no jerk
    return Metric(rms(jerk[keep]), "m/s3") if keep.any() else None


@_metric("how often the error leaves its funnel", "low")
def _funnel_exits(run: Run) -> Metric | None:
    count = run.exits(run.signals.funnel)
    return None if count is None else Metric(count, "1")


@_metric("how often the error leaves its barrier", "low")
def _barrier_exits(run: Run) -> Metric | None:
    count = run.exits(run.signals.barrier)
    return None if count is None else Metric(count, "1")


def _off(run: Run, role: str, unit: str, of: Callable[[np.ndarray], float]) -> Metric | None:
    """A number of how far the signal of a role is from the one that it shall follow."""
    a, b = run.get(role), run.get(f"wanted_{role}")
    return None if a is None or b is None else Metric(of(a - b), unit)


def _largest(error: np.ndarray) -> float:
    return float(np.abs(error).max())


@_metric("speed minus wanted speed", "low")
def _speed_error_rms(run: Run) -> Metric | None:
    return _off(run, "speed", "m/s", rms)


@_metric("largest of its absolute values", "low")
def _speed_error_max(run: Run) -> Metric | None:
    return _off(run, "speed", "m/s", _largest)


@_metric("position minus wanted position", "low")
def _position_error_rms(run: Run) -> Metric | None:
    return _off(run, "position", "m", rms)


@_metric("largest of its absolute values", "low")
def _position_error_max(run: Run) -> Metric | None:
    return _off(run, "position", "m", _largest)


@_metric("rim slower than 5 % of a vehicle faster than 1 m/s", "low")
def _lock_time(run: Run) -> Metric | None:
    v, slip = run.each("speed"), run.each("slip")
    if v is None:
        return None
    if slip is not None:
        s = slip * run.slip_sign
        rim = v - s if run.unit("slip") == "m/s" else v * (1 - s)
    elif run.unit("wheel_speed") == "m/s":
        rim = run.each("wheel_speed")
    else:
        return None
    if rim is None:
        return None
    locked = run.moving & (np.abs(rim) < LOCKED * np.abs(v)).any(axis=1)
    return Metric(float(np.count_nonzero(locked)) * run.tick, "s")


@_metric(
    "distance beyond that of the bound, the loop `ideal`; in traction short of it",
    "low",
    bound=True,
)
def _above_ideal(run: Run) -> Metric | None:
    distance, ideal = _distance(run), _ideal_distance(run)
    if distance is None or ideal is None:
        return None
    beyond = float(distance.value) - float(ideal.value)  # type: ignore[arg-type]
    return Metric(run.slip_sign * beyond, "m")  # in traction the longer distance is better


@_metric("longest time to compute one tick", "low")
def _step_time(run: Run) -> Metric | None:
    t = run.get("step_time")
    return None if t is None else Metric(float(t.max()), "s")


AGAINST_IDEAL = tuple(name for name, d in METRICS.items() if d.bound)
"""Metrics that need the loop ``ideal``."""


def measure(run: Run, names: Sequence[str] = tuple(METRICS)) -> dict[str, Metric]:
    """All metrics that have a meaning for the run, or those of these names, in order."""
    found = ((name, METRICS[name].compute(run)) for name in names)
    return {name: metric for name, metric in found if metric is not None}


def in_order(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Metrics in the order of files and tables."""
    return {name: metrics[name] for name in METRICS if name in metrics}
