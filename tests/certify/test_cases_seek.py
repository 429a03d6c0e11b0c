"""Seekers and estimators: what was CERTIFIED and did not hold, and what holds now, by own runs."""

from __future__ import annotations

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.certify import certificate, proofs
from slipctl.certify.bounds import filters
from slipctl.certify.catalogue import certify, system
from slipctl.certify.systems import CERTIFIED, REFUTED, UNDECIDED
from slipctl.models.cheng_2022.certificate import dither, dither_flight, sliding_seeker
from slipctl.models.cheng_2022.certificate.ball import Ball
from slipctl.models.cheng_2022.certificate.dither_search import find
from slipctl.models.huang_2020.certificate import rls_covariance
from slipctl.models.zhang_2021.certificate import chi_squared

F = Fraction
SLIDING = dict(k=1, rho=F("0.1"), beta=F("0.02"), slope=F("0.66"))
FINE = SLIDING | dict(T=F("2e-4"))
DITHER = dict(k=20, w=12.566, w_l=0.7, w_h=0.9, a=0.1, curvature=-0.18544)
FILTER = dict(gamma=0.23, R=1e-4, H=0.007)


def verdict(name, **numbers):
    """Verdict, after its certificate was written, read and checked."""
    payload = json.loads(json.dumps(proofs.write(system(name), numbers)))
    assert payload["verdict"] in certificate.check(payload)
    return payload["verdict"]


# ---- case 4: sliding_seek ------------------------------------------------------------------------


def test_a_tick_that_jumps_over_the_plane_is_refuted():
    """mu falls by 0.47 per s where it should climb by 0.1 per s."""
    assert verdict("sliding_seek", **SLIDING, T=F("0.05")) == REFUTED
    v = g = 0.0
    for _ in range(2000):
        s = 1 if math.sin(math.pi * (0.66 * v - g) / 0.02) >= 0 else -1
        v, g = v + 0.05 * s, g + 0.005
    assert 0.66 * v / (2000 * 0.05) < -0.4


@pytest.mark.parametrize(("asked", "wanted"), [
    (dict(ripple=F("0.1")), REFUTED), (dict(ripple=F("0.1"), curvature=-0.18544), REFUTED),
    (dict(ripple=F("0.21"), curvature=-0.18544), CERTIFIED),
    (dict(gap=F("0.1"), time=F("1.1")), REFUTED), (dict(gap=F("0.1"), time=F("1.25")), CERTIFIED),
    (dict(ripple=F("0.1"), gap=F("0.1"), time=2), REFUTED),
    (dict(noise=F("0.0005"), dead_time=F("0.001"), ripple=F("0.28"), curvature=-0.18544),
     CERTIFIED),
    (dict(noise=F("0.012")), REFUTED), (dict(dead_time=F("0.1")), REFUTED),
])  # fmt: skip
def test_what_is_asked_of_a_seeker_blocks(asked, wanted):
    """Ripple and time, noise beyond half a cell, a dead time of several cells."""
    assert verdict("sliding_seek", **FINE, **asked) == wanted


@pytest.mark.second
def test_a_plane_is_lost_just_beyond_its_travel_and_kept_just_inside():
    """Of the bound (n + 1)(k mu' + rho) T + 2 N <= beta, by runs from many starts."""
    rng = np.random.default_rng(1)
    for late, noise in ((0, 0.0), (3, 0.0), (0, 2e-3), (2, 1e-3)):
        T = (0.02 - 2 * noise) / ((late + 1) * 0.76)
        for factor, kept in ((0.99, True), (1.01, False)):
            p = sliding_seeker.Seeker(1.0, 0.1, 0.02, T * factor, noise, late)
            assert (sliding_seeker.travel(p, 0.66) <= 0.02) == kept
            delta, lost = rng.uniform(0, 0.04, 4000), np.zeros(4000, bool)
            cell, store = np.floor(delta / 0.04), [np.zeros(4000)] * late
            for _ in range(400):
                heard = delta - noise  # the sign - wherever the noise can make it
                up = (np.mod(heard, 0.04) <= 0.02) & (np.mod(delta + noise, 0.04) <= 0.02)
                store = [*store, np.where(up, 1.0, -1.0)]
                delta = delta + T * factor * (0.66 * store.pop(0) - 0.1)
                inside = np.mod(delta, 0.04)
                settled = (inside > noise) & (inside < 0.04 - noise)
                lost |= settled & (np.floor(delta / 0.04) < cell - 1)
            assert not (kept and lost.any())
            if not kept and not noise:
                assert lost.any() or late == 0


