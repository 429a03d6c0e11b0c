"""A linear loop behind a lag; poles and margins by python-control."""

from __future__ import annotations

import cmath
import math
import warnings
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify import smtlib
from slipctl.certify.arithmetic import decimal_intervals
from slipctl.certify.arithmetic.bisection import bisect
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    SAMPLED,
    Criterion,
    Entries,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)


def sampled_open_loop(K: float, lag: float, T: float) -> Any:
    """Open loop of e' = a, lag a' = -K e - a with the input held over T, as python-control has it.

    Without a lag it is K T/(z - 1).
    """
    import control
    from scipy.signal import BadCoefficients

    if lag == 0:
        return control.tf([K * T], [1, -1], T)
    with warnings.catch_warnings():
        # for lag >> T the first coefficients, below 1e-14 of the others, are left out
        warnings.simplefilter("ignore", BadCoefficients)
        return control.sample_system(control.tf([K], [lag, 1, 0]), T)


def loop_coefficients(lag: float, T: float) -> tuple[float, float, float]:
    """1 - E, b1 and b0 of the open loop K (b1 z + b0)/((z - 1)(z - E)), E = exp(-T/lag).

    b1 = T - lag (1 - E) and b0 = lag (1 - E) - T E, by their series where T/lag is small.
    """
    x = T / lag
    gone = -math.expm1(-x)
    if x > 1e-3:
        return gone, T - lag * gone, lag * gone - T * (1 - gone)
    return gone, T * x * (1 / 2 - x / 6 + x * x / 24), T * x * (1 / 2 - x / 3 + x * x / 8)


def open_loop(K: float, lag: float, T: float, w: float) -> complex:
    """``sampled_open_loop`` at the frequency w, without differences of nearly equal numbers."""
    turn = _expm1(w * T)  # z - 1
    if lag == 0:
        return K * T / turn
    gone, b1, b0 = loop_coefficients(lag, T)
    return K * (b1 * (turn + 1) + b0) / (turn * (turn + gone))


def _expm1(angle: float) -> complex:
    """exp(i angle) - 1."""
    return complex(-2 * math.sin(angle / 2) ** 2, math.sin(angle))


def loop_margins(K: float, lag: float, T: float) -> dict[str, Quantity]:
    """Largest |pole|, gain margin, phase margin in degrees and delay margin.

    Proof note: the gain margin is the largest K by Jury's conditions over K. The poles lie at 1 and
    E, the zero in (-1, 0), so |L| falls from 0 to the end of the frequencies, pi/T. It passes 1
    once, or, where |L| > 1 there, never, and the loop has no delay margin of its own.
    """
    import control

    slow = float(max(abs(p) for p in control.feedback(sampled_open_loop(K, lag, T)).poles()))
    found: dict[str, Quantity] = {"largest_pole": (slow, "1")}
    if slow >= 1:
        return found
    found["time_constant"] = (-T / math.log(slow) if slow > 0 else 0.0, "s")
    most = 2 / T
    if lag > 0:
        gone, b1, b0 = loop_coefficients(lag, T)
        most = min(gone / b0, 2 * (2 - gone) / (b1 - b0)) if b1 > b0 else gone / b0
    found["gain_margin"] = (most / K, "1")

    def size(w: float) -> float:
        return abs(open_loop(K, lag, T, w))

    end = math.pi / T
    if size(end) < 1:
        crossing = bisect(size, 1.0, 1e-3 * min(K, end), end)
        margin = math.pi / 2 + cmath.phase(1j * open_loop(K, lag, T, crossing))
        found["phase_margin"] = (math.degrees(margin), "deg")
        found["delay_margin"] = (margin / crossing, "s")
    return found


