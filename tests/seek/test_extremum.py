"""Seekers do what their bounds say: ripple, rate, regimes, bias, and what is refused."""

import logging
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Scenario,
    connect,
    law,
    locking_seek,
    perturbation_seek,
    seek_limits,
    simulate,
    sliding_seek,
)
from slipctl.certify.bounds import extremum as bounds

T = 2e-4
PEAK, HEIGHT, BEND = 1.2099, 0.2862, -0.18544  # of paper 004's dry surface
THIRD = 0.3227


@law(y=Output("1", "value"))
def cubic(
    v=Input("m/s", "place"),
    top=Param("m/s", PEAK, "peak"),
    height=Param("1", HEIGHT, "height"),
    slope=Param("s/m", 0.0, "slope"),
    bend=Param("s^2/m^2", BEND, "second derivative"),
    third=Param("s^3/m^3", 0.0, "third derivative"),
):
    d = v - top
    return height + slope * d + bend * d**2 / 2 + third * d**3 / 6


def seek(seeker, seconds, start=None, **params):
    loop = connect(
        "loop", {"map.v": "seek.v", "seek.y": "map.y"}, seek=seeker,
        map=cubic.with_params(**params) if params else cubic,
    )  # fmt: skip
    return simulate(loop, Scenario("seek", seconds, start=start or {}), log=None)


# ---- sliding mode -------------------------------------------------------------------------------


