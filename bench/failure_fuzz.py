"""libFuzzer against what the failure concept of a vehicle's controllers promises.

``python -m bench.failure_fuzz FILE[:CONTROLLER] [--seconds N] [--out FILE]`` writes the C of every
controller of a vehicle file and hands any bits to the sensors of its first axle
(``bench/loops/failure_fuzz.c``). Exit code 1 where a promise is broken.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.check import fuzz
from slipctl.ccode.codegen import c_module
from slipctl.run import store
from slipctl.study.request import Request

HARNESS = Path(__file__).parent / "loops" / "failure_fuzz.c"
FLAGS = ("-O1", "-g", "-ffp-contract=off", "-fno-sanitize-recover=all",
         "-fsanitize=fuzzer,undefined")  # fmt: skip
LONGEST = 2000
"""Bytes of an input at most, a hundred records."""


def fuzzed(name: str, seconds: int) -> dict[str, Any]:
    """How often a controller was tried, and the input that broke a promise, if one did.

    Args:
        name: ``FILE:CONTROLLER``. seconds: for libFuzzer.
    """
    asked = Request.read(name).needs_loop()
    runs = runs_of_part(asked.chosen[0], asked.study.controller)
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch)
        c_module(runs.block, folder, "ctl", period=runs.period)
        subprocess.run(
            [fuzz.tool(), *FLAGS, "-DM=ctl", '-DHDR="ctl.h"', "-I", scratch, str(HARNESS),
             str(folder / "ctl.c"), "-lm", "-o", str(folder / "fuzz")],
            check=True, capture_output=True,
        )  # fmt: skip
        ran = subprocess.run(
            [str(folder / "fuzz"), f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-seed=1",
             "-print_final_stats=1", "-timeout=60", f"-artifact_prefix={scratch}/"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        broken = sorted(folder.glob("crash-*"))
        trials = re.search(r"number_of_executed_units:\s*(\d+)", ran.stderr)
        return {
            "seconds": seconds, "trials": int(trials[1]) if trials else 0,
            "passed": ran.returncode == 0 and not broken,
            "input": broken[0].read_bytes().hex() if broken else "",
        }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz each and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    names = [options.name]
    if ".toml:" not in options.name:
        case = Request.read(options.name).cases[0]
        names = [f"{options.name}:{n}" for n, b in case.loops.items() if "ctl.trust" in paths(b)]
    rows = {}
    for name in names:
        rows[name.rpartition(":")[2]] = row = fuzzed(name, options.seconds)
        said = "kept" if row["passed"] else f"BROKEN by {row['input']}"
        print(f"{name}: {row['trials']} inputs, every promise {said}", flush=True)
        if options.out:
            store.write_json(Path(options.out), {"controllers": rows})
    return 0 if all(r["passed"] for r in rows.values()) else 1


def paths(loop: Any) -> list[str]:
    """Paths of the parts of a controller of a loop."""
    return [f"ctl.{n}" for n in runs_of_part(loop, "ctl").block.parts]


if __name__ == "__main__":
    sys.exit(main())
