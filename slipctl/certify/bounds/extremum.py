"""Bounds of extremum seeking: how fast a seeker climbs, how much it ripples, where it stops.

    sliding mode    v' = k sgn sin(pi (mu(v) - g)/beta),  g' = rho
    perturbation    v = th + a sin wt,  th' = k xi,
                    xi' = w_l ((y - eta) sin wt - xi),  eta' = w_h (y - eta)

mu(v) is a static map with slope mu', curvature mu'' < 0 at its peak and third derivative mu'''.
Units follow v and mu: k of the sliding mode is in v per s, rho in mu per s, beta in mu. k of the
perturbation is in v/mu per s.
"""

from __future__ import annotations

import cmath
import math

from slipctl.errors import BadInput

SLIDING, AVERAGED = "sliding", "averaged"

SEPARATION = 5.0
"""Least ratio of the dither's frequency to the corners of the filters; at 5 the washout keeps
25/26 of the gradient, and the low-pass lets a tenth of the second harmonic through."""


# ---- sliding mode -------------------------------------------------------------------------------


def ripple(k: float, beta: float, rho: float, slope: float = 0.0) -> float:
    """Largest rise of v in one half cycle without sliding; at the peak, ``slope=0``, k beta/rho.

    Proof note: delta = mu - g falls at rho - s k mu' with s = 1 or -1, and s is constant over
    each cell of width beta. So v travels k beta/(rho - k |mu'|) towards the peak and
    k beta/(rho + k |mu'|) back. (-k, k), as printed, are the limits of v', not of v.

    Args:
        k, beta, rho: of the seeker. slope: mu' where it is; inf from the sliding regime on.
    """
    rest = rho - k * abs(slope)
    return k * beta / rest if rest > 0 else math.inf


def sampled_ripple(k: float, beta: float, rho: float, T: float) -> float:
    """Largest rise of v in one half cycle at the peak, at period T: k T ceil(beta/(rho T)).

    Proof note: per tick delta falls by rho T, so a cell of width beta holds floor or ceil of
    beta/(rho T) ticks, and v moves k T in each.
    """
    return k * T * math.ceil(beta / (rho * T) * (1 - 1e-12))


def regime(k: float, rho: float, steepest: float) -> str:
    """``"sliding"`` if somewhere |mu'| > rho/k, so that the seeker climbs at rho; or averaged.

    Proof note: at delta = (2n + 1) beta the sign turns from + to - as delta rises. It is
    attractive from both sides if delta' = k mu' - rho > 0 below and -k mu' - rho < 0 above it,
    that is k mu' > rho. Likewise delta = 2n beta for k mu' < -rho.

    Args:
        k, rho: of the seeker. steepest: largest |mu'| of the map.
    """
    return SLIDING if k * abs(steepest) > rho else AVERAGED


def averaged_rate(k: float, rho: float, slope: float) -> float:
    """Mean v' at a slope: k^2 mu'/rho without sliding, rho/mu' with it.

    Proof note: the half cycles of :func:`ripple` last beta/(rho - k mu') with s = 1 and
    beta/(rho + k mu') with s = -1. So the mean of s is k mu'/rho, exactly, at constant mu'. In
    sliding delta is constant: mu' v' = g' = rho. Both are k at |mu'| = rho/k, the largest rate.
    """
    return k * k * slope / rho if abs(slope) * k <= rho else rho / slope


def time_constant(k: float, rho: float, curvature: float) -> float:
    """Time constant in s of the last, averaged part: rho/(k^2 |mu''|), mu'' at the peak."""
    return rho / (k * k * abs(curvature))


def sliding_zone(k: float, rho: float, curvature: float) -> float:
    """Distance from the peak below which sliding stops: rho/(k |mu''|), to first order."""
    return rho / (k * abs(curvature))


def largest_period(beta: float, rho: float) -> float:
    """Period in s at which delta passes a cell in one tick, beta/rho; stay well below it.

    Beyond it the sign no longer tells the cell: the seeker is deaf.
    """
    return beta / rho


def largest_delay(k: float, rho: float, beta: float, steepest: float) -> float:
    """Delay in s from v to the measured value below which sliding stays on its plane.

    Proof note: a delay lets delta run on beyond the plane at k |mu'| + rho at most. After
    beta/(k |mu'| + rho) it is in the next cell, where the sign turns once more, and the plane is
    lost.

    Args:
        k, rho, beta: of the seeker. steepest: largest |mu'| of the map.
    """
    return beta / (k * abs(steepest) + rho)


def switch_time(beta: float, rho: float, planes: float) -> float:
    """Time in s on a flat top in which delta falls through ``planes`` cells: planes beta/rho."""
    return planes * beta / rho


# ---- perturbation -------------------------------------------------------------------------------


def washout(w: float, w_h: float) -> float:
    """Share of the gradient that passes the washout in phase: w^2/(w^2 + w_h^2).

    Proof note: s/(s + w_h) at s = jw has this real part; demodulation by sin wt keeps only it.
    """
    return w * w / (w * w + w_h * w_h)


