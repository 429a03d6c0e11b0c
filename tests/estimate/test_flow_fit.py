"""Flows fitted to logs: closed forms, scipy, what their deviations are worth, what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from slipctl import BadInput, fit_over_time, from_text
from slipctl.estimate.log_fit import fit_search
from slipctl.estimate.log_fit.record import Record
from slipctl.estimate.log_fit.rollout import LATEST, Rolled, Stretch, stretches
from slipctl.models.trials import brake_step, coasting, coasting_by_mass

M, RHO, A, C = 38e3, 0.066, 1200.0, 4.5
KNOWN = {"m": M, "rho": RHO}


def coasted(t: np.ndarray, v_0: float = 25.0, a: float = A, c: float = C) -> np.ndarray:
    """Speed against A + C v^2 in closed form; the rotating mass is moved too."""
    rate = math.sqrt(a * c) / (M * (1 + RHO))
    return np.asarray(math.sqrt(a / c) * np.tan(math.atan(v_0 * math.sqrt(c / a)) - rate * t))


def stepped(t: np.ndarray, at: float, k: float, tau: float, dead: float) -> np.ndarray:
    """Answer of a first-order lag to a step of 1 at a time."""
    late = np.maximum(t - at - dead, 0.0)
    return k * (1 - np.exp(-late / tau))


def noise(size: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


# ---- closed forms -------------------------------------------------------------------------------


def test_coasting_finds_the_numbers_of_its_closed_form():
    t = np.arange(0, 250, 0.5)
    found = fit_over_time(coasting, {"time": t, "v": coasted(t)}, "v", at=KNOWN)
    assert found.values["c0"] == pytest.approx(A, rel=1e-7)
    assert found.values["c2"] == pytest.approx(C, rel=1e-7)
    assert found.values["c1"] == pytest.approx(0, abs=1e-6)
    assert found.max_error < 1e-9
    assert found.starts[0] == pytest.approx(25.0, abs=1e-9)


@pytest.mark.second
def test_a_deceleration_that_no_coasting_has_is_told():
    """Times in another unit give numbers that fit as well, a thousand times too large."""
    t = np.arange(0, 60, 0.5)
    right = fit_over_time(coasting, {"time": t, "v": coasted(t)}, "v", at=KNOWN)
    wrong = fit_over_time(coasting, {"time": 1e-3 * t, "v": coasted(t)}, "v", at=KNOWN)
    assert not any("units of time" in d for d in right.doubts)
    assert wrong.values["c0"] > 100 * right.values["c0"]
    assert "look at the units of time and v" in wrong.doubts[0]


@pytest.mark.second
def test_deviations_are_those_that_noise_brings():
    """Errors of 8 logs, each by its own deviation, have a mean square near 1 (chi^2 of 16)."""
    t = np.arange(0, 250, 2.0)
    off = []
    for seed in range(8):
        v = coasted(t) + 0.05 * noise(t.size, seed)
        found = fit_over_time(
            coasting, {"time": t, "v": v}, "v", ["c0", "c2"], at=KNOWN | {"c1": 0}
        )
        off += [(found.values[n] - true) / found.std[n] for n, true in (("c0", A), ("c2", C))]
        assert found.rms == pytest.approx(0.05, rel=0.2)
    assert 0.32 < float(np.mean(np.square(off))) < 2.0  # 99 % of such sums of squares


def test_resistance_by_mass_is_that_of_the_vehicle_by_its_mass():
    t = np.arange(0, 250, 1.0)
    log = {"time": t, "v": coasted(t) + 0.05 * noise(t.size)}
    whole = fit_over_time(coasting, log, "v", at=KNOWN)
    share = fit_over_time(coasting_by_mass, log, "v", at={"rho": RHO})
    for n in ("c0", "c1", "c2"):
        assert share.values[n] * M == pytest.approx(whole.values[n], rel=1e-5, abs=1e-4)
        assert share.std[n] * M == pytest.approx(whole.std[n], rel=1e-4)


@pytest.mark.second
def test_a_car_that_runs_backwards_has_the_same_resistance():
    """A log whose speed is negative: c1 was fitted as zero, its range's end."""
    t = np.arange(0, 250, 1.0)
    v = coasted(t) + 0.05 * noise(t.size)
    for flow, known in ((coasting, KNOWN), (coasting_by_mass, {"rho": RHO})):
        on, back = (fit_over_time(flow, {"time": t, "v": s * v}, "v", at=known) for s in (1, -1))
        for n in ("c0", "c1", "c2"):
            assert back.values[n] == pytest.approx(on.values[n], rel=1e-6), (flow.name, n)
            assert back.std[n] == pytest.approx(on.std[n], rel=1e-5)


