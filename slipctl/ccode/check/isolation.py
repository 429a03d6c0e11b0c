"""What a module must not do: touch memory that is not its own, or another instance or module."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.compile.programs import run_program
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.header import prototypes
from slipctl.ccode.module.plan import Plan
from slipctl.errors import RunFailed

QUICK = "-O0"
"""What is only linked or watched needs no better code: the sanitizers see more without it."""

SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def run_sanitizers(plan: Plan, folder: Path, compiler: str) -> tuple[str, bool]:
    """Run the folder's own test under the address and the undefined behaviour sanitizer.

    Returns:
        What to tell, and whether nothing was found. A compiler without the sanitizers is told and
        passes.
    """
    n, program = plan.name, folder / f"sanitized_{plan.name}"
    sources = [f"{n}.c", f"test_{n}.c", "-o", program, "-lm"]
    command = [*cc.lenient_command(compiler), QUICK, *SANITIZERS, *sources]
    if run_program(command, folder).returncode:
        return f"not run, {Path(compiler).name} has no sanitizers", True
    ran = run_program([program, "vectors.txt"], folder)
    found = re.search(r"runtime error: .*|ERROR: AddressSanitizer: \S+", ran.stderr)
    if found or ran.returncode not in (0, 1):
        return (found[0] if found else f"stopped with {ran.returncode}"), False
    return "address, undefined: nothing found", True


def linked_twice(plan: Plan, folder: Path, compiler: str, product: Path) -> bool:
    """Link the module into one program with itself under another name, and run both.

    Whatever the object file would show to others beside its own functions clashes here.
    """
    n = plan.name
    twin, calls, program = (folder / f for f in (f"{n}_twin.o", f"{n}_two.c", f"{n}_two"))
    calls.write_text(fill_template("twins.c", n=n), encoding="utf-8")
    renamed = [f"-D{n}_{f}={n}_twin_{f}" for f in prototypes(plan)]
    try:
        cc.compile_object(compiler, folder / f"{n}.c", twin, *renamed, QUICK)
        cc.compile_object(compiler, calls, calls.with_suffix(".o"))
        cc.link(compiler, [product, twin, calls.with_suffix(".o")], program)
    except RunFailed:
        return False
    return run_program([program]).returncode == 0


def same_beside_another(
    module: CModule, rows: np.ndarray, alone: np.ndarray, **params: Any
) -> bool:
    """Whether an instance gives the same bits while another one, on other inputs, runs beside it.

    Args:
        module: loaded.
        rows: input elements, one row per tick; the other instance has them in reverse.
        alone: outputs and states of an instance that ran alone.
    """
    together = np.hstack(module.reset(**params).replay_rows(rows, beside=rows[::-1]))
    return bool((together == alone).all())
