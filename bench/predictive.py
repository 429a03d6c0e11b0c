"""Generated C of predictive control and estimation: time of a tick, compile time, boards.

``python -m bench.predictive --out predictive_c.json`` writes the C of the reference
problem of the study ``predictive``, of longer horizons, of its other forms, and of four axles
side by side. That of a window of 30 samples and of the filters beside it is written,
too. Each is compiled with gcc at -O2. CPU time of a tick is taken on the host, the programs in
turn, so that ratios are of one run. The same C of a Cortex-M4 and a Cortex-M7 is counted in
instructions on emulated boards, beside Python.
``--against COMMIT`` is an earlier version of slipctl, whose C of the reference problem runs in turn
with today's.
"""

from __future__ import annotations

import argparse
import io
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.speed import machine
from slipctl import Block, c_module, connect, nmpc, sampled
from slipctl.ccode import codegen
from slipctl.errors import BadInput, RunFailed
from slipctl.predict.trials import Driver
from slipctl.run import store
from slipctl.studies.predictive.slip_problem import PEAKS, WEIGHTS, axle, cost, make, recorded

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

BOARDS = ("cortex-m4", "cortex-m7")
ON_BOARD = slice(20, 80)
"""Ticks that run on the boards; a change of rail is among them."""

NOT_COUNTED = (("160 stages", "double"),)
"""What no board has room for in 4 MB: its test has three instances, of 1.4 MB each."""

MOST_STATES = 30_000
"""Numbers of states over these ticks that a board has memory for; more states, fewer ticks."""


@dataclass(frozen=True)
class Program:
    """A folder of C, compiled to a program that takes its time.

    Attributes:
        path: the program. rows: its inputs.
        text: bytes of text of the module on the host.
        compile: CPU time of gcc in s.
    """

    path: Path
    rows: str
    text: int
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
    said = subprocess.run(["size", str(module)], capture_output=True, text=True, check=True).stdout
    text = int(said.splitlines()[1].split()[0])
    lines = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in rows)
    return Program(path, lines, text, after.children_user - before.children_user)


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


def estimator(name: str) -> tuple[Block, np.ndarray]:
    """An estimator of the adhesion force on the wheel of hst_braking, and measured ticks of it."""
    from slipctl.studies.predictive.estimation import filters

    block = filters(1e-2, 160.0)[name]
    rng = np.random.default_rng(1)
    t = 1e-3 * np.arange(1000)
    given = {"omega": 160 - 2 * t + 1e-2 * rng.standard_normal(t.size), "T_b": 0 * t - 5000}
    return block, np.array([given.get(n, np.ones(t.size)) for n in block.inputs]).T


def _with_rows(block: Block) -> tuple[Block, np.ndarray]:
    return block, four_rows(block)


TWO = {"scenarios": [{"mu_p": 0.6}, {}], "shared": 1, "rates": {"u": 20.0}}
"""Two scenarios behind a rate, in a plan that branches after a stage."""

PROBLEMS: dict[str, Callable[[], tuple[Block, np.ndarray]]] = {
    "reference": lambda: (make(), recorded(make())),
    "80 stages": lambda: (make(horizon=80), recorded(make())),
    "160 stages": lambda: (make(horizon=160), recorded(make())),
    "two parts": lambda: (make(split=True), recorded(make())),
    "deadline": lambda: (make(passes=4, deadline=True), recorded(make())),
    "exact Hessian": lambda: (make(hessian="exact"), recorded(make())),
    "branching": lambda: (make(**TWO), recorded(make())),
    "four axles": lambda: _with_rows(four_axles()),
    "window": lambda: estimator("mhe"),
    "filter ekf": lambda: estimator("ekf"),
    "filter ctukf": lambda: estimator("ctukf"),
}
"""Blocks by name, and the inputs on which each is timed."""


