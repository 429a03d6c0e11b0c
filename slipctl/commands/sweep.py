"""``slipctl sweep``: a loop with many sets of numbers, kept as they end, resumed and extended."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.commands.progress import Progress
from slipctl.errors import BadInput
from slipctl.run.results import Case
from slipctl.run.sweep import sweep_export
from slipctl.run.sweep.ensemble import World
from slipctl.run.sweep.sweep_runs import Sweep, sweep
from slipctl.study.declaration import Study
from slipctl.study.report.texts import number, wrap_table
from slipctl.study.request import Request

log = logging.getLogger("slipctl")

SHARES = (0.0, 0.05, 0.5, 0.95, 1.0)
"""Shares of the runs below the numbers of the table."""


def answer(options: argparse.Namespace, command: str) -> int:
    """Run what is missing, and print how the metrics are spread."""
    if options.export:
        sweep_export.check(Path(options.export))
    if options.name is None:
        raise BadInput("say what to run: slipctl sweep STUDY:LOOP --vary P=lo:hi:n --out DIR")
    if not options.out:
        raise BadInput("--out names no folder; write one")
    asked = Request.read(options.name, options.settings, options.swaps).needs_loop()
    study, case, loop = asked.study, asked.case, asked.loop
    world = None if options.varied else _world(study, case, loop, options)
    progress = Progress(1, sys.stderr, options.quiet)
    try:
        found = sweep(
            case.loops[loop], case.scenario, options.varied, options.out,
            samples=options.samples, seed=options.seed, design=options.design,
            signals=study.signals, known=case.known, logs=options.logs, jobs=options.jobs,
            compile=not options.no_compile, progress=lambda share: progress("sweep", share),
            about={"loop": f"{study.name}:{loop}", "set": list(asked.settings),
                   "swapped": list(asked.swaps), "command": command}, world=world,
            scheduler=options.scheduler or "", mixed=options.mixed,
        )  # fmt: skip
    finally:
        progress.end()
    if options.samples > 1 and not found.plan.drawn:
        log.warning(
            "--samples %d is left out, as nothing is drawn; --vary P=lo:hi draws", options.samples
        )
    print(json.dumps(spread(found), indent=1) if options.json else report(found))
    if options.export:
        found.save(options.export)
        if not options.json:
            print(f"\n{options.export}")
    failed = found.failed
    if failed:
        run, why = next(iter(failed.items()))
        log.error("%d of %d runs failed; run %d: %s", len(failed), len(found.runs), run, why)
    return 1 if failed else 0


def _world(study: Study, case: Case, loop: str, options: argparse.Namespace) -> World:
    """What the study or the file itself draws, where the line varies nothing."""
    ensemble = study.ensembles.get(case.scenario.name)
    if ensemble is None:
        raise BadInput(
            "a sweep needs something to vary; write --vary P=lo:hi:n or P=lo:hi, or an [ensemble]"
            " in a vehicle's file"
        )
    world = World(
        case.loops[loop], case.scenario, ensemble, signals=study.signals, known=case.known,
        seed=options.seed, compile=not options.no_compile,
    )  # fmt: skip
    for note in world.notes:
        log.warning("%s", note)
    return world


def spread(found: Sweep) -> dict[str, Any]:
    """How the metrics are spread over the runs, for a program."""
    metrics = [
        {"metric": name, "unit": unit,
         "quantiles": dict(zip(map(str, SHARES), shares, strict=True)) if shares else None}
        for name, unit, shares in _shares(found)
    ]  # fmt: skip
    return {
        "folder": str(found.folder), "runs": len(found.runs), "missing": found.missing,
        "failed": {str(k): why for k, why in found.failed.items()},
        "varied": [vars(a) for a in found.plan.axes], "metrics": metrics,
    }  # fmt: skip


def _shares(found: Sweep) -> Iterator[tuple[str, str, list[float]]]:
    """Each number of the metrics: name, unit, and below which values the shares of runs lie."""
    for name, (unit, labels) in found.units.items():
        count = found.rows(name)
        for k in range(count or 1):
            values = found.column(name, None if count is None else k)
            values = values[np.isfinite(values)]
            label = f", {labels[k]}" if count is not None and len(labels) == count else (
                f", {k + 1}" if count is not None and count > 1 else "")  # fmt: skip
            yield name + label, unit, np.quantile(values, SHARES).tolist() if values.size else []


def report(found: Sweep) -> str:
    """How the metrics are spread over the runs, as a table."""
    about, plan = found.about, found.plan
    many, failed = len(found.runs), len(found.failed)
    varied = ", ".join(
        f"{a.name} = {number(a.lo)} .. {number(a.hi)} {'' if a.unit == '1' else a.unit}".rstrip()
        + (f" ({a.points} values)" if a.points else " (drawn)")
        for a in plan.axes
    )
    head = [
        f"{about.get('loop', found.folder)}@{about['scenario']}: {many} runs"
        + (f", {failed} failed" if failed else "")
        + (f", {found.missing} missing" if found.missing else ""),
        f"varied: {varied}",
    ]
    if plan.drawn:
        head.append(f"design {plan.design}, seed {plan.seed}")
    rows = [["metric", "unit", "least", "5 %", "median", "95 %", "largest"]]
    for name, unit, shares in _shares(found):
        cells: list[Any] = list(shares) or [None] * len(SHARES)
        rows.append([name, unit, *map(number, cells)])
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
    tail = f"{found.folder}: slipctl.open_sweep({str(found.folder)!r}) has each run"
    return "\n".join([*head, "", wrap_table(rows, widths), "", tail])
