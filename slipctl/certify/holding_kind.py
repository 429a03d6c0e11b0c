"""Systems that hold an error inside bounds: prescribed performance and barrier Lyapunov."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import Any

from slipctl.certify import barrier, outward
from slipctl.certify import prescribed_performance as ppc
from slipctl.certify.bisection import bisect
from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    NECESSARY,
    SAMPLED,
    SUFFICIENT,
    Criterion,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)

DIGITS = 60


@cache
def peak_enclosure() -> outward.Interval:
    """Enclose the largest h(z) = (1 - z^2) atanh z.

    Proof note: h is concave on (0, 1), because h' = 1 - 2 z atanh z falls. So h(z0) <= max h <=
    h(z0) + |h'(z0)| at a rational z0 near the peak; both are enclosed outwards.
    """
    z = Fraction("0.64791822902960261270588617138849")
    atanh = outward.arctan_over(outward.Interval.of(-z * z, DIGITS)) * z
    h, slope = atanh * (1 - z * z), 1 - atanh * (2 * z)
    return outward.Interval(h.low, h.up.add(h.high, slope.magnitude()), DIGITS)


def _peak(n: Numbers) -> Any:
    return peak_enclosure() if isinstance(n["K1"], Fraction) else ppc.H_MAX


def _width(n: Numbers) -> Any:
    return (n["delta_l"] + n["delta_u"]) / 2


# ---- prescribed performance ---------------------------------------------------------------------


def _held(n: Numbers) -> Sequence[Side]:
    return [
        Side("W <= max h K1 eta_inf d", n["W"], _peak(n) * (n["K1"] * n["eta_inf"] * _width(n)))
    ]


def _window(n: Numbers) -> Sequence[Side]:
    kappa = n["K1"] * n["T"]
    if isinstance(kappa, Fraction):
        x = outward.Interval.of(kappa, DIGITS).ln() - 1 / kappa
        return [Side("ln(K1 T) - 1/(K1 T) < 1", x, 1)]
    return [Side("ln(K1 T) - 1/(K1 T) < 1", math.log(kappa) - 1 / kappa, 1)]


def _sampled(n: Numbers) -> Sequence[Side]:
    kappa = n["K1"] * n["T"]
    if kappa <= 1:
        return _held(n)
    largest = ppc.sampled_disturbance(float(kappa))
    return [*_window(n), Side("T W/(eta_inf d) <= largest of the sampled map at K1 T",
                 float(n["T"] * n["W"] / (n["eta_inf"] * _width(n))), largest)]  # fmt: skip


def _stable(n: Numbers) -> Sequence[Side]:
    return [Side("K1 T <= 2", n["K1"] * n["T"], 2)]


def _step(n: Numbers) -> Sequence[Side]:
    lower, upper = n["delta_l"] * n["eta_inf"], n["delta_u"] * n["eta_inf"]
    return [Side("step < min(delta_l, delta_u) eta_inf", n["step"], min(lower, upper))]


def _budget(n: Numbers) -> Sequence[Side]:
    """|F_a - F_a^| <= max h K1 eta d I_w v/r^2."""
    room = _peak(n) * (n["K1"] * n["eta_inf"] * _width(n) * n["I_w"] * n["v"] / n["r"] ** 2)
    return [Side("F_error <= max h K1 eta_inf d I_w v/r^2", n["F_error"], room)]


def _neglected(n: Numbers) -> Sequence[Side]:
    room = _peak(n) * (n["K1"] * n["eta_inf"] * _width(n) * n["v"])
    return [Side("(1 - slip) a <= max h K1 eta_inf d v", (1 - n["slip"]) * n["a"], room)]


def _funnel_values(n: Numbers) -> dict[str, Quantity]:
    W = ppc.largest_disturbance(n["K1"], n["eta_inf"], n["delta_l"], n["delta_u"])
    q = ppc.load(n["W"], n["K1"], n["eta_inf"], n["delta_l"], n["delta_u"])
    found = {"largest_disturbance": (W, "1/s"), "K1_T": (n["K1"] * n["T"], "1"),
             "share_of_the_bound_in_the_end": (ppc.settled(q), "1"),
             "largest_start_share": (ppc.recoverable(q), "1"),
             "same_under_the_barrier_law": (ppc.barrier_settled(q), "1")}  # fmt: skip
    if all(k in n for k in ("v", "r", "I_w")):
        found["adhesion_error_budget"] = (ppc.adhesion_budget(n["v"], W, n["r"], n["I_w"]), "N")
    if all(k in n for k in ("a", "slip")):
        found["lowest_speed_without_the_vehicle_term"] = (
            ppc.lowest_speed(n["a"], n["slip"], W), "m/s")  # fmt: skip
    return found


def _funnel_witness(n: Numbers) -> Witness:
    """Sampled run from the middle of the funnel: constant w, or the worst sign at each tick."""
    kappa, d = n["K1"] * n["T"], n["eta_inf"] * _width(n)
    W = n["W"]
    for k in ("F_error",):
        if k in n and all(x in n for x in ("v", "r", "I_w")):
            W = max(W, n["r"] ** 2 * n[k] / (n["I_w"] * n["v"]))
    if all(k in n for k in ("a", "slip", "v")):
        W = max(W, ppc.neglected_term(n["v"], n["a"], n["slip"]))
    om, step = n["T"] * W / d, n.get("step", 0.0) / d
    zs = [step]
    if step < 1:
        zs = worst_run(kappa, om) if om or kappa <= 2 else _falling(kappa)
    gone = abs(zs[-1]) >= 1
    every = max(1, len(zs) // 200)
    return Witness(
        f"|w| <= {W:.6g} 1/s, the worst of each tick"
        + (f", after a reference step of {n['step']:g}" if step >= 1 else ""),
        {"leaves_the_funnel_after": ((len(zs) - 1) * n["T"] if gone else math.inf, "s"),
         "share_of_the_bound": (abs(zs[-1]), "1")},
        {"t": ("s", [i * n["T"] for i in range(0, len(zs), every)]), "z": ("1", zs[::every])},
    )  # fmt: skip


def _falling(kappa: float) -> list[float]:
    """Run of the undisturbed map from just inside the bound."""
    zs = [1 - 1e-9]
    while abs(zs[-1]) < 1 and len(zs) < 100_000:
        zs.append(zs[-1] - kappa * ppc.restoring(zs[-1]))
    return zs


def worst_run(kappa: float, om: float, most: int = 20_000) -> list[float]:
    """Run of z+ = z - kappa h(z) + om_k, |om_k| <= om, from z = 0 that gets as far out as any.

    It ends outside, |z| >= 1, if the disturbance can get there at all, else where it gets no
    further.

    Proof note: what can be reached after k ticks is an interval [-b, b]; b+ = max |g| over it + om.
    Going back from the end, each place is aimed at from the place of that maximum, or from nearer
    to zero, where |g| takes every value in between.
    """

    def g(z: float) -> float:
        return z - kappa * ppc.restoring(z)

    dips = [bisect(lambda z: z * math.atanh(z), (1 - 1 / kappa) / 2, 0.0, 1 - 1e-16)] * (kappa > 1)
    places: list[float] = []
    b = 0.0
    while b < 1 and len(places) < most:
        places.append(max([b, *(z for z in dips if z < b)], key=lambda z: abs(g(z))))
        further = abs(g(places[-1])) + om
        if further <= b * (1 + 1e-13) and places[1:]:
            break
        b = max(b, further)
    target, back = b, []
    for place in reversed(places):
        back.append(target)
        if abs(g(place)) - om > target:
            place = bisect(lambda z: abs(g(z)), target, 0.0, place)
        target = place
    signed = [0.0]
    for z in reversed(back):  # the map is odd: each value with the sign that g gives it
        before = g(signed[-1])
        signed.append(math.copysign(z, before) if before else z)
    return signed


_LEAVES: dict[str, Any] = {
    "proves": ("stays",), "refuted_under": ("T", "W", "step", "F_error", "a")
}  # fmt: skip

PRESCRIBED_PERFORMANCE = register(System(
    "prescribed_performance",
    "Zhang 2021 (34): an error inside -delta_l eta < e < delta_u eta, e' = -K1 eps/l + e eta'/eta"
    " + w, |w| <= W, input held over T: does it stay inside?",
    {
        "K1": Number("1/s", "gain"),
        "T": Number("s", "sample period", role=INPUT, says="an input held over T = {}"),
        "eta_inf": Number("1", "least eta", power=1.0),
        "delta_l": Number("1", "width below, over eta"),
        "delta_u": Number("1", "width above, over eta"),
        "W": Number("1/s", "largest disturbance of the slip ratio's rate", 0.0, "not negative",
                    1.0, role=INPUT, says="every |w| <= {}", absent="a disturbance w"),
        "step": Number("1", "step of the reference from no error", None, "not negative", 1.0, True,
                       INPUT, "a step of the reference by {}", "a step of the reference"),
        "v": Number("m/s", "speed", optional=True),
        "r": Number("m", "wheel radius", optional=True),
        "I_w": Number("kg m^2", "wheel inertia", optional=True, power=-1.0),
        "F_error": Number("N", "error of the adhesion estimate", None, "not negative", 0.0, True,
                          INPUT, "every error of the adhesion estimate up to {}",
                          "an error of the adhesion estimate"),
        "a": Number("m/s^2", "deceleration whose term is neglected", None, "not negative", 1.0,
                    True, INPUT, "every neglected deceleration up to {}"),
        "slip": Number("1", "least slip ratio", None, "not negative", 0.0, True),
    },
    {
        "continuous": Criterion("T -> 0: invariant for every |w| <= W", _held, NECESSARY,
                                ("largest_W", "smallest_K1", "smallest_eta_inf"), **_LEAVES,
                                refutes="the constant w = W, outward"),
        "window": Criterion("sampled, w = 0: nothing inside leaves; K1 T < 1/W(1/e)", _window,
                            EXACT, ("largest_K1", "largest_T")),
        "sampled": Criterion("sampled: invariant from the middle for every |w| <= W", _sampled,
                             EXACT, ("largest_W", "largest_K1", "smallest_K1", "largest_T"),
                             proves=("stays",), covers=("T", "W")),
        "dies_out": Criterion("sampled, w = 0: errors die out", _stable,
                              margins=("largest_K1", "largest_T")),
        "reference_step": Criterion("a step of the reference stays inside", _step, EXACT,
                                    ("largest_step", "smallest_eta_inf"), ("step",), **_LEAVES,
                                    refutes="none; the step itself"),
        "adhesion_budget": Criterion("the error of the adhesion estimate is held at this speed",
                                     _budget, EXACT, ("largest_F_error", "smallest_v"),
                                     ("F_error", "v", "r", "I_w"), **_LEAVES,
                                     refutes="a constant error of the estimate, outward"),
        "neglected_term": Criterion("the vehicle's motion may be neglected at this speed",
                                    _neglected, EXACT, ("smallest_v", "largest_a"),
                                    ("a", "slip", "v"), **_LEAVES,
                                    refutes="the neglected term, constant"),
    },
    {"stays": Target("the error stays inside its bounds for all ticks")},
    start="no error",
    never=("a funnel that shrinks", "a lag of the actuator", "measurement noise"),
    values=_funnel_values,
    witness=_funnel_witness,
    panel=({"K1": 100.0, "T": 1e-3, "eta_inf": 5e-3, "delta_l": 1.2, "delta_u": 1.2, "W": 0.2},
     {"K1": 100.0, "T": 3e-2, "eta_inf": 5e-3, "delta_l": 1.2, "delta_u": 1.0, "W": 0.02,
      "step": 5e-3}),
    time=lambda n: SAMPLED,
))  # fmt: skip


# ---- barrier Lyapunov ---------------------------------------------------------------------------


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


def _recoverable(n: Numbers) -> dict[str, Any] | None:
    """Errors a, b a little nearer than the recoverable ones; None if there is none."""
    k, W = float(n["k"]), float(n["W"])
    found = {}
    for name, width in (("a", "k_a"), ("b", "k_s")):
        e = barrier.recoverable(W, k, float(n[width])) * (1 - 1e-9)
        if e == 0:
            return None
        found[name] = Fraction(e).limit_denominator(10**12) if isinstance(n["k"], Fraction) else e
    return found


def _together(n: Numbers) -> Sequence[Side]:
    """Sampled and disturbed: the errors in [-a, b] stay there.

    Proof note: the map is e - 2 k T e (k_x^2 - e^2) + T w. On the side of b it is largest at b,
    where the pull is at least W, or at 0 if kappa > 1; from the other side it overshoots by at most
    (2/3) (kappa - 1) sqrt((kappa - 1)/(3 kappa)) k_a, or not at all. So T W and that must fit in b.
    """
    ends = n if "b" in n else _recoverable(n)
    if ends is None:
        return _pulls(n)
    k, push, sides = n["k"], n["T"] * n["W"], []
    for here, width, other in (("b", "k_s", "k_a"), ("a", "k_a", "k_s")):
        e, kappa = ends[here], 2 * k * n[other] ** 2 * n["T"]
        sides += [
            Side(f"{here} < {width}", e, n[width]),
            Side(f"W <= 2 k {here} ({width}^2 - {here}^2)", n["W"],
                 2 * k * e * (n[width] ** 2 - e**2)),
            Side(f"T W <= {here}", push, e),
        ]  # fmt: skip
        if kappa > 1:
            sides.append(Side(
                f"4 (kappa - 1)^3 {other}^2 <= 27 kappa ({here} - T W)^2, kappa = 2 k {other}^2 T",
                4 * (kappa - 1) ** 3 * n[other] ** 2, 27 * kappa * (e - push) ** 2))  # fmt: skip
    return sides


def _barrier_values(n: Numbers) -> dict[str, Quantity]:
    k, a, b = n["k"], n["k_a"], n["k_s"]
    return {
        "largest_disturbance_above": (barrier.largest_disturbance(k, b), "m/s^2"),
        "largest_disturbance_below": (barrier.largest_disturbance(k, a), "m/s^2"),
        "time_constant_above": (1 / barrier.rate(k, b), "s"),
        "time_constant_below": (1 / barrier.rate(k, a), "s"),
        "largest_period": (barrier.largest_period(k, a, b), "s"),
        "stable_period": (barrier.stable_period(k, a, b), "s"),
        "error_in_the_end": (barrier.settled(n["W"], k, min(a, b)), "m/s"),
    }


def _barrier_witness(n: Numbers) -> Witness:
    """Sampled run: a constant W towards the nearer barrier, or the start that jumps furthest."""
    k, T, a, b, W = (float(n[x]) for x in ("k", "T", "k_a", "k_s", "W"))
    jump = not all(s.holds() for s in _no_jump(n))
    side = 1.0 if b <= a else -1.0
    e, what = 0.0, f"constant w = {side * W:.6g} m/s^2 from e = 0"
    if jump:
        kappa = 2 * k * max(a, b) ** 2 * T
        far = math.sqrt(max(kappa - 1, 0.0) / (3 * kappa)) * max(a, b)
        e, W = (-far if a >= b else far), 0.0
        what = f"no disturbance, from e = {e:.6g} m/s"
    h = T if jump else 0.005 / barrier.rate(k, b if side > 0 else a)
    t, rows = 0.0, [(0.0, e)]
    for _ in range(200_000):
        width = a if e < 0 else b
        e, t = e + h * (side * W - barrier.pull(e, k, width)), t + h
        rows.append((t, e))
        if not -a < e < b:
            break
    every = max(1, len(rows) // 200)
    gone = not -a < e < b
    return Witness(what, {"leaves_the_barrier_after": (t if gone else math.inf, "s"),
                          "error": (e, "m/s")},
                   {"t": ("s", [r[0] for r in rows[::every]]),
                    "e": ("m/s", [r[1] for r in rows[::every]])})  # fmt: skip


BARRIER = register(System(
    "barrier_lyapunov",
    "Cheng 2022 (42), (44), signs put right: e' = -2 k e (k_x^2 - e^2) + w, k_x = k_a for e < 0"
    " else k_s, |w| <= W, input held over T: does e stay in (-k_a, k_s)?",
    {
        "k": Number("s/m^2", "gain", power=-2.0),
        "k_a": Number("m/s", "barrier below", power=1.0),
        "k_s": Number("m/s", "barrier above", power=1.0),
        "W": Number("m/s^2", "largest |w|", 0.0, "not negative", 1.0, role=INPUT,
                    says="every |w| <= {}", absent="a disturbance w"),
        "T": Number("s", "sample period", role=INPUT, says="an input held over T = {}"),
    },
    {
        "disturbance": Criterion("T -> 0: invariant for every |w| <= W", _pulls, NECESSARY,
                                 ("largest_W", "smallest_k", "smallest_k_s")),
        "window": Criterion("sampled, w = 0: no error inside jumps out", _no_jump, NECESSARY,
                            ("largest_T", "largest_k", "largest_k_a")),
        "dies_out": Criterion("sampled, w = 0: small errors die out", _dies_out, NECESSARY,
                              ("largest_T", "largest_k", "largest_k_a")),
        "together": Criterion("sampled and disturbed: an interval of errors is invariant",
                              _together, SUFFICIENT, ("largest_W", "largest_T"),
                              find=_recoverable, multipliers=("a", "b"), proves=("stays",),
                              covers=("T", "W")),
    },
    {"stays": Target("e stays in (-{k_a}, {k_s}) for all ticks")},
    start="no error",
    never=("a lag of the actuator", "measurement noise"),
    values=_barrier_values,
    witness=_barrier_witness,
    panel=({"k": 1200.0, "k_a": 1.22986, "k_s": 0.02, "W": 5e-3, "T": 2e-4},
     {"k": 1200.0, "k_a": 1.22986, "k_s": 0.02, "W": 1e-2, "T": 1e-3}),
    time=lambda n: SAMPLED,
))  # fmt: skip
