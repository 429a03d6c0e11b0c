"""``slipctl compare``: runs and sweeps beside each other, what was changed first."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.errors import BadInput
from slipctl.run import store
from slipctl.run.metrics import METRICS
from slipctl.run.sweep import sweep_store
from slipctl.run.sweep.spread import quantiles
from slipctl.run.sweep.sweep_runs import open_sweep
from slipctl.study.report.texts import number, number_or_never, wrap_table

TOLD = ("study", "quick", "seed", "slipctl_version", "casadi_version", "numpy_version")
"""What a run says of itself that is compared, beside its parameters."""

SWEPT = {
    "loop": "loop", "scenario": "scenario", "set": "--set", "swapped": "--swap", "seed": "seed",
    "samples": "samples", "design": "design", "slipctl": "slipctl_version",
    "casadi": "casadi_version", "numpy": "numpy_version", "equations": "equations",
    "numbers": "numbers and inputs",
}  # fmt: skip
"""The same of a sweep, with the words for it."""

LISTED = 40
"""Most changed parameters that are listed."""


@dataclass
class Side:
    """A folder: what it says of itself, and its metrics by scenario and loop.

    Attributes:
        name: as it was typed.
        about: what it is, in words.
        parameters: value and unit by loop and name.
        metrics: values of each metric by ``scenario/loop``: one of a run, many of a sweep.
        units: unit by metric.
        state: what a run is that did not come to its end.
        draws: of a sweep, what each run was made with: its number, its numbers, its ensemble.
    """

    name: str
    about: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    metrics: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    state: str = ""
    draws: list[str] = field(default_factory=list)


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what was changed, then the metrics beside each other."""
    names = [n for given in options.folders for n in _inside(given)]
    if len(names) < 2:
        raise BadInput("compare takes two folders or more; write slipctl compare A B")
    sides = [read(name) for name in names]
    changed, tables = changes(sides), metric_rows(sides)
    if options.json:
        print(store.json_text({"format": store.FORMAT, "changed": changed, "metrics": tables}))
        return 0
    print(text(sides, changed, tables))
    return 0


def _inside(name: str) -> list[str]:
    """The sweeps in a folder of several loops, else the folder itself."""
    folder = Path(name)
    if (folder / sweep_store.FILE).is_file() or (folder / "metrics.json").is_file():
        return [name]
    found = sorted(folder.glob(f"*/{sweep_store.FILE}"), key=lambda p: p.stat().st_ctime_ns)
    return [str(p.parent) for p in found] or [name]


def read(name: str) -> Side:
    """Read a folder of ``slipctl run`` or of ``slipctl sweep``.

    Raises:
        BadInput: it is neither.
    """
    folder = Path(name)
    if (folder / sweep_store.FILE).is_file():
        return _sweep(name)
    if not (folder / "metrics.json").is_file():
        raise BadInput(f"{name} is no folder of slipctl run or slipctl sweep; it has no metrics")
    found = store.read_json(folder / "metrics.json")
    side = Side(name, state=str(found.get("state", "")))
    try:
        side.about = {k: _said(found[k]) for k in TOLD if k in found}
        side.parameters = {
            loop: {n: dict(zip(("value", "unit"), _quantity(n, p), strict=True))
                   for n, p in numbers.items()}
            for loop, numbers in found.get("parameters", {}).items()
        }  # fmt: skip
        for scenario, loops in found["scenarios"].items():
            for loop, metrics in loops.items():
                rows: dict[str, np.ndarray] = {}
                for metric, m in metrics.items():
                    _put(side, rows, metric, *_quantity(metric, m), m.get("rows", ()))
                side.metrics[f"{scenario}/{loop}"] = rows
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise BadInput(f"{folder / 'metrics.json'} is no file of slipctl: {error}") from None
    return side


def _quantity(name: str, given: Mapping[str, Any]) -> tuple[Any, str]:
    """Value and unit of a number or a list of numbers as a run writes them.

    Raises:
        ValueError: it is none, or is not finite.
    """
    value, unit = given["value"], given["unit"]
    flat = [value]
    while any(isinstance(v, list) for v in flat):
        flat = [v for part in flat for v in (part if isinstance(part, list) else [part])]
    real = all(v is None or (type(v) in (int, float) and abs(v) < sys.float_info.max) for v in flat)
    if not (real and isinstance(unit, str)):
        raise ValueError(f"{name} is no number with a unit")
    return value, unit


def _put(
    side: Side, rows: dict[str, np.ndarray], metric: str, value: Any, unit: str,
    labels: Sequence[str],
) -> None:  # fmt: skip
    """Take down a metric; a list has a row for each number."""
    values = value if isinstance(value, list) else [value]
    for k, v in enumerate(values):
        named = len(labels) == len(values)
        label = labels[k] if named else str(k + 1)
        name = f"{metric}, {label}" if isinstance(value, list) and len(values) > 1 else metric
        worst = METRICS[metric].worst if metric in METRICS and METRICS[metric].event else np.nan
        rows[name] = np.array([worst if v is None else float(v)])
        side.units[name] = unit


