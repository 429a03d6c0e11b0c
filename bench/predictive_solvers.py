"""Time of a tick and bytes of C on the four problems of ``predictive``, by solver.

``python -m bench.predictive_solvers --out predictive_solvers.json`` gives each the
inputs of the same closed loop. It counts CPU time, the least of the repeats, in turn in one run.
Ours are generated C. IPOPT and FATROP call compiled C of cost, rows and slopes; where that cannot
be compiled they run interpreted, and their row says so. OSQP and qrqp solve the program that an
interpreted linearisation makes. An answer that leaves more than 1e-6 of the conditions of Karush,
Kuhn and Tucker has no time.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from bench.predictive import built
from bench.speed import machine
from slipctl import c_module
from slipctl.predict import reference
from slipctl.predict.trials import Driver
from slipctl.run import store
from slipctl.studies.predictive.experiments import DO_MPC, FOUR, TO_THE_END, WAYS
from slipctl.studies.predictive.outside import as_user_writes
from slipctl.studies.predictive.problems import Problem, problems, rolled

OURS = ("one iteration", "three iterations")


def closed_loop(p: Problem) -> np.ndarray:
    """Inputs of the controller along its own closed loop, a row per tick."""
    rows, tick = [], Driver(p.make(), compile=False)

    def seen(*given: float) -> np.ndarray:
        rows.append(given)
        return tick(*given)

    rolled(p, seen)
    return np.array(rows)


def in_c(p: Problem, way: str, rows: np.ndarray, work: Path) -> tuple[dict[str, Any], Any]:
    """Bytes of text of our C, in double and float, and a call that gives the time of its tick."""
    bytes_, tick = {}, None
    for real in ("double", "float"):
        folder = work / real
        module = c_module(p.make(**WAYS[way]), folder, real=real)
        program = built(folder, module.name, real, rows, folder / "built")
        bytes_[f"text, {real}"] = program.text
        tick = tick or program.tick
    return {"how": "generated C", **bytes_}, tick


def by_solver(p: Problem, way: str, rows: np.ndarray) -> tuple[dict[str, Any], Any]:
    """How a solver runs, and a call that gives the time of its tick; none for a wrong answer."""
    how, context = "", reference.compile_callbacks() if way in TO_THE_END else nullcontext()
    try:
        with context:
            block = p.make(**WAYS[way])
            f = block.f
        how = "its functions compiled" if way in TO_THE_END else "linearised by interpreted code"
    except RuntimeError:  # no compiler
        block = p.make(**WAYS[way])
        how, f = "interpreted", block.f
    start = Driver(block, compile=False)
    wrong = False

    def run() -> float:
        nonlocal wrong
        x, began = ca.DM(start.x), time.process_time()
        for row in rows:
            x, y = f(x, row, start.p)
            wrong = wrong or not np.isfinite(float(y[0]))
            if wrong:
                return float("nan")
        return (time.process_time() - began) / len(rows)

    return {"how": how}, run


def by_do_mpc(p: Problem, rows: np.ndarray) -> tuple[dict[str, Any], Any]:
    """The same by do-mpc, as a user writes it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of features that are not asked for
        controller, template = as_user_writes(p)
    n = len(p.plant.states)

    def run() -> float:
        controller.reset_history()
        controller.x0 = rows[0, :n]
        controller.set_initial_guess()
        took = 0.0
        for row in rows:
            for name, value in zip(list(p.plant.inputs)[1:], row[n:], strict=True):
                template["_tvp", :, name] = value
            began = time.process_time()
            with redirect_stdout(StringIO()):
                controller.make_step(row[:n, None])
            took += time.process_time() - began
        return took / len(rows)

    return {"how": "interpreted"}, run


def measured(names: tuple[str, ...] = FOUR, repeats: int = 3) -> list[dict[str, Any]]:
    """A row per problem and solver."""
    found = []
    for name in names:
        p = problems()[name]
        rows, calls = closed_loop(p), {}
        with tempfile.TemporaryDirectory() as work:
            for way in WAYS:
                if (name, way) == ("rates", "FATROP"):  # it takes none
                    continue
                made: Callable[..., Any] = by_solver
                given: list[Any] = [p, way, rows]
                if way in OURS:
                    made, given = in_c, [*given, Path(work) / way.replace(" ", "_")]
                calls[way] = made(*given)
            if find_spec("do_mpc") and name in ("reference", "car"):
                calls[DO_MPC] = by_do_mpc(p, rows)
            times: dict[str, list[float]] = {way: [] for way in calls}
            for _ in range(repeats):
                for way, (_, tick) in calls.items():
                    times[way].append(tick())
        for way, (row, _) in calls.items():
            least = min(times[way])
            found.append({"problem": name, "solver": way, **row,
                          "tick_s": least if np.isfinite(times[way]).all() else None})  # fmt: skip
            print(found[-1], flush=True)
    return found


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", default="predictive_solvers.json")
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args()
    rows = measured(repeats=asked.repeats)
    store.write_json(Path(asked.out), {"format": 1, "versions": machine(), "rows": rows})


if __name__ == "__main__":
    main()
