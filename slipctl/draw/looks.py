"""How figures look: colours, lines and legends, the same in every study; nothing is hidden.

A curve that lies on another one is dashed, and no legend lies on a curve.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

BLACK, BLUE, ORANGE, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, SKY, AMBER, GREY = "#CC79A7", "#56B4E9", "#E69F00", "#7F7F7F"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER)
"""Colours that a colour-blind reader tells apart (after Okabe and Ito)."""

MORE = ("#8C564B", "#882255", "#117733", "#332288", "#999933")
"""Colours for more loops beside each other than the palette has."""

COLOURS = {
    "ideal": BLACK, "smc": ORANGE, "smes": ORANGE, "none": ORANGE, "pid": AMBER,
    "sta": BLUE, "super_twisting": BLUE, "hosm": BLUE, "eppfc": BLUE, "improved": BLUE,
    "sta_online": GREEN, "mpc": GREEN, "nmpc": GREEN, "predictive": GREEN, "esa": GREEN,
    "asmc": PURPLE, "fixed": PURPLE, "robust": SKY, "efc": SKY,
}  # fmt: skip
"""Loops whose colour is fixed; any other name gets one of the palette by its letters."""

RAILS = {"dry": "#F7EFE2", "wet": "#E4EEF6", "ice": "#F1F1F1", "snow": "#EDEDED",
         "leaves": "#EAD6B0"}  # fmt: skip
"""Shades of the bands behind a trace; any other condition stays white."""

STYLE: Any = {
    "figure.dpi": 100,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.prop_cycle": f"cycler(color={list(PALETTE)})",
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "svg.hashsalt": "slipctl",
    "svg.fonttype": "path",
    "path.simplify": True,
}

WIDTH, HEIGHT = 7.0, 1.9
"""Size in inches of a figure and of one of its panels."""


def colour(name: str) -> str:
    """Colour of a loop, the same in every study; ``sta_printed`` has that of ``sta``."""
    stem = _stem(name)
    for known in (name, stem):
        if known in COLOURS:
            return COLOURS[known]
    return PALETTE[int(hashlib.sha256(stem.encode()).hexdigest(), 16) % len(PALETTE)]


def hues_of(names: Sequence[str]) -> dict[str, str]:
    """Loops have their colour; other names take the palette in order.

    No two loops have one colour, as long as there are enough; ``sta_printed`` has that of ``sta``.
    """
    if not any(n in COLOURS or n.partition("_")[0] in COLOURS for n in names):
        return {n: PALETTE[k % len(PALETTE)] for k, n in enumerate(names)}
    by_stem: dict[str, str] = {}
    for fixed in (True, False):  # those of a fixed colour choose first
        for stem in (_stem(n) for n in names if _fixed(n) is fixed):
            own = COLOURS.get(stem) if fixed else None
            left = [c for c in (own, *PALETTE, *MORE) if c and c not in by_stem.values()]
            by_stem.setdefault(stem, left[0] if left else colour(stem))
    return {n: by_stem[_stem(n)] for n in names}


def _fixed(name: str) -> bool:
    """Whether a loop has a colour of its own in every study."""
    return name in COLOURS or _stem(name) in COLOURS


def _stem(name: str) -> str:
    return re.sub(
        r"_(printed|corrected|robust|real|explicit|implicit|proper_implicit|limited).*$", "", name
    )


def dash(name: str, beside: Sequence[str] = ()) -> Any:
    """Line of a loop: dotted for the bound, dashed where another one beside it has its colour."""
    if name == "ideal":
        return (0, (1, 1))
    same = [n for n in beside if colour(n) == colour(name)]
    return (0, (4, 1.5)) if name in same[1:] else "-"


@contextmanager
def style() -> Iterator[None]:
    """Draw in the one style."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        yield


def panels(rows: int = 1, columns: int = 1, *, height: float = HEIGHT, **options: Any) -> Any:
    """New figure with panels in the one style.

    Returns:
        The figure and its axes, an array of rows by columns.
    """
    from matplotlib.figure import Figure

    from slipctl.draw.layout import Grid

    with style():
        size = (WIDTH, height * rows + 0.4)
        fig = Figure(figsize=size, layout=Grid())
        axes = fig.subplots(rows, columns, squeeze=False, **options)
    for axis in axes.flat:
        for spine in axis.spines.values():
            spine.set_in_layout(False)  # measuring one asks for all marks again
    return fig, axes


