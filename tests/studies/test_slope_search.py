"""A search of the slope that knows no curve: shorter than own peaks, and not as good as the law."""

import numpy as np
import pytest

from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain, stop
from slipctl.models.wheel_rail.train_optimum import LocalRule, Rule
from slipctl.studies.leaf_fall.slope_search import SlopeSearch

LEAVES = falling_creep.with_params(**falling_creep.conditions["leaves"])


def train(axles, tau):
    places = tuple(20.0 * car + d for car in (0, 1) for d in (0.0, 2.0, 14.0, 16.0))[:axles]
    return SlidingTrain(LEAVES, falling_creep, places, 58860.0, tau, resistance=(0.012, 2e-5))


@pytest.mark.second
def test_it_gains_on_own_peaks_and_leaves_more_than_the_law_with_its_curves():
    made = train(8, 1e-4)
    own, law, search = (
        stop(made, rule, 20.0, cell=2.0).distance
        for rule in (Rule(made, greedy=True, fastest=21.0), LocalRule(made, fastest=21.0),
                     SlopeSearch(made))
    )  # fmt: skip
    assert law < search < law + 0.3 * (own - law)


def test_a_single_axle_without_noise_comes_to_its_own_peak():
    """Nobody follows, so the sum is ln f: on a rail that is not cleaned the slip is the peak's."""
    made = train(1, 0.0)
    search = SlopeSearch(made, start=0.1, noise=0.0, rate=2.0)
    dirty, e = np.array([True]), np.geomspace(1e-3, 0.3, 2000)
    slips = [search(float(x), 20.0, np.zeros(1), dirty)[0] for x in np.arange(0, 400.0)]
    best = e[made.heights(e, 20.0)[0].argmax()]
    assert np.mean(slips[-32:]) == pytest.approx(best, rel=0.3)
