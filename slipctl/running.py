"""Running a study: what the command line set and swapped, the runs, and the files they leave."""

from __future__ import annotations

import csv
import io
import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from slipctl import __version__, store, units
from slipctl.block import Block
from slipctl.doors import blame, find_block, load_block, load_file
from slipctl.errors import BadInput, RunFailed, nearest
from slipctl.metrics import Run, measure, place, rail_changes
from slipctl.simulation import _find, rail_values, simulate
from slipctl.studying import OPEN, Case, Context, NotRun, Results, Study, Table, Verdict, judge
from slipctl.texts import tolerance_text

if TYPE_CHECKING:
    import xarray

log = logging.getLogger("slipctl")

T = TypeVar("T")

EXPERIMENT_SEED = 1
"""Seed that experiments get."""

Report = Callable[[str, float], None]
"""Called with what is running and the share of it that is done."""


@dataclass(frozen=True)
class Setting:
    """One ``--set [loop:]block.param=VALUE[unit]``; ``*.m`` sets every parameter of that ending."""

    loop: str
    name: str
    value: str

    @classmethod
    def read(cls, text: str) -> Setting:
        """Split the text of a setting.

        Raises:
            BadInput: it is not of that form.
        """
        target, equals, value = text.partition("=")
        loop, _, name = target.strip().rpartition(":")
        if not equals or not name or not value.strip():
            raise BadInput(
                f"--set {text!r}: write [loop:]block.param=VALUE[unit], such as car.m=8.2t"
            )
        return cls(loop.strip(), name.strip(), value.strip())

    def matches(self, loop: Block) -> list[str]:
        """Full names of the parameters and start values that are meant.

        Raises:
            BadInput: more than one, without a ``*``.
        """
        known = [*loop.params, *loop.states]
        if self.name in known:
            return [self.name]
        if "*" in self.name:
            return [n for n in known if fnmatchcase(n, self.name)]
        hits = [n for n in known if n.endswith("." + self.name)]
        if len(hits) > 1:
            raise BadInput(
                f"--set {self.name}: could be {' or '.join(hits)}; write which,"
                f" or '*.{self.name}' for all"
            )
        return hits


def read_swaps(study: Study, texts: Sequence[str]) -> dict[str, Any]:
    """Models of a study with each ``name=file.py:block`` (or ``name=model``) in place.

    Raises:
        BadInput: no such model in the study, no such file or block.
    """
    swapped = dict(study.models)
    for text in texts:
        name, equals, source = (part.strip() for part in text.partition("="))
        if not equals or not source:
            raise BadInput(f"--swap {text!r}: write name=file.py:block, such as adh=my.py:my_law")
        if not study.models:
            raise BadInput(
                f"{study.name} has no models that --swap replaces; a study of your own may swap any"
                " part of its loops, see docs/all_rails.md, 'Rails of your own'"
            )
        if name not in study.models:
            raise BadInput(
                f"{study.name} has no model {name!r} to swap{nearest(name, study.models)}"
            )
        file, colon, block = source.rpartition(":")
        swapped[name] = find_block(load_file(file), block, file) if colon else load_block(source)
    return swapped


def in_words(swaps: Sequence[str], settings: Sequence[str]) -> str:
    """What was swapped and set, ``"adh swapped for my.py:law, car.m=8.2t set"``."""
    swapped = [" swapped for ".join(s.strip() for s in t.split("=", 1)) for t in swaps]
    return ", ".join([*swapped, *(f"{t.strip()} set" for t in settings)])


