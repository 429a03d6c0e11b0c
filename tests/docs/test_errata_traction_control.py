"""Errata of Wang 2025 about observer, limit and laws: each number of docs/errata.md, measured."""

import math
import re

import casadi as ca
import numpy as np
import pytest
from errata import shows
from reduced_train import BY_MU, observed, reduced_run

from slipctl import RunFailed, sampled
from slipctl.models.super_twisting.certificate import super_twisting as twisting
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wang_2025 import hst_traction_control as control
from slipctl.models.wang_2025.certificate import adhesion_observer as observer
from slipctl.models.wang_2025.certificate import higher_order as proofs
from slipctl.models.wheel_rail.contact import SURFACES, peak, polach
from slipctl.studies.hst_traction.claims import TABLE_4
from slipctl.studies.hst_traction.loops import BAND

K1, K2, L = 1.05 * math.sqrt(8800), 4400.0, 2000.0


def test_printed_f_has_the_other_sign():
    block, T = adhesion.adhesion_observer(), 3000.0
    x = block.start(z1=90.0, T_last=T)
    for _ in range(300):
        x, _ = block(**x, omega=90.0, T=T)
    shows("003.8", "-31.99", float(x["z2"]))
    shows("003.8", "31.99", (T - 0.01 * 90) / 93.75)


def test_theorem_1_as_printed():
    assert observer.printed_verdict(0.45, 0.21, 0.1)
    assert observer.printed_verdict(0.061, 0.03, 0.0145)
    shows("003.9", "1.113", observer.peak_gain(0.45, 0.21, 0.1))
    shows("003.9", "2.335", twisting.worst_ratio(0.061, 0.015, 0.0145))
    shows("003.9", "8800", 2 * K2)
    shows("003.9", "93.81", math.sqrt(2 * K2))
    shows("003.9", "44.33", observer.smallest_K1(K2, L))
    edge = math.sqrt(2 * (K2 - math.sqrt(K2**2 - 4 * L**2)))
    shows("003.9", "71.65", edge)
    assert observer.h_infinity(edge * 1.0001, K2, L)
    assert not observer.h_infinity(edge * 0.9999, K2, L)


@pytest.mark.parametrize("discretisation", ["implicit", "explicit"])
def test_observer_needs_a_slope(discretisation):
    block = adhesion.adhesion_observer(discretisation).with_params(B_t=0.0)
    ticks, jump = 60, 80.0
    u = np.vstack([100 - jump * 1e-3 * np.arange(ticks), np.zeros(ticks)])
    p = ca.repmat(block.pack("param", block.param_values()), 1, ticks)
    seen = block.f.mapaccum(ticks)(block.pack("state", block.start(z1=100.0)), u, p)[1]
    off = np.abs(np.array(seen).ravel() / (BY_MU * jump) - 1)
    shows("003.10", "0.110", BY_MU * jump)
    shows("003.10", "27", float(np.flatnonzero(off > 0.05)[-1] + 1))
    largest = {"implicit": "0.00103", "explicit": "0.0087"}[discretisation]
    plain = adhesion.adhesion_observer(discretisation)
    shows("003.10", largest, float(np.abs(observed(plain, 1e-3, seconds=3.0)).max()))


def test_printed_40_is_unstable():
    with pytest.raises(RunFailed) as failed:
        reduced_run(150e3, form="printed-40", seconds=5.0)
    shows("003.11", "1.475", float(re.search(r"t = ([\d.]+) s", str(failed.value))[1]))


def test_ice_has_no_poorer_surface():
    top = peak(40.0, "ice")
    assert min(peak(40.0, n).value for n in SURFACES) == top.value
    a, b = 0.0, top.location
    for _ in range(60):
        middle = (a + b) / 2
        below = polach(v_s=middle, v=40.0, **SURFACES["ice"])["mu"] < 0.9 * top.value
        a, b = (middle, b) if below else (a, middle)
    shows("003.13", "87.9", 10 * top.value * 15625 * 9.8 / 1e3)
    shows("003.13", "1.03", top.location)
    shows("003.13", "0.382", a)
    shows("003.13", "1.38", 3.6 * a)


