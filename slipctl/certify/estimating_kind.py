"""Systems that estimate: least squares with forgetting, and the adhesion filter of Zhang 2021."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify import filters, outward
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    CONTINUOUS,
    EXACT,
    INPUT,
    NECESSARY,
    SAMPLED,
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


def _ln(x: Any) -> Any:
    return outward.Interval.of(x, 60).ln() if isinstance(x, Fraction) else math.log(x)


# ---- recursive least squares --------------------------------------------------------------------


def memory(forgetting: float) -> float:
    """Samples that count: 1/(1 - forgetting)."""
    return 1 / (1 - forgetting)


def covariance_growth(forgetting: float, samples: float) -> float:
    """Factor by which the covariance grows in samples without excitation: forgetting^-samples.

    Proof note: without a regressor P+ = P/forgetting.
    """
    return math.exp(-samples * math.log(forgetting))


def overflow_samples(forgetting: float, limit: float, start: float = 1.0) -> float:
    """Samples without excitation after which P passes a limit: ln(limit/start)/-ln(forgetting)."""
    return math.log(limit / start) / -math.log(forgetting)


def covariance_bounds(forgetting: float, least: float, most: float, S: int) -> tuple[float, float]:
    """Bounds of the eigenvalues of P in the long run under persistent excitation.

    least I <= sum of phi phi' over any S samples <= most I gives
    (1 - lam)/most <= ... <= P <= lam^-(S-1) (1 - lam^S)/least.

    Proof note: 1/P is the sum of lam^(age) phi phi'. Each window of S samples gives at least
    least lam^(S-1) at its newest end, and the windows are a geometric series of ratio lam^S; above,
    each gives at most most, so the sum is at most most/(1 - lam^S).
    """
    window = forgetting**S
    return (1 - window) / most, (1 - window) / (least * forgetting ** (S - 1))


def _forgets(n: Numbers) -> Sequence[Side]:
    return [Side("forgetting <= 1", n["forgetting"], 1)]


def _excited(n: Numbers) -> Sequence[Side]:
    return [Side("forgetting < 1", n["forgetting"], 1), Side("0 < least", 0, n["least"])]


def _bounded(n: Numbers) -> Sequence[Side]:
    if n["forgetting"] >= 1:
        return [*_forgets(n), Side("P < limit", n["P"], n["limit"])]
    growth = n["idle"] * -_ln(n["forgetting"])
    return [Side("idle ln(1/forgetting) < ln(limit/P)", growth, _ln(n["limit"] / n["P"]))]


def _rls_values(n: Numbers) -> dict[str, Quantity]:
    f = n["forgetting"]
    if f >= 1:
        return {"memory": (math.inf, "samples")}
    found = {
        "memory": (memory(f), "samples"),
        "covariance_doubles_in": (math.log(2) / -math.log(f), "samples"),
        "covariance_grows_by": (covariance_growth(f, min(n["idle"], 700 / -math.log(f))), "1"),
        "passes_the_limit_after": (overflow_samples(f, n["limit"], n["P"]), "samples"),
    }
    if n["least"] > 0:
        low, high = covariance_bounds(f, n["least"], n["most"], int(n["samples"]))
        found |= {"covariance_above": (low, "1"), "covariance_below": (high, "1")}
    return found


def _rls_witness(n: Numbers) -> Witness:
    """Covariance without a regressor, sample by sample."""
    P, k, rows = n["P"], 0, [n["P"]]
    while n["limit"] > P and k < min(n["idle"], 200_000) and n["forgetting"] <= 1:
        P, k = P / n["forgetting"], k + 1
        rows.append(P)
    every = max(1, len(rows) // 200)
    return Witness(
        "no excitation: the regressor is zero in one direction",
        {"samples_until_the_limit": (float(k), "samples"), "P": (P, "1")},
        {"k": ("samples", [float(i) for i in range(0, len(rows), every)]),
         "P": ("1", rows[::every])},
    )  # fmt: skip


RLS = register(System(
    "rls",
    "P+ = (P - ...)/forgetting: is the covariance bounded, with excitation least <= sum of phi phi'"
    " over `samples` <= most, and through `idle` samples without any?",
    {
        "forgetting": Number("1", "forgetting factor"),
        "P": Number("1", "covariance when the excitation ends", 1.0),
        "idle": Number("1", "samples without excitation", 0.0, "not negative", role=INPUT,
                       says="{} samples without excitation"),
        "limit": Number("1", "largest covariance allowed; the default is that of float",
                        3.4028234663852886e38),
        "least": Number("1", "least excitation of any direction in a window", 0.0, "not negative"),
        "most": Number("1", "largest excitation in a window", 1.0),
        "samples": Number("1", "length of the window", 50.0),
    },
    {
        "forgets": Criterion("0 < forgetting <= 1", _forgets, NECESSARY),
        "idle": Criterion("the covariance stays below the limit without excitation", _bounded,
                          EXACT, ("largest_idle", "smallest_forgetting", "smallest_limit"),
                          proves=("bounded",), covers=("idle",),
                          refutes="a regressor that is zero in one direction"),
        "excited": Criterion("persistently excited: the error dies out as forgetting^k",
                             _excited, margins=("largest_forgetting",)),
    },
    {"bounded": Target("the covariance stays below {limit}")},
    start="P = {P}",
    values=_rls_values,
    witness=_rls_witness,
    time=lambda n: SAMPLED,
))  # fmt: skip


# ---- the filter ---------------------------------------------------------------------------------


def _dies_out(n: Numbers) -> Sequence[Side]:
    return [Side("0 < gamma", 0, n["gamma"])]


def _lemma(n: Numbers) -> Sequence[Side]:
    """Conditions of Lemma 2: process noise gamma P positive, P bounded, slopes bounded."""
    return [Side("0 < gamma P", 0, n["gamma"] * n["P"]), Side("0 < H^2", 0, n["H"] ** 2),
            Side("0 < R", 0, n["R"])]  # fmt: skip


def _settles(n: Numbers) -> Sequence[Side]:
    """ln(1 + (1/share - 1) P_ss/P) <= rate time."""
    gamma, dt = n["gamma"], n["dt"]
    steady = gamma * n["R"] / n["H"] ** 2
    if dt > 0:
        steady = steady / ((1 + gamma) * dt)
    inside = 1 + (1 / n["share"] - 1) * steady / n["P"]
    right = gamma * n["time"] if dt == 0 else _ln(1 + gamma) * (n["time"] / dt)
    return [Side("share < 1", n["share"], 1),
            Side("ln(1 + (1/share - 1) P_steady/P) <= rate time", _ln(inside), right)]  # fmt: skip


def _consistent(n: Numbers) -> Sequence[Side]:
    """Mean NIS of the filter inside its band on a random walk of the drift q."""
    gamma, R, H, dt, q = (float(n[k]) for k in ("gamma", "R", "H", "dt", "q"))
    low, high = filters.nis_band(int(n["band_samples"]))
    nis = filters.expected_nis(gamma, R, H, dt, q)
    return [Side("lower end of the band <= expected NIS", low, nis),
            Side("expected NIS <= upper end of the band", nis, high)]  # fmt: skip


def _filter_values(n: Numbers) -> dict[str, Quantity]:
    dt = n["dt"] or None
    gamma, R, H = n["gamma"], n["R"], n["H"]
    found = {
        "time_constant": (filters.time_constant(gamma, dt), "s"),
        "half_of_the_error_after": (filters.settling_time(0.5, gamma, n["P"], R, H, dt), "s"),
        "steady_variance": (filters.steady_variance(gamma, R, H, dt), "N^2"),
    }
    if dt:
        q = filters.matched_drift(gamma, R, H, dt)
        found |= {
            "pole": (filters.pole(gamma), "1"),
            "matched_drift": (q, "N^2/s"),
            "expected_nis_on_a_constant": (filters.expected_nis(gamma, R, H, dt), "1"),
        }
    return found  # fmt: skip


def _filter_witness(n: Numbers) -> Witness:
    """Error of the noise-free filter on a constant force, from 1 N."""
    dt, gamma, c = n["dt"], n["gamma"], n["H"] ** 2 / n["R"]
    h = dt or 0.01 / gamma
    Y, e, rows = 1 / n["P"], 1.0, [1.0]
    for _ in range(4000):
        before = Y / (1 + gamma) if dt else Y * math.exp(-gamma * h)
        Y = before + c * h if dt else before + c * -math.expm1(-gamma * h) / gamma
        e *= before / Y
        rows.append(e)
    t = [h * k for k in range(len(rows))]
    until = next((a for a, b in zip(t, rows, strict=True) if b <= n.get("share", 0.5)), math.inf)
    return Witness(
        "none; error on a constant force without noise",
        {"time_to_that_share": (until, "s")},
        {"t": ("s", t[::10]), "error": ("1", rows[::10])},
    )


FILTER = register(System(
    "filter",
    "Zhang 2021 (18)-(33): force from the increments of a speed with slope H, P- = (1 + gamma) P"
    " per sample of dt, or P' = gamma P - ... for dt = 0: does the error die out, in time, and is"
    " the variance it states true?",
    {
        "gamma": Number("1", "growth of the variance per sample, or in 1/s for dt = 0"),
        "R": Number("rad^2/s^3", "noise of the speed"),
        "H": Number("1/(kg m)", "slope of the speed's rate by the force, r/I_w"),
        "dt": Number("s", "sample period; 0 for the continuous reading", 1e-3, "not negative"),
        "P": Number("N^2", "variance at the start", 4e6),
        "share": Number("1", "share of the error that may be left", optional=True, role=TARGET),
        "time": Number("s", "after which time", optional=True, role=TARGET),
        "q": Number("N^2/s", "drift of the force", None, "not negative", 0.0, True),
        "band_samples": Number("1", "samples of the band of 95 %", 1000.0),
    },
    {
        "pole": Criterion("the error dies out: pole 1/(1 + gamma)", _dies_out, EXACT,
                          proves=("dies_out",)),
        "lemma_2": Criterion("conditions of Lemma 2: noise positive, P bounded, slopes bounded",
                             _lemma),
        "in_time": Criterion("that share of the error is left after that time", _settles, EXACT,
                             ("smallest_gamma", "smallest_P", "smallest_time"), ("share", "time"),
                             proves=("in_time",), refutes="none; a constant force"),
        "consistent": Criterion("the mean NIS lies in its band of 95 %", _consistent,
                                margins=("largest_q", "smallest_q"), needs=("q",)),
    },
    {
        "dies_out": Target("the error tends to zero on a constant force without noise"),
        "in_time": Target("at most the share {share} of it is left after {time}",
                          ("share", "time"), "a time"),
        "true": Target("the variance it states is true on a drift of {q}", ("q",),
                       "that the variance is true"),
    },
    values=_filter_values,
    witness=_filter_witness,
    time=lambda n: SAMPLED if n["dt"] else CONTINUOUS,
))  # fmt: skip
