"""What Frama-C proves of the C of every controller: alarms, ranges of states and outputs.

``python -m bench.c_folders.proofs [STUDY[:LOOP] ...] [--real double float] [--once]
[--out FILE]`` does for each what ``slipctl c --prove`` does. Exit code 1 where something is left
open. ``--once`` leaves out the run in which NaN and infinity are alarms too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.c_folders.written_folders import loops
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.module.plan import Plan
from slipctl.run import store
from slipctl.study import resolve


def proven(name: str, real: str, finite: bool) -> dict[str, Any]:
    """What is proven of the controller of one loop, also of ``finite`` numbers alone."""
    study, _, loop_name = name.partition(":")
    declared = resolve.load_study(study)
    loop, _ = resolve.find_loop(declared, loop_name)
    plan = Plan(loop[declared.controller], "ctl", loop.period, real)
    said = module_proof.run_eva(plan, codegen.texts(plan), finite=finite)
    kept = (
        "tool", "seconds", "ended", "of_guards", "alarms", "ranges", "functions", "non_finite",
        "passed",
    )  # fmt: skip
    return {k: said[k] for k in kept} | {"said": module_proof.summary(said)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prove and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="*")
    parser.add_argument("--real", nargs="+", default=["double", "float"])
    parser.add_argument("--once", action="store_true")
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    module_proof.tool()
    rows: dict[str, dict[str, Any]] = {}
    for name in loops(options.loops):
        for real in options.real:
            found = rows[f"{name} {real}"] = proven(name, real, not options.once)
            print(f"{name} {real}, {found['seconds']} s: {found['said']}", flush=True)
            if options.out:  # a run that is stopped keeps what is done
                store.write_json(Path(options.out), rows)
    return 0 if all(r["passed"] for r in rows.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
