"""Figures: one style, units on each axis, the same colour for the same loop in every study.

With ``looks`` the only place that imports matplotlib to draw, when something is drawn. A study's
figures are made of these helpers: ``traces`` of logged signals, ``lines`` and ``bars`` of anything,
``laws`` of an adhesion law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slipctl.block.units.unit_algebra import display_scale
from slipctl.draw import live, looks
from slipctl.draw import panels as seen
from slipctl.draw.distributions import limit_line
from slipctl.draw.distributions import spread as spread
from slipctl.draw.looks import BLACK, GREY, ORANGE, colour, dash, hues_of, label, panels, style
from slipctl.draw.looks import BLUE as BLUE
from slipctl.draw.looks import GREEN as GREEN
from slipctl.draw.looks import PALETTE as PALETTE
from slipctl.draw.looks import pretty as pretty
from slipctl.draw.strokes import area, envelope, stroke
from slipctl.run.results import NotRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from slipctl.block.block import Block
    from slipctl.run.results import Case, Results


def traces(
    results: Results,
    scenario: str,
    loops: Sequence[str] = (),
    signals: Sequence[str | Sequence[str]] = ("slip", "torque"),
    *,
    span: tuple[float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    labels: Mapping[str, str] | None = None,
) -> Figure:
    """Logged signals over time, one panel each, the loops in their colours.

    Of what each axle has its own, all panels show one and the same axle, that which slips most; the
    shading is that of this axle. On a page another one may be chosen.

    Args:
        results: what was run.
        scenario: the scenario.
        loops: the loops; none given takes all that ran.
        signals: for each panel a role (``"slip"``), a logged name, or several of them, of which
            the second and later ones are drawn thin and grey (a reference, a bound).
        span: times in s from and to which to draw.
        limits: range of the vertical axis by role or name, in the unit of the log.
        labels: axis label without unit by role or name; otherwise the signal's meaning.
    """
    chosen = list(loops) or list(results.data.get(scenario, {}))
    if not chosen:
        raise NotRun(f"{scenario} was not run")
    logs = {loop: results.log(scenario, loop) for loop in chosen}
    fig, axes = panels(len(signals), sharex=True)
    entries: dict[str, Any] = {}
    axle = seen.chosen_axle(results, logs, signals)
    drawn = [seen.make_panel(results, scenario, logs, w, span, axle or 0) for w in signals]
    rough = {loop: sum(panel.rough.get(loop, 0.0) for panel in drawn) for loop in logs}
    behind = sorted(rough, key=lambda loop: -rough[loop])  # chattering ones do not cover
    dashes = looks.line_styles([panel.curves for panel in drawn], behind)
    dashes |= {loop: own for loop in behind if (own := dash(loop, chosen)) != "-"}
    hues = hues_of(list(results.data[scenario]))
    with style():
        for axis, panel in zip(axes[:, 0], drawn, strict=True):
            first, others, unit = panel.first, panel.others, panel.unit
            for loop in [n for n in behind if n in panel.curves]:
                line = stroke(
                    axis, panel.curves[loop], color=hues[loop], ls=dashes[loop], label=loop,
                    zorder=2 + 0.01 * behind.index(loop),
                )  # fmt: skip
                if loop in panel.axles:
                    live.axles(line, panel.curves[loop][0], panel.axles[loop])
                entries.setdefault(loop, line)
            for other in others:
                _references(axis, results, logs, other, span, entries)
            factor, unit = display_scale(unit)
            of = f", axle {axle + 1}" if axle is not None and panel.axles else ""
            axis.set_ylabel(label((labels or {}).get(first, _wrap(panel.text)) + of, unit))
            if limits and first in limits:
                axis.set_ylim(*(factor * edge for edge in limits[first]))
        case = next(c for c in results.cases if c.scenario.name == scenario)
        axes[0, 0].set_xlim(*(span or (0.0, _last(results, case))))
        for axis in axes[:, 0]:
            bands(axis, results, scenario, title=axis is axes[0, 0], axle=axle)
        axes[-1, 0].set_xlabel("time [s]")
        if len(entries) > 1:
            loops_first = list(dict.fromkeys([*(n for n in chosen if n in entries), *entries]))
            fig.legend([entries[n] for n in loops_first], loops_first, ncols=min(len(entries), 6),
                       loc="outside upper center")  # fmt: skip
    return fig


def _references(
    axis: Axes, results: Results, logs: Mapping[str, Any], wanted: str,
    span: tuple[float, float] | None, entries: dict[str, Any],
) -> None:  # fmt: skip
    """Draw a reference or a bound in thin grey, once where all loops have the same."""
    found = {loop: n for loop, log in logs.items() if (n := seen.logged_name(results, log, wanted))}
    drawn: list[np.ndarray] = []
    for loop, name in found.items():
        values = logs[loop][name].values
        if any(np.array_equal(values, d) for d in drawn):
            continue
        drawn.append(values)
        said = seen.short_meaning(logs[loop][name], name)
        curve = seen.samples(logs[loop], name, span)
        line = stroke(axis, curve, color=GREY, ls=(0, (4, 2)), lw=0.9, zorder=3, label=said)
        entries.setdefault(said, line)


def speeds(results: Results, scenario: str, loops: Sequence[str]) -> Figure:
    """Speed of the vehicle and of its rim over time, a panel for each loop.

    The rim of a vehicle with several axles is that of the axle which slips most; the rail is shaded
    as this axle is on it. All panels have one axis of speeds.
    """
    logs = {loop: results.log(scenario, loop) for loop in loops}
    fig, axes = panels(len(loops), height=1.5, sharex=True, sharey=True)
    roles, hues = results.study.signals, hues_of(list(results.data[scenario]))
    case = next(c for c in results.cases if c.scenario.name == scenario)
    axle = seen.chosen_axle(results, logs, ["slip"])
    with style():
        for axis, (loop, log) in zip(axes[:, 0], logs.items(), strict=True):
            t, v = seen.samples(log, roles.find("speed", log), None)
            slip = roles.find("slip", log)
            by_ratio = log[slip].attrs.get("units") != "m/s"

            def rim(s: Any, v: Any = v, by_ratio: bool = by_ratio, log: Any = log) -> Any:
                s = roles.slip_sign(log) * s
                return v * (1 - s) if by_ratio else v - s

            s = seen.samples(log, slip, None, axle or 0)[1]
            line = stroke(axis, (t, rim(s)), color=hues[loop], label=f"rim, {loop}")
            every = seen.each_axle(log, slip, None)
            if every is not None:
                live.axles(line, t, rim(every, v=v[:, None]))
            stroke(axis, (t, v), color=GREY, lw=0.9, ls=(0, (4, 2)), label="vehicle")
            of = f", axle {axle + 1}" if axle is not None else ""
            axis.set_ylabel(label(f"speed{of}", "m/s"))
            axis.set_xlim(0.0, _last(results, case))
            bands(axis, results, scenario, title=axis is axes[0, 0], axle=axle, loop=loop)
        axes[-1, 0].set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.legend()
    return fig


def chatter(
    axis: Axes,
    signals: Mapping[str, tuple[np.ndarray, np.ndarray]],
    y: tuple[str, str],
    title: str = "",
    columns: int = 300,
) -> None:
    """Signals that chatter, over time in s: means as lines over what they cover, hiding no other.

    Args:
        axis: where.
        signals: times and values of each, by the loop's name.
        y: what it is, and its unit.
        title: above the panel.
        columns: parts of the time of which each mean and range is; the mean of a ripple is even
            where each part is whole periods of it.
    """
    with style():
        for name, (t, values) in signals.items():
            area(axis, t, values, min(columns, len(t)), color=colour(name), label=name)
        axis.set_xlabel(label("time", "s"))
        axis.set_ylabel(label(*y))
        axis.set_title(title)
        axis.margins(x=0.0)
        if len(signals) > 1:
            axis.legend()


def _last(results: Results, case: Case) -> float:
    """Time in s at which the last run of a scenario ended."""
    logs = results.data.get(case.scenario.name, {})
    if case.scenario.end is None or not logs:
        return case.scenario.duration
    return max(float(log["time"].values[-1]) for log in logs.values())


def bands(
    axis: Axes, results: Results, scenario: str, title: bool = True, axle: int | None = None,
    loop: str = "",
) -> None:  # fmt: skip
    """Shade the rail conditions behind a panel over time and name them above it.

    Args:
        axis, results, scenario: where, of what.
        title: whether they are named.
        axle: from 0 on, the one whose rail it is; None is where the vehicle is.
        loop: whose run it is; the first one where none is given.
    """
    case = next(c for c in results.cases if c.scenario.name == scenario)
    rail = case.scenario.rail
    if rail is None or len(rail.sections) < 2:
        return
    logs = results.data.get(scenario, {})
    log = logs.get(loop) or next(iter(logs.values()))

    def spans(of: int | None) -> list[tuple[float, float]]:
        changes = list(log.attrs.get("rail_changes_s", []))
        if of is not None and rail.by != "time":
            changes = seen.arrivals(results, log, list(rail.starts[1:]), of) or changes
        starts = [0.0, *changes]
        return list(zip(starts, [*starts[1:], _last(results, case)], strict=True))

    many = _axles(results, log) if axle is not None and rail.by != "time" else 0
    conditions = [s.condition or "" for s in rail.sections]
    names = [c.replace("_", " ") for c in conditions]
    hues = [looks.RAILS.get(c.partition("_")[0], "#FFFFFF") for c in conditions]
    if many:
        told = names if title else [""] * len(names)
        live.bands(axis, [
            [(*ends, hue, name) for ends, hue, name in zip(spans(k), hues, told, strict=False)]
            for k in range(many)
        ])  # fmt: skip
    ends = spans(axle)
    left, right = axis.get_xlim()
    for hue, name, (a, b) in zip(hues, names, ends, strict=False):
        a, b = max(a, left), min(b, right)
        if a >= b:
            continue
        axis.axvspan(a, b, color=hue, lw=0, zorder=-5)
        if a > left:
            axis.axvline(a, color="#AAAAAA", lw=0.7, zorder=-4)
        if title and name:
            axis.annotate(name, ((a + b) / 2, 1.0),
                          xycoords=("data", "axes fraction"), xytext=(0, 2),
                          textcoords="offset points", ha="center", va="bottom",
                          fontsize=8, color="#555555")  # fmt: skip
    axis.set_xlim(left, right)


def _axles(results: Results, log: Any) -> int:
    """Axles of a run, by its slip."""
    name = results.study.signals.find("slip", log)
    return int(np.prod(log[name].shape[1:], dtype=int)) if name else 0


def lines(
    curves: Mapping[str, tuple[Any, Any]],
    x: tuple[str, str],
    y: tuple[str, str],
    *,
    axis: Axes | None = None,
    log: str = "",
    marks: Mapping[str, tuple[float, float]] | None = None,
    title: str = "",
    points: bool = False,
    legend: bool = True,
) -> Figure:
    """Curves by name, ``{"sta": (times, values)}``; a loop's name has the loop's colour.

    Args:
        curves: abscissa and ordinate of each curve.
        x, y: what the axes are, and their units.
        axis: draw here instead of in a new figure.
        log: ``"x"``, ``"y"`` or ``"xy"`` for logarithmic axes.
        marks: points to mark, by name.
        title: above the panel.
        points: show the points of each curve.
        legend: name the curves, where there is more than one.
    """
    fig, axis = looks.panel_of(axis, 3.2)
    with style():
        hues = hues_of(list(curves))
        long = {n: (xs, _seen(ys, "y" in log)) for n, (xs, ys) in curves.items()
                if len(np.atleast_1d(xs)) > 1}  # fmt: skip
        lines_of: dict[str, Any] = looks.line_styles([long], list(long))
        for name, (xs, ys) in curves.items():
            own = _line(name, hues)
            dashes = lines_of.get(name, own) if own == "-" else own
            whole = np.asarray(xs), np.asarray(ys)
            if not points and len(np.atleast_1d(xs)) > 1:
                xs, ys = envelope(*whole)
            line = axis.plot(xs, ys, color=hues[name], ls=dashes, label=name,
                             marker="o" if points else None, ms=3)[0]  # fmt: skip
            if whole[0].ndim == whole[1].ndim == 1:
                live.exact(line, *whole)
        for name, (px, py) in (marks or {}).items():
            axis.plot([px], [py], "o", color=hues.get(name, BLACK), ms=5, zorder=5)
        if "x" in log:
            axis.set_xscale("log")
        if "y" in log:
            axis.set_yscale("log")
        axis.set_xlabel(label(*x))
        axis.set_ylabel(label(*y))
        axis.set_title(title)
        axis.margins(x=0.02 if points else 0.0)
        if len(curves) > 1 and legend:
            axis.legend()
    return fig


def _seen(ys: Any, logarithmic: bool) -> np.ndarray:
    """Ordinates as they are seen; what a logarithmic axis does not show is NaN."""
    height = np.asarray(ys, dtype=float)
    if not logarithmic:
        return height
    return np.log10(height, out=np.full(height.shape, np.nan), where=height > 0)


def _line(name: str, hues: Mapping[str, str]) -> Any:
    """Solid, but for a loop whose colour occurs twice, and for the bound."""
    return dash(name, list(hues)) if hues[name] == colour(name) else "-"


def laws(
    law: Block,
    conditions: Mapping[str, Mapping[str, float]] | None = None,
    *,
    upto: float = 10.0,
    peaks: Mapping[str, tuple[float, float]] | None = None,
    axis: Axes | None = None,
    title: str = "",
) -> Figure:
    """An adhesion law, one curve per rail condition.

    Args:
        law: from slip, its first input, to adhesion, its first output.
        conditions: parameters by condition; otherwise those that the law declares.
        upto: largest slip, from 0 on.
        peaks: place and height of the peak by condition, to be marked.
        axis: draw here instead of in a new figure.
        title: above the panel.
    """
    import casadi as ca

    slip = next(iter(law.inputs.values()))
    out = next(iter(law.outputs.values()))
    at = np.linspace(0.0, upto, 401)
    rest = {n: s.value if s.value is not None else 0.0 for n, s in law.inputs.items()}
    curves = {}
    for name, values in (conditions or law.conditions or {law.name: {}}).items():
        p = law.pack("param", law.param_values(**values))
        columns = [at if n == slip.name else np.full(at.size, float(v)) for n, v in rest.items()]
        given = ca.DM(0, at.size), ca.DM(np.array(columns)), ca.repmat(p, 1, at.size)
        y = law.f.map(at.size)(*given)
        index = list(law.outputs).index(out.name)
        curves[name] = (at, np.array(y[1]).reshape(-1, at.size)[index])
    across, up = (s.doc.partition(",")[0] or s.name for s in (slip, out))
    return lines(curves, (across, slip.unit), (up, out.unit), axis=axis, marks=peaks, title=title)


def bars(
    groups: Mapping[str, Mapping[str, float | None]],
    y: tuple[str, str],
    *,
    axis: Axes | None = None,
    log: bool = False,
    title: str = "",
    limit: tuple[str, float] | None = None,
) -> Figure:
    """Grouped bars, ``{"base": {"smc": 1.0, "sta": 0.2}}``; a value of None is left out.

    Args:
        groups: values by group (below the axis) and member (in the legend).
        y: what it is, and its unit.
        axis: draw here instead of in a new figure.
        log: logarithmic values.
        title: above the panel.
        limit: name and height of a line to compare with.
    """
    fig, axis = looks.panel_of(axis, 2.8)
    members = list(dict.fromkeys(m for group in groups.values() for m in group))
    hues = hues_of(members)
    width = 0.8 / max(len(members), 1)
    with style():
        for k, member in enumerate(members):
            at = [g + (k - (len(members) - 1) / 2) * width for g in range(len(groups))]
            heights = [group.get(member) for group in groups.values()]
            seen = [(a, h) for a, h in zip(at, heights, strict=True) if h is not None]
            if seen:
                places, tops = zip(*seen, strict=True)
                hatch = "///" if "_printed" in member else None
                axis.bar(places, tops, 0.9 * width, color=hues[member], label=member, hatch=hatch,
                         edgecolor="white", lw=0)  # fmt: skip
        limit_line(axis, limit)
        axis.set_xticks(range(len(groups)), looks.names_below(groups))
        axis.grid(visible=False, axis="x")
        if log:
            looks.logarithmic(axis)
        axis.set_ylabel(label(*y))
        axis.set_title(title)
        if len(members) > 1:
            axis.legend(ncols=min(len(members), 4))
    return fig


def _wrap(text: str, width: int = 24) -> str:
    """Break a long label once, at the space nearest to its middle."""
    if len(text) <= width:
        return text
    spaces = [k for k, c in enumerate(text) if c == " "]
    if not spaces:
        return text
    at = min(spaces, key=lambda k: abs(k - len(text) / 2))
    return f"{text[:at]}\n{text[at + 1 :]}"


# ---- files --------------------------------------------------------------------------------------


def load() -> None:
    """Import what drawing needs, ahead of the first figure."""
    import matplotlib.figure  # noqa: F401

    import slipctl.draw.figure_files  # noqa: F401


def svg_text(fig: Figure, stamp: str = "") -> str:
    """Figure as SVG, the same text every time; ``stamp`` is what it says of itself."""
    from slipctl.draw import figure_files

    return figure_files.svg_text(fig, stamp)


def mark_quick(fig: Figure) -> None:
    """Say on the figure that it comes from a quick run."""
    with style():
        fig.text(0.997, 0.997, "quick", ha="right", va="top", fontsize=8, color=ORANGE,
                 weight="bold")  # fmt: skip


def save(fig: Figure, folder: Path, stem: str, stamp: str = "") -> str:
    """Write a figure as PNG and SVG; gives the SVG."""
    from slipctl.draw import figure_files

    return figure_files.save(fig, folder, stem, stamp)
