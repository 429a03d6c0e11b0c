"""Systems that seek an extremum: sliding mode (Cheng 2022) and perturbation."""

from __future__ import annotations

import math
from collections.abc import Sequence

from slipctl.certify import extremum as bounds
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    Criterion,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)

# ---- sliding mode -------------------------------------------------------------------------------


def _slides(n: Numbers) -> Sequence[Side]:
    return [Side("rho < k slope", n["rho"], n["k"] * n["slope"])]


def _hears(n: Numbers) -> Sequence[Side]:
    return [Side("2 rho T <= beta", 2 * n["rho"] * n["T"], n["beta"])]


def _ripples(n: Numbers) -> Sequence[Side]:
    return [Side("k beta <= ripple rho", n["k"] * n["beta"], n["ripple"] * n["rho"])]


def _in_time(n: Numbers) -> Sequence[Side]:
    return [Side("gap <= rho time", n["gap"], n["rho"] * n["time"])]


def _sliding_values(n: Numbers) -> dict[str, Quantity]:
    k, rho, beta = n["k"], n["rho"], n["beta"]
    found = {
        "sliding_somewhere": (float(bounds.regime(k, rho, n["slope"]) == bounds.SLIDING), "1"),
        "rate_at_that_slope": (bounds.averaged_rate(k, rho, n["slope"]), "m/s^2"),
        "ripple_at_the_peak": (bounds.ripple(k, beta, rho), "m/s"),
        "ripple_at_the_peak_sampled": (bounds.sampled_ripple(k, beta, rho, n["T"]), "m/s"),
    }
    if "curvature" in n:
        found |= {
            "last_time_constant": (bounds.time_constant(k, rho, n["curvature"]), "s"),
            "sliding_stops_at": (bounds.sliding_zone(k, rho, n["curvature"]), "m/s"),
        }
    return found


