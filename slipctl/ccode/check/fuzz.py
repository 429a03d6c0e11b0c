"""Any bytes as inputs and parameters: libFuzzer on init, tune and step, with sanitizers.

What must hold, whatever comes: no crash, and no report of AddressSanitizer or UBSan. Outputs are
finite and in their declared ranges, states are finite. A refused tick leaves the state as it was.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.compile.compilers import version
from slipctl.ccode.compile.state_numbers import numbers_of
from slipctl.ccode.module import guard
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number
from slipctl.errors import BadInput, RunFailed

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

_HARNESS = """#include "{n}.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef {real} real;

static const double range_in[][2] = {{{range_in}}};
static const double range_param[][2] = {{{range_param}}};
static const double range_out[][2] = {{{range_out}}};
static const double good[] = {{{good}}}; /* inputs of recovery */
static const double safe_out[] = {{{safe_out}}}; /* NaN where none is stated */

static const uint8_t *at;
static size_t left;

static void taken(void *to, size_t n)
{{
    const size_t k = (n < left) ? n : left;
    (void)memset(to, 0, n);
    (void)memcpy(to, at, k);
    at += k;
    left -= k;
}}

/* Numbers of raw bytes, or, so that many trials come past the guards, numbers in their ranges. */
static void drawn(real *x, const double (*range)[2], int n)
{{
    uint8_t raw = 0;
    int k;
    taken(&raw, 1U);
    for (k = 0; k < n; ++k) {{
        if ((raw % 8U) == 0U) {{
            taken(&x[k], sizeof(real));
        }} else {{
            uint16_t share = 0;
            taken(&share, sizeof(share));
            if (share != 0U) {{ /* 0 leaves it as it is */
                const double part = (double)(share - 1U) / 65534.0;
                x[k] = (real)(range[k][0] * (1.0 - part) + range[k][1] * part);
            }}
        }}
    }}
}}

static void finite(const real *x, size_t n)
{{
    size_t k;
    for (k = 0; k < n; ++k) {{
        if (!(fabs((double)x[k]) <= DBL_MAX)) {{
            abort();
        }}
    }}
}}

