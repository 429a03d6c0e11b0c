"""Whole periods of a ripple: where a window is cut must not show in a mean."""

import numpy as np
import pytest

from slipctl.run import periods

SHAPES = {
    "sine": lambda x: np.sin(2 * np.pi * x),
    "triangle": lambda x: 4 * np.abs(x % 1 - 0.5) - 1,
    "sawtooth": lambda x: 2 * (x % 1) - 1,
    "square": lambda x: np.where(x % 1 < 0.5, 1.0, -1.0),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cut", [2.02, 2.5, 2.77, 3.4])
@pytest.mark.parametrize("start", [0.0, 0.3, 0.8])
def test_mean_does_not_tell_where_the_window_ends(shape, cut, start):
    """Windows of 2 to 3.4 periods, 200 samples each: the mean is off by a sample at most."""
    n = 200
    x = start + np.arange(round(cut * n)) / n
    y = 7.0 + 2.0 * SHAPES[shape](x)
    assert periods.mean(y) == pytest.approx(7.0, abs=2 * 2.0 / n)
    whole = periods.whole_periods(y)
    assert (whole.stop - whole.start) / n == pytest.approx(round((whole.stop - whole.start) / n))


def test_the_plain_mean_does_tell():
    """The same sine over 2.5 periods: what the function is there for."""
    y = np.sin(2 * np.pi * np.arange(500) / 200)
    assert y.mean() > 0.12
    assert abs(periods.mean(y)) < 1e-12


def test_noise_makes_no_periods_on_a_ripple():
    rng = np.random.default_rng(1)
    x = np.arange(700) / 200
    y = np.sin(2 * np.pi * x) + 0.1 * rng.standard_normal(len(x))
    whole = periods.whole_periods(y)
    assert whole.stop - whole.start == pytest.approx(600, abs=30) or (
        whole.stop - whole.start == pytest.approx(400, abs=30)
    )


@pytest.mark.parametrize("values", [np.zeros(10), np.arange(10.0), np.array([]), np.array([1.0])])
def test_without_periods_it_is_the_whole_window(values):
    assert periods.whole_periods(values) == slice(0, len(values))


def test_a_chattering_signal_of_two_samples():
    y = np.tile([1.0, -1.0], 8)[1:]
    assert periods.mean(y) == 0.0
    assert periods.rms(y) == 1.0


@pytest.mark.parametrize(("size", "counts"), [(1.05, True), (0.95, False)])
def test_a_swing_counts_from_a_quarter_of_all_that_is_seen(size, counts):
    """Of 4 in all, from -2 to 2 once; six periods of 40 samples."""
    y = size * np.sin(2 * np.pi * (np.arange(240) + 0.5) / 40)
    y[90], y[70] = 2.0, -2.0
    whole = periods.whole_periods(y)
    assert (whole.stop - whole.start == 5 * 40) == counts
