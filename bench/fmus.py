"""FMUs that FMPy opens: ``python -m bench.fmus [STUDY[:LOOP] ...]``.

The controller of each loop and each plant is written as FMU 2.0 and 3.0. FMPy validates both and
simulates the first second of the loop's run on the inputs recorded there, from the parameters and
start values it had. Outputs, states and status of every tick are compared with the block in Python.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import BadInput, Block, Scenario, simulate
from slipctl.ccode import codegen
from slipctl.ccode.check.comparison import expected_run
from slipctl.ccode.check.vectors import expected_outputs
from slipctl.ccode.compile.module import input_rows
from slipctl.ccode.module.header import bit
from slipctl.ccode.module.layout import c_elements
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship.fmu import VERSIONS
from slipctl.ccode.ship.fmu_xml import Variable, is_plant, variables
from slipctl.run import store
from slipctl.study import resolve

PLANTS = ("plant", "world")
"""Names of the part of a loop that is no controller."""


def opened_by_fmpy(
    loop: Block, part: str, scenario: Scenario, seconds: float = 1.0
) -> dict[str, dict[str, Any]]:
    """Let FMPy validate and simulate the FMUs of a part of a loop, and compare with Python.

    Args:
        loop: a loop of a study.
        part: the part that becomes an FMU, a controller or a plant.
        scenario: gives inputs, parameters and start values.
        seconds: how much of it.

    Returns:
        For ``"fmi2"`` and ``"fmi3"``: ``valid``, and ``problems`` where FMPy finds any;
        ``relative``, the largest difference from Python of any output or state in parts of the
        signal's largest value, and ``worst``, the signal; ``ticks``; ``status_differs``, ticks with
        another status; ``passed``: valid, at most 1e-12, the same status.

    Raises:
        BadInput: FMPy is not installed.
    """
    try:
        from fmpy import simulate_fmu  # type: ignore[import-not-found]
        from fmpy.validation import validate_fmu  # type: ignore[import-not-found]
    except ImportError:
        raise BadInput("opening FMUs needs FMPy; pip install fmpy") from None
    scenario = replace(scenario, duration=min(scenario.duration, seconds))
    block, inputs, params, start = _recorded(loop, part, scenario)
    plan = Plan(block, "part", loop.period)
    rows = input_rows(block, plan.layout.inputs, inputs)
    found = variables(plan)
    wanted = _wanted(plan, rows, params, start)
    h = float(plan.period or 0.0)
    names = ["time", *(v.name for v in found[: rows.shape[1]])]
    signals = np.zeros(len(rows), [(n, float) for n in names])
    signals["time"] = np.arange(len(rows)) * h
    for n, column in zip(names[1:], rows.T, strict=True):
        signals[n] = column
    begin = _elements(found, ("parameter",), params)
    begin |= _elements(found, ("local", "output"), start)
    report: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        codegen.export(block, Path(scratch) / "c", plan.name, period=loop.period, fmus=True)
        for version in VERSIONS:
            path = str(Path(scratch) / "c" / f"{plan.name}_fmi{version}.fmu")
            problems = validate_fmu(path)
            result = simulate_fmu(
                path, stop_time=len(rows) * h, output_interval=h, start_values=begin,
                input=signals if rows.shape[1] else None, output=[*wanted], validate=False,
                debug_logging=False,
            )  # fmt: skip
            report[f"fmi{version}"] = _compared(wanted, result) | {
                "valid": not problems, **({"problems": problems} if problems else {})
            }  # fmt: skip
    for r in report.values():
        r["passed"] = r["valid"] and r["relative"] <= codegen.LIMIT and not r["status_differs"]
    return report


def _recorded(
    loop: Block, part: str, scenario: Scenario
) -> tuple[Block, dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Block of a part, and its inputs, parameters and chosen start values in a run."""
    data = simulate(loop, scenario, log=[*loop.inputs, *loop.outputs, *loop.states])
    chosen = {loop.find(n, "state"): v for n, v in scenario.start.items()}
    start = {n.removeprefix(f"{part}."): v for n, v in chosen.items() if n.startswith(f"{part}.")}
    params = codegen.logged_params(loop, part, data)
    return loop[part], codegen.logged_inputs(loop, part, data), params, start


