"""One search in generated C against hand-written C and against scipy."""

from __future__ import annotations

import ctypes
import math
import statistics
import tempfile
import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from slipctl import differential_evolution
from slipctl.ccode.codegen import c_module
from slipctl.errors import BadInput
from slipctl.models.huang_2020.subway_braking import TABLE_1, double_exponential
from slipctl.run import build
from slipctl.seek import random

SEARCHES = 10
"""Searches per call: enough that the call itself does not count, and so few that ours and a peer
meet the same state of the machine."""

EVALUATIONS = 50 * 301
"""Of the curve in one search: 50 members, then 50 trials in each of 300 generations."""


def bench_de(rounds: int = 100) -> dict[str, Any]:
    """Time searches over the dry curve of Table 1, ours and the peers' in turn.

    Ours is the C that ``c_module`` writes; beside it is the CasADi text that ``simulate`` compiles.
    Times are processor times of this thread, so that other work on the machine counts less.

    Args:
        rounds: how often all of them run.

    Returns:
        Rows with ``ratio`` (median over the rounds, each round giving one ratio), the range that
        holds nine in ten of them, ``ratio_fastest`` (of the shortest times, what an idle machine
        gives) and median times per search in s: ``ours_vs_c`` (the peer evaluates every trial, as
        ours does), ``ours_vs_c_without_copies`` (the peer leaves out the 40 % of trials that
        crossover makes a copy of their parent), ``ours_vs_c_faster_generator`` (xorshift in place
        of Wichmann-Hill), ``simulated_vs_c`` (what ``simulate`` runs, against the first peer),
        ``scipy_vs_ours``; also ``evaluations`` of one search, and ``same_bits``:
        whether ours, simulated or in C, and the first two peers agree bit for bit.

    Raises:
        BadInput: there is no C compiler.
    """
    from bench.speed import peer_library

    library = peer_library("de")
    block = differential_evolution(double_exponential, "v_s", "mu", lo=0.01, hi=10.0)
    roller = build.compile_roller(block.f)
    if roller is None:
        raise BadInput("speed needs a C compiler; install gcc or clang, or set CC")
    curve = np.array([TABLE_1["dry"][s] for s in block.inputs])
    curves = np.tile(curve, (SEARCHES, 1))
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    log, found = np.empty((SEARCHES, 3)), np.empty((SEARCHES, 2))
    rng = np.array(random.state_from_seed(1))
    with tempfile.TemporaryDirectory() as folder:
        module = c_module(block, folder, "search").compile().load()

    def ours() -> np.ndarray:
        out, states = module.reset().replay_rows(curves)
        return np.concatenate([states[-1], out.ravel()])

    def simulated() -> np.ndarray:
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

    runs = [ours, simulated, *(peer(k) for k in range(3))]
    answers = [run() for run in runs]
    times = np.array([[_seconds(run) / SEARCHES for run in runs] for _ in range(rounds)])
    scipy = statistics.median(_seconds(lambda: _scipy(*curve)) for _ in range(3))
    mine = float(np.median(times[:, 0]))

    def row(who: int, peer: int) -> dict[str, float]:
        ratios = times[:, who] / times[:, peer]
        return {
            "ratio": float(np.median(ratios)),
            "ratio_min": float(np.quantile(ratios, 0.05)),
            "ratio_max": float(np.quantile(ratios, 0.95)),
            "ratio_fastest": float(times[:, who].min() / times[:, peer].min()),
            "ours_s": float(np.median(times[:, who])),
            "peer_s": float(np.median(times[:, peer])),
        }

    return {
        "ours_vs_c": row(0, 2),
        "ours_vs_c_without_copies": row(0, 3),
        "ours_vs_c_faster_generator": row(0, 4),
        "simulated_vs_c": row(1, 2),
        "scipy_vs_ours": {"ratio": scipy / mine, "ours_s": mine, "scipy_s": scipy},
        "evaluations": EVALUATIONS,
        "same_bits": all((answers[0] == other).all() for other in answers[1:4]),
    }


def _seconds(run: Callable[[], Any]) -> float:
    start = time.thread_time()
    run()
    return time.thread_time() - start


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
