"""Curves of a figure over time as plain data, for a page on which it zooms (``live.js``).

What is drawn is read off the figure: its panels, lines and bands. Of a line with many points the
smallest and the largest value of each column are kept, so that nothing of its height is lost. A
curve that another one hides gets a panel with the difference of both.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from slipctl.draw.looks import BLACK, GREY, SAME, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIME = label("time", "s")
"""Label of the axes that this is for."""

ALL = 500_000
"""Bytes that the numbers of all curves of a page take at most, as they stand in it."""

POINTS, LEAST = 6000, 300
"""Points that a curve keeps at most, and at least, whatever the page has."""

HIDDEN = 0.98
"""Share of its length on which a curve lies within the line of another that hides it."""

RANGE = "_range"
"""Label of an area from the smallest to the largest value of a curve."""

PANEL, STRIP = 150, 96
"""Height in pixels of a panel, and of one with a difference."""

_EXACT: WeakKeyDictionary[Any, tuple[np.ndarray, np.ndarray]] = WeakKeyDictionary()


_AXLES: WeakKeyDictionary[Any, tuple[np.ndarray, np.ndarray]] = WeakKeyDictionary()

_BANDS: WeakKeyDictionary[Any, list[list[tuple[float, float, str, str]]]] = WeakKeyDictionary()


def axles(line: Any, t: np.ndarray, every: np.ndarray) -> None:
    """Say what a line shows of other axles: values, a column for each axle."""
    _AXLES[line] = (np.asarray(t, dtype=float), np.asarray(every, dtype=float))


def bands(axis: Any, each: list[list[tuple[float, float, str, str]]]) -> None:
    """Say what the bands of a panel are for each axle."""
    _BANDS[axis] = each


def exact(line: Any, t: np.ndarray, y: np.ndarray) -> None:
    """Say what a line shows, where it is drawn from fewer points."""
    _EXACT[line] = (np.asarray(t, dtype=float), np.asarray(y, dtype=float))


@dataclass
class Curve:
    """A curve: times in s, values, and how it looks."""

    name: str
    t: np.ndarray
    y: np.ndarray
    colour: str
    dash: str = ""
    thin: bool = False
    axles: list[np.ndarray] = field(default_factory=list)


@dataclass
class Panel:
    """A panel: its label, range of values, curves, and bands of the rail (from, to, hue, name).

    Where axles have their own curves, ``by_axle`` has the bands of each.
    """

    label: str
    range: tuple[float, float]
    curves: list[Curve] = field(default_factory=list)
    bands: list[tuple[float, float, str, str]] = field(default_factory=list)
    high: int = PANEL
    by_axle: list[list[tuple[float, float, str, str]]] = field(default_factory=list)


@dataclass
class Live:
    """Panels over one span of time in s, and what is to be said of curves that hide each other."""

    span: tuple[float, float]
    panels: list[Panel]
    hidden: list[str] = field(default_factory=list)


def of_figure(fig: Figure) -> Live | None:
    """Curves of a figure; None if it shows something else than lines over one time.

    Args:
        fig: as it was drawn.
    """
    axes = [a for a in fig.axes if a.get_visible()]
    if not axes or not all(_over_time(a, axes) for a in axes):
        return None
    span = axes[0].get_xlim()
    if any(a.get_xlim() != span for a in axes):
        return None
    made = Live((float(span[0]), float(span[1])), [])
    for axis in axes:
        panel = _panel(axis, made.span)
        if panel is None:
            return None
        made.panels.append(panel)
        made.panels += _differences(panel, made.hidden)
    return made


def _over_time(axis: Axes, axes: Sequence[Axes]) -> bool:
    """Whether an axis shows lines over time, and nothing else."""
    told = [a for a in axes if a is axis or axis.get_shared_x_axes().joined(axis, a)]
    plain = axis.get_xscale() == axis.get_yscale() == "linear"
    other = [c for c in axis.collections if c.get_label() != RANGE]
    only = not (other or axis.images or axis.containers)
    return plain and only and any(a.get_xlabel() == TIME for a in told)


def _panel(axis: Axes, span: tuple[float, float]) -> Panel | None:
    from matplotlib.colors import to_hex

    texts = [" ".join(s.split()) for s in (axis.get_title("left"), axis.get_ylabel()) if s]
    low, high = axis.get_ylim()
    panel = Panel(", ".join(texts), (float(low), float(high)))
    for line in sorted(axis.lines, key=lambda one: one.get_zorder()):
        if line.get_zorder() < 0:
            continue  # borders of the bands
        if line.get_linestyle() == "None":
            return None
        t, y = _EXACT.get(line) or (
            np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float),
        )  # fmt: skip
        if line.get_transform() != axis.transData:  # a level over the whole width
            if len(set(y.tolist())) != 1:
                return None
            t = np.array(span)
        inside = (t >= span[0] - 1e-9) & (t <= span[1] + 1e-9)
        t, y = t[inside], y[inside]
        when, every = _AXLES.get(line) or (t, np.zeros((0, 0)))
        if every.size:
            inside = (when >= span[0] - 1e-9) & (when <= span[1] + 1e-9)
            every = every[inside]
        if not len(t) or not np.isfinite(y).any() or (np.diff(t) < 0).any():
            continue
        name, hue = str(line.get_label()), to_hex(line.get_color()).upper()
        panel.curves.append(Curve(
            "reference" if name.startswith("_") else name, t, y, hue, _dashes(line),
            line.get_linewidth() < 1, list(every.T) if len(every) == len(t) else [],
        ))  # fmt: skip
    panel.by_axle = _BANDS.get(axis, [])
    names = [(float(t.xy[0]), t.get_text()) for t in axis.texts if hasattr(t, "xy")]
    for patch in axis.patches:
        if patch.get_zorder() < 0:
            path = patch.get_patch_transform().transform_path(patch.get_path())
            across = np.asarray(path.vertices)[:, 0]
            a, b = float(across.min()), float(across.max())
            hue = to_hex(patch.get_facecolor())
            panel.bands.append((a, b, hue, next((n for x, n in names if a <= x <= b), "")))
    return panel if panel.curves else None


def _dashes(line: Any) -> str:
    offset_and_marks = getattr(line, "_unscaled_dash_pattern", (0, None))
    marks = offset_and_marks[1]
    return " ".join(f"{1.4 * m:g}" for m in marks) if marks else ""


def _differences(panel: Panel, told: list[str]) -> Iterator[Panel]:
    """Panels of what lies within the line of another curve, and a sentence for each."""
    height = abs(panel.range[1] - panel.range[0])
    for k, below in enumerate(panel.curves):
        if below.thin or len(below.t) < 3:
            continue
        for above in panel.curves[k + 1 :]:
            if above.thin or len(above.t) < 3:
                continue
            same = np.array_equal(above.t, below.t)
            over = above.y if same else np.interp(below.t, above.t, above.y, np.nan, np.nan)
            apart = below.y - over
            seen = np.isfinite(apart)
            if not seen.any() or np.mean(np.abs(apart[seen]) <= SAME * height) < HIDDEN:
                continue
            most = float(np.abs(apart[seen]).max())
            where, _, rest = panel.label.partition(" [")
            where, unit = where or "one panel", f" {rest.rstrip(']')}" if rest else ""
            if most == 0:
                told.append(f"{where}: {below.name} and {above.name} are the same")
                break
            told.append(
                f"{where}: {below.name} and {above.name} differ by at most {most:.3g}{unit}"
            )
            room = 1.06 * most
            t, apart = below.t[seen], apart[seen]
            name = f"{below.name} − {above.name}"
            other = [b - a for b, a in zip(below.axles, above.axles, strict=False)] if same else []
            yield Panel(
                f"difference of {panel.label}", (-room, room),
                [Curve(name, t, apart, below.colour, axles=[a[seen] for a in other])],
                [(a, b, hue, "") for a, b, hue, _ in panel.bands], STRIP,
                [[(a, b, hue, "") for a, b, hue, _ in of] for of in panel.by_axle],
            )  # fmt: skip
            break  # its difference to one of them is enough


# ---- as text in a page ---------------------------------------------------------------------------


def share(figures: Iterable[Live]) -> int:
    """Points that each curve of a page may keep, so that all of them stay within :data:`ALL`."""
    many = sum(max(len(c.axles), 1) for f in figures for p in f.panels for c in p.curves)
    return int(np.clip(ALL * 3 / 4 / 4 / max(many, 1), LEAST, POINTS))


def thin_curve(t: np.ndarray, y: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray, bool]:
    """A curve of at most so many points: of each column its smallest and its largest value.

    Returns:
        Times, values, and whether they come in such pairs.
    """
    if len(t) <= points:
        return t, y, False
    edges = np.linspace(0, len(t), points // 2 + 1).astype(int)
    first, last = edges[:-1], edges[1:] - 1
    inside = np.minimum(first[:, None] + np.arange(np.diff(edges).max()), last[:, None])
    part = y[inside]
    low = first + np.where(np.isnan(part), np.inf, part).argmin(1)
    high = first + np.where(np.isnan(part), -np.inf, part).argmax(1)
    low, high = np.minimum(low, last), np.minimum(high, last)
    keep = np.sort([low, high], axis=0).T.ravel()
    return t[keep], y[keep], True


def _packed(values: np.ndarray, low: float, high: float) -> str:
    """Numbers as 16 bits each between two ends, in base64; the largest says that there is none."""
    wide = high - low or 1.0
    steps = np.round((values - low) / wide * 65534)
    steps = np.where(np.isfinite(steps), np.clip(steps, 0, 65534), 65535)
    return base64.b64encode(steps.astype("<u2").tobytes()).decode()


def text(live: Live, points: int) -> str:
    """What ``live.js`` reads, as JSON that may stand inside a page."""
    return json.dumps(
        {"span": live.span, "panels": [_told(p, live.span, points) for p in live.panels]},
        separators=(",", ":"), ensure_ascii=False,
    ).replace("<", "\\u003c")  # fmt: skip


def _told(panel: Panel, span: tuple[float, float], points: int) -> Mapping[str, Any]:
    curves = []
    for c in panel.curves:
        curves.append({
            "name": c.name, "colour": "currentColor" if c.colour == BLACK else c.colour,
            "dash": c.dash, "thin": c.thin or c.colour == GREY,
            **_packed_curve(c.t, c.y, span, points),
            "axles": [_packed_curve(c.t, y, span, points) for y in c.axles],
        })  # fmt: skip
    return {"label": panel.label, "range": panel.range, "high": panel.high,
            "bands": panel.bands, "byAxle": panel.by_axle, "curves": curves}  # fmt: skip


def _packed_curve(
    t: np.ndarray, y: np.ndarray, span: tuple[float, float], points: int
) -> dict[str, Any]:
    t, y, pairs = thin_curve(t, y, points)
    seen = y[np.isfinite(y)]
    ends = (float(seen.min()), float(seen.max())) if seen.size else (0.0, 0.0)
    return {"pairs": pairs, "ends": ends, "x": _packed(t, *span), "y": _packed(y, *ends)}


def script() -> str:
    """The program that draws them."""
    return (files("slipctl.draw") / "live.js").read_text(encoding="utf-8")


STYLE = """
.live { display: none; font-size: .8rem; }
@media screen { figure.on > .live { display: block; } figure.on > img { display: none; } }
.live .bar { display: flex; gap: .8rem; align-items: baseline; min-height: 1.9em; }
.live .at { margin-left: auto; font-variant-numeric: tabular-nums; }
.live .head { display: flex; flex-wrap: wrap; gap: .1rem .8rem; align-items: baseline;
  padding-left: 64px; }
.live .what { font-weight: 600; }
.live button { font: inherit; color: inherit; background: none; border: 0; padding: 0 .1rem;
  cursor: pointer; }
.live button.reset { border: 1px solid var(--line); border-radius: 3px; padding: 0 .5rem; }
.live .key svg { width: 22px; height: 10px; margin-right: .3rem; }
.live .key[aria-pressed=false] { opacity: .35; text-decoration: line-through; }
.live .key b { display: inline-block; min-width: 3.6em; margin-left: .3rem; text-align: left;
  font-weight: 600; font-variant-numeric: tabular-nums; }
.live > svg { display: block; cursor: crosshair; touch-action: pan-y; user-select: none; }
.live text { font-size: 11px; fill: var(--ink); } .live text.soft { fill: var(--soft); }
.live .grid { stroke: var(--line); stroke-width: .6; }
.live .edge { stroke: var(--soft); stroke-width: .7; opacity: .6; }
.live .curve { fill: none; stroke-linejoin: round; } .live .range { fill-opacity: .28; }
.live .cursor { stroke: var(--ink); stroke-width: .8; stroke-dasharray: 3 2; }
.live .chosen { fill: var(--blue); opacity: .15; } .live .rail { opacity: var(--rail); }
"""