@pytest.mark.second
@settings(max_examples=5, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(0.02, 0.6), st.floats(0.0, 0.4))
def test_step_finds_gain_lag_and_dead_time(k: float, tau: float, dead: float):
    """Also where the dead time ends between two samples."""
    t = np.arange(0, 4, 0.01)
    command = np.where(t >= 0.5, 6e3, 0.0)
    y = 6e3 * stepped(t, t[command > 0][0], k, tau, dead)
    log = {"time": t, "T_cmd": command, "T": y + 20 * noise(t.size)}
    found = fit_over_time(brake_step, log, "T", delay="T_cmd")
    for n, true in (("k", k), ("tau", tau), ("dead_time", dead)):
        assert abs(found.values[n] - true) < 4.5 * found.std[n], n
    assert found.std["dead_time"] > 0.01 / math.sqrt(12.1)


def test_fit_is_that_of_scipy_on_an_integrated_trajectory():
    t = np.arange(0, 250, 2.0)
    v = coasted(t) + 0.1 * noise(t.size, 2) - 0.02 * t / 250

    def misfit(theta: np.ndarray) -> np.ndarray:
        def rate(_: float, x: Any) -> Any:
            force = 1e3 * theta[0] + 10 * theta[1] * x + theta[2] * x**2
            return -force / (M * (1 + RHO))

        run = solve_ivp(rate, (0, t[-1]), [theta[3]], t_eval=t, rtol=1e-10, atol=1e-10)
        return np.asarray(run.y[0] - v)

    other = least_squares(misfit, [1, 1, 5, 25], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = fit_over_time(coasting, {"time": t, "v": v}, "v", at=KNOWN)
    theirs = other.x * [1e3, 10, 1, 1]
    assert [*found.values.values(), *found.starts] == pytest.approx(theirs, rel=2e-4)
    spread = 2 * other.cost / (t.size - 4)
    covariance = spread * np.linalg.inv(other.jac.T @ other.jac) * found.alike
    std = np.sqrt(np.diag(covariance))[:3] * [1e3, 10, 1]
    assert list(found.std.values()) == pytest.approx(std, rel=1e-3)


# ---- the roll -----------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", ["hold", "linear"])
def test_slopes_of_the_roll_are_its_differences(rule: str):
    t = np.sort(np.random.default_rng(5).uniform(0, 3, 60))
    piece = Stretch(t, {"T_cmd": 1e3 * np.round(np.sin(3 * t), 1)}, np.zeros(t.size))
    rolled = Rolled(brake_step, "T", ["k", "tau"], "T_b", "T_cmd", rule, {"T_b": 0.0})
    at = np.array([0.9, 0.15, 50.0, 0.083])

    def over(theta: np.ndarray) -> np.ndarray:
        return rolled.over(piece, theta[:2], theta[2], theta[3], 4)[0]

    slopes = rolled.over(piece, at[:2], at[2], at[3], 4)[1]
    for i, step in enumerate((1e-6, 1e-6, 1e-3, 1e-7)):
        ahead, behind = at.copy(), at.copy()
        ahead[i] += step
        behind[i] -= step
        difference = (over(ahead) - over(behind)) / (2 * step)
        assert slopes[:, i] == pytest.approx(
            difference, rel=1e-5, abs=2e-3 * abs(slopes[:, i]).max()
        )


@pytest.mark.parametrize("dead", [0.0, 0.3, 1.0, 1.7, 2.9])
def test_a_late_input_comes_between_the_samples(dead: float):
    """tau T' = k u - T, u 7 N m for three seconds, and the dead time after it."""
    t = np.arange(8.0)
    piece = Stretch(t, {"T_cmd": np.where((t >= 1) & (t < 4), 7.0, 0.0)}, np.zeros(8))
    rolled = Rolled(brake_step, "T", ["k", "tau"], "", "T_cmd", "hold", {"T_b": 0.0})
    found, _ = rolled.over(piece, np.array([0.9, 0.5]), None, dead, 32)
    up, down = (stepped(t, at, 0.9, 0.5, dead) for at in (1.0, 4.0))
    assert found == pytest.approx(7 * (up - down), abs=1e-5)


def test_an_input_goes_straight_between_samples_if_asked():
    """x' = u with u = t: held it lags by half a sample, straight it is t^2/2."""
    own = from_text("x' = g*u where u [1/s], x = 0 m, g = 2 m")
    t = np.arange(0, 2, 0.1)
    log = {"time": t, "u": t, "x": 3 * t**2 / 2}
    straight = fit_over_time(own, log, "x", rule="linear")
    assert straight.values["g"] == pytest.approx(3, rel=1e-9)
    assert abs(fit_over_time(own, log, "x").values["g"] - 3) > 0.05


@pytest.mark.second
def test_stretches_and_logs_have_starts_of_their_own():
    t = np.arange(0, 100, 0.5)
    first = Record("there", t, {"slope": 0 * t + 0.002}, coasted(t))
    fall = first.inputs["slope"] * 9.81 / (1 + RHO)
    own = (coasted(t)[0] - coasted(t)[-1]) / t[-1]
    assert own > 0 < fall[0]
    late = np.concatenate([t, t + 200])
    both = Record("back", late, {"slope": 0 * late},
                  np.concatenate([coasted(t, 20.0), coasted(t, 12.0)]), (t.size,))  # fmt: skip
    found = fit_over_time(coasting, [both, Record("flat", t, {"slope": 0 * t}, coasted(t))], "v",
                          ["c0", "c2"], at=KNOWN | {"c1": 0})  # fmt: skip
    assert found.values == pytest.approx({"c0": A, "c2": C}, rel=1e-6)
    assert found.starts == pytest.approx((20.0, 12.0, 25.0), abs=1e-7)


def test_a_gradient_that_is_told_is_no_resistance():
    """Against another integrator; untold it goes into the numbers, and residuals stay alike."""
    t = np.arange(0, 150, 0.5)
    slope = 0.004 * np.sin(t / 15)

    def rate(s: float, x: Any) -> Any:
        return -(A + C * x**2 + M * 9.81 * 0.004 * np.sin(s / 15)) / (M * (1 + RHO))

    v = solve_ivp(rate, (0, t[-1]), [25.0], t_eval=t, rtol=1e-10, atol=1e-10).y[0]
    v = v + 0.02 * noise(t.size)
    some = dict(at=KNOWN | {"c1": 0.0})
    told = fit_over_time(coasting, {"time": t, "v": v, "slope": slope}, "v", ["c0", "c2"],
                         rule="linear", **some)  # fmt: skip
    assert abs(told.values["c0"] - A) < 4 * told.std["c0"]
    assert not told.doubts
    untold = fit_over_time(coasting, {"time": t, "v": v}, "v", ["c0", "c2"], **some)
    assert any("residuals stay alike" in d for d in untold.doubts)
    assert untold.std["c0"] > 5 * told.std["c0"]


@pytest.mark.second
def test_alike_residuals_count_as_fewer():
    """An autoregressive noise of .9: (1 + .9)/(1 - .9) = 19 samples count as one."""
    e = noise(3000)
    for k in range(1, e.size):
        e[k] += 0.9 * e[k - 1]
    t = np.arange(e.size) * 0.1
    found = fit_over_time(coasting, {"time": t, "v": coasted(t) + 0.02 * e}, "v", ["c0", "c2"],
                          at=KNOWN | {"c1": 0.0})  # fmt: skip
    assert 12 < found.alike < 28


# ---- what a log does not determine --------------------------------------------------------------


def test_a_narrow_range_of_speeds_is_told_with_its_deviation():
    t = np.arange(0, 20, 0.1)
    log = {"time": t, "v": coasted(t) + 0.02 * noise(t.size)}
    found = fit_over_time(coasting, log, "v", ["c0", "c2"], at=KNOWN | {"c1": 0.0})
    (said,) = [d for d in found.doubts if d.startswith("c0")]
    assert "is poorly determined by 19.9 s of v from 23.1" in said
    assert f"+- {found.std['c0']:.2g} N" in said


@pytest.mark.parametrize(
    ("span", "deviation", "unknown"), [(5, 0.1, ["c0", "c2"]), (20, 0.05, None)]
)  # fmt: skip
def test_what_is_worthless_is_refused_with_its_deviation(span, deviation, unknown):
    t = np.arange(0, span, 0.1)
    log = {"time": t, "v": coasted(t) + deviation * noise(t.size)}
    at = KNOWN | ({"c1": 0.0} if unknown else {})
    with pytest.raises(BadInput, match=r"not determine c\d.*\+-.*record a wider range or longer"):
        fit_over_time(coasting, log, "v", unknown, at=at)


def test_a_step_shorter_than_the_lag_is_refused():
    """Only k/tau shows: 30 ms of a lag of 0.3 s, with a noise as large as what the curve bends."""
    t = np.arange(0, 0.03, 0.001)
    y = 6e3 * stepped(t, 0.0, 1.0, 0.3, 0.0) + 60 * noise(t.size)
    log = {"time": t, "T_cmd": 0 * t + 6e3, "T": y}
    with pytest.raises(BadInput, match=r"does not determine k.*\(k = .*\+-.*0.029 s of T"):
        fit_over_time(brake_step, log, "T")


def test_a_log_without_any_effect_is_refused():
    t = np.arange(0, 10, 0.1)
    with pytest.raises(BadInput, match="does not determine k, tau: it shows none of their effect"):
        fit_over_time(brake_step, {"time": t, "T_cmd": 0 * t, "T": 0 * t}, "T")


T = np.arange(0, 30, 0.5)
LOG = {"time": T, "v": coasted(T)}


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"flow": from_text("y = 2*e where e [1]")}, "is a law; a fit over time takes a flow"),
        ({"measured": "w"}, "has no state or output 'w'"),
        ({"at": {"rho": RHO}}, r"coasting needs m \(mass, kg\); give it, --set m=VALUE"),
        ({"at": {}}, r"needs m \(mass, kg\), rho \(rotating mass, a share of the mass\); give it"),
        ({"at": KNOWN | {"c0": 1.0}, "unknown": ["c0"]}, "c0 is both given and unknown"),
        ({"at": KNOWN | {"k": 1.0}}, "has no input or parameter 'k'"),
        ({"at": {"m": "38 km", "rho": RHO}}, "another dimension"),
        ({"start": {"m": 1.0}}, "start has 'm'"),
        ({"delay": "u"}, "has no input 'u'"),
        ({"rule": "spline"}, "there is no rule 'spline'"),
        ({"unknown": ["g_"]}, "has no parameter 'g_'"),
        ({"data": {"v": T}}, "no column 'time'"),
        ({"data": {"time": T, "v": T[:5]}}, "columns of one length"),
        ({"data": {"time": -T, "v": T}}, "time has to rise"),
        ({"data": {"time": T, "v": T * np.nan}}, "v was measured in no stretch"),
        ({"data": {"time": T, "v": T, "slope": T * np.nan}}, "slope is not finite"),
        ({"data": {"time": T[:3], "v": coasted(T[:3])}}, "3 samples for 4 unknowns"),
        ({"data": []}, "there is no log"),
    ],
)  # fmt: skip
def test_what_cannot_be_fitted_is_told(change, wrong):
    whole: dict[str, Any] = {"flow": coasting, "data": LOG, "measured": "v", "at": KNOWN} | change
    with pytest.raises(BadInput, match=wrong):
        fit_over_time(**whole)


