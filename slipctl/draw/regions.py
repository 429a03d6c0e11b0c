"""Regions of a plane, each in its colour, with lines between them and a point in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from slipctl.draw import looks, plots


def regions(
    codes: np.ndarray, colours: Sequence[str], labels: Sequence[str], edges: Sequence[np.ndarray],
    names: Sequence[str], logarithmic: Sequence[bool], point: Sequence[Any] | None, title: str,
) -> plots.Figure:  # fmt: skip
    """Draw cells by the number of their region.

    Args:
        codes: a row for each cell upwards, a number for each along it.
        colours, labels: of the regions; one without a label is not in the legend.
        edges: of the cells, along and upwards. names: of both axes. logarithmic: which are.
        point: drawn as a star; None draws none.
        title: above the panel.
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
        if point is not None:
            axis.plot(*point, "*", color="#1a1a1a", ms=12, mec="white", mew=0.8)
        axis.set_xlim(xs[0], xs[-1])
        axis.set_ylim(ys[0], ys[-1])
        axis.set_xlabel(names[0])
        axis.set_ylabel(names[1])
        axis.set_title(title)
        seen = [k for k in sorted(set(codes.ravel().tolist())) if labels[k]]
        axis.legend(handles=[
            Patch(facecolor=colours[k], edgecolor="#6b6b6b", label=labels[k]) for k in seen
        ])  # fmt: skip
    return fig


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