def perturbation_poles(
    k: float, w_l: float, a: float, curvature: float, gain: float = 1.0
) -> tuple[complex, complex]:
    """Poles in 1/s of the averaged loop at the peak, slow one first.

    Proof note: the mean over a period of the dither gives to first order

        th~' = k xi,   xi' = w_l (a mu'' th~/2 - xi),   so s^2 + w_l s - k w_l a mu''/2 = 0.

    Args:
        k, w_l, a: of the seeker. curvature: mu'' at the peak.
        gain: share that the washout leaves, :func:`washout`.
    """
    root = cmath.sqrt(w_l * w_l + 2 * k * w_l * a * curvature * gain)
    return (-w_l + root) / 2, (-w_l - root) / 2


def perturbation_stable(k: float, curvature: float) -> bool:
    """Whether the averaged loop seeks the extremum and does not flee it: k mu'' < 0."""
    return k * curvature < 0


def perturbation_bias(a: float, curvature: float, third: float) -> float:
    """Where th comes to rest, less the peak, for a small dither: -mu''' a^2/(8 mu'').

    Proof note: the mean of mu(th + a sin wt) sin wt is a/2 (mu'' th~ + mu''' a^2/8) + ...; it
    vanishes there. Of order a^2, up to a^4.
    """
    return -third * a * a / (8 * curvature)


def perturbation_loss(a: float, curvature: float) -> float:
    """Mean loss of mu by a fixed dither at the peak: |mu''| a^2/4."""
    return abs(curvature) * a * a / 4


def vanishing_slope(r: float, gain: float = 1.0) -> float:
    """Slope |mu'| below which a dither a' = q (r |xi| - a) dies out: 2/(r gain).

    Proof note: at a constant slope xi' = w_l (gain a mu'/2 - xi) has a steady positive solution.
    The pair (xi, a) has a zero eigenvalue where r gain |mu'|/2 = 1, whatever q and w_l. So it
    can stop before the peak, at most where the slope is that, 2/(r |mu''|) from it.

    Args:
        r: gain of the dither in v/mu. gain: :func:`washout`.
    """
    return 2 / (r * gain)


def vanishing_contraction(
    k: float, a: float, q: float, curvature: float, gain: float = 1.0
) -> float:  # fmt: skip
    """Share of its distance from the peak that a dither leaves when it dies out.

    Proof note: with a e^(-q t) and a fast low-pass, th~' = gain k a e^(-q t) mu'' th~/2, so
    ln th~ changes by gain k a mu''/(2 q). A low-pass at w_l delays it; it is the better, the
    smaller gain k a |mu''|/2 is beside w_l.

    Args:
        k, a, q: gain, first amplitude and rate of the dither. curvature: mu'' at the peak.
        gain: :func:`washout`.
    """
    return math.exp(-gain * k * a * abs(curvature) / (2 * q))


# ---- refusals -----------------------------------------------------------------------------------


def check_sampling(where: str, beta: float, rho: float, T: float) -> None:
    """Refuse a period of which fewer than two fit into a cell.

    Raises:
        BadInput: with the bound and the cell that would pass.
    """
    limit = largest_period(beta, rho)
    if not limit * (1 + 1e-9) >= 2 * T:
        raise BadInput(
            f"{where}: at {T:g} s the seeker passes a cell beta = {beta:g} in {limit / T:.3g}"
            f" ticks, and needs two; beta = {2 * rho * T:.4g} or a period of {limit / 2:.4g} s"
            " would pass"
        )


def check_dither(where: str, w: float, w_h: float, w_l: float, T: float) -> None:
    """Refuse a dither near the corners of the filters, or one that a period cannot carry.

    Args:
        where: name for the message. w: dither in rad/s. w_h, w_l: corners in rad/s. T: period.

    Raises:
        BadInput: with the bound and the frequency that would pass.
    """
    corner = max(w_h, w_l)
    if not w >= SEPARATION * corner * (1 - 1e-9):
        raise BadInput(
            f"{where}: a dither of {w:.4g} rad/s is near the filter corners {w_h:g} and {w_l:g}"
            f" rad/s; {SEPARATION * corner:.4g} rad/s or more would pass"
        )
    if not w * T <= math.pi / 5 * (1 + 1e-9):
        raise BadInput(
            f"{where}: a dither of {w:.4g} rad/s has {2 * math.pi / (w * T):.3g} ticks of {T:g} s"
            f" in a period, and needs ten; {math.pi / 5 / T:.4g} rad/s or less would pass"
        )


def check_gain(where: str, k: float, curvature: float) -> None:
    """Refuse a gain that flees the extremum.

    Raises:
        BadInput: with the sign that would pass.
    """
    if not perturbation_stable(k, curvature):
        raise BadInput(
            f"{where}: gain {k:g} with a curvature of {curvature:g} flees the extremum;"
            f" {-math.copysign(abs(k) or 1.0, curvature):g} would pass"
        )
