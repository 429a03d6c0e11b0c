"""What a sweep costs beside what it rolls: ``python -m bench.sweeps``.

1000 runs of ``hst_braking:eppfc`` with a gain drawn in each, the compile cache warm. All is told as
ratios of one session: processor time a run against the compiled roll alone, and speed against a
pool of processes that calls ``with_params`` and ``simulate``. Then what a second core is worth,
memory, and speed on a cluster on this machine.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import Block, Scenario, Signals, prepare, simulate, sweep
from slipctl.run import build, machine, store
from slipctl.run.sweep.sweep_plan import plan_of
from slipctl.study.resolve import find_loop, load_study

LOOP = ("hst_braking", "eppfc")
VARY = ["ctl.law.K1=5:50"]
SHORT = 0.3
"""Duration in s of the runs whose memory is looked at."""


@cache
def asked(duration: float | None = None) -> tuple[Block, Scenario, Signals]:
    """The loop, what happens, and what the metrics speak of."""
    study = load_study(LOOP[0])
    loop, case = find_loop(study, LOOP[1])
    scenario = case.scenario if duration is None else case.scenario.but(duration=duration)
    return loop, scenario, study.signals


def swept(
    out: Path, samples: int, duration: float | None = None, jobs: int = 1, scheduler: str = ""
) -> float:
    """Sweep, and give the wall time in s."""
    loop, scenario, signals = asked(duration)
    began = time.perf_counter()
    sweep(loop, scenario, VARY, out, samples=samples, signals=signals, jobs=jobs,
          scheduler=scheduler)  # fmt: skip
    return time.perf_counter() - began


def cpu(call: Callable[[], Any]) -> float:
    """Processor time in s of a call, its threads included."""
    began = time.process_time()
    call()
    return time.process_time() - began


def roll_alone(runs: int) -> Callable[..., None]:
    """So many compiled rolls, of inputs and numbers that are ready."""
    loop, scenario, _ = asked()
    whole = prepare(loop, scenario).whole({})
    roller = build.compile_roller(whole.f)
    assert roller is not None
    x, y = np.empty_like(whole.x), np.empty_like(whole.y)

    def rolls(ticks: int | None = None) -> None:
        for _ in range(runs):
            now = whole.x[0].copy()
            for first, last, p in whole.parts if ticks is None else [(0, ticks, whole.parts[0][2])]:
                rows = slice(first, last)
                roller.roll(now, whole.u[rows], p, x[rows], y[rows])

    return rolls


def over_the_roll(samples: int, rounds: int) -> dict[str, float]:
    """Processor time of a run against the compiled roll alone; both in turn, on one thread.

    The sweep is made in rounds that extend it. What it costs to open one counts once, as it would
    in a single call.
    """
    each = samples // rounds
    rolls = roll_alone(each)
    rolls()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        opened = [cpu(lambda: swept(out, 1))]
        rows = []
        for k in range(rounds):
            alone = cpu(rolls)
            grown = cpu(lambda k=k: swept(out, 1 + each * (k + 1)))  # type: ignore[misc]
            opened.append(cpu(lambda k=k: swept(out, 1 + each * (k + 1))))  # type: ignore[misc]
            rows.append((grown, alone))
    opening = statistics.median(opened[1:])
    ratios = [(grown - opening) / alone for grown, alone in rows]
    total = sum(alone for _, alone in rows)
    return {
        "roll_cpu_s": total / samples, "opening_cpu_s": opening,
        "ratio": statistics.median(ratios) + opening / total,
        "ratio_min": min(ratios) + opening / total, "ratio_max": max(ratios) + opening / total,
        "wanted_at_most": 1.15,
    }  # fmt: skip


def one_call() -> dict[str, float]:
    """What it would save at most to roll several runs in one call: a call of one tick."""
    rolls = roll_alone(3)
    calls = roll_alone(3000)
    whole = cpu(rolls) / 3
    call = cpu(lambda: calls(1)) / 3000
    return {"call_of_one_tick_cpu_s": call, "share_of_a_run": call / whole}


def _simulated(gain: float) -> float:
    """Processor time in s of one run as it is made without a sweep."""
    loop, scenario, _ = asked()
    return cpu(lambda: simulate(loop.with_params(**{"ctl.law.K1": gain}), scenario))


def against_processes(samples: int, few: int, pairs: int) -> dict[str, float]:
    """A sweep on all cores against a pool of two processes, time of a run, in turn.

    The pool keeps its loop, is warm, and measures nothing. ``cpu_ratio`` is that of processor
    times, which do not depend on what else runs.
    """
    loop, scenario, _ = asked()
    plan = plan_of(loop, scenario, VARY, samples)
    gains = [plan.numbers(k)["ctl.law.K1"] for k in range(few)]
    each = samples // pairs
    rows = []
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(2) as pool:
        list(pool.map(_simulated, gains[:4], chunksize=2))
        for k in range(pairs):
            before = time.process_time()
            ours = swept(Path(folder) / str(k), each, jobs=2) / each
            used = (time.process_time() - before) / each
            began = time.perf_counter()
            theirs = sum(pool.map(_simulated, gains, chunksize=max(few // 8, 1))) / few
            rows.append((ours, (time.perf_counter() - began) / few, used, theirs))
    ratios = [pool_s / ours for ours, pool_s, _, _ in rows]
    return {"ours_s": statistics.median(r[0] for r in rows),
            "pool_s": statistics.median(r[1] for r in rows),
            "ratio": statistics.median(ratios), "ratio_min": min(ratios),
            "ratio_max": max(ratios), "wanted_at_least": 3.0,
            "cpu_ratio": statistics.median(b / a for _, _, a, b in rows)}  # fmt: skip


def second_core(samples: int, pairs: int) -> dict[str, float]:
    """Wall time of a sweep on one thread over that on two, in turn; says how busy the cores were.

    ``share_of_two_cores`` is the processor time that the two threads got, as a share of two cores:
    where others run too, it bounds what a second one can be worth.
    """
    ratios, shares = [], []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(pairs):
            one = swept(Path(folder) / f"one{k}", samples, jobs=1)
            began = time.process_time()
            two = swept(Path(folder) / f"two{k}", samples, jobs=2)
            shares.append((time.process_time() - began) / two / 2)
            ratios.append(one / two)
    return {"ratio": statistics.median(ratios), "ratio_min": min(ratios),
            "ratio_max": max(ratios), "share_of_two_cores": statistics.median(shares),
            "wanted_at_least": 1.8}  # fmt: skip


def memory(few: int, many: int) -> dict[str, float]:
    """Largest resident memory of a process that sweeps few runs, and of one that sweeps many.

    The runs are cut short, as what is kept of a run does not depend on its length.
    """

    def apart(samples: int) -> float:
        words = [sys.executable, "-m", "bench.sweeps", "--peak", str(samples)]
        done = subprocess.run(words, check=True, capture_output=True, text=True)
        return float(done.stdout)

    a, b = apart(few), apart(many)
    return {"duration_s": SHORT, f"peak_of_{few}_runs_MiB": a, f"peak_of_{many}_runs_MiB": b,
            "kB_a_run": 1024 * (b - a) / (many - few)}  # fmt: skip


def peak(samples: int) -> float:
    """Largest resident memory in MiB of this process after a sweep of short runs."""
    with tempfile.TemporaryDirectory() as folder:
        swept(Path(folder), samples, SHORT, jobs=2)
    status = Path("/proc/self/status").read_text(encoding="utf-8")  # rusage has the parent's too
    line = next(row for row in status.splitlines() if row.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


def on_a_cluster(samples: int, pairs: int) -> dict[str, float] | None:
    """Speed on a ``LocalCluster`` of two workers against two threads, the start not counted.

    ``cpu_ratio`` is the same of processor times, scheduler and both workers included: it does not
    depend on what else runs.
    """
    if find_spec("distributed") is None:
        return None
    import psutil
    from distributed import LocalCluster

    rows = []
    with (
        tempfile.TemporaryDirectory() as folder,
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
    ):
        address = cluster.scheduler_address
        every = [psutil.Process(w.pid) for w in cluster.workers.values()] + [psutil.Process()]

        def used(call: Callable[[], float]) -> tuple[float, float]:
            before = sum(sum(p.cpu_times()[:2]) for p in every)
            wall = call()
            return wall, sum(sum(p.cpu_times()[:2]) for p in every) - before

        swept(Path(folder) / "warm", 2, scheduler=address)
        for k in range(pairs):
            rows.append((
                used(lambda k=k: swept(Path(folder) / f"t{k}", samples, jobs=2)),  # type: ignore[misc]
                used(lambda k=k: swept(Path(folder) / f"c{k}", samples, scheduler=address)),  # type: ignore[misc]
            ))  # fmt: skip
    ratios = [threads / workers for (threads, _), (workers, _) in rows]
    return {"ratio": statistics.median(ratios), "ratio_min": min(ratios),
            "ratio_max": max(ratios), "wanted_at_least": 0.8,
            "cpu_ratio": statistics.median(t / w for (_, t), (_, w) in rows)}  # fmt: skip


def bench(samples: int = 1000, many: int = 10_000, only: Sequence[str] = ()) -> dict[str, Any]:
    """All of it, or what is named; the slower sides make fewer runs."""
    few, rounds = max(samples // 10, 2), 5 if samples >= 100 else 1
    pairs = min(rounds, 3)
    parts: dict[str, Callable[[], Any]] = {
        "over_the_roll": lambda: over_the_roll(samples, rounds),
        "one_call": one_call,
        "against_processes": lambda: against_processes(samples, few, pairs),
        "second_core": lambda: second_core(few, rounds),
        "memory": lambda: memory(min(samples, many // 2), many),
        "cluster": lambda: on_a_cluster(2 * few, pairs),
    }
    found: dict[str, Any] = {"runs": samples, "cores": machine.cores()}
    for name in only or parts:
        row = parts[name]()
        found[name] = row and {**row, "load": round(os.getloadavg()[0], 1)}
        print(name, found[name], flush=True)
    return found


def main(words: list[str] | None = None) -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("name", nargs="*", help="what to measure; all by default")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--many", type=int, default=10_000, help="runs whose memory is looked at")
    parser.add_argument("--out", default="sweep.json")
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args(words)
    if chosen.peak:
        print(peak(chosen.peak))
        return 0
    store.write_json(Path(chosen.out), bench(chosen.runs, chosen.many, chosen.name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