def prepare(
    study: Study,
    *,
    quick: bool = False,
    settings: Sequence[str] = (),
    swaps: Sequence[str] = (),
    loops: Sequence[str] = (),
    scenarios: Sequence[str] = (),
) -> tuple[list[Case], Mapping[str, Any]]:
    """Build the cases of a study as asked for, and check each of them by a run of one tick.

    Args:
        study: the study.
        quick: its quick form.
        settings: ``[loop:]block.param=VALUE[unit]``.
        swaps: ``name=file.py:block``.
        loops, scenarios: the only ones to keep; none given keeps all.

    Returns:
        The cases, and the models they are made of.

    Raises:
        BadInput: anything that a person can put right; nothing was computed yet.
    """
    models = read_swaps(study, swaps)
    read = [Setting.read(text) for text in settings]
    for k, setting in enumerate(read):
        if any((s.loop, s.name) == (setting.loop, setting.name) for s in read[:k]):
            raise BadInput(f"--set names {setting.name} twice; write it once")
    try:
        cases = list(study.cases(models, quick))
        cases = _select(study, cases, loops, scenarios)
        cases = _set(study, cases, read)
        for case in cases:
            for name, loop in case.loops.items():
                _try(case, name, loop)
                study.check(name, loop, case.scenario)
    except Exception as error:
        blame(error)
    return cases, models


def _select(
    study: Study, cases: list[Case], loops: Sequence[str], scenarios: Sequence[str]
) -> list[Case]:
    known = [c.scenario.name for c in cases]
    for s in scenarios:
        if s not in known:
            raise BadInput(f"{study.name} has no scenario {s!r}{nearest(s, known)}")
    names = list(dict.fromkeys(n for c in cases for n in c.loops))
    for name in loops:
        if name not in names:
            raise BadInput(f"{study.name} has no loop {name!r}{nearest(name, names)}")
    kept = [c for c in cases if not scenarios or c.scenario.name in scenarios]
    if loops:
        kept = [replace(c, loops={n: b for n, b in c.loops.items() if n in loops}) for c in kept]
    kept = [c for c in kept if c.loops]
    if not kept:
        raise BadInput(f"{study.name} has no loop {' or '.join(loops)} in {' or '.join(scenarios)}")
    return kept


def _set(study: Study, cases: list[Case], settings: Sequence[Setting]) -> list[Case]:
    """Apply the settings; each must reach at least one loop that runs."""
    for s in settings:
        names = list(dict.fromkeys(n for c in cases for n in c.loops))
        if s.loop and s.loop not in names:
            raise BadInput(
                f"--set {s.loop}:{s.name}: no loop {s.loop!r} runs{nearest(s.loop, names)}"
            )
        reached, overruled, changed = 0, "", []
        for case in (_freed(case, s) for case in cases):
            loops = dict(case.loops)
            for name, loop in case.loops.items():
                if s.loop not in ("", name):
                    continue
                targets = s.matches(loop)
                by_rail = {n for group in rail_values(loop, case.scenario) for n in group}
                free = [t for t in targets if t not in by_rail]
                if len(free) < len(targets) and not overruled:
                    first = next(t for t in targets if t in by_rail)
                    overruled = f"{name}'s {first} in scenario {case.scenario.name}"
                if free:
                    loops[name] = _with(loop, free, s)
                    reached += 1
            changed.append(replace(case, loops=loops))
        if not reached and overruled:
            raise BadInput(
                f"--set {s.name}: the rail sets {overruled}, so a constant has no effect;"
                f" --swap the law, or edit its rail conditions"
            )
        if not reached:
            loop_names = (n for c in cases for k, b in c.loops.items() if s.loop in ("", k)
                          for n in [*b.params, *b.states])  # fmt: skip
            endings = dict.fromkeys(e for n in loop_names for e in _endings(n))
            where = f"loop {s.loop}" if s.loop else f"no loop of {study.name}"
            has = "has no" if s.loop else "has a"
            raise BadInput(f"{where} {has} parameter {s.name!r}{nearest(s.name, endings)}")
        if overruled:
            log.warning("--set %s has no effect where the rail sets it: %s", s.name, overruled)
        cases = changed
    return cases


def _endings(name: str) -> list[str]:
    """Endings of a dotted name with at least two parts, shortest first: what a person writes."""
    parts = name.split(".")
    return [".".join(parts[k:]) for k in range(max(len(parts) - 2, 0), -1, -1)]