def test_states_that_nobody_measured_allow_no_gap():
    pair = from_text("x' = y; y' = -g where x = 0 m, y = 0 m/s, g = 9 m/s^2, z [m]", equations={
        "z": "x"})  # fmt: skip
    log = Record("log", T, {}, T**2, (30,))
    with pytest.raises(BadInput, match="nobody knows them behind a gap"):
        fit_over_time(pair, log, "z")
    whole = fit_over_time(pair, Record("log", T, {}, -5 * T**2 / 2), "z")
    assert whole.values["g"] == pytest.approx(5, rel=1e-6)


def test_a_flow_that_runs_away_is_refused():
    """x' = k x^2 is infinite after 1/(k x): no fit goes over that, and units of time do it."""
    flow = from_text("x' = k*x*x where x = 1 m, k = 5 1/(m s)")
    time = np.linspace(0.0, 3.0, 40)
    with pytest.raises(BadInput, match="not finite over data"):
        fit_over_time(flow, {"time": time, "x": 1 + time}, "x", unknown=["k"], start={"k": 50.0})


def test_a_flow_that_is_too_fast_for_its_samples_is_rolled_in_shorter_steps(monkeypatch):
    """A lag of 1/20 of a sample in every second one of the first: what is thinned has none."""
    monkeypatch.setattr(fit_search, "THIN", 20)
    monkeypatch.setattr(fit_search, "DRAWN", 2)
    t = np.arange(40.0)
    u, w = np.where((t < 36) & (t % 2 == 1), 20.0, 0.1), np.sin(0.2 * t)
    x = np.zeros(40)
    for k in range(39):
        x[k + 1] = w[k] + (x[k] - w[k]) * math.exp(-u[k])
    flow = from_text("x' = k*u*(w - x) where x = 0 m, u [1], w [m], k = 1 1/s")
    found = fit_over_time(flow, {"time": t, "x": x, "u": u, "w": w}, "x", unknown=["k"])
    assert found.values["k"] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("size", [2, 9, 10, 11, 100])
