"""Runs that are shown beside a verdict, and what they are made of: against other integrations."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from slipctl import BadInput
from slipctl.models.cheng_2022.certificate import barrier, load_observer_kind
from slipctl.models.super_twisting.certificate import twisting_swings, worst_run
from slipctl.models.super_twisting.certificate.super_twisting import worst_ratio
from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Law
from slipctl.models.super_twisting.certificate.twisting_sampled import replay_run

F = Fraction

# ---- the observer of the load --------------------------------------------------------------------


@pytest.mark.parametrize("gains", [(80.0, -64000.0, 40.0), (30.0, -50.0, 2.5), (-40.0, -40.0, 1.0)])
def test_the_error_of_a_load_is_that_of_the_linear_loop(gains) -> None:
    """From 1 N m, over 4000 steps of a fiftieth of the fastest pole, or until it is beyond 1e6."""
    L1, L2, J = gains
    n = {"L1": L1, "L2": L2, "J": J}
    A = np.array([[-L1, -1 / J], [-L2, 0.0]])
    poles = sorted(np.linalg.eigvals(A), key=lambda p: -p.real)
    h = 0.02 / max(abs(p) for p in poles)
    shown = load_observer_kind._observer_witness(n)
    run, last = shown.found["run"][0], shown.found["error_after_the_run"][0]
    steps = round(run / h)
    assert run == pytest.approx(h * steps, rel=1e-12)
    assert steps == 4000 if L1 > 0 else 300 < steps < 4000
    true = [(expm(A * h * i) @ [0.0, 1.0])[1] for i in range(0, 201, 20)]
    assert shown.trajectory["t"][1][:11] == pytest.approx([h * i for i in range(0, 201, 20)])
    assert shown.trajectory["error"][1][:11] == pytest.approx(true, rel=2e-3, abs=1e-6)
    assert len(shown.trajectory["t"][1]) == len(shown.trajectory["error"][1]) == steps // 20 + 1
    if L1 > 0:
        assert last == pytest.approx(abs((expm(A * run) @ [0.0, 1.0])[1]), rel=0.05, abs=1e-9)
    else:
        assert 1e6 < last < 1.1e6
    assert load_observer_kind.observer_poles(*gains) == pytest.approx(poles)


# ---- super-twisting ------------------------------------------------------------------------------


def law(k1, k2):
    return (lambda y: k1 * y), (lambda y: k2)


@pytest.mark.parametrize("gains", [(2.0, 3.0, 1.0), (0.7, 2.0, 1.5)])
def test_the_worst_half_turns_are_those_of_the_equations(gains) -> None:
    """x1' = x2 - k1 root(x1), x2' = d - k2 on the half x1 > 0, d the worst; mirrored each time."""
    k1, k2, L = gains
    v = 1.3
    found = worst_run.run(*law(k1, k2), L, v, 2e-3 * v, 3)
    assert len(found.crossings) == len(found.times) == 4
    ratios = np.divide(found.crossings[1:], found.crossings[:-1])
    assert ratios == pytest.approx([worst_ratio(k1, k2, L)] * 3, rel=1e-6)
    assert found.growth() == pytest.approx(worst_ratio(k1, k2, L), rel=1e-6)
    durations = np.diff(found.times)
    assert durations[1:] == pytest.approx(durations[:-1] * ratios[:-1], rel=1e-6)

    def rates(t, x):
        grows = x[1] > k1 * math.sqrt(max(x[0], 0))
        return [x[1] - k1 * math.sqrt(max(x[0], 0)), (L if grows else -L) - k2]

    ends = found.times[1]
    true = solve_ivp(rates, (0, 0.98 * ends), [0.0, v], rtol=1e-8, atol=1e-10, dense_output=True)
    t = np.array(found.t)
    first = (t > 0) & (t < 0.98 * ends)
    assert first.sum() > 5
    x1, x2 = true.sol(t[first])
    assert np.array(found.x1)[first] == pytest.approx(x1, abs=1e-4)
    assert np.array(found.x2)[first] == pytest.approx(x2, abs=1e-3)
    grows = np.array(found.x2)[first] > k1 * np.sqrt(np.array(found.x1)[first]) - 1e-9
    assert (np.array(found.d)[first] == np.where(grows, L, -L)).mean() > 0.9
    second = (t > found.times[1] * 1.02) & (t < found.times[2] * 0.98)
    assert (np.array(found.x1)[second] < 0).all()
    assert set(np.array(found.d)[second]) == {-L, L}
    assert (found.t[0], found.x1[0], found.x2[0], found.d[0]) == (0.0, 0.0, v, L)


def test_a_run_that_does_not_come_back_ends() -> None:
    away = worst_run.run(*law(1.0, 0.5), 1.0, 1.0, 0.5)
    assert away.crossings == [1.0]
    assert away.growth() == math.inf


def test_the_farthest_at_each_speed_is_what_any_tick_brings() -> None:
    """Row by row: an entry, or y - k1 root(y) + w from any row that is 3 to 7 higher."""
    rng = np.random.default_rng(3)
    w = np.arange(-14, 15) * 0.25
    entry = np.where(rng.random(29) < 0.4, rng.uniform(0, 9, 29), EMPTY)
    entry[20] = 30.0
    found = twisting_swings._sweep(1.5, w, entry, 3, 7)
    wanted = np.full(29, EMPTY)
    for at in range(28, -1, -1):
        best = entry[at]
        for source in range(at + 3, min(at + 7, 28) + 1):
            y = wanted[source]
            if y > 0:
                best = max(best, y - 1.5 * math.sqrt(y) + w[source])
        wanted[at] = best if best > 0 else EMPTY
    assert list(found) == pytest.approx(list(wanted))
    assert (found > EMPTY).sum() > 15
    assert (found == EMPTY).any()


@pytest.mark.parametrize(("k1", "k2"), [(3, 2), (2, 3), (5, 4)])
def test_a_swing_that_is_found_is_one_of_the_law(k1, k2) -> None:
    own = Law(F(k1, 2), F(k2, 2), F(1) if k2 > 2 else F(1, 2))
    near = None
    for wanted in (F(1), F(2), F(3)):
        d = twisting_swings.search(own, wanted, 0.05)
        if d is not None:
            assert max(abs(x) for x in d) <= own.L
            near = replay_run(own, d)
            assert near > wanted
    assert near is not None
    assert twisting_swings.search(own, F(10**9), 0.02) is None
    assert twisting_swings.search(Law(own.k1, own.L, own.L), F(1), 0.05) is None
    for noisy in (Law(own.k1, own.k2, own.L, F(1, 9)), Law(own.k1, own.k2, own.L, F(0), F(1, 9))):
        assert twisting_swings.search(noisy, F(1), 0.05) is None


# ---- the barrier ---------------------------------------------------------------------------------


def test_what_holds_an_error_has_its_pull_and_its_time() -> None:
    k, width, q = 3.0, 0.5, 4.0
    e = np.linspace(-0.45, 0.45, 7)
    assert barrier.pull(e, k, width) == pytest.approx(6 * e * (0.25 - e**2))
    assert barrier.robust_pull(e, q, width) == pytest.approx(4 * e * 0.25 / (0.25 - e**2))
    assert barrier.rate(k, width) == 1.5
    worst = barrier.largest_disturbance(k, width)
    assert worst == pytest.approx(max(barrier.pull(np.linspace(0, 0.5, 4001), k, width)), rel=1e-6)
    for share in (0.1, 0.7, 0.999):
        low = barrier.settled_error(share * worst, k, width)
        high = barrier.recoverable(share * worst, k, width)
        assert 0 < low < width / math.sqrt(3) < high < width
        assert barrier.pull(low, k, width) == pytest.approx(share * worst, rel=1e-9)
        assert barrier.pull(high, k, width) == pytest.approx(share * worst, rel=1e-9)
        assert barrier.escape_time(share * worst, k, width, high * 0.999) == math.inf
        robust = barrier.robust_settled(share * worst, q, width)
        assert barrier.robust_pull(robust, q, width) == pytest.approx(share * worst, rel=1e-9)
    assert barrier.settled_error(1.001 * worst, k, width) == math.inf
    assert barrier.recoverable(1.001 * worst, k, width) == 0
    for W, start in ((1.2 * worst, 0.0), (3 * worst, 0.2), (0.5 * worst, 0.48)):
        t = np.linspace(start, width, 20001)[:-1]
        slow = 1 / (W - barrier.pull(t, k, width))
        assert barrier.escape_time(W, k, width, start) == pytest.approx(
            np.trapezoid(slow, t), rel=1e-3)  # fmt: skip
    assert barrier.escape_time(worst, k, width, width) == 0
    assert barrier.escape_time(worst, k, width, 2 * width) == 0


def test_what_a_tick_holds_ends_where_it_throws_across() -> None:
    z = np.linspace(0, 1, 100_001)
    for kappa in (0.5, 1.0, 1.5, 2.7, 3.9):
        across = max(0.0, max(-(z - kappa * z * (1 - z * z))))
        assert barrier.overshoot(kappa) == pytest.approx(across, abs=1e-6)
    assert barrier.overshoot(4.0) == pytest.approx(1)
    assert [barrier.sampled_disturbance(x) for x in (-0.1, 0.0, 4.0, 4.5)] == [0.0] * 4
    assert barrier.sampled_disturbance(0.8) == pytest.approx(0.8 * 2 / (3 * math.sqrt(3)))
    k, wide, narrow = 3.0, 0.5, 0.3
    T = barrier.largest_period(k, wide, narrow)
    assert pytest.approx(barrier.largest_period(k, narrow, wide)) == T
    assert wide * barrier.overshoot(barrier.rate(k, wide) * T) == pytest.approx(narrow)
    assert barrier.stable_period(k, wide, narrow) == pytest.approx(2 / (2 * k * wide**2))


def test_the_function_of_the_barrier_changes_as_it_says() -> None:
    k, k_a, k_s, h = 2.0, 0.7, 0.4, 1e-6
    for e, w in ((0.3, 0.05), (-0.5, -0.02), (0.1, 0.0)):
        width = k_a if e < 0 else k_s
        V, change = barrier.lyapunov(e, w, k, k_a, k_s)
        assert pytest.approx(math.log(width**2 / (width**2 - e**2)) / 2) == V
        speed = w - barrier.pull(e, k, width)
        near = [barrier.lyapunov(e + s * h * speed, w, k, k_a, k_s)[0] for s in (1, -1)]
        assert change == pytest.approx((near[0] - near[1]) / (2 * h), rel=1e-5)


def test_what_would_pass_is_told() -> None:
    """Equal widths: four over 2 k k_x^2."""
    start, period, rate = barrier.check_start, barrier.check_period, barrier.check_rate
    start("b", 0.39, 0.7, 0.4)
    start("b", -0.69, 0.7, 0.4)
    period("b", 3.0, 0.5, 0.5, 2.66)
    rate("b", 37.6, 0.01, 0.9)
    for call, said in (
        (lambda: start("b", 0.45, 0.7, 0.4), r"k_s = 0\.5 would pass"),
        (lambda: start("b", -0.9, 0.7, 0.4), r"barrier -0\.7\.\.0\.4; k_a = 1 would"),
        (lambda: start("b", 0.4, 0.7, 0.4), r"k_s = 0\.444 would pass"),
        (lambda: period("b", 3.0, 0.5, 0.5, 2.7), r"T <= 2\.667 s, and 2\.4 s"),
        (lambda: rate("b", 50.0, 0.01, 0.9), r"q T = 0\.5, .*0 < q T <= 0\.38"),
        (lambda: rate("b", 50.0, 0.01, 0.9), r"q = 37\.6 1/s would pass"),
        (lambda: rate("b", 0.0, 0.01, 0.9), r"q T = 0,"),
    ):
        with pytest.raises(BadInput, match=said):
            call()
