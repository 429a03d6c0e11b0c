"""Carter's law and FASTSIM against CONTACT, and against a grid that shares nothing with them."""

import math

import numpy as np
import pytest

from slipctl.models.wheel_rail import hertz
from slipctl.models.wheel_rail.contact_reference import carter, fastsim

COULOMB = {"A": 1.0, "mu_0": 0.33}
SHAPE = hertz.ellipse_of_ratio(106.7e3, 0.8, 0.5, 2 * 82e9 * 1.28, 0.28)
WHEEL = {"Q": 106.7e3, "G": 82e9, "a": SHAPE.a, "b": SHAPE.b, "c11": hertz.c11(0.5, 0.28)}

SERIES_3 = {
    4e-4: 0.2577, 8e-4: 0.4653, 1.2e-3: 0.6281, 1.6e-3: 0.7521, 2e-3: 0.8433, 2.4e-3: 0.9075,
    2.8e-3: 0.9505, 3.2e-3: 0.9770, 3.6e-3: 0.9915, 4e-3: 0.9978, 4.4e-3: 0.9998, 4.8e-3: 1.0,
}  # fmt: skip
"""Creep and Fx/(FSTAT FN), CONTACT examples/tractcurv.ref_out (2025), cases 61 to 90: its FASTSIM
with a parabolic bound, on 44 strips of elements of 0.2889 mm."""

SERIES_1 = {
    4e-4: 0.2588, 8e-4: 0.4742, 1.2e-3: 0.6482, 1.6e-3: 0.7831, 2e-3: 0.8816, 2.4e-3: 0.9467,
    2.8e-3: 0.9832, 3.2e-3: 0.9976, 3.6e-3: 0.9991,
}  # fmt: skip
"""The same, cases 1 to 30: Kalker's exact theory."""


def share(law, creep: float, **values: float) -> float:
    found = law(v_s=10 * creep, v=10.0, **(COULOMB | values))["mu"]
    return float(found) / 0.33


def grid(creep: float, dx: float, strips: int) -> float:
    """FASTSIM as an algorithm: the traction grows from the leading edge, element by element."""
    a, b, G, Q = (WHEEL[n] for n in ("a", "b", "G", "Q"))
    L = 8 * a / (3 * G * WHEEL["c11"])
    p_0, total, dy = 2 * Q / (math.pi * a * b), 0.0, 2 * b / strips
    for y in -b + dy * (np.arange(strips) + 0.5):
        half = a * math.sqrt(1 - (y / b) ** 2)
        x, traction = half, 0.0
        while x > -half:
            step = min(dx, x + half)
            x -= step
            bound = 0.33 * p_0 * max(1 - ((x + step / 2) / a) ** 2 - (y / b) ** 2, 0.0)
            traction = min(traction + step * creep / L, bound)
            total += traction * step * dy
    return total / (0.33 * Q)


@pytest.mark.parametrize("creep", SERIES_3)
def test_fastsim_of_contact(creep):
    """Its elements end a traction at their end: up to 3 % more, which the closed form has not."""
    coarse = share(fastsim, creep, **WHEEL)
    assert -0.03 < coarse / SERIES_3[creep] - 1 < 1e-4
    # and the algorithm on its elements is what it printed
    assert grid(creep, 0.2889e-3, 44) == pytest.approx(SERIES_3[creep], rel=0.01)


@pytest.mark.parametrize("creep", [4e-4, 1.6e-3, 3.2e-3])
def test_closed_form_is_the_limit_of_fine_grids(creep):
    """The error of the algorithm falls with the elements, to a tenth at a tenth of their length."""
    exact = share(fastsim, creep, **WHEEL)
    coarse, fine = (grid(creep, dx, 200) / exact - 1 for dx in (3e-4, 3e-5))
    assert abs(fine) < 0.2 * abs(coarse) + 1e-3


@pytest.mark.parametrize("creep", SERIES_1)
def test_fastsim_beside_kalkers_exact_theory(creep):
    """What its assumption costs on this patch: at most 6 % of the friction, too little."""
    assert -0.06 < share(fastsim, creep, **WHEEL) - SERIES_1[creep] < 0.01


def test_slope_is_kalkers():
    slope = share(fastsim, 1e-9, **WHEEL) * 0.33 / 1e-9
    linear = WHEEL["G"] * WHEEL["a"] * WHEEL["b"] * WHEEL["c11"] / WHEEL["Q"]
    assert slope == pytest.approx(linear, rel=1e-4)


CYLINDER = {"Q": 35780.0, "G": 82e9, "nu": 0.28, "R": 0.5, "b": 0.1}
"""CONTACT examples/carter2d.inp: 200 mm wide, semi-axis 1.0 mm, adhesion on 0.6 of it."""


def test_carter_of_contact():
    assert float(carter.param_values(**CYLINDER)["a"]) == pytest.approx(1e-3, rel=1e-3)
    found = carter(v_s=10 * 2.4e-4, v=10.0, A=1.0, mu_0=0.3, **CYLINDER)["mu"] / 0.3
    # 1 - 0.6^2 = 0.64 by Carter's formula, 0.6480 in CONTACT's 50 elements
    assert found == pytest.approx(0.64, rel=1e-3)
    assert found == pytest.approx(0.6480, rel=0.015)


@pytest.mark.parametrize("law", [fastsim, carter])
def test_odd_whole_and_with_units(law):
    creep = np.geomspace(1e-5, 0.3, 60)
    up = np.array([share(law, x) for x in creep])
    assert np.allclose([share(law, -x) for x in creep], -up, rtol=1e-12)
    assert (np.diff(up) >= -1e-12).all()
    assert up[-1] == pytest.approx(1.0, abs=1e-9)
    assert not law.check_units()


@pytest.mark.parametrize("law", [carter, fastsim])
@pytest.mark.parametrize("v_s", [1e-4, 2e-3, 0.02])
def test_a_share_of_the_slope_is_a_share_of_the_creep(law, v_s):
    """Without falling friction the creep comes with its stiffness alone, below any saturation."""
    half = law(v_s=v_s, v=20.0, k=0.5, A=1.0)["mu"]
    assert half == pytest.approx(law(v_s=v_s / 2, v=20.0, k=1.0, A=1.0)["mu"], rel=1e-12)
    assert half < law(v_s=v_s, v=20.0, k=1.0, A=1.0)["mu"]
