"""``slipctl replay``: a recorded log through an estimator or a controller, and a report of it."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import __version__
from slipctl.block.block import Block
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.draw import live, plots
from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.run.logs.recorded_log import csv_of, read_recording
from slipctl.run.logs.replay import Replayed, replay
from slipctl.study.report.page_style import STYLE, figure, html_page, table
from slipctl.study.report.texts import number, wrap_table
from slipctl.study.request import Request

log = logging.getLogger("slipctl")

FIGURES = 8
"""Most outputs that are drawn without being asked for."""


def answer(options: argparse.Namespace, command: str) -> int:
    """Run, write and print."""
    out = Path(options.out)
    if not options.out:
        raise BadInput("--out names no folder; write one")
    store.check_folder(out)
    block = load_part(options.block)
    gap = parse_quantity(options.gap, "s", "--gap") if options.gap else None
    period = parse_quantity(options.period, "s", "--period") if options.period else None
    mapping, beside = pairs("--map", options.mapped), pairs("--beside", options.beside)
    names = {m for n in block.inputs for m in (n, n.rpartition(".")[2]) if n not in mapping}
    recording = read_recording(
        options.log,
        options.time or "",
        gap,
        [*mapping.values(), *beside.values(), *names],
        options.decimal or "",
    )
    found = replay(
        block, recording, mapping, settings=pairs("--set", options.settings), beside=beside,
        period=period, rule=options.resample,
        compile=not options.no_compile,
    )  # fmt: skip
    for line in found.done:
        log.debug("%s", line)
    for note in found.notes:
        log.warning("%s", note)
    rows = statistics(found)
    figures = {
        n: (plots.svg_text(f, command), live.of_figure(f)) for n, f in replay_figures(found).items()
    }
    store.write_json(out / "replay.json", {
        "log": options.log, "block": options.block, "slipctl_version": __version__,
        "command": command, "read": found.done, "notes": found.notes, "gaps_s": found.gaps,
        "statistics": [dict(zip(HEAD, r, strict=True)) for r in rows],
    })  # fmt: skip
    store.write_text(out / "replay.csv", csv_of(columns(found)))
    store.write_text(out / "report.html", page(found, rows, figures, options, command))
    if options.json:
        print(store.text_of(out / "replay.json"))
        return 0
    print(text(found, rows, options))
    print(f"\n{out / 'replay.csv'}\n{out / 'report.html'}")
    return 0


def load_part(name: str) -> Block:
    """Block by ``STUDY:LOOP.PART``, or as every command takes one.

    Raises:
        BadInput: no such block, or a whole loop.
    """
    asked = Request.read(name)
    if asked.loop and not asked.part:
        parts = ", ".join(f"{name}.{n}" for n in asked.block.parts)
        raise BadInput(f"{name} is a whole loop; write which part of it: {parts}")
    return asked.block


def pairs(option: str, texts: Sequence[str], example: str = "") -> dict[str, str]:
    """Names and what stands behind their ``=``, which is written as in the example.

    Raises:
        BadInput: none of both, or a name that stands twice.
    """
    found: dict[str, str] = {}
    for text_ in texts:
        name, equals, value = (part.strip() for part in text_.partition("="))
        if not equals or not name or not value:
            usual = "omega=WheelSpeed_1[km/h]" if option != "--set" else "T_b=0"
            raise BadInput(f"{option} {text_!r}: write {example or f'NAME=..., such as {usual}'}")
        if name in found:
            raise BadInput(f"{option} names {name} twice; write it once")
        found[name] = value
    return found


HEAD = ("signal", "unit", "mean", "rms", "largest")


def statistics(found: Replayed) -> list[list[str]]:
    """Residuals and innovations outside the gaps: mean, rms and largest."""
    keep = found.outside_gaps()
    rows = []
    signals = [(f"{c.output}: recorded minus computed", c.unit, c.residual) for c in found.compared]
    signals += [(n, found.block.outputs[n].unit, found.data[n].values) for n in found.innovations]
    for name, unit, values in signals:
        x = values[keep & np.isfinite(values)]
        three = (x.mean(), np.sqrt(np.mean(x**2)), np.abs(x).max()) if x.size else (None,) * 3
        rows.append([name, unit, *(number(None if v is None else float(v)) for v in three)])
    return rows


def replay_figures(found: Replayed) -> dict[str, plots.Figure]:
    """Outputs beside the recording with their residuals, innovations, other outputs."""
    time = found.data["time"].values
    figures = {}
    for c in found.compared:
        fig, axes = plots.panels(2, sharex=True)
        plots.lines({"recorded": (time, c.recorded), "computed": (time, c.computed)},
                    ("", ""), (c.output, c.unit), axis=axes[0, 0])  # fmt: skip
        plots.lines({"residual": (time, c.residual)}, ("time", "s"),
                    ("recorded - computed", c.unit), axis=axes[1, 0], legend=False)  # fmt: skip
        figures[f"{c.output} beside the recording"] = fig
    rest = [n for n in found.block.outputs
            if n in found.data and n not in {c.output for c in found.compared}]  # fmt: skip
    rest.sort(key=lambda n: n not in found.innovations)
    for n in rest[:FIGURES]:
        s = found.block.outputs[n]
        figures[n] = plots.lines({n: (time, found.data[n].values)}, ("time", "s"),
                                 (s.doc or n, s.unit), legend=False)  # fmt: skip
    return figures


def columns(found: Replayed) -> dict[str, np.ndarray]:
    """What ``replay.csv`` holds: all signals, and the recording beside them."""
    time = found.data["time"].values
    cells = {"time [s]": time + found.data.attrs["log_start_s"]}
    for n, v in found.data.data_vars.items():
        if v.ndim == 1:
            cells[f"{n} [{v.attrs.get('units', '1')}]"] = v.values
    for c in found.compared:
        cells[f"{c.output} recorded [{c.unit}]"] = c.recorded
        cells[f"{c.output} residual [{c.unit}]"] = c.residual
    return cells


def text(found: Replayed, rows: Sequence[Sequence[str]], options: argparse.Namespace) -> str:
    """What a person reads on the terminal."""
    time = found.data["time"].values
    held = sum(b - a for a, b in found.gaps)
    head = (
        f"{found.block.name} over {options.log}: {time.size} ticks of {found.block.period:g} s,"
        f" {len(found.gaps)} gaps ({held:.3g} s)"
    )
    if not rows:
        return f"{head}\nno output was compared; --beside OUTPUT=COLUMN compares one"
    every = [list(HEAD), *rows]
    return f"{head}\n\n{wrap_table(every)}"


def page(
    found: Replayed, rows: Sequence[Sequence[str]], figures: Mapping[str, Any],
    options: argparse.Namespace, command: str,
) -> str:  # fmt: skip
    """The report as one HTML file."""
    title = f"{found.block.name} over {Path(options.log).name}"
    done = "".join(f"<li>{escape(n)}</li>" for n in (*found.done, *found.notes))
    gaps = table(
        ("gap from [s]", "to [s]"), [(number(a), number(b)) for a, b in found.gaps], (0, 1)
    )
    points = live.share(curves for _, curves in figures.values() if curves)
    pictures = "".join(
        figure(svg, n, escape(n), curves, points) for n, (svg, curves) in figures.items()
    )
    compared = table(HEAD, rows, (2, 3, 4)) if rows else "<p>Nothing is compared.</p>"
    said = f"{escape(options.block)}, ticks of {found.block.period:g} s"
    body = f"""<h2>Figures</h2>{pictures}
<h2>Residuals and innovations</h2>{compared}
<h2>How the log was read</h2><ul>{done}</ul>{gaps if found.gaps else ""}
<h2>Provenance</h2><pre>{escape(command)}
slipctl {__version__}</pre>
<script>{live.script()}</script>"""
    return html_page(title, said, body, STYLE + live.STYLE)
