"""Bounds of prescribed performance: each is simulated just inside (0.99) and just outside (1.01).

The laws are simulated in the paper's letters, so that the reduction to one share z is tested too.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.models.zhang_2021.certificate import prescribed_performance as pp

K1, ETA, D = 100.0, 0.005, 1.2  # Zhang 2021, Table 3: gain, eta_inf, both widths
ETA_0, DECAY = 0.1, 30.0
R, I_W, M, N_W, G = 0.43, 60.35, 13800.0, 4.0, 9.81
RAILS = {
    "dry": (0.3266569, 0.1810268),
    "snow": (0.1382094, 0.1229218),
    "wet": (0.2279134, 0.1556029),
}
LIMIT = pp.largest_disturbance(K1, ETA, D, D)


def pull(e, eta, lower, upper, gain, law="funnel"):
    """Pull of the law in the paper's letters, (12)-(17) with the plus sign: K1 eps/l."""
    zeta = e / eta
    inside = (zeta > -lower) & (zeta < upper)
    z = np.where(inside, zeta, 0.0)
    eps = 0.5 * np.log((z + lower) / (upper - z))
    slope = (1 / (z + lower) + 1 / (upper - z)) / (2 * eta)
    found = gain * eps / slope if law == "funnel" else gain * eps * eta * (lower + upper) / 2
    return np.where(inside, found, np.nan)


def run(w, e=0.0, *, lower=D, upper=D, gain=K1, eta_0=ETA, eta_inf=ETA, decay=0.0, law="funnel",
        end=90.0, step=0.02):  # fmt: skip
    """Continuous loop by RK4 for an array of disturbances; times in 1/gain.

    Returns the last errors and the times of escape in s, inf for none.
    """
    w = np.atleast_1d(np.asarray(w, dtype=float))
    e = np.full(w.shape, float(e)) if np.ndim(e) == 0 else np.array(e, dtype=float)
    h = step / gain
    left = np.full(w.shape, np.inf)

    def rhs(t, e):
        eta = (eta_0 - eta_inf) * np.exp(-decay * t) + eta_inf
        slope = -decay * (eta_0 - eta_inf) * np.exp(-decay * t)
        return -pull(e, eta, lower, upper, gain, law) + e * slope / eta + w

    for k in range(round(end / step)):
        t = k * h
        k1 = rhs(t, e)
        k2 = rhs(t + h / 2, e + h / 2 * k1)
        k3 = rhs(t + h / 2, e + h / 2 * k2)
        k4 = rhs(t + h, e + h * k3)
        new = e + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        left = np.where(np.isnan(new) & np.isinf(left), t, left)
        e = np.where(np.isnan(new), e, new)
        e = np.where(np.isinf(left), e, np.nan)
        if np.isfinite(left).all():
            break
    return e, left


# ---- continuous time ----------------------------------------------------------------------------


def test_constants_solve_their_equations():
    """Peak of h at 2 eps tanh eps = 1; 1/INVARIANT is W(1/e). 1e-15 is double rounding."""
    eps = math.atanh(pp.Z_PEAK)
    assert 2 * eps * math.tanh(eps) == pytest.approx(1, abs=1e-14)
    z = np.linspace(0, 0.999999, 200_001)
    assert ((1 - z**2) * np.arctanh(z)).max() == pytest.approx(pp.H_MAX, abs=1e-10)
    assert pp.restoring_pull(pp.Z_PEAK) == pytest.approx(pp.H_MAX, abs=1e-15)
    w = 1 / pp.INVARIANT
    assert w * math.exp(w) == pytest.approx(math.exp(-1), abs=1e-15)
    assert round(pp.H_MAX, 10) == 0.4477432047
    assert round(pp.INVARIANT, 10) == 3.5911214767


