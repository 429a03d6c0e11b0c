"""Numbers and tables as text, for the terminal and for the report."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.run.metrics import METRICS, Metric
from slipctl.run.results import Results
from slipctl.study.declaration import FAILED, OPEN, REPRODUCED, Claim
from slipctl.study.verdicts import CHANGED, NEEDS_FULL, NOT_RUN, Verdict

DUST = 1e-30
"""Size below which a number is zero for a reader."""


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
        if abs(float(value)) < DUST:
            return "0"
        mantissa, e, exponent = f"{value or 0.0:.{digits}g}".partition("e")  # no -0
        if e and 0 <= int(exponent) <= 6:
            return f"{value:.0f}"
        return f"{mantissa}e{int(exponent)}" if e else mantissa
    return str(value)


def number_or_never(value: float | None, digits: int = 4) -> str:
    """Write a number of an event: *never* where it is infinite."""
    return "never" if value is not None and math.isinf(value) else number(value, digits)


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


def claim_line(v: Verdict) -> str:
    """One claim with the paper's answer, ours and the verdict, as a sentence."""
    paper, ours = answers(v)
    if v.left:
        return f"Claim: {v.claim.claim}. Not judged: it {v.left}."
    why = f": {v.why}" if v.why else ""
    return f"Claim: {v.claim.claim}. Paper {paper}, ours {ours}; {v.verdict}{why}."


