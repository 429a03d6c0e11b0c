"""Running a study: its cases, then its experiments, and judging its claims."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import casadi as ca

from slipctl.draw import plots
from slipctl.run import build
from slipctl.run.metrics import (
    AGAINST_OTHERS,
    Metric,
    Run,
    in_order,
    measure,
    place,
    rail_changes,
    rail_names,
)
from slipctl.run.results import Case, Results, Table, known_column
from slipctl.run.simulation import simulate
from slipctl.study.cache import Keep
from slipctl.study.declaration import OPEN, Claim, Context, Study
from slipctl.study.failures import note_failure, reason
from slipctl.study.files import results_folder
from slipctl.study.jobs import Cores, Job, Outcome, run_jobs
from slipctl.study.provenance import EXPERIMENT_SEED
from slipctl.study.verdicts import Verdict, judge

if TYPE_CHECKING:
    import xarray

log = logging.getLogger("slipctl")

T = TypeVar("T")

Report = Callable[[str, float], None]
"""Called with what is running and the share of it that is done: 1 when its results are there."""


def run(
    study: Study,
    cases: Sequence[Case],
    models: Mapping[str, Any] | None = None,
    *,
    quick: bool = False,
    compile: bool = True,
    experiments: bool | Sequence[str] = True,
    report: Report | None = None,
    results: Results | None = None,
    keep: Keep | None = None,
    command: str = "",
    cores: Cores | None = None,
    beside: Mapping[str, Job[Any]] | None = None,
    take: Callable[[str, Outcome[Any]], None] = lambda what, outcome: None,
) -> Results:
    """Run the cases and the experiments.

    A run that breaks is noted in ``results.failed`` and the others go on.

    Args:
        study: the study.
        cases, models: from :func:`prepare`; models are for the experiments.
        quick: as told to :func:`prepare`.
        compile: compile the loops where there is a compiler.
        experiments: run them too, or those named.
        report: told how far each run is, and when its results are there.
        results: filled as the runs finish, so that an interrupted call leaves what was done.
        keep: folder in which logs and finished experiments are kept, and from which those of an
            earlier run of the same are taken; None keeps nothing.
        command: command line, for the logs.
        cores: how many runs go on at once; None is one.
        beside: further jobs, after the runs of the first case; nothing is reported of them.
        take: given the outcome of each of them.
    """
    results = Results(study, cases, quick) if results is None else results
    given = study.models if models is None else models
    cores = cores or Cores(1)
    jobs: dict[str, Job[Any]] = {}
    others = beside or {}

    def tell(what: str, share: float) -> None:
        if report is not None and what not in others:
            report(what, share)

    # what a report needs first comes first; the experiments take longest; a core that is free at
    # the end takes the other runs, which are short
    wanted = experiments if not isinstance(experiments, bool) else study.experiments
    chosen = list(wanted) if experiments else []
    first = cases[:1] if chosen else cases
    _add_runs(jobs, results, first, compile, keep, command)
    jobs |= others
    for name in chosen:
        jobs[name] = _experiment_job(study, name, cases, given, quick, compile, keep, cores)
    _add_runs(jobs, results, cases[len(first) :], compile, keep, command)
    runs = {f"{c.scenario.name}/{n}": (c, n) for c in cases for n in c.loops}
    if jobs:
        load_logs()
    try:
        meanwhile = plots.load if study.figures else lambda: None  # what the figures need
        with closing(run_jobs(jobs, cores, tell, meanwhile)) as outcomes:
            for what, outcome in outcomes:
                if what in others:
                    take(what, outcome)
                    continue
                with note_failure(results, what):
                    found = outcome.get()
                    if what in runs:
                        case, name = runs[what]
                        _take(results, case, name, found)
                    else:
                        results.tables[what] = found
                        if keep is not None:
                            keep.keep_tables(what, found)
                tell(what, 1.0)
    finally:  # what had finished before Ctrl-C is in order too
        _put_in_order(results, study, cases, runs)
    return results


def _put_in_order(
    results: Results, study: Study, cases: Sequence[Case], runs: Iterable[str]
) -> None:
    """Order of scenarios, experiments and failures as they are declared, however they ended."""
    for case in cases:
        _finish(results, case)
    scenarios = [case.scenario.name for case in cases]
    results.data = _as_in(results.data, scenarios)
    results.metrics = _as_in(results.metrics, scenarios)
    order = {n: k for k, n in enumerate(study.experiments)}
    results.tables = dict(sorted(results.tables.items(), key=lambda item: order[item[0]]))
    results.failed = _as_in(results.failed, [*runs, *results.failed])


def _add_runs(
    jobs: dict[str, Job[Any]],
    results: Results,
    cases: Sequence[Case],
    compile: bool,
    keep: Keep | None,
    command: str,
) -> None:
    """Add the runs of cases: the first one, whose answer is read first, then the longest first.

    So no core is idle while the longest ends.
    """
    runs = [(case, name) for case in cases for name in case.loops]
    for case, name in [*runs[:1], *sorted(runs[1:], key=lambda run_: -_size(*run_))]:
        jobs[f"{case.scenario.name}/{name}"] = _loop_job(
            results, case, name, compile, keep, command
        )


def _size(case: Case, name: str) -> float:
    """How long a run is, roughly: ticks times numbers that a tick works out.

    A loop that was tried has its function; one that cannot be made says so where it runs.
    """
    with suppress(Exception):
        loop = case.loops[name]
        made = [f.sz_w() for f in loop._made.values() if isinstance(f, ca.Function)]
        return case.scenario.duration / float(loop.period or 0.0) * float(max(made, default=0))
    return 0.0


def load_logs() -> None:
    """Do what each run would do for itself, before the processes part."""
    import netCDF4  # noqa: F401
    import xarray

    build.identity()
    xarray.Dataset({"x": ("time", [0.0])}, coords={"time": [0.0]})  # imports what it needs itself


@dataclass(frozen=True)
class _Ran:
    """What the run of a loop gives: its log, metrics, and files that wait for their names.

    ``trouble`` says why there are no files.
    """

    data: xarray.Dataset
    metrics: dict[str, Metric]
    files: Sequence[tuple[Path, Path]] = ()
    trouble: str = ""


def _loop_job(
    results: Results, case: Case, name: str, compile: bool, keep: Keep | None, command: str
) -> Job[_Ran]:
    """Make the job that simulates one loop in its scenario, measures it and writes its log."""

    def job(tell: Callable[[float], None]) -> _Ran:
        scenario, signals = case.scenario.name, results.study.signals
        data = keep.log(scenario, name) if keep is not None else None
        found = data is not None
        if data is None:
            data = _simulated(results, case, name, compile, tell)
        changes = [float(t) for t in data.attrs["rail_changes_s"]]
        rails = rail_names(case.scenario, changes)
        metrics = measure(Run(data, signals, changes, rails=rails))
        if keep is None or found:
            return _Ran(data, metrics)
        data = data.assign_attrs(key=keep.of(scenario, name))
        folder, whole = keep.out / "logs" / scenario, data.assign_attrs(command=command)
        try:
            return _Ran(data, metrics, results_folder.draft_log(whole, folder, name))
        except Exception as error:
            return _Ran(data, metrics, trouble=reason(error))

    return job


def _simulated(
    results: Results, case: Case, name: str, compile: bool, tell: Callable[[float], None]
) -> xarray.Dataset:
    """Log of one loop in its scenario, with what the study knows beside it."""
    study, loop = results.study, case.loops[name]
    has = {s.name for s in loop.signals if s.role != "param"}
    wanted = None if case.log is None else [n for n in case.log if n in has]
    data = simulate(
        loop, case.scenario, compile=compile, progress=tell, log=wanted, every=case.every
    )
    data = add_known(study, case, data)
    changes = rail_changes(data, case.scenario, study.signals)
    return data.assign_attrs(
        study=study.name, quick=int(results.quick), loop_name=name, rail_changes_s=changes
    )


def _take(results: Results, case: Case, name: str, ran: _Ran) -> None:
    """Put what a run gave into the results, and its files into the folder."""
    scenario = case.scenario.name
    results.data.setdefault(scenario, {})[name] = ran.data
    results.metrics.setdefault(scenario, {})[name] = ran.metrics
    log.debug("%s/%s done", scenario, name)
    what = f"log of {scenario}/{name}"
    with note_failure(results, what):
        results_folder.publish(ran.files)
    if ran.trouble:
        results.failed[what] = ran.trouble


def _finish(results: Results, case: Case) -> None:
    """Measure the loops of a case against other runs, and put them in their order.

    Such are its bound, ``ideal``, and the same loop on the clean rail that the case names.
    """
    scenario = case.scenario.name
    if scenario not in results.data:
        return
    data, found = results.data[scenario], results.metrics[scenario]
    ideal, clean = found.get("ideal", {}), results.metrics.get(case.clean, {})
    for name in found if "distance" in ideal or clean else ():
        changes = [float(t) for t in data[name].attrs["rail_changes_s"]]
        run_ = Run(data[name], results.study.signals, changes, ideal, clean=clean.get(name, {}))
        found[name] = in_order(found[name] | measure(run_, AGAINST_OTHERS))
    results.data[scenario] = _as_in(data, case.loops)
    results.metrics[scenario] = _as_in(found, case.loops)


def _experiment_job(
    study: Study, name: str, cases: Sequence[Case], models: Mapping[str, Any], quick: bool,
    compile: bool, keep: Keep | None, cores: Cores,
) -> Job[dict[str, Table]]:  # fmt: skip
    """Make the job that does one experiment, or takes what an earlier run of it gave."""

    def job(tell: Callable[[float], None]) -> dict[str, Table]:
        found = keep.tables(name) if keep is not None else None
        if found is not None:
            return found
        context = Context(
            quick=quick, models=models, cases=cases, seed=EXPERIMENT_SEED, compile=compile,
            progress=tell, folder=keep.parts if keep is not None else None, cores=cores,
            key=keep.of(name) if keep is not None else "",
        )  # fmt: skip
        given = study.experiments[name].run(context)
        return {name: given} if isinstance(given, Table) else dict(given)

    return job


def _as_in(found: dict[str, T], order: Iterable[str]) -> dict[str, T]:
    return {name: found[name] for name in order if name in found}


def add_known(study: Study, case: Case, data: xarray.Dataset) -> xarray.Dataset:
    """Add what the study knows beside the loop to a log."""
    rail = case.scenario.rail
    where = None if rail is None else place(data, rail, study.signals)
    for name, known in case.known.items():
        column = known_column(known, rail, where, data)
        attributes = {"units": known.unit, "long_name": known.doc or name}
        dims = ("time", "axle" if data.sizes.get("axle") == column.shape[-1] else f"{name}.0")
        data = data.assign({name: (dims[: column.ndim], column, attributes)})
    return data


def judge_all(
    results: Results, changed: Callable[[Claim, set[str]], str] | None = None
) -> list[Verdict]:
    """Answer every claim of the study; one whose answer breaks is noted as failed.

    Args:
        results: what ran.
        changed: see :func:`~slipctl.study.verdicts.judge`.
    """
    verdicts = []
    for claim in results.study.claims:
        with note_failure(results, f"claim {claim.id}"):
            verdicts.append(judge(claim, results, changed))
            continue
        why = results.failed[f"claim {claim.id}"]
        verdicts.append(
            Verdict(claim, None, OPEN, f"the answer of the study cannot be computed: {why}")
        )
    return verdicts
