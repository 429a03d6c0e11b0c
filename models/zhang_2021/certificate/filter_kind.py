"""The adhesion filter of Zhang 2021: does its error die out, and is the variance it states true?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify import smtlib
from slipctl.certify.arithmetic.decimal_intervals import ln_of
from slipctl.certify.bounds import filters
from slipctl.certify.promise import check_whole
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    CONTINUOUS,
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
from slipctl.errors import BadInput
from slipctl.models.zhang_2021.certificate import chi_squared


def _dies_out(n: Numbers) -> Sequence[Side]:
    return [Side("0 < gamma", 0, n["gamma"])]


def _pole_step(n: Numbers, entry: Entries) -> str | None:
    """|e|/P falls at a sample, and P stays bounded; e the error on a constant force."""
    if not n["dt"]:
        return None
    term, plus, times = smtlib.term, smtlib.sum_term, smtlib.times
    grown, h, noise = 1 + n["gamma"], n["H"] * n["dt"], n["R"] * n["dt"]
    most = max(n["P"], n["gamma"] * noise / (grown * h * h))
    inverse = plus(times(h * h * grown, "P"), noise)
    facts = [
        term("<", 0, "P"), term("<=", "P", most), term("not", term("=", "e", 0)),
        term("=", times("later", inverse), times(noise, "e")),
        term("=", times("Q", inverse), times(noise * grown, "P")),
    ]  # fmt: skip
    fall = term("<", times("later", "later", "P", "P"), times("e", "e", "Q", "Q"))
    return smtlib.problem(("e", "P", "later", "Q"), facts, term("and", fall, term("<=", "Q", most)))


def _lemma(n: Numbers) -> Sequence[Side]:
    """Conditions of Lemma 2: process noise gamma P positive, P bounded, slopes bounded."""
    return [Side("0 < gamma P", 0, n["gamma"] * n["P"]), Side("0 < H^2", 0, n["H"] ** 2),
            Side("0 < R", 0, n["R"])]  # fmt: skip


def _settles(n: Numbers) -> Sequence[Side]:
    """ln(1 + (1/share - 1) P_ss/P) <= rate time, of whole samples."""
    gamma, dt = n["gamma"], n["dt"]
    if n["share"] >= 1:
        return [Side("1 <= share", 1, n["share"])]
    steady = gamma * n["R"] / n["H"] ** 2
    if dt > 0:
        steady = steady / ((1 + gamma) * dt)
    inside = 1 + (1 / n["share"] - 1) * steady / n["P"]
    if dt == 0:
        return [Side("ln(1 + (1/share - 1) P_steady/P) <= gamma time", ln_of(inside),
                     gamma * n["time"])]  # fmt: skip
    samples = math.floor(n["time"] / dt)
    return [Side("ln(1 + (1/share - 1) P_steady/P) <= ln(1 + gamma) samples", ln_of(inside),
                 ln_of(1 + gamma) * samples)]  # fmt: skip


def _consistent(n: Numbers) -> Sequence[Side]:
    """Expected mean NIS inside the band of 95 % that a consistent filter keeps."""
    gamma, R, H, dt, q, many = (n[k] for k in ("gamma", "R", "H", "dt", "q", "band_samples"))
    nis = filters.expected_nis(gamma, R, H, dt, q)
    if isinstance(nis, Fraction):
        below: Any = chi_squared.probability_below(nis * many, int(many))
    else:
        from scipy.special import gammainc

        below = float(gammainc(many / 2, nis * many / 2))
    low, high = Fraction(1, 40), Fraction(39, 40)
    return [Side("2.5 % <= chi-squared at the expected NIS", low, below),
            Side("chi-squared at the expected NIS <= 97.5 %", below, high)]  # fmt: skip


def _filter_guard(n: Numbers) -> None:
    if ("share" in n) != ("time" in n):
        told, other = ("share", "time") if "share" in n else ("time", "share")
        raise BadInput(f"{told} asks for nothing without {other}; add --set {other}=VALUE")
    if "q" in n and not n["dt"]:
        raise BadInput("q asks about samples; write a sample period dt above 0")
    check_whole("filter", n, "band_samples")
    if not n["band_samples"]:
        raise BadInput("band_samples = 0 must be 1 or more")


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
        if "q" in n:
            found["expected_nis"] = (filters.expected_nis(gamma, R, H, dt, n["q"]), "1")
    return found  # fmt: skip


def _filter_witness(n: Numbers) -> Witness:
    """Error of the noise-free filter on a constant force, from 1 N."""
    dt, gamma, c = n["dt"], n["gamma"], n["H"] ** 2 / n["R"]
    h = dt or 0.01 / gamma
    Y, e, kept = 1 / n["P"], 1.0, [1.0]
    for _ in range(4000):
        before = Y / (1 + gamma) if dt else Y * math.exp(-gamma * h)
        Y = before + c * h if dt else before + c * -math.expm1(-gamma * h) / gamma
        e *= before / Y
        kept.append(e)
    t = [h * k for k in range(len(kept))]
    until = next((a for a, b in zip(t, kept, strict=True) if b <= n.get("share", 0.5)), math.inf)
    return Witness(
        "none; error on a constant force without noise",
        {"time_to_that_share": (until, "s")},
        {"t": ("s", t[::10]), "error": ("1", kept[::10])},
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
        "dt": Number("s", "sample period; 0 for the continuous reading", 1e-3, "not negative",
                     role=INPUT, says="a sample time of {}", absent="a sample time"),
        "P": Number("N^2", "variance at the start", 4e6),
        "share": Number("1", "share of the error that may be left", optional=True, role=TARGET),
        "time": Number("s", "after which time", optional=True, role=TARGET),
        "q": Number("N^2/s", "drift of the force", None, "not negative", 0.0, True, role=TARGET),
        "band_samples": Number("1", "samples of the band of 95 %", 1000.0),
    },
    {
        "pole": Criterion("the error dies out: pole 1/(1 + gamma)", _dies_out, EXACT,
                          proves=("dies_out",), covers=("dt",), step=_pole_step),
        "lemma_2": Criterion("conditions of Lemma 2: noise positive, P bounded, slopes bounded",
                             _lemma),
        "in_time": Criterion("that share of the error is left after that time", _settles, EXACT,
                             ("smallest_gamma", "smallest_P", "smallest_time"), ("share", "time"),
                             proves=("in_time",), covers=("dt",), refutes="none; a constant force"),
        "consistent": Criterion("the expected NIS lies in its band of 95 %", _consistent, EXACT,
                                margins=("largest_q", "smallest_q"), needs=("q",),
                                proves=("true",), covers=("dt",),
                                refutes="a random walk of the force with the drift q"),
    },
    {
        "dies_out": Target("without noise the error on a constant force tends to zero"),
        "in_time": Target("at most the share {share} of that error is left from {time} on",
                          ("share", "time"), "a time"),
        "true": Target("on a random walk of drift {q} the variance that it states is true: the NIS"
                       " is expected inside the band of 95 % of {band_samples} samples", ("q",),
                       "that the variance it states is true"),
    },
    start="every force, of which P is the variance",
    values=_filter_values,
    witness=_filter_witness,
    guard=_filter_guard,
    time=lambda n: SAMPLED if n["dt"] else CONTINUOUS,
))  # fmt: skip
