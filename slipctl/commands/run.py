"""``slipctl run``: metrics, claims, logs, figures and a report of a study."""

from __future__ import annotations

import argparse
import logging
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from slipctl.commands.progress import Progress
from slipctl.run import store
from slipctl.run.results import Results
from slipctl.study import doors, files, preparing, running
from slipctl.study.declaration import Verdict
from slipctl.study.texts import changes, claim_table, metric_table

log = logging.getLogger("slipctl")


def answer(options: argparse.Namespace, command: str) -> int:
    """Run, write and print."""
    study = doors.load_study(options.study)
    out = Path(options.out or Path("out") / study.name)
    store.check_folder(out)

    cases, models = preparing.prepare(
        study, quick=options.quick, settings=options.settings, swaps=options.swaps,
        loops=options.loops, scenarios=options.scenarios,
    )  # fmt: skip
    changed = preparing.in_words(options.swaps, options.settings)
    results = running.new_results(study, cases, options.quick, changed)
    everything = not (options.loops or options.scenarios)
    if study.experiments and not everything:
        log.info("experiments are left out; they run without --loop and --scenario")
    if study.experiments and everything and options.settings:
        log.info("--set reaches the loops of the scenarios, not those that an experiment builds")
    total = sum(len(c.loops) for c in cases) + (len(study.experiments) if everything else 0)
    progress = Progress(total, sys.stderr, options.quiet)

    def save(what: str, write: Callable[[], Any]) -> None:
        with running.noted(results, what):
            write()

    def save_log(found: Results, scenario: str, loop: str) -> None:
        where = f"log of {scenario}/{loop}"
        save(where, lambda: files.save_log(found, scenario, loop, out, command))

    def save_numbers() -> None:
        progress.end()
        save("metrics.json", lambda: files.save_metrics(results, out, command))
        save("tables.json", lambda: files.save_tables(results, out, command))

    try:
        running.run(
            study, cases, models, quick=options.quick, compile=not options.no_compile,
            experiments=everything, report=progress, results=results, finished=save_log,
            folder=out / "parts",
        )  # fmt: skip
    except KeyboardInterrupt:
        save_numbers()
        raise
    save_numbers()
    verdicts = running.judge_all(results)
    save("claims.json", lambda: files.save_claims(results, verdicts, out, command))
    print(_summary(results, verdicts))
    sys.stdout.flush()
    save("report.html", lambda: files.save_pages(results, verdicts, out, command))
    if "report.html" not in results.failed:
        print(f"\n{out / 'report.html'}")
    for where, why in results.failed.items():
        log.error("%s failed: %s", where, why)
    return 1 if results.failed else 0


def _summary(results: Results, verdicts: Sequence[Verdict]) -> str:
    """Claims and metrics as text tables."""
    width = shutil.get_terminal_size((132, 50)).columns if sys.stdout.isatty() else 132
    title = f"{results.study.name}: {results.study.title}" + (" (quick)" if results.quick else "")
    parts = ["\n".join(filter(None, [title, changes(results)]))]
    if verdicts:
        parts.append(claim_table(verdicts, width))
    parts += [metric_table(results, scenario, width) for scenario in results.metrics]
    return "\n\n".join(parts)
