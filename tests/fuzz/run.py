"""Altered command lines, files and calls for as long, or as many, as wanted.

``python tests/fuzz/run.py --seconds 60`` or ``--cases 100000 --out fuzz.json``; ``--seed`` has a
run again. Half of the cases are command lines with their files (curves, models, certificates),
half are calls of public functions with a wrong argument. What ends badly is told with its seed
and case.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import random
import sys
import time
import warnings
from pathlib import Path

import calls
import test_commands

BATCH = 50
KEPT = (1, 2)
"""Seeds that found something once: they are run first."""


def called(number: int, seed: int) -> list[tuple[str, str]]:
    """Wrong calls drawn by seed that end badly."""
    every = list(calls.wrong_calls())
    found = []
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        for name, place, call in random.Random(seed).sample(every, min(number, len(every))):
            wrong = calls.answer(name, call)
            if wrong:
                found.append((f"seed {seed}: {name}({place})", wrong))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--cases", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    start, done, found = time.monotonic(), {"lines": 0, "calls": 0}, []
    for seed in itertools.chain(KEPT, itertools.count(chosen.seed)):
        if sum(done.values()) >= chosen.cases or time.monotonic() - start > chosen.seconds:
            break
        for words, wrong in test_commands.attack(BATCH, seed):
            found.append((f"seed {seed}: slipctl {' '.join(words)!a}", wrong))
        found += called(BATCH, seed)
        done = {"lines": done["lines"] + BATCH, "calls": done["calls"] + BATCH}
    for what, wrong in found:
        print(what, ascii(wrong)[:500])
    print(f"{sum(done.values())} cases, {len(found)} end badly")
    if chosen.out:
        told = {"seed": chosen.seed, **done, "wrong": found}
        chosen.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