def _sweep(name: str) -> Side:
    found = open_sweep(name)
    about = {SWEPT[k]: _said(v) for k, v in found.about.items() if k in SWEPT}
    for axis in found.plan.axes:
        points = f", {axis.points} values" if axis.points else ", drawn"
        about[f"--vary {axis.name}"] = f"{axis.lo:g} .. {axis.hi:g} {axis.unit}{points}"
    side = Side(name, about, state=f"{found.missing} runs are missing" if found.missing else "")
    rows: dict[str, np.ndarray] = {}
    for metric, unit, values in found.labelled():
        rows[metric], side.units[metric] = values, unit
    ensemble, seed = found.about.get("ensemble"), found.about.get("seed")
    side.draws = [json.dumps([k, n, ensemble, seed], sort_keys=True) for k, n, *_ in found.runs]
    loop = str(found.about.get("loop", "loop")).rpartition(":")[2]
    side.metrics[f"{found.about['scenario']}/{loop}"] = rows
    return side


def _said(value: Any) -> str:
    if isinstance(value, str):
        return value if len(value) <= 40 else value[:12] + "..."
    return json.dumps(value)


def changes(sides: Sequence[Side]) -> list[dict[str, Any]]:
    """What differs between the folders, but their metrics: a row each."""
    rows = []
    for key in dict.fromkeys(k for s in sides for k in s.about):
        values = [s.about.get(key, "-") for s in sides]
        if len(set(values)) > 1:
            rows.append({"what": key, "unit": "", "values": values})
    for loop in dict.fromkeys(n for s in sides for n in s.parameters):
        have = [s.parameters.get(loop) for s in sides]
        known = [p for p in have if p is not None]
        if len(known) < 2:
            continue
        for name in dict.fromkeys(n for p in known for n in p):
            cells = [None if p is None or name not in p else p[name].get("value") for p in have]
            if len({json.dumps(c) for c, p in zip(cells, have, strict=True) if p is not None}) > 1:
                unit = next(p[name]["unit"] for p in known if name in p)
                told = ["-" if c is None else number(c) for c in cells]
                rows.append({"what": f"{loop}: {name}", "unit": unit, "values": told})
    return rows


def metric_rows(sides: Sequence[Side]) -> dict[str, list[dict[str, Any]]]:
    """Rows of metrics for each loop that all have, or for the only loop of each."""
    common = [k for k in sides[0].metrics if all(k in s.metrics for s in sides)]
    pairs = [(k, [k] * len(sides)) for k in common]
    if not common and all(len(s.metrics) == 1 for s in sides):
        keys = [next(iter(s.metrics)) for s in sides]
        pairs = [(" | ".join(keys), keys)]
    if not pairs:
        has = "; ".join(f"{s.name} has {', '.join(s.metrics) or 'none'}" for s in sides)
        raise BadInput(f"the folders have no scenario and loop in common: {has}")
    rows = {}
    for title, keys in pairs:
        names = dict.fromkeys(n for s, k in zip(sides, keys, strict=True) for n in s.metrics[k])
        rows[title] = [_row(sides, keys, metric) for metric in names]
    return rows


def _row(sides: Sequence[Side], keys: Sequence[str], metric: str) -> dict[str, Any]:
    """A metric of each side: its median and spread, and how far it is from the first.

    Where both ran on the same draws, the difference is the median of those of the single runs.
    """
    every = [s.metrics[k].get(metric, np.empty(0)) for s, k in zip(sides, keys, strict=True)]
    values = [v[~np.isnan(v)] for v in every]
    shares = [quantiles(v, (0.05, 0.5, 0.95)) if v.size else None for v in values]
    middle = [None if q is None else q[1] for q in shares]
    spread = [
        [q[0], q[2]] if q and v.size > 1 else None for q, v in zip(shares, values, strict=True)
    ]
    first = middle[0]
    found: list[tuple[float | None, list[float] | None, bool]] = []
    for k, m in enumerate(middle[1:], start=1):
        each = _paired(sides[0], every[0], sides[k], every[k])
        if each is not None:
            low, mid, high = quantiles(each, (0.05, 0.5, 0.95))
            found.append((mid, [low, high], bool(low > 0 or high < 0)))
        elif m is None or first is None or (m == first and np.isinf(m)):
            found.append((None, None, False))
        else:  # whether 90 % of the runs of one lie on one side of those of the other
            (a_lo, a_hi), (b_lo, b_hi) = spread[0] or (first, first), spread[k] or (m, m)
            found.append((_minus(m, first), None, bool(a_hi < b_lo or b_hi < a_lo)))
    apart, paired, beyond = map(list, zip(*found, strict=True))
    units = {s.units[metric]: s.name for s in sides if metric in s.units}
    if len(units) > 1:
        told = ", ".join(f"in {u} in {name}" for u, name in units.items())
        raise BadInput(f"{metric} is {told}; run one of them again")
    unit = next(iter(units), "1")
    return {"metric": metric, "unit": unit, "values": middle, "spread": spread,
            "never": [int(np.isinf(v).sum()) for v in values], "difference": apart,
            "paired": paired, "beyond_spread": beyond}  # fmt: skip


