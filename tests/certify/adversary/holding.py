"""Adversaries of the laws that hold an error inside bounds: the funnel and the barrier.

Both are simulated in the letters of their papers, the error e and the delivered command a, tick by
tick. Pushes tried: constant, with the sign of e + x a for several x, square waves of several
periods, random; noise against the push, with it, and turned where the pull is largest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def told(n: Cases, name: str, default: float = 0.0) -> np.ndarray:
    value = n.get(name)
    if value is None:
        return np.full_like(n["T"], default)
    return np.where(np.isnan(value), default, value)


class Loop:
    """State of many runs, (policies, cases)."""

    def __init__(self, n: Cases, share: np.ndarray, standing: bool = False) -> None:
        self.n, self.T, self.standing = n, n["T"], standing
        self.lag, self.noise = told(n, "lag"), told(n, "noise")
        self.left = np.exp(-self.T / np.where(self.lag > 0, self.lag, 1.0)) * (self.lag > 0)
        self.wait = np.minimum(np.ceil(told(n, "dead") / self.T * (1 - 1e-12)), 200).astype(int)
        self.missed, self.pushed = self.lag * (1 - self.left), self.push()
        self.t, self.i = 0.0 * self.T, 0
        low, high = self.bounds()
        self.e = self.place(np.asarray(share), low, high)
        self.a = np.zeros_like(self.e)
        self.line = [np.zeros_like(self.e) for _ in range(int(self.wait.max()) + 1)]
        self.waits = [(int(late), self.wait == late) for late in np.unique(self.wait) if late]
        self.out = np.zeros(self.e.shape, bool)

    def place(self, share: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Error at a share of the bounds, -1 to 1 about the middle."""
        return (low + high) / 2 + share * (high - low) / 2

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        raise NotImplementedError

    def command(self, seen: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def push(self) -> np.ndarray:
        return self.n["W"]

    def tick(self, w: np.ndarray, noise: np.ndarray) -> None:
        """One tick with the disturbance and the noise as shares of their bounds."""
        low, high = self.bounds()
        seen = self.e + noise * self.noise
        self.out |= (seen >= high) | (seen <= low)
        seen = np.where(self.out, (low + high) / 2, seen)
        self.line = [self.command(seen), *self.line[:-1]]
        u = self.line[0]
        for late, those in self.waits:
            u = np.where(those, self.line[late], u)
        behind = self.a - u
        self.e = self.e + self.T * (u + w * self.pushed) + self.missed * behind
        self.a = u + behind * self.left
        self.t, self.i = self.t + self.T, self.i + 1

    def far(self) -> np.ndarray:
        """Share of the bounds, by size."""
        low, high = self.bounds()
        return np.abs((self.e - (low + high) / 2) / ((high - low) / 2))

    def away(self, side: float) -> np.ndarray:
        """Share of the bound of a side, from where the law pulls to."""
        return self.far()


class FunnelLoop(Loop):
    """Zhang 2021 (10)-(17), (34), with the plus sign in (15)."""

    def __init__(self, n: Cases, share: np.ndarray, standing: bool = False) -> None:
        last = n["eta_inf"]
        self.rate = told(n, "k")
        self.fall = np.maximum(told(n, "eta_0"), last) - last
        super().__init__(n, share, standing)

    def eta(self) -> np.ndarray:
        last = self.n["eta_inf"]
        return last if self.standing else last + self.fall * np.exp(-self.rate * self.t)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        eta = self.eta()
        return -self.n["delta_l"] * eta, self.n["delta_u"] * eta

    def command(self, seen: np.ndarray) -> np.ndarray:
        eta, last = self.eta(), self.n["eta_inf"]
        zeta, lower, upper = seen / eta, self.n["delta_l"], self.n["delta_u"]
        eps = np.log((zeta + lower) / (upper - zeta)) / 2
        ell = (1 / (zeta + lower) + 1 / (upper - zeta)) / (2 * eta)
        return -self.n["K1"] * eps / ell - seen * self.rate * (eta - last) / eta

    def push(self) -> np.ndarray:
        n = self.n
        force = told(n, "r") ** 2 * told(n, "F_error") / (told(n, "I_w", 1) * told(n, "v", 1))
        return n["W"] + force + (1 - told(n, "slip")) * told(n, "a") / told(n, "v", 1)


class BarrierLoop(Loop):
    """Cheng 2022 (42), (44), signs put right."""

    def away(self, side: float) -> np.ndarray:
        """From no error, which is not the middle of the bounds."""
        low, high = self.bounds()
        return np.abs(self.e / (high if side > 0 else low))

    def place(self, share: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return np.where(share > 0, share * high, -share * low)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return -self.n["k_a"], self.n["k_s"]

    def command(self, seen: np.ndarray) -> np.ndarray:
        width = np.where(seen < 0, self.n["k_a"], self.n["k_s"])
        return -2 * self.n["k"] * seen * (width**2 - seen**2)


WAYS = [("stay", 0.0), *(("lean", x) for x in (0.0, 0.3, 1.0, 3.0, -0.5)),
        *(("wave", p) for p in (1, 2, 3, 5, 8, 13, 21)), ("random", 0.9)]  # fmt: skip


def attacked(kind: type[Loop], n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """Whether any run leaves, per case."""
    start = told(n, "start", 0.5)
    rows = [(way, side, noise) for way in WAYS for side in (1.0, -1.0) for noise in (-1.0, 0.0)]
    places = rng.uniform(-1, 1, (len(rows), 1)) * np.ones_like(start)
    places[::2] = np.array([side for _, side, _ in rows[::2]])[:, None]
    gone = _run(kind(n, places * start), rows, rng, 50 + 150 * effort)
    for _ in range(effort):
        places = rng.uniform(-1, 1, (len(rows), 1)) * np.ones_like(start)
        gone |= _run(kind(n, places * start), rows, rng, 40)
    if "step" in n:
        gone |= _stepped(kind, n, rng, effort)
    return gone


def _stepped(kind: type[Loop], n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """A step from what the push has reached from the middle, where the funnel stands still."""
    step = told(n, "step")
    rows = [(way, side, -1.0) for way in WAYS[:7] for side in (1.0, -1.0)]
    loop = kind(n, np.zeros((len(rows), len(step))), True)
    _run(loop, rows, rng, 100 * effort)
    loop.e = loop.e + np.sign(loop.e) * step
    return _run(loop, rows, rng, 100 * effort) & (step > 0)


def _run(loop: Loop, rows: list[Any], rng: np.random.Generator, ticks: int) -> np.ndarray:
    side, against, size = (
        np.array(x)[:, None] for x in ([s for _, s, _ in rows], [x for _, _, x in rows],
                                       [float(w[1]) for w, _, _ in rows]))  # fmt: skip
    kinds = np.array([w[0] for w, _, _ in rows])
    lean, wave, wander = (np.flatnonzero(kinds == k) for k in ("lean", "wave", "random"))
    period, reach = size[wave].astype(int), size[lean] * np.maximum(loop.lag, loop.T)
    w = side * np.ones_like(loop.e)
    for i in range(ticks):
        w[lean] = np.where(loop.e[lean] + reach * loop.a[lean] >= 0, 1.0, -1.0)
        w[wave] = np.where((i // period) % 2, -side[wave], side[wave])
        if len(wander):
            flip = rng.random((len(wander), w.shape[1])) > size[wander]
            w[wander] = np.where(flip, -w[wander], w[wander])
        loop.tick(w, against * w * np.where(loop.far() < 0.62, 1.0, -1.0))
        if i % 8 == 7 and loop.out.any(axis=0).all():
            break
    return loop.out.any(axis=0)


def replayed(kind: type[Loop], n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """Whether the counterexample of a file leaves in the plain simulator."""
    one = {k: np.array([float(v)]) for k, v in n.items()}
    start = float(told(one, "start", 0.5)[0])
    if "run" not in counterexample or "side" in counterexample["run"]:
        side = counterexample.get("run", {}).get("side", 1)
        sides = (side,) if "run" in counterexample else (1, -1)
        place = _number(counterexample.get("run", {}).get("place", "31/50"))
        return any(_drifts(kind(one, np.array([[0.0]]), True), s, place) for s in sides)
    run = counterexample["run"]
    middle = run["from"] == "middle"
    if "errors" in run:
        return _steered(kind, one, run, middle, start)
    loop = kind(one, np.array([[_number(run["at"]) * start * (not middle)]]), middle)
    for count, w, noise, step in run["ticks"]:
        loop.e = loop.e + _number(step) * told(one, "step")
        for _ in range(count):
            loop.tick(np.array([[_number(w)]]), np.array([[_number(noise)]]))
    return bool(loop.out.any())


def _drifts(loop: Loop, side: float, place: float) -> bool:
    """Whether it leaves; a push that wins by little takes long, and must then still go outwards."""
    half = 0.0
    for i in range(6000):
        if i == 3000:
            half = float(loop.e[0, 0])
        loop.tick(np.array([[side]]), -side * np.where(loop.away(side) < place, 1.0, -1.0))
        if loop.out.any():
            return True
    return bool(side * (loop.e[0, 0] - half) > 0)


def _steered(kind: type[Loop], one: Cases, run: dict[str, Any], middle: bool, start: float) -> bool:
    """The push of each tick is what brings the error to the next one of the list, if allowed."""
    loop = kind(one, np.array([[0.0]]), middle)
    errors = [_number(x) for x in run["errors"]]
    loop.e = _error(loop, errors[0])
    for i in range(len(run["noise"])):
        if i == run["stepped"]:
            loop.e = loop.e + run["forward"] * told(one, "step")
        loop.tick(np.zeros((1, 1)), np.array([[float(run["noise"][i])]]))
        if loop.out.any():
            return i == len(run["noise"]) - 1
        if i + 1 < len(errors):
            target = _error(loop, errors[i + 1])
            if i + 1 == run["stepped"]:
                target = target - run["forward"] * told(one, "step")
            room = loop.T * loop.push() * (1 + 1e-9)
            loop.e = loop.e + np.clip(target - loop.e, -room, room)
    return False


def _error(loop: Loop, z: float) -> np.ndarray:
    if isinstance(loop, BarrierLoop):
        return np.array([[z]]) * loop.n["k_s"]
    low, high = loop.bounds()
    return (low + high) / 2 + np.array([[z]]) * (high - low) / 2


def _number(text: Any) -> float:
    over, _, under = str(text).partition("/")
    return int(over) / int(under or 1)


# ---- the cases ----------------------------------------------------------------------------------


def _some(rng: np.random.Generator, share: float, x: np.ndarray) -> np.ndarray:
    return np.where(rng.random(len(x)) < share, x, np.nan)


def _funnel(rng: np.random.Generator, n: int) -> Cases:
    """K1 10 to 300 1/s; K1 T 0.05 to 3; widths 0.8 to 1.5; W 0.05 to 0.5 of K1 eta_inf d.

    In a third each: noise up to 0.05 of the half-width, a lag of 0.03/K1 to 0.3/K1, a funnel that
    starts 1.5 to 20 times wider and falls at 0.02 K1 to 0.3 K1; in a tenth a dead time of a tick.
    """
    K1, kappa = common.log_uniform(rng, 10, 300, n), common.log_uniform(rng, 0.05, 3, n)
    eta = common.log_uniform(rng, 2e-3, 2e-2, n)
    lower, upper = rng.uniform(0.8, 1.5, (2, n))
    half = eta * (lower + upper) / 2
    T = common.rounded(kappa / K1)
    shrinks = rng.random(n) < 1 / 3
    return {
        "K1": K1, "T": T, "eta_inf": eta, "delta_l": lower, "delta_u": upper,
        "start": rng.uniform(0.1, 0.8, n), "W": common.log_uniform(rng, 0.05, 0.5, n) * K1 * half,
        "noise": _some(rng, 1 / 3, rng.uniform(0, 0.05, n) * half),
        "lag": _some(rng, 1 / 3, common.log_uniform(rng, 0.03, 0.3, n) / K1),
        "dead": np.where(shrinks, np.nan, _some(rng, 0.1, T)),
        "step": _some(rng, 0.3, rng.uniform(0.02, 0.4, n) * half),
        "eta_0": np.where(shrinks, eta * common.log_uniform(rng, 1.5, 20, n), np.nan),
        "k": np.where(shrinks, common.log_uniform(rng, 0.02, 0.3, n) * K1, np.nan),
    }  # fmt: skip


def _barrier(rng: np.random.Generator, n: int) -> Cases:
    """k_s 0.01 to 1; k_a 1 to 3 times as far; 2 k k_a^2 T 0.05 to 3; W 0.05 to 0.4 of 2 k k_s^3.

    In a third each: noise up to 0.05 k_s, a lag of 0.03 to 0.3 of 1/(2 k k_a^2).
    """
    k_s = common.log_uniform(rng, 0.01, 1, n)
    k_a = k_s * common.log_uniform(rng, 1, 3, n)
    k = common.log_uniform(rng, 1, 1e3, n) / k_s**2
    rate = 2 * k * k_a**2
    return {
        "k": k, "k_a": k_a, "k_s": k_s, "T": common.log_uniform(rng, 0.05, 3, n) / rate,
        "W": common.log_uniform(rng, 0.05, 0.4, n) * 2 * k * k_s**3,
        "start": rng.uniform(0.1, 0.8, n),
        "noise": _some(rng, 1 / 3, rng.uniform(0, 0.05, n) * k_s),
        "lag": _some(rng, 1 / 3, common.log_uniform(rng, 0.03, 0.3, n) / rate),
    }  # fmt: skip


def _most(n: Cases) -> np.ndarray:
    """Half of K1 eta_inf d, a little above the largest pull of the funnel."""
    return n["K1"] * n["eta_inf"] * (n["delta_l"] + n["delta_u"]) / 4


def _top(n: Cases) -> np.ndarray:
    """A little above the largest pull of the barrier's nearer side."""
    return 0.8 * n["k"] * n["k_s"] ** 3


def _rate(n: Cases) -> np.ndarray:
    return 2 * n["k"] * n["k_a"] ** 2


def _attack(kind: type[Loop]) -> Any:
    def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
        with np.errstate(all="ignore"):
            return attacked(kind, n, rng, effort)

    return leaves


def _first(kind: type[Loop], name: str, low: Any, high: Any) -> Any:
    """Number at which the search first succeeds, by bisection between two limits of a case."""

    def swing(n: Cases, rng: np.random.Generator) -> np.ndarray:
        a, b = low(n), high(n)
        for _ in range(7):
            middle = np.sqrt(a * b)
            with np.errstate(all="ignore"):
                gone = attacked(kind, {**n, name: middle}, rng, 1)
            a, b = np.where(gone, a, middle), np.where(gone, middle, b)
        return b

    return swing


def _replay(kind: type[Loop]) -> Any:
    def replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
        with np.errstate(all="ignore"):
            return replayed(kind, n, counterexample)

    return replays


ADVERSARIES = (
    Adversary("prescribed_performance", _funnel, ("W", "T"), _attack(FunnelLoop),
              _replay(FunnelLoop), swing={
                  "W": _first(FunnelLoop, "W", lambda n: 0.01 * _most(n), _most),
                  "T": _first(FunnelLoop, "T", lambda n: 0.03 / n["K1"], lambda n: 4 / n["K1"])}),
    Adversary("barrier_lyapunov", _barrier, ("W", "T"), _attack(BarrierLoop),
              _replay(BarrierLoop), swing={
                  "W": _first(BarrierLoop, "W", lambda n: 0.01 * _top(n), _top),
                  "T": _first(BarrierLoop, "T", lambda n: 0.03 / _rate(n),
                              lambda n: 5 / _rate(n))}),
)  # fmt: skip
