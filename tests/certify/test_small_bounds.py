"""Small bounds and refusals inside the proofs, each against its closed form or a run of its own."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from decimal import Context, Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.certify import certificate, proofs, safe_json
from slipctl.certify.arithmetic import binomial
from slipctl.certify.bounds import extremum, linear_kind, observers
from slipctl.certify.catalogue import SYSTEMS, certify
from slipctl.certify.checksum import with_checksum
from slipctl.certify.entries import DoesNotHold, read_mapping
from slipctl.certify.promise import REFUTED, rounded_up
from slipctl.certify.systems import CERTIFIED
from slipctl.models.bounded_error.certificate import bounded_error, lagged_maps, lagged_runs
from slipctl.models.bounded_error.certificate.interval_systems import sets
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged, lag_numbers
from slipctl.models.bounded_error.certificate.scalar_maps import CubicPull, Interval
from slipctl.models.cheng_2022.certificate import (
    dither,
    dither_flight,
    dither_push,
    dither_search,
    dithering_kind,
    seeking_kind,
    sliding_seeker,
)
from slipctl.models.cheng_2022.certificate.ball import Ball
from slipctl.models.huang_2020.certificate import (
    reaching_law,
    relay_orbits,
    relay_proof,
    relay_sets,
)
from slipctl.models.huang_2020.certificate.relay_sets import Relay
from slipctl.models.super_twisting.certificate import (
    super_twisting,
    twisting_polygons,
    twisting_proof,
    twisting_sampled,
)
from slipctl.models.super_twisting.certificate.twisting_levels import Levels
from slipctl.models.super_twisting.certificate.twisting_report import exact_verdict
from slipctl.models.super_twisting.certificate.twisting_rows import EMPTY, Grid, Law, Rows
from slipctl.models.super_twisting.certificate.twisting_turns import Sweep
from slipctl.models.wang_2025.certificate.saturated_motion import Saturated, half_turn
from slipctl.models.zhang_2021.certificate import funnel_kind

F = Fraction

# ---- super-twisting ------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3])
def test_a_criterion_does_not_depend_on_the_unit(unit):
    """x1 -> c x1 takes k1 to root(c) k1, k2 to c k2 and L to c L; the verdict stays."""
    k1, k2, L = math.sqrt(unit), 0.14 * unit, 0.01 * unit
    assert super_twisting.polyakov_poznyak(k1, k2, L)
    assert not super_twisting.polyakov_poznyak(-k1, k2, L)
    assert not super_twisting.polyakov_poznyak(k1, k2, L * 4)


def test_scores_are_one_tick_of_the_law():
    """Largest y of a row and of its mirror image: each is moved by the sign of y it has."""
    k1, tops = 0.8, np.array([-3.0, 0.0, 0.3, 4.0, -np.inf])
    w = np.array([-1.0, 0.5, 2.0, 0.1, 7.0])
    sources = np.stack([tops, -tops[::-1]])
    for side, found in zip((0, 1, -1), twisting_sampled._scores(k1, tops, w), strict=True):
        for y, moved, at in zip(sources.ravel(), found.ravel(), np.tile(w, 2), strict=True):
            if math.isinf(y) or np.sign(y) != side:
                assert moved == EMPTY
            else:
                assert moved == pytest.approx(y - k1 * math.sqrt(abs(y)) * side + at)


def test_rows_of_the_gain_lose_a_small_share():
    """At most 2 % is lost, and of a law with much to spare no more rows are taken than that."""
    law = Law(F(7), F(29, 10), F(1))
    parts, ratio = twisting_sampled._parts(law, 3), F(39, 19)
    assert super_twisting.log_ratio(7.0, 2.9, 1.0) < -0.2  # much to spare
    for p in range(3, parts + 1):
        assert (math.ceil(ratio * p) <= ratio * p * F(102, 100)) == (p == parts)


def test_the_box_ends_where_the_fastest_fall_meets_zero():
    """From its corner w falls along dw/dz = 2 (k2 + 1) z / (k1 z - w), told per unit of L."""
    k1, k2 = 6.0, 1.5
    P = twisting_polygons._box(k1, k2, {"wide": 2.0, "down": 0.8, "push": 0.1, "fall": 0.01})
    assert P is not None
    (z0, w0), (z1, w1), (z, w), (end, low) = P
    assert (z0, w0, w1, end) == (0, 1, 1, 0)
    assert z1 == z == pytest.approx(2 / k1)  # where the root is twice w
    assert w == pytest.approx(0.2)
    assert w - low == pytest.approx(1.1 * z * 2 * (k2 + 1) * z / (k1 * z - w))
    # where w is above the root, z grows: no corner
    assert twisting_polygons._box(k1, k2, {"wide": 0.1, "down": 0.5, "push": 0.1}) is None


GRID = Grid(Law(F(5), F(3), F(1)), 4, 10)


def test_rows_without_a_state_reach_nowhere():
    assert Rows(GRID, np.full(6, EMPTY)).largest() == 0
    assert Rows(GRID, np.array([EMPTY, 3.0])).largest() == 3 * GRID.unit


@pytest.mark.parametrize(("lowest", "ends"), [(-3, [1.0, 2.0]), (-1, [5.0, EMPTY, 7.0, 4.0])])
def test_rows_of_a_sweep_hold_its_rows_and_their_mirror_images(lowest, ends):
    """Row i of a sweep has w from (lowest + i) h on; as many rows lie above zero as below."""
    found = Sweep(GRID, [9], np.zeros(1), np.zeros(1), lowest, np.array(ends)).rows().ends
    n = len(found) // 2
    assert len(found) == 2 * n
    assert n >= max(-lowest, lowest + len(ends))
    wanted = {lowest + i: max(e, 0.0) for i, e in enumerate(ends)}
    assert [wanted.get(i - n, 0.0) for i in range(2 * n)] == list(found)


BOX = ((F(0), F(1)), (F(1, 2), F(1)), (F(1, 2), F(1, 5)), (F(0), F(-1, 2)))


def test_rows_of_a_polygon_hold_its_corners():
    """In the row of a corner y is at least (z kept)^2, exactly, also in very small units."""
    grid = Grid(GRID.law, 1, 30)
    levels = Levels(grid.law, BOX, F(80), F(1, 100))
    rows = levels.rows(grid)
    n, kept = len(rows.ends) // 2, F(levels.kept)
    for z, w in BOX[:-1]:
        row = min(int(w * kept // grid.height) + n, 2 * n - 1)
        assert F(rows.ends[row]) * grid.unit >= (z * kept) ** 2


@pytest.mark.parametrize("corners", [
    (*BOX[:2], BOX[1], *BOX[2:]),  # one twice: its edges may turn either way there
    (BOX[0], (F(3, 4), F(1)), *BOX[1:]),  # goes back the way it came
    BOX[:3],
])  # fmt: skip
def test_what_is_no_convex_polygon_proves_nothing(corners):
    levels = Levels(GRID.law, BOX, F(80), F(1, 100))
    assert levels._shaped()
    assert not replace(levels, corners=corners)._shaped()


# ---- saturation ----------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("exact", [False, True])
def test_half_turn_of_a_damped_motion(damping, exact):
    """e'' = -e - 2 d e' out of reach of its limits: R(s) = s exp(-pi d/root(1 - d^2))."""
    kind = Decimal if exact else float
    law = Saturated(kind(1), kind(2 * damping), (kind(2),) * 2, (kind(2),) * 2)
    rest = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    widths = []
    for steps in (50, 400):
        high, low = (half_turn(law, kind(1), above, steps) for above in (True, False))
        assert high is not None
        assert low is not None
        assert low[0] <= rest <= high[0]
        widths.append(high[0] - low[0])
    assert widths[1] < widths[0] / 2


