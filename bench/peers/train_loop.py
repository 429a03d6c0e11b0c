"""The train of hst_traction under a speed follower: ours, and the same loop in numpy arrays.

Both run 533 s on the surfaces of Table 2 on a grid of 1 ms, with the motors as lags. The numpy
program holds the 32 axles in arrays and does the same work per tick. Creep law and slope of all
axles are evaluated where a tick begins, where it ends, and again only where a residual is left.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, Rail, Scenario, Section, connect, law, simulate
from slipctl.models.wang_2025.hst_traction import DISTINCT, GROUPED, plant
from slipctl.models.wheel_rail.axle_forces import TOLERANCE
from slipctl.models.wheel_rail.axles import Axles
from slipctl.models.wheel_rail.contact import SURFACES, polach
from slipctl.run import build

RAIL = (("dry", 0.0), ("ice", 115.0), ("oily", 120.0), ("wet", 170.0), ("damp", 320.0))
DURATION, H, GAIN = 533.0, 1e-3, 2e5


def wanted(t: Any) -> Any:
    """Speed to follow in m/s: up to 35 m/s, held, and down to standstill."""
    return np.interp(t, [0, 150, 370, 530, 533], [0, 35, 35, 0, 0])


@law(F_contr=Output("N", "commanded force", positive="traction"))
def follower(
    v=Input("m/s", "train speed"),
    v_d=Input("m/s", "wanted speed"),
    k=Param("N s/m", GAIN, "gain"),
):
    """Speed follower, F = k (v_d - v)."""
    return k * (v_d - v)


def loop(axles: Axles) -> Block:
    """Train and follower."""
    wires = {"ctl.v": "plant.train.v", "ctl.v_d": "v_d", "plant.F_contr": "ctl.F_contr"}
    return connect("loop", wires, plant=plant(axles=axles, h=H), ctl=follower)


def run(axles: Axles, seconds: float = DURATION) -> Any:
    """Simulate; a row is kept every 0.1 s."""
    rail = Rail([Section(start, name) for name, start in RAIL if start < seconds])
    scenario = Scenario("speed", seconds, rail, inputs={"v_d": wanted})
    return simulate(loop(axles), scenario, every=100, log=("plant.train.v", "plant.train.v_s"))


class Peer:
    """The loop in numpy; states are attributes, :meth:`run` advances them."""

    def __init__(self) -> None:
        n = len(DISTINCT)
        self.x, self.v, self.omega = 0.0, 0.0, np.zeros(n)
        self.F_m, self.p, self.q = np.zeros(10), 0.0, 0.0
        self.motors = np.array(DISTINCT.motors)
        self.KEPS = float(polach.param_values()["KEPS"])

    def law(self, s: np.ndarray, v: float) -> tuple[np.ndarray, np.ndarray]:
        """Polach's adhesion and its slope."""
        k_A, k_S, A, B, mu_0 = self.surface
        fall = (1 - A) * mu_0 * np.exp(-B * np.abs(s))
        mu_vf = fall + A * mu_0
        by_s = self.KEPS / max(abs(v), 1.0) / mu_vf
        a, b = k_A * by_s * s, k_S * by_s * s
        one = 1 + a * a
        shape = a / one + np.arctan(b)
        falling = -B * fall * np.sign(s)
        rise = (k_A * (2 - one) / one**2 + k_S / (1 + b * b)) * by_s * (1 - s * falling / mu_vf)
        return 2 / np.pi * mu_vf * shape, 2 / np.pi * (falling * shape + mu_vf * rise)

    def sweep(self, s: np.ndarray, v_next: float, free: np.ndarray, k: float, hold: float) -> Any:
        """Forces of all axles, residual, and the next creeps and speed."""
        beta, N, by_mass = free - v_next, 153125.0, H / 500e3
        s = np.clip(s, beta - N / k, beta + N / k)
        locked = hold * s < -hold * v_next
        s = np.where(locked, -v_next, s)
        mu, slope = self.law(s, self.v)
        F, slope = N * mu, N * np.maximum(slope, 0)
        left = np.where(locked, 0, k * (s - beta) + F)
        move, slide = -left / (k + slope), np.where(locked, 1, k / (k + slope))
        error = self.v + by_mass * (F.sum() - self.F_d) - v_next
        worst = max(np.abs(left).max(), k * abs(error))
        expected = (F + slope * move).sum()
        error = self.v + by_mass * (expected - self.F_d) - v_next
        change = error / (1 + by_mass * (slope * slide).sum())
        return F, locked, worst, s + move - slide * change, v_next + change

    def brake(self, p_ref: float) -> None:
        """One step of RK4 of cylinder and pressure loop."""

        def rate(p: float, q: float) -> tuple[float, float]:
            e = p_ref - p
            u = 4 * e + q
            u_lim = min(max(u, 0.0), 450e3)
            return (u_lim - p) / 0.4, 10 * e + (u_lim - u) / 0.4

        p, q = self.p, self.q
        a1, b1 = rate(p, q)
        a2, b2 = rate(p + H / 2 * a1, q + H / 2 * b1)
        a3, b3 = rate(p + H / 2 * a2, q + H / 2 * b2)
        a4, b4 = rate(p + H * a3, q + H * b3)
        self.p = p + H / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        self.q = q + H / 6 * (b1 + 2 * b2 + 2 * b3 + b4)

    def run(self, ticks: int, first: int = 0) -> np.ndarray:
        """Advance; returns the speed of the train at each tick."""
        r, J, B_t, N = 0.445, 93.75, 0.01, 153125.0
        v_d = wanted(np.arange(first, first + ticks) * H)
        starts = [round(t / H) for _, t in RAIL]
        a, z, speeds = J / H + B_t, H / 0.05, np.empty(ticks)
        decay = 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24
        k = a / r**2
        for i in range(ticks):
            name = RAIL[int(np.searchsorted(starts, first + i, side="right")) - 1][0]
            self.surface = tuple(SURFACES[name][c] for c in ("k_A", "k_S", "A", "B", "mu_0"))
            v, omega = self.v, self.omega
            speeds[i] = v
            F_contr = GAIN * (v_d[i] - v)
            V = 3.6 * v
            self.F_d = (6.796 + 0.062 * V + 0.00143 * V**2) * 500 * min(1, max(-1, v / 0.01))
            top = 5.5e6 / np.maximum(r * omega[self.motors], 5.5e6 / 302e3) / 10
            T = np.zeros(omega.size)
            T[self.motors] = r * np.minimum(self.F_m, top)
            side = np.where(omega == 0, np.sign(v), np.sign(omega))
            stop = side * (15e3 / 450e3 * self.p * r)
            free = r / a * (J / H * omega + T - stop)
            hold = np.sign(stop)
            s, v_next = r * omega - v, v
            for _ in range(40):
                F, locked, worst, s, v_next = found = self.sweep(s, v_next, free, k, hold)
                if _ and worst <= TOLERANCE * N:
                    break
            F, locked = found[:2]
            self.omega = np.where(locked, 0, (J / H * omega + T - stop - r * F) / a)
            self.v = v + H * (F.sum() - self.F_d) / 500e3
            self.x += H * (v + self.v) / 2
            command = np.maximum(0, np.minimum(max(F_contr, 0) / 10, top))
            self.F_m = command + (self.F_m - command) * decay
            self.brake(min(max(-F_contr, 0) / 32 / (15e3 / 450e3), 450e3))
        return speeds


