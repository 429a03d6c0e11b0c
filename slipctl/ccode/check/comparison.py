"""C against Python: compile, replay with the state carried in C, compare every output and state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl.ccode.check import coverage, isolation
from slipctl.ccode.check.back_to_back import compared_bits
from slipctl.ccode.check.vectors.expected_outputs import (
    Expected,
    accepted_rows,
    catch_up,
    differences,
    largest_relative,
    missed_ticks,
    run_with_guards,
    start_state,
)
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.compile.programs import run_program, scratch_folder
from slipctl.ccode.module.header import bit, memory_bytes, prototypes
from slipctl.ccode.module.layout import spans
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import round_to_real
from slipctl.errors import BadInput, RunFailed
from slipctl.run import build

UNBOUNDED = 1e38
"""From here on an end of a range is the largest number, in float too."""

TRIAL = 200
"""Ticks of the made-up inputs that a module is tested with when nothing was logged."""


def compare(
    plan: Plan,
    made: Mapping[str, str],
    used: tuple[str, ...],
    run: Expected,
    params: Mapping[str, Any],
    closed_loop: Callable[[CModule, Mapping[str, Any]], dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Compile with each compiler, replay, and run the test program of the folder.

    A float module also runs with the rest of its loop, where there is one.
    """
    in_loop: dict[str, Any] = {}
    compiled: list[dict[str, Any]] = []
    signals: dict[str, dict[str, Any]] = {}
    mask = compared_bits(plan.real)
    passed = True
    with scratch_folder(made) as scratch:
        for compiler in used:
            module = CModule(scratch, plan).compile(compiler).load()
            state_bytes = module.instance_bytes
            module.reset(**params)
            got = np.hstack(module.replay_rows(run.rows))
            faults = run.faults(module.status, mask)
            for n, differs in differences(plan, run, got).items():
                known = signals.setdefault(n, differs)
                for k in ("absolute", "relative", "counted"):
                    known[k] = max(known[k], differs[k])
            product = module.object_file
            said, agreed = _own_test(plan, scratch, compiler, product)
            found = cc.symbols(product)
            wanted = sorted(f"{plan.name}_{f}" for f in prototypes(plan))
            clean = found is None or found["defined"] == wanted
            doubles = cc.in_double(found["needed"]) if found else []
            clean = clean and not (doubles and plan.real == "float")
            passed = passed and faults == 0 and agreed and clean
            if not compiled:  # once is enough: these are faults of the text
                memory_said, sound = isolation.run_sanitizers(plan, scratch, compiler)
                apart = {
                    "sanitizers": memory_said,
                    "two_instances_interleaved": isolation.same_beside_another(
                        module, run.rows, got, **params
                    ),
                    "two_modules_linked": isolation.linked_twice(plan, scratch, compiler, product),
                }
                passed = passed and sound and all(apart.values())
                reached = coverage.run_with_counters(plan, scratch, used)
                if closed_loop is not None and plan.real == "float":
                    in_loop = {"closed_loop": closed_loop(module, params)}
            compiled.append({
                "compiler": cc.version(compiler),
                "flags": " ".join(cc.FLAGS),
                "bytes": cc.sizes(product),
                "symbols": found,
                "double_functions": doubles,
                "stack": cc.stack(product),
                "functions": cc.code(product),
                "faults": faults,
                "own_test": said,
            })  # fmt: skip
    largest, _ = largest_relative(signals)
    return in_loop | {
        "memory_bytes": memory_bytes(plan) | {"state": state_bytes},
        "compiled": compiled,
        "isolation": apart,
        "coverage": reached,
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
    done = run_program([program, "vectors.txt"], folder)
    return (done.stdout.strip().splitlines() or ["no output"])[-1], done.returncode == 0


def expected_run(
    plan: Plan, rows: np.ndarray, params: Mapping[str, Any], whole: bool = True
) -> Expected:
    """What the C is to give: the block in Python with the guards around it.

    Args:
        plan: the module of a step or a law.
        rows: input elements, one row per tick, anything.
        params: parameters by name.
        whole: refuse a run that gives NaN or leaves its ranges; otherwise stop before it.

    Raises:
        BadInput: no tick is taken.
        RunFailed: as :func:`reference`.
    """
    seen, told = accepted_rows(plan, rows, plan.block.param_values(**params))
    good = told & bit("REFUSED") == 0
    if not good.any():
        raise BadInput(f"{plan.block.name}: no tick has all its inputs in their declared ranges")
    outputs, states = reference(plan, seen[good], params, whole, missed_ticks(good))
    if len(outputs) < np.count_nonzero(good):
        end = np.flatnonzero(good)[len(outputs)]
        rows, told = rows[:end], told[:end]
    return run_with_guards(plan, rows, told, outputs, states, params)


def reference(
    plan: Plan,
    rows: np.ndarray,
    params: Mapping[str, Any],
    whole: bool = True,
    gaps: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs and next states of the block itself, in CasADi's virtual machine.

    Args:
        plan: the module of a step or a law.
        rows: input elements, one row per tick.
        params: parameters by name.
        whole: refuse NaN and what is out of range; otherwise stop before it.
        gaps: ticks before each row that were refused, by default none.

    Raises:
        RunFailed: an output or a state becomes NaN or infinite, or a state leaves its range.
    """
    block = plan.block
    p = np.array(ca.DM(block.pack("param", block.param_values(**params))).full()).ravel()
    x = start_state(block, params)
    ticks = len(rows)
    before, outputs = np.empty((ticks, x.size)), np.empty((ticks, block.f.size1_out(1)))
    done = 0
    for first, last in _pieces(gaps if plan.counters else None, ticks):
        done += build.roll_interpreted(
            block.f, x, rows[first:last], p, before[first:last], outputs[first:last]
        )
        if done < last:
            break
        if gaps is not None and last:
            catch_up(plan, x, gaps[last - 1])
    good = np.isfinite(outputs[:done]).all(axis=1)
    first = done if good.all() else int(np.argmin(good))
    if first < ticks and whole:
        raise RunFailed(f"{block.name} itself gives NaN or infinity at tick {first}")
    after = x[np.newaxis, :] if first == ticks else before[first : first + 1]
    states = np.vstack([before[1:first], after]) if first else before[:0]
    lo, hi, *_ = plan.ends(plan.layout.states, block.param_values(**params))
    off = (states < lo) | (states > hi)
    if off.any():
        first = int(np.argmax(off.any(axis=1)))
        k = int(np.argmax(off[first]))
        name = next(m.name for m, here in spans(plan.layout.states) if k < here.stop)
        if whole:
            raise RunFailed(
                f"{block.name}: {name} = {states[first, k]:g} leaves its declared range"
                f" [{lo[k]:g}, {hi[k]:g}] at tick {first} of the run itself; widen the range"
            )
    return outputs[:first], states[:first]


def _pieces(gaps: np.ndarray | None, ticks: int) -> list[tuple[int, int]]:
    """Ranges of ticks; each ends behind one before which some were refused, the last one anyhow."""
    ends = [] if gaps is None else [int(k) + 1 for k in np.flatnonzero(gaps)]
    ends += [ticks] * (not ends or ends[-1] < ticks)
    return list(zip([0, *ends], ends, strict=False))


def _followed(column: np.ndarray, change: float) -> np.ndarray:
    """A column that goes after another one, by no more than a change per tick."""
    found = column.copy()
    for t in range(1, len(found)):
        found[t] = found[t - 1] + np.clip(column[t] - found[t - 1], -0.9 * change, 0.9 * change)
    return found


WIDTHS = (1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-6)
"""Shares of the ranges that made-up inputs may fill; the first with which a block makes a tick."""


def made_up(plan: Plan, params: Mapping[str, Any]) -> tuple[Expected, float]:
    """Run on made-up inputs, and the share of their ranges that they fill.

    Where the block breaks in the first tick they are made up again, nearer to the values that the
    inputs have if nobody gives them. If none will do, the run has no tick.
    """
    for width in WIDTHS:
        rows = round_to_real(trial_rows(plan, width), plan.real)
        _, told = accepted_rows(plan, rows, plan.block.param_values(**params))
        if plan.coupled and (told & bit("REFUSED")).all() and width > WIDTHS[-1]:
            continue  # each in its range, but not one beside the other
        run = expected_run(plan, rows, params, whole=False)
        if len(run.rows):
            break
    return run, width


def trial_rows(plan: Plan, width: float = 1.0) -> np.ndarray:
    """Made-up input elements that fill the ranges evenly, the same on every machine.

    Args:
        plan: the module.
        width: share of the ranges that they fill, about the declared values.
    """
    golden = (np.sqrt(5.0) - 1) / 2
    columns = []
    k = 0
    lows, highs, change, noise = plan.ends(plan.layout.inputs, plan.block.param_values())
    for m in plan.layout.inputs:
        s = m.signal
        centre = float(np.mean(np.asarray(s.value if s.value is not None else 0.0, dtype=float)))
        least, most = lows[k], highs[k]
        lo = least if abs(least) < UNBOUNDED else min(centre - max(abs(centre), 1.0), most)
        hi = most if abs(most) < UNBOUNDED else max(centre + max(abs(centre), 1.0), lo)
        for _ in range(m.size):
            k += 1
            share = np.modf(np.arange(1, TRIAL + 1) * golden + k * np.sqrt(2.0))[0]
            column = np.round(lo + (hi - lo) * share, 6).clip(lo, hi)
            if width < 1:
                column = np.clip(centre, lo, hi) * (1 - width) + column * width
            columns.append(_followed(column, change[k - 1] + noise[k - 1]))
    return np.column_stack(columns) if columns else np.zeros((TRIAL, 0))