def test_swings_that_die_out_are_certified_from_far():
    """4 m is beyond where nothing saturates; what proves it is the ladder of swings."""
    numbers = dict(k1="0.5", k3="0.2", M=500000, F_min=-100000, F_max=100000, F_low=-40000,
                   F_high=50000)  # fmt: skip
    criteria = SYSTEMS["saturation_compensation"].criteria
    exact = {k: F(v) for k, v in numbers.items()} | {"start": F(4)}
    assert criteria["ladder"].holds(exact)
    assert not criteria["free"].holds(exact)


def test_a_need_out_of_reach_is_shown_from_rest():
    """e1 starts at 0, and speeds up by the force that is missing."""
    numbers = dict(k1=0.5, k3=0.2, M=5e5, F_min=-1e5, F_max=1e5, F_low=0.0, F_high=1.5e5)
    shown = SYSTEMS["saturation_compensation"].witness(numbers).trajectory
    assert shown["e1"][1][0] == pytest.approx(0, abs=1e-9)
    within = SYSTEMS["saturation_compensation"].witness(numbers | {"F_high": 5e4}).trajectory
    assert set(within["e1"][1]) == {0.0}  # without a start there is nothing to correct
    assert shown["e2"][1][-1] < -0.9 * 5e4 / 5e5 * shown["t"][1][-1]


