"""Every controller as C, checked: ``python -m bench.c_targets [STUDY[:LOOP] ...]``.

A row per controller of each study, from sensor to actuator:

* ``double`` and ``float``: back to back with Python on this machine, sanitizers, two instances, two
  modules in one program. Then the same vectors on a Cortex-M4 and a Cortex-M7 that QEMU emulates,
  and what cppcheck finds by the rules of MISRA C:2012.
* ``casadi_float``: instructions of a step on the M4 of what CasADi itself generates with
  ``casadi_real=float`` from the same block, on the same inputs.
* ``fmu``: FMPy validates the FMU, simulates it on the recorded inputs, and compares with Python.
* ``fuzz``: any bytes, half of the time in double and half in float.

What stands in ``--out`` already for the same text and the same inputs is not done again. So a run
that was stopped goes on, and a long one can be done in pieces.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench import fmus
from bench.peers.casadi_float import casadi_float
from slipctl import BadInput, Block, RunFailed, connect, rls
from slipctl.analysis.optimum import argmax_block
from slipctl.ccode import codegen
from slipctl.ccode.check import fuzz
from slipctl.ccode.check.comparison import expected_run, trial_rows
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile import board, targets
from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.module import input_rows
from slipctl.ccode.module.plan import Plan
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.huang_2020 import subway_braking_control as control
from slipctl.models.ranges import fit_ranged, peak_ranged
from slipctl.run import store
from slipctl.run.results import Case
from slipctl.studies.subway_braking import loops
from slipctl.study import resolve

REALS = ("double", "float")
SEARCHING = "rls_argmax_super_twisting"
REPRESENTATIVE = (
    "subway_braking:sta", "hst_braking:eppfc_gradient", "hst_traction:hosm_limited",
    "freight_traction:smes_robust",
)  # fmt: skip
"""One controller of each paper."""

SECOND = 1.0
"""Length of a quick run in s."""

LONG = 40_000_000
"""A run with more numbers of outputs and states is taken as ``slipctl run --quick`` has it."""

TARGETS = ",".join(board.TARGETS)


# ---- the controllers ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Controller:
    """A controller in its loop.

    Attributes:
        name: ``study:loop``.
        loop: the loop. part: path of the controller in it.
        scenario: run that its inputs are recorded in; None: inputs are made up.
    """

    name: str
    loop: Block
    part: str
    scenario: Any

    @property
    def block(self) -> Block:
        """The controller, from sensor to actuator."""
        return self.loop[self.part]

    @property
    def c(self) -> str:
        """Its name in C."""
        return re.sub(r"\W", "_", self.name)

    @cached_property
    def recorded(self) -> tuple[Mapping[str, Any] | None, Mapping[str, Any]]:
        """Inputs and parameters of its run."""
        if self.scenario is None:
            return None, {}
        return codegen.record_part(self.loop, self.part, self.scenario)

    def plan(self, real: str) -> Plan:
        """What its C is written from."""
        return Plan(self.block, self.c, self.loop.period, real)

    def content(self) -> str:
        """Hash of its C without comments, of inputs and parameters, and of compilers' versions."""
        inputs, params = self.recorded
        tools = [*cc.compilers(), targets.tool("cortex-m4")]
        whole = hashlib.sha256("".join(map(cc.version, tools)).encode())
        for real in REALS:
            made = codegen.texts(self.plan(real))
            code = [bare(made[n]) for n in sorted(made) if n.endswith((".h", ".c"))]
            whole.update(repr(code).encode())
        for n, values in (inputs or {}).items():
            whole.update(n.encode() + np.ascontiguousarray(values, dtype=float).tobytes())
        whole.update(repr([(n, np.asarray(v).tolist()) for n, v in params.items()]).encode())
        return whole.hexdigest()[:16]


def bare(text: str) -> str:
    """C without comments and line breaks."""
    return " ".join(re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL).split())


