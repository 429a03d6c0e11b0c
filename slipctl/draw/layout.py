"""Where the panels of a figure stand: as large as their labels leave room for, measured once.

Matplotlib's own constrained layout measures every text twice and solves a program for places that
rows and columns give directly; it took a fifth of the time of a figure. Imported when something is
drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.layout_engine import LayoutEngine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAD = 3 / 72
"""Room in inches around a panel with its labels."""

LEFT, TITLE, MARKS, NAMES = 0.63, 0.24, 0.27, 0.45
"""Room in inches of labels before they are measured: the marks of an axis go by its length."""


class Grid(LayoutEngine):
    """Panels in rows and columns, as large as the figure lets them be; its legends stand above."""

    _adjust_compatible = False
    _colorbar_gridspec = False

    def execute(self, fig: Figure, ink: Any = None) -> None:
        """Place the panels; ``ink`` is what draws, of which the sizes of letters are asked."""
        ink = RendererAgg(1, 1, fig.dpi) if ink is None else ink
        panels = [_Panel(axis, *cell) for axis in fig.axes if (cell := _cell(axis)) is not None]
        if not panels:
            return
        boxes = [legend.get_tightbbox(ink) for legend in fig.legends if legend.get_in_layout()]
        above = sum([box.height / fig.dpi + 2 * PAD for box in boxes if box is not None], 0.0)
        _place(fig, panels, _guessed(panels), above)
        for _ in range(2):  # longer or shorter axes may have other marks: measured once more then
            marks = [_marks(panel.axis) for panel in panels]
            _place(fig, panels, _measured(panels, ink, fig.dpi), above)
            if marks == [_marks(panel.axis) for panel in panels]:
                return


class _Panel(NamedTuple):
    """A panel and its row and column."""

    axis: Axes
    row: int
    column: int


Sides = dict[str, np.ndarray]
"""Room in inches at the left and right of each column, above and below each row."""


def _cell(axis: Axes) -> tuple[int, int] | None:
    """Row and column of a panel; None where somebody has placed it by hand."""
    place: Any = axis.get_subplotspec()
    return None if place is None else (place.rowspan.start, place.colspan.start)


def _marks(axis: Axes) -> list[list[float]]:
    """Where the marks of a panel stand."""
    return [list(a.get_majorticklocs()) for a in (axis.xaxis, axis.yaxis)]


def _least(panels: list[_Panel]) -> Sides:
    """Room around panels that have no labels."""
    rows, columns = 1 + max(p.row for p in panels), 1 + max(p.column for p in panels)
    across = dict.fromkeys(("left", "right"), columns) | dict.fromkeys(("top", "bottom"), rows)
    return {side: np.full(many, PAD) for side, many in across.items()}


def _guessed(panels: list[_Panel]) -> Sides:
    """Room of labels as it often is."""
    sides = _least(panels)
    sides["left"][:] = LEFT
    for axis, row, _ in panels:
        if axis.get_title(loc="left"):
            sides["top"][row] = TITLE
        if axis.xaxis.get_tick_params().get("labelbottom", True):
            sides["bottom"][row] = NAMES if axis.get_xlabel() else MARKS
    return sides


def _measured(panels: list[_Panel], ink: Any, dpi: float) -> Sides:
    """Room that the labels of the panels take."""
    sides = _least(panels)
    for axis, row, column in panels:
        own, all_ = axis.get_window_extent(ink), axis.get_tightbbox(ink)
        if all_ is None:
            continue
        for side, at, room in (
            ("left", column, own.x0 - all_.x0), ("right", column, all_.x1 - own.x1),
            ("top", row, all_.y1 - own.y1), ("bottom", row, own.y0 - all_.y0),
        ):  # fmt: skip
            sides[side][at] = max(sides[side][at], room / dpi + PAD)
    return sides


def _place(fig: Figure, panels: list[_Panel], sides: Sides, above: float) -> None:
    """Place the panels between their labels; sizes in inches."""
    width, height = fig.get_size_inches()
    grid: Any = panels[0].axis.get_gridspec()
    x, wide = _along(sides["left"], sides["right"], grid.get_width_ratios(), width)
    y, high = _along(sides["top"], sides["bottom"], grid.get_height_ratios(), height - above)
    for axis, row, column in panels:
        low = height - above - y[row] - high[row]
        place = x[column] / width, low / height, wide[column] / width, high[row] / height
        axis.set_position(place)


def _along(
    before: np.ndarray, after: np.ndarray, shares: Any, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where panels begin along a length, and how long they are."""
    parts = np.asarray(shares, dtype=float)[: len(before)]
    left = max(length - before.sum() - after.sum(), 0.1 * len(parts))
    sizes = left * parts / parts.sum()
    return np.cumsum(before) + np.cumsum(after) - after + np.cumsum(sizes) - sizes, sizes
