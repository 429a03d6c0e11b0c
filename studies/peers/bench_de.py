"""One search in generated C against hand-written C and against scipy."""

from __future__ import annotations

import ctypes
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from slipctl import build, differential_evolution, wichmann_hill
from slipctl.errors import BadInput
from slipctl.models.subway_braking import TABLE_1, double_exponential

SEARCHES = 20
"""Searches per call of ours and of a peer, so that the call itself does not count."""

PEERS = ("every_trial", "without_copies", "faster_generator")
"""Functions of de.c, in its order."""

EVALUATIONS = 50 * 301
"""Of the curve in one search: 50 members, then 50 trials in each of 300 generations."""


def bench_de(rounds: int = 25) -> dict[str, Any]:
    """Time searches over the dry curve of Table 1, ours and the peers' in turn.

    Args:
        rounds: how often all of them run.

    Returns:
        Rows with ``ratio`` (median over the rounds, each round giving one ratio) and median times
        per search in s: ``ours_vs_c`` (the peer evaluates every trial, as ours does),
        ``ours_vs_c_without_copies`` (the peer leaves out the 40 % of trials that crossover makes a
        copy of their parent), ``ours_vs_c_faster_generator`` (xorshift in place of Wichmann-Hill),
        ``scipy_vs_ours``; also ``evaluations``, and ``same_bits`` of ours and the first two peers.

    Raises:
        BadInput: there is no C compiler.
    """
    from slipctl.studies.speed import peer_library

    library = peer_library("de")
    block = differential_evolution(double_exponential, "v_s", "mu", lo=0.01, hi=10.0)
    roller = build.compiled(block.f)
    if roller is None:
        raise BadInput("speed needs a C compiler; install gcc or clang, or set CC")
    curve = np.array([TABLE_1["dry"][s] for s in block.inputs])
    curves = np.tile(curve, (SEARCHES, 1))
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    log, found = np.empty((SEARCHES, 3)), np.empty((SEARCHES, 2))
    rng = np.array(wichmann_hill.seeded(1))

    def ours() -> np.ndarray:
        state = rng.copy()
        roller.roll(state, curves, p, log, found)
        return np.concatenate([state, found.ravel()])

    def peer(which: int) -> Callable[[], np.ndarray]:
        results = np.empty((SEARCHES, 2))

        def run() -> np.ndarray:
            state = rng.copy()
            pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (state, curves, results)]
            library.peer_de(which, ctypes.c_long(SEARCHES), *pointers)
            return np.concatenate([state, results.ravel()])

        return run

    runs = [ours, *(peer(k) for k in range(len(PEERS)))]
    answers = [run() for run in runs]
    times = np.array([[_seconds(run) / SEARCHES for run in runs] for _ in range(rounds)])
    scipy = statistics.median(_seconds(lambda: _scipy(*curve)) for _ in range(3))
    mine = float(np.median(times[:, 0]))

    def row(k: int) -> dict[str, float]:
        ratios = times[:, 0] / times[:, k]
        return {
            "ratio": float(np.median(ratios)), "ratio_min": float(ratios.min()),
            "ratio_max": float(ratios.max()), "ours_s": mine,
            "peer_s": float(np.median(times[:, k])),
        }  # fmt: skip

    return {
        "ours_vs_c": row(1),
        "ours_vs_c_without_copies": row(2),
        "ours_vs_c_faster_generator": row(3),
        "scipy_vs_ours": {"ratio": scipy / mine, "ours_s": mine, "scipy_s": scipy},
        "evaluations": EVALUATIONS,
        "same_bits": bool((answers[0] == answers[1]).all() and (answers[0] == answers[2]).all()),
    }


def _seconds(run: Callable[[], Any]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def _scipy(c: float, a: float, b: float) -> None:
    from scipy.optimize import differential_evolution as scipy_search

    def loss(x: np.ndarray) -> float:
        v = x[0]
        return c * (math.exp(-b * v) - math.exp(-a * v))

    result = scipy_search(
        loss, [(0.01, 10.0)], strategy="rand1bin", popsize=50, maxiter=300, recombination=0.6,
        mutation=(0.5, 1.0), atol=-1, polish=False, seed=1,
    )  # fmt: skip
    assert result.nfev == EVALUATIONS
