"""Verdict and margins of every criterion of the super-twisting law, and the worst disturbance.

CERTIFIED: the criterion proves the gains. NOT CERTIFIED BY THIS CRITERION: it says nothing. Only
the exact test says REFUTED, and then a disturbance that never lets the loop settle is given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import Any

from slipctl.certify.systems import CERTIFIED, REFUTED, end
from slipctl.errors import BadInput
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.super_twisting.certificate import worst_run
from slipctl.models.super_twisting.certificate.super_twisting import enclosure_of_log_ratio

Test = Callable[[float, float, float], bool]

TITLES = {
    "exact": "necessary and sufficient",
    "quadratic": "any quadratic Lyapunov function",
    "seeber_horn": "after Seeber and Horn 2017",
    "homogenised_48": "matrix of (46), best weight; (48) made unit-free",
    "levant": "after Levant 1993, 1998",
    "printed_48": "Huang 2020, (48) as printed",
    "polyakov_poznyak": "after Polyakov and Poznyak 2009",
    "no_overshoot": "x1 never changes its sign",
}
"""What each criterion is."""

TESTS: dict[str, Test] = {"exact": sta.exact, **sta.SUFFICIENT}
"""Every criterion by name, of k1 - delta, k2, L."""

PANEL = ((3.0, 4.0, 1.0), (1.5, 3.0, 0.1), (2.5, 40.0, 1.0), (20.0, 30.0, 5.0), (0.3, 2.0, 0.5))
"""Gains at which the unit of length is changed to find out whether a criterion depends on it."""


@dataclass(frozen=True)
class Witness:
    """Worst disturbance: r1 = delta |x1|^(1/2) sgn x1, and d = +-L sgn x1.

    Attributes:
        growth: |x2| at a crossing of x1 = 0 over that at the one before (q); inf when x1 never
            comes back, 0 when it comes back to the origin.
        law: the disturbance in words.
        x1, x2: where it starts.
        switches: times in s at which d changes its sign, for the first 8 half turns.
        d: L, the value of d up to the first switch.
        simulated: the growth in a run of the equations against that disturbance.
        trajectory: of that run, unit and values by signal, thinned.
    """

    growth: float
    law: str
    x1: float
    x2: float
    switches: tuple[float, ...]
    d: float
    simulated: float
    trajectory: Mapping[str, tuple[str, Sequence[float]]] = field(default_factory=dict)

    def payload(self) -> dict[str, Any]:
        """Entries of the JSON answer."""
        return {
            "growth": self.growth,
            "law": self.law,
            "start": {"x1": self.x1, "x2": self.x2},
            "d": {"value": self.d, "unit": sta.UNITS["L"]},
            "switches": {"value": list(self.switches), "unit": "s"},
            "simulated_growth": self.simulated,
        }

    def lines(self) -> list[str]:
        """Lines of the table."""
        return [
            f"worst disturbance: {self.law}",
            f"with it |x2| at a crossing of x1 = 0 is {self.growth:.6g} times that before"
            + (f" (simulated: {self.simulated:.6g})" if math.isfinite(self.simulated) else ""),
        ]


def exact_gains(
    k1: float | Fraction, k2: float | Fraction, L: float | Fraction, delta: float | Fraction = 0
) -> dict[str, Fraction]:
    """Gains as exact rationals.

    Raises:
        BadInput: a number that is not finite, not positive, beyond 1e-30 to 1e30, or too close to
            the one that it is compared with.
    """
    out = {}
    for name, value in dict(k1=k1, k2=k2, L=L, delta=delta).items():
        if isinstance(value, float) and not math.isfinite(value):
            raise BadInput(f"{name} = {value} is no finite number; write one in {sta.UNITS[name]}")
        number = Fraction(value)
        if number < 0 or (number == 0 and name != "delta"):
            least = "0 or more" if name == "delta" else "more than 0"
            raise BadInput(
                f"{name} = {float(value):g} {sta.UNITS[name]} must be {least}"
                + ("; without a disturbance every k1 > delta, k2 > 0 is stable" * (name == "L"))
            )
        if number and not Fraction(1, 10**30) <= number <= 10**30:
            raise BadInput(f"{name} must lie between 1e-30 and 1e30 {sta.UNITS[name]}")
        out[name] = number
    for one, two in (("k2", "L"), ("k1", "delta")):
        if out[one] != out[two] and float(out[one]) == float(out[two]):
            raise BadInput(f"{one} and {two} differ by less than a double tells; move them apart")
    return out


def exact_verdict(gains: dict[str, Fraction]) -> str:
    """Verdict of the exact criterion, proven: by rationals, or by an enclosure near the boundary.

    Raises:
        BadInput: the gains lie on the boundary to 240 digits.
    """
    k1, k2, L, delta = (gains[k] for k in ("k1", "k2", "L", "delta"))
    if k2 <= L or k1 <= delta:
        return REFUTED
    if (k1 - delta) ** 2 >= 8 * (k2 + L):
        return CERTIFIED
    ln_q = sta.log_ratio(float(k1 - delta), float(k2), float(L))
    if abs(ln_q) < 1e-6 or not math.isfinite(ln_q):
        found = enclosure_of_log_ratio(k1, k2, L, delta)
        if found is None:
            raise BadInput(
                "the gains lie on the boundary of stability; change k1 in its last digit"
            )
        return CERTIFIED if found[1] < 0 else REFUTED
    return CERTIFIED if ln_q < 0 else REFUTED


# ---- margins ------------------------------------------------------------------------------------


def _edge(holds: Callable[[float], bool], outside: float, inside: float) -> float:
    """Number at which a verdict changes, by bisection to the last digits."""
    for _ in range(200):
        middle = (outside + inside) / 2
        if middle in (outside, inside):
            break
        if holds(middle):
            inside = middle
        else:
            outside = middle
    return inside


def _k1_inside(name: str, k2: float, L: float) -> float:
    """Give a k1 that the criterion accepts if it accepts any at this k2 and L."""
    if k2 <= L:
        return 0.0
    if name == "polyakov_poznyak":
        return (16 * L * (k2 - L)) ** 0.25 * 2
    if name != "printed_48":
        return 2 * max(
            math.sqrt(8 * (k2 + L)), math.sqrt(8 * L * (k2 + L) / (k2 - L)), 2 * math.sqrt(k2)
        )
    low, high = 2.0, 2.0 + 4 * k2 + 4  # k1/4 < k2 is necessary, and the bound is convex in k1

    def bound(k1: float) -> float:
        return k1**2 / (4 * (k1 - 2)) + L**2 / k1

    for _ in range(300):
        one, two = low + (high - low) * 0.382, low + (high - low) * 0.618
        low, high = (low, two) if bound(one) < bound(two) else (one, high)
    return (low + high) / 2


def smallest_k1(name: str, k2: float, L: float, delta: float = 0.0) -> float | None:
    """Lower end of the k1 that a criterion certifies, None if none.

    Proof note: what it certifies is an interval of k1 (each bound is monotone or convex in k1).
    """
    inside = _k1_inside(name, k2, L)
    if not TESTS[name](inside, k2, L):
        return None
    return delta + _edge(lambda k1: bool(TESTS[name](k1, k2, L)), 0.0, inside)


def smallest_k2(name: str, k1: float, L: float, delta: float = 0.0) -> float | None:
    """Lower end of the k2 that a criterion certifies, None if none.

    Proof note: a criterion that accepts k2 > L accepts every larger one, except Seeber and Horn,
    L < k2 < k1^2 - L, and no overshoot, L < k2 <= k1^2/8 - L. Both start at L.
    """
    k = k1 - delta
    if k <= 0:
        return None
    top = {"seeber_horn": k * k - L, "no_overshoot": k * k / 8 - L}.get(name)
    if top is not None:
        return L if top > L else None
    inside = 2 * L
    while not TESTS[name](k, inside, L):
        inside *= 2
        if inside > 1e200:
            return None
    return _edge(lambda k2: bool(TESTS[name](k, k2, L)), L, inside)


def largest_L(name: str, k1: float, k2: float, delta: float = 0.0) -> float | None:
    """Upper end of the L that a criterion certifies, None if none.

    Proof note: every bound gets harder with L, and none holds at L = k2.
    """
    k = k1 - delta
    if k <= 0 or not TESTS[name](k, k2, 0.0):
        return None
    return _edge(lambda L: bool(TESTS[name](k, k2, L)), k2, 0.0)


def margins(
    name: str, k1: float, k2: float, L: float, delta: float = 0.0
) -> dict[str, float | None]:
    """Ends in each direction at which the verdict of a criterion changes.

    ``largest_delta`` is k1 less the smallest k1 at delta = 0, because delta only shifts k1.
    """
    least = smallest_k1(name, k2, L)
    spare = None if least is None or least > k1 else k1 - least
    return {
        "largest_L": largest_L(name, k1, k2, delta),
        "largest_delta": spare,
        "smallest_k1": None if least is None else least + delta,
        "smallest_k2": smallest_k2(name, k1, L, delta),
    }


@cache
def unit_dependent(name: str, scale: float = 1000.0) -> bool:
    """Whether a verdict changes somewhere when lengths are told in another unit.

    Proof note: x1 -> c x1 makes sqrt(c) k1, c k2, c L of the gains; what they do is the same.
    """
    test = TESTS[name]
    return any(
        bool(test(k1, k2, L)) != bool(test(k1 * math.sqrt(c), k2 * c, L * c))
        for k1, k2, L in PANEL
        for c in (scale, 1 / scale)
    )


def orbit_margins(k1: float, k2: float, T: float, band: float) -> dict[str, float | None]:
    """Ends at which explicit Euler's period-2 orbit still fits into a band."""

    def fits(k: float, T: float) -> bool:
        return sta.explicit_amplitude(k, k2, T) <= band

    return {
        "largest_k1": end(lambda k: fits(k, T), k1, True),
        "largest_T": end(lambda t: fits(k1, t), T, True),
    }


