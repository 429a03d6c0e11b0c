"""All systems that can be certified, by the name that the command line knows them by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from slipctl.certify import super_twisting as sta
from slipctl.certify import systems
from slipctl.certify.estimating_kind import FILTER, RLS
from slipctl.certify.holding_kind import BARRIER, PRESCRIBED_PERFORMANCE
from slipctl.certify.linear_kind import LAGGED_LOOP, LOAD_OBSERVER
from slipctl.certify.seeking_kind import PERTURBATION_SEEK, SLIDING_SEEK
from slipctl.certify.switching_kind import REACHING_LAW, SATURATION
from slipctl.certify.systems import EXACT, Criterion, Number, Numbers, Report, Side, System
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
    missing = [k for k, v in known.items() if k not in given and v.value is None]
    if missing:
        lacking = " ".join(f"{k}=VALUE" for k in missing)
        raise BadInput(f"super_twisting needs {', '.join(missing)}; add --set {lacking}")
    return super_twisting_report(**given)


SUPER_TWISTING = System(
    "super_twisting",
    "x1' = -k1 |x1|^.5 sgn x1 + x2 + r1, x2' = -k2 sgn x1 + d, |r1| <= delta |x1|^.5, |d| <= L: is"
    " x1 -> 0 in finite time?",
    {
        "k1": Number("m^.5/s^1.5", "gain of the root", power=0.5),
        "k2": Number("m/s^3", "gain of the integral", power=1.0),
        "L": Number("m/s^3", "bound of the disturbance's slope", power=1.0),
        "delta": Number("m^.5/s^1.5", "bound of |r1| over |x1|^.5", 0.0, "not negative", 0.5),
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