@pytest.mark.second
def test_largest_disturbance():
    """0.99 of it is held for ever, 1.01 escapes, either way; the settled share is as predicted."""
    share = np.array([0.9, 0.99, 1.01, 1.1])
    for sign in (1, -1):
        e, left = run(sign * share * LIMIT)
        assert np.isinf(left[:2]).all()
        assert np.isfinite(left[2:]).all()
        predicted = [pp.settled_share(q * pp.H_MAX) for q in share[:2]]
        np.testing.assert_allclose(sign * e[:2] / (D * ETA), predicted, atol=1e-6)
    assert pp.settled_share(0.9 * pp.H_MAX) == pytest.approx(0.480967, abs=5e-7)
    assert pp.settled_share(0.99 * pp.H_MAX) == pytest.approx(0.597969, abs=5e-7)


def test_largest_disturbance_with_any_widths():
    """The bound is the mean half-width's, and the law pulls to the middle, not to zero."""
    rng = np.random.default_rng(0)
    lower, upper = rng.uniform(0.3, 3, (2, 200))
    eta, gain = 10 ** rng.uniform(-3, 0, 200), 10 ** rng.uniform(0, 3, 200)
    W = pp.largest_disturbance(gain, eta, lower, upper)
    factor = np.repeat([0.0, 0.99, -0.99, 1.01, -1.01], 40)
    middle = eta * (upper - lower) / 2
    e, left = run(factor * W, e=middle, lower=lower, upper=upper, gain=gain,
                  eta_0=eta, eta_inf=eta)  # fmt: skip
    assert (np.isfinite(left) == (np.abs(factor) > 1)).all()
    np.testing.assert_allclose((e / eta)[:40], (middle / eta)[:40], atol=1e-9)
    z = pp.share(e[40:120], eta[40:120], lower[40:120], upper[40:120])
    np.testing.assert_allclose(np.abs(z), pp.settled_share(0.99 * pp.H_MAX), atol=1e-5)


@pytest.mark.second
def test_decay_of_the_funnel_does_not_matter():
    """With eta falling from 0.1 the same W holds; the escape comes later by the transient."""
    e, left = run(LIMIT * np.array([0.99, 1.01, 1.1]), eta_0=ETA_0, decay=DECAY, step=0.01)
    assert np.isinf(left[0])
    assert e[0] / (D * ETA) == pytest.approx(pp.settled_share(0.99 * pp.H_MAX), abs=1e-3)
    np.testing.assert_allclose(left[1:], [0.525, 0.262], atol=5e-4)  # digits of the hand-off


def test_what_is_recovered():
    """Against 0.9 of the limit a start just inside the larger root returns, just outside leaves."""
    z2 = pp.recoverable(0.9 * pp.H_MAX)
    _, left = run([0.9 * LIMIT] * 2, e=np.array([0.99, 1.01]) * z2 * D * ETA)
    assert np.isinf(left[0])
    assert np.isfinite(left[1])
    assert pp.recoverable(1.01 * pp.H_MAX) == 0.0
    assert pp.settled_share(1.01 * pp.H_MAX) == math.inf


@pytest.mark.parametrize("factor", [1.01, 1.1, 1.5, 5.0])
@pytest.mark.parametrize("z", [0.0, -0.5, 0.9])
def test_escape_time(factor, z):
    """Against the simulation; 1e-4 s is two of its steps, near the bound where h is steep."""
    _, left = run([factor * LIMIT], e=z * D * ETA, step=0.005)
    assert pp.escape_time(factor * LIMIT, K1, ETA, D, D, z) == pytest.approx(left[0], abs=1e-4)


def test_escape_time_of_a_rail_change():
    """6.54 kN of adhesion lost at 50 m/s, w = 0.4007 1/s, leaves the funnel after 30.3 ms."""
    assert pp.escape_time(0.4007, K1, ETA, D, D) == pytest.approx(30.3e-3, abs=5e-5)
    assert pp.escape_time(0.99 * LIMIT, K1, ETA, D, D) == math.inf
    assert pp.escape_time(0.99 * LIMIT, K1, ETA, D, D, 0.999) < math.inf
    assert pp.escape_time(0.0, K1, ETA, D, D, 0.9) == math.inf
    assert pp.escape_time(LIMIT, K1, ETA, D, D, 1.0) == 0.0


