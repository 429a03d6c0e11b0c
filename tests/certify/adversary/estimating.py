"""Adversaries of the estimators: regressors that come late; moments of a filter's error."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from . import common
from .common import Adversary, Cases

# ---- least squares ------------------------------------------------------------------------------


def _rls_draw(rng: np.random.Generator, n: int) -> Cases:
    """Memory 3 to 300 samples, windows of 2 to 50, excitation 0.01 to 1, P 0.1 to 10.

    A pause of 1 to 300 samples in half of the cases, no forgetting in one of twenty, no known
    excitation in one of ten.
    """
    lam = 1 - 1 / common.log_uniform(rng, 3, 300, n)
    lam = np.where(rng.random(n) < 0.05, 1.0, common.rounded(lam))
    least = common.log_uniform(rng, 0.01, 1, n)
    idle = np.where(rng.random(n) < 0.5, 0, rng.integers(1, 300, n)).astype(float)
    return {"forgetting": lam, "samples": rng.integers(2, 51, n).astype(float), "least": least,
            "most": 10 * least, "P": common.log_uniform(rng, 0.1, 10, n), "idle": idle}  # fmt: skip


def _largest(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    """Largest ln P of a direction: pulses once a window, at some sample of it, then the pause.

    The first pulse may come as late as the last sample of the first window, and after the pause the
    next one as late as the last of its first window.
    """
    many, worst = len(n["P"]), np.log(n["P"])
    S, rate = n["samples"], -np.log(n["forgetting"])
    for trial in range(12 * effort):
        first = np.where(rng.random(many) < 0.6, 1, np.ceil(rng.random(many) * S))
        count = np.where(trial % 3 == 0, 0, np.ceil(common.log_uniform(rng, 1, 400, many)))
        info = 1 / n["P"]
        run = int(np.quantile(count, 1.0))
        gap = first - 1
        age = np.zeros(many)
        with np.errstate(under="ignore", divide="ignore"):
            for k in range(run):
                on = k < count
                step = np.where(k == 0, gap + 1, S)
                info = np.where(on, info * np.exp(-rate * step) + n["least"], info)
            age = np.where(count > 0, S - 1, S - 1)
            quiet = age + np.where(n["idle"] > 0, n["idle"] + S - 1, 0)
            worst = np.maximum(worst, -np.log(info) + rate * quiet)
    return worst


def _largest_of_two(n: Cases, rng: np.random.Generator) -> np.ndarray:
    """Largest ln of an eigenvalue of P, two parameters: its own recursion, sample by sample.

    Two directions at a right angle, turned at random; each is excited once a window, at samples of
    its own, by ``least``. Then the pause, and the window after it.
    """
    many, S = len(n["P"]), n["samples"]
    turn, windows = rng.uniform(0, np.pi, many), rng.integers(0, 12, many)
    first = np.where(rng.random(many) < 0.7, 0.0, np.floor(rng.random(many) * S))
    other = first + 1 + np.where(rng.random(many) < 0.7, 0.0, np.floor(rng.random(many) * (S - 1)))
    at = np.stack([first, np.mod(other, S)])
    ways = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    P = n["P"] * np.eye(2)[:, :, None]
    last, worst = windows * S, np.log(n["P"])
    end = last + np.where(windows > 0, 0, S - 1) + np.where(n["idle"] > 0, n["idle"] + S - 1, 0)
    with np.errstate(over="ignore", invalid="ignore"):
        for t in range(int(end.max())):
            for at_one, way in zip(at, ways, strict=True):
                on = (t < last) & (np.mod(t, S) == at_one)
                phi = way * np.sqrt(n["least"]) * on
                Pphi = np.einsum("ijn,jn->in", P, phi)
                seen = n["forgetting"] + np.einsum("in,in->n", phi, Pphi)
                P = P - Pphi[:, None] * Pphi[None] / seen
            P = np.where(t < end, P / n["forgetting"], P)
            half, lean = (P[0, 0] + P[1, 1]) / 2, (P[0, 0] - P[1, 1]) / 2
            size = np.log(half + np.hypot(lean, P[0, 1]))
            worst = np.fmax(worst, np.where(t < end, size, worst))
    return worst


def _rls_leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    limit = np.log(n["limit"])
    out = _largest(n, rng, effort) > limit + 1e-9
    if effort > 1:  # where verdicts are tried
        for _ in range(effort):
            out |= _largest_of_two(n, rng) > limit + 1e-6  # of two thousand roundings
    return out


def _rls_replays(n: dict[str, float], counterexample: dict[str, Any]) -> bool:
    """Sample by sample, in logarithms where it would overflow."""
    run, lam = counterexample["run"], n["forgetting"]
    log_info = -math.log(n["P"])
    S = int(n["samples"])
    for _ in range(run["windows"]):
        for k in range(S):
            log_info += math.log(lam)
            if k == 0:
                log_info = np.logaddexp(log_info, math.log(n["least"]))
    return bool(-log_info - run["quiet"] * math.log(lam) > math.log(n["limit"]) - 1e-9)


# ---- the filter ---------------------------------------------------------------------------------


def _filter_draw(rng: np.random.Generator, n: int) -> Cases:
    """Gamma 0.02 to 1, R 1e-5 to 1, H 1e-3 to 0.1, dt 0.1 to 10 ms, P 0.1 to 1e4 steady ones."""
    gamma, R = common.log_uniform(rng, 0.02, 1, n), common.log_uniform(rng, 1e-5, 1, n)
    H, dt = common.log_uniform(rng, 1e-3, 0.1, n), common.log_uniform(rng, 1e-4, 1e-2, n)
    steady = gamma / (1 + gamma) * R / (H**2 * dt)
    P = steady * common.log_uniform(rng, 0.1, 1e4, n)
    return {"gamma": gamma, "R": R, "H": H, "dt": dt, "P": P}


def _share(n: Cases, samples: np.ndarray) -> np.ndarray:
    """Share of an error that is left after so many samples, by the filter's own recursion."""
    P, e, out = n["P"].copy(), np.ones_like(n["P"]), np.ones_like(n["P"])
    for k in range(int(samples.max(initial=0))):
        before = (1 + n["gamma"]) * P
        K = before * n["H"] * n["dt"] / (n["H"] ** 2 * n["dt"] ** 2 * before + n["R"] * n["dt"])
        P, e = (1 - K * n["H"] * n["dt"]) * before, e * (1 - K * n["H"] * n["dt"])
        out = np.where(samples >= k + 1, e, out)
    return out