def _elements(
    found: list[Variable], causalities: tuple[str, ...], values: dict[str, Any]
) -> dict[str, float]:
    """Values of scalar variables from those of signals."""
    given: dict[str, float] = {}
    for name, value in values.items():
        own = [v for v in found if v.causality in causalities and v.initial != "calculated"
               and v.member.name == name]  # fmt: skip
        given |= dict(zip((v.name for v in own), c_elements(own[0].member, value), strict=True))
    return {n: float(v) for n, v in given.items()}


def _wanted(
    plan: Plan, rows: np.ndarray, params: dict[str, Any], start: dict[str, Any]
) -> dict[str, np.ndarray]:
    """What Python gives after each tick, by name of the scalar variable."""
    block = plan.block.with_params(**start) if start else plan.block
    if start:
        plan = Plan(block, plan.name, plan.period, plan.real)
    run = expected_run(plan, rows, params)
    outputs = run.outputs
    if is_plant(plan.block):  # its outputs are those of the state after the tick
        p = np.array(block.pack("param", block.param_values(**params))).ravel()
        seen, told = expected_outputs.accepted_rows(plan, rows, block.param_values(**params))
        good = told & bit("REFUSED") == 0
        now = block.f.map(len(rows))(run.states.T, seen.T, np.tile(p[:, None], len(rows)))[1]
        outputs = expected_outputs.run_with_guards(
            plan, rows, told, np.array(now).T[good], run.states[good], params
        ).outputs
    found = variables(plan)
    shown = [v for v in found if v.causality in ("output", "local")]
    names = [[v.name for v in shown if (v.initial == "calculated") == out] for out in (True, False)]
    wanted: dict[str, np.ndarray] = {}
    for group, values in zip(names, (outputs, run.states), strict=True):
        wanted |= dict(zip(group, values.T, strict=True))
    return wanted | {"status": run.status}


def _compared(wanted: dict[str, np.ndarray], result: np.ndarray) -> dict[str, Any]:
    """Largest difference of what FMPy recorded after each tick."""
    relative, worst = 0.0, ""
    for name, values in wanted.items():
        if name == "status":
            continue
        largest = float(np.abs(values).max(initial=0.0)) or 1.0
        differs = float(np.abs(result[name][1:] - values).max(initial=0.0)) / largest
        if not differs <= relative:
            relative, worst = differs, name
    return {
        "ticks": len(result) - 1,
        "relative": relative,
        **({"worst": worst} if worst else {}),
        "status_differs": int(np.count_nonzero(result["status"][1:] != wanted["status"])),
    }


def parts(wanted: list[str]) -> Iterator[tuple[str, Block, str, Scenario]]:
    """Name, loop, part and scenario of each controller and each plant of the studies."""
    seen: set[str] = set()
    for name in dict.fromkeys(w.partition(":")[0] for w in wanted or resolve.studies()):
        study = resolve.load_study(name)
        cases = resolve.build_cases(study)
        for loop_name in dict.fromkeys(n for case in cases for n in case.loops):
            if wanted and not {name, f"{name}:{loop_name}"} & set(wanted):
                continue
            loop, case = resolve.pick_loop(study, cases, loop_name)
            for part in (study.controller, *PLANTS):
                if part not in loop.parts:
                    continue
                text = loop[part].f.serialize() if part in PLANTS else f"{name}:{loop_name}"
                if text not in seen:
                    seen.add(text)
                    yield f"{name}:{loop_name}.{part}", loop, part, case.scenario


def main(words: list[str] | None = None) -> int:
    """Open the FMUs of the controllers and plants named, or of all, and write ``fmus.json``."""
    parser = argparse.ArgumentParser(prog="python -m bench.fmus")
    parser.add_argument("name", nargs="*", help="STUDY or STUDY:LOOP; all by default")
    parser.add_argument("--out", default="fmus.json", help="file to write")
    chosen = parser.parse_args(words)
    found: dict[str, Any] = {}
    for name, loop, part, scenario in parts(chosen.name):
        began = time.perf_counter()
        row = opened_by_fmpy(loop, part, scenario)
        found[name] = row
        said = "passed" if all(r["passed"] for r in row.values()) else "FAILED"
        took = time.perf_counter() - began
        print(f"{name}: {said}, {took:.1f} s, {json.dumps(row)}", flush=True)
        store.write_json(Path(chosen.out), found)  # what was done stays when stopped
    return 0 if all(r["passed"] for row in found.values() for r in row.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