def _jury(n: Numbers) -> Sequence[Side]:
    """Jury's conditions of z^2 + (..) z + (..), or of z - 1 + K T without a lag."""
    K, T = n["K"], n["T"]
    if n["lag"] == 0:
        return [Side("K T < 2", K * T, 2)]
    lag = n["lag"]
    exact = isinstance(lag, Fraction)
    E = decimal_intervals.Interval.of(-T / lag, 60).exp() if exact else math.exp(-T / lag)
    reach = T - lag * (1 - E)
    one, zero = K * reach - 1 - E, E + K * (lag * (1 - E) - T * E)
    return [Side("p0 < 1", zero, 1), Side("0 < 1 + p1 + p0", 0, 1 + one + zero),
            Side("0 < 1 - p1 + p0", 0, 1 - one + zero)]  # fmt: skip


def _lag_step(n: Numbers, entry: Entries) -> str | None:
    """A quadratic function falls at every tick, for each E = exp(-T/lag) of its enclosure."""
    import numpy as np
    from scipy.linalg import solve_discrete_lyapunov

    K, T, lag = n["K"], n["T"], n["lag"]
    if lag == 0:
        return smtlib.shrinks([[1 - K * T, 0], [0, 0]], [1, 0, 1], True, None)
    E = decimal_intervals.Interval.of(-T / lag, 60).exp()
    e = float(E.ends()[0])
    # states e and a T, so that P is of ordinary size
    gone, b1, _ = loop_coefficients(float(lag), float(T))
    rows = [[1 - float(K) * b1, float(lag / T) * gone], [-float(K * T) * gone, e]]
    found = solve_discrete_lyapunov(np.array(rows).T, np.eye(2))
    P = [Fraction(float(f"{v:.9g}")).limit_denominator(10**9)
         for v in (found[0, 0], found[0, 1], found[1, 1])]  # fmt: skip
    gone_term = smtlib.sum_term(1, smtlib.times(-1, "E"))
    A = [
        [smtlib.sum_term(1 - K * T, smtlib.times(K * lag, gone_term)),
         smtlib.times(lag / T, gone_term)],
        [smtlib.times(-K * T, gone_term), "E"],
    ]  # fmt: skip
    low, high = E.ends()
    digits = 10**15  # outwards: short numbers make the solver's work short
    ends = Fraction(math.floor(low * digits), digits), Fraction(math.ceil(high * digits), digits)
    return smtlib.shrinks(A, P, True, ends)


def _lag_witness(n: Numbers) -> Witness:
    """Sampled loop from e = 1."""
    K, lag, T = n["K"], n["lag"], n["T"]
    E = math.exp(-T / lag) if lag > 0 else 0.0
    e, a, rows = 1.0, 0.0, [1.0]
    for _ in range(2000):
        u = -K * e
        e, a = e + T * u + (a - u) * lag * (1 - E), u + (a - u) * E
        rows.append(e)
        if abs(e) > 1e6:
            break
    return Witness(
        "none; from e = 1", {"|e|_after_the_run": (max(map(abs, rows[-3:])), "1"),
                             "run": (T * (len(rows) - 1), "s")},
        {"t": ("s", [T * i for i in range(len(rows))]), "e": ("1", rows)},
    )  # fmt: skip


LAGGED_LOOP = register(System(
    "lagged_loop",
    "A feedback-linearised loop, e' = a, lag a' = u - a, u = -K e held over T: is it stable, with"
    " which margins?",
    {
        "K": Number("1/s", "gain"),
        "T": Number("s", "sample period", role=INPUT, says="an input held over T = {}"),
        "lag": Number("s", "time constant of the actuator", 0.0, "not negative", role=INPUT,
                      says="a lag of {}", absent="a lag of the actuator"),
    },
    {
        "poles": Criterion("poles inside the unit circle (Jury)", _jury, EXACT,
                           ("largest_K", "largest_T"), proves=("dies_out",), covers=("T", "lag"),
                           refutes="none; e = 1 and a = 0 at the start", step=_lag_step),
    },
    {"dies_out": Target("e tends to zero")},
    never=("a disturbance", "a dead time"),
    values=lambda n: loop_margins(n["K"], n["lag"], n["T"]),
    witness=_lag_witness,
    panel=({"K": 100.0, "T": 1e-3, "lag": 0.05},),
    time=lambda n: SAMPLED,
))  # fmt: skip