# ---- seekers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0, 1, 4])
def test_nothing_gains_more_than_its_bound(late):
    """Seekers on a slope, tick by tick with rationals, from just below a turning plane."""
    p = sliding_seeker.Seeker(F(3), F(1, 2), F(1, 5), F(1, 100), 0, late)
    slope = F(2)
    start = 2 * p.beta * (1 - F(1, 10**6))
    delta, mu, waiting = start, F(0), [0] * late
    for i in range(1, 301):
        waiting.append(1 if delta % (2 * p.beta) <= p.beta else -1)
        move = waiting.pop(0) * p.k * slope * p.T
        mu, delta = mu + move, delta + move - p.rho * p.T
        assert mu <= max(0, sliding_seeker.gained_at_most(p, slope, i * p.T))  # it falls at first
    lagged = sliding_seeker.gained_at_most(p._replace(lag=F(1, 50)), slope, 3)
    hides = 3 * p.k * slope * F(1, 50)
    assert lagged == sliding_seeker.gained_at_most(p, slope, 3) + hides  # what a lag hides at most


def test_starts_of_searched_runs_cover_the_ripple():
    """From one end to the other, in halves of the ripple, no start farther than a quarter."""
    grid = np.linspace(-1, 1, 41)
    starts = np.array([float(s) for s in seeking_kind.STARTS])
    assert abs(grid[:, None] - starts).min(axis=1).max() <= 0.25
    assert abs(starts).max() <= 1


def test_a_slope_without_a_sliding_mode_is_climbed_at_its_mean():
    """The rate that is told is the way of the run over its time."""
    numbers = dict(k=1.0, rho=3.0, beta=0.1, slope=1.0, T=0.01)
    found = seeking_kind._sliding_witness(numbers)
    v, delta = 0.0, 0.05
    for _ in range(round(found.found["run"][0] / 0.01)):
        side = 1 if math.fmod(delta, 0.2) / 0.1 % 2 < 1 else -1
        v, delta = v + 0.01 * side, delta + 0.01 * (side - 3.0)
    assert found.found["mean_rate"][0] * found.found["run"][0] == pytest.approx(v, abs=0.021)
    assert found.trajectory["t"][1][-1] <= found.found["run"][0] + 1e-12


def test_few_digits_promise_less(monkeypatch):
    """A flight says what |th| exceeds: with ten digits less than with many, not more."""
    n = {k: F(v) for k, v in dict(k=20, w=40, w_l=30, w_h=25, curvature=3).items()}
    n |= {"a": F(1, 2), "T": F(1, 100)}
    far = dither_flight.flight(n, F(1, 3), F(1, 50), 40)
    monkeypatch.setattr(dither_flight, "DIGITS", 12)
    near = dither_flight.flight(n, F(1, 3), F(1, 50), 40)
    assert near is not None
    assert 0.9 * far < near < far


