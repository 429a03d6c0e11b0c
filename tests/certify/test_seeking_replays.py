"""Runs that refute a seeker, as a file holds them: against the seeker tick by tick."""

from __future__ import annotations

import random
from fractions import Fraction
from itertools import pairwise

import pytest

from slipctl import BadInput
from slipctl.certify.checksum import with_checksum
from slipctl.certify.entries import DoesNotHold
from slipctl.models.cheng_2022.certificate import (
    dither_flight,
    dithering_kind,
    seeking_kind,
    sliding_seeker,
)
from slipctl.models.cheng_2022.certificate.sliding_seeker import Seeker, Turn

F = Fraction
REFUSED = (DoesNotHold, BadInput)

# ---- on a slope ----------------------------------------------------------------------------------


def plain(p: Seeker, slope: F, start: F, against: bool, ticks: int):
    """Tick at which mu is three cells behind, and by how much: every tick by itself."""
    sums, move = [0], p.k * slope * p.T  # of signs
    for i in range(ticks):
        heard = start + move * sums[max(0, i - p.late)] - i * p.rho * p.T
        place = heard % (2 * p.beta)
        least, most = (p.noise, p.beta - p.noise) if against else (0, p.beta)
        sums.append(sums[-1] + (1 if least <= place <= most else -1))
        behind = (i + 1) * p.rho * p.T - move * sums[-1]
        if behind >= 3 * p.beta:
            return i + 1, behind
    return 0, 0


def test_the_tick_at_which_a_seeker_is_behind_is_that_of_its_run() -> None:
    rng, said = random.Random(4), []
    for _ in range(30):
        late = rng.choice((0, 0, 3, 7))
        p = Seeker(F(rng.randint(1, 5), 2), F(rng.randint(1, 8), 3), F(rng.randint(2, 6), 20),
                   F(1, rng.choice((40, 70))), F(rng.randint(0, 4), 50), late)  # fmt: skip
        slope, start = F(rng.randint(2, 9), 7), F(rng.randint(-9, 9), 11)
        for against in (False, True):
            found = sliding_seeker.first_tick_behind(p, slope, start, against, 60)
            assert found == plain(p, slope, start, against, 60)
            said.append((found[0] > 20, found[0] > 0, against, late > 0))
    assert len(set(said)) >= 8


SLOW = {"k": F(1), "rho": F(3), "beta": F(1, 10), "slope": F(2), "least": F(1), "T": F(1, 100)}
"""It lacks two per second of what it needs: three cells in fifteen ticks."""


def behind(n=SLOW, **change):
    run = {"slope": "1", "start": "0", "ticks": 15, "noise": "none"} | change
    return seeking_kind._replay_behind(n, with_checksum(n, run))


def test_a_slope_that_is_too_small_is_fallen_behind_by_what_it_lacks() -> None:
    assert behind() == "after 15 ticks mu is 0.3 behind a climb at rho"
    assert behind(ticks=20) == "after 20 ticks mu is 0.4 behind a climb at rho"
    assert behind(ticks=50, slope="3/2").startswith("after 50 ticks mu is 0.75 behind")
    assert behind(SLOW | {"lag": F(1, 10)}).startswith("after 15 ticks")  # none climbs faster
    found = seeking_kind._find_behind(SLOW)
    assert (found["slope"], found["ticks"]) == ("1", 15)