@pytest.mark.parametrize("most", [1, 3, 10])
def test_a_thinned_stretch_has_every_so_many_th_sample_and_no_more_than_asked(size, most):
    time = np.arange(size) * 0.5
    thin = Stretch(time, {"u": 2 * time}, 3 * time).thinned(most)
    every = int(np.ceil(size / most))
    assert thin.time.tolist() == [0.5 * k for k in range(0, size, every)]
    assert 1 <= thin.time.size <= most
    assert (thin.inputs["u"] == 2 * thin.time).all()
    assert (thin.measured == 3 * thin.time).all()


def test_a_log_is_cut_at_its_gaps_and_keeps_what_a_late_input_may_still_do():
    """A lone sample is no stretch, nor are samples of which nothing was measured."""
    time = np.array([0.0, 0.5, 1.0, 5.0, 7.0, 7.5, 8.0, 8.5])
    inputs = {"u": np.arange(8.0)}
    measured = np.array([1.0, 1, 1, 1, np.nan, 1, np.nan, np.nan])
    first, second = stretches(time, inputs, measured, [3, 4, 6], "u")
    assert (first.time.tolist(), second.time.tolist()) == ([0, 0.5, 1], [7, 7.5])
    assert second.inputs["u"].tolist() == [4, 5]
    assert np.array_equal(second.measured, [np.nan, 1], equal_nan=True)
    assert first.before[0].size == 0
    assert [b.tolist() for b in second.before] == [[5.0], [3.0]]  # within LATEST and a second
    assert 7.0 - 5.0 < LATEST + 1.0 < 7.0 - 1.0
    (plain, _) = stretches(time, inputs, measured, [3, 4, 6], "")
    assert plain.before[0].size == plain.before[1].size == 0
