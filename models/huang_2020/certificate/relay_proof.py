"""The reaching law behind a lag in certificates: a polygon as evidence, an orbit that refutes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.promise import Entries, Evidence, Numbers, Refuter, number_text, rounded_up
from slipctl.certify.smtlib import interval_terms, problem, sum_term, term, times
from slipctl.models.huang_2020.certificate import relay_orbits, relay_sets
from slipctl.models.huang_2020.certificate.relay_sets import Absorbing, Point, Relay, Ticker

MOST_WORK = 60_000
"""Most corners that are moved."""


def law(n: Numbers) -> Relay:
    """Law of the numbers."""
    return Relay(n["g1"], n["g2"], n["T"], n["lag"], n["D"])


def no_lag_band(g1: Any, g2: Any, T: Any, D: Any) -> Any:
    """Largest |s| in the end without a lag, exact; inf where there is none.

    Proof note: with r = 1 - T g1, s > 0 goes to r s - T g2 +- T D. For r <= 0 the ends alternate:
    S = T (g2 + D)/(2 - T g1). For r > 0, |s| stays within [lo, hi], lo = T (g2 - D) - r hi, hi =
    T (g2 + D) - r lo, as long as lo > 0. So hi = T g2/(1 + r) + T D/(1 - r), reached by a
    constant d.
    Where r = 1 and D = 0 the start stays: s and s - T g2 in turn, s as near to T g2 as it likes.
    Else d can bring s as near to 0 as it likes, and T (g2 + D) follows. D > g2 also holds s at
    (D - g2)/g1.
    """
    r = 1 - T * g1
    if T * g1 >= 2 or (g1 == 0 and g2 <= D):
        return float("inf")
    if r <= 0:
        return T * (g2 + D) / (2 - T * g1)
    if r < 1 and D * (1 + r) <= g2 * (1 - r):
        return T * g2 / (1 + r) + T * D / (1 - r)
    return max(T * (g2 + D), (D - g2) / g1) if g2 < D else T * (g2 + D)


def _find(n: Numbers) -> Entries | None:
    at, wanted = law(n), n.get("band")
    if not at.lag or at.left[0] == at.left[1]:
        return None
    if wanted is not None and relay_orbits.find(at, wanted):
        return None  # a bound would be in vain
    start = relay_sets.find(at)
    if start is None:
        return None
    ticker, ticks, work = Ticker(start), 0, 0
    before, fell = ticker.largest(), Fraction(0)
    while work < MOST_WORK:
        work += len(ticker.points) + 4
        ticker.tick()
        ticks += 1
        if ticks % 10 == 0 and wanted is not None and ticker.largest() <= wanted:
            break
        if ticks % 60 == 0:
            now = ticker.largest()
            if now > before * Fraction(9999, 10000) or _in_vain(before - now, fell, now, wanted):
                break
            before, fell = now, before - now
    bound = rounded_up(ticker.largest())
    if wanted is not None and bound > wanted:
        return None
    corners = [[str(s), str(a)] for s, a in start.corners]
    return {"corners": corners, "ticks": ticks, "bound": str(bound)}


def _in_vain(fall: Fraction, before: Fraction, now: Fraction, wanted: Fraction | None) -> bool:
    """Whether it will not come down to what is wanted, if each fall is that share of the last."""
    return wanted is not None and before > fall > 0 and \
        now - 2 * fall * fall / (before - fall) - fall > wanted  # fmt: skip


def _polygon(n: Numbers, entry: Entries) -> Absorbing:
    """Polygon of an evidence."""
    corners = []
    for corner in rows(entry["corners"], "evidence.corners", 200):
        s, a = rows(corner, "evidence.corners", 2, 2)
        corners.append((rational(s, "evidence.corners"), rational(a, "evidence.corners")))
    return Absorbing(law(n), tuple(corners))


def polygon_step(n: Numbers, entry: Entries) -> list[str]:
    """Every run comes into the polygon; the ticks after that are no inequality."""
    return list(smt_steps(_polygon(n, entry["evidence"])))


def _check(n: Numbers, given: Entries) -> None:
    entry = read_mapping(given, ("corners", "ticks", "bound"), "evidence", True)
    ticks = whole(entry["ticks"], "evidence.ticks", 1, MOST_WORK)
    bound = rational(entry["bound"], "evidence.bound")
    if not n["lag"]:
        raise DoesNotHold("evidence: it is for a lag")
    start = _polygon(n, entry)
    if not start.holds():
        raise DoesNotHold("evidence: not every run comes into the polygon")
    ticker, work = Ticker(start), 0
    for _ in range(ticks):
        work += len(ticker.points) + 4
        if work > MOST_WORK * 2:
            raise DoesNotHold("evidence: the ticks take too long")
        ticker.tick()
    if ticker.largest() > bound:
        raise DoesNotHold("evidence: |s| is larger after these ticks")
    if "band" in n and bound > n["band"]:
        raise DoesNotHold("evidence: the bound is larger than the band")


def claim(n: Numbers, entry: Entries) -> str:
    """Clause of the bound that the proof finds itself."""
    found: Any = entry.get("evidence", {})
    if isinstance(found, dict) and "bound" in found:
        bound = rational(found["bound"], "evidence.bound")
    elif not n["lag"] and entry:
        bound = rounded_up(Fraction(no_lag_band(n["g1"], n["g2"], n["T"], n["D"])))
    else:
        return "|s| stays bounded in the end"
    return f"|s| stays below {number_text(bound, 'm/s')} at every tick in the end"


def _find_orbit(n: Numbers) -> Entries | None:
    at = law(n)
    if not at.lag or at.left[0] == at.left[1]:
        return None
    found = relay_orbits.find(at, n["band"])
    if found is None:
        return None
    _, (s, a) = relay_orbits.prove_orbit(at, *found)
    scale = 10**12
    return {
        "start": {"s": str(s if not n["g1"] else Fraction(round(s * scale), scale)),
                  "a": str(Fraction(round(a * scale), scale))},
        "signs": list(found[0]),
        "d": [str(n["D"] * push) for push in found[1]],
    }  # fmt: skip


def _replay(n: Numbers, given: Entries) -> str:
    entry = read_mapping(given, ("start", "signs", "d"), "run", True)
    start = read_mapping(entry["start"], ("s", "a"), "run.start", True)
    told = [rational(start[k], f"run.start.{k}") for k in ("s", "a")]
    signs = [whole(x, "run.signs", -1, 1) for x in rows(entry["signs"], "run.signs", 400)]
    d = [rational(x, "run.d") for x in rows(entry["d"], "run.d", 400, len(signs))]
    if not n["lag"] or not signs:
        raise DoesNotHold("run: it needs a lag and a period")
    if any(abs(x) not in (0, n["D"]) for x in d):
        raise DoesNotHold("run: d is not -D, 0 or D")
    pushes = tuple((x > 0) - (x < 0) for x in d)
    first = Fraction(0) if n["g1"] else told[0]  # with g1 the period itself says where it starts
    largest, begin = relay_orbits.prove_orbit(law(n), tuple(signs), pushes, first)
    near = max(largest, n["T"] * n["g2"]) / 10**6
    if any(abs(x - y) > near * (1 + (i and 1 / n["lag"])) for i, (x, y) in
           enumerate(zip(told, begin, strict=True))):  # fmt: skip
        raise DoesNotHold("run: it does not start where the period does")
    if largest <= n["band"]:
        raise DoesNotHold("run: |s| stays inside the band")
    return f"a run of period {len(signs)} ticks with |s| up to {number_text(largest, 'm/s', 6)}"


POLYGON = Evidence(_find, _check)
ORBIT = Refuter("band", _find_orbit, _replay)


def smt_steps(polygon: Absorbing) -> Iterator[str]:
    """Tick of the reaching law behind a lag from lam >= 1 times its polygon, against each side.

    For both ends of E = exp(-T/lag): the state that follows is affine in E, as is all else.
    """
    law = polygon.law
    push = law.T * law.D
    faces = list(_faces(polygon.corners))
    inside = [term("<=", sum_term(times(n, "s"), times(m, "a")), "lam") for n, m in faces]
    facts = [term("<=", 1, "lam"), term("<=", 0, "s"), *interval_terms(-push, "e", push), *inside]
    for left in _outward(law.left):
        (m11, m12, b1), (m21, m22, b2) = law.rows(left)
        claims = []
        for n, m in faces:
            moved = [times(n * m11 + m * m21, "s"), times(n * m12 + m * m22, "a"), times(n, "e")]
            claims.append(term("<", sum_term(*moved, -n * b1 - m * b2), "lam"))
        yield problem(("s", "a", "e", "lam"), facts, claims, "QF_LRA")


def _outward(ends: tuple[Fraction, Fraction], digits: int = 15) -> tuple[Fraction, Fraction]:
    """Interval with short ends that holds the one given."""
    one = 10**digits
    return Fraction(math.floor(ends[0] * one), one), Fraction(math.ceil(ends[1] * one), one)


def _faces(P: Sequence[Point]) -> Iterator[Point]:
    """Give (n, m) with n s + m a = 1 along each side of a polygon."""
    for (s, a), (s2, a2) in zip(P, [*P[1:], P[0]], strict=True):
        size = s * a2 - a * s2
        yield (a2 - a) / size, (s - s2) / size
