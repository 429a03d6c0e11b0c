"""Metrics of a run: each is one function of a log, and one that has no meaning is left out.

Which logged signal is the speed, the slip or the torque is said by ``slipctl.run.roles.Signals``.
Of a signal with a value per axle, slip, torque and bounds take the worst axle, adhesion takes the
mean. Metrics of sliding wheels are in ``slipctl.run.measures.slide_metrics``, those of air, of a
mark and beside clean rail in ``brake_metrics``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from slipctl.run.measures.brake_metrics import BRAKES
from slipctl.run.measures.measured_run import LOCKED as LOCKED
from slipctl.run.measures.measured_run import MOVING as MOVING
from slipctl.run.measures.measured_run import STANDSTILL as STANDSTILL
from slipctl.run.measures.measured_run import Definition as Definition
from slipctl.run.measures.measured_run import Metric as Metric
from slipctl.run.measures.measured_run import Run as Run
from slipctl.run.measures.measured_run import entry
from slipctl.run.measures.measured_run import place as place
from slipctl.run.measures.measured_run import rail_changes as rail_changes
from slipctl.run.measures.measured_run import rail_names as rail_names
from slipctl.run.measures.slide_metrics import SLIDES
from slipctl.run.waveform import ripple, rms, settling_time

BAND = {"m/s": 0.05, "1": 0.01}
"""Slip error that counts as settled, by the unit of the slip."""

WINDOW = 0.5
"""Length in s of the windows before and after a change of the rail."""

METRICS: dict[str, Definition] = {}
"""What each metric is, in the order of files and tables."""

_metric = entry(METRICS)


# ---- the metrics, one function each; None is left out ------------------------------------------


@_metric("distance of the run; the last tick is completed with its speed")
def _distance(run: Run) -> Metric | None:
    return None if run.travelled is None else Metric(float(run.travelled[-1]), "m")


@_metric("distance of the loop `ideal` in this scenario", bound=True)
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
    "settling time about the loop's own reference, which may differ from the best slip",
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
    mu, best = run.worked("adhesion"), run.worked("best_adhesion")
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


def _exits(bounds: str, run: Run) -> Metric | None:
    count = run.exits(getattr(run.signals, bounds))
    return None if count is None else Metric(count, "1")


for bounds in ("funnel", "barrier"):
    METRICS[f"{bounds}_exits"] = Definition(
        partial(_exits, bounds), f"number of times that the error leaves its {bounds}", "low"
    )


def _off(role: str, unit: str, of: Callable[[np.ndarray], float], run: Run) -> Metric | None:
    """A number of how far the signal of a role is from the one that it shall follow."""
    a, b = run.get(role), run.get(f"wanted_{role}")
    return None if a is None or b is None else Metric(of(a - b), unit)


def _largest(error: np.ndarray) -> float:
    return float(np.abs(error).max())


for role, unit in (("speed", "m/s"), ("position", "m")):
    for word, of, meaning in (
        ("rms", rms, f"{role} minus wanted {role}"), ("max", _largest, "largest absolute value"),
    ):  # fmt: skip
        METRICS[f"{role}_error_{word}"] = Definition(partial(_off, role, unit, of), meaning, "low")


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


METRICS |= SLIDES | BRAKES

AGAINST_OTHERS = tuple(name for name, d in METRICS.items() if d.bound)
"""Metrics that need another run beside: the loop ``ideal``, or the same loop on clean rail."""


def measure(run: Run, names: Sequence[str] = tuple(METRICS)) -> dict[str, Metric]:
    """All metrics that have a meaning for the run, or those of these names, in order."""
    found = ((name, METRICS[name].compute(run)) for name in names)
    return {name: metric for name, metric in found if metric is not None}


def in_order(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Metrics in the order of files and tables."""
    return {name: metrics[name] for name in METRICS if name in metrics}
