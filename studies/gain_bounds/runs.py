"""Lyapunov functions of the papers' proofs along runs of their error equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.models.cheng_2022.certificate import barrier as bounds
from slipctl.models.cheng_2022.certificate import sliding_seeker
from slipctl.models.huang_2020.certificate import reaching_law
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.wang_2025.certificate import adhesion_observer, higher_order
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc

Rates = Callable[[np.ndarray, float], np.ndarray]


@dataclass(frozen=True)
class Run:
    """A Lyapunov function along a run.

    Attributes:
        name: of the system. source: where the proof stands.
        t: times in s. V, rate: the function and its derivative by the chain rule.
        where: samples at which the proof says that it falls.
        says: that, in words. d: disturbance, held from sample to sample.
    """

    name: str
    source: str
    t: np.ndarray
    V: np.ndarray
    rate: np.ndarray
    where: np.ndarray
    says: str
    d: np.ndarray

    def falls(self) -> float:
        """Share of the samples, where the proof says so, at which it falls."""
        return float((self.rate[self.where] < 0).mean())

    def deviation(self) -> float:
        """Largest difference of V' and the slope of V between samples, over the largest V'.

        Slopes are taken where the sliding variable is not about to cross zero.
        """
        middle = (self.rate[1:] + self.rate[:-1]) / 2
        slope = np.diff(self.V) / np.diff(self.t)
        smooth = self.where[1:] & self.where[:-1]
        smooth &= np.abs(self.rate[1:] - self.rate[:-1]) < 0.1 * np.abs(middle)
        smooth &= self.d[1:] == self.d[:-1]
        return float(np.abs(slope - middle)[smooth].max() / np.abs(middle)[smooth].max())


def integrate(
    rates: Rates, start: list[float], disturbance: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Runge-Kutta with the disturbance held over a step; times and states, one row per step."""
    x, rows = np.array(start, float), []
    for d in disturbance:
        rows.append(x)
        a = rates(x, d)
        b = rates(x + step / 2 * a, d)
        c = rates(x + step / 2 * b, d)
        e = rates(x + step * c, d)
        x = x + step / 6 * (a + 2 * b + 2 * c + e)
    return step * np.arange(len(rows)), np.array(rows)


