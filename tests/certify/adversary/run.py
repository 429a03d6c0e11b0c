"""Hold every verdict of certify against the adversaries: python tests/certify/adversary/run.py.

By hand before an issue is closed, 10 000 cases a system; exits with 1 if a verdict was false. With
--out the outcome goes into a file, where systems that were not run keep what they had.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # --jobs says how many cores are taken
sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.append(str(Path(__file__).parents[3]))

from adversary import common, smooth_loops, switched_ticks, user_ticks

BLOCK = 100
"""Cases of one trial."""

OTHERS = {
    "user_ticks": user_ticks.trial, "cells": switched_ticks.trial, "sums": smooth_loops.trial,
    "tube": smooth_loops.trial_of_tubes,
}  # fmt: skip
"""Trials that are of no system with numbers of its own."""


def block(name: str, n: int, seed: int) -> common.Tally:
    """One trial of a system, or of ticks that somebody wrote."""
    if name in OTHERS:
        return OTHERS[name](n, seed)
    return common.trial(common.adversaries()[name], n, seed, every=10)


def recorded(out: Path, name: str, entry: dict[str, Any]) -> None:
    """Write the outcome of a system into a file of evidence, beside those of the others."""
    from bench import speed
    from slipctl.run import store

    numbers: dict[str, Any] = {}
    if out.exists():
        numbers = json.loads(out.read_text(encoding="utf-8"))["numbers"]
    numbers[name] = {
        **entry,
        "date": datetime.date.today().isoformat(),
        "versions": speed.machine(),
    }
    command = (
        "python tests/certify/adversary/run.py --cases 10000 --out docs/evidence/adversary.json"
    )
    store.write_json(
        out, {"format": 1, "command": command, "numbers": dict(sorted(numbers.items()))}
    )


def main() -> int:
    """Run what is asked for."""
    known = [*common.adversaries(), *OTHERS]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems", nargs="*", default=known, metavar="SYSTEM")
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    false = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.systems or known:
            start, tally = perf_counter(), common.Tally()
            sizes = [min(BLOCK, options.cases - at) for at in range(0, options.cases, BLOCK)]
            jobs = [pool.submit(block, name, n, options.seed * 1000 + i)
                    for i, n in enumerate(sizes)]  # fmt: skip
            for job in jobs:
                tally.add(job.result())
                if options.out:  # so far, should it be stopped
                    recorded(options.out, name, {"seed": options.seed, **tally.payload()})
            false += len(tally.false_certified) + len(tally.false_refuted)
            print(f"{name}: {tally.certified} CERTIFIED, {tally.refuted} REFUTED,"
                  f" {tally.undecided} UNDECIDED ({tally.share_undecided:.1%});"
                  f" false {len(tally.false_certified)} and {len(tally.false_refuted)};"
                  f" {perf_counter() - start:.0f} s", flush=True)  # fmt: skip
            for text in (*tally.false_certified, *tally.false_refuted):
                print(f"  {text}", flush=True)
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
