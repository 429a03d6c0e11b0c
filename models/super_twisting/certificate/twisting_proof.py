"""Explicit super-twisting as sampled in certificates: its bounds as evidence, runs that refute."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any

from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.promise import Entries, Evidence, Numbers, Refuter, number_text, rounded_up
from slipctl.models.super_twisting.certificate import twisting_late
from slipctl.models.super_twisting.certificate.twisting_late import Kept, Late
from slipctl.models.super_twisting.certificate.twisting_levels import (
    MOST_CORNERS,
    Levels,
    smt_steps,
)
from slipctl.models.super_twisting.certificate.twisting_rows import Law
from slipctl.models.super_twisting.certificate.twisting_sampled import (
    MOST_WORK,
    Bound,
    Crossings,
    Plan,
    Run,
    bound,
    quick_run,
    replay_run,
    worst_run,
)
from slipctl.models.super_twisting.certificate.twisting_swings import MOST_TICKS
from slipctl.models.super_twisting.certificate.twisting_turns import MOST_TURNS


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
    found = bound(at[0], wanted, MOST_WORK if wanted is None else 0.7 * MOST_WORK)
    if found is None or (wanted is not None and found.y > wanted):
        return None
    levels = found.levels
    return {
        "corners": [[str(z), str(w)] for z, w in levels.corners],
        "level": str(levels.level),
        "fall": str(levels.fall),
        "crossings": [list(entry) for entry in found.turns],
        "ticks": [list(entry) for entry in found.plan],
        "bound": str(rounded_up(found.y * at[1])),
        "x2": str(rounded_up(found.w * at[1] / n["T"])),
    }


def _levels(law: Law, entry: Entries) -> Levels:
    """Polygon of an evidence."""
    corners = []
    for i, corner in enumerate(rows(entry["corners"], "evidence.corners", MOST_CORNERS)):
        z, w = rows(corner, f"evidence.corners[{i}]", 2, 2)
        corners.append((rational(z, "evidence.corners"), rational(w, "evidence.corners")))
    level, fall = (rational(entry[k], f"evidence.{k}") for k in ("level", "fall"))
    return Levels(law, tuple(corners), level, fall)


def levels_step(n: Numbers, entry: Entries) -> list[str]:
    """Every run comes into the polygon; the ticks of rows after that are no inequality."""
    at = law(n)
    return [] if at is None else list(smt_steps(_levels(at[0], entry["evidence"])))


def _plan(given: Any, where: str) -> Plan:
    """Pairs of rows in k2 - L and of how often."""
    found = []
    for step in rows(given, where, 40):
        parts, count = rows(step, where, 2, 2)
        found.append((whole(parts, where, 1, 10**6), whole(count, where, 0, MOST_TICKS)))
    return tuple(found)


def _crossings(given: Any) -> Crossings:
    """Rows in k2 - L, and bounds in them, of each entry."""
    where, found = "evidence.crossings", []
    for i, step in enumerate(rows(given, where, 40)):
        numbers = [whole(x, where, 1, 10**6) for x in rows(step, f"{where}[{i}]", MOST_TURNS + 1)]
        if len(numbers) < 2 or any(b >= a for a, b in pairwise(numbers[1:])):
            raise DoesNotHold(f"{where}[{i}]: no bounds that fall")
        found.append(tuple(numbers))
    return tuple(found)


def _check(n: Numbers, given: Entries) -> None:
    names = ("corners", "level", "fall", "crossings", "ticks", "bound", "x2")
    entry = read_mapping(given, names, "evidence", True)
    at = law(n)
    if at is None:
        raise DoesNotHold("evidence: no bound is known at these numbers")
    turns, plan = _crossings(entry["crossings"]), _plan(entry["ticks"], "evidence.ticks")
    limit, x2 = (rational(entry[k], f"evidence.{k}") for k in ("bound", "x2"))
    found = Bound(_levels(at[0], entry), turns, plan, limit / at[1], x2 * n["T"] / at[1])
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
    late = "" if rests(n) else " in the end"
    return f"|x1| stays below {number_text(limit, 'm/s')} at every tick{late}"


def _find_run(
    n: Numbers, search: Callable[[Law, Fraction], Run | None] = worst_run
) -> Entries | None:  # fmt: skip
    at = None if rests(n) else law(n)
    if at is None:
        return None
    found = search(at[0], n["band"] / at[1])
    if found is None:
        return None
    scale = at[1] / n["T"] ** 2
    return {"start": {"x1": "0", "x2": "0"}, "d": [str(d * scale) for d in found.d]}


def _replay(n: Numbers, given: Entries) -> str:
    entry = read_mapping(given, ("start", "d"), "run", True)
    start = read_mapping(entry["start"], ("x1", "x2"), "run.start", True)
    if start["x1"] != "0" or start["x2"] != "0":
        raise DoesNotHold("run: it must start where the law rests, x1 = x2 = 0")
    at = None if n.get("lag") or n.get("dead") else law(n)
    if at is None:
        raise DoesNotHold("run: the numbers are out of reach")
    scale = at[1] / n["T"] ** 2
    d = [rational(x, "run.d") / scale for x in rows(entry["d"], "run.d", MOST_TICKS)]
    reached = replay_run(at[0], d)
    if reached is None or reached * at[1] <= n["band"]:
        raise DoesNotHold("run: |x1| does not exceed the band, or |d| exceeds L")
    return (
        f"from x1 = x2 = 0, where the law rests for any time while d = 0, |x1| comes to"
        f" {number_text(reached * at[1], 'm/s', 6)} after {len(d)} ticks"
    )


# ---- late, or with noise ------------------------------------------------------------------------

MOST_DEAD = 50
"""Longest dead time in ticks."""


def rests(n: Numbers) -> bool:
    """Whether the promise is from rest: a command that comes late, or noise."""
    return any(n.get(k) for k in ("noise", "lag", "dead"))


def late(n: Numbers) -> tuple[Late, Fraction] | None:
    """Law with its lag, dead time and noise, and the unit of length; None if out of reach."""
    at = law(n)
    if at is None:
        return None
    T = n["T"]
    lag, dead = n.get("lag", Fraction(0)) / T, math.ceil(n.get("dead", Fraction(0)) / T)
    noise = n.get("noise", Fraction(0)) / at[1]
    if lag > 1000 or dead > MOST_DEAD or noise > 10**9:
        return None
    return Late(replace(at[0], N=noise), lag, dead), at[1]


def _find_late(n: Numbers) -> Entries | None:
    at = late(n) if rests(n) else None
    if at is None:
        return None
    wanted = n["band"] / at[1] if "band" in n else None
    found = twisting_late.find(at[0], wanted)
    if found is None or ("band" in n and found.y * at[1] > n["band"]):
        return None
    limit = rounded_up(found.y * at[1])
    if "band" in n:
        limit = min(limit, n["band"])
    return {"P": str(found.P), "parts": found.parts, "ticks": found.ticks, "bound": str(limit)}


def _check_late(n: Numbers, given: Entries) -> None:
    entry = read_mapping(given, ("P", "parts", "ticks", "bound"), "evidence", True)
    at = late(n)
    if at is None or not rests(n):  # it holds from rest, and says nothing of other starts
        raise DoesNotHold("evidence: no bound is known at these numbers")
    P, limit = (rational(entry[k], f"evidence.{k}") for k in ("P", "bound"))
    parts = whole(entry["parts"], "evidence.parts", 1, 10**6)
    ticks = whole(entry["ticks"], "evidence.ticks", 1, MOST_TICKS)
    if not 0 < P < 10**12 or not Kept(at[0], P, parts, ticks, limit / at[1]).holds():
        raise DoesNotHold("evidence: the set is left, or is larger than that")
    if "band" in n and limit > n["band"]:
        raise DoesNotHold("evidence: the bound is larger than the band")


def _find_late_run(n: Numbers) -> Entries | None:
    at = late(n) if rests(n) else None
    if at is None:
        return None
    found = twisting_late.search(at[0], n["band"] / at[1])
    if found is None:
        return None
    d, heard = found
    scale = at[1] / n["T"] ** 2
    run: dict[str, Any] = {"start": "rest", "d": [str(x * scale) for x in d]}
    return run | ({"noise": [str(x * at[1]) for x in heard]} if n.get("noise") else {})


def _replay_late(n: Numbers, given: Entries) -> str:
    names = ("start", "d", "noise") if n.get("noise") else ("start", "d")
    entry = read_mapping(given, names, "run", True)
    at = late(n)
    if entry["start"] != "rest" or at is None:
        raise DoesNotHold("run: it must start from rest, with numbers within reach")
    scale = at[1] / n["T"] ** 2
    d = [rational(x, "run.d") / scale for x in rows(entry["d"], "run.d", twisting_late.MOST_TICKS)]
    heard = [Fraction(0)] * len(d)
    if "noise" in entry:
        told = rows(entry["noise"], "run.noise", twisting_late.MOST_TICKS, len(d))
        heard = [rational(x, "run.noise") / at[1] for x in told]
    reached = twisting_late.replay(at[0], d, heard)
    if reached is None or reached * at[1] <= n["band"]:
        raise DoesNotHold("run: |x1| does not exceed the band, or |d| or the noise is too large")
    return f"from rest |x1| comes to {number_text(reached * at[1], 'm/s', 6)} after {len(d)} ticks"


SAMPLED_BOUND = Evidence(_find, _check)
LATE_BOUND = Evidence(_find_late, _check_late)
WORST_RUN = Refuter("band", _find_run, _replay, partial(_find_run, search=quick_run))
LATE_RUN = Refuter("band", _find_late_run, _replay_late, _find_late_run)
