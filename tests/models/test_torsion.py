"""Torsion of a wheelset: modes, critical fall and limit cycle against closed forms."""

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from slipctl import BadInput
from slipctl.certify.catalogue import certify
from slipctl.models.wheel_rail.contact import polach
from slipctl.models.wheel_rail.falling_creep import falling_creep
from slipctl.models.wheel_rail.torsion import Wheelset, axle_stiffness, twisting_axle

K_AXLE, LOAD, RADIUS = 7.526e6, 105e3, 0.625


def two_wheels(J=150.0, damping=0.005):
    return Wheelset((J, J), (K_AXLE,), (0, 1), LOAD, RADIUS, damping)


def test_an_axle_of_190_mm():
    assert axle_stiffness(0.19, 1.36) == pytest.approx(K_AXLE, rel=1e-2)  # of the steel's modulus


@pytest.mark.parametrize(("J", "frequency"), [(100, 61.75), (150, 50.416), (200, 43.66)])
def test_frequency_of_two_wheels(J, frequency):
    assert two_wheels(J).modes()[0].frequency == pytest.approx(frequency, rel=1e-4)


def test_critical_fall_of_two_wheels():
    found = two_wheels().critical_fall
    assert found == pytest.approx(0.011585, abs=5e-7)
    assert found == pytest.approx(
        2 * 0.005 * sqrt(2 * K_AXLE * 150) / (LOAD * RADIUS**2), rel=1e-12
    )


def test_a_rotor_behind_a_soft_shaft():
    """practice_cases 4: 15.13 and 49.17 Hz, .005702 and .012680 s/m."""
    modes = Wheelset((700, 190, 150), (2.2e6, K_AXLE), (1, 2), LOAD, RADIUS).modes()
    assert [m.frequency for m in modes] == pytest.approx([15.13, 49.17], abs=6e-3)
    assert [m.critical_fall for m in modes] == pytest.approx([0.005702, 0.012680], rel=1e-4)


@settings(max_examples=30, deadline=None)
@given(st.floats(50, 500), st.floats(1e6, 2e7), st.floats(1e-3, 0.05))
def test_the_critical_fall_is_that_of_the_eigenvalues_and_the_one_that_is_certified(J, k, z):
    """The full matrix of states, put together here: its fastest eigenvalue changes sign there."""
    d = z * sqrt(2 * k * J)
    K = k * np.array([[1, -1], [-1, 1.0]])

    def growth(fall):
        D = d * np.array([[1, -1], [-1, 1.0]]) - np.eye(2) * LOAD * RADIUS**2 * fall
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K / J, -D / J]])
        return max(e.real for e in np.linalg.eigvals(A) if abs(e.imag) > 1)

    critical = Wheelset((J, J), (k,), (0, 1), LOAD, RADIUS, z).critical_fall
    assert brentq(growth, 0, 3 * critical, rtol=1e-9) == pytest.approx(critical, rel=1e-6)
    numbers = {"J": J, "k": k, "z": z, "N": LOAD, "r": RADIUS}
    for share, verdict in ((1 - 1e-6, "CERTIFIED"), (1 + 1e-6, "REFUTED")):
        assert certify("twisting_axle", **numbers, fall=share * critical).verdict == verdict


@pytest.mark.second
@pytest.mark.parametrize("slip", [0.5, 1.0, 2.0])
@pytest.mark.others("long")
def test_the_limit_cycle_is_between_sticking_and_twice_the_slip(slip):
    """Torque near s sqrt(2 k J)/r; on a contact that is stiff, so that it sticks."""
    law = falling_creep.with_params(mu_0=0.36, A=0.38, B=0.70, c=1500.0)
    block = twisting_axle(law)
    values, names = block.param_values(), list(block.states)
    p, u = block.pack("param", values), block.pack("input", {"s": slip, "v": 10.0})

    def rates(_, x):
        return np.ravel(block.f(x, u, p)[0])

    run = solve_ivp(rates, (0, 2.5), [0.0, 1e-3], max_step=4e-4, rtol=1e-6, atol=1e-8)
    late = run.t > 2.2
    torque = K_AXLE * np.abs(run.y[names.index("twist")][late]).max()
    assert torque == pytest.approx(slip * sqrt(2 * K_AXLE * 150) / RADIUS, rel=0.05)
    swing = RADIUS * np.abs(run.y[names.index("rate")][late]).max() / 2
    assert swing == pytest.approx(slip, rel=0.05)


