"""C of every controller on its targets: ``python -m slipctl.studies.c_targets [STUDY[:LOOP] ...]``.

Each controller of each study is written in double and in float, checked on this machine, and its
vectors are replayed on a Cortex-M4 and a Cortex-M7 that QEMU emulates. Beside the instructions of a
step on the M4 in float stand those of what CasADi itself generates with ``casadi_real=float`` from
the same block, with the same inputs.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, RunFailed, codegen, connect, doors, rls, store
from slipctl.ccode import board, expected, targets
from slipctl.ccode import compilers as cc
from slipctl.ccode.comparison import reference, trial_rows
from slipctl.ccode.module import input_rows
from slipctl.ccode.plan import Plan
from slipctl.ccode.rounding import INEXACT
from slipctl.models import subway_braking
from slipctl.models import subway_braking_control as control
from slipctl.optimum import argmax_block
from slipctl.studies import subway_braking_loops as loops

REALS = ("double", "float")
SEARCHING = "rls_argmax_super_twisting"
REPRESENTATIVE = (
    "subway_braking:sta", "hst_braking:eppfc_gradient", "hst_traction:hosm_limited",
    "freight_traction:smes_robust",
)  # fmt: skip
"""One controller of each paper."""

SECOND = 1.0
"""Length of a quick run in s."""
TARGETS = ",".join(board.TARGETS)

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
        ``mean`` and ``most`` instructions; bytes of text; what of double it needs.
    """
    plan = Plan(block, real="float")
    rows = trial_rows(plan) if inputs is None else input_rows(block, plan.layout.inputs, inputs)
    rows = rows[:ticks]
    values = block.param_values(**params)
    p = np.array(ca.DM(block.pack("param", values)).full()).ravel()
    x = expected.start_state(block, params)
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
        return {
            "mean": float(found[1]),
            "most": int(found[2]),
            "text": (cc.sizes(folder / "peer.o", board.TOOLS) or {}).get("text"),
            "double_functions": cc.in_double(needed),
        }


def searching() -> tuple[Block, str, Any]:
    """Loop, part, no scenario: least squares, peak of the curve, super-twisting in every tick.

    The searching controllers of the studies run their estimator every few ticks, which hides what
    it takes; here all three run in each. Its inputs are made up, as nothing in this loop would
    excite the estimator.
    """
    law, sta = subway_braking.double_exponential, control.super_twisting()
    wires = {
        "estimator.mu": "mu_hat", "estimator.v_s": "v_s", "slip.v_opt": "peak.best",
        **{f"peak.{n}": f"estimator.{n}" for n in law.params},
        **{f"slip.{n}": n for n in ("v", "v_s", "mu_hat", "a_demand", "f_hat", "W_hat")},
        "T_b": "slip.T_b",
    }  # fmt: skip
    parts = {
        "estimator": rls(law, form="recursive", start=loops.START, period=loops.H),
        "peak": argmax_block(law, "v_s", lo=0.01, hi=10.0, closed_form=True),
        "slip": control.controller(sta, "slip"),
    }
    loop, _ = doors.find_loop(doors.load_study("subway_braking"), "sta")
    around = {k: v for k, v in loop.wires.items() if k != "ctl.v_opt"} | {"truth.v_opt": "v_opt"}
    whole = connect(
        "loop", around, plant=loop["plant"], ctl=connect("ctl", wires, **parts), truth=loops.truth
    )
    return whole, "ctl", None


def controllers(wanted: list[str]) -> Iterator[tuple[str, Block, str, Any]]:
    """Name, loop, part and scenario of each controller of the studies, or of those wanted."""
    if not wanted or SEARCHING in wanted:
        yield (SEARCHING, *searching())
    wanted = wanted or list(doors.studies())
    names = dict.fromkeys(w.partition(":")[0] for w in wanted if w != SEARCHING)
    for name in names:
        study = doors.load_study(name)
        loops = [w.partition(":")[2] for w in wanted if w.partition(":")[0] == name and ":" in w]
        for loop_name in loops or doors.loop_names(study):
            loop, case = doors.find_loop(study, loop_name)
            try:
                loop[study.controller]
            except BadInput:
                continue  # a bound without a controller
            yield f"{name}:{loop_name}", loop, study.controller, case.scenario