{numbers_of}int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{{
    static {n}_in in;
    static {n}_param param;
    static {n}_state state;
    static {n}_state before;
    static {n}_out out;
    int tick;
    int k;
    uint8_t tuned = 0;
{numbers}    at = data;
    left = size;
    {n}_default(&param);
    (void)memset(&in, 0, sizeof(in));
    (void)memset(&state, 0, sizeof(state));
    if ({n}_init(&param, &state) != 0) {{
        abort(); /* the defaults are good */
    }}
    taken(&tuned, 1U);
    if ((tuned % 4U) == 1U) {{
        drawn((real *)&param, range_param, {n_param});
        (void){n}_init(&param, &state);
    }}
    {finite_state}
    for (tick = 0; (tick < {ticks}) && (left > 0U); ++tick) {{
        int status;
        if ((tuned % 4U) == 2U) {{
            drawn((real *)&param, range_param, {n_param});
            (void){n}_tune(&param, &state);
        }}
        drawn((real *)&in, range_in, {n_in});
        (void)memcpy(&before, &state, sizeof(state));
        status = {n}_step(&in, &param, &state, &out);
        {finite_state}
        finite((const real *)&out, {n_out});
        for (k = 0; k < {n_out}; ++k) {{
            const double y = (double)((const real *)&out)[k];
            if (!(y >= range_out[k][0]) || !(y <= range_out[k][1])) {{
                abort();
            }}
            if (((status & (int){big}_REFUSED) != 0) && !isnan(safe_out[k])
                && (y != (double)(real)safe_out[k])) {{
                abort();
            }}
        }}
        if (((status & ((int){big}_REFUSED | (int){big}_RESET)) == (int){big}_REFUSED)
            && {moved}) {{
            abort();
        }}
    }}
    if ((tuned / 4U) % {often}U == 1U) {{ /* whatever came: good inputs end every fault */
        int status = 0;
        {n}_default(&param);
        if ({n}_tune(&param, &state) != 0) {{
            abort();
        }}
        for (k = 0; k < {n_in}; ++k) {{
            ((real *)&in)[k] = (real)good[k];
        }}
        for (tick = 0; tick < {settled}; ++tick) {{
            status = {n}_step(&in, &param, &state, &out);
        }}
        if ((status & ~(int){big}_LIMITED) != 0) {{
            abort();
        }}
    }}
    return 0;
}}
"""


def tool() -> str:
    """Path of clang, if it has libFuzzer.

    Raises:
        BadInput: it is not installed, or has none.
    """
    found = shutil.which("clang")
    if found is not None:
        with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
            trial = Path(scratch) / "trial.c"
            trial.write_text(
                "#include <stddef.h>\nint LLVMFuzzerTestOneInput(const char *d, size_t n);\n"
                "int LLVMFuzzerTestOneInput(const char *d, size_t n)\n"
                "{ return (d && n) ? 0 : 0; }\n",
                encoding="utf-8",
            )
            command = [found, *FLAGS, str(trial), "-o", str(trial.with_suffix(""))]
            if subprocess.run(command, capture_output=True, check=False).returncode == 0:
                return found
    raise BadInput(
        "--fuzz needs clang with libFuzzer; install it (Debian, Ubuntu: apt install clang)"
    )


_MOVED = "(memcmp(&before.kept, &state.kept, sizeof(state.kept)) != 0)"


def harness(plan: Plan) -> str:
    """Text of the program that libFuzzer calls."""
    lay = plan.layout

    def ranges(members: Any, least: float) -> str:
        rows = []
        for m in members:
            lo, hi = plan.limits(m)
            # where there is no end, numbers of a usual size are drawn, and raw bytes besides
            lo = lo if np.isfinite(lo) else min(-least, hi)
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
    kept = bool(lay.states)
    return _HARNESS.format(
        n=plan.name, big=lay.big, real=plan.real, ticks=TICKS,
        range_in=ranges(lay.inputs, 100.0), range_param=ranges(lay.params, 1e3),
        good=good or "0.0", often=OFTEN, settled=int(settled),
        range_out=outs or "{0.0, 0.0}", safe_out=safe or "0.0",
        **{
            k: sum(m.size for m in g)
            for k, g in (("n_in", lay.inputs), ("n_param", lay.params), ("n_out", lay.outputs))
        },
        numbers_of=numbers_of(lay, plan.real) * kept,
        numbers=f"    static real numbers[{sum(m.size for m in lay.states)}];\n" * kept,
        finite_state="numbers_of(&state.kept, numbers);\n"
        f"    finite(numbers, {sum(m.size for m in lay.states)});" * kept,
        moved=_MOVED if kept else "(0 != 0)",
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
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch)
        for name in plan.files:
            (folder / name).write_text(made[name], encoding="utf-8")
        (folder / "fuzz.c").write_text(harness(plan), encoding="utf-8")
        command = [compiler, *FLAGS, f"{n}.c", "fuzz.c", "-o", "fuzz", "-lm"]
        built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if built.returncode:
            raise RunFailed(f"clang refuses the harness: {built.stderr.strip().splitlines()[0]}")
        longest = 2 + TICKS * (1 + 8 * sum(m.size for m in plan.layout.inputs))
        longest += 8 * sum(m.size for m in plan.layout.params)
        (folder / "corpus").mkdir()
        rng = np.random.default_rng(seed)
        for k in range(16):  # long inputs from the beginning
            (folder / "corpus" / str(k)).write_bytes(rng.bytes(longest))
        ran = subprocess.run(
            ["./fuzz", "corpus", f"-seed={seed}", f"-max_len={longest}",
             f"-max_total_time={seconds}" if runs is None else f"-runs={runs}",
             "-print_final_stats=1", "-timeout=60", "-rss_limit_mb=4096"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
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
