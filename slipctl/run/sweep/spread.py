"""How a metric is spread over many runs, where a run that never reached it counts as the worst.

Without them a median ranks the loop best that fails most often: it is that of the survivors. A run
that broke off counts as the worst too. A metric that has no better end, or no meaning for a run,
leaves that run out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.run.metrics import METRICS

CONFIDENCE = 0.95
"""Confidence of the interval of a share of runs."""


def quantiles(values: np.ndarray, shares: Sequence[float]) -> list[float]:
    """Quantiles of numbers of which some may be infinite; linear between two finite ones.

    Args:
        values: numbers in any order; NaN is left out.
        shares: of the runs below each quantile, 0 to 1. One between a finite and an infinite
            value is infinite.

    Returns:
        As many numbers as shares; NaN where there are no values.
    """
    ordered = np.sort(values[~np.isnan(values)])
    found = []
    for share in shares:
        if not ordered.size:
            found.append(math.nan)
            continue
        at = share * (ordered.size - 1)
        low, part = int(at), at - int(at)
        below, above = ordered[low], ordered[min(low + 1, ordered.size - 1)]
        if part == 0 or below == above:
            found.append(float(below))
        elif np.isinf(above) or np.isinf(below):
            found.append(float(above if np.isinf(above) else below))
        else:
            found.append(float(below + part * (above - below)))
    return found


def value_in_run(name: str, metrics: Mapping[str, Any], row: int | None = None) -> float:
    """A metric of one run as a number: what never came counts as the worst, NaN has no meaning.

    Args:
        name: of the metric.
        metrics: of the run, values by name; empty where the run broke off.
        row: which number of a list.
    """
    worst = METRICS[name].worst if name in METRICS else math.nan
    if name not in metrics:
        return worst if not metrics else math.nan
    value = metrics[name]
    if isinstance(value, list):
        row = 0 if row is None else row
        if row >= len(value):
            return math.nan  # the run was never on that rail
        value = value[row]
    if value is None:
        return worst if name in METRICS and METRICS[name].event else math.nan
    return float(value)


def share_interval(hits: int, runs: int) -> tuple[float, float]:
    """Interval in which the true share lies, of so many hits in so many independent runs.

    Clopper and Pearson, Biometrika 26 (1934) 404-413: exact, whatever the share.

    Args:
        hits: 0 to ``runs``.
        runs: 1 or more.

    Returns:
        Lower and upper end.
    """
    from scipy.stats import beta

    tail = (1 - CONFIDENCE) / 2
    low = float(beta.ppf(tail, hits, runs - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, runs - hits)) if hits < runs else 1.0
    return low, high


@dataclass(frozen=True)
class Kept:
    """How many runs are within the limits of a study.

    Attributes:
        runs: that ended. within: those within all limits. fails: runs that are above each limit,
            or never reach the metric; a run may fail several.
    """

    runs: int
    within: int
    fails: Mapping[str, int]

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval of the share within all limits, at :data:`CONFIDENCE`."""
        return share_interval(self.within, self.runs)

    def __str__(self) -> str:
        low, high = (f"{100 * v:.3g}" for v in self.interval)
        worst = sorted(((n, k) for n, k in self.fails.items() if k), key=lambda f: -f[1])
        failing = ", ".join(f"{n}{' fails' * (not j)} {k}" for j, (n, k) in enumerate(worst))
        return (
            f"{self.within} of {self.runs} within all limits, {low} to {high} % with"
            f" {100 * CONFIDENCE:g} % confidence" + (f"; {failing}" if failing else "")
        )


def limits_missed(metrics: Mapping[str, Any], limits: Mapping[str, float]) -> list[str]:
    """Limits that a run does not keep, by name; a run that broke off keeps none.

    Args:
        metrics: values by name. limits: largest value of each metric.
    """
    found = []
    for name, limit in limits.items():
        value = metrics.get(name)
        values = value if isinstance(value, list) else [value]
        if not values or any(v is None or v > limit for v in values):
            found.append(name)
    return found


def count_kept(runs: Sequence[Mapping[str, Any]], limits: Mapping[str, float]) -> Kept | None:
    """Count the runs within limits; None without runs or limits."""
    if not runs or not limits:
        return None
    failed = [limits_missed(m, limits) for m in runs]
    fails = {name: sum(name in f for f in failed) for name in limits}
    return Kept(len(runs), sum(not f for f in failed), fails)
