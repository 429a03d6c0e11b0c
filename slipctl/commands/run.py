"""``slipctl run``: metrics, claims, logs, figures and a report of a study.

A plain run answers in seconds: the scenarios ``base`` and ``real``, or what else a study names as
plain, and the claims that they can answer. ``--scenario`` runs others, ``--full`` all of them and
the experiments. What an earlier run of the same left in the folder is taken; what another one left
is removed.
"""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import sys
import textwrap
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from slipctl.commands.progress import Progress
from slipctl.errors import BadInput
from slipctl.run import interrupts, store
from slipctl.run.results import Results
from slipctl.run.store import FolderLock
from slipctl.study import case_setup, claim_scope, execution
from slipctl.study.cache import Keep, key_of
from slipctl.study.failures import note_failure
from slipctl.study.files import results_folder
from slipctl.study.jobs import Cores
from slipctl.study.report import report_page
from slipctl.study.report.remarks import answer_line, estimator_remarks, warnings_of_runs
from slipctl.study.report.texts import changes, claim_line, claim_table, left_to_full, metric_table
from slipctl.study.request import Request
from slipctl.study.verdicts import Verdict, judge

log = logging.getLogger("slipctl")

STOPPED = "stopped before its end; results that were not finished are missing here"


def answer(options: argparse.Namespace, command: str) -> int:
    """Run, write and print."""
    asked = Request.read(options.study, options.settings, options.swaps, quick=options.quick)
    if asked.loop:
        raise BadInput(f"run takes a study; write slipctl run {asked.home} --loop {asked.loop}")
    study = asked.study
    out = Path(options.out or Path("out") / study.name)
    store.check_folder(out)
    options.settings, models = list(asked.settings), asked.models  # files of swaps: in the key
    key = key_of(study, quick=options.quick, settings=options.settings, swaps=options.swaps)
    keep = Keep(out, key)
    chosen = bool(options.loops or options.scenarios)
    experiments = (
        () if chosen else tuple(n for n in study.experiments if options.full or n in study.plain)
    )
    plain = None if options.full or options.scenarios else {} if chosen else keep.logs()
    left: list[str] = []
    cases, _ = case_setup.prepare(
        study, settings=asked.settings, loops=options.loops, scenarios=options.scenarios,
        plain=plain, left=left, built=(asked.cases, models),
    )  # fmt: skip
    changed = case_setup.in_words(options.swaps, options.settings)
    left += [n for n in study.experiments if n not in experiments and keep.tables(n) is None]
    results = Results(study, cases, options.quick, changed=changed, left=() if chosen else left)
    out.mkdir(parents=True, exist_ok=True)
    with FolderLock(out), Cores(options.jobs) as cores:
        return _Run(options, command, results, models, keep, cores, experiments).answer()