@pytest.mark.parametrize(
    ("numbers", "start", "noise", "ticks", "digits"),
    [("16.857146 57.197844 8.115939 4.62389 1.181548 .02175 .013572", "27.170694", ".032478",
      40, 8),
     ("153.640528 968.72287 .819521 1.092347 13.194723 .056163 .090755", "1.355419", ".008871",
      13, 6)],
)  # fmt: skip
def test_a_flight_that_goes_far_is_not_told_too_far(
    monkeypatch, numbers, start, noise, ticks, digits
):
    """What few digits lose grows with v^2: then nothing is said, or less than with many."""
    names = ("k", "w", "w_l", "w_h", "curvature", "a", "T")
    n = dict(zip(names, map(F, numbers.split()), strict=True))
    far = dither_flight.flight(n, F(start), F(noise), ticks)
    monkeypatch.setattr(dither_flight, "DIGITS", digits)
    near = dither_flight.flight(n, F(start), F(noise), ticks)
    assert near is None or near <= far


# ---- laws behind an actuator ---------------------------------------------------------------------


def test_points_outside_a_polygon_are_outside():
    """A circle of half a unit, told by its normals; points in units of 1e-20."""
    levels = [Decimal(500_000)] * len(lagged_maps.NORMALS)
    for size, inside in ((0.4, True), (0.6, False), (1e3, False)):
        hull = [(round(size * 1e20 * math.cos(x)), round(size * 1e20 * math.sin(x)))
                for x in np.linspace(0, 2 * np.pi, 12, endpoint=False)]  # fmt: skip
        assert lagged_maps._all_inside(hull, levels, Decimal(0)) == inside
        assert not lagged_maps._all_inside(hull, levels, Decimal("0.2"))


def test_an_entry_that_is_missing_is_named():
    with pytest.raises(BadInput, match=r"evidence\.ticks is missing"):
        sets({"settled": ["0", "1"], "kept": ["0", "1"]}, 10)
    with pytest.raises(BadInput, match="must hold"):
        read_mapping(3, ("a",), "evidence")


def test_what_cannot_come_down_is_given_up():
    """Falls of 1/10 after 1/5 halve: what is left is 1/10 more, and twice that is waited for."""
    for wanted, vain in ((None, False), (F(85, 100), False), (F(65, 100), True)):
        assert relay_proof._in_vain(F(1, 10), F(1, 5), F(1), wanted) == vain
    assert not relay_proof._in_vain(F(1, 5), F(1, 10), F(1), F(0))  # not slower yet


def test_each_disturbance_of_a_search_is_the_one_it_is_called():
    """Way 5 drives against the actuator in every tick, way 2 and 3 with the side and against it."""
    law = Relay(F(0), F(12), F(1, 1000), F(42, 10000), F(3))
    S, A, sides, D = (x.reshape(50, -1, 24) for x in relay_orbits._runs(law, 0.02, 100, 50))
    assert (D[:, 5] == -np.sign(A[:, 5])).all()
    assert (D[:, 2] == np.sign(S[:, 2])).all()
    assert (D[:, 3] == -sides[:, 3]).all()


# ---- others --------------------------------------------------------------------------------------


def test_a_bound_of_a_start_is_rounded_outwards():
    """A seeker that hears late: V is at least (|start| + swing)/spread, exactly."""
    found = dither_search.find(dither.Loop(0.0295, 0.0557, 0.0716, 0.012566, 0.0), 1.0)
    assert found is not None
    rng = np.random.default_rng(3)
    for start in rng.uniform(0, 1, 20):
        told = replace(found, before=0.0, spread=1e-6, farthest=math.inf).from_start(start)
        assert F(told) >= (F(start) + F(found.swing)) / F(1e-6)
        assert told <= (start + found.swing) / 1e-6 * (1 + 1e-11)


def test_draws_beyond_the_promise_are_refused():
    assert binomial.holds(20_000, 0, F(1, 100), F(1, 10**6))
    with pytest.raises(BadInput, match="at most 20000 draws"):
        binomial.holds(20_001, 0, F(1, 100), F(1, 10**6))


