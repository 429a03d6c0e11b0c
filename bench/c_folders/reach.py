"""What the test in the folder of every controller reaches: statements and branches of its C.

``python -m bench.c_folders.reach [STUDY[:LOOP] ...] [--out FILE]`` writes each folder as
``slipctl c`` does and counts by gcov, as ``--check`` does (:mod:`slipctl.ccode.check.coverage`).
What the file has already is not measured again. Exit code 1 where less than 95 % of the
reachable branches are reached.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.c_folders.written_folders import loops
from slipctl.ccode import codegen
from slipctl.ccode.check.coverage import REACHABLE, run_with_counters, share, summary
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan
from slipctl.run import store
from slipctl.study import resolve

LEAST = 0.95
"""Share of these branches that a test shall reach."""


def reached(name: str, real: str = "double") -> dict[str, Any]:
    """Coverage of the controller of one loop by its folder's own test."""
    study, _, loop_name = name.partition(":")
    declared = resolve.load_study(study)
    loop, case = resolve.find_loop(declared, loop_name)
    part = declared.controller
    inputs, params = codegen.record_part(loop, part, case.scenario, codegen.KEPT)
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch) / "c"
        codegen.export(
            loop[part], folder, "ctl", inputs=inputs, params=params, period=loop.period, real=real
        )
        plan = Plan(loop[part], "ctl", loop.period, real)
        found = run_with_counters(plan, folder, compilers.compilers())
    return found | {"missing": [m for m in found["missing"] if m["asked"]]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="*")
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    out = Path(options.out) if options.out else None
    rows: dict[str, dict[str, Any]] = {}
    if out and out.exists():  # a run that was stopped goes on
        rows = json.loads(out.read_text(encoding="utf-8"))["controllers"]
    few = 0
    for name in loops(options.loops):
        if name not in rows:
            rows[name] = reached(name)
            if out:
                store.write_json(out, {"format": 1, "controllers": rows})
        low = share(rows[name], REACHABLE) < LEAST
        few += low
        print(f"{name}: {summary(rows[name])}{', TOO FEW' * low}", flush=True)
    return 1 if few else 0


if __name__ == "__main__":
    sys.exit(main())
