"""Very many steps of a module in C on noise: is its state bounded, does its covariance drift?

The inputs are those of a tick of a run, held, with normal noise added: nothing excites an
estimator any more, which is when a forgetting one loses itself.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.tree.expressions import number
from slipctl.errors import RunFailed

PARTS = 10
"""Equal parts of the run that are compared."""

_DRIVER = """#include "{n}.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef {real} real;

static const double rows[{n_rows}][{n_in_}] = {{{rows}}};
static const double sigma[{n_in_}] = {{{sigma}}};
static const double range[{n_in_}][2] = {{{range}}};
static const double values[{n_param_}] = {{{params}}};
static uint64_t random_state = {seed}ULL;

static double uniform(void)
{{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (double)(random_state >> 11) * (1.0 / 9007199254740992.0);
}}

/* Sum of twelve: as good as normal within three deviations, and never beyond six. */
static double normal(void)
{{
    double sum = -6.0;
    int k;
    for (k = 0; k < 12; ++k) {{
        sum += uniform();
    }}
    return sum;
}}

int main(int argc, char **argv)
{{
    static {n}_in in;
    static {n}_param param;
    static {n}_state state;
    static {n}_out out;
    static double low[{n_all}];
    static double high[{n_all}];
    static double sum[{n_all}];
    const long ticks = (argc > 1) ? atol(argv[1]) : 1000;
    const long part = ticks / {parts};
    long statuses[256] = {{0}};
    long k;
    int j;
    {n}_default(&param);
    for (j = 0; j < {n_param}; ++j) {{
        ((real *)&param)[j] = (real)values[j];
    }}
    if ({n}_init(&param, &state) != 0) {{
        return 2;
    }}
    for (k = 0; k < part * {parts}; ++k) {{
        const double *row = rows[(k < {n_rows}) ? k : {n_rows} - 1];
        for (j = 0; j < {n_in}; ++j) {{
            const double x = row[j] + ((sigma[j] > 0.0) ? sigma[j] * normal() : 0.0);
            ((real *)&in)[j] = (real)fmin(range[j][1], fmax(range[j][0], x));
        }}
        ++statuses[{n}_step(&in, &param, &state, &out) & 255];
        for (j = 0; j < {n_all}; ++j) {{
            const double x = (j < {n_state}) ? (double)((real *)&state)[j]
                                             : (double)((real *)&out)[j - {n_state}];
            if (k % part == 0) {{
                low[j] = x;
                high[j] = x;
                sum[j] = 0.0;
            }}
            low[j] = (x < low[j]) ? x : low[j];
            high[j] = (x > high[j]) ? x : high[j];
            sum[j] += x;
        }}
        if ((k + 1) % part == 0) {{
            for (j = 0; j < {n_all}; ++j) {{
                printf("%.17g %.17g %.17g\\n", low[j], high[j], sum[j] / (double)part);
            }}
        }}
    }}
    for (j = 0; j < 256; ++j) {{
        printf("%ld\\n", statuses[j]);
    }}
    return 0;
}}
"""


def endured(
    plan: Plan,
    made: Mapping[str, str],
    rows: np.ndarray,
    sigma: np.ndarray,
    params: Mapping[str, Any],
    ticks: int,
    seed: int = 1,
) -> dict[str, Any]:
    """Run a module for many ticks and compare ten equal parts of the run.

    Args:
        plan: the module.
        made: text of its files by name.
        rows: input elements of the ticks before, one row each; the last one is then held.
        sigma: noise of each input element, standard deviation, added in every tick.
        params: parameters by name; the others have their defaults.
        ticks: how many.
        seed: of the noise.

    Returns:
        ``ticks``, ``seconds_per_step``, ``status`` (ticks by status) and, for each state and
        output, ``low``, ``high``, ``mean`` of every part.

    Raises:
        RunFailed: the compiler refuses, or the module refuses its parameters.
    """
    import time

    lay, n = plan.layout, plan.name
    values = plan.block.param_values(**params)
    flat = [float(v) for m in lay.params for v in np.ravel(values[m.name], order="F")]
    members = [*lay.states, *lay.outputs]
    count = {
        k: sum(m.size for m in g)
        for k, g in (("n_in", lay.inputs), ("n_param", lay.params), ("n_state", lay.states),
                     ("n_all", members))
    }  # fmt: skip
    ends = [plan.limits(m) for m in lay.inputs for _ in range(m.size)]
    most = float(np.finfo(np.float32 if plan.real == "float" else np.float64).max)
    text = _DRIVER.format(
        n=n, real=plan.real, seed=88172645463325252 + seed, parts=PARTS, n_rows=len(rows),
        n_in_=max(count["n_in"], 1), n_param_=max(count["n_param"], 1),
        rows=", ".join(f"{{{', '.join(number(float(v)) for v in row) or '0.0'}}}" for row in rows),
        sigma=", ".join(number(float(v)) for v in sigma) or "0.0",
        range=", ".join(f"{{{max(lo, -most)!r}, {min(hi, most)!r}}}" for lo, hi in ends)
        or "{0.0, 0.0}",
        params=", ".join(number(v) for v in flat) or "0.0", **count,
    )  # fmt: skip
    compiler = cc.compilers()[0]
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch)
        for name in plan.files:
            (folder / name).write_text(made[name], encoding="utf-8")
        (folder / "driver.c").write_text(text, encoding="utf-8")
        objects = [folder / f"{n}.o", folder / "driver.o"]
        for o in objects:
            cc.compile_object(compiler, o.with_suffix(".c"), o)
        cc.link(compiler, objects, folder / "driver")
        begun = time.perf_counter()
        done = subprocess.run(
            [str(folder / "driver"), str(ticks)], capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - begun
    if done.returncode:
        raise RunFailed(f"{n}: init refuses the parameters")
    lines = done.stdout.split("\n")
    table = np.array([line.split() for line in lines[: PARTS * count["n_all"]]], dtype=float)
    table = table.reshape(PARTS, count["n_all"], 3)
    status = {str(k): int(lines[table.shape[0] * table.shape[1] + k]) for k in range(256)}
    names = [
        (f"{m.name}[{k}]" if m.size > 1 else m.name, "state" if i < len(lay.states) else "output")
        for i, m in enumerate(members) for k in range(m.size)
    ]  # fmt: skip
    return {
        "ticks": (ticks // PARTS) * PARTS,
        "seconds_per_step": seconds / ticks,
        "status": {k: v for k, v in status.items() if v},
        "signals": {
            f"{role} {name}": {
                w: table[:, k, j].tolist() for j, w in enumerate(("low", "high", "mean"))
            }
            for k, (name, role) in enumerate(names)
        },
    }


def drifting(found: Mapping[str, Any], share: float = 0.3) -> list[str]:
    """Names of the signals that grow.

    The largest absolute value of the second half of the run is beyond that of parts 2 to 5 by more
    than a ``share``. (The extremes of normal noise grow by less.). Part 1 has the transient.
    """
    names = []
    for name, s in found["signals"].items():
        size = np.maximum(np.abs(s["low"]), np.abs(s["high"]))
        if not size[5:].max() <= (1 + share) * size[1:5].max():  # NaN grows, too
            names.append(name)
    return names