def on_boards(block: Block, rows: np.ndarray, real: str, folder: Path) -> dict[str, Any]:
    """Bytes, stack and instructions of a tick on each board, and whether Python says the same.

    The C is written into the folder.
    """
    ticks = min(len(rows[ON_BOARD]), MOST_STATES // sum(s.size for s in block.states.values()))
    middle = (ON_BOARD.start + ON_BOARD.stop) // 2
    some = rows[middle - ticks // 2 : middle - ticks // 2 + ticks]
    given = dict(zip(block.inputs, some.T, strict=True))
    report = codegen.check(block, given, folder, real=real, target=",".join(BOARDS))
    return {"passed": report["passed"]} | {
        t["target"]: {
            "text": t["bytes"]["text"], "stack": t["stack_used"], **t["instructions"],
            "double_helpers": len(t["double_helpers"]),
        }
        for t in report["targets"]
    }  # fmt: skip


WRITE = """import runpy, sys
tree, problem, out = sys.argv[1:]
sys.path.insert(0, tree)
import slipctl
assert slipctl.__file__.startswith(tree), slipctl.__file__
make = runpy.run_path(problem)["make"]
for real in ("double", "float"):
    slipctl.c_module(make(), f"{out}/{real}", real=real)
"""
"""Write the C of the reference problem by the slipctl of a tree."""


def written_by(commit: str, folder: Path) -> Path:
    """Write the C of the reference problem as slipctl at a commit did: folders double and float.

    Raises:
        BadInput: no such commit, as where this is no clone.
    """
    top, tree = Path(__file__).resolve().parents[1], folder / "tree"
    done = subprocess.run(["git", "-C", str(top), "archive", commit], capture_output=True)
    if done.returncode:
        raise BadInput(f"--against {commit}: no commit of {top}; leave it out, or name another one")
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        archive.extractall(tree, filter="data")
    named = ("studies/**/slip_problem.py", "studies/**/slip_nmpc.py")  # the second until it moved
    problem = next(path for name in named for path in tree.glob(name))
    subprocess.run([sys.executable, "-c", WRITE, str(tree), str(problem), str(folder)], check=True)
    return folder


def measured(names: Sequence[str], pairs: int, against: str | None) -> dict[str, Any]:
    """Times, bytes, instructions and ratios."""
    programs: dict[str, Program] = {}
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as made:
        work = Path(made)
        for name in names:
            block, rows = PROBLEMS[name]()
            for real in ("double", "float"):
                folder = work / f"{name} {real}".replace(" ", "_")
                if (name, real) in NOT_COUNTED:
                    c_module(block, folder, real=real)
                else:
                    found[f"{name}, {real}"] = on_boards(block, rows, real, folder)
                for k in (0, 1, 2) if block.composition.split else (0,):
                    word = f" prepared {k}" if k else ""
                    programs[f"{name}{word}, {real}"] = built(
                        folder, block.name, real, rows, folder / f"built_{k}", k
                    )
                print(f"written: {name}, {real}", flush=True)
        if against is not None:
            rows, earlier = recorded(make()), written_by(against, work / "against")
            for real in ("double", "float"):
                programs[f"against, {real}"] = built(
                    earlier / real, "nmpc", real, rows, work / f"against_{real}"
                )
        times: dict[str, list[float]] = {n: [] for n in programs}
        for _ in range(pairs):
            for n, program in programs.items():
                times[n].append(program.tick())
    for n, p in programs.items():
        host = {"tick_s": min(times[n]), "text": p.text, "compile_s": p.compile}
        found[n] = found.get(n, {}) | {"host": host}
    return found | ratios({n: np.array(t) for n, t in times.items()})


def ratios(times: dict[str, np.ndarray]) -> dict[str, float]:
    """Medians over the turns."""
    found = {}
    for real in ("double", "float"):
        t = {n.removesuffix(f", {real}"): v for n, v in times.items() if n.endswith(f", {real}")}
        if "two parts" in t:  # a part more of preparing, taken off, leaves the feedback
            feedback = 2 * t["two parts prepared 1"] - t["two parts prepared 2"]
            found[f"feedback over step, {real}"] = statistics.median(feedback / t["two parts"])
        for word, a, b in (
            ("160 over 80 stages", "160 stages", "80 stages"),
            ("reference over against", "reference", "against"),
        ):
            if {a, b} <= set(t):
                found[f"{word}, {real}"] = statistics.median(t[a] / t[b])
    return {n: float(v) for n, v in found.items()}


class Goal(NamedTuple):
    """A number that shall be at most so large, in double and in float.

    Attributes:
        name: as the page has it.
        row: of what is measured. place: in that row; the row is a number where it is empty.
        most: the largest value. unit: of both.
        reals: where it is asked.
    """

    name: str
    row: str
    place: tuple[str, ...]
    most: float
    unit: str
    reals: tuple[str, ...] = ("double", "float")


GOALS = (
    Goal("step over that of commit 3fc3fbf", "reference over against", (), 0.78, "1"),
    Goal("160 stages over 80", "160 over 80 stages", (), 2.1, "1"),
    Goal("feedback over the whole step", "feedback over step", (), 0.25, "1"),
    Goal("four axles", "four axles", ("host", "tick_s"), 1.5e-3, "s"),
    Goal("window of 30 samples", "window", ("host", "tick_s"), 100e-6, "s"),
    Goal("gcc -O2, reference", "reference", ("host", "compile_s"), 10.0, "s"),
    Goal("text on a Cortex-M4", "reference", ("cortex-m4", "text"), 35e3, "bytes", ("float",)),
)


def judged(found: dict[str, Any]) -> list[tuple[Goal, str, float]]:
    """Each goal of which there is a number: with float or double, and the number."""
    rows = []
    for goal in GOALS:
        for real in goal.reals:
            value = found.get(f"{goal.row}, {real}")
            for key in goal.place:
                value = value.get(key) if value is not None else None
            if value is not None:
                rows.append((goal, real, float(value)))
    return rows


def main() -> int:
    """Measure, print, judge and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(PROBLEMS)}; all if left out")
    parser.add_argument("--pairs", type=int, default=9, help="times of each program, in turn")
    parser.add_argument("--against", metavar="COMMIT", help="an earlier slipctl, as 3fc3fbf")
    parser.add_argument("--out", default="predictive_c.json")
    asked = parser.parse_args()
    try:
        if unknown := [n for n in asked.names if n not in PROBLEMS]:
            raise BadInput(f"no problem {unknown[0]!r}; there are {', '.join(PROBLEMS)}")
        found = measured(asked.names or list(PROBLEMS), asked.pairs, asked.against)
    except (BadInput, RunFailed) as error:
        print(f"slipctl: {error}", file=sys.stderr)
        return 2
    for name, row in found.items():
        print(name, row)
    missed = [name for name, row in found.items() if isinstance(row, dict)
              and not row.get("passed", True)]  # fmt: skip
    for goal, real, value in judged(found):
        print(f"{goal.name}, {real}: {value:.4g} {goal.unit}, at most {goal.most:g}")
        missed += [goal.name] * (value > goal.most)
    store.write_json(Path(asked.out), {"format": 1, "versions": machine(), "numbers": found})
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