def _first_time(n: Cases, rng: np.random.Generator) -> np.ndarray:
    """Time of a share, which it draws too: 1 % to 80 %."""
    n["share"] = common.rounded(common.log_uniform(rng, 0.01, 0.8, len(n["P"])))
    P, e, first = n["P"].copy(), np.ones_like(n["P"]), np.ones_like(n["P"])
    for k in range(1, 600):
        before = (1 + n["gamma"]) * P
        K = before * n["H"] * n["dt"] / (n["H"] ** 2 * n["dt"] ** 2 * before + n["R"] * n["dt"])
        P, e = (1 - K * n["H"] * n["dt"]) * before, e * (1 - K * n["H"] * n["dt"])
        first = np.where(e > n["share"], k + 1, first)
    return first * n["dt"]


def _nis(n: Cases) -> np.ndarray:
    """Expected NIS on a random walk of drift q, from the moments, run until they stand still."""
    P, V = n["P"] * 0 + 1.0, n["P"] * 0.0
    P = P * n["gamma"] / (1 + n["gamma"]) * n["R"] / (n["H"] ** 2 * n["dt"])
    h, noise, nis = n["H"] * n["dt"], n["R"] * n["dt"], P
    for _ in range(3000):
        before, V = (1 + n["gamma"]) * P, V + n["q"] * n["dt"]
        S = h * h * before + noise
        nis = (h * h * V + noise) / S
        K = before * h / S
        P, V = (1 - K * h) * before, (1 - K * h) ** 2 * V + K * K * noise
    return nis


def _untrue(n: Cases, slack: float) -> np.ndarray:
    from scipy.special import gammainc

    samples = np.where(np.isnan(n["band_samples"]), 1000, n["band_samples"]) \
        if "band_samples" in n else 1000.0  # fmt: skip
    at = gammainc(samples / 2, _nis(n) * samples / 2)  # of chi-squared
    return (at < 0.025 - slack) | (at > 0.975 + slack)


def _filter_leaves(n: Cases, rng: np.random.Generator, effort: int) -> np.ndarray:
    out = np.zeros(len(n["P"]), bool)
    told = ~np.isnan(n["time"]) if "time" in n else out
    if told.any():
        some = {k: v[told] for k, v in n.items()}
        samples = np.floor(some["time"] / some["dt"] * (1 + 1e-12))
        out[told] |= _share(some, samples) > some["share"] * (1 + 1e-9)
    told = ~np.isnan(n["q"]) if "q" in n else np.zeros(len(out), bool)
    if told.any():
        out[told] |= _untrue({k: v[told] for k, v in n.items()}, 1e-9)
    return out


def _filter_replays(n: Cases, entries: list[dict[str, Any]]) -> np.ndarray:
    """The variance is untrue, or too much is left after the samples of that time."""
    true = np.array([entry["clause"] == "true" for entry in entries])
    found = np.zeros(len(true), bool)
    if true.any():
        found[true] = _untrue({k: v[true] for k, v in n.items()}, -1e-9)
    late = {k: v[~true] for k, v in n.items()}
    if len(late["P"]):
        samples = np.floor(late["time"] / late["dt"] * (1 - 1e-12))
        found[~true] = _share(late, samples) > late["share"] * (1 - 1e-9)
    return found


ADVERSARIES = (
    Adversary(
        "rls", _rls_draw, ("limit",), _rls_leaves, _rls_replays, grows={"limit": False},
        swing={"limit": lambda n, rng: np.exp(np.minimum(_largest(n, rng, 1), 80.0))},
    ),
    Adversary(
        "filter", _filter_draw, ("time", "q"), _filter_leaves, replays_all=_filter_replays,
        grows={"time": False, "q": True}, swing={"time": _first_time},
        guess={"q": lambda n: n["gamma"] ** 2 * n["R"] / (n["H"] * n["dt"]) ** 2},
    ),
)  # fmt: skip
