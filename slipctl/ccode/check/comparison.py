"""C against Python: compile, replay with the state carried in C, compare every output and state."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.check import isolation
from slipctl.ccode.check.back_to_back import compared_bits
from slipctl.ccode.check.expected import Expected, differences, start_state
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.write.plan import Plan
from slipctl.errors import RunFailed
from slipctl.run import build

TRIAL = 200
"""Ticks of the made-up inputs that a module is tested with when nothing was logged."""


def compare(
    plan: Plan,
    made: Mapping[str, str],
    used: tuple[str, ...],
    run: Expected,
    params: Mapping[str, Any],
) -> dict[str, Any]:
    """Compile with each compiler, replay, and run the test program of the folder."""
    compiled: list[dict[str, Any]] = []
    signals: dict[str, dict[str, Any]] = {}
    mask = compared_bits(plan.real)
    passed = True
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        for name, text in made.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        for compiler in used:
            module = CModule(Path(scratch), plan).compile(compiler).load()
            state_bytes = module.instance_bytes
            module.reset(**params)
            got = np.hstack(module.replay_rows(run.rows))
            faults = run.faults(module.status, mask)
            for n, differs in differences(plan, run, got).items():
                known = signals.setdefault(n, differs)
                for k in ("absolute", "relative", "counted"):
                    known[k] = max(known[k], differs[k])
            product = module.object_file
            said, agreed = _own_test(plan, Path(scratch), compiler, product)
            found = cc.symbols(product)
            wanted = [f"{plan.name}_{f}" for f in ("default", "init", "step", "tune")]
            clean = found is None or found["defined"] == wanted
            doubles = cc.in_double(found["needed"]) if found else []
            clean = clean and not (doubles and plan.real == "float")
            passed = passed and faults == 0 and agreed and clean
            if not compiled:  # once is enough: these are faults of the text
                memory_said, sound = isolation.sanitized(plan, Path(scratch), compiler)
                apart = {
                    "sanitizers": memory_said,
                    "two_instances_interleaved": isolation.interleaved(
                        module, run.rows, got, **params
                    ),
                    "two_modules_linked": isolation.linked_twice(
                        plan, Path(scratch), compiler, product
                    ),
                }
                passed = passed and sound and all(apart.values())
            compiled.append({
                "compiler": cc.version(compiler),
                "flags": " ".join(cc.FLAGS),
                "bytes": cc.sizes(product),
                "symbols": found,
                "double_functions": doubles,
                "stack": cc.stack(compiler, Path(scratch) / f"{plan.name}.c"),
                "faults": faults,
                "own_test": said,
            })  # fmt: skip
    largest = max((s["relative"] for s in signals.values()), default=0.0)
    return {
        "memory_bytes": plan.memory_bytes | {"state": state_bytes},
        "compiled": compiled,
        "isolation": apart,
        "signals": signals,
        "largest_relative": largest,
        "ticks_off_range": run.refused,
        "ticks_limited": run.limited,
        "ticks_undecided": run.undecided,
        "passed": passed and all(s["counted"] <= s["limit"] for s in signals.values()),
    }


def _own_test(plan: Plan, folder: Path, compiler: str, product: Path) -> tuple[str, bool]:
    """Last line of the folder's own test program, and whether it is content."""
    test, program = folder / f"test_{plan.name}.o", folder / f"test_{plan.name}"
    cc.compile_object(compiler, test.with_suffix(".c"), test)
    cc.link(compiler, [product, test], program)
    done = subprocess.run(
        [str(program), "vectors.txt"], cwd=folder, capture_output=True, text=True, check=False
    )
    return (done.stdout.strip().splitlines() or ["no output"])[-1], done.returncode == 0


def reference(
    block: Block, rows: np.ndarray, params: Mapping[str, Any], whole: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs and next states of the block itself, in CasADi's virtual machine.

    Args:
        block: a step or a law.
        rows: input elements, one row per tick.
        params: parameters by name.
        whole: refuse NaN; otherwise stop before it.

    Raises:
        RunFailed: an output or a state becomes NaN or infinite.
    """
    p = np.array(ca.DM(block.pack("param", block.param_values(**params))).full()).ravel()
    x = start_state(block, params)
    ticks = len(rows)
    before, outputs = np.empty((ticks, x.size)), np.empty((ticks, block.f.size1_out(1)))
    done = build.roll_interpreted(block.f, x, rows, p, before, outputs)
    good = np.isfinite(outputs[:done]).all(axis=1)
    first = done if good.all() else int(np.argmin(good))
    if first < ticks and whole:
        raise RunFailed(f"{block.name} itself gives NaN or infinity at tick {first}")
    after = x[np.newaxis, :] if first == ticks else before[first : first + 1]
    return outputs[:first], np.vstack([before[1:first], after]) if first else before[:0]


def trial_rows(plan: Plan) -> np.ndarray:
    """Made-up input elements that fill the ranges evenly, the same on every machine."""
    golden = (np.sqrt(5.0) - 1) / 2
    columns = []
    k = 0
    for m in plan.layout.inputs:
        s = m.signal
        centre = float(np.mean(np.asarray(s.value if s.value is not None else 0.0, dtype=float)))
        lo = s.lo if np.isfinite(s.lo) else min(centre - max(abs(centre), 1.0), s.hi)
        hi = s.hi if np.isfinite(s.hi) else max(centre + max(abs(centre), 1.0), lo)
        for _ in range(m.size):
            k += 1
            share = np.modf(np.arange(1, TRIAL + 1) * golden + k * np.sqrt(2.0))[0]
            columns.append(np.round(lo + (hi - lo) * share, 6).clip(lo, hi))
    return np.column_stack(columns) if columns else np.zeros((TRIAL, 0))
