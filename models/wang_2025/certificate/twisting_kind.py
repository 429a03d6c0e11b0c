"""Systems of Wang 2025 of the super-twisting kind: the adhesion observer and the adaptive law.

Both are x1' = -K1 phi1(x1) + x2, x2' = -K2 phi2(x1) + d with phi2 = phi1 phi1' and, near x1 = 0,
phi1 = |x1|^(1/2) sgn x1, so that K2 phi2 -> K2/2 sgn x1. What phi1 has more makes |d|/phi1' smaller
than 2 L |phi1| everywhere but at x1 = 0: it neither helps nor harms what decides there. Hence
K1, K2/2, L are stable exactly if k1, k2, L of super-twisting are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from slipctl.certify.registry import register
from slipctl.certify.systems import (
    EXACT,
    INPUT,
    PRINTED,
    SUFFICIENT,
    Criterion,
    Entries,
    Number,
    Numbers,
    Quantity,
    Side,
    System,
    Target,
    Witness,
)
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.super_twisting.certificate import worst_run
from slipctl.models.super_twisting.certificate.quadratic import (
    MATRIX,
    exact_sides,
    fall,
    matrix,
    quadratic_sides,
)
from slipctl.models.wang_2025.certificate import adhesion_observer, higher_order


def _told(n: Numbers) -> list[Any]:
    return [n[k] for k in MATRIX] if "P11" in n else []


# ---- adhesion observer --------------------------------------------------------------------------

OBSERVER = ("K1", "K2/2", "L")


def _observer_exact(n: Numbers) -> Sequence[Side]:
    return exact_sides(n["K1"], n["K2"] / 2, n["L"], OBSERVER)


def _observer_quadratic(n: Numbers) -> Sequence[Side]:
    return quadratic_sides(n["K1"], n["K2"] / 2, n["L"], OBSERVER, _told(n))


def _observer_fall(n: Numbers, entry: Entries) -> str:
    return fall(n["K1"], n["K2"] / 2, n["L"], [Fraction(entry["multipliers"][k]) for k in MATRIX])


def _observer_root(n: Numbers) -> Sequence[Side]:
    return [
        Side("2 K2 < K1^2", 2 * n["K2"], n["K1"] ** 2), Side("2 L < K2", 2 * n["L"], n["K2"])
    ]  # fmt: skip


def _observer_printed(n: Numbers) -> Sequence[Side]:
    return [Side("2 K2 < K1", 2 * n["K2"], n["K1"]), Side("2 L < K2", 2 * n["L"], n["K2"])]


def _observer_run(n: Numbers) -> worst_run.Turns:
    K1, K2, K3, L = (float(n[k]) for k in ("K1", "K2", "K3", "L"))
    # so near to x1 = 0 that K3 |x1| is a thousandth, because that is where L decides
    v = math.sqrt(2 * K2 * 1e-3 / max(K3, 1e-3)) / 10
    return worst_run.run(
        lambda y: K1 * (y + K3 * y**3),
        lambda y: K2 * (0.5 + 2 * K3 * y**2 + 1.5 * K3**2 * y**4),
        L, v, 0.02 / max(K1, math.sqrt(K2 + 2 * L)),
    )  # fmt: skip


def _observer_values(n: Numbers) -> dict[str, Quantity]:
    K1, K2, L = n["K1"], n["K2"], n["L"]
    return {
        "worst_ratio": (sta.worst_ratio(K1, K2 / 2, L), "1"),
        "peak_gain": (adhesion_observer.peak_gain(K1, K2, L), "1"),
        "time_from_1_rad/s": (
            adhesion_observer.convergence_time(K1, K2, L, 1.0, 0.0, n["K3"]), "s"),
    }  # fmt: skip


def _run_witness(found: worst_run.Turns, law: str, units: tuple[str, str, str]) -> Witness:
    grown = found.growth()
    return Witness(
        law,
        {"growth_per_half_turn": (grown, "1"), "half_turns": (float(len(found.times) - 1), "1")},
        {"t": ("s", found.t), "x1": (units[0], found.x1), "x2": (units[1], found.x2),
         "d": (units[2], found.d)},
    )  # fmt: skip


WORST = "d = L sgn x1 while |x1| grows, -L sgn x1 while it falls"
NEVER = ("the law computed once per period", "measurement noise")

ADHESION_OBSERVER = register(System(
    "adhesion_observer",
    "Wang 2025 (17), (18): e' = z - K1 Phi1(e), z' = f' - K2 Phi2(e), |f'| < L: is e -> 0 in finite"
    " time? Phi1 = |e|^.5 sgn e + K3 |e|^1.5 sgn e, Phi2 = Phi1 Phi1'",
    {
        "K1": Number("rad^.5/s^1.5", "gain of the root", power=0.5),
        "K2": Number("rad/s^3", "gain of the integral", power=1.0),
        "K3": Number("s/rad", "gain of the far part", 0.0, "not negative", -1.0),
        "L": Number("rad/s^3", "bound of |f'|, f = -r F/J", power=1.0, role=INPUT,
                    says="every |f'| <= {}"),
    },
    {
        "exact": Criterion("q(K1, K2/2, L) < 1, any K3 >= 0", _observer_exact, EXACT,
                           ("largest_L", "smallest_K1", "smallest_K2"), proves=("settles",),
                           covers=("L",), refutes=WORST),
        "quadratic": Criterion("bounded-real lemma: any quadratic function of (Phi1, z)",
                               _observer_quadratic, SUFFICIENT,
                               ("largest_L", "smallest_K1", "smallest_K2"),
                               find=lambda n: matrix(n["K1"], n["K2"] / 2, n["L"]),
                               multipliers=MATRIX, proves=("settles",), covers=("L",),
                               step=_observer_fall),
        "theorem_1": Criterion("Theorem 1 with its root: K1 > sqrt(2 K2), K2 > 2 L",
                               _observer_root, margins=("largest_L", "smallest_K1"),
                               proves=("settles",), covers=("L",)),
        "printed_theorem_1": Criterion("Theorem 1 as our text has it, K1 > 2 K2; proves nothing",
                                       _observer_printed, PRINTED, ("largest_L", "smallest_K1")),
    },
    {"settles": Target("e is 0 after a finite time, and stays there")},
    never=NEVER,
    values=_observer_values,
    witness=lambda n: _run_witness(_observer_run(n), WORST, ("rad/s", "rad/s^2", "rad/s^3")),
    panel=({"K1": 98.5, "K2": 4400.0, "L": 2000.0, "K3": 0.5}, {"K1": 2.0, "K2": 0.3, "L": 0.1},
     {"K1": 0.5, "K2": 0.2, "L": 0.09}, {"K1": 1.0, "K2": 2.2, "L": 1.0}),
))  # fmt: skip


# ---- adaptive higher-order sliding mode ---------------------------------------------------------

HIGHER = ("k4", "beta k4", "eta")


def young_49(alpha: Any, beta: Any, k: Any, eta: Any, theta: Any) -> list[Side]:
    """Inequalities of (49) with the weight theta in Young's inequality; 1 as printed.

    16 theta eta^2 < 2 alpha k - beta^2/theta - (alpha + 4 beta^2 - beta/(2 theta))^2
    /(4 beta - 1/(4 theta)).

    Proof note: V = zeta' P zeta, P = [[alpha + 4 beta^2, -2 beta], [-2 beta, 1]], k2 = 2 beta k.
    The disturbance enters as 2 zeta' P B w <= zeta' P B B' P zeta/theta + theta w^2, |w| <= 4 eta
    |zeta1|, B = (0, 1/2)'.
    """
    rest = 4 * beta - 1 / (4 * theta)
    first = Side("1 < 16 beta theta", 1, 16 * beta * theta)
    if not rest > 0:
        return [first]
    cross = (alpha + 4 * beta**2 - beta / (2 * theta)) ** 2 / rest
    return [
        first,
        Side("16 theta eta^2 + beta^2/theta + (alpha + 4 beta^2 - beta/(2 theta))^2/(4 beta"
             " - 1/(4 theta)) < 2 alpha k4",
             16 * theta * eta**2 + beta**2 / theta + cross, 2 * alpha * k),
    ]  # fmt: skip


def best_weight(alpha: float, beta: float, eta: float) -> float:
    """Weight theta of the least k4 in :func:`young_49`, by golden section.

    Proof note: each term is convex in 1/theta or theta > 1/(16 beta), so there is one minimum.
    """

    def needed(log_theta: float) -> float:
        theta = math.exp(log_theta)
        return float(young_49(alpha, beta, 0.0, eta, theta)[-1].left)

    low = math.log(1 / (16 * beta)) + 1e-9
    high, ratio = low + 40.0, (math.sqrt(5) - 1) / 2
    for _ in range(70):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if needed(a) < needed(b) else (a, high)
    return math.exp((low + high) / 2)


def _higher_exact(n: Numbers) -> Sequence[Side]:
    return exact_sides(n["k4"], n["beta"] * n["k4"], n["eta"], HIGHER)


def _higher_quadratic(n: Numbers) -> Sequence[Side]:
    return quadratic_sides(n["k4"], n["beta"] * n["k4"], n["eta"], HIGHER, _told(n))


def _higher_printed(n: Numbers) -> Sequence[Side]:
    return young_49(n["alpha"], n["beta"], n["k4"], n["eta"], 1)


def _higher_matrix(n: Numbers) -> dict[str, Fraction] | None:
    return matrix(n["k4"], n["beta"] * n["k4"], n["eta"])


def _higher_fall(n: Numbers, entry: Entries) -> str:
    P = [Fraction(entry["multipliers"][k]) for k in MATRIX]
    return fall(n["k4"], n["beta"] * n["k4"], n["eta"], P)


def _young_fall(n: Numbers, entry: Entries) -> str:
    """The matrix of (49): what the weight in Young's inequality is for."""
    P = [n["alpha"] + 4 * n["beta"] ** 2, -2 * n["beta"], Fraction(1)]
    return fall(n["k4"], n["beta"] * n["k4"], n["eta"], P)


