"""What a search found, as a table for the terminal and as a page with pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np

from slipctl import __version__
from slipctl.certify.promise import CERTIFIED
from slipctl.design import statement
from slipctl.design.judging import CLOSE, Slice
from slipctl.design.tune import Tuned
from slipctl.design.tuning import TRAINING
from slipctl.draw import plots
from slipctl.study.report import STYLE, image, table
from slipctl.study.texts import number, with_unit, wrapped

Rows = list[list[str]]


def gains_rows(found: Tuned) -> Rows:
    """Each number: tuned, by hand, the range that keeps the objective, how it answers."""
    keeps = f"keeps {100 * CLOSE:g} %"
    rows = [["number", "unit", "range", "by hand", "tuned", keeps, "% a %"]]
    by = {s.free.name: s for s in found.slices}
    for f in found.frees:
        s = by.get(f.name)
        kept = f"{number(s.lo)} .. {number(s.hi)}" if s else "–"
        answer = number(s.answer, 2) if s and math.isfinite(s.answer) else "–"
        rows.append([f.name, f.unit, f"{number(f.lo)} .. {number(f.hi)}", number(f.now),
                     number(found.gains[f.name], 6), kept, answer])  # fmt: skip
    return rows


def judged_rows(found: Tuned) -> Rows:
    """Objective and limits on the held-out draws."""
    judged = found.judged
    assert judged is not None
    rows = [["held-out draws", "by hand", "tuned"]]
    hand, tuned = judged.by_hand, judged.tuned
    spread: dict[str, Callable[..., Any]] = {
        "least": np.min, "median": np.median, "largest": np.max
    }  # fmt: skip
    for what, of in spread.items():
        rows.append([f"{what} {found.search.objective.text}", *(
            number(float(of(s.values)), 6) for s in (hand, tuned))])  # fmt: skip
    rows.append([f"mean {found.search.objective.text}", number(hand.mean(), 6),
                 number(tuned.mean(), 6)])  # fmt: skip
    many = len(tuned.values)
    for limit, kept, before in judged.kept(found.search.limits):
        rows.append([f"draws with {limit.text}", f"{before} of {many}", f"{kept} of {many}"])
    return rows


def promise_rows(found: Tuned) -> Rows:
    """Verdict and margin of each certificate."""
    rows = [["certificate", "by hand", "tuned", "margin by hand", "margin"]]
    loop = found.tuned_loop()
    for g in found.promises.gains:
        tuned, hand = found.margins[g.name]
        verdicts = (found.promises.verdict(g, x) for x in (found.loop, loop))
        rows.append([g.name, *verdicts, *(number(m, 3) if m else "–" for m in (hand, tuned))])
    return rows


def difference(found: Tuned) -> str:
    """Mean paired difference on the held-out draws, in words."""
    judged = found.judged
    assert judged is not None
    if found.search.best is found.search.by_hand:
        return "nothing that was tried is better than the gains set by hand; they are kept"
    mean, error = judged.difference, judged.error
    sure = "more than" if abs(mean) > 2 * error else "within"
    return (
        f"tuned minus by hand, the same {len(judged.tuned.values)} held-out draws:"
        f" {mean:+.4g} +- {error:.2g} (standard error), {sure} twice the error"
    )


def text(found: Tuned) -> str:
    """What a person reads on the terminal."""
    search = found.search
    wide = [found.name, f"minimise {search.objective.text}",
            *(f"subject to {limit.text}" for limit in search.limits),
            *(f"subject to {p.text}" for p in search.promises.wanted)]  # fmt: skip
    refused = sum(search.refused.values())
    counted = (
        f"{search.thought} candidates, {refused} refused by a certificate before any run,"
        f" {search.spent} runs on {search.samples} draws"
    )
    blocks = [", ".join(wide), counted, _table(gains_rows(found)), _table(judged_rows(found)),
              difference(found)]  # fmt: skip
    if found.promises.gains:
        blocks.append(_table(promise_rows(found)))
    if found.statement is not None:
        blocks += statement.lines(found.statement)
    return "\n\n".join(blocks)


def _table(rows: Rows) -> str:
    return wrapped(rows, [max(len(r[k]) for r in rows) for k in range(len(rows[0]))])


# ---- pictures ------------------------------------------------------------------------------------


def pictures(found: Tuned) -> dict[str, plots.Figure]:
    """Convergence, slices, and paired differences, by caption."""
    search = found.search
    what = (search.objective.text, _unit(found))
    runs = [r for r, *_ in search.course]
    fig, axes = plots.panels(height=2.8)
    curves: dict[str, tuple[Any, Any]] = {
        "best so far": (runs, [m if missed <= 0 else math.nan for _, m, missed in search.course])
    }
    if math.isfinite(search.by_hand.score.mean()):
        curves["by hand"] = ([runs[0], runs[-1]], [search.by_hand.score.mean()] * 2)
    plots.lines(curves, ("runs", "1"), what, axis=axes[0, 0], points=True)
    shown = {"Mean over the draws of the search, against its runs.": fig}
    if found.slices:
        shown[
            "Mean over draws along each number, the others as tuned; the range that keeps"
            f" {100 * CLOSE:g} % is shaded. Where nothing is drawn a certificate or a limit fails."
        ] = _sliced(found.slices, what)
    if found.judged and search.best is not search.by_hand:
        d = np.sort(np.subtract(found.judged.tuned.values, found.judged.by_hand.values))
        share = (np.arange(d.size) + 0.5) / d.size * 100
        shown["Tuned minus by hand, each held-out draw, in order."] = plots.lines(
            {"difference": (share, d)}, ("share of the draws", "%"),
            (f"difference of {what[0]}", what[1]), legend=False,
        )  # fmt: skip
    return shown


def _unit(found: Tuned) -> str:
    """Unit of the objective."""
    search = found.search
    first = search.rolls.all(TRAINING, [(-1, search.by_hand.numbers, 0)])[0]
    return search.objective.unit(first) if first else "1"


def _sliced(slices: Sequence[Slice], what: tuple[str, str]) -> plots.Figure:
    fig, axes = plots.panels(len(slices), 1, height=2.4)
    for axis, s in zip(axes[:, 0], slices, strict=True):
        log = "x" if s.free.lo > 0 and s.free.hi >= 10 * s.free.lo else ""
        plots.lines({s.free.name: (s.values, s.means)}, (s.free.name, s.free.unit), what,
                    axis=axis, points=True, log=log, legend=False)  # fmt: skip
        axis.axvspan(s.lo, s.hi, color="#0072B2", alpha=0.12, lw=0)
        axis.axvline(s.free.now, color="#7F7F7F", ls=":", lw=1)
    return fig


# ---- the page ------------------------------------------------------------------------------------


def page(found: Tuned, command: str) -> str:
    """Write the page."""
    drawn = {caption: plots.svg_text(fig, command) for caption, fig in pictures(found).items()}
    sections = [("Gains", _html(gains_rows(found)) + _note()),
                ("Held-out draws", _html(judged_rows(found)) + _p(difference(found)))]  # fmt: skip
    if found.promises.gains:
        sections.append(("Certificates", _html(promise_rows(found)) + _promised(found)))
    if found.statement is not None:
        said = "".join(_p(line) for line in statement.lines(found.statement))
        none = _p("It says nothing of vehicles and rails outside the ensemble.")
        sections.append(("Statement", said + none))
    sections.append(("Pictures", "".join(_figure(c, svg) for c, svg in drawn.items())))
    sections.append(("Search", _searched(found) + f"<pre>{escape(command)}</pre>"))
    body = "".join(f"<section><h2>{t}</h2>{text}</section>" for t, text in sections)
    title = f"Gains of {found.name}"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="slipctl {__version__}">
<title>{escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="soft">minimise {escape(found.search.objective.text)} · slipctl {__version__}</p>
{body}
</body>
</html>
"""