def panel_of(axis: Axes | None, height: float) -> tuple[Any, Axes]:
    """Figure of a panel and the panel; a new one where none is given."""
    if axis is not None:
        return axis.get_figure(), axis
    fig, axes = panels(height=height)
    return fig, axes[0, 0]


def label(what: str, unit: str) -> str:
    """Label of an axis: what it is and its unit."""
    return f"{what} [{pretty(unit)}]" if unit not in ("", "1") else what


def pretty(unit: str) -> str:
    """Unit as a reader expects it: ``m/s^2`` as m/s²."""
    raised = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
    text = re.sub(r"\^(-?\d+)(?![.\d])", lambda m: m[1].translate(raised), unit)
    text = re.sub(r"(?<=[a-zA-Z])([234])\b", lambda m: m[1].translate(raised), text)
    return text.replace("*", "·")


DASHES: tuple[Any, ...] = ("-", (0, (5, 2.5)), (0, (2, 4)))
"""Lines of curves that lie on each other: what is below shows between the dashes on top."""

SAME = 0.008
"""Share of the height of a panel within which two curves look like one."""


def covered_curves(
    curve: tuple[Any, Any], below: Sequence[tuple[Any, Any]], height: float | None = None
) -> int:
    """On how many curves one lies for a fifth of its length or more; it is to be dashed.

    Args:
        curve: abscissa, which rises, and ordinate.
        below: the curves that are drawn before it.
        height: of the panel in units of the ordinate; None is what the curves take.
    """
    x, y = (np.asarray(part, dtype=float) for part in curve)
    if len(x) < 3:
        return 0
    others = [(np.asarray(xs, dtype=float), np.asarray(ys, dtype=float)) for xs, ys in below]
    if height is None:
        height = _height([(x, y), *others])
    found = 0
    for xs, ys in others:
        if len(xs) > 2:
            there = y if len(xs) == len(x) and np.array_equal(xs, x) else None
            beside = ys if there is not None else np.interp(x, xs, ys, np.nan, np.nan)
            near = np.abs(beside - y) <= SAME * height
            found += int(np.mean(near) >= 0.2)
    return found


def line_styles(panels: Sequence[Mapping[str, Any]], order: Sequence[str]) -> dict[str, Any]:
    """Line of each curve, the same in all panels: one that lies on another has more gaps than it.

    Args:
        panels: the curves of each panel by name, abscissa and ordinate.
        order: the names, first what is drawn first.
    """
    heights = [_height(panel.values()) for panel in panels]

    def lies_on(name: str, other: str) -> bool:
        return any(
            name in panel and other in panel and covered_curves(panel[name], [panel[other]], height)
            for panel, height in zip(panels, heights, strict=True)
        )

    found: dict[str, int] = {}
    for name in order:
        below = [gaps for other, gaps in found.items() if lies_on(name, other)]
        found[name] = min(max(below, default=-1) + 1, len(DASHES) - 1)
    return {name: DASHES[gaps] for name, gaps in found.items()}


def _height(curves: Iterable[tuple[Any, Any]]) -> float:
    """What curves take of the height of their panel, in units of the ordinate."""
    every = np.concatenate([np.asarray(y, dtype=float).ravel() for _, y in curves] or [np.zeros(1)])
    every = every[np.isfinite(every)]
    return float(np.ptp(every)) if len(every) else 0.0


def one_line(axes: Iterable[Axes]) -> None:
    """Give what has one name and colour in several panels one line, that with the most gaps."""
    gaps = {str(_pattern(dashes)): k for k, dashes in enumerate(DASHES)}
    found: dict[tuple[str, str], list[Any]] = {}
    for axis in axes:
        for line in axis.get_lines():
            if str(line.get_label())[:1] != "_" and _dashes(line) in gaps:
                found.setdefault((str(line.get_label()), str(line.get_color())), []).append(line)
    for lines in found.values():
        most = max(gaps[_dashes(line)] for line in lines)
        for line in lines:
            if gaps[_dashes(line)] < most:
                line.set_linestyle(DASHES[most])