def measured(
    loop: Block, part: str, scenario: Any, name: str, chosen: str = TARGETS
) -> dict[str, Any]:
    """Check one controller in double and float on this machine and on the targets."""
    inputs, params = codegen.recorded(loop, part, scenario) if scenario else (None, {})
    row: dict[str, Any] = {}
    for real in REALS:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
            report = codegen.export(
                loop[part], Path(scratch) / "c", re.sub(r"\W", "_", name), inputs=inputs,
                check=True, params=params, period=loop.period, real=real, target=chosen,
            )  # fmt: skip
        d = report.data
        row[real] = {
            "passed": report.passed,
            "ticks": d["ticks"],
            "largest_relative": d["largest_relative"],
            "worst_of_limit": max(
                (s["counted"] / s["limit"] for s in d["signals"].values()), default=0.0
            ),
            **{k: d[k] for k in ("ticks_off_range", "ticks_limited", "ticks_undecided")},
            "envelope": [n for n, s in d["signals"].items() if s["compared"] != "every tick"],
            "beyond": {
                n: [s["counted"], s["limit"]] for n, s in d["signals"].items()
                if not s["counted"] <= s["limit"]
            },
            "isolation": d["isolation"],
            "state_bytes": d["memory_bytes"]["state"],
            "targets": {
                t["target"]: {
                    **t["bytes"],
                    "instructions_mean": t["instructions"]["mean"],
                    "instructions_most": t["instructions"]["most"],
                    "stack_used": t["stack_used"],
                    "double_helpers": len(t["double_helpers"]),
                    "largest_relative": max(t["signals"].values(), default=0.0),
                    "passed": t["passed"],
                }
                for t in d["targets"]
            },
            "seconds": round(time.perf_counter() - began, 1),
        }  # fmt: skip
    if "cortex-m4" in row["float"]["targets"]:
        peer = casadi_float(loop[part], inputs, params, row["float"]["ticks"])
        ours = row["float"]["targets"]["cortex-m4"]["instructions_mean"]
        row["casadi_float"] = peer | {
            "times_ours": peer["mean"] / ours,
            "wanted": 10 if set(INEXACT) & set(peer["double_functions"]) else 5,
        }
    return row


def replayed(loop: Block, part: str, scenario: Any) -> dict[str, Any]:
    """Compare one controller in double on this machine, with one compiler and nothing else."""
    inputs, params = codegen.recorded(loop, part, scenario) if scenario else (None, {})
    block = loop[part]
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        module = codegen.c_module(block, Path(scratch) / "c", "ctl", period=loop.period)
        plan = Plan(block, "ctl", loop.period)
        rows = trial_rows(plan) if inputs is None else input_rows(block, plan.layout.inputs, inputs)
        good = expected.in_range(plan, rows)
        outputs, states = reference(block, rows[good], params)
        start = expected.start_state(block, params)
        run = expected.guarded(plan, rows, outputs, states, start)
        run = expected.with_limits(plan, run, params)
        module.compile(cc.compilers()[0]).load().reset(**params)
        got = np.hstack(module.replay_rows(run.rows))
        signals = expected.differences(plan, run, got)
        faults = run.faults(module.status, ~0)
    return {
        "passed": not faults and all(s["counted"] <= s["limit"] for s in signals.values()),
        "ticks": len(rows),
        "largest_relative": max((s["relative"] for s in signals.values()), default=0.0),
    }


def quick(words: list[str]) -> int:
    """Take a second of every controller in double here, of some on all targets, in float too."""
    failed = 0
    for name, loop, part, scenario in controllers(words):
        if scenario:
            scenario = replace(scenario, duration=min(scenario.duration, SECOND))
        everywhere = name in REPRESENTATIVE
        row = measured(loop, part, scenario, name) if everywhere else {}
        passed = all(row[real]["passed"] for real in REALS) if everywhere else True
        once = {} if everywhere else replayed(loop, part, scenario)
        passed = passed and once.get("passed", True)
        failed += not passed
        where = "all targets, double and float" if everywhere else f"{once['ticks']} ticks here"
        print(f"{name}: {'passed' if passed else 'FAILED'}, {where}", flush=True)
    return 1 if failed else 0


def main(words: list[str] | None = None) -> int:
    """Check the controllers named, or all, and write ``c_targets.json``."""
    parser = argparse.ArgumentParser(prog="python -m slipctl.studies.c_targets")
    parser.add_argument("name", nargs="*", help="STUDY or STUDY:LOOP; all by default")
    parser.add_argument("--out", default="c_targets.json", help="file to write")
    parser.add_argument(
        "--quick", action="store_true", help="a second of each, most in double here"
    )
    chosen = parser.parse_args(words)
    if chosen.quick:
        return quick(chosen.name)
    out, found, failed = Path(chosen.out), {}, 0
    for name, loop, part, scenario in controllers(chosen.name):
        try:
            row = measured(loop, part, scenario, name)
            passed = row["double"]["passed"] and row["float"]["passed"]
        except RunFailed as error:
            row, passed = {"failed": str(error)}, False
        failed += not passed
        found[name] = row
        peer = row.get("casadi_float", {})
        print(
            f"{name}: {'passed' if passed else 'FAILED'}; M4 float"
            f" {row.get('float', {}).get('targets', {}).get('cortex-m4', {})}; CasADi's float"
            f" {peer.get('mean')}, {peer.get('times_ours', 0):.1f} times",
            flush=True,
        )
        store.write_json(out, json.loads(json.dumps(found)))  # what was done stays when stopped
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
