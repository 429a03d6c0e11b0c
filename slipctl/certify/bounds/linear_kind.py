"""Linear parts: a loop behind a lag, an observer of a load; poles and margins by python-control."""

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
    TARGET,
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

# ---- a feedback-linearised loop behind a lag ----------------------------------------------------


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


# ---- observer of a load -------------------------------------------------------------------------


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