def test_barrier_law_holds_any_disturbance():
    """Settled at tanh(load) of the half-width, 0.97753 at five times the funnel law's limit."""
    factors = np.array([0.5, 1.0, 5.0, -5.0])
    e, left = run(factors * LIMIT, law="barrier", end=40)
    assert np.isinf(left).all()
    predicted = [pp.barrier_settled(pp.load(W, K1, ETA, D, D)) for W in factors * LIMIT]
    np.testing.assert_allclose(e / (D * ETA), predicted, atol=1e-6)
    assert predicted[2] == pytest.approx(0.977530, abs=5e-7)


# ---- sampled ------------------------------------------------------------------------------------


def ticks(kappa, z, count, om=None, law="funnel", lower=D, upper=D):
    """Loop with the torque held over a tick, in the paper's letters; shares z after each tick."""
    T = kappa / K1
    e = ETA * (np.asarray(z, dtype=float) * (lower + upper) + upper - lower) / 2
    shares = [pp.share(e, ETA, lower, upper)]
    for _ in range(count):
        w = 0.0 if om is None else om(shares[-1]) * ETA * (lower + upper) / 2 / T
        e = e + T * (w - pull(e, ETA, lower, upper, K1, law))
        shares.append(pp.share(e, ETA, lower, upper))
    return np.array(shares)


STARTS = np.concatenate([-np.geomspace(1e-6, 0.999999, 400), np.linspace(0.001, 0.999, 400)])


def test_monotone_window():
    """0.99: no error ever changes its sign. 1.01: some do."""
    for factor, changes in ((0.99, False), (1.01, True)):
        z = ticks(factor * pp.MONOTONE, STARTS, 200)
        assert (z * np.sign(STARTS) < -1e-12).any() == changes


def test_stable_window():
    """0.99: every error dies out. 1.01: it does not, from wherever it starts."""
    assert np.abs(ticks(0.99 * pp.STABLE, STARTS, 3000)[-1]).max() < 1e-6
    assert np.abs(ticks(1.01 * pp.STABLE, STARTS, 3000)[-1]).min() > 1e-2


def test_invariant_window():
    """0.99: nothing leaves the funnel by itself. 1.01: something does; 3.58 stays, 3.60 leaves."""
    for kappa, stays in (
        (0.99 * pp.INVARIANT, True), (1.01 * pp.INVARIANT, False), (3.58, True), (3.60, False),
    ):  # fmt: skip
        assert bool(np.isfinite(ticks(kappa, STARTS, 2000)).all()) == stays


def test_sampled_windows_with_unequal_widths():
    """Same windows, as the reduction to z says."""
    assert np.isfinite(ticks(0.99 * pp.INVARIANT, STARTS, 500, lower=0.7, upper=1.9)).all()
    assert not np.isfinite(ticks(1.01 * pp.INVARIANT, STARTS, 500, lower=0.7, upper=1.9)).all()


def worst(kappa, om, start, law="funnel", count=4000):
    """Half-width of what can be reached from |z| <= start against the worst |disturbance| <= om.

    The image of an interval about 0 is an interval about 0, because the map is odd and continuous.
    """
    b = start
    for _ in range(count):
        z = np.linspace(0, b, 4001)
        after = np.abs(ticks(kappa, z, 1, law=law)[-1]).max() + om
        if after >= 1 or not np.isfinite(after):
            return math.inf
        if after <= b * (1 + 1e-13) and b > start:
            break
        b = max(after, b)
    return b


@pytest.mark.parametrize("kappa", [0.1, 0.5, 1, 1.5, 1.9, 2, 2.5, 3, 3.5])
def test_sampled_disturbance(kappa):
    """0.99 of it leaves a part of the funnel that is never left; 1.01 gets out from zero."""
    om = pp.sampled_disturbance(kappa)
    assert worst(kappa, 0.99 * om, 0.0) < 1
    assert worst(kappa, 1.01 * om, 0.0) == math.inf


