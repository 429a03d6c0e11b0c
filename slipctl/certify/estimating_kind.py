"""Systems that estimate: least squares with forgetting, and the adhesion filter of Zhang 2021."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify import chi_squared, decimal_intervals, filters, rls_covariance, smtlib
from slipctl.certify.checksum import with_checksum, without_checksum
from slipctl.certify.entries import DoesNotHold, whole
from slipctl.certify.registry import register
from slipctl.certify.rls_covariance import (
    covariance_bounds,
    covariance_growth,
    memory,
    overflow_samples,
)
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
    Refuter,
    Side,
    System,
    Target,
    Witness,
    number_text,
)
from slipctl.errors import BadInput

__all__ = [
    "FILTER", "RLS", "covariance_bounds", "covariance_growth", "memory", "overflow_samples",
]  # fmt: skip


def _ln(x: Any) -> Any:
    return decimal_intervals.Interval.of(x, 60).ln() if isinstance(x, Fraction) else math.log(x)


def _whole(system: str, n: Numbers, *names: str) -> None:
    for name in names:
        if name in n and (n[name] != int(n[name]) or n[name] > 10**15):
            raise BadInput(
                f"{system}: {name} = {float(n[name]):g} must be a whole number, at most 1e15"
            )


# ---- recursive least squares --------------------------------------------------------------------


def _never_above(n: Numbers) -> Sequence[Side]:
    return [Side(*s) for s in rls_covariance.largest_sides(n)]


def _excited(n: Numbers) -> Sequence[Side]:
    return [Side("forgetting <= 1", n["forgetting"], 1), Side("0 < least", 0, n.get("least", 0))]


def _rls_guard(n: Numbers) -> None:
    if n["forgetting"] > 1:
        raise BadInput(f"forgetting = {float(n['forgetting']):g} must be above 0 and at most 1")
    _whole("rls", n, "samples", "idle")
    if n.get("least", 0) > n["most"]:
        raise BadInput(f"least = {float(n['least']):g} must not exceed most = {float(n['most']):g}")


def _rls_values(n: Numbers) -> dict[str, Quantity]:
    f = n["forgetting"]
    if f >= 1:
        return {"memory": (math.inf, "samples")}
    found = {
        "memory": (memory(f), "samples"),
        "covariance_doubles_in": (math.log(2) / -math.log(f), "samples"),
        "covariance_grows_by": (covariance_growth(f, n["idle"]), "1"),
        "passes_the_limit_after": (max(overflow_samples(f, n["limit"], n["P"]), 0.0), "samples"),
    }
    if n.get("least"):
        low, high = covariance_bounds(f, n["least"], n["most"], int(n["samples"]))
        found |= {"covariance_above": (low, "1"), "covariance_below": (high, "1")}
    return found


def _rls_witness(n: Numbers) -> Witness:
    """Covariance without a regressor, sample by sample."""
    P, k, kept = n["P"], 0, [n["P"]]
    while n["limit"] >= P and k < 200_000 and n["forgetting"] < 1:
        P, k = P / n["forgetting"], k + 1
        kept.append(P)
    every = max(1, len(kept) // 200)
    return Witness(
        "no excitation: the regressor is zero in one direction",
        {"samples_until_the_limit": (float(k), "samples"), "P": (P, "1")},
        {"k": ("samples", [float(i) for i in range(0, len(kept), every)]),
         "P": ("1", kept[::every])},
    )  # fmt: skip


def _allowed_quiet(n: Numbers) -> int | None:
    """Samples that may pass without excitation; None if nothing says so."""
    idle = math.floor(n["idle"])
    if not n.get("least"):
        return idle or None
    return int(rls_covariance.quiet(idle, n["samples"]))


def _find_growth(n: Numbers) -> Entries | None:
    if n["forgetting"] >= 1:
        return with_checksum(n, {"windows": 0, "quiet": 0}) if n["P"] > n["limit"] else None
    lam, rate = float(n["forgetting"]), -math.log(float(n["forgetting"]))
    allowed = _allowed_quiet(n)
    if allowed is None:
        more = (math.log(float(n["limit"])) - math.log(float(n["P"]))) / rate
        return with_checksum(n, {"windows": 0, "quiet": max(math.ceil(more * (1 + 1e-9)), 0) + 1})
    found: list[tuple[int, int]] = [(0, allowed)]
    if n.get("least"):
        S = int(n["samples"])
        for m in (1, 3, 10, 30, math.ceil(80 / (rate * S))):
            found.append((m, allowed - (S - 1)))
        found = [f for f in found if f[1] >= 0 and lam < 1]
    for windows, still in found:
        run = with_checksum(n, {"windows": windows, "quiet": still})
        try:
            _replay_growth(n, run)
        except DoesNotHold:
            continue
        return run
    return None


def _replay_growth(n: Numbers, run: Entries) -> str:
    """Windows with their excitation in the first sample, then quiet; by enclosures of logarithms.

    The last window counts S - 1 quiet samples itself, so that so many fewer may follow it.
    """
    run = without_checksum(n, run, ("windows", "quiet"), "run")
    windows = whole(run["windows"], "run.windows", 0, 10**12)
    still = whole(run["quiet"], "run.quiet", 0, 10**18)
    allowed = _allowed_quiet(n)
    if windows and not n.get("least"):
        raise DoesNotHold("run: no excitation is known")
    most = None if allowed is None else allowed - (int(n["samples"]) - 1 if windows else 0)
    if most is not None and still > most:
        raise DoesNotHold("run: it is quiet for longer than was asked")
    if n["forgetting"] >= 1:
        if windows or still or not n["P"] > n["limit"]:
            raise DoesNotHold("run: P does not exceed the limit")
        return "P exceeds the limit from the start"
    found = rls_covariance.covariance_after(n, windows, still)
    if not found.ends()[0] > _ln(n["limit"]).ends()[1]:
        raise DoesNotHold("run: P does not exceed the limit")
    before = f"after {windows} windows with their excitation in the first sample, " \
        if windows else ""  # fmt: skip
    return f"{before}{still} samples without excitation take P beyond the limit"


def _rls_claim(n: Numbers, _: Entries) -> str:
    limit = number_text(n["limit"], "1")
    if n["forgetting"] < 1 and not n.get("least") and n["idle"] > 0:
        return f"P, in any direction, never exceeds {limit} through these samples"
    return f"P, in any direction, never exceeds {limit}"


def _rls_start(n: Numbers) -> str:
    start = f"P = {number_text(n['P'], '1')}"
    if n.get("least"):
        words = (number_text(n[k], "1") for k in ("least", "most", "samples"))
        return start + ", with excitation {} <= sum of phi phi' <= {} over any {} samples".format(
            *words
        ) + (" before and after the pause" if n["idle"] else "")  # fmt: skip
    if n["forgetting"] < 1 and n["idle"] > 0:
        return f"{start}, through the first {number_text(n['idle'], '1')} samples"
    return f"{start}, whatever the regressor"


RLS = register(System(
    "rls",
    "P+ = (P - ...)/forgetting: does the covariance stay below a limit, with excitation least <="
    " sum of phi phi' <= most over any `samples`, and through one pause of `idle` samples?",
    {
        "forgetting": Number("1", "forgetting factor, at most 1"),
        "P": Number("1", "covariance at the start", 1.0),
        "idle": Number("1", "samples of a pause without excitation", 0.0, "not negative",
                       role=INPUT, says="one pause of {} samples without excitation",
                       absent="a pause without excitation"),
        "limit": Number("1", "largest covariance allowed; the default is that of float",
                        3.4028234663852886e38),
        "least": Number("1", "least excitation of any direction in a window", None, "not negative",
                        optional=True),
        "most": Number("1", "largest excitation in a window", 1.0),
        "samples": Number("1", "length of the window", 50.0),
    },
    {
        "bounded": Criterion("the covariance stays below the limit (exact)", _never_above, EXACT,
                             ("largest_idle", "smallest_forgetting", "smallest_limit"),
                             proves=("bounded",), covers=("idle",)),
        "excited": Criterion("persistently excited: the error is forgetting^k P_k/P_0 of its start",
                             _excited, margins=("largest_forgetting",), needs=("least",),
                             proves=("dies_out",), covers=("idle",)),
    },
    {
        "bounded": Target(_rls_claim),
        "dies_out": Target("without noise the error of the estimate tends to zero", ("least",),
                           "that the estimate's error tends to zero"),
    },
    start=_rls_start,
    refuters={"bounded": Refuter("bounded", _find_growth, _replay_growth)},
    never=("rounding",),
    values=_rls_values,
    witness=_rls_witness,
    guard=_rls_guard,
    time=lambda n: SAMPLED,
))  # fmt: skip


# ---- the filter ---------------------------------------------------------------------------------


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
        return [Side("ln(1 + (1/share - 1) P_steady/P) <= gamma time", _ln(inside),
                     gamma * n["time"])]  # fmt: skip
    samples = math.floor(n["time"] / dt)
    return [Side("ln(1 + (1/share - 1) P_steady/P) <= ln(1 + gamma) samples", _ln(inside),
                 _ln(1 + gamma) * samples)]  # fmt: skip


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
    _whole("filter", n, "band_samples")
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
