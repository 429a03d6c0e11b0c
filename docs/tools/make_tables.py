"""Fill tables of the studies' pages: ``python docs/tools/make_tables.py [--check] [STUDY ...]``.

The numbers are those of ``docs/evidence/STUDY.json``, or with ``--results FOLDER`` those that
``slipctl run STUDY --full --out FOLDER`` wrote. Without a name every page is filled; ``--check``
only compares. A table stands between ``<!-- table KIND ... -->`` and ``<!-- end -->``: ``claims``;
``metrics SCENARIO METRIC ...``, a row per loop; ``experiment NAME TABLE``; ``times`` and
``adversary``, of verdicts; ``enclosures``; ``ends``; ``gradients``; ``attacked``; ``solver_times``;
``estimator_times``.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any, NoReturn

from slipctl.block.units.unit_algebra import display_scale
from slipctl.run.metrics import METRICS, Metric
from slipctl.study.report.texts import left_out, number, same_for_all, times

DOCS = Path(__file__).resolve().parents[1]
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
    """JSON file of a folder of results, or that part of a file of evidence."""
    if results.is_dir():
        return json.loads((results / name).read_text(encoding="utf-8"))
    numbers = json.loads(results.read_text(encoding="utf-8"))["numbers"]
    return numbers[name.removesuffix(".json")]


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
    units = {n: display_scale(m[n]["unit"]) for m in loops.values() for n in names if n in m}
    every = {
        loop: {n: Metric(m["value"], m["unit"], tuple(m.get("rows", ()))) for n, m in f.items()}
        for loop, f in loops.items()
    }
    rails = {n: " / ".join(m[n].rows) for m in every.values() for n in names if n in m}
    lists = {n: [times(m[n].value, 1.0) for m in every.values() if n in m] for n in names}
    names = [n for n in names if not lists[n] or not same_for_all(n, lists[n])]
    head = ["loop"]
    for n in names:
        unit = f" [{units[n][1]}]" if n in units and units[n][1] != "1" else ""
        head.append(n + unit + (f", {rails[n]}" if rails.get(n) else ""))
    rows = []
    for loop, found in loops.items():
        cells = []
        for n in names:
            cells.append("" if n not in found else shown(n, found[n]["value"], *units[n]))
        rows.append([f"`{loop}`", *cells])
    asked = {k: {n: m for n, m in f.items() if n in words} for k, f in every.items()}
    return rows_to_text(head, rows) + "".join(f"{text}.\n\n" for text in left_out(asked))


def shown(name: str, value: Any, factor: float, unit: str) -> str:
    """Value of a metric: ways to the centimetre, the numbers of all rails beside each other."""
    if unit == "m":
        return f"{value:.2f}"
    missing = "never" if METRICS[name].event else "–"
    cells = [missing if v is None else number(v, 3) for v in times(value, factor)]
    return " / ".join(cells)


def experiment(results: Path, words: list[str]) -> str:
    """Table of an experiment."""
    name, table = words
    columns = read(results, "tables.json")["experiments"][name][table]["columns"]
    units = [display_scale(v["unit"]) for v in columns.values()]
    head = [c if u in ("", "1") else f"{c} [{u}]"
            for c, (_, u) in zip(columns, units, strict=True)]  # fmt: skip
    cells = [times(v["values"], f)
             for v, (f, _) in zip(columns.values(), units, strict=True)]  # fmt: skip
    return rows_to_text(head, [[number(v) for v in row] for row in zip(*cells, strict=True)])


def verdict_times(results: Path, words: list[str]) -> str:
    """A row per system: CPU time of its verdicts, of the slowest kind of question, of a check."""
    rows = []
    systems = json.loads(results.read_text(encoding="utf-8"))["numbers"]
    for name, kinds in systems.items():
        slowest = max(kinds, key=lambda k: kinds[k]["worst"])
        many = sum(k["cases"] for k in kinds.values())
        middle = sorted(k["median"] for k in kinds.values() for _ in range(k["cases"]))[many // 2]
        check = max(k["worst_check"] for k in kinds.values())
        rows.append([f"`{name}`", str(many), str(len(kinds)), f"{middle:.3f}",
                     f"{kinds[slowest]['worst']:.2f}", slowest or "nothing more",
                     f"{check:.2f}"])  # fmt: skip
    head = ["system", "cases", "kinds of questions", "median [s]", "slowest [s]", "asked there",
            "slowest check [s]"]  # fmt: skip
    return rows_to_text(head, rows)


def adversary_cases(results: Path, words: list[str]) -> str:
    """A row per system: what became of its cases against the adversary."""
    found = json.loads((DOCS / "evidence" / "adversary.json").read_text(encoding="utf-8"))
    rows = [
        [f"`{name}`", *(str(n[k]) for k in ("cases", "certified", "refuted", "undecided")),
         str(len(n["false_certified"]) + len(n["false_refuted"]))]
        for name, n in found["numbers"].items()
    ]  # fmt: skip
    return rows_to_text(["system", "cases", "CERTIFIED", "REFUTED", "UNDECIDED", "false"], rows)


def enclosures(results: Path, words: list[str]) -> str:
    """A row per adhesion law: how wide its enclosures are beside what was sampled."""
    file = DOCS / "evidence" / "enclosures.json"
    found = json.loads(file.read_text(encoding="utf-8"))["numbers"]["enclosures"]
    rows = [
        [f"`{name}`", str(n["cases"] + 1), str(n["lost"]), f"{n['median width']:.2f}",
         f"{n['widest']:.2f}", f"{n['default ranges']:.2f}", ", ".join(n["ranges"])]
        for name, n in found.items()
    ]  # fmt: skip
    head = ["law", "cases", "lost", "median width", "widest", "default ranges", "these are"]
    return rows_to_text(head, rows)


def ends(results: Path, words: list[str]) -> str:
    """A row per certificate and number: how far it is proved, and from where a run refutes it."""
    found = json.loads((DOCS / "evidence" / "ends.json").read_text(encoding="utf-8"))["numbers"]
    rows = []
    for name, n in found.items():
        for of, e in n["ends"].items():
            sides = [number(1e3 * e[k], 3) if e[k] else "" for k in ("certified", "refuted")]
            if e["certified"] is not None:  # what holds at no value has no end
                rows.append([f"`{name}`", n["system"], of, number(1e3 * n["now"][of], 3), *sides])
    head = ["certificate", "asked as", "number", "in the loop [ms]", "proved up to [ms]",
            "refuted from [ms]"]  # fmt: skip
    return rows_to_text(head, rows)


def gradients(results: Path, words: list[str]) -> str:
    """A row per loop with slopes: free numbers, and how far differences are from the slopes."""
    found = json.loads(results.read_text(encoding="utf-8"))["numbers"]["gradients"]
    smooth = {k: n for k, n in found.items() if "why" not in n}
    metrics_ = list(dict.fromkeys(m for n in smooth.values() for m in n["apart"]))
    rows = [
        [f"`{k}`", ", ".join(n["numbers"]), *(f"{n['apart'][m]:.1e}" for m in metrics_)]
        for k, n in smooth.items()
    ]
    return rows_to_text(["loop", "free", *metrics_], rows)


def attacked(results: Path, words: list[str]) -> str:
    """A row per promise of a tuned loop: what became of it under attack."""
    file = DOCS / "evidence" / "attacked.json"
    found = json.loads(file.read_text(encoding="utf-8"))["numbers"]
    rows = []
    for line, promises in found.items():
        short = re.sub(r"^slipctl tune | --(samples|runs|held-out|ensemble) \S+", "", line)
        for name, p in promises.items():
            told = [str(p["searched"]), number(p["worst"], 3)] if "worst" in p else ["", ""]
            many = [str(p["copies"]), str(p["broken"])]
            rows.append([f"`{short}`", name, p["system"], *many, *told])
    head = ["tuned", "promise", "asked as", "starts", "broken", "runs of the search",
            "largest share of the bound"]  # fmt: skip
    return rows_to_text(head, rows)


def searches(results: Path, words: list[str]) -> str:
    """A row per loop that was tuned: what it took, and what it brought on held-out draws."""
    found = json.loads((DOCS / "evidence" / "tuning.json").read_text(encoding="utf-8"))["numbers"]
    rows = [
        [f"`{name}`", str(n["numbers"]), str(n["runs"]), number(n["cpu_s"], 3),
         number(n["wanted_s"], 3), number(1e3 * n["tuned_minus_by_hand_m"], 3),
         number(1e3 * n["standard_error_m"], 2)]
        for name, n in found.items()
    ]  # fmt: skip
    head = ["loop", "free numbers", "runs of the search", "processor time [s]", "wanted [s]",
            "distance, tuned minus by hand [mm]", "standard error [mm]"]  # fmt: skip
    return rows_to_text(head, rows)


def solver_times(results: Path, words: list[str]) -> str:
    """A row per problem and solver: time of a tick, how often ours, how it ran, bytes of C."""
    file = DOCS / "evidence" / "predictive_c.json"
    found = json.loads(file.read_text(encoding="utf-8"))["numbers"]["predictive_solvers"]["rows"]
    ours = {r["problem"]: r["tick_s"] for r in found if r["solver"] == "one iteration"}
    rows = []
    for r in found:
        took = r["tick_s"]
        text = [f"{r[f'text, {real}'] / 1e3:.1f}" if f"text, {real}" in r else "–"
                for real in ("double", "float")]  # fmt: skip
        took_text = ["–", "–"]
        if took is not None:
            took_text = [f"{1e6 * took:.3g}", f"{took / ours[r['problem']]:.3g}"]
        rows.append([r["problem"], r["solver"], *took_text, r["how"], *text])
    head = ["problem", "solver", "a tick [us]", "times ours", "how it ran", "C [kB], double",
            "C [kB], float"]  # fmt: skip
    return rows_to_text(head, rows)


ESTIMATORS = {"ctukf": "filter ctukf", "ekf": "filter ekf", "mhe": "window"}
"""Estimators of the study ``predictive``, and their rows in ``predictive_c``."""


def estimator_times(results: Path, words: list[str]) -> str:
    """A row per estimator: time of a tick on the host, instructions and text on a Cortex-M4."""
    file = DOCS / "evidence" / "predictive_c.json"
    found = json.loads(file.read_text(encoding="utf-8"))["numbers"]["predictive_c"]["numbers"]
    rows = []
    for name, place in ESTIMATORS.items():
        double, single = (found[f"{place}, {real}"] for real in ("double", "float"))
        took = [f"{1e6 * r['host']['tick_s']:.3g}" for r in (double, single)]
        m4 = single["cortex-m4"]
        rows.append([name, *took, f"{m4['mean']:.0f}", str(m4["most"]), str(m4["text"])])
    head = ["estimator", "a tick [us], double", "float", "M4 float, instructions, mean", "most",
            "text [bytes]"]  # fmt: skip
    return rows_to_text(head, rows)


MAKERS = {"claims": claims, "metrics": metrics, "experiment": experiment, "times": verdict_times,
          "adversary": adversary_cases, "enclosures": enclosures,
          "ends": ends, "gradients": gradients, "attacked": attacked,
          "searches": searches, "solver_times": solver_times,
          "estimator_times": estimator_times}  # fmt: skip


class Arguments(argparse.ArgumentParser):
    """Arguments, of which a wrong one is refused in a line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"make_tables.py: {message}\n")


