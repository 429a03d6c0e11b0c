"""The best that a whole train can do: leading axles slide more and clean for those behind.

Over one rail point the axles pass one after the other at nearly one speed, so the best slips are a
dynamic program over the axles. With m axles behind and the energy W found,

    V_m(W) = max over e <= e_max of  f(e, W) + V_(m-1)(W + N f e),    V_(-1) = 0

whose inner optimum keeps  -(df/de)/f = L N/(1 + L N e), L = V_(m-1)'. An axle has two good slips,
one near its peak and one at its limit; a search from anywhere else ends in the wrong one. From the
program a nonlinear program over all axles and cells finds what is left, mostly 1e-4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from slipctl.models.wheel_rail.sliding_train import SlidingTrain, Stop, stop

LEAST = 1e-5
"""Smallest creep ratio that is looked at."""


@dataclass(frozen=True)
class Program:
    """Best slips at one speed, by how many axles follow and by the energy found.

    Attributes:
        W: energies in J/m, rising from 0, shape (k,).
        slip: creep ratio with 0, 1, ... axles behind, shape (axles, k).
        value: sum of the adhesions of this axle and those behind, shape (axles, k).
    """

    W: np.ndarray
    slip: np.ndarray
    value: np.ndarray

    def slips(self, behind: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Creep ratio of axles by how many are behind each, and by what each finds."""
        return np.array(
            [np.interp(w, self.W, self.slip[m]) for m, w in zip(behind, W, strict=True)]
        )


def program(train: SlidingTrain, v: float, axles: int | None = None) -> Program:
    """Best slips at a speed in m/s; with ``axles`` = 1 each axle's own, the greedy ones."""
    e = np.concatenate([[LEAST], np.geomspace(1e-4, train.slip, 400)])
    n = train.axles if axles is None else axles
    low, high = train.heights(e, v)
    largest = n * train.load * min(train.most, max(low.max(), high.max())) * train.slip
    W = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 400) * largest])
    share = train.recovered(W)[:, None]
    f = np.minimum((1 - share) * low + share * high, train.most)
    left = train.load * f * e
    allowed = left <= train.t_gamma
    rows, following = np.arange(W.size), W[:, None] + left
    value, slips, values = np.zeros(W.size), [], []
    for _ in range(n):
        total = np.where(allowed, f + np.interp(following, W, value), -np.inf)
        best = total.argmax(axis=1)
        value = total[rows, best]
        slips.append(e[best])
        values.append(value)
    return Program(W, np.array(slips), np.array(values))


@dataclass(frozen=True)
class Rule:
    """Slips by the program, over speed: of the whole train, or of each axle by itself.

    Attributes:
        train: the train.
        greedy: whether each axle goes to the peak of what it finds.
        fastest: largest speed in m/s.
    """

    train: SlidingTrain
    greedy: bool = False
    fastest: float = 60.0

    @cached_property
    def _speeds(self) -> np.ndarray:
        return np.linspace(0.5, self.fastest, 2 * max(2, round(self.fastest)))

    @cached_property
    def _programs(self) -> list[Program]:
        many = 1 if self.greedy else None
        return [program(self.train, float(v), many) for v in self._speeds]

    @cached_property
    def _clean(self) -> np.ndarray:
        """Slip on rail that was not fouled, by speed."""
        e = np.geomspace(1e-4, self.train.slip, 400)
        heights = (np.minimum(self.train.heights(e, float(v))[1], self.train.most)
                   for v in self._speeds)  # fmt: skip
        return np.array([e[f.argmax()] for f in heights])

    def __call__(self, x: float, v: float, W: np.ndarray, fouled: np.ndarray) -> np.ndarray:
        """Creep ratio of each axle; see :data:`~slipctl.models.wheel_rail.sliding_train.Slips`."""
        k = int(np.abs(self._speeds - v).argmin())
        n = self.train.axles
        behind = np.zeros(n, int) if self.greedy else np.arange(n - 1, -1, -1)
        return np.where(fouled, self._programs[k].slips(behind, W), self._clean[k])


