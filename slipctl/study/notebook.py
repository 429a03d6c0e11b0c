"""What a cell of a notebook shows of a block, a rail, a scenario, a study, a fit, a sweep, a proof.

Short: a line of what it is, then equations, a curve or a table. The classes look this up by name,
from ``_repr_html_``, so that nothing below depends on pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import singledispatch
from html import escape
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.certify.certificate import Certificate
from slipctl.draw import plots
from slipctl.draw.looks import pretty
from slipctl.estimate.curve_fit import Fitted
from slipctl.estimate.log_fit.record import FittedOverTime
from slipctl.run.rail import Rail, Scenario
from slipctl.run.results import Loops
from slipctl.run.sweep.spread import quantiles
from slipctl.run.sweep.sweep_runs import Sweep
from slipctl.study.declaration import Study
from slipctl.study.report.page_style import image, table
from slipctl.study.report.report_page import equations
from slipctl.study.report.texts import number, number_or_never

ROWS = 20
"""Rows of a table that a cell shows."""


@singledispatch
def html(thing: Any) -> str:
    """Markup of a thing for a cell of a notebook."""
    return f"<pre>{escape(repr(thing))}</pre>"


def _head(name: str, said: str = "") -> str:
    line = " ".join(said.split())
    return f"<p><b>{escape(name)}</b>{' · ' if line else ''}{escape(line)}</p>"


def _rows(head: Sequence[str], rows: Iterable[Sequence[Any]], right: Sequence[int] = ()) -> str:
    """Table of the first rows, and how many more there are."""
    every = list(rows)
    more = len(every) - ROWS
    left = f"<p>and {more} more</p>" if more > 0 else ""
    return (table(head, every[:ROWS], right) + left) if every else ""


def _value(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    array = np.asarray(value, dtype=float)
    return number(float(array)) if array.ndim == 0 else f"{array.size} numbers"


@html.register
def _block(block: Block) -> str:
    said = block.doc.partition("\n")[0]
    out = _head(block.name, said)
    signals = [
        (s.name, s.role, pretty(s.unit), _value(s.value), " ".join(s.doc.split()))
        for s in block.signals
    ]
    if block.parts:
        parts = [(n, b.kind, b.doc.partition("\n")[0]) for n, b in block.parts.items()]
        out += _rows(("part", "kind", "what it is"), parts)
        signals = [s for s in signals if s[1] in ("input", "output")]
    else:
        out += equations(block)
        out += _curve(block)
    return out + _rows(("signal", "role", "unit", "value", "meaning"), signals, (3,))


def _curve(block: Block) -> str:
    """Picture of an adhesion law over its slip."""
    slip = next(iter(block.inputs.values()), None)
    ready = all(s.value is not None for s in list(block.inputs.values())[1:])
    if slip is None or slip.per is None or block.kind != "law" or not ready:
        return ""
    if list(block.outputs) != ["mu"] or any(s.value is None for s in block.params.values()):
        return ""
    upto = 0.5 if slip.per == "ratio" else 5.0
    return image(plots.svg_text(plots.laws(block, upto=upto)), f"adhesion of {block.name}")


@html.register
def _loops(loops: Loops) -> str:
    return _head("loops", f"{len(loops)}: {', '.join(loops)}")


@html.register
def _rail(rail: Rail) -> str:
    unit = "s" if rail.by == "time" else "m"
    return _rows(
        (f"from [{unit}]", "condition", "values"),
        [(number(s.start), s.condition or "",
          ", ".join(f"{n} = {_value(v)}" for n, v in s.values.items())) for s in rail.sections],
        (0,),
    )  # fmt: skip


@html.register
def _scenario(scenario: Scenario) -> str:
    noise = f"noise x {scenario.noise:g}, " if scenario.noise != 1 else ""
    said = f"{scenario.duration:g} s, {noise}seed {scenario.seed}"
    out = _head(scenario.name, f"{said}. {scenario.doc}" if scenario.doc else said)
    given = [
        (kind, n, _value(v) if isinstance(v, (int, float)) else "changes")
        for kind in ("inputs", "start", "params") for n, v in getattr(scenario, kind).items()
    ]  # fmt: skip
    return out + (html(scenario.rail) if scenario.rail else "") + _rows(
        ("set", "name", "value"), given, (2,)
    )  # fmt: skip


@html.register
def _study(study: Study) -> str:
    cases = study.cases(study.models, False)
    return _head(study.name, study.title) + _rows(
        ("scenario", "duration [s]", "loops", "what it is"),
        [(c.scenario.name, number(c.scenario.duration), ", ".join(c.loops), c.scenario.doc)
         for c in cases],
        (1,),
    )  # fmt: skip


@html.register
def _fitted(found: Fitted) -> str:
    rows = []
    for n, v in found.values.items():
        ends = found.interval.get(n)
        rows.append((
            n, number(v), pretty(found.law.params[n].unit),
            "at a bound" if ends is None else f"{number(ends[0])} to {number(ends[1])}",
        ))  # fmt: skip
    table = _rows(("parameter", "value", "unit", "95 % interval"), rows, (1,))
    return _fit(found, found.law.name, table)


def _fit(found: Fitted | FittedOverTime, name: str, table: str) -> str:
    said = f"rms of the residuals {number(found.rms)}, largest {number(found.max_error)}"
    doubts = "".join(f"<p>{escape(line)}</p>" for line in found.doubts)
    return _head(name, said) + table + doubts


@html.register
def _fitted_over_time(found: FittedOverTime) -> str:
    rows = [
        (n, number(v), number(found.std[n], 2), pretty(found.unit(n)),
         "{} to {}".format(*map(number, found.interval[n])))
        for n, v in found.values.items()
    ]  # fmt: skip
    table = _rows(("parameter", "value", "std", "unit", "95 % interval"), rows, (1, 2))
    return _fit(found, found.flow.name, table)


@html.register
def _sweep(sweep: Sweep) -> str:
    said = f"{len(sweep.runs)} of {sweep.plan.size} runs, {len(sweep.failed)} failed"
    rows = []
    for name, unit, values in sweep.labelled():
        ends = quantiles(values, [0, 0.5, 1])
        if not np.isnan(ends[0]):
            never = int(np.isinf(values).sum())
            rows.append((name, *map(number_or_never, ends), str(never or ""), pretty(unit)))
    if sweep.kept:
        said += f"; {sweep.kept}"
    return _head(sweep.folder.name, said) + _rows(
        ("metric", "least", "median", "largest", "never", "unit"), rows, (1, 2, 3, 4)
    )


@html.register
def _certificate(found: Certificate) -> str:
    entries = found.entries
    plain = [(n, str(v)) for n, v in entries.items() if isinstance(v, (str, int, float))]
    return _head(found.verdict, str(entries.get("system", ""))) + _rows(("entry", "value"), [
        (n, v if len(v) <= 120 else f"{v[:117]}...") for n, v in plain if n != "verdict"
    ])  # fmt: skip