def test_sampled_disturbance_is_the_continuous_one_up_to_kappa_1():
    """In W no kappa tolerates more than the small ones; the spec's digits beyond are a grid's."""
    for kappa in (0.01, 0.3, 1.0):
        assert pp.sampled_disturbance(kappa) == pytest.approx(pp.H_MAX * kappa, rel=1e-14)
    kappas = np.linspace(1, 3.59, 60)
    tolerated = [pp.sampled_disturbance(k) / k for k in kappas]
    assert (np.diff(tolerated) < 1e-12).all()
    told = {1.5: 0.628989, 1.9: 0.593483, 2: 0.571327, 2.5: 0.422511, 3: 0.239038, 3.5: 0.038112}
    for kappa, om in told.items():
        assert 0 <= pp.sampled_disturbance(kappa) - om < 5e-5
    assert pp.sampled_disturbance(3.6) == 0.0
    assert pp.sampled_disturbance(0.0) == 0.0


@pytest.mark.parametrize("zb", [0.5, 0.8, 0.9, 0.95])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_barrier_window(zb, share):
    """Inside both ends |z| <= zb is kept from every start; 1 % outside it is not."""
    om = share * zb
    low, high = pp.barrier_window(zb, om)
    if low == math.inf:  # no kappa will do
        for kappa in np.linspace(0.01, 3, 40):
            assert worst(kappa, om, zb, "barrier", 1) > zb
        return
    for kappa in (low * 1.01 + 1e-6, (low + high) / 2, high * 0.99):
        assert worst(kappa, om, zb, "barrier", 1) <= zb
    assert worst(high * 1.01, om, zb, "barrier", 1) > zb
    if om > 0:
        assert worst(low * 0.99, om, zb, "barrier", 1) > zb


def test_barrier_window_digits():
    """Without disturbance: 2 zb/atanh zb."""
    found = [pp.barrier_window(zb)[1] for zb in (0.5, 0.8, 0.9, 0.95)]
    np.testing.assert_allclose(found, [1.8205, 1.4564, 1.2226, 1.0372], atol=5e-5)


# ---- references, actuators, speeds --------------------------------------------------------------


@given(e=st.floats(-0.9, 0.9), lower=st.floats(0.5, 2), upper=st.floats(0.5, 2))
def test_largest_reference_step(e, lower, upper):
    """A step just inside keeps the logarithm real, one just outside does not."""
    error = e * ETA * min(lower, upper)
    down, up = pp.largest_reference_step(error, ETA, lower, upper)
    for factor, inside in ((0.99, True), (1.01, False)):
        assert np.isfinite(pull(error + factor * down, ETA, lower, upper, K1)) == inside
        assert np.isfinite(pull(error - factor * up, ETA, lower, upper, K1)) == inside


def test_reference_step_of_the_paper():
    """0.006 at eta_inf: the search step 0.01 breaks the law, 0.0055 does not."""
    assert pp.largest_reference_step(0.0, ETA, D, D) == pytest.approx((0.006, 0.006))
    assert np.isfinite(pull(0.0055, ETA, D, D, K1))
    assert np.isnan(pull(0.0061, ETA, D, D, K1))


def test_smallest_funnel():
    """An error fits just when eta is larger."""
    for error in (0.13, -0.13):
        eta = pp.smallest_funnel(error, 0.8, 1.2)
        assert np.isfinite(pull(error, eta * 1.01, 0.8, 1.2, K1))
        assert np.isnan(pull(error, eta * 0.99, 0.8, 1.2, K1))
    assert pp.smallest_funnel(0.06, D, D, 0.6) == pytest.approx(0.06 / (0.6 * D))


def wheel_rates(v, slip, mu, T_b):
    """(1)-(2) of Zhang 2021 without resistance: rate of the slip ratio, all signs as printed."""
    F_a = -M * G / N_W * mu
    omega = (1 - slip) * v / R
    dv, domega = N_W * F_a / M, (T_b - R * F_a) / I_W
    return (dv * (v - (v - omega * R)) / v - R * domega) / v  # d/dt of (v - omega r)/v