def refined_point(train: SlidingTrain, v: float, slips: np.ndarray) -> tuple[np.ndarray, float]:
    """Best slips of the axles over one fouled rail point, from slips near them, by exact slopes.

    Returns:
        Creep ratios, shape (axles,), and the sum of the adhesions.
    """
    e = ca.MX.sym("e", train.axles)
    W, total, limits = 0.0, 0.0, []
    for k in range(train.axles):
        f = _adhesion(train, e[k], v, W)
        total += f
        limits.append(train.load * f * e[k])
        W += limits[-1]
    problem = {"x": e, "f": -total, "g": ca.vertcat(*limits)}
    found = _solver("point", problem)(x0=slips, lbx=LEAST, ubx=train.slip, lbg=-np.inf,
                                      ubg=train.t_gamma)  # fmt: skip
    return found["x"].full().ravel(), -float(found["f"])


@dataclass(frozen=True)
class LocalRule:
    """Slips of a law that looks at its own axle alone, with one number for those behind it.

    An axle with m axles behind it goes to the largest of

        ln f(e) + m k (1 - f/mu_r) e,    k = tau N (mu_r - mu_d)

    on the curve f that it finds; mu_d is the peak of the layer. Where it follows: the first joule
    per metre is worth d f/d W = tau (mu_r - f) to each axle behind, in parts of f.

    Attributes:
        train: the train, whose curves the law knows.
        strength: factor on k, 1 where the strength of the cleaning is known.
        recovered: mu_r, peak of the clean rail as the law believes; none given: as it is.
        fastest: largest speed in m/s.
    """

    train: SlidingTrain
    strength: float = 1.0
    recovered: float | None = None
    fastest: float = 60.0

    @cached_property
    def _tables(self) -> tuple[np.ndarray, ...]:
        """Speeds, shares, and the creep ratio by speed, share and axle."""
        train, e = self.train, np.geomspace(1e-4, self.train.slip, 300)
        speeds = np.linspace(0.5, self.fastest, 2 * max(2, round(self.fastest)))
        shares = np.linspace(0.0, 1.0, 65)
        behind = np.arange(train.axles - 1, -1, -1)[:, None]
        found = np.zeros((speeds.size, shares.size, train.axles))
        for i, v in enumerate(speeds):
            low, high = train.heights(e, float(v))
            mu_r = high.max() if self.recovered is None else self.recovered
            k = self.strength * train.tau * train.load * max(mu_r - low.max(), 0.0)
            for j, share in enumerate(shares):
                f = np.minimum((1 - share) * low + share * high, train.most)
                worth = np.log(f) + behind * k * np.maximum(1 - f / mu_r, 0) * e
                worth = np.where(train.load * f * e <= train.t_gamma, worth, -np.inf)
                found[i, j] = e[worth.argmax(axis=1)]
        return speeds, shares, found

    def __call__(self, x: float, v: float, W: np.ndarray, fouled: np.ndarray) -> np.ndarray:
        """Creep ratio of each axle; see :data:`~slipctl.models.wheel_rail.sliding_train.Slips`."""
        speeds, shares, found = self._tables
        i = int(np.abs(speeds - v).argmin())
        share = np.where(fouled, self.train.recovered(W), 1.0)
        # a clean rail gains nothing from more slip: there it is the peak
        return np.array([np.interp(q, shares, found[i, :, k]) for k, q in enumerate(share)])


@dataclass(frozen=True)
class Optimum:
    """What a train can do at best.

    Attributes:
        distance: stopping distance in m.
        run: the run that has it.
        by_program: distance in m of the slips that the program over the axles gives.
    """

    distance: float
    run: Stop
    by_program: float


def best_stop(train: SlidingTrain, speed: float, mesh: float = 2.0, cell: float = 0.25) -> Optimum:
    """Least stopping distance over the slips of all axles at all places.

    Args:
        train: the train.
        speed: at the start, in m/s.
        mesh: length in m over which a slip is held, a whole number of cells.
        cell: of the rail, in m, with which the distance is told.
    """
    rule = Rule(train, fastest=speed + 1)
    first = stop(train, rule, speed, cell)
    held = _refined(train, first, rule, speed, mesh)

    def slips(x: float, v: float, W: np.ndarray, dirty: np.ndarray) -> np.ndarray:
        return held[min(int(x / mesh), len(held) - 1)]

    run = stop(train, slips, speed, cell)
    run = run if run.distance < first.distance else first
    return Optimum(run.distance, run, first.distance)