def claim_table(verdicts: Sequence[Verdict], width: int = 132) -> str:
    """Table *claim / paper / ours / verdict and why*."""
    rows = [["claim", "paper", "ours", "verdict and why"]]
    for v in verdicts_of_run(verdicts):
        paper, ours = answers(v)
        rows.append([v.claim.claim, paper, ours, f"{v.verdict}{': ' if v.why else ''}{v.why}"])
    room = max(width - 6, 74)
    wide = [room * 36 // 100, room * 16 // 100, room * 16 // 100]
    wide = list(map(min, wide, widths_of(rows)))
    table = wrap_table(rows, [*wide, room - sum(wide)])
    return f"{table}\n\n{len(verdicts)} claims: {count(verdicts)}"


def widths_of(rows: Sequence[Sequence[str]]) -> list[int]:
    """Width of each column, in characters."""
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


def wrap_table(rows: Sequence[Sequence[str]], widths: Sequence[int] | None = None) -> str:
    """Table whose cells are wrapped to the widths, if any; the first row is its head."""
    out, widths = [], widths or widths_of(rows)
    for k, row in enumerate(rows):
        cells = [textwrap.wrap(c, w) or [""] for c, w in zip(row, widths, strict=True)]
        for line in range(max(map(len, cells))):
            parts = [c[line] if line < len(c) else "" for c in cells]
            padded = (p.ljust(w) for p, w in zip(parts, widths, strict=True))
            out.append("  ".join(padded).rstrip())
        if k == 0:
            out.append("  ".join("-" * w for w in widths))
    return "\n".join(out)


def ranked_rows(results: Results, scenario: str) -> list[tuple[list[str], list[int]]]:
    """Table of one scenario: a metric per row, a loop per column, the head first.

    With each row go the columns that hold its best number. The bound, ``ideal``, is no competitor.
    No column is the best where all say the same, and where a metric has no better end.
    """
    loops, limits = results.metrics[scenario], getattr(results.study, "limits", {})
    above, failed = values_beyond_limit(results, scenario), failed_loops(results, scenario)
    rows: list[tuple[list[str], list[int]]] = [(["metric", *loops], [])]
    for name, d in METRICS.items():
        found = {loop: m[name] for loop, m in loops.items() if name in m}
        if not found:
            continue
        factor, unit = display_scale(next(iter(found.values())).unit)
        digits = 6 if unit == "m" else 4  # ways differ in their centimetres
        lists = {k: times(m.value, factor) for k, m in found.items()}
        if name not in limits and same_for_all(name, list(lists.values())):
            continue
        cells = [
            _cell(lists[loop], digits, d.event, above[loop].get(name, ())) if loop in lists else ""
            for loop in loops
        ]
        competing = {
            column: lists[loop] for column, loop in enumerate(loops, 1)
            if loop in lists and not loop.startswith("ideal") and loop not in failed
        }  # fmt: skip
        many = max(map(len, lists.values()))
        best = [
            set(_best(name, {c: v[k] for c, v in competing.items() if k < len(v)}, digits))
            for k in range(many)
        ]
        label = name if unit == "1" else f"{name} [{unit}]"
        rows.append(([label, *cells], sorted(set.intersection(*best) if best else set())))
    return rows


def _cell(values: Sequence[Any], digits: int, event: bool, above: Sequence[int]) -> str:
    """Number of a loop, or those of all sections beside each other; marked above a limit."""
    told = (("never" if event else "–") if v is None else number(v, digits) for v in values)
    return " / ".join(text + MARK * (k in above) for k, text in enumerate(told))


def same_for_all(name: str, lists: Sequence[Sequence[Any]]) -> bool:
    """Whether an event tells no loop from another: none reached it, or all settled at once."""
    every = {v for values in lists for v in values}
    return METRICS[name].event and (every <= {None} or every <= {0})


def sections_line(results: Results, scenario: str) -> str:
    """What the numbers with slashes between belong to; empty where no metric has several."""
    every = [m.rows for metrics in results.metrics[scenario].values() for m in metrics.values()]
    rows = max(every, key=len, default=())
    where = " / ".join(rows)
    return f"Sections in order: {where}" if rows[1:] else ""


def failed_loops(results: Results, scenario: str) -> set[str]:
    """Loops that are no competitor: above a limit, or still moving where another one stopped."""
    loops = results.metrics[scenario]
    stops = {n: m["stopping_distance"].value for n, m in loops.items() if "stopping_distance" in m}
    stopped = any(v is not None for v in stops.values())
    still = {n for n, v in stops.items() if v is None and stopped}
    return still | {n for n, above in values_beyond_limit(results, scenario).items() if above}


def _best(name: str, values: Mapping[int, Any], digits: int) -> list[int]:
    """Columns whose number, as it is shown, is at the better end."""
    known = {k: v for k, v in values.items() if v is not None}
    better = METRICS[name].better
    if not better or not known or len(values) < 2 or max(map(abs, known.values())) < ROUNDING:
        return []
    end = (min if better == "low" else max)(known.values())
    best = [k for k, v in known.items() if number(v, digits) == number(end, digits)]
    return best if len(best) < len(values) else []


ROUNDING = 1e-12
"""Size below which numbers differ by rounding alone, so that none of them is the best."""

MARK = " !"
"""After a number that is above a limit of the study."""


def values_beyond_limit(results: Results, scenario: str) -> dict[str, dict[str, list[int]]]:
    """By loop and metric, which of its values are above the study's limit; none at all is, too."""
    found: dict[str, dict[str, list[int]]] = {}
    here = {name for metrics in results.metrics[scenario].values() for name in metrics}
    for loop, metrics in results.metrics[scenario].items():
        found[loop] = {}
        for name, limit in results.study.limits.items():
            if METRICS[name].bound and name not in here:
                continue  # this scenario has no other run to be measured against
            values = times(metrics[name].value, 1.0) if name in metrics else []
            above = [k for k, v in enumerate(values) if v is None or v > limit]
            if above or not values:
                found[loop][name] = above
    return found


def limits_broken(results: Results, scenario: str) -> list[str]:
    """A line for each loop that exceeds a limit, with its numbers."""
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
            told = "never" if worst is None else with_unit(worst, metric.unit)
            said.append(f"{name} {told}, at most {with_unit(limit, metric.unit)}")
        if said:
            lines.append(f"! loop {loop} exceeds its limits: {'; '.join(said)}")
    return lines


def times(value: Any, factor: float) -> list[Any]:
    """Numbers of a metric as a list, each times ``factor``."""
    found = value if isinstance(value, list) else [value]
    return [v if v is None or factor == 1.0 else factor * v for v in found]


def left_out(loops: Mapping[str, Mapping[str, Metric]], limits: Container[str] = ()) -> list[str]:
    """A line for events that are not shown, with the reason; ``limits``: those that have one."""
    lines = []
    for name, d in METRICS.items():
        lists = [times(m[name].value, 1.0) for m in loops.values() if name in m]
        if not d.event or not lists or name in limits or not same_for_all(name, lists):
            continue
        never = all(v is None for values in lists for v in values)
        if name == "stopping_distance":
            why = "no loop comes to a standstill"
        else:
            why = "no loop settles in the band" if never else "0 for every loop"
        lines.append(f"{name}: {why}, so it is not shown")
    return lines


def absent(results: Results, scenario: str) -> list[str]:
    """A line for metrics that some loops have and others have not, with the reason.

    A stopping distance that no loop has is told where it has a limit.
    """
    by_reason: dict[tuple[str, str], list[str]] = {}
    loops, signals = results.metrics[scenario], results.study.signals
    limits = getattr(results.study, "limits", {})
    for name, needs in ((n, d.needs) for n, d in METRICS.items() if d.needs):
        if not any(name in m for m in loops.values()) and name not in limits:
            continue
        reasons: dict[str, list[str]] = {}
        for loop in (n for n, m in loops.items() if name not in m):
            log = results.data[scenario][loop]
            missing = [r.replace("_", " ") for r in needs if signals.find(r, log) is None]
            why = f"no {' and no '.join(missing)}" if missing else ""
            if why:
                reasons.setdefault(why, []).append(loop)
        for why, names in reasons.items():
            by_reason.setdefault((", ".join(names), why), []).append(name)
    return [f"{', '.join(names)} of {of}: not shown, there is {why}"
            for (of, why), names in by_reason.items()]  # fmt: skip


def metric_table(results: Results, scenario: str, width: int = 132) -> str:
    """Metrics of one scenario as text; loops that do not fit beside the others go below them."""
    rows = [cells for cells, _ in ranked_rows(results, scenario)]
    wide = widths_of(rows)
    lines, limits = [f"scenario {scenario}"], getattr(results.study, "limits", {})
    for group in side_by_side(wide, width - 2):
        shown = [r for r in rows if any(r[k] for k in group)]
        for row in shown:
            cells = [row[0].ljust(wide[0]), *(row[k].rjust(wide[k]) for k in group)]
            lines.append("  " + "  ".join(cells).rstrip())
        lines.append("")
    said = [*limits_broken(results, scenario), sections_line(results, scenario),
            *left_out(results.metrics[scenario], limits), *absent(results, scenario)]  # fmt: skip
    for text in filter(None, said):
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
