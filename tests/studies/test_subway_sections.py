"""Rails that nobody tuned for: random sections, the section of the paper's blind spot, leaves."""

import math
from functools import cache

import numpy as np
import pytest

from slipctl import Scenario, simulate
from slipctl.models.huang_2020.subway_braking_control import super_twisting
from slipctl.studies.subway_braking import leaves, loops, sections

BLIND = ({"c": 0.075, "a": 0.640, "b": 1.979}, {"c": 0.087, "a": 0.342, "b": 1.108})
"""Two rails that differ by .0014 at the slip that is best on the first."""


@cache
def online(memory: int = 32):
    return loops.online(loops.MODELS, super_twisting(), memory=memory)


def best(c, a, b):
    return math.log(b / a) / (b - a)


def mu(v, c, a, b):
    return c * (np.exp(-a * v) - np.exp(-b * v))


def test_sections_are_drawn_as_they_are_said_to_be():
    rng = np.random.default_rng(1)
    drawn = [sections.random_section(rng) for _ in range(400)]
    place = np.array([best(**s) for s in drawn])
    height = np.array([mu(best(**s), **s) for s in drawn])
    ratio = np.array([s["b"] / s["a"] for s in drawn])
    for values, low, high in ((place, 0.605, 2.42), (height, 0.0287, 0.2867), (ratio, 1.5, 4.0)):
        assert low - 1e-3 < values.min() < values.max() < high + 1e-3
    # a uniform draw of 400: its mean lies within 4 deviations, 0.2887 of the range over 20
    for values, low, high in (
        (place, 0.605, 2.42),
        (np.log(height), np.log(0.0287), np.log(0.2867)),
    ):
        assert abs(values.mean() - (low + high) / 2) < 4 * 0.2887 * (high - low) / 20


@pytest.mark.second
@pytest.mark.long
def test_random_sections_are_found_within_half_a_second():
    """30 of the 1000 sections of the experiment, noise-free: all within 5 % for good."""
    rng = np.random.default_rng(4)
    drawn = [sections.random_section(rng) for _ in range(30)]
    log = sections.drive(online(), drawn, 0.0, 1)
    assert max(estimate for estimate, _, _ in sections.outcomes(log, drawn)) <= 0.5


@pytest.mark.second
@pytest.mark.parametrize(("memory", "found"), [(1, False), (32, True)])
@pytest.mark.others("long")
def test_the_rail_that_one_residual_is_blind_to(memory, found):
    log = sections.drive(online(memory), list(BLIND), 0.0, 1)
    _, (estimate, slip, _) = sections.outcomes(log, list(BLIND))
    assert (estimate <= 0.5, slip <= 0.5) == (found, found)
    if not found:  # held at the best slip of the rail before
        assert log["plant.wheel.v_s"].values[-1] == pytest.approx(best(**BLIND[0]), rel=0.05)


def test_a_released_brake_limits_how_fast_the_slip_falls():
    """The plant itself, with no torque, from 2.4 m/s on a rail with a peak of .03 at .8 m/s."""
    rail = {"c": 0.0799, "a": 0.8169, "b": 1.8153}
    plant = loops._world(loops.MODELS, lag=False).with_params(
        **{f"adh.{n}": v for n, v in rail.items()}
    )
    start = {"omega": (10 - 2.4) / 0.5, "v": 10.0}
    log = simulate(plant, Scenario("free", 2.0, inputs={"T_cmd": 0.0}, start=start))
    slip = log["wheel.v_s"].values
    reached = np.flatnonzero(slip <= 1.05 * best(**rail))[0] * 1e-3
    # the formula has no air: 235 N on 8 t, .03 m/s^2 of a mean of 1.5
    assert sections.fastest(2.4, **rail) == pytest.approx(reached, rel=0.03)


@pytest.mark.second
@pytest.mark.long
def test_after_leaves_the_estimate_comes_back_on_seeds_that_chose_nothing():
    """Some of the forty that judge; the experiment ``leaves`` has all. 101 was lost when the
    estimator took the meter's noise as white: it stayed at .63 of the best slip.
    """
    loop = loops.real_online(loops.MODELS, super_twisting())
    assert not set(leaves.CHOSEN) & {*leaves.HELD_OUT, 101}
    for seed in (101, *leaves.HELD_OUT[:2]):
        place, used = leaves.run(loop, seed)
        assert abs(place - 1) < leaves.NEAR
        assert used > 0.99  # above leaves.USE: what the page says of all forty
    dry = loops.double_exponential.conditions["dry"]
    assert best(**leaves.LEAVES) == pytest.approx(0.61, abs=0.005)
    assert mu(best(**leaves.LEAVES), **leaves.LEAVES) == pytest.approx(0.03, abs=5e-4)
    assert used == pytest.approx(mu(place * best(**dry), **dry) / mu(best(**dry), **dry), abs=0.02)
