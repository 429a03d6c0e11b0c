"""Speed against peers, each as a ratio measured in one run: ``python -m bench.speed``.

Ours and the peer run in turn, so that a machine whose speed drifts harms both; a ratio is the
median over the pairs. Peers in C lie in ``slipctl/studies/peers`` and are compiled with the flags
of the toolkit.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from bench.peers import subway_loop
from slipctl import BadInput, __version__
from slipctl.run import build

PEERS = Path(__file__).parent / "peers"
TICKS = 6000


def ratio(ours: Callable[[], Any], peer: Callable[[], Any], pairs: int = 9) -> dict[str, float]:
    """Time two calls in turn.

    Returns:
        Median times in s, and the median, smallest and largest ratio ours / peer.
    """
    ours(), peer()
    rows = []
    for _ in range(pairs):
        t0 = time.perf_counter()
        ours()
        t1 = time.perf_counter()
        peer()
        rows.append((t1 - t0, time.perf_counter() - t1))
    ratios = [a / b for a, b in rows]
    return {
        "ours_s": statistics.median(a for a, _ in rows),
        "peer_s": statistics.median(b for _, b in rows),
        "ratio": statistics.median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
    }


def peer_library(name: str) -> ctypes.CDLL:
    """Compile a hand-written peer with the toolkit's flags and load it.

    Raises:
        BadInput: there is no C compiler.
    """
    cc = build.compiler()
    if cc is None:
        raise BadInput("speed needs a C compiler; install gcc or clang, or set CC")
    folder = Path(tempfile.mkdtemp(prefix="slipctl_peer_"))
    library = folder / f"{name}.so"
    source = PEERS / f"{name}.c"
    flags = [*build.FLAGS, "-fPIC", "-shared"]
    subprocess.run([cc, *flags, str(source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def loop() -> dict[str, Any]:
    """Closed loop `sta` on dry rail without DE: ours, hand-written C, Python floats, numpy."""
    from slipctl.studies.subway_braking.loops import MODELS, best, perfect

    block = perfect(MODELS, MODELS["sta"])
    v_opt, _ = best(MODELS["adh"], "dry")
    roller = build.compile_roller(block.f)
    library = peer_library("subway_loop")
    assert roller is not None
    x0 = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel().copy()
    feed = {"v_opt": v_opt, "a_demand": 10.0}
    u = np.tile([feed[n] for n in block.inputs], (TICKS, 1))
    x_log, y_log = np.empty((TICKS, x0.size)), np.empty((TICKS, block.f.size1_out(1)))

    def ours(ticks: int = TICKS) -> None:
        roller.roll(x0.copy(), u[:ticks], p, x_log[:ticks], y_log[:ticks])

    q = np.array(list(subway_loop.P.values()))
    peer_x, peer_y, v = np.empty((TICKS, 5)), np.empty((TICKS, 17)), np.full(TICKS, v_opt)

    def in_c() -> None:
        start = np.array([0.0, 20.0, 40.0, 0.0, 0.0])
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (start, v, v, q, peer_x, peer_y)]
        library.peer_loop(ctypes.c_long(TICKS), *pointers)

    found = {"ours_vs_c": ratio(ours, in_c, 21)}
    order = [list(block.states).index(f"plant.wheel.{n}") for n in ("x", "v", "omega", "phi")]
    found["ours_vs_c"]["largest_state_difference"] = float(
        np.abs(x_log[:, order] - peer_x[:, :4]).max()
    )
    few = 1500
    floats = ratio(lambda: ours(few), lambda: subway_loop.run_floats(few, v_opt), 5)
    arrays = ratio(lambda: ours(few), lambda: subway_loop.run_numpy(few, v_opt), 3)
    found["floats_vs_ours"] = {"ratio": 1 / floats["ratio"], **_times(floats)}
    found["numpy_vs_ours"] = {"ratio": 1 / arrays["ratio"], **_times(arrays)}
    return found


def _times(row: dict[str, float]) -> dict[str, float]:
    return {"ours_s": row["ours_s"], "peer_s": row["peer_s"]}


def search() -> dict[str, Any]:
    """One DE search in generated C: against hand-written C and scipy."""
    from bench.peers.bench_de import bench_de

    return bench_de()


def filtered() -> dict[str, Any]:
    """Closed loop of hst_braking with filter and gradient reference: hand-written C, do-mpc."""
    from bench.peers.hst_loop import bench

    return bench()


def identified() -> dict[str, Any]:
    """Running resistance by swarm from 3000 samples, in generated C: vectorised numpy."""
    from bench.peers.bench_pso import bench_pso

    return bench_pso()


def creep() -> dict[str, Any]:
    """25 s of the loops of freight_traction at 0.2 ms, against real time."""
    from slipctl.studies.freight_traction.loops import MODELS, cases

    found: dict[str, Any] = {}
    for case in cases(MODELS, quick=False):
        if case.scenario.name == "moving_optimum":
            continue
        block = case.loops["improved_robust"]
        roller = build.compile_roller(block.f)
        assert roller is not None
        assert block.period is not None
        ticks = round(25.0 / block.period)
        x0 = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
        p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel().copy()
        u = np.zeros((ticks, block.f.size1_in(1)))
        noise = np.random.default_rng(1).standard_normal(ticks)
        for k, (name, signal) in enumerate(block.inputs.items()):
            u[:, k] = noise if signal.noise else signal.value
            assert signal.size == 1, name
        x_log, y_log = np.empty((ticks, x0.size)), np.empty((ticks, block.f.size1_out(1)))
        times = []
        for _ in range(9):
            t0 = time.perf_counter()
            roller.roll(x0.copy(), u, p, x_log, y_log)
            times.append(time.perf_counter() - t0)
        median = statistics.median(times)
        found[f"real_time_vs_{case.scenario.name}"] = {
            "ours_s": median, "peer_s": 25.0, "ratio": 25.0 / median,
            "ratio_min": 25.0 / max(times), "ratio_max": 25.0 / min(times),
        }  # fmt: skip
    return found


def train() -> dict[str, Any]:
    """Train of hst_traction over 533 s: against real time, numpy arrays, and grouped axles."""
    from bench.peers.train_loop import bench

    return bench()


def predictive() -> dict[str, Any]:
    """One real-time iteration of nmpc in generated C: IPOPT, FATROP, OSQP, do-mpc."""
    from bench.peers.slip_nmpc import bench

    return bench()


def reach() -> dict[str, Any]:
    """Map of the super-twisting criteria and one exact verdict, against LMIs in cvxpy, Clarabel."""
    from bench.peers.twisting_lmi import bench

    return bench()


def start() -> dict[str, Any]:
    """``slipctl --help`` against an empty Python start, as whole processes."""

    def run(*words: str) -> Callable[[], None]:
        return lambda: subprocess.run([sys.executable, *words], check=True, capture_output=True)  # type: ignore[return-value]

    return {"help_vs_empty": ratio(run("-m", "slipctl", "--help"), run("-c", "pass"), 11)}


PLAIN = {
    "subway_braking": (12.0, 6.0),
    "hst_braking": (25.0, 12.0),
    "freight_traction": (30.0, 15.0),
    "hst_traction": (60.0, 30.0),
}
"""Wall time in s that a plain run may take on two quiet cores, cold and warm compile cache."""


def plain() -> dict[str, Any]:
    """Plain ``slipctl run`` of each study into an empty folder, cold and warm compile cache.

    Wall and processor time in s, children included, beside the wall time that is wanted. Python
    may keep its bytecode, as it does where nobody forbids it.
    """
    found: dict[str, Any] = {}
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    for name, wanted in PLAIN.items():
        with tempfile.TemporaryDirectory(prefix="slipctl_") as folder:
            environment = kept | {"SLIPCTL_CACHE": f"{folder}/cache"}
            for state, goal in zip(("cold", "warm"), wanted, strict=True):
                command = [sys.executable, "-m", "slipctl", "-q", "run", name, "--out",
                           f"{folder}/{state}"]  # fmt: skip
                before, began = os.times(), time.perf_counter()
                subprocess.run(command, check=True, capture_output=True, env=environment)
                wall, after = time.perf_counter() - began, os.times()
                used = after.children_user + after.children_system
                used -= before.children_user + before.children_system
                found[f"{name}_{state}"] = {"wall_s": wall, "cpu_s": used, "wanted_s": goal}
    return found


def steps() -> dict[str, Any]:
    """A controller's step in generated C, guards and status included, against hand-written C."""
    from bench.peers.steps import bench

    return bench(101)


