"""Files of figures: SVG for the page and PNG beside it, drawn in one pass, the same every time."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.image import imsave
from matplotlib.transforms import Affine2D, Bbox

from slipctl.draw.layout import Grid
from slipctl.draw.looks import legends_aside, style
from slipctl.run import store

if TYPE_CHECKING:
    from matplotlib.backend_bases import GraphicsContextBase
    from matplotlib.figure import Figure

POINTS = 72
"""Units of an SVG in an inch."""

PIXELS = 160
"""Pixels of a PNG in an inch."""

PACKED = 3
"""Compression of a PNG, 0 to 9: closer takes as long as drawing it."""


class _Both(RendererBase):
    """Draws on an SVG and, larger, on a picture of pixels.

    What takes time in a figure is to find out what stands where; that is the same for both.
    """

    dpi = POINTS

    def __init__(self, svg: RendererSVG, pixels: RendererAgg) -> None:
        super().__init__()
        self.svg, self.pixels = svg, pixels
        self.scale = PIXELS / POINTS
        self.larger = Affine2D().scale(self.scale)
        for name in ("flipy", "get_canvas_width_height", "get_text_width_height_descent",
                     "open_group", "close_group", "points_to_pixels"):  # fmt: skip
            setattr(self, name, getattr(svg, name))

    def draw_path(self, gc: Any, path: Any, transform: Any, rgbFace: Any = None) -> None:
        """Draw a path."""
        self.svg.draw_path(gc, path, transform, rgbFace)
        self.pixels.draw_path(self._large(gc), path, transform + self.larger, rgbFace)

    def draw_markers(
        self, gc: Any, marker_path: Any, marker_trans: Any, path: Any, trans: Any,
        rgbFace: Any = None,
    ) -> None:  # fmt: skip
        """Draw a marker at each point of a path."""
        self.svg.draw_markers(gc, marker_path, marker_trans, path, trans, rgbFace)
        large = marker_trans + self.larger, path, trans + self.larger
        self.pixels.draw_markers(self._large(gc), marker_path, *large, rgbFace)

    def draw_path_collection(
        self, gc: Any, master_transform: Any, paths: Any, all_transforms: Any, offsets: Any,
        offset_trans: Any, *looks: Any, **more: Any,
    ) -> None:  # fmt: skip
        """Draw many paths."""
        what = paths, all_transforms, offsets
        self.svg.draw_path_collection(gc, master_transform, *what, offset_trans, *looks, **more)
        self.pixels.draw_path_collection(
            self._large(gc), master_transform + self.larger, *what, offset_trans + self.larger,
            *looks, **more,
        )  # fmt: skip

    def draw_text(
        self, gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False,
        mtext: Any = None,
    ) -> None:  # fmt: skip
        """Draw letters."""
        self.svg.draw_text(gc, x, y, s, prop, angle, ismath, mtext)
        where = x * self.scale, y * self.scale
        self.pixels.draw_text(self._large(gc), *where, s, prop, angle, ismath, mtext)

    def _large(self, gc: GraphicsContextBase) -> GraphicsContextBase:
        """The same pen, kept within the same part of the larger picture."""
        pen = self.pixels.new_gc()
        pen.copy_properties(gc)
        if (box := gc.get_clip_rectangle()) is not None:
            pen.set_clip_rectangle(Bbox(self.scale * box.get_points()))
        if gc.get_clip_path()[0] is not None:
            raise NotImplementedError("a part that is cut out along a path")
        return pen

    def start_rasterizing(self) -> None:
        """Refuse: pixels within an SVG are drawn by matplotlib itself."""
        raise NotImplementedError("pixels within an SVG")


def pictures(fig: Figure, stamp: str = "") -> tuple[str, bytes]:
    """Figure as SVG and as PNG, the same text and the same bytes every time.

    Args:
        fig: the figure.
        stamp: what the files say of themselves.
    """
    legends_aside(fig)
    with style():
        try:
            return _in_one_pass(fig, stamp)
        except NotImplementedError:  # pixels within an SVG, say: matplotlib draws each by itself
            return _svg(fig, stamp), _png(fig, stamp)


def svg_text(fig: Figure, stamp: str = "") -> str:
    """Figure as SVG, the same text every time."""
    legends_aside(fig)
    with style():
        return _svg(fig, stamp)


def _in_one_pass(fig: Figure, stamp: str) -> tuple[str, bytes]:
    out = io.StringIO()
    width, height = fig.get_size_inches()
    pixels = RendererAgg(width * PIXELS, height * PIXELS, PIXELS)
    fig.set_dpi(POINTS)
    svg = RendererSVG(width * POINTS, height * POINTS, out, image_dpi=PIXELS, metadata=_told(stamp))
    both = _Both(svg, pixels)
    engine = fig.get_layout_engine()
    if isinstance(engine, Grid):  # what it measures is known when it is drawn
        engine.execute(fig, both)
        fig.set_layout_engine("none")
    fig.draw(both)
    svg.finalize()
    return out.getvalue(), _packed(pixels, stamp)


def _svg(fig: Figure, stamp: str) -> str:
    text = io.StringIO()
    fig.set_dpi(PIXELS)
    FigureCanvasSVG(fig).print_svg(text, metadata=_told(stamp))
    return text.getvalue()


def _png(fig: Figure, stamp: str) -> bytes:
    fig.set_dpi(PIXELS)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return _packed(canvas.get_renderer(), stamp)


def _told(stamp: str) -> dict[str, str | None]:
    return {"Date": None, "Creator": "slipctl", "Description": stamp or None}


def _packed(pixels: RendererAgg, stamp: str) -> bytes:
    file = io.BytesIO()
    imsave(
        file, pixels.buffer_rgba(), format="png", origin="upper", dpi=PIXELS,
        metadata={"Software": "slipctl", "Description": stamp},
        pil_kwargs={"compress_level": PACKED},
    )  # fmt: skip
    return file.getvalue()


def save(fig: Figure, folder: Path, stem: str, stamp: str = "") -> str:
    """Write a figure as PNG and SVG; gives the SVG."""
    svg, png = pictures(fig, stamp)
    store.write_text(folder / f"{stem}.svg", svg)
    store.write_with(folder / f"{stem}.png", lambda path: path.write_bytes(png))
    return svg