def test_printed_gains_prove_little():
    eta = proofs.certified_eta(0.02, 0.09, 0.25)
    shows("003.14", "0.00936", eta)
    shows("003.14", "4.68", eta * 500e3 / 1e3)
    shows("003.14", "1.215", proofs.smallest_gain(0.02, 0.09, 0.05))
    shows("003.14", "100.2", proofs.smallest_gain(0.02, 0.09, 0.5))
    for eta, texts in ((0.05, ("0.4664", "0.1377", "0.1412")), (0.5, ("2.040", "2.998", "0.5395"))):
        k4 = proofs.smallest_k4(eta)
        for text, value in zip(texts, (k4, *proofs.best(k4)), strict=False):
            shows("003.14", text, value)


def test_s_leaves_its_band():
    s, _, _ = reduced_run(1e9)
    sigma = float(control.higher_order().param_values()["sigma"])
    shows("003.15", "1e-4", sigma)
    shows("003.15", "4.6e-4", float(np.abs(s).max()))
    assert np.abs(s).max() > sigma
    assert np.abs(s[30_000:]).max() < 3e-8


def test_creep_band_is_round_in_m_per_s():
    shows("003.17", "-0.72", 3.6 * BAND[0])
    shows("003.17", "2.88", 3.6 * BAND[1])


def test_table_4_has_no_units():
    shows("003.18", "5", float(TABLE_4["hosm"][2]))
    shows("003.18", "2", 1 / float(control.sliding_mode.param_values()["k_1"]))


def test_printed_slope_of_phi_1():
    e, K3 = 0.04, 0.5
    phi1 = e**0.5 + K3 * e**1.5
    shows("003.24", "0.5406", 0.5 + 2 * K3 * e + 1.5 * K3**2 * e**2)
    shows("003.24", "0.5406", phi1 * (0.5 * e**-0.5 + 1.5 * K3 * e**0.5))
    shows("003.24", "0.0510", phi1 * (0.5 * e**0.5 + 1.5 * K3 * e**0.5))


def test_printed_time_bound():
    given, c = (98.5, K2, 1500.0, 0.0, 80.0), 1e-3
    in_ms = (98.5 * c**1.5, K2 * c**3, 1500.0 * c**3, 0.0, 80.0 * c**2)
    shows("003.25", "3181", observer.convergence_time_printed(*given))
    shows("003.25", "95.7", observer.convergence_time_printed(*in_ms) * c)
    shows("003.25", "0.305", observer.convergence_time(*given))
    shows("003.25", "0.305", observer.convergence_time(*in_ms) * c)


def test_sampled_gain_of_37_grows_by_its_own_orbit():
    """The explicit law on an integrator: above the printed-out gain its own orbit feeds it."""
    T, sigma = control.T_C, 1e-4
    law = sampled(control.higher_order(), T, "euler")
    edge = 2 * math.sqrt(sigma) / (T * (1 + math.sqrt(sigma)))
    shows("003.26", "3.960", edge)
    shows("003.26", "18.66", law.params["k_max"].value)

    def run(gain, k_max=1e5, ticks=4000):
        x, e2 = ca.SX.sym("x", law.f.size1_in(0)), ca.SX.sym("e2")
        u = law.pack("input", dict(e1=0.0, e2=e2, a_ff=0.0, F_hi=1e12, F_lo=-1e12))
        told = dict(k_1=1e-3, k_4=1e-3, k_max=k_max)
        after, out = law.f(x, u, law.pack("param", law.param_values(**told)))
        y = law.unpack("output", out)
        closed = ca.vertcat(after, e2 + T * y["F_contr"] / 500e3)
        gain_a = law.unpack("state", after)["k_a"]
        tick = ca.Function("tick", [ca.vertcat(x, e2)], [closed, gain_a, ca.fabs(y["s"])])
        start = ca.vertcat(law.pack("state", law.start(k_a=gain)), 0.01)
        _, gains, s = tick.mapaccum(ticks)(start)
        return gains.full().ravel(), s.full().ravel()

    for gain, up in ((3.5, False), (4.5, True)):
        gains, _ = run(gain)
        assert bool(gains[-1] > gains[len(gains) // 2]) is up
    gains, s = run(20.0)
    shows("003.26", "0.00277", s[3001:].mean())
    shows("003.26", "0.00282", (T * gains[-1] / (2 - T * gains[-1])) ** 2)
    gains, _ = run(20.0, k_max=20.01)
    assert gains.max() <= 20.01 + 1e-3
    assert gains[-1] == gains[-1000]  # it stays there