def _freed(case: Case, s: Setting) -> Case:
    """Hand what the scenario gives, where a setting changes it, to the loops: the setting wins."""
    scenario, loops = case.scenario, dict(case.loops)
    for role, field in (("param", "params"), ("state", "start")):
        kept = dict(getattr(scenario, field))
        for key, value in list(kept.items()):
            chosen = {n: b for n, b in case.loops.items() if s.loop in ("", n)}
            if any(_find(b, role, key) in s.matches(b) for b in chosen.values()):
                del kept[key]
                log.warning("--set %s replaces %s of scenario %s", s.name, key, scenario.name)
                loops = {n: b.with_params(**{_find(b, role, key): value}) for n, b in loops.items()}
        scenario = scenario.but(**{field: kept})
    return replace(case, scenario=scenario, loops=loops)


def _with(loop: Block, targets: Sequence[str], s: Setting) -> Block:
    values = {}
    for t in targets:
        signal = loop.params.get(t) or loop.states[t]
        values[t] = units.parse_quantity(s.value, signal.unit, t)
    return loop.with_params(**values)


def _try(case: Case, name: str, loop: Block) -> None:
    """Run one tick: whatever is missing, unknown or out of range shows."""
    scenario = case.scenario
    if loop.period is not None and round(scenario.duration / loop.period) > 1:
        scenario = scenario.but(duration=loop.period)
    try:
        simulate(loop, scenario, compile=False)
    except BadInput as error:
        raise BadInput(f"{case.scenario.name}/{name}: {error}") from None
    except RunFailed:
        return  # the run itself will say so, with what else there is to see
    sections = 1 if case.scenario.rail is None else len(case.scenario.rail.sections)
    for key, known in case.known.items():
        if isinstance(known.values, Sequence) and len(known.values) != sections:
            raise BadInput(
                f"{case.scenario.name}: {key} has {len(known.values)} values for {sections}"
                f" rail sections"
            )


# ---- running ------------------------------------------------------------------------------------


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
    metrics = measure(Run(data, study.signals, changes, ideal))
    if name == "ideal" and "distance" in metrics:
        metrics = measure(Run(data, study.signals, changes, metrics))
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


# ---- files --------------------------------------------------------------------------------------


def provenance(results: Results, command: str) -> dict[str, Any]:
    """What every file says of where it comes from."""
    import casadi

    parameters: dict[str, Any] = {}
    for case in results.cases:
        for name, loop in case.loops.items():
            values = {
                n: {"value": np.asarray(v).tolist(), "unit": loop.params[n].unit}
                for n, v in loop.param_values().items()
            }
            first = parameters.setdefault(name, values)
            other = {n: v for n, v in values.items() if first.get(n) != v}
            if other:
                parameters[f"{name}@{case.scenario.name}"] = other
    seeds = {c.scenario.name: c.scenario.seed for c in results.cases}
    if results.tables:
        seeds["experiments"] = EXPERIMENT_SEED
    return {
        "slipctl_version": __version__,
        "casadi_version": casadi.__version__,  # type: ignore[attr-defined]
        "numpy_version": np.__version__,
        "command": command,
        "study": results.study.name,
        "quick": results.quick,
        "seed": seeds,
        "parameters": parameters,
    }


def save_log(results: Results, scenario: str, loop: str, out: Path, command: str) -> None:
    """Write one log as ``.nc`` (exact) and ``.csv`` (ten digits)."""
    data = results.data[scenario][loop].assign_attrs(command=command)
    folder = out / "logs" / scenario
    attrs = {k: v for k, v in data.attrs.items() if not (isinstance(v, list) and not v)}
    packed = {str(n): {"zlib": True, "complevel": 1} for n in data.data_vars}
    exact = data.copy(deep=False)
    exact.attrs = attrs
    with store.unbroken():
        store.write_with(
            folder / f"{loop}.nc",
            lambda path: exact.to_netcdf(path, engine="netcdf4", encoding=packed),
        )
        store.write_text(folder / f"{loop}.csv", csv_text(data))


