"""How numbers of many runs are spread: runs as dots beside a limit, paired differences.

What a run never reached is infinite. Such a run has its dot above all others, in a strip that says
how many there are, and counts in quartiles and median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from slipctl.draw import looks
from slipctl.run.sweep.spread import quantiles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GOLDEN = 0.618034
"""Step of the places of dots beside each other: they spread evenly, always the same."""


def spread(
    groups: Mapping[str, Sequence[float]],
    y: tuple[str, str],
    *,
    axis: Axes | None = None,
    log: bool = False,
    title: str = "",
    limit: tuple[str, float] | None = None,
) -> Figure:
    """Spread of many runs: every run a dot, the middle half a box, the median a line.

    Args:
        groups: values by group; a loop's name has the loop's colour. None and NaN are left out,
            infinite values are runs that never came to one.
        y: what it is, and its unit.
        axis: draw here instead of in a new figure.
        log: logarithmic values.
        title: above the panel.
        limit: name and height of a line to compare with.
    """
    fig, axis = looks.panel_of(axis, 2.8)
    hues = looks.hues_of(list(groups))
    columns = {n: np.array([np.nan if x is None else x for x in v], dtype=float)
               for n, v in groups.items()}  # fmt: skip
    with looks.style():
        if log:
            looks.logarithmic(axis)
        for k, (name, values) in enumerate(columns.items()):
            _dots(axis, k, values[np.isfinite(values)], hues[name])
        limit_line(axis, limit)
        top = _top(axis, columns)
        for k, values in enumerate(columns.values()):
            _box(axis, k, values, top)
            never = int(np.isinf(values).sum())
            if never:
                axis.plot([k], [top], "x", color=looks.ORANGE, ms=5, mew=1.4, clip_on=False)
                axis.annotate(f"{never} of {np.count_nonzero(~np.isnan(values))} never", (k, top),
                              xytext=(6, 0), textcoords="offset points", va="center", fontsize=8,
                              color=looks.ORANGE)  # fmt: skip
        axis.set_xticks(range(len(groups)), looks.names_below(groups))
        axis.set_xlim(-0.6, len(groups) - 0.4)
        axis.grid(visible=False, axis="x")
        axis.set_ylabel(looks.label(*y))
        axis.set_title(title)
    return fig


def _dots(axis: Axes, k: int, v: np.ndarray, hue: str) -> None:
    shift = (np.arange(len(v)) * GOLDEN) % 1 - 0.5
    axis.plot(k + 0.3 * shift, v, "o", ms=2.5 + 20 / (8 + len(v)), color=hue, alpha=0.55, mew=0)


def _top(axis: Axes, columns: Mapping[str, np.ndarray]) -> float:
    """Height at which runs stand that never came: above all others, where there are any."""
    if not any(np.isinf(v).any() for v in columns.values()):
        return float("nan")
    low, high = axis.get_ylim()
    top = high * (high / low) ** 0.08 if axis.get_yscale() == "log" else high + 0.08 * (high - low)
    axis.axhline((high * top) ** 0.5 if axis.get_yscale() == "log" else (high + top) / 2,
                 color=looks.GREY, lw=0.6, ls=(0, (1, 2)))  # fmt: skip
    axis.set_ylim(low, top)
    return top


def _box(axis: Axes, k: int, values: np.ndarray, top: float) -> None:
    low, middle, high = quantiles(values, [0.25, 0.5, 0.75])
    if np.isnan(middle):
        return
    low, middle, high = (min(v, top) if np.isinf(v) else v for v in (low, middle, high))
    axis.bar(k, high - low, 0.44, bottom=low, color="none", edgecolor=looks.BLACK, lw=0.9)
    axis.hlines(middle, k - 0.22, k + 0.22, color=looks.BLACK, lw=1.8)


def differences(
    groups: Mapping[str, Sequence[float]], base: str, y: tuple[str, str], *, axis: Axes,
    title: str = "",
) -> None:  # fmt: skip
    """Differences of runs on the same draws, in order; one curve for each group.

    Args:
        groups: differences by loop; infinite ones are not drawn and counted in the legend.
        base: the loop that they are counted from.
        y: what it is, and its unit.
        axis: where.
        title: above the panel.
    """
    hues = looks.hues_of([base, *groups])
    with looks.style():
        for name, values in groups.items():
            d = np.sort(np.asarray(values, dtype=float)[~np.isnan(values)])
            share = (np.arange(d.size) + 0.5) / max(d.size, 1) * 100
            seen = np.isfinite(d)
            lost, won = np.count_nonzero(d == np.inf), np.count_nonzero(d == -np.inf)
            said = f"{name} - {base}" + (f"; {lost} where {name} never came" if lost else "")
            said += f"; {won} where {base} never came" if won else ""
            size = 4 + 40 / (8 + d.size)
            axis.plot(share[seen], d[seen], ".", ms=size, color=hues[name], label=said)
        axis.axhline(0, color=looks.BLACK, lw=0.9)
        axis.set_xlim(0, 100)
        axis.set_xlabel(looks.label("share of the draws", "%"))
        axis.set_ylabel(looks.label(*y))
        axis.set_title(title)
        axis.legend()


def limit_line(axis: Axes, limit: tuple[str, float] | None) -> None:
    """Line to compare with, and its name."""
    if limit is not None:
        axis.axhline(limit[1], color=looks.BLACK, lw=0.9, ls=(0, (4, 2)))
        axis.annotate(
            limit[0], (1.0, limit[1]), xycoords=("axes fraction", "data"), xytext=(0, 2),
            textcoords="offset points", ha="right", fontsize=8,
        )  # fmt: skip
