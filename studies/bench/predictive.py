"""Generated C of predictive control and estimation: time of a tick, compile time, bytes of text.

``python -m slipctl.studies.bench.predictive --out predictive_c.json`` writes the C of the reference
problem of :mod:`slipctl.studies.bench.peers.slip_nmpc`, of longer horizons, of four axles side by
side and of a window of 30 samples. Each is compiled with gcc at -O2, and the time of a tick is
taken on the host, the programs in turn, so that ratios are of one run. ``--against FOLDER`` is the
folder of the reference problem's C as another version of slipctl wrote it.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import Block, c_module, connect, nmpc, sampled
from slipctl.ccode import codegen
from slipctl.predict.trials import Driver
from slipctl.run import store
from slipctl.studies.bench.peers.slip_nmpc import PEAKS, WEIGHTS, axle, cost, make, recorded
from slipctl.studies.bench.speed import machine

TIMES = """#include "{n}.h"
#include <stdio.h>
#include <time.h>
int main(void)
{{
    static {real} rows[{ticks}][{width}];
    static {n}_state state;
    {n}_param param;
    {n}_out out;
    int k, j, r;
    double best = 1e30, x;
    for (k = 0; k < {ticks}; ++k) {{
        for (j = 0; j < {width}; ++j) {{
            if (scanf("%lf", &x) != 1) {{
                return 1;
            }}
            rows[k][j] = ({real})x;
        }}
    }}
    for (r = 0; r < {repeats}; ++r) {{
        struct timespec a, b;
        {n}_default(&param);
        (void){n}_init(&param, &state);
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
        for (k = 0; k < {ticks}; ++k) {{
{prepare}            (void){n}_step((const {n}_in *)(const void *)rows[k], &param, &state, &out);
        }}
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
        x = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
        best = x < best ? x : best;
    }}
    printf("%.9g\\n", best / {ticks});
    return 0;
}}
"""
"""Time of a tick in s: the least of the repeats over the recorded inputs."""

ARM = ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")


@dataclass(frozen=True)
class Program:
    """A folder of C, compiled to a program that takes its time.

    Attributes:
        path: the program. rows: its inputs.
        text: bytes of text of the module, on the host and on a Cortex-M4.
        compile: CPU time of gcc in s.
    """

    path: Path
    rows: str
    text: dict[str, int]
    compile: float

    def tick(self) -> float:
        """Time of a tick in s."""
        done = subprocess.run(
            [str(self.path)], input=self.rows, capture_output=True, text=True, check=True
        )
        return float(done.stdout)


def built(
    folder: Path, name: str, real: str, rows: np.ndarray, scratch: Path, prepares: int = 0
) -> Program:
    """Compile a module and a program that calls it on rows of inputs.

    Each tick is prepared so often before; what is prepared again is computed again.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    repeats = max(3, int(20 * 250 / len(rows)))
    call = f"(void){name}_prepare((const {name}_in *)(const void *)rows[k], &param, &state);\n"
    fields = dict(n=name, real=real, ticks=len(rows), width=rows.shape[1], repeats=repeats,
                  prepare=prepares * call)  # fmt: skip
    (scratch / "times.c").write_text(TIMES.format(**fields), encoding="utf-8")
    flags = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", "-ffp-contract=off", f"-I{folder}"]
    before = os.times()
    module = scratch / "module.o"
    subprocess.run(["gcc", *flags, "-c", str(folder / f"{name}.c"), "-o", str(module)], check=True)
    after = os.times()
    path = scratch / "times"
    subprocess.run(
        ["gcc", *flags, str(scratch / "times.c"), str(module), "-lm", "-o", str(path)], check=True
    )
    text = {"host": _text("size", module)}
    other = scratch / "arm.o"
    try:
        subprocess.run(
            [*ARM, *flags[2:], "-c", str(folder / f"{name}.c"), "-o", str(other)], check=True
        )
        text["m4"] = _text("arm-none-eabi-size", other)
    except FileNotFoundError:
        pass  # no such compiler here
    lines = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in rows)
    return Program(path, lines, text, after.children_user - before.children_user)


def _text(tool: str, target: Path) -> int:
    said = subprocess.run([tool, str(target)], capture_output=True, text=True, check=True).stdout
    return int(said.splitlines()[1].split()[0])


def four_axles(**options: Any) -> Block:
    """Four axles of the reference problem side by side in one controller."""
    parts = [f"a{i}" for i in range(4)]
    plant = connect("four", {}, **dict.fromkeys(parts, axle))
    residuals = connect("residuals", {}, **dict.fromkeys(parts, cost))
    weights = {f"{a}.{n}": w for a in parts for n, w in WEIGHTS.items()}
    controls = [f"{a}.u" for a in parts]
    return nmpc(
        plant, residuals, controls, h=0.02, weights=weights, substeps=4, name="nmpc", **options
    )


