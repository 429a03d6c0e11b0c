"""Altered command lines, files and calls for as long, or as many, as wanted.

``python tests/fuzz/run.py --seconds 60`` or ``--cases 100000 --out fuzz.json``; ``--seed`` has a
run again. A third of the cases are command lines with their files (curves, models, certificates),
a third are calls of public functions with a wrong argument, and a third are vehicle files,
expressions and logs. ``--only lines``, ``calls`` or ``desk`` makes one kind. What ends badly is
told with its seed and case. Ctrl-C ends it with what it has.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import random
import signal
import sys
import time
import warnings
from pathlib import Path

import calls
import test_commands
import test_desk

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


def lined(number: int, seed: int) -> list[tuple[str, str]]:
    """Command lines that end badly."""
    return [(f"seed {seed}: slipctl {' '.join(words)!a}", wrong)
            for words, wrong in test_commands.attack(number, seed)]  # fmt: skip


def described(number: int, seed: int) -> list[tuple[str, str]]:
    """Vehicle files, expressions and logs that end badly."""
    return [(f"seed {seed}: {kind} {text!a}", wrong)
            for (kind, text), wrong in test_desk.attack(number, seed)]  # fmt: skip


KINDS = {"lines": lined, "calls": called, "desk": described}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--cases", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--only", choices=list(KINDS))
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    for asked in (signal.SIGINT, signal.SIGTERM):
        signal.signal(asked, signal.default_int_handler)
    kinds = [chosen.only] if chosen.only else list(KINDS)
    start, done, found = time.monotonic(), dict.fromkeys(kinds, 0), []
    for seed in itertools.chain(KEPT, itertools.count(chosen.seed)):
        if sum(done.values()) >= chosen.cases or time.monotonic() - start > chosen.seconds:
            break
        try:
            for kind in kinds:
                for what, wrong in KINDS[kind](BATCH, seed):
                    found.append((what, wrong))
                    print(what, ascii(wrong)[:500], flush=True)
                done[kind] += BATCH
        except KeyboardInterrupt:
            break
    print(f"{sum(done.values())} cases, {len(found)} end badly")
    if chosen.out:
        told = {"seed": chosen.seed, **done, "wrong": found}
        chosen.out.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
