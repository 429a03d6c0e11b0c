"""Wheel on rail without the shortcuts of Polach's law: Carter's line contact and FASTSIM's ellipse.

Signs, falling friction and the floor of the speed are those of ``contact``; s_x = v_s/max(|v|,
v_min) is the creep and mu_vf the friction at the slip speed. Both laws are odd in v_s, pure creep
along the rail, without spin, and steady.

Carter (Proc. R. Soc. A 112 (1926) 151), a cylinder on a plane, semi-axis a along and b across:

    mu = mu_vf [1 - (1 - s)^2],  s = pi G a b k |s_x|/(2 (1 - nu) Q mu_vf) <= 1

FASTSIM (Kalker, Vehicle System Dynamics 11 (1982) 1) on an ellipse, with a parabolic bound of the
traction. Along each strip the traction grows from the leading edge until it meets the bound. Both
vanish there, so adhesion ends at one distance from the trailing edge on all strips, 2 a d. With
phi = arccos d and a strip at y = b sin t, the integral over the strips is

    mu = (4 mu_vf/pi) [4 d I_3 - 4 d^2 I_2 + 4 d^3/3 I_1 + 4/3 (3 pi/16 - I_4)],   d <= 1,
    I_n = integral of cos^n t from 0 to phi,
    d = (3/8) k KEPS |s_x|/mu_vf,  KEPS = G pi a b c11/(4 Q)

which is the limit of FASTSIM for fine grids. Its slope without creep is Kalker's, G a b c11/Q.

Beside Kalker's exact theory (CONTACT) both leave out how the tractions on one place bend the steel
at another. Neither knows dirt, roughness or a layer between wheel and rail but by k, the share of
the slope without creep that they leave.
"""

from __future__ import annotations

import math
from typing import Any

from casadi import acos, cos, exp, fabs, fmax, fmin, pi, sign, sin

from slipctl import Input, Output, Param, law
from slipctl.models.wheel_rail.contact import BESIDE, WHEEL_LOAD, patch, patch_of_curve

PATCH = patch()
CONTACT = "CONTACT, examples/tractcurv"
CLEAN = {"clean": {"k": 1.0, "A": 0.14 / 0.33, "B": 0.5545, "mu_0": 0.33}}
"""Smooth clean steel: Kalker's slope, and the friction that CONTACT was given for its falling
curves: .33 at rest, .14 at high slip, half of the rest at 1.25 m/s."""

READINGS = {"v_s": "creep * v", "mu": "force / Q"}


def friction(v_s: Any, A: Any, B: Any, mu_0: Any) -> Any:
    """Friction at a slip speed, as of ``contact``."""
    return mu_0 * ((1 - A) * exp(-B * fabs(v_s)) + A)


@law(
    mu=Output("1", "adhesion coefficient", positive="traction"),
    conditions=CLEAN, readings=READINGS, follows=patch_of_curve, beside=BESIDE,
    leaves_out="that tractions bend the steel elsewhere (Kalker's exact theory: CONTACT), spin and"
    " lateral creep, an elastic layer on the rail, heat",
    measured_to=0, meant_to=math.inf,
)  # fmt: skip
def fastsim(
    v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v=Input("m/s", "train speed"),
    k=Param("1", 1.0, "share of the slope without creep", "Kalker: 1", lo=1e-4, hi=100),
    A=Param("1", 0.14 / 0.33, "friction at high creep by that at none", CONTACT, lo=0, hi=1),
    B=Param("s/m", 0.5545, "decay of the friction", CONTACT, lo=1e-3, hi=10),
    mu_0=Param("1", 0.33, "friction without creep", CONTACT, lo=1e-3, hi=1),
    Q=Param("N", WHEEL_LOAD, "load of the wheel", "Wang 2025, Table 1", lo=1e3, hi=1e6),
    G=Param("Pa", PATCH["G"], "shear modulus", "guess", lo=1e8, hi=1e12),
    a=Param("m", PATCH["a"], "semi-axis of the patch, rolling", "Hertz", lo=1e-4, hi=0.1),
    b=Param("m", PATCH["b"], "semi-axis of the patch, lateral", "Hertz", lo=1e-4, hi=0.1),
    c11=Param("1", PATCH["c11"], "creep coefficient", "Kalker 1990, Table E.3", lo=1, hi=50),
    KEPS=Param("1", "G * pi * a * b * c11 / (4 * Q)", "stiffness by load", "FASTSIM"),
    v_min=Param(
        "m/s", 1.0, "speed below which the creep is not divided", "guess", lo=1e-3, hi=1000
    ),
):
    """Adhesion over creep by FASTSIM on an ellipse with a parabolic bound, in closed form."""
    mu_vf = friction(v_s, A, B, mu_0)
    d = fmin(1 - 1e-12, 3 / 8 * k * KEPS / mu_vf * fabs(v_s) / fmax(fabs(v), v_min))
    phi = acos(d)
    s, c = sin(phi), cos(phi)
    I_1, I_2, I_3 = s, (phi + s * c) / 2, s - s**3 / 3
    I_4 = 3 * phi / 8 + sin(2 * phi) / 4 + sin(4 * phi) / 32
    share = 4 * d * I_3 - 4 * d**2 * I_2 + 4 * d**3 / 3 * I_1 + 4 / 3 * (3 * pi / 16 - I_4)
    return sign(v_s) * mu_vf * 4 / pi * share


@law(
    mu=Output("1", "adhesion coefficient", positive="traction"),
    conditions=CLEAN, readings=READINGS,
    leaves_out="the ellipse of the patch (FASTSIM: fastsim; exactly: CONTACT), spin and lateral"
    " creep, an elastic layer on the rail, heat",
    measured_to=0, meant_to=math.inf,
)  # fmt: skip
def carter(
    v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v=Input("m/s", "train speed"),
    k=Param("1", 1.0, "share of the slope without creep", "Carter: 1", lo=1e-4, hi=100),
    A=Param("1", 0.14 / 0.33, "friction at high creep by that at none", CONTACT, lo=0, hi=1),
    B=Param("s/m", 0.5545, "decay of the friction", CONTACT, lo=1e-3, hi=10),
    mu_0=Param("1", 0.33, "friction without creep", CONTACT, lo=1e-3, hi=1),
    Q=Param("N", WHEEL_LOAD, "load of the wheel", "Wang 2025, Table 1", lo=1e2, hi=1e6),
    G=Param("Pa", PATCH["G"], "shear modulus", "guess", lo=1e8, hi=1e12),
    nu=Param("1", 0.28, "Poisson's ratio", "rail steel", lo=0, hi=0.5),
    R=Param("m", 0.445, "radius of the cylinder", "guess", lo=0.05, hi=5),
    b=Param("m", PATCH["b"], "half the width of the line", "guess", lo=1e-4, hi=1),
    a=Param("m", "sqrt(2 * Q * R * (1 - nu) / (pi * b * G))", "half its length", "Hertz, a line"),
    v_min=Param(
        "m/s", 1.0, "speed below which the creep is not divided", "guess", lo=1e-3, hi=1000
    ),
):
    """Adhesion over creep by Carter: a cylinder rolls on a plane, all across alike."""
    mu_vf = friction(v_s, A, B, mu_0)
    slope = pi * G * a * b * k / ((1 - nu) * Q)
    s = fmin(1, slope * fabs(v_s) / fmax(fabs(v), v_min) / (2 * mu_vf))
    return sign(v_s) * mu_vf * (1 - (1 - s) ** 2)