@given(v=st.floats(1, 80), slip=st.floats(0, 0.9), mu=st.floats(0.01, 0.4))
def test_slip_fall_rate(v, slip, mu):
    """With the brake released the slip falls at just this rate; the vehicle's share is 9.5 %."""
    F = M * G / N_W * mu
    rate = pp.slip_fall_rate(F, v, R, I_W, G * mu, slip)
    assert wheel_rates(v, slip, mu, 0.0) == pytest.approx(-rate, rel=1e-12)
    assert 0.99 * rate < -wheel_rates(v, slip, mu, 0.0) < 1.01 * rate
    share = rate / pp.slip_fall_rate(F, v, R, I_W) - 1
    assert share == pytest.approx(0.0946 * (1 - slip), abs=1e-4)


@given(
    error=st.floats(0.01, 0.11), rate=st.floats(0.05, 2), eta_0=st.floats(0.1, 0.3),
    eta_inf=st.floats(1e-3, 0.02), width=st.floats(1.2, 2),
)  # fmt: skip
def test_largest_decay(error, rate, eta_0, eta_inf, width):
    """A funnel 1 % slower is never met by the error, one 1 % faster is."""
    k = pp.largest_decay(error, rate, eta_0, eta_inf, width)
    if k == math.inf:
        assert error <= width * eta_inf
        return
    for factor, met in ((0.99, False), (1.01, True)):
        t = np.linspace(0, error / rate, 40_001)
        bound = width * ((eta_0 - eta_inf) * np.exp(-factor * k * t) + eta_inf)
        gap = bound - (error - rate * t)
        assert (gap.min() <= 0) == met
        first = pp.crossing_time(error, rate, eta_0, eta_inf, factor * k, width)
        if met:  # to a step of the grid
            assert first == pytest.approx(t[np.argmax(gap <= 0)], abs=2 * t[1])
        else:
            assert first == math.inf


def test_feasible_funnel_of_the_paper():
    """0.181 to 0.123 on snow takes 0.163 s; with k = 30 the funnel is met after 35 ms, k <= 19."""
    error = RAILS["dry"][1] - RAILS["snow"][1]
    rate = pp.slip_fall_rate(
        M * G / N_W * RAILS["snow"][0], 43.6, R, I_W, G * RAILS["snow"][0], 0.15
    )
    assert rate == pytest.approx(0.356, abs=2e-3)
    assert error / rate == pytest.approx(0.163, abs=1e-3)
    assert pp.crossing_time(error, rate, ETA_0, ETA, DECAY, D) == pytest.approx(35e-3, abs=1e-3)
    assert pp.largest_decay(error, rate, ETA_0, ETA, D) == pytest.approx(19, abs=0.5)


def test_decay_and_crossing_at_their_ends():
    """Nothing to catch up, no time left, an error that stands still."""
    assert pp.largest_decay(0.001, 0.3, 0.1, 0.005, 1.2) == math.inf
    assert pp.largest_decay(0.2, 0.3, 0.1, 0.005, 1.2) == 0.0
    assert pp.largest_decay(0.05, 0.0, 0.1, 0.005, 1.2) == 0.0
    assert pp.crossing_time(0.2, 0.3, 0.1, 0.005, 30, 1.2) == 0.0
    still = pp.crossing_time(0.05, 0.0, 0.1, 0.005, 30, 1.2)
    assert 1.2 * (0.095 * math.exp(-30 * still) + 0.005) == pytest.approx(0.05, rel=1e-9)
    assert pp.crossing_time(0.004, 0.0, 0.1, 0.005, 30, 1.2) == math.inf


