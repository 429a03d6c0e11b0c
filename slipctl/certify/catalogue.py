"""All systems that can be certified, by the name that the command line knows them by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from slipctl.certify import super_twisting as sta
from slipctl.certify import systems
from slipctl.certify.estimating_kind import FILTER, RLS
from slipctl.certify.holding_kind import BARRIER, PRESCRIBED_PERFORMANCE
from slipctl.certify.linear_kind import LAGGED_LOOP, LOAD_OBSERVER
from slipctl.certify.seeking_kind import PERTURBATION_SEEK, SLIDING_SEEK
from slipctl.certify.switching_kind import REACHING_LAW, SATURATION
from slipctl.certify.systems import (
    EXACT,
    REFUTED,
    SAMPLED,
    SILENT,
    Criterion,
    Finding,
    Number,
    Numbers,
    Report,
    Side,
    System,
    Witness,
)
from slipctl.certify.twisting_kind import (
    ADHESION_OBSERVER,
    HIGHER_ORDER,
    exact_sides,
    quadratic_sides,
)
from slipctl.certify.twisting_report import PANEL, TITLES, super_twisting_report
from slipctl.errors import BadInput, nearest

SHIFTED = ("k1 - delta", "k2", "L")


def _exact(n: Numbers) -> Sequence[Side]:
    return exact_sides(n["k1"] - n["delta"], n["k2"], n["L"], SHIFTED)


def _quadratic(n: Numbers) -> Sequence[Side]:
    return quadratic_sides(n["k1"] - n["delta"], n["k2"], n["L"], SHIFTED)


def _named(name: str) -> Criterion:
    """Criterion of ``super_twisting.SUFFICIENT`` as an inequality that holds or not."""

    def sides(n: Numbers) -> Sequence[Side]:
        holds = sta.SUFFICIENT[name](n["k1"] - n["delta"], n["k2"], n["L"])
        return [Side(f"{name} holds", 0 if holds else 1, 0.5)]

    return Criterion(TITLES[name], sides)


def _report(given: Mapping[str, Any]) -> Report:
    known = SUPER_TWISTING.numbers
    for name in given:
        if name not in known:
            raise BadInput(f"super_twisting has no {name!r}{nearest(name, known)}")
    missing = [k for k, v in known.items() if k not in given and v.value is None and not v.optional]
    if missing:
        lacking = " ".join(f"{k}=VALUE" for k in missing)
        raise BadInput(f"super_twisting needs {', '.join(missing)}; add --set {lacking}")
    gains = {k: given[k] for k in ("k1", "k2", "L", "delta") if k in given}
    found = super_twisting_report(**gains)
    further = {k: v for k, v in given.items() if k not in gains}
    return _sampled(found, further) if further else found


def _sampled(found: Report, further: Mapping[str, Any]) -> Report:
    """Report with what sampling and a start add."""
    told = systems.checked(SUPER_TWISTING, further, whole=False)
    n = {**found.gains, **{k: float(v) for k, v in told.items() if k in further}}
    k1, k2, L, values = n["k1"], n["k2"], n["L"], dict(found.values)
    criteria, verdict, witness = dict(found.criteria), found.verdict, found.witness
    time = found.time
    if "v0" in n:
        least, most = sta.reaching_time_bounds(k1, k2, L, n["v0"], n["delta"])
        values["reaching_time_at_least"] = (least, "s")
        values["reaching_time_at_most"] = (most, "s")
        values["reaching_time_undisturbed"] = (sta.reaching_time(k1, k2, n["v0"]), "s")
    if "T" in n:
        T = n["T"]
        if k1 * k1 >= 4 * k2:
            values["explicit_amplitude"] = (sta.explicit_amplitude(k1, k2, T), "m/s")
        values["proper_implicit_amplitude"] = (sta.proper_implicit_amplitude(L, T), "m/s")
        if "phi" in n:
            values["implicit_offset"] = (sta.implicit_offset(n["phi"], T), "m/s")
    if "T" in n and "band" in n:
        fits = sta.explicit_amplitude(k1, k2, n["T"]) <= n["band"]
        ends: dict[str, float | None] = {
            "largest_k1": systems.end(
                lambda k: sta.explicit_amplitude(k, k2, n["T"]) <= n["band"], k1, True),
            "largest_T": systems.end(
                lambda T: sta.explicit_amplitude(k1, k2, T) <= n["band"], n["T"], True),
        }  # fmt: skip
        orbit = k1 * k1 >= 4 * k2
        criteria["band"] = Finding(
            REFUTED if orbit and not fits else SILENT, ends, False,
            "necessary: explicit Euler's period-2 orbit fits into the wanted band", fits,
        )  # fmt: skip
        if orbit and not fits:
            verdict, witness, time = REFUTED, _orbit(k1, k2, n["T"]), SAMPLED
    units = {k: v.unit for k, v in SUPER_TWISTING.numbers.items()}
    return Report(found.system, n, units, verdict, criteria, values, witness, time)


def _orbit(k1: float, k2: float, T: float) -> Witness:
    """Explicit Euler without disturbance, from a point of its period-2 orbit."""
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


SUPER_TWISTING = System(
    "super_twisting",
    "x1' = -k1 |x1|^.5 sgn x1 + x2 + r1, x2' = -k2 sgn x1 + d, |r1| <= delta |x1|^.5, |d| <= L: is"
    " x1 -> 0 in finite time?",
    {
        "k1": Number("m^.5/s^1.5", "gain of the root", power=0.5),
        "k2": Number("m/s^3", "gain of the integral", power=1.0),
        "L": Number("m/s^3", "bound of the disturbance's slope", power=1.0),
        "delta": Number("m^.5/s^1.5", "bound of |r1| over |x1|^.5", 0.0, "not negative", 0.5),
        "T": Number("s", "sample period", optional=True),
        "band": Number("m/s", "wanted half-swing of explicit Euler", None, optional=True, power=1),
        "phi": Number("m/s^2", "matched disturbance", None, "not negative", 1, True),
        "v0": Number("m/s^2", "x2 at the start, for the reaching time", None, "any", 1, True),
    },
    {
        "exact": Criterion(TITLES["exact"], _exact, EXACT),
        "quadratic": Criterion(TITLES["quadratic"], _quadratic),
        **{k: _named(k) for k in sta.SUFFICIENT if k != "quadratic"},
    },
    panel=tuple(dict(zip(("k1", "k2", "L"), row, strict=True)) for row in PANEL),
    answer=_report,
)

SYSTEMS = {
    s.name: s
    for s in (
        SUPER_TWISTING, REACHING_LAW, ADHESION_OBSERVER, HIGHER_ORDER, SATURATION,
        PRESCRIBED_PERFORMANCE, BARRIER, SLIDING_SEEK, PERTURBATION_SEEK, RLS, FILTER, LAGGED_LOOP,
        LOAD_OBSERVER,
    )
}  # fmt: skip
"""Every system by name."""


def system(name: str) -> System:
    """System by its name.

    Raises:
        BadInput: there is none.
    """
    if name not in SYSTEMS:
        raise BadInput(f"cannot certify {name!r}{nearest(name, SYSTEMS)}")
    return SYSTEMS[name]


def certify(name: str, **numbers: Any) -> Report:
    """Verdict, margins and witness of a system: ``certify("reaching_law", g1=36, g2=12, T=1e-3)``.

    Raises:
        BadInput: an unknown system or number, or numbers that mean nothing.
    """
    return systems.report(system(name), numbers)
