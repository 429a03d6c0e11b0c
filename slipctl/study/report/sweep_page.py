"""The page of a sweep: what is kept, how metrics are spread beside their limits, what failed first.

Where several loops ran on the same draws, their runs are compared one by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from slipctl import __version__
from slipctl.block.units.unit_algebra import display_scale
from slipctl.draw import plots
from slipctl.draw.distributions import differences
from slipctl.draw.looks import pretty
from slipctl.run.metrics import METRICS
from slipctl.run.sweep.spread import limits_missed, quantiles
from slipctl.run.sweep.sweep_results import Sweep
from slipctl.study.report.page_style import html_page, image, table
from slipctl.study.report.texts import number, number_or_never, with_unit

SHARES = (0.0, 0.05, 0.5, 0.95, 1.0)
HEAD = ("least", "5 %", "median", "95 %", "largest", "never")

WORST = 12
"""Runs that failed which the page lists for each loop."""

PICTURED = (
    "stopping_distance", "distance", "lock_time", "slip_max", "torque_ripple", "adhesion_use",
    "jerk_rms",
)  # fmt: skip
"""Metrics that are drawn where no limit asks for others."""

MOST = 5
"""Pictures of metrics without a limit."""


def page(sweeps: Mapping[str, Sweep], command: str) -> str:
    """Write the page.

    Args:
        sweeps: what ran, by loop. command: the command line.
    """
    first = next(iter(sweeps.values()))
    loop = str(first.about.get("loop", ""))
    title = f"Sweep of {'all loops of ' if len(sweeps) > 1 else ''}"
    title += loop.partition(":")[0] if len(sweeps) > 1 else loop
    sections = {
        "Limits": _limits(sweeps),
        "Pictures": _pictures(sweeps, command),
        "Runs that failed": _failures(sweeps),
        "Spread": "".join(_spread(n, s, len(sweeps) > 1) for n, s in sweeps.items()),
        "Provenance": f"{_varied(first)}<pre>{escape(command)}</pre>",
    }
    body = "".join(f"<section><h2>{t}</h2>{text}</section>" for t, text in sections.items() if text)
    said = (
        f"{len(first.runs)} runs of each loop in scenario\n"
        f"{escape(str(first.about['scenario']))} · slipctl {__version__}"
    )
    return html_page(title, said, body)


def _limits(sweeps: Mapping[str, Sweep]) -> str:
    limits = next(iter(sweeps.values())).limits
    if not limits:
        return ""
    rows = []
    for name, one in sweeps.items():
        kept = one.kept
        if kept is None:
            continue
        low, high = (f"{100 * v:.3g}" for v in kept.interval)
        rows.append([name, f"{kept.within} of {kept.runs}", f"{low} to {high} %",
                     *(str(kept.fails[n]) for n in limits)])  # fmt: skip
    units = next(iter(sweeps.values())).units
    head = ["loop", "within all limits", "95 % interval of the share"]
    for n, limit in limits.items():
        factor, unit = display_scale(units[n][0] if n in units else "1")
        head.append(f"runs that miss {n} ≤ {with_unit(factor * limit, pretty(unit))}")
    return table(head, rows, range(1, len(head))) + (
        '<p class="soft">A run that never reaches a metric, or broke off, misses its limit; a run'
        " may miss several. The interval is that of Clopper and Pearson.</p>"
    )


def _metrics_to_draw(sweeps: Mapping[str, Sweep]) -> list[str]:
    """Metrics with a limit, then others, single numbers of which some run has one."""
    first = next(iter(sweeps.values()))
    there = [
        n for n in dict.fromkeys((*first.limits, *PICTURED))
        if any(n in s.units and s.rows(n) is None for s in sweeps.values())
    ]  # fmt: skip
    spreads = [n for n in there if n in first.limits or _differs(sweeps, n)]
    if "stopping_distance" in spreads and "distance" not in first.limits:
        spreads = [n for n in spreads if n != "distance"]
    free = [n for n in spreads if n not in first.limits][:MOST]
    return [n for n in spreads if n in first.limits] + free


def _differs(sweeps: Mapping[str, Sweep], metric: str) -> bool:
    every = np.concatenate([s.column(metric) for s in sweeps.values() if metric in s.units])
    return bool(np.unique(every[~np.isnan(every)]).size > 1)


def _pictures(sweeps: Mapping[str, Sweep], command: str) -> str:
    out = []
    limits = next(iter(sweeps.values())).limits
    for metric in _metrics_to_draw(sweeps):
        factor, unit = display_scale(
            next(s.units[metric][0] for s in sweeps.values() if metric in s.units)
        )
        columns = {n: factor * s.column(metric) for n, s in sweeps.items() if metric in s.units}
        pairs = paired_differences({n: s for n, s in sweeps.items() if n in columns}, metric)
        fig, axes = plots.panels(2 if pairs else 1, 1, height=2.7)
        limit = None
        if metric in limits:
            value = factor * limits[metric]
            limit = (f"limit {with_unit(value, pretty(unit))}", value)
        plots.spread({n: list(v) for n, v in columns.items()}, (metric, unit), axis=axes[0, 0],
                     limit=limit)  # fmt: skip
        if pairs:
            base = next(iter(columns))
            differences({n: list(factor * d) for n, d in pairs.items()}, base,
                        (f"difference of {metric}", unit), axis=axes[1, 0])  # fmt: skip
        meaning = METRICS[metric].meaning
        said = (
            f"{metric}: {meaning}. Each dot is a run, the box the middle half, the bar the median."
        )
        if pairs:
            said += (
                " Below are the differences on the same draws, sorted; two runs that never reach it"
                " differ by 0."
            )
        svg = plots.svg_text(fig, command)
        out.append(f"<figure>{image(svg, said)}<figcaption>{escape(said)}</figcaption></figure>")
    return "".join(out)


def paired_differences(sweeps: Mapping[str, Sweep], metric: str) -> dict[str, np.ndarray]:
    """Differences of a metric from the first sweep on the same draws, by loop; in its own unit.

    Of two runs that never reached it there is none; one that did not is infinitely far.
    """
    (_first, base), *others = sweeps.items()
    at = {k: (numbers, i) for i, (k, numbers, *_) in enumerate(base.runs)}
    values = base.column(metric)
    found = {}
    for name, other in others:
        column, pairs = other.column(metric), []
        for i, (k, numbers, *_) in enumerate(other.runs):
            if k in at and at[k][0] == numbers:
                pairs.append((values[at[k][1]], column[i]))
        if pairs:
            a, b = np.array(pairs).T
            both = np.isinf(a) & np.isinf(b)
            found[name] = np.where(both, 0.0, b) - np.where(both, 0.0, a)
    return found


def _failures(sweeps: Mapping[str, Sweep]) -> str:
    """The first runs of each loop that miss a limit or broke off, with their numbers."""
    out = []
    for name, one in sweeps.items():
        rows: list[list[str]] = []
        many = 0
        axes = [a.name for a in one.plan.axes]
        for run, numbers, metrics, why in one.runs:
            missed = limits_missed(metrics, one.limits)
            if not missed and not why:
                continue
            many += 1
            if len(rows) < WORST:
                told = why if why else "; ".join(f"{n} {_value(metrics, n)}" for n in missed)
                rows.append([str(run), *(number(numbers.get(a)) for a in axes), told])
        if rows:
            units = {a.name: "" if a.unit == "1" else f" [{pretty(a.unit)}]" for a in one.plan.axes}
            head = ["run", *(f"{n}{u}" for n, u in units.items()), "what it misses"]
            more = f'<p class="soft">{many - WORST} more.</p>' if many > WORST else ""
            out.append(f"<h3>{escape(name)}: {many} of {len(one.runs)}</h3>"
                       + table(head, rows, range(len(head) - 1)) + more)  # fmt: skip
    return "".join(out)


def _value(metrics: Mapping[str, object], name: str) -> str:
    value = metrics.get(name)
    return "never" if value is None else number(value)


def _spread(name: str, one: Sweep, named: bool) -> str:
    rows: list[Sequence[str]] = []
    for metric, unit, values in one.labelled():
        factor, shown = display_scale(unit)
        shares = quantiles(factor * values, SHARES)
        if np.isnan(shares[0]):
            continue
        never = int(np.isinf(values).sum())
        label = metric if shown == "1" else f"{metric} [{pretty(shown)}]"
        rows.append([label, *map(number_or_never, shares), str(never or "–")])
    head = f"<h3>{escape(name)}</h3>" if named else ""
    return head + table(["metric", *HEAD], rows, range(1, len(HEAD) + 1))


def _varied(one: Sweep) -> str:
    rows = [
        [a.name, f"{number(a.lo)} to {number(a.hi)}", "" if a.unit == "1" else pretty(a.unit),
         f"{a.points} values" if a.points else "drawn"]
        for a in one.plan.axes
    ]  # fmt: skip
    seed = f"<p>Design {one.plan.design}, seed {one.plan.seed}.</p>" if one.plan.drawn else ""
    return table(["varied", "range", "unit", "how"], rows) + seed
