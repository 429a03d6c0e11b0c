"""The best a whole train can do: against brute force, the slope rule, and distances found apart."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.sliding_train import SlidingTrain, stop
from slipctl.models.wheel_rail.train_optimum import (
    LocalRule,
    Rule,
    best_stop,
    program,
    refined_point,
)
from tests.models.trains_on_layers import G, places

N = 6000 * G
LEAVES = falling_creep.with_params(mu_0=0.04, A=0.7, B=0.2)


def train(behind, tau=1e-4, **more):
    return SlidingTrain(LEAVES, falling_creep, behind, N, tau, resistance=(0.012, 2e-5), **more)


def passed(t, v, slips):
    """Adhesion and energy found, axle by axle, over one rail point."""
    W, found = 0.0, []
    for e in slips:
        low, high = t.heights([e], v)
        share = 1 - np.exp(-((t.tau * W) ** t.layers))
        f = float((1 - share) * low[0] + share * high[0])
        found.append((f, W))
        W += t.load * f * e
    return np.array(found).T


def at_best(t, v):
    """Slips of the program from a fouled rail point on."""
    table, W, slips = program(t, v), 0.0, []
    for m in range(t.axles - 1, -1, -1):
        slips.append(float(np.interp(W, table.W, table.slip[m])))
        W = W + t.load * passed(t, v, slips)[0][-1] * slips[-1]
    return np.array(slips)


# ---- one rail point ------------------------------------------------------------------------------


@pytest.mark.second
def test_three_axles_are_those_of_brute_force():
    """practice_cases: the best of 240^3 slips is .143733, at .300, .300, .0350."""
    t = train(places(1)[:3], 3e-4)
    slips, total = refined_point(t, 20.0, at_best(t, 20.0))
    assert total == pytest.approx(0.143733, abs=1e-6)
    assert slips == pytest.approx([0.3, 0.3, 0.0350], abs=2e-4)
    grid = np.geomspace(1e-3, 0.3, 24)
    brute = max(passed(t, 20.0, e)[0].sum() for e in product(grid, repeat=3))
    assert brute <= total * (1 + 1e-9)
    assert brute == pytest.approx(total, rel=2e-3)  # its grid is a coarse one


@settings(max_examples=10, deadline=None)
@given(st.floats(2e-5, 4e-4), st.floats(5.0, 40.0), st.integers(2, 8), st.sampled_from([1.0, 2.0]))
def test_the_program_keeps_the_slope_rule(tau, v, axles, layers):
    """-(df/de)/f = L N/(1 + L N e) inside; L, the worth of energy, by differences behind."""
    t = train(tuple(2.0 * k for k in range(axles)), tau, layers=layers)
    slips, total = refined_point(t, v, at_best(t, v))
    assert total >= program(t, v).value[-1, 0] * (1 - 1e-4)
    f, W = passed(t, v, slips)

    def behind(k, energy):
        worth, w = 0.0, energy
        for e in slips[k:]:
            low, high = t.heights([e], v)
            share = 1 - np.exp(-((tau * w) ** layers))
            one = float((1 - share) * low[0] + share * high[0])
            worth, w = worth + one, w + N * one * e
        return worth

    for k, e in enumerate(slips):
        if not 1e-4 < e < 0.2999:
            continue
        W_next, d = W[k] + N * f[k] * e, 1e-2
        L = (behind(k + 1, W_next + d) - behind(k + 1, W_next - d)) / (2 * d)
        h = 1e-6

        def height(at, k=k):
            low, high = t.heights([at], v)
            share = 1 - np.exp(-((tau * W[k]) ** layers))
            return float((1 - share) * low[0] + share * high[0])

        slope = (height(e + h) - height(e - h)) / (2 * h)
        assert -slope / f[k] == pytest.approx(L * N / (1 + L * N * e), abs=2e-3 / e)


def test_no_start_of_a_search_finds_better_and_some_end_worse():
    """An axle has two good slips, one near its peak and one at its limit."""
    t = train(places(2), 3.4e-5)
    best = refined_point(t, 25.0, at_best(t, 25.0))[1]
    rng = np.random.default_rng(1)
    starts = [np.full(8, 0.01), np.full(8, 0.1), *rng.uniform(1e-3, 0.3, (4, 8))]
    others = [refined_point(t, 25.0, e)[1] for e in starts]
    assert max(others) <= best * (1 + 1e-9)
    assert min(others) < best * (1 - 1e-3)


# ---- whole stops ---------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [{}, {"stretches": ((3.0, 9.0),)}, {"t_gamma": 500.0}])
def test_a_short_stop_is_best_by_the_optimum_then_the_program_then_each_axle(more):
    """From 4 m/s; the law of one axle with the strength known is as good as the program."""
    t = train((0.0, 2.0, 8.0), 1.8e-4, **more)
    greedy, by_program, law = (
        stop(t, rule, 4.0, 0.25).distance
        for rule in (Rule(t, True, 5.0), Rule(t, False, 5.0), LocalRule(t, fastest=5.0))
    )
    best = best_stop(t, 4.0, 1.0, 0.25)
    assert best.by_program == by_program
    assert 0.99 * by_program < best.distance < by_program < greedy
    assert law == pytest.approx(by_program, rel=2e-3)
    assert best.run.distance == best.distance
    assert (N * best.run.f * best.run.e).max() <= t.t_gamma * 1.01  # held over a mesh
    if not more:
        assert by_program < 0.9 * greedy


SAVED = {(4, 3.4e-5): 0.4, (4, 1.8e-4): 16, (8, 3.4e-5): 4, (8, 1e-4): 21, (8, 1.8e-4): 34}
"""Percent by which the optimum is shorter than greedy, by axles and cleaning: practice_cases."""


@pytest.mark.second
@pytest.mark.parametrize(("axles", "tau"), SAVED)
@pytest.mark.others("long")
def test_how_much_shorter_than_each_axle_at_its_peak(axles, tau):
    t = train(places(axles // 4), tau)
    greedy, best = (stop(t, Rule(t, own, 26.0), 25.0, 2.0).distance for own in (True, False))
    assert 100 * (1 - best / greedy) == pytest.approx(SAVED[axles, tau], abs=0.6)


@pytest.mark.second
@pytest.mark.parametrize("cars", [2, 3, 4])
@pytest.mark.parametrize("tau", [1e-4, 1.8e-4])
@pytest.mark.others("long")
def test_one_large_slip_for_all_is_shorter_than_the_best_slip_of_each(cars, tau):
    """From 8 axles and 1e-4 m/J on, by a tenth of the distance or more."""
    t = train(places(cars), tau)
    alike = stop(t, lambda *_: np.full(t.axles, 0.3), 25.0, 2.0).distance
    assert alike < 0.9 * stop(t, Rule(t, True, 26.0), 25.0, 2.0).distance


CASES = [
    (1, 1e-4, None, 778.13, 721.29),
    (2, 3.4e-5, None, 781.69, 748.60),
    (2, 1e-4, ((60.0, 360.0),), 455.25, 426.38),
]
REFERENCE = pytest.mark.parametrize(
    ("cars", "tau", "stretches", "greedy", "best"), CASES, ids=["O1", "O2", "O3"]
)


@pytest.mark.second
@pytest.mark.parametrize(
    ("cars", "tau", "stretches", "greedy", "best"), CASES, ids=["O1", "O2", "O3"]
)
@pytest.mark.others("long")
def test_the_program_is_within_1e_4_of_the_optimum(cars, tau, stretches, greedy, best):
    t = train(places(cars), tau, stretches=stretches)
    assert stop(t, Rule(t, True, 26.0), 25.0).distance == pytest.approx(greedy, rel=1e-5)
    assert stop(t, Rule(t, False, 26.0), 25.0).distance == pytest.approx(best, rel=1.1e-4)


@pytest.mark.long
@pytest.mark.parametrize(
    ("cars", "tau", "stretches", "greedy", "best"), CASES, ids=["O1", "O2", "O3"]
)
def test_the_optimum_to_its_digits(cars, tau, stretches, greedy, best):
    t = train(places(cars), tau, stretches=stretches)
    found = best_stop(t, 25.0, 2.0, 1.0)
    assert found.distance == pytest.approx(best, rel=1e-4)
    assert found.distance <= found.by_program
    assert found.distance >= best * (1 - 5e-5)  # nothing is better than what was found apart


@pytest.mark.long
def test_the_optimum_rests_where_mesh_and_cell_are_halved():
    coarse, fine = (best_stop(train(places(1)), 25.0, *way).distance
                    for way in ((2.0, 1.0), (1.0, 0.5)))  # fmt: skip
    assert fine == pytest.approx(coarse, rel=1e-4)


@pytest.mark.second
def test_the_local_law_is_nearly_as_good_and_bears_a_wrong_strength():
    """Of what is to be gained on 8 axles nearly all with the right strength, most within three."""
    t = train(places(2), 1e-4)
    greedy, best = (stop(t, Rule(t, own, 26.0), 25.0, 2.0).distance for own in (True, False))

    def share(**how):
        rule = LocalRule(t, fastest=26.0, **how)
        return (greedy - stop(t, rule, 25.0, 2.0).distance) / (greedy - best)

    assert share() == pytest.approx(1, abs=0.02)
    assert all(share(strength=s) > 0.75 for s in (1 / 3, 3))
    assert all(share(recovered=r) > 0.9 for r in (0.10, 0.25))


def planned(t, factor):
    """Stop where the program is solved anew at each place: its state is what each axle measures.

    It believes ``factor`` times the strength; an axle measures the share of the clean curve.
    """
    believed = Rule(replace(t, tau=factor * t.tau), False, 26.0)
    return stop(t, lambda x, v, W, fouled: believed(x, v, W / factor, fouled), 25.0, 2.0).distance


@pytest.mark.second
@pytest.mark.parametrize(("cars", "tau", "known", "wrong"), [
    (2, 3.4e-5, 2e-3, 5e-3), pytest.param(4, 1.8e-4, 5e-2, 7e-2, marks=pytest.mark.long),
])  # fmt: skip
def test_a_plan_over_the_axles_gains_little_on_the_law(cars, tau, known, wrong):
    """Shares of the distance, strength known and within three; docs/train_optimum.md has all."""
    t = train(places(cars), tau)
    for factor, most in ((1.0, known), (3.0, wrong), (1 / 3, wrong)):
        law = stop(t, LocalRule(t, factor, fastest=26.0), 25.0, 2.0).distance
        assert -0.01 < 1 - planned(t, factor) / law < most


@settings(max_examples=6, deadline=None)
@given(st.floats(1e-5, 3e-4), st.floats(0.02, 0.3), st.floats(0, 0.015))
def test_energy_of_the_train_is_what_forces_take(tau, e, gradient):
    """Kinetic energy by mass is what adhesion, resistance and gradient take over the way."""
    t = train(places(1), tau, gradient=-gradient)
    run = stop(t, lambda *_: np.full(4, e), 15.0, 1.0)
    slow = G * run.f.mean(axis=1) + 0.012 + 2e-5 * run.v**2 - G * gradient
    z = 15.0**2 / 2 - np.concatenate([[0.0], np.cumsum(slow)])
    assert z[-1] >= 0
    rest = run.distance - len(slow)  # the last part of a cell, as its own forces say
    assert 0 <= rest <= 1
    # behind an axle the rail has what it found and what it left: axle 2 finds what axle 1 left
    first = t.load * run.f[:, 0] * run.e[:, 0]
    assert run.W[2:, 1] == pytest.approx(first[:-2], rel=1e-12)


@pytest.mark.second
def test_a_limit_of_the_contact_holds():
    t = train(places(2), 1e-4, t_gamma=600.0)
    run = stop(t, Rule(t, False, 26.0), 25.0, 2.0)
    assert (N * run.f * run.e).max() <= 600 * 1.02  # slips are those of the nearest speed
    free = train(places(2), 1e-4)
    assert run.distance > stop(free, Rule(free, False, 26.0), 25.0, 2.0).distance


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"behind": (1.0, 3.0)}, "begin with 0 m"),
        ({"behind": (0.0, 3.0, 2.0)}, "rise from axle to axle"),
        ({"tau": -1.0}, "tau"),
        ({"slip": 0.0}, "slip"),
    ],
)
def test_trains_that_are_none(change, words):
    given = {"behind": places(1), "tau": 1e-4} | change
    with pytest.raises(BadInput, match=words):
        train(**given)


def test_a_train_that_does_not_stop_and_a_cell_too_long_are_refused():
    t = train(places(1), gradient=-0.1)
    with pytest.raises(BadInput, match="still moves"):
        stop(t, lambda *_: np.full(4, 0.1), 25.0, 1.0, longest=100.0)
    with pytest.raises(BadInput, match="apart"):
        stop(t, lambda *_: np.full(4, 0.1), 25.0, 5.0)