def test_a_run_that_turns_is_replayed_tick_by_tick() -> None:
    """With eight ticks of dead time it meets the next plane."""
    n = SLOW | {"rho": F(1, 2), "dead_time": F(8, 100), "least": F(3, 2)}
    p = seeking_kind._seeker(n)
    assert p.late == 8
    start = F(1, 640)
    tick, by = plain(p, F(2), start, False, 4000)
    assert tick > 15
    run = {"slope": "2", "start": str(start), "ticks": tick}
    assert behind(n, **run) == f"after {tick} ticks mu is {float(by):.6g} behind a climb at rho"
    for change in ({"ticks": tick - 1}, {"slope": "3/2", "ticks": 2}):
        with pytest.raises(DoesNotHold, match="mu does not fall behind by three cells"):
            behind(n, **(run | change))
    with pytest.raises(DoesNotHold, match="it has a lag, or more ticks than are replayed"):
        behind(n | {"lag": F(1, 100)}, **run)
    with pytest.raises(DoesNotHold, match="it has a lag, or more ticks than are replayed"):
        behind(n, **(run | {"ticks": sliding_seeker.MOST_TICKS + 1}))
    found = seeking_kind._find_behind(n)
    assert behind(n, **{k: v for k, v in found.items() if k != "seal"}).startswith("after ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"slope": "99/100"}, "its slope or its noise is outside"),
        ({"slope": "201/100"}, "its slope or its noise is outside"),
        ({"noise": "with"}, "its slope or its noise is outside"),
        ({"ticks": 4}, "mu does not fall behind by three cells"),
        ({"ticks": 0}, "run.ticks"), ({"ticks": True}, "run.ticks"),
        ({"more": 1}, "has no entry"),
    ],
)  # fmt: skip
def test_a_run_behind_that_is_altered_is_refused(change, said) -> None:
    with pytest.raises(REFUSED, match=said):
        behind(**change)


def test_a_run_whose_seal_is_of_another_is_refused() -> None:
    run = with_checksum(SLOW, {"slope": "1", "start": "0", "ticks": 15, "noise": "none"})
    with pytest.raises(DoesNotHold, match="it was altered; its seal is that of other numbers"):
        seeking_kind._replay_behind(SLOW, run | {"ticks": 16})
    with pytest.raises(DoesNotHold, match="it was altered; its seal is that of other numbers"):
        seeking_kind._replay_behind(SLOW | {"k": F(1, 2)}, run)
    assert len(run["seal"]) == 32


TIMED = {"k": F(3), "rho": F(1, 2), "beta": F(1, 5), "slope": F(2), "least": F(1), "T": F(1, 100),
         "time": F(1)}  # fmt: skip


def test_a_start_just_below_a_turning_plane_gains_so_much_at_most() -> None:
    """rho t + beta + (k slope - rho) T - 2 beta (1 - 1e-6); k slope t where it does not climb."""
    most = F(1, 2) + F(1, 5) + F(55, 1000) - F(2, 5) * (1 - F(1, 10**6))
    jumps = {"beta": F(1, 50)}  # a tick leaves such a cell: the way itself is the bound
    for more, bound in (({}, most), (jumps, F(6))):
        for gap, late in ((bound + F(1, 10**9), True), (bound, False), (bound / 2, False)):
            n = TIMED | more | {"gap": gap}
            run = with_checksum(n, {"slope": "2"})
            if late:
                said = seeking_kind._replay_late(n, run)
                assert f"mu has gained {float(bound):.6g} at most" in said
            else:
                with pytest.raises(DoesNotHold, match="it may be in time"):
                    seeking_kind._replay_late(n, run)
            assert (seeking_kind._find_late(n) == run) == (late or (more == jumps and gap > most))
    n = TIMED | {"gap": F(9)}
    for slope in ("99/100", "201/100"):
        with pytest.raises(DoesNotHold, match="its slope is not one that was asked"):
            seeking_kind._replay_late(n, with_checksum(n, {"slope": slope}))
    short = TIMED | {"gap": F(9), "time": F(1, 10)}
    assert "gained 0 at most" in seeking_kind._replay_late(
        short, with_checksum(short, {"slope": "1"})
    )


# ---- at the peak ---------------------------------------------------------------------------------


def test_on_a_flat_top_it_moves_one_way_as_long_as_a_cell_and_its_noise() -> None:
    """(0.2 + 2 0.01)/0.005: 44 ticks of 0.03 m/s."""
    for ripple, ticks, shown in (
        (F(131, 100), 44, True), (F(132, 100), 44, False), (F(131, 100), 43, False),
        (F(1, 2), 45, False), (F(1, 2), 43, True),
    ):  # fmt: skip
        n = TIMED | {"noise": F(1, 100), "ripple": ripple}
        run = with_checksum(n, {"ticks": ticks})
        if shown:
            said = seeking_kind._replay_swing(n, run)
            assert said == f"on a flat top v moves one way for {ticks} ticks"
        else:
            with pytest.raises(DoesNotHold, match="v does not move that far between two turns"):
                seeking_kind._replay_swing(n, run)
        found = seeking_kind._find_swing(n)
        assert (found or {}).get("ticks") == (44 if ripple < F(132, 100) else None)