def pages() -> list[str]:
    """Studies with a page and with evidence."""
    return [p.stem for p in sorted((DOCS / "evidence").glob("*.json"))
            if (DOCS / f"{p.stem}.md").exists()]  # fmt: skip


def main(arguments: list[str]) -> int:
    """Fill the pages, or say whether they are up to date."""
    parser = Arguments(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("studies", nargs="*", metavar="STUDY", help="all that have evidence")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="of one study's run")
    parser.add_argument("--check", action="store_true", help="compare only")
    given = parser.parse_args(arguments)
    unknown = [n for n in given.studies if not (DOCS / f"{n}.md").exists()]
    if unknown:
        parser.error(f"{unknown[0]} has no page; {', '.join(pages())} have one")
    if given.results and len(given.studies) != 1:
        parser.error("--results goes with the name of one study")
    old = 0
    for name in given.studies or pages():
        page, results = DOCS / f"{name}.md", given.results or DOCS / f"evidence/{name}.json"
        text = page.read_text(encoding="utf-8")
        try:
            new = filled(text, results)
        except OSError as error:
            parser.error(f"cannot read {error.filename}: {error.strerror}")
        except KeyError as missing:
            parser.error(f"{results} has no {missing}, which docs/{name}.md shows; run it --full")
        if not given.check:
            page.write_text(new, encoding="utf-8", newline="\n")
        elif new != text:
            print(f"docs/{name}.md is out of date; run: python docs/tools/make_tables.py {name}")
            old = 1
        else:
            print(f"docs/{name}.md is up to date")
    return old


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
