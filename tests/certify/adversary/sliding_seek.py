"""Adversary of the sliding-mode seeker: straight maps and parabolas, tick by tick."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases


def draw(rng: np.random.Generator, n: int) -> Cases:
    """k 0.3 to 3, rho 0.03 to 0.3, slope 1.2 to 4 rho/k, zone 0.2 to 2 m/s.

    Ripple 0.05 to 0.9 zones, 3 to 30 ticks of the steepest way to a cell; noise 0.5 % to 5 % of a
    cell in half of the cases, a dead time of one or two ticks in a quarter.
    """
    k, rho = common.log_uniform(rng, 0.3, 3, n), common.log_uniform(rng, 0.03, 0.3, n)
    slope = rho / k * common.log_uniform(rng, 1.2, 4, n)
    zone = common.log_uniform(rng, 0.2, 2, n)
    beta = rho / k * zone * common.log_uniform(rng, 0.05, 0.9, n)
    T = beta / (k * slope + rho) / common.log_uniform(rng, 3, 30, n)
    noise = np.where(rng.random(n) < 0.5, 0.0, beta * common.log_uniform(rng, 0.005, 0.05, n))
    late = np.where(rng.random(n) < 0.75, 0, rng.integers(1, 3, n))
    return {"k": k, "rho": rho, "beta": beta, "slope": slope, "curvature": -rho / (k * zone),
            "T": T, "noise": noise, "dead_time": late * T * 0.9}  # fmt: skip


def _plus(delta: np.ndarray, n: Cases, wanted: np.ndarray) -> np.ndarray:
    """Direction of a tick, by the noise that makes it the wanted one wherever it can."""
    beta, N = n["beta"], n["noise"]
    hit = (np.floor(delta / beta) % 2 == 0) == wanted
    if N.any():
        for heard in (delta - N, delta + N):
            hit |= (np.floor(heard / beta) % 2 == 0) == wanted
    return hit == wanted


def _delayed(store: list[np.ndarray], late: np.ndarray) -> np.ndarray:
    """Values as they were so many ticks ago, the oldest where there are fewer."""
    out = store[-1].copy()
    for ticks in range(1, int(late.max(initial=0)) + 1):
        out = np.where(late >= ticks, store[max(len(store) - 1 - ticks, 0)], out)
    return out


def _late(n: Cases) -> np.ndarray:
    return np.ceil(np.nan_to_num(n["dead_time"]) / n["T"] - 1e-12).astype(int)


def _climb(n: Cases, share: np.ndarray, ticks: int) -> np.ndarray:
    """Gain of mu on the straight slope at each tick, from delta = share 2 beta; noise says -."""
    n = n | {"noise": np.nan_to_num(n["noise"])}
    late, store = _late(n), [np.zeros_like(n["k"])]
    mu, g, out = np.zeros_like(n["k"]), -share * 2 * n["beta"], []
    for _ in range(ticks):
        up = _plus(_delayed(store, late) - g, n, np.zeros(mu.shape, bool))
        mu = mu + n["T"] * n["k"] * n["slope"] * np.where(up, 1, -1)
        g = g + n["T"] * n["rho"]
        store = [*store[-12:], mu]
        out.append(mu)
    return np.array(out)


def _peak(n: Cases, x: np.ndarray, share: np.ndarray, ticks: int) -> np.ndarray:
    """Range of v in the end: noise to the right for a half, then to the left and to the right."""
    n = n | {"noise": np.nan_to_num(n["noise"])}
    late, c = _late(n), n["curvature"] / 2
    store, g = [x], c * x * x - share * 2 * n["beta"]
    low, high = np.full_like(x, np.inf), np.full_like(x, -np.inf)
    for i in range(ticks):
        right = not 2 * ticks <= 4 * i < 3 * ticks
        seen = _delayed(store, late)
        up = _plus(c * seen * seen - g, n, np.full(x.shape, right))
        x = x + n["T"] * n["k"] * np.where(up, 1, -1)
        g = g + n["T"] * n["rho"]
        store = [*store[-12:], x]
        if 2 * i >= ticks:
            low, high = np.minimum(low, x), np.maximum(high, x)
    return high - low


def _wide(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    zone = n["rho"] / (n["k"] * np.abs(n["curvature"]))
    cycle = 2 * n["beta"] / (n["rho"] * n["T"])
    slow = zone / (n["k"] * n["T"])  # ticks of the last time constant
    ticks = int(np.quantile(8 * cycle + 6 * slow, 0.95)) if len(zone) else 0
    ticks, worst = min(ticks, 12_000), np.zeros_like(zone)
    near = n["k"] * n["beta"] / n["rho"]  # from farther out a run would still be on its way
    for _ in range(1 + effort // 4):
        x, share = near * rng.uniform(-0.5, 0.5, len(zone)), rng.random(len(zone))
        worst = np.maximum(worst, _peak(n, x, share, ticks))
    return worst


def _last_below(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """Last tick at which a start has gained less than the gap."""
    ticks = int(((n["gap"] + 5 * n["beta"]) / (n["rho"] * n["T"])).max()) + 10
    last = np.zeros_like(n["k"])
    for share in (0.999, 0.9999 + 0 * last, *rng.random((3 * effort, len(last)))):
        gain = _climb(n, share + 0 * last, min(ticks, 6000))
        below = gain < n["gap"]
        last = np.maximum(last, len(gain) - np.argmax(below[::-1], 0) * below.any(0))
        last = np.where(below.any(0), last, 0)
    return last


def leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """Mu three cells behind, or v too wide at the peak, or the gap not gained."""
    out = np.zeros(len(n["k"]), bool)
    for share in (0.02, 0.3, 0.6, 0.99, *rng.random(2 * effort)):
        gain = _climb(n, np.full_like(n["k"], share), 150 * effort)
        aim = (np.arange(len(gain)) + 1)[:, None] * n["rho"] * n["T"]
        out |= (aim - gain >= 3 * n["beta"] * (1 + 1e-9)).any(0)
    for name, search in (("ripple", _wide), ("time", _last_below)):
        told = ~np.isnan(n[name]) if name in n else np.zeros(len(out), bool)
        if told.any():
            some = {k: v[told] for k, v in n.items()}
            found = search(some, rng, effort)
            if name == "ripple":
                out[told] |= found > some["ripple"] * (1 + 1e-9)
            else:
                out[told] |= found > np.floor(some["time"] / some["T"] * (1 + 1e-12))
    return out


def _first_time(n: Cases, rng: np.random.Generator) -> np.ndarray:
    """Time of the gap, which it draws too: 0.5 to 5 cells."""
    n["gap"] = common.rounded(n["beta"] * common.log_uniform(rng, 0.5, 5, len(n["beta"])))
    return (_last_below(n, rng, 1) + 1) * n["T"]


def replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """The run of the file, in floats."""
    one = {k: np.array([float(v)]) for k, v in n.items()}
    run, clause = counterexample["run"], counterexample["clause"]
    beta = one["beta"][0]
    if clause == "climbs":
        one["slope"] = np.array([float(Fraction(run["slope"]))])
        if run["noise"] == "none":
            one["noise"] = np.zeros(1)
        share = np.array([float(Fraction(run["start"])) / (2 * beta)])
        gain = _climb(one, share, run["ticks"] + 3)[:, 0]
        aim = (np.arange(len(gain)) + 1) * n["rho"] * n["T"]
        return bool((aim - gain).max() >= 3 * beta * (1 - 1e-6))
    if clause == "in_time":
        one["noise"] = np.zeros(1)
        ticks = int(n["time"] / n["T"] * (1 + 1e-12))
        if not ticks:
            return True
        return bool(_climb(one, np.array([0.999999]), ticks)[-1, 0] < n["gap"])
    return _turning(n, run)


def _turning(n: dict[str, float], run: dict[str, Any]) -> bool:
    """Whether the second period's width exceeds the ripple, and the third's is no less.

    The width is that between the turns of a period. Whole numbers throughout, so
    that nothing is left to a tolerance: a value on a plane counts to the cells of both sides. Where
    the noise can say either, it says what the part wants, but does not turn twice at one plane.
    """
    plain = {k: Fraction(f"{n.get(k, 0):.10g}") for k in (
        "k", "rho", "beta", "curvature", "T", "noise", "dead_time", "ripple")}  # fmt: skip
    k, rho, T = plain["k"], plain["rho"], plain["T"]
    late, start = math.ceil(plain["dead_time"] / T), Fraction(run["start"])
    # x = start + j k T, and all values in units of 1/scale
    c = plain["curvature"] / 2
    values = (c * start**2, 2 * c * start * k * T, c * (k * T) ** 2, rho * T, plain["beta"],
              plain["noise"])  # fmt: skip
    scale = 2 * math.lcm(*(x.denominator for x in values))
    still, lean, bend, fall, beta, noise = (int(x * scale) for x in values)
    j, g, way = 0, still - beta // 2, 1
    places, turns, last = [0], [], None
    period = run["left"] + run["right"]
    while len(turns) < 3 * period:
        wanted = 1 if len(turns) % period >= run["left"] else -1
        old = places[max(len(places) - 1 - late, 0)]
        value = still + lean * old + bend * old * old - g
        delta, plane = value % (2 * beta), (2 * value + beta) // (2 * beta)
        above = delta <= beta + noise or delta >= 2 * beta - noise
        below = delta >= beta - noise or delta <= noise
        either = way if plane == last else wanted
        new = either if above and below else 1 if above else -1
        if new != way:
            way, last = new, plane
            turns.append(j)
        j, g = j + way, g + fall
        places = [*places[-late:], j] if late else [j]
    parts = (turns[period : 2 * period], turns[2 * period : 3 * period])
    widths = [max(part) - min(part) for part in parts]
    return widths[0] * k * T > plain["ripple"] and widths[1] >= widths[0]


ADVERSARY = Adversary(
    "sliding_seek", draw, ("ripple", "time", "T"), leaves, replays,
    grows={"ripple": False, "time": False, "T": True},
    swing={"ripple": lambda n, rng: _wide(n, rng, 1), "time": _first_time},
)  # fmt: skip