@pytest.mark.second
def test_ripple_on_a_parabola_stays_inside_its_bound():
    """Runs with random noise and delays end within the bound, and fill half of it at least."""
    rng = np.random.default_rng(2)
    for late, noise in ((0, 0.0), (2, 0.0), (0, 4e-4), (1, 2e-4)):
        p = sliding_seeker.Seeker(1.0, 0.1, 0.02, 1e-3, noise, late)
        assert all(a <= b for _, a, b in sliding_seeker.ripple_sides(p, -0.18544))
        x = rng.uniform(-0.5, 0.5, 64)
        g, store = -0.09272 * x * x - rng.uniform(0, 0.04, 64), []
        low, high = np.full(64, np.inf), np.full(64, -np.inf)
        for i in range(12_000):
            store = [*store[-late - 1 :], x] if late else [x]
            y = -0.09272 * store[0] ** 2 + noise * rng.choice([-1, 1], 64)
            x = x + 1e-3 * np.where(np.sin(np.pi * (y - g) / 0.02) >= 0, 1, -1)
            g = g + 1e-4
            if i > 6000:
                low, high = np.minimum(low, x), np.maximum(high, x)
        bound = sliding_seeker.ripple(p, -0.18544)
        assert 0.5 * bound < (high - low).max() < bound


def test_what_a_start_swings_through_is_not_what_it_ends_in():
    """From its start v swings by 42 m/s, in the end by 34: a ripple of 39.45 is not refuted."""
    wide = dict(k=3.557, rho=0.07098, beta=0.6241, slope=0.0395, T=0.2812, curvature=-0.0001487)
    v, mu, low, high = -15.64, 0.0, [], []
    g = -wide["beta"] / 2 - 0.0001487 / 2 * v * v
    for i in range(20_000):
        mu = -0.0001487 / 2 * v * v
        up = (mu - g) % (2 * wide["beta"]) <= wide["beta"]
        v, g = v + 3.557 * 0.2812 * (1 if up else -1), g + 0.07098 * 0.2812
        (low if i < 300 else high).append(v)
    assert max(high[-4000:]) - min(high[-4000:]) < 35
    assert verdict("sliding_seek", **wide, ripple=39.45) == UNDECIDED
    assert verdict("sliding_seek", **wide, ripple=60) == CERTIFIED
    assert verdict("sliding_seek", **wide, ripple=29) == REFUTED


# ---- case 5: perturbation_seek -------------------------------------------------------------------


def test_a_seeker_that_diverges_is_refuted_though_its_average_is_stable():
    fast = dict(k=314, w=1, w_l=0.525, w_h=0.618, a=1, curvature=-1)
    found = certify("perturbation_seek", **fast)
    assert found.verdict == verdict("perturbation_seek", **fast) == REFUTED
    assert found.values["slow_pole"][0] < 0


def _walk(n, start, ticks, noise=0.0, seed=0):
    """th - v* at each tick of the seeker on its parabola."""
    rng, th, xi, c, T = np.random.default_rng(seed), start, 0.0, n["curvature"] / 2, 1e-3
    eta, out = c * th * th, []
    for i in range(ticks):
        s = math.sin(n["w"] * T * i)
        high = c * (th + n["a"] * s) ** 2 + noise * rng.choice([-1, 1]) - eta
        th, xi, eta = (th + T * n["k"] * xi, xi + T * n["w_l"] * (high * s - xi),
                       eta + T * n["w_h"] * high)  # fmt: skip
        out.append(th)
    return np.array(out)


@pytest.mark.second
def test_reach_and_rest_are_those_of_runs():
    """The proven rest is that of the orbit to 0.1 %, the reach at most a tenth above a run's."""
    loop = dither.Loop(20 * 0.18544 * 0.1 / 12.566, 0.7 / 12.566, 0.9 / 12.566, 0.012566, 0.0)
    found = find(loop, 1.0)
    run = _walk(DITHER, 0.1, 60_000)
    assert abs(run[-2000:]).max() / 0.1 == pytest.approx(found.rest(), rel=1e-3)
    assert abs(run).max() / 0.1 < found.reach(1.0) < 1.1 * abs(run).max() / 0.1
    assert abs(_walk(DITHER, 0.1, 30_000, 1e-5)).max() < 0.1244
    assert verdict("perturbation_seek", **DITHER, reach=0.12, rest=3e-5) == CERTIFIED
    assert verdict("perturbation_seek", **DITHER, rest=2.2e-5) == REFUTED
    assert verdict("perturbation_seek", **DITHER, reach=0.09) == REFUTED
    assert verdict("perturbation_seek", **DITHER, noise=1e-5, rest=4e-3) == CERTIFIED


