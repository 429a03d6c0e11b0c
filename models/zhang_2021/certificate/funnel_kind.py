"""Prescribed performance: an error inside a funnel, with all that disturbs it added together."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import cache
from typing import Any

from slipctl.certify.arithmetic import decimal_intervals
from slipctl.certify.entries import DoesNotHold
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
)
from slipctl.models.bounded_error.certificate.bounded_error import BoundedError
from slipctl.models.bounded_error.certificate.scalar_maps import AtanhPull, Interval, Tick
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.certificate import sampled_funnel as funnel

DIGITS = 60


@cache
def peak_enclosure() -> decimal_intervals.Interval:
    """Enclose the largest h(z) = (1 - z^2) atanh z.

    Proof note: h is concave on (0, 1), because h' = 1 - 2 z atanh z falls. So h(z0) <= max h <=
    h(z0) + |h'(z0)| at a rational z0 near the peak; both are enclosed outwards.
    """
    z = Fraction("0.64791822902960261270588617138849")
    atanh = decimal_intervals.arctan_over(decimal_intervals.Interval.of(-z * z, DIGITS)) * z
    h, slope = atanh * (1 - z * z), 1 - atanh * (2 * z)
    return decimal_intervals.Interval(h.low, h.up.add(h.high, slope.magnitude()), DIGITS)


# ---- the inputs, added --------------------------------------------------------------------------


def disturbance(n: Numbers) -> Any:
    """Largest |w| in 1/s, all inputs together: W + r^2 F_error/(I_w v) + (1 - slip) a/v."""
    w = n["W"]
    if n.get("F_error"):
        w = w + n["r"] ** 2 * n["F_error"] / (n["I_w"] * n["v"])
    if n.get("a"):
        w = w + (1 - n.get("slip", 0)) * n["a"] / n["v"]
    return w


HALF = Fraction(1, 2)


def _begin(n: Numbers) -> Any:
    """Share of the bounds at the start; the inner half where nothing is told."""
    return n.get("start", HALF)


def guard(n: Numbers) -> None:
    """Refuse an input without the numbers that turn it into a rate, and a start outside.

    Raises:
        BadInput: what is missing.
    """
    for name, needs in (("F_error", ("v", "r", "I_w")), ("a", ("v",)), ("eta_0", ("k",)),
                        ("k", ("eta_0",))):  # fmt: skip
        missing = [x for x in needs if x not in n]
        if name in n and missing:
            lacking = " ".join(f"{x}=VALUE" for x in missing)
            raise BadInput(f"{name} needs {', '.join(missing)}; add --set {lacking}")
    if "eta_0" in n and n["eta_0"] < n["eta_inf"]:
        raise BadInput(f"eta_0 = {float(n['eta_0']):g} is below eta_inf; a funnel shrinks")
    if _begin(n) >= 1:
        raise BadInput(f"start = {float(n['start']):g} must be below 1, the bound")
    if n.get("slip", 0) > 1:
        raise BadInput(f"slip = {float(n['slip']):g} must be at most 1, a locked wheel")


def _law(n: Numbers) -> dict[str, Any]:
    """Numbers of ``sampled_funnel.Funnel``."""
    return {
        "K1": n["K1"], "T": n["T"], "eta_0": n.get("eta_0", n["eta_inf"]),
        "eta_inf": n["eta_inf"], "k": n.get("k", 0), "lower": n["delta_l"],
        "upper": n["delta_u"], "W": disturbance(n), "noise": n.get("noise", 0),
    }  # fmt: skip


def _floats(n: Numbers) -> funnel.Funnel:
    return funnel.Funnel(**{k: float(v) for k, v in _law(n).items()})


def _width(n: Numbers) -> Any:
    return (n["delta_l"] + n["delta_u"]) / 2


def _share(n: Numbers, error: Any) -> Any:
    """Error over the half-width at eta_inf."""
    return error / (n["eta_inf"] * _width(n))


def _moves(n: Numbers) -> bool:
    return bool(n.get("k")) and n.get("eta_0", n["eta_inf"]) != n["eta_inf"]


# ---- inequalities -------------------------------------------------------------------------------


def _held(n: Numbers) -> Sequence[Side]:
    exact = isinstance(n["K1"], Fraction)
    room = (peak_enclosure() if exact else ppc.H_MAX) * (n["K1"] * n["eta_inf"] * _width(n))
    return [Side("W + r^2 F_error/(I_w v) + (1 - slip) a/v <= max h K1 eta_inf d",
                 disturbance(n), room)]  # fmt: skip


def _window(n: Numbers) -> Sequence[Side]:
    kappa = n["K1"] * n["T"]
    if isinstance(kappa, Fraction):
        x = decimal_intervals.Interval.of(kappa, DIGITS).ln() - 1 / kappa
        return [Side("ln(K1 T) - 1/(K1 T) < 1", x, 1)]
    return [Side("ln(K1 T) - 1/(K1 T) < 1", math.log(kappa) - 1 / kappa, 1)]


def _stable(n: Numbers) -> Sequence[Side]:
    return [Side("K1 T <= 2", n["K1"] * n["T"], 2)]


def _together(n: Numbers) -> Sequence[Side]:
    """What start, step and disturbance reach, against where the law still pulls; with floats."""
    tick = _floats(n).standing()
    least = interval_systems.nearest_distances(
        tick, float(_begin(n)), float(_share(n, n.get("step", 0)))
    )
    return [Side("errors that are reached <= errors that the law holds", *least)]


# ---- proofs -------------------------------------------------------------------------------------


def _find(n: Numbers) -> Entries | None:
    found = funnel.find(_floats(n), float(_begin(n)), float(n.get("step", 0)))
    if found is None:
        return None
    sets = {
        "settled": interval_systems.interval_texts(found.settled),
        "kept": interval_systems.interval_texts(found.kept),
    }
    kept = funnel.Kept(interval_systems.interval(sets["settled"], "settled"),
                       interval_systems.interval(sets["kept"], "kept"), found.ticks)  # fmt: skip
    return sets | {"ticks": found.ticks} if _proved(n, kept) is None else None


def _proved(n: Numbers, kept: funnel.Kept) -> str | None:
    with interval_systems.stop_at_overflow():
        return funnel.why_unproved(_law(n), _begin(n), n.get("step", Fraction(0)), kept)
    return "numbers too large for a proof"


def _check(n: Numbers, given: Entries) -> None:
    settled, kept, ticks = interval_systems.sets(given, funnel.TICKS)
    why = _proved(n, funnel.Kept(settled, kept, ticks))
    if why is not None:
        raise DoesNotHold(f"proofs.together: {why}")


def _lagged(n: Numbers, number: Callable[[Any], Any], standing: bool = False) -> Any:
    """The law behind its actuator, in floats or decimals."""
    law, kappa = _law(n), n["K1"] * n["T"]
    lag, T = number(n.get("lag", 0)), number(n["T"])
    E, c1, c2, scale, dead = lagged_maps.lag_numbers(lag, T, interval_systems.ticks_of(n))
    r, g = number(Fraction(1)), number(Fraction(0))
    if _moves(n) and not standing:
        x = -number(law["k"]) * T
        fall = 1 - (x.exp() if isinstance(x, Decimal) else math.exp(x))
        s = 1 - number(law["eta_inf"]) / number(law["eta_0"])
        r, g = 1 / (1 - s * fall), number(law["k"]) * T / fall
    pull = AtanhPull(number(kappa))
    c = (n["delta_u"] - n["delta_l"]) / (2 * _width(n))
    return lagged_maps.Lagged(
        pull, pull, number(n["T"] * _share(n, law["W"])), number(_share(n, law["noise"])), dead,
        E, c1, c2, scale, r, g, number(c),
    )  # fmt: skip


def _lagged_in_time(n: Numbers, number: Callable[[Any], Any]) -> Callable[[int], Any]:
    """The law behind its actuator at each tick, with the funnel of that tick."""
    standing = _lagged(n, number, True)
    if not _moves(n):
        return lambda i: standing
    moving = _lagged(n, number)
    own = funnel.Funnel(**{k: number(v) for k, v in _law(n).items()})
    fall = 1 - own.shrink

    @cache
    def law(i: int) -> Any:
        eta, after = own.eta(i), own.eta(i + 1)
        r = 1 / (1 - own.share(i) * fall)
        return replace(moving, r=r, push=own.T * own.W / (after * own.d),
                       noise=own.noise / (eta * own.d))  # fmt: skip

    return law


def _ticks(n: Numbers, number: Callable[[Any], Any]) -> dict[str, Callable[[int], Tick]]:
    """The law alone: with the funnel of each tick, and standing still."""
    law = _floats(n) if number is float else funnel.decimals(_law(n))
    standing = law.standing()
    return {"start": law.ticks(), "middle": lambda i: standing}


def _lagged_ticks(n: Numbers, number: Callable[[Any], Any]) -> dict[str, Callable[[int], Any]]:
    standing = _lagged(n, number, True)
    return {"start": _lagged_in_time(n, number), "middle": lambda i: standing}


ERROR = BoundedError(
    "funnel", "the error leaves its funnel", "1/s", ", outward", disturbance, _ticks, _lagged_ticks,
    lambda n, number: (_lagged(n, number), _lagged(n, number, True)),
    lambda n, number: Interval(number(-_begin(n)), number(_begin(n))),
    lambda n, number: number(_share(n, Fraction(n.get("step", 0)))), _moves,
)  # fmt: skip


# ---- the system ---------------------------------------------------------------------------------


def _values(n: Numbers) -> dict[str, Quantity]:
    W = ppc.largest_disturbance(n["K1"], n["eta_inf"], n["delta_l"], n["delta_u"])
    w = disturbance(n)
    q = ppc.load(w, n["K1"], n["eta_inf"], n["delta_l"], n["delta_u"])
    found = {"largest_disturbance": (W, "1/s"), "disturbance_of_all_inputs": (w, "1/s"),
             "K1_T": (n["K1"] * n["T"], "1"),
             "share_of_the_bound_in_the_end": (ppc.settled_share(q), "1"),
             "largest_start_share": (ppc.recoverable(q), "1"),
             "same_under_the_barrier_law": (ppc.barrier_settled(q), "1")}  # fmt: skip
    if all(k in n for k in ("v", "r", "I_w")):
        found["adhesion_error_budget"] = (ppc.adhesion_budget(n["v"], W, n["r"], n["I_w"]), "N")
    if all(k in n for k in ("a", "slip")):
        found["lowest_speed_without_the_vehicle_term"] = (
            ppc.lowest_speed(n["a"], n["slip"], W), "m/s")  # fmt: skip
    return found


_INPUTS = ("T", "W", "step", "F_error", "a", "noise")

PRESCRIBED_PERFORMANCE = register(System(
    "prescribed_performance",
    "Zhang 2021 (34): an error inside -delta_l eta < e < delta_u eta, e' = -K1 eps/l + e eta'/eta"
    " + w, |w| <= W and all other inputs, added, input held over T. Does it stay inside?",
    {
        "K1": Number("1/s", "gain"),
        "T": Number("s", "sample period", role=INPUT, says="an input held over T = {}"),
        "eta_inf": Number("1", "least eta", power=1.0),
        "delta_l": Number("1", "width below, over eta"),
        "delta_u": Number("1", "width above, over eta"),
        "W": Number("1/s", "largest disturbance of the slip ratio's rate", 0.0, "not negative",
                    1.0, role=INPUT, says="every |w| <= {}", absent="a disturbance w"),
        "step": Number("1", "step of the reference from an error that has settled", None,
                       "not negative", 1.0, True, INPUT,
                       "a step of the reference by up to {} from every error that is reached from"
                       " the middle at eta_inf", "a step of the reference"),
        "v": Number("m/s", "speed", optional=True),
        "r": Number("m", "wheel radius", optional=True),
        "I_w": Number("kg m^2", "wheel inertia", optional=True, power=-1.0),
        "F_error": Number("N", "error of the adhesion estimate", None, "not negative", 0.0, True,
                          INPUT, "every error of the adhesion estimate up to {}",
                          "an error of the adhesion estimate"),
        "a": Number("m/s^2", "deceleration whose term is neglected", None, "not negative", 1.0,
                    True, INPUT, "every neglected acceleration up to {} either way",
                    "the vehicle's own motion, if the law neglects it"),
        "slip": Number("1", "least slip ratio", None, "not negative", 0.0, True),
        "eta_0": Number("1", "eta at the start", None, power=1.0, optional=True, role=INPUT,
                        says="a funnel that shrinks from eta = {}", absent="a shrinking funnel"),
        "k": Number("1/s", "decay of eta", None, "not negative", optional=True),
        "start": Number("1", "share of the half-width at the start", float(HALF), "not negative"),
        "noise": Number("1", "largest noise of the measured error", None, "not negative", 1.0,
                        True, INPUT, "every noise up to {}", "measurement noise"),
        "lag": Number("s", "time constant of the actuator, at rest at the start", None,
                      "not negative", 0.0, True, INPUT, "an actuator's lag of {}",
                      "a lag of the actuator"),
        "dead": Number("s", "dead time, in whole ticks", None, "not negative", 0.0, True, INPUT,
                       "a dead time of {}, rounded up to whole ticks, at rest too", "a dead time"),
    },
    {
        "continuous": Criterion("all inputs added, against the largest pull", _held, NECESSARY,
                                ("largest_W", "smallest_K1", "smallest_eta_inf", "largest_F_error",
                                 "largest_a", "smallest_v"), proves=("stays",),
                                refuted_under=(*_INPUTS, "eta_0", "lag", "dead"),
                                refutes="constant inputs, all of them outward"),
        "window": Criterion("sampled, w = 0: nothing inside leaves; K1 T < 1/W(1/e)", _window,
                            EXACT, ("largest_K1", "largest_T")),
        "dies_out": Criterion("sampled, w = 0: errors die out", _stable,
                              margins=("largest_K1", "largest_T")),
        "together": Criterion("sampled: an interval of errors is never left", _together, EXACT,
                              ("largest_W", "largest_K1", "smallest_K1", "largest_T",
                               "largest_step"),
                              evidence=Evidence(_find, _check), proves=("stays",),
                              covers=(*_INPUTS, "eta_0")),
        "polygon": Criterion("sampled, behind the actuator: a polygon of errors and actuator is"
                             " never left", kind=EXACT, needs=(), proves=("stays",),
                             evidence=ERROR.polygon(),
                             covers=(*_INPUTS, "eta_0", "lag", "dead")),
    },
    {"stays": Target("the error, as it is measured, stays inside its funnel at every tick")},
    start="every error up to {start} of the half-width from the middle of the funnel",
    refuters=ERROR.refuters(),
    never=("the time between two ticks of a funnel that shrinks", "a limit of the command"),
    guard=guard,
    values=_values,
    witness=ERROR.witness,
    panel=({"K1": 100.0, "T": 1e-3, "eta_inf": 5e-3, "delta_l": 1.2, "delta_u": 1.2, "W": 0.2},
     {"K1": 100.0, "T": 3e-2, "eta_inf": 5e-3, "delta_l": 1.2, "delta_u": 1.0, "W": 0.02,
      "step": 5e-4}),
    time=lambda n: SAMPLED,
))  # fmt: skip
