"""Runs that leave a bound, as the loop linearised at its rest says: what pushes adds up there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

FAR = 1e30
"""Gain at which no more ticks are added up."""

Step = Callable[[Sequence[float], Sequence[float]], Sequence[float]]
"""Next states of states and of what pushes, in floats."""


def summed_run(
    step: Step, rest: Sequence[float], sizes: tuple[Sequence[float], Sequence[float]], of: int,
    limit: float, horizons: Iterable[int],
) -> tuple[np.ndarray, np.ndarray] | None:  # fmt: skip
    """Signs of the start by state and of the pushes by tick, whose run leaves; None without one.

    Args:
        step: the tick. rest: its rest. sizes: how far states start off rest, and of each push.
        of: state that has to leave. limit: how far from its rest it may come.
        horizons: numbers of ticks over which is summed up; one after another is tried.
    """
    starts, pushes = sizes
    still, zero = np.asarray(step(rest, [0.0] * len(pushes))), list(rest)

    def column(x: Sequence[float], d: Sequence[float], off: float) -> np.ndarray:
        return np.asarray((np.asarray(step(x, d)) - still) / off)

    A, B = np.empty((len(rest), len(rest))), np.empty((len(rest), len(pushes)))
    for j, at in enumerate(rest):
        off = max(abs(at), 1.0) * 1e-7
        moved = [*zero[:j], at + off, *zero[j + 1 :]]
        A[:, j] = column(moved, [0.0] * len(pushes), off)
    for j, size in enumerate(pushes):
        off = 1e-6 * max(size, 1e-3)
        B[:, j] = column(rest, [off * (k == j) for k in range(len(pushes))], off)
    row, by_push, by_start = np.eye(len(rest))[of], [], []
    most = max(horizons := sorted(set(horizons)))
    for _ in range(most):
        if not np.isfinite(row).all() or np.abs(row).max() > FAR:
            break
        by_push.append(np.where(row @ B < 0, -1, 1))
        row = row @ A
        by_start.append(np.where(row < 0, -1, 1))
    for ticks in sorted({min(k, len(by_push)) for k in horizons}):
        signs, first = np.array(by_push[:ticks])[::-1], by_start[ticks - 1]
        for turn in (1, -1):
            x: Sequence[float] = [
                r + turn * s * z for r, s, z in zip(rest, first, starts, strict=True)
            ]
            for k, sign in enumerate(signs):
                x = step(x, [turn * s * w for s, w in zip(sign, pushes, strict=True)])
                if not abs(x[of] - rest[of]) <= limit:
                    if not np.isfinite(x).all():
                        break
                    return turn * first, turn * signs[: k + 1]
    return None