def _late_walk(n, start, ticks, outward=0.0):
    """th - v* with a dead time and a lag of the measurement; the dither alone runs before."""
    T, c, w, a = 1e-3, n["curvature"] / 2, n["w"], n["a"]
    late, E = round(n["dead_time"] / T), math.exp(-T / n["lag"])
    places = [start + a * math.sin(w * T * i) for i in range(-3000, 0)]
    heard, th, xi, eta, out = c * start * start, start, 0.0, c * start * start, []
    for v in places[: 3000 - late]:
        heard = E * heard + (1 - E) * c * v * v
    for i in range(ticks):
        s = math.sin(w * T * i)
        places.append(th + a * s)
        heard = E * heard + (1 - E) * c * places[-1 - late] ** 2
        high = heard + math.copysign(outward, s * start) - eta
        th, xi, eta = (th + T * n["k"] * xi, xi + T * n["w_l"] * (high * s - xi),
                       eta + T * n["w_h"] * high)  # fmt: skip
        out.append(th)
    return np.array(out)


@pytest.mark.second
@pytest.mark.parametrize("start", [0.1, -0.1])
def test_what_is_heard_late_counts(start):
    """Dead time and lag, together with noise: what is proved is not left by a run of the test's."""
    late = DITHER | dict(dead_time=0.02, lag=0.01, noise=1e-6)
    found = certify("perturbation_seek", **late)
    assert found.verdict == CERTIFIED
    assert {"a dead time", "a lag"}.isdisjoint(found.decision.promise.not_promised)
    reach, rest = (float(found.decision.promise.claims[k].split()[-2]) for k in ("reach", "rest"))
    run = abs(_late_walk(late, start, 40_000, 1e-6))
    assert 0.5 * reach < run.max() < reach
    assert run[-4000:].max() < rest
    assert verdict("perturbation_seek", **late, reach=0.095) == REFUTED


def test_a_seeker_that_hears_half_a_period_late_is_refuted():
    half = DITHER | dict(dead_time=0.25, lag=0.05, T=0.01)
    assert verdict("perturbation_seek", **half) == REFUTED
    assert "a dead time" in certify("perturbation_seek", **DITHER).decision.promise.not_promised


@pytest.mark.second
@pytest.mark.parametrize("heard", [{}, {"dead_time": 0.01}, {"lag": 0.02}])
def test_rest_with_noise_lies_between_a_run_and_its_bound(heard):
    """The bound for which it is CERTIFIED, and what the noise of the counterexample comes to."""
    told = DITHER | heard | {"noise": 1e-6}
    claim = certify("perturbation_seek", **told).decision.promise.claims["rest"]
    bound = float(claim.split()[-2])
    assert verdict("perturbation_seek", **told, rest=bound * 1.001) == CERTIFIED
    quiet = certify("perturbation_seek", **DITHER, **heard).decision.promise.claims["rest"]
    between = float(quiet.split()[-2]) * 1.001  # the orbit alone does not come to it
    assert between < bound
    found = certify("perturbation_seek", **told, rest=between)
    assert found.verdict == REFUTED
    assert found.decision.counterexample["by"] == "pushed"


def test_a_proof_for_another_loop_proves_nothing():
    """The function of one gain does not fall for one that is 30 times larger, or that flees."""
    loop = dither.Loop(0.0295, 0.0557, 0.0716, 0.012566, 0.0)
    found = find(loop, 1.0)
    assert dither.check_proof(loop, found.proof) is not None
    assert dither.check_proof(loop._replace(q=0.9), found.proof) is None
    assert dither.check_proof(loop._replace(q=-0.0295), found.proof) is None
    assert dither.check_proof(loop._replace(W=0.6), found.proof) is None


def test_a_function_does_not_fall_faster_than_it_does():
    """M >= 2 mu P with the best mu of a search: of a larger one it is false, however it is said."""
    loop = dither.Loop(0.0295, 0.0557, 0.0716, 0.012566, 0.0)
    proof = find(loop, 1.0).proof
    for factor in (2, 5, 20):
        assert dither.check_proof(loop, proof._replace(mu=factor * proof.mu)) is None
    assert dither.check_proof(loop, proof._replace(mu=0.9 * proof.mu)) is not None