# ---- witness and report -------------------------------------------------------------------------


def witness(k1: float, k2: float, L: float, delta: float = 0.0) -> Witness:
    """Worst disturbance from x1 = 0, x2 = 1 and how much it lets x2 grow per half turn."""
    q = sta.worst_ratio(k1, k2, L, delta)
    push = "r1 = delta |x1|^(1/2) sgn x1; " if delta else ""
    ran = simulated_run(k1, k2, L, delta)
    if k2 <= L or k1 <= delta:
        why = "x2 never turns back" if k2 <= L else "nothing damps x1"
        return Witness(math.inf, f"{push}d = L sgn x1: {why}", 0.0, 1.0, (), L, ran.growth(),
                       _trajectory(ran))  # fmt: skip
    law = f"{push}d = L sgn x1 while |x1| grows, -L sgn x1 while it falls (switch at x1' = 0)"
    switches: list[float] = []
    start, v = 0.0, 1.0
    for _ in range(8 if q > 0 else 1):
        turn, end, _ = sta.half_turn(k1, k2, L, delta, v)
        switches.append(start + turn)  # at the crossing sgn x1 and the law change together
        start, v = start + end, v * q
    return Witness(q, law, 0.0, 1.0, tuple(switches), L, ran.growth(), _trajectory(ran))


def simulated_run(k1: float, k2: float, L: float, delta: float = 0.0) -> worst_run.Turns:
    """Run of the equations against the worst disturbance, from x1 = 0, x2 = 1."""
    step = 0.02 / max(abs(k1 - delta), math.sqrt(2 * (k2 + L)))
    return worst_run.run(lambda y: (k1 - delta) * y, lambda y: k2, L, 1.0, step, 2)


def _trajectory(ran: worst_run.Turns) -> dict[str, tuple[str, Sequence[float]]]:
    slope = sta.UNITS["L"]
    return {"t": ("s", ran.t), "x1": ("m/s", ran.x1), "x2": ("m/s^2", ran.x2), "d": (slope, ran.d)}
