"""System that seeks an extremum by a sliding mode, after Cheng 2022."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify import smtlib
from slipctl.certify.bounds import extremum as bounds
from slipctl.certify.checksum import with_checksum, without_checksum
from slipctl.certify.entries import DoesNotHold, rational, whole
from slipctl.certify.registry import register
from slipctl.certify.systems import (
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
from slipctl.models.cheng_2022.certificate import sliding_seeker

HEARD = {
    "noise": Number("1", "largest error of the measured value", 0.0, "not negative", role=INPUT,
                    says="an error of the measured value up to {}", absent="measurement noise"),
    "dead_time": Number("s", "age of the measured value", 0.0, "not negative", role=INPUT,
                        says="a dead time of {}", absent="a dead time"),
    "lag": Number("s", "time constant of the measurement", 0.0, "not negative", role=INPUT,
                  says="a lag of {}", absent="a lag"),
}  # fmt: skip
"""What a seeker hears of the value."""


# ---- sliding mode -------------------------------------------------------------------------------


def _seeker(n: Numbers) -> sliding_seeker.Seeker:
    late = sliding_seeker.ticks_late(n.get("dead_time", 0), n["T"])
    return sliding_seeker.Seeker(n["k"], n["rho"], n["beta"], n["T"], n.get("noise", 0), late,
                          n.get("lag", 0))  # fmt: skip


def _least(n: Numbers) -> Any:
    return n.get("least", n["slope"])


def _slides(n: Numbers) -> Sequence[Side]:
    return [Side("rho < k least", n["rho"], n["k"] * _least(n))]


def _stays(n: Numbers) -> list[Side]:
    return [Side("(dead ticks + 1) (k slope + rho) T + 2 (noise + k slope lag) <= beta",
                 sliding_seeker.travel(_seeker(n), n["slope"]), n["beta"])]  # fmt: skip


def _climbs(n: Numbers) -> Sequence[Side]:
    return [*_slides(n), *_stays(n)]


def _climbs_step(n: Numbers, entry: Entries) -> str:
    """No plane is met but the one that is slid on, for every slope, in the ticks that are late.

    d is mu(v) - g at the tick before a turn is heard, t how many ticks of it have passed.
    """
    term, plus, times = smtlib.term, smtlib.sum_term, smtlib.times
    p = _seeker(n)
    heard = sliding_seeker.heard_error(p, n["slope"])
    facts = [*smtlib.interval_terms(_least(n), "m", n["slope"]),
             *smtlib.interval_terms(Fraction(0), "t", Fraction(p.late + 1))]  # fmt: skip
    climb = times(p.k * p.T, "m")
    down = plus("d", times(-1, "t", plus(climb, p.rho * p.T)))
    up = plus("d", times("t", plus(climb, -p.rho * p.T)))
    claim = term(
        "and",
        term("<", p.rho * p.T, climb),
        term("=>", term("<=", p.beta - heard, "d"), term("<=", heard, down)),
        term("=>", term("<=", "d", p.beta + heard), term("<=", up, 2 * p.beta - heard)),
    )
    return smtlib.problem(("m", "t", "d"), facts, claim)


def _hears(n: Numbers) -> Sequence[Side]:
    return [Side("2 rho T <= beta", 2 * n["rho"] * n["T"], n["beta"])]


def _ripples(n: Numbers) -> Sequence[Side]:
    p = _seeker(n)
    if not n.get("curvature"):
        return [Side("k T (floor((beta + 2 noise)/(rho T)) + 1) <= ripple",
                     sliding_seeker.flat_ripple(p), n["ripple"])]  # fmt: skip
    sides = [Side(*s) for s in sliding_seeker.ripple_sides(p, n["curvature"])]
    return [*sides, Side("2 X, in whole k T, <= ripple", sliding_seeker.ripple(p, n["curvature"]),
                         n["ripple"])]  # fmt: skip


def _in_time(n: Numbers) -> Sequence[Side]:
    gain = sliding_seeker.least_gain(_seeker(n), n["slope"], n["time"])
    return [*_climbs(n), Side("gap <= rho time - loss", n["gap"], gain)]


def _sliding_guard(n: Numbers) -> None:
    if n.get("least", 0) > n["slope"]:
        raise BadInput(
            f"least = {float(n['least']):g} s/m must not exceed slope = {float(n['slope']):g} s/m"
        )
    if n.get("curvature") == 0:
        raise BadInput("curvature = 0 is a flat top; leave it out, or write that of the peak")
    if ("gap" in n) != ("time" in n):
        told, other = ("gap", "time") if "gap" in n else ("time", "gap")
        raise BadInput(f"{told} asks for nothing without {other}; add --set {other}=VALUE")


def _sliding_values(n: Numbers) -> dict[str, Quantity]:
    k, rho, beta = n["k"], n["rho"], n["beta"]
    found = {
        "sliding_somewhere": (float(bounds.regime(k, rho, n["slope"]) == bounds.SLIDING), "1"),
        "rate_at_that_slope": (bounds.averaged_rate(k, rho, n["slope"]), "m/s^2"),
        "ripple_at_the_peak": (bounds.ripple(k, beta, rho), "m/s"),
        "ripple_at_the_peak_sampled": (bounds.sampled_ripple(k, beta, rho, n["T"]), "m/s"),
    }
    if n.get("curvature"):
        found |= {
            "last_time_constant": (bounds.time_constant(k, rho, n["curvature"]), "s"),
            "sliding_stops_at": (bounds.sliding_zone(k, rho, n["curvature"]), "m/s"),
            "ripple_bound": (sliding_seeker.ripple(_seeker(n), n["curvature"]), "m/s"),
        }
    return found


def _sliding_witness(n: Numbers) -> Witness:
    """Seeker on a constant slope: in a sliding mode the speed is rho/mu', here it is not."""
    k, rho, beta, slope = n["k"], n["rho"], n["beta"], n["slope"]
    cycle = 2 * beta * rho / max(abs(rho * rho - (k * slope) ** 2), 1e-3 * rho * rho)
    h, most = n["T"], 40_000
    v, delta, rows_ = 0.0, 0.5 * beta, [(0.0, 0.0)]
    for i in range(1, most + 1):
        sign = math.copysign(1.0, math.sin(math.pi * math.fmod(delta, 2 * beta) / beta))
        v, delta = v + h * k * sign, delta + h * (k * slope * sign - rho)
        rows_.append((i * h, v))
        if i * h > 20 * cycle and i > 100:
            break
    t, rate = rows_[-1][0], v / rows_[-1][0]
    every = max(1, len(rows_) // 200)
    kept = rows_[::every]
    return Witness(
        f"none; on a constant slope of {slope:g} s/m, tick by tick",
        {"mean_rate": (rate, "m/s^2"), "rate_of_a_sliding_mode": (rho / slope, "m/s^2"),
         "run": (t, "s")},
        {"t": ("s", [r[0] for r in kept]), "v": ("m/s", [r[1] for r in kept])},
    )  # fmt: skip


PARTS = (4, 20, 100, 300)
"""Half cycles of each part of a run that is searched at the peak."""

STARTS = tuple(Fraction(s, 10) for s in (10, 7, 3, -1, -4, -8))
"""Where such a run starts, in halves of the ripple."""

SEARCHED = 4000
"""Ticks in which a seeker is searched that falls behind."""


# Counterexamples, replayed with rationals.


def _find_behind(n: Numbers) -> Entries | None:
    p, least = _seeker(n), _least(n)
    if p.k * least < p.rho:
        ticks = math.ceil(3 * p.beta / ((p.rho - p.k * least) * p.T))
        return with_checksum(
            n, {"slope": str(least), "start": "0", "ticks": ticks, "noise": "none"}
        )
    if p.lag or p.late > SEARCHED:
        return None
    for ticks in (200, SEARCHED):
        for slope in dict.fromkeys((n["slope"], least)):
            for share in (Fraction(1, 64), Fraction(65, 64), Fraction(127, 64), Fraction(37, 64)):
                for against in dict.fromkeys((bool(p.noise), False)):
                    start = share * p.beta
                    tick, _ = sliding_seeker.first_tick_behind(p, slope, start, against, ticks)
                    if tick:
                        return with_checksum(n, {
                            "slope": str(slope), "start": str(start), "ticks": tick,
                            "noise": "against" if against else "none",
                        })  # fmt: skip
    return None


def _replay_behind(n: Numbers, run: Entries) -> str:
    p = _seeker(n)
    run = without_checksum(n, run, ("slope", "start", "noise", "ticks"), "run")
    slope, start = (rational(run[k], f"run.{k}") for k in ("slope", "start"))
    ticks = whole(run["ticks"], "run.ticks", 1, 10**300)
    if not _least(n) <= slope <= n["slope"] or run["noise"] not in ("against", "none"):
        raise DoesNotHold("run: its slope or its noise is outside of what was asked")
    by = (p.rho - p.k * slope) * p.T * ticks  # mu cannot climb faster than k slope
    tick = ticks
    if by < 3 * p.beta:
        if p.lag or max(p.late, ticks) > sliding_seeker.MOST_TICKS:
            raise DoesNotHold("run: it has a lag, or more ticks than are replayed")
        tick, by = sliding_seeker.first_tick_behind(
            p, slope, start, run["noise"] == "against", ticks
        )
    if by < 3 * p.beta:
        raise DoesNotHold("run: mu does not fall behind by three cells")
    return f"after {tick} ticks mu is {float(by):.6g} behind a climb at rho"


def _find_late(n: Numbers) -> Entries | None:
    p = _seeker(n)
    late = sliding_seeker.gained_at_most(p, n["slope"], n["time"]) < n["gap"]
    late = late or n["k"] * n["slope"] * n["time"] < n["gap"]
    return with_checksum(n, {"slope": str(n["slope"])}) if late else None


def _replay_late(n: Numbers, run: Entries) -> str:
    """A bound of what that start can have gained, not a run: it may have any number of ticks."""
    p = _seeker(n)
    slope = rational(without_checksum(n, run, ("slope",), "run")["slope"], "run.slope")
    if not _least(n) <= slope <= n["slope"]:
        raise DoesNotHold("run: its slope is not one that was asked")
    most = n["k"] * slope * n["time"]
    if all(s.holds() for s in _stays(n)):
        most = min(most, sliding_seeker.gained_at_most(p, slope, n["time"]))
    if not most < n["gap"]:
        raise DoesNotHold("run: it may be in time")
    shown = max(most, Fraction(0))
    return f"from just below a turning plane mu has gained {float(shown):.6g} at most by then"


def _find_swing(n: Numbers) -> Entries | None:
    p = _seeker(n)
    if not n.get("curvature"):
        ticks = math.ceil((p.beta + 2 * p.noise) / (p.rho * p.T))
        return with_checksum(n, {"ticks": ticks}) if p.k * p.T * ticks > n["ripple"] else None
    if p.lag:
        return None
    near = p.k * p.beta / (2 * p.rho)
    f = sliding_seeker.Seeker(
        float(p.k), float(p.rho), float(p.beta), float(p.T), float(p.noise), p.late
    )
    wanted = float(n["ripple"]) * (1 + 1e-9)
    if float(sliding_seeker.ripple(p, n["curvature"])) < wanted:
        return None
    for count in PARTS:
        for share in STARTS:
            start = Fraction(-near * share).limit_denominator(10**9)
            found = list(sliding_seeker.turns(f, float(n["curvature"]), float(start), count, count))
            if sliding_seeker.last_swing(found, count, count) > wanted:
                return with_checksum(n, {"start": str(start), "left": count, "right": count})
    return None


def _replay_swing(n: Numbers, run: Entries) -> str:
    p = _seeker(n)
    if not n.get("curvature"):
        ticks = whole(without_checksum(n, run, ("ticks",), "run")["ticks"], "run.ticks", 1, 10**300)
        allowed = ticks <= math.ceil((p.beta + 2 * p.noise) / (p.rho * p.T))
        if not (allowed and p.k * p.T * ticks > n["ripple"]):
            raise DoesNotHold("run: v does not move that far between two turns")
        return f"on a flat top v moves one way for {ticks} ticks"
    run = without_checksum(n, run, ("start", "left", "right"), "run")
    start = rational(run["start"], "run.start")
    left, right = (
        whole(run[k], f"run.{k}", 2, sliding_seeker.MOST_TURNS) for k in ("left", "right")
    )
    if p.lag or abs(start) > sliding_seeker.zone(p, n["curvature"]) or max(
        x.denominator.bit_length() for x in (start, *p[:5]) if isinstance(x, Fraction)
    ) > 400:  # fmt: skip
        raise DoesNotHold("run: its start or a lag is outside of what was asked")
    found = list(sliding_seeker.turns(p, n["curvature"], start, left, right))
    swing = sliding_seeker.last_swing(found, left, right)
    if not swing > n["ripple"]:
        raise DoesNotHold("run: v stays within the wanted ripple")
    return (f"after {found[-1].tick} ticks v has moved by {float(swing):.6g} m/s between two turns,"
            " and does so again")  # fmt: skip


def _sliding_start(n: Numbers) -> str:
    top = ""
    if "ripple" in n and n.get("curvature"):
        top = ", for the peak from every |v - v*| <= rho/(k |curvature|) on its parabola"
    least, most = float(_least(n)), float(n["slope"])
    slope = f"mu' of {most:g} s/m" if least == most else f"mu' between {least:g} and {most:g} s/m"
    return f"every v at rest and every g, where |mu'| is {slope[4:]}{top}"


def _ripple_claim(n: Numbers, _: Entries) -> str:
    wanted = number_text(n["ripple"], "m/s")
    if n.get("curvature"):
        return f"in the end v stays within an interval of {wanted} about the peak"
    return f"v moves by at most {wanted} between two turns on a flat top"


SLIDING_SEEK = register(System(
    "sliding_seek",
    "Cheng 2022 (22)-(36), sampled: v' = k sgn sin(pi (y - g)/beta), g' = rho, y = mu(v). Does mu"
    " climb at rho where it has its steepest slope, and how much does v ripple at the peak?",
    {
        "k": Number("m/s^2", "rate of v", power=1.0),
        "rho": Number("1/s", "rate of g"),
        "beta": Number("1", "width of a cell"),
        "slope": Number("s/m", "steepest |mu'|", power=-1.0),
        "T": Number("s", "sample period", role=INPUT, says="a sample time of {}"),
        "least": Number("s/m", "least |mu'| on the climb; that of the steepest if it is not told",
                        None, power=-1.0, optional=True),
        **HEARD,
        "curvature": Number("s^2/m^2", "mu'' at the peak", None, "any", -2.0, True),
        "ripple": Number("m/s", "wanted ripple of v at the peak", power=1.0, optional=True,
                         role=TARGET),
        "gap": Number("1", "mu to be gained", optional=True, role=TARGET),
        "time": Number("s", "in which time", optional=True, role=TARGET),
    },
    {
        "climbs": Criterion("a sliding mode exists and no tick leaves its plane", _climbs,
                            margins=("largest_T", "largest_rho", "smallest_beta"),
                            proves=("climbs",), covers=("T", *HEARD), step=_climbs_step),
        "sliding": Criterion("continuous: a sliding mode exists at the least slope", _slides, EXACT,
                             ("largest_rho", "smallest_k", "smallest_slope")),
        "hears": Criterion("two ticks fit into a cell (a rule)", _hears,
                           margins=("largest_T", "largest_rho", "smallest_beta")),
        "ripple": Criterion("what v ends in at the peak, noise and delay included", _ripples,
                            margins=("largest_beta", "smallest_ripple"), needs=("ripple",),
                            proves=("ripple",), covers=("T", *HEARD)),
        "in_time": Criterion("mu climbs at rho, less what a start may lose", _in_time,
                             margins=("smallest_time", "largest_gap"), needs=("gap", "time"),
                             proves=("in_time",), covers=("T", *HEARD)),
    },
    {
        "climbs": Target("mu never falls behind a climb at rho by three cells, 3 beta"),
        "ripple": Target(_ripple_claim, ("ripple",), "a ripple at the peak"),
        "in_time": Target("mu is {gap} higher from {time} on, as long as the slope lasts",
                          ("gap", "time"), "a time"),
    },
    start=_sliding_start,
    refuters={
        "climbs": Refuter("climbs", _find_behind, _replay_behind),
        "in_time": Refuter("in_time", _find_late, _replay_late),
        "ripple": Refuter("ripple", _find_swing, _replay_swing),
    },
    never=("a map whose slope varies faster than its parabola at the peak", "limits of v"),
    values=_sliding_values,
    witness=_sliding_witness,
    panel=({"k": 1.0, "rho": 0.1, "beta": 0.02, "slope": 0.66, "T": 2e-4, "ripple": 0.1},
           {"k": 1.0, "rho": 1.0, "beta": 0.1, "slope": 0.66, "T": 2e-4}),
    guard=_sliding_guard,
    time=lambda n: SAMPLED,
))  # fmt: skip