PEAK = {"k": F(1), "rho": F(1, 2), "beta": F(1, 8), "T": F(1, 100), "noise": F(1, 200),
        "slope": F(2), "curvature": F(-2), "ripple": F(1, 8)}  # fmt: skip


def half_cycles(p: Seeker, c: F, x: F, left: int, right: int):
    """Places of the turns on a parabola, tick by tick."""
    delta, edge, tick, side = p.beta / 2 - p.late * p.rho * p.T, F(0), p.late, 1
    for number in range(3 * (left + right)):
        to_left = number % (left + right) < left
        limit = edge - p.noise if to_left == (side < 0) else edge + p.noise
        more = None
        while more is None or more > 0:
            new = x + side * p.k * p.T
            delta += c * (new**2 - x**2) / 2 - p.rho * p.T
            x, tick = new, tick + 1
            if more is not None:
                more -= 1
            elif delta < limit:
                more = p.late
        if abs(x) + p.k * p.T > p.rho / (p.k * abs(c)):
            return
        yield Turn(tick, x, side)
        side, edge = -side, edge - p.beta


@pytest.mark.parametrize("late", [0, 3])
def test_turns_about_a_peak_are_those_of_its_ticks(late) -> None:
    for start, left, right in ((F(0), 2, 3), (F(1, 16), 3, 2), (F(-1, 10), 2, 2)):
        p = seeking_kind._seeker(PEAK | {"dead_time": late * PEAK["T"]})
        found = list(sliding_seeker.turns(p, F(-2), start, left, right))
        assert found == list(half_cycles(p, F(-2), start, left, right))
        assert len(found) == 3 * (left + right)
    far = list(sliding_seeker.turns(p, F(-2), F(6, 25), 2, 2))
    assert far == list(half_cycles(p, F(-2), F(6, 25), 2, 2))
    assert len(far) < 12  # it leaves the zone


def test_the_last_swing_is_that_of_the_last_period_but_one() -> None:
    def swing(*places, left=2, right=2):
        return sliding_seeker.last_swing([Turn(0, F(x), 1) for x in places], left, right)

    assert swing(9, 9, -9, 0, 1, -4, 2, 3, 1, -4, 2, 3) == 7
    assert swing(9, 9, -9, 0, 1, -4, 2, 3, 1, -5, 2, 3) == 7  # wider still: as wide at least
    assert swing(9, 9, -9, 0, 1, -4, 2, 3, 1, -4, 2, 2) == 0  # it still falls
    assert swing(9, 9, -9, 1, -4, 2, 3, 1, -4, 2, 3) == 0  # a turn too few
    assert swing(0, 1, 5, 0, 7, 2, 9, 3, 1, left=1, right=2) == 0
    assert swing(0, 1, 5, 0, 7, 2, 9, 3, 1, left=2, right=1) == 0


def swings(n=PEAK, **change):
    run = {"start": "1/16", "left": 3, "right": 2} | change
    return seeking_kind._replay_swing(n, with_checksum(n, run))


def test_a_swing_about_a_peak_is_that_of_its_turns() -> None:
    turns = list(half_cycles(seeking_kind._seeker(PEAK), F(-2), F(1, 16), 3, 2))
    widths = [max(t.x for t in part) - min(t.x for t in part) for part in (turns[5:10], turns[10:])]
    assert widths[1] >= widths[0]
    wide = widths[0]
    said = swings(PEAK | {"ripple": wide - F(1, 10**6)})
    assert said.startswith(f"after {turns[-1].tick} ticks v has moved by {float(wide):.6g} m/s")
    with pytest.raises(DoesNotHold, match="v stays within the wanted ripple"):
        swings(PEAK | {"ripple": wide})
    for n, change in ((PEAK | {"lag": F(1, 1000)}, {}), (PEAK, {"start": "-251/1000"}),
                      (PEAK, {"start": f"1/{2**401}"}),
                      (PEAK | {"beta": F(1, 3**300)}, {})):  # fmt: skip
        with pytest.raises(DoesNotHold, match="its start or a lag is outside of what was asked"):
            swings(n, **change)
    for change in ({"left": 1}, {"right": 1}, {"left": 601}, {"start": "x"}):
        with pytest.raises(BadInput, match=f"run.{next(iter(change))}"):
            swings(**change)


