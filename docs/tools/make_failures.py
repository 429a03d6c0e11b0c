"""The tables of failures.md: ``python docs/tools/make_failures.py [--check]``.

What a controller does follows from its model: the file that ``slipctl new metro`` writes. What
that comes to is in evidence/vehicle_faults.json: ``python -m bench.faults metro.toml --c``.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from made import made

from slipctl.block.text.failures import FAILURE_HEAD, failures_of
from slipctl.models.vehicle import trip as trips
from slipctl.study.files.trip_files import load_trip

HERE = Path(__file__).resolve().parents[1]
PAGE, EVIDENCE = HERE / "failures.md", HERE / "evidence" / "vehicle_faults.json"
FILE = HERE.parent / "models" / "vehicle" / "files" / "metro.toml"


def text_table(head: list[str], rows: list[list[str]]) -> str:
    """Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(r) + " |\n" for r in lines)


def modes() -> str:
    """A table for each set of controllers that does the same."""
    trip = load_trip(str(FILE))
    by_rows: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    for name, part in trip.controllers.items():
        by_rows.setdefault(tuple(failures_of(trips.vehicle_control(trip, part))), []).append(name)
    out = []
    for rows, names in by_rows.items():
        said = ", ".join(f"`{n}`" for n in names)
        if not rows:
            out.append(f"{said}: takes the demand as it is, and reads no sensor.\n")
        else:
            out.append(f"{said}:\n\n{text_table([*FAILURE_HEAD], [[*r] for r in rows])}")
    return "\n".join(out)


def campaign(rows: list[dict[str, Any]]) -> str:
    """A table for each situation: a row for each fault, the controllers beside each other."""
    names = list(dict.fromkeys(r["controller"] for r in rows))
    out = []
    for situation in dict.fromkeys(r["situation"] for r in rows):
        of = {(r["controller"], r["fault"]): r for r in rows if r["situation"] == situation}
        faults = dict.fromkeys(fault for _, fault in of)
        lines = [[fault, *(_cell(of.get((n, fault)), of[n, "none"]) for n in names)]
                 for fault in faults]  # fmt: skip
        out.append(f"{situation.capitalize()}:\n\n{text_table(['fault', *names], lines)}")
    return "\n".join(out)


def _cell(row: dict[str, Any] | None, base: dict[str, Any]) -> str:
    """Distance, wrong release, lock, delay of the demand: what there is of them."""
    if row is None:
        return ""
    said = []
    if row["stop"] is not None:
        said.append(f"{row['stop']:.1f} m")
    if row["released"] > 0.02:
        said.append(f"released {row['released']:.2f} s")
    if row["locked"] > base["locked"] + 0.1:
        said.append(f"locked {row['locked']:.1f} s")
    if row["stop"] is None or row["late"] > 0.1:
        said.append(f"demand within {1e3 * row['late']:.0f} ms")
    return ", ".join([*said, *(["latched"] if row["latched"] else [])])


def page() -> str:
    """The page with its tables made anew."""
    rows = json.loads(EVIDENCE.read_text(encoding="utf-8"))["numbers"]["vehicle_faults"]["rows"]
    text = PAGE.read_text(encoding="utf-8")
    for name, table in (("modes", modes()), ("campaign", campaign(rows))):
        marks = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.S)
        text, many = marks.subn(lambda m, t=table: f"{m[1]}\n{t}\n{m[2]}", text)
        assert many == 1, f"docs/{PAGE.name} has no table {name}"
    return text


if __name__ == "__main__":
    sys.exit(made(PAGE, page()))
