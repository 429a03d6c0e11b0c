"""What a tick of the estimator over a window does with a sample, piece by piece, by numpy."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from test_steps_of_a_windowed_fit import MODEL, by_numpy, curve

from slipctl import rls
from slipctl.estimate.model import Model
from slipctl.estimate.window import BELIEF, KNOWN, Window, _near, smallest_shift

WIDTH = 5
RNG = np.random.default_rng(12)
ROOT = RNG.normal(size=(3, 3))
P = {"gate": 4.0, "noise": 0.1, "coarsest": 0.5, "forgetting": 0.8}
SAMPLES = RNG.uniform(0.2, 2, size=(4, WIDTH))


def window(**options):
    given = {"memory": 1, "echo": 0.0, "recall": 0, "iterations": 4, "per_tick": 4} | options
    return Window(MODEL, WIDTH, **given)


def dm(values):
    return {n: ca.DM(np.array(v, dtype=float)) for n, v in values.items()}


def number(v):
    return np.array(ca.evalf(ca.MX(v)))


STATE = {"P": 0.01 * ROOT @ ROOT.T, "scatter": 0.04, "count": 9, "theta": [0.3, 0.8, -0.5]}
ROW = np.array([0.7, -1.1, 0.4])
DOUBT = float(ROW @ STATE["P"] @ ROW)


def test_the_variance_of_a_residual_is_noise_and_doubt():
    """Relative to the declared noise where one residual is looked at; noise has a largest value."""
    one, many = window(), window(memory=3)
    for scatter, noise in ((0.04, 0.04), (0.3, 0.25)):
        x = dm(STATE | {"scatter": scatter})
        assert float(one.variance(x, ca.DM(ROW), dm(P))) == pytest.approx(
            noise * (1 + DOUBT / 0.01)
        )
        assert float(many.variance(x, ca.DM(ROW), dm(P))) == pytest.approx(noise + DOUBT)
    below = dm(STATE | {"P": -STATE["P"]})
    assert float(many.variance(below, ca.DM(ROW), dm(P))) == pytest.approx(0.04)


def test_one_residual_tells_a_change_from_five_samples_on():
    limit = 4.0 * math.sqrt(0.04 * (1 + DOUBT / 0.01))
    for e, count, changed in ((1.01, 9, 1), (-1.01, 5, 1), (0.99, 9, 0), (1.5, 4, 0)):
        x = dm(STATE | {"count": count})
        found, shifts = window().change(x, ca.DM(e * limit), ca.DM(ROW), dm(P))
        assert float(found) == changed
        assert shifts is None
    x = dm(STATE | {"echoed": [0.3, *(0.1 * ROW)]})
    limit = 4.0 * math.sqrt(0.04 * (1 + 1.21 * DOUBT / 0.01))
    for e, changed in ((1.01, 1), (0.99, 0)):
        found, _ = window(echo=0.5).change(x, ca.DM(e * limit - 0.3), ca.DM(ROW), dm(P))
        assert float(found) == changed


@pytest.mark.parametrize("echo", [0.0, 0.5])
def test_shifts_of_the_latest_residuals_tell_a_change(echo):
    """The likelihood ratio with count - 3 degrees, and a hundredth for what is declared."""
    old = np.array([[1.5, -0.5, 2.0]])
    x = dm(STATE | {"shifts": old, "echoed": [0.02, *(0.1 * ROW)]})
    off, row = (0.02, 1.1 * ROW) if echo else (0.0, ROW)
    freedom = BELIEF + 6
    for e in (0.1, 1.4, 2.2):
        new = (e + off) / math.sqrt(0.04 + row @ STATE["P"] @ row)
        shifts = np.array([new, 1.5, -0.5])
        left = [np.cumsum(echo ** np.arange(k)) if echo else np.ones(k) for k in (1, 2, 3)]
        ratio = max((shifts[: len(s)] @ s[::-1]) ** 2 / (s @ s) for s in left)
        told = freedom * math.log1p(ratio / freedom)
        for gate in (math.sqrt(told) * 0.999, math.sqrt(told) * 1.001):
            changed, found = window(memory=3, echo=echo).change(
                x, ca.DM(e), ca.DM(ROW), dm(P | {"gate": gate}))  # fmt: skip
            assert number(changed).item() == (gate**2 < told)
            assert number(found).ravel() == pytest.approx(shifts)
    x = dm(STATE | {"count": 4, "shifts": old, "echoed": [0.02, *(0.1 * ROW)]})
    _, found = window(memory=3, echo=echo).change(x, ca.DM(9.0), ca.DM(ROW), dm(P))
    assert number(found).ravel().tolist() == [0, 1.5, -0.5]


def test_the_noise_that_a_fit_takes():
    """As declared for one residual, afresh, or of fewer than five samples; else what is seen."""
    x, few = dm(STATE), dm(STATE | {"count": 4})
    assert float(window().noise(x, ca.DM(0), ca.DM(0.01))) == 0.01
    several = window(memory=2)
    assert float(several.noise(x, ca.DM(0), ca.DM(0.01))) == pytest.approx(0.04)
    assert float(several.noise(x, ca.DM(1), ca.DM(0.01))) == 0.01
    assert float(several.noise(few, ca.DM(0), ca.DM(0.01))) == 0.01
    assert float(several.noise(dm(STATE | {"count": 5}), ca.DM(0), ca.DM(0.01))) == 0.04


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("again", [0, 1])
def test_what_leaves_the_window_is_remembered(full, again):
    """Its information is added to what was kept, 0.8 of it and 0.2 of what is known at first."""
    L = RNG.normal(size=(3, 3))
    least, theta, mean = (
        np.array([0.5, 2.0, 0.25]),
        np.array(STATE["theta"]),
        np.array([0.1, 0.9, 0]),
    )
    x = STATE | {"kept": SAMPLES, "Lambda": L @ L.T + np.eye(3), "mean": mean,
                 "count": WIDTH if full else 4}  # fmt: skip
    known = dm({"least": least, "constants": [0.9]})
    found = window().information(dm(x), ca.DM(again), ca.DM(0.04), known, dm(P))
    center, Lambda = (number(v) for v in found)
    values, slopes = (np.array(v) for v in MODEL.parameters(theta))
    e, rows = by_numpy(values.ravel(), SAMPLES[:, -1:], 0.9)
    g = (rows @ slopes).ravel()
    wanted = 0.8 * x["Lambda"] + 0.2 * np.diag(least) + np.outer(g, g) / 0.04
    pull = 0.8 * x["Lambda"] @ (mean - theta) + g * e / 0.04
    where = theta + np.linalg.solve(wanted, pull)
    if not full:
        wanted, where = x["Lambda"], mean
    if again:
        wanted, where = np.diag(least), theta
    assert Lambda == pytest.approx(wanted)
    assert center.ravel() == pytest.approx(where)


def test_samples_are_kept_newest_first():
    new = np.array([7.0, 8, 9, 10])
    for again, count, kept, many in (
        (0, 3, np.column_stack([new, SAMPLES[:, :-1]]), 4), (1, 3, np.tile(new[:, None], WIDTH), 1),
        (0, WIDTH, np.column_stack([new, SAMPLES[:, :-1]]), WIDTH),
    ):  # fmt: skip
        x = dm({"kept": SAMPLES, "count": count})
        found, now = window().samples(x, ca.DM(again), ca.DM(new))
        assert number(found) == pytest.approx(kept)
        assert float(now) == many


def test_an_estimate_is_within_reach_with_its_covariance_and_noise():
    H = ROOT @ ROOT.T + np.eye(3)
    hand = dm({"theta_now": [0.5, 9.0, -9.0], "H": H, "squares": 0.36, "damping": 0.7})
    known = dm({"declared": 0.01, "least": [1e-6] * 3})
    guess, mean = MODEL.guess, ca.DM([-8.0, 0.2, 8.0])
    for memory, count, scatter in (
        (1, 6, 0.01 + 0.36 / 6), (4, 6, (BELIEF * 0.01 + 0.36) / (BELIEF + 3)),
        (4, 2, (BELIEF * 0.01 + 0.36) / BELIEF),
    ):  # fmt: skip
        found = window(memory=memory).estimate(hand, ca.DM(count), mean, known, ca.DM(2.0))
        assert float(found["scatter"]) == pytest.approx(scatter)
    assert number(found["theta"]).ravel() == pytest.approx([0.5, guess[1] + 2, guess[2] - 2])
    assert number(found["mean"]).ravel() == pytest.approx([guess[0] - 2, 0.2, guess[2] + 2])
    assert number(found["P"]) == pytest.approx(np.linalg.inv(H))
    assert float(found["damping"]) == 0.7


def test_one_coordinate_alone_stays_in_the_range_of_its_law():
    alone = Model.of(curve, "y", ["c"], ["log(c)"], {"c": 2.0})
    lo = math.log(1e-3)
    assert alone.ends() == pytest.approx((lo, math.inf))
    for theta, far, wanted in ((-9, 99, lo), (9, 99, 9), (-9, 1, math.log(2) - 1),
                               (9, 1, math.log(2) + 1)):  # fmt: skip
        found = _near(ca.DM(theta), alone, ca.DM(far))
        assert float(ca.evalf(ca.MX(found))) == pytest.approx(wanted)


def test_a_former_estimate_is_asked_about_each_sample():
    """Its noise is at least the declared one; in force again it brings all that it knew."""
    asked, t = window(recall=2, memory=2), np.array([0.2, -0.4, 0.3])
    former = {"theta": t, "P": STATE["P"], "scatter": 0.001, "mean": [4.0, 5, 6],
              "Lambda": np.eye(3), "count": 5, "kept": SAMPLES + 1}  # fmt: skip
    now = {"theta": [9.0, 9, 9], "P": np.eye(3), "scatter": 9.0, "mean": [9.0, 9, 9],
           "Lambda": 9 * np.eye(3), "count": 3, "kept": SAMPLES, "unsettled": 4.0, "damping": 8.0,
           "shifts": [[0.5, 0.25]], "summed": 0.1}  # fmt: skip
    assert set(former) == set(KNOWN)
    values, slopes = (np.array(v) for v in MODEL.parameters(t))
    e, rows = by_numpy(values.ravel(), np.array([[0.5], [0.2], [1.1], [0.9]]), 0.9)
    h = (rows @ slopes).ravel()
    may = math.sqrt(0.01 + h @ STATE["P"] @ h)
    for agreed, wanted, back in ((0, 1, 0), (1, 2, 1)):
        x = dm(now | {f"former_{n}": v for n, v in former.items()} | {"agreed": agreed})
        at, counts, came = asked.recalled(x, ca.DM([0.5, 0.2, 1.1]), ca.DM(0.9), ca.DM([0.9]),
                                          dm(P | {"gate": 9.0}))  # fmt: skip
        assert number(came).item() == back
        assert number(counts["agreed"]).item() == wanted
        assert number(counts["summed"]).item() == pytest.approx(0.1 + e.item() / (9.0 * may))
        told = former | {"unsettled": 0, "damping": 0.1, "shifts": [[0, 0]]} if back else now
        for n in (*KNOWN, "unsettled", "damping", "shifts"):
            assert number(at[n]) == pytest.approx(number(ca.DM(np.array(told[n], dtype=float))))
    near = dm(now | {f"former_{n}": v for n, v in former.items()} | {"agreed": 1})
    far = 0.9 - e.item() + 1.01 * 3 * may
    counts = asked.recalled(near, ca.DM([0.5, 0.2, 1.1]), ca.DM(far), ca.DM([0.9]),
                            dm(P | {"gate": 3.0}))[1]  # fmt: skip
    assert number(counts["agreed"]).item() == 0


def test_settings_of_the_form_are_those_asked_for():
    block = rls(
        curve, unknown=["a", "b", "c"], coordinates=["a", "b", "c"], start={"b": 1.0}, memory=3,
        form="window", window=7, iterations=6, iterations_per_tick=2, recall=4,
    )  # fmt: skip
    told = block.choices
    names = ("window", "iterations", "iterations per tick", "memory", "recall")
    assert [told[n] for n in names] == [7, 6, 2, 3, 4]
    assert "echo" not in told
    shapes = {n: s.shape for n, s in block.states.items()}
    assert (shapes["kept"], shapes["shifts"], shapes["P"]) == ((4, 7), (1, 3), (3, 3))
    assert float(block.start()["damping"]) == 0.1
    assert float(block.start()["agreed"]) == -1


def test_the_smallest_shift_has_its_own_defaults():
    """Gate 5, declared noise 1e-3, one sample, three unknowns; an echo makes it smaller."""
    nu = BELIEF + 17
    s2 = (BELIEF * 1e-6 + 17 * 4e-6) / nu
    assert smallest_shift(2e-3, 20) == pytest.approx(math.sqrt(s2 * nu * math.expm1(25 / nu)))
    weight = 1 + 1.5**2 + 1.75**2
    assert smallest_shift(2e-3, 20, 3, echo=0.5) == pytest.approx(
        math.sqrt(s2 * nu * math.expm1(25 / nu) / weight))  # fmt: skip
    assert math.isinf(smallest_shift(1.0, 4))
    assert math.isfinite(smallest_shift(1.0, 5))


def test_the_next_residual_hears_the_innovation_of_the_newest():
    """Of five samples of which the oldest has no weight yet, in slopes by the coordinates."""
    it, echo = window(echo=0.5), 0.5
    weights = np.array([[1.0, 1, 1, 1, 0]])
    found = it.heard(dm({"theta": STATE["theta"], "kept": SAMPLES}), ca.DM(weights), ca.DM([0.9]))
    values, slopes = (np.array(v) for v in MODEL.parameters(STATE["theta"]))
    e, rows = by_numpy(values.ravel(), SAMPLES, 0.9)
    r, u, g = 0.0, 0.0, np.zeros(3)
    for k in (3, 2, 1, 0):
        q = echo / r if r else 0.0
        u, g, r = e[k] + q * u, rows[k] + q * g, 1 + echo**2 - echo * q
    assert number(found).ravel() == pytest.approx(echo / r * np.r_[u, slopes.T @ g])


@pytest.mark.parametrize("memory", [1, 3])
def test_a_change_puts_aside_what_was_known_and_begins_afresh(memory):
    """And two samples in a row that agree with it bring it back."""
    block = rls(curve, unknown=["b"], coordinates=["b"], start={"b": -0.3}, form="window", window=6,
                memory=memory, recall=2, noise=0.01)  # fmt: skip
    rng, state = np.random.default_rng(3), {}

    def sample(b, state):
        v, w = rng.uniform(0.2, 2), rng.uniform(0.5, 1, 2)
        y = 1.5 * math.exp(-0.4 * v) + b * w[0] - 0.7 * 0.4 * w[1] + 0.001 * rng.normal()
        return block(**state, v=v, w=w, y=y, k=0.7, a=0.4, c=1.5)

    for _ in range(9):
        state, out = sample(-0.3, state)
        assert out["changed"] == 0
    before = state
    assert out["b"] == pytest.approx(-0.3, abs=2e-3)
    state, out = sample(0.9, state)
    assert (out["changed"], out["recalled"]) == (1, 0)
    for n in KNOWN:
        assert np.asarray(state[f"former_{n}"]) == pytest.approx(np.asarray(before[n])), n
    assert (float(state["count"]), float(state["agreed"])) == (1, 0)
    state, out = sample(-0.3, state)
    assert (float(state["agreed"]), out["recalled"]) == (1, 0)
    state, out = sample(-0.3, state)
    assert out["recalled"] == 1
    assert out["b"] == pytest.approx(-0.3, abs=2e-3)