def test_poles_as_fast_as_asked_pass():
    observers.check_poles("it", [-2.0, -5.0], 2.0)
    with pytest.raises(BadInput, match="slower"):
        observers.check_poles("it", [-1.99, -5.0], 2.0)


def test_an_entry_that_stands_twice_is_named(tmp_path):
    path = tmp_path / "c.json"
    path.write_text('{"a": "1", "b": "1", "c": "2", "b": "2"}', encoding="utf-8")
    with pytest.raises(BadInput, match="'b' stands in it twice"):
        safe_json.read(path)


# ---- the function that falls, of a dithering seeker ----------------------------------------------


@pytest.fixture(scope="module")
def dithering():
    """A loop that hears late, and what proves that it comes home."""
    loop = dither.Loop(0.0295, 0.0557, 0.0716, 0.012566, 0.0, 3)
    found = dither_search.find(loop, 1.0)
    assert found is not None
    return loop, found


def proven_anew(loop, proof):
    """Found without what was found before: each test looks at its pieces."""
    return dither.check_proof.__wrapped__(loop, proof)


def test_the_square_of_a_tick_is_the_whole_of_it(dithering, monkeypatch):
    """x+ = x - W q z takes x^2/2 by -W (q x z - q^2 W z^2/2): the form of its matrix."""
    seen, own = [], dither._dominated
    monkeypatch.setattr(dither, "_dominated", lambda P, N, *a: seen.append(N) or own(P, N, *a))
    loop, found = dithering
    proven_anew(loop, found.proof)
    units = found.proof.units
    N = seen[0].mid * units[2]
    for x, z in ((0.3, -0.7), (1.1, 0.4)):
        d = np.array([x / units[0], z / units[1], 0.0])
        taken = (x**2 - (x - loop.W * loop.q * z) ** 2) / (2 * loop.W)
        assert d @ N @ d == pytest.approx(taken, rel=1e-9)
    assert (N == N.T).all()


def test_sums_have_no_higher_waves_than_is_told(dithering, monkeypatch):
    """A largest value between the nodes is bounded by the degree: the waves say which it is."""
    seen, own = [], dither._largest
    monkeypatch.setattr(dither, "_largest", lambda f, n: seen.append((f, n)) or own(f, n))
    loop, found = dithering
    orbit = np.array(found.proof.orbit)
    orbit[:, -2:] += 1e-4  # an orbit whose highest wave is seen
    proven_anew(loop, found.proof._replace(orbit=tuple(map(tuple, orbit))))
    assert len(seen) > 3
    for f, degree in seen:
        waves = abs(np.fft.rfft(f.mid)) / len(f.mid)
        assert waves[degree + 1 :].max() < 1e-13 + 1e-9 * waves.max()


def test_what_is_heard_before_is_rounded_outwards(dithering, monkeypatch):
    """Largest |z| of the orbit over what |z - orbit| is of V, exactly."""
    seen, own = [], dither._largest
    monkeypatch.setattr(dither, "_largest", lambda f, n: seen.append(own(f, n)) or seen[-1])
    found = proven_anew(dithering[0], dithering[1].proof)
    z = [a for a in seen if abs(a / found.spreads[1] / found.before - 1) < 1e-6]
    assert z
    assert all(F(found.before) >= F(a) / F(found.spreads[1]) for a in z)


# ---- sets and runs behind a lag ------------------------------------------------------------------


def behind(T=0.05, lag=0.2, dead=0, push=0.01, noise=0.0, gain=1.0):
    """e' = a + w, a' = (u - a)/lag, u = -gain T e (1 - e^2): the barrier law and its lag."""
    E, c1, c2, scale, left = lag_numbers(lag, T, dead)
    pull = CubicPull(gain * T, 1.0)
    return Lagged(pull, pull, push, noise, left, E, c1, c2, scale)