class _Run:
    """A run whose cases are ready: it writes, judges and prints."""

    def __init__(
        self, options: argparse.Namespace, command: str, results: Results, models: Any, keep: Keep,
        cores: Cores, experiments: Sequence[str],
    ) -> None:  # fmt: skip
        self.options, self.command, self.results, self.models = options, command, results, models
        self.keep, self.cores, self.experiments = keep, cores, experiments
        cases = results.cases
        if experiments and options.settings:
            log.info("--set reaches the loops of the scenarios, not those that experiments build")
        total = sum(len(c.loops) for c in cases) + len(experiments)
        self.progress = Progress(total, sys.stderr, options.quiet)
        self.unprinted: OSError | None = None
        study = results.study
        vehicle = not study.headline and not study.claims
        self.unanswered = [(c.scenario.name, n) for c in cases for n in c.loops if vehicle]
        self.named: set[str] = set()

    def answer(self) -> int:
        """Run, write and print; gives the exit code."""
        results, out = self.results, self.keep.out
        wanted = {c.scenario.name: tuple(c.loops) for c in results.cases}
        self.keep.clear(wanted)
        self._metrics("still running, or stopped before its end")
        judged = cache(self._claims)  # once, while figures are drawn
        sections: dict[str, Any] = {}
        self._tell(self._question())
        try:
            execution.run(
                results.study, results.cases, self.models, quick=results.quick,
                compile=not self.options.no_compile, experiments=self.experiments,
                report=self._heard, results=results, keep=self.keep, command=self.command,
                cores=self.cores, beside=results_folder.section_jobs(results),
                take=sections.__setitem__,
            )  # fmt: skip
            self._found_tables()
            self.progress.end()
            self._tell(self._headline())
            self._metrics()
            with note_failure(results, "report.html"):
                results_folder.save_pages(results, judged, out, self.command, self.cores, sections)
            verdicts = judged()
        except KeyboardInterrupt:
            interrupts.note_interrupt()
            self._stopped()
            raise KeyboardInterrupt(interrupts.KEPT) from None
        if self.options.json:
            print(self._json())
        else:
            self._tell(self._summary(verdicts))
        for where, why in results.failed.items():
            log.error("%s failed: %s", where, why)
        if self.unprinted:
            raise self.unprinted
        if "report.html" not in results.failed and not self.options.json:
            print(out / "report.html")
        return 1 if results.failed else 0

    def _tell(self, text: str, end: str = "\n\n") -> None:
        """Print for a person, at once; where that fails, the run goes on and says so at its end."""
        if text and not self.options.json and not self.unprinted:
            self.progress.end()
            try:
                print(text, end=end, flush=True)
            except OSError as error:  # nobody reads any more, or a full disk
                self.unprinted = error

    def _question(self) -> str:
        """What is asked and, of a study, what its answer is: before anything has run."""
        results, study = self.results, self.results.study
        quick = " (quick)" if results.quick else ""
        parts = [f"{study.name}: {study.title}{quick}", changes(results)]
        if study.short:
            parts += ["", _filled(study.doc), "", _filled(study.short)]
        return "\n".join(p for k, p in enumerate(parts) if p or k > 1)

    def _heard(self, what: str, share: float) -> None:
        """Show how far a run is; where it has ended, print the lines that it makes complete.

        A line for each controller of a vehicle, in the order of the file.
        """
        self.progress(what, share)
        results = self.results
        while share >= 1.0 and self.unanswered:
            scenario, loop = self.unanswered[0]
            there = loop in results.metrics.get(scenario, {})
            if not there and f"{scenario}/{loop}" not in results.failed:
                break
            self.unanswered.pop(0)
            if len(results.cases) > 1 and scenario not in self.named:
                self.named.add(scenario)
                self._tell(f"scenario {scenario}", "\n")
            end = "\n" if self.unanswered else "\n\n"
            self._tell(_filled(answer_line(results, scenario, loop), "  ") if there else "", end)

    def _headline(self) -> str:
        """The claim that a study stands or falls with."""
        results, study = self.results, self.results.study
        if not study.headline:
            return ""
        options = self.options
        changed = claim_scope.changes(results, options.settings, options.swaps, self.models)
        claim = next(c for c in study.claims if c.id == study.headline)
        with suppress(Exception):  # the table of claims says why its answer breaks
            return _filled(claim_line(judge(claim, results, changed)))
        return ""

    def _found_tables(self) -> None:
        """Take what an earlier run has found in experiments that this one leaves out."""
        if self.options.loops or self.options.scenarios:
            return
        for name in self.results.study.experiments:
            found = None if name in self.experiments else self.keep.tables(name)
            if found is not None:
                self.results.tables[name] = found

    def _metrics(self, state: str = "") -> None:
        results, out = self.results, self.keep.out
        with note_failure(results, "metrics.json"):
            results_folder.save_metrics(results, out, self.command, state)
        with note_failure(results, "tables.json"):
            results_folder.save_tables(results, out, self.command)

    def _claims(self, state: str = "") -> list[Verdict]:
        results, o = self.results, self.options
        changed = claim_scope.changes(results, o.settings, o.swaps, self.models)
        verdicts = execution.judge_all(results, changed)
        with note_failure(results, "claims.json"):
            results_folder.save_claims(results, verdicts, self.keep.out, self.command, state)
        return verdicts

    def _stopped(self) -> None:
        """Write what had finished, and that the rest is missing."""
        self.progress.end()
        self.keep.clear_parts()
        self._found_tables()
        self._metrics(STOPPED)
        verdicts, state = self._claims(STOPPED), f"This run was {STOPPED}."
        with note_failure(self.results, "report.html"):  # what was measured, without figures
            text = report_page.page(self.results, verdicts, {}, self.command, {}, state)
            store.write_text(self.keep.out / "report.html", text)

    def _json(self) -> str:
        """Metrics and claims as their files have them, and where the report is."""
        out = self.keep.out
        found = {
            name: json.loads((out / f"{name}.json").read_text(encoding="utf-8"))
            for name in ("metrics", "claims")
            if (out / f"{name}.json").is_file()
        }
        found["warnings"] = [
            {"text": t, "runs": where} for t, where in warnings_of_runs(self.results)
        ]
        found["remarks"] = [
            {"text": r.text, "run": f"{r.scenario}/{r.loop}", "numbers": list(r.numbers)}
            for r in estimator_remarks(self.results)
        ]
        return json.dumps(found | {"folder": str(out)}, indent=1, ensure_ascii=False)

    def _summary(self, verdicts: Sequence[Verdict]) -> str:
        """Warnings, then claims and metrics as text tables, then what is to be doubted."""
        results, width = self.results, _width()
        told = [f"warning: {line} ({where})" for line, where in warnings_of_runs(results)]
        parts = ["\n".join(_filled(t, "  ") for t in told)] if told else []
        if verdicts:
            parts.append(claim_table(verdicts, width))
        parts += [metric_table(results, scenario, width) for scenario in results.metrics]
        parts += filter(None, [self._remarks(), left_to_full(results)])
        return "\n\n".join(parts)

    def _remarks(self) -> str:
        """Doubts about estimators, a sentence for each controller; with ``-v`` their numbers."""
        lines = []
        for r in estimator_remarks(self.results):
            if r.held:  # others are among the warnings
                lines.append(_filled(f"{r.scenario}/{r.loop}: {r.text}", "  "))
            if self.options.verbose:
                lines += [_filled(f"  {n}", "    ") for n in r.numbers]
        return "\n".join(lines)


def _width() -> int:
    """Characters in a line of the terminal."""
    watched = sys.stdout and sys.stdout.isatty()
    return shutil.get_terminal_size((132, 50)).columns if watched else 132


def _filled(text: str, indent: str = "") -> str:
    return textwrap.fill(" ".join(text.split()) if not text.startswith(" ") else text,
                         _width(), subsequent_indent=indent)  # fmt: skip