def csv_text(data: xarray.Dataset) -> str:
    """Log as text: a header ``car.v [m/s]``, then one row per tick."""
    columns, names = [data["time"].values], ["time [s]"]
    for name, v in data.data_vars.items():
        unit = v.attrs.get("units", "1")
        flat = v.values.reshape(len(v), -1)
        many = flat.shape[1] > 1
        names += [f"{name}{f'[{k}]' if many else ''} [{unit}]" for k in range(flat.shape[1])]
        columns += list(flat.T)
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(names)
    row = ",".join(["%.10g"] * len(columns))
    rows = np.column_stack(columns).tolist()
    return head.getvalue() + "".join([row % tuple(r) + "\n" for r in rows])


def read_log(path: Path) -> xarray.Dataset:
    """Read a log that :func:`save_log` wrote.

    Raises:
        BadInput: no such file, or a newer format.
    """
    import xarray

    try:
        with xarray.open_dataset(path, engine="netcdf4") as data:
            store.check_format(str(path), data.attrs.get("format"))
            return data.load()
    except OSError as error:
        raise BadInput(f"cannot read {path}: {error.strerror or error}") from None


def save_metrics(results: Results, out: Path, command: str) -> None:
    """Write ``metrics.json``."""
    scenarios = {
        s: {
            loop: {n: {"value": m.value, "unit": m.unit} for n, m in metrics.items()}
            for loop, metrics in loops.items()
        }
        for s, loops in results.metrics.items()
    }
    payload: dict[str, Any] = {"study": results.study.name, "quick": results.quick}
    payload["scenarios"] = scenarios
    if results.failed:
        payload["failed"] = results.failed
    store.write_json(out / "metrics.json", payload | provenance(results, command))


def save_claims(results: Results, verdicts: Sequence[Verdict], out: Path, command: str) -> None:
    """Write ``claims.json``."""
    rows = [claim_row(v) for v in verdicts]
    payload = {"study": results.study.name, "quick": results.quick, "claims": rows}
    store.write_json(out / "claims.json", payload | provenance(results, command))


def claim_row(v: Verdict) -> dict[str, Any]:
    """One claim as ``claims.json`` has it."""
    c = v.claim
    checked = c.kind != "yes/no" and not c.not_checkable and c.tolerance is not None
    return {
        "id": c.id, "source": c.source, "claim": c.claim, "kind": c.kind, "paper": c.paper,
        "ours": v.ours, "unit": c.unit, "bound": c.bound or None,
        "tolerance": c.allowed() if checked else None,
        "tolerance_why": tolerance_text(c),
        "assumption": c.assumption, "scenario": c.scenario, "loop": c.loop,
        "verdict": v.verdict, "why": v.why,
    }  # fmt: skip


def save_tables(results: Results, out: Path, command: str) -> None:
    """Write ``tables.json``, the experiments; none leaves no file."""
    if not results.tables:
        return
    rows = {
        experiment: {
            name: {
                "title": t.title,
                "doc": t.doc,
                "columns": {c: {"unit": u, "values": list(v)} for c, (u, v) in t.columns.items()},
            }
            for name, t in tables.items()
        }
        for experiment, tables in results.tables.items()
    }
    payload = {"study": results.study.name, "quick": results.quick, "experiments": rows}
    store.write_json(out / "tables.json", payload | provenance(results, command))


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


def stamp(results: Results, command: str) -> str:
    """Provenance on one line, for the metadata of a figure."""
    return json.dumps({"format": store.FORMAT, **store.plain(provenance(results, command))})


def save_pages(
    results: Results, verdicts: Sequence[Verdict], out: Path, command: str
) -> dict[str, str]:
    """Draw the figures, write them and ``report.html``; gives the SVG by file stem.

    A figure that asks for what was not run is left out; one that breaks is noted as failed.
    """
    from slipctl import plots, report

    drawn: dict[str, str] = {}
    text = stamp(results, command)
    for stem, figure in results.study.figures.items():
        with noted(results, f"figure {stem}"):
            fig = figure.draw(results)
            if results.quick:
                plots.mark_quick(fig)
            drawn[stem] = plots.save(fig, out / "figures", stem, text)
    store.write_text(out / "report.html", report.page(results, verdicts, drawn, command))
    return drawn
