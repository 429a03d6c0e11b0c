"""Verdicts of the laws that hold an error inside bounds that once were false."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from slipctl import BadInput
from slipctl.certify import certificate, proofs
from slipctl.certify.catalogue import SYSTEMS, certify
from slipctl.certify.systems import CERTIFIED, REFUTED

FUNNEL = dict(K1=100, T="0.001", eta_inf="0.005", delta_l="1.2", delta_u="1.2")
WHEEL = dict(v=50, r="0.43", I_w="60.35")
TRAIN = dict(k1="0.5", k3="0.2", M=500000, F_min=-100000, F_max=100000, F_low=-90000, F_high=90000)


def verdict(name, **numbers):
    """Verdict, after the file has been checked as a stranger would."""
    exact = {k: Fraction(v) for k, v in numbers.items()}
    payload = proofs.write(SYSTEMS[name], exact)
    assert payload["verdict"] in certificate.check(payload)
    assert payload["time"] == ("in continuous time" if name.startswith("satur") else "as sampled")
    return payload["verdict"]


@pytest.mark.parametrize(("numbers", "wanted"), [
    (FUNNEL | dict(W="0.26", step="0.0059"), REFUTED),
    (FUNNEL | dict(W="0.26"), CERTIFIED),
    (FUNNEL | WHEEL | dict(F_error=3600, a=3, slip="0.1"), REFUTED),
    (FUNNEL | WHEEL | dict(F_error=3600), CERTIFIED),
    (FUNNEL | WHEEL | dict(a=3, slip="0.1"), CERTIFIED),
    (FUNNEL | WHEEL | dict(T="0.025", F_error=4300), REFUTED),
    (FUNNEL | WHEEL | dict(T="0.025", F_error=1700), REFUTED),
    (FUNNEL | WHEEL | dict(T="0.025", F_error=1600), CERTIFIED),
    (FUNNEL | dict(K1=200, T="0.016", eta_0="0.1", k=30), REFUTED),
    (FUNNEL | dict(eta_0="0.1", k=30, start="0.83"), CERTIFIED),
    (FUNNEL | dict(lag="0.005", W="0.1", noise="0.0001"), CERTIFIED),
    (FUNNEL | dict(lag="0.02", W="0.24"), REFUTED),
    (FUNNEL | dict(dead="0.003", W="0.1"), CERTIFIED),
    (FUNNEL | dict(lag="0.002", W="0.1", eta_0="0.1", k=30), CERTIFIED),
])  # fmt: skip
def test_inputs_of_the_funnel_are_added(numbers, wanted):
    """Case 3: two inputs that are held one by one are not held together; K1 T > 1 is sampled."""
    assert verdict("prescribed_performance", **numbers) == wanted


@pytest.mark.parametrize(("start", "wanted"), [(1, CERTIFIED), ("5.8", CERTIFIED), (6, REFUTED),
                                               (20, REFUTED)])  # fmt: skip
def test_a_need_that_varies_inside_its_limits(start, wanted):
    """Case 8: from 20 m the errors grow; the limit is at 5.9 m."""
    assert verdict("saturation_compensation", **TRAIN, start=start) == wanted


def test_without_a_start_nothing_far_is_promised():
    """What is promised without a start is the distance from which nothing saturates, 0.2 m."""
    promise = certify("saturation_compensation", **TRAIN).decision.promise
    assert "|e1| <= 0.2 m" in str(promise)
    constant = TRAIN | dict(F_low=50000, F_high=50000)
    assert verdict("saturation_compensation", **constant, start=2000) == CERTIFIED


def test_no_false_refutation_of_the_barrier():
    """Case 9: small errors that do not die out may stay inside all the same."""
    equal = dict(k=1, k_a=1, k_s=1, T="1.5")
    assert verdict("barrier_lyapunov", **equal) == CERTIFIED
    assert verdict("barrier_lyapunov", **equal, W="0.1") == CERTIFIED
    assert verdict("barrier_lyapunov", **equal, W="0.5") == REFUTED
    behind = dict(k=1, k_a=1, k_s=1, T="0.05", lag="0.2", noise="0.01")
    assert verdict("barrier_lyapunov", **behind, W="0.3") == CERTIFIED


def test_what_cannot_be_asked():
    for more, why in ((dict(F_error=1), "F_error needs v, r, I_w"), (dict(eta_0=1), "needs k"),
                      (dict(eta_0="0.001", k=1), "a funnel shrinks"),
                      (dict(start=1), "must be below 1")):  # fmt: skip
        with pytest.raises(BadInput, match=why):
            verdict("prescribed_performance", **FUNNEL, **more)
    with pytest.raises(BadInput, match="must not be above F_high"):
        verdict("saturation_compensation", **(TRAIN | dict(F_low=95000)))


@pytest.mark.parametrize(("name", "numbers"), [
    ("barrier_lyapunov", dict(k=207.4, k_a=4.321, k_s=0.2458, T=0.0002117, W=1.356, start=0.8285,
                              lag=3.821e-06, dead=0.0002866)),
    ("barrier_lyapunov", dict(k=2.122, k_a=0.01502, k_s=0.006941, T=1051, W=0, noise=0.003296,
                              start=0.999, lag=43.95)),
    ("prescribed_performance", dict(K1=26.99, T=0.04005, eta_inf=0.003557, delta_l=1.857,
                                    delta_u=1.209, W=0, noise=9.511e-05, start=0.674,
                                    dead=0.1202)),
])  # fmt: skip
def test_the_edge_of_the_start_set_is_a_start(name, numbers):
    """Its rounding to a float may lie outside; the run from the edge itself counts."""
    assert verdict(name, **{k: str(v) for k, v in numbers.items()}) == REFUTED


@pytest.mark.parametrize("numbers", [
    dict(K1=20, T="0.01", W="1.2", eta_0=2, k=6, dead="0.05", lag="0.03"),
    dict(K1="31.29", T="0.04877", W="0.2", eta_0="0.8142", k="3.991", dead="0.2"),
])  # fmt: skip
def test_a_dead_time_while_the_funnel_shrinks_is_refuted_by_a_run(numbers):
    """The error, rebuilt from the file in the letters of the law, needs no more than W."""
    n = dict(eta_inf="0.2", delta_l="1.949", delta_u="2.518") | numbers
    payload = proofs.write(
        SYSTEMS["prescribed_performance"], {k: Fraction(v) for k, v in n.items()}
    )
    assert payload["verdict"] == REFUTED
    assert "replayed" in certificate.check(payload)
    run, n = payload["counterexample"]["run"], {k: float(v) for k, v in n.items()}
    T, lag, late = n["T"], n.get("lag", 0.0), math.ceil(n["dead"] / n["T"] * (1 - 1e-12))
    gone = -math.expm1(-T / lag) if lag else 1.0
    below, above, a, line, errors = n["delta_l"], n["delta_u"], 0.0, [0.0] * late, []
    after = None
    for i, z in enumerate(float(Fraction(x)) for x in run["errors"]):
        fall = (n["eta_0"] - 0.2) * math.exp(-n["k"] * i * T)
        eta = 0.2 + fall
        errors.append(eta * ((above - below) / 2 + z * (above + below) / 2))
        if after is not None:
            assert abs(errors[-1] - after) <= T * n["W"] * (1 + 1e-9)
        x = errors[-1] / eta
        if not -below < x < above:
            break
        pull = (below + x) * (above - x) / (below + above) * math.log((below + x) / (above - x))
        line.append(-n["K1"] * eta * pull - errors[-1] * n["k"] * fall / eta)
        u = line.pop(0)
        after = errors[-1] + T * u + (a - u) * lag * gone
        a = u + (a - u) * (1 - gone)
    assert i == len(run["errors"]) - 1
