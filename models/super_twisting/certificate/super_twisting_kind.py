"""The super-twisting law: its promise and its criteria as inequalities of rationals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.promise import Entries, number_text
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    ASIDE,
    CONTINUOUS,
    EXACT,
    INPUT,
    NECESSARY,
    PRINTED,
    SAMPLED,
    SUFFICIENT,
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
from slipctl.errors import BadInput
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.super_twisting.certificate import twisting_report as twisting
from slipctl.models.super_twisting.certificate.quadratic import (
    MATRIX,
    exact_sides,
    fall,
    matrix,
    quadratic_sides,
)
from slipctl.models.super_twisting.certificate.twisting_proof import (
    LATE_BOUND,
    LATE_RUN,
    SAMPLED_BOUND,
    WORST_RUN,
    claim,
    levels_step,
    rests,
)

SHIFTED = ("k1 - delta", "k2", "L")
CONTINUOUS_INPUTS = ("L", "delta")
WORST = "r1 = delta |x1|^(1/2) sgn x1, d = L sgn x1 while |x1| grows, -L sgn x1 while it falls"


def _exact(n: Numbers) -> Sequence[Side]:
    return exact_sides(n["k1"] - n["delta"], n["k2"], n["L"], SHIFTED)


def _told(n: Numbers) -> list[Any]:
    return [n[k] for k in MATRIX] if "P11" in n else []


def _quadratic(n: Numbers) -> Sequence[Side]:
    return quadratic_sides(n["k1"] - n["delta"], n["k2"], n["L"], SHIFTED, _told(n))


def _matrix(n: Numbers) -> dict[str, Fraction] | None:
    return matrix(n["k1"] - n["delta"], n["k2"], n["L"])


def _fall(n: Numbers, entry: Mapping[str, Any]) -> str:
    P = [Fraction(entry["multipliers"][k]) for k in MATRIX]
    return fall(n["k1"] - n["delta"], n["k2"], n["L"], P)


SIDES: dict[str, Callable[[Any, Any, Any], list[Side]]] = {
    "seeber_horn": lambda k, b, L: [
        Side("L < k2", L, b), Side("k2 + L < (k1 - delta)^2", b + L, k * k)],
    "homogenised_48": lambda k, b, L: [
        Side("L k^2 + 2 L^2 < k2 k^2, k = k1 - delta", L * k * k + 2 * L * L, b * k * k)],
    "levant": lambda k, b, L: [
        Side("L < k2", L, b),
        Side("4 L (k2 + L) <= (k1 - delta)^2 (k2 - L)", 4 * L * (b + L), k * k * (b - L))],
    "printed_48": lambda k, b, L: [
        Side("2 < k1 - delta", 2, k),
        Side("k^3 + L^2 (4 k - 8) < k2 k (4 k - 8), k = k1 - delta",
             k**3 + L * L * (4 * k - 8), b * k * (4 * k - 8))],
    "polyakov_poznyak": lambda k, b, L: [
        Side("5 L < k2", 5 * L, b), Side("32 L < (k1 - delta)^2", 32 * L, k * k),
        Side("(k1 - delta)^2 < 8 (k2 - L)", k * k, 8 * (b - L))],
    "no_overshoot": lambda k, b, L: [
        Side("L < k2", L, b), Side("8 (k2 + L) <= (k1 - delta)^2", 8 * (b + L), k * k)],
}  # fmt: skip
"""Inequalities of ``super_twisting.SUFFICIENT`` of k1 - delta, k2, L; ``exact`` contains all."""


def _named(name: str) -> Criterion:
    def sides(n: Numbers) -> Sequence[Side]:
        k = n["k1"] - n["delta"]
        return [Side("delta < k1", 0, k), *(SIDES[name](k, n["k2"], n["L"]) if k > 0 else [])]

    return Criterion(twisting.TITLES[name], sides, PRINTED if "printed" in name else SUFFICIENT,
                     proves=("settles",), covers=CONTINUOUS_INPUTS)  # fmt: skip


def _orbit_fits(n: Numbers) -> Sequence[Side]:
    """Swing of explicit Euler's period-2 orbit, where there is one: k1^2 >= 4 k2."""
    k1, rest = n["k1"], n["k1"] * n["k1"] - 4 * n["k2"]
    if rest < 0:
        return [Side("0 < band", 0, n["band"])]
    exact = isinstance(rest, Fraction)
    root = Interval.of(rest, 60).sqrt() if exact and rest else math.sqrt(rest) if rest else rest
    wide = (root + k1) * n["T"]
    return [Side("T^2 (k1 + sqrt(k1^2 - 4 k2))^2 <= 16 band", wide * wide, 16 * n["band"])]