def test_a_dead_time_is_left_by_a_square_wave():
    """Four ticks of 0.3 s: a push that follows the error keeps inside what a resonance leaves."""
    law = behind(T=0.3, lag=0.0, dead=4, push=0.0931)
    chosen = lagged_runs.outward(lambda i: law, Interval(0.0, 0.0))
    assert chosen is not None
    turns = np.flatnonzero(np.diff(chosen.signs))
    assert len(set(np.diff(turns))) == 1  # of one period, and more than one half of it
    assert turns[0] + 1 == np.diff(turns)[0]


def test_the_move_that_a_dead_time_hides_is_that_of_a_tick():
    """Points of the set, tick by tick: none moves farther, and the bound is not twice too wide."""
    law = behind(T=0.02, dead=2, push=0.002)
    found = lagged_maps.invariant_levels(law, Interval(-0.1, 0.1))
    assert found is not None
    levels, moved = found
    normals = np.array(lagged_maps.NORMALS) / 1e6
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (20_000, 2)) * abs(levels).max() / 1e6
    z, a = points[(points @ normals.T <= levels / 1e6).all(axis=1)].T
    pulls = np.array([float(lagged_maps.signed_pull(law, np.array([x]))[0]) for x in z[:500]])
    moves = law.c1 * a[:500] * law.scale - law.c2 * pulls
    assert 0.7 * moved < abs(moves).max() + law.push <= moved


def test_a_drift_is_replayed_with_all_digits(monkeypatch):
    """What is replayed is the law to 1e-40, not to the 28 digits of a plain decimal."""
    seen = []
    monkeypatch.setattr(
        bounded_error.interval_systems, "replay_drift", lambda given, tick: seen.append(tick)
    )
    n = dict(K1=F(100), T=F(1, 1000), eta_inf=F(7, 1000), delta_l=F(1), delta_u=F(1), W=F(1, 3))
    funnel_kind.ERROR._replay_drift(n, {})
    exact = n["W"] * n["T"] / n["eta_inf"]
    assert abs(F(seen[0].push) / exact - 1) < F(1, 10**40)


def test_a_step_of_the_reference_behind_a_lag():
    """A small step is held, and the file of the proof passes its check."""
    numbers = dict(K1=100, T=F(1, 1000), eta_inf=F(5, 1000), delta_l=F(6, 5), delta_u=F(6, 5),
                   W=F(1, 20), lag=F(5, 1000), step=F(1, 1000))  # fmt: skip
    payload = proofs.write(SYSTEMS["prescribed_performance"], {k: F(v) for k, v in numbers.items()})
    assert payload["verdict"] == CERTIFIED
    assert CERTIFIED in certificate.check(payload)


# ---- what a promise says -------------------------------------------------------------------------


def test_what_is_not_promised_is_said():
    assert "r1" in certify("super_twisting", k1=2, k2=3, L=1).decision.promise.not_promised
    assert set(SYSTEMS["reaching_law"].clauses({"band": F(1)})) == {"band"}
    assert "ends" in SYSTEMS["reaching_law"].clauses({})


def test_a_period_that_starts_elsewhere_is_refused():
    """A run that refutes a band starts where its period does, to a millionth in s."""
    numbers = {k: F(v) for k, v in dict(g1=36, g2=12, T=".001", lag=".0042", D=3).items()}
    numbers["band"] = F(1, 1000)
    found = relay_proof._find_orbit(numbers)
    assert found is not None
    relay_proof._replay(numbers, found)
    told = F(found["start"]["s"])
    wrong = found | {"start": found["start"] | {"s": str(told * (1 + F(1, 10**4)))}}
    with pytest.raises(DoesNotHold, match="does not start"):
        relay_proof._replay(numbers, wrong)


def test_slopes_of_the_dithered_seeker_are_those_of_its_field():
    """x' = -q z, z' = l (S H - z), e' = h H + q x z - q^2 W z^2 / 2, H = x S1 + S2 / 2 - e."""
    loop, angles = dither.Loop(0.3, 0.5, 0.7, 0.2, 0.0), np.array([0.3, 2.0, 4.5])
    S1, S2 = dither_search._heard(loop, angles)
    q, l, h, W = loop[:4]

    def field(at):
        x, z, e = at
        S, H = np.sin(angles), x * S1 + S2 / 2 - e
        return np.stack([-q * z, l * (S * H - z), h * H + q * x * z - q**2 * W / 2 * z**2])

    at = np.array([[0.2, -0.4, 1.1], [0.9, 0.8, -0.5], [0.1, -0.3, 0.6]])
    found = dither_search._jacobians(loop, angles, at)
    for j in range(3):
        step = np.zeros((3, 1))
        step[j] = 1e-3  # squares: central differences are exact
        slope = (field(at + step) - field(at - step)) / 2e-3
        np.testing.assert_allclose(found[:, :, j].T, slope, atol=1e-11)


