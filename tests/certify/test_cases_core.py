"""Numbers that an attack from outside found to be wrong: slopes of jumps, margins, crashes."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, law
from slipctl.analysis.bounds import largest_slope
from slipctl.certify.bounds import linear_kind
from slipctl.certify.catalogue import SYSTEMS, certify


@law(mu=Output("1", "adhesion"))
def step(v_s=Input("m/s", "slip"), c=Param("1", 0.3, "height")):
    """Adhesion that falls to a half at 1 m/s."""
    return dict(mu=ca.if_else(v_s < 1, c, c / 2))


@law(mu=Output("1", "adhesion"))
def ramp(v_s=Input("m/s", "slip"), c=Param("1", 0.3, "height")):
    """Adhesion that rises up to 1 m/s, and falls from there: written with a comparison."""
    return dict(mu=ca.if_else(v_s < 1, c * v_s, c * (1.5 - v_s / 2)))


@law(mu=Output("1", "adhesion"))
def rounded(v_s=Input("m/s", "slip"), c=Param("1", 0.3, "height")):
    """Adhesion in steps."""
    return dict(mu=c * ca.floor(10 * v_s) / 10)


@pytest.mark.parametrize("method", ["interval", "grid"])
@pytest.mark.parametrize(("block", "jump"), [(step, "0.15 at v_s = 1"), (rounded, "0.03 at v_s")])
def test_a_jump_has_no_slope_bound(block, jump, method):
    """Case 11: its derivative is zero wherever there is one, which bounds nothing."""
    with pytest.raises(BadInput, match=f"mu may jump by {jump}"):
        largest_slope(block, "mu", "v_s", {"v_s": (0.0, 2.0)}, method)


def test_pieces_that_meet_have_one():
    """Beside the jump, and where two pieces meet, the slope is bounded as before."""
    assert largest_slope(step, "mu", "v_s", {"v_s": (0.0, 0.999)}).value < 1e-9
    found = largest_slope(ramp, "mu", "v_s", {"v_s": (0.0, 2.0)})
    v = np.linspace(0, 2, 2001)
    seen = np.abs(np.diff([float(ramp(v_s=x)["mu"]) for x in v])).max() / 1e-3
    assert seen <= found.value * (1 + 1e-9)  # the differences of a run, to their rounding
    assert found.value == pytest.approx(0.3, rel=1e-3)


def test_margins_of_a_slow_loop_behind_a_lag():
    """Case 12: python-control's phase margin was inf, and the delay margin nan."""
    values = certify("lagged_loop", K=1, T=1e-3, lag=0.05).values
    assert values["phase_margin"][0] == pytest.approx(87.1, abs=0.05)
    assert values["delay_margin"][0] == pytest.approx(1.52, abs=0.005)


def test_margins_by_runs():
    """Just inside the gain and the delay margin the loop dies out, just outside it does not."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        K = 10 ** rng.uniform(-1, 2)
        T = 10 ** rng.uniform(-2, 0) / K
        lag = rng.choice([0, T * 10 ** rng.uniform(-1, 1.5)])
        values = linear_kind.loop_margins(K, lag, T)
        if "gain_margin" not in values:
            continue
        for factor, dies in ((0.99, True), (1.01, False)):
            assert _shrinks(K * factor * values["gain_margin"][0], lag, T, 0) == dies
        if "delay_margin" in values:
            late = values["delay_margin"][0]
            k = max(1, round(late / T))  # a delay is whole ticks: the ticks are made to fit
            for factor, dies in ((0.97, True), (1.03, False)):
                ticks = math.floor(k * factor) if dies else math.ceil(k * factor)
                if k > 30:
                    assert _shrinks(K, lag, T, ticks) == dies


def _shrinks(K, lag, T, ticks):
    """Whether a run of the loop shrinks, its input late by so many ticks."""
    left = math.exp(-T / lag) if lag else 0.0
    e, a, past, sizes = 1.0, 0.0, [0.0] * ticks, []
    for _ in range(12_000 + 60 * ticks):
        past.append(-K * e)
        u = past.pop(0)
        e, a = e + T * u + lag * (a - u) * (1 - left), u + (a - u) * left
        sizes.append(math.hypot(e, a * T))
        if sizes[-1] > 1e9:
            return False
        if sizes[-1] < 1e-9 and ticks == 0:
            return True
    third = len(sizes) // 3
    return max(sizes[-third:]) < max(sizes[third : 2 * third])


ENDS = {"positive": (1e-40, 1e-9, 1.0, 1e9, 1e40), "not negative": (0, 1e-40, 1.0, 1e40),
        "any": (-1e40, -1.0, 0, 1e-40, 1e40)}  # fmt: skip


@pytest.mark.parametrize("name", SYSTEMS)
def test_no_number_crashes(name):
    """Any numbers that are allowed get an answer or one line: case 12, and random extremes."""
    own, rng = SYSTEMS[name], np.random.default_rng(7)
    for _ in range(25):
        numbers = {}
        for k, n in own.numbers.items():
            if n.optional and rng.random() < 0.5:
                continue
            numbers[k] = float(rng.choice(ENDS[n.low]) if rng.random() < 0.6
                               else 10 ** rng.uniform(-3, 3))  # fmt: skip
        _answers(name, numbers)


@pytest.mark.parametrize(("name", "numbers"), [
    ("sliding_seek", dict(k=1, rho=0.1, beta=0.02, slope=0.66, T=2e-4, curvature=0)),
    ("rls", dict(forgetting=0.98, least=1, samples=100000)),
    ("adhesion_observer", dict(K1=98.5, K2=4400, K3=0, L=1e30)),
])  # fmt: skip
def test_these_crashed(name, numbers):
    """Case 12: a division by zero, or a power beyond floats."""
    _answers(name, numbers)


def _answers(name, numbers):
    try:
        assert certify(name, **numbers).verdict in ("CERTIFIED", "REFUTED", "UNDECIDED")
    except BadInput as error:
        if "\n" in str(error):
            raise AssertionError(str(error)) from None


def test_certify_hst_braking_asks_what_its_pages_show():
    """Case 13: the jump dry -> snow leaves the funnel, on the same plant, as printed or not."""
    from slipctl.studies.hst_braking import gains as own
    from slipctl.study import resolve

    study = resolve.load_study("hst_braking")
    cases = resolve.build_cases(study)
    found = {}
    for g in study.certificates.gains:
        if g.system == "prescribed_performance":
            loop, _ = resolve.pick_loop(study, cases, g.loop)
            found[g.name] = certify(g.system, **g.numbers(loop))
    for name in ("eppfc", "eppfc_lag50", "eppfc_printed"):
        assert found[name].verdict == "REFUTED"
        assert found[name].gains["F_error"] == pytest.approx(own.jump_of_rail())
    assert found["eppfc_lag50"].gains["lag"] == 0.05
    assert found["eppfc_steady"].verdict == "CERTIFIED"
    unsaid = " ".join(found["eppfc_steady"].decision.promise.not_promised)
    assert "an error of the adhesion estimate" in unsaid
    assert "a lag of the actuator" in unsaid