def shaking(bound: float, n: int, hold: int, seed: int) -> np.ndarray:
    """Disturbance that jumps between random values, a third of them the bounds."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-bound, bound, n // hold + 1)
    levels[::3] = bound * rng.choice([-1.0, 1.0], len(levels[::3]))
    return np.repeat(levels, hold)[:n]


def reaching(n: int) -> Run:
    """Reaching law with the printed gains, |d| up to 10 of 12 m/s^2."""
    d = shaking(10.0, n, n // 40, 1)
    t, x = integrate(lambda s, d: -36 * s - 12 * np.sign(s) + d, [1.2], d, 0.4 / n)
    s = x[:, 0]
    V, rate = reaching_law.lyapunov(s, d, 36.0, 12.0)
    return Run("reaching law", "law (23), no proof printed", t, V, rate, np.abs(s) > 1e-4,
               "V' < 0 for s != 0, |d| < g2", d)  # fmt: skip


def twisting(n: int) -> Run:
    """Super-twisting of subway_braking, 20 and 10, |d| up to 9 m/s^3, within (48)."""
    d = shaking(9.0, n, n // 30, 2)

    def rates(x: np.ndarray, d: float) -> np.ndarray:
        s = np.sign(x[0])
        return np.array([-20 * np.sqrt(abs(x[0])) * s + x[1], -10 * s + d])

    t, x = integrate(rates, [1.2, 0.0], d, 0.3 / n)
    V, rate = sta.lyapunov(x[:, 0], x[:, 1], d, 20.0, 10.0)
    return Run("super-twisting", "Huang 2020 (44)-(48)", t, V, rate, np.abs(x[:, 0]) > 1e-4,
               "V' < 0 for x1 != 0 where (48) holds", d)  # fmt: skip


def funnel(n: int) -> Run:
    """Prescribed performance with the printed gains, |w| at 97 % of what it holds."""
    K1, width, W = 100.0, 0.006, 0.26
    w = shaking(W, n, n // 5, 3)

    def rates(z: np.ndarray, w: float) -> np.ndarray:
        return -K1 * (1 - z**2) * np.arctanh(z) + w / width

    t, x = integrate(rates, [0.72], w, 0.02 / n)
    z = x[:, 0]
    load = W / (K1 * width)
    inside = (np.abs(z) > ppc.settled_share(load)) & (np.abs(z) < ppc.recoverable(load))
    V, rate = ppc.lyapunov(z, w, K1, width)
    return Run("prescribed performance", "Zhang 2021 (35)-(38)", t, V, rate, inside,
               "V' < 0 between settled and recoverable error", w)  # fmt: skip


def observer(n: int) -> Run:
    """Adhesion observer, K1 = 98.5, K2 = 4400, K3 = 0.5, |f'| up to 2000 rad/s^3."""
    K1, K2, K3, L = 98.5, 4400.0, 0.5, 2000.0
    P = sta.quadratic_matrix(K1, K2 / 2, L, math.sqrt(K2**2 / 4 - L**2))
    d = shaking(L, n, n // 30, 4)

    def rates(x: np.ndarray, d: float) -> np.ndarray:
        root, s = np.sqrt(abs(x[0])), np.sign(x[0])
        phi1 = (root + K3 * root**3) * s
        phi2 = (0.5 + 2 * K3 * root**2 + 1.5 * K3**2 * root**4) * s
        return np.array([x[1] - K1 * phi1, -K2 * phi2 + d])

    t, x = integrate(rates, [4.0, 100.0], d, 0.15 / n)
    V, rate = adhesion_observer.lyapunov(x[:, 0], x[:, 1], d, K1, K2, K3, P)
    return Run("adhesion observer", "Wang 2025, Theorem 1", t, V, rate, np.abs(x[:, 0]) > 1e-4,
               "V' < 0 for e != 0", d)  # fmt: skip


def adaptive(n: int) -> Run:
    """Adaptive law, k4 = 0.25, with the largest eta that (49) certifies there."""
    alpha, beta, eta = higher_order.best(0.25)
    wanted, sigma = 0.25, 1e-3
    d = shaking(0.99 * eta, n, n // 20, 5)
    share = 2 * alpha / (1 + 4 * beta**2)

    def rates(x: np.ndarray, d: float) -> np.ndarray:
        root, s = np.sqrt(abs(x[0])), np.sign(x[0])
        phi1, phi2 = (root + root**2) * s, (0.5 + 1.5 * root + root**2) * s
        grow = phi1 * phi2 * share if abs(x[0]) > sigma else 0.0
        return np.array([-x[2] * phi1 + x[1], -2 * beta * x[2] * phi2 + d, grow])

    t, x = integrate(rates, [2.0, 0.0, 0.3], d, 8.0 / n)
    s, v, k = x.T
    k_rate = np.array([rates(a, b)[2] for a, b in zip(x, d, strict=True)])
    V, rate = higher_order.lyapunov(s, v, d, k, k_rate, wanted, alpha, beta)
    return Run("adaptive higher order", "Wang 2025, Theorem 2", t, V, rate, np.abs(s) > sigma,
               "V' < 0 for |s| > sigma where (49) holds", d)  # fmt: skip


def barrier(n: int) -> Run:
    """Barrier law with the printed gains, |w| up to 0.007 of 0.00739 m/s^2."""
    k, k_a, k_s, W = 1200.0, 1.22986, 0.02, 7e-3
    w = np.abs(shaking(W, n, n // 10, 6))
    t, x = integrate(lambda e, w: -2 * k * e * (k_s**2 - e**2) + w, [0.0125], w, 6.0 / n)
    e = x[:, 0]
    V, rate = bounds.lyapunov(e, w, k, k_a, k_s)
    inside = (e > bounds.settled_error(W, k, k_s)) & (e < bounds.recoverable(W, k, k_s))
    return Run("barrier Lyapunov", "Cheng 2022 (43)-(48)", t, V, rate, inside,
               "V' = -2 k e^2 < 0 without w; with it beyond the settled error", w)  # fmt: skip


def seeker(n: int) -> Run:
    """Sliding-mode seeker with rho = 0.1 on the slope 0.3 s/m: a sliding mode exists."""
    k, rho, beta, slope = 1.0, 0.1, 0.02, 0.3

    def rates(x: np.ndarray, _: float) -> np.ndarray:
        return k * slope * np.sign(np.sin(np.pi * x / beta)) - rho

    t, x = integrate(rates, [0.6 * beta], np.zeros(n), 0.06 / n)
    delta = x[:, 0]
    V, rate = sliding_seeker.lyapunov(delta, slope, k, rho, beta)
    # towards beta from below
    away = (np.abs(np.sin(np.pi * delta / beta)) > 0.05) & (delta / beta % 2 > 0.5)
    away &= delta / beta % 2 < 1.5
    return Run("sliding-mode seeker", "Cheng 2022 (25)-(28)", t, V, rate, away,
               "V' < 0 around (2n + 1) beta for k mu' > rho", np.zeros(n))  # fmt: skip


ALL: tuple[Callable[[int], Run], ...] = (
    reaching, twisting, funnel, observer, adaptive, barrier, seeker
)  # fmt: skip


def in_the_loop(log: Any, k1: float = 20.0, k2: float = 10.0) -> Run:
    """Super-twisting in the loop of subway_braking, from its log: x2 = s' + k1 |s|^.5 sgn s.

    Its V' is the slope of V from tick to tick: what the tick does not know (adhesion that moves
    within it, the torque's limits) is in it.
    """
    t, s = log["time"].values, log["ctl.law.s"].values
    T = float(t[1] - t[0])
    x2 = np.diff(s) / T + k1 * np.sqrt(np.abs(s[:-1])) * np.sign(s[:-1])
    s, d = s[:-1], np.zeros(len(x2))
    V, _ = sta.lyapunov(np.where(s == 0, 1e-12, s), x2, d, k1, k2)
    rate = np.append(np.diff(V) / T, 0.0)
    outside = np.abs(s) > (k1 * T) ** 2  # a tick that takes k1 |s|^.5 T does not cross zero there
    return Run(
        "super-twisting in the loop", "Huang 2020 (44)-(48)", t[:-1], V, rate, outside,
        "V falls for |s| > (k1 T)^2, where no tick crosses zero", d,
    )  # fmt: skip


def runs(quick: bool = False) -> list[Run]:
    """All of them."""
    return [make(4_000 if quick else 16_000) for make in ALL]


def sampled_twisting(
    form: str, T: float, phi: Any, k1: float = 1.5, k2: float = 1.1, ticks: int = 6000
) -> float:
    """Largest |x1| over the last third of x1' = u + phi'(t), u sampled by one of three forms.

    It starts near sliding: x2 = 0. The plant is exact, because only the integral phi enters.
    """
    x, v, out = 0.3 * T * T, -(phi(T) - phi(0.0)) / T, []
    for i in range(ticks):
        s = 1.0 if x >= 0 else -1.0
        if form == "explicit":
            u, v = v - k1 * np.sqrt(abs(x)) * s, v - T * k2 * s
        elif form == "implicit":
            c = x + T * v
            if abs(c) <= T * T * k2:
                u = v = -x / T
            else:
                y = (-T * k1 + np.sqrt((T * k1) ** 2 + 4 * (abs(c) - T * T * k2))) / 2
                u, v = (y * y * np.sign(c) - x) / T, v - T * k2 * np.sign(c)
        else:
            y = (np.sqrt((T * k1) ** 2 + 4 * max(0.0, abs(x) - T * T * k2)) - T * k1) / 2
            xi = max(-1.0, min(1.0, x / (T * T * k2)))
            v = v - T * k2 * xi
            u = v - k1 * y * s - T * k2 * xi
        before, after = phi(i * T), phi((i + 1) * T)
        x += T * u + after - before
        if i > 2 * ticks // 3:
            out.append(abs(x))
    return max(out)
