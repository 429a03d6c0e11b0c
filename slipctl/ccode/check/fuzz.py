"""Any bytes as inputs and parameters: libFuzzer on init, tune and step, with sanitizers.

What must hold, whatever comes: no crash, and no report of AddressSanitizer or UBSan. Outputs are
finite and in their declared ranges, states are finite. A refused tick leaves the state as it was.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from slipctl.ccode.compile.compilers import version
from slipctl.ccode.compile.programs import (
    find_program,
    missing_program,
    run_program,
    scratch_folder,
)
from slipctl.ccode.compile.state_numbers import numbers_of
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module import guard
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number
from slipctl.errors import RunFailed

FLAGS = (
    "-std=c99", "-O1", "-ffp-contract=off", "-gline-tables-only",
    "-fsanitize=fuzzer,address,undefined,float-cast-overflow", "-fno-sanitize-recover=all",
)  # fmt: skip

TICKS = 64
"""Ticks at most of one trial."""

OFTEN = 16
"""One trial in so many ends with good inputs, which must end every fault."""

SETTLED = 1.0
"""Seconds after the longest memory of an input after which, with good inputs, nothing may be told
but a limit."""

_TRIAL = """#include <stddef.h>
int LLVMFuzzerTestOneInput(const char *d, size_t n);
int LLVMFuzzerTestOneInput(const char *d, size_t n) { return (d && n) ? 0 : 0; }
"""


def tool() -> str:
    """Path of clang, if it has libFuzzer.

    Raises:
        BadInput: it is not installed, or has none.
    """
    what = "clang with libFuzzer"
    found = find_program("clang", "--fuzz", "clang", what)
    with scratch_folder({"trial.c": _TRIAL}) as folder:
        if run_program([found, *FLAGS, "trial.c", "-o", "trial"], folder).returncode:
            raise missing_program("--fuzz", what, "clang")
    return found


def harness(plan: Plan) -> str:
    """Text of the program that libFuzzer calls."""
    lay = plan.layout

    def ranges(members: Any, least: float) -> str:
        rows = []
        for m in members:
            lo, hi = plan.limits(m)
            # where there is no end, numbers of a usual size are drawn, and raw bytes besides
            lo = lo if np.isfinite(lo) else min(-least, hi - least)
            hi = hi if np.isfinite(hi) else max(least, lo + least)
            rows += [f"{{{number(lo)}, {number(hi)}}}"] * m.size
        return ", ".join(rows or ["{0.0, 0.0}"])

    most = float(np.finfo(np.float32 if plan.real == "float" else np.float64).max)
    outs = ", ".join(
        f"{{{number(max(plan.limits(m)[0], -most))}, {number(min(plan.limits(m)[1], most))}}}"
        for m in lay.outputs for _ in range(m.size)
    )  # fmt: skip
    lows, highs, *_ = plan.ends(lay.inputs, plan.block.param_values())
    values = [
        v
        for m in lay.inputs
        for v in c_elements(m, 0.0 if m.signal.value is None else m.signal.value)
    ]
    good = ", ".join(number(float(v)) for v in np.clip(values, lows, highs))
    settled = guard.memory(plan.period, plan.stale) + np.ceil(SETTLED / (plan.period or 1e-3))
    safe = ", ".join(number(plan.safe.get(m.c, np.nan)) for m in lay.outputs for _ in range(m.size))
    return fill_template(
        "fuzz.c",
        **lay.words(plan.real), ticks=TICKS, often=OFTEN, settled=int(settled),
        range_in=ranges(lay.inputs, 100.0), range_param=ranges(lay.params, 1e3),
        range_out=outs or "{0.0, 0.0}", safe_out=safe or "0.0", good=good or "0.0",
        numbers_of=numbers_of(lay, plan.real),
    )  # fmt: skip


def run_fuzzer(
    plan: Plan, made: dict[str, str], seconds: int, seed: int = 1, runs: int | None = None
) -> dict[str, Any]:
    """Fuzz a module for some time, or for a number of runs, whatever time they take.

    Args:
        plan: the module.
        made: text of its files by name.
        seconds: how long libFuzzer runs.
        seed: of its random numbers.
        runs: how many, in the place of ``seconds``.

    Returns:
        ``executions``, ``features`` (what the code did differently, as libFuzzer counts),
        ``passed``, ``said`` (the first line of a finding) and ``input`` (its bytes in hex).

    Raises:
        BadInput: no clang with libFuzzer.
        RunFailed: it refuses the module.
    """
    compiler, n = tool(), plan.name
    texts = {name: made[name] for name in plan.files} | {"fuzz.c": harness(plan)}
    with scratch_folder(texts) as folder:
        command = [compiler, *FLAGS, f"{n}.c", "fuzz.c", "-o", "fuzz", "-lm"]
        built = run_program(command, folder)
        if built.returncode:
            raise RunFailed(f"clang refuses the harness: {built.stderr.strip().splitlines()[0]}")
        longest = 2 + TICKS * (1 + 8 * sum(m.size for m in plan.layout.inputs))
        longest += 8 * sum(m.size for m in plan.layout.params)
        (folder / "corpus").mkdir()
        rng = np.random.default_rng(seed)
        for k in range(16):  # long inputs from the beginning
            (folder / "corpus" / str(k)).write_bytes(rng.bytes(longest))
        ends = f"-max_total_time={seconds}" if runs is None else f"-runs={runs}"
        options = ["-print_final_stats=1", "-timeout=60", "-rss_limit_mb=4096"]
        ran = run_program(
            ["./fuzz", "corpus", f"-seed={seed}", f"-max_len={longest}", ends, *options], folder
        )
        said = ran.stderr
        crash = next(folder.glob("crash-*"), None)
        done = re.findall(r"number_of_executed_units: +(\d+)", said)
        features = re.findall(r" ft: (\d+)", said)
        finding = re.search(r"runtime error: .*|ERROR: \w+: .*", said)
        return {
            "tool": version(compiler), "seconds": seconds, "seed": seed,
            "executions": int(done[-1]) if done else 0,
            "features": int(features[-1]) if features else 0,
            "passed": ran.returncode == 0 and crash is None,
            "said": finding[0][:300] if finding else "nothing found",
            "input": crash.read_bytes().hex() if crash else "",
        }  # fmt: skip
