"""What arithmetic of float may give: a module run with roundings up, down, to zero, at random.

The text of the module in float is compiled with another arithmetic in the place of float
(templates/rounding.hpp). In it each operation is rounded to one of the two floats beside its
result. This is Monte Carlo arithmetic (Parker, Pierce, Eggert 2000) with random rounding; rounding
always to one side adds what random rounding would average out, the drift of sums. The compiled
float module is one more such run, with roundings half as large. So what the runs differ by is what
it may differ by, through every cancellation, decision and iteration in between.

In double every processor gives the same bits, but for exp, log and the like: mathematics libraries
differ there by a unit in the last place. So a module in double is run with its calls of them moved
by one, up, down, to zero, at random: what it may give with another library.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.compile.module import CModule
from slipctl.ccode.compile.programs import first_error, missing_program, run_program
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import MATH
from slipctl.errors import BadInput, RunFailed

UP, DOWN, TO_ZERO, AT_RANDOM = range(4)

RUNS = ((UP, 0), (DOWN, 0), (TO_ZERO, 0), *((AT_RANDOM, seed) for seed in range(1, 6)))
"""Rounding and seed of each run."""

INEXACT = sorted(
    MATH - {"ceil", "copysign", "fabs", "fdim", "floor", "fma", "fmax", "fmin", "fmod", "frexp",
            "ldexp", "logb", "modf", "nearbyint", "nextafter", "remainder", "rint", "round",
            "scalbn", "sqrt", "trunc"}
)  # fmt: skip
"""Functions that a mathematics library need not round correctly."""


def inexact(text: str) -> list[str]:
    """Functions that C in double calls and that another mathematics library rounds otherwise."""
    return [f for f in INEXACT if re.search(rf"\b{f}\(", text)]


@dataclass(frozen=True)
class Trials:
    """Runs with other roundings; numbers are as the module has them, in float or double.

    Attributes:
        rows: outputs and states per tick and element, of each run.
        status: per run and tick.
    """

    rows: Sequence[np.ndarray]
    status: np.ndarray

    @property
    def ticks(self) -> int:
        """Ticks of each run."""
        return self.status.shape[1]

    def first(self, ticks: int) -> Trials:
        """The first ticks of each run."""
        return Trials([rows[:ticks] for rows in self.rows], self.status[:, :ticks])

    def differ(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far each element comes from what is wanted: in any tick, and its least and greatest.

        Returns:
            Two rows, the largest difference in a tick and that of the two ends.
        """
        spread, ends = np.zeros((2, wanted.shape[1]))
        for rows in self.rows:
            spread = np.maximum(spread, np.abs(rows - wanted).max(axis=0))
            for end in (np.min, np.max):
                ends = np.maximum(ends, np.abs(end(rows, axis=0) - end(wanted, axis=0)))
        return spread, ends


def has_cpp_compiler() -> bool:
    """Whether there is a C++ compiler."""
    try:
        compiler()
    except BadInput:
        return False
    return True


@lru_cache(maxsize=1)
def compiler() -> str:
    """C++ compiler, which the other arithmetic needs.

    Raises:
        BadInput: none.
    """
    for name in ("g++", "clang++", "c++"):
        if found := shutil.which(name):
            return found
    raise missing_program("--check of float or on a target", "a C++ compiler for its limits", "g++")


ENOUGH, AT_LEAST, SOME = 4e7, 1000, 64
"""Operations of a run after which a folder that is written in a hurry has enough ticks, ticks that
it has anyhow, and ticks by which operations are counted."""


def trials(
    plan: Plan,
    made: Mapping[str, str],
    rows: np.ndarray,
    params: Mapping[str, Any],
    folder: Path,
    hurry: bool = False,
) -> Trials:
    """Run a float module with other roundings, a module in double with another libm.

    Args:
        plan: the module.
        made: its texts.
        rows: input elements, one row per tick.
        params: parameters of the run.
        folder: where to compile it.
        hurry: leave out ticks at the end of a run of a float module beyond ``ENOUGH``
            operations; they are counted, so the same ticks are left on every machine.

    Raises:
        BadInput: no C++ compiler.
        RunFailed: it refuses the text.
    """
    n = plan.name
    for name in plan.files:
        (folder / name).write_text(made[name], encoding="utf-8")
    binding = CModule(folder, plan).binding
    arithmetic = fill_template("rounding.hpp")
    if plan.real == "double":
        moved = (f"#define {f}(...) rounding_beside({f}(__VA_ARGS__))" for f in INEXACT)
        arithmetic = fill_template("other_library.hpp", moved="\n".join(moved))
    text = f'{arithmetic}\nextern "C" {{\n#include "{n}.c"\n{binding}}}\n'
    source, library = folder / "rounded.cpp", folder / f"{n}.so"
    source.write_text(text, encoding="utf-8")
    command = [compiler(), "-std=c++17", "-w", "-O1", "-ffp-contract=off", "-shared", "-fPIC"]
    done = run_program([*command, "-o", library, source.name], folder)
    if done.returncode:
        complaint = first_error(done.stderr)
        raise RunFailed(f"{n} cannot be compiled with other roundings: {complaint}")

    def run(k: int) -> tuple[np.ndarray, np.ndarray]:
        mode, seed = RUNS[k]
        own = folder / f"{n}_{k}.so"  # rounding and seed are global in it
        shutil.copy(library, own)
        module = CModule(folder, plan).load(own)
        ctypes.CDLL(str(own)).rounding_choose(ctypes.c_int(mode), ctypes.c_int(seed))
        found = np.hstack(module.reset(**params).replay_rows(rows))
        return found, np.array(module.status)

    if hurry and plan.real == "float" and len(rows) > AT_LEAST:
        counted = ctypes.c_ulonglong.in_dll(ctypes.CDLL(str(library)), "rounding_operations")
        CModule(folder, plan).load(library).reset(**params).replay_rows(rows[:SOME])
        rows = rows[: max(AT_LEAST, int(ENOUGH * SOME / max(counted.value, 1)))]
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the library runs without Python's lock
        found, status = zip(*pool.map(run, range(len(RUNS))), strict=True)
    return Trials(found, np.array(status))
