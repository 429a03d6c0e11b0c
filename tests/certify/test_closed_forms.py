"""Closed forms that nothing else asks for, against plain runs."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from slipctl.models.huang_2020.certificate import reaching_law
from slipctl.models.wang_2025.certificate import adhesion_observer, twisting_kind


@pytest.mark.parametrize(("g1", "g2", "T"), [(0.0, 2.0, 0.1), (3.0, 2.0, 0.05), (10.0, 0.5, 0.1)])
def test_the_torque_swings_as_on_the_orbit(g1, g2, T):
    """s+ = s - T (g1 s + g2 sgn s) settles on +-s; the torque is (J/r) (g1 s + g2 sgn s)."""
    J, r, s = 60.0, 0.45, 0.01
    torques = []
    for _ in range(400):
        u = g1 * s + g2 * np.sign(s)
        torques.append(J / r * u)
        s -= T * u
    swing = max(torques[-10:]) - min(torques[-10:])
    assert reaching_law.torque_swing(g1, g2, T, J, r) == pytest.approx(swing, rel=1e-9)


@pytest.mark.parametrize(("L", "T"), [(2.0, 0.01), (30.0, 0.002), (1.0, 1.0)])
def test_the_mean_over_a_tick_lags_a_ramp_by_half_a_tick(L, T):
    f = L * np.linspace(0, T, 1001)
    assert adhesion_observer.implicit_error(L, T) == pytest.approx(f[-1] - f.mean(), rel=1e-9)


@pytest.mark.parametrize("scale", [10**-6, 1, 10**6, 10**10])
def test_the_weight_of_a_bound_follows_the_unit_of_time(scale):
    """alpha s^2, beta s and eta s^2 are the same law in another unit: theta is over s, never 0."""
    of = {"alpha": Fraction(9, 2), "beta": Fraction(1), "eta": Fraction(1, 2)}
    power = {"alpha": 2, "beta": 1, "eta": 2}
    own = twisting_kind._weight(of)["theta"]
    other = twisting_kind._weight({k: v * Fraction(scale) ** power[k] for k, v in of.items()})
    near = 1e-9 * scale if scale < 1e8 else 0  # a short fraction, but where that would be 0
    assert float(other["theta"]) * scale == pytest.approx(float(own), rel=1e-6, abs=near)
