"""Systems that seek an extremum: sliding mode (Cheng 2022) and perturbation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from slipctl.certify import dither, sliding
from slipctl.certify import extremum as bounds
from slipctl.certify.entries import DoesNotHold, rational, rows, whole
from slipctl.certify.registry import register
from slipctl.certify.seal import opened, sealed
from slipctl.certify.systems import (
    ASIDE,
    EXACT,
    INPUT,
    SAMPLED,
    TARGET,
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
    rounded_up,
    spelled,
)
from slipctl.errors import BadInput

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


def _seeker(n: Numbers) -> sliding.Seeker:
    late = sliding.ticks_late(n.get("dead_time", 0), n["T"])
    return sliding.Seeker(n["k"], n["rho"], n["beta"], n["T"], n.get("noise", 0), late,
                          n.get("lag", 0))  # fmt: skip


def _least(n: Numbers) -> Any:
    return n.get("least", n["slope"])


def _slides(n: Numbers) -> Sequence[Side]:
    return [Side("rho < k least", n["rho"], n["k"] * _least(n))]


def _stays(n: Numbers) -> list[Side]:
    return [Side("(dead ticks + 1) (k slope + rho) T + 2 (noise + k slope lag) <= beta",
                 sliding.travel(_seeker(n), n["slope"]), n["beta"])]  # fmt: skip


def _climbs(n: Numbers) -> Sequence[Side]:
    return [*_slides(n), *_stays(n)]


def _hears(n: Numbers) -> Sequence[Side]:
    return [Side("2 rho T <= beta", 2 * n["rho"] * n["T"], n["beta"])]


def _ripples(n: Numbers) -> Sequence[Side]:
    p = _seeker(n)
    if not n.get("curvature"):
        return [Side("k T (floor((beta + 2 noise)/(rho T)) + 1) <= ripple",
                     sliding.flat_ripple(p), n["ripple"])]  # fmt: skip
    sides = [Side(*s) for s in sliding.ripple_sides(p, n["curvature"])]
    return [*sides, Side("k beta/rho + 2 r E/beta < ripple", sliding.ripple(p, n["curvature"]),
                         n["ripple"])]  # fmt: skip


def _in_time(n: Numbers) -> Sequence[Side]:
    return [*_climbs(n), Side("gap <= rho time - loss", n["gap"],
                              sliding.gained(_seeker(n), n["slope"], n["time"]))]  # fmt: skip


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
            "ripple_bound": (sliding.ripple(_seeker(n), n["curvature"]), "m/s"),
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


# Counterexamples, replayed with rationals.


def _find_behind(n: Numbers) -> Entries | None:
    p = _seeker(n)
    if p.lag:
        return None
    slopes = dict.fromkeys((_least(n), n["slope"]))
    for ticks in (200, sliding.MOST_TICKS):
        for slope in slopes:
            for share in (Fraction(1, 64), Fraction(65, 64), Fraction(127, 64), Fraction(37, 64)):
                for against in dict.fromkeys((bool(p.noise), False)):
                    start = share * p.beta
                    tick, _ = sliding.behind(p, slope, start, against, ticks)
                    if tick:
                        return sealed(n, {
                            "slope": str(slope), "start": str(start), "ticks": tick,
                            "noise": "against" if against else "none",
                        })  # fmt: skip
    return None


def _replay_behind(n: Numbers, run: Entries) -> str:
    p = _seeker(n)
    run = opened(n, run, ("slope", "start", "noise", "ticks"), "run")
    slope, start = (rational(run[k], f"run.{k}") for k in ("slope", "start"))
    ticks = whole(run["ticks"], "run.ticks", 1, sliding.MOST_TICKS)
    if p.lag or not _least(n) <= slope <= n["slope"] or run["noise"] not in ("against", "none"):
        raise DoesNotHold("run: its slope, its noise or a lag is outside of what was asked")
    tick, by = sliding.behind(p, slope, start, run["noise"] == "against", ticks)
    if not tick:
        raise DoesNotHold("run: mu does not fall behind by three cells")
    return f"after {tick} ticks mu is {float(by):.6g} behind a climb at rho"


def _find_late(n: Numbers) -> Entries | None:
    p = _seeker(n)
    late = sliding.gained_at_most(p, n["slope"], n["time"]) < n["gap"]
    late = late or n["k"] * n["slope"] * n["time"] < n["gap"]
    return sealed(n, {"slope": str(n["slope"])}) if late else None


def _replay_late(n: Numbers, run: Entries) -> str:
    """A bound of what that start can have gained, not a run: it may have any number of ticks."""
    p = _seeker(n)
    slope = rational(opened(n, run, ("slope",), "run")["slope"], "run.slope")
    if not _least(n) <= slope <= n["slope"]:
        raise DoesNotHold("run: its slope is not one that was asked")
    most = n["k"] * slope * n["time"]
    if all(s.holds() for s in _stays(n)):
        most = min(most, sliding.gained_at_most(p, slope, n["time"]))
    if not most < n["gap"]:
        raise DoesNotHold("run: it may be in time")
    shown = max(most, Fraction(0))
    return f"from just below a turning plane mu has gained {float(shown):.6g} at most by then"


def _find_swing(n: Numbers) -> Entries | None:
    p = _seeker(n)
    if not n.get("curvature"):
        ticks = math.ceil((p.beta + 2 * p.noise) / (p.rho * p.T))
        return sealed(n, {"ticks": ticks}) if p.k * p.T * ticks > n["ripple"] else None
    if p.lag:
        return None
    start = Fraction(-p.k * p.beta / (2 * p.rho)).limit_denominator(10**9)
    f = sliding.Seeker(float(p.k), float(p.rho), float(p.beta), float(p.T), float(p.noise), p.late)
    for count in (4, 20, 100, 300):
        parts = (count, count) if p.noise else (2, 2 * count - 2)
        found = list(sliding.turns(f, float(n["curvature"]), float(start), *parts))
        if sliding.last_swing(found, *parts) > float(n["ripple"]) * (1 + 1e-9):
            return sealed(n, {"start": str(start), "left": parts[0], "right": parts[1]})
    return None


def _replay_swing(n: Numbers, run: Entries) -> str:
    p = _seeker(n)
    if not n.get("curvature"):
        ticks = whole(opened(n, run, ("ticks",), "run")["ticks"], "run.ticks", 1, 10**300)
        allowed = ticks <= math.ceil((p.beta + 2 * p.noise) / (p.rho * p.T))
        if not (allowed and p.k * p.T * ticks > n["ripple"]):
            raise DoesNotHold("run: v does not move that far between two turns")
        return f"on a flat top v moves one way for {ticks} ticks"
    run = opened(n, run, ("start", "left", "right"), "run")
    start = rational(run["start"], "run.start")
    left, right = (whole(run[k], f"run.{k}", 2, sliding.MOST_TURNS) for k in ("left", "right"))
    if p.lag or abs(start) > sliding.zone(p, n["curvature"]) or max(
        x.denominator.bit_length() for x in (start, *p[:5]) if isinstance(x, Fraction)
    ) > 400:  # fmt: skip
        raise DoesNotHold("run: its start or a lag is outside of what was asked")
    found = list(sliding.turns(p, n["curvature"], start, left, right))
    swing = sliding.last_swing(found, left, right)
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
    wanted = spelled(n["ripple"], "m/s")
    if n.get("curvature"):
        return f"in the end v stays within an interval of {wanted} about the peak"
    return f"v moves by at most {wanted} between two turns on a flat top"


SLIDING_SEEK = register(System(
    "sliding_seek",
    "Cheng 2022 (22)-(36), sampled: v' = k sgn sin(pi (y - g)/beta), g' = rho, y = mu(v): does mu"
    " climb at rho where it has its steepest slope, and how much does v ripple at the peak?",
    {
        "k": Number("m/s^2", "rate of v", power=1.0),
        "rho": Number("1/s", "rate of g"),
        "beta": Number("1", "width of a cell"),
        "slope": Number("s/m", "steepest |mu'|", power=-1.0),
        "T": Number("s", "sample period", role=INPUT, says="a sample time of {}"),
        "least": Number("s/m", "least |mu'| of the way; that of the steepest if it is not told",
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
                            proves=("climbs",), covers=("T", *HEARD)),
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


# ---- perturbation -------------------------------------------------------------------------------

MOST_DITHER_TICKS = 60_000


def _loop(n: Numbers) -> dither.Loop:
    """The seeker without dimensions, of floats or as balls around rationals."""
    q = -n["k"] * n["curvature"] * n["a"] / n["w"]
    noise = n.get("noise", 0) / (abs(n["curvature"]) * n["a"] ** 2)
    return dither.Loop(q, n["w_l"] / n["w"], n["w_h"] / n["w"], n["w"] * n["T"], noise)


def _from(n: Numbers) -> Any:
    return n.get("start", n["a"])


def _seeks(n: Numbers) -> Sequence[Side]:
    return [Side("k curvature < 0", n["k"] * n["curvature"], 0)]


def _separated(n: Numbers) -> Sequence[Side]:
    return [Side("5 w_l <= w", 5 * n["w_l"], n["w"]),
            Side("5 w_h <= w", 5 * n["w_h"], n["w"])]  # fmt: skip


def _carried(n: Numbers) -> Sequence[Side]:
    return [Side("10 w T <= 6.283", 10 * n["w"] * n["T"], 6.283)]


def _slow(n: Numbers) -> Sequence[Side]:
    """Both averaged poles are slow against the dither: 5 |p| <= w."""
    p = bounds.perturbation_poles(*(float(n[k]) for k in ("k", "w_l", "a", "curvature")))
    return [Side("5 |pole| <= w", bounds.SEPARATION * max(abs(x) for x in p), float(n["w"]))]


PROOF = ("units", "rate", "orbit", "P")


def _find_return(n: Numbers, target: str) -> Entries | None:
    if not n["k"] * n["curvature"] < 0 or not n["w"] * n["T"] < 3:
        return None
    reach = float(n["reach"] / n["a"]) if target == "reach" and "reach" in n else None
    found = dither.find(_loop({k: float(v) for k, v in n.items()}), float(_from(n) / n["a"]), reach)
    if found is None:
        return None
    entries = sealed(n, {
        "units": [int(math.log2(u)) for u in found.proof.units],
        "rate": str(Fraction(str(found.proof.mu))),
        "orbit": [[repr(v) for v in row] for row in found.proof.orbit],
        "P": [[repr(v) for v in row] for row in found.proof.P],
    })  # fmt: skip
    try:
        _check_return(n, entries, target)
    except DoesNotHold:
        return None
    return entries


def _read_return(n: Numbers, entries: Entries) -> dither.Found:
    """Check the proof that a file brings.

    Raises:
        DoesNotHold: it proves nothing. BadInput: it is malformed.
    """
    units = [2.0 ** whole(u, "units", -60, 60) for u in rows(entries["units"], "units", 3, 3)]
    mu = float(rational(entries["rate"], "rate"))
    length = 2 * dither.DEGREE + 1
    orbit, P = (
        tuple(tuple(_decimal(v, k) for v in rows(row, k, length, length))
              for row in rows(entries[k], k, count, count))
        for k, count in (("orbit", 3), ("P", 6))
    )  # fmt: skip
    exact = _loop({k: Fraction(v) for k, v in n.items()})
    found = dither.proven(exact, dither.Proof(orbit, P, (units[0], units[1], units[2]), mu))
    if found is None:
        raise DoesNotHold("its function need not fall")
    return found


def _decimal(text: Any, where: str) -> float:
    """Number of a text; a proof may be any numbers, so that its last digit is no matter."""
    try:
        value = float(text) if isinstance(text, str) and len(text) < 30 else math.nan
    except ValueError:
        value = math.nan
    if not abs(value) <= 1e6 or repr(value) != text:
        raise BadInput(f"{where} must hold decimal numbers of at most 1e6, written shortest")
    return value


def _check_return(n: Numbers, entries: Entries, target: str) -> None:
    found = _read_return(n, opened(n, entries, PROOF, "evidence"))
    value = _bounds_of(n, found)[target]
    if value is None:
        raise DoesNotHold("evidence: it does not return from as far as that")
    if target in n and not value < n[target]:
        raise DoesNotHold(f"evidence: {target} is {float(value):.6g}, more than what was asked")


def _bounds_of(n: Numbers, found: dither.Found) -> dict[str, Fraction | None]:
    """What is proven in m/s, as rationals that are rounded up."""
    a, start = Fraction(n["a"]), float(_from(n) / n["a"]) * (1 + 1e-12)
    reach = found.reach(start)
    if reach is None:
        return {"reach": None, "rest": None}
    return {"reach": rounded_up(Fraction(reach) * a, 9),
            "rest": rounded_up(Fraction(found.rest()) * a, 9)}  # fmt: skip


def _farthest(n: Numbers) -> Any:
    """What a run must exceed to leave: what was asked, or ten times its start."""
    return n["reach"] if "reach" in n else 10 * max(_from(n), n["a"])


def _return_claim(name: str) -> Any:
    def claim(n: Numbers, entry: Entries) -> str:
        words = {"reach": "|th - v*| never exceeds {}",
                 "rest": "in the end |th - v*| stays below {}"}[name]  # fmt: skip
        wanted = n.get(name, _farthest(n) if name == "reach" else max(_from(n), n["a"]))
        if name not in n and "evidence" in entry:
            proof = opened(n, entry["evidence"], PROOF, "evidence")
            wanted = _bounds_of(n, _read_return(n, proof))[name] or wanted
            wanted = rounded_up(wanted)
        return words.format(spelled(wanted, "m/s"))

    return claim


def _find_flight(n: Numbers) -> Entries | None:
    """Run that leaves: from either end of the starts, with floats."""
    limit, noise = float(_farthest(n)), float(n.get("noise", 0))
    for start in (float(_from(n)), -float(_from(n))):
        for against in dict.fromkeys((bool(noise), False)):
            tick = _flight(n, start, limit, against)
            if tick:
                return sealed(n, {
                    "start": str(_from(n) * (1 if start > 0 else -1)), "ticks": tick,
                    "noise": "outward" if against else "none",
                })  # fmt: skip
    return None


def _flight(n: Numbers, start: float, limit: float, against: bool) -> int:
    k, w, w_l, w_h, a, c, T = (float(n[x]) for x in ("k", "w", "w_l", "w_h", "a", "curvature", "T"))
    noise = float(n.get("noise", 0)) if against else 0.0
    th, xi, eta = start, 0.0, c / 2 * start * start
    for i in range(MOST_DITHER_TICKS):
        s = math.sin(w * T * i)
        high = c / 2 * (th + a * s) ** 2 - eta + math.copysign(noise, s * start * k)
        th, xi, eta = th + T * k * xi, xi + T * w_l * (high * s - xi), eta + T * w_h * high
        if not abs(th) <= limit * (1 + 1e-9):
            return i + 1
    return 0


def _replay_flight(n: Numbers, run: Entries) -> str:
    """Whole numbers of 60 digits, with a bound of their error that grows at every tick."""
    run = opened(n, run, ("start", "noise", "ticks"), "run")
    start = rational(run["start"], "run.start")
    ticks = whole(run["ticks"], "run.ticks", 1, MOST_DITHER_TICKS)
    if abs(start) > _from(n) or run["noise"] not in ("outward", "none"):
        raise DoesNotHold("run: its start or its noise is outside of what was asked")
    limit = _farthest(n)
    far = dither.flight(
        {k: n[k] for k in ("k", "w", "w_l", "w_h", "a", "curvature", "T")}, start,
        n.get("noise", Fraction(0)) if run["noise"] == "outward" else Fraction(0), ticks,
    )  # fmt: skip
    if far is None or not far > limit:
        raise DoesNotHold("run: it does not leave")
    return f"after {ticks} ticks |th - v*| exceeds {float(limit):.6g} m/s"


def _quiet(n: Numbers) -> dict[str, Any]:
    """The same seeker without noise, from an amplitude or less: one of its starts."""
    kept = {k: v for k, v in n.items() if k not in ("reach", "rest", "noise")}
    return kept | {"start": min(_from(n), n["a"])}


def _find_swings_on(n: Numbers) -> Entries | None:
    if "rest" not in n:
        return None
    plain = _quiet(n)
    entries = _find_return(plain, "rest")
    if entries is None:
        return None
    proof = opened(plain, entries, PROOF, "run")
    tick = _read_return(plain, proof).beyond(
        _loop({k: float(v) for k, v in plain.items()}), float(plain["start"] / n["a"]),
        float(n["rest"] / n["a"]),
    )  # fmt: skip
    return None if tick is None else sealed(n, {"ticks": tick, **proof})


def _replay_swings_on(n: Numbers, run: Entries) -> str:
    plain = _quiet(n)
    proof = opened(n, run, ("ticks", *PROOF), "run")
    tick = whole(proof["ticks"], "run.ticks", 1, 10**12)
    start = float(plain["start"] / n["a"]) * (1 + 1e-12)
    least = _read_return(plain, proof).at_least(_loop(plain), start, tick)
    if "rest" not in n or not Fraction(least) * n["a"] > n["rest"]:
        raise DoesNotHold("run: th does not swing that far")
    return (f"th follows a periodic orbit, and at tick {tick} |th - v*| is above"
            f" {least * float(n['a']):.6g} m/s")  # fmt: skip


def _perturbation_guard(n: Numbers) -> None:
    for name in ("k", "curvature"):
        if n[name] == 0:
            raise BadInput(f"{name} = 0 seeks nothing; write another number")


def _perturbation_values(n: Numbers) -> dict[str, Quantity]:
    gain = bounds.washout(n["w"], n["w_h"])
    slow, fast = bounds.perturbation_poles(n["k"], n["w_l"], n["a"], n["curvature"], gain)
    found = {
        "slow_pole": (slow.real, "1/s"), "slow_pole_imaginary": (slow.imag, "1/s"),
        "fast_pole": (fast.real, "1/s"),
        "loss_of_mu": (bounds.perturbation_loss(n["a"], n["curvature"]), "1"),
        "washout": (gain, "1"),
    }  # fmt: skip
    if "third" in n:
        bias = bounds.perturbation_bias(n["a"], n["curvature"], n["third"])
        found["bias"] = (bias, "m/s")
    return found


def _perturbation_witness(n: Numbers) -> Witness:
    """Seeker on the parabola of the curvature, tick by tick from its farthest start."""
    k, w_l, w_h, w, a, T, c = (float(n[x]) for x in ("k", "w_l", "w_h", "w", "a", "T", "curvature"))
    first = float(_from(n))
    th, xi, eta, kept = first, 0.0, c / 2 * first * first, [(0.0, first)]
    for i in range(MOST_DITHER_TICKS):
        s = math.sin(w * T * i)
        high = c / 2 * (th + a * s) ** 2 - eta
        th, xi, eta = th + T * k * xi, xi + T * w_l * (high * s - xi), eta + T * w_h * high
        kept.append(((i + 1) * T, th))
        if not abs(th) <= 1e3 * max(a, first):
            break
    every = max(1, len(kept) // 200)
    return Witness(
        "none; from the farthest start on a parabola of that curvature",
        {"distance_over_the_start": (abs(th) / first, "1"), "run": (kept[-1][0], "s")},
        {"t": ("s", [r[0] for r in kept[::every]]), "th": ("m/s", [r[1] for r in kept[::every]])},
    )


PERTURBATION_SEEK = register(System(
    "perturbation_seek",
    "v = th + a sin wt, th' = k xi, xi' = w_l ((y - eta) sin wt - xi), eta' = w_h (y - eta),"
    " sampled, on the parabola y of a peak at v*: does th stay near v* and come back to it?",
    {
        "k": Number("m/s^2", "gain, in v/mu per s", low="any", power=1.0),
        "w": Number("1/s", "dither"),
        "w_l": Number("1/s", "corner of the low-pass"),
        "w_h": Number("1/s", "corner of the washout"),
        "a": Number("m/s", "amplitude of the dither", power=1.0),
        "curvature": Number("s^2/m^2", "mu'' at the extremum", None, "any", -2.0),
        "third": Number("s^3/m^3", "mu''' there", None, "any", -3.0, True, role=ASIDE),
        "T": Number("s", "sample period", 1e-3, role=INPUT, says="a sample time of {}"),
        "noise": HEARD["noise"],
        "start": Number("m/s", "farthest |th - v*| at the start; a if it is not told", None,
                        power=1.0, optional=True),
        "reach": Number("m/s", "farthest |th - v*| wanted", None, power=1.0, optional=True,
                        role=TARGET),
        "rest": Number("m/s", "wanted |th - v*| in the end", None, power=1.0, optional=True,
                       role=TARGET),
    },
    {
        **{name: Criterion(f"a periodic Lyapunov function falls, tick by tick: {name}",
                           evidence=Evidence(partial(_find_return, target=name),
                                             partial(_check_return, target=name)),
                           proves=(name,), covers=("T", "noise"))
           for name in ("reach", "rest")},
        "averaged": Criterion("the averaged loop is stable (for w -> infinity)", _seeks),
        "separated": Criterion("the dither is 5 times faster than both corners (a rule)",
                               _separated, margins=("smallest_w", "largest_w_l", "largest_w_h")),
        "slow": Criterion("both averaged poles are 5 times slower than the dither (a rule)", _slow,
                          margins=("smallest_w", "largest_a")),
        "carried": Criterion("ten ticks to a period of the dither (a rule)", _carried,
                             margins=("largest_w", "largest_T")),
    },
    {
        "reach": Target(_return_claim("reach")),
        "rest": Target(_return_claim("rest")),
    },
    start=lambda n: f"every |th - v*| <= {spelled(_from(n), 'm/s')} with xi = 0, eta = y, wt = 0",
    refuters={
        "reach": Refuter("reach", _find_flight, _replay_flight),
        "rest": Refuter("rest", _find_swings_on, _replay_swings_on),
    },
    never=("a dead time", "a lag", "a map that is no parabola"),
    values=_perturbation_values,
    witness=_perturbation_witness,
    panel=({"k": 200.0, "w": 12.566, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544},
           {"k": -2.0, "w": 1.0, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544,
            "T": 1.0}),
    guard=_perturbation_guard,
    time=lambda n: SAMPLED,
))  # fmt: skip
