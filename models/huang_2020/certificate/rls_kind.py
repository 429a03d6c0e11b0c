"""Recursive least squares with forgetting: does its covariance stay below a limit?"""

from __future__ import annotations

import math
from collections.abc import Sequence

from slipctl.certify.arithmetic.decimal_intervals import ln_of
from slipctl.certify.checksum import with_checksum, without_checksum
from slipctl.certify.entries import DoesNotHold, whole
from slipctl.certify.promise import check_whole
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
    Refuter,
    Side,
    System,
    Target,
    Witness,
    number_text,
)
from slipctl.errors import BadInput
from slipctl.models.huang_2020.certificate import rls_covariance
from slipctl.models.huang_2020.certificate.rls_covariance import (
    covariance_bounds,
    covariance_growth,
    memory,
    overflow_samples,
)

__all__ = ["RLS", "covariance_bounds", "covariance_growth", "memory", "overflow_samples"]


def _never_above(n: Numbers) -> Sequence[Side]:
    return [Side(*s) for s in rls_covariance.largest_sides(n)]


def _excited(n: Numbers) -> Sequence[Side]:
    return [Side("forgetting <= 1", n["forgetting"], 1), Side("0 < least", 0, n.get("least", 0))]


def _rls_guard(n: Numbers) -> None:
    if n["forgetting"] > 1:
        raise BadInput(f"forgetting = {float(n['forgetting']):g} must be above 0 and at most 1")
    check_whole("rls", n, "samples", "idle")
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
    rate = -math.log(float(n["forgetting"]))
    allowed = _allowed_quiet(n)
    if allowed is None:
        more = (math.log(float(n["limit"])) - math.log(float(n["P"]))) / rate
        return with_checksum(n, {"windows": 0, "quiet": max(math.ceil(more * (1 + 1e-9)), 0) + 1})
    found: list[tuple[int, int]] = [(0, allowed)]
    if n.get("least"):
        S = int(n["samples"])
        for m in (1, 3, 10, 30, math.ceil(80 / (rate * S))):
            found.append((m, allowed - (S - 1)))
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
    if not found.ends()[0] > ln_of(n["limit"]).ends()[1]:
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
