"""Wrong samples on each input of controllers in C, in closed loop: what they lead to.

``python -m slipctl.studies.bench.faults [STUDY:LOOP[@SCENARIO] ...] [--out FILE]`` runs every fault
of :mod:`slipctl.ccode.check.faults` and prints a line for each; exit code 1 where one does harm.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from slipctl.ccode.check.faults import Fault, faults
from slipctl.run import store
from slipctl.study import doors

LOOPS = ("hst_braking:eppfc@real", "hst_braking:pid@real", "hst_braking:efc@real")
"""Controllers whose models have ranges, with sensors as they are."""

AT = 1.5
"""Time in s of the first wrong sample."""

WHEEL = "plant.wheel.omega"
"""Speed of the wheel in these loops."""


def table(name: str) -> list[Fault]:
    """Each fault on each input of the controller of a loop."""
    left, _, loop_name = name.rpartition(":")
    study = doors.load_study(left)
    loop, case = doors.find_loop(study, loop_name)
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        return faults(loop, study.controller, case.scenario, Path(scratch), AT, WHEEL)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="*", default=LOOPS)
    parser.add_argument("--out")
    options = parser.parse_args(arguments)
    found = {name: table(name) for name in options.loops}
    for name, rows in found.items():
        for f in rows:
            said = "back" if f.passed else f"{100 * f.back:.1f} % back, {f.worst}"
            locks = ", the wheel locks" if f.locks else ""
            missed = f", {f.missed} not told" if f.missed else ""
            print(f"{name} {f.signal} {f.kind}, {f.ticks} ticks: {said}{missed}{locks}")
        print(f"{name}: {sum(f.passed for f in rows)} of {len(rows)} do no harm")
    if options.out:
        rows_of = {n: [asdict(f) | {"passed": f.passed} for f in rows] for n, rows in found.items()}
        store.write_json(Path(options.out), {"format": 1, "faults": rows_of})
    return 0 if all(f.passed for rows in found.values() for f in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
