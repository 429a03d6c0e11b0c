"""CasADi's own output in float on a Cortex-M4: what the generated C is measured against."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, RunFailed
from slipctl.ccode.check.comparison import trial_rows
from slipctl.ccode.check.float_error import INEXACT
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile import board, targets
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.module import input_rows
from slipctl.ccode.module.plan import Plan

_PEER = """#include "peer.h"
#include "cortex_m.h"
#include <stdio.h>
#include <string.h>

static float x[{nx}], next[{nx}], u[{nu}], p[{np}], y[{ny}], w[{nw}];
static int iw[{niw}];
static const float *arg[{narg}];
static float *res[{nres}];

int main(void)
{{
    FILE *file = fopen("rows.bin", "rb");
    int ticks = {ticks};
    unsigned long from, empty, count, most = 0;
    double sum = 0;
    int k;
    clock_start();
    from = clock_now();
    empty = instructions(from, clock_now());
    if (fread(p, 4, {np}, file) != {np} || fread(x, 4, {nx}, file) != {nx}) {{
        return 2;
    }}
    for (k = 0; k < ticks; ++k) {{
        if (fread(u, 4, {nu}, file) != {nu}) {{
            return 2;
        }}
        arg[0] = x;
        arg[1] = u;
        arg[2] = p;
        res[0] = next;
        res[1] = y;
        from = clock_now();
        (void)peer(arg, res, iw, w, 0);
        count = instructions(from, clock_now()) - empty;
        sum += count;
        most = (count > most) ? count : most;
        memcpy(x, next, sizeof(x));
    }}
    printf("mean %.1f most %lu\\n", sum / ticks, most);
    return 0;
}}
"""


def casadi_float(
    block: Block, inputs: Mapping[str, Any] | None, params: Mapping[str, Any], ticks: int
) -> dict[str, Any]:
    """Instructions per step on a Cortex-M4 of CasADi's own output in float.

    Args:
        block: the controller.
        inputs, params: of its run.
        ticks: how many of them.

    Returns:
        ``mean`` and ``most`` instructions; bytes of ``text``; ``double_functions``: what of double
        it needs; ``wanted``: how many times fewer the generated C should take, 10 where it calls
        functions such as exp, log and sin, 5 elsewhere.

    Raises:
        RunFailed: it does not compile, or comes to no end.
    """
    plan = Plan(block, real="float")
    rows = trial_rows(plan) if inputs is None else input_rows(block, plan.layout.inputs, inputs)
    rows = rows[:ticks]
    values = block.param_values(**params)
    p = np.array(ca.DM(block.pack("param", values)).full()).ravel()
    x = expected_outputs.start_state(block, params)
    f = block.f
    f = ca.Function("peer", f.sx_in() if f.is_a("SXFunction") else f.mx_in(),
                    f.call(f.sx_in() if f.is_a("SXFunction") else f.mx_in()))  # fmt: skip
    sizes = {"nx": f.size1_in(0), "nu": f.size1_in(1), "np": f.size1_in(2), "ny": f.size1_out(1),
             "nw": f.sz_w() + 64, "niw": f.sz_iw() + 64, "narg": f.sz_arg() + 64,
             "nres": f.sz_res() + 64}  # fmt: skip
    sizes = {k: max(int(v), 1) for k, v in sizes.items()} | {"ticks": len(rows)}
    padded = [np.resize(a, max(len(a), 1)) if len(a) else np.zeros(1) for a in (p, x)]
    wide = rows if rows.shape[1] else np.zeros((len(rows), 1))
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        folder = Path(scratch)
        for name, text in board.board_files().items():
            (folder / name).write_text(text, encoding="utf-8")
        options = {"with_header": True, "casadi_real": "float", "casadi_int": "int"}
        generator = ca.CodeGenerator("peer.c", options)
        generator.add(f)
        generator.generate(f"{folder}/")
        (folder / "main.c").write_text(_PEER.format(**sizes), encoding="utf-8")
        (folder / "rows.bin").write_bytes(
            b"".join(a.astype(np.float32).tobytes() for a in (*padded, wide))
        )
        compiler, machine = targets.tool("cortex-m4"), board.TARGETS["cortex-m4"]
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-w", *machine]
        made = targets.run([compiler, *flags, "-c", "peer.c"], folder)
        linked = targets.run(
            [compiler, *flags, "main.c", "peer.o", "cortex_m.c", "-o", "peer.elf", *board.LINK,
             "-lm"], folder,
        )  # fmt: skip
        if made.returncode or linked.returncode:
            raise RunFailed(f"CasADi's float output of {block.name}: {made.stderr}{linked.stderr}")
        needed = (cc.symbols(folder / "peer.o", board.TOOLS) or {}).get("needed", [])
        call = [*targets.command("cortex-m4", "peer.elf"), "-serial", "none", *board.COUNT]
        said = targets.run(call, folder)
        found = re.search(r"mean ([\d.]+) most (\d+)", said.stdout)
        if found is None:
            raise RunFailed(f"CasADi's float output of {block.name} came to no end")
        doubles = cc.in_double(needed)
        return {
            "mean": float(found[1]),
            "most": int(found[2]),
            "text": (cc.sizes(folder / "peer.o", board.TOOLS) or {}).get("text"),
            "double_functions": doubles,
            "wanted": 10 if set(INEXACT) & set(doubles) else 5,
        }
