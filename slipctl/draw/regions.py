"""Regions of a plane, each in its colour, with lines between them and a point in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from slipctl.draw import looks, plots

LINES = 8
"""Level lines that are drawn, about."""

INK = "#7A1F5C"
"""Of level lines."""


def regions(
    codes: np.ndarray, colours: Sequence[str], labels: Sequence[str], edges: Sequence[np.ndarray],
    names: Sequence[str], logarithmic: Sequence[bool], point: Sequence[Any] | None, title: str,
    levels: tuple[Sequence[np.ndarray], np.ndarray, str] | None = None,
) -> plots.Figure:  # fmt: skip
    """Draw cells by the number of their region.

    Args:
        codes: a row for each cell upwards, a number for each along it.
        colours, labels: of the regions; one without a label is not in the legend.
        edges: of the cells, along and upwards. names: of both axes. logarithmic: which are.
        point: drawn as a star; None draws none.
        title: above the panel.
        levels: places along both axes, a quantity there, and its label; drawn as level lines.
    """
    xs, ys = edges
    fig, axes = plots.panels(height=4.2)
    axis = axes[0, 0]
    with looks.style():
        axis.pcolormesh(xs, ys, codes, cmap=ListedColormap(list(colours)),
                        vmin=-0.5, vmax=len(colours) - 0.5, rasterized=True)  # fmt: skip
        axis.add_collection(LineCollection(_borders(codes, xs, ys), colors="#1a1a1a", lw=0.8))
        for turned, scale in zip(logarithmic, (axis.set_xscale, axis.set_yscale), strict=True):
            if turned:
                scale("log")
        lines = []
        if levels is not None and np.isfinite(levels[1]).any():
            (x, y), z, label = levels
            drawn = axis.contour(x, y, np.ma.masked_invalid(z), _heights(z), colors=INK,
                                 linewidths=0.9)  # fmt: skip
            halo = [withStroke(linewidth=2.5, foreground="white")]
            drawn.set_path_effects(halo)
            for text in axis.clabel(drawn, fontsize=7, fmt="%.4g"):
                text.set_path_effects(halo)
            lines.append(Line2D([], [], color=INK, lw=0.9, label=label))
        if point is not None:
            axis.plot(*point, "*", color="#1a1a1a", ms=12, mec="white", mew=0.8)
        axis.set_xlim(xs[0], xs[-1])
        axis.set_ylim(ys[0], ys[-1])
        axis.set_xlabel(names[0])
        axis.set_ylabel(names[1])
        axis.set_title(title)
        seen = [k for k in sorted(set(codes.ravel().tolist())) if labels[k]]
        axis.legend(handles=[
            *(Patch(facecolor=colours[k], edgecolor="#6b6b6b", label=labels[k]) for k in seen),
            *lines,
        ])  # fmt: skip
    return fig


def _heights(z: np.ndarray) -> Any:
    """Heights of the level lines: evenly spaced, or by ratio where a quantity spans decades."""
    found = z[np.isfinite(z)]
    least, most = float(found.min()), float(found.max())
    if least <= 0 or most < 20 * least:
        return LINES
    ends = np.log10([least, most])
    each = 10.0 ** np.arange(np.floor(ends[0]), np.ceil(ends[1]) + 1)
    steps = np.concatenate([each, 2 * each, 5 * each] if np.ptp(ends) < 3 else [each])
    return np.sort(steps)


def _borders(codes: np.ndarray, xs: np.ndarray, ys: np.ndarray) -> list[Any]:
    """Edges between cells of different regions."""
    upright = [
        [(xs[k + 1], ys[j]), (xs[k + 1], ys[j + 1])]
        for j, k in np.argwhere(codes[:, 1:] != codes[:, :-1])
    ]
    level = [
        [(xs[k], ys[j + 1]), (xs[k + 1], ys[j + 1])]
        for j, k in np.argwhere(codes[1:] != codes[:-1])
    ]
    return upright + level
