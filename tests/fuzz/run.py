"""Altered command lines, files and calls for as long, or as many, as wanted.

``python tests/fuzz/run.py --seconds 60`` or ``--cases 100000 --out fuzz.json``; ``--seed`` has a
run again. A third of the cases are command lines with their files (curves, models, certificates),
a third are calls of public functions with a wrong argument, and a third are vehicle files,
expressions and logs. ``--only lines``, ``calls`` or ``desk`` makes one kind. What ends badly is
told with its seed and case. Ctrl-C ends it with what it has. The file of ``--out`` is written as it
goes, and the same line again goes on from there.
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
from typing import Any

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


def begun(out: Path | None, seed: int, kinds: list[str]) -> dict[str, Any]:
    """What an earlier run of the same has found, or nothing yet."""
    fresh = {"seed": seed, **dict.fromkeys(kinds, 0), "seeds": 0, "wrong": []}
    if out is None or not out.exists():
        return fresh
    found = json.loads(out.read_text(encoding="utf-8"))
    if found.get("seed") != seed or list(found) != list(fresh):
        sys.exit(f"{out} is of another run; remove it, or give the same --seed and --only")
    return found


def keep(out: Path, told: dict[str, Any]) -> None:
    """Write what was found, whole or not at all."""
    part = out.with_name(out.name + ".part")
    part.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    part.replace(out)


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
    start, told = time.monotonic(), begun(chosen.out, chosen.seed, kinds)
    seeds = itertools.chain(KEPT, itertools.count(chosen.seed))
    for seed in itertools.islice(seeds, told["seeds"], None):
        many = sum(told[kind] for kind in kinds)
        if many >= chosen.cases or time.monotonic() - start > chosen.seconds:
            break
        try:
            new = [(kind, case) for kind in kinds for case in KINDS[kind](BATCH, seed)]
        except KeyboardInterrupt:
            break
        for _, (what, wrong) in new:
            print(what, ascii(wrong)[:500], flush=True)
        told["wrong"] += [list(case) for _, case in new]
        told["seeds"] += 1
        for kind in kinds:
            told[kind] += BATCH
        if chosen.out:
            keep(chosen.out, told)
    found = told["wrong"]
    print(f"{sum(told[kind] for kind in kinds)} cases, {len(found)} end badly")
    if chosen.out:
        keep(chosen.out, told)
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
