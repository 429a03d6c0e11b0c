"""The locking seeker finds a peak, keeps it without ripple, and opens a lock that is off."""

import logging
import math

import numpy as np
import pytest
from casadi import exp, vertcat
from test_extremum import BEND, HEIGHT, PEAK, T, cubic

from slipctl import (
    BadInput,
    Input,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    State,
    connect,
    law,
    locking_seek,
    seek_limits,
    simulate,
    step,
)
from slipctl.certify.bounds import extremum as bounds

STEEP = 0.66


@law(y=Output("1", "value"), conditions={"one": {"top": 1.21}, "two": {"top": 1.81}})
def bump(
    v=Input("m/s", "place"),
    top=Param("m/s", PEAK, "peak"),
    height=Param("1", HEIGHT, "height"),
):
    """Rises from 0 by e height/top, and falls slowly beyond its top."""
    return height * v / top * exp(1 - v / top)


@step(y=Output("1", "value, late"), period=T)
def late(
    line=State("1", 0.0, "values, oldest first", shape=(50,)),
    u=Input("1", "value"),
):
    """Dead time of 50 ticks, 10 ms."""
    return dict(line=vertcat(line[1:], u)), dict(y=line[0])


def run(seconds, rail=None, seek=None, start=None, shape=bump, delayed=False):
    parts = {"seek": seek or locking_seek(T), "map": shape}
    wires = {"map.v": "seek.v", "seek.y": "map.y"}
    if delayed:
        parts["late"] = late
        wires |= {"late.u": "map.y", "seek.y": "late.y"}
    loop = connect("loop", wires, **parts)
    return simulate(loop, Scenario("seek", seconds, rail, start=start or {}))


def modes(log):
    """Times at which the mode changes, and the new mode."""
    m = log["seek.mode"].values
    at = np.flatnonzero(np.diff(m)) + 1
    return [(round(float(log.time[k]), 3), int(m[k])) for k in at]


@pytest.mark.parametrize("delayed", [False, True])
def test_locks_the_peak_and_keeps_it_still(delayed):
    """Within 0.3 % of the height in 6 s; the dither dies out; a dead time of 10 ms is allowed."""
    seek = locking_seek(T, steepest=math.e * HEIGHT / PEAK)
    log = run(12.0, seek=seek, delayed=delayed)
    assert [m for _, m in modes(log)] == [1, 2]
    late_part = slice(round(9.0 / T), None)
    assert log["map.y"].values[round(6.0 / T) :].min() > 0.997 * HEIGHT
    assert np.ptp(log["seek.v"].values[late_part]) < 1e-3
    assert float(log["seek.v"][-1]) == pytest.approx(PEAK, abs=0.01)


def test_the_lock_comes_after_three_more_planes():
    """delta_0 = beta/2, and the lock is where delta passes -3 beta, not before."""
    log = run(8.0)
    when = modes(log)[1][0]
    delta = log["seek.delta"].values
    k = round(when / T)
    assert delta[k - 1] < -3 * 0.02 <= delta[k - 2]
    first = round(modes(log)[0][0] / T)
    assert delta[first] == pytest.approx(0.01, abs=1e-4)
    left = np.flatnonzero(delta[first:k] > 0)[-1] + first  # three planes are left to be crossed
    assert (k - left) * T >= bounds.switch_time(0.02, 0.1, 3) * 0.9


def test_another_map_opens_the_lock():
    log = run(14.0, Rail([Section(0, "one"), Section(8.0, "two")]))
    opened = [t for t, m in modes(log) if m == 0]
    assert opened[0] == pytest.approx(8.0, abs=0.01)
    assert float(log["seek.v"][-1]) == pytest.approx(1.81, rel=0.03)


@pytest.mark.parametrize("place", [0.3, 0.8, 2.4])
def test_a_lock_off_the_peak_opens(place):
    """Put into the state of a lock where there is no peak; it finds out by itself."""
    kept = float(bump(v=place)["y"])
    start = {"seek.mode": 2.0, "seek.v": place, "seek.turn": place, "seek.a": 0.06,
             "seek.kept": kept, "seek.eta": kept}  # fmt: skip
    log = run(8.0, start=start)
    assert 0 in [m for _, m in modes(log)]
    assert float(log["map.y"][-1]) > 0.997 * HEIGHT
    assert int(log["seek.mode"][-1]) == 2


def test_what_the_dither_leaves():
    """Closed form, where the low-pass is ten times as fast as the climb: to 10 % of its log."""
    seek = locking_seek(T, gain=60.0, w=2 * math.pi * 20, w_h=1.0, w_l=10.0, r=1e-6)
    start = {"seek.mode": 2.0, "seek.v": PEAK - 0.08, "seek.turn": PEAK - 0.08, "seek.a": 0.06,
             "seek.kept": HEIGHT, "seek.eta": HEIGHT}  # fmt: skip
    log = run(8.0, seek=seek, start=start, shape=cubic)
    left = (PEAK - float(log["seek.v"][-1])) / 0.08
    told = bounds.vanishing_contraction(60.0, 0.06, 1.2, BEND)
    assert math.log(left) == pytest.approx(math.log(told), rel=0.1)


def test_delay_that_sliding_stands():
    """At 0.8 of the bound delta stays on its plane; at 3 times it falls away and locks early."""
    assert bounds.largest_delay(1.0, 0.1, 0.02, STEEP) == pytest.approx(0.02 / 0.76)
    early = {}
    for share in (0.8, 3.0):
        beta = 0.01 * (STEEP + 0.1) / share
        seek = locking_seek(T, beta=beta)
        log = run(3.0, seek=seek, delayed=True)
        early[share] = 2 in [m for _, m in modes(log)]
    assert early == {0.8: False, 3.0: True}


def test_told_before_it_runs(caplog):
    told = seek_limits(locking_seek(T), steepest=STEEP, curvature=BEND)
    assert told.regime == "sliding"
    assert told.ripple == 0
    assert told.rate == pytest.approx(0.1 / STEEP)
    assert "ripple 0.2 peak to peak" in told.notes
    assert "locks 0.6 s after" in told.notes
    with caplog.at_level(logging.WARNING):
        locking_seek(T, rho=1.0, beta=0.1, steepest=STEEP)
    assert "rho below 0.66 would slide" in caplog.text


def test_what_is_refused():
    with pytest.raises(BadInput, match=r"near the filter corners .* 25 rad/s or more"):
        locking_seek(T, w=12.0)
    with pytest.raises(BadInput, match=r"beta = 4e-05 or a period"):
        locking_seek(T, beta=1e-5)
    with pytest.raises(BadInput, match="tolerance = 0 must be positive"):
        locking_seek(T, tolerance=0.0)


def test_units():
    assert locking_seek(T).check_units() == []
    assert locking_seek(T, unit_of_place="1", unit_of_value="N").check_units() == []
