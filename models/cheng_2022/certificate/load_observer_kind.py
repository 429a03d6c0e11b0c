"""System ``load_observer``: observer of a load torque; poles by python-control."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from fractions import Fraction

from slipctl.certify import smtlib
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    TARGET,
    Criterion,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)


def observer_poles(L1: float, L2: float, J: float) -> list[complex]:
    """Poles in 1/s of x = (w, T_L), w' = (T - T_L)/J, with gains L1, L2: s^2 + L1 s - L2/J."""
    root = cmath.sqrt(L1 * L1 + 4 * L2 / J)
    return [(-L1 + root) / 2, (-L1 - root) / 2]


def _hurwitz(n: Numbers) -> Sequence[Side]:
    return [Side("0 < L1", 0, n["L1"]), Side("0 < -L2/J", 0, -n["L2"] / n["J"])]


def _observer_step(n: Numbers, slowest: Fraction) -> str:
    """A quadratic function of (w, T_L/J) falls faster than exp(-2 slowest t).

    P solves A'P + PA = -I, A = [[s - L1, -1], [-L2/J, s]].
    """
    a, c, s = slowest - n["L1"], -n["L2"] / n["J"], slowest
    trace, det = a + s, a * s + c
    # P = -(det I + adj(A)' adj(A))/(2 trace det)
    p = [det + s * s + c * c, s - a * c, det + a * a + 1]
    P = [-x / (2 * trace * det) for x in (p[0], p[1], p[2])]
    return smtlib.shrinks([[a, -1], [c, s]], P, False, None)


def _fast(n: Numbers) -> Sequence[Side]:
    """Both poles left of -slowest: the same with s shifted."""
    p, q, s = n["L1"], -n["L2"] / n["J"], n["slowest"]
    return [Side("2 slowest < L1", 2 * s, p),
            Side("0 < slowest^2 - L1 slowest - L2/J", 0, s * s - p * s + q)]  # fmt: skip


def _observer_values(n: Numbers) -> dict[str, Quantity]:
    import control

    system = control.ss([[-n["L1"], -1 / n["J"]], [-n["L2"], 0]], [[0], [0]], [[1, 0]], [[0]])
    poles = sorted(system.poles(), key=lambda p: -p.real)
    return {
        "slow_pole": (float(poles[0].real), "1/s"), "fast_pole": (float(poles[1].real), "1/s"),
        "imaginary_part": (float(abs(poles[0].imag)), "1/s"),
    }  # fmt: skip


def _observer_witness(n: Numbers) -> Witness:
    """Error of the observer from (0, 1 N m)."""
    slow = observer_poles(n["L1"], n["L2"], n["J"])
    h = 0.02 / max(abs(p) for p in slow)
    w, T, rows = 0.0, 1.0, [1.0]
    for _ in range(4000):
        dw, dT = -n["L1"] * w - T / n["J"], -n["L2"] * w
        mid_w, mid_T = w + h / 2 * dw, T + h / 2 * dT
        w, T = w + h * (-n["L1"] * mid_w - mid_T / n["J"]), T - h * n["L2"] * mid_w
        rows.append(T)
        if abs(T) > 1e6:
            break
    return Witness(
        "none; error of the load from 1 N m", {"error_after_the_run": (abs(T), "N m"),
                                               "run": (h * (len(rows) - 1), "s")},
        {"t": ("s", [h * i for i in range(0, len(rows), 20)]), "error": ("N m", rows[::20])},
    )  # fmt: skip


LOAD_OBSERVER = register(System(
    "load_observer",
    "Cheng 2022 (11)-(13): w^' = (T - T_L^)/J + L1 (w - w^), T_L^' = L2 (w - w^): does the error"
    " die out?",
    {
        "L1": Number("1/s", "gain of the speed", low="any"),
        "L2": Number("kg m^2/s^2", "gain of the load", low="any"),
        "J": Number("kg m^2", "inertia at the motor"),
        "slowest": Number("1/s", "least decay wanted", optional=True, role=TARGET),
    },
    {
        "poles": Criterion("both poles left of 0 (Routh, Hurwitz)", _hurwitz, EXACT,
                           proves=("dies_out",), refutes="none; T_L^ wrong by 1 N m at the start",
                           step=lambda n, entry: _observer_step(n, Fraction(0))),
        "fast": Criterion("both poles left of -slowest", _fast, EXACT,
                          ("smallest_L1", "largest_slowest"), ("slowest",), proves=("fast",),
                          refutes="none; an error along the slower pole",
                          step=lambda n, entry: _observer_step(n, n["slowest"])),
    },
    {
        "dies_out": Target("the errors of speed and load tend to zero, while the load is constant"),
        "fast": Target("and faster than exp(-{slowest} t)", ("slowest",), "a rate of decay"),
    },
    never=("a load that changes", "the observer computed once per period", "measurement noise"),
    values=_observer_values,
    witness=_observer_witness,
    panel=({"L1": 80.0, "L2": -64000.0, "J": 40.0},),
))  # fmt: skip
