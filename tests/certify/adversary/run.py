"""Hold every verdict of certify against the adversaries: python tests/certify/adversary/run.py.

By hand before an issue is closed, 10 000 cases a system; exits with 1 if a verdict was false. With
--out the outcome goes into a file, where systems that were not run keep what they had. It is
written after each hundred cases; --more goes on with what it holds of the same seed and code.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import inspect
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


def code(name: str) -> str:
    """Sum over the code that decides about a system and that attacks."""
    root, here, found = Path(__file__).parents[3], Path(__file__).parent, hashlib.sha256()
    attack = list(here.glob("*.py"))
    if name in OTHERS:
        attack = [here / "common.py", Path(inspect.getfile(OTHERS[name]))]
    for path in (*sorted((root / "slipctl" / "certify").rglob("*.py")), *sorted(attack)):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def kept(out: Path | None) -> dict[str, Any]:
    """Outcomes in a file of evidence, by system."""
    if out is None or not out.exists():
        return {}
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))["numbers"]
    return found


def recorded(out: Path, name: str, entry: dict[str, Any]) -> None:
    """Write the outcome of a system into a file of evidence, beside those of the others."""
    from bench import speed
    from slipctl.run import store

    numbers = kept(out)
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
    parser.add_argument("--more", action="store_true")
    options = parser.parse_args()
    false = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.systems or known:
            start, tally, before = perf_counter(), common.Tally(), kept(options.out).get(name, {})
            same = {"seed": options.seed, "code": code(name)}
            if options.more and same.items() <= before.items():
                tally = common.Tally.of(before)
            jobs = [pool.submit(block, name, min(BLOCK, options.cases - at),
                                options.seed * 1000 + at // BLOCK)
                    for at in range(tally.cases, options.cases, BLOCK)]  # fmt: skip
            for job in jobs:
                tally.add(job.result())
                if options.out:  # so far, should it be stopped
                    recorded(options.out, name, {**same, **tally.payload()})
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
