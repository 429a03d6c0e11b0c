"""Bounds of the adhesion observer and of the higher-order sliding mode of paper 003."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigvalsh
from scipy.optimize import minimize

from slipctl.certify.catalogue import system
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.wang_2025.certificate import adhesion_observer as observer
from slipctl.models.wang_2025.certificate import higher_order as hosm
from slipctl.models.wang_2025.hst_traction_control import higher_order

K1 = st.floats(0.05, 20)
K2 = st.floats(0.05, 50)
L = st.floats(0.01, 20)


# ---- observer -----------------------------------------------------------------------------------


@given(K1, K2, L)
def test_h_infinity_is_the_peak_of_the_frequency_response(K1, K2, L):
    def gain(w):
        return np.abs(2 * L / ((1j * w) ** 2 + K1 * 1j * w + K2))

    w = np.concatenate([[0.0], np.geomspace(1e-2, 1e2, 4000)])
    k = int(np.argmax(gain(w)))
    peak = gain(np.linspace(w[max(k - 1, 0)], w[min(k + 1, w.size - 1)], 2001)).max()
    assert observer.peak_gain(K1, K2, L) >= peak * (1 - 1e-12)
    assert observer.peak_gain(K1, K2, L) == pytest.approx(peak, rel=1e-6)  # the finer grid of w
    if abs(peak - 1) > 1e-3:
        assert observer.h_infinity(K1, K2, L) == (peak < 1)


@given(K1, K2, L)
def test_sufficient_forms_lie_in_the_exact_region(K1, K2, L):
    if observer.root_form(K1, K2, L):
        assert observer.h_infinity(K1, K2, L)
    if observer.h_infinity(K1, K2, L):
        assert observer.exact(K1, K2, L)


def test_numbers_of_the_exact_test():
    assert observer.smallest_K1(4400.0, 2000.0) / math.sqrt(2000) == pytest.approx(
        0.99122, abs=5e-6
    )
    near = 1.602 * math.sqrt(2000)  # where the two-branch condition begins, K2 = 2.2 L
    assert not observer.h_infinity(near - 0.03, 4400.0, 2000.0)
    assert observer.h_infinity(near + 0.03, 4400.0, 2000.0)
    assert observer.peak_gain(0.45, 0.21, 0.1) == pytest.approx(1.113, abs=5e-4)
    at = observer.largest_slope(0.061, 0.03)
    assert observer.exact(0.061, 0.03, at * 0.999)
    assert not observer.exact(0.061, 0.03, at * 1.001)
    assert observer.smallest_K1(3.0, 2.0) == math.inf


def test_theorem_1_as_printed_accepts_an_observer_that_diverges():
    K1, K2, L = 0.061, 0.03, 0.0145
    assert observer.printed_verdict(K1, K2, L)
    assert not observer.exact(K1, K2, L)
    assert sta.worst_ratio(K1, K2 / 2, L) == pytest.approx(2.3348, abs=5e-5)
    assert not observer.printed_verdict(93.8, 4400, 2000)  # and refuses one that is proven
    assert observer.h_infinity(93.8, 4400, 2000)


def time_to_rest(K1, K2, L, e2, seconds=1.0, dt=1e-6):
    """Time of the error system, K3 = 0, while f' pushes outwards at L, by small steps."""
    e1, t = 0.0, 0.0
    while t < seconds and (abs(e2) > 0.5 or abs(e1) > 1e-4):
        side = math.copysign(1.0, e1 if e1 else e2)
        e1, e2 = (
            e1 + dt * (e2 - K1 * math.sqrt(abs(e1)) * side),
            e2 + dt * (L - K2 / 2) * side,
        )
        t += dt
    return t


def test_convergence_time_bounds_the_time():
    K1, K2, L = 1.05 * math.sqrt(8800), 4400.0, 1500.0
    bound = observer.convergence_time(K1, K2, L, 0.0, 80.0)
    needed = time_to_rest(K1, K2, L, 80.0)
    assert 0.98 * 80 / (K2 / 2 - L) <= needed <= bound < 0.4
    assert observer.convergence_time(K1, K2, 2300.0, 0.0, 80.0) == math.inf


def test_printed_bound_of_the_time_depends_on_the_unit_of_time():
    """The same system in seconds and in milliseconds; the time in seconds."""
    K1, K2, L, e2, c = 98.5, 4400.0, 1500.0, 80.0, 1e-3
    scaled = (K1 * c**1.5, K2 * c**3, L * c**3, 0.0, e2 * c**2)
    for bound, equal in ((observer.convergence_time, True),
                         (observer.convergence_time_printed, False)):  # fmt: skip
        in_s, in_ms = bound(K1, K2, L, 0.0, e2), bound(*scaled) * c
        assert (in_ms == pytest.approx(in_s, rel=1e-6)) == equal


# ---- higher-order sliding mode ------------------------------------------------------------------


