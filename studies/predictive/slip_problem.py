"""The slip problem that solvers are measured on: one driven axle, a horizon, three rails.

Traction of one driven axle behind a motor lag, horizon 20 x 20 ms, 250 steps over three rails. The
reference costs are 29.031 where the controller knows the adhesion, and with an adhesion ten steps
late and 15 % high 932.15 for one real-time iteration, 843.85 converged. They count the state that
each step reaches.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from casadi import sqrt

from slipctl import Block, Input, Output, Param, State, flow, law, nmpc, sampled
from slipctl.predict.trials import Driver

TRACTION = dict(positive="traction", per="ratio")


@flow(s=Output("1", "slip", **TRACTION))
def axle(
    v=State("m/s", 10.0, "vehicle speed"),
    q=State("m/s", 10.05, "rim speed"),
    T=State("kN m", 1.0, "torque"),
    xi=State("s", 0.0, "integral of the slip error"),
    u=Input("kN m", "torque command", value=1.0, lo=0, hi=8),
    mu_p=Input("1", "peak adhesion", value=0.3),
    s_ref=Input("1", "slip reference", value=0.02, **TRACTION),
    r=Param("m", 0.45, "radius"),
    J=Param("kg m^2", 120.0, "inertia"),
    m_q=Param("kg", 5000.0, "load"),
    tau=Param("s", 0.05, "lag"),
    g=Param("m/s^2", 9.81, "gravity"),
):
    """Driven axle behind a motor lag: the problem that solvers are measured on."""
    s = (q - v) / sqrt(v**2 + 0.25)
    k = s / 0.025
    mu = mu_p * 2 * k / (1 + k**2)
    rim = r * (1000 * T - r * mu * m_q * g) / J
    return dict(v=mu * g, q=rim, T=(u - T) / tau, xi=s - s_ref), dict(s=s)


@law(e_s=Output("1"), e_xi=Output("s"), e_u=Output("kN m"))
def cost(
    s=Input("1", "slip", **TRACTION),
    s_ref=Input("1", "slip reference", **TRACTION),
    xi=Input("s", "integral of the slip error"),
    u=Input("kN m", "torque command"),
    T=Input("kN m", "torque"),
):
    """Slip error, its integral, and the torque still to come."""
    return dict(e_s=s - s_ref, e_xi=xi, e_u=u - T)


WEIGHTS = {"e_s": 100.0, "e_xi": 5.0, "e_u": 0.05}
PEAKS = np.r_[np.full(60, 0.30), np.full(100, 0.12), np.full(90, 0.25)]


def make(**options: Any) -> Block:
    """Controller of the problem; other options of ``nmpc`` as given."""
    return nmpc(axle, cost, "u", **{"h": 0.02, "weights": WEIGHTS, "substeps": 4, **options})


def closed_loop(
    block: Block, mismatch: bool = False, ticks: int = 250
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Cost of the run, controls, statuses and passes; the cost is that of the states reached."""
    plant, tick = sampled(axle, 0.02, "rk4", 4).f, Driver(block)
    p = axle.pack("param", axle.param_values())
    x, total, rows = np.array([10, 10.05, 1.0, 0.0]), 0.0, []
    for k in range(ticks):
        known = 1.15 * PEAKS[max(k - 10, 0)] if mismatch else PEAKS[k]
        u, status, passes, _ = tick(*x, known, 0.02)
        x = np.array(plant(x, [u, PEAKS[k], 0.02], p)[0]).ravel()
        slip = (x[1] - x[0]) / math.sqrt(x[0] ** 2 + 0.25)
        total += (100 * (slip - 0.02)) ** 2 + (5 * x[3]) ** 2 + (0.05 * (u - x[2])) ** 2
        rows.append((u, status, passes))
    return total, *np.array(rows).T


def recorded(block: Block) -> np.ndarray:
    """Inputs of the controller over the nominal closed loop, one row per step."""
    plant, tick = sampled(axle, 0.02, "rk4", 4).f, Driver(block)
    p = axle.pack("param", axle.param_values())
    x, rows = np.array([10, 10.05, 1.0, 0.0]), []
    for peak in PEAKS:
        rows.append([*x, peak, 0.02])
        u = tick(*rows[-1])[0]
        x = np.array(plant(x, [u, peak, 0.02], p)[0]).ravel()
    return np.array(rows)
