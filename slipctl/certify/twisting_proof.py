"""Explicit super-twisting as sampled in certificates: its bound as evidence, a run that refutes."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from slipctl.certify.entries import DoesNotHold, mapping, rational, rows, whole
from slipctl.certify.promise import Entries, Evidence, Numbers, Refuter, rounded_up, spelled
from slipctl.certify.twisting_levels import MOST_CORNERS, Levels
from slipctl.certify.twisting_rows import Law
from slipctl.certify.twisting_sampled import Bound, bound, quick_run, replay_run, worst_run

MOST_TICKS = 20_000
"""Most ticks of a run or a plan that are gone through."""


def law(n: Numbers) -> tuple[Law, Fraction] | None:
    """Law in a unit of length in which L is near 1, and that unit in m/s; None if out of reach.

    Proof note: x1 -> c x1 makes k1/root(c), k2/c, L/c of the gains; c is a power of 4, so that the
    root is rational. Then x1 = T^2 c y.
    """
    size = 0
    while n["L"] >= Fraction(4) ** (size + 1):
        size += 1
    while n["L"] < Fraction(4) ** size:
        size -= 1
    c = Fraction(4) ** size
    k1, k2, L = n["k1"] / Fraction(2) ** size, n["k2"] / c, n["L"] / c
    if not Fraction(1, 10**4) < k1 < 10**4 or not L < k2 < 10**5:
        return None
    return Law(k1, k2, L), c * n["T"] ** 2


def _find(n: Numbers) -> Entries | None:
    at = law(n)
    if at is None:
        return None
    wanted = n["band"] / at[1] if "band" in n else None
    if wanted is not None and quick_run(at[0], wanted):
        return None  # a bound would be in vain
    found = bound(at[0], wanted)
    if found is None or (wanted is not None and found.y > wanted):
        return None
    levels = found.levels
    return {
        "corners": [[str(z), str(w)] for z, w in levels.corners],
        "level": str(levels.level),
        "fall": str(levels.fall),
        "ticks": [list(entry) for entry in found.plan],
        "bound": str(rounded_up(found.y * at[1])),
        "x2": str(rounded_up(found.w * at[1] / n["T"])),
    }


def _check(n: Numbers, given: Entries) -> None:
    names = ("corners", "level", "fall", "ticks", "bound", "x2")
    entry = mapping(given, names, "evidence", True)
    at = law(n)
    if at is None:
        raise DoesNotHold("evidence: no bound is known at these numbers")
    corners = []
    for i, corner in enumerate(rows(entry["corners"], "evidence.corners", MOST_CORNERS)):
        z, w = rows(corner, f"evidence.corners[{i}]", 2, 2)
        corners.append((rational(z, "evidence.corners"), rational(w, "evidence.corners")))
    plan = []
    for step in rows(entry["ticks"], "evidence.ticks", 40):
        parts, ticks = rows(step, "evidence.ticks", 2, 2)
        plan.append((whole(parts, "evidence.ticks", 1, 10**6),
                     whole(ticks, "evidence.ticks", 1, MOST_TICKS)))  # fmt: skip
    limit, x2 = (rational(entry[k], f"evidence.{k}") for k in ("bound", "x2"))
    level, fall = (rational(entry[k], f"evidence.{k}") for k in ("level", "fall"))
    levels = Levels(at[0], tuple(corners), level, fall)
    found = Bound(levels, tuple(plan), limit / at[1], x2 * n["T"] / at[1])
    if not found.holds():
        raise DoesNotHold("evidence: the polygon does not shrink, or its ticks do not come so far")
    if "band" in n and limit > n["band"]:
        raise DoesNotHold("evidence: the bound is larger than the band")


def claim(n: Numbers, entry: Entries) -> str:
    """Clause of the bound that the proof finds itself."""
    found: Any = entry.get("evidence", {}) if isinstance(entry, Mapping) else {}
    if not isinstance(found, Mapping) or "bound" not in found:
        return "|x1| stays bounded in the end"
    limit = rational(found["bound"], "evidence.bound")
    return f"|x1| stays below {spelled(limit, 'm/s')} at every tick in the end"


def _find_run(n: Numbers) -> Entries | None:
    at = law(n)
    if at is None:
        return None
    found = worst_run(at[0], n["band"] / at[1])
    if found is None:
        return None
    scale = at[1] / n["T"] ** 2
    return {"start": {"x1": "0", "x2": "0"}, "d": [str(d * scale) for d in found.d]}


def _replay(n: Numbers, given: Entries) -> str:
    entry = mapping(given, ("start", "d"), "run", True)
    start = mapping(entry["start"], ("x1", "x2"), "run.start", True)
    if start["x1"] != "0" or start["x2"] != "0":
        raise DoesNotHold("run: it must start where the law rests, x1 = x2 = 0")
    at = law(n)
    if at is None:
        raise DoesNotHold("run: the numbers are out of reach")
    scale = at[1] / n["T"] ** 2
    d = [rational(x, "run.d") / scale for x in rows(entry["d"], "run.d", MOST_TICKS)]
    reached = replay_run(at[0], d)
    if reached is None or reached * at[1] <= n["band"]:
        raise DoesNotHold("run: |x1| does not exceed the band, or |d| exceeds L")
    return (
        f"from x1 = x2 = 0, where the law rests for any time while d = 0, |x1| comes to"
        f" {spelled(reached * at[1], 'm/s', 6)} after {len(d)} ticks"
    )


SAMPLED_BOUND = Evidence(_find, _check)
WORST_RUN = Refuter("band", _find_run, _replay)
