"""Command with saturation compensation: do the errors die out while the need varies?"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from typing import Any

from slipctl.certify import smtlib
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold, read_mapping, whole
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    NECESSARY,
    SUFFICIENT,
    Criterion,
    Entries,
    Evidence,
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
from slipctl.models.wang_2025.certificate import saturated_motion as swing

MOTION = ("k1", "k3", "M", "F_min", "F_max", "F_low", "F_high")


def guard(n: Numbers) -> None:
    """Refuse limits of the need that are in the wrong order.

    Raises:
        BadInput: they are.
    """
    if n["F_low"] > n["F_high"]:
        raise BadInput(f"F_low = {float(n['F_low']):g} N must not be above F_high")


def _law(n: Numbers) -> swing.Saturated:
    return swing.motion(*(float(n[k]) for k in MOTION))


def _exact(n: Numbers) -> tuple[swing.Saturated, Any]:
    """The motion and the start, in decimals; inside a context of that many digits."""
    *numbers, start = swing.exactly([*(n[k] for k in MOTION), n["start"]])
    return swing.motion(*numbers), start


# ---- inequalities -------------------------------------------------------------------------------


def _poles(n: Numbers) -> Sequence[Side]:
    return [Side("0 < k1", 0, n["k1"]), Side("0 < k3", 0, n["k3"])]


def _authority(n: Numbers) -> Sequence[Side]:
    return [Side("F_min < F_low", n["F_min"], n["F_low"]),
            Side("F_high < F_max", n["F_high"], n["F_max"])]  # fmt: skip


def _spare(n: Numbers) -> Any:
    """Force that is left to either side, whatever the need."""
    return min(n["F_max"] - n["F_high"], n["F_low"] - n["F_min"])


def _constant(n: Numbers) -> Sequence[Side]:
    """A need that does not vary.

    Proof note: let y = k1 k3 e1 + (k1 + k3) e2 and e2' = -f(y), f cut at fixed limits of either
    sign. Then V = k1 k3 e2^2/2 + the integral of f falls by (k1 + k3) f^2. And f = 0 only at y = 0.
    """
    return [*_authority(n), Side("F_high <= F_low", n["F_high"], n["F_low"])]


def _free(n: Numbers) -> Sequence[Side]:
    """Starts from which nothing saturates.

    Proof note: from rest at e1 the command is M k1 k3 e1 f(t), with
    f = (k1 exp(-k1 t) - k3 exp(-k3 t))/(k1 - k3). f(0) = 1, f <= exp(-k3 t) and f >= -1/e.
    """
    sides = list(_authority(n))
    if "start" in n:
        sides.append(Side("M k1 k3 start <= force to spare",
                          n["M"] * n["k1"] * n["k3"] * n["start"], _spare(n)))  # fmt: skip
    return sides


def _free_step(n: Numbers, entry: Entries) -> str | None:
    """Nothing saturates in the set |e1| <= start, |y| <= k1 k3 start, which is not left.

    y = k1 k3 e1 + (k1 + k3) e2 is what the command has beside the need, over M: e1' = e2, e2' = -y.
    """
    start = n.get("start", _free_start(n))
    if not start:
        return None
    term, plus, times = smtlib.term, smtlib.sum_term, smtlib.times
    p, s = n["k1"] * n["k3"], n["k1"] + n["k3"]
    most = p * start
    y = plus(times(p, "x"), times(s, "v"))
    facts = [*smtlib.interval_terms(-start, "x", start), *smtlib.interval_terms(-most, y, most)]
    rate = plus(times(p, "v"), times(-s, y))
    claim = term(
        "and",
        term("<=", times(n["M"], y), _spare(n)), term("<=", -_spare(n), times(n["M"], y)),
        term("=>", term("=", "x", start), term("<=", "v", 0)),
        term("=>", term("=", "x", -start), term("<=", 0, "v")),
        term("=>", term("=", y, most), term("<", rate, 0)),
        term("=>", term("=", y, -most), term("<", 0, rate)),
    )  # fmt: skip
    return smtlib.problem(("x", "v"), facts, claim)


# ---- the swing ----------------------------------------------------------------------------------


def _ladder(n: Numbers) -> Sequence[Side]:
    start = float(n["start"])
    if n["F_high"] == n["F_low"]:
        return _constant(n)
    held = _spare(n) > 0 and swing.dies_out(_law(n), start, 100)
    return [Side("swings <= the one before, down to no saturation", 0.0 if held else 1.0, 0.0)]


def _find(n: Numbers) -> Entries | None:
    if _spare(n) <= 0 or n["F_low"] == n["F_high"]:
        return None
    for steps in swing.FINER:
        if swing.dies_out(_law(n), float(n["start"]), steps):
            try:
                _check(n, {"steps": steps})
            except DoesNotHold:
                continue
            return {"steps": steps}
    return None


def _check(n: Numbers, given: Entries) -> None:
    steps = whole(
        read_mapping(given, ("steps",), "proofs.ladder", True)["steps"], "steps", 1, 10**6
    )
    if steps not in swing.FINER:
        raise DoesNotHold(f"proofs.ladder: steps must be one of {swing.FINER}")
    with precise(swing.DIGITS):
        law, start = _exact(n)
        if _spare(n) <= 0 or not (start == 0 or swing.dies_out(law, start, steps)):
            raise DoesNotHold("proofs.ladder: the swings are not shown to die out")


def _worst(n: Numbers) -> Entries | None:
    if not n.get("start") or _spare(n) <= 0:
        return None
    law, start = _law(n), float(n["start"])
    for side, own in ((1, law), (-1, law.turned())):
        if any(swing.comes_back(own, start, steps) for steps in swing.FINER):
            return {"e1": str(side * n["start"]), "need_while_e2_negative": str(n["F_high"]),
                    "need_while_e2_positive": str(n["F_low"])}  # fmt: skip
    return None


def _replay(n: Numbers, given: Entries) -> str:
    where = "counterexample.run"
    names = ("e1", "need_while_e2_negative", "need_while_e2_positive")
    entry = read_mapping(given, names, where, True)
    side = {str(n.get("start", 0)): 1, str(-n.get("start", 0)): -1}.get(str(entry["e1"]), 0)
    needs = (entry[names[1]], entry[names[2]])
    if not side or not n.get("start") or needs != (str(n["F_high"]), str(n["F_low"])):
        raise DoesNotHold(f"{where}: a start or a need that is not allowed")
    if _spare(n) <= 0:
        raise DoesNotHold(f"{where}: the need is out of reach; no swing is needed to see it")
    with precise(swing.DIGITS):
        law, start = _exact(n)
        own = law if side > 0 else law.turned()
        if not any(swing.comes_back(own, start, steps) for steps in swing.FINER):
            raise DoesNotHold(f"{where}: the error comes back nearer than it was")
    return f"from rest at e1 = {side * float(n['start']):g} m it comes to rest as far out, or more"


# ---- the system ---------------------------------------------------------------------------------


def command_poles(k1: float, k3: float) -> list[complex]:
    """Poles in 1/s of the command with saturation compensation on s = 0, by python-control.

    Proof note: on s = k1 e1 + e2 - lam = 0 the command is F_d/M + v_d' + delta/M - (k1 + k3) e2
    - k1 k3 e1: e1'' = -(k1 + k3) e1' - k1 k3 e1, whose poles are -k1 and -k3, in any saturation
    that s itself does not see (s' = u - delta/M exactly).
    """
    import control
    import numpy as np

    found = control.ss([[0, 1], [-k1 * k3, -(k1 + k3)]], [[0], [1]], [[1, 0]], [[0]]).poles()
    return [complex(p) for p in np.sort_complex(found)]


def _values(n: Numbers) -> dict[str, Quantity]:
    poles = command_poles(n["k1"], n["k3"])
    found = {f"pole_{i + 1}": (p.real, "1/s") for i, p in enumerate(poles)}
    found["recovery_to_2_%"] = (4 / min(n["k1"], n["k3"]), "s")
    found["spare_force"] = (_spare(n), "N")
    found["start_without_saturation"] = (_free_start(n), "m")
    return found


def _free_start(n: Numbers) -> Any:
    return max(_spare(n), 0) / (n["M"] * n["k1"] * n["k3"])


def _claim(n: Numbers, entry: Entries) -> str:
    told = ZERO.format(F_low=number_text(n["F_low"], "N"), F_high=number_text(n["F_high"], "N"))
    if n["F_high"] == n["F_low"] or _spare(n) <= 0:
        return told
    down = Context(prec=10, rounding=ROUND_FLOOR).divide(
        *(Decimal(x) for x in Fraction(_free_start(n)).as_integer_ratio())
    )
    return f"{told}, if |e1| <= {number_text(down, 'm')} at the start"


def _witness(n: Numbers) -> Witness:
    """The mass under the limited command: the need out of reach, or the worst one that varies."""
    out = _spare(n) <= 0
    high = n["F_high"] >= n["F_max"]
    h, e1, e2, t = 0.02, 0.0 if out else n.get("start", 0.0), 0.0, 0.0
    rows: list[tuple[float, float, float]] = []
    need = n["F_high"] if high or not out else n["F_low"]
    for i in range(3000):
        if not out:
            need = n["F_high"] if e2 < 0 or (e2 == 0 and e1 > 0) else n["F_low"]
        wanted = need - n["M"] * ((n["k1"] + n["k3"]) * e2 + n["k1"] * n["k3"] * e1)
        force = min(max(wanted, n["F_min"]), n["F_max"])
        e1, e2, t = e1 + h * e2, e2 + h * (force - need) / n["M"], t + h
        if i % 30 == 0:
            rows.append((t, e1, e2))
    return Witness(
        f"a constant force of {need:g} N is needed, beyond the limit" if out
        else "F_high is needed while e2 < 0, F_low while e2 > 0",
        {"speed_error_after_60_s": (e2, "m/s"), "position_error_after_60_s": (e1, "m")},
        {"t": ("s", [r[0] for r in rows]), "e1": ("m", [r[1] for r in rows]),
         "e2": ("m/s", [r[2] for r in rows])},
    )  # fmt: skip


ZERO = "e1 and e2 tend to zero, however the need varies from {F_low} to {F_high}"

_NEED = ("F_low", "F_high")
_BOTH = ("dies_out", "dies_out_near")

SATURATION = register(System(
    "saturation_compensation",
    "Wang 2025 (34)-(36): lam' = -k3 lam - (F_HO - F)/M keeps s' = u - delta/M in any saturation."
    " Do the errors die out while the need varies in any way, and from how far?",
    {
        "k1": Number("1/s", "slope of the sliding surface"),
        "k3": Number("1/s", "rate at which the compensation is forgotten"),
        "M": Number("kg", "mass"),
        "F_min": Number("N", "least force", low="any"),
        "F_max": Number("N", "largest force", low="any"),
        "F_low": Number("N", "least force that the profile needs after the event", low="any",
                        role=INPUT, lowest=True),
        "F_high": Number("N", "largest force that it needs", low="any", role=INPUT),
        "start": Number("m", "largest |e1| at the start, at rest", None, "not negative", 1.0,
                        optional=True),
    },
    {
        "poles": Criterion("poles -k1 and -k3 of the motion on s = 0", _poles, EXACT),
        "authority": Criterion("the force that is needed lies strictly inside the limits",
                               _authority, NECESSARY,
                               ("largest_F_high", "smallest_F_low", "smallest_F_max",
                                "largest_F_min"),
                               proves=_BOTH, refuted_under=_NEED,
                               refutes="the constant need that is out of reach"),
        "constant": Criterion("the need does not vary", _constant, EXACT, proves=_BOTH,
                              covers=_NEED),
        "free": Criterion("nothing saturates", _free, SUFFICIENT, proves=_BOTH, covers=_NEED,
                          step=_free_step),
        "ladder": Criterion("against the worst need each swing is smaller than the one before",
                            _ladder, EXACT, ("largest_start",), ("start",), proves=("dies_out",),
                            covers=_NEED, evidence=Evidence(_find, _check)),
    },
    {
        "dies_out": Target(ZERO, ("start",)),
        "dies_out_near": Target(_claim, unless=("dies_out",)),
    },
    start=lambda n: ("every |e1| <= " + number_text(n["start"], "m") if "start" in n
                     else "every e1") + ", at rest, on s = 0",
    refuters={"worst_need": Refuter("dies_out", _worst, _replay, _worst)},
    never=("an error of the surface s", "a start with e2 other than 0",
           "the law computed once per period", "a lag of the actuator"),
    guard=guard,
    values=_values,
    witness=_witness,
    panel=({"k1": 0.5, "k3": 0.2, "M": 5e5, "F_min": -1e5, "F_max": 1e5,
            "F_low": 0.0, "F_high": 5e4},),
))  # fmt: skip
