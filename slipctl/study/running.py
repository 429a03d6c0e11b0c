"""Running a study: its cases, then its experiments, and judging its claims."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from slipctl.errors import BadInput, RunFailed
from slipctl.run.metrics import Run, measure, place, rail_changes, rail_names
from slipctl.run.results import Case, NotRun, Results, Table
from slipctl.run.simulation import simulate
from slipctl.study.declaration import OPEN, Context, Study, Verdict, judge
from slipctl.study.doors import blame
from slipctl.study.provenance import EXPERIMENT_SEED

if TYPE_CHECKING:
    import xarray

log = logging.getLogger("slipctl")

T = TypeVar("T")

Report = Callable[[str, float], None]
"""Called with what is running and the share of it that is done."""


def run(
    study: Study,
    cases: Sequence[Case],
    models: Mapping[str, Any] | None = None,
    *,
    quick: bool = False,
    compile: bool = True,
    experiments: bool = True,
    report: Report | None = None,
    finished: Callable[[Results, str, str], None] | None = None,
    results: Results | None = None,
    folder: Path | None = None,
) -> Results:
    """Run the cases, then the experiments.

    A run that breaks is noted in ``results.failed`` and the others go on.

    Args:
        study: the study.
        cases: from :func:`prepare`.
        models: from :func:`prepare`, for the experiments.
        quick: as told to :func:`prepare`.
        compile: compile the loops where there is a compiler.
        experiments: run them too.
        report: told how far each run is.
        finished: called after each run, to save it.
        results: filled as the runs finish, so that an interrupted call leaves what was done.
        folder: where experiments keep what is finished, to be read on the next start.
    """
    results = new_results(study, cases, quick) if results is None else results
    tell = report or (lambda what, share: None)
    for case in cases:
        scenario = case.scenario.name
        ordered = sorted(case.loops, key=lambda n: n != "ideal")  # the bound first
        for name in ordered:
            what = f"{scenario}/{name}"
            tell(what, 0.0)
            with noted(results, what):
                _run_one(results, case, name, compile, _part(tell, what))
            if finished and name in results.data.get(scenario, {}):
                finished(results, scenario, name)
        if scenario in results.data:
            results.data[scenario] = _as_in(results.data[scenario], case.loops)
            results.metrics[scenario] = _as_in(results.metrics[scenario], case.loops)
    if experiments:
        for name, experiment in study.experiments.items():
            tell(name, 0.0)
            context = Context(
                quick=quick, models=study.models if models is None else models, cases=cases,
                seed=EXPERIMENT_SEED, compile=compile, progress=_part(tell, name), folder=folder,
            )  # fmt: skip
            with noted(results, name):
                found = experiment.run(context)
                results.tables[name] = {name: found} if isinstance(found, Table) else dict(found)
    return results


@contextmanager
def noted(results: Results, what: str) -> Iterator[None]:
    """Note what breaks, so that the rest goes on and nothing computed is lost."""
    try:
        yield
    except NotRun as missing:
        log.info("%s is left out: %s", what, missing)
    except Exception as error:
        results.failed[what] = reason(error)
        log.debug("%s", what, exc_info=True)


def reason(error: Exception) -> str:
    """Say an error in one line, with its place where it is in a model or a study."""
    try:
        blame(error)
    except (BadInput, RunFailed) as known:
        return str(known)
    except OSError as known:
        return f"cannot write {known.filename or ''}: {known.strerror or known}"
    except Exception as unknown:
        return f"{type(unknown).__name__}: {str(unknown).strip().partition(chr(10))[0]}"


def _run_one(
    results: Results, case: Case, name: str, compile: bool, progress: Callable[[float], None]
) -> None:
    """Simulate one loop in its scenario and measure it."""
    study, scenario = results.study, case.scenario.name
    loop = case.loops[name]
    has = {s.name for s in loop.signals if s.role != "param"}
    wanted = None if case.log is None else [n for n in case.log if n in has]
    data = simulate(
        loop, case.scenario, compile=compile, progress=progress, log=wanted, every=case.every
    )
    data = add_known(study, case, data)
    changes = rail_changes(data, case.scenario, study.signals)
    data = data.assign_attrs(
        study=study.name, quick=int(results.quick), loop_name=name, rail_changes_s=changes
    )
    ideal = results.metrics.get(scenario, {}).get("ideal", {})
    rails = rail_names(case.scenario, changes)
    metrics = measure(Run(data, study.signals, changes, ideal, rails))
    if name == "ideal" and "distance" in metrics:
        metrics = measure(Run(data, study.signals, changes, metrics, rails))
    results.data.setdefault(scenario, {})[name] = data
    results.metrics.setdefault(scenario, {})[name] = metrics
    log.debug("%s/%s done", scenario, name)


def new_results(
    study: Study, cases: Sequence[Case], quick: bool = False, changed: str = ""
) -> Results:
    """Make results to be filled by :func:`run`; ``changed`` is from :func:`in_words`."""
    return Results(study, cases, quick, changed=changed)


def _as_in(found: dict[str, T], order: Iterable[str]) -> dict[str, T]:
    return {name: found[name] for name in order if name in found}


def _part(tell: Report, what: str) -> Callable[[float], None]:
    return lambda share: tell(what, share)


def add_known(study: Study, case: Case, data: xarray.Dataset) -> xarray.Dataset:
    """Add what the study knows beside the loop to a log."""
    rail = case.scenario.rail
    where = None if rail is None else place(data, rail, study.signals)
    for name, known in case.known.items():
        values: Any = known.values
        if callable(values):
            values = np.asarray(values(data), dtype=float)
        elif isinstance(values, Sequence):
            if rail is None or where is None:
                values = values[0]
            else:
                section = np.searchsorted(rail.starts, where + 1e-9, side="right") - 1
                values = np.asarray(values, dtype=float)[np.maximum(section, 0)]
        column = np.array(np.broadcast_to(values, data["time"].shape), dtype=float)
        attributes = {"units": known.unit, "long_name": known.doc or name}
        data = data.assign({name: ("time", column, attributes)})
    return data


def judge_all(results: Results) -> list[Verdict]:
    """Answer every claim of the study; one whose answer breaks is noted as failed."""
    verdicts = []
    for claim in results.study.claims:
        with noted(results, f"claim {claim.id}"):
            verdicts.append(judge(claim, results))
            continue
        why = results.failed[f"claim {claim.id}"]
        verdicts.append(Verdict(claim, None, OPEN, f"our answer breaks: {why}"))
    return verdicts