def four_rows(block: Block) -> np.ndarray:
    """Inputs of a closed loop in which the rail changes for one axle after the other."""
    plant, tick = sampled(axle, 0.02, "rk4", 4).f.map(4), Driver(block, compile=False)
    p = np.tile(np.array(axle.pack("param", axle.param_values())).reshape(-1, 1), 4)
    x, rows = np.tile(np.array([[10], [10.05], [1.0], [0.0]]), 4), []
    for k in range(100):
        peaks = np.array([PEAKS[max(k + 40 - 10 * i, 0)] for i in range(4)])
        held = {f"a{i}_mu_p": peaks[i] for i in range(4)} | {f"a{i}_s_ref": 0.02 for i in range(4)}
        states = {n: x[j % 4, j // 4] for j, n in enumerate(list(block.inputs)[:16])}
        rows.append([(states | held)[n] for n in block.inputs])
        u = tick(*rows[-1])[:4]
        x = np.array(plant(x, np.vstack([u, peaks, np.full(4, 0.02)]), p)[0])
    return np.array(rows)


def window() -> tuple[Block, np.ndarray]:
    """The window of 30 samples on the wheel of hst_braking, and measured ticks of it."""
    from slipctl.studies.predictive.estimation import filters

    block = filters(1e-2, 160.0)["mhe"]
    rng = np.random.default_rng(1)
    t = 1e-3 * np.arange(1000)
    given = {"omega": 160 - 2 * t + 1e-2 * rng.standard_normal(t.size), "T_b": 5000 + 0 * t}
    return block, np.array([given.get(n, np.ones(t.size)) for n in block.inputs]).T


def _with_rows(block: Block) -> tuple[Block, np.ndarray]:
    return block, four_rows(block)


PROBLEMS: dict[str, Callable[[], tuple[Block, np.ndarray]]] = {
    "reference": lambda: (make(), recorded(make())),
    "80 stages": lambda: (make(horizon=80), recorded(make())),
    "160 stages": lambda: (make(horizon=160), recorded(make())),
    "two parts": lambda: (make(split=True), recorded(make())),
    "deadline": lambda: (make(passes=4, deadline=True), recorded(make())),
    "four axles": lambda: _with_rows(four_axles()),
    "window": window,
}
"""Blocks by name, and the inputs on which each is timed."""


def on_board(block: Block, rows: np.ndarray, real: str) -> dict[str, Any]:
    """Instructions of a tick on a Cortex-M4, mean and most, over a change of rail."""
    given = dict(zip(block.inputs, rows[40:80].T, strict=True))
    with tempfile.TemporaryDirectory() as folder:
        report = codegen.check(block, given, folder, real=real, target="cortex-m4")
    return dict(report["targets"][0]["instructions"])


def measured(names: Sequence[str], pairs: int, against: Path | None) -> dict[str, Any]:
    """Times, bytes and ratios."""
    programs: dict[str, Program] = {}
    counts: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as made:
        work = Path(made)
        for name in names:
            block, rows = PROBLEMS[name]()
            for real in ("double", "float"):
                folder = work / f"{name} {real}".replace(" ", "_")
                module = c_module(block, folder, real=real)
                programs[f"{name}, {real}"] = built(
                    folder, module.name, real, rows, folder / "built"
                )
                if name == "deadline":
                    counts[f"instructions with a deadline, {real}"] = on_board(block, rows, real)
                if block.split:
                    for k in (1, 2):
                        programs[f"{name} prepared {k}, {real}"] = built(
                            folder, module.name, real, rows, folder / f"built_{k}", k
                        )
        if against is not None:
            rows = PROBLEMS["reference"]()[1]
            for real in ("double", "float"):
                folder = against / real
                programs[f"against, {real}"] = built(
                    folder, "nmpc", real, rows, work / f"against_{real}"
                )
        times: dict[str, list[float]] = {n: [] for n in programs}
        for _ in range(pairs):
            for n, program in programs.items():
                times[n].append(program.tick())
    found: dict[str, Any] = counts | {
        n: {"tick_s": statistics.median(times[n]), "text": p.text, "compile_s": p.compile}
        for n, p in programs.items()
    }
    for real in ("double", "float"):
        if f"two parts, {real}" in times:
            step, once, twice = (
                np.array(times[f"two parts{p}, {real}"]) for p in ("", " prepared 1", " prepared 2")
            )
            found[f"feedback over step, {real}"] = float(np.median((2 * once - twice) / step))
        ratios = {"160 over 80 stages": ("160 stages", "80 stages")}
        if against is not None:
            ratios["reference over against"] = ("reference", "against")
        for word, (a, b) in ratios.items():
            if not {f"{a}, {real}", f"{b}, {real}"} <= set(times):
                continue
            each = zip(times[f"{a}, {real}"], times[f"{b}, {real}"], strict=True)
            found[f"{word}, {real}"] = statistics.median(x / y for x, y in each)
    return found


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(PROBLEMS)}; all if left out")
    parser.add_argument("--pairs", type=int, default=9, help="times of each program, in turn")
    parser.add_argument("--against", type=Path, help="folder with folders double and float")
    parser.add_argument("--out", default="predictive_c.json")
    asked = parser.parse_args()
    found = measured(asked.names or list(PROBLEMS), asked.pairs, asked.against)
    for name, row in found.items():
        print(name, row)
    data = {"format": 1, "versions": machine(), "numbers": found}
    store.write_json(Path(asked.out), data)


if __name__ == "__main__":
    main()