def _sliding_witness(n: Numbers) -> Witness:
    """Seeker on a constant slope: in a sliding mode the speed is rho/mu', here it is not."""
    k, rho, beta, slope = n["k"], n["rho"], n["beta"], n["slope"]
    cycle = 2 * beta * rho / max(rho * rho - (k * slope) ** 2, 1e-12 * rho * rho)
    h = min(n["T"], cycle / 400)
    v, delta, rows, most = 0.0, 0.5 * beta, [(0.0, 0.0)], 40_000
    for i in range(1, most + 1):
        sign = math.copysign(1.0, math.sin(math.pi * delta / beta))
        v, delta = v + h * k * sign, delta + h * (k * slope * sign - rho)
        rows.append((i * h, v))
        if i * h > 20 * cycle:
            break
    t, rate = rows[-1][0], v / rows[-1][0]
    every = max(1, len(rows) // 200)
    return Witness(
        f"none; on a constant slope of {slope:g} s/m the seeker does not slide, it still climbs",
        {"mean_rate": (rate, "m/s^2"), "rate_of_a_sliding_mode": (rho / slope, "m/s^2"),
         "run": (t, "s")},
        {"t": ("s", [r[0] for r in rows[::every]]), "v": ("m/s", [r[1] for r in rows[::every]])},
    )  # fmt: skip


SLIDING_SEEK = register(System(
    "sliding_seek",
    "Cheng 2022 (22)-(36): v' = k sgn sin(pi (mu(v) - g)/beta), g' = rho: is there a sliding mode,"
    " in which mu climbs at rho, where mu has its steepest slope?",
    {
        "k": Number("m/s^2", "rate of v", power=1.0),
        "rho": Number("1/s", "rate of g"),
        "beta": Number("1", "width of a cell"),
        "slope": Number("s/m", "steepest |mu'|", power=-1.0),
        "T": Number("s", "sample period"),
        "curvature": Number("s^2/m^2", "mu'' at the peak", None, "any", -2.0, True),
        "ripple": Number("m/s", "wanted ripple of v at the peak", power=1.0, optional=True),
        "gap": Number("1", "mu to be gained", optional=True),
        "time": Number("s", "in which time", optional=True),
    },
    {
        "sliding": Criterion("a sliding mode exists at the steepest slope", _slides, EXACT,
                             ("largest_rho", "smallest_k", "smallest_slope")),
        "hears": Criterion("two ticks fit into a cell", _hears,
                           margins=("largest_T", "largest_rho", "smallest_beta")),
        "ripple": Criterion("k beta/rho is the ripple at the peak", _ripples,
                            margins=("largest_beta", "smallest_rho"), needs=("ripple",)),
        "in_time": Criterion("mu climbs at rho at most, so that the gap takes gap/rho", _in_time,
                             margins=("smallest_rho",), needs=("gap", "time")),
    },
    {"climbs": Target("v climbs to the peak")},
    values=_sliding_values,
    witness=_sliding_witness,
    panel=({"k": 1.0, "rho": 0.1, "beta": 0.02, "slope": 0.66, "T": 2e-4, "ripple": 0.1},
     {"k": 1.0, "rho": 1.0, "beta": 0.1, "slope": 0.66, "T": 2e-4}),
))  # fmt: skip


# ---- perturbation -------------------------------------------------------------------------------


def _seeks(n: Numbers) -> Sequence[Side]:
    return [Side("k curvature < 0", n["k"] * n["curvature"], 0)]


def _separated(n: Numbers) -> Sequence[Side]:
    return [Side("5 w_l <= w", 5 * n["w_l"], n["w"]),
            Side("5 w_h <= w", 5 * n["w_h"], n["w"])]  # fmt: skip


def _carried(n: Numbers) -> Sequence[Side]:
    return [Side("10 w T <= 6.283", 10 * n["w"] * n["T"], 6.283)]


def _slow(n: Numbers) -> Sequence[Side]:
    """Both averaged poles are slow against the dither: 5 |p| <= w."""
    p = bounds.perturbation_poles(*(float(n[k]) for k in ("k", "w_l", "a", "curvature")))
    return [Side("5 |pole| <= w", bounds.SEPARATION * max(abs(x) for x in p), float(n["w"]))]


def _perturbation_values(n: Numbers) -> dict[str, Quantity]:
    gain = bounds.washout(n["w"], n["w_h"])
    slow, fast = bounds.perturbation_poles(n["k"], n["w_l"], n["a"], n["curvature"], gain)
    found = {
        "slow_pole": (slow.real, "1/s"), "slow_pole_imaginary": (slow.imag, "1/s"),
        "fast_pole": (fast.real, "1/s"),
        "loss_of_mu": (bounds.perturbation_loss(n["a"], n["curvature"]), "1"),
        "washout": (gain, "1"),
    }  # fmt: skip
    if "third" in n:
        bias = bounds.perturbation_bias(n["a"], n["curvature"], n["third"])
        found["bias"] = (bias, "m/s")
    return found


def _perturbation_witness(n: Numbers) -> Witness:
    """Seeker on the parabola of the curvature, from one amplitude beside the peak."""
    k, w_l, w_h, w, a = (n[x] for x in ("k", "w_l", "w_h", "w", "a"))
    h, th, xi, eta, rows = 2 * math.pi / w / 40, a, 0.0, 0.0, [(0.0, a)]
    pole = bounds.perturbation_poles(k, w_l, a, n["curvature"])[0].real
    span = min(3 / max(pole, 1e-9), 4000 * h * 40)
    for i in range(1, int(min(span / h, 160_000)) + 1):
        s = math.sin(w * i * h)
        y = n["curvature"] / 2 * (th + a * s) ** 2
        th, xi, eta = (th + h * k * xi, xi + h * w_l * ((y - eta) * s - xi),
                       eta + h * w_h * (y - eta))  # fmt: skip
        rows.append((i * h, th))
        if abs(th) > 1e3 * a:
            break
    every = max(1, len(rows) // 200)
    return Witness(
        "none; from one amplitude beside the peak of a parabola of that curvature",
        {"distance_over_the_start": (abs(th) / a, "1"), "run": (rows[-1][0], "s")},
        {"t": ("s", [r[0] for r in rows[::every]]), "th": ("m/s", [r[1] for r in rows[::every]])},
    )


PERTURBATION_SEEK = register(System(
    "perturbation_seek",
    "v = th + a sin wt, th' = k xi, xi' = w_l ((y - eta) sin wt - xi), eta' = w_h (y - eta): does"
    " the averaged loop seek the extremum?",
    {
        "k": Number("m/s^2", "gain, in v/mu per s", low="any", power=1.0),
        "w": Number("1/s", "dither"),
        "w_l": Number("1/s", "corner of the low-pass"),
        "w_h": Number("1/s", "corner of the washout"),
        "a": Number("m/s", "amplitude of the dither", power=1.0),
        "curvature": Number("s^2/m^2", "mu'' at the extremum", None, "any", -2.0),
        "third": Number("s^3/m^3", "mu''' there", None, "any", -3.0, True),
        "T": Number("s", "sample period", 1e-3),
    },
    {
        "averaged": Criterion("the averaged loop is stable (exact for w -> infinity)", _seeks,
                              EXACT),
        "separated": Criterion("the dither is 5 times faster than both corners (a rule)",
                               _separated, margins=("smallest_w", "largest_w_l", "largest_w_h")),
        "slow": Criterion("both averaged poles are 5 times slower than the dither (a rule)", _slow,
                          margins=("smallest_w", "largest_a")),
        "carried": Criterion("ten ticks to a period of the dither (a rule)", _carried,
                             margins=("largest_w", "largest_T")),
    },
    {"seeks": Target("th tends to the neighbourhood of the extremum")},
    values=_perturbation_values,
    witness=_perturbation_witness,
    panel=({"k": 200.0, "w": 12.566, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544},
     {"k": -2.0, "w": 1.0, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544, "T": 1.0}),
))  # fmt: skip