def _refined(train: SlidingTrain, start: Stop, rule: Rule, speed: float, mesh: float) -> np.ndarray:
    """Slips by step and axle, shape (steps, axles), of the shortest stop near a run.

    The last step is as long as it has to be; its length is what is made least.
    """
    n, off = train.axles, train.cells_behind(mesh)
    K = int(start.distance / mesh) + 1
    at = (np.arange(K) + 0.5) * mesh
    z0 = np.interp(np.arange(K) * mesh, start.x, start.v**2 / 2)
    z0[0] = speed**2 / 2
    nearest = np.clip(np.searchsorted(start.x, at), 0, len(start.x) - 1)
    e0, W0 = start.e[nearest], start.W[nearest]
    dirty = train.fouled_at(at[:, None] - off * mesh)
    z, last = ca.MX.sym("z", K), ca.MX.sym("last")
    e, W = ca.MX.sym("e", n, K), ca.MX.sym("W", n, K)
    lengths = ca.horzcat(ca.DM.ones(1, K - 1) * mesh, last)
    slow, laid = _step(train).map(K)(
        z.T, ca.horzcat(z[1:].T, 0), lengths, e, W, ca.DM(dirty.T.astype(float))
    )
    rows = [slow.T]
    for i in range(n):  # an axle finds what the one before it left, and what that one found
        since = min(int(off[i] - off[i - 1]), K) if i else K
        rows.append(W[i, :since].T)
        if since < K:
            rows.append((W[i, since:] - W[i - 1, : K - since] - laid[i - 1, : K - since]).T)
    kept = ca.vertcat(*rows)
    least = ca.vec(laid) if np.isfinite(train.t_gamma) else ca.MX(0, 1)
    low, high = np.where(dirty, LEAST, e0), np.where(dirty, train.slip, e0)
    low_z = np.concatenate([z0[:1], np.full(K - 1, 1e-6)])
    found = _solver(
        "train",
        {"x": ca.vertcat(z, last, ca.vec(e), ca.vec(W)), "f": last, "g": ca.vertcat(kept, least)},
    )(
        x0=np.concatenate([z0, [start.distance - (K - 1) * mesh], e0.ravel(), W0.ravel()]),
        lbx=np.concatenate([low_z, [0.0], low.ravel(), np.zeros(n * K)]),
        ubx=np.concatenate([np.full(K, z0[0]), [np.inf], high.ravel(), np.full(n * K, np.inf)]),
        lbg=np.concatenate([np.zeros(kept.numel()), np.full(least.numel(), -np.inf)]),
        ubg=np.concatenate([np.zeros(kept.numel()), np.full(least.numel(), train.t_gamma)]),
    )
    return found["x"].full().ravel()[K + 1 : K + 1 + n * K].reshape(K, n)


def _step(train: SlidingTrain) -> ca.Function:
    """Function (z, z+, length, e, W, fouled) -> residual, and J/m that each axle leaves."""
    n = train.axles
    z, nxt, length = ca.MX.sym("z"), ca.MX.sym("nxt"), ca.MX.sym("length")
    e, W, fouled = (ca.MX.sym(name, n) for name in ("e", "W", "fouled"))
    v = ca.sqrt(z + nxt)
    f = ca.vertcat(*(_adhesion(train, e[k], v, W[k], fouled[k]) for k in range(n)))
    f = ca.fmin(f, train.most)
    slow = train.gravity * ca.sum1(f) / n + train.lost(v)
    return ca.Function("step", [z, nxt, length, e, W, fouled],
                       [nxt - z + length * slow, train.load * f * e])  # fmt: skip


def _adhesion(
    train: SlidingTrain, e: ca.MX, v: ca.MX | float, W: ca.MX | float, fouled: ca.MX | float = 1.0
) -> ca.MX:
    """Adhesion of an axle, the brake's limit left out."""
    low, high = train.curves(e, v)
    kept = fouled * ca.exp(-((train.tau * ca.fmax(W, 0)) ** train.layers))
    return kept * low + (1 - kept) * high


def _solver(name: str, problem: dict[str, ca.MX]) -> ca.Function:
    quiet = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 300,
             "mu_init": 1e-6, "bound_push": 1e-8, "bound_frac": 1e-8}  # fmt: skip
    return ca.nlpsol(name, "ipopt", problem, {"print_time": False, "ipopt": quiet})
