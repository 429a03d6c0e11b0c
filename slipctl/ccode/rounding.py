"""What arithmetic of float may give: a module run with roundings up, down, to zero, at random.

The text of the module in float is compiled with another arithmetic in the place of float
(rounding.hpp), in which each operation is rounded to one of the two floats beside its result. This
is Monte Carlo arithmetic (Parker, Pierce, Eggert 2000) with random rounding; rounding always to one
side adds what random rounding would average out, the drift of sums. The compiled float module is
one more such run, with roundings half as large. So what the runs differ by is what it may differ
by, through every cancellation, decision and iteration in between.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.module import CModule
from slipctl.ccode.plan import Plan
from slipctl.errors import BadInput, RunFailed

UP, DOWN, TO_ZERO, AT_RANDOM = range(4)

RUNS = ((UP, 0), (DOWN, 0), (TO_ZERO, 0), *((AT_RANDOM, seed) for seed in range(1, 6)))
"""Rounding and seed of each run."""


@dataclass(frozen=True)
class Trials:
    """Runs with other roundings: outputs and states, and the status, per run, tick and element."""

    rows: np.ndarray
    status: np.ndarray


@lru_cache(maxsize=1)
def compiler() -> str:
    """C++ compiler, which the other arithmetic needs.

    Raises:
        BadInput: none.
    """
    for name in ("g++", "clang++", "c++"):
        if found := shutil.which(name):
            return found
    raise BadInput(
        "--real float --check needs a C++ compiler for its limits; install one (Debian, Ubuntu: apt"
        " install g++)"
    )


def trials(
    plan: Plan, made: Mapping[str, str], rows: np.ndarray, params: Mapping[str, Any], folder: Path
) -> Trials:
    """Run a float module with other roundings.

    Args:
        plan: the module, in float.
        made: its texts.
        rows: input elements, one row per tick.
        params: parameters of the run.
        folder: where to compile it.

    Raises:
        BadInput: no C++ compiler.
        RunFailed: it refuses the text.
    """
    n = plan.name
    for name in (f"{n}.h", f"{n}.c"):
        (folder / name).write_text(made[name], encoding="utf-8")
    module = CModule(folder, plan)
    arithmetic = Path(__file__).with_suffix(".hpp").read_text(encoding="utf-8")
    text = f'{arithmetic}\nextern "C" {{\n#include "{n}.c"\n{module.binding}}}\n'
    source, library = folder / "rounded.cpp", folder / f"{n}.so"
    source.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [compiler(), "-std=c++17", "-w", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-o",
         str(library), source.name],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        complaint = next((s for s in done.stderr.splitlines() if "error" in s), "no message")
        raise RunFailed(f"{n} cannot be compiled with other roundings: {complaint}")
    module.load(library)
    choose = ctypes.CDLL(str(library)).rounding_choose
    found, status = [], []
    for mode, seed in RUNS:
        choose(ctypes.c_int(mode), ctypes.c_int(seed))
        found.append(np.hstack(module.reset(**params).replay_rows(rows)).astype(float))
        status.append(np.array(module.status))
    return Trials(np.array(found), np.array(status))
