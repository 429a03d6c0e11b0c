"""Fill the tables of a study's page from its results: ``python docs/make_tables.py PAGE RESULTS``.

A table stands between ``<!-- table KIND ... -->`` and ``<!-- end -->``:
``claims``; ``metrics SCENARIO METRIC ...``, a row per loop; ``experiment NAME TABLE``.
``--check`` only compares.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from slipctl.study.texts import number

TABLE = re.compile(r"(<!-- table (.+?) -->\n).*?(<!-- end -->)", re.S)


def filled(text: str, results: Path, kinds: tuple[str, ...] = ()) -> str:
    """Page with its tables (only those of some kinds, if given) made anew."""

    def replace(match: re.Match[str]) -> str:
        kind, *words = match[2].split()
        if kinds and kind not in kinds:
            return match[0]
        return match[1] + MAKERS[kind](results, words) + match[3]

    return TABLE.sub(replace, text)


def rows_to_text(head: list[str], rows: list[list[str]]) -> str:
    """Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n" + "".join("| " + " | ".join(r) + " |\n" for r in lines) + "\n"


def read(results: Path, name: str) -> Any:
    """JSON file of the results."""
    return json.loads((results / name).read_text(encoding="utf-8"))


def claims(results: Path, words: list[str]) -> str:
    """Claim, the paper's answer, ours, verdict and why."""
    rows = []
    for c in read(results, "claims.json")["claims"]:
        unit = "" if c["unit"] == "1" or c["kind"] == "yes/no" else f" {c['unit']}"
        paper = f"{c['bound'] or ''} {number(c['paper'])}".strip()
        paper += unit if c["kind"] == "number" else ""
        ours = number(c["ours"]) + ("" if c["ours"] is None else unit)
        rows.append([f"{c['claim']} ({c['source']})", paper, ours, c["verdict"], c["why"]])
    return rows_to_text(["claim", "paper", "ours", "verdict", "why"], rows)


def metrics(results: Path, words: list[str]) -> str:
    """A row per loop of a scenario, a column per metric."""
    scenario, *names = words
    loops = read(results, "metrics.json")["scenarios"][scenario]
    units = {n: m[n]["unit"] for m in loops.values() for n in names if n in m}
    rails = {n: " / ".join(m[n].get("rows", ())) for m in loops.values() for n in names if n in m}
    head = ["loop"]
    for n in names:
        unit = f" [{units[n]}]" if units[n] != "1" else ""
        head.append(n + unit + (f", {rails[n]}" if rails.get(n) else ""))
    rows = []
    for loop, found in loops.items():
        cells = []
        for n in names:
            cells.append(shown(found[n]["value"], units[n]) if n in found else "")
        rows.append([f"`{loop}`", *cells])
    return rows_to_text(head, rows)


def shown(value: Any, unit: str) -> str:
    """Value of a metric: ways to the centimetre, large numbers by their power of ten."""
    if unit == "m":
        return f"{value:.2f}"
    return f"{value:.2e}" if isinstance(value, float) and value >= 1e5 else number(value, 3)


def experiment(results: Path, words: list[str]) -> str:
    """Table of an experiment."""
    name, table = words
    columns = read(results, "tables.json")["experiments"][name][table]["columns"]
    head = [c if v["unit"] in ("", "1") else f"{c} [{v['unit']}]" for c, v in columns.items()]
    values = zip(*(v["values"] for v in columns.values()), strict=True)
    return rows_to_text(head, [[number(v) for v in row] for row in values])


MAKERS = {"claims": claims, "metrics": metrics, "experiment": experiment}


def main(arguments: list[str]) -> int:
    """Fill the page, or say whether it is up to date."""
    page, results = (Path(a) for a in arguments if not a.startswith("--"))
    text = page.read_text(encoding="utf-8")
    new = filled(text, results)
    if "--check" in arguments:
        print(f"{page} is up to date" if new == text else f"run: make_tables.py {page} {results}")
        return int(new != text)
    page.write_text(new, encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
