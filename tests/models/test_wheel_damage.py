"""Wear, flash temperature and flats against the tables of their sources."""

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.models.wheel_damage import flash_temperature, flat_area, flat_depth, wear_rate

N = 55e3


def test_wear_is_that_of_the_table():
    """practice_models 6.2, N 55 kN, 120 mm2, in ug by m and mm2; continuous where kinds change."""
    slips = {(0.02, 0.1): 4.9, (0.05, 0.1): 12.1, (0.05, 0.2): 24.3, (0.05, 0.5): 55, (0.05, 1): 55,
             (0.1, 0.2): 48.6, (0.2, 0.2): 55, (0.3, 0.2): 55}  # fmt: skip
    for (mu, slip), k in slips.items():
        assert wear_rate(mu * slip * N) / 120 * 1e9 == pytest.approx(k, abs=0.05)
    for joint, jump in ((10.4, 0.12), (77.2, 1e-3)):
        ends = [float(wear_rate(120 * joint * (1 + s * 1e-9))) / 120 * 1e9 for s in (-1, 1)]
        assert abs(ends[1] - ends[0]) < jump + 1e-6
    assert float(wear_rate(120 * 100.0)) / 120 * 1e9 == pytest.approx(55 + 61.9 * 22.8)
    assert (np.diff(wear_rate(np.linspace(0, 1200, 500))) >= 0).all()


def test_flash_temperature_of_twin_discs():
    """Lewis and Dwyer-Joyce: mean and peak within 0.4 % and the rounding of the table."""
    U, a, b = 0.9844, 0.315e-3, 10e-3
    chi = U * a / (2 * 10.3)
    rows = {0.5: (9.2, 0.9, 1.3), 1: (25.7, 2.5, 3.7), 3: (102.6, 10.1, 15.1),
            7.5: (246.0, 24.4, 36.7), 10: (327.8, 32.8, 49.2), 15: (492.1, 49.9, 74.8),
            20: (728.4, 75.0, 112.5)}  # fmt: skip
    computed = (0.897, 2.508, 10.063, 24.41, 32.75, 49.85, 74.85)
    for (slip, (Q, mean, peak)), own in zip(rows.items(), computed, strict=True):
        found = flash_temperature(Q, U, U * (1 - slip / 100), 2 * a * b, a, chi * 4e6, 4e6)
        assert found / 1.5 == pytest.approx(own, rel=2e-4, abs=5e-4)  # digits
        assert found / 1.5 == pytest.approx(mean, rel=4e-3, abs=0.05)
        assert found == pytest.approx(peak, rel=4e-3, abs=0.07)  # 1.5 times the rounding


def test_flash_temperature_on_the_rail():
    """practice_models 6.3: peaks in K; a locked wheel is limited by the rail alone."""
    rows = {(0.05, 0.1, 30): 56, (0.05, 0.2, 30): 115, (0.05, 0.3, 40): 205, (0.05, 0.8, 30): 601,
            (0.1, 0.5, 20): 520}  # fmt: skip
    for (mu, slip, v), peak in rows.items():
        found = flash_temperature(mu * N * slip * v, v, v * (1 - slip))
        assert found == pytest.approx(peak, rel=0.01)
    for mu, v, mean in ((0.05, 10, 419), (0.05, 20, 592), (0.1, 10, 837)):
        assert flash_temperature(mu * N * v, v, 0.0) / 1.5 == pytest.approx(mean, abs=0.6)


def test_flats_have_the_depth_of_their_chord():
    """6.4, R 0.46 m: 40 mm .435 mm, 60 mm .978 mm, 63.5 mm 1.096 mm; 11.6, 39.1, 46.4 mm2."""
    rows = {40: (0.435, 11.6), 60: (0.978, 39.1), 63.5: (1.096, 46.4)}
    for length, (depth, area) in rows.items():
        assert 1e3 * flat_depth(length / 1e3, 0.46) == pytest.approx(depth, abs=6e-4)
        assert 1e6 * flat_area(length / 1e3, 0.46) == pytest.approx(area, abs=0.06)


def test_what_is_no_patch_is_refused():
    with pytest.raises(BadInput, match="patch = 0 must be positive"):
        wear_rate(100.0, 0.0)
    with pytest.raises(BadInput, match="half_length"):
        flash_temperature(1.0, 1.0, 1.0, half_length=-1.0)