def searching() -> Controller:
    """Least squares, peak of the curve and super-twisting in every tick.

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
        "estimator": fit_ranged(rls(law, form="recursive", start=loops.START, period=loops.H), law),
        "peak": peak_ranged(
            argmax_block(law, "v_s", lo=0.01, hi=10.0, closed_form=True, value=False)
        ),
        "slip": control.controller(sta, "slip"),
    }
    loop, _ = resolve.find_loop(resolve.load_study("subway_braking"), "sta")
    around = {k: v for k, v in loop.wires.items() if k != "ctl.v_opt"} | {"truth.v_opt": "v_opt"}
    whole = connect(
        "loop", around, plant=loop["plant"], ctl=connect("ctl", wires, **parts), truth=loops.truth
    )
    return Controller(SEARCHING, whole, "ctl", None)


def controllers(wanted: list[str]) -> Iterator[Controller]:
    """Each controller of the studies, or of those wanted, ``STUDY`` or ``STUDY:LOOP``.

    Raises:
        BadInput: no such study or loop.
    """
    if not wanted or SEARCHING in wanted:
        yield searching()
    names = [w for w in wanted if w != SEARCHING] if wanted else list(resolve.studies())
    for name in dict.fromkeys(w.partition(":")[0] for w in names):
        study = resolve.load_study(name)
        cases = resolve.build_cases(study)
        short: list[Case] = []
        chosen = [w.partition(":")[2] for w in names if w.startswith(f"{name}:")]
        for loop_name in chosen or dict.fromkeys(n for case in cases for n in case.loops):
            loop, case = resolve.pick_loop(study, cases, loop_name)
            if study.controller not in loop.parts:  # a bound has no controller
                continue
            if _numbers(loop, study.controller, case) > LONG:
                short = short or resolve.build_cases(study, quick=True)
                loop, case = resolve.pick_loop(study, short, loop_name)
            yield Controller(f"{name}:{loop_name}", loop, study.controller, case.scenario)


def _numbers(loop: Block, part: str, case: Case) -> float:
    """How many numbers a run of a part has: outputs and states in each tick."""
    kept = (*loop[part].outputs.values(), *loop[part].states.values())
    return case.scenario.duration / (loop.period or 1.0) * sum(s.size for s in kept)


# ---- what a row holds ---------------------------------------------------------------------------


class Wanted(NamedTuple):
    """What shall be done.

    Attributes:
        targets: processors, separated by commas.
        fuzz: seconds of libFuzzer for each controller.
    """

    targets: str = TARGETS
    fuzz: int = 0


def guarded(one: Controller) -> dict[str, int]:
    """How many numbers its guards look at in a step."""
    layout = one.plan("float").layout
    groups = {"inputs": layout.inputs, "states": layout.states, "outputs": layout.outputs}
    return {what: sum(m.size for m in members) for what, members in groups.items()}


def checked(one: Controller, real: str, chosen: Wanted) -> dict[str, Any]:
    """Check a controller on this machine and on the targets, and count MISRA findings."""
    inputs, params = one.recorded
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        report = codegen.export(
            one.block, Path(scratch) / "c", one.c, inputs=inputs, check=True, params=params,
            period=one.loop.period, real=real, target=chosen.targets, misra=True,
        )  # fmt: skip
    d = report.data
    signals, compared = d["signals"], d["signals"].values()
    return {
        "passed": report.passed,
        "ticks": d["ticks"],
        "largest_relative": d["largest_relative"],
        "worst_of_limit": max((s["counted"] / s["limit"] for s in compared), default=0.0),
        **{k: d[k] for k in ("ticks_off_range", "ticks_limited", "ticks_undecided")},
        "envelope": [n for n, s in signals.items() if s["compared"] == "envelope"],
        "not_compared": [n for n, s in signals.items() if s["compared"] == "nothing"],
        "beyond": {
            n: [s["counted"], s["limit"]] for n, s in signals.items()
            if not s["counted"] <= s["limit"]
        },
        "isolation": d["isolation"],
        "state_bytes": d["memory_bytes"]["state"],
        "compilers": [c["compiler"] for c in d["compiled"]],
        "targets": {
            t["target"]: {
                **t["bytes"],
                "instructions_mean": t["instructions"]["mean"],
                "instructions_most": t["instructions"]["most"],
                "stack_used": t["stack_used"],
                "double_helpers": len(t["double_helpers"]),
                "largest_relative": max(t["signals"].values(), default=0.0),
                "ticks": t["ticks"],
                "passed": t["passed"],
            }
            for t in d["targets"]
        },
        "misra": {
            "tool": d["analysis"]["tool"], "required": d["analysis"]["required"],
            "kernel_lines": d["analysis"]["kernel_lines"],
            "kernel": d["analysis"]["misra"].get("kernel", {}),
        },
    }  # fmt: skip


def beside_casadi(one: Controller, row: Mapping[str, Any]) -> dict[str, Any]:
    """Count CasADi's own float output on the same ticks."""
    ours = row["float"].get("targets", {}).get("cortex-m4")  # none where it failed
    if ours is None:
        return {}
    try:
        peer = casadi_float(one.block, *one.recorded, ours["ticks"])
    except RunFailed as error:  # too big for the board, say: nothing to compare with
        return {"passed": True, "failed": str(error)}
    return peer | {"times_ours": peer["mean"] / ours["instructions_mean"], "passed": True}


