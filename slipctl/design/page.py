"""What a search found, as a table for the terminal and as a page with pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from slipctl import __version__
from slipctl.certify.promise import CERTIFIED
from slipctl.design import statement
from slipctl.design.gain_search import TRAINING
from slipctl.design.judgement import CLOSE, Judged, Slice
from slipctl.design.tune import Tuned
from slipctl.draw import distributions, looks, plots
from slipctl.study.report.page_style import html_page, image, table
from slipctl.study.report.texts import number, number_or_never, with_unit, wrap_table

Rows = list[list[str]]

MOST = 12
"""Points of a front that a table shows."""

KNEE = (
    "The gains are those of the knee of the front, the point whose largest loss is"
    " smallest. A loss is the distance from the best value of the front, as a share"
    " of the span of the front."
)


def goals(found: Tuned) -> str:
    """What was made small, in words."""
    return ", ".join(goal.text for goal in found.search.objectives)


def gains_rows(found: Tuned) -> Rows:
    """Each number: tuned, by hand, the range that keeps each objective, how that answers."""
    rows = [["number", "unit", "range", "by hand", "tuned"]]
    texts = [goal.text for goal in found.search.objectives]
    for text in texts:
        what = f" of {text}" if len(texts) > 1 else ""
        rows[0] += [f"within {100 * CLOSE:g} %{what}", f"slope{what} [%/%]"]
    by = {(s.objective, s.free.name): s for s in found.slices}
    for f in found.frees:
        rows.append([f.name, f.unit, f"{number(f.lo)} .. {number(f.hi)}", number(f.now),
                     number(found.gains[f.name], 6)])  # fmt: skip
        for text in texts:
            s = by.get((text, f.name))
            rows[-1].append(f"{number(s.lo)} .. {number(s.hi)}" if s else "–")
            rows[-1].append(number(s.answer, 2) if s and math.isfinite(s.answer) else "–")
    return rows


def front_rows(found: Tuned, most: int = MOST) -> Rows:
    """Points of the front, from the least of the first objective on; of many an even share."""
    front, goals_ = found.front, found.search.objectives
    rows = [["front", *(f.short for f in found.frees), *(g.text for g in goals_)]]
    at = {round(k) for k in np.linspace(0, len(front) - 1, min(most, len(front)))}
    for k, c in enumerate(front):
        marks = [n for n, other in (("knee", found.search.best), ("by hand", found.search.by_hand))
                 if c is other]  # fmt: skip
        if k in at or marks:
            rows.append([" and ".join(marks), *(number(c.numbers[f.name]) for f in found.frees),
                         *(number_or_never(s.mean(), 6) for s in c.scores)])  # fmt: skip
    return rows


def judged_rows(found: Tuned) -> Rows:
    """Objectives and limits on the held-out draws."""
    judged = found.judged
    assert judged is not None
    rows = [["held-out draws", "by hand", "tuned"]]
    spread: dict[str, Callable[..., Any]] = {
        "least": np.min, "median": np.median, "largest": np.max, "mean": np.mean
    }  # fmt: skip
    for goal, its, unit in zip(found.search.objectives, judged.each, _units(found), strict=True):
        both, tail = (its.by_hand, its.tuned), "" if unit == "1" else f" [{unit}]"
        for what, of in spread.items():
            cells = [number_or_never(float(of(s.values)), 6) for s in both]
            rows.append([f"{what} {goal.text}{tail}", *cells])
        if any(s.lost() for s in both):
            rows.append([f"draws that never reach {goal.text}", *(str(s.lost()) for s in both)])
    many = len(judged.tuned.values)
    for limit, kept, before in judged.kept(found.search.limits):
        rows.append([f"draws with {limit.text}", f"{before} of {many}", f"{kept} of {many}"])
    return rows


def promise_rows(found: Tuned) -> Rows:
    """Verdict and margin of each certificate."""
    rows = [["certificate", "by hand", "tuned", "margin by hand", "margin tuned"]]
    loop = found.tuned_loop()
    for g in found.promises.gains:
        tuned, hand = found.margins[g.name]
        verdicts = (found.promises.verdict(g, x) for x in (found.loop, loop))
        rows.append([g.name, *verdicts, *(number(m, 3) if m else "–" for m in (hand, tuned))])
    return rows


def differences(found: Tuned) -> list[str]:
    """Mean paired difference of each objective on the held-out draws, in words."""
    judged = found.judged
    assert judged is not None
    if found.search.best is found.search.by_hand:
        return ["no candidate was better than the gains set by hand, so they are kept"]
    lines = []
    for goal, its, u in zip(found.search.objectives, judged.each, _units(found), strict=True):
        unit = "" if u == "1" else f" {u}"
        mean, error = its.difference, its.error
        lost, before = its.tuned.lost(), its.by_hand.lost()
        many = len(its.tuned.values)
        if lost or before:
            lines.append(
                f"{goal.text} is never reached in {lost} of {many} held-out draws tuned, in"
                f" {before} by hand"
            )
        if not math.isfinite(mean):
            continue
        a, b = (np.array(s.values) for s in (its.tuned, its.by_hand))
        both = np.isfinite(a) & np.isfinite(b)
        sure = "more than chance" if abs(mean) > 2 * error else "which may be chance"
        lines.append(
            f"mean {goal.text} of {sum(both)} held-out draws{' that both reach' * (not all(both))}:"
            f" {np.mean(a[both]):.6g}{unit} tuned, {np.mean(b[both]):.6g}{unit} by hand; difference"
            f" {mean:+.4g} +- {error:.2g}{unit} (standard error), {sure}"
        )
    return lines


def text(found: Tuned) -> str:
    """What a person reads on the terminal."""
    search = found.search
    wide = [found.name, f"minimise {goals(found)}",
            *(f"subject to {limit.text}" for limit in search.limits),
            *(f"subject to {p.text}" for p in search.promises.wanted)]  # fmt: skip
    refused = sum(search.refused.values())
    why = " or the lack of one nearby" if search.shown else ""
    counted = (
        f"{search.thought} candidates, {refused} refused by a certificate{why} before any run,"
        f" {search.spent} runs on {search.samples} draws"
    )
    if search.shown:
        counted += f"; {sum(search.shown.values())} of {len(search.shown)} best ones are proved"
    front = [wrap_table(front_rows(found)), KNEE] if found.front else []
    gradient = [found.polished.text()] if found.polished else []
    blocks = [
        ", ".join(wide), "\n".join([counted, *gradient]), *front, wrap_table(gains_rows(found)),
        wrap_table(judged_rows(found)), "\n".join(differences(found)),
    ]  # fmt: skip
    if found.promises.gains:
        blocks.append(wrap_table(promise_rows(found)))
    if found.statement is not None:
        blocks += statement.lines(found.statement)
    return "\n\n".join(blocks)


# ---- pictures ------------------------------------------------------------------------------------


def pictures(found: Tuned) -> dict[str, plots.Figure]:
    """Front or convergence, slices, and paired differences, by caption."""
    search = found.search
    units = _units(found)
    named = [(goal.text, unit) for goal, unit in zip(search.objectives, units, strict=True)]
    shown = {}
    if found.front:
        shown["Means over the draws of the search: no candidate is better in all objectives than"
              " one of the front."] = front_picture(found)  # fmt: skip
    else:
        shown["Mean over the draws of the search, against its runs."] = _course(found, named[0])
    for what in named:
        along = [s for s in found.slices if s.objective == what[0]]
        if along:
            shown[
                f"Mean {what[0]} over draws along each number, the others as tuned; the range"
                f" within {100 * CLOSE:g} % is shaded. The solid line is where it was tuned to, the"
                " dotted one where it was set by hand. Where there is no curve, a certificate or a"
                " limit fails."
            ] = _sliced(along, what, found.gains)
    if found.judged:
        for goal, what, its in zip(search.objectives, named, found.judged.each, strict=True):
            caption = (
                f"{what[0]} on the held-out draws: each dot is a draw, the box the middle half"
            )
            if search.best is not search.by_hand:
                caption += "; below, tuned minus by hand, draw by draw, in order"
            shown[f"{caption}."] = _judged_picture(found, goal.terms, what, its)
    return shown


def front_picture(found: Tuned) -> plots.Figure:
    """The front with its knee and the gains set by hand; a panel for each further objective."""
    search, units = found.search, _units(found)
    fig, axes = plots.panels(len(search.others), 1, height=3.2)
    first = (search.objective.text, units[0])
    for k, goal in enumerate(search.others, 1):
        curves: dict[str, tuple[Any, Any]] = {
            "front": (
                [c.score.mean() for c in found.front],
                [c.scores[k].mean() for c in found.front],
            )
        }
        for name, c in (("knee", search.best), ("by hand", search.by_hand)):
            at = [c.scores[i].mean() for i in (0, k)]
            if np.isfinite(at).all():
                curves[name] = ([at[0]], [at[1]])
        plots.lines(curves, first, (goal.text, units[k]), axis=axes[k - 1, 0], points=True)
    return fig


def _judged_picture(
    found: Tuned, terms: Sequence[tuple[float, str]], what: tuple[str, str], its: Judged
) -> plots.Figure:
    """Spread of an objective on the held-out draws beside its limit, and paired differences."""
    search = found.search
    moved = search.best is not search.by_hand
    fig, axes = plots.panels(2 if moved else 1, 1, height=2.6)
    groups = {"by hand": its.by_hand.values, "tuned": its.tuned.values} if moved else {
        "by hand": its.by_hand.values}  # fmt: skip
    limits = [x for x in search.limits if [m for _, m in terms] == [x.metric] and terms[0][0] == 1]
    limit = (limits[0].text, limits[0].value) if limits else None
    plots.spread(groups, what, axis=axes[0, 0], limit=limit)
    if moved:
        a, b = np.array(its.tuned.values), np.array(its.by_hand.values)
        both = np.isinf(a) & np.isinf(b)
        d = np.where(both, 0.0, a) - np.where(both, 0.0, b)
        y = (f"difference of {what[0]}", what[1])
        distributions.differences({"tuned": list(d)}, "by hand", y, axis=axes[1, 0])
    return fig


def _course(found: Tuned, what: tuple[str, str]) -> plots.Figure:
    search = found.search
    runs = [r for r, *_ in search.course]
    fig, axes = plots.panels(height=2.8)
    curves: dict[str, tuple[Any, Any]] = {
        "best so far": (runs, [m if missed <= 0 else math.nan for _, m, missed in search.course])
    }
    if math.isfinite(search.by_hand.score.mean_reached()):
        curves["by hand"] = ([runs[0], runs[-1]], [search.by_hand.score.mean_reached()] * 2)
    plots.lines(curves, ("runs", "1"), what, axis=axes[0, 0], points=True)
    return fig


def _units(found: Tuned) -> list[str]:
    """Unit of each objective."""
    search = found.search
    first = search.rolls.all(TRAINING, [(-1, search.by_hand.numbers, 0)])[0]
    return [goal.unit(first) if first else "1" for goal in search.objectives]


def _sliced(
    slices: Sequence[Slice], what: tuple[str, str], gains: Mapping[str, float]
) -> plots.Figure:
    fig, axes = plots.panels(len(slices), 1, height=2.4)
    for axis, s in zip(axes[:, 0], slices, strict=True):
        plots.lines({s.free.name: (s.values, s.means)}, (s.free.name, s.free.unit), what,
                    axis=axis, points=True, legend=False)  # fmt: skip
        if s.free.lo > 0 and s.free.hi >= 10 * s.free.lo:
            looks.logarithmic(axis, "x")
        axis.axvspan(s.lo, s.hi, color="#0072B2", alpha=0.12, lw=0)
        axis.axvline(gains[s.free.name], color="#7F7F7F", lw=1)
        axis.axvline(s.free.now, color="#7F7F7F", ls=":", lw=1)
    return fig


# ---- the page ------------------------------------------------------------------------------------


def page(found: Tuned, command: str) -> str:
    """Write the page."""
    drawn = {caption: plots.svg_text(fig, command) for caption, fig in pictures(found).items()}
    lines = "".join(_p(line) for line in differences(found))
    sections = [("Gains", _html(gains_rows(found)) + _note()),
                ("Held-out draws", _html(judged_rows(found)))]  # fmt: skip
    if found.front:
        sections.insert(0, ("Front", _html(front_rows(found, len(found.front))) + _p(KNEE)))
    if found.promises.gains:
        sections.append(("Certificates", _html(promise_rows(found)) + _promised(found)))
    if found.statement is not None:
        said = "".join(_p(line) for line in statement.lines(found.statement))
        none = _p("The statement does not hold for vehicles and rails outside the ensemble.")
        sections.append(("Statement", said + none))
    sections.append(("Pictures", "".join(_figure(c, svg) for c, svg in drawn.items())))
    sections.append(("Search", _searched(found) + f"<pre>{escape(command)}</pre>"))
    body = lines + "".join(f"<section><h2>{t}</h2>{text}</section>" for t, text in sections)
    said = f"minimise {escape(goals(found))} · slipctl {__version__}"
    return html_page(f"Gains of {found.name}", said, body)


def _note() -> str:
    return _p(
        f"Within {100 * CLOSE:g} %: range of the number in which the mean over the draws of the"
        f" search stays within {100 * CLOSE:g} % of its value, with the other numbers as tuned."
        " Slope: change of the objective in percent for one percent more of the number."
    )


def _promised(found: Tuned) -> str:
    lines = [
        _p("The margin is the factor on the bounds of the disturbances up to which the promise was"
           " found proved.")
    ]  # fmt: skip
    asked = [g.name for g, _, _ in found.promises.needed()]
    free = [g.name for g in found.promises.gains if g.name not in asked]
    if free and asked:
        lines.append(
            _p(
                f"A candidate had to have: {', '.join(asked)}. It did not have to have:"
                f" {', '.join(free)}, which the gains set by hand do not have either."
            )
        )
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
    why = found.polished.text() if found.polished else ""
    gradient = f" {why[0].upper()}{why[1:]}." if why else ""
    return _p(
        f"Scenario {world.scenario.name}; drawn: {', '.join(drawn)}. {search.thought} candidates"
        f" (refused before any run: {refused}), {search.spent} runs on {search.samples} draws,"
        f" seed {search.seed}, ensemble {world.ensemble.hash[:16]}.{gradient}"
    )


def _p(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def _html(rows: Rows) -> str:
    return table(rows[0], rows[1:], range(1, len(rows[0])))


def _figure(caption: str, svg: str) -> str:
    return f"<figure>{image(svg, caption)}<figcaption>{escape(caption)}</figcaption></figure>"