def test_it_swings_where_the_curve_falls_faster_than_the_critical_fall_and_rests_elsewhere():
    law = falling_creep.with_params(mu_0=0.36, A=0.38, B=0.70, c=664.0)
    block = twisting_axle(law)
    p = block.pack("param", block.param_values())
    for slip, grows in ((0.15, False), (0.3, True), (3.6, True), (3.8, False)):
        u = block.pack("input", {"s": slip, "v": 10.0})
        h, rows = 1e-7, []
        for step in np.eye(2) * h:
            ahead, back = (np.ravel(block.f(x, u, p)[0]) for x in (step, -step))
            rows.append((ahead - back) / (2 * h))
        A = np.array(rows).T
        assert (np.linalg.eigvals(A).real.max() > 0) == grows, slip
        assert np.abs(np.linalg.eigvals(A).imag).max() / (2 * pi) == pytest.approx(50.4, abs=0.2)


@pytest.mark.parametrize(
    "given",
    [
        {"inertias": (1.0,)}, {"stiffness": (1.0, 2.0)}, {"wheels": ()}, {"wheels": (2,)},
        {"load": 0.0}, {"damping": -1.0},
    ],
)  # fmt: skip
def test_wheelsets_that_are_none(given):
    whole = {"inertias": (1.0, 1.0), "stiffness": (1.0,), "wheels": (0, 1), "load": 1.0,
             "radius": 1.0} | given  # fmt: skip
    with pytest.raises(BadInput):
        Wheelset(**whole)


def test_a_law_with_derived_numbers_keeps_them():
    """Polach's stiffness follows from its patch, under a twisting axle as by itself."""
    law = polach.with_params(Q=60e3)
    block = twisting_axle(law)
    f = block.function()
    x, p = block.start(), block.param_values()
    given = {"s": 0.1, "v": 20.0, "twist": 0.0, "rate": 0.0}
    found = f(*(given.get(n[2:], p.get(n[2:], x.get(n[2:]))) for n in f.name_in()))
    mu = float(found[f.name_out().index("y_mu")])
    assert mu == pytest.approx(float(law(v_s=0.1, v=20.0)["mu"]), rel=1e-12)


def test_each_mode_twists_in_its_shape():
    """K x = w^2 M x for each, and the shapes are apart; the mode that turns is left out."""
    train = Wheelset((40.0, 150.0, 130.0), (2e6, K_AXLE), (1, 2), LOAD, RADIUS)
    K = np.array([[2e6, -2e6, 0], [-2e6, 2e6 + K_AXLE, -K_AXLE], [0, -K_AXLE, K_AXLE]])
    M = np.diag([40.0, 150.0, 130.0])
    modes = train.modes()
    assert len(modes) == 2
    assert 0 < modes[0].frequency < modes[1].frequency
    for mode in modes:
        w = 2 * pi * mode.frequency
        assert K @ mode.shape == pytest.approx(w**2 * M @ mode.shape, rel=1e-8, abs=1e-4)
        drive = LOAD * RADIUS**2 * (mode.shape[1] ** 2 + mode.shape[2] ** 2)
        assert mode.critical_fall == pytest.approx(2 * 0.005 * w / drive, rel=1e-12)
    assert modes[0].shape @ M @ modes[1].shape == pytest.approx(0, abs=1e-9)