BENCHMARKS: dict[str, Callable[[], dict[str, Any]]] = {
    "loop": loop,
    "search": search,
    "filtered": filtered,
    "steps": steps,
    "identified": identified,
    "creep": creep,
    "train": train,
    "predictive": predictive,
    "reach": reach,
    "start": start,
    "plain": plain,
}


def machine() -> dict[str, str]:
    """Machine and versions that the numbers belong to."""
    names = ("casadi", "numpy", "scipy")
    cc = build.compiler()
    shown = subprocess.run([cc, "--version"], capture_output=True, text=True).stdout if cc else ""
    return {
        "processor": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "compiler": shown.split("\n")[0],
        "slipctl": __version__,
        **{n: version(n) for n in names},
    }


def main(words: list[str] | None = None) -> int:
    """Run the benchmarks named, or all, and write ``speed.json``."""
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("name", nargs="*", help=f"of {', '.join(BENCHMARKS)}; all by default")
    parser.add_argument("--out", default="speed.json", help="file to write")
    chosen = parser.parse_args(words)
    for name in chosen.name:
        if name not in BENCHMARKS:
            print(
                f"slipctl: no benchmark {name!r}; it has {', '.join(BENCHMARKS)}", file=sys.stderr
            )
            return 2
    results: dict[str, Any] = {}
    for name in chosen.name or BENCHMARKS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        results[name] = BENCHMARKS[name]()
        for key, row in results[name].items():
            shown = row["ratio"] if isinstance(row, dict) and "ratio" in row else row
            print(f"{name:8s} {key:24s} {shown}")
    from slipctl.run import store

    store.write_json(
        Path(chosen.out), {"format": 1, "machine": machine(), "ticks": TICKS, "results": results}
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
