"""What a controller in C keeps of a shifted state: why some faults are never forgotten.

``python -m bench.state_shifts STUDY:LOOP ... [--out FILE]`` shifts each number that a
controller holds by 1 % of what it moves over, and lets it read what the run without the shift
reads. After 2 s a part of the shift is left: nothing of a filter, all of an integral. A law whose
state keeps all of a shift cannot forget a wrong sample by what it reads; only the plant leads it
back, or nothing does.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.faults import WHERE, controllers
from bench.loops.closed_loop import ClosedLoop
from bench.loops.wrong_samples import NEAR
from slipctl.run import store

SHIFT, LATER = 0.01, 2.0
"""Shift, of what a state moves over meanwhile, and time in s after which it is looked at."""


def kept(name: str, later: float = LATER) -> dict[str, float]:
    """Share of a shift that is left of each state, where it is more than 2 %.

    Arrays are left out: they are windows, and leave by their length.
    """
    from slipctl.ccode.check.vectors.run_inputs import record_part
    from slipctl.ccode.codegen import c_module

    _, loop, part, scenario = next(controllers([name]))
    _, params = record_part(loop, part, scenario, 1)
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        module = c_module(loop[part], Path(scratch), "ctl", period=loop.period).compile().load()
        whole = ClosedLoop(loop, part, scenario, module.reset(**params))
        whole.run(round(WHERE[name.partition(":")[0]].at[0] / whole.period))
        begin = whole.keep()
        truth = whole.run(min(round(later / whole.period), whole.ticks - whole.tick)).truth
        members = [m for m in whole.plan.layout.states for _ in range(m.size)]

        def held(shift: int | None = None, by: float = 0.0) -> np.ndarray:
            """States after each tick, with one of them shifted at first."""
            whole.go_back(begin)
            if shift is not None:
                module._state[shift] += by
            rows = []
            for row in truth:
                whole.watch(row[np.newaxis])
                rows.append(module._state[: len(members)].copy())
            return np.array(rows)

        plain, found = held(), {}
        for k, m in enumerate(members):
            by = SHIFT * float(np.ptp(plain[:, k]) or abs(plain[-1, k]))
            if m.size > 1 or not by:
                continue
            share = abs(held(k, by)[-1, k] - plain[-1, k]) / by
            if share > NEAR:
                found[m.name] = float(share)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what is kept, and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loops", nargs="+")
    parser.add_argument("--out", help="file to write")
    options = parser.parse_args(arguments)
    found = {name: kept(name) for name in options.loops}
    for name, shares in found.items():
        print(name, ", ".join(f"{n} {s:.3g}" for n, s in shares.items()) or "nothing")
    if options.out:
        store.write_json(Path(options.out), {"controllers": found})
    return 0


if __name__ == "__main__":
    sys.exit(main())
