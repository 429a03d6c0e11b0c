"""Bounds of prescribed performance control: an error held inside -lower eta < e < upper eta.

    e' = u + w,   zeta = e/eta,   eps = 1/2 ln((zeta + lower)/(upper - zeta)),
    funnel law    u = -K1 eps/l + e eta'/eta,   l = (1/(zeta + lower) + 1/(upper - zeta))/(2 eta)
    barrier law   u = -K1 eta d eps + e eta'/eta,   d = (lower + upper)/2

With z = (2 zeta - (upper - lower))/(2 d), the share of the half-width, eps = atanh z and
1/l = eta d (1 - z^2). So for either law, and whatever eta does,

    eta d z' = -K1 eta d h(z) + w,   h = (1 - z^2) atanh z  or  h = atanh z

which is all the bounds below need. W is the largest |w|, and ``load = W/(K1 eta d)``. Both laws
pull to z = 0, which is the error ``eta (upper - lower)/2``: none only if upper = lower.
Sampled with period T, the input held and eta slow: z+ = z - kappa h(z) + T w/(eta d), kappa = K1 T.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.errors import BadInput

Z_PEAK = 0.6479182290296026
"""Where h is largest: tanh of the root of 2 eps tanh eps = 1."""

H_MAX = 0.447743204694303
"""Largest value of h(z) = (1 - z^2) atanh z."""

MONOTONE = 1.0
"""Largest kappa of the funnel law at which no error changes its sign from tick to tick."""

STABLE = 2.0
"""Largest kappa of the funnel law at which every error inside the funnel dies out."""

INVARIANT = 3.591121476668622
"""Largest kappa of the funnel law at which no error leaves the funnel by itself: 1/W(1/e)."""


# ---- in continuous time -------------------------------------------------------------------------


def restoring_pull(z: float) -> float:
    """Pull of the funnel law at the share z of the half-width: h = (1 - z^2) atanh z.

    It vanishes at the bound, so an error that comes close enough is not held back.
    """
    return (1 - z * z) * math.atanh(z) if abs(z) < 1 else 0.0


def share(error: float, eta: float, lower: float, upper: float) -> float:
    """Share z of the half-width at an error: -1 at the lower bound, 1 at the upper one."""
    return (2 * error / eta - (upper - lower)) / (lower + upper)


def load(W: float, K1: float, eta: float, lower: float, upper: float) -> float:
    """Disturbance over what the gain can pull: W/(K1 eta d), d = (lower + upper)/2.

    Args:
        W: largest |w| in the error's unit per s. K1: gain in 1/s. eta: the funnel's least value.
        lower, upper: widths over eta.
    """
    return 2 * W / (K1 * eta * (lower + upper))


def largest_disturbance(K1: float, eta: float, lower: float, upper: float) -> float:
    """Largest W that the funnel law holds inside the funnel: 0.44774 K1 eta (lower + upper)/2.

    Proof note: at the share z* of the peak of h, z' <= 0 for every |w| <= W, so |z| <= z* is
    invariant. A constant w above the bound gives z' > 0 for all z, and the bound is crossed in
    finite time. Take the least eta, eta_inf: e eta'/eta cancels the motion of the funnel.
    """
    return H_MAX * K1 * eta * (lower + upper) / 2


def settled_share(load: float) -> float:
    """Largest |z| that a disturbance leaves in the end: smaller root of h(z) = load; inf if none.

    Proof note: h rises up to z*, so z' points inwards between both roots.
    """
    return bisect(restoring_pull, load, 0.0, Z_PEAK) if load <= H_MAX else math.inf


def recoverable(load: float) -> float:
    """Largest |z| at the start that is pulled back in spite of the load: larger root of h = load.

    Zero if there is none. From beyond it, the worst disturbance takes the error out.
    """
    return bisect(restoring_pull, load, 1.0, Z_PEAK) if load <= H_MAX else 0.0


def escape_time(
    W: float, K1: float, eta: float, lower: float, upper: float, z: float = 0.0
) -> float:
    """Time in s in which a constant disturbance takes the error from share z to the bound.

    Proof note: dt = dz/(W/(eta d) - K1 h(z)), integrated over the rest of the way; inf if the
    denominator has a zero there. Substituting z = tanh eps removes the corner of h at the bound.

    Args:
        W, K1, eta, lower, upper: as of :func:`load`, eta constant. z: share at the start.
    """
    q = load(W, K1, eta, lower, upper)
    if z >= 1:
        return 0.0
    if q <= 0 or (q <= H_MAX and z <= recoverable(q)):
        return math.inf
    from scipy.integrate import quad

    def slope(eps: float) -> float:
        narrow = 1 / math.cosh(eps) ** 2
        return narrow / (q - narrow * eps)

    near = math.atanh(Z_PEAK)
    points = sorted({math.atanh(z), *(e for e in (near - 0.5, near, near + 0.5, 3.0, 20.0)
                                      if e > math.atanh(z))})  # fmt: skip
    return sum(quad(slope, a, b, limit=500)[0] for a, b in pairwise(points)) / K1


def barrier_settled(load: float) -> float:
    """Largest |z| that a disturbance leaves in the end under the barrier law: tanh(load) < 1.

    Proof note: z' = -K1 atanh z + w/(eta d); atanh grows without bound, so every bounded
    disturbance is held, and |atanh z| <= max(|atanh z(0)|, load).
    """
    return math.tanh(load)


# ---- sampled ------------------------------------------------------------------------------------


def sampled_disturbance(kappa: float) -> float:
    """Largest om = T W/(eta d) that leaves an invariant interval |z| <= zb < 1, funnel law.

    Proof note: |z| <= zb is invariant if and only if max over it of |z - kappa h(z)| + om <= zb
    (both sides are odd). With g = z - kappa h: its maximum on [0, zb] is at an end; its minimum is
    at zc, where h' = 1/kappa, once zb has passed it. So om <= kappa h(zb) and om <= zb + min g. The
    first is largest at z*, the second grows from there on, and where it is the smaller one at z*,
    both are equal at the best zb. For kappa <= 1 the minimum is 0 and om = 0.44774 kappa.
    """
    if kappa <= 0 or kappa >= INVARIANT:
        return 0.0

    def least(zb: float) -> float:
        return min(0.0, *(z - kappa * restoring_pull(z) for z in (min(zb, turn), zb)))

    # h' = 1 - 2 z atanh z falls, so z atanh z = (1 - 1/kappa)/2 has one root
    turn = 0.0
    if kappa > 1:
        turn = bisect(lambda z: z * math.atanh(z), (1 - 1 / kappa) / 2, 0.0, 1 - 1e-16)
    if Z_PEAK + least(Z_PEAK) >= kappa * H_MAX:
        return kappa * H_MAX
    zb = bisect(lambda z: z + least(z) - kappa * restoring_pull(z), 0.0, Z_PEAK, 1.0)
    return zb + least(zb)


def barrier_window(zb: float, om: float = 0.0) -> tuple[float, float]:
    """Least and largest kappa at which |z| <= zb < 1 is invariant, barrier law; (inf, 0) if none.

    Proof note: the map z - kappa atanh z is odd. From the end zb it must not jump past the other
    end: kappa <= (2 zb - om)/atanh zb. It must pull back at the end: kappa >= om/atanh zb. Where
    its hump at z = sqrt(1 - kappa) lies inside, the hump plus om must not pass zb either.

    Args:
        zb: share of the half-width to be kept. om: T W/(eta d).
    """
    high = (2 * zb - om) / math.atanh(zb)

    def hump(kappa: float) -> float:
        top = math.sqrt(1 - kappa)
        return top - kappa * math.atanh(top)

    low = om / math.atanh(zb)
    if 1 - low > 0 and math.sqrt(1 - low) < zb:
        low = bisect(hump, zb - om, 1.0, 1 - zb * zb) if om <= zb else math.inf
    return (low, high) if low <= high else (math.inf, 0.0)


# ---- references, actuators, speeds --------------------------------------------------------------


def largest_reference_step(
    error: float, eta: float, lower: float, upper: float
) -> tuple[float, float]:
    """Largest steps of the reference, (down, up), that leave the error inside the funnel.

    Proof note: a step up by s turns e into e - s > -lower eta; a step down into e + s < upper eta.
    For lower = upper = d both are at least d eta - |e|.
    """
    return max(0.0, upper * eta - error), max(0.0, lower * eta + error)


def smallest_funnel(error: float, lower: float, upper: float, reserve: float = 1.0) -> float:
    """Least eta whose funnel holds an error; below ``reserve`` of the bound if reserve < 1."""
    return max(error / upper, -error / lower) / reserve


def slip_fall_rate(
    F_a: float, v: float, r: float, I_w: float, a: float = 0.0, slip: float = 0.0
) -> float:
    """Fastest fall of the slip ratio in 1/s, with the brake released: r^2 |F_a|/(I_w v) and a rest.

    Proof note: lambda = (v - omega r)/v gives lambda' = (1 - lambda) v'/v - r omega'/v, and a wheel
    without brake torque has omega' = |F_a| r/I_w. A brake cannot push, so this is the limit.

    Args:
        F_a: adhesion force in N. v: vehicle speed in m/s. r: radius in m. I_w: inertia in kg m^2.
        a: deceleration of the vehicle in m/s^2, whose share (1 - slip) a/v is 8 % on paper 001's
            train; left out by default.
        slip: slip ratio, for that share.
    """
    return r**2 * abs(F_a) / (I_w * v) + (1 - slip) * abs(a) / v


def crossing_time(
    error: float, rate: float, eta_0: float, eta_inf: float, k: float, width: float
) -> float:
    """First time in s at which an error that falls at a rate meets the bound; inf if never.

    The bound is width ((eta_0 - eta_inf) exp(-k t) + eta_inf). Proof note: bound minus error is
    convex in t, so it has at most one minimum, and it is met before that or never.

    Args:
        error: at t = 0, > 0. rate: fall of the error in 1/s, from then on until it is 0.
        eta_0, eta_inf: the funnel at t = 0 and in the end. k: its decay in 1/s. width: upper.
    """

    def gap(t: float) -> float:
        return width * ((eta_0 - eta_inf) * math.exp(-k * t) + eta_inf) - max(0.0, error - rate * t)

    if gap(0.0) <= 0:
        return 0.0
    end = error / rate if rate > 0 else math.inf
    steepest = width * k * (eta_0 - eta_inf)
    bottom = (
        math.log(steepest / rate) / k if steepest > rate > 0 else (0.0 if rate > 0 else math.inf)
    )
    bottom = min(bottom, end)
    if math.isinf(bottom):
        if error < width * eta_inf:
            return math.inf
        bottom = math.log(max(steepest / k / max(error - width * eta_inf, 1e-300), 1.0)) / k + 1 / k
    return math.inf if gap(bottom) > 0 else bisect(gap, 0.0, 0.0, bottom)


def largest_decay(error: float, rate: float, eta_0: float, eta_inf: float, width: float) -> float:
    """Largest k in 1/s of a funnel that an error falling at a rate never meets.

    Proof note: with A = error/width - eta_inf, B = rate/width the bound is met at t unless
    k <= -ln((A - B t)/(eta_0 - eta_inf))/t. With s = B t/A the least right side is at
    u - ln u = 1 + ln((eta_0 - eta_inf)/A), u = 1/(1 - s) > 1, and equals u B/A.

    Args:
        error, rate, eta_0, eta_inf, width: as of :func:`crossing_time`.
    """
    A, B = error / width - eta_inf, rate / width
    if A <= 0:
        return math.inf
    if eta_0 - eta_inf <= A or B <= 0:
        return 0.0
    c = math.log((eta_0 - eta_inf) / A)
    u = 1 + c + math.sqrt(2 * c)  # an upper bound, from which Newton's method falls to the root
    for _ in range(50):
        u -= (u - math.log(u) - 1 - c) / (1 - 1 / u) if u > 1 else 0.0
    return u * B / A


def neglected_term(v: float, a: float, slip: float) -> float:
    """Disturbance in 1/s that a law makes by leaving out the vehicle's motion: (1 - slip) a/v.

    Args:
        v: vehicle speed in m/s. a: its deceleration in m/s^2, g mu without resistance.
        slip: slip ratio, the least one in the funnel.
    """
    return (1 - slip) * a / v


def lowest_speed(a: float, slip: float, W: float) -> float:
    """Speed in m/s below which that term passes what the law holds: (1 - slip) a/W.

    Args:
        a, slip: as of :func:`neglected_term`. W: :func:`largest_disturbance` at the least eta.
    """
    return (1 - slip) * a / W


def adhesion_budget(v: float, W: float, r: float, I_w: float) -> float:
    """Largest error of the adhesion estimate in N that the law holds at a speed: W I_w v/r^2.

    Proof note: the law's torque contains r F_a^, so w = r^2 (F_a - F_a^)/(I_w v).

    Args:
        v: vehicle speed in m/s. W: :func:`largest_disturbance`, less what else disturbs.
        r: wheel radius in m. I_w: wheel inertia in kg m^2.
    """
    return W * I_w * v / r**2


# ---- refusals -----------------------------------------------------------------------------------


def check_gain(where: str, K1: float, T: float, law: str = "funnel") -> None:
    """Refuse K1 T beyond its window.

    Args:
        where: name of the block for the message. K1: gain in 1/s. T: period in s.
        law: ``"funnel"`` (stable up to 2) or ``"barrier"`` (keeps 0.95 of the half-width).

    Raises:
        BadInput: with the bound and the gain that would pass.
    """
    limit = STABLE if law == "funnel" else barrier_window(0.95)[1]
    if not 0 < K1 * T <= limit:
        raise BadInput(
            f"{where}: K1 = {K1:g} 1/s at T = {T:g} s is K1 T = {K1 * T:g}, and the {law} law needs"
            f" 0 < K1 T <= {limit:.4g}; K1 = {_below(limit / T)} 1/s would pass"
        )


def check_start(where: str, error: float, eta_0: float, lower: float, upper: float) -> None:
    """Refuse an error at the start that lies outside the funnel.

    Raises:
        BadInput: with the bounds and the eta_0 that would pass.
    """
    if not -lower * eta_0 < error < upper * eta_0:
        needed = smallest_funnel(error, lower, upper, 0.9)
        raise BadInput(
            f"{where}: the error {error:g} at the start is outside the funnel"
            f" {-lower * eta_0:g}..{upper * eta_0:g}; eta_0 = {_above(needed)} would pass"
        )


def check_reference_step(
    where: str, step: float, eta_inf: float, lower: float, upper: float, error: float = 0.0
) -> None:
    """Refuse a step of the reference that throws the error out of the funnel.

    Args:
        where: name of the block for the message. step: of the reference, either way.
        eta_inf: least eta. lower, upper: widths. error: largest |e| when it comes.

    Raises:
        BadInput: with the bound and the step that would pass.
    """
    limit = min(lower, upper) * eta_inf - abs(error)
    if not abs(step) < limit:
        wider = (abs(step) + abs(error)) / min(lower, upper) / 0.9
        advice = f"a step of {_below(0.9 * limit)}" if limit > 0 else f"eta_inf = {_above(wider)}"
        raise BadInput(
            f"{where}: a reference step of {abs(step):g} leaves the funnel, which has room for"
            f" less than {max(limit, 0.0):g} at eta_inf = {eta_inf:g}; {advice} would pass"
        )


def _below(number: float) -> str:
    """Three digits, not above."""
    digits = 2 - math.floor(math.log10(number))
    return f"{math.floor(number * 10**digits * (1 + 1e-12)) / 10**digits:g}"


def _above(number: float) -> str:
    """Three digits, not below."""
    digits = 2 - math.floor(math.log10(number))
    return f"{math.ceil(number * 10**digits * (1 - 1e-12)) / 10**digits:g}"


def lyapunov(z: Any, w: Any, K1: float, width: float) -> tuple[Any, Any]:
    """V and V', V = eps^2/2 of prescribed performance, eps = atanh z; Zhang 2021 (35)-(37).

    eps' = -K1 eps + l w, l = 1/(width (1 - z^2)): V' = -K1 eps^2 + l eps w.

    Args:
        z: share of the half-width. w: disturbance of the slip ratio's rate in 1/s. K1: gain.
        width: eta (delta_l + delta_u)/2.
    """
    eps = np.arctanh(z)
    return eps * eps / 2, -K1 * eps * eps + eps * w / (width * (1 - z * z))
