"""``slipctl sweep``: a loop with many sets of numbers, kept as they end, resumed and extended."""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.shared_numbers import number_at, targets
from slipctl.commands import compare
from slipctl.commands.progress import Progress
from slipctl.errors import BadInput, nearest
from slipctl.run import store
from slipctl.run.results import Case
from slipctl.run.sweep import sweep_export
from slipctl.run.sweep.ensemble import World
from slipctl.run.sweep.spread import CONFIDENCE, quantiles
from slipctl.run.sweep.sweep_runs import Sweep, sweep
from slipctl.study import case_setup
from slipctl.study.declaration import Study
from slipctl.study.report.sweep_page import page
from slipctl.study.report.texts import number, number_or_never, wrap_table
from slipctl.study.request import Request

log = logging.getLogger("slipctl")

NEVER = (
    "never: number of runs that did not reach the metric or broke off; each counts"
    " as the worst value in every column"
)

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
    asked, case, together = _asked(options)
    study, loops = asked.study, list(case.loops)
    if together and options.export:
        raise BadInput("--export writes one loop; name it, STUDY:LOOP")
    out = Path(options.out)
    places = {n: out / n if together else out for n in loops}
    # all of them are checked before the first one runs
    worlds = {n: None if options.varied else _world(study, case, n, options) for n in loops}
    world = worlds[loops[0]]
    _refuse_overruled(asked, case, world.ensemble.draw if world else options.varied)
    progress = Progress(len(loops), sys.stderr, options.quiet)
    found: dict[str, Sweep] = {}
    try:
        for name in loops:
            about = {"loop": f"{study.name}:{name}", "set": list(asked.settings),
                     "swapped": list(asked.swaps), "command": command,
                     "limits": dict(study.limits)}  # fmt: skip
            found[name] = sweep(
                case.loops[name], case.scenario, options.varied, places[name],
                samples=options.samples, seed=options.seed, design=options.design,
                signals=study.signals, known=case.known, logs=options.logs, jobs=options.jobs,
                compile=not options.no_compile, progress=partial(progress, f"sweep of {name}"),
                about=about, world=worlds[name], scheduler=options.scheduler or "",
                mixed=options.mixed,
            )  # fmt: skip
    finally:
        progress.end()
    if options.samples > 1 and not found[loops[0]].plan.drawn:
        log.warning(
            "--samples %d is left out, as nothing is drawn; --vary P=lo:hi draws", options.samples
        )
    if together:
        _tell_together(options, found, places, out)
    else:
        only = found[loops[0]]
        print(json.dumps(spread(only), indent=1) if options.json else report(only))
        if options.export:
            only.save(options.export)
            if not options.json:
                print(f"\n{options.export}")
    store.write_text(out / "report.html", page(found, command))
    if not options.json:
        print(f"\n{out / 'report.html'}")
    for name, one in found.items():
        if failed := one.failed:
            run, why = next(iter(failed.items()))
            log.error("%s: %d of %d runs failed; run %d: %s", name, len(failed), len(one.runs),
                      run, why)  # fmt: skip
    return 1 if any(one.failed for one in found.values()) else 0


def _refuse_overruled(asked: Request, case: Case, varied: Iterable[str]) -> None:
    """Refuse a ``--set`` of a number that each run of the sweep sets to another value."""
    for text in asked.settings:
        setting = case_setup.Setting.read(text)
        for name, loop in case.loops.items():
            given = {number_at(loop, n) for n in targets(loop, setting.name)}
            for one in (v.partition("=")[0].strip() for v in varied):
                drawn = {number_at(loop, n) for n in targets(loop, one)}
                if given and given <= drawn and setting.loop in ("", name):
                    raise BadInput(
                        f"--set {text}: the sweep varies {one}, so it has no effect; leave one out"
                    )