@pytest.mark.parametrize(("k", "rho", "beta"), [(1, 1, 0.1), (1, 1, 0.2), (2, 0.5, 0.02)])
def test_ripple_at_the_peak(k, rho, beta):
    """Peak to peak k beta/rho: a share of 2 %, and two ticks of k T where a cell has few."""
    run = seek(sliding_seek(T, k=k, rho=rho, beta=beta, start=PEAK), 30.0 * rho / k**2)
    v = run["seek.v"].values[len(run.time) // 2 :]
    assert np.ptp(v) == pytest.approx(bounds.ripple(k, beta, rho), rel=0.02, abs=2 * k * T)
    assert v.mean() == pytest.approx(PEAK, abs=beta)


@pytest.mark.parametrize("slope", [0.1, 0.3, -0.6, 0.9])
def test_averaged_rate_below_the_finite_rate_condition(slope):
    """At constant slope, k^2 mu'/rho to 2 %."""
    run = seek(sliding_seek(T, k=1, rho=1, beta=0.05), 20.0, slope=slope, bend=0.0)
    found = float(run["seek.v"][-1]) / 20
    assert found == pytest.approx(bounds.averaged_rate(1, 1, slope), rel=0.02)
    assert bounds.regime(1, 1, slope) == bounds.AVERAGED


@pytest.mark.parametrize("slope", [0.3, 0.6, -0.6])
def test_sliding_climbs_at_rho(slope):
    """Beyond the condition the value gains rho per s, to 2 %."""
    run = seek(sliding_seek(T, k=1, rho=0.1, beta=0.02), 10.0, slope=slope, bend=0.0)
    y = run["map.y"].values
    assert (y[-1] - y[len(y) // 5]) / 8.0 == pytest.approx(0.1, rel=0.02)
    v = run["seek.v"].values
    rate = bounds.averaged_rate(1, 0.1, slope)
    assert (v[-1] - v[len(v) // 5]) / 8 == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize(("share", "sliding"), [(0.99, False), (1.01, True)])
def test_sliding_begins_at_rho_over_k(share, sliding):
    """Just below, delta runs through cells for ever; just above, it stays on one plane."""
    rho = 0.5
    run = seek(sliding_seek(T, k=1, rho=rho, beta=0.02), 8.0, slope=share * rho, bend=0.0)
    late = run["seek.delta"].values[len(run.time) // 2 :]
    kept = np.ptp(late) < 0.02
    assert kept == sliding
    assert (bounds.regime(1, rho, share * rho) == bounds.SLIDING) == sliding


def test_time_constant_of_the_printed_set():
    """k = rho = 1 on the dry surface: 5.393 s; measured from the approach, to 2 %."""
    tau = bounds.time_constant(1, 1, BEND)
    assert tau == pytest.approx(5.393, abs=5e-4)
    run = seek(sliding_seek(T, k=1, rho=1, beta=0.02, start=0.6), 8.0)
    left = PEAK - np.convolve(run["seek.v"].values, np.full(200, 1 / 200), "valid")  # a ripple
    assert 6 / math.log(left[5000] / left[35000]) == pytest.approx(tau, rel=0.02)


@given(
    k=st.floats(0.1, 10), rho=st.floats(0.01, 10), beta=st.floats(1e-3, 0.5),
    slope=st.floats(-5, 5),
)  # fmt: skip
def test_rates_are_consistent(k, rho, beta, slope):
    """No seeker moves faster than k; ripple is least at the peak; uphill is uphill."""
    rate = bounds.averaged_rate(k, rho, slope)
    assert abs(rate) <= k * (1 + 1e-12)
    assert rate * slope >= 0
    assert bounds.ripple(k, beta, rho, slope) >= bounds.ripple(k, beta, rho)
    assert bounds.sampled_ripple(k, beta, rho, beta / rho / 50) == pytest.approx(
        bounds.ripple(k, beta, rho), rel=1e-6
    )


def test_a_seeker_that_never_slides_is_warned_of(caplog):
    with caplog.at_level(logging.WARNING):
        sliding_seek(T, k=1, rho=1, beta=0.1, steepest=0.66)
    assert "averaged regime" in caplog.text
    assert "rho below 0.66 would slide" in caplog.text
    caplog.clear()
    seeker = sliding_seek(T, steepest=0.66)
    assert caplog.text == ""
    told = seek_limits(seeker, steepest=0.66, curvature=BEND)
    assert told.regime == "sliding"
    assert told.ripple == pytest.approx(0.2)
    assert told.rate == pytest.approx(0.1 / 0.66)
    printed = seek_limits(seeker.with_params(rho=1.0, beta=0.1), steepest=0.66, curvature=BEND)
    assert printed.regime == "averaged"
    assert "averaged regime: rho/k = 1 >=" in printed.notes


def test_too_few_ticks_in_a_cell_are_refused():
    sliding_seek(T, rho=1.0, beta=2.0 * T)
    with pytest.raises(BadInput, match=r"beta = 0\.0004 or a period"):
        sliding_seek(T, rho=1.0, beta=1.99 * T)
    with pytest.raises(BadInput, match="rho = -1 must be positive"):
        sliding_seek(T, rho=-1)


# ---- perturbation -------------------------------------------------------------------------------


def test_poles_of_the_spec():
    """k = 200 times a in the demodulation is k = 20 without; a = .1, w_l = 5: -.1929, -4.807."""
    slow, fast = bounds.perturbation_poles(20, 5, 0.1, BEND)
    assert slow.real == pytest.approx(-0.1929, abs=5e-5)
    assert fast.real == pytest.approx(-4.807, abs=5e-4)


def test_fixed_dither_settles_at_its_bias():
    """Averaging is of first order in the corners over w: 3 % of the bias at 20 Hz."""
    w, a = 2 * math.pi * 20, 0.3
    block = perturbation_seek(T, k=20, a=a, w=w, start=PEAK)
    run = seek(block, 40.0, third=THIRD)
    theta = run["seek.theta"].values
    bias = bounds.perturbation_bias(a, BEND, THIRD)
    ticks = round(2 * math.pi / w / T) * 20
    assert theta[-ticks:].mean() - PEAK == pytest.approx(bias, rel=0.03)
    told = seek_limits(block, steepest=0.66, curvature=BEND, third=THIRD)
    assert told.bias == pytest.approx(bias)
    assert told.ripple == pytest.approx(0.6)
    assert np.ptp(run["seek.v"].values[-ticks:]) == pytest.approx(0.6, rel=0.02)


def test_slow_pole_of_a_fixed_dither():
    """Approach from 0.2 m/s away against the averaged pole, to 5 % (it is an average)."""
    w, w_l = 2 * math.pi * 20, 5.0
    run = seek(perturbation_seek(T, k=20, a=0.1, w=w, w_l=w_l, start=PEAK - 0.2), 10.0)
    theta = run["seek.theta"].values
    rate = math.log((PEAK - theta[15000]) / (PEAK - theta[40000])) / 5.0
    gain = bounds.washout(w, 0.9)
    slow = bounds.perturbation_poles(20, w_l, 0.1, BEND, gain)[0]
    assert rate == pytest.approx(-slow.real, rel=0.05)


@pytest.mark.parametrize(("share", "grows"), [(0.9, False), (1.1, True)])
def test_vanishing_dither_lives_above_its_slope(share, grows):
    """At constant slope; 10 % aside, because a ripple of xi remains at 10 Hz."""
    r, w = 20.0, 2 * math.pi * 10
    slope = share * bounds.vanishing_slope(r, bounds.washout(w, 0.9))
    block = perturbation_seek(T, dither="vanishing", k=1e-6, w=w, w_l=5, r=r, q=2.0)
    run = seek(block, 20.0, slope=slope, bend=0.0)
    a = run["seek.amplitude"].values
    assert (a[-1] > a[len(a) // 2]) == grows


def test_vanishing_dither_dies_out_near_the_peak():
    block = perturbation_seek(
        T, dither="vanishing", k=20, w=2 * math.pi * 10, w_l=5, r=20, start=0.3
    )
    run = seek(block, 60.0)
    told = seek_limits(block, steepest=0.66, curvature=BEND)
    assert float(run["seek.amplitude"][-1]) < 1e-3
    zone = bounds.vanishing_slope(20) / abs(BEND)
    assert abs(float(run["seek.theta"][-1]) - PEAK) < zone
    assert told.ripple == 0
    assert "may stop" in told.notes


def test_what_is_refused_of_a_dither():
    with pytest.raises(BadInput, match=r"near the filter corners .* 4\.5 rad/s or more"):
        perturbation_seek(T, w=4.4)
    perturbation_seek(T, w=4.5)
    with pytest.raises(BadInput, match="needs ten"):
        perturbation_seek(0.1, w=10.0)
    with pytest.raises(BadInput, match="no dither 'fading'"):
        perturbation_seek(T, dither="fading")
    with pytest.raises(BadInput, match="flees the extremum; -20 would pass"):
        seek_limits(perturbation_seek(T), steepest=1, curvature=0.2)
    with pytest.raises(BadInput, match="is no seeker"):
        seek_limits(cubic, steepest=1, curvature=-1)


@pytest.mark.parametrize(
    "block",
    [sliding_seek(T), perturbation_seek(T), perturbation_seek(T, dither="vanishing"),
     sliding_seek(T, unit_of_place="1", unit_of_value="N")],
    ids=["sliding", "fixed", "vanishing", "other units"],
)  # fmt: skip
def test_units_of_seekers(block):
    assert block.check_units() == []


@pytest.mark.parametrize(
    "wrong",
    [{"third": math.nan}, {"third": math.inf}, {"curvature": -math.inf}, {"curvature": 0.0},
     {"steepest": 0.0}, {"curvature": -BEND}],
)  # fmt: skip
@pytest.mark.parametrize("make", [perturbation_seek, locking_seek])
def test_a_map_that_no_seeker_climbs_is_refused(make, wrong):
    """A number that is none, no peak at all, and a valley, from which the gain flees."""
    with pytest.raises(BadInput):
        seek_limits(make(T), **dict(steepest=0.66, curvature=BEND) | wrong)


@pytest.mark.parametrize("k", [0.5, 2.0, 5.0])
def test_a_weak_dither_is_as_slow_as_its_slower_pole(k):
    """Both poles are real and their sum is -w_l, so the slower one has 2/w_l at least."""
    block = perturbation_seek(T, k=k)
    assert seek_limits(block, steepest=0.66, curvature=BEND).time_constant > 2 / 0.7
