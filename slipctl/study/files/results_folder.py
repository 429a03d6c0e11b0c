"""The files that a run leaves: logs, metrics, claims, tables, figures and the report."""

from __future__ import annotations

import csv
import errno
import io
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.draw import live, plots
from slipctl.draw.live import Live
from slipctl.run import store
from slipctl.run.results import Results
from slipctl.study.failures import note_failure
from slipctl.study.jobs import Cores, Job, Outcome, run_jobs
from slipctl.study.provenance import provenance, stamp
from slipctl.study.report import report_page
from slipctl.study.report.texts import tolerance_text, values_beyond_limit
from slipctl.study.verdicts import Verdict

if TYPE_CHECKING:
    import xarray


message = logging.getLogger("slipctl")

PAGE = "page, "
"""How the job of a section of the page begins its name."""


def draft_log(data: xarray.Dataset, folder: Path, loop: str) -> list[tuple[Path, Path]]:
    """Write one log, ``.nc`` (exact) and ``.csv`` (ten digits), under temporary names.

    Returns:
        These names, each with the one that it gets at last.
    """
    attrs = {k: v for k, v in data.attrs.items() if not (isinstance(v, list) and not v)}
    packed = {str(n): {"zlib": True, "complevel": 1} for n in data.data_vars}
    exact = data.copy(deep=False)
    exact.attrs = attrs
    text, log = folder / f"{loop}.csv", folder / f"{loop}.nc"
    parts: list[tuple[Path, Path]] = []
    try:
        with store.hold_interrupts():
            for path in (text, log):
                with store.name_file_in_errors(path):
                    parts.append((store.part(path), path))
            with store.name_file_in_errors(text):
                parts[0][0].write_text(csv_text(data), encoding="utf-8", newline="\n")
            with store.name_file_in_errors(log):
                _save(exact, parts[1][0], packed)
    except BaseException:
        for part, _ in parts:
            part.unlink(missing_ok=True)
        raise
    return parts


def _save(data: xarray.Dataset, path: Path, packed: dict[str, dict[str, Any]]) -> None:
    try:
        data.to_netcdf(path, engine="netcdf4", encoding=packed)
    except RuntimeError as error:  # netCDF does not say that the disk is full
        raise OSError(errno.EIO, f"{error} (is the disk full?)") from error


def publish(parts: Sequence[tuple[Path, Path]]) -> None:
    """Give files that are whole the names that they are known by."""
    with store.hold_interrupts():
        for part, path in parts:
            store.publish(part, path)


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
    cells = [_cells(c) for c in columns]
    row = ",".join(form for form, _ in cells) + "\n"
    rows = zip(*(values for _, values in cells), strict=True)
    return head.getvalue() + "".join([row % r for r in rows])


def _cells(column: np.ndarray) -> tuple[str, list[Any]]:
    """Format of the cells of a column, and its values; what stands still is written once."""
    if column.dtype != np.float64:
        return "%.10g", column.tolist()
    bits = np.ascontiguousarray(column).view(np.int64)
    begins = np.flatnonzero(np.diff(bits, prepend=bits[:1] + 1))
    if 2 * len(begins) > len(column):
        return "%.10g", column.tolist()
    texts = np.array([f"{v:.10g}" for v in column[begins].tolist()], dtype=object)
    return "%s", np.repeat(texts, np.diff(begins, append=len(column))).tolist()


def save_metrics(results: Results, out: Path, command: str, state: str = "") -> None:
    """Write ``metrics.json``; ``state`` says what a run is that did not come to its end."""
    scenarios = {
        s: {
            loop: {
                n: {"value": m.value, "unit": m.unit} | ({"rows": list(m.rows)} if m.rows else {})
                for n, m in metrics.items()
            }
            for loop, metrics in loops.items()
        }
        for s, loops in results.metrics.items()
    }
    content: dict[str, Any] = {"scenarios": scenarios}
    if results.study.limits:
        content["limits"] = dict(results.study.limits)
        content["above_limits"] = {s: values_beyond_limit(results, s) for s in results.metrics}
    if results.failed:
        content["failed"] = results.failed
    _write(results, out / "metrics.json", command, content, state)


