"""Barrier Lyapunov control, printed shape: an error inside (-k_a, k_s), all inputs together.

With z = e/k_s and kappa = 2 k k_s^2 T the law is a map of ``scalar_maps``,

    z+ = z - kappa z_m (x^2 - z_m^2) + T w/k_s,   z_m = z + n/k_s,   x = k_a/k_s below zero, else 1
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, TypeVar

from slipctl.certify import smtlib
from slipctl.certify.arithmetic import decimal_intervals
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold, read_mapping
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    NECESSARY,
    SAMPLED,
    Criterion,
    Entries,
    Evidence,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
)
from slipctl.errors import BadInput
from slipctl.models.bounded_error.certificate import (
    interval_systems,
    lagged_maps,
    scalar_maps,
)
from slipctl.models.bounded_error.certificate.bounded_error import BoundedError
from slipctl.models.bounded_error.certificate.scalar_maps import CubicPull, Interval, Tick
from slipctl.models.cheng_2022.certificate import barrier

Law = TypeVar("Law")
HALF = Fraction(1, 2)


def _begin(n: Numbers) -> Any:
    """Share of the bounds at the start; the inner half where nothing is told."""
    return n.get("start", HALF)


def guard(n: Numbers) -> None:
    """Refuse a start outside the barrier.

    Raises:
        BadInput: it is.
    """
    if _begin(n) >= 1:
        raise BadInput(f"start = {float(n['start']):g} must be below 1, the barrier")


# ---- inequalities -------------------------------------------------------------------------------


def _pulls(n: Numbers) -> Sequence[Side]:
    width = min(n["k_a"], n["k_s"])
    return [Side("27 W^2 <= 16 k^2 min(k_a, k_s)^6", 27 * n["W"] ** 2,
                 16 * n["k"] ** 2 * width**6)]  # fmt: skip


def _no_jump(n: Numbers) -> Sequence[Side]:
    """From either side the furthest overshoot stays inside the other barrier."""
    sides = []
    for here, there in (("k_a", "k_s"), ("k_s", "k_a")):
        kappa = 2 * n["k"] * n[here] ** 2 * n["T"]
        if kappa > 1:
            sides.append(Side(
                f"4 (kappa - 1)^3 {here}^2 <= 27 kappa {there}^2, kappa = 2 k {here}^2 T",
                4 * (kappa - 1) ** 3 * n[here] ** 2, 27 * kappa * n[there] ** 2))  # fmt: skip
    return sides or [Side("2 k max(k_a, k_s)^2 T <= 1",
                          2 * n["k"] * max(n["k_a"], n["k_s"]) ** 2 * n["T"], 1)]  # fmt: skip


def _dies_out(n: Numbers) -> Sequence[Side]:
    return [Side("2 k max(k_a, k_s)^2 T < 2",
                 2 * n["k"] * max(n["k_a"], n["k_s"]) ** 2 * n["T"], 2)]  # fmt: skip


def _together(n: Numbers) -> Sequence[Side]:
    """What start and disturbance reach, against where the law still pulls; with floats."""
    least = interval_systems.nearest_distances(_tick(n, float), float(_begin(n)), 0.0)
    return [Side("errors that are reached <= errors that the law holds", *least)]


# ---- the law ------------------------------------------------------------------------------------


def _pair(n: Numbers, number: Callable[[Any], Any]) -> tuple[CubicPull, CubicPull]:
    kappa = number(2 * n["k"] * n["k_s"] ** 2 * n["T"])
    return CubicPull(kappa, number(n["k_a"] / n["k_s"])), CubicPull(kappa, number(Fraction(1)))


def _tick(n: Numbers, number: Callable[[Any], Any]) -> Tick:
    return Tick(*_pair(n, number), number(n["T"] * n["W"] / n["k_s"]),
                number(n.get("noise", 0) / n["k_s"]))  # fmt: skip


def _lagged(n: Numbers, number: Callable[[Any], Any]) -> lagged_maps.Lagged:
    lag, T = number(n.get("lag", 0)), number(n["T"])
    E, c1, c2, scale, dead = lagged_maps.lag_numbers(lag, T, interval_systems.ticks_of(n))
    tick = _tick(n, number)
    zero = T - T
    return lagged_maps.Lagged(tick.below, tick.above, tick.push, tick.noise, dead, E, c1, c2,
                              scale, zero + 1, zero, zero)  # fmt: skip


def _always(law: Law) -> Callable[[int], Law]:
    return lambda i: law


def _start(n: Numbers, number: Callable[[Any], Any]) -> Interval:
    return Interval(number(-_begin(n) * n["k_a"] / n["k_s"]), number(_begin(n)))


# ---- proofs -------------------------------------------------------------------------------------


def _find(n: Numbers) -> Entries | None:
    tick = _tick(n, float)
    inner = scalar_maps.smallest(tick, _start(n, float))
    if inner is None:
        return None
    most = scalar_maps.limits(tick)
    for part in (0.3, 1e-2, 1e-4, 1e-6, 1e-9):
        entry = {"kept": interval_systems.interval_texts(scalar_maps.wider(inner, most, part))}
        if _proved(n, interval_systems.interval(entry["kept"], "kept")):
            return entry
    return None


def _proved(n: Numbers, z: Interval) -> bool:
    with interval_systems.stop_at_overflow(), precise(scalar_maps.DIGITS):
        start = _start(n, scalar_maps.exactly)
        tick = _tick(n, scalar_maps.exactly)
        return (z.low <= start.low - scalar_maps.SLOP and start.high + scalar_maps.SLOP <= z.high
                and max(tick.below.width, tick.below.slope(0)) <= scalar_maps.LARGEST
                and scalar_maps.proves_kept(tick, z))  # fmt: skip
    return False


def _check(n: Numbers, given: Entries) -> None:
    entry = read_mapping(given, ("kept",), "evidence", True)
    if not _proved(n, interval_systems.interval(entry["kept"], "evidence.kept")):
        raise DoesNotHold("proofs.together: 'kept' does not hold the start set, or is left")


def _kept_step(n: Numbers, entry: Entries) -> str:
    """The interval is left in no tick, and what is measured in it stays inside the barrier."""
    low, high = (Fraction(x) for x in entry["evidence"]["kept"])
    push, noise = n["T"] * n["W"] / n["k_s"], n.get("noise", Fraction(0)) / n["k_s"]
    far, after = n["k_a"] / n["k_s"], smtlib.sum_term("z", _pulled(n))
    facts = [*smtlib.interval_terms(low, "z", high),
             *smtlib.interval_terms(
                 -noise, smtlib.sum_term("y", smtlib.times(-1, "z")), noise)]  # fmt: skip
    claim = smtlib.term("and", *smtlib.interval_terms(low + push, after, high - push),
                        smtlib.term("<", -far, "y"), smtlib.term("<", "y", 1))  # fmt: skip
    return smtlib.problem(("z", "y"), facts, claim)


def _pulled(n: Numbers) -> str:
    """Command times T at the measured error y, over k_s."""
    kappa = 2 * n["k"] * n["k_s"] ** 2 * n["T"]

    def side(width: Fraction) -> str:
        squares = smtlib.sum_term(width**2, smtlib.times(-1, "y", "y"))
        return smtlib.times(-kappa, "y", squares)

    below = side(n["k_a"] / n["k_s"])
    return smtlib.term("ite", smtlib.term("<", "y", 0), below, side(Fraction(1)))


def _polygon_step(n: Numbers, entry: Entries) -> list[str]:
    """Each side of the polygon is passed in no tick, for both ends of E = exp(-T/lag).

    Between them too: the state that follows is affine in E.
    """
    kept = entry["evidence"]["kept"]
    sides = list(zip(lagged_maps.NORMALS, map(Fraction, kept["levels"]), strict=True))
    lag, T, ticks = n.get("lag", Fraction(0)), n["T"], interval_systems.ticks_of(n)
    push, noise = T * n["W"] / n["k_s"], n.get("noise", Fraction(0)) / n["k_s"]
    dead, scale, ends = ticks - 1, Fraction(1), [Fraction(0)]
    if lag:
        dead, scale, digits = ticks, T / max(lag, T), 10**15
        low, high = decimal_intervals.Interval.of(-T / lag, 60).exp().ends()
        ends = [Fraction(math.floor(low * digits), digits),
                Fraction(math.ceil(high * digits), digits)]  # fmt: skip
    moved = Fraction(kept["moved"])
    late = noise + dead * moved
    facts = [smtlib.term("<=", smtlib.sum_term(smtlib.times(a, "z"),
                                               smtlib.times(b / scale, "alpha")), level)
             for (a, b), level in sides]  # fmt: skip
    facts += smtlib.interval_terms(-late, smtlib.sum_term("y", smtlib.times(-1, "z")), late)
    claims = [smtlib.term("<", -n["k_a"] / n["k_s"], "y"), smtlib.term("<", "y", 1)]
    pulled = _pulled(n)
    for E in ends:
        c1 = lag / T * (1 - E) if lag else Fraction(1)
        move = smtlib.sum_term(smtlib.times(c1, "alpha"), smtlib.times(1 - c1, pulled))
        after = smtlib.sum_term(smtlib.times(E, "alpha"), smtlib.times(1 - E, pulled))
        claims += smtlib.interval_terms(push - moved, move, moved - push) if dead else []
        claims += [
            smtlib.term("<=", smtlib.sum_term(smtlib.times(a, smtlib.sum_term("z", move)),
                                          smtlib.times(b / scale, after), abs(a) * push), level)
            for (a, b), level in sides
        ]  # fmt: skip
    return [smtlib.problem(("z", "alpha", "y"), facts, claim) for claim in claims]


ERROR = BoundedError(
    "barrier", "the error passes its barrier", "m/s^2", " towards the nearer barrier",
    lambda n: n["W"], lambda n, number: {"start": _always(_tick(n, number))},
    lambda n, number: {"start": _always(_lagged(n, number))},
    lambda n, number: (_lagged(n, number),) * 2, _start,
)  # fmt: skip


# ---- the system ---------------------------------------------------------------------------------


def _values(n: Numbers) -> dict[str, Quantity]:
    k, a, b = n["k"], n["k_a"], n["k_s"]
    return {
        "largest_disturbance_above": (barrier.largest_disturbance(k, b), "m/s^2"),
        "largest_disturbance_below": (barrier.largest_disturbance(k, a), "m/s^2"),
        "time_constant_above": (1 / barrier.rate(k, b), "s"),
        "time_constant_below": (1 / barrier.rate(k, a), "s"),
        "largest_period": (barrier.largest_period(k, a, b), "s"),
        "stable_period": (barrier.stable_period(k, a, b), "s"),
        "error_in_the_end": (barrier.settled_error(n["W"], k, min(a, b)), "m/s"),
    }


BARRIER = register(System(
    "barrier_lyapunov",
    "Cheng 2022 (42), (44), signs put right: e' = -2 k e (k_x^2 - e^2) + w, k_x = k_a for e < 0"
    " else k_s, |w| <= W, input held over T. Does e stay in (-k_a, k_s)?",
    {
        "k": Number("s/m^2", "gain", power=-2.0),
        "k_a": Number("m/s", "barrier below", power=1.0),
        "k_s": Number("m/s", "barrier above", power=1.0),
        "W": Number("m/s^2", "largest |w|", 0.0, "not negative", 1.0, role=INPUT,
                    says="every |w| <= {}", absent="a disturbance w"),
        "T": Number("s", "sample period", role=INPUT, says="an input held over T = {}"),
        "start": Number("1", "share of the barriers at the start", float(HALF), "not negative"),
        "noise": Number("m/s", "largest noise of the measured error", None, "not negative", 1.0,
                        True, INPUT, "every noise up to {}", "measurement noise"),
        "lag": Number("s", "time constant of the actuator, at rest at the start", None,
                      "not negative", 0.0, True, INPUT, "an actuator's lag of {}",
                      "a lag of the actuator"),
        "dead": Number("s", "dead time, in whole ticks", None, "not negative", 0.0, True, INPUT,
                       "a dead time of {}, rounded up to whole ticks, at rest too", "a dead time"),
    },
    {
        "disturbance": Criterion("the disturbance against the largest pull", _pulls, NECESSARY,
                                 ("largest_W", "smallest_k", "smallest_k_s"), proves=("stays",),
                                 refuted_under=("T", "W", "noise", "lag", "dead"),
                                 refutes="the constant w = W, towards the nearer barrier"),
        "window": Criterion("sampled, w = 0: no error inside jumps out", _no_jump, EXACT,
                            ("largest_T", "largest_k", "largest_k_a")),
        "dies_out": Criterion("sampled, w = 0: small errors die out", _dies_out, EXACT,
                              ("largest_T", "largest_k", "largest_k_a")),
        "together": Criterion("sampled: an interval of errors is never left", _together, EXACT,
                              ("largest_W", "largest_T", "smallest_k"),
                              evidence=Evidence(_find, _check), proves=("stays",),
                              covers=("T", "W", "noise"), step=_kept_step),
        "polygon": Criterion("sampled, behind the actuator: a polygon of errors and actuator is"
                             " never left", kind=EXACT, proves=("stays",),
                             evidence=ERROR.polygon(),
                             covers=("T", "W", "noise", "lag", "dead"), step=_polygon_step),
    },
    {"stays": Target("e, as it is measured, stays in (-{k_a}, {k_s}) at every tick")},
    start="every error in {start} times (-{k_a}, {k_s})",
    refuters=ERROR.refuters(),
    never=("a step of the reference", "a limit of the command"),
    guard=guard,
    values=_values,
    witness=ERROR.witness,
    panel=({"k": 1200.0, "k_a": 1.22986, "k_s": 0.02, "W": 5e-3, "T": 2e-4},
     {"k": 1200.0, "k_a": 1.22986, "k_s": 0.02, "W": 1e-2, "T": 1e-3}),
    time=lambda n: SAMPLED,
))  # fmt: skip