def _turns(n: Numbers) -> Sequence[Side]:
    return [Side("L < k2", n["L"], n["k2"])]


def _band_claim(n: Numbers, entry: Entries) -> str:
    ticks = " at every tick" if "T" in n else ""
    end = "" if rests(n) else " in the end"
    return f"|x1| stays below {number_text(n['band'], 'm/s')}{ticks}{end}"


def _start(n: Numbers) -> str:
    return "x1 = x2 = 0, nothing under way" if rests(n) else "every start"


def _values(n: Numbers) -> dict[str, Quantity]:
    k1, k2, L, delta = (n[k] for k in ("k1", "k2", "L", "delta"))
    least, most = sta.reaching_time_bounds(k1, k2, L, 1.0, delta)
    found = {
        "ln_q": (sta.log_ratio(k1, k2, L, delta), "1"),
        "longest_reaching_time_per_x2_at_least": (least, "s^3/m"),
        "longest_reaching_time_per_x2_at_most": (most, "s^3/m"),
    }
    if "v0" in n:
        least, most = sta.reaching_time_bounds(k1, k2, L, n["v0"], delta)
        found["reaching_time_at_least"] = (least, "s")
        found["reaching_time_at_most"] = (most, "s")
        found["reaching_time_undisturbed"] = (sta.reaching_time(k1, k2, n["v0"]), "s")
    if "T" in n:
        if k1 * k1 >= 4 * k2:
            found["explicit_amplitude"] = (sta.explicit_amplitude(k1, k2, n["T"]), "m/s")
        found["proper_implicit_amplitude"] = (sta.proper_implicit_amplitude(L, n["T"]), "m/s")
        if "phi" in n:
            found["implicit_offset"] = (sta.implicit_offset(n["phi"], n["T"]), "m/s")
    return found


def _ends(name: str, n: Numbers) -> Mapping[str, float | None]:
    if name in twisting.TESTS:
        return twisting.margins(name, n["k1"], n["k2"], n["L"], n["delta"])
    if name != "band":
        return {}
    return twisting.orbit_margins(n["k1"], n["k2"], n["T"], n["band"])


def _guard(n: Numbers) -> None:
    for name in ("k1", "k2", "L", "delta"):
        if n[name] and not Fraction(1, 10**30) <= n[name] <= 10**30:
            raise BadInput(f"{name} must lie between 1e-30 and 1e30 {sta.UNITS[name]}")
    for one, two in (("k2", "L"), ("k1", "delta")):
        if n[one] != n[two] and float(n[one]) == float(n[two]):
            raise BadInput(f"{one} and {two} differ by less than a double tells; move them apart")


def _witness(n: Numbers) -> Any:
    """Explicit Euler's period-2 orbit where that is asked, else the worst disturbance."""
    if "T" not in n or "band" not in n or n["k1"] ** 2 < 4 * n["k2"]:
        return twisting.witness(n["k1"], n["k2"], n["L"], n["delta"])
    k1, k2, T = n["k1"], n["k2"], n["T"]
    x1, x2, rows = sta.explicit_amplitude(k1, k2, T), T * k2 / 2, []
    for _ in range(100):
        rows.append(x1)
        side = math.copysign(1.0, x1)
        x1, x2 = x1 + T * (x2 - k1 * math.sqrt(abs(x1)) * side), x2 - T * k2 * side
    return Witness(
        f"none; explicit Euler from x1 = {rows[0]:.6g} m/s, x2 = {T * k2 / 2:.6g} m/s^2",
        {"|x1|_after_100_ticks": (abs(x1), "m/s")},
        {"t": ("s", [T * i for i in range(100)]), "x1": ("m/s", rows)},
    )