def test_the_function_falls_at_random_states():
    """V along one tick of the equations in their first form, against the proven inequality."""
    loop = dither.Loop(0.0295, 0.0557, 0.0716, 0.1, 0.0)
    found = find(loop, 1.0)
    rng = np.random.default_rng(5)
    phi = rng.uniform(0, 2 * np.pi, 5000)
    d = rng.normal(size=(3, 5000)) * 10 ** rng.uniform(-2, 0.5, 5000)
    units = np.array(found.proof.units)[:, None]

    def at(sums, angle):
        return np.array(sums) @ dither.basis_at(angle, 8)

    def V(d, angle):
        P = at(found.proof.P, angle)
        a, b, c = d / units
        return np.sqrt(P[0] * a * a + P[3] * b * b + P[5] * c * c
                       + 2 * (P[1] * a * b + P[2] * a * c + P[4] * b * c))  # fmt: skip

    x, z, e = at(found.proof.orbit, phi) + d
    S, W = np.sin(phi), 0.1
    eta, y = e + x * x / 2, (x + S) ** 2 / 2  # eta and y over c a^2
    x1, z1 = x - W * 0.0295 * z, z + W * 0.0557 * ((y - eta) * S - z)
    e1 = eta + W * 0.0716 * (y - eta) - x1 * x1 / 2
    new = V(np.array([x1, z1, e1]) - at(found.proof.orbit, phi + W), phi + W)
    old = V(d, phi)
    bound = (1 - W * found.mu) * old + W * (found.alpha * old**2 + found.rho)
    assert (new <= bound * (1 + 1e-12)).all()
    near = old < found.farthest * 0.9
    assert near.sum() > 500
    assert (new < old)[near & (old > 2 * found.last)].all()


def test_balls_hold_what_they_compute():
    """Sums, products, quotients, roots and matrix products of rationals, against fractions."""
    rng = np.random.default_rng(1)
    a = [F(int(v), 997) for v in rng.integers(1, 10**6, 60)]
    b = [F(int(v), 991) for v in rng.integers(1, 10**6, 60)]
    A = Ball.near([float(v) for v in a], 1e-9)
    B = Ball.near([float(v) for v in b], 1e-12)
    for found, exact in (
        (A + B, [x + y for x, y in zip(a, b, strict=True)]),
        (A - B, [x - y for x, y in zip(a, b, strict=True)]),
        (A * B, [x * y for x, y in zip(a, b, strict=True)]),
        (A.over(B), [x / y for x, y in zip(a, b, strict=True)]),
        (A.dot(B)[None], [sum(x * y for x, y in zip(a, b, strict=True))]),
    ):
        low, high = np.atleast_1d(found.low()), np.atleast_1d(found.high())
        assert all(F(p) <= v <= F(q) for p, v, q in zip(low, exact, high, strict=True))
        assert (high - low < 1e-3 * abs(high)).all()
    root = A.sqrt()
    assert all(F(p) ** 2 <= v <= F(q) ** 2
               for p, v, q in zip(root.low(), a, root.high(), strict=True))  # fmt: skip


def test_flight_is_the_run():
    n = {k: F(str(v)) for k, v in (DITHER | dict(T=1e-3, k=-20)).items()}
    far = dither_flight.flight(n, F(1, 10), F(0), 15_000)
    assert far == pytest.approx(abs(_walk(DITHER | dict(k=-20), 0.1, 15_000)[-1]), rel=1e-9)


# ---- case 6: rls ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("numbers", "wanted"), [
    (dict(forgetting=1, P=10, limit=1), REFUTED), (dict(forgetting=1, P=10, limit=10), CERTIFIED),
    (dict(forgetting=0.98), REFUTED), (dict(forgetting=0.98, least=0), REFUTED),
    (dict(forgetting=0.98, idle=1000), CERTIFIED), (dict(forgetting=0.98, idle=5000), REFUTED),
    (dict(forgetting=0.98, least=0.01, limit=172), CERTIFIED),
    (dict(forgetting=0.98, least=0.01, limit=170), REFUTED),
    (dict(forgetting=0.98, least=1, samples=100000), REFUTED),
])  # fmt: skip
def test_covariance(numbers, wanted):
    assert verdict("rls", **numbers) == wanted
    assert set(proofs.write(system("rls"), numbers)["asked"]) >= {"P", "limit", "forgetting"}


def test_a_start_beyond_the_limit_needs_no_run():
    """Without forgetting P never grows: it exceeds the limit in sample 0 or never."""
    numbers = dict(forgetting=1, P=10, limit=1)
    entries = proofs.write(system("rls"), numbers)
    assert "from the start" in proofs.check(system("rls"), entries)
    run = entries["counterexample"]["run"]
    assert run["windows"] == run["quiet"] == 0