def _pattern(dashes: Any) -> Any:
    """As matplotlib holds it."""
    return (0, None) if dashes == "-" else (dashes[0], list(dashes[1]))


def _dashes(line: Any) -> str:
    """How a line is dashed, as text."""
    offset, marks = getattr(line, "_unscaled_dash_pattern", (0, None))
    return str((int(offset), None if marks is None else list(marks)))


def _told(axis: Any) -> tuple[Sequence[Any], Sequence[str]]:
    """What the legend of a panel shows, and what it says of it."""
    legend = axis.get_legend()
    names = [text.get_text() for text in legend.get_texts()]
    handles, known = axis.get_legend_handles_labels()
    return (handles if known == names else legend.legend_handles), names


def legends_aside(fig: Figure) -> None:
    """Take the legends off the panels, so that none lies on a curve.

    Where a name means the same line in all panels there is one legend above the figure. The legend
    of one panel alone stands above that panel. Else each panel has its own, below it if all stand
    in a row, or else at its right.
    """
    one_line(fig.axes)
    own = [a for a in fig.axes if a.get_legend() is not None]
    if not own:
        return
    entries: dict[str, Any] = {}
    looks: dict[Any, str] = {}
    one = not fig.legends
    for axis in own:
        for handle, name in zip(*_told(axis), strict=True):
            hue = getattr(handle, "get_color", lambda: None)()
            look = (str(hue), _dashes(handle))
            first = entries.setdefault(name, handle)
            one &= hue is None or getattr(first, "get_color", lambda: None)() == hue
            one &= hue is None or looks.setdefault(look, name) == name
    tops = {round(a.get_position().y1, 3) for a in fig.axes}
    beside = len(tops) > 1  # below panels in a row there is room, of which the figure gets more
    if not one and not beside:
        width, height = fig.get_size_inches()
        fig.set_size_inches(width, height + 0.17 * max(len(_told(a)[1]) for a in own))
    alone = one and beside and len(own) == 1 and own[0] is not fig.axes[0]
    with style():
        if alone:
            (axis,) = own
            handles, names = _told(axis)
            axis.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0),
                        ncols=_columns(fig, names))  # fmt: skip
            return
        for axis in own:
            handles, names = _told(axis)
            cast("Legend", axis.get_legend()).remove()
            if not one and beside:
                axis.legend(handles, names, loc="upper left", bbox_to_anchor=(1.0, 1.0))
            elif not one:
                axis.legend(handles, names, loc="upper left", bbox_to_anchor=(-0.1, -0.2))
        if one:
            fig.legend(entries.values(), entries.keys(), ncols=_columns(fig, list(entries)),
                       loc="outside upper center")  # fmt: skip


def _columns(fig: Figure, names: Sequence[str]) -> int:
    """Columns of a legend as wide as the figure, of which an inch holds about 13 letters."""
    rows = -(-sum(len(n) + 6 for n in names) // int(13 * fig.get_size_inches()[0]))
    return -(-len(names) // rows)


def names_below(groups: Mapping[str, Any]) -> list[str]:
    """Names below an axis, of which none touches another.

    Of many, a long one goes over two lines; of more than ten, each second one stands lower.
    """
    many = len(groups) > 6
    if len(groups) > 10:
        return [("\n" if k % 2 else "") + n for k, n in enumerate(groups)]
    return [n.replace("_", "_\n", 1) if many and len(n) > 9 else n for n in groups]


def logarithmic(axis: Axes, along: Literal["x", "y"] = "y") -> None:
    """Logarithmic scale, marked 1, 2, 5 and in plain numbers, so that no mark is on another."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set(**{f"{along}scale": "log"})
    scale = axis.xaxis if along == "x" else axis.yaxis
    scale.set_minor_locator(LogLocator(subs=(2, 5)))
    plain = FuncFormatter(lambda x, _: f"{x:g}")
    scale.set_major_formatter(plain)
    scale.set_minor_formatter(plain)
