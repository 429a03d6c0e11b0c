"""The folder of every controller as ``slipctl c`` writes it: does its ``make test`` pass?

``python -m bench.c_folders.written_folders [STUDY[:LOOP] ...] [--real double float]`` writes
each in a process of its own, tells time and memory that this took, and runs ``make test`` in it.
Exit code 1 where a test fails, or writing took longer than 10 s or more than 500 MB.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from slipctl.run import store
from slipctl.study import resolve

SECONDS, MEGABYTES = 10.0, 500.0
"""What writing a folder may take."""


def loops(wanted: Sequence[str]) -> Iterator[str]:
    """``STUDY:LOOP`` of each loop with a controller, or of those wanted."""
    for name in wanted or resolve.studies():
        if ":" in name:
            yield name
            continue
        study = resolve.load_study(name)
        cases = resolve.build_cases(study)
        for one in dict.fromkeys(n for case in cases for n in case.loops):
            loop, _ = resolve.pick_loop(study, cases, one)
            if study.controller in loop.parts:
                yield f"{name}:{one}"


def written(name: str, real: str) -> dict[str, Any]:
    """Write a folder and run its test.

    Returns:
        ``code`` of ``slipctl c``, ``seconds`` (elapsed and of the processor), ``megabytes`` at
        most, and the last line of ``make test``; ``passed``.
    """
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch) / "c"
        call = [sys.executable, "-m", "slipctl", "c", name, "--out", str(folder), "--real", real]
        began = time.perf_counter()
        process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        assert process.stderr is not None
        told = process.stderr.read().decode()
        _, code, used = os.wait4(process.pid, 0)
        process.returncode = code
        elapsed = time.perf_counter() - began
        found: dict[str, Any] = {
            "code": os.waitstatus_to_exitcode(code),
            "seconds": round(elapsed, 2),
            "processor_seconds": round(used.ru_utime + used.ru_stime, 2),
            "megabytes": round(used.ru_maxrss / 1024, 1),
        }
        if found["code"]:
            return found | {"test": told.strip().splitlines()[-1:], "passed": False}
        test = subprocess.run(
            ["make", "test"], cwd=folder, capture_output=True, text=True, check=False
        )
        last = (test.stdout + test.stderr).strip().splitlines()[-1:]
        return found | {"test": last, "passed": test.returncode == 0}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write and test."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="*")
    parser.add_argument("--real", nargs="+", default=["double", "float"])
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    rows: dict[str, dict[str, Any]] = {}
    failed = 0
    for name in loops(options.loops):
        for real in options.real:
            row = written(name, real)
            slow = row["processor_seconds"] > SECONDS or row["megabytes"] > MEGABYTES
            failed += slow or not row["passed"]
            rows[f"{name} {real}"] = row
            print(
                f"{name} {real}: {'passed' if row['passed'] else 'FAILED ' + str(row['test'])},"
                f" {row['processor_seconds']:.1f} s of the processor, {row['megabytes']:.0f} MB"
                f"{', TOO MUCH' * slow}",
                flush=True,
            )
            if options.out:
                store.write_json(Path(options.out), {"format": 1, "folders": rows})
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
