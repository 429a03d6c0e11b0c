"""One tick of an error inside bounds: what it reaches and keeps, against a grid of errors."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from slipctl.certify.arithmetic import enclosure
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.models.bounded_error.certificate import scalar_maps
from slipctl.models.bounded_error.certificate.scalar_maps import (
    AtanhPull,
    CubicPull,
    Interval,
    Tick,
    exactly,
    image,
    limits,
    proves_kept,
    roots,
    smallest,
    wider,
)
from slipctl.models.bounded_error.certificate.scalar_runs import Move, Run, aim_at, replay_errors

F = Fraction

PULLS = {"funnel": AtanhPull(0.3), "barrier": CubicPull(0.4, 1.5), "weak": CubicPull(0.05, 0.75)}


@pytest.mark.parametrize("name", PULLS)
def test_a_pull_is_that_of_its_law(name) -> None:
    """Its slope is its change, it peaks where that is zero, and falls to a push on both sides."""
    pull = PULLS[name]
    for share in (0.05, 0.3, 0.55, 0.8, 0.97):
        y = share * pull.width
        change = (pull.at(y + 1e-6) - pull.at(y - 1e-6)) / 2e-6
        assert pull.slope(y) == pytest.approx(change, rel=1e-4, abs=1e-7)
        assert pull.where(pull.slope(y)) == pytest.approx(y, rel=1e-9)
    assert pull.slope(pull.peak) == pytest.approx(0, abs=1e-12)
    assert pull.slope(pull.peak * 0.999) > 0 > pull.slope(pull.peak * 1.001)
    top = pull.at(pull.peak)
    for push in (0.01 * top, 0.5 * top, 0.999 * top):
        low, high = roots(pull, push)
        assert low < pull.peak < high < pull.width
        assert [pull.at(low), pull.at(high)] == pytest.approx([push, push], rel=1e-9)
    assert roots(pull, 1.001 * top) == (math.inf, 0.0)
    assert roots(pull, 0.0) == (0.0, pull.width)


@pytest.mark.parametrize("y", ["0.1", "0.647918", "0.999"])
def test_a_pull_in_decimals_is_that_of_floats(y) -> None:
    for pull in PULLS.values():
        exact = scalar_maps.replace(pull, **{k: Decimal(repr(v)) for k, v in vars(pull).items()
                                             if k != "peak"})  # fmt: skip
        at = Decimal(y) * exact.width
        with precise(40):
            assert float(exact.at(at)) == pytest.approx(pull.at(float(at)), rel=1e-12)
            slope = pull.slope(float(at))
            assert float(exact.slope(at)) == pytest.approx(slope, rel=1e-9, abs=1e-12)


TICKS = {
    "one width": Tick(PULLS["barrier"], PULLS["barrier"], 0.02, 0.05),
    "two widths": Tick(PULLS["weak"], PULLS["barrier"], 0.004, 0.03),
    "strong": Tick(CubicPull(2.5, 0.75), CubicPull(1.5, 1.5), 0.03, 0.04),
    "moving": Tick(CubicPull(2.5, 0.75), PULLS["funnel"], 0.02, 0.04, 1.07, 1.05, -0.02),
    "quiet": Tick(CubicPull(2.0, 0.75), AtanhPull(1.7), 0.01, 0.0, 1.02, 1.01, 0.01),
}


def reached(tick: Tick, z: Interval, many: int = 120) -> tuple[float, float]:
    """Least and largest next error over a grid of errors and noises."""
    at = np.linspace(z.low, z.high, many)
    inner = [tick.below.where(tick.q / tick.r), tick.above.where(tick.q / tick.r)]
    at = np.unique(np.concatenate([at, [x for s in (1, -1) for x in s * np.array(inner)
                                        if z.low <= x <= z.high]]))  # fmt: skip
    found = [tick.after(x + n) - tick.r * n for x in at
             for n in np.linspace(-tick.noise, tick.noise, 9)]  # fmt: skip
    return min(found) - tick.push, max(found) + tick.push


@pytest.mark.parametrize("name", TICKS)
def test_what_a_tick_reaches_is_the_hull_of_what_any_error_does(name) -> None:
    """No point lies outside; the ends are reached to 1e-3, but where the noise counts twice."""
    tick = TICKS[name]
    near, far = tick.above.width - tick.noise, tick.below.width - tick.noise
    for low, high in ((-0.7, 0.7), (-0.2, 0.6), (-0.9, -0.3), (0.1, 0.8), (-0.05, 0.02),
                      (0.5, 0.5), (-0.99, 0.99)):  # fmt: skip
        z = Interval(low * far, high * near)
        for own, inner in ((tick, z), (tick.mirrored(), Interval(-z.high, -z.low))):
            found, (least, most) = image(own, inner), reached(own, inner)
            assert found is not None
            assert found.low <= least + 1e-12
            assert most - 1e-12 <= found.high
            room = 1e-3 + (2 * own.r * own.noise if min(-inner.low, inner.high) < own.noise else 0)
            assert found.high - most < room
            assert least - found.low < room
    assert image(tick, Interval(-far, 0.0)) is None
    assert image(tick, Interval(0.0, near)) is None
    wide = image(tick, Interval(-0.1, 0.1), 0.25)
    thin = image(tick, Interval(-0.1, 0.1))
    assert wide == pytest.approx((thin.low - 0.25, thin.high + 0.25))


def decimals(tick: Tick) -> Tick:
    def of(p):
        return scalar_maps.replace(p, **{k: Decimal(repr(v)) for k, v in vars(p).items()
                                         if k != "peak"})  # fmt: skip

    numbers = {k: Decimal(repr(float(getattr(tick, k))))
               for k in ("push", "noise", "q", "r", "shift")}  # fmt: skip
    return Tick(of(tick.below), of(tick.above), **numbers)


@pytest.mark.parametrize("name", TICKS)
def test_what_is_kept_in_floats_is_proved_in_decimals_but_at_its_very_end(name) -> None:
    tick = TICKS[name]
    exact = decimals(tick)
    for low, high in ((-0.6, 0.7), (-0.3, 0.2), (-0.05, 0.3), (-0.9, 0.05)):
        z = Interval(low * tick.below.width, high * tick.above.width)
        found = image(tick, z)
        with precise(50):
            same = image(exact, Interval(*(Decimal(repr(x)) for x in z)))
        if found is None:
            assert same is None
            continue
        assert float(same.low) <= found.low + 1e-12
        assert float(same.high) >= found.high - 1e-12
        assert float(same.low) == pytest.approx(found.low, abs=1e-6)
        assert float(same.high) == pytest.approx(found.high, abs=1e-6)
        hull = Interval(*(Decimal(repr(x)) for x in z))
        assert proves_kept(exact, hull) == same.inside(hull)
    far = scalar_maps.replace(exact, shift=Decimal(10**12 + 1))
    inner = Interval(Decimal("-0.1"), Decimal("0.1"))
    assert not proves_kept(far, inner)
    huge = CubicPull(Decimal("1e-40"), Decimal(10**14))
    calm = Tick(huge, huge, Decimal(0), Decimal(0), Decimal("0.5"), Decimal(1), Decimal(0))
    assert proves_kept(calm, Interval(Decimal(-(10**12)), Decimal(10**12)))
    assert not proves_kept(calm, Interval(Decimal(-(10**12) - 1), Decimal(10**12)))
    assert not proves_kept(calm, Interval(Decimal(-(10**12)), Decimal(10**12 + 1)))


STILL = {k: scalar_maps.replace(t, q=1, r=1, shift=0) for k, t in TICKS.items()}


@pytest.mark.parametrize("name", STILL)
def test_the_smallest_set_is_kept_and_none_that_is_smaller(name) -> None:
    """From the start it moves out as far as it must; beyond its limits the push leads out."""
    tick = STILL[name]
    most = limits(tick)
    for side, far, pull in ((1, most[1], tick.above), (-1, most[0], tick.below)):
        assert 0 < far < pull.width - tick.noise + 1e-12
        assert pull.at(far + tick.noise) == pytest.approx(tick.push, rel=1e-6)
        assert pull.at(far + tick.noise - 1e-6) > tick.push > pull.at(far + tick.noise + 1e-6)
        assert side * (tick.after(side * (far + 2e-6 + tick.noise)) - side * tick.noise
                       + side * tick.push) > far  # fmt: skip
    for start in (Interval(-0.05, 0.1), Interval(-0.3, 0.0), Interval(0.0, 0.45)):
        found = smallest(tick, start)
        if found is None:
            worst = image(tick, Interval(-most[0], most[1]))
            assert worst is None or not worst.inside(Interval(-most[0], most[1]))
            continue
        assert start.inside(found)
        kept = image(tick, found)
        assert kept.low >= found.low - 1e-9
        assert kept.high <= found.high + 1e-9
        for cut in (Interval(found.low + 1e-5, found.high), Interval(found.low, found.high - 1e-5)):
            left = image(tick, cut)
            assert not (start.inside(cut) and left is not None and left.inside(cut))
    assert smallest(tick, Interval(0.0, most[1] + 1e-6)) is None
    assert smallest(tick, Interval(-most[0] - 1e-6, 0.0)) is None
    assert limits(scalar_maps.replace(tick, push=9.0)) == (-1.0, -1.0)


def test_an_interval_between_two_is_so_much_wider_on_either_side() -> None:
    inner, most = Interval(-1.0, 2.0), (5.0, 10.0)
    assert wider(inner, most, 0.25) == (-2.0, 4.0)
    assert wider(inner, most, 1.0) == (-5.0, 10.0)
    assert Interval(-1, 2).inside(Interval(-1, 2))
    assert not Interval(-1, 2).inside(Interval(0, 2))
    assert not Interval(-1, 2).inside(Interval(-1, 1))


@pytest.mark.parametrize("name", TICKS)
def test_an_error_is_aimed_at_by_some_error_noise_and_push(name) -> None:
    tick = TICKS[name]
    for z in (Interval(-0.3, 0.4), Interval(0.1, 0.2), Interval(-0.3, -0.2)):
        ends, grid = image(tick, z), reached(tick, z)
        for share in (-0.2, 0.0, 0.1, 0.5, 0.77, 1.0, 1.2):
            target = ends.low + share * (ends.high - ends.low)
            error, noise, push = aim_at(tick, z, target)
            assert z.low <= error <= z.high
            assert abs(noise) <= tick.noise
            assert abs(push) <= tick.push
            after = tick.after(error + noise) - tick.r * noise + push
            least, most = grid
            wanted = min(max(target, least), most)
            assert after == pytest.approx(wanted, abs=1e-9 if least < target < most else 2e-3)


def test_errors_of_a_run_have_radii_that_hold_the_true_ones() -> None:
    """Of the funnel with 50 digits: the same run with 90 lies within each radius."""
    tick = decimals(TICKS["moving"])
    start, moves = Decimal("0.125"), [Move(Decimal("0.01") * (i == 3), Decimal("0.03"),
                                           Decimal("-0.015")) for i in range(9)]  # fmt: skip
    found = list(replay_errors(lambda i: tick, Run(start, moves)))
    assert len(found) == 9
    with precise(90):
        z = start
        for move, (value, radius) in zip(moves, found, strict=True):
            z = z + move.step
            assert abs(z - value) <= radius
            assert radius <= Decimal("1e-25")
            z = tick.after(z + move.noise) - tick.r * move.noise + move.push
    assert found[0][1] == 0
    assert all(b > Decimal("1e-31") for _, b in found[1:])
    assert exactly(F(1, 3)) == Decimal("0." + "3" * 50)


def test_a_search_for_what_is_largest_that_ends_early_tells_what_is_left(monkeypatch) -> None:
    """Of two halves one is looked at, the other still may come to ten."""
    import casadi as ca

    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [x])
    monkeypatch.setattr(enclosure, "AT_ONCE", 1)
    for last, bound in ((1.0, 10.0), (12.0, 12.0)):
        told = [[last], [10.0]]
        found = enclosure.largest(
            f,
            np.zeros(1),
            np.full(1, 2.0),
            0.0,
            most=1,
            value=lambda y: 0 * y[0],
            bound=lambda a, b, told=told: np.array(told.pop()),
        )
        assert found == (0.0, bound, 2)