def _weight(n: Numbers) -> dict[str, Fraction]:
    theta = best_weight(float(n["alpha"]), float(n["beta"]), float(n["eta"]))
    return {"theta": Fraction(theta).limit_denominator(10**9) or Fraction(theta)}


def _higher_weighted(n: Numbers) -> Sequence[Side]:
    theta = n.get("theta")
    if theta is None:
        exact = isinstance(n["k4"], Fraction)
        theta = _weight(n)["theta"] if exact else best_weight(n["alpha"], n["beta"], n["eta"])
    return young_49(n["alpha"], n["beta"], n["k4"], n["eta"], theta)


def _higher_run(n: Numbers) -> worst_run.Turns:
    k1, k2, eta = float(n["k4"]), 2 * float(n["beta"]) * float(n["k4"]), float(n["eta"])
    v = 1e-3 * math.sqrt(k2 + eta)  # |s|^(1/2) is then a thousandth, and phi1 nearly its root
    return worst_run.run(
        lambda y: k1 * (y + y**2), lambda y: k2 * (0.5 + 1.5 * y + y**2), eta, v,
        0.02 / max(k1, math.sqrt(k2 + 2 * eta)),
    )  # fmt: skip


def _higher_values(n: Numbers) -> dict[str, Quantity]:
    found = {
        "worst_ratio": (sta.worst_ratio(n["k4"], n["beta"] * n["k4"], n["eta"]), "1"),
        "eta_of_49": (higher_order.certified_eta(n["alpha"], n["beta"], n["k4"]), "m/s^3"),
        "best_eta_of_the_matrix": (higher_order.best_weighted(n["k4"])[2], "m/s^3"),
        "smallest_k4_of_49_at_best": (higher_order.smallest_k4(n["eta"]), "1/s"),
    }
    if n["k4"] > higher_order.SMALLEST:
        alpha, beta, eta = higher_order.best(n["k4"])
        found |= {"best_eta_of_49": (eta, "m/s^3"), "with_alpha": (alpha, "1/s^2"),
                  "with_beta": (beta, "1/s")}  # fmt: skip
    return found


