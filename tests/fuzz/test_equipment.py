"""Vehicles with all that a file may have are refused, told, or right: draws of ``equipment.py``."""

import numpy as np
import pytest
from equipment import drawn, ended, loads, wheelsets


@pytest.mark.second
@pytest.mark.parametrize(
    "seed", [*range(6), *(pytest.param(k, marks=pytest.mark.long) for k in range(6, 12))]
)
@pytest.mark.others("long")
def test_a_drawn_vehicle_is_refused_told_or_right(seed, tmp_path):
    how, lines = ended(drawn(seed), tmp_path)
    assert how in ("refused", "told", "right"), lines


def test_the_judge_sees_a_load_that_is_not_the_weight():
    """An axle that pulls at the rail, and a weight that grows."""
    mu = np.full((3, 2), -0.1)
    for N, said in (([60.0, 40.0], 0), ([70.0, 40.0], 1), ([110.0, -10.0], 1)):
        assert len(list(loads(100.0, mu, mu * np.array(N)))) == said


def test_the_judge_sees_a_wheel_that_slows_beside_its_torques():
    """A wheelset of 100 kg m^2 at 0.5 m with a brake of 1 kN m on rail that pushes with 1 kN."""
    from types import SimpleNamespace

    trip = SimpleNamespace(vehicle=SimpleNamespace(inertias=(100.0,), radii=(0.5,)))
    log, F = {"plant.T": np.full((4, 1), 1e3)}, np.full((4, 1), -1e3)
    for slows, said in ((5e-3, 0), (5.1e-3, 1)):  # (1000 - 500)/100 rad/s^2 for 1 ms
        omega = 40.0 - slows * np.arange(4.0)[:, None]
        assert len(list(wheelsets(trip, log, omega, F))) == said
