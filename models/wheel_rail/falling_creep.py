"""Creep law with a floor: what a locked wheel keeps, and a rail that is cleaned, are both in it.

    mu(s) = mu_0 ((1 - A) exp(-B |s|) + A)/(1 + k_v |v|)
    eps   = c e/mu(s),   e = s/sqrt(v^2 + v_0^2)
    f     = (2 mu/pi) [k_A eps/(1 + (k_A eps)^2) + arctan(k_S eps)]

s is the slip speed, rim minus train. This is the form of Polach, Wear 258 (2005) 992. One number c
stands in the place of the patch: the curve begins with the slope (2/pi)(k_A + k_S) c, whatever the
friction is. At large slip it goes to the floor A mu_0. The friction falls with the speed by k_v,
which is 0 by default. v_0 keeps the creep finite at standstill.

The numbers are examples, none was measured: clean rail has a peak near 0.13 at 25 m/s, the layer of
leaves near 0.04.
"""

import math

from casadi import atan, exp, fabs, pi, sqrt

from slipctl import Input, Output, Param, law

EXAMPLE = "example of a wet rail, not measured"

SURFACES = {
    "clean": {"mu_0": 0.15, "A": 0.5, "B": 0.15},
    "leaves": {"mu_0": 0.04, "A": 0.7, "B": 0.2},
}
"""Rail that was cleaned by wheels, and under a layer of leaves."""


@law(
    mu=Output("1", "adhesion coefficient", positive="traction"),
    conditions=SURFACES,
    leaves_out="the patch, spin and lateral creep, heat",
    measured_to=0,
    meant_to=math.inf,
)
def falling_creep(
    v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v=Input("m/s", "train speed"),
    mu_0=Param("1", 0.15, "friction without slip", EXAMPLE, lo=1e-3, hi=1),
    A=Param("1", 0.5, "friction at large slip by that at none", EXAMPLE, lo=0, hi=1),
    B=Param("s/m", 0.15, "decay of the friction with slip", EXAMPLE, lo=0, hi=10),
    k_A=Param("1", 0.3, "share of the area of adhesion", EXAMPLE, lo=1e-4, hi=100),
    k_S=Param("1", 0.1, "share of the area of slip", EXAMPLE, lo=1e-4, hi=100),
    c=Param("1", 300.0, "stiffness of the contact by its load", EXAMPLE, lo=1, hi=1e5),
    k_v=Param("s/m", 0.0, "fall of the friction with speed", EXAMPLE, lo=0, hi=1),
    v_0=Param("m/s", 0.1, "speed that keeps the creep finite", EXAMPLE, lo=1e-3, hi=10),
):
    """Adhesion over creep with a floor at large slip, after Polach."""
    w = sqrt(v * v + v_0 * v_0)
    mu = mu_0 * ((1 - A) * exp(-B * fabs(v_s)) + A) / (1 + k_v * fabs(v))
    eps = c / mu * v_s / w
    return 2 * mu / pi * (k_A * eps / (1 + (k_A * eps) ** 2) + atan(k_S * eps))
