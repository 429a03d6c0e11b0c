"""Write pages of commands, metrics and keys: ``python docs/tools/make_reference.py [--check]``."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

from made import made

os.environ["COLUMNS"] = "88"  # the width of every help

DOCS = Path(__file__).parents[1]


def commands() -> str:
    """Help of each command, as the terminal shows it."""
    from slipctl.commands.arguments import parser

    top = parser()
    choices = next(a.choices for a in top._actions if isinstance(a, argparse._SubParsersAction))
    parts = [
        "# Commands\n",
        "Made from `slipctl COMMAND --help` by `python docs/tools/make_reference.py`. Exit codes: 0"
        " finished,\nwhatever the verdicts; 1 a run failed; 2 bad input, told in one line; 130"
        " stopped by Ctrl-C.\n\nWith `pip install 'slipctl[completion]'` bash completes commands"
        ' and options, after\n`eval "$(register-python-argcomplete slipctl)"`.\n',
    ]
    for name, command in choices.items():
        text = "\n".join(line.rstrip() for line in command.format_help().splitlines())
        parts.append(f"## slipctl {name}\n\n```text\n{text}\n```\n")
    return "\n".join(parts)


def metrics() -> str:
    """Each metric with its units and its meaning."""
    from slipctl.run.metrics import METRICS

    units = _units()
    rows = []
    for name, text in ((n, d.meaning) for n, d in METRICS.items()):
        unit = " or ".join(units.get(name, [])) or "see the run"
        meaning = text.replace("|", r"\|")
        rows.append(f"| `{name}` | {unit} | {meaning} |")
    head = (
        "# Metrics\n\nMade from the code by `python docs/tools/make_reference.py`. A metric that"
        " has no meaning for a run is left out.\nOne with several values says which rail each is"
        " of. Units are those that the studies have.\n\n"
        "| metric | unit | meaning |\n|---|---|---|\n"
    )
    return head + "\n".join(rows) + "\n"


KEYS_HEAD = """# All keys of a vehicle's file

Made from the declaration by `python docs/tools/make_reference.py`; `slipctl list kinds` prints the
same, and `slipctl schema` gives it to an editor. How the tables work together is told in
[your own vehicle](own_vehicle.md). A number that has a unit is written with one, any of its kind:
`"60 ms"`. Gains of the laws stand as they are on the metro car of `slipctl new metro`.
"""


def file_keys() -> str:
    """Each table of a vehicle's file with its keys: meaning, unit, default, range."""
    from slipctl.commands.library.contents import kinds
    from slipctl.models.vehicle.parts import Trip
    from slipctl.study.files.declared_parts import keys_of

    top = {"name": "", "doc": "What stands at the top of the file.",
           "keys": [vars(k) for k in keys_of(Trip) if k.default != "as below"]}  # fmt: skip
    parts = [KEYS_HEAD]
    for row in (top, *kinds()):
        head = _heading(row) if row["name"] else "Top"
        parts.append(f"## {head}\n\n{row['doc'].replace('``', '`')}\n")
        keys = [*row["keys"], *row.get("gains", ())]
        if keys:
            columns = ("meaning", "unit", "default", "range")
            lines = [f"| `{k['name']}` | {' | '.join(k[c] for c in columns)} |" for k in keys]
            top_ = ["| key | meaning | unit | default | range |", "|---|---|---|---|---|"]
            parts.append("\n".join([*top_, *lines]) + "\n")
    return "\n".join(parts)


def _heading(row: dict[str, Any]) -> str:
    """Table of a row as a file writes it, with its kind where it has several."""
    table = row["name"].removesuffix(f".{row['kind']}") if row["kind"] else row["name"]
    brackets = "[[{}]]" if row["many"] else "[{}]"
    return f"`{brackets.format(table)}`" + (f', `kind = "{row["kind"]}"`' if row["kind"] else "")


def _units() -> dict[str, list[str]]:
    """Units of each metric in the evidence of the studies."""
    found: dict[str, set[str]] = {}

    def walk(node: Any) -> None:
        if isinstance(node, dict):
            for name, value in node.items():
                if isinstance(value, dict) and {"value", "unit"} <= set(value):
                    found.setdefault(name, set()).add(value["unit"])
                else:
                    walk(value)

    for file in sorted((DOCS / "evidence").glob("*.json")):
        walk(json.loads(file.read_text(encoding="utf-8"))["numbers"].get("metrics", {}))
    return {name: sorted(units) for name, units in found.items()}


if __name__ == "__main__":
    sys.exit(
        made(DOCS / "commands.md", commands())
        | made(DOCS / "metrics.md", metrics())
        | made(DOCS / "file_keys.md", file_keys())
    )