def bench(seconds: float = DURATION, pairs: int = 5) -> dict[str, Any]:
    """Speed of 32 distinct axles and of two groups, and of numpy."""
    found: dict[str, Any] = {}
    for name, axles in (("distinct", DISTINCT), ("grouped", GROUPED)):
        run(axles, 0.2)  # compiled once
        t0 = time.process_time()
        log = run(axles, seconds)
        spent = time.process_time() - t0
        found[f"{name}_real_time"] = {"ratio": seconds / spent, "ours_s": spent}
    rollers = {name: _rolling(axles) for name, axles in
               (("distinct", DISTINCT), ("grouped", GROUPED))}  # fmt: skip
    few, rows = 1500, []
    for _ in range(pairs):
        peer = Peer()
        t0 = time.process_time()
        speeds = peer.run(few)
        t1 = time.process_time()
        ours = rollers["distinct"](few)
        t2 = time.process_time()
        for _ in range(5):
            rollers["grouped"](few)
        rows.append((t1 - t0, t2 - t1, (time.process_time() - t2) / 5))
    numpy_s, distinct_s, grouped_s = (float(np.median(c)) for c in zip(*rows, strict=True))
    found["numpy_vs_ours"] = {
        "ratio": float(np.median([a / b for a, b, _ in rows])), "ours_s": distinct_s,
        "peer_s": numpy_s, "largest_speed_difference": float(np.abs(ours - speeds).max()),
    }  # fmt: skip
    found["distinct_vs_grouped"] = {
        "ratio": float(np.median([b / c for _, b, c in rows])), "distinct_s": distinct_s,
        "grouped_s": grouped_s,
    }  # fmt: skip
    found["final_speed"] = float(log["plant.train.v"][-1])
    return found


def _rolling(axles: Axles) -> Any:
    """Call that runs some ticks from the start and gives the speed at each."""
    block = loop(axles)
    roller = build.compile_roller(block.f)
    assert roller is not None
    x0 = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    at = next(i for i, n in enumerate(_elements(block)) if n == "plant.train.v")

    def call(ticks: int) -> np.ndarray:
        u = np.ascontiguousarray(wanted(np.arange(ticks) * H)[:, None])
        x_log, y_log = np.empty((ticks, x0.size)), np.empty((ticks, block.f.size1_out(1)))
        roller.roll(x0.copy(), u, p, x_log, y_log)
        return x_log[:, at]

    return call


def _elements(block: Block) -> list[str]:
    """Name of the state of each element of the packed states."""
    return [n for n, s in block.states.items() for _ in range(s.size)]