def opened(one: Controller) -> dict[str, Any]:
    """Let FMPy open its FMUs; without a run there is nothing to simulate."""
    if one.scenario is None:
        return {"passed": True}
    found = fmus.opened_by_fmpy(one.loop, one.part, one.scenario)
    return {"passed": all(f["passed"] for f in found.values()), **found}


def fuzzed(one: Controller, seconds: int) -> dict[str, Any]:
    """Give it any bytes, in double and in float, for half of the time each."""
    found = {}
    for real in REALS:
        plan = one.plan(real)
        found[real] = fuzz.run_fuzzer(plan, codegen.texts(plan), max(seconds // len(REALS), 1))
    return {"passed": all(f["passed"] for f in found.values()), "seconds": seconds, **found}


def made(one: Controller, chosen: Wanted, kept: Mapping[str, Any]) -> dict[str, Any]:
    """Row of a controller; what was kept for the same content is taken over.

    Args:
        one: the controller.
        chosen: what shall be done.
        kept: its row as it was, or {}.
    """
    row: dict[str, Any] = {"content": one.content(), "guarded": guarded(one)}
    same = kept.get("content") == row["content"]
    steps: dict[str, Callable[[], dict[str, Any]]] = {
        **{real: lambda real=real: checked(one, real, chosen) for real in REALS},  # type: ignore[misc]
        "casadi_float": lambda: beside_casadi(one, row),
        "fmu": lambda: opened(one),
    }
    for part, step in steps.items():
        row[part] = kept[part] if same and kept.get(part, {}).get("passed") else _timed(step)
    before = kept.get("fuzz", {}) if same else {}
    if before.get("passed") and before["seconds"] >= chosen.fuzz:
        row["fuzz"] = before
    elif chosen.fuzz:
        row["fuzz"] = _timed(lambda: fuzzed(one, chosen.fuzz))
    return row


def _timed(step: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What a step gives, with the time it took; a failure is a result too."""
    began = time.perf_counter()
    try:
        found = step()
    except RunFailed as error:
        found = {"passed": False, "failed": str(error)}
    return found | {"took_s": round(time.perf_counter() - began, 1)}


def passed(row: Mapping[str, Any]) -> bool:
    """Whether all that was done of a row passed."""
    return all(part.get("passed", True) for part in row.values() if isinstance(part, dict))


PER_ELEMENT, SHARE = 15, 0.1
"""Instructions that a guarded number may take in a step, or a share of the step without guards."""


def allowed(before: Mapping[str, float], elements: int) -> float:
    """Instructions that guards of so many numbers may take, beside a module without them."""
    return max(SHARE * before["mean"], PER_ELEMENT * elements)


def guards_take(row: Mapping[str, Any], before: Mapping[str, float]) -> dict[str, float]:
    """Instructions of a step on the M4, in float, beside those of a module without guards.

    Args:
        row: of a controller.
        before: ``mean`` and ``most`` of the module without guards.

    Returns:
        ``more``: difference of the means; ``most``: of the worst ticks; ``per_element``: of the
        means, for each input, state and output; ``may``: what the mean may be more.
    """
    now, elements = row["float"]["targets"]["cortex-m4"], sum(row["guarded"].values())
    more = now["instructions_mean"] - before["mean"]
    return {
        "more": more, "most": now["instructions_most"] - before["most"],
        "per_element": more / elements,
        "may": allowed(before, elements),
    }  # fmt: skip


# ---- running ------------------------------------------------------------------------------------


def replayed(one: Controller) -> dict[str, Any]:
    """Compare one controller in double on this machine, with one compiler and nothing else."""
    inputs, params = one.recorded
    block = one.block
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        module = codegen.c_module(block, Path(scratch) / "c", "ctl", period=one.loop.period)
        plan = Plan(block, "ctl", one.loop.period)
        rows = trial_rows(plan) if inputs is None else input_rows(block, plan.layout.inputs, inputs)
        run = expected_outputs.with_limits(plan, expected_run(plan, rows, params), params)
        module.compile(cc.compilers()[0]).load().reset(**params)
        got = np.hstack(module.replay_rows(run.rows))
        signals = expected_outputs.differences(plan, run, got)
        faults = run.faults(module.status, ~0)
    return {
        "passed": not faults and all(s["counted"] <= s["limit"] for s in signals.values()),
        "ticks": len(rows),
        "largest_relative": expected_outputs.largest_relative(signals)[0],
    }


def quick(words: list[str]) -> int:
    """Take a second of every controller in double here, of some on all targets, in float too."""
    failed = 0
    for one in controllers(words):
        if one.scenario is not None:
            duration = min(one.scenario.duration, SECOND)
            one = replace(one, scenario=replace(one.scenario, duration=duration))
        if one.name in REPRESENTATIVE:
            good = all(checked(one, real, Wanted())["passed"] for real in REALS)
            where = "all targets, double and float"
        else:
            once = replayed(one)
            good, where = once["passed"], f"{once['ticks']} ticks here"
        failed += not good
        print(f"{one.name}: {'passed' if good else 'FAILED'}, {where}", flush=True)
    return 1 if failed else 0


def _row(name: str, chosen: Wanted, kept: Mapping[str, Any]) -> dict[str, Any]:
    """Row of a controller by its name, in a process of its own."""
    (one,) = controllers([name])
    return made(one, chosen, kept)


def said(name: str, row: Mapping[str, Any]) -> str:
    """One line on a row."""
    ours = row["float"].get("targets", {}).get("cortex-m4", {})
    peer, fuzzing = row["casadi_float"], row.get("fuzz", {})
    text = f"{name}: {'passed' if passed(row) else 'FAILED'}"
    if ours:
        text += f"; M4 float {ours['instructions_mean']:.0f} instructions"
    if "times_ours" in peer:
        text += f", CasADi's {peer['times_ours']:.1f} times"
    runs = sum(fuzzing.get(real, {}).get("executions", 0) for real in REALS)
    return text + (f"; {runs} runs of libFuzzer" if fuzzing else "")


def main(words: list[str] | None = None) -> int:
    """Check the controllers named, or all, and write ``c_targets.json``."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.c_targets", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("name", nargs="*", help="STUDY or STUDY:LOOP; all by default")
    parser.add_argument("--out", default="c_targets.json", help="file to write, and to go on from")
    parser.add_argument("--fuzz", type=int, default=0, metavar="SECONDS", help="of each controller")
    parser.add_argument("--jobs", type=int, default=1, help="controllers at a time")
    parser.add_argument(
        "--quick", action="store_true", help="a second of each, most in double here"
    )
    words_ = parser.parse_args(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends its processes, as Ctrl-C does
    try:
        if words_.quick:
            return quick(words_.name)
        return _all(words_)
    except BadInput as error:
        print(f"slipctl: {error}", file=sys.stderr)
        return 2


def _all(words: argparse.Namespace) -> int:
    out, chosen = Path(words.out), Wanted(fuzz=words.fuzz)
    names = [one.name for one in controllers(words.name)]
    rows = store.read_json(out)["rows"] if out.exists() else {}
    failed = 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(words.jobs, 1), mp_context=context) as pool:
        running = {pool.submit(_row, n, chosen, rows.get(n, {})): n for n in names}
        try:
            for done in as_completed(running):
                name = running[done]
                rows[name] = json.loads(json.dumps(done.result()))
                failed += not passed(rows[name])
                print(said(name, rows[name]), flush=True)
                store.write_json(out, {"format": 1, "rows": dict(sorted(rows.items()))})
        except BaseException as error:  # the others' rows would be lost: end them at once
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.terminate()
            if not isinstance(error, KeyboardInterrupt):
                raise
            print(f"slipctl: stopped; {out} has what was done", file=sys.stderr)
            return 130
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