# ---- a dither ------------------------------------------------------------------------------------

DITHERED = {k: F(v) for k, v in dict(k=20, w=40, w_l=30, w_h=25, curvature=3).items()} | {
    "a": F(1, 2), "T": F(1, 100), "noise": F(1, 50), "start": F(1, 3)}  # fmt: skip


def flies(n, **change):
    run = {"start": "1/3", "noise": "outward", "ticks": 40} | change
    return dithering_kind._replay_flight(n, with_checksum(n, run))


def test_a_flight_comes_as_far_as_its_ticks_and_its_noise_take_it() -> None:
    quiet = DITHERED | {"noise": F(0)}
    far = dither_flight.flight(DITHERED, F(1, 3), F(1, 50), 40)
    near = dither_flight.flight(quiet, F(1, 3), F(0), 40)
    assert near is not None
    assert far > near > F(1, 2)
    other = dither_flight.flight(DITHERED, F(-1, 3), F(1, 50), 40)
    for change, reached in (({}, far), ({"noise": "none"}, near), ({"start": "-1/3"}, other)):
        n = DITHERED | {"reach": reached * F(999, 1000)}
        limit = float(n["reach"])
        assert flies(n, **change) == f"after 40 ticks |th - v*| exceeds {limit:.6g} m/s"
        with pytest.raises(DoesNotHold, match="run: it does not leave"):
            flies(n | {"reach": reached}, **change)


@pytest.mark.parametrize(
    ("more", "change", "said"),
    [
        ({}, {"start": "334/1000"}, "its start or its noise is outside"),
        ({}, {"start": "-334/1000"}, "its start or its noise is outside"),
        ({}, {"noise": "inward"}, "its start or its noise is outside"),
        ({"dead_time": F(dither_flight.OLDEST + 1, 100)}, {}, "its start or its noise is outside"),
        ({"w": F(401)}, {}, "its start or its noise is outside"),
        ({}, {"ticks": 0}, "run.ticks"),
        ({}, {"ticks": dithering_kind.MOST_DITHER_TICKS + 1}, "run.ticks"),
        ({}, {"ticks": 1}, "run: it does not leave"),
    ],
)  # fmt: skip
def test_a_flight_that_is_altered_is_refused(more, change, said) -> None:
    n = DITHERED | {"reach": F(3, 5)}
    assert flies(n).startswith("after 40 ticks")
    with pytest.raises(REFUSED, match=said):
        flies(n | more, **change)


@pytest.mark.parametrize(
    "text", ["1e7", "1000001.0", "nan", "inf", "1", "0.10", "1_0.0", "", "x", "0" * 30, 0.5, None]
)
def test_a_number_of_a_proof_is_written_shortest(text) -> None:
    for good in ("0.1", "-1000000.0", "1e-07", "0.0"):
        assert dithering_kind._decimal(good, "P") == float(good)
    with pytest.raises(BadInput, match="P must hold decimal numbers of at most 1e6"):
        dithering_kind._decimal(text, "P")


def test_what_seeks_nothing_is_refused() -> None:
    for wrong, said in (({"least": F(3)}, "least = 3 s/m must not exceed slope = 2 s/m"),
                        ({"curvature": F(0)}, "curvature = 0 is a flat top"),
                        ({"gap": F(1)}, "gap asks for nothing without time"),
                        ({"time": F(1)}, "time asks for nothing without gap")):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            seeking_kind._sliding_guard(PEAK | wrong)
    for name in ("k", "curvature"):
        with pytest.raises(BadInput, match=f"{name} = 0 seeks nothing"):
            dithering_kind._perturbation_guard(DITHERED | {name: F(0)})
    assert seeking_kind._sliding_guard(PEAK | {"gap": F(1), "time": F(1)}) is None
    assert dithering_kind._perturbation_guard(DITHERED) is None
    ends = [sliding_seeker.ticks_late(F(k, 10), F(1)) for k in (0, 1, 10, 11)]
    assert all(a <= b for a, b in pairwise(ends))
    assert ends == [0, 1, 1, 2]