def test_a_run_that_does_not_come_back_has_no_period():
    turns = np.sin(np.arange(41) * np.pi / 4)
    assert relay_orbits._period(turns, np.cos(np.arange(41) * np.pi / 4), 20) == 8
    assert relay_orbits._period(np.arange(1.0, 42.0), np.arange(1.0, 42.0), 20) == 0


def test_the_smallest_polygon_in_whole_numbers_has_its_faces():
    """Corners (1, 0), (0, 1) and their mirror images: |s| + |a| <= 1, each side of size 1."""
    law = Relay(*[F(1)] * len(dataclasses.fields(Relay)))
    corners = ((F(1), F(0)), (F(0), F(1)), (F(-1), F(0)), (F(0), F(-1)))
    assert relay_sets.Absorbing(law, corners)._faces() == [
        (1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1)]  # fmt: skip
    assert relay_sets.Absorbing(law, corners[::-1])._faces() is None  # clockwise


def test_a_run_below_the_band_refutes_nothing():
    """A disturbance of 0 leaves the law at rest."""
    n = {"k1": F(5), "k2": F(3), "L": F(1), "T": F(1, 100), "band": F(1, 1000)}
    run = {"start": {"x1": "0", "x2": "0"}, "d": ["0", "0", "0"]}
    with pytest.raises(DoesNotHold, match="does not exceed the band"):
        twisting_proof._replay(n, run)
    with pytest.raises(DoesNotHold, match=r"or \|d\| exceeds L"):
        twisting_proof._replay(n, run | {"d": ["1000"]})


def test_bounds_in_words_have_six_digits_and_are_not_below():
    for value, shown in ((F(123456789, 1000), 123457), (F(123456789, 10**11), F(123457, 10**8)),
                         (F(1, 3), F(333334, 10**6)), (F(-2), 0)):  # fmt: skip
        assert rounded_up(value) == shown


def test_a_ball_of_a_rational_holds_it():
    for value in (F(0), F(1, 3), F(-2, 7), F(1, 10**320), F(10**20 + 1, 3)):
        ball = Ball.of(value)
        assert F(float(ball.mid)) - F(float(ball.rad)) <= value
        assert value <= F(float(ball.mid)) + F(float(ball.rad))


def test_the_loss_of_a_dither_is_the_mean_of_a_parabola():
    """mu'' x^2/2 over x = a sin phi."""
    x = 0.2 * np.sin(np.linspace(0, 2 * np.pi, 1000, endpoint=False))
    assert extremum.perturbation_loss(0.2, -3.0) == pytest.approx(np.mean(3.0 * x**2 / 2))


def test_without_enough_gain_the_exact_criterion_refutes():
    gains = {"k1": F(3), "k2": F(4), "L": F(1), "delta": F(0)}
    assert exact_verdict(gains) == CERTIFIED
    assert exact_verdict(gains | {"k2": F(1)}) == REFUTED
    assert exact_verdict(gains | {"delta": F(3)}) == REFUTED


def test_without_a_disturbance_the_worst_swing_is_the_orbit():
    """((k1 + root(k1^2 - 4 k2))/4)^2 T^2 where that root is real."""
    found = super_twisting.explicit_swing_map([3.0, 1.0], [1.0, 1.0], L=0.0, T=1e-3)
    assert found == pytest.approx([((3 + math.sqrt(5)) / 4) ** 2 * 1e-6, 0.0])


