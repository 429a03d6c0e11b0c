"""Adversary of the seeker with a dither: the loop on its parabola, tick by tick.

What is heard is late by a dead time in ticks, then follows by 1 - exp(-T/lag) per tick; before the
start the dither alone has run for 60 lags. Noises tried: those that push th outward or inward, and
those that push xi the way it goes, so that its swings build up.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator
from fractions import Fraction
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def draw(rng: np.random.Generator, n: int) -> Cases:
    """w 1 to 20 rad/s, corners w/20 to w/6, averaged natural frequency^2 0.15 to 1 w_l^2.

    a 0.05 to 0.5, curvature -0.05 to -1, start 0.1 to 1 a, 12 to 30 ticks to a period; one in ten
    flees (k < 0). A third has a dead time of up to 0.3 rad of the dither, a third such a lag, a
    third a noise of up to 1 % of |c| a^2.
    """
    w = common.log_uniform(rng, 1, 20, n)
    w_l, w_h = w / common.log_uniform(rng, 6, 20, n), w / common.log_uniform(rng, 6, 20, n)
    a, c = common.log_uniform(rng, 0.05, 0.5, n), -common.log_uniform(rng, 0.05, 1, n)
    k = 2 * w_l * common.log_uniform(rng, 0.15, 1, n) / (a * -c)
    k = k * np.where(rng.random(n) < 0.9, 1, -1)
    T = 2 * np.pi / w / rng.integers(12, 30, n)
    late, lag = common.log_uniform(rng, 0.02, 0.3, (2, n)) / w
    noise = common.log_uniform(rng, 1e-4, 1e-2, n) * -c * a**2
    late, lag, noise = (np.where(rng.random(n) < 1 / 3, v, 0.0) for v in (late, lag, noise))
    return {"k": k, "w": w, "w_l": w_l, "w_h": w_h, "a": a, "curvature": c, "T": T,
            "noise": noise, "dead_time": late, "lag": lag,
            "start": a * common.log_uniform(rng, 0.1, 1, n)}  # fmt: skip


class _Heard:
    """What is heard of the value, one entry per case."""

    def __init__(self, n: Cases, th: np.ndarray) -> None:
        T = n["T"]
        # of a decimal as it is typed, so that three ticks are three
        self.late = np.ceil(n["dead_time"] / T * (1 - 1e-12)).astype(int)
        self.E = np.exp(-T / np.where(n["lag"] > 0, n["lag"], 1.0)) * (n["lag"] > 0)
        self.line = [np.zeros_like(T)] * (int(self.late.max(initial=0)) + 1)
        before = int(60 * float((n["lag"] / T).max(initial=0))) + len(self.line)
        self.y = n["curvature"] / 2 * th**2
        for i in range(before, 0, -1):
            self.at(n["curvature"] / 2 * (th - n["a"] * np.sin(n["w"] * T * i)) ** 2)

    def at(self, y: np.ndarray) -> np.ndarray:
        self.line = [y, *self.line[:-1]]
        old = self.line[0]
        for late in range(1, len(self.line)):
            old = np.where(self.late == late, self.line[late], old)
        self.y = old + self.E * (self.y - old)
        return self.y


BUILDS_UP = 2.0
"""Noise that pushes xi the way it goes; 1 is outward, 0 none."""


def _run(n: Cases, share: float, ticks: int, loud: float) -> tuple[np.ndarray, np.ndarray]:
    """Largest |th - v*| of all ticks, and of the last three periods; of a swing that builds up from
    the peak that of the last third, less what may be left of its start there.
    """
    T, c = n["T"], n["curvature"] / 2
    far = np.where(np.isnan(n["start"]), n["a"], n["start"]) if "start" in n else n["a"]
    th, xi = share * far, np.zeros_like(T)
    n = n | {k: np.nan_to_num(n.get(k, 0 * T)) for k in ("noise", "dead_time", "lag")}
    heard, side = _Heard(n, th), np.sign(share * n["k"])
    eta, phase = c * th * th, np.zeros_like(T)
    most, last = np.abs(th), np.zeros_like(T)
    tail = int(3 * 2 * np.pi / float((n["w"] * T).min()))
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(ticks):
            s = np.sin(phase)
            pushed = s * (xi if loud == BUILDS_UP else side)
            noise = (loud != 0) * n["noise"] * np.where(pushed > 0, 1, -1)
            high = heard.at(c * (th + n["a"] * s) ** 2) - eta + noise
            th, xi, eta = (th + T * n["k"] * xi, xi + T * n["w_l"] * (high * s - xi),
                           eta + T * n["w_h"] * high)  # fmt: skip
            phase = np.mod(phase + n["w"] * T, 2 * np.pi)
            size = np.abs(th)
            size[np.isnan(size)] = np.inf
            most = np.maximum(most, size)
            if i >= ticks - tail:
                last = np.maximum(last, size)
            elif loud == BUILDS_UP and 3 * i >= 2 * ticks:
                last = np.maximum(last, np.where(n["noise"] > 0, size * (1 - 1e-3), 0.0))
    return most, last


def _search(n: Cases, effort: int) -> tuple[np.ndarray, np.ndarray]:
    natural = np.abs(n["k"] * n["curvature"]) * n["a"] * n["w_l"] / 2
    slow = np.minimum(natural / n["w_l"], n["w_l"] / 2)
    ticks = int((14 / slow / n["T"]).max()) + 200
    ways = ((1.0, 1.0), (0.0, BUILDS_UP), (-1.0, 1.0), (0.3, 0.0))[: 1 + effort]
    found = [_run(n, share, min(ticks, 12_000), loud) for share, loud in ways]
    return np.max([f[0] for f in found], 0), np.max([f[1] for f in found], 0)


def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """It goes farther than was asked, or rests farther out, or runs away."""
    most, last = _search(n, effort)
    far = np.where(np.isnan(n["start"]), n["a"], n["start"]) if "start" in n else n["a"]
    out = most > 10 * np.maximum(far, n["a"])
    for name, value in (("reach", most), ("rest", last)):
        if name in n:
            out |= value > np.where(np.isnan(n[name]), np.inf, n[name]) * (1 + 1e-9)
    return out


def _ticks(n: dict[str, float], th: float) -> Generator[tuple[float, float], float, None]:
    """One seeker in floats; gives its phase and th, and takes the noise of the next tick."""
    k, w, w_l, w_h, a, c, T = (n[x] for x in ("k", "w", "w_l", "w_h", "a", "curvature", "T"))
    late, lag = math.ceil(n.get("dead_time", 0.0) / T * (1 - 1e-12)), n.get("lag", 0.0)
    E, xi, eta = math.exp(-T / lag) if lag else 0.0, 0.0, c / 2 * th * th
    before = int(60 * lag / T) + late
    heard, line = eta, deque([eta] * late)
    for i in range(-before, 10**7):
        s = math.sin(w * T * i)
        line.append(c / 2 * (th + a * s) ** 2)
        y = line.popleft()
        heard = y + E * (heard - y)
        if i < 0:  # the dither alone
            continue
        high = heard - eta + (yield math.fmod(w * T * i, 2 * math.pi), th)
        th, xi, eta = th + T * k * xi, xi + T * w_l * (high * s - xi), eta + T * w_h * high


def replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """The run of the file, in floats; on its orbit from near the peak."""
    run, clause = counterexample["run"], counterexample["clause"]
    first = float(Fraction(run["start"])) if "start" in run else min(n.get("start", 1e9), n["a"])
    th = first if "start" in run else first / 100
    limit = n.get(clause, 10 * max(n.get("start", n["a"]), n["a"]))
    loop = _ticks(n, th)
    phase, th = next(loop)
    if counterexample["by"] == "pushed":
        return _pushed(n, loop, run) > limit * (1 - PHASE)
    noise = n.get("noise", 0.0) if run.get("noise") == "outward" else 0.0
    side = th * n["k"]
    for _ in range(run["ticks"]):
        phase, th = loop.send(noise if math.sin(phase) * side > 0 else -noise)
    return abs(th) > limit * (1 - 1e-9)


PHASE = 5e-3
"""What may be missed where the phase is that of the file to 2 pi/3000 and the orbit to e^-8."""


def _pushed(n: dict[str, float], loop: Any, run: dict[str, Any]) -> float:
    """|th - v*| after the noise of the file, which starts on the orbit at the phase of the file."""
    natural = abs(n["k"] * n["curvature"]) * n["a"] * n["w_l"] / 2
    slow = min(natural / n["w_l"], n["w_l"] / 2)
    wanted, settled = float(run["angle"]) % (2 * math.pi), math.ceil(8 / slow / n["T"])
    step = n["w"] * n["T"]
    off = [abs(math.remainder(step * (settled + i) - wanted, 2 * math.pi)) for i in range(3000)]
    for _ in range(settled + off.index(min(off))):
        loop.send(0.0)
    th = 0.0
    for sign in run["noise"]:
        _, th = loop.send(n["noise"] if sign == "+" else -n["noise"])
    return abs(th)


ADVERSARY = Adversary(
    "perturbation_seek", draw, ("rest", "reach"), leaves, replays,
    grows={"rest": False, "reach": False},
    swing={"rest": lambda n, rng: np.minimum(_search(n, 1)[1], 10 * n["a"]),
           "reach": lambda n, rng: np.minimum(_search(n, 1)[0], 10 * n["a"])},
)  # fmt: skip