def _minus(a: Any, b: Any) -> float:
    """Difference; 0 between two that never came."""
    return 0.0 if a == b else float(a) - float(b)


def _paired(one: Side, a: np.ndarray, other: Side, b: np.ndarray) -> np.ndarray | None:
    """Differences of the runs that both made on the same draws, other minus one; None if none is.

    A run that never came against one that did is infinitely far; two that never came do not differ.
    """
    if len(one.draws) != a.size or len(other.draws) != b.size or not a.size:
        return None
    at = {d: k for k, d in enumerate(one.draws)}
    pairs = [(a[at[d]], b[k]) for k, d in enumerate(other.draws) if d in at]
    found = [_minus(y, x) for x, y in pairs if not (np.isnan(x) or np.isnan(y))]
    return np.array(found) if found else None


def text(
    sides: Sequence[Side], changed: Sequence[Mapping[str, Any]],
    tables: Mapping[str, Sequence[Mapping[str, Any]]],
) -> str:  # fmt: skip
    """What a person reads."""
    letters = [chr(ord("A") + k) if k < 26 else str(k + 1) for k in range(len(sides))]
    parts = ["\n".join(
        f"{letter}  {s.name}" + (f" ({s.state})" if s.state else "")
        for letter, s in zip(letters, sides, strict=True)
    )]  # fmt: skip
    rows = [["changed", "unit", *letters]]
    rows += [[c["what"], c["unit"], *c["values"]] for c in changed[:LISTED]]
    parts.append(wrap_table(rows) if changed else "only metrics differ")
    if len(changed) > LISTED:
        parts[-1] += f"\n{len(changed) - LISTED} more; --json has all"
    return "\n\n".join([*parts, *metric_tables(letters, tables)])


def metric_tables(
    names: Sequence[str], tables: Mapping[str, Sequence[Mapping[str, Any]]]
) -> list[str]:
    """Tables of metrics, and what their cells mean; differences of many sides have their own.

    Args:
        names: of the sides. tables: of :func:`metric_rows`.
    """
    parts = []
    every = [r for t in tables.values() for r in t]
    swept = any(s is not None for r in every for s in r["spread"])
    paired = any(p is not None for r in every for p in r["paired"])
    apart = [f"{x} - {names[0]}" for x in names[1:]]
    for title, metrics in tables.items():
        if len(names) == 2:
            rows = [[title, "unit", *names, *apart]]
            rows += [[r["metric"], r["unit"], *_cells(r), *_apart_cells(r, swept)] for r in metrics]
            parts.append(wrap_table(rows))
            continue
        rows = [[title, "unit", *names]]
        parts.append(wrap_table(rows + [[r["metric"], r["unit"], *_cells(r)] for r in metrics]))
        rows = [["difference", "unit", *apart]]
        rows += [[r["metric"], r["unit"], *_apart_cells(r, swept)] for r in metrics
                 if _differs(r)]  # fmt: skip
        parts.append(wrap_table(rows))
    if swept:
        parts.append("median (5 % .. 95 %); " + (
            "differences are of runs on the same draws, * where 95 % of them have one sign"
            if paired else "* the two spreads do not overlap"
        ))  # fmt: skip
    if any(n for r in every for n in r["never"]):
        parts[-1] += (
            "\nnever: runs that did not reach it or broke off; they count as the worst value"
        )
    return parts


def tells_apart(row: Mapping[str, Any]) -> bool:
    """Whether a row of :func:`metric_rows` says that the sides differ."""
    spreads = {tuple(map(number, s)) for s in row["spread"] if s}
    values = {number(v) for v in row["values"]}
    return _differs(row) or any(len(k) > 1 for k in (values, spreads, set(row["never"])))


def _differs(row: Mapping[str, Any]) -> bool:
    """Whether a difference of a row is not 0, at its median or at an end of its spread."""
    return any((*row["difference"], *(end for pair in row["paired"] for end in pair or ())))


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Median, spread and how many never came, of each side."""
    found = []
    for v, s, never in zip(row["values"], row["spread"], row["never"], strict=True):
        text = number_or_never(v)
        text += f" ({number_or_never(s[0])} .. {number_or_never(s[1])})" if s else ""
        found.append(text + (f", {never} never" if never and s else ""))
    return found


def _apart_cells(row: Mapping[str, Any], swept: bool) -> list[str]:
    """Difference of each further side from the first, with its spread where runs are paired."""
    found = []
    each = zip(row["difference"], row["paired"], row["beyond_spread"], strict=True)
    for d, pair, beyond in each:
        text = _signed(d)
        text += f" ({_signed(pair[0])} .. {_signed(pair[1])})" if pair else ""
        found.append(text + (" *" if swept and beyond else ""))
    return found


def _signed(value: float | None) -> str:
    if value is not None and np.isinf(value):
        return "+inf" if value > 0 else "-inf"
    return ("+" if value is not None and value > 0 else "") + number(value)
