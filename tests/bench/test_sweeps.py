"""The bench of sweeps runs, and what it compares is the same work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench import sweeps
from slipctl import open_sweep, prepare
from slipctl.run import build

pytestmark = [
    pytest.mark.skipif(build.compiler() is None, reason="needs a C compiler"),
    pytest.mark.second,
]


def test_the_roll_alone_is_that_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a sweep is held against has the bits of the loop's own run."""
    loop, scenario, _ = sweeps.asked(0.05)
    monkeypatch.setattr(sweeps, "asked", lambda duration=None: (loop, scenario, None))
    kept = []
    real = np.empty_like
    monkeypatch.setattr(sweeps.np, "empty_like", lambda a: kept.append(real(a)) or kept[-1])
    sweeps.roll_alone(2)()
    whole = prepare(loop, scenario).whole({})
    assert np.array_equal(kept[0], whole.x)
    assert np.array_equal(kept[1], whole.y)


def test_the_sweep_of_the_bench(tmp_path: Path) -> None:
    """Each run has another gain, and none fails."""
    assert sweeps.swept(tmp_path, 3, 0.02) > 0
    found = open_sweep(tmp_path)
    assert len({n["ctl.law.K1"] for _, n, _, _ in found.runs}) == 3
    assert not found.failed