def slip_run(v, mu, best, factor_F=1.0, compensated=False, law="funnel"):
    """Slip dynamics at one speed each under (34); adhesion at its peak, estimate factor_F of it.

    Returns the times of escape in s. The estimate's error acts as r^2 (F_a - F_a^)/(I_w v).
    """
    F = -M * G / N_W * np.asarray(mu)
    e, h = np.zeros(np.broadcast(v, mu, best, factor_F).shape), 1e-4
    left = np.full(e.shape, np.inf)

    def rate(e):
        T_b = R * factor_F * F + I_W * v / R * pull(e, ETA, D, D, K1, law)
        if compensated:
            T_b = T_b + I_W * N_W * (1 - best - e) * F / (M * R)
        return wheel_rates(v, best + e, mu, T_b)

    for k in range(15_000):
        new = e + h * rate(e + h / 2 * rate(e))
        left = np.where(np.isnan(new) & np.isinf(left), k * h, left)
        e = new
    return left


@pytest.mark.second
def test_lowest_speed_without_the_vehicle_term():
    """Just above it the printed law holds, just below it does not; with the term it holds."""
    mu, best = np.array(list(RAILS.values())).T
    v = pp.lowest_speed(G * mu, best - pp.Z_PEAK * D * ETA, LIMIT)
    assert np.isinf(slip_run(1.01 * v, mu, best)).all()
    assert np.isfinite(slip_run(0.99 * v, mu, best)).all()
    assert np.isinf(slip_run(0.5 * v, mu, best, compensated=True)).all()
    np.testing.assert_allclose(pp.lowest_speed(G * mu, best, LIMIT), [9.77, 4.43, 7.03], atol=5e-3)
    np.testing.assert_allclose(pp.neglected_term(v, G * mu, best - pp.Z_PEAK * D * ETA), LIMIT)


@pytest.mark.second
def test_adhesion_budget():
    """An estimate wrong by 0.99 of the budget is borne, by 1.01 it is not; the barrier bears it."""
    mu, best = RAILS["dry"]
    v = np.repeat([50.0, 25.0, 10.0], 4)
    factor = np.tile([0.99, -0.99, 1.01, -1.01], 3)
    budget = pp.adhesion_budget(v, LIMIT, R, I_W)
    np.testing.assert_allclose(budget, 87.684 * v, rtol=1e-5)
    share = 1 + factor * budget / (M * G / N_W * mu)
    left = slip_run(v, mu, best, share, compensated=True)
    assert (np.isfinite(left) == (np.abs(factor) > 1)).all()
    assert np.isinf(slip_run(v, mu, best, share, compensated=True, law="barrier")).all()


# ---- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("check", "arguments", "words"),
    [
        (pp.check_gain, ("ctl", 3000.0, 1e-3), "K1 = 2000 1/s would pass"),
        (pp.check_gain, ("ctl", -1.0, 1e-3), "0 < K1 T <= 2"),
        (pp.check_gain, ("ctl", 1100.0, 1e-3, "barrier"), "K1 = 1030 1/s would pass"),
        (pp.check_start, ("ctl", 0.13, 0.1, 1.2, 1.2), "eta_0 = 0.121 would pass"),
        (pp.check_start, ("ctl", -0.13, 0.1, 1.2, 1.2), "-0.12..0.12"),
        (pp.check_reference_step, ("search", 0.01, 0.005, 1.2, 1.2), "a step of 0.0054 would pass"),
        (pp.check_reference_step, ("search", 0.01, 0.005, 1.2, 1.2, 0.007), "eta_inf = 0.0158"),
    ],
)
def test_refusals_name_the_bound_and_what_passes(check, arguments, words):
    """One line each."""
    with pytest.raises(BadInput) as caught:
        check(*arguments)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_a_refusal_proposes_passes():
    """Take the proposal, and nothing is refused any more."""
    for check, arguments in (
        (pp.check_gain, (2000.0, 1e-3)),
        (pp.check_gain, (1030.0, 1e-3, "barrier")),
        (pp.check_start, (0.13, 0.121, 1.2, 1.2)),
        (pp.check_reference_step, (0.0054, 0.005, 1.2, 1.2)),
        (pp.check_reference_step, (0.01, 0.0158, 1.2, 1.2, 0.007)),
    ):
        assert check("ctl", *arguments) is None