def _tell_together(
    options: argparse.Namespace, found: Mapping[str, Sweep], places: Mapping[str, Path], out: Path
) -> None:
    """Print all loops beside each other, run by run where they ran on the same draws."""
    if options.json:
        print(store.json_text({n: spread(one) for n, one in found.items()}).rstrip())
        return
    first = next(iter(found.values()))
    head = head_lines(first)
    head[0] = f"{out}: {len(found)} loops, {len(first.runs)} runs each, on the same draws"
    parts = ["\n".join(head)]
    wide = max(map(len, found))
    kept = [f"{n.ljust(wide)}  {k}" for n, one in found.items() if (k := one.kept)]
    if kept:
        parts.append("\n".join(kept))
    sides = [compare.read(str(p)) for p in places.values()]
    if len(sides) == 1:
        parts.append(report(first))
    else:
        (_, rows), *_ = compare.metric_rows(sides).items()
        told = {"metric": [r for r in rows if compare.tells_apart(r)]}
        parts += compare.metric_tables(list(found), told)
        parts.append(f"slipctl compare {out} has all metrics")
    print("\n\n".join(parts))


def _asked(options: argparse.Namespace) -> tuple[Request, Case, bool]:
    """What a name stands for, its case with what was set, and whether all loops are meant.

    The case has the loops that are to run and no other.
    """
    name, at, scenario = options.name, "", ""
    if ":" not in name:
        name, at, scenario = name.partition("@")
    asked = Request.read(name, options.settings, options.swaps)
    if asked.loop or not asked.home:
        asked = asked.needs_loop()
        return asked, asked.case, False
    names = [c.scenario.name for c in asked.cases]
    if at and scenario not in names:
        raise BadInput(f"{asked.study.name} has no scenario {scenario!r}{nearest(scenario, names)}")
    scenario = scenario or next((n for n in asked.study.ensembles if n in names), names[0])
    cases, _ = case_setup.prepare(
        asked.study, settings=asked.settings, scenarios=[scenario],
        built=(asked.cases, asked.models),
    )  # fmt: skip
    return asked, cases[0], True


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
    """How the metrics are spread over the runs, for a program; null is beyond every number."""
    metrics = []
    for name, unit, values in found.labelled():
        shares = quantiles(values, SHARES)
        metrics.append({
            "metric": name, "unit": unit, "not_reached": int(np.isinf(values).sum()),
            "quantiles": None if math.isnan(shares[0]) else {
                str(k): v if math.isfinite(v) else None
                for k, v in zip(SHARES, shares, strict=True)
            },
        })  # fmt: skip
    kept = found.kept
    limits = None if kept is None else {
        "limits": found.limits, "runs": kept.runs, "within": kept.within, "fails": kept.fails,
        "share_interval": list(kept.interval), "confidence": CONFIDENCE,
    }  # fmt: skip
    return {
        "folder": str(found.folder), "runs": len(found.runs), "missing": found.missing,
        "failed": {str(k): why for k, why in found.failed.items()},
        "varied": [vars(a) for a in found.plan.axes], "kept": limits, "metrics": metrics,
    }  # fmt: skip


def head_lines(found: Sweep) -> list[str]:
    """What was run, and what varied."""
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
    return head


def report(found: Sweep) -> str:
    """How the metrics are spread over the runs, as a table."""
    head = head_lines(found)
    if kept := found.kept:
        head.insert(1, str(kept))
    rows = [["metric", "unit", "least", "5 %", "median", "95 %", "largest", "never"]]
    for name, unit, values in found.labelled():
        never = int(np.isinf(values).sum())
        cells = map(number_or_never, quantiles(values, SHARES))
        rows.append([name, unit, *cells, str(never) if never else ""])
    if not any(row[-1] for row in rows[1:]):
        rows = [row[:-1] for row in rows]
    tail = f"{found.folder}: slipctl.open_sweep({str(found.folder)!r}) has each run"
    note = ["", NEVER] if rows[0][-1] == "never" else []
    return "\n".join([*head, "", wrap_table(rows), *note, "", tail])
