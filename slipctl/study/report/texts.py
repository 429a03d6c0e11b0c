"""Numbers and tables as text, for the terminal and for the report."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.run.metrics import BETTER, METRICS, NEEDS, Metric
from slipctl.run.results import Results
from slipctl.run.warnings.wheels import FIRST
from slipctl.study.case_setup import warnings_before_run
from slipctl.study.declaration import (
    CHANGED,
    FAILED,
    NEEDS_FULL,
    NOT_RUN,
    OPEN,
    REPRODUCED,
    Claim,
    Verdict,
)


def number(value: Any, digits: int = 4) -> str:
    """Write a value for a reader: four digits, lists with slashes, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        digits = telling_digits(list(value.values()), digits)
        return ", ".join(f"{k} {number(v, digits)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return " / ".join(number(v, digits) for v in value)
    if isinstance(value, (int, np.integer)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        if not math.isfinite(value):
            return "–"
        mantissa, e, exponent = f"{value or 0.0:.{digits}g}".partition("e")  # no -0
        if e and 0 <= int(exponent) <= 6:
            return f"{value:.0f}"
        return f"{mantissa}e{int(exponent)}" if e else mantissa
    return str(value)


def telling_digits(values: Sequence[Any], digits: int) -> int:
    """Digits, 9 at most, with which values that differ look different: an order can be seen."""
    plain = {v for v in values if isinstance(v, float) and math.isfinite(v)}
    while digits < 9 and len({number(v, digits) for v in plain}) < len(plain):
        digits += 1
    return digits


def with_unit(value: Any, unit: str) -> str:
    """Write a value and its unit."""
    plain = isinstance(value, (int, float, list)) and not isinstance(value, bool)
    return f"{number(value)} {unit}" if plain and unit != "1" else number(value)


def answers(v: Verdict) -> tuple[str, str]:
    """Paper's answer and ours, with units, as a reader wants them."""
    c = v.claim
    paper = f"{c.bound} {c.paper}".strip() if isinstance(c.paper, str) else ""
    if not paper:
        paper = f"{c.bound} {number(c.paper, 6)}".strip()
    if c.kind == "number" and c.unit != "1" and c.paper is not None:
        paper += f" {c.unit}"
    ours = with_unit(v.ours, c.unit)
    if isinstance(v.ours, Mapping) and c.unit != "1":
        ours += f" {c.unit}"
    return paper, ours


def tolerance_text(c: Claim) -> str:
    """Why the tolerance is what it is."""
    usual = {"last digit": "half a unit of the last printed digit", None: ""}
    return c.tolerance_why or usual.get(c.tolerance, str(c.tolerance))  # type: ignore[arg-type]


def verdicts_of_run(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Verdicts that this run gives: those of claims that are not left out of it."""
    return [v for v in verdicts if not v.left]


def count(verdicts: Sequence[Verdict]) -> str:
    """How many claims have which verdict, and how many are left out of this run."""
    tally = {
        k: sum(v.verdict == k for v in verdicts_of_run(verdicts))
        for k in (REPRODUCED, FAILED, OPEN)
    }
    said = [", ".join(f"{n} {k}" for k, n in tally.items() if n)]
    left = {
        NEEDS_FULL: "--full would judge {} more",
        NOT_RUN: "{} left out, because they speak of what was not run",
        CHANGED: "{} left out, because they speak of what was changed",
    }
    for why, text in left.items():
        number_ = sum(v.left == why for v in verdicts)
        said += [text.format(number_)] if number_ else []
    return "; ".join(filter(None, said))


def left_to_full(results: Results) -> str:
    """Line that names the scenarios and experiments that were left to ``--full``."""
    if not results.left:
        return ""
    known = results.study.experiments
    groups = {
        "scenarios": [n for n in results.left if n not in known],
        "experiments": [n for n in known if n in results.left],
    }
    said = (f"{what} {', '.join(names)}" for what, names in groups.items() if names)
    return f"Left to --full: {'; '.join(said)}"


def changes(results: Results) -> str:
    """Say what was swapped and set, so that nobody takes the results for those of the study."""
    if not results.changed:
        return ""
    claims = "; claims are of the paper's model" if results.study.claims else ""
    return f"with {results.changed}{claims}"


def claim_table(verdicts: Sequence[Verdict], width: int = 132) -> str:
    """Table *claim / paper / ours / verdict and why*."""
    rows = [["claim", "paper", "ours", "verdict and why"]]
    for v in verdicts_of_run(verdicts):
        paper, ours = answers(v)
        rows.append([v.claim.claim, paper, ours, f"{v.verdict}{': ' if v.why else ''}{v.why}"])
    room = max(width - 6, 74)
    wide = [room * 36 // 100, room * 16 // 100, room * 16 // 100]
    wide = [min(w, max(len(r[k]) for r in rows)) for k, w in enumerate(wide)]
    return (
        wrap_table(rows, [*wide, room - sum(wide)])
        + f"\n\n{len(verdicts)} claims: {count(verdicts)}"
    )


def wrap_table(rows: Sequence[Sequence[str]], widths: Sequence[int]) -> str:
    """Table whose cells are wrapped to the widths; the first row is its head."""
    out = []
    for k, row in enumerate(rows):
        cells = [textwrap.wrap(c, w) or [""] for c, w in zip(row, widths, strict=True)]
        for line in range(max(map(len, cells))):
            parts = [c[line] if line < len(c) else "" for c in cells]
            padded = (p.ljust(w) for p, w in zip(parts, widths, strict=True))
            out.append("  ".join(padded).rstrip())
        if k == 0:
            out.append("  ".join("-" * w for w in widths))
    return "\n".join(out)


def metric_rows(results: Results, scenario: str) -> list[list[str]]:
    """Table of one scenario: a metric per row, a loop per column, the head first."""
    return [cells for cells, _ in ranked_rows(results, scenario)]


def ranked_rows(results: Results, scenario: str) -> list[tuple[list[str], list[int]]]:
    """The same rows, each with the columns that hold its best number.

    The bound, ``ideal``, is no competitor. No column is the best where all say the same, and
    where a metric has no better end.
    """
    loops = results.metrics[scenario]
    above = values_beyond_limit(results, scenario)
    rows: list[tuple[list[str], list[int]]] = [(["metric", *loops], [])]
    for name in METRICS:
        found = {loop: m[name] for loop, m in loops.items() if name in m}
        if not found:
            continue
        factor, unit = display_scale(next(iter(found.values())).unit)
        digits = 6 if unit == "m" else 4  # ways differ in their centimetres
        lists = {k: times(m.value, factor) for k, m in found.items()}
        label = name if unit == "1" else f"{name} [{unit}]"
        named = max((m.rows for m in found.values()), key=len)
        same = equal_settling(
            name, list(lists.values()), name in getattr(results.study, "limits", {})
        )
        shown = [k for k in range(max(map(len, lists.values()))) if k not in same]
        for k in shown:  # a list goes down, an entry per row
            cells = [
                number(v[k], digits) + MARK * (k in above[loop].get(name, ()))
                if k < len(v := lists.get(loop, [])) else "" for loop in loops
            ]  # fmt: skip
            rail = f", {named[k]}" if k < len(named) else ""
            told = f"{label}{rail}" if k == shown[0] or rail else ""
            values = {
                column: v[k] for column, loop in enumerate(loops, 1)
                if k < len(v := lists.get(loop, [])) and not loop.startswith("ideal")
            }  # fmt: skip
            rows.append(([told, *cells], _best(name, values, digits)))
    return rows


def _best(name: str, values: Mapping[int, Any], digits: int) -> list[int]:
    """Columns whose number, as it is shown, is at the better end."""
    known = {k: v for k, v in values.items() if v is not None}
    if name not in BETTER or not known or len(values) < 2:
        return []
    end = (min if BETTER[name] == "low" else max)(known.values())
    best = [k for k, v in known.items() if number(v, digits) == number(end, digits)]
    return best if len(best) < len(values) else []


MARK = " !"
"""After a number that is above a limit of the study."""


def values_beyond_limit(results: Results, scenario: str) -> dict[str, dict[str, list[int]]]:
    """By loop and metric, which of its values are above the study's limit; none at all is, too."""
    found: dict[str, dict[str, list[int]]] = {}
    for loop, metrics in results.metrics[scenario].items():
        found[loop] = {}
        for name, limit in results.study.limits.items():
            values = times(metrics[name].value, 1.0) if name in metrics else []
            above = [k for k, v in enumerate(values) if v is None or v > limit]
            if above or not values:
                found[loop][name] = above
    return found


def limits_broken(results: Results, scenario: str) -> list[str]:
    """A line for each loop that is above a limit, with its numbers."""
    lines = []
    for loop, names in values_beyond_limit(results, scenario).items():
        said = []
        for name, above in names.items():
            limit, metric = results.study.limits[name], results.metrics[scenario][loop].get(name)
            if metric is None:
                said.append(f"it has no {name}, which may be {number(limit)} at most")
                continue
            worst = max((v for v in (times(metric.value, 1.0)[k] for k in above) if v is not None),
                        default=None)  # fmt: skip
            told = "for ever" if worst is None else with_unit(worst, metric.unit)
            said.append(f"{name} {told}, at most {with_unit(limit, metric.unit)}")
        if said:
            lines.append(f"! {loop} is above its limits: {'; '.join(said)}")
    return lines


def times(value: Any, factor: float) -> list[Any]:
    """Numbers of a metric as a list, each times ``factor``."""
    found = value if isinstance(value, list) else [value]
    return [v if v is None or factor == 1.0 else factor * v for v in found]


ALIKE = {0: "0 for every loop, none leaves the band", None: "no loop comes into the band to stay"}
"""Settling times that tell no loop from another, and what is said in their place."""


def equal_settling(
    name: str, lists: Sequence[Sequence[Any]], limited: bool = False
) -> dict[int, Any]:
    """Rails on which a settling time is 0 for every loop, or none settles: which of the two.

    Where it has a limit, that none settles is shown, and marked.
    """
    if name not in ("settling_time", "tracking_time"):
        return {}
    rails = [[v[k] for v in lists if k < len(v)] for k in range(max(map(len, lists), default=0))]
    told = [0] if limited else list(ALIKE)
    return {k: v[0] for k, v in enumerate(rails) if v[0] in told and len(set(v)) == 1}


def left_out(loops: Mapping[str, Mapping[str, Metric]], limits: Container[str] = ()) -> list[str]:
    """A line for settling times that are not shown, with the reason; ``limits``: those with one."""
    lines = []
    for name in ("settling_time", "tracking_time"):
        found = [m[name] for m in loops.values() if name in m]
        if not found:
            continue
        same = equal_settling(name, [times(m.value, 1.0) for m in found], name in limits)
        named = max((m.rows for m in found), key=len)
        for value, why in ALIKE.items():
            rails = [k for k, v in same.items() if v == value]
            if rails:
                where = ", ".join(named[k] if k < len(named) else f"rail {k + 1}" for k in rails)
                lines.append(f"{name} on {where}: {why}, so it is not shown")
    return lines


def absent(results: Results, scenario: str) -> list[str]:
    """A line for metrics that some loops have and others have not, with the reason.

    A stopping distance that no loop has is told where it has a limit.
    """
    by_reason: dict[tuple[str, str], list[str]] = {}
    loops, signals = results.metrics[scenario], results.study.signals
    limits = getattr(results.study, "limits", {})
    for name, needs in NEEDS.items():
        if not any(name in m for m in loops.values()) and name not in limits:
            continue
        reasons: dict[str, list[str]] = {}
        for loop in (n for n, m in loops.items() if name not in m):
            log = results.data[scenario][loop]
            missing = [r.replace("_", " ") for r in needs if signals.find(r, log) is None]
            why = f"no {' and no '.join(missing)}" if missing else ""
            if not why and name == "stopping_distance":
                why = "no standstill"
            if why:
                reasons.setdefault(why, []).append(loop)
        for why, names in reasons.items():
            by_reason.setdefault((", ".join(names), why), []).append(name)
    return [f"{', '.join(names)} of {of}: left out, there is {why}"
            for (of, why), names in by_reason.items()]  # fmt: skip


def doubts(results: Results) -> list[tuple[str, str]]:
    """What gives reason to doubt the runs, each line with the runs that it is about."""
    by_line: dict[str, dict[str, list[str]]] = {}
    for case in results.cases:
        scenario = case.scenario.name
        for name, loop in case.loops.items():
            log = results.data.get(scenario, {}).get(name)
            late = str(log.attrs.get("told", "")) if log is not None else ""
            for line in [
                *filter(None, late.split("\n")),
                *warnings_before_run(loop, case.scenario),
            ]:
                by_line.setdefault(line, {}).setdefault(scenario, []).append(name)
    return [
        (line, "; ".join(f"{s}: {', '.join(names)}" for s, names in runs.items()))
        for line, runs in sorted(by_line.items(), key=lambda item: not item[0].startswith(FIRST))
    ]


def metric_table(results: Results, scenario: str, width: int = 132) -> str:
    """Metrics of one scenario as text; loops that do not fit beside the others go below them."""
    rows = metric_rows(results, scenario)
    wide = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
    lines, limits = [f"scenario {scenario}"], getattr(results.study, "limits", {})
    for group in side_by_side(wide, width - 2):
        shown = [r for r in rows if any(r[k] for k in group)]
        for row in shown:
            cells = [row[0].ljust(wide[0]), *(row[k].rjust(wide[k]) for k in group)]
            lines.append("  " + "  ".join(cells).rstrip())
        lines.append("")
    for text in [*limits_broken(results, scenario), *left_out(results.metrics[scenario], limits),
                 *absent(results, scenario)]:  # fmt: skip
        lines[-1:] = [*textwrap.wrap(text, width - 2, initial_indent="  ",
                                     subsequent_indent="  "), ""]  # fmt: skip
    return "\n".join(lines[:-1])


def side_by_side(wide: Sequence[int], width: int) -> list[list[int]]:
    """Columns in groups that fit, with the first one before each, into a width of characters."""
    groups: list[list[int]] = [[]]
    for k in range(1, len(wide)):
        taken = wide[0] + sum(2 + wide[j] for j in [*groups[-1], k])
        if groups[-1] and taken > width:
            groups.append([])
        groups[-1].append(k)
    return groups
