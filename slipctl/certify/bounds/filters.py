"""What a scalar filter on increments does: pole, variance, and whether its variance can be true.

    phi(k+1) = phi(k) + d_v,  var d_v = q dt;    z(k+1) - z(k) = H dt phi(k) + d_w,  var d_w = R dt

Two readings of R_v = gamma P (Zhang 2021): per sample, P- = (1 + gamma) P, gamma a number; and
continuous, P' = gamma P - H^2 P^2/R, gamma in 1/s. Functions that know both take ``dt=None`` for
the continuous one. H is the slope of the measured rate by phi, R in unit^2/s.
"""

from __future__ import annotations

import math


def pole(gamma: float) -> float:
    """Pole per sample of the estimate's error, 1/(1 + gamma), in steady state.

    Proof note: 1/P = 1/P- + H^2 dt/R and P- = (1 + gamma) P give 1 - K H dt = P/P- = 1/(1 + gamma),
    whatever H, R, dt and the start.
    """
    return 1 / (1 + gamma)


def gain(gamma: float) -> float:
    """Share of a sample's innovation that enters the estimate: K H dt = gamma/(1 + gamma)."""
    return gamma / (1 + gamma)


def rate(gamma: float, dt: float | None = None) -> float:
    """Rate in 1/s at which the error dies out: ln(1 + gamma)/dt, continuous gamma."""
    return gamma if dt is None else math.log1p(gamma) / dt


def time_constant(gamma: float, dt: float | None = None) -> float:
    """Time constant in s: gamma = 0.23 gives 4.83 ms per sample of 1 ms, and 4.35 s per second."""
    return 1 / rate(gamma, dt)


def steady_variance(gamma: float, R: float, H: float, dt: float | None = None) -> float:
    """Steady variance P of phi: gamma R/((1 + gamma) H^2 dt), continuous gamma R/H^2.

    Proof note: 1/P = 1/((1 + gamma) P) + H^2 dt/R; P' = 0.
    """
    return gamma * R / H**2 if dt is None else gain(gamma) * R / (H**2 * dt)


def error_share(
    t: float, gamma: float, prior: float, R: float, H: float, dt: float | None = None
) -> float:
    """Share of the error at the start that is left at t, for constant phi and no noise.

    e(t)/e(0) = 1/(1 + (prior/P)(exp(rate t) - 1)) with the steady P. Proof note: the information
    Y = 1/P obeys Y+ = Y/(1 + gamma) + H^2 dt/R, which is linear, and e+/e = Y/((1 + gamma) Y+).

    Args:
        t: time in s; whole samples if dt is given. prior: variance at t = 0.
        gamma, R, H, dt: as above.
    """
    ratio = prior / steady_variance(gamma, R, H, dt)
    return 1 / (1 + ratio * math.expm1(rate(gamma, dt) * t))


def settling_time(
    share: float, gamma: float, prior: float, R: float, H: float, dt: float | None = None
) -> float:
    """Time in s until that share of the error is left; 39.6 s for half of it as printed."""
    ratio = prior / steady_variance(gamma, R, H, dt)
    return math.log1p((1 / share - 1) / ratio) / rate(gamma, dt)


def printed_22(sigma: float, unknowns: int = 1, N: int = 3) -> tuple[float, float]:
    """Factors that the printed sigma points put on mean and variance; (1, 1) would be right.

    Points phi, phi +- sqrt(sigma P) with the weights of N: sigma/(N + sigma) + 2 n/(2 N + 2 sigma)
    and 2 sigma/(2 N + 2 sigma). With one unknown and N = 3, sigma = 2 they are 0.6 and 0.4.
    """
    return (sigma + unknowns) / (N + sigma), sigma / (N + sigma)


# ---- consistency --------------------------------------------------------------------------------


def drift_variance(q: float, R: float, H: float, dt: float) -> float:
    """Steady variance of phi after a sample, without gamma.

    Proof note: P- - P = q dt with P = P-/(1 + c P-), c = H^2 dt/R: c P-^2 = q dt (1 + c P-).
    """
    before = (q * dt + math.sqrt((q * dt) ** 2 + 4 * q * R / H**2)) / 2
    return before - q * dt


def matched_drift(gamma: float, R: float, H: float, dt: float) -> float:
    """Return the only drift q for which the filter with gamma knows its variance: gamma P/dt.

    Proof note: the steady P does not depend on q, so it is right for one q only. For that one, the
    filter with gamma and the one with drift q have the same steady gain, which is the best.
    """
    return gamma * steady_variance(gamma, R, H, dt) / dt


def expected_nis(gamma: float, R: float, H: float, dt: float, q: float = 0.0) -> float:
    """Mean normalised innovation squared of the filter with gamma on a random walk with drift q.

    It is (2 gamma + rho (1 + gamma))/(gamma (2 + gamma)), rho = q (H dt)^2/R: 2/(2 + gamma) < 1 on
    constant phi, 1 at the matched drift only, and without bound beyond. Proof note: in units of
    sqrt(R dt) the error before a sample obeys x+ = x/(1 + gamma) - K n + w, var n = 1, var w = rho.
    The innovation is x + n, and the filter takes 1 + gamma for its variance, whatever q.
    """
    rho = q * (H * dt) ** 2 / R
    return (2 * gamma + rho * (1 + gamma)) / (gamma * (2 + gamma))


def innovation_correlation(gamma: float, R: float, H: float, dt: float, q: float = 0.0) -> float:
    """Correlation of successive innovations of that filter; 0 at the matched drift only.

    Proof note: with V = var x = (K^2 + rho)/(1 - a^2), a = 1/(1 + gamma), it is
    (a V - K)/(V + 1), and a^(j-1) times that over j samples.
    """
    rho, a, K = q * (H * dt) ** 2 / R, pole(gamma), gain(gamma)
    V = (K**2 + rho) / (1 - a**2)
    return (a * V - K) / (V + 1)


def nis_band(samples: int, measurements: int = 1, level: float = 0.95) -> tuple[float, float]:
    """Band in which the mean normalised innovation squared of a consistent filter lies.

    Proof note: innovations are independent and normal with the variance that the filter states, so
    the sum over the samples is chi-squared with samples * measurements degrees of freedom.
    """
    from scipy.special import gammaincinv  # scipy.stats takes a second to import

    freedom = samples * measurements
    low, high = (
        2 * gammaincinv(freedom / 2, q) / samples for q in ((1 - level) / 2, (1 + level) / 2)
    )
    return float(low), float(high)


def white_band(samples: int, level: float = 0.95) -> float:
    """Largest |correlation| between white innovations, at one lag: normal, variance 1/samples."""
    from scipy.special import ndtri

    return float(ndtri((1 + level) / 2)) / math.sqrt(samples)