SUPER_TWISTING = register(System(
    "super_twisting",
    "x1' = -k1 |x1|^.5 sgn x1 + x2 + r1, x2' = -k2 sgn x1 + d, |r1| <= delta |x1|^.5, |d| <= L: is"
    " x1 -> 0 in finite time?",
    {
        "k1": Number("m^.5/s^1.5", "gain of the root", power=0.5),
        "k2": Number("m/s^3", "gain of the integral", power=1.0),
        "L": Number("m/s^3", "bound of the disturbance's slope", power=1.0, role=INPUT,
                    says="every |d| <= {}",
                    hint="; without a disturbance every k1 > delta, k2 > 0 is stable"),
        "delta": Number("m^.5/s^1.5", "bound of |r1| over |x1|^.5", 0.0, "not negative", 0.5,
                        role=INPUT, says="every |r1| <= {} |x1|^.5", absent="r1"),
        "T": Number("s", "sample period", optional=True, role=INPUT, says="explicit steps of {}",
                    absent="the law computed once per period"),
        "noise": Number("m/s", "largest error of the measured x1", None, "not negative", 1.0, True,
                        INPUT, "noise up to {}", "measurement noise"),
        "lag": Number("s", "time constant of the actuator", None, "not negative", 0.0, True, INPUT,
                      "a lag of {}", "a lag of the actuator"),
        "dead": Number("s", "dead time of the actuator, in whole ticks rounded up", None,
                       "not negative", 0.0, True, INPUT, "a dead time of {}", "a dead time"),
        "band": Number("m/s", "wanted |x1| in the end", None, optional=True, power=1,
                       role=TARGET),
        "phi": Number("m/s^2", "matched disturbance", None, "not negative", 1, True, ASIDE),
        "v0": Number("m/s^2", "x2 at the start, for the reaching time", None, "any", 1, True,
                     ASIDE),
    },
    {
        "exact": Criterion(twisting.TITLES["exact"], _exact, EXACT, proves=("settles", "band"),
                           covers=CONTINUOUS_INPUTS, refutes=WORST),
        "quadratic": Criterion(twisting.TITLES["quadratic"], _quadratic, find=_matrix,
                               multipliers=MATRIX, proves=("settles", "band"),
                               covers=CONTINUOUS_INPUTS, step=_fall),
        **{k: _named(k) for k in sta.SUFFICIENT if k != "quadratic"},
        "turns": Criterion("sampled: x2 turns back", _turns, NECESSARY, needs=("T",),
                           proves=("ends", "band"), refuted_under=("L", "delta", "T"),
                           refutes="the constant d = L; x1 stays as large as it is"),
        "sampled": Criterion("explicit steps: a polygon that every run enters, then rows of states",
                             needs=("T",), proves=("ends", "band"), covers=("L", "T"),
                             evidence=SAMPLED_BOUND, step=levels_step),
        "late": Criterion("explicit steps, late or with noise: rows of states that hold every run",
                          needs=("T",), proves=("ends", "band"),
                          covers=("L", "T", "noise", "lag", "dead"), evidence=LATE_BOUND),
        "band": Criterion("necessary: explicit Euler's period-2 orbit fits into the wanted band",
                          _orbit_fits, NECESSARY, needs=("T", "band"), proves=("band",), covers=(),
                          refutes="none; d = 0 on the period-2 orbit",
                          refuted_under=("L", "delta", "T")),
    },
    {
        "settles": Target("x1 is 0 after a finite time, and stays there", unless=("band", "ends")),
        "ends": Target(claim, ("T",), unless=("band",)),
        "band": Target(_band_claim, ("band",)),
    },
    start=_start,
    refuters={"run": WORST_RUN, "late_run": LATE_RUN},
    never=("a limit of the command",),
    values=_values,
    witness=_witness,
    show_witness=True,
    panel=tuple(dict(zip(("k1", "k2", "L"), row, strict=True)) for row in twisting.PANEL),
    ends=_ends,
    guard=_guard,
    time=lambda n: SAMPLED if "T" in n else CONTINUOUS,
))  # fmt: skip