def _note() -> str:
    return _p(
        f"In the range that keeps {100 * CLOSE:g} % the mean over draws of the search stays within"
        f" {100 * CLOSE:g} % of its value, the other numbers as tuned. The last column is the"
        " change of the objective in percent for one percent more of the number."
    )


def _promised(found: Tuned) -> str:
    lines = [
        _p("The margin is the factor on the bounds of the disturbances up to which the promise was"
           " found proved.")
    ]  # fmt: skip
    loop = found.tuned_loop()
    for g in found.promises.gains:
        if found.promises.verdict(g, loop) == CERTIFIED:
            lines.append(_p(f"{g.name}: {found.promises.promise(g, loop)}"))
    return "".join(lines)


def _searched(found: Tuned) -> str:
    search, world = found.search, found.search.rolls.world
    drawn = [f"{a.name} {number(a.lo)} .. {with_unit(a.hi, a.unit)}" for a in world.axes]
    drawn += [f"{f.name} times {number(f.lo)} .. {number(f.hi)}" for f in world.factors]
    drawn += ["noise"] if world.ensemble.seeds else []
    refused = "; ".join(f"{n} by {why}" for why, n in search.refused.items()) or "none"
    return _p(
        f"Scenario {world.scenario.name}; drawn: {', '.join(drawn)}. {search.thought} candidates"
        f" (refused before any run: {refused}), {search.spent} runs on {search.samples} draws,"
        f" seed {search.seed}, ensemble {world.ensemble.hash[:16]}."
    )


def _p(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _html(rows: Rows) -> str:
    return table(rows[0], rows[1:], range(1, len(rows[0])))


def _figure(caption: str, svg: str) -> str:
    return f"<figure>{image(svg, caption)}<figcaption>{escape(caption)}</figcaption></figure>"
