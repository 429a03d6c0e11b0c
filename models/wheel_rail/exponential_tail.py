"""Adhesion of a wheel that rolls, slips or stands: two exponentials of the slip, and a tail.

    mu = c (exp(-a v_s) - exp(-b v_s)) + s (1 - exp(-b v_s)),   0 < a < b

The first term is the law of Huang 2020, eq (4), ``double_exponential``. It goes to
zero at large slip, so that a locked wheel would not brake at all. The second one is added here: it
goes to s, what sliding steel keeps. The one peak is at v_s* = ln(b (c + s)/(a c))/(b - a).

Where the numbers are from. a and b are of Table 1 of that paper. On dry rail s is a third of the
peak, as much as Polach's law has at large slip with A = 0.36 (Wang 2025, Table 3). So four locked
wheels slow a vehicle on level dry rail by s g = 0.98 m/s^2. The other conditions are guesses with a
peak near that of Table 1. No number was measured.
"""

import math

from casadi import exp, log

from slipctl import Input, Output, Param, law

TABLE_1 = "Huang 2020, Table 1"
GUESS = "guess, a third of the peak on dry rail"

SURFACES = {
    "dry": {"c": 0.8, "s": 0.10},
    "wet": {"c": 0.2, "s": 0.05},
    "leaves": {"c": 0.09, "s": 0.03},
    "ice": {"c": 0.065, "s": 0.015},
}
"""Peaks 0.308 at 1.39 m/s, 0.098 at 1.55 m/s, 0.050 at 1.65 m/s, 0.030 at 1.52 m/s."""


def peak_slip(c: float, a: float, b: float, s: float) -> float:
    """Slip speed of the peak in m/s: a c exp(-a v_s) = b (c + s) exp(-b v_s) there."""
    return log(b * (c + s) / (a * c)) / (b - a)


@law(
    mu=Output("1", "adhesion coefficient", positive="braking",
              source="twice what steel on steel can have", lo=-2, hi=2),
    conditions=SURFACES,
    closed_form=peak_slip,
    measured_to=0,
    meant_to=math.inf,
)  # fmt: skip
def exponential_tail(
    v_s=Input("m/s", "slip speed, vehicle minus rim", positive="braking", per="speed"),
    c=Param("1", 0.8, "height above the tail", "guess, peak near Table 1", lo=1e-3, hi=5),
    a=Param("s/m", 0.54, "slow decay", TABLE_1, lo=1e-3, hi=10),
    b=Param("s/m", 1.2, "fast decay", TABLE_1, lo=1e-3, hi=20),
    s=Param("1", 0.10, "adhesion of a wheel that slides fast or is locked", GUESS, lo=0, hi=0.5),
):
    """Adhesion by two exponentials of the slip speed and a tail: a locked wheel keeps s."""
    return c * (exp(-a * v_s) - exp(-b * v_s)) + s * (1 - exp(-b * v_s))