@pytest.mark.parametrize("x", [1e-6, 9.9e-4, 1.1e-3, 0.5])
def test_a_held_lag_is_that_of_its_closed_form(x):
    """b1 = T - lag (1 - E) and b0 = lag (1 - E) - T E, with 60 digits."""
    T, lag = Decimal("0.01"), Decimal("0.01") / Decimal(repr(x))
    with localcontext(Context(prec=60)):
        E = (-T / lag).exp()
        wanted = [float(v) for v in (1 - E, T - lag * (1 - E), lag * (1 - E) - T * E)]
    assert linear_kind.loop_coefficients(float(lag), 0.01) == pytest.approx(wanted, rel=1e-9)


def test_the_least_eigenvalue_is_guessed_from_below():
    rng = np.random.default_rng(5)
    A = rng.normal(size=(3, 3, 40))
    A = A + A.transpose(1, 0, 2)
    least = np.array([np.linalg.eigvalsh(A[:, :, k])[0] for k in range(40)])
    found = np.array([dither._least(A[:, :, k : k + 1]) for k in range(40)])
    assert np.all(found <= least)
    assert found == pytest.approx(least, abs=1e-5)


def test_a_sum_is_hardly_larger_than_at_its_nodes():
    angles = 2 * np.pi * np.arange(dither.NODES) / dither.NODES
    values = 1 + 2 * np.cos(5 * (angles - 0.0003))
    most = dither._most(Ball.of(values), 5)
    assert 3 <= most < 3.001


@pytest.mark.parametrize("E", [0.0, 0.3, 0.8])
def test_what_a_lag_makes_of_the_square_of_a_sine(E):
    """(1 - E)/(1 - E exp(-i n W)) of the n-th harmonic of (th + a sin phi)^2."""
    D, th, a, W, phi = 10**30, 0.7, 0.4, 0.3, 1.1

    def whole(v):
        return int(F(v) * D)

    turn, at = ((whole(math.cos(v)), whole(math.sin(v))) for v in (W, phi))
    found = dither_flight._rest(whole(th), whole(a), whole(E), turn, at, D)
    gains = [(1 - E) / (1 - E * np.exp(-1j * n * W)) for n in (1, 2)]
    one = 2 * th * a * (gains[0] * np.exp(1j * phi)).imag
    two = -(a**2) / 2 * (gains[1] * np.exp(2j * phi)).real
    assert found is not None
    assert found[0] / D == pytest.approx(th**2 + a**2 / 2 + one + two, rel=1e-12)


def test_signs_of_a_noise_that_are_none_are_refused():
    numbers = {"k": F("0.941"), "w": F("1.385"), "w_l": F("0.1262"), "w_h": F("0.148"),
               "a": F("0.2151"), "curvature": F("-0.6474"), "T": F("0.1815"),
               "noise": F("0.0002355"), "start": F("0.04556"), "rest": F("0.001908")}  # fmt: skip
    system = SYSTEMS["perturbation_seek"]
    payload = proofs.write(system, numbers)
    assert payload["counterexample"]["by"] == "pushed"
    assert payload["verdict"] == REFUTED
    run = {k: v for k, v in payload["counterexample"]["run"].items() if k != "seal"}
    for noise in (5, run["noise"] + "x", "+" * (dither_push.MOST_TICKS + 1)):
        with pytest.raises(BadInput, match=r"must hold \+ and -, at most"):
            dithering_kind._replay_pushed(numbers, with_checksum(numbers, run | {"noise": noise}))


def test_a_relay_that_takes_too_large_steps_has_no_orbit_of_two_ticks():
    """Below T g1 = 2 it swings by T g2/(2 - T g1), and from there on it grows without end."""
    for g1, T in ((100.0, 0.02), (100.0, 0.03), (2.0, 1.0)):
        assert reaching_law.chatter(g1, 5.0, T) == math.inf
    for g1, T in ((99.0, 0.02), (0.0, 0.1), (1.9, 1.0)):
        s = reaching_law.chatter(g1, 5.0, T)
        assert s - T * (g1 * s + 5.0) == pytest.approx(-s)
