"""What the experiments of the train measure by: spans of the rails, distance, times."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl.models.zhang_2021.hst_braking import G, M, N
from slipctl.studies.hst_braking.loops import (
    H,
)

LENGTH = 2.0
"""Time on each rail in s."""

F_Z = M * G / N
NEAR_FORCE = 221.0
"""Adhesion force that counts as estimated, 2 % of the steady dry force, in N."""

NEAR_SLIP = 0.01
"""Slip ratio that counts as found."""


def spans(log: Any) -> list[slice]:
    """Ticks of each rail."""
    n = round(LENGTH / H)
    return [slice(k * n, (k + 1) * n) for k in range(len(log["time"]) // n)]


def distance(log: Any) -> float:
    """Distance in m at the end of the run."""
    v, x = log["plant.wheel.v"].values, log["plant.wheel.x"].values
    return float(x[-1] + (1.5 * v[-1] - 0.5 * v[-2]) * H)


def time_until(off: np.ndarray, limit: float) -> float | None:
    """Time in s from which ``off`` stays below the limit; None if it does not at the end."""
    wrong = np.flatnonzero(off > limit)
    if not wrong.size:
        return 0.0
    return None if wrong[-1] == len(off) - 1 else float((wrong[-1] + 1) * H)
