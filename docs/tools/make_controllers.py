"""Write docs/c_controllers.md from the evidence: ``python docs/tools/make_controllers.py``.

``--check`` only compares.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from made import made

sys.path.append(str(Path(__file__).parents[2]))  # bench is not installed

from bench.c_targets import allowed, guards_take, passed
from bench.predictive import Goal, judged
from slipctl.ccode.ship.readable import table
from slipctl.study.processor import METRIC

HERE = Path(__file__).parents[1]
PAGE, EVIDENCE = HERE / "c_controllers.md", HERE / "evidence"

HEAD = """\
# Every controller in C

Made from [the evidence](evidence/c_targets.json) by `python docs/tools/make_controllers.py`; a
test fails when it is out of date. What is measured, and how, is told in
[the C interface](c_interface.md). `python -m bench.c_targets` measures it again.
"""

HOLDS = """\
## Does it hold

Back to back with Python over the run of the study, with the state carried in C. *Double* is the
largest difference of any output or state, of the largest value of its signal. *Float* is the
largest part of its limit that a signal takes ([how limits are found](c_interface.md#float)). Both
are on this machine. *Ends* counts the signals of which only the least and the greatest value is
compared,
*open* those that arithmetic alone decides; they are named below. *Targets* are the M4 and the M7,
in double and in float, with the first 20000 ticks at most. *MISRA* counts findings of required
rules in what slipctl writes and, after it, in CasADi's text. *FMU* is the version that FMPy
opened. *Runs* are those of libFuzzer. A run with more than 4e7 numbers of outputs and states is
taken as `slipctl run --quick` has it.
"""

COSTS = """\
## What it takes in float on a Cortex-M4

Bytes of text, of an instance (state with scratch memory), of stack (64 stands for at most 64).
Then instructions of a step, guards and status included, beside those of CasADi's own float output
of the same block. *Wanted* is ten times fewer where functions such as `exp` and `log` are called,
and five elsewhere.
"""

GUARDS = """\
## What the guards take

Instructions of a step in float on the M4, beside those of [the module without
guards](evidence/before_guards.json). *More* is the difference of the means. *Each* is that for
every input, state and output, as all of them are [guarded](c_interface.md#fault-concept). *At
most* is what was wanted: 15 for each of them, or a tenth of the step. If outputs are not counted,
{over} of {rows} take more than that. The worst tick is one in which an input is doubted: then
each is looked at with its age. Where *more* is negative the equations got shorter since. In
`rls_argmax_super_twisting`, which no study runs, they got longer: its matrices of three rows are
loops now, which read well, and were written out element by element.
"""

FORMS = """\
## Forms of predictive control, and the window

The slip problem of [the study](predictive.md) in the forms of [predictive control](nmpc.md), and
four of its axles in one controller. Then the window of 30 samples on the wheel of `hst_braking`,
with the filters beside it. *Deadline* makes four passes in each tick. *Branching* has two
scenarios, a shared stage and rates. Counted on both boards over a change of rail, beside Python
([evidence](evidence/predictive_c.json)); 160 stages in double do not fit on them. Bytes of text,
stack and instructions of a step; the M4 computes double in software. What has no row was not
counted in this evidence.
"""

GOALS_HEAD = """\
What was wanted of them. Times are CPU time on the machine of the evidence, the least of the
repeats; ratios are of programs that ran in turn.
`python -m bench.predictive --against 3fc3fbf` measures it again.
"""

IN_LOOP = """\
## In the loop

The plant in Python, the controller on the emulated M4, tick by tick
([how](c_interface.md#processor-in-the-loop), [evidence](evidence/pil.json)). *Plant* is the largest
difference of a signal outside the controller, of its largest value. *Beyond 1 %* names the metrics
that differ by more: their value in Python, here, and by how much storing floats alone moves them.
"""

OPEN = """\
## Signals that are not compared in every tick
"""


def page() -> str:
    """Text of the page."""
    evidence, in_loop, forms = (
        json.loads((EVIDENCE / f"{n}.json").read_text(encoding="utf-8"))
        for n in ("c_targets", "pil", "predictive_c")
    )
    found: dict[str, Any] = forms["numbers"]["predictive_c"]["numbers"]
    rows: dict[str, Any] = evidence["numbers"]["c_targets"]["rows"]
    least = [n for n, r in rows.items() if "times_ours" in r["casadi_float"]]
    few = [n for n in least if _times(rows[n]) < rows[n]["casadi_float"]["wanted"]]
    summary = (
        f"{sum(passed(r) for r in rows.values())} of {len(rows)} controllers pass all of it;"
        f" {len(least) - len(few)} of {len(least)} take as few instructions as wanted."
    )
    seconds = [r["fuzz"]["seconds"] for r in rows.values() if "fuzz" in r]
    if seconds:
        least = f"{min(seconds)} to " if min(seconds) < max(seconds) else ""
        summary += f" libFuzzer had {least}{max(seconds)} s for each."
    heads = ["controller", "ticks", "double", "float", "ends", "open", "targets",
             "MISRA", "FMU", "runs"]  # fmt: skip
    costs = ["controller", "text", "instance", "stack", "mean", "most", "CasADi's", "times",
             "wanted", "M7 mean"]  # fmt: skip
    parts = [
        HEAD, f"Measured {evidence['date']}. {summary}", HOLDS,
        table(heads, (_holds(n, r) for n, r in rows.items())), COSTS,
        table(costs, (_costs(n, r) for n, r in rows.items())),
        _guards(rows), FORMS, f"Measured {forms['date']}. {forms.get('note', '')}".strip(), table(
            ["form", "real", "holds", "M4 text", "M4 stack", "M4 mean", "M4 most", "M7 text",
             "M7 mean", "M7 most"],
            (_form(n, r) for n, r in found.items() if isinstance(r, dict) and "passed" in r),
        ), GOALS_HEAD, table(["what", "real", "measured", "at most", "unit", "reached"],
                             map(_goal, judged(found))), OPEN,
        "\n".join(line for n, r in rows.items() for line in _open(n, r)),
        IN_LOOP, table(["loop", "real", "ticks", "plant", "beyond 1 %", "passed"],
                       map(_in_loop, in_loop["numbers"].values())),
    ]  # fmt: skip
    return "\n\n".join(p.strip() for p in parts) + "\n"


def _times(row: Mapping[str, Any]) -> float:
    return float(row["casadi_float"]["times_ours"])


def _holds(name: str, row: Mapping[str, Any]) -> list[str]:
    double, real = row["double"], row["float"]
    if "ticks" not in double or "ticks" not in real:
        return [
            f"`{name}`",
            *[""] * 6,
            double.get("failed", real.get("failed", "failed")),
            "",
            "",
            "",
        ]
    targets = [t["passed"] for r in (double, real) for t in r["targets"].values()]
    ours = sum(double["misra"]["required"].values())
    kernel = sum(double["misra"]["kernel"].values())
    fmus = [v[3:] for v, f in row["fmu"].items() if isinstance(f, dict) and f["passed"]]
    fuzz = row.get("fuzz", {})
    runs = sum(fuzz.get(r, {}).get("executions", 0) for r in ("double", "float"))
    return [
        f"`{name}`", str(double["ticks"]), f"{double['largest_relative']:.1g}",
        f"{real['worst_of_limit']:.2f}",
        str(len(real["envelope"])), str(len(real["not_compared"])),
        f"{sum(targets)} of {len(targets)}", f"{ours}, {kernel}" if kernel else str(ours),
        ", ".join(fmus), f"{runs:,}".replace(",", " ") if runs else "",
    ]  # fmt: skip


def _costs(name: str, row: Mapping[str, Any]) -> list[str]:
    targets, peer = row["float"].get("targets", {}), row["casadi_float"]
    if not targets:
        return [f"`{name}`", *[""] * 9]
    m4, m7 = targets["cortex-m4"], targets["cortex-m7"]
    beside = (
        [f"{peer['mean']:.0f}", f"{_times(row):.1f}", str(peer["wanted"])]
        if "times_ours" in peer else [peer.get("failed", ""), "", ""]
    )  # fmt: skip
    return [
        f"`{name}`", str(m4["text"]), str(row["float"]["state_bytes"]), str(m4["stack_used"]),
        f"{m4['instructions_mean']:.0f}", str(m4["instructions_most"]), *beside,
        f"{m7['instructions_mean']:.0f}",
    ]  # fmt: skip


def _guards(rows: Mapping[str, Any]) -> str:
    """What the guards take in each controller that was counted without them."""
    told = json.loads((EVIDENCE / "before_guards.json").read_text(encoding="utf-8"))
    before, lines, over = told["numbers"]["before_guards"], [], 0
    for name, row in rows.items():
        if name not in before or not row["float"].get("targets"):
            continue
        took, elements = guards_take(row, before[name]), row["guarded"]
        over += took["more"] > allowed(before[name], elements["inputs"] + elements["states"])
        lines.append([
            f"`{name}`", *(str(elements[k]) for k in ("inputs", "states", "outputs")),
            f"{before[name]['mean']:.0f}", f"{took['more']:.0f}", f"{took['per_element']:.1f}",
            f"{took['may']:.0f}", "yes" if took["more"] <= took["may"] else "no",
            f"{took['most']:.0f}",
        ])  # fmt: skip
    heads = ["controller", "inputs", "states", "outputs", "without", "more", "each", "at most",
             "kept", "worst tick, more"]  # fmt: skip
    return f"{GUARDS.format(over=over, rows=len(lines))}\n{table(heads, lines)}"


def _form(name: str, row: Mapping[str, Any]) -> list[str]:
    form, real = name.rsplit(", ", 1)
    m4, m7 = row["cortex-m4"], row["cortex-m7"]
    counts = [m4["text"], m4["stack"], round(m4["mean"]), m4["most"], m7["text"],
              round(m7["mean"]), m7["most"]]  # fmt: skip
    return [form, real, "yes" if row["passed"] else "no", *map(str, counts)]


def _goal(one: tuple[Goal, str, float]) -> list[str]:
    goal, real, value = one
    unit, told = "" if goal.unit == "1" else goal.unit, f"{value:.3g}"
    told = told if value < 1e3 else f"{value:.0f}"
    return [goal.name, real, told, f"{goal.most:g}", unit, "yes" if value <= goal.most else "no"]


def _open(name: str, row: Mapping[str, Any]) -> list[str]:
    lines = []
    for key, text in (("envelope", "ends"), ("not_compared", "open")):
        signals = [f"`{s}`" for s in row["float"].get(key, [])]
        if signals:
            lines.append(f"* `{name}`, {text}: {', '.join(signals)}")
    return lines


def _in_loop(row: Mapping[str, Any]) -> list[str]:
    moved = row["metrics_move"]
    beyond = [
        f"`{n}` {a:.4g}, {b:.4g}, {moved.get(n, 0.0):.2g}"
        for n, (a, b) in row["metrics"].items()
        if None not in (a, b) and abs(a - b) > METRIC * max(abs(a), abs(b))
    ]
    faults = "".join(f", tick {tick} {what}" for tick, what in row["faults"].items())
    return [
        f"`{row['name']}`{faults}", row["real"], str(row["ticks"]),
        f"{max(row['signals'].values()):.1g}", "; ".join(beyond),
        "yes" if row["passed"] else ", ".join(row["failed"]),
    ]  # fmt: skip


if __name__ == "__main__":
    sys.exit(made(PAGE, page()))
