"""What ``slipctl tune`` costs and gains: ``python -m bench.tuning --out FILE``.

Two gains of ``subway_braking:sta`` and six numbers of ``hst_braking:eppfc``, each over 20 draws and
judged on 200 held-out ones, the compile cache warm. The machine may be shared, so processor time of
all cores is told beside wall time: a quiet machine takes no longer than that.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from bench import speed
from slipctl.design.promises import promises_of_loop
from slipctl.design.tune import Tuned, tune
from slipctl.run import store
from slipctl.study.resolve import find_loop, load_study

SAMPLES, HELD_OUT = 20, 200

GRID = 100
"""Points along a number of a grid of 1 % of its range."""

WITHIN = {"subway_braking:sta": 20.0, "hst_braking:eppfc": 120.0}
"""Seconds on two cores that are wanted."""

FREE: dict[str, dict[str, Any]] = {
    "subway_braking:sta": {"k1": (1, 60), "k2": (1, 60)},
    "hst_braking:eppfc": {"K1": (20, 400), "eta_0": (0.02, 0.2), "eta_inf": (0.002, 0.02),
                          "k": (0.2, 5), "delta_l": (0.6, 1.5), "delta_u": (0.6, 1.5)},
}  # fmt: skip


def tuned(name: str, samples: int, held_out: int, runs: int | None = None) -> Tuned:
    """Tune a loop of a study in its first scenario that has an ensemble."""
    study = load_study(name.partition(":")[0])
    loop_name = name.partition(":")[2]
    scenario = next(iter(study.ensembles))
    loop, case = find_loop(study, f"{loop_name}@{scenario}")
    return tune(
        loop, FREE[name], "distance", study.ensembles[scenario], scenario=case.scenario,
        signals=study.signals, known=case.known,
        gains=promises_of_loop(study.certificates.gains, loop_name, scenario),
        samples=samples, held_out=held_out, runs=runs, controller=study.controller,
    )  # fmt: skip


def row(
    name: str, samples: int = SAMPLES, held_out: int = HELD_OUT, runs: int | None = None
) -> Mapping[str, Any]:
    """Tune, and tell what it took and what it brought."""
    wall, cpu = perf_counter(), process_time()
    found = tuned(name, samples, held_out, runs)
    wall, cpu = perf_counter() - wall, process_time() - cpu
    assert found.judged is not None
    error = found.judged.error
    numbers = len(FREE[name])
    said = {
        "numbers": numbers, "draws": samples, "held_out": held_out, "runs": found.search.spent,
        "cpu_s": round(cpu, 1), "wall_s": round(wall, 1), "wanted_s": WITHIN[name],
        "gains": dict(found.gains), "tuned_minus_by_hand_m": found.judged.difference,
        "standard_error_m": error, "not_worse": bool(found.judged.difference <= error),
        "margins": {k: list(v) for k, v in found.margins.items()},
    }  # fmt: skip
    if numbers == 2:
        of_grid = GRID**numbers * samples
        said |= {"runs_of_a_1_percent_grid": of_grid, "fewer": of_grid / found.search.spent}
    return said


def main(words: Sequence[str] | None = None) -> int:
    """Measure and write; exits with 1 where tuned gains are worse than those by hand."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("loops", nargs="*", default=list(FREE))
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(words)
    numbers = {}
    for name in chosen.loops:
        tuned(name, 4, 2, runs=4)  # fills the compile cache
        numbers[name] = row(name)
        print(name, numbers[name], flush=True)
        if chosen.out:
            store.write_json(chosen.out, {
                "format": 1, "command": "python -m bench.tuning",
                "date": datetime.date.today().isoformat(), "versions": speed.machine(),
                "numbers": numbers,
            })  # fmt: skip
    return 0 if all(n["not_worse"] for n in numbers.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
