"""One true log in many dialects: read right, or refused in one line; never wrong."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from dialects import dialect_of, speeds

from slipctl import BadInput
from slipctl.models.trials import coasting
from slipctl.run.logs.log_signals import source_of
from slipctl.run.logs.recorded_log import read_recording

DRAWS = 200


def read(seed: int, file: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Times and speeds of a log in the dialect of a seed, and what was told."""
    d = dialect_of(seed)
    d.write(file)
    log = read_recording(file)
    v = source_of(coasting, log, coasting.states["v"], d.name).values(log)
    return log.time, v, log.notes


def is_true(t: np.ndarray, v: np.ndarray) -> bool:
    """Whether every sample is one of the true log, at its time but for the start of each run."""
    true, good = np.array(speeds()), np.isfinite(v)
    t, v = t[good], v[good]
    if t.size < 300:
        return False
    steps = np.diff(t)
    ends = [0, *(np.flatnonzero((steps > 0.5) | (steps < 0.02)) + 1), t.size]
    for a, b in pairwise(ends):
        fits = [
            s
            for s in range(true.size)
            if abs(true[s] - v[a]) < 0.06 and _alike(t[a:b] - t[a], v[a:b], s)
        ]
        if not fits:
            return False
    return True


def _alike(t: np.ndarray, v: np.ndarray, start: int) -> bool:
    true, places = np.array(speeds()), start + np.round(10 * t).astype(int)
    if places[-1] >= true.size or np.abs(10 * t - np.round(10 * t)).max() > 0.06:
        return False
    return bool(np.abs(true[places] - v).max() < 0.024)


def verdict(seed: int, file: Path) -> str:
    """What became of a log: right, wrong, or why it was refused."""
    try:
        t, v, _ = read(seed, file)
    except BadInput as error:
        lines = str(error).splitlines()
        return f"refused: {lines[0]}" if len(lines) == 1 else "refused in several lines"
    return "right" if is_true(t, v) else "wrong"


@pytest.mark.second
@pytest.mark.parametrize("block", range(10))
def test_a_log_is_read_right_or_refused(block: int, tmp_path: Path) -> None:
    """200 dialects of one log; at most a third are refused."""
    said = {}
    for seed in range(block * DRAWS // 10, (block + 1) * DRAWS // 10):
        said[seed] = verdict(seed, tmp_path / "log.csv")
    wrong = [seed for seed, x in said.items() if x in ("wrong", "refused in several lines")]
    assert not wrong, [dialect_of(s).said for s in wrong]
    refused = sum(x != "right" for x in said.values())
    assert refused <= math.ceil(0.6 * len(said)), said
