"""System that seeks an extremum by a dither, on a parabola."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from slipctl.certify.bounds import extremum as bounds
from slipctl.certify.checksum import with_checksum, without_checksum
from slipctl.certify.entries import DoesNotHold, rational, rows, whole
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    ASIDE,
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
    number_text,
    rounded_up,
)
from slipctl.errors import BadInput
from slipctl.models.cheng_2022.certificate import (
    dither,
    dither_flight,
    dither_push,
    dither_search,
    sliding_seeker,
)
from slipctl.models.cheng_2022.certificate.ball import UP, WELL_UP
from slipctl.models.cheng_2022.certificate.seeking_kind import HEARD

MOST_DITHER_TICKS = 60_000

SOON, LATER = 8, 40
"""How many of the averaged loop's time constants a run is followed: before a proof is looked for
(only where the averaged loop grows), and after; e^-8 and e^-40 of the start are left where it dies
out."""


def _loop(n: Numbers) -> dither.Loop:
    """The seeker without dimensions, of floats or as balls around rationals."""
    q = -n["k"] * n["curvature"] * n["a"] / n["w"]
    noise = n.get("noise", 0) / (abs(n["curvature"]) * n["a"] ** 2)
    return dither.Loop(q, n["w_l"] / n["w"], n["w_h"] / n["w"], n["w"] * n["T"], noise,
                       _late(n), n.get("lag", 0) / n["T"])  # fmt: skip


def _late(n: Numbers) -> int:
    """Ticks of the dead time, rounded up."""
    return sliding_seeker.ticks_late(n.get("dead_time", 0), n["T"])


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
    exact = _loop({k: Fraction(v) for k, v in n.items()})
    swing = dither_search.swing(exact) if target == "rest" and "rest" in n else 0.0
    if swing is None or not swing * n["a"] < n.get("rest", 1):
        return None  # it swings farther by itself
    blurred = exact.noise or exact.late or exact.lag  # else where it rests is that of the orbit
    reach = None
    if "reach" in n and (target == "reach" or not blurred):
        reach = float(n["reach"] / n["a"])
    found = dither_search.find(exact, float(_from(n) / n["a"]), reach)
    if found is None:
        return None
    entries = with_checksum(n, {
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
    length = 2 * dither_search.DEGREE + 1
    orbit, P = (
        tuple(tuple(_decimal(v, k) for v in rows(row, k, length, length))
              for row in rows(entries[k], k, count, count))
        for k, count in (("orbit", 3), ("P", 6))
    )  # fmt: skip
    exact = _loop({k: Fraction(v) for k, v in n.items()})
    found = dither.check_proof(exact, dither.Proof(orbit, P, (units[0], units[1], units[2]), mu))
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
    found = _read_return(n, without_checksum(n, entries, PROOF, "evidence"))
    if found.reach(_first(n)) is None:
        raise DoesNotHold("evidence: it does not return from as far as that")
    value = _bounds_of(n, found, target) if target in n else None
    if value is not None and not value < n[target]:
        raise DoesNotHold(f"evidence: {target} is {float(value):.6g}, more than what was asked")


def _first(n: Numbers) -> float:
    """Farthest start in amplitudes, rounded up."""
    return float(_from(n) / n["a"]) * UP


def _bounds_of(n: Numbers, found: dither.Found, target: str) -> Fraction | None:
    """What is proven in m/s, as a rational that is rounded up."""
    reach = found.reach(_first(n))
    if reach is None:
        return None
    value = reach if target == "reach" else found.rest()
    if target == "rest" and n.get("noise") and not value * n["a"] < n.get("rest", 0):
        wanted = float(n["rest"] / n["a"]) if "rest" in n else math.inf
        value = min(value, dither_push.at_most(_plain(n), found, wanted))
    return rounded_up(Fraction(value) * Fraction(n["a"]), 9)


def _farthest(n: Numbers) -> Any:
    """What a run must exceed to leave: what was asked, or ten times its start."""
    return n["reach"] if "reach" in n else 10 * max(_from(n), n["a"])


def _return_claim(name: str) -> Any:
    def claim(n: Numbers, entry: Entries) -> str:
        words = {"reach": "|th - v*| never exceeds {}",
                 "rest": "in the end |th - v*| stays below {}"}[name]  # fmt: skip
        wanted = n.get(name, _farthest(n) if name == "reach" else max(_from(n), n["a"]))
        if name not in n and "evidence" in entry:
            proof = without_checksum(n, entry["evidence"], PROOF, "evidence")
            wanted = _bounds_of(n, _read_return(n, proof), name) or wanted
            wanted = rounded_up(wanted)
        return words.format(number_text(wanted, "m/s"))

    return claim


def _find_flight(n: Numbers, constants: float = LATER) -> Entries | None:
    """Run that leaves: from either end of the starts, with floats."""
    if n["w"] * n["T"] > 4 or _late(n) > dither_flight.OLDEST:
        return None
    limit = float(_farthest(n)) * WELL_UP
    plain = {k: float(v) for k, v in n.items()}
    poles = bounds.perturbation_poles(*(plain[k] for k in ("k", "w_l", "a", "curvature")))
    slowest = max(min(abs(p.real) for p in poles) * plain["T"], 1 / MOST_DITHER_TICKS)
    most = min(int(constants / slowest) + 100 * SOON, MOST_DITHER_TICKS)
    for against in dict.fromkeys((bool(n.get("noise")), False)):
        for side in (1, -1):
            run = dither_flight.ticks(plain, float(side * _from(n)), _late(n), against, most, limit)
            left = next(run, None)
            if left:
                return with_checksum(n, {
                    "start": str(side * _from(n)), "ticks": left[0],
                    "noise": "outward" if against else "none",
                })  # fmt: skip
    return None


def _find_soon(n: Numbers) -> Entries | None:
    """Run that leaves, of a loop that grows on average; of another a proof takes less work."""
    poles = bounds.perturbation_poles(*(float(n[k]) for k in ("k", "w_l", "a", "curvature")))
    return _find_flight(n, SOON) if max(p.real for p in poles) > 0 else None


def _replay_flight(n: Numbers, run: Entries) -> str:
    """Whole numbers of 60 digits, with a bound of their error that grows at every tick."""
    run = without_checksum(n, run, ("start", "noise", "ticks"), "run")
    start = rational(run["start"], "run.start")
    ticks = whole(run["ticks"], "run.ticks", 1, MOST_DITHER_TICKS)
    late = _late(n)
    asked = abs(start) <= _from(n) and run["noise"] in ("outward", "none")
    if n["w"] * n["T"] > 4 or late > dither_flight.OLDEST or not asked:
        raise DoesNotHold("run: its start or its noise is outside of what was asked")
    limit = _farthest(n)
    far = dither_flight.flight(
        n, start, n.get("noise", Fraction(0)) if run["noise"] == "outward" else Fraction(0), ticks,
        late,
    )  # fmt: skip
    if far is None or not far > limit:
        raise DoesNotHold("run: it does not leave")
    return f"after {ticks} ticks |th - v*| exceeds {float(limit):.6g} m/s"


def _quiet(n: Numbers) -> dict[str, Any]:
    """The same seeker without noise, from near the peak: one of its starts."""
    kept = {k: v for k, v in n.items() if k not in ("reach", "rest", "noise")}
    return kept | {"start": min(_from(n), n["a"]) / 100}


def _find_swings_on(n: Numbers) -> Entries | None:
    if "rest" not in n:
        return None
    plain = _quiet(n)
    swing = dither_search.swing(_loop({k: Fraction(v) for k, v in plain.items()}))
    if swing is None or not swing * n["a"] > n["rest"]:
        return None
    entries = _find_return(plain, "rest")
    if entries is None:
        return None
    proof = without_checksum(plain, entries, PROOF, "run")
    tick = _read_return(plain, proof).beyond(
        _loop({k: float(v) for k, v in plain.items()}), float(plain["start"] / n["a"]),
        float(n["rest"] / n["a"]),
    )  # fmt: skip
    return None if tick is None else with_checksum(n, {"ticks": tick, **proof})


def _replay_swings_on(n: Numbers, run: Entries) -> str:
    plain = _quiet(n)
    proof = without_checksum(n, run, ("ticks", *PROOF), "run")
    tick = whole(proof["ticks"], "run.ticks", 1, 10**12)
    start = float(plain["start"] / n["a"]) * UP
    least = _read_return(plain, proof).at_least(_loop(plain), start, tick)
    if "rest" not in n or not Fraction(least) * n["a"] > n["rest"]:
        raise DoesNotHold("run: th does not swing that far")
    return (f"th follows a periodic orbit, and at tick {tick} |th - v*| is above"
            f" {least * float(n['a']):.6g} m/s")  # fmt: skip


def _find_pushed(n: Numbers) -> Entries | None:
    """Noise that drives th away from its orbit, beyond where it was to rest."""
    if not n.get("noise") or "rest" not in n:
        return None
    kept = _quiet(n) | {"noise": n["noise"]}
    entries = _find_return(kept, "rest")
    if entries is None:
        return None
    proof = without_checksum(kept, entries, PROOF, "run")
    plain = _plain(n)
    push = dither_push.find(plain, _read_return(kept, proof))
    if push is None:
        return None
    up = _signs(n)  # of y, whose unit is c a^2 in the loop without dimensions
    signs = "".join(up[x] for x in push.signs)
    return with_checksum(n, {"angle": repr(push.angle), "noise": signs, **proof})


def _signs(n: Numbers) -> str:
    """Sign of a noise of y that is negative, and that is positive, without dimensions."""
    return "-+" if n["curvature"] > 0 else "+-"


def _plain(n: Numbers) -> dither.Loop:
    exact = _loop({k: Fraction(v) for k, v in n.items()})
    q, l, h, W, noise = (float(v) for v in exact[:5])
    return dither.Loop(q, l, h, W, noise, int(exact.late), float(exact.lag))


def _replay_pushed(n: Numbers, run: Entries) -> str:
    proof = without_checksum(n, run, ("angle", "noise", *PROOF), "run")
    signs = proof["noise"]
    if not isinstance(signs, str) or len(signs) > dither_push.MOST_TICKS or set(signs) - set("+-"):
        raise BadInput(f"run.noise must hold + and -, at most {dither_push.MOST_TICKS}")
    push = dither_push.Push(
        _decimal(proof["angle"], "run.angle"), tuple(s == _signs(n)[1] for s in signs)
    )
    quiet = {k: v for k, v in n.items() if k != "noise"}
    noisy = _read_return(n, proof)
    least = dither_push.at_least(_plain(n), noisy, _read_return(quiet, proof), push)
    if "rest" not in n or not Fraction(least) * n["a"] > n["rest"]:
        raise DoesNotHold("run: the noise does not drive th that far")
    return (f"from its orbit a noise of {len(signs)} ticks drives |th - v*| to"
            f" {least * float(n['a']):.6g} m/s, again and again")  # fmt: skip


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
    first, T, kept = float(_from(n)), float(n["T"]), [(0.0, float(_from(n)))]
    plain = {k: float(v) for k, v in n.items()}
    most = MOST_DITHER_TICKS if _late(n) <= dither_flight.OLDEST else 0
    late = min(_late(n), dither_flight.OLDEST)
    for i, th in dither_flight.ticks(plain, first, late, False, most):
        kept.append((i * T, th))
        if not abs(th) <= 1e3 * max(float(n["a"]), first):
            break
    every = max(1, len(kept) // 200)
    return Witness(
        "none; from the farthest start on a parabola of that curvature",
        {"distance_over_the_start": (abs(kept[-1][1]) / first, "1"), "run": (kept[-1][0], "s")},
        {"t": ("s", [r[0] for r in kept[::every]]), "th": ("m/s", [r[1] for r in kept[::every]])},
    )


def _start(n: Numbers) -> str:
    heard = ", the dither alone before" if n.get("lag") or n.get("dead_time") else ""
    return f"every |th - v*| <= {number_text(_from(n), 'm/s')} with xi = 0, eta = y, wt = 0{heard}"


PERTURBATION_SEEK = register(System(
    "perturbation_seek",
    "v = th + a sin wt, th' = k xi, xi' = w_l ((y - eta) sin wt - xi), eta' = w_h (y - eta),"
    " sampled, on the parabola y of a peak at v*. Does th stay near v* and come back to it?",
    {
        "k": Number("m/s^2", "gain, in v/mu per s", low="any", power=1.0),
        "w": Number("1/s", "dither"),
        "w_l": Number("1/s", "corner of the low-pass"),
        "w_h": Number("1/s", "corner of the washout"),
        "a": Number("m/s", "amplitude of the dither", power=1.0),
        "curvature": Number("s^2/m^2", "mu'' at the extremum", None, "any", -2.0),
        "third": Number("s^3/m^3", "mu''' there", None, "any", -3.0, True, role=ASIDE),
        "T": Number("s", "sample period", 1e-3, role=INPUT, says="a sample time of {}"),
        **HEARD,
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
                           proves=(name,), covers=("T", *HEARD))
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
    start=_start,
    refuters={
        "reach": Refuter("reach", _find_flight, _replay_flight, _find_soon),
        "rest": Refuter("rest", _find_swings_on, _replay_swings_on, _find_swings_on),
        "pushed": Refuter("rest", _find_pushed, _replay_pushed),
    },
    never=("a map that is no parabola",),
    values=_perturbation_values,
    witness=_perturbation_witness,
    panel=({"k": 200.0, "w": 12.566, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544},
           {"k": -2.0, "w": 1.0, "w_l": 0.7, "w_h": 0.9, "a": 0.1, "curvature": -0.18544,
            "T": 1.0}),
    guard=_perturbation_guard,
    time=lambda n: SAMPLED,
))  # fmt: skip