def quadratic_form(alpha, beta, k1, eta):
    """Q of (48), from the matrices of the paper."""
    P = np.array([[alpha + 4 * beta**2, -2 * beta], [-2 * beta, 1]])
    A = np.array([[-k1, 1], [-2 * beta * k1, 0]])
    B, C = np.array([[0], [0.5]]), np.array([[1, 0]])
    return P, A.T @ P + P @ A + 16 * eta**2 * C.T @ C + P @ B @ B.T @ P


@given(st.floats(0.005, 3), st.floats(0.063, 0.6), st.floats(0.1, 3), st.floats(1e-4, 1))
def test_49_is_negative_definiteness(alpha, beta, k1, eta):
    P, Q = quadratic_form(alpha, beta, k1, eta)
    top = eigvalsh(Q)[-1]
    assert eigvalsh(P)[0] > 0
    if abs(top) > 1e-9:
        assert (k1 > hosm.smallest_gain(alpha, beta, eta)) == (top < 0)
        assert (eta < hosm.certified_eta(alpha, beta, k1)) == (top < 0)


def test_numbers_of_the_paper():
    assert hosm.certified_eta(0.02, 0.09, 0.25) == pytest.approx(0.009361430, abs=5e-10)
    assert hosm.smallest_gain(0.02, 0.09, 0.05) == pytest.approx(1.215, abs=5e-4)
    assert hosm.smallest_gain(0.02, 0.09, 0.5) == pytest.approx(100.2, abs=0.05)
    assert hosm.smallest_gain(0.02, 1 / 16, 0.01) == math.inf
    assert hosm.quadratic_eta(0.25, 0.045) == pytest.approx(0.02142392, abs=5e-9)
    assert hosm.exact_eta(0.25, 0.045) == pytest.approx(0.0225)


@pytest.mark.parametrize("k4", [0.2, 0.25, 0.5, 1, 2, 5, 10])
def test_closed_form_is_the_optimum(k4):
    alpha, beta, eta = hosm.best(k4)
    assert hosm.certified_eta(alpha, beta, k4) == pytest.approx(eta, rel=1e-12)
    found = minimize(
        lambda z: -hosm.certified_eta(z[0], z[1], k4), [alpha * 1.1, beta * 1.03],
        method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14},
    )  # fmt: skip
    assert -found.fun == pytest.approx(eta, rel=1e-7)
    k2 = 2 * beta * k4
    assert eta < hosm.quadratic_eta(k4, k2) <= hosm.exact_eta(k4, k2) == pytest.approx(k2 / 2)
    assert hosm.smallest_k4(eta) == pytest.approx(k4, rel=1e-9)


def test_published_values_of_the_optimum():
    """k4 = 0.25 and 1, as rationals."""
    assert hosm.best(0.25) == pytest.approx((5 / 144, 1 / 12, 0.018042196), abs=5e-10)
    assert hosm.best(1.0) == pytest.approx((56 / 81, 5 / 18, 1 / 6), abs=5e-10)
    assert hosm.smallest_k4(0.05) == pytest.approx(0.466, abs=5e-4)
    assert hosm.smallest_k4(0.5) == pytest.approx(2.04, abs=5e-3)
    assert hosm.smallest_k4(0.001) == hosm.SMALLEST
    with pytest.raises(ValueError, match=r"sqrt\(2\)/8"):
        hosm.best(0.1)


@pytest.mark.parametrize("k4", [0.25, 1.0])
def test_best_weight_is_the_supremum(k4):
    def eta(z):
        beta, w = math.exp(z[0]), math.exp(z[1])
        alpha = math.exp(z[2])
        rest = 4 * beta - 1 / (4 * w)
        if rest <= 0:
            return 0.0
        cross = (alpha + 4 * beta**2 - beta / (2 * w)) ** 2 / rest
        return math.sqrt(max(2 * alpha * k4 - beta**2 / w - cross, 0) / (16 * w))

    alpha, beta, top = hosm.best_weighted(k4)
    start = [math.log(beta), math.log(1.001 / (16 * beta)), math.log(alpha)]
    found = minimize(
        lambda z: -eta(z), start, method="Nelder-Mead", options={"maxiter": 4000, "xatol": 1e-12}
    )
    assert 0.99 * top < -found.fun < top
    assert top > hosm.best(k4)[2]


@given(st.floats(0.2, 5))
def test_bounds_do_not_depend_on_the_unit_of_length_but_49_does(k4):
    """s in m and in km: |s|^.5 scales gains of the root by sqrt; only its terms, near s = 0."""
    beta = hosm.best(k4)[1]
    k1, k2, c = k4, 2 * beta * k4, 1e-3
    assert hosm.exact_eta(k1 * c**0.5, k2 * c) == pytest.approx(hosm.exact_eta(k1, k2) * c)
    assert hosm.quadratic_eta(k1 * c**0.5, k2 * c) == pytest.approx(hosm.quadratic_eta(k1, k2) * c)


def test_gains_have_one_unit_in_the_law_and_in_its_certificate():
    law, asked = higher_order(), system("higher_order").numbers
    for name, told in (("alpha", "alpha"), ("beta", "beta"), ("k4", "k_4")):
        assert asked[name].unit == law.params[told].unit