_ENDS = ("largest_eta", "smallest_k4")
_SETTLES: dict[str, Any] = {"proves": ("settles",), "covers": ("eta",)}

HIGHER_ORDER = register(System(
    "higher_order",
    "Wang 2025 (37), (38) at the least gain k4: s' = -k4 phi1(s) + v, v' = -2 beta k4 phi2(s) + d,"
    " |d| <= eta: is s -> 0 in finite time? phi1 = |s|^.5 sgn s + s in m/s, phi2 = phi1 phi1'",
    {
        "k4": Number("1/s", "least gain of the adaptation", power=0.5),
        "alpha": Number("1/s^2", "of P in the proof", power=1.0),
        "beta": Number("1/s", "k2H = 2 beta k1H", power=0.5),
        "eta": Number("m/s^3", "bound of |delta'|/M", None, "not negative", 1.0, role=INPUT,
                      says="every |d| <= {}", absent="a disturbance d"),
    },
    {
        "exact": Criterion("q(k4, beta k4, eta) < 1", _higher_exact, EXACT, _ENDS, **_SETTLES,
                           refutes=WORST.replace("L", "eta")),
        "quadratic": Criterion("bounded-real lemma: any quadratic function of (phi1, v)",
                               _higher_quadratic, SUFFICIENT, _ENDS, find=_higher_matrix,
                               multipliers=MATRIX, **_SETTLES, step=_higher_fall),
        "homogenised_49": Criterion("the matrix of (49), best weight in Young's inequality",
                                    _higher_weighted, SUFFICIENT, _ENDS, find=_weight,
                                    multipliers=("theta",), **_SETTLES, step=_young_fall),
        "printed_49": Criterion("Wang 2025, (49) as printed: weight 1", _higher_printed,
                                margins=_ENDS, **_SETTLES, step=_young_fall),
    },
    {"settles": Target("s is 0 after a finite time, and stays there, at the least gain k4")},
    never=(*NEVER, "gains that adapt"),
    values=_higher_values,
    witness=lambda n: _run_witness(_higher_run(n), WORST.replace("L", "eta"),
                                   ("m/s", "m/s^2", "m/s^3")),
    panel=({"k4": 0.25, "alpha": 0.02, "beta": 0.09, "eta": 0.009},
     {"k4": 1.0, "alpha": 0.69, "beta": 0.28, "eta": 0.1},
     {"k4": 1.0, "alpha": 0.56, "beta": 0.375, "eta": 0.2},
     {"k4": 0.4, "alpha": 0.1, "beta": 0.12, "eta": 0.03}),
))  # fmt: skip
