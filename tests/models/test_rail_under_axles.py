"""What an axle finds on a rail that remembers: cleaned, dried, sanded, inside patches or not."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl.models.wheel_rail.rail_memory import _recovered

STARTS, ENDS, FACTORS = (10.0, 20.0, 24.0), (22.0, 30.0, 26.0), (0.9, 0.6, 0.7)


@pytest.mark.parametrize("drying", [False, True])
@pytest.mark.parametrize("nozzles", [(), (1,)])
def test_an_axle_finds_what_was_cleaned_dried_and_sanded_before_it(drying, nozzles):
    """1 - exp(-((tau W)^n + t/T_dry + sand/S_0)), of the lowest patch that an axle is in."""
    at = np.array([5.0, 10.0, 21.0, 22.0, 25.0, 30.0])
    found, sand, t = np.linspace(0, 3e4, 6), np.linspace(0.02, 0, 6), 40.0
    p = {"tau": 1e-4, "n": 0.8, "T_dry": 600.0, "S_0": 0.015, "start": ca.DM(STARTS),
         "end": ca.DM(ENDS), "factor": ca.DM(FACTORS)}  # fmt: skip
    layer = SimpleNamespace(places=3, drying=drying, nozzles=nozzles)
    u = {"at": ca.DM(at)}
    share, height = _recovered(layer, {"t": t}, u, p, ca.DM(found), ca.DM(sand))  # type: ignore[arg-type]
    share, height = (np.array(ca.DM(v)).ravel() for v in (share, height))
    for k, place in enumerate(at):
        inside = [f for a, b, f in zip(STARTS, ENDS, FACTORS, strict=True) if a <= place < b]
        effort = (1e-4 * found[k]) ** 0.8 if found[k] else 0.0
        effort += t / 600 if drying else 0
        effort += sand[k] / 0.015 if nozzles else 0
        assert share[k] == pytest.approx(1 - math.exp(-effort) if inside else 1)
        assert height[k] == pytest.approx(min(inside, default=1))