def test_largest_covariance_is_reached_and_not_passed():
    """One pulse a window of 50, seen just before the next; then a pause, and a late first pulse."""
    lam, S, least, idle = 0.98, 50, 0.01, 30
    P = 1.0
    for _ in range(40):
        P = 1 / (lam / P + least)
        P /= lam ** (S - 1)
    top = P / lam ** (idle + S - 1)
    n = dict(forgetting=lam, P=1.0, least=least, samples=S, idle=idle)
    for factor, holds in ((1 - 1e-6, False), (1 + 1e-6, True)):
        sides = rls_covariance.largest_sides(n | dict(limit=top * factor))
        assert all(a <= b for _, a, b in sides) == holds


def test_a_forgetting_factor_above_one_is_refused():
    with pytest.raises(BadInput, match="must be above 0 and at most 1"):
        certify("rls", forgetting=1.1)
    with pytest.raises(BadInput, match="must be a whole number"):
        certify("rls", forgetting=0.9, samples=2.5)
    with pytest.raises(BadInput, match="must not exceed most"):
        certify("rls", forgetting=0.9, least=2)


# ---- case 7: filter ------------------------------------------------------------------------------


@pytest.mark.parametrize(("numbers", "wanted"), [
    (dict(dt=1, share=0.5, time=0.5), REFUTED), (dict(dt=1, share=0.5, time=1), CERTIFIED),
    (dict(q=1e12), REFUTED), (dict(q=filters.matched_drift(0.23, 1e-4, 0.007, 1e-3)), CERTIFIED),
    (dict(q=0), REFUTED),
])  # fmt: skip
def test_filter(numbers, wanted):
    """In half a period no sample has come; a variance for one drift is true for that one only."""
    assert verdict("filter", **FILTER, **numbers) == wanted


@pytest.mark.parametrize("ticks", [1.999, 2, 2.001, 2.999, 3])
def test_time_counts_whole_samples(ticks):
    """Against the recursion, sample by sample."""
    P, e = 4e6, 1.0
    for _ in range(int(ticks)):
        before = 1.23 * P
        K = before * 0.007 / (0.007**2 * before + 1e-4)
        P, e = (1 - K * 0.007) * before, e * (1 - K * 0.007)
    for share, wanted in ((e * 1.001, CERTIFIED), (e * 0.999, REFUTED)):
        assert verdict("filter", **FILTER, dt=1, share=share, time=F(str(ticks))) == wanted


def test_a_period_that_is_altered_in_the_file_fails():
    payload = proofs.write(system("filter"), dict(FILTER))
    payload["asked"]["dt"]["value"] = "0"
    with pytest.raises(certificate.DoesNotHold):
        certificate.check(payload)


@pytest.mark.parametrize("freedom", [1, 2, 7, 100, 1001, 30_000])
def test_chi_squared_is_enclosed(freedom):
    """Against scipy, to its own 1e-9; far out and for many degrees only as a bound."""
    from scipy.stats import chi2

    for share in (1e-9, 0.025, 0.5, 0.975, 1 - 1e-9):
        value = float(chi2.ppf(share, freedom))
        low, high = (float(x) for x in chi_squared.probability_below(F(value), freedom).ends())
        assert low - 1e-9 * share <= share <= high + 1e-9 * share
        assert high - low < 1e-12 or freedom > 20_000 or not 0.01 < share < 0.99


# ---- case 12: no traceback -----------------------------------------------------------------------


@pytest.mark.parametrize(("name", "numbers"), [
    ("adhesion_observer", dict(K1=98.5, K2=4400, K3=0, L=1e30)),
    ("adhesion_observer", dict(K1=1e30, K2=1.5, K3=0.5, L=0.5)),
    ("higher_order", dict(k4=1, alpha=1, beta=1e30, eta=1)),
    ("rls", dict(forgetting=0.98, least=1, samples=100000)),
    ("sliding_seek", FINE | dict(dead_time=1e30)),
    ("perturbation_seek", DITHER | dict(T=1e30)),
    ("filter", FILTER | dict(q=1e30, band_samples=10**15)),
])  # fmt: skip
def test_far_out_numbers_give_a_verdict(name, numbers):
    found = certify(name, **numbers)
    assert found.verdict in (CERTIFIED, REFUTED, UNDECIDED)
    assert json.dumps(found.payload(), default=str)


@pytest.mark.parametrize(("numbers", "said"), [
    (dict(curvature=0), "curvature = 0 is a flat top"), (dict(gap=1), "gap asks for nothing"),
    (dict(least=1), "least = 1 s/m must not exceed"),
])  # fmt: skip
def test_a_seeker_that_means_nothing_is_refused(numbers, said):
    with pytest.raises(BadInput, match=said):
        certify("sliding_seek", **FINE, **numbers)
