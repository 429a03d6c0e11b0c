"""Identification by swarm in generated C against vectorised numpy, at the same budget."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import linear_fit, misfit_search
from slipctl.ccode.codegen import c_module
from slipctl.models.cheng_2022.freight_resistance import BOX, specific_resistance, swarm_settings
from slipctl.studies.freight_traction.identification import NOISE, samples

SAMPLES = 3000
SETTINGS = swarm_settings()


def bench_pso(rounds: int = 15) -> dict[str, Any]:
    """Time the identification of the running resistance from 3000 samples.

    Ours is the C that ``c_module`` writes: every sample through ``linear_fit``, then one search of
    60 particles and 300 iterations. Beside it is the same swarm in numpy, all particles at once.
    Over the samples, as (21) of Cheng 2022 has it; and, as a second row, both only search, over the
    nine numbers that the samples come down to. Times are processor times of this thread.

    Args:
        rounds: how often ours runs; numpy over the samples runs three times at most.

    Returns:
        ``numpy_vs_ours`` and ``numpy_vs_ours_search``, each with ``ratio`` (median time of the
        peer over the median of ours), ``ours_s`` and ``peer_s``; ``difference``: the largest one of
        a coefficient between ours and numpy, relative.

    Raises:
        BadInput: there is no C compiler.
    """
    data = samples(np.linspace(0, 20, SAMPLES), NOISE, 1)
    search = misfit_search(specific_resistance, BOX, **SETTINGS)
    fit = linear_fit(specific_resistance, noise=NOISE)
    with tempfile.TemporaryDirectory() as folder:
        sums = c_module(fit, Path(folder) / "fit", "fit").compile().load()
        swarm = c_module(search, Path(folder) / "search", "search").compile().load()
    rows = np.column_stack([data[k] for k in fit.inputs])
    given = np.array([list(fit.outputs).index(k) for k in search.inputs])
    edges = np.cumsum([0, *(s.size for s in fit.outputs.values())])[given]

    def summed() -> np.ndarray:
        return np.asarray(sums.reset().replay_rows(rows)[0][-1:, edges])

    def ours() -> np.ndarray:
        return np.asarray(swarm.reset().replay_rows(summed())[0][0, :3])

    information = summed()
    R, z = np.zeros((3, 3)), information[0, 6:]
    R[np.triu_indices(3)] = information[0, :6]
    regressor = np.stack([data["v"] ** k for k in range(3)], axis=1)

    def over_samples() -> np.ndarray:
        return numpy_swarm(lambda x: _half_squares(x @ regressor.T - data["y"]))

    def over_sums() -> np.ndarray:
        return numpy_swarm(lambda x: _half_squares(x @ R.T - z))

    def row(mine: Callable[[], Any], peer: Callable[[], Any], times: int) -> tuple[Any, Any]:
        found, ours_s = _timed(mine, rounds)
        peers, peer_s = _timed(peer, times)
        return found / peers - 1, {"ratio": peer_s / ours_s, "ours_s": ours_s, "peer_s": peer_s}

    def only_search() -> np.ndarray:
        return np.asarray(swarm.reset().replay_rows(information)[0][0, :3])

    difference, whole = row(ours, over_samples, min(rounds, 3))
    return {
        "numpy_vs_ours": whole,
        "numpy_vs_ours_search": row(only_search, over_sums, rounds)[1],
        "difference": float(np.abs(difference).max()),
    }


def _timed(run: Callable[[], np.ndarray], times: int) -> tuple[np.ndarray, float]:
    """What a call gives, and the median of its processor times in s."""
    taken = []
    for _ in range(times):
        start = time.thread_time()
        found = run()
        taken.append(time.thread_time() - start)
    return found, float(np.median(taken))


def numpy_swarm(cost: Callable[[np.ndarray], np.ndarray], seed: int = 1) -> np.ndarray:
    """Best place of a swarm over ``BOX``, all particles of an iteration at once."""
    rng, n = np.random.default_rng(seed), SETTINGS["particles"]
    lo, hi = np.array(list(BOX.values())).T
    most = SETTINGS["clamp"] * (hi - lo)
    x = lo + (hi - lo) * rng.random((n, 3))
    v, own, least = np.zeros((n, 3)), x.copy(), cost(x)
    for _ in range(SETTINGS["iterations"]):
        best = own[np.argmin(least)]
        v = (
            SETTINGS["inertia"] * v
            + SETTINGS["c1"] * rng.random((n, 3)) * (own - x)
            + SETTINGS["c2"] * rng.random((n, 3)) * (best - x)
        )
        v = np.clip(v, -most, most)
        x = np.clip(x + v, lo, hi)
        value = cost(x)
        better = value < least
        own[better], least[better] = x[better], value[better]
    return np.asarray(own[np.argmin(least)])


def _half_squares(e: np.ndarray) -> np.ndarray:
    return 0.5 * np.einsum("ij,ij->i", e, e)
