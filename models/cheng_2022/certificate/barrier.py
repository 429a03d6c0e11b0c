"""Bounds of barrier Lyapunov control: an error held inside -k_a < e < k_s.

    e' = -kappa(e) + w
    printed shape   kappa = 2 k e (k_x^2 - e^2)        pulls less and less near the barrier
    robust shape    kappa = q e k_x^2/(k_x^2 - e^2)    pulls more and more

with k_x = k_a for e < 0 and k_s for e > 0; below, ``width`` is the k_x of one side. With z = e/k_x

    z' = -2 k k_x^2 z (1 - z^2) + w/k_x     and     z' = -q z/(1 - z^2) + w/k_x

Sampled with period T: z+ = z - kappa h(z) + om, kappa = 2 k k_x^2 T or q T, om = T w/k_x.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.errors import BadInput

Z_PEAK = 1 / math.sqrt(3)
"""Where z (1 - z^2) is largest."""

H_MAX = 2 / (3 * math.sqrt(3))
"""Largest value of z (1 - z^2)."""

STABLE = 2.0
"""Largest kappa of the printed shape at which errors inside the barrier die out."""

INVARIANT = 4.0
"""Largest kappa of the printed shape at which no error leaves the barrier by itself."""


# ---- printed shape, continuous ------------------------------------------------------------------


def pull(e: float, k: float, width: float) -> float:
    """Pull 2 k e (k_x^2 - e^2) of the printed shape; beyond the barrier it pushes outwards."""
    return 2 * k * e * (width * width - e * e)


def rate(k: float, width: float) -> float:
    """Rate in 1/s of small errors: 2 k k_x^2."""
    return 2 * k * width * width


def largest_disturbance(k: float, width: float) -> float:
    """Largest |w| that the printed shape holds: 4 k k_x^3/(3 sqrt 3).

    Proof note: the pull is largest at e = k_x/sqrt 3, so that for every |w| up to its value there
    |e| <= k_x/sqrt 3 is invariant. A constant w above it gives e' > 0 up to the barrier and beyond.
    """
    return 2 * H_MAX * k * width**3


def settled_error(W: float, k: float, width: float) -> float:
    """Largest |e| that a disturbance leaves in the end; inf if none.

    Proof note: smaller root of 2 k e (k_x^2 - e^2) = W by the trigonometric solution of a cubic.
    """
    load = abs(W) / largest_disturbance(k, width)
    if load > 1:
        return math.inf
    return 2 * width * Z_PEAK * math.cos((math.acos(-load) + 4 * math.pi) / 3)


def recoverable(W: float, k: float, width: float) -> float:
    """Largest |e| at the start that is pulled back in spite of W; 0 if none."""
    load = abs(W) / largest_disturbance(k, width)
    return 0.0 if load > 1 else 2 * width * Z_PEAK * math.cos(math.acos(-load) / 3)


def escape_time(W: float, k: float, width: float, e: float = 0.0) -> float:
    """Time in s in which a constant W > 0 takes the error from e >= 0 to the barrier.

    Proof note: dt = de/(W - 2 k e (k_x^2 - e^2)); inf if the denominator has a zero on the way.
    """
    if e >= width:
        return 0.0
    q = abs(W) / (2 * k * width**3)
    if q <= H_MAX and e <= recoverable(W, k, width):
        return math.inf
    from scipy.integrate import quad

    z = e / width
    ends = sorted({z, 1.0, *(s for s in (Z_PEAK - 0.05, Z_PEAK, Z_PEAK + 0.05) if z < s < 1)})
    total = sum(
        quad(lambda s: 1 / (q - s * (1 - s * s)), a, b, limit=500)[0] for a, b in pairwise(ends)
    )
    return total / rate(k, width)


# ---- printed shape, sampled ---------------------------------------------------------------------


def overshoot(kappa: float) -> float:
    """Furthest share of k_x on the other side after one tick: max of -(z - kappa z (1 - z^2)).

    Proof note: (kappa - 1) z - kappa z^3 is largest at z^2 = (kappa - 1)/(3 kappa); none if
    kappa <= 1. It is 1 at kappa = 4, which is INVARIANT.
    """
    return 0.0 if kappa <= 1 else 2 / 3 * (kappa - 1) * math.sqrt((kappa - 1) / (3 * kappa))


def largest_period(k: float, k_a: float, k_s: float) -> float:
    """Largest period in s at which no error in (-k_a, k_s) jumps out: printed shape, w = 0.

    Proof note: from the side of k_a the furthest error is k_a overshoot(kappa_a) < k_s, and the
    same from the other side. From the narrower side that is so up to kappa = INVARIANT.
    """

    def of(here: float, there: float) -> float:
        share = there / here
        kappa = bisect(overshoot, share, 1.0, INVARIANT) if share < 1 else INVARIANT
        return kappa / rate(k, here)

    return min(of(k_a, k_s), of(k_s, k_a))


def stable_period(k: float, k_a: float, k_s: float) -> float:
    """Largest period in s at which small errors die out: kappa = 2 k k_x^2 T <= 2."""
    return STABLE / rate(k, max(k_a, k_s))


def sampled_disturbance(kappa: float) -> float:
    """Largest om = T W/k_x that leaves an invariant |z| <= zb < 1, printed shape, equal sides.

    Proof note: as for a funnel, om <= kappa h(zb), largest at 1/sqrt 3. And om <= zb + min over
    [0, zb] of z - kappa h(z). That grows with zb beyond the minimum. For kappa <= 1 that minimum
    is 0, so om = 2 kappa/(3 sqrt 3).
    """
    if not 0 < kappa < INVARIANT:
        return 0.0

    def g(z: float) -> float:
        return z - kappa * z * (1 - z * z)

    turn = math.sqrt((kappa - 1) / (3 * kappa)) if kappa > 1 else 0.0

    def room(zb: float) -> float:
        return zb + min(0.0, g(min(zb, turn)), g(zb))

    if room(Z_PEAK) >= kappa * H_MAX:
        return kappa * H_MAX
    return room(bisect(lambda z: room(z) - kappa * z * (1 - z * z), 0.0, Z_PEAK, 1.0))


# ---- robust shape -------------------------------------------------------------------------------


def robust_pull(e: float, q: float, width: float) -> float:
    """Pull q e k_x^2/(k_x^2 - e^2) of the robust shape."""
    return q * e * width * width / (width * width - e * e)


def robust_settled(W: float, q: float, width: float) -> float:
    """Largest |e| that a disturbance leaves in the end, below the barrier for every W.

    Proof note: positive root of W e^2 + q k_x^2 e - W k_x^2 = 0, where the pull equals W; the
    pull rises, so |e| <= that root is invariant and attractive.
    """
    load = 2 * abs(W) / (q * width)
    return width * load / (1 + math.sqrt(1 + load * load))


def robust_holds(kappa: float, zb: float, om: float = 0.0) -> bool:
    """Whether |z| <= zb < 1 is invariant under the sampled robust shape.

    Proof note: g = z - kappa z/(1 - z^2) is odd; its only hump in [0, 1) is at
    z^2 = (2 + kappa - sqrt(kappa^2 + 8 kappa))/2, none for kappa >= 1. So it is invariant if and
    only if g at the hump and at both ends of [0, zb], plus om, lie within -zb..zb.
    """

    def g(z: float) -> float:
        return z - kappa * z / (1 - z * z)

    hump = (2 + kappa - math.sqrt(kappa * kappa + 8 * kappa)) / 2
    places = [0.0, zb] + ([math.sqrt(hump)] if 0 < hump < zb * zb else [])
    return all(abs(g(z)) + om <= zb * (1 + 1e-14) for z in places)


def robust_window(zb: float, om: float = 0.0) -> tuple[float, float]:
    """Least and largest kappa = q T at which |z| <= zb is invariant; (inf, 0) if none.

    Proof note: from the end zb it must not jump past the other end:
    kappa <= (2 - om/zb)(1 - zb^2). What pulls back falls with kappa no more than it gains, so the
    set of kappa that hold is an interval below that.
    """
    high = (2 - om / zb) * (1 - zb * zb)
    if high <= 0 or not robust_holds(high * (1 - 1e-12), zb, om):
        return math.inf, 0.0
    if om == 0:
        return 0.0, high
    return bisect(lambda kappa: float(robust_holds(kappa, zb, om)), 0.5, 0.0, high), high


# ---- lag ----------------------------------------------------------------------------------------


def lag_excursion(jump: float, lag: float, authority: float | None = None) -> float:
    """Excursion of e that a jump of w makes behind an actuator of a lag.

    Without ``authority`` jump times lag, which no law undercuts behind a dead time, because
    e' = jump until the lag is over. A first-order lag that is given u* = jump leaves
    jump exp(-t/lag), of the same integral.

    Proof note, with ``authority`` A > jump: e' = jump - A (1 - exp(-t/lag)) until
    t* = -lag ln(1 - jump/A), and no command within A makes that integral smaller. It falls from
    jump times lag at A = jump to 0 for A without bound.

    Args:
        jump: of w, unit of e per s. lag: in s. authority: largest command, unit of w; for a
            first-order lag only.
    """
    if authority is None or authority <= jump:
        return jump * lag if authority is None or authority == jump else math.inf
    t = -lag * math.log(1 - jump / authority)
    return jump * t - authority * (t - lag * jump / authority)


# ---- refusals -----------------------------------------------------------------------------------


def check_start(where: str, error: float, k_a: float, k_s: float) -> None:
    """Refuse an error at the start that lies outside the barrier.

    Raises:
        BadInput: with the bounds and the barrier that would pass.
    """
    if not -k_a < error < k_s:
        name = "k_s" if error > 0 else "k_a"
        raise BadInput(
            f"{where}: the error {error:g} at the start is outside the barrier {-k_a:g}..{k_s:g};"
            f" {name} = {abs(error) / 0.9:.3g} would pass"
        )


def check_period(where: str, k: float, k_a: float, k_s: float, T: float) -> None:
    """Refuse a period at which the printed shape can jump over its own barrier.

    Raises:
        BadInput: with the bound and the period that would pass.
    """
    limit = largest_period(k, k_a, k_s)
    if not limit >= T:
        raise BadInput(
            f"{where}: at T = {T:g} s the printed shape can jump over its barrier; it needs"
            f" T <= {limit:.4g} s, and {0.9 * limit:.2g} s would pass"
        )


def check_rate(where: str, q: float, T: float, share: float = 0.9) -> None:
    """Refuse a robust shape whose q T does not keep a share of the barrier.

    Raises:
        BadInput: with the bound and the rate that would pass.
    """
    limit = robust_window(share)[1]
    if not 0 < q * T <= limit:
        raise BadInput(
            f"{where}: q = {q:g} 1/s at T = {T:g} s is q T = {q * T:g}, and keeping {share:g} of"
            f" the barrier needs 0 < q T <= {limit:.4g}; q = {0.99 * limit / T:.3g} 1/s would pass"
        )


def lyapunov(e: Any, w: Any, k: float, k_a: float, k_s: float) -> tuple[Any, Any]:
    """V and V', V = ln(k_x^2/(k_x^2 - e^2))/2, k_x = k_a for e < 0, else k_s; Cheng 2022 (43)-(48).

    V' = e e'/(k_x^2 - e^2) = -2 k e^2 + e w/(k_x^2 - e^2) with the printed shape.
    """
    width = np.where(np.asarray(e) < 0, k_a, k_s)
    room = width**2 - e * e
    return np.log(width**2 / room) / 2, -2 * k * e * e + e * w / room
