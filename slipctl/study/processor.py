"""A study's loop with its controller on an emulated processor, compared with the run in Python."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode import codegen
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.processor.in_loop import FAULTS, Board, HostModule, Stored, run_in_loop
from slipctl.ccode.check.processor.rig import Rig
from slipctl.ccode.check.vectors.expected_outputs import accepted_rows
from slipctl.ccode.compile import targets
from slipctl.ccode.compile.module import CModule, input_rows
from slipctl.ccode.module.header import bit
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.run.metrics import Run, measure, rail_changes
from slipctl.run.results import Case
from slipctl.run.simulation import simulate
from slipctl.study import execution
from slipctl.study.declaration import Study
from slipctl.study.request import Request

TRAJECTORY = 1e-9
"""Largest difference from Python in double, relative to the largest value of a signal."""

METRIC = 0.01
"""Largest relative difference of a metric in float; or twice what it moves by where the controller
in double keeps its inputs, outputs and states as floats. Where a law switches, or a limit cycle
lives in the last digits of the slip, that alone moves ticks of decisions and heights of cycles."""

ROUNDINGS = (None, 0, 1, 2)
"""Roundings that a metric is tried with: to the nearest float, and at random with these seeds."""


@dataclass(frozen=True)
class Comparison:
    """A run with the controller on a processor beside the one in Python; ``print`` says it.

    Attributes:
        data: what ``--out`` writes.
    """

    data: dict[str, Any]

    @property
    def passed(self) -> bool:
        """Whether the run is as it must be."""
        return bool(self.data["passed"])

    def __str__(self) -> str:
        d = self.data
        worst = max(d["signals"], key=lambda n: d["signals"][n])
        lines = [
            f"{d['name']} with {d['part']} on {d['target']} in {d['real']}: {d['ticks']} ticks in"
            f" {d['seconds']:.1f} s",
            f"  largest difference from Python outside the controller {d['signals'][worst]:.3g} of"
            f" the largest value ({worst})",
        ]
        for name, (python, target) in d["metrics"].items():
            move = d["metrics_move"].get(name, 0.0)
            said = f", moves by {move:.2g} with roundings" if move else ""
            mark = "  DIFFERS" if name in d["metrics_differ"] and not d["faults"] else ""
            lines.append(f"  {name}: {_said(python)} in Python, {_said(target)} here{said}{mark}")
        count = d["instructions"]
        lines.append(
            f"  instructions of a step: {count['mean']:.0f} in the mean, most {count['most']} (tick"
            f" {count['worst_tick']})"
        )
        if d["load"]:
            lines.append(f"  {load.load_line(d['load'])}")
        told = [f"{_bits(n)} in {k} tick{'s' * (k > 1)}" for n, k in d["status"].items()]
        lines.append(f"  status other than 0: {', '.join(told) or 'none'}")
        if d["faults"]:
            lines.append(f"  after the faults {d['difference_at_the_end']:.3g} of the largest slip")
        lines.append(f"  {'passed' if self.passed else 'FAILED: ' + ', '.join(d['failed'])}")
        return "\n".join(lines)


def compare(
    name: str,
    target: str,
    real: str,
    faults: Sequence[str] = (),
    out: Path | None = None,
    seconds: float | None = None,
    report: Callable[[str, float], object] = lambda what, share: None,
    clock: str | None = None,
) -> Comparison:
    """Run a loop of a study with its controller on a processor, and compare.

    In double the trajectory must be that of Python to 1e-9 of the largest value of each signal. In
    float each metric to 1 %, or to twice what storing floats moves it by. Every tick must have the
    status that the guards of the C have by the run in Python. With faults each of them must be told
    by the status. In the last tenth of the run the slip must be that of the undisturbed run to
    1 % of its largest value.

    Args:
        name: ``"study:loop"`` or ``"study:loop@scenario"``.
        target: ``"cortex-m4"`` or ``"cortex-m7"``.
        real: ``"double"`` or ``"float"``.
        faults: what happens on purpose, ``"1500=lost"``, ``late`` or ``broken``.
        out: file for the numbers.
        seconds: length of the run, where the scenario is longer.
        report: called with what is running and the share of it that is done.
        clock: frequency of the processor that the load is told for, ``"168MHz"``; by default that
            of the board. A step that takes longer than a tick fails.

    Raises:
        BadInput: no such loop, target or fault; no tick in so many seconds, or no such tick; faults
            where the study names no slip; a tool is missing.
        RunFailed: the board does not answer.
    """
    hertz = load.clock(clock)
    asked = Request.read(name).needs_loop()
    study, (loop, case) = asked.study, asked.chosen
    part = study.controller
    if seconds is not None:
        if not seconds >= (loop.period or 0.0):
            raise BadInput(f"--seconds {seconds:g} holds no tick of {name}; give more")
        length = min(seconds, case.scenario.duration)
        case = replace(case, scenario=replace(case.scenario, duration=length))
    runs = runs_of_part(loop, part)
    wanted = _faults(faults, round(case.scenario.duration / (runs.period or 1.0)))
    log = [*loop.inputs, *loop.outputs, *loop.states]
    if wanted and study.signals.find("slip", dict.fromkeys(log)) is None:
        raise BadInput(f"--fault: {name} logs no slip to recover; leave --fault out")
    targets.tool(target)
    targets.emulator(target)
    report("Python", 0.0)
    python = simulate(loop, case.scenario, log=log)
    plan = Plan(runs.block, part.replace(".", "_"), runs.period, real)
    params = codegen.logged_params(loop, part, python)
    began = time.perf_counter()
    with Rig(plan, codegen.texts(plan), target, params) as rig:
        got = run_in_loop(loop, part, case.scenario, rig, wanted, partial(report, target))
        steps = rig.instructions
    took = time.perf_counter() - began
    data: dict[str, Any] = {
        "name": name, "part": part, "target": target, "real": real, "seconds": took,
        "instructions": (count := _counted(steps)),
        "load": load.load(count["mean"], count["most"], runs.period, hertz),
        **_judged(study, case, loop, part, python, got, wanted, real, params, report),
    }  # fmt: skip
    failed = _failed(data)
    data |= {"failed": failed, "passed": not failed}
    if out is not None:
        store.write_json(out, data)
    return Comparison(data)


def closed_loop(
    asked: Request, part: str
) -> Callable[[CModule, Mapping[str, Any]], dict[str, Any]]:
    """What runs a float module of a part with the rest of its loop, beside the run in Python.

    Args:
        asked: names the loop.
        part: path of the part in it.

    Returns:
        Function of the loaded module and its parameters. It gives ``commands``: the largest
        difference of each output that a wire leads on, with its element, its tick and the largest
        value; ``metrics`` of both runs, those that differ, and whether it ``passed``. A metric may
        differ by 1 %, or by twice what it moves by in the module's own runs with the other float
        beside each input; these are made where one differs by more than 1 %.
    """
    study, (loop, case) = asked.study, asked.chosen

    def compared(module: CModule, params: Mapping[str, Any]) -> dict[str, Any]:
        block = runs_of_part(loop, part).block
        if len(module.block.outputs) < len(block.outputs):  # the metrics need what is measured, too
            with tempfile.TemporaryDirectory(prefix="slipctl_") as folder:
                module = codegen.c_module(block, folder, period=block.period, real="float")
                module = module.compile().load()

        def board(seed: int | None) -> HostModule:
            return HostModule(module.reset(**params), seed)

        python = simulate(loop, case.scenario, log=[*loop.inputs, *loop.outputs, *loop.states])
        got = run_in_loop(loop, part, case.scenario, board(None)).data
        wires = loop.wires.values()
        outputs = [n for n in loop[part].outputs if f"{part}.{n}" in wires and f"{part}.{n}" in got]
        metrics, here = _metrics(study, case, python), _metrics(study, case, got)
        moved: dict[str, float] = {}
        if not all(_close(m, here.get(n), 0.0) for n, m in metrics.items()):
            moved = _moved(study, case, loop, part, here, lambda what, share: None, ROUNDINGS[1:],
                           board)  # fmt: skip
        differ = [n for n, m in metrics.items() if not _close(m, here.get(n), moved.get(n, 0.0))]
        return {
            "ticks": min(len(python["time"]), len(got["time"])),
            "period": loop.period,
            "commands": {n: _farthest(python, got, f"{part}.{n}") for n in outputs},
            "metrics": {n: (m, here.get(n)) for n, m in metrics.items()},
            "metrics_move": moved,
            "metrics_differ": differ,
            "passed": not differ,
        }

    return compared


def _farthest(python: Any, got: Any, name: str) -> dict[str, Any]:
    """Largest difference of a signal while both runs last: how much, where, and when."""
    wanted, here = (d[name].values.reshape(len(d["time"]), -1) for d in (python, got))
    ticks = min(len(wanted), len(here))
    apart = np.abs(wanted[:ticks] - here[:ticks])
    tick, element = np.unravel_index(int(np.argmax(apart)), apart.shape)
    return {
        "absolute": float(apart[tick, element]), "largest": float(np.abs(wanted).max()),
        "element": int(element) if python[name].ndim > 1 else None, "tick": int(tick),
        "unit": python[name].attrs.get("units", ""),
    }  # fmt: skip


def _counted(steps: Sequence[int]) -> dict[str, Any]:
    """Instructions of a step: the mean, the most, and in which tick."""
    worst = int(np.argmax(steps))
    return {"mean": float(np.mean(steps)), "most": int(steps[worst]), "worst_tick": worst}


def _failed(data: Mapping[str, Any]) -> list[str]:
    """What is not as it must be; a NaN is not."""
    failed, faults = [], data["faults"]
    differences = data["signals"].values()
    if not faults and data["real"] == "double" and not all(d <= TRAJECTORY for d in differences):
        failed.append("trajectory")
    if not faults and data["metrics_differ"]:
        failed.append("metrics")
    if data["wrong_status"]:
        failed.append(f"status of {data['wrong_status']} ticks")
    if faults and not data["difference_at_the_end"] <= METRIC:
        failed.append("no recovery")
    if not data.get("load", {}).get("passed", True):
        failed.append("load")
    return failed


def _faults(words: Sequence[str], ticks: int) -> dict[int, str]:
    """What happens in which tick, as it was written; the tick behind it tells that it was lost."""
    found: dict[int, str] = {}
    for word in words:
        tick, _, what = word.partition("=")
        if not tick.isdigit() or what not in FAULTS:
            raise BadInput(
                f"--fault {word}: write TICK=WHAT, such as 1500=lost; {', '.join(FAULTS)}"
            )
        if int(tick) > ticks - 2:
            raise BadInput(
                f"--fault {word}: the run has {ticks} ticks and one must follow; write a tick from"
                f" 0 to {ticks - 2}"
            )
        if int(tick) in found:
            raise BadInput(f"--fault {word}: tick {tick} is {found[int(tick)]} already; write one")
        found[int(tick)] = what
    return found


def _bits(status: int) -> str:
    """A status as the documentation writes it."""
    return "no answer" if status < 0 else f"0x{status:03X}"


def _judged(
    study: Study,
    case: Case,
    loop: Block,
    part: str,
    python: Any,
    got: Any,
    faults: dict[int, str],
    real: str,
    params: Mapping[str, Any],
    report: Callable[[str, float], object],
) -> dict[str, Any]:
    """How a run on a processor differs from the one in Python."""
    outside = [
        str(n)
        for n in python
        if n in got.data and (not str(n).startswith(f"{part}.") or n in loop.wires.values())
    ]
    differences = {n: _difference(python[n].values, got.data[n].values) for n in outside}
    metrics, here = _metrics(study, case, python), _metrics(study, case, got.data)
    pairs = {n: (m, here.get(n)) for n, m in metrics.items()}
    moved = {}
    if real == "float" and not faults:
        block = runs_of_part(loop, part).block
        moved = _moved(study, case, loop, part, metrics, report, ROUNDINGS,
                       lambda seed: Stored(block, params, seed))  # fmt: skip
    differ = [n for n, (a, b) in pairs.items() if not _close(a, b, moved.get(n, 0.0))]
    expected = _told(_statuses(loop, part, python), faults)
    numbers, counts = np.unique(got.status[got.status != 0], return_counts=True)
    return {
        "ticks": len(got.status),
        "signals": differences,
        "metrics": pairs,
        "metrics_move": moved,
        "metrics_differ": differ,
        "status": {int(n): int(c) for n, c in zip(numbers, counts, strict=True)},
        "wrong_status": int(np.count_nonzero(expected != got.status)),
        "faults": {str(k): v for k, v in faults.items()},
        "difference_at_the_end": _at_the_end(study, python, got.data),
    }


def _difference(wanted: np.ndarray, got: np.ndarray, first: int = 0) -> float:
    """Largest difference from tick ``first`` on, of the largest value in any tick."""
    largest = float(np.abs(wanted).max(initial=0.0))
    return float(np.abs(wanted - got)[first:].max(initial=0.0)) / (largest or 1.0)


def _at_the_end(study: Study, python: Any, got: Any) -> float:
    """Difference of the slip in the last tenth of a run; NaN where the study names none."""
    slip = study.signals.find("slip", got)
    if slip is None:
        return float("nan")
    return _difference(python[slip].values, got[slip].values, -len(python["time"]) // 10)


def _metrics(study: Study, case: Case, data: Any) -> dict[str, float | None]:
    """Metrics of a run, each element by its own name; None where it has no value."""
    data = execution.add_known(study, case, data)
    run = Run(data, study.signals, rail_changes(data, case.scenario, study.signals), {})
    found: dict[str, float | None] = {}
    for n, m in measure(run).items():
        if isinstance(m.value, (list, tuple)):
            found |= {f"{n}[{k}]": v for k, v in enumerate(m.value)}
        elif n != "step_time":
            found[n] = m.value
    return found


def _moved(
    study: Study, case: Case, loop: Block, part: str, wanted: Mapping[str, float | None],
    report: Callable[[str, float], object], seeds: Sequence[int | None],
    board: Callable[[int | None], Board],
) -> dict[str, float]:  # fmt: skip
    """Largest change of each metric where numbers of the controller are kept as floats."""
    found = dict.fromkeys(wanted, 0.0)
    for seed in seeds:
        how = "floats to nearest" if seed is None else f"floats at random, seed {seed}"
        got = run_in_loop(loop, part, case.scenario, board(seed), report=partial(report, how))
        again = _metrics(study, case, got.data)
        for n, value in wanted.items():
            other = again.get(n)
            if value is not None and other is not None:
                found[n] = max(found[n], abs(value - other))
    return found


def _close(a: float | None, b: float | None, moved: float) -> bool:
    """Whether two values of a metric are one, up to twice what storing floats moves it by."""
    if a is None or b is None:
        return a is b
    return bool(abs(a - b) <= max(METRIC * max(abs(a), abs(b)), 2 * moved))


def _statuses(loop: Block, part: str, python: Any) -> np.ndarray:
    """Status that the guards of the C have in each tick, by the run in Python."""
    block, every, first, period = runs_of_part(loop, part)
    plan, ticks = Plan(block, period=period), len(python["time"])
    given = codegen.logged_params(loop, part, python)
    values = block.param_values(**given)
    rows = input_rows(block, plan.layout.inputs, codegen.logged_inputs(loop, part, python))
    called = np.broadcast_to(rows, (ticks, rows.shape[1]))[first::every]
    status = accepted_rows(plan, called, values)[1]
    for m in plan.layout.outputs:
        if f"{part}.{m.name}" in python:
            lo, hi, *_ = plan.ends([m], values)
            logged = python[f"{part}.{m.name}"].values.reshape(ticks, -1)[first::every]
            status[((logged < lo) | (logged > hi)).any(axis=1)] |= bit("LIMITED")
    return status


def _told(status: np.ndarray, faults: Mapping[int, str]) -> np.ndarray:
    """Status of each tick with faults; the next frame that is heard tells that one is missing."""
    status = status.copy()
    for tick, what in faults.items():
        if what == "late":
            status[tick] |= FAULTS["late"]
            continue
        status[tick] = -1 if what == "lost" else FAULTS["broken"]
        if faults.get(tick + 1, "late") == "late":
            status[tick + 1] |= FAULTS["lost"]
    return status


def _said(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"
