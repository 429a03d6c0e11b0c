"""``slipctl show``: equations, signals, units, sources of a block; contents of a study."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import textwrap
from typing import Any

from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.study.request import Request


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what the name stands for."""
    name = options.name
    asked = Request.read(name)
    whole = asked.home and not asked.loop
    if options.json and (options.latex or options.graph or options.against):
        raise BadInput("--json says all; leave out --latex, --graph and --against")
    if whole and not (options.latex or options.graph or options.against):
        if options.json:
            print(store.json_text(_study_data(asked)).rstrip())
        else:
            print(_for_terminal(_study_text(asked), options.verbose))
        return 0
    if whole:
        asked.needs_loop()
    from slipctl.draw import show

    block = asked.block
    if options.json:
        from slipctl.draw.block_data import block_dict

        print(store.json_text(block_dict(block)).rstrip())
        return 0
    if options.against:
        print(show.difference(block, Request.read(options.against).block).rstrip())
        return 0
    if options.latex:
        print(show.latex(block).rstrip())
    if options.graph:
        print(show.graph(block).rstrip())
    if not (options.latex or options.graph):
        print(_for_terminal(show.text(block).rstrip(), options.verbose))
    return 0


FOLDED = {"Signals": ("  state ", "  output "), "Jacobian": ("",)}
"""Rows of a section that a terminal does not show where there are many of them."""

MANY = 24
"""Rows of a section from which on it is folded."""


def _for_terminal(text: str, everything: bool) -> str:
    """A text as a terminal shows it: lines wrapped, long sections folded unless asked for.

    What goes into a file or another program stays as it is.
    """
    if not (sys.stdout and sys.stdout.isatty()):
        return text
    width = shutil.get_terminal_size((100, 50)).columns
    out = []
    for section in text.split("\n\n"):
        head, *rows = section.split("\n")
        starts = FOLDED.get(head, ())
        hidden = [r for r in rows if starts and r.startswith(starts)]
        if everything or len(rows) <= MANY or not hidden:
            hidden = []
        shown = [head, *(r for r in rows if r not in hidden)]
        if hidden:
            shown.append(f"  {len(hidden)} more rows; slipctl show -v has them")
        out.append("\n".join(line for row in shown for line in _hung(row, width)))
    return "\n\n".join(out)


def _hung(row: str, width: int) -> list[str]:
    """A row over several lines; one of a table gives up its columns where it does not fit."""
    if len(row) <= width:
        return [row]
    lead = len(row) - len(row.lstrip())
    close = " " * lead + re.sub(r" {2,}", "  ", row.lstrip())
    return textwrap.wrap(close, width, subsequent_indent=" " * (lead + 8), drop_whitespace=True,
                         break_long_words=False, replace_whitespace=False)  # fmt: skip


def _study_data(asked: Request) -> dict[str, Any]:
    study = asked.study
    return {
        "name": study.name, "title": study.title, "source": study.source, "doc": study.doc,
        "scenarios": [
            {"name": c.scenario.name, "duration_s": c.scenario.duration, "seed": c.scenario.seed,
             "doc": c.scenario.doc, "loops": list(c.loops)}
            for c in asked.cases
        ],
        "models": list(study.models),
        "experiments": {k: e.title for k, e in study.experiments.items()},
        "claims": [{"id": c.id, "claim": c.claim, "source": c.source} for c in study.claims],
        "figures": {k: f.caption for k, f in study.figures.items()},
    }  # fmt: skip


def _study_text(asked: Request) -> str:
    study, cases, name = asked.study, asked.cases, asked.name
    rows = [f"{study.name}: {study.title}", f"  {study.source}", "", *_wrapped(study.doc, "  ", 96)]
    rows += ["", "scenarios and loops"]
    for case in cases:
        s = case.scenario
        rows.append(f"  {s.name:<20} {s.duration:g} s, seed {s.seed}: {', '.join(case.loops)}")
        rows += _wrapped(s.doc, " " * 23, 96) if s.doc else []
    models = {k: getattr(m, "name", getattr(m, "__name__", "")) for k, m in study.models.items()}
    for title, pairs in (
        ("models that --swap replaces", list(models.items())),
        ("experiments", [(k, e.title) for k, e in study.experiments.items()]),
        ("claims", [(c.id, f"{c.claim} ({c.source})") for c in study.claims]),
        ("figures", [(k, f.caption) for k, f in study.figures.items()]),
    ):  # fmt: skip
        if pairs:
            wide = max(len(key) for key, _ in pairs)
            rows += ["", title, *(f"  {key:<{wide}}  {text}" for key, text in pairs)]
    loop = next(iter(cases[0].loops))
    rows += ["", f"See slipctl show {name}:{loop}, slipctl run {name}"]
    return "\n".join(rows)


def _wrapped(text: str, indent: str, width: int) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), width, initial_indent=indent,
                         subsequent_indent=indent)  # fmt: skip
