"""The loop `sta` of subway_braking by hand: in plain Python floats, and in numpy arrays."""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

P = dict(
    c=1.0, a=0.54, b=1.2, k0=150.0, k1=5.0, k2=0.35, kappa=0.0, lr=200.0, lt=136.0, kc=0.6,
    m=8000.0, J=240.0, r=0.5, g=9.81, omega0=0.1, T_max=20e3, K1=20.0, K2=10.0, T=1e-3,
    share=0.5, v_off=1.0, T_low=4e3,
)  # fmt: skip
"""Parameters in the order of the struct in subway_loop.c, SI units."""


def run_floats(ticks: int, v_opt: float) -> list[tuple[float, ...]]:
    """Run in plain floats; returns the logged states and outputs of each tick."""
    q = P
    c, a, b, k0, k1, k2 = q["c"], q["a"], q["b"], q["k0"], q["k1"], q["k2"]
    m, J, r, g, omega0 = q["m"], q["J"], q["r"], q["g"], q["omega0"]
    T, h = q["T"], q["T"] / 10
    W = q["kc"] * q["kappa"] * min(1, q["lr"] / q["lt"]) * m * g

    def rate(v: float, omega: float, T_b: float) -> tuple[float, float, float, float]:
        vs = v - r * omega
        F = c * (exp(-a * vs) - exp(-b * vs)) * m * g
        f = k0 + k1 * v + k2 * v * v
        fade = min(1, max(-1, omega / omega0))
        return v, -(F + f + W) / m, (r * F - T_b * fade) / J, omega

    x, v, omega, phi, u_sw = 0.0, 20.0, 40.0, 0.0, 0.0
    log = []
    for _ in range(ticks):
        vs = v - r * omega
        mu = c * (exp(-a * vs) - exp(-b * vs))
        F = mu * m * g
        f = k0 + k1 * v + k2 * v * v
        v_ref = min(v_opt, q["share"] * max(v, 0))
        T_eq = -(J / r) * (-(F + f + W) / m - F * r * r / J)
        s = vs - v_ref
        sg = (s > 0) - (s < 0)
        wanted = T_eq + (J / r) * (-q["K1"] * sqrt(abs(s)) * sg + u_sw)
        T_dem = r * (m * 10.0 - f - W) + J * 10.0 / r
        awake = v >= q["v_off"]
        top = max(0, min(T_dem, q["T_max"] if awake else q["T_low"]))
        T_b = min(top, max(0, wanted) if awake else top)
        log.append((x, v, omega, phi, u_sw, vs, F, mu, f, W, T_b, v_ref, T_eq, wanted, s, top))
        if 0 <= wanted <= top:
            u_sw -= T * q["K2"] * sg
        for _ in range(10):
            a1, b1, c1, d1 = rate(v, omega, T_b)
            a2, b2, c2, d2 = rate(v + h / 2 * b1, omega + h / 2 * c1, T_b)
            a3, b3, c3, d3 = rate(v + h / 2 * b2, omega + h / 2 * c2, T_b)
            a4, b4, c4, d4 = rate(v + h * b3, omega + h * c3, T_b)
            x += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            v += h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
            omega += h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
            phi += h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    return log


def run_numpy(ticks: int, v_opt: float) -> np.ndarray:
    """Run with the state as a numpy array, as a textbook script does it."""
    q = P
    m, J, r, g = q["m"], q["J"], q["r"], q["g"]
    T, h = q["T"], q["T"] / 10
    W = q["kc"] * q["kappa"] * np.minimum(1, q["lr"] / q["lt"]) * m * g

    def rate(x: np.ndarray, T_b: float) -> np.ndarray:
        vs = x[1] - r * x[2]
        F = q["c"] * (np.exp(-q["a"] * vs) - np.exp(-q["b"] * vs)) * m * g
        f = q["k0"] + q["k1"] * x[1] + q["k2"] * x[1] ** 2
        fade = np.clip(x[2] / q["omega0"], -1, 1)
        return np.array([x[1], -(F + f + W) / m, (r * F - T_b * fade) / J, x[2]])

    x, u_sw = np.array([0.0, 20.0, 40.0, 0.0]), 0.0
    log = np.empty((ticks, 16))
    for k in range(ticks):
        vs = x[1] - r * x[2]
        mu = q["c"] * (np.exp(-q["a"] * vs) - np.exp(-q["b"] * vs))
        F = mu * m * g
        f = q["k0"] + q["k1"] * x[1] + q["k2"] * x[1] ** 2
        v_ref = np.minimum(v_opt, q["share"] * np.maximum(x[1], 0))
        T_eq = -(J / r) * (-(F + f + W) / m - F * r**2 / J)
        s = vs - v_ref
        wanted = T_eq + (J / r) * (-q["K1"] * np.sqrt(np.abs(s)) * np.sign(s) + u_sw)
        T_dem = r * (m * 10.0 - f - W) + J * 10.0 / r
        awake = x[1] >= q["v_off"]
        top = np.maximum(0, np.minimum(T_dem, q["T_max"] if awake else q["T_low"]))
        T_b = np.minimum(top, np.maximum(0, wanted) if awake else top)
        log[k] = (*x, u_sw, vs, F, mu, f, W, T_b, v_ref, T_eq, wanted, s, top)
        if 0 <= wanted <= top:
            u_sw -= T * q["K2"] * np.sign(s)
        for _ in range(10):
            r1 = rate(x, T_b)
            r2 = rate(x + h / 2 * r1, T_b)
            r3 = rate(x + h / 2 * r2, T_b)
            r4 = rate(x + h * r3, T_b)
            x = x + h / 6 * (r1 + 2 * r2 + 2 * r3 + r4)
    return log