def _write(
    results: Results, file: Path, command: str, content: Mapping[str, Any], state: str = ""
) -> None:
    """Write what a file holds between what it is of and where it comes from."""
    head = {"study": results.study.name, "quick": results.quick}
    told = {"state": state} if state else {}
    store.write_json(file, {**head, **told, **content, **provenance(results, command)})


def save_claims(
    results: Results, verdicts: Sequence[Verdict], out: Path, command: str, state: str = ""
) -> None:
    """Write ``claims.json``; ``state`` as in :func:`save_metrics`."""
    rows = [claim_row(v) for v in verdicts]
    _write(results, out / "claims.json", command, {"claims": rows}, state)


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
    _write(results, out / "tables.json", command, {"experiments": rows})


Drawn = tuple[str, Live | None]
"""A figure as SVG, and its curves where it shows lines over time."""


def figure_jobs(results: Results, out: Path, command: str) -> dict[str, Callable[[Any], Drawn]]:
    """Jobs by file stem that each draw a figure, write it, and give what a page shows of it."""
    text = stamp(results, command)

    def draw(stem: str, tell: Any) -> Drawn:
        fig = results.study.figures[stem].draw(results)
        if results.quick:
            plots.mark_quick(fig)
        return plots.save(fig, out / "figures", stem, text), live.of_figure(fig)

    return {stem: partial(draw, stem) for stem in results.study.figures}


def section_jobs(results: Results) -> dict[str, Job[Any]]:
    """Sections of the page that need no run, by name; what they give goes to :func:`save_pages`."""
    return _sections(report_page.constant(results))


def save_pages(
    results: Results,
    judged: Callable[[], Sequence[Verdict]],
    out: Path,
    command: str,
    cores: Cores,
    there: Mapping[str, Outcome[Any]],
) -> None:
    """Draw the figures, write them and ``report.html``.

    A figure that asks for what was not run is left out; one that breaks is noted as failed.

    Args:
        results: what ran.
        judged: gives the claims with our answers; asked while figures are drawn, and once more.
        out: folder of the run.
        command: command line.
        cores: what the figures are drawn on.
        there: outcomes of :func:`section_jobs`; those that lack are written here.
    """
    plots.load()  # once, before the processes part
    figures = figure_jobs(results, out, command)
    jobs: dict[str, Job[Any]] = {f"figure {stem}": job for stem, job in figures.items()}
    jobs |= _sections(report_page.of_runs(results))
    jobs |= {n: j for n, j in section_jobs(results).items() if n not in there}
    done: dict[str, Any] = {}
    left: list[str] = []
    with closing(run_jobs(jobs, cores, lambda name, share: None, judged)) as outcomes:
        for name, outcome in chain(there.items(), outcomes):
            with note_failure(results, name, left):
                done[name] = outcome.get()
    if len(left) > 1:
        message.info("%d figures are left out: what they show was not run (-v: which)", len(left))
    for line in left:
        message.log(logging.INFO if len(left) == 1 else logging.DEBUG, line)
    both = {stem: done[f"figure {stem}"] for stem in figures if f"figure {stem}" in done}
    drawn = {stem: svg for stem, (svg, _) in both.items()}
    curves = {stem: live for stem, (_, live) in both.items() if live is not None}
    texts = {n.removeprefix(PAGE): t for n, t in done.items() if n.startswith(PAGE)}
    page = report_page.page(results, judged(), drawn, command, texts, curves=curves)
    store.write_text(out / "report.html", page)


def _sections(parts: Mapping[str, Callable[[], str]]) -> dict[str, Job[Any]]:
    def job(write: Callable[[], str], tell: Any) -> str:
        return write()

    return {PAGE + name: partial(job, write) for name, write in parts.items()}
